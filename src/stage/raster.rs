//! Raster: the cells that hold a point, slice by slice.

use std::collections::BTreeMap;

use crate::bucket::Buckets;
use crate::context::{Context, chunks};
use crate::error::Result;
use crate::grid::{Cell, Grid};
use crate::partition::BUCKET_SLICES;
use crate::points::Coordinate;
use crate::slice::{Bits, Runs, SliceStore};

/// The occupied cells of a cloud at one resolution.
#[derive(Debug)]
pub struct Occupancy {
    /// Cells along x, slices, rows.
    pub cells: Cell,
    /// The slices.
    pub store: SliceStore,
    /// Number of occupied cells.
    pub occupied: u64,
    /// Of each slice: its occupied cells.
    pub in_slice: Vec<u32>,
}

impl Occupancy {
    fn new(cells: Cell, context: &Context) -> Occupancy {
        let store = SliceStore::new(&context.workspace, context.memory.store_quota);
        Occupancy { cells, store, occupied: 0, in_slice: Vec::with_capacity(cells[1] as usize) }
    }

    fn append(&mut self, slices: Vec<Runs>) -> Result<()> {
        for slice in slices {
            let occupied = slice.cell_count();
            self.occupied += occupied;
            self.in_slice.push(occupied as u32);
            self.store.append(&slice)?;
        }
        Ok(())
    }

    /// Rasters all buckets; `progress` is told the slices of each. Memory: [`BUCKET_SLICES`] slices of bits and a piece of a bucket for each job in flight.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn of_buckets<T: Coordinate>(
        buckets: &Buckets<T>,
        grid: &Grid,
        context: &Context,
        mut progress: impl FnMut(u32),
    ) -> Result<Occupancy> {
        let cells = grid.cells();
        let [width, slices, rows] = cells;
        let mut out = Occupancy::new(cells, context);
        let mut jobs = 0..buckets.count();
        context.workers.in_order(
            context.memory.chunks_in_flight,
            || Ok(jobs.next()),
            |bucket| {
                let first = bucket as u32 * BUCKET_SLICES;
                let mut bits = vec![Bits::new(width, rows); (slices - first).min(BUCKET_SLICES) as usize];
                buckets.read(bucket, context.memory.piece_points, |points| {
                    for point in points {
                        let [x, y, z] = grid.cell_of(point.map(Into::into));
                        bits[(y - first) as usize].set(x, z);
                    }
                    Ok(())
                })?;
                Ok(bits.iter().map(Runs::from_bits).collect())
            },
            |slices: Vec<Runs>| {
                progress(slices.len() as u32);
                out.append(slices)
            },
        )?;
        Ok(out)
    }

    /// The same cloud with cells twice as large: a cell is occupied if any of its eight is.
    ///
    /// # Errors
    /// As [`Occupancy::of_buckets`].
    pub fn coarser(&self, context: &Context) -> Result<Occupancy> {
        let cells = self.cells.map(|c| c.div_ceil(2));
        let mut out = Occupancy::new(cells, context);
        let mut jobs = chunks(cells[1]);
        context.workers.in_order(
            context.memory.chunks_in_flight,
            || Ok(jobs.next()),
            |chunk| {
                let (mut bits, mut runs) = (Bits::new(cells[0], cells[2]), Runs::default());
                chunk
                    .map(|y| {
                        bits.clear();
                        for fine in 2 * y..(2 * y + 2).min(self.cells[1]) {
                            self.store.read(fine, &mut runs)?;
                            for z in 0..runs.row_count() {
                                for run in runs.row(z) {
                                    crate::slice::set_range(bits.row_mut(z / 2), run.start / 2, run.end.div_ceil(2));
                                }
                            }
                        }
                        Ok(Runs::from_bits(&bits))
                    })
                    .collect()
            },
            |slices| out.append(slices),
        )?;
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
        out.append((0..cells[1]).map(|y| Runs::from_bits(slices.get(&y).unwrap_or(&empty))).collect())?;
        Ok(out)
    }
}
