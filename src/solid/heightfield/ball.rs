//! The ball that rolls over columns, and the cells and faces below it.

use std::ops::Range;

use super::columns::{DATA, HeightField, HeightFieldOptions, KEPT, LIVE_COLUMN, Lines};
use super::heights::without_pinches;
use crate::error::Result;
use crate::grid::Cell;
use crate::grid::dilate::Ball;
use crate::grid::slice::{Bits, Slices, set_range};

/// The cells of some slices when the ball has rolled over the columns, their number, and each slice's faces.
pub fn filled(
    levels: &Lines<u32>,
    ground: &HeightField,
    slices: Range<u32>,
    cells: Cell,
    asked: HeightFieldOptions,
) -> Result<(Slices, u64, Vec<u32>, Vec<u8>)> {
    let (columns, reach) = (levels.width, i64::from(asked.ball.radius()));
    // A slice below the first, for its faces; and as many as tell what is cut off.
    let beside = if asked.jump.is_some() { CUT } else { 1 };
    let (first, end) = (i64::from(slices.start) - beside, i64::from(slices.end) + beside);
    let tops = levels.read(first - 2 * reach..end + 2 * reach, 0)?;
    let mut flags = ground.flags.read(first..end, 0)?;
    let mut tops = closed(&tops, columns, asked.ball);
    if let Some(jump) = asked.jump {
        cut(&mut flags, &tops, columns, jump);
    }
    let behind = (beside - 1) as usize * columns;
    let held = behind..behind + (slices.len() + 1) * columns;
    let (mut tops, flags) = (tops.drain(held.clone()).collect::<Vec<_>>(), &flags[held]);
    if asked.base {
        tops.iter_mut().zip(flags).filter(|(_, flag)| **flag & KEPT == 0).for_each(|(top, _)| *top = 0);
    }
    let (mut out, mut volume, mut faces) = (Slices::default(), 0, Vec::with_capacity(slices.len()));
    let mut bits = Bits::new(cells[0], cells[2]);
    let mut order: Vec<(u32, u32)> = Vec::new();
    for y in 1..=slices.len() {
        let here = y * columns..(y + 1) * columns;
        let (line, below) = (&tops[here.clone()], &tops[here.start - columns..here.start]);
        let (seen, seen_below) = (&flags[here.clone()], &flags[here.start - columns..here.start]);
        bits.clear();
        if asked.up.axis == 0 {
            for (z, &top) in line.iter().enumerate().filter(|(_, top)| **top > 0) {
                let range = if asked.up.positive { 0..top } else { ground.cells_up - top..ground.cells_up };
                set_range(bits.row_mut(z as u32), range.start, range.end);
            }
        } else {
            // From the bottom up, with ever fewer columns.
            order.clear();
            order.extend(line.iter().zip(0..).map(|(top, x)| (*top, x)));
            order.sort_unstable();
            let mut lower = 0;
            let mut row = vec![0u64; bits.row_words()];
            set_range(&mut row, 0, columns as u32);
            for height in 0..order.last().map_or(0, |(top, _)| *top) {
                while order[lower].0 <= height {
                    let x = order[lower].1;
                    row[x as usize / 64] &= !(1 << (x % 64));
                    lower += 1;
                }
                let z = if asked.up.positive { height } else { ground.cells_up - 1 - height };
                bits.row_mut(z).copy_from_slice(&row);
            }
        }
        volume += line.iter().map(|top| u64::from(*top)).sum::<u64>();
        faces.push(faces_of(
            line,
            below,
            |x| !ground.trimmed || seen[x] & LIVE_COLUMN != 0,
            |x| !ground.trimmed || seen_below[x] & LIVE_COLUMN != 0,
            !ground.trimmed,
        ));
        out.push(&bits);
    }
    Ok((out, volume, faces, flags[columns..].to_vec()))
}

/// Lines on either side that tell whether a column is cut off: its neighbour's, and those of squares of squares.
const CUT: i64 = 4;

