//! Shapes to sample points from, each centred on the origin with a longest side of about 1.

use std::f64::consts::{PI, TAU};
use std::fmt;
use std::str::FromStr;

use rand::{Rng, RngExt};

use crate::error::{Error, Result};
use crate::points::vector::{cross, dot};

/// Radius of the torus' tube round its centre line of radius [`TORUS_RADIUS`].
const TORUS_TUBE: f64 = 0.15;

/// Radius of the torus' centre line: with the tube, the torus is 1 wide.
const TORUS_RADIUS: f64 = 0.35;

/// The trefoil is 6 wide before it is scaled, and the tube adds to that.
const KNOT_SCALE: f64 = 1.0 / 7.0;

/// Radius of the knot's tube, before scaling: thin enough for strands to pass each other, and not to fold in the bends.
const KNOT_TUBE: f64 = 0.5;

/// The most area of the knot's tube per unit of its two parameters, divided by the tube's radius; a test searches for
/// it.
const KNOT_MAX_STRETCH: f64 = 8.28;

/// Octaves of the terrain: from hills of a quarter of its width to roughness of 1/128.
const TERRAIN_OCTAVES: u32 = 6;

/// Standard deviation of a cluster.
const CLUSTER_SPREAD: f64 = 0.05;

/// Number of clusters.
const CLUSTERS: u64 = 8;

/// Steps of the stairs.
const STEPS: u32 = 5;

/// Something to sample points from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, clap::ValueEnum)]
pub enum Shape {
    /// The surface of a ball; area-uniform.
    Sphere,
    /// A torus round the z axis; area-uniform.
    Torus,
    /// A tube round a trefoil knot; area-uniform.
    Knot,
    /// A fractal landscape, z up; uniform in plan, as from the air.
    Terrain,
    /// A square at z = 0.
    Plane,
    /// The surface of a cube; area-uniform.
    Box,
    /// The inside of a cube.
    Volume,
    /// Gaussian clusters.
    Cluster,
    /// A straight line along the cube's diagonal.
    Line,
    /// Open stairs: treads and risers, area-uniform.
    Steps,
}

impl Shape {
    /// All shapes.
    pub const ALL: [Shape; 10] = [
        Shape::Sphere,
        Shape::Torus,
        Shape::Knot,
        Shape::Terrain,
        Shape::Plane,
        Shape::Box,
        Shape::Volume,
        Shape::Cluster,
        Shape::Line,
        Shape::Steps,
    ];

    /// A random point of the shape, of size 1.
    pub fn point<R: Rng + ?Sized>(self, rng: &mut R) -> [f64; 3] {
        match self {
            Shape::Sphere => sphere(rng),
            Shape::Torus => torus(rng),
            Shape::Knot => knot(rng),
            Shape::Terrain => {
                let [x, y] = [centred(rng), centred(rng)];
                [x, y, terrain_height(x, y)]
            }
            Shape::Plane => [centred(rng), centred(rng), 0.0],
            Shape::Box => cube_surface(rng),
            Shape::Volume => [centred(rng), centred(rng), centred(rng)],
            Shape::Cluster => cluster(rng),
            Shape::Line => [centred(rng) / 3f64.sqrt(); 3],
            Shape::Steps => steps(rng),
        }
    }

    /// The surface's area at size 1, where a formula gives it.
    pub fn area(self) -> Option<f64> {
        match self {
            Shape::Sphere => Some(PI),
            Shape::Torus => Some(4.0 * PI * PI * TORUS_RADIUS * TORUS_TUBE),
            Shape::Plane => Some(1.0),
            Shape::Box => Some(6.0),
            // Treads together are a square, risers another.
            Shape::Steps => Some(2.0),
            _ => None,
        }
    }

