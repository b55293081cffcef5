//! PLY: a header, then the mesh's spools as they are, attributes behind the coordinates.

use crate::error::{Error, Result};
use crate::format::ply::header_text::HeaderText;
use crate::format::write::attributes::{BLOCK, Property, properties, records};
use crate::format::write::job::{Job, Positions};
use crate::mesh::MeshSource;
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::points::Precision;
use crate::points::scalar::{Endian, Scalar};

/// Bytes copied at once.
const PIECE: usize = 1 << 20;

/// Bytes that writing a mesh takes: a piece of it; or, where vertices are not written as they lie in its spool, jobs that make blocks of them. A job has what it reads, coordinates and
/// records, and as many bytes that it writes; one job waits for its turn, and has only these.
pub(crate) fn bytes(mesh: &MeshSpool, moves: bool, jobs: u64) -> u64 {
    let stride = mesh.schema().stride() as u64;
    let coordinates = 3 * if moves { size_of::<f64>() } else { MeshSource::precision(mesh).bytes() } as u64;
    let blocks = (2 * jobs - 1).min(2 * mesh.vertex_count().div_ceil(BLOCK as u64));
    let block = mesh.vertex_count().min(BLOCK as u64) * (coordinates + stride);
    let made = if moves || stride > 0 { blocks * block } else { 0 };
    made.max(mesh.bytes().min(PIECE as u64))
}

pub(crate) fn write(job: &mut Job) -> Result<()> {
    let (vertices, faces) = (job.mesh.vertex_count(), job.mesh.face_count());
    if vertices > i32::MAX as u64 {
        // Vertex numbers are `int`: programs that read PLY seldom know another type.
        let limit = i32::MAX as u64;
        return Err(Error::TooManyElements { count: vertices, what: "vertices", limit, carrier: "a PLY file" });
    }
    let moved = job.positions == Positions::Absolute && job.header.origin != [0.0; 3];
    let absolute = moved.then_some(job.header.origin);
    let properties = properties(job.mesh, job.header, job.workers)?;
    let header = HeaderText {
        // Spools hold native byte order.
        endian: Endian::NATIVE,
        comments: job.comments(),
        vertices,
        precision: if moved { Precision::Double } else { job.mesh.precision() },
        attributes: properties.iter().map(|p| (p.name.as_str(), p.scalar)).collect(),
        faces: Some(faces),
    };
    job.put(header.to_string().as_bytes())?;
    let mesh = job.mesh;
    if properties.is_empty() && absolute.is_none() {
        copy(job, vertices, 3 * mesh.precision().bytes(), |first, out| mesh.read_vertex_bytes(first, out))?;
    } else {
        job.put_blocks(vertices, BLOCK, |first, len| made(mesh, &properties, absolute, first, len))?;
    }
    copy(job, faces, size_of::<FaceRecord>(), |first, out| mesh.read_face_records(first, bytemuck::cast_slice_mut(out)))
}

/// The bytes of vertices with their attributes; in double precision, with the origin added, if that is given.
fn made(
    mesh: &MeshSpool,
    properties: &[Property],
    origin: Option<[f64; 3]>,
    first: u64,
    len: usize,
) -> Result<Vec<u8>> {
    let (mut stored, mut moved) = (Vec::new(), Vec::new());
    let (positions, stride): (&[u8], usize) = match origin {
        None => {
            let stride = 3 * mesh.precision().bytes();
            stored.resize(len * stride, 0);
            mesh.read_vertex_bytes(first, &mut stored)?;
            (&stored, stride)
        }
        Some(origin) => {
            moved.resize(len, [0.0; 3]);
            mesh.read_vertices(first, &mut moved)?;
            for position in &mut moved {
                *position = [0, 1, 2].map(|a| position[a] + origin[a]);
            }
            (bytemuck::cast_slice(&moved), size_of::<[f64; 3]>())
        }
    };
    let records = records(mesh, first, len)?;
    let mut out = Vec::with_capacity(positions.len() + records.len());
    for (number, position) in positions.chunks_exact(stride).enumerate() {
        out.extend_from_slice(position);
        let record = &records[number * mesh.schema().stride()..];
        for property in properties {
            let wide = matches!(property.scalar, Scalar::I64 | Scalar::U64);
            let scalar = if wide { Scalar::F64 } else { property.scalar };
            scalar.put(property.value(record), &mut out);
        }
    }
    Ok(out)
}

/// Copies so many records of `stride` bytes, which `read` reads from a number on.
fn copy(job: &mut Job, count: u64, stride: usize, read: impl Fn(u64, &mut [u8]) -> Result<()>) -> Result<()> {
    let most = (PIECE / stride).min(count as usize);
    let mut piece = vec![0; most * stride];
    let mut first = 0;
    while first < count {
        job.workers.check_cancelled()?;
        let now = (count - first).min(most as u64) as usize;
        let piece = &mut piece[..now * stride];
        read(first, piece)?;
        job.put(piece)?;
        job.advance(now as u64);
        first += now as u64;
    }
    Ok(())
}
