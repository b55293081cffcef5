//! Sign: which free cells lie inside, by a field that changes its sign across every wall.
//!
//! A wall that bounds a body has the outside on one side and the inside on the other. So the field u wants to be smooth where nothing stands
//! between two cells, and to turn its sign where a wall does. With u = −1 outside, it is the least of
//!
//! ```text
//!   E(u) = Σ g_ij (u_i − u_j)²  over free cells that share a face  +  C Σ (u_a + u_b)²  over walls, a and b being the free cells on both sides
//!
//!   u = -1 (outside)    -1   -1        # occupied
//!     # # # # # # . . # #              Round a whole body u is -1 outside and +1 inside, and E is 0, however folded the body is.
//!     #  +1  +1  +.5 0 .5 #            In a hole u passes through 0: the body is closed there by a membrane that its walls hold,
//!     #  +1  +1  +1  +1   #            whatever the hole's width. Where sampled walls face a concavity, they hold it open.
//!     # # # # # # # # # # #
//! ```
//!
//! No radius is looked for. E is quadratic; its least is found by conjugate gradients (`field.rs`). The inside is where u > 0.
//!
//! *What is outside* to begin with: all that a ball as large as the largest hole reaches (`rolling.rs`). On the concave side of a surface that is open that
//! ball may not fit, and u may rise above 0 there. What is inside of a body is lined by its walls; what merely lies before a dome or on a floor is
//! bare on its other side. So where too much of a component's border is bare, a smaller ball rolls in, until what is left is lined or gone (`support.rs`).
//!
//! All of that happens on one level of the pyramid, whose cells are held whole: at most [`LONGEST`] along any axis, more where [`crate::solid::level`] says so, so that its memory is bounded.
//! What is finer is decided where it is seen, by [`crate::solid::watershed`].
//!
//! Source: the idea that an unsigned distance can be given signs by a Laplacian is that of P. Mullen et al., *Signing the Unsigned* (2010).

mod block;
mod distance;
mod field;
mod membrane;
mod normal;
pub mod outliers;
mod rolling;
mod sheet;
mod sights;
mod support;
mod system;
#[cfg(test)]
pub(crate) mod tests;
mod wall_count;

use crate::error::Result;
use crate::grid::Cell;
use crate::grid::context::Context;
use crate::grid::occupancy::Occupancy;

pub use self::block::{Block, PAD, Side};
use self::field::Field;
use self::normal::Wall;
use self::sheet::Sheet;
pub use self::sheet::SheetWall;
pub use self::sights::Sights;
pub use self::wall_count::WallCount;

/// The most cells along any axis of a level that is held whole, where slots, voids and shells are not narrow.
pub const LONGEST: u32 = 128;

/// The most where they are.
pub const FINER_LONGEST: u32 = 256;

/// The most of them where a rough answer will do.
pub const ROUGH: u32 = 48;

/// The radius of the first ball, as a share of the longest side. A hole of a tenth of a sphere's surface is .6 of its side wide.
const FIRST: f64 = 0.35;

/// Each ball is so many times as large as the next.
const STEP: f64 = std::f64::consts::SQRT_2;

/// A level of the pyramid, held whole, and which of its cells are walls.
#[derive(Debug)]
pub struct Seen {
    block: Block,
    occupied: Vec<bool>,
    walls: Vec<u32>,
    outliers: Vec<u32>,
    /// Whether each cell is empty as lines of sight say; no flags if there are none.
    emptied: Vec<bool>,
    /// How many of the grid's cells are taken together along every axis.
    factor: u32,
}

impl Seen {
    /// Looks at a level whose cells are taken together by `factor`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn of(occupancy: &Occupancy, factor: u32, context: &Context) -> Result<Seen> {
        let (block, mut occupied) = Block::of(occupancy, factor)?;
        let cells = occupied.iter().filter(|occupied| **occupied).count();
        context.account.field(outliers::bytes(block.cells, cells as u64));
        let outliers = context.workers.pool().install(|| outliers::take_out(&block, &mut occupied));
        let walls: Vec<u32> = (0..occupied.len() as u32).filter(|&cell| occupied[cell as usize]).collect();
        Ok(Seen { block, occupied, walls, outliers, emptied: Vec::new(), factor })
    }

    /// The same with what lines of sight say, if there are any; `factor` as in [`Seen::of`].
    ///
    /// # Errors
    /// Errors of reading the input; [`crate::Error::Interrupted`].
    pub fn with_sights(mut self, sights: Option<&Sights<'_>>, factor: u32, context: &Context) -> Result<Seen> {
        if let Some(sights) = sights {
            self.emptied = sights.emptied(&self, factor, context)?;
        }
        Ok(self)
    }

    /// Whether there are outliers.
    pub fn has_outliers(&self) -> bool {
        !self.outliers.is_empty()
    }

    /// Whether a cell of the block is an outlier.
    pub fn is_outlier(&self, cell: Cell) -> bool {
        let index = self.block.index(cell.map(|c| c as usize));
        self.outliers.binary_search(&(index as u32)).is_ok()
    }
}

