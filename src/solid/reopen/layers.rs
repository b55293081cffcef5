//! What passes over the slices hand on: lists of plain values, one a slice; and stretches of slices that a job holds.

use std::marker::PhantomData;
use std::ops::Range;

use bytemuck::Pod;

use crate::error::Result;
use crate::grid::context::Context;
use crate::grid::slice::{Run, Runs, SliceStore};
use crate::storage::spool::Spool;

/// So many of these exist at a time, beside stores of slices: together they have the share of one of those.
const STORES: u64 = 4;

/// A list of values for each slice, in temporary storage, written in order.
#[derive(Debug)]
pub struct Layers<T> {
    spool: Spool,
    places: Vec<(u64, u32)>,
    values: PhantomData<T>,
}

impl<T: Pod> Layers<T> {
    /// No slices yet.
    pub fn new(context: &Context) -> Layers<T> {
        let spool = context.workspace.spool(context.memory.store_quota / STORES);
        Layers { spool, places: Vec::new(), values: PhantomData }
    }

    /// Appends the next slices.
    pub fn extend(&mut self, slices: &[Vec<T>]) -> Result<()> {
        for slice in slices {
            let at = self.spool.append(bytemuck::cast_slice(slice))?;
            self.places.push((at, slice.len() as u32));
        }
        Ok(())
    }

    /// How many values each slice has.
    pub fn counts(&self) -> Vec<u32> {
        self.places.iter().map(|(_, count)| *count).collect()
    }

    /// The values of slice `y`.
    pub fn read(&self, y: u32) -> Result<Vec<T>> {
        let (at, len) = self.places[y as usize];
        let mut out = vec![T::zeroed(); len as usize];
        self.spool.read_at(at, bytemuck::cast_slice_mut(&mut out))?;
        Ok(out)
    }
}

/// The cells of a slice, row after row.
#[derive(Debug, Default)]
pub struct Cells {
    /// Row z has the cells from `starts[z]` to `starts[z + 1]`; none if the slice is empty.
    starts: Vec<u32>,
    xs: Vec<u32>,
}

impl Cells {
    /// The cells of `runs`.
    pub fn of(runs: &Runs) -> Cells {
        if runs.all().is_empty() {
            return Cells::default();
        }
        let mut out = Cells { starts: vec![0], xs: Vec::new() };
        for z in 0..runs.row_count() {
            runs.row(z).iter().for_each(|run| out.xs.extend(run.start..run.end));
            out.starts.push(out.xs.len() as u32);
        }
        out
    }

    /// Number of cells.
    pub fn count(&self) -> usize {
        self.xs.len()
    }

    /// The numbers of the cells of row `z`, which may lie outside the slice.
    fn row(&self, z: i64) -> Range<usize> {
        if z < 0 || z + 1 >= self.starts.len() as i64 {
            return 0..0;
        }
        self.starts[z as usize] as usize..self.starts[z as usize + 1] as usize
    }

    /// The numbers of the cells `x` of row `z`; both may reach outside the slice.
    #[inline]
    pub fn range(&self, z: i64, x: Range<i64>) -> Range<usize> {
        let numbers = self.row(z);
        let from = numbers.start;
        let row = &self.xs[numbers];
        let first = row.partition_point(|c| i64::from(*c) < x.start);
        let count = row[first..].iter().take_while(|c| i64::from(**c) < x.end).count();
        from + first..from + first + count
    }

    /// The number of a cell, if it is one of these.
    #[inline]
    pub fn at(&self, x: i64, z: i64) -> Option<usize> {
        self.range(z, x..x + 1).next()
    }

    /// Row and x of every cell, in order.
    pub fn iter(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.starts
            .windows(2)
            .zip(0..)
            .flat_map(|(ends, z)| self.xs[ends[0] as usize..ends[1] as usize].iter().map(move |x| (z, *x)))
    }

    /// The x of cell `number`.
    #[inline]
    pub fn x(&self, number: usize) -> u32 {
        self.xs[number]
    }
}

