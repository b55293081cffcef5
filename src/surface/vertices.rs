//! The vertices of the surface, plane by plane: found from the slices round a plane, numbered, looked up, and counted for plans.
//!
//! The eight cells round a corner are its mask: bit i is the cell that lies above the corner along x if i has bit 0, along y if it has bit 1, along z if it
//! has bit 2. Each sheet of a corner is a vertex, and so is the middle of a doubled edge, which belongs to the plane of its lower end.

use crate::error::Result;
use crate::grid::context::{Context, chunks};
use crate::grid::slice::{Bits, Runs, words_for};
use crate::grid::window::Window;
use crate::solid::Solid;
use crate::solid::heightfield::{Columns, is_touched};
use crate::surface::corner::CORNERS;

/// A vertex before smoothing: a sheet of a corner, or the middle of a doubled edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Vertex {
    /// The corner (i, j, k); of a middle, the lower end of its edge.
    pub corner: [u32; 3],
    /// The eight cells round the corner.
    pub mask: u8,
    /// What the vertex is there.
    pub kind: Kind,
}

/// What a vertex is at its corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The sheet of this number.
    Sheet(u8),
    /// The middle of the doubled edge along this axis.
    Midpoint(u8),
}

/// The surface's corners on one plane, ready for look-up.
#[derive(Debug)]
pub(super) struct Plane {
    /// Rows of bits: is (i, k) a corner of the surface?
    pub(super) corners: Bits,
    /// The number of corners before each word of `corners`.
    before: Vec<u32>,
    /// The mask of each corner, and the number of its first vertex.
    pub(super) masks: Vec<u8>,
    pub(super) first: Vec<u32>,
    /// The number of corners before each row.
    pub(super) rows: Vec<u32>,
    /// Midpoints that belong to the plane, by (lower corner, axis). Nearly always empty.
    pub(super) midpoints: Vec<((u32, u32, u8), u32)>,
}

impl Plane {
    /// Finds plane `j`'s corners and appends its vertices. `around` are the slices j − 1, j and j + 1, each moved by one cell and row.
    pub(super) fn find(around: [&Bits; 3], j: u32, trimmed: Option<&Columns>, vertices: &mut Vec<Vertex>) -> Plane {
        let [low, high, _] = around;
        let (width, rows) = (low.width() - 1, low.row_count() - 1);
        let live = trimmed.map(|columns| Live::of(columns, j, width, rows));
        let mut out = Plane {
            corners: Bits::new(width, rows),
            before: Vec::new(),
            masks: Vec::new(),
            first: Vec::new(),
            rows: vec![0],
            midpoints: Vec::new(),
        };
        let words = out.corners.row(0).len();
        for k in 0..rows {
            let cells = [low.lit_row(k), high.lit_row(k), low.lit_row(k + 1), high.lit_row(k + 1)];
            let live_row = live.as_ref().map(|live| live.row(k));
            if cells.iter().all(Option::is_none) || live_row.is_some_and(|live| live.is_none()) {
                out.before.extend(std::iter::repeat_n(out.masks.len() as u32, words));
                out.rows.push(out.masks.len() as u32);
                continue;
            }
            for w in 0..words {
                out.before.push(out.masks.len() as u32);
                let c = words_round(cells, w);
                let any = c.iter().fold(0, |a, b| a | b);
                let all = c.iter().fold(u64::MAX, |a, b| a & b);
                let made = live_row.flatten().map_or(u64::MAX, |live| live[w]);
                let mut surface = any & !all & made;
                if surface == 0 {
                    continue;
                }
                let mut corners = surface;
                while surface != 0 {
                    let bit = surface.trailing_zeros();
                    surface &= surface - 1;
                    let mask = mask_of(c, bit);
                    if live.as_ref().is_some_and(|live| !live.touches(w as u32 * 64 + bit, k, mask)) {
                        corners &= !(1 << bit);
                        continue;
                    }
                    out.masks.push(mask);
                    out.first.push(vertices.len() as u32);
                    let corner = [w as u32 * 64 + bit, j, k];
                    for sheet in 0..CORNERS[usize::from(mask)].sheets {
                        vertices.push(Vertex { corner, mask, kind: Kind::Sheet(sheet) });
                    }
                }
                out.corners.row_mut(k)[w] = corners;
            }
            out.rows.push(out.masks.len() as u32);
        }
        out.add_midpoints(around, trimmed, vertices);
        out
    }

    /// Appends the midpoints of doubled edges whose lower end lies in the plane: along x and z first, then along y.
    fn add_midpoints(&mut self, around: [&Bits; 3], trimmed: Option<&Columns>, vertices: &mut Vec<Vertex>) {
        let doubled: Vec<usize> = (0..self.masks.len())
            .filter(|&o| CORNERS[usize::from(self.masks[o])].doubled & DOUBLED_UPWARDS != 0)
            .collect();
        for axes in [&[0u8, 2][..], &[1]] {
            for &ordinal in &doubled {
                let vertex = vertices[self.first[ordinal] as usize];
                for &axis in axes {
                    if has_midpoint(around, vertex.corner, vertex.mask, usize::from(axis), trimmed) {
                        let [i, _, k] = vertex.corner;
                        self.midpoints.push(((k, i, axis), vertices.len() as u32));
                        vertices.push(Vertex { kind: Kind::Midpoint(axis), ..vertex });
                    }
                }
            }
        }
    }

