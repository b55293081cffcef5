//! One slice of cells, in its two shapes: bits to compute with, runs to keep.
//!
//! ```text
//!   bits  ..####....##..   one u64 for 64 cells of a row, cell x in bit x % 64 of word x / 64
//!   runs    2..6   10..12  half-open ranges of set cells, sorted, never touching each other
//! ```
//!
//! A row of bits ends with at least one bit that is no cell, and is never set: rows lie one behind the other, and what is moved by one
//! bit over all of them at once must not come to lie in the next row.

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::storage::spool::{Spool, Workspace};

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
        // Rows side by side are cleared together.
        let mut z = 0;
        while let Some(first) = self.lit[z..].iter().position(|lit| *lit) {
            let begin = z + first;
            let lit = self.lit[begin..].iter().position(|lit| !lit).map_or(self.lit.len() - begin, |dark| dark);
            z = begin + lit;
            self.rows[begin * self.words..z * self.words].fill(0);
            self.lit[begin..z].fill(false);
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

    /// Whether the cells x - 1, x and x + 1 of row z are set: bits 0 to 2. Cells outside the slice are not; x lies in it.
    #[inline]
    pub fn three(&self, x: i64, z: i64) -> u8 {
        if z < 0 || z >= self.lit.len() as i64 || !self.lit[z as usize] {
            return 0;
        }
        let (row, x) = (self.row(z as u32), x as usize);
        let (word, bit) = (x / 64, x % 64);
        let before = if bit > 0 {
            row[word] >> (bit - 1) & 1
        } else if word > 0 {
            row[word - 1] >> 63
        } else {
            0
        };
        let after = if bit < 63 { row[word] >> (bit + 1) & 1 } else { row.get(word + 1).map_or(0, |next| next & 1) };
        (before | (row[word] >> bit & 1) << 1 | after << 2) as u8
    }

    /// The words of all rows, one row behind the other.
    pub fn words(&self) -> &[u64] {
        &self.rows
    }

    /// The words of all rows, to write to those of rows that hold something, or are said to ([`Bits::light`]).
    pub fn words_mut(&mut self) -> &mut [u64] {
        &mut self.rows
    }

    /// Says of some rows that they may hold something.
    pub fn light(&mut self, rows: std::ops::Range<usize>) {
        self.lit[rows].fill(true);
    }

    /// Number of set cells.
    pub fn cell_count(&self) -> u64 {
        let in_word = |word: u64| {
            if word == u64::MAX {
                64
            } else if word == 0 {
                0
            } else {
                word.count_ones()
            }
        };
        self.rows.iter().map(|word| u64::from(in_word(*word))).sum()
    }

    /// Words of a row.
    pub fn row_words(&self) -> usize {
        self.words
    }

    /// Clears all rows but those given.
    pub fn keep_rows(&mut self, rows: std::ops::Range<u32>) {
        for z in (0..rows.start.min(self.row_count())).chain(rows.end..self.row_count()) {
            if std::mem::take(&mut self.lit[z as usize]) {
                self.rows[z as usize * self.words..][..self.words].fill(0);
            }
        }
    }

    /// Clears every cell that is not set in `other`.
    pub fn and(&mut self, other: &Bits) {
        self.with_lit(other, |row, other| match other {
            Some(other) => row.iter_mut().zip(other).for_each(|(a, b)| *a &= b),
            None => row.fill(0),
        });
    }

    /// Clears every cell that is set in `other`.
    pub fn and_not(&mut self, other: &Bits) {
        self.with_lit(other, |row, other| {
            if let Some(other) = other {
                row.iter_mut().zip(other).for_each(|(a, b)| *a &= !b);
            }
        });
    }

    fn with_lit(&mut self, other: &Bits, change: impl Fn(&mut [u64], Option<&[u64]>)) {
        for z in 0..self.row_count() {
            if self.lit[z as usize] {
                change(&mut self.rows[z as usize * self.words..][..self.words], other.lit_row(z));
            }
        }
    }

    /// Takes the words of rows of `words` words each for its own cells, moved by `by` cells and rows. They lie at the beginning of its own
    /// words, which are else of no meaning.
    fn spread(&mut self, rows: usize, words: usize, by: u32) {
        let (whole, bits) = ((by / 64) as usize, by % 64);
        // From the last to the first: nothing is overwritten before it has been read.
        for z in (0..rows).rev() {
            let (from, to) = (z * words, (z + by as usize) * self.words);
            let mut any = 0;
            if bits == 0 && from == to && words == self.words {
                self.rows[from..from + words].iter().for_each(|word| any |= word);
            } else {
                let word = |rows: &[u64], i: usize| if i < words { rows[from + i] } else { 0 };
                let mut high = if self.words > whole { word(&self.rows, self.words - 1 - whole) } else { 0 };
                for i in (0..self.words).rev() {
                    let low = if i > whole { word(&self.rows, i - whole - 1) } else { 0 };
                    let moved = if i >= whole { high << bits | low >> 1 >> (63 - bits) } else { 0 };
                    (high, any) = (low, any | moved);
                    self.rows[to + i] = moved;
                }
            }
            self.lit[z + by as usize] = any != 0;
        }
        let before = (by as usize).min(self.lit.len());
        self.rows[..before * self.words].fill(0);
        self.lit[..before].fill(false);
        let after = rows + by as usize;
        self.rows[after * self.words..].fill(0);
        self.lit[after..].fill(false);
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

/// Words of a row of `width` cells and the bit behind them.
pub fn words_for(width: u32) -> usize {
    width as usize / 64 + 1
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

/// The words that hold bits `start..end` of a row, each with those of its bits.
#[inline]
pub fn words_of(start: u32, end: u32) -> impl Iterator<Item = (usize, u64)> {
    let words = start as usize / 64..(end as usize).div_ceil(64);
    words.map(move |i| {
        let (from, to) = (start.saturating_sub(i as u32 * 64), end - i as u32 * 64);
        let head = u64::MAX << from.min(63);
        (i, if to < 64 { head & ((1 << to) - 1) } else { head })
    })
}

/// Clears what lies past the end of a row of `width` cells in its last word.
#[inline]
pub fn clip(words: &mut [u64], width: u32) {
    if let Some(last) = words.get_mut(width as usize / 64) {
        *last &= behind(width);
    }
}

/// The cells of the last word of a row of `width` cells.
#[inline]
pub fn behind(width: u32) -> u64 {
    (1 << (width % 64)) - 1
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
        out.replace(bits, usize::MAX);
        out
    }

    /// Takes the runs of all rows of `bits` for its own; if they are more than `most`, only some of them, and says so by `false`.
    fn replace(&mut self, bits: &Bits, most: usize) -> bool {
        self.clear();
        for z in 0..bits.row_count() {
            match bits.lit_row(z) {
                Some(words) => self.push_row(words),
                None => self.end_row(),
            }
            if self.runs.len() > most {
                return false;
            }
        }
        true
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
}

impl SliceStore {
    /// An empty store that keeps up to `in_memory` bytes in memory.
    pub fn new(workspace: &Workspace, in_memory: u64) -> SliceStore {
        SliceStore { spool: workspace.spool(in_memory), places: Vec::new(), any: false }
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
                let mut slices = Slices::default();
                slices.push_runs(&Runs::default());
                slices.push_runs(&runs);
                store.extend(&slices).unwrap();
                let mut slices = Slices::default();
                slices.push(&bits);
                slices.push(&Bits::new(width, 0));
                slices.push(&bits);
                store.extend(&slices).unwrap();
                let mut read = Runs::default();
                for y in [2, 4] {
                    store.read(y, &mut read).unwrap();
                    prop_assert_eq!(&read, &runs);
                    for by in [0, 1, 5, 64, 70] {
                        let mut painted = Bits::new(width + by + 3, rows + by + 2);
                        painted.set(1, 1);
                        store.paint_moved(y.into(), by, &mut painted, &mut read).unwrap();
                        let mut expected = Bits::new(width + by + 3, rows + by + 2);
                        expected.paint(&runs, by, by);
                        prop_assert_eq!(painted.words(), expected.words());
                        prop_assert_eq!(Runs::from_bits(&painted), Runs::from_bits(&expected));
                    }
                }
                store.read(3, &mut read).unwrap();
                prop_assert_eq!(&read, &Runs::default());
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
            let mut masks = vec![0u64; 7];
            words_of(start, start + length).for_each(|(i, mask)| masks[i] |= mask);
            prop_assert_eq!(masks, words);
        }
    }
}
