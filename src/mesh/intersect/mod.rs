//! Whether two triangles of a mesh meet where they should not, exactly.
//!
//! Two triangles *intersect* if they have a point in common that is not a vertex or an edge they share by number:
//!
//! ```text
//!   no vertex shared        one shared                 two shared
//!   any common point        any but the vertex         any but the edge: only if folded flat onto each other
//!     ----/\----               \  |/                      d
//!        /  \                   \ *-----                 a=====b   c and d on one side of ab, in one plane
//!       /____\                   \/                      c
//! ```
//!
//! Touching counts; so do vertices of equal position and different number. Two triangles of the same three vertices lie on
//! each other and intersect. A triangle without area is the segment or the point that its corners span, and is judged by
//! the same rule.
//!
//! All signs come from adaptive exact predicates (Shewchuk 1997, by the `robust` crate), so the answer is that of the
//! coordinates as given. These must be 0 or of a magnitude between 1e-80 and [`FARTHEST`]: then no product of three, nor
//! its rounding error, leaves the range of `f64`. Beyond that the answer may be wrong, but there is one.

#[cfg(test)]
mod tests;

use robust::{Coord, Coord3D, orient2d, orient3d};

/// The largest magnitude of a coordinate for which answers are exact.
pub const FARTHEST: f64 = 1e100;

type Point = [f64; 3];

/// Whether triangles with vertex numbers `a` and `b` at positions `pa` and `pb` intersect.
///
/// Symmetric; does not depend on which vertex comes first, nor on the way round. The three numbers of a triangle must
/// differ from each other.
pub fn intersect(a: [u32; 3], pa: [Point; 3], b: [u32; 3], pb: [Point; 3]) -> bool {
    // Pairs (place in a, place in b) of shared vertices.
    let mut shared = [(0, 0); 3];
    let mut count = 0;
    for (i, v) in a.iter().enumerate() {
        if let Some(j) = b.iter().position(|u| u == v) {
            shared[count] = (i, j);
            count += 1;
        }
    }
    match count {
        0 => {
            !beside(pa, &pb)
                && !beside(pb, &pa)
                && ((0..3).any(|i| segment_meets_triangle(pa[i], pa[(i + 1) % 3], pb))
                    || (0..3).any(|i| segment_meets_triangle(pb[i], pb[(i + 1) % 3], pa)))
        }
        1 => {
            let (i, j) = shared[0];
            let of_a = [pa[(i + 1) % 3], pa[(i + 2) % 3]];
            let of_b = [pb[(j + 1) % 3], pb[(j + 2) % 3]];
            !beside(pa, &of_b)
                && !beside(pb, &of_a)
                && (reaches_beyond(pa[i], of_a, pb) || reaches_beyond(pb[j], of_b, pa))
        }
        2 => {
            let [(i, j), (k, l), _] = shared;
            folded(pa[i], pa[k], pa[3 - i - k], pb[3 - j - l])
        }
        _ => true,
    }
}

/// Whether all points lie strictly on one side of the triangle's plane: the usual case, and a quick end.
fn beside([a, b, c]: [Point; 3], points: &[Point]) -> bool {
    let mut sides = points.iter().map(|p| side_of_plane(a, b, c, *p));
    sides.next().is_some_and(|first| first != 0 && sides.all(|side| side == first))
}

/// Whether the side opposite to the shared vertex `v` shows that the triangles have more than `v` in common.
///
/// What two triangles share is convex, so if it is more than `v` it holds a segment from `v` that ends where the first of
/// them does: on the side opposite to `v`. Without area that side may pass through `v`; then the segment ends in a corner.
fn reaches_beyond(v: Point, [p, q]: [Point; 2], other: [Point; 3]) -> bool {
    if broad_side(v, p, q).is_some() {
        segment_meets_triangle(p, q, other)
    } else {
        [p, q].iter().any(|&corner| corner != v && segment_meets_triangle(corner, corner, other))
    }
}