    /// The number, among the plane's corners, of corner (i, k).
    #[inline]
    pub(super) fn ordinal(&self, i: u32, k: u32) -> usize {
        let row = self.corners.row(k);
        let (w, bit) = (i as usize / 64, i % 64);
        debug_assert!(row[w] >> bit & 1 == 1, "not a corner of the surface");
        let within = (row[w] & ((1 << bit) - 1)).count_ones();
        (self.before[k as usize * row.len() + w] + within) as usize
    }
}

/// The corners of a plane at live columns, and not on the bottom of the grid: those that may be made.
struct Live {
    rows: Vec<bool>,
    words: Vec<u64>,
    /// By place across columns, which of the four there are live, as [`is_touched`] asks for it.
    round: Vec<u8>,
    up: usize,
}

impl Live {
    fn of(columns: &Columns, j: u32, width: u32, rows: u32) -> Live {
        let up = columns.up().axis;
        let across = if columns.up().across() == 0 { width } else { rows };
        let round: Vec<u8> = (0..across).map(|column| columns.live_round(j.into(), column.into())).collect();
        // Columns lie side by side along x or along z: whether a corner's are live depends on one of the two, whether it lies at the bottom on the other.
        let made = |corner: [u32; 3]| round[corner[columns.up().across()] as usize] != 0;
        let above = |corner: [u32; 3]| !columns.at_bottom(corner);
        type Test<'a> = &'a dyn Fn([u32; 3]) -> bool;
        let (along_x, along_z): (Test<'_>, Test<'_>) =
            if columns.up().across() == 0 { (&made, &above) } else { (&above, &made) };
        let mut words = vec![0; words_for(width)];
        for i in (0..width).filter(|i| along_x([*i, j, 0])) {
            words[i as usize / 64] |= 1u64 << (i % 64);
        }
        let rows = (0..rows).map(|k| along_z([0, j, k])).collect();
        Live { rows, words, round, up }
    }

    /// Whether a face that is made touches the corner (i, k) of the surface, which has this mask.
    fn touches(&self, i: u32, k: u32, mask: u8) -> bool {
        let column = if self.up == 0 { k } else { i };
        is_touched(mask, self.round[column as usize], self.up)
    }

    /// The words of row `k`, if any of its corners may be made.
    fn row(&self, k: u32) -> Option<&[u64]> {
        self.rows[k as usize].then_some(&self.words)
    }
}

/// A corner's doubled edges that lead upwards, along any axis.
const DOUBLED_UPWARDS: u8 = 0b10_1010;

/// Whether the edge from a corner with this mask upwards along axis `m` is doubled, and both of its ends are made.
fn has_midpoint(around: [&Bits; 3], corner: [u32; 3], mask: u8, m: usize, trimmed: Option<&Columns>) -> bool {
    let upper_mask = mask_at(around, corner, m);
    let both = CORNERS[usize::from(mask)].doubled >> (2 * m + 1) & CORNERS[usize::from(upper_mask)].doubled >> (2 * m);
    let mut upper = corner;
    upper[m] += 1;
    both & 1 == 1 && trimmed.is_none_or(|columns| columns.holds(upper, upper_mask))
}

/// Tells `found` of every corner of the surface on plane `j` that is made, with its mask, in order. `around` as for [`Plane::find`].
fn each_corner(around: [&Bits; 3], j: u32, trimmed: Option<&Columns>, mut found: impl FnMut([u32; 3], u8)) {
    let [low, high, _] = around;
    let (width, rows) = (low.width() - 1, low.row_count() - 1);
    let live = trimmed.map(|columns| Live::of(columns, j, width, rows));
    for k in 0..rows {
        let cells = [low.lit_row(k), high.lit_row(k), low.lit_row(k + 1), high.lit_row(k + 1)];
        if cells.iter().all(Option::is_none) {
            continue;
        }
        for w in 0..words_for(width) {
            let c = words_round(cells, w);
            let mut surface = c.iter().fold(0, |a, b| a | b) & !c.iter().fold(u64::MAX, |a, b| a & b);
            if let Some(live) = &live {
                surface &= live.row(k).map_or(0, |live| live[w]);
            }
            while surface != 0 {
                let bit = surface.trailing_zeros();
                surface &= surface - 1;
                let mask = mask_of(c, bit);
                let i = w as u32 * 64 + bit;
                if live.as_ref().is_none_or(|live| live.touches(i, k, mask)) {
                    found([i, j, k], mask);
                }
            }
        }
    }
}

