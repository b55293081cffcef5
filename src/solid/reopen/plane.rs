//! The plane of a cell's points, told from the means and covariances of the cells round it.
//!
//! Round an edge or between two walls, all points near a cell have no plane in common. So the plane of all 3 x 3 x 3 cells competes with those of the eight
//! blocks of 2 x 2 x 2 cells that hold the cell; then the best one is fitted again, with weights that fall off with the distance from it.
//!
//! ```text
//!      # # # #  a wall          of the blocks round c, a lies within one wall
//!    +-----+                    and has the least residual
//!    | a # c # #
//!    +-----+   #  another one
//! ```

use bytemuck::{Pod, Zeroable};
use multiversion::multiversion;

use crate::points::vector::{cross, dot, minus, plus, times};

/// What is known of the points of a cell.
#[derive(Debug, Clone, Copy, Default, PartialEq, Zeroable, Pod)]
#[repr(C)]
pub struct Moments {
    /// How many there are, but no more than [`MOST`].
    pub weight: f32,
    /// Their mean, from the cell's lowest corner, in cells.
    pub mean: [f32; 3],
    /// Their covariance: xx, yy, zz, xy, xz, yz.
    pub covariance: [f32; 6],
}

/// In-cell offsets are summed as integers, in this part of a cell.
const QUANTA: f64 = (1 << 16) as f64;

/// A cell's points as they are summed; 2³¹ points would overflow them.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sum {
    points: u64,
    first: [u64; 3],
    second: [u64; 6],
}

impl Sum {
    pub(super) fn add(&mut self, within: [f64; 3]) {
        let o = within.map(|c| (c * QUANTA) as u64);
        self.points += 1;
        for (sum, o) in self.first.iter_mut().zip(o) {
            *sum += o;
        }
        let [x, y, z] = o;
        for (sum, o) in self.second.iter_mut().zip([x * x, y * y, z * z, x * y, x * z, y * z]) {
            *sum += o;
        }
    }

    pub(super) fn moments(&self) -> Moments {
        let points = (self.points as f64).max(1.0);
        let [x, y, z] = self.first.map(|sum| sum as f64 / points / QUANTA);
        let second = self.second.map(|sum| sum as f64 / points / (QUANTA * QUANTA));
        let means = [x * x, y * y, z * z, x * y, x * z, y * z];
        Moments {
            weight: (self.points as f32).min(MOST),
            mean: [x, y, z].map(|c| c as f32),
            covariance: std::array::from_fn(|i| (second[i] - means[i]) as f32),
        }
    }
}

/// More points of one cell count as so many.
pub const MOST: f32 = 3.0;

/// A cell's plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Across it, of length 1; on which side the outside lies is not known.
    pub normal: [f32; 3],
    /// How surely it is one, from 0 to 1.
    pub confidence: f32,
}

/// Cells in the cube that is looked at: so many either way, and if they hold too few points.
pub const REACH: [i64; 2] = [2, 3];

/// Points of the 27 cells, and three tenths of those beyond, that are enough.
const ENOUGH: f64 = 8.0;
const BEYOND: f64 = 0.3;

/// Points that a plane of the 27 cells takes, and one of eight.
const LEAST: [f64; 2] = [4.0, 6.0];

/// The second of the three variances, at the least: along a line there is no plane. And, of eight cells, its ratio to the first.
const WIDTH: f64 = 0.04;
const FLATNESS: f64 = 4.0;

/// A plane of eight cells must be better by so much: the residual is multiplied, and more is added.
const HANDICAP: (f64, f64) = (1.5, 0.004);

/// Refits, and their weights: standard deviations across the plane and along it.
const REFITS: u32 = 3;
const ACROSS: f64 = 0.35;
const ALONG: f64 = 1.1;
/// Of a refit: the least sum of weights, and the least second variance.
const LEAST_REFIT: (f64, f64) = (2.5, 0.03);
/// Weights below exp of this are none.
const NEGLIGIBLE: f64 = -12.0;

