//! How thick the shell of points is, in cells, and so whether they are noisy.
//!
//! ```text
//!    . .   .  .       noise: a block of 3 cells and one of 5       clean, but bent: the wider block
//!   .  .  . .  .      are as thick                                 is much thicker       . ' - ' .
//! ```
//!
//! Blocks are taken round occupied cells in slices all over the cloud. Of a block, only cells on the same side count ([`crate::surface::outward`]): not the other wall
//! of a slot. A cell with no inside behind it says nothing: both walls of a plate that is as thin as the cells look like noise. Sums are of integers, so the points' order cannot show.

use crate::error::Result;
use crate::grid::context::Context;
use crate::grid::occupancy::Sampled;
use crate::grid::partition::BUCKET_SLICES;
use crate::grid::rank_bitmap::RankBitmap;
use crate::grid::slice::{Bits, Runs};
use crate::points::Coordinate;
use crate::solid::Solid;
use crate::surface::outward::Outward;
use crate::surface::plane::{agreement, variance_across};

/// Slices that are looked at, and cells in each.
const SLICES: u32 = 16;
const CELLS: usize = 128;

/// Blocks of so many cells round a cell, either way.
const BLOCKS: [i64; 2] = [1, 2];

/// A block with fewer points says nothing.
const LEAST: i64 = 6;

/// The thickness that is noise, in cells. On 17 clouds the thickest clean one had .051 and the thinnest noisy one .111, by cells of k = 4.
const NOISE: f64 = 0.08;

/// Wider blocks of noise are at most so many times as thick. Where curvature makes a block thick it is 2 to 3 times.
const EVEN: f64 = 1.5;

/// How far behind a cell there is to be inside, in cells.
const BEHIND: f64 = 3.0;

/// Points' places within a cell are counted in this part of it.
const QUANTA: f64 = 1024.0;

/// Points of a cell: their number, the sums of their places in the cell, in 1/1024 of it, and of products of these.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    points: i64,
    sums: [i64; 3],
    products: [i64; 6],
}

const PAIRS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

impl Moments {
    fn add(&mut self, place: [i64; 3]) {
        self.points += 1;
        (0..3).for_each(|a| self.sums[a] += place[a]);
        PAIRS.iter().zip(&mut self.products).for_each(|((a, b), product)| *product += place[*a] * place[*b]);
    }

    /// Adds those of another cell, so many cells away.
    fn add_from(&mut self, other: &Moments, away: [i64; 3]) {
        let by = away.map(|cells| cells * QUANTA as i64);
        self.points += other.points;
        (0..3).for_each(|a| self.sums[a] += other.sums[a] + other.points * by[a]);
        for ((a, b), (product, more)) in PAIRS.iter().zip(self.products.iter_mut().zip(other.products)) {
            *product += more + other.sums[*a] * by[*b] + other.sums[*b] * by[*a] + other.points * by[*a] * by[*b];
        }
    }

    /// The variance across the flattest direction, in square cells.
    fn variance(&self) -> f64 {
        let n = self.points as f64;
        let mean = self.sums.map(|s| s as f64 / n);
        let mut covariance = [[0.0; 3]; 3];
        for ((a, b), product) in PAIRS.iter().zip(self.products) {
            let c = (product as f64 / n - mean[*a] * mean[*b]) / (QUANTA * QUANTA);
            (covariance[*a][*b], covariance[*b][*a]) = (c, c);
        }
        variance_across(&covariance).max(0.0)
    }
}

/// The shell of points round a surface.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Shell {
    /// How thick it is, in cells: of blocks of 3³ cells all over the surface, the lower quartile of the root of the variance across them.
    pub thickness: f64,
    /// The same of blocks of 5³ cells.
    pub wider: f64,
}

impl Shell {
    /// Whether that is noise. Curvature and edges make wider blocks thicker, noise does not.
    pub fn is_noisy(&self) -> bool {
        self.thickness > NOISE && self.wider < EVEN * self.thickness
    }
}

