//! Seal: closes the occupied cells with a ball of a radius that is given.
//!
//! Below the radius that its holes need, the ball gets into a body, and what is solid is a shell with the exterior on both its sides. From it on, the shell's
//! other side faces enclosed cells, and the ball may fall to smaller ones ([`crate::solid::watershed`]), so that it does not bridge what a smaller
//! one does not. Large balls begin on a coarser level of the pyramid, each level of which halves the resolution.
//!
//! Without a radius, [`crate::solid::sign`] tells the sides apart.

use crate::error::Result;
use crate::grid::context::Context;
use crate::grid::dilate::{Ball, squared};
use crate::grid::occupancy::Occupancy;
use crate::solid::Solid;
use crate::solid::exterior::Exterior;
use crate::solid::watershed::{LAST, LAST_COARSE, Sides};

/// A ball of this many cells is large enough to tell the sides apart on a level: it falls from there, and no level below needs a larger
/// one than twice the cells it ends with. From 3 cells on, the bunny's ball falls from 4 cells of the first coarse level, where its walls are too thick
/// to judge by, and a web stays at its base: 0.047 % of its longest side off the scan, root mean square, instead of 0.022.
const FALLS_FROM: u32 = 5;

/// The ball that tells inside and outside apart, on a level of the pyramid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ClosingBall {
    /// The level: 0 is the grid itself; each level has cells twice as large.
    pub level: u32,
    /// The closing radius, in cells of the level.
    pub radius: u32,
}

impl ClosingBall {
    /// The closing radius ρ in cells of the grid.
    pub fn rho(&self) -> u32 {
        self.radius << self.level
    }

    /// A closing with a given radius, in cells of the grid, on the level that has the smallest ball of 5 cells or more; rounded up to whole cells of
    /// that level.
    pub fn with_radius(rho: u32) -> ClosingBall {
        let level = (rho / FALLS_FROM).max(1).ilog2();
        ClosingBall { level, radius: rho.div_ceil(1 << level) }
    }
}

/// The squared radius that a ball falls to on a level.
pub fn last(level: u32) -> u32 {
    if level > 0 { LAST_COARSE } else { LAST }
}

/// The grid's occupied cells, and the same cells ever coarser.
#[derive(Debug)]
pub struct Pyramid<'a> {
    finest: &'a Occupancy,
    coarser: Vec<Occupancy>,
}

impl<'a> Pyramid<'a> {
    /// The pyramid over `finest`, up to `level`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn over(finest: &'a Occupancy, level: u32, context: &Context) -> Result<Pyramid<'a>> {
        let mut coarser: Vec<Occupancy> = Vec::new();
        while coarser.len() < level as usize {
            coarser.push(coarser.last().unwrap_or(finest).coarser(context)?);
        }
        Ok(Pyramid { finest, coarser })
    }

    /// The occupied cells of a level.
    pub fn level(&self, level: u32) -> &Occupancy {
        if level == 0 { self.finest } else { &self.coarser[level as usize - 1] }
    }

    /// The solid of the grid that the ball of `closing` and its fall ([`crate::solid::watershed`]) leave, without the dents ([`crate::solid::dents`]) that
    /// no points line.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn close(&self, closing: ClosingBall, context: &Context, mut progress: impl FnMut(u32)) -> Result<Solid> {
        let ClosingBall { level, radius } = closing;
        let exterior = Exterior::find(self.level(level), &Ball::new(radius), context)?;
        if closing.rho() == 1 {
            return Solid::outside_of(&exterior, self.finest, &Ball::new(1), context);
        }
        let mut sides = Sides::told_by(&exterior, squared(radius), context)?;
        drop(exterior);
        for level in (0..=level).rev() {
            let occupancy = self.level(level);
            if level < closing.level {
                sides = sides.refined(occupancy, context)?;
            }
            sides = sides.fallen(occupancy, last(level), None, context, &mut progress)?;
        }
        let solid = Solid::between(self.finest, &sides, &Ball::new(1), context)?;
        drop(sides);
        let solid = solid.without_dents(None, self.finest, context)?;
        progress(solid.cells[1]);
        Ok(solid)
    }
}
