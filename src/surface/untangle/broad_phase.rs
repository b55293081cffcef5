//! The broad phase: finds triangles whose boxes meet, by a sweep along rows of coarse cells.
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
//! Boxes are those of `quantized.rs`; what counts is which of them meet, not how far they reach.

use std::ops::Range;

use crate::grid::Grid;
use crate::grid::slice::set_range;
use crate::surface::untangle::quantized::{PackedBox, QuantizedPoint, Quantizer};

/// Triangles with consecutive numbers that share a box of their own.
pub const BLOCK: usize = 64;

/// The most entries of a layer that are looked at together: a layer with more is done in bands of rows. Only a single row may have more.
const BAND: usize = 1 << 16;

/// Rows that an entry is listed in, and layers, on average: a triangle is about a cell large, and rows and layers are two cells thick.
const LISTED: u64 = 2;

/// Triangles by number, and where their corners are.
pub trait TriangleSet {
    /// The numbers that triangles have, as two stretches; the second begins at a multiple of [`BLOCK`].
    fn stretches(&self) -> [Range<u32>; 2];
    /// The corners of a triangle.
    fn triangle(&self, t: u32) -> [u32; 3];
    /// Whether the positions of all corners of a triangle are known.
    fn is_known(&self, triangle: [u32; 3]) -> bool;
    /// The corners of triangle `t`, if there is one of that number, it is left, and its places are known.
    fn known(&self, t: u32) -> Option<[u32; 3]>;
    /// The quantized point of a vertex, at the place that is going to be written.
    fn quantized_point(&self, v: u32) -> QuantizedPoint;
    /// The boxes of blocks of triangles, from the first stretch's first block on.
    fn blocks(&mut self) -> &mut [PackedBox];
    /// Takes note that a block's box was widened for a dirty triangle with these corners.
    fn widened(&self, _triangle: [u32; 3]) {}
}

/// The triangles among which pairs are looked for.
#[derive(Debug, Clone, Copy)]
pub enum Dirty<'a> {
    /// All pairs are wanted; the boxes of blocks are set.
    All,
    /// Pairs of which at least one is among these (sorted); the boxes of their blocks are widened to hold them.
    Some(&'a [u32]),
}

/// Two triangles with consecutive numbers, the first of them even: mostly the two of one rectangle, which are near the same others.
#[derive(Debug, Clone, Copy)]
struct Entry {
    /// The box of both triangles.
    whole: PackedBox,
    /// The box of each triangle; that of nothing if the triangle is not known, or gone.
    each: [PackedBox; 2],
    /// The corners at which the rectangle, or the lone triangle, certainly does not meet another one. Elsewhere: a number that no vertex and no other
    /// entry has.
    sure: [u32; 4],
    first: u32,
    dirty: bool,
}

impl Entry {
    /// Whether the two entries have a corner in common at which they certainly do not meet.
    #[inline]
    fn are_sure(&self, other: &Entry) -> bool {
        // All of them, without a branch: this is asked once for every two rectangles side by side.
        self.sure.iter().fold(false, |any, v| any | other.sure.iter().fold(false, |any, w| any | (v == w)))
    }
}

/// Finds pairs of triangles whose boxes meet. Keeps its buffers.
///
/// Memory: [`BroadPhase::bytes`].
#[derive(Debug)]
pub struct BroadPhase {
    quantizer: Quantizer,
    /// The most entries of a band: [`BAND`], but in tests.
    band: usize,
    entries: Vec<Entry>,
    /// Where each row's list ends, and the lists.
    ends: Vec<u32>,
    listed: Vec<u32>,
    /// One row's, by where they begin.
    order: Vec<u64>,
    row: Vec<(PackedBox, u32)>,
}

impl BroadPhase {
    /// For triangles on `grid` whose places are less `origin`.
    pub fn new(grid: &Grid, origin: [f64; 3]) -> BroadPhase {
        let (entries, ends, listed, order, row) = Default::default();
        BroadPhase { quantizer: Quantizer::new(grid, origin), band: BAND, entries, ends, listed, order, row }
    }

    /// Bytes for a mesh of `faces` rectangles, of which no layer has more than `layer`: the entries of a band and their lists, and the numbers of all
    /// layers' triangles, in vectors that have grown by doubling.
    pub fn bytes(faces: u64, layer: u64) -> u64 {
        let listed = LISTED * size_of::<u32>() as u64;
        layer.min(BAND as u64) * (size_of::<Entry>() as u64 + 2 * listed) + faces * 2 * listed
    }

