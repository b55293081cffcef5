//! The survey, pass 1: how many points there are and the box they fill; and, where asked for, how densely they lie.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::error::{Error, Result};
use crate::grid::coarse::{CoarseGrid, Sketching};
use crate::grid::{Cell, Grid, Rotation};
use crate::input::{Carried, Cloud};
use crate::points::bounds::Bounds;
use crate::points::{Batch, Coordinate, Points};
use crate::resources::workers::Workers;

/// What the first pass over the points finds.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Survey {
    /// Finite points.
    pub points: u64,
    /// Records left out because a coordinate was NaN or infinite.
    pub dropped: u64,
    /// Points left out because they were not asked for.
    pub filtered: u64,
    /// The box of the points.
    pub bounds: Bounds,
}

impl Survey {
    /// All records that were read.
    pub fn records(&self) -> u64 {
        self.points + self.dropped + self.filtered
    }
}

/// Counts the points, finds their box and sketches their cells. `progress` is told the records of each block.
///
/// # Errors
/// Errors of reading the input; [`Error::NoPoints`]; [`Error::Interrupted`].
pub fn survey(
    cloud: &Cloud,
    workers: &Workers,
    in_flight: usize,
    mut progress: impl FnMut(u64),
) -> Result<(Survey, CoarseGrid)> {
    let mut total = Survey { points: 0, dropped: 0, filtered: 0, bounds: Bounds::EMPTY };
    let sketching = Sketching::default();
    cloud.for_each_batch(
        workers,
        in_flight,
        Carried::Coordinates,
        |batch| {
            let bounds = match &batch.points {
                Points::Single(points) => look(points, &sketching),
                Points::Double(points) => look(points, &sketching),
            };
            let Batch { dropped, filtered, .. } = *batch;
            Ok(Survey { points: batch.points.len() as u64, dropped, filtered, bounds })
        },
        |part| {
            total.points += part.points;
            total.dropped += part.dropped;
            total.filtered += part.filtered;
            total.bounds = total.bounds.union(part.bounds);
            progress(part.records());
            Ok(())
        },
    )?;
    if total.points == 0 {
        return Err(Error::NoPoints { dropped: total.dropped, filtered: total.filtered });
    }
    Ok((total, sketching.finish()))
}

/// The box of points, which are sketched.
fn look<T: Coordinate>(points: &[[T; 3]], sketching: &Sketching) -> Bounds {
    let bounds = bounds_of(points);
    sketching.add(points, bounds);
    bounds
}

fn bounds_of<T: Coordinate>(points: &[[T; 3]]) -> Bounds {
    // Compared in the file's precision: widening keeps the order, and four lanes are faster than two.
    let Some(&first) = points.first() else { return Bounds::EMPTY };
    let (mut min, mut max) = (first, first);
    for point in points {
        for a in 0..3 {
            min[a] = if point[a] < min[a] { point[a] } else { min[a] };
            max[a] = if point[a] > max[a] { point[a] } else { max[a] };
        }
    }
    Bounds { min: min.map(Into::into), max: max.map(Into::into) }
}

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

/// The box of the points in turned coordinates. `progress` is told the records of each block.
///
/// # Errors
/// Errors of reading the input; [`Error::Interrupted`].
pub fn turned_bounds(
    cloud: &Cloud,
    turn: Rotation,
    workers: &Workers,
    in_flight: usize,
    mut progress: impl FnMut(u64),
) -> Result<Bounds> {
    fn turned<T: Coordinate>(points: &[[T; 3]], turn: Rotation) -> Bounds {
        let places = points.iter().map(|p| turn.of(p.map(Into::into)));
        places.map(|p| Bounds { min: p, max: p }).fold(Bounds::EMPTY, Bounds::union)
    }
    let mut total = Bounds::EMPTY;
    cloud.for_each_batch(
        workers,
        in_flight,
        Carried::Coordinates,
        |batch| {
            let bounds = match &batch.points {
                Points::Single(points) => turned(points, turn),
                Points::Double(points) => turned(points, turn),
            };
            Ok((bounds, batch.records()))
        },
        |(part, records)| {
            total = total.union(part);
            progress(records);
            Ok(())
        },
    )?;
    Ok(total)
}

