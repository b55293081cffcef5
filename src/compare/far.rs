//! Corners of triangles that name vertices all over a mesh, found in two sorts instead of by jumping about.
//!
//! ```text
//!  corner, vertex    -> ranges of vertices:  each range's vertices are read once
//!  corner, place     -> ranges of triangles: each range's triangles are put together
//! ```

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::mesh::MeshSource;
use crate::nearest::room::Room;
use crate::nearest::shape::{Point, Triangle};

/// A corner, and the vertex it is.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, packed)]
struct Named {
    corner: u64,
    vertex: u32,
}

/// A corner, and where it lies.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Placed {
    corner: u64,
    place: Point,
}

/// Hands over the triangles of `pieces` of at most `piece` triangles each, in stretches of about as many, their corners in the mesh's own coordinates.
///
/// # Errors
/// Errors of reading and of `sink`; [`crate::Error::Io`]; [`crate::Error::Interrupted`].
pub(super) fn triangles(
    mesh: &dyn MeshSource,
    room: &Room,
    pieces: &[u64],
    piece: u64,
    mut sink: impl FnMut(Vec<Triangle>) -> Result<()>,
) -> Result<()> {
    let table = |bytes: usize, count: u64| (room.corners * room.in_flight as u64 / bytes as u64).clamp(1, count.max(1));
    let vertices = table(size_of::<Point>(), mesh.vertex_count());
    let ranges = |count: u64, range: u64| count.div_ceil(range) as usize;
    let mut by_vertex = room.partitions(ranges(mesh.vertex_count(), vertices), 1);
    let (mut faces, mut corner) = (Vec::new(), 0);
    for number in pieces {
        room.workers.check_cancelled()?;
        let first = number * piece;
        faces.resize((mesh.face_count() - first).min(piece) as usize, [0; 3]);
        mesh.read_faces(first, &mut faces)?;
        for &vertex in faces.as_flattened() {
            by_vertex.push((u64::from(vertex) / vertices) as usize, &Named { corner, vertex })?;
            corner += 1;
        }
    }

    let whole = corner / 3;
    let stretch = table(size_of::<Triangle>(), whole);
    let mut by_triangle = room.partitions(ranges(whole, stretch), 1);
    let (mut places, mut named) = (Vec::new(), Vec::new());
    for range in 0..by_vertex.count() {
        room.workers.check_cancelled()?;
        let first = range as u64 * vertices;
        places.resize((mesh.vertex_count() - first).min(vertices) as usize, [0.0; 3]);
        mesh.read_vertices(first, &mut places)?;
        while by_vertex.take(range, &mut named)? {
            for Named { corner, vertex } in named.drain(..) {
                let place = places[(u64::from(vertex) - first) as usize];
                by_triangle.push((corner / 3 / stretch) as usize, &Placed { corner, place })?;
            }
        }
    }
    drop((by_vertex, places));

    let mut placed = Vec::new();
    for range in 0..by_triangle.count() {
        room.workers.check_cancelled()?;
        let first = range as u64 * stretch;
        let mut triangles = vec![Triangle::zeroed(); (whole - first).min(stretch) as usize];
        while by_triangle.take(range, &mut placed)? {
            for Placed { corner, place } in placed.drain(..) {
                triangles[(corner / 3 - first) as usize].0[(corner % 3) as usize] = place;
            }
        }
        sink(triangles)?;
    }
    Ok(())
}