    /// The volume inside a closed surface at size 1, where a formula gives it.
    pub fn volume(self) -> Option<f64> {
        match self {
            Shape::Sphere => Some(PI / 6.0),
            Shape::Torus => Some(2.0 * PI * PI * TORUS_RADIUS * TORUS_TUBE * TORUS_TUBE),
            Shape::Box => Some(1.0),
            _ => None,
        }
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Shape::Sphere => "sphere",
            Shape::Torus => "torus",
            Shape::Knot => "knot",
            Shape::Terrain => "terrain",
            Shape::Plane => "plane",
            Shape::Box => "box",
            Shape::Volume => "volume",
            Shape::Cluster => "cluster",
            Shape::Line => "line",
            Shape::Steps => "steps",
        })
    }
}

impl FromStr for Shape {
    type Err = Error;

    fn from_str(name: &str) -> Result<Shape> {
        Shape::ALL.into_iter().find(|shape| shape.to_string() == name).ok_or_else(|| {
            let names: Vec<String> = Shape::ALL.iter().map(Shape::to_string).collect();
            Error::Usage(format!("shape: expected one of {}, found {name:?}", names.join(", ")))
        })
    }
}

/// A normally distributed number: mean 0, standard deviation 1 (Marsaglia's polar method, of whose pair one is used).
pub fn gaussian<R: Rng + ?Sized>(rng: &mut R) -> f64 {
    let ([u, _], square) = in_disc(rng);
    u * (-2.0 * libm::log(square) / square).sqrt()
}

/// Uniform in −½ … ½.
fn centred<R: Rng + ?Sized>(rng: &mut R) -> f64 {
    rng.random::<f64>() - 0.5
}

/// Uniform in the unit disc without its centre, and the square of its distance from there. Made of one 64-bit number
/// per try: 2⁻³¹ is far below any noise and half the random bits are half the time.
fn in_disc<R: Rng + ?Sized>(rng: &mut R) -> ([f64; 2], f64) {
    loop {
        let bits = rng.next_u64();
        let [u, v] = [(bits >> 32) as i32, bits as i32].map(|i| f64::from(i) * (1.0 / 2_147_483_648.0));
        let square = u * u + v * v;
        if square < 1.0 && square > 0.0 {
            return ([u, v], square);
        }
    }
}

/// Uniform on the unit circle: a point of the disc, moved out. No sine or cosine.
fn on_circle<R: Rng + ?Sized>(rng: &mut R) -> [f64; 2] {
    let ([u, v], square) = in_disc(rng);
    let scale = 1.0 / square.sqrt();
    [u * scale, v * scale]
}

/// Marsaglia (1972): for (u, v) uniform in the disc, s = u² + v² is uniform in 0 … 1, so that the unit sphere's z = 1
/// − 2s is uniform as it must be (Archimedes), while (u, v)/√s is a uniform direction independent of s.
fn sphere<R: Rng + ?Sized>(rng: &mut R) -> [f64; 3] {
    let ([u, v], square) = in_disc(rng);
    let radius = (1.0 - square).sqrt();
    [u * radius, v * radius, 0.5 - square]
}

/// The area per angle of the tube is proportional to the distance from the z axis: rejection by that.
fn torus<R: Rng + ?Sized>(rng: &mut R) -> [f64; 3] {
    loop {
        let [cos, sin] = on_circle(rng);
        let radius = TORUS_RADIUS + TORUS_TUBE * cos;
        if rng.random::<f64>() * (TORUS_RADIUS + TORUS_TUBE) < radius {
            let [x, y] = on_circle(rng);
            return [radius * x, radius * y, TORUS_TUBE * sin];
        }
    }
}

/// Rejection by the stretch of the tube's parameters (t along the curve, the angle round it).
fn knot<R: Rng + ?Sized>(rng: &mut R) -> [f64; 3] {
    loop {
        let t = rng.random::<f64>() * TAU;
        let [cos, sin] = on_circle(rng);
        let frame = Frame::of_trefoil(t);
        if rng.random::<f64>() * KNOT_MAX_STRETCH < frame.stretch(cos) {
            let around = |axis: usize| KNOT_TUBE * (cos * frame.normal[axis] + sin * frame.binormal[axis]);
            return [0, 1, 2].map(|axis| KNOT_SCALE * (frame.position[axis] + around(axis)));
        }
    }
}

