//! What each task does.

use std::path::PathBuf;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use serde::Deserialize;

use super::renew::{Reads, SavedApart, trace};
use super::{Task, Tasks};
use crate::error::{Error, Result};
use crate::grid::bucket::{Buckets, Compared};
use crate::grid::context::Context;
use crate::input::{Carried, Cloud};
use crate::mesh::spool::MeshSpool;
use crate::points::{Coordinate, Precision};
use crate::resources::workers::Workers;
use crate::run::bare_earth::keep_ground;
use crate::run::closed_cells::{ClosedCells, closed_cells};
use crate::run::files_to_mesh::{OUTPUT, Premade, Source, run_in};
use crate::run::identity;
use crate::run::job::{Job, Resources};
use crate::run::phase::Phase;
use crate::run::pipeline::context;
use crate::run::prepare::open_known;
use crate::run::progress::Progress;
use crate::run::report::Report;
use crate::run::saved_mesh::SavedMesh;
use crate::run::surface::{Slabwise, surface_options, with_slabs};
use crate::settings::Settings;
use crate::stitch::apart;
use crate::stitch::checkpoint::Checkpoint;
use crate::stitch::pieces::Means;
use crate::storage::spool::Workspace;

/// How long a task waits for what it needs: where a folder lies on another machine, its files show after a while.
const PATIENCE: Duration = Duration::from_secs(10);
const LOOK: Duration = Duration::from_millis(500);

impl Tasks {
    /// Does a task, unless it is done; tells the report of the run if it was the last.
    ///
    /// # Errors
    /// [`Error::NotReady`] if what the task needs is not there; [`Error::Damaged`] if that is damaged, and is going to be made again; those of the run.
    pub fn perform(
        &self,
        task: Task,
        resources: &Resources,
        workers: &Workers,
        progress: &mut Progress,
    ) -> Result<Option<Report>> {
        let phase = self.phase(task);
        if self.work.is_done(&phase) {
            return Ok(None);
        }
        self.wait_for_needs(task, workers)?;
        let resources = Resources { work: Some(self.path().to_path_buf()), ..resources.clone() };
        let job = Job { resources, ..self.job.clone() };
        let done = match self.plan.surveyed.workload.precision {
            Precision::Single => self.perform_as::<f32>(task, &job, workers, progress),
            Precision::Double => self.perform_as::<f64>(task, &job, workers, progress),
        };
        if let Err(Error::Damaged { path, .. }) = &done {
            self.work.blame(path)?;
            if task == Task::Finish {
                // The check may have looked at what is damaged.
                let looked = self.shares().flat_map(|number| [Task::Measure(number), Task::Check(number)]);
                let tiled = self.tilings().flat_map(|number| [Task::Sort(number), Task::Tile(number)]);
                let simplified = self.simplifying()?;
                looked.chain(tiled).chain(simplified).try_for_each(|task| self.work.set_aside(&self.phase(task)))?;
            }
        }
        match done {
            Err(Error::Interrupted) => Err(Error::Suspended(self.path().to_path_buf())),
            done => done,
        }
    }

