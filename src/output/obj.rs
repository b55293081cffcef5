//! OBJ: text, vertices first, triangles numbered from 1.

use std::io::Write;

use super::Job;
use crate::error::Result;
use crate::mesh::MeshSource;
use crate::points::Precision;

/// Lines of a block.
const BLOCK: usize = 1 << 15;

pub(super) fn write(job: &mut Job) -> Result<()> {
    let mesh = job.mesh;
    let comments: String = job.comments().iter().map(|line| format!("# {line}\n")).collect();
    job.put(comments.as_bytes())?;
    job.put_blocks(mesh.vertex_count(), BLOCK, |first, len| {
        let mut vertices = vec![[0.0; 3]; len];
        mesh.read_vertices(first, &mut vertices)?;
        let mut lines = Vec::with_capacity(len * 32);
        for [x, y, z] in vertices {
            match mesh.precision() {
                // As `f32` the shortest decimals are shorter, and read back to the same `f32`.
                Precision::Single => writeln!(lines, "v {} {} {}", x as f32, y as f32, z as f32),
                Precision::Double => writeln!(lines, "v {x} {y} {z}"),
            }
            .expect("memory takes all");
        }
        Ok(lines)
    })?;
    job.put_blocks(mesh.face_count(), BLOCK, |first, len| {
        let mut faces = vec![[0; 3]; len];
        mesh.read_faces(first, &mut faces)?;
        let mut lines = Vec::with_capacity(len * 24);
        for face in faces {
            let [a, b, c] = face.map(|v| u64::from(v) + 1);
            writeln!(lines, "f {a} {b} {c}").expect("memory takes all");
        }
        Ok(lines)
    })
}
