//! Temporary storage: append-only byte stores that begin in memory and move to disk when they outgrow it.
//!
//! A [`Workspace`] names the folder; a [`Spool`] is one store in it, written by one thread, [`PageFile`] is one that all
//! threads write to, and [`ScratchFile`] is a file as such. They stop before the disk is full. Files are unlinked as soon as they are opened, so
//! nothing is left behind on success, on error, on Ctrl-C or when the process is killed. What a spool holds is private
//! to the process that wrote it: native byte order, no version. Results never depend on where the bytes lay.
//!
//! A [`Spool`] and a [`PageFile`] can lie in a file of a work folder instead, which stays ([`crate::storage::work`]).

mod pages;

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use bytesize::ByteSize;

pub use self::pages::PageFile;
use crate::error::{Error, Result};
use crate::resources::workers::Workers;
use crate::storage::remote;
use crate::storage::work::store::NamedFile;
use crate::system::{self, FileAt};

/// The folder for temporary files and the account of what lies in it.
///
/// Cloning is cheap; clones share the account.
#[derive(Debug, Clone)]
pub struct Workspace {
    dir: Arc<PathBuf>,
    on_disk: Arc<AtomicU64>,
    peak: Arc<AtomicU64>,
    /// Bytes that may be written before the free space is looked at again.
    promised: Arc<AtomicU64>,
    stopped: Arc<AtomicBool>,
}

/// Where bytes on disk lie.
#[derive(Debug)]
enum Backing {
    /// In a file without a name.
    Nameless(File),
    /// In a file of a work folder.
    Named(NamedFile),
}

impl Backing {
    fn write(&self, bytes: &[u8], at: u64) -> io::Result<()> {
        match self {
            Backing::Nameless(file) => file.write_all_at(bytes, at),
            Backing::Named(named) => named.file.write_at(bytes, at),
        }
    }

    fn read(&self, out: &mut [u8], at: u64) -> io::Result<()> {
        match self {
            Backing::Nameless(file) => file.read_exact_at(out, at),
            Backing::Named(named) => named.file.read_at(out, at),
        }
    }

    fn will_need(&self, at: u64, bytes: u64) {
        match self {
            Backing::Nameless(file) => system::will_need(file, at, bytes),
            Backing::Named(named) => named.file.will_need(at, bytes),
        }
    }
}

impl Workspace {
    /// Uses `dir` for temporary files.
    ///
    /// # Errors
    /// [`Error::Io`] if no file can be created there: the work fails in its first second, not after hours.
    pub fn new(dir: impl Into<PathBuf>) -> Result<Workspace> {
        let workspace = Workspace::unchecked(dir);
        workspace.file()?;
        Ok(workspace)
    }

    /// Uses `dir` for temporary files, which may turn out to be impossible when the first is needed: for work that hardly ever needs one.
    pub fn unchecked(dir: impl Into<PathBuf>) -> Workspace {
        Workspace {
            dir: Arc::new(dir.into()),
            on_disk: Arc::default(),
            peak: Arc::default(),
            promised: Arc::default(),
            stopped: Arc::default(),
        }
    }

    /// Storage stops when the workers do: loops that go on for long without a job of theirs, such as the conversion of a mesh, end at their next piece of data.
    pub fn stopped_with(self, workers: &Workers) -> Workspace {
        Workspace { stopped: workers.cancel_flag(), ..self }
    }

    fn check_stopped(&self) -> Result<()> {
        if self.stopped.load(Ordering::Relaxed) { Err(Error::Interrupted) } else { Ok(()) }
    }

    /// The folder for temporary files of work on `file`, unless told otherwise: `TMPDIR`, or else the folder of `file`. The system's temporary
    /// folder is no default, as it is often kept in memory, but where the file lies in an object store.
    pub fn folder_beside(file: &Path) -> PathBuf {
        std::env::var_os("TMPDIR").map(PathBuf::from).unwrap_or_else(|| match file.parent() {
            _ if remote::is_remote(file) => remote::local_folder(),
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
            _ => PathBuf::from("."),
        })
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
        Ok(system::space(self.dir()).map_err(self.failed("read the free space"))?.available)
    }

