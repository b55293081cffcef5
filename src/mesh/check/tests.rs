//! Solids whose numbers are known, and a naive twin for everything else.

use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;

use super::*;
use crate::error::Error;
use crate::mesh::measure::GROUP;
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::points::Precision;
use crate::storage::work::store::{Folder, NamedFile, Store};

type Faces = Vec<[u32; 3]>;

const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

/// Plans from roomy to absurdly small: one vertex to a range, one corner at a time.
fn plans() -> [Plan; 5] {
    let roomy = Plan::for_budget(1 << 30, 2);
    let small = Plan::for_budget(0, 1);
    [
        Plan { range: (3, 3), block: 2, ..small.clone() },
        Plan { range: (1, 1), block: 1, window: 0, components: 0, in_flight: 1, ..small.clone() },
        Plan { range: (1, 64), block: 4, window: 5, components: 100, ..small.clone() },
        small,
        roomy,
    ]
}

fn report(positions: &[[f64; 3]], faces: &[[u32; 3]]) -> CheckReport {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let mut mesh = MeshSpool::new(&workspace, Precision::Double, 1 << 20);
    mesh.append_vertices(positions).unwrap();
    mesh.append_faces(&faces.iter().map(|f| FaceRecord::new(*f)).collect::<Vec<_>>()).unwrap();
    let mut reports = Vec::new();
    for (plan, threads) in plans().into_iter().zip([1, 2, 3, 1, 2]) {
        let workers = Workers::new(threads).unwrap();
        let check = Check { mesh: &mesh, plan, workers: &workers, workspace: &workspace };
        reports.push(check.run(&mut |_| ()).unwrap());
    }
    for of in [1, 2, 5] {
        // Each share with means of its own, as another process may have them; what they have shown goes through text.
        let workers: Vec<Workers> = [1, 2].into_iter().map(|threads| Workers::new(threads).unwrap()).collect();
        let means = |number: usize| shares::Means {
            budget: [0, 1 << 26][number % 2],
            workers: &workers[number % 2],
            workspace: &workspace,
        };
        let share = |number| shares::Share { number, of };
        let measure = |number| shares::measure(&mesh, share(number), means(number), &mut |_| ()).unwrap();
        let measured: Vec<shares::Measured> = (0..of).map(measure).map(through_text).collect();
        let looked = (0..of).map(|number| {
            // Files of a folder that tasks share, read again by their names.
            let store = Folder::open(dir.path(), &[]).unwrap();
            let named = ["joins", "boundary"].map(|what| {
                let name = format!("{what}-{number}-{of}");
                NamedFile { file: store.create(&name).unwrap(), name: name.into() }
            });
            let mut out = named.clone().map(|file| workspace.spool_in(file, 0));
            let looked = shares::look(&mesh, share(number), &measured, means(number + 1), &mut out, &mut |_| ())?;
            let files = [0, 1].map(|kind| workspace.spool_in(named[kind].clone(), looked.pairs[kind].to));
            Ok((through_text(looked), files))
        });
        reports.push(shares::conclude(&mesh, &measured, looked, means(of)).unwrap());
    }
    for other in &reports[1..] {
        // Compared as text since NaN is not equal to itself.
        assert_eq!(format!("{other:?}"), format!("{:?}", reports[0]), "the plan shows in the report");
    }
    reports.remove(0)
}

fn through_text<T: serde::Serialize + serde::de::DeserializeOwned>(value: T) -> T {
    serde_json::from_str(&serde_json::to_string(&value).unwrap()).unwrap()
}

/// Points on a parabola's graph, no four of them in a plane.
fn positions(count: u32) -> Vec<[f64; 3]> {
    (0..count).map(f64::from).map(|i| [i, i * i, i * i * i]).collect()
}

fn topology(vertices: u32, faces: &[[u32; 3]]) -> CheckReport {
    report(&positions(vertices), faces)
}

fn shifted(faces: &[[u32; 3]], by: u32) -> Faces {
    faces.iter().map(|f| f.map(|v| v + by)).collect()
}

