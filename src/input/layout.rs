//! The layout of a raw record: which number stands where.
//!
//! ```text
//!  layout = item { "," item }         xyz                      12 bytes: x y z as f32
//!  item   = "_:" bytes                xyzi                     16 bytes
//!         | letters [":" type]        xyzrgb                   15 bytes: colours are u8
//!         | name [":" type]           x:f64,y:f64,z:f64,i:u16,_:6
//! ```
//!
//! The letters are `x y z`, `i` (intensity), `r` (ring, or red beside `g` and `b`), `g`, `b` and `t` (time), one
//! field each; any other word is the name of a single field. A type behind letters holds for all of them. Without a
//! type a field is `f32`; `rgb` behind other letters is `u8`, as sensors and exporters pack it (three `f32`s are
//! `rgb:f32`).

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::points::Precision;

/// The longest record accepted, in bytes: far beyond any sensor's, small against a block.
pub const MAX_STRIDE: usize = 4096;

/// The order of the bytes of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Endian {
    /// Least significant byte first, as on x86-64 and AArch64.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

impl FromStr for Endian {
    type Err = Error;

    fn from_str(text: &str) -> Result<Endian> {
        match text {
            "le" | "little" => Ok(Endian::Little),
            "be" | "big" => Ok(Endian::Big),
            _ => Err(Error::Usage(format!("byte order: expected le or be, found {text:?}"))),
        }
    }
}

impl fmt::Display for Endian {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Endian::Little => "little-endian",
            Endian::Big => "big-endian",
        })
    }
}

/// The type of a stored number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scalar {
    /// 8-bit signed integer.
    I8,
    /// 8-bit unsigned integer.
    U8,
    /// 16-bit signed integer.
    I16,
    /// 16-bit unsigned integer.
    U16,
    /// 32-bit signed integer.
    I32,
    /// 32-bit unsigned integer.
    U32,
    /// 64-bit signed integer.
    I64,
    /// 64-bit unsigned integer.
    U64,
    /// IEEE 754 single precision.
    F32,
    /// IEEE 754 double precision.
    F64,
}

/// Every type with its names: ours first, then numpy's.
const SCALARS: [(Scalar, &str, &str); 10] = [
    (Scalar::I8, "i8", "i1"),
    (Scalar::U8, "u8", "u1"),
    (Scalar::I16, "i16", "i2"),
    (Scalar::U16, "u16", "u2"),
    (Scalar::I32, "i32", "i4"),
    (Scalar::U32, "u32", "u4"),
    (Scalar::I64, "i64", "i8"),
    (Scalar::U64, "u64", "u8"),
    (Scalar::F32, "f32", "f4"),
    (Scalar::F64, "f64", "f8"),
];

impl Scalar {
    /// Bytes of one number.
    pub fn bytes(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::I64 | Scalar::U64 | Scalar::F64 => 8,
        }
    }

    /// The precision that holds every value of this type (64-bit integers beyond 2⁵³ are rounded).
    pub fn precision(self) -> Precision {
        if self == Scalar::F32 { Precision::Single } else { Precision::Double }
    }

    /// The type of this name in the layout language (`f32`, `u16`).
    pub fn named(name: &str) -> Option<Scalar> {
        SCALARS.iter().find(|(_, ours, _)| *ours == name).map(|(scalar, ..)| *scalar)
    }

    /// The type of this numpy kind and size (`f4`, `u2`), without a byte order. `i8` and `u8` are 64 bits here.
    pub fn of_numpy(name: &str) -> Option<Scalar> {
        SCALARS.iter().find(|(.., numpy)| *numpy == name).map(|(scalar, ..)| *scalar)
    }

    fn name(self) -> &'static str {
        SCALARS.iter().find(|(scalar, ..)| *scalar == self).map_or("", |(_, ours, _)| ours)
    }
}

/// One item of a record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Field {
    /// A number with a name.
    Number {
        /// Its name; `x`, `y` and `z` are the coordinates.
        name: String,
        /// Its type.
        scalar: Scalar,
    },
    /// Bytes without meaning to us.
    Skipped(usize),
}

impl Field {
    /// Bytes of this item.
    pub fn bytes(&self) -> usize {
        match self {
            Field::Number { scalar, .. } => scalar.bytes(),
            Field::Skipped(bytes) => *bytes,
        }
    }
}

/// Where a number lies in a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    /// Bytes before it.
    pub offset: usize,
    /// Its type.
    pub scalar: Scalar,
}

/// The items of a record, in order; `x`, `y` and `z` are there exactly once each, and the record is at most
/// [`MAX_STRIDE`] bytes long.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    fields: Vec<Field>,
}

impl Layout {
    /// A layout of these items.
    ///
    /// # Errors
    /// [`Error::Usage`] if a coordinate is missing or doubled, or the record is too long.
    pub fn new(fields: Vec<Field>) -> Result<Layout> {
        for axis in ["x", "y", "z"] {
            let count = fields.iter().filter(|f| matches!(f, Field::Number { name, .. } if name == axis)).count();
            if count != 1 {
                return Err(Error::Usage(format!("layout: expected one field {axis}, found {count}")));
            }
        }
        let stride = fields.iter().fold(0usize, |sum, field| sum.saturating_add(field.bytes()));
        if stride > MAX_STRIDE {
            return Err(Error::Usage(format!(
                "layout: a record of {stride} bytes, at most {MAX_STRIDE} are supported"
            )));
        }
        Ok(Layout { fields })
    }

    /// Bytes of one record.
    pub fn stride(&self) -> usize {
        self.fields.iter().map(Field::bytes).sum()
    }

