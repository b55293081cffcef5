//! From solid cells to vertices and triangles: numbering, smoothing, diagonals.

use std::collections::BTreeMap;

use super::corner::{Cell, Corner, Face, Sheet, diagonal_cells, sheets};
use super::solid::Cells;

/// How a face is cut into two triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Diagonals {
    /// The larger smallest angle.
    Delaunay,
    /// Always diagonal 0.
    First,
    /// By the hash of the face.
    Random,
}

/// The surface before fitting, in the order of the output.
#[derive(Debug, Clone, Default)]
pub struct Surface {
    /// q' of every vertex, in cells along the grid's axes.
    pub positions: Vec<[f64; 3]>,
    /// The same after one step of smoothing, whatever steps there are.
    pub rest: Vec<[f64; 3]>,
    /// The plane of a vertex; of a doubled edge's middle, that of the edge's lower end.
    pub planes: Vec<u32>,
    /// Whether a vertex is the middle of a doubled edge.
    pub middle: Vec<bool>,
    /// The triangles.
    pub triangles: Vec<[u32; 3]>,
    /// The slice each triangle belongs to; `cells_y` for those on the topmost plane.
    pub slices: Vec<u32>,
    /// The face each triangle belongs to.
    pub faces: Vec<Face>,
    /// Of each triangle, whether it is written in the end.
    pub kept: Vec<bool>,
    /// The corner of a vertex that is not a middle.
    pub corners: Vec<Option<Corner>>,
    /// Whether a vertex bridges a hole.
    pub bridged: Vec<bool>,
    /// Whether a vertex lies where the surface is cut off: not all faces round it are made.
    pub cut_off: Vec<bool>,
    /// The solid whose surface it is.
    pub solid: Cells,
}

impl Surface {
    /// Leaves out the triangles of some faces.
    pub fn leave_out(&mut self, is_out: impl Fn(&Face) -> bool) {
        let stays: Vec<bool> = self.faces.iter().map(|face| !is_out(face)).collect();
        fn only<T>(list: &mut Vec<T>, stays: &[bool]) {
            let mut at = stays.iter();
            list.retain(|_| at.next() == Some(&true));
        }
        only(&mut self.triangles, &stays);
        only(&mut self.slices, &stays);
        only(&mut self.faces, &stays);
        only(&mut self.kept, &stays);
    }
}

/// Who is who before there are triangles.
#[derive(Default)]
struct Vertices {
    corners: BTreeMap<Corner, Vec<Sheet>>,
    /// Vertex number of the sheet that a face belongs to at a corner.
    number: BTreeMap<(Corner, Face), u32>,
    /// Middles by axis and lower end of their edge, with the solid cell whose copy they cut and the two ends.
    middles: BTreeMap<(usize, Corner), (u32, Cell, [u32; 2])>,
    count: u32,
}

fn next(corner: Corner, axis: usize) -> Corner {
    let mut next = corner;
    next[axis] += 1;
    next
}

impl Vertices {
    fn of(solid: &Cells) -> Vertices {
        let [cx, cy, cz] = solid.cells.map(|c| c as i32);
        let mut vertices = Vertices::default();
        for j in 0..=cy {
            for k in 0..=cz {
                for i in 0..=cx {
                    vertices.corners.insert([i, j, k], sheets([i, j, k], &|cell| solid.get(cell)));
                }
            }
        }
        for j in 0..=cy {
            for k in 0..=cz {
                for i in 0..=cx {
                    for sheet in &vertices.corners[&[i, j, k]] {
                        for &face in &sheet.faces {
                            vertices.number.insert(([i, j, k], face), vertices.count);
                        }
                        vertices.count += 1;
                    }
                }
            }
            // The upper ends of edges along y have no numbers yet: `end_middles` fills them in.
            for axes in [&[0, 2][..], &[1]] {
                for k in 0..=cz {
                    for i in 0..=cx {
                        for &axis in axes {
                            vertices.add_middle([i, j, k], axis, solid);
                        }
                    }
                }
            }
        }
        vertices.end_middles();
        vertices
    }

    /// Whether one sheet runs through all four faces of an edge at one of its ends.
    fn one_sheet(&self, end: Corner, axis: usize, along: i32) -> bool {
        let at_edge = |face: &&Face| face.axis != axis && face.cell[axis] == along;
        self.corners[&end].iter().any(|sheet| sheet.faces.iter().filter(at_edge).count() == 4)
    }

