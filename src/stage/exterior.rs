//! Exterior: the free cells that a path of free cells joins to the border of the padded box.
//!
//! Labels stream. Upwards, slice by slice, runs of free cells are joined by union-find within their slice and to the slice before;
//! a set of joined runs is a *class* of its slice, and of the slice below only "what became of its classes" is kept.
//! Class 0 is what is known to be exterior. Downwards, each class learns from the slice above what it turned out to be:
//!
//! ```text
//!   slice y+1   [0] [  1  ]          became, for the classes of slice y: 0 -> 0, 1 -> 1, 2 -> 1, 3 -> ended
//!   slice y     [0] [1] [2] [3]      exterior(y, c) = exterior(y+1, became(c)); what ended is not
//! ```
//!
//! Memory: the runs of two slices and their classes, whatever the number of slices.

use crate::context::{Context, chunks};
use crate::error::Result;
use crate::grid::Cell;
use crate::slice::{Bits, Runs, SliceStore, words_for};
use crate::stage::dilate::Ball;
use crate::stage::labels::{Lists, find, overlaps, unite};
use crate::stage::raster::Occupancy;
use crate::window::Window;

/// What a class became in the slice above, if nothing: it ended.
const ENDED: u32 = u32::MAX;

/// The box of cells padded on every side by ρ + 1: far enough that a ball outside the box touches every side of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Padded {
    /// Cells added on every side.
    pub pad: u32,
    /// Cells along x, slices, rows, padding included.
    pub cells: Cell,
}

impl Padded {
    /// The padding that closing radius `radius` asks for round a box of `cells`.
    pub fn new(cells: Cell, radius: u32) -> Padded {
        let pad = radius + 1;
        Padded { pad, cells: cells.map(|c| c + 2 * pad) }
    }
}

/// The exterior of a cloud, slice by slice, in the padded box.
#[derive(Debug)]
pub struct Exterior {
    /// The box.
    pub padded: Padded,
    free: SliceStore,
    classes: Lists<u32>,
    exterior: Lists<u32>,
}

impl Exterior {
    /// Finds the cells from which a path of cells free of the ball leads to the border.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn find(occupancy: &Occupancy, ball: &Ball, context: &Context) -> Result<Exterior> {
        let padded = Padded::new(occupancy.cells, ball.radius());
        let slices = padded.cells[1];
        let mut labeller = Labeller::new(padded, context);
        let mut jobs = chunks(slices);
        context.workers.in_order(
            context.memory.chunks_for(&context.load, ball.radius()),
            || Ok(jobs.next()),
            |chunk| free_slices(occupancy, ball, padded, chunk),
            |free: Vec<Runs>| free.into_iter().try_for_each(|slice| labeller.add(slice)),
        )?;
        labeller.resolve(context)
    }

    /// Sets the free cells of padded slice `y`, exterior or enclosed, in `bits`, which must be empty.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint_free(&self, y: u32, bits: &mut Bits, scratch: &mut Scratch) -> Result<()> {
        self.free.read(y, &mut scratch.runs)?;
        bits.paint(&scratch.runs, 0, 0);
        Ok(())
    }

    /// Sets the exterior cells of padded slice `y` in `bits`, which must be empty. `scratch` is overwritten.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint(&self, y: u32, bits: &mut Bits, scratch: &mut Scratch) -> Result<()> {
        self.free.read(y, &mut scratch.runs)?;
        self.classes.read(y, &mut scratch.classes)?;
        self.exterior.read(y, &mut scratch.exterior)?;
        for z in 0..scratch.runs.row_count() {
            let range = scratch.runs.row_range(z);
            let classes = &scratch.classes[range.clone()];
            for (run, &class) in scratch.runs.all()[range].iter().zip(classes) {
                if scratch.exterior[class as usize] != 0 {
                    crate::slice::set_range(bits.row_mut(z), run.start, run.end);
                }
            }
        }
        Ok(())
    }
}

/// Buffers for reading a slice of [`Exterior`].
#[derive(Debug, Default)]
pub struct Scratch {
    runs: Runs,
    classes: Vec<u32>,
    exterior: Vec<u32>,
}

