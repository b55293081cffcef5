//! Bare insides: what the field calls inside, and finer cells show to lie beside a body.
//!
//! On the cells of the field a fin is a single wall. Where it stands close to other walls, the field can call the air on one side of it inside:
//!
//! ```text
//!      o o o o o        # occupied, o outside, i inside
//!      o o o o o  fin
//!      i i o # o        The lump of i has walls below it and on one side only; the rest of its border is open.
//!      i i i # o        A body with a hole as large would have walls on opposite sides.
//!    # # # # # # #
//! ```
//!
//! So each component of inside cells, joined by faces, is judged by its border. A face is *open* if it leads to an outside cell, else *closed*. The component
//! becomes outside if more than a quarter of its faces are open and the closed ones lie on one side: with n the number of closed faces that look along
//! each of the six directions, 2 Σ min(n₊, n₋) over the axes is less than 3/5 of Σ (n₊ + n₋).

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::grid::context::{Context, chunks};
use crate::grid::label::{Labeller, Measure, Parts, Scratch};
use crate::grid::slice::{Bits, Run, Runs, Slices, set_range, words_of};
use crate::grid::window::Window;
use crate::solid::watershed::{Sides, stores};

/// The verdicts on components of the inside.
const STAYS: u8 = 0;
const BARE: u8 = 1;

/// The faces of a run's border, or of a component's.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Zeroable, Pod)]
#[repr(C)]
struct Border {
    /// Faces to outside cells.
    open: u64,
    /// Faces to cells without a side, occupied ones included, by direction: along -x, +x, -z, +z, -y, +y.
    closed: [u64; 6],
}

impl Measure for Border {
    fn add(&mut self, other: &Border) {
        self.open += other.open;
        self.closed.iter_mut().zip(other.closed).for_each(|(sum, more)| *sum += more);
    }
}

impl Border {
    /// The border of a run of row `z` of slice `y`, among the outside and the inside cells of the slices round it.
    fn of([outside, inside]: &[Window<Bits>; 2], y: i64, z: u32, run: Run) -> Border {
        let mut border = Border::default();
        let Run { start, end } = run;
        let (width, rows) = (inside.get(y).width(), inside.get(y).row_count());
        let mut add = |direction: usize, y: i64, z: i64, start: i64, end: i64| {
            // Beyond the padded box all is outside.
            if z < 0 || z >= i64::from(rows) || start < 0 || end > i64::from(width) {
                border.open += (end - start) as u64;
                return;
            }
            let (outside, inside) = (outside.get(y).row(z as u32), inside.get(y).row(z as u32));
            for (i, cells) in words_of(start as u32, end as u32) {
                border.open += u64::from((outside[i] & cells).count_ones());
                border.closed[direction] += u64::from((!outside[i] & !inside[i] & cells).count_ones());
            }
        };
        let (start, end, z) = (i64::from(start), i64::from(end), i64::from(z));
        add(0, y, z, start - 1, start);
        add(1, y, z, end, end + 1);
        add(2, y, z - 1, start, end);
        add(3, y, z + 1, start, end);
        add(4, y - 1, z, start, end);
        add(5, y + 1, z, start, end);
        border
    }

    /// Whether much of it is open, and what is closed lies on one side.
    fn verdict(&self) -> u8 {
        let closed: u64 = self.closed.iter().sum();
        let opposite: u64 = self.closed.chunks_exact(2).map(|axis| 2 * axis[0].min(axis[1])).sum();
        let is_bare = 4 * self.open > self.open + closed && 5 * opposite < 3 * closed;
        if is_bare { BARE } else { STAYS }
    }
}