/// A torus of `m` by `n` quadrilaterals, row by row; vertex (i, j) is i·n + j.
fn torus(m: u32, n: u32) -> (Vec<[f64; 3]>, Faces) {
    let angle = |i: u32, of: u32| f64::from(i) / f64::from(of) * std::f64::consts::TAU;
    let mut positions = Vec::new();
    let mut faces = Vec::new();
    for i in 0..m {
        for j in 0..n {
            let ((s, c), (t, d)) = (angle(i, m).sin_cos(), angle(j, n).sin_cos());
            positions.push([(3.0 + d) * c, (3.0 + d) * s, t]);
            let at = |i: u32, j: u32| i % m * n + j % n;
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    (positions, faces)
}

#[test]
fn a_tetrahedron_is_a_closed_oriented_manifold() {
    let corner = [[0.0; 3], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]];
    let found = report(&corner, &TETRAHEDRON);
    assert!(found.is_closed_oriented_manifold());
    assert_eq!((found.vertices, found.edges, found.triangles, found.euler), (4, 6, 4, 2));
    assert_eq!((found.components, found.genus), (1, Some(0)));
    assert_eq!((found.volume, found.area), (Some(4.5), 13.5 + 4.5 * 3f64.sqrt()));
    assert_eq!(found.bounds, Some([[0.0; 3], [3.0; 3]]));
    assert!(found.to_string().ends_with("closed, consistently oriented, manifold"), "{found}");
}

#[test]
fn a_torus_has_genus_one_and_its_volume() {
    let (positions, faces) = torus(40, 50);
    let found = report(&positions, &faces);
    assert!(found.is_closed_oriented_manifold());
    assert_eq!((found.euler, found.components, found.genus), (0, 1, Some(1)));
    let (area, volume) = (12.0 * std::f64::consts::PI.powi(2), 6.0 * std::f64::consts::PI.powi(2));
    assert!((found.area / area - 1.0).abs() < 0.01 && (found.volume.unwrap() / volume - 1.0).abs() < 0.01);
}

#[test]
fn tetrahedra_that_share_nothing_a_vertex_or_an_edge() {
    let with = |second: [u32; 4]| {
        let mut faces = TETRAHEDRON.to_vec();
        faces.extend(TETRAHEDRON.map(|f| f.map(|v| second[v as usize])));
        topology(8, &faces)
    };
    let apart = with([4, 5, 6, 7]);
    assert!(apart.is_closed_oriented_manifold());
    assert_eq!((apart.components, apart.euler, apart.genus), (2, 4, Some(0)));

    let vertex = with([4, 5, 3, 7]);
    assert!(vertex.closed && vertex.oriented && !vertex.manifold && !vertex.is_closed_oriented_manifold());
    assert_eq!((vertex.nonmanifold_vertices, vertex.nonmanifold_edges, vertex.components), (1, 0, 2));
    assert_eq!((vertex.genus, vertex.unreferenced_vertices), (None, 1));

    let edge = with([4, 2, 3, 7]);
    assert!(!edge.closed && edge.oriented && !edge.manifold);
    assert_eq!((edge.nonmanifold_vertices, edge.nonmanifold_edges, edge.components), (0, 1, 1));
}

#[test]
fn a_moebius_strip_cannot_be_oriented() {
    let faces: Faces = (0..5).map(|i| [i, (i + 1) % 5, (i + 2) % 5]).collect();
    let found = topology(5, &faces);
    assert!(!found.closed && !found.oriented && found.manifold);
    assert_eq!((found.edges, found.boundary_edges, found.euler, found.components), (10, 5, 0, 1));
}

#[test]
fn a_flipped_triangle_is_inconsistent_at_its_three_edges() {
    let mut faces = TETRAHEDRON.to_vec();
    faces[2].swap(0, 1);
    let found = topology(4, &faces);
    assert!(found.closed && !found.oriented && found.manifold);
    assert_eq!((found.inconsistent_edges, found.genus), (3, None));
}

#[test]
fn open_patch_with_degenerate_and_duplicate_triangles_and_idle_vertices() {
    let faces = [[0, 1, 2], [2, 1, 3], [3, 3, 1], [1, 2, 0], [5, 5, 5]];
    let found = topology(7, &faces);
    assert!(!found.closed && !found.oriented && !found.manifold);
    assert_eq!((found.degenerate_triangles, found.duplicate_triangles, found.unreferenced_vertices), (2, 1, 3));
    assert_eq!((found.edges, found.boundary_edges, found.nonmanifold_edges), (5, 2, 1));
    assert_eq!(found.inconsistent_edges, 2);
}

#[test]
fn nothing_is_not_closed() {
    let found = report(&[], &[]);
    assert!(!found.closed && !found.is_closed_oriented_manifold());
    assert_eq!((found.euler, found.components, found.bounds), (0, 0, None));
    assert_eq!(topology(3, &[]).unreferenced_vertices, 3);
}

#[test]
fn positions_that_are_not_finite_are_counted_and_measured_around() {
    let mut at = positions(5);
    at[3][1] = f64::NAN;
    at[4][0] = f64::NEG_INFINITY;
    let found = report(&at, &TETRAHEDRON);
    assert_eq!(found.nonfinite_vertices, 2);
    assert!(found.closed && found.manifold && !found.is_closed_oriented_manifold());
    assert!(found.area.is_finite() && found.volume.unwrap().is_finite());
    assert_eq!(found.bounds, Some([[0.0; 3], [2.0, 4.0, 8.0]]));
}

#[test]
fn a_vertex_number_out_of_range_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let mut mesh = MeshSpool::new(&workspace, Precision::Single, 1000);
    mesh.append_vertices(&positions(4)).unwrap();
    mesh.append_faces(&[FaceRecord::new([0, 1, 2]), FaceRecord::new([1, 4, 2])]).unwrap();
    let error = check(&mesh, 0, &Workers::new(1).unwrap(), &workspace, &mut |_| ()).unwrap_err();
    assert!(
        matches!(&error, Error::CheckFailed(what) if what == "triangle 1 names vertices [1, 4, 2] of 4"),
        "{error}"
    );
}

