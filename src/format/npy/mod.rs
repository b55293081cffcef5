//! NPY files, as NumPy writes them with `save`: arrays (n, 3 or more), and arrays of records with fields x, y and z.
//!
//! ```text
//!  \x93NUMPY | version: 2 bytes | length of the header: u16, from version 2 on u32 | header, a Python literal | data
//!  {'descr': '<f4', 'fortran_order': False, 'shape': (1000, 3), }
//!  {'descr': [('x', '<f8'), ('y', '<f8'), ('z', '<f8'), ('intensity', '<u2')], 'fortran_order': False, 'shape': (1000,), }
//! ```
//!
//! Of an array of numbers the last axis counts: its first three are x, y and z; others have no names, and are passed over. The axes before it (rows of a depth
//! image) make no difference. In Fortran order the numbers lie in columns.

use std::sync::Arc;

use super::columns::{Columns, Stretched};
use super::lines::quoted;
use super::records::{FixedRecords, RecordShape};
use crate::error::{Error, Result};
use crate::format::point_format::{PointFormat, Source};
use crate::points::attribute::Attribute;
use crate::points::scalar::{Column, Endian, Scalar};
use crate::storage::mapped::{Content, Mapped};

/// What every file begins with.
pub const SIGNATURE: &[u8] = b"\x93NUMPY";

/// The longest header accepted, in bytes.
const MAX_HEADER: u64 = 256 << 10;

/// Most numbers in a row of an array: wider ones are most likely (3, n).
const MAX_COLUMNS: u64 = 64;

/// The longest record accepted, in bytes.
const MAX_RECORD: usize = 64 << 10;

/// How deep lists and tuples may be nested: a type, its fields, their shapes.
const MAX_DEPTH: usize = 16;

/// Opens an NPY file.
///
/// # Errors
/// [`Error::Malformed`] if the header is wrong, the array holds no points, or the file is shorter than it promises.
pub fn open(content: &Content) -> Result<(Source, Arc<dyn PointFormat>)> {
    let file = content.unmapped()?;
    let path = file.path();
    let (header, start) = header(&file)?;
    let array = Array::of(&header).map_err(|(expected, found)| Error::malformed(path, "header", expected, found))?;
    let Array { count, stride, .. } = array;
    let whole = (file.len() - start) / stride as u64;
    if whole < count {
        let expected = format!("{count} points of {stride} bytes");
        let found = format!("the end of the file after {} bytes", file.len());
        return Err(Error::malformed(path, format_args!("point {whole}"), expected, found));
    }
    let source = Source {
        path: path.to_path_buf(),
        format: "NPY",
        description: format!("NPY {}, {count} points", array.description),
        records: Some(count),
        bytes: file.len(),
        crs: None,
        remark: None,
    };
    let Array { endian, coordinates, attributes, by_columns, .. } = array;
    if by_columns {
        let stretched = |column: Column| {
            let pitch = column.scalar.bytes();
            Stretched { start: start + column.offset as u64 * count, pitch, scalar: column.scalar }
        };
        return Ok((source, Arc::new(Columns::new(&file, count, endian, coordinates.map(stretched), Vec::new()))));
    }
    let shape = RecordShape { stride, coordinates, endian, transform: None, attributes };
    Ok((source, Arc::new(FixedRecords::new(&file, start, count, shape))))
}

/// The header's text, and where the data begins.
fn header(file: &Mapped) -> Result<(Literal, u64)> {
    let path = file.path();
    let short = |at: u64, expected: &str| {
        Error::malformed(
            path,
            format_args!("byte {at}"),
            expected,
            format_args!("the end of the file after {} bytes", file.len()),
        )
    };
    let head = file.read(0..file.len().min(12))?;
    let (start, len) = match head[SIGNATURE.len().min(head.len())..] {
        [1, _, a, b, ..] => (10, u64::from(u16::from_le_bytes([a, b]))),
        [2 | 3, _, a, b, c, d] => (12, u64::from(u32::from_le_bytes([a, b, c, d]))),
        [] | [1..=3, ..] => return Err(short(6, "a version and the length of the header")),
        [version, ..] => return Err(Error::malformed(path, "byte 6", "version 1, 2 or 3", version)),
    };
    if len > MAX_HEADER {
        return Err(Error::malformed(path, "byte 8", "a header of at most 256 KiB", format_args!("{len} bytes")));
    }
    let end = start + len;
    if end > file.len() {
        return Err(short(start, &format!("a header of {len} bytes")));
    }
    let text = file.read(start..end)?;
    let literal = Literal::read(&text).map_err(|at| {
        let found = quoted(&text[at.min(text.len())..]);
        Error::malformed(path, format_args!("byte {}", start + at as u64), "a literal of Python", found)
    })?;
    Ok((literal, end))
}

