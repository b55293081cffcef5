//! A file as bytes at positions: a memory map where the system allows one, plain reads where it does not.
//!
//! A map lends pages of the file without copying them, at a price: if another program shortens the file meanwhile, touching a page that is gone raises
//! SIGBUS. [`Mapped::bytes`] therefore asks the file's length before it lends anything, so a file that shrank between two
//! blocks is an ordinary error; a cut made during the decoding of a block is seen to by [`crate::system::bus`]. A file that is
//! rewritten in place gives mixed points, as it would with plain reads: [`crate::storage::steady`] tells.
//!
//! A file's bytes are its [`Content`]: what lies under its name, or what was unpacked from that, and lies in a stretch of a temporary file.
//! Nothing but this module knows the difference.
//!
//! Resident memory: pages count as the process's own while they are mapped in. [`Bytes`] gives its pages back when it
//! is dropped, so a pass over a file of any size holds about as many bytes as there are blocks in flight.

use std::fs::File;
use std::ops::{Deref, Range};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::storage::spool::ScratchFile;
use crate::system::{self, FileAt, Map, bus};

/// Linux maps pages round a fault in aligned windows of this size (`fault_around_bytes`), so pages are given back in
/// such windows too; smaller pieces would be mapped in again by the neighbouring block.
pub const FAULT_WINDOW: usize = 64 << 10;

/// The bytes of a point file, to be opened for each pass over them.
#[derive(Debug, Clone)]
pub struct Content {
    name: PathBuf,
    unpacked: Option<Unpacked>,
    absent: Option<Arc<Absent>>,
}

/// What of a point file was not fetched, since none of its points counts; in its place are zeros.
#[derive(Debug)]
pub enum Absent {
    /// All points.
    All,
    /// Those of the chunks that begin at these bytes, in order.
    Chunks(Vec<u64>),
}

impl Absent {
    /// Whether the points of a chunk are absent.
    pub fn has(&self, at: u64) -> bool {
        match self {
            Absent::All => true,
            Absent::Chunks(chunks) => chunks.binary_search(&at).is_ok(),
        }
    }
}

/// A stretch of a temporary file.
#[derive(Debug, Clone)]
struct Unpacked {
    file: Arc<ScratchFile>,
    /// A multiple of [`FAULT_WINDOW`].
    start: u64,
    len: u64,
}

impl Content {
    /// What lies under `path`.
    pub fn named(path: &Path) -> Content {
        Content { name: path.to_path_buf(), unpacked: None, absent: None }
    }

    /// What was unpacked from the file that messages call `name`: `len` bytes from `start` on, a multiple of [`FAULT_WINDOW`].
    pub fn unpacked(name: &Path, file: Arc<ScratchFile>, start: u64, len: u64) -> Content {
        Content { name: name.to_path_buf(), unpacked: Some(Unpacked { file, start, len }), absent: None }
    }

    /// The same content, of which something is absent.
    pub fn without(self, absent: Absent) -> Content {
        Content { absent: Some(Arc::new(absent)), ..self }
    }

    /// What is absent.
    pub fn absent(&self) -> Option<&Arc<Absent>> {
        self.absent.as_ref()
    }

    /// The file's name, as the user knows it.
    pub fn name(&self) -> &Path {
        &self.name
    }

    /// Opens it for one sequential pass.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be opened, or is not a regular file.
    pub fn open(&self) -> Result<Arc<Mapped>> {
        let mapped = self.unmapped()?;
        let Ok(len) = usize::try_from(mapped.len) else { return Ok(Arc::new(mapped)) };
        let map = system::map(&mapped.file, mapped.start, len);
        // What is unpacked lies in a file of this process's own, which nobody cuts; but its disk may fail.
        let watched = map.as_ref().and_then(|map| bus::watch(&self.name, map));
        let map = map.filter(|_| watched.is_some());
        Ok(Arc::new(Mapped { _watched: watched, map, ..mapped }))
    }

    /// Whether its bytes are lent from a map, and take no memory of the heap.
    pub fn is_mapped(&self) -> bool {
        self.open().is_ok_and(|mapped| mapped.map.is_some())
    }

    /// Opens it for plain reads only: the fallback of [`Content::open`], and the choice for a look at a few places.
    ///
    /// # Errors
    /// The same as [`Content::open`].
    pub fn unmapped(&self) -> Result<Mapped> {
        if let Some(Unpacked { file, start, len }) = &self.unpacked {
            return Ok(Mapped {
                content: self.clone(),
                file: file.handle()?,
                start: *start,
                len: *len,
                _watched: None,
                map: None,
            });
        }
        let path = &self.name;
        // Asked first: opening a pipe would wait for a writer.
        let metadata = std::fs::metadata(path).map_err(Error::io(path, "open"))?;
        if !metadata.is_file() {
            let source = std::io::Error::new(std::io::ErrorKind::InvalidInput, "it is not a regular file");
            return Err(Error::io(path, "read points from")(source));
        }
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        let metadata = file.metadata().map_err(Error::io(path, "read the length of"))?;
        Ok(Mapped { content: self.clone(), file, start: 0, len: metadata.len(), _watched: None, map: None })
    }
}

/// An open file whose bytes can be read at any position, from several threads at once.
#[derive(Debug)]
pub struct Mapped {
    content: Content,
    file: File,
    /// Where in the file the content begins, and its length.
    start: u64,
    len: u64,
    /// Goes before the map.
    _watched: Option<bus::Watched>,
    /// `None` where the file cannot be mapped: a pipe, an empty file, a file system without maps.
    map: Option<Map>,
}

