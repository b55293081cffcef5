//! Distances from points, and surfaces without what is far from them: against every point, one by one.

use asra_stream::{Error, Fit, Mesh, Reconstruction, Sealing, Tolerance};
use proptest::prelude::*;

/// The distance of each vertex from the nearest point: of all points.
fn brute_force(mesh: &Mesh, points: &[[f64; 3]]) -> Vec<f32> {
    let square = |a: &[f64; 3], b: &[f64; 3]| {
        let [x, y, z]: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
        x * x + y * y + z * z
    };
    let nearest = |v: &[f64; 3]| points.iter().map(|p| square(p, v)).fold(f64::INFINITY, f64::min);
    mesh.vertices().unwrap().iter().map(|v| nearest(v).sqrt() as f32).collect()
}

/// Points on a ball or a bent sheet, but for those in a cap, or in a hole.
fn points() -> impl Strategy<Value = (bool, Vec<[f64; 3]>)> {
    (prop::collection::vec((0.0f64..1.0, 0.0f64..1.0), 400..1500), any::<bool>(), any::<bool>(), 0.0f64..0.3).prop_map(
        |(places, ball, far, hole)| {
            let centre = if far { [500_000.0, -5_400_000.0, 300.0] } else { [0.0; 3] };
            let on = |(u, v): (f64, f64)| {
                let (sin, cos) = (u * std::f64::consts::TAU).sin_cos();
                let z = 2.0 * v - 1.0;
                let r = (1.0 - z * z).max(0.0).sqrt();
                if ball { [r * cos, r * sin, z] } else { [2.0 * u, 2.0 * v, 0.2 * sin] }
            };
            let there = |p: &[f64; 3]| if ball { p[2] < 1.0 - hole } else { (p[0] - 0.8).hypot(p[1] - 0.9) > hole };
            let kept = places.into_iter().map(on).filter(there).map(|p| std::array::from_fn(|a| p[a] + centre[a]));
            (ball, kept.collect())
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn distances_are_those_of_all_points_and_what_is_far_goes(
        (ball, points) in points(),
        plane: bool,
        narrow: bool,
        cells in 0.5f64..4.0,
        k in 2.0f64..5.0,
    ) {
        let single: Vec<[f32; 3]> = points.iter().map(|p| p.map(|c| c as f32)).collect();
        let far = points[0][0].abs() > 1000.0;
        // So far away single precision shows no surface.
        let narrow = narrow && !far;
        let of = |reversed: bool| {
            let cloud = match (narrow, reversed) {
                (true, false) => Reconstruction::of(&single),
                (true, true) => Reconstruction::of(single.iter().rev().copied().collect::<Vec<_>>().leak() as &[_]),
                (false, false) => Reconstruction::of(&points),
                (false, true) => Reconstruction::of(points.iter().rev().copied().collect::<Vec<_>>().leak() as &[_]),
            };
            // Every point counts.
            let cloud = cloud.keep_outliers().k(k).fit(if plane { Fit::Sphere } else { Fit::Nearest }).bridged();
            if ball { cloud.min_component(None).seal(Sealing::Auto) } else { cloud.terrain() }
        };
        let places: Vec<[f64; 3]> =
            if narrow { single.iter().map(|p| p.map(f64::from)).collect() } else { points.clone() };
        let whole = of(false).run().unwrap();
        let distances = whole.attribute("bridged").unwrap();
        let expected = brute_force(&whole, &places);
        prop_assert!(distances.iter().zip(&expected).all(|(a, b)| *a == f64::from(*b)));

        let trim = cells * whole.report().grid.cell_size;
        let trimmed = match of(false).trim(Tolerance::Length(trim)).run() {
            Ok(trimmed) => trimmed,
            // Nothing is that near.
            Err(Error::NoSurface) => {
                prop_assert!(distances.iter().filter(|d| **d <= trim).count() < distances.len() / 2);
                return Ok(());
            }
            Err(error) => panic!("{error}"),
        };
        let left = trimmed.attribute("bridged").unwrap();
        prop_assert_eq!(&left.iter().map(|d| *d as f32).collect::<Vec<_>>(), &brute_force(&trimmed, &places));
        prop_assert!(left.iter().all(|d| *d <= trim));
        let check = trimmed.check().unwrap();
        prop_assert!(check.is_sound(true), "{}", check);
        let far = distances.iter().filter(|d| **d > trim).count();
        prop_assert_eq!(far == 0, trimmed.triangle_count() == whole.triangle_count());
        prop_assert_eq!(trimmed.report().trimmed.unwrap().triangles as usize, whole.triangle_count() - trimmed.triangle_count());
        prop_assert!(far == 0 || !trimmed.report().closing.sealed);

        let again = of(true).trim(Tolerance::Length(trim)).threads(1).max_memory(32 << 20).run().unwrap();
        prop_assert_eq!(trimmed.vertices().unwrap(), again.vertices().unwrap());
        prop_assert_eq!(trimmed.triangles().unwrap(), again.triangles().unwrap());
        prop_assert_eq!(left, again.attribute("bridged").unwrap());
    }
}

#[test]
fn what_cannot_be_trimmed_is_refused() {
    let points: Vec<[f32; 3]> = (0..400).map(|i| [(i % 20) as f32, (i / 20) as f32, 0.1 * (i % 7) as f32]).collect();
    let told = |of: Reconstruction| of.run().unwrap_err().to_string();
    assert!(told(Reconstruction::of(&points).terrain().base(-3.0).trim(Tolerance::Cells(3.0))).contains("`trim`"));
    assert!(told(Reconstruction::of(&points).trim(Tolerance::Length(0.0))).contains("`trim` 0"));
    assert!(told(Reconstruction::of(&points).trim(Tolerance::Length(1e-9)).fit(Fit::Sphere)).contains("surface"));
    let twice = Reconstruction::of(&points).attribute("bridged", &[1u8; 400]).bridged();
    assert!(told(twice).contains("`bridged`"));
}