#[test]
fn an_open_mesh_has_no_volume() {
    let found = report(&positions(4), &TETRAHEDRON[..3]);
    assert!(!found.closed && found.area > 0.0);
    assert_eq!(found.volume, None);
    assert!(found.to_string().contains("area") && !found.to_string().contains("volume"), "{found}");
}

#[test]
fn volume_survives_coordinates_of_millions() {
    let (mut at, faces) = torus(30, 20);
    let near = report(&at, &faces).volume.unwrap();
    at.iter_mut().for_each(|p| *p = [p[0] + 500_000.0, p[1] + 5_100_000.0, p[2] + 300.0]);
    assert!((report(&at, &faces).volume.unwrap() / near - 1.0).abs() < 1e-9);
}

#[test]
fn far_groups_are_measured_like_near_ones() {
    // Four groups of triangles, and a last one that is short.
    let (at, faces) = torus(400, 380);
    assert!(faces.len() > 4 * GROUP);
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let workers = Workers::new(2).unwrap();
    let mut mesh = MeshSpool::new(&workspace, Precision::Double, 1 << 26);
    mesh.append_vertices(&at).unwrap();
    mesh.append_faces(&faces.iter().map(|f| FaceRecord::new(*f)).collect::<Vec<_>>()).unwrap();
    let roomy = Plan::for_budget(1 << 30, 2);
    let report = |window, far| {
        let plan = Plan { window, far, ..roomy.clone() };
        Check { mesh: &mesh, plan, workers: &workers, workspace: &workspace }.run(&mut |_| ()).unwrap()
    };
    let near = report(1 << 20, 0);
    assert!((near.area / (12.0 * std::f64::consts::PI.powi(2)) - 1.0).abs() < 1e-3);
    for far in [0, 1 << 20, 7 << 20, 1 << 24, 1 << 30] {
        assert_eq!(report(0, far), near, "{far} bytes for all of them");
    }
}

#[test]
fn progress_ends_with_the_number_of_triangles() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let mut mesh = MeshSpool::new(&workspace, Precision::Single, 1000);
    mesh.append_vertices(&positions(4)).unwrap();
    mesh.append_faces(&TETRAHEDRON.map(FaceRecord::new)).unwrap();
    let mut told = Vec::new();
    check(&mesh, 0, &Workers::new(1).unwrap(), &workspace, &mut |done| told.push(done)).unwrap();
    assert!(told.is_sorted() && told.last() == Some(&4), "{told:?}");
}

