//! Fitting: the nearest input point of every vertex of a slab, found through the cell grid.
//!
//! ```text
//!   +---+---+---+---+---+---+     the cells round a corner are searched shell by shell: first the eight that touch it
//!   | 3 | 3 | 3 | 3 | 3 | 3 |     (1), then the ring round them (2), and so on; what lies beyond shell m is at least
//!   +---+---+---+---+---+---+     m - |q' - corner| cells away, so a nearer point ends the search
//!   | 3 | 2 | 2 | 2 | 2 | 3 |
//!   +---+---+---+---+---+---+     points of a slice are sorted by row, then by cell: a stretch of a row's cells is one
//!   | 3 | 2 | 1 | 1 | 2 | 3 |     stretch of points, found by counting bits
//!   +---+---+---o---+---+---+
//! ```
//!
//! Points are read in pieces of bounded size, and every piece is searched for every vertex near it: a slab with more points
//! than fit in memory costs time, not memory.

use std::cmp::Ordering;
use std::ops::Range;

use crate::error::Result;
use crate::grid::Grid;
use crate::partition::{REACH, buckets_of};
use crate::points::Coordinate;
use crate::schedule::refill;
use crate::stage::contract::NONE;
use crate::stage::extract::{Kind, Surface};
use crate::stage::ranked::Ranked;
use crate::stage::raster::Sampled;
use crate::window::Window;

/// The nearest points of a slab's vertices.
#[derive(Debug, Clone, Default)]
pub struct Fitted {
    /// Of each vertex, a number of its point, or [`NONE`]. Equal numbers mean equal coordinates, and the reverse, within the slab.
    pub point: Vec<u32>,
    /// The squared distance from q′ to the point, in the input's units.
    pub distance: Vec<f64>,
    /// The point's coordinates, in file axes.
    pub target: Vec<[f64; 3]>,
}

impl Fitted {
    /// Nothing fitted, in the memory of `room`.
    pub fn none(vertices: usize, room: Fitted) -> Fitted {
        let Fitted { mut point, mut distance, mut target } = room;
        refill(&mut point, vertices, NONE);
        refill(&mut distance, vertices, f64::INFINITY);
        refill(&mut target, vertices, [0.0; 3]);
        Fitted { point, distance, target }
    }

    /// Gives vertex `v` a place of its own to go to, instead of a point.
    pub fn put(&mut self, v: usize, target: [f64; 3]) {
        (self.point[v], self.distance[v], self.target[v]) = (NONE, f64::INFINITY, target);
    }
}

/// Which vertices to fit, and how far from their planes their points may lie.
#[derive(Debug)]
pub struct Task<'a> {
    /// The slab's surface.
    pub surface: &'a Surface,
    /// Positions q′ of all its vertices, in cells.
    pub q: &'a [[f64; 3]],
    /// The planes whose vertices are fitted.
    pub planes: Range<u32>,
    /// Slices either side of a plane that are searched: [`crate::partition::halo`].
    pub halo: u32,
}

/// Finds the nearest point of every vertex on the task's planes; `Fitted` is indexed from the first of them, and takes the memory of `room`.
///
/// Ties go to the smaller (x, y, z). Memory: `piece` points (twice), and the index of `2 halo` slices.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn fit<T: Coordinate>(sampled: &Sampled<'_, T>, task: &Task<'_>, piece: usize, room: Fitted) -> Result<Fitted> {
    let Sampled { buckets, grid, .. } = sampled;
    let first = task.surface.on_plane(task.planes.start).start;
    let end = task.surface.on_plane(task.planes.end - 1).end;
    let mut search = Search { grid, task, first, found: Fitted::none((end - first) as usize, room), searched: 0 };
    let slices = task.planes.start.saturating_sub(task.halo)..(task.planes.end + task.halo).min(grid.cells()[1]);
    let buckets_near = buckets_of(slices.clone());
    let near: u64 = buckets_near.clone().map(|bucket| buckets.points_in(bucket as usize)).sum();
    let mut held: Vec<[T; 3]> = Vec::with_capacity(piece.min(near as usize));
    for bucket in buckets_near {
        let counted = sampled.counted_in(bucket)?;
        buckets.read(bucket as usize, piece, |points| {
            for point in points {
                let p = point.map(Into::into);
                if slices.contains(&grid.slice_of(p)) && counted.contains(grid, p) {
                    held.push(*point);
                    if held.len() == piece {
                        search.piece(&held, slices.clone())?;
                        held.clear();
                    }
                }
            }
            Ok(())
        })?;
    }
    search.piece(&held, slices)?;
    Ok(search.found)
}

