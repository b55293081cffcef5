//! The winding number at free cells of the solid: near walls by their own sum, far ones by the labels.
//!
//! With c(r) = erfc(u / √2) + √(2/π) u exp(−u²/2), u = r/σ, the sum of n·(m − x) A c(r) / (4π r³) over all walls is 1 − G∗1 inside and −G∗1 outside: the winding number less
//! what a Gaussian of standard deviation σ makes of the body. So with the labels in place of the body, near sum + G∗labels is the winding number, of which only walls
//! within 3 σ have to be looked at; labels that are wrong at first are put right step by step.
//!
//! Source: P. P. Ewald, *Die Berechnung optischer und elektrostatischer Gitterpotentiale*, Annalen der Physik 369 (1921), for sums split by a Gaussian; P. Merriman, J. K. Bence
//! and S. Osher, *Diffusion generated motion by mean curvature* (1992), for labels blurred and cut at a half.

use std::f64::consts::{PI, SQRT_2};
use std::ops::Range;

use super::Slabs;
use super::blocks::{self, BLOCK};
use super::dipole::Dipole;
use super::found::Found;
use super::layers::{Held, Layers, Stretch};
use super::tile::Tile;
use crate::error::Result;
use crate::grid::slice::{Runs, SliceStore, Slices};
use crate::solid::Solid;

/// How far, in σ, walls and labels count.
pub const RANGE: f64 = 3.0;

/// Added to squared distances: a wall is no point.
const SOFT: f64 = 0.16;

/// Entries of the table for each squared cell.
const FINENESS: f32 = 64.0;

/// A cell is inside if the winding number there is more, and surely outside if it is less than the second.
pub const INSIDE: f32 = 0.5;
pub const SURE: f32 = 0.3;

/// Free cells may open within so many cells of an occupied one that is looked at.
const BAND: i64 = 4;

/// How often labels are put right.
pub(super) const LABELLINGS: u32 = 4;

/// The Gaussian, and what a wall weighs by its distance.
#[derive(Debug)]
pub struct Kernel {
    /// How far it reaches, in cells.
    pub reach: i64,
    /// By squared distance: what a wall of area 1 adds for each cell along its normal.
    table: Vec<f32>,
    /// The rows that walls within reach lie in: slices and rows away, and how far along x.
    rows: Vec<(i64, i64, i64)>,
    /// The Gaussian's weights, from `-reach` to `reach`.
    weights: Vec<f32>,
}

impl Kernel {
    /// For a Gaussian of standard deviation `sigma`, in cells.
    pub fn new(sigma: f64) -> Kernel {
        let reach = (RANGE * sigma).ceil() as i64;
        let table = (0..=(reach * reach) as usize * FINENESS as usize).map(|entry| {
            let squared = entry as f64 / f64::from(FINENESS);
            let u = squared.sqrt() / sigma;
            let cut = libm::erfc(u / SQRT_2) + (2.0 / PI).sqrt() * u * libm::exp(-u * u / 2.0);
            let soft = squared + SOFT;
            (cut / (4.0 * PI * soft * soft.sqrt())) as f32
        });
        let weight = |d: i64| libm::exp(-(d * d) as f64 / (2.0 * sigma * sigma));
        let sum: f64 = (-reach..=reach).map(weight).sum();
        let weights = (-reach..=reach).map(|d| (weight(d) / sum) as f32).collect();
        // Means lie up to half a cell off the middle of their cells.
        let off = |d: i64| (d.abs() as f64 - 0.5).max(0.0);
        let mut rows = Vec::new();
        for y in -reach..=reach {
            for z in -reach..=reach {
                let left = (reach * reach) as f64 - off(y) * off(y) - off(z) * off(z);
                if left >= 0.0 {
                    rows.push((y, z, ((left.sqrt() + 0.5).floor() as i64).min(reach)));
                }
            }
        }
        Kernel { reach, table: table.collect(), weights, rows }
    }

    /// What the walls within reach add up to in the middles of the cells `xs` of a row, by slice, row and x.
    pub fn near(&self, xs: Range<i64>, y: i64, z: i64, dipoles: &Held<Dipole>) -> Vec<f32> {
        let mut sums = vec![0.0; (xs.end - xs.start) as usize];
        for (dy, dz, reach) in &self.rows {
            let (cells, values) = dipoles.slice(y + dy);
            for number in cells.range(z + dz, xs.start - reach..xs.end + reach) {
                let Dipole { mean, area, .. } = &values[number];
                let at = i64::from(cells.x(number));
                let away = [*dy as f32 + (mean[1] - 0.5), *dz as f32 + (mean[2] - 0.5)];
                let squared = away[0] * away[0] + away[1] * away[1];
                let across = area[1] * away[0] + area[2] * away[1];
                for x in xs.start.max(at - reach)..xs.end.min(at + reach + 1) {
                    let along = (at - x) as f32 + (mean[0] - 0.5);
                    let place = (along * along + squared) * FINENESS;
                    let entry = place as usize;
                    if let Some([low, high]) = self.table.get(entry..entry + 2) {
                        let weight = low + (place - entry as f32) * (high - low);
                        sums[(x - xs.start) as usize] += weight * (area[0] * along + across);
                    }
                }
            }
        }
        sums
    }

