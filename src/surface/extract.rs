//! Extraction: from the solid cells of a slab to its vertices and triangles.
//!
//! ```text
//!   y ^   plane y1   - - - - - - -   owned by the next slab; its vertices are named here, not made
//!     |   slice y1-1 [ faces       ]
//!     |   ...
//!     |   slice y0   [ faces       ]
//!     |   plane y0   - - - - - - -
//! ```
//!
//! A slab owns the planes y0 … y1 − 1 and the faces of its slices: those on a slice's lower plane and those within it. It
//! does not emit the faces on plane y1: they belong to the next slab. Seams close because both slabs derive plane y1's vertices
//! from the same cells, in the same order.
//!
//! All that is needed of a face is in the mask of its lowest corner: the face's cell is bit 7, its predecessor along axis a
//! bit 7 − 2^a.

use crate::error::Result;
use crate::grid::Cell;
use crate::grid::context::{Context, chunks};
use crate::grid::slice::{Bits, Runs, words_for};
use crate::grid::window::Window;
use crate::settings::surface::Diagonals;
use crate::solid::Solid;
use crate::solid::heightfield::{Columns, KEPT, LIVE_COLUMN, is_touched};
use crate::surface::corner::{CORNERS, NO_SHEET, neighbours, quadrant};

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
struct Plane {
    /// Rows of bits: is (i, k) a corner of the surface?
    corners: Bits,
    /// The number of corners before each word of `corners`.
    before: Vec<u32>,
    /// The mask of each corner, and the number of its first vertex.
    masks: Vec<u8>,
    first: Vec<u32>,
    /// The number of corners before each row.
    rows: Vec<u32>,
    /// Midpoints that belong to the plane, by (lower corner, axis). Nearly always empty.
    midpoints: Vec<((u32, u32, u8), u32)>,
}

/// The vertices of a slab's planes, with the look-ups that faces and smoothing need.
#[derive(Debug)]
pub struct Surface {
    /// Vertices, plane by plane from the lowest.
    pub vertices: Vec<Vertex>,
    planes: Vec<Plane>,
    /// The lowest plane.
    lowest: u32,
    /// The number of vertices before each plane; one entry more than planes.
    starts: Vec<u32>,
    /// The columns of the slices round the planes, if it is not closed: only corners of live ones are there.
    columns: Option<Columns>,
}

/// The triangles of some slices.
#[derive(Debug, Default)]
pub struct Triangles {
    /// Their vertices.
    pub corners: Vec<[u32; 3]>,
    /// Whether each triangle is written in the end; empty if all are.
    pub kept: Vec<bool>,
}