struct Search<'a> {
    grid: &'a Grid,
    task: &'a Task<'a>,
    first: u32,
    found: Fitted,
    /// Points of earlier pieces: numbers go on from there.
    searched: u32,
}

impl Search<'_> {
    /// Searches one piece of points for all vertices.
    fn piece<T: Coordinate>(&mut self, points: &[[T; 3]], slices: Range<u32>) -> Result<()> {
        if points.is_empty() {
            return Ok(());
        }
        let (sorted, starts) = sort_by_slice(points, self.grid, slices.clone());
        let halo = i64::from(self.task.halo);
        let [width, _, rows] = self.grid.cells();
        let mut window = Window::new(2 * halo as usize, || SliceIndex::new(width, rows));
        let mut sorting = Sorting::default();
        for plane in self.task.planes.clone() {
            window.slide_to(i64::from(plane) - halo, |y, index| {
                let inside = y >= i64::from(slices.start) && y < i64::from(slices.end);
                let range = if inside {
                    let y = (y - i64::from(slices.start)) as usize;
                    starts[y]..starts[y + 1]
                } else {
                    0..0
                };
                index.build(&sorted, range, self.grid, &mut sorting);
                Ok(())
            })?;
            for v in self.task.surface.on_plane(plane) {
                self.vertex(v, plane, &window);
            }
        }
        self.searched += points.len() as u32;
        Ok(())
    }

    fn vertex<T: Coordinate>(&mut self, v: u32, plane: u32, window: &Window<SliceIndex<T>>) {
        let vertex = &self.task.surface.vertices[v as usize];
        if let Kind::Middle(_) = vertex.kind {
            return;
        }
        let q = self.task.q[v as usize];
        let at = (v - self.first) as usize;
        let w = self.grid.cell_size();
        let slack = self.grid.slack();
        let reach = f64::from(REACH) * w;
        let offset: [f64; 3] = std::array::from_fn(|a| q[a] - f64::from(vertex.corner[a]));
        let farthest = offset.iter().fold(0.0f64, |m, d| m.max(d.abs()));
        let mut best = Nearest {
            from: self.grid.position(q),
            limit: reach * reach,
            distance: self.found.distance[at],
            target: self.found.target[at],
            point: self.found.point[at],
        };
        let [i, _, k] = vertex.corner.map(i64::from);
        let gap = |d: i64, offset: f64| (d as f64 - offset).max(offset - d as f64 - 1.0).max(slack) - slack;
        let row_gap = |dy: i64, dz: i64| gap(dy, offset[1]).powi(2) + gap(dz, offset[2]).powi(2);
        for m in 1..=i64::from(self.task.halo) {
            let beyond = (m - 1) as f64 - farthest - slack;
            if m > 1 && (beyond > f64::from(REACH) || (beyond > 0.0 && best.distance < (beyond * w).powi(2))) {
                break;
            }
            for dy in -m..m {
                let index = window.get(i64::from(plane) + dy);
                if index.points.is_empty() {
                    continue;
                }
                for dz in -m..m {
                    if row_gap(dy, dz) * w * w * (1.0 - 1e-9) > best.distance.min(best.limit) {
                        continue;
                    }
                    let base = self.searched + index.base;
                    if dy == -m || dy == m - 1 || dz == -m || dz == m - 1 {
                        best.look(index, base, k + dz, i - m..i + m);
                    } else {
                        best.look(index, base, k + dz, i - m..i - m + 1);
                        best.look(index, base, k + dz, i + m - 1..i + m);
                    }
                }
            }
        }
        self.found.distance[at] = best.distance;
        self.found.target[at] = best.target;
        self.found.point[at] = best.point;
    }
}

/// The nearest point so far.
struct Nearest {
    from: [f64; 3],
    limit: f64,
    distance: f64,
    target: [f64; 3],
    point: u32,
}

impl Nearest {
    /// Looks at the points in cells `x` of row `z`; both may reach outside the slice.
    #[inline]
    fn look<T: Coordinate>(&mut self, index: &SliceIndex<T>, base: u32, z: i64, x: Range<i64>) {
        let range = index.cells(z, x);
        for (number, point) in range.clone().zip(&index.points[range]) {
            let p: [f64; 3] = point.map(Into::into);
            let d = [p[0] - self.from[0], p[1] - self.from[1], p[2] - self.from[2]];
            let distance = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let nearer = distance < self.distance || (distance == self.distance && precedes(p, self.target));
            if nearer && distance <= self.limit {
                (self.distance, self.target, self.point) = (distance, p, base + number as u32);
            }
        }
    }
}

