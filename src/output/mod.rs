//! Meshes as files: PLY, STL, OBJ and GLB, each deterministic, each there only when whole.
//!
//! A [`Target`] is made before the work begins: it proves in the first second that the folder can be written to, and holds a
//! temporary file in it. The file takes its name when its last byte is written and whoever has the mesh written asks for that; on error, on
//! Ctrl-C and on any early return it is removed. Vertices are written in the mesh's own coordinates; the header's origin stands where the
//! format has room for it.
//!
//! | format | coordinates | triangles | attributes | origin | limit |
//! |--------|-------------|-----------|------------|--------|-------|
//! | PLY | `float` or `double`, as the mesh has them | `list uchar int` | properties | comment | 2³¹ − 1 vertices |
//! | STL | `f32` | corners, not shared; with normals | none | 80-byte header | 2³² − 1 triangles |
//! | OBJ | shortest decimals that read back exactly | from 1 | colours | comment | none |
//! | GLB | `f32` | `u32` | `COLOR_0`, `_NAME` | node translation, `asset.extras` | 4 GiB |

mod attributes;
mod glb;
mod obj;
mod ply;
mod points;
mod sidecar;
mod stl;
#[cfg(test)]
mod tests;
mod tiles;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::error::{Error, Result};
use crate::mesh::MeshHeader;
use crate::mesh::spool::MeshSpool;
use crate::schedule::Workers;
use crate::whole::{Overwrite, WholeFile};

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

pub use points::{CloudTarget, Description, FileKind};
pub use tiles::Tiles;

/// Which coordinates vertices are written with, where the format has a choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Positions {
    /// The mesh's own, in the input's precision, less the origin.
    #[default]
    Shifted,
    /// The input's, in double precision: PLY only.
    Absolute,
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
    file: WholeFile,
    overwrite: Overwrite,
    positions: Positions,
}

impl Target {
    /// Creates the temporary file beside `path`.
    ///
    /// # Errors
    /// [`Error::Usage`] for an unknown extension, and absolute positions in other formats than PLY; those of [`WholeFile::create`], also for
    /// the side-cars that the format may need.
    pub fn prepare(path: &Path, overwrite: Overwrite, positions: Positions) -> Result<Target> {
        let format = Format::from_path(path)?;
        if positions == Positions::Absolute && format != Format::Ply {
            return Err(Error::Usage(format!("--ply-double: {} is no PLY file", path.display())));
        }
        if sidecar::needed(format)
            && overwrite == Overwrite::Refuse
            && let Some(there) = sidecar::paths(path).into_iter().find(|path| path.exists())
        {
            return Err(Error::OutputExists(there));
        }
        Ok(Target { format, file: WholeFile::create(path, overwrite)?, overwrite, positions })
    }

    /// Creates the file in a folder that has no name yet, as [`WholeFile::within`] does.
    fn within(path: &Path, format: Format, positions: Positions) -> Result<Target> {
        Ok(Target { format, file: WholeFile::within(path)?, overwrite: Overwrite::Refuse, positions })
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
            Format::Ply => ply::write(&mut job),
            Format::Stl => stl::write(&mut job),
            Format::Obj => obj::write(&mut job),
            Format::Glb => glb::write(&mut job),
        }?;
        job.out.flush().map_err(Error::io(job.path, "write the mesh"))?;
        let written = Written { bytes: job.bytes };
        drop(job);
        let beside = match sidecar::needed(self.format) {
            true => sidecar::write(path, header, self.overwrite)?,
            false => Vec::new(),
        };
        Ok(Filled { file: self.file, beside, written })
    }
}

/// A mesh file that is whole, but for its name. Dropping it removes it.
#[derive(Debug)]
pub struct Filled {
    file: WholeFile,
    beside: Vec<WholeFile>,
    written: Written,
}

impl Filled {
    /// Gives the file, and those beside it, their names.
    ///
    /// # Errors
    /// [`Error::OutputExists`] if a file of that name has come up meanwhile; [`Error::Io`].
    pub fn finish(self) -> Result<Written> {
        self.file.finish()?;
        self.beside.into_iter().try_for_each(WholeFile::finish)?;
        Ok(self.written)
    }
}

/// [`Target::prepare`], [`Target::fill`] and [`Filled::finish`] in one.
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
    Target::prepare(path, overwrite, Positions::Shifted)?.fill(mesh, header, workers, progress)?.finish()
}

/// One file under way: what the formats share.
struct Job<'a> {
    mesh: &'a MeshSpool,
    header: &'a MeshHeader,
    workers: &'a Workers,
    out: BufWriter<&'a File>,
    path: &'a Path,
    positions: Positions,
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

    /// The header's comments, each as one line without control characters; with the reference system and the origin, if
    /// there are any, as the last.
    fn comments(&self) -> Vec<String> {
        let line = |text: &str| text.replace(|c: char| c.is_control(), " ");
        let mut lines: Vec<String> = self.header.comments.iter().map(|comment| line(comment)).collect();
        if let Some(crs) = &self.header.crs {
            lines.push(line(&format!("crs {crs}")));
            lines.extend(crs.wkt.as_ref().map(|wkt| line(&format!("wkt {wkt}"))));
        }
        if self.header.origin != [0.0; 3] && self.positions == Positions::Shifted {
            let [x, y, z] = self.header.origin;
            lines.push(format!("origin {x} {y} {z}"));
        }
        lines
    }
}
