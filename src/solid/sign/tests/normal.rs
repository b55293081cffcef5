//! Normals and the two sides of walls, on planes.

use proptest::prelude::*;

use super::super::block::Block;
use super::super::normal::{DOUBLE, NEAR, Wall, doubles, is_thick, two_sided};
use super::{Numbers, dot, marked, numbers_of};

const SIDE: usize = 21;

/// How far a cell is from a plane that passes near the middle.
fn height(cell: [usize; 3], normal: [f64; 3], offset: f64) -> f64 {
    dot(cell.map(|c| c as f64 - (SIDE / 2) as f64), normal) - offset
}

fn walls_of(block: &Block, occupied: &[bool]) -> Vec<Wall> {
    two_sided(block, occupied, &numbers_of(occupied))
}

/// Cells that two planes pass, so far apart, at any angle, without a part of them.
fn two_planes(seed: u64, apart: f64, missing: f64) -> (Block, Vec<bool>) {
    let mut numbers = Numbers::new(seed);
    let normal = numbers.direction();
    let block = Block::new([SIDE as u32; 3]);
    // A plane passes as many cells as points on it lie in.
    let width: f64 = normal.iter().map(|c| c.abs()).sum();
    let passed = |cell: &[usize; 3]| (height(*cell, normal, 0.0).abs() - apart / 2.0).abs() <= width / 2.0;
    let occupied = marked(&block, |cell| passed(cell) && numbers.part() >= missing);
    (block, occupied)
}

/// Whether a cell lies so far from the block's border that nothing near it is cut off.
fn is_amid(cell: [usize; 3]) -> bool {
    cell.into_iter().all(|c| (4..SIDE - 4).contains(&c))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_two_free_cells_lie_on_both_sides_of_a_plane(
        seed in any::<u64>(),
        offset in -0.5f64..0.5,
        missing in 0.0f64..0.15,
    ) {
        let mut numbers = Numbers::new(seed);
        let normal = numbers.direction();
        let block = Block::new([SIDE as u32; 3]);
        let in_plane = |cell: [usize; 3]| height(cell, normal, offset).abs() <= 0.5;
        let occupied = marked(&block, |&cell| in_plane(cell) && numbers.part() >= missing);
        // The share of the plane's cells that are missing among those whose normal is told.
        let lost = |cell: [usize; 3]| {
            let beside = Block::ball(NEAR.0).into_iter().map(|d| [0, 1, 2].map(|a| (cell[a] as i64 + i64::from(d[a])) as usize));
            let all: Vec<bool> = beside.filter(|beside| in_plane(*beside)).map(|beside| occupied[block.index(beside)]).collect();
            all.iter().filter(|there| !**there).count() as f64 / all.len() as f64
        };
        let walls = walls_of(&block, &occupied);
        // The plane's cells end at the border of the box; there a normal may be anything.
        let inner = |cell: u32| is_amid(block.cell(cell as usize));
        let (mut found, mut straight) = (0, 0.0);
        for wall in walls.iter().filter(|wall| inner(wall.cell)) {
            let [a, b] = wall.sides.map(|side| height(block.cell(side as usize), normal, offset));
            // Where a sample is missing, the free cell may lie in the plane.
            let at_gap = a.abs() <= 0.5 || b.abs() <= 0.5;
            prop_assert!(at_gap || a * b < 0.0, "{a} {b}");
            let along = dot(wall.normal.map(f64::from), normal).abs().min(1.0);
            // By chance three in ten of them or more may be missing; then only the two sides are known.
            let lost = lost(block.cell(wall.cell as usize));
            prop_assert!(along > 0.9 || lost >= 0.3, "{} degrees off, {lost} missing", along.acos().to_degrees());
            (found, straight) = (found + 1, straight + along);
        }
        let mean = straight / f64::from(found);
        prop_assert!(mean > 0.98, "{} degrees off on average", mean.acos().to_degrees());
        let expected = numbers_of(&occupied).into_iter().filter(|&cell| inner(cell)).count();
        prop_assert_eq!(found as usize, expected, "every cell of a plane has two sides");
    }

    /// A wall is double if the cells near it spread across it by more than the cells of one plane; one plane's are not, those of two planes are.
    #[test]
    fn walls_are_double_where_two_of_them_lie_near_each_other(
        seed in any::<u64>(),
        apart in prop_oneof![Just(0.0), 1.4f64..2.0],
        missing in 0.0f64..0.2,
    ) {
        let (block, occupied) = two_planes(seed, apart, missing);
        let (mut double, mut all) = (0, 0);
        let walls = walls_of(&block, &occupied);
        let told = doubles(&block, &occupied, &walls);
        for (wall, is_double) in walls.into_iter().zip(told) {
            let cell = block.cell(wall.cell as usize);
            if !is_amid(cell) {
                continue;
            }
            let across = wall.normal.map(f64::from);
            let round = Block::ball(NEAR.1).into_iter().filter(|d| {
                occupied[block.index([0, 1, 2].map(|a| (cell[a] as i64 + i64::from(d[a])) as usize))]
            });
            let offsets: Vec<f64> = round.map(|d| dot(d.map(f64::from), across)).collect();
            let mean = offsets.iter().sum::<f64>() / offsets.len() as f64;
            let variance = offsets.iter().map(|o| (o - mean) * (o - mean)).sum::<f64>() / offsets.len() as f64;
            let width: f64 = across.iter().map(|c| c.abs()).sum();
            let more = variance - width * width / 12.0 - DOUBLE;
            // Normals are kept in single precision.
            prop_assert!(more.abs() < 1e-4 || is_double == (more > 0.0), "{more}");
            double += u32::from(is_double);
            all += 1;
        }
        let share = f64::from(double) / f64::from(all);
        prop_assert!(if apart == 0.0 { share < 0.05 } else { share > 0.3 }, "{double} of {all}");
    }

    /// A wall is thick if the occupied cells along its normal spread by more than one plane's. Of one plane none is, however it lies and whatever is missing.
    #[test]
    fn walls_are_thick_where_cells_along_the_normal_spread(
        seed in any::<u64>(),
        apart in prop_oneof![Just(0.0), 1.1f64..1.7],
        missing in 0.0f64..0.2,
    ) {
        let (block, occupied) = two_planes(seed, apart, missing);
        let (mut thick, mut all) = (0, 0);
        for wall in walls_of(&block, &occupied) {
            let cell = block.cell(wall.cell as usize);
            if !is_amid(cell) {
                continue;
            }
            let across = wall.normal.map(f64::from);
            // What a line along the normal meets before the first free cell.
            let before = |way: f64| {
                let met = (2..=8).map(|half| across.map(|c| (way * f64::from(half) / 2.0 * c).round()));
                let met = met.take_while(|step| {
                    occupied[block.index([0, 1, 2].map(|a| (cell[a] as i64 + step[a] as i64) as usize))]
                });
                met.last().map_or(0.0, |step| dot(step, across))
            };
            let width: f64 = across.iter().map(|c| c.abs()).sum();
            let more = before(1.0) - before(-1.0) - width - 0.3;
            let told = is_thick(&block, &occupied, &wall);
            prop_assert!(more.abs() < 1e-4 || told == (more > 0.0), "{more}");
            (thick, all) = (thick + u32::from(told), all + 1);
        }
        prop_assert!(apart > 0.0 || 100 * thick < all, "{thick} of {all}");
    }

    /// The sides are free, opposite, and the first free ones on their half of the line.
    #[test]
    fn sides_are_the_first_free_cells_along_the_normal(seed in any::<u64>(), share in 0.0f64..0.9) {
        let mut numbers = Numbers::new(seed);
        let block = Block::new([7; 3]);
        let occupied = marked(&block, |_| numbers.part() < share);
        for wall in walls_of(&block, &occupied) {
            let from = block.cell(wall.cell as usize).map(|c| c as i64);
            for (side, sign) in wall.sides.into_iter().zip([1.0, -1.0]) {
                let at = |half: i64| {
                    let step = wall.normal.map(|c| (sign * f64::from(c) * half as f64 / 2.0).round() as i64);
                    block.at([0, 1, 2].map(|a| from[a] + step[a])).unwrap()
                };
                let first = (2..=8).map(at).find(|&cell| !occupied[cell]);
                // A half cell may be rounded either way once the normal is single precision.
                let near = (2..=8).map(at).any(|cell| cell == side as usize);
                prop_assert!(!occupied[side as usize]);
                prop_assert!(first == Some(side as usize) || !near, "{wall:?}");
            }
        }
    }
}

