//! What is nearest: of any number of places or triangles, in bounded memory.
//!
//! Distances are exact, by brute force made fast: targets lie in blocks on disk ([`blocks`]), each with a tree of boxes while it is in memory ([`tree`]), and queries go from block to
//! block until none nearer can hold anything ([`search`]). Neither threads nor memory show in what is found ([`shape`]).

pub(crate) mod blocks;
pub(crate) mod bridged;
pub(crate) mod room;
pub(crate) mod search;
pub(crate) mod shape;
#[cfg(test)]
pub(crate) mod testing;
pub(crate) mod tree;
