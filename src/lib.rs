//! Turns point clouds into watertight triangle meshes: without normals, in bounded memory, and with the same bytes every time.
//!
//! # Ten lines
//!
//! ```
//! # fn main() -> asra_stream::Result<()> {
//! // Points on a sphere, in no order, without normals.
//! let points: Vec<[f32; 3]> = (0..20_000)
//!     .map(|i| {
//!         let z = (2.0 * i as f32 + 1.0) / 20_000.0 - 1.0;
//!         let (r, angle) = ((1.0 - z * z).sqrt(), 2.399963 * i as f32);
//!         [r * angle.cos(), r * angle.sin(), z]
//!     })
//!     .collect();
//! let mesh = asra_stream::Reconstruction::of(&points).run()?;
//! let (vertices, triangles) = (mesh.vertices()?, mesh.triangles()?);
//! println!("{} vertices, {} triangles", vertices.len(), triangles.len());
//! # Ok(())
//! # }
//! ```
//!
//! # What goes in, what comes out
//!
//! | points | |
//! |---|---|
//! | [`Reconstruction::of`] | a slice of `[f32; 3]` or `[f64; 3]`, and [attributes](Reconstruction::attribute) beside it |
//! | [`Reconstruction::from_source`] | your own [`PointSource`]; a [`PointSpool`] for points that come in pieces |
//! | [`Reconstruction::from_files`] | PLY, LAS, LAZ, E57, PCD, NPY, OBJ, STL, text and raw files, patterns and folders |
//!
//! | mesh | |
//! |---|---|
//! | [`Reconstruction::run`] | a [`Mesh`]: vertices, triangles, attributes, and a [`Report`] |
//! | [`Mesh::save`] | a PLY, STL, OBJ or GLB file |
//! | [`Reconstruction::run_into`] | your own [`MeshSink`], piece by piece |
//!
//! # What you can rely on
//!
//! * **The mesh** is a closed, oriented 2-manifold, normals outwards. With [`Reconstruction::terrain`], [`Reconstruction::ground`] and
//!   [`Reconstruction::sheet`] it is a 2-manifold with a boundary. Every mesh is checked before it is handed over.
//! * **The result** depends on the points and the settings alone, bit for bit: not on memory, threads, temporary storage, or the order of the points.
//! * **Memory** stays below [`Reconstruction::max_memory`]. What does not fit lies in temporary files, which have no names and vanish with the process.
//! * **Errors** are values of [`Error`]; [`Error::kind`] groups them by what a caller can do about them. A panic in a worker is an error, too.
//! * **Progress and cancelling** go through an [`Observer`].
//!
//! # Settings
//!
//! Every setting has the command's default and the name of the command's option, in snake case: `--cell-size` is [`Reconstruction::cell_size`].
//! `--surface terrain` is [`Reconstruction::terrain`], and `--endian big` is [`Reconstruction::big_endian`].
//! The [guide](https://docs.rs/crate/asra-stream/latest/source/docs/guide.md) tells which ones matter for objects, terrain and noisy scans.
//!
//! # Features
//!
//! * `cli` (default): the command, as a library call. Without it, a dependant gets neither clap nor signal handlers.
//! * `allocator` (default): the command's allocator. A library should leave it out.
//! * `render`, `compare`, `generate`: what the command needs for pictures, distances and test clouds.
//! * `object-store`: inputs, folders of tasks and meshes in S3, Google Cloud Storage, Azure and on web servers, by their addresses.
//! * `internals`: the modules below this face, for this project's own tests and benchmarks. They change without notice.
//!
//! Most dependants want `default-features = false`.

// What only some of the features need stands beside what all do.
#![cfg_attr(not(feature = "cli"), allow(dead_code, unused_imports))]
#![cfg_attr(test, allow(clippy::disallowed_methods))]

#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
mod error;
mod format;
mod grid;
mod input;
mod mesh;
mod nearest;
mod points;
#[cfg(feature = "render")]
mod render;
mod resources;
mod run;
mod settings;
mod simplify;
mod solid;
mod stitch;
mod storage;
mod surface;
mod system;

pub use error::{Error, Kind as ErrorKind, Result};
pub use format::write::Positions;
pub use input::{Layout, PointBuffer, PointSlice, PointSource, PointSpool, Values};
pub use mesh::check::CheckReport;
pub use points::Precision;
pub use points::attribute::Attribute;
pub use points::bounds::{Axis, Bounds};
pub use points::crs::Crs;
pub use points::scalar::Scalar;
pub use points::seen_from::SeenFrom;
#[cfg(feature = "allocator")]
#[doc(hidden)]
pub use resources::allocator::give_back_after;
pub use run::observer::{Observer, Update};
pub use run::phase::Phase;
pub use run::reconstruction::{Mesh, MeshSink, Reconstruction};
pub use run::report::Report;
pub use settings::closing::{Least, Sealing};
pub use settings::open::Facing;
pub use settings::simplification::{Simplification, Tolerance};
pub use settings::surface::{Diagonals, Fit};
pub use storage::atomic_file::Overwrite;

/// The modules below the crate's face, for this project's own tests, benchmarks, fuzz targets and Python module. They change without notice.
///
/// A feature, and not only a hidden module: so no dependant reaches them by accident, and the compiler still tells which of their items nothing uses.
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod internals {
    macro_rules! opened {
        ($($(#[$when:meta])? $module:ident),* $(,)?) => {
            $($(#[$when])? pub mod $module {
                pub use crate::$module::*;
            })*
        };
    }
    opened! {
        error, format, grid, input, mesh, points,
        #[cfg(feature = "render")] render, resources, run, settings, simplify, solid, stitch, storage, surface,
    }
}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
