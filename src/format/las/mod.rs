//! LAS 1.0 to 1.4 and LAZ, all point formats; a COPC file is a LAZ file.
//!
//! ```text
//!  LAS  | header | VLRs | record record record …                                  | EVLRs |
//!  LAZ  | header | VLRs | table's place | chunk | chunk | … | table of the chunks | EVLRs |
//! ```
//!
//! A coordinate is the stored integer times the scale plus the offset, in `f64` and rounded twice, as other programs do it; so the nearest integer to
//! (coordinate − offset) / scale is the stored one.
//! Attributes keep the types that the file has: 16-bit colours stay 16-bit, and a scan angle is in degrees (`i8`) in point formats up to 5, in steps of 0.006
//! degrees (`i16`) from 6 on. Extra bytes go by their names, as `f64` where they have a scale or offset.

mod extra;
pub(crate) mod fields;
pub(crate) mod header;
pub(crate) mod partial;
#[cfg(test)]
mod tests;
pub(crate) mod window;
pub(crate) mod write;

use std::sync::Arc;

use self::fields::{Decoding, Field};
use self::header::Header;
use super::records::{Transform, same_length};
use super::unpack::Unpacking;
use crate::error::{Error, Result};
use crate::format::laz::{self, pieces};
use crate::format::options::InputOptions;
use crate::format::point_format::{BlockCutter, Decode, PointFormat, Source, Uncounted, records_of_a_block};
use crate::points::attribute::{Attribute, Schema, Wanted};
use crate::points::filter::Sieve;
use crate::points::{Batch, Precision};
use crate::storage::mapped::{Bytes, Content, Mapped};

/// Whether a file that begins with these bytes is a LAS or LAZ file.
pub fn is_las(head: &[u8]) -> bool {
    head.starts_with(b"LASF")
}

/// Opens the LAS or LAZ file. LAZ is decompressed now, if there is somebody to do it for all passes, and room for it.
///
/// # Errors
/// [`Error::Malformed`] if its header is not as it should be, or it holds fewer points than it says; those of unpacking.
pub fn open(
    content: &Content,
    options: &InputOptions,
    unpacking: &mut Unpacking,
) -> Result<(Source, Arc<dyn PointFormat>)> {
    let (file, path) = (content.open()?, content.name());
    let header = Header::read(&file)?;
    let Header { minor, point_format, record, count, transform, .. } = header;
    let packing = if header.compressed {
        Packing::Laz(laz::Packed::open(&file, &header)?)
    } else {
        let whole = (file.len() - header.start) / record as u64;
        if whole < count {
            let expected = format_args!("{count} points of {record} bytes from byte {} on", header.start).to_string();
            return Err(Error::malformed(
                path,
                "length",
                expected,
                format_args!("{whole} points, then the file's end"),
            ));
        }
        Packing::Plain
    };
    let (format, packed) = match &packing {
        Packing::Plain => ("LAS", String::new()),
        Packing::Laz(packed) => ("LAZ", packed.to_string()),
    };
    let [x, y, z] = transform.scale;
    let scale = if x == y && y == z { x.to_string() } else { format!("{x}, {y}, {z}") };
    let source = Source {
        path: path.to_path_buf(),
        format,
        description: format!("{format} 1.{minor}, point format {point_format}, in steps of {scale}{packed}"),
        records: Some(count),
        bytes: file.len(),
        crs: header.crs,
        remark: None,
    };
    let attributes = header.fields.iter().map(|field| field.attribute.clone()).collect();
    let (content, len, start, fields) = (content.clone(), file.len(), header.start, header.fields);
    let las = LasFile { content, len, start, count, record, transform, fields, attributes, packing };
    Ok((source, Arc::new(las.unpacked(options, unpacking)?)))
}

/// A LAS or LAZ file.
#[derive(Debug)]
struct LasFile {
    content: Content,
    /// The length the file had when it was looked at.
    len: u64,
    /// Where the points begin.
    start: u64,
    /// Number of points.
    count: u64,
    /// Bytes of a point's record.
    record: usize,
    transform: Transform,
    fields: Vec<Field>,
    attributes: Vec<Attribute>,
    packing: Packing,
}