/// The obvious version: a map from edges to triangles.
fn naive(vertices: u32, faces: &[[u32; 3]]) -> [u64; 10] {
    let sound: Faces = faces.iter().copied().filter(|[a, b, c]| a != b && b != c && c != a).collect();
    let mut edges: BTreeMap<(u32, u32), Vec<(usize, bool)>> = BTreeMap::new();
    for (number, &[a, b, c]) in sound.iter().enumerate() {
        for (a, b) in [(a, b), (b, c), (c, a)] {
            edges.entry((a.min(b), a.max(b))).or_default().push((number, a < b));
        }
    }
    let sets = |of: &BTreeSet<usize>, joins: &dyn Fn(&(u32, u32)) -> bool| {
        let mut label: Vec<usize> = (0..sound.len()).collect();
        for (_, at) in edges.iter().filter(|(edge, _)| joins(edge)) {
            for pair in at.windows(2) {
                let (x, y) = (label[pair[0].0], label[pair[1].0]);
                label.iter_mut().filter(|l| **l == x).for_each(|l| *l = y);
            }
        }
        of.iter().map(|&f| label[f]).collect::<BTreeSet<_>>().len() as u64
    };
    let at = |v: u32| (0..sound.len()).filter(|&f| sound[f].contains(&v)).collect::<BTreeSet<_>>();
    let used = (0..vertices).filter(|&v| !at(v).is_empty()).count() as u64;
    let fans = |v: u32| sets(&at(v), &|&(a, b)| a == v || b == v);
    let sorted: BTreeSet<_> = sound.iter().map(|f| BTreeSet::from(*f)).collect();
    type Sides = [(usize, bool)];
    let count = |test: &dyn Fn(&Sides) -> bool| edges.values().filter(|at| test(at)).count() as u64;
    let forward = |at: &Sides| at.iter().filter(|(_, forward)| *forward).count();
    [
        edges.len() as u64,
        count(&|at| at.len() == 1),
        count(&|at| at.len() > 2),
        count(&|at| at.len() == 2 && forward(at) != 1),
        count(&|at| at.len() > 1 && 2 * forward(at) != at.len()),
        (0..vertices).filter(|&v| fans(v) > 1).count() as u64,
        u64::from(vertices) - used,
        (faces.len() - sound.len()) as u64,
        (sound.len() - sorted.len()) as u64,
        sets(&(0..sound.len()).collect(), &|_| true),
    ]
}

fn numbers(found: &CheckReport) -> [u64; 10] {
    [
        found.edges,
        found.boundary_edges,
        found.nonmanifold_edges,
        found.inconsistent_edges,
        u64::from(!found.oriented),
        found.nonmanifold_vertices,
        found.unreferenced_vertices,
        found.degenerate_triangles,
        found.duplicate_triangles,
        found.components,
    ]
}

fn expected(vertices: u32, faces: &[[u32; 3]]) -> [u64; 10] {
    let mut expected = naive(vertices, faces);
    expected[4] = expected[4].min(1);
    expected
}

proptest! {
    #[test]
    fn triangle_soup_agrees_with_the_naive_twin(
        vertices in 1u32..14,
        faces in prop::collection::vec([0u32..14, 0u32..14, 0u32..14], 0..30),
    ) {
        let faces: Faces = faces.into_iter().map(|f| f.map(|v| v % vertices)).collect();
        prop_assert_eq!(numbers(&topology(vertices, &faces)), expected(vertices, &faces));
    }

    #[test]
    #[ignore = "exhaustive"]
    fn manifolds_with_their_elements_shuffled_stay_what_they_are(
        sizes in (3u32..6, 3u32..7),
        tetrahedra in 0u32..3,
        merged in prop::option::of((0u32..30, 0u32..30)),
        seed in prop::collection::vec(any::<u32>(), 60),
    ) {
        let (at, mut faces) = torus(sizes.0, sizes.1);
        let mut vertices = at.len() as u32;
        for _ in 0..tetrahedra {
            faces.extend(shifted(&TETRAHEDRON, vertices));
            vertices += 4;
        }
        if let Some((a, b)) = merged {
            faces.iter_mut().flatten().filter(|v| **v == a % vertices).for_each(|v| *v = b % vertices);
        }
        let mut order: Vec<u32> = (0..vertices).collect();
        order.sort_by_key(|v| seed[*v as usize % seed.len()].wrapping_mul(v + 1));
        faces.iter_mut().flatten().for_each(|v| *v = order[*v as usize]);
        faces.sort_by_key(|f| seed[f[0] as usize % seed.len()] ^ f[1]);
        let found = topology(vertices, &faces);
        prop_assert_eq!(numbers(&found), expected(vertices, &faces));
        if merged.is_none_or(|(a, b)| a % vertices == b % vertices) {
            prop_assert!(found.is_closed_oriented_manifold());
            prop_assert_eq!((found.components, found.genus), (u64::from(tetrahedra) + 1, Some(1)));
        }
    }
}
