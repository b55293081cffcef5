//! Whether inputs stay as they are while they are read: points or triangles of two states of a file would make a mesh of neither.

use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use crate::error::{Error, Result};
use crate::system::{self, bus};

/// What tells one state of a file from another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    length: u64,
    /// The last change of its content.
    changed: Option<SystemTime>,
    /// What tells it from other files.
    file: Option<(u64, u64)>,
}

impl Stamp {
    /// That of a regular file; `None` if there is none of that name.
    pub fn of(path: &Path) -> Option<Stamp> {
        path.metadata().ok().filter(Metadata::is_file).map(|there| Stamp {
            length: there.len(),
            changed: there.modified().ok(),
            file: system::file_number(path, &there),
        })
    }
}

/// Gives back the outcome of reading files, unless one of them is no longer as it was when its stamp was taken.
///
/// # Errors
/// [`Error::Changed`], also in the place of an error of reading, which that explains; [`Error::Io`] if the system could not read a page of one; those of
/// the outcome.
pub fn settle<'a, R>(files: impl Iterator<Item = (&'a Path, Stamp)>, outcome: Result<R>) -> Result<R> {
    if matches!(outcome, Err(Error::Interrupted | Error::Internal(_))) {
        return outcome;
    }
    for (path, before) in files {
        let found = match Stamp::of(path) {
            Some(now) if now == before => {
                if bus::lost(path) {
                    return Err(Error::io(path, "read")(system::unreadable()));
                }
                continue;
            }
            Some(now) if now.file != before.file => "another file of that name".to_owned(),
            Some(now) if now.length != before.length => format!("{} bytes", now.length),
            Some(_) => "other content: it was written to".to_owned(),
            // Whoever has read all of it does not miss it.
            None if outcome.is_ok() => continue,
            None => "none of that name".to_owned(),
        };
        let expected = format!("the file of {} bytes that was there in the first look", before.length);
        return Err(Error::Changed { path: path.to_path_buf(), expected, found });
    }
    outcome
}

/// Files that are read by one piece of work, with their stamps from before.
#[derive(Debug)]
pub struct Steady(Vec<(PathBuf, Stamp)>);

impl Steady {
    /// Looks at the files; what is none does not count.
    pub fn of<'a>(paths: impl IntoIterator<Item = &'a PathBuf>) -> Steady {
        Steady(paths.into_iter().filter_map(|path| Some((path.clone(), Stamp::of(path)?))).collect())
    }

    /// The same as [`settle`].
    ///
    /// # Errors
    /// The same as [`settle`].
    pub fn settle<R>(&self, outcome: Result<R>) -> Result<R> {
        settle(self.0.iter().map(|(path, stamp)| (path.as_path(), *stamp)), outcome)
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{self, File};

    use super::*;

    #[test]
    fn every_change_is_told_and_explains_other_errors() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        let make = || {
            fs::write(&path, "1234").unwrap();
            // Long ago, as far as clocks of file systems can tell.
            File::options().write(true).open(&path).unwrap().set_modified(SystemTime::UNIX_EPOCH).unwrap();
            Steady::of([&path])
        };
        let other = dir.path().join("b.bin");
        let changes: [(&dyn Fn(), &str); 3] = [
            (&|| fs::write(&path, "4321").unwrap(), "written to"),
            (&|| fs::write(&path, "12345").unwrap(), "found 5 bytes"),
            (&|| fs::write(&other, "1234").and_then(|()| fs::rename(&other, &path)).unwrap(), "another file"),
        ];
        for (change, words) in changes {
            let steady = make();
            assert_eq!(steady.settle(Ok(5)).unwrap(), 5);
            assert_eq!(steady.settle::<()>(Err(Error::Usage("mine".into()))).unwrap_err().to_string(), "mine");
            change();
            for outcome in [Ok(5), Err(Error::malformed(&path, "byte 3", "this", "that"))] {
                let error = steady.settle(outcome).unwrap_err();
                let text = error.to_string();
                assert!(text.contains(words) && text.contains("a.bin") && text.contains("4 bytes"), "{text}");
                assert_eq!(error.kind(), crate::error::Kind::Temporary);
            }
            assert!(matches!(steady.settle::<()>(Err(Error::Interrupted)), Err(Error::Interrupted)));
        }
        let steady = make();
        fs::remove_file(&path).unwrap();
        assert_eq!(steady.settle(Ok(5)).unwrap(), 5);
        assert!(matches!(
            steady.settle::<()>(Err(Error::NoPoints { dropped: 0, filtered: 0 })),
            Err(Error::Changed { .. })
        ));
    }
}
