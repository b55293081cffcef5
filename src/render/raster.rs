//! Triangles to samples: which triangle is nearest at each of a view's samples.
//!
//! ```text
//!   a tile: 16 x 16 pixels                 a pixel: 3 x 3 samples        between two samples: 256 places
//!   +--+--+--+- ... -+                     +---------+                    o- - - - - - - -o
//!   |  |  |  |       |   one lock,         | o  o  o |                    vertices are moved onto places, so all
//!   +--+--+--+- ... -+   36 KiB            | o  o  o |                    that follows is whole numbers and exact
//!   |  |  |  |       |                     | o  o  o |
//! ```
//!
//! A sample lies in a triangle if it lies on the inner side of its edges; one that lies on an edge belongs to the triangle to whose inside x grows, or y if
//! x does not: of two triangles that share an edge just one has it, and there are neither cracks nor samples drawn twice. A triangle that is so small or
//! thin that its box holds no sample is dropped after six comparisons.
//!
//! At each sample the triangle with the least *key* stays, depth first, then number. The least of some keys is the same in whatever order they come, so
//! triangles may be drawn by any number of threads, in any order; a tile is locked while a block's triangles are drawn to it.

use std::ops::Range;
use std::sync::Mutex;

/// Samples along a side of a pixel.
pub const SAMPLES: usize = 3;
/// Pixels along a side of a tile.
pub const TILE: usize = 16;
/// Samples along a side of a tile.
const SIDE: i64 = (TILE * SAMPLES) as i64;
/// Places from one sample to the next.
pub const PLACES: i64 = 256;
/// Bytes of a tile.
pub const TILE_BYTES: u64 = (SIDE * SIDE) as u64 * size_of::<Sample>() as u64;
/// The largest depth of a vertex.
pub const FARTHEST: u32 = (1 << (64 - NUMBER_BITS)) - 2;
/// Bits of a key that hold the triangle's number; depth has the others.
const NUMBER_BITS: u32 = 36;
/// Triangles that keys can tell apart.
pub const MOST_TRIANGLES: u64 = 1 << NUMBER_BITS;
/// From this width on, the part of a row that a triangle covers is calculated instead of tried.
const WIDE: i64 = 8;

/// A vertex in a view: places from the upper left corner, and depth, 0 being nearest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Placed {
    /// To the right.
    pub x: i32,
    /// Downwards.
    pub y: i32,
    /// Away from the viewer, up to [`FARTHEST`]; [`Placed::NOWHERE`] has more.
    pub depth: u32,
}

impl Placed {
    /// A vertex that is not finite.
    pub const NOWHERE: Placed = Placed { x: 0, y: 0, depth: u32::MAX };
}

/// What is seen at a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sample {
    /// Depth and number of the triangle.
    key: u64,
    /// What the triangle's painter gave.
    pub paint: Paint,
}

/// What is known of a surface where it is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Paint {
    /// Its normal, packed.
    pub normal: u32,
    /// Its colour and side, packed.
    pub tone: u32,
}

impl Sample {
    /// Nothing is seen.
    pub const EMPTY: Sample = Sample { key: u64::MAX, paint: Paint { normal: 0, tone: 0 } };

    /// How far away the surface is, if there is one.
    #[inline]
    pub fn depth(&self) -> Option<u32> {
        (self.key != u64::MAX).then_some((self.key >> NUMBER_BITS) as u32)
    }

    /// The number of the triangle that is seen, if there is one.
    #[cfg(test)]
    pub fn number(&self) -> Option<u64> {
        (self.key != u64::MAX).then_some(self.key & (MOST_TRIANGLES - 1))
    }
}

/// Columns and rows of samples, both ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Area {
    columns: (i64, i64),
    rows: (i64, i64),
}

impl Area {
    /// The samples in the box of a triangle.
    #[inline]
    fn of([a, b, c]: &[Placed; 3]) -> Area {
        // Sample i lies at i * PLACES + PLACES / 2.
        let samples = |low: i32, high: i32| {
            ((i64::from(low) + PLACES / 2 - 1).div_euclid(PLACES), (i64::from(high) - PLACES / 2).div_euclid(PLACES))
        };
        Area {
            columns: samples(a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x)),
            rows: samples(a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y)),
        }
    }

    fn within(self, other: Area) -> Area {
        let both = |a: (i64, i64), b: (i64, i64)| (a.0.max(b.0), a.1.min(b.1));
        Area { columns: both(self.columns, other.columns), rows: both(self.rows, other.rows) }
    }

    fn is_empty(self) -> bool {
        self.columns.0 > self.columns.1 || self.rows.0 > self.rows.1
    }
}

