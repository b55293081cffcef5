//! Binary records of one fixed length: raw files and most binary PLY files.
//!
//! Blocks are lent from the memory map. Where the three coordinates lie side by side in the cloud's own precision and
//! this machine's byte order, decoding is a copy.

use std::sync::Arc;

use bytemuck::Zeroable;

use super::layout::Layout;
use crate::error::{Error, Result};
use crate::format::point_format::{BlockCutter, Decode, PointFormat, records_of_a_block};
use crate::points::attribute::{Attribute, Carrying, Schema};
use crate::points::scalar::{Column, Endian, Scalar, reader};
use crate::points::{Batch, Coordinate, Points, Precision};
use crate::storage::mapped::{Bytes, Content, Mapped};

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
    /// The other numbers.
    pub attributes: Vec<(Attribute, usize)>,
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
    /// Records of `layout`.
    pub fn of(layout: &Layout, endian: Endian, transform: Option<Transform>) -> RecordShape {
        let (stride, coordinates, attributes) = (layout.stride(), layout.coordinates(), layout.attributes());
        RecordShape { stride, coordinates, endian, transform, attributes }
    }

    /// The narrowest precision that keeps the coordinates.
    pub fn precision(&self) -> Precision {
        match self.transform {
            Some(_) => Precision::Double,
            None => self.coordinates.iter().map(|c| c.scalar.precision()).max().unwrap_or(Precision::Double),
        }
    }

    /// How attributes come to their places in a record of `schema`.
    fn carrying(&self, schema: &Schema) -> Carrying {
        Carrying::new(schema, self.endian, |name| {
            let own = self.attributes.iter().find(|(attribute, _)| attribute.name == name);
            own.map(|(attribute, offset)| Column { offset: *offset, scalar: attribute.scalar })
        })
    }

    /// Appends the points of `bytes`, whole records all.
    pub fn decode<C: Coordinate>(&self, bytes: &[u8], points: &mut Vec<[C; 3]>) {
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
    }

    /// Where the coordinates begin, if they can be copied as they are.
    fn packed<C: Coordinate>(&self) -> Option<usize> {
        let own = Scalar::of(C::PRECISION);
        let start = self.coordinates[0].offset;
        let in_place = self
            .coordinates
            .iter()
            .enumerate()
            .all(|(axis, column)| column.scalar == own && column.offset == start + axis * size_of::<C>());
        (in_place && self.endian == Endian::NATIVE && self.transform.is_none()).then_some(start)
    }
}

/// `count` records of one shape from byte `start` of a file of `len` bytes on.
#[derive(Debug)]
pub struct FixedRecords {
    /// The file.
    content: Content,
    /// The length the file had when it was looked at; it must still have it when it is read.
    pub len: u64,
    /// Where the first record begins.
    pub start: u64,
    /// Number of records; `start + count · stride` is at most `len`.
    pub count: u64,
    /// The record.
    pub shape: Arc<RecordShape>,
    /// The attributes in it.
    pub attributes: Vec<Attribute>,
}

impl FixedRecords {
    /// `count` records from byte `start` of `file` on, which are within it.
    pub fn new(file: &Mapped, start: u64, count: u64, shape: RecordShape) -> FixedRecords {
        let (content, len) = (file.content().clone(), file.len());
        let attributes = shape.attributes.iter().map(|(attribute, _)| attribute.clone()).collect();
        FixedRecords { content, len, start, count, shape: Arc::new(shape), attributes }
    }
}

impl PointFormat for FixedRecords {
    fn precision(&self) -> Precision {
        self.shape.precision()
    }

    fn attributes(&self) -> &[Attribute] {
        &self.attributes
    }

    fn lent_from(&self) -> Option<&Content> {
        Some(&self.content)
    }

    fn cut(&self, schema: &Schema) -> Result<Box<dyn BlockCutter<'_> + '_>> {
        let file = self.content.open()?;
        same_length(&file, self.len)?;
        let (shape, carrying) = (Arc::clone(&self.shape), Arc::new(self.shape.carrying(schema)));
        Ok(Box::new(RecordCutter { file, at: self.start, left: self.count, shape, carrying }))
    }
}

/// [`Error::Changed`] if the file no longer has the length it had when it was first looked at.
pub fn same_length(file: &Mapped, len: u64) -> Result<()> {
    if file.len() == len {
        return Ok(());
    }
    Err(Error::length_changed(file.path(), format_args!("{len} bytes as in the first look"), file.len()))
}

struct RecordCutter {
    file: Arc<Mapped>,
    at: u64,
    left: u64,
    shape: Arc<RecordShape>,
    carrying: Arc<Carrying>,
}

impl<'a> BlockCutter<'a> for RecordCutter {
    fn next(&mut self) -> Result<Option<Box<dyn Decode + 'a>>> {
        if self.left == 0 {
            return Ok(None);
        }
        let records = self.left.min(records_of_a_block(self.shape.stride));
        let end = self.at + records * self.shape.stride as u64;
        let bytes = self.file.bytes(self.at..end)?;
        self.at = end;
        self.left -= records;
        let (shape, carrying) = (Arc::clone(&self.shape), Arc::clone(&self.carrying));
        Ok(Some(Box::new(RecordBlock { bytes, shape, carrying })))
    }
}

struct RecordBlock {
    bytes: Bytes,
    shape: Arc<RecordShape>,
    carrying: Arc<Carrying>,
}

impl Decode for RecordBlock {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        match &mut batch.points {
            Points::Single(points) => self.shape.decode(&self.bytes, points),
            Points::Double(points) => self.shape.decode(&self.bytes, points),
        }
        if self.carrying.stride() > 0 {
            batch.attributes.reserve(self.bytes.len() / self.shape.stride * self.carrying.stride());
            for record in self.bytes.chunks_exact(self.shape.stride) {
                self.carrying.carry(record, &mut batch.attributes);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(text: &str, endian: Endian) -> RecordShape {
        let layout: crate::input::Layout = text.parse().unwrap();
        RecordShape::of(&layout, endian, None)
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
                shape(layout, endian).decode(&bytes, &mut single);
                shape(layout, endian).decode(&bytes, &mut double);
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
        shape.decode(&bytes, &mut points);
        assert_eq!(points, [[500_123.45, 4_999_999.99, 100.07]]);
    }
}
