//! The header of a LAS file, and the variable-length records (VLRs) behind it. Nothing in them is trusted: what is kept fits the file.
//!
//! ```text
//!  byte  bytes                               | a VLR            an extended one (EVLR, from 1.4 on, behind the points)
//!     0      4  "LASF"                       |  0  2  reserved          0  2
//!    24      2  version, 1.0 to 1.4          |  2 16  user's name       2 16
//!    94      2  length of the header         | 18  2  record number    18  2
//!    96      4  where points begin           | 20  2  length           20  8
//!   100      4  number of VLRs               | 22 32  description      28 32
//!   104      1  point format; bit 7: LAZ     | 54     content          60
//!   105      2  length of a point's record
//!   107      4  number of points (0 in 1.4 if it does not fit)
//!   131     24  scale of x, y, z             | 155  24  offset of x, y, z
//!   235      8  where EVLRs begin (1.4)      | 243   4  their number    247  8  number of points (1.4)
//! ```

use byteorder::{ByteOrder, LE};

use super::super::records::Transform;
use super::extra;
use super::fields::{self, Field};
use crate::error::{Error, Result};
use crate::points::crs::{Crs, MAX_WKT};
use crate::storage::mapped::Mapped;

/// The header's length before version 1.3; later ones have more.
const LEAST: u64 = 227;
/// The header's length from version 1.4 on.
const LEAST_1_4: u64 = 375;

/// What a LAS file's header says, checked.
#[derive(Debug)]
pub struct Header {
    /// 1.`minor`.
    pub minor: u8,
    /// 0 to 10.
    pub point_format: u8,
    /// Whether the points are compressed.
    pub compressed: bool,
    /// Bytes of a point's record.
    pub record: usize,
    /// Where the points begin; within the file.
    pub start: u64,
    /// Number of points, which the file may be too short for.
    pub count: u64,
    /// How stored integers become coordinates.
    pub transform: Transform,
    /// The attributes of points.
    pub fields: Vec<Field>,
    /// The content of LASzip's record.
    pub laszip: Option<Vec<u8>>,
    /// The coordinate reference system.
    pub crs: Option<Crs>,
}

impl Header {
    /// Reads it.
    ///
    /// # Errors
    /// [`Error::Malformed`] if anything in it cannot be; [`Error::Io`].
    pub fn read(file: &Mapped) -> Result<Header> {
        let wrong = |place: &str, expected: &dyn std::fmt::Display, found: &dyn std::fmt::Display| {
            Error::malformed(file.path(), format_args!("LAS header, {place}"), expected, found)
        };
        let head = file.read(0..file.len().min(LEAST_1_4))?;
        if (head.len() as u64) < LEAST {
            return Err(wrong(
                "length",
                &format_args!("at least {LEAST} bytes"),
                &format_args!("{} bytes", head.len()),
            ));
        }
        let [major, minor] = [head[24], head[25]];
        if major != 1 || minor > 4 {
            return Err(wrong("version", &"1.0 to 1.4", &format_args!("{major}.{minor}")));
        }
        let least = if minor >= 4 { LEAST_1_4 } else { LEAST };
        let length = u64::from(LE::read_u16(&head[94..]));
        if length < least || length > file.len() {
            let expected = format_args!("{least} to {} bytes", file.len()).to_string();
            return Err(wrong("length", &expected, &length));
        }
        let start = u64::from(LE::read_u32(&head[96..]));
        if start < length || start > file.len() {
            let expected = format_args!("a byte from {length} to {}", file.len()).to_string();
            return Err(wrong("where points begin", &expected, &start));
        }
        let (point_format, compressed) = (head[104] & 0x3f, head[104] & 0x80 != 0);
        let base = fields::length(point_format).ok_or_else(|| wrong("point format", &"0 to 10", &point_format))?;
        let record = usize::from(LE::read_u16(&head[105..]));
        if record < base {
            let expected = format_args!("at least {base} bytes in point format {point_format}").to_string();
            return Err(wrong("length of a record", &expected, &record));
        }
        let legacy = u64::from(LE::read_u32(&head[107..]));
        let count = if minor >= 4 { LE::read_u64(&head[247..]) } else { 0 };
        let count = if count == 0 { legacy } else { count };
        let triple = |at: usize| [0, 1, 2].map(|axis| LE::read_f64(&head[at + 8 * axis..]));
        let transform = Transform { scale: triple(131), offset: triple(155) };
        for (place, values) in [("scale", transform.scale), ("offset", transform.offset)] {
            if let Some(bad) = values.iter().find(|v| !v.is_finite() || (place == "scale" && **v == 0.0)) {
                return Err(wrong(place, &"a usable number", bad));
            }
        }
        let mut header = Header {
            minor,
            point_format,
            compressed,
            record,
            start,
            count,
            transform,
            fields: fields::of(point_format),
            laszip: None,
            crs: None,
        };
        let mut found = Found::default();
        found.look(file, length, LE::read_u32(&head[100..]), VLR)?;
        if minor >= 4 && LE::read_u32(&head[243..]) > 0 {
            let at = LE::read_u64(&head[235..]);
            if at < start || at > file.len() {
                let expected = format_args!("a byte from {start} to {}", file.len()).to_string();
                return Err(wrong("where EVLRs begin", &expected, &at));
            }
            found.look(file, at, LE::read_u32(&head[243..]), EVLR)?;
        }
        if let Some(described) = &found.extra {
            extra::append(&mut header.fields, described, base..record);
        }
        header.crs = found.crs();
        header.laszip = found.laszip;
        Ok(header)
    }
}

