//! Triangles that are near each other: a grid of coarse cells over the boxes of triangles.
//!
//! ```text
//!   layer 2  |   .   |   .   |      a layer is as thick as a coarse cell (2 cells); layers are done one after the other,
//!            +-------+--___--+      so that only one layer's lists exist at a time
//!   layer 1  |   .  _|-~   | |
//!            +----/--+-----|-+      a triangle is listed in every coarse cell its box touches; two whose boxes meet are a
//!   layer 0  |   /   |   . | |      pair in one of them only: that of the greater of their lower ends
//! ```
//!
//! Boxes are in coarse cells and in `f32`: the way from a coordinate there is monotone, so boxes that meet do so still.

use crate::grid::Grid;
use crate::stage::contract::is_gone;

/// Triangles with consecutive numbers that share a box of their own.
pub const BLOCK: usize = 64;

/// The side of a coarse cell, in cells: a triangle is about one cell large, so it is listed in two or three coarse cells.
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

    #[inline]
    fn meets(&self, other: &Extent) -> bool {
        (0..3).all(|a| self.0[a] <= other.1[a] && other.0[a] <= self.1[a])
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

/// A triangle in a layer.
#[derive(Debug, Clone, Copy)]
struct Entry {
    extent: Extent,
    triangle: u32,
    suspect: bool,
}

/// Finds pairs of triangles whose boxes meet. Keeps its buffers.
///
/// Memory: 4 bytes for each coarse cell of a layer, that is one for each place of a slice; some 5 for each triangle, and some 60 for each of one layer's.
#[derive(Debug)]
pub struct Near {
    low: [f64; 3],
    inverse: f64,
    /// The file's axes: that of layers, then of rows, then along rows.
    axes: [usize; 3],
    /// Coarse cells along those.
    size: [usize; 3],
    counts: Vec<u32>,
    entries: Vec<Entry>,
    listed: Vec<u32>,
}

impl Near {
    /// For triangles on `grid` whose places are less `origin`.
    pub fn new(grid: &Grid, origin: [f64; 3]) -> Near {
        let [along, layer, row] = grid.axis().file_axes();
        let [x, y, z] = grid.cells().map(|c| (f64::from(c) / COARSE) as usize + 1);
        Near {
            low: std::array::from_fn(|a| grid.bounds().min[a] - origin[a]),
            inverse: 1.0 / (COARSE * grid.cell_size()),
            axes: [layer, row, along],
            size: [y, z, x],
            counts: Vec::new(),
            entries: Vec::new(),
            listed: Vec::new(),
        }
    }

    /// Tells `found` of every pair of known triangles whose boxes meet, each once, in no particular order.
    pub fn pairs<P: Places>(&mut self, of: &mut P, suspects: Suspects<'_>, mut found: impl FnMut(&P, u32, u32)) {
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
            for t in triangles {
                let extent = self.extent(of, of.triangle(t));
                self.entries.push(Entry { extent, triangle: t, suspect: is_suspect(t) });
            }
            self.list();
            self.meet(layer, |a, b| found(of, a, b));
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
                for t in first..end {
                    let triangle = of.triangle(t);
                    if !is_gone(triangle) && of.is_known(triangle) {
                        let extent = self.extent(of, triangle);
                        whole = whole.union(extent);
                        layers.add(t, self.range(&extent, 0));
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
                for t in start..(start + BLOCK as u32).min(stretch.end) {
                    let triangle = of.triangle(t);
                    if !is_gone(triangle) && of.is_known(triangle) {
                        let extent = self.extent(of, triangle);
                        if marks.meet(self.range(&extent, 0), self.range(&extent, 1)) {
                            layers.add(t, self.range(&extent, 0));
                        }
                    }
                }
            }
        }
        layers.0
    }

    #[inline]
    fn extent<P: Places>(&self, of: &P, triangle: [u32; 3]) -> Extent {
        let [p, q, r] = triangle.map(|v| {
            let place = of.place(v);
            self.axes.map(|a| ((place[a] - self.low[a]) * self.inverse) as f32)
        });
        Extent(std::array::from_fn(|a| p[a].min(q[a]).min(r[a])), std::array::from_fn(|a| p[a].max(q[a]).max(r[a])))
    }

    /// The coarse cells that a box touches along one of the axes; what lies outside the grid counts as its border.
    #[inline]
    fn range(&self, extent: &Extent, a: usize) -> [usize; 2] {
        [self.cell(extent.0[a], a), self.cell(extent.1[a], a)]
    }

    #[inline]
    fn cell(&self, x: f32, a: usize) -> usize {
        (x as usize).min(self.size[a] - 1)
    }

    /// Lists the layer's entries by coarse cell: afterwards cell c's are `listed[counts[c]..counts[c + 1]]`.
    fn list(&mut self) {
        let [_, rows, width] = self.size;
        let mut counts = std::mem::take(&mut self.counts);
        let mut listed = std::mem::take(&mut self.listed);
        counts.clear();
        counts.resize(rows * width + 2, 0);
        let cells = |e: &Entry, count: &mut dyn FnMut(usize)| {
            let ([z0, z1], [x0, x1]) = (self.range(&e.extent, 1), self.range(&e.extent, 2));
            for z in z0..=z1 {
                for x in x0..=x1 {
                    count(z * width + x);
                }
            }
        };
        for entry in &self.entries {
            cells(entry, &mut |c| counts[c + 2] += 1);
        }
        for c in 2..counts.len() {
            counts[c] += counts[c - 1];
        }
        listed.clear();
        listed.resize(counts[rows * width + 1] as usize, 0);
        for (number, entry) in self.entries.iter().enumerate() {
            cells(entry, &mut |c| {
                listed[counts[c + 1] as usize] = number as u32;
                counts[c + 1] += 1;
            });
        }
        (self.counts, self.listed) = (counts, listed);
    }

    /// The pairs of the layer that is listed.
    fn meet(&self, layer: usize, mut found: impl FnMut(u32, u32)) {
        let width = self.size[2];
        for (c, ends) in self.counts.windows(2).take(self.size[1] * width).enumerate() {
            let here = &self.listed[ends[0] as usize..ends[1] as usize];
            for (i, &one) in here.iter().enumerate() {
                let one = &self.entries[one as usize];
                for &other in &here[i + 1..] {
                    let other = &self.entries[other as usize];
                    if one.extent.meets(&other.extent) && (one.suspect || other.suspect) {
                        let at = |a: usize| self.cell(one.extent.0[a].max(other.extent.0[a]), a);
                        if at(2) == c % width && at(1) == c / width && at(0) == layer {
                            found(one.triangle, other.triangle);
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
