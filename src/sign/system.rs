//! Linear systems over cells of a block, solved by conjugate gradients.
//!
//! The unknowns u make Σ w_ij (u_i − u_j)² + Σ w_ab (u_a + u_b)² least: the first sum over pairs of cells that share a face, of which u is looked for
//! in one at least, the second over pairs of cells that lie on both sides of a wall.
//!
//! Vectors have a number for each cell of the block, and so a row of cells is a row of numbers, as SIMD likes it. Work is dealt out in slices, and sums
//! are formed slice by slice, in order: the solution is the same bits for any number of threads.
//!
//! Source of the method: M. R. Hestenes and E. Stiefel, *Methods of Conjugate Gradients for Solving Linear Systems* (1952); Jacobi's preconditioner.

use std::ops::Range;

use rayon::prelude::*;

use super::block::Block;
use crate::resources::workers::Workers;

/// The residual, as a part of the right side, at which the search ends.
const TOLERANCE: f64 = 1e-3;

/// The most steps of the search. It takes about as many as the longest side has cells.
const STEPS: usize = 1000;

/// Cells closer than this in a row are worked on together, whether u is looked for between them or not.
const NEAR: usize = 8;

/// Makes the matrix positive definite where a component of unknowns touches nothing known.
const LEAST: f32 = 1e-9;

/// The term of a cell with another one across a wall.
#[derive(Debug, Clone, Copy)]
struct Across {
    cell: u32,
    other: u32,
    weight: f32,
}

/// A system.
#[derive(Debug)]
pub struct System<'a> {
    block: &'a Block,
    /// The weight of a face between each cell and an equally open one; between two cells the lesser weight counts. 0 where u is not looked for.
    open: &'a [f32],
    /// For each slice: ranges that hold all cells in which u is looked for.
    spans: Vec<Vec<Range<usize>>>,
    /// The terms across walls, slice by slice.
    across: Vec<Vec<Across>>,
    diagonal: Vec<f32>,
    right: Vec<f32>,
}

