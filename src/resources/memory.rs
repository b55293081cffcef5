//! Memory: how a budget is shared out among what a run holds. [`crate::run::planner`] makes the plan.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

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
    /// What makes up the most memory that is expected.
    pub(crate) passes: Passes,
}

/// The most memory that passes are expected to take, in bytes; each is planned anew as more is known.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub(crate) struct Passes {
    /// What goes to an object store, beside all others.
    pub(crate) transfers: u64,
    /// The survey.
    pub(crate) surveying: Pass,
    /// Sorting points into buckets.
    pub(crate) bucketing: Pass,
    /// Finding the occupied cells, closing them, and opening them again.
    pub(crate) closing: Pass,
    /// The making of slabs.
    pub(crate) slabs: u64,
    /// The same as their stages counted it when they began; none before slabs are made.
    pub(crate) slabs_counted: Option<u64>,
    /// Distances, simplification and levels, where they are asked for.
    pub(crate) asked: u64,
    /// The check, and the writing of the mesh.
    pub(crate) check: u64,
}

/// What one of them is expected to take.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub(crate) struct Pass {
    /// Bytes of the heap.
    pub(crate) bytes: u64,
    /// Threads that have something to do in it.
    pub(crate) busy: u64,
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

/// What passes before slabs were found to take at most when they began, in bytes: a plan that is made beforehand can only expect it.
#[derive(Debug, Default)]
pub struct Account {
    field: AtomicU64,
    pass: AtomicU64,
    reopening: AtomicU64,
    measuring: AtomicU64,
    /// What slabs in the making hold, those that wait, and the mesh that they become.
    pub slabs: Arc<Tally>,
}

/// What an account comes to when the cells are closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Closing {
    /// Telling inside and outside apart on a level of cells; none if nothing had to be told apart.
    pub field: u64,
    /// All jobs of the pass over chunks of slices that takes the most.
    pub pass: u64,
    /// All jobs that open again what was filled; none if nothing was.
    pub reopening: u64,
    /// All jobs that measure how thick the shell of points is; none if it was not.
    pub measuring: u64,
}

impl Account {
    /// The sides of a level's cells are going to be found in so many bytes.
    pub fn field(&self, bytes: u64) {
        self.field.fetch_max(bytes, Ordering::Relaxed);
    }

    /// All jobs of a pass over chunks of slices are going to take so many bytes.
    pub fn pass(&self, bytes: u64) {
        self.pass.fetch_max(bytes, Ordering::Relaxed);
    }

    /// What was filled is going to be opened again in so many bytes.
    pub fn reopening(&self, bytes: u64) {
        self.reopening.fetch_max(bytes, Ordering::Relaxed);
    }

    /// The shell of points is going to be measured in so many bytes.
    pub fn measuring(&self, bytes: u64) {
        self.measuring.fetch_max(bytes, Ordering::Relaxed);
    }

    /// The account so far.
    pub fn closing(&self) -> Closing {
        let of = [&self.field, &self.pass, &self.reopening, &self.measuring];
        let [field, pass, reopening, measuring] = of.map(|bytes| bytes.load(Ordering::Relaxed));
        Closing { field, pass, reopening, measuring }
    }
}

/// What several hold at a time, in bytes, as each says when it knows.
#[derive(Debug, Default)]
pub struct Tally {
    now: AtomicU64,
    most: AtomicU64,
}

impl Tally {
    /// The most that was held at a time.
    pub fn most(&self) -> u64 {
        self.most.load(Ordering::Relaxed)
    }
}

/// What one of them holds, as long as it exists; without a tally, nobody counts it.
#[derive(Debug, Default)]
pub struct Claim {
    tally: Option<Arc<Tally>>,
    bytes: u64,
}

impl Claim {
    /// A claim to nothing yet.
    pub fn of(tally: &Arc<Tally>) -> Claim {
        Claim { tally: Some(Arc::clone(tally)), bytes: 0 }
    }

    /// How much it holds.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// From now on it holds so much.
    pub fn set(&mut self, bytes: u64) {
        if let Some(Tally { now, most }) = self.tally.as_deref() {
            if bytes >= self.bytes {
                let more = bytes - self.bytes;
                most.fetch_max(now.fetch_add(more, Ordering::Relaxed) + more, Ordering::Relaxed);
            } else {
                now.fetch_sub(self.bytes - bytes, Ordering::Relaxed);
            }
        }
        self.bytes = bytes;
    }
}

impl Clone for Claim {
    fn clone(&self) -> Claim {
        let mut copy = Claim { tally: self.tally.clone(), bytes: 0 };
        copy.set(self.bytes);
        copy
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        self.set(0);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tally_is_what_claims_came_to_at_a_time() {
        let tally = Arc::default();
        let (mut one, mut other) = (Claim::of(&tally), Claim::of(&tally));
        one.set(5);
        other.set(7);
        one.set(2);
        let copy = one.clone();
        assert_eq!(tally.most(), 12);
        drop((copy, other));
        one.set(12);
        assert_eq!(tally.most(), 12);
        one.set(13);
        assert_eq!((tally.most(), one.bytes()), (13, 13));
    }
}
