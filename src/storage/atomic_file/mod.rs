//! Files that appear under their name only when they are whole.
//!
//! A file in the making has no name at all where the system can do that: then nothing is left of it however the process ends. Elsewhere, and for folders, it has
//! a hidden name beside its own, and is locked; what a process that was killed has left there, locked by nobody, goes when the next one of the same name is
//! made.

mod whole_folder;

use std::fs::{File, OpenOptions};
use std::io::{self, Seek};
use std::path::{Path, PathBuf};

use tempfile::{Builder, TempPath};

pub use self::whole_folder::WholeFolder;
use crate::error::{Error, Result};
use crate::storage::remote::{self, Put};
use crate::system::{self, Entry, EntryKind, LastWords, Lock, Naming, folder};

/// What happens to a file that has the name already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Overwrite {
    /// It stays; the work is refused.
    Refuse,
    /// It is replaced, at the moment the new one is whole.
    Replace,
}

/// A file in the making. Dropping it removes it.
#[derive(Debug)]
pub struct AtomicFile {
    file: File,
    /// Its hidden name, where it needs one.
    hidden: Option<TempPath>,
    path: PathBuf,
    overwrite: Overwrite,
    synced: bool,
    /// Whether it has its name already: a pipe or a device.
    through: bool,
    /// Whether its name is an address in an object store, where it is put when it is whole.
    remote: bool,
}

impl AtomicFile {
    /// A file without a name, which need not reach the disk before it has one.
    fn unsynced(file: File, path: PathBuf, overwrite: Overwrite) -> AtomicFile {
        AtomicFile { file, hidden: None, path, overwrite, synced: false, through: false, remote: false }
    }

    /// A report: it replaces an older one, and is written to a pipe or a device as it is.
    ///
    /// # Errors
    /// The same as [`AtomicFile::create`]; [`Error::Io`] for a pipe that nobody reads.
    pub fn report(path: &Path) -> Result<AtomicFile> {
        let through = path.metadata().is_ok_and(|there| system::is_pipe_or_device(there.file_type()));
        if !through {
            return AtomicFile::create(path, Overwrite::Replace);
        }
        let file = system::open_pipe(path).map_err(Error::io(path, "write to"))?;
        let path = path.to_path_buf();
        Ok(AtomicFile { through: true, ..AtomicFile::unsynced(file, path, Overwrite::Replace) })
    }

    /// Creates the temporary file, with the permissions any new file gets. What a link leads to is replaced, and the link stays.
    ///
    /// # Errors
    /// [`Error::OutputExists`]; [`Error::Usage`] if something of that name is no file, or a link to nothing; [`Error::Io`] if the folder cannot be written to.
    pub fn create(path: &Path, overwrite: Overwrite) -> Result<AtomicFile> {
        AtomicFile::create_with(path, overwrite, None)
    }

    /// The same; a file that is going to be an object in an object store lies in the folder `local` until it is whole, or else in the system's for temporary files.
    ///
    /// # Errors
    /// Those of [`AtomicFile::create`].
    pub fn create_with(path: &Path, overwrite: Overwrite, local: Option<&Path>) -> Result<AtomicFile> {
        if remote::is_remote(path) {
            let is_there = remote::look(path)?.is_some();
            if is_there && overwrite == Overwrite::Refuse {
                return Err(Error::OutputExists(path.to_path_buf()));
            }
            let local = local.map_or_else(remote::local_folder, Path::to_path_buf);
            let file = tempfile::tempfile_in(&local).map_err(Error::io(local, "create a temporary file"))?;
            let path = path.to_path_buf();
            return Ok(AtomicFile { remote: true, ..AtomicFile::unsynced(file, path, overwrite) });
        }
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
        let folder = folder_of(path);
        folder.metadata().map_err(Error::io(folder, "open the folder"))?;
        reap(path);
        let (file, hidden) = match nameless(folder) {
            Some(file) => (file, None),
            None => {
                let (file, hidden) = hidden(path).map_err(Error::io(path, "create a file beside"))?;
                (file, Some(hidden))
            }
        };
        Ok(AtomicFile { hidden, synced: true, ..AtomicFile::unsynced(file, path.to_path_buf(), overwrite) })
    }

