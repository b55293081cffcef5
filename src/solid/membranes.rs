//! Membranes, for those who make the surface: near them, the field that tells the sides ([`crate::solid::sign`]) is kept, so that vertices go to where it is 0.
//!
//! ```text
//!   o o o o o o|i i        o outside, i inside: cells of the level. Between them, the surface has
//!   o o o|i i i i i        steps of a cell, or of as many cells of the grid as one of the level has.
//!   o|i i i i i i i
//!
//!   u < 0        __..      Between the cells' middles u is a spline, and what it is 0 on has none.
//!        __..--''  u > 0
//! ```
//!
//! What is kept are lists of cells with their u, one for each slice of the level, in temporary storage; whoever makes vertices plane by plane holds a few of them.

use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::grid::Cell;
use crate::grid::context::Context;
use crate::grid::partition::MOST_TRAVEL;
use crate::grid::trace::{Digests, Trace, are_same, digest};
use crate::grid::window::Window;
use crate::solid::sign::{Block, PAD};
use crate::storage::spool::Spool;
use crate::storage::work::sections::{SectionReader, SectionWriter};

/// Slices of the level that are held either side of a plane.
const BESIDE: i64 = 4;

/// Steps towards u = 0.
const STEPS: usize = 4;

/// A vertex moves by no more cells of the level, nor by more of the grid than [`MOST_TRAVEL`]: seams look so far.
const FARTHEST: f64 = 2.0;

/// A last step longer than this, in cells of the level, leads nowhere.
const SHORT: f64 = 0.25;

/// What u = ±1 is kept as.
const ONE: f32 = 32767.0;

/// The field near membranes.
#[derive(Debug)]
pub struct Membranes {
    common: Common,
    /// Of each cell, its number in its slice in the upper half, and its u in the lower one.
    spool: Spool,
    /// Where each slice's cells begin among all, in their order; then the number of all.
    starts: Vec<u32>,
    trace: Trace,
}

/// What all slices have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Common {
    /// Cells of the grid along a cell of the level.
    factor: u32,
    /// The block's cells along x and rows, padding included.
    width: u32,
    rows: u32,
}

