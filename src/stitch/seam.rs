//! The seam between two slabs: phase 2 of contraction, the choice between vertices of both on one point, and what retreat needs to see of the two.

use std::collections::BTreeSet;
use std::hash::Hash;
use std::ops::{Range, RangeInclusive};

use rustc_hash::FxHashMap;

use crate::grid::Grid;
use crate::grid::partition::TRAVEL;
use crate::mesh::spool::Frame;
use crate::points::{Coordinate, bits};
use crate::stitch::numbers::{BEFORE, InSlab, Named};
use crate::stitch::reach::{Reach, SeamReport};
use crate::stitch::slab::SlabMesh;
use crate::storage::seeds::SeededMap;
use crate::surface::contract::{Groups, NONE, Stars, contract, is_gone};
use crate::surface::untangle::broad_phase::{BLOCK, TriangleSet};
use crate::surface::untangle::cluster;
use crate::surface::untangle::quantized::{PackedBox, QuantizedPoint, Quantizer};
use crate::surface::untangle::submesh::Submesh;
use crate::surface::vertex_state::VertexState;

/// The two slabs at a seam, seen as one mesh.
///
/// Vertices of the lower slab keep their numbers, those of the upper one follow them, as they do in the lower one's triangles; of those of the slabs
/// beyond, nothing is known. The upper slab's triangles follow the lower one's, from a whole block on.
#[derive(Debug)]
pub struct Seam<'a, T> {
    lower: &'a mut SlabMesh<T>,
    upper: &'a mut SlabMesh<T>,
    /// The lower slab's first so many vertices must stay as they are.
    frozen: u32,
    frame: Frame,
    quantizer: Quantizer,
    /// Both slabs' blocks.
    blocks: Vec<PackedBox>,
    reach: Reach,
}

