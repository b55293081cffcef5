//! Walls: what stands between a component of free cells and the sides, and so which side it is on.
//!
//! ```text
//!   # # #        # occupied, o outside, i inside, c a cell of the component
//!   o # c c      the left wall has the outside behind it: it speaks for the inside
//!   o # c c
//!   o # # #      a wall is an occupied cell that touches a cell next to a side
//! ```

use bytemuck::{Pod, Zeroable};

use crate::context::{Context, chunks};
use crate::error::Result;
use crate::slice::{Bits, Run, Runs, SliceStore, words_for};
use crate::stage::dilate::Ball;
use crate::stage::exterior::{Padded, near};
use crate::stage::label::{Labeller, Labels, Measure};
use crate::stage::raster::Occupancy;
use crate::window::Window;

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
            context.memory.chunks_for(&context.load, 2 * ball.radius() + 3),
            || Ok(jobs.next()),
            |slices| self.evidence(&ball, slices),
            |slices: Vec<(Runs, Vec<Evidence>)>| {
                slices.into_iter().try_for_each(|(runs, found)| labeller.add(runs, &found))
            },
        )?;
        labeller.finish()?.judged(context, Evidence::verdict)
    }

    /// The runs of some slices, with the evidence of each.
    fn evidence(&self, ball: &Ball, slices: std::ops::Range<u32>) -> Result<Vec<(Runs, Vec<Evidence>)>> {
        let mut held = Vec::with_capacity(slices.len());
        for y in slices.clone() {
            let mut runs = Runs::default();
            self.cells.read(y, &mut runs)?;
            held.push(runs);
        }
        if held.iter().all(|runs| runs.all().is_empty()) {
            return Ok(held.into_iter().map(|runs| (runs, Vec::new())).collect());
        }
        let padded = self.padded;
        let reach = i64::from(ball.radius());
        let mut walls = [Walls::new(padded, ball), Walls::new(padded, ball)];
        let mut touched = Window::new(3, || padded.bits());
        let mut runs = Runs::default();
        let mut rows = [vec![0; words_for(padded.cells[0])], vec![0; words_for(padded.cells[0])]];
        let mut out = Vec::with_capacity(held.len());
        for (y, open) in slices.map(i64::from).zip(held) {
            for (walls, store) in walls.iter_mut().zip(self.next_to) {
                walls.slide_to(y - reach, padded, self.occupancy, store)?;
            }
            touched.slide_to(y - 1, |y, bits| self.outside.paint(y, bits, &mut runs))?;
            let mut found = Vec::with_capacity(open.all().len());
            for z in 0..open.row_count() {
                if open.row(z).is_empty() {
                    continue;
                }
                for (row, walls) in rows.iter_mut().zip(&walls) {
                    ball.dilate_row(near(&walls.window, y, z), row);
                }
                for run in open.row(z) {
                    let mut evidence = Evidence {
                        cells: u64::from(run.end - run.start),
                        touches_outside: u64::from(touches(&touched, y, z, *run)),
                        ..Evidence::default()
                    };
                    for x in run.start..run.end {
                        let behind = [0, 1].map(|side| rows[side][x as usize / 64] >> (x % 64) & 1 == 1);
                        evidence.outside_behind += u64::from(behind == [true, false]);
                        evidence.inside_behind += u64::from(behind == [false, true]);
                    }
                    found.push(evidence);
                }
            }
            out.push((open, found));
        }
        Ok(out)
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
}

impl Measure for Evidence {
    fn add(&mut self, other: &Evidence) {
        self.cells += other.cells;
        self.touches_outside += other.touches_outside;
        self.outside_behind += other.outside_behind;
        self.inside_behind += other.inside_behind;
    }
}

impl Evidence {
    /// What is cut off from the outside is inside. Else the walls decide, if those of a quarter of the cells speak, and four times as
    /// many for one side as for the other: a rim round a hole is not enough.
    fn verdict(&self) -> u8 {
        let decisive = |most: u64, least: u64| 4 * most >= self.cells && 4 * least <= most;
        if self.touches_outside == 0 || decisive(self.outside_behind, self.inside_behind) {
            INSIDE
        } else if decisive(self.inside_behind, self.outside_behind) {
            OUTSIDE
        } else {
            UNDECIDED
        }
    }
}

/// A window of walls: occupied cells that touch a cell next to one side.
struct Walls {
    window: Window<Bits>,
    next_to: Window<Bits>,
}

impl Walls {
    fn new(padded: Padded, ball: &Ball) -> Walls {
        Walls {
            window: Window::new(2 * ball.radius() as usize + 1, || padded.bits()),
            next_to: Window::new(3, || padded.bits()),
        }
    }

    fn slide_to(&mut self, first: i64, padded: Padded, occupancy: &Occupancy, store: &SliceStore) -> Result<()> {
        let block = Ball::new(1);
        let (mut runs, mut row) = (Runs::default(), vec![0; words_for(padded.cells[0])]);
        let next_to = &mut self.next_to;
        self.window.slide_to(first, |y, walls| {
            next_to.slide_to(y - 1, |y, bits| store.paint(y, bits, &mut runs))?;
            padded.paint_occupied(occupancy, y, walls, &mut runs)?;
            for z in 0..padded.cells[2] {
                if walls.lit_row(z).is_some() {
                    block.dilate_row(near(next_to, y, z), &mut row);
                    walls.row_mut(z).iter_mut().zip(&row).for_each(|(wall, near)| *wall &= near);
                }
            }
            Ok(())
        })
    }
}

/// Whether a run of row `z` shares a face with a cell of the window's slices.
fn touches(window: &Window<Bits>, y: i64, z: u32, run: Run) -> bool {
    let z = i64::from(z);
    let (first, last) = (i64::from(run.start), i64::from(run.end) - 1);
    let here = window.get(y);
    here.get(first - 1, z)
        || here.get(last + 1, z)
        || (first..=last).any(|x| {
            here.get(x, z - 1) || here.get(x, z + 1) || window.get(y - 1).get(x, z) || window.get(y + 1).get(x, z)
        })
}