/// A level of the pyramid with the side of every cell.
#[derive(Debug)]
pub struct Signed {
    /// The cells, some more on every side.
    pub block: Block,
    /// The side of each cell of the block.
    pub sides: Vec<Side>,
    /// How many of them are empty, as lines of sight say.
    pub emptied: u64,
    /// Number of walls: occupied cells that have free cells on both sides.
    pub walls: u64,
    /// How many of them are double: the occupied cells near them lie farther across them than those of one plane do, as where two walls lie near each other.
    pub doubles: u64,
    /// How many of them are so thick that they may be two.
    pub thick: u64,
    /// How many cells have no side, as they lie in pieces.
    pub pieces: usize,
    /// How many of them have the same side on both sides.
    pub part_nothing: u64,
    /// How many of these have the outside there.
    pub part_outside: u64,
    /// Where these lie: how many places there are, and how many of these are sparse ([`sheet::sparse`]).
    pub where_outside: [u64; 2],
    /// Cells of membranes: where inside and outside meet between walls.
    pub membranes: u64,
    /// The cells near them, in their order, with the u that stretched them; 0 on walls.
    pub near_membranes: Vec<(u32, f32)>,
    /// Patches of walls with the outside on both sides, the largest first: sheets.
    pub open: Vec<Patch>,
    /// Patches of walls with the inside on both sides: of slots and folds that were filled.
    pub filled: Vec<Patch>,
    /// The walls of the open patches, and those that they go on in ([`sheet::continued`]), in the order of their cells.
    pub sheets: Vec<SheetWall>,
}

/// A patch of walls that part nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patch {
    /// Number of its walls.
    pub walls: u64,
    /// Its least and its greatest cell along each axis.
    pub cells: [[usize; 3]; 2],
}

impl Patch {
    fn of(block: &Block, sheet: &Sheet) -> Patch {
        let mut cells = [[usize::MAX; 3], [0; 3]];
        for cell in sheet.walls.iter().map(|wall| block.cell(*wall as usize)) {
            for a in 0..3 {
                cells[0][a] = cells[0][a].min(cell[a]);
                cells[1][a] = cells[1][a].max(cell[a]);
            }
        }
        Patch { walls: sheet.walls.len() as u64, cells }
    }
}

