//! The memory plan: a budget becomes buffer sizes, quotas and numbers of jobs in flight, before the first point is sorted.
//!
//! Passes run one after the other, so the peak is what persists (spools that are kept in memory, the directories of spools)
//! plus the most that any one pass needs. Each pass is given as many jobs in flight as its share allows, at least one; the
//! least budget is what one job of the hungriest pass needs.
//!
//! ```text
//!   budget = process | buckets (if they fit)  | stores of slices | mesh (if it fits) |  working share: one pass at a time
//! ```
//!
//! The plan is made twice. First from the number of points, the grid, and how many faces each slab is expected to have ([`crate::run::estimate`], or the box
//! alone). Then, when the solid is known, its faces are counted, and what is not yet given out is shared out anew. What is expected to be used of it all is told
//! by [`crate::run::expected`].

use bytesize::ByteSize;

use crate::error::{Error, Result};
use crate::grid::context::job_bytes;
use crate::mesh::check::job::Need;
use crate::nearest::bridged;
use crate::resources::memory::{Closing, Keepable, Kept, MemoryPlan, Passes, SlabJobs, THREAD};
use crate::resources::workers::Workers;
use crate::run::pyramid;
use crate::run::slab_jobs::{HELD, held_in};
use crate::run::workload::{SurveyWorkload, Workload};
use crate::settings::surface::Fit;
use crate::simplify::Extent;
use crate::solid::heightfield;
use crate::solid::level;
use crate::solid::reopen;
use crate::solid::sign;
use crate::surface::thickness;

/// What the program takes from the heap whatever it does: the coarse grid, files, words.
pub(super) const HEAP: u64 = 3 << 20;

/// What it has beside that: data, and what the allocator keeps to itself.
const PROCESS: u64 = 5 << 20;

/// What a least budget has beside what its hungriest pass needs.
const BESIDE: u64 = 2 << 20;

/// Threads that a piece of the surface keeps busy: what stitching does for each slab is a quarter of what its making takes.
const THREADS_OF_PIECE: usize = 4;

/// A piece has so many slabs at least: where seams are not clean, several are made twice at its ends.
const SLABS_OF_PIECE: usize = 24;

/// The smallest chunk of a bucket: whole points of either precision, whole pages of memory and disk.
const CHUNK: u64 = 12 << 10;

/// Chunks are so many times as large at most, and as a power of two: sizes that the allocator has.
const CHUNK_DOUBLINGS: u32 = 4;

/// So many held at once that fewer would cost more than a second slab at a time gains.
const ENOUGH_HELD: u64 = 128 << 10;

/// A budget so many times as large as what is used is not one that anybody named: then the allocator keeps what slabs give back for the next (`main.rs`), this part
/// of it all.
const ROOMY: u64 = 4;
pub(super) const KEPT_BACK: u64 = 8;

/// Slabs that take more than this part of what there is for them give back what they have freed between their stages. Else, of eight threads on two processors, each may hold what it
/// freed until it is its turn to run again: 38 MiB beside slabs of 67 were seen, in a budget of 100.
const GIVE_BACK_ABOVE: u64 = 2;

/// What a job that writes a mesh file takes: of STL, 65,536 triangles, and its part of the vertices that are read together.
pub(super) const FILLING: u64 = 5 << 20;

impl MemoryPlan {
    /// Shares out `budget` bytes for `load` on `threads` threads.
    ///
    /// # Errors
    /// [`Error::Budget`] with the least budget that would do.
    pub fn for_budget(budget: u64, workload: &Workload, threads: usize) -> Result<MemoryPlan> {
        let least = Self::least(workload, threads);
        if budget < least {
            return Err(Error::Budget {
                given: ByteSize(budget),
                needed: ByteSize(least.next_multiple_of(1 << 20)),
                what: "the smallest plan for this cloud",
            });
        }
        let threads = threads.max(1);
        let pieces = threads.div_ceil(THREADS_OF_PIECE).min(workload.slabs().len() / SLABS_OF_PIECE).max(1);
        Self::share_out(budget, workload, (threads, pieces), None)
    }

