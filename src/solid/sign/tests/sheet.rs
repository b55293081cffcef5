//! Sheets, against twins that look at every cell.

use proptest::prelude::*;

use super::super::Side;
use super::super::block::Block;
use super::super::normal::{WEIGHT, Wall};
use super::super::sheet::{SheetWall, continued, find, weigh};
use super::{Numbers, components, marked, numbers_of, places, square_between};

fn random_sides(block: &Block, occupied: &[bool], share: f64, numbers: &mut Numbers) -> Vec<Side> {
    let inside = marked(block, |_| numbers.part() < share);
    let side = |(occupied, inside): (&bool, &bool)| match (occupied, inside) {
        (true, _) => Side::Wall,
        (_, true) => Side::Inside,
        _ => Side::Outside,
    };
    occupied.iter().zip(&inside).map(side).collect()
}

/// Walls that have the cells before and behind them on a side each.
fn walls_across(block: &Block, occupied: &[bool], axis: usize) -> Vec<Wall> {
    let mut normal = [0.0; 3];
    normal[axis] = 1.0;
    let step = block.strides()[axis];
    let wall = |cell: u32| {
        let sides = [step, -step].map(|step| (cell as usize).wrapping_add_signed(step) as u32);
        Wall { cell, sides, normal, weight: WEIGHT }
    };
    numbers_of(occupied).into_iter().map(wall).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn sheets_are_the_large_patches_with_the_outside_on_both_sides(
        seed in any::<u64>(),
        share in 0.02f64..0.2,
        inside in 0.0f64..0.3,
        axis in 0usize..3,
    ) {
        let mut numbers = Numbers::new(seed);
        let block = Block::new([11, 9, 10]);
        let occupied = marked(&block, |_| numbers.part() < share);
        let sides = random_sides(&block, &occupied, inside, &mut numbers);
        let walls = walls_across(&block, &occupied, axis);
        let open: Vec<bool> = (0..occupied.len() as u32)
            .map(|cell| {
                let at = walls.iter().find(|wall| wall.cell == cell);
                at.is_some_and(|wall| wall.sides.iter().all(|side| sides[*side as usize] == Side::Outside))
            })
            .collect();
        let patches = components(&block, &open, 3);
        let mut expected: Vec<Vec<u32>> = (0..open.len())
            .filter(|&first| patches[first] == Some(first))
            .map(|first| (0..open.len() as u32).filter(|&cell| patches[cell as usize] == Some(first)).collect())
            .filter(|patch: &Vec<u32>| patch.len() >= 27)
            .collect();
        let found = find(&block, &walls, &sides, Side::Outside);
        prop_assert!(found.is_sorted_by_key(|sheet| std::cmp::Reverse(sheet.walls.len())));
        let mut found: Vec<Vec<u32>> = found.into_iter().map(|sheet| sheet.walls).collect();
        found.iter_mut().for_each(|walls| walls.sort_unstable());
        found.sort();
        expected.sort();
        prop_assert_eq!(found, expected);
    }

    /// Walls near a sheet's wall that face as it does, and lie in its plane.
    #[test]
    fn sheets_go_on_in_their_planes(seed in any::<u64>(), share in 0.02f64..0.3, of_sheets in 0.0f64..0.4) {
        let mut numbers = Numbers::new(seed);
        let block = Block::new([14, 13, 15]);
        let occupied = marked(&block, |_| numbers.part() < share);
        let mut walls = walls_across(&block, &occupied, 0);
        for wall in &mut walls {
            let normal = numbers.direction().map(|c| c as f32);
            wall.normal = if numbers.part() < 0.5 { [-1.0, 0.0, 0.0] } else { normal };
        }
        let sheets: Vec<u32> = walls.iter().map(|wall| wall.cell).filter(|_| numbers.part() < of_sheets).collect();
        let found = continued(&block, &walls, &sheets);
        let places = places(&block);
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let goes_on = |wall: &Wall| {
            walls.iter().filter(|other| sheets.contains(&other.cell)).any(|other| {
                let [here, there] = [wall, other].map(|wall| places[wall.cell as usize]);
                let apart = [0, 1, 2].map(|a| here[a] as f32 - there[a] as f32);
                square_between(here, there) <= 36
                    && dot(apart, other.normal).abs() <= 1.0
                    && dot(wall.normal, other.normal).abs() >= 0.85
            })
        };
        let expected: Vec<SheetWall> = walls
            .iter()
            .filter(|wall| sheets.contains(&wall.cell) || goes_on(wall))
            .map(|wall| SheetWall { cell: wall.cell, normal: wall.normal })
            .collect();
        prop_assert_eq!(found, expected);
    }

    /// Of the walls round a wall that face as it does, most part nothing.
    #[test]
    fn walls_lose_their_weight_where_most_round_them_part_nothing(
        seed in any::<u64>(),
        share in 0.02f64..0.3,
        nothing in 0.2f64..0.8,
    ) {
        let mut numbers = Numbers::new(seed);
        let block = Block::new([14, 13, 15]);
        let occupied = marked(&block, |_| numbers.part() < share);
        let mut walls = walls_across(&block, &occupied, 0);
        for wall in &mut walls {
            let normal = numbers.direction();
            wall.normal = if numbers.part() < 0.5 { [1.0, 0.0, 0.0] } else { normal.map(|c| c as f32) };
            if numbers.part() < 0.1 {
                wall.weight = 0.1;
            }
        }
        let parts_nothing: Vec<bool> = walls.iter().map(|_| numbers.part() < nothing).collect();
        let before = walls.clone();
        let count = weigh(&block, &mut walls, &parts_nothing);
        let places = places(&block);
        let mut expected = 0;
        for (wall, after) in before.iter().zip(&walls) {
            let like = |other: &&(&Wall, bool)| {
                let along: f32 = (0..3).map(|a| other.0.normal[a] * wall.normal[a]).sum();
                square_between(places[wall.cell as usize], places[other.0.cell as usize]) <= 36 && along.abs() >= 0.85
            };
            let all: Vec<(&Wall, bool)> = before.iter().zip(parts_nothing.iter().copied()).collect();
            let all: Vec<bool> = all.iter().filter(like).map(|other| other.1).collect();
            let loses = wall.weight == WEIGHT && 2 * all.iter().filter(|n| **n).count() > all.len();
            expected += usize::from(loses);
            prop_assert_eq!(after.weight < wall.weight, loses);
        }
        prop_assert_eq!(count, expected);
    }
}
