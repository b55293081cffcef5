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
    /// The system of the cells that are `open`, none of which lies at the block's border. For some cells of the block, `known` writes the weight of the face between
    /// each and an equally open one, 0 if it is a wall; and the u of each, 0 where it is looked for.
    pub fn new(
        block: &'a Block,
        open: &'a [f32],
        workers: &Workers,
        known: impl Fn(Range<usize>, &mut [f32], &mut [f32]) + Sync,
    ) -> System<'a> {
        let slice = block.rows * block.width;
        let (mut diagonal, mut right) = (vec![0f32; open.len()], vec![0f32; open.len()]);
        let spans = workers.pool().install(|| {
            // Three slices' weights, and their u.
            let buffers = || [(); 2].map(|()| vec![0f32; 3 * slice]);
            let work = |[weights, held]: &mut [Vec<f32>; 2],
                        (y, (diagonal, right)): (usize, (&mut [f32], &mut [f32]))| {
                let open = &open[y * slice..(y + 1) * slice];
                let spans = spans(open, block.width);
                if !spans.is_empty() {
                    known((y - 1) * slice..(y + 2) * slice, weights, held);
                    terms(&spans, open, weights, held, block, diagonal, right);
                }
                spans
            };
            let slices = diagonal.par_chunks_mut(slice).zip(right.par_chunks_mut(slice)).enumerate();
            slices.map_init(buffers, work).collect()
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
                // What the product is no longer needed for holds z from here on.
                step(spans(y), alpha, diagonal(y), p, u, r, out)
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
    let strides = block.strides();
    for span in spans {
        let (from, n) = (first + span.start, span.len());
        let [o, o1, o2, o3, o4, o5, o6] = rows(open, from, strides, n);
        let [x0, x1, x2, x3, x4, x5, x6] = rows(x, from, strides, n);
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

/// The faces' terms of a slice: `weights` and `held` are those of the slice, of the one below and of the one above.
#[multiversion(targets("x86_64+avx+avx2"))]
fn terms(
    spans: &[Range<usize>],
    open: &[f32],
    weights: &[f32],
    held: &[f32],
    block: &Block,
    diagonal: &mut [f32],
    right: &mut [f32],
) {
    let strides = block.strides();
    for span in spans {
        let (from, n) = (open.len() + span.start, span.len());
        let [w, w1, w2, w3, w4, w5, w6] = rows(weights, from, strides, n);
        let [_, h1, h2, h3, h4, h5, h6] = rows(held, from, strides, n);
        let (open, diagonal, right) =
            (&open[span.start..][..n], &mut diagonal[span.start..][..n], &mut right[span.start..][..n]);
        for i in 0..n {
            let faces = [
                lesser(w[i], w1[i]),
                lesser(w[i], w2[i]),
                lesser(w[i], w3[i]),
                lesser(w[i], w4[i]),
                lesser(w[i], w5[i]),
                lesser(w[i], w6[i]),
            ];
            let sum = LEAST + faces[0] + faces[1] + faces[2] + faces[3] + faces[4] + faces[5];
            let mut known = faces[0] * h1[i];
            known += faces[1] * h2[i];
            known += faces[2] * h3[i];
            known += faces[3] * h4[i];
            known += faces[4] * h5[i];
            known += faces[5] * h6[i];
            diagonal[i] = if open[i] > 0.0 { sum } else { 0.0 };
            right[i] = if open[i] > 0.0 { known } else { 0.0 };
        }
    }
}

/// `n` numbers from a place on, and from those beside it in either direction along each axis.
#[inline(always)]
fn rows(of: &[f32], from: usize, [a, b, c]: [isize; 3], n: usize) -> [&[f32]; 7] {
    [
        &of[from..][..n],
        &of[from.wrapping_add_signed(-a)..][..n],
        &of[from.wrapping_add_signed(a)..][..n],
        &of[from.wrapping_add_signed(-b)..][..n],
        &of[from.wrapping_add_signed(b)..][..n],
        &of[from.wrapping_add_signed(-c)..][..n],
        &of[from.wrapping_add_signed(c)..][..n],
    ]
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

/// A step of the search: u + `alpha` p, for u; r - `alpha` z, for r, z being the matrix times p; and r / d, for z. Gives the products of r with itself and with the new z, in
/// double precision, of which eight parts grow side by side.
#[multiversion(targets("x86_64+avx+avx2"))]
fn step(
    spans: &[Range<usize>],
    alpha: f32,
    d: &[f32],
    p: &[f32],
    u: &mut [f32],
    r: &mut [f32],
    z: &mut [f32],
) -> [f64; 2] {
    let (mut rr, mut rz) = ([0f64; 8], [0f64; 8]);
    for span in spans {
        let n = span.len();
        let (d, p) = (&d[span.start..][..n], &p[span.start..][..n]);
        let (u, r, z) = (&mut u[span.start..][..n], &mut r[span.start..][..n], &mut z[span.start..][..n]);
        for i in 0..n {
            u[i] += alpha * p[i];
            r[i] = normal(r[i] - alpha * z[i]);
            z[i] = preconditioned(r[i], d[i]);
        }
        let ((r8, r), (z8, z)) = (r.as_chunks::<8>(), z.as_chunks::<8>());
        for i in 0..r.len() {
            rr[i] += f64::from(r[i]) * f64::from(r[i]);
            rz[i] += f64::from(r[i]) * f64::from(z[i]);
        }
        for (r, z) in r8.iter().zip(z8) {
            for i in 0..8 {
                rr[i] += f64::from(r[i]) * f64::from(r[i]);
                rz[i] += f64::from(r[i]) * f64::from(z[i]);
            }
        }
    }
    [rr.into_iter().sum(), rz.into_iter().sum()]
}

/// r / d, as if d were no less than [`LEAST`].
#[inline(always)]
fn preconditioned(r: f32, d: f32) -> f32 {
    r / if d > LEAST { d } else { LEAST }
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
            *z = preconditioned(*r, *d);
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
