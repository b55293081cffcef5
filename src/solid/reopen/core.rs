//! The core and rungs: what opens at once, in groups, where that makes no pieces, and no tunnels but wide ones.
//!
//! ```text
//!   S S S S S S      S solid, c core
//!     # c c S        Groups of the core are judged one by one, by how each changes the Euler number of the solid: its pieces, less its tunnels, and its cavities.
//!   v v c c S        v: a cavity. The first group that reaches it lowers the number by 1, and makes no tunnel; one that reaches it, too, makes one.
//!     S c c S
//! ```
//!
//! What is wide comes first: cubes of 3 x 3 x 3 cells may make tunnels, as no hole between samples is as wide. So a bore that was filled opens from end to end.
//!
//! *Rungs* are what is left of the target when cells have opened one by one, and goes across a slot: groups by which the number rises, so that handles vanish.
//!
//! ```text
//!   S         S
//!   S         S        # occupied cells that noise or a wall askew to the grid brought together, though their planes leave the middle of the slot outside:
//!   S # # # # S        the slot goes round them, so the solid has a handle there
//!   S         S
//! ```

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use super::Slabs;
use super::found::Found;
use super::layers::Stretch;
use super::open::{self, Change, Width};
use super::tile::Tile;
use crate::error::Result;
use crate::grid::label::{Components, Labeller, Labels, Measure, Parts, overlaps};
use crate::grid::slice::{Run, Runs, SliceStore};
use crate::solid::Solid;
use crate::solid::change::together;

/// Parts of the solid that are cut off and have fewer cells are opened, too, and so are those without samples.
pub(super) const BITS: u64 = 30;