/// Of the rows of cells round a row of corners (of slice dy, of row dz), word `w` of each of the eight cells: bit i is cell (i − 1 + dx) of the grid, so
/// corner i's.
#[inline]
fn words_round(cells: [Option<&[u64]>; 4], w: usize) -> [u64; 8] {
    let word = |dx: usize, row: Option<&[u64]>| {
        row.map_or(0, |row| {
            let next = row.get(w + 1).map_or(0, |next| next << 63);
            if dx == 0 { row[w] } else { row[w] >> 1 | next }
        })
    };
    std::array::from_fn(|i| word(i & 1, cells[i >> 1]))
}

/// The mask of the corner at a bit of these words.
#[inline]
fn mask_of(words: [u64; 8], bit: u32) -> u8 {
    (0..8).fold(0, |mask, i| mask | ((words[i] >> bit & 1) as u8) << i)
}

/// The mask of the corner one step along axis `m` from `corner`, from the slices round `corner`'s plane.
fn mask_at(around: [&Bits; 3], [i, _, k]: [u32; 3], m: usize) -> u8 {
    let step = |axis: usize| i64::from(axis == m);
    (0..8).fold(0, |mask, bit: usize| {
        let (dx, dy, dz) = ((bit & 1) as i64, bit >> 1 & 1, (bit >> 2) as i64);
        let slice = around[dy + usize::from(m == 1)];
        let set = slice.get(i64::from(i) + dx + step(0), i64::from(k) + dz + step(2));
        mask | u8::from(set) << bit
    })
}
/// As many rectangles for each slice as count for its memory: no fewer than its own faces with those that midpoints add, and than the vertices on its
/// lower plane; on the last one, on both planes. Memory for each job: three slices of bits.
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::Interrupted`].
pub fn weights(solid: &Solid, context: &Context) -> Result<Vec<u32>> {
    let (mut weights, last_plane) = weights_below(solid, context)?;
    if let Some(last) = weights.last_mut() {
        last.of_plane += last_plane;
    }
    Ok(weights.into_iter().map(Weight::rectangles).collect())
}

/// What counts for a slice's memory.
#[derive(Debug, Clone, Copy)]
pub struct Weight {
    /// Its own faces with those that midpoints add.
    faces: u32,
    /// The vertices on its lower plane.
    of_plane: u32,
}

impl Weight {
    /// As many rectangles as count for it.
    pub fn rectangles(self) -> u32 {
        self.faces.max(self.of_plane)
    }
}

/// [`weights`] without the plane above the last slice, and the number of its vertices.
///
/// # Errors
/// The same as [`weights`].
pub fn weights_below(solid: &Solid, context: &Context) -> Result<(Vec<Weight>, u32)> {
    let planes = vertices_of_planes(solid, context)?;
    let weight = |(faces, planes): (&u32, &[[u32; 2]])| {
        let [below, above] = [planes[0], planes[1]];
        Weight { faces: faces + below[1] + above[1], of_plane: below[0] }
    };
    let weights = solid.faces.iter().zip(planes.windows(2)).map(weight).collect();
    Ok((weights, planes.last().map_or(0, |[vertices, _]| *vertices)))
}

/// Of each plane, its vertices, and how many of them are midpoints.
fn vertices_of_planes(solid: &Solid, context: &Context) -> Result<Vec<[u32; 2]>> {
    let [_, slices, _] = solid.cells;
    let mut planes: Vec<[u32; 2]> = Vec::with_capacity(slices as usize + 1);
    let mut jobs = chunks(slices);
    context.workers.in_order(
        context.memory.chunks_in_flight,
        || Ok(jobs.next()),
        |chunk| counts(solid, chunk.start..chunk.end + u32::from(chunk.end == slices)),
        |counted: Vec<[u32; 2]>| {
            planes.extend(counted);
            Ok(())
        },
    )?;
    Ok(planes)
}

/// The number of vertices on each plane, and how many of them are midpoints.
fn counts(solid: &Solid, planes: std::ops::Range<u32>) -> Result<Vec<[u32; 2]>> {
    let [width, _, rows] = solid.cells;
    let (lowest, end) = (i64::from(planes.start), i64::from(planes.end));
    let columns = solid.ground.as_ref().map(|ground| ground.columns(lowest - 1..end + 1)).transpose()?;
    let trimmed = columns.as_ref().filter(|columns| columns.trimmed());
    let mut window = Window::new(3, || Bits::new(width + 2, rows + 2));
    let mut runs = Runs::default();
    let mut out = Vec::with_capacity(planes.len());
    for j in planes {
        let y = i64::from(j);
        window.slide_to(y - 1, |y, bits| solid.paint(y, bits, &mut runs))?;
        let around = [window.get(y - 1), window.get(y), window.get(y + 1)];
        let (mut sheets, mut midpoints) = (0, 0);
        each_corner(around, j, trimmed, |corner, mask| {
            let kind = &CORNERS[usize::from(mask)];
            sheets += u32::from(kind.sheets);
            if kind.doubled & DOUBLED_UPWARDS != 0 {
                midpoints += (0..3).filter(|m| has_midpoint(around, corner, mask, *m, trimmed)).count() as u32;
            }
        });
        out.push([sheets + midpoints, midpoints]);
    }
    Ok(out)
}
