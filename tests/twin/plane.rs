//! Vertices into the plane of the points round them, cell by cell as the specification says.

use std::collections::BTreeMap;

use super::Params;
use super::grid::{cell_of, own, raw_cell_of};

/// A cell's points: their mean, in cells along the grid's axes, and their number.
struct Cell {
    mean: [f64; 3],
    points: f64,
}

/// The cells that hold points, in the order in which they are summed.
pub struct Means(Vec<Cell>);

const QUANTA: f64 = 1_048_576.0;

impl Means {
    /// Sums the points by cell.
    pub fn of(points: &[[f64; 3]], params: &Params) -> Means {
        // By slice, row, x: the number of points and the sums of their offsets.
        let mut sums: BTreeMap<[i32; 3], (u64, [u64; 3])> = BTreeMap::new();
        let inv = 1.0 / params.w;
        for &p in points {
            let (cell, raw) = (cell_of(p, params), raw_cell_of(p, params));
            let (count, offsets) = sums.entry([cell[1], cell[2], cell[0]]).or_default();
            *count += 1;
            for (g, f) in params.axis.permutation().into_iter().enumerate() {
                let within = (own(p, params)[f] - params.min[f]) * inv - f64::from(raw[g]);
                offsets[g] += (within.clamp(0.0, 1.0) * QUANTA).floor() as u64;
            }
        }
        let means = sums.into_iter().map(|([y, z, x], (count, offsets))| {
            let points = count as f64;
            let mean = |g: usize| f64::from([x, y, z][g]) + offsets[g] as f64 / points / QUANTA;
            Cell { mean: [mean(0), mean(1), mean(2)], points }
        });
        Means(means.collect())
    }

    /// Where a vertex at `q` goes; `None` if it finds no plane.
    pub fn projected(&self, q: [f64; 3]) -> Option<[f64; 3]> {
        let mut at = q;
        let mut moved = false;
        let mut variance = 0.0;
        for step in 0..5 {
            let sight = match step {
                0 => 5.0,
                1 => 4.0,
                _ => f64::min(2.0 + 3.5 * variance, 4.0),
            };
            let Some((mean, covariance)) = self.around(at, sight) else { break };
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

    /// Mean, seen from `at`, and covariance of the points within sight.
    fn around(&self, at: [f64; 3], sight: f64) -> Option<([f64; 3], [[f64; 3]; 3])> {
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
            let weight = square * square * cell.points;
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

fn dot(u: [f64; 3], v: [f64; 3]) -> f64 {
    u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
}

/// Nearly the projection onto the direction of least variance.
fn flattest(covariance: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
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