impl Membranes {
    /// Of the cells of a level's block with their u, in their order; none if there are none.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn of(block: &Block, factor: u32, near: &[(u32, f32)], context: &Context) -> Result<Option<Membranes>> {
        if near.is_empty() {
            return Ok(None);
        }
        let slice = block.width * block.rows;
        debug_assert!(slice <= 1 << 16, "a cell's number has 16 bits");
        let kept = |&(cell, u): &(u32, f32)| {
            let u = (u.clamp(-1.0, 1.0) * ONE).round() as i16;
            (cell % slice as u32) << 16 | u32::from(u as u16)
        };
        let mut spool = context.workspace.spool(context.memory.store_quota);
        spool.append(bytemuck::cast_slice(&near.iter().map(kept).collect::<Vec<u32>>()))?;
        let start = |y: usize| near.partition_point(|(cell, _)| (*cell as usize) < y * slice) as u32;
        let starts = (0..=block.slices).map(start).collect();
        let common = Common { factor, width: block.width as u32, rows: block.rows as u32 };
        Ok(Some(Membranes { common, spool, starts, trace: Trace::default() }))
    }

    /// Saves them.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(&self, out: &mut SectionWriter<'_>) -> Result<Common> {
        out.spool(&self.spool)?;
        out.values(&self.starts)?;
        Ok(self.common)
    }

    /// Reads what [`Membranes::save`] saved.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`], [`crate::Error::Io`].
    pub fn load(common: Common, sections: &mut SectionReader<'_>, context: &Context) -> Result<Membranes> {
        let mut spool = context.workspace.spool(context.memory.store_quota);
        sections.spool(&mut spool)?;
        let starts: Vec<u32> = sections.values()?;
        let bytes = starts.last().map(|all| u64::from(*all) * size_of::<u32>() as u64);
        if !starts.is_sorted() || bytes != Some(spool.len()) || common.factor == 0 {
            return Err(sections.damaged("membranes are not what their slices say"));
        }
        Ok(Membranes { common, spool, starts, trace: Trace::default() })
    }

    /// Moves what lies in memory to disk.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn leave_memory(&mut self) -> Result<()> {
        self.spool.leave_memory()
    }

    /// From now on it is told which slices are read.
    pub fn trace(&mut self) {
        self.trace = Trace::of(self.slices());
    }

    /// What was in those that were read since.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn traced(&self) -> Result<Digests> {
        self.trace.digests(|slice| self.digest(slice))
    }

    /// Whether these slices are the same.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn are_same(&self, digests: &Digests) -> Result<bool> {
        are_same(digests, self.slices(), |slice| self.digest(slice))
    }

    /// What all slices have in common.
    pub fn common(&self) -> Common {
        self.common
    }

    fn slices(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    fn digest(&self, slice: u32) -> Result<u64> {
        let mut cells = Vec::new();
        self.read(slice as usize, &mut cells)?;
        Ok(digest(bytemuck::cast_slice(&cells)))
    }

    /// The cells of a slice of the block.
    fn read(&self, slice: usize, cells: &mut Vec<u32>) -> Result<()> {
        let [start, end] = [self.starts[slice], self.starts[slice + 1]];
        cells.clear();
        cells.resize((end - start) as usize, 0);
        self.spool.read_at(u64::from(start) * size_of::<u32>() as u64, bytemuck::cast_slice_mut(cells))
    }

    /// The field round planes of a grid of `cells`, for places near them, from the lowest on.
    pub fn round_planes(&self, cells: Cell) -> RoundPlane<'_> {
        RoundPlane { membranes: self, cells, window: Window::new(2 * BESIDE as usize + 1, Vec::new), first: 0 }
    }
}

/// The field round a plane that moves up.
#[derive(Debug)]
pub struct RoundPlane<'a> {
    membranes: &'a Membranes,
    cells: Cell,
    window: Window<Vec<u32>>,
    /// The lowest slice of the block that is held.
    first: i64,
}

/// u at a place, and how it grows along each axis.
struct At {
    u: f64,
    gradient: [f64; 3],
}

