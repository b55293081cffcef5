//! The points round a slab's vertices, sorted by cell, a bucket at a time.
//!
//! ```text
//!   bucket's points, in no order --> number of each one's cell --count, add up, move--> points, slice by slice, in each
//!   occupied cells of its slices --> row by row, by x: 0 1 2 ...                        row by row, in each by x
//!
//!   window:  [bucket 4] [bucket 5] [bucket 6]      as many as the slices round one plane can lie in
//! ```
//!
//! What is occupied is known from the raster, so a stretch of a row's cells is one stretch of points, found by counting bits.

use std::ops::Range;

use crate::error::Result;
use crate::grid::occupancy::Sampled;
use crate::grid::partition::{BUCKET_SLICES, buckets_of, buckets_round};
use crate::grid::rank_bitmap::RankBitmap;
use crate::grid::slice::Runs;
use crate::grid::window::Window;
use crate::points::Coordinate;
use crate::resources::workers::refill;
use crate::surface::contract::NONE;

/// A window of buckets that moves up with the plane at hand.
pub struct Index<'a, T> {
    sampled: &'a Sampled<'a, T>,
    /// The slices whose points are looked for.
    slices: Range<u32>,
    halo: u32,
    window: Window<BucketIndex<T>>,
    sorting: Sorting<T>,
    /// Which of each bucket's points are held, by their order in it.
    share: Range<u64>,
    /// Points of all buckets so far: their numbers go on from there.
    numbered: u32,
}

/// What one bucket at a time is sorted with.
#[derive(Debug)]
struct Sorting<T> {
    points: Vec<[T; 3]>,
    /// The number of each point's cell, or [`NONE`].
    cells: Vec<u32>,
    runs: Runs,
}

/// The points of a bucket, sorted by cell.
struct BucketIndex<T> {
    slices: Vec<SliceCells>,
    /// The number of points before each occupied cell; then the number of all.
    first: Vec<u32>,
    points: Vec<[T; 3]>,
    /// The number of the first point.
    base: u32,
}

/// The occupied cells of a slice.
struct SliceCells {
    ranked: RankBitmap,
    /// Cells of the bucket's slices below.
    before: u32,
    /// Its own; the others hold nothing if there are none.
    count: u32,
}

/// The points of one slice.
pub struct SlicePoints<'a, T> {
    bucket: &'a BucketIndex<T>,
    slice: &'a SliceCells,
}

/// How often a bucket's points near a slab are taken, `share` at a time, until all were.
pub fn shares<T: Coordinate>(sampled: &Sampled<'_, T>, slices: Range<u32>, share: u64) -> u64 {
    let points = buckets_of(slices).map(|bucket| sampled.buckets.read_count(bucket as usize));
    points.max().unwrap_or(0).div_ceil(share)
}

impl<'a, T: Coordinate> Index<'a, T> {
    /// An index of nothing yet, for the points in `slices`, as far as `halo` slices either side of a plane.
    pub fn new(sampled: &'a Sampled<'a, T>, slices: Range<u32>, halo: u32) -> Index<'a, T> {
        let [width, _, rows] = sampled.grid.cells();
        let slice = || SliceCells { ranked: RankBitmap::new(width, rows), before: 0, count: 0 };
        let bucket = || BucketIndex {
            slices: std::iter::repeat_with(slice).take(BUCKET_SLICES as usize).collect(),
            first: vec![0],
            points: Vec::new(),
            base: 0,
        };
        let window = Window::new(buckets_round(halo) as usize, bucket);
        Index { sampled, slices, halo, window, sorting: Sorting::default(), share: 0..0, numbered: 0 }
    }

    /// Starts again below the first slice, with other points of each bucket: those `share` by their order in it.
    pub fn begin(&mut self, share: Range<u64>) {
        self.share = share;
        self.window.restart();
    }

    /// Moves up to a plane.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn slide_to(&mut self, plane: u32) -> Result<()> {
        let Index { sampled, slices, halo, window, sorting, share, numbered } = self;
        let lowest = i64::from(plane) - i64::from(*halo);
        window.slide_to(lowest.div_euclid(i64::from(BUCKET_SLICES)), |bucket, index| {
            // Below zero and beyond the last there are none.
            let near = u32::try_from(bucket).ok().filter(|bucket| buckets_of(slices.clone()).contains(bucket));
            index.base = *numbered;
            match near {
                Some(bucket) => index.fill(bucket, slices.clone(), share.clone(), sampled, sorting)?,
                None => index.clear(),
            }
            *numbered += index.points.len() as u32;
            Ok(())
        })
    }

    /// The points of slice `y`, which is near the plane that the index was moved to.
    #[inline]
    pub fn slice(&self, y: i64) -> SlicePoints<'_, T> {
        let slices = i64::from(BUCKET_SLICES);
        let bucket = self.window.get(y.div_euclid(slices));
        SlicePoints { bucket, slice: &bucket.slices[y.rem_euclid(slices) as usize] }
    }
}