    /// Where the coordinates lie: x, y, z.
    pub fn coordinates(&self) -> [Column; 3] {
        ["x", "y", "z"].map(|axis| {
            let mut offset = 0;
            for field in &self.fields {
                match field {
                    Field::Number { name, scalar } if name == axis => return Column { offset, scalar: *scalar },
                    _ => offset += field.bytes(),
                }
            }
            unreachable!("Layout::new saw all three coordinates")
        })
    }
}

impl FromStr for Layout {
    type Err = Error;

    fn from_str(text: &str) -> Result<Layout> {
        let mut fields = Vec::new();
        for item in text.split(',') {
            push_item(item.trim(), &mut fields)
                .map_err(|reason| Error::Usage(format!("layout {text:?}: {reason}; for example xyz, xyzi, xyz:f64")))?;
        }
        Layout::new(fields)
    }
}

fn push_item(item: &str, fields: &mut Vec<Field>) -> std::result::Result<(), String> {
    let (word, kind) = match item.split_once(':') {
        Some((word, kind)) => (word, Some(kind)),
        None => (item, None),
    };
    if word == "_" {
        let bytes = kind.and_then(|k| k.parse().ok()).ok_or("skipped bytes are written _:COUNT")?;
        fields.push(Field::Skipped(bytes));
        return Ok(());
    }
    if word.is_empty() || !word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
        return Err(format!("{word:?} is not a field name"));
    }
    let scalar = match kind {
        Some(kind) => Some(
            Scalar::named(kind)
                .ok_or_else(|| format!("{kind:?} is not a type: i8 u8 i16 u16 i32 u32 i64 u64 f32 f64"))?,
        ),
        None => None,
    };
    if !word.chars().all(|c| "xyzirgbt".contains(c)) {
        fields.push(Field::Number { name: word.to_string(), scalar: scalar.unwrap_or(Scalar::F32) });
        return Ok(());
    }
    let colours_at = word.find("rgb");
    for (at, letter) in word.char_indices() {
        let colour = colours_at.is_some_and(|start| (start..start + 3).contains(&at));
        let default = if colour { Scalar::U8 } else { Scalar::F32 };
        fields.push(Field::Number { name: letter.to_string(), scalar: scalar.unwrap_or(default) });
    }
    Ok(())
}

/// The layout in its own language: neighbouring single-letter fields of one type are joined, so `x,y,z` shows as `xyz`.
impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut first = true;
        let mut rest = self.fields.as_slice();
        while let Some(field) = rest.first() {
            if !std::mem::take(&mut first) {
                f.write_str(",")?;
            }
            match field {
                Field::Skipped(bytes) => {
                    write!(f, "_:{bytes}")?;
                    rest = &rest[1..];
                }
                Field::Number { name, scalar } => {
                    let joins = |other: &Field| match other {
                        Field::Number { name: n, scalar: s } => s == scalar && is_letter(n) && is_letter(name),
                        Field::Skipped(_) => false,
                    };
                    let run = rest.iter().take_while(|other| joins(other)).count().max(1);
                    let mut word = String::new();
                    for field in &rest[..run] {
                        if let Field::Number { name, .. } = field {
                            word += name;
                        }
                    }
                    let bare = *scalar == Scalar::F32 && !word.contains("rgb");
                    if bare {
                        f.write_str(&word)?
                    } else {
                        write!(f, "{word}:{}", scalar.name())?
                    }
                    rest = &rest[run..];
                }
            }
        }
        Ok(())
    }
}

fn is_letter(name: &str) -> bool {
    name.len() == 1 && "xyzirgbt".contains(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(text: &str) -> Layout {
        text.parse().unwrap()
    }

    #[test]
    fn the_language_gives_strides_and_places() {
        for (text, stride, offsets) in [
            ("xyz", 12, [0, 4, 8]),
            ("xyzi", 16, [0, 4, 8]),
            ("xyzir", 20, [0, 4, 8]),
            ("xyzrgb", 15, [0, 4, 8]),
            ("xyz,rgb:f32", 24, [0, 4, 8]),
            ("xyz:f64", 24, [0, 8, 16]),
            ("x:f64,y:f64,z:f64,i:u16,_:6", 32, [0, 8, 16]),
            ("zyx", 12, [8, 4, 0]),
            ("xyz,nx,ny,nz", 24, [0, 4, 8]),
            ("_:4, xyz:i32 ,classification:u8", 17, [4, 8, 12]),
        ] {
            let layout = layout(text);
            assert_eq!(layout.stride(), stride, "{text}");
            assert_eq!(layout.coordinates().map(|c| c.offset), offsets, "{text}");
        }
        assert_eq!(layout("xyz:f64").coordinates()[1].scalar, Scalar::F64);
    }

    #[test]
    fn a_layout_prints_in_its_own_language() {
        for (text, printed) in [
            ("x,y,z", "xyz"),
            ("xyz:f64", "xyz:f64"),
            ("x:f64,y:f64,z:f64,i:u16,_:6", "xyz:f64,i:u16,_:6"),
            ("xyzrgb", "xyz,rgb:u8"),
            ("xyz,nx,ny,nz", "xyz,nx,ny,nz"),
            ("xyz,rgb:f32", "xyzrgb:f32"),
        ] {
            let first = layout(text);
            assert_eq!(first.to_string(), printed);
            assert_eq!(layout(printed), first, "{printed} means the same");
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, part) in [
            ("", "is not a field name"),
            ("xy", "one field z, found 0"),
            ("xyzx", "one field x, found 2"),
            ("xyz:f16", "\"f16\" is not a type"),
            ("xyz,_", "_:COUNT"),
            ("xyz,_:-1", "_:COUNT"),
            ("xyz,_:5000", "5012 bytes"),
            ("xyz,_:18446744073709551615", "at most 4096"),
            ("xyz,,i", "is not a field name"),
        ] {
            let error = text.parse::<Layout>().unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
