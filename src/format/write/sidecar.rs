//! Side-cars of meshes in formats that have no room for where they lie: `city.prj` and `city_offset.xyz` beside `city.obj`.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::job::{Format, Positions};
use crate::error::{Error, Result};
use crate::mesh::MeshHeader;
use crate::points::crs::Crs;
use crate::storage::atomic_file::{AtomicFile, Overwrite};
use crate::storage::remote::{is_remote, look};

/// The names of the side-cars of a mesh: of its reference system, and of its origin. Other programs look for these.
pub fn paths(mesh: &Path) -> [PathBuf; 2] {
    let stem = mesh.file_stem().unwrap_or_default().to_string_lossy();
    [mesh.with_extension("prj"), mesh.with_file_name(format!("{stem}_offset.xyz"))]
}

/// Whether a format needs side-cars.
pub fn needed(format: Format) -> bool {
    matches!(format, Format::Obj | Format::Stl)
}

/// A side-car of a mesh that is there already.
///
/// # Errors
/// [`Error::Io`], in an object store.
pub fn any_there(mesh: &Path) -> Result<Option<PathBuf>> {
    for path in paths(mesh) {
        if if is_remote(&path) { look(&path)?.is_some() } else { path.exists() } {
            return Ok(Some(path));
        }
    }
    Ok(None)
}

/// Writes what there is to tell, and gives back the files, whole but for their names.
///
/// # Errors
/// [`Error::OutputExists`]; [`Error::Io`].
pub fn write(mesh: &Path, header: &MeshHeader, positions: Positions, overwrite: Overwrite) -> Result<Vec<AtomicFile>> {
    let [prj, offset] = paths(mesh);
    let [x, y, z] = header.origin;
    let place = (header.origin != [0.0; 3] && positions == Positions::Shifted).then(|| format!("{x} {y} {z}\n"));
    let texts = [(prj, header.crs.as_ref().map(projection)), (offset, place)];
    let mut files = Vec::new();
    for (path, text) in texts {
        if let Some(text) = text {
            let file = AtomicFile::create(&path, overwrite)?;
            file.file().write_all(text.as_bytes()).map_err(Error::io(&path, "write"))?;
            files.push(file);
        }
    }
    Ok(files)
}

/// The well-known text, if the input has it, or else the name.
fn projection(crs: &Crs) -> String {
    match &crs.wkt {
        Some(wkt) => format!("{wkt}\n"),
        None => format!("{crs}\n"),
    }
}
