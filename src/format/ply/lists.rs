//! Binary PLY rows with lists, whose lengths vary: found by walking from row to row.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::super::records::same_length;
use super::header::{Element, PropertyKind};
use crate::error::{Error, Result};
use crate::format::point_format::{BLOCK_BYTES, BLOCK_RECORDS, BlockCutter, Decode, PointFormat};
use crate::points::attribute::{Attribute, Placing, Schema};
use crate::points::scalar::{Endian, Reader, reader};
use crate::points::{Batch, Coordinate, Points, Precision};
use crate::storage::mapped::{Bytes, Content, Mapped};

/// How to walk along a row.
#[derive(Debug)]
pub struct ListShape {
    path: PathBuf,
    element: String,
    steps: Vec<Step>,
    kinds: Vec<PropertyKind>,
}

/// One property of a row.
#[derive(Debug, Clone, Copy)]
enum Step {
    Number { bytes: usize, read: Reader },
    List { count_bytes: usize, read_count: Reader, item_bytes: usize },
}

/// What a walk along a row came to.
enum Walk {
    /// The row's length.
    Row(usize),
    /// The bytes end within the row.
    Cut,
    /// A list's length is not a whole number of this range.
    BadCount(f64),
}

impl ListShape {
    /// The rows of `element`.
    pub fn new(path: &Path, element: &Element, endian: Endian) -> ListShape {
        let kinds: Vec<PropertyKind> = element.properties.iter().map(|p| p.kind).collect();
        let step = |kind: &PropertyKind| match *kind {
            PropertyKind::Number(scalar) => Step::Number { bytes: scalar.bytes(), read: reader(scalar, endian) },
            PropertyKind::List { count, item } => {
                Step::List { count_bytes: count.bytes(), read_count: reader(count, endian), item_bytes: item.bytes() }
            }
        };
        let steps = kinds.iter().map(step).collect();
        ListShape { path: path.to_path_buf(), element: element.name.clone(), steps, kinds }
    }

    /// Walks along the row at the beginning of `bytes` and shows every single number with the index of its property.
    fn walk(&self, bytes: &[u8], mut number: impl FnMut(usize, f64)) -> Walk {
        let mut at = 0usize;
        for (index, step) in self.steps.iter().enumerate() {
            let rest = &bytes[at..];
            let len = match *step {
                Step::Number { bytes, read } => {
                    if rest.len() < bytes {
                        return Walk::Cut;
                    }
                    number(index, read(rest));
                    bytes
                }
                Step::List { count_bytes, read_count, item_bytes } => {
                    if rest.len() < count_bytes {
                        return Walk::Cut;
                    }
                    let count = read_count(rest);
                    if !(0.0..=f64::from(u32::MAX)).contains(&count) || count.fract() != 0.0 {
                        return Walk::BadCount(count);
                    }
                    count_bytes + count as usize * item_bytes
                }
            };
            if len > rest.len() {
                return Walk::Cut;
            }
            at += len;
        }
        Walk::Row(at)
    }

    /// The lengths of the next rows, up to `limit`, that lie whole in the next block from `at` on: their number and
    /// bytes. `row` is the number of the first, for messages.
    fn measure(&self, file: &Arc<Mapped>, at: u64, row: u64, limit: u64) -> Result<(u64, u64)> {
        let window = file.bytes(at..file.len().min(at + BLOCK_BYTES as u64))?;
        let (mut rows, mut end) = (0, 0);
        while rows < limit {
            let (expected, found) = match self.walk(&window[end..], |_, _| {}) {
                Walk::Row(len) => {
                    rows += 1;
                    end += len;
                    continue;
                }
                Walk::Cut if rows > 0 => break,
                Walk::Cut if at + window.len() as u64 == file.len() => {
                    ("a whole row".to_string(), format!("the end of the file after {} bytes", file.len()))
                }
                Walk::Cut => (format!("a row of at most {BLOCK_BYTES} bytes"), "a longer one".to_string()),
                Walk::BadCount(count) => ("the length of a list".to_string(), count.to_string()),
            };
            let place = format!("{} {}", self.element, row + rows);
            return Err(Error::malformed(&self.path, place, expected, found));
        }
        Ok((rows, end as u64))
    }
}

