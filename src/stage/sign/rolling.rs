//! A ball that rolls round the cloud: the cells that it reaches from beyond the box, whatever else becomes of them.
//!
//! A large ball rolls on a coarser copy of the cells, so that it is never more than [`ROUND`] cells wide; a copy's cell is occupied if any of its cells is, so that the ball
//! reaches less there, never more.

use super::block::{Block, PAD};
use super::distance::squared;

/// The radius from which a coarser copy will do.
const ROUND: f64 = 24.0;

/// Of each cell of the block, whether a ball of `radius` cells covers it that touches no occupied cell and can be moved there from far off.
pub fn reached(block: &Block, occupied: &[bool], radius: f64) -> Vec<bool> {
    let mut level = 0u32;
    while radius / f64::from(1 << level) >= ROUND {
        level += 1;
    }
    let radius = radius / f64::from(1u32 << level);
    let limit = (radius * radius).floor() as i32;
    let margin = radius.ceil() as usize + 2;
    let size = [block.width, block.rows, block.slices].map(|n| n.div_ceil(1 << level) + 2 * margin);
    let place = |x: usize, z: usize, y: usize| {
        (((y >> level) + margin) * size[1] + (z >> level) + margin) * size[0] + (x >> level) + margin
    };
    let mut coarse = vec![false; size.iter().product()];
    let mut index = 0;
    for y in 0..block.slices {
        for z in 0..block.rows {
            for x in 0..block.width {
                if occupied[index] {
                    coarse[place(x, z, y)] = true;
                }
                index += 1;
            }
        }
    }
    let far = squared(&coarse, size);
    let centres = filled_from_corner(&far, limit, size);
    let mut covered = squared(&centres, size);
    covered.iter_mut().for_each(|d| *d = i32::from(*d <= limit));
    let mut out = Vec::with_capacity(block.size());
    for y in 0..block.slices {
        for z in 0..block.rows {
            let border = |c: usize, n: usize| c < PAD || c + PAD >= n;
            let padding = border(y, block.slices) || border(z, block.rows);
            out.extend((0..block.width).map(|x| padding || border(x, block.width) || covered[place(x, z, y)] == 1));
        }
    }
    for (out, occupied) in out.iter_mut().zip(occupied) {
        *out &= !occupied;
    }
    out
}

/// The cells farther than `limit` (squared) that hang together by faces with the first cell.
fn filled_from_corner(far: &[i32], limit: i32, size: [usize; 3]) -> Vec<bool> {
    let mut reached = vec![false; far.len()];
    let mut stack = vec![0usize];
    reached[0] = true;
    let strides = [1, size[0], size[0] * size[1]];
    while let Some(cell) = stack.pop() {
        for axis in 0..3 {
            let at = cell / strides[axis] % size[axis];
            let mut visit = |next: usize| {
                if !reached[next] && far[next] > limit {
                    reached[next] = true;
                    stack.push(next);
                }
            };
            if at > 0 {
                visit(cell - strides[axis]);
            }
            if at + 1 < size[axis] {
                visit(cell + strides[axis]);
            }
        }
    }
    reached
}
