//! Walls: what stands between a component of free cells and the sides, and so which side it is on.
//!
//! ```text
//!   # # #        # occupied, o outside, i inside, c a cell of the component
//!   o # c c      the left wall has the outside behind it: it speaks for the inside
//!   o # c c
//!   o # # #      a wall is an occupied cell that touches a cell next to a side
//! ```
//!
//! Sheets have the outside on both sides: what lies behind them says nothing of what lies before them.

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::grid::context::{Context, chunks};
use crate::grid::dilate::{Ball, Dilation};
use crate::grid::label::{Labeller, Labels, Measure, Parts};
use crate::grid::occupancy::Occupancy;
use crate::grid::slice::{Bits, Run, Runs, SliceStore, words_of};
use crate::grid::window::Window;
use crate::solid::exterior::Padded;
use crate::solid::thicken::Sheets;

/// The verdicts on components.
pub const UNDECIDED: u8 = 0;
/// See [`UNDECIDED`].
pub const OUTSIDE: u8 = 1;
/// See [`UNDECIDED`].
pub const INSIDE: u8 = 2;

/// Cells without a side, and what is known round them; all in the padded box.
#[derive(Debug)]
pub struct Open<'a> {
    /// The box.
    pub padded: Padded,
    /// The occupied cells.
    pub occupancy: &'a Occupancy,
    /// Walls that have the outside on both sides, if any are known.
    pub sheets: Option<Sheets<'a>>,
    /// The cells whose components are judged.
    pub cells: &'a SliceStore,
    /// The cells outside.
    pub outside: &'a SliceStore,
    /// The cells next to the outside, and next to the inside.
    pub next_to: &'a [SliceStore; 2],
    /// Squared radius of the ball that the cells are free for.
    pub squared: u32,
}

impl Open<'_> {
    /// The components, judged by what they touch and by what lies behind their walls.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn judged(&self, context: &Context) -> Result<Labels> {
        // One cell more than the ball that the cells are free for: it reaches the nearest walls, and not those behind a thin part.
        let ball = Ball::squared((self.squared.isqrt() + 1).pow(2));
        let mut labeller = Labeller::new(context);
        let mut jobs = chunks(self.padded.cells[1]);
        context.workers.in_order(
            context.jobs(2 * ball.radius() + 6, self.padded.cells),
            || Ok(jobs.next()),
            |slices| self.parts(ball, slices),
            |parts: Parts<Evidence>| labeller.add(parts),
        )?;
        labeller.finish()?.judged(context, Evidence::verdict)
    }

    /// The parts of some slices, with the evidence of each.
    fn parts(&self, ball: Ball, slices: std::ops::Range<u32>) -> Result<Parts<Evidence>> {
        let padded = self.padded;
        let mut held = Vec::with_capacity(slices.len());
        let mut rows = 0..0;
        for y in slices.clone() {
            let mut runs = Runs::default();
            self.cells.read(y, &mut runs)?;
            for z in (0..runs.row_count()).filter(|z| !runs.row(*z).is_empty()) {
                rows = if rows.is_empty() { z..z + 1 } else { rows.start.min(z)..rows.end.max(z + 1) };
            }
            held.push(runs);
        }
        if rows.is_empty() {
            return Ok(Parts::of(held, |_, _, _| Evidence::default()));
        }
        let mut walls = [(); 2].map(|()| Walls::new(padded, ball, &rows, slices.end));
        let mut touched = Window::new(3, || padded.bits());
        let mut runs = Runs::default();
        let mut found = Vec::new();
        for (y, open) in slices.map(i64::from).zip(&held) {
            if open.all().is_empty() {
                continue;
            }
            touched.slide_to(y - 1, |y, bits| self.outside.paint(y, bits, &mut runs))?;
            let [outside, inside] = &mut walls;
            let outside = outside.near(y, padded, (self.occupancy, self.sheets), &self.next_to[0])?;
            let inside = inside.near(y, padded, (self.occupancy, None), &self.next_to[1])?;
            for z in 0..open.row_count() {
                let (outside, inside) = (outside.row(z), inside.row(z));
                for run in open.row(z) {
                    let mut evidence = Evidence {
                        cells: u64::from(run.end - run.start),
                        touches_outside: u64::from(touches(&touched, y, z, *run)),
                        ..Evidence::default()
                    };
                    for (i, cells) in words_of(run.start, run.end) {
                        evidence.outside_behind += u64::from((outside[i] & !inside[i] & cells).count_ones());
                        evidence.inside_behind += u64::from((inside[i] & !outside[i] & cells).count_ones());
                        evidence.inside_near += u64::from((inside[i] & cells).count_ones());
                    }
                    found.push(evidence);
                }
            }
        }
        let mut found = found.into_iter();
        Ok(Parts::of(held, |_, _, _| found.next().expect("every run has its evidence")))
    }
}

