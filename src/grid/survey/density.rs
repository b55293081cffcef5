//! How densely points lie and how clean they are, as far as the levels tell.

use super::dimension;
use super::levels::Levels;
use super::noise::noise;
use super::sampling_distance::{middle, sampling_distance};

/// How densely points lie, and how far from their surface.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Density {
    /// The mean distance between neighbouring samples; none of a single place.
    pub distance: Option<f64>,
    /// The distance in the middle of the surface, half of which is sampled more sparsely: that of all samples, if these lie evenly; none if too few places tell.
    pub middle: Option<f64>,
    /// The standard deviation from the surface; none if too few places tell.
    pub noise: Option<f64>,
    /// The dimension of what points fill that lie nearer to each other than that: 2 on a surface, 1 on lines, nearly 3 amid noise as thick as the distance, and more where points keep apart,
    /// as on a grid; none if too few places tell.
    pub near_dimension: Option<f64>,
    /// The dimension of what points fill that lie farther from each other: 2 on a surface, amid noise or not, nearly 3 in a body that points fill; none if too few places tell.
    pub far_dimension: Option<f64>,
}

impl Density {
    pub(super) fn of(levels: &Levels, points: u64) -> Density {
        let distance = sampling_distance(levels, points);
        Density {
            distance,
            middle: distance.and_then(|distance| middle(levels, distance)),
            noise: distance.and_then(|distance| noise(levels, distance)),
            near_dimension: distance.and_then(|distance| dimension::near(levels, distance)),
            far_dimension: distance.and_then(|distance| dimension::far(levels, distance)),
        }
    }
}
