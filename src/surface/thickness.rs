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
use crate::grid::Cell;
use crate::grid::context::Context;
use crate::grid::occupancy::Sampled;
use crate::grid::partition::BUCKET_SLICES;
use crate::grid::slice::{Bits, Runs};
use crate::points::Coordinate;
use crate::solid::Solid;
use crate::surface::flattest::{flattest, variance_along};
use crate::surface::outward::{self, Outward, agreement};

/// Slices that are looked at, and cells in each.
const SLICES: u32 = 16;
const CELLS: usize = 128;

/// Blocks of so many cells round a cell, either way.
const BLOCKS: [i64; 2] = [1, 2];

/// A block with fewer points says nothing.
const LEAST: i64 = 6;

/// The thickness that is noise, in cells. On 17 clouds the thickest clean one had .051 and the thinnest noisy one .111, by cells of k = 4.
const NOISE: f64 = 0.08;

/// Wider blocks of noise are at most so many times as thick: 1.1 to 1.5 times, of misregistered scans 1.6, of noise that fills the smaller blocks 1.8. Where curvature makes a block thick, or
/// a body is filled, it is 1.9 to 3 times.
const EVEN: f64 = 1.8;

/// A shell as thick as this fills the smaller blocks. The thickest clean surface had .40, however coarse its cells.
const FILLED: f64 = 0.42;

/// Noise as thick as this, in cells, leads planes of walls astray, and hides walls behind their own points.
const HIDING: f64 = 0.25;

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
        variance_along(&flattest(&covariance), &covariance).max(0.0)
    }
}

/// The shell of points round a surface.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Shell {
    /// How thick it is, in cells: of blocks of 3³ cells all over the surface, the lower quartile of the root of the variance across them.
    pub thickness: f64,
    /// The same of blocks of 5³ cells.
    pub wider: f64,
}

impl Shell {
    /// Whether that is noise. Curvature and edges make wider blocks thicker; noise does only where it fills the smaller ones.
    pub fn is_noisy(&self) -> bool {
        self.thickness > NOISE && self.wider < EVEN * self.thickness
    }

    /// Whether it is as thick as the smaller blocks let it be, or nearly: as noise of a cell and more is, and a filled body.
    pub fn fills_blocks(&self) -> bool {
        self.thickness > FILLED
    }

    /// Whether it is noise so thick that what the walls of a slot say of it means nothing ([`crate::solid::reopen`]).
    pub fn hides_walls(&self) -> bool {
        self.is_noisy() && self.thickness > HIDING
    }
}

/// Measures the shell; none where too few places tell.
///
/// Memory: [`bytes`] for each job in flight.
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
        jobs(solid.cells, context),
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

/// Bytes that [`measure`] needs for each slice that it looks at: slices of the solid, and the sums of the blocks' cells.
pub fn bytes(cells: Cell) -> u64 {
    bytes_among(cells, u64::from(cells[0]) * u64::from(cells[2]))
}

/// The same where no slice has more occupied cells than `most`.
fn bytes_among([width, _, rows]: Cell, most: u64) -> u64 {
    let side = 2 * BLOCKS[1] as u64 + 1;
    let chosen = (CELLS as u64).min(most);
    let of_slice = (chosen * side * side).min(most);
    // The cells of the slice at hand are listed block by block first, in a vector that grows.
    let listed = chosen * side * side * 2 * size_of::<[u32; 2]>() as u64;
    let cells = side * of_slice * size_of::<BlockCell>() as u64;
    outward::bytes([width, 0, rows]) + 2 * Bits::bytes(width + 2, rows + 2) + listed + cells
}

/// The same for all jobs at a time, where slices have so many occupied cells.
pub fn bytes_of_all(cells: Cell, in_slice: &[u32], context: &Context) -> u64 {
    let most = in_slice.iter().copied().max().unwrap_or(0);
    jobs(cells, context).min(SLICES as usize) as u64 * bytes_among(cells, most.into())
}

/// Slices that are looked at at a time.
fn jobs(cells: Cell, context: &Context) -> usize {
    context.memory.jobs_of(bytes(cells)).min(context.workers.threads())
}

/// An occupied cell of a block.
struct BlockCell {
    /// Its x and row.
    at: [u32; 2],
    outward: [f64; 3],
    moments: Moments,
}

/// The order of a slice's cells, which is that of x, then of rows.
fn place([x, z]: &[u32; 2]) -> u64 {
    u64::from(*x) << 32 | u64::from(*z)
}

