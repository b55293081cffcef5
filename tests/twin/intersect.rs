//! Do two triangles meet where they should not? By exact sums of products, from the definition in `docs/algorithm.md`.

type Point = [f64; 3];

/// The sign of a sum of products of numbers, exactly, unless it overflows or underflows.
fn sign(products: &[[f64; 4]]) -> i32 {
    let about: f64 = products.iter().map(|p| p.iter().product::<f64>()).sum();
    let size: f64 = products.iter().map(|p| p.iter().product::<f64>().abs()).sum();
    if about.abs() > 1e-13 * size {
        return if about > 0.0 { 1 } else { -1 };
    }
    // A sum of floats that do not overlap, the smallest first: its sign is that of the last one.
    let mut sum: Vec<f64> = Vec::new();
    for product in products {
        let mut parts = vec![1.0];
        for factor in product {
            parts = parts
                .iter()
                .flat_map(|part| {
                    let high = part * factor;
                    [part.mul_add(*factor, -high), high]
                })
                // Most are none: of whole numbers, and of what one factor takes whole.
                .filter(|part| *part != 0.0)
                .collect();
        }
        for part in parts {
            let mut carry = part;
            let mut next = Vec::new();
            for term in sum {
                let total: f64 = carry + term;
                let of_term = total - carry;
                let rest = (carry - (total - of_term)) + (term - of_term);
                if rest != 0.0 {
                    next.push(rest);
                }
                carry = total;
            }
            if carry != 0.0 {
                next.push(carry);
            }
            sum = next;
        }
    }
    sum.last().map_or(0, |last| if *last > 0.0 { 1 } else { -1 })
}

/// The side of the line ab that c lies on, in the plane of two coordinates.
fn turn(a: Point, b: Point, c: Point, [x, y]: [usize; 2]) -> i32 {
    let cross = |p: Point, q: Point| [[p[x], q[y], 1.0, 1.0], [-p[y], q[x], 1.0, 1.0]];
    sign([cross(a, b), cross(b, c), cross(c, a)].as_flattened())
}

/// The side of the plane abc that d lies on.
fn side(a: Point, b: Point, c: Point, d: Point) -> i32 {
    let det = |s: f64, p: Point, q: Point, r: Point| {
        [[0, 1, 2], [1, 2, 0], [2, 0, 1]].map(|[i, j, k]| [[s, p[i], q[j], r[k]], [-s, p[i], q[k], r[j]]])
    };
    sign([det(1.0, b, c, d), det(-1.0, a, c, d), det(1.0, a, b, d), det(-1.0, a, b, c)].as_flattened().as_flattened())
}

const PLANES: [[usize; 2]; 3] = [[1, 2], [2, 0], [0, 1]];

/// Whether p lies on the segment ab, given that the three lie on one line.
fn between(p: Point, a: Point, b: Point) -> bool {
    (0..3).all(|i| a[i].min(b[i]) <= p[i] && p[i] <= a[i].max(b[i]))
}

fn on_segment(p: Point, a: Point, b: Point) -> bool {
    PLANES.iter().all(|&plane| turn(a, b, p, plane) == 0) && between(p, a, b)
}

fn segments_meet(p: Point, q: Point, a: Point, b: Point) -> bool {
    if on_segment(p, a, b) || on_segment(q, a, b) || on_segment(a, p, q) || on_segment(b, p, q) {
        return true;
    }
    // Otherwise they can only cross, in the plane of the four.
    side(p, q, a, b) == 0
        && PLANES.iter().any(|&plane| {
            turn(p, q, a, plane) * turn(p, q, b, plane) < 0 && turn(a, b, p, plane) * turn(a, b, q, plane) < 0
        })
}

fn in_triangle(p: Point, [a, b, c]: [Point; 3]) -> bool {
    if side(a, b, c, p) != 0 {
        return false;
    }
    let Some(&plane) = PLANES.iter().find(|&&plane| turn(a, b, c, plane) != 0) else { return false };
    let turns = [turn(a, b, p, plane), turn(b, c, p, plane), turn(c, a, p, plane)];
    !(turns.contains(&1) && turns.contains(&-1))
}

