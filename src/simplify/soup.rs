//! Triangles on their way from pass to pass: each with its corners' places, so that nothing else has to be looked up.

use std::marker::PhantomData;
use std::ops::Range;

use bytemuck::Zeroable;

use super::gap::Drift;
use super::mark::{Mark, Marks, inwards, outwards};
use crate::error::Result;
use crate::points::Coordinate;
use crate::storage::spool::{Extent, Spool, Workspace};

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

/// Visits the records in some bytes of a spool in order, some at a time.
pub(super) fn each_block<T: Coordinate, M: Mark>(
    spool: &Spool,
    bytes: Range<u64>,
    mut visit: impl FnMut(&[Record<T, M>]) -> Result<()>,
) -> Result<()> {
    let mut records = Vec::new();
    for first in bytes.clone().step_by(BLOCK * record_bytes::<T, M>() as usize) {
        let count = (bytes.end - first) / record_bytes::<T, M>();
        records.resize(count.min(BLOCK as u64) as usize, Record::zeroed());
        spool.read_at(first, bytemuck::cast_slice_mut(&mut records))?;
        visit(&records)?;
    }
    Ok(())
}

/// Bytes of a record.
pub(super) fn record_bytes<T, M>() -> u64 {
    size_of::<Record<T, M>>() as u64
}

/// Triangles read at a time.
pub(super) const BLOCK: usize = 1 << 13;
/// Places that are kept of a pass's triangles, to cut space by: the most.
const SAMPLE: usize = 1 << 18;

/// Triangles in the order in which they came, and a sample of where they are.
pub(super) struct Soup<T, M> {
    /// One, or some that others have made, one behind the other.
    spools: Vec<Spool>,
    count: u64,
    /// None where others have made it.
    sample: Option<Sample<T>>,
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
        Soup::in_spool(workspace.spool(in_memory))
    }

    /// One that is appended to a spool, which is empty.
    pub(super) fn in_spool(spool: Spool) -> Soup<T, M> {
        let (spools, sample) = (vec![spool], Some(Sample::new()));
        Soup { spools, count: 0, sample, reached: 0.0, recoloured: 0.0, records: PhantomData }
    }

    /// Those in spools, one behind the other, that have drifted and changed colour by so much at the most.
    pub(super) fn joined(spools: Vec<Spool>, [reached, recoloured]: [f64; 2]) -> Soup<T, M> {
        let count = spools.iter().map(Spool::len).sum::<u64>() / record_bytes::<T, M>();
        Soup { spools, count, sample: None, reached, recoloured, records: PhantomData }
    }

    /// What was appended, where it lies.
    pub(super) fn extent(&mut self) -> Extent {
        self.spools[0].extent()
    }

    pub(super) fn count(&self) -> u64 {
        self.count
    }

    pub(super) fn append(&mut self, records: &[Record<T, M>]) -> Result<()> {
        for record in records {
            let corners = record.corners;
            if let Some(sample) = &mut self.sample {
                sample.take(corners[0]);
            }
            self.reached = self.reached.max(record.drift().most());
            if M::CARRIED {
                self.recoloured = self.recoloured.max(inwards(record.marks().tint).greatest());
            }
        }
        self.count += records.len() as u64;
        self.spools[0].append(bytemuck::cast_slice(records)).map(|_| ())
    }

    /// Visits all triangles in order, some at a time.
    pub(super) fn each_block(&self, mut visit: impl FnMut(&[Record<T, M>]) -> Result<()>) -> Result<()> {
        self.spools.iter().try_for_each(|spool| each_block(spool, 0..spool.len(), &mut visit))
    }

    /// First corners of triangles all over it.
    pub(super) fn sample(&self) -> Result<Vec<[T; 3]>> {
        if let Some(sample) = &self.sample {
            return Ok(sample.places());
        }
        // Those that would have been kept while triangles came.
        let every = std::iter::successors(Some(1u64), |every| Some(2 * every));
        let every = every.into_iter().find(|every| self.count.div_ceil(*every) <= SAMPLE as u64).unwrap_or(1);
        let (mut places, mut record) =
            (Vec::with_capacity(self.count.div_ceil(every) as usize), [Record::<T, M>::zeroed()]);
        let (mut spools, mut before) = (self.spools.iter(), 0);
        let mut spool = spools.next();
        for number in (0..self.count).step_by(every as usize) {
            while let Some(records) = spool.map(|spool| spool.len() / record_bytes::<T, M>())
                && number >= before + records
            {
                before += records;
                spool = spools.next();
            }
            if let Some(spool) = spool {
                spool.read_at((number - before) * record_bytes::<T, M>(), bytemuck::cast_slice_mut(&mut record))?;
                places.push(record[0].corners[0]);
            }
        }
        Ok(places)
    }
}
