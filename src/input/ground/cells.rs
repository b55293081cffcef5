//! What the points of every cell say of its height, and how many points there are of each class: a pass over the input, or as many as memory asks for.

use std::collections::{BTreeMap, BTreeSet};

use bytesize::ByteSize;

use super::tiles::{Place, TILE, Tiles, cell_of, place_of};
use super::window::SHARE;
use crate::error::{Error, Result};
use crate::input::{Carried, Cloud};
use crate::points::scalar::{Endian, reader};
use crate::points::{Batch, Points};
use crate::resources::workers::{Spares, Workers};
use crate::storage::spool::Workspace;

/// What is kept of the heights of a cell's points while there may be more. None of it depends on the order of points.
pub trait Gathered: Copy + Send + 'static {
    /// Nothing yet.
    const NONE: Self;
    /// With another point.
    fn with(self, height: f64) -> Self;
    /// The cell's height; NaN if there was no point.
    fn height(self) -> f32;
}

/// The lowest.
#[derive(Debug, Clone, Copy)]
pub struct Lowest(f32);

impl Gathered for Lowest {
    const NONE: Lowest = Lowest(f32::NAN);

    fn with(self, height: f64) -> Lowest {
        // A comparison with NaN is false; the two zeros are one.
        if self.0 <= height as f32 { self } else { Lowest(height as f32 + 0.0) }
    }

    fn height(self) -> f32 {
        self.0
    }
}

/// The highest.
#[derive(Debug, Clone, Copy)]
pub struct Highest(f32);

impl Gathered for Highest {
    const NONE: Highest = Highest(f32::NAN);

    fn with(self, height: f64) -> Highest {
        if self.0 >= height as f32 { self } else { Highest(height as f32 + 0.0) }
    }

    fn height(self) -> f32 {
        self.0
    }
}

/// The mean, of heights in steps: sums of whole numbers are the same in any order.
#[derive(Debug, Clone, Copy)]
pub struct Mean {
    sum: i64,
    count: i64,
}

/// Steps of a unit of length.
const STEPS: f64 = 65536.0;

impl Gathered for Mean {
    const NONE: Mean = Mean { sum: 0, count: 0 };

    fn with(self, height: f64) -> Mean {
        Mean { sum: self.sum.saturating_add((height * STEPS).round() as i64), count: self.count + 1 }
    }

    fn height(self) -> f32 {
        if self.count == 0 { f32::NAN } else { (self.sum as f64 / self.count as f64 / STEPS) as f32 }
    }
}

/// What the passes find.
#[derive(Debug)]
pub struct Cells {
    /// The heights of cells.
    pub heights: Tiles,
    /// Points by class.
    pub classes: [u64; 256],
    /// Points.
    pub points: u64,
}

/// The most passes over the input. A budget so small, or points so far apart, that more were needed are refused.
const MOST_PASSES: u64 = 64;

/// The attribute that tells a point's class.
const CLASS: &str = "classification";

