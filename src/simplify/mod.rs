//! Fewer triangles, within a tolerance, with every guarantee kept, out of core.
//!
//! An edge is collapsed onto one of its ends, so that every vertex that is left is one of the mesh's, with its attributes, bit for bit. The cheapest collapse
//! comes first: the one whose vertex goes the least far, squared, from the planes of its triangles (Garland & Heckbert 1997; without memory of what was there
//! before, as Lindstrom & Turk 1998). A collapse is made only if
//!
//! * the surface stays a manifold with the same components, tunnels and rims (the link condition: Dey et al. 1999),
//! * no triangle that comes meets another, by exact predicates,
//! * no place of either surface is farther than the tolerance from the other: [`gap`] bounds how far each collapse moves the surface, and [`gap::Drift`]
//!   adds these up,
//! * no triangle gets slimmer than there were.
//!
//! ```text
//!  mesh --> triangles with their corners --> parts of space --> each simplified --> triangles that are left
//!                     ^                      (cut by planes)    (any order, any      |
//!                     |                                          threads)            |
//!                     '------------ twice more, cut elsewhere -----------------------'--> numbered anew
//! ```
//!
//! Parts are boxes. A vertex can go if all triangles at it lie within one part; what comes in their place lies in their convex hull, so within the part,
//! too. Triangles that reach into several parts stay as they are, and each of these parts knows them. So parts have nothing to do with each other, and
//! neither threads nor memory show in the result.

mod boxes;
mod collapse;
mod count;
mod fan;
mod gap;
mod number;
mod part;
mod passes;
mod piece;
mod quadric;
mod queue;
mod soup;
mod space;
#[cfg(test)]
mod tests;

use self::collapse::Limits;
use self::count::Knob;
use self::passes::{Passes, Room, Triangles};
use self::soup::Soup;
use crate::error::Result;
use crate::mesh::spool::MeshSpool;
use crate::mesh::{MeshSource, check_vertex_count};
use crate::points::{Coordinate, Precision};
use crate::resources::workers::Workers;
use crate::storage::spool::Workspace;

/// What is asked of a simplification.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// No place of either surface may be farther than this from the other, in the mesh's units. None: whatever `most` takes.
    pub tolerance: Option<f64>,
    /// No more triangles than this, if that can be: with a tolerance, what costs least goes within it; without, it is the least tolerance that does.
    pub most: Option<u64>,
    /// The attribute of vertices, a whole number up to 65,535, that edges are not collapsed across.
    pub borders: Option<String>,
}

/// A tolerance is kept to with so much to spare: drift is rounded up to single precision between passes.
const LESS: f64 = 1.0 - 1e-6;

/// What came of a simplification.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Figures {
    /// Triangles before.
    pub before: u64,
    /// Triangles that are left.
    pub after: u64,
    /// The tolerance that was asked for, in the mesh's units.
    pub asked: Option<f64>,
    /// No place of either surface is farther than this from the other.
    pub reached: f64,
    /// The most triangles that were asked for.
    pub most: Option<u64>,
}

/// A mesh as far as the memory to simplify it depends on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extent {
    /// Its triangles.
    pub triangles: u64,
    /// Its vertices.
    pub vertices: u64,
    /// Their precision.
    pub precision: Precision,
}

impl Extent {
    /// The extent of a mesh.
    pub fn of(mesh: &dyn MeshSource) -> Extent {
        Extent { triangles: mesh.face_count(), vertices: mesh.vertex_count(), precision: mesh.precision() }
    }

    /// The least memory that simplifying it needs, in bytes.
    pub fn least_memory(self) -> u64 {
        let least = match self.precision {
            Precision::Single => Room::least::<f32>(self.triangles),
            Precision::Double => Room::least::<f64>(self.triangles),
        };
        least + number::bytes(self.vertices)
    }