impl<'a> System<'a> {
    /// The system of the cells that are `open`, none of which lies at the block's border. `known` gives the weight of the face between such a cell and
    /// one of which u is not looked for, and the u there; none if there is a wall.
    pub fn new(
        block: &'a Block,
        open: &'a [f32],
        workers: &Workers,
        known: impl Fn(usize, usize) -> Option<(f32, f32)> + Sync,
    ) -> System<'a> {
        let slice = block.rows * block.width;
        let (mut diagonal, mut right) = (vec![0f32; open.len()], vec![0f32; open.len()]);
        let spans = workers.pool().install(|| {
            let work = |(y, (diagonal, right)): (usize, (&mut [f32], &mut [f32]))| {
                let spans = spans(open, y * slice, slice, block.width);
                for cell in spans.iter().cloned().flatten().filter(|&cell| open[cell] > 0.0) {
                    let (mut sum, mut known_sum) = (LEAST, 0f32);
                    for next in block.beside(cell) {
                        if open[next] > 0.0 {
                            sum += open[cell].min(open[next]);
                        } else if let Some((weight, u)) = known(cell, next) {
                            sum += weight;
                            known_sum += weight * u;
                        }
                    }
                    (diagonal[cell - y * slice], right[cell - y * slice]) = (sum, known_sum);
                }
                spans
            };
            diagonal.par_chunks_mut(slice).zip(right.par_chunks_mut(slice)).enumerate().map(work).collect()
        });
        System { block, open, spans, across: vec![Vec::new(); block.slices], diagonal, right }
    }

    /// Adds the term `weight` (u_a + u_b)². `known` is the u of cells in which it is not looked for.
    pub fn across(&mut self, [a, b]: [u32; 2], weight: f32, known: impl Fn(u32) -> f32) {
        let slice = self.block.rows * self.block.width;
        for (cell, other) in [(a, b), (b, a)] {
            if self.open[cell as usize] == 0.0 {
                continue;
            }
            self.diagonal[cell as usize] += weight;
            if self.open[other as usize] > 0.0 {
                self.across[cell as usize / slice].push(Across { cell, other, weight });
            } else {
                self.right[cell as usize] -= weight * known(other);
            }
        }
    }

    /// Solves the system, from `u` on: a number for each cell of the block, of which those count in which u is looked for.
    pub fn solve(self, u: &mut [f32], workers: &Workers) {
        workers.pool().install(|| self.conjugate_gradients(u));
    }

    fn conjugate_gradients(mut self, u: &mut [f32]) {
        let slice = self.block.rows * self.block.width;
        let n = self.open.len();
        let mut r = std::mem::take(&mut self.right);
        let (mut p, mut out) = (vec![0f32; n], vec![0f32; n]);
        self.product(u, &mut out);
        let slices = r.par_chunks_mut(slice).zip(p.par_chunks_mut(slice)).zip(out.par_chunks(slice)).enumerate();
        let starts = slices.map(|(y, ((r, p), out))| {
            let (mut b, mut rr, mut rz) = (Sum::default(), Sum::default(), Sum::default());
            for span in self.local_spans(y) {
                let d = &self.diagonal[y * slice..][span.clone()];
                let (r, p, out) = (&mut r[span.clone()], &mut p[span.clone()], &out[span]);
                b.add(r, r);
                r.iter_mut().zip(out).for_each(|(r, out)| *r -= out);
                p.iter_mut().zip(&*r).zip(d).for_each(|((p, r), d)| *p = r / d.max(LEAST));
                rr.add(r, r);
                rz.add(r, p);
            }
            [b, rr, rz].map(Sum::total)
        });
        let [b, mut rr, mut rz] = total(starts.collect());
        for _ in 0..STEPS {
            if rr <= TOLERANCE * TOLERANCE * b {
                return;
            }
            let alpha = (rz / self.product(&p, &mut out)) as f32;
            let of = (p.par_chunks(slice), out.par_chunks(slice));
            let slices = u.par_chunks_mut(slice).zip(r.par_chunks_mut(slice)).zip(of.0.zip(of.1)).enumerate();
            let steps = slices.map(|(y, ((u, r), (p, out)))| {
                let (mut rr, mut rz) = (Sum::default(), Sum::default());
                for span in self.local_spans(y) {
                    let d = &self.diagonal[y * slice..][span.clone()];
                    let (u, r) = (&mut u[span.clone()], &mut r[span.clone()]);
                    let (p, out) = (&p[span.clone()], &out[span]);
                    u.iter_mut().zip(p).for_each(|(u, p)| *u += alpha * p);
                    r.iter_mut().zip(out).for_each(|(r, out)| *r = normal(*r - alpha * out));
                    rr.add(r, r);
                    rz.add_over(r, d);
                }
                [rr, rz].map(Sum::total)
            });
            let [new_rr, new_rz] = total(steps.collect());
            let beta = (new_rz / rz) as f32;
            (rr, rz) = (new_rr, new_rz);
            p.par_chunks_mut(slice).zip(r.par_chunks(slice)).enumerate().for_each(|(y, (p, r))| {
                for span in self.local_spans(y) {
                    let d = &self.diagonal[y * slice..][span.clone()];
                    let (p, r) = (&mut p[span.clone()], &r[span]);
                    p.iter_mut().zip(r).zip(d).for_each(|((p, r), d)| *p = normal(r / d.max(LEAST) + beta * *p));
                }
            });
        }
    }

    /// The spans of slice `y`, counted from its first cell.
    fn local_spans(&self, y: usize) -> impl Iterator<Item = Range<usize>> {
        let first = y * self.block.rows * self.block.width;
        self.spans[y].iter().map(move |span| span.start - first..span.end - first)
    }

    /// The matrix times `x`, and the product of both.
    fn product(&self, x: &[f32], out: &mut [f32]) -> f64 {
        let slice = self.block.rows * self.block.width;
        let work = |(y, out): (usize, &mut [f32])| {
            for (span, local) in self.spans[y].iter().zip(self.local_spans(y)) {
                let out = &mut out[local];
                let own = &x[span.clone()];
                for ((out, x), d) in out.iter_mut().zip(own).zip(&self.diagonal[span.clone()]) {
                    *out = d * x;
                }
                for s in self.block.strides().into_iter().flat_map(|s| [-s, s]) {
                    let next = span.start.wrapping_add_signed(s)..span.end.wrapping_add_signed(s);
                    less_next(out, &self.open[span.clone()], &self.open[next.clone()], &x[next]);
                }
            }
            for across in &self.across[y] {
                out[across.cell as usize - y * slice] += across.weight * x[across.other as usize];
            }
            let mut sum = Sum::default();
            for (span, local) in self.spans[y].iter().zip(self.local_spans(y)) {
                sum.add(&x[span.clone()], &out[local]);
            }
            [sum.total()]
        };
        let [sum] = total(out.par_chunks_mut(slice).enumerate().map(work).collect());
        sum
    }
}

