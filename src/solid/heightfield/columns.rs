//! The columns of some slices, as the stages after ask for them.

use std::ops::Range;

use super::{DATA, Ground, LIVE_COLUMN, Up};
use crate::error::Result;

/// The columns of some consecutive slices.
#[derive(Debug)]
pub struct Columns {
    up: Up,
    trimmed: bool,
    cells_up: u32,
    first: i64,
    width: usize,
    heights: Vec<f32>,
    flags: Vec<u8>,
}

impl Ground {
    /// The columns of slices `slices`; those that do not exist have nothing in them.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn columns(&self, slices: Range<i64>) -> Result<Columns> {
        Ok(Columns {
            up: self.up,
            trimmed: self.trimmed,
            cells_up: self.cells_up,
            first: slices.start,
            width: self.heights.width,
            heights: self.heights.read(slices.clone(), f32::NAN)?,
            flags: self.flags.read(slices, 0)?,
        })
    }
}

impl Columns {
    /// Whether faces are left out.
    pub fn trimmed(&self) -> bool {
        self.trimmed
    }

    /// From where they are seen.
    pub fn up(&self) -> Up {
        self.up
    }

    fn place(&self, y: i64, column: i64) -> Option<usize> {
        let inside = column >= 0 && column < self.width as i64 && y >= self.first;
        let at = || (y - self.first) as usize * self.width + column as usize;
        inside.then(at).filter(|at| *at < self.flags.len())
    }

    /// The flags of column `column` of slice `y`; none where there is no such column.
    #[inline]
    pub fn flags(&self, y: i64, column: i64) -> u8 {
        self.place(y, column).map_or(0, |at| self.flags[at])
    }

    /// What both columns of a face have, or its only one.
    #[inline]
    pub fn of_face(&self, cell: [u32; 3], axis: usize) -> u8 {
        let (y, column) = (i64::from(cell[1]), i64::from(cell[self.up.across()]));
        let own = self.flags(y, column);
        match axis {
            1 => own & self.flags(y - 1, column),
            axis if axis == self.up.axis => own,
            _ => own & self.flags(y, column - 1),
        }
    }

    /// Whether a corner on plane `j` between columns `column` − 1 and `column` belongs to a column that is live.
    pub fn is_live(&self, j: i64, column: i64) -> bool {
        let four = [(j - 1, column - 1), (j - 1, column), (j, column - 1), (j, column)];
        four.iter().any(|&(y, column)| self.flags(y, column) & LIVE_COLUMN != 0)
    }

    /// Whether a corner of the surface is made.
    pub fn holds(&self, corner: [u32; 3]) -> bool {
        self.is_live(i64::from(corner[1]), i64::from(corner[self.up.across()])) && !self.at_bottom(corner)
    }

    /// Whether a corner lies on the bottom of the grid.
    pub fn at_bottom(&self, corner: [u32; 3]) -> bool {
        corner[self.up.axis] == if self.up.positive { 0 } else { self.cells_up }
    }

    /// Where along the up axis a corner's vertex lies, in cells, if none of the four columns round it holds points, and it is the corner at their height.
    pub fn bridge(&self, corner: [u32; 3]) -> Option<f64> {
        let (j, column) = (i64::from(corner[1]), i64::from(corner[self.up.across()]));
        let height = |y: i64, column: i64| {
            let at = self.place(y, column)?;
            (self.flags[at] & DATA == 0 && !self.heights[at].is_nan()).then(|| f64::from(self.heights[at]))
        };
        let (a, b) = (height(j - 1, column - 1)?, height(j - 1, column)?);
        let (c, d) = (height(j, column - 1)?, height(j, column)?);
        let mean = ((a + b) + (c + d)) * 0.25;
        let corner = self.up.turn(f64::from(corner[self.up.axis]), self.cells_up);
        (mean.floor() + 1.0 == corner).then(|| self.up.turn(mean, self.cells_up))
    }
}
