//! Dents: where the ball fell too far between sparse points, the dent it left is filled.
//!
//! The steps of the fall are the same everywhere. Where points lie farther apart than the last balls are wide, these sink between them:
//!
//! ```text
//!   . o o o o o . . . .       # occupied, + solid though no point lies there, o covered by a ball outside
//!   # . o o o . # . . #       The dent on the left, which no larger ball reaches (.), is lined by + mostly: it is a gap between points.
//!   + + . . . + + # # +       A concavity of the object is lined by #, the points that were sampled there.
//!   + + + + + + + + + +
//! ```
//!
//! So the local spacing need not be measured: a dent's own lining tells whether it was sampled.

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::grid::context::{Context, chunks};
use crate::grid::dilate::Ball;
use crate::grid::label::{Labeller, Measure, Parts};
use crate::grid::occupancy::Occupancy;
use crate::grid::slice::{Bits, Run, Runs, SliceStore, clip, words_of};
use crate::grid::window::Window;
use crate::solid::exterior::{Padded, invert};
use crate::solid::{Solid, move_back};

/// Squared radius of the ball that does not reach a dent. With 4 to 9, dents stay between points of a half thinned to a tenth; with 25, the bunny's mean
/// squared error at k = 4 is an eighth larger.
const REACHES: u32 = 16;

impl Solid {
    /// The same solid with those dents filled that hardly any point lines. `thick` are those of its cells that sheets were thickened by
    /// ([`crate::solid::thicken`]): they have no points, and yet no ball sank there, so they tell nothing.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn without_dents(self, thick: Option<&SliceStore>, occupancy: &Occupancy, context: &Context) -> Result<Solid> {
        let ball = Ball::squared(REACHES);
        let mut labeller = Labeller::new(context);
        let mut jobs = chunks(self.cells[1]);
        context.workers.in_order(
            context.jobs(2 * ball.radius() + 5, self.cells),
            || Ok(jobs.next()),
            |slices| self.dents(thick, occupancy, ball, slices),
            |parts: Parts<Lining>| labeller.add(parts),
        )?;
        self.filled_where(labeller.finish()?, Lining::is_bare, context)
    }

    /// The dents of some slices, as far as they hang together there, with the lining of each.
    fn dents(
        &self,
        thick: Option<&SliceStore>,
        occupancy: &Occupancy,
        ball: Ball,
        slices: std::ops::Range<u32>,
    ) -> Result<Parts<Lining>> {
        let padded = Padded::new(self.cells, ball.radius());
        let Padded { pad, .. } = padded;
        let [width, _, rows] = self.cells;
        let mut near_solid = padded.dilation(ball, slices.end + pad + ball.radius());
        let mut covered = padded.dilation(ball, slices.end + pad);
        let mut around = LinedSlices::of(self, thick, occupancy);
        let [mut solid, mut dent] = [(); 2].map(|()| Bits::new(width, rows));
        let mut runs = Runs::default();
        let (mut held, mut linings) = (Vec::with_capacity(slices.len()), Vec::new());
        for y in slices.map(i64::from) {
            let covered = covered.slide_to(y + i64::from(pad), |y, room| {
                let paint = |y, bits: &mut Bits| self.store.paint_moved(y - i64::from(pad), pad, bits, &mut runs);
                let near_solid = near_solid.slide_to(y, paint)?;
                for z in 0..padded.cells[2] {
                    let row = room.row_mut(z);
                    row.copy_from_slice(near_solid.row(z));
                    invert(row, padded.cells[0]);
                }
                Ok(())
            })?;
            around.slide_to(y)?;
            self.store.paint(y, &mut solid, &mut runs)?;
            dent.clear();
            for z in 0..rows {
                let row = dent.row_mut(z);
                move_back(covered.row(z + pad), pad, row);
                row.iter_mut().zip(solid.row(z)).for_each(|(covered, solid)| *covered = !(*covered | solid));
                clip(row, width);
            }
            let dent = Runs::from_bits(&dent);
            for z in 0..rows {
                linings.extend(dent.row(z).iter().map(|run| around.lining(y, z, *run)));
            }
            held.push(dent);
        }
        let mut linings = linings.into_iter();
        Ok(Parts::of(held, |_, _, _| linings.next().expect("every run has its lining")))
    }
}

