//! A check under way: the mesh, how memory is shared out, and the working memory of a job.

use super::blocks::Stars;
use super::link::Examiner;
use crate::mesh::MeshSource;
use crate::mesh::measure::{Corners, GROUP};
use crate::resources::workers::Workers;
use crate::storage::spool::Workspace;

/// Vertices of a range while the triangles at them lie close together: its corners stay in a processor's cache.
const NEAR_RANGE: u32 = 1 << 15;
/// Bytes for each vertex of a range: up to 8 corners of 8 bytes on average, its place among them, its parent and flags,
/// and, if the mesh is in random order, three edges that leave the range and the room a vector grows by.
const VERTEX_BYTES: u64 = 64 + 8 + 6 + 48;
/// Bytes for each triangle of a far group: see [`Corners::fill`], and the triangle itself.
const FAR_BYTES: u64 = 122;

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
pub(super) struct Scratch {
    pub(super) faces: Vec<[u32; 3]>,
    pub(super) corners: Corners,
    pub(super) stars: Stars<[u32; 2]>,
    pub(super) examiner: Examiner,
    pub(super) parents: Vec<u32>,
    pub(super) used: Vec<bool>,
    pub(super) reached: Vec<bool>,
    pub(super) positions: Vec<[f64; 3]>,
}
