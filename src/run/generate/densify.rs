//! A cloud with the centroids of a mesh's triangles added: denser where the mesh knows of a surface (the paper's Table 3).

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::format;
use crate::format::write::{CloudTarget, Description, FileKind};
use crate::input::{Carried, Cloud, InputOptions, Opening, Unpacked, expand};
use crate::mesh::corners::{Block, Lookup, Order};
use crate::points::{Batch, Points, Precision};
use crate::resources::workers::Workers;
use crate::run::Resources;
use crate::run::forecast;
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::storage::atomic_file::Overwrite;
use crate::storage::steady::Steady;

/// Triangles of a job.
const PIECE: u64 = 1 << 14;
/// Vertices that are read along if a piece's numbers span no more: 1.5 MiB of positions.
const WINDOW: usize = 1 << 16;

/// What is made denser, and where it goes.
#[derive(Debug, Clone)]
pub struct Job {
    /// The mesh: PLY, STL, OBJ or GLB.
    pub mesh: PathBuf,
    /// The cloud, in any format that is read.
    pub cloud: PathBuf,
    /// How a raw cloud is laid out.
    pub input: InputOptions,
    /// The file: `.bin` (with a side-car), `.ply`, `.xyz` or `.txt`.
    pub output: PathBuf,
    /// Whether it may replace a file.
    pub overwrite: Overwrite,
    /// What the work may use. Nothing of it shows in the file.
    pub resources: Resources,
}

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Densified {
    /// Points of the cloud.
    pub points: u64,
    /// Centroids.
    pub centroids: u64,
    /// Bytes of the file, without its side-car.
    pub bytes: u64,
}

/// Writes the cloud's points, in their order, and then the centroids of the mesh's triangles in theirs, in the cloud's coordinates and precision. Attributes
/// are left behind.
///
/// Memory: some blocks of points for each worker; of a mesh that has to be converted, up to half the budget; for triangles whose corners lie far apart in the mesh, a quarter.
///
/// # Errors
/// Errors of reading either; [`Error::NoPoints`]; [`Error::Malformed`] if the mesh has no triangles, or a centroid is not finite; [`Error::Usage`] for an unknown
/// extension; [`Error::OutputExists`]; [`Error::Io`]; [`Error::Interrupted`].
pub fn densify(job: &Job, workers: &Workers, progress: &mut Progress) -> Result<Densified> {
    // Before anything is read: whether there will be a place for it.
    FileKind::of(&job.output)?;
    if job.overwrite == Overwrite::Refuse && job.output.exists() {
        return Err(Error::OutputExists(job.output.clone()));
    }
    let budget = job.resources.budget();
    let workspace = job.resources.workspace(&job.output)?.stopped_with(workers);
    let steady = Steady::of([&job.mesh]);
    let mesh = steady.settle(format::read::open(&job.mesh, &workspace, budget / 2))?;
    if mesh.face_count() == 0 {
        return Err(Error::malformed(&job.mesh, "the mesh", "triangles", "none"));
    }
    // Whether the file is packed is known as soon as it is opened.
    let (bytes, mut packed) = (forecast::bytes(&job.cloud), 0);
    progress.expect(forecast::densify(bytes, forecast::points(bytes, bytes), mesh.face_count()));
    let mut watch = |unpacked: Unpacked| {
        packed = bytes;
        progress.unpacked(unpacked);
        workers.check_cancelled()
    };
    let opening = Opening { workspace: &workspace, memory: budget / 8, decompress: Some(workers), watch: &mut watch };
    let cloud = Cloud::open_in(&expand(std::slice::from_ref(&job.cloud))?, &job.input, opening)?;

    let in_flight = workers.threads() + 1;
    let expected = forecast::records(&cloud).max(1);
    progress.expect(forecast::densify(packed, expected, mesh.face_count()));
    progress.begin(Phase::Survey, None);
    let (mut points, mut dropped, mut filtered) = (0, 0, 0);
    let count = |batch: &Batch| Ok((batch.points.len() as u64, batch.dropped, batch.filtered));
    cloud.for_each_batch(workers, in_flight, Carried::Coordinates, count, |part| {
        (points, dropped, filtered) = (points + part.0, dropped + part.1, filtered + part.2);
        progress.add_weighed(part.0, (points + dropped + filtered) as f64 / expected as f64);
        Ok(())
    })?;
    if points == 0 {
        return Err(Error::NoPoints { dropped, filtered });
    }

    let (centroids, precision) = (mesh.face_count(), cloud.precision());
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().replace(char::is_control, " ");
    let comment = format!("{points} points of {}, then {centroids} centroids of {}", name(&job.cloud), name(&job.mesh));
    let description = Description { comment, points: points + centroids, precision };
    let mut target = CloudTarget::create(&job.output, description, job.overwrite)?;
    let kind = target.kind();
    progress.expect(forecast::densify(packed, points, centroids));
    progress.begin(Phase::Write, Some(points + centroids));
    let encode = |batch: &Batch| {
        Ok(match &batch.points {
            Points::Single(points) => encoded(kind, precision, points.iter().map(|p| p.map(f64::from))),
            Points::Double(points) => encoded(kind, precision, points.iter().copied()),
        })
    };
    cloud.for_each_batch(workers, in_flight, Carried::Coordinates, encode, |(count, bytes)| {
        progress.add(count);
        target.append(&bytes)
    })?;
    let lookup = Lookup {
        mesh: &*mesh,
        workers,
        workspace: &workspace,
        block: PIECE as usize,
        window: WINDOW,
        in_flight,
        memory: budget / 4,
    };
    let piece = |block: &Block<'_, [f64; 3]>| {
        let places = centroids_of(block, mesh.origin());
        if let Some(at) = places.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
            let place = format!("triangle {}", block.number * PIECE + at as u64);
            return Err(Error::malformed(&job.mesh, place, "finite corners", format!("{:?}", places[at])));
        }
        Ok(encoded(kind, precision, places.into_iter()))
    };
    let read = |first: u64, positions: &mut [[f64; 3]]| mesh.read_vertices(first, positions);
    let pieces = 0..centroids.div_ceil(PIECE);
    let added = lookup.for_each(pieces, Order::Triangles, &read, piece, |(count, bytes)| {
        progress.add(count);
        target.append(&bytes)
    });
    steady.settle(added)?;
    let (bytes, _) = target.finish()?;
    progress.end();
    Ok(Densified { points, centroids, bytes })
}

/// Some points, and their bytes.
fn encoded(kind: FileKind, precision: Precision, points: impl ExactSizeIterator<Item = [f64; 3]>) -> (u64, Vec<u8>) {
    let count = points.len();
    let mut bytes = Vec::with_capacity(count * 3 * precision.bytes());
    points.for_each(|p| kind.encode(p, precision, &mut bytes));
    (count as u64, bytes)
}

/// The centroids of a block's triangles, in the input's coordinates.
fn centroids_of(block: &Block<'_, [f64; 3]>, origin: [f64; 3]) -> Vec<[f64; 3]> {
    let centroid = |[a, b, c]: [[f64; 3]; 3]| std::array::from_fn(|m| (a[m] + b[m] + c[m]) / 3.0 + origin[m]);
    block.corners().map(centroid).collect()
}