/// Which planes of a grid have points, along its own axes; no planes for axes that are not `asked` for. `progress` is told the records of each block.
///
/// # Errors
/// Errors of reading the input; [`Error::Interrupted`].
pub fn planes_with_points(
    cloud: &Cloud,
    grid: &Grid,
    asked: [bool; 3],
    workers: &Workers,
    in_flight: usize,
    mut progress: impl FnMut(u64),
) -> Result<[Vec<bool>; 3]> {
    let cells = [0, 1, 2].map(|g| if asked[g] { grid.cells()[g] } else { 0 });
    let found = cells.map(|cells| (0..cells).map(|_| AtomicBool::new(false)).collect::<Vec<_>>());
    cloud.for_each_batch(
        workers,
        in_flight,
        Carried::Coordinates,
        |batch| {
            let mark = |cell: Cell| {
                for (planes, plane) in found.iter().zip(cell) {
                    // Nearly all points find their plane marked.
                    if let Some(mark) = planes.get(plane as usize).filter(|mark| !mark.load(Ordering::Relaxed)) {
                        mark.store(true, Ordering::Relaxed);
                    }
                }
            };
            match &batch.points {
                Points::Single(points) => grid.cells_of(points, mark),
                Points::Double(points) => grid.cells_of(points, mark),
            }
            Ok(batch.records())
        },
        |records| {
            progress(records);
            Ok(())
        },
    )?;
    Ok(found.map(|planes| planes.into_iter().map(AtomicBool::into_inner).collect()))
}

/// Cells kept to count distinct ones: the count is good to about 1/√1024, three per cent.
const KEPT: usize = 1024;

/// Counts distinct cells in bounded memory: of all cells seen it keeps those with the smallest hashes; if the largest kept
/// hash is the fraction f of the hash range, there are about KEPT / f cells. Order of arrival does not matter.
///
/// Every point of a cell that is kept to the end was counted: the cell was never left out before.
#[derive(Debug)]
struct Distinct {
    /// The hashes, and how many points each was seen with.
    smallest: BTreeMap<u64, u64>,
    /// Larger hashes are not kept.
    largest: u64,
}

impl Distinct {
    fn new() -> Distinct {
        Distinct { smallest: BTreeMap::new(), largest: u64::MAX }
    }

    fn add(&mut self, hash: u64, points: u64) {
        // Nearly all hashes of small cells are too large, which is soon seen.
        if hash > self.largest {
            return;
        }
        if let Some(count) = self.smallest.get_mut(&hash) {
            *count += points;
        } else {
            self.smallest.insert(hash, points);
            if self.smallest.len() > KEPT {
                self.smallest.pop_last();
            }
            if self.smallest.len() == KEPT {
                self.largest = *self.smallest.last_key_value().expect("the list is full").0;
            }
        }
    }

    fn distinct(&self) -> f64 {
        match self.smallest.last_key_value() {
            Some((&last, _)) if self.smallest.len() == KEPT => (KEPT - 1) as f64 * (u64::MAX as f64 / last as f64),
            _ => self.smallest.len() as f64,
        }
    }

    /// The parts of the cells, and of their points, that are no strays: cells with at least a [`STRAY`] of the points that the middle one of all points shares its
    /// cell with.
    fn without_strays(&self) -> [f64; 2] {
        let mut counts: Vec<u64> = self.smallest.values().copied().collect();
        counts.sort_unstable();
        let all: u64 = counts.iter().sum();
        let mut before = 0;
        let middle = counts.iter().find(|count| {
            before += **count;
            2 * before >= all
        });
        let least = middle.map_or(0, |middle| middle.div_ceil(STRAY));
        let left: Vec<u64> = counts.iter().copied().filter(|count| *count >= least).collect();
        [left.len() as f64 / counts.len().max(1) as f64, left.iter().sum::<u64>() as f64 / all.max(1) as f64]
    }
}

/// A cell with fewer than this part of the usual points holds strays, or lies at the surface's border.
const STRAY: u64 = 20;

/// Cells that points are found in, for each w² of surface, w their side. A plane passes 1.5 on average over its positions, but
/// some of them only by a corner, where hardly a point falls.
const CELLS_OF_SURFACE: f64 = 1.2;
/// Points to a cell, on average, below which cells are small enough to measure the surface: few, so that folds of the surface
/// do not share cells, and enough to tell how many cells of the surface are empty by chance.
const POINTS_TO_A_CELL: f64 = 16.0;
/// Steps in which the share of empty cells is found: to three digits, more than the sketch has.
const STEPS: u32 = 12;
/// The axes of the cells, times three: at right angles to each other and askew to the cloud's, since floors and walls across
/// an axis would pass fewer cells than other surfaces.
const ASKEW: [[f64; 3]; 3] = [[2.0, -1.0, 2.0], [2.0, 2.0, -1.0], [-1.0, 2.0, 2.0]];

