//! A mesh's triangles, block by block, with the positions of their corners.
//!
//! ```text
//!   near block   vertex numbers close together: a window of vertices is read along with the triangles, each time
//!   far block    scattered numbers: corners are looked up once, many blocks together, and lie in a spool from then on
//! ```
//!
//! Meshes that were made slice by slice, as ours, have near blocks only, and nothing but boxes is kept of them. Of a mesh in random order, 72 bytes a triangle lie in
//! temporary storage, and every pass reads them from front to back.

use std::ops::Range;

use glam::DVec3;

use super::view::Frame;
use crate::error::{Error, Result};
use crate::mesh::MeshSource;
use crate::mesh::corners::{Corners, span};
use crate::resources::workers::{Spares, Workers};
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
    /// Blocks whose corners are looked up together.
    pub batch: usize,
    /// Bytes of corners that are kept in memory.
    pub in_memory: u64,
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
        let mut all = Blocks {
            mesh,
            window: sizes.window,
            blocks: Vec::new(),
            corners: workspace.spool(sizes.in_memory),
            bounds: Bounds::EMPTY,
            in_frames: vec![Bounds::EMPTY; frames.len()],
            drawable: 0,
        };
        let pieces = Spares::<Piece>::default();
        let number = mesh.face_count().div_ceil(BLOCK as u64);
        let look = |number: usize| {
            pieces.lend(|piece| {
                let count = read_faces(mesh, number, &mut piece.faces)?;
                let span = span(&piece.faces).unwrap_or((0, 0));
                if u64::from(span.1) >= mesh.vertex_count() {
                    return Err(Error::CheckFailed(format!("block {number} names vertex {}", span.1)));
                }
                let near = ((span.1 - span.0) as usize) < sizes.window;
                let seen = match near {
                    true => {
                        piece.local.clone_from(&piece.faces);
                        piece.corners.fill(mesh, &mut piece.local, sizes.window)?;
                        Some(seen(&piece.local, &piece.corners.table, frames))
                    }
                    false => None,
                };
                Ok((count, span, seen))
            })
        };
        let (mut far, mut done) = (Vec::new(), 0);
        workers.in_order_range(sizes.in_flight, number as usize, look, |(count, span, seen)| {
            let mut block = Block { span, bounds: Bounds::EMPTY, far: None };
            match seen {
                Some(seen) => {
                    block.bounds = seen.0;
                    all.widen(&seen);
                    done += count;
                    progress(done);
                }
                None => {
                    block.far = Some(far.len() as u32);
                    far.push(all.blocks.len());
                }
            }
            all.blocks.push(block);
            Ok(())
        })?;
        drop(pieces);
        all.look_up(&far, frames, sizes, workers, done, progress)?;
        Ok(all)
    }

    fn widen(&mut self, (bounds, in_frames, count): &Seen) {
        self.bounds = self.bounds.with(*bounds);
        self.drawable += count;
        self.in_frames.iter_mut().zip(in_frames).for_each(|(all, part)| *all = all.with(*part));
    }

    /// Writes the corners of far blocks to the spool, several blocks at once since each batch may read all vertices.
    fn look_up(
        &mut self,
        far: &[usize],
        frames: &[Frame],
        sizes: Sizes,
        workers: &Workers,
        mut done: u64,
        progress: &mut dyn FnMut(u64),
    ) -> Result<()> {
        let mesh = self.mesh;
        let batches: Vec<&[usize]> = far.chunks(sizes.batch).collect();
        let look = |batch: usize| {
            let (mut faces, mut piece, mut corners) = (Vec::new(), Vec::new(), Corners::default());
            for &number in batches[batch] {
                read_faces(mesh, number, &mut piece)?;
                faces.extend_from_slice(&piece);
            }
            corners.fill(mesh, &mut faces, sizes.window)?;
            let seen: Vec<_> = faces.chunks(BLOCK).map(|block| seen(block, &corners.table, frames)).collect();
            Ok((faces, corners.table, seen))
        };
        let mut blocks = far.iter();
        workers.in_order_range(sizes.in_flight, batches.len(), look, |(faces, table, seen)| {
            for (faces, seen) in faces.chunks(BLOCK).zip(seen) {
                let positions: Vec<[f64; 3]> = faces.as_flattened().iter().map(|v| table[*v as usize]).collect();
                self.corners.append(bytemuck::cast_slice(&positions))?;
                self.widen(&seen);
                let block = *blocks.next().expect("a batch is made of far blocks");
                self.blocks[block].bounds = seen.0;
                done += faces.len() as u64;
                progress(done);
            }
            Ok(())
        })
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
    pub fn far_blocks(&self) -> Vec<usize> {
        (0..self.len()).filter(|number| self.blocks[*number].far.is_some()).collect()
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
                piece.local.extend((0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]));
                piece.corners.table.resize(3 * count, [0.0; 3]);
                let at = u64::from(far) * (BLOCK * 3 * size_of::<[f64; 3]>()) as u64;
                self.corners.read_at(at, bytemuck::cast_slice_mut(&mut piece.corners.table))?;
                piece.window = None;
            }
        }
        Ok(())
    }
}

/// Reads the triangles of a block and returns how many they are.
pub fn read_faces(mesh: &dyn MeshSource, number: usize, faces: &mut Vec<[u32; 3]>) -> Result<u64> {
    let first = number as u64 * BLOCK as u64;
    let count = (mesh.face_count() - first).min(BLOCK as u64);
    faces.resize(count as usize, [0; 3]);
    mesh.read_faces(first, faces)?;
    Ok(count)
}

fn seen(faces: &[[u32; 3]], table: &[[f64; 3]], frames: &[Frame]) -> Seen {
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
