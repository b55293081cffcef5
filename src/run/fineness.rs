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

/// Amid noise, default cells are no smaller than so many of its standard deviations, as the survey knows them: of noise of more than a sampling distance it sees less and less.
/// Finer cells have gaps and handles in the shell of points, or only its outermost points bound the body.
///
/// Sphere, box, torus, knot, gauge, CAD part and plate, 20,000 and 60,000 samples, Gaussian noise in sampling distances: wrong pieces or genus, of 14; geometric mean of the distances from
/// mesh to truth and back, in sampling distances.
///
/// | noise | none | 2.2 | 2.6 | 3.2 |
/// |---|---|---|---|---|
/// | 0.7 | 4; .222, .229 | 4; .222, .229 | 5; .228, .229 | 1; .210, .220 |
/// | 1.0 | 11; .313, .295 | 8; .311, .296 | 5; .306, .301 | 3; .280, .288 |
/// | 1.5 | 14; 1.206, .545 | 9; .500, .395 | 7; .459, .394 | 5; .472, .425 |
/// | 2.0 | 10; 1.871, .762 | 5; .620, .502 | 6; .600, .531 | 5; .609, .576 |
/// | 3.0 | 8; 3.042, 1.429 | 7; 1.089, .771 | 5; 1.073, .799 | 5; 1.113, .842 |
const NOISES: f64 = 3.0;

/// Points lie amid noise if what those near each other fill has such a dimension ([`Density::near_dimension`]). Then noise it is, and not fins and slots.
const AMID_NOISE: std::ops::RangeInclusive<f64> = 2.3..=3.4;

/// And if what points fill that are far from each other has less than this ([`Density::far_dimension`]). Otherwise they fill a body.
const FILLED: f64 = 2.6;

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

/// Points that are this far off their surface on three quarters of it, in sampling distances, lie on no surface: they fill a volume, as leaves do.
///
/// Forest .51, wooded hills .40, a forest scanned from within .29; a small town between fields .19, towns and a stadium .02 to .1.
const IN_VOLUME: f64 = 1.0 / 3.0;

/// Seen from above, such points are at least this far apart, in sampling distances. Nearer ones lie over each other, as on stems, and tell nothing of more columns: with
/// columns as narrow as that, three quarters of the surface of the forest that was scanned from within (.31) bridged holes. Forest .41, wooded hills .62.
const STACKED: f64 = 1.0 / 3.0;

/// Columns of terrain are no narrower than this part of the sampling distance where points fill a volume: walls between leaves take two triangles for each cell of their
/// height, and a triangulation of all points has two triangles a point.
///
/// Every tenth point held out, vertical errors in metres, root mean square and 95 %, and triangles a point:
///
/// | side / d | forest, open ground | forest, crowns | | hills, open ground | hills, crowns | |
/// |---|---|---|---|---|---|---|
/// | 1.0 | 3.79, 9.20 | 5.04, 11.9 | 0.7 | 2.30, 5.17 | 3.62, 7.88 | 0.9 |
/// | 0.8 | 2.50, 6.48 | 4.80, 11.6 | 1.2 | 1.66, 2.91 | 3.06, 6.71 | 1.2 |
/// | 0.63 | 1.42, 2.71 | 4.56, 11.2 | 2.1 | 0.91, 1.25 | 2.84, 6.17 | 1.7 |
/// | 0.5; 0.55 | 0.54, 0.77 | 4.40, 10.8 | 3.9 | 1.11, 0.98 | 2.71, 5.98 | 2.5 |
/// | a triangulation | 0.51, 0.54 | 5.32, 11.8 | 2 | 0.70, 1.15 | 2.83, 5.92 | 2 |
const NARROWER: f64 = 0.6;

/// Cells are made finer than by k = 4 if they are no more than this part as wide. Hardly finer ones gain hardly anything, and noise and sparseness near the limits
/// are not known so well.
const WORTH: f64 = 0.9;

/// The side that `--cell-size auto` takes for samples of such density, which are as far apart as `in_plan` seen from above; none of a single place.
///
/// Where points fill a volume, the distance between samples of their surface says little: a column as wide as that has the ground of a gap and the crown beside it,
/// and its top is that of the highest of many leaves.
pub(super) fn auto_side(density: Density, in_plan: f64, open: Option<Kind>) -> Option<f64> {
    let distance = density.distance?;
    let in_volume = density.noise.is_some_and(|noise| noise >= IN_VOLUME * distance) && in_plan >= STACKED * distance;
    Some(match open {
        None | Some(Kind::Sheet) => AUTO_CELL * distance,
        Some(Kind::Terrain) if in_volume => AUTO_COLUMN * in_plan.clamp(NARROWER * distance, distance),
        // Of all points, few are the ground's.
        Some(Kind::Terrain | Kind::Ground) => AUTO_COLUMN * distance,
    })
}

