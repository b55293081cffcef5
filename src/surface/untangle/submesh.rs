//! The part of a mesh that is untangled at a time, as the rounds and the stars see it.

use super::broad_phase::Places;
use crate::surface::vertex_state::Fate;

/// A part of the mesh in which vertices may retreat.
pub trait Piece: Places {
    /// One more than the highest vertex of a known triangle.
    fn vertices(&self) -> u32;
    /// The place of a vertex, as it is going to be written.
    fn place(&self, v: u32) -> [f64; 3];
    /// The corners (3 × triangle + position) that were `v`'s before any contraction.
    fn corners(&self, v: u32) -> impl Iterator<Item = u32>;
    /// The next vertex of `v`'s cluster, or [`NONE`](crate::surface::contract::NONE).
    fn also(&self, v: u32) -> u32;
    /// Whether all triangles at `v` are in the piece.
    fn is_whole(&self, v: u32) -> bool;
    /// Whether `v` must stay as it is.
    fn is_settled(&self, v: u32) -> bool;
    /// Whether triangle `t` is written in the end.
    fn is_kept(&self, t: u32) -> bool;
    /// What became of `v`.
    fn fate(&self, v: u32) -> Fate;
    /// Gives the corners that were `v`'s to `survivor`, and sets the rest of its state.
    fn put(&mut self, v: u32, survivor: u32, also: u32, fate: Fate);
}
