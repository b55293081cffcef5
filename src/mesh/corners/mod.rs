//! Corners of triangles: what triangles need of their vertices, whichever order a mesh has.
//!
//! ```text
//!  near block         vertex numbers close together: a window of vertices is read (table)
//!  few far blocks     scattered numbers: those that are used are sorted in memory, and picked (table)
//!  many far blocks    all vertices are read at once if memory holds them, else two sorts on disk join them to corners (join)
//! ```
//!
//! Beside the windows of near blocks, each vertex is read once at most, whichever way far blocks take. Their triangles are read two or three times, and once more where blocks are
//! wanted in order.

mod join;
mod table;
#[cfg(test)]
mod tests;

use std::cell::Cell;
use std::ops::Range;

use bytemuck::Pod;

use self::join::{Joined, Room};
pub(crate) use self::table::fresh;
pub use self::table::{Corners, span};
use self::table::{PIECE, ReadVertices};
use super::MeshSource;
use crate::error::{Error, Result};
use crate::resources::workers::{Spares, Workers};
use crate::storage::spool::Workspace;

/// Bytes of memory for each triangle whose corners are picked: see [`Corners::fill`], and the triangle.
const PICKED_BYTES: u64 = 110 + 12;
/// Bytes for each triangle of a far block that a job looks at: as the mesh numbers its vertices, and by places in the table.
pub(crate) const LOOKED_AT_BYTES: u64 = 24;

/// What vertices have: their positions, say.
pub(crate) trait Value: Pod + Default + Send + Sync {}

impl<V: Pod + Default + Send + Sync> Value for V {}

/// In which order blocks are handed over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Order {
    /// That of triangles. Windows of near blocks are held beside what far blocks take, and if there are far blocks, triangles are read once more.
    Triangles,
    /// Near blocks first, then far ones; both in the order of triangles.
    NearFirst,
}

/// Triangles of a block, and what their vertices have.
#[derive(Debug)]
pub(crate) struct Block<'a, V> {
    /// The block.
    pub number: u64,
    /// The least and the greatest vertex number.
    pub span: (u32, u32),
    /// Whether the vertices lie so close together that they can be read again at any time: they are the table then.
    pub is_near: bool,
    /// Triangles as the mesh numbers their vertices.
    pub vertices: &'a [[u32; 3]],
    /// The same, by places in the table. Corners of a triangle have one place if they are one vertex.
    pub local: &'a [[u32; 3]],
    /// What vertices have.
    pub table: &'a [V],
}

impl<V: Copy> Block<'_, V> {
    /// What the vertices of each triangle have.
    pub fn corners(&self) -> impl ExactSizeIterator<Item = [V; 3]> {
        self.local.iter().map(|face| face.map(|v| self.table[v as usize]))
    }
}

/// Looks up the corners of a mesh's triangles, block by block.
#[derive(Clone, Copy)]
pub(crate) struct Lookup<'a> {
    pub mesh: &'a dyn MeshSource,
    pub workers: &'a Workers,
    pub workspace: &'a Workspace,
    /// Triangles of a block.
    pub block: usize,
    /// Vertices of a window: blocks that span more are far.
    pub window: usize,
    /// Blocks under way at a time.
    pub in_flight: usize,
    /// Bytes of memory for all far blocks together, but for what is made of them.
    pub memory: u64,
}

/// The working memory of a job.
#[derive(Default)]
struct Scratch<V> {
    vertices: Vec<[u32; 3]>,
    local: Vec<[u32; 3]>,
    corners: Corners<V>,
}

/// Appends the triangles of a far block by places in a table. Is told how many far blocks the table has before it, and its triangles.
type Renumber<'a> = dyn Fn(usize, &[[u32; 3]], &mut Vec<[u32; 3]>) + Sync + 'a;

/// Far blocks whose corners are known.
struct Known<'a, V> {
    far: &'a [u64],
    /// If near blocks are wanted in their places among far ones, too: the block before which to end.
    end: Option<u64>,
    /// What the vertices have.
    table: &'a [V],
    renumber: &'a Renumber<'a>,
    /// What jobs on other far blocks have left.
    spares: &'a Spares<Scratch<V>>,
}

/// The least memory for far blocks of so many triangles, of which so many are under way: one whose corners are looked up, and jobs. More makes them faster.
pub(crate) fn least_memory<V>(block: u64, in_flight: u64) -> u64 {
    in_flight * block * LOOKED_AT_BYTES + block * size_of::<[V; 3]>() as u64 + (1 << 20)
}

