//! Buckets: the points by slice, [`BUCKET_SLICES`] slices to a bucket, in memory or in temporary storage.
//!
//! ```text
//!   blocks --decode, sort by bucket--> pieces --+--> the bucket's open chunk, until that is full --+--> kept
//!                                               +--> of a long piece, whole chunks at once --------+
//!   bucket 0: [chunk 0] [chunk 5] ... [open]     a chunk is one allocation, or one write to a page on disk
//!   bucket 1: [chunk 1] [chunk 2] ... [open]     points: x y z in the cloud's precision, file axes, 12 or 24 bytes,
//!                                                then, for the same points in the same order, their attributes' records
//! ```
//!
//! All of it is done by the workers: a bucket is locked while a piece is copied to its open chunk, and chunks are written by whoever fills them. So points
//! lie in a bucket in no order that could be told before; nothing later may depend on it.

mod fill;

use std::collections::VecDeque;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::{Deserialize, Serialize};

use self::fill::Filling;
use crate::error::{Error, Result};
use crate::grid::Grid;
use crate::grid::context::Context;
use crate::grid::partition::BUCKET_SLICES;
use crate::grid::trace::{Digests, Trace, are_same};
use crate::input::{Carried, Cloud, Segment};
use crate::points::Coordinate;
use crate::resources::workers::Spares;
use crate::storage::spool::PageFile;
use crate::storage::work::WorkFolder;
use crate::storage::work::sections::{Section, SectionReader, SectionWriter};

/// Chunks on disk that are announced before they are read: a bucket's lie all over the file, and disks are fast only if they are asked for several at a time.
const AHEAD: usize = 32;

/// Points that are added to a cloud's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Added {
    /// In the cloud's precision.
    pub points: Vec<[f64; 3]>,
    /// The records of their attributes, one after the other.
    pub attributes: Vec<u8>,
}

impl Added {
    /// What tells them from others.
    pub fn checksum(&self) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(bytemuck::cast_slice(&self.points));
        hasher.update(&self.attributes);
        hasher.finalize()
    }
}

/// The buckets of a cloud, readable in any order, from several threads.
#[derive(Debug)]
pub struct Buckets<T> {
    /// One, or one for each segment of the input that was sorted by itself; each has all buckets.
    parts: Vec<Part<T>>,
    /// Number of buckets.
    count: usize,
    /// Bytes of a point's attributes.
    stride: usize,
    /// Which were read, if somebody asks.
    trace: Trace,
}

/// The buckets of points that were sorted together.
#[derive(Debug)]
struct Part<T> {
    buckets: Vec<Bucket<T>>,
    /// Where chunks are kept; none if that is memory.
    page_file: Option<PageFile>,
    /// Points of a whole chunk.
    chunk: usize,
    /// Bytes of a point's attributes.
    stride: usize,
    /// What the pages are compared with as they are read, if another process wrote them.
    written: Option<Written>,
}

/// Pages that another process wrote.
#[derive(Debug)]
struct Written {
    checksums: Vec<u32>,
    /// Of each bucket: whether its pages were compared.
    compared: Vec<AtomicBool>,
    /// For messages.
    path: PathBuf,
}

/// What is kept of saved buckets beside their points.
#[derive(Debug, Serialize, Deserialize)]
struct SavedBuckets {
    page: usize,
    chunk: usize,
    stride: usize,
    sections: Vec<Section>,
}

/// The phase of a run, as the work folder names it.
pub const PHASE: &str = "buckets";

/// The points of one bucket.
#[derive(Debug)]
struct Bucket<T> {
    points: u64,
    /// The sum of the digests of all points with their attributes, whose order is not told: zero where nobody asks.
    digest: u64,
    /// Fewer points than a whole chunk.
    open: Chunk<T>,
    /// Chunks in memory.
    held: Vec<Chunk<T>>,
    /// Pages of chunks on disk: whole ones, but for the last.
    stored: Vec<u32>,
}

/// Points and their attributes.
#[derive(Debug)]
struct Chunk<T> {
    points: Vec<[T; 3]>,
    attributes: Vec<u8>,
}