impl Surface {
    /// Finds the vertices on planes `planes` (clamped to those that exist).
    ///
    /// Memory: [`Surface::bytes`], and three slices of bits.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn find(solid: &Solid, planes: std::ops::RangeInclusive<i64>) -> Result<Surface> {
        let [width, slices, rows] = solid.cells;
        let (lowest, highest) = ((*planes.start()).max(0), (*planes.end()).min(i64::from(slices)));
        // A surface has about as many vertices as faces.
        let expected: usize =
            (lowest..=highest).filter_map(|y| solid.faces.get(y as usize)).map(|faces| *faces as usize).sum();
        let vertices = Vec::with_capacity(expected + expected / 32);
        let mut out = Surface { vertices, planes: Vec::new(), lowest: lowest as u32, starts: vec![0], columns: None };
        if let Some(ground) = &solid.ground {
            out.columns = Some(ground.columns(lowest - 1..highest + 2)?);
        }
        let trimmed = out.columns.as_ref().filter(|columns| columns.trimmed());
        let mut window = Window::new(3, || Bits::new(width + 2, rows + 2));
        let mut runs = Runs::default();
        for j in lowest..=highest {
            window.slide_to(j - 1, |y, bits| solid.paint(y, bits, &mut runs))?;
            let around = [window.get(j - 1), window.get(j), window.get(j + 1)];
            let plane = Plane::find(around, j as u32, trimmed, &mut out.vertices);
            out.planes.push(plane);
            out.starts.push(out.vertices.len() as u32);
        }
        Ok(out)
    }

    /// Bytes of a surface of so many vertices on `planes` planes of a grid of `cells`, with its look-ups; each is the only one at its corner.
    pub fn bytes(vertices: u64, planes: u64, [width, _, rows]: Cell) -> u64 {
        let words = words_for(width + 1) as u64 * u64::from(rows + 1);
        let lines = u64::from(rows + 2) * size_of::<u32>() as u64;
        let plane = Bits::bytes(width + 1, rows + 1) + words * size_of::<u32>() as u64 + lines;
        // What is known of corners is in vectors that grow.
        let corners = vertices * 2 * (size_of::<u8>() + size_of::<u32>()) as u64;
        vertices * size_of::<Vertex>() as u64 + corners + planes * plane
    }

    /// Bytes of the same without the look-ups.
    pub fn bytes_of_vertices(vertices: u64) -> u64 {
        vertices * size_of::<Vertex>() as u64
    }

    /// The numbers of the vertices on plane `j`.
    pub fn on_plane(&self, j: u32) -> std::ops::Range<u32> {
        let plane = (j - self.lowest) as usize;
        self.starts[plane]..self.starts[plane + 1]
    }

    /// The lowest and the highest plane held.
    pub fn planes(&self) -> std::ops::RangeInclusive<u32> {
        self.lowest..=self.lowest + self.planes.len() as u32 - 1
    }

    /// The vertex of corner (i, j, k) that has quadrant `q`.
    #[inline]
    pub fn vertex(&self, [i, j, k]: [u32; 3], q: usize) -> u32 {
        let plane = &self.planes[(j - self.lowest) as usize];
        let ordinal = plane.ordinal(i, k);
        let sheet = CORNERS[usize::from(plane.masks[ordinal])].sheet_of[q];
        debug_assert_ne!(sheet, NO_SHEET);
        plane.first[ordinal] + u32::from(sheet)
    }

    fn mask(&self, [i, j, k]: [u32; 3]) -> u8 {
        let plane = &self.planes[(j - self.lowest) as usize];
        plane.masks[plane.ordinal(i, k)]
    }

    /// Whether a corner is one of the surface's. Its plane must be held.
    pub fn has(&self, [i, j, k]: [u32; 3]) -> bool {
        self.planes[(j - self.lowest) as usize].corners.get(i64::from(i), i64::from(k))
    }

    /// The columns round the surface, if it is not closed.
    pub fn columns(&self) -> Option<&Columns> {
        self.columns.as_ref()
    }

    /// Gives back the memory of what [`Surface::vertex`], [`Surface::triangles`] and smoothing need; the vertices stay.
    pub fn drop_lookups(&mut self) {
        self.planes = Vec::new();
    }

    /// The two ends of the doubled edge that `vertex` is the middle of.
    pub fn ends(&self, vertex: &Vertex, axis: u8) -> [u32; 2] {
        let m = usize::from(axis);
        let mut upper = vertex.corner;
        upper[m] += 1;
        // Both pairs at the edge belong to the same sheet at either end: any quadrant there names it.
        let at = |mask: u8, edge: usize| neighbours(mask).find(|(e, _)| *e == edge).map(|(_, q)| q);
        let lower_quadrant = at(vertex.mask, 2 * m + 1).expect("a doubled edge has quadrants");
        let upper_quadrant = at(self.mask(upper), 2 * m).expect("a doubled edge has quadrants");
        [self.vertex(vertex.corner, lower_quadrant), self.vertex(upper, upper_quadrant)]
    }

    /// The triangles of slices `slices`, given the smoothed positions of all vertices, in cells; in the memory of `room`.
    pub fn triangles(
        &self,
        slices: std::ops::Range<u32>,
        q: &[[f64; 3]],
        diagonals: Diagonals,
        room: Vec<[u32; 3]>,
    ) -> Triangles {
        let planes = slices.clone().map(|y| &self.planes[(y - self.lowest) as usize]);
        let faces: usize = planes.flat_map(|plane| &plane.masks).map(|mask| faces_at(*mask)).sum();
        // Each middle cuts two triangles in two; those on the plane above lie on edges of these faces, too.
        let above = (slices.end.min(*self.planes().end()) - self.lowest) as usize;
        let below = (slices.start - self.lowest) as usize;
        let midpoints: usize = self.planes[below..=above].iter().map(|plane| plane.midpoints.len()).sum();
        let triangles = 2 * (faces + midpoints);
        let trimmed = self.columns.as_ref().filter(|columns| columns.trimmed());
        let kept = if trimmed.is_some() { Vec::with_capacity(triangles) } else { Vec::new() };
        let mut out = Triangles { corners: room, kept };
        out.corners.clear();
        out.corners.reserve_exact(triangles);
        for y in slices {
            let plane = &self.planes[(y - self.lowest) as usize];
            for row in plane.rows.windows(2) {
                let row = row[0] as usize..row[1] as usize;
                for axis in [1, 0, 2] {
                    for ordinal in row.clone() {
                        let mask = plane.masks[ordinal];
                        let (cell, predecessor) = (mask >> 7, mask >> (7 - (1 << axis)) & 1);
                        if cell == predecessor {
                            continue;
                        }
                        let corner = self.vertices[plane.first[ordinal] as usize].corner;
                        let flags = trimmed.map_or(KEPT | LIVE_COLUMN, |columns| columns.of_face(corner, axis));
                        if flags & LIVE_COLUMN != 0 {
                            self.face(corner, axis, predecessor == 1, q, diagonals, &mut out.corners);
                        }
                        if trimmed.is_some() {
                            out.kept.resize(out.corners.len(), flags & KEPT != 0);
                        }
                    }
                }
            }
        }
        out
    }

    /// The triangles of the face perpendicular to `a` whose lowest corner is `p00`.
    fn face(
        &self,
        p00: [u32; 3],
        a: usize,
        predecessor_solid: bool,
        q: &[[f64; 3]],
        diagonals: Diagonals,
        out: &mut Vec<[u32; 3]>,
    ) {
        let (b, c) = ((a + 1) % 3, (a + 2) % 3);
        let step = |d_b: u32, d_c: u32| {
            let mut corner = p00;
            corner[b] += d_b;
            corner[c] += d_c;
            corner
        };
        let mut corners = [p00, step(1, 0), step(1, 1), step(0, 1)];
        let mut quadrants = [quadrant(a, 1, 1), quadrant(a, 0, 1), quadrant(a, 0, 0), quadrant(a, 1, 0)];
        if !predecessor_solid {
            corners.swap(1, 3);
            quadrants.swap(1, 3);
        }
        let v: [u32; 4] = std::array::from_fn(|i| self.vertex(corners[i], quadrants[i]));
        let second = match diagonals {
            Diagonals::First => false,
            Diagonals::Random => splitmix64(p00, a) >> 63 == 1,
            Diagonals::Delaunay => second_is_delaunay(v.map(|v| q[v as usize])),
        };
        let triangles = if second { [[0, 1, 3], [1, 2, 3]] } else { [[0, 1, 2], [0, 2, 3]] };
        if corners.iter().all(|corner| CORNERS[usize::from(self.mask(*corner))].doubled == 0) {
            out.extend(triangles.map(|t| t.map(|i: usize| v[i])));
            return;
        }
        let mut solid_cell = p00.map(i64::from);
        solid_cell[a] -= i64::from(predecessor_solid);
        for triangle in triangles {
            let side = |i: usize| {
                let (from, to) = (triangle[i], triangle[(i + 1) % 3]);
                if (from + 2) % 4 == to { None } else { self.middle(corners[from], corners[to], solid_cell) }
            };
            split(triangle.map(|i| v[i]), [side(0), side(1), side(2)], out);
        }
    }

    /// The middle of the edge between two corners, if it is doubled and this solid cell's copy has one.
    fn middle(&self, from: [u32; 3], to: [u32; 3], solid_cell: [i64; 3]) -> Option<u32> {
        let m = (0..3).find(|&m| from[m] != to[m]).expect("a side has a direction");
        let (lower, upper) = if from[m] < to[m] { (from, to) } else { (to, from) };
        let both = CORNERS[usize::from(self.mask(lower))].doubled >> (2 * m + 1)
            & CORNERS[usize::from(self.mask(upper))].doubled >> (2 * m);
        let b = (m + 1) % 3;
        if both & 1 == 0 || solid_cell[b] != i64::from(lower[b]) - 1 {
            return None;
        }
        let plane = &self.planes[(lower[1] - self.lowest) as usize];
        let key = (lower[2], lower[0], m as u8);
        plane.midpoints.iter().find(|(place, _)| *place == key).map(|(_, vertex)| *vertex)
    }
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

