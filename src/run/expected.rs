//! Expectation: the most memory and disk that a plan lets a run take, pass by pass.
//!
//! Shares of a budget ([`crate::run::planner`]) are given out before anything is known, and are large enough for whatever comes. What is expected of a pass is told anew when more is
//! known: blocks of the input when it was read, fields and what is opened again when cells are closed, slabs when each of their stages begins, the check when the mesh is there. So the
//! figure of a report is that of each pass as it began.

use crate::grid::context::{CHUNK_SLICES, job_bytes, runs_bytes};
use crate::grid::slice::Bits;
use crate::mesh::MeshSource;
use crate::mesh::check::job::Need;
use crate::mesh::spool::MeshSpool;
use crate::nearest::bridged;
use crate::resources::memory::{Closing, MemoryPlan, Pass, Passes};
use crate::run::planner::{
    FILLING, HEAP, KEPT_BACK, checking, deciding, jobs_of_all, looking, measuring, reopening, reopening_records,
    survey_jobs,
};
use crate::run::pyramid;
use crate::run::slab_jobs::STITCHING;
use crate::run::workload::Workload;
use crate::simplify::Extent;
use crate::solid::heightfield;
use crate::storage::spool;

use crate::error::Result;

/// What is resident whatever the program does, as it was found: the process, what the allocator keeps to itself, the coarse grid. Of the heap, [`HEAP`] is the most.
///
/// The rule for this figure and those below: of runs of random configurations (`tools/memory.py`), what was resident beside what passes said was held; each figure the one that
/// leaves the fewest plans far from what was resident. Budgets are given out with more ([`MemoryPlan::least`]), as some runs had.
const ALWAYS: u64 = 5 << 19;

/// What each thread, and the allocator for it, has to itself beside what passes hold: in most, and where slabs are made.
const THREAD_OF_PASS: u64 = 1 << 16;
const THREAD_OF_SLABS: u64 = 5 << 16;

/// What each job that makes slabs has to itself, beside what its stages counted.
const JOB_OF_SLABS: u64 = 4 << 16;

/// What a mesh's spools have room for at their ends.
const SPOOLS: u64 = 4 * spool::PIECE as u64;

/// What slabs have freed and the allocator still has, as a part of what they hold: where they give it back between their stages, and where they do not.
const FREED: (u64, u64) = (32, 16);

impl Passes {
    /// The most of the heap at a time.
    fn heap(self) -> u64 {
        HEAP + Passes { slabs_counted: None, ..self }.beside_threads([0; 2], 0)
    }

    /// The most at a time, with so many threads.
    fn most(self, threads: usize) -> u64 {
        ALWAYS + self.beside_threads([THREAD_OF_PASS, THREAD_OF_SLABS], threads as u64)
    }

    fn beside_threads(self, [thread, of_slabs]: [u64; 2], threads: u64) -> u64 {
        let slabs = self.slabs_counted.unwrap_or(self.slabs + threads * of_slabs);
        let early = [self.surveying, self.bucketing, self.closing];
        let early = early.map(|Pass { bytes, busy }| bytes + busy.min(threads) * thread);
        let late = [self.asked, self.check].map(|bytes| bytes + threads * thread);
        self.transfers + early.into_iter().chain(late).max().unwrap_or(0).max(slabs)
    }
}

impl MemoryPlan {
    /// What of the memory that is expected to be used is taken from the heap, at the most.
    pub fn heap(&self) -> u64 {
        self.passes.heap()
    }

    /// The same plan with the memory that passes are expected to take.
    pub(super) fn with_passes(self, passes: Passes) -> MemoryPlan {
        let most = passes.most(self.threads);
        // What slabs counted has it.
        let keeps = passes.slabs_counted.is_none() && self.is_roomy(most);
        let kept_back = if keeps { most / KEPT_BACK } else { 0 };
        MemoryPlan { passes, predicted: most + kept_back, ..self }
    }

    /// The same plan with what the passes until the cells are closed take by the plan that they run with: what is expected of them, and of closing, if that is known, what was found.
    pub(super) fn with_passes_before(
        self,
        before: &MemoryPlan,
        workload: &Workload,
        closing: Option<Closing>,
    ) -> MemoryPlan {
        let (surveying, bucketing) = (before.surveying(workload), before.bucketing(workload));
        let passes = Passes { surveying, bucketing, closing: before.closing(workload, closing), ..self.passes };
        self.with_passes(passes)
    }

