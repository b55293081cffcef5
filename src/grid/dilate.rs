//! Dilation by a Euclidean ball, on words: which cells have a set cell in the ball round them.
//!
//! The ball is a stack of discs, and each disc a stack of rows. A slice that comes in is widened along x by 0, 1, 2, ... cells, once for all
//! discs; a disc is the union of such slices, each moved along z; and the larger disc, nearer to the ball's middle, has
//! the smaller one in it, so that only what is wider is added. What the disc gives is put into the slices at its distance above and below:
//!
//! ```text
//!                   discs of the slice that comes in
//!   z ^     . h=0 .          disc 1 = widened by 1                                     -> slices y - 1 and y + 1
//!     |   . h=1 h=1 h=1 .    disc 0 = disc 1 | widened by 2 | widened by 0, moved up and down by 2 ...  -> slice y
//!     |   . h=2 h=2 h=2 .
//!     +--------> x           h: how far the row of the disc is widened
//! ```
//!
//! So a slice is looked at once, whatever the radius, and a word of it costs an OR for each row of half a ball. All that goes over the rows of a
//! slice as if they were one row: the bit behind each ([`crate::grid::slice`]) keeps them apart.

use multiversion::multiversion;

use crate::error::Result;
use crate::grid::slice::{Bits, behind};

/// The ball of a closing radius.
///
/// Offsets with dx² + dy² + dz² ≤ r²; r² = ρ² for ρ ≥ 2, r² = 3 for ρ = 1 (the full 3×3×3 block, the paper's dilation by one
/// cell) and r² = 0 for ρ = 0. Each ball holds the smaller ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ball {
    radius: u32,
    squared: u32,
}

impl Ball {
    /// The ball of closing radius `radius`, in cells.
    pub fn new(radius: u32) -> Ball {
        Ball::squared(squared(radius))
    }

    /// The ball of the offsets whose squared length is at most `squared`.
    pub fn squared(squared: u32) -> Ball {
        Ball { radius: squared.isqrt(), squared }
    }

    /// The closing radius ρ, in cells: no offset of the ball is longer along an axis.
    pub fn radius(&self) -> u32 {
        self.radius
    }

    /// The half width of the row at this offset along the two other axes, if the ball has one there.
    pub fn half_width(&self, dy: u32, dz: u32) -> Option<u32> {
        self.squared.checked_sub(dy * dy + dz * dz).map(u32::isqrt)
    }
}

/// The squared radius r² of the ball of closing radius `radius`: ρ², but 3 for ρ = 1.
pub fn squared(radius: u32) -> u32 {
    if radius == 1 { 3 } else { radius * radius }
}

/// Words that are taken through all rows of the ball at once: they stay in registers.
const BLOCK: usize = 16;

/// Words of a slice that are widened before they are used, for all widths together: they stay in the nearest cache.
const TILE: usize = 6 << 10;

/// Slices, dilated one after the other, from the lowest to the highest. Memory: [`Dilation::bytes`].
#[derive(Debug)]
pub struct Dilation {
    ball: Ball,
    width: u32,
    rows: usize,
    /// The first slice that is not asked for any more.
    end: i64,
    /// The slice that comes in.
    painted: Bits,
    /// The slices under way, as many as the ball is high; slice y in `y mod` their number.
    under_way: Vec<Bits>,
    /// The first slice that has not come in yet, once one has.
    next: Option<i64>,
    /// `discs[dy]`: the rows that the disc at distance `dy` has, and that at `dy + 1` has not, or narrower ones. Of each: where it begins in
    /// the widened rows, when it is moved up, and down.
    discs: Vec<Vec<[usize; 2]>>,
    /// `into[dy]`: the slices under way that the disc at distance `dy` of the slice that comes in is put into.
    into: Vec<[Option<usize>; 2]>,
    /// Rows of a tile, widened by 0, 1, 2, ... cells; of each width one word before the first and after the last.
    widened: Vec<u64>,
    /// Rows of a tile, without those round it that the ball reaches.
    tile: usize,
}

impl Dilation {
    /// A dilation of slices of `rows` rows of `width` cells, below slice `end`.
    pub fn new(ball: Ball, width: u32, rows: u32, end: i64) -> Dilation {
        let painted = Bits::new(width, rows);
        let (reach, words) = (ball.radius as usize, painted.row_words());
        let tile = (TILE / (words * (reach + 1))).saturating_sub(2 * reach).max(4 * reach + 1).min(rows as usize);
        let stride = (tile + 2 * reach) * words + 2;
        let rows_of_disc = |dy: u32| {
            let wider = move |dz: &u32| ball.half_width(dy, *dz) > ball.half_width(dy + 1, *dz);
            let place = move |dz: u32| {
                let middle = ball.half_width(dy, dz)? as usize * stride + 1 + reach * words;
                Some([middle - dz as usize * words, middle + dz as usize * words])
            };
            (0..=ball.radius).filter(wider).filter_map(place).collect()
        };
        Dilation {
            ball,
            width,
            rows: rows as usize,
            end,
            under_way: vec![painted.clone(); 2 * reach + 1],
            painted,
            next: None,
            discs: (0..=ball.radius).map(rows_of_disc).collect(),
            into: Vec::new(),
            widened: vec![0; (reach + 1) * stride],
            tile,
        }
    }

