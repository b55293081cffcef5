//! One slice of cells, in its two shapes: bits to compute with, runs to keep.
//!
//! ```text
//!   bits  ..####....##..   one u64 for 64 cells of a row, cell x in bit x % 64 of word x / 64
//!   runs    2..6   10..12  half-open ranges of set cells, sorted, never touching each other
//! ```
//!
//! A row of bits ends with at least one bit that is no cell, and is never set: rows lie one behind the other, and what is moved by one
//! bit over all of them at once must not come to lie in the next row.

mod cells;
mod store;

pub use self::cells::{Bits, Run, Runs, behind, clip, set_range, words_for, words_of};
pub use self::store::{SliceStore, Slices};

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    use crate::storage::spool::Workspace;

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
