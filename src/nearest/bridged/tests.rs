//! The mesh written anew, against a naive twin that holds it whole.

use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;

use crate::mesh::MeshSource;
use crate::mesh::check::check;
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::nearest::bridged::distances::Distances;
use crate::nearest::bridged::schema::BRIDGED;
use crate::nearest::bridged::{Bridging, Rewritten, rewritten, with_bridged};
use crate::nearest::room::Room;
use crate::nearest::testing::with_room;
use crate::points::Precision;
use crate::points::attribute::{Attribute, Schema};
use crate::points::scalar::Scalar;

/// A mesh as lists.
#[derive(Debug, Clone, PartialEq, Default)]
struct Lists {
    places: Vec<[f64; 3]>,
    /// A byte of each vertex, as its attribute.
    bytes: Vec<u8>,
    distances: Vec<f32>,
    faces: Vec<[u32; 3]>,
}

/// A net of `u` by `v` squares, joined at its ends to a torus or not; the squares' diagonals as `turned` says, again and again.
fn net([u, v]: [u32; 2], joined: bool, turned: &[bool]) -> Vec<[u32; 3]> {
    let at = |i: u32, j: u32| (i % u) * v + j % v;
    let rows = if joined { [u, v] } else { [u - 1, v - 1] };
    let squares = (0..rows[0]).flat_map(|i| (0..rows[1]).map(move |j| [i, j]));
    let pair = |(number, [i, j]): (usize, [u32; 2])| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        if turned[number % turned.len()] { [[a, b, d], [b, c, d]] } else { [[a, b, c], [a, c, d]] }
    };
    squares.enumerate().flat_map(pair).collect()
}

/// The twin: rounds over maps.
fn naive(mesh: &Lists, trim: f64) -> Lists {
    let mut gone: BTreeSet<u32> =
        (0..).zip(&mesh.distances).filter(|(_, d)| f64::from(**d) > trim).map(|(v, _)| v).collect();
    let left = loop {
        let left: Vec<[u32; 3]> = mesh.faces.iter().filter(|f| f.iter().all(|v| !gone.contains(v))).copied().collect();
        // Of each vertex, from which other vertex a triangle leads to which.
        let mut round: BTreeMap<u32, BTreeMap<u32, u32>> = BTreeMap::new();
        for [a, b, c] in &left {
            for [at, from, to] in [[a, b, c], [b, c, a], [c, a, b]] {
                assert!(round.entry(*at).or_default().insert(*from, *to).is_none());
            }
        }
        let pinched = |steps: &BTreeMap<u32, u32>| {
            let begin = steps.keys().find(|from| steps.values().all(|to| to != *from)).or(steps.keys().next());
            let mut at = *begin.unwrap();
            let mut walked = BTreeSet::new();
            while let Some(to) = steps.get(&at).filter(|_| walked.insert(at)) {
                at = *to;
            }
            walked.len() < steps.len()
        };
        let more: Vec<u32> = round.iter().filter(|(_, steps)| pinched(steps)).map(|(v, _)| *v).collect();
        if more.is_empty() {
            break left;
        }
        gone.extend(more);
    };
    // With nothing to go, vertices that no triangle names stay.
    let named: BTreeSet<u32> = left.iter().flatten().copied().collect();
    let lost = |v: &u32| mesh.faces.iter().any(|f| f.contains(v));
    let stay: Vec<u32> =
        (0..mesh.places.len() as u32).filter(|v| named.contains(v) || (!gone.contains(v) && !lost(v))).collect();
    let number: BTreeMap<u32, u32> = stay.iter().copied().zip(0..).collect();
    Lists {
        places: stay.iter().map(|v| mesh.places[*v as usize]).collect(),
        bytes: stay.iter().map(|v| mesh.bytes[*v as usize]).collect(),
        distances: stay.iter().map(|v| mesh.distances[*v as usize]).collect(),
        faces: left.iter().map(|f| f.map(|v| number[&v])).collect(),
    }
}

fn spooled(mesh: &Lists, room: &Room) -> MeshSpool {
    let schema = Schema::new(vec![Attribute::new("intensity", Scalar::U8)]);
    let mut out = MeshSpool::with_attributes(room.workspace, Precision::Double, schema, 0);
    out.append_vertices(&mesh.places).unwrap();
    out.append_attributes(&mesh.bytes).unwrap();
    out.append_faces(&mesh.faces.iter().map(|f| FaceRecord::new(*f)).collect::<Vec<_>>()).unwrap();
    out
}

