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
mod points;
mod sidecar;
#[cfg(test)]
mod tests;
mod tiles;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::format::{glb, obj, ply, stl};
use crate::mesh::MeshHeader;
use crate::mesh::spool::MeshSpool;
use crate::resources::workers::Workers;
use crate::storage::atomic_file::{Overwrite, WholeFile};

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

/// The names of the side-cars that a mesh may have beside it, by its format.
pub fn beside(mesh: &Path) -> Vec<PathBuf> {
    match Format::from_path(mesh) {
        Ok(format) if sidecar::needed(format) => sidecar::paths(mesh).to_vec(),
        _ => Vec::new(),
    }
}

pub use attributes::constant;
pub use points::{CloudTarget, Description, FileKind};
pub use tiles::{INDEX as TILE_INDEX, MOST_TILES, Tiles, check_number as check_number_of_tiles};

/// Which coordinates vertices are written with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Positions {
    /// The mesh's own, in the input's precision, less the origin.
    Shifted,
    /// The input's: PLY and OBJ.
    Absolute,
}

impl Positions {
    /// What is chosen for a file of this name, or else what is usual: the input's own in PLY, where double precision holds them, and less the origin in
    /// formats of 32 bits, and in OBJ, which most programs read in 32 bits.
    ///
    /// # Errors
    /// [`Error::Usage`] if the format cannot hold what is chosen, or is unknown.
    pub fn of(path: &Path, chosen: Option<Positions>) -> Result<Positions> {
        let format = Format::from_path(path)?;
        match (chosen, format) {
            (Some(Positions::Absolute), Format::Stl | Format::Glb) => Err(Error::Usage(format!(
                "--coordinates input: {} has coordinates of 32 bits, which do not hold the input's own; .ply and .obj do",
                path.display()
            ))),
            (Some(chosen), _) => Ok(chosen),
            (None, Format::Ply) => Ok(Positions::Absolute),
            (None, _) => Ok(Positions::Shifted),
        }
    }
}

/// The longest comment line: readers that other programs share take 1,024 bytes for a line of PLY, or less.
const MOST_OF_A_LINE: usize = 200;
/// The most lines of a reference system's text; of one that is longer, comments have the name alone.
const MOST_WKT_LINES: usize = 64;
/// Bytes of it in a line.
const WKT_LINE: usize = 120;

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
    /// [`Error::Usage`] for an unknown extension, and absolute positions in formats of 32 bits; those of [`WholeFile::create`], also for
    /// the side-cars that the format may need.
    pub fn prepare(path: &Path, overwrite: Overwrite, positions: Positions) -> Result<Target> {
        let format = Format::from_path(path)?;
        let positions = Positions::of(path, Some(positions))?;
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
    file: WholeFile,
    beside: Vec<WholeFile>,
    /// Side-cars that must not stay.
    stale: Vec<PathBuf>,
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
        for path in self.stale.iter().filter(|path| path.symlink_metadata().is_ok_and(|there| !there.is_dir())) {
            std::fs::remove_file(path).map_err(Error::io(path, "remove the older mesh's side-car"))?;
        }
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
    Target::prepare(path, overwrite, Positions::of(path, None)?)?.fill(mesh, header, workers, progress)?.finish()
}

/// One file under way: what the formats share.
pub(crate) struct Job<'a> {
    pub(crate) mesh: &'a MeshSpool,
    pub(crate) header: &'a MeshHeader,
    pub(crate) workers: &'a Workers,
    pub(crate) out: BufWriter<&'a File>,
    pub(crate) path: &'a Path,
    pub(crate) positions: Positions,
    pub(crate) bytes: u64,
    pub(crate) elements: u64,
    pub(crate) progress: &'a mut dyn FnMut(u64),
}

impl Job<'_> {
    pub(crate) fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.out.write_all(bytes).map_err(Error::io(self.path, "write the mesh"))?;
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    /// Tells that `count` more vertices or triangles are written.
    pub(crate) fn advance(&mut self, count: u64) {
        self.elements += count;
        (self.progress)(self.elements);
    }

    /// Lets the workers make the bytes of elements `0..count`, `block` at a time, and puts them in order.
    pub(crate) fn put_blocks(
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
    pub(crate) fn comments(&self) -> Vec<String> {
        let line = |text: &str| text.replace(|c: char| c.is_control(), " ");
        let mut lines: Vec<String> = self.header.comments.iter().map(|comment| line(comment)).collect();
        if let Some(crs) = &self.header.crs {
            lines.push(line(&format!("crs {crs}")));
            lines.extend(crs.wkt.as_ref().map(|wkt| wkt_lines(&line(wkt))).unwrap_or_default());
        }
        if self.header.origin != [0.0; 3] && self.positions == Positions::Shifted {
            let [x, y, z] = self.header.origin;
            lines.push(format!("origin {x} {y} {z}"));
        }
        for line in &mut lines {
            line.truncate(boundary(line, MOST_OF_A_LINE));
        }
        lines
    }
}

/// The last place up to `at` where a text can be cut.
fn boundary(text: &str, at: usize) -> usize {
    (0..=at.min(text.len())).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0)
}

/// A reference system's text in lines that any reader takes, without the runs of blanks that some writers put in; none if it is too long.
fn wkt_lines(wkt: &str) -> Vec<String> {
    let text = wkt.split_whitespace().collect::<Vec<_>>().join(" ");
    let (mut rest, mut lines) = (text.as_str(), Vec::new());
    while !rest.is_empty() {
        let (piece, beyond) = rest.split_at(boundary(rest, WKT_LINE));
        lines.push(format!("wkt {piece}"));
        rest = beyond;
    }
    if lines.len() > MOST_WKT_LINES { Vec::new() } else { lines }
}
