//! Where the points were seen from, as the places of their scans tell.

use std::collections::BTreeMap;

use crate::error::{Error, Result};
use crate::input::{Carried, Cloud};
use crate::points::Points;
use crate::resources::workers::Workers;

/// Most digits that a unit vector's component keeps, as a factor: so sums of them are exact, and the same for any order of the points.
const UNIT: f64 = (1u64 << 40) as f64;

/// A direction is told in steps of this part of its length.
const DIRECTION_STEPS: f64 = 1e6;

/// At most one in so many of a scan's points may have their scanner behind the sheet's front.
const MOST_BEHIND: u64 = 3;

/// The direction that the points were seen from, on average: of the lines from each point to where its scan was taken from. It has length 1, to six digits.
///
/// A sheet has one front. Every point counts once, so a scan counts by its points, and those of files that do not tell count for nothing. Of each scan, two thirds of
/// the points at least must have been seen from the front: then the sheet's faces near them show their front to that scan's place.
///
/// Two passes over the points; memory for a few numbers for each scan.
///
/// # Errors
/// [`Error::InvalidSetting`] if no file tells where its scans were taken from, or if a scan saw its points from elsewhere; those of reading the input; [`Error::Interrupted`].
pub fn seen_from(cloud: &Cloud, workers: &Workers, in_flight: usize) -> Result<[f64; 3]> {
    if cloud.stations().all(|stations| stations.is_empty()) {
        return Err(Error::setting("facing", 
            "`facing` @poses: no file tells where its scans were taken from, as E57 files with poses do; give a direction, or a position such as @0,0,0".into(),
        ));
    }
    let mut sum = [0i128; 3];
    each_scan(
        cloud,
        workers,
        in_flight,
        |lines| {
            let mut sum = [0i64; 3];
            lines(&mut |line| {
                let length = line.iter().map(|c| c * c).sum::<f64>().sqrt();
                if length > 0.0 && length.is_finite() {
                    (0..3).for_each(|a| sum[a] += (line[a] / length * UNIT).round() as i64);
                }
            });
            sum
        },
        |_, part| (0..3).for_each(|a| sum[a] += i128::from(part[a])),
    )?;
    let length = sum.iter().map(|c| (*c as f64).powi(2)).sum::<f64>().sqrt();
    if length == 0.0 {
        return Err(Error::setting("facing", "`facing` @poses: the points lie all round where they were scanned from, and no side is the front; give a direction".into()));
    }
    let front = sum.map(|c| (c as f64 / length * DIRECTION_STEPS).round() / DIRECTION_STEPS);
    // By place, since files may come in any order.
    let mut scans: BTreeMap<[u64; 3], [u64; 2]> = BTreeMap::new();
    each_scan(
        cloud,
        workers,
        in_flight,
        |lines| {
            let mut counts = [0; 2];
            lines(&mut |line| {
                let behind = (0..3).map(|a| line[a] * front[a]).sum::<f64>() <= 0.0;
                counts[usize::from(behind)] += 1;
            });
            counts
        },
        |station, part: [u64; 2]| {
            let counts = scans.entry(station.map(f64::to_bits)).or_default();
            (0..2).for_each(|i| counts[i] += part[i]);
        },
    )?;
    let astray = scans.iter().find(|(_, [before, behind])| behind * MOST_BEHIND > before + behind);
    match astray {
        Some((station, [before, behind])) => {
            let [x, y, z] = station.map(f64::from_bits);
            let share = 100 * behind / (before + behind);
            let front = front.map(|c| c.to_string()).join(",");
            Err(Error::setting(
                "facing",
                format!(
                    "`facing` @poses: a sheet has one front, here {front}, and {share} % of the points scanned from {x},{y},{z} were seen from behind it; make a sheet of each side, with `facing` or `bounds`, or a closed surface"
                ),
            ))
        }
        None => Ok(front),
    }
}

/// One pass over the points of scans that tell where they were taken from. `work` is given the lines from all points of a block to that place, `sink` the place and what
/// `work` made of them.
fn each_scan<R: Send>(
    cloud: &Cloud,
    workers: &Workers,
    in_flight: usize,
    work: impl Fn(&dyn Fn(&mut dyn FnMut([f64; 3]))) -> R + Sync,
    mut sink: impl FnMut([f64; 3], R),
) -> Result<()> {
    cloud.for_each_batch(
        workers,
        in_flight,
        Carried::Coordinates,
        |batch| {
            Ok(batch.station.map(|station| {
                let line = |p: [f64; 3]| [0, 1, 2].map(|a| station[a] - p[a]);
                let lines = |see: &mut dyn FnMut([f64; 3])| match &batch.points {
                    Points::Single(points) => points.iter().for_each(|p| see(line(p.map(f64::from)))),
                    Points::Double(points) => points.iter().for_each(|p| see(line(*p))),
                };
                (station, work(&lines))
            }))
        },
        |part| {
            part.into_iter().for_each(|(station, made)| sink(station, made));
            Ok(())
        },
    )
}
