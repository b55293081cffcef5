//! Vertices onto the sphere of the points round them, cell by cell as the specification says.

use std::collections::BTreeMap;

use super::Params;
use super::grid::{cell_of, place_in_cell};
use super::solid::Cells;

/// A cell's points: their mean, in cells along the grid's axes, and their number; and what is outward of it.
pub struct Cell {
    pub cell: [i32; 3],
    pub mean: [f64; 3],
    pub points: f64,
    pub outward: [f64; 3],
}

/// The unit vector down the share of the solid round `centre`, in cells' numbers, weighted by a Gaussian; zero if it falls off by less than `least` for each cell.
fn down(solid: &Cells, centre: [f64; 3], least: f64) -> [f64; 3] {
    let near = |a: usize| ((centre[a] - 5.0).ceil() as i32)..=((centre[a] + 5.0).floor() as i32);
    let bell = |d: f64| libm::exp(-d * d / (2.0 * 1.35 * 1.35));
    let whole: f64 = near(0).map(|x| bell(f64::from(x) - centre[0])).sum();
    // The Gaussian along an axis, and how much it grows.
    let weight = |c: i32, a: usize| {
        let d = f64::from(c) - centre[a];
        [bell(d) / whole, bell(d) * d / (1.35 * 1.35) / whole]
    };
    let single = |c: i32, a: usize| weight(c, a).map(|w| w as f32);
    let mut rise = [0.0f32; 3];
    for y in near(1) {
        let mut of_slice = [0.0f32; 3];
        for z in near(2) {
            let cells = near(0).filter(|&x| solid.get([x, y, z]));
            let of_row = cells.fold([0.0; 2], |sums, x| [0, 1].map(|i| sums[i] + weight(x, 0)[i]));
            let ([along, growth], [of_z, growth_z]) = (of_row.map(|sum| sum as f32), single(z, 2));
            for (sum, part) in of_slice.iter_mut().zip([of_z * growth, of_z * along, growth_z * along]) {
                *sum += part;
            }
        }
        let [of_y, growth_y] = single(y, 1);
        for (sum, part) in rise.iter_mut().zip([of_y * of_slice[0], growth_y * of_slice[1], of_y * of_slice[2]]) {
            *sum += part;
        }
    }
    let rise = rise.map(f64::from);
    let steepness = dot(rise, rise).sqrt();
    if steepness < least { [0.0; 3] } else { rise.map(|c| -c / steepness) }
}

/// What is outward of a cell.
pub fn outward(solid: &Cells, cell: [i32; 3]) -> [f64; 3] {
    down(solid, cell.map(f64::from), 0.065)
}

/// What is outward of the lowest corner of a cell.
pub fn outward_of_corner(solid: &Cells, cell: [i32; 3]) -> [f64; 3] {
    down(solid, cell.map(|c| f64::from(c) - 0.5), 1e-4)
}

/// The cells that hold points, in the order in which they are summed.
pub struct Means(pub Vec<Cell>);

const QUANTA: f64 = 1_048_576.0;

/// One and a half times the cosine between two directions, from 0 to 1; 1 if there is none of either.
pub fn agreement(u: [f64; 3], v: [f64; 3]) -> f64 {
    if u == [0.0; 3] || v == [0.0; 3] { 1.0 } else { (1.5 * dot(u, v)).clamp(0.0, 1.0) }
}

impl Means {
    /// Sums the points by cell.
    pub fn of(points: &[[f64; 3]], solid: &Cells, params: &Params) -> Means {
        // By slice, row, x: the number of points and the sums of their offsets.
        let mut sums: BTreeMap<[i32; 3], (u64, [u64; 3])> = BTreeMap::new();
        for &p in points {
            let cell = cell_of(p, params);
            let (count, offsets) = sums.entry([cell[1], cell[2], cell[0]]).or_default();
            *count += 1;
            let within = place_in_cell(p, params);
            (0..3).for_each(|g| offsets[g] += (within[g] * QUANTA).floor() as u64);
        }
        let means = sums.into_iter().map(|([y, z, x], (count, offsets))| {
            let points = count as f64;
            let mean = |g: usize| f64::from([x, y, z][g]) + (offsets[g] / count) as f64 / QUANTA;
            let outward = outward(solid, [x, y, z]).map(|c| f64::from(c as f32));
            Cell { cell: [x, y, z], mean: [mean(0), mean(1), mean(2)], points, outward }
        });
        Means(means.collect())
    }

    /// Where a vertex at `q` goes whose corner has this outward; `None` if it finds no sphere.
    pub fn projected(&self, q: [f64; 3], outward: [f64; 3]) -> Option<[f64; 3]> {
        let mut at = q;
        let mut moved = false;
        let mut variance = 0.0;
        let mut sphere = Sphere { c: 0.0, b: [0.0; 3], e: 0.0 };
        let mut way = [0.0; 3];
        for step in 0..5 {
            let sight = match step {
                0 => 4.0,
                1 => 3.0,
                _ => f64::min(2.5 + 9.0 * variance * variance, 4.0),
            };
            let seen = self.seen(at, outward, sight);
            let Some(sums) = around(&seen) else { break };
            if outward == [0.0; 3] {
                let (covariance, across) = (sums.covariance(), flattest(sums.covariance()));
                way = across.map(|row| dot(row, sums.mean));
                variance = (0..9).map(|i| across[i / 3][i % 3] * covariance[i / 3][i % 3]).sum();
            } else {
                let weights: f64 = seen.iter().map(|cell| cell.weight).sum();
                let off = |d: [f64; 3]| sphere.value([0, 1, 2].map(|a| way[a] + d[a]));
                variance = seen.iter().map(|cell| cell.weight * (off(cell.d) * off(cell.d))).sum::<f64>() / weights;
                sphere = sums.sphere(sight);
                way = sphere.way(sight);
            }
            let next = [0, 1, 2].map(|a| at[a] + way[a]);
            let whole = [0, 1, 2].map(|a| next[a] - q[a]);
            if dot(whole, whole) > 36.0 {
                break;
            }
            (at, moved) = (next, true);
        }
        moved.then_some(at)
    }

