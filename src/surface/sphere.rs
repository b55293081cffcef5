//! Fitting to noisy points: every vertex moves onto the sphere of the points round it, in a few steps.
//!
//! Noise makes the occupied cells a thick shell, and the solid's surface its outside. The shell's middle is found from where the points are and from which way is
//! outward at each ([`crate::surface::outward`]): onto both a sphere is fitted, which may be as flat as a plane, and the vertex goes straight to it.
//!
//! ```text
//!      q'  .                       The first steps look far, as the shell may be some cells thick; the last look as far as the noise asks for: the wider the
//!       .  |  .     .              look, the less of the noise is left, and the more of what bends unlike a sphere is flattened.
//!    .  .  v   . .    .  .
//!   ....---x---..........----      A sphere is fitted to cells, not to points: a cell counts by the mean of its points and their
//!     .  .    .   .  .   .         number. Within a cell sums are of integers, across cells they run in the cells'
//!                                  order; so the order in which points arrive cannot show.
//! ```
//!
//! Only points on the vertex's own side count: those whose cell's outward direction is not opposite to the vertex's, by the
//! cosine between the two. So both sides of a thin plate stay where they are, and the points beyond an edge pull less. Cells that have no
//! outward direction (in the middle of a plate, deep in a thick shell) agree with all, and then have the vertex's.
//!
//! A vertex that has none itself, as it lies between two sides, goes into the plane of all points round it: across the direction in which they spread least
//! ([`crate::surface::flattest`]). A vertex beyond the points, where a hole is bridged, is left to the membrane ([`crate::solid::membranes`]). A vertex without points in sight, or led farther than [`MOST_TRAVEL`] cells, stays where it was.
//!
//! Source: G. Guennebaud, M. Germann and M. Gross, *Dynamic sampling and rendering of algebraic point set surfaces* (2008).

use std::ops::Range;

use crate::error::Result;
use crate::grid::Cell;
use crate::grid::occupancy::Sampled;
use crate::grid::partition::{MOST_TRAVEL, SPHERE_SIGHT, sphere_halo};
use crate::grid::window::Window;
use crate::points::Coordinate;
use crate::points::vector::{dot, minus, plus, times};
use crate::solid::Solid;
use crate::surface::fit::Task;
use crate::surface::flattest::{Matrix, flattest, variance_along};
use crate::surface::means::{self, MeansReader, SliceMeans};
use crate::surface::outward::{self, Outward, agreement, is_none};
use crate::surface::vertices::Kind;

/// How far the first steps look, in cells. With noise of a cell, a surface starts three to four cells outside.
const FIRST: [f64; 2] = [SPHERE_SIGHT, 3.0];

/// Steps that look as far as the noise asks for.
const LAST: usize = 3;

/// How far those look where there is no noise, and at most, in cells.
const SIGHT: (f64, f64) = (2.5, SPHERE_SIGHT);
/// How much farther they look, by the square of the variance about the sphere in square cells. Edges and what else bends unlike a sphere have a small variance, of which the square is
/// next to nothing.
const SIGHT_FOR_NOISE: f64 = 9.0;

/// Less variance of the distances from the vertex than this part of the squared look is taken for so much: cells at one place tell nothing of how the surface bends.
const LEAST_SPREAD: f64 = 1e-3;

/// A vertex lies beyond the points if the mean of what it sees lies aside by more than this part of its look. Amid a flat surface it lies aside by 0, on its rim by 0.22, and two fifths of the look
/// beyond the rim by this.
const ASIDE: f64 = 0.5;

/// Where the sphere's gradient is less steep, cells face all ways: there is no sphere, and no way to it.
const LEAST_STEEPNESS: f64 = 1e-6;

/// Where the vertices on some planes of a slab go: `put` is told a vertex, counted from the first on the task's planes, and its place in cells; of those that find no
/// sphere, or that lie beyond the points where there are membranes, it hears nothing. The task's halo is [`crate::grid::partition::sphere_halo`].
///
/// Memory: a chunk of a bucket, and the means of the halo's slices either side of a plane.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn project<T: Coordinate>(
    sampled: &Sampled<'_, T>,
    solid: &Solid,
    task: &Task<'_>,
    has_membranes: bool,
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
        let near = Near { window: &window, slices: seen, has_membranes };
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
    means::bytes(in_slice, 2 * sphere_halo(smooth) as usize, [width, rows]) + 2 * outward::bytes(cells)
}

/// The means near a plane.
struct Near<'a> {
    window: &'a Window<SliceMeans>,
    slices: Range<i64>,
    has_membranes: bool,
}

/// Weighted means over the cells in sight of a place; d leads to a cell's mean, n is outward of it.
#[derive(Default)]
struct Around {
    weight: f64,
    /// d.
    place: [f64; 3],
    /// n.
    outward: [f64; 3],
    /// n·d.
    off: f64,
    /// d·d by axes: xx, yy, zz, xy, xz, yz.
    products: [f64; 6],
    /// The square of how far the cell is off the sphere of the step before.
    variance: f64,
}

