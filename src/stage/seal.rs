//! Seal: finds the closing radius ρ, the smallest ball that does not roll into the inside.
//!
//! The solid's volume V against the radius jumps: below the jump the ball gets inside and only the shell of the points is solid, from it on
//! the inside is solid too, and V hardly grows any more (by some per cent a step). Where a scan has several holes there are several
//! jumps; the last one counts. In occupied cells, at the finest level:
//!
//! ```text
//!   radius           1     3     5     7     9    11    13    14    15    17    19    21
//!   bunny, scans   1.13  1.15  1.28  1.47  1.77  2.20  2.40 18.82 18.87 18.96 19.05 19.14
//!   dragon, scans  1.07  1.20  1.48  1.87  2.32  2.83  3.43  3.69  4.15  5.97  9.70  9.97
//! ```
//!
//! The search runs on a pyramid of the occupied cells, coarse to fine: each level halves the resolution, so that all radii are tried where
//! they are cheap. Of the volume, half the occupied cells are the shell's outer half; the rest, the inside, is the same on every level but for
//! the factor of eight: so a level tells the next finer one what volume to look for (measured: within 8 %).

use crate::error::Result;
use crate::stage::Context;
use crate::stage::dilate::Ball;
use crate::stage::raster::Occupancy;
use crate::stage::solid::Solid;

/// The coarsest level is the first with no more cells than this along any axis. With half of that, the several jumps of a scan that lacks parts
/// blur.
const COARSEST: u32 = 128;

/// A radius that multiplies the inside by this is a jump. Holes that are the object's own (the rocker arm's) showed 1.2, a ball that widens
/// on a sealed cloud shows 1.0 to 1.1; closing the last of several holes 1.3 and more.
const JUMP: f64 = 1.25;

/// A finer level is sealed from this share of the volume that the coarser one lets expect.
const CONFIRMED: f64 = 0.8;

/// The largest radius tried on the coarsest level, as a share of the longest side. Scans without a base need 0.06.
const LARGEST: f64 = 0.08;

/// What was tried: a radius at a level and the volume it gave.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Trial {
    /// 0 is the grid itself; each level has cells twice as large.
    pub level: u32,
    /// The radius, in cells of the level.
    pub radius: u32,
    /// Solid cells of the level.
    pub volume: u64,
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
            None => attempt.last_jump(0, level == pyramid.len())?.map(|(seen, _)| seen),
        };
    }
    let mut attempt = Level { occupancy, level: 0, context, trials: &mut trials, progress: &mut progress };
    let found = match seen {
        Some(seen) => attempt.refine(seen, 1)?,
        None => attempt.last_jump(1, pyramid.is_empty())?,
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
        self.trials.push(Trial { level: self.level, radius, volume: solid.volume });
        Ok(solid)
    }

    /// The solid without the outer half of the shell.
    fn inside(&self, volume: u64) -> f64 {
        volume as f64 - 0.5 * self.occupancy.occupied as f64
    }

    /// Tries radii upwards from `least` and takes the last at which the inside jumps, if there is one.
    ///
    /// The first level tries all radii up to the largest; a finer one, where the coarser found no inside, only small ones: a hole that needs
    /// more would have needed a ball of two or more on the coarser level, which tried that.
    fn last_jump(&mut self, least: u32, first_level: bool) -> Result<Option<(Seen, Solid)>> {
        let longest = f64::from(self.occupancy.cells.into_iter().max().unwrap_or(1));
        let most = if first_level { ((longest * LARGEST).ceil() as u32).max(3) } else { 3 };
        let mut before = self.inside(self.occupancy.occupied);
        let mut last = None;
        for radius in least..=most {
            let solid = self.close(radius)?;
            let inside = self.inside(solid.volume);
            if inside >= JUMP * before {
                last = Some((Seen { radius, inside }, solid));
            }
            before = inside;
        }
        Ok(last)
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
