//! Parts against naive twins, and whole meshes: what must not change does not, and the bound holds.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DMat3, DVec2, DVec3};
use proptest::prelude::*;

use super::boxes::{Boxes, Extent as Box3};
use super::gap::{Drift, Overlay};
use super::queue::Queue;
use super::space::Space;
use super::*;
use crate::mesh::check::{CheckReport, check, intersections};
use crate::mesh::spool::FaceRecord;
use crate::points::attribute::{Attribute, Schema};
use crate::points::scalar::Scalar;

mod apart;
mod beside;
mod kept;
mod moved;
mod reading;
mod steps;

type Triangle = [DVec3; 3];

/// A mesh in memory.
#[derive(Debug, Clone, PartialEq)]
struct Mesh {
    vertices: Vec<[f64; 3]>,
    classes: Vec<u8>,
    colours: Vec<[u8; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh {
    fn corners(&self) -> Vec<Triangle> {
        self.triangles.iter().map(|t| t.map(|v| DVec3::from_array(self.vertices[v as usize]))).collect()
    }

    fn spool(&self, precision: Precision, workspace: &Workspace) -> MeshSpool {
        let names = ["classification", "red", "green", "blue"];
        let schema = Schema::new(names.map(|name| Attribute::new(name, Scalar::U8)).to_vec());
        let mut spool = MeshSpool::with_attributes(workspace, precision, schema, 1 << 30);
        spool.append_vertices(&self.vertices).unwrap();
        let records = self.classes.iter().zip(&self.colours);
        let records: Vec<u8> = records.flat_map(|(class, [r, g, b])| [*class, *r, *g, *b]).collect();
        spool.append_attributes(&records).unwrap();
        spool.append_faces(&self.triangles.iter().map(|t| FaceRecord::new(*t)).collect::<Vec<_>>()).unwrap();
        spool
    }

    fn of(spool: &MeshSpool) -> Mesh {
        let mut vertices = vec![[0.0; 3]; spool.vertex_count() as usize];
        spool.read_vertices(0, &mut vertices).unwrap();
        let mut triangles = vec![[0; 3]; spool.face_count() as usize];
        spool.read_faces(0, &mut triangles).unwrap();
        let read = |number: usize| -> Vec<u8> {
            let mut values = vec![0.0; vertices.len()];
            spool.read_attribute(number, 0, &mut values).unwrap();
            values.into_iter().map(|value| value as u8).collect()
        };
        let [classes, red, green, blue] = [0, 1, 2, 3].map(read);
        let colours = (0..vertices.len()).map(|v| [red[v], green[v], blue[v]]).collect();
        Mesh { vertices, classes, colours, triangles }
    }

    fn report(&self) -> CheckReport {
        let dir = tempfile::tempdir().unwrap();
        let (workspace, workers) = (Workspace::new(dir.path()).unwrap(), Workers::new(1).unwrap());
        let spool = self.spool(Precision::Double, &workspace);
        let mut report = check(&spool, 64 << 20, &workers, &workspace, &mut |_| ()).unwrap();
        report.intersections = Some(intersections(&spool, 64 << 20, &workers, &workspace, &mut |_| ()).unwrap());
        report
    }

    fn simplified(&self, options: &Options, threads: usize, budget: u64, precision: Precision) -> (Mesh, Figures) {
        let dir = tempfile::tempdir().unwrap();
        let (workspace, workers) = (Workspace::new(dir.path()).unwrap(), Workers::new(threads).unwrap());
        let spool = self.spool(precision, &workspace);
        let least = Extent::of(&spool, options.moves, options.colours.is_some()).least_memory();
        let given = Given {
            mesh: &spool,
            options,
            budget: budget.max(least),
            workers: &workers,
            workspace: &workspace,
            kept: None,
        };
        let (left, figures) = simplify(given, &mut |_| ()).unwrap();
        (Mesh::of(&left), figures)
    }
}

/// What a simplification must not change.
fn kept(report: &CheckReport) -> (bool, bool, bool, u64, Option<u64>, u64, i64) {
    let CheckReport { closed, oriented, manifold, components, genus, boundary_loops, euler, .. } = *report;
    (closed, oriented, manifold, components, genus, boundary_loops, euler)
}

/// The surface of a grid bent to a torus (closed both ways), a tube (one way) or a sheet, with waves on it.
#[derive(Debug, Clone, Copy)]
struct Shape {
    /// Rows and columns.
    cells: [usize; 2],
    closed: [bool; 2],
    waves: f64,
    noise: f64,
    turn: f64,
    seed: u64,
}

/// Numbers in [-1, 1) that are the same on every machine.
fn random(seed: u64, number: u64) -> f64 {
    let mut z = (seed ^ number.wrapping_mul(0x9e37_79b9_7f4a_7c15)).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

impl Shape {
    fn mesh(&self) -> Mesh {
        let [rows, columns] = self.cells;
        let [of_rows, of_columns] = [0, 1].map(|a| self.cells[a] + usize::from(!self.closed[a]));
        let turn = DMat3::from_rotation_z(self.turn) * DMat3::from_rotation_x(0.7 * self.turn);
        let (mut vertices, mut classes, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        let mut colours = Vec::new();
        for i in 0..of_rows {
            for j in 0..of_columns {
                let (u, v) = (i as f64 / rows as f64, j as f64 / columns as f64);
                let (a, b) = (std::f64::consts::TAU * u, std::f64::consts::TAU * v);
                let bump = self.waves * ((3.0 * a).sin() * (2.0 * b).cos());
                let place = match self.closed {
                    [true, true] => {
                        let r = 1.0 + 0.1 * bump;
                        DVec3::new((3.0 + r * b.cos()) * a.cos(), (3.0 + r * b.cos()) * a.sin(), r * b.sin())
                    }
                    [true, false] => DVec3::new((1.0 + 0.1 * bump) * a.cos(), (1.0 + 0.1 * bump) * a.sin(), 4.0 * v),
                    _ => DVec3::new(4.0 * u, 4.0 * v, 0.2 * bump),
                };
                let number = vertices.len() as u64 * 3;
                let off = DVec3::from_array([0, 1, 2].map(|m| random(self.seed, number + m)));
                let edge = 4.0 / rows.max(columns) as f64;
                vertices.push((turn * (place + 0.2 * self.noise * edge * off)).as_vec3().as_dvec3().to_array());
                classes.push(u8::from(u + 0.3 * v > 0.55));
                colours.push([a.sin(), (2.0 * b).cos(), (a + b).sin()].map(|c| (127.0 + 100.0 * c) as u8));
            }
        }
        let at = |i: usize, j: usize| ((i % of_rows) * of_columns + j % of_columns) as u32;
        for i in 0..rows {
            for j in 0..columns {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                if random(self.seed ^ 7, (i * columns + j) as u64) < 0.0 {
                    triangles.extend([[a, b, c], [a, c, d]]);
                } else {
                    triangles.extend([[a, b, d], [b, c, d]]);
                }
            }
        }
        Mesh { vertices, classes, colours, triangles }
    }
}

fn shapes(most: usize) -> impl Strategy<Value = Shape> {
    let sides = [5usize..most, 5usize..most];
    let flags = prop_oneof![Just([true, true]), Just([true, false]), Just([false, false])];
    (sides, flags, prop_oneof![Just(0.0), 0.1f64..1.0], prop_oneof![Just(0.0), 0.0f64..1.0], 0.0f64..1.0, any::<u64>())
        .prop_map(|(cells, closed, waves, noise, turn, seed)| Shape { cells, closed, waves, noise, turn, seed })
}

/// The distance of a place from a triangle (Ericson 2005).
fn distance(p: DVec3, [a, b, c]: Triangle) -> f64 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return p.distance(a);
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return p.distance(b);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return p.distance(a + ab * (d1 / (d1 - d3)));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return p.distance(c);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return p.distance(a + ac * (d2 / (d2 - d6)));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return p.distance(b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))));
    }
    let sum = va + vb + vc;
    p.distance(a + ab * (vb / sum) + ac * (vc / sum))
}

