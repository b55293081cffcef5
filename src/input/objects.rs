//! What addresses in object stores stand for.
//!
//! They are taken as paths are: `s3://bucket/tiles/a.laz` is an object, `s3://bucket/tiles/*.laz` a pattern, and `s3://bucket/tiles/` all point clouds in that folder.

use std::path::{Path, PathBuf};

use glob::{MatchOptions, Pattern};

use crate::error::{Error, Result};
use crate::format::options::Depth;
use crate::storage::remote::{self, Meta, Place};

/// Bytes of an object that are looked at to tell whether it is a mesh of this program.
const HEAD: u64 = 64 << 10;

/// What an address stands for.
pub enum Stands {
    /// An object of that name.
    One(Meta),
    /// The objects that a pattern matches, by their names.
    Matching(Vec<(PathBuf, Meta)>),
    /// The objects in a folder, by their names, but for hidden ones.
    In(Vec<(PathBuf, Meta)>),
}

/// Finds out what an address stands for.
///
/// # Errors
/// [`Error::Io`]; [`Error::Usage`].
pub fn stands_for(input: &Path, depth: Depth) -> Result<Stands> {
    let text = input.to_string_lossy();
    if let Some(wild) = text.find(['*', '?', '[']) {
        let (folder, rest) = text.split_at(text[..wild].rfind('/').map_or(0, |slash| slash + 1));
        return matching(Path::new(folder), rest).map(Stands::Matching);
    }
    if !text.ends_with('/')
        && let Some(meta) = remote::look(input)?
    {
        return Ok(Stands::One(meta));
    }
    let place = Place::of(input)?;
    let within = place.path();
    let mut found = place.below(depth == Depth::Recursive).map_err(Error::io(input, "list"))?;
    found.retain(|(path, _)| {
        let name = path.strip_prefix(&within).unwrap_or(path);
        !name.components().any(|part| part.as_os_str().as_encoded_bytes().starts_with(b"."))
    });
    Ok(Stands::In(found))
}

/// The objects below a folder that a pattern matches from there on.
fn matching(folder: &Path, pattern: &str) -> Result<Vec<(PathBuf, Meta)>> {
    const LIKE_A_SHELL: MatchOptions =
        MatchOptions { case_sensitive: true, require_literal_separator: true, require_literal_leading_dot: true };
    let word = Pattern::new(pattern).map_err(|e| Error::Usage(format!("{pattern}: not a valid pattern: {e}")))?;
    let place = Place::of(folder)?;
    // As it is told of objects, whose addresses may be written in more than one way.
    let within = place.path();
    let mut found = place.below(pattern.contains('/')).map_err(Error::io(folder, "list"))?;
    found.retain(|(path, _)| {
        let name = path.strip_prefix(&within).unwrap_or(path).to_string_lossy();
        word.matches_with(&name, LIKE_A_SHELL)
    });
    Ok(found)
}

/// The first bytes of an object.
///
/// # Errors
/// [`Error::Io`], [`Error::Changed`].
pub fn head(path: &Path, meta: &Meta) -> Result<Vec<u8>> {
    remote::read(&Place::of(path)?, path, 0..meta.bytes.min(HEAD), meta)
}
