//! Sums and quantiles of distances that come in no order, the same for every order.
//!
//! Sums are kept as whole numbers, one for each power of two: adding these is exact. The quantile is found by counting: first by the
//! highest 16 bits of the distances, as they come, then by the next 16 among those that have the right ones, and so on.

use crate::error::Result;
use crate::nearest::room::Room;
use crate::storage::spool::Spool;

/// Distances kept before they are stored, and read at once.
const PIECE: usize = 1 << 12;
/// Bits that are counted by at a time.
const BITS: u32 = 16;
/// Exponents of `f64`.
const EXPONENTS: usize = 1 << 11;

/// An exact sum of numbers that are not negative, of up to 2⁷⁵ of them.
#[derive(Debug, Clone)]
struct Sum(Vec<u128>);

impl Sum {
    fn new() -> Sum {
        Sum(vec![0; EXPONENTS])
    }

    fn add(&mut self, value: f64) {
        let bits = value.to_bits();
        let (exponent, fraction) = ((bits >> 52) as usize % EXPONENTS, bits & ((1 << 52) - 1));
        // The first exponent is that of the smallest numbers, which have no leading one.
        let leading = if exponent == 0 { 0 } else { 1 << 52 };
        self.0[exponent] += u128::from(fraction | leading);
    }

    fn value(&self) -> f64 {
        // From the least up, so that rounding hardly shows; always in the same order.
        self.0.iter().enumerate().filter(|(_, whole)| **whole > 0).fold(0.0, |sum, (exponent, whole)| {
            let power = exponent.max(1) as i32 - 1075;
            // In two steps: the power alone may be below the least number.
            sum + *whole as f64 * 2f64.powi(power / 2) * 2f64.powi(power - power / 2)
        })
    }
}

/// Parts of a histogram.
pub const BINS: usize = 50;

/// How often distances occur.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Histogram {
    /// What is counted lies between 0 and this: twice the value that 95 % do not exceed, or else the largest.
    pub end: f64,
    /// In parts of the same width.
    pub counts: [u64; BINS],
    /// What is larger.
    pub beyond: u64,
}

impl Histogram {
    fn new(p95: f64, max: f64) -> Histogram {
        let end = if p95 > 0.0 { (2.0 * p95).min(max) } else { max };
        Histogram { end, counts: [0; BINS], beyond: 0 }
    }

    fn add(&mut self, value: f64) {
        match value > self.end {
            true => self.beyond += 1,
            // All are zero, or this one is the largest.
            false => self.counts[((value / self.end * BINS as f64) as usize).min(BINS - 1)] += 1,
        }
    }
}

/// What is told of some distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Figures {
    pub count: u64,
    pub mean: f64,
    pub rms: f64,
    /// The value of rank ⌈0.95 n⌉, from the least.
    pub p95: f64,
    pub max: f64,
    pub histogram: Histogram,
}

/// Distances, or angles, as they come.
pub(super) struct Spread {
    count: u64,
    sum: Sum,
    squares: Sum,
    max: f64,
    highest: Vec<u64>,
    piece: Vec<f64>,
    store: Spool,
}

impl Spread {
    /// None yet.
    pub fn new(room: &Room) -> Spread {
        let highest = vec![0; 1 << BITS];
        let (sum, squares) = (Sum::new(), Sum::new());
        Spread { count: 0, sum, squares, max: 0.0, highest, piece: Vec::with_capacity(PIECE), store: room.spool() }
    }

