//! Collapses edge after edge of a piece, the cheapest first, as long as every guarantee is kept.

use glam::DVec3;

use super::boxes::Boxes;
use super::fan::{Fan, shape};
use super::gap::{Drift, MOST, Overlay, ROUNDING};
use super::leaving::{Leaving, RingOrder};
use super::mark::Colours;
use super::merging::Merging;
use super::patch::{Node, Patch};
use super::piece::{NONE, Piece, Ring};
use super::quadric::Quadric;
use super::queue::Queue;

/// What a collapse has to keep to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// No place of either surface is farther than this from the other.
    pub(super) tolerance: f64,
    /// Within this, all has gone that could: 0 if nothing was tried.
    pub(super) tried: f64,
    /// A collapse that costs more is not made: of the squared distances from the planes of the triangles that go, their areas' sum.
    pub(super) cost: f64,
    /// No channel of the colour changes by more than this.
    pub(super) tint: f64,
    /// What colours are made of, if they are carried.
    pub(super) colours: Option<Colours>,
    /// Whether vertices may move.
    pub(super) moves: bool,
}

/// Triangles round a vertex, at most: each collapse looks at all of them.
pub(super) const MOST_ROUND: usize = 40;
/// Neighbours that a vertex is moved to in trial.
const MOST_TRIED: usize = 3;
/// A triangle's shape that is good enough, from 0 (without area) to 1 (equal sides): less is accepted only where it was no better before.
pub(super) const SHAPE: f64 = 0.15;
/// What edges' lengths weigh beside distances from planes: flat areas become even triangles.
pub(super) const EVEN: f64 = 1e-3;
/// The shares of the tolerance that collapses are kept to, one after the other. What is cheap but goes far comes last: it would leave triangles that have used the tolerance up
/// beside others that have hardly begun, and these could not go.
const STEPS: [f64; 3] = [0.5, 0.75, 1.0];
/// What the rim's planes weigh beside those of triangles.
const RIM: f64 = 10.0;

/// Mixes the bits of a number (Steele, Lea, Flood 2014).
pub(super) fn mixed(number: u32) -> u64 {
    let mut z = u64::from(number).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A piece while it is simplified.
pub(super) struct Simplifier<'a> {
    pub(super) piece: Piece,
    pub(super) limits: Limits,
    /// Where a vertex comes to lie that is moved there, as it is written; none if that is not in the part.
    pub(super) placed: &'a dyn Fn(DVec3) -> Option<DVec3>,
    /// Vertices on a rim.
    pub(super) rim: Vec<bool>,
    pub(super) queue: Queue,
    /// Vertices whose cost may have changed.
    pub(super) stale: Vec<bool>,
    /// Vertices that could not go within the tolerance when they were looked at last.
    pub(super) too_far: Vec<bool>,
    pub(super) costs: Vec<f32>,
    /// Of each vertex that is in the queue and not stale: the cheapest of its neighbours, in order, while no places are tried.
    best: Vec<[u32; MOST_TRIED]>,
    /// The neighbours of the vertex that is looked at, and the ways to them.
    around: Vec<(u32, DVec3)>,
    pub(super) boxes: Boxes,
    pub(super) triangles: usize,
    /// Triangles when the boxes were made.
    pub(super) boxed: usize,
    overlay: Overlay,
    pub(super) targets: Vec<Target>,
    pub(super) fan: Fan,
    pub(super) bounds: Vec<Drift>,
    pub(super) tints: Vec<Drift>,
    ways: Vec<Drift>,
    pub(super) patch: Patch,
    pub(super) merging: Merging,
    /// Whether vertices are placed anew by now.
    placing: bool,
}

/// Where a vertex may go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Target {
    pub(super) cost: f32,
    key: u32,
    /// The neighbour that it becomes one with.
    pub(super) vertex: u32,
    /// Where both come to lie, if that is not where the neighbour is.
    pub(super) place: Option<DVec3>,
}

impl Target {
    pub(super) fn new(cost: f64, (number, vertex): (u32, u32), place: Option<DVec3>) -> Target {
        Target { cost: cost as f32, key: mixed(number) as u32, vertex, place }
    }