/// A plane's confidence falls off with its thickness, in cells.
const THIN: f64 = 0.25;

/// A cell near the one whose plane is looked for.
#[derive(Debug, Clone, Copy)]
pub struct Near {
    /// Its points.
    points: f64,
    /// Their mean, and the mean of their products xx, yy, zz, xy, xz, yz, seen from the lowest corner of the cell whose plane is looked for.
    mean: [f64; 3],
    products: [f64; 6],
    /// Of the eight blocks of 2 x 2 x 2 cells, those that hold it; none if it is not one of the 27 cells.
    blocks: u8,
}

impl Near {
    /// The cell that is so many cells off.
    pub fn new(step: [i64; 3], moments: &Moments) -> Near {
        /// Of the blocks, those on the lower side along each axis.
        const LOWER: [u8; 3] = [0x55, 0x33, 0x0F];
        let side = |a: usize| match step[a] {
            0 => 0xFF,
            1 => !LOWER[a],
            -1 => LOWER[a],
            _ => 0,
        };
        let mean = [0, 1, 2].map(|a: usize| step[a] as f64 + f64::from(moments.mean[a]));
        let ([x, y, z], c) = (mean, moments.covariance.map(f64::from));
        let products = [x * x + c[0], y * y + c[1], z * z + c[2], x * y + c[3], x * z + c[4], y * z + c[5]];
        Near { points: f64::from(moments.weight), mean, products, blocks: side(0) & side(1) & side(2) }
    }
}

/// Whether the cells near one hold enough points for a plane.
pub fn is_enough(near: &[Near]) -> bool {
    let points = |near: &Near| near.points * if near.blocks != 0 { 1.0 } else { BEYOND };
    near.iter().map(points).sum::<f64>() >= ENOUGH
}

/// Sums over points.
#[derive(Debug, Default)]
struct Sums {
    weight: f64,
    first: [f64; 3],
    second: [f64; 6],
}

/// A plane that was fitted: a place, the normal, and the two least variances.
struct Fitted {
    at: [f64; 3],
    normal: [f64; 3],
    variances: [f64; 2],
}

impl Sums {
    fn add(&mut self, near: &Near, weight: f64) {
        self.weight += weight;
        for (sum, v) in self.first.iter_mut().zip(near.mean) {
            *sum += weight * v;
        }
        for (sum, v) in self.second.iter_mut().zip(near.products) {
            *sum += weight * v;
        }
    }

    /// The plane; none if the least variance is no less than `limit`.
    fn fitted(&self, limit: f64) -> Option<Fitted> {
        let at = self.first.map(|c| c / self.weight);
        let [xx, yy, zz, xy, xz, yz] = self.second.map(|c| c / self.weight);
        let [x, y, z] = at;
        let covariance = [xx - x * x, yy - y * y, zz - z * z, xy - x * y, xz - x * z, yz - y * z];
        let (variances, normal) = flattest(covariance, limit)?;
        Some(Fitted { at, normal, variances })
    }
}

