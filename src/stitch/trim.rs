//! Trim: what is written of a surface that is not closed. Triangles that are not kept are left out, and so are vertices that no other names.
//!
//! ```text
//!     left out   /  next slab                a slab's triangles name vertices of the next (o): whether those are written, and with what numbers, must not
//!   ------------o----o----                   change any more, so with them all vertices round them (x) are frozen
//!              / \  / \
//!   kept      x   x    x
//! ```

use crate::points::Coordinate;
use crate::stitch::slab::{BEFORE, SlabMesh};
use crate::surface::contract::{NONE, is_gone};

/// What is written of a slab.
#[derive(Debug)]
pub struct Trimmed {
    /// Whether each of the slab's vertices is written.
    pub written: Vec<bool>,
    /// Its kept triangles.
    pub triangles: Vec<[u32; 3]>,
    /// The next slab's vertices `0..frozen` must stay as they are.
    pub frozen: u32,
}

/// What is known from slab to slab.
#[derive(Debug, Default)]
pub struct Trim {
    /// Whether kept triangles of the slab below name each of the slab's first vertices.
    named: Vec<bool>,
    /// Numbers of the vertices of the slab before.
    before: Vec<u32>,
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
    /// What is written of `slab`, with numbers from `base` on, if `next` follows it.
    pub fn slab<T: Coordinate>(&mut self, slab: &SlabMesh<T>, next: Option<&SlabMesh<T>>, base: u32) -> Trimmed {
        let own = slab.own();
        let mut written = std::mem::take(&mut self.named);
        written.resize(own as usize, false);
        kept(slab).flatten().filter(|v| *v < own).for_each(|v| written[v as usize] = true);
        let of_next = next.into_iter().flat_map(kept).flatten().filter(|v| *v >= BEFORE);
        of_next.for_each(|v| written[(v - BEFORE) as usize] = true);
        let mut number = base;
        let mut count = |written: bool| {
            number += u32::from(written);
            number - u32::from(written)
        };
        let numbers: Vec<u32> = written.iter().map(|written| count(*written)).collect();

        // The next slab's vertices up to the last that is named.
        let names_next = |v: &u32| (own..BEFORE).contains(v);
        let named = slab.triangles_left().flatten().filter(names_next).max().map_or(0, |v| v - own + 1);
        self.named = vec![false; named as usize];
        kept(slab).flatten().filter(names_next).for_each(|v| self.named[(v - own) as usize] = true);
        let mut frozen = named;
        let mut after = Vec::with_capacity(named as usize);
        if let Some(next) = next {
            let mut all = self.named.clone();
            kept(next).flatten().filter(|v| *v < named).for_each(|v| all[v as usize] = true);
            after.extend(all.into_iter().map(count));
            let corners = (0..named).flat_map(|v| around(next, v)).flatten().filter(|u| *u < next.own());
            frozen = corners.map(|u| u + 1).fold(frozen, u32::max);
        }

        let name = |v: u32| {
            if v >= BEFORE {
                self.before[(v - BEFORE) as usize]
            } else if v >= own {
                after[(v - own) as usize]
            } else {
                numbers[v as usize]
            }
        };
        let triangles = kept(slab).map(|triangle| triangle.map(name)).collect();
        self.before = numbers;
        Trimmed { written, triangles, frozen }
    }
}
