//! HeightField: the columns of a surface that is seen from one side, how high each is, and which of them are kept.
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
//! Three passes over the slices, in jobs: floors and tops, and how high the points in them lie; heights and what is kept; the ball, and cells. Between them lie lines of a number for each
//! column, in temporary storage.

mod ball;
pub mod columns;
mod extent;
mod grid;
mod heights;

use std::ops::Range;

use self::ball::filled;
use self::columns::Lines;
pub use self::columns::{
    ColumnCounts, Columns, HeightField, HeightFieldOptions, KEPT, LIVE_COLUMN, Up, is_touched, live_reach, margin,
};
use self::extent::{Extent, QUANTA, ROUND_NEEDLES, without_needles};
use self::heights::Patch;
use crate::error::Result;
use crate::grid::Grid;
use crate::grid::bucket::Buckets;
use crate::grid::context::{CHUNK_SLICES, Context};
use crate::grid::occupancy::Occupancy;
use crate::grid::partition::buckets_of;
use crate::grid::slice::{Runs, SliceStore};
use crate::points::Coordinate;
use crate::solid::Solid;

/// Finds the columns and makes the solid of them. The solid's ground is set. Without `points`, these lie in the middles of their cells.
///
/// Memory: [`bytes`].
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::Interrupted`].
pub fn solid<T: Coordinate>(
    occupancy: &Occupancy,
    points: Option<(&Buckets<T>, &Grid)>,
    asked: HeightFieldOptions,
    context: &Context,
) -> Result<Solid> {
    let cells = occupancy.cells;
    let (up, across) = (asked.up, asked.up.across());
    let (columns, cells_up) = (cells[across], cells[up.axis]);
    let extents = extents(occupancy, points, up, context)?;
    let mut ground = HeightField {
        up,
        trimmed: !asked.base,
        cells_up,
        heights: Lines::new(columns, context),
        flags: Lines::new(columns, context),
        found: ColumnCounts::default(),
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
            let first = i64::from(slices.start) - i64::from(side);
            let end = i64::from(slices.start + job_slices(side) + side);
            let beyond = i64::from(ROUND_NEEDLES);
            let lines = extents.read(first - beyond..end + beyond, Extent::NOTHING)?;
            let extents = without_needles(&lines, columns as usize, asked.one_layer);
            drop(lines);
            let patch = Patch {
                width: columns as usize,
                side: side as usize,
                first,
                end: i64::from(cells[1]),
                cells_up,
                extents,
            };
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
    solid.ground = Some(HeightField { flags, ..ground });
    Ok(solid)
}

/// Memory of a job, in bytes, for slices of `columns` columns: what it reads, discs, the lattice's levels, what it gives.
pub fn bytes(columns: u32, bridge: u32, smooth: u32) -> u64 {
    let side = lattice_side(bridge, smooth);
    u64::from(columns + 2 * (bridge + 1)) * u64::from(job_slices(side) + 2 * (side + ROUND_NEEDLES)) * BYTES_OF_COLUMN
}

/// Memory of all jobs of the pass that needs the most of so many `slices`, with no more than `in_flight` at a time on so many `threads`: of those that interpolate, which are few, or of
/// those over chunks, which read fewer lines. Jobs that wait for their turn have only what they give.
pub fn bytes_of_pass(columns: u32, bridge: u32, smooth: u32, slices: u32, (in_flight, threads): (usize, usize)) -> u64 {
    let side = lattice_side(bridge, smooth);
    let all = |slices_of_job: u32, job: u64| {
        let jobs = (in_flight as u64).min(u64::from(slices.div_ceil(slices_of_job)));
        let running = jobs.min(threads as u64);
        running * job + (jobs - running) * u64::from(slices_of_job) * u64::from(columns) * BYTES_GIVEN
    };
    let lines = u64::from(CHUNK_SLICES + 2 * side);
    let over_chunk = u64::from(columns + 2 * (bridge + 1)) * lines * BYTES_OF_COLUMN;
    all(job_slices(side), bytes(columns, bridge, smooth)).max(all(CHUNK_SLICES, over_chunk))
}

/// Bytes for each column of each slice that a job reads: what is occupied of it, whether it is near data in four ways, its height, top, flags, and a third of the
/// lattice's levels.
const BYTES_OF_COLUMN: u64 = 40;

/// Bytes that a job gives for each column of each of its slices, at the most: its extent. Heights, tops and flags are fewer.
const BYTES_GIVEN: u64 = size_of::<Extent>() as u64;

/// The side of the lattice's coarsest cells: twice as far as any live column lies from one with points, so that one of four neighbours holds some.
fn lattice_side(bridge: u32, smooth: u32) -> u32 {
    (2 * (bridge + live_reach(smooth) + 1)).next_power_of_two()
}

/// Slices of a job that interpolates: whole coarsest cells.
fn job_slices(side: u32) -> u32 {
    side * (64 / side).max(1)
}

/// What is occupied of each column of each slice, and how high the points in its lowest and highest cells lie.
fn extents<T: Coordinate>(
    occupancy: &Occupancy,
    points: Option<(&Buckets<T>, &Grid)>,
    up: Up,
    context: &Context,
) -> Result<Lines<Extent>> {
    let cells = occupancy.cells;
    let (columns, cells_up) = (cells[up.across()], cells[up.axis]);
    let mut out = Lines::new(columns, context);
    let mut jobs = crate::grid::context::chunks(cells[1]);
    context.workers.in_order(
        context.memory.chunks_in_flight,
        || Ok(jobs.next()),
        |chunk| {
            let mut lines = vec![Extent::NOTHING; chunk.len() * columns as usize];
            let mut runs = Runs::default();
            for (y, line) in chunk.clone().zip(lines.chunks_exact_mut(columns as usize)) {
                occupancy.store.read(y, &mut runs)?;
                for z in 0..runs.row_count() {
                    let row = runs.row(z);
                    if up.axis == 0 {
                        row.iter().for_each(|run| line[z as usize].add(run.start..run.end));
                        continue;
                    }
                    for run in row {
                        for column in &mut line[run.start as usize..run.end as usize] {
                            column.add(z..z + 1);
                        }
                    }
                }
                if !up.positive {
                    line.iter_mut().for_each(|column| column.turn(cells_up));
                }
            }
            if let Some((buckets, grid)) = points {
                measure(&mut lines, chunk, buckets, grid, up)?;
            }
            Ok(lines)
        },
        |lines| out.append(&lines),
    )?;
    Ok(out)
}

/// Tells the columns of some slices how high the points in their lowest and highest cells lie on average.
fn measure<T: Coordinate>(
    columns: &mut [Extent],
    slices: Range<u32>,
    buckets: &Buckets<T>,
    grid: &Grid,
    up: Up,
) -> Result<()> {
    let (width, cells_up) = (grid.cells()[up.across()], grid.cells()[up.axis]);
    // Of each column's lowest and highest cell, the sum of heights within it and the number of points.
    let mut sums = vec![[(0u64, 0u64); 2]; columns.len()];
    for bucket in buckets_of(slices.clone()) {
        buckets.read(bucket as usize, |points| {
            for point in points {
                let (cell, within) = grid.place_of(point.map(Into::into));
                let (along, within) = (cell[up.axis], within[up.axis]);
                let (height, within) = if up.positive { (along, within) } else { (cells_up - 1 - along, 1.0 - within) };
                let column = ((cell[1] - slices.start) * width + cell[up.across()]) as usize;
                let Extent { floor, top, .. } = columns[column];
                for (sum, _) in
                    sums[column].iter_mut().zip([floor, top.wrapping_sub(1)]).filter(|(_, of)| *of == height)
                {
                    *sum = (sum.0 + (within * QUANTA) as u64, sum.1 + 1);
                }
            }
            Ok(())
        })?;
    }
    for (column, [floor, top]) in columns.iter_mut().zip(sums).filter(|(column, _)| column.is_data()) {
        let [floor, top] = [floor, top].map(|(sum, points)| (sum / points) as u32);
        column.measured(floor, top);
    }
    Ok(())
}
