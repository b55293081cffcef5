//! The first look at every triangle: where its vertices lie, what it measures.

use std::ops::Range;

use super::blocks::Blocks;
use super::job::{Check, Scratch};
use crate::error::Result;
use crate::mesh::corners::{fresh, span};
use crate::mesh::measure::{GROUP, Sums, is_degenerate};
use crate::resources::workers::Spares;

/// What the survey knows of the triangles.
pub(super) struct Survey {
    pub blocks: Blocks,
    pub degenerate: u64,
    /// The sums of each group; `None` for a far one until it has been measured.
    pub sums: Vec<Option<Sums>>,
}

impl Check<'_> {
    /// Number of groups.
    pub(super) fn groups(&self) -> usize {
        self.mesh.face_count().div_ceil(GROUP as u64) as usize
    }

    /// Looks at the triangles of groups.
    pub(super) fn survey(
        &self,
        groups: Range<usize>,
        scratch: &Spares<Scratch>,
        progress: &mut dyn FnMut(u64),
    ) -> Result<Survey> {
        let first_group = groups.start;
        let blocks = Blocks::new(self.plan.block);
        let mut survey = Survey { blocks: Blocks::new(self.plan.block), degenerate: 0, sums: Vec::new() };
        let look = |group: usize| {
            scratch.lend(|scratch| {
                let first = self.read_group(first_group + group, &mut scratch.faces)?;
                let spans = blocks.spans(first, &scratch.faces, self.mesh.vertex_count())?;
                let degenerate = scratch.faces.iter().filter(|face| is_degenerate(**face)).count() as u64;
                let wide = |(low, high): (u32, u32)| (high - low) as usize >= self.plan.window;
                if span(&scratch.faces).is_some_and(wide) {
                    return Ok((spans, degenerate, None));
                }
                scratch.corners.fill(self.mesh, &mut scratch.faces, self.plan.window)?;
                Ok((spans, degenerate, Some(Sums::of(&scratch.faces, &scratch.corners.table))))
            })
        };
        self.workers.in_order_range(self.plan.in_flight, groups.len(), look, |(spans, degenerate, sums)| {
            survey.blocks.extend(&spans);
            survey.degenerate += degenerate;
            survey.sums.push(sums);
            progress((survey.sums.len() as u64 * GROUP as u64).min(self.mesh.face_count()));
            Ok(())
        })?;
        Ok(survey)
    }

    /// Measures the groups that the survey left out, of those from `first_group` on, several at once since each batch may read all vertices.
    pub(super) fn measure_far(
        &self,
        first_group: usize,
        sums: &mut [Option<Sums>],
        scratch: &Spares<Scratch>,
    ) -> Result<()> {
        let far: Vec<usize> = (0..sums.len()).filter(|&group| sums[group].is_none()).collect();
        let batches: Vec<&[usize]> = far.chunks((self.plan.far / GROUP).max(1)).collect();
        let measure = |batch: usize| {
            scratch.lend(|scratch| {
                let mut faces = Vec::new();
                for &group in batches[batch] {
                    self.read_group(first_group + group, &mut scratch.faces)?;
                    faces.extend_from_slice(&scratch.faces);
                }
                scratch.corners.fill(self.mesh, &mut faces, self.plan.window)?;
                // Only the mesh's last group may be short, and it is the last of its batch.
                Ok(faces.chunks(GROUP).map(|group| Sums::of(group, &scratch.corners.table)).collect::<Vec<_>>())
            })
        };
        let mut groups = far.iter();
        self.workers.in_order_range(self.plan.in_flight, batches.len(), measure, |measured| {
            // In this order: a zip asks its first side first, and the groups must not lose one to the batch's end.
            for (measured, group) in measured.into_iter().zip(groups.by_ref()) {
                sums[*group] = Some(measured);
            }
            Ok(())
        })
    }

    /// Reads a group of triangles and returns the number of its first.
    fn read_group(&self, group: usize, faces: &mut Vec<[u32; 3]>) -> Result<u64> {
        let first = group as u64 * GROUP as u64;
        fresh(faces, (self.mesh.face_count() - first).min(GROUP as u64) as usize);
        self.mesh.read_faces(first, faces)?;
        Ok(first)
    }
}
