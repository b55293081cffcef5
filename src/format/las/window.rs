//! A part of a file as a stream, of which a small window is held at a time.

use std::io::{Error as IoError, ErrorKind, Read, Result as IoResult, Seek, SeekFrom};
use std::ops::Range;
use std::sync::Arc;

use crate::storage::mapped::{Bytes, Mapped};

/// Bytes held at a time.
const WINDOW: u64 = 256 << 10;

/// Reads the bytes of a file from one position to another.
#[derive(Debug)]
pub struct Window {
    file: Arc<Mapped>,
    /// Where the window ends, and what there is ends.
    next: u64,
    end: u64,
    bytes: Option<Bytes>,
    /// The part of the window that has been read.
    read: usize,
}

impl Window {
    /// The bytes of `range`, which lies within the file.
    pub fn new(file: &Arc<Mapped>, range: Range<u64>) -> Window {
        Window { file: Arc::clone(file), next: range.start, end: range.end, bytes: None, read: 0 }
    }

    /// The position in the file that is read next.
    pub fn position(&self) -> u64 {
        self.next - self.rest().len() as u64
    }

    fn rest(&self) -> &[u8] {
        self.bytes.as_ref().map_or(&[], |bytes| &bytes[self.read..])
    }
}

impl Read for Window {
    fn read(&mut self, into: &mut [u8]) -> IoResult<usize> {
        if self.rest().is_empty() && self.next < self.end {
            let end = (self.next + WINDOW).min(self.end);
            self.bytes = Some(self.file.bytes(self.next..end).map_err(IoError::other)?);
            (self.next, self.read) = (end, 0);
        }
        let rest = self.rest();
        let length = rest.len().min(into.len());
        into[..length].copy_from_slice(&rest[..length]);
        self.read += length;
        Ok(length)
    }
}

impl Seek for Window {
    /// Only within what there is; positions are those of the file.
    fn seek(&mut self, to: SeekFrom) -> IoResult<u64> {
        let to = match to {
            SeekFrom::Start(to) => Some(to),
            SeekFrom::Current(by) => self.position().checked_add_signed(by),
            SeekFrom::End(by) => self.end.checked_add_signed(by),
        };
        let to = to.filter(|&to| to <= self.end).ok_or(IoError::from(ErrorKind::UnexpectedEof))?;
        (self.next, self.bytes, self.read) = (to, None, 0);
        Ok(to)
    }
}
