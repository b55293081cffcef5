//! Comparisons against a twin that looks at every pair, with memory from plenty to hardly any.

use std::fmt::Write;

use proptest::prelude::*;

use super::report::Distances;
use super::*;
use crate::input::InputOptions;
use crate::nearest::shape::{Line, angle};
use crate::run::Resources;
use crate::run::progress::Show;

/// Vertices and triangles; without triangles it is a cloud.
#[derive(Debug, Clone)]
struct Shape {
    vertices: Vec<Point>,
    faces: Vec<[u32; 3]>,
    origin: Point,
}

impl Shape {
    fn ply(&self) -> String {
        let [x, y, z] = self.origin;
        let mut text = format!(
            "ply\nformat ascii 1.0\ncomment origin {x} {y} {z}\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n",
            self.vertices.len()
        );
        if !self.faces.is_empty() {
            write!(text, "element face {}\nproperty list uchar int vertex_indices\n", self.faces.len()).unwrap();
        }
        text += "end_header\n";
        self.vertices.iter().for_each(|[x, y, z]| writeln!(text, "{x} {y} {z}").unwrap());
        self.faces.iter().for_each(|[a, b, c]| writeln!(text, "3 {a} {b} {c}").unwrap());
        text
    }

    /// Where the vertices lie.
    fn places(&self) -> Vec<Point> {
        // The origin of a cloud's file is no comment that readers of clouds know.
        let origin = if self.faces.is_empty() { [0.0; 3] } else { self.origin };
        self.vertices.iter().map(|p| std::array::from_fn(|a| p[a] + origin[a])).collect()
    }
}

/// What the twin finds: distances and angles in no order.
#[derive(Default)]
struct Twin {
    nearest_point: Vec<f64>,
    mesh_centroids: Vec<f64>,
    mesh_vertices: Vec<f64>,
    reference_points: Vec<f64>,
    reference_centroids: Vec<f64>,
    along: Vec<f64>,
    missed: u64,
    turned: Vec<f64>,
}

/// Every pair; `None` where there is nothing to measure. The mesh's normals are turned `over` if asked for.
fn twin(mesh: &Shape, reference: &Shape, over: bool) -> Option<Twin> {
    let finite = |p: &Point| p.iter().all(|c| c.is_finite());
    let mut points: Vec<Point> = reference.places().into_iter().filter(finite).collect();
    let corner: Point = std::array::from_fn(|a| points.iter().map(|p| p[a]).fold(f64::INFINITY, f64::min));
    let from_corner = |p: Point| -> Point { std::array::from_fn(|a| p[a] - corner[a]) };
    points.iter_mut().for_each(|p| *p = from_corner(*p));
    let triangles = |shape: &Shape| -> Vec<Triangle> {
        let places = shape.places();
        let corners = shape.faces.iter().map(|face| face.map(|v| places[v as usize]));
        corners.filter(|t| t.iter().all(finite)).map(|t| Triangle(t.map(from_corner))).collect()
    };
    let (surface, other) = (triangles(mesh), triangles(reference));
    let sized = points.iter().any(|p| *p != points[0]);
    if surface.is_empty() || !sized || other.is_empty() && !reference.faces.is_empty() {
        return None;
    }
    let vertices: Vec<Point> = mesh.places().into_iter().filter(finite).map(from_corner).collect();
    fn least<T: Target>(from: Point, to: &[T]) -> f64 {
        to.iter().map(|target| target.distance2(from)).fold(f64::INFINITY, f64::min).sqrt()
    }
    let spots: Vec<Spot> = points.iter().map(|p| Spot(*p)).collect();
    let mut found = Twin {
        nearest_point: surface.iter().map(|t| least(t.centroid(), &spots)).collect(),
        reference_points: points.iter().map(|p| least(*p, &surface)).collect(),
        reference_centroids: other.iter().map(|t| least(t.centroid(), &surface)).collect(),
        ..Twin::default()
    };
    if other.is_empty() {
        found.mesh_centroids.clone_from(&found.nearest_point);
        found.mesh_vertices = vertices.iter().map(|p| least(*p, &spots)).collect();
        return Some(found);
    }
    found.mesh_centroids = surface.iter().map(|t| least(t.centroid(), &other)).collect();
    found.mesh_vertices = vertices.iter().map(|p| least(*p, &other)).collect();
    for triangle in &surface {
        let Some(normal) = triangle.normal() else {
            found.missed += 1;
            continue;
        };
        let normal = if over { normal.map(|c| -c) } else { normal };
        let place = triangle.centroid();
        let line = Line { origin: place, direction: normal };
        let met = other.iter().filter_map(|t| t.crossing(&line)).min_by(f64::total_cmp);
        met.map_or_else(|| found.missed += 1, |at| found.along.push(at));
        let nearest = other.iter().map(|t| t.distance2(place)).min_by(f64::total_cmp).unwrap();
        let equal = other.iter().filter(|t| t.distance2(place) == nearest);
        let turned = equal.filter_map(Triangle::normal).map(|other| angle(normal, other)).min_by(f64::total_cmp);
        found.turned.extend(turned);
    }
    Some(found)
}