    /// The same plan, when the faces of all slabs have been counted, with what closing the cells was found to take, if they were closed here: what is not yet given out is shared out anew. Where slabs have no room beside what was kept in
    /// memory, the new plan's quotas for that are none: it must leave memory before slabs are made.
    ///
    /// # Errors
    /// [`Error::Budget`] if a slab is too much, with the least budget that would do.
    pub fn with_surface(&self, workload: &Workload, closing: Option<Closing>) -> Result<MemoryPlan> {
        let Kept { buckets, slices } = Kept { buckets: self.buckets_quota, slices: self.slices_quota() };
        let mut less = vec![Kept { buckets, slices }, Kept { buckets: 0, slices }, Kept { buckets: 0, slices: 0 }];
        less.dedup();
        let share = |kept: Kept| {
            let already = Some((self.keepable, kept));
            Self::share_out(self.budget, workload, (self.threads, self.pieces), already)
        };
        let mut made = share(less[0]);
        for kept in &less[1..] {
            if made.is_ok() {
                break;
            }
            made = share(*kept);
        }
        // Until now, what leaves memory lay in it.
        made.map(|plan| plan.with_passes_before(self, workload, closing))
    }

    /// Bytes that all stores of slices together may take.
    pub(super) fn slices_quota(&self) -> u64 {
        STORES * self.store_quota
    }

    fn share_out(
        budget: u64,
        workload: &Workload,
        (threads, pieces): (usize, usize),
        already: Option<(Keepable, Kept)>,
    ) -> Result<MemoryPlan> {
        let process = process(threads) + workload.transfers();
        let mut left = budget.saturating_sub(process);
        // Kept in memory only what leaves the passes the larger part, and twice the least: a slab may turn out to have more faces than
        // expected, and the budget that is then named must not be eaten up by what it would allow to keep.
        // A finer level may be needed, too, which no least budget has.
        let spare = (2 * (Self::least(workload, threads) - process)).max(deciding_finer(workload) + BESIDE);
        let (keepable, kept) = already.unwrap_or_else(|| {
            let slices = workload.slice_bytes().max(1 << 20) * 3 / 2;
            let buckets = if workload.is_outlasting() { 0 } else { workload.bucket_bytes() };
            let keepable = Keepable { buckets, slices, spare };
            (keepable, keepable.within(left))
        });
        left = left.saturating_sub(kept.buckets + kept.slices);
        let mesh = workload.mesh_bytes();
        let fits = mesh <= left / 3 && mesh + spare <= left && !workload.is_outlasting();
        let mesh_quota = if fits { mesh } else { 0 };
        let working = left - mesh_quota;

        let jobs = |per_job: u64, share: u64, most: usize| ((share / per_job.max(1)) as usize).clamp(1, most);
        let blocks_in_flight = jobs(workload.block_job() + (CHUNK << CHUNK_DOUBLINGS), working / 2, 2 * threads);
        let for_buffers = working.saturating_sub(blocks_in_flight as u64 * workload.block_job());
        // A job that sorts a block holds a chunk, too. Of what is kept in memory, larger chunks would leave more of each bucket's last one empty.
        let doublings = (for_buffers / 16 * 15 / (workload.buckets() + blocks_in_flight as u64) / CHUNK).max(1).ilog2();
        let bucket_buffer = CHUNK << doublings.min(if kept.buckets > 0 { 1 } else { CHUNK_DOUBLINGS });
        let chunks_in_flight = jobs(Self::chunk_job(workload), working, 2 * threads);
        let for_points = (working / 2 / threads as u64).saturating_sub(workload.fitting_raster());
        let mut plan = MemoryPlan {
            budget,
            threads,
            blocks_in_flight,
            chunks_in_flight,
            bucket_buffer,
            buckets_quota: kept.buckets,
            store_quota: kept.slices / STORES,
            mesh_quota,
            points_held: held_in(workload, for_points).clamp(HELD.1, HELD.0) as usize,
            pieces,
            working,
            predicted: 0,
            predicted_disk: 0,
            keepable,
            passes: Passes::default(),
        };
        plan.predicted_disk = plan.disk_of(workload);
        let passes = plan.passes_of(workload)?;
        Ok(plan.with_passes(passes))
    }

    /// Whether the budget is many times what is used.
    pub(crate) fn is_roomy(&self, used: u64) -> bool {
        used < self.budget / ROOMY
    }

    /// Between two phases: has every thread give back what it has freed, unless there is plenty of room, and the next phase had better find it.
    pub fn between_phases(&self, workers: &Workers) {
        if !self.is_roomy(self.predicted) {
            workers.give_back();
        }
    }

    /// Whether there is room to write a mesh of so many vertices and triangles while it is checked: where it lies in memory, or what the check leaves is enough.
    pub(super) fn fills_meanwhile(&self, vertices: u64, triangles: u64) -> bool {
        self.mesh_quota > 0 || self.fills_beside(Need::of(vertices, triangles, self.threads))
    }

    pub(super) fn fills_beside(&self, check: Need) -> bool {
        check.within(self.working).bytes() + FILLING * jobs_of_all(self.threads) <= self.working
    }

