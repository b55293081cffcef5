//! Solid: the exterior grown back by the ball, never into an occupied cell; the rest, enclosed voids included, is solid.
//!
//! Dilation, connected exterior and growing back together are a morphological closing decided by connectivity: a ball of
//! radius ρ rolls outside, holes narrower than 2ρ are bridged, and the surface lies against the points again. Where the ball has fallen
//! ([`crate::stage::sides`]), what is outside is grown back by one cell instead, and what is inside stays.

use crate::context::{Context, chunks};
use crate::error::Result;
use crate::grid::Cell;
use crate::slice::{Bits, Runs, SliceStore, words_for};
use crate::stage::dilate::Ball;
use crate::stage::exterior::{Exterior, Padded, Scratch, invert};
use crate::stage::raster::Occupancy;
use crate::stage::sides::Sides;
use crate::window::Window;

/// The solid cells of a cloud, slice by slice, in the box.
#[derive(Debug)]
pub struct Solid {
    /// Cells along x, slices, rows.
    pub cells: Cell,
    /// The slices.
    pub store: SliceStore,
    /// Number of solid cells.
    pub volume: u64,
    /// Of each slice: the faces that the slice owns (on its lower plane and within it).
    pub faces: Vec<u32>,
}

struct Chunk {
    slices: Vec<Runs>,
    faces: Vec<u32>,
}

/// Which free cells are grown back.
#[derive(Debug, Clone, Copy)]
enum Grown<'a> {
    /// The exterior ones: what is left is the solid.
    Exterior(&'a Exterior),
    /// All: what is left is the shell, the closing of the occupied cells without regard to inside and outside.
    Free(&'a Exterior),
    /// Those outside, never into those inside.
    Outside(&'a Sides),
}

impl Grown<'_> {
    fn padded(&self) -> Padded {
        match self {
            Grown::Exterior(exterior) | Grown::Free(exterior) => exterior.padded,
            Grown::Outside(sides) => sides.padded,
        }
    }
}

impl Solid {
    /// Closes the occupied cells with `ball`.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn close(occupancy: &Occupancy, ball: &Ball, context: &Context) -> Result<Solid> {
        let exterior = Exterior::find(occupancy, ball, context)?;
        Solid::grown(occupancy, Grown::Exterior(&exterior), ball, context)
    }

    /// The solid between the two sides: the outside cells grown back by one cell, neither into an occupied cell nor into an inside
    /// one; the rest is solid.
    ///
    /// # Errors
    /// As [`Solid::close`].
    pub fn between(occupancy: &Occupancy, sides: &Sides, context: &Context) -> Result<Solid> {
        Solid::grown(occupancy, Grown::Outside(sides), &Ball::new(1), context)
    }

    /// Closes the occupied cells with `ball`, and tells how much of the shell encloses something: the faces that the shell
    /// turns to enclosed cells, for each face that it turns to the exterior.
    ///
    /// ```text
    ///     leaking: 0            sealed: 1, less the thicker the shell is against the body
    ///     +--------+            +--------+
    ///     |+------+|            |+------+|
    ///     ||      ||            ||//////||
    ///     +|      |+            |+------+|
    ///                           +--------+
    /// ```
    ///
    /// # Errors
    /// As [`Solid::close`].
    pub fn close_measured(occupancy: &Occupancy, ball: &Ball, context: &Context) -> Result<(Solid, f64)> {
        let exterior = Exterior::find(occupancy, ball, context)?;
        let solid = Solid::grown(occupancy, Grown::Exterior(&exterior), ball, context)?;
        let shell = Solid::grown(occupancy, Grown::Free(&exterior), ball, context)?;
        let (outer, all) = (solid.face_count() as f64, shell.face_count() as f64);
        Ok((solid, (all - outer) / outer))
    }

    fn grown(occupancy: &Occupancy, grown: Grown<'_>, ball: &Ball, context: &Context) -> Result<Solid> {
        let cells = occupancy.cells;
        let mut solid = Solid {
            cells,
            store: SliceStore::new(&context.workspace, context.memory.store_quota),
            volume: 0,
            faces: Vec::with_capacity(cells[1] as usize),
        };
        let mut jobs = chunks(cells[1]);
        context.workers.in_order(
            context.memory.chunks_for(&context.load, ball.radius()),
            || Ok(jobs.next()),
            |chunk| solid_slices(occupancy, grown, ball, chunk),
            |chunk| {
                for slice in &chunk.slices {
                    solid.volume += slice.cell_count();
                    solid.store.append(slice)?;
                }
                solid.faces.extend(chunk.faces);
                Ok(())
            },
        )?;
        Ok(solid)
    }

    fn face_count(&self) -> u64 {
        self.faces.iter().map(|faces| u64::from(*faces)).sum()
    }

    /// Sets the solid cells of slice `y` in `bits`, moved by one cell and one row; none where there is no such slice.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn paint(&self, y: i64, bits: &mut Bits, runs: &mut Runs) -> Result<()> {
        bits.clear();
        if (0..i64::from(self.cells[1])).contains(&y) {
            self.store.read(y as u32, runs)?;
            bits.paint(runs, 1, 1);
        }
        Ok(())
    }
}

