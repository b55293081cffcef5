//! Points as rows of text, a line each, with a header that tells their columns and number: PLY and PCD.

use std::sync::Arc;

use super::lines::{LineBlock, LineCutter, LineReading, LinesRead, blanks, lines, number, quoted};
use super::records::same_length;
use crate::error::{Error, Result};
use crate::format::point_format::{BLOCK_RECORDS, BlockCutter, Decode, PointFormat};
use crate::points::attribute::{Attribute, Placing, Schema};
use crate::points::scalar::Scalar;
use crate::points::{Coordinate, Precision};
use crate::storage::mapped::Content;

/// The rows of a file.
#[derive(Debug)]
pub struct Rows {
    /// Its length when the header was read.
    pub len: u64,
    /// Where the data begins, and the number of its first line.
    pub start: u64,
    /// See `start`.
    pub first_line: u64,
    /// Lines of other tables before the points.
    pub lines_before: u64,
    /// Points the header promises.
    pub count: u64,
    /// What a line holds.
    pub shape: Arc<RowShape>,
    /// The attributes among that.
    pub attributes: Vec<Attribute>,
}

/// What stands on a point's line.
#[derive(Debug)]
pub struct RowShape {
    /// The file.
    pub content: Content,
    /// What its format calls points.
    pub points: &'static str,
    /// The items in order.
    pub items: Vec<Item>,
    /// Which of them are x, y and z: numbers.
    pub coordinates: [usize; 3],
    /// Which of the values are attributes: a value for each item, then [`PACKED`] more.
    pub attributes: Vec<(Attribute, usize)>,
    /// The coordinates' precision.
    pub precision: Precision,
}

/// An item of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Item {
    /// A number.
    Number,
    /// A count, then that many numbers.
    List,
    /// A number whose four bytes, of the type given, are blue, green, red and alpha.
    Packed(Scalar),
}

/// What a packed item holds besides: behind the items' values come red, green, blue and alpha.
pub const PACKED: usize = 4;

impl RowShape {
    /// Reads the numbers of a line that are coordinates or have a place to `values`; or tells what was expected and found instead.
    fn parse<'a>(
        &self,
        line: &'a [u8],
        placing: &Placing,
        values: &mut [f64],
    ) -> std::result::Result<(), (String, &'a [u8])> {
        let mut tokens = blanks(line);
        let mut next = |expected: &str| tokens.next().ok_or((expected.to_string(), &b"the end of the line"[..]));
        let last = self.coordinates.into_iter().chain(placing.last()).max().unwrap_or(0);
        let unpacked = self.items.len()..self.items.len() + PACKED;
        for (index, item) in self.items.iter().enumerate().take(last + 1) {
            let token = next("a value for each property")?;
            if *item == Item::List {
                let wrong = || ("the length of a list".to_string(), token);
                let count: u64 = std::str::from_utf8(token).ok().and_then(|t| t.parse().ok()).ok_or_else(wrong)?;
                // Ends with the line, whatever the count.
                for _ in 0..count {
                    next("the values of a list")?;
                }
            } else if let Some(axis) = self.coordinates.iter().position(|&c| c == index) {
                values[index] = number(token).ok_or_else(|| (format!("{}, a number", ["x", "y", "z"][axis]), token))?;
            } else if let Item::Packed(scalar) = *item {
                if unpacked.clone().any(|index| placing.wants(index)) {
                    let colours = colours(token, scalar).ok_or_else(|| ("a packed colour".to_string(), token))?;
                    values[unpacked.clone()].copy_from_slice(&colours);
                }
            } else if placing.wants(index) {
                values[index] = number(token).ok_or_else(|| ("a number".to_string(), token))?;
            }
        }
        Ok(())
    }
}

/// Red, green, blue and alpha of a packed colour.
fn colours(token: &[u8], scalar: Scalar) -> Option<[f64; PACKED]> {
    let text = std::str::from_utf8(token).ok()?;
    let bits = match scalar {
        // Of a number that is not one, the text does not tell which.
        Scalar::F32 => text.parse().ok().map(|v: f32| if v.is_nan() { 0 } else { v.to_bits() })?,
        _ => text.parse().ok().or_else(|| text.parse().ok().map(|v: i32| v as u32))?,
    };
    let [blue, green, red, alpha] = bits.to_le_bytes().map(f64::from);
    Some([red, green, blue, alpha])
}

impl PointFormat for Rows {
    fn precision(&self) -> Precision {
        self.shape.precision
    }

    fn attributes(&self) -> &[Attribute] {
        &self.attributes
    }

    fn lent_from(&self) -> Option<&Content> {
        Some(&self.shape.content)
    }

    fn cut(&self, schema: &Schema) -> Result<Box<dyn BlockCutter<'_> + '_>> {
        let file = self.shape.content.open()?;
        same_length(&file, self.len)?;
        let mut lines = LineCutter::new(file, self.start, self.first_line);
        let mut before = self.lines_before;
        while before > 0 {
            let Some((_, filled)) = lines.next_filled(before)? else { break };
            before -= filled;
        }
        let shape = Arc::clone(&self.shape);
        let placing = Placing::new(schema, &shape.attributes);
        let reading = Arc::new(Reading { shape, placing });
        Ok(Box::new(RowCutter { lines, left: self.count, count: self.count, reading }))
    }
}

/// What is read of every row.
struct Reading {
    shape: Arc<RowShape>,
    placing: Placing,
}

struct RowCutter {
    lines: LineCutter,
    left: u64,
    count: u64,
    reading: Arc<Reading>,
}

impl<'a> BlockCutter<'a> for RowCutter {
    fn next(&mut self) -> Result<Option<Box<dyn Decode + 'a>>> {
        if self.left == 0 {
            return Ok(None);
        }
        let Some((block, filled)) = self.lines.next_filled(self.left.min(BLOCK_RECORDS as u64))? else {
            return Err(Error::malformed(
                self.lines.path(),
                format_args!("line {}", self.lines.line()),
                format_args!("{} {}", self.count, self.reading.shape.points),
                format_args!("the end of the file after {}", self.count - self.left),
            ));
        };
        self.left -= filled;
        Ok(Some(Box::new(LinesRead { block, reading: Arc::clone(&self.reading) })))
    }
}

impl LineReading for Reading {
    fn fill<C: Coordinate>(&self, block: &LineBlock, points: &mut Vec<[C; 3]>, attributes: &mut Vec<u8>) -> Result<()> {
        let mut values = vec![0.0; self.shape.items.len() + PACKED];
        for (number_of_line, range) in lines(&block.bytes) {
            let line = block.bytes[range].trim_ascii();
            if line.is_empty() {
                continue;
            }
            self.shape.parse(line, &self.placing, &mut values).map_err(|(expected, found)| {
                let place = format!("line {}", block.first_line + number_of_line);
                Error::malformed(self.shape.content.name(), place, expected, quoted(found))
            })?;
            points.push(self.shape.coordinates.map(|index| C::from_f64(values[index])));
            self.placing.place(&values, attributes);
        }
        Ok(())
    }

    fn record(&self) -> usize {
        self.placing.stride()
    }
}
