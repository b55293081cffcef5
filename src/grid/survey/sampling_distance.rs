//! How densely the points lie: the distance between neighbouring samples, in one pass and bounded memory.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::extent::Survey;
use crate::error::Result;
use crate::input::{Carried, Cloud};
use crate::points::Points;
use crate::points::bounds::Bounds;
use crate::resources::workers::Workers;

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
    use crate::grid::survey::extent::survey;
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
