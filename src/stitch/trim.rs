//! Trim: what is written of a surface that is not closed. Triangles that are not kept are left out, and so are vertices that no other names.
//!
//! ```text
//!     left out   /  next slab                a slab's triangles name vertices of the next (o): whether those are written, and with what numbers, must not
//!   ------------o----o----                   change any more, so with them all vertices round them (x) are frozen
//!              / \  / \
//!   kept      x   x    x
//! ```

use crate::points::Coordinate;
use crate::stitch::numbers::{BEFORE, InMesh, Named};
use crate::stitch::slab::SlabMesh;
use crate::surface::contract::{NONE, is_gone};

/// What is written of a slab.
#[derive(Debug)]
pub struct Trimmed {
    /// Whether each of the slab's vertices is written.
    pub written: Vec<bool>,
    /// Its kept triangles.
    pub triangles: Vec<[InMesh; 3]>,
    /// The next slab's vertices `0..frozen` must stay as they are.
    pub frozen: u32,
}

/// What is known from slab to slab.
#[derive(Debug, Default)]
pub struct Trim {
    /// Whether kept triangles of the slab below name each of the slab's first vertices.
    named: Vec<bool>,
    /// Numbers of the vertices of the slab before.
    before: Vec<InMesh>,
}

/// The kept triangles that are left of a slab.
fn kept<T: Coordinate>(slab: &SlabMesh<T>) -> impl Iterator<Item = [u32; 3]> + '_ {
    slab.triangles_written()
}

/// The triangles of `next` that are left at its vertex `v`, and the vertices that have become `v`, of `slab`'s or its own.
fn around<T: Coordinate>(next: &SlabMesh<T>, v: u32) -> impl Iterator<Item = [u32; 3]> + '_ {
    let own = |v: &u32| *v != NONE && *v < BEFORE;
    let cluster = std::iter::successors(Some(v), move |v| next.stars.also.get(*v as usize).copied().filter(own));
    let triangles = cluster.flat_map(|v| next.stars.corners(v)).map(|corner| next.triangles[corner as usize / 3]);
    triangles.filter(|triangle| !is_gone(*triangle))
}

