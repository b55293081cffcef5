//! Where the point formats of LAS keep the attributes of a point.
//!
//! ```text
//!  formats 0 to 5                                   formats 6 to 10
//!   0  x, y, z: i32                                  0  x, y, z: i32
//!  12  intensity: u16                               12  intensity: u16
//!  14  return 0-2 | returns 3-5 | dir 6 | edge 7    14  return 0-3 | returns 4-7
//!  15  class 0-4 | synth 5 | key 6 | withheld 7     15  synth 0 | key 1 | withheld 2 | overlap 3 | channel 4-5 | dir 6 | edge 7
//!  16  scan angle: i8, degrees                      16  class: u8
//!  17  user data: u8                                17  user data: u8
//!  18  source: u16                                  18  scan angle: i16, steps of 0.006 degrees
//!                                                   20  source: u16
//!  1, 3, 4, 5:  20  time: f64                       22  time: f64
//!  2: 20, 3 and 5: 28  red, green, blue: u16        7, 8, 10: 30  red, green, blue: u16;  8, 10: 36  near infrared: u16
//!  4: 28, 5: 34  29 bytes about a wave form         9: 30, 10: 38  29 bytes about a wave form
//! ```
//!
//! Wave forms are skipped.

use byteorder::{ByteOrder, LE};

use crate::points::attribute::{Attribute, Carrying, Schema};
use crate::points::scalar::{Column, Endian, Reader, Scalar, reader};
use crate::points::{Batch, Coordinate, Points};

use super::super::records::Transform;

/// An attribute, and where it is found in a record.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Its name and type.
    pub attribute: Attribute,
    /// Where it is found.
    pub place: Place,
}

/// Where a number is found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// As it is, so many bytes from the beginning.
    At(usize),
    /// Some bits of a byte: how many lie below them, and which remain then.
    Bits {
        /// The byte.
        at: usize,
        /// How far they are shifted.
        shift: u32,
        /// Which of them remain.
        mask: u8,
    },
    /// A number times a scale plus an offset.
    Scaled {
        /// The number.
        column: Column,
        /// What it is multiplied by.
        scale: f64,
        /// What is then added.
        offset: f64,
    },
}

/// Bytes of a record of this point format; `None` if there is no such format.
pub fn length(point_format: u8) -> Option<usize> {
    [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67].get(usize::from(point_format)).copied()
}

/// The attributes in records of this point format.
pub fn of(point_format: u8) -> Vec<Field> {
    let at = |name: &str, scalar, at| Field { attribute: Attribute::new(name, scalar), place: Place::At(at) };
    let bits = |name: &str, at, shift, bits: u32| {
        let mask = (1u8 << bits) - 1;
        Field { attribute: Attribute::new(name, Scalar::U8), place: Place::Bits { at, shift, mask } }
    };
    let mut fields = vec![at("intensity", Scalar::U16, 12)];
    if point_format < 6 {
        fields.extend([
            bits("return_number", 14, 0, 3),
            bits("number_of_returns", 14, 3, 3),
            bits("scan_direction", 14, 6, 1),
            bits("edge_of_flight_line", 14, 7, 1),
            bits("classification", 15, 0, 5),
            bits("synthetic", 15, 5, 1),
            bits("key_point", 15, 6, 1),
            bits("withheld", 15, 7, 1),
            at("scan_angle", Scalar::I8, 16),
            at("user_data", Scalar::U8, 17),
            at("point_source_id", Scalar::U16, 18),
        ]);
    } else {
        fields.extend([
            bits("return_number", 14, 0, 4),
            bits("number_of_returns", 14, 4, 4),
            bits("synthetic", 15, 0, 1),
            bits("key_point", 15, 1, 1),
            bits("withheld", 15, 2, 1),
            bits("overlap", 15, 3, 1),
            bits("scanner_channel", 15, 4, 2),
            bits("scan_direction", 15, 6, 1),
            bits("edge_of_flight_line", 15, 7, 1),
            at("classification", Scalar::U8, 16),
            at("user_data", Scalar::U8, 17),
            at("scan_angle", Scalar::I16, 18),
            at("point_source_id", Scalar::U16, 20),
        ]);
    }
    match point_format {
        1 | 3 | 4 | 5 => fields.push(at("gps_time", Scalar::F64, 20)),
        6.. => fields.push(at("gps_time", Scalar::F64, 22)),
        _ => {}
    }
    let colours = match point_format {
        2 => Some(20),
        3 | 5 => Some(28),
        7 | 8 | 10 => Some(30),
        _ => None,
    };
    if let Some(first) = colours {
        let names = ["red", "green", "blue"].into_iter().enumerate();
        fields.extend(names.map(|(i, name)| at(name, Scalar::U16, first + 2 * i)));
    }
    if matches!(point_format, 8 | 10) {
        fields.push(at("nir", Scalar::U16, 36));
    }
    fields
}