/// The plane of a cell whose points are `own`, among the cells `near` it, itself included; these lie within the second [`REACH`] if `wide`.
pub fn plane(own: &Moments, near: &[Near], wide: bool) -> Plane {
    let own: [f64; 3] = own.mean.map(f64::from);
    let mut best: Option<(f64, Fitted)> = None;
    for block in 0..9 {
        let all = block == 0;
        // Nothing is left to win.
        if !all && best.as_ref().is_some_and(|(residual, _)| *residual <= HANDICAP.1) {
            break;
        }
        let mut sums = Sums::default();
        let of = if all { 0xFF } else { 1 << (block - 1) };
        for cell in near.iter().filter(|cell| (all && wide) || cell.blocks & of != 0) {
            sums.add(cell, cell.points);
        }
        if sums.weight < LEAST[usize::from(!all)] {
            continue;
        }
        let freedom = sums.weight / (sums.weight - 3.0).max(1.0);
        let (factor, more) = if all { (1.0, 0.0) } else { HANDICAP };
        let limit = best.as_ref().map_or(f64::INFINITY, |(least, _)| (least - more) / (factor * freedom));
        let Some(fitted) = sums.fitted(limit) else { continue };
        let [first, second] = fitted.variances;
        if second < WIDTH || (!all && second < FLATNESS * first) {
            continue;
        }
        let off = dot(fitted.normal, minus(own, fitted.at));
        let residual = factor * (first * freedom + 0.5 * off * off) + more;
        if best.as_ref().is_none_or(|(least, _)| residual < *least) {
            best = Some((residual, fitted));
        }
    }
    let Some((_, Fitted { mut at, mut normal, .. })) = best else {
        return Plane { normal: [0.0, 0.0, 1.0], confidence: 0.0 };
    };
    let mut thickness = 1.0;
    for step in 0..REFITS {
        let off = dot(normal, minus(own, at));
        // The weights along the plane are seen from the cell's mean, then from half way to the plane.
        let from = minus(own, times(if step > 0 { 0.5 * off } else { 0.0 }, normal));
        if step == 0 && off.abs() > ACROSS {
            at = plus(at, times(off, normal));
        }
        let mut sums = Sums::default();
        for cells in near.chunks(TOGETHER) {
            let mut weights = [f64::NEG_INFINITY; TOGETHER];
            for (weight, cell) in weights.iter_mut().zip(cells) {
                let across = dot(normal, minus(cell.mean, at));
                let d = minus(cell.mean, from);
                let t = dot(normal, d);
                let along = dot(d, d) - t * t;
                *weight = -along / (2.0 * ALONG * ALONG) - across * across / (2.0 * ACROSS * ACROSS);
            }
            exponentials(&mut weights);
            for (weight, cell) in weights.iter().zip(cells).filter(|(weight, _)| **weight > 0.0) {
                sums.add(cell, cell.points * weight);
            }
        }
        if sums.weight < LEAST_REFIT.0 {
            break;
        }
        let Some(fitted) = sums.fitted(f64::INFINITY).filter(|fitted| fitted.variances[1] >= LEAST_REFIT.1) else {
            break;
        };
        (at, normal) = (fitted.at, fitted.normal);
        thickness = fitted.variances[0].sqrt();
    }
    let off = dot(normal, minus(own, at));
    let squared = thickness * thickness + off * off;
    let confidence = libm::exp(-squared / (2.0 * THIN * THIN)) as f32;
    Plane { normal: normal.map(|c| c as f32), confidence }
}

/// So many exponentials are found together.
const TOGETHER: usize = 8;

/// exp of each power, which is more than [`NEGLIGIBLE`] and no more than a little over 0; 0 of lesser ones. They are the bits of `libm::exp`, of which these are the operations,
/// without branches.
#[multiversion(targets("x86_64+avx+avx2"))]
fn exponentials(powers: &mut [f64; TOGETHER]) {
    // ln 2 in two parts, and the polynomial's coefficients.
    const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];
    const P: [f64; 5] = [
        1.666_666_666_666_660_2e-1,
        -2.777_777_777_701_559_3e-3,
        6.613_756_321_437_934e-5,
        -1.653_390_220_546_525_2e-6,
        4.138_136_797_057_238_5e-8,
    ];
    // The upper halves of the bits of ln 2 / 2 and of 2^-28.
    const HALF_LN_2: u64 = 0x3FD6_2E42;
    const SMALL: u64 = 0x3E30_0000;
    // Added to a whole number, 2^52 leaves its bits at the end.
    const WHOLE: f64 = 4_503_599_627_370_496.0;
    for power in powers {
        let x = if *power > NEGLIGIBLE { *power } else { NEGLIGIBLE };
        let upper = x.to_bits() >> 32 & 0x7FFF_FFFF;
        let k = if upper > HALF_LN_2 { (std::f64::consts::LOG2_E * x - 0.5).trunc() } else { 0.0 };
        let (high, low) = (x - k * LN_2[0], k * LN_2[1]);
        let r = high - low;
        let rr = r * r;
        let c = r - rr * (P[0] + rr * (P[1] + rr * (P[2] + rr * (P[3] + rr * P[4]))));
        let y = 1.0 + (r * c / (2.0 - c) - low + high);
        let scale = f64::from_bits((k + 1023.0 + WHOLE).to_bits() << 52);
        let exp = if upper > SMALL { y * scale } else { 1.0 + x };
        *power = if *power > NEGLIGIBLE { exp } else { 0.0 };
    }
}

