//! Which components of the inside are bare, against a count of every cell; and that bodies are not, and what lies before a dome is.

use proptest::prelude::*;

use super::super::block::Block;
use super::super::field::Field;
use super::super::normal::two_sided;
use super::super::support::{Bare, bare};
use super::{Numbers, components, marked, numbers_of, places, square_between};

/// The field that is `inside` there and outside elsewhere, with only the padding outside from the start.
fn field<'a>(block: &'a Block, occupied: &'a [bool], inside: &[bool]) -> Field<'a> {
    let level = marked(block, |_| true);
    let mut field = Field::new(block, occupied, level.iter().map(|level| !level).collect());
    field.u.iter_mut().zip(inside).for_each(|(u, inside)| *u = if *inside { 1.0 } else { -1.0 });
    field
}

/// Which free cells lie between two occupied ones that are opposite to each other.
fn gaps<'a>(block: &'a Block, occupied: &'a [bool]) -> impl Fn(usize) -> bool + 'a {
    move |cell| {
        let is_occupied = |step: isize| occupied[cell.wrapping_add_signed(step)];
        !occupied[cell] && !block.at_border(cell) && block.around().iter().any(|s| is_occupied(*s) && is_occupied(-s))
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn components_are_bare_if_a_quarter_of_their_border_is(
        seed in any::<u64>(),
        walls in 0.0f64..0.3,
        share in 0.1f64..0.6,
    ) {
        let mut numbers = Numbers::new(seed);
        let block = Block::new([9, 8, 7]);
        // Walls on one side only, so that the other side is bare.
        let occupied = marked(&block, |cell| cell[0] < 5 && numbers.part() < walls);
        let inside: Vec<bool> = marked(&block, |_| numbers.part() < share).iter().zip(&occupied).map(|(i, o)| i & !o).collect();
        let field = field(&block, &occupied, &inside);
        let places = places(&block);
        let faces = |a: usize, b: usize| square_between(places[a], places[b]) == 1;
        let is_gap = gaps(&block, &occupied);
        let is_lined = |cell: usize| block.around().iter().any(|step| occupied[cell.wrapping_add_signed(*step)]);
        let lined: Vec<bool> = (0..inside.len()).map(|cell| inside[cell] && is_lined(cell)).collect();
        // Parts: cells that lie beside no wall hang together by faces. Three times, those beside walls join the first part next to them; the rest hangs together by itself.
        let core: Vec<bool> = inside.iter().zip(&lined).map(|(inside, lined)| *inside && !lined).collect();
        let mut part: Vec<Option<usize>> = components(&block, &core, 1);
        for _ in 0..3 {
            let before = part.clone();
            for cell in (0..inside.len()).filter(|&cell| inside[cell] && before[cell].is_none()) {
                part[cell] = (0..inside.len()).filter(|&o| faces(cell, o)).filter_map(|o| before[o]).min();
            }
        }
        let rest: Vec<bool> = inside.iter().zip(&part).map(|(inside, of)| *inside && of.is_none()).collect();
        part.iter_mut().zip(components(&block, &rest, 1)).for_each(|(of, rest)| *of = of.or(rest));
        let borders = |of: &[Option<usize>]| {
            let mut counts = vec![[0usize; 4]; inside.len()];
            for cell in (0..inside.len()).filter(|&cell| inside[cell]) {
                let counts = &mut counts[of[cell].unwrap()];
                for o in (0..inside.len()).filter(|&o| faces(cell, o) && of[o] != of[cell]) {
                    let is_open = !occupied[o] && !is_gap(cell) && !is_gap(o);
                    counts[if inside[o] { 2 } else { usize::from(is_open) }] += 1;
                }
            }
            counts
        };
        let component = components(&block, &inside, 1);
        let (of_components, mut of_parts) = (borders(&component), borders(&part));
        let walls = two_sided(&block, &occupied, &numbers_of(&occupied));
        for [a, b] in walls.iter().map(|wall| wall.sides.map(|cell| part[cell as usize])) {
            if let (Some(a), Some(b)) = (a, b) && a != b {
                [a, b].into_iter().for_each(|of| of_parts[of][3] += 1);
            }
        }
        let whole: Vec<bool> = component.iter().map(|of| of.is_some_and(|of| {
            let [lined, open, ..] = of_components[of];
            4 * open > open + lined
        })).collect();
        let cells: Vec<bool> = part.iter().zip(&whole).map(|(of, whole)| *whole || of.is_some_and(|of| {
            let [lined, open, neck, shared] = of_parts[of];
            let all = lined + open + neck;
            all >= 30 && 10 * neck <= 6 * all && 4 * (open + shared.min(lined)) > all
        })).collect();
        let expected = cells.contains(&true).then_some(Bare { cells, whole });
        prop_assert!(bare(&field, &walls) == expected);
    }

    /// Two rooms of a box, the wall between which parts nothing: the smaller it is, the more of its border is that wall.
    #[test]
    fn a_pocket_behind_the_walls_of_a_body_is_bare(depth in 1usize..3, side in 12usize..17, axis in 0usize..3) {
        let block = Block::new([side as u32 + 12; 3]);
        let within = |cell: &[usize; 3], from: usize, to: usize| {
            (0..3).all(|a| if a == axis { (from..to).contains(&cell[a]) } else { (1..=side).contains(&cell[a]) })
        };
        let body = marked(&block, |cell| within(cell, 1, 16));
        let pocket = marked(&block, |cell| within(cell, 17, 17 + depth));
        let inside: Vec<bool> = body.iter().zip(&pocket).map(|(body, pocket)| body | pocket).collect();
        let shell = marked(&block, |cell| {
            cell.iter().enumerate().all(|(a, c)| *c <= if a == axis { 17 + depth } else { side + 1 })
        });
        let walls: Vec<bool> = shell.iter().zip(&inside).map(|(shell, inside)| shell & !inside).collect();
        let two = two_sided(&block, &walls, &numbers_of(&walls));
        let found = bare(&field(&block, &walls, &inside), &two);
        let expected = Bare { cells: pocket, whole: vec![false; inside.len()] };
        prop_assert!(found == Some(expected));
    }

    /// A box with a hole, and a floor with as much of the air on it.
    #[test]
    fn a_body_with_a_hole_is_lined_and_what_lies_on_a_floor_is_bare(
        side in 10usize..16,
        hole in 0usize..5,
        axis in 0usize..3,
    ) {
        let block = Block::new([side as u32; 3]);
        let inner = |cell: &[usize; 3]| cell.iter().all(|c| (1..side - 1).contains(c));
        let in_hole = |cell: &[usize; 3]| [1, 2].iter().all(|a| cell[(axis + a) % 3].abs_diff(side / 2) < hole);
        let inside = marked(&block, inner);
        let walls = marked(&block, |cell| !(inner(cell) || cell[axis] == 0 && in_hole(cell)));
        let floor = marked(&block, |cell| cell[axis] == 0);
        prop_assert_eq!(bare(&field(&block, &walls, &inside), &[]), None);
        let before_floor: Vec<bool> = inside.iter().zip(&floor).map(|(inside, floor)| *inside && !floor).collect();
        let expected = Bare { cells: before_floor.clone(), whole: before_floor };
        prop_assert!(bare(&field(&block, &floor, &inside), &[]) == Some(expected));
    }

    /// A cavity in a body: lined if most of its wall was sampled, else only a place that the field does not reach.
    #[test]
    fn a_cavity_is_lined_as_far_as_it_was_sampled(sampled in 0usize..7, radius in 2usize..5) {
        let block = Block::new([15; 3]);
        let from_middle = |cell: &[usize; 3]| cell.iter().map(|c| c.abs_diff(7)).max().unwrap();
        let cavity = marked(&block, |cell| from_middle(cell) < radius);
        // The cube's sides one after the other.
        let walls = marked(&block, |cell| {
            let side = |i: usize| if i.is_multiple_of(2) { cell[i / 2] == 7 - radius } else { cell[i / 2] == 7 + radius };
            from_middle(cell) == radius && (0..sampled).any(side)
        });
        let inside = marked(&block, |cell| (radius..7).contains(&from_middle(cell)));
        let inside: Vec<bool> = inside.iter().zip(&walls).map(|(i, w)| i & !w).collect();
        let field = field(&block, &walls, &inside);
        let enclosed: Vec<usize> = numbers_of(&cavity).into_iter().map(|cell| cell as usize).collect();
        let is_gap = gaps(&block, &walls);
        let (mut lined, mut open) = (0, 0);
        for &cell in &enclosed {
            for next in block.strides().iter().flat_map(|s| [cell.wrapping_add_signed(*s), cell.wrapping_add_signed(-s)]) {
                match () {
                    () if cavity[next] => {}
                    () if walls[next] || is_gap(cell) || is_gap(next) => lined += 1,
                    () => open += 1,
                }
            }
        }
        prop_assert_eq!(field.is_lined(&enclosed), 4 * open <= open + lined);
        if sampled == 6 {
            prop_assert!(field.is_lined(&enclosed));
        } else if sampled == 0 {
            prop_assert!(!field.is_lined(&enclosed));
        }
    }
}
