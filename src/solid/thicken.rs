//! Thickening: sheets have no inside. They are kept as thin bodies, with what is missing between their samples filled in.
//!
//! ```text
//!      o o o o o o o o      # samples of a sheet, which has the outside on both sides
//!      # # . # # . . #      A ball that rolls on either side of it does not pass through the gaps (.), and what it does not reach becomes solid.
//!      o o o o o o o o
//! ```
//!
//! Of a sheet's occupied cells, those in the walls of its patch and in those that it goes on in beneath a body ([`crate::solid::sign`]), D is what a ball of squared radius r₁² round
//! one of them covers. Solid become the cells that are farther than r₂ from all cells out of D, and lie in the plane of a wall near them. r₁ is 2.7 sampling distances,
//! at least √6 cells. r₂ is a little less, so that a sheet across the axes hangs together by faces. A gap of radius g is filled where √(r₁² − g²) ≥ r₂. Where
//! cells are one sampling distance wide, that is 1.8 of these: of a sheet whose samples lie at random, a disc of that radius is empty once in 3 · 10⁴. The small holes that are left are
//! unresolved cells ([`crate::solid::unresolved`]).
//! Between two sheets side by side, such as the fins of a cooler, a ball may not fit. Planes leave the air between them.

use crate::error::Result;
use crate::grid::context::{Context, chunks};
use crate::grid::dilate::Ball;
use crate::grid::occupancy::Occupancy;
use crate::grid::slice::{Bits, Runs, SliceStore, Slices, clip};
use crate::solid::exterior::{Padded, invert};
use crate::solid::move_back;
use crate::solid::sign::{Block, SheetWall};

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
    /// The walls, in the order of their cells.
    pub walls: &'a [SheetWall],
    /// How many cells of the grid one of them is wide.
    pub factor: u32,
    /// The level of the pyramid whose cells are looked at: 0 is the grid.
    pub level: u32,
}

/// The sum of a wall's occupied cells, in cells of the grid, and how many there are.
type Sum = ([u64; 3], u64);

/// The planes of walls.
struct Planes<'a> {
    sheets: Sheets<'a>,
    /// What the middle of each wall comes from.
    sums: Vec<Sum>,
    /// How far from the middle of a plane cells lie in it, at the most, in cells of the grid.
    along: f64,
    /// How far from the plane.
    across: f64,
    /// How many cells of the level off a wall may be.
    reach: i64,
    /// Rows of the level within reach, counted from a cell's own, the nearest first.
    rows: Vec<[i64; 2]>,
}

