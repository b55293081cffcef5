//! Growth: cells change sides one by one, beside those that did, where that changes no topology.
//!
//! ```text
//!   S S S S S S        target: cells that had better be on the other side
//!     t t t t #        x those of them that change: each is simple when its turn comes (simple), so neither pieces nor tunnels come of it.
//!   o x x x t #        The last t may stay: beyond it there is more outside, and to open it would join both.
//! ```

use crate::error::Result;
use crate::grid::context::{CHUNK_SLICES, Context};
use crate::grid::slice::{Run, SliceStore};
use crate::solid::Solid;
use crate::solid::change::{Change, together};
use crate::solid::reopen::found::Found;
use crate::solid::reopen::layers::Stretch;
use crate::solid::reopen::tile::{TILE, Tile};
use crate::solid::simple::{is_simple, neighbourhood};

/// Rounds at most.
pub const ROUNDS: u32 = 24;

/// Sub-grids of the cells whose coordinates are even or odd: no two cells of one touch, so all of one may change at once.
const SUBGRIDS: i64 = 8;

impl Solid {
    /// The cells of `target` that change, with those that are `changed` already. A round is a pass over the solid; a job holds the runs of a chunk and of eight slices more on either side.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub(super) fn growth(
        &self,
        mut changed: SliceStore,
        target: &SliceStore,
        change: Change,
        context: &Context,
    ) -> Result<SliceStore> {
        let jobs = self.growing_jobs(context);
        for _ in 0..ROUNDS {
            let more = self.round(&changed, target, change, jobs, context)?;
            if more.is_empty() {
                break;
            }
            changed = together(&changed, &more, self.cells, context)?;
        }
        Ok(changed)
    }

    /// What a round adds.
    fn round(
        &self,
        changed: &SliceStore,
        target: &SliceStore,
        change: Change,
        jobs: usize,
        context: &Context,
    ) -> Result<SliceStore> {
        context.slices_of(self.cells[1], jobs, |chunk, slices| {
            let around = i64::from(chunk.start) - SUBGRIDS..i64::from(chunk.end) + SUBGRIDS;
            let read = |store| Stretch::read(store, around.clone());
            let (target, mut found) = (read(target)?, Found::new(chunk.clone()));
            let tiles = Tile::with(&target, &chunk, self.cells, SUBGRIDS);
            if !tiles.is_empty() {
                let (solid, changed) = (read(&self.store)?, read(changed)?);
                for tile in &tiles {
                    round(tile, &solid, &changed, &target, change, |cell| found.push(cell, ()));
                }
            }
            found.sorted(self.cells).0.iter().for_each(|runs| slices.push_runs(runs));
            Ok(())
        })
    }

    /// Jobs in flight.
    fn growing_jobs(&self, context: &Context) -> usize {
        let [slices, side] = [CHUNK_SLICES, TILE].map(|cells| u64::from(cells) + 2 * SUBGRIDS as u64);
        // Of the solid, of what changed and of the target, two faces a run.
        let faces = self
            .faces
            .windows(self.faces.len().min(slices as usize))
            .map(|faces| faces.iter().map(|n| u64::from(*n)).sum());
        let runs = size_of::<Run>() as u64 * faces.max().unwrap_or(0);
        let rows = 3 * size_of::<u32>() as u64 * slices * u64::from(self.cells[2]);
        let job = runs + rows + slices * side * side;
        let jobs = context.memory.jobs_of(job);
        context.account.pass(job * (jobs as u64).min(u64::from(self.cells[1].div_ceil(CHUNK_SLICES))));
        jobs
    }
}

/// A round in a tile, which has a margin of [`SUBGRIDS`]: calls `found` with the cells that change.
fn round(
    tile: &Tile,
    solid: &Stretch,
    changed: &Stretch,
    target: &Stretch,
    change: Change,
    mut found: impl FnMut([i64; 3]),
) {
    let [before, after] = match change {
        Change::Removed => [0u8, 1],
        Change::Filled => [1, 0],
    };
    let mut outside = vec![1u8; tile.len()];
    tile.paint(solid, 0, &mut outside);
    tile.paint(changed, after, &mut outside);
    let mut left = Vec::new();
    target.cells(tile.ranges(1), |cell| {
        if outside[tile.place(cell)] == before {
            left.push(cell);
        }
    });
    let strides = tile.strides();
    for subgrid in 0..SUBGRIDS {
        left.retain(|cell| {
            let place = tile.place(*cell);
            let [x, y, z] = cell.map(|c| c & 1);
            if x + 2 * z + 4 * y != subgrid || !is_simple(neighbourhood(place, strides, |place| outside[place] == 1)) {
                return true;
            }
            outside[place] = after;
            if tile.holds(*cell, tile.margin) {
                found(*cell);
            }
            false
        });
    }
}
