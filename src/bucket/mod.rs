//! Buckets: the points by slice, [`BUCKET_SLICES`] slices to a bucket, in memory or in temporary storage.
//!
//! ```text
//!   blocks --decode, sort by bucket--> pieces --+--> the bucket's open chunk, until that is full --+--> kept
//!                                               +--> of a long piece, whole chunks at once --------+
//!   bucket 0: [chunk 0] [chunk 5] ... [open]     a chunk is one allocation, or one write to a slot on disk
//!   bucket 1: [chunk 1] [chunk 2] ... [open]     points: x y z in the cloud's precision, file axes, 12 or 24 bytes
//! ```
//!
//! All of it is done by the workers: a bucket is locked while a piece is copied to its open chunk, and chunks are written by whoever fills them. So points
//! lie in a bucket in no order that could be told before; nothing later may depend on it.

use std::sync::{Mutex, MutexGuard};

use crate::context::Context;
use crate::error::Result;
use crate::grid::Grid;
use crate::input::Cloud;
use crate::partition::BUCKET_SLICES;
use crate::points::{Batch, Coordinate};
use crate::schedule::Spares;
use crate::spool::Slots;

/// The buckets of a cloud, readable in any order, from several threads.
#[derive(Debug)]
pub struct Buckets<T> {
    buckets: Vec<Bucket<T>>,
    /// Where chunks are kept; none if that is memory.
    slots: Option<Slots>,
    /// Points of a whole chunk.
    chunk: usize,
}

/// The points of one bucket.
#[derive(Debug)]
struct Bucket<T> {
    points: u64,
    /// Fewer points than a whole chunk.
    open: Vec<[T; 3]>,
    /// Chunks in memory.
    held: Vec<Vec<[T; 3]>>,
    /// Slots of chunks on disk: whole ones, but for the last.
    stored: Vec<u32>,
}

/// The working memory of a job that sorts a block.
struct Scratch<T> {
    /// Of each point: its bucket.
    places: Vec<u32>,
    /// Of each bucket: its points, then where the next one goes.
    counts: Vec<u32>,
    sorted: Vec<[T; 3]>,
    /// An empty chunk.
    spare: Vec<[T; 3]>,
}

impl<T: Coordinate> Buckets<T> {
    /// Sorts the whole cloud into buckets. `progress` is told the records of each block.
    ///
    /// Memory: a block, its sorted points and a chunk for each job in flight, and a chunk for each bucket.
    ///
    /// # Errors
    /// Those of reading the input, [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn fill(cloud: &Cloud, grid: &Grid, context: &Context, mut progress: impl FnMut(u64)) -> Result<Buckets<T>> {
        let memory = &context.memory;
        let count = grid.cells()[1].div_ceil(BUCKET_SLICES) as usize;
        let slots = match memory.buckets_quota {
            0 => Some(context.workspace.slots(memory.bucket_buffer as usize)?),
            _ => None,
        };
        let empty = || Mutex::new(Bucket { points: 0, open: Vec::new(), held: Vec::new(), stored: Vec::new() });
        let filling = Filling {
            buckets: std::iter::repeat_with(empty).take(count).collect(),
            slots,
            chunk: memory.bucket_buffer as usize / size_of::<[T; 3]>(),
        };
        let spares = Spares::default();
        cloud.for_each_batch(
            &context.workers,
            memory.blocks_in_flight,
            |batch| spares.lend(|scratch| filling.sort(batch, grid, scratch)),
            |records| {
                progress(records);
                Ok(())
            },
        )?;
        context.workers.in_order_range(memory.blocks_in_flight, count, |bucket| filling.close(bucket), |()| Ok(()))?;
        Ok(filling.filled())
    }

    /// Number of buckets.
    pub fn count(&self) -> usize {
        self.buckets.len()
    }

    /// Number of points in a bucket.
    pub fn points_in(&self, bucket: usize) -> u64 {
        self.buckets[bucket].points
    }

    /// Number of points in all buckets.
    pub fn point_count(&self) -> u64 {
        self.buckets.iter().map(|bucket| bucket.points).sum()
    }

    /// Hands the points of `bucket` to `visit`, at most `at_once` at a time, in no order.
    ///
    /// # Errors
    /// [`crate::Error::Io`], and what `visit` returns.
    pub fn read(&self, bucket: usize, at_once: usize, mut visit: impl FnMut(&[[T; 3]]) -> Result<()>) -> Result<()> {
        let bucket = &self.buckets[bucket];
        let Some(slots) = &self.slots else {
            return bucket.held.iter().flat_map(|chunk| chunk.chunks(at_once.max(1))).try_for_each(visit);
        };
        let mut chunk = Vec::new();
        let mut left = bucket.points;
        for slot in &bucket.stored {
            chunk.resize(left.min(self.chunk as u64) as usize, [T::zeroed(); 3]);
            slots.read(*slot, bytemuck::cast_slice_mut(&mut chunk))?;
            chunk.chunks(at_once.max(1)).try_for_each(&mut visit)?;
            left -= chunk.len() as u64;
        }
        Ok(())
    }
}

