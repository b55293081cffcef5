//! A membrane in a box's hole lies where the rim does, wherever it was before.

use proptest::prelude::*;

use super::super::Side;
use super::super::block::Block;
use super::super::membrane::{count, stretch};
use super::super::normal::two_sided;
use super::{level, marked, numbers_of, workers};

/// The box's cells along x and slices.
const SIDE: usize = 24;

/// Which cells are beside occupied ones.
fn lined(block: &Block, occupied: &[bool]) -> Vec<bool> {
    let mut lined = vec![false; occupied.len()];
    for cell in numbers_of(occupied) {
        block.around().iter().for_each(|step| lined[(cell as usize).wrapping_add_signed(*step)] = true);
    }
    lined
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// A hole in the wall on one side; before, the membrane bulges by so many cells, inwards or outwards.
    #[test]
    fn it_lies_within_two_cells_of_the_rims_plane(
        radius in 2.5f64..7.0,
        height in 14usize..26,
        bulge in -7i64..8,
        axis in 0usize..3,
        bottom in any::<bool>(),
    ) {
        let mut cells = [SIDE as u32; 3];
        cells[axis] = height as u32 + 8;
        let block = Block::new(cells);
        // Along the axis, from the wall with the hole on.
        let depth = |cell: [usize; 3]| if bottom { cell[axis] as i64 - 6 } else { height as i64 - cell[axis] as i64 };
        let from_axis = |cell: [usize; 3]| {
            let off = |a: usize| cell[(axis + a) % 3] as f64 - (SIDE as f64 - 1.0) / 2.0;
            off(1).hypot(off(2))
        };
        let far = height as i64 - 6;
        let at = |cell: [usize; 3]| {
            let d = depth(cell);
            let across = [1, 2].map(|a| cell[(axis + a) % 3]);
            let within = across.iter().all(|c| (1..SIDE - 1).contains(c)) && (0..=far).contains(&d);
            let wall = within && (d == 0 || d == far || across.iter().any(|c| *c == 1 || *c == SIDE - 2));
            (within, wall)
        };
        let occupied = marked(&block, |&cell| at(cell).1 && (depth(cell) != 0 || from_axis(cell) > radius));
        let inside = marked(&block, |&cell| {
            let in_hole = from_axis(cell) <= radius;
            let d = depth(cell);
            let dented = in_hole && (0..bulge).contains(&d);
            let bulged = in_hole && (bulge..=0).contains(&d);
            (at(cell).0 && !at(cell).1 && !dented) || bulged
        });
        let mut sides: Vec<Side> = occupied.iter().zip(&inside).map(|(occupied, inside)| match (occupied, inside) {
            (true, _) => Side::Wall,
            (_, true) => Side::Inside,
            _ => Side::Outside,
        }).collect();
        let before = sides.clone();
        let walls = two_sided(&block, &occupied, &numbers_of(&occupied));
        let lined = lined(&block, &occupied);
        stretch(&block, &walls, &lined, &[], &mut sides, &workers());
        let is_membrane = |&cell: &[usize; 3]| {
            let index = block.index(cell);
            let beside = block.strides().into_iter().flat_map(|step| [-step, step]);
            let mut beside = beside.map(|step| sides[index.wrapping_add_signed(step)]);
            sides[index] == Side::Inside && !lined[index] && beside.any(|side| side == Side::Outside)
        };
        let membranes = level(block.cells).filter(is_membrane).count() as u64;
        prop_assert_eq!(count(&block, &lined, &sides), membranes);
        // A disc, of which a ring beside the rim is lined.
        prop_assert!(membranes as f64 <= std::f64::consts::PI * radius * radius * 2.0, "{}", membranes);
        prop_assert!(radius < 4.0 || membranes > 0);
        for cell in level(block.cells) {
            let (index, d) = (block.index(cell), depth(cell));
            if from_axis(cell) <= radius && d.abs() > 2 && d < far {
                prop_assert_eq!(sides[index], if d < 0 { Side::Outside } else { Side::Inside }, "{:?}", cell);
            } else if from_axis(cell) > radius + 2.0 {
                prop_assert_eq!(sides[index], before[index], "{:?}", cell);
            }
        }
    }
}

#[test]
fn what_walls_close_stays_as_it_is() {
    let block = Block::new([16; 3]);
    let shell = |cell: &[usize; 3], at: usize| cell.iter().map(|c| c.abs_diff(8)).max() == Some(at);
    let occupied = marked(&block, |cell| shell(cell, 6));
    let mut sides: Vec<Side> = occupied.iter().map(|o| if *o { Side::Wall } else { Side::Outside }).collect();
    let inside = marked(&block, |cell| (0..6).any(|at| shell(cell, at)));
    numbers_of(&inside).into_iter().for_each(|cell| sides[cell as usize] = Side::Inside);
    let before = sides.clone();
    let walls = two_sided(&block, &occupied, &numbers_of(&occupied));
    stretch(&block, &walls, &lined(&block, &occupied), &[], &mut sides, &workers());
    assert_eq!(sides, before);
}

/// A wide hole that faces the block's border, as near to it as a cloud may be.
#[test]
fn a_membrane_near_the_border_is_flat() {
    const WIDE: usize = 48;
    let (depth_of_dent, radius, top) = (20.0f64, 20.0f64, 47usize);
    let block = Block::new([WIDE as u32; 3]);
    let off = |c: usize| c as f64 - (WIDE as f64 - 1.0) / 2.0;
    let from_axis = |cell: [usize; 3]| off(cell[0]).hypot(off(cell[2]));
    let is_within = |cell: [usize; 3]| cell.iter().all(|c| (1..WIDE - 1).contains(c)) || cell[1] == top;
    let occupied = marked(&block, |&cell| {
        let is_side = [0, 2].iter().any(|&a| cell[a] == 1 || cell[a] == WIDE - 2);
        is_within(cell) && (is_side || cell[1] == 1 || cell[1] == top && from_axis(cell) > radius)
    });
    let dent = |cell: [usize; 3]| top as f64 - depth_of_dent * (1.0 - (from_axis(cell) / radius).powi(2)).max(0.0);
    let side = |cell: [usize; 3]| match occupied[block.index(cell)] {
        true => Side::Wall,
        false if is_within(cell) && (cell[1] as f64) < dent(cell) => Side::Inside,
        false => Side::Outside,
    };
    let mut sides = vec![Side::Outside; occupied.len()];
    level(block.cells).for_each(|cell| sides[block.index(cell)] = side(cell));
    let walls = two_sided(&block, &occupied, &numbers_of(&occupied));
    stretch(&block, &walls, &lined(&block, &occupied), &[], &mut sides, &workers());
    for cell in level(block.cells).filter(|&cell| from_axis(cell) < radius && cell[1] + 2 < top && cell[1] > 3) {
        assert_eq!(sides[block.index(cell)], Side::Inside, "{cell:?}");
    }
    // Nor does it bulge to the border.
    let highest = |x: usize, z: usize| (top..top + 4).find(|y| sides[block.index([x, *y, z])] == Side::Outside);
    assert!(highest(WIDE / 2, WIDE / 2).is_some_and(|y| y <= top + 3), "{:?}", highest(WIDE / 2, WIDE / 2));
}