/// Consecutive slices of cells, each cell with a value.
#[derive(Debug)]
pub struct Held<T> {
    first: i64,
    slices: Vec<(Cells, Vec<T>)>,
}

impl<T: Pod> Held<T> {
    /// The cells of `store` with their `values` in `slices`, which may reach below the first slice and above the last.
    pub fn read(store: &SliceStore, values: &Layers<T>, slices: Range<i64>) -> Result<Held<T>> {
        let mut runs = Runs::default();
        let read = |y| {
            if !(0..i64::from(store.slice_count())).contains(&y) {
                return Ok((Cells::default(), Vec::new()));
            }
            store.read(y as u32, &mut runs)?;
            Ok((Cells::of(&runs), values.read(y as u32)?))
        };
        Ok(Held { first: slices.start, slices: slices.map(read).collect::<Result<_>>()? })
    }
}

impl<T> Held<T> {
    /// The slices from slice `first` on.
    #[cfg(test)]
    pub fn of(first: i64, slices: Vec<(Cells, Vec<T>)>) -> Held<T> {
        Held { first, slices }
    }

    /// The cells of slice `y`, with their values.
    pub fn slice(&self, y: i64) -> (&Cells, &[T]) {
        let (cells, values) = &self.slices[(y - self.first) as usize];
        (cells, values)
    }

    /// The value of a cell, if it is one of these.
    #[inline]
    pub fn at(&self, [x, y, z]: [i64; 3]) -> Option<&T> {
        let (cells, values) = self.slice(y);
        cells.at(x, z).map(|number| &values[number])
    }

    /// Calls `each` with every cell of the cube of so many cells either way, by slice, row and x, and its value.
    #[inline]
    pub fn round(&self, [x, y, z]: [i64; 3], reach: i64, mut each: impl FnMut([i64; 3], &T)) {
        for y in y - reach..=y + reach {
            let (cells, values) = self.slice(y);
            for z in z - reach..=z + reach {
                for number in cells.range(z, x - reach..x + reach + 1) {
                    each([i64::from(cells.x(number)), y, z], &values[number]);
                }
            }
        }
    }

    /// Whether there is a cell in a box.
    pub fn any_of(&self, [xs, mut ys, zs]: [Range<i64>; 3]) -> bool {
        ys.any(|y| zs.clone().any(|z| !self.slice(y).0.range(z, xs.clone()).is_empty()))
    }

    /// Whether there is no cell at all.
    pub fn is_empty(&self) -> bool {
        self.slices.iter().all(|(cells, _)| cells.count() == 0)
    }
}

/// Consecutive slices of runs.
#[derive(Debug)]
pub struct Stretch {
    first: i64,
    slices: Vec<Runs>,
}

impl Stretch {
    /// Some slices of `store`; those outside it are empty.
    pub fn read(store: &SliceStore, slices: Range<i64>) -> Result<Stretch> {
        let read = |y| {
            let mut runs = Runs::default();
            if (0..i64::from(store.slice_count())).contains(&y) {
                store.read(y as u32, &mut runs)?;
            }
            Ok(runs)
        };
        Ok(Stretch { first: slices.start, slices: slices.map(read).collect::<Result<_>>()? })
    }

    /// The slices from slice `first` on.
    pub fn of(first: i64, slices: Vec<Runs>) -> Stretch {
        Stretch { first, slices }
    }

    /// The runs of a row; none outside.
    #[inline]
    pub fn row(&self, y: i64, z: i64) -> &[Run] {
        let slice = &self.slices[(y - self.first) as usize];
        if z >= 0 && z < i64::from(slice.row_count()) { slice.row(z as u32) } else { &[] }
    }

    /// Slice `y`.
    pub fn slice(&self, y: i64) -> &Runs {
        &self.slices[(y - self.first) as usize]
    }

