//! Cases by name, and a naive twin: what two triangles share, cut out in exact fractions.

use proptest::prelude::*;

use super::*;

type Corner = [i64; 3];

/// Both ways round and from every vertex, either triangle first: one answer.
fn agreed(a: [u32; 3], pa: [Point; 3], b: [u32; 3], pb: [Point; 3]) -> bool {
    let orders = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    let answer = intersect(a, pa, b, pb);
    for i in orders {
        for j in orders {
            let (a, pa, b, pb) = (i.map(|i| a[i]), i.map(|i| pa[i]), j.map(|j| b[j]), j.map(|j| pb[j]));
            assert_eq!(intersect(a, pa, b, pb), answer, "{a:?} {pa:?} {b:?} {pb:?}");
            assert_eq!(intersect(b, pb, a, pa), answer, "{a:?} {pa:?} {b:?} {pb:?} swapped");
        }
    }
    answer
}

/// Triangles that share the vertices whose positions are given as one in `shared`: the first so many of each.
fn meet(shared: usize, a: [Corner; 3], b: [Corner; 3]) -> bool {
    let numbers = [0, 1, 2].map(|i: u32| if (i as usize) < shared { i } else { i + 3 });
    let point = |p: Corner| p.map(|c| c as f64);
    assert_eq!(a[..shared], b[..shared]);
    let answer = agreed([0, 1, 2], a.map(point), numbers, b.map(point));
    assert_eq!(answer, naive([0, 1, 2], a, numbers, b), "the naive twin");
    answer
}

const FLAT: [Corner; 3] = [[0, 0, 0], [4, 0, 0], [0, 4, 0]];

#[test]
fn nothing_shared() {
    assert!(meet(0, FLAT, [[1, 1, -1], [1, 1, 1], [9, 9, 1]]), "pierced within");
    assert!(!meet(0, FLAT, [[3, 3, -1], [3, 3, 1], [9, 9, 1]]), "passes by");
    assert!(!meet(0, FLAT, [[0, 0, 1], [4, 0, 1], [0, 4, 1]]), "parallel");
    assert!(meet(0, FLAT, [[1, 1, 0], [1, 1, 5], [2, 1, 5]]), "a corner touches within");
    assert!(meet(0, FLAT, [[2, 2, 0], [2, 2, 5], [2, 3, 5]]), "a corner touches a side");
    assert!(meet(0, FLAT, [[4, 0, 0], [4, 0, 5], [9, 1, 5]]), "corners of one position and two numbers");
    assert!(meet(0, FLAT, [[2, -1, -1], [2, 1, 1], [9, -9, 0]]), "side crosses side");
    assert!(meet(0, FLAT, FLAT), "the same place by other numbers");
}

#[test]
fn in_one_plane() {
    assert!(meet(0, FLAT, [[1, 1, 0], [2, 1, 0], [1, 2, 0]]), "one within the other");
    assert!(meet(0, FLAT, [[-1, 1, 0], [5, 1, 0], [5, 2, 0]]), "sides cross");
    assert!(meet(0, FLAT, [[-9, 1, 0], [9, 1, 0], [0, 9, 0]]), "no corner in the other");
    assert!(meet(0, FLAT, [[1, 0, 0], [3, 0, 0], [2, -5, 0]]), "sides lie on each other");
    assert!(!meet(0, FLAT, [[4, 4, 0], [4, 1, 0], [1, 4, 0]]), "side by side");
    assert!(!meet(0, FLAT, [[5, 0, 0], [9, 0, 0], [9, 5, 0]]), "on one line, apart");
}

#[test]
fn one_vertex_shared() {
    assert!(!meet(1, FLAT, [[0, 0, 0], [1, 1, 3], [2, 1, 3]]), "the vertex and no more");
    assert!(!meet(1, FLAT, [[0, 0, 0], [-4, 0, 0], [0, -4, 0]]), "in one plane, opposite");
    assert!(meet(1, FLAT, [[0, 0, 0], [2, 1, -1], [2, 1, 1]]), "a blade through the vertex");
    assert!(meet(1, FLAT, [[0, 0, 0], [9, 9, 0], [9, 9, 5]]), "stands on it, beyond the opposite side");
    assert!(meet(1, FLAT, [[0, 0, 0], [1, 1, 0], [0, 0, 5]]), "stands on it, within");
    assert!(meet(1, FLAT, [[0, 0, 0], [2, 0, 0], [3, -1, 0]]), "sides from the vertex lie on each other");
    assert!(meet(1, FLAT, [[0, 0, 0], [1, 1, 0], [-1, 2, 0]]), "overlap in one plane");
}

