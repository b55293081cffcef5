//! A raster of heights whose small holes are filled.

use super::fill::{REACH, fill};
use super::opening::opened;
use super::tiles::{Place, TILE, Tiles};
use super::window::{WINDOW, first_cell, jobs_in_flight, middle};
use crate::error::Result;
use crate::resources::workers::Workers;
use crate::storage::spool::Workspace;

/// The widest hole that is filled has twice this radius, in cells: no such hole holds a tile.
pub const MOST: u32 = (TILE / 2 - 1) as u32;

/// The heights, and for those cells without one that no window of `radius` reaches whose cells are all without, the height that filling gives: holes narrower than such a window. Beyond the ends
/// of the data nothing is filled.
///
/// Memory: [`super::window::JOB_BYTES`] for each job, as many as a quarter of `budget` holds.
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::Interrupted`].
pub fn without_small_holes(
    heights: &Tiles,
    radius: u32,
    budget: u64,
    workers: &Workers,
    workspace: &Workspace,
) -> Result<Tiles> {
    let mut out = Tiles::new(workspace, 0);
    let places = heights.places();
    workers.in_order_range(
        jobs_in_flight(budget, workers),
        places.len(),
        |number| Ok((places[number], small_holes_filled(heights, places[number], radius)?)),
        |(place, heights)| out.append(place, &heights),
    )?;
    Ok(out)
}

/// A tile of [`without_small_holes`]. A radius above [`MOST`] counts as [`MOST`].
pub(super) fn small_holes_filled(heights: &Tiles, place: Place, radius: u32) -> Result<Vec<f32>> {
    let radius = radius.min(MOST);
    let mut window = heights.window(first_cell(place, REACH), WINDOW)?;
    if radius == 0 {
        return Ok(middle(&window, WINDOW, 0));
    }
    let margin = 2 * radius as usize;
    let side = TILE + 2 * margin;
    let empty: Vec<f32> =
        middle(&window, WINDOW, margin).iter().map(|height| if height.is_nan() { 1.0 } else { 0.0 }).collect();
    let open = middle(&opened(&empty, side, radius), side, 0);
    fill(&mut window, WINDOW);
    let mut out = middle(&window, WINDOW, 0);
    out.iter_mut().zip(open).filter(|(_, open)| *open > 0.0).for_each(|(height, _)| *height = f32::NAN);
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane with round holes, over a part of four tiles.
    #[test]
    fn small_holes_are_filled_and_wide_ones_and_the_ends_are_not() {
        let dir = tempfile::tempdir().unwrap();
        let (workers, workspace) = (Workers::new(2).unwrap(), Workspace::new(dir.path()).unwrap());
        // Middle and radius: one across four tiles, one within one.
        let holes = [([0, 0], 5), ([-60, 70], 20)];
        let is_in = |[y, x]: [i64; 2], ([row, column], radius): ([i64; 2], i64)| {
            (y - row).pow(2) + (x - column).pow(2) <= radius * radius
        };
        let height = |cell: [i64; 2]| {
            let there = cell.iter().all(|at| (-100..100).contains(at)) && !holes.iter().any(|hole| is_in(cell, *hole));
            if there { (cell[0] + 2 * cell[1]) as f32 } else { f32::NAN }
        };
        let mut tiles = Tiles::new(&workspace, 0);
        for place in [[-1, -1], [-1, 0], [0, -1], [0, 0]] {
            let cells = (0..TILE * TILE)
                .map(|i| [place[0] * TILE as i64 + (i / TILE) as i64, place[1] * TILE as i64 + (i % TILE) as i64]);
            tiles.append(place, &cells.map(height).collect::<Vec<_>>()).unwrap();
        }
        let found = without_small_holes(&tiles, 8, 1 << 20, &workers, &workspace).unwrap();
        let window = found.window([-128, -128], 256).unwrap();
        for (i, found) in window.iter().enumerate() {
            let cell = [(i / 256) as i64 - 128, (i % 256) as i64 - 128];
            let plane = (cell[0] + 2 * cell[1]) as f32;
            if !height(cell).is_nan() {
                assert_eq!(*found, plane);
            } else if is_in(cell, holes[0]) {
                assert!((found - plane).abs() < 6.0, "{cell:?}: {found} for {plane}");
            } else if is_in(cell, ([-60, 70], 20)) && !is_in(cell, ([-60, 70], 18)) {
                // At the ends of a wide hole the window does not reach everywhere.
                assert!(found.is_nan() || (found - plane).abs() < 6.0, "{cell:?}: {found} for {plane}");
            } else {
                assert!(found.is_nan(), "{cell:?}: {found}");
            }
        }
        let none = without_small_holes(&tiles, 0, 1 << 20, &workers, &workspace).unwrap();
        assert!(none.window([0, 0], 4).unwrap().iter().all(|height| height.is_nan()));
    }
}
