//! Levels of detail: the mesh, and from level to level fewer triangles.
//!
//! Each level is the one before it, whole, with twice its tolerance. How far a level may be from the mesh is the sum of what was proven on the way to it: no place of
//! either surface is farther than that from the other. A step that leaves out too little to be worth a level is gone on from with twice the tolerance, and what
//! it moved the surface counts, too.

use super::tree::MOST;
use crate::error::{Error, Result};
use crate::mesh::MeshSource;
use crate::mesh::copy::copy;
use crate::mesh::corners::Corners;
use crate::mesh::measure::is_degenerate;
use crate::mesh::spool::MeshSpool;
use crate::points::Precision;
use crate::points::attribute::Schema;
use crate::run::progress::Progress;
use crate::run::saved_mesh::Means;
use crate::run::simplification::passes;
use crate::simplify::{Extent, Options};

/// The first tolerance, in mean edges of the mesh.
const FIRST: f64 = 0.2;
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
    pub fn of(mesh: &MeshSpool, means: Means<'_>) -> Result<Extents> {
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
        each_block(mesh, means, look, |(more, sum)| {
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
    means: Means<'_>,
    work: impl Fn(Vec<[u32; 3]>) -> Result<R> + Sync,
    sink: impl FnMut(R) -> Result<()>,
) -> Result<()> {
    means.workers.in_order_range(means.in_flight(), blocks(mesh), |number| work(block(mesh, number)?), sink)
}

/// A mesh in single precision, of which `place` tells where vertices lie.
///
/// # Errors
/// Those of `place` and of reading the mesh; [`Error::Io`] if the work directory is full.
pub(super) fn copied(
    mesh: &dyn MeshSource,
    place: impl Fn([f64; 3]) -> Result<[f64; 3]> + Sync,
    in_memory: u64,
    means: Means<'_>,
) -> Result<MeshSpool> {
    let schema: Schema = mesh.schema().clone();
    let mut out = MeshSpool::with_attributes(means.workspace, Precision::Single, schema, in_memory);
    copy(mesh, &mut out, place, (means.workers, means.in_flight()))?;
    Ok(out)
}

/// The coarser levels of a mesh, until one fits in a tile, or no triangle more can go. Steps are kept under names that begin with `name`.
///
/// # Errors
/// Those of [`passes`].
pub(super) fn coarser(
    mesh: &MeshSpool,
    extents: &Extents,
    name: &str,
    means: Means<'_>,
    progress: &mut Progress,
) -> Result<Vec<Level>> {
    let mut levels: Vec<Level> = Vec::new();
    // A step that is no level.
    let mut step: Option<MeshSpool> = None;
    let (mut tolerance, mut error) = (FIRST * extents.edge, 0.0);
    for number in 0.. {
        let last = levels.last().map_or(mesh, |level| &level.mesh);
        if last.face_count() <= MOST || tolerance == 0.0 {
            break;
        }
        let from = step.as_ref().unwrap_or(last);
        let (fewer, reached) = fewer(from, tolerance, &format!("{name}-{number}"), means, progress)?;
        error += reached;
        let exhausted = tolerance > 2.0 * extents.diagonal();
        tolerance *= 2.0;
        let worth = fewer.face_count() as f64 <= WORTH * last.face_count() as f64 || fewer.face_count() <= MOST;
        if fewer.face_count() == 0 || exhausted && !worth {
            break;
        }
        if worth {
            levels.push(Level { mesh: fewer, error });
            step = None;
        } else {
            step = Some(fewer);
        }
    }
    Ok(levels)
}

/// A mesh with fewer triangles, within a tolerance, and how far it is from the mesh.
fn fewer(
    mesh: &MeshSpool,
    tolerance: f64,
    name: &str,
    by: Means<'_>,
    progress: &mut Progress,
) -> Result<(MeshSpool, f64)> {
    let Means { memory, workers, workspace, kept } = by;
    let means = (workers, workspace);
    if let Some(kept) = kept
        && let Some((mesh, bits)) = kept.found::<u64>(name, (mesh.precision(), mesh.schema()), means)?
    {
        return Ok((mesh, f64::from_bits(bits)));
    }
    let least = Extent::of(mesh, false, false).least_memory();
    let options = Options { tolerance: Some(tolerance), most: None, borders: None, colours: None, moves: false };
    let within = Means { memory: (memory / 4 * 3).max(least), ..by };
    let (fewer, figures) = passes(mesh, &options, &format!("{name}-simplify"), within, progress)?;
    if let Some(kept) = kept {
        return Ok((kept.keep(name, &fewer, figures.reached.to_bits(), means, by.in_flight())?, figures.reached));
    }
    // What levels keep in memory together must not grow.
    let in_memory = if memory > 2 * least { memory / 64 } else { 0 };
    match fewer.bytes() > in_memory {
        true => Ok((copied(&fewer, Ok, 0, by)?, figures.reached)),
        false => Ok((fewer, figures.reached)),
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

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;

    use super::*;
    use crate::mesh::spool::FaceRecord;
    use crate::resources::workers::Workers;
    use crate::run::progress::Show;
    use crate::run::saved_mesh::KeptSteps;
    use crate::storage::spool::Workspace;
    use crate::storage::work::WorkFolder;
    use crate::storage::work::simulated::{Crash, Fault, Simulated};

    /// A level: its vertices, its triangles, and the bits of its distance.
    type Bits = (Vec<[f64; 3]>, Vec<[u32; 3]>, u64);

    /// A square of waves.
    fn waves(workspace: &Workspace) -> MeshSpool {
        const SIDE: u32 = 44;
        let mut mesh = MeshSpool::new(workspace, Precision::Single, 1 << 30);
        let place = |v: u32| {
            let [x, y] = [v % (SIDE + 1), v / (SIDE + 1)].map(f64::from);
            [x, y, 2.0 * (x / 5.0).sin() * (y / 7.0).cos() + 0.1 * f64::from(v * 7919 % 13)]
        };
        mesh.append_vertices(&(0..(SIDE + 1) * (SIDE + 1)).map(place).collect::<Vec<_>>()).unwrap();
        let at = |i: u32, j: u32| i * (SIDE + 1) + j;
        let faces = (0..SIDE * SIDE).flat_map(|n| {
            let (i, j) = (n / SIDE, n % SIDE);
            [[at(i, j), at(i, j + 1), at(i + 1, j)], [at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]]
        });
        mesh.append_faces(&faces.map(FaceRecord::new).collect::<Vec<_>>()).unwrap();
        mesh
    }

    fn levels(
        mesh: &MeshSpool,
        workspace: &Workspace,
        (threads, memory): (usize, u64),
        kept: Option<KeptSteps>,
    ) -> Result<Vec<Bits>> {
        let workers = Workers::new(threads)?;
        let means = Means { memory, workers: &workers, workspace, kept };
        let extents = Extents::of(mesh, means)?;
        let levels = coarser(mesh, &extents, "level", means, &mut Progress::new(Show::Nothing))?;
        let bits = |level: Level| {
            let mut vertices = vec![[0.0; 3]; level.mesh.vertex_count() as usize];
            level.mesh.read_vertices(0, &mut vertices)?;
            let mut faces = vec![[0; 3]; level.mesh.face_count() as usize];
            level.mesh.read_faces(0, &mut faces)?;
            Ok((vertices, faces, level.error.to_bits()))
        };
        levels.into_iter().map(bits).collect()
    }

    /// In the folder of a run by itself, and in one that processes share: at every operation, and with every file damaged.
    #[test]
    #[ignore = "exhaustive"]
    fn levels_are_gone_on_with_at_every_operation() {
        let dir = tempfile::tempdir().unwrap();
        let workspace = Workspace::new(dir.path()).unwrap();
        let mesh = waves(&workspace);
        let expected = levels(&mesh, &workspace, (2, 1 << 30), None).unwrap();
        assert!(expected.len() > 1, "{} levels", expected.len());
        for alone in [true, false] {
            let kept_in = |store: &Simulated, means| {
                let store = Arc::new(store.clone());
                let work = match alone {
                    true => WorkFolder::in_store(store)?,
                    false => WorkFolder::shared_store(store, Path::new("work")),
                };
                let found = levels(&mesh, &workspace, means, Some(KeptSteps { work: &work, ending: ".3", alone }))?;
                work.settle(false).map(|()| found)
            };
            let whole = Simulated::default();
            assert_eq!(kept_in(&whole, (1, 1 << 30)).unwrap(), expected);
            let files = whole.files();
            // What is there is read, not made again.
            let again = whole.after(Crash::Kill);
            assert_eq!(kept_in(&again, (2, 0)).unwrap(), expected);
            assert_eq!(again.files(), files);
            for at in 0..whole.operations() {
                let store = Simulated::default();
                store.plant(Fault::CrashAt(at));
                if let Ok(found) = kept_in(&store, (1, 1 << 30)) {
                    assert_eq!(found, expected, "{at}");
                }
                for crash in [Crash::Kill, Crash::PowerCut(at)] {
                    let store = store.after(crash);
                    let mut found = kept_in(&store, (2, 0));
                    for _ in 0..3 {
                        if matches!(found, Err(Error::Damaged { .. })) {
                            found = kept_in(&store, (2, 0));
                        }
                    }
                    assert_eq!(found.unwrap(), expected, "{at} {crash:?}");
                }
            }
            for (name, length) in files.into_iter().filter(|(_, length)| *length > 0) {
                let damaged = whole.after(Crash::Kill);
                damaged.damage(&name, length / 2);
                let mut found = kept_in(&damaged, (1, 1 << 30));
                if matches!(found, Err(Error::Damaged { .. })) {
                    found = kept_in(&damaged, (1, 1 << 30));
                }
                assert_eq!(found.unwrap(), expected, "{name}");
            }
        }
    }
}