impl Signed {
    /// Finds the sides on a level.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn find(seen: Seen, context: &Context) -> Result<Signed> {
        // Here, and not step by step, so that no step waits for a thread of the pool to wake.
        let signed = context.workers.pool().install(|| Signed::found(seen, context));
        context.workers.between_steps();
        signed
    }

    fn found(seen: Seen, context: &Context) -> Result<Signed> {
        let Seen { block, occupied, walls, outliers: _, emptied, factor } = seen;
        context.account.field(bytes_of_block(&block, walls.len() as u64, context.workers.threads() as u64));
        let mut two_sided = normal::two_sided(&block, &occupied, &walls);
        let doubles = normal::doubles(&block, &occupied, &two_sided);
        let thick = two_sided.iter().filter(|wall| normal::is_thick(&block, &occupied, wall)).count() as u64;
        let seen = Cells { block: &block, occupied: &occupied, emptied: &emptied, are_wide: factor > 1 };
        let (mut sides, lined) = Signed::sides_and_lined(seen, &mut two_sided, &doubles, context)?;
        context.workers.between_steps();
        let near_membranes = membrane::stretch(&block, &two_sided, &lined, &emptied, &mut sides, &context.workers);
        let membranes = membrane::count(&block, &lined, &sides);
        drop(lined);
        let of = |wall: &Wall| wall.sides.map(|cell| sides[cell as usize]);
        let part_nothing = two_sided.iter().map(of).filter(|[a, b]| a == b && *a != Side::Unknown).count() as u64;
        let part_outside = two_sided.iter().map(of).filter(|both| *both == [Side::Outside; 2]).count() as u64;
        let outside = two_sided.iter().filter(|wall| of(wall) == [Side::Outside; 2]);
        let where_outside = sheet::sparse(outside.map(|wall| block.cell(wall.cell as usize)));
        let [open, filled] = [Side::Outside, Side::Inside].map(|side| sheet::find(&block, &two_sided, &sides, side));
        let mut sheets: Vec<u32> = open.iter().flat_map(|sheet| &sheet.walls).copied().collect();
        sheets.sort_unstable();
        let sheets = sheet::continued(&block, &two_sided, &sheets);
        let [open, filled] =
            [open, filled].map(|sheets| sheets.iter().map(|sheet| Patch::of(&block, sheet)).collect::<Vec<_>>());
        let emptied = emptied.iter().filter(|empty| **empty).count() as u64;
        Ok(Signed {
            emptied,
            walls: two_sided.len() as u64,
            doubles: doubles.iter().filter(|is_double| **is_double).count() as u64,
            thick,
            pieces: sides.iter().filter(|side| **side == Side::Unknown).count(),
            part_nothing,
            part_outside,
            membranes,
            near_membranes,
            where_outside,
            open,
            filled,
            sheets,
            block,
            sides,
        })
    }

    /// The sides of cells, and which of them are lined.
    ///
    /// The walls of narrow slots may have made the web between two slots outside, which a membrane then cuts off. So if membranes are large, the field is
    /// found once more, with double walls that weigh little. That is the answer if it has half of the membranes or less, and most of the body.
    fn sides_and_lined(
        seen: Cells,
        walls: &mut [Wall],
        doubles: &[bool],
        context: &Context,
    ) -> Result<(Vec<Side>, Vec<bool>)> {
        let block = seen.block;
        let (sides, lined) = Signed::solved(seen, walls, context)?;
        let membranes = membrane::count(block, &lined, &sides);
        if membranes < SUSPECT {
            return Ok((sides, lined));
        }
        let weights: Vec<f32> = walls.iter().map(|wall| wall.weight).collect();
        let weight = |is_double: bool| if is_double { normal::LIGHT } else { normal::WEIGHT };
        walls.iter_mut().zip(doubles).for_each(|(wall, is_double)| wall.weight = weight(*is_double));
        // Lined are the same cells.
        drop(lined);
        let (other, lined) = Signed::solved(seen, walls, context)?;
        let inside = |sides: &[Side]| sides.iter().filter(|side| **side == Side::Inside).count();
        let keeps_the_body = 10 * inside(&other) >= 9 * inside(&sides);
        if 2 * membrane::count(block, &lined, &other) <= membranes && keeps_the_body {
            return Ok((other, lined));
        }
        walls.iter_mut().zip(weights).for_each(|(wall, weight)| wall.weight = weight);
        Ok((sides, lined))
    }

    /// The sides of cells, by the field that walls with these weights have; and which cells are lined.
    fn solved(
        Cells { block, occupied, emptied, are_wide }: Cells,
        walls: &mut [Wall],
        context: &Context,
    ) -> Result<(Vec<Side>, Vec<bool>)> {
        let longest = f64::from(block.cells.into_iter().max().unwrap_or(1));
        let mut radius = (FIRST * longest).max(2.0);
        let mut outside = rolling::reached(block, occupied, radius);
        outside.iter_mut().zip(emptied).for_each(|(outside, empty)| *outside |= empty);
        let mut field = Field::new(block, occupied, outside);
        let lined = field.lined.iter().zip(occupied).filter(|(lined, occupied)| **lined & !**occupied).count();
        context
            .account
            .field(bytes_held(block, walls.len() as u64) + support::bytes(block.size() as u64, lined as u64));
        let mut tries = 0;
        loop {
            context.workers.check_cancelled()?;
            context.workers.between_steps();
            field.solve(walls, &context.workers);
            if let Some(bare) = support::bare(&field, walls) {
                let mut gains = false;
                while !gains && radius / STEP >= SMALLEST {
                    radius /= STEP;
                    gains = field.open(&bare.cells, &rolling::reached(block, occupied, radius));
                }
                if gains {
                    continue;
                }
                field.give_up(&bare.whole);
            }
            let nothing: Vec<bool> = walls.iter().map(|wall| field.same_side(wall.sides)).collect();
            tries += 1;
            let count = nothing.iter().filter(|n| **n).count();
            let new = if tries < TRIES && count as f64 > SEEN * nothing.len() as f64 {
                sheet::weigh(block, walls, &nothing)
            } else {
                0
            };
            if new == 0 {
                break;
            }
        }
        let sides = field.sides(are_wide);
        Ok((sides, field.lined))
    }

    /// The sides of a row of cells of the level, from [`PAD`] cells before its first one to as many after its last; none if all of it is outside, beyond the level.
    pub fn row(&self, y: i64, z: i64) -> Option<&[Side]> {
        let first = self.block.at([-(PAD as i64), y, z])?;
        Some(&self.sides[first..first + self.block.width])
    }
}

