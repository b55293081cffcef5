//! Slices in temporary storage.

use super::cells::{Bits, Run, Runs};
use crate::error::Result;
use crate::grid::trace::{Digests, Trace, are_same, digest};
use crate::storage::spool::{Spool, Workspace};
use crate::storage::work::sections::{SectionReader, SectionWriter};

/// Marks a stored slice as bits.
const BITS: u32 = 1 << 31;

/// Rows of fewer words are stored as bits whatever they hold.
const NOT_NARROW: usize = 5;

/// Slices in the format of a [`SliceStore`], on their way there: a job makes them, so that whoever appends them only copies bytes.
#[derive(Debug, Default)]
pub struct Slices {
    bytes: Vec<u8>,
    starts: Vec<usize>,
    /// Whether any of them has a set cell.
    any: bool,
    runs: Runs,
}

impl Slices {
    /// Adds a slice, in whichever shape is the smaller, if its rows are not narrow.
    pub fn push(&mut self, bits: &Bits) {
        // As runs: 4 bytes a row, 8 a run. Of narrow rows that is about as much, and bits are there at once.
        let (rows, words) = (bits.lit.len(), bits.rows.len());
        let most = words.saturating_sub(rows / 2 + 1);
        if bits.words >= NOT_NARROW && self.runs.replace(bits, most) {
            let runs = std::mem::take(&mut self.runs);
            self.push_runs(&runs);
            self.runs = runs;
        } else {
            self.begin([rows as u32, BITS | bits.words as u32]);
            self.any |= bits.rows.iter().any(|word| *word != 0);
            self.bytes.extend_from_slice(bytemuck::cast_slice(&bits.rows));
        }
    }

    /// Adds a slice of runs.
    pub fn push_runs(&mut self, slice: &Runs) {
        self.begin([slice.row_count(), slice.runs.len() as u32]);
        self.any |= !slice.runs.is_empty();
        self.bytes.extend_from_slice(bytemuck::cast_slice(&slice.starts));
        self.bytes.extend_from_slice(bytemuck::cast_slice(&slice.runs));
    }

    fn begin(&mut self, header: [u32; 2]) {
        self.starts.push(self.bytes.len());
        self.bytes.extend_from_slice(bytemuck::cast_slice(&header));
    }
}

/// Slices kept in temporary storage, written in order, read in any order.
///
/// A stored slice: `u32` rows, `u32` runs, `rows + 1` × `u32` starts, then the runs, 8 bytes each; or, where that is smaller, `u32` rows, `u32`
/// words of a row with the highest bit set, then the words. Native byte order.
#[derive(Debug)]
pub struct SliceStore {
    spool: Spool,
    places: Vec<u64>,
    any: bool,
    /// Which were read, if somebody asks.
    trace: Trace,
}

impl SliceStore {
    /// An empty store that keeps up to `in_memory` bytes in memory.
    pub fn new(workspace: &Workspace, in_memory: u64) -> SliceStore {
        SliceStore { spool: workspace.spool(in_memory), places: Vec::new(), any: false, trace: Trace::default() }
    }

