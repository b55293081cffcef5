//! Membranes that close holes: smooth, and as flat as their rims, wherever they face.

use asra_stream::internals::settings::surface::{Fit, SurfaceOptions};
use asra_stream::internals::settings::{Fineness, Resolution, Settings};
use proptest::prelude::*;

use crate::{Means, MeshBits, assert_means_do_not_show, stream};

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn of_length_1(v: [f64; 3]) -> [f64; 3] {
    let length = dot(v, v).sqrt();
    v.map(|c| c / length)
}

/// A ball of radius 1 whose cap above a height along a direction has no samples.
#[derive(Debug, Clone, Copy)]
struct Capless {
    direction: [f64; 3],
    height: f64,
}

impl Capless {
    /// So many samples of the whole ball, those of the cap left out: along a spiral, so that they lie evenly.
    fn samples(self, count: u32) -> Vec<[f64; 3]> {
        let sample = |i: u32| {
            let (turn, z) = (f64::from(i) * 2.399_963, 1.0 - (f64::from(i) + 0.5) / f64::from(count) * 2.0);
            let around = (1.0 - z * z).sqrt();
            [around * turn.cos(), around * turn.sin(), z].map(|c| f64::from(c as f32))
        };
        (0..count).map(sample).filter(|p| dot(*p, self.direction) < self.height).collect()
    }

    /// The volume of the cap.
    fn cap(self) -> f64 {
        let h = 1.0 - self.height;
        std::f64::consts::PI * h * h * (3.0 - h) / 3.0
    }
}

/// Towards an axis, or anyhow.
fn capless() -> impl Strategy<Value = Capless> {
    let anyhow = prop::array::uniform3(-1.0f64..1.0).prop_filter("no direction", |d| dot(*d, *d) > 0.1);
    let axis = (0usize..3, prop::bool::ANY).prop_map(|(axis, up)| {
        let mut direction = [0.0; 3];
        direction[axis] = if up { 1.0 } else { -1.0 };
        direction
    });
    (prop_oneof![anyhow, axis], 0.75f64..0.9)
        .prop_map(|(direction, height)| Capless { direction: of_length_1(direction), height })
}

fn volume((vertices, triangles): &MeshBits) -> f64 {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| vertices[v as usize].map(f64::from_bits));
        dot(a, cross(b, c)) / 6.0
    };
    triangles.iter().map(of).sum()
}

/// The mean cosine of the angle between a triangle's normal and the mean of all, by area, of triangles near the middle of the hole.
fn evenness((vertices, triangles): &MeshBits, hole: Capless) -> f64 {
    let rim = (1.0 - hole.height * hole.height).sqrt();
    let mut normals = Vec::new();
    for triangle in triangles {
        let [a, b, c] = triangle.map(|v| vertices[v as usize].map(f64::from_bits));
        let middle = [0, 1, 2].map(|i| (a[i] + b[i] + c[i]) / 3.0);
        let along = dot(middle, hole.direction);
        if along > 0.5 && dot(middle, middle) - along * along < (0.5 * rim).powi(2) {
            normals.push(cross([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i])));
        }
    }
    let sum = normals.iter().fold([0.0; 3], |sum, n| [0, 1, 2].map(|i| sum[i] + n[i]));
    let area: f64 = normals.iter().map(|n| dot(*n, *n).sqrt()).sum();
    dot(sum, sum).sqrt() / area
}

/// Cells so many times as wide as samples lie apart.
fn settings(count: u32, side: f64, fit: Fit) -> Settings {
    let usual = Settings::default();
    let side = side * (4.0 * std::f64::consts::PI / f64::from(count)).sqrt();
    let surface = SurfaceOptions { fit, ..usual.surface };
    Settings { fineness: Fineness::Given(Resolution::Cell(side)), surface, ..usual }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    /// On grids whose sign is found on the cells themselves, and on coarser ones.
    #[test]
    fn holes_are_closed_by_what_is_smooth_and_flat(
        hole in capless(),
        (count, side) in prop_oneof![(9_000u32..20_000, 1.2f64..1.5), (50_000u32..70_000, 0.6f64..0.8)],
        fit in prop_oneof![Just(Fit::Facets), Just(Fit::Nearest), Just(Fit::Sphere)],
    ) {
        let run = stream(&hole.samples(count), true, &settings(count, side, fit), Means::Ample).unwrap();
        crate::twin::check::check(run.mesh.0.len(), &run.mesh.1).map_err(TestCaseError::fail)?;
        // No less than with a flat lid, and less than three quarters of the cap more.
        let (ball, volume) = (4.0 / 3.0 * std::f64::consts::PI, volume(&run.mesh));
        let of_cap = 1.0 - (ball - volume) / hole.cap();
        prop_assert!(volume > 0.99 * (ball - hole.cap()) && of_cap < 0.75, "{volume}: {of_cap} of the cap");
        // Of a staircase askew a good half of the area looks elsewhere.
        let even = evenness(&run.mesh, hole);
        prop_assert!(even > 0.98, "{even}");
    }

    /// Slabs so thin that membranes reach through many.
    #[test]
    fn means_do_not_show_in_membranes(
        hole in capless(),
        side in 0.6f64..1.5,
        fit in prop_oneof![Just(Fit::Facets), Just(Fit::Nearest), Just(Fit::Sphere)],
        slab in prop::option::of(12u32..16),
    ) {
        let points = hole.samples(12_000);
        let settings = settings(12_000, side, fit);
        let settings = Settings { surface: SurfaceOptions { slab_slices: slab, ..settings.surface }, ..settings };
        let run = stream(&points, true, &settings, Means::Ample).unwrap();
        prop_assert!(run.made.counts.bridged > 0, "{:?}", run.made.counts);
        assert_means_do_not_show(&points, true, &settings, &run)?;
    }
}
