//! How densely the points lie: the distance between neighbouring samples.

use super::levels::{Level, Levels};
use super::noise::WIDE;

/// A cell with fewer than this part of the usual points holds strays, or lies at the surface's border.
const STRAY: u64 = 20;

/// Cells that points are found in, for each w² of surface, w their side. A plane passes 1.5 on average over its positions, but
/// some of them only by a corner, where hardly a point falls.
const CELLS_OF_SURFACE: f64 = 1.2;
/// Points to a cell, on average, below which cells are small enough to measure the surface: few, so that folds of the surface
/// do not share cells, and enough to tell how many cells of the surface are empty by chance.
const POINTS_TO_A_CELL: f64 = 16.0;
/// Steps in which the share of empty cells is found: to three digits, more than the sketch has.
const STEPS: u32 = 12;

/// The mean distance d between neighbouring samples of the cloud's surface, in the input's units: d² = area / points.
///
/// The cells with points in them are counted (by sketch) at sides that halve from the box's diagonal, down to the first
/// side at which there are fewer than 16 points to a cell. If points fall at random, λ to a cell on average, a share of
/// e^−λ gets none: so from the n/λ cells of the surface come its area and d. `None` for a single place.
///
/// On the horse, the dragon, the rocker arm, cube, sphere, torus and lattices (4,000 to 500,000 points at random, half of them
/// thinned to a tenth, or the meshes' own vertices) d comes out at 0.93 to 1.1 of what their area gives. It is too small
/// (0.8) for a plate so thin that both its sides share cells.
///
/// It is a mean over the surface, not a high quantile: where one part is sampled ten times as densely as another, d is that of
/// the denser, up to a third, and a grid laid by it keeps the detail there. The sparser part stays whole because the closing
/// radius grows.
///
/// If none of the levels has so few points to a cell, the finest tells: so many of its cells hold strays.
pub(super) fn sampling_distance(levels: &Levels, points: u64) -> Option<f64> {
    let counted = |level: &Level| {
        let [cells, kept] = without_strays(level);
        (kept * points as f64, cells * level.distinct())
    };
    let mut told = None;
    for (side, level) in levels.iter() {
        let (n, cells) = counted(level);
        told = Some(side / (CELLS_OF_SURFACE * points_to_a_cell(n / cells)).sqrt());
        if n / cells < POINTS_TO_A_CELL {
            break;
        }
    }
    told
}

/// Points of the middle cell for each d² of its side's square, where they lie evenly, d apart: .72 to .85 on horse, dragon, rocker arm and sphere. Cells have less of a surface than their
/// side's square, as many have a corner of it only.
const OF_MIDDLE: f64 = 0.78;
/// Fewer cells say nothing.
const CELLS: usize = 32;

/// The sampling distance of the middle one of all cells, which are those by which the noise is told; `distance` is that of all samples.
///
/// Where density is 1:10 along the body it is 1.14 times the distance of all samples, where it is 1:50 1.38 times.
pub(super) fn middle(levels: &Levels, distance: f64) -> Option<f64> {
    let (side, level) = levels.wider_than(WIDE * distance)?;
    let mut counts: Vec<u64> = level.counts().collect();
    counts.sort_unstable();
    let middle = counts.get(counts.len() / 2).filter(|_| counts.len() >= CELLS)?;
    Some(side / (*middle as f64 / OF_MIDDLE).sqrt())
}

/// The parts of the cells, and of their points, that are no strays: cells with at least a [`STRAY`] of the points that the middle one of all points shares its
/// cell with.
fn without_strays(level: &Level) -> [f64; 2] {
    let mut counts: Vec<u64> = level.counts().collect();
    counts.sort_unstable();
    let all: u64 = counts.iter().sum();
    let mut before = 0;
    let middle = counts.iter().find(|count| {
        before += **count;
        2 * before >= all
    });
    let least = middle.map_or(0, |middle| middle.div_ceil(STRAY));
    let left: Vec<u64> = counts.iter().copied().filter(|count| *count >= least).collect();
    [left.len() as f64 / counts.len().max(1) as f64, left.iter().sum::<u64>() as f64 / all.max(1) as f64]
}

/// The mean number λ of points that fall to a cell, if those that got any got `found` on average: found = λ / (1 − e^−λ).
///
/// Every step brings λ nearer by a factor of `found` − λ, which is less than 0.5 where `found` is 2 or more, as it is for
/// all but a handful of points.
fn points_to_a_cell(found: f64) -> f64 {
    let mut points = found;
    for _ in 0..STEPS {
        points = found * (1.0 - libm::exp(-points));
    }
    // A lattice may have one point in each of its cells: no more than half of the cells are taken to have been missed.
    points.max(found / 2.0)
}
