//! Labels: which runs of cells hang together over all slices, and what is to be said of each such component.
//!
//! Components stream. Upwards, slice by slice, runs are joined by union-find within their slice and to the slice before; a set of
//! joined runs is a *class* of its slice, and of the slice below only "what became of its classes" is kept. Whatever is
//! measured of runs is added up along the way, so that it is complete where a component ends.
//! Downwards, a verdict is given where a component ends, and each class learns it from the slice above:
//!
//! ```text
//!   slice y+1   [0] [  1  ]          became, for the classes of slice y: 0 -> 0, 1 -> 1, 2 -> 1, 3 -> ended
//!   slice y     [0] [1] [2] [3]      verdict(y, c) = verdict(y+1, became(c)), or that given where it ended
//! ```
//!
//! Memory: the runs of two slices and their classes, whatever the number of slices.

use std::marker::PhantomData;

use bytemuck::Pod;

use crate::context::Context;
use crate::error::Result;
use crate::slice::{Bits, Run, Runs, SliceStore, set_range};
use crate::spool::{Spool, Workspace};

/// What is measured of a run, and so of a component.
pub trait Measure: Pod + Default {
    /// Adds what was measured of another part of the same component. Order must not matter.
    fn add(&mut self, other: &Self);
}

/// What a class became in the slice above, if nothing: it ended.
const ENDED: u32 = u32::MAX;

/// The upward half: takes slices of runs in order, from slice 0, and gives each run its class.
pub struct Labeller<M> {
    runs: SliceStore,
    classes: Lists<u32>,
    /// Of slice y: what its classes became in slice y + 1.
    became: Lists<u32>,
    /// Of slice y: what was measured of the components that ended there, in the order of its classes.
    ended: Lists<M>,
    below: Runs,
    below_classes: Vec<u32>,
    below_measures: Vec<M>,
    parents: Vec<u32>,
}

impl<M: Measure> Labeller<M> {
    /// A labeller of no slices yet.
    pub fn new(context: &Context) -> Labeller<M> {
        let quota = context.memory.store_quota;
        Labeller {
            runs: SliceStore::new(&context.workspace, quota),
            classes: Lists::new(&context.workspace, quota),
            became: Lists::new(&context.workspace, quota),
            ended: Lists::new(&context.workspace, quota),
            below: Runs::default(),
            below_classes: Vec::new(),
            below_measures: Vec::new(),
            parents: Vec::new(),
        }
    }

    /// Labels the next slice; `measures` has one entry for each of its runs.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn add(&mut self, slice: Runs, measures: &[M]) -> Result<()> {
        // Elements of the union-find: the classes below, then this slice's runs.
        let (base, runs) = (self.below_measures.len() as u32, slice.all().len() as u32);
        self.parents.clear();
        self.parents.extend(0..base + runs);
        let parents = &mut self.parents;
        let first = self.runs.slice_count() == 0;
        for z in 0..slice.row_count() {
            let range = slice.row_range(z);
            let row = &slice.all()[range.clone()];
            let number = |i: usize| base + (range.start + i) as u32;
            if z > 0 {
                let before = slice.row_range(z - 1);
                overlaps(row, &slice.all()[before.clone()], |i, j| {
                    unite(parents, number(i), base + (before.start + j) as u32);
                });
            }
            if !first {
                let below = self.below.row_range(z);
                let classes = &self.below_classes[below.clone()];
                overlaps(row, &self.below.all()[below], |i, j| unite(parents, number(i), classes[j]));
            }
        }

        let mut names = vec![ENDED; (base + runs) as usize];
        let mut sums: Vec<M> = Vec::new();
        self.below_classes.clear();
        for run in 0..runs {
            let root = find(parents, base + run) as usize;
            if names[root] == ENDED {
                names[root] = sums.len() as u32;
                sums.push(M::default());
            }
            sums[names[root] as usize].add(&measures[run as usize]);
            self.below_classes.push(names[root]);
        }
        let (mut became, mut ended) = (Vec::with_capacity(base as usize), Vec::new());
        for (class, measure) in self.below_measures.iter().enumerate() {
            let name = names[find(parents, class as u32) as usize];
            became.push(name);
            match sums.get_mut(name as usize) {
                Some(sum) => sum.add(measure),
                None => ended.push(*measure),
            }
        }
        if !first {
            self.became.append(&became)?;
            self.ended.append(&ended)?;
        }
        self.runs.append(&slice)?;
        self.classes.append(&self.below_classes)?;
        self.below_measures = sums;
        self.below = slice;
        Ok(())
    }

    /// Ends the upward half: what ends with the last slice ends.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn finish(mut self) -> Result<Components<M>> {
        self.became.append(&vec![ENDED; self.below_measures.len()])?;
        self.ended.append(&self.below_measures)?;
        Ok(Components { runs: self.runs, classes: self.classes, became: self.became, ended: self.ended })
    }
}

/// All components, measured, and not yet judged.
#[derive(Debug)]
pub struct Components<M> {
    runs: SliceStore,
    classes: Lists<u32>,
    became: Lists<u32>,
    ended: Lists<M>,
}