/// Simplified in parts: the same for any threads and memory, sound, and nowhere farther off than is told.
fn keeps_what_is_promised(
    mesh: &Mesh,
    before: &CheckReport,
    options: &Options,
) -> std::result::Result<(), TestCaseError> {
    let (left, figures) = passes::with_parts_of(300, || mesh.simplified(options, 1, 0, Precision::Single));
    for (threads, budget) in [(1, 1 << 30), (3, 0), (4, 200 << 20)] {
        let (again, others) =
            passes::with_parts_of(300, || mesh.simplified(options, threads, budget, Precision::Single));
        prop_assert_eq!(&left, &again);
        prop_assert_eq!(figures, others);
    }
    let after = left.report();
    prop_assert_eq!(kept(before), kept(&after));
    prop_assert!(after.intersections.as_ref().is_some_and(|found| found.none()));
    let (fine, coarse) = (mesh.corners(), left.corners());
    prop_assert!(farthest(&fine, &coarse).max(farthest(&coarse, &fine)) <= figures.reached * (1.0 + 1e-12) + 1e-12);
    Ok(())
}

/// The greatest distance of some places of one surface from the other.
fn farthest(from: &[Triangle], to: &[Triangle]) -> f64 {
    let places =
        from.iter().flat_map(|&[a, b, c]| [a, (a + b) / 2.0, (a + b + c) / 3.0, (b + c) / 2.0 * 0.9 + 0.1 * a]);
    let nearest = |p: DVec3| to.iter().map(|t| distance(p, *t)).fold(f64::INFINITY, f64::min);
    places.map(nearest).fold(0.0, f64::max)
}