/// What speaks for a component's side.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(C)]
struct Evidence {
    cells: u64,
    /// Its runs that share a face with an outside cell.
    touches_outside: u64,
    /// Its cells near walls that have the outside, and not the inside, on a face.
    outside_behind: u64,
    /// The same with the inside.
    inside_behind: u64,
    /// Its cells near walls that have the inside on a face, whatever else.
    inside_near: u64,
}

impl Measure for Evidence {
    fn add(&mut self, other: &Evidence) {
        self.cells += other.cells;
        self.touches_outside += other.touches_outside;
        self.outside_behind += other.outside_behind;
        self.inside_behind += other.inside_behind;
        self.inside_near += other.inside_near;
    }
}

impl Evidence {
    /// The walls decide, if those of a quarter of the cells speak, and four times as many for one side as for the other: a rim round a hole is not enough.
    /// Else what is cut off from the outside is inside, unless walls round it have the inside behind them: that is a slot, where the ball fits by chance before
    /// the outside gets there. What the outside reaches is outside, too, if hardly a wall speaks: a slot between thin fins, whose side is not known yet.
    fn verdict(&self) -> u8 {
        let decisive = |most: u64, least: u64| 4 * most >= self.cells && 4 * least <= most;
        let (is_outside, cut_off) = (decisive(self.inside_behind, self.outside_behind), self.touches_outside == 0);
        let is_silent = 4 * self.outside_behind < self.cells && 4 * self.inside_near < self.cells;
        if decisive(self.outside_behind, self.inside_behind) || cut_off && 4 * self.inside_near < self.cells {
            INSIDE
        } else if !cut_off && (is_outside || is_silent) {
            OUTSIDE
        } else {
            UNDECIDED
        }
    }
}

/// The cells near the walls of one side, which are occupied cells that touch a cell next to that side.
struct Walls {
    near: Dilation,
    touching: Dilation,
    /// The occupied cells of a slice that lie in sheets.
    of_sheets: Bits,
    /// The rows that are looked at, with those that the balls reach.
    rows: std::ops::Range<u32>,
}

impl Walls {
    /// For the ball round cells in `rows`, in slices below slice `end`.
    fn new(padded: Padded, ball: Ball, rows: &std::ops::Range<u32>, end: u32) -> Walls {
        let rows = rows.start.saturating_sub(ball.radius() + 1)..rows.end + ball.radius() + 1;
        let touching = padded.dilation(Ball::new(1), end + ball.radius());
        Walls { near: padded.dilation(ball, end), touching, of_sheets: padded.bits(), rows }
    }

    /// The cells of slice `y`, but for those near sheets only. Calls must come with growing `y`.
    fn near(
        &mut self,
        y: i64,
        padded: Padded,
        (occupancy, sheets): (&Occupancy, Option<Sheets<'_>>),
        next_to: &SliceStore,
    ) -> Result<&Bits> {
        let (touching, of_sheets) = (&mut self.touching, &mut self.of_sheets);
        let (rows, mut runs) = (&self.rows, Runs::default());
        let near = self.near.slide_to(y, |y, walls| {
            padded.paint_occupied(occupancy, y, walls, &mut runs)?;
            walls.keep_rows(rows.clone());
            if let Some(sheets) = sheets {
                sheets.paint(occupancy, y - i64::from(padded.pad), padded.pad, of_sheets, &mut runs)?;
                walls.and_not(of_sheets);
            }
            walls.and(touching.slide_to(y, |y, bits| {
                next_to.paint(y, bits, &mut runs)?;
                bits.keep_rows(rows.clone());
                Ok(())
            })?);
            Ok(())
        })?;
        Ok(near)
    }
}

/// Whether a run of row `z` shares a face with a cell of the window's slices.
fn touches(window: &Window<Bits>, y: i64, z: u32, run: Run) -> bool {
    let here = window.get(y);
    let any = |slice: &Bits, z: u32| words_of(run.start, run.end).any(|(i, cells)| slice.row(z)[i] & cells != 0);
    here.get(i64::from(run.start) - 1, z.into())
        || here.get(run.end.into(), z.into())
        || z > 0 && any(here, z - 1)
        || z + 1 < here.row_count() && any(here, z + 1)
        || any(window.get(y - 1), z)
        || any(window.get(y + 1), z)
}
