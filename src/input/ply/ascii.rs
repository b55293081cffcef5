//! PLY vertices as text, one a line.

use std::path::PathBuf;
use std::sync::Arc;

use super::super::lines::{LineBlock, LineCutter, lines, number, quoted};
use super::super::mapped::Mapped;
use super::super::records::same_length;
use super::super::text::blanks;
use super::super::{BLOCK_RECORDS, BlockCutter, Decode, PointFormat};
use super::header::PropertyKind;
use crate::attribute::{Attribute, Placing, Schema};
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
    /// The attributes among that.
    pub attributes: Vec<Attribute>,
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
    /// Which of them are attributes.
    pub attributes: Vec<(Attribute, usize)>,
    /// The coordinates' precision.
    pub precision: Precision,
}

impl LineShape {
    /// Reads the numbers of a line that are coordinates or have a place to `values`, of which there is one for each property; or tells what was
    /// expected and found instead.
    fn parse<'a>(
        &self,
        line: &'a [u8],
        placing: &Placing,
        values: &mut [f64],
    ) -> std::result::Result<(), (String, &'a [u8])> {
        let mut tokens = blanks(line);
        let mut next = |expected: &str| tokens.next().ok_or((expected.to_string(), &b"the end of the line"[..]));
        let last = self.coordinates.into_iter().chain(placing.last()).max().unwrap_or(0);
        for (index, kind) in self.kinds.iter().enumerate().take(last + 1) {
            let token = next("a value for each property")?;
            if let PropertyKind::List { .. } = kind {
                let wrong = || ("the length of a list".to_string(), token);
                let count: u64 = std::str::from_utf8(token).ok().and_then(|t| t.parse().ok()).ok_or_else(wrong)?;
                // Ends with the line, whatever the count.
                for _ in 0..count {
                    next("the values of a list")?;
                }
            } else if let Some(axis) = self.coordinates.iter().position(|&c| c == index) {
                values[index] = number(token).ok_or_else(|| (format!("{}, a number", ["x", "y", "z"][axis]), token))?;
            } else if placing.wants(index) {
                values[index] = number(token).ok_or_else(|| ("a number".to_string(), token))?;
            }
        }
        Ok(())
    }
}

impl PointFormat for AsciiVertices {
    fn precision(&self) -> Precision {
        self.shape.precision
    }

    fn attributes(&self) -> &[Attribute] {
        &self.attributes
    }

    fn cut(&self, schema: &Schema) -> Result<Box<dyn BlockCutter>> {
        let file = Mapped::open(&self.path)?;
        same_length(&file, self.len)?;
        let mut lines = LineCutter::new(file, self.start, self.first_line);
        let mut before = self.lines_before;
        while before > 0 {
            let Some((_, filled)) = lines.next_filled(before)? else { break };
            before -= filled;
        }
        let (shape, count) = (Arc::clone(&self.shape), self.count);
        let placing = Arc::new(Placing::new(schema, &shape.attributes));
        Ok(Box::new(AsciiCutter { lines, left: count, count, shape, placing }))
    }
}

struct AsciiCutter {
    lines: LineCutter,
    left: u64,
    count: u64,
    shape: Arc<LineShape>,
    placing: Arc<Placing>,
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
        let (shape, placing) = (Arc::clone(&self.shape), Arc::clone(&self.placing));
        Ok(Some(Box::new(AsciiBlock { lines, shape, placing })))
    }
}

struct AsciiBlock {
    lines: LineBlock,
    shape: Arc<LineShape>,
    placing: Arc<Placing>,
}

impl AsciiBlock {
    fn fill<C: Coordinate>(&self, points: &mut Vec<[C; 3]>, attributes: &mut Vec<u8>) -> Result<()> {
        let mut values = vec![0.0; self.shape.kinds.len()];
        for (number_of_line, range) in lines(&self.lines.bytes) {
            let line = self.lines.bytes[range].trim_ascii();
            if line.is_empty() {
                continue;
            }
            self.shape.parse(line, &self.placing, &mut values).map_err(|(expected, found)| {
                let place = format!("line {}", self.lines.first_line + number_of_line);
                Error::malformed(&self.shape.path, place, expected, quoted(found))
            })?;
            points.push(self.shape.coordinates.map(|index| C::from_f64(values[index])));
            self.placing.place(&values, attributes);
        }
        Ok(())
    }
}

impl Decode for AsciiBlock {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        let Batch { points, attributes, .. } = batch;
        match points {
            Points::Single(points) => self.fill(points, attributes),
            Points::Double(points) => self.fill(points, attributes),
        }
    }
}
