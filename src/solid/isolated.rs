//! Lone cells: a solid cell that hangs on a body by an edge or a corner only is left out.
//!
//! ```text
//!     . # .        The surface keeps solid cells apart that share no face (see `corner`), so such a cell would become a
//!     # . .        separate speck of four triangles. It is left out if a cell it touches shares a face with another;
//!     # # .        cells with no such neighbour stay: every point alone keeps its speck.
//! ```
//!
//! The point of a dropped cell stays a point that vertices are fitted to.

use crate::error::Result;
use crate::grid::context::{Context, chunks};
use crate::grid::slice::{Run, Runs, SliceStore, Slices};
use crate::solid::Solid;

impl Solid {
    /// The same solid without lone cells that touch a larger body. The counts of faces stay those before: an upper bound.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn without_isolated_cells(self, context: &Context) -> Result<Solid> {
        let mut store = SliceStore::new(&context.workspace, context.memory.store_quota);
        let (mut volume, slices) = (0, self.cells[1]);
        let mut jobs = chunks(slices);
        context.workers.in_order(
            context.memory.chunks_in_flight,
            || Ok(jobs.next()),
            |chunk| {
                let first = chunk.start.saturating_sub(2);
                let mut held = Vec::new();
                for y in first..(chunk.end + 2).min(slices) {
                    let mut runs = Runs::default();
                    self.store.read(y, &mut runs)?;
                    held.push(runs);
                }
                let around = Around { slices: held };
                let (mut volume, mut slices) = (0, Slices::default());
                for y in chunk {
                    let slice = around.filtered((y - first) as usize);
                    volume += slice.cell_count();
                    slices.push_runs(&slice);
                }
                Ok((volume, slices))
            },
            |(cells, slices)| {
                volume += cells;
                store.extend(&slices)
            },
        )?;
        Ok(Solid { store, volume, ..self })
    }
}

/// Consecutive slices of runs.
struct Around {
    slices: Vec<Runs>,
}

impl Around {
    /// Slice `y` without its lone cells that touch a larger body.
    fn filtered(&self, y: usize) -> Runs {
        let slice = &self.slices[y];
        let mut out = Runs::default();
        for z in 0..slice.row_count() {
            for run in slice.row(z) {
                let cell = [i64::from(run.start), y as i64, i64::from(z)];
                // Only a run of one cell can be a lone cell.
                let dropped = run.end - run.start == 1 && self.is_lone(cell) && self.touches_a_body(cell);
                if !dropped {
                    out.push_run(run.start, run.end);
                }
            }
            out.end_row();
        }
        out
    }

    fn is_solid(&self, [x, y, z]: [i64; 3]) -> bool {
        if x < 0 || y < 0 || z < 0 || y >= self.slices.len() as i64 {
            return false;
        }
        let slice = &self.slices[y as usize];
        if z >= i64::from(slice.row_count()) {
            return false;
        }
        let row: &[Run] = slice.row(z as u32);
        let after = row.partition_point(|run| i64::from(run.start) <= x);
        after > 0 && i64::from(row[after - 1].end) > x
    }

    fn is_lone(&self, cell: [i64; 3]) -> bool {
        (0..3).all(|a| {
            [-1, 1].iter().all(|step| {
                let mut next = cell;
                next[a] += step;
                !self.is_solid(next)
            })
        })
    }

    fn touches_a_body(&self, [x, y, z]: [i64; 3]) -> bool {
        (-1..=1).any(|dy| {
            (-1..=1).any(|dz| {
                (-1..=1).any(|dx| {
                    let next = [x + dx, y + dy, z + dz];
                    self.is_solid(next) && !self.is_lone(next)
                })
            })
        })
    }
}