    /// Waits a while for what a task needs.
    fn wait_for_needs(&self, task: Task, workers: &Workers) -> Result<()> {
        let pieces = || (0..self.plan.pieces.len()).map(Task::Piece);
        match task {
            Task::Bucket(number) if number < self.plan.segments.len() => {}
            Task::Close => self.wait_for(task, (0..self.plan.segments.len()).map(Task::Bucket), workers)?,
            Task::Piece(number) if number < self.plan.pieces.len() => self.wait_for(task, [Task::Close], workers)?,
            Task::Bridge(number) if number + 1 < self.plan.pieces.len() => self.wait_for(task, pieces(), workers)?,
            Task::Measure(number) | Task::Check(number) if self.shares().contains(&number) => {
                self.wait_for_whole(task, workers)?;
                if let Task::Check(_) = task {
                    self.wait_for(task, self.shares().map(Task::Measure), workers)?;
                }
            }
            Task::Sort(number) | Task::Tile(number) if self.tilings().contains(&number) => {
                self.wait_for_whole(task, workers)?;
                if let Task::Tile(_) = task {
                    self.wait_for(task, self.tilings().map(Task::Sort), workers)?;
                }
            }
            Task::Planes(pass) | Task::Deal(pass, _) | Task::Simplify(pass, _) if self.passes().contains(&pass) => {
                self.wait_for_mesh(task, workers)?;
                self.wait_for_pass(task, pass, workers)?;
            }
            Task::Number if self.is_simplified() => {
                self.wait_for_mesh(task, workers)?;
                self.wait_for_last_pass(task, workers)?;
            }
            Task::Finish => {
                self.wait_for_whole(task, workers)?;
                self.wait_for(task, self.shares().map(Task::Check), workers)?;
                self.wait_for(task, self.tilings().map(Task::Tile), workers)?;
            }
            task => return Err(self.unknown(task)),
        }
        Ok(())
    }

    pub(super) fn unknown(&self, task: Task) -> Error {
        let folder = self.path().display();
        Error::Usage(format!("{folder}: has no task {task}; `asra-stream tasks {folder}` lists them"))
    }

    fn perform_as<T: Coordinate>(
        &self,
        task: Task,
        job: &Job,
        workers: &Workers,
        progress: &mut Progress,
    ) -> Result<Option<Report>> {
        job.settings.validate()?;
        if task == Task::Finish {
            let alone = Job { resources: Resources { work: None, ..job.resources.clone() }, ..job.clone() };
            let report = match run_in(&alone, Source::Made(self), workers, progress) {
                Err(Error::OutputExists(path)) => return self.finished_by_another(path, workers).map(|()| None),
                finished => finished?,
            };
            let rest = serde_json::to_value(&report).expect("a manifest can be written");
            self.work.commit(&self.phase(task), Vec::new(), rest)?;
            return Ok(Some(report));
        }
        let workspace = job.resources.workspace(self.path())?.stopped_with(workers);
        let segment = if let Task::Bucket(number) = task { Some(&self.plan.segments[number].segment) } else { None };
        let mut cloud =
            self.opened(|file| segment.is_some_and(|of| of.reads(file)), job, &workspace, workers, progress)?;
        if task == Task::Close && !cloud.places().places.is_empty() {
            // Lines of sight go to the points themselves.
            cloud = self.opened(|_| true, job, &workspace, workers, progress)?;
        }
        let job = &job.measured_as(&cloud)?;
        keep_ground(&mut cloud, &job.settings)?;
        let (surveyed, settings) = self.surveyed(&job.settings);
        let memory = context(&surveyed, workers, &workspace, job.resources.budget())?;
        let context = &Context { work: Some(Arc::clone(&self.work)), ..memory };
        match task {
            Task::Bucket(number) => self.sort::<T>(number, &cloud, context, progress)?,
            Task::Close => self.close::<T>(&cloud, &settings, context, progress)?,
            Task::Piece(_) | Task::Bridge(_) => self.stitch::<T>(task, &settings, context, progress)?,
            Task::Planes(_) | Task::Deal(..) | Task::Simplify(..) | Task::Number => {
                self.simplify::<T>(task, context, progress)?
            }
            Task::Measure(_) | Task::Check(_) => self.look::<T>(task, context, progress)?,
            Task::Sort(_) | Task::Tile(_) => self.tile::<T>(task, (&cloud, job, &settings), context, progress)?,
            Task::Finish => {}
        }
        Ok(None)
    }