    /// Memory of a dilation by a ball of radius `radius` of slices of this size, in bytes.
    pub fn bytes(radius: u32, width: u32, rows: u32) -> u64 {
        let widest_tile = Bits::bytes(width, 6 * radius + 1) * u64::from(radius + 1);
        u64::from(2 * radius + 2) * Bits::bytes(width, rows) + (8 * TILE as u64).max(widest_tile)
    }

    /// The cells of slice `y` that have a set cell in the ball round them, to be changed at will. `paint` is asked for the slices that the ball
    /// reaches and that have not come in yet, in order, and sets their cells; what is in the bits before is of no meaning. `y` must grow.
    ///
    /// # Errors
    /// The first error of `paint`; the dilation must not be used after it.
    ///
    /// # Panics
    /// If slice `y` or one above it was asked for before, or does not lie below the end.
    pub fn slide_to(&mut self, y: i64, mut paint: impl FnMut(i64, &mut Bits) -> Result<()>) -> Result<&mut Bits> {
        let (reach, len) = (i64::from(self.ball.radius), self.under_way.len() as i64);
        assert!(y < self.end, "a dilation stops at its end");
        if reach == 0 {
            assert!(self.next.is_none_or(|next| next <= y), "a dilation moves up only");
            self.next = Some(y + 1);
            paint(y, &mut self.under_way[0])?;
            return Ok(&mut self.under_way[0]);
        }
        let first = match self.next {
            Some(next) if next + reach > y => {
                assert!(next <= y + reach, "a dilation moves up only");
                next
            }
            _ => {
                (y..y + 2 * reach).for_each(|y| self.under_way[y.rem_euclid(len) as usize].clear());
                y - reach
            }
        };
        for entering in first..=y + reach {
            self.under_way[(entering + reach).rem_euclid(len) as usize].clear();
            paint(entering, &mut self.painted)?;
            let slot = |at: i64| (y..self.end).contains(&at).then(|| at.rem_euclid(len) as usize);
            self.into.clear();
            self.into.extend((0..=reach).map(|dy| [slot(entering + dy), slot(entering - dy)]));
            // Larger discs than the nearest slice needs are not made.
            let nearest = (y - entering).max(entering - (self.end - 1)).max(0);
            self.put(nearest as u32);
        }
        self.next = Some(y + reach + 1);
        Ok(&mut self.under_way[y.rem_euclid(len) as usize])
    }

    /// Puts the discs of the painted slice, from distance `nearest` on, into the slices that they reach.
    fn put(&mut self, nearest: u32) {
        let reach = self.ball.radius as usize;
        let mut z = 0;
        while z < self.rows {
            // Rows that hold something, no farther from each other than the ball reaches on both sides.
            let Some(begin) = (z..self.rows).find(|z| self.painted.lit_row(*z as u32).is_some()) else { break };
            let (mut end, mut ahead) = (begin + 1, begin + 1);
            while ahead < self.rows && ahead <= end + 2 * reach {
                if self.painted.lit_row(ahead as u32).is_some() {
                    end = ahead + 1;
                }
                ahead += 1;
            }
            let (mut from, to) = (begin.saturating_sub(reach), (end + reach).min(self.rows));
            while from < to {
                let tile = from..(from + self.tile).min(to);
                from = tile.end;
                self.put_tile(nearest, tile);
            }
            z = ahead;
        }
    }

    fn put_tile(&mut self, nearest: u32, tile: std::ops::Range<usize>) {
        let (reach, words) = (self.ball.radius as usize, self.painted.row_words());
        let stride = self.widened.len() / (reach + 1);
        let held = (tile.len() + 2 * reach) * words;
        {
            // The rows as they are, and nothing beyond the slice.
            let (below, above) = (reach.saturating_sub(tile.start), (tile.end + reach).saturating_sub(self.rows));
            let rows = &mut self.widened[1..][..held];
            rows[..below * words].fill(0);
            rows[held - above * words..].fill(0);
            let painted = (tile.start + below - reach) * words..(tile.end + reach - above) * words;
            rows[below * words..held - above * words].copy_from_slice(&self.painted.words()[painted]);
            self.widened[held + 1] = 0;
        }
        let widest = self.ball.half_width(nearest, 0).expect("the ball reaches that far");
        for h in 0..widest as usize {
            let (narrow, wide) = self.widened[h * stride..].split_at_mut(stride);
            widen(&narrow[..held + 2], &mut wide[..held + 2], words, behind(self.width));
        }
        for slot in self.into.iter().flatten().flatten() {
            self.under_way[*slot].light(tile.clone());
        }
        let mut discs = Discs {
            widened: &self.widened,
            discs: &self.discs[nearest as usize..],
            into: &self.into[nearest as usize..],
            under_way: &mut self.under_way,
        };
        put_words(&mut discs, tile.start * words, tile.len() * words);
    }
}

