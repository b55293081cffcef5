//! The sampling distance and the noise beside a naive twin, and on bodies whose noise is known.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

use proptest::prelude::*;

use super::density::Density;
use super::levels::{Known, Sketching};
use crate::points::bounds::Bounds;

fn bounds_of(points: &[[f64; 3]]) -> Bounds {
    points.iter().fold(Bounds::EMPTY, |bounds, p| bounds.union(Bounds { min: *p, max: *p }))
}

/// What blocks of points give that come in this order; `late` of them are at work at a time.
fn density(blocks: &[Vec<[f64; 3]>], records: Option<u64>, late: usize) -> Density {
    let (mut sketching, known) = (Sketching::new(records), Known::default());
    for at_work in blocks.chunks(late) {
        let levels: Vec<_> = at_work.iter().map(|points| known.levels_of(points, bounds_of(points))).collect();
        levels.into_iter().flatten().for_each(|levels| sketching.add(levels, &known));
    }
    let points = blocks.iter().map(|block| block.len() as u64).sum();
    Density::of(&sketching.finish(points), points)
}

mod naive {
    //! As docs/algorithm.md says, level by level, with all cells and all points held.

    use super::*;

    fn mixed(h: u64) -> u64 {
        let h = (h ^ h >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let h = (h ^ h >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        h ^ h >> 31
    }

    fn hash([a, b, c]: [u64; 3]) -> u64 {
        mixed(a.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ mixed(b.wrapping_mul(0xD6E8_FEB8_6659_FD93) ^ mixed(c)))
    }

    /// The power of two of level 0's cells.
    fn widest(bounds: &Bounds) -> i32 {
        let diagonal = 1.001 * bounds.extent().into_iter().fold(0.0, libm::hypot);
        let farthest = bounds.min.into_iter().chain(bounds.max).map(f64::abs).fold(0.0, f64::max);
        (-1000..).find(|e| 2f64.powi(*e) > diagonal && 2f64.powi(e + 40) > farthest).unwrap()
    }

    /// A cell of a level: its points' number and places.
    type Cells = BTreeMap<u64, (u64, BTreeSet<(u64, [u64; 3])>)>;

    fn cells(points: &[[f64; 3]], side: f64) -> Cells {
        let mut cells = Cells::new();
        for p in points {
            let [x, y, z] = p.map(|c| c / 3.0);
            let along = [2.0 * x - y + 2.0 * z, 2.0 * x + 2.0 * y - z, -x + 2.0 * y + 2.0 * z];
            let cell = cells.entry(hash(along.map(|c| (c / side).floor() as i64 as u64))).or_default();
            cell.0 += 1;
            let bits = p.map(|c| (c + 0.0).to_bits());
            cell.1.insert((hash(bits), bits));
        }
        cells
    }

    fn distinct(cells: &Cells) -> f64 {
        match cells.keys().nth(1023) {
            Some(last) => 1023.0 * (u64::MAX as f64 / *last as f64),
            None => cells.len() as f64,
        }
    }

    /// The sides of the levels that are looked at.
    pub fn sides(points: &[[f64; 3]]) -> Vec<f64> {
        let widest = widest(&bounds_of(points));
        let mut sides: Vec<f64> = Vec::new();
        for level in 0..20 {
            sides.push(2f64.powi(widest - level));
            if distinct(&cells(points, sides[level as usize])) > 0.25 * points.len() as f64 {
                break;
            }
        }
        sides
    }

    pub fn distance(points: &[[f64; 3]], sides: &[f64]) -> f64 {
        let n = points.len() as f64;
        let mut distance = 0.0;
        for &side in sides {
            let cells = cells(points, side);
            let distinct = distinct(&cells);
            let mut sizes: Vec<u64> = cells.into_values().map(|of| of.0).take(1024).collect();
            sizes.sort_unstable();
            let all: u64 = sizes.iter().sum();
            let middle = (0..sizes.len()).find(|i| 2 * sizes[..=*i].iter().sum::<u64>() >= all).unwrap();
            let least = sizes[middle].div_ceil(20);
            let left: Vec<u64> = sizes.iter().copied().filter(|size| *size >= least).collect();
            let points = left.iter().sum::<u64>() as f64 / all as f64 * n;
            let found = points / (left.len() as f64 / sizes.len() as f64 * distinct);
            let mut mean = found;
            (0..12).for_each(|_| mean = found * (1.0 - libm::exp(-mean)));
            distance = side / (1.2 * mean.max(found / 2.0)).sqrt();
            if found < 16.0 {
                break;
            }
        }
        distance
    }

    /// The lower quartile of the variances across the planes of cells.
    fn quartile(points: &[[f64; 3]], side: f64, distance: f64) -> Option<f64> {
        let telling: Vec<(u64, Vec<[f64; 3]>)> = cells(points, side)
            .into_values()
            .take(256)
            .map(|(count, places)| (count, places.into_iter().take(16).map(|(_, p)| p.map(f64::from_bits)).collect()))
            .collect();
        let least = (side / distance).powi(2) / 4.0;
        let of = telling.iter().filter(|(count, places)| *count as f64 >= least && places.len() >= 6);
        let mut variances: Vec<f64> = of.map(|(_, places)| variance(places)).collect();
        variances.sort_unstable_by(f64::total_cmp);
        (variances.len() >= 32).then(|| variances[variances.len() / 4])
    }

    /// The least mean square distance from a plane through the mean, over n - 3: by the directions of Jacobi's rotations.
    fn variance(places: &[[f64; 3]]) -> f64 {
        let n = places.len() as f64;
        let mean: [f64; 3] = std::array::from_fn(|a| places.iter().map(|p| p[a]).sum::<f64>() / n);
        let entry = |a: usize, b: usize| places.iter().map(|p| (p[a] - mean[a]) * (p[b] - mean[b])).sum::<f64>();
        let mut m: [[f64; 3]; 3] = std::array::from_fn(|a| std::array::from_fn(|b| entry(a, b)));
        for (p, q) in [(0, 1), (0, 2), (1, 2)].into_iter().cycle().take(60) {
            let angle = 0.5 * libm::atan2(2.0 * m[p][q], m[q][q] - m[p][p]);
            let (s, c) = (libm::sin(angle), libm::cos(angle));
            let old = m;
            for k in 0..3 {
                (m[p][k], m[q][k]) = (c * old[p][k] - s * old[q][k], s * old[p][k] + c * old[q][k]);
            }
            let old = m;
            for row in 0..3 {
                m[row][p] = c * old[row][p] - s * old[row][q];
                m[row][q] = s * old[row][p] + c * old[row][q];
            }
        }
        m[0][0].min(m[1][1]).min(m[2][2]).max(0.0) / (n - 3.0)
    }

    pub fn middle(points: &[[f64; 3]], sides: &[f64], distance: f64) -> Option<f64> {
        let side = *sides.iter().rfind(|side| **side > 4.0 * distance)?;
        let mut sizes: Vec<u64> = cells(points, side).into_values().map(|of| of.0).take(1024).collect();
        sizes.sort_unstable();
        (sizes.len() >= 32).then(|| side / (sizes[sizes.len() / 2] as f64 / 0.78).sqrt())
    }

    pub fn noise(points: &[[f64; 3]], sides: &[f64], distance: f64) -> Option<f64> {
        let level = sides.iter().rposition(|side| *side > 4.0 * distance)?;
        let of = |level: usize| quartile(points, sides[level], distance);
        let (narrow, wide) = (of(level)?, of(level.checked_sub(1)?)?);
        Some(((16.0 * narrow - wide).max(0.0) / 15.0).sqrt())
    }

    pub fn far_dimension(points: &[[f64; 3]], sides: &[f64], distance: f64) -> Option<f64> {
        let level = sides.iter().rposition(|side| *side > 4.0 * distance)?;
        let beside = |level: usize| {
            let counts: Vec<f64> = cells(points, sides[level]).into_values().map(|of| of.0 as f64).take(1024).collect();
            counts.iter().map(|c| c * c).sum::<f64>() / counts.iter().sum::<f64>()
        };
        Some(libm::log2(beside(level.checked_sub(1)?) / beside(level)))
    }

    pub fn near_dimension(points: &[[f64; 3]], sides: &[f64], distance: f64) -> Option<f64> {
        let side = *sides.iter().rfind(|side| **side > 2.0 * distance)?;
        let mut pairs = [0.0; 2];
        for (_, places) in cells(points, side).into_values().take(256) {
            let places: Vec<[f64; 3]> = places.into_iter().take(16).map(|(_, p)| p.map(f64::from_bits)).collect();
            for (p, q) in places.iter().flat_map(|p| places.iter().map(move |q| (p, q))).filter(|(p, q)| p != q) {
                let squared = (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) + (p[2] - q[2]).powi(2);
                for (pairs, far) in pairs.iter_mut().zip([0.4, 0.8]) {
                    *pairs += if squared <= (far * distance).powi(2) { 0.5 } else { 0.0 };
                }
            }
        }
        (pairs[0] >= 16.0).then(|| libm::log2(pairs[1] / pairs[0]))
    }
}

fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

fn shape(count: usize, seed: u64, shape: usize) -> Vec<[f64; 3]> {
    let mut unit = random(seed);
    (0..count)
        .map(|i| match shape {
            0 => [unit(), unit(), 0.0],
            1 => [unit(), unit(), unit()],
            // Nearly all on one place, and strays.
            2 if i % 50 > 0 => [0.5; 3],
            2 => [unit() * 1e3, unit(), unit()],
            // A line with piles on it.
            3 => [(unit() * 64.0).floor(), 0.0, 0.0],
            4 => [unit().powi(8), unit().powi(8), unit() * 1e-3],
            // Far from zero, and thick.
            _ => [5e6 + unit(), -3e5 + unit(), unit() * 0.003],
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    #[ignore = "exhaustive"]
    fn distance_and_noise_are_those_of_their_description(
        count in prop_oneof![1usize..200, 3000usize..6000, 60_000usize..61_000],
        kind in 0usize..6,
        scale in -30i32..30,
        seed in any::<u64>(),
        block in 1usize..20_000,
        late in 1usize..5,
        known in any::<bool>(),
        turned in any::<bool>(),
    ) {
        let points: Vec<[f64; 3]> = shape(count, seed, kind).iter().map(|p| p.map(|c| c * 2f64.powi(scale))).collect();
        // Small blocks of many points would take long.
        let mut blocks: Vec<Vec<[f64; 3]>> = points.chunks(block.max(count / 100)).map(<[_]>::to_vec).collect();
        if turned {
            blocks.reverse();
        }
        let found = density(&blocks, known.then_some(count as u64), late);
        let sides = naive::sides(&points);
        let distance = naive::distance(&points, &sides);
        prop_assert_eq!(found.distance.unwrap().to_bits(), distance.to_bits());
        prop_assert_eq!(found.middle.map(f64::to_bits), naive::middle(&points, &sides, distance).map(f64::to_bits));
        let noise = naive::noise(&points, &sides, distance);
        prop_assert_eq!(found.noise.is_some(), noise.is_some());
        let (a, b) = (found.noise.unwrap_or(0.0), noise.unwrap_or(0.0));
        // Roots of differences of what was found in two ways.
        prop_assert!((a * a - b * b).abs() <= 1e-9 * distance * distance, "{} {}", a, b);
        let [near, far] = [naive::near_dimension, naive::far_dimension].map(|of| of(&points, &sides, distance));
        prop_assert_eq!(found.near_dimension.map(f64::to_bits), near.map(f64::to_bits));
        prop_assert_eq!(found.far_dimension.map(f64::to_bits), far.map(f64::to_bits));
        // To the bit whatever the order.
        let sorted = {
            let mut points = points.clone();
            points.sort_unstable_by(|p, q| p.partial_cmp(q).unwrap());
            density(&[points], None, 1)
        };
        prop_assert_eq!(found, sorted);
    }
}

#[test]
fn a_single_place_and_no_extent_are_taken() {
    for place in [[0.0; 3], [1e300, -1e300, 7.0], [1e-300; 3], [-0.0, 5e-324, 0.0]] {
        let found = density(&[vec![place; 100]], None, 1);
        assert!(found.noise.is_none(), "{place:?}: {found:?}");
    }
}

/// Points of bodies of about one size, `noise` of them across the surface on average, and how far apart they are.
fn body(kind: &str, count: usize, noise: f64, seed: u64) -> (Vec<[f64; 3]>, f64) {
    let mut unit = random(seed);
    let mut normal = {
        let mut unit = random(seed ^ 0x55);
        move || (0..12).map(|_| unit()).sum::<f64>() - 6.0
    };
    let mut area = 0.0;
    let points = (0..count)
        .map(|_| {
            let more = noise * normal();
            let (u, v) = (unit(), unit());
            let (s, c) = (libm::sin(TAU * u), libm::cos(TAU * u));
            let p = match kind {
                "sphere" => {
                    area = 12.566;
                    let z = 2.0 * v - 1.0;
                    let r = (1.0 - z * z).sqrt();
                    [c * r, s * r, z].map(|x| x * (1.0 + more))
                }
                "pipe" => {
                    // Ten times as long as it is wide.
                    area = TAU * 0.2 * 2.0;
                    [(0.2 + more) * c, (0.2 + more) * s, 2.0 * v]
                }
                "block" => {
                    area = 6.0;
                    let place = [u, v, if unit() < 0.5 { more } else { 1.0 + more }];
                    let turn = (3.0 * unit()) as usize;
                    std::array::from_fn(|a| place[(a + turn) % 3])
                }
                _ => {
                    // Folds that are a tenth as deep as they are long.
                    area = 1.1;
                    [u, v, 0.01 * libm::sin(31.4 * u) * libm::cos(31.4 * v) + more]
                }
            };
            // Askew.
            let (x, y) = (0.8 * p[0] - 0.6 * p[1], 0.6 * p[0] + 0.8 * p[1]);
            [x, 0.96 * y - 0.28 * p[2], 0.28 * y + 0.96 * p[2]]
        })
        .collect();
    (points, (area / count as f64).sqrt())
}

#[test]
fn noise_is_told_from_what_is_bent() {
    for kind in ["sphere", "pipe", "block", "folds"] {
        for count in [50_000, 300_000] {
            for part in [0.0, 0.1, 0.2, 0.4] {
                let distance = body(kind, count, 0.0, 1).1;
                let (points, _) = body(kind, count, part * distance, 1);
                let found = density(&[points], None, 1);
                let told = found.noise.unwrap() / distance;
                let what = format!("{kind}, {count} points, noise of {part} sampling distances: {told}");
                if part == 0.0 {
                    assert!(told < 0.04, "{what}");
                } else {
                    assert!((0.65..1.2).contains(&(told / part)), "{what}");
                }
            }
        }
    }
}

#[test]
fn noise_fills_a_volume_and_fins_do_not() {
    let of = |points: Vec<[f64; 3]>| density(&[points], None, 1).near_dimension.unwrap();
    for kind in ["sphere", "pipe", "block", "folds"] {
        let distance = body(kind, 100_000, 0.0, 1).1;
        let noisy = |part: f64| of(body(kind, 100_000, part * distance, 1).0);
        assert!((1.4..2.0).contains(&noisy(0.0)), "{kind}: {}", noisy(0.0));
        for part in [0.7, 1.0, 2.0] {
            assert!((2.4..3.3).contains(&noisy(part)), "{kind}, {part}: {}", noisy(part));
        }
    }
    // Fins and slots: sheets so many sampling distances apart. A second layer is two of them.
    for (apart, sheets) in [(1.0, 40), (1.5, 40), (2.0, 40), (3.0, 40), (1.0, 2)] {
        let mut unit = random(2);
        let distance = (f64::from(sheets) / 100_000.0).sqrt();
        let sheet = |unit: &mut dyn FnMut() -> f64| (unit() * f64::from(sheets)).floor() * apart * distance;
        let points = (0..100_000)
            .map(|_| [unit(), unit(), sheet(&mut unit)])
            .map(|[x, y, z]| [x, 0.8 * y + 0.6 * z, 0.8 * z - 0.6 * y]);
        let told = of(points.collect());
        assert!((1.4..2.1).contains(&told), "{sheets} sheets, {apart} apart: {told}");
    }
}

/// Far from each other, points of a noisy surface fill a surface.
#[test]
fn a_filled_body_is_no_shell() {
    let of = |points: Vec<[f64; 3]>| density(&[points], None, 1).far_dimension.unwrap();
    for kind in ["sphere", "block"] {
        for part in [0.7, 1.5, 2.0, 3.0] {
            let distance = body(kind, 100_000, 0.0, 1).1;
            let told = of(body(kind, 100_000, part * distance, 1).0);
            assert!((1.9..2.5).contains(&told), "{kind}, {part}: {told}");
        }
    }
    let mut unit = random(3);
    for count in [20_000, 60_000, 200_000] {
        for side in [1.0, 1.2, 1.4, 1.7] {
            let cube = (0..count).map(|_| [(); 3].map(|()| side * unit())).collect::<Vec<_>>();
            let ball = (0..3 * count).map(|_| [(); 3].map(|()| side * (2.0 * unit() - 1.0)));
            let ball =
                ball.filter(|p| p.iter().map(|c| c * c).sum::<f64>() < side * side).take(count).collect::<Vec<_>>();
            for points in [cube, ball] {
                let askew = points.iter().map(|[x, y, z]| [0.8 * x - 0.6 * y, 0.6 * x + 0.8 * y, *z]).collect();
                let told = of(askew);
                assert!(told > 2.6, "{count} points, {side}: {told}");
            }
        }
    }
}

#[test]
fn the_middle_is_where_even_samples_lie_and_sparser_where_they_do_not() {
    for kind in ["sphere", "pipe", "block", "folds"] {
        let (points, _) = body(kind, 200_000, 0.0, 3);
        let of = |points: Vec<[f64; 3]>| {
            let found = density(&[points], None, 1);
            found.middle.unwrap() / found.distance.unwrap()
        };
        // One half keeps a part of its points only.
        let thinned = |every: usize| {
            points.iter().enumerate().filter(|(i, p)| p[0] > 0.1 || i % every == 0).map(|(_, p)| *p).collect()
        };
        let told = [of(points.clone()), of(thinned(10)), of(thinned(50))];
        assert!((0.9..1.12).contains(&told[0]), "{kind}: {told:?}");
        assert!(told[1] > 1.3 && told[2] > 1.1, "{kind}: {told:?}");
    }
}
