//! Diagonals of faces, chosen anew where vertices are at their points.
//!
//! ```text
//!   before fitting        at the points
//!     d-------c              d
//!     |     / |               \`.         the face has become reflex, and one of its triangles
//!     |  /    |                c  `.      is turned over; the diagonal from b to d leaves both
//!     a-------b               /  `-_`.    as they should be
//!                            a--------b
//! ```

use crate::points::vector::{cross, dot, minus};
use crate::surface::extract::second_is_delaunay;
use crate::surface::untangle::broad_phase::corners;
use crate::surface::vertices::{Kind, Vertex};

/// Vertices and their places. Faces with other corners are left as they are.
#[derive(Debug, Clone, Copy)]
pub struct Places<'a> {
    /// The vertices.
    pub vertices: &'a [Vertex],
    /// Where each is, in cells: at its point, if it has one.
    pub places: &'a [[f64; 3]],
    /// The vertex that triangles call 0.
    pub first: u32,
}

/// Chooses the diagonals of all faces whose corners are at four places: of two triangles each, one after the other.
pub fn choose(triangles: &mut [[u32; 3]], at: Places<'_>) {
    let mut rest = triangles;
    while let [one, other, ..] = rest {
        let Some(v @ [a, b, c, d]) = face([*one, *other], at.vertices, at.first) else {
            // The third triangle of a face with a midpoint stands alone.
            rest = &mut rest[1..];
            continue;
        };
        let is_second = one[1] == other[0];
        let takes_second = takes_second(v.map(|v| at.places[(v + at.first) as usize]), is_second);
        if takes_second != is_second {
            [*one, *other] = if takes_second { [[a, b, d], [b, c, d]] } else { [[a, b, c], [a, c, d]] };
        }
        rest = &mut rest[2..];
    }
}

/// The corners in turn of the face that two triangles make, if they do.
fn face(both: [[u32; 3]; 2], vertices: &[Vertex], first: u32) -> Option<[u32; 4]> {
    let corners = corners(both.map(Some))?;
    // Two triangles of faces side by side may look like one, and so may those that a midpoint makes.
    let numbers = corners.map(|v| (v + first) as usize);
    if numbers.iter().any(|v| *v >= vertices.len()) {
        return None;
    }
    let vertices = numbers.map(|v| &vertices[v]);
    let width = |a: usize| {
        let along = vertices.map(|vertex| vertex.corner[a]);
        along.iter().max().zip(along.iter().min()).map_or(0, |(most, least)| most - least)
    };
    let is_whole = vertices.iter().all(|vertex| matches!(vertex.kind, Kind::Sheet(_)));
    (is_whole && width(0) + width(1) + width(2) == 2).then_some(corners)
}

/// Whether the second diagonal is to cut a face with these corners, which `is_second` cuts now. A diagonal is *sound* if both triangles lie on the side of the face where they belong.
fn takes_second(places: [[f64; 3]; 4], is_second: bool) -> bool {
    if (0..4).any(|i| places[..i].contains(&places[i])) {
        return is_second;
    }
    let [p0, p1, p2, p3] = places;
    let face = cross(minus(p2, p0), minus(p3, p1));
    let is_sound = |[a, b, c]: [[f64; 3]; 3]| dot(cross(minus(b, a), minus(c, a)), face) > 0.0;
    let first_is_sound = is_sound([p0, p1, p2]) && is_sound([p0, p2, p3]);
    let second_is_sound = is_sound([p0, p1, p3]) && is_sound([p1, p2, p3]);
    match [first_is_sound, second_is_sound] {
        [true, true] => second_is_delaunay(places),
        [false, false] => is_second,
        [_, second] => second,
    }
}
