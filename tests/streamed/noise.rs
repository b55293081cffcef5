//! Noisy clouds: `--fit sphere` leads the surface back to where the points were sampled.

use asra_stream::internals::format::read;
use asra_stream::internals::resources::workers::Workers;
use asra_stream::internals::run::generate::{Options, Shape, generate};
use asra_stream::internals::run::progress::{Progress, Show};
use asra_stream::internals::run::{Job, Resources, run};
use asra_stream::internals::settings::Resolution;
use asra_stream::internals::settings::surface::{Fit, SurfaceOptions};
use asra_stream::internals::settings::{Fineness, Settings};
use asra_stream::internals::storage::spool::Workspace;
use proptest::prelude::*;

/// Cells along the diameter of the sphere without noise.
const CELLS: f64 = 60.0;

/// The root mean square of the vertices' distances from a noisy sphere of radius 1/2, in cells, and the median of the angles between triangles'
/// normals and its own, in degrees.
fn errors_of_a_sphere(noise_in_cells: f64, fit: Fit) -> (f64, f64) {
    let dir = tempfile::tempdir().unwrap();
    let (cloud, mesh) = (dir.path().join("sphere.bin"), dir.path().join("sphere.ply"));
    let workers = Workers::new(2).unwrap();
    // A sphere of 60 cells lies in some 17,000 of them.
    let options = Options { noise: noise_in_cells / CELLS, ..Options::new(Shape::Sphere, 340_000, &cloud) };
    generate(&options, &workers, &mut |_| ()).unwrap();
    let settings = Settings {
        fineness: Fineness::Given(Resolution::Cell(1.0 / CELLS)),
        surface: SurfaceOptions { fit, ..Settings::default().surface },
        ..Settings::default()
    };
    let resources = Resources {
        threads: Some(2),
        max_memory: Some(1 << 30),
        temp_dir: Some(dir.path().to_path_buf()),
        ..Resources::default()
    };
    let job = Job { output: Some(mesh.clone()), settings, resources, ..Job::new([&cloud]) };
    let report = run(&job, &workers, &mut Progress::new(Show::Nothing)).unwrap();
    assert_eq!(report.check.unwrap().components, 1);

    let mesh = read::open(&mesh, &Workspace::new(dir.path()).unwrap(), 1 << 28).unwrap();
    let mut vertices = vec![[0.0; 3]; mesh.vertex_count() as usize];
    mesh.read_vertices(0, &mut vertices).unwrap();
    let mut faces = vec![[0; 3]; mesh.face_count() as usize];
    mesh.read_faces(0, &mut faces).unwrap();
    let length = |v: [f64; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    let off = vertices.iter().map(|v| ((length(*v) - 0.5) * CELLS).powi(2)).sum::<f64>();
    let turned = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|v| vertices[v as usize]);
        let (u, v) = ([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i]));
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let cosine = (0..3).map(|i| normal[i] * (a[i] + b[i] + c[i])).sum::<f64>()
            / length(normal)
            / length([0, 1, 2].map(|i| a[i] + b[i] + c[i]));
        cosine.clamp(-1.0, 1.0).acos().to_degrees()
    };
    let mut angles: Vec<f64> = faces.iter().map(turned).collect();
    angles.sort_by(f64::total_cmp);
    ((off / vertices.len() as f64).sqrt(), angles[angles.len() / 2])
}

#[test]
fn spheres_take_most_of_the_noise_away() {
    for noise in [0.25, 0.5, 1.0] {
        let (sphere, turned) = errors_of_a_sphere(noise, Fit::Sphere);
        let (nearest, _) = errors_of_a_sphere(noise, Fit::Nearest);
        assert!(sphere < noise / 3.0, "noise {noise}: {sphere} cells off, with the nearest points {nearest}");
        assert!(sphere < nearest / 3.0, "noise {noise}: {sphere} cells off, with the nearest points {nearest}");
        assert!(turned < 5.0, "noise {noise}: triangles {turned} degrees askew");
    }
}

/// Shapes with n points, turned, with noise of so many sampling distances; what their vertices are moved onto.
fn chosen(shape: Shape, points: u64, noise: f64, seed: u64) -> Fit {
    let dir = tempfile::tempdir().unwrap();
    let cloud = dir.path().join("cloud.bin");
    let workers = Workers::new(2).unwrap();
    let options = Options { seed, noise, ..Options::new(shape, points, &cloud) };
    generate(&options, &workers, &mut |_| ()).unwrap();
    let resources = Resources {
        threads: Some(2),
        max_memory: Some(1 << 30),
        temp_dir: Some(dir.path().to_path_buf()),
        ..Resources::default()
    };
    let job = Job { output: Some(dir.path().join("mesh.ply")), resources, ..Job::new([&cloud]) };
    run(&job, &workers, &mut Progress::new(Show::Nothing)).unwrap().fit.onto
}

#[test]
fn spheres_are_chosen_where_noise_is_wider_than_a_cell() {
    // Noise of a cell fills the smaller of the blocks that measure it.
    for (shape, noise) in [(Shape::Box, 0.018), (Shape::Sphere, 0.0115), (Shape::Torus, 0.0092)] {
        assert_eq!(chosen(shape, 60_000, noise, 1), Fit::Sphere, "{shape}");
    }
    // A body that points fill is no shell.
    assert_eq!(chosen(Shape::Volume, 60_000, 0.0, 1), Fit::Facets);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    #[ignore = "exhaustive"]
    fn spheres_are_chosen_where_points_are_noisy_and_nowhere_else(
        shape in prop_oneof![Just(Shape::Sphere), Just(Shape::Torus), Just(Shape::Box), Just(Shape::Knot)],
        points in 20_000u64..40_000,
        seed in 1u64..1000,
    ) {
        // The sampling distance of shapes that are 1 to 2 across, nearly.
        let distance = 1.5 / (points as f64).sqrt();
        prop_assert_eq!(chosen(shape, points, 0.0, seed), Fit::Facets);
        // The knot's tube is so thin that its curvature hides the noise.
        if shape != Shape::Knot {
            prop_assert_eq!(chosen(shape, points, 0.4 * distance, seed), Fit::Sphere);
        }
    }
}