    /// The size of the folder's file system.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn capacity(&self) -> Result<u64> {
        Ok(system::space(self.dir()).map_err(self.failed("read the size"))?.capacity)
    }

    /// A new store that keeps up to `in_memory` bytes in memory and goes to disk beyond.
    pub fn spool(&self, in_memory: u64) -> Spool {
        Spool { workspace: self.clone(), in_memory, store: Store::Memory(Vec::new()), len: 0, since: Since::default() }
    }

    /// A store whose bytes lie in a file of a work folder, which holds `len` of them already.
    pub fn spool_in(&self, file: NamedFile, len: u64) -> Spool {
        self.count(len);
        let store = Store::Disk(Backing::Named(file));
        Spool { workspace: self.clone(), in_memory: 0, store, len, since: Since { from: len, ..Since::default() } }
    }

    /// A new file without a name, on disk.
    ///
    /// # Errors
    /// [`Error::Io`] if no file can be created.
    pub fn scratch_file(&self) -> Result<ScratchFile> {
        Ok(ScratchFile { file: self.file()?, workspace: self.clone(), written: AtomicU64::new(0) })
    }

    /// A file without a name.
    fn file(&self) -> Result<File> {
        tempfile::tempfile_in(&*self.dir).map_err(self.failed("create a temporary file"))
    }
}

/// Bytes of a spool that are allocated together while it lies in memory. In pieces, so that what is there is never moved, nor
/// twice there, as more comes.
pub(crate) const PIECE: usize = 64 << 10;

/// An append-only store of bytes, in memory while small, in an unlinked file once it outgrows its share.
///
/// Writing needs `&mut`; reading is by position and may happen from several threads at once.
#[derive(Debug)]
pub struct Spool {
    workspace: Workspace,
    in_memory: u64,
    store: Store,
    len: u64,
    since: Since,
}

#[derive(Debug)]
enum Store {
    /// Pieces of [`PIECE`] bytes, the last one shorter.
    Memory(Vec<Vec<u8>>),
    Disk(Backing),
}

/// What was appended to a file of a work folder since its extent was last asked for.
#[derive(Debug, Clone, Default)]
struct Since {
    from: u64,
    hasher: crc32fast::Hasher,
}

