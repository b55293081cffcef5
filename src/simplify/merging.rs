//! The room that merges work in: what is known of vertices, and lists that are used again.

use glam::DVec3;

use super::piece::Ring;
use super::quadric::Quadric;

/// What is known of the triangles round a vertex.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Corner {
    pub(super) quadric: Quadric,
    /// The sum of their normals, each as long as the area.
    pub(super) across: DVec3,
    pub(super) known: bool,
}

/// What merges work with.
#[derive(Debug, Default)]
pub(super) struct Merging {
    pub(super) corners: Vec<Corner>,
    /// The triangles round the other end.
    pub(super) ring: Ring,
    /// The vertices round both ends, in order, and the triangles that lie on the ways from each to the next.
    pub(super) link: Vec<u32>,
    pub(super) outer: Vec<u32>,
    pub(super) star: Vec<u32>,
}

impl Merging {
    /// Room for so many vertices.
    pub(super) fn new(vertices: usize) -> Merging {
        Merging { corners: vec![Corner::default(); vertices], ..Merging::default() }
    }
}