impl Sheets<'_> {
    /// Sets the occupied cells of slice `y` whose middles lie in walls in `bits`, moved by `pad` cells and rows; none where there is no such slice.
    pub fn paint(&self, occupancy: &Occupancy, y: i64, pad: u32, bits: &mut Bits, runs: &mut Runs) -> Result<()> {
        bits.clear();
        if !(0..i64::from(occupancy.cells[1])).contains(&y) {
            return Ok(());
        }
        occupancy.store.read(y as u32, runs)?;
        let wall = |c: u32| (((2 * u64::from(c) + 1) << self.level) / 2 / u64::from(self.factor)) as usize;
        let width = self.block.cells[0];
        for z in 0..runs.row_count() {
            let first = self.block.index([0, wall(y as u32), wall(z)]) as u32;
            let walls = &self.walls[self.within(first, first + width)];
            let is_wall = |x: u32| walls.binary_search_by_key(&(first + wall(x) as u32), |wall| wall.cell).is_ok();
            let cells = runs.row(z).iter().filter(|_| !walls.is_empty()).flat_map(|run| run.start..run.end);
            cells.filter(|x| is_wall(*x)).for_each(|x| bits.set(x + pad, z + pad));
        }
        Ok(())
    }

    /// What becomes solid between the samples of the sheets, of no occupied cells; None where there is no sheet. `side`: that of a cell in sampling distances.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn thickened(&self, side: f64, occupancy: &Occupancy, context: &Context) -> Result<Option<SliceStore>> {
        if self.walls.is_empty() {
            return Ok(None);
        }
        let squared = squared_between(side);
        let balls = balls(squared);
        let planes = self.planes(f64::from(squared).sqrt(), occupancy, context)?;
        let mut thick = SliceStore::new(&context.workspace, context.memory.store_quota);
        let mut jobs = chunks(occupancy.cells[1]);
        context.workers.in_order(
            context.jobs(balls[0].radius() + balls[1].radius() + 2, occupancy.cells),
            || Ok(jobs.next()),
            |slices| planes.thickened(balls, occupancy, slices),
            |slices| thick.extend(&slices),
        )?;
        Ok(Some(thick))
    }

    /// Which walls have a cell from `first` on and before `end`.
    fn within(&self, first: u32, end: u32) -> std::ops::Range<usize> {
        let at = |cell: u32| self.walls.partition_point(|wall| wall.cell < cell);
        at(first)..at(end)
    }

    /// The planes of the walls, for sheets whose gaps a ball of radius `between` spans.
    fn planes(&self, between: f64, occupancy: &Occupancy, context: &Context) -> Result<Planes<'_>> {
        let mut sums: Vec<Sum> = vec![([0; 3], 0); self.walls.len()];
        let mut runs = Runs::default();
        for y in 0..occupancy.cells[1] {
            context.workers.check_cancelled()?;
            occupancy.store.read(y, &mut runs)?;
            for z in 0..runs.row_count() {
                let row = [0, y, z].map(|c| (c / self.factor) as usize);
                let first = self.block.index(row) as u32;
                let walls = self.within(first, first + occupancy.cells[0].div_ceil(self.factor));
                if walls.is_empty() {
                    continue;
                }
                for x in runs.row(z).iter().flat_map(|run| run.start..run.end) {
                    let of_row = &self.walls[walls.clone()];
                    if let Ok(wall) = of_row.binary_search_by_key(&(first + x / self.factor), |wall| wall.cell) {
                        let (sum, count) = &mut sums[walls.start + wall];
                        sum.iter_mut().zip([x, y, z]).for_each(|(sum, c)| *sum += u64::from(c));
                        *count += 1;
                    }
                }
            }
        }
        let factor = f64::from(self.factor);
        let along = between + factor;
        // A wall's middle lies in its cell.
        let reach = (along / factor) as i64 + 1;
        let mut rows: Vec<[i64; 2]> = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |z| [y, z])).collect();
        rows.sort_by_key(|[y, z]| y * y + z * z);
        Ok(Planes { sheets: *self, sums, along, across: (1.0 + factor) / 2.0, reach, rows })
    }
}

/// r₁², where a cell is `side` sampling distances wide.
fn squared_between(side: f64) -> u32 {
    ((BETWEEN / side).powi(2) as u32).clamp(LEAST, MOST)
}

/// The balls of r₁ and r₂.
fn balls(squared: u32) -> [Ball; 2] {
    let thinner = f64::from(squared).sqrt() - THICKER;
    [squared, (thinner * thinner) as u32].map(Ball::squared)
}

