//! Places in object stores, by their addresses: `s3://bucket/tiles/a.laz`, `gs://…`, `az://…`, `https://…`.
//!
//! An address goes through the program as a path, and is taken apart here alone. There are no folders, no locks and no names that are given later: an object is there, whole,
//! or it is not. So what is written lies in a file of this machine until it is whole, and is put under its name then.
//!
//! Built with the feature `object-store`; without it, an address is an error that names the feature.

#[cfg(not(feature = "object-store"))]
mod absent;
#[cfg(feature = "object-store")]
mod client;
#[cfg(feature = "object-store")]
mod errors;
#[cfg(feature = "object-store")]
pub mod store;
#[cfg(feature = "object-store")]
mod upload;

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[cfg(not(feature = "object-store"))]
pub use self::absent::Place;
#[cfg(feature = "object-store")]
pub use self::client::Place;
use crate::error::{Error, Result};
use crate::storage::work::store::Store;

/// Bytes of all transfers' buffers together, at the most.
pub const BUFFERS: u64 = 16 << 20;

/// What addresses begin with.
const SCHEMES: [&str; 10] = ["s3", "s3a", "gs", "az", "adl", "azure", "abfs", "abfss", "http", "https"];

/// Whether a path is an address in an object store.
pub fn is_remote(path: &Path) -> bool {
    let scheme = path.to_str().and_then(|text| text.split_once("://")).map(|(scheme, _)| scheme);
    scheme
        .is_some_and(|scheme| SCHEMES.contains(&scheme) || cfg!(any(test, feature = "internals")) && scheme == "memory")
}

/// The folder for files that lie on this machine on behalf of objects, unless another is named: `TMPDIR`, or else the system's.
pub fn local_folder() -> PathBuf {
    std::env::temp_dir()
}

/// What tells one state of an object from another.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Meta {
    /// Its length.
    pub bytes: u64,
    /// When it was last put there, as the store tells it.
    pub changed: String,
    /// What the store tells its states apart by.
    pub tag: Option<String>,
}

impl Meta {
    /// Whether both are of one state of an object. Requests tell times more or less exactly, so tags count where both have them.
    pub fn is_of_same(&self, other: &Meta) -> bool {
        let same = match (&self.tag, &other.tag) {
            (Some(tag), Some(other)) => tag == other,
            _ => self.changed == other.changed,
        };
        same && self.bytes == other.bytes
    }
}

impl std::fmt::Display for Meta {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} bytes of {}", self.bytes, self.changed)?;
        self.tag.iter().try_for_each(|tag| write!(f, " ({tag})"))
    }
}

/// Whether an object replaces another of its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Put {
    /// It does not: the other stays, and that is an error.
    Create,
    /// It does.
    Replace,
}

/// What an address's object is like; None if there is none.
///
/// # Errors
/// [`Error::Io`]; [`Error::Usage`] without the feature.
pub fn look(path: &Path) -> Result<Option<Meta>> {
    match Place::of(path)?.look() {
        Ok(meta) => Ok(Some(meta)),
        Err(error) if error.kind() == io::ErrorKind::NotFound && !is_of_bucket(&error) => Ok(None),
        Err(error) => Err(Error::io(path, "look at")(error)),
    }
}

/// Whether it is not the object that is missing, but the bucket.
pub(crate) fn is_of_bucket(error: &io::Error) -> bool {
    error.to_string().contains("NoSuchBucket")
}

/// Puts all of a local file under an address. What is there is whole, or what was there before.
///
/// # Errors
/// [`Error::OutputExists`] if something is there that is to stay; [`Error::Io`].
pub fn upload(file: &File, path: &Path, put: Put) -> Result<()> {
    let length = file.metadata().map_err(Error::io(path, "write"))?.len();
    Place::of(path)?.upload(file, length, put).map_err(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => Error::OutputExists(path.to_path_buf()),
        _ => Error::io(path, "write")(error),
    })
}

/// The objects below an address as the files of a folder of tasks; what has to lie on this machine goes to the folder `local`.
///
/// # Errors
/// [`Error::Usage`] if it is no address, or the store's settings are not in order.
pub fn store(path: &Path, local: &Path) -> Result<Arc<dyn Store>> {
    Place::of(path)?.store(local)
}

/// Removes an object, if it is there.
///
/// # Errors
/// [`Error::Io`].
pub fn remove(path: &Path) -> Result<()> {
    match Place::of(path)?.remove() {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(Error::io(path, "remove")(error)),
        _ => Ok(()),
    }
}
