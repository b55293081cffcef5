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
//! those vertices of slab k up to the last that is named are *frozen*, and a round that would move one of them is not done.
//!
//! **Beginning in the middle.** If the seam below slab a is *clean* ([`reach`]), stitching can begin there, with slab a - 1 as it is by itself. It is added first, and
//! nothing is written of it: what the seam makes of slab a is what matters, and how slab a calls those of slab a - 1's vertices that it was closed over. All from slab a
//! on comes out as in one run, with vertices numbered from where the [`Checkpoint`] says: those of slab a - 1 come just before, below zero if that is the first number.

pub mod apart;
pub mod checkpoint;
pub mod counts;
mod inside;
pub mod make;
pub mod numbers;
pub mod pieces;
pub mod reach;
pub mod seam;
pub mod size;
pub mod slab;
pub mod trim;

use glam::DVec3;

use self::checkpoint::{Checkpoint, Mark};
use self::counts::Counts;
use self::numbers::{InMesh, InSlab, Named};
use self::reach::{Part, SeamReport};
use self::seam::Seam;
use self::slab::SlabMesh;
use self::trim::{Trim, Trimmed};
use crate::error::{Error, Result};
use crate::grid::Grid;
use crate::mesh::MeshSource;
use crate::mesh::spool::{FaceRecord, Frame, MeshSpool};
use crate::points::Coordinate;
use crate::surface::untangle::broad_phase::BroadPhase;
use crate::surface::untangle::{Untangled, untangle};
use crate::surface::vertex_state::VertexState;

/// The largest number of vertices: what a PLY file's `int` can index.
pub const VERTEX_LIMIT: u64 = i32::MAX as u64;

/// Vertices or triangles that are written at a time.
const BATCH: usize = 1 << 15;

/// Takes slabs in order and writes the mesh.
#[derive(Debug)]
pub struct Stitcher<'a, T> {
    grid: &'a Grid,
    /// Slices either side of a seam within which vertices of both slabs can have the same point.
    halo: u32,
    broad_phase: BroadPhase,
    mesh: Appended,
    waiting: Option<SlabMesh<T>>,
    /// The slab that is to be added next.
    next: u32,
    /// All slabs below this one are written.
    written: u32,
    /// Vertices that are written: the number of the next one.
    vertices: u64,
    /// Numbers of the vertices of the slab before the waiting one.
    before: Vec<InMesh>,
    /// What is left out, if the surface is not closed.
    trim: Option<Trim>,
    /// The waiting slab's vertices `0..frozen` must stay as they are: the slab before names them.
    frozen: u32,
    counts: Counts,
    /// What each slab that was written added to [`Counts::bridged_area`].
    areas: Vec<f64>,
    seams: Vec<SeamReport>,
    /// How many of the waiting slab's first vertices the seam below it touched.
    touched: u32,
    /// Whether the seam below the waiting slab was clean.
    clean: bool,
}

/// A mesh that is appended to, vertex by vertex and triangle by triangle; they are handed on together.
#[derive(Debug)]
struct Appended {
    mesh: MeshSpool,
    frame: Frame,
    vertices: Vec<[f64; 3]>,
    attributes: Vec<u8>,
    faces: Vec<FaceRecord>,
    /// Triangles so far.
    face_count: u64,
}

impl Appended {
    fn vertex<T: Coordinate>(&mut self, slab: &SlabMesh<T>, v: InSlab) -> Result<()> {
        let stride = self.mesh.schema().stride();
        self.vertices.push(self.frame.place(slab.position(v)));
        self.attributes.extend_from_slice(&slab.attributes[v.at() * stride..][..stride]);
        if self.vertices.len() == BATCH { self.hand_on() } else { Ok(()) }
    }

    fn face(&mut self, vertices: [InMesh; 3]) -> Result<()> {
        self.face_count += 1;
        self.faces.push(FaceRecord::new(vertices.map(|InMesh(v)| v)));
        if self.faces.len() == BATCH { self.hand_on() } else { Ok(()) }
    }

    /// Hands what is gathered to the mesh.
    fn hand_on(&mut self) -> Result<()> {
        self.mesh.append_vertices(&self.vertices)?;
        self.mesh.append_attributes(&self.attributes)?;
        self.mesh.append_faces(&self.faces)?;
        self.vertices.clear();
        self.attributes.clear();
        self.faces.clear();
        Ok(())
    }
}

/// The mesh that slabs became.
#[derive(Debug)]
pub struct Stitched {
    /// The mesh.
    pub mesh: MeshSpool,
    /// What became of the vertices.
    pub counts: Counts,
    /// How each seam was closed, from the lowest on.
    pub seams: Vec<SeamReport>,
}

impl Stitched {
    /// What is to be known of a mesh of so many slabs that is whole.
    pub fn checkpoint(&self, slabs: u32) -> Checkpoint {
        let counts = [self.mesh.vertex_count(), self.mesh.face_count()];
        Checkpoint::new(slabs, counts, self.counts, self.seams.clone())
    }
}

