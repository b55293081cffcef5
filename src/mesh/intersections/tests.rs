//! Meshes whose intersections are known, and a naive twin: every triangle with every other.

use std::collections::BTreeSet;

use proptest::prelude::*;

use super::*;
use crate::mesh::intersect::intersect;
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::points::Precision;

type Points = Vec<[f64; 3]>;
type Faces = Vec<[u32; 3]>;

/// What limits there are from roomy to so small that cells are distributed again and again.
fn limits(triangles: u64) -> [Limits; 3] {
    let usual = Limits::of(triangles);
    [Limits { held: 200, cells: 4, sample: 90, ..usual.clone() }, Limits { held: 150, ..usual.clone() }, usual]
}

fn search(
    points: &[[f64; 3]],
    faces: &[[u32; 3]],
    limits: &Limits,
    threads: usize,
    plan: Option<Plan>,
) -> Intersections {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let mut mesh = MeshSpool::new(&workspace, Precision::Double, 1 << 20);
    mesh.append_vertices(points).unwrap();
    mesh.append_faces(&faces.iter().map(|f| FaceRecord::new(*f)).collect::<Vec<_>>()).unwrap();
    let workers = Workers::new(threads).unwrap();
    let budget = if plan.is_some() { 0 } else { 1 << 30 };
    let plan = plan.unwrap_or_else(|| Plan::for_budget(budget, threads));
    let check = Check { mesh: &mesh, plan, workers: &workers, workspace: &workspace };
    let mut told = Vec::new();
    let search = Search { check: &check, budget, limits: limits.clone() };
    let found = search.run(&mut |done| told.push(done)).unwrap();
    assert!(told.is_sorted() && told.last() == Some(&(faces.len() as u64)), "{told:?}");
    found
}

/// The findings for roomy and for absurdly small means, which must be the same.
fn with_any_means(points: &[[f64; 3]], faces: &[[u32; 3]], limits: &Limits) -> Intersections {
    let small = Plan::for_budget(0, 1);
    let far = Plan { block: 3, window: 2, ..small.clone() };
    let found = search(points, faces, limits, 2, None);
    for (threads, plan) in [(1, None), (3, Some(small)), (2, Some(far))] {
        assert_eq!(search(points, faces, limits, threads, plan), found, "{threads} threads, {limits:?}");
    }
    found
}

fn intersections_of(points: &[[f64; 3]], faces: &[[u32; 3]]) -> Intersections {
    let [first, others @ ..] = limits(faces.len() as u64).map(|limits| with_any_means(points, faces, &limits));
    others.iter().for_each(|other| assert_eq!(*other, first));
    first
}

/// Every pair, and what it says of the mesh.
fn naive(points: &[[f64; 3]], faces: &[[u32; 3]]) -> (u64, u64, Option<[u64; 2]>) {
    let at = |face: [u32; 3]| face.map(|v| points[v as usize]);
    let sound = |face: [u32; 3]| !is_degenerate(face) && at(face).as_flattened().iter().all(|c| c.is_finite());
    let mut pairs = Vec::new();
    for (i, &a) in faces.iter().enumerate() {
        for (j, &b) in faces.iter().enumerate().skip(i + 1) {
            if sound(a) && sound(b) && intersect(a, at(a), b, at(b)) {
                pairs.push([i as u64, j as u64]);
            }
        }
    }
    let triangles: BTreeSet<u64> = pairs.iter().flatten().copied().collect();
    (pairs.len() as u64, triangles.len() as u64, pairs.first().copied())
}

/// A sphere of `rings` rows of `2 · rings` rectangles, each of two triangles (or one, at the poles).
fn sphere(rings: u32, centre: [f64; 3], radius: f64) -> (Points, Faces) {
    let columns = 2 * rings;
    let mut points = Vec::new();
    for i in 0..=rings {
        for j in 0..columns {
            let theta = f64::from(i) / f64::from(rings) * std::f64::consts::PI;
            let phi = f64::from(j) / f64::from(columns) * std::f64::consts::TAU;
            let way = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
            points.push([0, 1, 2].map(|m| centre[m] + radius * way[m]));
        }
    }
    // A pole is the first vertex of its row.
    let at = |i: u32, j: u32| i * columns + if i.is_multiple_of(rings) { 0 } else { j % columns };
    let squares = (0..rings).flat_map(|i| (0..columns).map(move |j| (i, j)));
    let cut = |(i, j)| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]];
    let faces = squares.flat_map(cut).filter(|face| !is_degenerate(*face)).collect();
    (points, faces)
}

/// Both meshes as one.
fn together(mut a: (Points, Faces), b: (Points, Faces)) -> (Points, Faces) {
    let shift = a.0.len() as u32;
    a.0.extend(b.0);
    a.1.extend(b.1.iter().map(|face| face.map(|v| v + shift)));
    a
}

#[test]
fn a_sphere_is_free_of_intersections() {
    let (points, faces) = sphere(20, [5e5, -3.0, 0.0], 2.0);
    let found = intersections_of(&points, &faces);
    assert!(found.none(), "{found:?}");
    assert_eq!((found.triangles, found.first), (0, None));
}

