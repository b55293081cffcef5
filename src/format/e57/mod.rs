//! E57 (ASTM E2807): scans with poses, cartesian or spherical, as other programs write them. Images are skipped, and so are extensions.
//!
//! ```text
//!  | header | section: packet packet packet … | section … | images | XML |     all in pages with checksums (paged.rs)
//!
//!  packet   | 1 | flags | length − 1: u16 | number of streams: u16 | their lengths: u16 … | stream | stream | … |
//!  stream   the numbers of one field, bit by bit without gaps, on and on from packet to packet
//!
//!  reader   packets -> streams -> the bits of so many records   (one thread, copies)
//!  jobs     bits -> numbers -> poses, attributes                (any thread)
//! ```
//!
//! The XML says what the fields are ([`scan::Scan`]). Records whose `cartesianInvalidState` (or `sphericalInvalidState`) is not 0 are no points: they are dropped, and
//! counted with those that are not finite. Colours that are integers from 0 to 255, or to 65535, stay as they are; others are spread from their limits over one of these;
//! a file has one kind. Intensities stay as they are.
//!
//! A scan was taken from where its pose puts the origin; [`scan::Place`] says which scans tell.

mod paged;
mod scan;
#[cfg(test)]
mod tests;
mod xml;

use std::sync::Arc;

use byteorder::{ByteOrder, LE};

use self::paged::Pages;
use self::scan::{Place, Reading, Scan};
use self::xml::Tree;
use super::records::same_length;
use crate::error::{Error, Result};
use crate::format::point_format::{BLOCK_BYTES, BLOCK_RECORDS, BlockCutter, Decode, PointFormat, Source};
use crate::points::attribute::{Attribute, Schema, Wanted};
use crate::points::crs::Crs;
use crate::points::scalar::Scalar;
use crate::points::{Batch, Coordinate, Points, Precision};
use crate::storage::mapped::{Content, Mapped};

/// Bytes of streams that are held while a scan is read: more than in any block, and what some may be ahead of others.
const MOST_AHEAD: usize = 4 << 20;

/// Whether a file that begins with these bytes is an E57 file.
pub fn is_e57(head: &[u8]) -> bool {
    head.starts_with(b"ASTM-E57")
}

/// Opens the E57 file.
///
/// # Errors
/// [`Error::Malformed`] if its header or XML is not as it should be.
pub fn open(content: &Content) -> Result<(Source, Arc<dyn PointFormat>)> {
    let (file, path) = (content.open()?, content.name());
    let wrong = |place: &str, expected: &dyn std::fmt::Display, found: &dyn std::fmt::Display| {
        Error::malformed(path, format_args!("E57 {place}"), expected, found)
    };
    let head = file.read(0..file.len().min(48))?;
    if head.len() < 48 {
        return Err(wrong("header", &"48 bytes", &format_args!("{} bytes", head.len())));
    }
    let [major, page] = [u64::from(LE::read_u32(&head[8..])), LE::read_u64(&head[40..])];
    if (major, page) != (1, 1024) {
        return Err(wrong(
            "header",
            &"version 1, pages of 1024 bytes",
            &format_args!("version {major}, pages of {page}"),
        ));
    }
    let [at, length] = [24, 32].map(|from| LE::read_u64(&head[from..]));
    if length > xml::MAX_TEXT {
        return Err(wrong("header", &format_args!("at most {} bytes of XML", xml::MAX_TEXT), &length));
    }
    let mut text = Vec::new();
    Pages::at(&file, at)?.read(length as usize, &mut text)?;
    let text = String::from_utf8_lossy(&text);
    let tree = Tree::parse(text.trim_end_matches('\0'))
        .map_err(|(at, found)| wrong(&format!("XML, byte {at}"), &"the description of scans", &found))?;
    let root = tree.root().child("e57Root").ok_or_else(|| wrong("XML", &"e57Root", &"none"))?;
    let mut scans = Vec::new();
    for (i, element) in root.child("data3D").into_iter().flat_map(|data| data.children()).enumerate() {
        let place = format!("XML, scan {i}");
        let scan = Scan::of(element).map_err(|found| wrong(&place, &"a scan", &found))?;
        if let Some(name) = scan.repeated() {
            return Err(wrong(&place, &"every field once", &format_args!("{name} twice")));
        }
        scans.push(scan);
    }
    // Where no scan of a file is moved, poses that move nothing were put there by programs that had none.
    if scans.iter().all(|scan| scan.place != Place::Told) {
        scans.iter_mut().filter(|scan| scan.place == Place::Unmoved).for_each(|scan| scan.place = Place::Unknown);
    }
    let attributes: Vec<Vec<Attribute>> = scans.iter().map(Scan::attributes).collect();
    let mut attributes = Wanted::All.of(attributes.iter().map(Vec::as_slice))?.attributes().to_vec();
    // A file whose scans have colours of both kinds has the wide one.
    let colour = |a: &&mut Attribute| ["red", "green", "blue"].contains(&a.name.as_str());
    let wide = attributes.iter_mut().filter(colour).fold(Scalar::U8, |wide, a| wide.union(a.scalar));
    attributes.iter_mut().filter(colour).for_each(|a| a.scalar = wide);

    let records = scans.iter().map(|scan| scan.records).fold(0, u64::saturating_add);
    let many = match scans.len() {
        1 => "1 scan".to_string(),
        many => format!("{many} scans"),
    };
    let crs = root.child("coordinateMetadata").and_then(|metadata| Crs::parse(metadata.text()));
    let source = Source {
        path: path.to_path_buf(),
        format: "E57",
        description: format!("E57, {many}"),
        records: Some(records),
        bytes: file.len(),
        crs,
        remark: None,
    };
    let (content, len) = (content.clone(), file.len());
    Ok((source, Arc::new(E57File { content, len, scans: scans.into(), attributes, wide })))
}

