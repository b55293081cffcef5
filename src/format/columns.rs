//! Binary columns: all x, then all y, then all z and whatever else; compressed PCD and NPY in Fortran order.
//!
//! ```text
//!   x0 x1 x2 x3 x4 x5 … y0 y1 y2 y3 y4 y5 … z0 z1 z2 z3 z4 z5 …        a block: as many bytes of each column
//!      [________]          [________]          [________]
//! ```

use std::sync::Arc;

use super::records::same_length;
use crate::error::Result;
use crate::format::point_format::{BLOCK_BYTES, BLOCK_RECORDS, BlockCutter, Decode, PointFormat};
use crate::points::attribute::{Attribute, Carrying, Schema};
use crate::points::scalar::{Endian, Scalar, reader};
use crate::points::{Batch, Coordinate, Points, Precision};
use crate::storage::mapped::{Bytes, Content, Mapped};

/// One number of every point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stretched {
    /// Where the first one lies.
    pub start: u64,
    /// Bytes from one to the next.
    pub pitch: usize,
    /// Its type.
    pub scalar: Scalar,
}

/// Points whose numbers lie in columns.
#[derive(Debug)]
pub struct Columns {
    content: Content,
    len: u64,
    count: u64,
    endian: Endian,
    coordinates: [Stretched; 3],
    own: Vec<(Attribute, Stretched)>,
    attributes: Vec<Attribute>,
}

impl Columns {
    /// `count` points of a file; every column lies within it.
    pub fn new(
        file: &Mapped,
        count: u64,
        endian: Endian,
        coordinates: [Stretched; 3],
        own: Vec<(Attribute, Stretched)>,
    ) -> Columns {
        let attributes = own.iter().map(|(attribute, _)| attribute.clone()).collect();
        Columns { content: file.content().clone(), len: file.len(), count, endian, coordinates, own, attributes }
    }
}

impl PointFormat for Columns {
    fn precision(&self) -> Precision {
        self.coordinates.iter().map(|c| c.scalar.precision()).max().unwrap_or(Precision::Double)
    }

    fn attributes(&self) -> &[Attribute] {
        &self.attributes
    }

    fn cut(&self, schema: &Schema) -> Result<Box<dyn BlockCutter<'_> + '_>> {
        let file = self.content.open()?;
        same_length(&file, self.len)?;
        let wanted: Vec<&(Attribute, Stretched)> =
            self.own.iter().filter(|(a, _)| schema.column(&a.name).is_some()).collect();
        let mut columns = self.coordinates.to_vec();
        columns.extend(wanted.iter().map(|(_, column)| *column));
        // Attributes are put side by side, and then carried like those of any record.
        let record = Schema::new(wanted.iter().map(|(attribute, _)| attribute.clone()).collect());
        let carrying = Carrying::new(schema, self.endian, |name| record.column(name));
        let reading = Arc::new(Reading { columns, endian: self.endian, carrying });
        Ok(Box::new(ColumnCutter { file, first: 0, count: self.count, reading }))
    }
}

/// What is read of a block.
struct Reading {
    /// x, y, z, then attributes.
    columns: Vec<Stretched>,
    endian: Endian,
    carrying: Carrying,
}

struct ColumnCutter {
    file: Arc<Mapped>,
    first: u64,
    count: u64,
    reading: Arc<Reading>,
}

impl<'a> BlockCutter<'a> for ColumnCutter {
    fn next(&mut self) -> Result<Option<Box<dyn Decode + 'a>>> {
        if self.first == self.count {
            return Ok(None);
        }
        let pitch: usize = self.reading.columns.iter().map(|c| c.pitch).sum();
        let points = (self.count - self.first).min((BLOCK_BYTES / pitch).clamp(1, BLOCK_RECORDS) as u64);
        let piece = |column: &Stretched| {
            let pitch = column.pitch as u64;
            let start = column.start + self.first * pitch;
            // The last number ends before the next one's place, and maybe with the file.
            self.file.bytes(start..start + (points - 1) * pitch + column.scalar.bytes() as u64)
        };
        let bytes = self.reading.columns.iter().map(piece).collect::<Result<_>>()?;
        self.first += points;
        Ok(Some(Box::new(ColumnBlock { bytes, points: points as usize, reading: Arc::clone(&self.reading) })))
    }
}

struct ColumnBlock {
    /// A piece of each column.
    bytes: Vec<Bytes>,
    points: usize,
    reading: Arc<Reading>,
}

impl ColumnBlock {
    fn fill<C: Coordinate>(&self, points: &mut Vec<[C; 3]>) {
        let axes = [0, 1, 2].map(|axis| {
            let column = self.reading.columns[axis];
            (&self.bytes[axis], column.pitch, reader(column.scalar, self.reading.endian))
        });
        let point = |i: usize| axes.map(|(bytes, pitch, read)| C::from_f64(read(&bytes[i * pitch..])));
        points.extend((0..self.points).map(point));
    }
}

impl Decode for ColumnBlock {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        let Batch { points, attributes, .. } = batch;
        match points {
            Points::Single(points) => self.fill(points),
            Points::Double(points) => self.fill(points),
        }
        let carrying = &self.reading.carrying;
        if carrying.stride() > 0 {
            attributes.reserve(self.points * carrying.stride());
            let mut record = Vec::new();
            for i in 0..self.points {
                record.clear();
                for (bytes, column) in self.bytes.iter().zip(&self.reading.columns).skip(3) {
                    record.extend_from_slice(&bytes[i * column.pitch..][..column.scalar.bytes()]);
                }
                carrying.carry(&record, attributes);
            }
        }
        Ok(())
    }
}
