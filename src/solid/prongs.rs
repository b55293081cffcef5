//! Prongs: where the shell of points is thick, cells that stand off the solid, as a few points stray farther from the surface than the others.
//!
//! ```text
//!         # #               A cell with at most 9 solid ones among the 26 round it goes, as far as that changes no topology.
//!         #                 On a flat face, a lone cell has 9; a cell of the face 17, of an edge 11.
//!   # # # # # # # #
//! ```
//!
//! Vertices on all sides of a prong would move onto one place of the surface, where their triangles overlap.

use std::ops::Range;

use crate::error::Result;
use crate::grid::context::Context;
use crate::grid::slice::{Bits, Runs, SliceStore, Slices};
use crate::grid::window::Window;
use crate::solid::Solid;
use crate::solid::change::Change;

/// A cell of a prong has so many solid ones among the 26 round it, at the most.
const ROUND: usize = 9;

/// Twice, as what bears a prong may be one when that is gone.
const TIMES: u32 = 2;

impl Solid {
    /// The solid without prongs.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn without_prongs(self, context: &Context) -> Result<Solid> {
        let mut solid = self;
        for _ in 0..TIMES {
            let prongs = solid.prongs(context)?;
            let gone = solid.growth(context.no_cells(), &prongs, Change::Removed, context)?;
            if gone.is_empty() {
                break;
            }
            solid = solid.without(&gone, context)?;
        }
        Ok(solid)
    }

    /// The cells of prongs.
    fn prongs(&self, context: &Context) -> Result<SliceStore> {
        context.slices_of(self.cells[1], context.jobs(1, self.cells), |chunk, slices| self.prongs_of(chunk, slices))
    }

    fn prongs_of(&self, chunk: Range<u32>, found: &mut Slices) -> Result<()> {
        let [width, slices, rows] = self.cells;
        let mut window = Window::new(3, || Bits::new(width, rows));
        let (mut runs, mut here) = (Runs::default(), Runs::default());
        for y in chunk {
            window.slide_to(i64::from(y) - 1, |y, bits: &mut Bits| {
                bits.clear();
                if (0..i64::from(slices)).contains(&y) { self.store.paint(y, bits, &mut runs) } else { Ok(()) }
            })?;
            let around = [-1, 0, 1].map(|d| window.get(i64::from(y) + d));
            self.store.read(y, &mut here)?;
            let mut prongs = Runs::default();
            for z in 0..rows {
                for run in here.row(z) {
                    let is_prong = |x: u32| {
                        let near = |a: u32, d: i64| i64::from(a) + d;
                        let round = around
                            .iter()
                            .flat_map(|slice| (0..9).map(move |i| (slice, near(x, i % 3 - 1), near(z, i / 3 - 1))));
                        round.filter(|(slice, x, z)| slice.get(*x, *z)).take(ROUND + 2).count() <= ROUND + 1
                    };
                    (run.start..run.end).filter(|x| is_prong(*x)).for_each(|x| prongs.push_run(x, x + 1));
                }
                prongs.end_row();
            }
            found.push_runs(&prongs);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::grid::Cell;
    use crate::run::testing::with_context;
    use crate::solid::growth::ROUNDS;
    use crate::solid::reopen::marks::{Marks, add, cube, euler, simple};
    use crate::solid::sign::tests::Numbers;

    /// What [`Solid::without_prongs`] leaves.
    fn left(marks: &Marks) -> Marks {
        let cells = marks.cells.map(|c| c as u32);
        with_context(cells, |context| {
            let (store, faces) = (marks.store(context), vec![1000; cells[1] as usize]);
            let solid = Solid { cells, store, volume: 0, faces, ground: None };
            Marks::of_solid(&solid.without_prongs(context).unwrap())
        })
    }

    fn naive(marks: &Marks) -> Marks {
        let mut left = marks.clone();
        for _ in 0..2 {
            let before = left.clone();
            let solid = |cell| cube(1).into_iter().filter(|d| *d != [0; 3] && before.at(add(cell, *d))).count();
            for (_, subgrid) in (0..ROUNDS).flat_map(|round| (0..8).map(move |subgrid| (round, subgrid))) {
                for cell in before.all().filter(|cell| before.at(*cell) && solid(*cell) <= 9) {
                    let is_its_turn = (cell[0] & 1) + 2 * (cell[2] & 1) + 4 * (cell[1] & 1) == subgrid;
                    if is_its_turn && left.at(cell) && simple(|d| !left.at(add(cell, d))) {
                        left.put(cell, false);
                    }
                }
            }
        }
        left
    }

    /// A block with towers of some cells on it and pits in it, one or two cells wide, and cells at random.
    fn block(seed: u64, share: f64) -> Marks {
        let mut numbers = Numbers::new(seed);
        let cells: Cell = [22, 37, 19];
        let mut marks = Marks::of(cells, |cell| cell.iter().zip(cells).all(|(c, n)| (4..i64::from(n) - 4).contains(c)));
        for cell in marks.all().collect::<Vec<_>>() {
            let near = cube(1).into_iter().any(|d| marks.at(add(cell, d)) != marks.at(cell));
            if near && numbers.part() < share {
                marks.put(cell, !marks.at(cell));
            }
        }
        marks
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]

        #[test]
        fn prongs_are_those_of_the_definition_and_topology_stays(seed in any::<u64>(), share in 0.0f64..0.4) {
            let marks = block(seed, share);
            let (found, expected) = (left(&marks), naive(&marks));
            prop_assert!(found.set == expected.set);
            prop_assert_eq!(found.groups().len(), marks.groups().len());
            let number = |of: &Marks| euler(of.all(), |cell| of.at(cell));
            prop_assert_eq!(number(&found), number(&marks));
        }
    }

    /// A tower goes, and the faces that it stands on stay.
    #[test]
    fn a_tower_goes() {
        let cells: Cell = [12, 20, 12];
        let block = |[x, y, z]: [i64; 3]| (2..9).contains(&x) && (2..12).contains(&y) && (2..9).contains(&z);
        for high in 1..6 {
            let tower = |cell: [i64; 3]| cell[0] == 5 && cell[2] == 6 && (12..12 + high).contains(&cell[1]);
            let found = left(&Marks::of(cells, |cell| block(cell) || tower(cell)));
            assert!(found.all().all(|cell| !tower(cell) || !found.at(cell)), "{high}");
            // Corners go, as no more than 7 are round them.
            let gone = found.all().filter(|cell| block(*cell) && !found.at(*cell)).count();
            assert!(gone <= 8, "{gone}");
        }
    }
}
