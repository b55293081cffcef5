//! Solid: the exterior grown back by the ball, never into an occupied cell; the rest, enclosed voids included, is solid.
//!
//! Dilation, connected exterior and growing back together are a morphological closing decided by connectivity: a ball of
//! radius ρ rolls outside, holes narrower than 2ρ are bridged, and the surface lies against the points again. Where the ball has fallen
//! ([`self::watershed`]), what is outside is grown back by one cell instead, and what is inside stays.

mod bare;
pub mod cavities;
mod change;
mod characteristic;
pub mod close;
pub mod component;
pub mod dents;
pub mod exterior;
mod growth;
pub mod heightfield;
pub mod isolated;
pub(crate) mod level;
pub mod membranes;
pub mod parted;
pub mod prongs;
pub mod reopen;
pub mod seal;
pub mod side_votes;
pub mod sign;
mod simple;
pub mod thicken;
pub mod unresolved;
pub mod watershed;
pub mod winding;

use serde::{Deserialize, Serialize};

use self::exterior::{Exterior, Padded, Scratch};
use self::heightfield::columns::{HeightField, SavedHeightField};
use self::watershed::Sides;
use crate::error::Result;
use crate::grid::Cell;
use crate::grid::context::{Context, chunks};
use crate::grid::dilate::Ball;
use crate::grid::occupancy::Occupancy;
use crate::grid::slice::{Bits, Runs, SliceStore, Slices, clip, words_for};
use crate::storage::work::sections::{SectionReader, SectionWriter};

/// The solid cells of a cloud, slice by slice, in the box.
#[derive(Debug)]
pub struct Solid {
    /// Cells along x, slices, rows.
    pub cells: Cell,
    /// The slices.
    pub store: SliceStore,
    /// Number of solid cells.
    pub volume: u64,
    /// The number of faces that each slice owns: those on its lower plane and those within it.
    pub faces: Vec<u32>,
    /// The columns, if it is the ground below a surface that is not closed.
    pub ground: Option<HeightField>,
}

/// What is kept of a saved solid beside its slices.
#[derive(Debug, Serialize, Deserialize)]
pub struct SavedSolid {
    cells: Cell,
    volume: u64,
    ground: Option<SavedHeightField>,
}

struct Chunk {
    slices: Slices,
    volume: u64,
    faces: Vec<u32>,
}

/// Which free cells are grown back.
#[derive(Debug, Clone, Copy)]
enum Grown<'a> {
    /// The exterior ones: what is left is the solid.
    Exterior(&'a Exterior),
    /// Those outside, never into those inside.
    Outside(&'a Sides),
}

impl Grown<'_> {
    fn padded(&self) -> Padded {
        match self {
            Grown::Exterior(exterior) => exterior.padded,
            Grown::Outside(sides) => sides.padded,
        }
    }
}

impl Solid {
    /// Saves the solid.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(&self, out: &mut SectionWriter<'_>) -> Result<SavedSolid> {
        self.store.save(out)?;
        out.values(&self.faces)?;
        let ground = self.ground.as_ref().map(|ground| ground.save(out)).transpose()?;
        Ok(SavedSolid { cells: self.cells, volume: self.volume, ground })
    }

    /// Reads what [`Solid::save`] saved.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`], [`crate::Error::Io`].
    pub fn load(saved: &SavedSolid, sections: &mut SectionReader<'_>, context: &Context) -> Result<Solid> {
        let store = SliceStore::load(sections, &context.workspace, context.memory.store_quota)?;
        let faces = sections.values()?;
        let ground = saved.ground.as_ref().map(|ground| HeightField::load(ground, sections, context)).transpose()?;
        Ok(Solid { cells: saved.cells, store, volume: saved.volume, faces, ground })
    }

    /// Closes the occupied cells with `ball`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn close(occupancy: &Occupancy, ball: &Ball, context: &Context) -> Result<Solid> {
        let exterior = Exterior::find(occupancy, ball, context)?;
        Solid::outside_of(&exterior, occupancy, ball, context)
    }

    /// The cells that are left when the exterior, which was found with `ball`, is grown back.
    ///
    /// # Errors
    /// The same as [`Solid::close`].
    pub fn outside_of(exterior: &Exterior, occupancy: &Occupancy, ball: &Ball, context: &Context) -> Result<Solid> {
        Solid::grown(occupancy, Grown::Exterior(exterior), ball, context)
    }

    /// The solid between the two sides: the outside cells grown back by `ball`, neither into an occupied cell nor into an inside
    /// one; the rest is solid.
    ///
    /// # Errors
    /// The same as [`Solid::close`].
    pub fn between(occupancy: &Occupancy, sides: &Sides, ball: &Ball, context: &Context) -> Result<Solid> {
        Solid::grown(occupancy, Grown::Outside(sides), ball, context)
    }

    fn grown(occupancy: &Occupancy, grown: Grown<'_>, ball: &Ball, context: &Context) -> Result<Solid> {
        let cells = occupancy.cells;
        let mut solid = Solid {
            cells,
            store: SliceStore::new(&context.workspace, context.memory.store_quota),
            volume: 0,
            faces: Vec::with_capacity(cells[1] as usize),
            ground: None,
        };
        let mut jobs = chunks(cells[1]);
        context.workers.in_order(
            context.jobs(ball.radius(), cells),
            || Ok(jobs.next()),
            |chunk| solid_slices(occupancy, grown, ball, chunk),
            |chunk| {
                solid.volume += chunk.volume;
                solid.faces.extend(chunk.faces);
                solid.store.extend(&chunk.slices)
            },
        )?;
        Ok(solid)
    }

    /// Sets the solid cells of slice `y` in `bits`, moved by one cell and one row; none where there is no such slice.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint(&self, y: i64, bits: &mut Bits, runs: &mut Runs) -> Result<()> {
        self.store.paint_moved(y, 1, bits, runs)
    }
}

