//! A folder of tasks in an object store: what of [`WorkFolder`] is otherwise there.

use std::io;
use std::path::Path;

use super::store::Store;
use super::{JOB, WorkFolder};
use crate::error::{Error, Result};
use crate::storage::remote::{self, Place};

impl WorkFolder {
    /// Whether it lies in an object store.
    pub fn is_remote(&self) -> bool {
        remote::is_remote(&self.path)
    }

    /// [`WorkFolder::shared`]; of a folder in an object store, what has to lie on this machine goes to `local`, or else to the system's folder for temporary files.
    ///
    /// # Errors
    /// Those of [`WorkFolder::shared`].
    pub fn shared_with(path: &Path, local: Option<&Path>) -> Result<WorkFolder> {
        if !remote::is_remote(path) {
            return WorkFolder::shared(path);
        }
        let work = WorkFolder::of_objects(path, local)?;
        match work.has_begun_surely()? {
            true => Ok(work),
            false => Err(WorkFolder::no_tasks(path)),
        }
    }

    /// The folder in which a run is to be planned: that of [`WorkFolder::open`], or one in an object store, which nothing locks: whoever is the first to say what is made there
    /// decides.
    ///
    /// # Errors
    /// Those of [`WorkFolder::open`].
    pub fn to_plan(path: &Path, local: Option<&Path>) -> Result<WorkFolder> {
        if !remote::is_remote(path) {
            return WorkFolder::open(path);
        }
        let work = WorkFolder::of_objects(path, local)?;
        let other = || -> Result<bool> {
            Ok(!Place::of(path)?.below(true).map_err(Error::io(path, "read the folder"))?.is_empty())
        };
        if !work.has_begun_surely()? && other()? {
            let message = "holds other objects, but no run's; choose another `work`";
            return Err(Error::Usage(format!("{}: {message}", path.display())));
        }
        Ok(work)
    }

    fn of_objects(path: &Path, local: Option<&Path>) -> Result<WorkFolder> {
        let local = local.map_or_else(remote::local_folder, Path::to_path_buf);
        let path = path.to_str().map_or(path, |text| Path::new(text.trim_end_matches('/')));
        Ok(WorkFolder::shared_store(remote::store(path, &local)?, path))
    }

    /// Whether it is known what is made here, if that can be told.
    fn has_begun_surely(&self) -> Result<bool> {
        match self.store.open(JOB) {
            Ok(_) => Ok(true),
            Err(error) if error.kind() == io::ErrorKind::NotFound && !remote::is_of_bucket(&error) => Ok(false),
            Err(error) => Err(self.failed("open")(error)),
        }
    }
}

/// Whether bytes have to be brought where others see them, whoever is in a hurry.
pub(super) fn must_sync(store: &dyn Store, durable: bool) -> bool {
    durable || store.is_here_until_synced()
}
