//! Diagonals of rectangles, chosen anew where vertices are at their points.
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

/// The vertices that triangles name, counted from `first` on, and their places.
#[derive(Debug, Clone, Copy)]
pub struct Places<'a> {
    /// The vertices.
    pub vertices: &'a [Vertex],
    /// Where each is, in cells: at its point, if it has one.
    pub places: &'a [[f64; 3]],
    /// The vertex that triangles call 0.
    pub first: u32,
}

/// A face that is cut in two: its corners in turn, and which diagonals leave both triangles on the side of the face where they belong.
struct Rectangle {
    corners: [u32; 4],
    places: [[f64; 3]; 4],
    is_second: bool,
    /// Of the diagonal from the first to the third corner, and of that from the second to the fourth.
    are_sound: [bool; 2],
}

/// Chooses the diagonals of all faces whose corners are at four places.
pub fn choose(triangles: &mut [[u32; 3]], at: Places<'_>) {
    each(triangles, at, |rectangle| match rectangle.are_sound {
        [true, true] => second_is_delaunay(rectangle.places),
        [false, false] => rectangle.is_second,
        [_, second] => second,
    });
}

/// Asks of every face with corners at four places whether the second diagonal is to cut it.
fn each(triangles: &mut [[u32; 3]], at: Places<'_>, wants_second: impl Fn(&Rectangle) -> bool) {
    let mut rest = triangles;
    while let [one, other, ..] = rest {
        let Some(rectangle) = Rectangle::of([*one, *other], at) else {
            // The third triangle of a face with a midpoint stands alone.
            rest = &mut rest[1..];
            continue;
        };
        if let Some(rectangle) = rectangle {
            let second = wants_second(&rectangle);
            if second != rectangle.is_second {
                let [a, b, c, d] = rectangle.corners;
                [*one, *other] = if second { [[a, b, d], [b, c, d]] } else { [[a, b, c], [a, c, d]] };
            }
        }
        rest = &mut rest[2..];
    }
}

impl Rectangle {
    /// The face of two triangles, if they are all of one; nothing of it, if not all of its corners are at places of their own.
    fn of(both: [[u32; 3]; 2], at: Places<'_>) -> Option<Option<Rectangle>> {
        let corners = corners(both.map(Some))?;
        let numbers = corners.map(|v| (v + at.first) as usize);
        // Two triangles of faces side by side may look like one, and so may those that a midpoint makes.
        let vertices = numbers.map(|v| &at.vertices[v]);
        let is_wide = |a: usize| {
            let along = vertices.map(|vertex| vertex.corner[a]);
            along.iter().max().zip(along.iter().min()).map_or(0, |(most, least)| most - least)
        };
        let is_whole = vertices.iter().all(|vertex| matches!(vertex.kind, Kind::Sheet(_)));
        if !is_whole || is_wide(0) + is_wide(1) + is_wide(2) != 2 {
            return None;
        }
        let places = numbers.map(|v| at.places[v]);
        if (0..4).any(|i| places[..i].contains(&places[i])) {
            return Some(None);
        }
        let [p0, p1, p2, p3] = places;
        let face = cross(minus(p2, p0), minus(p3, p1));
        let is_sound = |[a, b, c]: [[f64; 3]; 3]| dot(cross(minus(b, a), minus(c, a)), face) > 0.0;
        let are_sound =
            [is_sound([p0, p1, p2]) && is_sound([p0, p2, p3]), is_sound([p0, p1, p3]) && is_sound([p1, p2, p3])];
        Some(Some(Rectangle { corners, places, is_second: both[0][1] == both[1][0], are_sound }))
    }
}