impl<'a, T: Coordinate> Seam<'a, T> {
    /// The seam of two slabs, with the first `frozen` vertices of the lower one to stay as they are.
    pub fn of(
        lower: &'a mut SlabMesh<T>,
        upper: &'a mut SlabMesh<T>,
        frozen: u32,
        frame: Frame,
        quantizer: Quantizer,
    ) -> Seam<'a, T> {
        let mut blocks = std::mem::take(&mut lower.blocks);
        blocks.append(&mut upper.blocks);
        Seam { lower, upper, frozen, frame, quantizer, blocks, reach: Reach::default() }
    }

    /// Gives the upper slab its blocks' boxes: it is the next seam's lower one. Those of the lower one are no longer needed.
    pub fn give_back_blocks(&mut self) {
        self.upper.blocks = self.blocks.split_off(self.lower.triangles.len().div_ceil(BLOCK));
    }

    /// How the seam was closed, in so many rounds of retreat, if of the lower slab's vertices the first `settled` are touched by the seam before or named by the slab before.
    /// And how many of the upper slab's first vertices are touched now.
    pub fn report(&self, rounds: u32, settled: u32) -> (SeamReport, u32) {
        let plane = |v: u32| {
            let (slab, v) = self.place_of(v);
            slab.plane_of(v)
        };
        let planes = |range: RangeInclusive<u32>| [plane(*range.start()), plane(*range.end())];
        let [read, changed] = [self.reach.all_read(), self.reach.all_changed()];
        let apart = read.as_ref().is_none_or(|read| settled <= *read.start());
        let touched = self.reach.highest_touched().and_then(|v| v.checked_sub(self.lower.own())).map_or(0, |v| v + 1);
        let report = SeamReport {
            plane: self.upper.slices.start,
            read: read.map(planes),
            changed: changed.map(planes),
            rounds,
            clean: apart && !self.reach.has_read_beyond(),
        };
        (report, touched)
    }

    /// The number of the upper slab's first triangle.
    #[inline]
    fn upper_triangles(&self) -> u32 {
        self.lower.triangles.len().next_multiple_of(BLOCK) as u32
    }

    /// The slab that a vertex is of, and its number there. It counts as read.
    #[inline]
    fn slab_of(&self, v: u32) -> (&SlabMesh<T>, InSlab) {
        self.reach.read(v);
        self.place_of(v)
    }

    fn place_of(&self, v: u32) -> (&SlabMesh<T>, InSlab) {
        if v < self.lower.own() { (self.lower, InSlab(v)) } else { (self.upper, InSlab(v - self.lower.own())) }
    }

    fn slab_of_mut(&mut self, v: u32) -> (&mut SlabMesh<T>, InSlab) {
        if v < self.lower.own() { (self.lower, InSlab(v)) } else { (self.upper, InSlab(v - self.lower.own())) }
    }

    /// The number here of a vertex of the upper slab.
    fn of_upper(&self, v: InSlab) -> u32 {
        self.lower.own() + v.0
    }

    /// The number here of what the upper slab calls `name`, and the reverse.
    #[inline]
    fn named_by_upper(&self, name: u32) -> u32 {
        match self.upper.named(name) {
            Named::Before(InSlab(v)) => v,
            // Those of the slab beyond follow the upper one's.
            Named::Own(_) | Named::Next(_) => self.lower.own() + name,
        }
    }

    fn name_to_upper(&self, v: u32) -> u32 {
        if v < self.lower.own() { BEFORE + v } else { v - self.lower.own() }
    }

    /// The triangles that are left at a cluster.
    fn triangles_at(&self, v: u32) -> impl Iterator<Item = u32> {
        let corners = cluster(self, v).flat_map(|member| self.corners(member));
        corners.map(|corner| corner / 3).filter(|&t| !is_gone(self.triangle(t)))
    }

    /// The triangles at vertices, whose places are known.
    pub fn triangles_around(&self, vertices: Vec<u32>) -> Vec<u32> {
        let mut out: Vec<u32> = vertices.into_iter().flat_map(|v| self.triangles_at(v)).collect();
        out.sort_unstable();
        out.dedup();
        out.retain(|&t| self.is_known(self.triangle(t)));
        out
    }

    /// Takes note that all vertices on so many planes on either side of the seam are read.
    fn read_near(&self, planes: u32) {
        let lowest = self.lower.on_highest(planes).next().map(|InSlab(v)| v);
        let highest = self.upper.on_lowest(planes).next_back().map(|v| self.of_upper(v));
        lowest.into_iter().chain(highest).for_each(|v| self.reach.read(v));
    }

    /// The vertices of either slab that have come to the other's side of the plane: only their triangles, and those on the plane, can meet the other
    /// slab's.
    pub fn strayed(&self, grid: &Grid) -> Vec<u32> {
        let plane = f64::from(self.upper.slices.start);
        self.read_near(TRAVEL);
        // In cells; what is just about on the plane counts as beyond it, whichever way it was rounded.
        let height = |slab: &SlabMesh<T>, v: InSlab| grid.height_of(slab.position(v)) - plane;
        let lives = |slab: &SlabMesh<T>, v: &InSlab| slab.state[v.at()] != VertexState::Contracted;
        let of_lower = self.lower.on_highest(TRAVEL).filter(|v| lives(self.lower, v) && height(self.lower, *v) > -0.01);
        let of_upper = self.upper.on_lowest(TRAVEL).filter(|v| lives(self.upper, v) && height(self.upper, *v) < 0.01);
        of_lower.map(|InSlab(v)| v).chain(of_upper.map(|v| self.of_upper(v))).collect()
    }

    /// The vertex's point as something to compare ([`bits`]). None if it has none, has gone back, or is of a slab beyond.
    fn point(&self, v: u32) -> Option<[u64; 3]> {
        if !self.is_known([v; 3]) {
            return None;
        }
        let (slab, v) = self.slab_of(v);
        slab.state[v.at()].is_on_point().then(|| bits(slab.fitted.target[v.at()]))
    }

    fn distance(&self, v: u32) -> f64 {
        let (slab, v) = self.slab_of(v);
        slab.distance(v)
    }

    /// Phase 2: contracts the vertices that edges between vertices of the same point join to the seam's plane. Gives the vertices whose triangles it
    /// changed, and those on the plane.
    pub fn close(&mut self) -> Vec<u32> {
        let own = self.lower.own();
        let mut joined: BTreeSet<u32> = BTreeSet::new();
        for start in own..own + self.upper.seam() {
            let Some(point) = self.point(start) else { continue };
            let mut open = vec![start];
            while let Some(v) = open.pop() {
                // A vertex alone on its point is not worth carrying along: it is added once a second one is found.
                for triangle in self.triangles_at(v) {
                    for u in self.triangle(triangle) {
                        if u != v && self.point(u) == Some(point) {
                            joined.insert(v);
                            if joined.insert(u) {
                                open.push(u);
                            }
                        }
                    }
                }
            }
        }
        let mut changed: Vec<u32> = (own..own + self.upper.seam()).collect();
        for (dead, survivor) in self.contractions(&joined) {
            let mut last = dead;
            let mut member = dead;
            while member != NONE {
                last = member;
                let also = self.also(member);
                self.put(member, survivor, also, VertexState::Contracted);
                member = also;
            }
            self.put(last, survivor, self.also(survivor), VertexState::Contracted);
            self.put(survivor, survivor, dead, self.state(survivor));
            changed.push(survivor);
        }
        changed.retain(|&v| self.state(v) != VertexState::Contracted);
        changed
    }

    /// The contractions (dead, survivor) among the joined vertices, in order.
    fn contractions(&self, joined: &BTreeSet<u32>) -> Vec<(u32, u32)> {
        if joined.is_empty() {
            return Vec::new();
        }
        // The stars of the joined vertices, as a mesh of their own; its vertices are numbered in the order of the whole mesh's.
        let mut patch: Vec<u32> = joined.iter().flat_map(|&v| self.triangles_at(v)).collect();
        patch.sort_unstable();
        patch.dedup();
        let mut vertices: Vec<u32> = patch.iter().flat_map(|&t| self.triangle(t)).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let local: FxHashMap<u32, u32> = vertices.iter().enumerate().map(|(i, v)| (*v, i as u32)).collect();
        // Looked up only, and numbered in the order of vertices.
        let mut points: SeededMap<[u64; 3], u32> = SeededMap::default();
        let mut group = Vec::with_capacity(vertices.len());
        for &v in &vertices {
            match self.point(v).filter(|_| joined.contains(&v)) {
                Some(point) => {
                    let number = points.len() as u32;
                    group.push(*points.entry(point).or_insert(number));
                }
                None => group.push(NONE),
            }
        }
        let mut triangles: Vec<[u32; 3]> = patch.iter().map(|&t| self.triangle(t).map(|v| local[&v])).collect();
        let mut stars = Stars::new(&triangles, vertices.len(), vertices.len(), Stars::default());
        let is_trimmed = !(self.lower.kept.is_empty() && self.upper.kept.is_empty());
        let kept: Vec<bool> = patch.iter().filter(|_| is_trimmed).map(|&t| self.is_kept(t)).collect();
        let distance = |v: u32| self.distance(vertices[v as usize]);
        let groups = Groups { group: &group, distance, kept: &kept };
        let mut out = Vec::new();
        contract(&mut triangles, &mut stars, groups, |dead, survivor| {
            out.push((vertices[dead as usize], vertices[survivor as usize]));
        });
        out
    }

    /// Of some vertices of a slab, those that took the place of a point near the seam, by where the point lies: lower than the two slices at the seam, in them,
    /// higher. Of the upper slab there are hardly any of the first, of the lower one hardly any of the last, so that few have to be compared.
    fn fitted_near(
        &self,
        mesh: &SlabMesh<T>,
        vertices: impl Iterator<Item = InSlab>,
        grid: &Grid,
        halo: u32,
    ) -> [Vec<InSlab>; 3] {
        let seam = self.upper.slices.start;
        // A vertex of the other slab can have the same point only if the point lies this near to the seam, and a vertex lies as near to its point.
        let near = seam.saturating_sub(halo)..seam + halo;
        let mut out: [Vec<InSlab>; 3] = Default::default();
        let took = |v: &InSlab| matches!(mesh.state[v.at()], VertexState::Fitted | VertexState::Creased(_));
        for v in vertices.filter(took) {
            let slice = grid.slice_of(mesh.fitted.target[v.at()].map(Into::into));
            if near.contains(&slice) {
                out[usize::from(slice + 1 >= seam) + usize::from(slice > seam)].push(v);
            }
        }
        out
    }

    /// Where vertices of both slabs took the same point's place, only the nearer keeps it. Gives the others.
    pub fn choose_fitted(&mut self, grid: &Grid, halo: u32) -> Vec<u32> {
        self.read_near(2 * halo);
        let below = self.fitted_near(self.lower, self.lower.on_highest(2 * halo), grid, halo);
        let above = self.fitted_near(self.upper, self.upper.on_lowest(2 * halo), grid, halo);
        let mut changed = Vec::new();
        for (below, above) in below.into_iter().zip(above) {
            let below = below.into_iter().map(|v| (bits(self.lower.fitted.target[v.at()]), v));
            let above = above.into_iter().map(|v| (bits(self.upper.fitted.target[v.at()]), v));
            for (v, u) in common(below, above) {
                if self.upper.distance(u) < self.lower.distance(v) {
                    changed.push(v.0);
                } else {
                    changed.push(self.of_upper(u));
                }
            }
        }
        for &v in &changed {
            self.reach.change(v);
            let (frame, quantizer) = (self.frame, self.quantizer);
            let (slab, v) = self.slab_of_mut(v);
            slab.state[v.at()] = VertexState::Attracted;
            slab.quantized[v.at()] = quantizer.quantized_point(frame.place(slab.position(v)));
        }
        changed
    }
}

