//! Outward: on which side of a place the solid ends, from the solid cells round it.
//!
//! ```text
//!   . . . . .      Each solid cell round the place pushes away from itself, with 1 / its distance. On a flat wall that comes to the wall's
//!   . . ^ . .      normal; where the solid is on both sides (a plate of one cell, a wall that stands in a filled slot), to nothing:
//!   # # O # #      then there is no outward, and the points there may belong to either side.
//!   # # # # #
//! ```

use crate::error::Result;
use crate::grid::slice::{Bits, Runs};
use crate::grid::window::Window;
use crate::solid::Solid;

/// How far solid cells are looked at, in cells: two on either side of a cell, or of a corner.
const LOOK: i64 = 2;

/// Less push than this is none: on a flat wall it comes to 13.8, on a plate of two cells to 6.9.
const LEAST: f64 = 2.5;

/// What the solid cells of a row push, by which of them are solid; for the rows round a cell, or a corner, one slice behind the other.
type Pushes<const ROWS: usize, const PATTERNS: usize> = [[[f64; 3]; PATTERNS]; ROWS];

static OF_CELLS: Pushes<25, 32> = pushes(5, 0.0);
static OF_CORNERS: Pushes<16, 32> = pushes(4, 0.5);

/// The pushes of `width` cells along each axis from two before on, seen from `centre` behind a cell's number.
const fn pushes<const ROWS: usize, const PATTERNS: usize>(width: usize, centre: f64) -> Pushes<ROWS, PATTERNS> {
    let mut out = [[[0.0; 3]; PATTERNS]; ROWS];
    let mut at = 0;
    while at < ROWS * PATTERNS {
        let (row, pattern) = (at / PATTERNS, at % PATTERNS);
        let mut x = 0;
        while x < width {
            let of = [x, row / width, row % width];
            let d = [of[0] as f64 - 2.0 + centre, of[1] as f64 - 2.0 + centre, of[2] as f64 - 2.0 + centre];
            let square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            if pattern >> x & 1 == 1 && square > 0.0 {
                out[row][pattern][0] -= d[0] / square;
                out[row][pattern][1] -= d[1] / square;
                out[row][pattern][2] -= d[2] / square;
            }
            x += 1;
        }
        at += 1;
    }
    out
}

/// The solid's slices round a plane of a slab, or round a slice.
pub(crate) struct Outward<'a> {
    solid: &'a Solid,
    window: Window<Bits>,
    runs: Runs,
    /// Slices that are looked at from one before: of a plane's corners those below and above, of a cell one more.
    reach: (i64, i64),
}

/// Bytes of the slices that are looked at.
pub(crate) fn bytes([width, _, rows]: [u32; 3]) -> u64 {
    (2 * LOOK as u64 + 1) * Bits::bytes(width + 2, rows + 2)
}

impl<'a> Outward<'a> {
    /// For cells.
    pub fn of_cells(solid: &'a Solid) -> Outward<'a> {
        Outward::new(solid, (-LOOK, LOOK))
    }

    /// For corners of cells.
    pub fn of_corners(solid: &'a Solid) -> Outward<'a> {
        Outward::new(solid, (-LOOK, LOOK - 1))
    }

    fn new(solid: &'a Solid, reach: (i64, i64)) -> Outward<'a> {
        let [width, _, rows] = solid.cells;
        let slot = || Bits::new(width + 2, rows + 2);
        Outward { solid, window: Window::new((reach.1 - reach.0 + 1) as usize, slot), runs: Runs::default(), reach }
    }

    /// Moves to the slice, or to the plane below it.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn slide_to(&mut self, y: i64) -> Result<()> {
        let Outward { solid, window, runs, reach } = self;
        window.slide_to(y + reach.0, |y, bits| solid.paint(y, bits, runs))
    }

    /// The unit vector outward from cell or corner `x`, `z` of what [`Outward::slide_to`] was called with; zero if there is none.
    pub fn at(&self, x: u32, y: i64, z: u32) -> [f64; 3] {
        let (width, pushes) = if self.reach.1 == LOOK { (5, &OF_CELLS[..]) } else { (4, &OF_CORNERS[..]) };
        let mut push = [0.0f64; 3];
        let mut pushes = pushes.iter();
        for dy in self.reach.0..=self.reach.1 {
            let slice = self.window.get(y + dy);
            for (dz, of_row) in (self.reach.0..=self.reach.1).zip(&mut pushes) {
                // A slice is painted one cell and one row in.
                let cells = slice.stretch(i64::from(x) + 1 + self.reach.0, i64::from(z) + 1 + dz, width);
                let of_row = of_row[cells as usize];
                (0..3).for_each(|a| push[a] += of_row[a]);
            }
        }
        let length = (push[0] * push[0] + push[1] * push[1] + push[2] * push[2]).sqrt();
        if length < LEAST { [0.0; 3] } else { push.map(|c| c / length) }
    }
}
