//! Meshes as files: PLY, STL, OBJ and GLB, each deterministic, each there only when whole.
//!
//! A [`Target`] is made before the work begins: it proves in the first second that the folder can be written to, and holds a
//! temporary file in it. The file takes its name when its last byte is written and whoever has the mesh written asks for that; on error, on
//! Ctrl-C and on any early return it is removed. Vertices are written in the mesh's own coordinates; the header's origin stands where the
//! format has room for it.
//!
//! | format | coordinates | triangles | attributes | origin | limit |
//! |--------|-------------|-----------|------------|--------|-------|
//! | PLY | `float` or `double`, as the mesh has them; the input's own, unless the origin is to be taken off | `list uchar int` | properties | comment | 2³¹ − 1 vertices |
//! | STL | `f32` | corners, not shared; with normals | none | 80-byte header | 2³² − 1 triangles |
//! | OBJ | shortest decimals that, with the origin, read back exactly | from 1 | colours | comment | none |
//! | GLB | `f32`, turned by the node so that y is up | `u16` or `u32` | `COLOR_0`, `_NAME` | node translation, `asset.extras` | 4 GiB |

pub(crate) mod attributes;
pub(crate) mod job;
mod part;
mod points;
mod sidecar;
pub mod territory;
#[cfg(test)]
mod tests;
pub mod tiles;
pub mod tiling;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use self::job::Job;
use crate::error::{Error, Result};
use crate::format::{glb, obj, ply, stl};
use crate::mesh::spool::MeshSpool;
use crate::mesh::{MeshHeader, MeshSource};
use crate::points::Precision;
use crate::resources::workers::Workers;
use crate::storage::atomic_file::{AtomicFile, Overwrite};
use crate::storage::remote::{is_remote, remove};
use crate::storage::spool::Workspace;

/// The names of the side-cars that a mesh may have beside it, by its format.
pub fn beside(mesh: &Path) -> Vec<PathBuf> {
    match Format::from_path(mesh) {
        Ok(format) if sidecar::needed(format) => sidecar::paths(mesh).to_vec(),
        _ => Vec::new(),
    }
}

pub use attributes::constant;
pub use job::{Format, Positions};
pub use points::{CloudTarget, Description, FileKind};

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Written {
    /// Length of the file.
    pub bytes: u64,
}

/// A mesh file that is going to be.
#[derive(Debug)]
pub struct Target {
    format: Format,
    file: AtomicFile,
    overwrite: Overwrite,
    positions: Positions,
}

impl Target {
    /// Bytes that filling it with a mesh takes, with so many jobs at a time, each of which takes `most` in the formats of which nothing else is said.
    pub fn filling(&self, mesh: &MeshSpool, jobs: u64, most: u64) -> u64 {
        let moves = self.positions == Positions::Absolute && MeshSource::precision(mesh) == Precision::Double;
        match self.format {
            Format::Ply => ply::write::bytes(mesh, moves, jobs),
            Format::Stl | Format::Obj | Format::Glb => (jobs * most).min(mesh.bytes()),
        }
    }

    /// Creates the temporary file beside `path`.
    ///
    /// # Errors
    /// [`Error::Usage`] for an unknown extension, and absolute positions in formats of 32 bits; those of [`AtomicFile::create`], also for
    /// the side-cars that the format may need.
    pub fn prepare(path: &Path, overwrite: Overwrite, positions: Positions) -> Result<Target> {
        Target::prepare_with(path, overwrite, positions, None)
    }

    /// The same; of a mesh that is to be an object in an object store, the temporary file is created in the folder `local`, or else in the system's for such files.
    ///
    /// # Errors
    /// Those of [`Target::prepare`].
    pub fn prepare_with(
        path: &Path,
        overwrite: Overwrite,
        positions: Positions,
        local: Option<&Path>,
    ) -> Result<Target> {
        let format = Format::from_path(path)?;
        let positions = Positions::of(path, Some(positions))?;
        if sidecar::needed(format)
            && overwrite == Overwrite::Refuse
            && let Some(there) = sidecar::any_there(path)?
        {
            return Err(Error::OutputExists(there));
        }
        Ok(Target { format, file: AtomicFile::create_with(path, overwrite, local)?, overwrite, positions })
    }