/// Where the cells of two planes touch, or are the same, many walls are thick. At some angles none is, so that this holds of many angles together only.
#[test]
fn walls_of_two_planes_without_a_cell_between_are_often_thick() {
    for apart in [1.1, 1.4, 1.7] {
        let (mut thick, mut all) = (0, 0);
        for seed in 0..40 {
            let (block, occupied) = two_planes(seed, apart, 0.1);
            for wall in walls_of(&block, &occupied).iter().filter(|wall| is_amid(block.cell(wall.cell as usize))) {
                (thick, all) = (thick + u32::from(is_thick(&block, &occupied, wall)), all + 1);
            }
        }
        assert!(4 * thick > all, "{thick} of {all} where planes lie {apart} cells apart");
    }
}

#[test]
fn cells_without_a_direction_are_given_the_first_axis() {
    let block = Block::new([9; 3]);
    for half in 0..=1 {
        let occupied = marked(&block, |cell| cell.iter().all(|c| c.abs_diff(4) <= half));
        let middle = block.index([4; 3]);
        let wall = walls_of(&block, &occupied).into_iter().find(|wall| wall.cell as usize == middle).unwrap();
        assert_eq!(wall.normal, [1.0, 0.0, 0.0]);
        assert_eq!(wall.sides.map(|s| block.cell(s as usize)), [[5 + half, 4, 4], [3 - half, 4, 4]]);
    }
}

#[test]
fn the_inside_of_a_thick_block_has_no_walls() {
    let block = Block::new([15; 3]);
    let occupied = marked(&block, |_| true);
    let middle = block.index([7; 3]);
    let walls = walls_of(&block, &occupied);
    assert!(walls.iter().all(|wall| wall.cell as usize != middle));
}