/// The cells of a chunk of slices that are left, with the number of faces of each slice.
fn solid_slices(occupancy: &Occupancy, grown: Grown<'_>, ball: &Ball, chunk: std::ops::Range<u32>) -> Result<Chunk> {
    let Padded { pad, cells: [width, _, rows] } = grown.padded();
    let [box_width, _, box_rows] = occupancy.cells;
    let radius = i64::from(ball.radius());
    let mut window = Window::new(2 * ball.radius() as usize + 1, || Bits::new(width, rows));
    // Cells that are not grown into.
    let (mut kept, mut runs) = (Bits::new(width, rows), Runs::default());
    let (mut acc, mut scratch) = (vec![0; words_for(width)], Scratch::default());
    let mut below = vec![0; words_for(width) * box_rows as usize];
    let mut out = Chunk { slices: Vec::with_capacity(chunk.len()), faces: Vec::with_capacity(chunk.len()) };
    // The slice before the chunk is computed for its faces with the chunk's first slice.
    for y in chunk.start.saturating_sub(1)..chunk.end {
        let padded_y = i64::from(y + pad);
        window.slide_to(padded_y - radius, |y, bits| {
            bits.clear();
            match grown {
                Grown::Exterior(exterior) => exterior.paint(y as u32, bits, &mut scratch),
                Grown::Free(exterior) => exterior.paint_free(y as u32, bits, &mut scratch),
                Grown::Outside(sides) => sides.outside().paint(y, bits, &mut runs),
            }
        })?;
        kept.clear();
        if let Grown::Outside(sides) = grown {
            sides.inside().paint(padded_y, &mut kept, &mut runs)?;
        }
        occupancy.store.read(y, &mut runs)?;
        kept.paint(&runs, pad, pad);

        let (mut slice, mut faces) = (Runs::default(), 0);
        for z in 0..box_rows {
            let row =
                |dy: i32, dz: i32| window.get(padded_y + i64::from(dy)).lit_row((z + pad).wrapping_add_signed(dz));
            ball.dilate_row(row, &mut acc);
            invert(&mut acc, width);
            if let Some(words) = kept.lit_row(z + pad) {
                acc.iter_mut().zip(words).for_each(|(a, w)| *a |= w);
            }
            // Nothing outside the box is solid: outside it every cell is in the ball of an exterior one.
            push_shifted(&mut slice, &acc, pad, box_width);
            let (before, below) = below.split_at_mut(z as usize * acc.len());
            let row_before = before.rchunks_exact(acc.len()).next();
            faces += faces_of_row(&acc, row_before, &below[..acc.len()], z == box_rows - 1);
            below[..acc.len()].copy_from_slice(&acc);
        }
        if y >= chunk.start {
            // The lower plane of slice 0 has every solid cell's face, and `below` was empty then: counted alike.
            out.slices.push(slice);
            out.faces.push(faces);
        }
    }
    Ok(out)
}

/// Appends the runs of a padded row, moved back into the box.
fn push_shifted(out: &mut Runs, words: &[u64], pad: u32, width: u32) {
    for (i, &word) in words.iter().enumerate() {
        let (mut word, base) = (word, i as u32 * 64);
        while word != 0 {
            let start = word.trailing_zeros();
            let length = (!(word >> start)).trailing_zeros();
            let first = (base + start).saturating_sub(pad);
            let end = (base + start + length).saturating_sub(pad).min(width);
            debug_assert!(base + start >= pad && base + start + length <= pad + width, "solid outside the box");
            if first < end {
                out.push_run(first, end);
            }
            word &= u64::MAX.checked_shl(start + length).unwrap_or(0);
        }
    }
    out.end_row();
}

/// Faces of a row with its own cells, the row before it (none for the first) and the row below; the last row also has faces with the
/// empty row after it.
fn faces_of_row(row: &[u64], before: Option<&[u64]>, below: &[u64], last: bool) -> u32 {
    let mut faces = 0;
    let mut carry = 0;
    for (i, &word) in row.iter().enumerate() {
        faces += (word ^ (word << 1 | carry)).count_ones();
        carry = word >> 63;
        faces += (word ^ below[i]).count_ones();
        faces += (word ^ before.map_or(0, |b| b[i])).count_ones();
        if last {
            faces += word.count_ones();
        }
    }
    faces + carry as u32
}
