//! A raster of heights over the plane that is stored where there is something to store: square tiles, sorted by row and column, in temporary storage.
//!
//! Cells are numbered from the origin of the input's coordinates, so a cell is the same square whatever else the input holds.

use bytemuck::cast_slice_mut;

use crate::error::Result;
use crate::storage::spool::{Spool, Workspace};

/// Cells along the side of a tile.
pub const TILE: usize = 128;
/// Bytes of a tile.
pub const TILE_BYTES: u64 = (TILE * TILE * size_of::<f32>()) as u64;

/// The row and the column of a tile; of a cell.
pub type Place = [i64; 2];

/// Where a cell lies: its tile, and its number in that.
pub fn place_of(cell: Place) -> (Place, usize) {
    let side = TILE as i64;
    let [row, column] = cell.map(|at| at.rem_euclid(side) as usize);
    (cell.map(|at| at.div_euclid(side)), row * TILE + column)
}

/// The cell that a point lies in, where cells have sides of `side`.
pub fn cell_of(point: [f64; 3], side: f64) -> Place {
    // Casting saturates: what lies farther than cells can be numbered shares the last one.
    [point[1], point[0]].map(|at| ((at / side).floor() as i64).clamp(-FARTHEST, FARTHEST))
}

/// The farthest cell: sums of a few of these overflow nothing.
const FARTHEST: i64 = 1 << 52;

/// Tiles of heights, NaN where nothing is known.
#[derive(Debug)]
pub struct Tiles {
    places: Vec<Place>,
    heights: Spool,
}

impl Tiles {
    /// None, the first `in_memory` bytes of which are going to stay in memory.
    pub fn new(workspace: &Workspace, in_memory: u64) -> Tiles {
        Tiles { places: Vec::new(), heights: workspace.spool(in_memory) }
    }

    /// The tiles' places, in order.
    pub fn places(&self) -> &[Place] {
        &self.places
    }

    /// Adds a tile, which comes after all that are there.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    ///
    /// # Panics
    /// If it does not, or has not [`TILE`]² heights: a bug of the caller.
    pub fn append(&mut self, place: Place, heights: &[f32]) -> Result<()> {
        assert!(self.places.last().is_none_or(|last| *last < place), "tiles come in order");
        assert_eq!(heights.len(), TILE * TILE);
        self.heights.append(bytemuck::cast_slice(heights))?;
        self.places.push(place);
        Ok(())
    }

    /// The heights of a square of `side` cells from `first` on, row by row; NaN where there is no tile.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn window(&self, first: Place, side: usize) -> Result<Vec<f32>> {
        let mut out = vec![f32::NAN; side * side];
        let mut tile = vec![0f32; TILE * TILE];
        let (low, high) = (place_of(first).0, place_of(first.map(|at| at + side as i64 - 1)).0);
        for row in low[0]..=high[0] {
            for column in low[1]..=high[1] {
                let Ok(number) = self.places.binary_search(&[row, column]) else { continue };
                self.heights.read_at(number as u64 * TILE_BYTES, cast_slice_mut(&mut tile))?;
                // Where the tile begins in the window; before it, perhaps.
                let at = [row * TILE as i64 - first[0], column * TILE as i64 - first[1]];
                let within = |at: i64| {
                    let (from, to) = (at.max(0), (at + TILE as i64).min(side as i64));
                    from as usize..to as usize
                };
                let columns = within(at[1]);
                for y in within(at[0]) {
                    let from = (y as i64 - at[0]) as usize * TILE + (columns.start as i64 - at[1]) as usize;
                    out[y * side + columns.start..y * side + columns.end]
                        .copy_from_slice(&tile[from..from + columns.len()]);
                }
            }
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn windows_hold_what_cells_were_given(
            places in prop::collection::btree_set(prop::array::uniform2(-2i64..3), 0..6),
            first in prop::array::uniform2(-300i64..300),
            side in 1usize..300,
        ) {
            let dir = tempfile::tempdir().unwrap();
            let mut tiles = Tiles::new(&Workspace::new(dir.path()).unwrap(), 100_000);
            let height = |[row, column]: Place| (row * 1000 + column) as f32;
            for place in &places {
                let cells = (0..TILE * TILE).map(|i| [(i / TILE) as i64, (i % TILE) as i64]);
                let heights: Vec<f32> =
                    cells.map(|[y, x]| height([place[0] * TILE as i64 + y, place[1] * TILE as i64 + x])).collect();
                tiles.append(*place, &heights).unwrap();
            }
            let window = tiles.window(first, side).unwrap();
            for (i, found) in window.iter().enumerate() {
                let cell = [first[0] + (i / side) as i64, first[1] + (i % side) as i64];
                if places.contains(&place_of(cell).0) {
                    prop_assert_eq!(*found, height(cell));
                } else {
                    prop_assert!(found.is_nan());
                }
            }
        }

        #[test]
        fn a_cell_lies_in_one_tile(cell in prop::array::uniform2(-1_000_000i64..1_000_000)) {
            let ([row, column], number) = place_of(cell);
            let side = TILE as i64;
            prop_assert_eq!([row * side + number as i64 / side, column * side + number as i64 % side], cell);
        }
    }

    #[test]
    fn far_points_have_a_cell() {
        assert_eq!(cell_of([1.5, -0.5, 0.0], 1.0), [-1, 1]);
        assert_eq!(cell_of([f64::MAX, f64::MIN, 0.0], 1e-3), [-FARTHEST, FARTHEST]);
    }
}
