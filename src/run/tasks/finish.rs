//! The end of all tasks: pieces and bridges as one mesh.

use std::sync::Arc;

use super::{Task, Tasks};
use crate::error::{Error, Result};
use crate::grid::context::Context;
use crate::mesh::spool::MeshSpool;
use crate::points::{Coordinate, Precision};
use crate::run::progress::Progress;
use crate::run::surface::{Reconstructed, reconstructed};
use crate::run::surveyed::Surveyed;
use crate::settings::Settings;
use crate::stitch::Stitched;
use crate::stitch::apart::{Link, Of, chain};
use crate::storage::work::WorkFolder;

impl Tasks {
    /// The folder.
    pub(in crate::run) fn folder(&self) -> &Arc<WorkFolder> {
        &self.work
    }

    /// What the plan knows of the cloud, and settings as its points settle them.
    pub(in crate::run) fn surveyed(&self, settings: &Settings) -> (Surveyed, Settings) {
        let surveyed = self.plan.surveyed.clone();
        let settings = Settings { open: surveyed.open, ..*settings };
        (surveyed, settings)
    }

    /// The mesh that tasks have made, and what is to be told of its making.
    ///
    /// # Errors
    /// [`Error::NotReady`]; [`Error::Damaged`]; [`Error::Io`]; [`Error::TooManyElements`] if a mesh file cannot number its vertices.
    pub(in crate::run) fn reconstructed(
        &self,
        settings: &Settings,
        context: &Context,
        progress: &mut Progress,
    ) -> Result<Reconstructed> {
        match self.plan.surveyed.workload.precision {
            Precision::Single => self.reconstructed_as::<f32>(settings, context, progress),
            Precision::Double => self.reconstructed_as::<f64>(settings, context, progress),
        }
    }

    fn reconstructed_as<T: Coordinate>(
        &self,
        settings: &Settings,
        context: &Context,
        progress: &mut Progress,
    ) -> Result<Reconstructed> {
        let pieces = self.pieces()?;
        let Some(chain) = chain(&pieces, &self.bridges(&pieces)?)? else {
            return Err(Error::Internal("a bridge that nobody knew of".into()));
        };
        let mut mesh: Option<MeshSpool> = None;
        for Link { of, within } in chain.links {
            let task = match of {
                Of::Piece(number) => Task::Piece(number),
                Of::Bridge(number) => Task::Bridge(number),
            };
            let part = self.mesh_of::<T>(task, context)?.within(within);
            match &mut mesh {
                Some(mesh) => mesh.join(part),
                None => mesh = Some(part),
            }
        }
        let mesh = mesh.ok_or_else(|| Error::Internal("a mesh of no piece".into()))?;
        let stitched = Stitched { mesh, counts: chain.counts, seams: chain.seams };
        let of = (&self.buckets::<T>(Task::Finish, context)?, self.cells(Task::Finish, context)?);
        let memory = context.memory.clone();
        reconstructed(stitched, &self.plan.surveyed, settings, of, memory, context, progress)
    }

    /// The vertices and triangles of a piece or a bridge, as they were written.
    fn mesh_of<T: Coordinate>(&self, task: Task, context: &Context) -> Result<MeshSpool> {
        let (saved, files) = self.saved_apart(Task::Finish, task)?;
        let [vertices, attributes, faces] = files.as_slice() else {
            return Err(self.work.damaged(&format!("done/{}.json", task.phase()), "a file is missing"));
        };
        let mut spools = Vec::with_capacity(3);
        for (name, extent) in [vertices, attributes, faces].into_iter().zip(saved.extents) {
            let file = self.work.open_file(name)?;
            if !self.work.is_as_written(&file, extent, &context.workers)? {
                return Err(self.work.damaged(name, "its bytes are not what was written"));
            }
            spools.push(context.workspace.spool_in(file, extent.to));
        }
        let spools = spools.try_into().map_err(|_| Error::Internal("three files".into()))?;
        let mesh = MeshSpool::in_spools(T::PRECISION, self.plan.schema.clone(), spools);
        let [vertices, faces] = saved.apart.sizes;
        match mesh.holds(vertices, faces) {
            true => Ok(mesh),
            false => {
                Err(self.work.damaged(&format!("done/{}.json", task.phase()), "it does not tell how long files are"))
            }
        }
    }
}