    /// How places are quantized.
    pub fn quantizer(&self) -> Quantizer {
        self.quantizer
    }

    /// Tells `found` the numbers of every pair of known triangles whose boxes meet, each pair once, in no particular order. Left out are pairs in rectangles with a
    /// common corner of which `is_ring` is true ([`crate::surface::untangle::star`]).
    pub fn pairs<P: TriangleSet>(
        &mut self,
        of: &mut P,
        dirty: Dirty<'_>,
        is_ring: impl Fn(u32) -> bool,
        mut found: impl FnMut(&P, u32, u32),
    ) {
        let layers = match dirty {
            Dirty::All => self.layers_of_all(of),
            Dirty::Some(dirty) => self.layers_near(of, dirty),
        };
        for (layer, triangles) in layers {
            for (band, entries) in self.bands(of, &triangles) {
                self.entries.clear();
                self.entries.reserve_exact(entries);
                // Both are sorted.
                let mut to_come = match dirty {
                    Dirty::All => [].as_slice(),
                    Dirty::Some(dirty) => dirty,
                };
                for &first in &triangles {
                    let both = [of.known(first), of.known(first + 1)];
                    let each = both.map(|triangle| triangle.map_or(PackedBox::EMPTY, |triangle| extent(of, triangle)));
                    let whole = each[0].union(each[1]);
                    let [lowest, highest] = self.quantizer.rows_of(&whole);
                    if lowest >= band.end || highest < band.start {
                        continue;
                    }
                    let number = self.entries.len() as u32;
                    let sure = match corners(both) {
                        Some(corners) => corners.map(|v| if is_ring(v) { v } else { !number }),
                        None => [!number; 4],
                    };
                    // The two themselves are a pair, where they first appear.
                    if let [Some(_), Some(_)] = both
                        && sure == [!number; 4]
                        && each[0].meets(&each[1])
                        && self.quantizer.layers(&whole)[0] == layer
                        && band.contains(&lowest)
                    {
                        found(of, first, first + 1);
                    }
                    while to_come.first().is_some_and(|t| *t < first) {
                        to_come = &to_come[1..];
                    }
                    let dirty = matches!(dirty, Dirty::All) || to_come.first().is_some_and(|t| *t <= first + 1);
                    self.entries.push(Entry { whole, each, sure, first, dirty });
                }
                self.list(&band);
                self.sweep(layer, &band, |a, b| found(of, a, b));
            }
        }
    }

    /// The rows of a layer in bands that have no more than [`BAND`] entries each, if they have several rows, and how many entries each has at most.
    fn bands<P: TriangleSet>(&self, of: &P, triangles: &[u32]) -> Vec<(Range<usize>, usize)> {
        let rows = self.quantizer.rows();
        if triangles.len() <= self.band {
            return vec![(0..rows, triangles.len())];
        }
        // Of each row, the entries that begin there, and those that touch it.
        let mut counts = vec![[0usize; 2]; rows];
        for &first in triangles {
            let [lowest, highest] = self.quantizer.rows_of(&extent_of_both(of, first));
            counts[lowest][0] += 1;
            counts[lowest..=highest].iter_mut().for_each(|[_, touch]| *touch += 1);
        }
        let mut bands = Vec::new();
        let (mut start, mut entries) = (0, 0);
        for (row, [begin, touch]) in counts.into_iter().enumerate() {
            if row > start && entries + begin > self.band {
                bands.push((start..row, entries));
                (start, entries) = (row, 0);
            }
            entries += if row == start { touch } else { begin };
        }
        bands.push((start..rows, entries));
        bands
    }

    /// All known triangles by layer; sets the boxes of blocks.
    fn layers_of_all<P: TriangleSet>(&self, of: &mut P) -> Vec<(usize, Vec<u32>)> {
        let mut layers = Layers::default();
        let mut block = 0;
        for stretch in of.stretches() {
            let mut first = stretch.start;
            while first < stretch.end {
                let mut whole = PackedBox::EMPTY;
                let end = (first + BLOCK as u32).min(stretch.end);
                for t in (first..end).step_by(2) {
                    let both = extent_of_both(of, t);
                    if both != PackedBox::EMPTY {
                        whole = whole.union(both);
                        layers.add(t, self.quantizer.layers(&both));
                    }
                }
                of.blocks()[block] = whole;
                block += 1;
                first = end;
            }
        }
        layers.0
    }