fn segment_meets_triangle(p: Point, q: Point, t: [Point; 3]) -> bool {
    let [a, b, c] = t;
    if in_triangle(p, t)
        || in_triangle(q, t)
        || [[a, b], [b, c], [c, a]].iter().any(|s| segments_meet(p, q, s[0], s[1]))
    {
        return true;
    }
    let turns = [side(p, q, a, b), side(p, q, b, c), side(p, q, c, a)];
    side(a, b, c, p) * side(a, b, c, q) < 0 && (turns == [1; 3] || turns == [-1; 3])
}

/// Whether the two, whose boxes meet, have a point in common that is not of a vertex or an edge they share by number.
pub fn intersect(a: [u32; 3], b: [u32; 3], at: &dyn Fn(u32) -> Point) -> bool {
    let (pa, pb) = (a.map(at), b.map(at));
    let shared: Vec<u32> = a.into_iter().filter(|v| b.contains(v)).collect();
    let sides = |t: [u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let has_area = |t: [Point; 3]| PLANES.iter().any(|&plane| turn(t[0], t[1], t[2], plane) != 0);
    let holds = |t: [Point; 3], p: Point| segment_meets_triangle(p, p, t);
    let meets = |t: [u32; 3], other: [Point; 3]| match shared.first() {
        None => sides(t).into_iter().any(|[u, v]| segment_meets_triangle(at(u), at(v), other)),
        // What lies beyond the shared vertex reaches the opposite side of one of the two, or a corner of a triangle without area.
        Some(shared) => {
            let rest: Vec<Point> = t.into_iter().filter(|v| v != shared).map(at).collect();
            if has_area(t.map(at)) {
                segment_meets_triangle(rest[0], rest[1], other)
            } else {
                rest.into_iter().any(|p| p != at(*shared) && holds(other, p))
            }
        }
    };
    match shared.len() {
        0 | 1 => meets(a, pb) || meets(b, pa),
        2 => {
            let third = |t: [u32; 3]| at(*t.iter().find(|v| !shared.contains(v)).expect("only two are shared"));
            let ([p, q], c, d) = ([at(shared[0]), at(shared[1])], third(a), third(b));
            if side(p, q, c, d) != 0 {
                return false;
            }
            match PLANES.iter().find(|&&plane| turn(p, q, c, plane) != 0 || turn(p, q, d, plane) != 0) {
                Some(&plane) => turn(p, q, c, plane) == turn(p, q, d, plane),
                // Pieces of one line: beyond pq both go on to the same side if a third corner lies in the other triangle.
                None => {
                    let beyond = |r: Point, other| !segments_meet(r, r, p, q) && holds(other, r);
                    beyond(c, pb) || beyond(d, pa)
                }
            }
        }
        _ => true,
    }
}

/// The pairs of triangles that intersect.
pub fn pairs(triangles: &[[u32; 3]], at: &dyn Fn(u32) -> Point) -> Vec<([u32; 3], [u32; 3])> {
    pairs_but(triangles, at, &|_| false)
}

/// The same, given that no two of the triangles that are `still` do.
pub fn pairs_but(
    triangles: &[[u32; 3]],
    at: &dyn Fn(u32) -> Point,
    still: &dyn Fn([u32; 3]) -> bool,
) -> Vec<([u32; 3], [u32; 3])> {
    let still: Vec<bool> = triangles.iter().map(|t| still(*t)).collect();
    let ends = |t: &[u32; 3]| {
        let [p, q, r] = t.map(at);
        [0, 1, 2].map(|i| [p[i].min(q[i]).min(r[i]), p[i].max(q[i]).max(r[i])])
    };
    let boxes: Vec<[[f64; 2]; 3]> = triangles.iter().map(ends).collect();
    let mut pairs = Vec::new();
    // In the order of their ends along y, where most clouds are longest: what begins behind the end of a box does not meet it.
    let mut order: Vec<usize> = (0..boxes.len()).collect();
    order.sort_by(|i, j| boxes[*i][1][0].total_cmp(&boxes[*j][1][0]));
    for (at_i, &i) in order.iter().enumerate() {
        let one = boxes[i];
        for &j in order[at_i + 1..].iter().take_while(|j| boxes[**j][1][0] <= one[1][1]) {
            let other = boxes[j];
            let meet = (0..3).all(|a| one[a][0] <= other[a][1] && other[a][0] <= one[a][1]);
            if meet && !(still[i] && still[j]) && intersect(triangles[i], triangles[j], at) {
                pairs.push((triangles[i], triangles[j]));
            }
        }
    }
    pairs
}