/// The cells of a chunk of slices that are left, with the number of faces of each slice.
fn solid_slices(occupancy: &Occupancy, grown: Grown<'_>, ball: &Ball, chunk: std::ops::Range<u32>) -> Result<Chunk> {
    let padded = grown.padded();
    let Padded { pad, .. } = padded;
    let [width, _, rows] = occupancy.cells;
    let mut dilation = padded.dilation(*ball, chunk.end + pad);
    let (mut runs, mut scratch) = (Runs::default(), Scratch::default());
    let (mut occupied, mut inside) = (Bits::new(width, rows), padded.bits());
    let (mut slice, mut below) = (Bits::new(width, rows), Bits::new(width, rows));
    let mut moved = vec![0; words_for(width)];
    let mut out = Chunk { slices: Slices::default(), volume: 0, faces: Vec::new() };
    // The slice before the chunk is computed for its faces with the chunk's first slice. Slice 0 has none before it: its lower plane has
    // every solid cell's face.
    let before = chunk.start.min(1);
    for y in chunk.start - before..chunk.end {
        let padded_y = i64::from(y + pad);
        let taken = dilation.slide_to(padded_y, |y, bits| match grown {
            Grown::Exterior(exterior) => exterior.paint(y as u32, bits, &mut scratch),
            Grown::Outside(sides) => sides.outside().paint(y, bits, &mut runs),
        })?;
        occupancy.store.paint(i64::from(y), &mut occupied, &mut runs)?;
        if let Grown::Outside(sides) = grown {
            sides.inside().paint(padded_y, &mut inside, &mut runs)?;
        }
        slice.clear();
        for z in 0..rows {
            // Nothing outside the box is solid: outside it every cell is in the ball of an exterior one.
            let row = slice.row_mut(z);
            move_back(taken.row(z + pad), pad, row);
            row.iter_mut().for_each(|word| *word = !*word);
            if let Some(inside) = inside.lit_row(z + pad) {
                move_back(inside, pad, &mut moved);
                row.iter_mut().zip(&moved).for_each(|(a, w)| *a |= w);
            }
            clip(row, width);
            if let Some(occupied) = occupied.lit_row(z) {
                row.iter_mut().zip(occupied).for_each(|(a, w)| *a |= w);
            }
        }
        if y >= chunk.start {
            out.volume += slice.cell_count();
            out.faces.push(faces(&slice, &below));
            out.slices.push(&slice);
        }
        std::mem::swap(&mut slice, &mut below);
    }
    Ok(out)
}

/// Writes to `out` what a row holds from cell `by` on; the row has `2 * by` cells more.
pub(super) fn move_back(row: &[u64], by: u32, out: &mut [u64]) {
    let (row, bits) = (&row[by as usize / 64..], by % 64);
    // The last words have none after them, or one that the row may lack.
    let pairs = out.len().min(row.len() - 1);
    let (low, high) = (&row[..pairs], &row[1..=pairs]);
    for i in 0..pairs {
        out[i] = low[i] >> bits | high[i] << 1 << (63 - bits);
    }
    if pairs < out.len() {
        out[pairs] = row[pairs] >> bits;
    }
}

/// Faces of a slice on its lower plane and within it.
pub(super) fn faces(slice: &Bits, below: &Bits) -> u32 {
    let empty = vec![0; slice.row_words()];
    let mut before = empty.as_slice();
    let mut faces = 0;
    for z in 0..slice.row_count() {
        let mut carry = 0;
        for ((&word, &before), &below) in slice.row(z).iter().zip(before).zip(below.row(z)) {
            let across = [word ^ (word << 1 | carry), word ^ below, word ^ before];
            // The bit behind the row's last cell counts that cell's face.
            carry = word >> 63;
            if across != [0; 3] {
                faces += across.iter().map(|word| word.count_ones()).sum::<u32>();
            }
        }
        before = slice.row(z);
    }
    // The last row's faces with the empty row after it.
    faces + before.iter().map(|word| word.count_ones()).sum::<u32>()
}
