//! Sides: which free cells lie outside and which inside, found where a large ball still fits and carried on to smaller ones.
//!
//! One closing radius for the whole cloud, needed by one hole, bridges every concavity narrower than that hole. So the radius falls: outside and
//! inside are first told apart by the ball that seals ([`crate::stage::seal`]); then, ball by ball, the cells that become free are given
//! to a side.
//!
//! ```text
//!   o o o o . . . o o o o     # occupied, o outside, i inside, free for the large ball; . and ? are not
//!   o o o . # # # . o o o
//!   o o . # # . # # . o o     ? becomes free for a smaller ball. Next to one side, it is that side's:
//!   o . # # ? ? ? # # . o       the mouth of the concavity on top, the edges of the inside.
//!   o . # . . i . . # . o     A component that lies next to neither, or next to both, is judged by its walls (`walls.rs`):
//!   o . # . i i i . # . o       walls with the inside behind them say outside, and the reverse.
//!   o . # # # ? # # # . o     A hole (the ? below) has walls with neither or both behind: it stays bridged.
//!   o o . . . ? . . . o o
//! ```
//!
//! *Next to a side*: in the ball (the larger one, of the step before) round one of its cells. The steps halve the ball's squared radius, down
//! to 2: at the end, the passage that a cell lies in is more than two cells wide. Large balls fall on a coarser level of the pyramid
//! ([`Sides::refined`]), so that no ball on any level is much larger than ten cells.

use crate::context::{Context, chunks};
use crate::error::Result;
use crate::slice::{Bits, Runs, SliceStore, clip, set_range, words_for};
use crate::stage::dilate::Ball;
use crate::stage::exterior::{Exterior, Padded, Scratch, invert, near};
use crate::stage::raster::Occupancy;
use crate::stage::walls::{INSIDE, OUTSIDE, Open};
use crate::window::Window;

/// The last step's squared radius.
const LAST: u32 = 2;

/// On a coarser level the ball falls no further than to this squared radius: what is finer is seen better on the next level.
const LAST_COARSE: u32 = 4;

/// The squared radius of the step after one of `squared`: half of it, but not past 4, and then the last. Smaller steps change nothing but the time.
fn next(squared: u32) -> u32 {
    if squared > 4 { (squared / 2).max(4) } else { LAST }
}

/// The free cells whose side is known, in the padded box.
#[derive(Debug)]
pub struct Sides {
    /// The box.
    pub padded: Padded,
    outside: SliceStore,
    inside: SliceStore,
    /// Squared radius of the ball for which all free cells were considered.
    squared: u32,
}

/// The slices of two stores.
type Pair = Vec<[Runs; 2]>;

