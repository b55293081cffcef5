//! Labels: which runs of cells hang together over all slices, and what is to be said of each such component.
//!
//! Components stream. A job joins the runs of its chunk of slices by union-find to *parts*; what is measured of runs is added up by part.
//! Of a part that touches neither the chunk's lowest nor its highest slice that is all: it is *closed*. The others are *open*. Upwards, chunk
//! by chunk, open parts are joined where the highest slice of a chunk meets the lowest of the next; a set of joined parts is a *class* of its
//! chunk, and of the chunk below only "what became of its classes" is kept. Measures are added up along the way, so that they are complete
//! where a component ends. Downwards, a verdict is given where a component ends, and each class learns it from the chunk above:
//!
//! ```text
//!   chunk c+1   [0] [  1  ]          became, for the classes of chunk c: 0 -> 0, 1 -> 1, 2 -> 1, 3 -> ended
//!   chunk c     [0] [1] [2] [3]      verdict(c, class) = verdict(c+1, became(class)), or that given where it ended
//! ```
//!
//! Only what touches the border of chunks is joined on the calling thread. Memory: the runs and parts of a chunk for each job, and of two slices
//! with their open parts.

use std::marker::PhantomData;

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::grid::Cell;
use crate::grid::context::Context;
use crate::grid::slice::{Bits, Run, Runs, SliceStore, Slices, set_range};
use crate::storage::spool::{Spool, Workspace};

/// What is measured of a run, and so of a component.
pub trait Measure: Pod + Default + Send {
    /// Adds what was measured of another part of the same component. Order must not matter.
    fn add(&mut self, other: &Self);
}

/// The number of a run's or a component's cells.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(transparent)]
pub struct Cells(pub u64);

impl Measure for Cells {
    fn add(&mut self, other: &Cells) {
        self.0 += other.0;
    }
}

/// What a class became in the chunk above, if nothing: it ended.
const ENDED: u32 = u32::MAX;

/// The parts of a chunk of slices.
#[derive(Debug)]
pub struct Parts<M> {
    runs: Slices,
    /// The part of each run, slice after slice.
    parts: Vec<u32>,
    /// The number of runs in the chunk before each slice, and then of all.
    starts: Vec<u32>,
    lowest: Runs,
    highest: Runs,
    /// What was measured of the open parts, which have the first numbers.
    open: Vec<M>,
    closed: Vec<M>,
}

impl<M: Measure> Parts<M> {
    /// Joins the runs of a chunk of slices; `measure` is told slice, row and run, in order. There must be a slice.
    pub fn of(slices: Vec<Runs>, mut measure: impl FnMut(usize, u32, Run) -> M) -> Parts<M> {
        let mut runs = Slices::default();
        let mut starts = vec![0];
        let mut parents: Vec<u32> = Vec::new();
        for (y, slice) in slices.iter().enumerate() {
            runs.push_runs(slice);
            let base = parents.len() as u32;
            parents.extend(base..base + slice.all().len() as u32);
            starts.push(parents.len() as u32);
            for z in 0..slice.row_count() {
                let here = slice.row_range(z);
                let row = &slice.all()[here.clone()];
                let mut join = |other: &Runs, z: u32, base_of_other: u32| {
                    let there = other.row_range(z);
                    overlaps(row, &other.all()[there.clone()], |i, j| {
                        unite(&mut parents, base + (here.start + i) as u32, base_of_other + (there.start + j) as u32);
                    });
                };
                if z > 0 {
                    join(slice, z - 1, base);
                }
                if y > 0 {
                    join(&slices[y - 1], z, starts[y - 1]);
                }
            }
        }
        // No run has a parent behind it: in order, each learns its root.
        for run in 0..parents.len() {
            parents[run] = parents[parents[run] as usize];
        }
        // Open parts first.
        let mut numbers = vec![ENDED; parents.len()];
        let (mut open, last) = (0, slices.len() - 1);
        let ends = [0..starts[1], starts[last]..starts[last + 1]];
        for root in ends.into_iter().flatten().map(|run| parents[run as usize] as usize) {
            if numbers[root] == ENDED {
                numbers[root] = open;
                open += 1;
            }
        }
        let mut measures = vec![M::default(); open as usize];
        let mut next = 0;
        for (y, slice) in slices.iter().enumerate() {
            for z in 0..slice.row_count() {
                for run in slice.row(z) {
                    let root = parents[next] as usize;
                    if numbers[root] == ENDED {
                        numbers[root] = measures.len() as u32;
                        measures.push(M::default());
                    }
                    measures[numbers[root] as usize].add(&measure(y, z, *run));
                    next += 1;
                }
            }
        }
        parents.iter_mut().for_each(|part| *part = numbers[*part as usize]);
        let closed = measures.split_off(open as usize);
        let mut slices = slices.into_iter();
        let lowest = slices.next().expect("a chunk has a slice");
        let highest = slices.next_back().unwrap_or_else(|| lowest.clone());
        Parts { runs, parts: parents, starts, lowest, highest, open: measures, closed }
    }

