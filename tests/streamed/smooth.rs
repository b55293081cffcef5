//! More smoothing makes the surface smoother and leaves its volume alone.

use asra_stream::internals::format::read;
use asra_stream::internals::mesh::MeshSource;
use asra_stream::internals::resources::workers::Workers;
use asra_stream::internals::run::generate::{Options, Shape, generate};
use asra_stream::internals::run::progress::{Progress, Show};
use asra_stream::internals::run::{Job, Resources, run};
use asra_stream::internals::settings::Resolution;
use asra_stream::internals::settings::surface::{Fit, SurfaceOptions};
use asra_stream::internals::settings::{Fineness, Settings};
use asra_stream::internals::storage::spool::Workspace;

/// Volume, and the root mean square of the angle between triangles with a common side, in degrees.
fn volume_and_roughness(mesh: &dyn MeshSource) -> (f64, f64) {
    let mut vertices = vec![[0.0; 3]; mesh.vertex_count() as usize];
    mesh.read_vertices(0, &mut vertices).unwrap();
    let mut faces = vec![[0; 3]; mesh.face_count() as usize];
    mesh.read_faces(0, &mut faces).unwrap();
    let cross =
        |u: [f64; 3], v: [f64; 3]| [0, 1, 2].map(|i| u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3]);
    let dot = |u: [f64; 3], v: [f64; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    let minus = |u: [f64; 3], v: [f64; 3]| [0, 1, 2].map(|i| u[i] - v[i]);
    let (mut volume, mut squares) = (0.0, 0.0);
    let mut sides = std::collections::HashMap::new();
    for face in &faces {
        let [a, b, c] = face.map(|v| vertices[v as usize]);
        volume += dot(a, cross(b, c)) / 6.0;
        let normal = cross(minus(b, a), minus(c, a));
        let unit = normal.map(|x| x / dot(normal, normal).sqrt());
        for [from, to] in [[face[0], face[1]], [face[1], face[2]], [face[2], face[0]]] {
            if let Some(other) = sides.insert((from.min(to), from.max(to)), unit) {
                squares += dot(unit, other).clamp(-1.0, 1.0).acos().powi(2);
            }
        }
    }
    (volume, (squares / sides.len() as f64).sqrt().to_degrees())
}

#[test]
fn twenty_steps_smooth_a_knot_and_a_sphere_and_leave_their_volumes() {
    let dir = tempfile::tempdir().unwrap();
    let workers = Workers::new(2).unwrap();
    for shape in [Shape::Sphere, Shape::Knot] {
        let cloud = dir.path().join(format!("{shape}.bin"));
        generate(&Options::new(shape, 200_000, &cloud), &workers, &mut |_| ()).unwrap();
        let smoothed = |smooth: u32| {
            let mesh = dir.path().join(format!("{shape}.{smooth}.ply"));
            let settings = Settings {
                fineness: Fineness::Given(Resolution::Slices(60)),
                surface: SurfaceOptions { smooth, fit: Fit::None, ..Settings::default().surface },
                ..Settings::default()
            };
            let resources = Resources {
                threads: Some(2),
                max_memory: Some(1 << 30),
                temp_dir: Some(dir.path().to_path_buf()),
                ..Resources::default()
            };
            let job = Job { output: Some(mesh.clone()), settings, resources, ..Job::new([&cloud]) };
            run(&job, &workers, &mut Progress::new(Show::Nothing)).unwrap();
            volume_and_roughness(&*read::open(&mesh, &Workspace::new(dir.path()).unwrap(), 1 << 28).unwrap())
        };
        let (volume, mut last) = smoothed(1);
        let first = last;
        for steps in [2, 3, 5, 10, 20] {
            let (now, roughness) = smoothed(steps);
            let change = (now / volume - 1.0).abs();
            assert!(change < 0.005, "{shape}, {steps} steps: the volume changes by {change}");
            assert!(roughness < last, "{shape}, {steps} steps: {roughness} degrees after {last}");
            last = roughness;
        }
        assert!(last < first / 3.0, "{shape}: {last} degrees after {first}");
    }
}
