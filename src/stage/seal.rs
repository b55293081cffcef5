//! Seal: finds the closing radius ρ, the smallest ball that does not roll into the inside.
//!
//! Below that radius the ball gets inside, and what is solid is a shell with the exterior on both its sides; from it on, the
//! shell's other side faces enclosed cells. So the share of the shell that encloses something
//! ([`Solid::measure`]) tells whether a radius seals, on the first try if it does:
//!
//! ```text
//!   share for radius, on the coarsest level of  0     1     2     3     4     5     6
//!   the armadillo's points, dense              .84   .77   .78   .72   .69   .66   .60
//!   the bunny, holes in its base               .00   .00   .01   .72   .72   .71   .69
//!   the dragon's raw scans, parts missing      .00   .01   .01   .06   .18   .14   .09
//! ```
//!
//! Where the ball that a hole needs is about as thick as the body, no radius leaves anything enclosed (last row). There the volume tells: it
//! jumps (in occupied cells 1.6, 2.1, 2.6 at radius 3, 4, 5) and then hardly grows (2.7, 2.7). The last jump counts, if the next finer level
//! confirms it.
//!
//! The search runs on a pyramid of the occupied cells, coarse to fine: each level halves the resolution, so that all radii are tried where
//! they are cheap, and ends as soon as a ball of some cells seals a level. Finer levels only look for the solid's volume: half the occupied cells are the shell's outer half; the rest, the
//! inside, is the same on every level but for the factor of eight (measured: within 8 %).

use crate::context::Context;
use crate::error::Result;
use crate::stage::dilate::{Ball, squared};
use crate::stage::exterior::Exterior;
use crate::stage::raster::Occupancy;
use crate::stage::sides::{LAST, LAST_COARSE, Sides};
use crate::stage::solid::Solid;

/// The coarsest level is the first with no more cells than this along any axis. With half of that, the several jumps of a scan that lacks parts
/// blur.
const COARSEST: u32 = 128;

/// Where the largest share of the shell that encloses something stays below this, there is no inside: an open surface has
/// some small cavities, no more.
const ENCLOSES: f64 = 0.25;

/// Without such a share, a radius that multiplies the inside by this is a jump. A ball that widens on a sealed cloud shows 1.0 to 1.1,
/// closing the last of several holes 1.3 and more.
const JUMP: f64 = 1.25;

/// The smallest radius with this part of the inside that the radius with the largest share gives is taken: larger ones only
/// thicken the shell.
const NEARLY: f64 = 0.9;

/// A finer level is sealed from this share of the volume that the coarser one lets expect.
const CONFIRMED: f64 = 0.8;

/// The largest radius tried on the coarsest level, as a share of the longest side. Scans without a base need 0.06.
const LARGEST: f64 = 0.08;

/// A ball of this many cells is large enough to tell the sides apart on a level: it falls from there, and no level below needs a larger
/// one than twice the cells it ends with. From 3 cells on, the bunny's ball falls from 4 cells of the first coarse level, where its walls are too thick
/// to judge by, and a web stays at its base: 0.047 % of its longest side off the scan, root mean square, instead of 0.022.
const FALLS_FROM: u32 = 5;

/// What was tried: a radius at a level, and what it gave.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Trial {
    /// 0 is the grid itself; each level has cells twice as large.
    pub level: u32,
    /// The radius, in cells of the level.
    pub radius: u32,
    /// Solid cells of the level.
    pub volume: u64,
    /// The share of the shell that encloses something, where it was measured.
    pub encloses: Option<f64>,
}

/// The ball that tells inside and outside apart, on a level of the pyramid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Closing {
    /// The level: 0 is the grid itself; each level has cells twice as large.
    pub level: u32,
    /// The closing radius, in cells of the level.
    pub radius: u32,
}

impl Closing {
    /// The closing radius ρ in cells of the grid.
    pub fn rho(&self) -> u32 {
        self.radius << self.level
    }

    /// A closing with a given radius, in cells of the grid, on the level that has the smallest ball of 5 cells or more; rounded up to whole cells of
    /// that level.
    pub fn with_radius(rho: u32) -> Closing {
        let level = (rho / FALLS_FROM).max(1).ilog2();
        Closing { level, radius: rho.div_ceil(1 << level) }
    }
}

