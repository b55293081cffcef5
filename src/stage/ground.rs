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

use std::ops::Range;

use bytemuck::Pod;

use crate::context::{CHUNK_SLICES, Context};
use crate::error::Result;
use crate::grid::Cell;
use crate::slice::{Bits, Runs, SliceStore, Slices, set_range};
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

/// The columns of a job's slices, and of a coarsest cell's more on either side.
struct Patch {
    width: usize,
    side: usize,
    /// The first slice, and the first behind the grid's last.
    first: i64,
    end: i64,
    extents: Vec<[u32; 2]>,
}

impl Patch {
    /// Heights, tops and flags of the first `slices` slices behind the first side.
    fn of(&self, slices: usize, asked: Asked) -> (Vec<f32>, Vec<u32>, Vec<u8>, Found) {
        let (width, rows) = (self.width, self.extents.len() / self.width);
        let own = self.side * width..(self.side + slices) * width;
        let is_data = |i: usize| self.extents[i][0] != NOTHING;

        // Discs reach beyond the box: as far as the largest, and one more, on either side.
        let pad = asked.bridge as usize + 1;
        let wide = width + 2 * pad;
        let mut mask = vec![false; wide * rows];
        for (row, line) in mask.chunks_exact_mut(wide).enumerate() {
            (0..width).for_each(|x| line[pad + x] = is_data(row * width + x));
        }
        let mut open: Vec<bool> = near(&mask, wide, asked.bridge);
        open.iter_mut().for_each(|near| *near = !*near);
        let open = near(&open, wide, asked.bridge);
        // Closed: no disc without points reaches it.
        mask.iter_mut().zip(&open).for_each(|(mask, open)| *mask |= !open);
        let mask = without_pinches(&mask, wide);
        let live = near(&mask, wide, live_reach(asked.smooth));

        let levels = self.levels();
        let mut heights = Vec::with_capacity(own.len());
        let mut tops = Vec::with_capacity(own.len());
        let mut flags = Vec::with_capacity(own.len());
        let mut found = Found::default();
        for i in own {
            let (row, x) = (i / width, i % width);
            let padded = row * wide + pad + x;
            let flag = if is_data(i) { DATA } else { 0 }
                | if mask[padded] { KEPT } else { 0 }
                | if live[padded] { LIVE_COLUMN } else { 0 };
            let (height, top) = if is_data(i) {
                (self.extents[i][0] as f32 + 0.5, self.extents[i][1])
            } else if flag & LIVE_COLUMN != 0 {
                let height = interpolated(&levels, x, row) as f32;
                (height, height as u32 + 1)
            } else {
                (f32::NAN, 0)
            };
            found.data += u64::from(flag & DATA);
            found.bridged += u64::from(flag & (DATA | KEPT) == KEPT);
            heights.push(height);
            tops.push(top);
            flags.push(flag);
        }
        (heights, tops, flags, found)
    }

    /// Floors, averaged over ever larger cells of the lattice: level l has cells of 2^(l + 1) columns and slices. What has no points is interpolated
    /// from the level above.
    fn levels(&self) -> Vec<Level> {
        let floor = |x: usize, row: usize| match self.extents.get(row * self.width + x) {
            Some([floor, _]) if x < self.width && *floor != NOTHING => f64::from(*floor) + 0.5,
            _ => f64::NAN,
        };
        let mut levels = vec![Level::over(self.width, self.extents.len() / self.width, floor)];
        for _ in 2..=self.side.ilog2() {
            let below = &levels[levels.len() - 1];
            levels.push(Level::over(below.width, below.values.len() / below.width, |x, row| {
                below.at(x as i64, row as i64)
            }));
        }
        for l in (0..levels.len() - 1).rev() {
            let (finer, coarser) = levels.split_at_mut(l + 1);
            let (level, above) = (&mut finer[l], &coarser[0]);
            for (row, values) in level.values.chunks_exact_mut(level.width).enumerate() {
                let slice = self.first + ((row as i64) << (l + 1));
                if !(0..self.end).contains(&slice) {
                    continue;
                }
                for (x, value) in values.iter_mut().enumerate().filter(|(_, value)| value.is_nan()) {
                    *value = above.between(x, row);
                }
            }
        }
        levels
    }
}

