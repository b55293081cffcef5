//! Other programs' meshes, opened for reading piece by piece.
//!
//! A binary little-endian PLY file of triangles is read in place. Everything else is converted to a
//! [`MeshSpool`](crate::mesh::spool::MeshSpool) in one pass: polygons become fans of triangles, STL corners of equal position become one vertex. Whatever a
//! header promises is believed only as far as the file's length bears it out.

pub(crate) mod convert;
pub(crate) mod input;
#[cfg(test)]
mod tests;
pub(crate) mod text;
pub(crate) mod weld;

use std::path::Path;

use self::input::{Input, chosen};
use crate::error::{Error, Result};
use crate::format::write::Format;
use crate::format::{glb, obj, ply, stl};
use crate::mesh::MeshSource;
use crate::points::attribute::{Schema, Wanted};
use crate::points::crs::Crs;
use crate::storage::spool::Workspace;

/// Opens a mesh: PLY and GLB by their first bytes, STL and OBJ by their extension.
///
/// A mesh that has to be converted keeps up to `in_memory` bytes in memory and the rest in the workspace; converting takes
/// about as much again.
///
/// # Errors
/// [`Error::Io`]; [`Error::Malformed`] if the content is not what the format promises, then or later when a triangle
/// with a vertex number out of range is read; [`Error::ForeignFormat`] for a compressed GLB; [`Error::TooManyElements`];
/// [`Error::Usage`] for an unknown kind of file.
pub fn open(path: &Path, workspace: &Workspace, in_memory: u64) -> Result<Box<dyn MeshSource>> {
    open_with(path, workspace, in_memory, &Wanted::None)
}

/// [`open`], with attributes of vertices: numbers of PLY by their names, colours of OBJ, `COLOR_0` and `_NAME` of GLB. A mesh that is read in place has all of its
/// attributes, whatever is wanted.
///
/// # Errors
/// The same as [`open`]; [`Error::Usage`] if the mesh lacks one that is wanted by name: it lists those that are there.
pub fn open_with(path: &Path, workspace: &Workspace, in_memory: u64, wanted: &Wanted) -> Result<Box<dyn MeshSource>> {
    let input = Input::open(path)?;
    match input.format()? {
        Some(Format::Ply) => ply::mesh::open(input, workspace, in_memory, wanted),
        Some(Format::Glb) => Ok(Box::new(glb::mesh::read(&input, workspace, in_memory, wanted)?)),
        Some(Format::Stl) => {
            chosen(path, wanted, &Schema::default())?;
            Ok(Box::new(stl::mesh::read(&input, workspace, in_memory)?))
        }
        Some(Format::Obj) => Ok(Box::new(obj::mesh::read(&input, workspace, in_memory, wanted)?)),
        None => Err(Error::Usage(format!("{}: not a mesh that can be read: .ply, .stl, .obj or .glb", path.display()))),
    }
}

/// Whether a file holds triangles: PLY with faces, OBJ with any, STL and GLB by what they are. What is none of these, or compressed, does not.
///
/// # Errors
/// [`Error::Io`]; [`Error::Malformed`] for the header of a PLY file.
pub fn has_triangles(path: &Path) -> Result<bool> {
    if path.is_dir() || !path.exists() {
        // A folder or a pattern of point files; whoever opens it says what is wrong.
        return Ok(false);
    }
    let input = Input::open(path)?;
    match input.format()? {
        Some(Format::Ply) => ply::mesh::has_faces(&input),
        Some(Format::Obj) => obj::mesh::has_faces(&input),
        Some(Format::Stl | Format::Glb) => Ok(true),
        None => Ok(false),
    }
}

/// The longest header, or side-car, that is looked at for what it tells.
const LONGEST: u64 = 1 << 20;

/// The reference system of a mesh, as far as the file tells: a PLY file in its comments, and a GLB file in its node, as this program writes them, others in a `.prj` beside. What cannot be read
/// tells nothing; whoever opens it says why.
pub fn told_crs(path: &Path) -> Option<Crs> {
    let input = Input::open(path).ok()?;
    let beside = path.with_extension("prj");
    let format = input.format().ok()??;
    if let Some(crs) = (format == Format::Glb).then(|| glb::mesh::told_crs(&input)).flatten() {
        return Some(crs);
    }
    if format != Format::Ply {
        let is_short = beside.metadata().is_ok_and(|there| there.is_file() && there.len() <= LONGEST);
        return is_short.then(|| named(&std::fs::read_to_string(&beside).ok()?))?;
    }
    let (mut name, mut wkt) = (None, String::new());
    for comment in comments(&input)? {
        if let Some(rest) = comment.strip_prefix("wkt ") {
            wkt += rest;
        } else if let Some(rest) = comment.strip_prefix("crs ") {
            name = name.or(Some(rest.to_owned()));
        }
    }
    Crs::parse(&wkt).filter(|crs| crs.wkt.is_some()).or_else(|| named(&name?))
}

/// The side of the cells that a mesh was made with, where a PLY file tells, as this program writes it.
pub fn told_cell_size(path: &Path) -> Option<f64> {
    let input = Input::open(path).ok()?;
    if input.format().ok()?? != Format::Ply {
        return None;
    }
    let told = comments(&input)?.into_iter().find_map(|comment| {
        let number = comment.strip_prefix("cell_size ")?.split(' ').next()?.to_owned();
        number.parse::<f64>().ok()
    });
    told.filter(|side| *side > 0.0 && side.is_finite())
}

/// The comments of a PLY header.
fn comments(input: &Input) -> Option<Vec<String>> {
    let mut head = vec![0; input.length.min(LONGEST) as usize];
    input.read_at(0, &mut head).ok()?;
    let lines = head.split(|byte| *byte == b'\n').take_while(|line| line.trim_ascii() != b"end_header");
    let comments = lines.filter_map(|line| line.strip_prefix(b"comment "));
    Some(comments.map(|comment| String::from_utf8_lossy(comment).into_owned()).collect())
}

/// A system as this program writes it: its text, or its code, behind which its name stands.
fn named(text: &str) -> Option<Crs> {
    let code = text.split([' ', ',']).next().unwrap_or_default();
    Crs::parse(code).filter(|crs| crs.epsg.is_some()).or_else(|| Crs::parse(text))
}
