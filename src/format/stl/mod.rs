//! STL files: the three corners of every facet are points. Corners that facets share come several times, which does no harm.
//!
//! ```text
//!  80 bytes of anything | count: u32 | facet | facet | …        facet: normal, three corners: 12 × f32; two bytes of anything
//! ```
//!
//! Binary files have no signature; their length, which is what the count makes it, tells them. Files of text are read statement by statement.

use std::sync::Arc;

use super::records::same_length;
use super::statements::{Statements, first_word};
use crate::error::{Error, Result};
use crate::format::point_format::{BLOCK_BYTES, BlockCutter, Decode, PointFormat, Source};
use crate::points::attribute::{Attribute, Schema};
use crate::points::scalar::{Endian, Scalar, reader};
use crate::points::{Batch, Coordinate, Points, Precision};
use crate::storage::mapped::{Bytes, Content, Mapped};

const HEADER: u64 = 84;
const FACET: usize = 50;

/// The bytes of a facet before its corners.
const NORMAL: usize = 12;

/// The end of a text that is searched for `endsolid NAME`.
const TAIL: u64 = 4096;

/// Whether a file of length `len` that begins like this is a binary STL file: its length is what its count makes it.
pub fn is_binary(head: &[u8], len: u64) -> bool {
    facets(head).is_some_and(|facets| facets > 0 && len == HEADER + facets * FACET as u64)
}

/// Whether text that begins like this is STL.
pub fn is_text(head: &[u8]) -> bool {
    first_word(head, b"solid") && head.split(|&b| b == b'\n').skip(1).any(|line| first_word(line, b"facet"))
}

fn facets(head: &[u8]) -> Option<u64> {
    let count = head.get(80..84)?;
    Some(u64::from(u32::from_le_bytes([count[0], count[1], count[2], count[3]])))
}

/// Opens a file that is binary STL, or should be.
///
/// # Errors
/// [`Error::Malformed`] if its length is not what its count makes it.
pub fn open_binary(content: &Content) -> Result<(Source, Arc<dyn PointFormat>)> {
    let file = content.unmapped()?;
    let head = file.read(0..file.len().min(HEADER))?;
    let expected = match facets(&head) {
        Some(facets) if file.len() == HEADER + facets * FACET as u64 => {
            let source = Source {
                path: content.name().to_path_buf(),
                format: "STL",
                description: format!("STL binary, the corners of {facets} facets"),
                records: Some(3 * facets),
                bytes: file.len(),
                crs: None,
                remark: None,
            };
            return Ok((source, Arc::new(Facets { content: content.clone(), len: file.len(), facets })));
        }
        Some(facets) => format!("{} bytes for its {facets} facets", HEADER + facets * FACET as u64),
        None => format!("a header of {HEADER} bytes, or text that begins with \"solid\""),
    };
    Err(Error::malformed(file.path(), "length", expected, format_args!("{} bytes", file.len())))
}

/// Opens a file of text.
///
/// # Errors
/// [`Error::Malformed`] if it does not end like one.
pub fn open_text(content: &Content) -> Result<(Source, Arc<dyn PointFormat>)> {
    let file = content.unmapped()?;
    let tail = file.read(file.len().saturating_sub(TAIL)..file.len())?;
    let last = tail.trim_ascii_end().rsplit(|&b| b == b'\n').next().unwrap_or_default();
    if !first_word(last, b"endsolid") {
        return Err(Error::malformed(file.path(), "the last line", "endsolid", super::lines::quoted(last)));
    }
    let source = Source {
        path: content.name().to_path_buf(),
        format: "STL",
        description: "STL ASCII, the corners of its facets".to_string(),
        records: None,
        bytes: file.len(),
        crs: None,
        remark: None,
    };
    Ok((source, Arc::new(Statements::new(&file, b"vertex", Vec::new()))))
}

#[derive(Debug)]
struct Facets {
    content: Content,
    len: u64,
    facets: u64,
}

impl PointFormat for Facets {
    fn precision(&self) -> Precision {
        Precision::Single
    }

    fn attributes(&self) -> &[Attribute] {
        &[]
    }

    fn cut(&self, schema: &Schema) -> Result<Box<dyn BlockCutter<'_> + '_>> {
        let file = self.content.open()?;
        same_length(&file, self.len)?;
        Ok(Box::new(FacetCutter { file, at: HEADER, left: self.facets, record: schema.stride() }))
    }
}

struct FacetCutter {
    file: Arc<Mapped>,
    at: u64,
    left: u64,
    record: usize,
}

impl<'a> BlockCutter<'a> for FacetCutter {
    fn next(&mut self) -> Result<Option<Box<dyn Decode + 'a>>> {
        if self.left == 0 {
            return Ok(None);
        }
        let facets = self.left.min((BLOCK_BYTES / FACET) as u64);
        let end = self.at + facets * FACET as u64;
        let bytes = self.file.bytes(self.at..end)?;
        self.at = end;
        self.left -= facets;
        Ok(Some(Box::new(FacetBlock { bytes, record: self.record })))
    }
}

struct FacetBlock {
    bytes: Bytes,
    /// Bytes of a point's attributes, of which the file has none.
    record: usize,
}

impl FacetBlock {
    fn fill<C: Coordinate>(&self, points: &mut Vec<[C; 3]>) {
        let read = reader(Scalar::F32, Endian::Little);
        for facet in self.bytes.chunks_exact(FACET) {
            let corners = facet[NORMAL..NORMAL + 36].chunks_exact(12);
            points.extend(corners.map(|corner| [0, 4, 8].map(|at| C::from_f64(read(&corner[at..])))));
        }
    }
}

impl Decode for FacetBlock {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        match &mut batch.points {
            Points::Single(points) => self.fill(points),
            Points::Double(points) => self.fill(points),
        }
        batch.attributes.resize(batch.points.len() * self.record, 0);
        Ok(())
    }
}

pub(crate) mod mesh;
#[cfg(test)]
mod tests;
pub(crate) mod write;