#[test]
fn an_edge_shared() {
    assert!(!meet(2, FLAT, [[0, 0, 0], [4, 0, 0], [0, 4, 1]]), "a sharp fold");
    assert!(!meet(2, FLAT, [[0, 0, 0], [4, 0, 0], [1, -4, 0]]), "flat");
    assert!(meet(2, FLAT, [[0, 0, 0], [4, 0, 0], [1, 9, 0]]), "folded flat onto each other");
    assert!(meet(2, FLAT, [[0, 0, 0], [4, 0, 0], [0, 4, 0]]), "of equal corners");
    assert!(meet(3, FLAT, FLAT), "the same triangle");
}

#[test]
fn triangles_without_area() {
    let line = [[1, 1, -1], [1, 1, 0], [1, 1, 1]];
    assert!(meet(0, FLAT, line), "a line through");
    assert!(meet(0, FLAT, [[1, 1, 0]; 3]) && !meet(0, FLAT, [[1, 1, 1]; 3]), "a point in and off");
    assert!(meet(0, line, line) && meet(0, [[1, 1, 1]; 3], [[1, 1, 1]; 3]), "on each other");
    assert!(!meet(0, line, [[1, 1, 2], [1, 1, 3], [1, 1, 4]]), "on one line, apart");
    assert!(!meet(1, FLAT, [[0, 0, 0], [0, 0, 3], [0, 0, -3]]), "a line through the shared vertex");
    assert!(!meet(1, FLAT, [[0, 0, 0], [0, 0, 0], [0, 0, 3]]), "a corner on the shared vertex");
    assert!(meet(1, FLAT, [[0, 0, 0], [1, 1, 0], [-1, -1, 0]]), "a line in the plane");
    assert!(!meet(1, [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 0, 0], [-1, 0, 0], [-2, 0, 0]]), "lines, opposite");
    assert!(meet(1, [[0, 0, 0], [1, 0, 0], [-1, 0, 0]], [[0, 0, 0], [3, 0, 0], [4, 0, 0]]), "lines, overlapping");
    let edge = [[0, 0, 0], [2, 0, 0]];
    let with = |x| [edge[0], edge[1], [x, 0, 0]];
    assert!(meet(2, with(3), with(4)) && !meet(2, with(3), with(-1)) && !meet(2, with(1), with(5)), "along the edge");
    let point = |c| [[0, 0, 0], [0, 0, 0], c];
    assert!(!meet(2, point([1, 0, 0]), point([0, 1, 0])) && meet(2, point([1, 0, 0]), point([3, 0, 0])), "no edge");
    assert!(!meet(2, FLAT, [[0, 0, 0], [4, 0, 0], [2, 0, 0]]), "the edge itself");
}

#[test]
fn a_hair_apart_is_apart() {
    let flat = [[0.0, 0.0, 0.3], [1.0, 0.0, 0.3], [0.0, 1.0, 0.3]];
    let above = [[0.25, 0.25, 0.3f64.next_up()], [0.25, 0.25, 1.0], [0.5, 0.25, 1.0]];
    assert!(!agreed([0, 1, 2], flat, [3, 4, 5], above));
    let mut on = above;
    on[0][2] = 0.3;
    assert!(agreed([0, 1, 2], flat, [3, 4, 5], on));
    // Far from zero and tilted: one unit in the last place decides.
    let lift = |p: Point| [p[0] + 5e6, p[1] - 4e5, 3.0 * (p[0] + p[1]) + 7e6];
    let tilted = flat.map(lift);
    let mut tip = [[0.25, 0.25, 0.0], [0.5, 0.5, 0.0], [0.5, 0.25, 0.0]].map(lift);
    (tip[1][2], tip[2][2]) = (8e6, 8e6);
    assert!(agreed([0, 1, 2], tilted, [3, 4, 5], tip));
    tip[0][2] = tip[0][2].next_up();
    assert!(!agreed([0, 1, 2], tilted, [3, 4, 5], tip));
}

/// A point in homogeneous coordinates x y z w, w > 0.
type Fraction = [i128; 4];

fn dot(h: Fraction, p: Fraction) -> i128 {
    (0..4).map(|i| h[i] * p[i]).sum()
}

