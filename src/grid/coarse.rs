//! The coarse grid: the cells that a cloud's points lie in at a coarse resolution, found in the survey's pass, before there is a grid.
//!
//! ```text
//!   cells have sides of 2^e of the input's units and lie at multiples of them, whatever the box:
//!
//!   |   |   |   |   |   |   |   |      when the box outgrows SIDE cells, e grows by one, and cells become one by twos
//!   |       |       |       |
//!
//!   a cell's bit is that of its place modulo SIDE along each axis: no two cells of a box of up to SIDE cells share one
//! ```
//!
//! Points come in any order and from several threads; the cells are the same. What the plan makes of them is [`crate::run::estimate`]'s.

use std::collections::BTreeSet;
use std::sync::RwLock;
use std::sync::atomic::{AtomicU64, Ordering};

use serde::{Deserialize, Serialize};

use crate::points::Coordinate;
use crate::points::bounds::Bounds;

/// The most cells along an axis, a power of two: a bit each, 2 MiB in all.
pub const SIDE: u32 = 256;

/// Bytes of a coarse grid.
pub const BYTES: u64 = (SIDE as u64).pow(3) / 8;

/// Added to a number of less than 2^51, it leaves the nearest whole number in the lowest bits.
const TO_WHOLE: f64 = 6_755_399_441_055_744.0;

/// Points to a column of cells from which hardly any is empty by chance: of random ones, one in 3,000.
const FILLED: u64 = 8;

/// A body has so many cells of twice the side at least: fewer tell nothing of its shape. Of all such cells, one in so many may lie apart from it, as strays.
const BODY: usize = 100;
const STRAYS: usize = 50;

/// Strays that make the longest side so many times as long are worth leaving out.
const STRETCHED: f64 = 1.5;

/// Cells have no smaller sides than 2^-46 of the farthest coordinate, and than this power of two.
const SMALLEST: i32 = -1000;

/// The cells of a cloud, while its points arrive.
#[derive(Debug)]
pub struct Sketching(RwLock<CoarseGrid>);

/// The cells of a cloud.
#[derive(Debug, Serialize, Deserialize)]
#[serde(into = "Sparse", try_from = "Sparse")]
pub struct CoarseGrid {
    exponent: i32,
    bounds: Bounds,
    words: Vec<AtomicU64>,
}

/// The same as it is saved: of the words, those that are not zero.
#[derive(Serialize, Deserialize)]
struct Sparse {
    exponent: i32,
    bounds: Bounds,
    words: Vec<(u32, u64)>,
}

impl From<CoarseGrid> for Sparse {
    fn from(coarse_grid: CoarseGrid) -> Sparse {
        let CoarseGrid { exponent, bounds, words } = coarse_grid;
        let words = (0..).zip(words.into_iter().map(AtomicU64::into_inner)).filter(|(_, word)| *word != 0);
        Sparse { exponent, bounds, words: words.collect() }
    }
}

impl TryFrom<Sparse> for CoarseGrid {
    type Error = String;

    fn try_from(sparse: Sparse) -> Result<CoarseGrid, String> {
        let mut coarse_grid = CoarseGrid { exponent: sparse.exponent, bounds: sparse.bounds, ..CoarseGrid::default() };
        for (number, word) in sparse.words {
            let there = coarse_grid.words.get_mut(number as usize);
            *there.ok_or_else(|| format!("there is no word {number}"))?.get_mut() = word;
        }
        Ok(coarse_grid)
    }
}

impl Clone for CoarseGrid {
    fn clone(&self) -> CoarseGrid {
        let words = self.words.iter().map(|word| AtomicU64::new(word.load(Ordering::Relaxed)));
        CoarseGrid { exponent: self.exponent, bounds: self.bounds, words: words.collect() }
    }
}

impl Default for CoarseGrid {
    fn default() -> CoarseGrid {
        let words = (0..SIDE.pow(3) / 64).map(|_| AtomicU64::new(0)).collect();
        CoarseGrid { exponent: SMALLEST, bounds: Bounds::EMPTY, words }
    }
}

impl Default for Sketching {
    fn default() -> Self {
        Sketching(RwLock::new(CoarseGrid::default()))
    }
}

