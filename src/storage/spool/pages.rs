//! Pages of equal size, in a file of their own.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use super::{Backing, Workspace};
use crate::error::Result;
use crate::storage::work::store::NamedFile;

impl Workspace {
    /// A new file on disk of pages of `page` bytes each.
    ///
    /// # Errors
    /// [`Error::Io`] if no file can be created.
    pub fn page_file(&self, page: usize) -> Result<PageFile> {
        Ok(self.pages_in(Backing::Nameless(self.file()?), page, 0))
    }

    /// The same in a file of a work folder, whose first `taken` pages hold `bytes` already.
    pub fn page_file_in(&self, file: NamedFile, page: usize, (taken, bytes): (u32, u64)) -> PageFile {
        self.count(bytes);
        let pages = self.pages_in(Backing::Named(file), page, taken);
        pages.on_disk.store(bytes, Ordering::Relaxed);
        pages
    }

    fn pages_in(&self, file: Backing, page: usize, taken: u32) -> PageFile {
        let (taken, on_disk) = (AtomicU32::new(taken), AtomicU64::new(0));
        PageFile { file, workspace: self.clone(), page, taken, on_disk, checksums: Mutex::default() }
    }
}

/// Pages of equal size in an unlinked file, written and read by several threads at once.
#[derive(Debug)]
pub struct PageFile {
    workspace: Workspace,
    file: Backing,
    page: usize,
    taken: AtomicU32,
    on_disk: AtomicU64,
    /// The checksum of each page's bytes, where the file is one of a work folder.
    checksums: Mutex<Vec<u32>>,
}

impl PageFile {
    /// Puts `parts`, one behind the other, into a page of their own and returns its number.
    ///
    /// # Panics
    /// If they are more than a page holds: a bug of the caller.
    ///
    /// # Errors
    /// [`Error::Io`] if the work directory is full or fails.
    pub fn put(&self, parts: &[&[u8]]) -> Result<u32> {
        let bytes: usize = parts.iter().map(|part| part.len()).sum();
        assert!(bytes <= self.page, "more bytes than a page holds");
        let number = self.taken.fetch_add(1, Ordering::Relaxed);
        let mut at = u64::from(number) * self.page as u64;
        let mut hasher = crc32fast::Hasher::new();
        for part in parts {
            self.workspace.write(&self.file, part, at)?;
            self.on_disk.fetch_add(part.len() as u64, Ordering::Relaxed);
            at += part.len() as u64;
        }
        if let Backing::Named(_) = self.file {
            parts.iter().for_each(|part| hasher.update(part));
            let mut checksums = self.checksums.lock().unwrap_or_else(PoisonError::into_inner);
            let most = checksums.len().max(number as usize + 1);
            checksums.resize(most, 0);
            checksums[number as usize] = hasher.finalize();
        }
        Ok(number)
    }

    /// The file of a work folder that the pages lie in, if they do.
    pub fn named(&self) -> Option<&NamedFile> {
        if let Backing::Named(file) = &self.file { Some(file) } else { None }
    }

    /// Bytes of a page.
    pub fn page(&self) -> usize {
        self.page
    }

    /// The checksums of all pages, by number, of a file of a work folder.
    pub fn checksums(&self) -> Vec<u32> {
        self.checksums.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Says that page `number` is going to be read: the system begins to fetch it.
    pub fn announce(&self, number: u32) {
        self.file.will_need(u64::from(number) * self.page as u64, self.page as u64);
    }

    /// Fills `out` from byte `from` of page `number` on.
    ///
    /// # Errors
    /// [`Error::Io`] if the work directory fails.
    pub fn read(&self, number: u32, from: usize, out: &mut [u8]) -> Result<()> {
        let at = u64::from(number) * self.page as u64 + from as u64;
        self.file.read(out, at).map_err(self.workspace.failed("read temporary data"))
    }
}

impl Drop for PageFile {
    fn drop(&mut self) {
        self.workspace.on_disk.fetch_sub(*self.on_disk.get_mut(), Ordering::Relaxed);
    }
}
