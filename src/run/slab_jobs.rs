//! Slabs in the making: how many there are at a time, in how many pieces, and the bytes that they take.

use std::ops::Range;
use std::sync::Arc;

use crate::grid::partition::{buckets_round, halo};
use crate::resources::memory::{SlabJobs, THREAD, Tally};
use crate::run::workload::{PointWorkload, Workload};
use crate::stitch::size::{Size, Told};

/// The most points that a slab's fitting holds at once, and the fewest.
pub(super) const HELD: (u64, u64) = (4 << 20, 16 << 10);

/// What a slab in the making has given back, and the allocator not yet: for each face, and the most. It waits some milliseconds, so that two slabs seldom have
/// given back at the same time; slabs for which memory is short ask it not to wait (`stitch/make.rs`).
const GIVEN_BACK: (u64, u64) = (140, 15 << 20);

/// The share of it that the allocator loses between blocks of many sizes, as slab after slab is made: where there is one at a time, and where there are several.
const LOST: (u64, u64) = (14, 32);

/// Vertices and triangles on their way from a slab to the mesh, and what the mesh's stores hold of them.
pub(super) const STITCHING: u64 = 5 << 19;

/// Bytes of the points that are held at once when a slab is fitted with `held` of them: those round a plane, sorted, with as many cells at most; and a bucket's share
/// of them while it is sorted.
fn held_bytes(workload: &Workload, held: u64) -> u64 {
    let PointWorkload { bucket, window } = workload.points_near();
    let share = held / u64::from(buckets_round(halo(workload.smooth)));
    (window.min(held) + bucket.min(share)) * sorted_bytes(workload)
}

/// Bytes of a point among others that are sorted, with the number of its cell or of those before it.
fn sorted_bytes(workload: &Workload) -> u64 {
    workload.coordinates() + 4
}

/// The most points that can be held at once in `room` bytes: all of them, or some.
pub(super) fn held_in(workload: &Workload, room: u64) -> u64 {
    let whole = workload.all_held();
    if held_bytes(workload, whole) <= room {
        return whole;
    }
    let buckets = u64::from(buckets_round(halo(workload.smooth)));
    room / sorted_bytes(workload) * buckets / (buckets + 1)
}

impl SlabJobs {
    /// One slab at a time.
    pub(super) fn one(points_held: u64) -> SlabJobs {
        SlabJobs { running: 1, ahead: 0, points_held: points_held as usize, pieces: 1, gives_back: true }
    }

    /// What slabs of a workload are made with, to tell `tally` what their stages take.
    pub(super) fn told(&self, workload: &Workload, tally: &Arc<Tally>) -> Told {
        Told {
            tally: Arc::clone(tally),
            of: workload.made(),
            sizes: workload.slabs().to_vec(),
            points: workload.fitting_raster() + held_bytes(workload, self.points_held as u64),
            means: workload.means(),
        }
    }

    /// The most bytes of all slabs of a workload at a time, with the points round a plane, as far as they are held at once.
    pub(super) fn bytes(&self, workload: &Workload) -> u64 {
        self.bytes_beside(workload, 0)
    }

    /// The same with a mesh of so many bytes that grows meanwhile: while a slab is made, it has what came of those before.
    pub(super) fn bytes_beside(&self, workload: &Workload, mesh_in_memory: u64) -> u64 {
        let (of, means) = (workload.made(), workload.means());
        let points = workload.fitting_raster() + held_bytes(workload, self.points_held as u64);
        let size = |slab: &Size| {
            let mesh = slab.bytes(&of);
            (mesh, slab.bytes_making(&of, points, means) - mesh)
        };
        let slabs = workload.slabs();
        let in_flight = self.in_flight().min(slabs.len());
        // For hundreds of threads, as if the widest slabs were side by side.
        let widest = (slabs.len() * in_flight > MOST_LOOKED_AT).then(|| {
            let widest = slabs.iter().max_by_key(|slab| slab.faces).copied().unwrap_or_default();
            vec![widest; in_flight + 2]
        });
        let slabs = widest.as_deref().unwrap_or(slabs);
        let sizes: Vec<(u64, u64)> = slabs.iter().map(size).collect();
        let mesh = |number: usize| sizes.get(number).map_or(0, |(mesh, _)| *mesh);
        let seams = slabs.windows(2).map(|pair| pair[0].bytes_at_seam(pair[1], of.trimmed));
        let seams: Vec<u64> = seams.collect();
        let given_back = |slabs: &[Size]| {
            let widest = slabs.iter().map(|slab| slab.faces).max().unwrap_or(0);
            if self.running > 1 { (widest * GIVEN_BACK.0).min(GIVEN_BACK.1) } else { 0 }
        };
        if self.pieces > 1 {
            let bytes = self.bytes_of_pieces(workload, &sizes, &seams) + given_back(slabs);
            return bytes + bytes / LOST.1 + mesh_in_memory;
        }
        // Of slabs side by side, those that take the most are in the making.
        let mut making = Vec::new();
        let mut beside = |numbers: Range<usize>| {
            let some = &sizes[numbers.start.min(sizes.len())..numbers.end.min(sizes.len())];
            making.clear();
            making.extend(some.iter().map(|(_, making)| *making));
            making.sort_unstable_by(|a, b| b.cmp(a));
            let meshes: u64 = some.iter().map(|(mesh, _)| *mesh).sum();
            meshes + making.iter().take(self.running).sum::<u64>()
        };
        let all = slabs.iter().map(|slab| slab.faces).sum::<u64>().max(1);
        let is_stand_in = slabs.len() < workload.slabs().len();
        let (mut most, mut stitched) = (0, if is_stand_in { all } else { 0 });
        for (first, slab) in slabs.iter().enumerate() {
            let grown = (u128::from(mesh_in_memory) * u128::from(stitched.min(all)) / u128::from(all)) as u64;
            stitched += slab.faces;
            // The slab before waits for its seam with this one: while this one is made, and while the calling thread is at that seam.
            let before = if first > 0 { mesh(first - 1) } else { 0 };
            let idle = before + beside(first..first + in_flight);
            let at_seam = first.checked_sub(1).map_or(0, |lower| seams[lower]);
            let busy = before + mesh(first) + at_seam + beside(first + 1..first + in_flight);
            most = most.max(grown + idle.max(busy));
        }
        let bytes = most + given_back(slabs);
        bytes + bytes / if self.running > 1 { LOST.1 } else { LOST.0 } + STITCHING
    }

