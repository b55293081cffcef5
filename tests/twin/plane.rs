//! Vertices into the plane of the points round them, cell by cell as the specification says.

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

/// The unit vector from the solid cells that are no farther than two cells along any axis from `centre`, in cells' numbers, by their directions over their
/// distances; zero if that is short.
pub fn outward(solid: &Cells, centre: [f64; 3]) -> [f64; 3] {
    let near = |a: usize| ((centre[a] - 2.0).ceil() as i32)..=((centre[a] + 2.0).floor() as i32);
    let mut push = [0.0; 3];
    for y in near(1) {
        for z in near(2) {
            let mut of_row = [0.0; 3];
            for x in near(0).filter(|&x| solid.get([x, y, z])) {
                let d = [0, 1, 2].map(|a| f64::from([x, y, z][a]) - centre[a]);
                if dot(d, d) > 0.0 {
                    (0..3).for_each(|a| of_row[a] -= d[a] / dot(d, d));
                }
            }
            (0..3).for_each(|a| push[a] += of_row[a]);
        }
    }
    let length = dot(push, push).sqrt();
    if length < 2.5 { [0.0; 3] } else { push.map(|c| c / length) }
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
            let outward = outward(solid, [x, y, z].map(f64::from)).map(|c| f64::from(c as f32));
            Cell { cell: [x, y, z], mean: [mean(0), mean(1), mean(2)], points, outward }
        });
        Means(means.collect())
    }

    /// Where a vertex at `q` goes whose corner has this outward; `None` if it finds no plane.
    pub fn projected(&self, q: [f64; 3], outward: [f64; 3]) -> Option<[f64; 3]> {
        let mut at = q;
        let mut moved = false;
        let mut variance = 0.0;
        for step in 0..5 {
            let sight = match step {
                0 => 5.0,
                1 => 4.0,
                _ => f64::min(2.0 + 3.5 * variance, 4.0),
            };
            let Some((mean, covariance)) = self.around(at, outward, sight) else { break };
            let across = flattest(covariance);
            let mut next = at;
            for a in 0..3 {
                next[a] = at[a] + dot(across[a], mean);
            }
            let way = [0, 1, 2].map(|a| next[a] - q[a]);
            if dot(way, way) > 36.0 {
                break;
            }
            (at, moved) = (next, true);
            variance = 0.0;
            for a in 0..3 {
                for b in 0..3 {
                    variance += across[a][b] * covariance[a][b];
                }
            }
        }
        moved.then_some(at)
    }

    /// Mean, seen from `at`, and covariance of the points within sight and on the vertex's side.
    fn around(&self, at: [f64; 3], outward: [f64; 3], sight: f64) -> Option<([f64; 3], [[f64; 3]; 3])> {
        let mut weights = 0.0;
        let mut sums = [0.0; 3];
        let mut squares = [[0.0; 3]; 3];
        for cell in &self.0 {
            let d = [0, 1, 2].map(|a| cell.mean[a] - at[a]);
            let share = 1.0 - dot(d, d) / (sight * sight);
            if share <= 0.0 {
                continue;
            }
            let square = share * share;
            let weight = square * square * cell.points * agreement(outward, cell.outward);
            weights += weight;
            for a in 0..3 {
                sums[a] += weight * d[a];
                for b in a..3 {
                    squares[a][b] += weight * d[a] * d[b];
                }
            }
        }
        if weights <= 0.0 {
            return None;
        }
        let mean = sums.map(|s| s / weights);
        let mut covariance = [[0.0; 3]; 3];
        for a in 0..3 {
            for b in 0..3 {
                covariance[a][b] = squares[a.min(b)][a.max(b)] / weights - mean[a] * mean[b];
            }
        }
        Some((mean, covariance))
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
