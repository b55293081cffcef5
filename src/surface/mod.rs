//! From the solid to the triangles of one slab: corners, smoothing, fitting, contraction, attributes, untangling.
//!
//! These stages do no I/O of their own: slices come from the stores that they are handed.

pub mod attributes;
pub mod contract;
pub mod corner;
pub mod creases;
pub mod diagonals;
pub mod extract;
pub mod facets;
pub mod fit;
mod flattest;
pub mod flips;
mod means;
pub mod outward;
mod paraboloid;
pub mod smooth;
pub mod sphere;
pub mod thickness;
pub mod untangle;
pub mod vertex_state;
pub mod vertices;
