//! Linear systems over cells of a block, solved by conjugate gradients.
//!
//! The unknowns u make Σ w_ij (u_i − u_j)² + Σ w_ab (u_a + u_b)² least: the first sum over pairs of cells that share a face, of which u is looked for
//! in one at least, the second over pairs of cells that lie on both sides of a wall.
//!
//! Vectors have a number for each cell of the block, and so a row of cells is a row of numbers, as SIMD likes it. Work is dealt out in slices, and sums
//! are formed slice by slice, in order: the solution is the same bits for any number of threads. The loops over a row are compiled once more for processors with AVX2;
//! they do the same operations in the same order, and so give the same bits.
//!
//! Source of the method: M. R. Hestenes and E. Stiefel, *Methods of Conjugate Gradients for Solving Linear Systems* (1952); Jacobi's preconditioner.

use std::ops::Range;

use multiversion::multiversion;
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
    /// For each slice: ranges that hold all cells in which u is looked for, counted from the slice's first cell.
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
                let spans = spans(&open[y * slice..(y + 1) * slice], block.width);
                let cells = spans.iter().cloned().flatten().map(|cell| y * slice + cell);
                for cell in cells.filter(|&cell| open[cell] > 0.0) {
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
        let spans = |y: usize| &self.spans[y][..];
        let diagonal = |y: usize| &self.diagonal[y * slice..(y + 1) * slice];
        let slices = r.par_chunks_mut(slice).zip(p.par_chunks_mut(slice)).zip(out.par_chunks(slice)).enumerate();
        let starts = slices.map(|(y, ((r, p), out))| {
            let b = product(spans(y), r, r);
            advance(spans(y), -1.0, out, r);
            precondition(spans(y), diagonal(y), r, p);
            [b, product(spans(y), r, r), product(spans(y), r, p)]
        });
        let [b, mut rr, mut rz] = total(starts.collect());
        for _ in 0..STEPS {
            if rr <= TOLERANCE * TOLERANCE * b {
                return;
            }
            let alpha = (rz / self.product(&p, &mut out)) as f32;
            let of = (p.par_chunks(slice), out.par_chunks_mut(slice));
            let slices = u.par_chunks_mut(slice).zip(r.par_chunks_mut(slice)).zip(of.0.zip(of.1)).enumerate();
            let steps = slices.map(|(y, ((u, r), (p, out)))| {
                advance(spans(y), alpha, p, u);
                advance(spans(y), -alpha, out, r);
                // What the product is no longer needed for holds z from here on.
                precondition(spans(y), diagonal(y), r, out);
                [product(spans(y), r, r), product(spans(y), r, out)]
            });
            let [new_rr, new_rz] = total(steps.collect());
            let beta = (new_rz / rz) as f32;
            (rr, rz) = (new_rr, new_rz);
            let slices = p.par_chunks_mut(slice).zip(out.par_chunks(slice)).enumerate();
            slices.for_each(|(y, (p, z))| turn(spans(y), beta, z, p));
        }
    }

    /// The matrix times `x`, and the product of both.
    fn product(&self, x: &[f32], out: &mut [f32]) -> f64 {
        let slice = self.block.rows * self.block.width;
        let work = |(y, out): (usize, &mut [f32])| {
            let first = y * slice;
            times_matrix(&self.spans[y], &self.diagonal, self.open, x, first, self.block, out);
            for across in &self.across[y] {
                out[across.cell as usize - first] += across.weight * x[across.other as usize];
            }
            [product(&self.spans[y], &x[first..first + slice], out)]
        };
        let [sum] = total(out.par_chunks_mut(slice).enumerate().map(work).collect());
        sum
    }
}

// The loops over the cells of a slice's spans. They hold no closures: what iterators make of a closure is compiled for all processors alike.

