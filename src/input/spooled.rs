//! Points that come in pieces and are larger than memory: kept in temporary storage, from where every pass reads them.

use std::ops::Range;
use std::path::PathBuf;

use super::memory::{PointBuffer, PointSource};
use crate::error::{Error, Result};
use crate::points::attribute::Attribute;
use crate::points::{Points, Precision};
use crate::storage::spool::{Spool, Workspace};

/// Points that are read once at a time, as many as are there.
const PIECE: u64 = 1 << 14;

/// Points that come in pieces, kept in a temporary file without a name, as far as they take more than the memory that they may.
#[derive(Debug)]
pub struct PointSpool {
    precision: Precision,
    attributes: Vec<Attribute>,
    points: Spool,
    records: Spool,
    count: u64,
}

impl PointSpool {
    /// For points with these attributes, in this precision. `in_memory` bytes of them stay in memory; the others go to a file in `folder`, the system's folder for
    /// temporary files if there is none.
    ///
    /// # Errors
    /// [`Error::Io`] if no file can be created there.
    pub fn new(
        precision: Precision,
        attributes: Vec<Attribute>,
        in_memory: u64,
        folder: Option<PathBuf>,
    ) -> Result<PointSpool> {
        let workspace = Workspace::new(folder.unwrap_or_else(std::env::temp_dir))?;
        let [points, records] = [workspace.spool(in_memory / 2), workspace.spool(in_memory / 2)];
        Ok(PointSpool { precision, attributes, points, records, count: 0 })
    }

    /// Appends all points of a source, which is read once.
    ///
    /// # Errors
    /// [`Error::Source`] if it has other attributes, or a wider precision; what it says; [`Error::Io`] if the disk is full.
    pub fn append(&mut self, source: &dyn PointSource) -> Result<()> {
        if source.precision() > self.precision {
            return Err(Error::Source("a later piece has double precision, the first one single".into()));
        }
        if source.attributes() != self.attributes {
            return Err(Error::Source("a later piece has other attributes than the first one".into()));
        }
        let (mut points, mut records) = (Points::new(self.precision), Vec::new());
        let end = source.len();
        for first in (0..end).step_by(PIECE as usize) {
            match &mut points {
                Points::Single(points) => points.clear(),
                Points::Double(points) => points.clear(),
            }
            records.clear();
            let range = first..end.min(first + PIECE);
            source.read(range.clone(), &mut PointBuffer { points: &mut points, records: &mut records })?;
            let expected = range.end - range.start;
            if points.len() as u64 != expected || records.len() as u64 != expected * self.stride() as u64 {
                return Err(Error::Source(format!("expected {expected} points, found {}", points.len()).into()));
            }
            match &points {
                Points::Single(points) => self.points.append(bytemuck::cast_slice(points))?,
                Points::Double(points) => self.points.append(bytemuck::cast_slice(points))?,
            };
            self.records.append(&records)?;
            self.count += expected;
        }
        Ok(())
    }

    fn stride(&self) -> usize {
        self.attributes.iter().map(|attribute| attribute.scalar.bytes()).sum()
    }
}

impl PointSource for PointSpool {
    fn len(&self) -> u64 {
        self.count
    }

    fn precision(&self) -> Precision {
        self.precision
    }

    fn attributes(&self) -> Vec<Attribute> {
        self.attributes.clone()
    }

    fn read(&self, range: Range<u64>, out: &mut PointBuffer) -> Result<()> {
        let (count, point) = ((range.end - range.start) as usize, 3 * self.precision.bytes() as u64);
        match self.precision {
            Precision::Single => {
                let mut points = vec![[0f32; 3]; count];
                self.points.read_at(range.start * point, bytemuck::cast_slice_mut(&mut points))?;
                out.extend_single(&points);
            }
            Precision::Double => {
                let mut points = vec![[0f64; 3]; count];
                self.points.read_at(range.start * point, bytemuck::cast_slice_mut(&mut points))?;
                out.extend_double(&points);
            }
        }
        let mut records = vec![0; count * self.stride()];
        self.records.read_at(range.start * self.stride() as u64, &mut records)?;
        out.extend_attributes(&records);
        Ok(())
    }
}
