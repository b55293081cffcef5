//! The first look at every triangle: where its vertices lie, what it measures.

use std::ops::Range;

use super::blocks::Blocks;
use super::job::Check;
use crate::error::Result;
use crate::mesh::corners::{Block, Lookup, Order};
use crate::mesh::measure::{GROUP, Sums, is_degenerate};

/// What the survey knows of the triangles.
pub(super) struct Survey {
    pub blocks: Blocks,
    pub degenerate: u64,
    /// The sums of each group.
    pub sums: Vec<Sums>,
}

impl Check<'_> {
    /// Number of groups.
    pub(super) fn groups(&self) -> usize {
        self.mesh.face_count().div_ceil(GROUP as u64) as usize
    }

    /// Looks at the triangles of groups.
    pub(super) fn survey(&self, groups: Range<usize>, progress: &mut dyn FnMut(u64)) -> Result<Survey> {
        let lookup = Lookup {
            mesh: self.mesh,
            workers: self.workers,
            workspace: self.workspace,
            block: GROUP,
            window: self.plan.window,
            in_flight: self.plan.in_flight,
            memory: self.plan.far,
        };
        let blocks = Blocks::new(self.plan.block);
        let (mut all, mut degenerate) = (Blocks::new(self.plan.block), 0);
        let mut sums = vec![Sums::NONE; groups.len()];
        let look = |group: &Block<'_, [f64; 3]>| {
            let degenerate = group.vertices.iter().filter(|face| is_degenerate(**face)).count() as u64;
            Ok((group.number, blocks.spans(group.vertices), degenerate, Sums::of(group.local, group.table)))
        };
        let read = |first: u64, positions: &mut [[f64; 3]]| self.mesh.read_vertices(first, positions);
        let range = groups.start as u64..groups.end as u64;
        let mut done = 0;
        lookup.for_each(range, Order::NearFirst, &read, look, |(number, spans, repeated, measured)| {
            let group = number as usize - groups.start;
            all.put(group * (GROUP / self.plan.block), &spans);
            degenerate += repeated;
            sums[group] = measured;
            done += GROUP as u64;
            progress(done.min(self.mesh.face_count()));
            Ok(())
        })?;
        Ok(Survey { blocks: all, degenerate, sums })
    }
}
