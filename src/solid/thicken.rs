//! Thickening: sheets have no inside. They are kept as thin bodies, with what is missing between their samples filled in.
//!
//! ```text
//!      o o o o o o o o      # samples of a sheet, which has the outside on both sides
//!      # # . # # . . #      A ball that rolls on either side of it does not pass through the gaps (.), and what it does not reach becomes inside.
//!      o o o o o o o o
//! ```
//!
//! Of a sheet's occupied cells, those in the walls of its patch ([`crate::solid::sign`]), D is what a ball of squared radius r₁² round one of them covers. Inside
//! become the free cells, whether they had a side or none, that are farther than r₂ from all cells out of D. r₁ is 2.7 sampling distances, at least √6 cells: of a
//! sheet whose samples lie at random, a disc of that radius is empty once in 10¹⁰. r₂ is a little less, so that a sheet across the axes hangs together by faces.

use crate::error::Result;
use crate::grid::context::Context;
use crate::grid::dilate::Ball;
use crate::grid::occupancy::Occupancy;
use crate::grid::slice::{Bits, Runs, Slices, clip};
use crate::solid::exterior::{Padded, invert};
use crate::solid::move_back;
use crate::solid::sign::Block;
use crate::solid::watershed::{Sides, stores};

/// r₁ in sampling distances.
const BETWEEN: f64 = 2.7;

/// The least r₁², in cells.
const LEAST: u32 = 6;

/// The greatest r₁², in cells.
const MOST: u32 = 256;

/// How much less than r₁ is r₂, in cells.
const THICKER: f64 = 0.7;

/// The walls of sheets, on the level of the sign.
#[derive(Debug, Clone, Copy)]
pub struct Sheets<'a> {
    /// The level's cells.
    pub block: &'a Block,
    /// The indices of the walls, in order.
    pub walls: &'a [u32],
    /// How many cells of the grid one of them is wide.
    pub factor: u32,
}

impl Sheets<'_> {
    /// Sets the occupied cells of slice `y` that lie in walls in `bits`, moved by `pad` cells and rows; none where there is no such slice.
    fn paint(&self, occupancy: &Occupancy, y: i64, pad: u32, bits: &mut Bits, runs: &mut Runs) -> Result<()> {
        bits.clear();
        if !(0..i64::from(occupancy.cells[1])).contains(&y) {
            return Ok(());
        }
        occupancy.store.read(y as u32, runs)?;
        for z in 0..runs.row_count() {
            let row = [0, y as u32, z].map(|c| (c / self.factor) as usize);
            let first = self.block.index(row) as u32;
            let end = first + occupancy.cells[0].div_ceil(self.factor);
            let walls = &self.walls[self.walls.partition_point(|wall| *wall < first)..];
            let walls = &walls[..walls.partition_point(|wall| *wall < end)];
            let is_wall = |x: u32| walls.binary_search(&(first + x / self.factor)).is_ok();
            let cells = runs.row(z).iter().filter(|_| !walls.is_empty()).flat_map(|run| run.start..run.end);
            cells.filter(|x| is_wall(*x)).for_each(|x| bits.set(x + pad, z + pad));
        }
        Ok(())
    }
}

/// The balls of r₁ and r₂, where a cell is `side` sampling distances wide.
fn balls(side: f64) -> [Ball; 2] {
    let squared = ((BETWEEN / side).powi(2) as u32).clamp(LEAST, MOST);
    let thinner = f64::from(squared).sqrt() - THICKER;
    [squared, (thinner * thinner) as u32].map(Ball::squared)
}

