//! Lines of sight: what lies between a point and the place it was scanned from is empty, so it is outside.
//!
//! ```text
//!   place          . o . . . . . . . .      o the cells that the line goes through; those next to the point's (~), which noise may have moved, are left out
//!     *----------->. . o o o o o ~ #
//!                  # # # # # # # # #        A line that meets an occupied cell on its way says nothing: noise, or the edge of something.
//! ```
//!
//! All points of a cell that one place saw are one line, from the middle of the cell. So neither their number nor their order matters, and there are no more lines than
//! occupied cells times places.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use rayon::prelude::*;

use super::Seen;
use crate::error::Result;
use crate::grid::context::Context;
use crate::grid::{Cell, Grid};
use crate::input::{Cloud, Places};

/// A cell is empty if so many lines go through it: one may be that of a stray.
pub(super) const LINES: u32 = 2;

/// Cells within this squared distance of the point's are left out.
pub(super) const NEAR: usize = 3;

/// Places that are looked at in one pass over the points: a bit of a number for each.
const AT_A_TIME: usize = u64::BITS as usize;

/// The lines of sight from a cloud's points to the places that they were scanned from.
#[derive(Debug)]
pub struct Sights<'a> {
    cloud: &'a Cloud<'a>,
    grid: &'a Grid,
    places: Places,
}

impl<'a> Sights<'a> {
    /// Those of a cloud's points; none if it is not known where they were scanned from.
    pub fn of(cloud: &'a Cloud<'a>, grid: &'a Grid) -> Option<Sights<'a>> {
        let places = cloud.places();
        (!places.places.is_empty()).then_some(Sights { cloud, grid, places })
    }

    /// Number of places.
    pub fn places(&self) -> usize {
        self.places.places.len()
    }

    /// Whether each cell of a level, whose cells are taken together by `factor`, is empty, as lines of sight say. A pass over the points for every 64 places; memory:
    /// [`CELL`] for each cell, and blocks of points.
    ///
    /// # Errors
    /// Errors of reading the input; [`crate::Error::Interrupted`].
    pub(super) fn emptied(&self, seen: &Seen, factor: u32, context: &Context) -> Result<Vec<bool>> {
        let (block, occupied) = (&seen.block, &seen.occupied);
        let zeros = || (0..block.size()).into_par_iter().map(|_| AtomicU64::new(0)).collect::<Vec<_>>();
        let marks = zeros();
        let counts: Vec<AtomicU32> = (0..block.size()).map(|_| AtomicU32::new(0)).collect();
        for (pass, places) in self.places.places.chunks(AT_A_TIME).enumerate() {
            self.mark(pass * AT_A_TIME..pass * AT_A_TIME + places.len(), seen, factor, &marks, context)?;
            let line = |cell: Cell, place: [f64; 3], passed: &mut Vec<usize>| {
                let (place, piece) = self.grid.seen_from(cell.map(|c| c * factor), place);
                let scale = f64::from(factor);
                let within = piece.map(|cells| (cells.start / factor) as usize..cells.end.div_ceil(factor) as usize);
                passed.clear();
                let free = walk(cell.map(|c| c as usize), place.map(|c| c / scale), &within, |cell| {
                    passed.push(block.index(cell));
                    !occupied[block.index(cell)]
                });
                if free {
                    for &cell in passed.iter() {
                        counts[cell].fetch_add(1, Ordering::Relaxed);
                    }
                }
            };
            context.workers.pool().install(|| {
                seen.walls.par_iter().for_each_init(Vec::new, |passed, &wall| {
                    let mut bits = marks[wall as usize].swap(0, Ordering::Relaxed);
                    let cell = block.cell(wall as usize).map(|c| c as u32);
                    while bits != 0 {
                        line(cell, places[bits.trailing_zeros() as usize], passed);
                        bits &= bits - 1;
                    }
                });
            });
            context.workers.check_cancelled()?;
        }
        drop(marks);
        let is_empty = |(count, occupied): (AtomicU32, &bool)| !occupied && count.into_inner() >= LINES;
        Ok(counts.into_par_iter().zip(occupied).map(is_empty).collect())
    }

    /// Marks the occupied cells that any of these places saw a point of, a bit for each place.
    fn mark(&self, of: Range<usize>, seen: &Seen, factor: u32, marks: &[AtomicU64], context: &Context) -> Result<()> {
        let in_flight = context.memory.blocks_in_flight;
        self.cloud.for_each_batch(
            &context.workers,
            in_flight,
            self.places.carried(),
            |batch| {
                self.places.each(batch, |point, place| {
                    if of.contains(&place) {
                        let cell = self.grid.cell_of(point).map(|c| (c / factor) as usize);
                        let index = seen.block.index(cell);
                        let bit = 1u64 << (place - of.start);
                        // Most points of a cell were seen with others.
                        if seen.occupied[index] && marks[index].load(Ordering::Relaxed) & bit == 0 {
                            marks[index].fetch_or(bit, Ordering::Relaxed);
                        }
                    }
                });
                Ok(())
            },
            |()| Ok(()),
        )
    }
}

/// Bytes for each cell of the block: which places saw it, how many lines go through it, and its flag.
pub const CELL: u64 = 8 + 4 + 1;

/// Tells of the cells that the line from the middle of `cell` to `place` goes through, in turn, as long as they lie `within` a box and `tell` wants more; but not of those that
/// are [`NEAR`]. A cell that the line merely touches does not count. Whether `tell` wanted all.
pub(super) fn walk(
    cell: [usize; 3],
    place: [f64; 3],
    within: &[Range<usize>; 3],
    mut tell: impl FnMut([usize; 3]) -> bool,
) -> bool {
    let middle = cell.map(|c| c as f64 + 0.5);
    let mut here = cell;
    loop {
        // The part of the line at which it leaves the cell along each axis.
        let leaves: [f64; 3] = std::array::from_fn(|a| leaving(here[a], middle[a], place[a]));
        let next = leaves.into_iter().fold(f64::INFINITY, f64::min);
        if next >= 1.0 {
            return true;
        }
        for a in 0..3 {
            if leaves[a] == next {
                let up = place[a] > middle[a];
                if here[a] == if up { within[a].end - 1 } else { within[a].start } {
                    return true;
                }
                here[a] = if up { here[a] + 1 } else { here[a] - 1 };
            }
        }
        let apart: usize = (0..3).map(|a| here[a].abs_diff(cell[a]).pow(2)).sum();
        if apart > NEAR && !tell(here) {
            return false;
        }
    }
}

/// Where a line, 0 at `from` and 1 at `to`, leaves a plane of cells that it goes through.
fn leaving(plane: usize, from: f64, to: f64) -> f64 {
    if from == to {
        return f64::INFINITY;
    }
    let side = if to > from { plane + 1 } else { plane };
    (side as f64 - from) / (to - from)
}
