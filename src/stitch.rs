//! Stitching: the slabs, arriving in order, become one mesh.
//!
//! ```text
//!   slab k+1   (being made)
//!   slab k     [ arrived ]     1. phase 2 of contraction at the seam between k - 1 and k
//!     ~ seam ~                 2. of vertices of k - 1 and k with the same point, one takes its place
//!   slab k-1   [ waiting ]     3. nothing can change in k - 1 any more: it is numbered and written
//! ```
//!
//! A vertex's number is the count of surviving vertices before it. What the seam above slab k takes away lies in the
//! upper half of slab k, so the numbers in its lower half, which slab k - 1's triangles name, are final in time.

use std::collections::BTreeSet;

use rustc_hash::FxHashMap;

use crate::error::{Error, Result};
use crate::grid::Grid;
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::slab::{BEFORE, Fate, SlabMesh};
use crate::stage::contract::{Fans, GONE, Groups, NONE, contract};

/// The largest number of vertices: what a PLY file's `int` can index.
pub const VERTEX_LIMIT: u64 = i32::MAX as u64;

/// Takes slabs in order and writes the mesh.
#[derive(Debug)]
pub struct Stitcher<'a> {
    grid: &'a Grid,
    /// Slices either side of a seam within which vertices of both slabs can have the same point.
    halo: u32,
    /// Taken off every position.
    origin: [f64; 3],
    mesh: MeshSpool,
    waiting: Option<SlabMesh>,
    /// The number of the waiting slab's first vertex.
    base: u64,
    /// Numbers of the vertices of the slab before the waiting one.
    before: Vec<u32>,
    vertices: Vec<[f64; 3]>,
    faces: Vec<FaceRecord>,
    counts: Counts,
}

/// What became of the vertices.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counts {
    /// Vertices that are input points, bit for bit.
    pub fitted: u64,
    /// Vertices moved into the plane of the points round them.
    pub projected: u64,
    /// Vertices pulled towards a point that another vertex took.
    pub pulled: u64,
    /// Vertices that stay where smoothing put them: no point within reach, or not to be fitted.
    pub unfitted: u64,
    /// Vertices contracted into others.
    pub contracted: u64,
}

/// A vertex of the two slabs at a seam; ordered as the whole mesh's vertices are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
enum Side {
    Lower(u32),
    Upper(u32),
}

impl<'a> Stitcher<'a> {
    /// A stitcher that appends to `mesh`; `halo` as in [`crate::partition::halo`].
    pub fn new(grid: &'a Grid, halo: u32, origin: [f64; 3], mesh: MeshSpool) -> Stitcher<'a> {
        Stitcher {
            grid,
            halo,
            origin,
            mesh,
            waiting: None,
            base: 0,
            before: Vec::new(),
            vertices: Vec::new(),
            faces: Vec::new(),
            counts: Counts::default(),
        }
    }

    /// Takes the next slab.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::TooManyElements`] past [`VERTEX_LIMIT`].
    pub fn add(&mut self, mut slab: SlabMesh) -> Result<()> {
        if let Some(mut lower) = self.waiting.take() {
            close_seam(&mut lower, &mut slab);
            choose_fitted(&mut lower, &mut slab, self.grid, self.halo);
            self.write(&lower, Some(&slab))?;
        }
        self.waiting = Some(slab);
        Ok(())
    }

    /// Writes the last slab and gives the mesh.
    ///
    /// # Errors
    /// As [`Stitcher::add`].
    pub fn finish(mut self) -> Result<(MeshSpool, Counts)> {
        if let Some(last) = self.waiting.take() {
            self.write(&last, None)?;
        }
        Ok((self.mesh, self.counts))
    }

    fn write(&mut self, slab: &SlabMesh, next: Option<&SlabMesh>) -> Result<()> {
        self.vertices.clear();
        let numbers = number(slab, self.base);
        for v in 0..slab.own() {
            match slab.fate[v as usize] {
                Fate::Gone => {
                    self.counts.contracted += 1;
                    continue;
                }
                Fate::Fitted => self.counts.fitted += 1,
                Fate::Projected => self.counts.projected += 1,
                Fate::Pulled => self.counts.pulled += 1,
                Fate::Stays => self.counts.unfitted += 1,
            }
            let position = slab.position(v);
            self.vertices.push(std::array::from_fn(|a| position[a] - self.origin[a]));
        }
        let after = self.base + self.vertices.len() as u64;
        if after > VERTEX_LIMIT {
            return Err(Error::TooManyElements {
                count: after,
                what: "vertices",
                limit: VERTEX_LIMIT,
                carrier: "a mesh file's int",
            });
        }
        let numbers_after = next.map_or_else(Vec::new, |next| number(next, after));
        self.faces.clear();
        self.faces.extend(slab.triangles_left().map(|t| {
            FaceRecord::new(t.map(|v| {
                if v >= BEFORE {
                    self.before[(v - BEFORE) as usize]
                } else if v >= slab.own() {
                    numbers_after[(v - slab.own()) as usize]
                } else {
                    numbers[v as usize]
                }
            }))
        }));
        self.mesh.append_vertices(&self.vertices)?;
        self.mesh.append_faces(&self.faces)?;
        self.base = after;
        self.before = numbers;
        Ok(())
    }
}

/// The numbers of a slab's vertices, counted from `base`; those of contracted ones mean nothing.
fn number(slab: &SlabMesh, base: u64) -> Vec<u32> {
    let mut next = base as u32;
    slab.fate
        .iter()
        .map(|fate| {
            let number = next;
            next += u32::from(*fate != Fate::Gone);
            number
        })
        .collect()
}

/// The two slabs at a seam, seen as one mesh.
struct Seam<'a> {
    lower: &'a mut SlabMesh,
    upper: &'a mut SlabMesh,
}