impl Slabs<'_> {
    /// The core: what is opened at once, with what it cuts off. What is wide opens first, and may make tunnels.
    pub(super) fn core(
        &self,
        solid: &Solid,
        occupied: &SliceStore,
        target: &SliceStore,
        sure: &SliceStore,
    ) -> Result<SliceStore> {
        let wide = self.with_bits(solid, occupied, self.groups(solid, target, sure, Width::Cube)?)?;
        let wide = self.without_cuts(solid, wide)?;
        let without_wide = if wide.is_empty() { None } else { Some(solid.without(&wide, self.context)?) };
        let left = without_wide.as_ref().unwrap_or(solid);
        let opened = self.with_bits(left, occupied, self.groups(left, target, sure, Width::Plate)?)?;
        let opened = self.settled(left, opened, |opened| self.tunnels(left, opened))?;
        if without_wide.is_none() { Ok(opened) } else { together(&wide, &opened, self.cells, self.context) }
    }

    /// What is opened, without the groups that touch a piece which they cut off from a larger one.
    pub(super) fn without_cuts(&self, solid: &Solid, mut opened: SliceStore) -> Result<SliceStore> {
        while let Some(pieces) = self.cut_off(solid, &opened)? {
            let cuts = self.beside(solid, &opened, &pieces)?;
            if cuts.is_empty() {
                // All of them have as many cells.
                break;
            }
            opened = self.less(&opened, &cuts)?;
        }
        Ok(opened)
    }

    /// The groups of the sure cells of the target that are as wide, reach the outside and lie deep in the solid.
    fn groups(&self, solid: &Solid, target: &SliceStore, sure: &SliceStore, width: Width) -> Result<SliceStore> {
        let reach = width.reach();
        let parts = self.parts(
            |chunk, found| {
                let stretch = |store| Slabs::stretch(store, chunk, reach);
                let slices = i64::from(chunk.start) - reach..i64::from(chunk.end) + reach;
                let certain = both(&stretch(target)?, &stretch(sure)?, slices);
                let solid = stretch(&solid.store)?;
                for tile in self.tiles(chunk, reach)? {
                    open::core(&tile, &solid, &certain, width, |cell, known| found.push(cell, known));
                }
                Ok(())
            },
            |cell| Known { deep: cell.deep.into(), joined: cell.joined.into() },
        )?;
        let labels = parts.judged(self.context, |known| known.deep & known.joined)?;
        self.judged(&labels, None)
    }

    /// The rungs: of the target that the solid still holds, groups at the outside by which the Euler number rises, where they cut off no piece.
    pub(super) fn rungs(&self, solid: &Solid, target: SliceStore) -> Result<SliceStore> {
        self.settled(solid, target, |rungs| {
            let mut any = false;
            let labels = self.changes(solid, rungs, None)?.judged(self.context, |change| {
                let stays = change.euler <= 0 || change.joined == 0;
                any |= stays;
                u8::from(stays)
            })?;
            Ok(if any { Some(self.judged(&labels, None)?) } else { None })
        })
    }

    /// Of what is opened, what is left when groups that `stay` and groups that cut off pieces are put back. A group that is put back alters what others change: they are judged until
    /// all that are left may open.
    fn settled(
        &self,
        solid: &Solid,
        mut opened: SliceStore,
        stay: impl Fn(&SliceStore) -> Result<Option<SliceStore>>,
    ) -> Result<SliceStore> {
        while !opened.is_empty() {
            let stay = stay(&opened)?;
            if let Some(stay) = &stay {
                opened = self.less(&opened, stay)?;
            }
            let cuts = self.cuts(solid, &opened)?;
            if let Some(cuts) = &cuts {
                opened = self.less(&opened, cuts)?;
            }
            if stay.is_none() && cuts.is_none() {
                break;
            }
        }
        Ok(opened)
    }

    /// Of what is opened, the groups that make a tunnel.
    fn tunnels(&self, solid: &Solid, opened: &SliceStore) -> Result<Option<SliceStore>> {
        let mut any = false;
        let labels = self.changes(solid, opened, None)?.judged(self.context, |change| {
            any |= change.euler < 0;
            u8::from(change.euler < 0)
        })?;
        if !any {
            return Ok(None);
        }
        // Perhaps one of them joins a cavity to the outside, and is the only one that does.
        let lowering = self.judged(&labels, None)?;
        any = false;
        let labels = self.round_cavities(solid, opened, &lowering)?.judged(self.context, |change| {
            let tunnels = change.euler < -change.cavities.max(change.touches.into());
            any |= tunnels;
            u8::from(tunnels)
        })?;
        Ok(if any { Some(self.judged(&labels, None)?) } else { None })
    }

    /// Of what is opened, groups by which the Euler number rises, where they cut off pieces.
    fn cuts(&self, solid: &Solid, opened: &SliceStore) -> Result<Option<SliceStore>> {
        let Some(pieces) = self.cut_off(solid, opened)? else { return Ok(None) };
        let mut any = false;
        let labels = self.changes(solid, opened, Some(&pieces))?.judged(self.context, |change| {
            // Where it does not, tunnels vanish.
            let cuts = change.euler > 0 && change.touches == 1;
            any |= cuts;
            u8::from(cuts)
        })?;
        Ok(if any { Some(self.judged(&labels, None)?) } else { None })
    }

    /// Of what is opened, the groups that share a face with a cell of `marked`.
    fn beside(&self, solid: &Solid, opened: &SliceStore, marked: &SliceStore) -> Result<SliceStore> {
        let labels = self.changes(solid, opened, Some(marked))?.judged(self.context, |change| change.touches)?;
        self.judged(&labels, None)
    }

    /// The groups of what is opened, by faces, with what each changes, and whether it shares a face with a cell of `marked`.
    fn changes(&self, solid: &Solid, opened: &SliceStore, marked: Option<&SliceStore>) -> Result<Components<Changes>> {
        self.parts(
            |chunk, found| {
                let marked = marked.map(|marked| Slabs::stretch(marked, chunk, 1)).transpose()?;
                self.each_change(chunk, solid, opened, marked.as_ref(), |cell, change| found.push(cell, change))
            },
            Changes::from,
        )
    }

    /// Calls `found` with the cells of a chunk that are opened and what each changes, tile by tile.
    fn each_change(
        &self,
        chunk: &Range<u32>,
        solid: &Solid,
        opened: &SliceStore,
        marked: Option<&Stretch>,
        mut found: impl FnMut([i64; 3], Change),
    ) -> Result<()> {
        let opened = Slabs::stretch(opened, chunk, 1)?;
        let tiles = Tile::with(&opened, chunk, self.cells, 1);
        if !tiles.is_empty() {
            let solid = Slabs::stretch(&solid.store, chunk, 1)?;
            tiles.iter().for_each(|tile| open::changes(tile, &solid, &opened, marked, &mut found));
        }
        Ok(())
    }

    /// Groups of what is opened and cavities of the solid, joined by faces: what each of these clusters changes, and whether there is a cavity in it.
    fn round_cavities(&self, solid: &Solid, opened: &SliceStore, groups: &SliceStore) -> Result<Components<Changes>> {
        let cavities = self.cavities(solid)?;
        let mut labeller = Labeller::new(self.context);
        self.each(
            |chunk| {
                let (groups, cavities) = (Slabs::stretch(groups, &chunk, 0)?, Slabs::stretch(&cavities, &chunk, 1)?);
                let mut found = Found::new(chunk.clone());
                self.each_change(&chunk, solid, opened, None, |cell, change| {
                    if groups.get(cell) {
                        found.push(cell, i32::from(change.euler));
                    }
                })?;
                let mut changes = found.sorted(self.cells).1.into_iter().flatten();
                let slice = |y: u32| {
                    let rows = 0..i64::from(self.cells[2]);
                    Runs::joined(rows.map(|z| [groups.row(y.into(), z), cavities.row(y.into(), z)].concat()).collect())
                };
                Ok(Parts::of(chunk.clone().map(slice).collect(), |y, z, run| {
                    let row = groups.row(i64::from(chunk.start) + y as i64, z.into());
                    let within = row.iter().filter(|part| run.start <= part.start && part.end <= run.end);
                    let cells: u32 = within.map(|part| part.end - part.start).sum();
                    let euler = changes.by_ref().take(cells as usize).sum();
                    let cavities = euler_of(&cavities, i64::from(chunk.start) + y as i64, z.into(), run);
                    Changes { euler, cavities, touches: u8::from(cells < run.end - run.start), ..Changes::default() }
                }))
            },
            |parts: Parts<Changes>| labeller.add(parts),
        )?;
        labeller.finish()
    }

    /// The parts, joined by faces, of the cells that `work` finds in chunks; `of` tells what a cell adds to its part.
    pub(super) fn parts<C: Copy + Send, M: Measure>(
        &self,
        work: impl Fn(&Range<u32>, &mut Found<C>) -> Result<()> + Sync,
        of: impl Fn(C) -> M + Sync,
    ) -> Result<Components<M>> {
        let mut labeller = Labeller::new(self.context);
        self.each(
            |chunk| {
                let mut found = Found::new(chunk.clone());
                work(&chunk, &mut found)?;
                let (runs, values) = found.sorted(self.cells);
                let mut values = values.into_iter().flatten();
                Ok(Parts::of(runs, |_, _, run| {
                    let mut sum = M::default();
                    for value in values.by_ref().take((run.end - run.start) as usize) {
                        sum.add(&of(value));
                    }
                    sum
                }))
            },
            |parts: Parts<M>| labeller.add(parts),
        )?;
        labeller.finish()
    }

    /// The parts of the outside, joined by faces, that the solid encloses.
    fn cavities(&self, solid: &Solid) -> Result<SliceStore> {
        let [width, slices, rows] = self.cells;
        let mut labeller = Labeller::new(self.context);
        self.each(
            |chunk| {
                let whole = || {
                    let mut whole = Runs::default();
                    (0..rows).for_each(|_| {
                        whole.push_run(0, width);
                        whole.end_row();
                    });
                    whole
                };
                let solid = Slabs::stretch(&solid.store, &chunk, 0)?;
                let outside = chunk.clone().map(|y| without(&whole(), solid.slice(y.into()))).collect();
                Ok(Parts::of(outside, |y, z, run| {
                    let y = chunk.start + y as u32;
                    let at_end =
                        run.start == 0 || run.end == width || z == 0 || z + 1 == rows || y == 0 || y + 1 == slices;
                    Reaches { end: at_end.into() }
                }))
            },
            |parts: Parts<Reaches>| labeller.add(parts),
        )?;
        let labels = labeller.finish()?.judged(self.context, |reaches| u8::from(reaches.end == 0))?;
        self.judged(&labels, None)
    }

    /// What is opened, with the pieces of the solid that are thereby cut off and small, or have no samples.
    fn with_bits(&self, solid: &Solid, occupied: &SliceStore, opened: SliceStore) -> Result<SliceStore> {
        if opened.is_empty() {
            return Ok(opened);
        }
        let is_bit = |piece: &Piece| piece.touched > 0 && (piece.cells < BITS || piece.sampled == 0);
        let mut any = false;
        let labels = self.pieces(solid, &opened, true, Some(occupied))?.judged(self.context, |piece| {
            any |= is_bit(piece);
            u8::from(is_bit(piece))
        })?;
        if any { self.judged(&labels, Some(&opened)) } else { Ok(opened) }
    }

    /// The pieces that opening cuts off from larger ones, if it makes more pieces of the solid.
    fn cut_off(&self, solid: &Solid, opened: &SliceStore) -> Result<Option<SliceStore>> {
        if opened.is_empty() {
            return Ok(None);
        }
        let pieces = self.pieces(solid, opened, true, None)?;
        let (mut after, mut before, mut largest) = (0u64, 0u64, 0);
        pieces.for_each(|piece| {
            if piece.touched > 0 {
                after += 1;
                largest = largest.max(piece.cells);
            }
        })?;
        if after < 2 {
            return Ok(None);
        }
        self.pieces(solid, opened, false, None)?.for_each(|piece| before += u64::from(piece.touched > 0))?;
        if after <= before {
            return Ok(None);
        }
        let labels = pieces.judged(self.context, |piece| u8::from(piece.touched > 0 && piece.cells < largest))?;
        Ok(Some(self.judged(&labels, None)?))
    }

    /// The pieces of the solid; if `without_opened`, of what is left of it, and of each whether it lies beside what is opened; else whether it holds some of that. And which
    /// have `occupied` cells, if these are given.
    fn pieces(
        &self,
        solid: &Solid,
        opened: &SliceStore,
        without_opened: bool,
        occupied: Option<&SliceStore>,
    ) -> Result<Components<Piece>> {
        let mut labeller = Labeller::new(self.context);
        self.each(
            |chunk| {
                let solid = Slabs::stretch(&solid.store, &chunk, 0)?;
                let opened = Slabs::stretch(opened, &chunk, 1)?;
                let occupied = occupied.map(|occupied| Slabs::stretch(occupied, &chunk, 0)).transpose()?;
                let slice = |y: u32| match without_opened {
                    true => without(solid.slice(y.into()), opened.slice(y.into())),
                    false => solid.slice(y.into()).clone(),
                };
                let slices: Vec<Runs> = chunk.clone().map(slice).collect();
                Ok(Parts::of(slices, |y, z, run| {
                    let (y, z) = (i64::from(chunk.start) + y as i64, i64::from(z));
                    let (start, end) = (i64::from(run.start), i64::from(run.end));
                    let touched = opened.any(start - i64::from(without_opened)..end + i64::from(without_opened), y, z)
                        || without_opened
                            && (opened.any(start..end, y, z - 1)
                                || opened.any(start..end, y, z + 1)
                                || opened.any(start..end, y - 1, z)
                                || opened.any(start..end, y + 1, z));
                    let sampled = occupied.as_ref().is_some_and(|occupied| occupied.any(start..end, y, z));
                    Piece { cells: (end - start) as u64, touched: touched.into(), sampled: sampled.into() }
                }))
            },
            |parts: Parts<Piece>| labeller.add(parts),
        )?;
        labeller.finish()
    }

    /// The cells with verdict 1, and those of `more`.
    pub(super) fn judged(&self, labels: &Labels, more: Option<&SliceStore>) -> Result<SliceStore> {
        let cells = labels.cells(1, self.cells, self.context)?;
        match more {
            Some(more) => together(&cells, more, self.cells, self.context),
            None => Ok(cells),
        }
    }

    /// The cells of `opened` that are not in `gone`.
    pub(super) fn less(&self, opened: &SliceStore, gone: &SliceStore) -> Result<SliceStore> {
        self.context.slices_of(self.cells[1], self.jobs, |chunk, slices| {
            let [opened, gone] = [opened, gone].map(|store| Slabs::stretch(store, &chunk, 0));
            let (opened, gone) = (opened?, gone?);
            chunk.for_each(|y| slices.push_runs(&without(opened.slice(y.into()), gone.slice(y.into()))));
            Ok(())
        })
    }
}