/// How the records of a file become points, and attributes of a schema.
#[derive(Debug)]
pub struct Decoding {
    record: usize,
    transform: Transform,
    /// What is not in a record as it is: put behind it, before it is carried.
    derived: Vec<Derived>,
    carrying: Carrying,
}

#[derive(Debug)]
enum Derived {
    Bits { at: usize, shift: u32, mask: u8 },
    Scaled { at: usize, read: Reader, scale: f64, offset: f64 },
}

impl Decoding {
    /// How records of `record` bytes with these fields are decoded.
    pub fn new(record: usize, transform: Transform, fields: &[Field], schema: &Schema) -> Decoding {
        let mut derived = Vec::new();
        let mut behind = record;
        let mut columns: Vec<(&str, Column)> = Vec::new();
        for Field { attribute: Attribute { name, scalar }, place } in fields {
            if schema.column(name).is_none() {
                continue;
            }
            let offset = match *place {
                Place::At(at) => at,
                Place::Bits { at, shift, mask } => {
                    derived.push(Derived::Bits { at, shift, mask });
                    behind
                }
                Place::Scaled { column, scale, offset } => {
                    let read = reader(column.scalar, Endian::Little);
                    derived.push(Derived::Scaled { at: column.offset, read, scale, offset });
                    behind
                }
            };
            if offset == behind {
                behind += scalar.bytes();
            }
            columns.push((name, Column { offset, scalar: *scalar }));
        }
        let carrying = Carrying::new(schema, Endian::Little, |name| {
            columns.iter().find(|(own, _)| *own == name).map(|(_, column)| *column)
        });
        Decoding { record, transform, derived, carrying }
    }

    /// Bytes of a record.
    pub fn record(&self) -> usize {
        self.record
    }

    /// Appends the points of `bytes`, whole records all.
    pub fn decode(&self, bytes: &[u8], batch: &mut Batch) {
        match &mut batch.points {
            Points::Single(points) => self.points(bytes, points),
            Points::Double(points) => self.points(bytes, points),
        }
        if self.carrying.stride() == 0 {
            return;
        }
        let mut whole: Vec<u8> = Vec::new();
        for record in bytes.chunks_exact(self.record) {
            if self.derived.is_empty() {
                self.carrying.carry(record, &mut batch.attributes);
                continue;
            }
            whole.clear();
            whole.extend_from_slice(record);
            for derived in &self.derived {
                match *derived {
                    Derived::Bits { at, shift, mask } => whole.push(record[at] >> shift & mask),
                    Derived::Scaled { at, read, scale, offset } => {
                        whole.extend((read(&record[at..]) * scale + offset).to_le_bytes());
                    }
                }
            }
            self.carrying.carry(&whole, &mut batch.attributes);
        }
    }

    fn points<C: Coordinate>(&self, bytes: &[u8], points: &mut Vec<[C; 3]>) {
        let Transform { scale, offset } = self.transform;
        points.extend(bytes.chunks_exact(self.record).map(|record| {
            [0, 1, 2].map(|a| C::from_f64(f64::from(LE::read_i32(&record[4 * a..])) * scale[a] + offset[a]))
        }));
    }
}
