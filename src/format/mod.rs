//! File formats: what each one says of points and of meshes, and how it is written.
//!
//! A folder is a format: its points are read by `mod.rs`, its meshes by `mesh.rs`, and `write.rs` writes its meshes. [`mod@read`] and [`mod@write`] are the doors to
//! meshes; the door to points is [`crate::input`].

pub(crate) mod columns;
pub(crate) mod detect_layout;
pub(crate) mod e57;
pub mod geotiff;
pub mod glb;
pub(crate) mod las;
pub(crate) mod layout;
pub(crate) mod laz;
pub(crate) mod lines;
pub(crate) mod lzf;
pub(crate) mod npy;
pub(crate) mod obj;
pub(crate) mod options;
pub(crate) mod pcd;
pub(crate) mod ply;
pub(crate) mod point_format;
pub(crate) mod raw;
pub mod read;
pub(crate) mod records;
pub(crate) mod rows;
pub(crate) mod sidecar;
pub(crate) mod statements;
pub(crate) mod stl;
#[cfg(test)]
pub(crate) mod testing;
pub(crate) mod text;
pub mod tiles3d;
pub(crate) mod unpack;
pub mod write;