impl<T: Coordinate> Buckets<T> {
    /// Sorts the whole cloud into buckets, with attributes or without, and what is added to it. `progress` is told the records of each block.
    ///
    /// Memory: a block, its sorted points and a chunk for each job in flight, and a chunk for each bucket.
    ///
    /// # Errors
    /// Errors of reading the input, [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn fill(
        (cloud, added, carried): (&Cloud, Option<&Added>, Carried),
        grid: &Grid,
        context: &Context,
        progress: impl FnMut(u64),
    ) -> Result<Buckets<T>> {
        Buckets::fill_with((cloud, None, carried), added, (grid, context), PHASE, progress)
    }

    /// The same with the points of a segment, if there is one, for a phase of that name.
    ///
    /// # Errors
    /// The same as [`Buckets::fill`].
    pub fn fill_with(
        (cloud, segment, carried): (&Cloud, Option<&Segment>, Carried),
        added: Option<&Added>,
        (grid, context): (&Grid, &Context),
        phase: &str,
        mut progress: impl FnMut(u64),
    ) -> Result<Buckets<T>> {
        let memory = &context.memory;
        let count = bucket_count(grid);
        let stride = cloud.carried(carried).stride();
        let page = memory.bucket_buffer as usize;
        let page_file = match (&context.work, memory.buckets_quota) {
            (Some(work), _) => Some(context.workspace.page_file_in(work.create(phase)?, page, (0, 0))),
            (None, 0) => Some(context.workspace.page_file(page)?),
            (None, _) => None,
        };
        let chunk = memory.bucket_buffer as usize / (size_of::<[T; 3]>() + stride);
        let filling = Filling::new(count, page_file, chunk, stride, segment.is_some());
        let spares = Spares::default();
        cloud.for_each_batch_of(
            segment,
            &context.workers,
            memory.blocks_in_flight,
            carried,
            |batch| spares.lend(|scratch| filling.sort(batch, grid, scratch)),
            |records| {
                progress(records);
                Ok(())
            },
        )?;
        if let Some(added) = added {
            spares.lend(|scratch| filling.add_all(added, grid, scratch))?;
        }
        context.workers.in_order_range(memory.blocks_in_flight, count, |bucket| filling.close(bucket), |()| Ok(()))?;
        Ok(filling.filled())
    }

    /// Moves the points that lie in memory to disk.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn leave_memory(&mut self, context: &Context) -> Result<()> {
        self.parts.iter_mut().try_for_each(|part| part.leave_memory(context))
    }

    /// Saves where the points lie, which is in a file of the work folder, and commits both as a phase.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    ///
    /// # Panics
    /// If they were not filled together.
    pub fn commit(&self, work: &WorkFolder, phase: &str) -> Result<()> {
        let [part] = &self.parts[..] else { panic!("what was filled together is committed") };
        part.commit(work, phase)
    }

    /// The buckets that were committed as phases, each of which filled them in part; none if one of these is not done.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`], [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn committed(
        work: &WorkFolder,
        phases: impl IntoIterator<Item = String>,
        grid: &Grid,
        compared: Compared,
        context: &Context,
    ) -> Result<Option<Buckets<T>>> {
        let parts: Option<Vec<Part<T>>> = phases
            .into_iter()
            .map(|phase| Part::committed(work, &phase, grid, compared, context).transpose())
            .collect::<Option<Result<_>>>()
            .transpose()?;
        let Some(parts) = parts else { return Ok(None) };
        let (count, stride) = (bucket_count(grid), parts.first().map_or(0, |part| part.stride));
        Ok(Some(Buckets { parts, count, stride, trace: Trace::default() }))
    }

    /// From now on it is told which buckets are read.
    pub fn trace(&mut self) {
        self.trace = Trace::of(self.count);
    }

    /// What was in those that were read since. Of points that were sorted as segments.
    pub fn traced(&self) -> Digests {
        self.trace.digests(|bucket| Ok(self.digest(bucket))).expect("digests are there")
    }

    /// Whether in these buckets the same points are, with the same attributes.
    pub fn are_same(&self, digests: &Digests) -> bool {
        are_same(digests, self.count, |bucket| Ok(self.digest(bucket))).expect("digests are there")
    }

    fn digest(&self, bucket: u32) -> u64 {
        self.parts.iter().fold(0, |sum: u64, part| sum.wrapping_add(part.buckets[bucket as usize].digest))
    }

    /// Number of buckets.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Bytes of a point's attributes.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Number of points in a bucket.
    pub fn points_in(&self, bucket: usize) -> u64 {
        self.parts.iter().map(|part| part.buckets[bucket].points).sum()
    }

    /// Number of points in a bucket, for whoever reads nothing where there are none.
    pub fn read_count(&self, bucket: usize) -> u64 {
        self.trace.read(bucket);
        self.points_in(bucket)
    }

    /// Number of points in all buckets.
    pub fn point_count(&self) -> u64 {
        (0..self.count).map(|bucket| self.points_in(bucket)).sum()
    }

    /// Hands the points of `bucket` to `visit`, a chunk at a time, in no order.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Damaged`], and what `visit` returns.
    pub fn read(&self, bucket: usize, visit: impl FnMut(&[[T; 3]]) -> Result<()>) -> Result<()> {
        self.read_share(bucket, 0..u64::MAX, visit)
    }

    /// The same for a share of them: those with numbers in `share`, in an order that stays the same once the buckets are filled.
    ///
    /// # Errors
    /// The same as [`Buckets::read`].
    pub fn read_share(
        &self,
        bucket: usize,
        share: Range<u64>,
        mut visit: impl FnMut(&[[T; 3]]) -> Result<()>,
    ) -> Result<()> {
        self.trace.read(bucket);
        let mut before = 0;
        for part in &self.parts {
            let points = part.buckets[bucket].points;
            let within = |number: u64| number.saturating_sub(before).min(points);
            let here = within(share.start)..within(share.end);
            before += points;
            if !here.is_empty() {
                part.read_share(bucket, here, &mut visit)?;
            }
        }
        Ok(())
    }

    /// Hands the points of `bucket` to `visit` with the records of their attributes, a chunk at a time, in no order.
    ///
    /// # Errors
    /// The same as [`Buckets::read`].
    pub fn read_attributes(&self, bucket: usize, mut visit: impl FnMut(&[[T; 3]], &[u8]) -> Result<()>) -> Result<()> {
        self.trace.read(bucket);
        self.parts.iter().try_for_each(|part| part.read_attributes(bucket, &mut visit))
    }
}

