//! Fitting to noisy points: every vertex moves into the plane of the points round it, in a few steps.
//!
//! Noise makes the occupied cells a thick shell, and the solid's surface its outside. Towards the middle of the shell a vertex is led
//! by the points' density: the points near it, weighted by distance, have a mean on the denser side of it, and a flattest
//! direction, across the shell; along that direction the vertex goes to the mean.
//!
//! ```text
//!      q'  .                       The first steps look far, as the shell may be some cells thick; the last look no
//!       .  |  .     .              farther than the shell they have found is: the wider the look, the more of a
//!    .  .  v   . .    .  .         curved surface is flattened.
//!   ....---x---..........----
//!     .  .    .   .  .   .         A plane is found from cells, not from points: a cell counts by the mean of its points and their
//!                                  number. Within a cell sums are of integers, across cells they run in the cells'
//!                                  order; so the order in which points arrive cannot show.
//! ```
//!
//! Only points on the vertex's own side count: those whose cell's outward direction ([`crate::surface::outward`]) is not opposite to the vertex's, by the
//! cosine between the two. So both sides of a thin plate stay where they are, and the points beyond an edge pull less. Cells and corners that have no
//! outward direction (in the middle of a thick shell) agree with all.
//!
//! The flattest direction is never computed: the adjugate of the covariance has the same axes with the least the largest, and
//! squaring it leaves that alone. Where the points have no flattest direction (a line, a lump), what is left of the others moves
//! the vertex towards the mean, partly. A vertex without points in sight, or led farther than [`PLANE_TRAVEL`] cells, stays where it was.

use std::ops::Range;

use crate::error::Result;
use crate::grid::Cell;
use crate::grid::occupancy::Sampled;
use crate::grid::partition::{PLANE_SIGHT, PLANE_TRAVEL, plane_halo};
use crate::grid::window::Window;
use crate::points::Coordinate;
use crate::points::vector::minus;
use crate::solid::Solid;
use crate::surface::fit::Task;
use crate::surface::means::{self, MeansReader, SliceMeans};
use crate::surface::outward::{self, Outward};
use crate::surface::vertices::Kind;

/// How far the first steps look, in cells. With noise of a cell, a surface starts three to four cells outside.
const FIRST: [f64; 2] = [5.0, PLANE_SIGHT];

/// Steps that look as far as the noise asks for. With three, samples of a horse at 20 points a cell with noise of 1/4, 1/2 and 1 cell
/// end within 0.31, 0.22 and 0.24 of the noise (root mean square).
const LAST: u32 = 3;

/// How far those look where there is no noise, and at most, in cells. Looking 2.5 cells far flattens a horse's ears by more than noise of a
/// quarter of a cell is worth.
const SIGHT: (f64, f64) = (2.0, PLANE_SIGHT);
/// How much farther they look for each square cell of variance across the plane: noise of a cell shows as 0.6, after the weights.
const SIGHT_FOR_NOISE: f64 = 3.5;

/// Added to the variances: two places of a line or a plane without noise still have a covariance that can be inverted.
const LEAST_VARIANCE: f64 = 1.0 / 1024.0;

/// Squarings of the adjugate: a direction with twice the variance of the flattest keeps 2⁻⁸ of its share.
const SQUARINGS: u32 = 3;

/// Where the vertices on some planes of a slab go: `put` is told a vertex, counted from the first on the task's planes, and its place in cells; of those that find no
/// plane it hears nothing. The task's halo is [`crate::grid::partition::plane_halo`].
///
/// Memory: a chunk of a bucket, and the means of the halo's slices either side of a plane.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn project<T: Coordinate>(
    sampled: &Sampled<'_, T>,
    solid: &Solid,
    task: &Task<'_>,
    mut put: impl FnMut(usize, [f64; 3]),
) -> Result<()> {
    let Task { surface, q, ref planes, halo } = *task;
    let [width, _, rows] = sampled.grid.cells();
    let halo = i64::from(halo);
    let mut window = Window::new(2 * halo as usize, || SliceMeans::new(width, rows));
    let mut reader = MeansReader::new(sampled, Some(solid));
    let mut corners = Outward::of_corners(solid);
    let first = surface.on_plane(planes.start).start;
    for plane in planes.clone() {
        window.slide_to(i64::from(plane) - halo, |y, slice| reader.read(y, slice))?;
        let seen = i64::from(plane) - halo..i64::from(plane) + halo;
        let near = Near { window: &window, slices: seen };
        corners.slide_to(i64::from(plane))?;
        for v in surface.on_plane(plane) {
            let vertex = &surface.vertices[v as usize];
            // The midpoint of a doubled edge lies between two sides.
            let outward = match vertex.kind {
                Kind::Sheet(_) => corners.at(vertex.corner[0], i64::from(plane), vertex.corner[2]),
                Kind::Midpoint(_) => [0.0; 3],
            };
            if let Some(place) = near.projected(q[v as usize], outward) {
                put((v - first) as usize, place);
            }
        }
    }
    Ok(())
}

/// Bytes that [`project`] needs, on a grid of `cells` with so many occupied cells `in_slice`: the means of
/// a window of slices, and the sums of a bucket's.
pub fn bytes(in_slice: &[u32], cells: Cell, smooth: u32) -> u64 {
    let [width, _, rows] = cells;
    means::bytes(in_slice, 2 * plane_halo(smooth) as usize, [width, rows]) + 2 * outward::bytes(cells)
}

/// The means near a plane.
struct Near<'a> {
    window: &'a Window<SliceMeans>,
    slices: Range<i64>,
}

/// The weighted points round a place.
struct Around {
    /// Their mean, seen from the place.
    mean: [f64; 3],
    /// Their covariance.
    covariance: Matrix,
}