    /// Creates a file in a folder of this process's own, where nothing else is and nobody looks before the folder has its name. Whoever gives it that sees to
    /// it that what it holds has reached the disk.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn within(path: &Path) -> Result<AtomicFile> {
        let file = OpenOptions::new().read(true).write(true).create_new(true).open(path);
        let file = file.map_err(Error::io(path, "create"))?;
        let hidden = Some(TempPath::try_from_path(path).map_err(Error::io(path, "create"))?);
        Ok(AtomicFile { hidden, ..AtomicFile::unsynced(file, path.to_path_buf(), Overwrite::Replace) })
    }

    /// Creates a file in a folder that never gets a name: what is written is to be read from it.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn aside(folder: &Path) -> Result<AtomicFile> {
        let file = tempfile::tempfile_in(folder).map_err(Error::io(folder, "create a temporary file"))?;
        let path = folder.to_path_buf();
        Ok(AtomicFile { through: true, ..AtomicFile::unsynced(file, path, Overwrite::Refuse) })
    }

    /// The name it is going to have.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file, to write to.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Gives it its name, once what was written has reached the disk: after a power cut, what has the name is whole.
    ///
    /// # Errors
    /// [`Error::OutputExists`] if a file of that name has come up meanwhile; [`Error::Io`].
    pub fn finish(mut self) -> Result<()> {
        if self.through {
            return Ok(());
        }
        if self.remote {
            let put = if self.overwrite == Overwrite::Refuse { Put::Create } else { Put::Replace };
            return remote::upload(&self.file, &self.path, put);
        }
        if self.synced {
            synced(self.file.sync_all()).map_err(Error::io(&self.path, "write"))?;
        }
        self.name().map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => Error::OutputExists(self.path.clone()),
            _ => Error::io(&self.path, "name the finished file")(error),
        })?;
        if self.synced {
            sync_folder(&self.path);
        }
        Ok(())
    }

    /// What writes the file if the process has to end at once.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(crate) fn last_words(&self) -> Result<LastWords> {
        // No other process has this number.
        let (prefix, suffix) = hidden_parts(&self.path);
        let number = std::process::id() % 10u32.pow(RANDOM as u32);
        let folder = if self.remote { remote::local_folder() } else { folder_of(&self.path).to_path_buf() };
        let aside = folder.join(format!("{prefix}{number:0RANDOM$}{suffix}"));
        let naming = match (self.through || self.remote, &self.hidden) {
            (true, _) => Naming::None,
            (false, Some(_)) => Naming::Rename,
            (false, None) => Naming::Link,
        };
        LastWords::new(&self.file, self.hidden.as_deref(), aside, &self.path, naming)
            .map_err(Error::io(&self.path, "create"))
    }

    fn name(&mut self) -> io::Result<()> {
        let hidden = match self.hidden.take() {
            Some(hidden) => hidden,
            None => match system::link(&self.file, &self.path) {
                Ok(()) => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                    if self.overwrite == Overwrite::Refuse {
                        return Err(error);
                    }
                    // Only a name takes a name's place at once.
                    let file = &self.file;
                    beside(&self.path, |builder, folder| builder.make_in(folder, |path| system::link(file, path)))?
                        .into_temp_path()
                }
                // The system makes files without names, and then gives them none.
                Err(_) => {
                    let (mut file, path) = hidden(&self.path)?;
                    self.file.rewind()?;
                    io::copy(&mut &self.file, &mut file)?;
                    synced(file.sync_all())?;
                    path
                }
            },
        };
        match self.overwrite {
            Overwrite::Replace => hidden.persist(&self.path),
            Overwrite::Refuse => hidden.persist_noclobber(&self.path),
        }
        .map_err(|refused| refused.error)
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Removes a file, a link, or a folder and what it holds.
fn remove(path: &Path) -> io::Result<()> {
    std::fs::remove_file(path).or_else(|file| match folder::remove(path) {
        Err(error) if error.kind() == io::ErrorKind::NotADirectory => Err(file),
        removed => removed,
    })
}

/// The parts of hidden names that are the same for all in the making of one name.
fn hidden_parts(path: &Path) -> (String, &'static str) {
    (format!(".{}.", path.file_name().unwrap_or_default().to_string_lossy()), ".tmp")
}

/// Random letters of a hidden name.
const RANDOM: usize = 6;

/// Makes what lies under a hidden name.
fn beside<R>(path: &Path, make: impl FnOnce(&mut Builder, &Path) -> R) -> R {
    let (prefix, suffix) = hidden_parts(path);
    make(Builder::new().prefix(&prefix).suffix(suffix).rand_bytes(RANDOM), folder_of(path))
}

/// A file without a name that can be given one.
fn nameless(folder: &Path) -> Option<File> {
    let file = system::nameless(folder)?;
    // For the moment in which it may have a hidden name.
    system::lock(&file);
    Some(file)
}

/// A file under a hidden name.
fn hidden(path: &Path) -> io::Result<(File, TempPath)> {
    let (name, file) = until_held(|| {
        let made = beside(path, |builder, folder| {
            system::with_usual_permissions(builder, false);
            builder.tempfile_in(folder)
        })?;
        let (file, name) = made.into_parts();
        Ok((name, file))
    })?;
    Ok((file, name))
}

/// Locks what was just made, unless the system knows no locks. False if someone else took it for a leftover before it was locked.
fn held(file: &File) -> bool {
    system::lock(file) != Lock::Taken && system::has_a_name(file)
}