/// Takes from `out` what the faces to the next cells add: the lesser openness of both, times `x` there.
fn less_next(out: &mut [f32], open: &[f32], next: &[f32], x: &[f32]) {
    let n = out.len();
    let (open, next, x) = (&open[..n], &next[..n], &x[..n]);
    for i in 0..n {
        out[i] -= if next[i] < open[i] { next[i] } else { open[i] } * x[i];
    }
}

/// Less than this is 0. The search spreads by a cell a step, and grows fainter by more than half: numbers too small to be normal ones, which are slow, would be
/// next.
const TINY: f32 = 1e-20;

fn normal(value: f32) -> f32 {
    if value.abs() < TINY { 0.0 } else { value }
}

/// The ranges of a slice's cells that hold all that are open, the first cell being `first`.
fn spans(open: &[f32], first: usize, slice: usize, width: usize) -> Vec<Range<usize>> {
    let mut spans: Vec<Range<usize>> = Vec::new();
    for row in (first..first + slice).step_by(width) {
        let from = spans.len();
        for cell in (row..row + width).filter(|&cell| open[cell] > 0.0) {
            match spans[from..].last_mut() {
                Some(span) if span.end + NEAR > cell => span.end = cell + 1,
                _ => spans.push(cell..cell + 1),
            }
        }
    }
    spans
}

/// The sums of all slices, in their order.
fn total<const N: usize>(of: Vec<[f64; N]>) -> [f64; N] {
    of.into_iter().fold([0.0; N], |mut sums, of| {
        sums.iter_mut().zip(of).for_each(|(sum, of)| *sum += of);
        sums
    })
}

/// A sum of products in double precision, of which eight parts grow side by side.
#[derive(Default)]
struct Sum([f64; 8]);

impl Sum {
    fn add(&mut self, a: &[f32], b: &[f32]) {
        self.each(a, b, |a, b| f64::from(a) * f64::from(b));
    }

    /// Adds a² / d.
    fn add_over(&mut self, a: &[f32], d: &[f32]) {
        self.each(a, d, |a, d| f64::from(a) * f64::from(a / d.max(LEAST)));
    }

    fn each(&mut self, a: &[f32], b: &[f32], product: impl Fn(f32, f32) -> f64) {
        let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
        let rest = a8.remainder().iter().zip(b8.remainder());
        rest.zip(&mut self.0).for_each(|((a, b), sum)| *sum += product(*a, *b));
        for (a, b) in a8.zip(b8) {
            for ((sum, a), b) in self.0.iter_mut().zip(a).zip(b) {
                *sum += product(*a, *b);
            }
        }
    }

    fn total(self) -> f64 {
        self.0.into_iter().sum()
    }
}
