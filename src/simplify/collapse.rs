//! Collapses edge after edge of a piece, the cheapest first, as long as every guarantee is kept.

use glam::DVec3;

use super::boxes::Boxes;
use super::fan::{Fan, shape};
use super::gap::{Drift, MOST, Overlay, ROUNDING};
use super::piece::{NONE, Piece, Ring};
use super::quadric::Quadric;
use super::queue::Queue;

/// What a collapse has to keep to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// No place of either surface is farther than this from the other.
    pub(super) tolerance: f64,
    /// A collapse that costs more is not made: of the squared distances from the planes of the triangles that go, their areas' sum.
    pub(super) cost: f64,
}

/// Triangles round a vertex, at most: each collapse looks at all of them.
const MOST_ROUND: usize = 40;
/// Neighbours that a vertex is moved to in trial.
const MOST_TRIED: usize = 3;
/// A triangle's shape that is good enough, from 0 (without area) to 1 (equal sides): less is accepted only where it was no better before.
const SHAPE: f64 = 0.15;
/// What edges' lengths weigh beside distances from planes: flat areas become even triangles.
const EVEN: f64 = 1e-3;
/// What the rim's planes weigh beside those of triangles.
const RIM: f64 = 10.0;

/// Mixes the bits of a number (Steele, Lea, Flood 2014).
fn mixed(number: u32) -> u64 {
    let mut z = u64::from(number).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A piece while it is simplified.
pub(super) struct Simplifier {
    pub(super) piece: Piece,
    limits: Limits,
    /// Vertices on a rim.
    rim: Vec<bool>,
    queue: Queue,
    /// Vertices whose cost may have changed.
    stale: Vec<bool>,
    costs: Vec<f32>,
    boxes: Boxes,
    triangles: usize,
    /// Triangles when the boxes were made.
    boxed: usize,
    overlay: Overlay,
    targets: Vec<(f32, u32, u32)>,
    fan: Fan,
    bounds: Vec<Drift>,
}

impl Simplifier {
    pub(super) fn new(piece: Piece, limits: Limits) -> Simplifier {
        let vertices = piece.positions.len();
        let triangles = piece.triangles.len();
        let mut simplifier = Simplifier {
            rim: vec![false; vertices],
            queue: Queue::new(piece.numbers.iter().map(|number| mixed(*number) as u32).collect()),
            stale: vec![false; vertices],
            costs: vec![0.0; vertices],
            boxes: Boxes::default(),
            triangles,
            boxed: 0,
            overlay: Overlay::default(),
            targets: Vec::new(),
            fan: Fan::default(),
            bounds: Vec::new(),
            piece,
            limits,
        };
        simplifier.find_rims();
        simplifier.make_boxes();
        simplifier
    }

    fn make_boxes(&mut self) {
        let Piece { triangles, positions, .. } = &self.piece;
        let corners = |t: u32| triangles[t as usize].map(|v| positions[v as usize]);
        let there = (0..triangles.len() as u32).filter(|t| triangles[*t as usize][0] != NONE);
        let centres = there.map(|t| (t, corners(t).into_iter().sum::<DVec3>() / 3.0));
        self.boxes = Boxes::build(centres, triangles.len(), corners);
        self.boxed = self.triangles;
    }

    /// Tells which vertices lie on a rim.
    fn find_rims(&mut self) {
        let mut ring = Ring::default();
        for v in 0..self.piece.positions.len() as u32 {
            self.rim[v as usize] = self.piece.ring(v, &mut ring) && !ring.closed;
        }
    }

    /// The distances from the planes of the triangles round a vertex; on a rim, of planes that stand on it, too.
    fn quadric(&self, vertex: u32) -> Quadric {
        let own = self.piece.position(vertex);
        let star = self.piece.star(vertex);
        let mut quadric = Quadric::default();
        for &t in star {
            let ways = self.piece.others(t, vertex).map(|v| self.piece.position(v) - own);
            let across = ways[0].cross(ways[1]) / 2.0;
            quadric.add(across);
            if self.rim[vertex as usize] {
                for (v, way) in self.piece.others(t, vertex).into_iter().zip(ways) {
                    if self.piece.is_rim(star, v) {
                        let upright = way.cross(across);
                        let length = upright.length();
                        if length > 0.0 {
                            quadric.add(upright * (RIM * way.length_squared() / length));
                        }
                    }
                }
            }
        }
        quadric
    }

    /// The neighbours that a vertex may go to, in `self.targets`.
    fn look(&mut self, vertex: u32) {
        self.targets.clear();
        let quadric = self.quadric(vertex);
        let (own, star) = (self.piece.position(vertex), self.piece.star(vertex));
        let rim = self.rim[vertex as usize];
        for &t in star {
            let others = self.piece.others(t, vertex);
            // Round a closed star every neighbour comes first in one triangle. A rim is shortened along itself.
            for &target in &others[..if rim { 2 } else { 1 }] {
                if (!rim || self.piece.is_rim(star, target)) && self.same_class(vertex, target) {
                    let cost = quadric.at(self.piece.position(target) - own, EVEN * EVEN);
                    self.targets.push((cost as f32, mixed(self.piece.numbers[target as usize]) as u32, target));
                }
            }
        }
    }

    /// Takes the cheapest of the neighbours that [`Simplifier::look`] has found.
    fn next_target(&mut self) -> Option<(f32, u32, u32)> {
        let key = |target: &(f32, u32, u32)| (target.1, target.2);
        let before = |a: &(f32, u32, u32), b: &(f32, u32, u32)| a.0.total_cmp(&b.0).then(key(a).cmp(&key(b)));
        let least = (0..self.targets.len())
            .reduce(|a, b| if before(&self.targets[b], &self.targets[a]).is_lt() { b } else { a })?;
        Some(self.targets.swap_remove(least))
    }

    /// The least that a move to one of them costs.
    fn least_cost(&self) -> f32 {
        self.targets.iter().fold(f32::INFINITY, |least, target| least.min(target.0))
    }

    fn same_class(&self, a: u32, b: u32) -> bool {
        let classes = &self.piece.classes;
        classes.is_empty() || classes[a as usize] == classes[b as usize]
    }

    /// Puts a vertex into the queue by what it costs now.
    fn push(&mut self, vertex: u32) {
        self.stale[vertex as usize] = false;
        if self.piece.fixed[vertex as usize] {
            return;
        }
        self.look(vertex);
        self.costs[vertex as usize] = self.least_cost();
        self.queue.put(vertex, self.costs[vertex as usize]);
    }

    /// Collapses until nothing more can go.
    pub(super) fn run(&mut self) {
        for vertex in 0..self.piece.positions.len() as u32 {
            self.push(vertex);
        }
        let mut ring = Ring::default();
        while let Some((cost, vertex)) = self.queue.pop() {
            if f64::from(cost) > self.limits.cost {
                break;
            }
            self.look(vertex);
            if std::mem::take(&mut self.stale[vertex as usize]) {
                // It waits again if it costs more by now.
                let now = self.least_cost();
                self.costs[vertex as usize] = now;
                if now > cost {
                    self.queue.put(vertex, now);
                    continue;
                }
            }
            if !self.piece.ring(vertex, &mut ring) {
                continue;
            }
            let used = ring.triangles.iter().map(|t| self.piece.drift[*t as usize]).fold(Drift::NONE, Drift::with);
            if ring.vertices.len() > MOST {
                continue;
            }
            for _ in 0..MOST_TRIED {
                let Some((_, _, target)) = self.next_target() else { break };
                if self.collapse(vertex, target, used, &ring) {
                    break;
                }
            }
        }
    }

    /// The other triangle that two vertices have, beside the one given.
    fn across(&self, a: u32, b: u32, beside: u32) -> Option<u32> {
        let others = self.piece.star(a).iter().copied().filter(|t| *t != beside);
        others.into_iter().find(|t| self.piece.triangles[*t as usize].contains(&b))
    }

    /// Whether the two vertices' neighbours in common are those across their edge, and no triangle would come twice.
    fn links(&self, vertex: u32, target: u32, ring: &Ring) -> bool {
        let n = ring.vertices.len();
        let at = ring.vertices.iter().position(|v| *v == target).expect("a target is a neighbour");
        let across = |v: u32| {
            if ring.closed {
                ring.vertices[(at + 1) % n] == v || ring.vertices[(at + n - 1) % n] == v
            } else {
                ring.vertices[if at == 0 { 1 } else { at - 1 }] == v
            }
        };
        for &t in self.piece.star(target) {
            let corners = self.piece.triangles[t as usize];
            if corners.contains(&vertex) {
                continue;
            }
            let mut both = 0;
            for v in corners {
                if v != target && ring.vertices.contains(&v) {
                    if !across(v) {
                        return false;
                    }
                    both += 1;
                }
            }
            // The triangle that would come is there.
            if both == 2 {
                return false;
            }
        }
        if !ring.closed {
            // A rim of three vertices would be one edge.
            let other = ring.vertices[if at == 0 { n - 1 } else { 0 }];
            if n == 2 {
                // The last triangle of a component stays; so does one whose inner edge is a rim, too.
                return self.across(target, other, ring.triangles[0]).is_some();
            }
            return !self.piece.star(target).iter().any(|t| self.piece.triangles[*t as usize].contains(&other));
        }
        true
    }

    /// Moves a vertex to a neighbour, if everything allows it. `used` is the most that its triangles have used up.
    fn collapse(&mut self, vertex: u32, target: u32, used: Drift, ring: &Ring) -> bool {
        if !self.links(vertex, target, ring) {
            return false;
        }
        let n = ring.vertices.len();
        if self.piece.star(target).len() + ring.triangles.len() > MOST_ROUND + 4
            && self.piece.star(target).len() + ring.triangles.len() > n + MOST_ROUND
        {
            return false;
        }
        let own = self.piece.position(vertex);
        let at = ring.vertices.iter().position(|v| *v == target).expect("a target is a neighbour");
        // The ring, read from the target on.
        let place = |k: usize| -> u32 {
            if ring.closed {
                ring.vertices[(at + k) % n]
            } else if at == 0 {
                ring.vertices[k]
            } else {
                ring.vertices[n - 1 - k]
            }
        };
        // An open ring read backwards runs the other way round.
        let mirrored = !ring.closed && at != 0;
        let mut axis = DVec3::ZERO;
        for &t in &ring.triangles {
            let [a, b, c] = self.piece.corners(t);
            axis += (b - a).cross(c - a);
        }
        if mirrored {
            axis = -axis;
        }
        let length = axis.length();
        let relative = (0..n).map(|k| self.piece.position(place(k)) - own);
        let seen = self.overlay.look(if length > 0.0 { axis / length } else { DVec3::Z }, relative, ring.closed)
            && length > 0.0;
        self.fan.spread(&self.piece, place, n, mirrored, &self.overlay);
        let least_old = ring.triangles.iter().map(|t| shape(self.piece.corners(*t))).fold(1.0, f64::min);
        if self.fan.shape() < SHAPE.min(least_old) {
            return false;
        }
        // Old triangles in the order of `place`.
        let old = |j: usize| -> usize {
            let t = match (ring.closed, mirrored) {
                (true, _) => ring.triangles[(at + j) % n],
                (false, false) => ring.triangles[j],
                (false, true) => ring.triangles[n - 2 - j],
            };
            t as usize
        };
        if seen && n > 2 {
            self.overlay.bounds(axis / length, |j| self.piece.drift[old(j)], &mut self.bounds);
        } else {
            let way = if seen { self.overlay.moved() } else { self.piece.position(target) - own };
            let bound = used.along(way, [-1.0, 0.0]).wider(ROUNDING * way.length());
            self.bounds.clear();
            self.bounds.resize(n - 1, bound);
        }
        // Where a triangle goes whose vertex has no other, the edge that it stood on has all of it; so does the triangle on the edge's other side.
        let inner = if n == 2 { self.across(target, place(1), ring.triangles[0]) } else { None };
        if let Some(inner) = inner {
            self.bounds[0] = self.bounds[0].with(self.piece.drift[inner as usize]);
        }
        if !self.bounds.iter().all(|bound| bound.most() <= self.limits.tolerance) {
            return false;
        }
        let overlay = seen.then_some(&self.overlay);
        if self.fan.meets(&self.piece, &mut self.boxes, &ring.triangles, own, overlay) {
            return false;
        }

        // Done: what follows cannot fail.
        let first = self.bounds[0];
        let following: Vec<(usize, Drift)> = (1..n - 1).map(|k| (old(k), self.bounds[k - 1])).collect();
        let Simplifier { piece, boxes, .. } = self;
        piece.collapse(vertex, target, ring);
        let Piece { triangles, positions, drift: carried, .. } = piece;
        for &t in &ring.triangles {
            let corners = triangles[t as usize];
            if corners[0] == NONE {
                boxes.remove(t);
                self.triangles -= 1;
            } else {
                boxes.update(t, corners.map(|v| positions[v as usize]));
            }
        }
        for (t, bound) in following {
            carried[t] = bound;
        }
        if let Some(inner) = inner {
            carried[inner as usize] = first;
        }
        if self.triangles * 2 < self.boxed {
            self.make_boxes();
        }
        self.push(target);
        for &v in &ring.vertices {
            if v != target && !self.piece.fixed[v as usize] {
                self.stale[v as usize] = true;
                if !self.queue.has(v) {
                    self.queue.put(v, self.costs[v as usize]);
                }
            }
        }
        true
    }
}
