//! What is in a folder, and how one is removed.
//!
//! The standard library panics if the system cannot close a folder that was listed, as happens where a disk or a network fails. Here everything that fails is an
//! error, and closing is no matter: what was listed was listed.

use std::ffi::OsStr;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use rustix::fs::{AtFlags, CWD, Dir, FileType, Mode, OFlags, openat, statat, unlinkat};
use rustix::io::retry_on_intr;

use super::answers::{Entry, EntryKind};

/// What is in a folder, in the system's order, without the folder itself and the one above.
///
/// # Errors
/// What the system says.
pub fn entries(folder: &Path) -> io::Result<Vec<Entry>> {
    // A listing that a signal interrupts is begun anew.
    let list = || listed(&opened(CWD, folder.as_os_str(), OFlags::empty())?);
    Ok(retry_on_intr(list)?)
}

/// Removes a folder and what it holds. Links in it are removed, not what they lead to.
///
/// # Errors
/// What the system says; [`io::ErrorKind::NotADirectory`] if it is none.
pub fn remove(folder: &Path) -> io::Result<()> {
    Ok(remove_in(CWD, folder.as_os_str())?)
}

fn opened(parent: BorrowedFd, name: &OsStr, more: OFlags) -> rustix::io::Result<OwnedFd> {
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC | more;
    retry_on_intr(|| openat(parent, name, flags, Mode::empty()))
}

fn listed(folder: &OwnedFd) -> rustix::io::Result<Vec<Entry>> {
    let mut entries = Vec::new();
    for entry in Dir::read_from(folder)? {
        let entry = entry?;
        let name = OsStr::from_bytes(entry.file_name().to_bytes());
        if name == "." || name == ".." {
            continue;
        }
        let kind = match entry.file_type() {
            // Some file systems do not tell it here.
            FileType::Unknown => FileType::from_raw_mode(statat(folder, name, AtFlags::SYMLINK_NOFOLLOW)?.st_mode),
            kind => kind,
        };
        let kind = match kind {
            FileType::RegularFile => EntryKind::File,
            FileType::Directory => EntryKind::Folder,
            _ => EntryKind::Other,
        };
        entries.push(Entry { name: name.to_owned(), kind });
    }
    Ok(entries)
}

/// Each folder is opened where it was found, so that nobody can put a link in its place meanwhile.
fn remove_in(parent: BorrowedFd, name: &OsStr) -> rustix::io::Result<()> {
    // One that is empty needs no look into it.
    if unlinkat(parent, name, AtFlags::REMOVEDIR).is_ok() {
        return Ok(());
    }
    let folder = opened(parent, name, OFlags::NOFOLLOW)?;
    for entry in retry_on_intr(|| listed(&folder))? {
        match entry.kind {
            EntryKind::Folder => remove_in(folder.as_fd(), &entry.name)?,
            _ => unlinkat(&folder, &entry.name, AtFlags::empty())?,
        }
    }
    unlinkat(parent, name, AtFlags::REMOVEDIR)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_listed_and_removed_but_not_what_links_lead_to() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        std::fs::create_dir_all(path("a/b/c")).unwrap();
        for file in ["kept", "a/1", "a/b/2", "a/b/c/3"] {
            std::fs::write(path(file), file).unwrap();
        }
        std::fs::create_dir(path("other")).unwrap();
        std::os::unix::fs::symlink(path("kept"), path("a/link")).unwrap();
        std::os::unix::fs::symlink(path("other"), path("a/b/link")).unwrap();

        let mut found = entries(&path("a")).unwrap();
        found.sort_by(|a, b| a.name.cmp(&b.name));
        let found: Vec<_> = found.iter().map(|entry| (entry.name.to_str().unwrap(), entry.kind)).collect();
        assert_eq!(
            found,
            [("1", EntryKind::File), ("b", EntryKind::Folder), ("link", EntryKind::Other)],
            "without the folder itself and the one above"
        );

        remove(&path("a")).unwrap();
        assert!(!path("a").exists() && path("kept").is_file() && path("other").is_dir());
        assert_eq!(entries(&path("a")).unwrap_err().kind(), io::ErrorKind::NotFound);
        for none in [entries(&path("kept")).unwrap_err(), remove(&path("kept")).unwrap_err()] {
            assert_eq!(none.kind(), io::ErrorKind::NotADirectory);
        }
        std::os::unix::fs::symlink(path("other"), path("link")).unwrap();
        assert!(remove(&path("link")).is_err() && path("other").is_dir(), "a link is no folder to remove");
    }
}