/// Distances in units as they ought to be: exact where no sum is taken.
fn check_distances(found: &Distances, mut expected: Vec<f64>) {
    expected.sort_by(f64::total_cmp);
    let n = expected.len();
    assert_eq!(found.count, n as u64);
    assert_eq!(found.max.units, expected[n - 1]);
    assert_eq!(found.p95.units, expected[(95 * n).div_ceil(100) - 1]);
    let mean = expected.iter().sum::<f64>() / n as f64;
    let rms = (expected.iter().map(|d| d * d).sum::<f64>() / n as f64).sqrt();
    assert!((found.mean.units - mean).abs() <= 1e-12 * mean && (found.rms.units - rms).abs() <= 1e-12 * rms);
}

fn compared(mesh: &Shape, reference: &Shape, budget: u64, threads: usize) -> Result<Comparison> {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str, shape: &Shape| {
        let path = dir.path().join(name);
        std::fs::write(&path, shape.ply()).unwrap();
        path
    };
    let job = Job {
        mesh: path("mesh.ply", mesh),
        reference: path("reference.ply", reference),
        kind: None,
        input: InputOptions::default(),
        heatmap: None,
        resources: Resources {
            max_memory: Some(budget),
            threads: Some(threads),
            temp_dir: Some(dir.path().into()),
            ..Resources::default()
        },
    };
    let found = compare(&job, &job.resources.workers().unwrap(), &mut Progress::new(Show::Nothing));
    found.map(|mut found| {
        (found.mesh.path, found.reference.path) = ("mesh".into(), "reference".into());
        found
    })
}

fn check_all(mesh: &Shape, reference: &Shape) {
    let found = [(1 << 30, 1), (1 << 14, 2), (1 << 12, 1), (1, 2)]
        .map(|(budget, threads)| compared(mesh, reference, budget, threads));
    let [plenty, less @ ..] = found;
    let over = plenty.as_ref().is_ok_and(|found| {
        let reference = &found.reference;
        is_inside_out(found.mesh.volume) != is_inside_out(reference.volume)
    });
    let expected = twin(mesh, reference, over);
    let Some(expected) = expected else {
        assert!(plenty.is_err() && less.iter().all(Result::is_err));
        return;
    };
    let plenty = plenty.unwrap();
    for found in less {
        assert_eq!(found.unwrap(), plenty);
    }
    check_distances(&plenty.mesh_to_reference.centroids, expected.mesh_centroids);
    check_distances(&plenty.mesh_to_reference.vertices, expected.mesh_vertices);
    check_distances(&plenty.reference_to_mesh.points, expected.reference_points);
    match plenty.reference_to_mesh.centroids {
        Some(found) => check_distances(&found, expected.reference_centroids),
        None => assert!(expected.reference_centroids.is_empty()),
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let squares = |values: &[f64]| values.iter().map(|d| (100.0 * d / plenty.longest_side).powi(2)).collect::<Vec<_>>();
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-11 * b.abs();
    assert!(near(plenty.mse.nearest_point, 100.0 * mean(&squares(&expected.nearest_point))));
    match plenty.mse.along_normal {
        Some(found) => assert!(near(found, 100.0 * mean(&squares(&expected.along)))),
        None => assert!(expected.along.is_empty()),
    }
    assert_eq!(plenty.mse.along_normal_missed, expected.missed);
    match plenty.normal_deviation {
        Some(found) => {
            assert_eq!(found.max, expected.turned.iter().copied().fold(0.0, f64::max));
            assert!(near(found.mean, mean(&expected.turned)));
        }
        None => assert!(expected.turned.is_empty()),
    }
}

fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![8 => (-2i32..3).prop_map(f64::from), 8 => -2.0..2.0f64, 1 => -1e4..1e4f64]
}

