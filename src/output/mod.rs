//! Meshes as files: PLY, STL, OBJ and GLB, each deterministic, each there only when whole.
//!
//! A [`Target`] is made before the work begins: it proves in the first second that the folder can be written to, and holds a
//! temporary file in it. The file takes its name when its last byte is written; on error, on Ctrl-C and on any early
//! return it is removed. Vertices are written in the mesh's own coordinates; the header's origin stands where the
//! format has room for it.
//!
//! | format | coordinates | triangles | origin | limit |
//! |--------|-------------|-----------|--------|-------|
//! | PLY | `float` or `double`, as the mesh has them | `list uchar int` | comment | 2³¹ − 1 vertices |
//! | STL | `f32` | corners, not shared; with normals | 80-byte header | 2³² − 1 triangles |
//! | OBJ | shortest decimals that read back exactly | from 1 | comment | none |
//! | GLB | `f32` | `u32` | node translation, `asset.extras` | 4 GiB |

mod glb;
mod obj;
mod ply;
mod stl;
#[cfg(test)]
mod tests;

use std::fs::{File, Permissions};
use std::io::{BufWriter, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::error::{Error, Result};
use crate::mesh::MeshHeader;
use crate::mesh::spool::MeshSpool;
use crate::schedule::Workers;

/// The file formats that meshes are written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Binary little-endian PLY.
    Ply,
    /// Binary STL.
    Stl,
    /// Wavefront OBJ.
    Obj,
    /// glTF 2.0 in one binary file.
    Glb,
}

impl Format {
    /// The format that a path's extension names, in whatever case.
    ///
    /// # Errors
    /// [`Error::Usage`] for any other extension, or none.
    pub fn from_path(path: &Path) -> Result<Format> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("ply") => Ok(Format::Ply),
            Some("stl") => Ok(Format::Stl),
            Some("obj") => Ok(Format::Obj),
            Some("glb") => Ok(Format::Glb),
            _ => Err(Error::Usage(format!(
                "{}: the mesh's format is told by its extension: .ply, .stl, .obj or .glb",
                path.display()
            ))),
        }
    }
}

/// What happens to a file that has the output's name already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Overwrite {
    /// It stays; the work is refused.
    Refuse,
    /// It is replaced, at the moment the new one is whole.
    Replace,
}

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
    path: PathBuf,
    overwrite: Overwrite,
    file: NamedTempFile,
}

impl Target {
    /// Creates the temporary file beside `path`, with the permissions any new file gets.
    ///
    /// # Errors
    /// [`Error::Usage`] for an unknown extension, [`Error::OutputExists`], [`Error::Io`] if the folder cannot be
    /// written to.
    pub fn prepare(path: &Path, overwrite: Overwrite) -> Result<Target> {
        let format = Format::from_path(path)?;
        if overwrite == Overwrite::Refuse && path.exists() {
            return Err(Error::OutputExists(path.to_path_buf()));
        }
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let file = tempfile::Builder::new()
            .prefix(&format!(".{name}."))
            .suffix(".tmp")
            // Less the process's umask, as for any file that is created.
            .permissions(Permissions::from_mode(0o666))
            .tempfile_in(folder)
            .map_err(Error::io(path, "create the mesh"))?;
        Ok(Target { format, path: path.to_path_buf(), overwrite, file })
    }

    /// Writes the mesh and gives the file its name. `progress` is told the number of vertices and triangles
    /// written so far.
    ///
    /// # Errors
    /// [`Error::TooManyElements`] if the format cannot index the mesh, before anything is written; [`Error::Io`];
    /// [`Error::OutputExists`] if a file of that name has come up meanwhile; [`Error::Interrupted`].
    pub fn write(
        self,
        mesh: &MeshSpool,
        header: &MeshHeader,
        workers: &Workers,
        progress: &mut dyn FnMut(u64),
    ) -> Result<Written> {
        let out = BufWriter::with_capacity(1 << 16, self.file.as_file());
        let mut job = Job { mesh, header, workers, out, path: &self.path, bytes: 0, elements: 0, progress };
        match self.format {
            Format::Ply => ply::write(&mut job),
            Format::Stl => stl::write(&mut job),
            Format::Obj => obj::write(&mut job),
            Format::Glb => glb::write(&mut job),
        }?;
        job.out.flush().map_err(Error::io(&self.path, "write the mesh"))?;
        let written = Written { bytes: job.bytes };
        drop(job);
        match self.overwrite {
            Overwrite::Replace => self.file.persist(&self.path),
            Overwrite::Refuse => self.file.persist_noclobber(&self.path),
        }
        .map_err(|refused| match refused.error.kind() {
            std::io::ErrorKind::AlreadyExists => Error::OutputExists(self.path.clone()),
            _ => Error::io(&self.path, "name the finished mesh")(refused.error),
        })?;
        Ok(written)
    }
}

/// [`Target::prepare`] and [`Target::write`] in one.
///
/// # Errors
/// As these.
pub fn write(
    mesh: &MeshSpool,
    header: &MeshHeader,
    path: &Path,
    overwrite: Overwrite,
    workers: &Workers,
    progress: &mut dyn FnMut(u64),
) -> Result<Written> {
    Target::prepare(path, overwrite)?.write(mesh, header, workers, progress)
}

/// One file under way: what the formats share.
struct Job<'a> {
    mesh: &'a MeshSpool,
    header: &'a MeshHeader,
    workers: &'a Workers,
    out: BufWriter<&'a File>,
    path: &'a Path,
    bytes: u64,
    elements: u64,
    progress: &'a mut dyn FnMut(u64),
}

impl Job<'_> {
    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.out.write_all(bytes).map_err(Error::io(self.path, "write the mesh"))?;
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    /// Tells that `count` more vertices or triangles are written.
    fn advance(&mut self, count: u64) {
        self.elements += count;
        (self.progress)(self.elements);
    }

    /// Lets the workers make the bytes of elements `0..count`, `block` at a time, and puts them in order.
    fn put_blocks(
        &mut self,
        count: u64,
        block: usize,
        make: impl Fn(u64, usize) -> Result<Vec<u8>> + Sync,
    ) -> Result<()> {
        let blocks = count.div_ceil(block as u64) as usize;
        let workers = self.workers;
        let make = |number: usize| {
            let first = number as u64 * block as u64;
            let len = (count - first).min(block as u64);
            Ok((len, make(first, len as usize)?))
        };
        workers.in_order_range(workers.threads() + 1, blocks, make, |(len, bytes)| {
            self.put(&bytes)?;
            self.advance(len);
            Ok(())
        })
    }

    /// The header's comments, each as one line without control characters; with the origin, if there is one, as the last.
    fn comments(&self) -> Vec<String> {
        let mut lines: Vec<String> =
            self.header.comments.iter().map(|line| line.replace(|c: char| c.is_control(), " ")).collect();
        if self.header.origin != [0.0; 3] {
            let [x, y, z] = self.header.origin;
            lines.push(format!("origin {x} {y} {z}"));
        }
        lines
    }
}
