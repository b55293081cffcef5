//! What the field's sign is made of, against naive twins; and the whole of it on bodies and sheets.

mod bodies;
mod field;
mod membrane;
mod normal;
mod outliers;
mod rolling;
mod sheet;
mod sights;
mod signed;
mod support;

use super::block::{Block, PAD};
use crate::grid::Cell;
use crate::resources::workers::Workers;

/// Numbers that look random and are the same for the same seed.
pub struct Numbers(u64);

impl Numbers {
    pub fn new(seed: u64) -> Numbers {
        let mut numbers = Numbers(seed ^ 0x9e37_79b9_7f4a_7c15);
        // Seeds that differ by little give numbers that differ by little at first.
        (0..4).for_each(|_| _ = numbers.part());
        numbers
    }

    /// From 0 to 1.
    pub fn part(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) as f64 / f64::from(1u32 << 31)
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.part()
    }

    pub fn below(&mut self, limit: usize) -> usize {
        (self.part() * limit as f64) as usize
    }

    /// A direction, all of them as likely.
    pub fn direction(&mut self) -> [f64; 3] {
        loop {
            let v = [(); 3].map(|()| self.between(-1.0, 1.0));
            let length = dot(v, v).sqrt();
            if (0.1..1.0).contains(&length) {
                return v.map(|c| c / length);
            }
        }
    }
}

pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

/// Two threads.
pub fn workers() -> Workers {
    Workers::new(2).unwrap()
}

/// The cells of a level for which something holds, in the level's block.
pub fn marked(block: &Block, holds: impl FnMut(&[usize; 3]) -> bool) -> Vec<bool> {
    let mut marks = vec![false; block.size()];
    level(block.cells).filter(holds).for_each(|cell| marks[block.index(cell)] = true);
    marks
}

/// The cells of a level.
pub fn level(cells: Cell) -> impl Iterator<Item = [usize; 3]> {
    let [width, slices, rows] = cells.map(|c| c as usize);
    (0..slices).flat_map(move |y| (0..rows).flat_map(move |z| (0..width).map(move |x| [x, y, z])))
}

/// Places of all cells of a block, in its order; those of the padding included.
pub fn places(block: &Block) -> Vec<[i64; 3]> {
    let mut out = Vec::with_capacity(block.size());
    for y in 0..block.slices as i64 {
        for z in 0..block.rows as i64 {
            out.extend((0..block.width as i64).map(|x| [x, y, z].map(|c| c - PAD as i64)));
        }
    }
    out
}

pub fn numbers_of(cells: &[bool]) -> Vec<u32> {
    (0..cells.len() as u32).filter(|&cell| cells[cell as usize]).collect()
}

pub fn square_between(a: [i64; 3], b: [i64; 3]) -> i64 {
    (0..3).map(|i| (a[i] - b[i]).pow(2)).sum()
}

/// Of each cell that `holds`, the least number of those that a path of such cells joins to it; by sweeps until nothing changes.
pub fn components(block: &Block, holds: &[bool], squared: i64) -> Vec<Option<usize>> {
    let places = places(block);
    let cells: Vec<usize> = (0..holds.len()).filter(|&cell| holds[cell]).collect();
    let mut least: Vec<Option<usize>> = (0..holds.len()).map(|cell| holds[cell].then_some(cell)).collect();
    let mut changed = true;
    while changed {
        changed = false;
        for &a in &cells {
            for &b in &cells {
                if square_between(places[a], places[b]) <= squared && least[b] < least[a] {
                    (least[a], changed) = (least[b], true);
                }
            }
        }
    }
    least
}
