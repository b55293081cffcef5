//! Filling buckets: all workers sort blocks of points, and add them to the buckets' open chunks.

use std::sync::{Mutex, MutexGuard};

use super::{Added, Bucket, Buckets, Chunk, Part};
use crate::error::Result;
use crate::grid::Grid;
use crate::grid::partition::BUCKET_SLICES;
use crate::grid::trace::{Trace, digest};
use crate::points::{Batch, Coordinate};
use crate::storage::spool::PageFile;

/// The same, lent.
#[derive(Clone, Copy)]
struct Lent<'a, T> {
    points: &'a [[T; 3]],
    attributes: &'a [u8],
}

/// The working memory of a job that sorts a block.
pub(super) struct Scratch<T> {
    /// The bucket of each point.
    places: Vec<u32>,
    /// For each bucket: its number of points, then where the next one goes.
    counts: Vec<u32>,
    sorted: Chunk<T>,
    /// An empty chunk.
    spare: Chunk<T>,
}

/// Buckets that all workers fill.
pub(super) struct Filling<T> {
    buckets: Vec<Mutex<Bucket<T>>>,
    page_file: Option<PageFile>,
    chunk: usize,
    stride: usize,
    /// Whether it is told what is in each bucket.
    digested: bool,
}

/// A chunk where it stays.
enum Kept<T> {
    Held(Chunk<T>),
    Stored(u32),
}

impl<T: Coordinate> Filling<T> {
    /// So many empty buckets.
    pub fn new(count: usize, page_file: Option<PageFile>, chunk: usize, stride: usize, digested: bool) -> Filling<T> {
        let empty = || {
            let (open, held, stored) = (Chunk::default(), Vec::new(), Vec::new());
            Mutex::new(Bucket { points: 0, digest: 0, open, held, stored })
        };
        let buckets = std::iter::repeat_with(empty).take(count).collect();
        Filling { buckets, page_file, chunk, stride, digested }
    }

    /// Sorts what is added to the cloud's points into the buckets, some at a time.
    pub fn add_all(&self, added: &Added, grid: &Grid, scratch: &mut Scratch<T>) -> Result<()> {
        const AT_A_TIME: usize = 4096;
        for (number, points) in added.points.chunks(AT_A_TIME).enumerate() {
            let points: Vec<[T; 3]> = points.iter().map(|point| point.map(T::from_f64)).collect();
            // Where attributes are not carried, they have no bytes.
            let attributes = &added.attributes[number * AT_A_TIME * self.stride..][..points.len() * self.stride];
            self.sort_part(Lent { points: &points, attributes }, grid, scratch)?;
        }
        Ok(())
    }

    /// Sorts a block's points into the buckets, and returns the number of the block's records.
    pub fn sort(&self, batch: &Batch, grid: &Grid, scratch: &mut Scratch<T>) -> Result<u64> {
        let part = Lent { points: T::of(&batch.points), attributes: &batch.attributes };
        self.sort_part(part, grid, scratch)?;
        Ok(batch.records())
    }

    fn sort_part(&self, part: Lent<'_, T>, grid: &Grid, scratch: &mut Scratch<T>) -> Result<()> {
        scratch.sort(part, self.stride, grid, self.buckets.len());
        let mut rest = scratch.sorted.part();
        let mut start = 0;
        for bucket in 0..self.buckets.len() {
            // Where the next point would go: the end.
            let end = scratch.counts[bucket] as usize;
            if start < end {
                let (here, beyond) = rest.split(end - start, self.stride);
                self.add(bucket, here, &mut scratch.spare)?;
                (rest, start) = (beyond, end);
            }
        }
        Ok(())
    }

    /// Adds points to a bucket. `spare` is an empty chunk, and stays one.
    fn add(&self, bucket: usize, part: Lent<'_, T>, spare: &mut Chunk<T>) -> Result<()> {
        let digest = if self.digested { part.digest(self.stride) } else { 0 };
        let (mut whole, rest) = part.split(part.points.len() / self.chunk * self.chunk, self.stride);
        while !whole.points.is_empty() {
            let (chunk, beyond) = whole.split(self.chunk, self.stride);
            let kept = self.kept(chunk)?;
            self.lock(bucket).keep(kept);
            whole = beyond;
        }
        let mut full = {
            let mut bucket = self.lock(bucket);
            bucket.points += part.points.len() as u64;
            bucket.digest = bucket.digest.wrapping_add(digest);
            bucket.open.reserve(self.chunk, self.stride);
            let (fits, left) = rest.split(rest.points.len().min(self.chunk - bucket.open.points.len()), self.stride);
            bucket.open.extend(fits);
            if bucket.open.points.len() < self.chunk {
                return Ok(());
            }
            spare.reserve(self.chunk, self.stride);
            spare.extend(left);
            std::mem::replace(&mut bucket.open, std::mem::take(spare))
        };
        // Nobody waits for the bucket while its chunk is written.
        let kept = match &self.page_file {
            Some(_) => {
                let kept = self.kept(full.part())?;
                full.points.clear();
                full.attributes.clear();
                *spare = full;
                kept
            }
            None => Kept::Held(full),
        };
        self.lock(bucket).keep(kept);
        Ok(())
    }