    /// The cloud of all files, of which those that are read are opened, and are what they were when tasks were planned. Nothing is read more than once, so nothing is
    /// decompressed for later; and blocks are those that segments were made of.
    pub(super) fn opened(
        &self,
        is_read: impl Fn(usize) -> bool,
        job: &Job,
        workspace: &Workspace,
        workers: &Workers,
        progress: &mut Progress,
    ) -> Result<Cloud<'static>> {
        let files = self.files.iter().zip(&self.plan.states).enumerate();
        identity::compare(&self.work, files.filter(|(number, _)| is_read(*number)).map(|(_, file)| file))?;
        open_known(job, (&self.files, &self.plan.headers), is_read, (workspace, workers), progress)
    }

    /// Waits whether the output that is there is another process's that has done the same task meanwhile.
    fn finished_by_another(&self, path: PathBuf, workers: &Workers) -> Result<()> {
        match self.wait_for(Task::Finish, [Task::Finish], workers) {
            Err(Error::NotReady { .. }) => {
                // It is somebody else's: nobody is to take it for this job's own.
                self.work.set_aside(OUTPUT)?;
                Err(Error::OutputExists(path))
            }
            waited => waited,
        }
    }

    /// Waits a while for all pieces and bridges.
    fn wait_for_mesh(&self, task: Task, workers: &Workers) -> Result<()> {
        self.wait_for(task, (0..self.plan.pieces.len()).map(Task::Piece), workers)?;
        let bridges = apart::bridges(&self.pieces(task)?);
        self.wait_for(task, bridges.into_iter().map(Task::Bridge), workers)
    }

    /// Waits a while for the mesh that is checked and written.
    fn wait_for_whole(&self, task: Task, workers: &Workers) -> Result<()> {
        self.wait_for_mesh(task, workers)?;
        let number = self.is_simplified().then_some(Task::Number);
        self.wait_for(task, number, workers)
    }

    /// Waits a while for tasks to be done.
    pub(super) fn wait_for(&self, task: Task, needed: impl IntoIterator<Item = Task>, workers: &Workers) -> Result<()> {
        let start = Instant::now();
        for needed in needed {
            while !self.work.is_done(&self.phase(needed)) {
                if start.elapsed() > PATIENCE {
                    let (task, needed) = (task.to_string(), needed.to_string());
                    return Err(Error::NotReady { path: self.path().to_path_buf(), task, needed });
                }
                workers.check_cancelled()?;
                thread::sleep(LOOK);
            }
        }
        Ok(())
    }

    fn sort<T: Coordinate>(
        &self,
        number: usize,
        cloud: &Cloud,
        context: &Context,
        progress: &mut Progress,
    ) -> Result<()> {
        progress.begin(Phase::Bucket, None);
        let phase = self.phase(Task::Bucket(number));
        let input = (cloud, Some(&self.plan.segments[number].segment), Carried::Attributes);
        let surveyed = &self.plan.surveyed;
        // They are no file's.
        let added = surveyed.added().filter(|_| number == 0);
        let buckets =
            Buckets::<T>::fill_with(input, added, (&surveyed.grid, context), &phase, |records| progress.add(records))?;
        progress.end();
        buckets.commit(&self.work, &phase)
    }

    fn close<T: Coordinate>(
        &self,
        cloud: &Cloud,
        settings: &Settings,
        context: &Context,
        progress: &mut Progress,
    ) -> Result<()> {
        let buckets = self.buckets::<T>(Task::Close, context)?;
        let (expected, found) = (self.plan.surveyed.survey.points, buckets.point_count());
        if expected != found {
            let path = self.path().to_path_buf();
            let (expected, found) = (format!("the {expected} points of the plan"), found.to_string());
            return Err(Error::Changed { path, expected, found });
        }
        let cells = closed_cells(cloud, &self.plan.surveyed, settings, &buckets, context, progress)?;
        progress.end();
        cells.weighed(context)?.commit(&self.work, &self.phase(Task::Close))
    }

    fn stitch<T: Coordinate>(
        &self,
        task: Task,
        settings: &Settings,
        context: &Context,
        progress: &mut Progress,
    ) -> Result<()> {
        let pieces = if let Task::Bridge(_) = task { self.pieces(task)? } else { Vec::new() };
        let mut buckets = self.buckets::<T>(task, context)?;
        let mut cells = self.cells(task, context)?;
        let whole = self.whole(settings, &cells);
        if let Some((manifest, saved)) = self.earlier(task)?
            && saved.reads.are_same(whole, (&buckets, &cells), &pieces)?
        {
            progress.note(&format!("{task}: stays as it was, since nothing that it was made of has changed"));
            return self.work.adopt(&self.phase(task), &manifest);
        }
        let within = match task {
            Task::Piece(number) => self.plan.pieces[number].clone(),
            // It hardly ever reaches farther.
            Task::Bridge(from) => self.plan.pieces[from + 1].clone(),
            _ => 0..self.plan.slabs,
        };
        let phase = self.phase(task);
        let named = SavedMesh::files(&self.work, &phase)?;
        let surveyed = &self.plan.surveyed;
        let fit = surface_options(settings, &cells).fit;
        let workload = cells.counted_workload(&surveyed.workload, fit, &buckets, context)?;
        trace(&mut buckets, &mut cells);
        let of = (&buckets, &cells);
        let counted = (&workload, &context.memory.with_surface(&workload, None)?);
        let (mut mesh, apart) =
            with_slabs((Some(within.clone()), counted), surveyed, settings, of, context, progress, |slabwise| {
                let Slabwise { slabs, begun, means, .. } = slabwise;
                let stitcher = |_: usize, from: &Checkpoint| {
                    let spools = named.clone().map(|file| context.workspace.spool_in(file, 0));
                    begun(MeshSpool::in_spools(T::PRECISION, self.plan.schema.clone(), spools), from)
                };
                let means = Means { stitcher: &stitcher, ..means };
                match task {
                    Task::Bridge(from) => apart::bridge(from, &pieces, slabs, &means),
                    _ => apart::piece(within, slabs, &means),
                }
            })?;
        let joined =
            if let Task::Bridge(from) = task { Some((from, apart.to.unwrap_or(pieces.len() - 1))) } else { None };
        let reads = Reads::since(whole, of, joined, &pieces)?;
        let saved = SavedApart { apart, extents: mesh.extents(), reads };
        let rest = serde_json::to_value(saved).expect("a manifest can be written");
        self.work.commit(&phase, named.into(), rest)
    }

    /// The points, sorted by other tasks.
    pub(super) fn buckets<T: Coordinate>(&self, task: Task, context: &Context) -> Result<Buckets<T>> {
        let phases = (0..self.plan.segments.len()).map(|number| self.phase(Task::Bucket(number)));
        let grid = &self.plan.surveyed.grid;
        let buckets = Buckets::committed(&self.work, phases, grid, Compared::AsRead, context)?;
        buckets.ok_or_else(|| self.missing(task, Task::Bucket(0)))
    }

    /// The cells, closed by another task.
    pub(super) fn cells(&self, task: Task, context: &Context) -> Result<ClosedCells> {
        ClosedCells::committed(&self.work, &self.phase(Task::Close), context)?
            .ok_or_else(|| self.missing(task, Task::Close))
    }

    /// What is saved of a piece or a bridge, which a task needs, and the names of its files.
    pub(super) fn saved_apart(&self, task: Task, needed: Task) -> Result<(SavedApart, Vec<String>)> {
        let phase = self.phase(needed);
        let saved = self.work.load(&phase, |manifest| {
            let damaged = |_| self.work.damaged(&format!("done/{phase}.json"), "it cannot be read");
            Ok((SavedApart::deserialize(&manifest.rest).map_err(damaged)?, manifest.files.clone()))
        })?;
        saved.ok_or_else(|| self.missing(task, needed))
    }

    pub(super) fn missing(&self, task: Task, needed: Task) -> Error {
        Error::NotReady { path: self.path().to_path_buf(), task: task.to_string(), needed: needed.to_string() }
    }
}
