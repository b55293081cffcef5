//! The memory plan: a budget becomes buffer sizes, quotas and numbers of jobs in flight, before the first point is sorted.
//!
//! Passes run one after the other, so the peak is what persists (spools that are kept in memory, the directories of spools)
//! plus the most that any one pass needs. Each pass is given as many jobs in flight as its share allows, at least one; the
//! least budget is what one job of the hungriest pass needs. What is known only later (the exact number of faces of a slab, a large ball) is
//! held against the same share when it is known.
//!
//! ```text
//!   budget = process | buckets (if they fit)  | stores of slices | mesh (if it fits) |  working share: one pass at a time
//! ```

use bytesize::ByteSize;

use crate::context::CHUNK_SLICES;
use crate::error::{Error, Result};
use crate::grid::{Cell, Grid};
use crate::partition::{BUCKET_SLICES, halo, slab_count, slab_slices, smooth_halo};
use crate::points::Precision;
use crate::slice::Bits;
use crate::stage::dilate::Dilation;

/// The process itself: code, directories of spools, what the allocator keeps; and for each thread its stack and its part of that.
const PROCESS: u64 = 12 << 20;
const THREAD: u64 = 3 << 19;

/// A block of input, its decoded points and their sorted copy.
const BLOCK_JOB: u64 = 5 << 20;

/// The smallest chunk of a bucket: whole points of either precision, whole pages of memory and disk.
const CHUNK: u64 = 12 << 10;

/// Chunks are so many times as large at most, and as a power of two: sizes that the allocator has.
const CHUNK_DOUBLINGS: u32 = 4;

/// The largest and smallest piece of points that a slab's fitting holds at once, in points.
const PIECE: (u64, u64) = (4 << 20, 16 << 10);

/// Points in a piece from which smaller ones would cost more than a second slab at a time gains.
const GOOD_PIECE: u64 = 256 << 10;

/// Bytes of a slab's mesh for each face while it is made. While fitting: a vertex as found (21), smoothed (24) and fitted (36),
/// two triangles (24); while contracting, without the first but with fans (32), groups and winners (25); while retreating, without these but with
/// places (24), spots (8), what is seen of fans (9), and triangles by layer (12). The rest is what vectors and the allocator leave unused.
const FACE_BYTES: u64 = 195;

/// Of those, the bytes that remain when the slab waits for its seam.
const FACE_BYTES_WAITING: u64 = 140;

/// Bytes for each face beside a slab, of the planes that are smoothed with it: a vertex as found (21), before and after a step (48).
const SMOOTHED_BYTES: u64 = 69;

/// Bytes for each face of a slab while it is written: positions (24, and 12 narrowed), triangles (26), numbers (8).
const FACE_BYTES_WRITING: u64 = 75;

/// What the plan is made from.
#[derive(Debug, Clone, PartialEq)]
pub struct Load {
    /// Number of points.
    pub points: u64,
    /// Precision of the cloud.
    pub precision: Precision,
    /// Cells along x, slices, rows.
    pub cells: Cell,
    /// Steps of smoothing.
    pub smooth: u32,
}

impl Load {
    /// The load of `points` points on `grid`.
    pub fn new(points: u64, precision: Precision, grid: &Grid, smooth: u32) -> Load {
        Load { points, precision, cells: grid.cells(), smooth }
    }

    /// Bytes of a point in a bucket.
    pub fn record(&self) -> u64 {
        3 * self.precision.bytes() as u64
    }

    /// A surface's faces, roughly: those of the box, and a third more for its slopes; never more than cells allow.
    pub fn faces(&self) -> u64 {
        let [x, y, z] = self.cells.map(u64::from);
        (2 * (x * y + y * z + z * x) * 4 / 3).min(x.saturating_mul(y).saturating_mul(z).saturating_mul(6))
    }

    /// Triangles to expect: two a face, less what contraction takes.
    pub fn triangles(&self) -> u64 {
        self.faces() * 2
    }

    /// Vertices to expect.
    pub fn vertices(&self) -> u64 {
        self.faces()
    }

