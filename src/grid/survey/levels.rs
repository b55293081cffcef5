//! Samples of the cells that points lie in, on many levels at once, while neither their box nor their number is known.
//!
//! ```text
//!   cells have sides of 2^e of the input's units and lie at multiples of them, whatever the box:
//!
//!   level 0   |               |               |      its cells are as wide as the box's diagonal: the box passes 8 of them at most,
//!   level 1   |       |       |       |       |      so all are kept, and when the box outgrows them, those of the next level are
//!   level 2   |   |   |   |   |   |   |   |   |      found from them
//! ```
//!
//! A level keeps the cells with the lowest hashes, and of a few of them the points with the lowest hashes. Which these are depends on the points alone, not on their
//! order, nor on how they were dealt out to blocks.

use std::collections::BTreeMap;
use std::sync::RwLock;

use crate::points::Coordinate;
use crate::points::bounds::Bounds;

/// Levels of cells, the widest first; each has cells half as wide as the one before.
const LEVELS: u32 = 20;
/// Cells of a level that are kept to count distinct ones: the count is good to about 1/√1024, three per cent.
pub const KEPT: usize = 1024;
/// Cells of a level, of those that are kept, that keep points.
pub const TELLING: usize = 256;
/// Points that such a cell keeps.
pub const PLACES: usize = 16;
/// Cells for each point beyond which finer levels are left out: at four points to a cell, the sampling distance is known.
const ENOUGH_CELLS: f64 = 0.25;

/// Of level 0, cells are wider than the box's diagonal by so much: more than what rounding adds to it.
const WIDER: f64 = 1.001;
/// Cells of level 0 have no smaller sides than 2^-40 of the farthest coordinate, and than this power of two.
const SMALLEST: i32 = -1000;

type Hash = u64;

/// A node of the library's ordered maps has room for so many things, and is at least as full as this unless it is the root; inner nodes have a pointer to one node more.
const NODE: (u64, u64) = (11, 5);

/// What was found out about so many of the things with the lowest hashes.
#[derive(Debug, Clone)]
struct Lowest<V, const MOST: usize> {
    lowest: BTreeMap<Hash, V>,
    /// Higher hashes are not kept.
    highest: Hash,
}

impl<V, const MOST: usize> Lowest<V, MOST> {
    /// Keeps none with higher hashes than `highest`.
    fn up_to(highest: Hash) -> Lowest<V, MOST> {
        Lowest { lowest: BTreeMap::new(), highest }
    }

    /// The most bytes of so many things at most, without what they own; one more is there while another is left out.
    fn bytes(things: u64) -> u64 {
        let pointer = size_of::<usize>() as u64;
        // Its parent and its place there, and lengths, which are aligned.
        let node = NODE.0 * size_of::<(Hash, V)>() as u64 + 2 * pointer;
        let nodes = (things.min(MOST as u64) + 1).div_ceil(NODE.1);
        nodes * node + nodes.div_ceil(NODE.1) * (NODE.0 + 1) * pointer
    }

    /// Adds to what is known of a thing, if that is kept.
    fn add(&mut self, hash: Hash, new: impl FnOnce() -> V, add: impl FnOnce(&mut V)) {
        // Nearly all hashes of small cells are too high, which is soon seen.
        if hash > self.highest {
            return;
        }
        if let Some(known) = self.lowest.get_mut(&hash) {
            return add(known);
        }
        let mut known = new();
        add(&mut known);
        self.lowest.insert(hash, known);
        if self.lowest.len() > MOST {
            self.lowest.pop_last();
        }
        if let Some((&last, _)) = self.lowest.last_key_value().filter(|_| self.lowest.len() == MOST) {
            self.highest = self.highest.min(last);
        }
    }
}

/// A point that a cell keeps, behind its hash and its coordinates' bits.
type Place = (Hash, [u64; 3]);

/// The points of a cell with the lowest hashes, in their order, each place once.
#[derive(Debug, Clone, Default)]
pub struct Places(Vec<Place>);

