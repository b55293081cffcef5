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

/// Of the eight blocks of 2 x 2 x 2 cells that hold the middle of a cube of 27, the seven other cells: three that share a face with it, three an edge, one a corner.
const BLOCKS: [[u32; 7]; 8] = {
    let mut blocks = [[0; 7]; 8];
    let mut block = 0;
    while block < 8 {
        let x: i32 = if block & 1 == 1 { 1 } else { -1 };
        let z: i32 = if block & 2 == 2 { 3 } else { -3 };
        let y: i32 = if block & 4 == 4 { 9 } else { -9 };
        let steps = [x, z, y, x + z, x + y, z + y, x + y + z];
        let mut i = 0;
        while i < 7 {
            blocks[block][i] = 1 << (13 + steps[i]);
            i += 1;
        }
        block += 1;
    }
    blocks
};

/// How the Euler number of the solid, its pieces less its tunnels, changes if a cell opens; of those round it, some are `outside`.
///
/// The Euler number is cells - pairs + squares - cubes of cells that share faces, and 1 more for each block of which only two opposite corners are outside: these do not
/// hang together there.
pub(super) fn euler_change(outside: u32) -> i8 {
    let solid = !outside;
    let all = |mask: u32| i8::from(solid & mask == mask);
    let mut change = -1;
    let (mut squares, mut cubes, mut opposite) = (0, 0, 0);
    for [x, z, y, xz, xy, zy, xyz] in BLOCKS {
        // A square with the cell lies in two blocks.
        squares += all(x | z | xz) + all(x | y | xy) + all(z | y | zy);
        let others = x | z | y | xz | xy | zy | xyz;
        cubes += all(others);
        let out = outside & others;
        // Before, two opposite cells were outside, one of them this one's neighbour; after, this one and its opposite are.
        let two = [x | zy, z | xy, y | xz];
        opposite -= i8::from(two.contains(&out));
        opposite += i8::from(out == xyz);
    }
    let mut pairs = 0;
    let mut face = FACES;
    while face != 0 {
        pairs += all(face & face.wrapping_neg());
        face &= face - 1;
    }
    change += pairs - squares / 2 + cubes + opposite;
    change
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

/// Of each cell of a cube of 27, those of the cube that share a face with it, or an edge or a face.
const BY_FACES: [u32; 27] = touching(1);
const BY_EDGES: [u32; 27] = touching(2);

const fn touching(squared: i32) -> [u32; 27] {
    let mut table = [0; 27];
    let mut a: i32 = 0;
    while a < 27 {
        let mut b = 0;
        while b < 27 {
            let (x, z, y) = (a % 3 - b % 3, a / 3 % 3 - b / 3 % 3, a / 9 - b / 9);
            if x * x + y * y + z * z <= squared {
                table[a as usize] |= 1 << b;
            }
            b += 1;
        }
        a += 1;
    }
    table
}

/// The six cells of the cube that share a face with the one in the middle.
const FACES: u32 = 1 << 4 | 1 << 10 | 1 << 12 | 1 << 14 | 1 << 16 | 1 << 22;

/// The eight that share a corner with it alone.
const CORNERS: u32 = 1 | 1 << 2 | 1 << 6 | 1 << 8 | 1 << 18 | 1 << 20 | 1 << 24 | 1 << 26;

/// All but the one in the middle.
const ROUND: u32 = ((1 << 27) - 1) & !(1 << 13);

/// The cells of `cells` that so many steps lead to from those of `ends`.
fn within(steps: u32, ends: u32, cells: u32, by: &[u32; 27]) -> u32 {
    (0..steps).fold(ends, |reached, _| {
        let (mut left, mut next) = (reached, reached);
        while left != 0 {
            next |= by[left.trailing_zeros() as usize];
            left &= left - 1;
        }
        next & cells
    })
}

/// Whether all cells of `ends` hang together by way of `cells`.
fn hang_together(ends: u32, cells: u32, by: &[u32; 27]) -> bool {
    let mut reached = ends & ends.wrapping_neg();
    loop {
        let next = within(1, reached, cells, by);
        if next == reached {
            return reached & ends == ends;
        }
        reached = next;
    }
}

/// Whether a solid cell may open without a change of topology, when those of the cells round it that are `outside` are: it shares a face with one that is, and with one that
/// is not; round it, the outside that it would join hangs together, and so does the solid within three steps that it is a part of. The solid hangs together by faces, the outside by edges,
/// too: so the surface has it ([`crate::surface::corner`]).
///
/// Source: G. Bertrand and G. Malandain, *A new characterization of three-dimensional simple points* (1994).
pub(super) fn opens(outside: u32) -> bool {
    let solid = ROUND & !outside;
    let near = within(2, solid & FACES, solid, &BY_FACES);
    outside & FACES != 0
        && solid & FACES != 0
        && hang_together(outside & !CORNERS, outside, &BY_EDGES)
        && hang_together(solid & FACES, near, &BY_FACES)
}

/// Sub-grids of the cells whose coordinates are even or odd: no two cells of one touch, so all of one may open at once.
pub const SUBGRIDS: i64 = 8;

/// A round of growth in a tile, which has a margin of [`SUBGRIDS`]: calls `found` with the cells of the `target` that open, beside those that are `opened` already.
pub fn grown(tile: &Tile, solid: &Stretch, opened: &Stretch, target: &Stretch, mut found: impl FnMut([i64; 3])) {
    if !target.any_of(tile.ranges(tile.margin)) {
        return;
    }
    let mut outside = vec![1u8; tile.len()];
    tile.paint(solid, 0, &mut outside);
    tile.paint(opened, 1, &mut outside);
    let mut left = Vec::new();
    target.cells(tile.ranges(1), |cell| {
        if outside[tile.place(cell)] == 0 {
            left.push(cell);
        }
    });
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