/// The Frenet frame of c(t) = ((2 + cos 3t) cos 2t, (2 + cos 3t) sin 2t, sin 3t).
struct Frame {
    position: [f64; 3],
    normal: [f64; 3],
    binormal: [f64; 3],
    speed: f64,
    curvature: f64,
}

impl Frame {
    fn of_trefoil(t: f64) -> Frame {
        let ((s2, c2), (s3, c3)) = (libm::sincos(2.0 * t), libm::sincos(3.0 * t));
        // In the plane: radius r(t) = 2 + cos 3t at angle 2t; e points outwards, f along the angle.
        let (r, r1, r2) = (2.0 + c3, -3.0 * s3, -9.0 * c3);
        let planar = |e: f64, f: f64, z: f64| [e * c2 - f * s2, e * s2 + f * c2, z];
        let first = planar(r1, 2.0 * r, 3.0 * c3);
        let second = planar(r2 - 4.0 * r, 4.0 * r1, -9.0 * s3);
        let speed = dot(first, first).sqrt();
        let across = cross(first, second);
        let turn = dot(across, across).sqrt();
        let binormal = across.map(|v| v / turn);
        let normal = cross(binormal, first).map(|v| v / speed);
        Frame { position: planar(r, 0.0, s3), normal, binormal, speed, curvature: turn / (speed * speed * speed) }
    }

    /// Area of the tube per unit of t and angle, divided by the tube's radius; `cos` is towards the normal.
    fn stretch(&self, cos: f64) -> f64 {
        self.speed * (1.0 - KNOT_TUBE * self.curvature * cos)
    }
}

/// Value noise: smooth interpolation of random heights on ever finer lattices, each half as high as the one before. One
/// landscape for all seeds: they choose where it is sampled.
fn terrain_height(x: f64, y: f64) -> f64 {
    let mut height = 0.0;
    for octave in 0..TERRAIN_OCTAVES {
        let cells = f64::from(4u32 << octave);
        let (u, v) = ((x + 0.5) * cells, (y + 0.5) * cells);
        let (i, j) = (u.floor(), v.floor());
        let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
        let (s, t) = (smooth(u - i), smooth(v - j));
        let at = |di: u64, dj: u64| lattice(u64::from(octave), i as u64 + di, j as u64 + dj);
        let low = at(0, 0) + s * (at(1, 0) - at(0, 0));
        let high = at(0, 1) + s * (at(1, 1) - at(0, 1));
        height += (low + t * (high - low) - 0.5) * 0.1 / f64::from(1u32 << octave);
    }
    height
}

/// A fixed random number in 0 … 1 for each place.
fn lattice(a: u64, b: u64, c: u64) -> f64 {
    // splitmix64 of the place's number.
    let mut z = (a << 48 | b << 24 | c).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ z >> 31) >> 11) as f64 / (1u64 << 53) as f64
}

fn cube_surface<R: Rng + ?Sized>(rng: &mut R) -> [f64; 3] {
    let side = rng.random_range(0..6usize);
    let mut point = [centred(rng), centred(rng), centred(rng)];
    point[side % 3] = if side < 3 { -0.5 } else { 0.5 };
    point
}

/// Clusters within the middle of the cube, so that nearly all points lie in it.
fn cluster<R: Rng + ?Sized>(rng: &mut R) -> [f64; 3] {
    let number = rng.random_range(0..CLUSTERS);
    [0, 1, 2].map(|axis| 0.6 * (lattice(99, number, axis) - 0.5) + CLUSTER_SPREAD * gaussian(rng))
}

