//! Paraboloids through places: smooth surfaces of which a few places are known, and their normals.

use crate::points::vector::{cross, dot, minus};

/// A surface of the second degree over a plane: it lies `height` above a place of that plane, along its normal.
#[derive(Debug, Clone, Copy)]
pub(super) struct Paraboloid {
    /// The plane's normal, of length 1.
    normal: [f64; 3],
    /// The plane's place where u = v = 0.
    place: [f64; 3],
    /// Where u and v go, of length 1, at right angles.
    across: [[f64; 3]; 2],
    /// The factors of 1, u, v, u²/2, uv and v²/2.
    height: [f64; 6],
}

/// A plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    /// Its normal, of length 1.
    pub normal: [f64; 3],
    /// One of its places.
    pub place: [f64; 3],
}

/// Of all weights together, what is added for slopes, so that places on a line have a surface, too.
const LEVEL: f64 = 1e-6;

impl Paraboloid {
    /// The surface nearest to places with weights, by least squares along the plane's normal (of any length). Curvature costs: what of all weights together a curvature of one
    /// over `unit` adds to the squares, in `unit`s, is `stiffness`.
    pub fn through(
        plane: Plane,
        places: impl IntoIterator<Item = ([f64; 3], f64)>,
        unit: f64,
        stiffness: f64,
    ) -> Paraboloid {
        let length = dot(plane.normal, plane.normal).sqrt();
        let normal = plane.normal.map(|c| c / length);
        // Not along the normal.
        let other = if normal[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        let u = cross(normal, other);
        let length = dot(u, u).sqrt();
        let u = u.map(|c| c / length);
        let mut surface = Paraboloid { normal, place: plane.place, across: [u, cross(normal, u)], height: [0.0; 6] };
        let (mut rows, mut all) = ([[0.0; 7]; 6], 0.0);
        for (place, weight) in places {
            let (uv, above) = surface.seen(place);
            let terms = terms(uv.map(|c| c / unit));
            all += weight;
            for (row, term) in rows.iter_mut().zip(terms) {
                (0..6).for_each(|j| row[j] += weight * term * terms[j]);
                row[6] += weight * term * (above / unit);
            }
        }
        for (i, more) in [0.0, LEVEL, LEVEL, stiffness, stiffness, stiffness].into_iter().enumerate() {
            rows[i][i] += more * all;
        }
        let [a, b, c, uu, uv, vv] = solved(rows);
        surface.height = [a * unit, b, c, uu / unit, uv / unit, vv / unit];
        surface
    }

    /// Where a place lies over the plane, and how far above it.
    #[inline]
    fn seen(&self, place: [f64; 3]) -> ([f64; 2], f64) {
        let way = minus(place, self.place);
        (self.across.map(|direction| dot(direction, way)), dot(self.normal, way))
    }

    #[inline]
    fn height(&self, uv: [f64; 2]) -> f64 {
        terms(uv).iter().zip(self.height).fold(0.0, |sum, (term, factor)| sum + term * factor)
    }

    /// How far a place lies from the surface, along the plane's normal.
    #[inline]
    pub fn distance(&self, place: [f64; 3]) -> f64 {
        let (uv, above) = self.seen(place);
        (above - self.height(uv)).abs()
    }

    /// The plane that touches the surface below or above a place.
    pub fn touching(&self, place: [f64; 3]) -> Plane {
        let ([u, v], _) = self.seen(place);
        let [_, b, c, uu, uv, vv] = self.height;
        let (du, dv) = (b + uu * u + uv * v, c + uv * u + vv * v);
        let [along, across] = self.across;
        let normal: [f64; 3] = std::array::from_fn(|a| self.normal[a] - du * along[a] - dv * across[a]);
        let length = dot(normal, normal).sqrt();
        let above = self.height([u, v]);
        let place = std::array::from_fn(|a| self.place[a] + u * along[a] + v * across[a] + above * self.normal[a]);
        Plane { normal: normal.map(|c| c / length), place }
    }
}

#[inline]
fn terms([u, v]: [f64; 2]) -> [f64; 6] {
    [1.0, u, v, u * u / 2.0, u * v, v * v / 2.0]
}

/// Solves positive definite equations, each with its right side last (Gauss and Jordan).
fn solved(mut rows: [[f64; 7]; 6]) -> [f64; 6] {
    for i in 0..6 {
        let row = rows[i];
        for (j, other) in rows.iter_mut().enumerate() {
            if j != i {
                let factor = other[i] / row[i];
                (0..7).for_each(|k| other[k] -= factor * row[k]);
            }
        }
    }
    std::array::from_fn(|i| rows[i][6] / rows[i][i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Of a surface of the second degree, the surface itself is found, and the planes that touch it.
        #[test]
        fn a_paraboloid_is_found_again(height in prop::array::uniform6(-0.5f64..0.5), turn in prop::array::uniform3(-1.0f64..1.0)) {
            prop_assume!(dot(turn, turn) > 0.1);
            let truth = Paraboloid { height, ..Paraboloid::through(Plane { normal: turn, place: [1.0, 2.0, 3.0] }, [([0.0; 3], 1.0)], 1.0, 1.0) };
            let at = |u: f64, v: f64| {
                let z = truth.height([u, v]);
                std::array::from_fn(|a| truth.place[a] + u * truth.across[0][a] + v * truth.across[1][a] + z * truth.normal[a])
            };
            let places: Vec<([f64; 3], f64)> = (0..25).map(|i| (at(f64::from(i % 5) - 2.0, f64::from(i / 5) - 2.0), 1.0 + f64::from(i % 3))).collect();
            let found = Paraboloid::through(Plane { normal: truth.normal, place: truth.place }, places, 1.5, 0.0);
            let there = at(0.3, -1.4);
            prop_assert!(found.distance(there) < 1e-4, "{}", found.distance(there));
            let [next, beside] = [at(0.3 + 1e-5, -1.4), at(0.3, -1.4 + 1e-5)];
            let normal = cross(minus(next, there), minus(beside, there));
            let touching = found.touching(there);
            let cosine = dot(normal, touching.normal) / dot(normal, normal).sqrt();
            prop_assert!(cosine > 0.999, "{cosine}");
            prop_assert!(dot(minus(touching.place, there), minus(touching.place, there)) < 1e-8);
        }

        /// The more curvature costs, the flatter the surface.
        #[test]
        fn stiffness_flattens(bend in 0.1f64..1.0) {
            let places: Vec<([f64; 3], f64)> = (-3..=3).flat_map(|x| (-3..=3).map(move |y| (f64::from(x), f64::from(y)))).map(|(x, y)| ([x, y, bend * x * x], 1.0)).collect();
            let plane = Plane { normal: [0.0, 0.0, 2.0], place: [0.0; 3] };
            let bends = [0.0, 1.0, 100.0].map(|stiffness| Paraboloid::through(plane, places.clone(), 1.0, stiffness).height[3..].iter().map(|c| c.abs()).sum::<f64>());
            prop_assert!((bends[0] - 2.0 * bend).abs() < 1e-4 && bends[0] > bends[1] && bends[1] > bends[2], "{bends:?}");
        }
    }
}