impl Planes<'_> {
    /// Whether a cell of the grid lies in the plane of a wall near it.
    fn hold(&self, cell: [i64; 3]) -> bool {
        let Sheets { block, factor, .. } = self.sheets;
        let [x, y, z] = cell.map(|c| c / i64::from(factor));
        let near = |wall: usize| {
            let (sum, count) = self.sums[wall];
            let d: [f64; 3] = [0, 1, 2].map(|a| cell[a] as f64 - sum[a] as f64 / count as f64);
            let dot = |b: [f64; 3]| d[0] * b[0] + d[1] * b[1] + d[2] * b[2];
            dot(d) <= self.along * self.along && dot(self.sheets.walls[wall].normal.map(f64::from)).abs() <= self.across
        };
        self.rows.iter().any(|&[dy, dz]| {
            let [first, end] = [x - self.reach, x + self.reach + 1].map(|x| x.clamp(0, i64::from(block.cells[0])));
            let row = block.at([first, y + dy, z + dz]).map(|first| first as u32);
            row.is_some_and(|row| self.sheets.within(row, row + (end - first) as u32).any(near))
        })
    }

    /// What the sheets fill, in some slices.
    fn thickened(&self, [near, far]: [Ball; 2], occupancy: &Occupancy, slices: std::ops::Range<u32>) -> Result<Slices> {
        // A padding that D leaves free at its border.
        let padded = Padded::new(occupancy.cells, near.radius());
        let Padded { pad, .. } = padded;
        let mut reached = padded.dilation(far, slices.end + pad);
        let mut covered = padded.dilation(near, slices.end + pad + far.radius());
        let [width, _, rows] = occupancy.cells;
        let (mut thick, mut occupied, mut runs) = (Bits::new(width, rows), Bits::new(width, rows), Runs::default());
        let mut out = Slices::default();
        for y in slices.map(i64::from) {
            let reached = reached.slide_to(y + i64::from(pad), |y, free| {
                let paint =
                    |y: i64, bits: &mut Bits| self.sheets.paint(occupancy, y - i64::from(pad), pad, bits, &mut runs);
                let covered = covered.slide_to(y, paint)?;
                for z in 0..padded.cells[2] {
                    let row = free.row_mut(z);
                    row.copy_from_slice(covered.row(z));
                    invert(row, padded.cells[0]);
                }
                Ok(())
            })?;
            occupancy.store.paint(y, &mut occupied, &mut runs)?;
            thick.clear();
            for z in 0..rows {
                let row = thick.row_mut(z);
                move_back(reached.row(z + pad), pad, row);
                row.iter_mut().zip(occupied.row(z)).for_each(|(thick, occupied)| *thick = !(*thick | occupied));
                clip(row, width);
            }
            let closed = Runs::from_bits(&thick);
            for z in 0..rows {
                for x in closed.row(z).iter().flat_map(|run| run.start..run.end) {
                    if !self.hold([i64::from(x), y, i64::from(z)]) {
                        thick.row_mut(z)[x as usize / 64] &= !(1 << (x % 64));
                    }
                }
            }
            out.push(&thick);
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;
    use proptest::test_runner::{RngAlgorithm, TestRng};
    use rand::RngExt;

    use super::*;
    use crate::grid::Cell;
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
            normals in prop::array::uniform5(prop::array::uniform3(-1.0f32..1.0)),
            factor in 1u32..4,
            side in 0.6f64..1.3,
        ) {
            let cells: Cell = [14, 13, 12];
            let block = Block::new(cells.map(|c| c.div_ceil(factor)));
            let wall = |cell: [i64; 3]| block.index(cell.map(|c| (c / i64::from(factor)) as usize)) as u32;
            let occupied: BTreeSet<[i64; 3]> = samples.iter().map(|(x, y, z, _)| [*x, *y, *z].map(i64::from)).collect();
            let in_walls: BTreeSet<u32> =
                samples.iter().filter(|s| s.3).map(|(x, y, z, _)| wall([*x, *y, *z].map(i64::from))).collect();
            let walls: Vec<SheetWall> =
                in_walls.iter().map(|&cell| SheetWall { cell, normal: normals[cell as usize % 5] }).collect();
            let sheet: Vec<[i64; 3]> = occupied.iter().copied().filter(|cell| in_walls.contains(&wall(*cell))).collect();
            let all: Vec<[i64; 3]> = (0..13i64)
                .flat_map(|y| (0..12i64).flat_map(move |z| (0..14i64).map(move |x| [x, y, z])))
                .collect();
            let found: Vec<[i64; 3]> = with_context(cells, |context| {
                let of = |cells: Vec<[i64; 3]>| {
                    Occupancy::of_cells(cells.into_iter().map(|cell| cell.map(|c| c as u32)), [14, 13, 12], context).unwrap()
                };
                let sheets = Sheets { block: &block, walls: &walls, factor, level: 0 };
                let thick = sheets.thickened(side, &of(occupied.iter().copied().collect()), context).unwrap();
                let (mut bits, mut runs) = (Bits::new(14, 12), Runs::default());
                all.iter().copied().filter(|[x, y, z]| {
                    thick.as_ref().is_some_and(|thick| {
                        thick.paint(*y, &mut bits, &mut runs).unwrap();
                        bits.get(*x, *z)
                    })
                }).collect()
            });
            let squared = ((2.7 / side) * (2.7 / side)).floor().max(6.0);
            let thinner = ((squared.sqrt() - 0.7) * (squared.sqrt() - 0.7)).floor();
            let thick = twin(&sheet, [squared as u32, thinner as u32], &all);
            let far = f64::from(factor);
            let is_in_plane = |cell: &[i64; 3]| walls.iter().any(|of| {
                let own: Vec<&[i64; 3]> = sheet.iter().filter(|cell| wall(**cell) == of.cell).collect();
                let from_mean = |a: usize| {
                    cell[a] as f64 - own.iter().map(|cell| cell[a]).sum::<i64>() as f64 / own.len() as f64
                };
                let d = [0, 1, 2].map(from_mean);
                let dot = |b: [f64; 3]| d[0] * b[0] + d[1] * b[1] + d[2] * b[2];
                dot(d) <= (squared.sqrt() + far).powi(2) && 2.0 * dot(of.normal.map(f64::from)).abs() <= 1.0 + far
            });
            let expected: Vec<[i64; 3]> = all
                .iter()
                .copied()
                .filter(|cell| !occupied.contains(cell) && thick.contains(cell) && is_in_plane(cell))
                .collect();
            prop_assert_eq!(found, expected);
        }

        /// On a level of the pyramid an occupied cell belongs to the wall that its middle lies in.
        #[test]
        fn cells_of_walls_are_those_whose_middles_lie_in_them(
            cells in prop::collection::btree_set((0u32..9, 0u32..8, 0u32..7), 1..60),
            in_walls in prop::collection::vec(any::<bool>(), 64),
            level in 0u32..3,
            factor in 1u32..8,
        ) {
            let size: Cell = [9, 8, 7];
            let block = Block::new(size.map(|c| (c << level).div_ceil(factor)));
            // A wall by its cell, at random.
            let is_wall = |[x, y, z]: [usize; 3]| in_walls[(7 * x + 3 * y + 5 * z) % 64];
            let all = (0..block.size()).filter(|index| block.index(block.cell(*index)) == *index);
            let walls: Vec<SheetWall> = all
                .filter(|index| is_wall(block.cell(*index)))
                .map(|index| SheetWall { cell: index as u32, normal: [1.0, 0.0, 0.0] })
                .collect();
            let sheets = Sheets { block: &block, walls: &walls, factor, level };
            let expected: BTreeSet<Cell> = cells.iter().map(|(x, y, z)| [*x, *y, *z]).filter(|cell| {
                let middle = cell.map(|c| (f64::from(c) + 0.5) * f64::from(1 << level) / f64::from(factor));
                is_wall(middle.map(|c| c.floor() as usize))
            }).collect();
            let found: BTreeSet<Cell> = with_context(size, |context| {
                let occupied = cells.iter().map(|(x, y, z)| [*x, *y, *z]);
                let occupancy = Occupancy::of_cells(occupied, size, context).unwrap();
                let (mut bits, mut runs, mut out) = (Bits::new(11, 9), Runs::default(), BTreeSet::new());
                for y in 0..8 {
                    sheets.paint(&occupancy, y, 1, &mut bits, &mut runs).unwrap();
                    let cells = (0..9).flat_map(|x| (0..7).map(move |z| [x, y, z]));
                    out.extend(cells.filter(|[x, _, z]| bits.get(x + 1, z + 1)).map(|cell| cell.map(|c| c as u32)));
                }
                out
            });
            prop_assert_eq!(found, expected);
        }

        /// Two sheets side by side, at any angle: what is thick lies in one of them or in the other.
        #[test]
        fn the_air_between_two_sheets_stays(
            seed in any::<u64>(),
            between in 3.5f64..8.0,
            missing in 0.0f64..0.4,
            normal in prop::array::uniform3(-1.0f64..1.0),
        ) {
            let length = normal.iter().map(|c| c * c).sum::<f64>().sqrt();
            prop_assume!(length > 0.1);
            let normal = normal.map(|c| c / length);
            let cells: Cell = [24; 3];
            let block = Block::new(cells);
            let all = || (0..24 * 24 * 24u32).map(|i| [i % 24, i / 576, i / 24 % 24]);
            let height = |cell: Cell| (0..3).map(|a| normal[a] * (f64::from(cell[a]) - 11.5)).sum::<f64>();
            let to_sheet = |cell: Cell| (height(cell).abs() - between / 2.0).abs();
            let mut numbers = TestRng::from_seed(RngAlgorithm::ChaCha, &[seed.to_le_bytes(); 4].concat());
            let sheet: Vec<Cell> =
                all().filter(|cell| to_sheet(*cell) <= 0.5).filter(|_| numbers.random_range(0.0..1.0) >= missing).collect();
            let mut walls: Vec<SheetWall> = sheet
                .iter()
                .map(|cell| SheetWall { cell: block.index(cell.map(|c| c as usize)) as u32, normal: normal.map(|c| c as f32) })
                .collect();
            walls.sort_by_key(|wall| wall.cell);
            with_context(cells, |context| {
                let occupancy = Occupancy::of_cells(sheet.iter().copied(), cells, context).unwrap();
                let sheets = Sheets { block: &block, walls: &walls, factor: 1, level: 0 };
                let thick = sheets.thickened(1.0, &occupancy, context).unwrap().unwrap();
                let (mut bits, mut runs) = (Bits::new(24, 24), Runs::default());
                let mut filled = 0;
                for cell in all() {
                    thick.paint(i64::from(cell[1]), &mut bits, &mut runs).unwrap();
                    let is_thick = bits.get(i64::from(cell[0]), i64::from(cell[2]));
                    assert!(!is_thick || to_sheet(cell) <= 1.5, "{cell:?} is {} off", to_sheet(cell));
                    filled += u64::from(is_thick);
                }
                assert!(filled > 0, "nothing is filled");
            });
        }
    }
}
