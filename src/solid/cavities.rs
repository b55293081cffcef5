//! Parts of the solid and of what is not solid. Cavities that are specks are filled: what is shut off within the solid, and no larger than what is left out as a speck.
//!
//! ```text
//!   # # # # # # #        . outside, # solid, o a speck of the outside: a stray in the body leaves one, or a few samples that lie
//!   # # o # # # # .      astray of their wall. Nothing tells it from noise, and the surface would have a piece more, inside.
//!   # # # # # # #
//! ```

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::grid::context::{Context, chunks};
use crate::grid::label::{Components, Labeller, Measure, Parts};
use crate::grid::slice::{Run, Runs};
use crate::settings::closing::Least;
use crate::solid::Solid;
use crate::solid::change::Change;
use crate::solid::component::FEW;

/// The verdicts.
const OPEN: u8 = 0;
const FILLED: u8 = 1;

/// A run of cells, or all that hangs together with it.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(C)]
struct Part {
    cells: u64,
    /// How many of its runs lie at the end of the grid.
    at_end: u64,
}

impl Measure for Part {
    fn add(&mut self, other: &Part) {
        self.cells += other.cells;
        self.at_end += other.at_end;
    }
}

impl Solid {
    /// The solid with those cavities filled that have fewer cells than a component must have to be no speck, `least` and [`Least::Auto`] alike; but none, if all of these
    /// together are no few.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn without_specks_of_outside(self, least: Least, context: &Context) -> Result<Solid> {
        let limit = least.cells(self.volume).min(Least::Auto.cells(self.volume));
        let labelled = self.parts(false, context)?;
        let is_speck = |part: &Part| part.at_end == 0 && part.cells < limit;
        let mut specks = 0;
        labelled.for_each(|part| specks += if is_speck(part) { part.cells } else { 0 })?;
        if specks == 0 || FEW * specks >= self.volume {
            return Ok(self);
        }
        let labels = labelled.judged(context, |part| if is_speck(part) { FILLED } else { OPEN })?;
        self.changed(&labels, FILLED, Change::Filled, context)
    }

    /// The pieces of the surface: those of the solid, and cavities of at least so many cells.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn pieces(&self, least: u64, context: &Context) -> Result<u64> {
        let mut count = 0;
        self.parts(true, context)?.for_each(|_| count += 1)?;
        self.parts(false, context)?.for_each(|part| count += u64::from(part.at_end == 0 && part.cells >= least))?;
        Ok(count)
    }

    /// The parts, joined by faces, of the solid, or of what is not solid.
    fn parts(&self, solid: bool, context: &Context) -> Result<Components<Part>> {
        let mut labeller = Labeller::new(context);
        let mut jobs = chunks(self.cells[1]);
        context.workers.in_order(
            context.memory.chunks_in_flight,
            || Ok(jobs.next()),
            |chunk| {
                let first = chunk.start;
                let read = |y| {
                    let mut runs = Runs::default();
                    self.store.read(y, &mut runs)?;
                    Ok(if solid { runs } else { between(&runs, self.cells[0]) })
                };
                let slices = chunk.map(read).collect::<Result<Vec<Runs>>>()?;
                let [width, count, rows] = self.cells;
                Ok(Parts::of(slices, |slice, z, Run { start, end }| {
                    let y = first + slice as u32;
                    let at_end = start == 0 || end == width || y == 0 || y + 1 == count || z == 0 || z + 1 == rows;
                    Part { cells: u64::from(end - start), at_end: at_end.into() }
                }))
            },
            |parts: Parts<Part>| labeller.add(parts),
        )?;
        labeller.finish()
    }
}

