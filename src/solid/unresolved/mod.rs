//! Unresolved: groups of a few cells that alter the topology of the solid, and that no sampling can vouch for.
//!
//! Where samples are noisy or sparse, single occupied cells stand off the body, and single gaps go through its wall:
//!
//! ```text
//!      . # # .       an arch: two cells more make     # # . # #      a pin hole: one cell more
//!      . # . # .     a handle                         # # . # #      takes a handle away
//!    # # # # # # #                                    # # . # #
//!    i i i i i i i
//! ```
//!
//! Such groups are found by a cube of 3 x 3 x 3 cells. *Spikes* are the solid cells that no such cube round an unoccupied solid cell covers; *pits* the
//! cells that are not solid and that no such cube of cells that are not solid covers; *tubes* ([`tubes`]) those that not even a plate of 3 x 3 x 1 of them
//! covers. A group, joined by faces, is judged by what it does to the Euler
//! characteristic χ = components − handles + cavities of the solid: a few spikes that lower it are taken away, a few pits or tubes whose filling raises it are
//! filled. Groups that leave χ as it is are detail, and stay. So is what a group of spikes has but for its handle, as the tip of an ear with a hole in it: it grows on again from what is left,
//! cell by cell, where that changes no topology ([`crate::solid::growth`]).
//!
//! χ is a sum over the 2 x 2 x 2 cells round each corner of the grid (`characteristic`), so that what a group changes is summed up along its runs. Where a corner
//! touches two groups, the first one in the order of cells is given its change.
//!
//! What is left of handles that are no wider than a tube or a strut ([`Solid::narrow_handles`]) is told: nobody can say whether they are the body's.
//! Where they are nets of rungs across a slot ([`nets`]), the slot is filled whole.
//!
//! Source: T. Y. Kong and A. Rosenfeld, *Digital topology: introduction and survey* (1989), for χ of cells joined by faces.

mod nets;
mod tubes;

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::grid::context::{Context, chunks};
use crate::grid::dilate::{Ball, Dilation};
use crate::grid::label::{Components, Labeller, Labels, Measure, Parts};
use crate::grid::occupancy::Occupancy;
use crate::grid::slice::{Bits, Run, Runs, clip};
use crate::grid::window::Window;
use crate::solid::change::Change;
use crate::solid::dents::Lining;
use crate::solid::exterior::{Padded, invert};
use crate::solid::unresolved::tubes::Tubes;
use crate::solid::{Solid, move_back};

/// Groups of as many cells are seen well enough to be believed.
const BELIEVED: u64 = 64;

/// Pits of no more cells are filled even if samples line them: they lie under an arch of samples.
const PIT: u64 = 8;

/// The squared radius of a ball that is a cube of 3 x 3 x 3 cells.
const CUBE: u32 = 3;

/// The verdicts on groups.
const STAYS: u8 = 0;
const CHANGES: u8 = 1;

/// What the cells of a group are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Solid cells that no cube of solid cells covers.
    Spikes,
    /// Cells that are not solid and that no empty cube covers.
    Pits,
    /// Cells that are not solid and that no empty plate covers.
    Tubes,
    /// Solid cells that no plate of solid cells covers.
    Struts,
}

impl Kind {
    /// Those that are not believed, in the order in which they are looked for.
    const UNBELIEVED: [Kind; 3] = [Kind::Spikes, Kind::Pits, Kind::Tubes];
    /// Those that narrow handles are made of: a strut goes round the hole, a tube through it.
    const NARROW: [Kind; 2] = [Kind::Tubes, Kind::Struts];

    /// What is done to a group that is not believed, or is asked about.
    fn change(self) -> Change {
        match self {
            Kind::Spikes | Kind::Struts => Change::Removed,
            Kind::Pits | Kind::Tubes => Change::Filled,
        }
    }
}

/// Eight times what the corner between 2 x 2 x 2 cells adds to χ of solid cells joined by faces: cells − pairs that share a face + squares of four −
/// cubes of eight. Bit x + 2 z + 4 y of the pattern is the cell's. A cell is shared by 8 corners, a pair by 4, a square by 2.
const fn characteristic(pattern: u8) -> i32 {
    let mut sum = pattern.count_ones() as i32;
    let mut axis = 0;
    while axis < 3 {
        let step = 1 << axis;
        let mut cell = 0;
        while cell < 8 {
            if cell & step == 0 && pattern >> cell & 1 == 1 && pattern >> (cell + step) & 1 == 1 {
                sum -= 2;
            }
            cell += 1;
        }
        // The squares across this axis: the four cells of either side.
        let side: u8 = match axis {
            0 => 0b0101_0101,
            1 => 0b0011_0011,
            _ => 0b0000_1111,
        };
        if pattern & side == side {
            sum += 4;
        }
        if pattern & !side == !side {
            sum += 4;
        }
        axis += 1;
    }
    if pattern == u8::MAX { sum - 8 } else { sum }
}