/// The cells of a slice that are not in `gone`.
fn without(slice: &Runs, gone: &Runs) -> Runs {
    let mut out = Runs::default();
    for z in 0..slice.row_count() {
        let mut gone = gone.row(z).iter().peekable();
        for run in slice.row(z) {
            let mut start = run.start;
            while gone.next_if(|gone| gone.end <= start).is_some() {}
            while let Some(hole) = gone.peek().filter(|hole| hole.start < run.end) {
                if hole.start > start {
                    out.push_run(start, hole.start);
                }
                start = hole.end;
                if hole.end > run.end {
                    break;
                }
                gone.next();
            }
            if start < run.end {
                out.push_run(start, run.end);
            }
        }
        out.end_row();
    }
    out
}

/// What the cells of a run of row `z` of slice `y` add to the Euler number of some cells as faces join them: cells − pairs + squares − cubes, with the cells before them along each axis.
fn euler_of(cells: &Stretch, y: i64, z: i64, run: Run) -> i32 {
    let here: Vec<Run> =
        cells.row(y, z).iter().filter(|part| run.start <= part.start && part.end <= run.end).copied().collect();
    let with = |runs: &[Run], y: i64, z: i64| {
        let mut out = Vec::new();
        common(runs, cells.row(y, z), |run| out.push(run));
        out
    };
    let (beside, below) = (with(&here, y, z - 1), with(&here, y - 1, z));
    let squares = with(&with(&beside, y - 1, z), y - 1, z - 1);
    (here.len() + squares.len()) as i32 - (beside.len() + below.len()) as i32
}

