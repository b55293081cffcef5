//! How thick the shell of points is, block by block as the specification says.

use std::collections::{BTreeMap, BTreeSet};

use super::Params;
use super::grid::{cell_of, place_in_cell};
use super::solid::Cells;
use super::sphere::{agreement, flattest, outward};

/// The lower quartiles of the thickness of blocks of 3³ and 5³ cells; `None` if too few of them tell.
pub fn shell(points: &[[f64; 3]], solid: &Cells, params: &Params) -> Option<[f64; 2]> {
    let mut places: BTreeMap<[i32; 3], Vec<[i64; 3]>> = BTreeMap::new();
    for &p in points {
        let place = place_in_cell(p, params).map(|within| (within * 1024.0).floor() as i64);
        places.entry(cell_of(p, params)).or_default().push(place);
    }
    let slices = i64::from(params.cells[1]);
    let chosen: BTreeSet<i64> = (0..16).map(|i| (2 * i + 1) * slices / 32).collect();
    let mut variances = [Vec::new(), Vec::new()];
    let mut looked_at = 0;
    for y in chosen {
        let mut cells: Vec<[i32; 3]> = places.keys().copied().filter(|cell| i64::from(cell[1]) == y).collect();
        cells.sort_by_key(|cell| (cell[2], cell[0]));
        for cell in cells.iter().copied().step_by(cells.len().div_ceil(128).max(1)) {
            looked_at += 1;
            let side = outward(solid, cell);
            let back = [0, 1, 2].map(|a| cell[a] - (3.0 * side[a]).round() as i32);
            if side == [0.0; 3] || !solid.get(back) {
                continue;
            }
            let blocks = [1, 2].map(|reach| {
                let mut block = Vec::new();
                for (other, within) in &places {
                    let away = [0, 1, 2].map(|a| other[a] - cell[a]);
                    let near = away.iter().all(|d| d.abs() <= reach);
                    if near && agreement(side, outward(solid, *other)) > 0.0 {
                        block.extend(within.iter().map(|p| [0, 1, 2].map(|a| p[a] + 1024 * i64::from(away[a]))));
                    }
                }
                block
            });
            if blocks.iter().all(|block| block.len() >= 6) {
                variances.iter_mut().zip(&blocks).for_each(|(all, block)| all.push(variance(block)));
            }
        }
    }
    if 4 * variances[0].len() < looked_at - looked_at % 4 || variances[0].is_empty() {
        return None;
    }
    Some(variances.map(|mut all| {
        all.sort_by(f64::total_cmp);
        all[all.len() / 4].sqrt()
    }))
}

/// Whether a shell is noise.
pub fn is_noisy([thickness, wider]: [f64; 2]) -> bool {
    thickness > 0.08 && wider < 1.8 * thickness
}

/// The variance of places across their flattest direction, in square cells.
fn variance(places: &[[i64; 3]]) -> f64 {
    let n = places.len() as f64;
    let sum = |of: &dyn Fn(&[i64; 3]) -> i64| places.iter().map(of).sum::<i64>() as f64 / n;
    let mean = [0, 1, 2].map(|a| sum(&|p| p[a]));
    let covariance = [0, 1, 2]
        .map(|a| [0, 1, 2].map(|b| (sum(&|p| p[a] * p[b]) - mean[a.min(b)] * mean[a.max(b)]) / (1024.0 * 1024.0)));
    let across = flattest(covariance);
    let mut variance = 0.0;
    for a in 0..3 {
        for b in 0..3 {
            variance += across[a][b] * covariance[a][b];
        }
    }
    variance.max(0.0)
}
