//! Triangles on their way from pass to pass: each with its corners' places, so that nothing else has to be looked up.

use bytemuck::Zeroable;
use glam::DVec3;

use super::gap::Drift;
use crate::error::Result;
use crate::points::Coordinate;
use crate::storage::spool::{Spool, Workspace};

/// A triangle with all that is known of it. 78 bytes in single precision, 114 in double.
#[derive(Debug, Clone, Copy, Zeroable, bytemuck::Pod)]
#[repr(C, packed)]
pub(super) struct Record<T> {
    /// The vertices' numbers in the mesh that was given.
    pub(super) vertices: [u32; 3],
    /// What it has drifted, rounded outwards: the least and the most along x, y and z.
    drift: [[f32; 3]; 2],
    /// The vertices' classes.
    pub(super) classes: [u16; 3],
    pub(super) corners: [[T; 3]; 3],
}

impl<T: Coordinate> Record<T> {
    pub(super) fn new(vertices: [u32; 3], classes: [u16; 3], corners: [[f64; 3]; 3], drift: Drift) -> Record<T> {
        let down = |x: f64| if f64::from(x as f32) > x { (x as f32).next_down() } else { x as f32 };
        let up = |x: f64| if f64::from(x as f32) < x { (x as f32).next_up() } else { x as f32 };
        let drift = [drift.low.to_array().map(down), drift.high.to_array().map(up)];
        Record { vertices, drift, classes, corners: corners.map(|corner| corner.map(T::from_f64)) }
    }

    pub(super) fn places(&self) -> [[f64; 3]; 3] {
        let corners = self.corners;
        corners.map(|corner| corner.map(Into::into))
    }

    pub(super) fn drift(&self) -> Drift {
        let [low, high] = self.drift.map(|ends| DVec3::from_array(ends.map(f64::from)));
        Drift { low, high }
    }
}

/// Triangles read at a time.
const BLOCK: usize = 1 << 13;
/// Places that are kept of a pass's triangles, to cut space by: the most.
const SAMPLE: usize = 1 << 18;

/// Triangles in the order in which they came, and a sample of where they are.
pub(super) struct Soup<T> {
    spool: Spool,
    count: u64,
    sample: Sample<T>,
    /// The farthest that any place has drifted.
    pub(super) reached: f64,
}

/// First corners of every so many triangles: all, until they are too many; then every second of them, and so on.
#[derive(Debug, Clone)]
pub(super) struct Sample<T> {
    places: Vec<[T; 3]>,
    every: u64,
    seen: u64,
}

impl<T: Coordinate> Sample<T> {
    pub(super) const BYTES: u64 = (SAMPLE * size_of::<[T; 3]>()) as u64;

    pub(super) fn new() -> Sample<T> {
        Sample { places: Vec::new(), every: 1, seen: 0 }
    }

    pub(super) fn take(&mut self, place: [T; 3]) {
        if self.seen.is_multiple_of(self.every) {
            if self.places.len() == SAMPLE {
                let mut number = 0;
                self.places.retain(|_| {
                    number += 1;
                    number % 2 == 1
                });
                self.every *= 2;
            }
            if self.seen.is_multiple_of(self.every) {
                self.places.push(place);
            }
        }
        self.seen += 1;
    }

    pub(super) fn places(&self) -> Vec<[T; 3]> {
        self.places.clone()
    }
}

impl<T: Coordinate> Soup<T> {
    pub(super) fn new(workspace: &Workspace, in_memory: u64) -> Soup<T> {
        Soup { spool: workspace.spool(in_memory), count: 0, sample: Sample::new(), reached: 0.0 }
    }

    pub(super) fn count(&self) -> u64 {
        self.count
    }

    pub(super) fn append(&mut self, records: &[Record<T>]) -> Result<()> {
        for record in records {
            let corners = record.corners;
            self.sample.take(corners[0]);
            self.reached = self.reached.max(record.drift().most());
        }
        self.count += records.len() as u64;
        self.spool.append(bytemuck::cast_slice(records)).map(|_| ())
    }

    /// Visits all triangles in order, some at a time.
    pub(super) fn each_block(&self, mut visit: impl FnMut(&[Record<T>]) -> Result<()>) -> Result<()> {
        let mut records = Vec::new();
        for first in (0..self.count).step_by(BLOCK) {
            records.resize((self.count - first).min(BLOCK as u64) as usize, Record::zeroed());
            self.spool.read_at(first * size_of::<Record<T>>() as u64, bytemuck::cast_slice_mut(&mut records))?;
            visit(&records)?;
        }
        Ok(())
    }

    pub(super) fn sample(&self) -> &Sample<T> {
        &self.sample
    }
}
