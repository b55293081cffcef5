use std::f64::consts::PI;

use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng};
use rand::RngExt;

use super::sums::{Bins, LANES, Terms, Vector, bin_of, gradient, lanes, pull, winding};
use super::*;

fn numbers(seed: u64) -> TestRng {
    let mut bytes = [7; 32];
    bytes[..8].copy_from_slice(&seed.to_le_bytes());
    TestRng::from_seed(RngAlgorithm::ChaCha, &bytes)
}

/// A direction, evenly distributed.
fn direction(numbers: &mut TestRng) -> [f64; 3] {
    let (z, angle) = (numbers.random_range(-1.0..1.0f64), numbers.random_range(0.0..2.0 * PI));
    let round = (1.0 - z * z).sqrt();
    [round * angle.cos(), round * angle.sin(), z]
}

/// Three directions at right angles.
fn axes(numbers: &mut TestRng) -> [[f64; 3]; 3] {
    let (a, other) = (direction(numbers), direction(numbers));
    let along: f64 = (0..3).map(|i| a[i] * other[i]).sum();
    let b: [f64; 3] = std::array::from_fn(|i| other[i] - along * a[i]);
    let length = b.iter().map(|c| c * c).sum::<f64>().sqrt();
    let b = b.map(|c| c / length);
    [a, b, crate::points::vector::cross(a, b)]
}

fn turned(points: &mut [[f64; 3]], axes: &[[f64; 3]; 3]) {
    points.iter_mut().for_each(|p| *p = std::array::from_fn(|i| (0..3).map(|a| p[a] * axes[a][i]).sum()));
}

fn ordered(points: &mut [[f64; 3]]) {
    points.sort_by(|p, q| p[0].total_cmp(&q[0]).then(p[1].total_cmp(&q[1])).then(p[2].total_cmp(&q[2])));
}

fn sphere(count: usize, radius: f64, numbers: &mut TestRng) -> Vec<[f64; 3]> {
    (0..count).map(|_| direction(numbers).map(|c| radius * c)).collect()
}

fn torus(count: usize, tube: f64, numbers: &mut TestRng) -> Vec<[f64; 3]> {
    let mut points = Vec::new();
    while points.len() < count {
        let (round, along) = (numbers.random_range(0.0..2.0 * PI), numbers.random_range(0.0..2.0 * PI));
        let far = 1.0 + tube * round.cos();
        // Outside there is more of it.
        if numbers.random_range(0.0..1.0 + tube) < far {
            points.push([far * along.cos(), far * along.sin(), tube * round.sin()]);
        }
    }
    points
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn sums_are_those_of_all_terms(seed in any::<u64>(), count in 60usize..400) {
        let mut numbers = numbers(seed);
        let mut any = |size: f32| -> Vector { std::array::from_fn(|_| numbers.random_range(-size..size)) };
        let points: Vec<Vector> = (0..count).map(|_| any(15.0)).collect();
        let dipoles: Vec<Vector> = (0..count).map(|_| any(1.0)).collect();
        let (bins, order) = Bins::of(&points);
        let values: Vec<Vector> = order.iter().map(|i| dipoles[*i]).collect();
        prop_assert!(bins.points.iter().zip(&order).all(|(p, i)| *p == points[*i]));
        let (far, width) = (bins.far(&values), 0.5f32);
        let mut terms = Terms::default();
        for bin in 0..bins.len() {
            prop_assert!(bins.range(bin).all(|i| bin_of(bins.points[i]) == bins.key(bin)));
            bins.terms(bins.key(bin), &values, &far, &mut terms);
            let here: Vec<Vector> = bins.points[bins.range(bin)].iter().take(LANES).copied().collect();
            let at = lanes(&here);
            let sums = (winding(&at, &terms, width), gradient(&at, &terms, width), pull(&at, &terms, width));
            for (lane, place) in here.iter().enumerate() {
                // Point by point, in double precision.
                let (mut w, mut g, mut q, mut size) = (0.0f64, [0.0f64; 3], [0.0f64; 3], [0.0f64; 2]);
                for (p, v) in bins.points.iter().zip(&values) {
                    let e: [f64; 3] = std::array::from_fn(|a| f64::from(p[a]) - f64::from(place[a]));
                    let v = v.map(f64::from);
                    let distance = e.iter().map(|c| c * c).sum::<f64>().sqrt();
                    let r = distance.max(f64::from(width));
                    let along: f64 = (0..3).map(|a| v[a] * e[a]).sum();
                    w += along / (4.0 * PI * r.powi(3));
                    size[0] += 3.0 * r.powi(-2) / (4.0 * PI);
                    size[1] += 6.0 * r.powi(-3);
                    for a in 0..3 {
                        let far = if distance > f64::from(width) { 3.0 * along * e[a] / r.powi(5) } else { 0.0 };
                        g[a] += v[a] / r.powi(3) - far;
                        q[a] -= v[0] * e[a] / (4.0 * PI * r.powi(3));
                    }
                }
                // What is far stands for each bin at its middle: an error of some hundredths of what it could come to.
                prop_assert!((f64::from(sums.0[lane]) - w).abs() < 0.02 * size[0], "{} {w}", sums.0[lane]);
                for a in 0..3 {
                    prop_assert!((f64::from(sums.1[a][lane]) - g[a]).abs() < 0.02 * size[1]);
                    prop_assert!((f64::from(sums.2[a][lane]) - q[a]).abs() < 0.02 * size[0]);
                }
            }
        }
    }
}