    /// Whether a cell is set.
    #[inline]
    pub fn get(&self, [x, y, z]: [i64; 3]) -> bool {
        let row = self.row(y, z);
        let after = row.partition_point(|run| i64::from(run.start) <= x);
        after > 0 && i64::from(row[after - 1].end) > x
    }

    /// Whether one of the cells `x` of a row is set.
    #[inline]
    pub fn any(&self, x: Range<i64>, y: i64, z: i64) -> bool {
        let row = self.row(y, z);
        let before = row.partition_point(|run| i64::from(run.start) < x.end);
        before > 0 && i64::from(row[before - 1].end) > x.start
    }
}

impl Stretch {
    /// Calls `each` with the cells of a box that are set, by slice, row and x.
    pub fn cells(&self, [xs, ys, zs]: [Range<i64>; 3], mut each: impl FnMut([i64; 3])) {
        for y in ys {
            for z in zs.clone() {
                let row = self.row(y, z);
                let first = row.partition_point(|run| i64::from(run.end) <= xs.start);
                for run in row[first..].iter().take_while(|run| i64::from(run.start) < xs.end) {
                    for x in i64::from(run.start).max(xs.start)..i64::from(run.end).min(xs.end) {
                        each([x, y, z]);
                    }
                }
            }
        }
    }

    /// Whether one of the cells of a box is set.
    pub fn any_of(&self, [xs, mut ys, zs]: [Range<i64>; 3]) -> bool {
        ys.any(|y| zs.clone().any(|z| self.any(xs.clone(), y, z)))
    }
}

/// Cubes of cells round one cell after the other, of a row from the first on: what the next ones do not reach is passed over once.
#[derive(Debug)]
pub struct Rounds<'a, T> {
    held: &'a Held<T>,
    reach: i64,
    /// The cell before.
    before: Option<[i64; 3]>,
    /// The rows round it, what they lie in, and of each the cells, with their values, that are not passed over.
    rows: Vec<([i64; 2], &'a [u32], &'a [T])>,
}

impl<'a, T> Rounds<'a, T> {
    /// Cubes of so many cells either way.
    pub fn new(held: &'a Held<T>, reach: i64) -> Rounds<'a, T> {
        Rounds { held, reach, before: None, rows: Vec::new() }
    }

    /// The same as [`Held::round`].
    #[inline]
    pub fn round(&mut self, cell: [i64; 3], mut each: impl FnMut([i64; 3], &'a T)) {
        let [x, y, z] = cell;
        if !self.before.is_some_and(|before| [before[1], before[2]] == [y, z] && before[0] <= x) {
            self.rows.clear();
            for y in y - self.reach..=y + self.reach {
                let (cells, values) = &self.held.slices[(y - self.held.first) as usize];
                for z in z - self.reach..=z + self.reach {
                    let numbers = cells.row(z);
                    if !numbers.is_empty() {
                        self.rows.push(([y, z], &cells.xs[numbers.clone()], &values[numbers]));
                    }
                }
            }
        }
        self.before = Some(cell);
        let (from, to) = (x - self.reach, x + self.reach);
        for ([y, z], xs, values) in &mut self.rows {
            let passed = xs.iter().take_while(|x| i64::from(**x) < from).count();
            (*xs, *values) = (&xs[passed..], &values[passed..]);
            for (x, value) in xs.iter().zip(*values).take_while(|(x, _)| i64::from(**x) <= to) {
                each([i64::from(*x), *y, *z], value);
            }
        }
    }
}

impl<T> Layers<T> {
    /// Turns the order of slices round, for what was written from the last to the first.
    pub fn reverse(&mut self) {
        self.places.reverse();
    }
}

impl<T> Held<T> {
    /// The slices that are held.
    pub fn slices(&self) -> Range<i64> {
        self.first..self.first + self.slices.len() as i64
    }

    /// The values of slice `y`, to be changed.
    pub fn values_mut(&mut self, y: i64) -> &mut [T] {
        &mut self.slices[(y - self.first) as usize].1
    }
}
