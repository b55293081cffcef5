//! The one strict mesh checker, for meshes of any size in bounded memory.
//!
//! ```text
//!  survey     every triangle, in groups: smallest and largest vertex number of each block; area and volume
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
pub(crate) mod job;
mod link;
mod report;
pub(crate) mod shares;
mod survey;
#[cfg(test)]
mod tests;
mod vertices;

use glam::DVec3;

use self::job::{Check, Plan};
pub use self::report::CheckReport;
use self::survey::Survey;
use self::vertices::{Bounds, Found};
use super::measure::Sums;
use super::{MeshSource, check_vertex_count};
use crate::error::Result;
pub use crate::mesh::intersections::intersections;
use crate::resources::workers::{Spares, Workers};
use crate::storage::spool::Workspace;

/// Checks a mesh: topology, area, volume, box. Does not look for self-intersections: that is [`intersections`].
///
/// Memory: about `budget` bytes, but no less than some 8 MB for each worker; beyond that 2 KB for every million triangles,
/// and 32 bytes for each triangle of the vertex that has the most. Temporary storage: 132 bytes a triangle if the mesh is in random
/// order and the budget does not hold its vertices. `progress` is told the number of triangles done, up to the number of triangles;
/// both passes over them count half.
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

/// [`check`] for a mesh whose triangles name vertices near each other, as those do that this program makes: takes no more than that needs.
///
/// # Errors
/// The same as [`check`].
pub(crate) fn check_near(
    mesh: &dyn MeshSource,
    budget: u64,
    workers: &Workers,
    workspace: &Workspace,
    progress: &mut dyn FnMut(u64),
) -> Result<CheckReport> {
    check_vertex_count(mesh.vertex_count())?;
    Check { mesh, plan: Plan::for_near(budget, mesh, workers.threads()), workers, workspace }.run(progress)
}

impl Check<'_> {
    fn run(&self, progress: &mut dyn FnMut(u64)) -> Result<CheckReport> {
        let triangles = self.mesh.face_count();
        let survey = self.survey(0..self.groups(), &mut |done| progress(done / 2))?;
        let scratch = Spares::default();
        let vertices = self.mesh.vertex_count();
        let ranges = self.ranges(&survey.blocks, vertices);
        let mut done = 0;
        let mut found = |found: Found, hand: &mut dyn FnMut(Found) -> Result<()>| {
            hand(found)?;
            done += 1;
            progress(triangles / 2 + (u128::from(triangles) * done / ranges as u128) as u64 / 2);
            Ok(())
        };
        let found =
            self.together(|hand| self.vertices(&survey.blocks, 0..vertices, &scratch, |one| found(one, hand)))?;
        drop(scratch);
        let report = self.report(&survey, found)?;
        progress(triangles);
        Ok(report)
    }

    /// What all triangles and all vertices have shown.
    fn report(&self, survey: &Survey, found: Found) -> Result<CheckReport> {
        let triangles = self.mesh.face_count();
        let sums = survey.sums.iter().fold(Sums::NONE, |sum, group| sum.plus(*group));
        let (tally, sound) = (&found.tally, triangles - survey.degenerate);
        let mut components = found.sets;
        if tally.nonmanifold_vertices > 0 {
            components = sound - self.merges_by_edges(&survey.blocks)?;
        }

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