/// The mean distance d between neighbouring samples of the cloud's surface, in the input's units: d² = area / points.
///
/// The cells with points in them are counted (by sketch) at sides that halve from the box's diagonal, down to the first
/// side at which there are fewer than 16 points to a cell. If points fall at random, λ to a cell on average, a share of
/// e^−λ gets none: so from the n/λ cells of the surface come its area and d. `None` for a single place.
///
/// On the horse, the dragon, the rocker arm, cube, sphere, torus and lattices (4,000 to 500,000 points at random, half of them
/// thinned to a tenth, or the meshes' own vertices) d comes out at 0.93 to 1.1 of what their area gives. It is too small
/// (0.8) for a plate so thin that both its sides share cells.
///
/// It is a mean over the surface, not a high quantile: where one part is sampled ten times as densely as another, d is that of
/// the denser, up to a third, and a grid laid by it keeps the detail there. The sparser part stays whole because the closing
/// radius grows.
///
/// `progress` is told the records of each block.
///
/// # Errors
/// Errors of reading the input; [`Error::Interrupted`].
pub fn sampling_distance(
    cloud: &Cloud,
    survey: &Survey,
    workers: &Workers,
    in_flight: usize,
    mut progress: impl FnMut(u64),
) -> Result<Option<f64>> {
    match measured(cloud, survey, Levels::Coarse, workers, in_flight, &mut progress)? {
        Measured::Distance(distance) => Ok(distance),
        // So many of the cells hold strays that those of the other levels count.
        Measured::TooCoarse => match measured(cloud, survey, Levels::All, workers, in_flight, &mut progress)? {
            Measured::Distance(distance) => Ok(distance),
            Measured::TooCoarse => Ok(None),
        },
    }
}

/// Levels of cells. Level l has 2^(l + 1) cells along the diagonal.
const LEVELS: usize = 20;
/// Cells for each point beyond which finer ones are left out: at four points to a cell, far below [`POINTS_TO_A_CELL`].
const ENOUGH_CELLS: f64 = 0.25;

/// The levels that are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Levels {
    /// Those with fewer cells than [`ENOUGH_CELLS`], and the next.
    Coarse,
    /// All.
    All,
}

/// What the levels tell.
enum Measured {
    /// The sampling distance; none of a single place.
    Distance(Option<f64>),
    /// None of them has few enough points to a cell.
    TooCoarse,
}

