//! What every pass over the slices is given, and how a pass is cut into jobs.

use crate::resources::workers::Workers;
use crate::run::planner::MemoryPlan;
use crate::run::workload::Load;
use crate::storage::spool::Workspace;

/// What every pass over the slices is given: who works, where temporary data goes, how much memory there is.
#[derive(Debug, Clone)]
pub struct Context {
    /// The worker threads.
    pub workers: Workers,
    /// The work directory.
    pub workspace: Workspace,
    /// The shares of the memory budget.
    pub memory: MemoryPlan,
    /// What the plan was made from.
    pub load: Load,
}

/// Slices that one job of a pass over the slices computes; its window's halo comes on top.
pub const CHUNK_SLICES: u32 = 16;

/// The chunks of `slices` slices: half-open ranges of [`CHUNK_SLICES`], the last one shorter.
pub fn chunks(slices: u32) -> impl Iterator<Item = std::ops::Range<u32>> {
    (0..slices).step_by(CHUNK_SLICES as usize).map(move |first| first..(first + CHUNK_SLICES).min(slices))
}
