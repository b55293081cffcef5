//! Parts of the solid and of what is not solid. *Cavities* are what is shut off within the solid. Two kinds are filled.
//!
//! Specks are no larger than what is left out as a speck of the solid:
//!
//! ```text
//!   # # # # # # #        . outside, # solid, o a speck of the outside: a stray in the body leaves one, or a few samples that lie
//!   # # o # # # # .      astray of their wall. Nothing tells it from noise, and the surface would have a piece more, inside.
//!   # # # # # # #
//! ```
//!
//! Bare cavities have any size, and hardly a point lines them:
//!
//! ```text
//!   # # # # # # # # #    # occupied, + solid though no point lies there, o a bare cavity. Where a wedge is narrower than the field's
//!     # # + + o o + +    cells, it is filled. Here and there in it, the field gives cells no side, and a ball finds the outside beyond
//!         # # # o + +    the lower wall. A void of the body is lined by #.
//!             # # # #
//! ```

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::grid::context::{Context, chunks};
use crate::grid::label::{Components, Labeller, Measure, Parts};
use crate::grid::occupancy::Occupancy;
use crate::grid::slice::{Run, Runs, SliceStore};
use crate::settings::closing::Least;
use crate::solid::Solid;
use crate::solid::component::FEW;
use crate::solid::dents::{LinedSlices, Lining};

/// A run of cells, or all that hangs together with it.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(C)]
struct Part {
    cells: u64,
    /// How many of its runs lie at the end of the grid.
    at_end: u64,
}

impl Part {
    /// Whether what is not solid is shut off.
    fn is_cavity(&self) -> bool {
        self.at_end == 0
    }
}

impl Measure for Part {
    fn add(&mut self, other: &Part) {
        self.cells += other.cells;
        self.at_end += other.at_end;
    }
}

/// The same of what is not solid, with what lines it.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(C)]
struct LinedPart {
    part: Part,
    lining: Lining,
}

impl Measure for LinedPart {
    fn add(&mut self, other: &LinedPart) {
        self.part.add(&other.part);
        self.lining.add(&other.lining);
    }
}

