//! Which cells are opened: those that the winding number says are outside, as far as that makes no piece, and no tunnel but a wide one.
//!
//! ```text
//!   S S S S S S        target: what had better be outside
//!     # t t #          core: sure cells of it, in cubes of 3 x 3 x 3 cells or plates of 2 x 2, if some lie deep in the solid and they reach the outside
//!     # c c #          the rest opens cell by cell from the outside, where that changes no topology
//!     # c c #
//!     # r r #          rungs: groups of what is left of the target that open at once, where handles vanish by that
//!     #     #
//! ```

use super::layers::{Held, Stretch};
use super::tile::Tile;
use super::wall::{HIDDEN, THIN, Wall};
use crate::points::vector::{dot, minus, times};
use crate::solid::simple::{euler_change, neighbourhood};

/// A wall's cell opens if no more of it is inside, and its plane is as sure.
const MOSTLY_OUTSIDE: f64 = 0.5;
const SURE: f32 = 0.5;

/// Cells that are looked at to tell a target, either way.
pub const LOOK: i64 = 3;

/// Whether more walls that touch a cell are thin than hidden: there the solid is right.
fn is_thin(cell: [i64; 3], walls: &Held<Wall>) -> bool {
    let (mut thin, mut hidden) = (0, 0);
    walls.round(cell, 1, |_, wall| {
        thin += u32::from(wall.kind == THIN);
        hidden += u32::from(wall.kind == HIDDEN);
    });
    thin > hidden
}

/// The cells that share a face with one.
fn faces([x, y, z]: [i64; 3]) -> [[i64; 3]; 6] {
    [[x - 1, y, z], [x + 1, y, z], [x, y - 1, z], [x, y + 1, z], [x, y, z - 1], [x, y, z + 1]]
}

/// Calls `found` with the target cells of a tile, which has a margin of [`LOOK`]: of the free cells those `outside`, where thin walls do not outnumber hidden ones; and walls
/// whose cells lie mostly outside, beside such a cell, with the solid behind.
pub fn target(tile: &Tile, walls: &Held<Wall>, solid: &Stretch, outside: &Stretch, mut found: impl FnMut([i64; 3])) {
    // Cells of walls open beside such cells only.
    if !outside.any_of(tile.ranges(LOOK - 1)) {
        return;
    }
    let mut free = vec![0u8; tile.len()];
    tile.paint(outside, 1, &mut free);
    for cell in tile.cells(0) {
        let place = tile.place(cell);
        if free[place] == 1 && tile.holds(cell, 1) && is_thin(cell, walls) {
            free[place] = 0;
        }
    }
    // What lies behind a wall whose cell may open.
    let behind = |cell: [i64; 3], wall: &Wall| {
        let touches = faces(cell).into_iter().any(|next| free[tile.place(next)] == 1);
        if wall.sign == 0 || wall.confidence < SURE || !touches || is_thin(cell, walls) {
            return None;
        }
        let outwards = times(f64::from(wall.sign), wall.across());
        let middle = cell.map(|c| c as f64 + 0.5);
        if 0.5 + dot(outwards, minus(wall.at(cell), middle)) > MOSTLY_OUTSIDE {
            return None;
        }
        let behind = minus(middle, outwards).map(|c| c.floor() as i64);
        (solid.get(behind) && free[tile.place(behind)] == 0).then_some(behind)
    };
    for cell in tile.cells(LOOK) {
        if free[tile.place(cell)] == 1 {
            found(cell);
        } else if let Some(wall) = walls.at(cell)
            && solid.get(cell)
            && let Some(behind_it) = behind(cell, wall)
            && walls.at(behind_it).is_none_or(|wall| !solid.get(behind_it) || behind(behind_it, wall).is_none())
        {
            found(cell);
        }
    }
}

/// How wide what opens at once is, at the least.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Width {
    /// Plates of 2 x 2 cells: a hole between samples may be as wide.
    Plate,
    /// Cubes of 3 x 3 x 3 cells: no wall has a hole as wide by chance.
    Cube,
}

