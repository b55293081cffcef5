//! The columns of a surface that is seen from one side: what is asked of them, what is kept of each, and those of some slices, as the stages after ask for them.

use std::ops::Range;

use bytemuck::Pod;
use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::grid::context::Context;
use crate::grid::dilate::Ball;
use crate::grid::trace::{Digests, Trace, are_same, digest};
use crate::storage::spool::Spool;
use crate::storage::work::sections::{SectionReader, SectionWriter};

/// Columns round those that are kept whose faces are made, so that what is kept is as it would be on a closed surface: a vertex whose point is in a kept
/// column lies within five of it, and the triangles round its neighbours within seven. For one step of smoothing.
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
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
    pub(super) fn turn(self, at: f64, cells: u32) -> f64 {
        if self.positive { at } else { f64::from(cells) - at }
    }
}

/// What is asked of the ground.
#[derive(Debug, Clone, Copy)]
pub struct HeightFieldOptions {
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
    /// Whether it is one layer of the world as seen from above, in which steps stay steep and single cells in the air are nothing.
    pub one_layer: bool,
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
pub struct HeightField {
    /// From where it is seen.
    pub up: Up,
    /// Whether faces are left out: those of columns that are not kept. Else the mesh is closed.
    pub trimmed: bool,
    /// Cells along the up axis.
    pub(super) cells_up: u32,
    /// Height above the bottom, in cells: of a column with points that of the points in its highest cell, else interpolated. NaN where nothing is known.
    pub(super) heights: Lines<f32>,
    pub(super) flags: Lines<u8>,
    /// What was found.
    pub found: ColumnCounts,
}

/// What is kept of saved columns beside their lines.
#[derive(Debug, Serialize, Deserialize)]
pub struct SavedHeightField {
    up: Up,
    trimmed: bool,
    cells_up: u32,
    width: u32,
    found: ColumnCounts,
}

impl HeightField {
    /// Saves the columns.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn save(&self, out: &mut SectionWriter<'_>) -> Result<SavedHeightField> {
        out.spool(&self.heights.spool)?;
        out.spool(&self.flags.spool)?;
        let &HeightField { up, trimmed, cells_up, found, .. } = self;
        Ok(SavedHeightField { up, trimmed, cells_up, width: self.heights.width as u32, found })
    }

    /// Moves the columns that lie in memory to disk.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn leave_memory(&mut self) -> Result<()> {
        self.heights.spool.leave_memory()?;
        self.flags.spool.leave_memory()
    }

    /// From now on it is told which slices' columns are read.
    pub fn trace(&mut self) {
        self.heights.trace = Trace::of(self.heights.slices() as usize);
        self.flags.trace = Trace::of(self.flags.slices() as usize);
    }

    /// What was in those that were read since: heights, and what columns are.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn traced(&self) -> Result<[Digests; 2]> {
        Ok([
            self.heights.trace.digests(|slice| self.heights.digest(slice))?,
            self.flags.trace.digests(|slice| self.flags.digest(slice))?,
        ])
    }

    /// Whether the columns of these slices are the same.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn are_same(&self, [heights, flags]: &[Digests; 2]) -> Result<bool> {
        Ok(are_same(heights, self.heights.slices() as usize, |slice| self.heights.digest(slice))?
            && are_same(flags, self.flags.slices() as usize, |slice| self.flags.digest(slice))?)
    }

    /// What all columns have in common.
    pub fn common(&self) -> (Up, bool, u32, usize) {
        (self.up, self.trimmed, self.cells_up, self.heights.width)
    }

    /// Reads what [`HeightField::save`] saved.
    ///
    /// # Errors
    /// [`crate::Error::Damaged`], [`crate::Error::Io`].
    pub fn load(saved: &SavedHeightField, sections: &mut SectionReader<'_>, context: &Context) -> Result<HeightField> {
        let &SavedHeightField { up, trimmed, cells_up, width, found } = saved;
        let heights = Lines::load(width, sections, context)?;
        let flags = Lines::load(width, sections, context)?;
        Ok(HeightField { up, trimmed, cells_up, heights, flags, found })
    }
}

