//! Reopening: what the closing filled though the points say that it is outside is opened again.
//!
//! A ball does not enter a slot that is narrower than itself, so the solid fills it. But the walls on both sides of it have points, whose planes tell
//! how the surface lies; and where walls are seen from the outside, these tell on which side of them it is:
//!
//! ```text
//!    o o o o o o o o o        o outside, # occupied, + filled
//!    # # # o o o # # #
//!        # + + + #            1. every occupied cell gets a plane from the cells round it (plane)
//!        # + + + #            2. cells that the outside is near to on one side get a sign; others are hidden (wall)
//!        # + + + #            3. hidden cells get theirs from one another (signs)
//!        # # # # #            4. the winding number of all that tells what is outside (field)
//!                             5. which opens from the outside, and makes no pieces, and no tunnels but wide ones (open, core; solid/growth)
//!                             6. and so do walls that are hidden still (clefts); what these bare is looked at once more, from 2 on
//! ```
//!
//! All passes go over chunks of slices and hold some slices more on either side; from pass to pass, what is known of each cell lies in spools. Only blocks of cells near
//! *deep* occupied cells are looked at, which no cell outside the solid touches: where there are none, nothing was filled that has points round it.

pub(in crate::solid) mod blocks;
mod clefts;
mod core;
mod dipole;
mod field;
pub(in crate::solid) mod found;
pub(in crate::solid) mod layers;
mod open;
mod plane;
mod signs;
mod sizes;
pub(in crate::solid) mod tile;
mod wall;

#[cfg(test)]
pub(in crate::solid) mod marks;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod twin;

use std::collections::BTreeSet;
use std::ops::Range;

use bytemuck::Pod;

use self::blocks::{BLOCK, Blocks};
use self::dipole::{Areas, Dipole};
use self::field::Kernel;
use self::found::Found;
use self::layers::{Cells, Held, Layers, Rounds, Stretch};
use self::plane::{Moments, Near, Sum};
use self::signs::Signs;
use self::sizes::Sizes;
pub use self::sizes::{bytes_to_expect, records_to_expect};
use self::tile::{TILE, Tile};
use self::wall::{HIDDEN, Wall};
use crate::error::Result;
use crate::grid::bucket::Buckets;
use crate::grid::context::{Context, chunks};
use crate::grid::dilate::Ball;
use crate::grid::occupancy::Sampled;
use crate::grid::partition::BUCKET_SLICES;
use crate::grid::slice::{Bits, Run, Runs, SliceStore, Slices};
use crate::grid::{Cell, Grid};
use crate::points::Coordinate;
use crate::solid::change::Change;
use crate::solid::exterior::Padded;
use crate::solid::{Solid, move_back};

/// Cells within this squared distance of one touch it.
const TOUCHES: u32 = 3;

/// So many deep occupied cells in a block are evidence that something was filled; and then, so many hidden walls.
const EVIDENCE: u32 = 3;

/// Blocks on every side of one with evidence: in these cells may open; and in these the walls are looked at that tell so.
const OPEN: u32 = 1;
const LOOKED_AT: u32 = 2;

/// The Gaussian's standard deviation: in sampling distances, and in cells from and to.
const SIGMA: f64 = 3.0;
const SIGMA_CELLS: (f64, f64) = (2.0, 3.0);

/// Steps of finding the walls' planes, for progress.
pub const STEPS_BEFORE: u64 = 2;

/// Steps of opening a solid, or its clefts.
pub const STEPS: u64 = 8;

/// How the points lie.
#[derive(Debug, Clone, Copy)]
pub struct Sampling<'a> {
    /// A cell's side, in sampling distances.
    pub side: f64,
    /// What sheets were thickened by: there, walls are hidden in cells that no point lies in.
    pub thickened: Option<&'a SliceStore>,
}

/// What passes over chunks of slices are given.
pub struct Slabs<'a> {
    /// Who works, and where temporary data goes.
    context: &'a Context,
    /// Cells along x, slices, rows.
    cells: Cell,
    /// The occupied cells that are looked at.
    active: SliceStore,
    /// Blocks in which cells may open.
    allowed: Blocks,
    /// Jobs in flight.
    jobs: usize,
    /// What they depend on.
    sizes: Sizes,
}

