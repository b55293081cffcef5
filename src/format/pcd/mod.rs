//! PCD files, as the Point Cloud Library writes them: text, binary and compressed, versions .5 to .7.
//!
//! ```text
//!  # .PCD v0.7 - Point Cloud Data file format
//!  VERSION 0.7
//!  FIELDS x y z rgb            COLUMNS in old files
//!  SIZE 4 4 4 4                4 if there is no such line
//!  TYPE F F F F                I, U or F; F if there is no such line
//!  COUNT 1 1 1 1               1 if there is no such line
//!  WIDTH 640
//!  HEIGHT 480                  more than 1: rows of a depth image, with NaN where nothing was seen
//!  VIEWPOINT 0 0 0 1 0 0 0
//!  POINTS 307200
//!  DATA binary                 ascii, binary or binary_compressed
//! ```
//!
//! `VIEWPOINT` says where the sensor was. It does not move points: nor does it in the Point Cloud Library. Fields of several numbers (descriptors) and padding
//! are passed over. `rgb` and `rgba`, a colour packed into four bytes, become red, green and blue (and alpha).
//!
//! Compressed data is one LZF stream of columns: it is unpacked once, to temporary disk, and read from there by blocks.

use std::path::Path;
use std::sync::Arc;

use super::columns::{Columns, Stretched};
use super::lines::{lines, quoted};
use super::lzf::{LONGEST, Lzf};
use super::records::{FixedRecords, RecordShape};
use super::rows::{Item, RowShape, Rows};
use super::unpack::Unpacking;
use crate::error::{Error, Result};
use crate::format::point_format::{BLOCK_BYTES, PointFormat, Source};
use crate::points::Precision;
use crate::points::attribute::Attribute;
use crate::points::scalar::{Column, Endian, Scalar};
use crate::storage::mapped::{Content, Mapped};

/// The longest header accepted, in bytes.
const MAX_HEADER: u64 = 64 << 10;

/// The longest record accepted, in bytes: descriptors have some thousands.
const MAX_RECORD: usize = 64 << 10;

/// Whether a file that begins like this is a PCD file.
pub fn is_pcd(head: &[u8]) -> bool {
    if head.starts_with(b"# .PCD") {
        return true;
    }
    let mut statements = lines(head).map(|(_, range)| head[range].trim_ascii()).filter(|l| is_statement(l));
    let first = statements.next().unwrap_or_default();
    let fields = |line: &[u8]| line.starts_with(b"FIELDS ") || line.starts_with(b"COLUMNS ");
    if first.starts_with(b"VERSION ") {
        statements.any(fields)
    } else {
        fields(first) && statements.any(|l| l.starts_with(b"DATA "))
    }
}

fn is_statement(line: &[u8]) -> bool {
    !line.is_empty() && !line.starts_with(b"#")
}

/// One field of a record.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Field {
    name: String,
    size: usize,
    count: usize,
    /// `None` for sizes that no number has: padding.
    scalar: Option<Scalar>,
}

impl Field {
    fn bytes(&self) -> usize {
        self.size * self.count
    }

    /// Whether it says nothing.
    fn is_padding(&self) -> bool {
        self.name == "_"
    }