    /// Creates the file in a folder that has no name yet, as [`AtomicFile::within`] does.
    fn within(path: &Path, format: Format, positions: Positions) -> Result<Target> {
        Ok(Target { format, file: AtomicFile::within(path)?, overwrite: Overwrite::Refuse, positions })
    }

    /// Creates a temporary file that never gets a name: what is written is to be read from it ([`Filled::file`]).
    fn aside(workspace: &Workspace, format: Format, positions: Positions) -> Result<Target> {
        let file = AtomicFile::aside(workspace.dir())?;
        Ok(Target { format, file, overwrite: Overwrite::Refuse, positions })
    }

    /// Writes the mesh; the file has no name yet. `progress` is told the number of vertices and triangles written so far.
    ///
    /// # Errors
    /// [`Error::TooManyElements`] if the format cannot index the mesh, before anything is written; [`Error::Io`]; [`Error::Interrupted`].
    pub fn fill(
        self,
        mesh: &MeshSpool,
        header: &MeshHeader,
        workers: &Workers,
        progress: &mut dyn FnMut(u64),
    ) -> Result<Filled> {
        let out = BufWriter::with_capacity(1 << 16, self.file.file());
        let (path, positions) = (self.file.path(), self.positions);
        let mut job = Job { mesh, header, workers, out, path, positions, bytes: 0, elements: 0, progress };
        match self.format {
            Format::Ply => ply::write::write(&mut job),
            Format::Stl => stl::write::write(&mut job),
            Format::Obj => obj::write::write(&mut job),
            Format::Glb => glb::write::write(&mut job),
        }?;
        job.out.flush().map_err(Error::io(job.path, "write the mesh"))?;
        let written = Written { bytes: job.bytes };
        drop(job);
        let beside = match sidecar::needed(self.format) {
            true => sidecar::write(path, header, positions, self.overwrite)?,
            false => Vec::new(),
        };
        // What an older mesh of that name had beside it would be taken for this one's.
        let mut stale = Vec::new();
        if sidecar::needed(self.format) && self.overwrite == Overwrite::Replace {
            stale = sidecar::paths(path).into_iter().filter(|old| beside.iter().all(|new| new.path() != old)).collect();
        }
        Ok(Filled { file: self.file, beside, stale, written })
    }
}

/// A mesh file that is whole, but for its name. Dropping it removes it.
#[derive(Debug)]
pub struct Filled {
    file: AtomicFile,
    beside: Vec<AtomicFile>,
    /// Side-cars that must not stay.
    stale: Vec<PathBuf>,
    written: Written,
}

impl Filled {
    /// The file.
    fn file(&self) -> &File {
        self.file.file()
    }

    /// Gives the file, and those beside it, their names.
    ///
    /// # Errors
    /// [`Error::OutputExists`] if a file of that name has come up meanwhile; [`Error::Io`].
    pub fn finish(self) -> Result<Written> {
        self.file.finish()?;
        self.beside.into_iter().try_for_each(AtomicFile::finish)?;
        let (remote, local): (Vec<&PathBuf>, Vec<&PathBuf>) = self.stale.iter().partition(|path| is_remote(path));
        remote.into_iter().try_for_each(|path| remove(path))?;
        for path in local.into_iter().filter(|path| path.symlink_metadata().is_ok_and(|there| !there.is_dir())) {
            std::fs::remove_file(path).map_err(Error::io(path, "remove the older mesh's side-car"))?;
        }
        Ok(self.written)
    }
}

/// [`Target::prepare`], [`Target::fill`] and [`Filled::finish`] in one, for tests and benchmarks.
///
/// # Errors
/// As these.
#[cfg(any(test, feature = "internals"))]
pub fn write(
    mesh: &MeshSpool,
    header: &MeshHeader,
    path: &Path,
    overwrite: Overwrite,
    workers: &Workers,
    progress: &mut dyn FnMut(u64),
) -> Result<Written> {
    Target::prepare(path, overwrite, Positions::of(path, None)?)?.fill(mesh, header, workers, progress)?.finish()
}
