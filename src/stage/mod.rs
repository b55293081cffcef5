//! The stages a slice goes through, in order: raster, dilate, exterior, solid (with seal, which tries radii), sides (with walls), hollow, lone, component,
//! extract, smooth, fit or plane, attributes, contract, retreat (with near, spot and fan, which find what may intersect).
//!
//! Stages do no I/O of their own: slices come from and go to the stores they are handed.

pub mod attributes;
pub mod component;
pub mod contract;
pub mod corner;
pub mod dilate;
pub mod exterior;
pub mod extract;
pub mod fan;
pub mod fate;
pub mod fit;
pub mod ground;
pub mod hollow;
pub mod label;
pub mod lone;
pub mod near;
pub mod plane;
pub mod ranked;
pub mod raster;
pub mod retreat;
pub mod seal;
pub mod sides;
pub mod sign;
pub mod smooth;
pub mod solid;
pub mod spot;
pub mod unresolved;
pub mod walls;