impl Sides {
    /// The same sides of the grid's cells, with the free cells of thickened sheets given to the inside. `side`: that of a cell in sampling distances.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn with_thickened(
        self,
        sheets: Sheets<'_>,
        side: f64,
        occupancy: &Occupancy,
        context: &Context,
    ) -> Result<Sides> {
        if sheets.walls.is_empty() {
            return Ok(self);
        }
        let balls = balls(side);
        let radius = balls[0].radius() + balls[1].radius() + 2;
        let [outside, inside] =
            stores(self.padded, radius, context, |slices| self.thickened(sheets, balls, occupancy, slices))?;
        Ok(Sides { outside, inside, ..self })
    }

    /// The outside without the thickened sheets, and the inside with them, in some slices.
    fn thickened(
        &self,
        sheets: Sheets<'_>,
        [near, far]: [Ball; 2],
        occupancy: &Occupancy,
        slices: std::ops::Range<u32>,
    ) -> Result<[Slices; 2]> {
        // A padding that D leaves free at its border, and no less than that of the sides.
        let radius = near.radius().max(self.padded.pad);
        let wide = Padded::new(occupancy.cells, radius);
        let more = wide.pad - self.padded.pad;
        let mut reached = wide.dilation(far, slices.end + more);
        let mut covered = wide.dilation(near, slices.end + more + far.radius());
        let (mut thick, mut side, mut runs) = (self.padded.bits(), self.padded.bits(), Runs::default());
        let [width, _, rows] = self.padded.cells;
        let mut out: [Slices; 2] = Default::default();
        for y in slices {
            let reached = reached.slide_to(i64::from(y + more), |y, free| {
                let paint = |y: i64, bits: &mut Bits| {
                    sheets.paint(occupancy, y - i64::from(wide.pad), wide.pad, bits, &mut runs)
                };
                let covered = covered.slide_to(y, paint)?;
                for z in 0..wide.cells[2] {
                    let row = free.row_mut(z);
                    row.copy_from_slice(covered.row(z));
                    invert(row, wide.cells[0]);
                }
                Ok(())
            })?;
            self.padded.paint_occupied(occupancy, i64::from(y), &mut side, &mut runs)?;
            thick.clear();
            for z in 0..rows {
                let row = thick.row_mut(z);
                move_back(reached.row(z + more), more, row);
                row.iter_mut().zip(side.row(z)).for_each(|(thick, occupied)| *thick = !(*thick | occupied));
                clip(row, width);
            }
            self.outside.paint(i64::from(y), &mut side, &mut runs)?;
            side.and_not(&thick);
            out[0].push(&side);
            self.inside.paint(i64::from(y), &mut side, &mut runs)?;
            for z in 0..rows {
                side.row_mut(z).iter_mut().zip(thick.row(z)).for_each(|(side, thick)| *side |= thick);
            }
            out[1].push(&side);
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::grid::Cell;
    use crate::grid::slice::SliceStore;
    use crate::run::testing::with_context;

    fn squared_distance(a: [i64; 3], b: [i64; 3]) -> u32 {
        (0..3).map(|i| (a[i] - b[i]).pow(2)).sum::<i64>() as u32
    }

    /// The thickened sheet cell by cell, among the cells of a box.
    fn twin(sheet: &[[i64; 3]], [near, far]: [u32; 2], cells: &[[i64; 3]]) -> Vec<[i64; 3]> {
        let in_d = |cell: [i64; 3]| sheet.iter().any(|at| squared_distance(cell, *at) <= near);
        let reach = i64::from(far.isqrt());
        let steps: Vec<[i64; 3]> = (-reach..=reach)
            .flat_map(|x| (-reach..=reach).flat_map(move |y| (-reach..=reach).map(move |z| [x, y, z])))
            .filter(|step| squared_distance(*step, [0; 3]) <= far)
            .collect();
        let is_far = |cell: &[i64; 3]| steps.iter().all(|step| in_d([0, 1, 2].map(|a| cell[a] + step[a])));
        cells.iter().copied().filter(|cell| is_far(cell)).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn thickened_sheets_are_those_of_the_twin(
            samples in prop::collection::vec((0u32..14, 0u32..13, 0u32..12, any::<bool>()), 1..60),
            factor in 1u32..4,
            side in 0.6f64..1.3,
            pad in 1u32..6,
        ) {
            let cells: Cell = [14, 13, 12];
            let block = Block::new(cells.map(|c| c.div_ceil(factor)));
            let wall = |[x, y, z]: Cell| block.index([x, y, z].map(|c| (c / factor) as usize)) as u32;
            let mut walls: Vec<u32> =
                samples.iter().filter(|s| s.3).map(|(x, y, z, _)| wall([*x, *y, *z])).collect();
            walls.sort_unstable();
            walls.dedup();
            let occupied: Vec<Cell> = samples.iter().map(|(x, y, z, _)| [*x, *y, *z]).collect();
            let sheet: Vec<[i64; 3]> =
                occupied.iter().filter(|cell| walls.contains(&wall(**cell))).map(|cell| cell.map(i64::from)).collect();
            let padded = Padded { pad, cells: cells.map(|c| c + 2 * pad) };
            let all: Vec<[i64; 3]> = (0..padded.cells[1])
                .flat_map(|y| (0..padded.cells[2]).flat_map(move |z| (0..padded.cells[0]).map(move |x| [x, y, z])))
                .map(|cell| cell.map(|c| i64::from(c) - i64::from(pad)))
                .collect();
            let is_free = |cell: &[i64; 3]| !occupied.iter().any(|at| at.map(i64::from) == *cell);
            // Some free cells have no side yet.
            let is_outside = |cell: &[i64; 3]| is_free(cell) && (3 * cell[0] + 5 * cell[1] + 2 * cell[2]).rem_euclid(4) > 0;
            let found: Vec<[i64; 3]> = with_context(cells, |context| {
                let occupancy = Occupancy::of_cells(occupied.iter().copied(), cells, context).unwrap();
                let [mut outside, mut inside] = [(); 2].map(|()| SliceStore::new(&context.workspace, context.memory.store_quota));
                let mut bits = padded.bits();
                for y in 0..i64::from(padded.cells[1]) {
                    let mut slices = [Slices::default(), Slices::default()];
                    bits.clear();
                    slices[1].push(&bits);
                    for [x, _, z] in all.iter().filter(|cell| cell[1] + i64::from(pad) == y && is_outside(cell)) {
                        bits.set((x + i64::from(pad)) as u32, (z + i64::from(pad)) as u32);
                    }
                    slices[0].push(&bits);
                    outside.extend(&slices[0]).unwrap();
                    inside.extend(&slices[1]).unwrap();
                }
                let sides = Sides { padded, outside, inside, squared: 2 };
                let sheets = Sheets { block: &block, walls: &walls, factor };
                let sides = sides.with_thickened(sheets, side, &occupancy, context).unwrap();
                let [mut outside, mut inside] = [padded.bits(), padded.bits()];
                let mut runs = Runs::default();
                all.iter().copied().filter(|cell| {
                    let [x, y, z] = cell.map(|c| c + i64::from(pad));
                    sides.outside.paint(y, &mut outside, &mut runs).unwrap();
                    sides.inside.paint(y, &mut inside, &mut runs).unwrap();
                    assert_eq!(outside.get(x, z), is_outside(cell) && !inside.get(x, z));
                    inside.get(x, z)
                }).collect()
            });
            let squared = ((2.7 / side) * (2.7 / side)).floor().max(6.0);
            let thinner = ((squared.sqrt() - 0.7) * (squared.sqrt() - 0.7)).floor();
            let expected: Vec<[i64; 3]> =
                twin(&sheet, [squared as u32, thinner as u32], &all).into_iter().filter(is_free).collect();
            prop_assert_eq!(found, expected);
        }
    }
}
