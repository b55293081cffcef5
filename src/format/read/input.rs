//! What readers of meshes are given: a file by position, and the attributes that are wanted of it.

use std::fs::File;
use std::path::Path;

use crate::error::{Error, Result};
use crate::format::write::job::Format;
use crate::points::attribute::{Attribute, Schema, Wanted};
use crate::points::scalar::Scalar;
use crate::system::FileAt;

/// The wanted ones of the attributes that are there.
pub(crate) fn chosen(path: &Path, wanted: &Wanted, there: &Schema) -> Result<Schema> {
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
pub(crate) fn colours(scalar: Scalar) -> Schema {
    Schema::new(["red", "green", "blue"].map(|name| Attribute::new(name, scalar)).to_vec())
}

/// A file to read from, by position.
pub(crate) struct Input<'a> {
    pub(crate) file: File,
    pub(crate) path: &'a Path,
    pub(crate) length: u64,
}

impl<'a> Input<'a> {
    /// Opens a regular file.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(crate) fn open(path: &'a Path) -> Result<Input<'a>> {
        // Asked first: opening a pipe would wait for a writer.
        if !std::fs::metadata(path).map_err(Error::io(path, "open"))?.is_file() {
            return Err(Error::io(path, "read a mesh from")(std::io::Error::new(
                std::io::ErrorKind::InvalidInput,
                "it is not a regular file",
            )));
        }
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        let length = file.metadata().map_err(Error::io(path, "read"))?.len();
        Ok(Input { file, path, length })
    }

    /// PLY and GLB by their first bytes, all by their extension.
    pub(crate) fn format(&self) -> Result<Option<Format>> {
        let mut magic = [0; 4];
        let known = self.length.min(4) as usize;
        self.read_at(0, &mut magic[..known])?;
        Ok(match &magic {
            b"ply\n" | b"ply\r" => Some(Format::Ply),
            b"glTF" => Some(Format::Glb),
            _ => Format::from_path(self.path).ok(),
        })
    }

    pub(crate) fn read_at(&self, at: u64, out: &mut [u8]) -> Result<()> {
        self.file.read_exact_at(out, at).map_err(Error::io(self.path, "read"))
    }
}