    /// Checks that the passes have so many bytes. That `what` needs them may only turn out while cells are closed.
    ///
    /// # Errors
    /// [`Error::Budget`] if they have less, with a budget that would do.
    pub fn require(&self, bytes: u64, what: &'static str) -> Result<()> {
        if bytes <= self.working {
            return Ok(());
        }
        let needed = process(self.threads) + self.passes.transfers + BESIDE + bytes;
        Err(Error::Budget { given: ByteSize(self.budget), needed: ByteSize(needed.next_multiple_of(1 << 20)), what })
    }

    /// The least budget for a workload on `threads` threads, in bytes.
    pub fn least(workload: &Workload, threads: usize) -> u64 {
        let slab = SlabJobs::one(HELD.1).bytes(workload);
        let after = process(threads)
            + workload.transfers()
            + BESIDE
            + slab
                .max(checking(workload, threads).jobs)
                .max(workload.bridging().map_or(0, |_| bridged::Extent::least_memory(threads)))
                .max(workload.simplified().map_or(0, Extent::least_memory))
                .max(workload.levels().map_or(0, |extent| extent.least_memory().max(pyramid::LEAST)));
        after.max(Self::least_before_slabs(workload, threads))
    }

    /// The least budget for the passes before slabs are made.
    pub(crate) fn least_before_slabs(workload: &Workload, threads: usize) -> u64 {
        let chunks = workload.buckets() + 1;
        let bucketing = workload.block_job() + chunks * CHUNK / 15 * 16;
        process(threads)
            + workload.transfers()
            + BESIDE
            + bucketing
                .max(workload.surveying().bytes(1, threads as u64))
                .max(workload.upsampling())
                .max(Self::chunk_job(workload))
                .max(deciding(workload))
                .max(looking(workload, 1))
                .max(measuring(workload))
                .max(reopening(workload))
    }

    /// Bytes of a job over a chunk of slices with the smallest ball, and with columns, if there are any.
    pub(super) fn chunk_job(workload: &Workload) -> u64 {
        job_bytes(1, workload.cells)
            + workload
                .columns
                .map_or(0, |columns| heightfield::bytes(columns.of_slice, columns.bridge, workload.smooth))
    }

    /// Slabs that may be in the making and waiting at a time.
    ///
    /// # Errors
    /// [`Error::Budget`] if one in the making and one at its seam are too much.
    pub fn slab_jobs(&self, workload: &Workload) -> Result<SlabJobs> {
        // As many as there are threads, and finished slabs that wait for their turn; then fewer.
        let beside = [self.threads.div_ceil(2), 0].map(|ahead| (self.threads, ahead));
        let fewer = (1..self.threads).rev().map(|running| (running, 0));
        for (running, ahead) in beside.into_iter().chain(fewer) {
            let jobs = SlabJobs { running, ahead, points_held: 0, pieces: 1, gives_back: running == 1 };
            let room = self.working.saturating_sub(jobs.bytes(workload)) / running as u64;
            // What other stages need more than fitting is room for points, too.
            let fits = |held: &u64| SlabJobs { points_held: *held as usize, ..jobs }.bytes(workload) <= self.working;
            let doubled = std::iter::successors(Some(HELD.1), |held| Some(2 * held));
            let beside = doubled.take_while(|held| *held <= HELD.0 && fits(held)).last().unwrap_or(0);
            let points_held = held_in(workload, room).max(beside).min(self.points_held as u64);
            // Two slabs at a time are worth holding fewer points, but not ever fewer: what is held is searched anew each time.
            let enough = if running > 1 { ENOUGH_HELD } else { HELD.1 };
            if points_held >= enough.min(self.points_held as u64).min(workload.all_held()) {
                let jobs = SlabJobs { points_held: points_held as usize, ..jobs };
                let pieces = if running == self.threads { self.pieces.min(workload.slabs().len()) } else { 1 };
                let several = (2..=pieces).rev().map(|pieces| SlabJobs { pieces, ..jobs });
                let jobs = several.into_iter().find(|jobs| jobs.bytes(workload) <= self.working).unwrap_or(jobs);
                let is_tight = jobs.bytes(workload) > self.working / GIVE_BACK_ABOVE;
                return Ok(SlabJobs { gives_back: jobs.gives_back || is_tight, ..jobs });
            }
        }
        Err(Error::Budget {
            given: ByteSize(self.budget),
            needed: ByteSize(Self::least(workload, self.threads).next_multiple_of(1 << 20)),
            what: "the slab with the most faces",
        })
    }
}

/// The stores of slices that each have as large a share: more exist at a time, but most are smaller.
const STORES: u64 = 3;

