//! Normals of walls, and the free cells on both sides of them.

use rayon::prelude::*;

use super::block::Block;

/// Squared radius of the ball whose occupied cells tell a wall's normal; and the one if there are too few in it, and by which double walls are told.
pub(super) const NEAR: (i32, i32) = (5, 12);

/// Fewer occupied cells in the smaller ball are too few.
const ENOUGH: i64 = 7;

/// What a wall weighs, against a face between free cells.
pub const WEIGHT: f32 = 4.0;

/// A wall is *double* if occupied cells lie farther across it than those of one plane do: by this in their variance, in cells squared. So two walls are that lie 1.3 cells apart or more, up to the ball's radius.
pub(super) const DOUBLE: f64 = 0.4;

/// What a double wall weighs: there may be a slot or a fin between its sides, and then these are alike.
pub const LIGHT: f32 = 0.05;

/// How far a wall's sides are looked for, in half cells.
const REACH: i32 = 8;

/// The number of walls that one thread takes at a time.
const TOGETHER: usize = 1024;

/// An occupied cell with the nearest free cells on both of its sides, as indices of the block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// The occupied cell.
    pub cell: u32,
    /// The free cells.
    pub sides: [u32; 2],
    /// The direction from the second one to the first.
    pub normal: [f32; 3],
    /// What it weighs: how likely it parts an inside from the outside.
    pub weight: f32,
}

/// The steps from a wall along its normal (`sign` 1) or against it (-1), in whole cells, as far as its sides are looked for.
fn steps(normal: [f64; 3], sign: f64) -> impl Iterator<Item = [i32; 3]> {
    (2..=REACH).map(move |half| normal.map(|n| (sign * f64::from(half) / 2.0 * n).round() as i32))
}

/// Those of the occupied cells `walls` that have free cells on both sides, in their order. The work is dealt out to the pool that it is called in.
pub fn two_sided(block: &Block, occupied: &[bool], walls: &[u32]) -> Vec<Wall> {
    let near = Rows::of_ball(block, NEAR.0);
    let wide: Vec<([i64; 3], isize)> =
        Block::ball(NEAR.1).into_iter().map(|d| (d.map(i64::from), block.step(d))).collect();
    let wall = |&cell: &u32| {
        let wall = cell as usize;
        let mut moments = Moments::of_rows(occupied, wall, &near);
        if moments.count < ENOUGH {
            moments = Moments::of(occupied, wall, &wide);
        }
        let normal = moments.normal();
        let side = |sign: f64| {
            steps(normal, sign).find_map(|step| {
                let cell = wall.checked_add_signed(block.step(step))?;
                (!occupied[cell]).then_some(cell as u32)
            })
        };
        Some(Wall { cell, sides: [side(1.0)?, side(-1.0)?], normal: normal.map(|c| c as f32), weight: WEIGHT })
    };
    walls.par_iter().with_min_len(TOGETHER).filter_map(wall).collect()
}

/// Which walls are double: the occupied cells in the wider ball spread across them by more than one plane's do.
pub fn doubles(block: &Block, occupied: &[bool], walls: &[Wall]) -> Vec<bool> {
    let wide: Vec<([i64; 3], isize)> =
        Block::ball(NEAR.1).into_iter().map(|d| (d.map(i64::from), block.step(d))).collect();
    let is_double = |wall: &Wall| {
        let normal = wall.normal.map(f64::from);
        // Cells that a plane passes have their middles within half of their width across it on either side.
        let width: f64 = normal.iter().map(|c| c.abs()).sum();
        Moments::of(occupied, wall.cell as usize, &wide).variance(normal) > width * width / 12.0 + DOUBLE
    };
    walls.par_iter().with_min_len(TOGETHER).map(is_double).collect()
}

/// A wall is *thick* if the cells from its one side to the other spread across it by more than the cells of one plane do, by this, in cells. No plane's do, however it lies;
/// of two planes 1 to 2 cells apart, one wall in five or more is thick.
pub(super) const THICK: f64 = 0.3;

/// Whether the occupied cells along a wall's normal, from the last one before its one side to the last one before the other, are too many for one plane.
///
/// ```text
///   b  #  #  #  #  a      the last cells before a and b: their middles lie no farther apart, along n, than a plane's cells are wide, |n_x| + |n_y| + |n_z|
///      ^-------^
/// ```
pub fn is_thick(block: &Block, occupied: &[bool], wall: &Wall) -> bool {
    let normal = wall.normal.map(f64::from);
    let last = |sign: f64| {
        let is_occupied = |step: &[i32; 3]| occupied[(wall.cell as usize).wrapping_add_signed(block.step(*step))];
        let last = steps(normal, sign).take_while(is_occupied).last().unwrap_or([0; 3]);
        (0..3).map(|a| f64::from(last[a]) * normal[a]).sum::<f64>()
    };
    let width: f64 = normal.iter().map(|c| c.abs()).sum();
    last(1.0) - last(-1.0) > width + THICK
}

