//! Without the feature there is no place in an object store.

use std::convert::Infallible;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{Meta, Put};
use crate::error::{Error, Result};
use crate::storage::work::store::Store;

/// A place in an object store: there is none.
#[derive(Debug, Clone)]
pub struct Place(Infallible);

impl Place {
    /// The place of an address.
    ///
    /// # Errors
    /// [`Error::Usage`], always.
    pub fn of(path: &Path) -> Result<Place> {
        let message = "object stores need a program that is built with the feature `object-store`";
        Err(Error::Usage(format!("{}: {message}", path.display())))
    }

    /// Its address.
    pub fn path(&self) -> PathBuf {
        match self.0 {}
    }

    /// What is there.
    ///
    /// # Errors
    /// None.
    pub fn look(&self) -> io::Result<Meta> {
        match self.0 {}
    }

    /// The objects below it.
    ///
    /// # Errors
    /// None.
    pub fn below(&self, _: bool) -> io::Result<Vec<(PathBuf, Meta)>> {
        match self.0 {}
    }

    /// Bytes of the object.
    ///
    /// # Errors
    /// None.
    pub fn read(&self, _: Range<u64>, _: Option<&Meta>) -> io::Result<Vec<u8>> {
        match self.0 {}
    }

    /// Puts a file there.
    ///
    /// # Errors
    /// None.
    pub fn upload(&self, _: &File, _: u64, _: Put) -> io::Result<()> {
        match self.0 {}
    }

    /// The objects below it as files.
    ///
    /// # Errors
    /// None.
    pub fn store(self, _: &Path) -> Result<Arc<dyn Store>> {
        match self.0 {}
    }

    /// Removes what is there.
    ///
    /// # Errors
    /// None.
    pub fn remove(&self) -> io::Result<()> {
        match self.0 {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::storage::remote::{is_remote, look};

    #[test]
    fn an_address_names_the_feature() {
        for address in ["s3://bucket/a.laz", "gs://bucket/tiles/*.laz", "https://host/a.laz"] {
            let path = Path::new(address);
            assert!(is_remote(path));
            let error = look(path).unwrap_err();
            assert!(
                matches!(&error, Error::Usage(words) if words.contains(address) && words.contains("`object-store`")),
                "{error}"
            );
        }
        assert!(!is_remote(Path::new("s3:/bucket")) && !is_remote(Path::new("/data/s3://x")));
    }
}