const WITHIN: Options = Options { tolerance: None, most: None, borders: None, colours: None, moves: false };

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// G1 to G4 and G6's precondition, on closed and open surfaces, smooth and noisy.
    #[test]
    fn guarantees_are_kept(shape in shapes(26), part in 0.0f64..1.5, borders in any::<bool>()) {
        let mesh = shape.mesh();
        let before = mesh.report();
        prop_assume!(before.intersections.as_ref().is_some_and(|found| found.none()));
        let tolerance = part * part * 0.5;
        let borders = borders.then(|| "classification".to_owned());
        let options = Options { tolerance: Some(tolerance), borders: borders.clone(), ..WITHIN };
        let (left, figures) = mesh.simplified(&options, 2, 0, Precision::Double);
        let after = left.report();
        prop_assert_eq!(kept(&before), kept(&after));
        prop_assert!(after.intersections.as_ref().is_some_and(|found| found.none()), "{:?}", after.intersections);
        prop_assert_eq!(after.unreferenced_vertices, 0);
        prop_assert_eq!((figures.before, figures.after), (before.triangles, after.triangles));

        // Every vertex is one of those before, with its attributes, and in their order.
        let bits = |mesh: &Mesh| -> Vec<([u64; 3], u8, [u8; 3])> {
            let rest = mesh.classes.iter().zip(&mesh.colours);
            mesh.vertices.iter().zip(rest).map(|(v, (class, colour))| (v.map(f64::to_bits), *class, *colour)).collect()
        };
        let mut there = bits(&mesh).into_iter();
        prop_assert!(bits(&left).iter().all(|vertex| there.any(|other| other == *vertex)));

        prop_assert!(figures.reached <= tolerance);
        let (fine, coarse) = (mesh.corners(), left.corners());
        let (there, back) = (farthest(&fine, &coarse), farthest(&coarse, &fine));
        prop_assert!(there.max(back) <= figures.reached * (1.0 + 1e-12) + 1e-12, "{} {} {}", there, back, figures.reached);

        if borders.is_some() {
            // Classes that no triangle joined before are joined by none now.
            let joined = |mesh: &Mesh| -> BTreeSet<BTreeSet<u8>> {
                mesh.triangles.iter().map(|t| t.iter().map(|v| mesh.classes[*v as usize]).collect()).collect()
            };
            prop_assert!(joined(&left).is_subset(&joined(&mesh)));
        }
    }

    /// Many parts, so that borders are met: the same mesh for any threads and memory, and the same guarantees.
    #[test]
    #[ignore = "exhaustive"]
    fn parts_do_not_show(shape in shapes(60), part in 0.05f64..0.5) {
        let mesh = shape.mesh();
        let before = mesh.report();
        prop_assume!(before.intersections.as_ref().is_some_and(|found| found.none()));
        let options = Options { tolerance: Some(part), ..WITHIN };
        keeps_what_is_promised(&mesh, &before, &options)?;
    }

    #[test]
    fn as_few_as_are_asked_for(shape in shapes(30), share in 0.1f64..1.2) {
        let mesh = shape.mesh();
        prop_assume!(mesh.report().intersections.is_some_and(|found| found.none()));
        let most = (share * mesh.triangles.len() as f64) as u64;
        let fewest = mesh.simplified(&Options { tolerance: Some(1e9), ..WITHIN }, 1, 0, Precision::Double).1.after;
        for tolerance in [None, Some(1e9)] {
            let (left, figures) = mesh.simplified(&Options { tolerance, most: Some(most), ..WITHIN }, 1, 0, Precision::Double);
            prop_assert_eq!(left.triangles.len() as u64, figures.after);
            // There may be a few more where there are hardly any: what goes first is another.
            prop_assert!(figures.after <= most.max(fewest + fewest / 2 + 8), "{} of {most}, {fewest}", figures.after);
            if most as usize >= mesh.triangles.len() && tolerance.is_none() {
                prop_assert_eq!(figures.reached, 0.0);
            }
        }
    }

    /// A bound of every place of a star against sampled places of the overlay, straight above each other.
    #[test]
    fn no_place_of_a_star_moves_farther_than_told(
        heights in prop::collection::vec(-1.0f64..1.0, 3..9),
        radii in prop::collection::vec(0.3f64..2.0, 9),
        places in prop::collection::vec((0.0f64..1.0, 0.0f64..1.0), 200),
    ) {
        let n = heights.len();
        let ring: Vec<DVec3> = heights.iter().zip(&radii).enumerate().map(|(i, (height, radius))| {
            let angle = std::f64::consts::TAU * i as f64 / n as f64;
            DVec3::new(radius * angle.cos(), radius * angle.sin(), *height)
        }).collect();
        let mut overlay = Overlay::default();
        prop_assume!(overlay.look(DVec3::Z, ring.iter().copied(), true));
        let mut bounds = Vec::new();
        overlay.bounds(DVec3::Z, f64::INFINITY, |_| Drift::NONE, &mut bounds);
        let mut found = 0;
        for k in 1..n - 1 {
            let fresh = [ring[0], ring[k], ring[k + 1]];
            for &(s, t) in &places {
                let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
                let place = fresh[0] + (fresh[1] - fresh[0]) * s + (fresh[2] - fresh[0]) * t;
                // The old triangle below or above it.
                for j in 0..n {
                    let (p, q) = (ring[j], ring[(j + 1) % n]);
                    let whole = p.truncate().perp_dot(q.truncate());
                    let of_p = place.truncate().perp_dot(q.truncate()) / whole;
                    let of_q = p.truncate().perp_dot(place.truncate()) / whole;
                    if of_p >= 0.0 && of_q >= 0.0 && of_p + of_q <= 1.0 {
                        let way = of_p * p.z + of_q * q.z - place.z;
                        let Drift { low, high } = bounds[k - 1];
                        prop_assert!(low.z - 1e-9 <= way && way <= high.z + 1e-9, "{way} beyond {low} {high}");
                        found += 1;
                    }
                }
            }
        }
        prop_assert!(found >= places.len());
    }

    #[test]
    fn the_queue_gives_the_cheapest(steps in prop::collection::vec((0u32..20, 0u32..8, any::<bool>()), 1..200)) {
        let keys: Vec<u32> = (0..20).map(|v| v * 7 % 5).collect();
        let mut queue = Queue::new(keys.clone());
        let mut naive: BTreeMap<u32, f32> = BTreeMap::new();
        for (vertex, cost, put) in steps {
            if put {
                queue.put(vertex, cost as f32);
                naive.insert(vertex, cost as f32);
            } else {
                let first = naive.iter().min_by(|a, b| a.1.total_cmp(b.1).then(keys[*a.0 as usize].cmp(&keys[*b.0 as usize])).then(a.0.cmp(b.0)));
                let first = first.map(|(vertex, cost)| (*cost, *vertex));
                prop_assert_eq!(queue.pop(), first);
                first.map(|(_, vertex)| naive.remove(&vertex));
            }
            for vertex in 0..20 {
                prop_assert_eq!(queue.has(vertex), naive.contains_key(&vertex));
            }
        }
    }

    #[test]
    fn boxes_follow_their_triangles(
        corners in prop::collection::vec([[-5.0f64..5.0, -5.0..5.0, -5.0..5.0], [-1.0..1.0, -1.0..1.0, -1.0..1.0], [-1.0..1.0, -1.0..1.0, -1.0..1.0]], 1..60),
        steps in prop::collection::vec((0usize..60, [-5.0f64..5.0, -5.0..5.0, -5.0..5.0], any::<bool>()), 0..80),
    ) {
        let mut there: Vec<Option<Triangle>> = corners.iter().map(|[a, b, c]| {
            let a = DVec3::from_array(*a);
            Some([a, a + DVec3::from_array(*b), a + DVec3::from_array(*c)])
        }).collect();
        let at = |there: &[Option<Triangle>], t: u32| there[t as usize].unwrap_or_default();
        let centres = (0..there.len() as u32).map(|t| (t, at(&there, t)[0]));
        let mut boxes = Boxes::build(centres, there.len(), |t| at(&there, t));
        for (which, to, gone) in steps {
            let t = which % there.len();
            if there[t].is_none() {
                continue;
            }
            if gone {
                there[t] = None;
                boxes.remove(t as u32);
            } else {
                there[t] = there[t].map(|[_, b, c]| [DVec3::from_array(to), b, c]);
                boxes.update(t as u32, at(&there, t as u32));
            }
            let place = Box3::of([DVec3::from_array(to), DVec3::from_array(to) + 1.0]);
            let mut found = Vec::new();
            boxes.near(&place, &mut found);
            found.sort_unstable();
            let meet = |t: &u32| there[*t as usize].is_some_and(|corners| Box3::of(corners).meets(&place));
            prop_assert_eq!(found, (0..there.len() as u32).filter(meet).collect::<Vec<_>>());
        }
    }

    #[test]
    fn every_place_lies_in_one_part(
        sample in prop::collection::vec([-3i8..3, -3i8..3, -3i8..3], 0..80),
        most in 1u64..20,
        share in 0.2f64..0.8,
        asked in prop::collection::vec([-4i8..4, -4i8..4, -4i8..4], 2..20),
    ) {
        let place = |c: &[i8; 3]| c.map(f64::from);
        let sample: Vec<[f64; 3]> = sample.iter().map(place).collect();
        let count = sample.len() as u64;
        let distinct = sample.iter().map(|p| p.map(f64::to_bits)).collect::<BTreeSet<_>>().len();
        let space = Space::of(sample.clone(), count, most, share);
        let mut in_parts = vec![0u64; space.parts()];
        sample.iter().for_each(|place| in_parts[space.part(*place) as usize] += 1);
        prop_assert!(space.parts() <= distinct.max(1));
        if distinct == sample.len() {
            prop_assert!(in_parts.iter().all(|count| *count <= most), "{in_parts:?}");
        }
        for pair in asked.windows(2) {
            let (a, b) = (place(&pair[0]), place(&pair[1]));
            let low = std::array::from_fn(|m| a[m].min(b[m]));
            let high = std::array::from_fn(|m| a[m].max(b[m]));
            let mut met = Vec::new();
            space.meet(low, high, |part| met.push(part));
            // Places all over the box, which is what the parts are to be found by.
            let whole = |m: usize| (low[m] as i64..=high[m] as i64).map(|c| c as f64);
            let mut naive = BTreeSet::new();
            for x in whole(0) {
                for y in whole(1) {
                    for z in whole(2) {
                        naive.insert(space.part([x, y, z]));
                    }
                }
            }
            met.sort_unstable();
            prop_assert_eq!(met, naive.into_iter().collect::<Vec<_>>());
        }
    }
}