/// The steepest that a sheet's bridges may be, in cells for each column.
const STEEPEST: u32 = 4;

/// Keeps no columns any more at the foot of what stands before them by more than `jump` cells, so that no wall joins the two, and no steep bridges.
fn cut(flags: &mut [u8], tops: &[u32], width: usize, jump: u32) {
    let kept = |i: usize| flags[i] & KEPT != 0;
    let stays = |i: usize| {
        let (x, y) = (i % width, i / width);
        let lines = y.saturating_sub(1)..(y + 2).min(tops.len() / width);
        let mut around = lines.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x));
        let is_bridge = flags[i] & DATA == 0;
        let breaks = |other: u32| other > tops[i] + jump || is_bridge && other.abs_diff(tops[i]) > STEEPEST;
        kept(i) && !around.any(|other| kept(other) && breaks(tops[other]))
    };
    let left: Vec<bool> = (0..tops.len()).map(stays).collect();
    for (flag, kept) in flags.iter_mut().zip(without_pinches(&left, width)) {
        *flag = *flag & !KEPT | if kept { KEPT } else { 0 };
    }
}

/// The faces of a slice's columns of these heights that are made: on top, to the columns before them and to those of the slice below, and, of a closed
/// solid, at the bottom and beyond its ends.
fn faces_of(
    line: &[u32],
    below: &[u32],
    is_live: impl Fn(usize) -> bool,
    is_live_below: impl Fn(usize) -> bool,
    whole: bool,
) -> u32 {
    let mut faces = 0;
    for (x, &top) in line.iter().enumerate().filter(|(x, _)| is_live(*x)) {
        faces += if whole { 2 * u32::from(top > 0) } else { 1 };
        let before = if x > 0 && is_live(x - 1) {
            line[x - 1]
        } else if whole {
            0
        } else {
            top
        };
        let under = if is_live_below(x) { below[x] } else { top };
        faces += top.abs_diff(before) + top.abs_diff(under);
    }
    faces + if whole { line[line.len() - 1] } else { 0 }
}

/// Heights when the ball has rolled over them, without as many lines as it reaches, twice, at either end: dilation, then erosion. Beyond the box all
/// heights are 0.
fn closed(tops: &[u32], width: usize, ball: Ball) -> Vec<u32> {
    let pad = 2 * ball.radius() as usize;
    let wide = width + 2 * pad;
    let mut padded = vec![0; tops.len() / width * wide];
    for (padded, line) in padded.chunks_exact_mut(wide).zip(tops.chunks_exact(width)) {
        padded[pad..pad + width].copy_from_slice(line);
    }
    let higher = rolled(&padded, wide, ball, |a, b, height| a.max(b + height), 0);
    let lower = rolled(&higher, wide, ball, |a, b, height| a.min(b.saturating_sub(height)), u32::MAX);
    lower.chunks_exact(wide).flat_map(|line| &line[pad..pad + width]).copied().collect()
}

/// For each column: what `best` makes of the columns within the ball and the ball's height there. The lines that the ball reaches beyond at either end are left out. Of as
/// many columns at the ends of lines it is not the true one.
fn rolled(tops: &[u32], width: usize, ball: Ball, best: impl Fn(u32, u32, u32) -> u32, start: u32) -> Vec<u32> {
    let reach = ball.radius() as usize;
    let rows = tops.len() / width;
    let mut out = vec![start; (rows - 2 * reach) * width];
    for (y, line) in out.chunks_exact_mut(width).enumerate() {
        for dy in 0..=2 * reach {
            for dx in 0..=2 * reach {
                let [away_y, away_x] = [dy, dx].map(|d| d.abs_diff(reach) as u32);
                let Some(height) = ball.half_width(away_y, away_x) else { continue };
                let from = &tops[(y + dy) * width + dx..(y + dy + 1) * width];
                let inner = reach..width - reach;
                line[inner].iter_mut().zip(from).for_each(|(out, top)| *out = best(*out, *top, height));
            }
        }
    }
    out
}
