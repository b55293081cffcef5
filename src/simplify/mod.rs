//! Fewer triangles, within a tolerance, with every guarantee kept, out of core.
//!
//! An edge is collapsed onto one of its ends, so that every vertex that is left is one of the mesh's, with its attributes, bit for bit, or, if it is asked for, to
//! the best place near it ([`merge`]). The cheapest collapse
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

/// Calls a function of the types of a mesh's records.
macro_rules! typed {
    ($extent:expr, $($path:ident)::+ ($($argument:expr),*)) => {
        match ($extent.precision, $extent.marked) {
            (Precision::Single, false) => $($path)::+::<f32, ()>($($argument),*),
            (Precision::Single, true) => $($path)::+::<f32, Marks>($($argument),*),
            (Precision::Double, false) => $($path)::+::<f64, ()>($($argument),*),
            (Precision::Double, true) => $($path)::+::<f64, Marks>($($argument),*),
        }
    };
}

pub mod apart;
mod blend;
mod boxes;
mod collapse;
mod count;
mod fan;
mod gap;
mod leaving;
mod mark;
mod merge;
mod merging;
mod number;
mod part;
mod passes;
mod patch;
mod piece;
mod quadric;
mod queue;
mod reading;
mod sight;
mod soup;
mod space;
#[cfg(test)]
mod tests;

use std::cell::Cell;

use self::collapse::Limits;
use self::count::Knob;
use self::mark::{Colours, Mark, Marks};
use self::number::Placed;
use self::passes::{Passes, Room, Triangles};
use self::reading::Wanted;
use self::soup::Soup;
use crate::error::Result;
use crate::mesh::spool::MeshSpool;
use crate::mesh::{MeshSource, check_vertex_count};
use crate::points::{Coordinate, Precision};
use crate::resources::workers::Workers;
use crate::storage::spool::{Spool, Workspace};
use crate::storage::work::WorkFolder;

/// What is asked of a simplification.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// No place of either surface may be farther than this from the other, in the mesh's units. None: whatever `most` takes.
    pub tolerance: Option<f64>,
    /// No more triangles than this, if that can be: with a tolerance, what costs least goes within it; without, it is the least tolerance that does.
    pub most: Option<u64>,
    /// The attribute of vertices, a whole number up to 65,535, that edges are not collapsed across.
    pub borders: Option<String>,
    /// No channel of a colour may change by more than so many steps of 255, where vertices have colours. None: by as much as it may.
    pub colours: Option<u8>,
    /// Whether a vertex may be placed anew, with attributes between those of the vertices that it is made of.
    pub moves: bool,
}

/// A tolerance is kept to with so much to spare: drift is rounded up to single precision between passes.
const LESS: f64 = 1.0 - 1e-6;

/// What came of a simplification.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
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
    /// No channel of a colour has changed by more than so many steps of 255; none if it was not asked for.
    pub recoloured: Option<f64>,
    /// Passes over the mesh, those of trials included.
    pub passes: u64,
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
    /// Whether vertices may move, or colours are looked at.
    pub marked: bool,
}

impl Extent {
    /// The extent of a mesh whose vertices may move, or whose colours count, if it has any.
    pub fn of(mesh: &dyn MeshSource, moves: bool, colours: bool) -> Extent {
        let (triangles, vertices, precision) = (mesh.face_count(), mesh.vertex_count(), mesh.precision());
        let marked = moves || colours && Colours::of(mesh).is_some();
        Extent { triangles, vertices, precision, marked }
    }

    /// The least memory that simplifying it needs, in bytes.
    pub fn least_memory(self) -> u64 {
        typed!(self, Room::least(self.triangles)) + typed!(self, number::bytes(self.vertices))
    }

    /// The memory that simplifying it is going to take of so much, in bytes: never more than that, and [`Extent::least_memory`] at least.
    pub fn memory(self, budget: u64, threads: usize) -> u64 {
        let numbering = typed!(self, number::bytes(self.vertices));
        let budget = budget.max(self.least_memory());
        let used = typed!(self, Room::of(self.triangles, budget, numbering))
            .map(|room| typed!(self, Room::used(&room, self.triangles, threads)));
        used.map_or(budget, |used| (used + numbering).min(budget))
    }

    /// The temporary disk that simplifying it takes, in bytes: triangles with their corners, as they are sorted to parts, and those that are left. A mesh whose triangles
    /// name vertices all over, and which memory does not hold, takes up to 180 more for each triangle.
    pub fn disk(self) -> u64 {
        2 * self.triangles * typed!(self, soup::record_bytes())
    }
}