fn found(points: &[[f64; 3]]) -> Option<Told> {
    surface_of(points, &Workers::new(2).unwrap()).unwrap()
}

/// The distance of a place from the nearest of others.
fn far(place: &[f64; 3], from: &[[f64; 3]]) -> f64 {
    let squared = |p: &[f64; 3]| (0..3).map(|a| (p[a] - place[a]).powi(2)).sum::<f64>();
    from.iter().map(squared).fold(f64::INFINITY, f64::min).sqrt()
}

#[test]
fn spheres_and_tori_are_told_from_few_points() {
    for seed in 0..3u64 {
        let mut numbers = numbers(seed);
        let axes = axes(&mut numbers);
        let count = numbers.random_range(250..450usize);
        let inner = numbers.random_range(0.4..0.6);
        let mut two = sphere(count, 1.0, &mut numbers);
        two.extend(sphere((count as f64 * inner * inner) as usize, inner, &mut numbers));
        // A sphere; a torus; a sphere in a sphere, whose Euler number is that of the wall.
        for (mut points, expected) in
            [(sphere(count, 1.0, &mut numbers), 1), (torus(count, 0.35, &mut numbers), 0), (two, 2)]
        {
            turned(&mut points, &axes);
            let offset = [1e5, -3e4, 7.0];
            points.iter_mut().for_each(|p| (0..3).for_each(|a| p[a] += offset[a]));
            ordered(&mut points);
            if seed == 0 {
                let others = surface_of(&points, &Workers::new(3).unwrap()).unwrap();
                assert_eq!(found(&points), others, "threads show");
            }
            let told = found(&points).unwrap_or_else(|| panic!("seed {seed}, Euler number {expected}: nothing"));
            assert_eq!((told.characteristic, told.is_steady), (expected, true), "seed {seed}");
            let [first, .., last] = told.sampled.as_slice() else { panic!("seed {seed}") };
            assert!(first.places.len() > 4 * points.len() && last.places.len() > 8 * points.len(), "seed {seed}");
            // The nearest point is that, and none is far.
            let spacing = (4.0 * PI / count as f64).sqrt();
            for (place, nearest) in last.places.iter().zip(&last.nearest) {
                let least = far(place, &points);
                assert!((far(place, &points[*nearest..=*nearest]) - least).abs() < 1e-4, "seed {seed}");
                assert!(least < 3.0 * spacing, "seed {seed}: {least} of {spacing}");
            }
            if expected == 1 {
                let off = |p: &[f64; 3]| ((0..3).map(|a| (p[a] - offset[a]).powi(2)).sum::<f64>().sqrt() - 1.0).abs();
                let mean = last.places.iter().map(off).sum::<f64>() / last.places.len() as f64;
                assert!(mean < 0.1 * spacing, "seed {seed}: {mean} of {spacing}");
            }
        }
    }
}