/// The rows of the matrix that belong to cells of a slice, of which `first` is the first one, times `x`: without the terms across walls.
#[multiversion(targets("x86_64+avx+avx2"))]
fn times_matrix(
    spans: &[Range<usize>],
    diagonal: &[f32],
    open: &[f32],
    x: &[f32],
    first: usize,
    block: &Block,
    out: &mut [f32],
) {
    let [a, b, c] = block.strides();
    for span in spans {
        let (from, n) = (first + span.start, span.len());
        let at = [0, -a, a, -b, b, -c, c].map(|step| from.wrapping_add_signed(step));
        let [o, o1, o2, o3, o4, o5, o6] = rows(open, at, n);
        let [x0, x1, x2, x3, x4, x5, x6] = rows(x, at, n);
        let (d, out) = (&diagonal[from..][..n], &mut out[span.start..][..n]);
        for i in 0..n {
            let mut sum = d[i] * x0[i];
            sum -= lesser(o[i], o1[i]) * x1[i];
            sum -= lesser(o[i], o2[i]) * x2[i];
            sum -= lesser(o[i], o3[i]) * x3[i];
            sum -= lesser(o[i], o4[i]) * x4[i];
            sum -= lesser(o[i], o5[i]) * x5[i];
            sum -= lesser(o[i], o6[i]) * x6[i];
            out[i] = sum;
        }
    }
}

/// `n` numbers from each place on.
#[inline(always)]
fn rows(of: &[f32], at: [usize; 7], n: usize) -> [&[f32]; 7] {
    at.map(|at| &of[at..at + n])
}

#[inline(always)]
fn lesser(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

/// v + `alpha` w, for v.
#[multiversion(targets("x86_64+avx+avx2"))]
fn advance(spans: &[Range<usize>], alpha: f32, w: &[f32], v: &mut [f32]) {
    for span in spans {
        let (w, v) = (&w[span.start..span.end], &mut v[span.start..span.end]);
        for (v, w) in v.iter_mut().zip(w) {
            *v += alpha * w;
        }
    }
}

/// z + `beta` p, for p.
#[multiversion(targets("x86_64+avx+avx2"))]
fn turn(spans: &[Range<usize>], beta: f32, z: &[f32], p: &mut [f32]) {
    for span in spans {
        let (z, p) = (&z[span.start..span.end], &mut p[span.start..span.end]);
        for (p, z) in p.iter_mut().zip(z) {
            *p = normal(z + beta * *p);
        }
    }
}

/// z = r / d.
#[multiversion(targets("x86_64+avx+avx2"))]
fn precondition(spans: &[Range<usize>], d: &[f32], r: &mut [f32], z: &mut [f32]) {
    for span in spans {
        let (d, r) = (&d[span.start..span.end], &mut r[span.start..span.end]);
        for ((z, r), d) in z[span.start..span.end].iter_mut().zip(r).zip(d) {
            *r = normal(*r);
            *z = *r / if *d > LEAST { *d } else { LEAST };
        }
    }
}

/// The sum of products, in double precision, of which eight parts grow side by side.
#[multiversion(targets("x86_64+avx+avx2"))]
fn product(spans: &[Range<usize>], a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0f64; 8];
    for span in spans {
        let (a8, rest_a) = a[span.start..span.end].as_chunks::<8>();
        let (b8, rest_b) = b[span.start..span.end].as_chunks::<8>();
        for (i, (a, b)) in rest_a.iter().zip(rest_b).enumerate() {
            sums[i] += f64::from(*a) * f64::from(*b);
        }
        for (a, b) in a8.iter().zip(b8) {
            for i in 0..8 {
                sums[i] += f64::from(a[i]) * f64::from(b[i]);
            }
        }
    }
    sums.into_iter().sum()
}

/// Less than this is 0. The search spreads by a cell a step, and grows fainter by more than half: numbers too small to be normal ones, which are slow, would be
/// next.
const TINY: f32 = 1e-20;

#[inline(always)]
fn normal(value: f32) -> f32 {
    if value.abs() < TINY { 0.0 } else { value }
}

/// The ranges of a slice's cells that hold all that are open.
fn spans(open: &[f32], width: usize) -> Vec<Range<usize>> {
    let mut spans: Vec<Range<usize>> = Vec::new();
    for row in (0..open.len()).step_by(width) {
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
