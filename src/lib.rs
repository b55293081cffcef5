#![doc = include_str!("../ARCHITECTURE.md")]
// What only some of the features need stands beside what all do.
#![cfg_attr(not(feature = "cli"), allow(dead_code, unused_imports))]
#![cfg_attr(test, allow(clippy::disallowed_methods))]

#[cfg(feature = "cli")]
pub mod cli;
#[cfg(feature = "compare")]
pub mod compare;
pub mod error;
pub mod format;
#[cfg(feature = "generate")]
pub mod generate;
pub mod grid;
pub mod input;
pub mod mesh;
pub mod points;
#[cfg(feature = "render")]
pub mod render;
pub mod resources;
pub mod run;
pub mod settings;
pub mod sign;
pub mod solid;
pub mod stitch;
pub mod storage;
pub mod surface;

pub use error::{Error, Result};
pub use format::write::Positions;
pub use input::{PointBuffer, PointSlice, PointSource, PointSpool, Values};
pub use points::Precision;
pub use points::attribute::Attribute;
pub use points::scalar::Scalar;
pub use run::progress::{Observer, Update};
pub use run::reconstruction::{Mesh, MeshSink, Reconstruction};
pub use storage::atomic_file::Overwrite;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