    /// The shares of the cells of a tile and its margin that are inside: the solid's free cells but for `opened` ones, and what walls say of theirs.
    pub fn shares(&self, tile: &Tile, solid: &Stretch, opened: &Stretch, dipoles: &Held<Dipole>) -> Vec<f32> {
        let mut shares = vec![0.0; tile.len()];
        tile.paint(solid, 1.0, &mut shares);
        tile.paint(opened, 0.0, &mut shares);
        let [xs, ys, zs] = [0, 1, 2].map(|a| tile.low[a]..tile.low[a] + tile.size[a] as i64);
        for y in ys {
            let (cells, values) = dipoles.slice(y);
            for z in zs.clone() {
                for number in cells.range(z, xs.clone()) {
                    shares[tile.place([i64::from(cells.x(number)), y, z])] = values[number].inside;
                }
            }
        }
        shares
    }

    /// Blurs the shares along x and along rows; what is left is a sum along slices, for the cells that are asked for ([`Kernel::along_slices`]). Cells of the margin have
    /// no meaning along these two.
    pub fn blur(&self, tile: &Tile, shares: &[f32]) -> Vec<f32> {
        let [width, slices, rows] = tile.size;
        let reach = self.reach as usize;
        let (inner_x, inner_z) = (width - 2 * reach, rows - 2 * reach);
        let mut along_x = vec![0.0f32; shares.len()];
        for (from, to) in shares.chunks_exact(width).zip(along_x.chunks_exact_mut(width)) {
            if from.iter().all(|share| *share == 0.0) {
                continue;
            }
            let to = &mut to[reach..reach + inner_x];
            for (d, weight) in self.weights.iter().enumerate() {
                for (to, from) in to.iter_mut().zip(&from[d..d + inner_x]) {
                    *to += weight * from;
                }
            }
        }
        let mut blurred = vec![0.0f32; shares.len()];
        for slice in 0..slices {
            for z in 0..inner_z {
                let row = |z: usize| (slice * rows + z) * width + reach;
                let to = row(z + reach);
                for (d, weight) in self.weights.iter().enumerate() {
                    let from = row(z + d);
                    for x in 0..inner_x {
                        blurred[to + x] += weight * along_x[from + x];
                    }
                }
            }
        }
        blurred
    }

    /// The Gaussian's mean of the shares round a cell of the tile, of what [`Kernel::blur`] gave.
    pub fn along_slices(&self, tile: &Tile, blurred: &[f32], [x, y, z]: [i64; 3]) -> f32 {
        let places = (y - self.reach..=y + self.reach).map(|y| tile.place([x, y, z]));
        self.weights.iter().zip(places).fold(0.0, |sum, (weight, place)| sum + weight * blurred[place])
    }
}

