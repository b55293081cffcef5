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

use super::field::Field;
use super::normal::Wall;

/// A component is bare if this part of its border is.
const BARE: f64 = 0.25;

/// A part of a component is judged by itself if no more than this part of its border leads to other parts,
const NECK: f64 = 0.6;

/// and if its border has so many faces.
const LARGE: f64 = 30.0;

/// What of the inside is bare.
#[derive(Debug, PartialEq, Eq)]
pub struct Bare {
    /// Of each cell of the block, whether it belongs to a component that is bare, or a part of one.
    pub cells: Vec<bool>,
    /// As `cells`, of whole components only.
    pub whole: Vec<bool>,
}

/// Finds what of the inside is bare; none if nothing is. A component is bare for want of walls. A large part of it ([`parts`]) that narrow necks join to others
/// is judged by itself; a wall with another part behind it lines neither of both.
pub fn bare(field: &Field<'_>, walls: &[Wall]) -> Option<Bare> {
    let of_components = {
        let (of, count) = components(field);
        let borders = borders(field, &of, count);
        marked(&of, &borders, |border| border.open as f64 > BARE * border.all())
    };
    let (of, count) = parts(field);
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

/// Of each cell, whether it belongs to one of those whose border is as asked; none if there is no such one.
fn marked(of: &[u32], borders: &[Border], is: impl Fn(&Border) -> bool) -> Option<Vec<bool>> {
    let is: Vec<bool> = borders.iter().map(is).collect();
    is.contains(&true).then(|| of.iter().map(|&number| is[number as usize]).collect())
}

/// The borders of what has these numbers, from 1 on.
fn borders(field: &Field<'_>, of: &[u32], count: u32) -> Vec<Border> {
    let mut borders = vec![Border::default(); count as usize + 1];
    for (cell, &number) in of.iter().enumerate().filter(|(_, number)| **number != 0) {
        let border = &mut borders[number as usize];
        for next in field.block.beside(cell).into_iter().filter(|&next| of[next] != number) {
            match of[next] {
                0 if field.is_open(cell, next) => border.open += 1,
                0 => border.lined += 1,
                _ => border.neck += 1,
            }
        }
    }
    borders
}

/// The components of the inside, joined by faces of cells, numbered from 1 on, and how many there are.
fn components(field: &Field<'_>) -> (Vec<u32>, u32) {
    let mut of = vec![0u32; field.u.len()];
    let mut count = 0;
    spread(field, &mut of, &mut count, |_| true);
    (of, count)
}

/// Parts of the components, numbered from 1 on, and how many there are. They hang together by faces of cells that lie beside no wall, so that what leads through a
/// hole between samples parts them; cells beside walls belong to the part next to them, and what has no other cells is a part of its own.
fn parts(field: &Field<'_>) -> (Vec<u32>, u32) {
    let mut of = vec![0u32; field.u.len()];
    let mut count = 0;
    spread(field, &mut of, &mut count, |cell| !field.lined[cell]);
    spread(field, &mut of, &mut count, |cell| field.lined[cell]);
    (of, count)
}

/// Numbers the cells of the inside that have no number yet, from those on that numbers spread through: each such cell gives its number to all cells beside it.
fn spread(field: &Field<'_>, of: &mut [u32], count: &mut u32, through: impl Fn(usize) -> bool) {
    let mut stack = Vec::new();
    for first in 0..of.len() {
        if of[first] != 0 || !field.is_inside(first) || !through(first) {
            continue;
        }
        *count += 1;
        of[first] = *count;
        stack.push(first as u32);
        while let Some(cell) = stack.pop() {
            for next in field.block.beside(cell as usize) {
                if of[next] == 0 && field.is_inside(next) {
                    of[next] = *count;
                    if through(next) {
                        stack.push(next as u32);
                    }
                }
            }
        }
    }
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
    fn all(&self) -> f64 {
        (self.open + self.lined + self.neck) as f64
    }
}

/// Whether what is enclosed is lined by walls, so that it is a cavity that was sampled.
pub fn is_lined(field: &Field<'_>, enclosed: &[usize]) -> bool {
    let (mut lined, mut open) = (0u64, 0u64);
    for &cell in enclosed {
        for next in field.block.beside(cell) {
            if !field.is_asked(next) || field.u[next] > 0.0 {
                if field.is_open(cell, next) { open += 1 } else { lined += 1 }
            }
        }
    }
    open as f64 <= BARE * (open + lined) as f64
}
