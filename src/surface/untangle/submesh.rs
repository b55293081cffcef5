//! The part of a mesh that is untangled at a time, as the rounds and the stars see it.

use super::broad_phase::TriangleSet;
use crate::surface::vertex_state::VertexState;

/// A part of the mesh in which vertices may retreat.
pub trait Submesh: TriangleSet {
    /// One more than the highest vertex of a known triangle.
    fn vertices(&self) -> u32;
    /// The position of a vertex, as it is going to be written.
    fn place(&self, v: u32) -> [f64; 3];
    /// The corners (3 × triangle + position) that were `v`'s before any contraction.
    fn corners(&self, v: u32) -> impl Iterator<Item = u32>;
    /// The next vertex of `v`'s cluster, or [`NONE`](crate::surface::contract::NONE).
    fn also(&self, v: u32) -> u32;
    /// Whether all triangles at `v` are in the submesh.
    fn is_whole(&self, v: u32) -> bool;
    /// Whether `v` must stay as it is.
    fn is_frozen(&self, v: u32) -> bool;
    /// Whether triangle `t` is written in the end.
    fn is_kept(&self, t: u32) -> bool;
    /// Whether triangle `t` is flipped ([`crate::surface::flips`]).
    fn is_flipped(&self, t: u32) -> bool;
    /// Takes back the flip of triangle `t`, or makes it again if it was taken back. Gives its two triangles.
    fn toggle_flip(&mut self, t: u32) -> Option<[u32; 2]>;
    /// The state of `v`.
    fn state(&self, v: u32) -> VertexState;
    /// Gives the corners that were `v`'s to `survivor`, and sets the rest of its state.
    fn put(&mut self, v: u32, survivor: u32, also: u32, state: VertexState);
}
