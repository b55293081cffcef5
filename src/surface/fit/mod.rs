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
//! Of each bucket as many points are held as there is room for, and every such share is searched for every vertex near it: buckets
//! with more points than fit in memory cost time, not memory.

mod index;

use std::cmp::Ordering;
use std::ops::Range;

use self::index::{Index, SlicePoints};
use crate::error::Result;
use crate::grid::Grid;
use crate::grid::occupancy::Sampled;
use crate::grid::partition::{REACH, buckets_round};
use crate::points::Coordinate;
use crate::resources::workers::refill;
use crate::surface::contract::NONE;
use crate::surface::extract::Surface;
use crate::surface::vertices::Kind;

/// The nearest points of a slab's vertices.
#[derive(Debug, Clone, Default)]
pub struct Fitted<T> {
    /// A number for each vertex's point, or [`NONE`]. Within the slab, equal numbers mean equal coordinates, and the reverse.
    pub point: Vec<u32>,
    /// The point's coordinates, in file axes.
    pub target: Vec<[T; 3]>,
}

impl<T: Coordinate> Fitted<T> {
    /// Nothing fitted, in the memory of `room`.
    pub fn none(vertices: usize, room: Fitted<T>) -> Fitted<T> {
        let Fitted { mut point, mut target } = room;
        refill(&mut point, vertices, NONE);
        refill(&mut target, vertices, [T::zeroed(); 3]);
        Fitted { point, target }
    }

    /// Keeps the points of these vertices only, which are counted anew.
    pub fn keep(&mut self, vertices: Range<u32>) {
        let [start, end] = [vertices.start, vertices.end].map(|v| v as usize);
        self.point.truncate(end);
        self.point.drain(..start);
        self.target.truncate(end);
        self.target.drain(..start);
    }

    /// Bytes of the points of so many vertices, of `coordinates` bytes each.
    pub fn bytes(vertices: u64, coordinates: u64) -> u64 {
        vertices * (size_of::<u32>() as u64 + coordinates)
    }

    /// Gives vertex `v` a place of its own to go to, instead of a point.
    pub fn put(&mut self, v: usize, target: [T; 3]) {
        (self.point[v], self.target[v]) = (NONE, target);
    }

    /// The squared distance from `from`, the place of vertex `v`, to its point, in the input's units; infinite if it has none.
    #[inline]
    pub fn distance(&self, v: usize, from: [f64; 3]) -> f64 {
        if self.point[v] == NONE { f64::INFINITY } else { squared_distance(self.target[v].map(Into::into), from) }
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
    /// Slices either side of a plane that are searched: [`crate::grid::partition::halo`].
    pub halo: u32,
}

/// Finds the nearest point of every vertex on the task's planes; `Fitted` is indexed from the first of them, and takes the memory of `room`.
///
/// Ties go to the smaller (x, y, z). Memory: `at_once` points, a bucket's share of them once more while they are sorted, and the cells of
/// the slices of as many buckets as lie round a plane.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn fit<T: Coordinate>(
    sampled: &Sampled<'_, T>,
    task: &Task<'_>,
    at_once: usize,
    room: Fitted<T>,
) -> Result<Fitted<T>> {
    let grid = sampled.grid;
    let first = task.surface.on_plane(task.planes.start).start;
    let end = task.surface.on_plane(task.planes.end - 1).end;
    let mut search = Search { grid, task, first, found: Fitted::none((end - first) as usize, room) };
    let slices = task.planes.start.saturating_sub(task.halo)..(task.planes.end + task.halo).min(grid.cells()[1]);
    let share = (at_once as u64 / u64::from(buckets_round(task.halo))).max(1);
    let shares = index::shares(sampled, slices.clone(), share);
    let mut index = Index::new(sampled, slices, task.halo);
    for turn in 0..shares {
        index.begin(turn * share..(turn + 1) * share);
        for plane in task.planes.clone() {
            index.slide_to(plane)?;
            search.plane(plane, &index);
        }
    }
    Ok(search.found)
}