    /// The parts of slice `y` of the chunk.
    fn of_slice(&self, y: usize) -> &[u32] {
        &self.parts[self.starts[y] as usize..self.starts[y + 1] as usize]
    }
}

/// The upward half: takes the parts of chunks in order, from slice 0.
pub struct Labeller<M> {
    components: Components<M>,
    /// The highest slice so far, the class of each of its runs, and what was measured of each class.
    below: Runs,
    below_classes: Vec<u32>,
    below_measures: Vec<M>,
}

impl<M: Measure> Labeller<M> {
    /// A labeller of no slices yet.
    pub fn new(context: &Context) -> Labeller<M> {
        let quota = context.memory.store_quota;
        let components = Components {
            runs: SliceStore::new(&context.workspace, quota),
            parts: Lists::new(&context.workspace, quota),
            chunk_of: Vec::new(),
            classes: Lists::new(&context.workspace, quota),
            became: Lists::new(&context.workspace, quota),
            ended: Lists::new(&context.workspace, quota),
            closed: Lists::new(&context.workspace, quota),
        };
        Labeller { components, below: Runs::default(), below_classes: Vec::new(), below_measures: Vec::new() }
    }

    /// Joins the next chunk to those before.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn add(&mut self, chunk: Parts<M>) -> Result<()> {
        // Elements of the union-find: the classes below, then this chunk's open parts.
        let (base, open) = (self.below_measures.len(), chunk.open.len());
        let mut parents: Vec<u32> = (0..(base + open) as u32).collect();
        let first = self.components.chunk_of.is_empty();
        if !first {
            let parts = chunk.of_slice(0);
            for z in 0..chunk.lowest.row_count() {
                let (here, below) = (chunk.lowest.row_range(z), self.below.row_range(z));
                overlaps(chunk.lowest.row(z), self.below.row(z), |i, j| {
                    unite(&mut parents, base as u32 + parts[here.start + i], self.below_classes[below.start + j]);
                });
            }
        }
        let mut names = vec![ENDED; base + open];
        let (mut classes, mut sums): (Vec<u32>, Vec<M>) = (Vec::with_capacity(open), Vec::new());
        for (part, measure) in chunk.open.iter().enumerate() {
            let root = find(&mut parents, (base + part) as u32) as usize;
            if names[root] == ENDED {
                names[root] = sums.len() as u32;
                sums.push(M::default());
            }
            sums[names[root] as usize].add(measure);
            classes.push(names[root]);
        }
        let (mut became, mut ended) = (Vec::with_capacity(base), Vec::new());
        for (class, measure) in self.below_measures.iter().enumerate() {
            let name = names[find(&mut parents, class as u32) as usize];
            became.push(name);
            match sums.get_mut(name as usize) {
                Some(sum) => sum.add(measure),
                None => ended.push(*measure),
            }
        }
        let slices = chunk.starts.len() - 1;
        let highest = chunk.of_slice(slices - 1);
        self.below_classes.clear();
        self.below_classes.extend(highest.iter().map(|part| classes[*part as usize]));
        (self.below, self.below_measures) = (chunk.highest, sums);

        let out = &mut self.components;
        if !first {
            out.became.append(&became)?;
            out.ended.append(&ended)?;
        }
        out.chunk_of.extend(std::iter::repeat_n(out.classes.places.len() as u32, slices));
        out.classes.append(&classes)?;
        out.closed.append(&chunk.closed)?;
        out.runs.extend(&chunk.runs)?;
        out.parts.extend(&chunk.parts, &chunk.starts)
    }

    /// Ends the upward half: what ends with the last slice ends.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn finish(mut self) -> Result<Components<M>> {
        self.components.became.append(&vec![ENDED; self.below_measures.len()])?;
        self.components.ended.append(&self.below_measures)?;
        Ok(self.components)
    }
}

