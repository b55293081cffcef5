//! Tiles: small boxes of cells that a job looks at one by one, as arrays of bytes.
//!
//! ```text
//!   z ^   +----+----+----+      A job has sixteen slices, cut into tiles of TILE x TILE cells. A tile is looked at with some cells
//!     |   |    |::::|    |      more on every side; what lies outside the box is empty.
//!     |   +----+----+----+
//!     +-----------------> x
//! ```

use std::collections::BTreeSet;
use std::ops::Range;

use super::layers::Stretch;
use crate::grid::Cell;

/// Cells of a tile's side, across the slices.
pub const TILE: u32 = 32;

/// A box of cells with a margin.
#[derive(Debug, Clone, Copy)]
pub struct Tile {
    /// The lowest cell of the margin.
    pub low: [i64; 3],
    /// Cells along x, slices, rows, with the margin.
    pub size: [usize; 3],
    /// The margin.
    pub margin: i64,
}

impl Tile {
    /// The box of `cells` with a margin.
    pub fn new(cells: [Range<u32>; 3], margin: i64) -> Tile {
        let low = [0, 1, 2].map(|a| i64::from(cells[a].start) - margin);
        Tile { low, size: [0, 1, 2].map(|a| cells[a].len() + 2 * margin as usize), margin }
    }

    /// The tiles of a chunk at these places: rows and x, in tiles.
    pub fn at(places: BTreeSet<(u32, u32)>, chunk: &Range<u32>, cells: Cell, margin: i64) -> Vec<Tile> {
        let tile = |(z, x): (u32, u32)| {
            let side = |tile: u32, a: usize| tile * TILE..((tile + 1) * TILE).min(cells[a]);
            Tile::new([side(x, 0), chunk.clone(), side(z, 2)], margin)
        };
        places.into_iter().map(tile).collect()
    }

    /// The tiles of a chunk that hold some of `marked`.
    pub fn with(marked: &Stretch, chunk: &Range<u32>, cells: Cell, margin: i64) -> Vec<Tile> {
        let mut at = BTreeSet::new();
        for y in chunk.clone() {
            let runs = marked.slice(y.into());
            for z in 0..runs.row_count() {
                for run in runs.row(z) {
                    at.extend((run.start / TILE..run.end.div_ceil(TILE)).map(|x| (z / TILE, x)));
                }
            }
        }
        Tile::at(at, chunk, cells, margin)
    }

    /// Cells with the margin.
    pub fn len(&self) -> usize {
        self.size.iter().product()
    }

    /// The place of a cell, which lies in the tile or its margin.
    #[inline]
    pub fn place(&self, [x, y, z]: [i64; 3]) -> usize {
        ((y - self.low[1]) as usize * self.size[2] + (z - self.low[2]) as usize) * self.size[0]
            + (x - self.low[0]) as usize
    }

    /// The step to the next cell along x, to the next slice, to the next row.
    pub fn strides(&self) -> [usize; 3] {
        [1, self.size[0] * self.size[2], self.size[0]]
    }

    /// Whether a cell lies in the tile or its margin, but for so many cells on every side.
    #[inline]
    pub fn holds(&self, cell: [i64; 3], but: i64) -> bool {
        (0..3).all(|a| cell[a] >= self.low[a] + but && cell[a] < self.low[a] + self.size[a] as i64 - but)
    }

    /// Its cells along x, slices and rows, but for so many on every side of the margin.
    pub fn ranges(&self, but: i64) -> [Range<i64>; 3] {
        [0, 1, 2].map(|a| self.low[a] + but..(self.low[a] + self.size[a] as i64 - but).max(self.low[a] + but))
    }

    /// The cells of the tile, but for so many on every side of the margin, by slice, row and x.
    pub fn cells(&self, but: i64) -> impl Iterator<Item = [i64; 3]> + use<> {
        let [xs, ys, zs] = self.ranges(but);
        ys.flat_map(move |y| {
            let xs = xs.clone();
            zs.clone().flat_map(move |z| xs.clone().map(move |x| [x, y, z]))
        })
    }

    /// Writes `value` to the cells of `runs`.
    pub fn paint<T: Copy>(&self, runs: &Stretch, value: T, out: &mut [T]) {
        let [x0, y0, z0] = self.low;
        for y in y0..y0 + self.size[1] as i64 {
            for z in z0..z0 + self.size[2] as i64 {
                let row = runs.row(y, z);
                let first = row.partition_point(|run| i64::from(run.end) <= x0);
                for run in &row[first..] {
                    let (start, end) = (i64::from(run.start).max(x0), i64::from(run.end).min(x0 + self.size[0] as i64));
                    if start >= end {
                        break;
                    }
                    let at = self.place([start, y, z]);
                    out[at..at + (end - start) as usize].fill(value);
                }
            }
        }
    }
}
