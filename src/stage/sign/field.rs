//! The field u, and its least by conjugate gradients.
//!
//! All sums are formed in the order of cells and walls, on one thread: the field is the same bits everywhere.

use super::block::Block;
use super::normal::Wall;
use super::{Side, support};

/// What a face weighs if one of its cells lies between two occupied ones: a gap in a wall, as sparse sampling leaves.
const GAP: f32 = 0.1;

/// The residual, as a part of the first one, at which the search ends.
const TOLERANCE: f64 = 1e-3;

/// The most steps of the search. It takes about as many as the longest side has cells.
const STEPS: usize = 1000;

/// Fewer enclosed cells are no cavity.
const CAVITY: usize = 27;

const NONE: u32 = u32::MAX;

/// The field on the free cells of a block.
#[derive(Debug)]
pub struct Field<'a> {
    pub(super) block: &'a Block,
    occupied: &'a [bool],
    /// Cells with an occupied one among the 26 round them.
    pub(super) lined: Vec<bool>,
    gaps: Vec<bool>,
    /// Cells that are outside, whatever the field.
    outside: Vec<bool>,
    /// Of each cell, its number among those whose u is looked for.
    number: Vec<u32>,
    /// These cells.
    pub(super) cells: Vec<u32>,
    /// Their u.
    pub(super) u: Vec<f32>,
}

