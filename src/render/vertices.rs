//! What the picture wants to know of vertices besides where they are: a smooth normal and a colour. 8 bytes each, in the vertices' order.
//!
//! A vertex's normal is the sum of the normals of its triangles, by area. Vertices are taken range by range; each range reads the blocks that touch it and adds up in the
//! order of triangles, so that sums are the same for every budget and any number of threads. Normals come from the mesh and not from the picture: they are smooth where triangles are
//! larger than pixels, where the picture alone shows facets, and where triangles are smaller than samples they are means over some of them, so that single
//! ones do not show as specks.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3, Vec4};

use super::blocks::{BLOCK, Blocks, Piece, Sizes, is_finite};
use super::colour::Tint;
use super::shading::{NO_NORMAL, Shading, pack_normal, unpack_normal};
use crate::error::Result;
use crate::mesh::corners;
use crate::resources::workers::{Spares, Workers, refill};
use crate::storage::spool::{Spool, Workspace};

/// Vertices of a range while the triangles at them lie close together.
const NEAR_RANGE: u32 = 1 << 17;
/// Blocks may be read this often on average before larger ranges are preferred.
const READS: u64 = 2;
/// Bytes of a vertex of a range: the sum of normals and of areas, and its record.
pub const RANGE_BYTES: u64 = 16 + 8;
/// Vertices whose colours are read at once.
const PIECE: usize = 1 << 15;

/// What is known of a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Vertex {
    /// Its normal, packed.
    pub normal: u32,
    /// What [`Tint::tone`] wants to know.
    pub tint: u32,
}

/// All vertices, and once more the corners of far blocks, triangle by triangle.
#[derive(Debug)]
pub struct Vertices {
    /// Nothing, if pictures want to know nothing of vertices.
    store: Spool,
    corners: Spool,
}

impl Vertices {
    /// Looks at all triangles and vertices. `most` bounds the vertices of a range.
    ///
    /// # Errors
    /// Errors of reading the mesh and of the workspace; [`crate::Error::Interrupted`].
    pub fn of(
        blocks: &Blocks,
        tint: &Tint,
        shading: Shading,
        (sizes, most): (Sizes, u32),
        workers: &Workers,
        workspace: &Workspace,
        progress: &mut dyn FnMut(u64),
    ) -> Result<Vertices> {
        let mut all =
            Vertices { store: workspace.spool(sizes.in_memory / 2), corners: workspace.spool(sizes.in_memory / 2) };
        if shading == Shading::Flat && matches!(tint, Tint::One(_)) {
            return Ok(all);
        }
        let mesh = blocks.mesh();
        let count = mesh.vertex_count();
        let mut range = NEAR_RANGE.min(most);
        while range < most && blocks.reads(range) > READS * blocks.len() as u64 {
            range = range.saturating_mul(2).min(most);
        }
        let ranges = count.div_ceil(u64::from(range));
        let spares = Spares::<(Piece, Vec<Vec4>)>::default();
        let look = |number: usize| {
            let start = number as u64 * u64::from(range);
            let end = (start + u64::from(range)).min(count);
            let len = (end - start) as usize;
            let mut vertices = vec![Vertex { normal: NO_NORMAL, tint: 0 }; len];
            if shading == Shading::Smooth {
                spares.lend(|(piece, sums)| {
                    refill(sums, len, Vec4::ZERO);
                    sum_normals(blocks, start as u32..end as u32, piece, sums)?;
                    vertices.iter_mut().zip(&*sums).for_each(|(vertex, sum)| vertex.normal = pack(*sum));
                    Ok(())
                })?;
            }
            let mut tints = vec![0; len.min(PIECE)];
            for (piece, vertices) in vertices.chunks_mut(PIECE).enumerate() {
                let tints = &mut tints[..vertices.len()];
                tint.read(mesh, start + (piece * PIECE) as u64, tints)?;
                vertices.iter_mut().zip(tints).for_each(|(vertex, tint)| vertex.tint = *tint);
            }
            Ok(vertices)
        };
        let mut done = 0;
        workers.in_order_range(sizes.in_flight, ranges as usize, look, |vertices| {
            done += 1;
            progress((u128::from(mesh.face_count()) * done / u128::from(ranges)) as u64);
            all.store.append(bytemuck::cast_slice(&vertices)).map(drop)
        })?;
        drop(spares);
        all.look_up(blocks, sizes, workers, workspace)?;
        Ok(all)
    }