fn shape(faces: std::ops::Range<usize>) -> impl Strategy<Value = Shape> {
    let vertex = prop_oneof![40 => prop::array::uniform3(coordinate()), 1 => Just([0.5, f64::NAN, 0.0])];
    let origin = prop_oneof![Just([0.0; 3]), Just([1024.0, -4096.0, 8.0]), Just([0.1, 0.2, 0.3])];
    (prop::collection::vec(vertex, 3..30), prop::collection::vec(prop::array::uniform3(any::<u32>()), faces), origin)
        .prop_map(|(vertices, mut faces, origin)| {
            faces.as_flattened_mut().iter_mut().for_each(|v| *v %= vertices.len() as u32);
            Shape { vertices, faces, origin }
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(if cfg!(debug_assertions) { 60 } else { 300 }))]
    #[test]
    fn any_mesh_against_any_mesh(mesh in shape(1..60), reference in shape(1..60), shared: bool) {
        // Often enough both are to lie on each other in part.
        let mut mesh = mesh;
        if shared {
            mesh.vertices.extend_from_slice(&reference.vertices);
            mesh.origin = reference.origin;
        }
        check_all(&mesh, &reference);
    }

    #[test]
    fn any_mesh_against_any_cloud(mesh in shape(1..40), cloud in shape(0..1), copies in 1usize..4) {
        let cloud = Shape { vertices: cloud.vertices.repeat(copies), ..cloud };
        check_all(&mesh, &cloud);
    }
}

/// A tetrahedron of side vectors along the axes.
fn tetrahedron(size: f64, origin: Point) -> Shape {
    let vertices = [[0.0; 3], [size, 0.0, 0.0], [0.0, size, 0.0], [0.0, 0.0, size]].to_vec();
    Shape { vertices, faces: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], origin }
}

#[test]
fn a_mesh_is_no_distance_from_itself_wherever_its_origin_is() {
    let plain = tetrahedron(3.0, [0.0; 3]);
    let mut moved = tetrahedron(3.0, [512_000.0, 5_403_000.0, -300.0]);
    let mut far = plain.clone();
    far.vertices.iter_mut().for_each(|p| *p = [p[0] + 512_000.0, p[1] + 5_403_000.0, p[2] - 300.0]);
    for (mesh, reference) in [(&plain, &plain), (&moved, &far), (&far, &moved)] {
        let found = compared(mesh, reference, 1 << 26, 1).unwrap();
        for distances in
            [&found.mesh_to_reference.centroids, &found.mesh_to_reference.vertices, &found.reference_to_mesh.points]
        {
            assert!(distances.max.units < 1e-9, "{distances:?}");
        }
        assert_eq!(found.mesh_to_reference.vertices.max.units, 0.0);
        assert_eq!(found.avr.map(|avr| avr < 1e-9), Some(true));
        assert_eq!(found.mse.along_normal_missed, 0);
        assert!(found.normal_deviation.unwrap().max < 1e-6);
        assert_eq!(found.longest_side, 3.0);
        assert!((found.diagonal - 27f64.sqrt()).abs() < 1e-12);
    }
    let mut inside_out = plain.clone();
    inside_out.faces.iter_mut().for_each(|face| face.swap(0, 1));
    let found = compared(&plain, &inside_out, 1 << 26, 1).unwrap();
    assert!(found.normal_deviation.unwrap().max < 1e-6 && found.avr.unwrap() < 1e-9);
    moved.origin[0] += 3.0;
    assert!(compared(&moved, &far, 1 << 26, 1).unwrap().reference_to_mesh.points.max.units == 3.0);
}