impl<'a> Field<'a> {
    /// The field that is −1 on the cells `outside`.
    pub fn new(block: &'a Block, occupied: &'a [bool], walls: &[u32], outside: Vec<bool>) -> Field<'a> {
        let mut lined = vec![false; occupied.len()];
        for step in block.around() {
            walls.iter().for_each(|&wall| lined[(wall as usize).wrapping_add_signed(step)] = true);
        }
        let opposite: Vec<isize> = block.around().into_iter().filter(|step| *step > 0).collect();
        let mut gaps = vec![false; occupied.len()];
        for cell in (0..occupied.len()).filter(|&cell| lined[cell] && !occupied[cell] && !block.at_border(cell)) {
            gaps[cell] = opposite
                .iter()
                .any(|&step| occupied[cell.wrapping_add_signed(step)] && occupied[cell.wrapping_add_signed(-step)]);
        }
        let mut field = Field {
            block,
            occupied,
            lined,
            gaps,
            outside,
            number: vec![NONE; occupied.len()],
            cells: Vec::new(),
            u: Vec::new(),
        };
        field.renumber();
        field
    }

    fn renumber(&mut self) {
        let before = std::mem::take(&mut self.u);
        let mut cells = Vec::new();
        let mut u = Vec::new();
        for cell in 0..self.number.len() {
            let old = std::mem::replace(&mut self.number[cell], NONE);
            if !self.occupied[cell] && !self.outside[cell] {
                self.number[cell] = cells.len() as u32;
                cells.push(cell as u32);
                u.push(before.get(old as usize).copied().unwrap_or(0.0));
            }
        }
        (self.cells, self.u) = (cells, u);
    }

    /// The number of a cell, if its u is looked for.
    pub(super) fn number(&self, cell: usize) -> Option<usize> {
        Some(self.number[cell]).filter(|n| *n != NONE).map(|n| n as usize)
    }

    /// Whether two free cells lie on the same side.
    pub(super) fn same_side(&self, [a, b]: [u32; 2]) -> bool {
        self.is_outside(a as usize) == self.is_outside(b as usize)
    }

    /// Whether nothing stands between two cells that share a face: neither is occupied, nor a gap between occupied ones.
    pub(super) fn is_open(&self, a: usize, b: usize) -> bool {
        !(self.occupied[a] || self.occupied[b] || self.gaps[a] || self.gaps[b])
    }

    /// Whether a cell is free and outside.
    pub(super) fn is_outside(&self, cell: usize) -> bool {
        match self.number(cell) {
            Some(number) => self.u[number] <= 0.0,
            None => !self.occupied[cell],
        }
    }

    fn weight(&self, a: usize, b: usize) -> f32 {
        if self.gaps[a] | self.gaps[b] { GAP } else { 1.0 }
    }

    /// Finds the u that makes E least, from where it is.
    pub fn solve(&mut self, walls: &[Wall]) {
        let n = self.cells.len();
        let strides = self.block.strides();
        let (mut diagonal, mut b) = (vec![1e-9f32; n], vec![0f32; n]);
        for (i, &cell) in self.cells.iter().enumerate() {
            let cell = cell as usize;
            for next in strides.into_iter().flat_map(|s| [cell.wrapping_add_signed(-s), cell.wrapping_add_signed(s)]) {
                if !self.occupied[next] {
                    let weight = self.weight(cell, next);
                    diagonal[i] += weight;
                    if self.outside[next] {
                        b[i] -= weight;
                    }
                }
            }
        }
        let mut pairs = Vec::with_capacity(walls.len());
        for wall in walls {
            match wall.sides.map(|cell| self.number(cell as usize)) {
                [Some(i), Some(j)] => {
                    diagonal[i] += wall.weight;
                    diagonal[j] += wall.weight;
                    pairs.push(([i as u32, j as u32], wall.weight));
                }
                [Some(i), None] | [None, Some(i)] => {
                    diagonal[i] += wall.weight;
                    b[i] += wall.weight;
                }
                [None, None] => {}
            }
        }
        let mut u = std::mem::take(&mut self.u);
        let product = |x: &[f32], out: &mut [f32]| {
            for (i, &cell) in self.cells.iter().enumerate() {
                let cell = cell as usize;
                let mut sum = diagonal[i] * x[i];
                for s in strides {
                    for next in [cell.wrapping_add_signed(-s), cell.wrapping_add_signed(s)] {
                        let j = self.number[next];
                        if j != NONE {
                            sum -= self.weight(cell, next) * x[j as usize];
                        }
                    }
                }
                out[i] = sum;
            }
            for &([i, j], weight) in &pairs {
                out[i as usize] += weight * x[j as usize];
                out[j as usize] += weight * x[i as usize];
            }
        };
        conjugate_gradients(product, &diagonal, &b, &mut u);
        self.u = u;
    }

    /// Lets the outside into the components that are `bare` (by number), as far as it is `reached`.
    pub fn open(&mut self, bare: &[bool], reached: &[bool]) {
        for (&cell, bare) in self.cells.iter().zip(bare) {
            self.outside[cell as usize] |= bare & reached[cell as usize];
        }
        self.renumber();
    }

    /// Gives all that is `bare` (by number) to the outside.
    pub fn give_up(&mut self, bare: &[bool]) {
        self.u.iter_mut().zip(bare).filter(|(_, bare)| **bare).for_each(|(u, _)| *u = -1.0);
    }

    /// The side of every cell. What is not inside is outside if a path of such cells leads to what was outside from the start. Else it is enclosed: a cavity if
    /// walls line it ([`support::is_lined`]), and else inside.
    pub fn sides(&self) -> Vec<Side> {
        let mut sides: Vec<Side> =
            self.occupied.iter().map(|occupied| if *occupied { Side::Wall } else { Side::Inside }).collect();
        let starts = (0..sides.len()).filter(|&cell| self.outside[cell] && !self.occupied[cell]).collect();
        self.spread(&mut sides, starts, |_| {});
        for cell in 0..sides.len() {
            if sides[cell] == Side::Inside && self.is_outside(cell) {
                let mut enclosed = Vec::new();
                self.spread(&mut sides, vec![cell], |cell| enclosed.push(cell));
                if enclosed.len() < CAVITY || !support::is_lined(self, &enclosed) {
                    // Not outside, and not to be found again.
                    enclosed.into_iter().for_each(|cell| sides[cell] = Side::Enclosed);
                }
            }
        }
        sides.iter_mut().filter(|side| **side == Side::Enclosed).for_each(|side| *side = Side::Inside);
        sides
    }

    /// Makes cells that are not inside outside, and all that faces join to them.
    fn spread(&self, sides: &mut [Side], mut stack: Vec<usize>, mut found: impl FnMut(usize)) {
        let strides = self.block.strides();
        for &cell in &stack {
            sides[cell] = Side::Outside;
        }
        while let Some(cell) = stack.pop() {
            found(cell);
            if self.block.at_border(cell) {
                continue;
            }
            for next in strides.into_iter().flat_map(|s| [cell.wrapping_add_signed(-s), cell.wrapping_add_signed(s)]) {
                if sides[next] == Side::Inside && self.is_outside(next) {
                    sides[next] = Side::Outside;
                    stack.push(next);
                }
            }
        }
    }
}

/// Solves A x = b for a positive definite A, given as its product with a vector, and its diagonal; from x on.
pub(super) fn conjugate_gradients(product: impl Fn(&[f32], &mut [f32]), diagonal: &[f32], b: &[f32], x: &mut [f32]) {
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    let mut out = vec![0f32; b.len()];
    product(x, &mut out);
    let mut r: Vec<f32> = b.iter().zip(&out).map(|(b, a)| b - a).collect();
    let mut p: Vec<f32> = r.iter().zip(diagonal).map(|(r, d)| r / d).collect();
    let mut rz = dot(&r, &p);
    let enough = TOLERANCE * TOLERANCE * dot(b, b);
    for _ in 0..STEPS {
        if dot(&r, &r) <= enough {
            return;
        }
        product(&p, &mut out);
        let alpha = (rz / dot(&p, &out)) as f32;
        for i in 0..x.len() {
            x[i] += alpha * p[i];
            r[i] -= alpha * out[i];
        }
        let next = r.iter().zip(diagonal).map(|(r, d)| f64::from(*r) * f64::from(*r / *d)).sum::<f64>();
        let beta = (next / rz) as f32;
        rz = next;
        for i in 0..x.len() {
            p[i] = r[i] / diagonal[i] + beta * p[i];
        }
    }
}