impl Seam<'_> {
    /// The triangles at a vertex, as (is it the upper slab's, its number there).
    fn triangles_at(&self, v: Side) -> Vec<(bool, usize)> {
        let at = |fans: &Fans, mesh: &SlabMesh, v: u32, upper: bool| -> Vec<(bool, usize)> {
            if (v as usize) < fans.len() {
                fans.at(v, &mesh.triangles).map(|(t, _)| (upper, t)).collect()
            } else {
                Vec::new()
            }
        };
        match v {
            Side::Lower(v) => at(&self.lower.fans, self.lower, v, false),
            Side::Upper(v) => {
                let mut all = at(&self.lower.fans, self.lower, self.lower.own() + v, false);
                all.extend(at(&self.upper.fans, self.upper, v, true));
                all
            }
        }
    }

    fn corners(&self, (upper, triangle): (bool, usize)) -> [Side; 3] {
        let own = self.lower.own();
        if upper {
            self.upper.triangles[triangle].map(Side::Upper)
        } else {
            self.lower.triangles[triangle].map(|v| if v < own { Side::Lower(v) } else { Side::Upper(v - own) })
        }
    }

    /// The vertex's point as something to compare: its coordinates' bits. None if it has none or is the slab's after the upper one.
    fn point(&self, v: Side) -> Option<[u64; 3]> {
        let (mesh, v) = match v {
            Side::Lower(v) => (&*self.lower, v),
            Side::Upper(v) => (&*self.upper, v),
        };
        // A lower slab's triangle may name vertices of the slab before it (from BEFORE on): not of this seam.
        let point = mesh.fitted.point.get(v as usize)?;
        (*point != NONE).then(|| mesh.fitted.target[v as usize].map(f64::to_bits))
    }

    fn distance(&self, v: Side) -> f64 {
        match v {
            Side::Lower(v) => self.lower.fitted.distance[v as usize],
            Side::Upper(v) => self.upper.fitted.distance[v as usize],
        }
    }
}

