//! The field makes E least: E is formed from its definition, in double precision, and made least cell by cell.

use proptest::prelude::*;

use super::super::block::{Block, Side};
use super::super::field::Field;
use super::super::normal::{Wall, two_sided};
use super::{Numbers, marked, numbers_of, workers};
use crate::resources::workers::Workers;

/// A term weight (u_a + sign u_b)² of E.
struct Term {
    cells: [usize; 2],
    weight: f64,
    sign: f64,
}

/// E on all cells of a block; u is −1 on those that are outside.
struct Energy {
    terms: Vec<Term>,
    /// Of each cell, its terms.
    of: Vec<Vec<usize>>,
    free: Vec<usize>,
    outside: Vec<bool>,
}

impl Energy {
    fn new(block: &Block, occupied: &[bool], outside: &[bool], walls: &[Wall]) -> Energy {
        let gap =
            |cell: usize| {
                // Of the outermost cells of the padding none lies between occupied ones.
                !block.at_border(cell)
                    && Block::ball(3).into_iter().filter(|d| *d != [0; 3]).map(|d| block.step(d)).any(|step| {
                        occupied[cell.wrapping_add_signed(step)] && occupied[cell.wrapping_add_signed(-step)]
                    })
            };
        let mut terms = Vec::new();
        for cell in (0..occupied.len()).filter(|&cell| !block.at_border(cell)) {
            for step in block.strides() {
                let cells = [cell, cell.wrapping_add_signed(step)];
                if cells.iter().all(|&cell| !occupied[cell]) {
                    let weight = if cells.iter().any(|&cell| gap(cell)) { f64::from(0.1f32) } else { 1.0 };
                    terms.push(Term { cells, weight, sign: -1.0 });
                }
            }
        }
        for wall in walls {
            let cells = wall.sides.map(|cell| cell as usize);
            terms.push(Term { cells, weight: f64::from(wall.weight), sign: 1.0 });
        }
        let mut of = vec![Vec::new(); occupied.len()];
        for (i, term) in terms.iter().enumerate() {
            term.cells.iter().for_each(|&cell| of[cell].push(i));
        }
        let free = (0..occupied.len()).filter(|&cell| !occupied[cell] && !outside[cell]).collect();
        Energy { terms, of, free, outside: outside.to_vec() }
    }

    fn of(&self, u: &[f64]) -> f64 {
        self.terms.iter().map(|t| t.weight * (u[t.cells[0]] + t.sign * u[t.cells[1]]).powi(2)).sum()
    }

    /// Weight and pull of the terms of a cell: half of E's slope there is weight · u − pull.
    fn at(&self, u: &[f64], cell: usize) -> (f64, f64) {
        self.of[cell].iter().map(|&i| &self.terms[i]).fold((0.0, 0.0), |(weight, pull), term| {
            let other = if term.cells[0] == cell { term.cells[1] } else { term.cells[0] };
            (weight + term.weight, pull - term.weight * term.sign * u[other])
        })
    }

    /// Half of E's slope.
    fn slope(&self, u: &[f64]) -> f64 {
        let square = |&cell: &usize| {
            let (weight, pull) = self.at(u, cell);
            (weight * u[cell] - pull).powi(2)
        };
        self.free.iter().map(square).sum::<f64>().sqrt()
    }

    fn start(&self) -> Vec<f64> {
        self.outside.iter().map(|outside| if *outside { -1.0 } else { 0.0 }).collect()
    }

