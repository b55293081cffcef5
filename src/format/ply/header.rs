//! The header of a PLY file, of points or of a mesh: what elements follow, and how each is stored.
//!
//! ```text
//!  ply
//!  format binary_little_endian 1.0
//!  comment anything                       also obj_info
//!  comment origin 1000 2000 0             what is to be added to vertices
//!  element vertex 12
//!  property float x                       or float32; likewise for all types
//!  property list uchar int neighbours     a count, then that many numbers
//!  end_header
//! ```

use std::path::Path;

use super::super::lines::{lines, quoted};
use crate::error::{Error, Result};
use crate::mesh::told_origin;
use crate::points::scalar::{Endian, Scalar};

/// The longest header accepted, in bytes.
pub const MAX_HEADER: u64 = 1 << 20;

/// What the property of a face that lists its corners may be named.
pub const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// How numbers are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// As text, one element a line.
    Ascii,
    /// As they are, without gaps.
    Binary(Endian),
}

/// One property of an element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Property {
    /// Its name.
    pub name: String,
    /// What is stored.
    pub kind: PropertyKind,
}

/// What a property stores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PropertyKind {
    /// A number.
    Number(Scalar),
    /// A count, then that many numbers.
    List {
        /// The type of the count.
        count: Scalar,
        /// The type of the numbers.
        item: Scalar,
    },
}

/// A table of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Element {
    /// Its name.
    pub name: String,
    /// The number of its rows, as claimed.
    pub count: u64,
    /// Its columns.
    pub properties: Vec<Property>,
}

impl Element {
    /// Bytes of a row in binary; `None` if a list makes that vary.
    pub fn fixed_size(&self) -> Option<u64> {
        self.properties.iter().map(|p| p.kind.number().map(|scalar| scalar.bytes() as u64)).sum()
    }

    /// The least bytes of a row in binary: a face has three corners, other lists may be empty.
    pub fn least_size(&self) -> u64 {
        let least = |property: &Property| match property.kind {
            PropertyKind::Number(scalar) => scalar.bytes(),
            PropertyKind::List { count, item } if CORNERS.contains(&property.name.as_str()) => {
                count.bytes() + 3 * item.bytes()
            }
            PropertyKind::List { count, .. } => count.bytes(),
        };
        self.properties.iter().map(|property| least(property) as u64).sum()
    }
}

impl PropertyKind {
    /// The type of a property that is no list.
    pub fn number(self) -> Option<Scalar> {
        match self {
            PropertyKind::Number(scalar) => Some(scalar),
            PropertyKind::List { .. } => None,
        }
    }
}

/// A whole header.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// How the data is stored.
    pub encoding: Encoding,
    /// The tables, in file order.
    pub elements: Vec<Element>,
    /// What a comment says is to be added to vertices.
    pub origin: [f64; 3],
    /// Bytes of the header.
    pub len: u64,
    /// Lines of the header.
    pub lines: u64,
}

impl Header {
    /// Reads the header at the beginning of `head`, the first [`MAX_HEADER`] bytes of the file or all of it.
    ///
    /// # Errors
    /// [`Error::Malformed`] with the line.
    pub fn parse(path: &Path, head: &[u8]) -> Result<Header> {
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut origin = [0.0; 3];
        for (number, range) in lines(head).skip(1) {
            let line = &head[range.clone()];
            let wrong =
                |expected: &str| Error::malformed(path, format!("header line {}", number + 1), expected, quoted(line));
            let text = std::str::from_utf8(line).unwrap_or("comment").trim();
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            match words.as_slice() {
                ["comment", "origin", ..] => {
                    let told = text.strip_prefix("comment").and_then(told_origin);
                    origin = told.unwrap_or(origin);
                }
                [] | ["comment" | "obj_info", ..] => {}
                ["format", name, _version] => {
                    encoding = Some(encoding_of(name).ok_or_else(|| wrong("a known format"))?)
                }
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| wrong("element NAME COUNT"))?;
                    elements.push(Element { name: (*name).to_string(), count, properties: Vec::new() });
                }
                ["property", rest @ ..] => {
                    let property = property_of(rest).ok_or_else(|| wrong("property TYPE NAME, with a known type"))?;
                    elements
                        .last_mut()
                        .ok_or_else(|| wrong("an element before its properties"))?
                        .properties
                        .push(property);
                }
                ["end_header"] => {
                    // The line must be ended: what follows is data.
                    let end = memchr::memchr(b'\n', &head[range.end..]).map(|found| range.end + found + 1);
                    let len = end.ok_or_else(|| wrong("a line end behind end_header"))? as u64;
                    let encoding = encoding.ok_or_else(|| wrong("a format line before the end of the header"))?;
                    return Ok(Header { encoding, elements, origin, len, lines: number + 1 });
                }
                _ => return Err(wrong("format, element, property, comment or end_header")),
            }
        }
        let found = if head.len() as u64 == MAX_HEADER { "a header of more than 1 MiB" } else { "the end of the file" };
        Err(Error::malformed(path, "header", "end_header", found))
    }
}

fn encoding_of(name: &str) -> Option<Encoding> {
    match name {
        "ascii" => Some(Encoding::Ascii),
        "binary_little_endian" => Some(Encoding::Binary(Endian::Little)),
        "binary_big_endian" => Some(Encoding::Binary(Endian::Big)),
        _ => None,
    }
}

fn property_of(words: &[&str]) -> Option<Property> {
    let (name, kind) = match words {
        ["list", count, item, name] => (name, PropertyKind::List { count: scalar_of(count)?, item: scalar_of(item)? }),
        [kind, name] => (name, PropertyKind::Number(scalar_of(kind)?)),
        _ => return None,
    };
    Some(Property { name: (*name).to_string(), kind })
}

fn scalar_of(name: &str) -> Option<Scalar> {
    Some(match name {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "int64" | "longlong" => Scalar::I64,
        "uint64" | "ulonglong" => Scalar::U64,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Header> {
        Header::parse(Path::new("a.ply"), text.as_bytes())
    }

    const FULL: &str = "ply\r\nformat binary_big_endian 1.0\r\ncomment made by hand\r\nobj_info 7\r\nelement camera 1\r\n\
        property list uchar int a\r\nelement vertex 9\r\nproperty float32 x\r\nproperty double y\r\nproperty ushort z\r\nend_header\r\n";

    #[test]
    fn both_dialects_lists_and_comments_are_read() {
        let header = parse(FULL).unwrap();
        assert_eq!(header.encoding, Encoding::Binary(Endian::Big));
        assert_eq!((header.len, header.lines), (FULL.len() as u64, 11));
        assert_eq!(header.elements[0].fixed_size(), None);
        assert_eq!((header.elements[1].count, header.elements[1].fixed_size()), (9, Some(14)));
    }

    #[test]
    fn no_prefix_is_a_header() {
        for end in 3..FULL.len() {
            assert!(parse(&FULL[..end]).is_err(), "prefix of {end} bytes");
        }
    }

    #[test]
    fn what_is_wrong_is_located() {
        for (text, part) in [
            ("ply\nformat binary_middle_endian 1.0\n", "header line 2: expected a known format"),
            ("ply\nelement vertex -1\n", "header line 2: expected element NAME COUNT"),
            ("ply\nproperty float x\n", "an element before"),
            ("ply\nelement vertex 1\nproperty half x\n", "header line 3"),
            ("ply\nelement vertex 1\nend_header\n", "a format line"),
            ("ply\nwhat\n", "found \"what\""),
            ("ply\n", "found the end of the file"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