#[test]
fn a_tetrahedron_half_as_large_has_the_errors_that_can_be_told_by_hand() {
    let (mesh, reference) = (tetrahedron(1.0, [0.0; 3]), tetrahedron(2.0, [0.0; 3]));
    let found = compared(&mesh, &reference, 1 << 26, 1).unwrap();
    // Three faces lie on the other's; the fourth is parallel, (2 - 1) / sqrt 3 away.
    let away = 1.0 / 3f64.sqrt();
    assert!((found.mesh_to_reference.centroids.max.units - 1.0 / 3.0).abs() < 1e-12, "the other faces are nearer");
    assert!((found.mse.along_normal.unwrap() - 100.0 * (50.0 * away).powi(2) / 4.0).abs() < 1e-6, "{:?}", found.mse);
    assert_eq!(found.mesh_to_reference.vertices.max.units, 0.0);
    assert_eq!(found.reference_to_mesh.points.max.units, 1.0);
    assert_eq!(found.reference_to_mesh.points.count, 4);
    // Area grows as the square, volume as the cube.
    assert!((found.avr.unwrap() - 100.0).abs() < 1e-9);
}

#[test]
fn large_triangles_equal_points_and_outliers_are_no_exception() {
    let mut mesh = tetrahedron(1.0, [0.0; 3]);
    for i in 0..200 {
        let x = f64::from(i) * 0.01;
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend([[x, 0.0, 0.0], [x + 0.01, 0.0, 0.0], [x, 0.01, 0.0]]);
        mesh.faces.push([first, first + 1, first + 2]);
    }
    let first = mesh.vertices.len() as u32;
    mesh.vertices.extend([[-1e3, -1e3, 5.0], [1e3, -1e3, 5.0], [0.0, 2e3, 5.0]]);
    mesh.faces.push([first, first + 1, first + 2]);
    let mut vertices = vec![[0.25; 3]; 500];
    vertices.extend([[1e6, 0.0, 0.0], [0.0, -1e6, 1e6]]);
    let cloud = Shape { vertices, faces: Vec::new(), origin: [0.0; 3] };
    check_all(&mesh, &cloud);
    check_all(&mesh, &mesh);
}

#[test]
fn nothing_to_measure_is_said() {
    let mesh = tetrahedron(1.0, [0.0; 3]);
    let cloud = |vertices: Vec<Point>| Shape { vertices, faces: Vec::new(), origin: [0.0; 3] };
    for (mesh, reference, part) in [
        (&cloud(vec![[0.0; 3]]), &mesh, "mesh.ply: the header: expected one element face"),
        (&mesh, &cloud(Vec::new()), "the input holds no points"),
        (&mesh, &cloud(vec![[f64::NAN; 3]]), "the input holds no points"),
        (&mesh, &cloud(vec![[1.0; 3]; 3]), "a single place"),
        (
            &Shape { vertices: vec![[f64::NAN; 3]; 3], ..mesh.clone() }.with_faces(1),
            &mesh,
            "expected triangles with finite corners",
        ),
    ] {
        let error = compared(mesh, reference, 1 << 26, 1).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
}

impl Shape {
    /// The first triangle, so many times.
    fn with_faces(self, count: usize) -> Shape {
        Shape { faces: vec![[0, 1, 2]; count], ..self }
    }
}
