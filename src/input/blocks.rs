//! The blocks of a cloud's files, one after the other, or those of a segment.

use std::ops::Range;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::format::point_format::{BlockCutter, Decode, PointFormat};
use crate::points::filter::{Sieve, Verdict, judged};
use crate::points::{Batch, Points, Precision};

/// A part of the input: of some files, some of the blocks, by the file's number and theirs.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Segment(pub Vec<(usize, Range<u64>)>);

impl Segment {
    /// Files of so many blocks each, cut into `count` segments, or fewer if there are fewer blocks, of about as many blocks.
    pub fn cut(of_source: &[u64], count: usize) -> Vec<Segment> {
        let all: u64 = of_source.iter().sum();
        let count = (count as u64).clamp(1, all.max(1));
        let mut segments = vec![Segment::default(); count as usize];
        let mut before = 0;
        for (source, &blocks) in of_source.iter().enumerate() {
            for (segment, number) in segments.iter_mut().zip(0..) {
                let end = |number: u64| (all * number / count).clamp(before, before + blocks) - before;
                let within = end(number)..end(number + 1);
                if !within.is_empty() {
                    segment.0.push((source, within));
                }
            }
            before += blocks;
        }
        segments
    }

    /// Whether blocks of a file belong to it.
    pub fn reads(&self, source: usize) -> bool {
        !self.of(source).is_empty()
    }

    /// The blocks of a file that belong to it, if any do.
    pub fn range_of(&self, source: usize) -> Option<Range<u64>> {
        Some(self.of(source)).filter(|blocks| !blocks.is_empty())
    }

    /// The blocks of a file that belong to it.
    fn of(&self, source: usize) -> Range<u64> {
        self.0.iter().find(|(of, _)| *of == source).map_or(0..0, |(_, blocks)| blocks.clone())
    }
}

/// One pass over a cloud, or a segment of it.
pub struct Blocks<'a> {
    waiting: std::iter::Enumerate<std::slice::Iter<'a, Arc<dyn PointFormat + 'a>>>,
    current: Option<Current<'a>>,
    within: Option<&'a Segment>,
    precision: Precision,
    sieve: Arc<Sieve>,
    verdict: Option<Arc<dyn Verdict>>,
}

/// The file that is read.
struct Current<'a> {
    source: usize,
    cutter: Box<dyn BlockCutter<'a> + 'a>,
    /// Of the blocks that are left, those that are wanted.
    left: Range<u64>,
}

impl<'a> Blocks<'a> {
    /// Of all files.
    pub(super) fn of(
        formats: &'a [Arc<dyn PointFormat + 'a>],
        precision: Precision,
        sieve: Arc<Sieve>,
        verdict: Option<Arc<dyn Verdict>>,
    ) -> Blocks<'a> {
        Blocks { waiting: formats.iter().enumerate(), current: None, within: None, precision, sieve, verdict }
    }

    /// Those of a segment, or of everything if there is none.
    pub(super) fn within(self, segment: Option<&'a Segment>) -> Blocks<'a> {
        Blocks { within: segment, ..self }
    }

    /// The next block; `None` at the end. Cheap: it only finds where the block ends.
    ///
    /// # Errors
    /// If a file cannot be read, changed its length since it was looked at, or is malformed.
    pub fn next_block(&mut self) -> Result<Option<Block<'a>>> {
        loop {
            if let Some(Current { source, cutter, left }) = &mut self.current {
                let source = *source;
                let records = if left.end > 0 { cutter.next()? } else { None };
                let Some(records) = records else {
                    self.current = None;
                    continue;
                };
                let before = left.start > 0;
                *left = left.start.saturating_sub(1)..left.end - 1;
                if before {
                    continue;
                }
                let (sieve, verdict) = (Arc::clone(&self.sieve), self.verdict.clone());
                return Ok(Some(Block { records, source, precision: self.precision, sieve, verdict }));
            }
            let Some((source, format)) = self.waiting.next() else { return Ok(None) };
            let left = self.within.map_or(0..u64::MAX, |segment| segment.of(source));
            if !left.is_empty() {
                self.current = Some(Current { source, cutter: format.cut(&self.sieve.decoded)?, left });
            }
        }
    }
}

/// Undecoded records, to be decoded on any thread.
pub struct Block<'a> {
    records: Box<dyn Decode + 'a>,
    source: usize,
    precision: Precision,
    sieve: Arc<Sieve>,
    verdict: Option<Arc<dyn Verdict>>,
}

impl Block<'_> {
    /// The number of its file.
    pub(super) fn source(&self) -> usize {
        self.source
    }

    /// Replaces the content of `batch` by this block's points that count, in file order and the cloud's precision. Reusing a batch
    /// saves its allocation.
    ///
    /// # Errors
    /// [`Error::Malformed`] if the bytes are not what the format promises.
    pub fn decode(&self, batch: &mut Batch) -> Result<()> {
        match (&mut batch.points, self.precision) {
            (Points::Single(points), Precision::Single) => points.clear(),
            (Points::Double(points), Precision::Double) => points.clear(),
            (points, precision) => *points = Points::new(precision),
        }
        batch.attributes.clear();
        (batch.dropped, batch.filtered) = (0, 0);
        (batch.station, batch.source) = (self.records.station(), self.source);
        self.records.decode(batch)?;
        self.sieve.sift(batch);
        self.verdict.as_deref().map_or(Ok(()), |verdict| judged(batch, verdict))
    }
}
