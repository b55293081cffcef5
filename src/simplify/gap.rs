//! How far a surface moves when one vertex goes: a bound for both directions.
//!
//! The triangles round the vertex u cover a polygon when they are seen along an axis, and so do the triangles that come in their place. Every place of one
//! surface has a place of the other straight above or below it. Both are flat in pieces, so the distance between the two is greatest at a corner of their
//! overlay: at u itself, or where an edge that was there crosses one that comes (successive mappings: Cohen, Olano, Manocha 1997).
//!
//! ```text
//!        r2 ------- r1            old edges: u to every r          new edges: r0 to r2, r3, r4
//!       /  `.     .'  \
//!      /     `. .'     \          corners of the overlay: u, and the crossings of u-r1 with r0-r2,
//!    r3 - - - -u- - - - r0        of u-r2 with r0-r3, of u-r4 ... with r0-r3, and so on
//!      \     .' `.     /
//!       \  .'     `.  /
//!        r4 ------- r5
//! ```
//!
//! The map that it makes is one to one and continuous, so that bounds of collapses one after the other add up.

use glam::{DVec2, DVec3};

/// Vertices of a ring, at most.
pub(super) const MOST: usize = 64;

/// Rounding of all that is computed here, as a part of the star's size: bounds are made greater by so much.
pub(super) const ROUNDING: f64 = 1e-13;

/// A star whose middle vertex is going to its ring's first vertex: places relative to the vertex that goes, seen along an axis.
#[derive(Debug, Default)]
pub(super) struct Overlay {
    /// Two axes across that which it is seen along.
    right: DVec3,
    up: DVec3,
    /// The ring, across the axis.
    across: Vec<DVec2>,
    /// The ring, along the axis.
    height: Vec<f64>,
    /// Both, from the ring's first vertex on, whichever the vertex goes to.
    ring: Vec<(DVec2, f64)>,
    /// Whether the old triangles cover a polygon once.
    covered: bool,
    gaps: Vec<[f64; 2]>,
    spent: Vec<Drift>,
    /// The largest distance of the ring from the vertex.
    size: f64,
    /// The place the vertex is moved to first; itself in a closed star, a place of the new rim in an open one.
    middle: (DVec2, f64),
    /// The way there.
    moved: DVec3,
    closed: bool,
}

