//! Means: each occupied cell stands for its points by their mean and their number.
//!
//! Within a cell sums are of integers, so the order in which points arrive cannot show. Slices of means are read upwards, a bucket of points at a time.

use crate::error::Result;
use crate::grid::occupancy::Sampled;
use crate::grid::partition::BUCKET_SLICES;
use crate::grid::rank_bitmap::RankBitmap;
use crate::grid::slice::Runs;
use crate::points::Coordinate;
use crate::solid::Solid;
use crate::surface::outward::Outward;

/// In-cell offsets are summed as integers, in this part of a cell.
pub(super) const QUANTA: f64 = (1 << 20) as f64;

/// An occupied cell as it is looked at from vertices. Its slice and row are known where it is looked at. Slices of these are the most that fitting holds, so
/// it is kept small.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mean {
    /// The cell along x.
    pub x: i32,
    /// The points' mean in the cell, in [`QUANTA`].
    pub within: [i32; 3],
    /// Their number.
    pub points: i32,
    /// Outward from the cell; zero if nobody asked for it.
    pub outward: [f32; 3],
}

impl Mean {
    /// Where it lies, in cells, if its cell is in slice `y` and row `z`.
    #[inline]
    pub fn place(&self, y: f64, z: f64) -> [f64; 3] {
        let within = |a: usize| f64::from(self.within[a]) / QUANTA;
        [f64::from(self.x) + within(0), y + within(1), z + within(2)]
    }
}

/// A cell's points as they are summed: offsets from the cell in [`QUANTA`], and their number. 2⁴³ points would overflow them.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    offsets: [u64; 3],
    points: u64,
}

/// The means of one slice.
#[derive(Debug)]
pub(super) struct SliceMeans {
    /// Its occupied cells.
    pub cells: RankBitmap,
    /// The mean of each.
    pub means: Vec<Mean>,
}

impl SliceMeans {
    /// A slice without means.
    pub fn new(width: u32, rows: u32) -> SliceMeans {
        SliceMeans { cells: RankBitmap::new(width, rows), means: Vec::new() }
    }

    /// Forgets its means.
    pub fn clear(&mut self) {
        self.cells.clear();
        self.means.clear();
    }
}

/// Bytes of the means of the `slices` slices that have the most, on a grid of so many cells along x and so many rows, with so many occupied cells `in_slice`; and of the sums of a bucket.
pub(super) fn bytes(in_slice: &[u32], slices: usize, [width, rows]: [u32; 2]) -> u64 {
    let most = |slices: usize, each: usize| {
        let in_slices = in_slice.windows(slices.min(in_slice.len()));
        let occupied = in_slices.map(|some| some.iter().map(|n| u64::from(*n)).sum::<u64>()).max().unwrap_or(0);
        occupied * each as u64 + RankBitmap::bytes(slices as u64, occupied, width, rows)
    };
    // A slice's vector that must grow is there twice.
    let growing = u64::from(in_slice.iter().copied().max().unwrap_or(0)) * size_of::<Mean>() as u64;
    most(slices, size_of::<Mean>()) + most(BUCKET_SLICES as usize, size_of::<Sum>()) + growing
}

/// Reads slices of means, in order, from buckets.
pub(super) struct MeansReader<'a, T> {
    sampled: &'a Sampled<'a, T>,
    outward: Option<Outward<'a>>,
    /// The bucket at hand.
    bucket: Option<u32>,
    /// Its slices' cells and sums.
    sums: Vec<(RankBitmap, Vec<Sum>)>,
    runs: Runs,
}

impl<'a, T: Coordinate> MeansReader<'a, T> {
    /// Reads the means of `sampled`; with outward directions, if there is a solid to take them from.
    pub fn new(sampled: &'a Sampled<'a, T>, solid: Option<&'a Solid>) -> MeansReader<'a, T> {
        let outward = solid.map(Outward::of_cells);
        MeansReader { sampled, outward, bucket: None, sums: Vec::new(), runs: Runs::default() }
    }

    /// Reads slice `y`, which must not lie below the one before. Slices beyond the grid are empty.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn read(&mut self, y: i64, slice: &mut SliceMeans) -> Result<()> {
        let slices = self.sampled.grid.cells()[1];
        match u32::try_from(y).ok().filter(|y| *y < slices) {
            Some(y) => self.read_slice(y, slice),
            None => {
                slice.clear();
                Ok(())
            }
        }
    }

    fn read_slice(&mut self, y: u32, slice: &mut SliceMeans) -> Result<()> {
        let bucket = y / BUCKET_SLICES;
        if self.bucket != Some(bucket) {
            self.sum(bucket)?;
            self.bucket = Some(bucket);
        }
        let (cells, sums) = &mut self.sums[(y % BUCKET_SLICES) as usize];
        std::mem::swap(&mut slice.cells, cells);
        self.sampled.occupied.read(y, &mut self.runs)?;
        let runs = &self.runs;
        let places = (0..runs.row_count())
            .flat_map(|z| runs.row(z).iter().flat_map(move |run| (run.start..run.end).map(move |x| (x, z))));
        if let Some(outward) = &mut self.outward {
            outward.slide_to(i64::from(y))?;
        }
        let outward = &self.outward;
        refill_exactly(&mut slice.means, sums.len());
        slice.means.extend(places.zip(sums).map(|((x, z), sum)| Mean {
            x: x as i32,
            within: sum.offsets.map(|offset| (offset / sum.points) as i32),
            points: i32::try_from(sum.points).unwrap_or(i32::MAX),
            outward: outward.as_ref().map_or([0.0; 3], |outward| outward.at(x, i64::from(y), z).map(|c| c as f32)),
        }));
        Ok(())
    }

    /// Sums the points of a bucket by cell.
    fn sum(&mut self, bucket: u32) -> Result<()> {
        let Sampled { buckets, occupied, grid, .. } = self.sampled;
        let [width, slices, rows] = grid.cells();
        let first = bucket * BUCKET_SLICES;
        self.sums.resize_with(BUCKET_SLICES as usize, || (RankBitmap::new(width, rows), Vec::new()));
        for (y, (cells, sums)) in (first..slices).zip(&mut self.sums) {
            occupied.read(y, &mut self.runs)?;
            let count = cells.replace(&self.runs) as usize;
            refill_exactly(sums, count);
            sums.resize(count, Sum::default());
        }
        let sums = &mut self.sums;
        buckets.read(bucket as usize, |points| {
            for point in points {
                let ([x, y, z], within) = grid.place_of(point.map(Into::into));
                let (cells, sums) = &mut sums[(y - first) as usize];
                if let Some(number) = cells.at(x, z) {
                    let sum = &mut sums[number];
                    sum.points += 1;
                    for (offsets, within) in sum.offsets.iter_mut().zip(within) {
                        *offsets += (within * QUANTA) as u64;
                    }
                }
            }
            Ok(())
        })
    }
}

/// Empties a vector and gives it room for `count` elements, not more.
fn refill_exactly<T>(some: &mut Vec<T>, count: usize) {
    some.clear();
    some.reserve_exact(count);
}
