//! Where the surface bridges: how far its vertices are from the nearest point, and the surface without the triangles that are farther than a distance.
//!
//! ```text
//!   . . . . . .               . . .     points
//!   o-o-o-o-o-o-o-o-o-o-o-o-o-o-o-o     vertices
//!   0 0 0 0 0 0 1 2 3 4 3 2 1 0 0 0     their distances, the attribute `bridged`
//!   o-o-o-o-o-o-o-o         o-o-o-o     what is left with a distance of 2
//! ```
//!
//! Both look at the finished mesh, so they tell of what is written: after fitting, contraction and untangling.

mod distances;
mod schema;
#[cfg(test)]
mod tests;
mod trim;

pub(crate) use self::distances::distances;
pub(crate) use self::schema::with_bridged;
pub(crate) use self::trim::{Bridging, Rewritten, rewritten};

use crate::mesh::MeshSource;
use crate::mesh::spool::MeshSpool;
use crate::points::Precision;

/// What the memory and the disk depend on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Extent {
    pub points: u64,
    pub vertices: u64,
    pub triangles: u64,
    pub precision: Precision,
    /// Bytes of a vertex's attributes.
    pub attributes: u64,
    /// Whether triangles are left out.
    pub trimmed: bool,
}

/// Bytes from which the work is not hindered by its room; for each thread, too.
const LEAST: (u64, u64) = (6 << 20, 2 << 20);

impl Extent {
    /// The extent of a mesh, of so many points.
    pub fn of(mesh: &MeshSpool, points: u64, trimmed: bool) -> Extent {
        let (vertices, triangles, precision) = (mesh.vertex_count(), mesh.face_count(), mesh.precision());
        Extent { points, vertices, triangles, precision, attributes: mesh.schema().stride() as u64, trimmed }
    }

    /// The least memory, in bytes.
    pub fn least_memory(threads: usize) -> u64 {
        LEAST.0 + LEAST.1 * threads as u64
    }

    /// The memory that it takes of so much, in bytes.
    pub fn memory(self, budget: u64, threads: usize) -> u64 {
        budget.min(self.whole() + Extent::least_memory(threads))
    }

    /// The memory with which all points are in one block, and all distances in one range.
    fn whole(self) -> u64 {
        self.points * distances::BYTES_OF_POINT + self.vertices * distances::BYTES_OF_VERTEX
    }

    /// The temporary disk, in bytes: points twice, as they are sorted; queries twice, as they go from block to block; distances; and the mesh anew.
    pub fn disk(self) -> u64 {
        let place = size_of::<[f64; 3]>() as u64;
        let query = 2 * (place + 3 * size_of::<u64>() as u64);
        let (flags, corners) = if self.trimmed { (10, 36 * self.triangles) } else { (0, 0) };
        let vertex = 3 * self.precision.bytes() as u64 + self.attributes;
        2 * self.points * place + self.vertices * (query + 12 + flags + vertex) + self.triangles * 13 + corners
    }
}