/// [`characteristic`] of every pattern.
const CHARACTERISTIC: [i32; 256] = {
    let mut table = [0; 256];
    let mut pattern = 0;
    while pattern < 256 {
        table[pattern] = characteristic(pattern as u8);
        pattern += 1;
    }
    table
};

/// The same of the surface round the cells: two cells that are not solid and share a corner only are kept apart there, which is a handle less.
const OF_SURFACE: [i32; 256] = {
    let mut table = CHARACTERISTIC;
    let mut cell = 0;
    while cell < 4 {
        table[!(1u8 << cell | 1 << (7 - cell)) as usize] += 8;
        cell += 1;
    }
    table
};

/// What a group of cells is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Zeroable, Pod)]
#[repr(C)]
struct Group {
    cells: u64,
    /// Eight times χ with the group less χ without it.
    change: i64,
    /// A pit's faces to occupied cells, and to other solid cells.
    lining: Lining,
}

impl Measure for Group {
    fn add(&mut self, other: &Group) {
        self.cells += other.cells;
        self.change += other.change;
        self.lining.add(&other.lining);
    }
}

impl Group {
    fn verdict(&self, kind: Kind) -> u8 {
        let better = match kind {
            Kind::Spikes => self.change < 0,
            Kind::Pits => self.change > 0 && (self.cells <= PIT || !self.lining.is_sampled()),
            Kind::Tubes => self.change > 0 && !self.lining.is_sampled(),
            Kind::Struts => false,
        };
        if better && self.cells < BELIEVED { CHANGES } else { STAYS }
    }
}

/// What is known of a group that may be a narrow handle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Zeroable, Pod)]
#[repr(C)]
struct Narrow {
    /// Eight times χ of the surface with the group less χ without it.
    change: i64,
    /// The cells from the one that it begins with to the end of the numbers, and to the one that it ends before: the more, the larger is its box.
    from: [u32; 3],
    to: [u32; 3],
}

impl Measure for Narrow {
    fn add(&mut self, other: &Narrow) {
        self.change += other.change;
        for a in 0..3 {
            self.from[a] = self.from[a].max(other.from[a]);
            self.to[a] = self.to[a].max(other.to[a]);
        }
    }
}

impl Narrow {
    fn of(kind: Kind, around: &[Window<Bits>; 2], cells: &Window<Bits>, y: i64, z: u32, run: Run) -> Narrow {
        let [low, high] = [[run.start, y as u32, z], [run.end - 1, y as u32, z]];
        let change = at_corners(around, cells, (y, z, run), |groups, without, cell| {
            // Each part on its own: what else is in groups stays as it is.
            let part = part_of(groups, cell);
            let others = if kind.change() == Change::Removed { groups & !part } else { 0 };
            let value = |pattern: u8| OF_SURFACE[usize::from(pattern | without | others)];
            if part.trailing_zeros() == cell { value(part) - value(0) } else { 0 }
        });
        Narrow { change, from: low.map(|c| u32::MAX - c), to: high.map(|c| c + 1) }
    }

    /// By how much χ grows if the group is taken away, or filled: the handles that it makes.
    fn handles(&self, kind: Kind) -> u64 {
        let grows = if kind.change() == Change::Removed { -self.change } else { self.change };
        (grows.max(0) as u64).div_ceil(8)
    }

    /// The first cell of its box, and the one behind its last.
    fn cells(&self) -> [[u32; 3]; 2] {
        [self.from.map(|c| u32::MAX - c), self.to]
    }
}

/// Handles that are no wider than a tube or a strut.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct NarrowHandles {
    /// How many there are.
    pub count: u64,
    /// The box of the widest: its first cell along x, slices and rows, and the cell behind its last.
    pub widest: Option<[[u32; 3]; 2]>,
    /// Whether slots round them were filled and opened anew, so that the surface has fewer pieces and handles now.
    #[serde(default)]
    pub reopened: bool,
}

