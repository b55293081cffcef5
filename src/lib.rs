#![doc = include_str!("../ARCHITECTURE.md")]

pub mod error;
pub mod mesh;
pub mod output;
pub mod points;
pub mod schedule;
pub mod spool;

pub use error::{Error, Result};