impl Sketching {
    /// Adds points, all of which lie in `bounds`.
    pub fn add<T: Coordinate>(&self, points: &[[T; 3]], bounds: Bounds) {
        const NO_PANIC: &str = "nothing panics while it holds the coarse grid";
        if points.is_empty() {
            return;
        }
        let mut coarse_grid = self.0.read().expect(NO_PANIC);
        if !coarse_grid.holds(bounds) {
            drop(coarse_grid);
            self.0.write().expect(NO_PANIC).widen(bounds);
            coarse_grid = self.0.read().expect(NO_PANIC);
        }
        let inverse = coarse_grid.inverse();
        for point in points {
            let place = place(point.map(|c| whole(c.into(), inverse)));
            let (word, bit) = (&coarse_grid.words[place / 64], 1 << (place % 64));
            // Nearly all points find their cell's bit set.
            if word.load(Ordering::Relaxed) & bit == 0 {
                word.fetch_or(bit, Ordering::Relaxed);
            }
        }
    }

    /// All cells of the points.
    pub fn finish(self) -> CoarseGrid {
        self.0.into_inner().expect("nothing panicked while it held the coarse grid")
    }
}

impl CoarseGrid {
    /// The cells' side.
    pub fn side(&self) -> f64 {
        2f64.powi(self.exponent)
    }

    /// The lowest place of a cell along each axis, in sides from zero, and the number of places up to the highest.
    pub fn extent(&self) -> ([i64; 3], [u32; 3]) {
        let ([low, high], inverse) = ([self.bounds.min, self.bounds.max], self.inverse());
        let low = low.map(|c| whole(c, inverse));
        (low, std::array::from_fn(|a| (whole(high[a], inverse) - low[a]) as u32 + 1))
    }

    /// Along each axis: whether some planes of cells between others are empty. A gap of three sides shows.
    pub fn has_gaps(&self) -> [bool; 3] {
        let (_, cells) = self.extent();
        let mut planes = cells.map(|cells| vec![false; cells as usize]);
        for cell in self.cells() {
            planes.iter_mut().zip(cell).for_each(|(planes, plane)| planes[plane as usize] = true);
        }
        planes.map(|planes| planes.contains(&false))
    }

    /// The cells, each by its place above the lowest, in no particular order.
    pub fn cells(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        let (low, cells) = self.extent();
        // A point on a cell's end that was sketched with smaller cells may be one above what it gives now.
        self.places().map(move |place| std::array::from_fn(|a| ((place[a] - low[a]) as u32).min(cells[a] - 1)))
    }

    /// How many cells there are when they are taken together by 2^`halvings` along every axis, from the lowest place on.
    pub fn count(&self, halvings: u32) -> u64 {
        let side = (SIDE as usize >> halvings) + 1;
        let mut words = vec![0u64; side.pow(3).div_ceil(64)];
        for cell in self.cells() {
            let [x, y, z] = cell.map(|c| (c >> halvings) as usize);
            let number = (z * side + y) * side + x;
            words[number / 64] |= 1 << (number % 64);
        }
        words.iter().map(|word| u64::from(word.count_ones())).sum()
    }