    /// The cells within sight, each with its weight.
    fn seen(&self, at: [f64; 3], outward: [f64; 3], sight: f64) -> Vec<Seen> {
        let cells = self.0.iter().filter_map(|cell| {
            let d = [0, 1, 2].map(|a| cell.mean[a] - at[a]);
            let share = 1.0 - dot(d, d) / (sight * sight);
            if share <= 0.0 {
                return None;
            }
            let square = share * share;
            let weight = square * square * cell.points * agreement(outward, cell.outward);
            Some(Seen { weight, d, n: if cell.outward == [0.0; 3] { outward } else { cell.outward } })
        });
        cells.collect()
    }
}

/// A cell within sight: d leads to it, n is outward of it.
struct Seen {
    weight: f64,
    d: [f64; 3],
    n: [f64; 3],
}

/// Weighted means over cells; `None` if none has weight.
fn around(seen: &[Seen]) -> Option<Around> {
    let weights: f64 = seen.iter().map(|cell| cell.weight).sum();
    let mean = |of: &dyn Fn(&Seen) -> f64| seen.iter().map(|cell| cell.weight * of(cell)).sum::<f64>() / weights;
    (weights > 0.0).then(|| Around {
        mean: [0, 1, 2].map(|a| mean(&|cell| cell.d[a])),
        normal: [0, 1, 2].map(|a| mean(&|cell| cell.n[a])),
        off: mean(&|cell| dot(cell.n, cell.d)),
        squares: [0, 1, 2].map(|a| [0, 1, 2].map(|b| mean(&|cell| cell.d[a.min(b)] * cell.d[a.max(b)]))),
    })
}

/// The means of d, which leads to a cell, of what is outward of it, of the product of both, and of d_a·d_b.
struct Around {
    mean: [f64; 3],
    normal: [f64; 3],
    off: f64,
    squares: [[f64; 3]; 3],
}

impl Around {
    fn covariance(&self) -> [[f64; 3]; 3] {
        [0, 1, 2].map(|a| [0, 1, 2].map(|b| self.squares[a][b] - self.mean[a] * self.mean[b]))
    }

    fn sphere(&self, sight: f64) -> Sphere {
        let squared = self.squares[0][0] + self.squares[1][1] + self.squares[2][2];
        let spread = f64::max(squared - dot(self.mean, self.mean), 1e-3 * sight * sight);
        let e = 0.5 * (self.off - dot(self.normal, self.mean)) / spread;
        let b = [0, 1, 2].map(|a| self.normal[a] - 2.0 * e * self.mean[a]);
        let c = -dot(b, self.mean) - e * squared;
        let length = dot(b, b).sqrt();
        let scale = if length < 1e-6 { 0.0 } else { 1.0 / length };
        Sphere { c: scale * c, b: b.map(|b| scale * b), e: scale * e }
    }
}

/// Where c + b·x + e x² is 0.
struct Sphere {
    c: f64,
    b: [f64; 3],
    e: f64,
}

impl Sphere {
    fn value(&self, x: [f64; 3]) -> f64 {
        self.c + dot(self.b, x) + self.e * dot(x, x)
    }

    fn way(&self, sight: f64) -> [f64; 3] {
        let root = (1.0 - 4.0 * self.e * self.c).max(0.0).sqrt();
        let far = (-2.0 * self.c / (1.0 + root)).max(-sight).min(sight);
        self.b.map(|b| far * b)
    }
}

pub fn dot(u: [f64; 3], v: [f64; 3]) -> f64 {
    u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
}

/// Nearly the projection onto the direction of least variance.
pub fn flattest(covariance: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let mut c = covariance;
    for (a, row) in c.iter_mut().enumerate() {
        row[a] += 1.0 / 1024.0;
    }
    let mut m = [[0.0; 3]; 3];
    for [a, b] in [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]] {
        let (i, j) = ((a + 1) % 3, (a + 2) % 3);
        let (k, l) = ((b + 1) % 3, (b + 2) % 3);
        m[a][b] = c[i][k] * c[j][l] - c[i][l] * c[j][k];
        m[b][a] = m[a][b];
    }
    m = over_trace(m);
    for _ in 0..3 {
        let column = |m: [[f64; 3]; 3], b: usize| [m[0][b], m[1][b], m[2][b]];
        let square = [0, 1, 2].map(|a| [0, 1, 2].map(|b| dot(m[a], column(m, b))));
        m = over_trace(square);
    }
    m
}

fn over_trace(m: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let trace = m[0][0] + m[1][1] + m[2][2];
    m.map(|row| row.map(|entry| entry / trace))
}
