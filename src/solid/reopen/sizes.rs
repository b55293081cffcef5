//! What the jobs over chunks of slices take, in bytes: for the walls when it is known which cells are looked at, for the field when its candidates are known, too: the free
//! cells that may open.

use std::ops::Range;

use super::SIGMA_CELLS;
use super::dipole::{self, Dipole};
use super::field::RANGE;
use super::plane::{self, Moments, Sum};
use super::tile::TILE;
use super::wall::{self, Wall};
use crate::grid::Cell;
use crate::grid::context::{CHUNK_SLICES, chunks};
use crate::grid::slice::Run;

/// How far the widest Gaussian reaches, in cells.
const REACH: i64 = (RANGE * SIGMA_CELLS.1) as i64;

/// Bytes of a cell's place among those that a job holds.
const PLACE: u64 = size_of::<u32>() as u64;

/// Bytes of a candidate: its place, and what the walls near it add up to.
const CANDIDATE: u64 = PLACE + size_of::<f32>() as u64;

/// Bytes of a candidate until its row of tiles is done: row, place and that sum, in a vector that grows by doubling.
const AT_HAND: u64 = 2 * (PLACE + CANDIDATE);

/// Candidates to expect for each cell that is looked at.
const CANDIDATES: u64 = 4;

/// What the jobs depend on.
#[derive(Debug)]
pub struct Sizes {
    /// Cells along x, slices, rows.
    pub cells: Cell,
    /// How far the Gaussian reaches, in cells.
    pub gaussian: i64,
    /// Of each slice, the occupied cells that are looked at.
    pub active: Vec<u32>,
    /// Of each slice, the solid's faces.
    pub faces: Vec<u32>,
}

impl Sizes {
    /// Bytes of the job over each chunk, and of what it gives, in the passes that look at walls.
    pub fn of_walls(&self) -> Vec<[u64; 2]> {
        self.of_chunks(|chunk| for_walls(|more| self.around(&self.active, chunk, more)))
    }

    /// The same with the passes that look at free cells, of which each slice has so many candidates.
    pub fn of_field(&self, candidates: &[u32]) -> Vec<[u64; 2]> {
        self.of_chunks(|chunk| {
            let active = |more| self.around(&self.active, chunk, more);
            let candidates = self.around(candidates, chunk, 0);
            // As if a row of tiles had its share of them.
            let rows = u64::from(self.cells[2]).max(1);
            let at_hand = candidates * AT_HAND * rows.min(TILE.into()) / rows;
            for_walls(active).max(for_dipoles(active(self.gaussian)) + candidates * CANDIDATE + at_hand)
        })
    }

    fn of_chunks(&self, for_cells: impl Fn(&Range<u32>) -> u64) -> Vec<[u64; 2]> {
        let bytes = |chunk: Range<u32>| {
            // Of the solid and of what is opened, two faces a run.
            let runs = |more| size_of::<Run>() as u64 * self.around(&self.faces, &chunk, more);
            let all = for_cells(&chunk) + runs(self.gaussian) + rows_and_tile(self.gaussian, self.cells);
            [all, size_of::<Moments>() as u64 * self.around(&self.active, &chunk, 0) + runs(0)]
        };
        chunks(self.cells[1]).map(bytes).collect()
    }

    /// The sum over a chunk and so many slices more on either side.
    fn around(&self, of: &[u32], chunk: &Range<u32>, more: i64) -> u64 {
        let slices = chunk.start.saturating_sub(more as u32)..(chunk.end + more as u32).min(self.cells[1]);
        of[slices.start as usize..slices.end as usize].iter().map(|count| u64::from(*count)).sum()
    }
}

/// Bytes of what is known of walls in the pass that holds the most of it; a chunk and so many slices more on either side have so many active cells.
fn for_walls(active: impl Fn(i64) -> u64) -> u64 {
    let [sum, moments, wall, dipole] =
        [size_of::<Sum>(), size_of::<Moments>(), size_of::<Wall>(), size_of::<Dipole>()].map(|bytes| bytes as u64);
    // What each pass holds of the slices round a chunk, and what it finds for the chunk's own. Points are summed bucket by bucket, which have fewer slices than a chunk.
    let passes =
        [(0, sum, 0), (plane::REACH[1], moments, wall), (wall::SIGHT, wall, wall), (dipole::BOUNDS, wall, dipole)];
    let bytes = passes.map(|(more, held, found)| active(more) * (PLACE + held) + active(0) * found);
    bytes.into_iter().max().unwrap_or(0)
}

/// Bytes of so many walls as they add to the field.
fn for_dipoles(active: u64) -> u64 {
    active * (PLACE + size_of::<Dipole>() as u64)
}

/// Slices of a chunk with so many more on either side.
fn slices_held(more: i64) -> u64 {
    u64::from(CHUNK_SLICES) + 2 * more as u64
}

/// Bytes of the rows of all slices that a job holds, and of a tile, three times.
fn rows_and_tile(gaussian: i64, cells: Cell) -> u64 {
    let side = u64::from(TILE) + 2 * gaussian as u64;
    let (row, tile) = (4 * size_of::<u32>() as u64, 3 * size_of::<f32>() as u64);
    slices_held(gaussian) * (u64::from(cells[2]) * row + side * side * tile)
}

/// Bytes to expect of a job, with so many faces in a slice, as if each had an occupied cell that is looked at.
pub fn bytes_to_expect(faces_of_slice: u64, cells: Cell) -> u64 {
    let faces = |more: i64| faces_of_slice * slices_held(more);
    let for_field = for_dipoles(faces(REACH)) + CANDIDATES * CANDIDATE * faces(0);
    for_walls(faces).max(for_field) + size_of::<Run>() as u64 * faces(REACH) + rows_and_tile(REACH, cells)
}

/// Bytes to expect that are handed from pass to pass, of so many occupied cells.
pub fn records_to_expect(cells: u64) -> u64 {
    cells * (size_of::<Moments>() + 2 * size_of::<Wall>() + size_of::<Dipole>()) as u64
}
