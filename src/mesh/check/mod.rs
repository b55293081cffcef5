//! The one strict mesh checker, for meshes of any size in bounded memory.
//!
//! ```text
//!  survey     every triangle once, in groups: smallest and largest vertex number of each block; area and volume
//!  far        area and volume of groups whose triangles' vertices lie far apart
//!  vertices   range by range: the corners at each vertex, gathered from the blocks that touch the range, tell of its edges
//!             and fans; a union-find within the range, joined to the others' by the edges that leave it, of components
//!  edges      only if some vertex has several fans: components once more, by triangles that share an edge
//! ```
//!
//! Whether triangles intersect is a question of its own, which takes longer: [`intersections`].
//!
//! A mesh whose triangles name vertices near each other is read about three times. One in random order is read as often as
//! there are ranges, and the budget decides how large they are. The findings are the same for every budget and any number
//! of threads, to the last bit of area and volume.

mod blocks;
mod components;
mod link;
mod report;
mod survey;
#[cfg(test)]
mod tests;
mod vertices;

use glam::DVec3;

use self::blocks::Stars;
use self::link::Examiner;
pub use self::report::CheckReport;
use self::vertices::Bounds;
use super::measure::{Corners, GROUP, Sums};
use super::{MeshSource, check_vertex_count};
use crate::error::Result;
pub use crate::mesh::intersections::{Intersection, Intersections, intersections};
use crate::resources::workers::{Spares, Workers};
use crate::storage::spool::Workspace;

/// Vertices of a range while the triangles at them lie close together: its corners stay in a processor's cache.
const NEAR_RANGE: u32 = 1 << 15;
/// Bytes for each vertex of a range: up to 8 corners of 8 bytes on average, its place among them, its parent and flags,
/// and, if the mesh is in random order, three edges that leave the range and the room a vector grows by.
const VERTEX_BYTES: u64 = 64 + 8 + 6 + 48;
/// Bytes for each triangle of a far group: see [`Corners::fill`], and the triangle itself.
const FAR_BYTES: u64 = 122;

/// Checks a mesh: topology, area, volume, box. Does not look for self-intersections: that is [`intersections`].
///
/// Memory: about `budget` bytes, but no less than some 8 MB for each worker; beyond that 2 KB for every million triangles,
/// and 32 bytes for each triangle of the vertex that has the most. `progress` is told the number of triangles done, up
/// to the number of triangles; both passes over them count half.
///
/// # Errors
/// What reading the mesh or the work directory gives; [`crate::Error::TooManyElements`] if 32 bits cannot number the
/// vertices; [`crate::Error::CheckFailed`] if a triangle names a vertex
/// that is not there; [`crate::Error::Interrupted`].
pub fn check(
    mesh: &dyn MeshSource,
    budget: u64,
    workers: &Workers,
    workspace: &Workspace,
    progress: &mut dyn FnMut(u64),
) -> Result<CheckReport> {
    check_vertex_count(mesh.vertex_count())?;
    Check { mesh, plan: Plan::for_budget(budget, workers.threads()), workers, workspace }.run(progress)
}

/// The budget as sizes. None of them shows in the findings.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    /// Jobs under way at a time.
    pub(crate) in_flight: usize,
    /// Triangles of a block.
    pub(crate) block: usize,
    /// Vertices that are read along with a group of triangles if its numbers span no more.
    pub(crate) window: usize,
    /// Triangles of far groups measured at once.
    pub(crate) far: usize,
    /// Vertices of a range: the least, and the most.
    pub(crate) range: (u32, u32),
    /// Bytes for the components of the whole mesh.
    pub(crate) components: u64,
}

impl Plan {
    pub(crate) fn for_budget(budget: u64, threads: usize) -> Plan {
        let in_flight = threads + 1;
        let job = budget / 4 * 3 / in_flight as u64;
        let most = (job / VERTEX_BYTES).clamp(u64::from(NEAR_RANGE) / 4, 1 << 31) as u32;
        Plan {
            in_flight,
            block: GROUP / 4,
            window: (job / 48).clamp(GROUP as u64, 4 * GROUP as u64) as usize,
            far: (job / FAR_BYTES) as usize / GROUP * GROUP,
            range: (NEAR_RANGE.min(most), most),
            components: budget / 4,
        }
    }
}

pub(crate) struct Check<'a> {
    pub(crate) mesh: &'a dyn MeshSource,
    pub(crate) plan: Plan,
    pub(crate) workers: &'a Workers,
    pub(crate) workspace: &'a Workspace,
}

/// The working memory of one job, handed from job to job.
#[derive(Default)]
struct Scratch {
    faces: Vec<[u32; 3]>,
    corners: Corners,
    stars: Stars<[u32; 2]>,
    examiner: Examiner,
    parents: Vec<u32>,
    used: Vec<bool>,
    reached: Vec<bool>,
    positions: Vec<[f64; 3]>,
}

impl Check<'_> {
    fn run(&self, progress: &mut dyn FnMut(u64)) -> Result<CheckReport> {
        let scratch = Spares::default();
        let triangles = self.mesh.face_count();
        let mut survey = self.survey(&scratch, &mut |done| progress(done / 2))?;
        self.measure_far(&mut survey.sums, &scratch)?;
        let sums = survey.sums.iter().flatten().fold(Sums::NONE, |sum, group| sum.plus(*group));

        let found = self.vertices(&survey.blocks, &scratch, &mut |done| progress(triangles / 2 + done / 2))?;
        drop(scratch);
        let (tally, sound) = (&found.tally, triangles - survey.degenerate);
        let mut components = found.sets;
        if tally.nonmanifold_vertices > 0 {
            components = sound - self.merges_by_edges(&survey.blocks)?;
        }
        progress(triangles);

        let euler = tally.used as i64 - tally.edges as i64 + sound as i64;
        let closed = tally.edges > 0 && tally.boundary == 0 && tally.nonmanifold_edges == 0;
        let oriented = tally.unbalanced == 0;
        let manifold = tally.nonmanifold_edges == 0 && tally.nonmanifold_vertices == 0;
        let Bounds(low, high) = found.bounds;
        let bounds = (low.x <= high.x).then(|| [low.to_array(), high.to_array()]);
        let centre = if bounds.is_some() { low.midpoint(high) } else { DVec3::ZERO };
        Ok(CheckReport {
            vertices: self.mesh.vertex_count(),
            triangles,
            edges: tally.edges,
            boundary_edges: tally.boundary,
            boundary_loops: found.loops,
            nonmanifold_edges: tally.nonmanifold_edges,
            inconsistent_edges: tally.inconsistent,
            nonmanifold_vertices: tally.nonmanifold_vertices,
            unreferenced_vertices: self.mesh.vertex_count() - tally.used,
            degenerate_triangles: survey.degenerate,
            duplicate_triangles: tally.duplicates,
            nonfinite_vertices: found.nonfinite,
            euler,
            components,
            genus: (closed && oriented && manifold).then(|| (components as i64 - euler / 2) as u64),
            area: sums.area,
            volume: closed.then(|| sums.volume_about(centre)),
            bounds,
            closed,
            oriented,
            manifold,
            intersections: None,
        })
    }
}