/// Bytes of the process with its threads, as budgets are given out: more than most runs have.
fn process(threads: usize) -> u64 {
    HEAP + beside_the_heap(threads)
}

/// Bytes of a budget that are not given out for the heap: what the process, its threads and the allocator have to themselves.
pub fn beside_the_heap(threads: usize) -> u64 {
    PROCESS + THREAD * threads.max(1) as u64
}

/// Jobs at a time of a pass that asks for little memory: one more than threads.
pub(super) fn jobs_of_all(threads: usize) -> u64 {
    threads as u64 + 1
}

/// Blocks of the input that are in flight in the survey, which comes before the plan.
pub(crate) fn survey_jobs(surveying: SurveyWorkload, budget: u64, threads: usize) -> usize {
    surveying.blocks_in(budget.saturating_sub(process(threads)), threads.max(1) as u64) as usize
}

/// Bytes of the one job at least that measures how noisy points are.
pub(super) fn measuring(workload: &Workload) -> u64 {
    let measured = matches!(workload.fit, Fit::Auto | Fit::AutoPoints) || workload.columns.is_none();
    if measured { thickness::bytes(workload.cells) } else { 0 }
}

/// Bytes of a job that opens again what the closing filled; a surface that is not closed has none.
pub(super) fn reopening(workload: &Workload) -> u64 {
    if workload.columns.is_some() {
        return 0;
    }
    let slices = u64::from(workload.partition().slices);
    reopen::bytes_to_expect(workload.faces_of_widest() / slices + 1, workload.cells)
}

/// Bytes that are handed from pass to pass meanwhile.
pub(super) fn reopening_records(workload: &Workload) -> u64 {
    if workload.columns.is_some() { 0 } else { reopen::records_to_expect(workload.faces().min(workload.points)) }
}

/// Bytes of the level that inside and outside are told apart on, and of the first look at a finer one; a surface that is not closed needs none.
pub(super) fn deciding(workload: &Workload) -> u64 {
    if workload.columns.is_some() {
        return 0;
    }
    let factor = sign::least_factor(workload.cells, sign::LONGEST);
    let finest = workload.cells.map(|cells| cells.div_ceil(factor));
    let outliers = sign::outliers::bytes(finest, workload.points);
    sign::bytes(workload.cells_of_level()).max(outliers).max(workload.field_found())
}

/// Bytes of a finer level, if the cells turn out to need one; a surface that is not closed needs none.
fn deciding_finer(workload: &Workload) -> u64 {
    if workload.columns.is_some() { 0 } else { level::bytes_of_finer(workload.cells) }
}

/// Bytes of looking along lines of sight with so many blocks of points in flight, if there are any.
pub(super) fn looking(workload: &Workload, blocks: u64) -> u64 {
    if workload.is_sighted() { sign::sights_bytes(workload.cells) + blocks * workload.block_job() } else { 0 }
}

