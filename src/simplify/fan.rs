//! The triangles that are to come in the place of a vertex's star, and whether they would meet others.

use glam::DVec3;

use super::boxes::{Boxes, Extent};
use super::piece::Piece;
use super::sight::Sight;
use crate::mesh::intersect::intersect;

/// A triangle that is to come.
#[derive(Debug, Clone, Copy)]
struct Fresh {
    vertices: [u32; 3],
    places: [DVec3; 3],
    /// The corners' numbers, in the order in which the ring goes round.
    corners: [usize; 3],
}

impl Fresh {
    fn bounds(&self) -> (DVec3, DVec3) {
        let [a, b, c] = self.places;
        (a.min(b).min(c), a.max(b).max(c))
    }
}

/// Triangles that are to come, and room for those near them.
#[derive(Debug)]
pub(super) struct Fan {
    fresh: Vec<Fresh>,
    /// The vertices of the ring and, where the triangles go round a vertex, this, each with its place.
    corners: Vec<(u32, DVec3)>,
    /// How many of these are the ring.
    ring: usize,
    near: Vec<u32>,
    sight: Sight,
}

impl Fan {
    /// Room for a piece with so many vertices.
    pub(super) fn new(vertices: usize) -> Fan {
        let (fresh, corners, near) = (Vec::new(), Vec::new(), Vec::new());
        Fan { fresh, corners, ring: 0, near, sight: Sight::new(vertices) }
    }

    /// The triangles from the first vertex of a ring to all sides that it is not an end of. `mirrored` tells that the ring runs clockwise.
    pub(super) fn spread(&mut self, piece: &Piece, ring: impl Iterator<Item = u32>, mirrored: bool) {
        self.fresh.clear();
        self.corners.clear();
        self.corners.extend(ring.map(|v| (v, piece.position(v))));
        self.ring = self.corners.len();
        for k in 1..self.ring.saturating_sub(1) {
            let corners = [0, k, k + 1];
            let [a, b, c] = if mirrored { [0, k + 1, k] } else { corners }.map(|number| self.corners[number]);
            self.fresh.push(Fresh { vertices: [a.0, b.0, c.0], places: [a.1, b.1, c.1], corners });
        }
    }

    /// The triangles from a vertex, at a place, to all sides of the ring round it.
    pub(super) fn spread_round(&mut self, piece: &Piece, ring: &[u32], (middle, place): (u32, DVec3)) {
        self.fresh.clear();
        self.corners.clear();
        self.corners.extend(ring.iter().map(|v| (*v, piece.position(*v))));
        self.corners.push((middle, place));
        self.ring = ring.len();
        for k in 0..ring.len() {
            let corners = [ring.len(), k, (k + 1) % ring.len()];
            let [a, b, c] = corners.map(|number| self.corners[number]);
            self.fresh.push(Fresh { vertices: [a.0, b.0, c.0], places: [a.1, b.1, c.1], corners });
        }
    }

    /// The worst shape of the triangles.
    pub(super) fn shape(&self) -> f64 {
        self.fresh.iter().map(|fresh| shape(fresh.places)).fold(1.0, f64::min)
    }

    /// Whether one of them would meet a triangle that stays, or, where they are not seen apart, another of them. `star` are the triangles that go; `axes` the two
    /// across which all of them are seen, relative to `own`.
    pub(super) fn meets(
        &mut self,
        piece: &Piece,
        boxes: &mut Boxes,
        star: &[u32],
        own: DVec3,
        axes: Option<(DVec3, DVec3)>,
    ) -> bool {
        let Fan { fresh, corners, ring, near, sight } = self;
        if fresh.is_empty() {
            return false;
        }
        let first = corners[0].1;
        let (low, high) =
            corners[1..].iter().fold((first, first), |(low, high), (_, place)| (low.min(*place), high.max(*place)));
        if let Some(axes) = axes {
            sight.look((corners, *ring), fresh.iter().map(|fresh| fresh.corners), own, axes);
        }
        near.clear();
        boxes.near(&Extent::of([low, high]), near);
        // By their numbers' last six bits: most triangles are none of the star, and these tell so.
        let in_star = star.iter().fold(0u64, |bits, t| bits | 1 << (t % 64));
        for &t in near.iter() {
            if in_star >> (t % 64) & 1 == 1 && star.contains(&t) {
                continue;
            }
            let there = piece.triangles[t as usize];
            let beyond = if axes.is_some() { sight.beyond(there, |v| piece.position(v)) } else { 0 };
            let its = there.map(|v| piece.position(v));
            for (number, one) in fresh.iter().enumerate() {
                if axes.is_some() && sight.is_beside(number, beyond) {
                    continue;
                }
                if are_apart(one, its) {
                    continue;
                }
                let places = |corners: [DVec3; 3]| corners.map(|place| place.to_array());
                if intersect(one.vertices, places(one.places), there, places(its)) {
                    return true;
                }
            }
        }
        if axes.is_none() {
            let places = |one: &Fresh| one.places.map(|place| place.to_array());
            let pairs = fresh.iter().enumerate().flat_map(|(k, a)| fresh[..k].iter().map(move |b| (a, b)));
            return pairs.into_iter().any(|(a, b)| intersect(a.vertices, places(a), b.vertices, places(b)));
        }
        false
    }
}

/// Whether their boxes have nothing in common.
fn are_apart(one: &Fresh, [a, b, c]: [DVec3; 3]) -> bool {
    let (low, high) = one.bounds();
    low.cmpgt(a.max(b).max(c)).any() || a.min(b).min(c).cmpgt(high).any()
}

/// How a triangle is shaped: 1 if its sides are equal, 0 if it has no area.
pub(super) fn shape([a, b, c]: [DVec3; 3]) -> f64 {
    let sides = (b - a).length_squared() + (c - b).length_squared() + (a - c).length_squared();
    let area = (b - a).cross(c - a).length();
    if sides > 0.0 { area * (2.0 * 3f64.sqrt()) / sides } else { 0.0 }
}