    /// The same plan when slabs of a mesh have told that they and it took so many bytes at a time; nothing if none was made here.
    pub(super) fn with_slabs_made(self, workload: &Workload, mesh: &MeshSpool, most: u64) -> MemoryPlan {
        if most == 0 {
            return self;
        }
        let lasting = self.held(workload) + workload.standing_slice_bytes().min(self.slices_quota());
        // What is on its way to the mesh is no more than a slab, and than all of the mesh: once as it is gathered, once as it is handed on.
        let widest = workload.slabs().iter().map(|slab| slab.bytes(&workload.made())).max().unwrap_or(0);
        let stitching = self.pieces as u64 * STITCHING.min(2 * widest.min(mesh.bytes()) + SPOOLS);
        let held = lasting + most + stitching;
        let Ok(jobs) = self.slab_jobs(workload) else { return self };
        let beside = jobs.running.min(workload.slabs().len()) as u64 * JOB_OF_SLABS;
        let counted = held + held / if jobs.gives_back { FREED.0 } else { FREED.1 } + beside;
        let counted = counted.min(self.budget.saturating_sub(ALWAYS + self.passes.transfers));
        let passes = Passes { slabs_counted: Some(counted), ..self.passes };
        self.with_passes(passes)
    }

    /// The same plan when the mesh is there, which is checked, or not, and then written in so many bytes beside it.
    pub(super) fn with_mesh(self, mesh: &MeshSpool, checked: bool, filling: u64) -> MemoryPlan {
        let in_memory = if self.mesh_quota > 0 { mesh.bytes().min(self.mesh_quota) } else { 0 };
        let (vertices, triangles) = (mesh.vertex_count(), mesh.face_count());
        let check = match checked {
            true => Need::of_spans(vertices, triangles, mesh.spans(), self.threads).within(self.working).bytes(),
            false => 0,
        };
        let meanwhile = self.fills_meanwhile(vertices, triangles);
        let both = if meanwhile { check + filling } else { check.max(filling) };
        let passes = Passes { check: in_memory + both, ..self.passes };
        self.with_passes(passes)
    }

    /// The most memory that passes are expected to take, of a mesh that is not there.
    pub(super) fn passes_of(&self, workload: &Workload) -> Result<Passes> {
        let standing = workload.standing_slice_bytes().min(self.slices_quota());
        let mesh = self.mesh_quota.min(workload.mesh_bytes());
        let lasting = self.held(workload) + standing;
        let asked = [
            workload.bridging().map(|extent| lasting + extent.memory(self.working, self.threads)),
            workload.simplified().map(|extent| extent.memory(self.working, self.threads)),
            workload.levels().map(|extent| extent.memory(self.working, self.threads).max(pyramid::LEAST)),
        ];
        Ok(Passes {
            transfers: workload.transfers(),
            surveying: self.surveying(workload),
            bucketing: self.bucketing(workload),
            closing: self.closing(workload, None),
            slabs: lasting + self.slab_jobs(workload)?.bytes_beside(workload, mesh),
            slabs_counted: None,
            asked: asked.into_iter().flatten().max().map_or(0, |most| mesh + most),
            check: mesh + self.checking(checking(workload, self.threads), (workload.mesh_bytes(), mesh)),
        })
    }

    /// What the check takes, and the writing of a mesh of so many bytes meanwhile, of which so many lie in memory.
    fn checking(&self, check: Need, (mesh, in_memory): (u64, u64)) -> u64 {
        let most = match self.mesh_quota {
            0 if self.fills_beside(check) => mesh,
            0 => 0,
            _ => in_memory,
        };
        check.within(self.working).bytes() + most.min(FILLING * jobs_of_all(self.threads))
    }

    /// The survey.
    fn surveying(&self, workload: &Workload) -> Pass {
        let surveying = workload.surveying();
        let threads = self.threads as u64;
        let bytes = surveying.bytes_as_read(survey_jobs(surveying, self.budget, self.threads) as u64, threads);
        Pass { bytes: bytes.max(workload.upsampling()), busy: self.busy(surveying.blocks) }
    }

    /// Sorting points into buckets.
    fn bucketing(&self, workload: &Workload) -> Pass {
        let blocks = self.blocks(workload);
        let buckets = self.buckets_quota.min(workload.bucket_bytes());
        let open = self.open_chunks(workload);
        // A block that waits for a thread is not decoded yet.
        let under_way = blocks.min(self.threads as u64);
        let sorting = blocks * workload.surveying().as_read + under_way * workload.sorting_a_block();
        let bytes = buckets + sorting + if buckets > 0 { open / 2 } else { open };
        Pass { bytes, busy: self.busy(blocks) }
    }