/// The two least eigenvalues of a covariance xx, yy, zz, xy, xz, yz, no less than 0, and the direction of the least, of length 1; none if the least is no less than `limit`.
///
/// The least is the first root of det(A - t I), which Newton's method finds from 0 upwards: each step is a lower bound. Its direction is across two rows of A - t I.
fn flattest(covariance: [f64; 6], limit: f64) -> Option<([f64; 2], [f64; 3])> {
    /// Steps, at most: they halve the distance even to a double root.
    const STEPS: u32 = 40;
    /// A step that is no longer, in parts of the trace, is the last.
    const LAST: f64 = 1e-15;
    /// A slope that is no more, in parts of the trace's square, tells nothing.
    const LOST: f64 = 1e-10;
    let [xx, yy, zz, xy, xz, yz] = covariance;
    let trace = xx + yy + zz;
    let minors = (xx * yy - xy * xy) + (xx * zz - xz * xz) + (yy * zz - yz * yz);
    let determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    let mut least = 0.0;
    for _ in 0..STEPS {
        if least >= limit {
            return None;
        }
        let value = determinant - least * (minors - least * (trace - least));
        let slope = minors - least * (2.0 * trace - 3.0 * least);
        // At the root, rounding leaves a value of either sign; where two or three roots meet, the slope is lost in it, too.
        if value <= 0.0 || slope <= LOST * trace * trace || value <= slope * (LAST * trace) {
            break;
        }
        least += value / slope;
    }
    let (sum, product) = (trace - least, minors - least * (trace - least));
    let root = (sum * sum - 4.0 * product).max(0.0).sqrt();
    let second = (0.5 * (sum - root)).max(least);
    let rows = [[xx - least, xy, xz], [xy, yy - least, yz], [xz, yz, zz - least]];
    let mut normal = [0.0, 0.0, 1.0];
    let mut squared = 0.0;
    for (i, j) in [(0, 1), (0, 2), (1, 2)] {
        let across = cross(rows[i], rows[j]);
        let length = dot(across, across);
        if length > squared {
            (normal, squared) = (across, length);
        }
    }
    let length = if squared > 0.0 { squared.sqrt() } else { 1.0 };
    Some(([least, second], normal.map(|c| c / length)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn exponentials_have_the_bits_of_the_library(
            powers in prop::collection::vec(prop_oneof![-13.0f64..1e-9, -0.4f64..-0.3, -1.1f64..-1.0, -1e-7f64..1e-12], TOGETHER),
        ) {
            let mut found: [f64; TOGETHER] = powers.clone().try_into().unwrap();
            exponentials(&mut found);
            for (power, found) in powers.into_iter().zip(found) {
                let expected = if power > NEGLIGIBLE { libm::exp(power) } else { 0.0 };
                prop_assert_eq!(found.to_bits(), expected.to_bits(), "{}", power);
            }
        }

        #[test]
        fn the_flattest_direction_is_that_of_jacobi(
            of in prop_oneof![
                prop::array::uniform6(-2.0f64..2.0),
                // Nearly flat, nearly a line, nearly round.
                prop::array::uniform6(-1.0f64..1.0).prop_map(|[a, b, c, d, e, f]| [a, b, 1e-7 * c, d, 1e-7 * e, 1e-7 * f]),
                prop::array::uniform6(-1.0f64..1.0).prop_map(|[a, b, c, d, e, f]| [a, 1e-4 * b, 1e-6 * c, d, e, 1e-6 * f]),
                prop::array::uniform6(-1e-6f64..1e-6).prop_map(|[a, b, c, d, e, f]| [1.0 + a, 1.0 + b, 1.0 + c, d, e, f]),
            ],
        ) {
            let [a, b, c, d, e, f] = of;
            let m = squared([[a, d, e], [d, b, f], [e, f, c]]);
            let of = [m[0][0], m[1][1], m[2][2], m[0][1], m[0][2], m[1][2]];
            let ([least, second], n) = flattest(of, f64::INFINITY).unwrap();
            let (expected, direction) = by_jacobi(m);
            let trace = of[0] + of[1] + of[2];
            for (found, expected) in [least, second].into_iter().zip(expected) {
                // A root that is double is known to half the digits, one that is triple to a third.
                prop_assert!((found - expected).abs() <= 1e-5 * trace, "{found} for {expected}");
            }
            if expected[1] - expected[0] > 1e-2 * trace {
                prop_assert!((least - expected[0]).abs() <= 1e-13 * trace, "{least} for {}", expected[0]);
                prop_assert!((dot(n, direction).abs() - 1.0).abs() < 1e-12, "{n:?} for {direction:?}");
            }
            prop_assert!((dot(n, n) - 1.0).abs() < 1e-12);
        }

        #[test]
        fn a_variance_beyond_the_limit_is_not_looked_for(of in prop::array::uniform6(-2.0f64..2.0), limit in 0.0f64..1.0) {
            let [a, b, c, d, e, f] = of;
            let m = squared([[a, d, e], [d, b, f], [e, f, c]]);
            let of = [m[0][0], m[1][1], m[2][2], m[0][1], m[0][2], m[1][2]];
            let all = flattest(of, f64::INFINITY);
            prop_assert_eq!(flattest(of, limit), all.filter(|([least, _], _)| *least < limit));
        }
    }

    #[test]
    fn points_in_one_place_have_no_variance() {
        assert_eq!(flattest([0.0; 6], f64::INFINITY), Some(([0.0; 2], [0.0, 0.0, 1.0])));
    }

    /// A symmetric matrix times itself, which has no negative eigenvalues.
    fn squared(a: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
        a.map(|row| a.map(|column| dot(row, column)))
    }

    /// The naive twin: Jacobi's rotations (G. H. Golub and C. F. Van Loan, *Matrix Computations*, 4th edition, 2013, section 8.5).
    fn by_jacobi(mut a: [[f64; 3]; 3]) -> ([f64; 2], [f64; 3]) {
        let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for (p, q) in [(0, 1), (0, 2), (1, 2)].repeat(12) {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let tangent = if theta < 0.0 { -1.0 } else { 1.0 } / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
            let sine = tangent * cosine;
            for row in a.iter_mut().chain(&mut axes) {
                (row[p], row[q]) = (cosine * row[p] - sine * row[q], sine * row[p] + cosine * row[q]);
            }
            let (x, y) = (a[p], a[q]);
            a[p] = [0, 1, 2].map(|k: usize| cosine * x[k] - sine * y[k]);
            a[q] = [0, 1, 2].map(|k: usize| sine * x[k] + cosine * y[k]);
        }
        let mut order = [0, 1, 2];
        order.sort_by(|i, j| a[*i][*i].total_cmp(&a[*j][*j]));
        ([order[0], order[1]].map(|i| a[i][i]), [0, 1, 2].map(|k: usize| axes[k][order[0]]))
    }
}
