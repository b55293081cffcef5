//! Heights of columns: which are kept, and those interpolated where there are no points, on a lattice of ever coarser cells.

use super::columns::{ColumnCounts, DATA, HeightFieldOptions, KEPT, LIVE_COLUMN, live_reach};
use super::extent::Extent;

/// The columns of a job's slices, and of a coarsest cell's more on either side.
pub struct Patch {
    pub width: usize,
    pub side: usize,
    /// The first slice, and the first behind the grid's last.
    pub first: i64,
    pub end: i64,
    /// The grid's cells along the direction that is up.
    pub cells_up: u32,
    pub extents: Vec<Extent>,
}

impl Patch {
    /// Heights, tops and flags of the first `slices` slices behind the first side.
    pub fn of(&self, slices: usize, asked: HeightFieldOptions) -> (Vec<f32>, Vec<u32>, Vec<u8>, ColumnCounts) {
        let (width, rows) = (self.width, self.extents.len() / self.width);
        let own = self.side * width..(self.side + slices) * width;
        let is_data = |i: usize| self.extents[i].is_data();

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

        let levels = self.levels(asked.one_layer);
        let mut heights = Vec::with_capacity(own.len());
        let mut tops = Vec::with_capacity(own.len());
        let mut flags = Vec::with_capacity(own.len());
        let mut found = ColumnCounts::default();
        for i in own {
            let (row, x) = (i / width, i % width);
            let padded = row * wide + pad + x;
            let flag = if is_data(i) { DATA } else { 0 }
                | if mask[padded] { KEPT } else { 0 }
                | if live[padded] { LIVE_COLUMN } else { 0 };
            let (height, top) = if is_data(i) {
                (self.extents[i].top_height() as f32, self.extents[i].top)
            } else if flag & LIVE_COLUMN != 0 {
                let height = levels[0].between(x, row) as f32;
                // Points on the box's upper side lie at the end of its highest cells.
                (height, (height as u32 + 1).min(self.cells_up))
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

    /// Heights of columns with points, averaged over ever larger cells of the lattice: level l has cells of 2^(l + 1) columns and slices. What has no points is interpolated
    /// from the level above.
    fn levels(&self, steps: bool) -> Vec<Level> {
        let known = |x: usize, row: usize| match self.extents.get(row * self.width + x) {
            Some(extent) if x < self.width && extent.is_data() => extent.floor_height(),
            _ => f64::NAN,
        };
        let mut levels = vec![Level::over(
            self.width,
            self.extents.len() / self.width,
            [Alike::on(0, steps), Alike::on(1, steps)],
            known,
        )];
        for l in 2..=self.side.ilog2() {
            let below = &levels[levels.len() - 1];
            levels.push(Level::over(
                below.width,
                below.values.len() / below.width,
                [Alike::on(l - 1, steps), Alike::on(l, steps)],
                |x, row| below.at(x as i64, row as i64),
            ));
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

/// By how much heights that are averaged may differ.
#[derive(Debug, Clone, Copy)]
struct Alike(f64);

impl Alike {
    /// Of cells of level `level`, if heights that differ much are parted by a step: what a slope makes of their distance, and a bit. Else by anything.
    fn on(level: u32, steps: bool) -> Alike {
        Alike(if steps { 2.0 + 0.5 * f64::from(1u32 << level) } else { f64::INFINITY })
    }

    fn are(self, a: f64, b: f64) -> bool {
        (a - b).abs() <= self.0
    }

    /// The mean of the most values that are alike, of equal numbers the lowest; NaN where none is known.
    fn mean(self, values: [f64; 4]) -> f64 {
        let mut best = (0, f64::NAN, f64::NAN);
        for lowest in values.into_iter().filter(|value| !value.is_nan()) {
            let alike = values.into_iter().filter(|value| *value >= lowest && self.are(*value, lowest));
            let (count, sum) = alike.fold((0, 0.0), |(count, sum), value| (count + 1, sum + value));
            if count > best.0 || count == best.0 && lowest < best.1 {
                best = (count, lowest, sum / f64::from(count));
            }
        }
        best.2
    }
}

/// A level of the lattice: NaN where nothing is known.
struct Level {
    width: usize,
    values: Vec<f64>,
    alike: Alike,
}

impl Level {
    /// The level above one of `width` by `rows`: means of two by two values, as far as there are any and they are alike.
    fn over(width: usize, rows: usize, [alike, here]: [Alike; 2], below: impl Fn(usize, usize) -> f64) -> Level {
        let (half, rows) = (width.div_ceil(2), rows / 2);
        let mut values = Vec::with_capacity(half * rows);
        for row in 0..rows {
            for x in 0..half {
                let four = [(0, 0), (1, 0), (0, 1), (1, 1)]
                    .map(|(dx, dy)| if 2 * x + dx < width { below(2 * x + dx, 2 * row + dy) } else { f64::NAN });
                values.push(alike.mean(four));
            }
        }
        Level { width: half, values, alike: here }
    }

    fn at(&self, x: i64, row: i64) -> f64 {
        if x < 0 || row < 0 || x >= self.width as i64 {
            return f64::NAN;
        }
        self.values.get(row as usize * self.width + x as usize).copied().unwrap_or(f64::NAN)
    }

    /// The value at a place of the level below: of the four nearest cells, by nearness, as far as they have one like that of the nearest.
    fn between(&self, x: usize, row: usize) -> f64 {
        let nearer = |at: usize| (at as i64 / 2, at as i64 / 2 + if at.is_multiple_of(2) { -1 } else { 1 });
        let ((x0, x1), (y0, y1)) = (nearer(x), nearer(row));
        let (mut sum, mut weights, mut nearest) = (0.0, 0.0, f64::NAN);
        for (x, row, weight) in [(x0, y0, 9.0), (x1, y0, 3.0), (x0, y1, 3.0), (x1, y1, 1.0)] {
            let value = self.at(x, row);
            if nearest.is_nan() {
                nearest = value;
            }
            if !value.is_nan() && self.alike.are(value, nearest) {
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
pub fn without_pinches(set: &[bool], width: usize) -> Vec<bool> {
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