/// Whether triangles abc and abd have more in common than ab.
fn folded(a: Point, b: Point, c: Point, d: Point) -> bool {
    if side_of_plane(a, b, c, d) != 0 {
        return false;
    }
    for axis in 0..3 {
        let (of_c, of_d) = (side_of_line(axis, a, b, c), side_of_line(axis, a, b, d));
        if of_c != 0 || of_d != 0 {
            return of_c == of_d;
        }
    }
    // Neither has area: what they share ends in c or d, if not with ab.
    let beyond = |corner, other| segment_meets_triangle(corner, corner, other) && !segments_meet(corner, corner, a, b);
    beyond(c, [a, b, d]) || beyond(d, [a, b, c])
}

/// Whether the closed segment pq and the closed triangle have a point in common.
fn segment_meets_triangle(p: Point, q: Point, [a, b, c]: [Point; 3]) -> bool {
    let (of_p, of_q) = (side_of_plane(a, b, c, p), side_of_plane(a, b, c, q));
    if of_p * of_q > 0 {
        return false;
    }
    let sides = [[a, b], [b, c], [c, a]];
    let meets_a_side = || sides.iter().any(|&[a, b]| segments_meet(p, q, a, b));
    let Some(axis) = broad_side(a, b, c) else {
        // A triangle without area is its three sides.
        return meets_a_side();
    };
    match (of_p, of_q) {
        (0, 0) => in_triangle(axis, p, [a, b, c]) || meets_a_side(),
        (0, _) => in_triangle(axis, p, [a, b, c]),
        (_, 0) => in_triangle(axis, q, [a, b, c]),
        _ => one_sided(sides.map(|[a, b]| side_of_plane(p, q, a, b))),
    }
}

/// An axis along which the triangle is seen to have area; `None` if it has none.
fn broad_side(a: Point, b: Point, c: Point) -> Option<usize> {
    (0..3).find(|&axis| side_of_line(axis, a, b, c) != 0)
}

/// Whether p, in the triangle's plane, lies in the triangle. The triangle must have area when seen along `axis`.
fn in_triangle(axis: usize, p: Point, [a, b, c]: [Point; 3]) -> bool {
    one_sided([side_of_line(axis, a, b, p), side_of_line(axis, b, c, p), side_of_line(axis, c, a, p)])
}

fn one_sided(sides: [i32; 3]) -> bool {
    sides.iter().all(|s| *s >= 0) || sides.iter().all(|s| *s <= 0)
}

/// Whether two closed segments have a point in common.
fn segments_meet(p: Point, q: Point, a: Point, b: Point) -> bool {
    let boxes_meet = (0..3).all(|m| p[m].min(q[m]) <= a[m].max(b[m]) && a[m].min(b[m]) <= p[m].max(q[m]));
    // In one plane they meet if, from wherever one looks, neither lies on one side of the other's line; on one line, if
    // their boxes do.
    boxes_meet
        && side_of_plane(p, q, a, b) == 0
        && (0..3).all(|axis| {
            side_of_line(axis, p, q, a) * side_of_line(axis, p, q, b) <= 0
                && side_of_line(axis, a, b, p) * side_of_line(axis, a, b, q) <= 0
        })
}

/// The side of the plane abc that d lies on: -1, 0 or 1.
fn side_of_plane(a: Point, b: Point, c: Point, d: Point) -> i32 {
    // A plane across an axis is common in surfaces made of cells, and the adaptive predicate is slow to find nothing.
    if (0..3).any(|m| a[m] == b[m] && a[m] == c[m] && a[m] == d[m]) {
        return 0;
    }
    let coord = |[x, y, z]: Point| Coord3D { x, y, z };
    sign(orient3d(coord(a), coord(b), coord(c), coord(d)))
}

/// The side of the line ab that c lies on, seen along `axis`: -1, 0 or 1.
fn side_of_line(axis: usize, a: Point, b: Point, c: Point) -> i32 {
    let coord = |p: Point| Coord { x: p[(axis + 1) % 3], y: p[(axis + 2) % 3] };
    sign(orient2d(coord(a), coord(b), coord(c)))
}

fn sign(x: f64) -> i32 {
    i32::from(x > 0.0) - i32::from(x < 0.0)
}
