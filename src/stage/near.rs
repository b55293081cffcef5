//! Triangles that are near each other: a sweep along rows of coarse cells over the boxes of triangles.
//!
//! ```text
//!   row 2  |      .              a layer is as thick as a coarse cell (2 cells), as is a row in it; layers are done one
//!          +---_____-----        after the other, so that only one layer's lists exist at a time
//!   row 1  | _|-~   |  ___
//!          +/--+----+-|---|      a triangle is listed in every row its box touches; two whose boxes meet are a
//!   row 0  |   |      |   |      pair in one of them only: that of the greater of their lower ends
//! ```
//!
//! The two triangles of a rectangle are listed as one.
//!
//! Boxes are in coarse cells and in `f32`: the way from a coordinate there is monotone, so boxes that meet do so still.

use crate::grid::Grid;
use crate::stage::contract::is_gone;

/// Triangles with consecutive numbers that share a box of their own.
pub const BLOCK: usize = 64;

/// The side of a coarse cell, in cells: a triangle is about one cell large, so it is listed in two or three rows.
const COARSE: f64 = 2.0;

/// An axis-parallel box, in coarse cells: lower and upper end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent([f32; 3], [f32; 3]);

impl Extent {
    /// The box of nothing.
    pub const EMPTY: Extent = Extent([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);

    fn union(self, other: Extent) -> Extent {
        Extent(std::array::from_fn(|a| self.0[a].min(other.0[a])), std::array::from_fn(|a| self.1[a].max(other.1[a])))
    }

    /// All six comparisons are made: which one fails cannot be foreseen, and a wrong guess costs more than all of them.
    #[inline]
    fn meets(&self, other: &Extent) -> bool {
        (0..3).fold(true, |meet, a| meet & (self.0[a] <= other.1[a]) & (other.0[a] <= self.1[a]))
    }
}

/// Triangles by number, and where their corners are.
pub trait Places {
    /// The numbers that triangles have, as two stretches; the second begins at a multiple of [`BLOCK`].
    fn stretches(&self) -> [std::ops::Range<u32>; 2];
    /// The corners of a triangle.
    fn triangle(&self, t: u32) -> [u32; 3];
    /// Whether the places of all corners of a triangle are known.
    fn is_known(&self, triangle: [u32; 3]) -> bool;
    /// The place of a vertex, as it is going to be written.
    fn place(&self, v: u32) -> [f64; 3];
    /// The boxes of blocks of triangles, from the first stretch's first block on.
    fn blocks(&mut self) -> &mut [Extent];
}

/// Which triangles are looked at.
#[derive(Debug, Clone, Copy)]
pub enum Suspects<'a> {
    /// All pairs are wanted; the boxes of blocks are set.
    All,
    /// Pairs of which at least one is among these (sorted); the boxes of their blocks are widened to hold them.
    Some(&'a [u32]),
}

/// Two triangles with consecutive numbers, the first of them even: mostly the two of one rectangle, which are near the same others.
#[derive(Debug, Clone, Copy)]
struct Entry {
    /// Of both.
    whole: Extent,
    /// Of each; that of nothing where it is not known or gone.
    each: [Extent; 2],
    first: u32,
    suspect: bool,
}

/// Finds pairs of triangles whose boxes meet. Keeps its buffers.
///
/// Memory: some 3 bytes for each triangle, and some 110 for each of one layer's.
#[derive(Debug)]
pub struct Near {
    low: [f64; 3],
    inverse: f64,
    /// The file's axes: that of layers, then of rows, then along rows.
    axes: [usize; 3],
    /// Layers and rows.
    size: [usize; 2],
    entries: Vec<Entry>,
    /// Where each row's list ends, and the lists.
    ends: Vec<u32>,
    listed: Vec<u32>,
    /// One row's, by where they begin.
    order: Vec<u64>,
    row: Vec<Entry>,
}

impl Near {
    /// For triangles on `grid` whose places are less `origin`.
    pub fn new(grid: &Grid, origin: [f64; 3]) -> Near {
        let [along, layer, row] = grid.axis().file_axes();
        let [_, y, z] = grid.cells().map(|c| (f64::from(c) / COARSE) as usize + 1);
        Near {
            low: std::array::from_fn(|a| grid.bounds().min[a] - origin[a]),
            inverse: 1.0 / (COARSE * grid.cell_size()),
            axes: [layer, row, along],
            size: [y, z],
            entries: Vec::new(),
            ends: Vec::new(),
            listed: Vec::new(),
            order: Vec::new(),
            row: Vec::new(),
        }
    }

