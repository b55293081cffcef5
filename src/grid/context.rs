//! What every pass over the slices is given, and how a pass is cut into jobs.

use std::ops::Range;
use std::sync::Arc;

use super::Cell;
use super::dilate::Dilation;
use super::slice::{Bits, SliceStore, Slices};
use crate::error::Result;
use crate::resources::memory::{Account, MemoryPlan};
use crate::resources::workers::Workers;
use crate::storage::spool::Workspace;
use crate::storage::work::WorkFolder;

/// What every pass over the slices is given: who works, where temporary data goes, how much memory there is.
#[derive(Debug, Clone)]
pub struct Context {
    /// The worker threads.
    pub workers: Workers,
    /// The work directory.
    pub workspace: Workspace,
    /// The shares of the memory budget.
    pub memory: MemoryPlan,
    /// Where finished phases stay, if they are to.
    pub work: Option<Arc<WorkFolder>>,
    /// What its passes were found to take.
    pub account: Arc<Account>,
}

impl Context {
    /// A context with a plan, of which nothing stays. Between its passes, threads give back what they have freed, unless there is plenty of room.
    pub fn new(workers: &Workers, workspace: &Workspace, memory: MemoryPlan) -> Context {
        workers.give_back_after_passes(!memory.is_roomy(memory.predicted));
        Context { workers: workers.clone(), workspace: workspace.clone(), memory, work: None, account: Arc::default() }
    }

    /// The slices that `work` makes of chunks of so many, with so many jobs in flight.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn slices_of(
        &self,
        slices: u32,
        jobs: usize,
        work: impl Fn(Range<u32>, &mut Slices) -> Result<()> + Sync,
    ) -> Result<SliceStore> {
        let mut out = SliceStore::new(&self.workspace, self.memory.store_quota);
        let mut left = chunks(slices);
        self.workers.in_order(
            jobs,
            || Ok(left.next()),
            |chunk| {
                let mut slices = Slices::default();
                work(chunk, &mut slices)?;
                Ok(slices)
            },
            |slices| out.extend(&slices),
        )?;
        Ok(out)
    }

    /// No cell: a store without slices.
    pub fn no_cells(&self) -> SliceStore {
        SliceStore::new(&self.workspace, self.memory.store_quota)
    }

    /// Jobs in flight of a pass over the chunks of `cells`, with a ball of radius `radius`: at least one.
    pub fn jobs(&self, radius: u32, cells: Cell) -> usize {
        let job = job_bytes(radius, cells);
        let jobs = self.memory.jobs_of(job);
        self.account.pass(job * (jobs as u64).min(u64::from(cells[1].div_ceil(CHUNK_SLICES))));
        jobs
    }
}

/// Bytes of a job over a chunk of slices of `cells` with a ball of radius `radius`: its dilation, some slices more, and the runs it gives.
pub fn job_bytes(radius: u32, cells: Cell) -> u64 {
    let [x, _, z] = cells;
    let pad = 2 * (radius + 1);
    Dilation::bytes(radius, x + pad, z + pad) + 4 * Bits::bytes(x + pad, z + pad) + runs_bytes(z + pad)
}

/// Bytes of the runs of cells that a job gives: three a row, as they are, labelled (16 bytes each) and as they are stored.
pub fn runs_bytes(rows: u32) -> u64 {
    u64::from(CHUNK_SLICES + 2) * u64::from(rows) * (2 * (4 + 3 * 8) + 3 * 16)
}

/// Slices that one job of a pass over the slices computes; its window's halo comes on top.
pub const CHUNK_SLICES: u32 = 16;

/// The chunks of `slices` slices: half-open ranges of [`CHUNK_SLICES`], the last one shorter.
pub fn chunks(slices: u32) -> impl Iterator<Item = Range<u32>> {
    (0..slices).step_by(CHUNK_SLICES as usize).map(move |first| first..(first + CHUNK_SLICES).min(slices))
}