impl Places {
    #[inline]
    fn add(&mut self, hash: Hash, bits: impl FnOnce() -> [u64; 3]) {
        // Nearly all points' hashes are too high.
        if self.0.len() < PLACES || hash <= self.0[PLACES - 1].0 {
            self.insert((hash, bits()));
        }
    }

    fn insert(&mut self, place: Place) {
        if self.0.len() == PLACES && self.0[PLACES - 1] <= place {
            return;
        }
        if let Err(at) = self.0.binary_search(&place) {
            self.0.truncate(PLACES - 1);
            self.0.insert(at, place);
        }
    }

    /// The most bytes of so many points in so many cells: a vector has room for twice as many as it holds, and for no fewer than four.
    fn bytes(points: u64, cells: u64) -> u64 {
        let room = points.saturating_mul(2).saturating_add(4 * cells).min(PLACES as u64 * cells);
        room * size_of::<Place>() as u64
    }

    /// The points.
    pub fn points(&self) -> impl ExactSizeIterator<Item = [f64; 3]> + '_ {
        self.0.iter().map(|(_, bits)| bits.map(f64::from_bits))
    }
}

/// What is known of the cells of one level.
#[derive(Debug, Clone)]
pub struct Level {
    /// The cells, with their points' number.
    counts: Lowest<([i64; 3], u64), KEPT>,
    places: Lowest<Places, TELLING>,
}

impl Level {
    /// The most bytes of a level of so many points and cells.
    fn bytes(points: u64, cells: u64) -> u64 {
        let telling = cells.min(TELLING as u64 + 1);
        Lowest::<([i64; 3], u64), KEPT>::bytes(cells)
            + Lowest::<Places, TELLING>::bytes(cells)
            + Places::bytes(points, telling)
    }

    fn up_to(highest: [Hash; 2]) -> Level {
        Level { counts: Lowest::up_to(highest[0]), places: Lowest::up_to(highest[1]) }
    }

    /// The hashes up to which cells and points are kept.
    fn highest(&self) -> [Hash; 2] {
        [self.counts.highest, self.places.highest]
    }

    fn add(&mut self, other: Level) {
        for (hash, (cell, points)) in other.counts.lowest {
            self.counts.add(hash, || (cell, 0), |known| known.1 += points);
        }
        for (hash, places) in other.places.lowest {
            self.places.add(hash, Places::default, |known| {
                places.0.into_iter().for_each(|place| known.insert(place));
            });
        }
    }

    /// The level above, of one whose cells were all kept.
    fn above(&self) -> Level {
        let mut above = Level::up_to([Hash::MAX; 2]);
        for (below, (cell, points)) in &self.counts.lowest {
            let cell = cell.map(|c| c >> 1);
            let hash = hash(cell.map(|c| c as u64));
            above.counts.add(hash, || (cell, 0), |known| known.1 += points);
            let places = self.places.lowest.get(below);
            above.places.add(hash, Places::default, |known| {
                places.into_iter().flat_map(|places| &places.0).for_each(|place| known.insert(*place));
            });
        }
        above
    }

    /// About how many cells have points: if the highest hash that is kept is the fraction f of all hashes, there are KEPT / f.
    pub fn distinct(&self) -> f64 {
        let kept = &self.counts.lowest;
        match kept.last_key_value() {
            Some((&last, _)) if kept.len() == KEPT => (KEPT - 1) as f64 * (u64::MAX as f64 / last as f64),
            _ => kept.len() as f64,
        }
    }

    /// How many points each of the kept cells has. All were counted: a cell that is kept to the end was never left out before.
    pub fn counts(&self) -> impl ExactSizeIterator<Item = u64> + '_ {
        self.counts.lowest.values().map(|(_, points)| *points)
    }

    /// The cells that keep points: how many points each has, and those that it keeps.
    pub fn telling(&self) -> impl Iterator<Item = (u64, &Places)> {
        let points = |hash: &Hash| self.counts.lowest.get(hash).map_or(0, |(_, points)| *points);
        self.places.lowest.iter().map(move |(hash, places)| (points(hash), places))
    }
}

/// The levels of a cloud.
#[derive(Debug, Clone)]
pub struct Levels {
    bounds: Bounds,
    /// Cells of the first level have sides of two to the power of this, cells of the next half as wide.
    widest: i32,
    levels: Vec<Level>,
}