/// Buckets that all workers fill.
struct Filling<T> {
    buckets: Vec<Mutex<Bucket<T>>>,
    slots: Option<Slots>,
    chunk: usize,
}

/// A chunk where it stays.
enum Kept<T> {
    Held(Vec<[T; 3]>),
    Stored(u32),
}

impl<T: Coordinate> Filling<T> {
    /// Sorts a block's points into the buckets, and returns the number of the block's records.
    fn sort(&self, batch: &Batch, grid: &Grid, scratch: &mut Scratch<T>) -> Result<u64> {
        let points = T::of(&batch.points);
        scratch.sort(points, grid, self.buckets.len());
        let mut start = 0;
        for bucket in 0..self.buckets.len() {
            // Where the next point would go: the end.
            let end = scratch.counts[bucket] as usize;
            if start < end {
                self.add(bucket, &scratch.sorted[start..end], &mut scratch.spare)?;
            }
            start = end;
        }
        Ok(points.len() as u64 + batch.dropped)
    }

    /// Adds points to a bucket. `spare` is an empty chunk, and stays one.
    fn add(&self, bucket: usize, points: &[[T; 3]], spare: &mut Vec<[T; 3]>) -> Result<()> {
        let (whole, rest) = points.split_at(points.len() / self.chunk * self.chunk);
        let chunks = whole.chunks_exact(self.chunk).map(|chunk| match &self.slots {
            Some(slots) => Ok(Kept::Stored(slots.put(bytemuck::cast_slice(chunk))?)),
            None => Ok(Kept::Held(chunk.to_vec())),
        });
        for chunk in chunks.collect::<Result<Vec<_>>>()? {
            self.lock(bucket).keep(chunk);
        }
        let mut full = {
            let mut bucket = self.lock(bucket);
            bucket.points += points.len() as u64;
            if bucket.open.capacity() == 0 {
                bucket.open.reserve_exact(self.chunk);
            }
            let (fits, left) = rest.split_at(rest.len().min(self.chunk - bucket.open.len()));
            bucket.open.extend_from_slice(fits);
            if bucket.open.len() < self.chunk {
                return Ok(());
            }
            if spare.capacity() == 0 {
                spare.reserve_exact(self.chunk);
            }
            spare.extend_from_slice(left);
            std::mem::replace(&mut bucket.open, std::mem::take(spare))
        };
        // Nobody waits for the bucket while its chunk is written.
        let kept = match &self.slots {
            Some(slots) => {
                let slot = slots.put(bytemuck::cast_slice(&full))?;
                full.clear();
                *spare = full;
                Kept::Stored(slot)
            }
            None => Kept::Held(full),
        };
        self.lock(bucket).keep(kept);
        Ok(())
    }

    /// Keeps what is left in a bucket's open chunk.
    fn close(&self, bucket: usize) -> Result<()> {
        let mut bucket = self.lock(bucket);
        let open = std::mem::take(&mut bucket.open);
        if !open.is_empty() {
            let kept = match &self.slots {
                Some(slots) => Kept::Stored(slots.put(bytemuck::cast_slice(&open))?),
                None => Kept::Held(open),
            };
            bucket.keep(kept);
        }
        Ok(())
    }

    fn filled(self) -> Buckets<T> {
        let unlocked = self.buckets.into_iter().map(|bucket| bucket.into_inner().expect(NO_PANIC));
        Buckets { buckets: unlocked.collect(), slots: self.slots, chunk: self.chunk }
    }

    fn lock(&self, bucket: usize) -> MutexGuard<'_, Bucket<T>> {
        self.buckets[bucket].lock().expect(NO_PANIC)
    }
}

const NO_PANIC: &str = "no job panics while it holds a bucket";

impl<T> Bucket<T> {
    fn keep(&mut self, chunk: Kept<T>) {
        match chunk {
            Kept::Held(points) => self.held.push(points),
            Kept::Stored(slot) => self.stored.push(slot),
        }
    }
}

impl<T> Default for Scratch<T> {
    fn default() -> Self {
        Scratch { places: Vec::new(), counts: Vec::new(), sorted: Vec::new(), spare: Vec::new() }
    }
}

impl<T: Coordinate> Scratch<T> {
    /// A counting sort of points by bucket. Afterwards `counts` says of each bucket where its points end.
    fn sort(&mut self, points: &[[T; 3]], grid: &Grid, buckets: usize) {
        let Scratch { places, counts, sorted, .. } = self;
        counts.clear();
        counts.resize(buckets, 0);
        places.clear();
        places.extend(points.iter().map(|p| {
            let bucket = grid.slice_of(p.map(Into::into)) / BUCKET_SLICES;
            counts[bucket as usize] += 1;
            bucket
        }));
        let mut next = 0;
        for count in counts.iter_mut() {
            next += std::mem::replace(count, next);
        }
        // What was there is overwritten: only what is longer than ever before is set to zero first.
        sorted.resize(points.len(), [T::zeroed(); 3]);
        for (point, bucket) in points.iter().zip(places) {
            let at = &mut counts[*bucket as usize];
            sorted[*at as usize] = *point;
            *at += 1;
        }
    }
}
