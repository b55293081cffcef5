//! Triangle meshes larger than memory: where they lie, how they are checked.
//!
//! A mesh is a sequence of vertices and a sequence of triangles of vertex numbers; nothing here knows of slices.

pub mod check;
pub mod copy;
pub mod corners;
pub mod intersect;
pub(crate) mod intersections;
pub mod measure;
pub mod spool;

use crate::error::{Error, Result};
use crate::points::Precision;
use crate::points::attribute::Schema;
use crate::points::crs::Crs;

/// A triangle mesh that can be read piece by piece, in any order, from several threads.
pub trait MeshSource: Sync {
    /// Number of vertices.
    fn vertex_count(&self) -> u64;
    /// Number of triangles.
    fn face_count(&self) -> u64;
    /// Added to a vertex, component by component in `f64`, gives the coordinates it stands for: [`MeshHeader::origin`].
    fn origin(&self) -> [f64; 3];
    /// The narrowest precision that keeps its vertices.
    fn precision(&self) -> Precision;
    /// Fills `out` with vertices `first ..`, in the mesh's own coordinates.
    ///
    /// # Errors
    /// [`crate::Error::Io`], or [`crate::Error::Malformed`] where the file's content is at fault.
    fn read_vertices(&self, first: u64, out: &mut [[f64; 3]]) -> Result<()>;
    /// Fills `out` with triangles `first ..`; every number is less than [`MeshSource::vertex_count`].
    ///
    /// # Errors
    /// The same as [`MeshSource::read_vertices`]; a vertex number out of range is [`crate::Error::Malformed`].
    fn read_faces(&self, first: u64, out: &mut [[u32; 3]]) -> Result<()>;
    /// The attributes of vertices that can be read.
    fn schema(&self) -> &Schema;
    /// Fills `out` with what vertices `first ..` have of the attribute that is the schema's `number`-th, from 0.
    ///
    /// # Errors
    /// The same as [`MeshSource::read_vertices`].
    fn read_attribute(&self, number: usize, first: u64, out: &mut [f64]) -> Result<()>;
}

/// What travels with a mesh besides its elements.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MeshHeader {
    /// Added to a vertex, component by component in `f64`, gives the input's coordinates. Zero where none was taken off.
    pub origin: [f64; 3],
    /// Lines about the mesh's making, for formats that have comments.
    pub comments: Vec<String>,
    /// The input's coordinate reference system, if it tells it.
    pub crs: Option<Crs>,
    /// Whether the surface is open, so that it is seen from both sides.
    pub sheet: bool,
    /// Attributes that are not written since all vertices have one value, which the comments tell.
    pub constant: Vec<String>,
}

/// The origin that a line of text tells, as in `origin 512000 5403000 300`: the program's own meshes say so in comments.
pub(crate) fn told_origin(line: &str) -> Option<[f64; 3]> {
    let numbers = line.trim().strip_prefix("origin ")?;
    let numbers: Vec<f64> = numbers.split_ascii_whitespace().map_while(|word| word.parse().ok()).collect();
    <[f64; 3]>::try_from(numbers).ok().filter(|origin| origin.iter().all(|c| c.is_finite()))
}

/// Refuses more vertices than 32 bits can number.
pub(crate) fn check_vertex_count(count: u64) -> Result<()> {
    let limit = u64::from(u32::MAX);
    if count > limit {
        return Err(Error::TooManyElements { count, what: "vertices", limit, carrier: "a mesh" });
    }
    Ok(())
}
