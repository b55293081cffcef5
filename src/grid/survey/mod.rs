//! The survey: what passes over the points find before the grid is laid.

mod density;
mod dimension;
mod extent;
mod levels;
mod noise;
mod sampling_distance;
mod seen_from;
#[cfg(test)]
mod tests;

pub use self::density::Density;
pub use self::extent::{Survey, Wanted, boxes_of_sources, planes_with_points, survey, turned_bounds};
pub use self::seen_from::seen_from;
