//! A run, from points to a mesh and a report.
//!
//! ```text
//!  job ─► prepare: find, open, survey, rehearse, plan ─► pipeline ─► check, write ─► report
//!         └ looks: what `info` and `plan` tell            └───── files_to_mesh ─────┘
//! ```
//!
//! [`files_to_mesh`] has a file in the end, [`reconstruction`] a mesh in memory.

mod advice;
pub mod bare_earth;
pub mod bridging;
pub mod closed_cells;
#[cfg(feature = "compare")]
pub mod compare;
mod counted;
mod estimate;
mod expected;
mod files_to_mesh;
mod fineness;
mod finished;
pub mod forecast;
#[cfg(feature = "generate")]
pub mod generate;
#[cfg(feature = "render")]
mod html;
mod identity;
pub mod job;
mod judgement;
pub mod looks;
mod mesh_header;
pub mod observer;
pub mod phase;
pub mod pipeline;
mod place;
pub mod planner;
mod prepare;
#[cfg(feature = "render")]
pub mod preview;
pub mod progress;
pub mod pyramid;
mod rasters;
pub mod reconstruction;
pub mod report;
pub mod saved_mesh;
pub mod simplification;
mod slab_jobs;
mod summary;
pub mod surface;
mod surface_log;
pub mod surveyed;
pub mod tasks;
#[cfg(any(test, feature = "internals"))]
#[doc(hidden)]
pub mod testing;
mod upsampled;
pub mod workload;

pub use self::files_to_mesh::run;
pub use self::job::{Check, Job, Resources, Units, default_output_of};
pub use self::prepare::{look, plan};
pub use self::pyramid::tileset_file;
pub use self::simplification::simplify_file;
