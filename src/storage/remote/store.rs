//! A folder of tasks that lies in an object store.
//!
//! ```text
//!   create, write ──► a nameless file here ──sync──► an object ──link──► an object of that name, if there is none
//!   open, read    ◄── blocks of a nameless file here ◄── stretches of an object, as they are asked for
//! ```
//!
//! What is read stays in a file without a name, so that nothing is fetched twice; where this machine's disk is full, it is only handed on. Objects do not change once they are there.

use std::collections::HashMap;
use std::fmt;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use super::client::Place;
use super::{Meta, Put};
use crate::error::Result;
use crate::storage::work::store::{Store, StoredFile};
use crate::system::FileAt;

/// Bytes that are fetched at the least.
const BLOCK: u64 = 256 << 10;

/// Blocks of one request at the most, when one stretch follows another.
const MOST_BLOCKS: u64 = 16;

/// The most bytes of an object that is not in the folder of data: a manifest, or the job.
const MOST: u64 = 64 << 20;

/// The folder of what is fetched in pieces.
const DATA: &str = "data/";

/// Objects below a place as the files of a folder.
#[derive(Debug)]
pub struct Objects {
    place: Place,
    /// Where files lie that objects are made of, and what was fetched.
    local: PathBuf,
    /// Files that are being made, by their names.
    made: Mutex<HashMap<String, Weak<Made>>>,
}

impl Place {
    /// The objects below it as the files of a folder; what has to lie on this machine goes to the folder `local`.
    ///
    /// # Errors
    /// None.
    pub fn store(self, local: &Path) -> Result<Arc<dyn Store>> {
        Ok(Arc::new(Objects { place: self, local: local.to_path_buf(), made: Mutex::default() }))
    }
}

impl Objects {
    fn made(&self) -> MutexGuard<'_, HashMap<String, Weak<Made>>> {
        self.made.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The file of a name that is being made here.
    fn made_as(&self, name: &str) -> Option<Arc<Made>> {
        self.made().get(name).and_then(Weak::upgrade)
    }

    /// All of what has a name.
    fn bytes_of(&self, name: &str) -> io::Result<Vec<u8>> {
        match self.made_as(name) {
            Some(made) => made.bytes(),
            None => self.place.within(name)?.whole(MOST),
        }
    }
}

impl Store for Objects {
    fn create(&self, name: &str) -> io::Result<Arc<dyn StoredFile>> {
        let place = self.place.within(name)?;
        let made = Arc::new(Made { file: tempfile::tempfile_in(&self.local)?, place, put: Mutex::new(false) });
        let mut all = self.made();
        all.retain(|_, made| made.strong_count() > 0);
        if all.contains_key(name) {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        all.insert(name.to_owned(), Arc::downgrade(&made));
        Ok(made)
    }

    fn open(&self, name: &str) -> io::Result<Arc<dyn StoredFile>> {
        if let Some(made) = self.made_as(name) {
            return Ok(made);
        }
        let place = self.place.within(name)?;
        if !name.starts_with(DATA) {
            return Ok(Arc::new(Held(place.whole(MOST)?)));
        }
        let meta = place.look()?;
        let blocks = usize::try_from(meta.bytes.div_ceil(BLOCK)).map_err(|_| io::ErrorKind::FileTooLarge)?;
        let fetched = Fetched { there: vec![0; blocks.div_ceil(64)], file: None, next: 0, ahead: 1 };
        Ok(Arc::new(Opened { place, meta, local: self.local.clone(), fetched: Mutex::new(fetched) }))
    }

    fn link(&self, name: &str, second: &str) -> io::Result<()> {
        self.place.within(second)?.put(&self.bytes_of(name)?, Put::Create)
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        let made = self.made().remove(name).and_then(|made| made.upgrade());
        if made.is_some_and(|made| !*made.put()) {
            return Ok(());
        }
        self.place.within(name)?.remove()
    }

    fn list(&self, folder: &str) -> io::Result<Vec<String>> {
        let place = self.place.within(folder)?;
        let below = place.path();
        let found = place.below(false)?;
        Ok(found.iter().filter_map(|(path, _)| Some(path.strip_prefix(&below).ok()?.to_str()?.to_owned())).collect())
    }

    fn sync_names(&self, _: &str) -> io::Result<()> {
        Ok(())
    }

    fn is_here_until_synced(&self) -> bool {
        true
    }
}

/// A file that is being made.
struct Made {
    file: File,
    place: Place,
    /// Whether what it holds is there for others.
    put: Mutex<bool>,
}

impl Made {
    fn put(&self) -> MutexGuard<'_, bool> {
        self.put.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn bytes(&self) -> io::Result<Vec<u8>> {
        let length = self.length()?;
        if length > MOST {
            return Err(io::ErrorKind::FileTooLarge.into());
        }
        let mut bytes = vec![0; length as usize];
        self.file.read_exact_at(&mut bytes, 0)?;
        Ok(bytes)
    }
}

impl fmt::Debug for Made {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Made({})", self.place.path().display())
    }
}

impl StoredFile for Made {
    fn write_at(&self, bytes: &[u8], at: u64) -> io::Result<()> {
        *self.put() = false;
        self.file.write_all_at(bytes, at)
    }

    fn read_at(&self, out: &mut [u8], at: u64) -> io::Result<()> {
        self.file.read_exact_at(out, at)
    }

