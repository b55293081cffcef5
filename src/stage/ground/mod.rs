//! Ground: the columns of a surface that is seen from one side, how high each is, and which of them are kept.
//!
//! ```text
//!   up ^        ###          a column's *top* is its highest occupied cell, its *floor* the lowest
//!      |        . .  #
//!      |  #  ###.#. ##   #   (a roof, something below it, ground)
//!      |  :##:::::::::___:   columns without points take an interpolated height: bridged up to a hole's width (kept), and a margin beyond
//!      +---------------->    columns
//!         data   data bridge
//! ```
//!
//! All columns are solid from the bottom of the grid to their height; then a small ball rolls over them and fills the pits that it cannot reach into. So there
//! is one layer everywhere. The grid has a margin, in which the surface runs on, and which is left out when the mesh is written.
//!
//! Three passes over the slices, in jobs: floors and tops; heights and what is kept; the ball, and cells. Between them lie lines of a number for each
//! column, in temporary storage.

mod ball;
mod columns;
mod heights;

use std::ops::Range;

use bytemuck::Pod;

use self::ball::filled;
pub use self::columns::{Columns, is_touched};
use self::heights::Patch;
use crate::context::{CHUNK_SLICES, Context};
use crate::error::Result;
use crate::slice::{Runs, SliceStore};
use crate::spool::Spool;
use crate::stage::dilate::Ball;
use crate::stage::raster::Occupancy;
use crate::stage::solid::Solid;

/// Columns round those that are kept whose faces are made, so that what is kept is as it would be on a closed surface: vertices with a point lie
/// within five of a column with points, and the triangles round their neighbours within seven. For one step of smoothing.
const LIVE: u32 = 7;

/// Columns that are made round those that are kept, after `smooth` steps of smoothing: each further one sees two more.
pub fn live_reach(smooth: u32) -> u32 {
    LIVE + 2 * (smooth.max(1) - 1)
}

/// Cells of margin that the grid needs on all sides but above.
pub fn margin(smooth: u32) -> u32 {
    live_reach(smooth) + 2
}

/// The direction that the surface is seen from, along a grid axis that is not the slices'.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Up {
    /// Grid axis 0 (along rows) or 2 (across rows).
    pub axis: usize,
    /// Whether up is the way of growing coordinates.
    pub positive: bool,
}

impl Up {
    /// The grid axis along which a slice's columns are numbered.
    pub fn across(self) -> usize {
        2 - self.axis
    }

    /// The height above the bottom of a place along the up axis, where `cells` lie along it, or the reverse.
    fn turn(self, at: f64, cells: u32) -> f64 {
        if self.positive { at } else { f64::from(cells) - at }
    }
}

/// What is asked of the ground.
#[derive(Debug, Clone, Copy)]
pub struct Asked {
    /// From where it is seen.
    pub up: Up,
    /// Radius of the disc that bridges holes, in cells.
    pub bridge: u32,
    /// The ball that rolls over it.
    pub ball: Ball,
    /// Whether the kept columns alone are solid, down to the bottom of the grid, and the mesh is closed.
    pub base: bool,
    /// The highest step, in cells, whose wall is kept; all are if there is none.
    pub jump: Option<u32>,
    /// Steps of smoothing.
    pub smooth: u32,
}

/// The column holds points.
pub const DATA: u8 = 1;
/// It holds points, or is bridged.
pub const KEPT: u8 = 2;
/// It is kept, or near a column that is.
pub const LIVE_COLUMN: u8 = 4;

/// The columns of a cloud, slice by slice.
#[derive(Debug)]
pub struct Ground {
    /// From where it is seen.
    pub up: Up,
    /// Whether faces are left out: those of columns that are not kept. Else the mesh is closed.
    pub trimmed: bool,
    /// Cells along the up axis.
    cells_up: u32,
    /// Height above the bottom, in cells; NaN where there is nothing near to interpolate.
    heights: Lines<f32>,
    flags: Lines<u8>,
    /// What was found.
    pub found: Found,
}

/// Numbers of columns.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Found {
    /// Columns with points.
    pub data: u64,
    /// Columns without points that are bridged.
    pub bridged: u64,
}

/// Lines of equal length, one for each slice, written in order.
#[derive(Debug)]
struct Lines<T> {
    spool: Spool,
    width: usize,
    kind: std::marker::PhantomData<T>,
}

impl<T: Pod> Lines<T> {
    fn new(width: u32, context: &Context) -> Lines<T> {
        let spool = context.workspace.spool(context.memory.store_quota);
        Lines { spool, width: width as usize, kind: std::marker::PhantomData }
    }

    fn append(&mut self, lines: &[T]) -> Result<()> {
        self.spool.append(bytemuck::cast_slice(lines)).map(|_| ())
    }

    fn slices(&self) -> i64 {
        (self.spool.len() as usize / size_of::<T>() / self.width) as i64
    }

