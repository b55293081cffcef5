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
#[cfg(all(test, feature = "object-store"))]
mod tests;
#[cfg(feature = "object-store")]
mod upload;

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

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
    scheme.is_some_and(|scheme| SCHEMES.contains(&scheme) || cfg!(test) && scheme == "memory")
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

#[cfg(feature = "object-store")]
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

/// What was found where another object was expected.
#[derive(Debug)]
pub struct Changed(pub String);

impl std::fmt::Display for Changed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "it has changed meanwhile: found {}", self.0)
    }
}

impl std::error::Error for Changed {}

/// Whether an object replaces another of its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Put {
    /// It does not: the other stays, and that is an error.
    Create,
    /// It does.
    Replace,
}

/// Bytes of an object that is to be as it was noted.
///
/// # Errors
/// [`Error::Changed`] if it is not; [`Error::Io`].
pub fn read(place: &Place, path: &Path, range: Range<u64>, expected: &Meta) -> Result<Vec<u8>> {
    place.read(range, Some(expected)).map_err(|error| {
        match error.get_ref().and_then(|inner| inner.downcast_ref::<Changed>()) {
            Some(Changed(found)) => {
                Error::Changed { path: path.to_path_buf(), expected: expected.to_string(), found: found.clone() }
            }
            None => Error::io(path, "read")(error),
        }
    })
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

/// What objects are like that this process has found, by their addresses.
static NOTED: Mutex<BTreeMap<PathBuf, Meta>> = Mutex::new(BTreeMap::new());

/// Takes note of what an object is like that is going to be read: what is read then is to be the same.
pub fn note(path: &Path, meta: Meta) {
    NOTED.lock().unwrap_or_else(PoisonError::into_inner).insert(path.to_path_buf(), meta);
}

/// What was noted of an object.
pub fn noted(path: &Path) -> Option<Meta> {
    NOTED.lock().unwrap_or_else(PoisonError::into_inner).get(path).cloned()
}

/// What an object is like that is there, as it was noted, or as it is.
///
/// # Errors
/// [`Error::Io`] if there is none, or that cannot be told.
pub fn known(path: &Path) -> Result<Meta> {
    if let Some(meta) = noted(path) {
        return Ok(meta);
    }
    let meta = Place::of(path)?.look().map_err(Error::io(path, "open"))?;
    note(path, meta.clone());
    Ok(meta)
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
