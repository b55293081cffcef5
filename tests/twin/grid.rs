//! From the file's coordinates to cells and back: the axis permutation, the raster, the cell of a point.

use super::Params;

/// An axis of the file's coordinates, as the slicing axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// Slices are perpendicular to the file's x.
    X,
    /// Slices are perpendicular to the file's y.
    Y,
    /// Slices are perpendicular to the file's z.
    Z,
}

impl Axis {
    /// The three axes in the file's order.
    pub const ALL: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

    /// Which of the file's axes this is.
    pub fn index(self) -> usize {
        self as usize
    }

    /// The file axis behind each grid axis: `grid[g] = file[permutation[g]]`; the grid's y is this axis.
    pub fn permutation(self) -> [usize; 3] {
        match self {
            Axis::X => [2, 0, 1],
            Axis::Y => [0, 1, 2],
            Axis::Z => [1, 2, 0],
        }
    }
}

/// Axis, lower end of the box (file axes), cell size and number of cells (grid axes) for a cloud in `slices` slices.
///
/// Without an axis the longest side is taken, of equal ones the first. A side of length 0 cannot be sliced: then the
/// grid is one slice thick and the cells are the longest side's length divided by `slices`, or 1 if the cloud is one
/// point.
pub fn grid_for(points: &[[f64; 3]], axis: Option<Axis>, slices: u32) -> (Axis, [f64; 3], f64, [u32; 3]) {
    let mut min = points[0];
    let mut max = points[0];
    for p in points {
        for a in 0..3 {
            min[a] = min[a].min(p[a]);
            max[a] = max[a].max(p[a]);
        }
    }
    let extent = [max[0] - min[0], max[1] - min[1], max[2] - min[2]];
    let mut longest = Axis::X;
    for candidate in Axis::ALL {
        if extent[candidate.index()] > extent[longest.index()] {
            longest = candidate;
        }
    }
    let axis = axis.unwrap_or(longest);
    let (side, along_axis) =
        if extent[axis.index()] > 0.0 { (extent[axis.index()], slices) } else { (extent[longest.index()], 1) };
    let w = if side > 0.0 { side / f64::from(slices) } else { 1.0 };
    let inv = 1.0 / w;
    let mut cells = [1; 3];
    for (g, f) in axis.permutation().into_iter().enumerate() {
        cells[g] = (extent[f] * inv * (1.0 - 4.0 * f64::EPSILON)).ceil().max(1.0) as u32;
    }
    cells[1] = along_axis;
    (axis, min, w, cells)
}

/// The axes of a grid that is turned so that the third points in a direction: the first is at right angles to it and to the file axis least along it.
pub fn turned_up(d: [f64; 3]) -> [[f64; 3]; 3] {
    let unit = |v: [f64; 3]| {
        let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        [v[0] / length, v[1] / length, v[2] / length]
    };
    let up = unit(d);
    let [a, b, c] = up.map(f64::abs);
    let across = if a <= b && a <= c {
        [0.0, -up[2], up[1]]
    } else if b <= c {
        [up[2], 0.0, -up[0]]
    } else {
        [-up[1], up[0], 0.0]
    };
    let first = unit(across);
    let second = [0, 1, 2].map(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        up[j] * first[k] - up[k] * first[j]
    });
    [first, second, up]
}

/// A point's coordinates along the axes that the box has: the file's, or turned ones.
pub fn own(p: [f64; 3], params: &Params) -> [f64; 3] {
    match params.turn {
        Some(turn) => turn.map(|axis| axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2]),
        None => p,
    }
}

/// The planes left out along a grid axis, where points lie in planes `taken`: those in the middle of the widest gaps. `longest` is the longest side's
/// number of planes.
pub fn folds(taken: &[u32], longest: u32, reach: u32) -> Vec<[u32; 2]> {
    let mut taken = taken.to_vec();
    taken.sort_unstable();
    taken.dedup();
    let kept = 256.max(reach).max((taken.len() as u32).div_ceil(2));
    let wide = |width: u32| width > 2 * kept && width > longest.div_ceil(32);
    let mut gaps: Vec<[u32; 2]> = (1..taken.len()).map(|i| [taken[i - 1] + 1, taken[i]]).collect();
    gaps.retain(|[from, to]| wide(to - from));
    while gaps.len() > 4 {
        // The narrowest goes, of equals the last.
        let narrowest = gaps.iter().map(|[from, to]| to - from).min().unwrap();
        let last = gaps.iter().rposition(|[from, to]| to - from == narrowest).unwrap();
        gaps.remove(last);
    }
    gaps.into_iter().map(|[from, to]| [from + kept / 2, to - kept.div_ceil(2)]).collect()
}

/// The cell of a point, along the grid's axes, if no planes were left out.
pub fn raw_cell_of(p: [f64; 3], params: &Params) -> [u32; 3] {
    let p = own(p, params);
    let inv = 1.0 / params.w;
    let mut cell = [0; 3];
    for (g, f) in params.axis.permutation().into_iter().enumerate() {
        let along = ((p[f] - params.min[f]) * inv).floor();
        let left_out: u32 = params.folds[g].iter().map(|[from, to]| to - from).sum();
        cell[g] = along.clamp(0.0, f64::from(params.cells[g] + left_out - 1)) as u32;
    }
    cell
}

/// The cell of a point, along the grid's axes.
pub fn cell_of(p: [f64; 3], params: &Params) -> [i32; 3] {
    let raw = raw_cell_of(p, params);
    [0, 1, 2].map(|g| {
        let below = params.folds[g].iter().filter(|[_, to]| *to <= raw[g]);
        raw[g] as i32 - below.map(|[from, to]| to - from).sum::<u32>() as i32
    })
}

/// A position in cells along the grid's axes, as file coordinates.
pub fn to_file(q: [f64; 3], params: &Params) -> [f64; 3] {
    let mut t = [0.0; 3];
    for (g, f) in params.axis.permutation().into_iter().enumerate() {
        let mut left_out = 0;
        for [from, to] in &params.folds[g] {
            // The plane that a fold has become.
            if q[g] >= f64::from(from - left_out) {
                left_out += to - from;
            }
        }
        t[f] = params.min[f] + params.w * (q[g] + f64::from(left_out));
    }
    match params.turn {
        Some([x, y, z]) => [0, 1, 2].map(|a| x[a] * t[0] + y[a] * t[1] + z[a] * t[2]),
        None => t,
    }
}

/// A point's place in its cell, from 0 to 1 along the grid's axes.
pub fn place_in_cell(p: [f64; 3], params: &Params) -> [f64; 3] {
    let raw = raw_cell_of(p, params);
    let files = params.axis.permutation();
    [0, 1, 2].map(|g| {
        let along = (own(p, params)[files[g]] - params.min[files[g]]) * (1.0 / params.w);
        (along - f64::from(raw[g])).clamp(0.0, 1.0)
    })
}