#[test]
fn two_spheres_that_cut_each_other() {
    let (points, faces) = together(sphere(14, [0.0; 3], 1.0), sphere(11, [0.7, 0.1, 0.2], 0.9));
    let found = intersections_of(&points, &faces);
    let (pairs, triangles, first) = naive(&points, &faces);
    assert!(pairs > 100 && found.complete && !found.none());
    assert_eq!((found.pairs, found.triangles), (pairs, triangles));
    let first_found = found.first.unwrap();
    assert_eq!(Some(first_found.triangles), first);
    let from_origin = first_found.at.iter().map(|c| c * c).sum::<f64>().sqrt();
    assert!((0.8..1.1).contains(&from_origin), "near both surfaces: {:?}", first_found.at);

    let apart = together(sphere(14, [0.0; 3], 1.0), sphere(11, [0.0; 3], 0.9));
    assert!(intersections_of(&apart.0, &apart.1).none(), "one within the other");
}

#[test]
fn the_order_of_triangles_decides_nothing_but_their_numbers() {
    let (points, mut faces) = together(sphere(14, [0.0; 3], 1.0), sphere(11, [0.7, 0.1, 0.2], 0.9));
    let found = intersections_of(&points, &faces);
    faces.sort_by_key(|[a, b, c]| (a * 7 + b * 31 + c * 101).wrapping_mul(2_654_435_761));
    let other = intersections_of(&points, &faces);
    assert_eq!((other.pairs, other.triangles), (found.pairs, found.triangles));
}

#[test]
fn a_few_huge_triangles_over_many_small_ones() {
    let (mut points, mut faces) = sphere(20, [0.0; 3], 1.0);
    for z in [-0.51, 0.013, 4.0] {
        let new = points.len() as u32;
        points.extend([[-90.0, -90.0, z], [200.0, -90.0, z], [-90.0, 200.0, z]]);
        faces.push([new, new + 1, new + 2]);
    }
    let found = intersections_of(&points, &faces);
    let (pairs, triangles, _) = naive(&points, &faces);
    assert_eq!((found.pairs, found.triangles, found.complete), (pairs, triangles, true));
}

#[test]
fn triangles_in_one_place_are_counted_up_to_the_limit() {
    let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let faces = vec![[0, 1, 2]; 300];
    let found = with_any_means(&points, &faces, &Limits::of(300));
    assert_eq!((found.pairs, found.triangles, found.complete), (300 * 299 / 2, 300, true));

    let few = Limits { pairs: 1000, ..Limits::of(300) };
    let found = with_any_means(&points, &faces, &few);
    assert_eq!((found.pairs, found.complete), (1000, false));
    assert_eq!(found.first.unwrap().triangles, [0, 1]);

    // Nothing parts them, so of a cell that does not fit only a sample is looked at.
    let found = with_any_means(&points, &faces, &Limits { held: 100, sample: 50, ..few });
    assert!(!found.complete && (100..=1000).contains(&found.pairs), "{found:?}");
}

#[test]
fn a_limit_in_the_middle_gives_the_same_findings_for_all_means() {
    let (points, faces) = together(sphere(14, [0.0; 3], 1.0), sphere(11, [0.7, 0.1, 0.2], 0.9));
    for (pairs, work) in [(50, u64::MAX), (u64::MAX, 2000), (u64::MAX, 20_000)] {
        let found = with_any_means(&points, &faces, &Limits { held: 64, pairs, work, ..Limits::of(1) });
        assert!(!found.complete && found.pairs <= pairs && !found.none(), "{found:?}");
    }
}

#[test]
fn what_is_not_sound_is_left_out() {
    let nan = f64::NAN;
    let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [nan, 0.0, 0.0], [0.0, 0.0, 1e300], [0.2, 0.2, -1.0]];
    assert!(intersections_of(&points, &[[0, 1, 2], [3, 4, 5], [0, 4, 5], [5, 5, 4], [1, 1, 1]]).none());
    assert!(intersections_of(&points, &[]).none() && intersections_of(&[], &[]).none());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// Triangles of all sizes, from few places and from anywhere.
    #[test]
    fn soup_agrees_with_the_naive_twin(
        places in prop::collection::vec(([0i32..9, 0i32..9, 0i32..9], 0i32..3), 3..80),
        corners in prop::collection::vec([any::<u32>(), any::<u32>(), any::<u32>()], 0..150),
        near in any::<bool>(),
    ) {
        let points: Points =
            places.iter().map(|(p, power)| p.map(|c| f64::from(c) * 10f64.powi(*power))).collect();
        let count = points.len() as u32;
        let near = |[a, b, c]: [u32; 3]| if near { [a, a.wrapping_add(b % 3), a.wrapping_add(c % 4)] } else { [a, b, c] };
        let faces: Faces = corners.into_iter().map(|c| near(c).map(|v| v % count)).collect();
        let [narrow, middling, found] = limits(faces.len() as u64).map(|limits| with_any_means(&points, &faces, &limits));
        for other in [narrow, middling] {
            prop_assert!(!other.complete || other == found, "{:?}", other);
        }
        let (pairs, triangles, first) = naive(&points, &faces);
        prop_assert!(found.complete);
        prop_assert_eq!((found.pairs, found.triangles, found.first.map(|f| f.triangles)), (pairs, triangles, first));
    }
}
