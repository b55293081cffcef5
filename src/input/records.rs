//! Binary records of one fixed length: raw files and most binary PLY files.
//!
//! Blocks are lent from the memory map. Where the three coordinates lie side by side in the cloud's own precision and
//! this machine's byte order, decoding is a copy.

use std::path::PathBuf;
use std::sync::Arc;

use bytemuck::Zeroable;

use super::layout::{Column, Endian, Scalar};
use super::mapped::{Bytes, Mapped};
use super::{BLOCK_BYTES, BLOCK_RECORDS, BlockCutter, Decode, PointFormat};
use crate::error::{Error, Result};
use crate::points::{Batch, Coordinate, Points, Precision};

/// How the three coordinates are found in a record.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordShape {
    /// Bytes from one record to the next; every column lies within.
    pub stride: usize,
    /// x, y and z.
    pub coordinates: [Column; 3],
    /// Byte order of the numbers.
    pub endian: Endian,
    /// What the stored numbers are multiplied by and what is then added, for stored integers.
    pub transform: Option<Transform>,
}

/// Coordinate = stored number · scale + offset, along each axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transform {
    /// Size of one step.
    pub scale: [f64; 3],
    /// Position of the stored zero.
    pub offset: [f64; 3],
}

impl RecordShape {
    /// The narrowest precision that keeps the coordinates.
    pub fn precision(&self) -> Precision {
        match self.transform {
            Some(_) => Precision::Double,
            None => self.coordinates.iter().map(|c| c.scalar.precision()).max().unwrap_or(Precision::Double),
        }
    }

    /// Appends the finite points of `bytes`, whole records all, and returns how many were not finite.
    pub fn decode<C: Coordinate>(&self, bytes: &[u8], points: &mut Vec<[C; 3]>) -> u64 {
        let before = points.len();
        let records = bytes.len() / self.stride;
        match self.packed::<C>() {
            Some(0) if self.stride == size_of::<[C; 3]>() => {
                points.resize(before + records, Zeroable::zeroed());
                bytemuck::cast_slice_mut(&mut points[before..]).copy_from_slice(bytes);
            }
            Some(offset) => points.extend(bytes.chunks_exact(self.stride).map(|record| -> [C; 3] {
                bytemuck::pod_read_unaligned(&record[offset..offset + size_of::<[C; 3]>()])
            })),
            None => {
                let read = self.coordinates.map(|column| (column.offset, reader(column.scalar, self.endian)));
                let stored = bytes.chunks_exact(self.stride).map(|r| read.map(|(offset, read)| read(&r[offset..])));
                match self.transform {
                    None => points.extend(stored.map(|point| point.map(C::from_f64))),
                    Some(Transform { scale: s, offset: o }) => {
                        points.extend(stored.map(|p| [0, 1, 2].map(|axis| C::from_f64(p[axis] * s[axis] + o[axis]))))
                    }
                }
            }
        }
        drop_non_finite(points, before)
    }

    /// Where the coordinates begin, if they can be copied as they are.
    fn packed<C: Coordinate>(&self) -> Option<usize> {
        let own = match C::PRECISION {
            Precision::Single => Scalar::F32,
            Precision::Double => Scalar::F64,
        };
        let native = if cfg!(target_endian = "little") { Endian::Little } else { Endian::Big };
        let start = self.coordinates[0].offset;
        let in_place = self
            .coordinates
            .iter()
            .enumerate()
            .all(|(axis, column)| column.scalar == own && column.offset == start + axis * size_of::<C>());
        (in_place && self.endian == native && self.transform.is_none()).then_some(start)
    }
}

