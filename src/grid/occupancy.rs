//! Raster: the cells that hold points, slice by slice.
//!
//! A cell with fewer than the least number of points is not occupied, and its points do not count any more: nothing is fitted to them.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::grid::bucket::Buckets;
use crate::grid::context::{Context, chunks};
use crate::grid::partition::BUCKET_SLICES;
use crate::grid::rank_bitmap::RankBitmap;
use crate::grid::slice::{Bits, Runs, SliceStore, Slices, set_range};
use crate::grid::{Cell, Grid};
use crate::points::Coordinate;
use crate::storage::work::sections::{SectionReader, SectionWriter};

/// The occupied cells of a cloud at one resolution.
#[derive(Debug)]
pub struct Occupancy {
    /// Cells along x, slices, rows.
    pub cells: Cell,
    /// The slices.
    pub store: SliceStore,
    /// Number of occupied cells.
    pub occupied: u64,
    /// The number of occupied cells of each slice.
    pub in_slice: Vec<u32>,
    /// Cells with points, but fewer than the least number.
    pub sparse: u64,
}

/// Slices of occupied cells on their way to an [`Occupancy`].
#[derive(Debug, Default)]
pub struct Raster {
    slices: Slices,
    in_slice: Vec<u32>,
    sparse: u64,
}

/// What is kept of saved cells beside their slices.
#[derive(Debug, Serialize, Deserialize)]
pub struct SavedOccupancy {
    cells: Cell,
    occupied: u64,
    sparse: u64,
}

impl Raster {
    /// Adds a slice.
    pub fn push(&mut self, slice: &Bits) {
        self.in_slice.push(slice.cell_count() as u32);
        self.slices.push(slice);
    }

    /// Adds a slice of runs.
    pub fn push_runs(&mut self, slice: &Runs) {
        self.in_slice.push(slice.cell_count() as u32);
        self.slices.push_runs(slice);
    }
}