/// The runs between a slice's runs, in rows of so many cells.
fn between(runs: &Runs, width: u32) -> Runs {
    let mut out = Runs::default();
    for z in 0..runs.row_count() {
        let mut from = 0;
        for run in runs.row(z) {
            if from < run.start {
                out.push_run(from, run.start);
            }
            from = run.end;
        }
        if from < width {
            out.push_run(from, width);
        }
        out.end_row();
    }
    out
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeSet, HashSet};

    use proptest::prelude::*;

    use super::*;
    use crate::grid::Cell;
    use crate::grid::occupancy::Occupancy;
    use crate::run::testing::with_context;

    const CELLS: Cell = [15, 70, 14];

    fn all() -> impl Iterator<Item = Cell> {
        let [width, slices, rows] = CELLS;
        (0..slices).flat_map(move |y| (0..rows).flat_map(move |z| (0..width).map(move |x| [x, y, z])))
    }

    /// The cells that faces join.
    fn parts(cells: &BTreeSet<Cell>) -> Vec<Vec<Cell>> {
        let (mut seen, mut parts) = (HashSet::new(), Vec::new());
        for &first in cells {
            if !seen.insert(first) {
                continue;
            }
            let (mut found, mut stack) = (vec![], vec![first]);
            while let Some(cell) = stack.pop() {
                found.push(cell);
                for (a, step) in [(0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)] {
                    let mut next = cell;
                    next[a] = next[a].wrapping_add_signed(step);
                    if cells.contains(&next) && seen.insert(next) {
                        stack.push(next);
                    }
                }
            }
            parts.push(found);
        }
        parts
    }

    fn at_end(part: &[Cell]) -> bool {
        part.iter().any(|cell| (0..3).any(|a| cell[a] == 0 || cell[a] + 1 == CELLS[a]))
    }

    /// The solid as the rule says, from its holes: without those cavities that are specks, unless these are many.
    fn expected(holes: &BTreeSet<Cell>, least: u64) -> BTreeSet<Cell> {
        let volume = (CELLS.iter().product::<u32>() as usize - holes.len()) as u64;
        let limit = least.min(64).min(volume.div_ceil(1000));
        let mut specks = BTreeSet::new();
        for found in parts(holes) {
            if !at_end(&found) && (found.len() as u64) < limit {
                specks.extend(found);
            }
        }
        let few = 50 * (specks.len() as u64) < volume;
        all().filter(|cell| !holes.contains(cell) || few && specks.contains(cell)).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn specks_of_the_outside_are_filled_and_nothing_else(
            seeds in prop::collection::vec((0u32..15, 0u32..70, 0u32..14, 0usize..3, 1u32..9), 1..150),
            least in prop_oneof![Just(Least::Auto), (1u64..12).prop_map(Least::Cells), Just(Least::Largest)],
        ) {
            // Rods of holes, which meet here and there.
            let rod = |(x, y, z, axis, length): (u32, u32, u32, usize, u32)| {
                (0..length).map(move |i| {
                    let mut cell = [x, y, z];
                    cell[axis] += i;
                    cell
                })
            };
            let inside = |cell: &Cell| (0..3).all(|a| cell[a] < CELLS[a]);
            let holes: BTreeSet<Cell> = seeds.into_iter().flat_map(rod).filter(inside).collect();
            let cells = match least {
                Least::Cells(cells) => cells,
                _ => u64::MAX,
            };
            let (pieces, found): (u64, BTreeSet<Cell>) = with_context(CELLS, |context| {
                let solid = all().filter(|cell| !holes.contains(cell));
                let Occupancy { store, occupied, .. } = Occupancy::of_cells(solid, CELLS, context).unwrap();
                let solid = Solid { cells: CELLS, store, volume: occupied, faces: vec![0; 70], ground: None };
                let pieces = solid.pieces(4, context).unwrap();
                let filled = solid.without_specks_of_outside(least, context).unwrap();
                let mut runs = Runs::default();
                let mut found = BTreeSet::new();
                for y in 0..CELLS[1] {
                    filled.store.read(y, &mut runs).unwrap();
                    for z in 0..CELLS[2] {
                        found.extend(runs.row(z).iter().flat_map(|run| (run.start..run.end).map(move |x| [x, y, z])));
                    }
                }
                assert_eq!(found.len() as u64, filled.volume);
                (pieces, found)
            });
            let cavities = parts(&holes).into_iter().filter(|part| part.len() >= 4 && !at_end(part)).count();
            prop_assert_eq!(pieces as usize, parts(&all().filter(|cell| !holes.contains(cell)).collect()).len() + cavities);
            prop_assert_eq!(found, expected(&holes, cells));
        }
    }
}