fn minus(a: Corner, b: Corner) -> Corner {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Corner, b: Corner) -> Corner {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The half space of points p with normal · (p − through) ≥ 0.
fn half_space(normal: Corner, through: Corner) -> Fraction {
    let offset: i64 = (0..3).map(|i| normal[i] * through[i]).sum();
    [i128::from(normal[0]), i128::from(normal[1]), i128::from(normal[2]), -i128::from(offset)]
}

/// Half spaces whose common part is the hull of the corners, whatever its dimension.
fn half_spaces(corners: [Corner; 3]) -> Vec<Fraction> {
    let [a, b, c] = corners;
    let normal = cross(minus(b, a), minus(c, a));
    let both = |normal: Corner, through| [half_space(normal, through), half_space(normal.map(|n| -n), through)];
    if normal != [0; 3] {
        let sides = [[a, b], [b, c], [c, a]].map(|[p, q]| half_space(cross(normal, minus(q, p)), p));
        return both(normal, a).into_iter().chain(sides).collect();
    }
    // The two ends of the segment are the corners farthest from each other.
    let length = |[p, q]: [Corner; 2]| minus(p, q).iter().map(|d| d * d).sum::<i64>();
    let [p, q] = [[a, b], [b, c], [c, a]].into_iter().max_by_key(|ends| length(*ends)).unwrap();
    let along = minus(q, p);
    let axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    if along == [0; 3] {
        return axes.into_iter().flat_map(|axis| both(axis, p)).collect();
    }
    let across = axes.into_iter().flat_map(|axis| both(cross(along, axis), p));
    across.chain([half_space(along, p), half_space(along.map(|n| -n), q)]).collect()
}

/// The corners of the convex polygon's part in a half space.
fn cut(polygon: &[Fraction], h: Fraction) -> Vec<Fraction> {
    let mut kept = Vec::new();
    for (i, &p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (of_p, of_q) = (dot(h, p), dot(h, q));
        if of_p >= 0 {
            kept.push(p);
        }
        if of_p.signum() * of_q.signum() < 0 {
            // The point between p and q where h vanishes, w positive, in lowest terms.
            let mut on: Fraction = std::array::from_fn(|m| p[m] * of_q.abs() + q[m] * of_p.abs());
            let divisor = on.iter().fold(0, |a, &b| gcd(a, b));
            on.iter_mut().for_each(|c| *c /= divisor);
            kept.push(on);
        }
    }
    kept
}

fn gcd(a: i128, b: i128) -> i128 {
    if b == 0 { a.abs() } else { gcd(b, a % b) }
}

/// Cuts `pa` down to what lies in `pb`; the two intersect if a corner of that is not in what they share by number.
fn naive(a: [u32; 3], pa: [Corner; 3], b: [u32; 3], pb: [Corner; 3]) -> bool {
    let fraction = |[x, y, z]: Corner| [i128::from(x), i128::from(y), i128::from(z), 1];
    let common = half_spaces(pb).into_iter().fold(pa.map(fraction).to_vec(), |polygon, h| cut(&polygon, h));
    let shared: Vec<Corner> = (0..3).filter(|i| b.contains(&a[*i])).map(|i| pa[i]).collect();
    let within = |hull: [Corner; 3], p: &Fraction| half_spaces(hull).iter().all(|h| dot(*h, *p) >= 0);
    match shared[..] {
        [] => !common.is_empty(),
        [v] => !common.iter().all(|p| within([v; 3], p)),
        [v, w] => !common.iter().all(|p| within([v, w, w], p)),
        _ => true,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    /// Corners from few places: touching, folds, lines and points are common.
    #[test]
    fn agrees_with_the_naive_twin(
        places in prop::collection::vec([-2i64..3, -2i64..3, -2i64..3], 6),
        flat in any::<bool>(),
        b in Just([0u32, 1, 2, 3, 4, 5]).prop_shuffle(),
    ) {
        let at = |v: u32| if flat { [places[v as usize][0], places[v as usize][1], 1] } else { places[v as usize] };
        let (a, b) = ([0, 1, 2], [b[0], b[1], b[2]]);
        let point = |v: u32| at(v).map(|c| c as f64);
        prop_assert_eq!(agreed(a, a.map(point), b, b.map(point)), naive(a, a.map(at), b, b.map(at)));
    }

    /// Larger numbers and other units: powers of two and shifts that lose no digit change nothing.
    #[test]
    fn agrees_with_the_naive_twin_at_any_scale(
        places in prop::collection::vec([-50i64..51, -50i64..51, -9i64..10], 6),
        shared in 0u32..3,
        power in -200i32..200,
        shift in [-1000i64..1000, -1000i64..1000, -1000i64..1000],
    ) {
        let (a, b) = ([0, 1, 2], [0, 1, 2].map(|i| if i < shared { i } else { i + 3 }));
        let at = |v: u32| places[v as usize];
        let point = |v: u32| [0, 1, 2].map(|m| (at(v)[m] + shift[m]) as f64 * 2f64.powi(power));
        prop_assert_eq!(agreed(a, a.map(point), b, b.map(point)), naive(a, a.map(at), b, b.map(at)));
    }
}