/// The free cells of a chunk of padded slices.
fn free_slices(occupancy: &Occupancy, ball: &Ball, padded: Padded, chunk: std::ops::Range<u32>) -> Result<Vec<Runs>> {
    let [width, _, rows] = padded.cells;
    let radius = i64::from(ball.radius());
    let mut window = Window::new(2 * ball.radius() as usize + 1, || Bits::new(width, rows));
    let (mut runs, mut acc) = (Runs::default(), vec![0; words_for(width)]);
    let mut out = Vec::with_capacity(chunk.len());
    for y in chunk.map(i64::from) {
        window.slide_to(y - radius, |y, bits| {
            bits.clear();
            let y = y - i64::from(padded.pad);
            if (0..i64::from(occupancy.cells[1])).contains(&y) {
                occupancy.store.read(y as u32, &mut runs)?;
                bits.paint(&runs, padded.pad, padded.pad);
            }
            Ok(())
        })?;
        let mut free = Runs::default();
        for z in 0..rows as i32 {
            let row = |dy: i32, dz: i32| {
                let z = z + dz;
                if z < 0 || z >= rows as i32 { None } else { window.get(y + i64::from(dy)).lit_row(z as u32) }
            };
            if ball.dilate_row(row, &mut acc) {
                invert(&mut acc, width);
                free.push_row(&acc);
            } else {
                free.push_run(0, width);
                free.end_row();
            }
        }
        out.push(free);
    }
    Ok(out)
}

/// Complements the first `width` cells of a row; the rest of its last word stays clear.
pub fn invert(words: &mut [u64], width: u32) {
    for word in words.iter_mut() {
        *word = !*word;
    }
    if !width.is_multiple_of(64)
        && let Some(last) = words.last_mut()
    {
        *last &= u64::MAX >> (64 - width % 64);
    }
}

/// The upward half: takes slices of free runs in order and gives each run its class.
struct Labeller {
    padded: Padded,
    free: SliceStore,
    classes: Lists<u32>,
    /// Of slice y: what its classes became in slice y + 1.
    became: Lists<u32>,
    below: Runs,
    below_classes: Vec<u32>,
    /// Number of classes of the slice below; class 0 always exists.
    below_count: usize,
    parents: Vec<u32>,
}

impl Labeller {
    fn new(padded: Padded, context: &Context) -> Labeller {
        let quota = context.memory.store_quota;
        Labeller {
            padded,
            free: SliceStore::new(&context.workspace, quota),
            classes: Lists::new(&context.workspace, quota),
            became: Lists::new(&context.workspace, quota),
            below: Runs::default(),
            below_classes: Vec::new(),
            below_count: 1,
            parents: Vec::new(),
        }
    }

    /// Labels the next slice. Elements of the union-find: the classes below, then this slice's runs.
    fn add(&mut self, slice: Runs) -> Result<()> {
        let y = self.free.slice_count();
        let [width, slices, rows] = self.padded.cells;
        let (base, runs) = (self.below_count as u32, slice.all().len() as u32);
        self.parents.clear();
        self.parents.extend(0..base + runs);
        let parents = &mut self.parents;
        let at_end = y == 0 || y == slices - 1;
        for z in 0..rows {
            let range = slice.row_range(z);
            let row = &slice.all()[range.clone()];
            let number = |i: usize| base + (range.start + i) as u32;
            for (i, run) in row.iter().enumerate() {
                if at_end || z == 0 || z == rows - 1 || run.start == 0 || run.end == width {
                    unite(parents, number(i), 0);
                }
            }
            if z > 0 {
                let before = slice.row_range(z - 1);
                overlaps(row, &slice.all()[before.clone()], |i, j| {
                    unite(parents, number(i), base + (before.start + j) as u32);
                });
            }
            if y > 0 {
                let below = self.below.row_range(z);
                let classes = &self.below_classes[below.clone()];
                overlaps(row, &self.below.all()[below], |i, j| unite(parents, number(i), classes[j]));
            }
        }

        // The smaller root wins a union, so whatever joined class 0, the exterior, has root 0.
        let mut names = vec![ENDED; (base + runs) as usize];
        names[0] = 0;
        let mut count = 1;
        self.below_classes.clear();
        for run in base..base + runs {
            let root = find(parents, run) as usize;
            if names[root] == ENDED {
                names[root] = count;
                count += 1;
            }
            self.below_classes.push(names[root]);
        }
        if y > 0 {
            let became: Vec<u32> = (0..base).map(|class| names[find(parents, class) as usize]).collect();
            self.became.append(&became)?;
        }
        self.free.append(&slice)?;
        self.classes.append(&self.below_classes)?;
        self.below_count = count as usize;
        self.below = slice;
        Ok(())
    }

    /// The downward half.
    fn resolve(self, context: &Context) -> Result<Exterior> {
        let mut exterior = Lists::new(&context.workspace, context.memory.store_quota);
        let mut above: Vec<u32> = (0..self.below_count).map(|class| u32::from(class == 0)).collect();
        exterior.append(&above)?;
        let mut became = Vec::new();
        for y in (0..self.free.slice_count() - 1).rev() {
            self.became.read(y, &mut became)?;
            let here: Vec<u32> = became.iter().map(|&c| if c == ENDED { 0 } else { above[c as usize] }).collect();
            exterior.append(&here)?;
            above = here;
        }
        Ok(Exterior { padded: self.padded, free: self.free, classes: self.classes, exterior: exterior.reversed() })
    }
}
