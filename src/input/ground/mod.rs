//! Bare earth: which points lie on the ground, for clouds without classes.
//!
//! ```text
//!  points --lowest--> the lowest of each cell --sink--> without pits --open--> cells on the ground --fill--> heights
//!                                                                                                              |
//!  points ---------------------------------------------------------------------------- near their height? <----+
//! ```
//!
//! A simple morphological filter (SMRF: T. Pingel, K. Clarke, W. McBride, *An improved simple morphological filter for the terrain classification of airborne LIDAR
//! data*, ISPRS Journal 77, 2013). A cell whose lowest point stands higher above the opened surface than a slope lets expect is an object's. What is left is
//! interpolated, and a point near that is ground. docs/algorithm.md has the rules.
//!
//! The raster is one of tiles over the plane in temporary storage. Every step makes a tile of the tiles round it, so memory depends on neither the number of points nor
//! the area; what it depends on is the number of jobs in flight, and the share for the first step's tiles.

pub mod cells;
pub mod fill;
pub mod opening;
mod options;
pub mod surface;
pub mod tiles;
mod verdict;
mod window;

use self::cells::{Cells, Lowest, gather};
use self::fill::{REACH, fill};
use self::opening::open;
pub use self::options::GroundOptions;
use self::surface::small_holes_filled;
use self::tiles::{Place, TILE, Tiles};
pub use self::verdict::GroundModel;
use self::window::{SHARE, WINDOW, first_cell, jobs_in_flight, middle};
use crate::error::Result;
use crate::input::Cloud;
use crate::resources::workers::Workers;
use crate::storage::spool::Workspace;

/// What was found.
#[derive(Debug)]
pub struct Found {
    /// Points by class.
    pub classes: [u64; 256],
    /// All points.
    pub points: u64,
    /// The lowest points, of which the ground is to be made.
    lowest: Tiles,
}

/// Looks at the points: how many there are of each class, and the lowest of each cell. `progress` is told the records that were read.
///
/// Memory: a quarter of `budget`. Temporary disk: 64 KiB for each square of 128 cells with points.
///
/// # Errors
/// Errors of reading the input; [`crate::Error::Budget`] if the points lie all over the world; [`crate::Error::Io`]; [`crate::Error::Interrupted`].
pub fn look(
    cloud: &Cloud,
    asked: GroundOptions,
    budget: u64,
    workers: &Workers,
    workspace: &Workspace,
    progress: impl FnMut(u64),
) -> Result<Found> {
    let Cells { heights, classes, points } =
        gather::<Lowest>(cloud, asked.cell, budget / SHARE, workers, workspace, progress)?;
    Ok(Found { classes, points, lowest: heights })
}

impl Found {
    /// The ground below the points. `progress` is told the steps that are done, of how many.
    ///
    /// Memory: [`window::JOB_BYTES`] for each job, at most two a thread, as many as a quarter of `budget` holds. Temporary disk: 200 KiB for each square of 128 cells with points.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn model(
        self,
        asked: GroundOptions,
        budget: u64,
        workers: &Workers,
        workspace: &Workspace,
        mut progress: impl FnMut(u64, u64),
    ) -> Result<GroundModel> {
        let in_flight = jobs_in_flight(budget, workers);
        let all = 3 * self.lowest.places().len() as u64;
        let mut done = 0;
        let mut step = |from: &Tiles, work: &(dyn Fn(&Tiles, Place) -> Result<Vec<f32>> + Sync)| {
            let mut made = Tiles::new(workspace, 0);
            let places = from.places();
            workers.in_order_range(
                in_flight,
                places.len(),
                |number| Ok((places[number], work(from, places[number])?)),
                |(place, heights)| {
                    done += 1;
                    progress(done, all);
                    made.append(place, &heights)
                },
            )?;
            Ok(made)
        };
        let sunk = step(&self.lowest, &|tiles, place| without_pits(tiles, place, asked.pit as f32))?;
        // Wider holes stay unknown, and so does what lies beyond the end of the data. Filled from a roof that the end cuts, the roof would go on there and sink slowly, and no window would see a step.
        let whole = step(&sunk, &|tiles, place| small_holes_filled(tiles, place, asked.hole))?;
        let ground = step(&whole, &|tiles, place| {
            let own = sunk.window(first_cell(place, 0), TILE)?;
            on_ground(tiles, place, own, asked)
        })?;
        drop((whole, sunk));
        GroundModel::of(&ground, asked, in_flight, workers, workspace)
    }
}

/// A tile without what lies in a pit: so much lower than a closing with its neighbours leaves it. What is filled beside a pit is filled with it, and no lower.
fn without_pits(tiles: &Tiles, place: Place, pit: f32) -> Result<Vec<f32>> {
    // Twice the window's radius.
    const MARGIN: usize = 2;
    let side = TILE + 2 * MARGIN;
    let window = tiles.window(first_cell(place, REACH), WINDOW)?;
    let mut own = middle(&window, WINDOW, 0);
    let mut whole = window;
    fill(&mut whole, WINDOW);
    let upside_down: Vec<f32> = middle(&whole, WINDOW, MARGIN).iter().map(|height| -height).collect();
    open(&upside_down, side, 1, |_, closed| {
        for (own, closed) in own.iter_mut().zip(closed) {
            if -closed - *own > pit {
                *own = f32::NAN;
            }
        }
    });
    Ok(own)
}

/// The lowest points of a tile's cells that lie on the ground: those that no window lowers by more than the slope allows.
fn on_ground(whole: &Tiles, place: Place, mut own: Vec<f32>, asked: GroundOptions) -> Result<Vec<f32>> {
    let margin = 2 * asked.window as usize;
    let side = TILE + 2 * margin;
    let window = whole.window(first_cell(place, margin), side)?;
    let mut before = middle(&window, side, 0);
    open(&window, side, asked.window, |radius, opened| {
        let most = (asked.slope * asked.cell * f64::from(radius)).min(asked.storey) as f32;
        for ((own, before), opened) in own.iter_mut().zip(&mut before).zip(opened) {
            if *before - opened > most {
                *own = f32::NAN;
            }
            *before = *opened;
        }
    });
    Ok(own)
}

#[cfg(test)]
mod tests;
