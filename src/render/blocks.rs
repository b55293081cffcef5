//! A mesh's triangles, block by block, with the positions of their corners.
//!
//! ```text
//!   near block   vertex numbers close together: a window of vertices is read along with the triangles, each time
//!   far block    scattered numbers: corners are looked up once, and lie in a spool from then on
//! ```
//!
//! Meshes that were made slice by slice, as ours, have near blocks only, and nothing but boxes is kept of them. Of a mesh in random order, 72 bytes a triangle lie in
//! temporary storage, and every pass reads them from front to back.

use std::ops::Range;

use glam::DVec3;

use super::view::Frame;
use crate::error::Result;
use crate::mesh::MeshSource;
use crate::mesh::corners::{Block as Looked, Corners, Lookup, Order};
use crate::resources::workers::Workers;
use crate::storage::spool::{Spool, Workspace};

/// Triangles of a block: enough to be worth a job, few enough for a processor's cache.
pub const BLOCK: usize = 1 << 15;
/// Coordinates beyond this count as not finite: their squares would not be.
const MOST: f64 = 1e100;

/// Whether a vertex can be drawn.
pub fn is_finite(position: [f64; 3]) -> bool {
    position.iter().all(|c| c.abs() <= MOST)
}

/// A box, in whatever frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// The least components.
    pub low: DVec3,
    /// The greatest.
    pub high: DVec3,
}

impl Bounds {
    /// That of nothing.
    pub const EMPTY: Bounds = Bounds { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    /// Whether there is nothing in it.
    pub fn is_empty(&self) -> bool {
        self.low.x > self.high.x
    }

    /// The box of both.
    pub fn with(self, other: Bounds) -> Bounds {
        Bounds { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn add(&mut self, position: DVec3) {
        self.low = self.low.min(position);
        self.high = self.high.max(position);
    }
}

/// What is known of a block.
#[derive(Debug, Clone, Copy)]
struct Block {
    /// Its least and its greatest vertex number.
    span: (u32, u32),
    /// Its triangles that can be drawn lie in this box.
    bounds: Bounds,
    /// Where its corners lie, in blocks, if it is far.
    far: Option<u32>,
}

/// The blocks of a mesh: 72 bytes each.
pub struct Blocks<'a> {
    mesh: &'a dyn MeshSource,
    /// Vertices that are read along with a block if its numbers span no more.
    window: usize,
    blocks: Vec<Block>,
    corners: Spool,
    /// The box of all triangles that can be drawn.
    pub bounds: Bounds,
    /// Their boxes in some frames.
    pub in_frames: Vec<Bounds>,
    /// How many they are.
    pub drawable: u64,
}

/// What a look at some triangles finds of those that can be drawn: their box, in each frame as well, and their number.
type Seen = (Bounds, Vec<Bounds>, u64);

/// The triangles of one block; its memory is used again.
#[derive(Debug, Default)]
pub struct Piece {
    /// The triangles as the mesh numbers their corners.
    pub faces: Vec<[u32; 3]>,
    /// The same, by places in the table.
    pub local: Vec<[u32; 3]>,
    /// Positions of corners.
    pub corners: Corners,
    /// The mesh's vertices that the table holds, if these are all of a stretch.
    pub window: Option<Range<u32>>,
}

/// What a job may use; none of it shows in the picture.
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    /// Jobs at a time.
    pub in_flight: usize,
    /// Vertices of a window.
    pub window: usize,
    /// Bytes for all far blocks together while their corners are looked up.
    pub far: u64,
    /// Bytes of corners that are kept in memory.
    pub in_memory: u64,
}

impl Sizes {
    /// What looks up corners of a mesh.
    pub fn lookup<'a>(&self, mesh: &'a dyn MeshSource, workers: &'a Workers, workspace: &'a Workspace) -> Lookup<'a> {
        let Sizes { in_flight, window, far: memory, .. } = *self;
        Lookup { mesh, workers, workspace, block: BLOCK, window, in_flight, memory }
    }
}