    /// Tells `found` of every pair of known triangles whose boxes meet, each once, in no particular order.
    pub fn pairs<P: Places>(
        &mut self,
        of: &mut P,
        suspects: Suspects<'_>,
        mut found: impl FnMut(&P, [u32; 3], [u32; 3]),
    ) {
        let layers = match suspects {
            Suspects::All => self.layers_of_all(of),
            Suspects::Some(suspects) => self.layers_near(of, suspects),
        };
        let is_suspect = |t: u32| match suspects {
            Suspects::All => true,
            Suspects::Some(suspects) => suspects.binary_search(&t).is_ok(),
        };
        for (layer, triangles) in layers {
            self.entries.clear();
            for first in triangles {
                let each = self.extents(of, first);
                let whole = each[0].union(each[1]);
                // The two themselves are a pair, where they first appear.
                if each[0].meets(&each[1]) && self.range(&whole, 0)[0] == layer {
                    found(of, of.triangle(first), of.triangle(first + 1));
                }
                let suspect = is_suspect(first) || is_suspect(first + 1);
                self.entries.push(Entry { whole, each, first, suspect });
            }
            self.list();
            self.sweep(layer, |a, b| found(of, of.triangle(a), of.triangle(b)));
        }
    }

    /// All known triangles by layer; sets the boxes of blocks.
    fn layers_of_all<P: Places>(&self, of: &mut P) -> Vec<(usize, Vec<u32>)> {
        let mut layers = Layers::default();
        let mut block = 0;
        for stretch in of.stretches() {
            let mut first = stretch.start;
            while first < stretch.end {
                let mut whole = Extent::EMPTY;
                let end = (first + BLOCK as u32).min(stretch.end);
                for t in (first..end).step_by(2) {
                    let each = self.extents(of, t);
                    let both = each[0].union(each[1]);
                    if both != Extent::EMPTY {
                        whole = whole.union(both);
                        layers.add(t, self.range(&both, 0));
                    }
                }
                of.blocks()[block] = whole;
                block += 1;
                first = end;
            }
        }
        layers.0
    }

    /// By layer, the triangles that lie in the same layer and row as a suspect.
    fn layers_near<P: Places>(&self, of: &mut P, suspects: &[u32]) -> Vec<(usize, Vec<u32>)> {
        let [first, second] = of.stretches();
        let blocks_of_first = first.len().div_ceil(BLOCK);
        let mut marks = Marks::default();
        for &t in suspects {
            let triangle = of.triangle(t);
            let extent = self.extent(of, triangle);
            marks.add(self.range(&extent, 0), self.range(&extent, 1));
            let block = if t < second.start {
                t as usize / BLOCK
            } else {
                blocks_of_first + (t - second.start) as usize / BLOCK
            };
            let whole = &mut of.blocks()[block];
            *whole = whole.union(extent);
        }
        let mut layers = Layers::default();
        let mut block = 0;
        for stretch in [first, second] {
            for start in stretch.clone().step_by(BLOCK) {
                let whole = of.blocks()[block];
                block += 1;
                if whole == Extent::EMPTY || !marks.meet(self.range(&whole, 0), self.range(&whole, 1)) {
                    continue;
                }
                for t in (start..(start + BLOCK as u32).min(stretch.end)).step_by(2) {
                    let each = self.extents(of, t);
                    let both = each[0].union(each[1]);
                    if both != Extent::EMPTY && marks.meet(self.range(&both, 0), self.range(&both, 1)) {
                        layers.add(t, self.range(&both, 0));
                    }
                }
            }
        }
        layers.0
    }

    /// The boxes of triangles `first` and the next.
    #[inline]
    fn extents<P: Places>(&self, of: &P, first: u32) -> [Extent; 2] {
        let stretches = of.stretches();
        [first, first + 1].map(|t| {
            if stretches.iter().any(|stretch| stretch.contains(&t)) {
                let triangle = of.triangle(t);
                if !is_gone(triangle) && of.is_known(triangle) {
                    return self.extent(of, triangle);
                }
            }
            Extent::EMPTY
        })
    }

    #[inline]
    fn extent<P: Places>(&self, of: &P, triangle: [u32; 3]) -> Extent {
        let [p, q, r] = triangle.map(|v| {
            let place = of.place(v);
            self.axes.map(|a| ((place[a] - self.low[a]) * self.inverse) as f32)
        });
        Extent(std::array::from_fn(|a| p[a].min(q[a]).min(r[a])), std::array::from_fn(|a| p[a].max(q[a]).max(r[a])))
    }