    /// u that makes E least, by Gauss and Seidel's sweeps.
    fn least(&self) -> Vec<f64> {
        let mut u = self.start();
        for _ in 0..20_000 {
            let mut moved = 0f64;
            for &cell in &self.free {
                let (weight, pull) = self.at(&u, cell);
                if weight > 0.0 {
                    moved = moved.max((u[cell] - pull / weight).abs());
                    u[cell] = pull / weight;
                }
            }
            if moved < 1e-9 {
                break;
            }
        }
        u
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn the_field_makes_the_energy_least(
        seed in any::<u64>(),
        cells in [2u32..8, 2u32..8, 2u32..8],
        share in 0.0f64..0.6,
        boxed in any::<bool>(),
        hole in 0.0f64..0.4,
    ) {
        let mut numbers = Numbers::new(seed);
        let block = Block::new(cells);
        let at_side = |cell: &[usize; 3]| (0..3).any(|a| cell[a] == 0 || cell[a] + 1 == cells[a] as usize);
        let occupied = marked(&block, |cell| {
            let share = if !boxed { share } else if at_side(cell) { 1.0 - hole } else { 0.05 };
            numbers.part() < share
        });
        let level = marked(&block, |_| true);
        let outside: Vec<bool> = level.iter().zip(&occupied).map(|(level, o)| !level || !o && numbers.part() < 0.05).collect();
        let numbers_of_walls = numbers_of(&occupied);
        let walls = two_sided(&block, &occupied, &numbers_of_walls);
        let energy = Energy::new(&block, &occupied, &outside, &walls);
        let mut field = Field::new(&block, &occupied, outside.clone());
        let mut alone = Field::new(&block, &occupied, outside.clone());
        field.solve(&walls, &workers());
        alone.solve(&walls, &Workers::new(1).unwrap());
        prop_assert_eq!(&field.u, &alone.u, "the number of threads decides bits");
        let free: Vec<usize> = (0..occupied.len()).filter(|&cell| field.is_asked(cell)).collect();
        prop_assert_eq!(&free, &energy.free);
        let mut u = energy.start();
        free.iter().for_each(|&cell| u[cell] = f64::from(field.u[cell]));

        // The residual that the search may leave, and what single precision adds to it.
        let most = 1.1e-3 * energy.slope(&energy.start()) + 1e-6;
        prop_assert!(energy.slope(&u) <= most, "{} of {most}", energy.slope(&u));
        let least = energy.least();
        let [found, least_energy] = [&u, &least].map(|u| energy.of(u));
        prop_assert!(found - least_energy <= 1e-3 * (1.0 + energy.of(&energy.start())), "{found} {least_energy}");
        for _ in 0..8 {
            let mut other = u.clone();
            let size = numbers.between(0.05, 0.5);
            free.iter().for_each(|&cell| other[cell] += numbers.between(-size, size));
            prop_assert!(free.is_empty() || energy.of(&other) >= found);
        }
        // Where a field that is least is clearly on a side, the one that was found is too, as long as something holds it.
        let sums = u.iter().zip(&least).filter(|(_, least)| least.abs() > 0.05);
        let apart = sums.clone().filter(|(u, least)| u.signum() != least.signum()).count();
        prop_assert!(apart as f64 <= 0.01 * sums.count() as f64, "{apart} cells have the other sign");
    }

    /// What is opened is outside from then on, and the others keep their u.
    #[test]
    fn opening_keeps_the_others(seed in any::<u64>(), share in 0.0f64..0.4) {
        let mut numbers = Numbers::new(seed);
        let block = Block::new([6, 5, 7]);
        let occupied = marked(&block, |_| numbers.part() < share);
        let level = marked(&block, |_| true);
        let mut field =
            Field::new(&block, &occupied, level.iter().map(|level| !level).collect());
        let before: Vec<f32> = occupied.iter().map(|_| numbers.part() as f32).collect();
        field.u.clone_from(&before);
        let asked: Vec<bool> = (0..occupied.len()).map(|cell| field.is_asked(cell)).collect();
        let bare: Vec<bool> = asked.iter().map(|asked| *asked && numbers.part() < 0.5).collect();
        let reached: Vec<bool> = occupied.iter().map(|_| numbers.part() < 0.5).collect();
        field.open(&bare, &reached);
        for cell in 0..occupied.len() {
            let opened = bare[cell] && reached[cell];
            prop_assert_eq!(field.is_asked(cell), asked[cell] && !opened);
            prop_assert!(!opened || field.is_outside(cell));
            prop_assert!(!field.is_asked(cell) || field.u[cell] == before[cell]);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// On wide cells, components of inside cells, joined by faces, have no side if they have fewer than 27 cells; or fewer than 27 with none occupied round them, and a
    /// face to the other side for every eight cells, which of inside cells all have a gap on them. All else is as on the grid's own.
    #[test]
    fn pieces_of_wide_cells_have_no_side(seed in any::<u64>(), holes in 0.0f64..0.1) {
        let mut numbers = Numbers::new(seed);
        let cells = [14usize; 3];
        let block = Block::new(cells.map(|c| c as u32));
        // A box of rooms: walls at random places along each axis.
        let walls = [(); 3].map(|()| [0, 13, 1 + numbers.below(12), 1 + numbers.below(12), 1 + numbers.below(12)]);
        let occupied = marked(&block, |cell| (0..3).any(|a| walls[a].contains(&cell[a])) && numbers.part() >= holes);
        let level = marked(&block, |_| true);
        let outside: Vec<bool> = level.iter().map(|level| !level).collect();
        let of_walls = two_sided(&block, &occupied, &numbers_of(&occupied));
        let mut field = Field::new(&block, &occupied, outside);
        field.solve(&of_walls, &workers());
        let [own, wide] = [false, true].map(|are_wide| field.sides(are_wide));
        // First the enclosed cells, then what is left of the inside.
        let mut expected = own.clone();
        for is_low in [true, false] {
            let is_of = |cell: usize| match is_low {
                true => field.is_asked(cell) && field.u[cell] <= 0.0,
                false => expected[cell] == Side::Inside,
            };
            let mut waits: Vec<bool> = (0..own.len()).map(is_of).collect();
            for first in 0..own.len() {
                let (mut piece, mut stack) = (Vec::new(), vec![first]);
                while let Some(cell) = stack.pop() {
                    if std::mem::take(&mut waits[cell]) {
                        piece.push(cell);
                        stack.extend(block.beside(cell));
                    }
                }
                let round = |cell: usize| block.around().into_iter().map(move |step| cell.wrapping_add_signed(step));
                let deep = piece.iter().filter(|cell| !round(**cell).any(|next| occupied[next])).count();
                let is_other = |next: usize| match is_low {
                    true => !occupied[next] && !field.is_outside(next),
                    false => !occupied[next] && expected[next] != Side::Inside,
                };
                let faces = piece.iter().flat_map(|cell| block.beside(*cell).map(|next| [*cell, next]));
                let others: Vec<[usize; 2]> = faces.filter(|[_, next]| is_other(*next)).collect();
                let is_gap = |cell: usize| {
                    let at = |step: isize| occupied[cell.wrapping_add_signed(step)];
                    block.around().into_iter().any(|step| at(step) && at(-step))
                };
                let all_gaps = others.iter().all(|face| face.iter().any(|cell| is_gap(*cell)));
                let is_layer = deep < 27 && 8 * others.len() >= piece.len() && (is_low || all_gaps);
                let is_piece = piece.len() < 27 || is_layer;
                // What the outside reaches is not enclosed.
                let reached = |cell: &usize| block.beside(*cell).iter().any(|next| !level[*next]);
                let is_enclosed = || !piece.is_empty() && !piece.iter().any(reached) && field.is_lined(&piece);
                if is_piece && (!is_low || is_enclosed()) {
                    piece.into_iter().for_each(|cell| expected[cell] = Side::Unknown);
                }
            }
        }
        prop_assert_eq!(wide, expected);
    }
}
