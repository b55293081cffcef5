//! What may not be what was meant, told before a run as well as after it: each with the option that helps.

use crate::error::words::short;
use crate::points::bounds::Bounds;
use crate::run::progress::Warning;
use crate::run::surveyed::Surveyed;

/// What the survey alone tells.
pub(super) fn of_survey(surveyed: &Surveyed) -> Vec<Warning> {
    far_points(surveyed).into_iter().chain(too_fine(surveyed)).collect()
}

/// Cells of a closed surface that are smaller than the sampling distance have about two triangles and more to a point.
fn too_fine(surveyed: &Surveyed) -> Option<Warning> {
    let distance = surveyed.density?.distance.filter(|_| surveyed.open.is_none())?;
    let side = surveyed.grid.cell_size() / distance;
    (side < 1.0)
        .then(|| Warning::new(format!("cells are finer than points can carry: {side:.2} sampling distances"), CARRIED))
}

/// What helps where cells are too fine.
pub(super) const CARRIED: &str =
    "--cell-size auto makes them as fine as can be; without --k, --slices and --cell-size they are as fine as is good";

/// A few points far from all others, which make the box large and cells coarse. A grid that leaves the gap out is none the worse for them.
fn far_points(surveyed: &Surveyed) -> Option<Warning> {
    let bounds = &surveyed.survey.bounds;
    let body = surveyed.coarse_grid.body(bounds).filter(|_| !surveyed.grid.has_gaps())?;
    let (with, without) = (short(bounds.longest_side()), short(body.longest_side()));
    Some(Warning::new(
        format!("a few points lie far off: the longest side is {with}, and {without} without them"),
        format!("{} leaves them out", bounds_option(&body)),
    ))
}

/// The option that takes the points of a box, with as few digits as hold them all.
fn bounds_option(of: &Bounds) -> String {
    // A thousandth of the longest side more, so that rounding takes no point away.
    let more = of.longest_side() / 1000.0;
    let places = (-libm::log10(more).floor()).clamp(0.0, 15.0) as usize;
    let corner = |corner: [f64; 3], by: f64| corner.map(|c| format!("{:.places$}", c + by)).join(",");
    format!("--bounds {},{}", corner(of.min, -more), corner(of.max, more))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_holds_all_that_it_is_made_of() {
        for scale in [1e-7, 0.02, 1.0, 31.0, 1e6] {
            let of = Bounds {
                min: [-0.123_456_789, 0.0, 3.9999].map(|c| c * scale),
                max: [1.0, 0.7, 4.0].map(|c| c * scale),
            };
            let option = bounds_option(&of);
            let numbers: Vec<f64> = option["--bounds ".len()..].split(',').map(|n| n.parse().unwrap()).collect();
            for a in 0..3 {
                assert!(numbers[a] <= of.min[a] && of.max[a] <= numbers[a + 3], "{option}");
                assert!(numbers[a + 3] - numbers[a] <= of.max[a] - of.min[a] + 0.005 * of.longest_side(), "{option}");
            }
        }
    }
}
