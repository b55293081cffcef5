//! Sides: which free cells lie outside and which inside, found where a large ball still fits and carried on to smaller ones.
//!
//! One closing radius for the whole cloud, needed by one hole, bridges every concavity narrower than that hole. So the radius falls: outside and
//! inside are first told apart by a field ([`crate::solid::sign`]) or by a ball that is given ([`crate::solid::seal`]); then, ball by ball, the
//! cells that become free are given to a side.
//!
//! ```text
//!   o o o o . . . o o o o     # occupied, o outside, i inside, free for the large ball; . and ? are not
//!   o o o . # # # . o o o
//!   o o . # # . # # . o o     ? becomes free for a smaller ball. Next to one side, it is that side's:
//!   o . # # ? ? ? # # . o       the mouth of the concavity on top, the edges of the inside.
//!   o . # . . i . . # . o     A component that lies next to neither, or next to both, is judged by its walls (`side_votes.rs`):
//!   o . # . i i i . # . o       walls with the inside behind them say outside, and the reverse.
//!   o . # # # ? # # # . o     A hole (the ? below) has walls with neither or both behind: it stays bridged.
//!   o o . . . ? . . . o o
//! ```
//!
//! *Next to a side*: in the ball (the larger one, of the step before) round one of its cells. The steps halve the ball's squared radius, down
//! to 2: at the end, the passage that a cell lies in is more than two cells wide. Large balls fall on a coarser level of the pyramid
//! ([`Sides::refined`]), so that no ball on any level is much larger than ten cells.

use crate::error::Result;
use crate::grid::context::{Context, chunks};
use crate::grid::dilate::Ball;
use crate::grid::occupancy::Occupancy;
use crate::grid::slice::{Bits, Runs, SliceStore, Slices, behind, set_range};
use crate::solid::exterior::{Exterior, Padded, Scratch};
use crate::solid::side_votes::{INSIDE, OUTSIDE, Open};
use crate::solid::sign::{PAD, Side, Signed};
use crate::solid::thicken::Sheets;

/// The last step's squared radius.
pub const LAST: u32 = 2;

/// On a coarser level the ball falls no further than to this squared radius: what is finer is seen better on the next level.
pub const LAST_COARSE: u32 = 4;

/// The squared radius of the step after one of `squared`: half of it, but not past 4, and then the last. Smaller steps change nothing but the time.
fn next(squared: u32) -> u32 {
    if squared > 4 { (squared / 2).max(4) } else { LAST }
}

/// How many steps a ball of `squared` takes to fall to `last`.
pub fn steps(squared: u32, last: u32) -> u32 {
    let fall = |squared: &u32| Some(next(*squared).max(last)).filter(|_| *squared > last);
    std::iter::successors(Some(squared), fall).count() as u32 - 1
}

/// The free cells whose side is known, in the padded box.
#[derive(Debug)]
pub struct Sides {
    /// The box.
    pub padded: Padded,
    pub(super) outside: SliceStore,
    pub(super) inside: SliceStore,
    /// Squared radius of the ball for which all free cells were considered.
    pub(super) squared: u32,
}

