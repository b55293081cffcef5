//! Clefts: slots so narrow that the points of both walls share cells.
//!
//! No free cell lies between such walls, so the winding number has nothing to open there. But the points of these cells lie where no outside is near, and what was measured there was
//! seen:
//!
//! ```text
//!   S S S S S S S S
//!     # # # S S S S      # occupied, S solid; h occupied and hidden: no outside is near along the normal
//!           h h h h      Cells of the cleft open one by one, from the outside, where that changes no topology;
//!     # # # S S S S      the vertices on both sides of it find the points of both walls.
//!   S S S S S S S S
//! ```

use bytemuck::{Pod, Zeroable};

use super::layers::Layers;
use super::wall::{HIDDEN, THIN, Wall};
use super::{Blocks, OPEN, Reopening, Sampling, Slabs};
use crate::error::Result;
use crate::grid::label::Measure;
use crate::grid::slice::SliceStore;
use crate::solid::Solid;

/// A wall's cell with so many hidden walls among the cells round it belongs to a cleft.
pub(super) const BESIDE: u32 = 3;

/// Hidden walls of a cleft, at the least: fewer are strays.
pub(super) const LEAST: u32 = 5;

/// Noise hides walls, too, but none so deep: among noisy points, so many walls of a cleft have no outside within this squared distance.
pub(super) const BELOW_NOISE: u32 = 12;

impl Reopening<'_> {
    /// What is left of the solid, when it was opened, without its clefts, and without what is seen to be outside then; and whether it had any. `step` is called [`super::STEPS`] times
    /// at most.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn without_clefts(&mut self, solid: Solid, step: impl FnMut()) -> Result<(Solid, bool)> {
        let (solid, blocks) = self.less_clefts(solid)?;
        let Some(blocks) = blocks else { return Ok((solid, false)) };
        let near = blocks.widened(OPEN, self.slabs.context)?;
        let solid = self.pass(solid, Some(&near), step)?;
        Ok((self.less_clefts(solid)?.0, true))
    }

    /// The solid without its clefts, and the blocks in which they lie, if there are any.
    fn less_clefts(&mut self, solid: Solid) -> Result<(Solid, Option<Blocks>)> {
        let clefts = self.slabs.clefts(&solid, self.occupied, &self.planes, self.sampling)?;
        if clefts.is_empty() {
            return Ok((solid, None));
        }
        let context = self.slabs.context;
        let blocks = Blocks::with_cells(&clefts, 1, self.slabs.cells, context)?;
        Ok((solid.without(&clefts, context)?, Some(blocks)))
    }
}

impl Slabs<'_> {
    /// The cells of clefts that open, when the solid is what the rest has left of it. Of walls, planes count alone.
    pub(super) fn clefts(
        &mut self,
        solid: &Solid,
        occupied: &SliceStore,
        walls: &Layers<Wall>,
        sampling: Sampling<'_>,
    ) -> Result<SliceStore> {
        let walls = self.seen(solid, walls)?;
        let below_noise = if sampling.noisy { Some(solid.deep(BELOW_NOISE, occupied, self.context)?) } else { None };
        let groups = self.parts(
            |chunk, found| {
                let held = self.held(&walls, chunk, 1)?;
                let deep = below_noise.as_ref().map(|deep| Slabs::stretch(deep, chunk, 0)).transpose()?;
                let thickened = sampling.thickened.map(|store| Slabs::stretch(store, chunk, 1)).transpose()?;
                let is_thickened = |[x, y, z]: [i64; 3]| {
                    let near = [x - 1..x + 2, y - 1..y + 2, z - 1..z + 2];
                    thickened.as_ref().is_some_and(|thickened| thickened.any_of(near))
                };
                let mut cells = Vec::new();
                for y in chunk.clone().map(i64::from) {
                    let (places, walls) = held.slice(y);
                    for ((z, x), wall) in places.iter().zip(walls).filter(|(_, wall)| wall.kind != THIN) {
                        let (cell, is_hidden) = ([x.into(), y, z.into()], wall.kind == HIDDEN);
                        let mut hidden = 0;
                        held.round(cell, 1, |_, wall| hidden += u32::from(wall.kind == HIDDEN));
                        if (is_hidden || hidden >= BESIDE) && !is_thickened(cell) {
                            let counts = is_hidden && deep.as_ref().is_none_or(|deep| deep.get(cell));
                            cells.push((cell, u32::from(counts)));
                        }
                    }
                }
                // They are taken row by row.
                cells.sort_by_key(|([_, _, z], _)| *z);
                cells.into_iter().for_each(|(cell, walls)| found.push(cell, walls));
                Ok(())
            },
            |walls| Hidden { walls },
        )?;
        let labels = groups.judged(self.context, |group| u8::from(group.walls >= LEAST))?;
        let clefts = self.judged(&labels, None)?;
        if clefts.is_empty() {
            return Ok(clefts);
        }
        self.allowed = Blocks::with_cells(&clefts, 1, self.cells, self.context)?;
        self.grown_from(solid, self.none()?, &clefts)
    }
}

/// The hidden walls of a group that count.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(C)]
struct Hidden {
    walls: u32,
}

impl Measure for Hidden {
    fn add(&mut self, other: &Hidden) {
        self.walls += other.walls;
    }
}