    /// The layers (0) or rows (1) that a box touches; what lies outside the grid counts as its border.
    #[inline]
    fn range(&self, extent: &Extent, a: usize) -> [usize; 2] {
        [self.cell(extent.0[a], a), self.cell(extent.1[a], a)]
    }

    #[inline]
    fn cell(&self, x: f32, a: usize) -> usize {
        (x as usize).min(self.size[a] - 1)
    }

    /// Lists the layer's entries by row: afterwards row z's are those from `ends[z]` to `ends[z + 1]`.
    fn list(&mut self) {
        let mut ends = std::mem::take(&mut self.ends);
        ends.clear();
        ends.resize(self.size[1] + 2, 0);
        for entry in &self.entries {
            let [first, last] = self.range(&entry.whole, 1);
            for end in &mut ends[first + 2..=last + 2] {
                *end += 1;
            }
        }
        for z in 1..ends.len() {
            ends[z] += ends[z - 1];
        }
        self.listed.clear();
        self.listed.resize(ends[self.size[1] + 1] as usize, 0);
        for (number, entry) in self.entries.iter().enumerate() {
            let [first, last] = self.range(&entry.whole, 1);
            for end in &mut ends[first + 1..=last + 1] {
                self.listed[*end as usize] = number as u32;
                *end += 1;
            }
        }
        self.ends = ends;
    }

    /// The pairs of the layer that is listed: along each row, from where one box begins to where it ends, others begin.
    fn sweep(&mut self, layer: usize, mut found: impl FnMut(u32, u32)) {
        // Positive floats are ordered as their bits are.
        let begins = |entry: &Entry| entry.whole.0[2].max(0.0);
        for z in 0..self.size[1] {
            self.order.clear();
            for &number in &self.listed[self.ends[z] as usize..self.ends[z + 1] as usize] {
                let key = u64::from(begins(&self.entries[number as usize]).to_bits());
                self.order.push(key << 32 | u64::from(number));
            }
            self.order.sort_unstable();
            self.row.clear();
            self.row.extend(self.order.iter().map(|key| self.entries[*key as u32 as usize]));
            for (i, one) in self.row.iter().enumerate() {
                let end = one.whole.1[2].max(0.0);
                for other in &self.row[i + 1..] {
                    if begins(other) > end {
                        break;
                    }
                    if one.whole.meets(&other.whole) && (one.suspect || other.suspect) {
                        let at = |a: usize| self.cell(one.whole.0[a].max(other.whole.0[a]), a);
                        if at(1) == z && at(0) == layer {
                            for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                                if one.each[i].meets(&other.each[j]) {
                                    found(one.first + i as u32, other.first + j as u32);
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Triangles by layer; a triangle that touches several is in each.
#[derive(Debug, Default)]
struct Layers(Vec<(usize, Vec<u32>)>);

impl Layers {
    fn add(&mut self, t: u32, [first, last]: [usize; 2]) {
        for layer in first..=last {
            // Few layers, and mostly the same one as for the triangle before.
            match self.0.iter().rposition(|(number, _)| *number == layer) {
                Some(at) => self.0[at].1.push(t),
                None => self.0.push((layer, vec![t])),
            }
        }
    }
}

/// The rows that suspects touch: of each layer, bits.
#[derive(Debug, Default)]
struct Marks(Vec<(usize, Vec<u64>)>);

impl Marks {
    fn add(&mut self, [first, last]: [usize; 2], [low, high]: [usize; 2]) {
        for layer in first..=last {
            let at = self.0.iter().position(|(number, _)| *number == layer).unwrap_or_else(|| {
                self.0.push((layer, Vec::new()));
                self.0.len() - 1
            });
            let rows = &mut self.0[at].1;
            if rows.len() <= high / 64 {
                rows.resize(high / 64 + 1, 0);
            }
            for row in low..=high {
                rows[row / 64] |= 1 << (row % 64);
            }
        }
    }

    fn meet(&self, [first, last]: [usize; 2], [low, high]: [usize; 2]) -> bool {
        self.0.iter().filter(|(layer, _)| (first..=last).contains(layer)).any(|(_, rows)| {
            (low..=high.min((rows.len() * 64).saturating_sub(1))).any(|row| rows[row / 64] >> (row % 64) & 1 == 1)
        })
    }
}
