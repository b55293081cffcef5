//! PLY: a header, then the mesh's two spools as they are.

use std::fmt::Write;

use super::Job;
use crate::error::{Error, Result};
use crate::mesh::MeshSource;
use crate::mesh::spool::FaceRecord;
use crate::points::Precision;
use crate::spool::Spool;

/// Spools hold native byte order.
const FORMAT: &str = if cfg!(target_endian = "little") { "binary_little_endian" } else { "binary_big_endian" };
/// Bytes copied at once.
const PIECE: usize = 1 << 20;

pub(super) fn write(job: &mut Job) -> Result<()> {
    let (vertices, faces) = (job.mesh.vertex_count(), job.mesh.face_count());
    if vertices > i32::MAX as u64 {
        // Vertex numbers are `int`: programs that read PLY seldom know another type.
        let limit = i32::MAX as u64;
        return Err(Error::TooManyElements { count: vertices, what: "vertices", limit, carrier: "a PLY file" });
    }
    let scalar = match job.mesh.precision() {
        Precision::Single => "float",
        Precision::Double => "double",
    };
    let mut header = format!("ply\nformat {FORMAT} 1.0\n");
    for comment in job.comments() {
        writeln!(header, "comment {comment}").expect("memory takes all");
    }
    write!(
        header,
        "element vertex {vertices}\nproperty {scalar} x\nproperty {scalar} y\nproperty {scalar} z\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .expect("memory takes all");
    job.put(header.as_bytes())?;
    let mesh = job.mesh;
    copy(job, mesh.vertex_bytes(), 3 * mesh.precision().bytes())?;
    copy(job, mesh.face_bytes(), size_of::<FaceRecord>())
}

/// Copies a spool of records of `stride` bytes.
fn copy(job: &mut Job, spool: &Spool, stride: usize) -> Result<()> {
    let mut piece = vec![0; PIECE / stride * stride];
    let mut at = 0;
    while at < spool.len() {
        job.workers.check_cancelled()?;
        let len = (spool.len() - at).min(piece.len() as u64) as usize;
        spool.read_at(at, &mut piece[..len])?;
        job.put(&piece[..len])?;
        job.advance((len / stride) as u64);
        at += len as u64;
    }
    Ok(())
}