    /// The memory that simplifying it is going to take of so much, in bytes: never more than that, and [`Extent::least_memory`] at least.
    pub fn memory(self, budget: u64, threads: usize) -> u64 {
        let numbering = number::bytes(self.vertices);
        let budget = budget.max(self.least_memory());
        let used =
            match self.precision {
                Precision::Single => Room::of::<f32>(self.triangles, budget, numbering)
                    .map(|room| room.used::<f32>(self.triangles, threads)),
                Precision::Double => Room::of::<f64>(self.triangles, budget, numbering)
                    .map(|room| room.used::<f64>(self.triangles, threads)),
            };
        used.map_or(budget, |used| (used + numbering).min(budget))
    }

    /// The temporary disk that simplifying it takes, in bytes: triangles with their corners, as they are sorted to parts, and those that are left.
    pub fn disk(self) -> u64 {
        let record = match self.precision {
            Precision::Single => size_of::<soup::Record<f32>>(),
            Precision::Double => size_of::<soup::Record<f64>>(),
        };
        2 * self.triangles * record as u64
    }
}

/// Simplifies a mesh. `progress` is told the part that is done.
///
/// Triangles that name a vertex twice are left out, and vertices that no triangle names. Where the mesh is no manifold, it stays as it is; triangles that
/// intersect may stay, but no more come.
///
/// Memory: `budget`, no less than [`Extent::least_memory`]. Disk: [`Extent::disk`].
///
/// # Errors
/// [`Error::Budget`]; [`Error::Usage`] if the attribute is not there; what reading the mesh or the work directory gives; [`Error::Interrupted`].
pub fn simplify(
    mesh: &dyn MeshSource,
    options: &Options,
    budget: u64,
    workers: &Workers,
    workspace: &Workspace,
    progress: &mut dyn FnMut(f64),
) -> Result<(MeshSpool, Figures)> {
    check_vertex_count(mesh.vertex_count())?;
    match mesh.precision() {
        Precision::Single => simplify_as::<f32>(mesh, options, budget, workers, workspace, progress),
        Precision::Double => simplify_as::<f64>(mesh, options, budget, workers, workspace, progress),
    }
}

fn simplify_as<T: Coordinate>(
    mesh: &dyn MeshSource,
    options: &Options,
    budget: u64,
    workers: &Workers,
    workspace: &Workspace,
    progress: &mut dyn FnMut(f64),
) -> Result<(MeshSpool, Figures)> {
    let classes = options.borders.as_ref().map(|name| class_of(mesh, name)).transpose()?;
    let before = mesh.face_count();
    let numbering = number::bytes(mesh.vertex_count());
    let passes = Passes { workers, workspace, room: Room::of::<T>(before, budget, numbering)? };
    let from = Triangles::Mesh(mesh, classes);
    let told = &mut |part: f64| progress(0.95 * part);
    let within =
        Limits { tolerance: options.tolerance.map_or(f64::INFINITY, |asked| asked * LESS), cost: f64::INFINITY };
    let soup: Soup<T> = match options.most {
        Some(most) if most < before => {
            let scale = passes::scale(mesh)?;
            let search = match options.tolerance {
                None => (Knob::Tolerance, 0.05 * scale.edge, 2.0 * scale.diagonal),
                Some(_) => {
                    let square = scale.edge * scale.edge;
                    (
                        Knob::Cost,
                        1e-4 * square * square,
                        scale.diagonal * scale.diagonal * scale.diagonal * scale.diagonal,
                    )
                }
            };
            count::fewest(&passes, from, within, search, most, told)?
        }
        // All that is wanted is there.
        Some(_) if options.tolerance.is_none() => {
            passes.simplified(&from, Limits { tolerance: 0.0, ..within }, told)?
        }
        _ => passes.simplified(&from, within, told)?,
    };
    let whole = number::numbered(mesh, &soup, &passes)?;
    progress(1.0);
    let Options { tolerance: asked, most, .. } = *options;
    let figures = Figures { before, after: whole.face_count(), asked, reached: soup.reached, most };
    Ok((whole, figures))
}

/// The number of the attribute that tells classes.
fn class_of(mesh: &dyn MeshSource, name: &str) -> Result<usize> {
    let attributes = mesh.schema().attributes();
    let found = attributes.iter().position(|attribute| attribute.name == name);
    found.ok_or_else(|| crate::error::Error::Usage(mesh.schema().lacks(name)))
}
