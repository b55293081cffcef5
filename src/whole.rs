//! Files that appear under their name only when they are whole.

use std::fs::{File, Permissions};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
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
    file: Making,
    path: PathBuf,
    overwrite: Overwrite,
}

/// Where the bytes go meanwhile.
#[derive(Debug)]
enum Making {
    /// To a temporary file.
    Aside(NamedTempFile),
    /// To where they are to be: a pipe or a device.
    Through(File),
}

impl WholeFile {
    /// A report: it replaces an older one, and is written to a pipe or a device as it is.
    ///
    /// # Errors
    /// As [`WholeFile::create`]; [`Error::Io`] for a pipe that nobody reads.
    pub fn report(path: &Path) -> Result<WholeFile> {
        use std::os::unix::fs::FileTypeExt;
        let through =
            path.metadata().is_ok_and(|there| there.file_type().is_fifo() || there.file_type().is_char_device());
        if !through {
            return WholeFile::create(path, Overwrite::Replace);
        }
        // Opening a pipe must not wait for a reader; writing to it may.
        let flags = rustix::fs::OFlags::NONBLOCK.bits() as i32;
        let open = || -> std::io::Result<File> {
            let file = File::options().write(true).custom_flags(flags).open(path)?;
            let set = rustix::fs::fcntl_getfl(&file)?;
            rustix::fs::fcntl_setfl(&file, set - rustix::fs::OFlags::NONBLOCK)?;
            Ok(file)
        };
        let file = Making::Through(open().map_err(Error::io(path, "write to"))?);
        Ok(WholeFile { file, path: path.to_path_buf(), overwrite: Overwrite::Replace })
    }

    /// Creates the temporary file, with the permissions any new file gets. What a link leads to is replaced, and the link stays.
    ///
    /// # Errors
    /// [`Error::OutputExists`]; [`Error::Usage`] if something of that name is no file, or a link to nothing; [`Error::Io`] if the folder cannot be written to.
    pub fn create(path: &Path, overwrite: Overwrite) -> Result<WholeFile> {
        let linked;
        let mut path = path;
        if let Ok(there) = path.symlink_metadata() {
            let refused = |what: &str| Err(Error::Usage(format!("{}: {what}; choose another name", path.display())));
            let Ok(metadata) = path.metadata() else { return refused("is a link that leads to no file") };
            if metadata.is_dir() {
                return refused("is a folder");
            }
            if !metadata.is_file() {
                return refused("is no regular file, but a device, a pipe or a socket");
            }
            if overwrite == Overwrite::Refuse {
                return Err(Error::OutputExists(path.to_path_buf()));
            }
            if there.is_symlink() {
                linked = path.canonicalize().map_err(Error::io(path, "follow the link"))?;
                path = &linked;
            }
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
        Ok(WholeFile { file: Making::Aside(file), path: path.to_path_buf(), overwrite })
    }

    /// The name it is going to have.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file, to write to.
    pub fn file(&self) -> &File {
        match &self.file {
            Making::Aside(file) => file.as_file(),
            Making::Through(file) => file,
        }
    }

    /// Gives it its name.
    ///
    /// # Errors
    /// [`Error::OutputExists`] if a file of that name has come up meanwhile; [`Error::Io`].
    pub fn finish(self) -> Result<()> {
        let Making::Aside(file) = self.file else { return Ok(()) };
        let named = match self.overwrite {
            Overwrite::Replace => file.persist(&self.path),
            Overwrite::Refuse => file.persist_noclobber(&self.path),
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
    fn a_link_stays_and_what_is_no_file_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        std::fs::write(path("old"), b"old").unwrap();
        std::os::unix::fs::symlink("old", path("link")).unwrap();
        assert!(matches!(WholeFile::create(&path("link"), Overwrite::Refuse), Err(Error::OutputExists(_))));
        let whole = WholeFile::create(&path("link"), Overwrite::Replace).unwrap();
        whole.file().write_all(b"new").unwrap();
        whole.finish().unwrap();
        assert!(path("link").is_symlink());
        assert_eq!(std::fs::read(path("old")).unwrap(), b"new");

        std::os::unix::fs::symlink("gone", path("dangling")).unwrap();
        std::fs::create_dir(path("folder")).unwrap();
        rustix::fs::mkfifoat(rustix::fs::CWD, path("pipe"), rustix::fs::Mode::from_raw_mode(0o600)).unwrap();
        for (name, what) in [("dangling", "leads to no file"), ("folder", "is a folder"), ("pipe", "a pipe")] {
            for overwrite in [Overwrite::Refuse, Overwrite::Replace] {
                let error = WholeFile::create(&path(name), overwrite).unwrap_err().to_string();
                assert!(error.contains(what), "{error}");
            }
        }
        assert!(WholeFile::report(&path("pipe")).is_err(), "a pipe that nobody reads");
        assert!(path("dangling").is_symlink() && path("folder").is_dir() && !path("pipe").is_file());
        let null = WholeFile::report(Path::new("/dev/null")).unwrap();
        null.file().write_all(b"gone").unwrap();
        null.finish().unwrap();
        assert!(!Path::new("/dev/null").is_file());
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
