//! A level's cells, held whole, with some cells more on every side.

use std::ops::Range;

use rayon::prelude::*;

use crate::error::Result;
use crate::grid::Cell;
use crate::grid::occupancy::Occupancy;
use crate::grid::slice::Runs;

/// What a cell of a block is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Side {
    /// Occupied: a wall.
    Wall,
    /// Free, and outside.
    Outside,
    /// Free, and inside.
    Inside,
    /// Free, in a piece that the level's cells do not tell the side of.
    Unknown,
}

/// Cells added on every side, so that what looks about a cell need not look where the block ends.
pub const PAD: usize = 4;

/// A box of cells. Cell (x, y, z) of the level has the index ((y + PAD) rows + z + PAD) width + x + PAD.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Block {
    /// The level's cells along x, slices, rows.
    pub cells: Cell,
    /// Cells along x, padding included.
    pub width: usize,
    /// Slices, padding included.
    pub slices: usize,
    /// Rows of a slice, padding included.
    pub rows: usize,
}

impl Block {
    /// The block of so many cells.
    pub fn new(cells: Cell) -> Block {
        let [width, slices, rows] = cells.map(|c| c as usize + 2 * PAD);
        Block { cells, width, slices, rows }
    }

    /// The block of a level whose cells are taken together by `factor` along every axis, and which of its cells are occupied: those any of whose cells is.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn of(occupancy: &Occupancy, factor: u32) -> Result<(Block, Vec<bool>)> {
        Block::of_slices(occupancy, factor, 0..occupancy.cells[1].div_ceil(factor))
    }

    /// The same for some slices of the level; the padding holds what is occupied of those beside them.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn of_slices(occupancy: &Occupancy, factor: u32, slices: Range<u32>) -> Result<(Block, Vec<bool>)> {
        let [width, _, rows] = occupancy.cells.map(|c| c.div_ceil(factor));
        let block = Block::new([width, slices.len() as u32, rows]);
        let mut occupied = vec![false; block.size()];
        let mut runs = Runs::default();
        let below = (slices.start * factor).saturating_sub(PAD as u32 * factor);
        for y in below..occupancy.cells[1].min((slices.end + PAD as u32) * factor) {
            occupancy.store.read(y, &mut runs)?;
            let slice = (y / factor) as usize + PAD - slices.start as usize;
            for z in 0..runs.row_count() {
                let first = (slice * block.rows + (z / factor) as usize + PAD) * block.width + PAD;
                for run in runs.row(z) {
                    let cells = (run.start / factor) as usize..run.end.div_ceil(factor) as usize;
                    occupied[first + cells.start..first + cells.end].fill(true);
                }
            }
        }
        Ok((block, occupied))
    }

    /// Number of cells, padding included.
    pub fn size(&self) -> usize {
        self.width * self.slices * self.rows
    }

    /// The index of a cell of the level.
    pub fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        ((y + PAD) * self.rows + z + PAD) * self.width + x + PAD
    }

    /// The index of a cell of the level or of the padding; none beyond that.
    pub fn at(&self, cell: [i64; 3]) -> Option<usize> {
        let [x, y, z] = cell.map(|c| c + PAD as i64);
        let inside = |c: i64, n: usize| (0..n as i64).contains(&c);
        (inside(x, self.width) && inside(y, self.slices) && inside(z, self.rows))
            .then(|| (y as usize * self.rows + z as usize) * self.width + x as usize)
    }

    /// The cell of the level that has an index.
    pub fn cell(&self, index: usize) -> [usize; 3] {
        let (x, rest) = (index % self.width, index / self.width);
        [x, rest / self.rows, rest % self.rows].map(|c| c.saturating_sub(PAD))
    }

    /// Steps to the next cell along x, slices and rows.
    pub fn strides(&self) -> [isize; 3] {
        [1, (self.rows * self.width) as isize, self.width as isize]
    }

    /// The six cells that share a face with one that does not lie at the border.
    #[inline]
    pub fn beside(&self, cell: usize) -> [usize; 6] {
        let (slice, row) = (self.rows * self.width, self.width);
        [
            cell.wrapping_sub(1),
            cell.wrapping_add(1),
            cell.wrapping_sub(slice),
            cell.wrapping_add(slice),
            cell.wrapping_sub(row),
            cell.wrapping_add(row),
        ]
    }

    /// The step from a cell to another.
    pub fn step(&self, [x, y, z]: [i32; 3]) -> isize {
        let [a, b, c] = self.strides();
        x as isize * a + y as isize * b + z as isize * c
    }

    /// Whether a cell of the block lies on its border.
    pub fn at_border(&self, index: usize) -> bool {
        let (x, rest) = (index % self.width, index / self.width);
        let (z, y) = (rest % self.rows, rest / self.rows);
        x == 0 || z == 0 || y == 0 || x + 1 == self.width || z + 1 == self.rows || y + 1 == self.slices
    }

    /// A flag for each cell, made row by row: `make` is given the indices of a row's cells that do not lie at the block's border, and their flags, which are false. The
    /// others stay false. The work is dealt out to the pool that it is called in.
    pub fn each_row(&self, make: impl Fn(Range<usize>, &mut [bool]) + Sync) -> Vec<bool> {
        let mut flags = vec![false; self.size()];
        let slice = self.rows * self.width;
        flags.par_chunks_mut(slice).enumerate().filter(|(y, _)| *y > 0 && y + 1 < self.slices).for_each(
            |(y, flags)| {
                for z in 1..self.rows - 1 {
                    let row = z * self.width + 1..(z + 1) * self.width - 1;
                    make(y * slice + row.start..y * slice + row.end, &mut flags[row]);
                }
            },
        );
        flags
    }

    /// The offsets of a ball of squared radius `squared`, its centre included.
    pub fn ball(squared: i32) -> Vec<[i32; 3]> {
        let r = squared.isqrt();
        let mut out = Vec::new();
        for y in -r..=r {
            for z in -r..=r {
                out.extend((-r..=r).filter(|x| x * x + y * y + z * z <= squared).map(|x| [x, y, z]));
            }
        }
        out
    }

    /// Which of the five cells from two before a cell to two after it, in its row, have their flag set: bits 0 to 4, in this order. Neither end may lie beyond the block by more
    /// than the padding is wide.
    #[inline]
    pub fn five(flags: &[bool], cell: usize) -> u8 {
        let eight: [u8; 8] = bytemuck::cast_slice(&flags[cell - 2..cell + 6]).try_into().expect("eight flags");
        // Each flag is a byte; the product's highest byte gathers them.
        (u64::from_le_bytes(eight).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8 & 0x1F
    }

    /// The steps of the 26 cells round a cell.
    pub fn around(&self) -> Vec<isize> {
        Block::ball(3).into_iter().filter(|d| *d != [0; 3]).map(|d| self.step(d)).collect()
    }
}