/// The line through two corners: a x + b y + c is 0 on it, more on the side of the third.
#[derive(Debug, Clone, Copy)]
struct Edge {
    a: i64,
    b: i64,
    c: i64,
    /// -1 if what lies on it is not in the triangle.
    bias: i64,
}

impl Edge {
    fn through(from: Placed, to: Placed, sign: i64) -> Edge {
        let [(x0, y0), (x1, y1)] = [from, to].map(|p| (i64::from(p.x), i64::from(p.y)));
        let (a, b) = (sign * (y0 - y1), sign * (x1 - x0));
        Edge { a, b, c: -(a * x0 + b * y0), bias: if a > 0 || (a == 0 && b > 0) { 0 } else { -1 } }
    }

    #[inline]
    fn at(&self, column: i64, row: i64) -> i64 {
        self.a * (column * PLACES + PLACES / 2) + self.b * (row * PLACES + PLACES / 2) + self.c
    }
}

/// A triangle ready to be drawn. Its corner k has weight 1 where edge k is farthest.
#[derive(Debug, Clone, Copy)]
pub struct Triangle {
    edges: [Edge; 3],
    depths: [f64; 3],
    /// The inverse of twice the area, in places.
    inverse: f64,
    area: Area,
    /// Whether its corners are counter-clockwise as seen.
    pub front: bool,
}

impl Triangle {
    /// `None` if it is seen edge-on, or has fallen together.
    #[inline]
    pub fn new(corners: [Placed; 3]) -> Option<Triangle> {
        let [a, b, c] = corners;
        let [(x0, y0), (x1, y1), (x2, y2)] = corners.map(|p| (i64::from(p.x), i64::from(p.y)));
        // y grows downwards: what is counter-clockwise as seen has a negative area.
        let twice = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0);
        if twice == 0 {
            return None;
        }
        let sign = twice.signum();
        Some(Triangle {
            edges: [Edge::through(b, c, sign), Edge::through(c, a, sign), Edge::through(a, b, sign)],
            depths: corners.map(|p| f64::from(p.depth)),
            inverse: 1.0 / twice.abs() as f64,
            area: Area::of(&corners),
            front: twice < 0,
        })
    }

    /// Whether some sample of `area` may lie on the inner side of every edge.
    fn may_reach(&self, area: &Area) -> bool {
        self.edges.iter().all(|edge| {
            let column = if edge.a > 0 { area.columns.1 } else { area.columns.0 };
            let row = if edge.b > 0 { area.rows.1 } else { area.rows.0 };
            edge.at(column, row) + edge.bias >= 0
        })
    }

    /// A range that holds all columns in `low..=high` of a row that are in the triangle.
    #[inline]
    fn stretch(&self, (mut low, mut high): (i64, i64), row: i64) -> (i64, i64) {
        for edge in &self.edges {
            // value + step * i >= 0 for columns low + i
            let (value, step) = (edge.at(low, row) + edge.bias, edge.a * PLACES);
            if value < 0 {
                if step <= 0 {
                    return (low, low - 1);
                }
                low += (-value + step - 1) / step;
            } else if step < 0 {
                high = high.min(low + value / -step);
            }
        }
        (low, high)
    }
}

/// Some rows of tiles of a view, and what is seen at their samples.
#[derive(Debug)]
pub struct Band {
    /// Tiles of a row.
    columns: i64,
    /// The tile rows of the view.
    rows: Range<i64>,
    tiles: Vec<Mutex<Vec<Sample>>>,
}

const NO_PANIC: &str = "nothing panics while a tile is held";

/// The triangles of a block by the tiles that they reach.
#[derive(Debug, Default)]
pub struct Bins {
    /// A tile and a triangle of the block.
    pairs: Vec<(u32, u32)>,
    /// Where the tiles are that were in use when their turn came.
    later: Vec<Range<usize>>,
}

/// Pairs of a tile and a triangle that are held at a time.
pub const MOST_PAIRS: usize = 1 << 16;

impl Band {
    /// Nothing is seen yet in tile rows `rows` of a view that is `width` pixels wide. 36 KiB a tile.
    pub fn new(width: usize, rows: Range<usize>) -> Band {
        let columns = width.div_ceil(TILE);
        let tile = || Mutex::new(vec![Sample::EMPTY; (SIDE * SIDE) as usize]);
        let tiles = (0..columns * rows.len()).map(|_| tile()).collect();
        Band { columns: columns as i64, rows: rows.start as i64..rows.end as i64, tiles }
    }