/// The number of faces whose lowest corner has this mask.
fn faces_at(mask: u8) -> usize {
    (0..3).filter(|axis| (mask >> 7 ^ mask >> (7 - (1 << axis))) & 1 == 1).count()
}

/// Emits a triangle whose sides 01, 12, 20 may have a middle: the first that has one splits it in two.
fn split([a, b, c]: [u32; 3], [ab, bc, ca]: [Option<u32>; 3], out: &mut Vec<[u32; 3]>) {
    match (ab, bc, ca) {
        (None, None, None) => out.push([a, b, c]),
        (Some(m), ..) => {
            split([a, m, c], [None, None, ca], out);
            split([m, b, c], [None, bc, None], out);
        }
        // Turned, the side that has a middle comes first.
        (None, Some(_), _) => split([b, c, a], [bc, ca, ab], out),
        (None, None, Some(_)) => split([c, a, b], [ca, ab, bc], out),
    }
}

impl Plane {
    /// Finds plane `j`'s corners and appends its vertices. `around` are the slices j − 1, j and j + 1, each moved by one cell and row.
    fn find(around: [&Bits; 3], j: u32, trimmed: Option<&Columns>, vertices: &mut Vec<Vertex>) -> Plane {
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
    fn ordinal(&self, i: u32, k: u32) -> usize {
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

/// Whether the second diagonal (corners 1 and 3) makes the larger smallest angle, by more than rounding.
fn second_is_delaunay([p0, p1, p2, p3]: [[f64; 3]; 4]) -> bool {
    let first = largest_cosine(p0, p1, p2).max(largest_cosine(p0, p2, p3));
    let second = largest_cosine(p0, p1, p3).max(largest_cosine(p1, p2, p3));
    second < first - 1e-9
}

/// The cosine of a triangle's smallest angle.
fn largest_cosine(p: [f64; 3], q: [f64; 3], r: [f64; 3]) -> f64 {
    let minus = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (pq, qr, rp) = (minus(q, p), minus(r, q), minus(p, r));
    let (a, b, c) = (dot(pq, pq).sqrt(), dot(qr, qr).sqrt(), dot(rp, rp).sqrt());
    let at = |u, v, lengths: f64| -dot(u, v) / lengths;
    at(rp, pq, c * a).max(at(pq, qr, a * b)).max(at(qr, rp, b * c))
}

/// The splitmix64 generator's output for a face's place.
fn splitmix64([x, y, z]: [u32; 3], a: usize) -> u64 {
    let place = u64::from(x) | u64::from(y) << 20 | u64::from(z) << 40 | (a as u64) << 60;
    let mut h = place.wrapping_add(0x9E37_79B9_7F4A_7C15);
    h = (h ^ h >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ h >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    h ^ h >> 31
}
