//! Diagonals of faces once more, where vertices have their points.

use super::sphere::dot;
use super::surface::{Surface, larger_angle};

type Place = [f64; 3];

pub fn minus(p: Place, q: Place) -> Place {
    [0, 1, 2].map(|a| p[a] - q[a])
}

pub fn cross(u: Place, v: Place) -> Place {
    [0, 1, 2].map(|a| u[(a + 1) % 3] * v[(a + 2) % 3] - u[(a + 2) % 3] * v[(a + 1) % 3])
}

/// The normal of a triangle, as long as twice its area.
pub fn normal([a, b, c]: [Place; 3]) -> Place {
    cross(minus(b, a), minus(c, a))
}

/// The triangles that either diagonal makes of four corners.
pub fn cuts<T: Copy>(v: [T; 4]) -> [[[T; 3]; 2]; 2] {
    [[[v[0], v[1], v[2]], [v[0], v[2], v[3]]], [[v[0], v[1], v[3]], [v[1], v[2], v[3]]]]
}

/// Chooses the diagonals of all faces of two triangles whose places are known: of a slice, with such corners.
pub fn choose(surface: &mut Surface, places: &[Place], known: &dyn Fn(u32, [u32; 4]) -> bool) {
    let mut end = 0;
    for of_face in surface.faces.clone().chunk_by(|a, b| a == b) {
        end += of_face.len();
        if of_face.len() != 2 {
            continue;
        }
        let first = end - 1;
        let (one, other) = (surface.triangles[first - 1], surface.triangles[first]);
        // Either (0, 1, 2) and (0, 2, 3), or (0, 1, 3) and (1, 2, 3).
        let (corners, now) = if one[0] == other[0] {
            ([one[0], one[1], one[2], other[2]], 0)
        } else {
            ([one[0], one[1], other[1], one[2]], 1)
        };
        let at = corners.map(|v| places[v as usize]);
        if !known(surface.slices[first], corners) || (0..4).any(|i| (0..i).any(|j| at[i] == at[j])) {
            continue;
        }
        let whole = cross(minus(at[2], at[0]), minus(at[3], at[1]));
        let sound = cuts(at).map(|cut| cut.into_iter().all(|triangle| dot(normal(triangle), whole) > 0.0));
        let cut = match sound {
            [true, true] => larger_angle(at),
            [true, false] => 0,
            [false, true] => 1,
            [false, false] => now,
        };
        let triangles = cuts(corners)[cut];
        (surface.triangles[first - 1], surface.triangles[first]) = (triangles[0], triangles[1]);
    }
}