    fn area(&self) -> Area {
        Area { columns: (0, self.columns * SIDE - 1), rows: (self.rows.start * SIDE, self.rows.end * SIDE - 1) }
    }

    /// Its rows of tiles.
    pub fn rows(&self) -> Range<usize> {
        self.rows.start as usize..self.rows.end as usize
    }

    /// The places that its rows of samples reach from, and to: what has no part of that is not seen in it.
    pub fn reach(&self) -> Range<i64> {
        self.rows.start * SIDE * PLACES..self.rows.end * SIDE * PLACES
    }

    /// Draws a block's triangles, of which `corners` tells where they are; the first has number `first`. `painter` makes of a triangle that is seen, once, what tells
    /// the paint at the corners' weights.
    pub fn draw<P: FnMut([f32; 3]) -> Paint>(
        &self,
        bins: &mut Bins,
        first: u64,
        count: usize,
        corners: impl Fn(usize) -> [Placed; 3],
        painter: impl Fn(usize, bool) -> P,
    ) {
        let whole = self.area();
        for i in 0..count {
            let placed = corners(i);
            if placed.iter().any(|p| p.depth > FARTHEST) {
                continue;
            }
            let area = Area::of(&placed).within(whole);
            if area.is_empty() {
                continue;
            }
            let tiles = |(low, high): (i64, i64)| (low / SIDE, high / SIDE);
            let (columns, rows) = (tiles(area.columns), tiles(area.rows));
            if columns.0 == columns.1 && rows.0 == rows.1 {
                bins.pairs.push((self.tile(columns.0, rows.0), i as u32));
            } else if let Some(triangle) = Triangle::new(placed) {
                for row in rows.0..=rows.1 {
                    for column in columns.0..=columns.1 {
                        if triangle.may_reach(&tile_area(column, row)) {
                            bins.pairs.push((self.tile(column, row), i as u32));
                            if bins.pairs.len() >= MOST_PAIRS {
                                self.empty(bins, first, &corners, &painter);
                            }
                        }
                    }
                }
            }
            if bins.pairs.len() >= MOST_PAIRS {
                self.empty(bins, first, &corners, &painter);
            }
        }
        self.empty(bins, first, &corners, &painter);
    }

    fn tile(&self, column: i64, row: i64) -> u32 {
        ((row - self.rows.start) * self.columns + column) as u32
    }

    /// Draws what is in the bins.
    fn empty<P: FnMut([f32; 3]) -> Paint>(
        &self,
        bins: &mut Bins,
        first: u64,
        corners: &impl Fn(usize) -> [Placed; 3],
        painter: &impl Fn(usize, bool) -> P,
    ) {
        let Bins { pairs, later } = bins;
        pairs.sort_unstable();
        let fill = |samples: &mut [Sample], pairs: &[(u32, u32)]| {
            let tile = i64::from(pairs[0].0);
            let area = tile_area(tile % self.columns, self.rows.start + tile / self.columns);
            for &(_, i) in pairs {
                if let Some(triangle) = Triangle::new(corners(i as usize)) {
                    let number = first + u64::from(i);
                    cover(samples, &area, &triangle, number, || painter(i as usize, triangle.front));
                }
            }
        };
        later.clear();
        let mut start = 0;
        while start < pairs.len() {
            let tile = pairs[start].0;
            let end = start + pairs[start..].partition_point(|pair| pair.0 == tile);
            match self.tiles[tile as usize].try_lock() {
                Ok(mut samples) => fill(&mut samples, &pairs[start..end]),
                Err(_) => later.push(start..end),
            }
            start = end;
        }
        for run in later.drain(..) {
            let mut samples = self.tiles[pairs[run.start].0 as usize].lock().expect(NO_PANIC);
            fill(&mut samples, &pairs[run]);
        }
        pairs.clear();
    }

