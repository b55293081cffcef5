//! The phase after the surface's: how far vertices are from points, and what is too far from any.

use crate::error::Result;
use crate::grid::context::Context;
use crate::grid::occupancy::Sampled;
use crate::mesh::MeshSource;
use crate::mesh::spool::MeshSpool;
use crate::nearest::bridged::{Bridging, Extent, Rewritten, distances, rewritten};
use crate::nearest::room::Room;
use crate::points::Coordinate;
use crate::resources::memory::MemoryPlan;
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::stitch::counts::Counts;

/// Triangles that were left out.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Trimmed {
    /// How far a vertex may be from the nearest point.
    pub distance: f64,
    /// How many triangles have one that is farther, or would have made no manifold with what is left.
    pub triangles: u64,
}

/// The mesh with the distances of its vertices from points, without what is too far from any.
pub(super) fn measured<T: Coordinate>(
    mesh: MeshSpool,
    asked: Bridging,
    counts: &mut Counts,
    (sampled, origin): (&Sampled<'_, T>, [f64; 3]),
    (memory, context): (&MemoryPlan, &Context),
    progress: &mut Progress,
) -> Result<(MeshSpool, Option<Trimmed>)> {
    let points = sampled.buckets.point_count();
    progress.begin(Phase::Bridged, Some(points + mesh.vertex_count()));
    let extent = Extent::of(&mesh, points, asked.trim.is_some());
    let room = Room::new(extent.memory(memory.working, memory.threads), &context.workers, &context.workspace);
    let found = distances(&mesh, origin, sampled, &room, &mut |done| progress.add(done))?;
    let Rewritten { mesh, left_out, bridged_area } = rewritten(&mesh, &found, asked, &room)?;
    progress.end();
    let Some(distance) = asked.trim else { return Ok((mesh, None)) };
    counts.bridged_area = bridged_area;
    Ok((mesh, Some(Trimmed { distance, triangles: left_out })))
}