impl Occupancy {
    /// Saves the cells.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(&self, out: &mut SectionWriter<'_>) -> Result<SavedOccupancy> {
        self.store.save(out)?;
        out.values(&self.in_slice)?;
        Ok(SavedOccupancy { cells: self.cells, occupied: self.occupied, sparse: self.sparse })
    }

    /// Reads what [`Occupancy::save`] saved.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`], [`crate::Error::Io`].
    pub fn load(saved: &SavedOccupancy, sections: &mut SectionReader<'_>, context: &Context) -> Result<Occupancy> {
        let store = SliceStore::load(sections, &context.workspace, context.memory.store_quota)?;
        let &SavedOccupancy { cells, occupied, sparse } = saved;
        Ok(Occupancy { cells, store, occupied, in_slice: sections.values()?, sparse })
    }

    /// No slices yet.
    pub fn new(cells: Cell, context: &Context) -> Occupancy {
        let store = SliceStore::new(&context.workspace, context.memory.store_quota);
        Occupancy { cells, store, occupied: 0, in_slice: Vec::with_capacity(cells[1] as usize), sparse: 0 }
    }

    /// Appends the next slices.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn append(&mut self, slices: &Raster) -> Result<()> {
        self.occupied += slices.in_slice.iter().map(|cells| u64::from(*cells)).sum::<u64>();
        self.in_slice.extend(&slices.in_slice);
        self.sparse += slices.sparse;
        self.store.extend(&slices.slices)
    }

    /// Rasters all buckets: cells of at least `least` points are occupied. `progress` is told the points of each bucket. Memory:
    /// [`BUCKET_SLICES`] slices of bits and a chunk of a bucket for each job in flight; if `least` is more than one, which takes a second look at the points, a
    /// number for each of the slices' cells as well.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn of_buckets<T: Coordinate>(
        buckets: &Buckets<T>,
        grid: &Grid,
        least: u32,
        context: &Context,
        mut progress: impl FnMut(u64),
    ) -> Result<Occupancy> {
        let cells = grid.cells();
        let [width, slices, rows] = cells;
        let mut out = Occupancy::new(cells, context);
        let mut jobs = 0..buckets.count();
        let mut done = 0..buckets.count();
        context.workers.in_order(
            context.memory.chunks_in_flight,
            || Ok(jobs.next()),
            |bucket| {
                let first = bucket as u32 * BUCKET_SLICES;
                let mut bits = vec![Bits::new(width, rows); (slices - first).min(BUCKET_SLICES) as usize];
                buckets.read(bucket, |points| {
                    grid.cells_of(points, |[x, y, z]| bits[(y - first) as usize].set(x, z));
                    Ok(())
                })?;
                let mut out = Raster::default();
                if least > 1 {
                    let slices: Vec<Runs> = bits.iter().map(Runs::from_bits).collect();
                    let (slices, sparse) = well_filled(slices, buckets, bucket, grid, least)?;
                    slices.iter().for_each(|slice| out.push_runs(slice));
                    out.sparse = sparse;
                } else {
                    bits.iter().for_each(|slice| out.push(slice));
                }
                Ok(out)
            },
            |slices: Raster| {
                progress(done.next().map_or(0, |bucket| buckets.points_in(bucket)));
                out.append(&slices)
            },
        )?;
        Ok(out)
    }

    /// The same cloud with cells twice as large: a cell is occupied if any of its eight is.
    ///
    /// # Errors
    /// The same as [`Occupancy::of_buckets`].
    pub fn coarser(&self, context: &Context) -> Result<Occupancy> {
        let cells = self.cells.map(|c| c.div_ceil(2));
        let mut out = Occupancy::new(cells, context);
        let mut jobs = chunks(cells[1]);
        context.workers.in_order(
            context.memory.chunks_in_flight,
            || Ok(jobs.next()),
            |chunk| {
                let (mut bits, mut runs) = (Bits::new(cells[0], cells[2]), Runs::default());
                let mut out = Raster::default();
                for y in chunk {
                    bits.clear();
                    for fine in 2 * y..(2 * y + 2).min(self.cells[1]) {
                        self.store.read(fine, &mut runs)?;
                        for z in 0..runs.row_count() {
                            for run in runs.row(z) {
                                set_range(bits.row_mut(z / 2), run.start / 2, run.end.div_ceil(2));
                            }
                        }
                    }
                    out.push(&bits);
                }
                Ok(out)
            },
            |slices| out.append(&slices),
        )?;
        Ok(out)
    }

    /// The same cells without those that `keep` turns down.
    ///
    /// # Errors
    /// The same as [`Occupancy::of_buckets`].
    pub fn filtered(&self, keep: impl Fn(Cell) -> bool + Sync, context: &Context) -> Result<Occupancy> {
        let mut out = Occupancy::new(self.cells, context);
        let mut jobs = chunks(self.cells[1]);
        context.workers.in_order(
            context.memory.chunks_in_flight,
            || Ok(jobs.next()),
            |chunk| {
                let mut runs = Runs::default();
                let mut out = Raster::default();
                for y in chunk {
                    self.store.read(y, &mut runs)?;
                    let mut left = Runs::default();
                    for z in 0..runs.row_count() {
                        for run in runs.row(z) {
                            (run.start..run.end).filter(|&x| keep([x, y, z])).for_each(|x| left.push_run(x, x + 1));
                        }
                        left.end_row();
                    }
                    out.push_runs(&left);
                }
                Ok(out)
            },
            |slices| out.append(&slices),
        )?;
        out.sparse = self.sparse;
        Ok(out)
    }

    /// An occupancy of given cells, for tests and for callers that have cells instead of points.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    ///
    /// # Panics
    /// If a cell lies outside `cells`.
    pub fn of_cells(occupied: impl IntoIterator<Item = Cell>, cells: Cell, context: &Context) -> Result<Occupancy> {
        let mut slices = BTreeMap::<u32, Bits>::new();
        for [x, y, z] in occupied {
            assert!(y < cells[1], "cell outside the grid");
            slices.entry(y).or_insert_with(|| Bits::new(cells[0], cells[2])).set(x, z);
        }
        let mut out = Occupancy::new(cells, context);
        let empty = Bits::new(cells[0], cells[2]);
        let mut raster = Raster::default();
        (0..cells[1]).for_each(|y| raster.push(slices.get(&y).unwrap_or(&empty)));
        out.append(&raster)?;
        Ok(out)
    }
}