/// Phase 2: contracts the vertices that edges between vertices of the same point join to the seam's plane.
fn close_seam(lower: &mut SlabMesh, upper: &mut SlabMesh) {
    let seam = Seam { lower, upper };
    let mut joined: BTreeSet<Side> = BTreeSet::new();
    for start in (0..seam.upper.seam).map(Side::Upper) {
        let Some(point) = seam.point(start) else { continue };
        let mut open = vec![start];
        while let Some(v) = open.pop() {
            // A vertex alone on its point is not worth carrying along: it is added once a second one is found.
            for triangle in seam.triangles_at(v) {
                for u in seam.corners(triangle) {
                    if u != v && seam.point(u) == Some(point) {
                        joined.insert(v);
                        if joined.insert(u) {
                            open.push(u);
                        }
                    }
                }
            }
        }
    }
    if joined.is_empty() {
        return;
    }

    // The fans of the joined vertices, as a mesh of their own; its vertices are numbered in the order of the whole mesh's.
    let mut patch: Vec<(bool, usize)> = joined.iter().flat_map(|&v| seam.triangles_at(v)).collect();
    patch.sort_unstable();
    patch.dedup();
    let vertices: BTreeSet<Side> = patch.iter().flat_map(|&t| seam.corners(t)).collect();
    let vertices: Vec<Side> = vertices.into_iter().collect();
    let local: FxHashMap<Side, u32> = vertices.iter().enumerate().map(|(i, v)| (*v, i as u32)).collect();
    let mut points: FxHashMap<[u64; 3], u32> = FxHashMap::default();
    let mut group = Vec::with_capacity(vertices.len());
    let mut distance = Vec::with_capacity(vertices.len());
    for v in &vertices {
        match seam.point(*v).filter(|_| joined.contains(v)) {
            Some(point) => {
                let number = points.len() as u32;
                group.push(*points.entry(point).or_insert(number));
                distance.push(seam.distance(*v));
            }
            None => {
                group.push(NONE);
                distance.push(f64::INFINITY);
            }
        }
    }
    let mut triangles: Vec<[u32; 3]> = patch.iter().map(|&t| seam.corners(t).map(|v| local[&v])).collect();
    let mut fans = Fans::new(&triangles, vertices.len());
    let groups = Groups { group: &group, distance: &distance };
    let mut gone = Vec::new();
    contract(&mut triangles, &mut fans, groups, |dead, _| gone.push(dead));

    let Seam { lower, upper } = seam;
    let own = lower.own();
    for dead in gone {
        match vertices[dead as usize] {
            Side::Lower(v) => lower.fate[v as usize] = Fate::Gone,
            Side::Upper(v) => upper.fate[v as usize] = Fate::Gone,
        }
    }
    for (&(in_upper, number), triangle) in patch.iter().zip(&triangles) {
        let new = if *triangle == GONE {
            GONE
        } else {
            triangle.map(|v| match (vertices[v as usize], in_upper) {
                (Side::Lower(v), false) | (Side::Upper(v), true) => v,
                (Side::Upper(v), false) => own + v,
                (Side::Lower(v), true) => BEFORE + v,
            })
        };
        if in_upper {
            upper.triangles[number] = new;
        } else {
            lower.triangles[number] = new;
        }
    }
}

/// Where vertices of both slabs took the same point's place, only the nearer keeps it.
fn choose_fitted(lower: &mut SlabMesh, upper: &mut SlabMesh, grid: &Grid, halo: u32) {
    let seam = upper.slices.start;
    // A vertex of the other slab can have the same point only if the point lies this near to the seam.
    let near = seam.saturating_sub(halo)..seam + halo;
    let fitted_near = |mesh: &SlabMesh| -> Vec<u32> {
        (0..mesh.own())
            .filter(|&v| mesh.fate[v as usize] == Fate::Fitted)
            .filter(|&v| near.contains(&grid.slice_of(mesh.fitted.target[v as usize])))
            .collect()
    };
    let key = |mesh: &SlabMesh, v: u32| mesh.fitted.target[v as usize].map(f64::to_bits);
    let below: FxHashMap<[u64; 3], u32> = fitted_near(lower).into_iter().map(|v| (key(lower, v), v)).collect();
    for v in fitted_near(upper) {
        if let Some(&u) = below.get(&key(upper, v)) {
            if upper.fitted.distance[v as usize] < lower.fitted.distance[u as usize] {
                lower.fate[u as usize] = Fate::Pulled;
            } else {
                upper.fate[v as usize] = Fate::Pulled;
            }
        }
    }
}