/// Bytes for each cell of the block: its flags and number, and, as if every cell's u were looked for, the cell, u, and what conjugate gradients
/// hold of it.
const CELL: u64 = 7 + 4 + 8 + 20;

/// The same before that: its flag and number.
const CELL_SEEN: u64 = 1 + 4;

/// Bytes for each cell of a block that is there: seven flags, one of them its side in the other answer; its u and how open it is.
const CELL_HELD: u64 = 7 + 2 * 4;

/// What conjugate gradients hold of it.
const CELL_SOLVED: u64 = 4 * 4;

/// Bytes for each of its walls: in two lists, with what is known of it, whether it is double, and its weight in the other answer.
const WALL_HELD: u64 = 4 + size_of::<Wall>() as u64 + 1 + 4;

/// Its terms in two cells' equations, in vectors that grow.
const WALL_SOLVED: u64 = 48;

/// Slices that a thread holds of what is known beside cells whose u is looked for: three, of two numbers for each cell.
const BUFFERS: u64 = 3 * 2 * 4;

/// The most memory that finding the sides of a block takes, with so many occupied cells.
fn bytes_of_block(block: &Block, walls: u64, threads: u64) -> u64 {
    let slice = (block.rows * block.width) as u64;
    let solving = block.size() as u64 * CELL_SOLVED + walls * WALL_SOLVED + threads * slice * BUFFERS;
    bytes_held(block, walls) + solving
}

/// What a field holds all the time.
fn bytes_held(block: &Block, walls: u64) -> u64 {
    block.size() as u64 * CELL_HELD + walls * WALL_HELD
}

/// The most memory that finding the sides of a grid of so many cells takes, but for a finer level.
pub fn bytes(cells: Cell) -> u64 {
    (block_cells(cells) * CELL).max(wall_count::bytes(cells))
}

/// The most memory that finding the sides takes on a level of such a grid whose cells are taken together by `factor`, of which so many are occupied.
pub fn bytes_of_level(cells: Cell, factor: u32, occupied: u64, threads: usize) -> u64 {
    let block = Block::new(cells.map(|c| c.div_ceil(factor)));
    // Of each wall, the cells beside it are lined: two or three.
    let judging = bytes_held(&block, occupied) + support::bytes(block.size() as u64, 3 * occupied);
    bytes_of_block(&block, occupied, threads as u64).max(judging).max(outliers::bytes(block.cells, occupied))
}

/// The most memory that looking along lines of sight takes before that, and beside blocks of points.
pub fn sights_bytes(cells: Cell) -> u64 {
    block_cells(cells) * (CELL_SEEN + sights::CELL)
}

/// The cells of the finest block of a grid.
fn block_cells(cells: Cell) -> u64 {
    cells_of_level(cells, least_factor(cells, LONGEST))
}

/// How many of a grid's cells are taken together along every axis, at the least, so that a level has at most `longest` along any.
pub fn least_factor(cells: Cell, longest: u32) -> u32 {
    cells.into_iter().max().unwrap_or(1).div_ceil(longest).max(1)
}

/// The cells of the block of a level of such a grid whose cells are taken together by `factor`, padding included.
pub fn cells_of_level(cells: Cell, factor: u32) -> u64 {
    cells.into_iter().map(|c| u64::from(c.div_ceil(factor)) + 2 * PAD as u64).product()
}

/// A level's cells: which are occupied, which are empty by lines of sight, and whether they are wider than the grid's.
#[derive(Clone, Copy)]
struct Cells<'a> {
    block: &'a Block,
    occupied: &'a [bool],
    emptied: &'a [bool],
    are_wide: bool,
}

/// How often sheets are looked for.
const TRIES: usize = 8;

/// The part of the walls that part nothing, from which on sheets are looked for.
const SEEN: f64 = 0.02;

/// Membranes of fewer cells cut off no web that is worth another answer: they are as large as a hole ten cells wide.
const SUSPECT: u64 = 100;

/// A ball smaller than this, in cells, is no ball.
const SMALLEST: f64 = 1.5;