/// What a simplification is given.
#[derive(Clone, Copy)]
pub struct Given<'a> {
    /// The mesh that is simplified.
    pub mesh: &'a dyn MeshSource,
    /// What is asked.
    pub options: &'a Options,
    /// Bytes of memory, no less than [`Extent::least_memory`].
    pub budget: u64,
    /// Who does it.
    pub workers: &'a Workers,
    /// Where temporary files go.
    pub workspace: &'a Workspace,
    /// Where it is kept how far it is, for a run that goes on: the folder, and what the names of its phases begin with.
    pub kept: Option<(&'a WorkFolder, &'a str)>,
}

impl<'a> Given<'a> {
    fn extent(&self) -> Extent {
        Extent::of(self.mesh, self.options.moves, self.options.colours.is_some())
    }

    fn passes<T: Coordinate, M: Mark>(&self) -> Result<Passes<'a>> {
        let (workers, workspace, before) = (self.workers, self.workspace, self.mesh.face_count());
        let numbering = number::bytes::<T, M>(self.mesh.vertex_count());
        let room = Room::of::<T, M>(before, self.budget, numbering)?;
        // Trials of other tolerances are passes like those that count.
        let kept = self.kept.filter(|_| self.options.most.is_none());
        Ok(Passes { workers, workspace, room, kept, made: Cell::new(0) })
    }

    fn colours<M: Mark>(&self) -> Option<Colours> {
        if M::CARRIED { Colours::of(self.mesh) } else { None }
    }

    fn wanted<M: Mark>(&self) -> Result<Wanted> {
        let classes = self.options.borders.as_ref().map(|name| class_of(self.mesh, name)).transpose()?;
        Ok(Wanted { classes, colours: self.colours::<M>() })
    }
}

/// Simplifies a mesh. `progress` is told the part that is done.
///
/// Triangles that name a vertex twice are left out, and vertices that no triangle names. Where the mesh is no manifold, it stays as it is; triangles that
/// intersect may stay, but no more come. What is kept of a simplification within a tolerance is each pass, row of parts by row; of one to a number of triangles, nothing is.
///
/// Memory: the budget. Disk: [`Extent::disk`].
///
/// # Errors
/// [`Error::Budget`]; [`Error::Usage`] if the attribute is not there; what reading the mesh or the work directory gives; [`Error::Damaged`] for what was kept;
/// [`Error::Interrupted`].
pub fn simplify(given: Given<'_>, progress: &mut dyn FnMut(f64)) -> Result<(MeshSpool, Figures)> {
    check_vertex_count(given.mesh.vertex_count())?;
    typed!(given.extent(), simplify_as(given, progress))
}

fn simplify_as<T: Coordinate, M: Mark>(
    given: Given<'_>,
    progress: &mut dyn FnMut(f64),
) -> Result<(MeshSpool, Figures)> {
    let Given { mesh, options, .. } = given;
    let passes = given.passes::<T, M>()?;
    let colours = given.colours::<M>();
    let from = Triangles::Mesh(mesh, given.wanted::<M>()?);
    let told = &mut |part: f64| progress(0.95 * part);
    let within = limits(options, colours);
    let soup: Soup<T, M> = match options.most {
        Some(most) if most < mesh.face_count() => {
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
    let finished = finished(mesh, options, &soup, colours, &passes, None)?;
    progress(1.0);
    Ok(finished)
}

/// What a collapse is kept to.
fn limits(options: &Options, colours: Option<Colours>) -> Limits {
    Limits {
        tolerance: options.tolerance.map_or(f64::INFINITY, |asked| asked * LESS),
        tried: 0.0,
        cost: f64::INFINITY,
        tint: match (options.colours, colours) {
            (Some(steps), Some(colours)) => f64::from(steps) * colours.step * LESS,
            _ => f64::INFINITY,
        },
        colours,
        moves: options.moves,
    }
}

/// The mesh of the triangles that are left, and how many.
fn finished<T: Coordinate, M: Mark>(
    mesh: &dyn MeshSource,
    options: &Options,
    soup: &Soup<T, M>,
    colours: Option<Colours>,
    passes: &Passes,
    out: Option<[Spool; 3]>,
) -> Result<(MeshSpool, Figures)> {
    let placed = if options.moves { Placed::Anew(colours) } else { Placed::AsBefore };
    let whole = number::numbered(mesh, soup, placed, passes, out)?;
    let Options { tolerance: asked, most, .. } = *options;
    let recoloured = options.colours.map(|_| colours.map_or(0.0, |colours| soup.recoloured / colours.step));
    let figures = Figures {
        before: mesh.face_count(),
        after: whole.face_count(),
        asked,
        reached: soup.reached,
        most,
        recoloured,
        passes: passes.made.get(),
    };
    Ok((whole, figures))
}

/// The number of the attribute that tells classes.
fn class_of(mesh: &dyn MeshSource, name: &str) -> Result<usize> {
    let attributes = mesh.schema().attributes();
    let found = attributes.iter().position(|attribute| attribute.name == name);
    found.ok_or_else(|| crate::error::Error::Usage(mesh.schema().lacks(name)))
}
