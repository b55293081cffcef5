//! Blocks of cells: where there is evidence that something was filled, and what lies near it.

use std::ops::Range;

use super::core::common;
use super::layers::Stretch;
use crate::error::Result;
use crate::grid::Cell;
use crate::grid::context::Context;
use crate::grid::label::overlaps;
use crate::grid::slice::{Bits, Run, Runs, SliceStore, Slices};

/// Cells of a block's side.
pub const BLOCK: u32 = 8;

/// Some blocks of a grid.
#[derive(Debug)]
pub struct Blocks {
    /// A layer of blocks a slice.
    store: SliceStore,
    /// Blocks along x, slices, rows.
    sides: Cell,
}

impl Blocks {
    /// The blocks that hold so many of `cells`, or more, in a grid of `sides`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn with_cells(cells: &SliceStore, least: u32, sides: Cell, context: &Context) -> Result<Blocks> {
        let slices = sides[1];
        let sides = sides.map(|c| c.div_ceil(BLOCK));
        Blocks::layers(sides, context, |layer, bits| {
            let mut counts = vec![0u32; sides[0] as usize * sides[2] as usize];
            let mut runs = Runs::default();
            for y in layer * BLOCK..((layer + 1) * BLOCK).min(slices) {
                cells.read(y, &mut runs)?;
                for z in 0..runs.row_count() {
                    for x in runs.row(z).iter().flat_map(|run| run.start..run.end) {
                        counts[(z / BLOCK * sides[0] + x / BLOCK) as usize] += 1;
                    }
                }
            }
            for (number, _) in counts.iter().enumerate().filter(|(_, count)| **count >= least) {
                bits.set(number as u32 % sides[0], number as u32 / sides[0]);
            }
            Ok(())
        })
    }

    /// These blocks and all that are no farther than `by` blocks from one of them.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn widened(&self, by: u32, context: &Context) -> Result<Blocks> {
        let [width, layers, rows] = self.sides;
        Blocks::layers(self.sides, context, |layer, bits| {
            let mut runs = Runs::default();
            for other in layer.saturating_sub(by)..(layer + by + 1).min(layers) {
                self.store.read(other, &mut runs)?;
                for z in 0..runs.row_count() {
                    for run in runs.row(z) {
                        for row in z.saturating_sub(by)..(z + by + 1).min(rows) {
                            (run.start.saturating_sub(by)..(run.end + by).min(width)).for_each(|x| bits.set(x, row));
                        }
                    }
                }
            }
            Ok(())
        })
    }

    /// Those that are in both.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn both(&self, other: &Blocks, context: &Context) -> Result<Blocks> {
        Blocks::layers(self.sides, context, |layer, bits| {
            let (mut runs, mut others) = (Runs::default(), Runs::default());
            self.store.read(layer, &mut runs)?;
            other.store.read(layer, &mut others)?;
            for z in 0..runs.row_count().min(others.row_count()) {
                common(runs.row(z), others.row(z), |run| (run.start..run.end).for_each(|x| bits.set(x, z)));
            }
            Ok(())
        })
    }

    /// Blocks that `work` sets, layer by layer.
    fn layers(sides: Cell, context: &Context, work: impl Fn(u32, &mut Bits) -> Result<()> + Sync) -> Result<Blocks> {
        let mut store = SliceStore::new(&context.workspace, context.memory.store_quota);
        let mut layers = 0..sides[1];
        context.workers.in_order(
            context.memory.chunks_in_flight,
            || Ok(layers.next()),
            |layer| {
                let (mut bits, mut slices) = (Bits::new(sides[0], sides[2]), Slices::default());
                work(layer, &mut bits)?;
                slices.push(&bits);
                Ok(slices)
            },
            |slices| store.extend(&slices),
        )?;
        Ok(Blocks { store, sides })
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.store.is_empty()
    }

    /// The blocks that some slices of the grid pass through, counted in blocks.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn of_slices(&self, slices: &Range<u32>) -> Result<Stretch> {
        Stretch::read(&self.store, i64::from(slices.start / BLOCK)..i64::from(slices.end.div_ceil(BLOCK)))
    }

    /// The blocks that slice `y` of the grid passes through.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn read(&self, y: u32, runs: &mut Runs) -> Result<()> {
        self.store.read(y / BLOCK, runs)
    }
}

/// Whether the cell at x in row z lies in one of the blocks of a slice.
pub fn holds(blocks: &Runs, x: u32, z: u32) -> bool {
    let block = x / BLOCK;
    blocks.row(z / BLOCK).iter().any(|run| run.start <= block && block < run.end)
}

/// What of the cells `runs` of a slice lies in its blocks.
pub fn within(runs: &Runs, blocks: &Runs) -> Runs {
    let mut left = Runs::default();
    for z in 0..runs.row_count() {
        let row = blocks.row(z / BLOCK);
        let scaled: Vec<Run> = row.iter().map(|run| Run { start: run.start * BLOCK, end: run.end * BLOCK }).collect();
        overlaps(runs.row(z), &scaled, |i, j| {
            let run = runs.row(z)[i];
            left.push_run(run.start.max(scaled[j].start), run.end.min(scaled[j].end));
        });
        left.end_row();
    }
    left
}