/// An E57 file.
#[derive(Debug)]
struct E57File {
    content: Content,
    /// The length the file had when it was looked at.
    len: u64,
    scans: Arc<[Scan]>,
    attributes: Vec<Attribute>,
    /// The type of colours.
    wide: Scalar,
}

impl PointFormat for E57File {
    fn precision(&self) -> Precision {
        self.scans.iter().map(Scan::precision).max().unwrap_or(Precision::Single)
    }

    fn attributes(&self) -> &[Attribute] {
        &self.attributes
    }

    fn stations(&self) -> Vec<[f64; 3]> {
        self.scans.iter().filter_map(Scan::station).collect()
    }

    fn cut(&self, schema: &Schema) -> Result<Box<dyn BlockCutter<'_> + '_>> {
        let file = self.content.open()?;
        same_length(&file, self.len)?;
        let (scans, schema) = (Arc::clone(&self.scans), schema.clone());
        Ok(Box::new(Cutter { file, scans, schema, wide: self.wide, next: 0, open: None }))
    }
}

/// One pass over an E57 file.
struct Cutter {
    file: Arc<Mapped>,
    scans: Arc<[Scan]>,
    schema: Schema,
    wide: Scalar,
    /// The scan that comes next, and the one that is read.
    next: usize,
    open: Option<Open>,
}

/// A scan that is read.
struct Open {
    pages: Pages,
    number: usize,
    left: u64,
    /// The most records of a block.
    most: u64,
    reading: Arc<Reading>,
    /// For each field that is needed, what was read of its stream and not given out.
    streams: Vec<Stream>,
    packet: Vec<u8>,
}

/// A part of the stream of a field.
#[derive(Debug, Clone, Default)]
struct Stream {
    bytes: Vec<u8>,
    /// Bits of the first byte that are given out.
    skip: usize,
    /// Bits of a number.
    bits: usize,
}

impl Stream {
    /// The whole numbers there are; as many as you like if they take no bits.
    fn numbers(&self) -> u64 {
        (self.bytes.len() * 8 - self.skip).checked_div(self.bits).map_or(u64::MAX, |numbers| numbers as u64)
    }

    /// Takes away so many numbers, which are there.
    fn take(&mut self, numbers: u64) -> Stream {
        let end = self.skip + self.bits * numbers as usize;
        let taken = Stream { bytes: self.bytes[..end.div_ceil(8)].to_vec(), ..*self };
        self.bytes.drain(..end / 8);
        self.skip = end % 8;
        taken
    }

    /// The bits of a number.
    fn number(&self, index: usize) -> u64 {
        if self.bits == 0 {
            return 0;
        }
        let bit = self.skip + index * self.bits;
        let (from, to) = (bit / 8, (bit + self.bits).div_ceil(8));
        let mut word = [0; 16];
        word[..to - from].copy_from_slice(&self.bytes[from..to]);
        (u128::from_le_bytes(word) >> (bit % 8)) as u64 & (u64::MAX >> (64 - self.bits))
    }
}