impl Slabs<'_> {
    /// Runs `work` on every chunk, and `sink` on what it gives, in order.
    fn each<R: Send>(
        &self,
        work: impl Fn(Range<u32>) -> Result<R> + Sync,
        sink: impl FnMut(R) -> Result<()>,
    ) -> Result<()> {
        let mut jobs = chunks(self.cells[1]);
        self.context.workers.in_order(self.jobs, || Ok(jobs.next()), work, sink)
    }

    /// What is known of the active cells of a chunk and so many slices more on either side.
    fn held<T: Pod>(&self, values: &Layers<T>, chunk: &Range<u32>, more: i64) -> Result<Held<T>> {
        Held::read(&self.active, values, i64::from(chunk.start) - more..i64::from(chunk.end) + more)
    }

    /// The slices of a store round a chunk.
    fn stretch(store: &SliceStore, chunk: &Range<u32>, more: i64) -> Result<Stretch> {
        Stretch::read(store, i64::from(chunk.start) - more..i64::from(chunk.end) + more)
    }

    /// The tiles of a chunk in which cells may open.
    fn tiles(&self, chunk: &Range<u32>, margin: i64) -> Result<Vec<Tile>> {
        let mut at = BTreeSet::new();
        let mut runs = Runs::default();
        for layer in chunk.start / BLOCK..chunk.end.div_ceil(BLOCK) {
            self.allowed.read(layer * BLOCK, &mut runs)?;
            for z in 0..runs.row_count() {
                for run in runs.row(z) {
                    let tiles = run.start * BLOCK / TILE..(run.end * BLOCK).div_ceil(TILE);
                    at.extend(tiles.map(|x| (z * BLOCK / TILE, x)));
                }
            }
        }
        Ok(Tile::at(at, chunk, self.cells, margin))
    }

    /// Makes a store of what `work` finds in every tile.
    fn found(
        &self,
        margin: i64,
        work: impl Fn(&Range<u32>, &[Tile], &mut Found<()>) -> Result<()> + Sync,
    ) -> Result<SliceStore> {
        self.context.slices_of(self.cells[1], self.jobs, |chunk, slices| {
            let (tiles, mut found) = (self.tiles(&chunk, margin)?, Found::new(chunk.clone()));
            if !tiles.is_empty() {
                work(&chunk, &tiles, &mut found)?;
            }
            found.sorted(self.cells).0.iter().for_each(|runs| slices.push_runs(runs));
            Ok(())
        })
    }
}

/// One value for each cell of a chunk.
fn mapped<T: Pod, U>(held: &Held<T>, chunk: &Range<u32>, mut each: impl FnMut([i64; 3], &T) -> U) -> Vec<Vec<U>> {
    let mut slice = |y: u32| {
        let (cells, values) = held.slice(y.into());
        cells.iter().zip(values).map(|((z, x), value)| each([x, y, z].map(i64::from), value)).collect()
    };
    chunk.clone().map(&mut slice).collect()
}

/// The walls round what the closing filled, and how they tell what is outside.
pub struct Reopening<'a> {
    slabs: Slabs<'a>,
    occupied: &'a SliceStore,
    thickened: Option<&'a SliceStore>,
    kernel: Kernel,
    planes: Layers<Wall>,
}