/// The cells of slice `y` that were looked at, and the variances of the blocks round those that tell.
fn of_slice<T: Coordinate>(sampled: &Sampled<'_, T>, solid: &Solid, y: u32) -> Result<(usize, Vec<[f64; 2]>)> {
    let [width, slices, rows] = solid.cells;
    let mut runs = Runs::default();
    let chosen = chosen_cells(sampled, y, &mut runs)?;
    let (y, far) = (i64::from(y), BLOCKS[1]);
    let first = (y - far).max(0);
    let block_slices = first..=(y + far).min(i64::from(slices) - 1);

    // The occupied cells of the blocks, slice by slice, in order.
    let mut outward = Outward::of_cells(solid);
    let mut bits = Bits::new(width, rows);
    let mut blocks: Vec<Vec<BlockCell>> = Vec::new();
    for y in block_slices.clone() {
        outward.slide_to(y)?;
        sampled.occupied.paint(y, &mut bits, &mut runs)?;
        let mut cells: Vec<[u32; 2]> = Vec::new();
        for [x, z] in &chosen {
            let beside = (i64::from(*z) - far..=i64::from(*z) + far)
                .flat_map(|z| (i64::from(*x) - far..=i64::from(*x) + far).map(move |x| (x, z)));
            cells.extend(beside.filter(|(x, z)| bits.get(*x, *z)).map(|(x, z)| [x as u32, z as u32]));
        }
        cells.sort_unstable_by_key(place);
        cells.dedup();
        let cell = |at: [u32; 2]| BlockCell { at, outward: outward.at(at[0], y, at[1]), moments: Moments::default() };
        blocks.push(cells.into_iter().map(cell).collect());
    }
    let found =
        |cells: &[BlockCell], at: [u32; 2]| cells.binary_search_by_key(&place(&at), |cell| place(&cell.at)).ok();
    for bucket in *block_slices.start() as u32 / BUCKET_SLICES..=*block_slices.end() as u32 / BUCKET_SLICES {
        sampled.buckets.read(bucket as usize, |points| {
            for point in points {
                let ([x, y, z], within) = sampled.grid.place_of(point.map(Into::into));
                let cells = usize::try_from(i64::from(y) - first).ok().and_then(|number| blocks.get_mut(number));
                if let Some(cells) = cells
                    && let Some(number) = found(cells, [x, z])
                {
                    cells[number].moments.add(within.map(|c| (c * QUANTA) as i64));
                }
            }
            Ok(())
        })?;
    }

    // Of the chosen cells, those with the inside behind them.
    let own = |at: &[u32; 2]| {
        let cells = &blocks[(y - first) as usize];
        cells[found(cells, *at).expect("a chosen cell is in its own block")].outward
    };
    let mut bits = Bits::new(width + 2, rows + 2);
    let mut telling = vec![false; chosen.len()];
    for dy in -(BEHIND as i64)..=BEHIND as i64 {
        solid.paint(y + dy, &mut bits, &mut runs)?;
        for (at, telling) in chosen.iter().zip(&mut telling) {
            let own = own(at);
            let back = own.map(|c| -(c * BEHIND).round() as i64);
            let place = [i64::from(at[0]) + 1 + back[0], i64::from(at[1]) + 1 + back[2]];
            *telling |= own != [0.0; 3] && back[1] == dy && bits.get(place[0], place[1]);
        }
    }

    let variance = |at: &[u32; 2], reach: i64| {
        let mut sum = Moments::default();
        for dy in -reach..=reach {
            let Some(cells) = usize::try_from(y + dy - first).ok().and_then(|number| blocks.get(number)) else {
                continue;
            };
            for dx in -reach..=reach {
                for dz in -reach..=reach {
                    let place = [i64::from(at[0]) + dx, i64::from(at[1]) + dz].map(u32::try_from);
                    let [Ok(x), Ok(z)] = place else { continue };
                    let Some(number) = found(cells, [x, z]) else { continue };
                    if agreement(own(at), cells[number].outward) > 0.0 {
                        sum.add_from(&cells[number].moments, [dx, dy, dz]);
                    }
                }
            }
        }
        (sum.points >= LEAST).then(|| sum.variance())
    };
    let mut out = Vec::new();
    for (at, _) in chosen.iter().zip(&telling).filter(|(_, telling)| **telling) {
        if let (Some(small), Some(large)) = (variance(at, BLOCKS[0]), variance(at, BLOCKS[1])) {
            out.push([small, large]);
        }
    }
    Ok((chosen.len(), out))
}

/// Occupied cells of a slice, x and row, as evenly as can be, [`CELLS`] at most.
fn chosen_cells<T>(sampled: &Sampled<'_, T>, y: u32, runs: &mut Runs) -> Result<Vec<[u32; 2]>> {
    sampled.occupied.read(y, runs)?;
    let step = (runs.cell_count() as usize).div_ceil(CELLS).max(1);
    let row = |z: u32| runs.row(z).iter().flat_map(move |run| (run.start..run.end).map(move |x| [x, z]));
    Ok((0..runs.row_count()).flat_map(row).step_by(step).collect())
}
