//! A mesh from wherever it lies into a spool.

use super::spool::{FaceRecord, MeshSpool};
use super::{MeshSource, check_vertex_count};
use crate::error::Result;
use crate::resources::workers::Workers;

/// Elements of a block, which one thread reads at a time.
const BLOCK: usize = 1 << 15;

/// Appends a mesh's vertices, with their attributes, and its triangles to an empty mesh of the same attributes. `place` tells where a vertex lies in that.
/// `in_flight` blocks are worked on at a time.
///
/// # Errors
/// Those of `place` and of reading the mesh; [`crate::Error::Io`] if the work directory is full; those of a mesh with more vertices than 32 bits can number.
pub fn copy(
    mesh: &dyn MeshSource,
    out: &mut MeshSpool,
    place: impl Fn([f64; 3]) -> Result<[f64; 3]> + Sync,
    (workers, in_flight): (&Workers, usize),
) -> Result<()> {
    check_vertex_count(mesh.vertex_count())?;
    let schema = mesh.schema();
    let blocks = |count: u64| count.div_ceil(BLOCK as u64) as usize;
    let block = |count: u64, number: usize| {
        let first = number as u64 * BLOCK as u64;
        (first, (count - first).min(BLOCK as u64) as usize)
    };
    let vertices = |number: usize| {
        let (first, len) = block(mesh.vertex_count(), number);
        let mut places = vec![[0.0; 3]; len];
        mesh.read_vertices(first, &mut places)?;
        for at in &mut places {
            *at = place(*at)?;
        }
        let stride = schema.stride();
        let mut records = Vec::with_capacity(len * stride);
        if stride > 0 {
            let mut columns = Vec::new();
            for (attribute, _) in schema.attributes().iter().enumerate() {
                let mut values = vec![0.0; len];
                mesh.read_attribute(attribute, first, &mut values)?;
                columns.push(values);
            }
            for vertex in 0..len {
                for (attribute, values) in schema.attributes().iter().zip(&columns) {
                    attribute.scalar.put(values[vertex], &mut records);
                }
            }
        }
        Ok((places, records))
    };
    workers.in_order_range(in_flight, blocks(mesh.vertex_count()), vertices, |(places, records)| {
        out.append_vertices(&places)?;
        out.append_attributes(&records)
    })?;
    let faces = |number: usize| {
        let (first, len) = block(mesh.face_count(), number);
        let mut faces = vec![[0; 3]; len];
        mesh.read_faces(first, &mut faces)?;
        Ok(faces.into_iter().map(FaceRecord::new).collect::<Vec<_>>())
    };
    workers.in_order_range(in_flight, blocks(mesh.face_count()), faces, |faces| out.append_faces(&faces))
}