impl Levels {
    /// The most bytes of the levels of so many points.
    pub fn bytes(points: u64) -> u64 {
        // A box as wide as a cell of level 0 passes eight of them, and each has eight on the next.
        let cells = |level: u32| points.min(8u64.saturating_pow(level + 1));
        (0..LEVELS).map(|level| size_of::<Level>() as u64 + Level::bytes(points, cells(level))).sum()
    }

    /// The most bytes beside them while they are found, of so many points: places, codes, hashes, where cells begin.
    pub fn bytes_finding(points: u64) -> u64 {
        let (place, code) = (size_of::<[i64; 3]>(), size_of::<(u64, u32)>());
        points * (place + code).max(code + size_of::<Hash>() + size_of::<u32>()) as u64
    }

    /// Those of no points.
    fn new() -> Levels {
        Levels { bounds: Bounds::EMPTY, widest: SMALLEST, levels: Vec::new() }
    }

    /// The levels, the widest cells first, each with its cells' side.
    pub fn iter(&self) -> impl Iterator<Item = (f64, &Level)> {
        self.levels.iter().enumerate().map(|(i, level)| (2f64.powi(self.widest - i as i32), level))
    }

    /// The level with the least cells of more than this side.
    pub fn wider_than(&self, side: f64) -> Option<(f64, &Level)> {
        self.iter().take_while(|(wide, _)| *wide > side).last()
    }

    /// Adds the levels of other points, and leaves out those finer than the first that has more cells than `enough`.
    fn add(&mut self, mut other: Levels, enough: f64) {
        if self.levels.is_empty() {
            *self = other;
        } else {
            let bounds = self.bounds.union(other.bounds);
            self.widen(bounds);
            other.widen(bounds);
            // Those that were left out of either are of no use.
            self.levels.truncate(other.levels.len());
            self.levels.iter_mut().zip(other.levels).for_each(|(level, more)| level.add(more));
        }
        self.cut(enough);
    }

    /// Leaves out those finer than the first that has more cells than `enough`.
    fn cut(&mut self, enough: f64) {
        let last = self.levels.iter().position(|level| level.distinct() > enough);
        self.levels.truncate(last.map_or(self.levels.len(), |last| last + 1));
    }

    /// Makes them levels of points in `bounds`, which holds those at hand.
    fn widen(&mut self, bounds: Bounds) {
        let widest = widest(&bounds);
        while self.widest < widest {
            self.widest += 1;
            self.levels.insert(0, self.levels[0].above());
            self.levels.truncate(LEVELS as usize);
        }
        self.bounds = bounds;
    }
}

/// The exponent of the side of level 0's cells, of points in `bounds`.
fn widest(bounds: &Bounds) -> i32 {
    let farthest = bounds.min.iter().chain(&bounds.max).fold(0.0f64, |most, c| most.max(c.abs()));
    let diagonal = bounds.extent().into_iter().fold(0.0, libm::hypot) * WIDER;
    let exponent = |of: f64| if of > 0.0 { libm::ilogb(of).min(1000) + 1 } else { SMALLEST };
    exponent(diagonal).max(exponent(farthest) - 40).max(SMALLEST)
}

/// The levels of a cloud, while its points arrive.
#[derive(Debug)]
pub struct Sketching {
    levels: Levels,
    enough: f64,
}

/// How far the levels are: what of the next points is not going to be kept.
#[derive(Debug)]
pub struct Known(RwLock<Bar>);

#[derive(Debug, Clone, Copy)]
struct Bar {
    bounds: Bounds,
    widest: i32,
    levels: u32,
    highest: [[Hash; 2]; LEVELS as usize],
}

impl Default for Known {
    fn default() -> Self {
        Known(RwLock::new(Bar {
            bounds: Bounds::EMPTY,
            widest: SMALLEST,
            levels: LEVELS,
            highest: [[Hash::MAX; 2]; LEVELS as usize],
        }))
    }
}

const NO_PANIC: &str = "nothing panics while it holds what is known";

