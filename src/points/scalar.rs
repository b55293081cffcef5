//! Numbers as files store them: types, byte orders, and where they lie in a record.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::points::Precision;

/// The order of the bytes of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Endian {
    /// Least significant byte first, as on x86-64 and AArch64.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

impl Endian {
    /// That of this machine.
    pub const NATIVE: Endian = if cfg!(target_endian = "little") { Endian::Little } else { Endian::Big };
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
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

    /// The type of coordinates in this precision.
    pub fn of(precision: Precision) -> Scalar {
        match precision {
            Precision::Single => Scalar::F32,
            Precision::Double => Scalar::F64,
        }
    }

    /// The type of this name in the layout language (`f32`, `u16`).
    pub fn named(name: &str) -> Option<Scalar> {
        SCALARS.iter().find(|(_, ours, _)| *ours == name).map(|(scalar, ..)| *scalar)
    }

    /// The type of this numpy kind and size (`f4`, `u2`), without a byte order. `i8` and `u8` are 64 bits here.
    pub fn of_numpy(name: &str) -> Option<Scalar> {
        SCALARS.iter().find(|(.., numpy)| *numpy == name).map(|(scalar, ..)| *scalar)
    }

    /// The narrowest type that holds every value of both (64-bit integers beside other types become `f64`, which rounds beyond 2⁵³).
    pub fn union(self, other: Scalar) -> Scalar {
        // Bits of the least integers that hold all values, signed or not; a float holds those of its mantissa.
        let integer = |scalar: Scalar| match scalar {
            Scalar::U8 => Some((8, false)),
            Scalar::U16 => Some((16, false)),
            Scalar::U32 => Some((32, false)),
            Scalar::U64 => Some((64, false)),
            Scalar::I8 => Some((8, true)),
            Scalar::I16 => Some((16, true)),
            Scalar::I32 => Some((32, true)),
            Scalar::I64 => Some((64, true)),
            Scalar::F32 | Scalar::F64 => None,
        };
        if self == other {
            return self;
        }
        match (integer(self), integer(other)) {
            (Some((a, a_signed)), Some((b, b_signed))) => {
                let signed = a_signed || b_signed;
                let bits = |bits: u32, own: bool| if signed && !own { bits + 1 } else { bits };
                match (bits(a, a_signed).max(bits(b, b_signed)), signed) {
                    (..=8, _) => Scalar::I8,
                    (..=16, true) => Scalar::I16,
                    (..=16, false) => Scalar::U16,
                    (..=32, true) => Scalar::I32,
                    (..=32, false) => Scalar::U32,
                    (..=64, true) => Scalar::I64,
                    (..=64, false) => Scalar::U64,
                    _ => Scalar::F64,
                }
            }
            (Some((bits, _)), None) if bits <= 16 => other,
            (None, Some((bits, _))) if bits <= 16 => self,
            _ => Scalar::F64,
        }
    }

    /// Appends `value` in this type and the machine's byte order; what the type cannot hold becomes the nearest value that it can, NaN zero.
    pub fn put(self, value: f64, out: &mut Vec<u8>) {
        match self {
            Scalar::I8 => out.extend((value as i8).to_ne_bytes()),
            Scalar::U8 => out.extend((value as u8).to_ne_bytes()),
            Scalar::I16 => out.extend((value as i16).to_ne_bytes()),
            Scalar::U16 => out.extend((value as u16).to_ne_bytes()),
            Scalar::I32 => out.extend((value as i32).to_ne_bytes()),
            Scalar::U32 => out.extend((value as u32).to_ne_bytes()),
            Scalar::I64 => out.extend((value as i64).to_ne_bytes()),
            Scalar::U64 => out.extend((value as u64).to_ne_bytes()),
            Scalar::F32 => out.extend((value as f32).to_ne_bytes()),
            Scalar::F64 => out.extend(value.to_ne_bytes()),
        }
    }

    /// Its name in the layout language.
    pub fn name(self) -> &'static str {
        SCALARS.iter().find(|(scalar, ..)| *scalar == self).map_or("", |(_, ours, _)| ours)
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

/// Reads the number at the beginning of the bytes, which hold at least that number.
pub type Reader = fn(&[u8]) -> f64;

/// The reader of numbers of this type and byte order.
pub fn reader(scalar: Scalar, endian: Endian) -> Reader {
    use byteorder::{BE, ByteOrder, LE};
    match (scalar, endian) {
        (Scalar::I8, _) => |b| f64::from(b[0] as i8),
        (Scalar::U8, _) => |b| f64::from(b[0]),
        (Scalar::I16, Endian::Little) => |b| f64::from(LE::read_i16(b)),
        (Scalar::U16, Endian::Little) => |b| f64::from(LE::read_u16(b)),
        (Scalar::I32, Endian::Little) => |b| f64::from(LE::read_i32(b)),
        (Scalar::U32, Endian::Little) => |b| f64::from(LE::read_u32(b)),
        (Scalar::I64, Endian::Little) => |b| LE::read_i64(b) as f64,
        (Scalar::U64, Endian::Little) => |b| LE::read_u64(b) as f64,
        (Scalar::F32, Endian::Little) => |b| f64::from(LE::read_f32(b)),
        (Scalar::F64, Endian::Little) => LE::read_f64,
        (Scalar::I16, Endian::Big) => |b| f64::from(BE::read_i16(b)),
        (Scalar::U16, Endian::Big) => |b| f64::from(BE::read_u16(b)),
        (Scalar::I32, Endian::Big) => |b| f64::from(BE::read_i32(b)),
        (Scalar::U32, Endian::Big) => |b| f64::from(BE::read_u32(b)),
        (Scalar::I64, Endian::Big) => |b| BE::read_i64(b) as f64,
        (Scalar::U64, Endian::Big) => |b| BE::read_u64(b) as f64,
        (Scalar::F32, Endian::Big) => |b| f64::from(BE::read_f32(b)),
        (Scalar::F64, Endian::Big) => BE::read_f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_union_holds_the_extremes_of_both() {
        let extremes = |scalar: Scalar| match scalar {
            Scalar::I8 => [f64::from(i8::MIN), f64::from(i8::MAX)],
            Scalar::U8 => [0.0, f64::from(u8::MAX)],
            Scalar::I16 => [f64::from(i16::MIN), f64::from(i16::MAX)],
            Scalar::U16 => [0.0, f64::from(u16::MAX)],
            Scalar::I32 => [f64::from(i32::MIN), f64::from(i32::MAX)],
            Scalar::U32 => [0.0, f64::from(u32::MAX)],
            Scalar::I64 => [i64::MIN as f64, i64::MAX as f64],
            Scalar::U64 => [0.0, u64::MAX as f64],
            Scalar::F32 => [f64::from(f32::MIN), f64::from(f32::MIN_POSITIVE)],
            Scalar::F64 => [f64::MIN, f64::MIN_POSITIVE],
        };
        for (a, ..) in SCALARS {
            for (b, ..) in SCALARS {
                let both = a.union(b);
                assert_eq!(both, b.union(a));
                for value in [extremes(a), extremes(b)].concat() {
                    let mut bytes = Vec::new();
                    both.put(value, &mut bytes);
                    assert_eq!(bytes.len(), both.bytes());
                    assert_eq!(reader(both, Endian::NATIVE)(&bytes), value, "{a:?} and {b:?} are {both:?}");
                }
            }
        }
    }
}