/// Gathers the points of each cell of side `side`. `memory` is what the tiles that are being filled may take; where they do not fit, the ones that
/// come first are filled in a first pass, and so on. `progress` is told the records of each block of the first pass.
///
/// # Errors
/// Errors of reading the input; [`Error::Budget`] if that would take more than 64 passes; [`Error::Io`]; [`Error::Interrupted`].
pub fn gather<G: Gathered>(
    cloud: &Cloud,
    side: f64,
    memory: u64,
    workers: &Workers,
    workspace: &Workspace,
    mut progress: impl FnMut(u64),
) -> Result<Cells> {
    let bytes = (TILE * TILE * size_of::<G>()) as u64;
    let most = (memory / bytes).max(1);
    let mut found = Cells { heights: Tiles::new(workspace, 0), classes: [0; 256], points: 0 };
    let mut seen: BTreeSet<Place> = BTreeSet::new();
    let class = cloud.schema_of(&[CLASS]);
    let class =
        class.column(CLASS).map(|column| (column.offset, class.stride(), reader(column.scalar, Endian::NATIVE)));
    let (mut from, mut first) = (None, true);
    // Handed back to the workers: what one thread takes and another gives back, the allocator keeps for long.
    let spares = Spares::<Vec<(Place, u32, f64)>>::default();
    loop {
        let mut pass = Pass::<G> { from, until: None, most: most as usize, tiles: BTreeMap::new() };
        let work = |batch: &Batch| {
            let mut classes = [0u64; 256];
            if let Some((at, stride, read)) = &class {
                for record in batch.attributes.chunks_exact(*stride) {
                    let value = read(&record[*at..]);
                    if (0.0..256.0).contains(&value) {
                        classes[value as usize] += 1;
                    }
                }
            }
            let mut cells = spares.take().unwrap_or_default();
            match &batch.points {
                Points::Single(points) => cells_of(points.iter().map(|p| p.map(f64::from)), side, &mut cells),
                Points::Double(points) => cells_of(points.iter().copied(), side, &mut cells),
            }
            Ok((cells, classes, batch.records()))
        };
        cloud.for_each_batch(
            workers,
            2 * workers.threads(),
            Carried::Only(&[CLASS]),
            work,
            |(cells, classes, records)| {
                if first {
                    progress(records);
                    found.points += cells.len() as u64;
                    found.classes.iter_mut().zip(&classes).for_each(|(sum, count)| *sum += count);
                    let mut last = None;
                    for (place, ..) in &cells {
                        if last != Some(*place) {
                            seen.insert(*place);
                            last = Some(*place);
                        }
                    }
                    let passes = (seen.len() as u64).div_ceil(most);
                    if passes > MOST_PASSES {
                        let tiles = (seen.len() as u64).div_ceil(MOST_PASSES);
                        return Err(Error::Budget {
                            given: ByteSize(memory * SHARE),
                            needed: ByteSize(tiles * bytes * SHARE),
                            what: "a raster of points that lie so far apart",
                        });
                    }
                }
                pass.add(&cells);
                spares.give(cells);
                Ok(())
            },
        )?;
        first = false;
        for (place, cells) in &pass.tiles {
            let heights: Vec<f32> = cells.iter().map(|cell| cell.height()).collect();
            found.heights.append(*place, &heights)?;
        }
        match pass.until {
            None => return Ok(found),
            until => from = until,
        }
    }
}

/// For each point, the tile it lies in, the number of its cell in that, and its height.
fn cells_of(points: impl ExactSizeIterator<Item = [f64; 3]>, side: f64, out: &mut Vec<(Place, u32, f64)>) {
    let cell = |point: [f64; 3]| {
        let (place, number) = place_of(cell_of(point, side));
        (place, number as u32, point[2])
    };
    out.clear();
    out.reserve_exact(points.len());
    out.extend(points.map(cell));
}

/// A pass that fills the tiles from one place on, as many as memory holds.
struct Pass<G> {
    from: Option<Place>,
    /// The first tile that is left to the next pass.
    until: Option<Place>,
    most: usize,
    tiles: BTreeMap<Place, Vec<G>>,
}

impl<G: Gathered> Pass<G> {
    fn add(&mut self, cells: &[(Place, u32, f64)]) {
        let mut cells = cells.iter().copied().peekable();
        while let Some(&(place, ..)) = cells.peek() {
            // Points that follow each other lie near each other, mostly.
            let of_place = std::iter::from_fn(|| cells.next_if(|(next, ..)| *next == place));
            match self.tile(place) {
                None => of_place.for_each(drop),
                Some(tile) => of_place.for_each(|(_, number, height)| {
                    let cell = &mut tile[number as usize];
                    *cell = cell.with(height);
                }),
            }
        }
    }

