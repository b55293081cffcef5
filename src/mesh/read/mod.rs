//! Other programs' meshes, opened for reading piece by piece.
//!
//! A binary little-endian PLY file of triangles is read in place. Everything else is converted to a
//! [`MeshSpool`](super::spool::MeshSpool) in one pass: polygons become fans of triangles, STL corners of equal position become one vertex. Whatever a
//! header promises is believed only as far as the file's length bears it out.

mod convert;
mod glb;
mod obj;
mod ply;
mod ply_header;
mod stl;
#[cfg(test)]
mod tests;
mod text;
mod weld;

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

use super::MeshSource;
use crate::attribute::{Attribute, Schema, Wanted};
use crate::error::{Error, Result};
use crate::scalar::Scalar;
use crate::spool::Workspace;

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
/// As [`open`]; [`Error::Usage`] if the mesh lacks one that is wanted by name: it lists those that are there.
pub fn open_with(path: &Path, workspace: &Workspace, in_memory: u64, wanted: &Wanted) -> Result<Box<dyn MeshSource>> {
    let file = File::open(path).map_err(Error::io(path, "open"))?;
    let length = file.metadata().map_err(Error::io(path, "read"))?.len();
    let input = Input { file, path, length };
    let mut magic = [0; 4];
    let known = length.min(4) as usize;
    input.read_at(0, &mut magic[..known])?;
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match (&magic, extension.as_deref()) {
        (b"ply\n" | b"ply\r", _) | (_, Some("ply")) => ply::open(input, workspace, in_memory, wanted),
        (b"glTF", _) | (_, Some("glb")) => Ok(Box::new(glb::read(&input, workspace, in_memory, wanted)?)),
        (_, Some("stl")) => {
            chosen(path, wanted, &Schema::default())?;
            Ok(Box::new(stl::read(&input, workspace, in_memory)?))
        }
        (_, Some("obj")) => Ok(Box::new(obj::read(&input, workspace, in_memory, wanted)?)),
        _ => Err(Error::Usage(format!("{}: not a mesh that can be read: .ply, .stl, .obj or .glb", path.display()))),
    }
}

/// Of the attributes that are there, those that are wanted.
fn chosen(path: &Path, wanted: &Wanted, there: &Schema) -> Result<Schema> {
    let find = |name: &String| -> Result<Attribute> {
        let found = there.attributes().iter().find(|attribute| attribute.name == *name);
        found.cloned().ok_or_else(|| Error::Usage(format!("{}: {}", path.display(), there.lacks(name))))
    };
    match wanted {
        Wanted::None => Ok(Schema::default()),
        Wanted::All => Ok(there.clone()),
        Wanted::Named(names) => Ok(Schema::new(names.iter().map(find).collect::<Result<_>>()?)),
    }
}

/// Colours, where the format knows them without names.
fn colours(scalar: Scalar) -> Schema {
    Schema::new(["red", "green", "blue"].map(|name| Attribute::new(name, scalar)).to_vec())
}

/// A file to read from, by position.
struct Input<'a> {
    file: File,
    path: &'a Path,
    length: u64,
}

impl Input<'_> {
    fn read_at(&self, at: u64, out: &mut [u8]) -> Result<()> {
        self.file.read_exact_at(out, at).map_err(Error::io(self.path, "read"))
    }
}
