//! What becomes of the topology if one cell changes sides, told by the 26 cells round it.
//!
//! The solid hangs together by faces, the outside by edges, too: so the surface has it ([`crate::surface::corner`]). A cell is *simple* if the pieces, tunnels and cavities of the solid are
//! the same with it and without it. Bit x + 3 z + 9 y of a neighbourhood, each from 0 to 2, is the cell there; bit 13, the cell itself, is 0.
//!
//! Source: G. Bertrand and G. Malandain, *A new characterization of three-dimensional simple points* (1994).

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
pub fn euler_change(outside: u32) -> i8 {
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
pub fn neighbourhood(place: usize, [_, slice, row]: [usize; 3], set: impl Fn(usize) -> bool) -> u32 {
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

/// Whether a cell is simple, when those of the cells round it that are `outside` are: it shares a face with one that is, and with one that is not; round it, the outside that it would join
/// hangs together, and so does the solid within three steps that it is, or would be, a part of.
pub fn is_simple(outside: u32) -> bool {
    let solid = ROUND & !outside;
    let near = within(2, solid & FACES, solid, &BY_FACES);
    outside & FACES != 0
        && solid & FACES != 0
        && hang_together(outside & !CORNERS, outside, &BY_EDGES)
        && hang_together(solid & FACES, near, &BY_FACES)
}