impl<T> Default for Sorting<T> {
    fn default() -> Self {
        Sorting { points: Vec::new(), cells: Vec::new(), runs: Runs::default() }
    }
}

impl<T: Coordinate> BucketIndex<T> {
    fn clear(&mut self) {
        self.slices.iter_mut().for_each(|slice| slice.count = 0);
        self.points.clear();
    }

    /// Takes a share of the points of bucket `number`, as far as they lie in `near` and count.
    fn fill(
        &mut self,
        number: u32,
        near: Range<u32>,
        share: Range<u64>,
        sampled: &Sampled<'_, T>,
        sorting: &mut Sorting<T>,
    ) -> Result<()> {
        let Sorting { points, cells, runs } = sorting;
        let lowest = number * BUCKET_SLICES;
        let mut before = 0;
        for (slice, y) in self.slices.iter_mut().zip(lowest..) {
            slice.before = before;
            slice.count = 0;
            if near.contains(&y) {
                sampled.occupied.read(y, runs)?;
                slice.count = slice.ranked.replace(runs);
                before += slice.count;
            }
        }
        let BucketIndex { slices, first, points: sorted, .. } = self;
        // How many points each cell has, two places late: added up, one place late, that is where they go.
        refill(first, before as usize + 2, 0);
        let expected = share.end.min(sampled.buckets.points_in(number as usize)).saturating_sub(share.start);
        points.clear();
        points.reserve_exact(expected as usize);
        cells.clear();
        cells.reserve_exact(expected as usize);
        sampled.buckets.read_share(number as usize, share, |some| {
            sampled.grid.cells_of(some, |[x, y, z]| {
                let slice = &slices[(y - lowest) as usize];
                let in_slice = if slice.count > 0 { slice.ranked.at(x, z) } else { None };
                let cell = in_slice.map_or(NONE, |cell| slice.before + cell as u32);
                if cell != NONE {
                    first[cell as usize + 2] += 1;
                }
                cells.push(cell);
            });
            points.extend_from_slice(some);
            Ok(())
        })?;
        let mut counted = 0;
        for first in first.iter_mut() {
            counted += *first;
            *first = counted;
        }
        // What was there is overwritten.
        sorted.reserve_exact((counted as usize).saturating_sub(sorted.len()));
        sorted.resize(counted as usize, [T::zeroed(); 3]);
        for (point, cell) in points.iter().zip(&*cells).filter(|(_, cell)| **cell != NONE) {
            // Moves on to where the next cell's go, and so comes to its place.
            let at = &mut first[*cell as usize + 1];
            sorted[*at as usize] = *point;
            *at += 1;
        }
        Ok(())
    }
}

impl<T> Clone for SlicePoints<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for SlicePoints<'_, T> {}

impl<'a, T> SlicePoints<'a, T> {
    /// Whether the slice holds none.
    #[inline]
    pub fn is_empty(self) -> bool {
        self.slice.count == 0
    }

    /// The points in cells `x` of row `z`, both of which may reach outside the slice, and the number of the first.
    #[inline]
    pub fn in_cells(self, z: i64, x: Range<i64>) -> (u32, &'a [[T; 3]]) {
        let cells = self.slice.ranked.cells(z, x);
        let first = &self.bucket.first[self.slice.before as usize..];
        let range = first[cells.start]..first[cells.end];
        (self.bucket.base + range.start, &self.bucket.points[range.start as usize..range.end as usize])
    }
}
