//! Facets: vertices on their nearest points make facets that cut corners; here they are moved so that the facets pass amid the points instead.
//!
//! ```text
//!            .  .  .                  On a convex surface all points between the corners of a facet lie outside of it. A corner goes outwards (or, on a
//!        . ___________ .              concave surface, inwards) by what the points of its facets lie off on the mean: half of them are outside then,
//!        /           . \              half inside. Points count by their share in the corner: their place on the facet, as weights of the three corners.
//!     . /               \ .
//! ```
//!
//! That is one step of the least-squares fit of a mesh to points (H. Hoppe et al., Mesh optimization, 1993), along normals, for all vertices at once, and
//! half as long again, as neighbours go the same way. Each occupied cell stands for its points by their mean ([`super::means`]).
//!
//! ```text
//!    plane j + 1   o---o---o      A cell is shown the facets at its own eight corners and keeps the nearest. Those of planes j and j + 1 are known
//!    slice j       | m |   |      once plane j + 1 has been looked at; then slice j is settled: its means go to the corners of their facets.
//!    plane j       o---o---o
//! ```

use std::ops::Range;

use crate::error::Result;
use crate::grid::Cell;
use crate::grid::occupancy::Sampled;
use crate::points::Coordinate;
use crate::points::vector::{cross, dot, minus};
use crate::solid::Solid;
use crate::surface::contract::NONE;
use crate::surface::means::{self, MeansReader, SliceMeans};
use crate::surface::outward;
use crate::surface::vertices::{Kind, Vertex};

/// How far a mean may lie from its facet, in cells.
const FARTHEST: f64 = 1.0;

/// How far a vertex may go outwards, in cells.
const TRAVEL: f64 = 0.5;

/// How far inwards: so the two sides of a wall as thin as a sampling distance do not meet.
const INWARDS: f64 = 0.25;

/// What lies farther behind its facet may be of the other side of a thin wall. It counts where the vertex has more points there than elsewhere.
const BEHIND: f64 = 0.25;

/// How much farther a vertex goes than its points lie off on the mean.
const STRIDE: f64 = 1.5;

/// Points that lie on the facets, for all that is known: they keep a vertex with a few points from following each.
const STILL: f64 = 0.5;

/// Facets round a point whose normals come to a smaller part of their lengths have no normal in common: as at the rim of a thin plate, or where vertices of both sides have one point.
const AGREEING: f64 = 0.5;

/// Between neighbours at a distance e on a sphere of radius r, a facet lies e²/8r inside on the mean, a quarter of how far a vertex lies above the mean of its neighbours (e²/2r). Where a
/// vertex has no more than [`FEW`] points, most points are vertices, and tell nothing of what lies between: that quarter is added. Where there are more points, they tell. It is no
/// more than [`NEIGHBOURS`] times what neighbours lie above theirs on the mean, and nothing where that goes the other way: a curve is shared by neighbours, noise is not.
const BENT: f64 = 0.5;
const FEW: f64 = 2.0;
const NEIGHBOURS: f64 = 2.0;

/// The vertices of a slab and of a few planes beside it ([`crate::surface::creases::PLANES_BESIDE`]), at their points, and the facets between them.
#[derive(Debug)]
pub struct Facets<'a> {
    /// The vertices, plane by plane.
    pub vertices: &'a [Vertex],
    /// The planes.
    pub planes: Range<u32>,
    /// The number of the first vertex on each plane; then that of all vertices.
    pub starts: Vec<u32>,
    /// Where each vertex is, in cells: at its point, if it has one.
    pub places: Vec<[f64; 3]>,
    /// Where smoothing put each vertex, in cells.
    pub smoothed: &'a [[f64; 3]],
    /// The point of each vertex, or [`NONE`]; equal numbers are equal places.
    pub points: &'a [u32],
    /// Triangles below the slab's own.
    pub below: &'a [[u32; 3]],
    /// The slab's own, with its vertices counted from `own.start` on.
    pub triangles: &'a [[u32; 3]],
    /// Those above them.
    pub above: &'a [[u32; 3]],
    /// The slab's own vertices.
    pub own: Range<u32>,
    /// The planes that they are on.
    pub own_planes: Range<u32>,
}

