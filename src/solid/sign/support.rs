//! Support: whether what the field calls inside is lined by walls, or lies bare.
//!
//! ```text
//!   # # # # # #            . . . . .           i inside, # occupied, . outside
//!   # i i i i .            . i i i .           Left: a body with a hole; few cells of its border are bare.
//!   # i i i i .          # i i i i i #         Right: what a dome, seen from below, holds; as many are bare as are lined.
//!   # # # # # #            # # # # #
//! ```
//!
//! A wall lines what lies on one side of it only if the outside is on its other side. A pocket between a floor and the body over it, or a slot that was filled, has the
//! inside of the body behind its walls; it is as bare as if they were not there.

use std::ops::Range;

use rayon::prelude::*;

use super::block::Block;
use super::field::{BARE, Field};
use super::normal::Wall;

/// A part of a component is judged by itself if no more than this part of its border leads to other parts,
const NECK: f64 = 0.6;

/// and if its border has so many faces.
const LARGE: f64 = 30.0;

/// What of the inside is bare.
#[derive(Debug, PartialEq, Eq)]
pub struct Bare {
    /// Whether each cell of the block belongs to a bare component, or to a bare part of one.
    pub cells: Vec<bool>,
    /// As `cells`, of whole components only.
    pub whole: Vec<bool>,
}

/// Finds what of the inside is bare; none if nothing is. A component is bare for want of walls. A large part of it ([`parts`]) that narrow necks join to others
/// is judged by itself; a wall with another part behind it lines neither of both.
pub fn bare(field: &Field<'_>, walls: &[Wall]) -> Option<Bare> {
    let inside = field.inside();
    let of_components = {
        let (of, count) = numbered(field.block, &inside);
        let borders = borders(field, &of, count);
        marked(&of, &borders, |border| border.open as f64 > BARE * border.all())
    };
    let (of, count) = parts(field, &inside);
    let mut borders = borders(field, &of, count);
    for [a, b] in walls.iter().map(|wall| wall.sides.map(|cell| of[cell as usize])) {
        if a != 0 && b != 0 && a != b {
            [a, b].into_iter().for_each(|number| borders[number as usize].shared += 1);
        }
    }
    let of_parts = marked(&of, &borders, |border| {
        let shared = border.shared.min(border.lined) as f64;
        let alone = border.all() >= LARGE && border.neck as f64 <= NECK * border.all();
        alone && border.open as f64 + shared > BARE * border.all()
    });
    match (of_components, of_parts) {
        (None, None) => None,
        (None, Some(cells)) => Some(Bare { whole: vec![false; cells.len()], cells }),
        (Some(whole), None) => Some(Bare { cells: whole.clone(), whole }),
        (Some(whole), Some(mut cells)) => {
            cells.iter_mut().zip(&whole).for_each(|(cell, whole)| *cell |= whole);
            Some(Bare { cells, whole })
        }
    }
}

/// Bytes that [`bare`] takes beside the field, in a block of so many cells of which so many are lined: three flags, two numbers for each cell; and for each that is lined, its own and
/// its component's number, in vectors that grow, or as many runs of cells, each of them likewise, with its root and number.
pub fn bytes(cells: u64, lined: u64) -> u64 {
    let (of_lined, of_run) = (4 * size_of::<u32>(), 2 * size_of::<Range<usize>>() + 2 * size_of::<u32>());
    cells * (3 + 2 * size_of::<u32>() as u64) + lined * of_lined.max(of_run) as u64
}

/// Whether each cell belongs to a component whose border passes `is`; `None` if none does.
fn marked(of: &[u32], borders: &[Border], is: impl Fn(&Border) -> bool) -> Option<Vec<bool>> {
    let is: Vec<bool> = borders.iter().map(is).collect();
    is.contains(&true).then(|| of.par_iter().with_min_len(ALONE).map(|&number| is[number as usize]).collect())
}

/// The borders of what has these numbers, from 1 on.
fn borders(field: &Field<'_>, of: &[u32], count: u32) -> Vec<Border> {
    let none = || vec![Border::default(); count as usize + 1];
    let (slice, [a, b, c]) = (field.block.rows * field.block.width, field.block.strides());
    let add = |mut borders: Vec<Border>, (y, cells): (usize, &[u32])| {
        let Some(first) = cells.iter().position(|number| *number != 0) else { return borders };
        let last = cells.iter().rposition(|number| *number != 0).unwrap_or(first);
        let from = y * slice + first;
        let rows = [0, -a, a, -b, b, -c, c].map(|step| &of[from.wrapping_add_signed(step)..][..last + 1 - first]);
        for (i, &number) in rows[0].iter().enumerate() {
            let next = [1, 2, 3, 4, 5, 6].map(|row: usize| rows[row][i]);
            if number == 0 || next.iter().fold(0, |differ, next| differ | (next ^ number)) == 0 {
                continue;
            }
            let cell = from + i;
            let border = &mut borders[number as usize];
            for (next, of) in field.block.beside(cell).into_iter().zip(next).filter(|(_, of)| *of != number) {
                match of {
                    0 if field.is_open(cell, next) => border.open += 1,
                    0 => border.lined += 1,
                    _ => border.neck += 1,
                }
            }
        }
        borders
    };
    let both = |mut one: Vec<Border>, other: Vec<Border>| {
        one.iter_mut().zip(other).for_each(|(one, other)| one.add(other));
        one
    };
    of.par_chunks(slice).enumerate().fold(none, add).reduce(none, both)
}

