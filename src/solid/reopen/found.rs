//! What the tiles of a job find: cells with values, put in order row by row of tiles.

use std::ops::Range;

use super::tile::TILE;
use crate::grid::Cell;
use crate::grid::slice::Runs;

/// Some cells, slice by slice, each with a value: what the tiles of a job give, one after the other, by row and x.
///
/// Only those of one row of tiles lie there as they came; those of the rows before are runs and values.
#[derive(Debug)]
pub struct Found<T> {
    first: u32,
    /// The first cell row of the tiles at hand.
    row: u32,
    /// Of each slice, the cells of the tiles at hand: row, x and value.
    at_hand: Vec<Vec<(u32, u32, T)>>,
    runs: Vec<Runs>,
    values: Vec<Vec<T>>,
}

impl<T: Copy> Found<T> {
    /// None yet, in some slices.
    pub fn new(slices: Range<u32>) -> Found<T> {
        let none = |_| Vec::new();
        let runs = slices.clone().map(|_| Runs::default()).collect();
        Found {
            first: slices.start,
            row: 0,
            at_hand: slices.clone().map(none).collect(),
            runs,
            values: slices.map(|_| Vec::new()).collect(),
        }
    }

    /// Adds a cell of a tile that is in no earlier row of tiles than those before.
    pub fn push(&mut self, [x, y, z]: [i64; 3], value: T) {
        let (x, z) = (x as u32, z as u32);
        debug_assert!(z >= self.row, "tiles come row by row");
        if z >= self.row + TILE {
            self.end_rows(z / TILE * TILE);
        }
        self.at_hand[(y - i64::from(self.first)) as usize].push((z, x, value));
    }

    /// Slice by slice, the runs and the values of the cells, in the cells' order.
    pub fn sorted(mut self, cells: Cell) -> (Vec<Runs>, Vec<Vec<T>>) {
        self.end_rows(cells[2]);
        (self.runs, self.values)
    }

    /// Puts the cells at hand in order; those that follow lie in cell row `next` or after it.
    fn end_rows(&mut self, next: u32) {
        for ((found, runs), values) in self.at_hand.iter_mut().zip(&mut self.runs).zip(&mut self.values) {
            found.sort_unstable_by_key(|(z, x, _)| (*z, *x));
            let mut left = found.iter().peekable();
            for row in self.row..next {
                while let Some((_, x, value)) = left.next_if(|(z, ..)| *z == row) {
                    runs.push_run(*x, *x + 1);
                    values.push(*value);
                }
                runs.end_row();
            }
            found.clear();
        }
        self.row = next;
    }
}
