//! Vertices that move, and colours that are kept.

use super::*;
use crate::simplify::patch::{Node, Patch};

const MOVED: Options = Options { moves: true, ..WITHIN };

/// How far colours at some places of one surface are from all that the other has within a distance: the least difference, channel by channel, is looked for
/// between the least and the greatest of a triangle's corners.
fn recoloured(from: &Mesh, to: &Mesh, within: f64) -> f64 {
    let places = to.corners();
    let tints =
        |mesh: &Mesh, t: usize| mesh.triangles[t].map(|v| DVec3::from_array(mesh.colours[v as usize].map(f64::from)));
    let mut worst = 0f64;
    for (t, [a, b, c]) in from.corners().into_iter().enumerate() {
        let [p, q, r] = tints(from, t);
        for [x, y, z] in [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.3, 0.3, 0.4], [0.0, 0.2, 0.8]] {
            let (place, tint) = (a * x + b * y + c * z, p * x + q * y + r * z);
            let there = (0..places.len()).filter(|other| distance(place, places[*other]) <= within);
            let away = there.map(|other| {
                let [p, q, r] = tints(to, other);
                let (low, high) = (p.min(q).min(r), p.max(q).max(r));
                (low - tint).max(tint - high).max(DVec3::ZERO).max_element()
            });
            worst = worst.max(away.fold(f64::INFINITY, f64::min));
        }
    }
    worst
}

/// The height and the colour of a triangle over a place, if it lies there.
fn over(corners: [Node; 3], at: DVec2) -> Option<(f64, DVec3)> {
    let [a, b, c] = corners;
    let whole = (b.at - a.at).perp_dot(c.at - a.at);
    let of_b = (at - a.at).perp_dot(c.at - a.at) / whole;
    let of_c = (b.at - a.at).perp_dot(at - a.at) / whole;
    let inside = of_b >= 0.0 && of_c >= 0.0 && of_b + of_c <= 1.0;
    let height = a.height + of_b * (b.height - a.height) + of_c * (c.height - a.height);
    inside.then(|| (height, a.tint + (b.tint - a.tint) * of_b + (c.tint - a.tint) * of_c))
}

