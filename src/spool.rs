//! Temporary storage: append-only byte stores that begin in memory and move to disk when they outgrow it.
//!
//! A [`Workspace`] names the folder; a [`Spool`] is one store in it, written by one thread, and [`Slots`] is one that all
//! threads write to. Files are unlinked as soon as they are opened, so
//! nothing is left behind on success, on error, on Ctrl-C or when the process is killed. What a spool holds is private
//! to the process that wrote it: native byte order, no version. Results never depend on where the bytes lay.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use crate::error::{Error, Result};

/// The folder for temporary files and the account of what lies in it.
///
/// Cloning is cheap; clones share the account.
#[derive(Debug, Clone)]
pub struct Workspace {
    dir: Arc<PathBuf>,
    on_disk: Arc<AtomicU64>,
    peak: Arc<AtomicU64>,
}

impl Workspace {
    /// Uses `dir` for temporary files.
    ///
    /// # Errors
    /// [`Error::Io`] if no file can be created there: the work fails in its first second, not after hours.
    pub fn new(dir: impl Into<PathBuf>) -> Result<Workspace> {
        let dir = dir.into();
        tempfile::tempfile_in(&dir).map_err(Error::io(&dir, "create a temporary file"))?;
        Ok(Workspace { dir: Arc::new(dir), on_disk: Arc::default(), peak: Arc::default() })
    }

    /// The folder.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// The most bytes that lay on disk at one time so far.
    pub fn peak_on_disk(&self) -> u64 {
        self.peak.load(Ordering::Relaxed)
    }

    /// Bytes free in the folder's file system, for users like this one.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn available(&self) -> Result<u64> {
        let stat = rustix::fs::statvfs(self.dir()).map_err(|e| self.failed("read the free space")(e.into()))?;
        Ok(stat.f_bavail * stat.f_frsize)
    }

    /// A new store that keeps up to `in_memory` bytes in memory and goes to disk beyond.
    pub fn spool(&self, in_memory: u64) -> Spool {
        Spool { workspace: self.clone(), in_memory, store: Store::Memory(Vec::new()), len: 0 }
    }

    /// New slots of `slot` bytes each, on disk.
    ///
    /// # Errors
    /// [`Error::Io`] if no file can be created.
    pub fn slots(&self, slot: usize) -> Result<Slots> {
        Ok(Slots {
            file: self.file()?,
            workspace: self.clone(),
            slot,
            taken: AtomicU32::new(0),
            on_disk: AtomicU64::new(0),
        })
    }

    /// A file without a name.
    fn file(&self) -> Result<File> {
        tempfile::tempfile_in(&*self.dir).map_err(self.failed("create a temporary file"))
    }
}

/// Bytes of a spool that are allocated together while it lies in memory. In pieces, so that what is there is never moved, nor
/// twice there, as more comes.
const PIECE: usize = 64 << 10;

/// An append-only store of bytes, in memory while small, in an unlinked file once it outgrows its share.
///
/// Writing needs `&mut`; reading is by position and may happen from several threads at once.
#[derive(Debug)]
pub struct Spool {
    workspace: Workspace,
    in_memory: u64,
    store: Store,
    len: u64,
}

#[derive(Debug)]
enum Store {
    /// Pieces of [`PIECE`] bytes, the last one shorter.
    Memory(Vec<Vec<u8>>),
    Disk(File),
}

impl Spool {
    /// Bytes appended so far.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Whether nothing was appended yet.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whether the bytes lie on disk.
    pub fn is_on_disk(&self) -> bool {
        matches!(self.store, Store::Disk(_))
    }

    /// Adds `bytes` at the end and returns the position of their first. Unbuffered: append in large pieces.
    ///
    /// # Errors
    /// [`Error::Io`] if the work directory is full or fails.
    pub fn append(&mut self, bytes: &[u8]) -> Result<u64> {
        let at = self.len;
        if let Store::Memory(held) = &mut self.store {
            if at + bytes.len() as u64 <= self.in_memory {
                hold(held, bytes);
                self.len += bytes.len() as u64;
                return Ok(at);
            }
            let file = self.workspace.file()?;
            for (number, piece) in held.iter().enumerate() {
                let at = (number * PIECE) as u64;
                file.write_all_at(piece, at).map_err(self.workspace.failed("write temporary data"))?;
            }
            self.workspace.grow(at);
            self.store = Store::Disk(file);
        }
        if let Store::Disk(file) = &self.store {
            file.write_all_at(bytes, at).map_err(self.workspace.failed("write temporary data"))?;
            self.workspace.grow(bytes.len() as u64);
        }
        self.len += bytes.len() as u64;
        Ok(at)
    }

    /// Fills `out` from position `at`.
    ///
    /// # Panics
    /// If the range was never appended: a bug of the caller.
    ///
    /// # Errors
    /// [`Error::Io`] if the work directory fails.
    pub fn read_at(&self, at: u64, out: &mut [u8]) -> Result<()> {
        assert!(at + out.len() as u64 <= self.len, "read past the end of a spool");
        match &self.store {
            Store::Memory(held) => {
                let (mut number, mut from, mut out) = (at as usize / PIECE, at as usize % PIECE, out);
                while !out.is_empty() {
                    let (now, rest) = out.split_at_mut(out.len().min(PIECE - from));
                    now.copy_from_slice(&held[number][from..from + now.len()]);
                    (number, from, out) = (number + 1, 0, rest);
                }
                Ok(())
            }
            Store::Disk(file) => file.read_exact_at(out, at).map_err(self.workspace.failed("read temporary data")),
        }
    }
}

