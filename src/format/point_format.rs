//! What a format of points is: a file whose structure is known, cut into blocks of whole records, which are decoded on any thread.

use std::fmt;
use std::path::PathBuf;

use crate::error::Result;
use crate::points::attribute::{Attribute, Schema};
use crate::points::crs::Crs;
use crate::points::{Batch, Precision};
use crate::storage::mapped::Content;

/// The length a block of records aims at: large against the cost of handing it to another thread, small enough for a
/// core's cache and for dozens in flight.
pub const BLOCK_BYTES: usize = 1 << 20;

/// The most records in a block, so that a decoded block is bounded as well: 1.5 MiB of `f64` coordinates.
pub const BLOCK_RECORDS: usize = 1 << 16;

/// The most records of so many bytes in a block.
pub(crate) fn records_of_a_block(record: usize) -> u64 {
    (BLOCK_BYTES / record).clamp(1, BLOCK_RECORDS) as u64
}

/// One file of a cloud, as it was understood.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// The file; "standard input" if it is that.
    pub path: PathBuf,
    /// The format's name: "raw", "PLY", "LAZ", "text".
    pub format: &'static str,
    /// What was understood, as a line to print.
    pub description: String,
    /// Number of records, where the format tells.
    pub records: Option<u64>,
    /// Length of the file, as it lies there.
    pub bytes: u64,
    /// The coordinate reference system, where the file tells.
    pub crs: Option<Crs>,
    /// What is odd about the file though its points are whole, as a sentence to print behind its path.
    pub remark: Option<String>,
}

/// A file whose structure is known.
///
/// It holds no open file: thousands of tiles may be waiting. [`PointFormat::cut`] opens it for one pass.
pub(crate) trait PointFormat: fmt::Debug + Send + Sync {
    /// The narrowest precision that keeps the coordinates.
    fn precision(&self) -> Precision;

    /// The attributes of its points.
    fn attributes(&self) -> &[Attribute];

    /// Where its scans were taken from, as far as it tells.
    fn stations(&self) -> Vec<[f64; 3]> {
        Vec::new()
    }

    /// The content that blocks are parts of until they are decoded; none if a block has bytes of its own.
    fn lent_from(&self) -> Option<&Content> {
        None
    }

    /// Opens the file and starts cutting at its first record; blocks are to be decoded with attributes of `schema`.
    fn cut(&self, schema: &Schema) -> Result<Box<dyn BlockCutter<'_> + '_>>;
}

/// One pass over a file.
pub(crate) trait BlockCutter<'a>: Send {
    /// The next block of whole records; `None` at the end. Sequential, and much cheaper than decoding.
    fn next(&mut self) -> Result<Option<Box<dyn Decode + 'a>>>;
}

/// The records of a block.
pub(crate) trait Decode: Send + Sync {
    /// Appends all points to `batch`, which comes empty and in the cloud's precision, with a record of the schema for each. Those that are
    /// not finite are left out later, and not by the format.
    fn decode(&self, batch: &mut Batch) -> Result<()>;

    /// Where all of them were scanned from, if the file tells.
    fn station(&self) -> Option<[f64; 3]> {
        None
    }
}

/// So many points that do not count.
pub(crate) struct Uncounted(pub u64);

impl Decode for Uncounted {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        batch.filtered += self.0;
        Ok(())
    }
}