    fn add_middle(&mut self, corner: Corner, axis: usize, solid: &Cells) {
        let Some(cells) = diagonal_cells(corner, axis, 1, &|cell| solid.get(cell)) else { return };
        if [corner, next(corner, axis)].into_iter().all(|end| self.one_sheet(end, axis, corner[axis])) {
            self.middles.insert((axis, corner), (self.count, cells[0], [0; 2]));
            self.count += 1;
        }
    }

    fn end_middles(&mut self) {
        for (&(axis, corner), (_, cell, ends)) in &mut self.middles {
            for (end, at) in ends.iter_mut().zip([corner, next(corner, axis)]) {
                // Any face of the cell at the edge will do: all belong to the one sheet.
                let of_cell = |(c, face): &(Corner, Face)| {
                    *c == at && face.axis != axis && face.cell[axis] == corner[axis] && face.sides().contains(cell)
                };
                *end = *self.number.iter().find(|(key, _)| of_cell(key)).expect("an end has a sheet").1;
            }
        }
    }

    /// q' of every vertex.
    fn positions(&self, smooth: u32) -> Vec<[f64; 3]> {
        let mut displacement = vec![[0.0; 3]; self.count as usize];
        for way in ways(smooth) {
            let before = displacement.clone();
            for (corner, sheets) in &self.corners {
                for sheet in sheets {
                    let own = self.number[&(*corner, sheet.faces[0])] as usize;
                    let mut sum = [0.0; 3];
                    for turn in &sheet.turns {
                        let neighbour = self.number[&(turn.towards, turn.faces[0])];
                        assert_eq!(neighbour, self.number[&(turn.towards, turn.faces[1])], "a turn has one end");
                        for a in 0..3 {
                            let e = f64::from(turn.towards[a] - corner[a]);
                            sum[a] += e + before[neighbour as usize][a];
                        }
                    }
                    let r = sheet.turns.len() as f64;
                    displacement[own] = [0, 1, 2].map(|a| match way {
                        None => (before[own][a] + sum[a]) / (r + 1.0),
                        Some(part) => before[own][a] + part * (sum[a] / r - before[own][a]),
                    });
                }
            }
        }
        for d in displacement.iter_mut().flatten() {
            *d = d.clamp(-1.0, 1.0);
        }
        let mut positions = displacement.clone();
        for ((corner, _), &number) in &self.number {
            let d = displacement[number as usize];
            positions[number as usize] = [0, 1, 2].map(|a| f64::from(corner[a]) + d[a]);
        }
        for (&(axis, corner), &(middle, cell, ends)) in &self.middles {
            let [p, q] = ends.map(|end| positions[end as usize]);
            // Towards its solid cell: the edge's other copy stays where the edge is.
            let towards = [0, 1, 2].map(|a| match a == axis {
                true => 0.0,
                false if cell[a] < corner[a] => -0.25,
                false => 0.25,
            });
            positions[middle as usize] = [0, 1, 2].map(|a| (p[a] + q[a]) * 0.5 + towards[a]);
        }
        positions
    }
}

/// What smoothing does, one after the other: Eq. 4 (`None`), then a part of the way to the neighbours' mean, in and out.
fn ways(smooth: u32) -> Vec<Option<f64>> {
    let pairs = (1..smooth).flat_map(|_| [Some(5.0 / 8.0), Some(-(7.0 / 11.0))]);
    std::iter::repeat_n(None, smooth.min(1) as usize).chain(pairs).collect()
}

