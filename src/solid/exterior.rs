//! Exterior: the free cells that a path of free cells joins to the border of the padded box.
//!
//! The runs of free cells are labelled slice by slice ([`crate::grid::label`]); a component that touches the border is exterior, any other
//! is enclosed.

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::grid::Cell;
use crate::grid::context::{Context, chunks};
use crate::grid::dilate::{Ball, Dilation};
pub use crate::grid::label::Scratch;
use crate::grid::label::{Labeller, Labels, Measure, Parts};
use crate::grid::occupancy::Occupancy;
use crate::grid::slice::{Bits, Runs, clip};

/// The verdicts on components of free cells.
const ENCLOSED: u8 = 0;
const EXTERIOR: u8 = 1;

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

    /// Empty bits of one slice.
    pub fn bits(&self) -> Bits {
        Bits::new(self.cells[0], self.cells[2])
    }

    /// A dilation by `ball` of its slices below slice `end`.
    pub fn dilation(&self, ball: Ball, end: u32) -> Dilation {
        Dilation::new(ball, self.cells[0], self.cells[2], i64::from(end))
    }

    /// Sets the occupied cells of padded slice `y` in `bits`, which is cleared first; slices outside the box have none.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint_occupied(&self, occupancy: &Occupancy, y: i64, bits: &mut Bits, runs: &mut Runs) -> Result<()> {
        occupancy.store.paint_moved(y - i64::from(self.pad), self.pad, bits, runs)
    }
}

/// The exterior of a cloud, slice by slice, in the padded box.
#[derive(Debug)]
pub struct Exterior {
    /// The box.
    pub padded: Padded,
    labels: Labels,
}

/// Whether a run or a component touches the border of the padded box: 1 if so.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(transparent)]
struct AtBorder(u8);

impl Measure for AtBorder {
    fn add(&mut self, other: &AtBorder) {
        self.0 |= other.0;
    }
}

impl AtBorder {
    fn verdict(&self) -> u8 {
        if self.0 == 1 { EXTERIOR } else { ENCLOSED }
    }
}

impl Exterior {
    /// Finds the cells from which a path of cells free of the ball leads to the border.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn find(occupancy: &Occupancy, ball: &Ball, context: &Context) -> Result<Exterior> {
        let padded = Padded::new(occupancy.cells, ball.radius());
        let mut labeller = Labeller::new(context);
        let mut jobs = chunks(padded.cells[1]);
        context.workers.in_order(
            context.jobs(ball.radius(), occupancy.cells),
            || Ok(jobs.next()),
            |chunk| free_parts(occupancy, ball, padded, chunk),
            |parts: Parts<AtBorder>| labeller.add(parts),
        )?;
        let labels = labeller.finish()?.judged(context, |at_border| at_border.verdict())?;
        Ok(Exterior { padded, labels })
    }

    /// Sets the exterior cells of padded slice `y` in `bits`, which is cleared first. `scratch` is overwritten.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint(&self, y: u32, bits: &mut Bits, scratch: &mut Scratch) -> Result<()> {
        bits.clear();
        self.labels.paint(y, EXTERIOR, bits, scratch)
    }

    /// Sets the free cells of padded slice `y` that are not exterior in `bits`, which is cleared first.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint_enclosed(&self, y: u32, bits: &mut Bits, scratch: &mut Scratch) -> Result<()> {
        bits.clear();
        self.labels.paint(y, ENCLOSED, bits, scratch)
    }
}

/// The free cells of a chunk of padded slices, as far as they hang together there.
fn free_parts(
    occupancy: &Occupancy,
    ball: &Ball,
    padded: Padded,
    chunk: std::ops::Range<u32>,
) -> Result<Parts<AtBorder>> {
    let [width, slices, rows] = padded.cells;
    let (mut dilation, mut runs) = (padded.dilation(*ball, chunk.end), Runs::default());
    let mut free = Vec::with_capacity(chunk.len());
    for y in chunk.clone().map(i64::from) {
        let taken = dilation.slide_to(y, |y, bits| padded.paint_occupied(occupancy, y, bits, &mut runs))?;
        let mut slice = Runs::default();
        for z in 0..rows {
            if taken.lit_row(z).is_some() {
                let row = taken.row_mut(z);
                invert(row, width);
                slice.push_row(row);
            } else {
                slice.push_run(0, width);
                slice.end_row();
            }
        }
        free.push(slice);
    }
    Ok(Parts::of(free, |y, z, run| {
        let y = chunk.start + y as u32;
        let at_end = y == 0 || y == slices - 1 || z == 0 || z == rows - 1;
        AtBorder(u8::from(at_end || run.start == 0 || run.end == width))
    }))
}

/// Complements the first `width` cells of a row; the rest of its last word stays clear.
pub fn invert(words: &mut [u64], width: u32) {
    for word in words.iter_mut() {
        *word = !*word;
    }
    clip(words, width);
}