/// [`sampling_distance`], from these levels.
fn measured(
    cloud: &Cloud,
    survey: &Survey,
    which: Levels,
    workers: &Workers,
    in_flight: usize,
    mut progress: impl FnMut(u64),
) -> Result<Measured> {
    let diagonal = survey.bounds.extent().into_iter().fold(0.0, libm::hypot);
    if diagonal <= 0.0 {
        return Ok(Measured::Distance(None));
    }
    let Bounds { min, max } = survey.bounds;
    let centre: [f64; 3] = std::array::from_fn(|a| min[a].midpoint(max[a]));
    // However it is turned, the box lies within half its diagonal of its centre.
    let cells = 2f64.powi(LEVELS as i32);
    let scale = cells * (1.0 - 1e-12) / diagonal;
    let mut sketches: Vec<Distinct> = (0..LEVELS).map(|_| Distinct::new()).collect();
    // Falls as soon as finer levels show to be of no use.
    let looked_at = AtomicUsize::new(LEVELS);
    cloud.for_each_batch(
        workers,
        in_flight,
        Carried::Coordinates,
        |batch| {
            let cell = |p: [f64; 3]| {
                let d: [f64; 3] = std::array::from_fn(|a| (p[a] - centre[a]) * scale / 3.0);
                let along = |axis: [f64; 3]| axis[0] * d[0] + axis[1] * d[1] + axis[2] * d[2];
                interleaved(ASKEW.map(|axis| (along(axis) + cells / 2.0) as u64))
            };
            let mut codes: Vec<u64> = match &batch.points {
                Points::Single(points) => points.iter().map(|p| cell(p.map(f64::from))).collect(),
                Points::Double(points) => points.iter().map(|p| cell(*p)).collect(),
            };
            codes.sort_unstable();
            let levels = looked_at.load(Ordering::Relaxed);
            let mut part: Vec<Distinct> = (0..levels).map(|_| Distinct::new()).collect();
            // Along this curve, the cells within a larger one lie side by side, on every level.
            let mut runs: Vec<([u64; 3], u64)> = Vec::with_capacity(codes.len());
            for code in codes {
                add_to_run(&mut runs, apart(code >> (3 * (LEVELS - levels))), 1);
            }
            for sketch in part.iter_mut().rev() {
                runs.iter().for_each(|&(cell, points)| sketch.add(hash(cell), points));
                let mut coarser = Vec::with_capacity(runs.len());
                runs.iter().for_each(|&(cell, points)| add_to_run(&mut coarser, cell.map(|c| c >> 1), points));
                runs = coarser;
            }
            Ok((part, batch.records()))
        },
        |(part, records)| {
            progress(records);
            for (sketch, part) in sketches.iter_mut().zip(part) {
                part.smallest.into_iter().for_each(|(hash, points)| sketch.add(hash, points));
            }
            let enough = ENOUGH_CELLS * survey.points as f64;
            let levels = looked_at.load(Ordering::Relaxed);
            if which == Levels::Coarse
                && let Some(level) = sketches[..levels].iter().position(|sketch| sketch.distinct() > enough)
            {
                looked_at.store(level + 1, Ordering::Relaxed);
            }
            Ok(())
        },
    )?;
    let levels = looked_at.into_inner();
    let counted = |sketch: &Distinct| {
        let [cells, points] = sketch.without_strays();
        (points * survey.points as f64, cells * sketch.distinct())
    };
    let found = sketches[..levels].iter().map(counted).enumerate().find(|(_, (n, cells))| n / cells < POINTS_TO_A_CELL);
    let (level, (n, cells)) = match found {
        Some(found) => found,
        None if levels < LEVELS => return Ok(Measured::TooCoarse),
        None => (LEVELS - 1, counted(&sketches[LEVELS - 1])),
    };
    let side = diagonal / 2f64.powi(level as i32 + 1);
    Ok(Measured::Distance(Some(side / (CELLS_OF_SURFACE * points_to_a_cell(n / cells)).sqrt())))
}

/// Adds points of a cell to the last run, if that is of the same cell, or begins a new one.
fn add_to_run(runs: &mut Vec<([u64; 3], u64)>, cell: [u64; 3], points: u64) {
    match runs.last_mut() {
        Some((last, count)) if *last == cell => *count += points,
        _ => runs.push((cell, points)),
    }
}

/// The bits of three numbers below 2²¹, in turns: a Morton code.
fn interleaved(cell: [u64; 3]) -> u64 {
    let spread = |mut c: u64| {
        c = (c | c << 32) & 0x001F_0000_0000_FFFF;
        c = (c | c << 16) & 0x001F_0000_FF00_00FF;
        c = (c | c << 8) & 0x100F_00F0_0F00_F00F;
        c = (c | c << 4) & 0x10C3_0C30_C30C_30C3;
        (c | c << 2) & 0x1249_2492_4924_9249
    };
    spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2
}

/// The three numbers of a Morton code.
fn apart(code: u64) -> [u64; 3] {
    [code, code >> 1, code >> 2].map(|mut c| {
        c &= 0x1249_2492_4924_9249;
        c = (c | c >> 2) & 0x10C3_0C30_C30C_30C3;
        c = (c | c >> 4) & 0x100F_00F0_0F00_F00F;
        c = (c | c >> 8) & 0x001F_0000_FF00_00FF;
        c = (c | c >> 16) & 0x001F_0000_0000_FFFF;
        (c | c >> 32) & 0x001F_FFFF
    })
}

/// The mean number λ of points that fall to a cell, if those that got any got `found` on average: found = λ / (1 − e^−λ).
///
/// Every step brings λ nearer by a factor of `found` − λ, which is less than 0.5 where `found` is 2 or more, as it is for
/// all but a handful of points.
fn points_to_a_cell(found: f64) -> f64 {
    let mut points = found;
    for _ in 0..STEPS {
        points = found * (1.0 - libm::exp(-points));
    }
    // A lattice may have one point in each of its cells: no more than half of the cells are taken to have been missed.
    points.max(found / 2.0)
}