/// The slices of a bucket without the cells of fewer than `least` points, and how many these are.
fn well_filled<T: Coordinate>(
    mut slices: Vec<Runs>,
    buckets: &Buckets<T>,
    bucket: usize,
    grid: &Grid,
    least: u32,
) -> Result<(Vec<Runs>, u64)> {
    let [width, _, rows] = grid.cells();
    let mut counts: Vec<(RankBitmap, Vec<u32>)> = slices
        .iter()
        .map(|slice| {
            let mut cells = RankBitmap::new(width, rows);
            let count = cells.replace(slice);
            (cells, vec![0; count as usize])
        })
        .collect();
    let first = bucket as u32 * BUCKET_SLICES;
    buckets.read(bucket, |points| {
        for point in points {
            let [x, y, z] = grid.cell_of(point.map(Into::into));
            let (cells, counts) = &mut counts[(y - first) as usize];
            let number = cells.at(x, z).expect("a point's cell was set");
            counts[number] = counts[number].saturating_add(1);
        }
        Ok(())
    })?;
    let mut sparse = 0;
    for (slice, (_, counts)) in slices.iter_mut().zip(counts) {
        let mut counts = counts.into_iter();
        let mut left = Runs::default();
        for z in 0..slice.row_count() {
            for run in slice.row(z) {
                for (x, count) in (run.start..run.end).zip(&mut counts) {
                    if count >= least {
                        left.push_run(x, x + 1);
                    } else {
                        sparse += 1;
                    }
                }
            }
            left.end_row();
        }
        *slice = left;
    }
    Ok((slices, sparse))
}

/// The points of a cloud by slice, and which of them count.
#[derive(Debug)]
pub struct Sampled<'a, T> {
    /// The points.
    pub buckets: &'a Buckets<T>,
    /// The occupied cells, slice by slice.
    pub occupied: &'a SliceStore,
    /// The grid.
    pub grid: &'a Grid,
    /// Which points count.
    pub counted: Counted,
}

/// Which points count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Counted {
    /// All: every point's cell is occupied.
    All,
    /// Those in occupied cells.
    Occupied,
}

/// The cells of a bucket whose points count.
#[derive(Debug)]
pub struct CountedCells {
    first: u32,
    /// The occupied cells of each slice; `None` if all points count.
    slices: Option<Vec<RankBitmap>>,
}

impl<T: Coordinate> Sampled<'_, T> {
    /// The cells of a bucket whose points count. Memory: nothing if all do, else [`BUCKET_SLICES`] slices of bits and a half.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn counted_in(&self, bucket: u32) -> Result<CountedCells> {
        let first = bucket * BUCKET_SLICES;
        if self.counted == Counted::All {
            return Ok(CountedCells { first, slices: None });
        }
        let [width, slices, rows] = self.grid.cells();
        let mut runs = Runs::default();
        let slice = |y| {
            self.occupied.read(y, &mut runs)?;
            let mut cells = RankBitmap::new(width, rows);
            cells.replace(&runs);
            Ok(cells)
        };
        let slices = (first..slices.min(first + BUCKET_SLICES)).map(slice).collect::<Result<_>>()?;
        Ok(CountedCells { first, slices: Some(slices) })
    }
}

impl CountedCells {
    /// Whether a point of the bucket counts.
    #[inline]
    pub fn contains(&self, grid: &Grid, point: [f64; 3]) -> bool {
        self.slices.as_ref().is_none_or(|slices| {
            let [x, y, z] = grid.cell_of(point);
            slices[(y - self.first) as usize].at(x, z).is_some()
        })
    }
}
