//! A ball that rolls round the cloud: the cells that it reaches from beyond the box, whatever else becomes of them.
//!
//! A large ball rolls on a coarser copy of the cells, so that it is never more than [`ROUND`] cells wide; a copy's cell is occupied if any of its cells is, so that the ball
//! mostly reaches less there. Never does it come nearer to an occupied cell than by (f − 1) √3 cells more than a ball on the block itself, f being the copy's factor.

use rayon::prelude::*;

use super::block::{Block, PAD};
use crate::grid::dilate::{Ball, Dilation};
use crate::grid::slice::{Bits, set_range};

/// The radius from which a coarser copy will do.
const ROUND: f64 = 24.0;

/// Whether a ball of `radius` cells covers each cell of the block, if it touches no occupied cell and can be moved there from far off. Memory: a few bits for each cell
/// of a box that is larger by the ball on every side.
pub fn reached(block: &Block, occupied: &[bool], radius: f64) -> Vec<bool> {
    let mut level = 0u32;
    while radius / f64::from(1 << level) >= ROUND {
        level += 1;
    }
    let radius = radius / f64::from(1u32 << level);
    let ball = Ball::squared((radius * radius).floor() as u32);
    let margin = radius.ceil() as usize + 2;
    let [width, rows, slices] = [block.width, block.rows, block.slices].map(|n| n.div_ceil(1 << level) + 2 * margin);
    let empty = Bits::new(width as u32, rows as u32);
    let place = |c: usize| (c >> level) + margin;
    let mut coarse = vec![empty.clone(); slices];
    for (row, cells) in occupied.chunks(block.width).enumerate().filter(|(_, cells)| cells.contains(&true)) {
        let row = coarse[place(row / block.rows)].row_mut(place(row % block.rows) as u32);
        let mut at = 0;
        while let Some(start) = cells[at..].iter().position(|is| *is).map(|first| at + first) {
            at = cells[start..].iter().position(|is| !is).map_or(cells.len(), |length| start + length);
            set_range(row, place(start) as u32, place(at - 1) as u32 + 1);
        }
    }
    let mut free = dilated(&coarse, ball);
    drop(coarse);
    free.iter_mut().for_each(Bits::complement);
    let centres = filled_from_corner(&free);
    drop(free);
    let covered = dilated(&centres, ball);
    let border = |c: usize, n: usize| c < PAD || c + PAD >= n;
    let columns: Vec<(usize, usize)> = (0..block.width).map(|x| (place(x) / 64, place(x) % 64)).collect();
    let mut out = vec![false; block.size()];
    let rows = out.par_chunks_mut(block.width).zip(occupied.par_chunks(block.width)).enumerate();
    rows.with_min_len(block.rows).for_each(|(row, (out, occupied))| {
        let (y, z) = (row / block.rows, row % block.rows);
        if border(y, block.slices) || border(z, block.rows) {
            out.fill(true);
        } else {
            let bits = covered[place(y)].row(place(z) as u32);
            out.iter_mut().zip(&columns).for_each(|(out, (word, bit))| *out = bits[*word] >> bit & 1 == 1);
            out[..PAD].fill(true);
            out[block.width - PAD..].fill(true);
        }
        out.iter_mut().zip(occupied).for_each(|(out, occupied)| *out &= !occupied);
    });
    out
}

/// The slices with all cells in the ball round a set one. The work is dealt out to the pool that it is called in, in as many parts as it has threads.
fn dilated(slices: &[Bits], ball: Ball) -> Vec<Bits> {
    let (width, rows) = (slices[0].width(), slices[0].row_count());
    let each = slices.len().div_ceil(rayon::current_num_threads());
    let part = |first: usize| {
        let end = (first + each).min(slices.len());
        let mut dilation = Dilation::new(ball, width, rows, end as i64);
        let slice = |y: usize| {
            let slice = dilation.slide_to(y as i64, |y, bits| {
                match usize::try_from(y).ok().and_then(|y| slices.get(y)) {
                    Some(slice) => bits.clone_from(slice),
                    None => bits.clear(),
                }
                Ok(())
            });
            slice.expect("nothing is read").clone()
        };
        (first..end).map(slice).collect::<Vec<Bits>>()
    };
    let firsts: Vec<usize> = (0..slices.len()).step_by(each).collect();
    let parts: Vec<Vec<Bits>> = firsts.into_par_iter().map(part).collect();
    parts.into_iter().flatten().collect()
}

/// The free cells that hang together by faces with the first cell: found slice by slice, up and down, until no slice gains a cell. A slice is looked at again if it, or one beside it,
/// has gained cells since.
fn filled_from_corner(free: &[Bits]) -> Vec<Bits> {
    let (rows, count) = (free[0].row_count(), free.len());
    let mut reached = vec![Bits::new(free[0].width(), rows); count];
    reached[0].set(0, 0);
    let mut waits = vec![true; count];
    while waits.contains(&true) {
        for y in (0..count).chain((0..count).rev()) {
            if !std::mem::take(&mut waits[y]) {
                continue;
            }
            let mut changed = false;
            let mut here = std::mem::replace(&mut reached[y], Bits::new(0, 0));
            for beside in [y.checked_sub(1), Some(y + 1).filter(|y| *y < count)].into_iter().flatten() {
                for z in 0..rows {
                    if let Some(row) = reached[beside].lit_row(z) {
                        changed |= spread(here.row_mut(z), row, free[y].row(z));
                    }
                }
            }
            let mut row_before = vec![0; here.row_words()];
            for rows in [&mut (0..rows) as &mut dyn Iterator<Item = u32>, &mut (0..rows).rev()] {
                row_before.fill(0);
                for z in rows {
                    changed |= spread(here.row_mut(z), &row_before, free[y].row(z));
                    row_before.copy_from_slice(here.row(z));
                }
            }
            reached[y] = here;
            if changed {
                waits[y.saturating_sub(1)..(y + 2).min(count)].fill(true);
            }
        }
    }
    reached
}

/// Adds the free cells of `from`, and all free ones in a row with them. Whether there were any new ones.
fn spread(row: &mut [u64], from: &[u64], free: &[u64]) -> bool {
    if row.iter().zip(from).zip(free).all(|((row, from), free)| from & free & !row == 0) {
        return false;
    }
    row.iter_mut().zip(from).zip(free).for_each(|((row, from), free)| *row |= from & free);
    let mut carry = 0;
    for (row, free) in row.iter_mut().zip(free) {
        let (mut found, mut path) = (*row | carry & free, *free);
        for step in [1, 2, 4, 8, 16, 32] {
            found |= path & found << step;
            path &= path << step;
        }
        (*row, carry) = (found, found >> 63);
    }
    carry = 0;
    for (row, free) in row.iter_mut().zip(free).rev() {
        let (mut found, mut path) = (*row | carry & free, *free);
        for step in [1, 2, 4, 8, 16, 32] {
            found |= path & found >> step;
            path &= path >> step;
        }
        (*row, carry) = (found, found << 63);
    }
    true
}
