//! The ball that rolls, against a ball whose every place is tried.

use proptest::prelude::*;

use super::super::block::{Block, PAD};
use super::super::distance::squared;
use super::super::rolling::reached;
use super::{Numbers, level, marked, places, square_between};

/// Every place of the ball in a box that is wider than the block by the ball, tried one by one.
fn tried(block: &Block, occupied: &[bool], radius: f64) -> Vec<bool> {
    let margin = radius.ceil() as i64 + 3;
    let places = places(block);
    let walls: Vec<[i64; 3]> = (0..places.len()).filter(|&i| occupied[i]).map(|i| places[i]).collect();
    let limit = radius * radius;
    let size = [block.width, block.slices, block.rows].map(|n| n as i64 + 2 * margin);
    let place = |[x, y, z]: [i64; 3]| [x, y, z].map(|c| c - PAD as i64 - margin);
    let number = |[x, y, z]: [i64; 3]| ((y * size[2] + z) * size[0] + x) as usize;
    let mut reached = vec![false; size.iter().product::<i64>() as usize];
    let mut centres = Vec::new();
    let mut stack = vec![[0i64; 3]];
    while let Some(cell) = stack.pop() {
        let inside = (0..3).all(|a| (0..size[a]).contains(&cell[a]));
        if !inside || reached[number(cell)] {
            continue;
        }
        if walls.iter().any(|wall| square_between(*wall, place(cell)) as f64 <= limit) {
            continue;
        }
        reached[number(cell)] = true;
        centres.push(place(cell));
        for axis in 0..3 {
            for step in [-1, 1] {
                let mut next = cell;
                next[axis] += step;
                stack.push(next);
            }
        }
    }
    let padding = |p: [i64; 3]| (0..3).any(|a| p[a] < 0 || p[a] >= i64::from(block.cells[a]));
    let covered = |p: [i64; 3]| centres.iter().any(|c| square_between(*c, p) as f64 <= limit);
    places.iter().zip(occupied).map(|(&p, &occupied)| !occupied && (padding(p) || covered(p))).collect()
}

/// What a ball covers whose middle keeps farther than `clear` from the occupied cells.
fn on_all_cells(block: &Block, occupied: &[bool], clear: f64, radius: f64) -> Vec<bool> {
    let margin = radius.ceil() as usize + 3;
    let size = [block.width, block.rows, block.slices].map(|n| n + 2 * margin);
    let number = |[x, y, z]: [i64; 3]| {
        let [x, y, z] = [x, y, z].map(|c| (c + PAD as i64) as usize + margin);
        (y * size[1] + z) * size[0] + x
    };
    let places = places(block);
    let mut walls = vec![false; size.iter().product()];
    (0..places.len()).filter(|&i| occupied[i]).for_each(|i| walls[number(places[i])] = true);
    let far = squared(&walls, size);
    let mut centres = vec![false; walls.len()];
    let mut stack = vec![0usize];
    while let Some(cell) = stack.pop() {
        if f64::from(far[cell]) <= clear * clear || std::mem::replace(&mut centres[cell], true) {
            continue;
        }
        let at = [cell % size[0], cell / size[0] % size[1], cell / (size[0] * size[1])];
        for (axis, stride) in [1, size[0], size[0] * size[1]].into_iter().enumerate() {
            if at[axis] > 0 {
                stack.push(cell - stride);
            }
            if at[axis] + 1 < size[axis] {
                stack.push(cell + stride);
            }
        }
    }
    let covered = squared(&centres, size);
    let padding = |p: [i64; 3]| (0..3).any(|a| p[a] < 0 || p[a] >= i64::from(block.cells[a]));
    let covered = |p: [i64; 3]| f64::from(covered[number(p)]) <= radius * radius;
    places.iter().zip(occupied).map(|(&p, &occupied)| !occupied && (padding(p) || covered(p))).collect()
}

/// A box with round holes in its walls, and strays in it: some balls get in, others do not.
fn box_with_holes(block: &Block, numbers: &mut Numbers) -> Vec<bool> {
    let far = block.cells.map(|c| c as usize - 1);
    let holes: Vec<([f64; 3], f64)> = (0..1 + numbers.below(3))
        .map(|_| {
            let at = block.cells.map(|c| numbers.between(0.0, f64::from(c)));
            (at, numbers.between(0.2, 0.7) * f64::from(block.cells[0]))
        })
        .collect();
    let mut strays = Numbers::new(numbers.below(1 << 20) as u64);
    marked(block, |cell| {
        let stray = strays.part() < 0.0005;
        let wall = (0..3).any(|a| cell[a] == 0 || cell[a] == far[a]);
        let in_hole = holes
            .iter()
            .any(|(at, radius)| (0..3).map(|a| (cell[a] as f64 - at[a]).powi(2)).sum::<f64>() < radius * radius);
        stray || wall && !in_hole
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn the_ball_reaches_what_it_reaches_when_every_place_is_tried(
        cells in [1u32..9, 1u32..9, 1u32..9],
        radius in 1.0f64..6.0,
        share in 0.0f64..0.5,
        boxed in any::<bool>(),
        seed in any::<u64>(),
    ) {
        let block = Block::new(cells);
        let mut numbers = Numbers::new(seed);
        let occupied = if boxed { box_with_holes(&block, &mut numbers) } else { marked(&block, |_| numbers.part() < share) };
        prop_assert_eq!(reached(&block, &occupied, radius), tried(&block, &occupied, radius));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    /// On a coarser copy, cells that the ball keeps away from may be nearer by the diagonal of a copy's cell.
    #[test]
    fn a_large_ball_reaches_no_more_than_one_that_keeps_away_less(
        cells in [20u32..70, 20u32..70, 20u32..70],
        radius in 24.0f64..56.0,
        seed in any::<u64>(),
    ) {
        let block = Block::new(cells);
        let occupied = box_with_holes(&block, &mut Numbers::new(seed));
        let factor: f64 = if radius < 48.0 { 2.0 } else { 4.0 };
        let clear = radius - (factor - 1.0) * 3f64.sqrt();
        let coarse = reached(&block, &occupied, radius);
        let fine = on_all_cells(&block, &occupied, clear, radius);
        for cell in level(block.cells).map(|cell| block.index(cell)) {
            prop_assert!(!coarse[cell] || fine[cell], "{:?}", block.cell(cell));
        }
    }
}
