//! Files of lines: cut into blocks at line ends, with line numbers for messages.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::format::point_format::{BLOCK_BYTES, BLOCK_RECORDS, BlockCutter, Decode};
use crate::points::{Batch, Coordinate, Points};
use crate::storage::mapped::{Bytes, Mapped};

/// The longest line accepted, in bytes. Wider tables exist nowhere; a binary file taken for text stops here.
pub const MAX_LINE: usize = 64 << 10;

/// One pass over the lines from a position on.
pub struct LineCutter {
    file: Arc<Mapped>,
    at: u64,
    line: u64,
}

/// Whole lines, the last one of a file possibly without its line end.
pub struct LineBlock {
    /// The text.
    pub bytes: Bytes,
    /// The number of its first line, counted from 1.
    pub first_line: u64,
    /// How many lines it has.
    pub count: usize,
}

impl LineCutter {
    /// Starts at byte `at`, which is the beginning of line number `line`.
    pub fn new(file: Arc<Mapped>, at: u64, line: u64) -> LineCutter {
        LineCutter { file, at, line }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// The number of the next line.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// The next lines, about [`BLOCK_BYTES`] of them, but no more than [`BLOCK_RECORDS`] lines; `None` at the end of the file.
    ///
    /// # Errors
    /// [`Error::Malformed`] if a line is longer than [`MAX_LINE`]; [`Error::Io`].
    pub fn next(&mut self) -> Result<Option<LineBlock>> {
        let left = self.file.len() - self.at;
        if left == 0 {
            return Ok(None);
        }
        let bytes = self.file.bytes(self.at..self.at + left.min((BLOCK_BYTES + MAX_LINE) as u64))?;
        // The block ends behind the line in which its size is reached, when it has as many lines as a block may have, or with the file.
        let searched = BLOCK_BYTES.min(bytes.len());
        let mut ends = memchr::memchr_iter(b'\n', &bytes).map(|at| at + 1);
        let (mut whole, mut end) = (0, 0);
        while end <= searched && whole < BLOCK_RECORDS {
            let Some(next) = ends.next() else { break };
            (whole, end) = (whole + 1, next);
        }
        let is_full = end > searched || whole == BLOCK_RECORDS;
        let end = match is_full {
            true => end,
            false if bytes.len() as u64 == left => bytes.len(),
            false => return Err(self.endless(whole as u64)),
        };
        let (bytes, first_line) = (self.file.bytes(self.at..self.at + end as u64)?, self.line);
        self.at += end as u64;
        self.line += whole as u64;
        let count = whole + usize::from(bytes.last() != Some(&b'\n'));
        Ok(Some(LineBlock { bytes, first_line, count }))
    }

    /// The next lines, but at most `limit` that are not blank; also how many those are.
    ///
    /// # Errors
    /// The same as [`LineCutter::next`].
    pub fn next_filled(&mut self, limit: u64) -> Result<Option<(LineBlock, u64)>> {
        let (at, first_line) = (self.at, self.line);
        let Some(block) = self.next()? else { return Ok(None) };
        let mut filled = 0;
        for (number, range) in lines(&block.bytes) {
            if filled == limit {
                // Hands the rest back.
                self.at = at + range.start as u64;
                self.line = first_line + number;
                let bytes = self.file.bytes(at..self.at)?;
                return Ok(Some((LineBlock { bytes, first_line, count: number as usize }, filled)));
            }
            filled += u64::from(!block.bytes[range].trim_ascii().is_empty());
        }
        Ok(Some((block, filled)))
    }

    fn endless(&self, lines_before: u64) -> Error {
        let place = format!("line {}", self.line + lines_before);
        Error::malformed(self.path(), place, format_args!("a line of at most {MAX_LINE} bytes"), "a longer one")
    }
}

/// The lines of `bytes` with their numbers counted from 0, without line ends.
pub fn lines(bytes: &[u8]) -> impl Iterator<Item = (u64, Range<usize>)> {
    let mut start = 0;
    let mut number = 0;
    std::iter::from_fn(move || {
        if start >= bytes.len() {
            return None;
        }
        let end = memchr::memchr(b'\n', &bytes[start..]).map_or(bytes.len(), |found| start + found);
        let text_end = if end > start && bytes[end - 1] == b'\r' { end - 1 } else { end };
        let item = (number, start..text_end);
        start = end + 1;
        number += 1;
        Some(item)
    })
}

/// How points are read of lines.
pub trait LineReading: Send + Sync {
    /// Appends the points of a block, and a record of attributes for each.
    ///
    /// # Errors
    /// [`Error::Malformed`] with the line.
    fn fill<C: Coordinate>(&self, block: &LineBlock, points: &mut Vec<[C; 3]>, attributes: &mut Vec<u8>) -> Result<()>;