struct Search<'a, T> {
    grid: &'a Grid,
    task: &'a Task<'a>,
    first: u32,
    found: Fitted<T>,
}

impl<T: Coordinate> Search<'_, T> {
    /// Searches the points of an index round one plane for all vertices on it.
    fn plane(&mut self, plane: u32, index: &Index<'_, T>) {
        let halo = i64::from(self.task.halo);
        let around = (-halo..halo).map(|dy| index.slice(i64::from(plane) + dy)).collect::<Vec<_>>();
        if around.iter().any(|slice| !slice.is_empty()) {
            for v in self.task.surface.on_plane(plane) {
                self.vertex(v, &around);
            }
        }
    }

    /// Searches the points of the slices `around` a vertex's plane, as many below it as above.
    fn vertex(&mut self, v: u32, around: &[SlicePoints<'_, T>]) {
        let vertex = &self.task.surface.vertices[v as usize];
        if let Kind::Midpoint(_) = vertex.kind {
            return;
        }
        // Where a surface is cut off, points that are not kept may lie near. What has a point may be contracted, and needs a whole star.
        if self.task.surface.columns().is_some_and(|columns| !columns.makes_all_round(vertex.corner)) {
            return;
        }
        let q = self.task.q[v as usize];
        let at = (v - self.first) as usize;
        let w = self.grid.cell_size();
        let slack = self.grid.slack();
        let reach = f64::from(REACH) * w;
        let offset: [f64; 3] = std::array::from_fn(|a| q[a] - f64::from(vertex.corner[a]));
        let farthest = offset.iter().fold(0.0f64, |m, d| m.max(d.abs()));
        let from = self.grid.position(q);
        let mut best = Nearest {
            from,
            limit: reach * reach,
            distance: self.found.distance(at, from),
            target: self.found.target[at].map(Into::into),
            point: self.found.point[at],
        };
        let [i, _, k] = vertex.corner.map(i64::from);
        let gap = |d: i64, offset: f64| (d as f64 - offset).max(offset - d as f64 - 1.0).max(slack) - slack;
        let row_gap = |dy: i64, dz: i64| gap(dy, offset[1]).powi(2) + gap(dz, offset[2]).powi(2);
        let halo = i64::from(self.task.halo);
        for m in 1..=halo {
            let beyond = (m - 1) as f64 - farthest - slack;
            if m > 1 && (beyond > f64::from(REACH) || (beyond > 0.0 && best.distance < (beyond * w).powi(2))) {
                break;
            }
            for dy in -m..m {
                let slice = around[(dy + halo) as usize];
                if slice.is_empty() {
                    continue;
                }
                for dz in -m..m {
                    if row_gap(dy, dz) * w * w * (1.0 - 1e-9) > best.distance.min(best.limit) {
                        continue;
                    }
                    if dy == -m || dy == m - 1 || dz == -m || dz == m - 1 {
                        best.look(slice, k + dz, i - m..i + m);
                    } else {
                        best.look(slice, k + dz, i - m..i - m + 1);
                        best.look(slice, k + dz, i + m - 1..i + m);
                    }
                }
            }
        }
        self.found.target[at] = best.target.map(T::from_f64);
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
    fn look<T: Coordinate>(&mut self, slice: SlicePoints<'_, T>, z: i64, x: Range<i64>) {
        let (first, points) = slice.in_cells(z, x);
        for (number, point) in (first..).zip(points) {
            let p: [f64; 3] = point.map(Into::into);
            let distance = squared_distance(p, self.from);
            let nearer = distance < self.distance || (distance == self.distance && precedes(p, self.target));
            if nearer && distance <= self.limit {
                (self.distance, self.target, self.point) = (distance, p, number);
            }
        }
    }
}

/// The squared distance of two places.
#[inline]
pub fn squared_distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

/// Whether `a` comes before `b` by (x, y, z).
pub fn precedes(a: [f64; 3], b: [f64; 3]) -> bool {
    let order = a.iter().zip(&b).map(|(a, b)| a.total_cmp(b)).find(|o| o.is_ne());
    order == Some(Ordering::Less)
}
