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
//!
//! The block ends a few cells beyond the cloud, and were u held at −1 there, it would press a membrane that faces the border into the body. So the border is no wall, but lets
//! through as much as the space beyond it would:
//!
//! ```text
//!   - - - - - - - - -  border       k - - - - - - - k           k: u + 1 = -∂u/∂n / k, k = 4 / (π radius)
//!   # # # _     _ # # #             # # # _ _ _ _ # # #
//!   #       \_/       #             #                 #          Left: held at −1. Right: as the space beyond would.
//! ```

use std::ops::Range;

use super::block::{Block, Side};
use super::distance::squared;
use super::normal::Wall;
use super::system::System;
use crate::resources::workers::Workers;

/// If no membrane has so many cells, all stay where they are, and u is found for what the surface is made of alone: where few cells alone are unlined, walls are near on all sides,
/// and what a membrane would yield may be a wall's gap.
const FEW: usize = 9;

/// How far from a membrane cells are asked anew, at the most.
const FAR: f64 = 32.0;

/// Membranes are stretched so many times at the most: what is held farther off lies as the membrane before it did, so each is flatter than the one before.
const TIMES: usize = 4;

/// The squared distance from a membrane's cells up to which u is kept ([`crate::solid::membranes`]).
const NEAR: i32 = 25;

/// The cells of membranes: inside, beside no wall, beside the outside.
fn cells(block: &Block, lined: &[bool], sides: &[Side]) -> impl Iterator<Item = usize> {
    let is_border = |cell: usize| block.beside(cell).iter().any(|&next| sides[next] == Side::Outside);
    (0..sides.len()).filter(move |&cell| sides[cell] == Side::Inside && !lined[cell] && is_border(cell))
}

/// The most cells that one membrane has; its cells are joined by faces, edges and corners.
fn largest(block: &Block, membrane: &[bool]) -> usize {
    let around = block.around();
    let mut waits = membrane.to_vec();
    let (mut most, mut stack) = (0, Vec::new());
    for cell in 0..waits.len() {
        let mut count = 0;
        stack.extend(std::mem::take(&mut waits[cell]).then_some(cell));
        while let Some(cell) = stack.pop() {
            count += 1;
            let beside = around.iter().map(|step| cell.wrapping_add_signed(*step));
            stack.extend(beside.filter(|&next| std::mem::take(&mut waits[next])));
        }
        most = most.max(count);
    }
    most
}

/// What a face to the block's border weighs, where a membrane is a disc of that radius: as much as the free space beyond would let through. A disc that is held at 1 has
/// ∂u/∂n = 4 / (π radius) in the mean on either side, if u is 0 far off.
fn weight_of_border(radius: f64) -> f32 {
    (4.0 / (std::f64::consts::PI * radius)).min(1.0) as f32
}

/// How many cells membranes have: about as many as a hole has room for, but for its rim.
pub fn count(block: &Block, lined: &[bool], sides: &[Side]) -> u64 {
    cells(block, lined, sides).count() as u64
}

/// Stretches the membranes anew, until they stay where they are; what is `emptied`, if anything is, stays outside. Gives u in the cells near membranes, in their order.
pub fn stretch(
    block: &Block,
    walls: &[Wall],
    lined: &[bool],
    emptied: &[bool],
    sides: &mut [Side],
    workers: &Workers,
) -> Vec<(u32, f32)> {
    let mut last: Option<Vec<f32>> = None;
    for _ in 0..TIMES {
        let from = last.take();
        let Some(Stretched { u, changed }) = stretch_once(block, walls, lined, emptied, (sides, from), workers) else {
            break;
        };
        last = Some(u);
        if !changed {
            break;
        }
    }
    last.map_or_else(Vec::new, |u| near_membranes(block, lined, sides, &u))
}

/// What comes of stretching.
struct Stretched {
    /// The u of each cell of the block: 0 on walls, and ±1 where it was held.
    u: Vec<f32>,
    /// Whether any cell got another side.
    changed: bool,
}

/// Stretches the membranes once, `from` the u of the time before; none if there is no membrane.
fn stretch_once(
    block: &Block,
    walls: &[Wall],
    lined: &[bool],
    emptied: &[bool],
    (sides, from): (&mut [Side], Option<Vec<f32>>),
    workers: &Workers,
) -> Option<Stretched> {
    let size = [block.width, block.rows, block.slices];
    let mut membrane = vec![false; sides.len()];
    cells(block, lined, sides).for_each(|cell| membrane[cell] = true);
    let count = largest(block, &membrane);
    if count == 0 {
        return None;
    }
    // Of a disc of as many cells.
    let radius = (f64::from(count as u32) / std::f64::consts::PI).sqrt();
    let reach = (radius + 4.0).min(FAR);
    let border = weight_of_border(radius);
    let far = squared(&membrane, size);
    let mut held: Vec<bool> = far.iter().map(|far| f64::from(*far) > reach * reach).collect();
    drop((far, membrane));
    let parted = |wall: &Wall| sides[wall.sides[0] as usize] != sides[wall.sides[1] as usize];
    walls.iter().filter(|wall| parted(wall)).flat_map(|wall| wall.sides).for_each(|cell| held[cell as usize] = true);
    held.iter_mut().zip(emptied).for_each(|(held, empty)| *held |= empty);
    let sign = |side: Side| if side == Side::Outside { -1.0f32 } else { 1.0 };
    let mut open = vec![0f32; sides.len()];
    let is_first = from.is_none();
    let mut u = from.unwrap_or_else(|| vec![0f32; sides.len()]);
    for cell in (0..sides.len()).filter(|&cell| !held[cell] && sides[cell] != Side::Wall && !block.at_border(cell)) {
        open[cell] = 1.0;
        if is_first {
            u[cell] = sign(sides[cell]);
        }
    }
    drop(held);
    let known = |cells: Range<usize>, weights: &mut [f32], held: &mut [f32]| {
        for (weight, cell) in weights.iter_mut().zip(cells.clone()) {
            *weight = match sides[cell] {
                Side::Wall => 0.0,
                _ if block.at_border(cell) => border,
                _ => 1.0,
            };
        }
        for (to, cell) in held.iter_mut().zip(cells) {
            *to = if open[cell] > 0.0 { 0.0 } else { sign(sides[cell]) };
        }
    };
    let mut system = System::new(block, &open, workers, known);
    walls.iter().for_each(|wall| system.across(wall.sides, wall.weight, |other| sign(sides[other as usize])));
    system.solve(&mut u, workers);
    let mut changed = false;
    for (cell, u) in u.iter_mut().enumerate() {
        if open[cell] == 0.0 {
            *u = if sides[cell] == Side::Wall { 0.0 } else { sign(sides[cell]) };
        } else if count >= FEW {
            let side = if *u > 0.0 { Side::Inside } else { Side::Outside };
            changed |= sides[cell] != side;
            sides[cell] = side;
        }
    }
    Some(Stretched { u, changed })
}

/// The cells near membranes with their u, in their order.
fn near_membranes(block: &Block, lined: &[bool], sides: &[Side], u: &[f32]) -> Vec<(u32, f32)> {
    let mut membrane = vec![false; sides.len()];
    cells(block, lined, sides).for_each(|cell| membrane[cell] = true);
    let far = squared(&membrane, [block.width, block.rows, block.slices]);
    (0u32..).zip(far.iter().zip(u)).filter(|(_, (far, _))| **far <= NEAR).map(|(cell, (_, u))| (cell, *u)).collect()
}