/// Numbers of columns.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ColumnCounts {
    /// Columns with points.
    pub data: u64,
    /// Columns without points that are bridged.
    pub bridged: u64,
}

/// Columns side by side whose heights differ by more cells are parted by a wall.
const WALL: f64 = 2.0;

/// Where the surface lies at a vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// Along the up axis, in cells.
    pub height: f64,
    /// Whether none of the columns round it holds points.
    pub is_bridged: bool,
}

/// Lines of equal length, one for each slice, written in order.
#[derive(Debug)]
pub(super) struct Lines<T> {
    spool: Spool,
    pub(super) width: usize,
    kind: std::marker::PhantomData<T>,
    /// Which were read, if somebody asks.
    trace: Trace,
}

impl<T: Pod> Lines<T> {
    pub(super) fn new(width: u32, context: &Context) -> Lines<T> {
        let spool = context.workspace.spool(context.memory.store_quota);
        Lines { spool, width: width as usize, kind: std::marker::PhantomData, trace: Trace::default() }
    }

    /// Reads lines that were saved.
    fn load(width: u32, saved: &mut SectionReader<'_>, context: &Context) -> Result<Lines<T>> {
        let mut lines = Lines::new(width, context);
        saved.spool(&mut lines.spool)?;
        Ok(lines)
    }

    pub(super) fn append(&mut self, lines: &[T]) -> Result<()> {
        self.spool.append(bytemuck::cast_slice(lines)).map(|_| ())
    }

    fn digest(&self, slice: u32) -> Result<u64> {
        let mut line = vec![0; self.width * size_of::<T>()];
        self.spool.read_at(u64::from(slice) * line.len() as u64, &mut line)?;
        Ok(digest(&line))
    }

    pub(super) fn slices(&self) -> i64 {
        (self.spool.len() as usize / size_of::<T>() / self.width) as i64
    }

    /// The lines of some slices, one behind the other; those that do not exist hold `none`.
    pub(super) fn read(&self, slices: Range<i64>, none: T) -> Result<Vec<T>> {
        let mut out = vec![none; (slices.end - slices.start) as usize * self.width];
        let there = slices.start.clamp(0, self.slices())..slices.end.clamp(0, self.slices());
        there.clone().for_each(|slice| self.trace.read(slice as usize));
        if !there.is_empty() {
            let first = (there.start - slices.start) as usize * self.width;
            let len = (there.end - there.start) as usize * self.width;
            let at = there.start as u64 * (self.width * size_of::<T>()) as u64;
            self.spool.read_at(at, bytemuck::cast_slice_mut(&mut out[first..first + len]))?;
        }
        Ok(out)
    }
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

impl HeightField {
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

    /// Which of the four columns at a corner on plane `j`, between columns `column` − 1 and `column`, are live: bit dy + 2 · dc is the one on slice
    /// j − 1 + dy.
    pub fn live_round(&self, j: i64, column: i64) -> u8 {
        let live = |y, column| u8::from(self.flags(y, column) & LIVE_COLUMN != 0);
        live(j - 1, column - 1) | live(j, column - 1) << 1 | live(j - 1, column) << 2 | live(j, column) << 3
    }

    /// Whether a corner of the surface with this mask is made: one that a face touches that is made.
    pub fn holds(&self, corner: [u32; 3], mask: u8) -> bool {
        let live = self.live_round(i64::from(corner[1]), i64::from(corner[self.up.across()]));
        !self.at_bottom(corner) && is_touched(mask, live, self.up.axis)
    }

    /// Whether all faces at a corner that is not on the bottom are made.
    pub fn makes_all_round(&self, corner: [u32; 3]) -> bool {
        !self.trimmed || self.live_round(i64::from(corner[1]), i64::from(corner[self.up.across()])) == 0b1111
    }

    /// Whether a corner lies on the bottom of the grid.
    pub fn at_bottom(&self, corner: [u32; 3]) -> bool {
        corner[self.up.axis] == if self.up.positive { 0 } else { self.cells_up }
    }