/// Twice the area of a triangle, positive if it runs counter-clockwise.
pub(super) fn area(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

/// Two axes that, with a unit vector, make a right-handed system (Duff et al. 2017).
pub(super) fn across(axis: DVec3) -> (DVec3, DVec3) {
    let sign = 1f64.copysign(axis.z);
    let a = -1.0 / (sign + axis.z);
    let b = axis.x * axis.y * a;
    let right = DVec3::new(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x);
    (right, DVec3::new(b, sign + axis.y * axis.y * a, -axis.y))
}

impl Overlay {
    /// Where the ring's vertex of this number is, across the axis and along it.
    pub(super) fn node(&self, number: usize) -> (DVec2, f64) {
        (self.across[number], self.height[number])
    }

    /// Where the vertex is that goes, or, in an open star, was moved to.
    pub(super) fn middle(&self) -> (DVec2, f64) {
        self.middle
    }

    /// The largest distance of the ring from the vertex.
    pub(super) fn size(&self) -> f64 {
        self.size
    }

    /// The two axes across that which it is seen along.
    pub(super) fn axes(&self) -> (DVec3, DVec3) {
        (self.right, self.up)
    }

    /// Looks at a star along a unit vector `axis`. `ring` gives places relative to the vertex that goes, beginning with the vertex that it goes to.
    /// `false` if the old or the new triangles do not cover one polygon once, seen from there.
    pub(super) fn look(&mut self, axis: DVec3, ring: impl Iterator<Item = DVec3>, closed: bool) -> bool {
        self.look_at(axis, ring, closed);
        self.turn(0)
    }

    /// Looks at a star as [`Overlay::look`] does. A closed one may begin anywhere: [`Overlay::turn`] tells which vertex is the one gone to, so that what does not depend on
    /// it is found once for all neighbours that are tried.
    pub(super) fn look_at(&mut self, axis: DVec3, ring: impl Iterator<Item = DVec3>, closed: bool) {
        let (right, up) = across(axis);
        (self.right, self.up) = (right, up);
        self.ring.clear();
        self.closed = closed;
        let mut size = 0f64;
        let mut first = DVec3::ZERO;
        let mut last = DVec3::ZERO;
        for place in ring {
            if self.ring.is_empty() {
                first = place;
            }
            last = place;
            size = size.max(place.length_squared());
            self.ring.push((DVec2::new(place.dot(right), place.dot(up)), place.dot(axis)));
        }
        self.size = size.sqrt();
        (self.middle, self.moved) = ((DVec2::ZERO, 0.0), DVec3::ZERO);
        if !closed {
            let rim = last - first;
            let part = (-first.dot(rim) / rim.length_squared()).clamp(0.0, 1.0);
            let on_rim = first + rim * part;
            self.middle = (DVec2::new(on_rim.dot(right), on_rim.dot(up)), on_rim.dot(axis));
            self.moved = on_rim;
        }
        self.covered = self.old_cover_once();
    }

    /// The vertex goes to that of the ring with this number. `false` if the old or the new triangles do not cover one polygon once.
    pub(super) fn turn(&mut self, to: usize) -> bool {
        let (before, from) = self.ring.split_at(to);
        self.across.clear();
        self.height.clear();
        for &(at, height) in from.iter().chain(before) {
            self.across.push(at);
            self.height.push(height);
        }
        let (ring, n) = (&self.across, self.across.len());
        let least = ROUNDING * self.size * self.size;
        self.covered && (1..n - 1).all(|k| area(ring[0], ring[k], ring[k + 1]) > least)
    }

    /// The way that the middle is moved before it is looked at: none in a closed star.
    pub(super) fn moved(&self) -> DVec3 {
        self.moved
    }

    fn old_cover_once(&self) -> bool {
        let (ring, n) = (&self.ring, self.ring.len());
        let least = ROUNDING * self.size * self.size;
        let m = self.middle.0;
        if self.closed {
            // Counter-clockwise all along and once round: the ring passes a ray from u once.
            let mut rounds = 0;
            let mut p = ring[n - 1].0;
            for &(q, _) in ring {
                if area(m, p, q) <= least {
                    return false;
                }
                rounds += i32::from(p.y < 0.0 && q.y >= 0.0);
                p = q;
            }
            rounds == 1
        } else {
            // All lie on one side of the new rim, so that from there one sees no more than half of the way round.
            let rim = |k: usize| area(ring[n - 1].0, ring[0].0, ring[k].0) > least;
            (1..n - 1).all(rim) && (0..n - 1).all(|i| area(m, ring[i].0, ring[i + 1].0) >= -least)
        }
    }

    /// For each new triangle, of ring vertices 0, k and k + 1: the most that old triangles under it have used up, and the largest distance between the two
    /// surfaces there, together. `used` tells what old triangle j, of ring vertices j and j + 1, has used up. `false`, and no bounds, where one of them has a way longer
    /// than `tolerance` for sure, as soon as that is clear.
    ///
    /// Greater than the truth by a rounding, never less.
    pub(super) fn bounds(
        &mut self,
        axis: DVec3,
        tolerance: f64,
        used: impl Fn(usize) -> Drift,
        bounds: &mut Vec<Drift>,
    ) -> bool {
        let (ring, height, n) = (&self.across, &self.height, self.across.len());
        let (m, h) = self.middle;
        let old = if self.closed { n } else { n - 1 };
        let before = |j: usize| if j == 0 { old - 1 } else { j - 1 };
        // Of each new triangle: the greatest gap, and the greatest that was used up below it.
        let (gaps, spent) = (&mut self.gaps, &mut self.spent);
        gaps.clear();
        gaps.resize(n, [0.0; 2]);
        spent.clear();
        spent.resize(n, Drift::NONE);
        let (moved, more) = (self.moved, ROUNDING * self.size);
        let bound = |spent: Drift, gap: [f64; 2]| spent.along(moved, [-1.0, 0.0]).along(axis, gap).wider(more);
        let least = ROUNDING * self.size * self.size;
        let mut doubtful = !self.closed;
        spent[1..n - 1].iter_mut().zip(1..).for_each(|(spent, k)| *spent = used(k));
        spent[1] = spent[1].with(used(0));
        if self.closed {
            spent[n - 2] = spent[n - 2].with(used(n - 1));
        }
        let r0 = ring[0];
        if self.closed {
            // The middle, over the triangle that it lies in.
            let k =
                (1..n - 1).find(|&k| k == n - 2 || area(r0, ring[k + 1], m) <= 0.0).expect("a polygon has a triangle");
            let (p, q) = (ring[k], ring[k + 1]);
            let whole = area(r0, p, q);
            let (of_p, of_q) = (area(r0, m, q) / whole, area(r0, p, m) / whole);
            let above = height[0] + of_p * (height[k] - height[0]) + of_q * (height[k + 1] - height[0]);
            gaps[k] = [(h - above).min(0.0), (h - above).max(0.0)];
            spent[k] = (0..old).map(&used).fold(spent[k], Drift::with);
            // What comes below makes boxes greater only, and each operation on their ends rounds one way throughout: none of them gets less.
            if bound(spent[k], gaps[k]).most() > tolerance {
                return false;
            }
        }
        // Crossings of m-r_j with r_0-r_k.
        for k in 2..n - 1 {
            let diagonal = ring[k] - r0;
            let of_m = diagonal.perp_dot(m - r0);
            doubtful |= of_m.abs() <= least;
            for j in 1..n {
                if j == k {
                    continue;
                }
                let of_j = diagonal.perp_dot(ring[j] - r0);
                if (of_m > 0.0) == (of_j > 0.0) {
                    continue;
                }
                let spoke = ring[j] - m;
                let (of_0, of_k) = (spoke.perp_dot(r0 - m), spoke.perp_dot(ring[k] - m));
                doubtful |= of_0.abs() <= least || of_k.abs() <= least || of_j.abs() <= least;
                if (of_0 > 0.0) == (of_k > 0.0) {
                    continue;
                }
                let along_spoke = of_m / (of_m - of_j);
                let along_diagonal = of_0 / (of_0 - of_k);
                let old_height = h + along_spoke * (height[j] - h);
                let new_height = height[0] + along_diagonal * (height[k] - height[0]);
                let gap = old_height - new_height;
                let below = if j < old { used(before(j)).with(used(j)) } else { used(before(j)) };
                for new in [k - 1, k] {
                    gaps[new] = [gaps[new][0].min(gap), gaps[new][1].max(gap)];
                    spent[new] = spent[new].with(below);
                }
            }
        }
        if doubtful {
            // Where an edge runs through a corner, it is not clear which triangles lie over which.
            let most = (0..old).map(&used).fold(Drift::NONE, Drift::with);
            spent[1..n - 1].fill(most);
            let gap = gaps[1..n - 1].iter().fold([0f64; 2], |all, gap| [all[0].min(gap[0]), all[1].max(gap[1])]);
            gaps[1..n - 1].fill(gap);
        }
        bounds.clear();
        bounds.extend((1..n - 1).map(|k| bound(spent[k], gaps[k])));
        true
    }
}

/// Where the places of a triangle may have been at first, relative to where they are: a box of ways.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Drift {
    pub(super) low: DVec3,
    pub(super) high: DVec3,
}

impl Drift {
    /// Nothing has moved.
    pub(super) const NONE: Drift = Drift { low: DVec3::ZERO, high: DVec3::ZERO };

    /// What holds both.
    pub(super) fn with(self, other: Drift) -> Drift {
        Drift { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// After all places have moved by a part of `axis` between the two given, against it.
    pub(super) fn along(self, axis: DVec3, [least, most]: [f64; 2]) -> Drift {
        let (a, b) = (axis * least, axis * most);
        Drift { low: self.low + a.min(b), high: self.high + a.max(b) }
    }

    /// After all places have moved by so much, wherever to.
    pub(super) fn wider(self, way: f64) -> Drift {
        Drift { low: self.low - way, high: self.high + way }
    }

    /// The greatest number in it, whatever its sign.
    pub(super) fn greatest(self) -> f64 {
        self.low.abs().max(self.high.abs()).max_element()
    }

    /// The longest way.
    pub(super) fn most(self) -> f64 {
        self.low.abs().max(self.high.abs()).length()
    }
}