/// A vertex at a crease, and how far it goes there, in cells.
#[derive(Debug, Clone, Copy)]
pub struct Creased {
    /// The vertex.
    pub vertex: u32,
    /// From its point.
    pub way: [f32; 3],
}

/// What a vertex has to do with creases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Crease {
    #[default]
    Away,
    /// A triangle leads from it to a vertex at a crease.
    Beside,
    At,
}

/// Where a vertex goes, in cells.
#[derive(Debug, Clone, Copy)]
pub struct Centred {
    /// So far from its point that its facets pass amid the points.
    pub onto: [f64; 3],
    /// Where it would be without leaving its place along the surface: straight below or above where smoothing put it.
    pub beside: [f64; 3],
}

/// Bytes that [`Facets::centre`] needs beside the surface's vertices: of so many vertices and triangles.
pub fn bytes(vertices: u64, triangles: u64, has_creases: bool) -> u64 {
    let of_vertex = size_of::<[f64; 3]>()
        + size_of::<Sums>()
        + 2 * size_of::<u32>()
        + size_of::<u64>()
        + size_of::<f64>()
        + if has_creases { size_of::<Crease>() + size_of::<Creased>() } else { 0 };
    vertices * of_vertex as u64 + 3 * triangles * size_of::<u32>() as u64
}

/// Bytes of the means that it looks at, on a grid of so many cells, with so many occupied cells `in_slice`.
pub fn bytes_of_means(in_slice: &[u32], cells: Cell) -> u64 {
    let [width, _, rows] = cells;
    let most = u64::from(in_slice.iter().copied().max().unwrap_or(0));
    means::bytes(in_slice, 2, [width, rows]) + outward::bytes(cells) + 2 * most * size_of::<Nearest>() as u64
}

/// What the points of a vertex's facets are off, and their number, by their shares in it.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    off: f64,
    points: f64,
    /// The same of those that lie [`BEHIND`].
    behind: [f64; 2],
}

impl Sums {
    /// Counts so many points with `share` in the vertex.
    fn add(&mut self, off: f64, points: f64) {
        if off < -BEHIND {
            self.behind[0] += points * off;
            self.behind[1] += points;
        } else {
            self.off += points * off;
            self.points += points;
        }
    }

    /// How far the vertex goes, along the normal of its facets, if it lies so far above its neighbours by its curvature.
    fn way(&self, above: f64) -> f64 {
        let (mut off, mut points) = (self.off, self.points);
        if self.behind[1] > points {
            off += self.behind[0];
            points += self.behind[1];
        }
        let bent = above * BENT / points.max(FEW);
        (STRIDE * off / (points + STILL) + bent).clamp(-INWARDS, TRAVEL)
    }
}

/// The nearest facet of a mean so far.
#[derive(Debug, Clone, Copy)]
struct Nearest {
    distance2: f64,
    triangle: u32,
}

/// A slice of means, with the nearest facet of each.
struct Layer {
    y: i64,
    slice: SliceMeans,
    nearest: Vec<Nearest>,
}

/// A triangle's corners and the normal's direction, of any length.
#[derive(Debug, Clone, Copy)]
pub(super) struct Facet {
    number: u32,
    pub(super) vertices: [u32; 3],
    pub(super) corners: [[f64; 3]; 3],
    pub(super) normal: [f64; 3],
}

/// How the facets round a point lie.
struct Bearing {
    normal: [f64; 3],
    /// How far the point lies above the mean of its neighbours, along the normal.
    above: f64,
}