/// All `count` words of a tile, which begins at word `first` of the slice.
#[multiversion(targets("x86_64+avx+avx2"))]
fn put_words(discs: &mut Discs<'_>, first: usize, count: usize) {
    if count < BLOCK {
        (0..count).for_each(|i| discs.put::<1>(i, first));
    } else {
        // The last block may overlap the one before: to put a word twice does no harm.
        for i in (0..count).step_by(BLOCK) {
            discs.put::<BLOCK>(i.min(count - BLOCK), first);
        }
    }
}

/// The discs of a tile on their way into the slices.
struct Discs<'a> {
    widened: &'a [u64],
    discs: &'a [Vec<[usize; 2]>],
    into: &'a [[Option<usize>; 2]],
    under_way: &'a mut [Bits],
}

impl Discs<'_> {
    /// Words `i..i + N` of the tile, which begins at word `first` of the slice.
    #[inline(always)]
    fn put<const N: usize>(&mut self, i: usize, first: usize) {
        let mut words = [0u64; N];
        for (rows, into) in self.discs.iter().zip(self.into).rev() {
            for [up, down] in rows {
                let (up, down) = (block::<N>(self.widened, up + i), block::<N>(self.widened, down + i));
                for j in 0..N {
                    words[j] |= up[j] | down[j];
                }
            }
            let mut any = 0;
            for word in words {
                any |= word;
            }
            if any == 0 {
                continue;
            }
            for slot in into.iter().flatten() {
                let slice = &mut self.under_way[*slot].words_mut()[first + i..];
                let slice: &mut [u64; N] = slice.first_chunk_mut().expect("the tile lies in the slice");
                for j in 0..N {
                    slice[j] |= words[j];
                }
            }
        }
    }
}

/// The `N` words from `at` on: of known number, so that the loops over them are unrolled.
#[inline(always)]
fn block<const N: usize>(words: &[u64], at: usize) -> &[u64; N] {
    words[at..].first_chunk().expect("the rows round a tile are there")
}

/// Sets both neighbours of every set cell of rows of `words` words, whose last words have the cells `last`. Before the first and after the last
/// row there is one word more, which is clear.
#[multiversion(targets("x86_64+avx+avx2"))]
fn widen(narrow: &[u64], wide: &mut [u64], words: usize, last: u64) {
    let n = narrow.len() - 2;
    let (before, here, after, out) = (&narrow[..n], &narrow[1..n + 1], &narrow[2..n + 2], &mut wide[1..n + 1]);
    for i in 0..n {
        out[i] = here[i] | here[i] << 1 | here[i] >> 1 | before[i] >> 63 | after[i] << 63;
    }
    let mut end = words - 1;
    while end < n {
        out[end] &= last;
        end += words;
    }
    wide[n + 1] = 0;
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn is_in(squared: u32, d: [i64; 3]) -> bool {
        d.iter().map(|c| c * c).sum::<i64>() <= i64::from(squared)
    }

    #[test]
    fn the_ball_of_one_is_the_block() {
        let ball = Ball::new(1);
        assert!((0..=1).all(|dy| (0..=1).all(|dz| ball.half_width(dy, dz) == Some(1))));
        assert_eq!((ball.half_width(2, 0), ball.half_width(0, 2)), (None, None));
    }

    proptest! {
        #[test]
        fn slices_equal_the_naive_twin(
            set in prop::collection::vec((0u32..130, 0i64..9, 0u32..30), 0..12),
            size in (0usize..6).prop_map(|i| [1u32, 2, 63, 64, 65, 130][i]),
            rows in 1u32..30,
            radius in 0u32..6,
            squared in prop::option::of(0u32..40),
            asked in prop::collection::btree_set(-2i64..12, 1..8),
            beyond in 0i64..3,
        ) {
            let squared = squared.unwrap_or(super::squared(radius));
            let set: Vec<_> = set.into_iter().filter(|c| c.0 < size && c.2 < rows).collect();
            let end = asked.last().map_or(0, |y| y + 1 + beyond);
            let mut dilation = Dilation::new(Ball::squared(squared), size, rows, end);
            dilation.tile = dilation.tile.min(5);
            for y in asked {
                let painted = dilation.slide_to(y, |y, bits| {
                    bits.clear();
                    set.iter().filter(|c| c.1 == y).for_each(|c| bits.set(c.0, c.2));
                    Ok(())
                }).unwrap();
                for x in 0..i64::from(size) {
                    for z in 0..i64::from(rows) {
                        let near = |c: &(u32, i64, u32)| [i64::from(c.0) - x, c.1 - y, i64::from(c.2) - z];
                        let naive = set.iter().any(|c| is_in(squared, near(c)));
                        prop_assert_eq!(painted.get(x, z), naive, "{} {} {}", x, y, z);
                    }
                }
                for z in 0..rows {
                    prop_assert!(painted.row(z)[size as usize / 64] & !behind(size) == 0, "beyond the end of a row");
                    prop_assert!(painted.lit_row(z).is_some() || painted.row(z).iter().all(|word| *word == 0));
                }
            }
        }
    }
}
