//! Levels of detail: the mesh, and from level to level fewer triangles.
//!
//! Each level is the one before it, whole, with twice its tolerance. How far a level may be from the mesh is the sum of what was proven on the way to it: no place of
//! either surface is farther than that from the other. A step that leaves out too little to be worth a level is gone on from with twice the tolerance, and what
//! it moved the surface counts, too.

use super::tree::MOST;
use crate::error::{Error, Result};
use crate::mesh::measure::{Corners, is_degenerate};
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::mesh::{MeshSource, check_vertex_count};
use crate::points::Precision;
use crate::points::attribute::Schema;
use crate::resources::workers::Workers;
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::simplify::{Extent, Options, simplify};
use crate::storage::spool::Workspace;

/// The first tolerance, in mean edges of the mesh.
const FIRST: f64 = 0.1;
/// A level has at most so much of the triangles of the one before it.
const WORTH: f64 = 0.6;
/// Elements of a block.
pub(super) const BLOCK: usize = 1 << 15;
/// Vertices that a block's triangles may span for all of them to be read.
pub(super) const WINDOW: usize = 1 << 16;

/// A level.
pub(super) struct Level {
    /// Its mesh.
    pub mesh: MeshSpool,
    /// No place of it, or of the mesh, is farther than this from the other.
    pub error: f64,
}

/// What is measured of a mesh.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extents {
    /// The box of all triangles.
    pub bounds: [[f64; 3]; 2],
    /// The root mean square of edges.
    edge: f64,
}

impl Extents {
    /// Of all triangles.
    ///
    /// # Errors
    /// Errors of reading the mesh; [`Error::Interrupted`].
    pub fn of(mesh: &MeshSpool, workers: &Workers) -> Result<Extents> {
        let none = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        let (mut bounds, mut squares) = (none, 0.0);
        let look = |mut faces: Vec<[u32; 3]>| {
            let mut corners = Corners::default();
            corners.fill(mesh, &mut faces, WINDOW)?;
            let (mut bounds, mut squares) = (none, 0.0);
            for face in faces {
                let places = face.map(|v| corners.table[v as usize]);
                places.iter().for_each(|place| widen(&mut bounds, [*place; 2]));
                for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                    squares +=
                        (0..3).map(|i| (places[a][i] - places[b][i]) * (places[a][i] - places[b][i])).sum::<f64>();
                }
            }
            Ok((bounds, squares))
        };
        each_block(mesh, workers, look, |(more, sum)| {
            widen(&mut bounds, more);
            squares += sum;
            Ok(())
        })?;
        let edge = libm::sqrt(squares / (3 * mesh.face_count()).max(1) as f64);
        Ok(Extents { bounds, edge })
    }

    fn diagonal(&self) -> f64 {
        let [low, high] = self.bounds;
        libm::sqrt((0..3).map(|a| (high[a] - low[a]) * (high[a] - low[a])).sum())
    }
}

/// Widens a box by another.
pub(super) fn widen(bounds: &mut [[f64; 3]; 2], [low, high]: [[f64; 3]; 2]) {
    for a in 0..3 {
        bounds[0][a] = bounds[0][a].min(low[a]);
        bounds[1][a] = bounds[1][a].max(high[a]);
    }
}

/// The number of blocks of a mesh's triangles.
pub(super) fn blocks(mesh: &MeshSpool) -> usize {
    mesh.face_count().div_ceil(BLOCK as u64) as usize
}

/// The triangles of a block, without those that repeat a vertex.
///
/// # Errors
/// Errors of reading the mesh.
pub(super) fn block(mesh: &MeshSpool, number: usize) -> Result<Vec<[u32; 3]>> {
    let first = number as u64 * BLOCK as u64;
    let mut faces = vec![[0; 3]; (mesh.face_count() - first).min(BLOCK as u64) as usize];
    mesh.read_faces(first, &mut faces)?;
    faces.retain(|face| !is_degenerate(*face));
    Ok(faces)
}