    /// The cells' places, in sides from zero.
    fn places(&self) -> impl Iterator<Item = [i64; 3]> + '_ {
        let (low, _) = self.extent();
        let bits =
            |word: u64| std::iter::successors(Some(word), |w| Some(w & w.wrapping_sub(1))).take_while(|w| *w != 0);
        let words =
            self.words.iter().map(|word| word.load(Ordering::Relaxed)).enumerate().filter(|(_, word)| *word != 0);
        words.flat_map(move |(i, word)| bits(word).map(move |w| i * 64 + w.trailing_zeros() as usize)).map(move |bit| {
            let side = SIDE as usize;
            let remainder = [bit % side, bit / side % side, bit / side / side];
            std::array::from_fn(|a| low[a] + (remainder[a] as i64 - low[a]).rem_euclid(i64::from(SIDE)))
        })
    }

    /// The columns of cells that points lie in, seen along z: each once, by its place above the lowest along x and y, in order.
    pub fn columns(&self) -> Vec<[u32; 2]> {
        let mut columns: Vec<[u32; 2]> = self.cells().map(|[x, y, _]| [x, y]).collect();
        columns.sort_unstable();
        columns.dedup();
        columns
    }

    /// About how large an area the cloud's `points` cover, seen along z: that of their columns, of which those that have a neighbour without points count half.
    /// Columns are so wide that `FILLED` points or more fall to one on average: narrower ones may be empty between the points.
    pub fn area(&self, points: u64) -> f64 {
        let (mut columns, mut side) = (self.columns(), self.side());
        while columns.len() > 1 && points < FILLED * columns.len() as u64 {
            columns.iter_mut().for_each(|column| *column = column.map(|c| c / 2));
            columns.sort_unstable();
            columns.dedup();
            side *= 2.0;
        }
        let has = |x: i64, y: i64| {
            let column = u32::try_from(x).ok().zip(u32::try_from(y).ok());
            column.is_some_and(|(x, y)| columns.binary_search(&[x, y]).is_ok())
        };
        let share = |column: &[u32; 2]| {
            let [x, y] = column.map(i64::from);
            let inner = has(x - 1, y) && has(x + 1, y) && has(x, y - 1) && has(x, y + 1);
            if inner { 1.0 } else { 0.5 }
        };
        columns.iter().map(share).sum::<f64>() * side * side
    }

    /// The side of the square of that area that one of the cloud's `points` has, on average.
    pub fn spacing(&self, points: u64) -> f64 {
        (self.area(points) / points as f64).sqrt()
    }

    /// About how many squares of side `side`, lying at whole numbers of sides along x and y, a surface through points in `bounds` touches: those that the columns
    /// touch within the bounds, or their share of the columns' area where squares are smaller than half a column.
    pub fn squares(&self, bounds: &Bounds, side: f64) -> u64 {
        let (low, _) = self.extent();
        // A column along an axis, in sides.
        let ratio = self.side() / side;
        let within = |a: usize, place: u32| {
            let from = (low[a] as f64 + f64::from(place)) * ratio;
            [from.max(bounds.min[a] / side), (from + ratio).next_down().min(bounds.max[a] / side)]
        };
        let columns = self.columns();
        if ratio > 2.0 {
            let length = |a: usize, place: u32| {
                let [from, to] = within(a, place);
                (to - from).max(0.0)
            };
            return columns.iter().map(|&[x, y]| length(0, x) * length(1, y)).sum::<f64>().min(1e18) as u64;
        }
        let range = |a: usize, place: u32| {
            let [from, to] = within(a, place).map(|c| c.floor() as i64);
            from..=to
        };
        let squares =
            columns.iter().flat_map(|&[x, y]| range(0, x).flat_map(move |x| range(1, y).map(move |y| [x, y])));
        squares.collect::<BTreeSet<[i64; 2]>>().len() as u64
    }

    /// The box of the cells that hang together and are most, if hardly any others are there and they stretch the box of the points, `bounds`, by a half or more: a body, and a few points far off.
    /// Cells hang together if no gap of four sides is between them. The box holds all points of the body.
    pub fn body(&self, bounds: &Bounds) -> Option<Bounds> {
        let (low, cells) = self.extent();
        let halves = cells.map(|cells| cells.div_ceil(2) as usize);
        let number = |cell: [usize; 3]| (cell[2] * halves[1] + cell[1]) * halves[0] + cell[0];
        let mut waits = vec![false; halves.iter().product()];
        let mut all: Vec<[usize; 3]> = self.cells().map(|cell| cell.map(|c| c as usize / 2)).collect();
        all.sort_unstable();
        all.dedup();
        all.iter().for_each(|cell| waits[number(*cell)] = true);
        let mut most = (0, [[0; 3]; 2]);
        for start in &all {
            if !std::mem::take(&mut waits[number(*start)]) {
                continue;
            }
            let (mut count, mut corners, mut next) = (0, [*start; 2], vec![*start]);
            while let Some(cell) = next.pop() {
                count += 1;
                corners = [
                    std::array::from_fn(|a| corners[0][a].min(cell[a])),
                    std::array::from_fn(|a| corners[1][a].max(cell[a])),
                ];
                let around = |a: usize| cell[a].saturating_sub(1)..(cell[a] + 2).min(halves[a]);
                for z in around(2) {
                    for y in around(1) {
                        next.extend(
                            around(0).map(|x| [x, y, z]).filter(|beside| std::mem::take(&mut waits[number(*beside)])),
                        );
                    }
                }
            }
            if count > most.0 {
                most = (count, corners);
            }
        }
        let (count, [first, last]) = most;
        if count < BODY || all.len() - count > all.len() / STRAYS {
            return None;
        }
        let end = |place: usize, a: usize| (low[a] + 2 * place as i64) as f64 * self.side();
        let body = Bounds {
            min: std::array::from_fn(|a| end(first[a], a).max(bounds.min[a])),
            max: std::array::from_fn(|a| end(last[a] + 1, a).min(bounds.max[a])),
        };
        (body.longest_side() * STRETCHED <= bounds.longest_side()).then_some(body)
    }

    fn inverse(&self) -> f64 {
        2f64.powi(-self.exponent)
    }

    fn holds(&self, bounds: Bounds) -> bool {
        let both = self.bounds.union(bounds);
        both == self.bounds
    }

    /// Makes room for points in `bounds`.
    fn widen(&mut self, bounds: Bounds) {
        let both = self.bounds.union(bounds);
        let farthest = both.min.iter().chain(&both.max).fold(0.0f64, |most, c| most.max(c.abs()));
        let fits = |exponent: i32| {
            let inverse = 2f64.powi(-exponent);
            farthest * inverse < 2f64.powi(46)
                && (0..3).all(|a| whole(both.max[a], inverse) - whole(both.min[a], inverse) < i64::from(SIDE))
        };
        let mut exponent = self.exponent;
        while !fits(exponent) {
            exponent += 1;
        }
        let coarser = exponent - self.exponent;
        let held: Vec<[i64; 3]> = if coarser > 0 { self.places().collect() } else { Vec::new() };
        (self.exponent, self.bounds) = (exponent, both);
        if coarser > 0 {
            self.words.iter_mut().for_each(|word| *word.get_mut() = 0);
            for cell in held {
                // A cell 2^63 times as large lies at 0 or -1.
                let place = place(cell.map(|c| c >> coarser.min(63)));
                *self.words[place / 64].get_mut() |= 1 << (place % 64);
            }
        }
    }
}

