//! Corners of equal position become one vertex, however many corners there are.
//!
//! ```text
//!  corner, position              -> buckets by position   each tells equal positions by a map of those it has seen
//!  first, corner, position       -> ranges by `first`     firsts are numbered in order: the mesh's vertices
//!  corner, vertex                -> ranges by corner      the mesh's triangles
//! ```
//!
//! `first` is the first corner of the same position, so vertices keep the order in which the file meets them, whatever the
//! number of buckets, and what lies close together in the file stays so.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::hash::BuildHasher;

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::mesh::check_vertex_count;
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::points::Precision;
use crate::storage::queue::Queue;
use crate::storage::seeds::Seeds;
use crate::storage::spool::Workspace;

/// Bytes of a position seen, in a map that is half empty; a vertex has six corners on average but may have one.
const SEEN_BYTES: u64 = 48;
/// The most buckets, each of which may hold a temporary file open, at two stages at a time.
const MOST_BUCKETS: u64 = 200;
const NO_VERTEX: u32 = u32::MAX;

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Corner {
    corner: u64,
    position: [f32; 3],
    unused: u32,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Seen {
    first: u64,
    corner: Corner,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Numbered {
    corner: u64,
    vertex: u32,
    unused: u32,
}

/// Takes corners, three for each triangle, and gives a mesh of single precision.
pub(crate) struct Welder<'a> {
    workspace: &'a Workspace,
    in_memory: u64,
    corners: u64,
    by_position: Vec<Queue<Corner>>,
    seeds: Seeds,
}

impl Welder<'_> {
    /// For up to about `most_corners`: more would take more memory, no more.
    pub fn new(workspace: &Workspace, most_corners: u64, in_memory: u64) -> Welder<'_> {
        let buckets = (most_corners * SEEN_BYTES / in_memory.max(1)).clamp(1, MOST_BUCKETS);
        let mut welder = Welder { workspace, in_memory, corners: 0, by_position: Vec::new(), seeds: Seeds::new() };
        welder.by_position = welder.queues(buckets as usize);
        welder
    }

    fn queues<T: Pod>(&self, count: usize) -> Vec<Queue<T>> {
        (0..count).map(|_| Queue::new(self.workspace, self.in_memory / 2 / count as u64)).collect()
    }

    /// The next corner. Zero and negative zero are equal; a coordinate that is not a number equals itself.
    pub fn corner(&mut self, position: [f32; 3]) -> Result<()> {
        // Adding zero makes negative zero positive and nothing else.
        let position = position.map(|c| c + 0.0);
        let bucket = (self.seeds.hash_one(position.map(f32::to_bits)) >> 32) as usize % self.by_position.len();
        self.by_position[bucket].push(Corner { corner: self.corners, position, unused: 0 })?;
        self.corners += 1;
        Ok(())
    }

    /// The welded mesh.
    pub fn finish(mut self) -> Result<MeshSpool> {
        let buckets = self.by_position.len();
        // Whole triangles, so that none is cut by a range's end.
        let range = (self.corners.div_ceil(buckets as u64)).next_multiple_of(3).max(3);
        let mut by_first = self.queues(buckets);
        for bucket in std::mem::take(&mut self.by_position) {
            // Other seeds than those of the buckets, in each of which hashes have something in common.
            let mut firsts: HashMap<[u32; 3], u64, Seeds> = HashMap::with_hasher(Seeds::new());
            bucket.read(|corner| {
                let first = match firsts.entry(corner.position.map(f32::to_bits)) {
                    Entry::Occupied(seen) => *seen.get(),
                    Entry::Vacant(new) => *new.insert(corner.corner),
                };
                by_first[(first / range) as usize].push(Seen { first, corner })
            })?;
        }

        let mut mesh = MeshSpool::new(self.workspace, Precision::Single, self.in_memory);
        let mut by_corner = self.queues(buckets);
        let mut vertices = 0u64;
        for (number, seen) in by_first.into_iter().enumerate() {
            let start = number as u64 * range;
            let mut positions = vec![None; range.min(self.corners.saturating_sub(start)) as usize];
            seen.read(|Seen { first, corner }| {
                if first == corner.corner {
                    positions[(first - start) as usize] = Some(corner.position.map(f64::from));
                }
                Ok(())
            })?;
            let found: Vec<[f64; 3]> = positions.iter().copied().flatten().collect();
            check_vertex_count(vertices + found.len() as u64)?;
            mesh.append_vertices(&found)?;
            let mut numbers = Vec::with_capacity(positions.len());
            for position in positions {
                numbers.push(if position.is_some() { vertices as u32 } else { NO_VERTEX });
                vertices += u64::from(position.is_some());
            }
            seen.read(|Seen { first, corner: Corner { corner, .. } }| {
                let numbered = Numbered { corner, vertex: numbers[(first - start) as usize], unused: 0 };
                by_corner[(corner / range) as usize].push(numbered)
            })?;
        }

        for (number, numbered) in by_corner.into_iter().enumerate() {
            let start = number as u64 * range;
            let mut triangles = vec![[NO_VERTEX; 3]; range.min(self.corners.saturating_sub(start)) as usize / 3];
            numbered.read(|Numbered { corner, vertex, .. }| {
                let at = (corner - start) as usize;
                triangles[at / 3][at % 3] = vertex;
                Ok(())
            })?;
            mesh.append_faces(&triangles.into_iter().map(FaceRecord::new).collect::<Vec<_>>())?;
        }
        Ok(mesh)
    }
}