impl Cutter {
    /// Starts with a scan.
    fn start(&self, number: usize) -> Result<Open> {
        let scan = &self.scans[number];
        let reading = scan.reading(&self.schema, self.wide);
        let bits = |&(field, _): &(usize, _)| Stream { bits: scan.bits(field), ..Stream::default() };
        let streams: Vec<Stream> = reading.fields.iter().map(bits).collect();
        let row: usize = streams.iter().map(|stream| stream.bits).sum();
        let wrong = |expected: &dyn std::fmt::Display, found: &dyn std::fmt::Display| {
            Error::malformed(self.file.path(), format_args!("scan {number}"), expected, found)
        };
        // Such records would be made of nothing, as many as the header claims.
        if row == 0 && scan.records > BLOCK_RECORDS as u64 {
            return Err(wrong(&"coordinates that differ", &format_args!("{} times the same", scan.records)));
        }
        let mut packet = Vec::new();
        let mut pages = Pages::at(&self.file, scan.at)?;
        pages.read(32, &mut packet)?;
        if packet[0] != 1 {
            return Err(wrong(&"a section of points (1)", &packet[0]));
        }
        let pages = Pages::at(&self.file, LE::read_u64(&packet[16..]))?;
        let most = (BLOCK_BYTES * 8).checked_div(row).unwrap_or(BLOCK_RECORDS).clamp(1, BLOCK_RECORDS) as u64;
        Ok(Open { pages, number, left: scan.records, most, reading: Arc::new(reading), streams, packet })
    }
}

impl Open {
    /// Takes in a packet.
    fn more(&mut self, file: &Mapped, fields: usize) -> Result<()> {
        let place = format!("scan {}, {} records before its end", self.number, self.left);
        let wrong = |expected: &dyn std::fmt::Display, found: &dyn std::fmt::Display| {
            Error::malformed(file.path(), &place, expected, found)
        };
        let Open { pages, packet, streams, reading, .. } = self;
        pages.read(4, packet)?;
        let (kind, length) = (packet[0], usize::from(LE::read_u16(&packet[2..])) + 1);
        if kind > 2 || length % 4 != 0 {
            return Err(wrong(&"a packet", &format_args!("kind {kind} of {length} bytes")));
        }
        pages.read(length - 4, packet)?;
        if kind != 1 {
            return Ok(());
        }
        let count = packet.get(..2).map_or(0, |count| usize::from(LE::read_u16(count)));
        let (heads, lengths) = (2 + 2 * count, packet.get(2..2 + 2 * count).unwrap_or_default());
        let lengths: Vec<usize> = lengths.chunks_exact(2).map(|length| usize::from(LE::read_u16(length))).collect();
        let whole = heads + lengths.iter().sum::<usize>();
        if lengths.len() != fields || whole > packet.len() {
            let found = format_args!("{count} streams of {whole} bytes in {}", packet.len()).to_string();
            return Err(wrong(&format_args!("{fields} streams within the packet"), &found));
        }
        let mut held = 0;
        for (stream, &(field, _)) in streams.iter_mut().zip(&reading.fields) {
            let from = heads + lengths[..field].iter().sum::<usize>();
            // Fields that take no bits have no need of any.
            if stream.bits > 0 {
                stream.bytes.extend_from_slice(&packet[from..from + lengths[field]]);
            }
            held += stream.bytes.len();
        }
        if held > MOST_AHEAD {
            return Err(wrong(&"streams that keep step", &format_args!("some that are {held} bytes ahead")));
        }
        Ok(())
    }
}

impl<'a> BlockCutter<'a> for Cutter {
    fn next(&mut self) -> Result<Option<Box<dyn Decode + 'a>>> {
        loop {
            let Some(open) = self.open.as_mut().filter(|open| open.left > 0) else {
                if self.next == self.scans.len() {
                    return Ok(None);
                }
                self.open = Some(self.start(self.next)?);
                self.next += 1;
                continue;
            };
            let records = open.streams.iter().map(Stream::numbers).min().unwrap_or(0).min(open.left).min(open.most);
            // A block is worth a job if it is at least half of what it might be.
            if records < open.left && records < open.most.div_ceil(2) {
                open.more(&self.file, self.scans[open.number].fields())?;
                continue;
            }
            open.left -= records;
            let streams = open.streams.iter_mut().map(|stream| stream.take(records)).collect();
            return Ok(Some(Box::new(Block {
                streams,
                records: records as usize,
                reading: Arc::clone(&open.reading),
                station: self.scans[open.number].station(),
            })));
        }
    }
}

/// Records that are not decoded.
struct Block {
    streams: Vec<Stream>,
    records: usize,
    reading: Arc<Reading>,
    station: Option<[f64; 3]>,
}

impl Block {
    fn points<C: Coordinate>(&self, points: &mut Vec<[C; 3]>, attributes: &mut Vec<u8>) {
        let mut bits = vec![0; self.streams.len()];
        points.extend((0..self.records).map(|i| {
            bits.iter_mut().zip(&self.streams).for_each(|(bits, stream)| *bits = stream.number(i));
            self.reading.point::<C>(&bits, attributes)
        }));
    }
}

impl Decode for Block {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        let Batch { points, attributes, .. } = batch;
        match points {
            Points::Single(points) => self.points(points, attributes),
            Points::Double(points) => self.points(points, attributes),
        }
        Ok(())
    }

    fn station(&self) -> Option<[f64; 3]> {
        self.station
    }
}