/// Makes something until it is held; others that look for leftovers are not so many.
fn until_held<T>(mut make: impl FnMut() -> io::Result<(T, File)>) -> io::Result<(T, File)> {
    const TRIES: usize = 16;
    for _ in 0..TRIES {
        let (made, handle) = make()?;
        if held(&handle) {
            return Ok((made, handle));
        }
    }
    Err(io::ErrorKind::ResourceBusy.into())
}

/// Removes what processes that are no more left under hidden names of this one. Whether that works or not is no matter of this one's.
fn reap(path: &Path) {
    let (prefix, suffix) = hidden_parts(path);
    let folder = folder_of(path);
    let Ok(entries) = folder::entries(folder) else { return };
    for Entry { name, kind } in entries {
        let random = name.to_str().and_then(|name| name.strip_prefix(&prefix)?.strip_suffix(suffix));
        if !random.is_some_and(|random| random.len() == RANDOM && random.bytes().all(|b| b.is_ascii_alphanumeric())) {
            continue;
        }
        if kind == EntryKind::Other {
            continue;
        }
        let there = folder.join(name);
        let Ok(left) = system::open_leftover(&there, kind == EntryKind::Folder) else { continue };
        // Who makes it holds its lock.
        if system::lock(&left) == Lock::Held {
            let _ = remove(&there);
        }
    }
}

