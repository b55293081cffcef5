//! A mesh file under way: its format, its coordinates, and what the formats share.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::error::{Error, Result};
use crate::mesh::MeshHeader;
use crate::mesh::spool::MeshSpool;
use crate::resources::workers::Workers;

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

/// Which coordinates vertices are written with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
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
    /// [`Error::InvalidSetting`] if the format cannot hold what is chosen; [`Error::Usage`] if it is unknown.
    pub fn of(path: &Path, chosen: Option<Positions>) -> Result<Positions> {
        let format = Format::from_path(path)?;
        match (chosen, format) {
            (Some(Positions::Absolute), Format::Stl | Format::Glb) => Err(Error::setting(
                "coordinates",
                format!(
                    "`coordinates` input: {} has coordinates of 32 bits, which do not hold the input's own; .ply and .obj do",
                    path.display()
                ),
            )),
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