/// How the points lie in the file.
#[derive(Debug)]
enum Packing {
    /// Record by record.
    Plain,
    /// Compressed.
    Laz(Arc<laz::Packed>),
}

impl LasFile {
    /// The same points without compression, if several passes over them are to come and there is room.
    fn unpacked(self, options: &InputOptions, unpacking: &mut Unpacking) -> Result<LasFile> {
        let Packing::Laz(packed) = &self.packing else { return Ok(self) };
        if self.content.absent().is_some() {
            return Ok(self);
        }
        let Some(workers) = unpacking.for_all_passes(self.count.saturating_mul(self.record as u64))? else {
            return Ok(self);
        };
        let kept = match options.attributes {
            Wanted::None => {
                let is_looked_at = |name: &str| options.looked_at.contains(&name) || options.seen_from.looks_at(name);
                let looked_at = self.attributes.iter().filter(|there| is_looked_at(&there.name));
                looked_at.fold(Schema::default(), |schema, attribute| schema.with(attribute))
            }
            _ => Wanted::All.of([&*self.attributes])?,
        };
        let decoded = Sieve::new(&options.filter, kept, [&*self.attributes].into_iter()).decoded;
        let cutter = self.pieces(packed, &decoded)?;
        let content = pieces::unpack(cutter, workers, unpacking)?;
        let len = content.unmapped()?.len();
        Ok(LasFile { content, len, start: 0, packing: Packing::Plain, ..self })
    }

    /// One pass over what is compressed, for the attributes of `schema`.
    fn pieces(&self, packed: &Arc<laz::Packed>, schema: &Schema) -> Result<pieces::Cutter> {
        pieces::Cutter::new(self.opened()?, Arc::clone(packed), self.count, laz::selection(&self.fields, schema))
    }

    fn opened(&self) -> Result<Arc<Mapped>> {
        let file = self.content.open()?;
        same_length(&file, self.len)?;
        Ok(file)
    }
}

impl PointFormat for LasFile {
    fn precision(&self) -> Precision {
        Precision::Double
    }

    fn attributes(&self) -> &[Attribute] {
        &self.attributes
    }

    fn lent_from(&self) -> Option<&Content> {
        // What is decompressed is the block's own.
        matches!(self.packing, Packing::Plain).then_some(&self.content)
    }

    fn cut(&self, schema: &Schema) -> Result<Box<dyn BlockCutter<'_> + '_>> {
        let decoding = Arc::new(Decoding::new(self.record, self.transform, &self.fields, schema));
        Ok(match &self.packing {
            Packing::Plain if self.content.absent().is_some() => Box::new(Nowhere { left: self.count }),
            Packing::Plain => Box::new(Cutter { file: self.opened()?, at: self.start, left: self.count, decoding }),
            Packing::Laz(packed) => Box::new(pieces::Blocks { cutter: self.pieces(packed, schema)?, decoding }),
        })
    }
}

struct Cutter {
    file: Arc<Mapped>,
    at: u64,
    left: u64,
    decoding: Arc<Decoding>,
}

impl<'a> BlockCutter<'a> for Cutter {
    fn next(&mut self) -> Result<Option<Box<dyn Decode + 'a>>> {
        if self.left == 0 {
            return Ok(None);
        }
        let records = self.left.min(records_of_a_block(self.decoding.record()));
        let end = self.at + records * self.decoding.record() as u64;
        let bytes = self.file.bytes(self.at..end)?;
        self.at = end;
        self.left -= records;
        Ok(Some(Box::new(Block { bytes, decoding: Arc::clone(&self.decoding) })))
    }
}

/// Points that are not there, as none of them counts.
struct Nowhere {
    left: u64,
}

impl<'a> BlockCutter<'a> for Nowhere {
    fn next(&mut self) -> Result<Option<Box<dyn Decode + 'a>>> {
        let points = std::mem::take(&mut self.left);
        Ok((points > 0).then(|| Box::new(Uncounted(points)) as Box<dyn Decode + 'a>))
    }
}

struct Block {
    bytes: Bytes,
    decoding: Arc<Decoding>,
}

impl Decode for Block {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        self.decoding.decode(&self.bytes, batch);
        Ok(())
    }
}