/// The places x where `constant + linear · x + square x²` is 0, seen from where it was fitted; `linear` has length 1, so that near the sphere this is nearly how far outside x lies.
#[derive(Default)]
struct Sphere {
    constant: f64,
    linear: [f64; 3],
    square: f64,
}

impl Near<'_> {
    /// Where a vertex at `start` goes that has this outward direction, or none; none if it finds no cells, or if it lies beyond them and a membrane does.
    fn projected(&self, start: [f64; 3], outward: [f64; 3]) -> Option<[f64; 3]> {
        let mut found = None;
        let (mut at, mut sight) = (start, FIRST[0]);
        let (mut sphere, mut way) = (Sphere::default(), [0.0; 3]);
        for step in 0..FIRST.len() + LAST {
            let around = self.around(at, outward, sight, (&sphere, way));
            let is_beyond = |around: &Around| step >= FIRST.len() && sphere.is_beside(around, sight);
            if self.has_membranes && around.as_ref().is_none_or(is_beyond) {
                return None;
            }
            let Some(around) = around else { break };
            let variance;
            if is_none(outward) {
                (way, variance) = around.to_plane();
            } else {
                variance = around.variance;
                sphere = around.sphere(sight);
                way = sphere.way(sight);
            }
            let next = plus(at, way);
            let moved = minus(next, start);
            if dot(moved, moved) > MOST_TRAVEL * MOST_TRAVEL {
                break;
            }
            at = next;
            found = Some(at);
            sight = match FIRST.get(step + 1) {
                Some(sight) => *sight,
                None => (SIGHT.0 + SIGHT_FOR_NOISE * variance * variance).min(SIGHT.1),
            };
        }
        found
    }

    /// What lies within `sight` of a place and on its side; none if nothing does. `before` is the sphere of the step before, and the way from there.
    fn around(&self, at: [f64; 3], outward: [f64; 3], sight: f64, before: (&Sphere, [f64; 3])) -> Option<Around> {
        let [xs, ys, zs] = at.map(|c| (c - sight).floor() as i64..(c + sight).floor() as i64 + 1);
        let mut sums = Around::default();
        for y in ys.start.max(self.slices.start)..ys.end.min(self.slices.end) {
            let slice = self.window.get(y);
            for z in zs.clone() {
                for mean in &slice.means[slice.cells.cells(z, xs.clone())] {
                    let d = minus(mean.place(y as f64, z as f64), at);
                    let share = 1.0 - dot(d, d) / (sight * sight);
                    if share > 0.0 {
                        let n = mean.outward.map(f64::from);
                        let w = (share * share) * (share * share) * f64::from(mean.points) * agreement(outward, n);
                        sums.add(w, d, if is_none(n) { outward } else { n });
                        let off = before.0.value(plus(before.1, d));
                        sums.variance += w * (off * off);
                    }
                }
            }
        }
        sums.mean()
    }
}

impl Around {
    fn add(&mut self, w: f64, d: [f64; 3], n: [f64; 3]) {
        let [x, y, z] = d;
        self.weight += w;
        self.off += w * dot(n, d);
        for a in 0..3 {
            self.place[a] += w * d[a];
            self.outward[a] += w * n[a];
        }
        for (sum, product) in self.products.iter_mut().zip([x * x, y * y, z * z, x * y, x * z, y * z]) {
            *sum += w * product;
        }
    }

    /// The means of what was added; none if it weighs nothing.
    fn mean(self) -> Option<Around> {
        let Around { weight, place, outward, off, products, variance } = self;
        (weight > 0.0).then(|| Around {
            weight: 1.0,
            place: place.map(|c| c / weight),
            outward: outward.map(|c| c / weight),
            off: off / weight,
            products: products.map(|c| c / weight),
            variance: variance / weight,
        })
    }

    /// The sphere whose gradient at the cells is nearest to their outward directions by least squares, and that lies amid them.
    fn sphere(&self, sight: f64) -> Sphere {
        let squared = self.products[0] + self.products[1] + self.products[2];
        let spread = (squared - dot(self.place, self.place)).max(LEAST_SPREAD * sight * sight);
        let square = 0.5 * (self.off - dot(self.outward, self.place)) / spread;
        let linear = minus(self.outward, times(2.0 * square, self.place));
        let constant = -dot(linear, self.place) - square * squared;
        let steepness = dot(linear, linear).sqrt();
        let scale = if steepness < LEAST_STEEPNESS { 0.0 } else { 1.0 / steepness };
        Sphere { constant: scale * constant, linear: times(scale, linear), square: scale * square }
    }