fn nodes(most: usize) -> impl Strategy<Value = Vec<(f64, f64, [f64; 3])>> {
    let channel = 0.0f64..255.0;
    prop::collection::vec((0.3f64..2.0, -1.0f64..1.0, [channel.clone(), channel.clone(), channel]), 4..most)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// G1, G2, G4, borders of classes and colours, on closed and open surfaces, smooth and noisy.
    #[test]
    fn guarantees_are_kept_where_vertices_move(
        shape in shapes(24),
        part in 0.0f64..1.5,
        borders in any::<bool>(),
        colours in prop_oneof![Just(None), (0u8..120).prop_map(Some)],
        moves in any::<bool>(),
        share in prop_oneof![Just(None), (0.05f64..0.9).prop_map(Some)],
    ) {
        let mesh = shape.mesh();
        let before = mesh.report();
        prop_assume!(before.intersections.as_ref().is_some_and(|found| found.none()));
        let tolerance = part * part * 0.5;
        // Within a tolerance alone, places are tried last; for a number of triangles, first.
        let most = share.map(|share| (share * mesh.triangles.len() as f64) as u64);
        let borders = borders.then(|| "classification".to_owned());
        let options = Options { tolerance: Some(tolerance), borders: borders.clone(), colours, moves, most };
        let (left, figures) = mesh.simplified(&options, 2, 0, Precision::Single);
        let after = left.report();
        prop_assert_eq!(kept(&before), kept(&after));
        prop_assert!(after.intersections.as_ref().is_some_and(|found| found.none()), "{:?}", after.intersections);
        prop_assert_eq!(after.unreferenced_vertices, 0);

        prop_assert!(figures.reached <= tolerance);
        let (fine, coarse) = (mesh.corners(), left.corners());
        let (there, back) = (farthest(&fine, &coarse), farthest(&coarse, &fine));
        prop_assert!(there.max(back) <= figures.reached * (1.0 + 1e-12) + 1e-12, "{} {} {}", there, back, figures.reached);

        prop_assert_eq!(figures.recoloured.is_some(), colours.is_some());
        if let (Some(most), Some(told)) = (colours, figures.recoloured) {
            prop_assert!(told <= f64::from(most));
            let within = figures.reached * (1.0 + 1e-12) + 1e-12;
            for (from, to) in [(&mesh, &left), (&left, &mesh)] {
                let found = recoloured(from, to, within);
                prop_assert!(found <= told + 1e-9, "{found} of {told}");
            }
        }
        if borders.is_some() {
            let joined = |mesh: &Mesh| -> BTreeSet<BTreeSet<u8>> {
                mesh.triangles.iter().map(|t| t.iter().map(|v| mesh.classes[*v as usize]).collect()).collect()
            };
            prop_assert!(joined(&left).is_subset(&joined(&mesh)));
        }
    }

    #[test]
    #[ignore = "exhaustive"]
    fn parts_do_not_show_where_vertices_move(
        shape in shapes(40),
        part in 0.05f64..0.5,
        colours in prop_oneof![Just(None), Just(Some(60))],
        most in prop_oneof![3 => Just(None), 1 => Just(Some(700))],
    ) {
        let mesh = shape.mesh();
        let before = mesh.report();
        prop_assume!(before.intersections.as_ref().is_some_and(|found| found.none()));
        let options = Options { tolerance: Some(part), colours, most, ..MOVED };
        keeps_what_is_promised(&mesh, &before, &options)?;
    }

    /// On a plane nothing drifts, so that a place's colour before is that of the same place.
    #[test]
    fn colours_of_a_plane_stay_where_they_are(
        cells in [8usize..24, 8usize..24], turn in 0.0f64..1.0, seed in any::<u64>(), most in 0u8..200, moves in any::<bool>(), smooth in any::<bool>(),
    ) {
        let shape = Shape { cells, closed: [false, false], waves: 0.0, noise: 0.0, turn, seed };
        let mut mesh = shape.mesh();
        if !smooth {
            for (number, colour) in mesh.colours.iter_mut().enumerate() {
                *colour = [0, 1, 2].map(|channel| (127.0 + 120.0 * random(seed, 3 * number as u64 + channel)) as u8);
            }
        }
        let options = Options { tolerance: Some(1e-6), colours: Some(most), moves, ..WITHIN };
        let (left, figures) = mesh.simplified(&options, 1, 0, Precision::Single);
        let told = figures.recoloured.unwrap();
        prop_assert!(told <= f64::from(most));
        let normal = DMat3::from_rotation_z(turn) * DMat3::from_rotation_x(0.7 * turn) * DVec3::Z;
        let (right, up) = gap::across(normal);
        let flat = |mesh: &Mesh| -> Vec<[Node; 3]> {
            let node = |v: u32| {
                let place = DVec3::from_array(mesh.vertices[v as usize]);
                let tint = DVec3::from_array(mesh.colours[v as usize].map(f64::from));
                Node { at: DVec2::new(place.dot(right), place.dot(up)), height: 0.0, tint }
            };
            mesh.triangles.iter().map(|t| t.map(node)).collect()
        };
        let (fine, coarse) = (flat(&mesh), flat(&left));
        for (number, corners) in fine.iter().enumerate() {
            for [x, y, z] in [[0.98, 0.01, 0.01], [0.01, 0.5, 0.49], [0.3, 0.3, 0.4]] {
                let at = corners[0].at * x + corners[1].at * y + corners[2].at * z;
                let tint = corners[0].tint * x + corners[1].tint * y + corners[2].tint * z;
                let Some((_, now)) = coarse.iter().find_map(|corners| over(*corners, at)) else { continue };
                // Places move by 10⁻⁶, and colours change by 255 from vertex to vertex at the most.
                prop_assert!((now - tint).abs().max_element() <= told + 0.01, "{number}: {now} for {tint}, told {told}");
            }
        }
        if most > 100 && smooth {
            prop_assert!(left.triangles.len() < mesh.triangles.len());
        }
    }

    /// A vertex that goes to a neighbour: the same as is told by what knows nothing else.
    #[test]
    fn patches_tell_what_overlays_do(ring in nodes(9)) {
        let n = ring.len();
        let places: Vec<DVec3> = ring.iter().enumerate().map(|(i, (radius, height, _))| {
            let angle = std::f64::consts::TAU * i as f64 / n as f64;
            DVec3::new(radius * angle.cos(), radius * angle.sin(), *height)
        }).collect();
        let mut overlay = Overlay::default();
        prop_assume!(overlay.look(DVec3::Z, places.iter().copied(), true));
        let mut bounds = Vec::new();
        overlay.bounds(DVec3::Z, f64::INFINITY, |_| Drift::NONE, &mut bounds);
        let mut patch = Patch::default();
        patch.size = overlay.size();
        let node = |(at, height)| Node { at, height, tint: DVec3::ZERO };
        patch.nodes.extend((0..n).map(|k| node(overlay.node(k))).chain([node(overlay.middle())]));
        patch.old.triangles.extend((0..n).map(|j| [n, j, (j + 1) % n]));
        patch.old.inner.push(n);
        patch.new.triangles.extend((1..n - 1).map(|k| [0, k, k + 1]));
        let (mut own, mut tints) = (Vec::new(), Vec::new());
        prop_assert!(patch.bounds(DVec3::Z, DVec3::ZERO, |_| Default::default(), &mut own, &mut tints));
        for (a, b) in bounds.iter().zip(&own) {
            prop_assert!((a.low - b.low).abs().max_element() < 1e-9 && (a.high - b.high).abs().max_element() < 1e-9, "{a:?} {b:?}");
        }
    }

    /// Two vertices that become one elsewhere: no sampled place is farther, or of another colour, than told, and what old triangles have used up counts.
    #[test]
    fn no_place_of_a_patch_moves_farther_than_told(
        ring in nodes(10),
        inner in [(0.0f64..0.6, 0.0f64..6.3, -1.0f64..1.0), (0.0f64..0.6, 0.0f64..6.3, -1.0f64..1.0), (0.0f64..0.6, 0.0f64..6.3, -1.0f64..1.0)],
        split in 0.2f64..0.8,
        places in prop::collection::vec((0.0f64..1.0, 0.0f64..1.0), 60),
    ) {
        let n = ring.len();
        let s = ((split * n as f64) as usize).clamp(1, n - 1);
        let mut patch = Patch::default();
        patch.size = 3.0;
        patch.nodes.extend(ring.iter().enumerate().map(|(i, (radius, height, tint))| {
            let at = DVec2::from_angle(std::f64::consts::TAU * i as f64 / n as f64) * *radius;
            Node { at, height: *height, tint: DVec3::from_array(*tint) }
        }));
        patch.nodes.extend(inner.iter().map(|(radius, angle, height)| Node {
            at: DVec2::from_angle(*angle) * *radius, height: *height, tint: DVec3::splat(100.0 + 50.0 * height),
        }));
        let (u, v, p) = (n, n + 1, n + 2);
        patch.old.triangles.extend((0..n).map(|k| [if k < s { u } else { v }, k, (k + 1) % n]));
        patch.old.triangles.extend([[u, s, v], [v, 0, u]]);
        patch.old.inner.extend([u, v]);
        patch.new.triangles.extend((0..n).map(|k| [p, k, (k + 1) % n]));
        patch.new.inner.push(p);
        prop_assume!(patch.faces_up());
        // Each old triangle has a drift and a tint of its own.
        let used = |j: usize| {
            let way = DVec3::new(j as f64, 0.0, 0.0);
            (Drift { low: DVec3::ZERO, high: way }, Drift { low: -way, high: DVec3::ZERO })
        };
        let (mut bounds, mut tints) = (Vec::new(), Vec::new());
        prop_assert!(patch.bounds(DVec3::Z, DVec3::ZERO, used, &mut bounds, &mut tints));
        let mut found = 0;
        for (k, new) in patch.new.triangles.iter().enumerate() {
            let corners = new.map(|node| patch.nodes[node]);
            for &(s, t) in &places {
                let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
                let at = corners[0].at + (corners[1].at - corners[0].at) * s + (corners[2].at - corners[0].at) * t;
                let Some((height, tint)) = over(corners, at) else { continue };
                for (j, old) in patch.old.triangles.iter().enumerate() {
                    if let Some((before, tinted)) = over(old.map(|node| patch.nodes[node]), at) {
                        let (way, change) = (before - height, tinted - tint);
                        let Drift { low, high } = bounds[k];
                        prop_assert!(low.z - 1e-9 <= way && way <= high.z + 1e-9, "{way} beyond {low} {high}");
                        prop_assert!(high.x >= j as f64 - 1e-9);
                        let Drift { low, high } = tints[k];
                        let low = low + DVec3::new(j as f64, 0.0, 0.0);
                        prop_assert!(low.cmple(change + 1e-9).all() && change.cmple(high + 1e-9).all(), "{change} beyond {low} {high}");
                        found += 1;
                    }
                }
            }
        }
        prop_assert!(found >= places.len());
    }
}