impl<'a> Reopening<'a> {
    /// The walls where the solid hides points; none where it hides hardly any. `step` is called [`STEPS_BEFORE`] times at most.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn of<T: Coordinate>(
        solid: &Solid,
        sampled: &Sampled<'a, T>,
        sampling: Sampling<'a>,
        context: &'a Context,
        mut step: impl FnMut(),
    ) -> Result<Option<Reopening<'a>>> {
        Reopening::with(solid, sampled.occupied, sampling, context, |slabs| {
            step();
            let moments = slabs.moments(sampled.buckets, sampled.grid)?;
            step();
            Ok(moments)
        })
    }

    /// The same, with what `moments` says of the active cells.
    fn with(
        solid: &Solid,
        occupied: &'a SliceStore,
        sampling: Sampling<'a>,
        context: &'a Context,
        moments: impl FnOnce(&Slabs) -> Result<Layers<Moments>>,
    ) -> Result<Option<Reopening<'a>>> {
        let kernel = Kernel::new((SIGMA / sampling.side).clamp(SIGMA_CELLS.0, SIGMA_CELLS.1));
        let Some(slabs) = Slabs::find(solid, occupied, kernel.reach, context)? else { return Ok(None) };
        let planes = slabs.planes(&moments(&slabs)?)?;
        Ok(Some(Reopening { slabs, occupied, thickened: sampling.thickened, kernel, planes }))
    }

    /// The solid with what the closing filled opened again, where the walls say so. `step` is called [`STEPS`] times at most.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn opened(&mut self, solid: Solid, step: impl FnMut()) -> Result<Solid> {
        self.pass(solid, None, step)
    }

    /// What is left when the solid was opened, in some blocks alone if these are given.
    fn pass(&mut self, solid: Solid, near: Option<&Blocks>, mut step: impl FnMut()) -> Result<Solid> {
        let Reopening { slabs, occupied, kernel, .. } = self;
        let (occupied, context) = (*occupied, slabs.context);
        slabs.sizes.faces.clone_from(&solid.faces);
        let walls = slabs.seen(&solid, &self.planes)?;
        step();
        let signs = Signs::find(slabs, &walls)?;
        step();
        let mut evident = Blocks::with_cells(&slabs.hidden(&walls)?, EVIDENCE, slabs.cells, context)?;
        if let Some(near) = near {
            evident = evident.both(near, context)?;
        }
        if evident.is_empty() {
            return Ok(solid);
        }
        slabs.allowed = evident.widened(OPEN, context)?;
        let dipoles = slabs.dipoles(&walls, &signs, &evident.widened(LOOKED_AT, context)?)?;
        // At most all free cells are candidates; how many are is known when they are found.
        slabs.jobs = slabs.jobs_of(&slabs.sizes.of_field(&slabs.free(&solid, occupied)?));
        step();
        let candidates = slabs.candidates(&solid, occupied, &dipoles, kernel)?;
        slabs.take(slabs.sizes.of_field(&candidates.1.counts()));
        step();
        let (outside, sure) = slabs.labelled(&solid, &dipoles, &candidates, kernel)?;
        drop((candidates, dipoles));
        step();
        let target = slabs.found(open::LOOK, |chunk, tiles, found| {
            let held = signs.walls(slabs, &walls, chunk, open::LOOK)?;
            let solid = Slabs::stretch(&solid.store, chunk, open::LOOK)?;
            let outside = Slabs::stretch(&outside, chunk, open::LOOK)?;
            // Tiles reach beyond the blocks in which cells may open.
            let allowed = slabs.allowed.of_slices(chunk)?;
            for tile in tiles {
                open::target(tile, &held, &solid, &outside, |cell| {
                    if allowed.get(cell.map(|c| c / i64::from(BLOCK))) {
                        found.push(cell, ());
                    }
                });
            }
            Ok(())
        })?;
        step();
        if target.is_empty() {
            return Ok(solid);
        }
        let core = slabs.core(&solid, occupied, &target, &sure)?;
        step();
        let opened = solid.growth(core, &target, Change::Removed, context)?;
        step();
        let (left, target) = (solid.without(&opened, context)?, slabs.less(&target, &opened)?);
        drop((solid, opened));
        let rungs = slabs.rungs(&left, target)?;
        left.without(&rungs, context)
    }
}

impl Solid {
    /// The deep occupied cells: those with no cell outside the solid within a squared distance.
    fn deep(&self, squared: u32, occupied: &SliceStore, context: &Context) -> Result<SliceStore> {
        let ball = Ball::squared(squared);
        let padded = Padded::new(self.cells, ball.radius());
        let pad = padded.pad;
        context.slices_of(self.cells[1], context.jobs(ball.radius(), self.cells), |chunk, slices| {
            let mut runs = Runs::default();
            let mut dilation = padded.dilation(ball, chunk.end + pad);
            let mut deep = Bits::new(self.cells[0], self.cells[2]);
            let mut moved = vec![0; deep.row_words()];
            for y in chunk {
                let near = dilation.slide_to(i64::from(y + pad), |y, bits| {
                    self.store.paint_moved(y - i64::from(pad), pad, bits, &mut runs)?;
                    bits.complement();
                    Ok(())
                })?;
                occupied.paint(y.into(), &mut deep, &mut runs)?;
                for z in 0..self.cells[2] {
                    if deep.lit_row(z).is_some() {
                        move_back(near.row(z + pad), pad, &mut moved);
                        deep.row_mut(z).iter_mut().zip(&moved).for_each(|(cell, near)| *cell &= !near);
                    }
                }
                slices.push(&deep);
            }
            Ok(())
        })
    }
}

