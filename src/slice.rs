//! One slice of cells, in its two shapes: bits to compute with, runs to keep.
//!
//! ```text
//!   bits  ..####....##..   one u64 for 64 cells of a row, cell x in bit x % 64 of word x / 64
//!   runs    2..6   10..12  half-open ranges of set cells, sorted, never touching each other
//! ```

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::spool::{Spool, Workspace};

/// A slice as bits: `rows` rows of `width` cells.
#[derive(Debug, Clone)]
pub struct Bits {
    width: u32,
    words: usize,
    rows: Vec<u64>,
    lit: Vec<bool>,
}

impl Bits {
    /// An empty slice.
    pub fn new(width: u32, rows: u32) -> Bits {
        let words = words_for(width);
        Bits { width, words, rows: vec![0; words * rows as usize], lit: vec![false; rows as usize] }
    }

    /// Memory of a slice of this size, in bytes.
    pub fn bytes(width: u32, rows: u32) -> u64 {
        (8 * words_for(width) as u64 + 1) * u64::from(rows)
    }

    /// Clears all cells.
    pub fn clear(&mut self) {
        for (row, lit) in self.rows.chunks_exact_mut(self.words).zip(&mut self.lit) {
            if std::mem::take(lit) {
                row.fill(0);
            }
        }
    }

    /// Number of rows.
    pub fn row_count(&self) -> u32 {
        self.lit.len() as u32
    }

    /// Cells of a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// A row's words.
    #[inline]
    pub fn row(&self, z: u32) -> &[u64] {
        &self.rows[z as usize * self.words..][..self.words]
    }

    /// A row's words if the row holds anything (a row that was written to counts as holding something).
    #[inline]
    pub fn lit_row(&self, z: u32) -> Option<&[u64]> {
        self.lit[z as usize].then(|| self.row(z))
    }

    /// A row's words, to write to.
    #[inline]
    pub fn row_mut(&mut self, z: u32) -> &mut [u64] {
        self.lit[z as usize] = true;
        &mut self.rows[z as usize * self.words..][..self.words]
    }

    /// Sets one cell.
    #[inline]
    pub fn set(&mut self, x: u32, z: u32) {
        self.lit[z as usize] = true;
        self.rows[z as usize * self.words + x as usize / 64] |= 1 << (x % 64);
    }

    /// Whether a cell is set; cells outside the slice are not.
    #[inline]
    pub fn get(&self, x: i64, z: i64) -> bool {
        x >= 0
            && z >= 0
            && x < i64::from(self.width)
            && z < self.lit.len() as i64
            && self.rows[z as usize * self.words + x as usize / 64] >> (x % 64) & 1 == 1
    }

    /// Sets the cells of `runs`, moved by `dx` cells and `dz` rows; all must fall inside.
    pub fn paint(&mut self, runs: &Runs, dx: u32, dz: u32) {
        for z in 0..runs.row_count() {
            let row = runs.row(z);
            if !row.is_empty() {
                let words = self.row_mut(z + dz);
                for run in row {
                    set_range(words, run.start + dx, run.end + dx);
                }
            }
        }
    }
}

/// Words of a row of `width` cells.
pub fn words_for(width: u32) -> usize {
    width.div_ceil(64) as usize
}

/// Sets bits `start..end` of a row.
#[inline]
pub fn set_range(words: &mut [u64], start: u32, end: u32) {
    if start >= end {
        return;
    }
    let (first, last) = (start as usize / 64, (end - 1) as usize / 64);
    let head = u64::MAX << (start % 64);
    let tail = u64::MAX >> (63 - (end - 1) % 64);
    if first == last {
        words[first] |= head & tail;
    } else {
        words[first] |= head;
        words[first + 1..last].fill(u64::MAX);
        words[last] |= tail;
    }
}

/// Clears what lies past the end of a row of `width` cells in its last word.
#[inline]
pub fn clip(words: &mut [u64], width: u32) {
    if !width.is_multiple_of(64)
        && let Some(last) = words.last_mut()
    {
        *last &= u64::MAX >> (64 - width % 64);
    }
}

/// A range of set cells in a row: `start..end`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Zeroable, Pod)]
#[repr(C)]
pub struct Run {
    /// The first set cell.
    pub start: u32,
    /// The first cell after it that is not set.
    pub end: u32,
}

/// A slice as runs, row after row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Runs {
    /// Row z's runs are `runs[starts[z]..starts[z + 1]]`; always one longer than the number of rows.
    starts: Vec<u32>,
    runs: Vec<Run>,
}

impl Default for Runs {
    fn default() -> Self {
        Runs { starts: vec![0], runs: Vec::new() }
    }
}

impl Runs {
    /// Empties the slice, to be filled row by row.
    pub fn clear(&mut self) {
        self.starts.truncate(1);
        self.runs.clear();
    }

    /// Appends the runs of set bits of a row.
    pub fn push_row(&mut self, words: &[u64]) {
        for (i, &word) in words.iter().enumerate() {
            let (mut word, base) = (word, i as u32 * 64);
            while word != 0 {
                let start = word.trailing_zeros();
                let length = (!(word >> start)).trailing_zeros();
                self.push_run(base + start, base + start + length);
                // A shift by 64 clears all: nothing is left of a word whose run reached its end.
                word &= u64::MAX.checked_shl(start + length).unwrap_or(0);
            }
        }
        self.end_row();
    }