/// Reads triangles block by block, works on each, and takes the results in order. Triangles that repeat a vertex are left out.
pub(super) fn each_block<R: Send>(
    mesh: &MeshSpool,
    workers: &Workers,
    work: impl Fn(Vec<[u32; 3]>) -> Result<R> + Sync,
    sink: impl FnMut(R) -> Result<()>,
) -> Result<()> {
    workers.in_order_range(workers.threads() + 1, blocks(mesh), |number| work(block(mesh, number)?), sink)
}

/// A mesh in single precision, of which `place` tells where vertices lie.
///
/// # Errors
/// Those of `place` and of reading the mesh; [`Error::Io`] if the work directory is full.
pub(super) fn copied(
    mesh: &dyn MeshSource,
    place: impl Fn([f64; 3]) -> Result<[f64; 3]> + Sync,
    in_memory: u64,
    workers: &Workers,
    workspace: &Workspace,
) -> Result<MeshSpool> {
    check_vertex_count(mesh.vertex_count())?;
    let schema: Schema = mesh.schema().clone();
    let mut out = MeshSpool::with_attributes(workspace, Precision::Single, schema.clone(), in_memory);
    let in_flight = workers.threads() + 1;
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
    workers.in_order_range(in_flight, blocks(mesh.face_count()), faces, |faces| out.append_faces(&faces))?;
    Ok(out)
}

/// The coarser levels of a mesh, until one fits in a tile, or no triangle more can go.
///
/// # Errors
/// Those of [`simplify`].
pub(super) fn coarser(
    mesh: &MeshSpool,
    extents: &Extents,
    budget: u64,
    (workers, workspace): (&Workers, &Workspace),
    progress: &mut Progress,
) -> Result<Vec<Level>> {
    let mut levels: Vec<Level> = Vec::new();
    // A step that is no level.
    let mut step: Option<MeshSpool> = None;
    let (mut tolerance, mut error) = (FIRST * extents.edge, 0.0);
    loop {
        let last = levels.last().map_or(mesh, |level| &level.mesh);
        if last.face_count() <= MOST || tolerance == 0.0 {
            return Ok(levels);
        }
        let from = step.as_ref().unwrap_or(last);
        let least = Extent::of(from, false, false).least_memory();
        let room = (budget / 4 * 3).max(least);
        let options = Options { tolerance: Some(tolerance), most: None, borders: None, colours: None, moves: false };
        let triangles = from.face_count() as f64;
        progress.begin(Phase::Simplify, Some(from.face_count()));
        let told = &mut |part: f64| progress.set((part * triangles) as u64);
        let (fewer, figures) = simplify(from, &options, room, workers, workspace, told)?;
        error += figures.reached;
        let exhausted = tolerance > 2.0 * extents.diagonal();
        tolerance *= 2.0;
        let worth = fewer.face_count() as f64 <= WORTH * last.face_count() as f64 || fewer.face_count() <= MOST;
        if fewer.face_count() == 0 || exhausted && !worth {
            return Ok(levels);
        }
        // What levels keep in memory together must not grow.
        let kept = if budget > 2 * least { budget / 64 } else { 0 };
        let fewer = match fewer.bytes() > kept {
            true => copied(&fewer, Ok, 0, workers, workspace)?,
            false => fewer,
        };
        if worth {
            levels.push(Level { mesh: fewer, error });
            step = None;
        } else {
            step = Some(fewer);
        }
    }
}

/// Refuses places that are no places.
///
/// # Errors
/// [`Error::Malformed`].
pub(super) fn finite(place: [f64; 3], path: &std::path::Path) -> Result<[f64; 3]> {
    if place.iter().all(|c| c.is_finite()) {
        return Ok(place);
    }
    Err(Error::malformed(path, "the mesh", "vertices with finite coordinates", format!("{place:?}")))
}
