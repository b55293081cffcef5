//! Clefts: slots so narrow that the points of both walls share cells.
//!
//! No free cell lies between such walls, so the winding number has nothing to open there. But the points of these cells lie where no outside is near, and what was measured there was
//! seen. A second layer of points, of a scan that does not fit, is hidden below the first one, too; but there, the outside is behind the first layer. The walls of a cleft are *deep*: along
//! their normals, there is nothing but solid for a good way.
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
use super::wall::{DEPTH, HIDDEN, THIN, Wall};
use super::{Blocks, OPEN, Reopening, Slabs};
use crate::error::Result;
use crate::grid::label::Measure;
use crate::grid::slice::SliceStore;
use crate::solid::Solid;
use crate::solid::change::Change;

/// A wall's cell with so many hidden walls among the cells round it belongs to a cleft.
const BESIDE: u32 = 3;

/// So many hidden walls of a cleft are deep, at the least: fewer are strays.
const LEAST: u32 = 8;

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
        let clefts = self.slabs.clefts(&solid, &self.planes, self.thickened)?;
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
        &self,
        solid: &Solid,
        walls: &Layers<Wall>,
        thickened: Option<&SliceStore>,
    ) -> Result<SliceStore> {
        let walls = self.seen(solid, walls)?;
        let groups = self.parts(
            |chunk, found| {
                let held = self.held(&walls, chunk, 1)?;
                let solid = Slabs::stretch(&solid.store, chunk, DEPTH)?;
                let thickened = thickened.map(|store| Slabs::stretch(store, chunk, 1)).transpose()?;
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
                            let is_deep = is_hidden && wall.is_deep(cell, &solid);
                            cells.push((cell, Hidden { walls: is_hidden.into(), deep: is_deep.into() }));
                        }
                    }
                }
                // They are taken row by row.
                cells.sort_by_key(|([_, _, z], _)| *z);
                cells.into_iter().for_each(|(cell, hidden)| found.push(cell, hidden));
                Ok(())
            },
            |hidden| hidden,
        )?;
        let labels = groups.judged(self.context, |group| u8::from(group.is_cleft()))?;
        let clefts = self.judged(&labels, None)?;
        if clefts.is_empty() {
            return Ok(clefts);
        }
        solid.growth(self.context.no_cells(), &clefts, Change::Removed, self.context)
    }
}

/// The hidden walls of a group, and how many of them are deep.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(C)]
struct Hidden {
    walls: u32,
    deep: u32,
}

impl Hidden {
    /// Half of a cleft's hidden walls are deep, or more.
    fn is_cleft(self) -> bool {
        self.deep >= LEAST && 2 * self.deep >= self.walls
    }
}

impl Measure for Hidden {
    fn add(&mut self, other: &Hidden) {
        self.walls += other.walls;
        self.deep += other.deep;
    }
}
