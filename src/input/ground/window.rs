//! Windows round tiles: what a job reads and gives.

use super::fill::REACH;
use super::tiles::{Place, TILE};
use crate::resources::workers::Workers;

/// The part of the budget that the first step's tiles take: one in so many.
pub const SHARE: u64 = 4;

/// Jobs of [`JOB_BYTES`] at a time.
pub fn jobs_in_flight(budget: u64, workers: &Workers) -> usize {
    ((budget / SHARE / JOB_BYTES) as usize).clamp(1, 2 * workers.threads())
}

/// Cells along the side of a window that is filled.
pub const WINDOW: usize = TILE + 2 * REACH;

/// Memory of a job: a window to be filled, its levels, and what is made of it.
pub const JOB_BYTES: u64 = (WINDOW * WINDOW * size_of::<f32>() * 4) as u64;

// Windows that are filled begin at multiples of the reach, and a tile is a multiple of it.
const _: () = assert!(TILE.is_multiple_of(REACH));

/// The first cell of a window that reaches `beyond` cells farther than a tile.
pub fn first_cell(place: Place, beyond: usize) -> Place {
    place.map(|at| at * TILE as i64 - beyond as i64)
}

/// The tile in the middle of a window of `side` cells, and `margin` cells round it.
pub fn middle(window: &[f32], side: usize, margin: usize) -> Vec<f32> {
    let first = (side - TILE) / 2 - margin;
    let lines = (0..TILE + 2 * margin).map(|y| (first + y) * side + first);
    lines.flat_map(|at| window[at..at + TILE + 2 * margin].iter().copied()).collect()
}