/// Appends `bytes` to pieces.
fn hold(held: &mut Vec<Vec<u8>>, mut bytes: &[u8]) {
    while !bytes.is_empty() {
        if held.last().is_none_or(|last| last.len() == PIECE) {
            // A spool's first piece grows: most spools of small clouds stay far below it.
            held.push(if held.is_empty() { Vec::new() } else { Vec::with_capacity(PIECE) });
        }
        let last = held.last_mut().expect("a piece was added if there was none");
        let (now, rest) = bytes.split_at(bytes.len().min(PIECE - last.len()));
        last.extend_from_slice(now);
        bytes = rest;
    }
}

/// Slots of equal size in an unlinked file, written and read by several threads at once.
#[derive(Debug)]
pub struct Slots {
    workspace: Workspace,
    file: File,
    slot: usize,
    taken: AtomicU32,
    on_disk: AtomicU64,
}

impl Slots {
    /// Puts `parts`, one behind the other, into a slot of their own and returns its number.
    ///
    /// # Panics
    /// If they are more than a slot holds: a bug of the caller.
    ///
    /// # Errors
    /// [`Error::Io`] if the work directory is full or fails.
    pub fn put(&self, parts: &[&[u8]]) -> Result<u32> {
        let bytes: usize = parts.iter().map(|part| part.len()).sum();
        assert!(bytes <= self.slot, "more bytes than a slot holds");
        let number = self.taken.fetch_add(1, Ordering::Relaxed);
        let mut at = u64::from(number) * self.slot as u64;
        for part in parts {
            self.file.write_all_at(part, at).map_err(self.workspace.failed("write temporary data"))?;
            at += part.len() as u64;
        }
        self.on_disk.fetch_add(bytes as u64, Ordering::Relaxed);
        self.workspace.grow(bytes as u64);
        Ok(number)
    }

    /// Fills `out` from byte `from` of slot `number` on.
    ///
    /// # Errors
    /// [`Error::Io`] if the work directory fails.
    pub fn read(&self, number: u32, from: usize, out: &mut [u8]) -> Result<()> {
        let at = u64::from(number) * self.slot as u64 + from as u64;
        self.file.read_exact_at(out, at).map_err(self.workspace.failed("read temporary data"))
    }
}

impl Drop for Slots {
    fn drop(&mut self) {
        self.workspace.on_disk.fetch_sub(*self.on_disk.get_mut(), Ordering::Relaxed);
    }
}

impl Workspace {
    fn failed(&self, action: &'static str) -> impl FnOnce(std::io::Error) -> Error + use<> {
        Error::io(self.dir.to_path_buf(), action)
    }

    fn grow(&self, bytes: u64) {
        let now = self.on_disk.fetch_add(bytes, Ordering::Relaxed) + bytes;
        self.peak.fetch_max(now, Ordering::Relaxed);
    }
}

impl Drop for Spool {
    fn drop(&mut self) {
        if self.is_on_disk() {
            self.workspace.on_disk.fetch_sub(self.len, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_the_same_in_memory_and_on_disk() {
        let dir = tempfile::tempdir().unwrap();
        let workspace = Workspace::new(dir.path()).unwrap();
        for (quota, stretch) in [(0, 1), (5, 1), (10, 1), (1000, 1), (200_000, 5000), (10_000_000, 5000)] {
            let mut spool = workspace.spool(quota);
            let mut expected = Vec::new();
            for i in 0u8..40 {
                let piece: Vec<u8> = (0..usize::from(i % 7) * stretch).map(|at| i ^ at as u8).collect();
                assert_eq!(spool.append(&piece).unwrap(), expected.len() as u64);
                expected.extend(piece);
            }
            assert_eq!(spool.is_on_disk(), expected.len() as u64 > quota);
            let mut back = vec![0; expected.len() - 3];
            spool.read_at(3, &mut back).unwrap();
            assert_eq!(back, expected[3..]);
        }
        assert!(workspace.peak_on_disk() > 0);
        assert_eq!(workspace.on_disk.load(Ordering::Relaxed), 0);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "spool files have no name");
    }

    #[test]
    fn slots_filled_by_several_threads_are_read_back() {
        let dir = tempfile::tempdir().unwrap();
        let workspace = Workspace::new(dir.path()).unwrap();
        let slots = workspace.slots(100).unwrap();
        let fill = |thread: u8| {
            (0..50u8)
                .map(|i| {
                    (
                        slots
                            .put(&[
                                &[thread ^ i][..usize::from(i.min(1))],
                                &vec![thread ^ i; usize::from(i.max(1) - 1)],
                            ])
                            .unwrap(),
                        thread,
                        i,
                    )
                })
                .collect::<Vec<_>>()
        };
        let filled: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (1..4).map(|thread| scope.spawn(move || fill(thread << 6))).collect();
            threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
        });
        for (number, thread, i) in filled {
            let mut back = vec![0; usize::from(i)];
            slots.read(number, 0, &mut back).unwrap();
            assert_eq!(back, vec![thread ^ i; usize::from(i)]);
        }
        assert_eq!(workspace.peak_on_disk(), 3 * (0..50).sum::<u64>());
        drop(slots);
        assert_eq!(workspace.on_disk.load(Ordering::Relaxed), 0);
    }

    #[test]
    fn a_missing_folder_is_refused_at_once() {
        let error = Workspace::new("/nonexistent/folder").unwrap_err();
        assert!(error.to_string().contains("/nonexistent/folder"));
    }
}
