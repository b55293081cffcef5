//! Memory: how a budget is shared out among what a run holds. [`crate::run::planner`] makes the plan.

/// Bytes of a thread: its stack, and its part of what the allocator keeps to itself.
pub(crate) const THREAD: u64 = 1 << 20;

/// How a memory budget is shared out.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct MemoryPlan {
    /// The budget, in bytes.
    pub budget: u64,
    /// Worker threads.
    pub threads: usize,
    /// Blocks of input in flight while bucketing and surveying.
    pub blocks_in_flight: usize,
    /// Chunks of slices in flight.
    pub chunks_in_flight: usize,
    /// A whole chunk of a bucket, in bytes.
    pub bucket_buffer: u64,
    /// Buckets stay in memory up to this many bytes in all: all or nothing.
    pub buckets_quota: u64,
    /// Each store of slices stays in memory up to this many bytes.
    pub store_quota: u64,
    /// The mesh stays in memory up to this many bytes.
    pub mesh_quota: u64,
    /// Points that a slab's fitting holds at once, at most.
    pub points_held: usize,
    /// Pieces that the surface is stitched in at a time, at most.
    pub pieces: usize,
    /// What one pass may use at a time, in bytes.
    pub working: u64,
    /// The most memory that the plan expects to be used, in bytes.
    pub predicted: u64,
    /// The most temporary disk that the plan expects to be used, in bytes.
    pub predicted_disk: u64,
    /// What would be kept in memory with another budget.
    #[serde(skip)]
    pub(crate) keepable: Keepable,
}

/// What is kept in memory from pass to pass where a budget has room for it, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Keepable {
    /// All buckets.
    pub(crate) buckets: u64,
    /// All stores of slices.
    pub(crate) slices: u64,
    /// What the passes are left at the least.
    pub(crate) spare: u64,
}

/// What is kept of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Kept {
    pub(crate) buckets: u64,
    pub(crate) slices: u64,
}

impl Keepable {
    /// What may be kept of `left` bytes: no more than leaves the passes the larger part.
    pub(crate) fn within(self, left: u64) -> Kept {
        let keep = |bytes: u64, left: u64, share: u64| {
            if bytes <= left / share && bytes + self.spare <= left { bytes } else { 0 }
        };
        let buckets = keep(self.buckets, left, 2);
        Kept { buckets, slices: keep(self.slices, left - buckets, 4) }
    }
}

impl MemoryPlan {
    /// Jobs of `bytes` each that the working share lets be in flight at a time: at least one, and no more than keep the threads busy.
    pub fn jobs_of(&self, bytes: u64) -> usize {
        ((self.working / bytes.max(1)) as usize).clamp(1, 2 * self.threads)
    }
}

/// How many slabs exist at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlabJobs {
    /// In the making.
    pub running: usize,
    /// Finished, and waiting for their turn.
    pub ahead: usize,
    /// Points of a slab that are held at once.
    pub points_held: usize,
    /// Pieces that are stitched side by side.
    pub pieces: usize,
    /// Whether each asks the allocator, between its stages, to give back what it has freed.
    pub gives_back: bool,
}

impl SlabJobs {
    /// Of a piece, between source and sink of its pass.
    pub fn in_flight(&self) -> usize {
        let all = self.running + self.ahead;
        // With one, the thread that stitches would make the slabs.
        if self.pieces > 1 { all.div_ceil(self.pieces).max(2) } else { all }
    }
}
