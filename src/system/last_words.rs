//! A file that is written where nothing may take memory or wait for a lock: in the handler of a signal.

use std::ffi::CString;
use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use rustix::fs::{AtFlags, CWD, linkat, renameat};
use rustix::io::Errno;

use super::answers::Naming;

/// Writes a file in the making and gives it its name.
#[derive(Debug)]
pub struct LastWords {
    file: File,
    /// Where it is now.
    from: CString,
    /// A hidden name, if it has to replace an older file.
    aside: CString,
    path: CString,
    naming: Naming,
}

impl LastWords {
    /// For a file that lies at `hidden`, unless it has no name, and is to lie at `path`; `aside` is a name that nothing has.
    ///
    /// # Errors
    /// What the system says of another handle; a name that holds a zero.
    pub fn new(
        file: &File,
        hidden: Option<&Path>,
        aside: PathBuf,
        path: &Path,
        naming: Naming,
    ) -> io::Result<LastWords> {
        let file = file.try_clone()?;
        let number = PathBuf::from(format!("/proc/self/fd/{}", file.as_raw_fd()));
        let from = c_string(hidden.unwrap_or(&number))?;
        Ok(LastWords { file, from, aside: c_string(&aside)?, path: c_string(path)?, naming })
    }

    /// Writes the file. Whatever fails here, there is nobody left to tell.
    pub fn say(&self, text: &[u8]) {
        let mut rest = text;
        while !rest.is_empty() {
            match rustix::io::write(&self.file, rest) {
                Ok(written) if written > 0 => rest = &rest[written..],
                Err(Errno::INTR) => {}
                _ => return,
            }
        }
        let (from, aside, path) = (&*self.from, &*self.aside, &*self.path);
        let link = |to| linkat(CWD, from, CWD, to, AtFlags::SYMLINK_FOLLOW).is_ok();
        let _ = match self.naming {
            Naming::None => Ok(()),
            Naming::Rename => renameat(CWD, from, CWD, path),
            Naming::Link if link(path) || !link(aside) => Ok(()),
            // Only a name takes a name's place at once.
            Naming::Link => renameat(CWD, aside, CWD, path),
        };
    }
}

fn c_string(path: &Path) -> io::Result<CString> {
    Ok(CString::new(path.as_os_str().as_bytes())?)
}