impl Solid {
    /// The handles that go, one by one, when a tube is filled or a strut is taken away: as many as there are by the kind that makes more of them, since a hole that is
    /// narrow may have a narrow rim as well. But no more than the surface has in all: what hangs on by nothing but a strut makes none.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn narrow_handles(&self, occupancy: &Occupancy, context: &Context) -> Result<NarrowHandles> {
        let mut found = NarrowHandles::default();
        let mut most = 0;
        for kind in Kind::NARROW {
            let mut count = 0;
            self.narrow_groups(occupancy, kind, context)?.for_each(|group: &Narrow| {
                let handles = group.handles(kind);
                count += handles;
                if handles > most {
                    most = handles;
                    found.widest = Some(group.cells());
                }
            })?;
            found.count = found.count.max(count);
        }
        if found.count > 0 {
            found.count = found.count.min(self.handles(context)?);
            found.widest = found.widest.filter(|_| found.count > 0);
        }
        Ok(found)
    }

    /// No fewer handles than the surface has: cavities that reach the outside over an edge alone count as pieces of it.
    fn handles(&self, context: &Context) -> Result<u64> {
        Ok((self.pieces(1, context)? as i64 - self.characteristic_of_surface()?).max(0) as u64)
    }

    /// The groups of a kind that narrow handles are made of.
    fn narrow_groups(&self, occupancy: &Occupancy, kind: Kind, context: &Context) -> Result<Components<Narrow>> {
        let of = |around: &_, cells: &_, y, z, run| Narrow::of(kind, around, cells, y, z, run);
        self.labelled(occupancy, kind, context, of)?.finish()
    }

    /// The groups of a kind, with what `of` tells of each of their runs.
    fn labelled<M: Measure>(
        &self,
        occupancy: &Occupancy,
        kind: Kind,
        context: &Context,
        of: impl Fn(&[Window<Bits>; 2], &Window<Bits>, i64, u32, Run) -> M + Sync,
    ) -> Result<Labeller<M>> {
        let mut labeller = Labeller::new(context);
        let mut jobs = chunks(self.cells[1]);
        context.workers.in_order(
            context.jobs(6, self.cells),
            || Ok(jobs.next()),
            |slices| Seen::new(self, occupancy, kind, slices.end).groups(slices, &of),
            |parts| labeller.add(parts),
        )?;
        Ok(labeller)
    }

    /// The same solid without small groups of cells that make handles, and with small gaps filled that do.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn without_unresolved(self, occupancy: &Occupancy, context: &Context) -> Result<Solid> {
        let mut solid = self;
        for kind in Kind::UNBELIEVED {
            let components = solid.labelled(occupancy, kind, context, Group::of)?.finish()?;
            let mut any = false;
            components.for_each(|_| any = true)?;
            if !any {
                continue;
            }
            let mut changes = false;
            let labels = components.judged(context, |group| {
                let verdict = group.verdict(kind);
                changes |= verdict == CHANGES;
                verdict
            })?;
            if changes {
                let changed = solid.changed(&labels, CHANGES, kind.change(), context)?;
                solid = match kind.change() {
                    Change::Filled => changed,
                    Change::Removed => changed.grown_into(&labels, context)?,
                };
            }
        }
        Ok(solid)
    }
}

impl Solid {
    /// With those cells of the groups that change, in which the solid grows without a change of topology.
    fn grown_into(self, labels: &Labels, context: &Context) -> Result<Solid> {
        let target = labels.cells(CHANGES, self.cells, context)?;
        let grown = self.growth(context.no_cells(), &target, Change::Filled, context)?;
        if grown.is_empty() { Ok(self) } else { self.with(&grown, context) }
    }
}

/// Finds the groups of some slices.
struct Seen<'a> {
    solid: &'a Solid,
    occupancy: &'a Occupancy,
    kind: Kind,
    padded: Padded,
    /// What the first cube covers, and for pits the second.
    dilations: [Dilation; 2],
    tubes: Tubes<'a>,
    runs: Runs,
    scratch: Bits,
}

