//! A slice as bits, and as runs.

use bytemuck::{Pod, Zeroable};

/// A slice as bits: `rows` rows of `width` cells.
#[derive(Debug, Clone)]
pub struct Bits {
    width: u32,
    /// Words of a row.
    pub(super) words: usize,
    pub(super) rows: Vec<u64>,
    pub(super) lit: Vec<bool>,
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

    /// Whether the `count` cells of row z from x on are set: bit 0 and those above it. Cells outside the slice are not; of x and `count`, fewer than 64 lie before it.
    #[inline]
    pub fn stretch(&self, x: i64, z: i64, count: u32) -> u32 {
        if z < 0 || z >= self.lit.len() as i64 || !self.lit[z as usize] {
            return 0;
        }
        let row = self.row(z as u32);
        let (word, bit) = (x.div_euclid(64), x.rem_euclid(64) as u32);
        let at = |word: i64| usize::try_from(word).ok().and_then(|word| row.get(word)).copied().unwrap_or(0);
        let low = at(word) >> bit;
        let both = if bit + count > 64 { low | at(word + 1) << (64 - bit) } else { low };
        both as u32 & ((1 << count) - 1)
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

    /// Sets the cells that are not set, and clears those that are.
    pub fn complement(&mut self) {
        self.lit.fill(true);
        self.rows.iter_mut().for_each(|word| *word = !*word);
        self.clip_rows();
    }

    /// Clears what lies behind the rows' last cells.
    pub fn clip_rows(&mut self) {
        self.rows.chunks_exact_mut(self.words).for_each(|row| clip(row, self.width));
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
    pub(super) fn spread(&mut self, rows: usize, words: usize, by: u32) {
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
    pub(super) starts: Vec<u32>,
    pub(super) runs: Vec<Run>,
}

impl Default for Runs {
    fn default() -> Self {
        Runs { starts: vec![0], runs: Vec::new() }
    }
}

impl Runs {
    /// A slice of runs that do not overlap, row by row, in any order.
    pub fn joined(rows: Vec<Vec<Run>>) -> Runs {
        let mut out = Runs::default();
        for mut row in rows {
            row.sort_unstable_by_key(|run| run.start);
            row.iter().for_each(|run| out.push_run(run.start, run.end));
            out.end_row();
        }
        out
    }

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
    pub(super) fn replace(&mut self, bits: &Bits, most: usize) -> bool {
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
