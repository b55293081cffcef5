#![doc = include_str!("../ARCHITECTURE.md")]

pub mod bucket;
pub mod error;
pub mod generate;
pub mod grid;
pub mod input;
pub mod mesh;
pub mod pipeline;
pub mod plan;
pub mod points;
pub mod progress;
pub mod schedule;
pub mod slab;
pub mod slice;
pub mod spool;
pub mod stage;
pub mod stitch;
pub mod survey;
pub mod window;

pub use error::{Error, Result};
