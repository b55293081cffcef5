//! How the slices are shared out: buckets, slabs and their halo. Fixed by the grid and the steps of smoothing alone, never by threads or
//! memory, so that the mesh cannot depend on these.
//!
//! ```text
//!   slices   0 1 2 3 4 5 6 7 8 ...
//!   buckets  |0      |1      |2        BUCKET_SLICES each: read and written together
//!   slabs    |0                  |1    slab_slices each: one job, one mesh
//!            |<- halo ->|              points of a vertex lie within so many slices of its plane
//! ```

use std::ops::Range;

use crate::settings::surface::SurfaceOptions;

/// Slices of one bucket: what is written to and read from temporary storage together.
pub const BUCKET_SLICES: u32 = 4;

/// How far from a vertex its point may be, in cells.
pub const REACH: u32 = 3;

/// How far from where it starts a vertex may go amid noisy points, or onto a membrane, in cells. With noise of a cell, the surface starts
/// four cells off where a stray lies, and more.
pub const MOST_TRAVEL: f64 = 6.0;

/// How far a vertex looks round for the sphere of the points, at most, in cells.
pub const SPHERE_SIGHT: f64 = 4.0;

/// Slices either side of a plane in which the points lie that move its vertices onto their spheres, after `smooth` steps of smoothing: the
/// way there, the look round from its end, and one for each step.
pub fn sphere_halo(smooth: u32) -> u32 {
    (MOST_TRAVEL + SPHERE_SIGHT) as u32 + smooth.max(1)
}

/// Slices either side of a plane in which the points of its vertices lie, after `smooth` steps of smoothing: the reach, and
/// one for each step, as a step moves a vertex by less than a cell.
pub fn halo(smooth: u32) -> u32 {
    REACH + smooth.max(1)
}

/// How many planes a vertex may get away from its own, whatever it is fitted to: no step of smoothing takes it farther than a cell; and one for rounding.
pub const TRAVEL: u32 = MOST_TRAVEL as u32 + 2;

/// Planes either side of a slab whose vertices are smoothed, too, so that the slab's become what they are in the whole surface. The first step of
/// smoothing needs none; each further one goes in and out again and needs a plane for either.
pub fn smooth_halo(smooth: u32) -> u32 {
    2 * (smooth.max(1) - 1)
}

/// Slices of a slab, given the steps of smoothing: a whole number of buckets, and so many that what a vertex at one seam can be contracted with
/// (twice the fitting's halo away, and its fan) never reaches the middle of the slab. Fixed by the parameters, never by threads or memory.
pub fn slab_slices(smooth: u32) -> u32 {
    (2 * (2 * halo(smooth) + 1) + 2).next_multiple_of(BUCKET_SLICES)
}

/// How slices are dealt out to slabs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slabs {
    /// Steps of smoothing.
    pub smooth: u32,
    /// Slices of a slab.
    pub slices: u32,
}

impl Slabs {
    /// Those of a surface.
    pub fn of(options: &SurfaceOptions) -> Slabs {
        Slabs { slices: options.slab_slices.unwrap_or(slab_slices(options.smooth)), ..Slabs::from(options.smooth) }
    }
}

impl From<u32> for Slabs {
    /// As many slices as so many steps of smoothing ask for.
    fn from(smooth: u32) -> Slabs {
        Slabs { smooth, slices: slab_slices(smooth) }
    }
}

/// The slices of slab `number`.
pub fn slices_of(number: u32, slabs: impl Into<Slabs>, slices: u32) -> Range<u32> {
    let size = slabs.into().slices;
    number * size..((number + 1) * size).min(slices)
}

/// The buckets that slices lie in.
pub fn buckets_of(slices: Range<u32>) -> Range<u32> {
    slices.start / BUCKET_SLICES..slices.end.div_ceil(BUCKET_SLICES)
}

/// The most buckets that the slices `halo` either side of a plane lie in.
pub fn buckets_round(halo: u32) -> u32 {
    (2 * halo).saturating_sub(2) / BUCKET_SLICES + 2
}

/// Number of slabs.
pub fn slab_count(slabs: impl Into<Slabs>, slices: u32) -> u32 {
    slices.div_ceil(slabs.into().slices)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_plane_has_more_buckets_round_it_and_some_has_as_many() {
        for halo in 1..40 {
            let round = |plane: u32| buckets_of(plane - halo..plane + halo).len() as u32;
            let most = (halo..halo + 2 * BUCKET_SLICES).map(round).max();
            assert_eq!(most, Some(buckets_round(halo)), "{halo}");
        }
    }
}
