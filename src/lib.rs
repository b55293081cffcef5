#![doc = include_str!("../ARCHITECTURE.md")]

pub mod cli;
pub mod compare;
pub mod error;
pub mod format;
pub mod generate;
pub mod grid;
pub mod input;
pub mod mesh;
pub mod points;
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
pub use input::{PointBuffer, PointSlice, PointSource, Values};
pub use points::Precision;
pub use run::progress::{Observer, Update};
pub use run::reconstruction::{Mesh, MeshSink, Reconstruction};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