/// The whole number at or below c/side; next to one, it may be the one below.
#[inline]
fn whole(c: f64, inverse: f64) -> i64 {
    // The number's fraction has the last 52 bits, of which the highest is that of 2^51: it is 1 for what is not negative.
    (((c * inverse - 0.5) + TO_WHOLE).to_bits() << 12) as i64 >> 12 ^ i64::MIN >> 12
}

/// The number of a cell's bit.
#[inline]
fn place(cell: [i64; 3]) -> usize {
    let [x, y, z] = cell.map(|c| c as usize % SIDE as usize);
    (z * SIDE as usize + y) * SIDE as usize + x
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    fn bounds_of(points: &[[f64; 3]]) -> Bounds {
        points.iter().fold(Bounds::EMPTY, |bounds, p| bounds.union(Bounds { min: *p, max: *p }))
    }

    #[test]
    fn whole_numbers_are_found_without_a_branch() {
        for (c, expected) in [(0.25, 0), (0.999, 0), (1.25, 1), (-0.25, -1), (-1.25, -2), (1e9 + 0.5, 1_000_000_000)] {
            assert_eq!(whole(c, 1.0), expected, "{c}");
        }
        assert_eq!(whole(-7e12 - 0.5, 1.0), -7_000_000_000_001);
    }

    #[test]
    fn columns_and_their_area_are_those_of_a_map() {
        // A square of 90 by 90, thick in places, in cells of 1.
        let points: Vec<[f64; 3]> = (0..360)
            .flat_map(|i| (0..360).map(move |j| [f64::from(i) / 4.0 + 0.1, f64::from(j) / 4.0 + 0.1, f64::from(i % 7)]))
            .chain([[200.0, 0.5, 0.0]])
            .collect();
        let sketching = Sketching::default();
        sketching.add(&points, bounds_of(&points));
        let coarse_grid = sketching.finish();
        assert_eq!((coarse_grid.side(), coarse_grid.columns().len()), (1.0, 90 * 90 + 1));
        for halvings in 0..9 {
            let together: BTreeSet<[u32; 3]> = coarse_grid.cells().map(|cell| cell.map(|c| c >> halvings)).collect();
            assert_eq!(coarse_grid.count(halvings), together.len() as u64, "{halvings}");
        }
        let area = |points: u64| coarse_grid.area(points) / 8100.0;
        assert!((area(360 * 360) - 1.0).abs() < 0.03, "{}", area(360 * 360));
        // Were they fewer, columns of 1 might be empty between them.
        assert!((area(8100) - 1.0).abs() < 0.1, "{}", area(8100));
    }

    #[test]
    fn strays_are_told_from_a_body() {
        let sphere = |i: u32| {
            let z = (2.0 * f64::from(i) + 1.0) / 20_000.0 - 1.0;
            let (r, angle) = ((1.0 - z * z).sqrt(), 2.399963 * f64::from(i));
            [5.0 + r * angle.cos(), r * angle.sin(), z]
        };
        let body = |strays: &[[f64; 3]]| {
            let points: Vec<[f64; 3]> = (0..20_000).map(sphere).chain(strays.iter().copied()).collect();
            let sketching = Sketching::default();
            sketching.add(&points, bounds_of(&points));
            let bounds = bounds_of(&points);
            sketching.finish().body(&bounds)
        };
        assert_eq!(body(&[]), None);
        // Too near to matter: the longest side is 2.9 instead of 2.
        assert_eq!(body(&[[6.9, 0.0, 0.0]]), None);
        let found = body(&[[9.0, 0.1, 0.2], [4.0, -3.0, 0.0]]).unwrap();
        for a in 0..3 {
            let middle = [5.0, 0.0, 0.0][a];
            assert!(found.min[a] <= middle - 0.99 && found.min[a] > middle - 1.1, "{found:?}");
            assert!(found.max[a] >= middle + 0.99 && found.max[a] < middle + 1.1, "{found:?}");
        }
        // Another body is no stray.
        let twin: Vec<[f64; 3]> = (0..20_000).map(|i| sphere(i).map(|c| c + 9.0)).collect();
        assert_eq!(body(&twin), None);
    }

    #[test]
    fn whole_coordinates_stay_within_the_extent_when_cells_grow() {
        // 130 is an even number of the first cells, and an odd one of those twice as large.
        let blocks = [vec![[0.0; 3], [130.0; 3]], vec![[5.0, 300.0, 5.0]]];
        let sketching = Sketching::default();
        blocks.iter().for_each(|block| sketching.add(block, bounds_of(block)));
        let coarse_grid = sketching.finish();
        let (_, cells) = coarse_grid.extent();
        assert_eq!((coarse_grid.side(), cells[0]), (2.0, 65));
        assert!(coarse_grid.cells().all(|c| (0..3).all(|a| c[a] < cells[a])));
    }

    proptest! {
        #[test]
        fn cells_do_not_depend_on_the_order_of_blocks(
            points in prop::collection::vec(prop::array::uniform3(-1e3f64..1e3), 1..300),
            scale in -20i32..20, offset in -1e6f64..1e6, block in 1usize..50,
        ) {
            let points: Vec<[f64; 3]> =
                points.into_iter().map(|p| p.map(|c| c * 2f64.powi(scale) + offset)).collect();
            let coarse_grid = |points: &[[f64; 3]]| {
                let sketching = Sketching::default();
                points.chunks(block).for_each(|block| sketching.add(block, bounds_of(block)));
                sketching.finish()
            };
            let here = coarse_grid(&points);
            let reversed: Vec<_> = points.iter().rev().copied().collect();
            let there = coarse_grid(&reversed);
            prop_assert_eq!(here.exponent, there.exponent);
            let cells: BTreeSet<_> = here.cells().collect();
            prop_assert_eq!(&cells, &there.cells().collect());
            let (low, cells_along) = here.extent();
            let expected: BTreeSet<[u32; 3]> =
                points.iter().map(|p| std::array::from_fn(|a| (whole(p[a], here.inverse()) - low[a]) as u32)).collect();
            // A point next to a cell's end may fall to either side of it, depending on the sides at the time.
            prop_assert!(cells.symmetric_difference(&expected).count() <= points.len() / 50);
            prop_assert!(cells.iter().all(|c| (0..3).all(|a| c[a] < cells_along[a] && cells_along[a] <= SIDE)));
        }
    }

    /// Points on a square lattice of 200 by 200, a unit apart, from `low` on, and the squares expected of them.
    fn of_lattice(low: [f64; 2], side: f64) -> u64 {
        let place = |i: i32| [low[0] + f64::from(i % 200) + 0.5, low[1] + f64::from(i / 200) + 0.5, 0.0];
        let points: Vec<[f64; 3]> = (0..40_000).map(place).collect();
        let bounds = points.iter().fold(Bounds::EMPTY, |bounds, p| bounds.union(Bounds { min: *p, max: *p }));
        let sketching = Sketching::default();
        sketching.add(&points, bounds);
        sketching.finish().squares(&bounds, side)
    }

    #[test]
    fn squares_are_counted_on_either_side_of_zero() {
        for low in [[0.0, 0.0], [-200.0, -400.0], [-600.0, 800.0]] {
            for (side, squares) in [(1000.0, 1), (50.0, 16), (10.0, 400)] {
                assert_eq!(of_lattice(low, side), squares, "{low:?} {side}");
            }
            // Smaller ones by their area.
            for side in [1.0, 0.01] {
                let share = of_lattice(low, side) as f64 / (200.0 / side).powi(2);
                assert!((share - 1.0).abs() < 0.02, "{low:?} {side}: {share}");
            }
        }
        assert_eq!(of_lattice([-100.0, -100.0], 1e9), 4, "round zero");
        assert!(of_lattice([0.0, 0.0], 1e-300) >= 1_000_000_000_000, "no overflow");
    }
}