impl<'a> Blocks<'a> {
    /// Looks at all triangles once, and looks up the corners of far blocks. `progress` is told how many triangles are done.
    ///
    /// # Errors
    /// Errors of reading the mesh and of the workspace; [`Error::Interrupted`].
    pub fn survey(
        mesh: &'a dyn MeshSource,
        frames: &[Frame],
        sizes: Sizes,
        workers: &Workers,
        workspace: &Workspace,
        progress: &mut dyn FnMut(u64),
    ) -> Result<Blocks<'a>> {
        let number = mesh.face_count().div_ceil(BLOCK as u64);
        let unseen = Block { span: (0, 0), bounds: Bounds::EMPTY, far: None };
        let mut all = Blocks {
            mesh,
            window: sizes.window,
            blocks: vec![unseen; number as usize],
            corners: workspace.spool(sizes.in_memory),
            bounds: Bounds::EMPTY,
            in_frames: vec![Bounds::EMPTY; frames.len()],
            drawable: 0,
        };
        let look = |block: &Looked<'_, [f64; 3]>| {
            let count = block.vertices.len();
            let (seen, corners) = if block.is_near {
                (seen(block.local.iter().copied(), block.table, frames), None)
            } else {
                let corners: Vec<[f64; 3]> = block.corners().flatten().collect();
                (seen(apart(count), &corners, frames), Some(corners))
            };
            Ok((block.number as usize, count as u64, block.span, seen, corners))
        };
        let read = |first: u64, positions: &mut [[f64; 3]]| mesh.read_vertices(first, positions);
        let (mut far, mut done) = (0, 0);
        sizes.lookup(mesh, workers, workspace).for_each(
            0..number,
            Order::NearFirst,
            &read,
            look,
            |(number, count, span, seen, corners)| {
                all.widen(&seen);
                let block = &mut all.blocks[number];
                *block = Block { span, bounds: seen.0, far: None };
                if let Some(corners) = corners {
                    block.far = Some(far);
                    far += 1;
                    all.corners.append(bytemuck::cast_slice(&corners))?;
                }
                done += count;
                progress(done);
                Ok(())
            },
        )?;
        Ok(all)
    }

    fn widen(&mut self, (bounds, in_frames, count): &Seen) {
        self.bounds = self.bounds.with(*bounds);
        self.drawable += count;
        self.in_frames.iter_mut().zip(in_frames).for_each(|(all, part)| *all = all.with(*part));
    }

    /// How many blocks there are.
    pub fn len(&self) -> usize {
        self.blocks.len()
    }

    /// The mesh itself.
    pub fn mesh(&self) -> &'a dyn MeshSource {
        self.mesh
    }

    /// The box of a block.
    pub fn bounds_of(&self, number: usize) -> Bounds {
        self.blocks[number].bounds
    }

    /// The numbers of far blocks, in order: those that [`Blocks::far`] counts.
    pub fn far_blocks(&self) -> Vec<u64> {
        let is_far = |number: &u64| self.blocks[*number as usize].far.is_some();
        (0..self.len() as u64).filter(is_far).collect()
    }

    /// Which of the far blocks a block is, if it is one.
    pub fn far(&self, number: usize) -> Option<u32> {
        self.blocks[number].far
    }

    /// Whether a block may have a triangle at one of these vertices.
    pub fn touches(&self, number: usize, vertices: &Range<u32>) -> bool {
        let (low, high) = self.blocks[number].span;
        low < vertices.end && high >= vertices.start
    }

    /// How many blocks must be read in total if each range of so many vertices reads all that touch it.
    pub fn reads(&self, range: u32) -> u64 {
        self.blocks.iter().map(|block| u64::from(block.span.1 / range - block.span.0 / range) + 1).sum()
    }

    /// Reads the triangles of a block, and where their corners are.
    ///
    /// # Errors
    /// Errors of reading the mesh and the spool.
    pub fn read(&self, number: usize, piece: &mut Piece) -> Result<()> {
        let Block { span, far, .. } = self.blocks[number];
        let count = read_faces(self.mesh, number, &mut piece.faces)? as usize;
        match far {
            None => {
                piece.local.clone_from(&piece.faces);
                piece.corners.fill(self.mesh, &mut piece.local, self.window)?;
                piece.window = Some(span.0..span.1 + 1);
            }
            Some(far) => {
                piece.local.clear();
                piece.local.extend(apart(count));
                piece.corners.table.resize(3 * count, [0.0; 3]);
                let at = u64::from(far) * (BLOCK * 3 * size_of::<[f64; 3]>()) as u64;
                self.corners.read_at(at, bytemuck::cast_slice_mut(&mut piece.corners.table))?;
                piece.window = None;
            }
        }
        Ok(())
    }
}

/// Triangles whose corners lie one after another.
fn apart(count: usize) -> impl Iterator<Item = [u32; 3]> {
    (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
}

/// Reads the triangles of a block and returns how many they are.
fn read_faces(mesh: &dyn MeshSource, number: usize, faces: &mut Vec<[u32; 3]>) -> Result<u64> {
    let first = number as u64 * BLOCK as u64;
    let count = (mesh.face_count() - first).min(BLOCK as u64);
    faces.resize(count as usize, [0; 3]);
    mesh.read_faces(first, faces)?;
    Ok(count)
}

fn seen(faces: impl Iterator<Item = [u32; 3]>, table: &[[f64; 3]], frames: &[Frame]) -> Seen {
    let (mut used, mut count) = (vec![false; table.len()], 0);
    for face in faces {
        if face.iter().all(|v| is_finite(table[*v as usize])) {
            face.iter().for_each(|v| used[*v as usize] = true);
            count += 1;
        }
    }
    let (mut bounds, mut in_frames) = (Bounds::EMPTY, vec![Bounds::EMPTY; frames.len()]);
    for (position, _) in table.iter().zip(used).filter(|(_, used)| *used) {
        let position = DVec3::from_array(*position);
        bounds.add(position);
        in_frames.iter_mut().zip(frames).for_each(|(bounds, frame)| bounds.add(frame.turn(position)));
    }
    (bounds, in_frames, count)
}
