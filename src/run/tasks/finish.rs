//! The end of all tasks: pieces and bridges as one mesh.

use std::path::PathBuf;
use std::sync::Arc;

use serde::de::DeserializeOwned;
use serde_json::Value;

use super::renew::SavedApart;
use super::{Task, Tasks, of_generation};
use crate::error::{Error, Result};
use crate::grid::bucket::Compared;
use crate::grid::context::Context;
use crate::input::Cloud;
use crate::mesh::check::CheckReport;
use crate::mesh::check::shares::{self, Looked, Measured, Share};
use crate::mesh::spool::MeshSpool;
use crate::points::{Coordinate, Precision};
use crate::resources::workers::Workers;
use crate::run::files_to_mesh::Premade;
use crate::run::job::Job;
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::run::saved_mesh::SavedMesh;
use crate::run::surface::{Reconstructed, reconstructed};
use crate::run::surveyed::Surveyed;
use crate::settings::Settings;
use crate::simplify::Figures;
use crate::stitch::Stitched;
use crate::stitch::apart::{Link, Of, chain};
use crate::storage::spool::{Spool, Workspace};
use crate::storage::work::WorkFolder;
use crate::storage::work::store::NamedFile;

impl Premade for Tasks {
    fn folder(&self) -> &Arc<WorkFolder> {
        &self.work
    }

    fn ending(&self) -> String {
        of_generation("", self.plan.generation)
    }

    fn files(&self) -> &[PathBuf] {
        &self.files
    }

    fn cloud(
        &self,
        job: &Job,
        workspace: &Workspace,
        workers: &Workers,
        progress: &mut Progress,
    ) -> Result<Cloud<'static>> {
        self.opened(|_| false, job, workspace, workers, progress)
    }

    fn surveyed(&self, settings: &Settings) -> (Surveyed, Settings) {
        let surveyed = self.plan.surveyed.clone();
        let settings = surveyed.settled(settings);
        (surveyed, settings)
    }

    fn reconstructed(&self, settings: &Settings, context: &Context, progress: &mut Progress) -> Result<Reconstructed> {
        let (task, compared) = (Task::Finish, Compared::Now);
        match self.plan.surveyed.workload.precision {
            Precision::Single => self.reconstructed_as::<f32>(task, settings, compared, context, progress),
            Precision::Double => self.reconstructed_as::<f64>(task, settings, compared, context, progress),
        }
    }

    fn simplified(&self, context: &Context) -> Result<Option<(MeshSpool, Figures)>> {
        if !self.is_simplified() {
            return Ok(None);
        }
        match self.plan.surveyed.workload.precision {
            Precision::Single => self.numbered::<f32>(Task::Finish, Compared::Now, context),
            Precision::Double => self.numbered::<f64>(Task::Finish, Compared::Now, context),
        }
        .map(Some)
    }

    fn tiles(&self, context: &Context) -> Result<Option<Vec<[Spool; 2]>>> {
        self.written_tiles(Task::Finish, context)
    }

    fn damaged_tiles(&self, run: usize) -> Error {
        self.damaged_run(run)
    }

    fn checked(
        &self,
        mesh: &MeshSpool,
        budget: u64,
        workers: &Workers,
        workspace: &Workspace,
    ) -> Result<Option<CheckReport>> {
        if self.shares().is_empty() {
            return Ok(None);
        }
        let measured = self.measured(Task::Finish)?;
        let looked = self.shares().map(|number| {
            let needed = Task::Check(number);
            let looked: Looked = self.shown(Task::Finish, needed)?;
            let file = |kind: usize| self.spool_of((needed, kind), &[looked.pairs[kind]], (workers, workspace));
            let files = [file(0)?, file(1)?];
            Ok((looked, files))
        });
        shares::conclude(mesh, &measured, looked, means(workers, workspace, budget)).map(Some)
    }
}

impl Tasks {
    /// The mesh before it is simplified, and how it came to be.
    pub(super) fn reconstructed_as<T: Coordinate>(
        &self,
        task: Task,
        settings: &Settings,
        compared: Compared,
        context: &Context,
        progress: &mut Progress,
    ) -> Result<Reconstructed> {
        let stitched = self.stitched::<T>(task, compared, context)?;
        let of = (&self.buckets::<T>(task, context)?, self.cells(task, context)?);
        let memory = context.memory.clone();
        reconstructed(stitched, &self.plan.surveyed, settings, of, memory, context, progress)
    }