    fn is_before(&self, other: &Target) -> bool {
        let key = |target: &Target| (target.key, target.vertex, target.place.is_none());
        self.cost.total_cmp(&other.cost).then(key(self).cmp(&key(other))).is_lt()
    }
}

impl<'a> Simplifier<'a> {
    /// Bytes of the neighbours that are kept of each vertex.
    pub(super) const BEST_BYTES: u64 = size_of::<[u32; MOST_TRIED]>() as u64;

    pub(super) fn new(piece: Piece, limits: Limits, placed: &'a dyn Fn(DVec3) -> Option<DVec3>) -> Simplifier<'a> {
        let vertices = piece.positions.len();
        let triangles = piece.triangles.len();
        let mut simplifier = Simplifier {
            rim: vec![false; vertices],
            queue: Queue::new(piece.numbers.iter().map(|number| mixed(*number) as u32).collect()),
            stale: vec![false; vertices],
            too_far: vec![false; vertices],
            costs: vec![0.0; vertices],
            best: vec![[NONE; MOST_TRIED]; vertices],
            around: Vec::new(),
            boxes: Boxes::default(),
            triangles,
            boxed: 0,
            overlay: Overlay::default(),
            targets: Vec::new(),
            fan: Fan::new(vertices),
            bounds: Vec::new(),
            tints: Vec::new(),
            ways: Vec::new(),
            patch: Patch::default(),
            merging: Merging::new(if limits.moves { vertices } else { 0 }),
            // Where the tolerance alone ends it, vertices on the surface go farther: places beside it use the tolerance up sooner.
            placing: limits.moves && limits.cost < f64::INFINITY,
            piece,
            limits,
            placed,
        };
        simplifier.find_rims();
        simplifier.make_boxes();
        simplifier
    }

    pub(super) fn make_boxes(&mut self) {
        let Piece { triangles, positions, .. } = &self.piece;
        let corners = |t: u32| triangles[t as usize].map(|v| positions[v as usize]);
        let there = (0..triangles.len() as u32).filter(|t| triangles[*t as usize][0] != NONE);
        let centres = there.map(|t| (t, corners(t).into_iter().sum::<DVec3>() / 3.0));
        self.boxes = Boxes::build(centres, triangles.len(), corners);
        self.boxed = self.triangles;
    }

    /// Tells which vertices lie on a rim.
    fn find_rims(&mut self) {
        // Of an open ring, each vertex but the last begins one side, and each but the first ends one: numbers of the former less those of the latter are a sum that is not 0,
        // modulo 2^32 either. Where it is 0, the ring need not be looked at.
        let mut sums = vec![0u32; self.piece.positions.len()];
        for &[a, b, c] in &self.piece.triangles {
            for (v, [from, to]) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
                sums[v as usize] = sums[v as usize].wrapping_add(from).wrapping_sub(to);
            }
        }
        let mut ring = Ring::default();
        for v in 0..self.piece.positions.len() as u32 {
            self.rim[v as usize] = sums[v as usize] != 0 && self.piece.ring(v, &mut ring) && !ring.closed;
        }
    }