/// The side of default cells, `usual` by k = 4: half of that, where points carry it, and more where noise asks for it.
///
/// They carry it if they are dense enough on half of the surface that cells are not empty by chance, and so clean that the surface through them is not rough.
pub(super) fn default_side(usual: f64, density: Density) -> f64 {
    // What few points do not tell is taken for the worst.
    let sparser = density.middle.zip(density.distance).map(|(middle, all)| middle.max(all));
    let even = sparser.map_or(usual, |distance| SAFE_CELL * distance);
    let clean = density.noise.map_or(usual, |noise| noise / CLEAN);
    let carried = (FINER * usual).max(even).max(clean);
    let side = if carried <= WORTH * usual { carried } else { usual };
    let amid_noise = density.near_dimension.is_some_and(|near| AMID_NOISE.contains(&near));
    let is_shell = density.far_dimension.is_some_and(|far| far < FILLED);
    let noise = density.noise.filter(|_| amid_noise && is_shell);
    side.max(density.distance.map_or(0.0, |distance| AUTO_CELL * distance))
        .max(noise.map_or(0.0, |noise| NOISES * noise))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn columns_are_as_narrow_as_points_lie_seen_from_above_where_these_fill_a_volume(
            distance in 1e-3f64..1e3,
            ratio in prop_oneof![0.1f64..1.2, 1e-3f64..1e3],
            noise in prop::option::of(0.0f64..1.0),
        ) {
            let noises = noise.map(|noise| noise * distance);
            let density = Density { distance: Some(distance), middle: None, noise: noises, near_dimension: None, far_dimension: None };
            let side = |kind| auto_side(density, ratio * distance, kind).unwrap();
            let terrain = side(Some(Kind::Terrain));
            let narrow = (terrain / distance - ratio.clamp(0.6, 1.0)).abs() < 1e-9;
            match noise.unwrap_or(0.0) {
                noise if noise > 0.34 && ratio > 0.34 => prop_assert!(narrow),
                noise if noise < 0.33 || ratio < 0.33 => prop_assert_eq!(terrain, distance),
                _ => prop_assert!(narrow || terrain == distance),
            }
            prop_assert_eq!(side(Some(Kind::Ground)), distance);
            for other in [None, Some(Kind::Sheet)] {
                prop_assert_eq!(side(other), 1.25 * distance);
            }
        }

        #[test]
        fn default_cells_are_as_fine_as_points_carry(
            distance in prop::option::of(0.0f64..3.0),
            middle in prop::option::of(0.0f64..3.0),
            noise in prop::option::of(prop_oneof![0.0f64..0.2, 0.0f64..2.0]),
            near_dimension in prop::option::of(1.0f64..5.0),
            far_dimension in prop::option::of(1.5f64..3.5),
        ) {
            let side = default_side(1.0, Density { distance, middle, noise, near_dimension, far_dimension });
            let amid_noise = near_dimension.is_some_and(|near| (2.3..=3.4).contains(&near))
                && far_dimension.is_some_and(|far| far < 2.6);
            let least = distance.map_or(0.0, |d| 1.25 * d).max(if amid_noise { 3.0 * noise.unwrap_or(0.0) } else { 0.0 });
            // Never coarser than by k = 4, the sampling distance or the noise, whichever is most; never finer than half of the first.
            prop_assert!(side >= least && side >= 0.5 && side <= least.max(1.0));
            if side < 1.0 {
                prop_assert!(side >= 1.35 * middle.unwrap() && side >= 1.35 * distance.unwrap());
                prop_assert!(noise.unwrap() <= side * 0.05 * (1.0 + 1e-9));
            }
            // Points that are denser, more even or cleaner never make cells coarser.
            let less = |of: Option<f64>| of.map(|of| of * 0.9);
            for better in [
                Density { distance: less(distance), middle, noise, near_dimension, far_dimension },
                Density { distance, middle: less(middle), noise, near_dimension, far_dimension },
                Density { distance, middle, noise: less(noise), near_dimension, far_dimension },
            ] {
                prop_assert!(default_side(1.0, better) <= side);
            }
        }
    }
}