    /// Where along the up axis the surface lies at the place `q` of a corner's vertex, in cells: between the heights of the four columns round the corner, by
    /// nearness, if these are known, differ by no more than [`WALL`] unless all of them are bridged, and the corner is no more than a cell away from there and not on the bottom.
    pub fn level(&self, corner: [u32; 3], q: [f64; 3]) -> Option<Level> {
        let (j, column) = (i64::from(corner[1]), i64::from(corner[self.up.across()]));
        let four = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(dy, dc)| self.place(j - 1 + dy, column - 1 + dc));
        let mut heights = [0.0; 4];
        let mut is_bridged = true;
        for (at, height) in four.into_iter().zip(&mut heights) {
            let at = at?;
            *height = f64::from(self.heights[at]);
            is_bridged &= self.flags[at] & DATA == 0;
        }
        let [low, high] = [f64::min, f64::max].map(|of| heights.into_iter().fold(heights[0], of));
        if heights.iter().any(|height| height.is_nan()) || !is_bridged && high - low > WALL {
            return None;
        }
        let part = |at: f64, corner: i64| (at - corner as f64 + 0.5).clamp(0.0, 1.0);
        let (u, v) = (part(q[1], j), part(q[self.up.across()], column));
        let between = |a: f64, b: f64, part: f64| a + part * (b - a);
        let [a, b, c, d] = heights;
        let height = between(between(a, b, v), between(c, d, v), u);
        let corner = self.up.turn(f64::from(corner[self.up.axis]), self.cells_up);
        let is_near = corner > 0.0 && (height - corner).abs() <= 1.0;
        is_near.then(|| Level { height: self.up.turn(height, self.cells_up), is_bridged })
    }
}

/// Whether a face that is made touches a corner with this mask: the top of a live column, or a wall between two live columns side by side. Walls that
/// part live columns from others are not made, however high they are.
///
/// `live` as [`Columns::live_round`] gives it; columns are upright along axis `up`, which is x or z.
pub fn is_touched(mask: u8, live: u8, up: usize) -> bool {
    if live == 0b1111 {
        return true;
    }
    // The cell of a column on either side of the corner, along the up axis.
    let cell = |column: usize, end: usize| {
        let (dy, dc) = (column & 1, column >> 1);
        let (dx, dz) = if up == 0 { (end, dc) } else { (dc, end) };
        mask >> (dx + 2 * dy + 4 * dz) & 1
    };
    let is_live = |column: usize| live >> column & 1 == 1;
    let ends_here = |column: usize| is_live(column) && cell(column, 0) != cell(column, 1);
    let parts = |(a, b): (usize, usize)| is_live(a) && is_live(b) && cell(a, 0) != cell(b, 0);
    (0..4).any(ends_here) || [(0, 1), (2, 3), (0, 2), (1, 3)].into_iter().any(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every arrangement of cells and of live columns, against the twelve faces at a corner.
    #[test]
    fn a_corner_is_touched_if_one_of_its_twelve_faces_is_made() {
        for (up, live, mask) in [0, 2]
            .into_iter()
            .flat_map(|up| (0..16u8).flat_map(move |live| (0..=255u8).map(move |mask| (up, live, mask))))
        {
            let solid = |cell: [usize; 3]| mask >> (cell[0] + 2 * cell[1] + 4 * cell[2]) & 1 == 1;
            let is_live = |cell: [usize; 3]| live >> (cell[1] + 2 * cell[2 - up]) & 1 == 1;
            let cells = (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2]);
            let made = cells
                .flat_map(|cell| (0..3).filter(move |axis| cell[*axis] == 0).map(move |axis| (cell, axis)))
                .any(|(cell, axis)| {
                    let mut next = cell;
                    next[axis] = 1;
                    solid(cell) != solid(next) && is_live(cell) && is_live(next)
                });
            // Live or not, columns that all count make every corner of the surface one.
            let expected = made || live == 0b1111;
            assert_eq!(is_touched(mask, live, up), expected, "up {up} live {live:04b} mask {mask:08b}");
        }
    }
}