/// The height of a column without points.
fn interpolated(levels: &[Level], x: usize, row: usize) -> f64 {
    levels[0].between(x, row)
}

/// A level of the lattice: NaN where nothing is known.
struct Level {
    width: usize,
    values: Vec<f64>,
}

impl Level {
    /// The level above one of `width` by `rows`: means of two by two values, as far as there are any.
    fn over(width: usize, rows: usize, below: impl Fn(usize, usize) -> f64) -> Level {
        let (half, rows) = (width.div_ceil(2), rows / 2);
        let mut values = Vec::with_capacity(half * rows);
        for row in 0..rows {
            for x in 0..half {
                let (mut sum, mut count) = (0.0, 0.0);
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let value = if 2 * x + dx < width { below(2 * x + dx, 2 * row + dy) } else { f64::NAN };
                    if !value.is_nan() {
                        sum += value;
                        count += 1.0;
                    }
                }
                values.push(if count > 0.0 { sum / count } else { f64::NAN });
            }
        }
        Level { width: half, values }
    }

    fn at(&self, x: i64, row: i64) -> f64 {
        if x < 0 || row < 0 || x >= self.width as i64 {
            return f64::NAN;
        }
        self.values.get(row as usize * self.width + x as usize).copied().unwrap_or(f64::NAN)
    }

    /// The value at a place of the level below: of the four nearest cells, by nearness, as far as they have one.
    fn between(&self, x: usize, row: usize) -> f64 {
        let nearer = |at: usize| (at as i64 / 2, at as i64 / 2 + if at.is_multiple_of(2) { -1 } else { 1 });
        let ((x0, x1), (y0, y1)) = (nearer(x), nearer(row));
        let (mut sum, mut weights) = (0.0, 0.0);
        for (x, row, weight) in [(x0, y0, 9.0), (x1, y0, 3.0), (x0, y1, 3.0), (x1, y1, 1.0)] {
            let value = self.at(x, row);
            if !value.is_nan() {
                sum += weight * value;
                weights += weight;
            }
        }
        sum / weights
    }
}

/// The columns with a set one within `radius`, both in rows of `width`.
fn near(set: &[bool], width: usize, radius: u32) -> Vec<bool> {
    let (rows, squared) = (set.len() / width, u64::from(radius).pow(2));
    // How far along slices the nearest set column lies, upwards and downwards.
    let mut away = vec![u32::MAX; set.len()];
    for step in [false, true] {
        let mut since = vec![u32::MAX; width];
        for row in 0..rows {
            let row = if step { rows - 1 - row } else { row };
            let line = row * width..(row + 1) * width;
            for ((since, set), away) in since.iter_mut().zip(&set[line.clone()]).zip(&mut away[line]) {
                *since = if *set { 0 } else { since.saturating_add(1) };
                *away = (*away).min(*since);
            }
        }
    }
    let mut out = vec![false; set.len()];
    for (away, out) in away.chunks_exact(width).zip(out.chunks_exact_mut(width)) {
        // The end of the stretch that is near, as far as it is known; stretches begin in order of their columns, less the radius.
        let mut starts = vec![0i32; width + 1];
        for (x, away) in away.iter().enumerate().filter(|(_, away)| **away <= radius) {
            let half = (squared - u64::from(*away).pow(2)).isqrt() as usize;
            starts[x.saturating_sub(half)] += 1;
            starts[(x + half + 1).min(width)] -= 1;
        }
        let mut depth = 0;
        for (out, start) in out.iter_mut().zip(&starts) {
            depth += start;
            *out = depth > 0;
        }
    }
    out
}