    /// The tile, if it is one of this pass.
    fn tile(&mut self, place: Place) -> Option<&mut Vec<G>> {
        if self.from.is_some_and(|from| place < from) || self.until.is_some_and(|until| place >= until) {
            return None;
        }
        if self.tiles.len() == self.most && !self.tiles.contains_key(&place) {
            let last = *self.tiles.last_key_value()?.0;
            if place > last {
                self.until = Some(place);
                return None;
            }
            self.until = Some(last);
            self.tiles.remove(&last);
        }
        Some(self.tiles.entry(place).or_insert_with(|| vec![G::NONE; TILE * TILE]))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use proptest::prelude::*;

    use super::*;
    use crate::input::ground::tiles::TILE_BYTES;
    use crate::input::{Arrays, InputOptions, PointSlice};

    /// The heights of cells with points.
    fn heights_of<G: Gathered>(points: &[[f64; 3]], side: f64, memory: u64) -> HashMap<Place, f32> {
        let dir = tempfile::tempdir().unwrap();
        let arrays = Arrays::new(PointSlice::from(points));
        let cloud = Cloud::of_source(&arrays, &InputOptions::default()).unwrap();
        let (workers, workspace) = (Workers::new(2).unwrap(), Workspace::new(dir.path()).unwrap());
        let mut records = 0;
        let found = gather::<G>(&cloud, side, memory, &workers, &workspace, |more| records += more).unwrap();
        assert_eq!((found.points, records), (points.len() as u64, points.len() as u64));
        let mut cells = HashMap::new();
        for place in found.heights.places() {
            let heights = found.heights.window(place.map(|at| at * TILE as i64), TILE).unwrap();
            for (i, height) in heights.into_iter().enumerate().filter(|(_, height)| !height.is_nan()) {
                let cell = [place[0] * TILE as i64 + (i / TILE) as i64, place[1] * TILE as i64 + (i % TILE) as i64];
                cells.insert(cell, height);
            }
        }
        cells
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn every_cell_has_its_points_whatever_the_memory(
            points in prop::collection::vec(prop::array::uniform3(-700i32..700), 1..300),
            tiles in 3u64..40,
            side in 1u32..4,
        ) {
            let points: Vec<[f64; 3]> = points.into_iter().map(|p| p.map(|c| f64::from(c) / 2.0)).collect();
            let side = f64::from(side) / 2.0;
            let mut expected: HashMap<Place, Vec<f64>> = HashMap::new();
            for [x, y, z] in &points {
                expected.entry([(y / side).floor() as i64, (x / side).floor() as i64]).or_default().push(*z);
            }
            let all = |of: fn(&[f64]) -> f64| -> HashMap<Place, f32> {
                expected.iter().map(|(cell, heights)| (*cell, of(heights) as f32)).collect()
            };
            // No more than 12 × 12 tiles have points: three at a time are no more than 48 passes.
            let memory = tiles * TILE_BYTES;
            let lowest = all(|heights| heights.iter().copied().fold(f64::INFINITY, f64::min));
            prop_assert_eq!(heights_of::<Lowest>(&points, side, memory), lowest);
            let highest = all(|heights| heights.iter().copied().fold(f64::NEG_INFINITY, f64::max));
            prop_assert_eq!(heights_of::<Highest>(&points, side, memory), highest);
            // Sums of halves are exact.
            let mean = all(|heights| heights.iter().sum::<f64>() / heights.len() as f64);
            prop_assert_eq!(heights_of::<Mean>(&points, side, 4 * memory), mean);
        }
    }

    #[test]
    fn points_all_over_the_world_are_refused_and_not_read_for_ever() {
        let points: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i) * 1e9, 0.0, 0.0]).collect();
        let arrays = Arrays::new(PointSlice::from(&points[..]));
        let cloud = Cloud::of_source(&arrays, &InputOptions::default()).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let (workers, workspace) = (Workers::new(1).unwrap(), Workspace::new(dir.path()).unwrap());
        let error = gather::<Lowest>(&cloud, 1.0, TILE_BYTES, &workers, &workspace, |_| ()).unwrap_err();
        assert!(matches!(error, Error::Budget { .. }), "{error}");
    }
}