    /// By layer, the triangles that touch a coarse cell that a dirty triangle touches.
    fn layers_near<P: TriangleSet>(&self, of: &mut P, dirty: &[u32]) -> Vec<(usize, Vec<u32>)> {
        let [first, second] = of.stretches();
        let blocks_of_first = first.len().div_ceil(BLOCK);
        let mut marks = Marks::new(self.quantizer);
        for &t in dirty {
            let triangle = of.triangle(t);
            let extent = extent(of, triangle);
            marks.add(&extent);
            let block = if t < second.start {
                t as usize / BLOCK
            } else {
                blocks_of_first + (t - second.start) as usize / BLOCK
            };
            let whole = &mut of.blocks()[block];
            *whole = whole.union(extent);
            of.widened(triangle);
        }
        let mut layers = Layers::default();
        let mut block = 0;
        for stretch in [first, second] {
            for start in stretch.clone().step_by(BLOCK) {
                let whole = of.blocks()[block];
                block += 1;
                if whole == PackedBox::EMPTY || !marks.meet(&whole) {
                    continue;
                }
                for t in (start..(start + BLOCK as u32).min(stretch.end)).step_by(2) {
                    let both = extent_of_both(of, t);
                    if both != PackedBox::EMPTY && marks.meet(&both) {
                        layers.add(t, self.quantizer.layers(&both));
                    }
                }
            }
        }
        layers.0
    }

    /// Lists the entries by row of the band: afterwards those of its row z are those from `ends[z]` to `ends[z + 1]`, counted from the band's first row.
    fn list(&mut self, band: &Range<usize>) {
        let mut ends = std::mem::take(&mut self.ends);
        ends.clear();
        ends.resize(band.len() + 2, 0);
        let rows_of = |entry: &Entry| {
            let [first, last] = self.quantizer.rows_of(&entry.whole);
            [first.max(band.start) - band.start, last.min(band.end - 1) - band.start]
        };
        for entry in &self.entries {
            let [first, last] = rows_of(entry);
            for end in &mut ends[first + 2..=last + 2] {
                *end += 1;
            }
        }
        for z in 1..ends.len() {
            ends[z] += ends[z - 1];
        }
        self.listed.clear();
        self.listed.resize(ends[band.len() + 1] as usize, 0);
        for (number, entry) in self.entries.iter().enumerate() {
            let [first, last] = rows_of(entry);
            for end in &mut ends[first + 1..=last + 1] {
                self.listed[*end as usize] = number as u32;
                *end += 1;
            }
        }
        self.ends = ends;
    }

