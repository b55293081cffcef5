//! How densely points lie and how clean they are, as far as the levels tell.

use super::levels::Levels;
use super::noise::{dimension, noise, thicker, variances};
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
    /// How many times as far points lie from the surface in cells twice as wide: hardly farther amid noise, twice as far in a body that points fill; none if too few places tell.
    pub thicker: Option<f64>,
    /// The dimension of what points near each other fill: 2 on a surface, 1 on lines, nearly 3 amid noise as thick as the sampling distance, and more where points keep apart, as on a grid;
    /// none if too few places tell.
    pub dimension: Option<f64>,
}

impl Density {
    pub(super) fn of(levels: &Levels, points: u64) -> Density {
        let distance = sampling_distance(levels, points);
        let variances = distance.and_then(|distance| variances(levels, distance));
        Density {
            distance,
            middle: distance.and_then(|distance| middle(levels, distance)),
            noise: variances.as_ref().map(noise),
            thicker: variances.as_ref().and_then(thicker),
            dimension: distance.and_then(|distance| dimension(levels, distance)),
        }
    }
}