    /// The same but for what was given back, where several pieces are stitched side by side, of slabs of such sizes (of the mesh, and of its making beside that) and such bytes at their seams.
    fn bytes_of_pieces(&self, workload: &Workload, sizes: &[(u64, u64)], seams: &[u64]) -> u64 {
        let mesh = |number: usize| sizes.get(number).map_or(0, |(mesh, _)| *mesh);
        let meshes = |numbers: Range<usize>| numbers.map(mesh).sum::<u64>();
        let ranges = self.ranges(workload);
        // Where slabs stand for the widest, any of them may be any.
        let stand_in = sizes.len() < workload.slabs().len();
        let of_piece = |range: &Range<u32>| {
            let start = if stand_in { 0 } else { (range.start as usize).saturating_sub(1) };
            // It may go on past its end.
            let at = (start..sizes.len()).map(|first| {
                let before = if first > start { mesh(first - 1) } else { 0 };
                let at_seam = if first > start { seams[first - 1] } else { 0 };
                before + at_seam + meshes(first..first + self.in_flight())
            });
            at.max().unwrap_or(0)
        };
        let copies = |range: &Range<u32>| {
            let boundary = if stand_in { 1 } else { range.start as usize };
            meshes(boundary - 1..boundary + 1)
        };
        let mut making: Vec<u64> = sizes.iter().map(|(_, making)| *making).collect();
        making.sort_unstable_by(|a, b| b.cmp(a));
        let making = match stand_in {
            true => making.first().map_or(0, |making| making * self.running as u64),
            false => making.iter().take(self.running).sum(),
        };
        let pieces = ranges.len() as u64;
        let stitching = pieces * STITCHING + (pieces - 1) * THREAD;
        ranges.iter().map(of_piece).sum::<u64>() + ranges[1..].iter().map(copies).sum::<u64>() + making + stitching
    }

    /// The slabs of each piece: about as many faces in each.
    pub(crate) fn ranges(&self, workload: &Workload) -> Vec<Range<u32>> {
        let slabs = workload.slabs();
        let count = slabs.len() as u32;
        let pieces = (self.pieces.max(1) as u32).min(count.max(1));
        let all: u64 = slabs.iter().map(|slab| slab.faces + 1).sum();
        let (mut ranges, mut start, mut sum) = (Vec::new(), 0, 0);
        for (number, slab) in (0..count).zip(slabs) {
            sum += slab.faces + 1;
            let (made, after) = (ranges.len() as u32, number + 1);
            let left = pieces - made - 1;
            let is_share = u128::from(sum) * u128::from(pieces) >= u128::from(all) * u128::from(made + 1);
            // Each of those to come has a slab.
            if left > 0 && (is_share || count - after == left) {
                ranges.push(start..after);
                start = after;
            }
        }
        ranges.push(start..count);
        ranges
    }
}

/// Slabs times slabs in flight, beyond which not every slab is looked at with those beside it.
const MOST_LOOKED_AT: usize = 1 << 18;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::points::Precision;

    proptest! {
        #[test]
        fn pieces_are_all_slabs_in_order(faces in prop::collection::vec(0u64..1 << 20, 1..60), pieces in 1usize..70) {
            let slices = faces.len() as u32 * 20;
            let workload = Workload::in_cells(1_000_000, Precision::Single, [slices; 3], 1).with_faces(faces.clone(), false);
            let ranges = SlabJobs { pieces, ..SlabJobs::one(1) }.ranges(&workload);
            prop_assert_eq!(ranges.len(), pieces.min(faces.len()));
            prop_assert!(ranges.iter().all(|range| !range.is_empty()));
            prop_assert!(ranges.iter().cloned().flatten().eq(0..faces.len() as u32));
            let of = |range: &Range<u32>| range.clone().map(|k| faces[k as usize] + 1).sum::<u64>();
            let (all, widest) = (of(&(0..faces.len() as u32)), faces.iter().max().unwrap() + 1);
            let share = all / ranges.len() as u64 + 1;
            // What is left over is a slab at each end, but where the last pieces are given a slab each.
            prop_assert!(ranges[0].len() == 1 || of(&ranges[0]) <= share + widest);
        }
    }
}