/// How a kind of variable-length record looks.
#[derive(Clone, Copy)]
struct Kind {
    name: &'static str,
    header: u64,
    length: fn(&[u8]) -> u64,
}

const VLR: Kind = Kind { name: "VLR", header: 54, length: |head| u64::from(LE::read_u16(&head[20..])) };
const EVLR: Kind = Kind { name: "EVLR", header: 60, length: |head| LE::read_u64(&head[20..]) };

/// The records that matter; of several of a kind, the first.
#[derive(Debug, Default)]
struct Found {
    laszip: Option<Vec<u8>>,
    extra: Option<Vec<u8>>,
    wkt: Option<Vec<u8>>,
    keys: Option<Vec<u8>>,
    key_numbers: Option<Vec<u8>>,
    key_text: Option<Vec<u8>>,
}

impl Found {
    /// Walks along `number` records from byte `at` on.
    fn look(&mut self, file: &Mapped, mut at: u64, number: u32, kind: Kind) -> Result<()> {
        for i in 0..number {
            let wrong = |expected: &str| {
                let place = format_args!("{} {i} of {number}, byte {at}", kind.name).to_string();
                Error::malformed(file.path(), place, expected, format_args!("a file of {} bytes", file.len()))
            };
            if file.len() - at < kind.header {
                return Err(wrong("the head of a record"));
            }
            let head = file.read(at..at + kind.header)?;
            let (content, length) = (at + kind.header, (kind.length)(&head));
            if file.len() - content < length {
                return Err(wrong(&format!("{length} bytes of content")));
            }
            let end = content + length;
            let user = head[2..18].split(|&byte| byte == 0).next().unwrap_or_default();
            let slot = match (user, LE::read_u16(&head[18..])) {
                (b"laszip encoded", 22204) => Some(&mut self.laszip),
                (b"LASF_Spec", 4) => Some(&mut self.extra),
                (b"LASF_Projection", 2112) => Some(&mut self.wkt),
                (b"LASF_Projection", 34735) => Some(&mut self.keys),
                (b"LASF_Projection", 34736) => Some(&mut self.key_numbers),
                (b"LASF_Projection", 34737) => Some(&mut self.key_text),
                _ => None,
            };
            if let Some(slot @ None) = slot
                && length <= MAX_WKT as u64
            {
                *slot = Some(file.read(content..end)?);
            }
            at = end;
        }
        Ok(())
    }

    /// The coordinate reference system they tell: the text's, else the keys'.
    fn crs(&self) -> Option<Crs> {
        let text = self.wkt.as_ref().and_then(|wkt| Crs::parse(&String::from_utf8_lossy(wkt)));
        text.or_else(|| {
            let keys: Vec<u16> = self.keys.as_ref()?.chunks_exact(2).map(LE::read_u16).collect();
            let numbers = self.key_numbers.as_deref().unwrap_or_default().chunks_exact(8).map(LE::read_f64);
            Crs::of_geotiff(&keys, &numbers.collect::<Vec<f64>>(), self.key_text.as_deref().unwrap_or_default())
        })
    }
}
