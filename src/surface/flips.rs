//! Edge flips: two triangles get the other diagonal of their quadrilateral, where that is better.
//!
//! ```text
//!      c               c
//!     /|\             / \          the triangle t keeps its corners at c and d, and passes the one at a on to b;
//!    / | \           / t \         u keeps a and b, and passes the one at c on to d
//!   d t|u b   ->    d-----b
//!    \ | /           \ u /         so a flip is two corners, and whose they were: enough to take it back,
//!     \|/             \ /          as untangling does before any vertex of the two moves
//!      a               a
//! ```
//!
//! The diagonals of faces are chosen before ([`crate::surface::diagonals`]); flips are for the edges between faces, and for triangles whose vertices were contracted.

use crate::points::vector::{cross, dot, minus};
use crate::surface::contract::{NONE, Stars, is_gone};
use crate::surface::extract::second_is_delaunay;

/// A triangle with less than this part of its quadrilateral's area counts as turned over. Areas are seen along the quadrilateral's normal.
const LEAST: f64 = 0.02;

/// Two triangles whose normals have a smaller cosine than this make a ridge, which the other diagonal would cut off: 18°.
const LEVEL: f64 = 0.95;

/// At most one of so many triangles is flipped: flips take memory until the slab is written.
const SPARSE: usize = 4;

/// One of the two corners of a flip.
#[derive(Debug, Clone, Copy)]
struct Flip {
    /// 3 × triangle + position.
    corner: u32,
    /// The other one.
    other: u32,
    /// The vertex whose corner it is, after the flip and before.
    vertices: [u32; 2],
    is_done: bool,
}

/// The flips of a mesh, by triangle: each triangle takes part in one at most.
#[derive(Debug, Clone, Default)]
pub struct Flips(Vec<Flip>);

/// What is asked of vertices and triangles to decide whether an edge is flipped.
pub trait Flippable {
    /// Whether all is known of a vertex, and its star is whole.
    fn is_inside(&self, v: u32) -> bool;
    /// Where a vertex is.
    fn place(&self, v: u32) -> [f64; 3];
    /// Whether it lies at a crease.
    fn is_creased(&self, v: u32) -> bool;
    /// Whether a triangle is written in the end.
    fn is_kept(&self, t: u32) -> bool;
}

/// Two triangles side by side.
struct Quadrilateral {
    /// The corners in turn; the triangles' common edge joins the first and the third.
    corners: [u32; 4],
    /// The corners at the first and at the third that a flip gives to the second and to the fourth.
    passed: [u32; 2],
}

/// Bytes of the flips among so many triangles.
pub fn bytes(triangles: u64) -> u64 {
    triangles / SPARSE as u64 * size_of::<Flip>() as u64
}

/// Bytes that [`flip`] needs beside these.
pub fn bytes_of_flipping(triangles: u64) -> u64 {
    triangles * size_of::<u32>() as u64
}

/// Flips edges where that is better, triangle by triangle: of each, the edge whose quadrilateral's lesser triangle gains most. Triangles and stars are as if the flips had always been.
///
/// Memory: [`bytes`], [`bytes_of_flipping`].
pub fn flip(triangles: &mut [[u32; 3]], stars: &mut Stars, of: &impl Flippable) -> Flips {
    let most = triangles.len() / SPARSE;
    let mut flips: Vec<Flip> = Vec::with_capacity(most);
    // The flip's corner that each triangle has.
    let mut taking_part = vec![NONE; triangles.len()];
    for t in 0..triangles.len() {
        let is_inside = |t: usize| !is_gone(triangles[t]) && triangles[t].iter().all(|v| of.is_inside(*v));
        if taking_part[t] != NONE || !is_inside(t) {
            continue;
        }
        if flips.len() + 2 > most {
            break;
        }
        let mut best: Option<(f64, Quadrilateral)> = None;
        for position in 0..3 {
            let Some(quadrilateral) = Quadrilateral::of(triangles, stars, t, position) else { continue };
            let [one, other] = quadrilateral.passed.map(|corner| corner as usize / 3);
            let is_free = taking_part[other] == NONE && is_inside(other);
            if !is_free || of.is_kept(one as u32) != of.is_kept(other as u32) {
                continue;
            }
            let Some(gain) = quadrilateral.gain(of).filter(|gain| best.as_ref().is_none_or(|best| *gain > best.0))
            else {
                continue;
            };
            let [_, b, _, d] = quadrilateral.corners;
            // Nor where a flip took that edge away: it could not be taken back.
            let is_there = |t: usize| {
                let partner = flips.get(taking_part[t] as usize).map(|flip| triangles[flip.other as usize / 3]);
                triangles[t].contains(&d)
                    || partner.is_some_and(|partner| partner.contains(&d) && !partner.contains(&b))
            };
            if !stars.at(b, triangles).any(|(t, _)| is_there(t)) {
                best = Some((gain, quadrilateral));
            }
        }
        let Some((_, Quadrilateral { corners: [a, b, c, d], passed })) = best else { continue };
        for (corner, other, [before, after]) in [(passed[0], passed[1], [a, b]), (passed[1], passed[0], [c, d])] {
            let holder = stars.cluster(before).find(|member| stars.corners(*member).any(|held| held == corner));
            let vertices = [holder.unwrap_or(before), after];
            taking_part[corner as usize / 3] = flips.len() as u32;
            flips.push(Flip { corner, other, vertices, is_done: true });
            stars.pass(corner, vertices);
            triangles.as_flattened_mut()[corner as usize] = after;
        }
    }
    flips.sort_unstable_by_key(|flip| flip.corner);
    flips.shrink_to_fit();
    Flips(flips)
}