/// A stretch of a spool's bytes, and their checksum.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Extent {
    /// The first byte.
    pub from: u64,
    /// The one behind the last.
    pub to: u64,
    /// CRC-32.
    pub crc: u32,
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
    /// [`Error::Io`] if the work directory is full or fails; [`Error::Interrupted`].
    pub fn append(&mut self, bytes: &[u8]) -> Result<u64> {
        self.workspace.check_stopped()?;
        let at = self.len;
        if let Store::Memory(held) = &mut self.store {
            if at + bytes.len() as u64 <= self.in_memory {
                hold(held, bytes);
                self.len += bytes.len() as u64;
                return Ok(at);
            }
            self.leave_memory()?;
        }
        if let Store::Disk(file) = &self.store {
            self.workspace.write(file, bytes, at)?;
            if let Backing::Named(_) = file {
                self.since.hasher.update(bytes);
            }
        }
        self.len += bytes.len() as u64;
        Ok(at)
    }

    /// Moves what lies in memory to disk, and frees it; what is appended later goes there, too.
    ///
    /// # Errors
    /// [`Error::Io`] if the work directory is full or fails.
    pub fn leave_memory(&mut self) -> Result<()> {
        if let Store::Memory(held) = &mut self.store {
            let file = Backing::Nameless(self.workspace.file()?);
            for (number, piece) in held.iter_mut().enumerate() {
                self.workspace.write(&file, &std::mem::take(piece), (number * PIECE) as u64)?;
            }
            self.store = Store::Disk(file);
        }
        Ok(())
    }

    /// Fills `out` from position `at`.
    ///
    /// # Panics
    /// If the range was never appended: a bug of the caller.
    ///
    /// # Errors
    /// [`Error::Io`] if the work directory fails; [`Error::Interrupted`].
    pub fn read_at(&self, at: u64, out: &mut [u8]) -> Result<()> {
        assert!(at + out.len() as u64 <= self.len, "read past the end of a spool");
        self.workspace.check_stopped()?;
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
            Store::Disk(file) => file.read(out, at).map_err(self.workspace.failed("read temporary data")),
        }
    }

    /// What was appended since the last time this was asked for, or since the spool was made, if the bytes lie in a file of a work folder.
    pub fn extent(&mut self) -> Extent {
        let next = Since { from: self.len, ..Since::default() };
        let Since { from, hasher } = std::mem::replace(&mut self.since, next);
        Extent { from, to: self.len, crc: hasher.finalize() }
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

/// Bytes between two looks at the free space; and as many stay free, at least.
const LOOK: u64 = 16 << 20;

/// A file without a name whose length nobody knows beforehand.
#[derive(Debug)]
pub struct ScratchFile {
    workspace: Workspace,
    file: File,
    written: AtomicU64,
}

impl ScratchFile {
    /// Writes at a position; each is written once.
    ///
    /// # Errors
    /// [`Error::Disk`] if hardly any space is left; [`Error::Io`] if the work directory fails.
    pub fn write_at(&self, bytes: &[u8], at: u64) -> Result<()> {
        let more = bytes.len() as u64;
        self.workspace.reserve(more)?;
        self.file.write_all_at(bytes, at).map_err(self.workspace.failed("write temporary data"))?;
        self.written.fetch_add(more, Ordering::Relaxed);
        self.workspace.count(more);
        Ok(())
    }

    /// Lets the file reach to a position, with zeros that take no room.
    ///
    /// # Errors
    /// [`Error::Io`] if the work directory fails.
    pub fn reach(&self, end: u64) -> Result<()> {
        self.file.set_len(end).map_err(self.workspace.failed("write temporary data"))
    }

    /// Another handle of the file, to read from.
    ///
    /// # Errors
    /// [`Error::Io`] if the process has too many files open.
    pub fn handle(&self) -> Result<File> {
        self.file.try_clone().map_err(self.workspace.failed("open temporary data"))
    }
}

/// How many bytes may be written, `more` of them now, where `available` are free; `None` if that leaves too little.
fn promise(available: u64, more: u64) -> Option<u64> {
    (available >= more + LOOK).then(|| more.max(LOOK.min(available - LOOK)))
}

impl Drop for ScratchFile {
    fn drop(&mut self) {
        self.workspace.on_disk.fetch_sub(*self.written.get_mut(), Ordering::Relaxed);
    }
}

impl Workspace {
    fn failed(&self, action: &'static str) -> impl FnOnce(std::io::Error) -> Error + use<> {
        Error::io(self.dir.to_path_buf(), action)
    }

    /// Writes to a file on disk, if there is room, and counts it.
    fn write(&self, file: &Backing, bytes: &[u8], at: u64) -> Result<()> {
        self.reserve(bytes.len() as u64)?;
        file.write(bytes, at).map_err(self.failed("write temporary data"))?;
        self.count(bytes.len() as u64);
        Ok(())
    }

    /// Sees to it that there is room for so many more bytes: what is free is looked at now and then, and a little of it is left to others.
    fn reserve(&self, more: u64) -> Result<()> {
        let take = |promised: u64| promised.checked_sub(more);
        if self.promised.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take).is_ok() {
            return Ok(());
        }
        let available = self.available()?;
        let Some(promise) = promise(available, more) else {
            let written = self.on_disk.load(Ordering::Relaxed);
            return Err(Error::Disk {
                path: self.dir().to_path_buf(),
                // Of all that was free at first, and for all that is to be written: more may come yet.
                available: ByteSize(written + available),
                needed: ByteSize(written + more + LOOK),
                capacity: ByteSize(self.capacity()?),
            });
        };
        self.promised.store(promise - more, Ordering::Relaxed);
        Ok(())
    }

    fn count(&self, bytes: u64) {
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
    fn bytes_that_leave_memory_are_the_same_on_disk() {
        let dir = tempfile::tempdir().unwrap();
        let workspace = Workspace::new(dir.path()).unwrap();
        for len in [0, 1, PIECE - 1, PIECE, PIECE + 1, 3 * PIECE + 5] {
            let mut expected: Vec<u8> = (0..len).map(|at| (at % 251) as u8).collect();
            let mut spool = workspace.spool(u64::MAX);
            spool.append(&expected).unwrap();
            assert!(!spool.is_on_disk());
            spool.leave_memory().unwrap();
            assert!(spool.is_on_disk());
            // What comes later lies behind it, and nothing is moved twice.
            spool.append(&[1, 2, 3]).unwrap();
            spool.leave_memory().unwrap();
            expected.extend([1, 2, 3]);
            let mut back = vec![0; expected.len()];
            spool.read_at(0, &mut back).unwrap();
            assert_eq!(back, expected);
            assert_eq!(workspace.on_disk.load(Ordering::Relaxed), expected.len() as u64);
        }
        assert_eq!(workspace.on_disk.load(Ordering::Relaxed), 0);
    }

    #[test]
    fn pages_filled_by_several_threads_are_read_back() {
        let dir = tempfile::tempdir().unwrap();
        let workspace = Workspace::new(dir.path()).unwrap();
        let pages = workspace.page_file(100).unwrap();
        let fill = |thread: u8| {
            (0..50u8)
                .map(|i| {
                    (
                        pages
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
            pages.read(number, 0, &mut back).unwrap();
            assert_eq!(back, vec![thread ^ i; usize::from(i)]);
        }
        assert_eq!(workspace.peak_on_disk(), 3 * (0..50).sum::<u64>());
        drop(pages);
        assert_eq!(workspace.on_disk.load(Ordering::Relaxed), 0);
    }

    #[test]
    fn a_temporary_file_is_counted_and_leaves_the_disk_some_room() {
        let dir = tempfile::tempdir().unwrap();
        let workspace = Workspace::new(dir.path()).unwrap();
        let file = workspace.scratch_file().unwrap();
        file.write_at(b"abc", 0).unwrap();
        file.write_at(b"de", 100).unwrap();
        let mut back = [0; 2];
        file.handle().unwrap().read_exact_at(&mut back, 100).unwrap();
        assert_eq!((&back, workspace.peak_on_disk()), (b"de", 5));
        drop(file);
        assert_eq!(workspace.on_disk.load(Ordering::Relaxed), 0);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
        assert_eq!(promise(1 << 40, 7), Some(LOOK));
        assert_eq!(promise(1 << 40, 3 * LOOK), Some(3 * LOOK));
        assert_eq!(promise(LOOK + 9, 7), Some(9));
        assert_eq!(promise(LOOK + 6, 7), None);
        assert_eq!(promise(0, 7), None);
    }

    #[test]
    fn storage_stops_with_the_workers() {
        let dir = tempfile::tempdir().unwrap();
        let workers = Workers::new(1).unwrap();
        let mut spool = Workspace::new(dir.path()).unwrap().stopped_with(&workers).spool(100);
        spool.append(b"abc").unwrap();
        workers.cancel_flag().store(true, Ordering::Relaxed);
        assert!(matches!(spool.append(b"d"), Err(Error::Interrupted)));
        assert!(matches!(spool.read_at(0, &mut [0]), Err(Error::Interrupted)));
    }

    #[test]
    fn a_missing_folder_is_refused_at_once() {
        let error = Workspace::new("/nonexistent/folder").unwrap_err();
        assert!(error.to_string().contains("/nonexistent/folder"));
    }
}