    /// Adds a value whose square is given.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn add_square(&mut self, square: f64) -> Result<()> {
        self.add_both(square.sqrt(), square)
    }

    /// Adds a value.
    ///
    /// # Errors
    /// The same as [`Spread::add_square`].
    pub fn add(&mut self, value: f64) -> Result<()> {
        self.add_both(value, value * value)
    }

    fn add_both(&mut self, value: f64, square: f64) -> Result<()> {
        self.count += 1;
        self.sum.add(value);
        self.squares.add(square);
        self.max = self.max.max(value);
        self.highest[(value.to_bits() >> (64 - BITS)) as usize] += 1;
        self.piece.push(value);
        if self.piece.len() == PIECE {
            self.store.append(bytemuck::cast_slice(&self.piece))?;
            self.piece.clear();
        }
        Ok(())
    }

    /// What they come to; `None` if there are none.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn figures(mut self) -> Result<Option<Figures>> {
        if self.count == 0 {
            return Ok(None);
        }
        self.store.append(bytemuck::cast_slice(&self.piece))?;
        let n = self.count as f64;
        let (mean, rms) = (self.sum.value() / n, (self.squares.value() / n).sqrt());
        let p95 = self.quantile()?;
        let mut histogram = Histogram::new(p95, self.max);
        let mut piece = Vec::with_capacity(PIECE);
        for first in (0..self.count).step_by(PIECE) {
            piece.resize((self.count - first).min(PIECE as u64) as usize, 0.0);
            self.store.read_at(first * 8, bytemuck::cast_slice_mut::<f64, u8>(&mut piece))?;
            piece.iter().for_each(|value| histogram.add(*value));
        }
        Ok(Some(Figures { count: self.count, mean, rms, p95, max: self.max, histogram }))
    }

    fn quantile(&self) -> Result<f64> {
        let rank = self.count - self.count / 20;
        let (mut known, mut left) = pick(&self.highest, rank);
        let mut piece = Vec::with_capacity(PIECE);
        for level in 2..=64 / BITS {
            let mut counts = vec![0u64; 1 << BITS];
            let shift = 64 - level * BITS;
            for first in (0..self.count).step_by(PIECE) {
                piece.resize((self.count - first).min(PIECE as u64) as usize, 0u64);
                self.store.read_at(first * 8, bytemuck::cast_slice_mut(&mut piece))?;
                for bits in piece.iter().filter(|bits| *bits >> (shift + BITS) == known) {
                    counts[(bits >> shift) as usize % (1 << BITS)] += 1;
                }
            }
            let (next, rest) = pick(&counts, left);
            (known, left) = (known << BITS | next, rest);
        }
        Ok(f64::from_bits(known))
    }
}

/// The first number up to which at least `rank` are counted, and how many of them are its own.
fn pick(counts: &[u64], rank: u64) -> (u64, u64) {
    let mut left = rank;
    for (number, &count) in counts.iter().enumerate() {
        if left <= count {
            return (number as u64, left);
        }
        left -= count;
    }
    unreachable!("a rank is no more than all that were counted")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::nearest::testing::with_room;

    fn figures(values: &[f64], kept: u64) -> Option<Figures> {
        with_room(1, |room| {
            let mut spread = Spread::new(&Room { kept, ..room });
            values.iter().for_each(|value| spread.add(*value).unwrap());
            spread.figures().unwrap()
        })
    }

    proptest! {
        #[test]
        fn figures_are_those_of_a_sorted_list_in_any_order(mut values in prop::collection::vec(prop_oneof![Just(0.0), Just(1.5), 0.0..1e3f64, 0.0..1e-320f64], 1..300)) {
            let found = figures(&values, 1 << 20).unwrap();
            values.sort_by(f64::total_cmp);
            prop_assert_eq!(figures(&values, 0).unwrap(), found);
            let n = values.len();
            prop_assert_eq!(found.count, n as u64);
            prop_assert_eq!(found.p95, values[(95 * n).div_ceil(100) - 1]);
            prop_assert_eq!(found.max, values[n - 1]);
            let mean = values.iter().sum::<f64>() / n as f64;
            let rms = (values.iter().map(|v| v * v).sum::<f64>() / n as f64).sqrt();
            let Histogram { end, counts, beyond } = found.histogram;
            prop_assert_eq!(beyond, values.iter().filter(|v| **v > end).count() as u64);
            prop_assert_eq!(counts.iter().sum::<u64>() + beyond, found.count);
            let half = values.iter().filter(|v| **v / end * BINS as f64 >= 25.0 && **v <= end).count() as u64;
            prop_assert!(end == 0.0 || counts[25..].iter().sum::<u64>() == half);
            prop_assert!((found.mean - mean).abs() <= 1e-13 * mean && (found.rms - rms).abs() <= 1e-13 * rms);
        }
    }

    #[test]
    fn sums_do_not_forget_what_is_small() {
        let mut sum = Sum::new();
        (0..1000).for_each(|_| sum.add(1e-17));
        sum.add(1.0);
        assert_eq!(sum.value(), 1.0 + 1e-14);
        assert_eq!(Sum::new().value(), 0.0);
        let mut least = Sum::new();
        least.add(5e-324);
        assert_eq!(least.value(), 5e-324);
        assert_eq!(figures(&[], 0), None);
        let long: Vec<f64> = (1..=10_000).map(f64::from).collect();
        assert_eq!(figures(&long, 0).unwrap().p95, 9500.0);
    }
}
