//! Bodies and sheets, turned at random, by their distances; and the cells that sample them.

use super::super::block::Block;
use super::{Numbers, dot, marked};

/// What a body is, in its own axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    Sphere {
        radius: f64,
    },
    Brick {
        half: [f64; 3],
    },
    Torus {
        large: f64,
        small: f64,
    },
    /// A sphere in a sphere: what lies between is the body.
    Hollow {
        outer: f64,
        inner: f64,
    },
    /// A sphere's part within an angle of its top: a sheet. The middle of its rim is the origin's.
    Bowl {
        radius: f64,
        angle: f64,
    },
    Plane {
        half: [f64; 2],
    },
}

/// A shape that is turned and moved, with a hole in its wall.
#[derive(Debug, Clone, Copy)]
pub struct Body {
    pub shape: Shape,
    pub axes: [[f64; 3]; 3],
    middle: [f64; 3],
    pub size: usize,
    /// Middle and radius of a hole, in the block.
    pub hole: Option<([f64; 3], f64)>,
}

impl Body {
    pub fn new(shape: Shape, longest: f64, numbers: &mut Numbers) -> Body {
        let z = numbers.direction();
        let other = loop {
            let other = numbers.direction();
            if dot(z, other).abs() < 0.9 {
                break other;
            }
        };
        let x = cross(z, other);
        let x = x.map(|c| c / dot(x, x).sqrt());
        let axes = [x, cross(z, x), z];
        // The longest diagonal that a turned brick of the longest side may have, and a cell more.
        let size = (longest * 3f64.sqrt()) as usize + 4;
        let middle = [(); 3].map(|()| size as f64 / 2.0 + numbers.between(-0.5, 0.5));
        Body { shape, axes, middle, size, hole: None }
    }

    /// A closed body whose longest side is `longest`.
    pub fn closed(numbers: &mut Numbers, longest: f64) -> Body {
        let half = longest / 2.0;
        let shape = match numbers.below(3) {
            0 => Shape::Sphere { radius: half },
            1 => Shape::Brick { half: [half, numbers.between(0.3, 1.0) * half, numbers.between(0.3, 1.0) * half] },
            _ => {
                let small = numbers.between(0.2, 0.35) * half;
                Shape::Torus { large: half - small, small }
            }
        };
        Body::new(shape, longest, numbers)
    }

    /// A sphere or a brick with a hole whose width is a part of the longest side.
    pub fn with_hole(numbers: &mut Numbers, longest: f64, part: f64) -> Body {
        let half = longest / 2.0;
        let (shape, top) = if numbers.below(2) == 0 {
            (Shape::Sphere { radius: half }, half)
        } else {
            let height = numbers.between(0.5, 1.0) * half;
            (Shape::Brick { half: [half, numbers.between(0.6, 1.0) * half, height] }, height)
        };
        let mut body = Body::new(shape, longest, numbers);
        let at = [0, 1, 2].map(|a| body.middle[a] + top * body.axes[2][a]);
        body.hole = Some((at, part * longest / 2.0));
        body
    }

    pub fn sheet(numbers: &mut Numbers, longest: f64) -> Body {
        let half = longest / 2.0;
        let shape = if numbers.below(2) == 0 {
            Shape::Plane { half: [half, numbers.between(0.5, 1.0) * half] }
        } else {
            let angle = numbers.between(20f64, 60.0).to_radians();
            Shape::Bowl { radius: half / angle.sin(), angle }
        };
        Body::new(shape, longest, numbers)
    }

    pub fn any(numbers: &mut Numbers, longest: f64) -> Body {
        match numbers.below(3) {
            0 => Body::closed(numbers, longest),
            1 => {
                let part = numbers.between(0.05, 0.25);
                Body::with_hole(numbers, longest, part)
            }
            _ => Body::sheet(numbers, longest),
        }
    }

    pub fn is_sheet(&self) -> bool {
        matches!(self.shape, Shape::Plane { .. } | Shape::Bowl { .. })
    }

    /// The distance to the wall, less than 0 within the body. Sheets have no such side.
    pub fn height(&self, cell: [usize; 3]) -> f64 {
        let from: [f64; 3] = [0, 1, 2].map(|a| cell[a] as f64 + 0.5 - self.middle[a]);
        let p = self.axes.map(|axis| dot(axis, from));
        let length = dot(p, p).sqrt();
        match self.shape {
            Shape::Sphere { radius } => length - radius,
            Shape::Hollow { outer, inner } => (length - outer).max(inner - length),
            Shape::Brick { half } => {
                let over: [f64; 3] = [0, 1, 2].map(|a| p[a].abs() - half[a]);
                let beyond = over.map(|c| c.max(0.0));
                dot(beyond, beyond).sqrt() + over.into_iter().fold(f64::NEG_INFINITY, f64::max).min(0.0)
            }
            Shape::Torus { large, small } => (p[0].hypot(p[1]) - large).hypot(p[2]) - small,
            Shape::Plane { half } => {
                let over = [p[0].abs() - half[0], p[1].abs() - half[1]].map(|c| c.max(0.0));
                over[0].hypot(over[1]).hypot(p[2])
            }
            Shape::Bowl { radius, angle } => {
                // From the sphere's middle, which lies below the rim's.
                let q = [p[0].hypot(p[1]), p[2] + radius * angle.cos()];
                if q[0].atan2(q[1]) <= angle {
                    (q[0].hypot(q[1]) - radius).abs()
                } else {
                    (q[0] - radius * angle.sin()).hypot(p[2])
                }
            }
        }
    }

    /// How far a cell is from the edge of the hole's disc or within it.
    pub fn distance_from_hole(&self, cell: [usize; 3]) -> f64 {
        self.hole.map_or(f64::INFINITY, |(at, radius)| {
            (0..3).map(|a| (cell[a] as f64 + 0.5 - at[a]).powi(2)).sum::<f64>().sqrt() - radius
        })
    }

    /// The cells next to the wall, without as large a part of them.
    pub fn sampled(&self, missing: f64, numbers: &mut Numbers) -> (Block, Vec<bool>) {
        let near = |cell: &[usize; 3]| self.height(*cell).abs() <= 0.7 && self.distance_from_hole(*cell) > 0.0;
        // The block ends where the body does, as that of a cloud does.
        let all = Block::new([self.size as u32; 3]);
        let cells: Vec<[usize; 3]> =
            super::level(all.cells).filter(near).filter(|_| numbers.part() >= missing).collect();
        let mut occupied = vec![false; all.size()];
        cells.iter().for_each(|cell| occupied[all.index(*cell)] = true);
        (all, occupied)
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}

#[test]
fn the_cells_of_a_sphere_are_as_many_as_its_area_and_lie_on_it() {
    let body = Body::new(Shape::Sphere { radius: 10.0 }, 20.0, &mut Numbers::new(1));
    let (block, occupied) = body.sampled(0.0, &mut Numbers::new(2));
    let count = occupied.iter().filter(|o| **o).count() as f64;
    let shell = 4.0 * std::f64::consts::PI * 100.0 * 1.4;
    assert!((0.9..1.1).contains(&(count / shell)), "{count} of {shell}");
    let inner = marked(&block, |cell| body.height(*cell) < -0.7);
    assert!(inner.iter().zip(&occupied).all(|(inner, occupied)| !(inner & occupied)));
}
