//! Exterior: the free cells that a path of free cells joins to the border of the padded box.
//!
//! The runs of free cells are labelled slice by slice ([`crate::stage::label`]); a component that touches the border is exterior, any other
//! is enclosed.

use bytemuck::{Pod, Zeroable};

use crate::context::{Context, chunks};
use crate::error::Result;
use crate::grid::Cell;
use crate::slice::{Bits, Runs, clip, words_for};
use crate::stage::dilate::Ball;
pub use crate::stage::label::Scratch;
use crate::stage::label::{Labeller, Labels, Measure};
use crate::stage::raster::Occupancy;
use crate::window::Window;

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

    /// Sets the occupied cells of padded slice `y` in `bits`, which is cleared first; slices outside the box have none.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint_occupied(&self, occupancy: &Occupancy, y: i64, bits: &mut Bits, runs: &mut Runs) -> Result<()> {
        bits.clear();
        let y = y - i64::from(self.pad);
        if (0..i64::from(occupancy.cells[1])).contains(&y) {
            occupancy.store.read(y as u32, runs)?;
            bits.paint(runs, self.pad, self.pad);
        }
        Ok(())
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
        let [width, slices, rows] = padded.cells;
        let mut labeller = Labeller::new(context);
        let mut jobs = chunks(slices);
        let (mut y, mut at_border) = (0, Vec::new());
        context.workers.in_order(
            context.memory.chunks_for(&context.load, ball.radius()),
            || Ok(jobs.next()),
            |chunk| free_slices(occupancy, ball, padded, chunk),
            |free: Vec<Runs>| {
                for slice in free {
                    let at_end = y == 0 || y == slices - 1;
                    at_border.clear();
                    for z in 0..rows {
                        let at_end = at_end || z == 0 || z == rows - 1;
                        let touches = slice.row(z).iter().map(|run| at_end || run.start == 0 || run.end == width);
                        at_border.extend(touches.map(|touches| AtBorder(u8::from(touches))));
                    }
                    labeller.add(slice, &at_border)?;
                    y += 1;
                }
                Ok(())
            },
        )?;
        Ok(Exterior { padded, labels: labeller.finish()?.judged(context, AtBorder::verdict)? })
    }

    /// Sets the free cells of padded slice `y`, exterior or enclosed, in `bits`, which must be empty.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint_free(&self, y: u32, bits: &mut Bits, scratch: &mut Scratch) -> Result<()> {
        self.labels.paint_all(y, bits, scratch)
    }

    /// Sets the exterior cells of padded slice `y` in `bits`, which must be empty. `scratch` is overwritten.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint(&self, y: u32, bits: &mut Bits, scratch: &mut Scratch) -> Result<()> {
        self.labels.paint(y, EXTERIOR, bits, scratch)
    }

    /// Sets the free cells of padded slice `y` that are not exterior in `bits`, which must be empty.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint_enclosed(&self, y: u32, bits: &mut Bits, scratch: &mut Scratch) -> Result<()> {
        self.labels.paint(y, ENCLOSED, bits, scratch)
    }
}

/// The free cells of a chunk of padded slices.
fn free_slices(occupancy: &Occupancy, ball: &Ball, padded: Padded, chunk: std::ops::Range<u32>) -> Result<Vec<Runs>> {
    let [width, _, rows] = padded.cells;
    let radius = i64::from(ball.radius());
    let mut window = Window::new(2 * ball.radius() as usize + 1, || padded.bits());
    let (mut runs, mut acc) = (Runs::default(), vec![0; words_for(width)]);
    let mut out = Vec::with_capacity(chunk.len());
    for y in chunk.map(i64::from) {
        window.slide_to(y - radius, |y, bits| padded.paint_occupied(occupancy, y, bits, &mut runs))?;
        let mut free = Runs::default();
        for z in 0..rows {
            if ball.dilate_row(near(&window, y, z), &mut acc) {
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

/// The rows of a window round row `z` of slice `y`, by their offset, for [`Ball::dilate_row`].
pub fn near<'a>(window: &'a Window<Bits>, y: i64, z: u32) -> impl Fn(i32, i32) -> Option<&'a [u64]> {
    move |dy, dz| {
        let slice = window.get(y + i64::from(dy));
        let z = i64::from(z) + i64::from(dz);
        if (0..i64::from(slice.row_count())).contains(&z) { slice.lit_row(z as u32) } else { None }
    }
}

/// Complements the first `width` cells of a row; the rest of its last word stays clear.
pub fn invert(words: &mut [u64], width: u32) {
    for word in words.iter_mut() {
        *word = !*word;
    }
    clip(words, width);
}
