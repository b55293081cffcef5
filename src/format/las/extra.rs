//! Extra bytes: attributes of a LAS file's own, behind what its point format has in every record.
//!
//! ```text
//!  a description, of 192 bytes         options: bit 3 says that there is a scale, bit 4 an offset
//!    2   1  type: 1 to 10 = u8 i8 u16 i16 u32 i32 u64 i64 f32 f64; 11 to 20 two of them, 21 to 30 three (deprecated)
//!    3   1  options; of type 0, bytes that nothing is known of
//!    4  32  name
//!  112  24  scale, of up to three numbers      136  24  offset
//! ```

use std::ops::Range;

use byteorder::{ByteOrder, LE};

use super::fields::{Field, Place};
use crate::points::attribute::Attribute;
use crate::points::scalar::{Column, Scalar};

/// Bytes of a description.
const DESCRIPTION: usize = 192;

const TYPES: [Scalar; 10] = [
    Scalar::U8,
    Scalar::I8,
    Scalar::U16,
    Scalar::I16,
    Scalar::U32,
    Scalar::I32,
    Scalar::U64,
    Scalar::I64,
    Scalar::F32,
    Scalar::F64,
];

/// Appends the fields that `described` tells of, as far as they lie in the bytes `within` a record. Names that are there already, and coordinates' names,
/// are left out.
pub fn append(fields: &mut Vec<Field>, described: &[u8], within: Range<usize>) {
    let mut at = within.start;
    for one in described.chunks_exact(DESCRIPTION) {
        let (kind, options) = (usize::from(one[2]), one[3]);
        let (scalar, numbers) = match kind {
            0 => {
                at += usize::from(options);
                continue;
            }
            1..=30 => (TYPES[(kind - 1) % 10], 1 + (kind - 1) / 10),
            // Nothing says how long it is, nor where the next one begins.
            _ => return,
        };
        let name = String::from_utf8_lossy(one[4..36].split(|&byte| byte == 0).next().unwrap_or_default())
            .replace(|c: char| c.is_control(), "_");
        for number in 0..numbers {
            let column = Column { offset: at, scalar };
            at += scalar.bytes();
            if at > within.end {
                return;
            }
            let or = |bit: u8, from: usize, otherwise: f64| {
                if options & bit == 0 { otherwise } else { LE::read_f64(&one[from + 8 * number..]) }
            };
            let (scale, offset) = (or(8, 112, 1.0), or(16, 136, 0.0));
            let own = if numbers == 1 { name.clone() } else { format!("{name}_{number}") };
            let field = if (scale, offset) == (1.0, 0.0) {
                Field { attribute: Attribute::new(&own, scalar), place: Place::At(column.offset) }
            } else {
                let attribute = Attribute::new(&own, Scalar::F64);
                Field { attribute, place: Place::Scaled { column, scale, offset } }
            };
            let name = &field.attribute.name;
            let taken =
                ["", "x", "y", "z"].contains(&name.as_str()) || fields.iter().any(|f| f.attribute.name == *name);
            if !taken {
                fields.push(field);
            }
        }
    }
}
