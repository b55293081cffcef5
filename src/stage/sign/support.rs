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

/// What of the inside is bare.
#[derive(Debug, PartialEq, Eq)]
pub struct Bare {
    /// Of each cell of the block, whether it belongs to a component that is bare.
    pub cells: Vec<bool>,
    /// As `cells`, of components that are so for want of walls alone: not because other components lie behind their walls.
    pub without_walls: Vec<bool>,
}

/// Finds the components of the inside that are bare; none if there is no such component. A wall with two components on its sides lines neither of them.
pub fn bare(field: &Field<'_>, walls: &[Wall]) -> Option<Bare> {
    let (of, count) = components(field);
    let mut borders = vec![Border::default(); count as usize + 1];
    for (cell, &number) in of.iter().enumerate().filter(|(_, number)| **number != 0) {
        let border = &mut borders[number as usize];
        for next in field.block.beside(cell).into_iter().filter(|&next| of[next] != number) {
            if of[next] == 0 && field.is_open(cell, next) { border.open += 1 } else { border.lined += 1 }
        }
    }
    for [a, b] in walls.iter().map(|wall| wall.sides.map(|cell| of[cell as usize])) {
        if a != 0 && b != 0 && a != b {
            [a, b].into_iter().for_each(|number| borders[number as usize].shared += 1);
        }
    }
    if !borders.iter().any(Border::is_bare) {
        return None;
    }
    let marked =
        |is: fn(&Border) -> bool| of.iter().map(|&number| number != 0 && is(&borders[number as usize])).collect();
    Some(Bare { cells: marked(Border::is_bare), without_walls: marked(Border::is_without_walls) })
}

/// The components of the inside, numbered from 1 on, and how many there are. They hang together by faces of cells that lie beside no wall, so that what leads
/// through a hole between samples parts them; cells beside walls belong to the component next to them, and what has no other cells to one of its own.
fn components(field: &Field<'_>) -> (Vec<u32>, u32) {
    let mut of = vec![0u32; field.u.len()];
    let mut count = 0;
    let mut stack = Vec::new();
    for beside_walls in [false, true] {
        for first in 0..of.len() {
            if of[first] != 0 || !field.is_inside(first) || field.lined[first] != beside_walls {
                continue;
            }
            count += 1;
            of[first] = count;
            stack.push(first);
            while let Some(cell) = stack.pop() {
                for next in field.block.beside(cell) {
                    if of[next] == 0 && field.is_inside(next) {
                        of[next] = count;
                        if field.lined[next] == beside_walls {
                            stack.push(next);
                        }
                    }
                }
            }
        }
    }
    (of, count)
}

/// The border of a component, in faces of cells.
#[derive(Debug, Clone, Copy, Default)]
struct Border {
    /// Faces to walls, and to other components: what hangs together with a body through a wide opening is a part of it.
    lined: u64,
    open: u64,
    /// Walls that have another component behind them.
    shared: u64,
}

impl Border {
    fn is_bare(&self) -> bool {
        (self.open + self.shared.min(self.lined)) as f64 > BARE * (self.open + self.lined) as f64
    }

    fn is_without_walls(&self) -> bool {
        self.open as f64 > BARE * (self.open + self.lined) as f64
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