/// How many layers of cells beside walls belong to the part that they lie on. Beside a wall askew to all axes there are three.
///
/// ```text
///   i i i i i i i       i: beside no wall, so that it holds the part together
///   3 3 2 2 1 1 1       1, 2, 3: beside a wall (one of the 26 round it is occupied), in the round that takes them
///   # 3 3 3 2 2 2
///   . # # # 3 3 3
/// ```
const LAYERS: usize = 3;

/// Parts of the components of what is `inside`, numbered from 1 on, and how many there are. They hang together by faces of cells that lie beside no wall, so that what leads through a
/// hole between samples parts them. [`LAYERS`] times, cells beside walls join the first part next to them. What is left then are parts of its own.
fn parts(field: &Field<'_>, inside: &[bool]) -> (Vec<u32>, u32) {
    let core: Vec<bool> = inside.iter().zip(&field.lined).map(|(inside, lined)| inside & !lined).collect();
    let (mut of, count) = numbered(field.block, &core);
    let cells = (0..of.len() as u32).into_par_iter().with_min_len(ALONE);
    let mut left: Vec<u32> = cells.filter(|&cell| inside[cell as usize] & field.lined[cell as usize]).collect();
    for _ in 0..LAYERS {
        let first_beside = |&cell: &u32| {
            let beside = field.block.beside(cell as usize).into_iter().map(|next| of[next]);
            beside.filter(|number| *number != 0).min().unwrap_or(0)
        };
        let numbers: Vec<u32> = left.par_iter().with_min_len(ALONE).map(first_beside).collect();
        left.iter().zip(&numbers).for_each(|(&cell, &number)| of[cell as usize] = number);
        let mut numbers = numbers.into_iter();
        left.retain(|_| numbers.next() == Some(0));
    }
    if left.is_empty() {
        return (of, count);
    }
    let mut alone = vec![false; of.len()];
    left.iter().for_each(|&cell| alone[cell as usize] = true);
    let (others, more) = numbered(field.block, &alone);
    left.iter().for_each(|&cell| of[cell as usize] = count + others[cell as usize]);
    (of, count + more)
}

/// The number of cells that one thread takes at a time.
const ALONE: usize = 1 << 14;

/// Numbers the components of some cells, none of which lies at the block's border, from 1 on, in the order of their first cells; and tells how many there are. Cells that share a face belong together. Runs of
/// cells in a row are joined where they overlap with those of the rows before.
fn numbered(block: &Block, is: &[bool]) -> (Vec<u32>, u32) {
    let slice = block.rows * block.width;
    let runs_of = |y: usize| {
        let (mut runs, mut ends): (Vec<Range<usize>>, Vec<usize>) = (Vec::new(), Vec::with_capacity(block.rows));
        for row in (y * slice..(y + 1) * slice).step_by(block.width) {
            let (cells, mut at) = (&is[row..row + block.width], 0);
            while let Some(first) = cells[at..].iter().position(|is| *is) {
                let start = at + first;
                let end = cells[start..].iter().position(|is| !is).map_or(cells.len(), |length| start + length);
                runs.push(row + start..row + end);
                at = end;
            }
            ends.push(runs.len());
        }
        (runs, ends)
    };
    let slices: Vec<_> = (0..block.slices).into_par_iter().map(runs_of).collect();
    let mut runs: Vec<Range<usize>> = Vec::with_capacity(slices.iter().map(|(runs, _)| runs.len()).sum());
    let mut firsts: Vec<usize> = vec![0];
    for (of_slice, ends) in slices {
        let before = runs.len();
        runs.extend(of_slice);
        firsts.extend(ends.into_iter().map(|end| before + end));
    }
    let mut roots: Vec<u32> = (0..runs.len() as u32).collect();
    for row in 0..firsts.len() - 1 {
        for (rows, cells) in [(1, block.width), (block.rows, slice)] {
            if row < rows {
                continue;
            }
            let mut others = firsts[row - rows]..firsts[row - rows + 1];
            let mut own = firsts[row]..firsts[row + 1];
            while !own.is_empty() && !others.is_empty() {
                let (run, other) = (&runs[own.start], &runs[others.start]);
                let other = other.start + cells..other.end + cells;
                if run.start < other.end && other.start < run.end {
                    join(&mut roots, own.start as u32, others.start as u32);
                }
                if run.end < other.end {
                    own.start += 1;
                } else {
                    others.start += 1;
                }
            }
        }
    }
    let (mut of, mut count) = (vec![0u32; block.size()], 0);
    let mut numbers = vec![0u32; runs.len()];
    for (i, run) in runs.into_iter().enumerate() {
        // The root is the first run.
        let first = root(&mut roots, i as u32) as usize;
        if first == i {
            count += 1;
            numbers[i] = count;
        }
        of[run].fill(numbers[first]);
    }
    (of, count)
}

/// Joins the components of two runs, whose root is the first run of both.
fn join(roots: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(roots, a), root(roots, b));
    roots[a.max(b) as usize] = a.min(b);
}

/// The first run of a component.
fn root(roots: &mut [u32], mut run: u32) -> u32 {
    while roots[run as usize] != run {
        roots[run as usize] = roots[roots[run as usize] as usize];
        run = roots[run as usize];
    }
    run
}

/// A border, in faces of cells.
#[derive(Debug, Clone, Copy, Default)]
struct Border {
    lined: u64,
    open: u64,
    /// Faces to other parts.
    neck: u64,
    /// Walls that have another part behind them.
    shared: u64,
}

impl Border {
    fn add(&mut self, other: Border) {
        self.lined += other.lined;
        self.open += other.open;
        self.neck += other.neck;
        self.shared += other.shared;
    }

    fn all(&self) -> f64 {
        (self.open + self.lined + self.neck) as f64
    }
}