/// The pairs of values of equal keys, in the order of the longer side.
fn common<K: Eq + Hash>(
    one: impl ExactSizeIterator<Item = (K, InSlab)>,
    other: impl ExactSizeIterator<Item = (K, InSlab)>,
) -> Vec<(InSlab, InSlab)> {
    if one.len() > other.len() {
        return common(other, one).into_iter().map(|(v, u)| (u, v)).collect();
    }
    let one: SeededMap<K, InSlab> = one.collect();
    other.filter_map(|(key, u)| Some((*one.get(&key)?, u))).collect()
}

impl<T: Coordinate> TriangleSet for Seam<'_, T> {
    fn stretches(&self) -> [Range<u32>; 2] {
        let first = self.upper_triangles();
        [0..self.lower.triangles.len() as u32, first..first + self.upper.triangles.len() as u32]
    }

    #[inline]
    fn triangle(&self, t: u32) -> [u32; 3] {
        let first = self.upper_triangles();
        let triangle = if t < first {
            self.lower.triangles[t as usize]
        } else {
            self.upper.triangles[(t - first) as usize].map(|v| self.named_by_upper(v))
        };
        // What joins vertices changes with them.
        for v in triangle {
            if self.is_known([v; 3]) {
                self.reach.read(v);
            } else if v >= BEFORE {
                self.reach.read_beyond();
            }
        }
        triangle
    }

    #[inline]
    fn is_known(&self, triangle: [u32; 3]) -> bool {
        triangle.iter().all(|&v| v < self.lower.own() + self.upper.own())
    }

    #[inline]
    fn known(&self, t: u32) -> Option<[u32; 3]> {
        let exists = self.stretches().iter().any(|stretch| stretch.contains(&t));
        let triangle = exists.then(|| self.triangle(t))?;
        (!is_gone(triangle) && self.is_known(triangle)).then_some(triangle)
    }

    #[inline]
    fn quantized_point(&self, v: u32) -> QuantizedPoint {
        let (slab, v) = self.slab_of(v);
        slab.quantized[v.at()]
    }

    fn blocks(&mut self) -> &mut [PackedBox] {
        &mut self.blocks
    }

    fn widened(&self, triangle: [u32; 3]) {
        triangle.into_iter().for_each(|v| self.reach.touch(v));
    }
}

