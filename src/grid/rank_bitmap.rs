//! The occupied cells of a slice, numbered: row after row, in a row by x.
//!
//! ```text
//!   row 1   . # # .    3 4        a cell's number is a count of bits: those before its word, which are kept, and those
//!   row 0   # . # #    0 1 2      before it in its word; so a stretch of a row's cells is one stretch of numbers
//! ```

use std::ops::Range;

use crate::grid::slice::{Runs, set_range, words_for};

/// Occupied cells and their numbers. Memory: 12 bytes for every 64 places of the slice.
#[derive(Debug)]
pub struct RankBitmap {
    words: usize,
    width: u32,
    rows: u32,
    /// Is a cell occupied? One row after the other.
    occupied: Vec<u64>,
    /// The number of occupied cells before each word.
    before: Vec<u32>,
}

impl RankBitmap {
    /// A slice of `rows` rows of `width` cells, none occupied.
    pub fn new(width: u32, rows: u32) -> RankBitmap {
        // One cell more than there are, so that the end of a row has a bit, too.
        let words = words_for(width + 1);
        let places = words * rows as usize;
        RankBitmap { words, width, rows, occupied: vec![0; places], before: vec![0; places] }
    }

    /// Empties the slice.
    pub fn clear(&mut self) {
        self.occupied.fill(0);
    }

    /// Makes a cell occupied. Numbers hold once [`RankBitmap::number`] was called after the last.
    #[inline]
    pub fn set(&mut self, x: u32, z: u32) {
        self.occupied[z as usize * self.words + x as usize / 64] |= 1 << (x % 64);
    }

    /// Takes the cells of `runs` for its own, numbers them and gives their count.
    pub fn replace(&mut self, runs: &Runs) -> u32 {
        self.clear();
        for (z, words) in (0..runs.row_count()).zip(self.occupied.chunks_exact_mut(self.words)) {
            runs.row(z).iter().for_each(|run| set_range(words, run.start, run.end));
        }
        self.number()
    }

    /// Numbers the occupied cells and gives their count.
    pub fn number(&mut self) -> u32 {
        let mut cells = 0;
        for (before, word) in self.before.iter_mut().zip(&self.occupied) {
            *before = cells;
            cells += word.count_ones();
        }
        cells
    }

    /// The number of a cell inside the slice, if it is occupied.
    #[inline]
    pub fn at(&self, x: u32, z: u32) -> Option<usize> {
        let (word, bit) = (z as usize * self.words + x as usize / 64, x % 64);
        let occupied = self.occupied[word];
        let before = || self.before[word] + (occupied & ((1 << bit) - 1)).count_ones();
        (occupied >> bit & 1 == 1).then(|| before() as usize)
    }

    /// The numbers of the occupied cells among cells `x` of row `z`; both may reach outside the slice.
    #[inline]
    pub fn cells(&self, z: i64, x: Range<i64>) -> Range<usize> {
        if z < 0 || z >= i64::from(self.rows) {
            return 0..0;
        }
        let rank = |x: i64| {
            let x = x.clamp(0, i64::from(self.width)) as usize;
            let word = z as usize * self.words + x / 64;
            let within = self.occupied[word] & ((1 << (x % 64)) - 1);
            (self.before[word] + within.count_ones()) as usize
        };
        rank(x.start)..rank(x.end)
    }
}