    /// The pairs of the band that is listed: along each row, from where one box begins to where it ends, others begin.
    fn sweep(&mut self, layer: usize, band: &Range<usize>, mut found: impl FnMut(u32, u32)) {
        for z in 0..band.len() {
            let listed = &self.listed[self.ends[z] as usize..self.ends[z + 1] as usize];
            let begins = |number: u32| self.entries[number as usize].whole.begin();
            self.order.clear();
            self.order.extend(listed.iter().map(|&number| u64::from(begins(number)) << 32 | u64::from(number)));
            self.order.sort_unstable();
            self.row.clear();
            self.row.extend(self.order.iter().map(|key| (self.entries[*key as u32 as usize].whole, *key as u32)));
            let cell = self.quantizer.cell(layer, band.start + z);
            for (i, (one, number)) in self.row.iter().enumerate() {
                let end = one.end();
                for (other, other_number) in self.row[i + 1..].iter().take_while(|(other, _)| other.begin() <= end) {
                    if one.meets(other) && self.quantizer.first_common(one, other) == cell {
                        let (one, other) = (&self.entries[*number as usize], &self.entries[*other_number as usize]);
                        if !(one.dirty || other.dirty) || one.are_sure(other) {
                            continue;
                        }
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

/// The box of triangles `first` and the next.
#[inline]
fn extent_of_both<P: TriangleSet>(of: &P, first: u32) -> PackedBox {
    let both = [of.known(first), of.known(first + 1)];
    match (corners(both), both) {
        (Some([a, b, c, d]), _) => {
            let [a, b, c, d] = [a, b, c, d].map(|v| of.quantized_point(v));
            PackedBox::of([a, b, c]).union(PackedBox::of([d, d, d]))
        }
        (None, [Some(one), Some(other)]) => extent(of, one).union(extent(of, other)),
        _ => PackedBox::EMPTY,
    }
}

/// The corners of the rectangle that two triangles make, in order round it, or of a lone triangle, the last one twice. None if they make none.
///
/// ```text
///   3---2    diagonal 0: (0 1 2) (0 2 3)
///   |   |    diagonal 1: (0 1 3) (1 2 3)
///   0---1
/// ```
#[inline]
pub fn corners(both: [Option<[u32; 3]>; 2]) -> Option<[u32; 4]> {
    match both {
        [Some([a, b, c]), Some([d, e, f])] if d == a && e == c => Some([a, b, c, f]),
        [Some([a, b, c]), Some([d, e, f])] if d == b && f == c => Some([a, b, e, c]),
        [Some([a, b, c]), None] | [None, Some([a, b, c])] => Some([a, b, c, c]),
        _ => None,
    }
}

#[inline]
fn extent<P: TriangleSet>(of: &P, triangle: [u32; 3]) -> PackedBox {
    PackedBox::of(triangle.map(|v| of.quantized_point(v)))
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

/// The coarse cells that dirty triangles touch: of each layer, bits, row after row.
#[derive(Debug)]
struct Marks {
    quantizer: Quantizer,
    /// Words of a row.
    words: usize,
    layers: Vec<(usize, Vec<u64>)>,
}

impl Marks {
    fn new(quantizer: Quantizer) -> Marks {
        Marks { quantizer, words: quantizer.columns().div_ceil(64), layers: Vec::new() }
    }

    fn add(&mut self, extent: &PackedBox) {
        let [first, last] = self.quantizer.layers(extent);
        let ([low, high], [left, right]) = (self.quantizer.rows_of(extent), self.quantizer.columns_of(extent));
        for layer in first..=last {
            let at = self.layers.iter().position(|(number, _)| *number == layer).unwrap_or_else(|| {
                self.layers.push((layer, vec![0; self.words * self.quantizer.rows()]));
                self.layers.len() - 1
            });
            for row in low..=high {
                let words = &mut self.layers[at].1[row * self.words..][..self.words];
                set_range(words, left as u32, right as u32 + 1);
            }
        }
    }

    fn meet(&self, extent: &PackedBox) -> bool {
        let [first, last] = self.quantizer.layers(extent);
        let ([low, high], [left, right]) = (self.quantizer.rows_of(extent), self.quantizer.columns_of(extent));
        self.layers.iter().filter(|(layer, _)| (first..=last).contains(layer)).any(|(_, bits)| {
            (low..=high).any(|row| {
                (left / 64..=right / 64).any(|word| {
                    let from = u64::MAX << (if word == left / 64 { left % 64 } else { 0 });
                    let to = u64::MAX >> (if word == right / 64 { 63 - right % 64 } else { 0 });
                    bits[row * self.words + word] & from & to != 0
                })
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;
    use crate::points::bounds::{Axis, Bounds};
    use crate::settings::{AxisChoice, Resolution};

    /// Triangles in two stretches, with gone ones among them, and one without known corners at the end.
    struct Soup {
        triangles: Vec<[u32; 3]>,
        quantized: Vec<QuantizedPoint>,
        blocks: Vec<PackedBox>,
    }

    /// Where the second stretch begins.
    const SECOND: u32 = 2 * BLOCK as u32;

    impl Soup {
        fn at(&self, t: u32) -> Option<[u32; 3]> {
            let second = t.checked_sub(SECOND).map(|t| t + BLOCK as u32);
            let index = if t < BLOCK as u32 { Some(t) } else { second };
            self.triangles.get(index? as usize).copied()
        }

        fn all(&self) -> impl Iterator<Item = u32> {
            self.stretches().into_iter().flatten()
        }
    }

    impl TriangleSet for Soup {
        fn stretches(&self) -> [Range<u32>; 2] {
            let all = self.triangles.len() as u32;
            let first = all.min(BLOCK as u32);
            [0..first, SECOND..SECOND + all - first]
        }

        fn triangle(&self, t: u32) -> [u32; 3] {
            self.at(t).expect("a number that is in use")
        }

        fn is_known(&self, triangle: [u32; 3]) -> bool {
            triangle.iter().all(|v| (*v as usize) < self.quantized.len())
        }

        fn known(&self, t: u32) -> Option<[u32; 3]> {
            self.at(t).filter(|t| self.is_known(*t) && t[0] != t[1] && t[1] != t[2] && t[2] != t[0])
        }

        fn quantized_point(&self, v: u32) -> QuantizedPoint {
            self.quantized[v as usize]
        }

        fn blocks(&mut self) -> &mut [PackedBox] {
            &mut self.blocks
        }
    }

    /// Vertices in a box of cells, and triangles of neighbours in the list of them: small ones among large ones, some gone, some with a corner that is not known.
    fn soup() -> impl Strategy<Value = (Vec<[f64; 3]>, Vec<[u32; 3]>)> {
        let vertex = (0.0..24.0, 0.0..10.0, 0.0..24.0).prop_map(|(x, y, z): (f64, f64, f64)| [x, y, z]);
        (prop::collection::vec(vertex, 8..60), 0u32..1000).prop_flat_map(|(vertices, seed)| {
            let count = vertices.len() as u32;
            let triangle = (0..=count, 1..4u32, 0..6u32)
                .prop_map(move |(a, b, c)| [a, (a + b) % count, (a + b + c + seed) % count]);
            (Just(vertices), prop::collection::vec(triangle, 2..200))
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        /// Against all pairs of boxes: each pair that has something dirty is found once, and none that does not meet; whatever the bands.
        #[test]
        fn pairs_are_those_of_all_boxes_with_all((vertices, triangles) in soup(), band in 1usize..300, dirty in prop::collection::vec(any::<bool>(), 200)) {
            let bounds = Bounds { min: [0.0; 3], max: [24.0, 10.0, 24.0] };
            let grid = Grid::new(1, &bounds, Resolution::Cell(1.0), AxisChoice::Fixed(Axis::Y)).unwrap();
            let mut phase = BroadPhase { band, ..BroadPhase::new(&grid, [0.0; 3]) };
            let quantized = vertices.iter().map(|v| phase.quantizer().quantized_point(*v)).collect();
            let mut soup = Soup { triangles, quantized, blocks: vec![PackedBox::EMPTY; 5] };

            let boxes: Vec<([u32; 3], u32, PackedBox)> =
                soup.all().filter_map(|t| Some((soup.known(t)?, t, extent(&soup, soup.known(t)?)))).collect();
            let mut meeting = BTreeMap::new();
            for (i, (one, t, a)) in boxes.iter().enumerate() {
                for (other, u, b) in &boxes[i + 1..] {
                    if a.meets(b) {
                        let mut key = [*one, *other];
                        key.sort_unstable();
                        meeting.entry(key).or_insert_with(Vec::new).push([*t, *u]);
                    }
                }
            }
            let mut look = |dirty: Dirty<'_>| {
                let mut found = BTreeMap::new();
                phase.pairs(&mut soup, dirty, |_| false, |soup, a, b| {
                    let mut key = [a, b].map(|t| soup.triangle(t));
                    key.sort_unstable();
                    *found.entry(key).or_insert(0usize) += 1;
                });
                found
            };
            let all = look(Dirty::All);
            for (key, pairs) in &meeting {
                prop_assert!(all.get(key).is_some_and(|times| *times == pairs.len()), "{key:?}: {:?} of {pairs:?}", all.get(key));
            }
            prop_assert_eq!(all.len(), meeting.len());

            let some: Vec<u32> = boxes.iter().map(|(_, t, _)| *t).filter(|t| dirty[*t as usize % dirty.len()]).collect();
            let found = look(Dirty::Some(&some));
            for (key, pairs) in &meeting {
                let least = pairs.iter().filter(|pair| pair.iter().any(|t| some.contains(t))).count();
                let times = found.get(key).copied().unwrap_or(0);
                prop_assert!((least..=pairs.len()).contains(&times), "{key:?}: {times} of {least}");
            }
            prop_assert!(found.keys().all(|key| meeting.contains_key(key)));
        }
    }
}