/// The rows of a ball whose radius is less than three cells.
struct Rows {
    /// For each row: its slice and row counted from the middle, the step to its own middle, and the bits of its cells as [`Block::five`] has them.
    rows: Vec<([i64; 2], isize, u8)>,
    /// For each pattern of bits: their number, the sum of their offsets, and the sum of the squares.
    sums: Vec<[i64; 3]>,
}

impl Rows {
    fn of_ball(block: &Block, squared: i32) -> Rows {
        let mut rows: Vec<([i64; 2], isize, u8)> = Vec::new();
        for [x, y, z] in Block::ball(squared) {
            let bit = 1 << (x + 2);
            match rows.last_mut() {
                Some((last, _, bits)) if *last == [y, z].map(i64::from) => *bits |= bit,
                _ => rows.push(([y, z].map(i64::from), block.step([0, y, z]), bit)),
            }
        }
        let sums = (0..=u8::MAX).map(|pattern| {
            let offsets = (-2i64..=2).filter(|x| pattern >> (x + 2) & 1 == 1);
            offsets.fold([0; 3], |[count, sum, squares], x| [count + 1, sum + x, squares + x * x])
        });
        Rows { rows, sums: sums.collect() }
    }
}

/// Sums over the offsets of occupied cells.
struct Moments {
    count: i64,
    first: [i64; 3],
    /// xx, yy, zz, xy, yz, zx.
    second: [i64; 6],
}

impl Moments {
    fn of_rows(occupied: &[bool], wall: usize, near: &Rows) -> Moments {
        let mut sums = Moments { count: 0, first: [0; 3], second: [0; 6] };
        for &([y, z], step, bits) in &near.rows {
            let pattern = Block::five(occupied, wall.wrapping_add_signed(step)) & bits;
            let [count, x, xx] = near.sums[pattern as usize];
            sums.count += count;
            for (sum, d) in sums.first.iter_mut().zip([x, y * count, z * count]) {
                *sum += d;
            }
            for (sum, d) in sums.second.iter_mut().zip([xx, y * y * count, z * z * count, x * y, y * z * count, z * x])
            {
                *sum += d;
            }
        }
        sums
    }

    fn of(occupied: &[bool], wall: usize, near: &[([i64; 3], isize)]) -> Moments {
        let mut sums = Moments { count: 0, first: [0; 3], second: [0; 6] };
        for &([x, y, z], step) in near {
            if occupied[wall.wrapping_add_signed(step)] {
                sums.count += 1;
                for (sum, d) in sums.first.iter_mut().zip([x, y, z]) {
                    *sum += d;
                }
                for (sum, d) in sums.second.iter_mut().zip([x * x, y * y, z * z, x * y, y * z, z * x]) {
                    *sum += d;
                }
            }
        }
        sums
    }

    /// The variance of the cells' offsets along a direction.
    fn variance(&self, [x, y, z]: [f64; 3]) -> f64 {
        let [xx, yy, zz, xy, yz, zx] = self.second.map(|sum| sum as f64 / self.count as f64);
        let mean: f64 =
            self.first.iter().zip([x, y, z]).map(|(sum, c)| *sum as f64 * c).sum::<f64>() / self.count as f64;
        x * x * xx + y * y * yy + z * z * zz + 2.0 * (x * y * xy + y * z * yz + z * x * zx) - mean * mean
    }

    /// The direction in which the cells spread least.
    fn normal(&self) -> [f64; 3] {
        let covariance = |product: usize, a: usize, b: usize| {
            (self.count * self.second[product] - self.first[a] * self.first[b]) as f64
        };
        least_axis([
            [covariance(0, 0, 0), covariance(3, 0, 1), covariance(5, 2, 0)],
            [covariance(3, 0, 1), covariance(1, 1, 1), covariance(4, 1, 2)],
            [covariance(5, 2, 0), covariance(4, 1, 2), covariance(2, 2, 2)],
        ])
    }
}

/// The eigenvector of a symmetric matrix's least eigenvalue, by Jacobi's rotations; of equal ones that of the first axis.
fn least_axis(mut a: [[f64; 3]; 3]) -> [f64; 3] {
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..6 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            let rows = (a[p], a[q]);
            for (k, (x, y)) in rows.0.into_iter().zip(rows.1).enumerate() {
                (a[p][k], a[q][k]) = (c * x - s * y, s * x + c * y);
            }
            for row in &mut v {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
        }
    }
    let least = (1..3).fold(0, |least, i| if a[i][i] < a[least][least] { i } else { least });
    [v[0][least], v[1][least], v[2][least]]
}