    /// Writes the corners of far blocks.
    fn look_up(&mut self, blocks: &Blocks, sizes: Sizes, workers: &Workers, workspace: &Workspace) -> Result<()> {
        let Vertices { store, corners } = self;
        let read = |first: u64, out: &mut [Vertex]| read(store, first, out);
        let look = |block: &corners::Block<'_, Vertex>| Ok(block.corners().flatten().collect::<Vec<_>>());
        sizes.lookup(blocks.mesh(), workers, workspace).for_far(&blocks.far_blocks(), &read, look, |vertices| {
            corners.append(bytemuck::cast_slice(&vertices)).map(drop)
        })
    }

    /// Whether there is anything to read.
    pub fn are_known(&self) -> bool {
        !self.store.is_empty()
    }

    /// Reads the vertices of the piece's table; `number` is the piece's block.
    ///
    /// # Errors
    /// Errors of the workspace.
    pub fn read(&self, blocks: &Blocks, number: usize, piece: &Piece, out: &mut Vec<Vertex>) -> Result<()> {
        out.resize(piece.corners.table.len(), Vertex::default());
        match (blocks.far(number), &piece.window) {
            (None, Some(window)) => read(&self.store, u64::from(window.start), out),
            (far, _) => {
                let at = u64::from(far.unwrap_or(0)) * (BLOCK * 3 * size_of::<Vertex>()) as u64;
                self.corners.read_at(at, bytemuck::cast_slice_mut(out))
            }
        }
    }
}

fn read(store: &Spool, first: u64, out: &mut [Vertex]) -> Result<()> {
    store.read_at(first * size_of::<Vertex>() as u64, bytemuck::cast_slice_mut(out))
}

/// Adds up the normals and the areas of all triangles at the range's vertices.
fn sum_normals(blocks: &Blocks, range: std::ops::Range<u32>, piece: &mut Piece, sums: &mut [Vec4]) -> Result<()> {
    let extent = (blocks.bounds.high - blocks.bounds.low).max_element();
    let unit = if extent > 0.0 { 1.0 / extent } else { 1.0 };
    for number in (0..blocks.len()).filter(|number| blocks.touches(*number, &range)) {
        blocks.read(number, piece)?;
        for (face, local) in piece.faces.iter().zip(&piece.local) {
            if !face.iter().any(|v| range.contains(v)) {
                continue;
            }
            let Some(normal) = normal(local.map(|v| piece.corners.table[v as usize]), unit) else { continue };
            for v in face {
                if let Some(sum) = sums.get_mut(v.wrapping_sub(range.start) as usize) {
                    *sum += normal.extend(normal.length());
                }
            }
        }
    }
    Ok(())
}

/// A triangle's normal, as long as twice its area in squares of `1 / unit`; `None` if it cannot be drawn.
pub fn normal(corners: [[f64; 3]; 3], unit: f64) -> Option<Vec3> {
    if !corners.iter().all(|p| is_finite(*p)) {
        return None;
    }
    let [a, b, c] = corners.map(DVec3::from_array);
    Some(((b - a) * unit).cross((c - a) * unit).as_vec3())
}

/// Of a vertex, the length of the sum of its triangles' normals, as a share of their areas, at which it lies on an edge, and at which it does not. Where two faces
/// meet at an angle, it is the cosine of half of it: 0.71 at the edge of a cube; single slivers hardly change it.
const EDGE: (f32, f32) = (0.76, 0.88);
/// The last bits of a normal's two numbers, which tell how much of an edge the vertex is.
const SPARE_BITS: u32 = 0x0001_0001;

/// A sum of normals and areas, packed: the direction, and in two bits how smooth the surface is there.
fn pack(sum: Vec4) -> u32 {
    let normal = pack_normal(sum.truncate());
    if normal == NO_NORMAL {
        return NO_NORMAL;
    }
    let share = sum.truncate().length() / sum.w;
    let level = (((share - EDGE.0) / (EDGE.1 - EDGE.0)).clamp(0.0, 1.0) * 3.0 + 0.5) as u32;
    normal & !SPARE_BITS | (level & 1) | (level >> 1) << 16
}

impl Vertex {
    /// Its normal, if it has one, and how smooth the surface is there: from 0, an edge, to 1.
    #[inline]
    pub fn normal(self) -> Option<(Vec3, f32)> {
        let normal = unpack_normal(if self.normal == NO_NORMAL { NO_NORMAL } else { self.normal & !SPARE_BITS })?;
        Some((normal, ((self.normal & 1) + 2 * (self.normal >> 16 & 1)) as f32 / 3.0))
    }
}
