//! How many points there are and where: their box, which is pass 1; their box in turned coordinates; and the planes of a grid that they lie on.

use std::sync::atomic::{AtomicBool, Ordering};

use super::density::Density;
use super::levels::{Known, Levels, Sketching as LevelSketching};
use crate::error::{Error, Result};
use crate::grid::coarse::{CoarseGrid, Sketching};
use crate::grid::{Cell, Grid, Rotation};
use crate::input::{Carried, Cloud};
use crate::points::bounds::Bounds;
use crate::points::{Batch, Coordinate, Points};
use crate::resources::workers::Workers;

/// What the first pass over the points finds.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Survey {
    /// Finite points.
    pub points: u64,
    /// Records left out because a coordinate was NaN or infinite.
    pub dropped: u64,
    /// Points left out because they were not asked for.
    pub filtered: u64,
    /// The box of the points.
    pub bounds: Bounds,
    /// The blocks that they came in, and the most records of one.
    #[serde(default)]
    pub blocks: (u64, u64),
}

impl Survey {
    /// All records that were read.
    pub fn records(&self) -> u64 {
        self.points + self.dropped + self.filtered
    }
}

/// What the first pass is to find beside the points' number, their box and their cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Wanted {
    /// Nothing.
    Extent,
    /// How densely they lie.
    Density,
}

impl Wanted {
    /// The most bytes of a block of so many points that is being looked at, beside the block itself.
    pub fn bytes_looking(self, points: u64) -> u64 {
        if self == Wanted::Density { Levels::bytes_finding(points) } else { 0 }
    }

    /// The most bytes of what is found of so many points, which is kept for a block until its turn, and for all blocks to the end.
    pub fn bytes_found(self, points: u64) -> u64 {
        if self == Wanted::Density { Levels::bytes(points) } else { 0 }
    }
}

/// Counts the points, finds their box, sketches their cells and, if that is wanted, finds how densely they lie. `progress` is told the records of each block.
///
/// # Errors
/// Errors of reading the input; [`Error::NoPoints`]; [`Error::Interrupted`].
pub fn survey(
    cloud: &Cloud,
    wanted: Wanted,
    workers: &Workers,
    in_flight: usize,
    mut progress: impl FnMut(u64),
) -> Result<(Survey, CoarseGrid, Option<Density>)> {
    let mut total = Survey { points: 0, dropped: 0, filtered: 0, bounds: Bounds::EMPTY, blocks: (0, 0) };
    let sketching = Sketching::default();
    let records = cloud.sources().iter().map(|source| source.records).sum();
    let (mut levels, known) = (LevelSketching::new(records), Known::default());
    cloud.for_each_batch(
        workers,
        in_flight,
        Carried::Coordinates,
        |batch| {
            let bounds = bounds_of_batch(&batch.points);
            match &batch.points {
                Points::Single(points) => sketching.add(points, bounds),
                Points::Double(points) => sketching.add(points, bounds),
            }
            let levels = match (&batch.points, wanted) {
                (_, Wanted::Extent) => None,
                (Points::Single(points), Wanted::Density) => known.levels_of(points, bounds),
                (Points::Double(points), Wanted::Density) => known.levels_of(points, bounds),
            };
            let Batch { dropped, filtered, .. } = *batch;
            let points = batch.points.len() as u64;
            Ok((Survey { points, dropped, filtered, bounds, blocks: (1, points + dropped + filtered) }, levels))
        },
        |(part, of_part)| {
            total.points += part.points;
            total.dropped += part.dropped;
            total.filtered += part.filtered;
            total.bounds = total.bounds.union(part.bounds);
            total.blocks = (total.blocks.0 + part.blocks.0, total.blocks.1.max(part.blocks.1));
            if let Some(of_part) = of_part {
                levels.add(of_part, &known);
            }
            progress(part.records());
            Ok(())
        },
    )?;
    if total.points == 0 {
        return Err(no_points(cloud, total.dropped, total.filtered));
    }
    let density = (wanted == Wanted::Density).then(|| Density::of(&levels.finish(total.points), total.points));
    Ok((total, sketching.finish(), density))
}

/// Why there are no points: of polygons that lie elsewhere, both places are told.
fn no_points(cloud: &Cloud, dropped: u64, filtered: u64) -> Error {
    let elsewhere = cloud.clip().filter(|_| filtered > 0).and_then(|clip| clip.elsewhere(&whole_box(cloud).ok()?));
    elsewhere.unwrap_or(Error::NoPoints { dropped, filtered })
}

/// The box of all points, whether they count or not.
fn whole_box(cloud: &Cloud) -> Result<Bounds> {
    let (mut blocks, mut batch) = (cloud.all_blocks(), Batch::new(cloud.precision()));
    let mut bounds = Bounds::EMPTY;
    while let Some(block) = blocks.next_block()? {
        block.decode(&mut batch)?;
        bounds = bounds.union(bounds_of_batch(&batch.points));
    }
    Ok(bounds)
}

fn bounds_of_batch(points: &Points) -> Bounds {
    match points {
        Points::Single(points) => bounds_of(points),
        Points::Double(points) => bounds_of(points),
    }
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

/// The box of each file's points that count, in reading order; an empty one if it has none. `progress` is told the records of each block.
///
/// # Errors
/// Errors of reading the input; [`Error::Interrupted`].
pub fn boxes_of_sources(
    cloud: &Cloud,
    workers: &Workers,
    in_flight: usize,
    mut progress: impl FnMut(u64),
) -> Result<Vec<Bounds>> {
    let mut boxes = vec![Bounds::EMPTY; cloud.sources().len()];
    cloud.for_each_batch(
        workers,
        in_flight,
        Carried::Coordinates,
        |batch| Ok((batch.source, bounds_of_batch(&batch.points), batch.records())),
        |(source, bounds, records)| {
            boxes[source] = boxes[source].union(bounds);
            progress(records);
            Ok(())
        },
    )?;
    Ok(boxes)
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