impl Width {
    /// Cells that are looked at round one, either way.
    pub fn reach(self) -> i64 {
        match self {
            Width::Plate => 1,
            Width::Cube => 2,
        }
    }
}

/// Calls `found` with the cells of a tile, which has a margin of [`Width::reach`], that may be the core: `certain` ones in plates or cubes that are outside; and what is known
/// of each.
pub fn core(tile: &Tile, solid: &Stretch, certain: &Stretch, width: Width, mut found: impl FnMut([i64; 3], CoreCell)) {
    if !certain.any_of(tile.ranges(tile.margin)) {
        return;
    }
    let mut kept = vec![0u8; tile.len()];
    tile.paint(solid, 1, &mut kept);
    let was_solid = kept.clone();
    tile.paint(certain, 0, &mut kept);
    let strides = tile.strides();
    certain.cells(tile.ranges(tile.margin), |cell| {
        let place = tile.place(cell);
        if was_solid[place] == 0 {
            return;
        }
        let plate = |across: usize| {
            let [a, b] = [(across + 1) % 3, (across + 2) % 3].map(|axis| strides[axis]);
            // The four plates across an axis that hold the cell.
            [place, place - a, place - b, place - a - b]
                .into_iter()
                .any(|low| [low, low + a, low + b, low + a + b].into_iter().all(|place| kept[place] == 0))
        };
        let is_wide = match width {
            Width::Plate => (0..3).any(plate),
            Width::Cube => in_cube(place, strides, |place| kept[place] == 0),
        };
        if is_wide {
            let joined = faces(cell).into_iter().any(|next| was_solid[tile.place(next)] == 0);
            let deep = !joined && neighbourhood(place, strides, |place| was_solid[place] == 0) == 0;
            found(cell, CoreCell { deep, joined });
        }
    });
}

/// Whether one of the 27 cubes of 3 x 3 x 3 cells that hold a cell is outside.
fn in_cube(place: usize, strides: [usize; 3], outside: impl Fn(usize) -> bool) -> bool {
    let step = |[x, y, z]: [usize; 3]| x * strides[0] + y * strides[1] + z * strides[2];
    let cube = || (0..27).map(|i| step([i % 3, i / 9, i / 3 % 3]));
    cube().any(|back| cube().all(|on| outside(place - back + on)))
}

/// What is known of a cell that may be the core.
#[derive(Debug, Clone, Copy)]
pub struct CoreCell {
    /// No cell that touches it was outside.
    pub deep: bool,
    /// One that shares a face with it was.
    pub joined: bool,
}

/// Calls `found` with the cells of a tile, which has a margin of 1, that are `opened`: with how the Euler number of the solid changes if the cell opens after those before
/// it, in the order of cells; and with whether it shares a face with a cell of `marked`, and with the outside.
pub fn changes(
    tile: &Tile,
    solid: &Stretch,
    opened: &Stretch,
    marked: Option<&Stretch>,
    mut found: impl FnMut([i64; 3], Change),
) {
    if !opened.any_of(tile.ranges(1)) {
        return;
    }
    let mut left = vec![0u8; tile.len()];
    tile.paint(solid, 1, &mut left);
    opened.cells(tile.ranges(0), |cell| {
        if tile.holds(cell, 1) {
            let outside = neighbourhood(tile.place(cell), tile.strides(), |place| left[place] == 0);
            let touches = marked.is_some_and(|marked| faces(cell).into_iter().any(|next| marked.get(next)));
            let joined = faces(cell).into_iter().any(|next| !solid.get(next));
            found(cell, Change { euler: euler_change(outside), touches, joined });
        }
        left[tile.place(cell)] = 0;
    });
}

/// What opening a cell changes.
#[derive(Debug, Clone, Copy)]
pub struct Change {
    /// The change of the Euler number.
    pub euler: i8,
    /// A cell that shares a face with it is marked.
    pub touches: bool,
    /// One that shares a face with it was outside.
    pub joined: bool,
}