/// The outcome of the search.
#[derive(Debug)]
pub struct Sealed {
    /// The smallest ball that seals, or none if the cloud has no inside at any radius.
    pub closing: Option<Closing>,
    /// The exterior that this ball finds, if the last trials left it.
    pub exterior: Option<Exterior>,
    /// All that was tried, in order.
    pub trials: Vec<Trial>,
}

/// The grid's occupied cells, and the same cells ever coarser.
#[derive(Debug)]
pub struct Pyramid<'a> {
    finest: &'a Occupancy,
    coarser: Vec<Occupancy>,
}

impl<'a> Pyramid<'a> {
    /// The pyramid over `finest`, up to the first level with no more than 128 cells along any axis, or to `level`, if that is coarser.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn over(finest: &'a Occupancy, level: u32, context: &Context) -> Result<Pyramid<'a>> {
        let mut coarser: Vec<Occupancy> = Vec::new();
        while coarser.last().unwrap_or(finest).cells.iter().max() > Some(&COARSEST) || coarser.len() < level as usize {
            coarser.push(coarser.last().unwrap_or(finest).coarser(context)?);
        }
        Ok(Pyramid { finest, coarser })
    }

    /// The occupied cells of a level.
    pub fn level(&self, level: u32) -> &Occupancy {
        if level == 0 { self.finest } else { &self.coarser[level as usize - 1] }
    }

    fn coarsest(&self) -> u32 {
        self.coarser.len() as u32
    }

    /// The solid of the grid that the ball of `closing` and its fall ([`crate::stage::sides`]) leave, without the hollows ([`crate::stage::hollow`]) that
    /// no points line; `exterior` is what that ball finds, if it is there already.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn close(
        &self,
        closing: Closing,
        exterior: Option<Exterior>,
        context: &Context,
        mut progress: impl FnMut(u32),
    ) -> Result<Solid> {
        let Closing { level, radius } = closing;
        let exterior = match exterior {
            Some(exterior) => exterior,
            None => Exterior::find(self.level(level), &Ball::new(radius), context)?,
        };
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
            let last = if level > 0 { LAST_COARSE } else { LAST };
            sides = sides.fallen(occupancy, last, context, &mut progress)?;
        }
        let solid = Solid::between(self.finest, &sides, &Ball::new(1), context)?;
        drop(sides);
        let solid = solid.without_hollows(self.finest, context)?;
        progress(solid.cells[1]);
        Ok(solid)
    }
}

/// What a level of the pyramid taught the next finer one.
#[derive(Debug, Clone, Copy)]
struct Seen {
    radius: u32,
    /// Whether more than a jump of the volume speaks for it.
    confirmed: bool,
    /// Solid cells, less the half of the occupied ones that lies outside the surface.
    inside: f64,
}

/// What was found on a level, and the exterior, if it is still there.
type Found = Option<(Seen, Option<Exterior>)>;

