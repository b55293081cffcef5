//! Stars: the triangles round a vertex, seen along an axis. If they all turn the same way there and go round once, no two of them intersect.
//!
//! ```text
//!     c---b---a       the *star* of v are the triangles at v, its *ring* the rectangles at v: both their triangles. If the rectangles are
//!     |\  |   |       convex, too, each lies within its sector at v (between d and b, for one), and no two triangles of the ring intersect.
//!     | \ |   |       On a smooth surface nearly all vertices have such a ring, so that nothing that touches them need be looked at again.
//!     d---v---h
//!     |   |\  |
//!     e---f--\g
//! ```

use std::cell::Cell;

use robust::{Coord, orient2d};

use crate::points::vector::{cross, minus};
use crate::surface::contract::{NONE, is_gone};
use crate::surface::untangle::broad_phase::corners;
use crate::surface::untangle::submesh::Submesh;

/// What is known of the triangles at a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Star {
    /// Nothing.
    Unknown,
    /// Each pair has to be looked at.
    Doubtful,
    /// No two of its star intersect.
    Free,
    /// No two of its ring intersect.
    Ring,
}

/// Bytes that [`all_stars`] needs for so many vertices.
pub fn bytes(vertices: u64) -> u64 {
    vertices * (size_of::<u64>() + size_of::<Star>()) as u64
}

/// What is to be said of all vertices, in one pass over the triangles. May be in doubt, or say less, where a closer look would not.
///
/// ```text
///   bits 0-5    seen along axis a, some triangle may not turn left (bit 2 a), or not right (bit 2 a + 1)
///   bits 6-11   the same of some rectangle, whichever of its diagonals cuts it
///   bits 16-63  sixteen for each axis: crossings of the ray
/// ```
pub fn all_stars<P: Submesh>(submesh: &P) -> Vec<Cell<Star>> {
    let mut seen = vec![0u64; submesh.vertices() as usize];
    for first in submesh.stretches().into_iter().flat_map(|stretch| stretch.step_by(2)) {
        let both = [submesh.known(first), submesh.known(first + 1)];
        let mut not = [0; 2];
        for ((triangle, not), t) in both.into_iter().zip(&mut not).zip(first..) {
            match triangle {
                Some(triangle) => *not = add(&mut seen, triangle, triangle.map(|v| submesh.place(v))),
                None => leave_open(&mut seen, submesh, t),
            }
        }
        match (corners(both), both) {
            (Some(around), [Some(_), Some(_)]) => {
                // Each diagonal's triangles make the rectangle; the fourth is looked at, too, so that rounding is no matter.
                let [p0, p1, p2, p3] = around.map(|v| submesh.place(v));
                let [a, b, c, d] = [[p0, p1, p2], [p0, p2, p3], [p0, p1, p3], [p1, p2, p3]].map(|t| turns(t).1);
                around.into_iter().for_each(|v| seen[v as usize] |= (a | b | c | d) << RING);
            }
            (Some([a, b, c, _]), _) => {
                [a, b, c].into_iter().for_each(|v| seen[v as usize] |= (not[0] | not[1]) << RING)
            }
            (None, _) => both.into_iter().flatten().flatten().for_each(|v| seen[v as usize] |= NEITHER << RING),
        }
    }
    let turns_one_way = |seen: u64, a: usize| seen >> (2 * a) & 3 != 3 && seen >> (16 * (a + 1)) & 0xffff == 1;
    let said = |seen: u64| {
        if (0..3).any(|a| turns_one_way(seen | seen >> RING & NEITHER, a)) {
            Star::Ring
        } else if (0..3).any(|a| turns_one_way(seen, a)) {
            Star::Free
        } else {
            Star::Doubtful
        }
    };
    seen.into_iter().map(|seen| Cell::new(said(seen))).collect()
}

/// Bits of all axes and both directions, and how far those of rectangles are shifted.
const NEITHER: u64 = 0b11_1111;
const RING: u32 = 6;

