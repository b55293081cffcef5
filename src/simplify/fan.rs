//! The triangles that are to come in the place of a vertex's star, and whether they would meet others.

use glam::{DVec2, DVec3};

use super::boxes::{Boxes, Extent};
use super::gap::Overlay;
use super::patch::Node;
use super::piece::Piece;
use crate::mesh::intersect::intersect;

/// What a side must clear a place by to be taken for a wall between triangles, as a part of the square of the greatest length: far more than rounding.
const CLEAR: f64 = 1e-11;

/// A triangle that is to come.
#[derive(Debug, Clone, Copy)]
struct Fresh {
    vertices: [u32; 3],
    places: [DVec3; 3],
    low: DVec3,
    high: DVec3,
    /// Counter-clockwise, seen along the overlay's axis: the vertices and where they are.
    seen: [(u32, DVec2); 3],
}

/// Triangles that are to come, and room for those near them.
#[derive(Debug, Default)]
pub(super) struct Fan {
    fresh: Vec<Fresh>,
    near: Vec<u32>,
}

impl Fan {
    /// The triangles from the first vertex of a ring to all sides that it is not an end of. `mirrored` tells that the ring runs clockwise.
    pub(super) fn spread(
        &mut self,
        piece: &Piece,
        ring: impl Fn(usize) -> u32,
        len: usize,
        mirrored: bool,
        overlay: &Overlay,
    ) {
        self.fresh.clear();
        for k in 1..len.saturating_sub(1) {
            let numbers = [0, k, k + 1];
            let vertices = numbers.map(&ring);
            let places = vertices.map(|v| piece.position(v));
            let [a, b, c] = places;
            let seen = numbers.map(|number| (ring(number), overlay.seen(number)));
            let vertices = if mirrored { [vertices[0], vertices[2], vertices[1]] } else { vertices };
            let places = if mirrored { [a, c, b] } else { places };
            self.fresh.push(Fresh { vertices, places, low: a.min(b).min(c), high: a.max(b).max(c), seen });
        }
    }

    /// The triangles from a vertex, at a place, to all sides of the ring round it. `nodes` are those of the ring, and the last is the vertex's.
    pub(super) fn spread_round(&mut self, piece: &Piece, ring: &[u32], (middle, place): (u32, DVec3), nodes: &[Node]) {
        self.fresh.clear();
        for k in 0..ring.len() {
            let numbers = [k, (k + 1) % ring.len()];
            let [(p, b), (q, c)] = numbers.map(|k| (ring[k], piece.position(ring[k])));
            let places = [place, b, c];
            let seen = [(middle, nodes[nodes.len() - 1].at), (p, nodes[numbers[0]].at), (q, nodes[numbers[1]].at)];
            let (low, high) = (place.min(b).min(c), place.max(b).max(c));
            self.fresh.push(Fresh { vertices: [middle, p, q], places, low, high, seen });
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
        let Fan { fresh, near } = self;
        let Some(first) = fresh.first() else { return false };
        let (low, high) =
            fresh.iter().fold((first.low, first.high), |(low, high), f| (low.min(f.low), high.max(f.high)));
        near.clear();
        boxes.near(&Extent::of([low, high]), near);
        for &t in near.iter() {
            let there = piece.triangles[t as usize];
            let its = there.map(|v| piece.position(v));
            let (its_low, its_high) = (its[0].min(its[1]).min(its[2]), its[0].max(its[1]).max(its[2]));
            let outside = |low: DVec3, high: DVec3| low.cmpgt(its_high).any() || its_low.cmpgt(high).any();
            if outside(low, high) || star.contains(&t) {
                continue;
            }
            let mut seen = None;
            for one in fresh.iter().filter(|one| !outside(one.low, one.high)) {
                if let Some((right, up)) = axes {
                    let across = |place: DVec3| DVec2::new((place - own).dot(right), (place - own).dot(up));
                    let seen = seen.get_or_insert_with(|| its.map(across));
                    if is_beside(one, there, seen) {
                        continue;
                    }
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

/// Whether a triangle that is there lies on the outer side of one side of a new one, seen along the axis, but for corners that are ends of that side: then they
/// have nothing else in common. `false` says nothing.
fn is_beside(fresh: &Fresh, there: [u32; 3], seen: &[DVec2; 3]) -> bool {
    let [a, b, c] = fresh.seen;
    [(a, b), (b, c), (c, a)].into_iter().any(|((from, p), (to, q))| {
        let along = q - p;
        there.iter().zip(seen).all(|(v, place)| {
            let way = *place - p;
            *v == from || *v == to || along.perp_dot(way) < -CLEAR * (along.length_squared() + way.length_squared())
        })
    })
}

/// How a triangle is shaped: 1 if its sides are equal, 0 if it has no area.
pub(super) fn shape([a, b, c]: [DVec3; 3]) -> f64 {
    let sides = (b - a).length_squared() + (c - b).length_squared() + (a - c).length_squared();
    let area = (b - a).cross(c - a).length();
    if sides > 0.0 { area * (2.0 * 3f64.sqrt()) / sides } else { 0.0 }
}
