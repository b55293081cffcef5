//! A check under way: the mesh, how memory is shared out, and the working memory of a job.

use super::blocks::Stars;
use super::components;
use super::link::Examiner;
use crate::mesh::MeshSource;
use crate::mesh::corners;
use crate::mesh::measure::GROUP;
use crate::mesh::spool::Spans;
use crate::resources::workers::Workers;
use crate::storage::spool::Workspace;

/// Corners of a range that are held at a time, for each of its vertices; a closed mesh has six on average.
pub(super) const CORNERS: usize = 8;
/// Vertices read at once to see whether they are finite.
pub(super) const PIECE: usize = 1 << 12;
/// Vertices of a range while the triangles at them lie close together: its corners stay in a processor's cache.
const NEAR_RANGE: u32 = 1 << 15;
/// Bytes for each vertex of a range: up to 8 corners of 8 bytes on average, its place among them, its parent and flags,
/// and, if the mesh is in random order, three edges that leave the range.
const VERTEX_BYTES: u64 = 64 + 8 + 6 + LEAVING;
/// Triangles of a block.
const BLOCK: usize = GROUP / 4;
/// Vertices of a window: the least, and the most.
const WINDOW: (usize, usize) = (GROUP, 4 * GROUP);
/// Bytes for each vertex of a range, if all have three edges that leave it, and for the room a vector grows by.
const LEAVING: u64 = 48;

/// What the check of a mesh takes while its triangles name vertices near each other, in bytes, given as much as it may want.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Need {
    /// All jobs together.
    pub(crate) jobs: u64,
    /// The components of the whole mesh: more than that makes it no faster, and with less they wait on disk.
    pub(crate) components: u64,
}

impl Need {
    /// What the check of a mesh of so many vertices and triangles needs.
    pub(crate) fn of(vertices: u64, triangles: u64, threads: usize) -> Need {
        Need::of_spans(vertices, triangles, None, threads)
    }

    /// The same of a mesh of which it is known, or not, how far apart the vertices of its triangles lie.
    pub(crate) fn of_spans(vertices: u64, triangles: u64, spans: Option<Spans>, threads: usize) -> Need {
        let widest = spans.map_or(vertices, |spans| spans.group.min(vertices));
        // What a job needs is lent to those that are under way, no more than there are threads.
        let jobs = threads.max(1) as u64;
        let group = triangles.min(GROUP as u64);
        let near =
            group * 2 * size_of::<[u32; 3]>() as u64 + widest.min(WINDOW.1 as u64) * size_of::<[f64; 3]>() as u64;
        // A group can span more than a window only where there are more vertices.
        let far = if widest > WINDOW.1 as u64 { corners::least_memory::<[f64; 3]>(group, jobs + 1) } else { 0 };
        let surveying = (jobs.min(triangles.div_ceil(GROUP as u64)) * near).max(far);

        let range = vertices.min(u64::from(NEAR_RANGE));
        let corners = (range * CORNERS as u64).min(3 * triangles);
        // The vertices of a mesh that is there have so many on average; a range may have an eighth more.
        let average = || 3 * triangles * range / vertices.max(1);
        let corners = if spans.is_some() { corners.min(average() / 8 * 9) } else { corners };
        // A parent and two flags; and, where there are several ranges, edges that leave this one, which are those of its last vertices.
        let of_vertex = size_of::<u32>() as u64 + 2;
        let last = if vertices > range { range.min(spans.map_or(range, |spans| spans.triangle)) } else { 0 };
        let stars = Stars::<[u32; 2]>::bytes(range, corners, triangles.min(BLOCK as u64));
        let positions = range.min(PIECE as u64) * size_of::<[f64; 3]>() as u64;
        let looking = jobs.min(vertices.div_ceil(u64::from(NEAR_RANGE)))
            * (stars + range * of_vertex + last * LEAVING + positions);
        // First one, then the other.
        Need { jobs: surveying.max(looking), components: components::bytes(vertices) }
    }

    /// With a budget of so many bytes.
    pub(crate) fn within(self, budget: u64) -> Need {
        let (jobs, components) = shares(budget);
        Need { jobs: self.jobs.min(jobs), components: self.components.min(components) }
    }

    pub(crate) fn bytes(self) -> u64 {
        self.jobs + self.components
    }
}

/// A budget's shares for jobs and for components.
fn shares(budget: u64) -> (u64, u64) {
    (budget / 4 * 3, budget / 4)
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
    /// Bytes for all triangles together whose vertices lie far apart.
    pub(crate) far: u64,
    /// Vertices of a range: the least, and the most.
    pub(crate) range: (u32, u32),
    /// Bytes for the components of the whole mesh.
    pub(crate) components: u64,
}

impl Plan {
    pub(crate) fn for_budget(budget: u64, threads: usize) -> Plan {
        let (jobs, components) = shares(budget);
        Plan::of(jobs, components, threads)
    }

    /// For a mesh whose triangles name vertices near each other: no more than it needs.
    pub(crate) fn for_near(budget: u64, mesh: &dyn MeshSource, threads: usize) -> Plan {
        let vertices = mesh.vertex_count();
        let need = Need::of(vertices, mesh.face_count(), threads);
        let (jobs, components) = shares(budget);
        let plan = Plan::of(need.jobs.min(jobs), components, threads);
        if jobs < need.jobs {
            return plan;
        }
        // What is needed is counted for windows as wide as the mesh.
        Plan { window: (vertices as usize).clamp(WINDOW.0, WINDOW.1), ..plan }
    }

    fn of(jobs: u64, components: u64, threads: usize) -> Plan {
        let job = jobs / threads.max(1) as u64;
        let most = (job / VERTEX_BYTES).clamp(u64::from(NEAR_RANGE) / 4, 1 << 31) as u32;
        Plan {
            in_flight: threads + 1,
            block: BLOCK,
            window: (job / 48).clamp(WINDOW.0 as u64, WINDOW.1 as u64) as usize,
            far: jobs,
            range: (NEAR_RANGE.min(most), most),
            components,
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
    pub(super) stars: Stars<[u32; 2]>,
    pub(super) examiner: Examiner,
    pub(super) parents: Vec<u32>,
    pub(super) used: Vec<bool>,
    pub(super) reached: Vec<bool>,
    pub(super) positions: Vec<[f64; 3]>,
}