impl<'a> Seen<'a> {
    fn new(solid: &'a Solid, occupancy: &'a Occupancy, kind: Kind, end: u32) -> Seen<'a> {
        let padded = Padded::new(solid.cells, Ball::squared(CUBE).radius());
        let dilation = |more: u32| padded.dilation(Ball::squared(CUBE), end + padded.pad + more);
        // A slice more than asked for: corners are shared with it.
        let dilations = [dilation(3), dilation(2)];
        let scratch = Bits::new(solid.cells[0], solid.cells[2]);
        let tubes = Tubes::new(solid, kind == Kind::Struts);
        Seen { solid, occupancy, kind, padded, dilations, tubes, runs: Runs::default(), scratch }
    }

    /// Sets the cells of slice `y` that groups are made of.
    fn paint(&mut self, y: i64, bits: &mut Bits) -> Result<()> {
        bits.clear();
        let [width, slices, rows] = self.solid.cells;
        if !(0..i64::from(slices)).contains(&y) {
            return Ok(());
        }
        let Seen { solid, occupancy, kind, padded, dilations, tubes, runs, scratch } = self;
        let pad = i64::from(padded.pad);
        let [first, second] = dilations;
        let covered = match kind {
            Kind::Tubes | Kind::Struts => return tubes.paint(y, bits),
            Kind::Spikes => first.slide_to(y + pad, |y, room| {
                solid.store.paint_moved(y - pad, padded.pad, room, runs)?;
                let mut occupied = padded.bits();
                padded.paint_occupied(occupancy, y, &mut occupied, runs)?;
                room.and_not(&occupied);
                Ok(())
            })?,
            Kind::Pits => second.slide_to(y + pad, |y, room| {
                let paint = |y, bits: &mut Bits| solid.store.paint_moved(y - pad, padded.pad, bits, runs);
                let near = first.slide_to(y, paint)?;
                for z in 0..padded.cells[2] {
                    let row = room.row_mut(z);
                    row.copy_from_slice(near.row(z));
                    invert(row, padded.cells[0]);
                }
                Ok(())
            })?,
        };
        solid.store.paint(y, scratch, runs)?;
        for z in 0..rows {
            let solid = scratch.row(z);
            if *kind == Kind::Spikes && scratch.lit_row(z).is_none() {
                continue;
            }
            let row = bits.row_mut(z);
            move_back(covered.row(z + padded.pad), padded.pad, row);
            match kind.change() {
                Change::Removed => row.iter_mut().zip(solid).for_each(|(covered, solid)| *covered = solid & !*covered),
                Change::Filled => row.iter_mut().zip(solid).for_each(|(covered, solid)| *covered = !(*covered | solid)),
            }
            clip(row, width);
        }
        Ok(())
    }

    /// The groups of some slices, as far as they hang together there, with what `of` tells of their runs.
    fn groups<M: Measure>(
        mut self,
        slices: std::ops::Range<u32>,
        of: impl Fn(&[Window<Bits>; 2], &Window<Bits>, i64, u32, Run) -> M,
    ) -> Result<Parts<M>> {
        let [width, _, rows] = self.solid.cells;
        let mut cells = Window::new(3, || Bits::new(width, rows));
        let mut around = [(); 2].map(|()| Window::new(3, || Bits::new(width, rows)));
        let (mut runs, mut held, mut groups) = (Runs::default(), Vec::with_capacity(slices.len()), Vec::new());
        for y in slices.map(i64::from) {
            cells.slide_to(y - 1, |y, bits| self.paint(y, bits))?;
            let found = Runs::from_bits(cells.get(y));
            if !found.all().is_empty() {
                for (window, store) in around.iter_mut().zip([&self.solid.store, &self.occupancy.store]) {
                    window.slide_to(y - 1, |y, bits| store.paint(y, bits, &mut runs))?;
                }
            }
            for z in 0..rows {
                groups.extend(found.row(z).iter().map(|run| of(&around, &cells, y, z, *run)));
            }
            held.push(found);
        }
        let mut groups = groups.into_iter();
        Ok(Parts::of(held, |_, _, _| groups.next().expect("every run has its group")))
    }
}

impl Group {
    /// What a run of row `z` of slice `y` adds: its cells, what they change, and what lines them.
    fn of(around: &[Window<Bits>; 2], cells: &Window<Bits>, y: i64, z: u32, run: Run) -> Group {
        let change = at_corners(around, cells, (y, z, run), |group, without, cell| {
            // Where a corner touches several cells of groups, the first one is given the change.
            let is_first = group.trailing_zeros() == cell;
            let value = |pattern: u8| CHARACTERISTIC[usize::from(pattern)];
            if is_first { value(group | without) - value(without) } else { 0 }
        });
        Group { cells: u64::from(run.end - run.start), change, lining: Lining::of(around, y, z, run) }
    }
}

