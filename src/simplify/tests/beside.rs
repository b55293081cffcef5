//! What is skipped or found early, against what finds it the long way.

use super::*;
use crate::mesh::intersect::intersect;
use crate::simplify::piece::Piece;
use crate::simplify::sight::Sight;

/// A ring round the origin, at even angles.
fn ring(heights: &[f64], radii: &[f64]) -> Vec<DVec3> {
    let place = |(i, (height, radius)): (usize, (&f64, &f64))| {
        let angle = std::f64::consts::TAU * i as f64 / heights.len() as f64;
        DVec3::new(radius * angle.cos(), radius * angle.sin(), *height)
    };
    heights.iter().zip(radii).enumerate().map(place).collect()
}

/// Looks at the triangles from a ring's first vertex and at some that are there, all between `places`, of which the first `n` are the ring. Whether each two are told
/// to lie beside each other, and whether they intersect.
fn told(places: &[DVec3], n: usize, there: &[[u32; 3]]) -> Vec<(bool, bool)> {
    let numbers = (0..places.len() as u32).collect();
    let piece = Piece::new(places.to_vec(), numbers, there.to_vec(), vec![Drift::NONE; there.len()]);
    let corners: Vec<(u32, DVec3)> = (0..n).map(|v| (v as u32, places[v])).collect();
    let fresh: Vec<[usize; 3]> = (1..n - 1).map(|k| [0, k, k + 1]).collect();
    let mut sight = Sight::new(places.len());
    // Seen a second time, nothing is left of the first.
    for axes in [(DVec3::Y, DVec3::Z), (DVec3::X, DVec3::Y)] {
        sight.look((&corners, n), fresh.iter().copied(), DVec3::ZERO, axes);
        there.iter().for_each(|corners| {
            sight.beyond(*corners, |v| piece.position(v));
        });
    }
    let mut found = Vec::new();
    for corners in there {
        let beyond = sight.beyond(*corners, |v| piece.position(v));
        for (number, one) in fresh.iter().enumerate() {
            let of_there = corners.map(|v| places[v as usize].to_array());
            let meets = intersect(one.map(|v| v as u32), one.map(|v| places[v].to_array()), *corners, of_there);
            found.push((sight.is_beside(number, beyond), meets));
        }
    }
    found
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Triangles all over, between vertices of the ring and others. Coordinates on a grid, so that places lie on lines and on each other.
    #[test]
    fn what_lies_beside_does_not_intersect(
        radii in prop::collection::vec(1u8..4, 3..10),
        others in prop::collection::vec([-8i8..8, -8i8..8, -2i8..2], 3..12),
        picks in prop::collection::vec([any::<prop::sample::Index>(), any::<prop::sample::Index>(), any::<prop::sample::Index>()], 1..40),
        grid in any::<bool>(),
    ) {
        let n = radii.len();
        let radii: Vec<f64> = radii.into_iter().map(f64::from).collect();
        let heights: Vec<f64> = radii.iter().map(|radius| 0.3 * radius).collect();
        let mut places = ring(&heights, &radii);
        if grid {
            places.iter_mut().for_each(|place| *place = place.round());
        }
        places.extend(others.iter().map(|place| DVec3::from_array(place.map(f64::from))));
        let there: Vec<[u32; 3]> = picks.iter().map(|corners| corners.map(|index| index.index(places.len()) as u32)).collect();
        let there: Vec<[u32; 3]> = there.into_iter().filter(|[a, b, c]| a != b && b != c && c != a).collect();
        for (beside, meets) in told(&places, n, &there) {
            prop_assert!(!(beside && meets));
        }
    }

    /// Where the ring bends nowhere inwards, no triangle that lies outside, or on a side of it, is left to the exact test.
    #[test]
    fn what_lies_outside_a_convex_ring_is_told(heights in prop::collection::vec(-0.5f64..0.5, 4..12)) {
        let n = heights.len();
        let mut places = ring(&heights, &vec![1.0; n]);
        places.extend(ring(&heights, &vec![3.0; n]));
        let beside = |v: usize| [v, (v + 1) % n, n + v].map(|v| v as u32);
        let apart = |v: usize| [v, n + (v + n - 1) % n, n + v].map(|v| v as u32);
        let there: Vec<[u32; 3]> = (0..n).flat_map(|v| [beside(v), apart(v)]).collect();
        for (beside, meets) in told(&places, n, &there) {
            prop_assert!(beside && !meets);
        }
    }

    /// A bound that is given up early is one beyond the tolerance.
    #[test]
    fn bounds_are_given_up_only_beyond_the_tolerance(
        heights in prop::collection::vec(-1.0f64..1.0, 3..9),
        radii in prop::collection::vec(0.3f64..2.0, 9),
        drifts in prop::collection::vec([0.0f64..0.3, 0.0..0.3, 0.0..0.3, 0.0..0.3], 9),
        tolerance in 0.0f64..1.5,
        to in any::<prop::sample::Index>(),
    ) {
        let ring = ring(&heights, &radii);
        let to = to.index(ring.len());
        let drift = |j: usize| {
            let [a, b, c, d] = drifts[j];
            Drift { low: DVec3::new(-a, -b, -c), high: DVec3::new(d, a, b) }
        };
        let mut overlay = Overlay::default();
        overlay.look_at(DVec3::Z, ring.iter().copied(), true);
        let covers = overlay.turn(to);
        let (mut early, mut whole) = (Vec::new(), Vec::new());
        let told = covers && overlay.bounds(DVec3::Z, tolerance, drift, &mut early);
        // The ring as it is read from that vertex on.
        let turned: Vec<DVec3> = (0..ring.len()).map(|k| ring[(to + k) % ring.len()]).collect();
        prop_assert_eq!(overlay.look(DVec3::Z, turned.into_iter(), true), covers);
        prop_assume!(covers);
        prop_assert!(overlay.bounds(DVec3::Z, f64::INFINITY, drift, &mut whole));
        if told {
            prop_assert_eq!(early, whole);
        } else {
            prop_assert!(whole.iter().any(|bound| bound.most() > tolerance));
        }
    }
}