    /// The distances from the planes of the triangles round a vertex; on a rim, of planes that stand on it, too.
    pub(super) fn quadric(&self, vertex: u32) -> Quadric {
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

    /// The neighbours that a vertex may go to, in `self.around`, and what that costs.
    fn look_round(&mut self, vertex: u32) -> Quadric {
        self.around.clear();
        let (own, star) = (self.piece.position(vertex), self.piece.star(vertex));
        if self.rim[vertex as usize] {
            // A rim is shortened along itself.
            let quadric = self.quadric(vertex);
            let (piece, rim) = (&self.piece, |target: &u32| self.piece.is_rim(star, *target));
            let targets = star.iter().flat_map(|t| piece.others(*t, vertex)).filter(rim);
            self.around.extend(targets.map(|target| (target, piece.position(target) - own)));
            return quadric;
        }
        let mut quadric = Quadric::default();
        for &t in star {
            // Round a closed star every neighbour comes first in one triangle.
            let [first, second] = self.piece.others(t, vertex);
            let [way, next] = [first, second].map(|v| self.piece.position(v) - own);
            quadric.add(way.cross(next) / 2.0);
            self.around.push((first, way));
        }
        quadric
    }

    /// What it costs at least to move a vertex to a neighbour. The cheapest neighbours are kept in `self.best`.
    fn find_best(&mut self, vertex: u32) -> f32 {
        let quadric = self.look_round(vertex);
        let Piece { numbers, .. } = &self.piece;
        let key = |target: u32| (mixed(numbers[target as usize]) as u32, target);
        let (mut best, mut costs, mut count) = ([NONE; MOST_TRIED], [0f32; MOST_TRIED], 0);
        let mut least = f32::INFINITY;
        for &(target, way) in &self.around {
            if !self.same_class(vertex, target) {
                continue;
            }
            let cost = quadric.at(way, EVEN * EVEN) as f32;
            least = least.min(cost);
            let mut at = count;
            while at > 0 && cost.total_cmp(&costs[at - 1]).then_with(|| key(target).cmp(&key(best[at - 1]))).is_lt() {
                at -= 1;
            }
            if at < MOST_TRIED {
                count = MOST_TRIED.min(count + 1);
                best.copy_within(at..count - 1, at + 1);
                costs.copy_within(at..count - 1, at + 1);
                (best[at], costs[at]) = (target, cost);
            }
        }
        self.best[vertex as usize] = best;
        least
    }

    /// What a vertex costs now. Where it may go is in `self.best` then or, where places are tried, in `self.targets`.
    fn cost(&mut self, vertex: u32) -> f32 {
        if !self.placing {
            return self.find_best(vertex);
        }
        self.targets.clear();
        if !self.rim[vertex as usize] {
            self.look_to_merge(vertex);
        } else {
            let quadric = self.look_round(vertex);
            for at in 0..self.around.len() {
                let (target, way) = self.around[at];
                if self.same_class(vertex, target) {
                    let cost = quadric.at(way, EVEN * EVEN);
                    self.targets.push(Target::new(cost, (self.piece.numbers[target as usize], target), None));
                }
            }
        }
        self.targets.iter().fold(f32::INFINITY, |least, target| least.min(target.cost))
    }

    /// Takes the cheapest of the neighbours that [`Simplifier::cost`] has found.
    fn next_target(&mut self) -> Option<Target> {
        let least =
            (0..self.targets.len()).reduce(|a, b| if self.targets[b].is_before(&self.targets[a]) { b } else { a })?;
        Some(self.targets.swap_remove(least))
    }

    pub(super) fn same_class(&self, a: u32, b: u32) -> bool {
        let classes = &self.piece.classes;
        classes.is_empty() || classes[a as usize] == classes[b as usize]
    }

    /// Puts a vertex into the queue by what it costs now.
    pub(super) fn push(&mut self, vertex: u32) {
        self.stale[vertex as usize] = false;
        if self.piece.fixed[vertex as usize] {
            return;
        }
        self.costs[vertex as usize] = self.cost(vertex);
        self.queue.put(vertex, self.costs[vertex as usize]);
    }

    /// Collapses until nothing more can go.
    pub(super) fn run(&mut self) {
        let Limits { tolerance, tried, .. } = self.limits;
        let mut once_more = false;
        for share in STEPS {
            let is_more = share * tolerance > tried && tolerance < f64::INFINITY;
            if is_more || share == 1.0 {
                self.limits.tolerance = share * tolerance;
                self.run_through(once_more);
                once_more = true;
            }
        }
        if self.limits.moves && !self.placing {
            self.placing = true;
            self.run_through(false);
        }
    }

    /// Collapses until nothing more can go: begins with the vertices that are not settled or, once more, with those that could not go within the tolerance.
    fn run_through(&mut self, once_more: bool) {
        for vertex in 0..self.piece.positions.len() as u32 {
            let is_tried = if once_more {
                std::mem::take(&mut self.too_far[vertex as usize])
            } else {
                !self.piece.settled[vertex as usize]
            };
            if is_tried && !self.piece.star(vertex).is_empty() {
                self.push(vertex);
            }
        }
        let mut leaving = Leaving::default();
        while let Some((cost, vertex)) = self.queue.pop() {
            if f64::from(cost) > self.limits.cost {
                break;
            }
            if std::mem::take(&mut self.stale[vertex as usize]) || self.placing {
                // It waits again if it costs more by now.
                let now = self.cost(vertex);
                self.costs[vertex as usize] = now;
                if now > cost {
                    self.queue.put(vertex, now);
                    continue;
                }
            }
            self.too_far[vertex as usize] = false;
            if !leaving.look_round(&self.piece, vertex) || leaving.ring.vertices.len() > MOST {
                continue;
            }
            if leaving.ring.closed {
                self.overlay.look_at(leaving.unit(), leaving.ways.iter().copied(), true);
            }
            if self.placing {
                self.go_or_merge(vertex, &leaving);
                continue;
            }
            for target in self.best[vertex as usize] {
                if target == NONE || self.collapse(vertex, target, &leaving) {
                    break;
                }
            }
        }
    }

    /// Moves a vertex to one of the neighbours or places in `self.targets`, the cheapest that allows it.
    fn go_or_merge(&mut self, vertex: u32, leaving: &Leaving) {
        // So many neighbours, and so many places.
        let mut tried = [0; 2];
        while let Some(Target { cost, vertex: target, place, .. }) = self.next_target() {
            let tried = &mut tried[usize::from(place.is_some())];
            if *tried == MOST_TRIED {
                continue;
            }
            *tried += 1;
            if f64::from(cost) > self.limits.cost {
                break;
            }
            let done = match place {
                Some(place) => self.merge(vertex, target, place, leaving),
                None => self.collapse(vertex, target, leaving),
            };
            if done {
                break;
            }
        }
    }

    /// The other triangle that two vertices have, beside the one given.
    fn across(&self, a: u32, b: u32, beside: u32) -> Option<u32> {
        let others = self.piece.star(a).iter().copied().filter(|t| *t != beside);
        others.into_iter().find(|t| self.piece.triangles[*t as usize].contains(&b))
    }

    /// Whether the two vertices' neighbours in common are those across their edge, and no triangle would come twice.
    pub(super) fn links(&self, vertex: u32, target: u32, leaving: &Leaving) -> bool {
        let (ring, at) = (&leaving.ring, leaving.place_of(target));
        let n = ring.vertices.len();
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
                if v != target && leaving.rings(v) {
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

    /// Moves a vertex to a neighbour, if everything allows it.
    fn collapse(&mut self, vertex: u32, target: u32, leaving: &Leaving) -> bool {
        if !self.links(vertex, target, leaving) {
            return false;
        }
        let ring = &leaving.ring;
        let n = ring.vertices.len();
        if self.piece.star(target).len() + ring.triangles.len() > MOST_ROUND + 4
            && self.piece.star(target).len() + ring.triangles.len() > n + MOST_ROUND
        {
            return false;
        }
        let own = leaving.own;
        let at = leaving.place_of(target);
        // The ring, read from the target on.
        let from = leaving.from(at);
        let place = |k: usize| ring.vertices[from.vertex(k)];
        let mirrored = from.mirrored;
        let axis = if mirrored { -leaving.unit() } else { leaving.unit() };
        let seen = match ring.closed {
            true => self.overlay.turn(at),
            false => self.overlay.look(axis, (0..n).map(|k| leaving.ways[from.vertex(k)]), false),
        } && leaving.has_axis();
        let covered = seen && n > 2;
        if !covered {
            let way = if seen { self.overlay.moved() } else { self.piece.position(target) - own };
            let bound = leaving.used.along(way, [-1.0, 0.0]).wider(ROUNDING * way.length());
            if bound.most() > self.limits.tolerance {
                self.too_far[vertex as usize] = true;
                return false;
            }
            self.bounds.clear();
            self.bounds.resize(n - 1, bound);
        }
        self.fan.spread(&self.piece, (0..n).map(place), mirrored);
        let worst = self.fan.shape();
        // Whatever was there before, a good shape will do.
        if worst < SHAPE && ring.triangles.iter().all(|t| worst < shape(self.piece.corners(*t))) {
            return false;
        }
        // Old triangles in the order of `place`.
        let old = |j: usize| ring.triangles[from.triangle(j)] as usize;
        let used = |j: usize| leaving.drift[from.triangle(j)];
        if covered && !self.overlay.bounds(axis, self.limits.tolerance, used, &mut self.bounds) {
            self.too_far[vertex as usize] = true;
            return false;
        }
        // Where a triangle goes whose vertex has no other, the edge that it stood on has all of it; so does the triangle on the edge's other side.
        let inner = if n == 2 { self.across(target, place(1), ring.triangles[0]) } else { None };
        if let Some(inner) = inner {
            self.bounds[0] = self.bounds[0].with(self.piece.drift[inner as usize]);
        }
        if !self.bounds.iter().all(|bound| bound.most() <= self.limits.tolerance) {
            self.too_far[vertex as usize] = true;
            return false;
        }
        let tinted = self.limits.tint < f64::INFINITY;
        if tinted && !self.tints_are_kept((vertex, target), leaving, from, (axis, covered)) {
            return false;
        }
        let axes = seen.then(|| self.overlay.axes());
        if self.fan.meets(&self.piece, &mut self.boxes, &ring.triangles, own, axes) {
            return false;
        }

        // Done: what follows cannot fail.
        if tinted {
            (1..n - 1).for_each(|k| self.piece.tints[old(k)] = self.tints[k - 1]);
            if let Some(inner) = inner {
                self.piece.tints[inner as usize] = self.tints[0].with(self.piece.tints[inner as usize]);
            }
        }
        let Simplifier { piece, boxes, bounds, .. } = self;
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
        (1..n - 1).for_each(|k| carried[old(k)] = bounds[k - 1]);
        if let Some(inner) = inner {
            carried[inner as usize] = bounds[0];
        }
        if self.triangles * 2 < self.boxed {
            self.make_boxes();
        }
        if self.limits.moves {
            self.forget(target, ring);
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

    /// Whether colours stay within what is allowed as a vertex goes to a neighbour; `self.tints` has how they change, of every triangle that comes. `from` reads the ring
    /// in the order in which the overlay sees it.
    fn tints_are_kept(
        &mut self,
        (vertex, target): (u32, u32),
        leaving: &Leaving,
        from: RingOrder,
        (axis, seen): (DVec3, bool),
    ) -> bool {
        let ring = &leaving.ring;
        let n = ring.vertices.len();
        let Piece { tints, blends, .. } = &self.piece;
        let tint = |v: u32| blends[v as usize].tint();
        if seen {
            let Patch { nodes, old: before, new: after, size, .. } = &mut self.patch;
            nodes.clear();
            for k in 0..n {
                let v = ring.vertices[from.vertex(k)];
                let (at, height) = self.overlay.node(k);
                nodes.push(Node { at, height, tint: tint(v) });
            }
            let (at, height) = self.overlay.middle();
            nodes.push(Node { at, height, tint: tint(vertex) });
            *size = self.overlay.size();
            before.clear();
            after.clear();
            before.triangles.extend((0..ring.triangles.len()).map(|j| [n, j, (j + 1) % n]));
            before.inner.push(n);
            after.triangles.extend((1..n - 1).map(|k| [0, k, k + 1]));
            let used = |j: usize| (Drift::NONE, tints[ring.triangles[from.triangle(j)] as usize]);
            let mut ways = std::mem::take(&mut self.ways);
            let told = self.patch.bounds(axis, DVec3::ZERO, used, &mut ways, &mut self.tints);
            self.ways = ways;
            if !told {
                return false;
            }
        } else {
            let used = ring.triangles.iter().map(|t| tints[*t as usize]).fold(Drift::NONE, Drift::with);
            self.tints.clear();
            self.tints.resize(n - 1, used.along(tint(target) - tint(vertex), [-1.0, 0.0]));
        }
        self.tints.iter().all(|tint| tint.greatest() <= self.limits.tint)
    }
}