    /// Visits the pixels of a row of tiles, each with its column and row in the view, and its samples.
    pub fn pixels(&self, row: usize, width: usize, height: usize, mut visit: impl FnMut(usize, usize, &[Sample])) {
        let first = (row as i64 - self.rows.start) * self.columns;
        let mut samples = [Sample::EMPTY; SAMPLES * SAMPLES];
        for column in 0..self.columns as usize {
            let tile = self.tiles[first as usize + column].lock().expect(NO_PANIC);
            for y in 0..TILE.min(height.saturating_sub(row * TILE)) {
                for x in 0..TILE.min(width.saturating_sub(column * TILE)) {
                    for (line, out) in samples.chunks_exact_mut(SAMPLES).enumerate() {
                        let at = (y * SAMPLES + line) * SIDE as usize + x * SAMPLES;
                        out.copy_from_slice(&tile[at..at + SAMPLES]);
                    }
                    visit(column * TILE + x, row * TILE + y, &samples);
                }
            }
        }
    }
}

fn tile_area(column: i64, row: i64) -> Area {
    let samples = |tile: i64| (tile * SIDE, tile * SIDE + SIDE - 1);
    Area { columns: samples(column), rows: samples(row) }
}

/// Draws a triangle to a tile.
#[inline]
fn cover<P: FnMut([f32; 3]) -> Paint>(
    samples: &mut [Sample],
    tile: &Area,
    triangle: &Triangle,
    number: u64,
    painter: impl Fn() -> P,
) {
    let area = triangle.area.within(*tile);
    let mut paint = None;
    for row in area.rows.0..=area.rows.1 {
        let (mut low, mut high) = area.columns;
        if high - low >= WIDE {
            (low, high) = triangle.stretch((low, high), row);
        }
        let [mut u, mut v, mut w] = triangle.edges.map(|edge| edge.at(low, row));
        let [bu, bv, bw] = triangle.edges.map(|edge| edge.bias);
        let line = (row - tile.rows.0) * SIDE - tile.columns.0;
        for column in low..=high {
            if ((u + bu) | (v + bv) | (w + bw)) >= 0 {
                let weights = [u, v, w].map(|e| e as f64);
                let [near, middle, far] = triangle.depths;
                let depth = (weights[0] * near + weights[1] * middle + weights[2] * far) * triangle.inverse;
                let key = (depth as u64) << NUMBER_BITS | number;
                let sample = &mut samples[(line + column) as usize];
                if key < sample.key {
                    let paint = paint.get_or_insert_with(&painter);
                    *sample = Sample { key, paint: paint(weights.map(|e| (e * triangle.inverse) as f32)) };
                }
            }
            u += triangle.edges[0].a * PLACES;
            v += triangle.edges[1].a * PLACES;
            w += triangle.edges[2].a * PLACES;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const PIXELS: usize = 40;
    const ACROSS: usize = PIXELS * SAMPLES;

    /// Every sample against every triangle, in wide integers: number and depth of what is seen.
    fn naive(triangles: &[[Placed; 3]]) -> Vec<Option<(u32, u64)>> {
        let see = |i: usize| {
            let [x, y] = [i % ACROSS, i / ACROSS].map(|s| s as i128 * 256 + 128);
            let mut nearest: Option<(u32, u64)> = None;
            for (number, corners) in triangles.iter().enumerate() {
                let [a, b, c] = corners.map(|p| (i128::from(p.x), i128::from(p.y)));
                let cross = |p: (i128, i128), q: (i128, i128), r: (i128, i128)| {
                    (q.0 - p.0) * (r.1 - p.1) - (r.0 - p.0) * (q.1 - p.1)
                };
                let area = cross(a, b, c);
                if area == 0 || corners.iter().any(|p| p.depth > FARTHEST) {
                    continue;
                }
                let mut inside = true;
                let mut weights = [0.0; 3];
                for (k, (p, q)) in [(b, c), (c, a), (a, b)].into_iter().enumerate() {
                    let value = cross(p, q, (x, y)) * area.signum();
                    weights[k] = value as f64;
                    // A step to the right, or else downwards, of a point on the edge leads inside.
                    let right = cross(p, q, (x + 1, y)) * area.signum();
                    let below = cross(p, q, (x, y + 1)) * area.signum();
                    inside &= value > 0 || (value == 0 && (right > 0 || (right == 0 && below > 0)));
                }
                if !inside {
                    continue;
                }
                let [u, v, w] = [0, 1, 2].map(|k| weights[k] * f64::from(corners[k].depth));
                let depth = ((u + v + w) * (1.0 / area.abs() as f64)) as u32;
                if nearest.is_none_or(|(d, _)| depth < d) {
                    nearest = Some((depth, number as u64));
                }
            }
            nearest
        };
        (0..ACROSS * ACROSS).map(see).collect()
    }

    /// The same by bands of the given rows of tiles, the triangles in blocks, in the order given by `order`.
    fn drawn(triangles: &[[Placed; 3]], band: usize, block: usize, backwards: bool) -> Vec<Option<(u32, u64)>> {
        let mut seen = vec![None; ACROSS * ACROSS];
        for start in (0..PIXELS.div_ceil(TILE)).step_by(band) {
            let rows = start..(start + band).min(PIXELS.div_ceil(TILE));
            let samples = Band::new(PIXELS, rows.clone());
            let mut firsts: Vec<usize> = (0..triangles.len()).step_by(block).collect();
            if backwards {
                firsts.reverse();
            }
            let mut bins = Bins::default();
            for first in firsts {
                let block = &triangles[first..(first + block).min(triangles.len())];
                samples.draw(&mut bins, first as u64, block.len(), |i| block[i], |_, _| |_| Paint::default());
            }
            for row in rows {
                samples.pixels(row, PIXELS, PIXELS, |x, y, samples| {
                    for (k, sample) in samples.iter().enumerate() {
                        let at = (y * SAMPLES + k / SAMPLES) * ACROSS + x * SAMPLES + k % SAMPLES;
                        seen[at] = sample.depth().zip(sample.number());
                    }
                });
            }
        }
        seen
    }

    /// Corners on samples and beside them, in the picture and around it; depths from few, so that ties are common.
    fn corner() -> impl Strategy<Value = Placed> {
        let along = prop_oneof![
            (-20i32..140).prop_map(|s| s * 256 + 128),
            -6_000i32..36_000,
            (0i32..20).prop_map(|s| 8_000 + s * 64),
            Just(-4_000_000i32),
            Just(4_000_000i32),
        ];
        let depth = prop_oneof![0u32..4, Just(FARTHEST), 0..=FARTHEST];
        (along.clone(), along, depth).prop_map(|(x, y, depth)| Placed { x, y, depth })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn samples_see_what_every_triangle_by_itself_says(
            triangles in prop::collection::vec([corner(), corner(), corner()], 0..24),
            band in 1usize..4,
            block in 1usize..9,
            backwards: bool,
        ) {
            prop_assert!(drawn(&triangles, band, block, backwards) == naive(&triangles));
        }
    }

    #[test]
    fn a_fan_covers_every_sample_once() {
        // All round a point that lies on a sample, the corners on samples, too.
        let at = |x: i32, y: i32| Placed { x: x * 256 + 128, y: y * 256 + 128, depth: 7 };
        let rim = [(0, 0), (30, 0), (60, 0), (60, 45), (60, 90), (20, 90), (0, 90), (0, 11)].map(|(x, y)| at(x, y));
        let fan: Vec<[Placed; 3]> = (0..8).map(|i| [at(17, 23), rim[i], rim[(i + 1) % 8]]).collect();
        let mut count = vec![0; ACROSS * ACROSS];
        for triangle in &fan {
            for (count, seen) in count.iter_mut().zip(drawn(&[*triangle], 3, 1, false)) {
                *count += i32::from(seen.is_some());
            }
        }
        assert_eq!(count.iter().sum::<i32>(), 60 * 90);
        assert!(count.iter().all(|count| *count <= 1));
    }

    #[test]
    fn threads_do_not_show() {
        let mut state = 1u64;
        let mut next = |below: i32| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            ((state >> 33) % below as u64) as i32
        };
        let mut corner = || Placed { x: next(30_000), y: next(30_000), depth: next(3) as u32 };
        let triangles: Vec<[Placed; 3]> = (0..4000).map(|_| [corner(), corner(), corner()]).collect();
        let band = Band::new(PIXELS, 0..3);
        std::thread::scope(|scope| {
            for (part, block) in triangles.chunks(1000).enumerate() {
                let band = &band;
                scope.spawn(move || {
                    let paint = |i: usize, _| move |_| Paint { normal: (part * 1000 + i) as u32, tone: 0 };
                    band.draw(&mut Bins::default(), part as u64 * 1000, block.len(), |i| block[i], paint);
                });
            }
        });
        let expected = drawn(&triangles, 3, 4000, false);
        for row in 0..3 {
            band.pixels(row, PIXELS, PIXELS, |x, y, samples| {
                for (k, sample) in samples.iter().enumerate() {
                    let at = (y * SAMPLES + k / SAMPLES) * ACROSS + x * SAMPLES + k % SAMPLES;
                    assert_eq!(sample.depth().zip(sample.number()), expected[at]);
                    assert_eq!(sample.number().unwrap_or(0), u64::from(sample.paint.normal));
                }
            });
        }
    }
}
