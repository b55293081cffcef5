//! What corners all over a mesh need of their vertices, found in two sorts on disk instead of by jumping about.
//!
//! ```text
//!  corner, vertex    -> ranges of vertices:     each range's vertices are read once
//!  corner, value     -> stretches of triangles: each stretch's corners are put in their order
//! ```
//!
//! Every vertex is read once at most, and every corner is written and read twice, whatever the order of triangles.

use bytemuck::{Pod, Zeroable};

use super::Value;
use super::table::{ReadVertices, fresh};
use crate::error::Result;
use crate::resources::workers::Workers;
use crate::storage::partitions::Partitions;
use crate::storage::spool::Workspace;

/// A corner, and the vertex it is.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, packed)]
struct Named {
    corner: u64,
    vertex: u32,
}

/// A corner, and what its vertex has.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, packed)]
struct Valued<V> {
    corner: u64,
    value: V,
}

/// Workers, temporary storage, and how many bytes of memory a join takes.
pub(super) struct Room<'a> {
    pub workers: &'a Workers,
    pub workspace: &'a Workspace,
    pub memory: u64,
}

/// The memory of a join, shared out.
struct Shares {
    /// Bytes for the vertices of a range, and later for the corners of a stretch.
    table: u64,
    /// Bytes for the pages of each of the two sorts.
    pages: u64,
    /// Bytes that each of the two sorts keeps of full pages.
    kept: u64,
}

impl Shares {
    /// The table has to hold `least` bytes. It has three eighths otherwise; pages of both sorts have four, what they keep one.
    fn of(memory: u64, least: u64) -> Shares {
        let table = (memory / 8 * 3).max(least.min(memory));
        let sort = (memory - table) / 2;
        Shares { table, pages: sort / 5 * 4, kept: sort / 5 }
    }
}

/// Corners in their order, stretch by stretch.
pub(super) struct Joined<V> {
    sorted: Partitions<Valued<V>>,
    corners: u64,
    /// Corners of a stretch.
    stretch: u64,
}

impl<V: Value> Joined<V> {
    /// Joins `corners` corners with what `read` tells of their vertices, of which there are `vertices`. `name` hands over the corners' vertices, in the order of corners.
    /// Stretches have a multiple of `block` corners.
    ///
    /// Memory: what `room` says, but no less than a block's corners, some 160 bytes for the square root of the number of vertices, and some 300 for each stretch. Temporary
    /// storage: 20 bytes for each corner, and its value.
    ///
    /// # Errors
    /// Errors of `name` and `read`; [`crate::Error::Io`]; [`crate::Error::Interrupted`].
    pub fn of(
        room: &Room<'_>,
        (vertices, corners): (u64, u64),
        block: u64,
        name: impl FnOnce(&mut dyn FnMut(&[u32]) -> Result<()>) -> Result<()>,
        read: &ReadVertices<'_, V>,
    ) -> Result<Joined<V>> {
        let value = size_of::<V>() as u64;
        let shares = Shares::of(room.memory, block * value);
        // Ranges have pages, which would take more memory than vertices if there were more of them.
        let range = (shares.table / value).max(vertices.isqrt()).clamp(1, vertices.max(1));
        // Places in a stretch have 32 bits.
        let stretch = (shares.table / value / block).clamp(1, u64::from(u32::MAX) / block) * block;
        let mut by_vertex = partitions(&shares, vertices.div_ceil(range), room.workspace);
        let mut corner = 0;
        name(&mut |vertices| {
            for &vertex in vertices {
                by_vertex.push((u64::from(vertex) / range) as usize, &Named { corner, vertex })?;
                corner += 1;
            }
            Ok(())
        })?;

        let mut sorted = partitions(&shares, corners.div_ceil(stretch), room.workspace);
        let (mut values, mut named) = (Vec::new(), Vec::new());
        for number in 0..by_vertex.count() {
            room.workers.check_cancelled()?;
            if by_vertex.records(number) == 0 {
                continue;
            }
            let first = number as u64 * range;
            fresh(&mut values, (vertices - first).min(range) as usize);
            read(first, &mut values)?;
            while by_vertex.take(number, &mut named)? {
                for Named { corner, vertex } in named.drain(..) {
                    let value = values[(u64::from(vertex) - first) as usize];
                    sorted.push((corner / stretch) as usize, &Valued { corner, value })?;
                }
            }
        }
        Ok(Joined { sorted, corners, stretch })
    }

    /// Corners of a stretch; the last has no more.
    pub fn stretch(&self) -> u64 {
        self.stretch
    }

    /// The values of a stretch's corners, in their order. A stretch can be taken once.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn take(&mut self, number: usize, values: &mut Vec<V>) -> Result<()> {
        let first = number as u64 * self.stretch;
        fresh(values, (self.corners - first).min(self.stretch) as usize);
        let mut valued = Vec::new();
        while self.sorted.take(number, &mut valued)? {
            for Valued { corner, value } in valued.drain(..) {
                values[(corner - first) as usize] = value;
            }
        }
        Ok(())
    }
}

fn partitions<T: Pod>(shares: &Shares, count: u64, workspace: &Workspace) -> Partitions<T> {
    Partitions::new(count as usize, shares.pages, shares.kept, workspace)
}