/// The set without what is narrower than two columns, and without pairs of columns that touch at a corner alone: the other two there are set, too.
fn without_pinches(set: &[bool], width: usize) -> Vec<bool> {
    let mut out = vec![false; set.len()];
    let squares = || (0..set.len() - width - 1).filter(|i| i % width + 1 < width);
    for i in squares() {
        let square = [i, i + 1, i + width, i + width + 1];
        if square.iter().all(|i| set[*i]) {
            square.into_iter().for_each(|i| out[i] = true);
        }
    }
    // What is set may touch another at a corner in turn, but what is set then does not.
    for _ in 0..2 {
        let before = out.clone();
        for i in squares() {
            let square = [i, i + 1, i + width, i + width + 1];
            let [a, b, c, d] = square.map(|i| before[i]);
            if a == d && b == c && a != b {
                square.into_iter().for_each(|i| out[i] = true);
            }
        }
    }
    out
}

/// The cells of some slices when the ball has rolled over the columns, their number, and each slice's faces.
fn filled(
    levels: &Lines<u32>,
    ground: &Ground,
    slices: Range<u32>,
    cells: Cell,
    asked: Asked,
) -> Result<(Slices, u64, Vec<u32>, Vec<u8>)> {
    let (columns, reach) = (levels.width, i64::from(asked.ball.radius()));
    // A slice below the first, for its faces; and as many as tell what is cut off.
    let beside = if asked.jump.is_some() { CUT } else { 1 };
    let (first, end) = (i64::from(slices.start) - beside, i64::from(slices.end) + beside);
    let tops = levels.read(first - 2 * reach..end + 2 * reach, 0)?;
    let mut flags = ground.flags.read(first..end, 0)?;
    let mut tops = closed(&tops, columns, asked.ball);
    if let Some(jump) = asked.jump {
        cut(&mut flags, &tops, columns, jump);
    }
    let behind = (beside - 1) as usize * columns;
    let held = behind..behind + (slices.len() + 1) * columns;
    let (mut tops, flags) = (tops.drain(held.clone()).collect::<Vec<_>>(), &flags[held]);
    if asked.base {
        tops.iter_mut().zip(flags).filter(|(_, flag)| **flag & KEPT == 0).for_each(|(top, _)| *top = 0);
    }
    let (mut out, mut volume, mut faces) = (Slices::default(), 0, Vec::with_capacity(slices.len()));
    let mut bits = Bits::new(cells[0], cells[2]);
    let mut order: Vec<(u32, u32)> = Vec::new();
    for y in 1..=slices.len() {
        let here = y * columns..(y + 1) * columns;
        let (line, below) = (&tops[here.clone()], &tops[here.start - columns..here.start]);
        let (seen, seen_below) = (&flags[here.clone()], &flags[here.start - columns..here.start]);
        bits.clear();
        if asked.up.axis == 0 {
            for (z, &top) in line.iter().enumerate().filter(|(_, top)| **top > 0) {
                let range = if asked.up.positive { 0..top } else { ground.cells_up - top..ground.cells_up };
                set_range(bits.row_mut(z as u32), range.start, range.end);
            }
        } else {
            // From the bottom up, with ever fewer columns.
            order.clear();
            order.extend(line.iter().zip(0..).map(|(top, x)| (*top, x)));
            order.sort_unstable();
            let mut lower = 0;
            let mut row = vec![0u64; bits.row_words()];
            set_range(&mut row, 0, columns as u32);
            for height in 0..order.last().map_or(0, |(top, _)| *top) {
                while order[lower].0 <= height {
                    let x = order[lower].1;
                    row[x as usize / 64] &= !(1 << (x % 64));
                    lower += 1;
                }
                let z = if asked.up.positive { height } else { ground.cells_up - 1 - height };
                bits.row_mut(z).copy_from_slice(&row);
            }
        }
        volume += line.iter().map(|top| u64::from(*top)).sum::<u64>();
        faces.push(faces_of(
            line,
            below,
            |x| !ground.trimmed || seen[x] & LIVE_COLUMN != 0,
            |x| !ground.trimmed || seen_below[x] & LIVE_COLUMN != 0,
            !ground.trimmed,
        ));
        out.push(&bits);
    }
    Ok((out, volume, faces, flags[columns..].to_vec()))
}