/// When points that another process wrote are compared with their checksums.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compared {
    /// All of them, at once.
    Now,
    /// Those of a bucket when it is read for the first time.
    AsRead,
}

fn bucket_count(grid: &Grid) -> usize {
    grid.cells()[1].div_ceil(BUCKET_SLICES) as usize
}

impl<T: Coordinate> Part<T> {
    fn leave_memory(&mut self, context: &Context) -> Result<()> {
        if self.page_file.is_some() {
            return Ok(());
        }
        let page_file = context.workspace.page_file(self.chunk * (size_of::<[T; 3]>() + self.stride))?;
        for bucket in &mut self.buckets {
            // All of a bucket's chunks but the last are whole, as its pages are.
            for chunk in std::mem::take(&mut bucket.held) {
                let (points, attributes) = (bytemuck::cast_slice(&chunk.points), chunk.attributes.as_slice());
                bucket.stored.push(page_file.put(&[points, attributes])?);
            }
        }
        self.page_file = Some(page_file);
        Ok(())
    }

    fn commit(&self, work: &WorkFolder, phase: &str) -> Result<()> {
        let Some(pages) = self.page_file.as_ref().and_then(PageFile::named) else { return Ok(()) };
        let mut out = SectionWriter::new(work, &format!("places-{phase}"))?;
        out.values(&self.buckets.iter().map(|bucket| bucket.points).collect::<Vec<u64>>())?;
        out.values(&self.buckets.iter().map(|bucket| bucket.digest).collect::<Vec<u64>>())?;
        out.values(&self.buckets.iter().flat_map(|bucket| bucket.stored.iter().copied()).collect::<Vec<u32>>())?;
        out.values(&self.page_file.as_ref().map(PageFile::checksums).unwrap_or_default())?;
        let (places, sections) = out.finish();
        let page = self.page_file.as_ref().map_or(0, PageFile::page);
        let saved = SavedBuckets { page, chunk: self.chunk, stride: self.stride, sections };
        let rest = serde_json::to_value(saved).expect("a manifest can be written");
        work.commit(phase, vec![pages.clone(), places], rest)
    }

