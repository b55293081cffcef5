//! Dipoles: what walls add to the winding number. A wall's is as long as its area: what in its plane is nearer to its mean than to those of the walls round it.
//!
//! ```text
//!    \  +---+   /
//!  x  \ |   |  /   x       a polygon round the mean o, cut half way to each other wall x
//!      +  o  +
//!   x   \   /    x
//!        +-+
//! ```

use bytemuck::{Pod, Zeroable};

use super::layers::{Held, Rounds};
use super::wall::{THIN, Wall};
use crate::points::vector::{cross, dot, minus, times};

/// What a wall adds to the winding number round it, and what share of its cell is inside.
#[derive(Debug, Clone, Copy, Default, PartialEq, Zeroable, Pod)]
#[repr(C)]
pub struct Dipole {
    /// The mean of its points, from its lowest corner, in cells.
    pub mean: [f32; 3],
    /// Towards the outside, as long as its area, in squared cells; 0 if its sign is not known.
    pub area: [f32; 3],
    /// The share of its cell that is inside.
    pub inside: f32,
}

impl Dipole {
    /// Of a wall whose sign has been looked for.
    pub fn of(wall: &Wall, cell: [i64; 3], areas: &mut Areas) -> Dipole {
        let normal = wall.across();
        let side = f64::from(wall.sign);
        let inside = match wall.sign {
            0 if wall.kind == THIN => 0.5,
            0 => 1.0,
            _ => {
                let middle = wall.mean.map(|c| f64::from(c) - 0.5);
                (0.5 + side * dot(normal, middle)).clamp(0.0, 1.0) as f32
            }
        };
        let area = if wall.sign == 0 { 0.0 } else { side * areas.of(wall, cell) };
        Dipole { mean: wall.mean, area: normal.map(|c| (area * c) as f32), inside }
    }
}

/// The polygon that is cut: its radius, in cells, and the directions of its corners.
const RADIUS: f64 = 2.2;
const HALF_ROOT: f64 = 0.866_025_403_784_438_6;
const CORNERS: [[f64; 2]; 12] = [
    [1.0, 0.0],
    [HALF_ROOT, 0.5],
    [0.5, HALF_ROOT],
    [0.0, 1.0],
    [-0.5, HALF_ROOT],
    [-HALF_ROOT, 0.5],
    [-1.0, 0.0],
    [-HALF_ROOT, -0.5],
    [-0.5, -HALF_ROOT],
    [0.0, -1.0],
    [0.5, -HALF_ROOT],
    [HALF_ROOT, -0.5],
];

/// Cells round a wall that bound its area, either way.
pub const BOUNDS: i64 = 3;

/// Walls as near as this, in half squared cells, cut before the others: few of those reach what is left.
const NEAR: f64 = 1.5;

/// What is left of a polygon that vanished, in squared cells.
const VANISHED: f64 = 0.1;

/// Areas of one wall after the other.
pub struct Areas<'a> {
    walls: Rounds<'a, Wall>,
    /// Walls that are not near, as they cut.
    others: Vec<Cut>,
    polygon: Polygon,
}

/// Cuts off what is nearer to a place than to the mean.
#[derive(Debug, Clone, Copy)]
struct Cut {
    /// Where the place lies in the plane.
    to: [f64; 2],
    /// Half its squared distance, in space.
    half: f64,
}

