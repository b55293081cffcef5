//! Membranes: where inside and outside meet with no wall between them, the border between them is stretched anew.
//!
//! The ball that rolls round the cloud dips into a hole, and so does the field, which is −1 wherever the ball has been:
//!
//! ```text
//!   # # # .         . # # #        # # # . . . . # # #        # wall, o outside, i inside, f held as it is
//!   f i i \ o o o  / i i f         f ? ? ? ? ? ? ? ? f
//!   f i i i \ _ _ / i i i          f ? ? ? ? ? ? ? ? f        Left: the field's membrane. Right: the cells (?) that are asked anew.
//! ```
//!
//! So the cells round a membrane are asked anew, with those beside walls that part inside and outside held at ±1, and those farther off too. The
//! field that is harmonic in between is as far from the walls on either side, and its membrane is as flat as the rim lets it be.

use std::ops::Range;

use super::block::{Block, Side};
use super::distance::squared;
use super::normal::Wall;
use super::system::System;
use crate::resources::workers::Workers;

/// Fewer cells of a membrane are left as they are.
const FEW: usize = 9;

/// How far from a membrane cells are asked anew, at the most.
const FAR: f64 = 32.0;

/// Membranes are stretched so many times at the most: what is held farther off lies as the membrane before it did, so each is flatter than the one before.
const TIMES: usize = 4;

/// The cells of membranes: inside, beside no wall, beside the outside.
fn cells(block: &Block, lined: &[bool], sides: &[Side]) -> impl Iterator<Item = usize> {
    let is_border = |cell: usize| block.beside(cell).iter().any(|&next| sides[next] == Side::Outside);
    (0..sides.len()).filter(move |&cell| sides[cell] == Side::Inside && !lined[cell] && is_border(cell))
}

/// How many cells membranes have: about as many as a hole has room for, but for its rim.
pub fn count(block: &Block, lined: &[bool], sides: &[Side]) -> u64 {
    cells(block, lined, sides).count() as u64
}

/// Stretches the membranes anew, until they stay where they are; what is `emptied`, if anything is, stays outside.
pub fn stretch(block: &Block, walls: &[Wall], lined: &[bool], emptied: &[bool], sides: &mut [Side], workers: &Workers) {
    for _ in 0..TIMES {
        if !stretch_once(block, walls, lined, emptied, sides, workers) {
            break;
        }
    }
}

/// Whether any cell got another side.
fn stretch_once(
    block: &Block,
    walls: &[Wall],
    lined: &[bool],
    emptied: &[bool],
    sides: &mut [Side],
    workers: &Workers,
) -> bool {
    let size = [block.width, block.rows, block.slices];
    let mut membrane = vec![false; sides.len()];
    let mut count = 0;
    for cell in cells(block, lined, sides) {
        membrane[cell] = true;
        count += 1;
    }
    if count < FEW {
        return false;
    }
    // The radius of a disc of as many cells.
    let reach = ((f64::from(count as u32) / std::f64::consts::PI).sqrt() + 4.0).min(FAR);
    let far = squared(&membrane, size);
    let mut held: Vec<bool> = far.iter().map(|far| f64::from(*far) > reach * reach).collect();
    drop((far, membrane));
    let parted = |wall: &Wall| sides[wall.sides[0] as usize] != sides[wall.sides[1] as usize];
    walls.iter().filter(|wall| parted(wall)).flat_map(|wall| wall.sides).for_each(|cell| held[cell as usize] = true);
    held.iter_mut().zip(emptied).for_each(|(held, empty)| *held |= empty);
    let sign = |cell: usize| if sides[cell] == Side::Outside { -1.0f32 } else { 1.0 };
    let mut open = vec![0f32; sides.len()];
    let mut u = vec![0f32; sides.len()];
    for cell in (0..sides.len()).filter(|&cell| !held[cell] && sides[cell] != Side::Wall && !block.at_border(cell)) {
        (open[cell], u[cell]) = (1.0, sign(cell));
    }
    drop(held);
    let known = |cells: Range<usize>, weights: &mut [f32], held: &mut [f32]| {
        for (weight, side) in weights.iter_mut().zip(&sides[cells.clone()]) {
            *weight = if *side == Side::Wall { 0.0 } else { 1.0 };
        }
        for (to, cell) in held.iter_mut().zip(cells) {
            *to = if open[cell] > 0.0 { 0.0 } else { sign(cell) };
        }
    };
    let mut system = System::new(block, &open, workers, known);
    walls.iter().for_each(|wall| system.across(wall.sides, wall.weight, |other| sign(other as usize)));
    system.solve(&mut u, workers);
    let mut changed = false;
    for (cell, _) in open.iter().enumerate().filter(|(_, open)| **open > 0.0) {
        let side = if u[cell] > 0.0 { Side::Inside } else { Side::Outside };
        changed |= sides[cell] != side;
        sides[cell] = side;
    }
    changed
}