impl Trim {
    /// What is written of `slab` if `next` follows it. `base` tells the number of its first vertex, given how many are written; below zero, numbers wrap.
    pub fn slab<T: Coordinate>(
        &mut self,
        slab: &SlabMesh<T>,
        next: Option<&SlabMesh<T>>,
        base: impl FnOnce(u32) -> u32,
    ) -> Trimmed {
        let own = slab.own();
        let mut written = std::mem::take(&mut self.named);
        written.resize(own as usize, false);
        kept(slab).flatten().filter(|v| *v < own).for_each(|v| written[v as usize] = true);
        if let Some(next) = next {
            for name in kept(next).flatten() {
                if let Named::Before(v) = next.named(name) {
                    written[v.at()] = true;
                }
            }
        }
        let mut next_number = base(written.iter().map(|written| u32::from(*written)).sum());
        let mut count = |written: bool| {
            let number = next_number;
            next_number = number.wrapping_add(u32::from(written));
            InMesh(number)
        };
        let numbers: Vec<InMesh> = written.iter().map(|written| count(*written)).collect();

        // The next slab's vertices up to the last that is named.
        let of_next = |name: u32| slab.named(name).of_next();
        let named = slab.triangles_left().flatten().filter_map(of_next).max().map_or(0, |v| v.0 + 1);
        self.named = vec![false; named as usize];
        kept(slab).flatten().filter_map(of_next).for_each(|v| self.named[v.at()] = true);
        let mut frozen = named;
        let mut after = Vec::with_capacity(named as usize);
        if let Some(next) = next {
            let mut all = self.named.clone();
            kept(next).flatten().filter(|v| *v < named).for_each(|v| all[v as usize] = true);
            after.extend(all.into_iter().map(count));
            let corners = (0..named).flat_map(|v| around(next, v)).flatten().filter(|u| *u < next.own());
            frozen = corners.map(|u| u + 1).fold(frozen, u32::max);
        }

        let name = |name: u32| match slab.named(name) {
            Named::Own(v) => numbers[v.at()],
            Named::Next(v) => after[v.at()],
            Named::Before(v) => self.before[v.at()],
        };
        let triangles = kept(slab).map(|triangle| triangle.map(name)).collect();
        self.before = numbers;
        Trimmed { written, triangles, frozen }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;
    use crate::stitch::numbers::InSlab;
    use crate::surface::contract::Stars;
    use crate::surface::vertex_state::VertexState;

    /// A slab to be: its vertices; and of each triangle its corners as seeds, whether it is kept, and what its first corner is instead, of the slab before.
    type Plan = (u32, Vec<([u32; 3], bool, Option<u32>)>);

    fn plan() -> impl Strategy<Value = Plan> {
        let triangle =
            (prop::array::uniform3(any::<u32>()), prop::bool::weighted(0.7), prop::option::weighted(0.2, any::<u32>()));
        (2u32..12, prop::collection::vec(triangle, 0..12))
    }

    /// The slab, and its triangles before any was closed over the seam below. The slab before names vertices of its lower half, the one after those of its upper half.
    fn slab(plans: &[Plan], k: usize) -> (SlabMesh<f32>, Vec<[u32; 3]>) {
        let (own, triangles) = &plans[k];
        let names = own + plans.get(k + 1).map_or(0, |(next, _)| next / 2);
        let first: Vec<[u32; 3]> = triangles.iter().map(|(seeds, ..)| seeds.map(|seed| seed % names)).collect();
        let mut now = first.clone();
        for (corners, (.., before)) in now.iter_mut().zip(triangles) {
            if let (Some(seed), Some(below)) = (before, k.checked_sub(1)) {
                let below = plans[below].0;
                corners[0] = BEFORE + below / 2 + seed % (below - below / 2);
            }
        }
        let stars = Stars::new(&first, names as usize, *own as usize, Stars::default());
        let kept = triangles.iter().map(|(_, kept, _)| *kept).collect();
        let state = vec![VertexState::Unfitted; *own as usize];
        (SlabMesh { state, kept, triangles: now, stars, ..SlabMesh::default() }, first)
    }

    proptest! {
        /// Slab by slab against all slabs at once.
        #[test]
        fn what_is_written_is_what_kept_triangles_name(plans in prop::collection::vec(plan(), 1..5)) {
            let slabs: Vec<(SlabMesh<f32>, Vec<[u32; 3]>)> = (0..plans.len()).map(|k| slab(&plans, k)).collect();
            let meant = |k: usize, name: u32| match slabs[k].0.named(name) {
                Named::Own(v) => (k, v),
                Named::Next(v) => (k + 1, v),
                Named::Before(v) => (k - 1, v),
            };
            let kept_of = |k: usize| kept(&slabs[k].0).map(move |t| t.map(|name| meant(k, name))).collect::<Vec<_>>();
            let named: BTreeSet<(usize, InSlab)> = (0..slabs.len()).flat_map(kept_of).flatten().collect();
            let number = |of: (usize, InSlab)| InMesh(named.range(..of).count() as u32);
            let (mut trim, mut base) = (Trim::default(), 0);
            for (k, (slab, _)) in slabs.iter().enumerate() {
                let next = slabs.get(k + 1);
                let found = trim.slab(slab, next.map(|(next, _)| next), |_| base);
                let written: Vec<bool> = (0..slab.own()).map(|v| named.contains(&(k, InSlab(v)))).collect();
                base += written.iter().filter(|written| **written).count() as u32;
                prop_assert_eq!(found.written, written);
                prop_assert_eq!(found.triangles, kept_of(k).into_iter().map(|t| t.map(number)).collect::<Vec<_>>());
                // Frozen are the vertices up to the last that is named, and up to all that share a triangle with one of these.
                let last = slab.triangles_left().flatten().filter_map(|name| slab.named(name).of_next()).max();
                let mut frozen = last.map_or(0, |v| v.0 + 1);
                let upto = frozen;
                if let Some((next, first)) = next {
                    for (triangle, first) in next.triangles.iter().zip(first) {
                        if !is_gone(*triangle) && first.iter().any(|v| *v < upto) {
                            frozen = triangle.iter().filter(|u| **u < next.own()).map(|u| u + 1).fold(frozen, u32::max);
                        }
                    }
                }
                prop_assert_eq!(found.frozen, frozen);
            }
        }
    }
}