/// Where there is nothing to be brought to a disk, nothing failed.
fn synced(outcome: io::Result<()>) -> io::Result<()> {
    match outcome {
        Err(error) if matches!(error.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => Ok(()),
        outcome => outcome,
    }
}

/// Brings a name to the disk, if the system does such a thing: what has the name is whole in any case.
fn sync_folder(path: &Path) {
    let _ = File::open(folder_of(path)).and_then(|folder| folder.sync_all());
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn the_name_comes_last_and_nothing_else_stays() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.ply");
        let count = || std::fs::read_dir(dir.path()).unwrap().count();

        drop(AtomicFile::create(&path, Overwrite::Refuse).unwrap());
        assert_eq!(count(), 0, "an abandoned file is removed");

        let whole = AtomicFile::create(&path, Overwrite::Refuse).unwrap();
        whole.file().write_all(b"one").unwrap();
        assert!(!path.exists());
        whole.finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one");
        let any = dir.path().join("any");
        File::create(&any).unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&path), mode(&any), "the permissions of any new file");
        std::fs::remove_file(any).unwrap();

        assert!(matches!(AtomicFile::create(&path, Overwrite::Refuse), Err(Error::OutputExists(_))));
        let whole = AtomicFile::create(&path, Overwrite::Replace).unwrap();
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
        assert!(matches!(AtomicFile::create(&path("link"), Overwrite::Refuse), Err(Error::OutputExists(_))));
        let whole = AtomicFile::create(&path("link"), Overwrite::Replace).unwrap();
        whole.file().write_all(b"new").unwrap();
        whole.finish().unwrap();
        assert!(path("link").is_symlink());
        assert_eq!(std::fs::read(path("old")).unwrap(), b"new");

        std::os::unix::fs::symlink("gone", path("dangling")).unwrap();
        std::fs::create_dir(path("folder")).unwrap();
        rustix::fs::mkfifoat(rustix::fs::CWD, path("pipe"), rustix::fs::Mode::from_raw_mode(0o600)).unwrap();
        for (name, what) in [("dangling", "leads to no file"), ("folder", "is a folder"), ("pipe", "a pipe")] {
            for overwrite in [Overwrite::Refuse, Overwrite::Replace] {
                let error = AtomicFile::create(&path(name), overwrite).unwrap_err().to_string();
                assert!(error.contains(what), "{error}");
            }
        }
        assert!(AtomicFile::report(&path("pipe")).is_err(), "a pipe that nobody reads");
        assert!(path("dangling").is_symlink() && path("folder").is_dir() && !path("pipe").is_file());
        let null = AtomicFile::report(Path::new("/dev/null")).unwrap();
        null.file().write_all(b"gone").unwrap();
        null.finish().unwrap();
        assert!(!Path::new("/dev/null").is_file());
    }

    #[test]
    fn a_file_that_came_up_meanwhile_is_kept() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.ply");
        let whole = AtomicFile::create(&path, Overwrite::Refuse).unwrap();
        std::fs::write(&path, b"theirs").unwrap();
        assert!(matches!(whole.finish(), Err(Error::OutputExists(_))));
        assert_eq!(std::fs::read(&path).unwrap(), b"theirs");
    }

    /// As on a file system that makes no files without names.
    fn with_hidden_name(path: &Path, overwrite: Overwrite) -> AtomicFile {
        let (file, name) = hidden(path).unwrap();
        AtomicFile {
            file,
            hidden: Some(name),
            path: path.to_path_buf(),
            overwrite,
            synced: true,
            through: false,
            remote: false,
        }
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            folder.read_dir().unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn in_the_making_it_has_no_name_where_the_system_can() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.ply");
        let whole = AtomicFile::create(&path, Overwrite::Refuse).unwrap();
        assert_eq!(whole.hidden.is_some(), nameless(dir.path()).is_none());
        assert_eq!(names(dir.path()).len(), usize::from(whole.hidden.is_some()));
    }

    #[test]
    fn what_a_killed_process_left_goes_and_what_others_hold_stays() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.ply");
        let held_by_another = with_hidden_name(&path, Overwrite::Replace);
        let folder_of_another = WholeFolder::create(&path, Overwrite::Replace).unwrap();
        // As a kill leaves them: there, and unlocked. The others only look like it.
        let mine = [".out.ply.a1B2c3.tmp", ".out.ply.backup-of-mine.tmp", ".out.ply.tmp", ".other.ply.a1B2c3.tmp"];
        mine.iter().for_each(|name| std::fs::write(dir.path().join(name), "left").unwrap());
        std::fs::create_dir(dir.path().join(".out.ply.d4E5f6.tmp")).unwrap();
        std::fs::write(dir.path().join(".out.ply.d4E5f6.tmp/1_2.ply"), "left").unwrap();
        let before = names(dir.path());
        let whole = AtomicFile::create(&path, Overwrite::Replace).unwrap();
        let gone: Vec<String> = before.into_iter().filter(|name| !names(dir.path()).contains(name)).collect();
        assert_eq!(gone, [".out.ply.a1B2c3.tmp", ".out.ply.d4E5f6.tmp"]);
        whole.file().write_all(b"one").unwrap();
        whole.finish().unwrap();
        held_by_another.file().write_all(b"two").unwrap();
        held_by_another.finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
        drop(folder_of_another);
        assert_eq!(
            names(dir.path()),
            [".other.ply.a1B2c3.tmp", ".out.ply.backup-of-mine.tmp", ".out.ply.tmp", "out.ply"]
        );
    }

    #[test]
    fn a_hidden_name_serves_as_well_as_none() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.ply");
        for (overwrite, expected) in [(Overwrite::Refuse, "one"), (Overwrite::Replace, "two")] {
            let whole = with_hidden_name(&path, overwrite);
            whole.file().write_all(expected.as_bytes()).unwrap();
            whole.finish().unwrap();
            assert_eq!(std::fs::read_to_string(&path).unwrap(), expected);
        }
        assert!(matches!(with_hidden_name(&path, Overwrite::Refuse).finish(), Err(Error::OutputExists(_))));
        assert_eq!(names(dir.path()), ["out.ply"]);
    }

    #[test]
    fn a_folder_takes_its_place_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("city.tiles");
        let make = |overwrite, content: &str| {
            let mut folder = WholeFolder::create(&path, overwrite).unwrap();
            let file = AtomicFile::within(&folder.within("a")).unwrap();
            file.file().write_all(content.as_bytes()).unwrap();
            file.finish().unwrap();
            folder
        };
        make(Overwrite::Refuse, "one").finish().unwrap();
        assert_eq!(std::fs::read_to_string(path.join("a")).unwrap(), "one");
        make(Overwrite::Replace, "two").finish().unwrap();
        assert_eq!(std::fs::read_to_string(path.join("a")).unwrap(), "two");
        assert!(matches!(WholeFolder::create(&path, Overwrite::Refuse), Err(Error::OutputExists(_))));
        // What comes up meanwhile is kept.
        std::fs::remove_dir_all(&path).unwrap();
        let folder = make(Overwrite::Refuse, "three");
        std::fs::create_dir(&path).unwrap();
        assert!(matches!(folder.finish(), Err(Error::OutputExists(_))));
        // A file of that name is replaced, too.
        std::fs::remove_dir(&path).unwrap();
        std::fs::write(&path, "a file").unwrap();
        make(Overwrite::Replace, "four").finish().unwrap();
        assert_eq!(std::fs::read_to_string(path.join("a")).unwrap(), "four");
        assert_eq!(names(dir.path()), ["city.tiles"]);
    }

    /// Whoever always loses what it made gives up; it does not go on making.
    #[test]
    fn what_cannot_be_held_is_not_made_for_ever() {
        let dir = tempfile::tempdir().unwrap();
        let mut made = 0;
        let outcome = until_held(|| {
            made += 1;
            let file = File::create(dir.path().join("gone"))?;
            std::fs::remove_file(dir.path().join("gone"))?;
            Ok(((), file))
        });
        assert_eq!((outcome.unwrap_err().kind(), made), (io::ErrorKind::ResourceBusy, 16));
    }
}