    /// Bytes of the mesh to expect, in temporary storage.
    pub fn mesh_bytes(&self) -> u64 {
        self.vertices() * self.record() + self.triangles() * 13
    }

    /// Bytes of the points in buckets.
    pub fn bucket_bytes(&self) -> u64 {
        self.points * self.record()
    }

    /// Bytes that slices take as runs, to expect: a dozen runs of 8 bytes a row and slice in all stores together, and their directories.
    pub fn slice_bytes(&self) -> u64 {
        let [_, y, z] = self.cells.map(u64::from);
        y * z * 160 + y * 64
    }

    /// Temporary disk to expect when nothing is kept in memory.
    pub fn disk(&self) -> u64 {
        self.bucket_bytes() + self.mesh_bytes() + self.slice_bytes()
    }

    /// Bytes that one slab's job holds besides the points and the mesh: its planes of corners, its index of points.
    fn slab_raster(&self) -> u64 {
        let [x, _, z] = self.cells;
        let bits = Bits::bytes(x + 2, z + 2);
        u64::from(slab_slices(self.smooth) + 2 * smooth_halo(self.smooth) + 1) * bits * 3 / 2
            + 3 * bits
            + u64::from(2 * halo(self.smooth)) * bits * 3 / 2
    }

    /// Faces of one slab, to expect: the mean. The estimate of all faces lies above what surfaces have, which makes up for uneven slabs.
    fn slab_faces(&self) -> u64 {
        self.faces().div_ceil(u64::from(slab_count(self.smooth, self.cells[1])))
    }
}

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
    /// The buffer of one bucket, in bytes.
    pub bucket_buffer: u64,
    /// Buckets stay in memory up to this many bytes in all: all or nothing.
    pub buckets_quota: u64,
    /// Each store of slices stays in memory up to this many bytes.
    pub store_quota: u64,
    /// The mesh stays in memory up to this many bytes.
    pub mesh_quota: u64,
    /// Points that a slab's fitting holds at once, at most.
    pub piece_points: usize,
    /// What one pass may use at a time, in bytes.
    pub working: u64,
    /// The most memory that the plan expects to be used, in bytes.
    pub predicted: u64,
    /// The most temporary disk that the plan expects to be used, in bytes.
    pub predicted_disk: u64,
}

impl MemoryPlan {
    /// Shares out `budget` bytes for `load` on `threads` threads.
    ///
    /// # Errors
    /// [`Error::Budget`] with the least budget that would do.
    pub fn for_budget(budget: u64, load: &Load, threads: usize) -> Result<MemoryPlan> {
        let least = Self::least(load, threads);
        if budget < least {
            return Err(Error::Budget {
                given: ByteSize(budget),
                needed: ByteSize(least.next_multiple_of(1 << 20)),
                what: "the smallest plan for this cloud",
            });
        }
        let threads = threads.max(1);
        let process = process(threads);
        let mut left = budget - process;
        // Kept in memory only what leaves the passes the larger part, and twice the least: a slab may turn out to have more faces than
        // expected, and the budget that is then named must not be eaten up by what it would allow to keep.
        let spare = 2 * (least - process);
        let mut keep = |bytes: u64, share: u64| {
            let kept = if bytes <= left / share && bytes + spare <= left { bytes } else { 0 };
            left -= kept;
            kept
        };
        let buckets_quota = keep(load.bucket_bytes(), 2);
        // A spool that grows in memory may hold twice its bytes for a moment.
        let mesh_quota = keep(load.mesh_bytes() * 2, 3) / 2;
        let store_quota = keep((load.slice_bytes() * 2).max(1 << 20), 4) / 8;
        let working = left;

        let buckets = u64::from(load.cells[1].div_ceil(BUCKET_SLICES));
        let jobs = |per_job: u64, share: u64, most: usize| ((share / per_job.max(1)) as usize).clamp(1, most);
        let blocks_in_flight = jobs(BLOCK_JOB, working / 2, 2 * threads);
        let for_buffers = working.saturating_sub(blocks_in_flight as u64 * BLOCK_JOB) / 4 * 3;
        let doublings = (for_buffers / buckets / CHUNK).max(1).ilog2().min(CHUNK_DOUBLINGS);
        let bucket_buffer = CHUNK << doublings;
        let chunks_in_flight = jobs(Self::chunk_job(load, 1), working, 2 * threads);
        let running = threads as u64;
        let for_points = (working / 2 / running).saturating_sub(load.slab_raster());
        let slab_points = load.bucket_bytes() / load.record()
            * u64::from(slab_slices(load.smooth) + 2 * halo(load.smooth))
            / u64::from(load.cells[1])
            + 1;
        let piece_points = (for_points / point_bytes(load)).clamp(PIECE.1, PIECE.0);
        let mut plan = MemoryPlan {
            budget,
            threads,
            blocks_in_flight,
            chunks_in_flight,
            bucket_buffer,
            buckets_quota,
            store_quota,
            mesh_quota,
            piece_points: piece_points as usize,
            working,
            predicted: 0,
            predicted_disk: 0,
        };
        let slabs = plan.slab_jobs(load, load.slab_faces(), 0)?;
        let passes = [
            blocks_in_flight as u64 * BLOCK_JOB + (buckets * bucket_buffer / 3 * 4).min(load.bucket_bytes()),
            chunks_in_flight as u64 * Self::chunk_job(load, 1),
            slabs.running as u64 * slab_job(load, load.slab_faces(), slab_points.min(slabs.piece_points as u64))
                + (slabs.waiting as u64 - 2) * load.slab_faces() * FACE_BYTES_WAITING
                + stitching(load.slab_faces()),
        ];
        let kept = buckets_quota.min(load.bucket_bytes())
            + mesh_quota.min(load.mesh_bytes())
            + (8 * store_quota).min(load.slice_bytes());
        plan.predicted = process + kept + passes.into_iter().max().unwrap_or(0);
        plan.predicted_disk = load.disk() - kept.min(load.disk());
        Ok(plan)
    }