/// Adds a triangle to the stars of its corners. Gives its turns.
#[inline]
fn add(seen: &mut [u64], triangle: [u32; 3], places: [[f64; 3]; 3]) -> u64 {
    let (normal, not) = turns(places);
    for i in 0..3 {
        let (centre, from, to) = (places[i], places[(i + 1) % 3], places[(i + 2) % 3]);
        let mut crossings = 0;
        for (a, n) in normal.into_iter().enumerate() {
            let y = (a + 2) % 3;
            let upwards = (from[y] < centre[y]) & (centre[y] <= to[y]);
            let downwards = (to[y] < centre[y]) & (centre[y] <= from[y]);
            let left = n > 0.0;
            crossings += u64::from((left & upwards) | (!left & downwards)) << (16 * (a + 1));
        }
        // A vertex has far fewer triangles than sixteen bits can count.
        let seen = &mut seen[triangle[i] as usize];
        *seen = (*seen | not) + crossings;
    }
    not
}

/// A triangle's normal, and along which axes it may not turn left, or not right.
#[inline]
fn turns(places: [[f64; 3]; 3]) -> ([f64; 3], u64) {
    let (ab, ac) = (minus(places[1], places[0]), minus(places[2], places[0]));
    let largest = ab.iter().chain(&ac).fold(0.0f64, |m, d| m.max(d.abs()));
    let doubt = 1e-14 * largest * largest;
    let normal = cross(ab, ac);
    let mut not = 0;
    for (a, n) in normal.into_iter().enumerate() {
        not |= u64::from(n <= doubt) << (2 * a) | u64::from(n >= -doubt) << (2 * a + 1);
    }
    (normal, not)
}

/// If triangle `t` is left, but not known, nothing is said of the vertices it touches.
fn leave_open<P: Submesh>(seen: &mut [u64], submesh: &P, t: u32) {
    if submesh.stretches().iter().any(|stretch| stretch.contains(&t)) && !is_gone(submesh.triangle(t)) {
        for v in submesh.triangle(t) {
            if let Some(seen) = seen.get_mut(v as usize) {
                *seen |= NEITHER | NEITHER << RING;
            }
        }
    }
}

/// Whether, seen along some axis, all triangles at `v` turn the same way and go round it once: then no two of them intersect.
///
/// Exact, as the turns are. Of a star with a triangle that is not known nothing is said.
pub fn star_is_free<P: Submesh>(submesh: &P, v: u32) -> bool {
    let centre = submesh.place(v);
    let mut link: [([f64; 3], [f64; 3]); MOST_IN_STAR] = [([0.0; 3], [0.0; 3]); MOST_IN_STAR];
    let mut count = 0;
    let mut member = v;
    while member != NONE {
        for corner in submesh.corners(member) {
            let triangle = submesh.triangle(corner / 3);
            if is_gone(triangle) {
                continue;
            }
            if count == MOST_IN_STAR || !submesh.is_known(triangle) {
                return false;
            }
            let at = corner as usize % 3;
            link[count] = (submesh.place(triangle[(at + 1) % 3]), submesh.place(triangle[(at + 2) % 3]));
            count += 1;
        }
        member = submesh.also(member);
    }
    let link = &link[..count];
    (0..3).any(|axis| goes_round_once(centre, link, axis))
}

/// Stars with more triangles are rare, and looked at pair by pair.
const MOST_IN_STAR: usize = 24;

fn goes_round_once(centre: [f64; 3], link: &[([f64; 3], [f64; 3])], axis: usize) -> bool {
    let flat = |p: [f64; 3]| Coord { x: p[(axis + 1) % 3], y: p[(axis + 2) % 3] };
    let centre = flat(centre);
    let mut sides = link.iter().map(|&(a, b)| orient2d(centre, flat(a), flat(b)));
    let Some(first) = sides.next() else { return false };
    if first == 0.0 || !sides.all(|side| if first > 0.0 { side > 0.0 } else { side < 0.0 }) {
        return false;
    }
    // Every turn crosses the ray from the centre along +x once, upwards if turns are to the left.
    let crosses = |a: f64, b: f64| a < centre.y && centre.y <= b;
    let crossings = link.iter().filter(|&&(a, b)| {
        let (a, b) = (flat(a).y, flat(b).y);
        if first > 0.0 { crosses(a, b) } else { crosses(b, a) }
    });
    crossings.count() == 1
}