impl Quadrilateral {
    /// The two triangles at the edge of triangle `t` that begins at a position.
    fn of(triangles: &[[u32; 3]], stars: &Stars, t: usize, position: usize) -> Option<Quadrilateral> {
        let [a, c, d] = [0, 1, 2].map(|more| triangles[t][(position + more) % 3]);
        let (u, there) = stars.at(c, triangles).find(|(u, there)| triangles[*u][(there + 1) % 3] == a)?;
        let b = triangles[u][(there + 2) % 3];
        let passed = [3 * t + position, 3 * u + there].map(|corner| corner as u32);
        (b != d).then_some(Quadrilateral { corners: [a, b, c, d], passed })
    }

    /// What the lesser triangle's part of the area gains by a flip, if it is for the better.
    fn gain(&self, of: &impl Flippable) -> Option<f64> {
        let places @ [pa, pb, pc, pd] = self.corners.map(|v| of.place(v));
        let whole = cross(minus(pc, pa), minus(pd, pb));
        let square = dot(whole, whole);
        let normal = |a, b, c| cross(minus(b, a), minus(c, a));
        let part = |normal| dot(normal, whole) / square;
        let (one, other) = (normal(pa, pc, pd), normal(pa, pb, pc));
        let now = part(one).min(part(other));
        let then = part(normal(pb, pc, pd)).min(part(normal(pa, pb, pd)));
        // Also if the whole has no area, and nothing is known.
        if then.is_nan() || then <= LEAST {
            return None;
        }
        let is_better = now <= LEAST || {
            let [a, b, c, d] = self.corners.map(|v| of.is_creased(v));
            match [a && c, b && d] {
                [true, false] => false,
                [false, true] => true,
                _ => {
                    let along = dot(one, other);
                    let is_level = along > 0.0 && along * along >= LEVEL * LEVEL * (dot(one, one) * dot(other, other));
                    is_level && second_is_delaunay(places)
                }
            }
        };
        is_better.then_some(then - now)
    }
}

impl Flips {
    fn of(&self, t: u32) -> Option<usize> {
        self.0.binary_search_by_key(&t, |flip| flip.corner / 3).ok()
    }

    /// Whether a triangle is flipped.
    pub fn has(&self, t: u32) -> bool {
        self.of(t).is_some_and(|at| self.0[at].is_done)
    }

    /// Takes back the flip of a triangle, or makes it again if it was taken back. Gives its two triangles.
    pub fn toggle(&mut self, t: u32, triangles: &mut [[u32; 3]], stars: &mut Stars) -> Option<[u32; 2]> {
        let one = self.of(t)?;
        let other = self.of(self.0[one].other / 3)?;
        let corners = [one, other].map(|at| self.0[at].corner as usize);
        // Of (b, c, d) and (d, a, b), the corners after b and d are wanted; of (a, c, d) and (c, a, b), those before a and c.
        let more = if self.0[one].is_done { 1 } else { 2 };
        let wanted = corners.map(|corner| triangles[corner / 3][(corner % 3 + more) % 3]);
        for ((at, corner), wanted) in [one, other].into_iter().zip(corners).zip([wanted[1], wanted[0]]) {
            let flip = &mut self.0[at];
            let [before, after] = flip.vertices;
            stars.pass(flip.corner, if flip.is_done { [after, before] } else { [before, after] });
            flip.is_done = !flip.is_done;
            triangles[corner / 3][corner % 3] = wanted;
        }
        Some(corners.map(|corner| corner as u32 / 3))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    /// Vertices at places, some of them at creases; of triangles, every so many are not kept.
    struct Places {
        places: Vec<[f64; 3]>,
        creased: Vec<bool>,
        kept: usize,
    }

    impl Flippable for Places {
        fn is_inside(&self, v: u32) -> bool {
            (v as usize) < self.places.len() - 2
        }
        fn place(&self, v: u32) -> [f64; 3] {
            self.places[v as usize]
        }
        fn is_creased(&self, v: u32) -> bool {
            self.creased[v as usize]
        }
        fn is_kept(&self, t: u32) -> bool {
            t as usize >= self.kept
        }
    }

    /// A torus of so many squares either way, cut in two.
    fn torus(side: u32) -> Vec<[u32; 3]> {
        let at = |u: u32, v: u32| u % side * side + v % side;
        let squares = (0..side).flat_map(|u| (0..side).map(move |v| (u, v)));
        let halves = |(u, v)| {
            let [a, b, c, d] = [at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)];
            [[a, b, c], [a, c, d]]
        };
        squares.flat_map(halves).collect()
    }