    /// Whether it is a colour in four bytes.
    fn is_packed(&self) -> bool {
        ["rgb", "rgba"].contains(&self.name.as_str()) && self.size == 4 && self.count == 1 && self.scalar.is_some()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Data {
    Ascii,
    Binary,
    Compressed,
}

#[derive(Debug, PartialEq, Eq)]
struct Header {
    fields: Vec<Field>,
    points: u64,
    data: Data,
    /// Bytes and lines of the header.
    len: u64,
    lines: u64,
}

/// Opens a PCD file.
///
/// # Errors
/// [`Error::Malformed`] if the header is wrong, has no x, y and z, or promises more than the file holds; if compressed data is damaged. Those of unpacking.
pub fn open(content: &Content, unpacking: &mut Unpacking) -> Result<(Source, Arc<dyn PointFormat>)> {
    let file = content.unmapped()?;
    let path = file.path();
    let header = Header::parse(path, &file.read(0..file.len().min(MAX_HEADER))?)?;
    let coordinates = header.coordinates(path)?;
    let precision = coordinates.iter().map(|c| c.scalar.precision()).max().unwrap_or(Precision::Double);
    let (format, encoding): (Arc<dyn PointFormat>, &str) = match header.data {
        Data::Ascii => (Arc::new(rows(&file, &header, precision)), "ASCII"),
        Data::Binary => (Arc::new(records(&file, &header, coordinates)?), "binary"),
        Data::Compressed => (Arc::new(columns(&file, header.stored(), unpacking)?), "compressed"),
    };
    let precision = match precision {
        Precision::Single => "single",
        Precision::Double => "double",
    };
    let source = Source {
        path: path.to_path_buf(),
        format: "PCD",
        description: format!("PCD {encoding}, {} points in {precision} precision", header.points),
        records: Some(header.points),
        bytes: file.len(),
        crs: None,
        remark: None,
    };
    Ok((source, format))
}

impl Header {
    fn parse(path: &Path, head: &[u8]) -> Result<Header> {
        let mut names: Option<Vec<String>> = None;
        let (mut sizes, mut types, mut counts) = (None, None, None);
        let (mut width, mut height, mut points) = (None, None, None);
        for (number, range) in lines(head) {
            let line = &head[range.clone()];
            let wrong =
                |expected: &str| Error::malformed(path, format!("header line {}", number + 1), expected, quoted(line));
            if !is_statement(line.trim_ascii()) {
                continue;
            }
            let text = std::str::from_utf8(line).map_err(|_| wrong("text"))?;
            let mut words = text.split_ascii_whitespace();
            let word = words.next().unwrap_or_default();
            let numbers = |words: std::str::SplitAsciiWhitespace| words.map(|w| w.parse::<usize>().ok()).collect();
            let number_of = |mut words: std::str::SplitAsciiWhitespace| {
                words.next().and_then(|w| w.parse::<u64>().ok()).ok_or_else(|| wrong("a number behind the word"))
            };
            match word {
                "VERSION" | "VIEWPOINT" => {}
                "FIELDS" | "COLUMNS" => names = Some(words.map(str::to_string).collect()),
                "SIZE" => {
                    let all: Option<Vec<usize>> = numbers(words);
                    sizes = Some(all.ok_or_else(|| wrong("SIZE and the bytes of each field"))?);
                }
                "COUNT" => {
                    let all: Option<Vec<usize>> = numbers(words);
                    counts = Some(all.ok_or_else(|| wrong("COUNT and the numbers of each field"))?);
                }
                "TYPE" => types = Some(words.map(str::to_string).collect::<Vec<_>>()),
                "WIDTH" => width = Some(number_of(words)?),
                "HEIGHT" => height = Some(number_of(words)?),
                "POINTS" => points = Some(number_of(words)?),
                "DATA" => {
                    let data = match words.next() {
                        Some("ascii") => Data::Ascii,
                        Some("binary") => Data::Binary,
                        Some("binary_compressed") => Data::Compressed,
                        _ => return Err(wrong("DATA and ascii, binary or binary_compressed")),
                    };
                    // The line must be ended: what follows is data.
                    let end = memchr::memchr(b'\n', &head[range.end..]).map(|found| range.end + found + 1);
                    let len = end.ok_or_else(|| wrong("a line end behind DATA"))? as u64;
                    let names = names.ok_or_else(|| wrong("FIELDS before DATA"))?;
                    let fields = fields(names, sizes, types, counts)
                        .map_err(|(expected, found)| Error::malformed(path, "header", expected, found))?;
                    let points = total(points, width, height)
                        .map_err(|(expected, found)| Error::malformed(path, "header", expected, found))?;
                    return Ok(Header { fields, points, data, len, lines: number + 1 });
                }
                _ => return Err(wrong("a line of a PCD header")),
            }
        }
        let found =
            if head.len() as u64 == MAX_HEADER { "a header of more than 64 KiB" } else { "the end of the file" };
        Err(Error::malformed(path, "header", "a line DATA", found))
    }

    /// Bytes of a point.
    fn stride(&self) -> usize {
        self.fields.iter().map(Field::bytes).sum()
    }

    /// The header of what compressed files hold, which is no padding.
    fn stored(&self) -> Header {
        let fields = self.fields.iter().filter(|field| !field.is_padding()).cloned().collect();
        Header { fields, ..*self }
    }

    /// The fields that are one number, each with the bytes before it and with its index.
    fn numbers(&self) -> impl Iterator<Item = (usize, &Field, Column)> {
        let mut offset = 0;
        let place = move |(index, field): (usize, &'_ Field)| {
            let column = field.scalar.filter(|_| field.count == 1).map(|scalar| Column { offset, scalar });
            offset += field.bytes();
            (index, column)
        };
        let placed: Vec<(usize, Option<Column>)> = self.fields.iter().enumerate().map(place).collect();
        placed.into_iter().filter_map(|(index, column)| Some((index, &self.fields[index], column?)))
    }

    /// Where x, y and z lie in a record.
    fn coordinates(&self, path: &Path) -> Result<[Column; 3]> {
        let mut found = [Column { offset: 0, scalar: Scalar::F32 }; 3];
        for (place, axis) in found.iter_mut().zip(["x", "y", "z"]) {
            let column = self.numbers().find(|(_, field, _)| field.name == axis).map(|(.., column)| column);
            *place = column.ok_or_else(|| {
                let names: Vec<&str> = self.fields.iter().map(|f| f.name.as_str()).take(20).collect();
                Error::malformed(path, "header", format_args!("a field {axis} of one number"), names.join(" "))
            })?;
        }
        Ok(found)
    }

    /// The other numbers: attribute, field, and where it lies in a record; of those of one name, the first.
    fn attributes(&self) -> Vec<(Attribute, Place)> {
        let mut out: Vec<(Attribute, Place)> = Vec::new();
        let mut add = |attribute: Attribute, place: Place| {
            if out.iter().all(|(known, _)| known.name != attribute.name) {
                out.push((attribute, place));
            }
        };
        for (field, own, column) in self.numbers() {
            if own.is_padding() || ["x", "y", "z"].contains(&own.name.as_str()) {
                continue;
            }
            if !own.is_packed() {
                add(Attribute::new(&own.name, column.scalar), Place { field, part: None, column });
                continue;
            }
            let parts = if own.name == "rgba" { 4 } else { 3 };
            for (part, (name, byte)) in
                [("red", 2), ("green", 1), ("blue", 0), ("alpha", 3)].into_iter().take(parts).enumerate()
            {
                let column = Column { offset: column.offset + byte, scalar: Scalar::U8 };
                add(Attribute::new(name, Scalar::U8), Place { field, part: Some(part), column });
            }
        }
        out
    }
}

/// Where an attribute is found.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Its field.
    field: usize,
    /// Which part of a packed field it is.
    part: Option<usize>,
    /// Where it lies in a binary record.
    column: Column,
}

type Wrong = (String, String);

fn fields(
    names: Vec<String>,
    sizes: Option<Vec<usize>>,
    types: Option<Vec<String>>,
    counts: Option<Vec<usize>>,
) -> std::result::Result<Vec<Field>, Wrong> {
    let all = names.len();
    let sizes = sizes.unwrap_or_else(|| vec![4; all]);
    let types = types.unwrap_or_else(|| vec!["F".to_string(); all]);
    let counts = counts.unwrap_or_else(|| vec![1; all]);
    for (word, len) in [("SIZE", sizes.len()), ("TYPE", types.len()), ("COUNT", counts.len())] {
        if len != all {
            return Err((format!("as many words behind {word} as FIELDS, {all}"), len.to_string()));
        }
    }
    let mut out = Vec::new();
    let mut record = 0usize;
    for (((name, size), kind), count) in names.into_iter().zip(sizes).zip(types).zip(counts) {
        let scalar = match (kind.as_str(), size) {
            ("I", 1) => Some(Scalar::I8),
            ("I", 2) => Some(Scalar::I16),
            ("I", 4) => Some(Scalar::I32),
            ("I", 8) => Some(Scalar::I64),
            ("U", 1) => Some(Scalar::U8),
            ("U", 2) => Some(Scalar::U16),
            ("U", 4) => Some(Scalar::U32),
            ("U", 8) => Some(Scalar::U64),
            ("F", 4) => Some(Scalar::F32),
            ("F", 8) => Some(Scalar::F64),
            (_, 1..) if name == "_" => None,
            _ => {
                let expected = "type I or U with size 1, 2, 4 or 8, or F with size 4 or 8".to_string();
                return Err((
                    expected,
                    format!("field {} of type {} and size {size}", quoted(name.as_bytes()), quoted(kind.as_bytes())),
                ));
            }
        };
        record = size
            .checked_mul(count)
            .and_then(|bytes| record.checked_add(bytes))
            .filter(|r| *r <= MAX_RECORD)
            .ok_or_else(|| (format!("a point of at most {MAX_RECORD} bytes"), "a longer one".to_string()))?;
        out.push(Field { name, size, count, scalar });
    }
    Ok(out)
}

/// The number of points that the header claims.
fn total(points: Option<u64>, width: Option<u64>, height: Option<u64>) -> std::result::Result<u64, Wrong> {
    let area = match (width, height) {
        (Some(width), height) => Some(width.checked_mul(height.unwrap_or(1)).ok_or_else(|| {
            ("WIDTH and HEIGHT of a cloud".to_string(), format!("{width} by {}", height.unwrap_or(1)))
        })?),
        (None, _) => None,
    };
    match (points, area) {
        (Some(points), Some(area)) if points != area => {
            Err((format!("as many POINTS as WIDTH times HEIGHT, {area}"), points.to_string()))
        }
        (Some(points), _) => Ok(points),
        (None, Some(area)) => Ok(area),
        (None, None) => Err(("a line POINTS or WIDTH".to_string(), "neither".to_string())),
    }
}

fn rows(file: &Mapped, header: &Header, precision: Precision) -> Rows {
    // A field of several numbers is as many items.
    let (mut items, mut firsts) = (Vec::new(), Vec::new());
    for field in &header.fields {
        firsts.push(items.len());
        let item = match field.scalar {
            Some(scalar) if field.is_packed() => Item::Packed(scalar),
            _ => Item::Number,
        };
        items.resize(items.len() + field.count, item);
    }
    let first =
        |name: &str| header.numbers().find(|(_, field, _)| field.name == name).map_or(0, |(index, ..)| firsts[index]);
    let attributes: Vec<(Attribute, usize)> = header
        .attributes()
        .into_iter()
        .map(|(attribute, place)| (attribute, place.part.map_or(firsts[place.field], |part| items.len() + part)))
        .collect();
    Rows {
        len: file.len(),
        start: header.len,
        first_line: header.lines + 1,
        lines_before: 0,
        count: header.points,
        attributes: attributes.iter().map(|(attribute, _)| attribute.clone()).collect(),
        shape: Arc::new(RowShape {
            content: file.content().clone(),
            points: "points",
            coordinates: ["x", "y", "z"].map(first),
            items,
            attributes,
            precision,
        }),
    }
}

fn records(file: &Mapped, header: &Header, coordinates: [Column; 3]) -> Result<FixedRecords> {
    let stride = header.stride();
    let whole = file.len().saturating_sub(header.len) / stride as u64;
    if whole < header.points {
        let expected = format!("{} points of {stride} bytes", header.points);
        let found = format!("the end of the file after {} bytes", file.len());
        return Err(Error::malformed(file.path(), format_args!("point {whole}"), expected, found));
    }
    let attributes =
        header.attributes().into_iter().map(|(attribute, place)| (attribute, place.column.offset)).collect();
    let shape = RecordShape { stride, coordinates, endian: Endian::Little, transform: None, attributes };
    Ok(FixedRecords::new(file, header.len, header.points, shape))
}

/// Unpacks the columns.
fn columns(file: &Mapped, header: Header, unpacking: &mut Unpacking) -> Result<Columns> {
    let path = file.path();
    let start = header.len + 8;
    if file.len() < start {
        let found = format!("the end of the file after {} bytes", file.len());
        return Err(Error::malformed(path, format_args!("byte {}", header.len), "two lengths of 4 bytes", found));
    }
    let lengths = file.read(header.len..start)?;
    let length = |at: usize| u64::from(u32::from_le_bytes([0, 1, 2, 3].map(|i| lengths[at + i])));
    let (packed, unpacked) = (length(0), length(4));
    let place = format!("byte {}", header.len);
    let stride = header.stride() as u64;
    if header.points.checked_mul(stride) != Some(unpacked) {
        let expected = format!("{} points of {stride} bytes", header.points);
        return Err(Error::malformed(path, place, expected, format_args!("{unpacked} bytes, once unpacked")));
    }
    if file.len() - start < packed {
        let found = format!("the end of the file after {} bytes", file.len());
        return Err(Error::malformed(path, place, format_args!("{packed} bytes, compressed"), found));
    }
    let content = unpack(file, start..start + packed, unpacked, unpacking)?;
    // Where a number lies in its field is the same in records and in columns.
    let stretched = |field: usize, column: Column| {
        let before: usize = header.fields[..field].iter().map(Field::bytes).sum();
        let start = before as u64 * header.points + (column.offset - before) as u64;
        Stretched { start, pitch: header.fields[field].size, scalar: column.scalar }
    };
    let axis = |name: &str| {
        let found = header.numbers().find(|(_, field, _)| field.name == name);
        let (field, _, column) = found.expect("the header was seen to have all coordinates");
        stretched(field, column)
    };
    let own = header.attributes().into_iter().map(|(a, place)| (a, stretched(place.field, place.column))).collect();
    Ok(Columns::new(&content.unmapped()?, header.points, Endian::Little, ["x", "y", "z"].map(axis), own))
}

/// Unpacks the LZF stream in `range`, which gives `unpacked` bytes.
fn unpack(file: &Mapped, range: std::ops::Range<u64>, unpacked: u64, unpacking: &mut Unpacking) -> Result<Content> {
    let damaged = |at: u64, expected: &str, found: &str| {
        Error::malformed(file.path(), format_args!("byte {at}"), expected, found)
    };
    let mut stretch = unpacking.begin()?;
    let mut lzf = Lzf::default();
    let (mut at, mut left) = (range.start, unpacked);
    while at < range.end {
        let piece = file.read(at..range.end.min(at + BLOCK_BYTES as u64))?;
        let last = at + piece.len() as u64 == range.end;
        let mut used = 0;
        // A token that may be cut by the piece's end is left for the next piece.
        while used < piece.len() && (last || piece.len() - used >= LONGEST) {
            let here = at + used as u64;
            let before = lzf.waiting() as u64;
            match lzf.token(&piece[used..]) {
                Ok(Some(token)) => used += token,
                Ok(None) => return Err(damaged(here, "a whole token of LZF", "the end of the compressed data")),
                Err(_) => return Err(damaged(here, "a copy of bytes that are there", "one of bytes before the first")),
            }
            let new = lzf.waiting() as u64 - before;
            if new > left {
                return Err(damaged(here, &format!("{unpacked} bytes, once unpacked"), "more"));
            }
            left -= new;
            lzf.hand_on(false, |bytes| stretch.append(bytes))?;
        }
        at += used as u64;
    }
    if left > 0 {
        return Err(damaged(at, &format!("{unpacked} bytes, once unpacked"), &format!("{left} less")));
    }
    lzf.hand_on(true, |bytes| stretch.append(bytes))?;
    Ok(stretch.finish(file.path()))
}

#[cfg(test)]
mod tests;