    /// The way into the plane of the cells, and their variance across it.
    fn to_plane(&self) -> ([f64; 3], f64) {
        let covariance = self.covariance();
        let across = flattest(&covariance);
        (across.map(|row| dot(row, self.place)), variance_along(&across, &covariance))
    }

    fn covariance(&self) -> Matrix {
        let ([x, y, z], [xx, yy, zz, xy, xz, yz]) = (self.place, self.products);
        let (xy, xz, yz) = (xy - x * y, xz - x * z, yz - y * z);
        [[xx - x * x, xy, xz], [xy, yy - y * y, yz], [xz, yz, zz - z * z]]
    }
}

impl Sphere {
    fn value(&self, x: [f64; 3]) -> f64 {
        self.constant + dot(self.linear, x) + self.square * dot(x, x)
    }

    /// Whether what is seen lies aside, along the sphere; in any direction, if there is no sphere.
    fn is_beside(&self, around: &Around, sight: f64) -> bool {
        let aside = minus(around.place, times(dot(around.place, self.linear), self.linear));
        dot(aside, aside) > (ASIDE * sight) * (ASIDE * sight)
    }

    /// The way to it from where it was fitted, no longer than `sight`.
    fn way(&self, sight: f64) -> [f64; 3] {
        // The nearer root of constant + t + square t²; where there is none, its vertex.
        let left = (1.0 - 4.0 * self.square * self.constant).max(0.0);
        times((-2.0 * self.constant / (1.0 + left.sqrt())).clamp(-sight, sight), self.linear)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The cells of a patch of a sphere, or of a plane if it bends by 0, seen from a place that is so far outside of it.
    fn patch(normal: [f64; 3], bend: f64, off: f64, places: &[[f64; 3]]) -> Around {
        let mut around = Around::default();
        for place in places {
            // Straight below the place, on the sphere through the origin; its middle is −normal / bend.
            let (x, n) = if bend == 0.0 {
                (minus(*place, times(dot(*place, normal), normal)), normal)
            } else {
                let from_middle = plus(*place, times(1.0 / bend, normal));
                let n = times(bend.signum() / dot(from_middle, from_middle).sqrt(), from_middle);
                (minus(times(1.0 / bend, n), times(1.0 / bend, normal)), n)
            };
            around.add(1.0 + place[0] * place[0], minus(x, times(off, normal)), n);
        }
        around.mean().unwrap()
    }

    proptest! {
        #[test]
        fn a_step_leads_onto_the_sphere_that_cells_lie_on(
            normal in prop::array::uniform3(-1.0f64..1.0).prop_filter("long", |n| dot(*n, *n) > 0.1),
            bend in prop_oneof![Just(0.0), -0.2f64..0.2],
            off in -2.0f64..2.0,
            places in prop::collection::vec(prop::array::uniform3(-1.5f64..1.5), 6..40),
        ) {
            let normal = times(1.0 / dot(normal, normal).sqrt(), normal);
            let sphere = patch(normal, bend, off, &places).sphere(4.0);
            let way = sphere.way(4.0);
            prop_assert!(dot(plus(way, times(off, normal)), plus(way, times(off, normal))).sqrt() < 1e-6, "{way:?} for {off} along {normal:?}");
            prop_assert!(sphere.value(way).abs() < 1e-6);
        }
    }

    #[test]
    fn a_vertex_lies_beyond_cells_that_are_all_aside() {
        // Half a plane of cells, weighted as they are seen from so far beyond its rim, and above it.
        let is_beyond = |rim: f64, above: f64| {
            let (mut around, sight) = (Around::default(), 2.5);
            for (x, z) in (-40..=40).flat_map(|x| (-40..=40).map(move |z| (0.1 * f64::from(x), 0.1 * f64::from(z)))) {
                let d = [x, -above, z];
                let share: f64 = 1.0 - dot(d, d) / (sight * sight);
                if x >= rim && share > 0.0 {
                    around.add(share.powi(4), d, [0.0, 1.0, 0.0]);
                }
            }
            let around = around.mean().unwrap();
            around.sphere(sight).is_beside(&around, sight)
        };
        for (rim, expected) in [(-3.0, false), (-1.0, false), (0.0, false), (0.5, false), (1.5, true), (2.0, true)] {
            assert_eq!(is_beyond(rim, 0.0), expected, "{rim} beyond the rim");
            assert_eq!(is_beyond(rim, 0.7), expected, "{rim} beyond the rim, above it");
        }
    }

    #[test]
    fn cells_that_face_all_ways_have_no_sphere() {
        let mut around = Around::default();
        for (d, n) in [([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]), ([1.0, 0.0, 0.0], [0.0, 0.0, -1.0])] {
            around.add(1.0, d, n);
        }
        assert_eq!(around.mean().unwrap().sphere(4.0).way(4.0), [0.0; 3]);
        assert!(Around::default().mean().is_none());
    }
}
