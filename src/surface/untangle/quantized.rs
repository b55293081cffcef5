//! Quantized points, and boxes of them, packed into words: what the broad phase compares.
//!
//! ```text
//!   bit 63 | 62 guard  61..42 along rows | 41 guard  40..21 layer | 20 guard  19..0 row |
//! ```
//!
//! A quantized point is a place in whole units, a fraction of a coarse cell, as three numbers in one word. The way from a coordinate to its number is monotone,
//! so boxes that meet do so still. All three numbers are compared by one subtraction: a guard bit, set before, is borrowed from where the number
//! taken away was the larger.

use crate::grid::{Gaps, Grid};

/// The side of a coarse cell, in cells: a triangle is about one cell large, so it is listed in two or three rows.
const COARSE: f64 = 2.0;

/// Bits of one number, and from one to the next.
const BITS: u32 = 20;
const STEP: u32 = BITS + 1;

const GUARDS: u64 = 1 << BITS | 1 << (BITS + STEP) | 1 << (BITS + 2 * STEP);

/// The numbers of layers, of rows, and along rows: how far each is shifted.
const SHIFTS: [u32; 3] = [STEP, 0, 2 * STEP];

/// A place in whole units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QuantizedPoint(u64);

impl QuantizedPoint {
    /// The guards of the numbers that are not less than the other's.
    #[inline]
    fn not_less(self, other: QuantizedPoint) -> u64 {
        ((self.0 | GUARDS) - other.0) & GUARDS
    }

    /// Number by number, the lesser and the greater.
    #[inline]
    fn sorted(self, other: QuantizedPoint) -> [QuantizedPoint; 2] {
        let guards = self.not_less(other);
        let here = guards - (guards >> BITS);
        let differ = self.0 ^ other.0;
        [QuantizedPoint(self.0 ^ (differ & here)), QuantizedPoint(other.0 ^ (differ & here))]
    }

    #[inline]
    fn number(self, a: usize) -> u32 {
        (self.0 >> SHIFTS[a]) as u32 & ((1 << BITS) - 1)
    }
}

/// An axis-parallel box, ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PackedBox {
    low: QuantizedPoint,
    high: QuantizedPoint,
}

impl PackedBox {
    /// The box of nothing. It meets no other: no quantized point's number is as large as its lower end's.
    pub const EMPTY: PackedBox = PackedBox { low: QuantizedPoint(GUARDS - (GUARDS >> BITS)), high: QuantizedPoint(0) };

    /// The box of a triangle.
    #[inline]
    pub fn of([a, b, c]: [QuantizedPoint; 3]) -> PackedBox {
        let [low, high] = a.sorted(b);
        PackedBox { low: low.sorted(c)[0], high: high.sorted(c)[1] }
    }

    /// The box of both.
    #[inline]
    pub fn union(self, other: PackedBox) -> PackedBox {
        PackedBox { low: self.low.sorted(other.low)[0], high: self.high.sorted(other.high)[1] }
    }

    /// Whether the two have a quantized point in common.
    #[inline]
    pub fn meets(&self, other: &PackedBox) -> bool {
        self.high.not_less(other.low) & other.high.not_less(self.low) == GUARDS
    }

    /// Where it begins along rows.
    #[inline]
    pub fn begin(&self) -> u32 {
        self.low.number(2)
    }

    /// Where it ends along rows.
    #[inline]
    pub fn end(&self) -> u32 {
        self.high.number(2)
    }
}

/// How places are quantized.
#[derive(Debug, Clone, Copy)]
pub struct Quantizer {
    low: [f64; 3],
    inverse: f64,
    /// What is left out along layers, rows and columns, with cells for a unit of length, and quantization steps in a cell.
    gaps: Option<([Gaps; 3], [f64; 2])>,
    /// The file's axes: that of layers, then of rows, then along rows.
    axes: [usize; 3],
    /// The greatest number of each.
    top: [u32; 3],
    /// A coarse cell is `1 << units` units large.
    units: u32,
}

