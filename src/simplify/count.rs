//! The least tolerance that leaves no more triangles than are wanted.

use super::collapse::Limits;
use super::mark::Mark;
use super::passes::{Passes, Triangles};
use super::soup::Soup;
use crate::error::Result;
use crate::points::Coordinate;

/// A mesh of so much less than the most triangles is good enough.
const NEAR: f64 = 0.98;
/// Two limits whose ratio is less are one.
const ALIKE: f64 = 1.01;
/// Trials, at most.
const MOST: usize = 24;

/// The limit that is looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Knob {
    /// The tolerance.
    Tolerance,
    /// What a collapse costs, within a given tolerance.
    Cost,
}

/// Looks for the least limit that leaves at most `most` triangles. Where a limit leaves more, the next trial goes on from there; so the longest trial is the
/// first. Beyond `farthest`, a limit changes nothing any more: what is left then is as few as there can be.
pub(super) fn fewest<T: Coordinate, M: Mark>(
    passes: &Passes,
    mesh: Triangles<T, M>,
    limits: Limits,
    (knob, start, farthest): (Knob, f64, f64),
    most: u64,
    progress: &mut dyn FnMut(f64),
) -> Result<Soup<T, M>> {
    let with = |limit: f64, tried: f64| match knob {
        Knob::Tolerance => Limits { tolerance: limit, tried, ..limits },
        Knob::Cost => Limits { cost: limit, ..limits },
    };
    // What is left with the greatest limit that leaves too many, and with the least that does not.
    let mut many: Option<Soup<T, M>> = None;
    let mut few: Option<Soup<T, M>> = None;
    let (mut low, mut high) = (0.0, f64::INFINITY);
    let mut limit = start.min(farthest);
    for trial in 0..MOST {
        let before = many.as_ref().map_or(mesh, Triangles::Soup);
        let begun = trial as f64 / (trial as f64 + 1.0);
        let told = &mut |part: f64| progress(begun + part * (1.0 - begun) / 2.0);
        let left = passes.simplified(&before, with(limit, low), told)?;
        let share = left.count() as f64 / most as f64;
        if left.count() > most {
            if limit >= farthest {
                return Ok(left);
            }
            (low, many) = (limit, Some(left));
        } else {
            (high, few) = (limit, Some(left));
            if share > NEAR || high / low < ALIKE {
                break;
            }
        }
        limit = next(limit, share, low, high).min(farthest);
    }
    match few {
        Some(few) => Ok(few),
        None => passes.simplified(&many.as_ref().map_or(mesh, Triangles::Soup), with(farthest, low), progress),
    }
}

/// The next limit to try, between the two ends: half of a tolerance more leaves about a fifth of the triangles fewer.
fn next(limit: f64, share: f64, low: f64, high: f64) -> f64 {
    let guess = limit * libm::pow((share / (0.5 + 0.5 * NEAR)).clamp(0.1, 10.0), 1.5);
    if high.is_infinite() {
        return guess.max(1.2 * limit);
    }
    if low == 0.0 {
        return guess.min(0.8 * limit);
    }
    let middle = libm::sqrt(low * high);
    // Well within the ends, so that they come nearer every time.
    let (from, to) = (libm::sqrt(low * middle), libm::sqrt(middle * high));
    if guess >= from && guess <= to { guess } else { middle }
}
