//! OBJ: text, vertices first, triangles numbered from 1.

use std::io::Write;

use super::Job;
use super::attributes::{COLOURS, Property, properties, records};
use crate::error::Result;
use crate::mesh::MeshSource;
use crate::points::Precision;

/// Lines of a block.
const BLOCK: usize = 1 << 15;

pub(super) fn write(job: &mut Job) -> Result<()> {
    let mesh = job.mesh;
    let comments: String = job.comments().iter().map(|line| format!("# {line}\n")).collect();
    job.put(comments.as_bytes())?;
    let properties = properties(job)?;
    let colours: Vec<&Property> =
        COLOURS.iter().filter_map(|name| properties.iter().find(|property| property.name == *name)).collect();
    // Behind the coordinates, where most programs read colours of vertices, from 0 to 1.
    let colours = <[&Property; 3]>::try_from(colours).ok();
    job.put_blocks(mesh.vertex_count(), BLOCK, |first, len| {
        let mut vertices = vec![[0.0; 3]; len];
        mesh.read_vertices(first, &mut vertices)?;
        let records = if colours.is_some() { records(mesh, first, len)? } else { Vec::new() };
        let mut lines = Vec::with_capacity(len * 32);
        for (number, [x, y, z]) in vertices.into_iter().enumerate() {
            match mesh.precision() {
                // As `f32` the shortest decimals are shorter, and read back to the same `f32`.
                Precision::Single => write!(lines, "v {} {} {}", x as f32, y as f32, z as f32),
                Precision::Double => write!(lines, "v {x} {y} {z}"),
            }
            .expect("memory takes all");
            for colour in colours.iter().flatten() {
                let record = &records[number * mesh.schema().stride()..];
                write!(lines, " {}", (colour.value(record) / colour.full()) as f32).expect("memory takes all");
            }
            lines.push(b'\n');
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