impl Sides {
    /// The sides that a ball tells apart: the exterior is outside, enclosed free cells are inside. `squared` is the ball's squared radius.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn told_by(exterior: &Exterior, squared: u32, context: &Context) -> Result<Sides> {
        let padded = exterior.padded;
        let [outside, inside] = pairs(padded, 1, context, |slices| {
            let (mut bits, mut scratch) = (padded.bits(), Scratch::default());
            let both = |y: u32| {
                bits.clear();
                exterior.paint(y, &mut bits, &mut scratch)?;
                let outside = Runs::from_bits(&bits);
                bits.clear();
                exterior.paint_enclosed(y, &mut bits, &mut scratch)?;
                Ok([outside, Runs::from_bits(&bits)])
            };
            slices.map(both).collect()
        })?;
        Ok(Sides { padded, outside, inside, squared })
    }

    /// Lets the ball fall to the last step of this level; `progress` is told the slices of each step.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn fallen(
        mut self,
        occupancy: &Occupancy,
        level: u32,
        context: &Context,
        progress: &mut dyn FnMut(u32),
    ) -> Result<Sides> {
        let last = if level > 0 { LAST_COARSE } else { LAST };
        while self.squared > last {
            let squared = next(self.squared);
            self = self.step(occupancy, squared, context)?;
            progress(occupancy.cells[1]);
        }
        Ok(self)
    }

    /// The same sides on the next finer level, whose cells are half as large: a cell has its parent's side, if it is free for the
    /// smallest ball.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn refined(&self, finer: &Occupancy, context: &Context) -> Result<Sides> {
        let squared = 4 * self.squared;
        let padded = Padded::new(finer.cells, Ball::squared(squared).radius());
        // Parents of the padding lie in the coarser padding, or beyond it, where all is outside.
        let coarse = self.padded;
        let free = Ball::squared(LAST);
        let [outside, inside] = pairs(padded, free.radius(), context, |slices| {
            let mut window = Window::new(2 * free.radius() as usize + 1, || padded.bits());
            let (mut runs, mut taken) = (Runs::default(), vec![0; words_for(padded.cells[0])]);
            let mut bits = [padded.bits(), padded.bits()];
            let mut out = Vec::new();
            for y in slices {
                let reach = i64::from(free.radius());
                window.slide_to(i64::from(y) - reach, |y, bits| padded.paint_occupied(finer, y, bits, &mut runs))?;
                bits.iter_mut().for_each(Bits::clear);
                let parent_y = (i64::from(y) - i64::from(padded.pad)).div_euclid(2) + i64::from(coarse.pad);
                let held = (0..i64::from(coarse.cells[1])).contains(&parent_y);
                for (store, bits) in [&self.outside, &self.inside].into_iter().zip(&mut bits) {
                    if held {
                        store.read(parent_y as u32, &mut runs)?;
                        paint_children(&runs, coarse, padded, bits);
                    }
                }
                if !held {
                    (0..padded.cells[2]).for_each(|z| set_range(bits[0].row_mut(z), 0, padded.cells[0]));
                }
                for z in 0..padded.cells[2] {
                    if free.dilate_row(near(&window, i64::from(y), z), &mut taken) {
                        for bits in &mut bits {
                            and_not(bits.row_mut(z), &taken);
                        }
                    }
                }
                out.push(bits.each_ref().map(Runs::from_bits));
            }
            Ok(out)
        })?;
        Ok(Sides { padded, outside, inside, squared })
    }

    /// The outside cells, slice by slice of the padded box.
    pub fn outside(&self) -> &SliceStore {
        &self.outside
    }

    /// The inside cells, slice by slice of the padded box.
    pub fn inside(&self) -> &SliceStore {
        &self.inside
    }

    /// One step: gives the cells that are free for the ball of `squared` a side.
    fn step(self, occupancy: &Occupancy, squared: u32, context: &Context) -> Result<Sides> {
        let padded = self.padded;
        let near = self.near(occupancy, context)?;
        let mut open = SliceStore::new(&context.workspace, context.memory.store_quota);
        let mut found = false;
        let [outside, inside] = {
            let ball = Ball::squared(squared);
            let mut stores = stores(context);
            let mut jobs = chunks(padded.cells[1]);
            context.workers.in_order(
                context.memory.chunks_for(&context.load, 2 * ball.radius() + 2),
                || Ok(jobs.next()),
                |slices| self.next_to_one_side(occupancy, &near, &ball, slices),
                |slices: Vec<[Runs; 3]>| {
                    for [outside, inside, rest] in slices {
                        found |= !rest.all().is_empty();
                        stores[0].append(&outside)?;
                        stores[1].append(&inside)?;
                        open.append(&rest)?;
                    }
                    Ok(())
                },
            )?;
            stores
        };
        let grown = Sides { padded, outside, inside, squared };
        if !found {
            return Ok(grown);
        }
        let (outside, next_to) = (&grown.outside, &near);
        let labels = Open { padded, occupancy, cells: &open, outside, next_to, squared }.judged(context)?;
        let [outside, inside] = pairs(padded, 1, context, |slices| {
            let (mut bits, mut runs, mut scratch) = (padded.bits(), Runs::default(), Scratch::default());
            slices
                .map(|y| {
                    grown.outside.paint(i64::from(y), &mut bits, &mut runs)?;
                    labels.paint(y, OUTSIDE, &mut bits, &mut scratch)?;
                    let outside = Runs::from_bits(&bits);
                    grown.inside.paint(i64::from(y), &mut bits, &mut runs)?;
                    labels.paint(y, INSIDE, &mut bits, &mut scratch)?;
                    Ok([outside, Runs::from_bits(&bits)])
                })
                .collect()
        })?;
        Ok(Sides { padded, outside, inside, squared })
    }

    /// The cells next to either side: in the ball round one of its cells, and not occupied.
    fn near(&self, occupancy: &Occupancy, context: &Context) -> Result<[SliceStore; 2]> {
        let (padded, ball) = (self.padded, Ball::squared(self.squared));
        pairs(padded, 2 * ball.radius(), context, |slices| {
            let reach = i64::from(ball.radius());
            let window = || Window::new(2 * ball.radius() as usize + 1, || padded.bits());
            let mut windows = [window(), window()];
            let (mut occupied, mut runs) = (padded.bits(), Runs::default());
            let mut row = vec![0; words_for(padded.cells[0])];
            let mut out = Vec::new();
            for y in slices {
                for (window, store) in windows.iter_mut().zip([&self.outside, &self.inside]) {
                    window.slide_to(i64::from(y) - reach, |y, bits| store.paint(y, bits, &mut runs))?;
                }
                padded.paint_occupied(occupancy, i64::from(y), &mut occupied, &mut runs)?;
                out.push(windows.each_ref().map(|window| {
                    let mut grown = Runs::default();
                    for z in 0..padded.cells[2] {
                        if ball.dilate_row(near(window, i64::from(y), z), &mut row) {
                            clip(&mut row, padded.cells[0]);
                            if let Some(occupied) = occupied.lit_row(z) {
                                and_not(&mut row, occupied);
                            }
                            grown.push_row(&row);
                        } else {
                            grown.end_row();
                        }
                    }
                    grown
                }));
            }
            Ok(out)
        })
    }

    /// Of some slices: the sides with the newly free cells that lie next to one of them only, and the newly free cells that do not.
    fn next_to_one_side(
        &self,
        occupancy: &Occupancy,
        next_to: &[SliceStore; 2],
        ball: &Ball,
        slices: std::ops::Range<u32>,
    ) -> Result<Vec<[Runs; 3]>> {
        let padded = self.padded;
        let reach = i64::from(ball.radius());
        let mut window = Window::new(2 * ball.radius() as usize + 1, || padded.bits());
        let mut runs = Runs::default();
        let mut sides = [padded.bits(), padded.bits()];
        let mut next_bits = [padded.bits(), padded.bits()];
        let mut free = vec![0; words_for(padded.cells[0])];
        let mut out = Vec::with_capacity(slices.len());
        for y in slices {
            window.slide_to(i64::from(y) - reach, |y, bits| padded.paint_occupied(occupancy, y, bits, &mut runs))?;
            for (bits, store) in sides.iter_mut().zip([&self.outside, &self.inside]) {
                store.paint(i64::from(y), bits, &mut runs)?;
            }
            for (bits, store) in next_bits.iter_mut().zip(next_to) {
                store.paint(i64::from(y), bits, &mut runs)?;
            }
            let mut rest = Runs::default();
            for z in 0..padded.cells[2] {
                if !ball.dilate_row(near(&window, i64::from(y), z), &mut free) {
                    free.fill(0);
                }
                invert(&mut free, padded.cells[0]);
                let [outside, inside] = &mut sides;
                let (near_outside, near_inside) = (next_bits[0].row(z), next_bits[1].row(z));
                let mut any = false;
                for i in 0..free.len() {
                    let new = free[i] & !outside.row(z)[i] & !inside.row(z)[i];
                    free[i] = 0;
                    if new != 0 {
                        let (o, n) = (near_outside[i], near_inside[i]);
                        outside.row_mut(z)[i] |= new & o & !n;
                        inside.row_mut(z)[i] |= new & n & !o;
                        free[i] = new & !(o ^ n);
                        any |= free[i] != 0;
                    }
                }
                if any {
                    rest.push_row(&free);
                } else {
                    rest.end_row();
                }
            }
            let [outside, inside] = sides.each_ref().map(Runs::from_bits);
            out.push([outside, inside, rest]);
        }
        Ok(out)
    }
}