    fn length(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    fn cut(&self, length: u64) -> io::Result<()> {
        *self.put() = false;
        self.file.set_len(length)
    }

    fn sync(&self) -> io::Result<()> {
        let mut put = self.put();
        if !*put {
            self.place.upload(&self.file, self.length()?, Put::Replace)?;
            *put = true;
        }
        Ok(())
    }

    fn will_need(&self, _: u64, _: u64) {}
}

/// An object that is in memory.
struct Held(Vec<u8>);

impl fmt::Debug for Held {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Held({} bytes)", self.0.len())
    }
}

/// An object is not written to.
fn unwritable<T>() -> io::Result<T> {
    Err(io::Error::new(io::ErrorKind::Unsupported, "an object cannot be changed"))
}

impl StoredFile for Held {
    fn write_at(&self, _: &[u8], _: u64) -> io::Result<()> {
        unwritable()
    }

    fn read_at(&self, out: &mut [u8], at: u64) -> io::Result<()> {
        let there = usize::try_from(at).ok().and_then(|at| self.0.get(at..at.checked_add(out.len())?));
        out.copy_from_slice(there.ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    }

    fn length(&self) -> io::Result<u64> {
        Ok(self.0.len() as u64)
    }

    fn cut(&self, _: u64) -> io::Result<()> {
        unwritable()
    }

    fn sync(&self) -> io::Result<()> {
        Ok(())
    }

    fn will_need(&self, _: u64, _: u64) {}
}

/// An object that is read in pieces.
#[derive(Debug)]
struct Opened {
    place: Place,
    meta: Meta,
    local: PathBuf,
    fetched: Mutex<Fetched>,
}

/// What of an object lies here.
#[derive(Debug)]
struct Fetched {
    /// A bit for each block.
    there: Vec<u64>,
    file: Option<Arc<File>>,
    /// The block behind the last that was asked for, and how many are fetched if that is asked for next.
    next: u64,
    ahead: u64,
}

impl Fetched {
    fn has(&self, block: u64) -> bool {
        self.there[block as usize / 64] >> (block % 64) & 1 == 1
    }
}

impl Opened {
    fn fetched(&self) -> MutexGuard<'_, Fetched> {
        self.fetched.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The blocks to be fetched for a stretch, from its first missing one on: if there are any. Else the file that has them all.
    fn missing(&self, from: u64, to: u64) -> std::result::Result<Arc<File>, (u64, u64)> {
        let mut fetched = self.fetched();
        let (first, end) = (from / BLOCK, to.div_ceil(BLOCK));
        let missing = (first..end).find(|block| !fetched.has(*block));
        let is_next = first == fetched.next || first + 1 == fetched.next;
        fetched.next = end;
        match (missing, &fetched.file) {
            (None, Some(file)) => Ok(Arc::clone(file)),
            (missing, _) => {
                fetched.ahead = if is_next { (2 * fetched.ahead).min(MOST_BLOCKS) } else { 1 };
                let (from, all) = (missing.unwrap_or(first), self.meta.bytes.div_ceil(BLOCK));
                let most = (from + MOST_BLOCKS).min(all);
                let wanted = end.max(from + fetched.ahead).min(most);
                let until = (from..wanted).find(|block| fetched.has(*block)).unwrap_or(wanted);
                Err((from, until.max(from + 1)))
            }
        }
    }

    /// Keeps blocks for whoever asks for them next; false if there is no room for them.
    fn keep(&self, first: u64, end: u64, bytes: &[u8]) -> io::Result<bool> {
        let file = {
            let mut fetched = self.fetched();
            match &fetched.file {
                Some(file) => Arc::clone(file),
                None => Arc::clone(fetched.file.insert(Arc::new(tempfile::tempfile_in(&self.local)?))),
            }
        };
        match file.write_all_at(bytes, first * BLOCK) {
            Err(error) if matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded) => {
                return Ok(false);
            }
            written => written?,
        }
        let mut fetched = self.fetched();
        for block in first..end {
            fetched.there[block as usize / 64] |= 1 << (block % 64);
        }
        Ok(true)
    }
}

impl StoredFile for Opened {
    fn write_at(&self, _: &[u8], _: u64) -> io::Result<()> {
        unwritable()
    }

    fn read_at(&self, out: &mut [u8], at: u64) -> io::Result<()> {
        let to =
            at.checked_add(out.len() as u64).filter(|to| *to <= self.meta.bytes).ok_or(io::ErrorKind::UnexpectedEof)?;
        if out.is_empty() {
            return Ok(());
        }
        loop {
            let (first, end) = match self.missing(at, to) {
                Ok(file) => return file.read_exact_at(out, at),
                Err(missing) => missing,
            };
            let stretch = first * BLOCK..(end * BLOCK).min(self.meta.bytes);
            let bytes = self.place.read(stretch, Some(&self.meta))?;
            if !self.keep(first, end, &bytes)? {
                for (piece, number) in out.chunks_mut((MOST_BLOCKS * BLOCK) as usize).zip(0..) {
                    let at = at + number * MOST_BLOCKS * BLOCK;
                    piece.copy_from_slice(&self.place.read(at..at + piece.len() as u64, Some(&self.meta))?);
                }
                return Ok(());
            }
        }
    }

    fn length(&self) -> io::Result<u64> {
        Ok(self.meta.bytes)
    }

    fn cut(&self, _: u64) -> io::Result<()> {
        unwritable()
    }

    fn sync(&self) -> io::Result<()> {
        Ok(())
    }

    fn will_need(&self, _: u64, _: u64) {}
}