fn lists(mesh: &MeshSpool, carried: bool) -> Lists {
    let count = mesh.vertex_count() as usize;
    let mut out =
        Lists { places: vec![[0.0; 3]; count], faces: vec![[0; 3]; mesh.face_count() as usize], ..Lists::default() };
    mesh.read_vertices(0, &mut out.places).unwrap();
    mesh.read_faces(0, &mut out.faces).unwrap();
    let mut values = vec![0.0; count];
    mesh.read_attribute(0, 0, &mut values).unwrap();
    out.bytes = values.iter().map(|value| *value as u8).collect();
    if carried {
        mesh.read_attribute(1, 0, &mut values).unwrap();
        out.distances = values.iter().map(|value| *value as f32).collect();
    }
    out
}

proptest! {
    #[test]
    fn what_is_left_is_what_the_twin_leaves_in_any_room(
        sides in [3u32..12, 3u32..9],
        joined: bool,
        turned in prop::collection::vec(any::<bool>(), 1..9),
        far in prop::collection::vec(0u8..10, 30),
        share in 0u8..6,
        shift in 0u32..40,
        tiny: bool,
        carried: bool,
    ) {
        let count = sides[0] * sides[1];
        let mut faces = net(sides, joined, &turned);
        // Numbers that do not follow the net, so that ranges cut it up.
        let renumbered = |v: u32| (v + shift) % count;
        faces.iter_mut().for_each(|f| *f = f.map(renumbered));
        let mesh = Lists {
            places: (0..count).map(|v| [f64::from(v / sides[1]), f64::from(v % sides[1]), 0.5]).collect(),
            bytes: (0..count).map(|v| v as u8).collect(),
            distances: (0..count as usize).map(|v| if far[v % far.len()] < share { 2.5 } else { 0.25 }).collect(),
            faces,
        };
        with_room(2, |room| {
            let room = if tiny { Room { corners: 60, kept: 0, pages: 0, ..room } } else { room };
            let asked = Bridging { carried, trim: Some(1.0), reach: 0.2 };
            let found = Distances::of(&mesh.distances, &room);
            let Rewritten { mesh: made, left_out, bridged_area } = rewritten(&spooled(&mesh, &room), &found, asked, &room).unwrap();
            let mut expected = naive(&mesh, 1.0);
            prop_assert_eq!(left_out as usize, mesh.faces.len() - expected.faces.len());
            if !carried {
                expected.distances.clear();
            }
            prop_assert_eq!(&lists(&made, carried), &expected);
            let report = check(&made, 1 << 24, room.workers, room.workspace, &mut |_| ()).unwrap();
            prop_assert!(expected.faces.is_empty() || report.is_sound(true), "{}", report);
            // All that is left is farther than the reach.
            prop_assert_eq!(bridged_area, report.area);
            Ok(())
        })?;
    }
}

#[test]
fn a_vertex_of_two_fans_goes_with_them() {
    // Two far vertices on opposite sides of the middle of a net leave it two fans.
    let mut mesh = Lists {
        places: (0..9).map(|v| [f64::from(v / 3), f64::from(v % 3), 0.0]).collect(),
        bytes: vec![7; 9],
        distances: vec![0.0; 9],
        faces: net([3, 3], false, &[false]),
    };
    mesh.distances[1] = 2.0;
    mesh.distances[7] = 2.0;
    with_room(1, |room| {
        let left = |trim: f64| {
            let asked = Bridging { carried: true, trim: Some(trim), reach: 9.0 };
            let found = Distances::of(&mesh.distances, &room);
            lists(&rewritten(&spooled(&mesh, &room), &found, asked, &room).unwrap().mesh, true)
        };
        assert_eq!(left(1.0), Lists::default());
        assert_eq!(left(2.0), mesh);
    });
}

#[test]
fn an_attribute_of_that_name_is_refused() {
    let schema = with_bridged(&Schema::default()).unwrap();
    assert_eq!(schema.attributes()[0].name, BRIDGED);
    assert!(with_bridged(&schema).unwrap_err().to_string().contains("`bridged`"));
}