impl Solid {
    /// The solid with those cavities filled that hardly any point lines, as [`Solid::without_dents`] has it, with the same `thick`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn without_bare_cavities(
        self,
        thick: Option<&SliceStore>,
        occupancy: &Occupancy,
        context: &Context,
    ) -> Result<Solid> {
        let mut any = false;
        self.parts(false, context)?.for_each(|part| any |= part.is_cavity())?;
        // Most solids have none, and what lines their outside would be counted for nothing.
        if !any {
            return Ok(self);
        }
        let mut labeller = Labeller::new(context);
        let mut jobs = chunks(self.cells[1]);
        context.workers.in_order(
            context.jobs(3, self.cells),
            || Ok(jobs.next()),
            |chunk| {
                let mut around = LinedSlices::of(&self, thick, occupancy);
                let (mut slices, mut parts) = (Vec::with_capacity(chunk.len()), Vec::new());
                for y in chunk {
                    around.slide_to(y.into())?;
                    let free = self.free(y)?;
                    for z in 0..free.row_count() {
                        let lined = |run: &Run| LinedPart {
                            part: self.part(y, z, *run),
                            lining: around.lining(y.into(), z, *run),
                        };
                        parts.extend(free.row(z).iter().map(lined));
                    }
                    slices.push(free);
                }
                let mut parts = parts.into_iter();
                Ok(Parts::of(slices, |_, _, _| parts.next().expect("every run is a part")))
            },
            |parts: Parts<LinedPart>| labeller.add(parts),
        )?;
        let is_bare = |lined: &LinedPart| lined.part.is_cavity() && lined.lining.is_bare();
        self.filled_where(labeller.finish()?, is_bare, context)
    }

    /// The solid with those cavities filled that have fewer cells than a component must have to be no speck, `least` and [`Least::Auto`] alike; but none, if all of these
    /// together are no few.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn without_specks_of_outside(self, least: Least, context: &Context) -> Result<Solid> {
        let limit = least.cells(self.volume).min(Least::Auto.cells(self.volume));
        let labelled = self.parts(false, context)?;
        let is_speck = |part: &Part| part.is_cavity() && part.cells < limit;
        let mut specks = 0;
        labelled.for_each(|part| specks += if is_speck(part) { part.cells } else { 0 })?;
        if specks == 0 || FEW * specks >= self.volume {
            return Ok(self);
        }
        self.filled_where(labelled, is_speck, context)
    }

    /// The pieces of the surface: those of the solid, and cavities of at least so many cells.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn pieces(&self, least: u64, context: &Context) -> Result<u64> {
        let mut count = 0;
        self.parts(true, context)?.for_each(|_| count += 1)?;
        self.parts(false, context)?.for_each(|part| count += u64::from(part.is_cavity() && part.cells >= least))?;
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
                let read = |y| if solid { self.runs(y) } else { self.free(y) };
                let slices = chunk.map(read).collect::<Result<Vec<Runs>>>()?;
                Ok(Parts::of(slices, |slice, z, run| self.part(first + slice as u32, z, run)))
            },
            |parts: Parts<Part>| labeller.add(parts),
        )?;
        labeller.finish()
    }

    /// The runs of slice `y`.
    fn runs(&self, y: u32) -> Result<Runs> {
        let mut runs = Runs::default();
        self.store.read(y, &mut runs)?;
        Ok(runs)
    }

    /// The runs of cells of slice `y` that are not solid.
    fn free(&self, y: u32) -> Result<Runs> {
        Ok(between(&self.runs(y)?, self.cells[0]))
    }

    /// A run of row `z` of slice `y`.
    fn part(&self, y: u32, z: u32, Run { start, end }: Run) -> Part {
        let [width, slices, rows] = self.cells;
        let at_end = start == 0 || end == width || y == 0 || y + 1 == slices || z == 0 || z + 1 == rows;
        Part { cells: u64::from(end - start), at_end: at_end.into() }
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

    /// A solid of some cells of the box.
    fn solid_of(cells: impl Iterator<Item = Cell>, context: &Context) -> Solid {
        let Occupancy { store, occupied, .. } = Occupancy::of_cells(cells, CELLS, context).unwrap();
        Solid { cells: CELLS, store, volume: occupied, faces: vec![0; CELLS[1] as usize], ground: None }
    }

    /// Its cells.
    fn cells_of(solid: &Solid) -> BTreeSet<Cell> {
        let mut found = BTreeSet::new();
        for y in 0..CELLS[1] {
            let runs = solid.runs(y).unwrap();
            for z in 0..CELLS[2] {
                found.extend(runs.row(z).iter().flat_map(|run| (run.start..run.end).map(move |x| [x, y, z])));
            }
        }
        assert_eq!(found.len() as u64, solid.volume);
        found
    }

    /// Blocks of holes, which meet here and there.
    fn blocks(seeds: Vec<([u32; 3], [u32; 3])>) -> BTreeSet<Cell> {
        let held = |cell: &Cell, (low, size): &([u32; 3], [u32; 3])| {
            (0..3).all(|a| (low[a]..low[a] + size[a]).contains(&cell[a]))
        };
        all().filter(|cell| seeds.iter().any(|block| held(cell, block))).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn cavities_that_no_point_lines_are_filled_and_nothing_else(
            seeds in prop::collection::vec(((1u32..14, 1u32..69, 1u32..13).prop_map(<[u32; 3]>::from), prop::array::uniform3(1u32..6)), 1..40),
            shares in prop::collection::vec((0.0f64..0.6, 0.0f64..0.6), 7),
            draws in prop::collection::vec(0.0f64..1.0, 97),
        ) {
            let holes = blocks(seeds);
            // The shares of occupied and of thickened cells differ from one part of the box to the next.
            let draw = |[x, y, z]: &Cell| draws[(7 * x + 31 * y + 5 * z) as usize % 97];
            let of = |cell: &Cell| shares[cell[1] as usize / 10];
            let marked = |from: &dyn Fn(&Cell) -> [f64; 2]| -> BTreeSet<Cell> {
                all().filter(|cell| !holes.contains(cell) && draw(cell) >= from(cell)[0] && draw(cell) < from(cell)[1]).collect()
            };
            let occupied = marked(&|cell| [0.0, of(cell).0]);
            let thick = if shares[0].0 < 0.5 { marked(&|cell| [of(cell).0, of(cell).0 + of(cell).1]) } else { BTreeSet::new() };
            let mut expected: BTreeSet<Cell> = all().filter(|cell| !holes.contains(cell)).collect();
            for cavity in parts(&holes).into_iter().filter(|part| !at_end(part)) {
                let beside = cavity.iter().flat_map(|cell| {
                    (0..6).map(move |side| {
                        let mut next = *cell;
                        next[side / 2] = next[side / 2].wrapping_add_signed(if side % 2 == 0 { 1 } else { -1 });
                        next
                    })
                });
                let (mut sampled, mut bare) = (0, 0);
                for cell in beside.filter(|cell| !holes.contains(cell)) {
                    sampled += u32::from(occupied.contains(&cell));
                    bare += u32::from(!occupied.contains(&cell) && !thick.contains(&cell));
                }
                if 5 * sampled < 2 * bare {
                    expected.extend(cavity);
                }
            }
            let found = with_context(CELLS, |context| {
                let solid = solid_of(all().filter(|cell| !holes.contains(cell)), context);
                let occupancy = Occupancy::of_cells(occupied.iter().copied(), CELLS, context).unwrap();
                let thick = (!thick.is_empty()).then(|| Occupancy::of_cells(thick.iter().copied(), CELLS, context).unwrap().store);
                cells_of(&solid.without_bare_cavities(thick.as_ref(), &occupancy, context).unwrap())
            });
            prop_assert_eq!(found, expected);
        }

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
                let solid = solid_of(all().filter(|cell| !holes.contains(cell)), context);
                let pieces = solid.pieces(4, context).unwrap();
                (pieces, cells_of(&solid.without_specks_of_outside(least, context).unwrap()))
            });
            let cavities = parts(&holes).into_iter().filter(|part| part.len() >= 4 && !at_end(part)).count();
            prop_assert_eq!(pieces as usize, parts(&all().filter(|cell| !holes.contains(cell)).collect()).len() + cavities);
            prop_assert_eq!(found, expected(&holes, cells));
        }
    }
}