impl Quantizer {
    /// For places in `grid` that are less `origin`. Those outside are taken to its border.
    pub fn new(grid: &Grid, origin: [f64; 3]) -> Quantizer {
        let [along, layer, row] = grid.axis().file_axes();
        let (low, cells) = grid.file_box();
        let [x, y, z] = cells.map(|c| (f64::from(c) / COARSE) as u32 + 1);
        // As fine as the numbers go; the highest one is the empty box's.
        let units = ((1 << BITS) - 1) / x.max(y).max(z);
        let units = units.ilog2();
        Quantizer {
            low: std::array::from_fn(|a| low[a] - origin[a]),
            inverse: f64::from(1u32 << units) / (COARSE * grid.cell_size()),
            gaps: grid.has_gaps().then(|| {
                let [x, y, z] = grid.gaps();
                ([y, z, x], [1.0 / grid.cell_size(), f64::from(1u32 << units) / COARSE])
            }),
            axes: [layer, row, along],
            top: [y, z, x].map(|cells| (cells << units) - 1),
            units,
        }
    }

    /// The quantized point of a place.
    #[inline]
    pub fn quantized_point(&self, place: [f64; 3]) -> QuantizedPoint {
        let mut quantized_point = 0;
        for (a, axis) in self.axes.into_iter().enumerate() {
            let along = place[axis] - self.low[axis];
            let number = match &self.gaps {
                None => (along * self.inverse) as u32,
                Some((gaps, [cells, units])) => (gaps[a].height(along * cells) * units) as u32,
            };
            quantized_point |= u64::from(number.min(self.top[a])) << SHIFTS[a];
        }
        QuantizedPoint(quantized_point)
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        (self.top[1] >> self.units) as usize + 1
    }

    /// The first and the last layer that a box touches.
    #[inline]
    pub fn layers(&self, extent: &PackedBox) -> [usize; 2] {
        [extent.low, extent.high].map(|quantized_point| (quantized_point.number(0) >> self.units) as usize)
    }

    /// The first and the last row that a box touches.
    #[inline]
    pub fn rows_of(&self, extent: &PackedBox) -> [usize; 2] {
        [extent.low, extent.high].map(|quantized_point| (quantized_point.number(1) >> self.units) as usize)
    }

    /// Number of coarse cells of a row.
    pub fn columns(&self) -> usize {
        (self.top[2] >> self.units) as usize + 1
    }

    /// The first and the last coarse cell along a row that a box touches.
    #[inline]
    pub fn columns_of(&self, extent: &PackedBox) -> [usize; 2] {
        [extent.low, extent.high].map(|quantized_point| (quantized_point.number(2) >> self.units) as usize)
    }

    /// A layer and a row as [`Quantizer::first_common`] gives them.
    pub fn cell(&self, layer: usize, row: usize) -> u64 {
        ((layer as u64) << SHIFTS[0] | (row as u64) << SHIFTS[1]) << self.units
    }

    /// The first layer and row that two boxes which meet both touch, to be compared with [`Quantizer::cell`].
    #[inline]
    pub fn first_common(&self, one: &PackedBox, other: &PackedBox) -> u64 {
        let whole = ((1 << BITS) - 1) >> self.units << self.units;
        one.low.sorted(other.low)[1].0 & (whole << SHIFTS[0] | whole << SHIFTS[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quantized_point(numbers: [u64; 3]) -> QuantizedPoint {
        QuantizedPoint((0..3).fold(0, |word, a| word | numbers[a] << SHIFTS[a]))
    }

    /// Boxes of a few numbers, the least and greatest ones among them, are compared as their numbers are.
    #[test]
    fn boxes_meet_where_their_numbers_do() {
        let some = [0u64, 1, 7, (1 << BITS) - 2];
        let ends: Vec<(u64, u64)> = some.iter().flat_map(|&a| some.map(|b| (a, b))).filter(|(a, b)| a <= b).collect();
        let middle = PackedBox { low: quantized_point([1, 1, 1]), high: quantized_point([7, 7, 7]) };
        for &x in &ends {
            for &y in &ends {
                for &z in &ends {
                    let other =
                        PackedBox { low: quantized_point([x.0, y.0, z.0]), high: quantized_point([x.1, y.1, z.1]) };
                    let expected = [x, y, z].iter().all(|&(low, high)| low <= 7 && high >= 1);
                    assert_eq!(middle.meets(&other), expected, "{x:?} {y:?} {z:?}");
                    assert_eq!(other.meets(&middle), expected, "{x:?} {y:?} {z:?}");
                    assert!(!other.meets(&PackedBox::EMPTY));
                    assert_eq!(other.union(PackedBox::EMPTY), other);
                    assert_eq!(PackedBox::of([other.low, other.high, other.low]), other);
                }
            }
        }
        assert!(!PackedBox::EMPTY.meets(&PackedBox::EMPTY));
    }
}
