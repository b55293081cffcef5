//! PLY vertices as text, one a line.

use std::path::PathBuf;
use std::sync::Arc;

use super::super::lines::{LineBlock, LineCutter, lines, number, quoted};
use super::super::mapped::Mapped;
use super::super::records::{drop_non_finite, same_length};
use super::super::text::blanks;
use super::super::{BLOCK_RECORDS, BlockCutter, Decode, PointFormat};
use super::header::PropertyKind;
use crate::error::{Error, Result};
use crate::points::{Batch, Coordinate, Points, Precision};

/// The vertices of an ASCII file.
#[derive(Debug)]
pub struct AsciiVertices {
    /// The file.
    pub path: PathBuf,
    /// Its length when the header was read.
    pub len: u64,
    /// Where the data begins, and the number of its first line.
    pub start: u64,
    /// See `start`.
    pub first_line: u64,
    /// Lines of other elements before the vertices.
    pub lines_before: u64,
    /// Vertices the header promises.
    pub count: u64,
    /// What a line holds.
    pub shape: Arc<LineShape>,
}

/// What stands on the line of a vertex.
#[derive(Debug)]
pub struct LineShape {
    /// The file, for messages.
    pub path: PathBuf,
    /// The properties in order.
    pub kinds: Vec<PropertyKind>,
    /// Which of them are x, y and z: numbers, not lists.
    pub coordinates: [usize; 3],
    /// The coordinates' precision.
    pub precision: Precision,
}

impl LineShape {
    /// The coordinates on a line, or what was expected and found instead.
    fn parse<'a>(&self, line: &'a [u8]) -> std::result::Result<[f64; 3], (&'static str, &'a [u8])> {
        let mut tokens = blanks(line);
        let mut next = |expected| tokens.next().ok_or((expected, &b"the end of the line"[..]));
        let mut point = [0.0; 3];
        let mut missing = 3;
        for (index, kind) in self.kinds.iter().enumerate() {
            let token = next("a value for each property")?;
            if let PropertyKind::List { .. } = kind {
                let wrong = ("the length of a list", token);
                let count: u64 = std::str::from_utf8(token).ok().and_then(|t| t.parse().ok()).ok_or(wrong)?;
                // Ends with the line, whatever the count.
                for _ in 0..count {
                    next("the values of a list")?;
                }
            } else if let Some(axis) = self.coordinates.iter().position(|&c| c == index) {
                point[axis] = number(token).ok_or((["x, a number", "y, a number", "z, a number"][axis], token))?;
                missing -= 1;
                if missing == 0 {
                    break;
                }
            }
        }
        Ok(point)
    }
}

impl PointFormat for AsciiVertices {
    fn precision(&self) -> Precision {
        self.shape.precision
    }

    fn cut(&self) -> Result<Box<dyn BlockCutter>> {
        let file = Mapped::open(&self.path)?;
        same_length(&file, self.len)?;
        let mut lines = LineCutter::new(file, self.start, self.first_line);
        let mut before = self.lines_before;
        while before > 0 {
            let Some((_, filled)) = lines.next_filled(before)? else { break };
            before -= filled;
        }
        Ok(Box::new(AsciiCutter { lines, left: self.count, count: self.count, shape: Arc::clone(&self.shape) }))
    }
}

struct AsciiCutter {
    lines: LineCutter,
    left: u64,
    count: u64,
    shape: Arc<LineShape>,
}

impl BlockCutter for AsciiCutter {
    fn next(&mut self) -> Result<Option<Box<dyn Decode>>> {
        if self.left == 0 {
            return Ok(None);
        }
        let Some((lines, filled)) = self.lines.next_filled(self.left.min(BLOCK_RECORDS as u64))? else {
            return Err(Error::malformed(
                self.lines.path(),
                format_args!("line {}", self.lines.line()),
                format_args!("{} vertices", self.count),
                format_args!("the end of the file after {}", self.count - self.left),
            ));
        };
        self.left -= filled;
        Ok(Some(Box::new(AsciiBlock { lines, shape: Arc::clone(&self.shape) })))
    }
}

struct AsciiBlock {
    lines: LineBlock,
    shape: Arc<LineShape>,
}

impl AsciiBlock {
    fn fill<C: Coordinate>(&self, points: &mut Vec<[C; 3]>) -> Result<u64> {
        for (number_of_line, range) in lines(&self.lines.bytes) {
            let line = self.lines.bytes[range].trim_ascii();
            if line.is_empty() {
                continue;
            }
            let point = self.shape.parse(line).map_err(|(expected, found)| {
                let place = format!("line {}", self.lines.first_line + number_of_line);
                Error::malformed(&self.shape.path, place, expected, quoted(found))
            })?;
            points.push(point.map(C::from_f64));
        }
        Ok(drop_non_finite(points, 0))
    }
}

impl Decode for AsciiBlock {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        batch.dropped = match &mut batch.points {
            Points::Single(points) => self.fill(points)?,
            Points::Double(points) => self.fill(points)?,
        };
        Ok(())
    }
}
