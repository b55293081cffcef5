//! Folders that appear under their name only when they are whole.

use std::ffi::OsString;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use super::{Overwrite, beside, reap, remove, sync_folder, synced, until_held};
use crate::error::{Error, Result};
use crate::system::{self, folder};

/// A folder in the making, beside its own place under a hidden name. Dropping it removes it and what it holds.
#[derive(Debug)]
pub struct WholeFolder {
    folder: HiddenFolder,
    /// Holds the lock.
    handle: File,
    path: PathBuf,
    overwrite: Overwrite,
}

impl WholeFolder {
    /// Creates the folder, with the permissions any new one gets.
    ///
    /// # Errors
    /// [`Error::OutputExists`]; [`Error::Io`].
    pub fn create(path: &Path, overwrite: Overwrite) -> Result<WholeFolder> {
        if overwrite == Overwrite::Refuse && path.exists() {
            return Err(Error::OutputExists(path.to_path_buf()));
        }
        reap(path);
        let made = until_held(|| {
            let folder = HiddenFolder::beside(path)?;
            let handle = system::open_folder(&folder.path)?;
            Ok((folder, handle))
        });
        let (folder, handle) = made.map_err(Error::io(path, "create a folder beside"))?;
        Ok(WholeFolder { folder, handle, path: path.to_path_buf(), overwrite })
    }

    /// Where a file of this name lies until the folder has its own. The folder remembers what it may hold.
    pub fn within(&mut self, name: &str) -> PathBuf {
        self.folder.names.push(name.into());
        self.folder.path.join(name)
    }

    /// Gives it its name, once what it holds has reached the disk. What has the name already, if it may go, goes in the same moment.
    ///
    /// # Errors
    /// [`Error::OutputExists`] if something of that name has come up meanwhile; [`Error::Io`].
    pub fn finish(self) -> Result<()> {
        let synced = synced(system::sync_all_of(&self.handle, &self.folder.path));
        synced.map_err(Error::io(&self.path, "write"))?;
        let replaced = self.name().map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists | io::ErrorKind::DirectoryNotEmpty => Error::OutputExists(self.path.clone()),
            _ => Error::io(&self.path, "name the finished folder")(error),
        })?;
        sync_folder(&self.path);
        let old = self.folder.keep();
        if replaced {
            // If that fails, it goes when the folder is made again.
            remove(&old).map_err(Error::io(&old, "remove the older folder"))?;
        }
        Ok(())
    }

    /// Whether something else lies under the hidden name now.
    fn name(&self) -> io::Result<bool> {
        let (here, there) = (&*self.folder.path, &*self.path);
        let replaces = self.overwrite == Overwrite::Replace && there.symlink_metadata().is_ok();
        let named = if replaces { system::exchange(here, there) } else { system::rename_new(here, there) };
        match named {
            Ok(()) => Ok(replaces),
            Err(error) if error.kind() == io::ErrorKind::Unsupported && replaces => {
                // In two steps; if the second fails, the first is taken back.
                let aside = here.with_extension("old");
                std::fs::rename(there, &aside)?;
                std::fs::rename(here, there).inspect_err(|_| drop(std::fs::rename(&aside, there)))?;
                std::fs::rename(&aside, here)?;
                Ok(true)
            }
            // Onto a folder that is there, this works only if that is empty.
            Err(error) if error.kind() == io::ErrorKind::Unsupported => std::fs::rename(here, there).map(|()| false),
            Err(error) => Err(error),
        }
    }
}

/// A folder under a hidden name. Dropping it removes it and what it holds.
#[derive(Debug)]
struct HiddenFolder {
    path: PathBuf,
    /// Of what it may hold: it can be removed by these even if the system refuses to list it.
    names: Vec<OsString>,
}

impl HiddenFolder {
    fn beside(path: &Path) -> io::Result<HiddenFolder> {
        let folder = beside(path, |builder, folder| {
            system::with_usual_permissions(builder, true);
            builder.tempdir_in(folder)
        })?;
        Ok(HiddenFolder { path: folder.keep(), names: Vec::new() })
    }

    /// Where it is; from now on it stays.
    fn keep(mut self) -> PathBuf {
        std::mem::take(&mut self.path)
    }
}

impl Drop for HiddenFolder {
    fn drop(&mut self) {
        if self.path.as_os_str().is_empty() {
            return;
        }
        for name in &self.names {
            let _ = std::fs::remove_file(self.path.join(name));
        }
        let _ = folder::remove(&self.path);
    }
}
