//! A slab before its seams are closed, as untangling sees it.

use std::ops::Range;

use crate::mesh::spool::Frame;
use crate::points::Coordinate;
use crate::stitch::numbers::InSlab;
use crate::stitch::slab::SlabMesh;
use crate::surface::contract::{NONE, is_gone};
use crate::surface::flips::{Flippable, flip};
use crate::surface::untangle::broad_phase::{BLOCK, TriangleSet};
use crate::surface::untangle::quantized::{PackedBox, QuantizedPoint, Quantizer};
use crate::surface::untangle::submesh::Submesh;
use crate::surface::vertex_state::VertexState;

/// A slab by itself: its vertices from `first` on are free to retreat.
pub(super) struct Inside<'a, T> {
    slab: &'a mut SlabMesh<T>,
    first: u32,
    frame: Frame,
    quantizer: Quantizer,
    /// The position of each vertex where it is now, as it is going to be written.
    places: Vec<[T; 3]>,
}

impl<'a, T: Coordinate> Inside<'a, T> {
    /// The slab, with its vertices where they are now.
    pub fn of(slab: &'a mut SlabMesh<T>, frame: Frame, quantizer: Quantizer) -> Inside<'a, T> {
        let first = if slab.slices.start > 0 { slab.seam() } else { 0 };
        let own = (0..slab.own()).map(InSlab);
        let places: Vec<[T; 3]> = own.map(|v| frame.place(slab.position(v)).map(T::from_f64)).collect();
        slab.quantized.clear();
        slab.quantized.reserve_exact(places.len());
        slab.quantized.extend(places.iter().map(|place| quantizer.quantized_point(place.map(Into::into))));
        Inside { slab, first, frame, quantizer, places }
    }

    /// Flips edges where that is better.
    pub fn flip_edges(&mut self) {
        let SlabMesh { triangles, stars, .. } = &mut *self.slab;
        let (mut triangles, mut stars) = (std::mem::take(triangles), std::mem::take(stars));
        self.slab.flips = flip(&mut triangles, &mut stars, self);
        (self.slab.triangles, self.slab.stars) = (triangles, stars);
    }
}

impl<T: Coordinate> Flippable for Inside<'_, T> {
    fn is_inside(&self, v: u32) -> bool {
        self.is_whole(v)
    }

    #[inline]
    fn place(&self, v: u32) -> [f64; 3] {
        Submesh::place(self, v)
    }

    fn is_creased(&self, v: u32) -> bool {
        matches!(self.state(v), VertexState::Creased(_))
    }

    fn is_kept(&self, t: u32) -> bool {
        Submesh::is_kept(self, t)
    }
}

impl<T: Coordinate> TriangleSet for Inside<'_, T> {
    fn stretches(&self) -> [Range<u32>; 2] {
        let end = self.slab.triangles.len().next_multiple_of(BLOCK) as u32;
        [0..self.slab.triangles.len() as u32, end..end]
    }

    #[inline]
    fn triangle(&self, t: u32) -> [u32; 3] {
        self.slab.triangles[t as usize]
    }

    #[inline]
    fn is_known(&self, triangle: [u32; 3]) -> bool {
        triangle.iter().all(|v| self.is_whole(*v))
    }

    #[inline]
    fn known(&self, t: u32) -> Option<[u32; 3]> {
        let triangle = *self.slab.triangles.get(t as usize)?;
        (!is_gone(triangle) && self.is_known(triangle)).then_some(triangle)
    }

    #[inline]
    fn quantized_point(&self, v: u32) -> QuantizedPoint {
        self.slab.quantized[v as usize]
    }

    fn blocks(&mut self) -> &mut [PackedBox] {
        &mut self.slab.blocks
    }
}

impl<T: Coordinate> Submesh for Inside<'_, T> {
    fn vertices(&self) -> u32 {
        self.slab.own()
    }

    #[inline]
    fn place(&self, v: u32) -> [f64; 3] {
        self.places[v as usize].map(Into::into)
    }

    fn corners(&self, v: u32) -> impl Iterator<Item = u32> {
        self.slab.stars.corners(v)
    }

    #[inline]
    fn also(&self, v: u32) -> u32 {
        self.slab.stars.also.get(v as usize).copied().unwrap_or(NONE)
    }

    fn is_whole(&self, v: u32) -> bool {
        (self.first..self.slab.own()).contains(&v)
    }

    fn is_frozen(&self, _: u32) -> bool {
        false
    }

    #[inline]
    fn is_kept(&self, t: u32) -> bool {
        self.slab.is_kept(t)
    }

    fn is_flipped(&self, t: u32) -> bool {
        self.slab.flips.has(t)
    }

    fn toggle_flip(&mut self, t: u32) -> Option<[u32; 2]> {
        self.slab.toggle_flip(t)
    }

    fn state(&self, v: u32) -> VertexState {
        self.slab.state[v as usize]
    }

    fn put(&mut self, v: u32, survivor: u32, also: u32, state: VertexState) {
        let SlabMesh { stars, triangles, .. } = &mut *self.slab;
        for corner in stars.corners(v) {
            triangles.as_flattened_mut()[corner as usize] = survivor;
        }
        stars.also[v as usize] = also;
        self.slab.state[v as usize] = state;
        let place = self.frame.place(self.slab.position(InSlab(v)));
        self.places[v as usize] = place.map(T::from_f64);
        self.slab.quantized[v as usize] = self.quantizer.quantized_point(place);
    }
}