    /// What all pieces and bridges come to.
    pub(super) fn stitched<T: Coordinate>(
        &self,
        task: Task,
        compared: Compared,
        context: &Context,
    ) -> Result<Stitched> {
        let pieces = self.pieces(task)?;
        let Some(chain) = chain(&pieces, &self.bridges(task, &pieces)?)? else {
            return Err(Error::Internal("a bridge that nobody knew of".into()));
        };
        let mut mesh: Option<MeshSpool> = None;
        for Link { of, within } in chain.links {
            let needed = match of {
                Of::Piece(number) => Task::Piece(number),
                Of::Bridge(number) => Task::Bridge(number),
            };
            let part = self.mesh_of::<T>((task, needed), compared, context)?.within(within);
            match &mut mesh {
                Some(mesh) => mesh.join(part),
                None => mesh = Some(part),
            }
        }
        let mesh = mesh.ok_or_else(|| Error::Internal("a mesh of no piece".into()))?;
        Ok(Stitched { mesh, counts: chain.counts, seams: chain.seams })
    }

    /// The mesh that is checked and written.
    pub(super) fn mesh<T: Coordinate>(&self, task: Task, compared: Compared, context: &Context) -> Result<MeshSpool> {
        match self.is_simplified() {
            true => Ok(self.numbered::<T>(task, compared, context)?.0),
            false => Ok(self.stitched::<T>(task, compared, context)?.mesh),
        }
    }

    /// Does a task of the check.
    pub(super) fn look<T: Coordinate>(&self, task: Task, context: &Context, progress: &mut Progress) -> Result<()> {
        // Whoever finishes compares all of the mesh with its checksums, and has what was found in a damaged one looked for again.
        let mesh = self.mesh::<T>(task, Compared::AsRead, context)?;
        progress.begin(Phase::Check, None);
        let phase = self.phase(task);
        let named = match task {
            Task::Check(_) => ["joins", "boundary"]
                .map(|what| self.work.create(&format!("{what}-{phase}")))
                .into_iter()
                .collect::<Result<_>>()?,
            _ => Vec::new(),
        };
        let rest = match self.looked(task, (&mesh, &named), context, progress) {
            Err(error @ Error::CheckFailed(_)) => {
                self.mesh::<T>(task, Compared::Now, context)?;
                return Err(error);
            }
            looked => looked?,
        };
        progress.end();
        self.work.commit(&phase, named, rest)
    }

    fn looked(
        &self,
        task: Task,
        (mesh, named): (&MeshSpool, &[NamedFile]),
        context: &Context,
        progress: &mut Progress,
    ) -> Result<Value> {
        let means = means(&context.workers, &context.workspace, context.memory.working);
        let of = self.shares().len();
        let told = &mut |done| progress.set(done);
        let looked = match task {
            Task::Measure(number) => serde_json::to_value(shares::measure(mesh, Share { number, of }, means, told)?),
            Task::Check(number) => {
                let measured = self.measured(task)?;
                let [joins, boundary] = named else { return Err(Error::Internal("two files of pairs".into())) };
                let mut out = [joins, boundary].map(|file| context.workspace.spool_in(file.clone(), 0));
                serde_json::to_value(shares::look(mesh, Share { number, of }, &measured, means, &mut out, told)?)
            }
            task => return Err(Error::Internal(format!("{task} is no task of the check"))),
        };
        looked.map_err(|words| Error::Internal(words.to_string()))
    }

    fn measured(&self, task: Task) -> Result<Vec<Measured>> {
        self.shares().map(|number| self.shown(task, Task::Measure(number))).collect()
    }

    /// What a task of the check has shown.
    pub(super) fn shown<R: DeserializeOwned>(&self, task: Task, needed: Task) -> Result<R> {
        let phase = self.phase(needed);
        let shown = self.work.load(&phase, |manifest| {
            let damaged = |_| self.work.damaged(&format!("done/{phase}.json"), "it cannot be read");
            serde_json::from_value(manifest.rest.clone()).map_err(damaged)
        })?;
        shown.ok_or_else(|| self.missing(task, needed))
    }

    /// The vertices and triangles of a piece or a bridge, as they were written.
    fn mesh_of<T: Coordinate>(
        &self,
        (task, needed): (Task, Task),
        compared: Compared,
        context: &Context,
    ) -> Result<MeshSpool> {
        let SavedApart { apart, extents, .. } = self.saved_apart(task, needed)?.0;
        self.mesh_in_files::<T>(needed, SavedMesh { sizes: apart.sizes, extents }, compared, context)
    }

    /// A mesh whose three files a task has written.
    pub(super) fn mesh_in_files<T: Coordinate>(
        &self,
        of: Task,
        saved: SavedMesh,
        compared: Compared,
        context: &Context,
    ) -> Result<MeshSpool> {
        let phase = self.phase(of);
        let manifest = self.work.manifest(&phase)?.ok_or_else(|| self.missing(Task::Finish, of))?;
        let form = (T::PRECISION, &self.plan.schema);
        saved.open((&self.work, &phase, &manifest), form, compared, (&context.workers, &context.workspace))
    }
}

fn means<'a>(workers: &'a Workers, workspace: &'a Workspace, budget: u64) -> shares::Means<'a> {
    shares::Means { budget, workers, workspace }
}