/// Whether `a` comes before `b` by (x, y, z).
pub fn precedes(a: [f64; 3], b: [f64; 3]) -> bool {
    let order = a.iter().zip(&b).map(|(a, b)| a.total_cmp(b)).find(|o| o.is_ne());
    order == Some(Ordering::Less)
}

/// The points of one slice, sorted by row and cell.
#[derive(Debug)]
struct SliceIndex<T> {
    points: Vec<[T; 3]>,
    /// The number of the first point among the piece's.
    base: u32,
    width: u32,
    rows: u32,
    occupied: Ranked,
    /// Of each occupied cell: the points before it; one entry more than cells.
    first: Vec<u32>,
}

/// What one slice at a time is sorted with.
#[derive(Debug, Default)]
struct Sorting {
    keys: Vec<(u32, u32)>,
    by_x: Vec<u32>,
    order: Vec<u32>,
    counts: Vec<u32>,
}

impl<T: Coordinate> SliceIndex<T> {
    fn new(width: u32, rows: u32) -> SliceIndex<T> {
        SliceIndex { points: Vec::new(), base: 0, width, rows, occupied: Ranked::new(width, rows), first: Vec::new() }
    }

    /// Takes the points `range` of `sorted`.
    fn build(&mut self, sorted: &[[T; 3]], range: Range<usize>, grid: &Grid, sorting: &mut Sorting) {
        self.base = range.start as u32;
        let points = &sorted[range];
        let had_points = !self.points.is_empty();
        self.points.clear();
        self.first.clear();
        if points.is_empty() && !had_points {
            return;
        }
        self.occupied.clear();
        let Sorting { keys, by_x, order, counts } = sorting;
        keys.clear();
        keys.extend(points.iter().map(|p| {
            let [x, _, z] = grid.cell_of(p.map(Into::into));
            (x, z)
        }));
        // Two stable counting sorts, the less significant key first.
        counting_sort(counts, self.width, 0..points.len() as u32, |i| keys[i as usize].0, by_x);
        counting_sort(counts, self.rows, by_x.iter().copied(), |i| keys[i as usize].1, order);
        self.points.extend(order.iter().map(|&i| points[i as usize]));
        let mut last = None;
        for (number, &i) in order.iter().enumerate() {
            let (x, z) = keys[i as usize];
            if last != Some((x, z)) {
                self.first.push(number as u32);
                self.occupied.set(x, z);
                last = Some((x, z));
            }
        }
        self.first.push(points.len() as u32);
        self.occupied.number();
    }

    /// The stretch of points in cells `x` of row `z`.
    #[inline]
    fn cells(&self, z: i64, x: Range<i64>) -> Range<usize> {
        let cells = self.occupied.cells(z, x);
        self.first[cells.start] as usize..self.first[cells.end] as usize
    }
}

/// A stable counting sort of `items` by `key`, which is less than `keys`, into `out`.
fn counting_sort(
    counts: &mut Vec<u32>,
    keys: u32,
    items: impl ExactSizeIterator<Item = u32> + Clone,
    key: impl Fn(u32) -> u32,
    out: &mut Vec<u32>,
) {
    counts.clear();
    counts.resize(keys as usize, 0);
    for item in items.clone() {
        counts[key(item) as usize] += 1;
    }
    let mut next = 0;
    for count in counts.iter_mut() {
        next += std::mem::replace(count, next);
    }
    out.clear();
    out.resize(items.len(), 0);
    for item in items {
        let at = &mut counts[key(item) as usize];
        out[*at as usize] = item;
        *at += 1;
    }
}

/// The points by slice, and where each slice starts.
fn sort_by_slice<T: Coordinate>(points: &[[T; 3]], grid: &Grid, slices: Range<u32>) -> (Vec<[T; 3]>, Vec<usize>) {
    let slice = |p: &[T; 3]| (grid.slice_of(p.map(Into::into)) - slices.start) as usize;
    let mut starts = vec![0; slices.len() + 1];
    for point in points {
        starts[slice(point) + 1] += 1;
    }
    for y in 0..slices.len() {
        starts[y + 1] += starts[y];
    }
    let mut next = starts.clone();
    let mut sorted = vec![[T::zeroed(); 3]; points.len()];
    for point in points {
        let at = &mut next[slice(point)];
        sorted[*at] = *point;
        *at += 1;
    }
    (sorted, starts)
}