/// All components, measured, and not yet judged.
#[derive(Debug)]
pub struct Components<M> {
    runs: SliceStore,
    /// The parts of each slice's runs.
    parts: Lists<u32>,
    /// The chunk of each slice.
    chunk_of: Vec<u32>,
    /// The classes of each chunk's open parts.
    classes: Lists<u32>,
    /// What each chunk's classes became in the next chunk.
    became: Lists<u32>,
    /// What was measured of the components that ended in each chunk, in the order of its classes.
    ended: Lists<M>,
    /// What was measured of each chunk's closed parts.
    closed: Lists<M>,
}

impl<M: Measure> Components<M> {
    /// Calls `each` with what was measured of every component.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn for_each(&self, mut each: impl FnMut(&M)) -> Result<()> {
        let mut read = Vec::new();
        for list in [&self.ended, &self.closed] {
            for chunk in 0..list.places.len() as u32 {
                list.read(chunk, &mut read)?;
                read.iter().for_each(&mut each);
            }
        }
        Ok(())
    }

    /// The downward half: every run learns its component's verdict, which is asked for once.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn judged(self, context: &Context, mut verdict: impl FnMut(&M) -> u8) -> Result<Labels> {
        let mut verdicts = Lists::new(&context.workspace, context.memory.store_quota);
        let (mut became, mut measures, mut classes, mut of_parts) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut above = Vec::<u8>::new();
        for chunk in (0..self.classes.places.len() as u32).rev() {
            self.became.read(chunk, &mut became)?;
            self.ended.read(chunk, &mut measures)?;
            let mut ended = measures.iter();
            let mut given = |class: &u32| match above.get(*class as usize) {
                Some(verdict) => *verdict,
                None => verdict(ended.next().expect("every class that ended was measured")),
            };
            let here: Vec<u8> = became.iter().map(&mut given).collect();
            self.classes.read(chunk, &mut classes)?;
            self.closed.read(chunk, &mut measures)?;
            of_parts.clear();
            of_parts.extend(classes.iter().map(|class| here[*class as usize]));
            of_parts.extend(measures.iter().map(&mut verdict));
            verdicts.append(&of_parts)?;
            above = here;
        }
        verdicts.places.reverse();
        Ok(Labels { runs: self.runs, parts: self.parts, chunk_of: self.chunk_of, verdicts })
    }
}

/// Runs of cells, slice by slice, each with its component's verdict.
#[derive(Debug)]
pub struct Labels {
    runs: SliceStore,
    parts: Lists<u32>,
    chunk_of: Vec<u32>,
    /// The verdicts on each chunk's parts.
    verdicts: Lists<u8>,
}

/// Buffers for reading a slice of [`Labels`].
#[derive(Debug, Default)]
pub struct Scratch {
    runs: Runs,
    parts: Vec<u32>,
    verdicts: Vec<u8>,
}

impl Labels {
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