/// Calls `found` with the runs of cells that are in both of two rows.
pub(super) fn common(a: &[Run], b: &[Run], mut found: impl FnMut(Run)) {
    overlaps(a, b, |i, j| found(Run { start: a[i].start.max(b[j].start), end: a[i].end.min(b[j].end) }));
}

/// The cells that are in both of two stretches.
fn both(a: &Stretch, b: &Stretch, slices: Range<i64>) -> Stretch {
    let first = slices.start;
    let slice = |y: i64| {
        let (a, b) = (a.slice(y), b.slice(y));
        let mut out = Runs::default();
        for z in 0..a.row_count().min(b.row_count()) {
            common(a.row(z), b.row(z), |run| out.push_run(run.start, run.end));
            out.end_row();
        }
        out
    };
    Stretch::of(first, slices.map(slice).collect())
}

/// What is known of a part of the core.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(C)]
struct Known {
    /// Whether some of it lies deep.
    deep: u8,
    /// Whether it reaches the outside.
    joined: u8,
}

impl Measure for Known {
    fn add(&mut self, other: &Known) {
        self.deep |= other.deep;
        self.joined |= other.joined;
    }
}

/// What a part changes that is opened at once.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(C)]
struct Changes {
    /// How the Euler number of the solid changes.
    euler: i32,
    /// The Euler number of the cavities in it.
    cavities: i32,
    /// Whether it touches a marked cell.
    touches: u8,
    /// Whether it reaches the outside.
    joined: u8,
    /// Nothing.
    filler: [u8; 2],
}

impl From<Change> for Changes {
    fn from(Change { euler, touches, joined }: Change) -> Changes {
        Changes { euler: euler.into(), touches: touches.into(), joined: joined.into(), ..Changes::default() }
    }
}

impl Measure for Changes {
    fn add(&mut self, other: &Changes) {
        self.euler += other.euler;
        self.cavities += other.cavities;
        self.touches |= other.touches;
        self.joined |= other.joined;
    }
}

/// Whether a part of the outside reaches the end of the grid.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(C)]
struct Reaches {
    end: u8,
}

impl Measure for Reaches {
    fn add(&mut self, other: &Reaches) {
        self.end |= other.end;
    }
}

/// A part of the solid.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(C)]
struct Piece {
    cells: u64,
    /// Its runs that touch what is opened.
    touched: u64,
    /// Its runs with occupied cells, if they were asked for.
    sampled: u64,
}

impl Measure for Piece {
    fn add(&mut self, other: &Piece) {
        self.cells += other.cells;
        self.touched += other.touched;
        self.sampled += other.sampled;
    }
}
