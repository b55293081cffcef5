//! Outward: on which side of a place the solid ends, from the solid cells round it.
//!
//! ```text
//!   . . . . . .      It is the way down the share of solid cells, weighted by a Gaussian. So it is smooth where noise makes the solid's surface rough, and known on
//!   . . . ^ . .      both sides of it. Where the solid ends on two sides alike (in the middle of a plate, in a wall that stands in a filled slot), and deep in the
//!   # # # O # #      solid, there is none.
//!   # # # # # #
//! ```

use std::sync::LazyLock;

use crate::error::Result;
use crate::grid::slice::{Bits, Runs};
use crate::grid::window::Window;
use crate::points::vector::dot;
use crate::solid::Solid;

/// How far solid cells are looked at, in cells: so many on either side of a cell, or of a corner.
const LOOK: i64 = 5;

/// The Gaussian's standard deviation, in cells.
const SIGMA: f64 = 1.35;

/// A cell where the share falls off by less, for each cell, has no outward direction. In the outermost cells of a flat wall it is 0.28, one cell deeper 0.16, two cells deeper 0.05; in a plate of two
/// cells 0.12.
const LEAST: f64 = 0.065;

/// The same of a corner, which lies on the solid's surface. Where the solid is the same on all sides there may still be none.
const LEAST_OF_CORNER: f64 = 1e-4;

/// What solid cells come to, row by row.
struct Kernel {
    /// By the distance along an axis from the first cell on: the Gaussian, and how much it grows there for each cell.
    weights: Vec<[f32; 2]>,
    /// The sums of both over the solid cells of a row, by which of them are solid.
    of_rows: Vec<[f32; 2]>,
    least: f64,
}

static OF_CELLS: LazyLock<Kernel> = LazyLock::new(|| Kernel::new(2 * LOOK as u32 + 1, LEAST));
static OF_CORNERS: LazyLock<Kernel> = LazyLock::new(|| Kernel::new(2 * LOOK as u32, LEAST_OF_CORNER));

impl Kernel {
    /// The kernel of `width` cells along each axis, seen from the middle.
    fn new(width: u32, least: f64) -> Kernel {
        let off = (0..width).map(|x| f64::from(x) - f64::from(width - 1) / 2.0);
        let weights: Vec<[f64; 2]> = off
            .map(|d| {
                let weight = libm::exp(-d * d / (2.0 * SIGMA * SIGMA));
                [weight, weight * d / (SIGMA * SIGMA)]
            })
            .collect();
        let sum: f64 = weights.iter().map(|[weight, _]| weight).sum();
        let weights: Vec<[f64; 2]> = weights.into_iter().map(|both| both.map(|w| w / sum)).collect();
        let of_row = |cells: u32| {
            let solid = weights.iter().enumerate().filter(|(x, _)| cells >> x & 1 == 1);
            let both = solid.fold([0.0; 2], |sums, (_, weights)| [sums[0] + weights[0], sums[1] + weights[1]]);
            both.map(|sum| sum as f32)
        };
        let of_rows = (0..1 << width).map(of_row).collect();
        Kernel { weights: weights.into_iter().map(|both| both.map(|w| w as f32)).collect(), of_rows, least }
    }
}

/// The solid's slices round a plane of a slab, or round a slice.
pub(crate) struct Outward<'a> {
    solid: &'a Solid,
    window: Window<Bits>,
    runs: Runs,
    kernel: &'static Kernel,
}

/// Bytes of the slices that are looked at.
pub(crate) fn bytes([width, _, rows]: [u32; 3]) -> u64 {
    (2 * LOOK as u64 + 1) * Bits::bytes(width + 2, rows + 2)
}

impl<'a> Outward<'a> {
    /// For cells.
    pub fn of_cells(solid: &'a Solid) -> Outward<'a> {
        Outward::new(solid, &OF_CELLS)
    }

    /// For corners of cells.
    pub fn of_corners(solid: &'a Solid) -> Outward<'a> {
        Outward::new(solid, &OF_CORNERS)
    }

    fn new(solid: &'a Solid, kernel: &'static Kernel) -> Outward<'a> {
        let [width, _, rows] = solid.cells;
        let slot = || Bits::new(width + 2, rows + 2);
        Outward { solid, window: Window::new(kernel.weights.len(), slot), runs: Runs::default(), kernel }
    }

    /// Moves to the slice, or to the plane below it.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn slide_to(&mut self, y: i64) -> Result<()> {
        let Outward { solid, window, runs, .. } = self;
        window.slide_to(y - LOOK, |y, bits| solid.paint(y, bits, runs))
    }

    /// The unit vector outward from cell or corner `x`, `z` of what [`Outward::slide_to`] was called with; zero if there is none.
    pub fn at(&self, x: u32, y: i64, z: u32) -> [f64; 3] {
        let Kernel { weights, of_rows, least } = self.kernel;
        let width = weights.len() as u32;
        let mut rise = [0.0f32; 3];
        for (dy, [weight_y, growth_y]) in (-LOOK..).zip(weights) {
            let slice = self.window.get(y + dy);
            let mut of_slice = [0.0f32; 3];
            for (dz, [weight_z, growth_z]) in (-LOOK..).zip(weights) {
                // A slice is painted one cell and one row in.
                let cells = slice.stretch(i64::from(x) + 1 - LOOK, i64::from(z) + 1 + dz, width);
                if cells != 0 {
                    let [weight, growth] = of_rows[cells as usize];
                    of_slice[0] += weight_z * growth;
                    of_slice[1] += weight_z * weight;
                    of_slice[2] += growth_z * weight;
                }
            }
            rise[0] += weight_y * of_slice[0];
            rise[1] += growth_y * of_slice[1];
            rise[2] += weight_y * of_slice[2];
        }
        let rise = rise.map(f64::from);
        let steepness = dot(rise, rise).sqrt();
        if steepness < *least { [0.0; 3] } else { rise.map(|c| -c / steepness) }
    }
}

/// Whether there is no outward direction.
#[inline]
pub(crate) fn is_none([x, y, z]: [f64; 3]) -> bool {
    x == 0.0 && y == 0.0 && z == 0.0
}

/// How far two places are on the same side, by their outward directions: 0 from a right angle between the two on, 1 up to a cosine of 2/3; 1 if one of them has none.
#[inline]
pub(crate) fn agreement(one: [f64; 3], other: [f64; 3]) -> f64 {
    if is_none(one) || is_none(other) { 1.0 } else { (1.5 * dot(one, other)).clamp(0.0, 1.0) }
}