impl<T: Coordinate> Submesh for Seam<'_, T> {
    fn vertices(&self) -> u32 {
        self.lower.own() + self.upper.own()
    }

    #[inline]
    fn place(&self, v: u32) -> [f64; 3] {
        let (slab, v) = self.slab_of(v);
        self.frame.place(slab.position(v))
    }

    fn corners(&self, v: u32) -> impl Iterator<Item = u32> {
        // The lower slab's triangles name the upper one's vertices by the numbers they have here.
        let first = 3 * self.upper_triangles();
        let own = self.lower.own();
        let of_upper = if (own..BEFORE).contains(&v) { v - own } else { NONE };
        self.lower.stars.corners(v).chain(self.upper.stars.corners(of_upper).map(move |corner| first + corner))
    }

    fn also(&self, v: u32) -> u32 {
        if !self.is_known([v; 3]) {
            return NONE;
        }
        let (slab, at) = self.slab_of(v);
        match slab.stars.also[at.at()] {
            NONE => NONE,
            also if v < self.lower.own() => also,
            also => self.named_by_upper(also),
        }
    }

    fn is_whole(&self, v: u32) -> bool {
        self.is_known([v; 3]) && (v >= self.lower.seam() || self.lower.slices.start == 0)
    }

    fn is_frozen(&self, v: u32) -> bool {
        v < self.frozen || v >= BEFORE
    }

    fn is_kept(&self, t: u32) -> bool {
        let first = self.upper_triangles();
        if t < first { self.lower.is_kept(t) } else { self.upper.is_kept(t - first) }
    }

    fn is_flipped(&self, t: u32) -> bool {
        let first = self.upper_triangles();
        if t < first { self.lower.flips.has(t) } else { self.upper.flips.has(t - first) }
    }

    fn toggle_flip(&mut self, t: u32) -> Option<[u32; 2]> {
        let first = self.upper_triangles();
        let (slab, first) = if t < first { (&mut *self.lower, 0) } else { (&mut *self.upper, first) };
        let both = slab.toggle_flip(t - first)?.map(|t| t + first);
        let corners = both.into_iter().flat_map(|t| self.triangle(t));
        // A corner may have become a vertex of the slab before.
        corners.filter(|v| *v < BEFORE).for_each(|v| self.reach.change(v));
        Some(both)
    }

    fn state(&self, v: u32) -> VertexState {
        let (slab, v) = self.slab_of(v);
        slab.state[v.at()]
    }

    fn put(&mut self, v: u32, survivor: u32, also: u32, state: VertexState) {
        self.reach.change(v);
        let first = 3 * self.upper_triangles();
        self.reach.touch(survivor);
        let corners: Vec<u32> = self.corners(v).collect();
        for corner in corners {
            // Vertices of the slab beyond have the highest numbers: all of the upper slab counts as touched then.
            self.triangle(corner / 3).into_iter().filter(|v| *v < BEFORE).for_each(|v| self.reach.touch(v));
            if corner < first {
                self.lower.triangles.as_flattened_mut()[corner as usize] = survivor;
            } else {
                self.upper.triangles.as_flattened_mut()[(corner - first) as usize] = self.name_to_upper(survivor);
            }
        }
        let also = if v < self.lower.own() || also == NONE { also } else { self.name_to_upper(also) };
        let (frame, quantizer) = (self.frame, self.quantizer);
        let (slab, v) = self.slab_of_mut(v);
        slab.stars.also[v.at()] = also;
        slab.state[v.at()] = state;
        slab.quantized[v.at()] = quantizer.quantized_point(frame.place(slab.position(v)));
    }
}
