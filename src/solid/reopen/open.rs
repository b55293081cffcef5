//! Which cells are opened: those that the winding number says are outside, as far as that makes no piece and no tunnel.
//!
//! ```text
//!   S S S S S S        target: what had better be outside
//!     # t t #          core: sure cells of it, in plates of 2 x 2 cells, if some lie deep in the solid and they reach the outside
//!     # c c #          the rest opens cell by cell from the outside, where that changes no topology
//!     # c c #
//! ```

use super::layers::{Held, Stretch};
use super::tile::Tile;
use super::vector::{dot, minus, times};
use super::wall::{HIDDEN, THIN, Wall};

/// A wall's cell opens if no more of it is inside, and its plane is as sure.
const MOSTLY_OUTSIDE: f64 = 0.5;
const SURE: f32 = 0.5;

/// Cells that are looked at to tell a target, either way.
pub const LOOK: i64 = 3;

/// What is known of a cell of the core: no cell that touches it was outside, one that shares a face with it was.
pub const DEEP: u8 = 1;
pub const JOINED: u8 = 2;

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

/// Calls `found` with the cells of a tile, which has a margin of 1, that may be the core: `certain` ones in plates of 2 x 2 cells that are outside; and what is known of each.
pub fn plates(tile: &Tile, solid: &Stretch, certain: &Stretch, mut found: impl FnMut([i64; 3], u8)) {
    let mut kept = vec![0u8; tile.len()];
    tile.paint(solid, 1, &mut kept);
    let was_solid = kept.clone();
    tile.paint(certain, 0, &mut kept);
    let strides = tile.strides();
    for cell in tile.cells(1) {
        let place = tile.place(cell);
        if kept[place] == 1 || was_solid[place] == 0 {
            continue;
        }
        let plate = |across: usize| {
            let [a, b] = [(across + 1) % 3, (across + 2) % 3].map(|axis| strides[axis]);
            // The four plates across an axis that hold the cell.
            [place, place - a, place - b, place - a - b]
                .into_iter()
                .any(|low| [low, low + a, low + b, low + a + b].into_iter().all(|place| kept[place] == 0))
        };
        if !(0..3).any(plate) {
            continue;
        }
        let joined = faces(cell).into_iter().any(|next| was_solid[tile.place(next)] == 0);
        let deep = !joined && neighbourhood(place, strides, |place| was_solid[place] == 0) == 0;
        found(cell, if deep { DEEP } else { 0 } | if joined { JOINED } else { 0 });
    }
}

/// The cells round one that are set, as bits x + 3 z + 9 y, each from 0 to 2; the cell itself is bit 13, which stays 0.
#[inline]
fn neighbourhood(place: usize, [_, slice, row]: [usize; 3], set: impl Fn(usize) -> bool) -> u32 {
    let low = place - slice - row - 1;
    let mut bits = 0;
    for y in 0..3 {
        for z in 0..3 {
            for x in 0..3 {
                bits |= u32::from(set(low + y * slice + z * row + x)) << (x + 3 * z + 9 * y);
            }
        }
    }
    bits & !(1 << 13)
}

/// Of each cell of a cube of 27, those of the cube that touch it.
const TOUCHING: [u32; 27] = {
    let mut table = [0; 27];
    let mut a = 0;
    while a < 27 {
        let mut b = 0;
        while b < 27 {
            let (x, z, y) = (a % 3 - b % 3, a / 3 % 3 - b / 3 % 3, a / 9 - b / 9);
            if x * x <= 1 && y * y <= 1 && z * z <= 1 {
                table[a as usize] |= 1 << b;
            }
            b += 1;
        }
        a += 1;
    }
    table
};

/// The six cells of the cube that share a face with the one in the middle.
const FACES: u32 = 1 << 4 | 1 << 10 | 1 << 12 | 1 << 14 | 1 << 16 | 1 << 22;

/// Whether a solid cell may open, when those of the cells round it that are `outside` are: it shares a face with one that is, and one that is not, and the outside round
/// it hangs together. So the outside gains no tunnel. Where more than one part of the solid meets in the cell, a rung is cut.
pub(super) fn opens(outside: u32) -> bool {
    if outside & FACES == 0 || outside & FACES == FACES {
        return false;
    }
    let mut reached = outside & outside.wrapping_neg();
    loop {
        let (mut left, mut next) = (reached, reached);
        while left != 0 {
            next |= TOUCHING[left.trailing_zeros() as usize];
            left &= left - 1;
        }
        next &= outside;
        if next == reached {
            return reached == outside;
        }
        reached = next;
    }
}

/// Sub-grids of the cells whose coordinates are even or odd: no two cells of one touch, so all of one may open at once.
pub const SUBGRIDS: i64 = 8;

/// A round of growth in a tile, which has a margin of [`SUBGRIDS`]: calls `found` with the cells of the `target` that open, beside those that are `opened` already.
pub fn grown(tile: &Tile, solid: &Stretch, opened: &Stretch, target: &Stretch, mut found: impl FnMut([i64; 3])) {
    let mut outside = vec![1u8; tile.len()];
    tile.paint(solid, 0, &mut outside);
    tile.paint(opened, 1, &mut outside);
    let mut wanted = vec![0u8; tile.len()];
    tile.paint(target, 1, &mut wanted);
    let mut left: Vec<[i64; 3]> =
        tile.cells(1).filter(|cell| wanted[tile.place(*cell)] == 1 && outside[tile.place(*cell)] == 0).collect();
    let strides = tile.strides();
    let before = left.len();
    for subgrid in 0..SUBGRIDS {
        left.retain(|cell| {
            let place = tile.place(*cell);
            let [x, y, z] = cell.map(|c| c & 1);
            if x + 2 * z + 4 * y == subgrid && opens(neighbourhood(place, strides, |place| outside[place] == 1)) {
                outside[place] = 1;
                if tile.holds(*cell, tile.margin) {
                    found(*cell);
                }
                return false;
            }
            true
        });
    }
    debug_assert!(left.len() <= before);
}
