//! Dilation by a Euclidean ball, on words: which cells have a set cell in the ball round them.
//!
//! A ball of radius ρ is a stack of rows along x. All rows of one half width h are united first, and the union is widened
//! cell by cell while narrower rows join it, so that each row of the ball costs one OR per word and each half width one
//! widening, instead of one widening per row:
//!
//! ```text
//!   z ^     . h=0 .          acc = rows with h = 2
//!     |   . h=1 h=1 .        acc = widen(acc) | rows with h = 1
//!     |   . h=2 h=2 h=2      acc = widen(acc) | rows with h = 0      (each row was widened h times)
//!     +--------> slice
//! ```

/// The ball of a closing radius, as rows along x.
///
/// Offsets with dx² + dy² + dz² ≤ r²; r² = ρ² for ρ ≥ 2, r² = 3 for ρ = 1 (the full 3×3×3 block, the paper's dilation by one
/// cell) and r² = 0 for ρ = 0. Each ball holds the smaller ones.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ball {
    radius: u32,
    /// `layers[h]`: the (slice, row) offsets of the rows with half width h.
    layers: Vec<Vec<(i32, i32)>>,
}

impl Ball {
    /// The ball of closing radius `radius`, in cells.
    pub fn new(radius: u32) -> Ball {
        Ball::squared(squared(radius))
    }

    /// The ball of the offsets whose squared length is at most `squared`.
    pub fn squared(squared: u32) -> Ball {
        let (radius, squared) = (squared.isqrt(), i64::from(squared));
        let reach = radius as i32;
        let mut layers = vec![Vec::new(); radius as usize + 1];
        for dy in -reach..=reach {
            for dz in -reach..=reach {
                let left = squared - i64::from(dy * dy + dz * dz);
                if left >= 0 {
                    let half_width = (0..=i64::from(radius)).take_while(|h| h * h <= left).last().unwrap_or(0);
                    layers[half_width as usize].push((dy, dz));
                }
            }
        }
        Ball { radius, layers }
    }

    /// The closing radius ρ, in cells: no offset of the ball is longer along an axis.
    pub fn radius(&self) -> u32 {
        self.radius
    }

    /// Writes to `acc` the row of cells that have a set cell in the ball round them, and says whether there is any.
    ///
    /// `row(dy, dz)` gives the row at that offset, or `None` where no cell is set. Set cells must lie at least ρ cells
    /// from the ends of the row: widening does not stop at them.
    pub fn dilate_row<'a>(&self, row: impl Fn(i32, i32) -> Option<&'a [u64]>, acc: &mut [u64]) -> bool {
        acc.fill(0);
        let mut any = false;
        for (h, offsets) in self.layers.iter().enumerate().rev() {
            for &(dy, dz) in offsets {
                if let Some(words) = row(dy, dz) {
                    any = true;
                    for (a, w) in acc.iter_mut().zip(words) {
                        *a |= w;
                    }
                }
            }
            if any && h > 0 {
                widen(acc);
            }
        }
        any
    }
}

/// The squared radius r² of the ball of closing radius `radius`: ρ², but 3 for ρ = 1.
pub fn squared(radius: u32) -> u32 {
    if radius == 1 { 3 } else { radius * radius }
}

/// Sets both neighbours of every set cell of a row.
fn widen(words: &mut [u64]) {
    let mut below = 0;
    for i in 0..words.len() {
        let word = words[i];
        let above = words.get(i + 1).map_or(0, |next| next << 63);
        words[i] = word | word << 1 | below | word >> 1 | above;
        below = word >> 63;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slice::Bits;
    use proptest::prelude::*;

    #[test]
    fn the_ball_of_one_is_the_block() {
        let ball = Ball::new(1);
        assert_eq!(ball.layers, [vec![], (-1..=1).flat_map(|dy| (-1..=1).map(move |dz| (dy, dz))).collect()]);
    }

    #[test]
    fn balls_hold_the_offsets_within_their_radius() {
        for radius in [0, 2, 3, 5, 8] {
            let r = radius as i32;
            let expected = (-r..=r)
                .flat_map(|x| (-r..=r).flat_map(move |y| (-r..=r).map(move |z| x * x + y * y + z * z)))
                .filter(|d| *d <= r * r)
                .count();
            let rows: usize = Ball::new(radius).layers.iter().enumerate().map(|(h, l)| (2 * h + 1) * l.len()).sum();
            assert_eq!(rows, expected);
        }
    }

    proptest! {
        #[test]
        fn rows_equal_the_naive_twin(
            set in prop::collection::vec((0u32..90, 0i64..5, 0u32..5), 0..12),
            radius in 0u32..4,
        ) {
            let width = 90 + 2 * radius;
            let mut slices: Vec<Bits> = (0..5).map(|_| Bits::new(width, 5)).collect();
            for &(x, y, z) in &set {
                slices[y as usize].set(x + radius, z);
            }
            let ball = Ball::new(radius);
            let squared = if radius == 1 { 3 } else { i64::from(radius * radius) };
            let mut acc = vec![0; Bits::new(width, 1).row(0).len()];
            for z in 0..5i64 {
                let row = |dy: i32, dz: i32| {
                    let (y, z) = (2 + i64::from(dy), z + i64::from(dz));
                    if (0..5).contains(&y) && (0..5).contains(&z) { slices[y as usize].lit_row(z as u32) } else { None }
                };
                ball.dilate_row(row, &mut acc);
                for x in 0..i64::from(width) {
                    let naive = set.iter().any(|&(sx, sy, sz)| {
                        let d = [i64::from(sx + radius) - x, sy - 2, i64::from(sz) - z];
                        d.iter().map(|c| c * c).sum::<i64>() <= squared
                    });
                    prop_assert_eq!(acc[x as usize / 64] >> (x % 64) & 1 == 1, naive);
                }
            }
        }
    }
}