impl Known {
    /// The levels of some points, all of which lie in `bounds`; without what is not going to be kept.
    pub fn levels_of<T: Coordinate>(&self, points: &[[T; 3]], bounds: Bounds) -> Option<Levels> {
        if points.is_empty() {
            return None;
        }
        let bar = *self.0.read().expect(NO_PANIC);
        let bounds = bar.bounds.union(bounds);
        let widest = widest(&bounds);
        let wider = if bar.bounds == Bounds::EMPTY { 0 } else { (widest - bar.widest) as u32 };
        let levels = (bar.levels + wider).min(LEVELS);
        // Of a level that is new, nothing is known.
        let highest = |level: u32| level.checked_sub(wider).map_or([Hash::MAX; 2], |i| bar.highest[i as usize]);
        let mut found: Vec<Level> = (0..levels).map(|level| Level::up_to(highest(level))).collect();

        let scale = 2f64.powi(LEVELS as i32 - widest);
        let places: Vec<[i64; 3]> = points.iter().map(|p| place(widened(p), scale)).collect();
        let mut lowest = places[0];
        places.iter().for_each(|place| (0..3).for_each(|a| lowest[a] = lowest[a].min(place[a])));
        let origin = lowest.map(|c| c >> LEVELS << LEVELS);
        // Nothing lies beyond two cells of level 0.
        let within = |place: i64, origin: i64| place.saturating_sub(origin).min((2 << LEVELS) - 1) as u64;
        let code = |p: &[i64; 3]| {
            let [x, y, z] = [within(p[0], origin[0]), within(p[1], origin[1]), within(p[2], origin[2])];
            spread(x) | spread(y) << 1 | spread(z) << 2
        };
        let mut codes: Vec<(u64, u32)> = places.iter().map(code).zip(0..).collect();
        drop(places);
        codes.sort_unstable();
        let bits = |number: usize| place_bits(widened(&points[codes[number].1 as usize]));
        let hashes: Vec<Hash> = (0..codes.len()).map(|number| hash(bits(number))).collect();
        // Along this curve, the cells within a larger one lie side by side, on every level: where each begins.
        let mut begins: Vec<u32> = Vec::with_capacity(codes.len());
        for level in (0..levels).rev() {
            let shift = LEVELS - level;
            let first =
                |number: usize| number == 0 || codes[number].0 >> (3 * shift) != codes[number - 1].0 >> (3 * shift);
            if begins.is_empty() {
                begins.extend((0..codes.len() as u32).filter(|number| first(*number as usize)));
            } else {
                begins.retain(|number| first(*number as usize));
            }
            let base = [origin[0] >> shift, origin[1] >> shift, origin[2] >> shift];
            let Level { counts, places } = &mut found[level as usize];
            for (i, &begin) in begins.iter().enumerate() {
                let begin = begin as usize;
                let code = codes[begin].0 >> (3 * shift);
                let cell = [
                    base[0] + gathered(code) as i64,
                    base[1] + gathered(code >> 1) as i64,
                    base[2] + gathered(code >> 2) as i64,
                ];
                let hash = hash([cell[0] as u64, cell[1] as u64, cell[2] as u64]);
                if hash > counts.highest {
                    continue;
                }
                let end = begins.get(i + 1).map_or(codes.len(), |next| *next as usize);
                counts.add(hash, || (cell, 0), |known| known.1 += (end - begin) as u64);
                places.add(hash, Places::default, |known| {
                    let hashes = hashes[begin..end].iter().zip(begin..end);
                    hashes.for_each(|(hash, number)| known.add(*hash, || bits(number)));
                });
            }
        }
        Some(Levels { bounds, widest, levels: found })
    }
}

impl Sketching {
    /// Of a cloud with so many records at most, if that is known.
    pub fn new(records: Option<u64>) -> Sketching {
        Sketching {
            levels: Levels::new(),
            enough: records.map_or(f64::INFINITY, |records| ENOUGH_CELLS * records as f64),
        }
    }

