//! A slab: its fixed share of the slices, and the mesh made of it alone, before its seams are closed.

use std::ops::Range;

use crate::points::Coordinate;
use crate::resources::memory::Claim;
use crate::stitch::numbers::{InSlab, Named};
use crate::stitch::size::Size;
use crate::surface::contract::{Stars, is_gone};
use crate::surface::fit::Fitted;
use crate::surface::flips::Flips;
use crate::surface::untangle::quantized::{PackedBox, QuantizedPoint};
use crate::surface::vertex_state::{CREASED, SHARES, SIDEWAYS, VertexState};

/// The mesh of one slab, of points of precision `T`.
///
/// Triangles name vertices by number, as [`Named`] says: the slab's, and those of the slabs on either side.
#[derive(Debug, Clone, Default)]
pub struct SlabMesh<T> {
    /// The slab's slices.
    pub slices: Range<u32>,
    /// The position of each vertex before it is fitted, in file axes: the smoothed one, of open surfaces at the surface's height where that is known.
    pub smoothed: Vec<[f64; 3]>,
    /// The position of each vertex at rest: after one step of smoothing. Empty if that is the smoothed one.
    pub rest: Vec<[f64; 3]>,
    /// The point of each vertex.
    pub fitted: Fitted<T>,
    /// Where each vertex goes instead of its point, so that facets pass amid the points, and where it would be without leaving its place along the surface; empty if vertices go to their points.
    pub centred: Vec<[[T; 3]; 2]>,
    /// The vertices at creases, in order, and their places there.
    pub creased: Vec<(u32, [T; 3])>,
    /// The record of each vertex's attributes.
    pub attributes: Vec<u8>,
    /// The state of each vertex.
    pub state: Vec<VertexState>,
    /// Whether each triangle is written in the end; empty if all are.
    pub kept: Vec<bool>,
    /// Triangles, in order; where contraction took one away, two of its corners are the same.
    pub triangles: Vec<[u32; 3]>,
    /// The triangles at each of the slab's vertices and of the next slab's that it names.
    pub stars: Stars,
    /// The first vertex of each plane, from the lowest on; then [`SlabMesh::own`].
    pub planes: Vec<u32>,
    /// The quantized position of each vertex, where it is now.
    pub quantized: Vec<QuantizedPoint>,
    /// The boxes of [`BLOCK`](crate::surface::untangle::broad_phase::BLOCK) triangles each.
    pub blocks: Vec<PackedBox>,
    /// The flips among its triangles.
    pub flips: Flips,
    /// Pairs of its own triangles that still intersect.
    pub tangled: u64,
    /// Its size, if anybody is told of it.
    pub size: Size,
    /// What it says that it holds of memory.
    pub claim: Claim,
}

/// Triangles that do not matter when a slab is given another's room.
const SMALL: usize = 1 << 12;

impl<T: Coordinate> SlabMesh<T> {
    /// Number of the slab's own vertices, contracted ones included.
    #[inline]
    pub fn own(&self) -> u32 {
        self.state.len() as u32
    }

    /// The slab's vertices on its lowest plane: `0..seam()`.
    pub fn seam(&self) -> u32 {
        self.planes[1]
    }

    /// What its triangles mean by a name.
    #[inline]
    pub fn named(&self, name: u32) -> Named {
        Named::of(name, self.own())
    }

    /// The plane that vertex `v` is on.
    pub fn plane_of(&self, v: InSlab) -> u32 {
        self.slices.start + self.planes.partition_point(|first| *first <= v.0) as u32 - 1
    }

    /// The vertices on the lowest `planes` planes.
    pub fn on_lowest(&self, planes: u32) -> impl DoubleEndedIterator<Item = InSlab> + use<T> {
        let numbers = 0..self.planes[self.planes.len().min(planes as usize + 1) - 1];
        numbers.map(InSlab)
    }

    /// The vertices on the highest `planes` planes.
    pub fn on_highest(&self, planes: u32) -> impl DoubleEndedIterator<Item = InSlab> + use<T> {
        let numbers = self.planes[self.planes.len().saturating_sub(planes as usize + 1)]..self.own();
        numbers.map(InSlab)
    }