/// A value as Python writes it.
#[derive(Debug, Clone, PartialEq)]
enum Literal {
    Text(String),
    Whole(u64),
    Word(String),
    /// A list or a tuple.
    Items(Vec<Literal>),
    Dictionary(Vec<(Literal, Literal)>),
}

impl Literal {
    /// Reads a literal with nothing but blanks behind it; or says where it is wrong.
    fn read(text: &[u8]) -> std::result::Result<Literal, usize> {
        let mut reader = LiteralReader { text, at: 0 };
        let literal = reader.literal(0)?;
        reader.blanks();
        if reader.at == text.len() { Ok(literal) } else { Err(reader.at) }
    }

    fn get(&self, key: &str) -> Option<&Literal> {
        let Literal::Dictionary(entries) = self else { return None };
        entries.iter().find(|(k, _)| *k == Literal::Text(key.to_string())).map(|(_, value)| value)
    }
}

struct LiteralReader<'a> {
    text: &'a [u8],
    at: usize,
}

impl LiteralReader<'_> {
    fn blanks(&mut self) {
        self.at += self.text[self.at..].iter().take_while(|b| b.is_ascii_whitespace()).count();
    }

    /// The next byte that is no blank.
    fn peek(&mut self) -> Option<u8> {
        self.blanks();
        self.text.get(self.at).copied()
    }

    /// Goes past `byte` if it comes next.
    fn passes(&mut self, byte: u8) -> bool {
        let there = self.peek() == Some(byte);
        self.at += usize::from(there);
        there
    }

    fn run(&mut self, of: impl Fn(&u8) -> bool) -> String {
        let start = self.at;
        self.at += self.text[start..].iter().take_while(|b| of(b)).count();
        String::from_utf8_lossy(&self.text[start..self.at]).into_owned()
    }

    fn literal(&mut self, depth: usize) -> std::result::Result<Literal, usize> {
        let start = self.at;
        if depth > MAX_DEPTH {
            return Err(start);
        }
        match self.peek() {
            Some(quote @ (b'\'' | b'"')) => {
                self.at += 1;
                // Names with quotes or backslashes are no names of coordinates.
                let text = self.run(|b| *b != quote && *b != b'\\');
                if self.passes(quote) { Ok(Literal::Text(text)) } else { Err(self.at) }
            }
            Some(b'0'..=b'9') => {
                let digits = self.run(u8::is_ascii_digit);
                // Python 2 wrote long numbers so.
                self.passes(b'L');
                digits.parse().map(Literal::Whole).map_err(|_| start)
            }
            Some(b'(' | b'[') => {
                self.at += 1;
                let mut items = Vec::new();
                loop {
                    if self.passes(b')') || self.passes(b']') {
                        return Ok(Literal::Items(items));
                    }
                    items.push(self.literal(depth + 1)?);
                    self.passes(b',');
                }
            }
            Some(b'{') => {
                self.at += 1;
                let mut entries = Vec::new();
                loop {
                    if self.passes(b'}') {
                        return Ok(Literal::Dictionary(entries));
                    }
                    let key = self.literal(depth + 1)?;
                    if !self.passes(b':') {
                        return Err(self.at);
                    }
                    entries.push((key, self.literal(depth + 1)?));
                    self.passes(b',');
                }
            }
            Some(b) if b.is_ascii_alphabetic() => Ok(Literal::Word(self.run(u8::is_ascii_alphanumeric))),
            _ => Err(self.at),
        }
    }
}

/// How points lie in the data.
#[derive(Debug, PartialEq)]
struct Array {
    count: u64,
    /// Bytes of a point.
    stride: usize,
    endian: Endian,
    coordinates: [Column; 3],
    attributes: Vec<(Attribute, usize)>,
    by_columns: bool,
    description: String,
}

type Wrong = (String, String);

fn wrong<T>(expected: impl Into<String>, found: impl Into<String>) -> std::result::Result<T, Wrong> {
    Err((expected.into(), found.into()))
}

