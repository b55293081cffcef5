//! The surface phase in the work folder: the mesh so far, and the places where stitching can begin again.

use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::grid::context::Context;
use crate::mesh::spool::MeshSpool;
use crate::points::attribute::Schema;
use crate::points::{Coordinate, Precision};
use crate::run::saved_mesh::FILES;
use crate::stitch::checkpoint::Checkpoint;
use crate::stitch::{Stitched, Stitcher};
use crate::storage::work::WorkFolder;
use crate::storage::work::log::{Log, Reached};

/// The phase, as the work folder names it.
const PHASE: &str = "surface";

/// What a line of the log says.
#[derive(Debug, Serialize, Deserialize)]
struct Line {
    checkpoint: Checkpoint,
    /// Whether the mesh is whole.
    whole: bool,
}

/// Where the surface is written to, and where it is told how far it is: vertices, attributes and faces.
#[derive(Debug)]
pub(super) struct SurfaceLog<'a>(Log<'a, 3>);

/// What an earlier run has made of the surface.
#[derive(Debug)]
pub(super) struct MadeBefore {
    /// Its vertices and triangles.
    pub mesh: MeshSpool,
    /// Where to go on.
    pub checkpoint: Checkpoint,
    /// Whether there is nothing left to do.
    pub whole: bool,
}

impl<'a> SurfaceLog<'a> {
    /// Begins the phase, or goes on with it.
    ///
    /// # Errors
    /// Those of [`Log::open`].
    pub fn open(
        work: &'a WorkFolder,
        (precision, schema): (Precision, &Schema),
        context: &Context,
    ) -> Result<(SurfaceLog<'a>, MadeBefore)> {
        let (log, Reached { files, ends, last }) = Log::open::<Line>(work, PHASE, FILES, &context.workers)?;
        let spools = [0, 1, 2].map(|i| context.workspace.spool_in(files[i].clone(), ends[i]));
        let mesh = MeshSpool::in_spools(precision, schema.clone(), spools);
        let whole = last.as_ref().is_some_and(|line| line.whole);
        let checkpoint = last.map_or_else(|| Checkpoint::at(0), |line| line.checkpoint);
        Ok((SurfaceLog(log), MadeBefore { mesh, checkpoint, whole }))
    }

    /// Writes down how far the surface is, if it is time, and stitching can begin again there.
    ///
    /// # Errors
    /// [`crate::Error::Io`], of an earlier line, too.
    pub fn tell<T: Coordinate>(&mut self, stitcher: &mut Stitcher<'_, T>) -> Result<()> {
        if self.0.is_due() { self.tell_now(stitcher) } else { Ok(()) }
    }

    /// The same, whether it is time or not: as the run is being ended.
    ///
    /// # Errors
    /// [`crate::Error::Io`], of an earlier line, too.
    pub fn tell_now<T: Coordinate>(&mut self, stitcher: &mut Stitcher<'_, T>) -> Result<()> {
        let Some(checkpoint) = stitcher.checkpoint() else { return Ok(()) };
        // Whatever ended a write may have left a part of a slab behind.
        if !stitcher.mesh().holds(checkpoint.vertices, checkpoint.faces) {
            return Ok(());
        }
        let extents = stitcher.mesh_mut().extents();
        self.0.append(extents, &Line { checkpoint, whole: false })
    }

    /// Writes down that the mesh is whole, of so many slabs.
    ///
    /// # Errors
    /// [`crate::Error::Io`], of an earlier line, too.
    pub fn end(mut self, stitched: &mut Stitched, slabs: u32) -> Result<()> {
        let extents = stitched.mesh.extents();
        self.0.end(extents, &Line { checkpoint: stitched.checkpoint(slabs), whole: true })
    }
}