/// The slices that line what is not solid, a few at a time.
pub(super) struct LinedSlices<'a> {
    solid: &'a SliceStore,
    thick: Option<&'a SliceStore>,
    occupied: &'a SliceStore,
    /// The solid cells that tell, and the occupied ones.
    around: [Window<Bits>; 2],
    thickened: Bits,
    runs: Runs,
}

impl LinedSlices<'_> {
    /// Those of a solid; the cells that sheets were thickened by tell nothing.
    pub(super) fn of<'a>(solid: &'a Solid, thick: Option<&'a SliceStore>, occupancy: &'a Occupancy) -> LinedSlices<'a> {
        let [width, _, rows] = solid.cells;
        let around = [(); 2].map(|()| Window::new(3, || Bits::new(width, rows)));
        let thickened = Bits::new(width, rows);
        LinedSlices { solid: &solid.store, thick, occupied: &occupancy.store, around, thickened, runs: Runs::default() }
    }

    /// Goes on to slice `y`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub(super) fn slide_to(&mut self, y: i64) -> Result<()> {
        let LinedSlices { solid, thick, occupied, around: [telling, samples], thickened, runs } = self;
        telling.slide_to(y - 1, |y, bits| {
            solid.paint(y, bits, runs)?;
            if let Some(thick) = thick {
                thick.paint(y, thickened, runs)?;
                bits.and_not(thickened);
            }
            Ok(())
        })?;
        samples.slide_to(y - 1, |y, bits| occupied.paint(y, bits, runs))
    }

    /// The lining of a run of row `z` of slice `y`.
    pub(super) fn lining(&self, y: i64, z: u32, run: Run) -> Lining {
        Lining::of(&self.around, y, z, run)
    }
}

/// What a dent's faces turn to, as far as it tells whether the dent was sampled.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Zeroable, Pod)]
#[repr(C)]
pub struct Lining {
    /// Faces to occupied cells.
    sampled: u64,
    /// Faces to other solid cells that tell: those that sheets were thickened by do not.
    bare: u64,
}

impl Measure for Lining {
    fn add(&mut self, other: &Lining) {
        self.sampled += other.sampled;
        self.bare += other.bare;
    }
}

impl Lining {
    /// A lining of so many faces to occupied cells, and to other solid ones.
    #[cfg(test)]
    pub(super) fn of_faces(sampled: u64, bare: u64) -> Lining {
        Lining { sampled, bare }
    }

    /// The lining of a run of row `z` of slice `y`, among the solid cells that tell and the occupied cells of the slices round it.
    pub fn of([solid, occupied]: &[Window<Bits>; 2], y: i64, z: u32, run: Run) -> Lining {
        let mut lining = Lining::default();
        let mut add = |y: i64, z: u32, start: u32, end: u32| {
            let (solid, occupied) = (solid.get(y).row(z), occupied.get(y).row(z));
            for (i, cells) in words_of(start, end) {
                lining.sampled += u64::from((occupied[i] & cells).count_ones());
                lining.bare += u64::from((solid[i] & !occupied[i] & cells).count_ones());
            }
        };
        let Run { start, end } = run;
        let (width, rows) = (solid.get(y).width(), solid.get(y).row_count());
        if start > 0 {
            add(y, z, start - 1, start);
        }
        if end < width {
            add(y, z, end, end + 1);
        }
        if z > 0 {
            add(y, z - 1, start, end);
        }
        if z + 1 < rows {
            add(y, z + 1, start, end);
        }
        add(y - 1, z, start, end);
        add(y + 1, z, start, end);
        lining
    }

    /// Whether most of it was sampled: three faces in five, or more.
    pub fn is_sampled(&self) -> bool {
        5 * self.sampled >= 3 * (self.sampled + self.bare)
    }