impl Sides {
    /// The sides that a ball tells apart: the exterior is outside, enclosed free cells are inside. `squared` is the ball's squared radius.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn told_by(exterior: &Exterior, squared: u32, context: &Context) -> Result<Sides> {
        let padded = exterior.padded;
        let [outside, inside] = stores(padded, 1, context, |slices| {
            let (mut bits, mut scratch) = (padded.bits(), Scratch::default());
            let mut out: [Slices; 2] = Default::default();
            for y in slices {
                exterior.paint(y, &mut bits, &mut scratch)?;
                out[0].push(&bits);
                exterior.paint_enclosed(y, &mut bits, &mut scratch)?;
                out[1].push(&bits);
            }
            Ok(out)
        })?;
        Ok(Sides { padded, outside, inside, squared })
    }

    /// The sides that a field's sign tells, on a level of the pyramid: a free cell has the side of the cell of `signed` that its middle lies in. `factor`: how
    /// many cells of the grid one of `signed` is wide.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn signed(signed: &Signed, factor: u32, occupancy: &Occupancy, level: u32, context: &Context) -> Result<Sides> {
        // A cell that is free there is so for a ball of one of its cells at the least.
        let squared = (factor >> level).max(1).pow(2);
        let padded = Padded::new(occupancy.cells, Ball::squared(squared).radius());
        let pad = i64::from(padded.pad);
        let parent = |c: u32| (((2 * (i64::from(c) - pad) + 1) << level).div_euclid(2)).div_euclid(i64::from(factor));
        // Where the sides of the cells of a row lie in a row of `signed`; beyond it all is outside.
        let columns: Vec<usize> = (0..padded.cells[0]).map(|x| (parent(x) + PAD as i64) as usize).collect();
        let [outside, inside] = stores(padded, 1, context, |slices| {
            let (mut occupied, mut runs) = (padded.bits(), Runs::default());
            let mut bits = [padded.bits(), padded.bits()];
            let mut out: [Slices; 2] = Default::default();
            for y in slices {
                bits.iter_mut().for_each(Bits::clear);
                for z in 0..padded.cells[2] {
                    let Some(row) = signed.row(parent(y), parent(z)) else {
                        set_range(bits[0].row_mut(z), 0, padded.cells[0]);
                        continue;
                    };
                    for (i, columns) in columns.chunks(64).enumerate() {
                        let mut words = [0u64; 2];
                        for (bit, column) in columns.iter().enumerate() {
                            let side = row.get(*column).copied().unwrap_or(Side::Outside);
                            words[0] |= u64::from(side == Side::Outside) << bit;
                            words[1] |= u64::from(side == Side::Inside) << bit;
                        }
                        for (bits, word) in bits.iter_mut().zip(words).filter(|(_, word)| *word != 0) {
                            bits.row_mut(z)[i] = word;
                        }
                    }
                }
                padded.paint_occupied(occupancy, i64::from(y), &mut occupied, &mut runs)?;
                for (out, bits) in out.iter_mut().zip(&mut bits) {
                    bits.and_not(&occupied);
                    out.push(bits);
                }
            }
            Ok(out)
        })?;
        Ok(Sides { padded, outside, inside, squared })
    }

    /// Lets the ball fall to the squared radius `last`; `progress` is told the slices of each step. `sheets` are walls that have the outside on both sides, if any are known.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn fallen(
        mut self,
        occupancy: &Occupancy,
        last: u32,
        sheets: Option<Sheets<'_>>,
        context: &Context,
        progress: &mut dyn FnMut(u32),
    ) -> Result<Sides> {
        while self.squared > last {
            let squared = next(self.squared).max(last);
            self = self.step(occupancy, squared, sheets, context)?;
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
        let [outside, inside] = stores(padded, free.radius(), context, |slices| {
            let (mut dilation, mut runs) = (padded.dilation(free, slices.end), Runs::default());
            let mut bits = [padded.bits(), padded.bits()];
            let mut out: [Slices; 2] = Default::default();
            for y in slices {
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
                let taken =
                    dilation.slide_to(i64::from(y), |y, bits| padded.paint_occupied(finer, y, bits, &mut runs))?;
                for (bits, out) in bits.iter_mut().zip(&mut out) {
                    bits.and_not(taken);
                    out.push(bits);
                }
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
    fn step(self, occupancy: &Occupancy, squared: u32, sheets: Option<Sheets<'_>>, context: &Context) -> Result<Sides> {
        let padded = self.padded;
        // What is next to the sides lies in the balls of the step before.
        let balls = [self.squared, squared].map(Ball::squared);
        let radius = 2 * balls[0].radius() + balls[1].radius() + 2;
        let [outside, inside, open, next_outside, next_inside] =
            stores(padded, radius, context, |slices| self.next_to_one_side(occupancy, balls, slices))?;
        let grown = Sides { padded, outside, inside, squared };
        if open.is_empty() {
            return Ok(grown);
        }
        let (outside, next_to) = (&grown.outside, &[next_outside, next_inside]);
        let labels = Open { padded, occupancy, sheets, cells: &open, outside, next_to, squared }.judged(context)?;
        let [outside, inside] = stores(padded, 1, context, |slices| {
            let (mut bits, mut runs, mut scratch) = (padded.bits(), Runs::default(), Scratch::default());
            let mut out: [Slices; 2] = Default::default();
            for y in slices {
                for (out, (side, verdict)) in out.iter_mut().zip([(&grown.outside, OUTSIDE), (&grown.inside, INSIDE)]) {
                    side.paint(i64::from(y), &mut bits, &mut runs)?;
                    labels.paint(y, verdict, &mut bits, &mut scratch)?;
                    out.push(&bits);
                }
            }
            Ok(out)
        })?;
        Ok(Sides { padded, outside, inside, squared })
    }

    /// For some slices: the sides, with the newly free cells that lie next to one of them only; the other newly free cells; and the cells
    /// next to either side, in the ball round one of its cells, and not occupied. `balls`: that of the step before, and this step's.
    fn next_to_one_side(
        &self,
        occupancy: &Occupancy,
        balls: [Ball; 2],
        slices: std::ops::Range<u32>,
    ) -> Result<[Slices; 5]> {
        let padded = self.padded;
        let mut next_to = [(); 2].map(|()| padded.dilation(balls[0], slices.end));
        let mut dilation = padded.dilation(balls[1], slices.end);
        let (mut occupied, mut rest, mut runs) = (padded.bits(), padded.bits(), Runs::default());
        let mut sides = [padded.bits(), padded.bits()];
        let mut out: [Slices; 5] = Default::default();
        let last = behind(padded.cells[0]);
        for y in slices.map(i64::from) {
            let taken = dilation.slide_to(y, |y, bits| padded.paint_occupied(occupancy, y, bits, &mut runs))?;
            padded.paint_occupied(occupancy, y, &mut occupied, &mut runs)?;
            let [next_outside, next_inside] = &mut next_to;
            let next_outside = next_outside.slide_to(y, |y, bits| self.outside.paint(y, bits, &mut runs))?;
            let next_inside = next_inside.slide_to(y, |y, bits| self.inside.paint(y, bits, &mut runs))?;
            for (bits, store) in sides.iter_mut().zip([&self.outside, &self.inside]) {
                store.paint(y, bits, &mut runs)?;
            }
            rest.clear();
            let [outside, inside] = &mut sides;
            for z in 0..padded.cells[2] {
                let (taken, near_outside, near_inside) = (taken.row(z), next_outside.row(z), next_inside.row(z));
                for i in 0..taken.len() {
                    let cells = if i + 1 == taken.len() { last } else { u64::MAX };
                    let new = !taken[i] & !outside.row(z)[i] & !inside.row(z)[i] & cells;
                    if new != 0 {
                        let (o, n) = (near_outside[i], near_inside[i]);
                        outside.row_mut(z)[i] |= new & o & !n;
                        inside.row_mut(z)[i] |= new & n & !o;
                        let left = new & !(o ^ n);
                        if left != 0 {
                            rest.row_mut(z)[i] = left;
                        }
                    }
                }
            }
            next_outside.and_not(&occupied);
            next_inside.and_not(&occupied);
            for (out, bits) in out.iter_mut().zip([outside, inside, &mut rest, next_outside, next_inside]) {
                out.push(bits);
            }
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

/// Fills stores, slice by slice of the padded box, from chunks of slices; `radius` is the reach of their windows, for the plan.
pub(super) fn stores<const N: usize>(
    padded: Padded,
    radius: u32,
    context: &Context,
    work: impl Fn(std::ops::Range<u32>) -> Result<[Slices; N]> + Sync,
) -> Result<[SliceStore; N]> {
    let mut stores = [(); N].map(|()| SliceStore::new(&context.workspace, context.memory.store_quota));
    let mut jobs = chunks(padded.cells[1]);
    context.workers.in_order(
        context.jobs(radius, padded.cells),
        || Ok(jobs.next()),
        work,
        |slices: [Slices; N]| stores.iter_mut().zip(&slices).try_for_each(|(store, slices)| store.extend(slices)),
    )?;
    Ok(stores)
}