/// Finds the ball that seals. `progress` is told the slices of each trial. The outcome depends on the occupied cells alone.
///
/// The search goes down the pyramid until a ball of 5 cells or more seals a level, or to the grid itself.
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::Interrupted`].
pub fn find(pyramid: &Pyramid<'_>, context: &Context, mut progress: impl FnMut(u32)) -> Result<Sealed> {
    let mut trials = Vec::new();
    let mut seen: Option<Seen> = None;
    for level in (0..=pyramid.coarsest()).rev() {
        let least = u32::from(level == 0);
        let occupancy = pyramid.level(level);
        let mut attempt = Level { occupancy, level, context, trials: &mut trials, progress: &mut progress };
        let found = match seen {
            Some(seen) => attempt.refine(seen, least)?,
            None => attempt.first_enclosing(least, level == pyramid.coarsest())?,
        };
        let exterior;
        (seen, exterior) = found.unzip();
        if let Some(Seen { radius, confirmed, .. }) = seen
            && (confirmed && radius >= FALLS_FROM || level == 0)
        {
            let exterior = exterior.flatten();
            return Ok(Sealed { closing: Some(Closing { level, radius }), exterior, trials });
        }
    }
    Ok(Sealed { closing: None, exterior: None, trials })
}

/// One level of the pyramid under trial.
struct Level<'a> {
    occupancy: &'a Occupancy,
    level: u32,
    context: &'a Context,
    trials: &'a mut Vec<Trial>,
    progress: &'a mut dyn FnMut(u32),
}

impl Level<'_> {
    fn close(&mut self, radius: u32) -> Result<(Exterior, u64)> {
        let ball = Ball::new(radius);
        let exterior = Exterior::find(self.occupancy, &ball, self.context)?;
        let volume = Solid::volume_outside_of(&exterior, self.occupancy, &ball, self.context)?;
        (self.progress)(self.occupancy.cells[1]);
        self.trials.push(Trial { level: self.level, radius, volume, encloses: None });
        Ok((exterior, volume))
    }

    /// The solid without the outer half of the shell.
    fn inside(&self, volume: u64) -> f64 {
        volume as f64 - 0.5 * self.occupancy.occupied as f64
    }

    /// Tries radii upwards from `least` and takes the first that gives nearly the inside of the one whose shell encloses the largest share.
    ///
    /// The first level tries all radii up to the largest; a finer one, where the coarser found no inside, only small ones: a hole that needs
    /// more would have needed a ball of two or more on the coarser level, which tried that.
    fn first_enclosing(&mut self, least: u32, first_level: bool) -> Result<Found> {
        let longest = f64::from(self.occupancy.cells.into_iter().max().unwrap_or(1));
        let most = if first_level { ((longest * LARGEST).ceil() as u32).max(3) } else { 3 };
        let mut tried = Vec::new();
        for radius in least..=most {
            let (volume, encloses) = Solid::measure(self.occupancy, &Ball::new(radius), self.context)?;
            (self.progress)(self.occupancy.cells[1]);
            self.trials.push(Trial { level: self.level, radius, volume, encloses: Some(encloses) });
            tried.push((encloses, Seen { radius, confirmed: encloses >= ENCLOSES, inside: self.inside(volume) }));
        }
        let jump = |pair: &[(f64, Seen)]| (pair[1].1.inside >= JUMP * pair[0].1.inside).then_some(pair[1].1);
        let largest = tried.iter().copied().reduce(|best, next| if next.0 > best.0 { next } else { best });
        let found = match largest {
            Some((encloses, most)) if encloses >= ENCLOSES => tried
                .into_iter()
                .map(|(_, seen)| Seen { confirmed: true, ..seen })
                .find(|seen| seen.inside >= NEARLY * most.inside),
            // On the grid itself no finer level would confirm a jump.
            _ if self.level == 0 => None,
            _ => tried.windows(2).rev().find_map(jump),
        };
        Ok(found.map(|seen| (seen, None)))
    }

    /// Finds the smallest radius near twice the coarser level's that gives about the volume to be expected.
    ///
    /// A coarse ball of radius r covers the fine one of radius 2 r - 2, so a smaller one than 2 r - 3 cannot seal.
    fn refine(&mut self, coarse: Seen, least: u32) -> Result<Found> {
        let expected = 8.0 * coarse.inside + 0.5 * self.occupancy.occupied as f64;
        let lowest = (2 * coarse.radius).saturating_sub(3).max(least);
        let highest = 2 * coarse.radius + 4;
        let seals = |volume: u64| volume as f64 >= CONFIRMED * expected;

        let middle = (2 * coarse.radius).max(least);
        let mut radius = middle;
        let (mut exterior, mut volume) = self.close(radius)?;
        while !seals(volume) {
            if radius == highest {
                return Ok(None);
            }
            radius += 1;
            (exterior, volume) = self.close(radius)?;
        }
        // Going up, the radius below was tried; starting sealed, smaller ones may do.
        while radius <= middle && radius > lowest {
            let smaller = self.close(radius - 1)?;
            if !seals(smaller.1) {
                break;
            }
            (radius, (exterior, volume)) = (radius - 1, smaller);
        }
        Ok(Some((Seen { radius, confirmed: true, inside: self.inside(volume) }, Some(exterior))))
    }
}