/// The surface of a solid, smoothed in `smooth` steps.
pub fn surface(solid: &Cells, smooth: u32, diagonals: Diagonals) -> Surface {
    let vertices = Vertices::of(solid);
    let count = vertices.count as usize;
    let mut surface = Surface {
        positions: vertices.positions(smooth),
        rest: vertices.positions(1),
        planes: vec![0; count],
        middle: vec![false; count],
        corners: vec![None; count],
        bridged: vec![false; count],
        cut_off: vec![false; count],
        solid: solid.clone(),
        ..Surface::default()
    };
    for ((corner, _), &number) in &vertices.number {
        surface.planes[number as usize] = corner[1] as u32;
        surface.corners[number as usize] = Some(*corner);
    }
    for ((_, corner), &(number, ..)) in &vertices.middles {
        surface.planes[number as usize] = corner[1] as u32;
        surface.middle[number as usize] = true;
    }

    let [cx, cy, cz] = solid.cells.map(|c| c as i32);
    for y in 0..=cy {
        for z in 0..=cz {
            for axis in [1, 0, 2] {
                for x in 0..=cx {
                    let face = Face { axis, cell: [x, y, z] };
                    let [below, above] = face.sides();
                    if solid.get(below) != solid.get(above) {
                        for triangle in triangles(face, solid, &vertices, &surface.positions, diagonals) {
                            surface.triangles.push(triangle);
                            surface.slices.push(y as u32);
                            surface.faces.push(face);
                            surface.kept.push(true);
                        }
                    }
                }
            }
        }
    }
    surface
}

fn triangles(face: Face, solid: &Cells, vertices: &Vertices, at: &[[f64; 3]], diagonals: Diagonals) -> Vec<[u32; 3]> {
    let (b, c) = ((face.axis + 1) % 3, (face.axis + 2) % 3);
    let p00 = face.cell;
    let (p10, p01, p11) = (next(p00, b), next(p00, c), next(next(p00, b), c));
    let [below, above] = face.sides();
    let (inside, corners) =
        if solid.get(below) { (below, [p00, p10, p11, p01]) } else { (above, [p00, p01, p11, p10]) };
    let v = corners.map(|corner| vertices.number[&(corner, face)]);

    let mut middles = BTreeMap::new();
    for edge in [(b, p00), (b, p01), (c, p00), (c, p10)] {
        if let Some(&(middle, cell, ends)) = vertices.middles.get(&edge)
            && cell == inside
        {
            middles.insert((ends[0].min(ends[1]), ends[0].max(ends[1])), middle);
        }
    }

    let cuts = [[[v[0], v[1], v[2]], [v[0], v[2], v[3]]], [[v[0], v[1], v[3]], [v[1], v[2], v[3]]]];
    let cut = match diagonals {
        Diagonals::First => 0,
        Diagonals::Random => {
            let [x, y, z] = face.cell.map(|n| n as u64);
            (splitmix64(x + (y << 20) + (z << 40) + ((face.axis as u64) << 60)) >> 63) as usize
        }
        Diagonals::Delaunay => larger_angle(v.map(|v| at[v as usize])),
    };
    cuts[cut].into_iter().flat_map(|triangle| split(triangle, &middles)).collect()
}

/// A triangle cut at the middles on its sides.
fn split(t: [u32; 3], middles: &BTreeMap<(u32, u32), u32>) -> Vec<[u32; 3]> {
    for [a, b, c] in [[t[0], t[1], t[2]], [t[1], t[2], t[0]], [t[2], t[0], t[1]]] {
        if let Some(&m) = middles.get(&(a.min(b), a.max(b))) {
            return [[a, m, c], [m, b, c]].into_iter().flat_map(|half| split(half, middles)).collect();
        }
    }
    vec![t]
}

/// Which diagonal of four places makes the larger smallest angle.
pub fn larger_angle(at: [[f64; 3]; 4]) -> usize {
    let cuts = [[[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]];
    let largest = cuts.map(|cut| cut.into_iter().map(|t| largest_cosine(t, &at)).fold(f64::MIN, f64::max));
    usize::from(largest[0] - largest[1] > 1e-9)
}

fn largest_cosine(t: [u32; 3], at: &[[f64; 3]]) -> f64 {
    let mut largest = f64::MIN;
    for [p, q, r] in [[t[0], t[1], t[2]], [t[1], t[2], t[0]], [t[2], t[0], t[1]]] {
        let [p, q, r] = [p, q, r].map(|v| at[v as usize]);
        let pq = [0, 1, 2].map(|a| q[a] - p[a]);
        let pr = [0, 1, 2].map(|a| r[a] - p[a]);
        let dot = |u: [f64; 3], v: [f64; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
        largest = largest.max(dot(pq, pr) / (dot(pq, pq).sqrt() * dot(pr, pr).sqrt()));
    }
    largest
}

/// One number of the generator SplitMix64 whose state before the call is `state`.
fn splitmix64(state: u64) -> u64 {
    let mut z = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