/// Lines on either side that tell whether a column is cut off: its neighbour's, and those of squares of squares.
const CUT: i64 = 4;

/// The steepest that a sheet's bridges may be, in cells for each column.
const STEEPEST: u32 = 4;

/// Keeps no columns any more at the foot of what stands before them by more than `jump` cells, so that no wall joins the two, and no steep bridges.
fn cut(flags: &mut [u8], tops: &[u32], width: usize, jump: u32) {
    let kept = |i: usize| flags[i] & KEPT != 0;
    let stays = |i: usize| {
        let (x, y) = (i % width, i / width);
        let lines = y.saturating_sub(1)..(y + 2).min(tops.len() / width);
        let mut around = lines.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x));
        let is_bridge = flags[i] & DATA == 0;
        let breaks = |other: u32| other > tops[i] + jump || is_bridge && other.abs_diff(tops[i]) > STEEPEST;
        kept(i) && !around.any(|other| kept(other) && breaks(tops[other]))
    };
    let left: Vec<bool> = (0..tops.len()).map(stays).collect();
    for (flag, kept) in flags.iter_mut().zip(without_pinches(&left, width)) {
        *flag = *flag & !KEPT | if kept { KEPT } else { 0 };
    }
}

/// The faces of a slice's columns of these heights that are made: on top, to the columns before them and to those of the slice below, and, of a closed
/// solid, at the bottom and beyond its ends.
fn faces_of(
    line: &[u32],
    below: &[u32],
    is_live: impl Fn(usize) -> bool,
    is_live_below: impl Fn(usize) -> bool,
    whole: bool,
) -> u32 {
    let mut faces = 0;
    for (x, &top) in line.iter().enumerate().filter(|(x, _)| is_live(*x)) {
        faces += if whole { 2 * u32::from(top > 0) } else { 1 };
        let before = if x > 0 && is_live(x - 1) {
            line[x - 1]
        } else if whole {
            0
        } else {
            top
        };
        let under = if is_live_below(x) { below[x] } else { top };
        faces += top.abs_diff(before) + top.abs_diff(under);
    }
    faces + if whole { line[line.len() - 1] } else { 0 }
}

/// Heights when the ball has rolled over them, without as many lines as it reaches, twice, at either end: dilation, then erosion. Beyond the box all
/// heights are 0.
fn closed(tops: &[u32], width: usize, ball: Ball) -> Vec<u32> {
    let pad = 2 * ball.radius() as usize;
    let wide = width + 2 * pad;
    let mut padded = vec![0; tops.len() / width * wide];
    for (padded, line) in padded.chunks_exact_mut(wide).zip(tops.chunks_exact(width)) {
        padded[pad..pad + width].copy_from_slice(line);
    }
    let higher = rolled(&padded, wide, ball, |a, b, height| a.max(b + height), 0);
    let lower = rolled(&higher, wide, ball, |a, b, height| a.min(b.saturating_sub(height)), u32::MAX);
    lower.chunks_exact(wide).flat_map(|line| &line[pad..pad + width]).copied().collect()
}

/// Of each column, what `best` makes of those within the ball and its height there; without as many lines as the ball reaches at either end. Of as
/// many columns at the ends of lines it is not the true one.
fn rolled(tops: &[u32], width: usize, ball: Ball, best: impl Fn(u32, u32, u32) -> u32, start: u32) -> Vec<u32> {
    let reach = ball.radius() as usize;
    let rows = tops.len() / width;
    let mut out = vec![start; (rows - 2 * reach) * width];
    for (y, line) in out.chunks_exact_mut(width).enumerate() {
        for dy in 0..=2 * reach {
            for dx in 0..=2 * reach {
                let [away_y, away_x] = [dy, dx].map(|d| d.abs_diff(reach) as u32);
                let Some(height) = ball.half_width(away_y, away_x) else { continue };
                let from = &tops[(y + dy) * width + dx..(y + dy + 1) * width];
                let inner = reach..width - reach;
                line[inner].iter_mut().zip(from).for_each(|(out, top)| *out = best(*out, *top, height));
            }
        }
    }
    out
}

