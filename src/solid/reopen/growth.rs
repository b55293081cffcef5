//! Growth: cells open one by one, from the outside, where that changes no topology.

use super::{Slabs, joined, open};
use crate::error::Result;
use crate::grid::slice::{SliceStore, Slices};
use crate::solid::Solid;

/// Rounds of growth, at most.
pub(super) const ROUNDS: u32 = 24;

impl Slabs<'_> {
    /// What is opened, when it has grown.
    pub(super) fn grown_from(&self, solid: &Solid, mut opened: SliceStore, target: &SliceStore) -> Result<SliceStore> {
        for _ in 0..ROUNDS {
            let (more, grown) = self.grown(solid, opened, target)?;
            opened = more;
            if !grown {
                break;
            }
        }
        Ok(opened)
    }

    /// A round of growth: what is opened then, and whether it is more.
    fn grown(&self, solid: &Solid, opened: SliceStore, target: &SliceStore) -> Result<(SliceStore, bool)> {
        let more = self.found(open::SUBGRIDS, |chunk, tiles, found| {
            let [solid, opened, target] =
                [&solid.store, &opened, target].map(|store| Slabs::stretch(store, chunk, open::SUBGRIDS));
            let (solid, opened, target) = (solid?, opened?, target?);
            for tile in tiles {
                open::grown(tile, &solid, &opened, &target, |cell| found.push(cell, ()));
            }
            Ok(())
        })?;
        if more.is_empty() {
            return Ok((opened, false));
        }
        Ok((self.together(&opened, &more)?, true))
    }

    /// No cell.
    pub(super) fn none(&self) -> Result<SliceStore> {
        let mut out = SliceStore::new(&self.context.workspace, self.context.memory.store_quota);
        let mut slices = Slices::default();
        let empty = joined(vec![Vec::new(); self.cells[2] as usize]);
        (0..self.cells[1]).for_each(|_| slices.push_runs(&empty));
        out.extend(&slices)?;
        Ok(out)
    }
}
