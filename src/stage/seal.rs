//! Seal: finds the closing radius ρ, the smallest ball that does not roll into the inside.
//!
//! The solid's volume against the radius jumps at one value: below it the ball gets inside and only the shell of the points is solid,
//! from it on the inside is solid too. Design experiments saw 0.14-0.27 of the true volume below the jump and 1.05-1.12 above.
//! The search runs on a pyramid of the occupied cells, coarse to fine: each level halves the resolution, so that large
//! radii are tried where they are cheap, and a finer level only has to confirm or refine what the coarser one found.

use crate::error::Result;
use crate::stage::Context;
use crate::stage::dilate::Ball;
use crate::stage::raster::Occupancy;
use crate::stage::solid::Solid;

/// The coarsest level is the first with no more cells than this along any axis.
const COARSEST: u32 = 64;

/// A tried radius counts as sealing if it multiplies the volume at least by this. Leaks show jumps of 4 to 8 on scans; widening the ball on a
/// sealed cloud changes the volume by some per cent.
const JUMP: f64 = 1.5;

/// The largest radius tried on the coarsest level, as a share of the longest side. The bunny, with the holes in its base, needs 0.06.
const LARGEST: f64 = 0.1;

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
    volume: u64,
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
            None => attempt.largest_jump(0, level == pyramid.len())?.map(|(seen, _)| seen),
        };
    }
    let mut attempt = Level { occupancy, level: 0, context, trials: &mut trials, progress: &mut progress };
    let found = match seen {
        Some(seen) => attempt.refine(seen, 1)?,
        None => attempt.largest_jump(1, pyramid.is_empty())?,
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

    /// Tries radii upwards from `least` and takes the one with the largest jump of volume, if that is a jump at all.
    ///
    /// The first level tries all radii up to the largest; a finer one, where the coarser found no inside, only small ones: a hole that needs
    /// more would have needed a ball of two or more on the coarser level, which tried that.
    fn largest_jump(&mut self, least: u32, first_level: bool) -> Result<Option<(Seen, Solid)>> {
        let longest = f64::from(self.occupancy.cells.into_iter().max().unwrap_or(1));
        let last = if first_level { ((longest * LARGEST).ceil() as u32).max(3) } else { 3 };
        let mut volume_before = self.occupancy.occupied;
        let mut best: Option<(f64, Seen, Solid)> = None;
        for radius in least..=last {
            let solid = self.close(radius)?;
            let jump = solid.volume as f64 / volume_before as f64;
            volume_before = solid.volume;
            if jump >= JUMP && best.as_ref().is_none_or(|(most, ..)| jump > *most) {
                best = Some((jump, Seen { radius, volume: solid.volume }, solid));
            }
        }
        Ok(best.map(|(_, seen, solid)| (seen, solid)))
    }

    /// Tries radii upwards until the volume is nearer (by ratio) to what the coarser level saw than to the bare shell of occupied cells.
    ///
    /// A coarse ball of radius r covers the fine one of radius 2 r - 2; smaller ones cannot seal and are not tried.
    fn refine(&mut self, coarse: Seen, least: u32) -> Result<Option<(Seen, Solid)>> {
        let expected = coarse.volume as f64 * 8.0;
        let enough = (self.occupancy.occupied as f64 * expected).sqrt();
        let first = (2 * coarse.radius).saturating_sub(3).max(least);
        for radius in first..=2 * coarse.radius + 4 {
            let solid = self.close(radius)?;
            if solid.volume as f64 >= enough {
                return Ok(Some((Seen { radius, volume: solid.volume }, solid)));
            }
        }
        Ok(None)
    }
}
