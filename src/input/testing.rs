//! Reading a whole cloud at once, for tests of the formats.

use std::path::Path;

use super::{Carried, Cloud, InputOptions};
use crate::error::Result;
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
    while let Some(block) = blocks.next()? {
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
