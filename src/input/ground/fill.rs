//! Filling what is not known of a raster: means over ever larger cells upwards, interpolation downwards.

/// Doublings from a cell to the largest: 128 cells.
pub const LEVELS: u32 = 7;
/// Cells that a window must reach beyond what is asked for, in multiples of which it must begin: a cell of the highest level.
pub const REACH: usize = 1 << LEVELS;

/// Gives each cell of a square window of `side` cells that holds NaN a height from those about it. Cells farther than [`REACH`] to twice that from all heights stay NaN.
///
/// Level l has cells of 2^l by 2^l cells; the height of one is the mean of those of its four parts that have any. Going down, a cell without a height takes that
/// between the four nearest cells of the level above, weighted 9, 3, 3 and 1, as far as these have one. The window begins at a multiple of [`REACH`], and so does its
/// length: then what lies a [`REACH`] from its ends does not depend on where it begins.
pub fn fill(heights: &mut [f32], side: usize) {
    assert!(side.is_multiple_of(REACH) && heights.len() == side * side, "whole cells of the highest level");
    if heights.iter().all(|height| !height.is_nan()) {
        return;
    }
    let mut levels: Vec<Vec<f32>> = Vec::with_capacity(LEVELS as usize);
    for l in 0..LEVELS {
        let wide = side >> l;
        let below = levels.last().map_or(&*heights, |level| level);
        let half = wide / 2;
        let mut level = Vec::with_capacity(half * half);
        for row in 0..half {
            for column in 0..half {
                let at = 2 * row * wide + 2 * column;
                let (mut sum, mut count) = (0.0, 0.0);
                for height in [below[at], below[at + 1], below[at + wide], below[at + wide + 1]] {
                    if !height.is_nan() {
                        sum += height;
                        count += 1.0;
                    }
                }
                level.push(sum / count);
            }
        }
        levels.push(level);
    }
    for l in (0..LEVELS as usize).rev() {
        let (finer, coarser) = levels.split_at_mut(l);
        let level = finer.last_mut().map_or(&mut *heights, |level| level);
        let (wide, above, half) = (side >> l, &coarser[0], side >> (l + 1));
        for (row, line) in level.chunks_exact_mut(wide).enumerate() {
            for (column, height) in line.iter_mut().enumerate().filter(|(_, height)| height.is_nan()) {
                *height = between(above, half, row, column);
            }
        }
    }
}

/// The height that the level above, of `half` by `half` cells, has at a cell.
fn between(above: &[f32], half: usize, row: usize, column: usize) -> f32 {
    let nearer = |at: usize| {
        let own = at / 2;
        (own, if at.is_multiple_of(2) { own.checked_sub(1) } else { Some(own + 1).filter(|next| *next < half) })
    };
    let ((y, beside_y), (x, beside_x)) = (nearer(row), nearer(column));
    let (mut sum, mut weights) = (0.0, 0.0);
    for (y, x, weight) in
        [(Some(y), Some(x), 9.0), (beside_y, Some(x), 3.0), (Some(y), beside_x, 3.0), (beside_y, beside_x, 1.0)]
    {
        let (Some(y), Some(x)) = (y, x) else { continue };
        let height = above[y * half + x];
        if !height.is_nan() {
            sum += weight * height;
            weights += weight;
        }
    }
    sum / weights
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Cells with a height, thinned out by squares of different sizes.
    fn heights(side: usize) -> impl Strategy<Value = Vec<f32>> {
        (any::<u64>(), 1u32..200, 1usize..90).prop_map(move |(seed, every, coarse)| {
            let hash = |a: usize, b: usize| {
                let mut h = seed
                    ^ (a as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
                    ^ (b as u64).wrapping_mul(0xD6E8_FEB8_6659_FD93);
                h ^= h >> 29;
                h = h.wrapping_mul(0xBF58_476D_1CE4_E5B9);
                (h >> 33) as u32
            };
            (0..side * side)
                .map(|i| {
                    let (y, x) = (i / side, i % side);
                    let known = hash(y, x).is_multiple_of(every) && hash(y / coarse, x / coarse).is_multiple_of(2);
                    if known { (hash(x, y) % 1000) as f32 / 10.0 } else { f32::NAN }
                })
                .collect()
        })
    }

    /// Cell by cell, from the definition, without storing a level.
    struct Twin<'a> {
        heights: &'a [f32],
        side: usize,
    }

    impl Twin<'_> {
        fn mean(&self, level: u32, row: i64, column: i64) -> f32 {
            let wide = (self.side >> level) as i64;
            if !(0..wide).contains(&row) || !(0..wide).contains(&column) {
                return f32::NAN;
            }
            if level == 0 {
                return self.heights[row as usize * self.side + column as usize];
            }
            let parts =
                [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(dy, dx)| self.mean(level - 1, 2 * row + dy, 2 * column + dx));
            let known: Vec<f32> = parts.into_iter().filter(|part| !part.is_nan()).collect();
            known.iter().sum::<f32>() / known.len() as f32
        }

        fn at(&self, level: u32, row: i64, column: i64) -> f32 {
            let wide = (self.side >> level) as i64;
            if !(0..wide).contains(&row) || !(0..wide).contains(&column) {
                return f32::NAN;
            }
            let own = self.mean(level, row, column);
            if !own.is_nan() || level == LEVELS {
                return own;
            }
            let beside = |at: i64| at.div_euclid(2) + if at % 2 == 0 { -1 } else { 1 };
            let [y, x] = [row, column].map(|at| (at.div_euclid(2), beside(at))).map(|(own, beside)| [own, beside]);
            let (mut sum, mut weights) = (0.0, 0.0);
            for (y, x, weight) in [(y[0], x[0], 9.0), (y[1], x[0], 3.0), (y[0], x[1], 3.0), (y[1], x[1], 1.0)] {
                let height = self.at(level + 1, y, x);
                if !height.is_nan() {
                    sum += weight * height;
                    weights += weight;
                }
            }
            sum / weights
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        #[ignore = "exhaustive"]
        fn as_its_definition_says(given in heights(REACH), probes in prop::collection::vec(0..REACH * REACH, 12)) {
            let mut filled = given.clone();
            fill(&mut filled, REACH);
            let twin = Twin { heights: &given, side: REACH };
            for i in probes {
                let expected = twin.at(0, (i / REACH) as i64, (i % REACH) as i64);
                prop_assert_eq!(filled[i].to_bits(), expected.to_bits(), "cell {}: {} for {}", i, filled[i], expected);
            }
        }

        #[test]
        fn the_middle_knows_nothing_of_where_the_window_begins(given in heights(5 * REACH)) {
            let (wide, narrow) = (5 * REACH, 3 * REACH);
            let mut all = given.clone();
            fill(&mut all, wide);
            let mut part: Vec<f32> = (0..narrow)
                .flat_map(|y| given[(y + REACH) * wide + REACH..][..narrow].to_vec())
                .collect();
            fill(&mut part, narrow);
            // And one cell more on every side.
            for y in REACH - 1..2 * REACH + 1 {
                for x in REACH - 1..2 * REACH + 1 {
                    prop_assert_eq!(part[y * narrow + x].to_bits(), all[(y + REACH) * wide + REACH + x].to_bits());
                }
            }
        }
    }

    #[test]
    fn what_is_known_stays_and_nothing_makes_nothing() {
        let mut none = vec![f32::NAN; REACH * REACH];
        fill(&mut none, REACH);
        assert!(none.iter().all(|height| height.is_nan()));
        let mut one = none.clone();
        one[5] = 2.5;
        fill(&mut one, REACH);
        assert!(one.iter().all(|height| *height == 2.5));
    }
}
