//! Stitching: the slabs, arriving in order, become one mesh.
//!
//! ```text
//!   slab k+1   (being made)
//!   slab k     [ arrived ]     1. phase 2 of contraction at the seam between k - 1 and k
//!     ~ seam ~                 2. of vertices of k - 1 and k with the same point, one takes its place
//!   slab k-1   [ waiting ]     3. vertices of both retreat until no triangles intersect
//!                              4. nothing can change in k - 1 any more: it is numbered and written
//! ```
//!
//! A vertex's number is the count of surviving vertices before it. What the seam above slab k takes away lies in the
//! upper half of slab k, so the numbers in its lower half, which slab k - 1's triangles name, are final in time. A retreat mostly reaches a few cells;
//! those vertices of slab k up to the last that is named are *settled*, and a round that would move one of them is not done.

use glam::DVec3;

use crate::error::{Error, Result};
use crate::grid::Grid;
use crate::mesh::spool::{FaceRecord, Frame, MeshSpool};
use crate::seam::Seam;
use crate::slab::{BEFORE, SlabMesh};
use crate::stage::fate::Fate;
use crate::stage::near::Near;
use crate::stage::retreat::retreat;

/// The largest number of vertices: what a PLY file's `int` can index.
pub const VERTEX_LIMIT: u64 = i32::MAX as u64;

/// Vertices or triangles that are written at a time.
const PIECE: usize = 1 << 15;

/// Takes slabs in order and writes the mesh.
#[derive(Debug)]
pub struct Stitcher<'a> {
    grid: &'a Grid,
    /// Slices either side of a seam within which vertices of both slabs can have the same point.
    halo: u32,
    frame: Frame,
    near: Near,
    mesh: MeshSpool,
    waiting: Option<SlabMesh>,
    /// The number of the waiting slab's first vertex.
    base: u64,
    /// Numbers of the vertices of the slab before the waiting one.
    before: Vec<u32>,
    /// The waiting slab's vertices `0..settled` must stay as they are: the slab before names them.
    settled: u32,
    vertices: Vec<[f64; 3]>,
    faces: Vec<FaceRecord>,
    counts: Counts,
}

/// What became of the vertices.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
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
    /// Vertices that went back towards rest because triangles there would intersect.
    pub retreated: u64,
    /// Pairs of triangles that intersect still: none, unless cells are too small for the precision of coordinates, or a chain of
    /// retreats would have to reach through a whole slab.
    pub tangled: u64,
    /// Area of the triangles that bridge a hole: all three vertices stay where smoothing put them, for want of a point within reach.
    pub bridged_area: f64,
}

impl<'a> Stitcher<'a> {
    /// A stitcher that appends to `mesh`, whose positions are to be written in `frame`; `halo` as in [`crate::partition::halo`].
    pub fn new(grid: &'a Grid, halo: u32, frame: Frame, mesh: MeshSpool) -> Stitcher<'a> {
        Stitcher {
            grid,
            halo,
            frame,
            near: Near::new(grid, frame.origin),
            mesh,
            waiting: None,
            base: 0,
            before: Vec::new(),
            settled: 0,
            vertices: Vec::new(),
            faces: Vec::new(),
            counts: Counts::default(),
        }
    }

    /// Takes the next slab; gives one that is written, for its memory.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::TooManyElements`] past [`VERTEX_LIMIT`].
    pub fn add(&mut self, mut slab: SlabMesh) -> Result<Option<SlabMesh>> {
        let mut lower = self.waiting.take();
        if let Some(lower) = &mut lower {
            let mut seam = Seam::of(lower, &mut slab, self.settled, self.frame, self.near.scale());
            let mut changed = seam.close();
            changed.extend(seam.choose_fitted(self.grid, self.halo));
            changed.extend(seam.strayed(self.grid));
            let suspects = seam.triangles_around(changed);
            self.counts.tangled += retreat(&mut seam, &mut self.near, Some(suspects));
            seam.give_back_blocks();
            self.write(lower, Some(&slab))?;
        }
        self.waiting = Some(slab);
        Ok(lower)
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
        let after = self.base + slab.fate.iter().filter(|fate| **fate != Fate::Gone).count() as u64;
        if after > VERTEX_LIMIT {
            return Err(Error::TooManyElements {
                count: after,
                what: "vertices",
                limit: VERTEX_LIMIT,
                carrier: "a mesh file's int",
            });
        }
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
                Fate::Back(_) | Fate::Rest => self.counts.retreated += 1,
            }
            self.vertices.push(self.frame.place(slab.position(v)));
            if self.vertices.len() == PIECE {
                self.mesh.append_vertices(&self.vertices)?;
                self.vertices.clear();
            }
        }
        self.mesh.append_vertices(&self.vertices)?;
        self.vertices.clear();
        self.counts.tangled += slab.tangled;
        let numbers_after = next.map_or_else(Vec::new, |next| number(next, after));
        for triangle in slab.triangles_left() {
            self.faces.push(FaceRecord::new(triangle.map(|v| {
                if v >= BEFORE {
                    self.before[(v - BEFORE) as usize]
                } else if v >= slab.own() {
                    numbers_after[(v - slab.own()) as usize]
                } else {
                    numbers[v as usize]
                }
            })));
            if self.faces.len() == PIECE {
                self.mesh.append_faces(&self.faces)?;
                self.faces.clear();
            }
        }
        self.mesh.append_faces(&self.faces)?;
        self.faces.clear();
        self.counts.bridged_area += bridged_area(slab, next);
        let named = slab.triangles_left().flatten().filter(|v| (slab.own()..BEFORE).contains(v)).max();
        self.settled = named.map_or(0, |v| v - slab.own() + 1);
        self.base = after;
        self.before = numbers;
        Ok(())
    }
}

/// The area of a slab's triangles whose vertices all stay. Vertices of the slab before are named only by triangles that were contracted onto a point.
fn bridged_area(slab: &SlabMesh, next: Option<&SlabMesh>) -> f64 {
    let place = |v: u32| -> Option<DVec3> {
        let (mesh, v) = if v < slab.own() { (slab, v) } else { (next?, v.checked_sub(slab.own())?) };
        let stays = *mesh.fate.get(v as usize)? == Fate::Stays;
        stays.then(|| DVec3::from(mesh.position(v)))
    };
    let corners = slab.triangles_left().filter_map(|[a, b, c]| Some([place(a)?, place(b)?, place(c)?]));
    corners.map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum()
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