/// A symmetric matrix.
type Matrix = [[f64; 3]; 3];

impl Near<'_> {
    /// Where a vertex at `start` goes, if that is outward from it.
    fn projected(&self, start: [f64; 3], outward: [f64; 3]) -> Option<[f64; 3]> {
        let mut found = None;
        let (mut at, mut sight) = (start, FIRST[0]);
        for step in 0..FIRST.len() as u32 + LAST {
            let Some(Around { mean, covariance }) = self.around(at, outward, sight) else { break };
            let across = flattest(&covariance);
            let next: [f64; 3] = std::array::from_fn(|a| {
                at[a] + (across[a][0] * mean[0] + across[a][1] * mean[1] + across[a][2] * mean[2])
            });
            let moved: [f64; 3] = std::array::from_fn(|a| next[a] - start[a]);
            if moved[0] * moved[0] + moved[1] * moved[1] + moved[2] * moved[2] > PLANE_TRAVEL * PLANE_TRAVEL {
                break;
            }
            at = next;
            found = Some(at);
            let variance: f64 = (0..9).map(|i| across[i / 3][i % 3] * covariance[i / 3][i % 3]).sum();
            sight = match FIRST.get(step as usize + 1) {
                Some(sight) => *sight,
                None => (SIGHT.0 + SIGHT_FOR_NOISE * variance).min(SIGHT.1),
            };
        }
        found
    }

    /// The points within `sight` of a place and on its side; none if there are none.
    fn around(&self, at: [f64; 3], outward: [f64; 3], sight: f64) -> Option<Around> {
        let [xs, ys, zs] = at.map(|c| (c - sight).floor() as i64..(c + sight).floor() as i64 + 1);
        let (mut weights, mut sum, mut squares) = (0.0, [0.0; 3], [0.0; 6]);
        for y in ys.start.max(self.slices.start)..ys.end.min(self.slices.end) {
            let slice = self.window.get(y);
            for z in zs.clone() {
                for mean in &slice.means[slice.cells.cells(z, xs.clone())] {
                    let d = minus(mean.place(y as f64, z as f64), at);
                    let share = 1.0 - (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) / (sight * sight);
                    if share > 0.0 {
                        let [ox, oy, oz] = mean.outward;
                        let agreement = agreement(outward, [f64::from(ox), f64::from(oy), f64::from(oz)]);
                        let w = (share * share) * (share * share) * f64::from(mean.points) * agreement;
                        let [x, y, z] = [w * d[0], w * d[1], w * d[2]];
                        weights += w;
                        sum[0] += x;
                        sum[1] += y;
                        sum[2] += z;
                        squares[0] += x * d[0];
                        squares[1] += x * d[1];
                        squares[2] += x * d[2];
                        squares[3] += y * d[1];
                        squares[4] += y * d[2];
                        squares[5] += z * d[2];
                    }
                }
            }
        }
        if weights <= 0.0 {
            return None;
        }
        let mean = sum.map(|c| c / weights);
        let [xx, xy, xz, yy, yz, zz] = squares.map(|c| c / weights);
        let [x, y, z] = mean;
        let (xy, xz, yz) = (xy - x * y, xz - x * z, yz - y * z);
        let covariance = [[xx - x * x, xy, xz], [xy, yy - y * y, yz], [xz, yz, zz - z * z]];
        Some(Around { mean, covariance })
    }
}

/// How far a cell is on a vertex's side: 0 from a right angle between the two on, 1 up to a cosine of 2/3. With the square of the cosine, noise that leads the
/// outer cells of a shell astray makes the inner ones, which have no outward direction, outweigh them: by a quarter of a cell where noise is a cell.
#[inline]
pub(crate) fn agreement(vertex: [f64; 3], cell: [f64; 3]) -> f64 {
    let is_none = |of: [f64; 3]| of[0] == 0.0 && of[1] == 0.0 && of[2] == 0.0;
    if is_none(vertex) || is_none(cell) {
        return 1.0;
    }
    let cosine = vertex[0] * cell[0] + vertex[1] * cell[1] + vertex[2] * cell[2];
    (1.5 * cosine).clamp(0.0, 1.0)
}

/// The variance across a covariance's flattest direction.
pub(crate) fn variance_across(covariance: &[[f64; 3]; 3]) -> f64 {
    let across = flattest(covariance);
    (0..9).map(|i| across[i / 3][i % 3] * covariance[i / 3][i % 3]).sum()
}

/// The projection onto a covariance's flattest direction, nearly: its trace is 1.
fn flattest(covariance: &Matrix) -> Matrix {
    let mut c = *covariance;
    (0..3).for_each(|a| c[a][a] += LEAST_VARIANCE);
    // Entry (i, j): with i, i + 1, i + 2 and j, j + 1, j + 2 in turn, the sign comes by itself.
    let turn = |i: usize| ((i + 1) % 3, (i + 2) % 3);
    let mut m: Matrix = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let ((i1, i2), (j1, j2)) = (turn(i.min(j)), turn(i.max(j)));
            c[i1][j1] * c[i2][j2] - c[i1][j2] * c[i2][j1]
        })
    });
    m = scaled(&m);
    for _ in 0..SQUARINGS {
        let squared =
            std::array::from_fn(|i| std::array::from_fn(|j| m[i][0] * m[0][j] + m[i][1] * m[1][j] + m[i][2] * m[2][j]));
        m = scaled(&squared);
    }
    m
}

/// The matrix divided by its trace.
fn scaled(m: &Matrix) -> Matrix {
    let trace = m[0][0] + m[1][1] + m[2][2];
    m.map(|row| row.map(|entry| entry / trace))
}