#[test]
fn a_flat_sheet_becomes_few_triangles() {
    let shape = Shape { cells: [60, 60], closed: [false, false], waves: 0.0, noise: 0.0, turn: 0.3, seed: 1 };
    let mesh = shape.mesh();
    let (left, _) = mesh.simplified(&Options { tolerance: Some(1e-5), ..WITHIN }, 1, 0, Precision::Single);
    assert!(left.triangles.len() * 50 < mesh.triangles.len(), "{} of {}", left.triangles.len(), mesh.triangles.len());
}

#[test]
fn what_is_no_manifold_stays_as_it_is() {
    // Two tubes that share a vertex, by number.
    let shape = Shape { cells: [12, 20], closed: [true, false], waves: 0.0, noise: 0.0, turn: 0.2, seed: 1 };
    let (mut mesh, other) = (shape.mesh(), shape.mesh());
    let count = mesh.vertices.len() as u32;
    mesh.vertices.extend(other.vertices.iter().map(|v| [v[0] + 9.0, v[1], v[2]]));
    mesh.classes.extend(other.classes);
    mesh.colours.extend(other.colours);
    let shared = 100;
    mesh.triangles.extend(other.triangles.iter().map(|t| t.map(|v| if v == shared { shared } else { v + count })));
    let before = mesh.report();
    assert!(before.nonmanifold_vertices == 1);
    let (left, _) = mesh.simplified(&Options { tolerance: Some(0.1), ..WITHIN }, 1, 0, Precision::Double);
    let after = left.report();
    assert!(left.triangles.len() < mesh.triangles.len());
    assert_eq!((after.nonmanifold_vertices, after.nonmanifold_edges), (1, 0));
    assert!(left.vertices.contains(&mesh.vertices[shared as usize]));
}

#[test]
fn too_little_memory_is_refused_with_the_figure_that_does() {
    let shape = Shape { cells: [60, 60], closed: [true, true], waves: 0.5, noise: 0.0, turn: 0.3, seed: 1 };
    let dir = tempfile::tempdir().unwrap();
    let (workspace, workers) = (Workspace::new(dir.path()).unwrap(), Workers::new(2).unwrap());
    let spool = shape.mesh().spool(Precision::Double, &workspace);
    let options = Options { tolerance: Some(0.01), ..WITHIN };
    let given =
        Given { mesh: &spool, options: &options, budget: 0, workers: &workers, workspace: &workspace, kept: None };
    let with = |budget: u64| simplify(Given { budget, ..given }, &mut |_| ());
    let refused = with(1 << 20).unwrap_err();
    let crate::error::Error::Budget { needed, .. } = refused else { panic!("{refused}") };
    with(needed.0).unwrap();
}
