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
        let [width, slices, rows] = self.cells;
        let (mut below, mut slice, mut runs) = (Bits::new(width, rows), Bits::new(width, rows), Runs::default());
        let mut sum = 0;
        for y in 0..slices {
            self.store.paint(i64::from(y), &mut slice, &mut runs)?;
            for z in 0..rows {
                // Rows are joined with the one before in the slice, and with both in the slice below.
                let (here, under) = (slice.row(z), below.row(z));
                sum += runs_of([here]) - runs_of([here, under]);
                if z > 0 {
                    let (beside, under_beside) = (slice.row(z - 1), below.row(z - 1));
                    sum -= runs_of([here, beside]) - runs_of([here, beside, under, under_beside]);
                }
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
            });
        }
    }
}
