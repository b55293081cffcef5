//! The occupied cells of a slice, numbered: row after row, in a row by x.
//!
//! ```text
//!   row 1   . # # .    3 4        a cell's number is a count of bits: those before its word, which are kept, and those
//!   row 0   . # . #    0 1 2      before it in its word; so a stretch of a row's cells is one stretch of numbers
//!
//!   first   0 0 1 1 2             words without a bit are most, and are not kept: of each place of a word, how many are kept before it
//!   words   . w . w               is known, and whether it is one of them shows at the next place
//! ```

use std::ops::Range;

use crate::grid::slice::{Runs, words_for};

/// Occupied cells and their numbers. Memory: 4 bytes for every 64 places of the slice, and 12 for those that hold an occupied cell.
#[derive(Debug)]
pub struct RankBitmap {
    words: usize,
    width: u32,
    rows: u32,
    /// The number of words that are kept before each, one row after the other; then that of all.
    first: Vec<u32>,
    /// Is a cell occupied? Words in which one is, and an empty one at the end.
    occupied: Vec<u64>,
    /// The number of occupied cells before each word that is kept, and before the end.
    before: Vec<u32>,
}

impl RankBitmap {
    /// A slice of `rows` rows of `width` cells, none occupied.
    pub fn new(width: u32, rows: u32) -> RankBitmap {
        let words = Self::words(width);
        RankBitmap { words, width, rows, first: vec![0; words * rows as usize + 1], occupied: vec![0], before: vec![0] }
    }

    /// The most bytes of so many slices with so many occupied cells in all.
    pub fn bytes(slices: u64, cells: u64, width: u32, rows: u32) -> u64 {
        let places = slices * (Self::words(width) as u64 * u64::from(rows) + 1);
        places * size_of::<u32>() as u64 + (cells.min(places) + slices) * (size_of::<u64>() + size_of::<u32>()) as u64
    }

    /// Words of a row: of one cell more than there are, so that its end has a bit, too.
    fn words(width: u32) -> usize {
        words_for(width + 1)
    }

    /// The number of rows.
    pub fn rows(&self) -> u32 {
        self.rows
    }

    /// Empties the slice.
    pub fn clear(&mut self) {
        self.replace(&Runs::default());
    }

    /// Takes the cells of `runs`, in rows that may be fewer, for its own, numbers them and gives their count.
    pub fn replace(&mut self, runs: &Runs) -> u32 {
        let RankBitmap { words, first, occupied, before, .. } = self;
        occupied.clear();
        before.clear();
        let kept = words_of(runs);
        occupied.reserve_exact(kept + 1);
        before.reserve_exact(kept + 1);
        let mut cells = 0;
        // The next place of a word whose `first` is to be known.
        let mut next = 0;
        for z in 0..runs.row_count() {
            for run in runs.row(z) {
                for word in run.start / 64..=(run.end - 1) / 64 {
                    let place = z as usize * *words + word as usize;
                    if place >= next {
                        first[next..=place].fill(occupied.len() as u32);
                        next = place + 1;
                        occupied.push(0);
                        before.push(cells);
                    }
                    let (start, end) = (run.start.max(word * 64), run.end.min((word + 1) * 64));
                    let last = occupied.len() - 1;
                    occupied[last] |= (u64::MAX >> (64 - (end - start))) << (start % 64);
                    cells += end - start;
                }
            }
        }
        first[next..].fill(occupied.len() as u32);
        occupied.push(0);
        before.push(cells);
        cells
    }

    /// The number of occupied cells before bit `bit` of the word at a place, and whether the bit's cell is.
    #[inline]
    fn rank(&self, place: usize, bit: u32) -> (u32, bool) {
        let (kept, next) = (self.first[place] as usize, self.first[place + 1] as usize);
        let word = if next > kept { self.occupied[kept] } else { 0 };
        (self.before[kept] + (word & ((1 << bit) - 1)).count_ones(), word >> bit & 1 == 1)
    }

    /// The number of a cell inside the slice, if it is occupied.
    #[inline]
    pub fn at(&self, x: u32, z: u32) -> Option<usize> {
        let (number, is_occupied) = self.rank(z as usize * self.words + x as usize / 64, x % 64);
        is_occupied.then_some(number as usize)
    }

    /// The numbers of the occupied cells among cells `x` of row `z`; both may reach outside the slice.
    #[inline]
    pub fn cells(&self, z: i64, x: Range<i64>) -> Range<usize> {
        if z < 0 || z >= i64::from(self.rows) {
            return 0..0;
        }
        let row = z as usize * self.words;
        let [start, end] = [x.start, x.end].map(|x| x.clamp(0, i64::from(self.width)) as usize);
        // Most stretches begin and end in one word, and most words are empty.
        let (from, to) = (row + start / 64, row + end / 64);
        if self.first[from] == self.first[to + 1] {
            return 0..0;
        }
        self.rank(from, start as u32 % 64).0 as usize..self.rank(to, end as u32 % 64).0 as usize
    }
}

/// Words that hold a cell of these runs.
fn words_of(runs: &Runs) -> usize {
    let mut count = 0;
    for z in 0..runs.row_count() {
        // The first word that is not counted yet.
        let mut next = 0;
        for run in runs.row(z) {
            let last = (run.end - 1) / 64;
            count += (last + 1).saturating_sub(next.max(run.start / 64));
            next = last + 1;
        }
    }
    count as usize
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::grid::slice::Bits;

    proptest! {
        #[test]
        fn a_cells_number_is_how_many_occupied_ones_come_before_it(
            (width, rows) in (1u32..200, 1u32..6),
            places in proptest::collection::vec((0u32..200, 0u32..6, 1u32..90), 0..40),
            others in proptest::collection::vec((0u32..200, 0u32..6), 0..40),
        ) {
            let mut ranked = RankBitmap::new(width, rows);
            // What was there before must not show.
            let mut bits = Bits::new(width, rows);
            others.iter().filter(|(x, z)| *x < width && *z < rows).for_each(|(x, z)| bits.set(*x, *z));
            ranked.replace(&Runs::from_bits(&bits));
            let mut bits = Bits::new(width, rows);
            for (x, z, length) in places {
                (x..width.min(x + length)).filter(|_| z < rows).for_each(|x| bits.set(x, z));
            }
            let runs = Runs::from_bits(&bits);
            prop_assert_eq!(u64::from(ranked.replace(&runs)), runs.cell_count());
            prop_assert!(ranked.occupied.len() <= runs.cell_count() as usize + 1);
            prop_assert_eq!(ranked.occupied.len(), words_of(&runs) + 1);
            let is_occupied = |x: i64, z: i64| {
                (0..i64::from(width)).contains(&x) && (0..i64::from(rows)).contains(&z) && bits.get(x, z)
            };
            let mut numbers = Vec::new();
            for z in 0..i64::from(rows) {
                for x in 0..i64::from(width) {
                    let number = is_occupied(x, z).then_some(numbers.len());
                    prop_assert_eq!(ranked.at(x as u32, z as u32), number);
                    numbers.extend(number.map(|_| (x, z)));
                }
            }
            for z in -1..=i64::from(rows) {
                for start in -12..i64::from(width) + 3 {
                    for length in [1, 9, 64, 300] {
                        let found: Vec<(i64, i64)> = ranked.cells(z, start..start + length).map(|n| numbers[n]).collect();
                        let expected: Vec<(i64, i64)> =
                            (start..start + length).filter(|x| is_occupied(*x, z)).map(|x| (x, z)).collect();
                        prop_assert_eq!(found, expected);
                    }
                }
            }
        }
    }
}
