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

use super::Side;
use super::block::Block;
use super::distance::squared;
use super::field::conjugate_gradients;
use super::normal::Wall;

/// Fewer cells of a membrane are left as they are.
const FEW: usize = 9;

/// How far from a membrane cells are asked anew, at the most.
const FAR: f64 = 32.0;

const NONE: u32 = u32::MAX;

/// Stretches the membranes anew.
pub fn stretch(block: &Block, walls: &[Wall], lined: &[bool], sides: &mut [Side]) {
    let size = [block.width, block.rows, block.slices];
    let strides = block.strides();
    let around = |cell: usize| {
        strides.into_iter().flat_map(move |s| [cell.wrapping_add_signed(-s), cell.wrapping_add_signed(s)])
    };
    let mut membrane = vec![false; sides.len()];
    let mut count = 0;
    for cell in (0..sides.len()).filter(|&cell| sides[cell] == Side::Inside && !lined[cell]) {
        if around(cell).any(|next| sides[next] == Side::Outside) {
            membrane[cell] = true;
            count += 1;
        }
    }
    if count < FEW {
        return;
    }
    // The radius of a disc of as many cells.
    let reach = ((f64::from(count as u32) / std::f64::consts::PI).sqrt() + 4.0).min(FAR);
    let far = squared(&membrane, size);
    let mut held: Vec<bool> = far.iter().map(|far| f64::from(*far) > reach * reach).collect();
    drop((far, membrane));
    let parted = |wall: &Wall| sides[wall.sides[0] as usize] != sides[wall.sides[1] as usize];
    walls.iter().filter(|wall| parted(wall)).flat_map(|wall| wall.sides).for_each(|cell| held[cell as usize] = true);
    let mut number = vec![NONE; sides.len()];
    let mut cells = Vec::new();
    for (cell, side) in sides.iter().enumerate() {
        if !held[cell] && *side != Side::Wall && !block.at_border(cell) {
            number[cell] = cells.len() as u32;
            cells.push(cell as u32);
        }
    }
    let sign = |cell: usize| if sides[cell] == Side::Outside { -1.0f32 } else { 1.0 };
    let (mut diagonal, mut b) = (vec![1e-9f32; cells.len()], vec![0f32; cells.len()]);
    for (i, &cell) in cells.iter().enumerate() {
        for next in around(cell as usize).filter(|&next| sides[next] != Side::Wall) {
            diagonal[i] += 1.0;
            if number[next] == NONE {
                b[i] += sign(next);
            }
        }
    }
    let mut pairs = Vec::new();
    for wall in walls {
        let [i, j] = wall.sides.map(|cell| number[cell as usize]);
        match [i, j].map(|n| n != NONE) {
            [true, true] => {
                diagonal[i as usize] += wall.weight;
                diagonal[j as usize] += wall.weight;
                pairs.push(([i, j], wall.weight));
            }
            [true, false] => {
                diagonal[i as usize] += wall.weight;
                b[i as usize] -= wall.weight * sign(wall.sides[1] as usize);
            }
            [false, true] => {
                diagonal[j as usize] += wall.weight;
                b[j as usize] -= wall.weight * sign(wall.sides[0] as usize);
            }
            [false, false] => {}
        }
    }
    let mut u: Vec<f32> = cells.iter().map(|&cell| sign(cell as usize)).collect();
    let product = |x: &[f32], out: &mut [f32]| {
        for (i, &cell) in cells.iter().enumerate() {
            let mut sum = diagonal[i] * x[i];
            for next in around(cell as usize) {
                let j = number[next];
                if j != NONE {
                    sum -= x[j as usize];
                }
            }
            out[i] = sum;
        }
        for &([i, j], weight) in &pairs {
            out[i as usize] += weight * x[j as usize];
            out[j as usize] += weight * x[i as usize];
        }
    };
    conjugate_gradients(product, &diagonal, &b, &mut u);
    for (&cell, u) in cells.iter().zip(&u) {
        sides[cell as usize] = if *u > 0.0 { Side::Inside } else { Side::Outside };
    }
}
