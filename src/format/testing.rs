//! Reading a whole cloud at once, for tests of the formats.

use std::path::Path;

use crate::error::Result;
use crate::input::{BLOCK_RECORDS, Carried, Cloud, InputOptions};
use crate::points::attribute::Wanted;
use crate::points::scalar::{Endian, Scalar, reader};
use crate::points::{Batch, Points, Precision};

/// All points of one file, widened, and the number of dropped records.
pub fn collect(path: &Path, options: &InputOptions) -> Result<(Vec<[f64; 3]>, u64)> {
    collect_all(&Cloud::open(&[path.to_path_buf()], options)?)
}

/// All points of a cloud, widened, and the number of dropped records.
pub fn collect_all(cloud: &Cloud) -> Result<(Vec<[f64; 3]>, u64)> {
    let mut blocks = cloud.blocks(Carried::Attributes);
    let mut batch = Batch::new(Precision::Single);
    let (mut all, mut dropped) = (Vec::new(), 0);
    while let Some(block) = blocks.next_block()? {
        block.decode(&mut batch)?;
        dropped += batch.dropped;
        match &batch.points {
            Points::Single(points) => all.extend(points.iter().map(|p| p.map(f64::from))),
            Points::Double(points) => all.extend_from_slice(points),
        }
    }
    Ok((all, dropped))
}

/// All points of a file that is in order.
pub fn points_of(path: &Path, options: &InputOptions) -> Vec<[f64; 3]> {
    collect(path, options).unwrap().0
}

/// A cloud's points, widened, with the records of their attributes.
pub struct WithAttributes {
    /// The cloud.
    pub cloud: Cloud<'static>,
    /// Its points.
    pub points: Vec<[f64; 3]>,
    /// Their records.
    pub records: Vec<u8>,
    /// Points that are not finite, and points that are filtered out.
    pub left_out: (u64, u64),
}

impl WithAttributes {
    /// Reads a file.
    pub fn of(path: &Path, options: &InputOptions) -> Result<WithAttributes> {
        WithAttributes::of_cloud(Cloud::open(&[path.to_path_buf()], options)?)
    }

    /// Reads a cloud.
    pub fn of_cloud(cloud: Cloud<'static>) -> Result<WithAttributes> {
        let (mut points, mut records, mut left_out) = (Vec::new(), Vec::new(), (0, 0));
        let mut blocks = cloud.blocks(Carried::Attributes);
        let mut batch = Batch::new(Precision::Double);
        while let Some(block) = blocks.next_block()? {
            block.decode(&mut batch)?;
            assert!(batch.records() <= BLOCK_RECORDS as u64);
            match &batch.points {
                Points::Single(more) => points.extend(more.iter().map(|p| p.map(f64::from))),
                Points::Double(more) => points.extend_from_slice(more),
            }
            records.extend_from_slice(&batch.attributes);
            left_out = (left_out.0 + batch.dropped, left_out.1 + batch.filtered);
        }
        drop(blocks);
        Ok(WithAttributes { cloud, points, records, left_out })
    }

    /// The values of an attribute.
    pub fn values(&self, name: &str) -> Vec<f64> {
        let column = self.cloud.schema().column(name).unwrap_or_else(|| panic!("{name} is there"));
        let read = reader(column.scalar, Endian::NATIVE);
        self.records.chunks_exact(self.cloud.schema().stride()).map(|record| read(&record[column.offset..])).collect()
    }
}

/// A file of one format, read with all its attributes.
#[derive(Debug, PartialEq)]
pub struct Read {
    /// What was understood.
    pub description: String,
    /// Its points' precision.
    pub precision: Precision,
    /// The points that are finite, widened.
    pub points: Vec<[f64; 3]>,
    /// The records that were dropped.
    pub dropped: u64,
    /// The attributes: name, type, and the value of each point.
    pub attributes: Vec<(String, Scalar, Vec<f64>)>,
}

/// Reads a file that is called `name` and holds `content`.
pub fn read(name: &str, content: &[u8]) -> Result<Read> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, content).unwrap();
    let options = InputOptions { attributes: Wanted::All, ..InputOptions::default() };
    let cloud = Cloud::open(&[path], &options)?;
    let mut blocks = cloud.blocks(Carried::Attributes);
    let mut batch = Batch::new(cloud.precision());
    let (mut points, mut dropped, mut records) = (Vec::new(), 0, Vec::new());
    while let Some(block) = blocks.next_block()? {
        block.decode(&mut batch)?;
        dropped += batch.dropped;
        records.extend_from_slice(&batch.attributes);
        match &batch.points {
            Points::Single(single) => points.extend(single.iter().map(|p| p.map(f64::from))),
            Points::Double(double) => points.extend_from_slice(double),
        }
    }
    let schema = cloud.schema();
    let values = |name: &str| {
        let column = schema.column(name).unwrap();
        let read = reader(column.scalar, Endian::NATIVE);
        records.chunks_exact(schema.stride()).map(|record| read(&record[column.offset..])).collect()
    };
    let attributes = schema.attributes().iter().map(|a| (a.name.clone(), a.scalar, values(&a.name))).collect();
    let description = cloud.sources()[0].description.clone();
    Ok(Read { description, precision: cloud.precision(), points, dropped, attributes })
}

/// What is said of a file that cannot be read.
pub fn refused(name: &str, content: &[u8]) -> String {
    read(name, content).unwrap_err().to_string()
}
