//! Labels: which runs of cells hang together over all slices, and what is to be said of each such component.
//!
//! Components stream. Upwards, slice by slice, runs are joined by union-find within their slice and to the slice before; a set of
//! joined runs is a *class* of its slice, and of the slice below only "what became of its classes" is kept. Whatever is
//! measured of runs is added up along the way, so that it is complete where a component ends, and a verdict is given there.
//! Downwards, each class learns the verdict from the slice above:
//!
//! ```text
//!   slice y+1   [0] [  1  ]          became, for the classes of slice y: 0 -> 0, 1 -> 1, 2 -> 1, 3 -> ended: its verdict
//!   slice y     [0] [1] [2] [3]      verdict(y, c) = verdict(y+1, became(c)), or that given where it ended
//! ```
//!
//! Memory: the runs of two slices and their classes, whatever the number of slices.

use crate::context::Context;
use crate::error::Result;
use crate::slice::{Bits, Run, Runs, SliceStore, set_range};
use crate::spool::{Spool, Workspace};

/// What is measured of a run, and so of a component.
pub trait Measure: Copy + Default {
    /// Adds what was measured of another part of the same component. Order must not matter.
    fn add(&mut self, other: &Self);
}

/// From here on, a class did not become a class of the slice above: it ended, with the verdict that the rest of the number tells.
const ENDED: u32 = u32::MAX - u8::MAX as u32;

/// The upward half: takes slices of runs in order, from slice 0, and gives each run its class.
pub struct Labeller<M> {
    runs: SliceStore,
    classes: Records,
    /// Of slice y: what its classes became in slice y + 1.
    became: Records,
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
            classes: Records::new(&context.workspace, quota),
            became: Records::new(&context.workspace, quota),
            below: Runs::default(),
            below_classes: Vec::new(),
            below_measures: Vec::new(),
            parents: Vec::new(),
        }
    }

    /// Labels the next slice; `measures` has one entry for each of its runs. `verdict` tells what a component that ends comes to.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn add(&mut self, slice: Runs, measures: &[M], verdict: impl Fn(&M) -> u8) -> Result<()> {
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
        let mut became = Vec::with_capacity(base as usize);
        for (class, measure) in self.below_measures.iter().enumerate() {
            let name = names[find(parents, class as u32) as usize];
            became.push(if name == ENDED { ENDED + u32::from(verdict(measure)) } else { name });
            if name != ENDED {
                sums[name as usize].add(measure);
            }
        }
        if !first {
            self.became.append(&became)?;
        }
        self.runs.append(&slice)?;
        self.classes.append(&self.below_classes)?;
        self.below_measures = sums;
        self.below = slice;
        Ok(())
    }

    /// The downward half: every run learns its component's verdict.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn resolve(self, context: &Context, verdict: impl Fn(&M) -> u8) -> Result<Labels> {
        let mut verdicts = Records::new(&context.workspace, context.memory.store_quota);
        let mut above: Vec<u32> = self.below_measures.iter().map(|measure| u32::from(verdict(measure))).collect();
        let slices = self.runs.slice_count();
        if slices > 0 {
            verdicts.append(&above)?;
        }
        let mut became = Vec::new();
        for y in (0..slices.saturating_sub(1)).rev() {
            self.became.read(y, &mut became)?;
            let here: Vec<u32> =
                became.iter().map(|&c| if c >= ENDED { c - ENDED } else { above[c as usize] }).collect();
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
    classes: Records,
    verdicts: Records,
}

/// Buffers for reading a slice of [`Labels`].
#[derive(Debug, Default)]
pub struct Scratch {
    runs: Runs,
    classes: Vec<u32>,
    verdicts: Vec<u32>,
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
        self.runs.read(y, &mut scratch.runs)?;
        self.classes.read(y, &mut scratch.classes)?;
        self.verdicts.read(y, &mut scratch.verdicts)?;
        for z in 0..scratch.runs.row_count() {
            let range = scratch.runs.row_range(z);
            let classes = &scratch.classes[range.clone()];
            for (run, &class) in scratch.runs.all()[range].iter().zip(classes) {
                if scratch.verdicts[class as usize] == u32::from(wanted) {
                    set_range(bits.row_mut(z), run.start, run.end);
                }
            }
        }
        Ok(())
    }
}

/// Lists of `u32`, written one after the other, read by number.
#[derive(Debug)]
struct Records {
    spool: Spool,
    places: Vec<(u64, u32)>,
}

impl Records {
    fn new(workspace: &Workspace, in_memory: u64) -> Records {
        Records { spool: workspace.spool(in_memory), places: Vec::new() }
    }

    fn append(&mut self, list: &[u32]) -> Result<()> {
        let at = self.spool.append(bytemuck::cast_slice(list))?;
        self.places.push((at, list.len() as u32));
        Ok(())
    }

    fn read(&self, number: u32, out: &mut Vec<u32>) -> Result<()> {
        let (at, len) = self.places[number as usize];
        out.resize(len as usize, 0);
        self.spool.read_at(at, bytemuck::cast_slice_mut(out))
    }
}

/// Calls `found(i, j)` for every pair of runs of two rows that share a cell coordinate.
fn overlaps(a: &[Run], b: &[Run], mut found: impl FnMut(usize, usize)) {
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
