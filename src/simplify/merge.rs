//! Collapses that place the vertex anew (`--move-vertices`): both ends of an edge go to where the squared distances from their triangles' planes are least, of
//! the places that keep the volume (Lindstrom & Turk 1998).
//!
//! Both ends must lie within the part, and not on a rim: elsewhere a vertex goes to a neighbour, as without. What must hold is the same, and so is the bound: the
//! triangles round both ends and those round the new place cover one polygon, seen along the sum of the normals ([`Patch`]).

use glam::DVec3;

use super::collapse::{EVEN, MOST_ROUND, SHAPE, Simplifier, Target};
use super::fan::shape;
use super::gap::{MOST, across};
use super::leaving::Leaving;
use super::mark::Blend;
use super::merging::{Corner, Merging};
use super::patch::{Node, Patch};
use super::piece::{NONE, Piece, Ring};
use super::quadric::Quadric;

/// A place is no farther from both ends than so many times their distance: planes that are nearly one meet anywhere.
const FARTHEST: f64 = 2.0;

impl Simplifier<'_> {
    fn corner(&mut self, vertex: u32) -> Corner {
        let known = self.merging.corners[vertex as usize];
        if known.known {
            return known;
        }
        let own = self.piece.position(vertex);
        let mut across = DVec3::ZERO;
        for &t in self.piece.star(vertex) {
            let [a, b] = self.piece.others(t, vertex).map(|v| self.piece.position(v) - own);
            across += a.cross(b) / 2.0;
        }
        let corner = Corner { quadric: self.quadric(vertex), across, known: true };
        self.merging.corners[vertex as usize] = corner;
        corner
    }

    /// What was known of a ring and of the vertex that its middle went to holds no more.
    pub(super) fn forget(&mut self, target: u32, ring: &Ring) {
        self.merging.corners[target as usize].known = false;
        ring.vertices.iter().for_each(|v| self.merging.corners[*v as usize].known = false);
    }

    /// What a vertex that is not on a rim may become one with, in `self.targets`: each neighbour as it is, and at the best place.
    pub(super) fn look_to_merge(&mut self, vertex: u32) {
        let own = self.piece.position(vertex);
        let corner = self.corner(vertex);
        let degree = self.piece.star(vertex).len();
        for at in 0..degree {
            let t = self.piece.star(vertex)[at];
            // Every neighbour comes first in one triangle.
            let target = self.piece.others(t, vertex)[0];
            if !self.same_class(vertex, target) {
                continue;
            }
            let way = self.piece.position(target) - own;
            let name = (self.piece.numbers[target as usize], target);
            self.targets.push(Target::new(corner.quadric.at(way, EVEN * EVEN), name, None));
            if self.piece.fixed[target as usize] || self.rim[target as usize] {
                continue;
            }
            let there = self.corner(target);
            if let Some((cost, way)) = self.best(vertex, target, (corner, there), way) {
                self.targets.push(Target::new(cost, name, Some(own + way)));
            }
        }
    }

    /// The best place for two vertices, as a way from the first, and what it costs. `way` leads to the second.
    fn best(&self, vertex: u32, target: u32, (own, there): (Corner, Corner), way: DVec3) -> Option<(f64, DVec3)> {
        // The triangles that both have count once.
        let mut both = Quadric::default();
        let mut shared = DVec3::ZERO;
        for &t in self.piece.star(vertex) {
            let others = self.piece.others(t, vertex);
            if others.contains(&target) {
                let [a, b] = others.map(|v| self.piece.position(v) - self.piece.position(vertex));
                let across = a.cross(b) / 2.0;
                both.add(across);
                shared += across;
            }
        }
        let even = EVEN * EVEN * (own.quadric.weight() + there.quadric.weight());
        let of_there = there.quadric.matrix();
        let mut matrix = own.quadric.matrix() + of_there - both.matrix();
        matrix.x_axis.x += even;
        matrix.y_axis.y += even;
        matrix.z_axis.z += even;
        let even_there = EVEN * EVEN * there.quadric.weight();
        let slope = of_there * way + way * even_there;
        let across = own.across + there.across - shared;
        let volume = there.across.dot(way);
        let inverse = matrix.inverse();
        let (free, along) = (inverse * slope, inverse * across);
        let per_volume = across.dot(along);
        if !per_volume.is_finite() || per_volume <= 0.0 {
            return None;
        }
        let best = free + along * ((volume - across.dot(free)) / per_volume);
        let farthest = FARTHEST * FARTHEST * way.length_squared();
        if !(best.length_squared() <= farthest && (best - way).length_squared() <= farthest) {
            return None;
        }
        let beyond = best - way;
        let cost = own.quadric.at(best, EVEN * EVEN) + there.quadric.at(beyond, EVEN * EVEN) - both.at(best, 0.0);
        Some((cost.max(0.0), best))
    }

    /// Moves two neighbours to one place, if everything allows it. `leaving` is the first; the second is left.
    pub(super) fn merge(&mut self, vertex: u32, target: u32, place: DVec3, leaving: &Leaving) -> bool {
        let Some(place) = (self.placed)(place) else { return false };
        let ring = &leaving.ring;
        if !ring.closed || !self.links(vertex, target, leaving) {
            return false;
        }
        let mut merging = std::mem::take(&mut self.merging);
        let done = self.merge_with(vertex, target, place, ring, &mut merging);
        self.merging = merging;
        if done {
            let known = &mut self.merging.corners;
            known[target as usize].known = false;
            self.merging.link.iter().for_each(|v| known[*v as usize].known = false);
            self.push(target);
            for at in 0..self.merging.link.len() {
                let v = self.merging.link[at];
                if !self.piece.fixed[v as usize] {
                    self.stale[v as usize] = true;
                    if !self.queue.has(v) {
                        self.queue.put(v, self.costs[v as usize]);
                    }
                }
            }
        }
        done
    }

    fn merge_with(&mut self, vertex: u32, target: u32, place: DVec3, ring: &Ring, merging: &mut Merging) -> bool {
        let Merging { ring: other, link, outer, star, .. } = merging;
        if !self.piece.ring(target, other) || !other.closed {
            return false;
        }
        let (m, l) = (ring.vertices.len(), other.vertices.len());
        let (Some(at), Some(back)) =
            (ring.vertices.iter().position(|v| *v == target), other.vertices.iter().position(|v| *v == vertex))
        else {
            return false;
        };
        // Once round both: what follows the second in the ring of the first, then what follows the first in that of the second.
        link.clear();
        outer.clear();
        for k in 1..m - 1 {
            link.push(ring.vertices[(at + k) % m]);
            outer.push(ring.triangles[(at + k) % m]);
        }
        for k in 1..l - 1 {
            link.push(other.vertices[(back + k) % l]);
            outer.push(other.triangles[(back + k) % l]);
        }
        let n = link.len();
        if n < 3 || n > MOST.min(MOST_ROUND) {
            return false;
        }
        star.clear();
        star.extend_from_slice(&ring.triangles);
        star.extend(other.triangles.iter().filter(|t| !ring.triangles.contains(t)));

        let own = self.piece.position(vertex);
        let mut axis = DVec3::ZERO;
        let mut least_old = 1f64;
        for &t in star.iter() {
            let [a, b, c] = self.piece.corners(t);
            axis += (b - a).cross(c - a);
            least_old = least_old.min(shape([a, b, c]));
        }
        let length = axis.length();
        if length.is_nan() || length <= 0.0 {
            return false;
        }
        let axis = axis / length;
        // Nodes: those round both, then the first, the second, and the place.
        let (right, up) = across(axis);
        let share = share_of(own, self.piece.position(target), place);
        let [of_vertex, of_target] = [vertex, target].map(|v| self.piece.blends[v as usize]);
        let colour = match self.limits.colours {
            Some(colours) => colours.between(of_vertex.tint(), of_target.tint(), share),
            None => [0.0; 3],
        };
        let Patch { nodes, old, new, size, .. } = &mut self.patch;
        nodes.clear();
        old.clear();
        new.clear();
        *size = 0.0;
        let mut node = |place: DVec3, blend: &Blend| {
            let way = place - own;
            *size = size.max(way.length());
            nodes.push(Node {
                at: glam::DVec2::new(way.dot(right), way.dot(up)),
                height: way.dot(axis),
                tint: blend.tint(),
            });
        };
        link.iter().for_each(|v| node(self.piece.position(*v), &self.piece.blends[*v as usize]));
        node(own, &of_vertex);
        node(self.piece.position(target), &of_target);
        node(place, &Blend { colour, ..Blend::default() });
        let number = |v: u32| {
            if v == vertex {
                n
            } else if v == target {
                n + 1
            } else {
                link.iter().position(|other| *other == v).expect("it lies round both")
            }
        };
        old.triangles.extend(star.iter().map(|t| self.piece.triangles[*t as usize].map(number)));
        old.inner.extend([n, n + 1]);
        new.triangles.extend((0..n).map(|k| [n + 2, k, (k + 1) % n]));
        new.inner.push(n + 2);
        if !self.patch.faces_up() || !goes_once_round(&self.patch.nodes[..n], self.patch.nodes[n + 2]) {
            return false;
        }
        self.fan.spread_round(&self.piece, link, (target, place));
        if self.fan.shape() < SHAPE.min(least_old) {
            return false;
        }
        let Piece { drift, tints, .. } = &self.piece;
        let used = |j: usize| (drift[star[j] as usize], tints[star[j] as usize]);
        if !self.patch.bounds(axis, DVec3::ZERO, used, &mut self.bounds, &mut self.tints)
            || !self.tints.iter().all(|tint| tint.greatest() <= self.limits.tint)
        {
            return false;
        }
        if !self.bounds.iter().all(|bound| bound.most() <= self.limits.tolerance) {
            self.too_far[vertex as usize] = true;
            return false;
        }
        if self.fan.meets(&self.piece, &mut self.boxes, star, own, Some((right, up))) {
            return false;
        }

        // Done: what follows cannot fail.
        let piece = &mut self.piece;
        piece.collapse(vertex, target, ring);
        piece.positions[target as usize] = place;
        let (near, far) = if share < 0.5 { (vertex, target) } else { (target, vertex) };
        let [near_number, other] = [near, far].map(|v| piece.numbers[v as usize]);
        piece.numbers[target as usize] = near_number;
        piece.blends[target as usize] = Blend { other, share: share.min(1.0 - share) as f32, colour };
        if let Some(class) = piece.classes.get(near as usize).copied() {
            piece.classes[target as usize] = class;
        }
        for (k, &t) in outer.iter().enumerate() {
            piece.drift[t as usize] = self.bounds[k];
            piece.tints[t as usize] = self.tints[k];
        }
        for &t in star.iter() {
            if self.piece.triangles[t as usize][0] == NONE {
                self.boxes.remove(t);
                self.triangles -= 1;
            } else {
                let corners = self.piece.corners(t);
                self.boxes.update(t, corners);
            }
        }
        if self.triangles * 2 < self.boxed {
            self.make_boxes();
        }
        true
    }
}

/// Where a place lies on the way from one to another, seen across: 0 to 1.
fn share_of(from: DVec3, to: DVec3, place: DVec3) -> f64 {
    let way = to - from;
    let length = way.length_squared();
    if length > 0.0 { ((place - from).dot(way) / length).clamp(0.0, 1.0) } else { 0.0 }
}

/// Whether the ring goes once round a place, if every side of it goes round it counter-clockwise: it passes a ray from there once.
fn goes_once_round(ring: &[Node], middle: Node) -> bool {
    let passes = |k: usize| {
        let (p, q) = (ring[k].at - middle.at, ring[(k + 1) % ring.len()].at - middle.at);
        p.y < 0.0 && q.y >= 0.0
    };
    (0..ring.len()).filter(|k| passes(*k)).count() == 1
}