impl<M: Measure> Components<M> {
    /// Calls `each` with what was measured of every component, in the order in which they end.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn for_each(&self, mut each: impl FnMut(&M)) -> Result<()> {
        let mut ended = Vec::new();
        for y in 0..self.runs.slice_count() {
            self.ended.read(y, &mut ended)?;
            ended.iter().for_each(&mut each);
        }
        Ok(())
    }

    /// The downward half: every run learns its component's verdict, which is asked for once.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn judged(self, context: &Context, mut verdict: impl FnMut(&M) -> u8) -> Result<Labels> {
        let mut verdicts = Lists::new(&context.workspace, context.memory.store_quota);
        let (mut became, mut ended, mut above) = (Vec::new(), Vec::new(), Vec::<u8>::new());
        for y in (0..self.runs.slice_count()).rev() {
            self.became.read(y, &mut became)?;
            self.ended.read(y, &mut ended)?;
            let mut ended = ended.iter();
            let mut given = |class: &u32| match above.get(*class as usize) {
                Some(verdict) => *verdict,
                None => verdict(ended.next().expect("every class that ended was measured")),
            };
            let here: Vec<u8> = became.iter().map(&mut given).collect();
            verdicts.append(&here)?;
            above = here;
        }
        verdicts.places.reverse();
        Ok(Labels { runs: self.runs, classes: self.classes, verdicts })
    }
}

/// Runs of cells, slice by slice, each with its component's verdict.
#[derive(Debug)]
pub struct Labels {
    runs: SliceStore,
    classes: Lists<u32>,
    verdicts: Lists<u8>,
}

/// Buffers for reading a slice of [`Labels`].
#[derive(Debug, Default)]
pub struct Scratch {
    runs: Runs,
    classes: Vec<u32>,
    verdicts: Vec<u8>,
}

impl Labels {
    /// Sets the cells of slice `y` in `bits`, whatever their component's verdict.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint_all(&self, y: u32, bits: &mut Bits, scratch: &mut Scratch) -> Result<()> {
        self.runs.read(y, &mut scratch.runs)?;
        bits.paint(&scratch.runs, 0, 0);
        Ok(())
    }

    /// Sets the cells of slice `y` whose component's verdict is `wanted` in `bits`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint(&self, y: u32, wanted: u8, bits: &mut Bits, scratch: &mut Scratch) -> Result<()> {
        self.for_each(y, scratch, |z, run, verdict| {
            if verdict == wanted {
                set_range(bits.row_mut(z), run.start, run.end);
            }
        })
    }

    /// Calls `each` with the row, the run and the verdict of every run of slice `y`, in order.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn for_each(&self, y: u32, scratch: &mut Scratch, mut each: impl FnMut(u32, Run, u8)) -> Result<()> {
        self.runs.read(y, &mut scratch.runs)?;
        self.classes.read(y, &mut scratch.classes)?;
        self.verdicts.read(y, &mut scratch.verdicts)?;
        for z in 0..scratch.runs.row_count() {
            let range = scratch.runs.row_range(z);
            for (run, &class) in scratch.runs.row(z).iter().zip(&scratch.classes[range]) {
                each(z, *run, scratch.verdicts[class as usize]);
            }
        }
        Ok(())
    }
}

/// Lists of plain values, written one after the other, read by number.
#[derive(Debug)]
struct Lists<T> {
    spool: Spool,
    places: Vec<(u64, u32)>,
    values: PhantomData<T>,
}

impl<T: Pod> Lists<T> {
    fn new(workspace: &Workspace, in_memory: u64) -> Lists<T> {
        Lists { spool: workspace.spool(in_memory), places: Vec::new(), values: PhantomData }
    }

    fn append(&mut self, list: &[T]) -> Result<()> {
        let at = self.spool.append(bytemuck::cast_slice(list))?;
        self.places.push((at, list.len() as u32));
        Ok(())
    }

    fn read(&self, number: u32, out: &mut Vec<T>) -> Result<()> {
        let (at, len) = self.places[number as usize];
        out.resize(len as usize, T::zeroed());
        self.spool.read_at(at, bytemuck::cast_slice_mut(out))
    }
}

/// Calls `found(i, j)` for every pair of runs of two rows that share a cell coordinate.
pub fn overlaps(a: &[Run], b: &[Run], mut found: impl FnMut(usize, usize)) {
    let (mut i, mut j) = (0, 0);
    while i < a.len() && j < b.len() {
        if a[i].start < b[j].end && b[j].start < a[i].end {
            found(i, j);
        }
        if a[i].end < b[j].end { i += 1 } else { j += 1 }
    }
}

fn find(parents: &mut [u32], mut element: u32) -> u32 {
    while parents[element as usize] != element {
        let grandparent = parents[parents[element as usize] as usize];
        parents[element as usize] = grandparent;
        element = grandparent;
    }
    element
}

fn unite(parents: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(parents, a), find(parents, b));
    parents[a.max(b) as usize] = a.min(b);
}