    fn committed(
        work: &WorkFolder,
        phase: &str,
        grid: &Grid,
        compared: Compared,
        context: &Context,
    ) -> Result<Option<Part<T>>> {
        work.load(phase, |manifest| {
            let [pages, places] = manifest.files.as_slice() else {
                return Err(work.damaged(phase, "a file is missing"));
            };
            let of = |rest: &serde_json::Value| SavedBuckets::deserialize(rest).ok();
            let saved = of(&manifest.rest).ok_or_else(|| work.damaged(phase, "the manifest cannot be read"))?;
            let SavedBuckets { page, chunk, stride, sections } = saved;
            let mut sections = SectionReader::new(work, places, sections)?;
            let counts: Vec<u64> = sections.values()?;
            let digests: Vec<u64> = sections.values()?;
            let stored: Vec<u32> = sections.values()?;
            let checksums: Vec<u32> = sections.values()?;
            let point = size_of::<[T; 3]>() + stride;
            let count = bucket_count(grid);
            let pages_of = |points: u64| points.div_ceil(chunk.max(1) as u64);
            let fits = counts.len() == count
                && digests.len() == count
                && chunk > 0
                && chunk.checked_mul(point).is_some_and(|bytes| bytes <= page)
                && counts.iter().fold(0, |pages: u64, points| pages.saturating_add(pages_of(*points)))
                    == stored.len() as u64
                && stored.iter().all(|page| (*page as usize) < checksums.len());
            if !fits {
                return Err(work.damaged(places, "what it tells does not fit together"));
            }
            let mut rest = stored.as_slice();
            let mut buckets = Vec::with_capacity(count);
            for (points, digest) in counts.into_iter().zip(digests) {
                let (here, beyond) = rest.split_at(pages_of(points) as usize);
                rest = beyond;
                let stored = here.to_vec();
                buckets.push(Bucket { points, digest, open: Chunk::default(), held: Vec::new(), stored });
            }
            let bytes = buckets.iter().map(|bucket| bucket.points).sum::<u64>() * point as u64;
            let file = work.open_file(pages)?;
            let taken = (checksums.len() as u32, bytes);
            let file = context.workspace.page_file_in(file, page, taken);
            let written = Written {
                checksums,
                compared: std::iter::repeat_with(AtomicBool::default).take(count).collect(),
                path: work.path().join(pages),
            };
            let part = Part { buckets, page_file: Some(file), chunk, stride, written: Some(written) };
            if compared == Compared::Now {
                let jobs = context.memory.jobs_of(page as u64);
                context.workers.in_order_range(jobs, count, |bucket| part.compare(bucket), |()| Ok(()))?;
            }
            Ok(part)
        })
    }

    /// Compares a bucket's pages with their checksums, unless that was done before.
    fn compare(&self, bucket: usize) -> Result<()> {
        let Some((written, pages)) = self.written.as_ref().zip(self.page_file.as_ref()) else { return Ok(()) };
        if written.compared[bucket].load(Ordering::Relaxed) {
            return Ok(());
        }
        let (mut left, mut bytes) = (self.buckets[bucket].points, Vec::new());
        for page in &self.buckets[bucket].stored {
            let count = left.min(self.chunk as u64);
            left -= count;
            bytes.resize(count as usize * (size_of::<[T; 3]>() + self.stride), 0);
            pages.read(*page, 0, &mut bytes)?;
            if crc32fast::hash(&bytes) != written.checksums[*page as usize] {
                let found = format!("points of bucket {bucket} are not what was written");
                return Err(Error::Damaged { path: written.path.clone(), found });
            }
        }
        written.compared[bucket].store(true, Ordering::Relaxed);
        Ok(())
    }

    fn read_share(
        &self,
        bucket: usize,
        share: Range<u64>,
        mut visit: impl FnMut(&[[T; 3]]) -> Result<()>,
    ) -> Result<()> {
        self.compare(bucket)?;
        let bucket = &self.buckets[bucket];
        let mut before = 0;
        // Of the next so many points, those that are of the share.
        let mut shared = |count: usize| {
            let within = |number: u64| number.saturating_sub(before).min(count as u64) as usize;
            let part = within(share.start)..within(share.end);
            before += count as u64;
            part
        };
        let Some(page_file) = &self.page_file else {
            let parts = bucket.held.iter().map(|chunk| &chunk.points[shared(chunk.points.len())]);
            return parts.filter(|part| !part.is_empty()).try_for_each(visit);
        };
        let mut points = Vec::new();
        let mut left = bucket.points;
        let parts = bucket.stored.iter().map(|page| {
            let count = left.min(self.chunk as u64);
            left -= count;
            (*page, shared(count as usize))
        });
        let mut parts = parts.filter(|(_, part)| !part.is_empty());
        let mut announced = VecDeque::new();
        loop {
            while announced.len() < AHEAD
                && let Some((page, part)) = parts.next()
            {
                page_file.announce(page);
                announced.push_back((page, part));
            }
            let Some((page, part)) = announced.pop_front() else { return Ok(()) };
            points.resize(part.len(), [T::zeroed(); 3]);
            page_file.read(page, part.start * size_of::<[T; 3]>(), bytemuck::cast_slice_mut(&mut points))?;
            visit(&points)?;
        }
    }