/// The sum over the corners of the cells of a run of row `z` of slice `y`. `of` is told the patterns of the groups' cells round a corner and of the solid ones that
/// are in none, and the bit of the run's cell.
fn at_corners(
    [solid, _]: &[Window<Bits>; 2],
    cells: &Window<Bits>,
    (y, z, run): (i64, u32, Run),
    of: impl Fn(u8, u8, u32) -> i32,
) -> i64 {
    let mut sum = 0;
    let slices = [y - 1, y, y + 1].map(|y| [cells.get(y), solid.get(y)]);
    for x in i64::from(run.start)..i64::from(run.end) {
        // Of each row of the 27 cells round it, slice by slice: three of the groups, and three of the solid without them.
        let mut threes = [[[0u8; 2]; 3]; 3];
        for (threes, [cells, solid]) in threes.iter_mut().zip(slices) {
            for (threes, z) in threes.iter_mut().zip(i64::from(z) - 1..) {
                let group = cells.three(x, z);
                *threes = [group, solid.three(x, z) & !group];
            }
        }
        for corner in 0..8usize {
            // The corner's lowest cell lies at x + dx - 1, y + dy - 1, z + dz - 1.
            let [dx, dz, dy] = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
            let pattern = |of: usize| {
                let two = |dy: usize, dz: usize| threes[dy][dz][of] >> dx & 3;
                two(dy, dz) | two(dy, dz + 1) << 2 | two(dy + 1, dz) << 4 | two(dy + 1, dz + 1) << 6
            };
            sum += i64::from(of(pattern(0), pattern(1), 7 - corner as u32));
        }
    }
    sum
}

/// The cells of a pattern that faces join to the one of bit `cell`, within the pattern.
fn part_of(pattern: u8, cell: u32) -> u8 {
    let mut part: u8 = 1 << cell;
    // Through the cells of a pattern, none is farther than five steps.
    for _ in 0..5 {
        let along = [(part & 0x55) << 1 | part >> 1 & 0x55, (part & 0x33) << 2 | part >> 2 & 0x33, part.rotate_left(4)];
        part |= (along[0] | along[1] | along[2]) & pattern;
    }
    part
}

#[cfg(test)]
mod properties;

#[cfg(test)]
mod tests {
    use super::*;

    /// χ of solid cells joined by faces, counted one by one.
    fn counted(cells: &[[i32; 3]]) -> i32 {
        let has = |cell: [i32; 3]| cells.contains(&cell);
        let mut sum = 0;
        for &[x, y, z] in cells {
            for square in 0..8 {
                let [a, b, c] = [square & 1, square >> 1 & 1, square >> 2 & 1];
                let all = (0..=a).all(|i| (0..=b).all(|j| (0..=c).all(|k| has([x + i, y + j, z + k]))));
                sum += if all { if (a + b + c) % 2 == 0 { 1 } else { -1 } } else { 0 };
            }
        }
        sum
    }

    /// The same by corners.
    fn by_corners(cells: &[[i32; 3]]) -> i32 {
        let mut sum = 0;
        for x in -2..6 {
            for y in -2..6 {
                for z in -2..6 {
                    let pattern = (0..8).fold(0u8, |pattern, i| {
                        let cell = [x + (i & 1), y + (i >> 2 & 1), z + (i >> 1 & 1)];
                        pattern | u8::from(cells.contains(&cell)) << i
                    });
                    sum += CHARACTERISTIC[usize::from(pattern)];
                }
            }
        }
        assert_eq!(sum % 8, 0);
        sum / 8
    }

    #[test]
    fn every_pattern_of_eight_cells_has_the_characteristic_that_is_counted() {
        for pattern in 0..256 {
            let cells: Vec<[i32; 3]> =
                (0..8).filter(|i| pattern >> i & 1 == 1).map(|i| [i & 1, i >> 2 & 1, i >> 1 & 1]).collect();
            assert_eq!(by_corners(&cells), counted(&cells), "{pattern}");
        }
    }

    #[test]
    fn a_ball_a_ring_and_a_hollow_have_one_none_and_two() {
        let cube = |keep: fn([i32; 3]) -> bool| -> Vec<[i32; 3]> {
            (0..27).map(|i| [i % 3, i / 3 % 3, i / 9]).filter(|c| keep(*c)).collect()
        };
        assert_eq!(by_corners(&cube(|_| true)), 1);
        assert_eq!(by_corners(&cube(|[x, y, _]| [x, y] != [1, 1])), 0);
        assert_eq!(by_corners(&cube(|c| c != [1, 1, 1])), 2);
    }
}
