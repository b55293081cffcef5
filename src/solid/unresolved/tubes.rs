//! Tubes: cells that are not solid and that no empty plate of 3 x 3 x 1 cells covers, whichever way the plate lies.
//!
//! A slot between two walls holds plates, however narrow it is; a tube of one or two cells across holds none:
//!
//! ```text
//!   # # # # # # #      # # # # # # #
//!   . . . . . . .      # # . # # # #     Left a slot, seen from its side: plates of three cells lie in it along and across the drawing.
//!   # # # # # # #      # # # # # # #     Right a tube, seen along its axis: nothing three cells wide lies in it.
//! ```
//!
//! Where a body rests on a floor, single samples reach from one to the other, and the slot that is left between them is a net of tubes.
//!
//! *Struts* are the same of solid cells: those that no plate of solid cells covers. A fin of one cell's width holds plates, a rod of two holds none.

use crate::error::Result;
use crate::grid::slice::{Bits, Runs, clip};
use crate::grid::window::Window;
use crate::solid::exterior::Padded;
use crate::solid::{Solid, move_back};

/// Finds the tubes, or the struts, of a solid's slices, from the lowest to the highest.
pub(super) struct Tubes<'a> {
    solid: &'a Solid,
    /// Whether it is struts that are looked for.
    struts: bool,
    padded: Padded,
    /// The cells of a slice that plates must not have: as they are, and widened by one cell along x, and along the rows.
    widened: Window<[Bits; 3]>,
    /// The middles of a slice's empty plates that stand up, along x and along the rows; each widened by one cell along its plate's side.
    upright: Window<[Bits; 2]>,
    runs: Runs,
}

impl<'a> Tubes<'a> {
    pub(super) fn new(solid: &'a Solid, struts: bool) -> Tubes<'a> {
        let padded = Padded::new(solid.cells, 1);
        let widened = Window::new(5, || [(); 3].map(|()| padded.bits()));
        let upright = Window::new(3, || [(); 2].map(|()| padded.bits()));
        Tubes { solid, struts, padded, widened, upright, runs: Runs::default() }
    }

    /// Sets the cells of slice `y` that lie in tubes, or in struts, in `bits`, which hold none. `y` must grow.
    pub(super) fn paint(&mut self, y: i64, bits: &mut Bits) -> Result<()> {
        let Tubes { solid, struts, padded, widened, upright, runs } = self;
        let pad = padded.pad;
        let [mut sum, mut middles] = [padded.bits(), padded.bits()];
        upright.slide_to(y - 1, |y, plates| {
            widened.slide_to(y - 1, |y, [slice, along, across]| {
                solid.store.paint_moved(y, pad, slice, runs)?;
                if *struts {
                    slice.complement();
                }
                widen(slice, along);
                widen_rows(slice, across);
                Ok(())
            })?;
            for (plate, axis) in plates.iter_mut().zip([1, 2]) {
                middles.clear();
                (y - 1..=y + 1).for_each(|y| or(&mut middles, &widened.get(y)[axis]));
                middles.complement();
                if axis == 1 { widen(&middles, plate) } else { widen_rows(&middles, plate) }
            }
            Ok(())
        })?;
        // What plates cover: those that lie in the slice, and those that stand on any of the three slices.
        let [slice, along, _] = widened.get(y);
        widen_rows(along, &mut middles);
        middles.complement();
        widen(&middles, &mut sum);
        widen_rows(&sum, &mut middles);
        (y - 1..=y + 1).for_each(|y| upright.get(y).iter().for_each(|plate| or(&mut middles, plate)));
        or(&mut middles, slice);
        for z in 0..solid.cells[2] {
            let row = bits.row_mut(z);
            move_back(middles.row(z + pad), pad, row);
            row.iter_mut().for_each(|word| *word = !*word);
            clip(row, solid.cells[0]);
        }
        Ok(())
    }
}

// Slices are narrow: their words are worked on as one row.

/// The cells of `bits` and the next ones along x.
fn widen(bits: &Bits, out: &mut Bits) {
    let words = lit_words(out);
    let (from, last) = (bits.words(), words.len() - 1);
    let word = |before: u64, word: u64, after: u64| word | word << 1 | word >> 1 | before >> 63 | after << 63;
    words[0] = word(0, from[0], if last > 0 { from[1] } else { 0 });
    for (out, near) in words[1..].iter_mut().zip(from.windows(3)) {
        *out = word(near[0], near[1], near[2]);
    }
    if last > 0 {
        words[last] = word(from[last - 1], from[last], 0);
    }
    // The bit behind a row's last cell is none, and so no row reaches the next one's first cell.
    out.clip_rows();
}

/// The cells of `bits` and those of the rows before and after.
fn widen_rows(bits: &Bits, out: &mut Bits) {
    let (from, row) = (bits.words(), bits.row_words());
    let words = lit_words(out);
    words.copy_from_slice(from);
    words.iter_mut().zip(&from[row..]).for_each(|(out, after)| *out |= after);
    words[row..].iter_mut().zip(from).for_each(|(out, before)| *out |= before);
}

fn or(bits: &mut Bits, other: &Bits) {
    lit_words(bits).iter_mut().zip(other.words()).for_each(|(bits, other)| *bits |= other);
}

/// All words, to write to.
fn lit_words(bits: &mut Bits) -> &mut [u64] {
    bits.light(0..bits.row_count() as usize);
    bits.words_mut()
}
