//! How far points lie from the surface that they are samples of: their noise, or how badly their scans fit each other.
//!
//! ```text
//!    . .   .  .       noise: cells, and those twice as wide,       clean, but bent: points are 4 times       . ' - ' .
//!   .  .  . .  .      are as thick                                 as thick in cells twice as wide
//! ```

use super::levels::{Levels, Places};

/// Cells are wider than so many sampling distances, and no more than twice that: 19 to 77 points on average.
pub(super) const WIDE: f64 = 4.0;
/// A cell with fewer points says nothing; nor does one with fewer than this part of a side's square in sampling distances: it has a corner or the rim of the surface.
const LEAST: usize = 6;
const PART: f64 = 0.25;
/// Fewer cells say nothing.
const CELLS: usize = 32;
/// In cells twice as wide, the variance across a bent surface is so many times as large.
const BENT: f64 = 16.0;

/// The standard deviation of points from their surface, which they are samples of `distance` apart, in the input's units; none if too few cells tell.
///
/// Of cells 4 to 8 sampling distances wide and of those twice as wide, the lower quartile of the variance across their points' plane is found. It is that of the flattest parts: neither
/// edges nor folds. It is the noise's and that of what is bent, which is 16 times as much in the wider cells.
///
/// In parts of the side by k = 4: samples and own vertices of horse, rocker arm, dragon and bunny, plates and blocks have 0 to .015; noise of .025 % of the diagonal .064, raw scans .11.
pub(super) fn noise(levels: &Levels, distance: f64) -> Option<f64> {
    let mut variances = levels.iter().take_while(|(side, _)| *side > WIDE * distance).map(|(side, level)| {
        let least = PART * (side / distance) * (side / distance);
        let tells = |points: u64, places: &Places| points as f64 >= least && places.points().len() >= LEAST;
        let telling = level.telling().filter(|(points, places)| tells(*points, places));
        let mut found: Vec<f64> = telling.map(|(_, places)| variance(places)).collect();
        found.sort_unstable_by(f64::total_cmp);
        (found.len() >= CELLS).then(|| found[found.len() / 4])
    });
    let mut last = [None; 2];
    variances.by_ref().for_each(|variance| last = [last[1], variance]);
    let [wide, narrow] = last;
    Some((BENT * narrow? - wide?).max(0.0).sqrt() / (BENT - 1.0).sqrt())
}

/// The variance of points across their flattest direction, as of a sample: three of them have none.
fn variance(places: &Places) -> f64 {
    let n = places.points().len() as f64;
    let mut mean = [0.0; 3];
    places.points().for_each(|p| (0..3).for_each(|a| mean[a] += p[a] / n));
    let mut squares = [0.0; 6];
    for p in places.points() {
        let [x, y, z]: [f64; 3] = std::array::from_fn(|a| p[a] - mean[a]);
        let products = [x * x, y * y, z * z, y * z, x * z, x * y];
        squares.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
    }
    least_eigenvalue(squares).max(0.0) / (n - 3.0)
}

/// The least eigenvalue of a symmetric matrix, its diagonal first: the characteristic polynomial's least root, by an angle's thirds (O. K. Smith, 1961).
fn least_eigenvalue([xx, yy, zz, yz, xz, xy]: [f64; 6]) -> f64 {
    let mean = (xx + yy + zz) / 3.0;
    let [x, y, z] = [xx - mean, yy - mean, zz - mean];
    let spread = ((x * x + y * y + z * z + 2.0 * (yz * yz + xz * xz + xy * xy)) / 6.0).sqrt();
    if spread == 0.0 {
        return mean;
    }
    let [x, y, z, yz, xz, xy] = [x, y, z, yz, xz, xy].map(|c| c / spread);
    let determinant = x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz);
    let angle = libm::acos((determinant / 2.0).clamp(-1.0, 1.0)) / 3.0;
    mean + 2.0 * spread * libm::cos(angle + std::f64::consts::TAU / 3.0)
}
