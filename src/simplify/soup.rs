//! Triangles on their way from pass to pass: each with its corners' places, so that nothing else has to be looked up.

use std::marker::PhantomData;

use bytemuck::Zeroable;

use super::gap::Drift;
use super::mark::{Mark, Marks, inwards, outwards};
use crate::error::Result;
use crate::points::Coordinate;
use crate::storage::spool::{Spool, Workspace};

/// A triangle with all that is known of it. 78 bytes in single precision, 114 in double; 84 more with marks.
#[derive(Debug, Clone, Copy, Zeroable, bytemuck::Pod)]
#[repr(C, packed)]
pub(super) struct Record<T, M> {
    /// The vertices' numbers in the mesh that was given.
    pub(super) vertices: [u32; 3],
    /// What it has drifted, rounded outwards: the least and the most along x, y and z.
    drift: [[f32; 3]; 2],
    /// The vertices' classes.
    pub(super) classes: [u16; 3],
    pub(super) corners: [[T; 3]; 3],
    mark: M,
}

impl<T: Coordinate, M: Mark> Record<T, M> {
    pub(super) fn new(
        vertices: [u32; 3],
        classes: [u16; 3],
        corners: [[f64; 3]; 3],
        drift: Drift,
        marks: Marks,
    ) -> Record<T, M> {
        let corners = corners.map(|corner| corner.map(T::from_f64));
        Record { vertices, drift: outwards(drift), classes, corners, mark: M::of(marks) }
    }

    pub(super) fn places(&self) -> [[f64; 3]; 3] {
        let corners = self.corners;
        corners.map(|corner| corner.map(Into::into))
    }

    pub(super) fn drift(&self) -> Drift {
        inwards(self.drift)
    }

    pub(super) fn marks(&self) -> Marks {
        let mark = self.mark;
        mark.marks()
    }
}

/// Bytes of a record.
pub(super) fn record_bytes<T, M>() -> u64 {
    size_of::<Record<T, M>>() as u64
}

/// Triangles read at a time.
const BLOCK: usize = 1 << 13;
/// Places that are kept of a pass's triangles, to cut space by: the most.
const SAMPLE: usize = 1 << 18;

/// Triangles in the order in which they came, and a sample of where they are.
pub(super) struct Soup<T, M> {
    spool: Spool,
    count: u64,
    sample: Sample<T>,
    /// The farthest that any place has drifted.
    pub(super) reached: f64,
    /// The most that any channel of a colour has changed.
    pub(super) recoloured: f64,
    records: PhantomData<M>,
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

impl<T: Coordinate, M: Mark> Soup<T, M> {
    pub(super) fn new(workspace: &Workspace, in_memory: u64) -> Soup<T, M> {
        let spool = workspace.spool(in_memory);
        Soup { spool, count: 0, sample: Sample::new(), reached: 0.0, recoloured: 0.0, records: PhantomData }
    }

    pub(super) fn count(&self) -> u64 {
        self.count
    }

    pub(super) fn append(&mut self, records: &[Record<T, M>]) -> Result<()> {
        for record in records {
            let corners = record.corners;
            self.sample.take(corners[0]);
            self.reached = self.reached.max(record.drift().most());
            if M::CARRIED {
                self.recoloured = self.recoloured.max(inwards(record.marks().tint).greatest());
            }
        }
        self.count += records.len() as u64;
        self.spool.append(bytemuck::cast_slice(records)).map(|_| ())
    }

    /// Visits all triangles in order, some at a time.
    pub(super) fn each_block(&self, mut visit: impl FnMut(&[Record<T, M>]) -> Result<()>) -> Result<()> {
        let mut records = Vec::new();
        for first in (0..self.count).step_by(BLOCK) {
            records.resize((self.count - first).min(BLOCK as u64) as usize, Record::zeroed());
            self.spool.read_at(first * size_of::<Record<T, M>>() as u64, bytemuck::cast_slice_mut(&mut records))?;
            visit(&records)?;
        }
        Ok(())
    }

    pub(super) fn sample(&self) -> &Sample<T> {
        &self.sample
    }
}