/// Measures the shell; none where too few places tell.
///
/// Memory: for each job in flight, five slices of numbered cells, and the sums of the cells of [`CELLS`] blocks.
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::Interrupted`].
pub fn measure<T: Coordinate>(sampled: &Sampled<'_, T>, solid: &Solid, context: &Context) -> Result<Option<Shell>> {
    let slices = solid.cells[1];
    let middle = |i: u32| (u64::from(2 * i + 1) * u64::from(slices) / u64::from(2 * SLICES)) as u32;
    let mut chosen: Vec<u32> = (0..SLICES).map(middle).collect();
    chosen.dedup();
    let mut variances: [Vec<f64>; 2] = Default::default();
    let mut looked_at = 0;
    context.workers.in_order_range(
        context.memory.chunks_in_flight.min(context.workers.threads()),
        chosen.len(),
        |i| of_slice(sampled, solid, chosen[i]),
        |(cells, found)| {
            looked_at += cells;
            for block in found {
                variances.iter_mut().zip(block).for_each(|(all, one)| all.push(one));
            }
            Ok(())
        },
    )?;
    if variances[0].len() < (looked_at / 4).max(1) {
        return Ok(None);
    }
    let [thickness, wider] = variances.map(|mut all| {
        all.sort_unstable_by(f64::total_cmp);
        all[all.len() / 4].sqrt()
    });
    Ok(Some(Shell { thickness, wider }))
}

/// The cells of slice `y` that were looked at, and the variances of the blocks round those that tell.
fn of_slice<T: Coordinate>(sampled: &Sampled<'_, T>, solid: &Solid, y: u32) -> Result<(usize, Vec<[f64; 2]>)> {
    let [width, slices, rows] = solid.cells;
    let far = BLOCKS[1];
    let mut runs = Runs::default();
    sampled.occupied.read(y, &mut runs)?;
    let cells: Vec<[u32; 2]> = (0..runs.row_count())
        .flat_map(|z| runs.row(z).iter().flat_map(move |run| (run.start..run.end).map(move |x| [x, z])))
        .collect();
    let step = cells.len().div_ceil(CELLS).max(1);
    let chosen: Vec<[u32; 2]> = cells.iter().copied().step_by(step).collect();
    let near = |y: i64| (0..i64::from(slices)).contains(&y);
    // The occupied cells of the blocks, with what is outward of them.
    let (mut blocks, mut directions) = (Vec::new(), Vec::new());
    let mut outward = Outward::of_cells(solid);
    for y in i64::from(y) - far..=i64::from(y) + far {
        let (mut ranked, mut occupied) = (RankBitmap::new(width, rows), RankBitmap::new(width, rows));
        let mut here = Vec::new();
        if near(y) {
            outward.slide_to(y)?;
            sampled.occupied.read(y as u32, &mut runs)?;
            occupied.replace(&runs);
            for [x, z] in &chosen {
                for z in i64::from(*z) - far..=i64::from(*z) + far {
                    for x in i64::from(*x) - far..=i64::from(*x) + far {
                        let inside = (0..i64::from(width)).contains(&x) && (0..i64::from(rows)).contains(&z);
                        if inside && occupied.at(x as u32, z as u32).is_some() {
                            ranked.set(x as u32, z as u32);
                        }
                    }
                }
            }
            let count = ranked.number();
            here.reserve_exact(count as usize);
            for z in 0..rows {
                for x in 0..width {
                    if ranked.at(x, z).is_some() {
                        here.push(outward.at(x, y, z));
                    }
                }
            }
        } else {
            ranked.number();
        }
        let count = here.len();
        directions.push(here);
        blocks.push((ranked, vec![Moments::default(); count]));
    }
    let first = i64::from(y) - far;
    let lowest = first.max(0) as u32;
    let highest = (i64::from(y) + far).min(i64::from(slices) - 1) as u32;
    for bucket in lowest / BUCKET_SLICES..=highest / BUCKET_SLICES {
        sampled.buckets.read(bucket as usize, |points| {
            for point in points {
                let ([x, y, z], within) = sampled.grid.place_of(point.map(Into::into));
                if let Some((ranked, moments)) = blocks.get_mut((i64::from(y) - first) as usize)
                    && let Some(number) = ranked.at(x, z)
                {
                    moments[number].add(within.map(|c| (c * QUANTA) as i64));
                }
            }
            Ok(())
        })?;
    }
    let behind = BEHIND as i64;
    let mut inside = Vec::new();
    for y in i64::from(y) - behind..=i64::from(y) + behind {
        let mut bits = Bits::new(width + 2, rows + 2);
        if near(y) {
            solid.paint(y, &mut bits, &mut runs)?;
        }
        inside.push(bits);
    }
    let looked_at = chosen.len();
    let mut out = Vec::new();
    for [x, z] in chosen {
        let centre = &blocks[far as usize].0;
        let number = centre.at(x, z).expect("a chosen cell is in its own block");
        let own = directions[far as usize][number];
        let back = own.map(|c| -(c * BEHIND).round() as i64);
        let is_inside = inside[(behind + back[1]) as usize].get(i64::from(x) + 1 + back[0], i64::from(z) + 1 + back[2]);
        if own == [0.0; 3] || !is_inside {
            continue;
        }
        let mut found = [0.0; 2];
        let mut enough = true;
        for (r, found) in BLOCKS.into_iter().zip(&mut found) {
            let mut sum = Moments::default();
            for dy in -r..=r {
                let ((ranked, moments), directions) = (&blocks[(far + dy) as usize], &directions[(far + dy) as usize]);
                for dz in -r..=r {
                    for dx in -r..=r {
                        let (x, z) = (i64::from(x) + dx, i64::from(z) + dz);
                        let inside = (0..i64::from(width)).contains(&x) && (0..i64::from(rows)).contains(&z);
                        let Some(number) = inside.then(|| ranked.at(x as u32, z as u32)).flatten() else { continue };
                        let there = directions[number];
                        if agreement(own, there) > 0.0 {
                            sum.add_from(&moments[number], [dx, dy, dz]);
                        }
                    }
                }
            }
            enough &= sum.points >= LEAST;
            if enough {
                *found = sum.variance();
            }
        }
        if enough {
            out.push(found);
        }
    }
    Ok((looked_at, out))
}