impl Sides {
    /// The same sides, with the bare components of the inside given to the outside.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn without_bare(self, context: &Context) -> Result<Sides> {
        let padded = self.padded;
        let mut labeller = Labeller::new(context);
        let mut jobs = chunks(padded.cells[1]);
        context.workers.in_order(
            context.jobs(3, padded.cells),
            || Ok(jobs.next()),
            |slices| self.borders(slices),
            |parts: Parts<Border>| labeller.add(parts),
        )?;
        let mut any = false;
        let labels = labeller.finish()?.judged(context, |border| {
            let verdict = border.verdict();
            any |= verdict == BARE;
            verdict
        })?;
        if !any {
            return Ok(self);
        }
        let [outside, inside] = stores(padded, 1, context, |slices| {
            let (mut runs, mut scratch) = (Runs::default(), Scratch::default());
            let [mut side, mut bare] = [padded.bits(), padded.bits()];
            let mut out: [Slices; 2] = Default::default();
            for y in slices {
                self.outside.paint(i64::from(y), &mut side, &mut runs)?;
                labels.paint(y, BARE, &mut side, &mut scratch)?;
                out[0].push(&side);
                bare.clear();
                labels.paint(y, BARE, &mut bare, &mut scratch)?;
                self.inside.paint(i64::from(y), &mut side, &mut runs)?;
                side.and_not(&bare);
                out[1].push(&side);
            }
            Ok(out)
        })?;
        Ok(Sides { outside, inside, ..self })
    }

    /// The inside's components in some slices, with the border of each.
    fn borders(&self, slices: std::ops::Range<u32>) -> Result<Parts<Border>> {
        let padded = self.padded;
        let mut around = [(); 2].map(|()| Window::new(3, || padded.bits()));
        let (mut runs, mut held, mut borders) = (Runs::default(), Vec::with_capacity(slices.len()), Vec::new());
        let last = i64::from(padded.cells[1]) - 1;
        for y in slices.map(i64::from) {
            let [outside, inside] = &mut around;
            outside.slide_to(y - 1, |y, bits| {
                self.outside.paint(y, bits, &mut runs)?;
                if y < 0 || y > last {
                    (0..padded.cells[2]).for_each(|z| set_range(bits.row_mut(z), 0, padded.cells[0]));
                }
                Ok(())
            })?;
            inside.slide_to(y - 1, |y, bits| self.inside.paint(y, bits, &mut runs))?;
            let found = Runs::from_bits(around[1].get(y));
            for z in 0..found.row_count() {
                borders.extend(found.row(z).iter().map(|run| Border::of(&around, y, z, *run)));
            }
            held.push(found);
        }
        let mut borders = borders.into_iter();
        Ok(Parts::of(held, |_, _, _| borders.next().expect("every run has its border")))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::grid::Cell;
    use crate::grid::slice::SliceStore;
    use crate::run::testing::with_context;
    use crate::solid::exterior::Padded;

    const CELLS: Cell = [13, 11, 12];

    fn cells() -> impl Iterator<Item = [i64; 3]> {
        let [width, slices, rows] = CELLS.map(i64::from);
        (0..slices).flat_map(move |y| (0..rows).flat_map(move |z| (0..width).map(move |x| [x, y, z])))
    }

    /// What a cell is.
    #[derive(Debug, Clone, Copy, PartialEq)]
    enum Is {
        Outside,
        Inside,
        Neither,
    }

    fn at(marks: &[Is], cell: [i64; 3]) -> Is {
        let [x, y, z] = cell;
        let [width, slices, rows] = CELLS.map(i64::from);
        let within = (0..width).contains(&x) && (0..slices).contains(&y) && (0..rows).contains(&z);
        if within { marks[((y * rows + z) * width + x) as usize] } else { Is::Outside }
    }

    fn neighbours([x, y, z]: [i64; 3]) -> [[i64; 3]; 6] {
        [[x - 1, y, z], [x + 1, y, z], [x, y, z - 1], [x, y, z + 1], [x, y - 1, z], [x, y + 1, z]]
    }

    /// Cell by cell: the components of the inside, their faces, and the verdict as docs/algorithm.md words it.
    fn twin(marks: &[Is]) -> Vec<Is> {
        let mut out = marks.to_vec();
        let mut seen = std::collections::HashSet::new();
        for first in cells().filter(|cell| at(marks, *cell) == Is::Inside) {
            let (mut component, mut stack) = (Vec::new(), vec![first]);
            while let Some(cell) = stack.pop() {
                if seen.insert(cell) {
                    component.push(cell);
                    stack.extend(neighbours(cell).into_iter().filter(|next| at(marks, *next) == Is::Inside));
                }
            }
            let faces = |direction: usize, is: Is| {
                component.iter().filter(|cell| at(marks, neighbours(**cell)[direction]) == is).count() as f64
            };
            let open: f64 = (0..6).map(|direction| faces(direction, Is::Outside)).sum();
            let closed: f64 = (0..6).map(|direction| faces(direction, Is::Neither)).sum();
            let both = |axis: usize| faces(2 * axis, Is::Neither).min(faces(2 * axis + 1, Is::Neither));
            if open > 0.25 * (open + closed) && 2.0 * (0..3).map(both).sum::<f64>() < 0.6 * closed - 1e-9 {
                for cell in cells().zip(&mut out).filter(|(cell, _)| component.contains(cell)) {
                    *cell.1 = Is::Outside;
                }
            }
        }
        out
    }

    fn store(marks: &[Is], is: Is, context: &Context) -> SliceStore {
        let mut store = SliceStore::new(&context.workspace, context.memory.store_quota);
        let mut bits = Bits::new(CELLS[0], CELLS[2]);
        let mut slices = Slices::default();
        for y in 0..i64::from(CELLS[1]) {
            bits.clear();
            let of_slice = cells().filter(|cell| cell[1] == y && at(marks, *cell) == is);
            of_slice.for_each(|[x, _, z]| bits.set(x as u32, z as u32));
            slices.push(&bits);
        }
        store.extend(&slices).unwrap();
        store
    }

    fn fast(marks: &[Is]) -> Vec<Is> {
        with_context(CELLS, |context| {
            let [outside, inside] = [Is::Outside, Is::Inside].map(|is| store(marks, is, context));
            let sides = Sides { padded: Padded { pad: 1, cells: CELLS }, outside, inside, squared: 1 };
            let sides = sides.without_bare(context).unwrap();
            let [mut outside, mut inside] = [(); 2].map(|()| Bits::new(CELLS[0], CELLS[2]));
            let mut runs = Runs::default();
            let of_cell = |[x, y, z]: [i64; 3]| {
                sides.outside.paint(y, &mut outside, &mut runs).unwrap();
                sides.inside.paint(y, &mut inside, &mut runs).unwrap();
                match (outside.get(x, z), inside.get(x, z)) {
                    (true, false) => Is::Outside,
                    (false, true) => Is::Inside,
                    (false, false) => Is::Neither,
                    (true, true) => panic!("a cell on both sides"),
                }
            };
            cells().map(of_cell).collect()
        })
    }

    /// Boxes of inside and of walls, laid over one another, in the outside.
    fn marks() -> impl Strategy<Value = Vec<Is>> {
        let span = |n: u32| (0..i64::from(n), 1..7i64);
        let is = prop_oneof![Just(Is::Inside), Just(Is::Neither), Just(Is::Neither), Just(Is::Outside)];
        let boxes = prop::collection::vec((span(CELLS[0]), span(CELLS[1]), span(CELLS[2]), is), 1..12);
        boxes.prop_map(|boxes| {
            let of_cell = |cell: [i64; 3]| {
                boxes.iter().fold(Is::Outside, |was, (x, y, z, is)| {
                    let within = [x, y, z].into_iter().zip(cell).all(|(s, c)| (s.0..s.0 + s.1).contains(&c));
                    if within { *is } else { was }
                })
            };
            cells().map(of_cell).collect()
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(96))]

        #[test]
        fn bare_components_are_those_of_the_twin(marks in marks()) {
            prop_assert_eq!(fast(&marks), twin(&marks));
        }
    }

    #[test]
    fn a_lump_beside_a_fin_goes_and_a_cup_stays() {
        let lump = |[x, y, z]: [i64; 3]| match [x, y, z] {
            [_, _, 0..=2] => Is::Neither,
            [8, _, _] => Is::Neither,
            [5..=7, 2..=8, 3..=7] => Is::Inside,
            _ => Is::Outside,
        };
        let cup = |[x, y, z]: [i64; 3]| match [x, y, z] {
            [4..=8, 3..=7, 3..=6] => Is::Inside,
            [3..=9, 2..=8, 2..=6] => Is::Neither,
            _ => Is::Outside,
        };
        let [lump, cup] = [cells().map(lump).collect::<Vec<_>>(), cells().map(cup).collect()];
        assert!(fast(&lump).iter().all(|is| *is != Is::Inside));
        assert_eq!(fast(&cup), cup);
    }
}