impl<'a, T: Coordinate> Stitcher<'a, T> {
    /// A stitcher that appends to `mesh`, whose positions are to be written in `frame`; `halo` as in [`crate::grid::partition::halo`]. If the surface is `trimmed`,
    /// only triangles that are kept are written.
    #[cfg(any(test, feature = "internals"))]
    pub fn new(grid: &'a Grid, halo: u32, frame: Frame, mesh: MeshSpool, trimmed: bool) -> Stitcher<'a, T> {
        Stitcher::resumed(grid, halo, frame, mesh, trimmed, &Checkpoint::at(0))
    }

    /// [`Stitcher::new`] that goes on from a checkpoint: the slab to add first is [`Stitcher::next`]. `mesh` is to hold the vertices and triangles that the
    /// checkpoint counts, or none, if they are kept elsewhere.
    pub fn resumed(
        grid: &'a Grid,
        halo: u32,
        frame: Frame,
        mesh: MeshSpool,
        trimmed: bool,
        checkpoint: &Checkpoint,
    ) -> Stitcher<'a, T> {
        Stitcher {
            grid,
            halo,
            broad_phase: BroadPhase::new(grid, frame.origin),
            mesh: Appended {
                mesh,
                frame,
                vertices: Vec::new(),
                attributes: Vec::new(),
                faces: Vec::new(),
                face_count: checkpoint.faces,
            },
            waiting: None,
            next: checkpoint.slab.saturating_sub(1),
            written: checkpoint.slab,
            vertices: checkpoint.vertices,
            before: Vec::new(),
            trim: trimmed.then(Trim::default),
            frozen: 0,
            counts: checkpoint.counts(),
            areas: Vec::new(),
            seams: checkpoint.seams.clone(),
            touched: 0,
            clean: false,
        }
    }

    /// The mesh so far.
    pub fn mesh(&self) -> &MeshSpool {
        &self.mesh.mesh
    }

    /// The same, to ask for what was appended to it.
    pub fn mesh_mut(&mut self) -> &mut MeshSpool {
        &mut self.mesh.mesh
    }

    /// The number of the slab that is to be added next.
    pub fn next(&self) -> u32 {
        self.next
    }

    /// What is to be known to go on from the slab that was added last, if the seam below it was clean: all below it is written, and `mesh` holds that.
    pub fn checkpoint(&self) -> Option<Checkpoint> {
        let Mark { slab, vertices, faces, counts } = self.mark()?;
        Some(Checkpoint::new(slab, [vertices, faces], counts, self.seams.clone()))
    }

    /// The same in short.
    fn mark(&self) -> Option<Mark> {
        let (slab, vertices, faces, counts) = (self.written, self.vertices, self.mesh.face_count, self.counts);
        self.clean.then_some(Mark { slab, vertices, faces, counts })
    }

    /// Takes the next slab; gives one that is written, for its memory.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::TooManyElements`] past [`VERTEX_LIMIT`].
    pub fn add(&mut self, mut slab: SlabMesh<T>) -> Result<Option<SlabMesh<T>>> {
        let mut lower = self.waiting.take();
        if let Some(lower) = &mut lower {
            let waiting = lower.claim.bytes();
            lower.claim.set(waiting + lower.size.bytes_at_seam(slab.size, self.trim.is_some()));
            let (report, touched, tangled) = self.close(lower, &mut slab);
            lower.claim.set(waiting);
            (self.touched, self.clean) = (touched, report.clean);
            if self.next == self.written {
                // Stitching began in the middle: the seam and the slab below it were counted, and written, where the checkpoint was made.
                self.pass_over(lower, &slab);
            } else {
                self.counts.tangled += tangled;
                self.seams.push(report);
                self.write(lower, Some(&slab))?;
            }
        }
        self.waiting = Some(slab);
        self.next += 1;
        Ok(lower)
    }

    /// Closes the seam between two slabs: how, how many of the upper one's first vertices are touched now, and how many pairs of triangles still intersect.
    fn close(&mut self, lower: &mut SlabMesh<T>, upper: &mut SlabMesh<T>) -> (SeamReport, u32, u64) {
        let settled = if Part::Settled.is_on() { self.touched.max(self.frozen) } else { self.touched };
        let mut seam = Seam::of(lower, upper, self.frozen, self.mesh.frame, self.broad_phase.quantizer());
        let mut changed = seam.close();
        changed.extend(seam.choose_fitted(self.grid, self.halo));
        changed.extend(seam.strayed(self.grid));
        let dirty = seam.triangles_around(changed);
        let Untangled { tangled, rounds } = untangle(&mut seam, &mut self.broad_phase, Some(dirty));
        let (report, touched) = seam.report(rounds, settled);
        seam.give_back_blocks();
        (report, touched, tangled)
    }

    /// Writes the last slab and gives the mesh.
    ///
    /// # Errors
    /// The same as [`Stitcher::add`].
    pub fn finish(self) -> Result<Stitched> {
        Ok(self.finish_piece()?.0)
    }

    /// [`Stitcher::finish`] with what each slab added to the area of bridged triangles.
    fn finish_piece(mut self) -> Result<(Stitched, Vec<f64>)> {
        // Where stitching begins in the middle, the slab before that is not written.
        if let Some(last) = self.waiting.take().filter(|_| self.next > self.written) {
            self.write(&last, None)?;
        }
        Ok(self.end_here())
    }

