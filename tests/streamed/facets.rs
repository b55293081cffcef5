//! Facets that pass amid the points of surfaces known by a formula.

use std::f64::consts::PI;

use asra_stream::internals::settings::surface::Fit;
use asra_stream::{Mesh, Reconstruction};
use proptest::prelude::*;

/// A closed surface by its signed distance, positive outside, and places on it by area.
#[derive(Debug, Clone, Copy)]
enum Body {
    Sphere,
    /// Of this small radius; the large one is 1.
    Torus(f64),
    /// A cylinder of radius 1/2 and length 1 with half balls at its ends.
    Capsule,
}

impl Body {
    fn distance(self, [x, y, z]: [f64; 3]) -> f64 {
        match self {
            Body::Sphere => (x * x + y * y + z * z).sqrt() - 1.0,
            Body::Torus(small) => ((x.hypot(y) - 1.0).hypot(z)) - small,
            Body::Capsule => (x * x + y * y + (z.abs() - 0.5).max(0.0).powi(2)).sqrt() - 0.5,
        }
    }

    fn area(self) -> f64 {
        match self {
            Body::Sphere => 4.0 * PI,
            Body::Torus(small) => 4.0 * PI * PI * small,
            Body::Capsule => 2.0 * PI,
        }
    }

    /// A place on it: from one near it, along the distance's gradient.
    fn onto(self, place: [f64; 3]) -> [f64; 3] {
        (0..8).fold(place, |p, _| {
            let at = |a: usize, by: f64| self.distance([0, 1, 2].map(|b| if a == b { p[b] + by } else { p[b] }));
            let slope = [0, 1, 2].map(|a| (at(a, 1e-6) - at(a, -1e-6)) / 2e-6);
            [0, 1, 2].map(|a| p[a] - self.distance(p) * slope[a])
        })
    }

    /// Samples at random: those of a thin shell of places, which lie evenly by area but for curvature.
    fn samples(self, count: usize, seed: u64) -> Vec<[f32; 3]> {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut out = Vec::new();
        while out.len() < count {
            let place = [0; 3].map(|_| 3.2 * next() - 1.6);
            if self.distance(place).abs() < 0.05 {
                out.push(self.onto(place).map(|c| c as f32));
            }
        }
        out
    }
}

/// The root mean square of the distances of triangles' middles from the body, by area; and their mean.
fn off(mesh: &Mesh, body: Body) -> (f64, f64) {
    let vertices = mesh.vertices().unwrap();
    let (mut area, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for triangle in mesh.triangles().unwrap() {
        let [a, b, c] = triangle.map(|v| vertices[v as usize]);
        let (u, v) = ([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i]));
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let weight = normal.iter().map(|c| c * c).sum::<f64>().sqrt();
        let distance = body.distance([0, 1, 2].map(|i| (a[i] + b[i] + c[i]) / 3.0));
        area += weight;
        sum += weight * distance;
        squares += weight * distance * distance;
    }
    ((squares / area).sqrt(), sum / area)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn facets_pass_amid_the_points(
        body in prop_oneof![Just(Body::Sphere), (0.25f64..0.5).prop_map(Body::Torus), Just(Body::Capsule)],
        count in 5000usize..20_000, side in 2.5f64..4.0, seed: u64,
    ) {
        let points = body.samples(count, seed);
        // In sampling distances.
        let side = side * (body.area() / count as f64).sqrt();
        let made = |fit| Reconstruction::of(&points[..]).cell_size(side).fit(fit).run().unwrap();
        let [(nearest, inside), (facets, amid)] = [Fit::Nearest, Fit::Facets].map(|fit| off(&made(fit), body));
        prop_assert!(facets < 0.72 * nearest, "{facets} off, with vertices on points {nearest}");
        prop_assert!(amid.abs() < 0.7 * inside.abs(), "{amid} off on the mean, with vertices on points {inside}");
    }
}