    /// Saves all slices.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(&self, out: &mut SectionWriter<'_>) -> Result<()> {
        out.spool(&self.spool)?;
        out.values(&self.places)?;
        out.values(&[u8::from(self.any)])
    }

    /// Reads what [`SliceStore::save`] saved; up to `in_memory` bytes are kept in memory.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`], [`crate::Error::Io`].
    pub fn load(saved: &mut SectionReader<'_>, workspace: &Workspace, in_memory: u64) -> Result<SliceStore> {
        let mut spool = workspace.spool(in_memory);
        saved.spool(&mut spool)?;
        let places = saved.values()?;
        let any = saved.values::<u8>()? != [0];
        Ok(SliceStore { spool, places, any, trace: Trace::default() })
    }

    /// Appends the next slices.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn extend(&mut self, slices: &Slices) -> Result<()> {
        let at = self.spool.append(&slices.bytes)?;
        self.places.extend(slices.starts.iter().map(|start| at + *start as u64));
        self.any |= slices.any;
        Ok(())
    }

    /// Moves the slices that lie in memory to disk.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn leave_memory(&mut self) -> Result<()> {
        self.spool.leave_memory()
    }

    /// From now on it is told which slices are read.
    pub fn trace(&mut self) {
        self.trace = Trace::of(self.places.len());
    }

    /// What was in those that were read since.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn traced(&self) -> Result<Digests> {
        self.trace.digests(|y| self.digest(y))
    }

    /// Whether these slices are the same.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn are_same(&self, digests: &Digests) -> Result<bool> {
        are_same(digests, self.places.len(), |y| self.digest(y))
    }

    /// The digest of slice `y` as it is stored, which depends on nothing but its cells.
    fn digest(&self, y: u32) -> Result<u64> {
        let (at, [rows, words]) = self.header(y)?;
        let bytes = match words & BITS {
            0 => 4 * (u64::from(rows) + 1) + size_of::<Run>() as u64 * u64::from(words),
            _ => 8 * u64::from(rows) * u64::from(words & !BITS),
        };
        let mut stored = vec![0; bytes as usize];
        self.spool.read_at(at, &mut stored)?;
        Ok(digest(&stored).wrapping_add(u64::from(words)))
    }

    /// Whether no slice has a set cell.
    pub fn is_empty(&self) -> bool {
        !self.any
    }

    /// Number of slices.
    pub fn slice_count(&self) -> u32 {
        self.places.len() as u32
    }

    /// Sets the cells of slice `y` in `bits`, which is cleared first; none where there is no such slice. `runs` is overwritten.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint(&self, y: i64, bits: &mut Bits, runs: &mut Runs) -> Result<()> {
        self.paint_moved(y, 0, bits, runs)
    }

    /// Sets the cells of slice `y`, moved by `by` cells and rows, in `bits`, which is cleared first; none where there is no such slice.
    /// `runs` is overwritten.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint_moved(&self, y: i64, by: u32, bits: &mut Bits, runs: &mut Runs) -> Result<()> {
        if !(0..i64::from(self.slice_count())).contains(&y) {
            bits.clear();
            return Ok(());
        }
        self.trace.read(y as usize);
        let (at, [rows, words]) = self.header(y as u32)?;
        if words & BITS == 0 {
            bits.clear();
            self.read_runs(at, [rows, words], runs)?;
            bits.paint(runs, by, by);
        } else {
            let (rows, words) = (rows as usize, (words & !BITS) as usize);
            self.spool.read_at(at, bytemuck::cast_slice_mut(&mut bits.rows[..rows * words]))?;
            bits.spread(rows, words, by);
        }
        Ok(())
    }

    /// Reads slice `y` into `out`.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory fails.
    pub fn read(&self, y: u32, out: &mut Runs) -> Result<()> {
        self.trace.read(y as usize);
        let (at, [rows, words]) = self.header(y)?;
        if words & BITS == 0 {
            return self.read_runs(at, [rows, words], out);
        }
        let words = (words & !BITS) as usize;
        let mut read = vec![0u64; rows as usize * words];
        self.spool.read_at(at, bytemuck::cast_slice_mut(&mut read))?;
        out.clear();
        read.chunks_exact(words).for_each(|row| out.push_row(row));
        Ok(())
    }

    /// The header of slice `y`, and where what follows it lies.
    fn header(&self, y: u32) -> Result<(u64, [u32; 2])> {
        let (at, mut header) = (self.places[y as usize], [0u32; 2]);
        self.spool.read_at(at, bytemuck::cast_slice_mut(&mut header))?;
        Ok((at + 8, header))
    }

    fn read_runs(&self, at: u64, [rows, runs]: [u32; 2], out: &mut Runs) -> Result<()> {
        let rows = rows as usize;
        out.starts.resize(rows + 1, 0);
        self.spool.read_at(at, bytemuck::cast_slice_mut(&mut out.starts))?;
        out.runs.resize(runs as usize, Run { start: 0, end: 0 });
        self.spool.read_at(at + 4 * (rows as u64 + 1), bytemuck::cast_slice_mut(&mut out.runs))
    }
}
