//! Walls of a level that is not held whole, counted some slices at a time.

use super::block::{Block, PAD};
use super::normal::{Wall, doubles, two_sided};
use crate::error::Result;
use crate::grid::Cell;
use crate::grid::context::Context;
use crate::grid::occupancy::Occupancy;

/// Slices of the level that are held at a time, beside padding on either side.
const SLICES: u32 = 16;

/// Bytes for each cell of these: its flag; and for one in four, as if it were occupied, its number, and a wall.
const CELL: u64 = 1 + (size_of::<u32>() as u64 + size_of::<Wall>() as u64) / 4;

/// How many walls a level has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WallCount {
    /// Its occupied cells.
    pub occupied: u64,
    /// Its walls: those with free cells on both sides.
    pub walls: u64,
    /// How many of these are double ([`super::Signed::doubles`]).
    pub doubles: u64,
}

impl WallCount {
    /// Counts them where cells are taken together by `factor`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn of(occupancy: &Occupancy, factor: u32, context: &Context) -> Result<WallCount> {
        let slices = occupancy.cells[1].div_ceil(factor);
        let mut counted = WallCount { occupied: 0, walls: 0, doubles: 0 };
        for first in (0..slices).step_by(SLICES as usize) {
            context.workers.check_cancelled()?;
            let (block, occupied) = Block::of_slices(occupancy, factor, first..(first + SLICES).min(slices))?;
            let slice = block.rows * block.width;
            let own = PAD * slice..occupied.len() - PAD * slice;
            let cells: Vec<u32> = own.filter(|&cell| occupied[cell]).map(|cell| cell as u32).collect();
            let [walls, double] = context.workers.pool().install(|| {
                let walls = two_sided(&block, &occupied, &cells);
                let double = doubles(&block, &occupied, &walls).into_iter().filter(|is_double| *is_double).count();
                [walls.len(), double]
            });
            counted.occupied += cells.len() as u64;
            counted.walls += walls as u64;
            counted.doubles += double as u64;
        }
        context.workers.between_steps();
        Ok(counted)
    }
}

/// The most memory that counting them takes on any level of a grid of so many cells that may be tried.
pub fn bytes(cells: Cell) -> u64 {
    let factor = super::least_factor(cells, super::FINER_LONGEST);
    let [width, slices, rows] = cells.map(|c| u64::from(c.div_ceil(factor)) + 2 * PAD as u64);
    width * rows * slices.min(u64::from(SLICES) + 2 * PAD as u64) * CELL
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::run::testing::with_context;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 16, ..ProptestConfig::default() })]

        #[test]
        fn counts_are_those_of_the_whole_level(
            factor in 1u32..4,
            planes in proptest::collection::vec((0u32..3, 0u32..70), 1..5),
            strays in proptest::collection::vec(any::<[u32; 3]>(), 0..200),
        ) {
            let cells = [40, 70, 30];
            let of_plane = |&(axis, at): &(u32, u32)| {
                let [a, b, c] = [axis, (axis + 1) % 3, (axis + 2) % 3].map(|a| a as usize);
                let mut all = Vec::new();
                for i in 0..cells[b] {
                    for j in 0..cells[c] {
                        let mut cell = [0; 3];
                        (cell[a], cell[b], cell[c]) = (at.min(cells[a] - 1), i, j);
                        all.push(cell);
                    }
                }
                all
            };
            let strays = strays.iter().map(|s| std::array::from_fn(|a| s[a] % cells[a]));
            let occupied: Vec<Cell> = planes.iter().flat_map(of_plane).chain(strays).collect();
            with_context(cells, |context| {
                let occupancy = Occupancy::of_cells(occupied, cells, context).unwrap();
                let (block, occupied) = Block::of(&occupancy, factor).unwrap();
                let all: Vec<u32> = (0..occupied.len() as u32).filter(|cell| occupied[*cell as usize]).collect();
                let walls = two_sided(&block, &occupied, &all);
                let double = doubles(&block, &occupied, &walls).into_iter().filter(|is_double| *is_double).count();
                let expected =
                    WallCount { occupied: all.len() as u64, walls: walls.len() as u64, doubles: double as u64 };
                assert_eq!(WallCount::of(&occupancy, factor, context).unwrap(), expected);
            });
        }
    }
}
