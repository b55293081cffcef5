#![doc = include_str!("../ARCHITECTURE.md")]

pub mod allocator;
pub mod attribute;
pub mod bucket;
pub mod cli;
pub mod closing;
mod colour;
pub mod compare;
pub mod context;
pub mod crs;
pub mod defect;
pub mod densify;
pub mod error;
pub mod forecast;
pub mod generate;
pub mod grid;
pub mod input;
pub mod load;
pub mod looks;
pub mod machine;
pub mod mesh;
pub mod open;
pub mod output;
#[cfg(test)]
mod panics;
pub mod partition;
pub mod pipeline;
pub mod plan;
pub mod points;
pub mod preview;
pub mod progress;
pub mod reconstruction;
pub mod rehearsal;
pub mod render;
pub mod report;
pub mod run;
pub mod scalar;
pub mod schedule;
pub mod seam;
mod seeds;
pub mod sketch;
pub mod slab;
pub mod slice;
pub mod spool;
pub mod stage;
pub mod steady;
pub mod stitch;
pub mod survey;
pub mod tally;
pub mod trim;
pub mod unit;
pub mod whole;
pub mod window;

pub use error::{Error, Result};
pub use input::{PointBuffer, PointSlice, PointSource, Values};
pub use points::Precision;
pub use progress::{Observer, Update};
pub use reconstruction::{Mesh, MeshSink, Reconstruction};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
