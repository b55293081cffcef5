//! The survey: what passes over the points find before the grid is laid.

mod extent;
mod sampling_distance;
mod seen_from;

pub use self::extent::{Survey, boxes_of_sources, planes_with_points, survey, turned_bounds};
pub use self::sampling_distance::sampling_distance;
pub use self::seen_from::seen_from;
