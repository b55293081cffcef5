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
use crate::solid::exterior::{Padded, invert};
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
        let Padded { pad, cells } = *padded;
        let [mut sum, mut middles] = [padded.bits(), padded.bits()];
        upright.slide_to(y - 1, |y, plates| {
            widened.slide_to(y - 1, |y, [slice, along, across]| {
                solid.store.paint_moved(y, pad, slice, runs)?;
                if *struts {
                    complement(slice, cells[0]);
                }
                widen(slice, along);
                widen_rows(slice, across);
                Ok(())
            })?;
            for (plate, axis) in plates.iter_mut().zip([1, 2]) {
                middles.clear();
                (y - 1..=y + 1).for_each(|y| or(&mut middles, &widened.get(y)[axis]));
                complement(&mut middles, cells[0]);
                if axis == 1 { widen(&middles, plate) } else { widen_rows(&middles, plate) }
            }
            Ok(())
        })?;
        // What plates cover: those that lie in the slice, and those that stand on any of the three slices.
        let [slice, along, _] = widened.get(y);
        widen_rows(along, &mut middles);
        complement(&mut middles, cells[0]);
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

/// The cells of `bits` and the next ones along x.
fn widen(bits: &Bits, out: &mut Bits) {
    out.clear();
    for z in (0..bits.row_count()).filter(|z| bits.lit_row(*z).is_some()) {
        let (row, out) = (bits.row(z), out.row_mut(z));
        for i in 0..row.len() {
            let before = if i > 0 { row[i - 1] } else { 0 };
            let after = row.get(i + 1).copied().unwrap_or(0);
            out[i] = row[i] | row[i] << 1 | row[i] >> 1 | before >> 63 | after << 63;
        }
        clip(out, bits.width());
    }
}

/// The cells of `bits` and those of the rows before and after.
fn widen_rows(bits: &Bits, out: &mut Bits) {
    out.clear();
    for z in 0..bits.row_count() {
        for near in z.saturating_sub(1)..(z + 2).min(bits.row_count()) {
            if let Some(row) = bits.lit_row(near) {
                out.row_mut(z).iter_mut().zip(row).for_each(|(out, row)| *out |= row);
            }
        }
    }
}

fn or(bits: &mut Bits, other: &Bits) {
    for z in 0..bits.row_count() {
        if let Some(row) = other.lit_row(z) {
            bits.row_mut(z).iter_mut().zip(row).for_each(|(bits, other)| *bits |= other);
        }
    }
}

fn complement(bits: &mut Bits, width: u32) {
    for z in 0..bits.row_count() {
        invert(bits.row_mut(z), width);
    }
}