/// Removes the points from `from` on that have a coordinate that is NaN or infinite, and returns their number.
///
/// A pass without branches finds out whether there are any: almost always there are none, and then that pass is all.
pub fn drop_non_finite<C: Coordinate>(points: &mut Vec<[C; 3]>, from: usize) -> u64 {
    // 0 · v is 0 for finite v and NaN for all others, so the sum is 0 exactly if all are finite.
    let sums = points[from..]
        .iter()
        .fold([0.0; 3], |sums: [f64; 3], point| [0, 1, 2].map(|axis| sums[axis] + 0.0 * point[axis].into()));
    if sums == [0.0; 3] {
        return 0;
    }
    let mut kept = from;
    for read in from..points.len() {
        if points[read].iter().all(|&c| c.into().is_finite()) {
            points[kept] = points[read];
            kept += 1;
        }
    }
    let dropped = points.len() - kept;
    points.truncate(kept);
    dropped as u64
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

/// `count` records of one shape from byte `start` of a file of `len` bytes on.
#[derive(Debug)]
pub struct FixedRecords {
    /// The file.
    pub path: PathBuf,
    /// The length the file had when it was looked at; it must still have it when it is read.
    pub len: u64,
    /// Where the first record begins.
    pub start: u64,
    /// Number of records; `start + count · stride` is at most `len`.
    pub count: u64,
    /// The record.
    pub shape: Arc<RecordShape>,
}

impl PointFormat for FixedRecords {
    fn precision(&self) -> Precision {
        self.shape.precision()
    }

    fn cut(&self) -> Result<Box<dyn BlockCutter>> {
        let file = Mapped::open(&self.path)?;
        same_length(&file, self.len)?;
        Ok(Box::new(RecordCutter { file, at: self.start, left: self.count, shape: Arc::clone(&self.shape) }))
    }
}

/// [`Error::Malformed`] if the file no longer has the length it had when it was first looked at.
pub fn same_length(file: &Mapped, len: u64) -> Result<()> {
    if file.len() == len {
        return Ok(());
    }
    let expected = format_args!("{len} bytes as in the first look").to_string();
    Err(Error::malformed(file.path(), "length", expected, format_args!("{} bytes", file.len())))
}

struct RecordCutter {
    file: Arc<Mapped>,
    at: u64,
    left: u64,
    shape: Arc<RecordShape>,
}

impl BlockCutter for RecordCutter {
    fn next(&mut self) -> Result<Option<Box<dyn Decode>>> {
        if self.left == 0 {
            return Ok(None);
        }
        let records = self.left.min((BLOCK_BYTES / self.shape.stride).clamp(1, BLOCK_RECORDS) as u64);
        let end = self.at + records * self.shape.stride as u64;
        let bytes = self.file.bytes(self.at..end)?;
        self.at = end;
        self.left -= records;
        Ok(Some(Box::new(RecordBlock { bytes, shape: Arc::clone(&self.shape) })))
    }
}

struct RecordBlock {
    bytes: Bytes,
    shape: Arc<RecordShape>,
}

impl Decode for RecordBlock {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        batch.dropped = match &mut batch.points {
            Points::Single(points) => self.shape.decode(&self.bytes, points),
            Points::Double(points) => self.shape.decode(&self.bytes, points),
        };
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn shape(text: &str, endian: Endian) -> RecordShape {
        let layout: super::super::Layout = text.parse().unwrap();
        RecordShape { stride: layout.stride(), coordinates: layout.coordinates(), endian, transform: None }
    }

    #[test]
    fn packed_strided_and_swapped_records_give_the_same_points() {
        let points: Vec<[f32; 3]> = (0..1000).map(|i| [i as f32 * 0.1, -(i as f32), 1e-3]).collect();
        for (layout, pad) in [("xyz", 0), ("xyz,_:5", 5)] {
            for endian in [Endian::Little, Endian::Big] {
                let mut bytes = Vec::new();
                for v in points.iter().flatten().enumerate() {
                    match endian {
                        Endian::Little => bytes.extend(v.1.to_le_bytes()),
                        Endian::Big => bytes.extend(v.1.to_be_bytes()),
                    }
                    if v.0 % 3 == 2 {
                        bytes.extend(vec![0xff; pad]);
                    }
                }
                let (mut single, mut double) = (Vec::<[f32; 3]>::new(), Vec::<[f64; 3]>::new());
                assert_eq!(shape(layout, endian).decode(&bytes, &mut single), 0);
                assert_eq!(shape(layout, endian).decode(&bytes, &mut double), 0);
                assert_eq!(single, points);
                assert_eq!(double, points.iter().map(|p| p.map(f64::from)).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn scale_and_offset_apply_to_stored_integers() {
        let transform = Some(Transform { scale: [0.01; 3], offset: [500_000.0, 5_000_000.0, 100.0] });
        let shape = RecordShape { transform, ..shape("xyz:i32", Endian::Little) };
        assert_eq!(shape.precision(), Precision::Double);
        let bytes: Vec<u8> = [12_345i32, -1, 7].iter().flat_map(|v| v.to_le_bytes()).collect();
        let mut points = Vec::<[f64; 3]>::new();
        assert_eq!(shape.decode(&bytes, &mut points), 0);
        assert_eq!(points, [[500_123.45, 4_999_999.99, 100.07]]);
    }

    proptest! {
        #[test]
        fn exactly_the_finite_points_stay_in_order(points in prop::collection::vec(any::<[u32; 3]>(), 0..50), kept in 0usize..5) {
            let points: Vec<[f32; 3]> = points.into_iter().map(|p| p.map(|bits| {
                // Half of the exponents are all ones: NaN or infinite.
                f32::from_bits(if bits & 16 == 0 { bits | 0x7f80_0000 } else { bits })
            })).collect();
            let kept = kept.min(points.len());
            let mut actual = points.clone();
            let dropped = drop_non_finite(&mut actual, kept);
            let mut expected = points[..kept].to_vec();
            expected.extend(points[kept..].iter().filter(|p| p.iter().all(|c| c.is_finite())));
            prop_assert_eq!(dropped as usize, points.len() - expected.len());
            prop_assert_eq!(bytemuck::cast_slice::<_, u32>(&actual), bytemuck::cast_slice::<_, u32>(&expected));
        }
    }
}
