//! Two triangulations of one polygon, one over the other: how far they are from each other, and how their colours differ.
//!
//! [`Overlay`](super::gap::Overlay) is this for a vertex that goes to a neighbour, in less time, and without colours. Here, two vertices may have become a third
//! that lies elsewhere. Seen along the axis, the old triangles cover the ring's polygon once, and so do the new ones; heights and colours are linear on every
//! triangle, so that their differences are greatest at a corner of the overlay.
//!
//! ```text
//!       r2 ----- r1           r2 ----- r1      corners: u and v over the new triangles, p under the old ones,
//!      /  \     / \          /  `. .'   \      and where an edge that was there crosses one that comes
//!    r3 -- u --v -- r0     r3 - - p - - - r0
//!      \  /  \  \ /          \  .' `.   /
//!       r4 ---- r5            r4 ---- r5
//! ```

use glam::{DVec2, DVec3};

use super::gap::{Drift, ROUNDING, area};

/// Places may lie so much outside a triangle, as a part of it, and still be taken for within it.
const SLACK: f64 = 1e-9;

/// A corner of either triangulation.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Node {
    /// Across the axis.
    pub(super) at: DVec2,
    /// Along it.
    pub(super) height: f64,
    pub(super) tint: DVec3,
}

/// A difference of heights, and one of colours.
#[derive(Debug, Clone, Copy, Default)]
struct Gap {
    height: f64,
    tint: DVec3,
}

/// The least and the most of gaps.
#[derive(Debug, Clone, Copy, Default)]
struct Gaps {
    height: [f64; 2],
    tint: Drift,
}

impl Gaps {
    fn add(&mut self, gap: Gap) {
        self.height = [self.height[0].min(gap.height), self.height[1].max(gap.height)];
        self.tint = self.tint.with(Drift { low: gap.tint, high: gap.tint });
    }

    fn with(self, other: Gaps) -> Gaps {
        let height = [self.height[0].min(other.height[0]), self.height[1].max(other.height[1])];
        Gaps { height, tint: self.tint.with(other.tint) }
    }
}

/// A triangulation: triangles of nodes, and the edges within.
#[derive(Debug, Default)]
pub(super) struct Triangulation {
    pub(super) triangles: Vec<[usize; 3]>,
    /// Each with the triangles on its sides.
    edges: Vec<([usize; 2], [usize; 2])>,
    /// Nodes that are not on the ring, or were moved onto a rim.
    pub(super) inner: Vec<usize>,
}

impl Triangulation {
    pub(super) fn clear(&mut self) {
        self.triangles.clear();
        self.inner.clear();
    }

    fn find_edges(&mut self) {
        self.edges.clear();
        for (number, triangle) in self.triangles.iter().enumerate() {
            for side in 0..3 {
                let (a, b) = (triangle[side], triangle[(side + 1) % 3]);
                let back = |other: &[usize; 3]| (0..3).any(|side| (other[side], other[(side + 1) % 3]) == (b, a));
                // Each edge has two triangles; one side of it is enough.
                let beside = if a < b { self.triangles.iter().position(back) } else { None };
                self.edges.extend(beside.map(|beside| ([a, b], [number, beside])));
            }
        }
    }
}

/// What a patch carries and is to carry.
#[derive(Debug, Default)]
pub(super) struct Patch {
    pub(super) nodes: Vec<Node>,
    pub(super) old: Triangulation,
    pub(super) new: Triangulation,
    /// The largest distance of a node from the place that they are relative to.
    pub(super) size: f64,
    gaps: Vec<Gaps>,
    spent: Vec<(Drift, Drift)>,
}

impl Patch {
    fn of(&self, triangle: [usize; 3]) -> [DVec2; 3] {
        triangle.map(|node| self.nodes[node].at)
    }

    fn least(&self) -> f64 {
        ROUNDING * self.size * self.size
    }

    /// Whether all triangles of both run counter-clockwise.
    pub(super) fn faces_up(&self) -> bool {
        let up = |triangle: &[usize; 3]| {
            let [a, b, c] = self.of(*triangle);
            area(a, b, c) > self.least()
        };
        self.old.triangles.iter().all(up) && self.new.triangles.iter().all(up)
    }

    /// Whether the triangles of both surely have no place in common but corners and sides of both.
    fn apart(&self, one: [usize; 3], other: [usize; 3]) -> bool {
        let beside = |a: [usize; 3], b: [usize; 3]| {
            (0..3).any(|side| {
                let (from, to) = (a[side], a[(side + 1) % 3]);
                let (p, q) = (self.nodes[from].at, self.nodes[to].at);
                b.into_iter().all(|v| v == from || v == to || area(p, q, self.nodes[v].at) < -self.least())
            })
        };
        beside(one, other) || beside(other, one)
    }