    /// Whether hardly any of it was: less than two sampled faces in seven, found by trying, from .3 to .67 sampled faces for each bare one. With .67, concavities of the horse are
    /// filled (mean squared error .069 instead of .035).
    pub(super) fn is_bare(&self) -> bool {
        5 * self.sampled < 2 * self.bare
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;
    use crate::grid::Cell;
    use crate::run::testing::with_context;

    const CELLS: Cell = [13, 14, 12];

    fn all_cells() -> impl Iterator<Item = Cell> {
        (0..CELLS[0]).flat_map(|x| (0..CELLS[1]).flat_map(move |y| (0..CELLS[2]).map(move |z| [x, y, z])))
    }

    fn squared_distance(a: [i64; 3], b: [i64; 3]) -> i64 {
        (0..3).map(|i| (a[i] - b[i]).pow(2)).sum()
    }

    /// The cells that dents are filled with, cell by cell.
    fn twin(solid: &BTreeSet<Cell>, occupied: &BTreeSet<Cell>, thick: &BTreeSet<Cell>) -> BTreeSet<Cell> {
        let reaches = i64::from(REACHES);
        let is_near =
            |at: [i64; 3], cells: &[[i64; 3]]| cells.iter().any(|cell| squared_distance(at, *cell) <= reaches);
        let solids: Vec<[i64; 3]> = solid.iter().map(|cell| cell.map(i64::from)).collect();
        let [width, slices, rows] = CELLS.map(i64::from);
        let padded =
            (-4..width + 4).flat_map(|x| (-4..slices + 4).flat_map(move |y| (-4..rows + 4).map(move |z| [x, y, z])));
        let middles: Vec<[i64; 3]> = padded.filter(|at| !is_near(*at, &solids)).collect();
        let mut left: BTreeSet<Cell> =
            all_cells().filter(|cell| !solid.contains(cell) && !is_near(cell.map(i64::from), &middles)).collect();
        let mut filled = BTreeSet::new();
        while let Some(first) = left.pop_first() {
            let (mut dent, mut next) = (vec![first], 0);
            let [mut sampled, mut bare] = [0; 2];
            while next < dent.len() {
                for axis in 0..3 {
                    for step in [-1, 1] {
                        let mut cell = dent[next];
                        cell[axis] = cell[axis].wrapping_add_signed(step);
                        if left.remove(&cell) {
                            dent.push(cell);
                        }
                        sampled += u64::from(occupied.contains(&cell));
                        bare += u64::from(solid.contains(&cell) && !occupied.contains(&cell) && !thick.contains(&cell));
                    }
                }
                next += 1;
            }
            if 5 * sampled < 2 * bare {
                filled.extend(dent);
            }
        }
        filled
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Blocks beside each other, of whose cells some are occupied and some others were thickened.
        #[test]
        fn dents_that_are_filled_are_those_of_the_twin(
            blocks in prop::collection::vec(prop::array::uniform3((0u32..12, 1u32..8)), 1..7),
            shares in prop::collection::vec((0.0f64..0.6, 0.0f64..0.5), 3),
            draws in prop::collection::vec(0.0f64..1.0, 97),
        ) {
            let solid: BTreeSet<Cell> = all_cells()
                .filter(|cell| blocks.iter().any(|block| (0..3).all(|a| (block[a].0..block[a].0 + block[a].1).contains(&cell[a]))))
                .collect();
            // The shares differ from one third of the box to the next.
            let draw = |[x, y, z]: &Cell| draws[(7 * x + 31 * y + 5 * z) as usize % 97];
            let of = |cell: &Cell| shares[cell[0] as usize * 3 / 13];
            let occupied: BTreeSet<Cell> = solid.iter().filter(|cell| draw(cell) < of(cell).0).copied().collect();
            let thick: BTreeSet<Cell> =
                solid.iter().filter(|cell| draw(cell) >= of(cell).0 && draw(cell) < of(cell).0 + of(cell).1).copied().collect();
            let thick = if shares[0].0 < 0.5 { thick } else { BTreeSet::new() };
            let mut expected = twin(&solid, &occupied, &thick);
            expected.extend(&solid);
            let found: BTreeSet<Cell> = with_context(CELLS, |context| {
                let of = |cells: &BTreeSet<Cell>| Occupancy::of_cells(cells.iter().copied(), CELLS, context).unwrap();
                let before = Solid { cells: CELLS, store: of(&solid).store, volume: 0, faces: Vec::new(), ground: None };
                let store = of(&thick).store;
                let solid = before.without_dents(Some(&store).filter(|_| !thick.is_empty()), &of(&occupied), context).unwrap();
                let (mut bits, mut runs) = (Bits::new(CELLS[0], CELLS[2]), Runs::default());
                all_cells().filter(|[x, y, z]| {
                    solid.store.paint(i64::from(*y), &mut bits, &mut runs).unwrap();
                    bits.get(i64::from(*x), i64::from(*z))
                }).collect()
            });
            prop_assert_eq!(found, expected);
        }
    }
}
