//! Components: parts of the solid that hang together by faces; small ones are left out.
//!
//! The solid's runs are labelled slice by slice ([`crate::grid::label`]), with their cells counted along the way.

use crate::error::Result;
use crate::grid::context::{Context, chunks};
use crate::grid::label::{Cells, Labeller, Parts, Scratch, overlaps};
use crate::grid::occupancy::{Occupancy, Raster};
use crate::grid::slice::{Run, Runs, SliceStore, Slices};
use crate::settings::closing::Least;
use crate::solid::Solid;

impl Least {
    /// The least number of cells, where the largest component has `largest`.
    pub(super) fn cells(self, largest: u64) -> u64 {
        match self {
            Least::Auto => SPECK.min(largest.div_ceil(SHARE)),
            Least::Cells(cells) => cells,
            Least::Share(share) => (share * largest as f64).ceil() as u64,
            Least::Largest => largest,
        }
    }
}

/// Components of fewer cells are specks.
pub const SPECK: u64 = 64;

/// So many times as large as a speck is the largest component, at the least.
const SHARE: u64 = 1000;

/// Specks are less than this part of all cells.
pub(super) const FEW: u64 = 50;

/// What was found and left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct Components {
    /// Components before.
    pub found: u64,
    /// Components left out.
    pub dropped: u64,
    /// Their cells.
    pub dropped_cells: u64,
    /// Cells of the largest.
    pub largest: u64,
}

/// The verdicts.
const DROPPED: u8 = 0;
const KEPT: u8 = 1;

/// The solid without its small components, and the occupied cells that lie in those that are kept: points of others do not
/// count any more. The solid's counts of faces stay those before: an upper bound.
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::Interrupted`].
pub fn keep(
    solid: Solid,
    occupancy: Occupancy,
    least: Least,
    context: &Context,
) -> Result<(Solid, Occupancy, Components)> {
    let slices = solid.cells[1];
    let mut labeller = Labeller::new(context);
    let mut jobs = chunks(slices);
    context.workers.in_order(
        context.memory.chunks_in_flight,
        || Ok(jobs.next()),
        |chunk| {
            let read = |y| {
                let mut runs = Runs::default();
                solid.store.read(y, &mut runs)?;
                Ok(runs)
            };
            let slices = chunk.map(read).collect::<Result<Vec<Runs>>>()?;
            Ok(Parts::of(slices, |_, _, run| Cells(u64::from(run.end - run.start))))
        },
        |parts| labeller.add(parts),
    )?;
    let labelled = labeller.finish()?;
    let mut components = Components::default();
    labelled.for_each(|cells| {
        components.found += 1;
        components.largest = components.largest.max(cells.0);
    })?;
    let mut limit = least.cells(components.largest);
    if least == Least::Auto {
        let mut specks = 0;
        labelled.for_each(|cells| specks += if cells.0 < limit { cells.0 } else { 0 })?;
        if FEW * specks >= solid.volume {
            limit = 0;
        }
    }
    let labels = labelled.judged(context, |cells| {
        if cells.0 >= limit {
            return KEPT;
        }
        components.dropped += 1;
        components.dropped_cells += cells.0;
        DROPPED
    })?;

    let mut store = SliceStore::new(&context.workspace, context.memory.store_quota);
    let mut left = Occupancy::new(occupancy.cells, context);
    let (mut volume, mut jobs) = (0, chunks(slices));
    context.workers.in_order(
        context.memory.chunks_in_flight,
        || Ok(jobs.next()),
        |chunk| {
            let (mut occupied, mut scratch) = (Runs::default(), Scratch::default());
            let mut rows: Vec<Vec<Run>> = vec![Vec::new(); solid.cells[2] as usize];
            let (mut volume, mut out) = (0, (Slices::default(), Raster::default()));
            for y in chunk {
                rows.iter_mut().for_each(Vec::clear);
                labels.for_each(y, &mut scratch, |z, run, verdict| {
                    if verdict == KEPT {
                        rows[z as usize].push(run);
                    }
                })?;
                occupancy.store.read(y, &mut occupied)?;
                let (mut solid_left, mut occupied_left) = (Runs::default(), Runs::default());
                for (row, z) in rows.iter().zip(0..) {
                    row.iter().for_each(|run| solid_left.push_run(run.start, run.end));
                    // Not all of a run is solid: lone cells and spikes were left out.
                    overlaps(occupied.row(z), row, |i, j| {
                        let run = occupied.row(z)[i];
                        occupied_left.push_run(run.start.max(row[j].start), run.end.min(row[j].end));
                    });
                    solid_left.end_row();
                    occupied_left.end_row();
                }
                volume += solid_left.cell_count();
                out.0.push_runs(&solid_left);
                out.1.push_runs(&occupied_left);
            }
            Ok((volume, out))
        },
        |(cells, (solid_left, occupied_left))| {
            volume += cells;
            store.extend(&solid_left)?;
            left.append(&occupied_left)
        },
    )?;
    Ok((Solid { store, volume, ..solid }, left, components))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_said_in_three_ways() {
        assert_eq!("largest".parse(), Ok(Least::Largest));
        assert_eq!("2.5%".parse(), Ok(Least::Share(0.025)));
        assert_eq!("100".parse(), Ok(Least::Cells(100)));
        for wrong in ["", "%", "101%", "-1%", "-3", "1.5", "Largest", "nan%"] {
            assert!(wrong.parse::<Least>().is_err(), "{wrong}");
        }
        let cells = [Least::Cells(7), Least::Share(0.025), Least::Share(0.0), Least::Largest].map(|l| l.cells(100));
        assert_eq!(cells, [7, 3, 0, 100]);
    }
}
