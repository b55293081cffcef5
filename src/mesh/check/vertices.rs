//! The second look, vertex by vertex: edges, fans, components, positions.

use std::ops::Range;

use glam::DVec3;

use super::blocks::{Blocks, Stars};
use super::components::{Components, root};
use super::job::{CORNERS, Check, PIECE, Scratch};
use super::link::{Tally, is_simple_cycle};
use crate::error::Result;
use crate::resources::workers::Spares;
use crate::storage::queue::Queue;

/// Blocks may be read this often on average before larger ranges are preferred.
const READS: u64 = 2;

#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds(pub DVec3, pub DVec3);

impl Bounds {
    const EMPTY: Bounds = Bounds(DVec3::INFINITY, DVec3::NEG_INFINITY);

    fn with(self, other: Bounds) -> Bounds {
        Bounds(self.0.min(other.0), self.1.max(other.1))
    }
}

/// What the vertices of a range have shown.
pub(super) struct Found {
    pub tally: Tally,
    pub nonfinite: u64,
    pub bounds: Bounds,
    /// Sets of the range's vertices that are joined by edges within it.
    pub sets: u64,
    /// Sets of edges of one triangle that hang together at vertices.
    pub loops: u64,
    /// Edges of one triangle.
    pub boundary: Vec<[u32; 2]>,
    /// Vertices of sets that hang together with those of other ranges: edges that leave the range upwards, from the root of their lower end's set; and vertices that edges
    /// reach from below, with their set's root, where they are not that themselves.
    pub joins: Vec<[u32; 2]>,
}

impl Found {
    /// Nothing yet.
    pub fn nothing() -> Found {
        Found {
            tally: Tally::default(),
            nonfinite: 0,
            bounds: Bounds::EMPTY,
            sets: 0,
            loops: 0,
            boundary: Vec::new(),
            joins: Vec::new(),
        }
    }

    /// Adds what another range has shown, but for what hangs together.
    pub fn add(&mut self, other: &Found) {
        self.tally.add(&other.tally);
        self.nonfinite += other.nonfinite;
        self.bounds = self.bounds.with(other.bounds);
        self.sets += other.sets;
    }
}

