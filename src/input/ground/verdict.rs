//! Which points lie on the ground, whose heights are known.

use bytemuck::cast_slice_mut;

use super::fill::{REACH, fill};
use super::options::GroundOptions;
use super::tiles::{Place, TILE, Tiles};
use super::window::{WINDOW, first_cell, middle};
use crate::error::Result;
use crate::points::Points;
use crate::points::filter::Verdict;
use crate::resources::workers::Workers;
use crate::storage::spool::{Spool, Workspace};

/// Cells along the side of a tile with a margin of one, so that what lies between the middles of cells is found in one tile.
const SIDE: usize = TILE + 2;
/// Bytes of such a tile.
const BYTES: usize = SIDE * SIDE * size_of::<f32>();

/// The heights of the ground, on disk.
#[derive(Debug)]
pub struct GroundModel {
    asked: GroundOptions,
    places: Vec<Place>,
    heights: Spool,
}

impl GroundModel {
    /// The ground between cells that lie on it.
    pub(super) fn of(
        ground: &Tiles,
        asked: GroundOptions,
        in_flight: usize,
        workers: &Workers,
        workspace: &Workspace,
    ) -> Result<GroundModel> {
        let places = ground.places().to_vec();
        let mut heights = workspace.spool(0);
        workers.in_order_range(
            in_flight,
            places.len(),
            |number| {
                let mut window = ground.window(first_cell(places[number], REACH), WINDOW)?;
                fill(&mut window, WINDOW);
                Ok(middle(&window, WINDOW, 1))
            },
            |tile| heights.append(bytemuck::cast_slice(&tile)).map(drop),
        )?;
        Ok(GroundModel { asked, places, heights })
    }

    /// The tile and the place in it, in cells from the middle of its first one, margin included, that a point lies above.
    fn place(&self, x: f64, y: f64) -> (Place, [f64; 2]) {
        // Between the middles of cells: half a cell less.
        let at = [y / self.asked.cell - 0.5, x / self.asked.cell - 0.5];
        let place = super::tiles::place_of(super::tiles::cell_of([x, y, 0.0], self.asked.cell)).0;
        let within = [0, 1].map(|a| (at[a] - (place[a] * TILE as i64) as f64 + 1.0).clamp(0.0, (SIDE - 1) as f64));
        (place, within)
    }

    /// Whether a point lies on the ground, by its height and its place in a tile.
    fn is_near(&self, tile: &[f32], [row, column]: [f64; 2], height: f64) -> bool {
        let first = |at: f64| (at as usize).min(SIDE - 2);
        let (y, x) = (first(row), first(column));
        let (v, u) = (row - y as f64, column - x as f64);
        let [a, b, c, d] = [0, 1, SIDE, SIDE + 1].map(|more| f64::from(tile[y * SIDE + x + more]));
        let ground = (a * (1.0 - u) + b * u) * (1.0 - v) + (c * (1.0 - u) + d * u) * v;
        let along = ((b - a) * (1.0 - v) + (d - c) * v) / self.asked.cell;
        let across = ((c - a) * (1.0 - u) + (d - b) * u) / self.asked.cell;
        let slope = libm::sqrt(along * along + across * across);
        // Nothing is near what is not known.
        (height - ground).abs() <= self.asked.near + self.asked.scaling * slope
    }
}

impl Verdict for GroundModel {
    fn judge(&self, points: &Points) -> Result<Vec<bool>> {
        let point = |number: usize| match points {
            Points::Single(points) => points[number].map(f64::from),
            Points::Double(points) => points[number],
        };
        let mut verdicts = vec![false; points.len()];
        // Tile by tile, so that each is read once.
        let mut order: Vec<(Place, u32)> = (0..points.len())
            .map(|number| {
                let [x, y, _] = point(number);
                (self.place(x, y).0, number as u32)
            })
            .collect();
        order.sort_unstable();
        let mut tile = vec![0f32; SIDE * SIDE];
        for of_tile in order.chunk_by(|a, b| a.0 == b.0) {
            let Ok(number) = self.places.binary_search(&of_tile[0].0) else { continue };
            self.heights.read_at((number * BYTES) as u64, cast_slice_mut(&mut tile))?;
            for &(_, number) in of_tile {
                let [x, y, z] = point(number as usize);
                verdicts[number as usize] = self.is_near(&tile, self.place(x, y).1, z);
            }
        }
        Ok(verdicts)
    }
}