    /// Adds the levels of more points, and tells the next ones.
    pub fn add(&mut self, levels: Levels, known: &Known) {
        self.levels.add(levels, self.enough);
        let Levels { bounds, widest, levels } = &self.levels;
        let mut highest = [[Hash::MAX; 2]; LEVELS as usize];
        highest.iter_mut().zip(levels).for_each(|(highest, level)| *highest = level.highest());
        *known.0.write().expect(NO_PANIC) =
            Bar { bounds: *bounds, widest: *widest, levels: levels.len() as u32, highest };
    }

    /// The levels of all points, of which there are so many; none finer than the first with more cells than a quarter of that, however many records there were.
    pub fn finish(mut self, points: u64) -> Levels {
        self.levels.cut(ENOUGH_CELLS * points as f64);
        self.levels
    }
}

/// A point's coordinates, which are `f64` without loss.
#[inline]
fn widened<T: Coordinate>(p: &[T; 3]) -> [f64; 3] {
    [p[0].into(), p[1].into(), p[2].into()]
}

/// Coordinates' bits; the two zeros are one place.
#[inline]
fn place_bits(p: [f64; 3]) -> [u64; 3] {
    [(p[0] + 0.0).to_bits(), (p[1] + 0.0).to_bits(), (p[2] + 0.0).to_bits()]
}

/// Where a point lies along the cells' axes, in whole parts of one over `scale`. The axes are at right angles to each other and askew to the cloud's, since floors and walls
/// across an axis would pass fewer cells than other surfaces.
#[inline]
fn place(p: [f64; 3], scale: f64) -> [i64; 3] {
    let [x, y, z] = [p[0] / 3.0, p[1] / 3.0, p[2] / 3.0];
    // Faster than the library's rounding, which is a call.
    let whole = |c: f64| {
        let near = c as i64;
        near.saturating_sub(i64::from(near as f64 > c))
    };
    [
        whole((2.0 * x - y + 2.0 * z) * scale),
        whole((2.0 * x + 2.0 * y - z) * scale),
        whole((-x + 2.0 * y + 2.0 * z) * scale),
    ]
}

/// A number below 2²¹ with two zeros before each of its bits: a third of a Morton code.
#[inline]
fn spread(mut c: u64) -> u64 {
    c = (c | c << 32) & 0x001F_0000_0000_FFFF;
    c = (c | c << 16) & 0x001F_0000_FF00_00FF;
    c = (c | c << 8) & 0x100F_00F0_0F00_F00F;
    c = (c | c << 4) & 0x10C3_0C30_C30C_30C3;
    (c | c << 2) & 0x1249_2492_4924_9249
}

/// The number that was spread.
#[inline]
fn gathered(mut c: u64) -> u64 {
    c &= 0x1249_2492_4924_9249;
    c = (c | c >> 2) & 0x10C3_0C30_C30C_30C3;
    c = (c | c >> 4) & 0x100F_00F0_0F00_F00F;
    c = (c | c >> 8) & 0x001F_0000_FF00_00FF;
    c = (c | c >> 16) & 0x001F_0000_0000_FFFF;
    (c | c >> 32) & 0x001F_FFFF
}

/// A number that looks like a random one, of three. Each is mixed before the next is joined to it: the bits of k and of -k, times any number, differ in all but the last few, as those of a
/// small number and of a negative one do.
#[inline]
fn hash(of: [u64; 3]) -> Hash {
    let last = mixed(of[2]);
    mixed(of[0].wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ mixed(of[1].wrapping_mul(0xD6E8_FEB8_6659_FD93) ^ last))
}

#[inline]
fn mixed(mut h: u64) -> u64 {
    h = (h ^ h >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ h >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    h ^ h >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_cells_near_the_origin_have_one_hash() {
        let hashes: std::collections::BTreeSet<Hash> =
            (0..64u64.pow(3)).map(|i| hash([i % 64, i / 64 % 64, i / 4096].map(|c| c.wrapping_sub(32)))).collect();
        assert_eq!(hashes.len(), 64usize.pow(3));
    }

    #[test]
    fn numbers_are_gathered_again() {
        for c in [0, 1, 5, (1 << 20) - 1, 1 << 20, 0x15_5555, 0x0A_AAAA, 0x1F_FFFF] {
            assert_eq!(gathered(spread(c) | spread(!c & 0x1F_FFFF) << 1), c);
        }
    }
}