/// What the check takes.
pub(super) fn checking(workload: &Workload, threads: usize) -> Need {
    Need::of(workload.vertices(), workload.triangles(), threads)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::grid::partition::slab_count;
    use crate::points::Precision;

    fn load(points: u64, s: u32) -> Workload {
        Workload::in_cells(points, Precision::Single, [s; 3], 1)
    }

    #[test]
    fn the_least_budget_is_accepted_and_one_byte_less_is_refused_with_it() {
        for (points, s) in [(1, 1), (36_000, 132), (100_000_000, 1856), (1_000_000_000, 4000)] {
            let workload = load(points, s);
            for threads in [1, 2, 64] {
                MemoryPlan::for_budget(MemoryPlan::least(&workload, threads), &workload, threads).unwrap();
            }
            let least = MemoryPlan::least(&workload, 2);
            let Err(Error::Budget { needed, .. }) = MemoryPlan::for_budget(least - 1, &workload, 2) else {
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
    fn faces_that_are_known_sharpen_the_plan() {
        let workload = load(20_000_000, 1085);
        let slabs = slab_count(1, 1085);
        let with = |faces: u64| workload.with_faces(vec![faces; slabs as usize], false);
        let plan = MemoryPlan::for_budget(400 << 20, &with(300_000), 2).unwrap();
        let sharper = plan.with_surface(&with(250_000), None).unwrap();
        assert!(sharper.predicted < plan.predicted && sharper.predicted_disk < plan.predicted_disk);
        assert_eq!((sharper.bucket_buffer, sharper.buckets_quota), (plan.bucket_buffer, plan.buckets_quota));
        let Err(Error::Budget { needed, .. }) = plan.with_surface(&with(3_000_000), None) else {
            panic!("a slab of three million faces was accepted")
        };
        let roomier = MemoryPlan::for_budget(needed.0, &with(300_000), 2).unwrap();
        roomier.with_surface(&with(3_000_000), None).expect("the figure that was named does");
    }

    proptest! {
        #[test]
        fn the_figure_of_a_late_refusal_does(
            points in 1u64..1 << 30,
            s in 8u32..2000,
            (expected, counted) in (1u64..1 << 20, 1u64..1 << 23),
            factor in 1.0..4.0,
            threads in 1usize..9,
        ) {
            let with = |faces: u64| load(points, s).with_faces(vec![faces; slab_count(1, s) as usize], false);
            let least = MemoryPlan::least(&with(expected), threads);
            let given = MemoryPlan::for_budget((least as f64 * factor) as u64, &with(expected), threads).unwrap();
            if let Err(Error::Budget { needed, .. }) = given.with_surface(&with(counted), None) {
                let roomier = MemoryPlan::for_budget(needed.0, &with(expected), threads).unwrap();
                prop_assert!(roomier.with_surface(&with(counted), None).is_ok(), "{}", needed);
            }
        }
    }

    #[test]
    fn what_was_kept_leaves_memory_where_slabs_have_no_room_beside_it() {
        let with = |faces: u64| load(4_000_000, 100).with_faces(vec![faces; slab_count(1, 100) as usize], false);
        let (expected, counted) = (with(10_000), with(700_000));
        let least = MemoryPlan::least(&counted, 2);
        let given = MemoryPlan::for_budget(least, &expected, 2).unwrap();
        assert!(given.buckets_quota > 0 && given.store_quota > 0);
        let slabs = given.with_surface(&counted, None).expect("the least does, whatever was expected");
        assert_eq!(slabs.buckets_quota, 0);
        // The points lay in memory until then, and do not any more.
        assert!(slabs.predicted >= given.buckets_quota && slabs.predicted <= least);
        assert!(slabs.predicted_disk >= counted.bucket_bytes());
        let roomy = MemoryPlan::for_budget(8 << 30, &expected, 2).unwrap().with_surface(&counted, None).unwrap();
        assert!(roomy.buckets_quota > 0);
    }

    #[test]
    fn slabs_are_made_side_by_side_while_there_is_room() {
        // More than telling inside and outside apart takes.
        let workload = load(200_000_000, 1085).with_faces(vec![800_000; slab_count(1, 1085) as usize], false);
        let jobs = |budget: u64| MemoryPlan::for_budget(budget, &workload, 2).unwrap().slab_jobs(&workload).unwrap();
        let (least, large) = (jobs(MemoryPlan::least(&workload, 2)), jobs(4 << 30));
        assert_eq!((least.running, least.in_flight()), (1, 1));
        assert_eq!((large.running, large.in_flight()), (2, 3));
        assert!(least.points_held < large.points_held);
        assert_eq!(large.points_held as u64, workload.all_held());
    }

    #[test]
    fn pieces_are_for_many_threads_and_room() {
        let workload = load(200_000_000, 1600).with_faces(vec![800_000; slab_count(1, 1600) as usize], false);
        let jobs = |budget: u64, threads: usize| {
            MemoryPlan::for_budget(budget, &workload, threads).unwrap().slab_jobs(&workload).unwrap()
        };
        for threads in [1, 2, 4] {
            assert_eq!(jobs(64 << 30, threads).pieces, 1);
        }
        // 80 slabs are enough for three pieces.
        assert_eq!([8, 16, 64].map(|threads| jobs(64 << 30, threads).pieces), [2, 3, 3]);
        assert_eq!(jobs(MemoryPlan::least(&workload, 64), 64).pieces, 1);
        let (mut pieces, mut before) = (0, jobs(1 << 30, 64));
        for budget in 2..64u64 {
            let now = jobs(budget << 30, 64);
            assert!(now.pieces >= before.pieces);
            pieces += usize::from(now.pieces > before.pieces);
            before = now;
        }
        assert!(pieces > 1, "as many as fit");
    }

    #[test]
    fn more_memory_never_means_smaller_shares() {
        let workload = load(20_000_000, 1085);
        let small = MemoryPlan::for_budget(128 << 20, &workload, 2).unwrap();
        let large = MemoryPlan::for_budget(8 << 30, &workload, 2).unwrap();
        assert_eq!(small.buckets_quota, 0, "240 MB of points do not fit into 128 MiB");
        assert!(large.buckets_quota >= workload.bucket_bytes());
        assert!(large.points_held >= small.points_held);
    }
}
