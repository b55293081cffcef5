//! How fine cells are that nobody gave a side: what the points carry.

use crate::grid::survey::Density;
use crate::settings::open::Kind;

/// The cell size that `--cell-size auto` takes, in sampling distances: the finest that keeps handles and holes as they are.
///
/// 500,000 points at random on the horse (genus 0) and the dragon (its outside has genus 1), three times each; root mean square
/// distances in thousandths of a percent of the box's diagonal, against those of ball pivoting through all points, with
/// the samples' true normals. The dragon's other direction says nothing: part of its surface lies deep within.
///
/// | side / d | radius | horse: genus | mesh to truth | truth to mesh | dragon: components, genus | mesh to truth |
/// |---|---|---|---|---|---|---|
/// | ball pivoting | | open | 2.8 | 4.0 | open | 4.6 |
/// | 1.0 | 2 to 3 | 1 or 2 | 3.1 | 5.9 | 1 to 3, 1 or 2 | 6.3 |
/// | 1.25 | 1 | 0 | 3.6 | 7.5 | 1, 1 | 7.9 |
/// | 1.5 | 1 | 0 | 4.3 | 8.9 | 1, 1 or 2 | 11.1 |
/// | 2.0 | 1 | 0 | 6.2 | 14.3 | 1, 1 or 2 | 21.5 |
/// | k = 4 (1.8; 1.2) | 1 | 0 | 5.5 | 13.0 | 1, 1 | 7.6 |
///
/// At 1.0, a third of the surface's cells are empty by chance, so that sealing takes two or three cells, which then bridge what
/// lies close together; at 1.16 that still happens in one cloud of four, at 1.2 in none. The distance as measured is off by a
/// few percent: with it, the horse comes to 4.0 and 8.3, the dragon to 8.1, 1.4 to 2.1 times ball pivoting. With half of the
/// points thinned to a tenth, 1.25 still gives one component of the right genus, at a radius of 4.
const AUTO_CELL: f64 = 1.25;

/// The side that default cells have at least where they are finer than by k = 4, in sampling distances: a little more than the finest that keeps handles and holes, as the
/// distance is known to a few per cent, and the next cloud may be worse. With 1.25, one of eight clouds (50,000 samples of the horse) had a handle that is not there; with 1.35 none of four had.
const SAFE_CELL: f64 = 1.35;

/// Default cells are no smaller than this part of those by k = 4: four times the triangles at most.
const FINER: f64 = 0.5;

/// Default cells finer than those by k = 4 are so wide that the noise is no more than this part of their side.
const CLEAN: f64 = 0.05;

/// That of terrain and ground, whose columns cannot come apart: cells that are empty by chance are bridged.
///
/// Every tenth point held out, vertical errors of the others' mesh in metres, root mean square and 95 %; `tools/terrain.py held`:
///
/// | side / d | town, open ground | town, open roofs | Brittany, ground by classes | forest, ground by classes |
/// |---|---|---|---|---|
/// | 1.25 | .178, .106 | .576, .454 | .193, .342 | .119, .241 |
/// | 1.0 | .104, .074 | .524, .457 | .181, .305 | .105, .218 |
/// | a triangulation | .063, .065 | 1.923, 3.725 | .166, .253 | .099, .201 |
///
/// At 1.0, terrain has 1.4 triangles a point, a triangulation 2.
const AUTO_COLUMN: f64 = 1.0;

/// Cells are made finer than by k = 4 if they are no more than this part as wide. Hardly finer ones gain hardly anything, and noise and sparseness near the limits
/// are not known so well.
const WORTH: f64 = 0.9;

/// The side that `--cell-size auto` takes for samples that are so far apart.
pub(super) fn auto_side(distance: f64, open: Option<Kind>) -> f64 {
    match open {
        None | Some(Kind::Sheet) => AUTO_CELL * distance,
        Some(_) => AUTO_COLUMN * distance,
    }
}

/// The side of default cells, `usual` by k = 4: half of that, where points carry it.
///
/// They carry it if they are dense enough on half of the surface that cells are not empty by chance, and so clean that the surface through them is not rough.
pub(super) fn default_side(usual: f64, density: Density) -> f64 {
    // What few points do not tell is taken for the worst.
    let sparser = density.middle.zip(density.distance).map(|(middle, all)| middle.max(all));
    let even = sparser.map_or(usual, |distance| SAFE_CELL * distance);
    let clean = density.noise.map_or(usual, |noise| noise / CLEAN);
    let carried = (FINER * usual).max(even).max(clean);
    let side = if carried <= WORTH * usual { carried } else { usual };
    side.max(density.distance.map_or(0.0, |distance| auto_side(distance, None)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn default_cells_are_as_fine_as_points_carry(
            distance in prop::option::of(0.0f64..3.0),
            middle in prop::option::of(0.0f64..3.0),
            noise in prop::option::of(0.0f64..0.2),
        ) {
            let side = default_side(1.0, Density { distance, middle, noise });
            let least = distance.map_or(0.0, |d| 1.25 * d);
            // Never coarser than by k = 4 or the sampling distance, whichever is more; never finer than half of it.
            prop_assert!(side >= least && side >= 0.5 && side <= least.max(1.0));
            if side < 1.0 {
                prop_assert!(side >= 1.35 * middle.unwrap() && side >= 1.35 * distance.unwrap());
                prop_assert!(noise.unwrap() <= side * 0.05 * (1.0 + 1e-9));
            }
            // Points that are denser, more even or cleaner never make cells coarser.
            let less = |of: Option<f64>| of.map(|of| of * 0.9);
            for better in [
                Density { distance: less(distance), middle, noise },
                Density { distance, middle: less(middle), noise },
                Density { distance, middle, noise: less(noise) },
            ] {
                prop_assert!(default_side(1.0, better) <= side);
            }
        }
    }
}