    fn read_attributes(&self, bucket: usize, mut visit: impl FnMut(&[[T; 3]], &[u8]) -> Result<()>) -> Result<()> {
        self.compare(bucket)?;
        let bucket = &self.buckets[bucket];
        let Some(page_file) = &self.page_file else {
            return bucket.held.iter().try_for_each(|chunk| visit(&chunk.points, &chunk.attributes));
        };
        let (mut points, mut attributes) = (Vec::new(), Vec::new());
        let mut left = bucket.points;
        for page in &bucket.stored {
            points.resize(left.min(self.chunk as u64) as usize, [T::zeroed(); 3]);
            attributes.resize(points.len() * self.stride, 0);
            page_file.read(*page, 0, bytemuck::cast_slice_mut(&mut points))?;
            page_file.read(*page, size_of_val(points.as_slice()), &mut attributes)?;
            visit(&points, &attributes)?;
            left -= points.len() as u64;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::InputOptions;
    use crate::points::attribute::Wanted;
    use crate::points::bounds::{Axis, Bounds};
    use crate::run::testing::with_context;
    use crate::settings::{AxisChoice, Resolution};

    #[test]
    fn points_that_leave_memory_are_the_same_on_disk() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("cloud.bin");
        // More than a chunk in one bucket, few in another, none in a third.
        let place = |number: u32| [(number % 97) as f32, if number.is_multiple_of(100) { 11.5 } else { 1.5 }, 0.5];
        let points = 40_000u32;
        let bytes: Vec<u8> = (0..points)
            .flat_map(|number| place(number).into_iter().flat_map(f32::to_le_bytes).chain(number.to_le_bytes()))
            .collect();
        std::fs::write(&path, bytes).unwrap();
        let layout = Some("xyz,number:u32".parse().unwrap());
        let input = InputOptions { layout, attributes: Wanted::All, ..InputOptions::default() };
        let cloud = Cloud::open(&[path], &input).unwrap();
        let bounds = Bounds { min: [0.0; 3], max: [97.0, 12.0, 1.0] };
        let grid = Grid::new(points.into(), &bounds, Resolution::Cell(1.0), AxisChoice::Fixed(Axis::Y)).unwrap();
        with_context(grid.cells(), |context| {
            let mut context = context.clone();
            context.memory.buckets_quota = 1 << 20;
            let mut buckets =
                Buckets::<f32>::fill((&cloud, None, Carried::Attributes), &grid, &context, |_| ()).unwrap();
            let read = |buckets: &Buckets<f32>, bucket: usize| {
                let (mut points, mut numbers) = (Vec::new(), Vec::new());
                let add = |some: &[[f32; 3]], records: &[u8]| {
                    points.extend_from_slice(some);
                    numbers.extend_from_slice(records);
                    Ok(())
                };
                buckets.read_attributes(bucket, add).unwrap();
                let mut share = Vec::new();
                let some = |some: &[[f32; 3]]| {
                    share.extend_from_slice(some);
                    Ok(())
                };
                buckets.read_share(bucket, 5..30_000, some).unwrap();
                (points, numbers, share)
            };
            let all = |buckets: &Buckets<f32>| (0..3).map(|bucket| read(buckets, bucket)).collect::<Vec<_>>();
            let before = all(&buckets);
            assert_eq!(before.iter().map(|(points, ..)| points.len()).collect::<Vec<_>>(), [39_600, 0, 400]);
            assert_eq!(context.workspace.peak_on_disk(), 0);
            buckets.leave_memory(&context).unwrap();
            assert!(buckets.parts[0].buckets.iter().all(|bucket| bucket.held.is_empty()));
            assert_eq!(context.workspace.peak_on_disk(), u64::from(points) * 16);
            assert!(all(&buckets) == before);
        });
    }
}