    /// Each edge from corner to corner, once; and what is held of each vertex.
    fn edges(triangles: &[[u32; 3]]) -> BTreeSet<[u32; 2]> {
        triangles.iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]).collect()
    }

    fn held(stars: &Stars, vertices: u32) -> Vec<BTreeSet<u32>> {
        (0..vertices).map(|v| stars.corners(v).collect()).collect()
    }

    proptest! {
        /// Flips leave a closed manifold, with stars that are its own; none makes an edge that another took away; taken back in any order, they leave what was, and can be made again.
        #[test]
        fn flips_keep_a_manifold_and_can_be_taken_back(
            side in 4u32..9,
            heights in prop::collection::vec(prop::array::uniform3(-0.9f64..0.9), 64),
            creased in prop::collection::vec(prop::bool::weighted(0.2), 64),
            kept in 0usize..20,
            order in prop::collection::vec(any::<u32>(), 128),
        ) {
            let count = side * side;
            let place = |v: u32| {
                let [x, y, z] = heights[v as usize];
                [f64::from(v / side) + x, f64::from(v % side) + y, z / 3.0]
            };
            let of = Places { places: (0..count).map(place).collect(), creased, kept };
            let before = torus(side);
            let mut triangles = before.clone();
            let stars_of = |triangles: &[[u32; 3]]| Stars::new(triangles, count as usize, count as usize, Stars::default());
            let mut stars = stars_of(&before);
            let mut flips = flip(&mut triangles, &mut stars, &of);
            prop_assert!(flips.0.len() <= before.len() / SPARSE);
            prop_assert_eq!(edges(&triangles).len(), 3 * triangles.len());
            prop_assert!(edges(&triangles).iter().all(|[a, b]| edges(&triangles).contains(&[*b, *a])));
            prop_assert_eq!(held(&stars, count), held(&stars_of(&triangles), count));
            let [was, is] = [edges(&before), edges(&triangles)];
            // Whatever is taken back, its edges are not there twice.
            prop_assert_eq!(was.difference(&is).count(), flips.0.len());
            for (t, triangle) in triangles.iter().enumerate().filter(|(t, _)| flips.has(*t as u32)) {
                prop_assert!(triangle.iter().chain(&before[t]).all(|v| of.is_inside(*v)));
            }

            let after = triangles.clone();
            let mut some: Vec<u32> = (0..triangles.len() as u32).collect();
            some.sort_by_key(|t| order[*t as usize % order.len()]);
            for t in &some {
                if flips.has(*t) {
                    let both = flips.toggle(*t, &mut triangles, &mut stars).unwrap();
                    prop_assert!(both.contains(t) && !flips.has(both[0]) && !flips.has(both[1]));
                }
            }
            prop_assert_eq!(&triangles, &before);
            prop_assert_eq!(held(&stars, count), held(&stars_of(&before), count));
            for t in some.iter().filter(|t| after[**t as usize] != before[**t as usize]) {
                if !flips.has(*t) {
                    flips.toggle(*t, &mut triangles, &mut stars).unwrap();
                }
            }
            prop_assert_eq!(&triangles, &after);
            prop_assert_eq!(held(&stars, count), held(&stars_of(&after), count));
        }
    }

    /// A triangle that is turned over gets the other diagonal; a crease stays an edge, and becomes one.
    #[test]
    fn what_is_turned_over_is_flipped_and_creases_are_followed() {
        let flipped = |places: [[f64; 3]; 4], creased: [bool; 4]| {
            let of = Places { places: places.to_vec(), creased: creased.to_vec(), kept: 0 };
            let quadrilateral = Quadrilateral { corners: [0, 1, 2, 3], passed: [0, 0] };
            quadrilateral.gain(&of).is_some()
        };
        let none = [false; 4];
        // The third corner lies within the triangle of the others: seen from the first, the diagonal to it is the only sound one.
        let reflex = [[0.0, 0.0, 0.0], [4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 4.0, 0.0]];
        let turned = [reflex[1], reflex[2], reflex[3], reflex[0]];
        assert!(!flipped(reflex, none) && flipped(turned, none));
        let long = [[0.0, 0.0, 0.0], [2.0, -1.0, 0.0], [4.0, 0.0, 0.0], [2.0, 1.0, 0.0]];
        assert!(
            flipped(long, none)
                && !flipped(long, [true, false, true, false])
                && flipped(long, [false, true, false, true])
        );
        // A ridge is no worse for being long.
        let ridge = [[0.0, 0.0, 0.5], [2.0, -1.0, 0.0], [4.0, 0.0, 0.5], [2.0, 1.0, 0.0]];
        assert!(!flipped(ridge, none));
    }
}
