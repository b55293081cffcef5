//! Normals of a level's vertices: the mean of its triangles', by area, all over the level, so that no border of a tile shows.

use std::ops::Range;

use super::levels::{WINDOW, block, blocks, each_block};
use crate::error::Result;
use crate::mesh::MeshSource;
use crate::mesh::corners::{Corners, span};
use crate::mesh::spool::MeshSpool;
use crate::run::saved_mesh::Means;
use crate::storage::spool::Spool;

/// Bytes of a normal.
pub(super) const BYTES: u64 = 12;

/// The normals of all vertices, three `f32` each. An eighth of the memory is for the sums: with less, triangles are read more often.
///
/// # Errors
/// Errors of reading the mesh; [`crate::Error::Io`] if the work directory is full; [`crate::Error::Interrupted`].
pub(super) fn normals(mesh: &MeshSpool, means: Means<'_>) -> Result<Spool> {
    let Means { memory, workers, workspace, .. } = means;
    let vertices = mesh.vertex_count();
    let together = (memory / 8 / BYTES).max(1 << 16).min(vertices.max(1));
    let blocks = blocks(mesh);
    // The vertices of each block, from the first to the last.
    let mut spans = vec![Some((0, u32::MAX)); blocks];
    if together < vertices {
        spans.clear();
        each_block(
            mesh,
            means,
            |faces| Ok(span(&faces)),
            |span| {
                spans.push(span);
                Ok(())
            },
        )?;
    }
    let mut out = workspace.spool(0);
    let mut sums = Vec::new();
    for first in (0..vertices).step_by(together as usize) {
        let range = first..(first + together).min(vertices);
        sums.clear();
        sums.resize((range.end - range.start) as usize, [0f32; 3]);
        let meets =
            |range: &Range<u64>, (low, high): (u32, u32)| u64::from(low) < range.end && u64::from(high) >= range.start;
        let there: Vec<usize> =
            (0..blocks).filter(|block| spans[*block].is_some_and(|span| meets(&range, span))).collect();
        let work = |number: usize| {
            let faces = block(mesh, there[number])?;
            let (mut local, mut corners) = (faces.clone(), Corners::default());
            corners.fill(mesh, &mut local, WINDOW)?;
            let across = local.iter().map(|face| across(face.map(|v| corners.table[v as usize]))).collect::<Vec<_>>();
            Ok((faces, across))
        };
        workers.in_order_range(means.in_flight(), there.len(), work, |(faces, across)| {
            for (face, across) in faces.iter().zip(&across) {
                for v in face.iter().filter(|v| range.contains(&u64::from(**v))) {
                    let sum = &mut sums[(u64::from(*v) - range.start) as usize];
                    (0..3).for_each(|a| sum[a] += across[a]);
                }
            }
            Ok(())
        })?;
        sums.iter_mut().for_each(|sum| *sum = of_length_one(*sum));
        out.append(bytemuck::cast_slice(&sums))?;
    }
    Ok(out)
}

/// Twice a triangle's area along its normal.
fn across([a, b, c]: [[f64; 3]; 3]) -> [f32; 3] {
    let (u, v): ([f64; 3], [f64; 3]) = (std::array::from_fn(|i| b[i] - a[i]), std::array::from_fn(|i| c[i] - a[i]));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]].map(|c| c as f32)
}

/// Up, where there is no direction.
fn of_length_one(sum: [f32; 3]) -> [f32; 3] {
    let length = sum.iter().map(|c| f64::from(*c) * f64::from(*c)).sum::<f64>().sqrt();
    if length > 0.0 && length.is_finite() { sum.map(|c| (f64::from(c) / length) as f32) } else { [0.0, 0.0, 1.0] }
}
