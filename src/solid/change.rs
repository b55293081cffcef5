//! Change: cells are filled, or taken away, slice by slice.

use crate::error::Result;
use crate::grid::Cell;
use crate::grid::context::{Context, chunks};
use crate::grid::label::{Components, Labels, Measure, Scratch};
use crate::grid::slice::{Bits, Run, Runs, SliceStore, Slices};
use crate::solid::{Solid, faces};

/// How cells that have a verdict change the solid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Change {
    /// They are taken away.
    Removed,
    /// They are filled.
    Filled,
}

impl Solid {
    /// The solid with those components filled that `is_filled` names.
    pub(super) fn filled_where<M: Measure>(
        self,
        components: Components<M>,
        is_filled: impl Fn(&M) -> bool,
        context: &Context,
    ) -> Result<Solid> {
        const FILLED: u8 = 1;
        let mut any = false;
        let labels = components.judged(context, |measure| {
            let fills = is_filled(measure);
            any |= fills;
            if fills { FILLED } else { 0 }
        })?;
        if any { self.changed(&labels, FILLED, Change::Filled, context) } else { Ok(self) }
    }

    /// The solid with the groups changed that have a verdict.
    pub(super) fn changed(&self, labels: &Labels, verdict: u8, change: Change, context: &Context) -> Result<Solid> {
        self.with_slices(context, |y, slice, group, scratch: &mut Scratch| match change {
            Change::Filled => labels.paint(y, verdict, slice, scratch),
            Change::Removed => {
                group.clear();
                labels.paint(y, verdict, group, scratch)?;
                slice.and_not(group);
                Ok(())
            }
        })
    }

    /// The solid with some more cells.
    pub(super) fn with(&self, cells: &SliceStore, context: &Context) -> Result<Solid> {
        self.with_slices(context, |y, slice, _, runs: &mut Runs| {
            cells.read(y, runs)?;
            slice.paint(runs, 0, 0);
            Ok(())
        })
    }

    /// The solid without some cells.
    pub(super) fn without(&self, cells: &SliceStore, context: &Context) -> Result<Solid> {
        self.with_slices(context, |y, slice, gone, runs: &mut Runs| {
            cells.paint(y.into(), gone, runs)?;
            slice.and_not(gone);
            Ok(())
        })
    }

    /// The solid with every slice as `change` leaves it, which is given the slice's number, its cells, and room for as many and for its own scratch, both as they were left.
    /// A slice at the end of a chunk is changed twice.
    fn with_slices<S: Default>(
        &self,
        context: &Context,
        change: impl Fn(u32, &mut Bits, &mut Bits, &mut S) -> Result<()> + Sync,
    ) -> Result<Solid> {
        let [width, slices, rows] = self.cells;
        let store = SliceStore::new(&context.workspace, context.memory.store_quota);
        let mut out =
            Solid { cells: self.cells, store, volume: 0, faces: Vec::with_capacity(slices as usize), ground: None };
        let mut jobs = chunks(slices);
        context.workers.in_order(
            context.jobs(1, self.cells),
            || Ok(jobs.next()),
            |chunk| {
                let (mut runs, mut scratch) = (Runs::default(), S::default());
                let mut bits = [(); 3].map(|()| Bits::new(width, rows));
                let [slice, below, room] = &mut bits;
                let (mut volume, mut faces_of, mut out) = (0, Vec::with_capacity(chunk.len()), Slices::default());
                for y in chunk.start.saturating_sub(1)..chunk.end {
                    self.store.paint(y.into(), slice, &mut runs)?;
                    change(y, slice, room, &mut scratch)?;
                    if y >= chunk.start {
                        volume += slice.cell_count();
                        faces_of.push(faces(slice, below));
                        out.push(slice);
                    }
                    std::mem::swap(slice, below);
                }
                Ok((volume, faces_of, out))
            },
            |(volume, faces_of, slices)| {
                out.volume += volume;
                out.faces.extend(faces_of);
                out.store.extend(&slices)
            },
        )?;
        Ok(out)
    }
}

/// The cells of two stores, of which none is in both; a store that ends early has none in the slices that follow.
pub(super) fn together(
    one: &SliceStore,
    other: &SliceStore,
    [_, slices, rows]: Cell,
    context: &Context,
) -> Result<SliceStore> {
    context.slices_of(slices, context.memory.chunks_in_flight, |chunk, slices| {
        let mut runs = Runs::default();
        for y in chunk {
            let mut all: Vec<Vec<Run>> = vec![Vec::new(); rows as usize];
            for store in [one, other].into_iter().filter(|store| y < store.slice_count()) {
                store.read(y, &mut runs)?;
                all.iter_mut().zip(0..runs.row_count()).for_each(|(row, z)| row.extend(runs.row(z)));
            }
            slices.push_runs(&Runs::joined(all));
        }
        Ok(())
    })
}
