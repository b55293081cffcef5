//! The check in shares, each of which another process may look at: first at its triangles, then, when all of these are known, at its vertices.
//!
//! ```text
//!  measure   a share's triangles: which vertices each block names, area and volume       needs nothing
//!  look      a share's vertices: edges, fans, sets that hang together, positions         needs what all triangles were found to name
//!  conclude  what no share shows alone: components, boundary loops, the sums             needs all of both
//! ```

use std::ops::Range;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::blocks::Blocks;
use super::job::{Check, Plan};
use super::link::Tally;
use super::report::CheckReport;
use super::survey::Survey;
use super::vertices::{Bounds, Found};
use crate::error::Result;
use crate::mesh::measure::Sums;
use crate::mesh::{MeshSource, check_vertex_count};
use crate::resources::workers::{Spares, Workers};
use crate::storage::spool::{Extent, Spool, Workspace};

/// One of so many shares of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Share {
    pub number: usize,
    pub of: usize,
}

impl Share {
    /// What it has of `count` things that lie in a row.
    fn within(self, count: usize) -> Range<usize> {
        let end = |number: usize| (count as u128 * number as u128 / self.of as u128) as usize;
        end(self.number)..end(self.number + 1)
    }
}

/// Pairs that are read at a time.
const TOGETHER: usize = 1 << 14;

/// What a share's triangles have shown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Measured {
    /// The least and the greatest number of a vertex that a block names.
    spans: Vec<(u32, u32)>,
    degenerate: u64,
    /// The bits of the sums of each group.
    sums: Vec<[u64; 8]>,
}

/// What a share's vertices have shown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Looked {
    tally: Tally,
    nonfinite: u64,
    /// Bits, as a box of nothing is infinite.
    bounds: [[u64; 3]; 2],
    sets: u64,
    /// Where pairs of vertices lie, in a file each: those that hang together, and edges of one triangle.
    pub pairs: [Extent; 2],
}

/// What a check takes: memory, workers, a folder.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Means<'a> {
    pub budget: u64,
    pub workers: &'a Workers,
    pub workspace: &'a Workspace,
}

impl Means<'_> {
    fn check<'c>(&'c self, mesh: &'c dyn MeshSource) -> Check<'c> {
        let plan = Plan::for_near(self.budget, mesh, self.workers.threads());
        Check { mesh, plan, workers: self.workers, workspace: self.workspace }
    }
}

/// Looks at a share's triangles.
///
/// # Errors
/// The same as [`super::check`].
pub(crate) fn measure(
    mesh: &dyn MeshSource,
    share: Share,
    means: Means<'_>,
    progress: &mut dyn FnMut(u64),
) -> Result<Measured> {
    check_vertex_count(mesh.vertex_count())?;
    let check = means.check(mesh);
    let survey = check.survey(share.within(check.groups()), progress)?;
    let sums = survey.sums.into_iter().map(|sums| sums.numbers().map(f64::to_bits)).collect();
    Ok(Measured { spans: survey.blocks.all().to_vec(), degenerate: survey.degenerate, sums })
}

/// Looks at a share's vertices. Pairs of vertices, which may be many, are appended to `out`: those that hang together, and edges of one triangle. `progress` is told the vertices
/// that are looked at.
///
/// # Errors
/// The same as [`super::check`].
pub(crate) fn look(
    mesh: &dyn MeshSource,
    share: Share,
    measured: &[Measured],
    means: Means<'_>,
    out: &mut [Spool; 2],
    progress: &mut dyn FnMut(u64),
) -> Result<Looked> {
    let (check, scratch) = (means.check(mesh), Spares::default());
    let Survey { blocks, .. } = surveyed(&check, measured);
    let within = share.within(mesh.vertex_count() as usize);
    let within = within.start as u64..within.end as u64;
    let (mut all, mut done) = (Found::nothing(), 0);
    let (vertices, ranges) = (within.end - within.start, check.ranges(&blocks, within.end - within.start) as u64);
    check.vertices(&blocks, within, &scratch, |found| {
        all.add(&found);
        for (out, pairs) in out.iter_mut().zip([&found.joins, &found.boundary]) {
            out.append(bytemuck::cast_slice(pairs))?;
        }
        done += 1;
        progress(vertices * done / ranges);
        Ok(())
    })?;
    let Found { tally, nonfinite, bounds: Bounds(low, high), sets, .. } = all;
    let bounds = [low, high].map(|corner| corner.to_array().map(f64::to_bits));
    let [joins, boundary] = out;
    Ok(Looked { tally, nonfinite, bounds, sets, pairs: [joins.extent(), boundary.extent()] })
}

/// What all shares have shown together, which is what [`super::check`] finds; with each share's files.
///
/// # Errors
/// The same as [`super::check`]; those of reading what shares have shown.
pub(crate) fn conclude(
    mesh: &dyn MeshSource,
    measured: &[Measured],
    looked: impl Iterator<Item = Result<(Looked, [Spool; 2])>>,
    means: Means<'_>,
) -> Result<CheckReport> {
    let check = means.check(mesh);
    let found = check.together(|hand| {
        for looked in looked {
            let (Looked { tally, nonfinite, bounds, sets, pairs }, files) = looked?;
            let [low, high] = bounds.map(|corner| DVec3::from_array(corner.map(f64::from_bits)));
            let found = Found::nothing();
            hand(Found { tally, nonfinite, bounds: Bounds(low, high), sets, ..found })?;
            for (kind, (file, Extent { from, to, .. })) in files.iter().zip(pairs).enumerate() {
                for first in (from..to).step_by(TOGETHER * size_of::<[u32; 2]>()) {
                    let count = ((to - first) as usize / size_of::<[u32; 2]>()).min(TOGETHER);
                    let mut some = vec![[0; 2]; count];
                    file.read_at(first, bytemuck::cast_slice_mut(&mut some))?;
                    let found = Found::nothing();
                    hand(if kind == 0 { Found { joins: some, ..found } } else { Found { boundary: some, ..found } })?;
                }
            }
        }
        Ok(())
    })?;
    check.report(&surveyed(&check, measured), found)
}

fn surveyed(check: &Check<'_>, measured: &[Measured]) -> Survey {
    let mut blocks = Blocks::new(check.plan.block);
    measured.iter().for_each(|measured| blocks.put(blocks.count() as usize, &measured.spans));
    let sums = measured.iter().flat_map(|measured| &measured.sums);
    Survey {
        blocks,
        degenerate: measured.iter().map(|measured| measured.degenerate).sum(),
        sums: sums.map(|bits| Sums::of_numbers(bits.map(f64::from_bits))).collect(),
    }
}