    /// Bytes of closing the cells and opening them again, as that was found to take.
    pub(super) fn bytes_of_closing(&self, workload: &Workload, closing: Closing) -> u64 {
        self.closing(workload, Some(closing)).bytes
    }

    /// Closing the cells and opening them again; with what it was found to take, if that is known.
    fn closing(&self, workload: &Workload, closing: Option<Closing>) -> Pass {
        let sealing = workload.slice_bytes().min(self.slices_quota());
        // A pass over few slices has no more jobs than chunks.
        let of_pass =
            |jobs: usize, slices_of_job: u32| (jobs as u64).min(u64::from(workload.cells[1].div_ceil(slices_of_job)));
        let slices = of_pass(self.chunks_in_flight, CHUNK_SLICES) * job_bytes(1, workload.cells);
        let columns = workload.columns.map_or(0, |columns| {
            let (of_slice, bridge) = (columns.of_slice, columns.bridge);
            // The cells of the solid are made of them, slice by slice.
            let [width, slices, rows] = workload.cells;
            let given = of_pass(self.chunks_in_flight, CHUNK_SLICES) * (Bits::bytes(width, rows) + runs_bytes(rows));
            given
                + heightfield::bytes_of_pass(
                    of_slice,
                    bridge,
                    workload.smooth,
                    slices,
                    (self.chunks_in_flight, self.threads),
                )
        });
        let job = reopening(workload);
        let measuring = measuring(workload);
        let measuring = measuring * of_pass(self.jobs_of(measuring).min(self.threads), 1);
        let Closing { field, pass, reopening, measuring } = closing.unwrap_or_else(|| Closing {
            field: deciding(workload),
            pass: slices,
            reopening: of_pass(self.jobs_of(job), CHUNK_SLICES) * job,
            measuring,
        });
        // Sides are told apart while occupied cells are all that there is, and those of a coarser level: as many bytes as later the solid has.
        let occupied = workload.standing_slice_bytes().min(sealing);
        let looking = looking(workload, self.blocks(workload));
        let passes = pass.max(slices).max(columns).max(reopening).max(looking).max(measuring);
        let closing = (sealing + passes).max(occupied + field);
        let chunks = u64::from(workload.cells[1].div_ceil(CHUNK_SLICES));
        // Where a field is looked for, all threads look.
        let busy = if workload.columns.is_none() { self.threads as u64 } else { self.busy(chunks) };
        Pass { bytes: self.held(workload) + closing, busy }
    }

    /// Threads that have something to do in a pass of so many jobs: the calling one is beside them.
    fn busy(&self, jobs: u64) -> u64 {
        (self.threads as u64).min(1 + jobs)
    }

    /// Blocks of the input that are in flight at the most.
    fn blocks(&self, workload: &Workload) -> u64 {
        (self.blocks_in_flight as u64).min(workload.blocks())
    }

    /// Bytes of open chunks: one is whole as memory goes, once it was another's.
    fn open_chunks(&self, workload: &Workload) -> u64 {
        let chunks = workload.buckets() + self.blocks(workload);
        (chunks * self.bucket_buffer / 15 * 16).min(workload.bucket_bytes())
    }

    /// Bytes of the buckets that stay in memory.
    fn held(&self, workload: &Workload) -> u64 {
        let buckets = self.buckets_quota.min(workload.bucket_bytes());
        if buckets > 0 { buckets + self.open_chunks(workload) / 2 } else { 0 }
    }

    /// The most temporary disk that is going to be used.
    pub(super) fn disk_of(&self, workload: &Workload) -> u64 {
        let mesh = self.mesh_quota.min(workload.mesh_bytes());
        let bucketed = workload.bucket_bytes() - self.buckets_quota.min(workload.bucket_bytes());
        let sealing = if self.store_quota > 0 { 0 } else { workload.slice_bytes() };
        let sealing = sealing + reopening_records(workload).saturating_sub(self.store_quota);
        let standing = if self.store_quota > 0 { 0 } else { workload.standing_slice_bytes() };
        let surface = standing + workload.mesh_bytes() - mesh + workload.bridging().map_or(0, bridged::Extent::disk);
        let kept = if workload.bridging().is_some() { 0 } else { mesh };
        let fewer = workload.simplified().or(workload.levels());
        // Slices, and what passes leave, that are kept in the work folder, too.
        let (saved, times) = if workload.is_outlasting() { (workload.standing_slice_bytes(), 2) } else { (0, 1) };
        let simplifying = workload.mesh_bytes() - kept + times * fewer.map_or(0, Extent::disk);
        bucketed + saved + sealing.max(surface).max(simplifying)
    }
}
