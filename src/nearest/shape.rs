//! Points, triangles and boxes: how far, and where along a line. In `f64`, relative to whoever asks.
//!
//! What is found must not depend on how targets are grouped into boxes, to the last bit. So a box's bound is never more than what is computed for a target
//! in it, in spite of rounding: results are clamped to the target's own box, by the same arithmetic, and each of its operations is monotone.
//!
//! ```text
//!            p                  what is nearest is
//!            | d2                 within the triangle, if p stands over it (seen along its normal),
//!        a___|____ c              on a side, or a corner, else. Sides are computed alike from both
//!         \  |   /                triangles that share them, so equally near means equal bits
//!          \ *  /
//!           \  /      box: p's distance to [low, high] along each axis
//!            b
//! ```

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// The largest magnitude of a coordinate that is looked at: beyond, products would leave the range of `f64`.
const FARTHEST: f64 = 1e75;

/// A triangle whose height is a smaller part of its longest side has the distance of its sides: its normal is mostly rounding. Squared.
const FLAT: f64 = 1e-16;

/// Part by which the stretch of a line within a box is made longer, so that rounding does not let a line slip between two boxes.
const SLIP: f64 = 1e-15;

/// Components of directions below this are none.
const LEVEL: f64 = 1e-200;

/// A place.
pub(crate) type Point = [f64; 3];

/// Whether a place can be looked at: it is finite, and not absurdly far.
pub(crate) fn is_usable(p: Point) -> bool {
    // Not what compares false: NaN is left out, too.
    p.iter().all(|c| c.abs() <= FARTHEST)
}

/// A box along the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cuboid {
    pub low: Point,
    pub high: Point,
}

impl Cuboid {
    /// Holds nothing.
    pub const EMPTY: Cuboid = Cuboid { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };

    /// The box of both.
    pub fn with(&self, other: &Cuboid) -> Cuboid {
        Cuboid {
            low: std::array::from_fn(|a| self.low[a].min(other.low[a])),
            high: std::array::from_fn(|a| self.high[a].max(other.high[a])),
        }
    }

    /// The axis along which it is longest.
    pub fn longest(&self) -> usize {
        let extent = |a: usize| self.high[a] - self.low[a];
        (1..3).fold(0, |best, a| if extent(a) > extent(best) { a } else { best })
    }

    /// The length of its longest side.
    pub fn side(&self) -> f64 {
        let axis = self.longest();
        self.high[axis] - self.low[axis]
    }

    /// The squared distance from `p`; 0 within.
    pub fn distance2(&self, p: Point) -> f64 {
        length2(std::array::from_fn(|a| (self.low[a] - p[a]).max(p[a] - self.high[a]).max(0.0)))
    }

    /// How far along a line, either way, it is to the box; infinite if the line passes it by.
    pub fn entry(&self, line: &Line) -> f64 {
        self.stretch(line).map_or(f64::INFINITY, |(from, to)| from.max(-to).max(0.0))
    }

    /// The stretch of a line within the box.
    fn stretch(&self, line: &Line) -> Option<(f64, f64)> {
        let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
        for a in 0..3 {
            let (low, high) = (self.low[a] - line.origin[a], self.high[a] - line.origin[a]);
            if line.direction[a].abs() < LEVEL {
                if low > 0.0 || high < 0.0 {
                    return None;
                }
                continue;
            }
            let (low, high) = (low / line.direction[a], high / line.direction[a]);
            let (low, high) = if line.direction[a] > 0.0 { (low, high) } else { (high, low) };
            from = from.max(low - low.abs() * SLIP);
            to = to.min(high + high.abs() * SLIP);
        }
        (from <= to).then_some((from, to))
    }
}

/// The squared length; the order of additions is that of every distance here.
fn length2([x, y, z]: Point) -> f64 {
    x * x + y * y + z * z
}

/// A line through a place, along a direction of length 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    pub origin: Point,
    pub direction: Point,
}

/// What distances are measured to.
pub(crate) trait Target: Copy + Send + Sync {
    /// Its box.
    fn cuboid(&self) -> Cuboid;
    /// Where it is sorted to.
    fn middle(&self) -> Point;
    /// The squared distance from `p`, no less than that to the box.
    fn distance2(&self, p: Point) -> f64;
}

/// A point as a target.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(transparent)]
pub(crate) struct Spot(pub Point);

impl Target for Spot {
    fn cuboid(&self) -> Cuboid {
        Cuboid { low: self.0, high: self.0 }
    }

    fn middle(&self) -> Point {
        self.0
    }