/// Sets the children of the cells of a coarse slice that lie in a fine slice; beyond the coarse box all is set, if the row's end is.
fn paint_children(runs: &Runs, coarse: Padded, fine: Padded, bits: &mut Bits) {
    // The first child of padded coarse cell c is 2 (c - coarse.pad) + fine.pad.
    let child = |c: u32| 2 * (i64::from(c) - i64::from(coarse.pad)) + i64::from(fine.pad);
    let width = i64::from(fine.cells[0]);
    for z in 0..fine.cells[2] {
        let parent = (i64::from(z) - i64::from(fine.pad)).div_euclid(2) + i64::from(coarse.pad);
        let parent = parent.clamp(0, i64::from(runs.row_count()) - 1) as u32;
        for run in runs.row(parent) {
            let start = if run.start == 0 { 0 } else { child(run.start).clamp(0, width) };
            let end = if run.end == coarse.cells[0] { width } else { child(run.end).clamp(0, width) };
            if start < end {
                set_range(bits.row_mut(z), start as u32, end as u32);
            }
        }
    }
}

/// Fills two stores, slice by slice of the padded box, from chunks of slices; `radius` is the reach of their windows, for the plan.
fn pairs(
    padded: Padded,
    radius: u32,
    context: &Context,
    work: impl Fn(std::ops::Range<u32>) -> Result<Pair> + Sync,
) -> Result<[SliceStore; 2]> {
    let mut stores = stores(context);
    let mut jobs = chunks(padded.cells[1]);
    context.workers.in_order(
        context.memory.chunks_for(&context.load, radius),
        || Ok(jobs.next()),
        work,
        |slices: Pair| {
            for pair in slices {
                for (store, runs) in stores.iter_mut().zip(&pair) {
                    store.append(runs)?;
                }
            }
            Ok(())
        },
    )?;
    Ok(stores)
}

fn stores(context: &Context) -> [SliceStore; 2] {
    let store = || SliceStore::new(&context.workspace, context.memory.store_quota);
    [store(), store()]
}

fn and_not(row: &mut [u64], other: &[u64]) {
    row.iter_mut().zip(other).for_each(|(a, b)| *a &= !b);
}