    /// Appends a run to the row under way, joining it to the run it touches.
    #[inline]
    pub fn push_run(&mut self, start: u32, end: u32) {
        let row_start = self.starts[self.starts.len() - 1] as usize;
        if self.runs.len() > row_start {
            let last = self.runs.len() - 1;
            if self.runs[last].end == start {
                self.runs[last].end = end;
                return;
            }
        }
        self.runs.push(Run { start, end });
    }

    /// Ends the row under way.
    pub fn end_row(&mut self) {
        self.starts.push(self.runs.len() as u32);
    }

    /// The runs of all rows of `bits`.
    pub fn from_bits(bits: &Bits) -> Runs {
        let mut out = Runs::default();
        for z in 0..bits.row_count() {
            match bits.lit_row(z) {
                Some(words) => out.push_row(words),
                None => out.end_row(),
            }
        }
        out
    }

    /// Number of rows.
    pub fn row_count(&self) -> u32 {
        self.starts.len() as u32 - 1
    }

    /// Row z's runs, in order.
    #[inline]
    pub fn row(&self, z: u32) -> &[Run] {
        &self.runs[self.row_range(z)]
    }

    /// The positions of row z's runs among all runs.
    #[inline]
    pub fn row_range(&self, z: u32) -> std::ops::Range<usize> {
        self.starts[z as usize] as usize..self.starts[z as usize + 1] as usize
    }

    /// All runs, row after row.
    pub fn all(&self) -> &[Run] {
        &self.runs
    }

    /// Number of set cells.
    pub fn cell_count(&self) -> u64 {
        self.runs.iter().map(|r| u64::from(r.end - r.start)).sum()
    }
}

/// Slices kept as runs in temporary storage, written in order, read in any order.
///
/// A stored slice: `u32` rows, `u32` runs, `rows + 1` × `u32` starts, then the runs, 8 bytes each; native byte order.
#[derive(Debug)]
pub struct SliceStore {
    spool: Spool,
    places: Vec<u64>,
    scratch: Vec<u8>,
}

impl SliceStore {
    /// An empty store that keeps up to `in_memory` bytes in memory.
    pub fn new(workspace: &Workspace, in_memory: u64) -> SliceStore {
        SliceStore { spool: workspace.spool(in_memory), places: Vec::new(), scratch: Vec::new() }
    }

    /// Appends the next slice.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn append(&mut self, slice: &Runs) -> Result<()> {
        self.scratch.clear();
        self.scratch.extend_from_slice(&slice.row_count().to_ne_bytes());
        self.scratch.extend_from_slice(&(slice.runs.len() as u32).to_ne_bytes());
        self.scratch.extend_from_slice(bytemuck::cast_slice(&slice.starts));
        self.scratch.extend_from_slice(bytemuck::cast_slice(&slice.runs));
        let at = self.spool.append(&self.scratch)?;
        self.places.push(at);
        Ok(())
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
        bits.clear();
        if (0..i64::from(self.slice_count())).contains(&y) {
            self.read(y as u32, runs)?;
            bits.paint(runs, 0, 0);
        }
        Ok(())
    }

    /// Reads slice `y` into `out`.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory fails.
    pub fn read(&self, y: u32, out: &mut Runs) -> Result<()> {
        let at = self.places[y as usize];
        let mut header = [0u32; 2];
        self.spool.read_at(at, bytemuck::cast_slice_mut(&mut header))?;
        let (rows, runs) = (header[0] as usize, header[1] as usize);
        out.starts.resize(rows + 1, 0);
        self.spool.read_at(at + 8, bytemuck::cast_slice_mut(&mut out.starts))?;
        out.runs.resize(runs, Run { start: 0, end: 0 });
        self.spool.read_at(at + 8 + 4 * (rows as u64 + 1), bytemuck::cast_slice_mut(&mut out.runs))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn runs_and_bits_are_the_same_slice(cells in prop::collection::vec(any::<bool>(), 1..700), width in 1u32..200) {
            let rows = (cells.len() as u32).div_ceil(width);
            let mut bits = Bits::new(width, rows);
            for (i, _) in cells.iter().enumerate().filter(|(_, set)| **set) {
                bits.set(i as u32 % width, i as u32 / width);
            }
            let runs = Runs::from_bits(&bits);
            prop_assert_eq!(runs.cell_count(), cells.iter().filter(|c| **c).count() as u64);
            let mut back = Bits::new(width + 5, rows + 2);
            back.paint(&runs, 5, 2);
            for z in 0..i64::from(rows) {
                for x in 0..i64::from(width) {
                    prop_assert_eq!(bits.get(x, z), back.get(x + 5, z + 2));
                }
            }
            for z in 0..rows {
                prop_assert!(runs.row(z).windows(2).all(|p| p[0].end < p[1].start));
            }

            let dir = tempfile::tempdir().unwrap();
            let workspace = Workspace::new(dir.path()).unwrap();
            for quota in [0, 1 << 20] {
                let mut store = SliceStore::new(&workspace, quota);
                store.append(&Runs::default()).unwrap();
                store.append(&runs).unwrap();
                let mut read = Runs::default();
                store.read(1, &mut read).unwrap();
                prop_assert_eq!(&read, &runs);
                store.read(0, &mut read).unwrap();
                prop_assert_eq!(&read, &Runs::default());
            }
        }

        #[test]
        fn a_range_is_set_exactly(start in 0u32..200, length in 0u32..200) {
            let mut words = vec![0u64; 7];
            set_range(&mut words, start, start + length);
            for x in 0..448 {
                prop_assert_eq!(words[x / 64] >> (x % 64) & 1 == 1, (start..start + length).contains(&(x as u32)));
            }
        }
    }
}