impl Array {
    fn of(header: &Literal) -> std::result::Result<Array, Wrong> {
        let need = |key: &str| header.get(key).ok_or_else(|| (format!("a dictionary with {key}"), "none".to_string()));
        let (descr, order, shape) = (need("descr")?, need("fortran_order")?, need("shape")?);
        let fortran = match order {
            Literal::Word(word) if word == "True" => true,
            Literal::Word(word) if word == "False" => false,
            other => return wrong("fortran_order True or False", shown(other)),
        };
        let axes = match shape {
            Literal::Items(items) => items.iter().map(whole).collect::<Option<Vec<u64>>>(),
            _ => None,
        };
        let Some(axes) = axes else { return wrong("a shape of whole numbers", shown(shape)) };
        match descr {
            Literal::Text(kind) => Array::plain(kind, &axes, fortran),
            Literal::Items(fields) => Array::structured(fields, &axes),
            other => wrong("a type such as '<f4', or a list of fields", shown(other)),
        }
    }

    /// An array of numbers.
    fn plain(kind: &str, axes: &[u64], fortran: bool) -> std::result::Result<Array, Wrong> {
        let Kind { scalar: Some(scalar), endian, bytes } = Kind::of(kind)? else {
            return wrong(
                "whole numbers or floats of 4 or 8 bytes, as from array.astype('f4')",
                format!("type {kind:?}"),
            );
        };
        let (columns, before) = match axes.split_last() {
            Some((&last, before)) if !before.is_empty() && (3..=MAX_COLUMNS).contains(&last) => (last, before),
            _ => return wrong(format!("a shape (n, m) with m from 3 to {MAX_COLUMNS}"), format!("{axes:?}")),
        };
        let count = product(before)?;
        let column = |index: usize| Column { offset: index * bytes, scalar };
        let ignored = if columns > 3 { format!(", {} without names ignored", columns - 3) } else { String::new() };
        let order = if fortran { "Fortran order" } else { "C order" };
        Ok(Array {
            count,
            stride: columns as usize * bytes,
            endian: endian.unwrap_or_default(),
            coordinates: [0, 1, 2].map(column),
            attributes: Vec::new(),
            by_columns: fortran,
            description: format!("of {kind}, {order}, x y z in columns 1 2 3{ignored}"),
        })
    }

    /// An array of records.
    fn structured(fields: &[Literal], axes: &[u64]) -> std::result::Result<Array, Wrong> {
        let mut endian = None;
        let mut offset = 0usize;
        let mut numbers: Vec<(String, Column)> = Vec::new();
        for field in fields {
            let (name, bytes, scalar) = Array::field(field, &mut endian, 0)?;
            if let Some(scalar) = scalar {
                numbers.push((name, Column { offset, scalar }));
            }
            offset = offset.saturating_add(bytes);
        }
        if offset > MAX_RECORD {
            return wrong(format!("a record of at most {MAX_RECORD} bytes"), "a longer one");
        }
        let mut coordinates = [Column { offset: 0, scalar: Scalar::F32 }; 3];
        for (place, axis) in coordinates.iter_mut().zip(["x", "y", "z"]) {
            let Some((_, column)) = numbers.iter().find(|(name, _)| name.eq_ignore_ascii_case(axis)) else {
                let names: Vec<&str> = numbers.iter().map(|(name, _)| name.as_str()).take(20).collect();
                return wrong(format!("a field {axis}, a number"), quoted(names.join(" ").as_bytes()));
            };
            *place = *column;
        }
        let mut attributes: Vec<(Attribute, usize)> = Vec::new();
        for (name, column) in &numbers {
            let attribute = Attribute::new(name, column.scalar);
            let known = ["x", "y", "z"].contains(&attribute.name.as_str())
                || attribute.name.is_empty()
                || attributes.iter().any(|(known, _)| known.name == attribute.name);
            if !known {
                attributes.push((attribute, column.offset));
            }
        }
        let description = format!("of records of {offset} bytes");
        let (count, endian) = (product(axes)?, endian.unwrap_or_default());
        Ok(Array { count, stride: offset, endian, coordinates, attributes, by_columns: false, description })
    }