    /// The most points that a block can have.
    fn most(&self, block: &LineBlock) -> usize {
        block.count
    }

    /// Bytes of a point's attributes.
    fn record(&self) -> usize;
}

/// Lines, and how points are read of them.
pub struct LinesRead<R> {
    /// The lines.
    pub block: LineBlock,
    /// How they are read.
    pub reading: Arc<R>,
}

impl<R: LineReading> Decode for LinesRead<R> {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        let Batch { points, attributes, .. } = batch;
        let most = self.reading.most(&self.block);
        points.reserve_exact(most);
        attributes.reserve_exact(most * self.reading.record());
        match points {
            Points::Single(points) => self.reading.fill(&self.block, points, attributes),
            Points::Double(points) => self.reading.fill(&self.block, points, attributes),
        }
    }
}

/// One pass over all lines to the end of the file.
pub struct AllLines<R> {
    /// The lines.
    pub lines: LineCutter,
    /// How they are read.
    pub reading: Arc<R>,
}

impl<'a, R: LineReading + 'a> BlockCutter<'a> for AllLines<R> {
    fn next(&mut self) -> Result<Option<Box<dyn Decode + 'a>>> {
        let Some(block) = self.lines.next()? else { return Ok(None) };
        Ok(Some(Box::new(LinesRead { block, reading: Arc::clone(&self.reading) })))
    }
}

/// The tokens of a line between spaces and tabs.
pub fn blanks(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|b| b.is_ascii_whitespace()).filter(|token| !token.is_empty())
}

/// The number a token spells, `nan` and `inf` included.
pub fn number(token: &[u8]) -> Option<f64> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// Text from a file as a message shows it: short, and without control characters.
pub fn quoted(text: &[u8]) -> String {
    const SHOWN: usize = 40;
    let cut = &text[..text.len().min(SHOWN)];
    format!("{:?}{}", String::from_utf8_lossy(cut), if text.len() > SHOWN { "…" } else { "" })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(content: &[u8]) -> Arc<Mapped> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("lines");
        std::fs::write(&path, content).unwrap();
        // The map outlives the name.
        crate::storage::mapped::Content::named(&path).open().unwrap()
    }

    #[test]
    fn blocks_are_whole_lines_and_numbered() {
        // Long lines, then short ones.
        let text = (1..=300_000).map(|i| if i < 200_000 { format!("{i} 1.5 2.5 3.5\r\n") } else { format!("{i} 1\n") });
        let text: String = text.collect();
        let mut cutter = LineCutter::new(file(text.as_bytes()), 0, 1);
        let (mut joined, mut blocks) = (Vec::new(), 0);
        while let Some(block) = cutter.next().unwrap() {
            let first = std::str::from_utf8(&block.bytes).unwrap().split(' ').next().unwrap();
            assert_eq!(first.parse::<u64>().unwrap(), block.first_line);
            assert_eq!(block.count, block.bytes.iter().filter(|byte| **byte == b'\n').count());
            assert!(block.count <= BLOCK_RECORDS && block.bytes.len() <= BLOCK_BYTES + 32);
            joined.extend_from_slice(&block.bytes);
            blocks += 1;
        }
        assert_eq!(joined, text.as_bytes());
        assert!(blocks > 4);
    }

    #[test]
    fn a_limit_counts_filled_lines_and_hands_the_rest_back() {
        let mut cutter = LineCutter::new(file(b"a\n\nb\r\n \nc\nd"), 0, 1);
        let (block, filled) = cutter.next_filled(2).unwrap().unwrap();
        assert_eq!((&*block.bytes, filled), (&b"a\n\nb\r\n"[..], 2));
        assert_eq!(cutter.line(), 4);
        let (block, filled) = cutter.next_filled(9).unwrap().unwrap();
        assert_eq!((&*block.bytes, filled), (&b" \nc\nd"[..], 2));
        assert!(cutter.next_filled(1).unwrap().is_none());
    }

    #[test]
    fn an_endless_line_is_an_error() {
        let mut content = b"1 2 3\n".to_vec();
        content.resize(BLOCK_BYTES + MAX_LINE + 10, b'7');
        let error = LineCutter::new(file(&content), 0, 1).next().err().unwrap().to_string();
        assert!(error.contains("line 2") && error.contains("65536"), "{error}");
    }

    #[test]
    fn lines_end_in_any_way() {
        let text = b"a\nb\r\n\nlast";
        let found: Vec<_> = lines(text).map(|(n, r)| (n, &text[r])).collect();
        assert_eq!(found, [(0, &b"a"[..]), (1, b"b"), (2, b""), (3, b"last")]);
    }
}