impl<'a> Slabs<'a> {
    /// The blocks and cells that are looked at; none if there is no evidence that anything was filled. The Gaussian is going to reach so many cells.
    fn find(solid: &Solid, occupied: &SliceStore, gaussian: i64, context: &'a Context) -> Result<Option<Slabs<'a>>> {
        let deep = solid.deep(TOUCHES, occupied, context)?;
        if deep.is_empty() {
            return Ok(None);
        }
        let cells = solid.cells;
        let evident = Blocks::with_cells(&deep, EVIDENCE, cells, context)?;
        if evident.is_empty() {
            return Ok(None);
        }
        let (allowed, looked_at) = (evident.widened(OPEN, context)?, evident.widened(LOOKED_AT, context)?);
        let mut active = SliceStore::new(&context.workspace, context.memory.store_quota);
        let mut in_slice = Vec::with_capacity(cells[1] as usize);
        let mut jobs = chunks(cells[1]);
        context.workers.in_order(
            context.memory.chunks_in_flight,
            || Ok(jobs.next()),
            |chunk| {
                let (mut runs, mut blocks, mut slices) = (Runs::default(), Runs::default(), Slices::default());
                let mut counts = Vec::with_capacity(chunk.len());
                for y in chunk {
                    occupied.read(y, &mut runs)?;
                    looked_at.read(y, &mut blocks)?;
                    let left = blocks::within(&runs, &blocks);
                    counts.push(left.cell_count() as u32);
                    slices.push_runs(&left);
                }
                Ok((counts, slices))
            },
            |(counts, slices)| {
                in_slice.extend(counts);
                active.extend(&slices)
            },
        )?;
        let sizes = Sizes { cells, gaussian, active: in_slice, faces: solid.faces.clone() };
        let mut slabs = Slabs { context, cells, active, allowed, jobs: 1, sizes };
        slabs.take(slabs.sizes.of_walls());
        Ok(Some(slabs))
    }

    /// From now on, the job over each chunk takes so many bytes, and gives so many; the account is told what jobs side by side take.
    fn take(&mut self, mut bytes: Vec<[u64; 2]>) {
        self.jobs = self.jobs_of(&bytes);
        bytes.sort_unstable_by(|a, b| b.cmp(a));
        // Those that take the most may stand side by side; the others wait, with what they give.
        let threads = self.context.workers.threads();
        let in_flight = bytes.iter().take(self.jobs).enumerate();
        self.context.account.reopening(in_flight.map(|(i, [all, given])| if i < threads { all } else { given }).sum());
    }

    /// Jobs in flight, if they take so many bytes.
    fn jobs_of(&self, bytes: &[[u64; 2]]) -> usize {
        self.context.memory.jobs_of(bytes.iter().map(|[all, _]| *all).max().unwrap_or(0))
    }

    /// Of each slice, the solid's free cells that lie where cells may open.
    fn free(&self, solid: &Solid, occupied: &SliceStore) -> Result<Vec<u32>> {
        let mut out = Vec::with_capacity(self.cells[1] as usize);
        let mut jobs = chunks(self.cells[1]);
        self.context.workers.in_order(
            self.context.memory.chunks_in_flight,
            || Ok(jobs.next()),
            |chunk| {
                let (mut runs, mut blocks) = (Runs::default(), Runs::default());
                let free = |y| {
                    self.allowed.read(y, &mut blocks)?;
                    let mut within = |store: &SliceStore| {
                        store.read(y, &mut runs)?;
                        Ok(blocks::within(&runs, &blocks).cell_count())
                    };
                    Ok(within(&solid.store)?.saturating_sub(within(occupied)?) as u32)
                };
                chunk.map(free).collect::<Result<Vec<u32>>>()
            },
            |free| {
                out.extend(free);
                Ok(())
            },
        )?;
        Ok(out)
    }

    /// What is known of the points of the active cells.
    fn moments<T: Coordinate>(&self, buckets: &Buckets<T>, grid: &Grid) -> Result<Layers<Moments>> {
        let mut out = Layers::new(self.context);
        let mut jobs = 0..buckets.count();
        let slices = self.cells[1];
        self.context.workers.in_order(
            self.jobs,
            || Ok(jobs.next()),
            |bucket| {
                let first = bucket as u32 * BUCKET_SLICES;
                let mut runs = Runs::default();
                let read = |y| {
                    self.active.read(y, &mut runs)?;
                    Ok(Cells::of(&runs))
                };
                let cells = (first..slices.min(first + BUCKET_SLICES)).map(read).collect::<Result<Vec<Cells>>>()?;
                let mut sums: Vec<Vec<Sum>> = cells.iter().map(|cells| vec![Sum::default(); cells.count()]).collect();
                if sums.iter().any(|sums| !sums.is_empty()) {
                    buckets.read(bucket, |points| {
                        for point in points {
                            let ([x, y, z], within) = grid.place_of(point.map(Into::into));
                            let slice = (y - first) as usize;
                            if let Some(number) = cells[slice].at(x.into(), z.into()) {
                                sums[slice][number].add(within);
                            }
                        }
                        Ok(())
                    })?;
                }
                Ok(sums.into_iter().map(|sums| sums.iter().map(Sum::moments).collect()).collect::<Vec<Vec<Moments>>>())
            },
            |slices| out.extend(&slices),
        )?;
        Ok(out)
    }

    /// The active cells with their planes.
    fn planes(&self, moments: &Layers<Moments>) -> Result<Layers<Wall>> {
        let mut out = Layers::new(self.context);
        self.each(
            |chunk| {
                let held = self.held(moments, &chunk, plane::REACH[1])?;
                let mut rounds = plane::REACH.map(|reach| Rounds::new(&held, reach));
                let mut near = Vec::new();
                Ok(mapped(&held, &chunk, |cell, own| {
                    let mut wide = false;
                    for (number, rounds) in rounds.iter_mut().enumerate() {
                        near.clear();
                        rounds.round(cell, |there, moments| {
                            near.push(Near::new([0, 1, 2].map(|a| there[a] - cell[a]), moments))
                        });
                        wide = number > 0;
                        if plane::is_enough(&near) {
                            break;
                        }
                    }
                    let plane = plane::plane(own, &near, wide);
                    Wall { mean: own.mean, normal: plane.normal, confidence: plane.confidence, ..Wall::default() }
                }))
            },
            |slices| out.extend(&slices),
        )?;
        Ok(out)
    }

    /// The walls as they are seen from outside the solid.
    fn seen(&self, solid: &Solid, walls: &Layers<Wall>) -> Result<Layers<Wall>> {
        let mut out = Layers::new(self.context);
        self.each(
            |chunk| {
                let held = self.held(walls, &chunk, wall::SIGHT)?;
                if held.is_empty() {
                    return Ok(vec![Vec::new(); chunk.len()]);
                }
                let solid = Slabs::stretch(&solid.store, &chunk, wall::SIGHT)?;
                let mut rounds = Rounds::new(&held, wall::NEXT_REACH);
                Ok(mapped(&held, &chunk, |cell, wall| wall.seen(cell, &mut rounds, &solid)))
            },
            |slices| out.extend(&slices),
        )?;
        Ok(out)
    }

    /// The cells of hidden walls.
    fn hidden(&self, walls: &Layers<Wall>) -> Result<SliceStore> {
        self.context.slices_of(self.cells[1], self.jobs, |chunk, slices| {
            let held = self.held(walls, &chunk, 0)?;
            for y in chunk {
                let (cells, walls) = held.slice(y.into());
                let mut rows = vec![Vec::new(); self.cells[2] as usize];
                for ((z, x), _) in cells.iter().zip(walls).filter(|(_, wall)| wall.kind == HIDDEN) {
                    rows[z as usize].push(Run { start: x, end: x + 1 });
                }
                slices.push_runs(&Runs::joined(rows));
            }
            Ok(())
        })
    }

    /// What each wall adds to the winding number; those outside some blocks add nothing.
    fn dipoles(&self, walls: &Layers<Wall>, signs: &Signs, near: &Blocks) -> Result<Layers<Dipole>> {
        let mut out = Layers::new(self.context);
        self.each(
            |chunk| {
                let held = signs.walls(self, walls, &chunk, dipole::BOUNDS)?;
                let (mut blocks, mut areas) = (Runs::default(), Areas::new(&held));
                let slice = |y: u32| {
                    near.read(y, &mut blocks)?;
                    let (cells, values) = held.slice(y.into());
                    let dipole = |((z, x), wall): ((u32, u32), &Wall)| match blocks::holds(&blocks, x, z) {
                        true => Dipole::of(wall, [x, y, z].map(i64::from), &mut areas),
                        false => Dipole { mean: wall.mean, area: [0.0; 3], inside: 1.0 },
                    };
                    Ok(cells.iter().zip(values).map(dipole).collect())
                };
                chunk.map(slice).collect::<Result<Vec<Vec<Dipole>>>>()
            },
            |slices| out.extend(&slices),
        )?;
        Ok(out)
    }
}