    fn distance2(&self, p: Point) -> f64 {
        length2(std::array::from_fn(|a| self.0[a] - p[a]))
    }
}

/// Three corners.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(transparent)]
pub(crate) struct Triangle(pub [Point; 3]);

impl Triangle {
    /// Its centroid.
    pub fn centroid(&self) -> Point {
        let [a, b, c] = &self.0;
        std::array::from_fn(|m| (a[m] + b[m] + c[m]) / 3.0)
    }

    /// The unit normal, to the side from which the corners run counter-clockwise; `None` without area.
    pub fn normal(&self) -> Option<Point> {
        let [a, b, c] = self.0.map(DVec3::from_array);
        (b - a).cross(c - a).try_normalize().map(|n| n.to_array())
    }

    /// How far along a line, either way, it is to the triangle, if they meet. A line in the triangle's plane does not.
    ///
    /// Lines do not slip between triangles that share an edge: on which side of it they pass has one answer for both.
    pub fn crossing(&self, line: &Line) -> Option<f64> {
        let (from, to) = self.cuboid().stretch(line)?;
        let (o, d) = (DVec3::from_array(line.origin), DVec3::from_array(line.direction));
        let [a, b, c] = self.0.map(|p| DVec3::from_array(p) - o);
        let sides = [d.dot(b.cross(c)), d.dot(c.cross(a)), d.dot(a.cross(b))];
        if !(sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)) {
            return None;
        }
        let n = (b - a).cross(c - a);
        let along = n.dot(d);
        let t = n.dot(a) / along;
        // Along is 0, or as good as that, if the line lies in the plane.
        t.is_finite().then(|| t.clamp(from, to).abs())
    }
}

impl Target for Triangle {
    fn cuboid(&self) -> Cuboid {
        around(&self.0)
    }

    fn middle(&self) -> Point {
        let [a, b, c] = &self.0;
        std::array::from_fn(|m| (a[m] + b[m] + c[m]) * (1.0 / 3.0))
    }

    fn distance2(&self, p: Point) -> f64 {
        let corners = self.0.map(|corner| std::array::from_fn(|m| corner[m] - p[m]));
        let [a, b, c] = corners.map(DVec3::from_array);
        let (ab, bc, ca) = (b - a, c - b, a - c);
        let n = bc.cross(ca);
        let (square, longest) =
            (n.length_squared(), ab.length_squared().max(bc.length_squared()).max(ca.length_squared()));
        if square > FLAT * longest * longest {
            let over = n.dot(a.cross(ab)) >= 0.0 && n.dot(b.cross(bc)) >= 0.0 && n.dot(c.cross(ca)) >= 0.0;
            if over {
                return within(n * (n.dot(a) / square), &around(&corners));
            }
        }
        side(corners[0], corners[1]).min(side(corners[1], corners[2])).min(side(corners[2], corners[0]))
    }
}

/// The box of some points.
fn around(points: &[Point]) -> Cuboid {
    points.iter().fold(Cuboid::EMPTY, |cuboid, p| cuboid.with(&Cuboid { low: *p, high: *p }))
}

/// The squared distance of a place that ought to lie in the box.
fn within(place: DVec3, cuboid: &Cuboid) -> f64 {
    let place = place.to_array();
    // Not `clamp`, which panics where a place is not a number.
    length2(std::array::from_fn(|a| place[a].max(cuboid.low[a]).min(cuboid.high[a])))
}

/// The squared distance of the origin from a segment, the same for both directions.
fn side(a: Point, b: Point) -> f64 {
    let (a, b) = if a <= b { (a, b) } else { (b, a) };
    let (from, to) = (DVec3::from_array(a), DVec3::from_array(b));
    let way = to - from;
    let at = -from.dot(way) / way.length_squared();
    if at >= 1.0 {
        length2(b)
    } else if at > 0.0 {
        within(from + way * at, &around(&[a, b]))
    } else {
        length2(a)
    }
}