    /// What is written, without the slab that was added last.
    fn end_here(self) -> (Stitched, Vec<f64>) {
        (Stitched { mesh: self.mesh.mesh, counts: self.counts, seams: self.seams }, self.areas)
    }

    fn write(&mut self, slab: &SlabMesh<T>, next: Option<&SlabMesh<T>>) -> Result<()> {
        self.counts.tangled += slab.tangled;
        let area = bridged_area(slab, next);
        self.counts.bridged_area += area;
        self.areas.push(area);
        let base = self.vertices as u32;
        let after = if let Some(trim) = &mut self.trim {
            let Trimmed { written, triangles, frozen } = trim.slab(slab, next, |_| base);
            let after = self.number_after(written.iter().filter(|written| **written).count())?;
            for ((v, written), state) in (0..).zip(written).zip(&slab.state) {
                if written {
                    self.mesh.vertex(slab, InSlab(v))?;
                }
                if written || *state == VertexState::Contracted {
                    self.counts.count(*state);
                }
            }
            triangles.into_iter().try_for_each(|triangle| self.mesh.face(triangle))?;
            self.frozen = frozen;
            after
        } else {
            let after = self.number_after(left(&slab.state))?;
            let numbers = number(&slab.state, base);
            for (v, state) in (0..).zip(&slab.state) {
                self.counts.count(*state);
                if *state != VertexState::Contracted {
                    self.mesh.vertex(slab, InSlab(v))?;
                }
            }
            self.frozen = named_of_next(slab);
            let numbers_after =
                next.map_or_else(Vec::new, |next| number(&next.state[..self.frozen as usize], after as u32));
            for triangle in slab.triangles_left() {
                self.mesh.face(triangle.map(|name| match slab.named(name) {
                    Named::Own(v) => numbers[v.at()],
                    Named::Next(v) => numbers_after[v.at()],
                    Named::Before(v) => self.before[v.at()],
                }))?;
            }
            self.before = numbers;
            after
        };
        self.mesh.hand_on()?;
        self.vertices = after;
        self.written += 1;
        Ok(())
    }

    /// What [`Stitcher::write`] leaves behind for the slab after it, and nothing else: the slab's last vertex comes just before the first one that is going to be written.
    fn pass_over(&mut self, slab: &SlabMesh<T>, next: &SlabMesh<T>) {
        let after = self.vertices as u32;
        if let Some(trim) = &mut self.trim {
            self.frozen = trim.slab(slab, Some(next), |written| after.wrapping_sub(written)).frozen;
        } else {
            self.before = number(&slab.state, after.wrapping_sub(left(&slab.state) as u32));
            self.frozen = named_of_next(slab);
        }
    }

    /// The number of the first vertex after `more` others.
    fn number_after(&self, more: usize) -> Result<u64> {
        within_limit(self.vertices + more as u64)
    }
}

/// So many vertices, if a mesh file can number them.
fn within_limit(count: u64) -> Result<u64> {
    let (limit, carrier) = (VERTEX_LIMIT, "a mesh file's int");
    if count > limit { Err(Error::TooManyElements { count, what: "vertices", limit, carrier }) } else { Ok(count) }
}

/// The area of a slab's triangles that are written and whose vertices all stay, or lie at an interpolated height. Vertices of the slab before are named only by triangles that were contracted onto a point.
fn bridged_area<T: Coordinate>(slab: &SlabMesh<T>, next: Option<&SlabMesh<T>>) -> f64 {
    let place = |name: u32| -> Option<DVec3> {
        let (mesh, v) = match slab.named(name) {
            Named::Own(v) => (slab, v),
            Named::Next(v) => (next?, v),
            Named::Before(_) => return None,
        };
        let stays = matches!(mesh.state[v.at()], VertexState::Unfitted | VertexState::Bridged);
        stays.then(|| DVec3::from(mesh.position(v)))
    };
    let corners = slab.triangles_written().filter_map(|[a, b, c]| Some([place(a)?, place(b)?, place(c)?]));
    corners.map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum()
}

/// The numbers of vertices, given what became of them, counted from `base`; those of contracted ones mean nothing. Below zero, numbers wrap.
fn number(states: &[VertexState], base: u32) -> Vec<InMesh> {
    let mut next = base;
    states
        .iter()
        .map(|state| {
            let number = InMesh(next);
            next = next.wrapping_add(u32::from(*state != VertexState::Contracted));
            number
        })
        .collect()
}

/// How many vertices are left of contraction.
fn left(states: &[VertexState]) -> usize {
    states.iter().filter(|state| **state != VertexState::Contracted).count()
}

/// How many of the next slab's first vertices there are up to the last that a slab's triangles name.
fn named_of_next<T: Coordinate>(slab: &SlabMesh<T>) -> u32 {
    let named = slab.triangles_left().flatten().filter_map(|name| slab.named(name).of_next()).max();
    named.map_or(0, |v| v.0 + 1)
}

#[cfg(test)]
mod tests;