fn hash(cell: [u64; 3]) -> u64 {
    let mut h = cell[0] | cell[1] << 21 | cell[2] << 42;
    h = (h ^ h >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ h >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    h ^ h >> 31
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use proptest::prelude::*;

    use super::*;
    use crate::input::{InputOptions, PointSlice};

    /// The sampling distance as its description says, level by level, with all cells held.
    fn naive(points: &[[f64; 3]], bounds: &Bounds) -> Option<f64> {
        let diagonal = bounds.extent().into_iter().fold(0.0, libm::hypot);
        if diagonal <= 0.0 {
            return None;
        }
        let levels: Vec<[f64; 2]> = (0..20)
            .map(|level| {
                let mut counts: HashMap<u64, u64> = HashMap::new();
                for p in points {
                    let d: [f64; 3] = std::array::from_fn(|a| {
                        (p[a] - bounds.min[a].midpoint(bounds.max[a])) * (2f64.powi(20) * (1.0 - 1e-12) / diagonal)
                            / 3.0
                    });
                    let cell = [[2.0, -1.0, 2.0], [2.0, 2.0, -1.0], [-1.0, 2.0, 2.0]].map(|axis: [f64; 3]| {
                        (axis[0] * d[0] + axis[1] * d[1] + axis[2] * d[2] + 2f64.powi(19)) as u64 >> (19 - level)
                    });
                    *counts.entry(hash(cell)).or_default() += 1;
                }
                let mut kept: Vec<(u64, u64)> = counts.into_iter().collect();
                kept.sort_unstable();
                kept.truncate(KEPT);
                let distinct = match kept.last() {
                    Some((last, _)) if kept.len() == KEPT => (KEPT - 1) as f64 * (u64::MAX as f64 / *last as f64),
                    _ => kept.len() as f64,
                };
                let mut sizes: Vec<u64> = kept.iter().map(|(_, count)| *count).collect();
                sizes.sort_unstable();
                let all: u64 = sizes.iter().sum();
                let middle = (0..sizes.len()).find(|i| 2 * sizes[..=*i].iter().sum::<u64>() >= all).unwrap();
                let least = sizes[middle].div_ceil(STRAY);
                let left: Vec<u64> = sizes.iter().copied().filter(|size| *size >= least).collect();
                let share = left.iter().sum::<u64>() as f64 / all as f64;
                [share * points.len() as f64, left.len() as f64 / sizes.len() as f64 * distinct]
            })
            .collect();
        let level = levels.iter().position(|[n, cells]| n / cells < POINTS_TO_A_CELL).unwrap_or(19);
        let [n, cells] = levels[level];
        let side = diagonal / 2f64.powi(level as i32 + 1);
        Some(side / (CELLS_OF_SURFACE * points_to_a_cell(n / cells)).sqrt())
    }

    fn random(count: usize, seed: u64, shape: usize) -> Vec<[f64; 3]> {
        let mut state = seed;
        let mut unit = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..count)
            .map(|i| match shape {
                0 => [unit(), unit(), 0.0],
                1 => [unit(), unit(), unit()],
                // Nearly all on one place, and strays.
                2 if i % 50 > 0 => [0.5; 3],
                2 => [unit() * 1e3, unit(), unit()],
                // A line with piles on it.
                3 => [(unit() * 64.0).floor(), 0.0, 0.0],
                _ => [unit().powi(8), unit().powi(8), unit() * 1e-3],
            })
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn the_sampling_distance_is_that_of_its_description(
            count in prop_oneof![1usize..200, 3000usize..6000, 150_000usize..151_000],
            shape in 0usize..5,
            seed in any::<u64>(),
        ) {
            let points = random(count, seed, shape);
            let arrays = crate::input::Arrays::new(PointSlice::from(&points));
            let cloud = Cloud::of_source(&arrays, &InputOptions::default()).unwrap();
            let workers = Workers::new(2).unwrap();
            let (found, _) = survey(&cloud, &workers, 4, |_| ()).unwrap();
            let mut expected = 0;
            let distance = sampling_distance(&cloud, &found, &workers, 4, |records| expected += records).unwrap();
            prop_assert_eq!(distance.map(f64::to_bits), naive(&points, &found.bounds).map(f64::to_bits));
            prop_assert!(expected % count as u64 == 0);
        }
    }

    #[test]
    fn codes_are_taken_apart_again() {
        for cell in [[0, 0, 0], [1, 2, 3], [(1 << 20) - 1, 0, 1 << 20], [0x15_5555, 0x0A_AAAA, 0x1F_FFFF]] {
            assert_eq!(apart(interleaved(cell)), cell);
            assert_eq!(apart(interleaved(cell) >> 9), cell.map(|c| c >> 3));
        }
    }
}