impl Facet {
    /// Which of its corners comes after vertex `v`.
    #[inline]
    fn after(&self, v: u32) -> usize {
        self.vertices.iter().position(|u| *u == v).map_or(0, |at| (at + 1) % 3)
    }
}

impl Layer {
    fn new([width, _, rows]: Cell) -> Layer {
        Layer { y: -1, slice: SliceMeans::new(width, rows), nearest: Vec::new() }
    }

    fn read<T: Coordinate>(&mut self, y: i64, reader: &mut MeansReader<'_, T>) -> Result<()> {
        self.y = y;
        reader.read(y, &mut self.slice)?;
        self.nearest.clear();
        let none = Nearest { distance2: FARTHEST * FARTHEST, triangle: NONE };
        self.nearest.resize(self.slice.means.len(), none);
        Ok(())
    }
}

impl Facets<'_> {
    /// Where the slab's vertices that have points go: `put` is told each, counted from the slab's first, and its places; of those without facets it hears nothing. Of vertices at `creases`
    /// these are the places without one. The vertices at creases are there afterwards.
    ///
    /// Memory: [`bytes`], [`bytes_of_means`].
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn centre<T: Coordinate>(
        &mut self,
        stars: &Stars,
        creases: &[Creased],
        sampled: &Sampled<'_, T>,
        solid: &Solid,
        mut put: impl FnMut(usize, Centred),
    ) -> Result<()> {
        let crease = self.beside_creases(stars, creases);
        let mut sums = vec![Sums::default(); self.vertices.len()];
        let mut reader = MeansReader::new(sampled, Some(solid));
        let [mut low, mut high] = [(); 2].map(|()| Layer::new(sampled.grid.cells()));
        let next = self.next_planes();
        let first = self.on_planes(next.clone()).start;
        high.read(i64::from(next.start) - 1, &mut reader)?;
        let mut star = Vec::new();
        for plane in next {
            std::mem::swap(&mut low, &mut high);
            high.read(i64::from(plane), &mut reader)?;
            for v in self.on_planes(plane..plane + 1) {
                let Vertex { corner, kind: Kind::Sheet(_), .. } = self.vertices[v as usize] else { continue };
                star.clear();
                star.extend(stars.at(v).iter().filter_map(|t| self.facet(*t)));
                for layer in [&mut low, &mut high] {
                    self.offer(first..v, corner, &star, layer);
                }
            }
            self.settle(&low, &crease, &mut sums);
        }
        self.settle(&high, &crease, &mut sums);
        self.step(stars, &sums, creases, &crease, &mut put);
        Ok(())
    }

    /// The slab's planes and those next to them: the triangles at their vertices are all known.
    pub(super) fn next_planes(&self) -> Range<u32> {
        let Range { start, end } = self.own_planes;
        self.planes.start.max(start.saturating_sub(1))..self.planes.end.min(end + 1)
    }

    /// The vertices on some of the planes.
    pub(super) fn on_planes(&self, planes: Range<u32>) -> Range<u32> {
        let at = |plane: u32| self.starts[(plane - self.planes.start) as usize];
        at(planes.start)..at(planes.end)
    }

    /// Triangle `t`'s vertices; those below come first, those above last.
    #[inline]
    pub(super) fn triangle(&self, t: u32) -> [u32; 3] {
        let t = t as usize;
        let own = t.wrapping_sub(self.below.len());
        match self.below.get(t) {
            Some(below) => *below,
            None if own < self.triangles.len() => self.triangles[own].map(|v| v + self.own.start),
            None => self.above[own - self.triangles.len()],
        }
    }

    pub(super) fn triangle_count(&self) -> u32 {
        (self.below.len() + self.triangles.len() + self.above.len()) as u32
    }

    /// Triangle `t` as a facet, if it has an area.
    #[inline]
    pub(super) fn facet(&self, t: u32) -> Option<Facet> {
        let vertices = self.triangle(t);
        let corners = vertices.map(|v| self.places[v as usize]);
        let normal = cross(minus(corners[1], corners[0]), minus(corners[2], corners[0]));
        (dot(normal, normal) > 0.0).then_some(Facet { number: t, vertices, corners, normal })
    }

    /// The triangles at each vertex.
    pub fn stars(&self) -> Stars {
        let triangles = self.triangle_count();
        let mut first = vec![0; self.vertices.len() + 1];
        for v in (0..triangles).flat_map(|t| self.triangle(t)) {
            first[v as usize] += 1;
        }
        let mut sum = 0;
        for first in &mut first {
            sum += *first;
            *first = sum;
        }
        let mut at = vec![0; sum as usize];
        for t in (0..triangles).rev() {
            for v in self.triangle(t) {
                first[v as usize] -= 1;
                at[first[v as usize] as usize] = t;
            }
        }
        Stars { first, at }
    }

    /// Shows the facets at a vertex to the means of a slice whose cells touch its corner; those at the vertices `before` it have been shown.
    fn offer(&self, before: Range<u32>, corner: Cell, star: &[Facet], layer: &mut Layer) {
        let Layer { y, slice, nearest } = layer;
        let [i, _, k] = corner.map(i64::from);
        for z in [k - 1, k] {
            for number in slice.cells.cells(z, i - 1..i + 1) {
                let mean = &slice.means[number];
                let outward = mean.outward.map(f64::from);
                if outward == [0.0; 3] {
                    continue;
                }
                let place = mean.place(*y as f64, z as f64);
                let cell = [i64::from(mean.x), *y, z];
                let nearest = &mut nearest[number];
                for facet in star {
                    if dot(facet.normal, outward) <= 0.0 || self.is_shown_before(facet, &before, cell) {
                        continue;
                    }
                    let [a, _, _] = facet.corners;
                    let above = dot(minus(place, a), facet.normal);
                    // Nearer than its plane it is not, but for rounding.
                    if above * above > nearest.distance2 * dot(facet.normal, facet.normal) * (1.0 + 1e-9) {
                        continue;
                    }
                    let (_, distance2) = on_triangle(place, facet.corners);
                    if (distance2, facet.number) < (nearest.distance2, nearest.triangle) {
                        *nearest = Nearest { distance2, triangle: facet.number };
                    }
                }
            }
        }
    }

    /// Whether one of the vertices `before` is the facet's and touches the cell, too.
    #[inline]
    fn is_shown_before(&self, facet: &Facet, before: &Range<u32>, cell: [i64; 3]) -> bool {
        let touches = |corner: Cell| corner.iter().zip(cell).all(|(c, at)| (0..2).contains(&(i64::from(*c) - at)));
        facet.vertices.iter().any(|u| {
            let Vertex { corner, kind, .. } = &self.vertices[*u as usize];
            before.contains(u) && matches!(kind, Kind::Sheet(_)) && touches(*corner)
        })
    }

    /// What each vertex has to do with `creases`, if there are any.
    fn beside_creases(&self, stars: &Stars, creases: &[Creased]) -> Vec<Crease> {
        let mut crease = vec![Crease::Away; if creases.is_empty() { 0 } else { self.vertices.len() }];
        for Creased { vertex, .. } in creases {
            for u in stars.at(*vertex).iter().flat_map(|t| self.triangle(*t)) {
                crease[u as usize] = Crease::Beside;
            }
        }
        creases.iter().for_each(|creased| crease[creased.vertex as usize] = Crease::At);
        crease
    }

    /// Gives the means of a slice to the corners of their facets: where there are some at creases, to these alone. A cell that an edge runs through has a mean inside of it, which lies near to no side.
    fn settle(&self, layer: &Layer, crease: &[Crease], sums: &mut [Sums]) {
        let Layer { y, slice: SliceMeans { cells, means }, nearest } = layer;
        for z in 0..i64::from(cells.rows()) {
            for number in cells.cells(z, 0..i64::MAX) {
                let Some(facet) = Some(nearest[number].triangle).filter(|t| *t != NONE).and_then(|t| self.facet(t))
                else {
                    continue;
                };
                let mean = &means[number];
                let place = mean.place(*y as f64, z as f64);
                let (shares, _) = on_triangle(place, facet.corners);
                let off = dot(minus(place, facet.corners[0]), facet.normal) / dot(facet.normal, facet.normal).sqrt();
                let is_at_crease = |v: &u32| crease.get(*v as usize) == Some(&Crease::At);
                let cuts_edge = facet.vertices.iter().any(is_at_crease);
                for (v, share) in facet.vertices.into_iter().zip(shares).filter(|(v, _)| !cuts_edge || is_at_crease(v))
                {
                    sums[v as usize].add(off, share * f64::from(mean.points));
                }
            }
        }
    }

    /// Moves all vertices that are on one point alike, along the normal of their facets: those beside creases along that of facets that lead there.
    fn step(
        &mut self,
        stars: &Stars,
        sums: &[Sums],
        creases: &[Creased],
        crease: &[Crease],
        put: &mut impl FnMut(usize, Centred),
    ) {
        let next = self.on_planes(self.next_planes());
        let with_point = (0u32..).zip(self.points).filter(|(v, point)| **point != NONE && next.contains(v));
        let mut by_point: Vec<u64> = Vec::with_capacity(self.points.len());
        by_point.extend(with_point.map(|(v, point)| u64::from(*point) << 32 | u64::from(v)));
        by_point.sort_unstable();
        let groups = || by_point.chunk_by(|a, b| a >> 32 == b >> 32);
        let is = |same: &[u64], what: Crease| vertices(same).any(|v| crease.get(v as usize) == Some(&what));
        let is_beside = |same: &&[u64]| !is(same, Crease::At) && is(same, Crease::Beside);
        // Of the slab's own vertices: only their facets are all known.
        let mut above = vec![f64::NAN; self.vertices.len()];
        let find_above = |facets: &Facets<'_>, same: &[u64], above: &mut [f64]| {
            let bearing = facets.bearing(stars, same);
            facets.own_of(same).for_each(|v| above[v as usize] = bearing.as_ref().map_or(f64::NAN, |of| of.above));
        };
        groups().for_each(|same| find_above(self, same, &mut above));
        groups().filter(|same| !is_beside(same)).for_each(|same| self.move_group(stars, sums, &above, same, put));
        for Creased { vertex, way } in creases {
            self.places[*vertex as usize].iter_mut().zip(way).for_each(|(c, way)| *c += f64::from(*way));
        }
        let at_or_beside = groups().filter(|same| is(same, Crease::At) || is(same, Crease::Beside));
        at_or_beside.for_each(|same| find_above(self, same, &mut above));
        groups().filter(is_beside).for_each(|same| self.move_group(stars, sums, &above, same, put));
    }

    /// Moves the slab's own of the vertices on a point.
    fn move_group(
        &self,
        stars: &Stars,
        sums: &[Sums],
        above: &[f64],
        same: &[u64],
        put: &mut impl FnMut(usize, Centred),
    ) {
        let Some(Bearing { normal, above: own }) = self.bearing(stars, same) else { return };
        let (mut all, mut bent, mut count) = (Sums::default(), 0.0, 0.0);
        for v in vertices(same) {
            let Sums { off, points, behind } = sums[v as usize];
            all.off += off;
            all.points += points;
            (0..2).for_each(|i| all.behind[i] += behind[i]);
            for facet in stars.at(v).iter().filter_map(|t| self.facet(*t)) {
                let above = above[facet.vertices[facet.after(v)] as usize];
                if !above.is_nan() {
                    bent += above;
                    count += 1.0;
                }
            }
        }
        let most = if count > 0.0 { NEIGHBOURS * bent / count } else { 0.0 };
        let way = all.way(own.clamp(most.min(0.0), most.max(0.0)));
        for v in self.own_of(same) {
            let (place, from) = (self.places[v as usize], self.smoothed[v as usize]);
            let onto: [f64; 3] = std::array::from_fn(|a| place[a] + way * normal[a]);
            let above = dot(minus(from, onto), normal);
            let beside = std::array::from_fn(|a| from[a] - above * normal[a]);
            put((v - self.own.start) as usize, Centred { onto, beside });
        }
    }

    /// The slab's own of the vertices on a point.
    fn own_of(&self, same: &[u64]) -> impl Iterator<Item = u32> {
        vertices(same).filter(|v| self.own.contains(v))
    }

    /// How the facets round a point lie, if they have a normal in common.
    fn bearing(&self, stars: &Stars, same: &[u64]) -> Option<Bearing> {
        let (mut normal, mut area) = ([0.0; 3], 0.0);
        let (mut neighbours, mut count) = ([0.0; 3], 0.0);
        for v in vertices(same) {
            for facet in stars.at(v).iter().filter_map(|t| self.facet(*t)) {
                normal.iter_mut().zip(facet.normal).for_each(|(sum, c)| *sum += c);
                area += dot(facet.normal, facet.normal).sqrt();
                neighbours.iter_mut().zip(facet.corners[facet.after(v)]).for_each(|(sum, c)| *sum += c);
                count += 1.0;
            }
        }
        let length = dot(normal, normal).sqrt();
        if length <= 0.0 || length < AGREEING * area {
            return None;
        }
        let normal = normal.map(|c| c / length);
        let place = self.places[same[0] as u32 as usize];
        Some(Bearing { normal, above: dot(minus(place, neighbours.map(|c| c / count)), normal) })
    }
}