    /// Puts a chunk where it stays.
    fn kept(&self, part: Lent<'_, T>) -> Result<Kept<T>> {
        Ok(match &self.page_file {
            Some(page_file) => Kept::Stored(page_file.put(&[bytemuck::cast_slice(part.points), part.attributes])?),
            None => Kept::Held(Chunk { points: part.points.to_vec(), attributes: part.attributes.to_vec() }),
        })
    }

    /// Keeps what is left in a bucket's open chunk.
    pub fn close(&self, bucket: usize) -> Result<()> {
        let mut bucket = self.lock(bucket);
        let open = std::mem::take(&mut bucket.open);
        if !open.points.is_empty() {
            let kept = if self.page_file.is_some() { self.kept(open.part())? } else { Kept::Held(open) };
            bucket.keep(kept);
        }
        Ok(())
    }

    pub fn filled(self) -> Buckets<T> {
        let Filling { page_file, chunk, stride, .. } = self;
        let buckets: Vec<_> = self.buckets.into_iter().map(|bucket| bucket.into_inner().expect(NO_PANIC)).collect();
        let count = buckets.len();
        let parts = vec![Part { buckets, page_file, chunk, stride, written: None }];
        Buckets { parts, count, stride, trace: Trace::default() }
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
            Kept::Stored(page) => self.stored.push(page),
        }
    }
}

impl<T> Default for Chunk<T> {
    fn default() -> Self {
        Chunk { points: Vec::new(), attributes: Vec::new() }
    }
}

impl<T: Coordinate> Chunk<T> {
    /// Makes room for so many points, if there is none yet.
    fn reserve(&mut self, points: usize, stride: usize) {
        if self.points.capacity() == 0 {
            self.points.reserve_exact(points);
            self.attributes.reserve_exact(points * stride);
        }
    }

    fn extend(&mut self, part: Lent<'_, T>) {
        self.points.extend_from_slice(part.points);
        self.attributes.extend_from_slice(part.attributes);
    }

    fn part(&self) -> Lent<'_, T> {
        Lent { points: &self.points, attributes: &self.attributes }
    }
}

impl<T: Coordinate> Lent<'_, T> {
    /// The sum of all points' digests, each of its coordinates and its record together: what one has must not pass for another's.
    fn digest(&self, stride: usize) -> u64 {
        let mut whole = Vec::with_capacity(size_of::<[T; 3]>() + stride);
        let of_point = |(number, point): (usize, &[T; 3])| {
            whole.clear();
            whole.extend_from_slice(bytemuck::bytes_of(point));
            whole.extend_from_slice(&self.attributes[number * stride..][..stride]);
            digest(&whole)
        };
        self.points.iter().enumerate().map(of_point).fold(0, u64::wrapping_add)
    }
}

impl<'a, T> Lent<'a, T> {
    /// The first `points` points, and the others.
    fn split(self, points: usize, stride: usize) -> (Lent<'a, T>, Lent<'a, T>) {
        let (first, others) = self.points.split_at(points);
        let (attributes, of_others) = self.attributes.split_at(points * stride);
        (Lent { points: first, attributes }, Lent { points: others, attributes: of_others })
    }
}

impl<T> Default for Scratch<T> {
    fn default() -> Self {
        Scratch { places: Vec::new(), counts: Vec::new(), sorted: Chunk::default(), spare: Chunk::default() }
    }
}

impl<T: Coordinate> Scratch<T> {
    /// A counting sort of points by bucket. Afterwards `counts` says of each bucket where its points end.
    fn sort(&mut self, part: Lent<'_, T>, stride: usize, grid: &Grid, buckets: usize) {
        let Scratch { places, counts, sorted, .. } = self;
        let points = part.points;
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
        sorted.points.resize(points.len(), [T::zeroed(); 3]);
        sorted.attributes.resize(points.len() * stride, 0);
        if stride > 0 {
            // Before the points are sorted, which moves the counts on.
            let mut ends = counts.clone();
            for (record, bucket) in part.attributes.chunks_exact(stride).zip(places.iter()) {
                let at = &mut ends[*bucket as usize];
                sorted.attributes[*at as usize * stride..][..stride].copy_from_slice(record);
                *at += 1;
            }
        }
        for (point, bucket) in points.iter().zip(places) {
            let at = &mut counts[*bucket as usize];
            sorted.points[*at as usize] = *point;
            *at += 1;
        }
    }
}