    /// The least budget for a load on `threads` threads, in bytes.
    pub fn least(load: &Load, threads: usize) -> u64 {
        let buckets = u64::from(load.cells[1].div_ceil(BUCKET_SLICES));
        let bucketing = BLOCK_JOB + buckets * CHUNK / 3 * 4 + 4;
        let slices = Self::chunk_job(load, 1);
        let slab = slab_job(load, load.slab_faces(), PIECE.1) + stitching(load.slab_faces());
        process(threads) + (2 << 20) + bucketing.max(slices).max(slab)
    }

    /// Bytes of a job over a chunk of slices with a ball of radius `radius`: its dilation, some slices more, and the runs it gives, three a row, as
    /// they are, labelled (16 bytes each) and as they are stored.
    fn chunk_job(load: &Load, radius: u32) -> u64 {
        let [x, _, z] = load.cells;
        let pad = 2 * (radius + 1);
        Dilation::bytes(radius, x + pad, z + pad)
            + 4 * Bits::bytes(x + pad, z + pad)
            + u64::from(CHUNK_SLICES + 2) * u64::from(z + pad) * (2 * (4 + 3 * 8) + 3 * 16)
    }

    /// Chunks in flight for a ball of radius `radius`, at least one.
    pub fn chunks_for(&self, load: &Load, radius: u32) -> usize {
        ((self.working / Self::chunk_job(load, radius)) as usize).clamp(1, 2 * self.threads)
    }