impl Check<'_> {
    /// Vertices per range: few, unless that has every block read many times.
    fn range_len(&self, blocks: &Blocks) -> u32 {
        let (mut range, most) = self.plan.range;
        while range < most && blocks.reads(range) > READS * blocks.count() {
            range = range.saturating_mul(2).min(most);
        }
        range
    }

    /// Number of ranges that so many vertices are looked at in.
    pub(super) fn ranges(&self, blocks: &Blocks, vertices: u64) -> usize {
        vertices.div_ceil(u64::from(self.range_len(blocks))) as usize
    }

    /// Looks at some vertices, range by range, and hands on what each range has shown, in order.
    pub(super) fn vertices(
        &self,
        blocks: &Blocks,
        within: Range<u64>,
        scratch: &Spares<Scratch>,
        mut found: impl FnMut(Found) -> Result<()>,
    ) -> Result<()> {
        let range = u64::from(self.range_len(blocks));
        let look = |number: usize| {
            let start = within.start + number as u64 * range;
            let end = (start + range).min(within.end);
            scratch.lend(|scratch| self.range(blocks, start as u32..end as u32, scratch))
        };
        let ranges = self.ranges(blocks, within.end - within.start);
        self.workers.in_order_range(self.plan.in_flight, ranges, look, &mut found)
    }

    /// All that ranges have shown together; `hand` hands them on, one after the other.
    pub(super) fn together(
        &self,
        hand: impl FnOnce(&mut dyn FnMut(Found) -> Result<()>) -> Result<()>,
    ) -> Result<Found> {
        let vertices = self.mesh.vertex_count();
        let mut components = Components::new(vertices, self.plan.components, self.workspace);
        let mut all = Found::nothing();
        let mut boundary = Queue::new(self.workspace, self.plan.components / 8);
        hand(&mut |found: Found| {
            all.add(&found);
            for [a, b] in found.joins {
                components.join(u64::from(a), u64::from(b))?;
            }
            found.boundary.into_iter().try_for_each(|edge| boundary.push(edge))
        })?;
        all.sets -= components.merges()?;
        if all.tally.boundary > 0 {
            let mut components = Components::new(vertices, self.plan.components, self.workspace);
            boundary.read(|[a, b]| components.join(u64::from(a), u64::from(b)))?;
            all.loops = all.tally.at_boundary - components.merges()?;
        }
        Ok(all)
    }

    fn range(&self, blocks: &Blocks, range: Range<u32>, scratch: &mut Scratch) -> Result<Found> {
        let Scratch { stars, examiner, parents, used, reached, positions, .. } = scratch;
        let len = range.len();
        parents.clear();
        parents.extend(0..len as u32);
        for flags in [&mut *used, reached] {
            flags.clear();
            flags.resize(len, false);
        }
        let (mut tally, mut leaving, mut unions) = (Tally::default(), Vec::new(), 0);

        let records = |_, [a, b, c]: [u32; 3]| [(a, [b, c]), (b, [c, a]), (c, [a, b])];
        stars.visit(self.mesh, blocks, range.clone(), CORNERS * len, records, |v, corners| {
            let own = v - range.start;
            used[own as usize] = true;
            let mut neighbour = |u: u32| {
                if u < range.start {
                    reached[own as usize] = true;
                } else if u >= range.end {
                    leaving.push([v, u]);
                } else if u > v {
                    let (a, b) = (root(parents, own), root(parents, u - range.start));
                    if a != b {
                        parents[a.max(b) as usize] = a.min(b);
                        unions += 1;
                    }
                }
            };
            if is_simple_cycle(corners) {
                tally.used += 1;
                for &[u, _] in &*corners {
                    tally.edges += u64::from(u > v);
                    neighbour(u);
                }
            } else {
                examiner.examine(v, corners, &mut tally, neighbour);
            }
        })?;

        for edge in &mut leaving {
            edge[0] = root(parents, edge[0] - range.start) + range.start;
        }
        leaving.sort_unstable();
        leaving.dedup();
        let mut joins = leaving;
        // A vertex that is reached but not a root is one more node there, and one that is merged at once.
        let mut sets = tally.used - unions;
        for own in (0..len as u32).filter(|&own| reached[own as usize]) {
            let to = root(parents, own);
            if to != own {
                joins.push([own + range.start, to + range.start]);
                sets += 1;
            }
        }
        let (nonfinite, bounds) = self.positions(&range, used, positions)?;
        let boundary = std::mem::take(&mut examiner.boundary);
        Ok(Found { nonfinite, bounds, sets, loops: 0, boundary, tally, joins })
    }

    /// Counts the range's vertices that are not finite; the box holds the others that are used.
    fn positions(&self, range: &Range<u32>, used: &[bool], piece: &mut Vec<[f64; 3]>) -> Result<(u64, Bounds)> {
        let (mut nonfinite, mut bounds) = (0, Bounds::EMPTY);
        for (used, first) in used.chunks(PIECE).zip((u64::from(range.start)..).step_by(PIECE)) {
            piece.resize(used.len(), [0.0; 3]);
            self.mesh.read_vertices(first, piece)?;
            for (&position, &used) in piece.iter().zip(used) {
                let position = DVec3::from_array(position);
                if !position.is_finite() {
                    nonfinite += 1;
                } else if used {
                    bounds = bounds.with(Bounds(position, position));
                }
            }
        }
        Ok((nonfinite, bounds))
    }

    /// Sound triangles less sets of triangles that hang together by edges: exact where a vertex with several fans
    /// would wrongly tie these together.
    pub(super) fn merges_by_edges(&self, blocks: &Blocks) -> Result<u64> {
        let vertices = self.mesh.vertex_count();
        // Edges with their triangles take about twice the room of corners.
        let range = (self.range_len(blocks) / 2).max(1);
        let ranges = vertices.div_ceil(u64::from(range)) as usize;
        let mut components = Components::new(self.mesh.face_count(), self.plan.components, self.workspace);
        let look = |number: usize| {
            let start = number as u64 * u64::from(range);
            let end = (start + u64::from(range)).min(vertices);
            let side = |face, a: u32, b: u32| (a.min(b), (a.max(b), face));
            let sides = |face, [a, b, c]: [u32; 3]| [side(face, a, b), side(face, b, c), side(face, c, a)];
            let (mut stars, mut joins) = (Stars::<(u32, u64)>::default(), Vec::new());
            stars.visit(self.mesh, blocks, start as u32..end as u32, CORNERS * range as usize, sides, |_, edges| {
                edges.sort_unstable();
                let of_one_edge = edges.windows(2).filter(|pair| pair[0].0 == pair[1].0);
                joins.extend(of_one_edge.map(|pair| [pair[0].1, pair[1].1]));
            })?;
            Ok(joins)
        };
        self.workers.in_order_range(self.plan.in_flight, ranges, look, |joins| {
            joins.into_iter().try_for_each(|[a, b]| components.join(a, b))
        })?;
        components.merges()
    }
}