/// The angle between two directions, in degrees, accurate for small ones, too.
pub(crate) fn angle(a: Point, b: Point) -> f64 {
    let (a, b) = (DVec3::from_array(a), DVec3::from_array(b));
    libm::atan2(a.cross(b).length(), a.dot(b)).to_degrees()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Where a convex function of 0 to 1 is least, and what it is there.
    fn least(f: impl Fn(f64) -> f64) -> f64 {
        let (mut from, mut to) = (0.0, 1.0);
        for _ in 0..80 {
            let [left, right] = [from + (to - from) / 3.0, to - (to - from) / 3.0];
            if f(left) < f(right) { to = right } else { from = left }
        }
        f(from).min(f(to))
    }

    /// The distance by another way: the squared distance is convex, so its least value is sought.
    fn sought(triangle: &Triangle, p: Point) -> f64 {
        let [a, b, c] = triangle.0.map(DVec3::from_array);
        let p = DVec3::from_array(p);
        least(|s| least(|t| (a + ((b - a) * t + (c - a) * (1.0 - t)) * s).distance_squared(p))).sqrt()
    }

    fn place() -> impl Strategy<Value = Point> {
        let whole = prop::array::uniform3((-3i32..4).prop_map(f64::from));
        prop_oneof![whole, prop::array::uniform3(-3.0..3.0f64)]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn distances_are_those_of_a_search_and_no_less_than_the_box(corners in prop::array::uniform3(place()), p in place()) {
            let triangle = Triangle(corners);
            let d2 = triangle.distance2(p);
            prop_assert!((d2.sqrt() - sought(&triangle, p)).abs() < 1e-6, "{} {}", d2.sqrt(), sought(&triangle, p));
            prop_assert!(triangle.cuboid().distance2(p) <= d2);
            let [a, b, c] = corners;
            for turned in [[b, c, a], [c, a, b], [a, c, b]] {
                prop_assert!((Triangle(turned).distance2(p).sqrt() - d2.sqrt()).abs() < 1e-12);
            }
        }

        #[test]
        fn a_line_meets_a_triangle_where_weights_say(corners in prop::array::uniform3(place()), weights in prop::array::uniform3(0.01..1.0f64), t in -3.0..3.0f64, towards in place()) {
            let triangle = Triangle(corners);
            let direction = DVec3::from_array(towards).try_normalize();
            prop_assume!(direction.is_some() && triangle.normal().is_some());
            let direction = direction.unwrap();
            let steep = direction.dot(DVec3::from_array(triangle.normal().unwrap())).abs();
            prop_assume!(steep > 1e-3);
            let sum: f64 = weights.iter().sum();
            let hit: DVec3 = (0..3).map(|i| DVec3::from_array(corners[i]) * (weights[i] / sum)).sum();
            let line = Line { origin: (hit - direction * t).to_array(), direction: direction.to_array() };
            let found = triangle.crossing(&line);
            prop_assert!((found.unwrap() - t.abs()).abs() < 1e-9, "{:?} {}", found, t);
            prop_assert!(triangle.cuboid().entry(&line) <= found.unwrap());
            // Mirrored at a side, it is outside.
            let beside = DVec3::from_array(corners[0]) + DVec3::from_array(corners[1]) - hit;
            let line = Line { origin: (beside - direction * t).to_array(), ..line };
            prop_assert_eq!(triangle.crossing(&line), None);
        }

        #[test]
        fn sides_are_the_same_bits_from_both_triangles(a in place(), b in place(), c in place(), p in place()) {
            let to = |q: Point| std::array::from_fn(|m| q[m] - p[m]);
            prop_assert_eq!(side(to(a), to(b)).to_bits(), side(to(b), to(a)).to_bits());
            // Neither of the two triangles of a side lies farther off than it, but for rounding: where a place is over one of them, its plane counts.
            for triangle in [[a, b, c], [b, a, c]] {
                prop_assert!(Triangle(triangle).distance2(p).sqrt() <= side(to(a), to(b)).sqrt() + 1e-9);
            }
        }
    }

    #[test]
    fn what_has_no_area_is_a_segment_or_a_point() {
        let [a, b] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        for corners in [[a, b, a], [a, a, b], [a, b, b], [a, [1.0, 0.0, 0.0], b], [b, [0.5, 1e-13, 0.0], a]] {
            let triangle = Triangle(corners);
            assert!((triangle.distance2([1.0, 3.0, 4.0]) - 25.0).abs() < 1e-9);
            assert_eq!(triangle.distance2([3.0, 0.0, 0.0]), 1.0);
        }
        assert_eq!(Triangle([b; 3]).distance2([0.0; 3]), 4.0);
        assert_eq!(Triangle([b; 3]).normal(), None);
        let line = Line { origin: [1.0, 0.0, -1.0], direction: [0.0, 0.0, 1.0] };
        assert_eq!(Triangle([a, b, a]).crossing(&line), None);
    }

    #[test]
    fn angles_are_degrees() {
        let [x, y] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        assert_eq!([angle(x, x), angle(x, y), angle(x, [-1.0, 0.0, 0.0])], [0.0, 90.0, 180.0]);
        assert!((angle(x, [1.0, 1e-9, 0.0]) - 1e-9f64.to_degrees()).abs() < 1e-20);
    }
}