    /// The lines of some slices, one behind the other; those that do not exist hold `none`.
    fn read(&self, slices: Range<i64>, none: T) -> Result<Vec<T>> {
        let mut out = vec![none; (slices.end - slices.start) as usize * self.width];
        let there = slices.start.clamp(0, self.slices())..slices.end.clamp(0, self.slices());
        if !there.is_empty() {
            let first = (there.start - slices.start) as usize * self.width;
            let len = (there.end - there.start) as usize * self.width;
            let at = there.start as u64 * (self.width * size_of::<T>()) as u64;
            self.spool.read_at(at, bytemuck::cast_slice_mut(&mut out[first..first + len]))?;
        }
        Ok(out)
    }
}

/// No cell of the column is occupied.
const NOTHING: u32 = u32::MAX;

/// Finds the columns and makes the solid of them. The solid's ground is set.
///
/// Memory: [`bytes`].
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::Interrupted`].
pub fn solid(occupancy: &Occupancy, asked: Asked, context: &Context) -> Result<Solid> {
    let cells = occupancy.cells;
    let (up, across) = (asked.up, asked.up.across());
    let (columns, cells_up) = (cells[across], cells[up.axis]);
    let extents = extents(occupancy, up, context)?;
    let mut ground = Ground {
        up,
        trimmed: !asked.base,
        cells_up,
        heights: Lines::new(columns, context),
        flags: Lines::new(columns, context),
        found: Found::default(),
    };
    let mut levels: Lines<u32> = Lines::new(columns, context);
    let side = lattice_side(asked.bridge, asked.smooth);
    let jobs = |step: u32| {
        let mut first = (0..cells[1]).step_by(step as usize);
        move || Ok(first.next().map(|first| first..(first + step).min(cells[1])))
    };
    context.workers.in_order(
        context.memory.chunks_in_flight,
        jobs(job_slices(side)),
        |slices| {
            let window = i64::from(slices.start) - i64::from(side)..i64::from(slices.start + job_slices(side) + side);
            let extents = extents.read(window.clone(), [NOTHING, 0])?;
            let first = window.start;
            let patch =
                Patch { width: columns as usize, side: side as usize, first, end: i64::from(cells[1]), extents };
            Ok(patch.of(slices.len(), asked))
        },
        |(heights, tops, flags, found)| {
            ground.heights.append(&heights)?;
            ground.flags.append(&flags)?;
            ground.found.data += found.data;
            ground.found.bridged += found.bridged;
            levels.append(&tops)
        },
    )?;
    drop(extents);
    let mut flags = Lines::new(columns, context);
    let store = SliceStore::new(&context.workspace, context.memory.store_quota);
    let mut solid = Solid { cells, store, volume: 0, faces: Vec::with_capacity(cells[1] as usize), ground: None };
    context.workers.in_order(
        context.memory.chunks_in_flight,
        jobs(CHUNK_SLICES),
        |slices| filled(&levels, &ground, slices, cells, asked),
        |(slices, volume, faces, left)| {
            flags.append(&left)?;
            solid.volume += volume;
            solid.faces.extend(faces);
            solid.store.extend(&slices)
        },
    )?;
    solid.ground = Some(Ground { flags, ..ground });
    Ok(solid)
}

/// Memory of a job, in bytes, for slices of `columns` columns: what it reads, discs, the lattice's levels, what it gives.
pub fn bytes(columns: u32, bridge: u32, smooth: u32) -> u64 {
    let side = lattice_side(bridge, smooth);
    u64::from(columns + 2 * (bridge + 1)) * u64::from(job_slices(side) + 2 * side) * 20
}

/// The side of the lattice's coarsest cells: twice as far as any live column lies from one with points, so that one of four neighbours holds some.
fn lattice_side(bridge: u32, smooth: u32) -> u32 {
    (2 * (bridge + live_reach(smooth) + 1)).next_power_of_two()
}

/// Slices of a job that interpolates: whole coarsest cells.
fn job_slices(side: u32) -> u32 {
    side * (64 / side).max(1)
}

/// Of each slice's columns, the lowest occupied cell and the one behind the highest, as heights above the bottom.
fn extents(occupancy: &Occupancy, up: Up, context: &Context) -> Result<Lines<[u32; 2]>> {
    let cells = occupancy.cells;
    let (columns, cells_up) = (cells[up.across()], cells[up.axis]);
    let mut out = Lines::new(columns, context);
    let mut jobs = crate::context::chunks(cells[1]);
    context.workers.in_order(
        context.memory.chunks_in_flight,
        || Ok(jobs.next()),
        |chunk| {
            let mut lines = vec![[NOTHING, 0]; chunk.len() * columns as usize];
            let mut runs = Runs::default();
            for (y, line) in chunk.zip(lines.chunks_exact_mut(columns as usize)) {
                occupancy.store.read(y, &mut runs)?;
                for z in 0..runs.row_count() {
                    let row = runs.row(z);
                    if up.axis == 0 {
                        if let [first, ..] = row {
                            line[z as usize] = [first.start, row[row.len() - 1].end];
                        }
                        continue;
                    }
                    for run in row {
                        for column in &mut line[run.start as usize..run.end as usize] {
                            *column = [column[0].min(z), z + 1];
                        }
                    }
                }
                if !up.positive {
                    for column in line.iter_mut().filter(|column| column[0] != NOTHING) {
                        *column = [cells_up - column[1], cells_up - column[0]];
                    }
                }
            }
            Ok(lines)
        },
        |lines| out.append(&lines),
    )?;
    Ok(out)
}