impl RoundPlane<'_> {
    /// Moves up to a plane of the grid.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn slide_to(&mut self, plane: u32) -> Result<()> {
        let membranes = self.membranes;
        self.first = i64::from(plane / membranes.common.factor) + PAD as i64 - BESIDE;
        self.window.slide_to(self.first, |slice, cells| match usize::try_from(slice) {
            Ok(slice) if slice < membranes.slices() => {
                membranes.trace.read(slice);
                membranes.read(slice, cells)
            }
            _ => {
                cells.clear();
                Ok(())
            }
        })
    }

    /// Where the membrane lies beside a place that is at most a cell from the plane, in cells of the grid: where Newton's steps along the gradient of u lead, or as far there as a vertex may move.
    /// It is cut off where it leaves the grid, as the solid is: a lid that faces a side of the box is flat. None where u is not known all round, or the steps lead nowhere.
    pub fn place(&self, from: [f64; 3]) -> Option<[f64; 3]> {
        let factor = f64::from(self.membranes.common.factor);
        let from = from.map(|c| c / factor);
        let (mut at, mut last) = (from, f64::INFINITY);
        for _ in 0..STEPS {
            let At { u, gradient } = self.u(at)?;
            let squared: f64 = gradient.iter().map(|c| c * c).sum();
            if squared == 0.0 {
                return None;
            }
            (0..3).for_each(|a| at[a] -= u * gradient[a] / squared);
            last = u.abs() / squared.sqrt();
        }
        if last > SHORT {
            return None;
        }
        let way: [f64; 3] = std::array::from_fn(|a| at[a] - from[a]);
        let length = way.iter().map(|c| c * c).sum::<f64>().sqrt();
        let most = FARTHEST.min(MOST_TRAVEL / factor);
        let share = if length > most { most / length } else { 1.0 };
        Some(std::array::from_fn(|a| ((from[a] + share * way[a]) * factor).clamp(0.0, f64::from(self.cells[a]))))
    }

    /// u at a place, in cells of the level: the quadratic B-spline over the middles of 3×3×3 cells; none if one of them is not known.
    fn u(&self, place: [f64; 3]) -> Option<At> {
        // The cell that the place lies in, and how far from its middle.
        let cell = place.map(f64::floor);
        let off: [f64; 3] = std::array::from_fn(|a| place[a] - cell[a] - 0.5);
        let weights = off.map(|d| [0.5 * (0.5 - d) * (0.5 - d), 0.75 - d * d, 0.5 * (0.5 + d) * (0.5 + d)]);
        let slopes = off.map(|d| [d - 0.5, -2.0 * d, d + 0.5]);
        let [x, y, z] = cell.map(|c| c as i64 + PAD as i64);
        let mut at = At { u: 0.0, gradient: [0.0; 3] };
        for dy in 0..3 {
            for dz in 0..3 {
                let row = self.three(y + dy as i64 - 1, z + dz as i64 - 1, x - 1)?;
                let sum = |weights: [f64; 3]| row[0] * weights[0] + row[1] * weights[1] + row[2] * weights[2];
                let (along, slope) = (sum(weights[0]), sum(slopes[0]));
                at.u += along * weights[1][dy] * weights[2][dz];
                at.gradient[0] += slope * weights[1][dy] * weights[2][dz];
                at.gradient[1] += along * slopes[1][dy] * weights[2][dz];
                at.gradient[2] += along * weights[1][dy] * slopes[2][dz];
            }
        }
        Some(at)
    }

    /// The u of three cells of a row of the block, from `x` on.
    fn three(&self, slice: i64, row: i64, x: i64) -> Option<[f64; 3]> {
        let Common { width, rows, .. } = self.membranes.common;
        let is_there = (self.first..self.first + 2 * BESIDE + 1).contains(&slice)
            && (0..i64::from(rows)).contains(&row)
            && (0..=i64::from(width) - 3).contains(&x);
        let first = is_there.then(|| (row * i64::from(width) + x) as u32)?;
        let cells = self.window.get(slice);
        let at = cells.partition_point(|cell| cell >> 16 < first);
        let three = cells.get(at..at + 3)?;
        let u = |cell: u32| f64::from(cell as u16 as i16) / f64::from(ONE);
        (three[0] >> 16 == first && three[2] >> 16 == first + 2).then(|| [u(three[0]), u(three[1]), u(three[2])])
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;
    use crate::run::testing::with_context;

    const CELLS: [u32; 3] = [14, 11, 9];

    /// Every cell of the block with its number and its middle, in cells of the level.
    fn all(block: &Block) -> impl Iterator<Item = (u32, [f64; 3])> {
        let (width, rows) = (block.width, block.rows);
        (0..block.size()).map(move |cell| {
            let at = [cell % width, cell / (width * rows), cell / width % rows];
            (cell as u32, at.map(|c| c as f64 - PAD as f64 + 0.5))
        })
    }

    fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
        (0..3).map(|i| a[i] * b[i]).sum()
    }

    /// The quadratic B-spline that is centred on 0.
    fn spline(t: f64) -> f64 {
        match t.abs() {
            t if t <= 0.5 => 0.75 - t * t,
            t if t <= 1.5 => 0.5 * (1.5 - t) * (1.5 - t),
            _ => 0.0,
        }
    }

    proptest! {
        #[test]
        fn places_are_on_a_plane_that_u_is_0_on(
            normal in prop::array::uniform3(-1.0f64..1.0),
            factor in 1u32..9,
            froms in prop::collection::vec(prop::array::uniform3(3.0f64..6.0), 1..20),
        ) {
            let length = dot(normal, normal).sqrt();
            prop_assume!(length > 0.3);
            let normal = normal.map(|c| c / length);
            let middle = [4.5; 3];
            let height = |p: [f64; 3]| dot(normal, [0, 1, 2].map(|a| p[a] - middle[a]));
            let block = Block::new(CELLS);
            let near: Vec<(u32, f32)> = all(&block).map(|(cell, p)| (cell, (height(p) / 16.0) as f32)).collect();
            with_context(CELLS, |context| {
                let membranes = Membranes::of(&block, factor, &near, context).unwrap().unwrap();
                let mut froms = froms;
                froms.sort_by(|a, b| a[1].total_cmp(&b[1]));
                let mut round = membranes.round_planes(CELLS.map(|c| c * factor));
                for from in froms {
                    let f = f64::from(factor);
                    let of_grid = from.map(|c| c * f);
                    round.slide_to(of_grid[1].round() as u32).unwrap();
                    let place = round.place(of_grid).unwrap();
                    let way: [f64; 3] = std::array::from_fn(|a| (place[a] - of_grid[a]) / f);
                    // Straight to it, or as far as a vertex may.
                    let most = 2.0f64.min(6.0 / f);
                    let expected = (-height(from)).clamp(-most, most);
                    for a in 0..3 {
                        prop_assert!((way[a] - expected * normal[a]).abs() < 0.01, "{way:?}, {expected} along {normal:?}");
                    }
                }
                Ok(())
            })?;
        }

        #[test]
        fn u_is_the_splines_where_it_is_known(
            known in prop::collection::vec(prop::option::weighted(0.97, -1.0f32..1.0), 22 * 19 * 17),
            places in prop::collection::vec((-1.0f64..14.0, -1.0f64..11.0, -1.0f64..9.0), 1..40),
        ) {
            let block = Block::new(CELLS);
            let near: Vec<(u32, f32)> =
                (0u32..).zip(&known).take(block.size()).filter_map(|(cell, u)| Some((cell, (*u)?))).collect();
            let of_cell: BTreeMap<u32, f32> = near.iter().copied().collect();
            with_context(CELLS, |context| {
                let membranes = Membranes::of(&block, 1, &near, context).unwrap().unwrap();
                let mut places: Vec<[f64; 3]> = places.into_iter().map(|(x, y, z)| [x, y, z]).collect();
                places.sort_by(|a, b| a[1].total_cmp(&b[1]));
                let mut round = membranes.round_planes(CELLS);
                for place in places {
                    round.slide_to(place[1].max(0.0) as u32).unwrap();
                    let mut sum = Some(0.0);
                    for (cell, middle) in all(&block) {
                        if (0..3).all(|a| (place[a].floor() + 0.5 - middle[a]).abs() < 1.1) {
                            let weight: f64 = (0..3).map(|a| spline(place[a] - middle[a])).product();
                            sum = sum.zip(of_cell.get(&cell)).map(|(sum, u)| sum + weight * f64::from(*u));
                        }
                    }
                    match (round.u(place), sum) {
                        (Some(at), Some(u)) => prop_assert!((at.u - u).abs() < 1e-4, "{place:?}: {} and {u}", at.u),
                        (at, sum) => prop_assert_eq!(at.is_none(), sum.is_none(), "{:?}", place),
                    }
                    // The gradient, by differences.
                    if let Some(at) = round.u(place) {
                        for a in 0..3 {
                            let beside = |d: f64| round.u(std::array::from_fn(|b| place[b] + if a == b { d } else { 0.0 }));
                            if let (Some(less), Some(more)) = (beside(-1e-4), beside(1e-4)) {
                                let slope = (more.u - less.u) / 2e-4;
                                prop_assert!((slope - at.gradient[a]).abs() < 1e-2, "{place:?}, {a}: {slope}");
                            }
                        }
                    }
                }
                Ok(())
            })?;
        }
    }
}