    /// All cells whose component's verdict is `wanted`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn cells(&self, wanted: u8, [_, slices, rows]: Cell, context: &Context) -> Result<SliceStore> {
        context.slices_of(slices, context.memory.chunks_in_flight, |chunk, slices| {
            let mut scratch = Scratch::default();
            for y in chunk {
                let mut all: Vec<Vec<Run>> = vec![Vec::new(); rows as usize];
                self.for_each(y, &mut scratch, |z, run, verdict| {
                    if verdict == wanted {
                        all[z as usize].push(run);
                    }
                })?;
                slices.push_runs(&Runs::joined(all));
            }
            Ok(())
        })
    }

    /// Calls `each` with the row, the run and the verdict of every run of slice `y`, in order.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn for_each(&self, y: u32, scratch: &mut Scratch, mut each: impl FnMut(u32, Run, u8)) -> Result<()> {
        self.runs.read(y, &mut scratch.runs)?;
        self.parts.read(y, &mut scratch.parts)?;
        self.verdicts.read(self.chunk_of[y as usize], &mut scratch.verdicts)?;
        for z in 0..scratch.runs.row_count() {
            let range = scratch.runs.row_range(z);
            for (run, &part) in scratch.runs.row(z).iter().zip(&scratch.parts[range]) {
                each(z, *run, scratch.verdicts[part as usize]);
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

    /// Appends several lists: from each start to the next.
    fn extend(&mut self, lists: &[T], starts: &[u32]) -> Result<()> {
        let at = self.spool.append(bytemuck::cast_slice(lists))?;
        let place = |ends: &[u32]| (at + u64::from(ends[0]) * size_of::<T>() as u64, ends[1] - ends[0]);
        self.places.extend(starts.windows(2).map(place));
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::run::testing::context;

    const SIZE: [usize; 3] = [70, 12, 5];

    fn index([x, y, z]: [usize; 3]) -> usize {
        (y * SIZE[2] + z) * SIZE[0] + x
    }

    fn cell(index: usize) -> [usize; 3] {
        [index % SIZE[0], index / SIZE[0] / SIZE[2], index / SIZE[0] % SIZE[2]]
    }

    /// The number of cells of each set cell's component, by flooding from every cell.
    fn flooded(set: &[bool]) -> Vec<u64> {
        let mut out = vec![0; set.len()];
        for first in 0..set.len() {
            if !set[first] || out[first] > 0 {
                continue;
            }
            let (mut component, mut at) = (vec![first], 0);
            out[first] = 1;
            while at < component.len() {
                for (axis, size) in SIZE.into_iter().enumerate() {
                    for step in [-1isize, 1] {
                        let mut next = cell(component[at]);
                        next[axis] = next[axis].wrapping_add_signed(step);
                        if next[axis] < size && set[index(next)] && out[index(next)] == 0 {
                            out[index(next)] = 1;
                            component.push(index(next));
                        }
                    }
                }
                at += 1;
            }
            component.iter().for_each(|&c| out[c] = component.len() as u64);
        }
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(150))]

        /// Components that reach over any number of chunks, in memory and on disk, are those that flooding finds.
        #[test]
        fn labels_are_those_of_flooding(
            bits in prop::collection::vec(0u32..100, SIZE.iter().product::<usize>()),
            filling in 5u32..95,
            cuts in prop::collection::vec(1usize..6, SIZE[1]),
            in_memory in any::<bool>(),
        ) {
            let set: Vec<bool> = bits.iter().map(|bit| *bit < filling).collect();
            let dir = tempfile::tempdir().unwrap();
            let mut context = context(dir.path(), SIZE.map(|c| c as u32), 1);
            context.memory.store_quota = if in_memory { 1 << 20 } else { 0 };

            let slice = |y: usize| {
                let mut bits = Bits::new(SIZE[0] as u32, SIZE[2] as u32);
                (0..SIZE[2]).for_each(|z| {
                    (0..SIZE[0]).filter(|&x| set[index([x, y, z])]).for_each(|x| bits.set(x as u32, z as u32));
                });
                Runs::from_bits(&bits)
            };
            let mut labeller = Labeller::new(&context);
            let mut y = 0;
            for length in cuts {
                let end = (y + length).min(SIZE[1]);
                if y < end {
                    let slices: Vec<Runs> = (y..end).map(slice).collect();
                    labeller.add(Parts::of(slices, |_, _, run| Cells(u64::from(run.end - run.start)))).unwrap();
                }
                y = end;
            }
            let components = labeller.finish().unwrap();
            let expected = flooded(&set);
            let mut sizes = Vec::new();
            components.for_each(|cells| sizes.push(cells.0)).unwrap();
            prop_assert_eq!(sizes.iter().sum::<u64>(), set.iter().filter(|set| **set).count() as u64);

            let labels = components.judged(&context, |cells| (cells.0 % 200) as u8).unwrap();
            let mut scratch = Scratch::default();
            for y in 0..SIZE[1] {
                let mut seen = 0;
                let mut wrong = Vec::new();
                labels
                    .for_each(y as u32, &mut scratch, |z, run, verdict| {
                        for x in run.start..run.end {
                            seen += 1;
                            let at = [x as usize, y, z as usize];
                            if !set[index(at)] || (expected[index(at)] % 200) as u8 != verdict {
                                wrong.push(at);
                            }
                        }
                    })
                    .unwrap();
                prop_assert!(wrong.is_empty(), "{wrong:?}");
                prop_assert_eq!(seen, (0..SIZE[0] * SIZE[2]).filter(|i| set[y * SIZE[0] * SIZE[2] + i]).count());
            }
        }
    }
}