impl Slabs<'_> {
    /// The free cells that may open, each with what the walls near it add up to.
    pub(super) fn candidates(
        &self,
        solid: &Solid,
        occupied: &SliceStore,
        dipoles: &Layers<Dipole>,
        kernel: &Kernel,
    ) -> Result<(SliceStore, Layers<f32>)> {
        let mut store = SliceStore::new(&self.context.workspace, self.context.memory.store_quota);
        let mut sums = Layers::new(self.context);
        let reach = BAND;
        // The rows of the ball: slices and rows away, and how far along x.
        let ball: Vec<[i64; 3]> = (-reach..=reach)
            .flat_map(|y| (-reach..=reach).map(move |z| (y, z, reach * reach - y * y - z * z)))
            .filter(|(.., left)| *left >= 0)
            .map(|(y, z, left)| [y, z, left.isqrt()])
            .collect();
        self.each(
            |chunk| {
                let mut found = Found::new(chunk.clone());
                let tiles = self.tiles(&chunk, 0)?;
                if !tiles.is_empty() {
                    let held = self.held(dipoles, &chunk, kernel.reach)?;
                    let solid = Slabs::stretch(&solid.store, &chunk, 0)?;
                    // All of them: those that are not looked at may lie where cells may open.
                    let occupied = Slabs::stretch(occupied, &chunk, 0)?;
                    let mut allowed = Runs::default();
                    for tile in tiles {
                        let (own, mut near_walls) = (tile.ranges(0), vec![false; tile.len()]);
                        for y in i64::from(chunk.start) - reach..i64::from(chunk.end) + reach {
                            let (cells, _) = held.slice(y);
                            let [xs, _, zs] =
                                [0, 1, 2].map(|a| tile.low[a] - reach..tile.low[a] + tile.size[a] as i64 + reach);
                            for z in zs {
                                for number in cells.range(z, xs.clone()) {
                                    let x = i64::from(cells.x(number));
                                    for [dy, dz, far] in &ball {
                                        let [own_xs, ys, zs] = &own;
                                        let (from, to) = (own_xs.start.max(x - far), own_xs.end.min(x + far + 1));
                                        if from < to && ys.contains(&(y + dy)) && zs.contains(&(z + dz)) {
                                            let first = tile.place([from, y + dy, z + dz]);
                                            near_walls[first..first + (to - from) as usize].fill(true);
                                        }
                                    }
                                }
                            }
                        }
                        let mut layer = None;
                        let [xs, ys, zs] = tile.ranges(0);
                        for (y, z) in ys.flat_map(|y| zs.clone().map(move |z| (y, z))) {
                            if layer != Some(y / i64::from(BLOCK)) {
                                self.allowed.read(y as u32, &mut allowed)?;
                                layer = Some(y / i64::from(BLOCK));
                            }
                            let is_asked = |x: i64| {
                                near_walls[tile.place([x, y, z])]
                                    && solid.get([x, y, z])
                                    && !occupied.get([x, y, z])
                                    && blocks::holds(&allowed, x as u32, z as u32)
                            };
                            let mut asked = xs.clone().filter(|x| is_asked(*x)).peekable();
                            while let Some(first) = asked.next() {
                                let mut end = first + 1;
                                while asked.next_if_eq(&end).is_some() {
                                    end += 1;
                                }
                                let sums = kernel.near(first..end, y, z, &held);
                                (first..end).zip(sums).for_each(|(x, sum)| found.push([x, y, z], sum));
                            }
                        }
                    }
                }
                let (runs, values) = found.sorted(self.cells);
                let mut slices = Slices::default();
                runs.iter().for_each(|runs| slices.push_runs(runs));
                Ok((slices, values))
            },
            |(slices, values)| {
                store.extend(&slices)?;
                sums.extend(&values)
            },
        )?;
        Ok((store, sums))
    }

    /// The candidates that are outside, and those of them that surely are.
    pub(super) fn labelled(
        &self,
        solid: &Solid,
        dipoles: &Layers<Dipole>,
        (candidates, sums): &(SliceStore, Layers<f32>),
        kernel: &Kernel,
    ) -> Result<(SliceStore, SliceStore)> {
        let store = || SliceStore::new(&self.context.workspace, self.context.memory.store_quota);
        let mut outside = store();
        let mut sure = store();
        for labelling in 0..LABELLINGS {
            let (mut next, mut certain) = (store(), store());
            self.each(
                |chunk| {
                    let (mut out, mut out_sure) = (Found::new(chunk.clone()), Found::new(chunk.clone()));
                    let tiles = self.tiles(&chunk, kernel.reach)?;
                    if !tiles.is_empty() {
                        let held = self.held(dipoles, &chunk, kernel.reach)?;
                        let solid = Slabs::stretch(&solid.store, &chunk, kernel.reach)?;
                        let opened = Slabs::stretch(&outside, &chunk, kernel.reach)?;
                        let asked = Held::read(candidates, sums, i64::from(chunk.start)..i64::from(chunk.end))?;
                        for tile in tiles.iter().filter(|tile| asked.any_of(tile.ranges(kernel.reach))) {
                            let shares = kernel.shares(tile, &solid, &opened, &held);
                            let blurred = kernel.blur(tile, &shares);
                            let reach = kernel.reach;
                            let [xs, ys, zs] =
                                [0, 1, 2].map(|a| tile.low[a] + reach..tile.low[a] + tile.size[a] as i64 - reach);
                            for y in ys {
                                let (cells, sums) = asked.slice(y);
                                for z in zs.clone() {
                                    for number in cells.range(z, xs.clone()) {
                                        let cell = [i64::from(cells.x(number)), y, z];
                                        let winding = sums[number] + kernel.along_slices(tile, &blurred, cell);
                                        if winding <= INSIDE {
                                            out.push(cell, ());
                                            if winding < SURE {
                                                out_sure.push(cell, ());
                                            }
                                        }
                                    }
                                }
                            }
                        }
                    }
                    Ok([out, out_sure].map(|found| {
                        let mut slices = Slices::default();
                        found.sorted(self.cells).0.iter().for_each(|runs| slices.push_runs(runs));
                        slices
                    }))
                },
                |[out, out_sure]| {
                    next.extend(&out)?;
                    if labelling + 1 == LABELLINGS { certain.extend(&out_sure) } else { Ok(()) }
                },
            )?;
            (outside, sure) = (next, certain);
        }
        Ok((outside, sure))
    }
}
