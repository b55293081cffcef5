//! How objects come here: into the temporary file that unpacking uses, whole or with holes.

use std::path::Path;

use crate::error::Result;
use crate::format::las::partial::{self, Choice};
use crate::format::options::InputOptions;
use crate::format::unpack::Unpacking;
use crate::storage::mapped::Content;
use crate::storage::remote::{self, Place};

/// An object's bytes: all of them, or, where only points in a box count, those that tell what the file is and those of points that may lie in the box.
///
/// # Errors
/// [`crate::Error::Changed`] if the object is not as it was found; [`crate::Error::Io`]; those of [`Unpacking::fetch`].
pub fn fetched(path: &Path, options: &InputOptions, unpacking: &mut Unpacking) -> Result<Content> {
    let (place, meta) = (Place::of(path)?, remote::known(path)?);
    let read = |range| remote::read(&place, path, range, &meta);
    let sparse = unpacking.sparse(meta.bytes)?;
    let content = sparse.content(path);
    let Some(bounds) = options.filter.bounds.filter(|_| options.skip_bytes.is_none()) else {
        unpacking.fetch(&sparse, std::slice::from_ref(&(0..meta.bytes)), &read)?;
        return Ok(content);
    };
    let mut fetch = |range| unpacking.fetch(&sparse, std::slice::from_ref(&range), &read).map(drop);
    match partial::choose(&content, &bounds, &mut fetch)? {
        Choice::Whole { there } => {
            unpacking.fetch(&sparse, std::slice::from_ref(&(there..meta.bytes)), &read)?;
            Ok(content)
        }
        Choice::Part { absent, wanted } => {
            unpacking.fetch(&sparse, &wanted, &read)?;
            Ok(content.without(absent))
        }
    }
}