    /// Slabs that may be in the making and waiting at a time, when the largest has `faces` faces and each needs `means` bytes for means of cells.
    ///
    /// # Errors
    /// [`Error::Budget`] if one in the making and two at a seam are too much.
    pub fn slab_jobs(&self, load: &Load, faces: u64, means: u64) -> Result<SlabJobs> {
        let waiting = faces * FACE_BYTES_WAITING;
        let for_jobs = self.working.saturating_sub(stitching(faces));
        let besides_points = slab_job(load, faces, 0) + means;
        for running in (1..=self.threads).rev() {
            let room = (for_jobs / running as u64).saturating_sub(besides_points) / point_bytes(load);
            let piece_points = room.min(self.piece_points as u64);
            // Two slabs at a time are worth smaller pieces of points, but not ever smaller ones: each is searched anew.
            let enough = if running == 1 { PIECE.1 } else { GOOD_PIECE };
            if piece_points >= enough.min(self.piece_points as u64) {
                let left = for_jobs - running as u64 * (slab_job(load, faces, piece_points) + means);
                // Beyond one for each thread, jobs in flight are finished slabs that wait for their turn.
                let room_ahead = ((left / waiting.max(1)) as usize).min(self.threads);
                let ahead = if running == self.threads { room_ahead } else { 0 };
                let piece_points = piece_points as usize;
                return Ok(SlabJobs { running, waiting: ahead + 2, in_flight: running + ahead, piece_points });
            }
        }
        let least = stitching(faces) + slab_job(load, faces, PIECE.1) + means;
        Err(Error::Budget {
            given: ByteSize(self.budget),
            needed: ByteSize((self.budget - self.working + least).next_multiple_of(1 << 20)),
            what: "the slab with the most faces",
        })
    }
}

/// Bytes of the process with its threads.
fn process(threads: usize) -> u64 {
    PROCESS + THREAD * threads.max(1) as u64
}

/// Bytes of the two slabs at a seam, one of them being written, with `faces` faces each.
fn stitching(faces: u64) -> u64 {
    faces * (2 * FACE_BYTES_WAITING + FACE_BYTES_WRITING)
}

/// Bytes that a point takes while a slab is fitted: read, sorted by slice, and sorted by cell a window at a time.
fn point_bytes(load: &Load) -> u64 {
    load.record() * 3 + 16
}

/// Bytes of a slab in the making, with `faces` faces and `points` points at once.
fn slab_job(load: &Load, faces: u64, points: u64) -> u64 {
    // Of the planes that only smoothing needs, in proportion: and there, before and after a step are held at once.
    let smoothed = u64::from(2 * smooth_halo(load.smooth)) * SMOOTHED_BYTES / u64::from(slab_slices(load.smooth));
    load.slab_raster() + points * point_bytes(load) + faces * (FACE_BYTES + smoothed)
}

/// How many slabs exist at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlabJobs {
    /// In the making.
    pub running: usize,
    /// Finished, waiting for their turn or for their seam.
    pub waiting: usize,
    /// Between source and sink of the pass.
    pub in_flight: usize,
    /// Points of a slab that are held at once.
    pub piece_points: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(points: u64, s: u32) -> Load {
        Load { points, precision: Precision::Single, cells: [s; 3], smooth: 1 }
    }

    #[test]
    fn the_least_budget_is_accepted_and_one_byte_less_is_refused_with_it() {
        for (points, s) in [(1, 1), (36_000, 132), (100_000_000, 1856), (1_000_000_000, 4000)] {
            let load = load(points, s);
            for threads in [1, 2, 64] {
                MemoryPlan::for_budget(MemoryPlan::least(&load, threads), &load, threads).unwrap();
            }
            let least = MemoryPlan::least(&load, 2);
            let Err(Error::Budget { needed, .. }) = MemoryPlan::for_budget(least - 1, &load, 2) else {
                panic!("a budget below the least was accepted")
            };
            assert!(needed.0 >= least && needed.0 < least + (1 << 20));
        }
    }

    #[test]
    fn the_prediction_keeps_the_budget() {
        for budget in [64u64 << 20, 200 << 20, 1 << 30, 6 << 30] {
            for (points, s) in [(1, 1), (36_000, 132), (20_000_000, 1085), (100_000_000, 1856)] {
                if let Ok(plan) = MemoryPlan::for_budget(budget, &load(points, s), 2) {
                    assert!(plan.predicted <= budget, "{budget} {points} {plan:?}");
                }
            }
        }
    }

    #[test]
    fn more_memory_never_means_smaller_shares() {
        let load = load(20_000_000, 1085);
        let small = MemoryPlan::for_budget(128 << 20, &load, 2).unwrap();
        let large = MemoryPlan::for_budget(8 << 30, &load, 2).unwrap();
        assert_eq!(small.buckets_quota, 0, "240 MB of points do not fit into 128 MiB");
        assert!(large.buckets_quota >= load.bucket_bytes());
        assert!(large.piece_points >= small.piece_points);
    }
}