impl Mapped {
    /// What was opened, to be opened again.
    pub fn content(&self) -> &Content {
        &self.content
    }

    /// The file's path.
    pub fn path(&self) -> &Path {
        self.content.name()
    }

    /// The file's length when it was opened.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// The bytes of `range`: lent from the map, or read into memory of their own.
    ///
    /// # Panics
    /// If the range reaches past [`Mapped::len`]: a bug of the caller.
    ///
    /// # Errors
    /// [`Error::Changed`] if the file has become shorter since it was opened; [`Error::Io`] if reading fails.
    pub fn bytes(self: &Arc<Self>, range: Range<u64>) -> Result<Bytes> {
        assert!(range.start <= range.end && range.end <= self.len, "bytes {range:?} of a file of {}", self.len);
        if self.map.is_none() {
            return Ok(Bytes(Hold::Owned(self.read(range)?)));
        }
        let now = self.file.metadata().map_err(Error::io(self.path(), "read the length of"))?.len();
        if now < self.start + range.end {
            return Err(self.shrunk(now));
        }
        let range = range.start as usize..range.end as usize;
        Ok(Bytes(Hold::Lent { file: Arc::clone(self), range }))
    }

    /// The bytes of `range` by a plain read.
    ///
    /// # Errors
    /// The same as [`Mapped::bytes`].
    pub fn read(&self, range: Range<u64>) -> Result<Vec<u8>> {
        let mut bytes = vec![0; (range.end - range.start) as usize];
        self.file.read_exact_at(&mut bytes, self.start + range.start).map_err(|e| match e.kind() {
            std::io::ErrorKind::UnexpectedEof => self.shrunk(self.file.metadata().map_or(0, |m| m.len())),
            _ => Error::io(self.path(), "read")(e),
        })?;
        Ok(bytes)
    }

    fn shrunk(&self, now: u64) -> Error {
        Error::length_changed(self.path(), format_args!("{} bytes as when it was opened", self.len), now)
    }
}

/// Some bytes of a file, valid for as long as this lives.
#[derive(Debug)]
pub struct Bytes(Hold);

#[derive(Debug)]
enum Hold {
    /// From the map of `file`, which is there; `range` lies within the file's length at opening.
    Lent {
        file: Arc<Mapped>,
        range: Range<usize>,
    },
    Owned(Vec<u8>),
}

impl Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match &self.0 {
            Hold::Lent { file, range } => file.map.as_ref().map_or(&[], |map| &map[range.clone()]),
            Hold::Owned(bytes) => bytes,
        }
    }
}

impl Drop for Bytes {
    fn drop(&mut self) {
        let Hold::Lent { file, range } = &self.0 else { return };
        let Some(map) = &file.map else { return };
        // The window in which the block ends belongs to the next block, which gives it back.
        let start = range.start / FAULT_WINDOW * FAULT_WINDOW;
        let end = if range.end as u64 == file.len { range.end } else { range.end / FAULT_WINDOW * FAULT_WINDOW };
        if start < end {
            system::give_back(map, start, end - start);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(len: usize) -> (tempfile::TempDir, PathBuf, Vec<u8>) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("sample");
        let content: Vec<u8> = (0..len).map(|i| (i * 7 % 251) as u8).collect();
        std::fs::write(&path, &content).unwrap();
        (dir, path, content)
    }

    #[test]
    fn map_and_plain_reads_give_the_same_bytes() {
        let (_dir, path, content) = sample(300_000);
        let mapped = Content::named(&path).open().unwrap();
        let plain = Arc::new(Content::named(&path).unmapped().unwrap());
        assert!(mapped.map.is_some() && Content::named(&path).is_mapped());
        for range in [0..0, 0..300_000, 1..77_777, 65_535..65_537, 299_999..300_000] {
            let expected = &content[range.start as usize..range.end as usize];
            assert_eq!(&*mapped.bytes(range.clone()).unwrap(), expected);
            assert_eq!(&*plain.bytes(range).unwrap(), expected);
        }
        let (first, second) = (mapped.bytes(0..150_000).unwrap(), mapped.bytes(150_000..300_000).unwrap());
        drop(second);
        assert_eq!(&*first, &content[..150_000], "a block given back does not disturb another");
    }

    #[test]
    fn a_file_cut_between_blocks_is_an_error() {
        let (_dir, path, _) = sample(300_000);
        for file in [Content::named(&path).open().unwrap(), Arc::new(Content::named(&path).unmapped().unwrap())] {
            drop(file.bytes(0..100_000).unwrap());
            File::options().write(true).open(&path).unwrap().set_len(150_000).unwrap();
            let error = file.bytes(100_000..200_000).unwrap_err().to_string();
            assert!(error.contains("300000 bytes") && error.contains("150000 bytes"), "{error}");
            File::options().write(true).open(&path).unwrap().set_len(300_000).unwrap();
        }
    }

    #[test]
    fn folders_are_refused_and_empty_files_are_empty() {
        let dir = tempfile::tempdir().unwrap();
        assert!(Content::named(dir.path()).open().unwrap_err().to_string().contains("not a regular file"));
        let empty = dir.path().join("empty");
        File::create(&empty).unwrap();
        assert!(Content::named(&empty).open().unwrap().bytes(0..0).unwrap().is_empty());
    }
}