/// The columns of some consecutive slices.
#[derive(Debug)]
pub struct Columns {
    up: Up,
    trimmed: bool,
    cells_up: u32,
    first: i64,
    width: usize,
    heights: Vec<f32>,
    flags: Vec<u8>,
}

impl Ground {
    /// The columns of slices `slices`; those that do not exist have nothing in them.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn columns(&self, slices: Range<i64>) -> Result<Columns> {
        Ok(Columns {
            up: self.up,
            trimmed: self.trimmed,
            cells_up: self.cells_up,
            first: slices.start,
            width: self.heights.width,
            heights: self.heights.read(slices.clone(), f32::NAN)?,
            flags: self.flags.read(slices, 0)?,
        })
    }
}

impl Columns {
    /// Whether faces are left out.
    pub fn trimmed(&self) -> bool {
        self.trimmed
    }

    /// From where they are seen.
    pub fn up(&self) -> Up {
        self.up
    }

    fn place(&self, y: i64, column: i64) -> Option<usize> {
        let inside = column >= 0 && column < self.width as i64 && y >= self.first;
        let at = || (y - self.first) as usize * self.width + column as usize;
        inside.then(at).filter(|at| *at < self.flags.len())
    }

    /// The flags of column `column` of slice `y`; none where there is no such column.
    #[inline]
    pub fn flags(&self, y: i64, column: i64) -> u8 {
        self.place(y, column).map_or(0, |at| self.flags[at])
    }

    /// What both columns of a face have, or its only one.
    #[inline]
    pub fn of_face(&self, cell: [u32; 3], axis: usize) -> u8 {
        let (y, column) = (i64::from(cell[1]), i64::from(cell[self.up.across()]));
        let own = self.flags(y, column);
        match axis {
            1 => own & self.flags(y - 1, column),
            axis if axis == self.up.axis => own,
            _ => own & self.flags(y, column - 1),
        }
    }

    /// Whether a corner on plane `j` between columns `column` − 1 and `column` belongs to a column that is live.
    pub fn is_live(&self, j: i64, column: i64) -> bool {
        let four = [(j - 1, column - 1), (j - 1, column), (j, column - 1), (j, column)];
        four.iter().any(|&(y, column)| self.flags(y, column) & LIVE_COLUMN != 0)
    }

    /// Whether a corner of the surface is made.
    pub fn holds(&self, corner: [u32; 3]) -> bool {
        self.is_live(i64::from(corner[1]), i64::from(corner[self.up.across()])) && !self.at_bottom(corner)
    }

    /// Whether a corner lies on the bottom of the grid.
    pub fn at_bottom(&self, corner: [u32; 3]) -> bool {
        corner[self.up.axis] == if self.up.positive { 0 } else { self.cells_up }
    }

    /// Where along the up axis a corner's vertex lies, in cells, if none of the four columns round it holds points, and it is the corner at their height.
    pub fn bridge(&self, corner: [u32; 3]) -> Option<f64> {
        let (j, column) = (i64::from(corner[1]), i64::from(corner[self.up.across()]));
        let height = |y: i64, column: i64| {
            let at = self.place(y, column)?;
            (self.flags[at] & DATA == 0 && !self.heights[at].is_nan()).then(|| f64::from(self.heights[at]))
        };
        let (a, b) = (height(j - 1, column - 1)?, height(j - 1, column)?);
        let (c, d) = (height(j, column - 1)?, height(j, column)?);
        let mean = ((a + b) + (c + d)) * 0.25;
        let corner = self.up.turn(f64::from(corner[self.up.axis]), self.cells_up);
        (mean.floor() + 1.0 == corner).then(|| self.up.turn(mean, self.cells_up))
    }
}
