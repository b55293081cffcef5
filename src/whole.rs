//! Files that appear under their name only when they are whole.

use std::fs::{File, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::error::{Error, Result};

/// What happens to a file that has the name already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Overwrite {
    /// It stays; the work is refused.
    Refuse,
    /// It is replaced, at the moment the new one is whole.
    Replace,
}

/// A file in the making, under a temporary name beside its own. Dropping it removes it.
#[derive(Debug)]
pub struct WholeFile {
    file: NamedTempFile,
    path: PathBuf,
    overwrite: Overwrite,
}

impl WholeFile {
    /// Creates the temporary file, with the permissions any new file gets.
    ///
    /// # Errors
    /// [`Error::OutputExists`]; [`Error::Io`] if the folder cannot be written to.
    pub fn create(path: &Path, overwrite: Overwrite) -> Result<WholeFile> {
        if overwrite == Overwrite::Refuse && path.exists() {
            return Err(Error::OutputExists(path.to_path_buf()));
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        folder.metadata().map_err(Error::io(folder, "open the folder"))?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let file = tempfile::Builder::new()
            .prefix(&format!(".{name}."))
            .suffix(".tmp")
            // Less the process's umask, as for any file that is created.
            .permissions(Permissions::from_mode(0o666))
            .tempfile_in(folder)
            .map_err(Error::io(path, "create a file beside"))?;
        Ok(WholeFile { file, path: path.to_path_buf(), overwrite })
    }

    /// The name it is going to have.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file, to write to.
    pub fn file(&self) -> &File {
        self.file.as_file()
    }

    /// Gives it its name.
    ///
    /// # Errors
    /// [`Error::OutputExists`] if a file of that name has come up meanwhile; [`Error::Io`].
    pub fn finish(self) -> Result<()> {
        let named = match self.overwrite {
            Overwrite::Replace => self.file.persist(&self.path),
            Overwrite::Refuse => self.file.persist_noclobber(&self.path),
        };
        named.map(drop).map_err(|refused| match refused.error.kind() {
            std::io::ErrorKind::AlreadyExists => Error::OutputExists(self.path.clone()),
            _ => Error::io(&self.path, "name the finished file")(refused.error),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn the_name_comes_last_and_nothing_else_stays() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.ply");
        let count = || std::fs::read_dir(dir.path()).unwrap().count();

        drop(WholeFile::create(&path, Overwrite::Refuse).unwrap());
        assert_eq!(count(), 0, "an abandoned file is removed");

        let whole = WholeFile::create(&path, Overwrite::Refuse).unwrap();
        whole.file().write_all(b"one").unwrap();
        assert!(!path.exists());
        whole.finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one");
        let any = dir.path().join("any");
        File::create(&any).unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&path), mode(&any), "the permissions of any new file");
        std::fs::remove_file(any).unwrap();

        assert!(matches!(WholeFile::create(&path, Overwrite::Refuse), Err(Error::OutputExists(_))));
        let whole = WholeFile::create(&path, Overwrite::Replace).unwrap();
        whole.file().write_all(b"two").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one");
        whole.finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
        assert_eq!(count(), 1);
    }

    #[test]
    fn a_file_that_came_up_meanwhile_is_kept() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.ply");
        let whole = WholeFile::create(&path, Overwrite::Refuse).unwrap();
        std::fs::write(&path, b"theirs").unwrap();
        assert!(matches!(whole.finish(), Err(Error::OutputExists(_))));
        assert_eq!(std::fs::read(&path).unwrap(), b"theirs");
    }
}