impl Lookup<'_> {
    /// Hands over what `work` makes of blocks, with what `read` tells of their vertices.
    ///
    /// Memory: for near blocks 24 bytes for each triangle of a block, and a window of values, as often as there are jobs under way; for far ones what is given. Less than
    /// [`least_memory`] is exceeded. 8 bytes for each far block. Temporary storage: see [`Joined::of`].
    ///
    /// # Errors
    /// Errors of `read`, `work`, `sink` and of reading triangles; [`Error::CheckFailed`] if a triangle names a vertex that the mesh does not have; [`Error::Io`];
    /// [`Error::Interrupted`].
    pub fn for_each<V: Value, R: Send>(
        &self,
        blocks: Range<u64>,
        order: Order,
        read: &ReadVertices<'_, V>,
        work: impl Fn(&Block<'_, V>) -> Result<R> + Sync,
        mut sink: impl FnMut(R) -> Result<()>,
    ) -> Result<()> {
        let spares = Spares::<Scratch<V>>::default();
        let look = |number: u64| {
            spares.lend(|scratch| {
                let span = self.read(number, &mut scratch.vertices)?;
                let near = self.is_near(span).then(|| self.near(number, span, read, scratch, &work));
                Ok((number, near.transpose()?))
            })
        };
        let (mut far, waits, mut numbers) = (Vec::new(), Cell::new(false), blocks.clone());
        let next = || Ok(if waits.get() { None } else { numbers.next() });
        self.workers.in_order(self.in_flight, next, look, |(number, made)| {
            match made {
                Some(made) if !waits.get() => sink(made)?,
                // It comes once more, after the far block that it follows.
                Some(_) => (),
                None => {
                    far.push(number);
                    waits.set(order == Order::Triangles);
                }
            }
            Ok(())
        })?;
        drop(spares);
        let Some(&first) = far.first() else { return Ok(()) };
        self.workers.between_steps();
        match order {
            Order::NearFirst => self.far(&far, None, read, &work, &mut sink),
            Order::Triangles => {
                let far = self.far_among(first..blocks.end)?;
                self.far(&far, Some(blocks.end), read, &work, &mut sink)
            }
        }
    }

    /// Hands over what `work` makes of some blocks, in their order, as if they were far.
    ///
    /// # Errors
    /// The same as [`Lookup::for_each`].
    pub fn for_far<V: Value, R: Send>(
        &self,
        far: &[u64],
        read: &ReadVertices<'_, V>,
        work: impl Fn(&Block<'_, V>) -> Result<R> + Sync,
        mut sink: impl FnMut(R) -> Result<()>,
    ) -> Result<()> {
        if far.is_empty() { Ok(()) } else { self.far(far, None, read, &work, &mut sink) }
    }

    /// Which of some blocks are far.
    fn far_among(&self, blocks: Range<u64>) -> Result<Vec<u64>> {
        let spares = Spares::<Vec<[u32; 3]>>::default();
        let look = |i: usize| {
            let number = blocks.start + i as u64;
            let span = spares.lend(|faces| self.read(number, faces))?;
            Ok((number, self.is_near(span)))
        };
        let mut far = Vec::new();
        let count = (blocks.end - blocks.start) as usize;
        self.workers.in_order_range(self.in_flight, count, look, |(number, is_near)| {
            if !is_near {
                far.push(number);
            }
            Ok(())
        })?;
        Ok(far)
    }

    /// Looks up the corners of far blocks, and hands over what `work` makes of them; and of near ones from the first of them to `end`, if that is given.
    fn far<V: Value, R: Send>(
        &self,
        far: &[u64],
        end: Option<u64>,
        read: &ReadVertices<'_, V>,
        work: &(impl Fn(&Block<'_, V>) -> Result<R> + Sync),
        sink: &mut impl FnMut(R) -> Result<()>,
    ) -> Result<()> {
        // The same for all stretches: what workers have taken and this thread gives back would wait for them.
        let spares = Spares::<Scratch<V>>::default();
        let jobs = (self.in_flight * self.block) as u64 * LOOKED_AT_BYTES;
        let memory = self.memory.saturating_sub(jobs);
        let vertices = self.mesh.vertex_count();
        let triangles: u64 = far.iter().map(|number| self.len(*number)).sum();
        let all = vertices * size_of::<V>() as u64;
        let picked = triangles * PICKED_BYTES + (PIECE * size_of::<V>()) as u64;
        if picked <= memory.min(all) && 3 * triangles <= u64::from(u32::MAX) {
            let (mut picked, mut corners) = (Vec::with_capacity(triangles as usize), Corners::default());
            self.each_of(far, |faces| {
                picked.extend_from_slice(faces);
                Ok(())
            })?;
            corners.fill_from(read, &mut picked, 0)?;
            let renumber = |place: usize, faces: &[[u32; 3]], out: &mut Vec<[u32; 3]>| {
                out.extend_from_slice(&picked[place * self.block..][..faces.len()]);
            };
            let table = &corners.table;
            return self.known(&Known { far, end, table, renumber: &renumber, spares: &spares }, read, work, sink);
        }
        if all <= memory {
            let mut table = vec![V::default(); vertices as usize];
            for (piece, values) in table.chunks_mut(PIECE).enumerate() {
                self.workers.check_cancelled()?;
                read((piece * PIECE) as u64, values)?;
            }
            let renumber = |_, faces: &[[u32; 3]], out: &mut Vec<[u32; 3]>| out.extend_from_slice(faces);
            let known = Known { far, end, table: &table, renumber: &renumber, spares: &spares };
            return self.known(&known, read, work, sink);
        }
        let room = Room { workers: self.workers, workspace: self.workspace, memory };
        let block = 3 * self.block as u64;
        let name = |put: &mut dyn FnMut(&[u32]) -> Result<()>| self.each_of(far, |faces| put(faces.as_flattened()));
        let mut joined = Joined::of(&room, (vertices, 3 * triangles), block, name, read)?;
        let stretch = (joined.stretch() / block) as usize;
        let mut table = Vec::new();
        for (number, part) in far.chunks(stretch).enumerate() {
            joined.take(number, &mut table)?;
            let end = end.map(|end| far.get((number + 1) * stretch).copied().unwrap_or(end));
            let renumber = |place: usize, faces: &[[u32; 3]], out: &mut Vec<[u32; 3]>| {
                let first = 3 * (place * self.block) as u32;
                out.extend((first..).step_by(3).zip(faces).map(|(first, face)| by_places(first, *face)));
            };
            let known = Known { far: part, end, table: &table, renumber: &renumber, spares: &spares };
            self.known(&known, read, work, sink)?;
        }
        Ok(())
    }

    /// Hands over what `work` makes of far blocks whose corners are known, and of near ones among them.
    fn known<V: Value, R: Send>(
        &self,
        known: &Known<'_, V>,
        read: &ReadVertices<'_, V>,
        work: &(impl Fn(&Block<'_, V>) -> Result<R> + Sync),
        sink: &mut impl FnMut(R) -> Result<()>,
    ) -> Result<()> {
        let Known { far, end, table, renumber, spares } = *known;
        let look = |i: usize| {
            spares.lend(|scratch| {
                let number = if end.is_some() { far[0] + i as u64 } else { far[i] };
                let span = self.read(number, &mut scratch.vertices)?;
                let Ok(place) = far.binary_search(&number) else { return self.near(number, span, read, scratch, work) };
                let Scratch { vertices, local, .. } = scratch;
                local.clear();
                renumber(place, vertices, local);
                work(&Block { number, span, is_near: false, vertices, local, table })
            })
        };
        let count = end.map_or(far.len(), |end| (end - far[0]) as usize);
        self.workers.in_order_range(self.in_flight, count, look, sink)
    }

    /// What `work` makes of a near block whose triangles have been read.
    fn near<V: Value, R>(
        &self,
        number: u64,
        span: (u32, u32),
        read: &ReadVertices<'_, V>,
        scratch: &mut Scratch<V>,
        work: &(impl Fn(&Block<'_, V>) -> Result<R> + Sync),
    ) -> Result<R> {
        let Scratch { vertices, local, corners } = scratch;
        local.clone_from(vertices);
        corners.fill_from(read, local, self.window)?;
        work(&Block { number, span, is_near: true, vertices, local, table: &corners.table })
    }

    /// Whether vertices of that span are read whole.
    fn is_near(&self, (low, high): (u32, u32)) -> bool {
        ((high - low) as usize) < self.window
    }

    /// How many triangles a block has.
    fn len(&self, number: u64) -> u64 {
        (self.mesh.face_count() - number * self.block as u64).min(self.block as u64)
    }

    /// Reads the triangles of a block, and tells the least and the greatest of their vertices.
    fn read(&self, number: u64, faces: &mut Vec<[u32; 3]>) -> Result<(u32, u32)> {
        let (first, vertices) = (number * self.block as u64, self.mesh.vertex_count());
        fresh(faces, self.len(number) as usize);
        self.mesh.read_faces(first, faces)?;
        let span = span(faces).expect("a block has triangles");
        if u64::from(span.1) >= vertices {
            let beyond = |face: &[u32; 3]| face.iter().any(|&v| u64::from(v) >= vertices);
            let at = faces.iter().position(beyond).expect("a span is taken from triangles");
            return Err(Error::CheckFailed(format!(
                "triangle {} names vertices {:?} of {vertices}",
                first + at as u64,
                faces[at]
            )));
        }
        Ok(span)
    }

    /// Reads blocks one after another.
    fn each_of(&self, numbers: &[u64], mut visit: impl FnMut(&[[u32; 3]]) -> Result<()>) -> Result<()> {
        let mut faces = Vec::new();
        for number in numbers {
            self.workers.check_cancelled()?;
            self.read(*number, &mut faces)?;
            visit(&faces)?;
        }
        Ok(())
    }
}

/// A triangle whose corners have places of their own, from `first` on. A vertex that comes twice keeps its first place.
fn by_places(first: u32, [a, b, c]: [u32; 3]) -> [u32; 3] {
    let second = if b == a { first } else { first + 1 };
    let third = if c == a {
        first
    } else if c == b {
        second
    } else {
        first + 2
    };
    [first, second, third]
}
