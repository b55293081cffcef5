//! The lowest point of every cell, and how many points there are of each class: a pass over the input, or as many as memory asks for.

use std::collections::{BTreeMap, BTreeSet};

use bytesize::ByteSize;

use super::tiles::{Place, TILE, TILE_BYTES, Tiles, cell_of, place_of};
use crate::error::{Error, Result};
use crate::input::{Carried, Cloud};
use crate::points::scalar::{Endian, reader};
use crate::points::{Batch, Points};
use crate::resources::workers::Workers;
use crate::storage::spool::Workspace;

/// What the passes find.
#[derive(Debug)]
pub struct Lowest {
    /// The lowest heights.
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

/// Finds the lowest point of each cell of side `side`. `memory` is what the tiles that are being filled may take; where they do not fit, the ones that
/// come first are filled in a first pass, and so on. `progress` is told the records of each block of the first pass.
///
/// # Errors
/// Errors of reading the input; [`Error::Budget`] if that would take more than 64 passes; [`Error::Io`]; [`Error::Interrupted`].
pub fn lowest(
    cloud: &Cloud,
    side: f64,
    memory: u64,
    workers: &Workers,
    workspace: &Workspace,
    mut progress: impl FnMut(u64),
) -> Result<Lowest> {
    let most = (memory / TILE_BYTES).max(1);
    let mut found = Lowest { heights: Tiles::new(workspace, 0), classes: [0; 256], points: 0 };
    let mut seen: BTreeSet<Place> = BTreeSet::new();
    let class = cloud.schema_of(&[CLASS]);
    let class =
        class.column(CLASS).map(|column| (column.offset, class.stride(), reader(column.scalar, Endian::NATIVE)));
    let (mut from, mut first) = (None, true);
    loop {
        let mut pass = Pass { from, until: None, most: most as usize, tiles: BTreeMap::new() };
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
            let cells = match &batch.points {
                Points::Single(points) => cells_of(points.iter().map(|p| p.map(f64::from)), side),
                Points::Double(points) => cells_of(points.iter().copied(), side),
            };
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
                            given: ByteSize(memory * super::SHARE),
                            needed: ByteSize(tiles * TILE_BYTES * super::SHARE),
                            what: "the ground filter, for points that lie so far apart,",
                        });
                    }
                }
                pass.add(cells);
                Ok(())
            },
        )?;
        first = false;
        for (place, heights) in &pass.tiles {
            found.heights.append(*place, heights)?;
        }
        match pass.until {
            None => return Ok(found),
            until => from = until,
        }
    }
}

/// For each point, the tile it lies in, the number of its cell in that, and its height.
fn cells_of(points: impl Iterator<Item = [f64; 3]>, side: f64) -> Vec<(Place, u32, f32)> {
    let cell = |point: [f64; 3]| {
        let (place, number) = place_of(cell_of(point, side));
        (place, number as u32, point[2] as f32)
    };
    points.map(cell).collect()
}

/// A pass that fills the tiles from one place on, as many as memory holds.
struct Pass {
    from: Option<Place>,
    /// The first tile that is left to the next pass.
    until: Option<Place>,
    most: usize,
    tiles: BTreeMap<Place, Vec<f32>>,
}

impl Pass {
    fn add(&mut self, cells: Vec<(Place, u32, f32)>) {
        let mut cells = cells.into_iter().peekable();
        while let Some(&(place, ..)) = cells.peek() {
            // Points that follow each other lie near each other, mostly.
            let of_place = std::iter::from_fn(|| cells.next_if(|(next, ..)| *next == place));
            match self.tile(place) {
                None => of_place.for_each(drop),
                Some(tile) => of_place.for_each(|(_, number, height)| {
                    let lowest = &mut tile[number as usize];
                    if lowest.is_nan() || height < *lowest {
                        *lowest = height;
                    }
                }),
            }
        }
    }

    /// The tile, if it is one of this pass.
    fn tile(&mut self, place: Place) -> Option<&mut Vec<f32>> {
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
        Some(self.tiles.entry(place).or_insert_with(|| vec![f32::NAN; TILE * TILE]))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use proptest::prelude::*;

    use super::*;
    use crate::input::{InputOptions, PointSlice};

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn every_cell_has_its_lowest_point_whatever_the_memory(
            points in prop::collection::vec(prop::array::uniform3(-700i32..700), 1..300),
            tiles in 1u64..40,
            side in 1u32..4,
        ) {
            let points: Vec<[f64; 3]> = points.into_iter().map(|p| p.map(|c| f64::from(c) / 2.0)).collect();
            let side = f64::from(side) / 2.0;
            let mut expected: HashMap<[i64; 2], f32> = HashMap::new();
            for [x, y, z] in &points {
                let lowest = expected.entry([(y / side).floor() as i64, (x / side).floor() as i64]).or_insert(f32::MAX);
                *lowest = lowest.min(*z as f32);
            }
            let dir = tempfile::tempdir().unwrap();
            let arrays = crate::input::Arrays::new(PointSlice::from(&points[..]));
            let cloud = Cloud::of_source(&arrays, &InputOptions::default()).unwrap();
            let (workers, workspace) = (Workers::new(2).unwrap(), Workspace::new(dir.path()).unwrap());
            let mut records = 0;
            let found = lowest(&cloud, side, tiles * TILE_BYTES, &workers, &workspace, |more| records += more).unwrap();
            prop_assert_eq!((found.points, records), (points.len() as u64, points.len() as u64));
            let mut cells = 0;
            for place in found.heights.places() {
                let heights = found.heights.window(place.map(|at| at * TILE as i64), TILE).unwrap();
                for (i, height) in heights.iter().enumerate().filter(|(_, height)| !height.is_nan()) {
                    let cell = [place[0] * TILE as i64 + (i / TILE) as i64, place[1] * TILE as i64 + (i % TILE) as i64];
                    prop_assert_eq!(Some(height), expected.get(&cell));
                    cells += 1;
                }
            }
            prop_assert_eq!(cells, expected.len());
        }
    }

    #[test]
    fn points_all_over_the_world_are_refused_and_not_read_for_ever() {
        let points: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i) * 1e9, 0.0, 0.0]).collect();
        let arrays = crate::input::Arrays::new(PointSlice::from(&points[..]));
        let cloud = Cloud::of_source(&arrays, &InputOptions::default()).unwrap();
        let dir = tempfile::tempdir().unwrap();
        let (workers, workspace) = (Workers::new(1).unwrap(), Workspace::new(dir.path()).unwrap());
        let error = lowest(&cloud, 1.0, TILE_BYTES, &workers, &workspace, |_| ()).unwrap_err();
        assert!(matches!(error, Error::Budget { .. }), "{error}");
    }
}