    /// Height and colour of a triangle at a place, if it is within.
    fn within(&self, triangle: [usize; 3], place: DVec2) -> Option<Gap> {
        let [a, b, c] = self.of(triangle);
        let whole = area(a, b, c);
        let (of_b, of_c) = (area(a, place, c) / whole, area(a, b, place) / whole);
        if !(of_b >= -SLACK && of_c >= -SLACK && of_b + of_c <= 1.0 + SLACK) {
            return None;
        }
        let [a, b, c] = triangle.map(|node| self.nodes[node]);
        Some(Gap {
            height: a.height + of_b * (b.height - a.height) + of_c * (c.height - a.height),
            tint: a.tint + (b.tint - a.tint) * of_b + (c.tint - a.tint) * of_c,
        })
    }

    /// For each new triangle: where its places may have been, and how its colours may differ from what they were. `used` tells that of old triangles.
    /// `moved` is
    /// the way that all may have gone before they are looked at. `false` if it is not to be told.
    ///
    /// Greater than the truth by a rounding, never less.
    pub(super) fn bounds(
        &mut self,
        axis: DVec3,
        moved: DVec3,
        used: impl Fn(usize) -> (Drift, Drift),
        bounds: &mut Vec<Drift>,
        tints: &mut Vec<Drift>,
    ) -> bool {
        self.old.find_edges();
        self.new.find_edges();
        let count = self.new.triangles.len();
        let (mut gaps, mut spent) = (std::mem::take(&mut self.gaps), std::mem::take(&mut self.spent));
        gaps.clear();
        gaps.resize(count, Gaps::default());
        spent.clear();
        for &new in &self.new.triangles {
            let below = self.old.triangles.iter().enumerate().filter(|(_, old)| !self.apart(new, **old));
            let both = |(a, b): (Drift, Drift), (c, d): (Drift, Drift)| (a.with(c), b.with(d));
            spent.push(below.map(|(number, _)| used(number)).fold((Drift::NONE, Drift::NONE), both));
        }
        let found = self.find_gaps(&mut gaps);
        if found {
            let tinted = self.nodes.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), node| {
                (low.min(node.tint), high.max(node.tint))
            });
            let (more, more_tint) = (ROUNDING * self.size, ROUNDING * (tinted.1 - tinted.0).max_element());
            bounds.clear();
            tints.clear();
            for (gaps, (drift, tint)) in gaps.iter().zip(&spent) {
                bounds.push(drift.along(moved, [-1.0, 0.0]).along(axis, gaps.height).wider(more));
                let sum = Drift { low: tint.low + gaps.tint.low, high: tint.high + gaps.tint.high };
                tints.push(sum.wider(more_tint));
            }
        }
        (self.gaps, self.spent) = (gaps, spent);
        found
    }

    /// The gaps at the overlay's corners, of the new triangles that have them.
    fn find_gaps(&self, gaps: &mut [Gaps]) -> bool {
        let least = self.least();
        let mut doubtful = false;
        let between = |a: Gap, b: Gap| Gap { height: a.height - b.height, tint: a.tint - b.tint };
        let on = |node: Node| Gap { height: node.height, tint: node.tint };
        for &inner in &self.old.inner {
            let mut seen = false;
            for (number, &new) in self.new.triangles.iter().enumerate() {
                if let Some(there) = self.within(new, self.nodes[inner].at) {
                    gaps[number].add(between(on(self.nodes[inner]), there));
                    seen = true;
                }
            }
            if !seen {
                return false;
            }
        }
        for &inner in &self.new.inner {
            let mut seen = false;
            for &old in &self.old.triangles {
                if let Some(there) = self.within(old, self.nodes[inner].at) {
                    let gap = between(there, on(self.nodes[inner]));
                    let own = self.new.triangles.iter().zip(&mut *gaps).filter(|(new, _)| new.contains(&inner));
                    own.for_each(|(_, gaps)| gaps.add(gap));
                    seen = true;
                }
            }
            if !seen {
                return false;
            }
        }
        for &([a, b], _) in &self.old.edges {
            for &([c, d], beside) in &self.new.edges {
                if a == c || a == d || b == c || b == d {
                    continue;
                }
                let [a, b, c, d] = [a, b, c, d].map(|node| self.nodes[node]);
                let (old, new) = (b.at - a.at, d.at - c.at);
                let (of_c, of_d) = (old.perp_dot(c.at - a.at), old.perp_dot(d.at - a.at));
                let (of_a, of_b) = (new.perp_dot(a.at - c.at), new.perp_dot(b.at - c.at));
                doubtful |= [of_a, of_b, of_c, of_d].into_iter().any(|of| of.abs() <= least);
                if (of_a > 0.0) == (of_b > 0.0) || (of_c > 0.0) == (of_d > 0.0) {
                    continue;
                }
                let (along_old, along_new) = (of_a / (of_a - of_b), of_c / (of_c - of_d));
                let lerp = |a: Node, b: Node, part: f64| Gap {
                    height: a.height + part * (b.height - a.height),
                    tint: a.tint + (b.tint - a.tint) * part,
                };
                let gap = between(lerp(a, b, along_old), lerp(c, d, along_new));
                beside.into_iter().for_each(|new| gaps[new].add(gap));
            }
        }
        if doubtful {
            // Where an edge runs through a corner, it is not clear which triangles lie over which.
            let all = gaps.iter().fold(Gaps::default(), |all, gaps| all.with(*gaps));
            gaps.fill(all);
        }
        true
    }
}