    /// Room for a slab of this size: what it does not fill is not touched.
    pub fn with_room(size: Size, smooth: u32) -> SlabMesh<T> {
        let vertices = Size::vertices(size.faces) as usize;
        let triangles = size.triangles() as usize;
        SlabMesh {
            // Each further step of smoothing takes new memory.
            smoothed: Vec::with_capacity(if smooth > 1 { 0 } else { Size::vertices(size.round) as usize }),
            fitted: Fitted { point: Vec::with_capacity(vertices), target: Vec::with_capacity(vertices) },
            state: Vec::with_capacity(vertices),
            triangles: Vec::with_capacity(triangles),
            stars: Stars::with_room(vertices, triangles),
            quantized: Vec::with_capacity(vertices),
            ..SlabMesh::default()
        }
    }

    /// Whether this is the right room for a slab of that size: large enough, and not much too large, since the slab holds it while it waits.
    pub fn suits(&self, size: Size) -> bool {
        let (room, needed) = (self.triangles.capacity(), size.triangles() as usize);
        (needed..=needed + needed / 8 + SMALL).contains(&room)
    }

    /// Takes back the flip that triangle `t` takes part in, or makes it again. Gives its two triangles.
    pub fn toggle_flip(&mut self, t: u32) -> Option<[u32; 2]> {
        self.flips.toggle(t, &mut self.triangles, &mut self.stars)
    }

    /// The squared distance of vertex `v`, where smoothing put it, to its point.
    #[inline]
    pub fn distance(&self, v: InSlab) -> f64 {
        self.fitted.distance(v.at(), self.smoothed[v.at()])
    }

    /// The final position of vertex `v`, in file axes.
    #[inline]
    pub fn position(&self, v: InSlab) -> [f64; 3] {
        let smoothed = self.smoothed[v.at()];
        let own = self.fitted.target[v.at()];
        let [target, beside] = self.centred.get(v.at()).unwrap_or(&[own; 2]).map(|place| place.map(Into::into));
        let between =
            |from: [f64; 3], to: [f64; 3], share: f64| std::array::from_fn(|a| from[a] + share * (to[a] - from[a]));
        match self.state[v.at()] {
            VertexState::Fitted | VertexState::Projected | VertexState::Bridged => target,
            VertexState::Creased(step) => match self.creased.binary_search_by_key(&v.0, |(v, _)| *v) {
                Ok(at) => between(target, self.creased[at].1.map(Into::into), CREASED[usize::from(step)]),
                Err(_) => target,
            },
            VertexState::Attracted => between(smoothed, target, 0.9),
            VertexState::Unfitted | VertexState::Contracted => smoothed,
            VertexState::AtRest => self.rest_of(v),
            VertexState::Backtracked(step) if beside == target => {
                between(self.rest_of(v), target, SHARES[usize::from(step)])
            }
            // Along the surface first.
            VertexState::Backtracked(step) => match SIDEWAYS.get(usize::from(step)) {
                Some(share) => between(beside, target, *share),
                None => between(self.rest_of(v), beside, SHARES[usize::from(step)]),
            },
        }
    }

    fn rest_of(&self, v: InSlab) -> [f64; 3] {
        *self.rest.get(v.at()).unwrap_or(&self.smoothed[v.at()])
    }

    /// Whether a triangle is written, if it is left.
    #[inline]
    pub fn is_kept(&self, t: u32) -> bool {
        self.kept.get(t as usize).copied().unwrap_or(true)
    }

    /// The triangles that are written: left, and kept.
    pub fn triangles_written(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        let triangles = (0u32..).zip(&self.triangles);
        triangles.filter(|(t, triangle)| self.is_kept(*t) && !is_gone(**triangle)).map(|(_, triangle)| *triangle)
    }

    /// The triangles that are left.
    pub fn triangles_left(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.triangles.iter().copied().filter(|t| !is_gone(*t))
    }
}
