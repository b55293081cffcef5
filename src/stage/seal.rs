//! Seal: finds the closing radius ρ, the smallest ball that does not roll into the inside.
//!
//! Below that radius the ball gets inside, and what is solid is a shell with the exterior on both its sides; from it on, the
//! shell's other side faces enclosed cells. So the share of the shell that encloses something
//! ([`Solid::close_measured`]) tells whether a radius seals, on the first try if it does:
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
//! they are cheap. Finer levels only look for the solid's volume: half the occupied cells are the shell's outer half; the rest, the
//! inside, is the same on every level but for the factor of eight (measured: within 8 %).

use crate::context::Context;
use crate::error::Result;
use crate::stage::dilate::Ball;
use crate::stage::raster::Occupancy;
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

/// The outcome of the search.
#[derive(Debug)]
pub struct Sealed {
    /// The closing radius ρ, in cells of the grid.
    pub radius: u32,
    /// The solid closed with it.
    pub solid: Solid,
    /// Whether the cloud was seen to have an inside that this radius seals.
    pub has_inside: bool,
    /// All that was tried, in order.
    pub trials: Vec<Trial>,
}

/// What a level of the pyramid taught the next finer one.
#[derive(Debug, Clone, Copy)]
struct Seen {
    radius: u32,
    /// Solid cells, less the half of the occupied ones that lies outside the surface.
    inside: f64,
}

/// Finds ρ for `occupancy` and closes it. `progress` is told the slices of each trial. The outcome depends on the occupied cells alone.
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::Interrupted`].
pub fn find(occupancy: &Occupancy, context: &Context, mut progress: impl FnMut(u32)) -> Result<Sealed> {
    let mut pyramid = Vec::new();
    while pyramid.last().unwrap_or(occupancy).cells.iter().max() > Some(&COARSEST) {
        pyramid.push(pyramid.last().unwrap_or(occupancy).coarser(context)?);
    }
    let mut trials = Vec::new();
    let mut seen: Option<Seen> = None;
    for level in (1..=pyramid.len()).rev() {
        let occupancy = &pyramid[level - 1];
        let mut attempt =
            Level { occupancy, level: level as u32, context, trials: &mut trials, progress: &mut progress };
        seen = match seen {
            Some(seen) => attempt.refine(seen, 0)?.map(|(seen, _)| seen),
            None => attempt.first_enclosing(0, level == pyramid.len())?,
        };
    }
    let mut attempt = Level { occupancy, level: 0, context, trials: &mut trials, progress: &mut progress };
    let found = match seen {
        Some(seen) => attempt.refine(seen, 1)?,
        None => match attempt.first_enclosing(1, pyramid.is_empty())? {
            Some(seen) => Some((seen, attempt.close(seen.radius)?)),
            None => None,
        },
    };
    Ok(match found {
        Some((seen, solid)) => Sealed { radius: seen.radius, solid, has_inside: true, trials },
        None => {
            Sealed { radius: 1, solid: Solid::close(occupancy, &Ball::new(1), context)?, has_inside: false, trials }
        }
    })
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
    fn close(&mut self, radius: u32) -> Result<Solid> {
        let solid = Solid::close(self.occupancy, &Ball::new(radius), self.context)?;
        (self.progress)(self.occupancy.cells[1]);
        self.trials.push(Trial { level: self.level, radius, volume: solid.volume, encloses: None });
        Ok(solid)
    }

    /// The solid without the outer half of the shell.
    fn inside(&self, volume: u64) -> f64 {
        volume as f64 - 0.5 * self.occupancy.occupied as f64
    }

    /// Tries radii upwards from `least` and takes the first that gives nearly the inside of the one whose shell encloses the largest share.
    ///
    /// The first level tries all radii up to the largest; a finer one, where the coarser found no inside, only small ones: a hole that needs
    /// more would have needed a ball of two or more on the coarser level, which tried that.
    fn first_enclosing(&mut self, least: u32, first_level: bool) -> Result<Option<Seen>> {
        let longest = f64::from(self.occupancy.cells.into_iter().max().unwrap_or(1));
        let most = if first_level { ((longest * LARGEST).ceil() as u32).max(3) } else { 3 };
        let mut tried = Vec::new();
        for radius in least..=most {
            let (solid, encloses) = Solid::close_measured(self.occupancy, &Ball::new(radius), self.context)?;
            (self.progress)(self.occupancy.cells[1]);
            let volume = solid.volume;
            self.trials.push(Trial { level: self.level, radius, volume, encloses: Some(encloses) });
            tried.push((encloses, Seen { radius, inside: self.inside(volume) }));
        }
        let jump = |pair: &[(f64, Seen)]| (pair[1].1.inside >= JUMP * pair[0].1.inside).then_some(pair[1].1);
        let largest = tried.iter().copied().reduce(|best, next| if next.0 > best.0 { next } else { best });
        Ok(match largest {
            Some((encloses, most)) if encloses >= ENCLOSES => {
                tried.into_iter().map(|(_, seen)| seen).find(|seen| seen.inside >= NEARLY * most.inside)
            }
            // On the grid itself no finer level would confirm a jump.
            _ if self.level == 0 => None,
            _ => tried.windows(2).rev().find_map(jump),
        })
    }

    /// Finds the smallest radius near twice the coarser level's that gives about the volume to be expected.
    ///
    /// A coarse ball of radius r covers the fine one of radius 2 r - 2, so a smaller one than 2 r - 3 cannot seal.
    fn refine(&mut self, coarse: Seen, least: u32) -> Result<Option<(Seen, Solid)>> {
        let expected = 8.0 * coarse.inside + 0.5 * self.occupancy.occupied as f64;
        let lowest = (2 * coarse.radius).saturating_sub(3).max(least);
        let highest = 2 * coarse.radius + 4;
        let sealed = |solid: &Solid| solid.volume as f64 >= CONFIRMED * expected;

        let middle = (2 * coarse.radius).max(least);
        let mut radius = middle;
        let mut solid = self.close(radius)?;
        while !sealed(&solid) {
            if radius == highest {
                return Ok(None);
            }
            radius += 1;
            solid = self.close(radius)?;
        }
        // Going up, the radius below was tried; starting sealed, smaller ones may do.
        while radius <= middle && radius > lowest {
            let smaller = self.close(radius - 1)?;
            if !sealed(&smaller) {
                break;
            }
            (radius, solid) = (radius - 1, smaller);
        }
        Ok(Some((Seen { radius, inside: self.inside(solid.volume) }, solid)))
    }
}
