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
use crate::grid::slice::{Bits, Runs, words_for};
use crate::grid::window::Window;
use crate::settings::surface::Diagonals;
use crate::solid::Solid;
use crate::solid::heightfield::{Columns, KEPT, LIVE_COLUMN};
use crate::surface::corner::{CORNERS, NO_SHEET, neighbours, quadrant};
use crate::surface::vertices::{Plane, Vertex};

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
/// Whether the second diagonal (corners 1 and 3) makes the larger smallest angle, by more than rounding.
pub fn second_is_delaunay([p0, p1, p2, p3]: [[f64; 3]; 4]) -> bool {
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
