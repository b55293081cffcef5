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
use crate::points::attribute::Attribute;
use crate::points::scalar::{Column, Scalar};

/// The longest record accepted, in bytes: far beyond any sensor's, small against a block.
pub const MAX_STRIDE: usize = 4096;

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

/// The items of a record, in order; `x`, `y` and `z` are there exactly once each, and the record is at most
/// 4096 bytes long.
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
                return Err(Error::Usage(format!(
                    "layout: expected one field {axis}, found {count}; for example xyz, xyzi, xyz:f64"
                )));
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

impl Layout {
    /// The other numbers, each with the bytes before it: `r` is a ring, or red beside `g` and `b`.
    pub fn attributes(&self) -> Vec<(Attribute, usize)> {
        let named =
            |wanted: &str| self.fields.iter().any(|f| matches!(f, Field::Number { name, .. } if name == wanted));
        let colours = named("g") && named("b");
        let mut out = Vec::new();
        let mut offset = 0;
        for field in &self.fields {
            if let Field::Number { name, scalar } = field
                && !["x", "y", "z"].contains(&name.as_str())
            {
                let name = if name == "r" && !colours { "ring" } else { name };
                let attribute = Attribute::new(name, *scalar);
                // Of fields of one name, the first counts.
                if out.iter().all(|(known, _): &(Attribute, usize)| known.name != attribute.name) {
                    out.push((attribute, offset));
                }
            }
            offset += field.bytes();
        }
        out
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
