//! Buckets: the points by slice, [`BUCKET_SLICES`] slices to a bucket, in temporary storage.
//!
//! ```text
//!   blocks --decode, sort by bucket--> pieces --append--> one buffer per bucket --when full--> extent in the spool
//!   bucket 0: [extent 0] [extent 5] ...      all buckets share one spool; an extent is one write
//!   bucket 1: [extent 1] [extent 2] ...      points: x y z in the cloud's precision, file axes, 12 or 24 bytes
//! ```
//!
//! The order of points inside a bucket is the order of arrival; nothing later may depend on it.

use std::marker::PhantomData;

use crate::context::Context;
use crate::error::Result;
use crate::grid::Grid;
use crate::input::Cloud;
use crate::partition::BUCKET_SLICES;
use crate::points::{Batch, Coordinate, Points};
use crate::spool::Spool;

/// The buckets of a cloud, readable in any order, from several threads.
#[derive(Debug)]
pub struct Buckets<T> {
    spool: Spool,
    extents: Vec<Vec<Extent>>,
    points: u64,
    precision: PhantomData<T>,
}

/// A stretch of one bucket's points in the spool.
#[derive(Debug, Clone, Copy)]
struct Extent {
    at: u64,
    points: u32,
}

/// The points of one block, sorted by bucket.
struct Sorted<T> {
    points: Vec<[T; 3]>,
    /// Bucket and number of points, in the order of `points`.
    pieces: Vec<(u32, u32)>,
    records: u64,
}

impl<T: Coordinate> Buckets<T> {
    /// Sorts the whole cloud into buckets. `progress` is told the records of each block.
    ///
    /// Memory: a block and its sorted points for each job in flight, and a buffer for each bucket.
    ///
    /// # Errors
    /// Those of reading the input, [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn fill(cloud: &Cloud, grid: &Grid, context: &Context, mut progress: impl FnMut(u64)) -> Result<Buckets<T>> {
        let count = grid.cells()[1].div_ceil(BUCKET_SLICES) as usize;
        let capacity = (context.memory.bucket_buffer as usize / size_of::<[T; 3]>()).max(1);
        let mut buckets = Buckets {
            spool: context.workspace.spool(context.memory.buckets_quota),
            extents: vec![Vec::new(); count],
            points: 0,
            precision: PhantomData,
        };
        let mut buffers: Vec<Vec<[T; 3]>> = vec![Vec::new(); count];
        cloud.for_each_batch(
            &context.workers,
            context.memory.blocks_in_flight,
            |batch| Ok(sort_by_bucket(batch, grid, count)),
            |sorted: Sorted<T>| {
                let mut rest = sorted.points.as_slice();
                for (bucket, points) in sorted.pieces {
                    let (mut piece, after) = rest.split_at(points as usize);
                    rest = after;
                    let buffer = &mut buffers[bucket as usize];
                    while !piece.is_empty() {
                        let (fits, left) = piece.split_at(piece.len().min(capacity - buffer.len()));
                        if buffer.capacity() == 0 {
                            // Whole at once: growing by and by would leave the smaller ones' memory behind. Untouched pages cost nothing.
                            buffer.reserve_exact(capacity);
                        }
                        buffer.extend_from_slice(fits);
                        piece = left;
                        if buffer.len() == capacity {
                            buckets.flush(bucket as usize, buffer)?;
                        }
                    }
                }
                progress(sorted.records);
                Ok(())
            },
        )?;
        for (bucket, buffer) in buffers.iter_mut().enumerate() {
            buckets.flush(bucket, buffer)?;
        }
        Ok(buckets)
    }

    fn flush(&mut self, bucket: usize, buffer: &mut Vec<[T; 3]>) -> Result<()> {
        if !buffer.is_empty() {
            let at = self.spool.append(bytemuck::cast_slice(buffer))?;
            self.extents[bucket].push(Extent { at, points: buffer.len() as u32 });
            self.points += buffer.len() as u64;
            buffer.clear();
        }
        Ok(())
    }

    /// Number of buckets.
    pub fn count(&self) -> usize {
        self.extents.len()
    }

    /// Number of points in a bucket.
    pub fn points_in(&self, bucket: usize) -> u64 {
        self.extents[bucket].iter().map(|extent| u64::from(extent.points)).sum()
    }

    /// Number of points in all buckets.
    pub fn point_count(&self) -> u64 {
        self.points
    }

    /// Hands the points of `bucket` to `visit`, at most `at_once` at a time, in order of arrival.
    ///
    /// # Errors
    /// [`crate::Error::Io`], and what `visit` returns.
    pub fn read(&self, bucket: usize, at_once: usize, mut visit: impl FnMut(&[[T; 3]]) -> Result<()>) -> Result<()> {
        let mut buffer: Vec<[T; 3]> = Vec::new();
        for extent in &self.extents[bucket] {
            let mut done = 0;
            while done < extent.points as usize {
                let now = at_once.max(1).min(extent.points as usize - done);
                buffer.resize(now, [T::zeroed(); 3]);
                let at = extent.at + (done * size_of::<[T; 3]>()) as u64;
                self.spool.read_at(at, bytemuck::cast_slice_mut(&mut buffer))?;
                visit(&buffer)?;
                done += now;
            }
        }
        Ok(())
    }
}

/// A counting sort of a batch's points by bucket; points of one bucket stay in file order.
fn sort_by_bucket<T: Coordinate>(batch: &Batch, grid: &Grid, buckets: usize) -> Sorted<T> {
    let records = batch.points.len() as u64 + batch.dropped;
    let (points, pieces) = match &batch.points {
        Points::Single(points) => counting_sort(points, |c| T::from_f64(f64::from(c)), grid, buckets),
        Points::Double(points) => counting_sort(points, T::from_f64, grid, buckets),
    };
    Sorted { points, pieces, records }
}

fn counting_sort<S: Coordinate, T: Coordinate>(
    points: &[[S; 3]],
    convert: impl Fn(S) -> T,
    grid: &Grid,
    buckets: usize,
) -> (Vec<[T; 3]>, Vec<(u32, u32)>) {
    let mut counts = vec![0u32; buckets];
    let places: Vec<u32> = points
        .iter()
        .map(|p| {
            let bucket = grid.slice_of(p.map(Into::into)) / BUCKET_SLICES;
            counts[bucket as usize] += 1;
            bucket
        })
        .collect();
    let pieces: Vec<(u32, u32)> =
        counts.iter().enumerate().filter(|(_, n)| **n > 0).map(|(bucket, n)| (bucket as u32, *n)).collect();
    let mut next = 0;
    for count in &mut counts {
        next += std::mem::replace(count, next);
    }
    let mut sorted = vec![[T::zeroed(); 3]; points.len()];
    for (point, bucket) in points.iter().zip(places) {
        let at = &mut counts[bucket as usize];
        sorted[*at as usize] = [convert(point[0]), convert(point[1]), convert(point[2])];
        *at += 1;
    }
    (sorted, pieces)
}