impl<'a> Areas<'a> {
    /// Among walls that are known in [`BOUNDS`] cells round those that are asked for.
    pub fn new(walls: &'a Held<Wall>) -> Areas<'a> {
        let polygon = Polygon { corners: Vec::new(), left: Vec::new(), farthest: 0.0 };
        Areas { walls: Rounds::new(walls, BOUNDS), others: Vec::new(), polygon }
    }

    /// The area of a wall, in squared cells.
    pub fn of(&mut self, wall: &Wall, cell: [i64; 3]) -> f64 {
        let Areas { walls, others, polygon } = self;
        others.clear();
        polygon.begin();
        each_cut(wall, cell, walls, |cut| if cut.half <= NEAR { polygon.cut(cut) } else { others.push(cut) });
        others.iter().for_each(|cut| polygon.cut(*cut));
        polygon.area()
    }
}

/// Calls `each` with how the walls round one cut, but for those behind it.
fn each_cut(wall: &Wall, cell: [i64; 3], walls: &mut Rounds<Wall>, mut each: impl FnMut(Cut)) {
    let (normal, at) = (wall.across(), wall.at(cell));
    let aside = if normal[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let first = cross(normal, aside);
    let first = times(1.0 / dot(first, first).sqrt(), first);
    let second = cross(normal, first);
    walls.round(cell, |other, neighbour| {
        if other == cell {
            return;
        }
        let d = minus(neighbour.at(other), at);
        let cosine = dot(normal, neighbour.across());
        let behind = match wall.sign * neighbour.sign {
            0 => cosine.abs() > 0.7 && dot(d, normal).abs() > 0.6,
            same => cosine * f64::from(same) < -0.3,
        };
        if !behind {
            each(Cut { to: [dot(d, first), dot(d, second)], half: 0.5 * dot(d, d) });
        }
    });
}

/// What is left round a wall's mean, in its plane.
struct Polygon {
    corners: Vec<[f64; 2]>,
    /// Those that the cut at hand leaves.
    left: Vec<[f64; 2]>,
    /// Of the corner that is farthest from the mean, the squared distance; a little more.
    farthest: f64,
}

impl Polygon {
    /// Nothing is cut off.
    fn begin(&mut self) {
        self.corners.clear();
        self.corners.extend(CORNERS.map(|corner| corner.map(|c| RADIUS * c)));
        self.farthest = RADIUS * RADIUS * (1.0 + 1e-9);
    }

    fn cut(&mut self, Cut { to: [x, y], half }: Cut) {
        let aside = x * x + y * y;
        if aside < 1e-8 || half * half >= self.farthest * aside {
            return;
        }
        let Some(last) = self.corners.last() else { return };
        let beyond = |p: &[f64; 2]| p[0] * x + p[1] * y - half;
        self.left.clear();
        self.farthest = 0.0;
        let (mut from, mut a) = (*last, beyond(last));
        for to in &self.corners {
            let b = beyond(to);
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                let t = a / (a - b);
                self.left.push([from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])]);
            }
            if b <= 0.0 {
                self.left.push(*to);
            }
            (from, a) = (*to, b);
        }
        std::mem::swap(&mut self.corners, &mut self.left);
        self.farthest = self.corners.iter().map(|[x, y]| x * x + y * y).fold(0.0, f64::max) * (1.0 + 1e-9);
        if self.corners.len() < 3 {
            self.corners.clear();
        }
    }

    fn area(&self) -> f64 {
        let Some(last) = self.corners.last() else { return VANISHED };
        let mut from = last;
        let mut sum = 0.0;
        for to in &self.corners {
            sum += from[0] * to[1] - from[1] * to[0];
            from = to;
        }
        0.5 * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::slice::Runs;
    use crate::solid::reopen::layers::Cells;
    use proptest::prelude::*;

    /// The naive twin: all walls cut, in the order of cells, and each goes round all corners.
    fn naive(wall: &Wall, cell: [i64; 3], held: &Held<Wall>) -> f64 {
        let mut polygon: Vec<[f64; 2]> = CORNERS.map(|corner| corner.map(|c| RADIUS * c)).into();
        each_cut(wall, cell, &mut Rounds::new(held, BOUNDS), |Cut { to: [x, y], half }| {
            if x * x + y * y < 1e-8 {
                return;
            }
            let beyond = |p: [f64; 2]| p[0] * x + p[1] * y - half;
            let mut left = Vec::new();
            for (number, from) in polygon.iter().enumerate() {
                let to = polygon[(number + 1) % polygon.len()];
                let (a, b) = (beyond(*from), beyond(to));
                if a <= 0.0 {
                    left.push(*from);
                }
                if a * b < 0.0 {
                    let t = a / (a - b);
                    left.push([0, 1].map(|i| from[i] + t * (to[i] - from[i])));
                }
            }
            polygon = left;
        });
        let pairs = polygon.iter().zip(polygon.iter().cycle().skip(1));
        0.5 * pairs.map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>()
    }

    fn walls() -> impl Strategy<Value = Vec<Option<Wall>>> {
        let wall = (prop::array::uniform3(0.0f32..1.0), prop::array::uniform3(-1.0f64..1.0), -1i8..=1);
        let wall = wall.prop_map(|(mean, n, sign)| {
            let n = [n[0], n[1], n[2] + 1.5];
            let normal = times(1.0 / dot(n, n).sqrt(), n).map(|c| c as f32);
            Wall { mean, normal, sign, confidence: 1.0, ..Wall::default() }
        });
        prop::collection::vec(prop::option::weighted(0.25, wall), 7 * 7 * 7)
    }

    proptest! {
        #[test]
        fn areas_are_those_that_all_cuts_leave(walls in walls()) {
            let mut walls = walls.into_iter();
            let slices = (0..7).map(|_| {
                let (mut runs, mut values) = (Runs::default(), Vec::new());
                for _ in 0..7 {
                    for x in 0..7 {
                        if let Some(wall) = walls.next().flatten() {
                            runs.push_run(x, x + 1);
                            values.push(wall);
                        }
                    }
                    runs.end_row();
                }
                (Cells::of(&runs), values)
            });
            let held = Held::of(0, slices.collect());
            let mut areas = Areas::new(&held);
            let (cells, values) = held.slice(3);
            for ((z, x), wall) in cells.iter().zip(values) {
                let cell = [x.into(), 3, z.into()];
                let (found, expected) = (areas.of(wall, cell), naive(wall, cell, &held));
                prop_assert!((found - expected).abs() < 1e-9 || (found == VANISHED && expected < 1e-9), "{found} for {expected}");
            }
        }
    }
}
