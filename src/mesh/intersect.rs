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
//! Touching counts. All signs come from adaptive exact predicates (Shewchuk 1997, by the `robust` crate), so the answer is that of the
//! coordinates as given, whatever their size; coordinates must be finite and neither overflow nor underflow when three are multiplied.

use robust::{Coord, Coord3D, orient2d, orient3d};

type Point = [f64; 3];

/// Whether triangles with vertex numbers `a` and `b` at positions `pa` and `pb` intersect. Symmetric; does not depend on which vertex comes first.
pub fn intersect(a: [u32; 3], pa: [Point; 3], b: [u32; 3], pb: [Point; 3]) -> bool {
    // Turned so that shared vertices come first: pairs (place in a, place in b).
    let mut shared = [(0, 0); 3];
    let mut count = 0;
    for (i, v) in a.iter().enumerate() {
        if let Some(j) = b.iter().position(|u| u == v)
            && count < 3
        {
            shared[count] = (i, j);
            count += 1;
        }
    }
    match count {
        0 => {
            (0..3).any(|i| segment_meets_triangle(pa[i], pa[(i + 1) % 3], pb))
                || (0..3).any(|i| segment_meets_triangle(pb[i], pb[(i + 1) % 3], pa))
        }
        1 => {
            // Whatever they share beyond the vertex reaches the side opposite to it, in one of the two.
            let (i, j) = shared[0];
            segment_meets_triangle(pa[(i + 1) % 3], pa[(i + 2) % 3], pb)
                || segment_meets_triangle(pb[(j + 1) % 3], pb[(j + 2) % 3], pa)
        }
        2 => {
            let [(i, j), (k, l), _] = shared;
            folded(pa[i], pa[k], pa[3 - i - k], pb[3 - j - l])
        }
        _ => true,
    }
}

/// Whether triangles abc and abd lie in one plane, c and d on the same side of ab.
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
    // No area at all: the two are pieces of one line, and overlap.
    true
}

/// Whether the closed segment pq and the closed triangle have a point in common.
fn segment_meets_triangle(p: Point, q: Point, [a, b, c]: [Point; 3]) -> bool {
    let (of_p, of_q) = (side_of_plane(a, b, c, p), side_of_plane(a, b, c, q));
    if of_p * of_q > 0 {
        return false;
    }
    let Some(axis) = (0..3).find(|&axis| side_of_line(axis, a, b, c) != 0) else {
        // A triangle without area is its three sides.
        return [[a, b], [b, c], [c, a]].iter().any(|&[a, b]| segments_meet(p, q, a, b));
    };
    match (of_p, of_q) {
        (0, 0) => {
            in_triangle(axis, p, [a, b, c]) || [[a, b], [b, c], [c, a]].iter().any(|&[a, b]| segments_meet(p, q, a, b))
        }
        (0, _) => in_triangle(axis, p, [a, b, c]),
        (_, 0) => in_triangle(axis, q, [a, b, c]),
        _ => one_sided([side_of_plane(p, q, a, b), side_of_plane(p, q, b, c), side_of_plane(p, q, c, a)]),
    }
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
    if side_of_plane(p, q, a, b) != 0 {
        return false;
    }
    let boxes_meet = (0..3).all(|m| p[m].min(q[m]) <= a[m].max(b[m]) && a[m].min(b[m]) <= p[m].max(q[m]));
    // In one plane they meet if, from wherever one looks, neither lies on one side of the other's line; on one line, if their boxes do.
    boxes_meet
        && (0..3).all(|axis| {
            side_of_line(axis, p, q, a) * side_of_line(axis, p, q, b) <= 0
                && side_of_line(axis, a, b, p) * side_of_line(axis, a, b, q) <= 0
        })
}

/// The side of the plane abc that d lies on: -1, 0 or 1.
fn side_of_plane(a: Point, b: Point, c: Point, d: Point) -> i32 {
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
