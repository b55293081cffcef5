//! Sharp edges of bodies known by their planes, turned at random; and none on what is smooth.

use asra_stream::internals::settings::surface::{Diagonals, Fit, SurfaceOptions};
use asra_stream::internals::settings::{Fineness, Resolution, Settings};
use proptest::prelude::*;

use crate::{Means, MeshBits, assert_same, stream};

/// Numbers from 0 to 1 that look random.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// A prism about the z axis whose base is a triangle with two sides of length 1 that meet at an angle, turned about an axis.
#[derive(Debug, Clone, Copy)]
struct Prism {
    /// In degrees.
    angle: f64,
    height: f64,
    axis: [f64; 3],
    turn: f64,
}

impl Prism {
    fn base(self) -> [[f64; 2]; 3] {
        let half = self.angle.to_radians() / 2.0;
        [[0.0, 0.0], [half.cos(), -half.sin()], [half.cos(), half.sin()]]
    }

    /// Turned, by Rodrigues' formula.
    fn turned(self, p: [f64; 3]) -> [f64; 3] {
        let length = self.axis.iter().map(|c| c * c).sum::<f64>().sqrt();
        let k = self.axis.map(|c| c / length);
        let along: f64 = (0..3).map(|a| k[a] * p[a]).sum();
        let (s, c) = self.turn.sin_cos();
        [0, 1, 2].map(|a| {
            let (b, d) = ((a + 1) % 3, (a + 2) % 3);
            c * p[a] + s * (k[b] * p[d] - k[d] * p[b]) + (1.0 - c) * along * k[a]
        })
    }

    /// How far a place lies off the surface, once it is turned back: outside, no more than that; inside, exactly that.
    fn distance(self, p: [f64; 3]) -> f64 {
        let [x, y, z] = Prism { turn: -self.turn, ..self }.turned(p);
        let base = self.base();
        let mut out = z.abs() - self.height / 2.0;
        for i in 0..3 {
            let ([a, b], [c, d]) = (base[i], base[(i + 1) % 3]);
            let (u, v) = (c - a, d - b);
            out = out.max((v * (x - a) - u * (y - b)) / u.hypot(v));
        }
        out
    }

    fn area(self) -> f64 {
        let [a, b, c] = self.base();
        let side = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
        self.angle.to_radians().sin() + self.height * (side(a, b) + side(b, c) + side(c, a))
    }

    /// Samples by area.
    fn samples(self, count: usize, numbers: &mut Numbers) -> Vec<[f64; 3]> {
        let base = self.base();
        let ends = self.angle.to_radians().sin();
        (0..count)
            .map(|_| {
                let mut at = numbers.next() * self.area();
                let (mut s, mut t) = (numbers.next(), numbers.next());
                if at < ends {
                    if s + t > 1.0 {
                        (s, t) = (1.0 - s, 1.0 - t);
                    }
                    let [x, y] = [0, 1].map(|a| s * base[1][a] + t * base[2][a]);
                    return self.turned([x, y, if at < ends / 2.0 { self.height / 2.0 } else { -self.height / 2.0 }]);
                }
                at -= ends;
                let mut i = 0;
                loop {
                    let ([a, b], [c, d]) = (base[i], base[(i + 1) % 3]);
                    let wide = (c - a).hypot(d - b) * self.height;
                    if at < wide || i == 2 {
                        return self.turned([a + s * (c - a), b + s * (d - b), (t - 0.5) * self.height]);
                    }
                    at -= wide;
                    i += 1;
                }
            })
            .map(|p| p.map(|c| f64::from(c as f32)))
            .collect()
    }
}

/// The sides of all its edges meet at 35° and more: those at less than 30° stay as they are.
fn prism() -> impl Strategy<Value = Prism> {
    (35.0f64..110.0, 0.4f64..1.0, prop::array::uniform3(0.1f64..1.0), 0.0f64..3.0)
        .prop_map(|(angle, height, axis, turn)| Prism { angle, height, axis, turn })
}

/// Cells of this side.
fn settings(side: f64, fit: Fit) -> Settings {
    let usual = Settings::default();
    let surface = SurfaceOptions { fit, ..usual.surface };
    Settings { fineness: Fineness::Given(Resolution::Cell(side)), surface, ..usual }
}

