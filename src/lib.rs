#![doc = include_str!("../ARCHITECTURE.md")]

pub mod error;
pub mod generate;
pub mod input;
pub mod mesh;
pub mod points;
pub mod schedule;
pub mod spool;

pub use error::{Error, Result};