/// Where the rows of `element` end that begin at `start`.
///
/// # Errors
/// [`Error::Malformed`] if the file ends before.
pub fn skip(file: &Arc<Mapped>, element: &Element, start: u64, endian: Endian) -> Result<u64> {
    if let Some(size) = element.fixed_size() {
        let end = element.count.checked_mul(size).and_then(|bytes| start.checked_add(bytes));
        return end.filter(|&end| end <= file.len()).ok_or_else(|| {
            let expected = format!("{} rows of {size} bytes", element.count);
            Error::malformed(file.path(), &element.name, expected, format_args!("a file of {} bytes", file.len()))
        });
    }
    let shape = ListShape::new(file.path(), element, endian);
    let (mut at, mut row) = (start, 0);
    while row < element.count {
        let (rows, bytes) = shape.measure(file, at, row, element.count - row)?;
        at += bytes;
        row += rows;
    }
    Ok(at)
}

/// Vertices with lists.
#[derive(Debug)]
pub struct ListRecords {
    content: Content,
    len: u64,
    start: u64,
    count: u64,
    shape: Arc<ListShape>,
    coordinates: [usize; 3],
    own: Vec<(Attribute, usize)>,
    attributes: Vec<Attribute>,
}

impl ListRecords {
    /// `count` rows from byte `start` on; `coordinates` are the indices of x, y and z among their properties, `own` the attributes and theirs.
    pub fn new(
        file: &Mapped,
        start: u64,
        count: u64,
        shape: ListShape,
        coordinates: [usize; 3],
        own: Vec<(Attribute, usize)>,
    ) -> ListRecords {
        let attributes = own.iter().map(|(attribute, _)| attribute.clone()).collect();
        ListRecords {
            content: file.content().clone(),
            len: file.len(),
            start,
            count,
            shape: Arc::new(shape),
            coordinates,
            own,
            attributes,
        }
    }
}

impl PointFormat for ListRecords {
    fn precision(&self) -> Precision {
        let numbers = self.coordinates.iter().filter_map(|&index| self.shape.kinds[index].number());
        numbers.map(|scalar| scalar.precision()).max().unwrap_or(Precision::Double)
    }

    fn attributes(&self) -> &[Attribute] {
        &self.attributes
    }

    fn cut(&self, schema: &Schema) -> Result<Box<dyn BlockCutter<'_> + '_>> {
        let file = self.content.open()?;
        same_length(&file, self.len)?;
        let (at, count) = (self.start, self.count);
        Ok(Box::new(ListCutter {
            file,
            at,
            row: 0,
            count,
            shape: Arc::clone(&self.shape),
            coordinates: self.coordinates,
            placing: Arc::new(Placing::new(schema, &self.own)),
        }))
    }
}

struct ListCutter {
    file: Arc<Mapped>,
    at: u64,
    row: u64,
    count: u64,
    shape: Arc<ListShape>,
    coordinates: [usize; 3],
    placing: Arc<Placing>,
}

impl<'a> BlockCutter<'a> for ListCutter {
    fn next(&mut self) -> Result<Option<Box<dyn Decode + 'a>>> {
        if self.row == self.count {
            return Ok(None);
        }
        let limit = (self.count - self.row).min(BLOCK_RECORDS as u64);
        let (rows, len) = self.shape.measure(&self.file, self.at, self.row, limit)?;
        let bytes = self.file.bytes(self.at..self.at + len)?;
        self.at += len;
        self.row += rows;
        let (shape, placing) = (Arc::clone(&self.shape), Arc::clone(&self.placing));
        Ok(Some(Box::new(ListBlock { bytes, shape, coordinates: self.coordinates, placing })))
    }
}

struct ListBlock {
    /// Whole rows.
    bytes: Bytes,
    shape: Arc<ListShape>,
    coordinates: [usize; 3],
    placing: Arc<Placing>,
}

impl ListBlock {
    fn fill<C: Coordinate>(&self, points: &mut Vec<[C; 3]>, attributes: &mut Vec<u8>) {
        let mut rest = &*self.bytes;
        let mut values = vec![0.0; self.shape.kinds.len()];
        while !rest.is_empty() {
            // The cutter measured whole rows; if another program changes the file meanwhile, the block ends here.
            let Walk::Row(len) = self.shape.walk(rest, |index, value| values[index] = value) else { break };
            points.push(self.coordinates.map(|index| C::from_f64(values[index])));
            self.placing.place(&values, attributes);
            rest = &rest[len..];
        }
    }
}

impl Decode for ListBlock {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        let Batch { points, attributes, .. } = batch;
        match points {
            Points::Single(points) => self.fill(points, attributes),
            Points::Double(points) => self.fill(points, attributes),
        }
        Ok(())
    }
}