#[test]
fn vertices_that_move_come_nearer_than_those_that_stay() {
    let shape = Shape { cells: [40, 40], closed: [true, true], waves: 0.5, noise: 0.0, turn: 0.3, seed: 1 };
    let mesh = shape.mesh();
    let most = mesh.triangles.len() as u64 / 8;
    let mean = |moves: bool| {
        let options = Options { tolerance: Some(1e3), most: Some(most), moves, ..WITHIN };
        let (left, figures) = mesh.simplified(&options, 1, 0, Precision::Single);
        assert!(figures.after <= most && figures.after * 10 > most * 9);
        let (fine, coarse) = (mesh.corners(), left.corners());
        let squares = fine.iter().map(|[a, b, c]| {
            let place = (*a + *b + *c) / 3.0;
            let nearest = coarse.iter().map(|t| distance(place, *t)).fold(f64::INFINITY, f64::min);
            nearest * nearest
        });
        (squares.sum::<f64>() / fine.len() as f64).sqrt()
    };
    let (moved, stayed) = (mean(true), mean(false));
    assert!(moved < 0.9 * stayed, "{moved} for {stayed}");
}

/// Where nothing is between, nothing is made up: classes and counts are those of a vertex that was there, measures lie between.
#[test]
fn attributes_lie_between_those_that_were_there() {
    let shape = Shape { cells: [30, 30], closed: [true, true], waves: 0.5, noise: 0.0, turn: 0.3, seed: 1 };
    let mesh = shape.mesh();
    let options = Options { tolerance: Some(0.5), most: Some(mesh.triangles.len() as u64 / 3), ..MOVED };
    let (left, _) = mesh.simplified(&options, 1, 0, Precision::Single);
    let there: BTreeSet<[u64; 3]> = mesh.vertices.iter().map(|v| v.map(f64::to_bits)).collect();
    let moved = left.vertices.iter().filter(|v| !there.contains(&v.map(f64::to_bits))).count();
    assert!(2 * moved > left.vertices.len(), "{moved} of {}", left.vertices.len());
    assert!(left.classes.iter().all(|class| *class <= 1));
    // Colours follow the places that they lie at: from one vertex to the next they change by 42 at the most.
    for (place, colour) in left.vertices.iter().zip(&left.colours) {
        let nearest = |v: &[f64; 3]| DVec3::from_array(*v).distance_squared(DVec3::from_array(*place));
        let near =
            (0..mesh.vertices.len()).min_by(|a, b| nearest(&mesh.vertices[*a]).total_cmp(&nearest(&mesh.vertices[*b])));
        let before = mesh.colours[near.unwrap()];
        assert!((0..3).all(|c| colour[c].abs_diff(before[c]) < 90), "{colour:?} for {before:?}");
    }
}