#[test]
fn what_has_no_inside_is_not_told() {
    for seed in 0..3u64 {
        let mut numbers = numbers(100 + seed);
        let axes = axes(&mut numbers);
        let count = numbers.random_range(250..450usize);
        let flat: Vec<[f64; 3]> =
            (0..count).map(|_| [numbers.random_range(-1.0..1.0), numbers.random_range(-1.0..1.0), 0.0]).collect();
        let half: Vec<[f64; 3]> = sphere(2 * count, 1.0, &mut numbers).into_iter().filter(|p| p[2] < 0.0).collect();
        let cloud: Vec<[f64; 3]> =
            (0..count).map(|_| std::array::from_fn(|_| numbers.random_range(-1.0..1.0))).collect();
        let line: Vec<[f64; 3]> = (0..count).map(|i| [i as f64, 0.0, 0.0]).collect();
        let place = vec![[0.5; 3]; count];
        for (what, mut points) in [("flat", flat), ("half", half), ("cloud", cloud), ("line", line), ("place", place)] {
            turned(&mut points, &axes);
            ordered(&mut points);
            assert_eq!(found(&points), None, "seed {seed}: {what}");
        }
    }
}

/// The blocks that are looked at, and what is taken of the others, give the Euler number of all vertices of the lattice, each with the sum over all points.
#[test]
fn the_lattice_has_the_euler_number_of_all_its_vertices() {
    use super::dipoles::Dipoles;
    use super::lattice::{EDGE, look};

    for seed in 0..4u64 {
        let mut numbers = numbers(200 + seed);
        let mut points = if seed % 2 == 0 { sphere(120, 3.0, &mut numbers) } else { torus(200, 0.35, &mut numbers) };
        if seed % 2 == 1 {
            points.as_flattened_mut().iter_mut().for_each(|c| *c *= 3.5);
        }
        turned(&mut points, &axes(&mut numbers));
        let points: Vec<Vector> = points.iter().map(|p| p.map(|c| c as f32)).collect();
        let workers = Workers::new(2).unwrap();
        let dipoles = Dipoles::find(Bins::of(&points).0, &workers).unwrap();
        let shown = look(&dipoles, &[0.45], &workers).unwrap().unwrap();
        let vertex = |c: f64| (c / f64::from(EDGE)).floor() as i32;
        let bound = |a: usize, up: f64| {
            points
                .iter()
                .map(|p| vertex(f64::from(p[a]) + up))
                .reduce(|x, y| if up > 0.0 { x.max(y) } else { x.min(y) })
                .unwrap()
        };
        let (low, high) = ([0, 1, 2].map(|a| bound(a, -2.0)), [0, 1, 2].map(|a| bound(a, 2.0)));
        for (which, width) in [0.4f64, 0.7].into_iter().enumerate() {
            let inside = |x: i32, y: i32, z: i32| {
                let at = [x, y, z].map(|c| f64::from(c) * f64::from(EDGE));
                let of_point = |(p, v): (&Vector, &Vector)| {
                    let e: [f64; 3] = std::array::from_fn(|a| f64::from(p[a]) - at[a]);
                    let r = e.iter().map(|c| c * c).sum::<f64>().sqrt().max(width);
                    (0..3).map(|a| f64::from(v[a]) * e[a]).sum::<f64>() / (4.0 * PI * r.powi(3))
                };
                dipoles.bins.points.iter().zip(&dipoles.values).map(of_point).sum::<f64>() > 0.5
            };
            let all = (low[2]..=high[2])
                .flat_map(|z| (low[1]..=high[1]).flat_map(move |y| (low[0]..=high[0]).map(move |x| [x, y, z])));
            let set: std::collections::BTreeSet<[i32; 3]> = all.filter(|[x, y, z]| inside(*x, *y, *z)).collect();
            let mut expected = 0i64;
            for at in &set {
                for sides in 0..8u32 {
                    let corner = |i: u32| set.contains(&std::array::from_fn(|a| at[a] + (i >> a & 1) as i32));
                    if (0..8u32).filter(|i| i & !sides == 0).all(corner) {
                        expected += 1 - 2 * i64::from(sides.count_ones() % 2);
                    }
                }
            }
            assert_eq!(shown.characteristic[which], expected, "seed {seed}, width {width}");
        }
    }
}