/// The share of the area whose triangles' middles are farther off `than` that. A mean would tell of few vertices that retreat far at an acute corner; teeth are many.
fn off((vertices, triangles): &MeshBits, than: f64, distance: impl Fn([f64; 3]) -> f64) -> f64 {
    let (mut area, mut off) = (0.0, 0.0);
    for triangle in triangles {
        let [a, b, c] = triangle.map(|v| vertices[v as usize].map(f64::from_bits));
        let (u, v) = ([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i]));
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let weight = normal.iter().map(|c| c * c).sum::<f64>().sqrt();
        area += weight;
        if distance([0, 1, 2].map(|i| (a[i] + b[i] + c[i]) / 3.0)).abs() > than {
            off += weight;
        }
    }
    off / area
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 16, ..ProptestConfig::default() })]

    #[test]
    fn edges_are_the_twins(prism in prism(), seed: u64, side in 1.4f64..2.0, slab in prop::option::of(12u32..18)) {
        let points = prism.samples(500, &mut Numbers(seed));
        let side = side * (prism.area() / points.len() as f64).sqrt();
        let seal = asra_stream::internals::settings::closing::Sealing::Cells(2);
        let given = settings(side, Fit::Facets);
        let given = Settings { seal, min_component: None, surface: SurfaceOptions { slab_slices: slab, ..given.surface }, ..given };
        let run = stream(&points, true, &given, Means::Ample).unwrap();
        prop_assert!(run.made.counts.creased > 0, "no crease: {:?}", run.made.counts);
        assert_same(&points, true, &given)?;
    }

    #[test]
    fn edges_are_sharp(prism in prism(), seed: u64, side in 1.4f64..2.0) {
        let points = prism.samples(8000, &mut Numbers(seed));
        let side = side * (prism.area() / points.len() as f64).sqrt();
        // What knows nothing of edges: vertices on points, faces cut anyhow.
        let plain = settings(side, Fit::Nearest);
        let plain = Settings { surface: SurfaceOptions { diagonals: Diagonals::First, ..plain.surface }, ..plain };
        let [facets, plain] = [settings(side, Fit::Facets), plain]
            .map(|settings| stream(&points, true, &settings, Means::Ample).unwrap())
            .map(|run| off(&run.mesh, 0.05 * side, |place| prism.distance(place)));
        prop_assert!(facets < 0.85 * plain, "{facets} of the area off, with vertices on points {plain}");
    }

    #[test]
    fn what_is_smooth_has_none(large in 0.0f64..1.5, seed: u64, count in 1500usize..8000, side in 1.4f64..3.0) {
        let mut numbers = Numbers(seed);
        // A ball, or a ring with a tube of radius 1/2.
        let large = if large < 0.6 { 0.0 } else { large };
        let mut points = Vec::new();
        while points.len() < count {
            let [u, v, keep] = [0; 3].map(|_| numbers.next());
            let (about, round) = (std::f64::consts::TAU * u, std::f64::consts::TAU * v);
            if large == 0.0 {
                let z = 2.0 * keep - 1.0;
                let r = (1.0 - z * z).sqrt();
                points.push([0.5 * r * about.cos(), 0.5 * r * about.sin(), 0.5 * z]);
            } else if keep * (large + 0.5) < large + 0.5 * round.cos() {
                let r = large + 0.5 * round.cos();
                points.push([r * about.cos(), r * about.sin(), 0.5 * round.sin()]);
            }
        }
        let points: Vec<[f64; 3]> = points.into_iter().map(|p| p.map(|c| f64::from(c as f32))).collect();
        let area = std::f64::consts::PI * if large == 0.0 { 1.0 } else { 2.0 * std::f64::consts::PI * large };
        let run = stream(&points, true, &settings(side * (area / count as f64).sqrt(), Fit::Facets), Means::Ample).unwrap();
        // A dent of random points may look like one.
        let counts = run.made.counts;
        prop_assert!(counts.creased <= 2 + counts.fitted / 500, "{counts:?}");
    }
}