/// Stairs that rise along x from (−½, −½) to (½, ½): half the area is treads, half risers.
fn steps<R: Rng + ?Sized>(rng: &mut R) -> [f64; 3] {
    let depth = 1.0 / f64::from(STEPS);
    let place = rng.random::<f64>();
    let step = (place * f64::from(STEPS)).floor();
    let y = centred(rng);
    if rng.random::<bool>() {
        [place - 0.5, y, (step + 1.0) * depth - 0.5]
    } else {
        [step * depth - 0.5, y, place - 0.5]
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const SAMPLES: usize = 100_000;

    fn samples(shape: Shape) -> Vec<[f64; 3]> {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        (0..SAMPLES).map(|_| shape.point(&mut rng)).collect()
    }

    #[test]
    fn every_shape_is_centred_and_about_one_wide() {
        for shape in Shape::ALL {
            let points = samples(shape);
            let extent = (0..3).map(|axis| {
                let of = |p: &[f64; 3]| p[axis];
                let (min, max) =
                    (points.iter().map(of).fold(f64::MAX, f64::min), points.iter().map(of).fold(f64::MIN, f64::max));
                assert!((min + max).abs() < 0.25, "{shape} is centred along axis {axis}: {min}..{max}");
                max - min
            });
            let longest = extent.fold(0.0, f64::max);
            let expected = if shape == Shape::Line { 0.577 } else { 1.0 };
            assert!((longest - expected).abs() < 0.15, "{shape}: {longest}");
            assert_eq!(shape.to_string().parse::<Shape>().unwrap(), shape);
        }
        assert!("cow".parse::<Shape>().unwrap_err().to_string().contains("sphere, torus"));
    }

    #[test]
    fn points_lie_on_their_surface() {
        for [x, y, z] in samples(Shape::Sphere) {
            assert!(((x * x + y * y + z * z).sqrt() - 0.5).abs() < 1e-9);
        }
        for [x, y, z] in samples(Shape::Torus) {
            assert!(((x.hypot(y) - TORUS_RADIUS).hypot(z) - TORUS_TUBE).abs() < 1e-9);
        }
        for p in samples(Shape::Box) {
            assert_eq!(p.iter().filter(|c| c.abs() == 0.5).count(), 1);
        }
        for p in samples(Shape::Knot).iter().step_by(100) {
            let distance = |t: f64| {
                let c = Frame::of_trefoil(t).position;
                let d = [0, 1, 2].map(|axis| p[axis] - KNOT_SCALE * c[axis]);
                dot(d, d).sqrt()
            };
            let nearest = (0..6000).map(|i| distance(f64::from(i) / 6000.0 * TAU)).fold(f64::MAX, f64::min);
            assert!((nearest - KNOT_SCALE * KNOT_TUBE).abs() < 1e-4, "{nearest}");
        }
    }

    /// Equal areas get equal shares: 100 000 samples keep a share within 0.005 of its expectation (3 standard
    /// deviations).
    #[test]
    fn closed_surfaces_are_sampled_by_area() {
        let share = |shape, inside: &dyn Fn(&[f64; 3]) -> bool| {
            samples(shape).iter().filter(|p| inside(p)).count() as f64 / SAMPLES as f64
        };
        let near =
            |found: f64, expected: f64| assert!((found - expected).abs() < 0.005, "{found}, expected {expected}");
        // A sphere's zone has the area of the cylinder round it.
        near(share(Shape::Sphere, &|p| p[2] > 0.25), 0.25);
        near(share(Shape::Sphere, &|p| p[0] < -0.4), 0.1);
        // The outer half of a torus: ½ + r/(πR) of the area.
        near(share(Shape::Torus, &|p| p[0].hypot(p[1]) > TORUS_RADIUS), 0.5 + TORUS_TUBE / (PI * TORUS_RADIUS));
        near(share(Shape::Box, &|p| p[1] == 0.5), 1.0 / 6.0);
        near(share(Shape::Steps, &|p| p[2] > 0.0), 0.6 * 0.5 + 0.5 * 0.5);
    }

    #[test]
    fn the_knots_bounds_hold() {
        let mut most: f64 = 0.0;
        for i in 0..100_000 {
            let frame = Frame::of_trefoil(f64::from(i) / 100_000.0 * TAU);
            most = most.max(frame.stretch(-1.0)).max(frame.stretch(1.0));
            assert!(frame.stretch(1.0) > 0.0, "the tube must not fold at its inner side");
        }
        assert!(most <= KNOT_MAX_STRETCH && most > 0.99 * KNOT_MAX_STRETCH, "the bound is {most}");
    }
}
