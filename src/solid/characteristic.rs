//! The Euler number of the solid, which its pieces, handles and voids come to.

use super::Solid;
use crate::error::Result;
use crate::grid::slice::{Bits, Runs};

impl Solid {
    /// The Euler number of the cells as faces join them: cells − pairs + squares − cubes, which is pieces − handles + voids. Memory: two slices of bits.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn characteristic(&self) -> Result<i64> {
        // Rows are joined with the one before in the slice, and with both in the slice below.
        self.sum_of_rows(|[[under_beside, under], [beside, here]]| {
            runs_of([here]) - runs_of([here, under]) - runs_of([here, beside])
                + runs_of([here, beside, under, under_beside])
        })
    }

    /// That of the surface, which keeps two cells apart that are not solid and share nothing but a corner: pieces of the surface, less its handles. Memory: two slices of bits.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn characteristic_of_surface(&self) -> Result<i64> {
        Ok(self.characteristic()? + self.sum_of_rows(kept_apart)?)
    }

    /// The sum of what `of` says of every row, which is given the row before and the row itself, of the slice below and of its own. What lies before the grid is empty.
    fn sum_of_rows(&self, of: impl Fn([[&[u64]; 2]; 2]) -> i64) -> Result<i64> {
        let [width, slices, rows] = self.cells;
        let (mut below, mut slice, mut runs) = (Bits::new(width, rows), Bits::new(width, rows), Runs::default());
        let nothing = vec![0; slice.row_words()];
        let mut sum = 0;
        for y in 0..slices {
            self.store.paint(i64::from(y), &mut slice, &mut runs)?;
            for z in 0..rows {
                sum +=
                    of([&below, &slice].map(|slice| [if z > 0 { slice.row(z - 1) } else { &nothing }, slice.row(z)]));
            }
            std::mem::swap(&mut below, &mut slice);
        }
        Ok(sum)
    }
}

/// The runs of what is set in all of some rows: its cells, less the pairs of them side by side.
fn runs_of<const ROWS: usize>(rows: [&[u64]; ROWS]) -> i64 {
    let (mut before, mut runs) = (0, 0);
    for word in 0..rows[0].len() {
        let all = rows.iter().fold(u64::MAX, |all, row| all & row[word]);
        runs += i64::from((all & !(all << 1 | before)).count_ones());
        before = all >> 63;
    }
    runs
}

/// How many blocks of 2 x 2 x 2 cells of four rows, two of either slice, lack nothing but two opposite cells.
fn kept_apart(rows: [[&[u64]; 2]; 2]) -> i64 {
    let mut count = 0;
    for word in 0..rows[0][0].len() {
        // Bit x is the cell at x of a row, or the one after it.
        let after = |row: &[u64]| row[word] >> 1 | row.get(word + 1).map_or(0, |next| next << 63);
        let cells = rows.map(|slice| slice.map(|row| [row[word], after(row)])).concat().concat();
        for first in 0..4 {
            let all =
                (0..8).fold(u64::MAX, |all, i| all & if i == first || i == 7 - first { !cells[i] } else { cells[i] });
            count += i64::from(all.count_ones());
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use crate::grid::dilate::Ball;
    use crate::grid::occupancy::Occupancy;
    use crate::run::testing::with_context;
    use crate::solid::Solid;

    proptest! {
        #[test]
        fn it_is_what_cells_pairs_squares_and_cubes_come_to(
            cells in prop::collection::btree_set([0u32..70, 0u32..7, 0u32..6], 1..400),
        ) {
            let size = [70, 7, 6];
            with_context(size, |context| {
                let occupancy = Occupancy::of_cells(cells.iter().copied(), size, context).unwrap();
                let solid = Solid::close(&occupancy, &Ball::new(1), context).unwrap();
                let mut set = BTreeSet::new();
                let (mut bits, mut runs) = (crate::grid::slice::Bits::new(70, 6), crate::grid::slice::Runs::default());
                for y in 0..7u32 {
                    solid.store.paint(y.into(), &mut bits, &mut runs).unwrap();
                    set.extend((0..70).flat_map(|x| (0..6).map(move |z| [x, y, z])).filter(|c| bits.get(c[0].into(), c[2].into())));
                }
                let mut expected = 0i64;
                for cell in &set {
                    for sides in 0..8u32 {
                        let whole = (0..8u32).filter(|i| i & !sides == 0).all(|i| {
                            set.contains(&std::array::from_fn(|a| cell[a] + (i >> a & 1)))
                        });
                        expected += if whole { 1 - 2 * i64::from(sides.count_ones() % 2) } else { 0 };
                    }
                }
                assert_eq!(solid.characteristic().unwrap(), expected);
                let block = |at: [u32; 3]| (0..8u32).map(move |i| [0, 1, 2].map(|a| at[a] + (i >> a & 1)));
                for x in 0..69 {
                    for (y, z) in (0..6).flat_map(|y| (0..5).map(move |z| (y, z))) {
                        let empty: Vec<[u32; 3]> = block([x, y, z]).filter(|cell| !set.contains(cell)).collect();
                        expected += i64::from(empty.len() == 2 && (0..3).all(|a| empty[0][a] != empty[1][a]));
                    }
                }
                assert_eq!(solid.characteristic_of_surface().unwrap(), expected);
            });
        }
    }
}