    /// Name, bytes and type (if it is one number) of a field; its byte order settles `endian`, or must agree with it.
    fn field(
        field: &Literal,
        endian: &mut Option<Endian>,
        depth: usize,
    ) -> std::result::Result<(String, usize, Option<Scalar>), Wrong> {
        let expected = "fields such as ('x', '<f4')";
        let Literal::Items(parts) = field else { return wrong(expected, shown(field)) };
        let (name, kind, shape) = match parts.as_slice() {
            [name, kind] => (name, kind, None),
            [name, kind, shape] => (name, kind, Some(shape)),
            _ => return wrong(expected, shown(field)),
        };
        let name = match name {
            Literal::Text(name) => name.clone(),
            // A title and a name.
            Literal::Items(both) => match both.as_slice() {
                [_, Literal::Text(name)] => name.clone(),
                _ => return wrong(expected, shown(field)),
            },
            _ => return wrong(expected, shown(field)),
        };
        let (bytes, scalar) = match kind {
            Literal::Text(kind) => {
                let kind = Kind::of(kind)?;
                if kind.endian.is_some_and(|stated| stated != *endian.get_or_insert(stated)) {
                    return wrong("one byte order for all fields", format!("another for {}", quoted(name.as_bytes())));
                }
                (kind.bytes, kind.scalar)
            }
            // Records within the record are passed over.
            Literal::Items(fields) if depth < MAX_DEPTH => {
                let mut bytes = 0usize;
                for field in fields {
                    bytes = bytes.saturating_add(Array::field(field, endian, depth + 1)?.1);
                }
                (bytes, None)
            }
            _ => return wrong(expected, shown(field)),
        };
        let Some(shape) = shape else { return Ok((name, bytes, scalar)) };
        let axes = match shape {
            Literal::Items(items) => items.iter().map(whole).collect::<Option<Vec<u64>>>(),
            Literal::Whole(axis) => Some(vec![*axis]),
            _ => None,
        };
        let Some(axes) = axes else { return wrong(expected, shown(field)) };
        let bytes = usize::try_from(product(&axes)?).map_or(usize::MAX, |items| bytes.saturating_mul(items));
        Ok((name, bytes, None))
    }
}

fn whole(literal: &Literal) -> Option<u64> {
    if let Literal::Whole(number) = literal { Some(*number) } else { None }
}

fn product(axes: &[u64]) -> std::result::Result<u64, Wrong> {
    let checked = axes.iter().try_fold(1u64, |product, axis| product.checked_mul(*axis));
    checked.ok_or_else(|| ("a shape of an array".to_string(), quoted(format!("{axes:?}").as_bytes())))
}

fn shown(literal: &Literal) -> String {
    quoted(format!("{literal:?}").as_bytes())
}

/// A type: `<f4`, `|u1`, `|S10`.
struct Kind {
    /// What it is, if it is a number that we know.
    scalar: Option<Scalar>,
    /// `None` where it makes no difference.
    endian: Option<Endian>,
    bytes: usize,
}

impl Kind {
    fn of(text: &str) -> std::result::Result<Kind, Wrong> {
        let (order, bare) = match text.as_bytes().first() {
            Some(b'<') => (Some(Endian::Little), &text[1..]),
            Some(b'>') => (Some(Endian::Big), &text[1..]),
            Some(b'|') => (None, &text[1..]),
            Some(b'=') => (Some(Endian::NATIVE), &text[1..]),
            _ => (None, text),
        };
        let scalar = if bare == "b1" { Some(Scalar::U8) } else { Scalar::of_numpy(bare) };
        if let Some(scalar) = scalar {
            let bytes = scalar.bytes();
            return Ok(Kind { scalar: Some(scalar), endian: order.filter(|_| bytes > 1), bytes });
        }
        let unit = match bare.as_bytes().first() {
            // Bytes, text of four bytes a letter, halves and wider floats, complex numbers, times.
            Some(b'V' | b'S' | b'a' | b'f' | b'c' | b'M' | b'm') => 1,
            Some(b'U') => 4,
            _ => return wrong("a type such as '<f4'", quoted(text.as_bytes())),
        };
        let size = bare[1..].split('[').next().unwrap_or_default().parse().ok();
        match size.and_then(|size: usize| size.checked_mul(unit)) {
            Some(bytes) => Ok(Kind { scalar: None, endian: None, bytes }),
            None => wrong("a type such as '<f4'", quoted(text.as_bytes())),
        }
    }
}

#[cfg(test)]
mod tests;