/// The vertices on a point, given a key for each: the point's number above the vertex's.
fn vertices(same: &[u64]) -> impl Iterator<Item = u32> {
    same.iter().map(|key| *key as u32)
}

/// The triangles at each vertex, in order: nothing is contracted yet, so they are lists side by side.
#[derive(Debug)]
pub struct Stars {
    first: Vec<u32>,
    at: Vec<u32>,
}

impl Stars {
    #[inline]
    pub(super) fn at(&self, v: u32) -> &[u32] {
        &self.at[self.first[v as usize] as usize..self.first[v as usize + 1] as usize]
    }
}

/// The place of a triangle that is nearest to `p`, as weights of its corners, and the squared distance (C. Ericson, Real-Time Collision Detection, 2004, section 5.1.5).
#[inline]
fn on_triangle(p: [f64; 3], [a, b, c]: [[f64; 3]; 3]) -> ([f64; 3], f64) {
    let weights = weights(p, [a, b, c]);
    let [wa, wb, wc] = weights;
    let off: [f64; 3] = std::array::from_fn(|i| p[i] - (wa * a[i] + wb * b[i] + wc * c[i]));
    (weights, dot(off, off))
}

#[inline]
fn weights(p: [f64; 3], [a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    let (ab, ac) = (minus(b, a), minus(c, a));
    let along = |corner: [f64; 3]| {
        let way = minus(p, corner);
        (dot(ab, way), dot(ac, way))
    };
    let (d1, d2) = along(a);
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let (d3, d4) = along(b);
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let (d5, d6) = along(c);
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return [1.0 - t, 0.0, t];
    }
    let va = d3 * d6 - d5 * d4;
    let (e, f) = (d4 - d3, d5 - d6);
    if va <= 0.0 && e >= 0.0 && f >= 0.0 {
        let t = e / (e + f);
        return [0.0, 1.0 - t, t];
    }
    let all = 1.0 / (va + vb + vc);
    let (v, w) = (vb * all, vc * all);
    [1.0 - v - w, v, w]
}
