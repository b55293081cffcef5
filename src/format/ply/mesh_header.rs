//! The header of a PLY file: what elements follow, in what types.

use crate::error::Result;
use crate::format::read::Input;
use crate::format::read::text::{Lines, shortened};
use crate::mesh::told_origin;
use crate::points::scalar::Scalar;

/// The longest header: tens of thousands of comments.
const LONGEST: u64 = 1 << 20;

/// How values are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// The types of values, under both families of names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Type {
    Int8,
    Uint8,
    Int16,
    Uint16,
    Int32,
    Uint32,
    Float32,
    Float64,
}

impl Type {
    fn named(name: &str) -> Option<Type> {
        Some(match name {
            "char" | "int8" => Type::Int8,
            "uchar" | "uint8" => Type::Uint8,
            "short" | "int16" => Type::Int16,
            "ushort" | "uint16" => Type::Uint16,
            "int" | "int32" => Type::Int32,
            "uint" | "uint32" => Type::Uint32,
            "float" | "float32" => Type::Float32,
            "double" | "float64" => Type::Float64,
            _ => return None,
        })
    }

    /// The same type elsewhere in the program.
    pub fn scalar(self) -> Scalar {
        match self {
            Type::Int8 => Scalar::I8,
            Type::Uint8 => Scalar::U8,
            Type::Int16 => Scalar::I16,
            Type::Uint16 => Scalar::U16,
            Type::Int32 => Scalar::I32,
            Type::Uint32 => Scalar::U32,
            Type::Float32 => Scalar::F32,
            Type::Float64 => Scalar::F64,
        }
    }

    /// Bytes of a value.
    pub fn bytes(self) -> usize {
        match self {
            Type::Int8 | Type::Uint8 => 1,
            Type::Int16 | Type::Uint16 => 2,
            Type::Int32 | Type::Uint32 | Type::Float32 => 4,
            Type::Float64 => 8,
        }
    }

    /// The little-endian value at the start of `bytes`; every type fits `f64` exactly.
    pub fn decode(self, bytes: &[u8]) -> f64 {
        let first4 = || [bytes[0], bytes[1], bytes[2], bytes[3]];
        match self {
            Type::Int8 => f64::from(bytes[0] as i8),
            Type::Uint8 => f64::from(bytes[0]),
            Type::Int16 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
            Type::Uint16 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            Type::Int32 => f64::from(i32::from_le_bytes(first4())),
            Type::Uint32 => f64::from(u32::from_le_bytes(first4())),
            Type::Float32 => f64::from(f32::from_le_bytes(first4())),
            Type::Float64 => {
                let [a, b, c, d] = first4();
                f64::from_le_bytes([a, b, c, d, bytes[4], bytes[5], bytes[6], bytes[7]])
            }
        }
    }
}

/// One value of an element, or a list of them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Property {
    Scalar { name: String, kind: Type },
    List { name: String, count: Type, item: Type },
}

/// A kind of element and how many there are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

impl Element {
    /// Bytes of one element, if that is fixed.
    pub fn stride(&self) -> Option<u64> {
        let bytes = |property: &Property| match property {
            Property::Scalar { kind, .. } => Some(kind.bytes() as u64),
            Property::List { .. } => None,
        };
        self.properties.iter().map(bytes).sum()
    }
}

/// A header.
#[derive(Debug)]
pub(crate) struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
    /// What a comment says is to be added to vertices.
    pub origin: [f64; 3],
    /// Bytes of the header itself.
    pub length: u64,
}

impl Header {
    /// Reads the header of a mesh; the lines then stand at its last.
    pub fn read(input: &Input, lines: &mut Lines) -> Result<Header> {
        let header = Header::parse(lines)?;
        for needed in ["vertex", "face"] {
            if header.elements.iter().filter(|element| element.name == needed).count() != 1 {
                let what =
                    if needed == "face" { "one element face (is this a point cloud?)" } else { "one element vertex" };
                return Err(crate::Error::malformed(input.path, "the header", what, "none, or several"));
            }
        }
        Ok(header)
    }

    /// Reads a header, whatever elements it tells of.
    pub fn parse(lines: &mut Lines) -> Result<Header> {
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut origin = [0.0; 3];
        if !lines.advance()? || lines.line() != "ply" {
            return Err(lines.malformed("\"ply\"", format!("{:?}", shortened(lines.line()))));
        }
        loop {
            if !lines.advance()? || !lines.is_terminated() {
                return Err(lines.malformed("end_header", "the end of the file"));
            }
            if lines.consumed() > LONGEST {
                return Err(lines.malformed("end_header within 1 MiB", "more header"));
            }
            let wrong = |expected: &str| lines.malformed(expected, format!("{:?}", shortened(lines.line())));
            let words: Vec<&str> = lines.line().split_ascii_whitespace().take(6).collect();
            match words[..] {
                ["comment", "origin", ..] => {
                    let told = lines.line().strip_prefix("comment").and_then(told_origin);
                    origin = told.unwrap_or(origin);
                }
                ["comment" | "obj_info", ..] | [] => {}
                ["format", name, "1.0"] => {
                    encoding = Some(match name {
                        "ascii" => Encoding::Ascii,
                        "binary_little_endian" => Encoding::LittleEndian,
                        "binary_big_endian" => Encoding::BigEndian,
                        _ => return Err(wrong("format ascii, binary_little_endian or binary_big_endian")),
                    });
                }
                ["element", name, count] => {
                    let count = lines.number(Some(count), "the number of elements")?;
                    elements.push(Element { name: name.into(), count, properties: Vec::new() });
                }
                ["property", "list", count, item, name] => {
                    let kinds = Type::named(count).zip(Type::named(item));
                    let Some((count, item)) = kinds else { return Err(wrong("types of PLY")) };
                    let Some(element) = elements.last_mut() else { return Err(wrong("an element before")) };
                    element.properties.push(Property::List { name: name.into(), count, item });
                }
                ["property", kind, name] => {
                    let Some(kind) = Type::named(kind) else { return Err(wrong("a type of PLY")) };
                    let Some(element) = elements.last_mut() else { return Err(wrong("an element before")) };
                    element.properties.push(Property::Scalar { name: name.into(), kind });
                }
                ["end_header"] => break,
                _ => return Err(wrong("a header line of PLY 1.0")),
            }
        }
        let Some(encoding) = encoding else { return Err(lines.malformed("a format line before", "none")) };
        Ok(Header { encoding, elements, origin, length: lines.consumed() })
    }
}
