//! The triangles of the mesh that is given, as records: with their corners' places, classes and colours.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use super::gap::Drift;
use super::mark::{Blend, Colours, Mark, Marks};
use super::soup::{Record, record_bytes};
use crate::error::Result;
use crate::mesh::MeshSource;
use crate::mesh::corners::{Block, LOOKED_AT_BYTES, Lookup, Order, least_memory};
use crate::mesh::measure::is_degenerate;
use crate::points::Coordinate;
use crate::resources::workers::Workers;
use crate::storage::spool::Workspace;

/// Triangles that are read at a time.
pub(super) const BLOCK: usize = 1 << 13;
/// Vertices that are read along with a block of triangles if its numbers span no more.
pub(super) const WINDOW: usize = 1 << 16;
/// Vertices whose places or attributes are asked for at a time.
const PIECE: usize = 1 << 12;

/// What is read of a vertex.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
struct Vertex {
    place: [f64; 3],
    /// As it is written; zero if there is none.
    colour: [f32; 3],
    class: u32,
}

/// What is read of a mesh's vertices beside their places.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted {
    /// The number of the attribute that tells classes.
    pub(super) classes: Option<usize>,
    /// Colours, if marks are carried.
    pub(super) colours: Option<Colours>,
}

/// Blocks of a mesh's triangles.
pub(super) fn blocks(mesh: &dyn MeshSource) -> u64 {
    mesh.face_count().div_ceil(BLOCK as u64)
}

/// Bytes that reading takes beside [`far_bytes`]: the vertices that a block's numbers span, and records of two blocks.
pub(super) fn bytes<T, M>(triangles: u64) -> u64 {
    let block = triangles.min(BLOCK as u64) * (2 * record_bytes::<T, M>() + LOOKED_AT_BYTES);
    block + window(triangles) as u64 * size_of::<Vertex>() as u64 + (PIECE * size_of::<[f64; 3]>()) as u64
}

/// The least bytes for blocks whose vertices lie far apart.
pub(super) fn far_bytes(triangles: u64) -> u64 {
    least_memory::<Vertex>(triangles.min(BLOCK as u64), 1)
}

fn window(triangles: u64) -> usize {
    (WINDOW as u64).min(3 * triangles) as usize
}

/// A mesh that is read.
pub(super) struct Reading<'a> {
    pub(super) mesh: &'a dyn MeshSource,
    pub(super) wanted: Wanted,
    pub(super) workers: &'a Workers,
    pub(super) workspace: &'a Workspace,
    /// Bytes for blocks whose vertices lie far apart, no less than [`far_bytes`].
    pub(super) memory: u64,
}

impl Reading<'_> {
    /// Visits the triangles of some blocks, in order. Those that repeat a vertex are left out.
    ///
    /// # Errors
    /// Those of [`Lookup::for_each`].
    pub(super) fn for_each<T: Coordinate, M: Mark>(
        &self,
        blocks: Range<u64>,
        mut visit: impl FnMut(&[Record<T, M>]) -> Result<()>,
    ) -> Result<()> {
        let Reading { mesh, workers, workspace, memory, .. } = *self;
        let window = window(mesh.face_count());
        let lookup = Lookup { mesh, workers, workspace, block: BLOCK, window, in_flight: 1, memory };
        let read = |first: u64, out: &mut [Vertex]| self.vertices(first, out);
        lookup.for_each(blocks, Order::Triangles, &read, |block| Ok(records(block)), |records| visit(&records))
    }

    /// What vertices have, from the one with that number on.
    fn vertices(&self, first: u64, out: &mut [Vertex]) -> Result<()> {
        let mut places = vec![[0.0; 3]; PIECE.min(out.len())];
        for (number, out) in out.chunks_mut(PIECE).enumerate() {
            let (first, places) = (first + (number * PIECE) as u64, &mut places[..out.len()]);
            self.mesh.read_vertices(first, places)?;
            out.iter_mut().zip(&*places).for_each(|(out, place)| out.place = *place);
            let values = &mut places.as_flattened_mut()[..out.len()];
            if let Some(classes) = self.wanted.classes {
                self.mesh.read_attribute(classes, first, values)?;
                out.iter_mut().zip(&*values).for_each(|(out, class)| out.class = u32::from(*class as u16));
            }
            for (channel, attribute) in self.wanted.colours.iter().flat_map(|colours| colours.attributes).enumerate() {
                self.mesh.read_attribute(attribute, first, values)?;
                out.iter_mut().zip(&*values).for_each(|(out, value)| out.colour[channel] = *value as f32);
            }
        }
        Ok(())
    }
}

fn records<T: Coordinate, M: Mark>(block: &Block<'_, Vertex>) -> Vec<Record<T, M>> {
    let mut records = Vec::with_capacity(block.vertices.len());
    let sound = block.vertices.iter().zip(block.corners()).filter(|(numbers, _)| !is_degenerate(**numbers));
    records.extend(sound.map(|(numbers, corners)| {
        let blends = std::array::from_fn(|corner| Blend::of(numbers[corner], corners[corner].colour));
        let classes = corners.map(|corner| corner.class as u16);
        let marks = Marks { corners: blends, ..Marks::default() };
        Record::new(*numbers, classes, corners.map(|corner| corner.place), Drift::NONE, marks)
    }));
    records
}
