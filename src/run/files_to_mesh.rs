//! The whole run: files in, mesh file out. What the command does, as a call.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use crate::error::words::thousands;
use crate::error::{Error, Result};
use crate::format::tiles3d::is_named;
use crate::format::write::tiling::{Division, Tiling};
use crate::format::write::{Positions, Written};
use crate::grid::bucket;
use crate::grid::context::Context;
use crate::input::{Cloud, STANDARD_INPUT};
use crate::mesh::MeshSource;
use crate::mesh::check::{CheckReport, check_near};
use crate::mesh::spool::MeshSpool;
#[cfg(feature = "render")]
use crate::render;
use crate::resources::workers::Workers;
use crate::run::bare_earth::{Beside, bare_earth, budget_beside, of_whole_budget};
use crate::run::finished::{Finished, refuse_unsound, report};
#[cfg(feature = "render")]
use crate::run::html::PlannedPage;
use crate::run::identity;
use crate::run::job::{Check, Job};
use crate::run::mesh_header::header_of;
use crate::run::phase::Phase;
use crate::run::pipeline::{context, reconstruct};
use crate::run::place::{Place, output_of, refuse_input_as_output, territories};
use crate::run::prepare::{Passes, describe, expected_tiles, files, known, open, planned, surveyed};
#[cfg(feature = "render")]
use crate::run::preview::{self, DrawnPreview, PlannedPreview};
use crate::run::progress::Progress;
use crate::run::pyramid::TilesetTarget;
use crate::run::report::{OutputReport, Report};
use crate::run::saved_mesh::{KeptSteps, Means};
use crate::run::simplification::{Lengths, simplified};
use crate::run::surface::Reconstructed;
use crate::run::surveyed::Surveyed;
use crate::settings::Settings;
use crate::simplify::Figures;
#[cfg(feature = "render")]
use crate::storage::atomic_file::AtomicFile;
use crate::storage::atomic_file::Overwrite;
use crate::storage::remote::is_remote;
use crate::storage::spool::{Spool, Workspace};
use crate::storage::work::WorkFolder;

/// Seconds from which on a run is told that it need not begin anew.
const LONG: f64 = 600.0;

/// The phase in which outputs get their names, as the work folder names it.
pub(super) const OUTPUT: &str = "output";

/// Whether this run may have named this output before it was ended.
fn has_output_of(work: &WorkFolder, output: &Path) -> bool {
    let manifest = work.manifest(OUTPUT).ok().flatten();
    // Tasks name it from the root.
    let named = [Some(output.to_path_buf()), std::path::absolute(output).ok()];
    manifest.is_some_and(|manifest| named.iter().flatten().any(|named| manifest.rest == named.display().to_string()))
}

/// Reconstructs: reads the input, makes the mesh, checks it, writes it.
///
/// # Errors
/// All of [`Error`]. Whatever happens, no temporary file stays, and the output exists only if it is whole.
pub fn run(job: &Job, workers: &Workers, progress: &mut Progress) -> Result<Report> {
    let Some(folder) = &job.resources.work else { return run_in(job, Source::Points(None), workers, progress) };
    refuse_remote_work(folder)?;
    let work = Arc::new(WorkFolder::open(folder)?);
    match run_in(job, Source::Points(Some(&work)), workers, progress) {
        Ok(report) => work.finish(OUTPUT).map(|()| report),
        Err(error) => {
            // What is whole stays, whatever ended the run.
            let left = work.leave(matches!(error, Error::Interrupted), OUTPUT);
            Err(match (error, left) {
                (error @ Error::OutputExists(_), Ok(true) | Err(_)) => {
                    // It is somebody else's: the run that goes on must not take it for its own.
                    work.set_aside(OUTPUT)?;
                    error
                }
                (Error::Interrupted, Ok(true)) => Error::Suspended(folder.clone()),
                (error, _) => error,
            })
        }
    }
}

/// A run by itself says line by line how far it is, and cuts what is half done: objects are there whole, and are not changed.
fn refuse_remote_work(folder: &Path) -> Result<()> {
    match is_remote(folder) {
        false => Ok(()),
        true => Err(Error::setting(
            "work",
            format!(
                "`work` {}: a run by itself adds to its files as it goes on, which objects do not allow; choose a folder of this machine, or do the run as tasks, with `asra-stream plan` and `asra-stream work`",
                folder.display()
            ),
        )),
    }
}

/// What a run makes its mesh of.
pub(super) enum Source<'a> {
    /// The points; phases stay in a folder, if there is one.
    Points(Option<&'a Arc<WorkFolder>>),
    /// What was made of them before.
    Made(&'a dyn Premade),
}

/// A mesh that others have made of a job's points, and that is to be finished.
pub(super) trait Premade {
    /// The folder in which it is said what gets its name.
    fn folder(&self) -> &Arc<WorkFolder>;

    /// What the names of phases end with that come of them.
    fn ending(&self) -> String;

    /// The files of the points.
    fn files(&self) -> &[PathBuf];

    /// Their cloud, of which nothing need be read.
    ///
    /// # Errors
    /// Whatever is in the way of reading what is known of it.
    fn cloud(
        &self,
        job: &Job,
        workspace: &Workspace,
        workers: &Workers,
        progress: &mut Progress,
    ) -> Result<Cloud<'static>>;

    /// What is known of the cloud, and settings as its points settle them.
    fn surveyed(&self, settings: &Settings) -> (Surveyed, Settings);

    /// The mesh.
    ///
    /// # Errors
    /// Whatever is in the way of reading it.
    fn reconstructed(&self, settings: &Settings, context: &Context, progress: &mut Progress) -> Result<Reconstructed>;

    /// The mesh with fewer triangles, if they have left some out, too.
    ///
    /// # Errors
    /// Whatever is in the way of reading that.
    fn simplified(&self, context: &Context) -> Result<Option<(MeshSpool, Figures)>>;

    /// What its check found, if that was made, too.
    ///
    /// # Errors
    /// Whatever is in the way of reading that.
    fn checked(
        &self,
        mesh: &MeshSpool,
        budget: u64,
        workers: &Workers,
        workspace: &Workspace,
    ) -> Result<Option<CheckReport>>;

    /// The files of its tiles, a spool of them for each run of tiles and one that tells what they are, if these were written, too.
    ///
    /// # Errors
    /// Whatever is in the way of reading that.
    fn tiles(&self, context: &Context) -> Result<Option<Vec<[Spool; 2]>>>;

    /// What is to be told of a run of tiles that is not what was written.
    fn damaged_tiles(&self, run: usize) -> Error;
}

/// Refuses an output that a run of an opened cloud could not write; not one that tasks of this folder have written.
///
/// # Errors
/// [`Error::Usage`], [`Error::OutputExists`], [`Error::InvalidSetting`]; those of making a file there.
pub(super) fn refuse_output(job: &Job, files: &[PathBuf], cloud: &Cloud, work: Option<&WorkFolder>) -> Result<()> {
    let output = output_of(job, files)?;
    let mut job = job.clone();
    if work.is_some_and(|work| has_output_of(work, &output)) {
        job.overwrite = Overwrite::Replace;
    }
    Place::of(&job, files, &output)?.0.stand_where(cloud, &job)
}

pub(super) fn run_in(job: &Job, source: Source<'_>, workers: &Workers, progress: &mut Progress) -> Result<Report> {
    let start = Instant::now();
    let (work, outputs) = match source {
        Source::Points(work) => (work, work),
        // Who finishes tasks has no folder for itself, but says there what it gives its name.
        Source::Made(made) => (None, Some(made.folder())),
    };
    let files = match source {
        Source::Points(_) => files(job, progress)?,
        Source::Made(made) => made.files().to_vec(),
    };
    if work.is_some() && files.iter().any(|file| file == Path::new(STANDARD_INPUT)) {
        let message = "`work`: standard input cannot be read again by a run that goes on; write it to a file first";
        return Err(Error::setting("work", message.into()));
    }
    let output = output_of(job, &files)?;
    let mut job = job.clone();
    if outputs.is_some_and(|work| has_output_of(work, &output)) {
        // It was named, and then the run was ended.
        job.overwrite = Overwrite::Replace;
    }
    let job = &job;
    Beside::of(job)?.paths().try_for_each(|path| refuse_input_as_output(&files, path))?;
    let mut beside = Beside::of(job)?.create()?;
    // What can fail for want of room or rights fails now, not after the work.
    let (mut target, positions) = Place::of(job, &files, &output)?;
    #[cfg(feature = "render")]
    let picture = job.preview.path(&output).map(|path| render::picture_file(&path, job.overwrite)).transpose()?;
    #[cfg(feature = "render")]
    let page = job.html.as_deref().map(AtomicFile::report).transpose()?;
    let beside_output = if is_named(&output) { TilesetTarget::folder(&output)? } else { &*output };
    let workspace = job.resources.workspace(beside_output)?.stopped_with(workers);
    progress.expect_run(known(job, &files, Passes::All));
    let mut cloud = match source {
        Source::Points(_) => open(job, &files, &workspace, workers, Passes::All, progress)?,
        Source::Made(made) => made.cloud(job, &workspace, workers, progress)?,
    };
    target.stand_where(&cloud, job)?;
    let job = &job.measured_as(&cloud)?;
    if let (Place::Tiles(tiles), Some(side)) = (&mut target, job.tile) {
        tiles.divide_by(Division::Squares(side));
    }

    describe(&cloud, &job.settings, progress);
    let budget = job.resources.budget();
    beside.measure_as(&Beside::of(job)?);
    let (ground, left) = match source {
        Source::Points(_) => (
            bare_earth(&mut cloud, &job.settings, &mut beside, budget, workers, &workspace, progress)?,
            budget_beside(&job.settings, budget, workers),
        ),
        Source::Made(_) => (None, budget),
    };
    let (mut surveyed, settings) = match source {
        Source::Points(_) => surveyed(&cloud, &job.settings, (workers, &workspace), left, progress)?,
        Source::Made(made) => made.surveyed(&job.settings),
    };
    let levels = matches!(target, Place::Tileset(_));
    if is_remote(&output) {
        surveyed.workload = surveyed.workload.with_transfers();
    }
    // The page's mesh is one of fewer triangles.
    #[cfg(feature = "render")]
    if page.is_some() {
        surveyed.workload = surveyed.workload.with_page();
    }
    if levels {
        surveyed.workload = surveyed.workload.with_levels();
    }
    if let Some(tiles) = expected_tiles(job, &surveyed)? {
        progress.note(&format!("about {} tiles in {}", thousands(tiles), Tiling::path(&output).display()));
    }
    if let (Place::Tiles(tiles), true) = (&mut target, job.batch) {
        tiles.divide_by(Division::Inputs(territories(&cloud, workers, progress)?));
    }
    let whole = |error| of_whole_budget(error, &settings, budget, workers);
    if let Some(work) = work {
        identity::begin(work, &files, &cloud, &job.input, (&settings, &surveyed))?;
        if work.is_done(bucket::PHASE) {
            progress.note(&format!("going on with what lies in {}", work.path().display()));
        }
    }
    let planned = match source {
        Source::Points(_) => planned(&cloud, surveyed, &settings, (workers, &workspace), left, work.cloned(), progress),
        Source::Made(_) => context(&surveyed, workers, &workspace, left).map(|context| (surveyed, context)),
    };
    let (surveyed, context) = planned.map_err(whole)?;
    if outputs.is_none() && progress.seconds_left().is_some_and(|seconds| seconds > LONG) {
        progress.note("this run is going to take more than ten minutes: with `work` DIR, the same command goes on from where it was ended");
    }
    #[cfg(feature = "render")]
    let picture = picture
        .map(|file| PlannedPreview::new(file, &settings, &surveyed.survey.bounds, cloud.schema(), cloud.measure()));
    #[cfg(feature = "render")]
    if let Some(picture) = &picture {
        picture.check_memory(&context.memory)?;
    }
    #[cfg(feature = "render")]
    let page = page.map(|file| {
        let options = preview::options(&settings, &surveyed.survey.bounds, cloud.schema());
        let legend = render::Legend::In(cloud.measure());
        PlannedPage::new(file, render::Options { legend, ..options }, settings.may_end())
    });
    let mut made = match source {
        Source::Points(_) => reconstruct(&cloud, &surveyed, &settings, &context, progress).map_err(whole)?,
        Source::Made(made) => made.reconstructed(&settings, &context, progress)?,
    };

    if job.settings.may_be_empty() && made.mesh.face_count() == 0 {
        return Err(Error::NoSurface);
    }
    let ending = if let Source::Made(before) = source { before.ending() } else { String::new() };
    let kept = match source {
        Source::Points(work) => work.map(|work| KeptSteps { work, ending: &ending, alone: true }),
        // What is read again while it waits to be an object is not there.
        Source::Made(before) if before.folder().is_remote() => None,
        Source::Made(before) => Some(KeptSteps { work: before.folder(), ending: &ending, alone: false }),
    };
    let mut simplification = None;
    if let Some(asked) = &settings.simplify {
        let longest = surveyed.survey.bounds.longest_side();
        let lengths = Lengths { cell: Some(surveyed.grid.cell_size()), longest };
        let means = Means { memory: made.memory.working, workers, workspace: &workspace, kept };
        let before = match source {
            Source::Points(_) => None,
            Source::Made(before) => before.simplified(&context)?,
        };
        let (fewer, figures) = match before {
            Some(before) => before,
            None => simplified(&made.mesh, asked, lengths, means, progress)?,
        };
        made.mesh = fewer;
        simplification = Some(figures);
    }
    let header = header_of(&cloud, &surveyed, &settings, &made, &job.input.attributes, workers)?;
    let origin = if positions == Positions::Absolute { [0.0; 3] } else { made.origin };
    let mut checked = None;
    made.memory = made.memory.with_mesh(&made.mesh, job.check == Check::Always, target.filling(&made.mesh, workers));
    if job.check == Check::Always {
        progress.begin(Phase::Check, Some(made.mesh.face_count()));
        let budget = made.memory.working;
        let mut work = || {
            let by_tasks = match source {
                Source::Points(_) => None,
                Source::Made(before) => before.checked(&made.mesh, budget, workers, &workspace)?,
            };
            let here = || check_near(&made.mesh, budget, workers, &workspace, &mut |done| progress.set(done));
            by_tasks.map_or_else(here, Ok)
        };
        // Neither needs the other, and only what is sound gets its name. Where there is room, both are done at once.
        let (report, filled) = match made.memory.fills_meanwhile(made.mesh.vertex_count(), made.mesh.face_count()) {
            false => (work(), Ok(target)),
            true => target.filled_meanwhile(&made.mesh, &header, workers, work),
        };
        let mut report = report?;
        target = filled?;
        if let (Some(bounds), Positions::Absolute) = (&mut report.bounds, positions) {
            bounds.iter_mut().for_each(|corner| (0..3).for_each(|a| corner[a] += made.origin[a]));
        }
        refuse_unsound(&report, &settings)?;
        checked = Some(report);
    }
    #[cfg(feature = "render")]
    let drawn = match picture {
        None => None,
        Some(picture) => {
            progress.begin(Phase::Render, Some(made.mesh.face_count()));
            let memory = made.memory.working;
            Some(picture.draw(&made.mesh, memory, workers, &workspace, &mut |done| progress.set(done))?)
        }
    };
    #[cfg(feature = "render")]
    let page = match page {
        None => None,
        Some(page) => {
            let triangles = made.mesh.face_count() as f64;
            progress.begin(Phase::Render, Some(made.mesh.face_count()));
            let told = &mut |part: f64| progress.set((part * triangles) as u64);
            Some(page.show((&made.mesh, made.origin), &made.memory, (workers, &workspace), told)?)
        }
    };
    let elements = match &target {
        Place::Tiles(_) => 2 * made.mesh.face_count(),
        Place::File(_) => made.mesh.vertex_count() + made.mesh.face_count(),
        // Told level by level.
        Place::Tileset(_) => 0,
        // Written already, but for the name.
        Place::Filled(_) => 0,
    };
    progress.begin(Phase::Write, Some(elements));
    if let Some(work) = outputs.filter(|work| !has_output_of(work, &output)) {
        // An earlier run may have named another.
        work.set_aside(OUTPUT)?;
        work.commit(OUTPUT, Vec::new(), output.display().to_string().into())?;
        work.settle(true)?;
    }
    let mut told = |done| progress.set(done);
    let (mut files, mut tileset) = (None, None);
    let (path, written) = match target {
        Place::File(target) => (output, target.fill(&made.mesh, &header, workers, &mut told)?.finish()?),
        Place::Tileset(target) => {
            let means = Means { memory: made.memory.working, workers, workspace: &workspace, kept };
            let figures = target.write(&made.mesh, &header, &job.tileset, means, progress)?;
            let bytes = figures.bytes;
            files = Some(figures.tiles());
            tileset = Some(figures);
            (output, Written { bytes })
        }
        Place::Filled(filled) => (output, filled.finish()?),
        Place::Tiles(tiles) => {
            let memory = made.memory.working;
            let before = if let Source::Made(before) = source { Some(before) } else { None };
            let runs = before.map(|before| before.tiles(&context)).transpose()?.flatten();
            let (written, count) = match (before, runs) {
                (Some(before), Some(runs)) => {
                    tiles.take(&header, &runs, workers, &mut told)?.map_err(|run| before.damaged_tiles(run))?
                }
                _ => tiles.write(&made.mesh, &header, memory, workers, &workspace, &mut told)?,
            };
            files = Some(count);
            (Tiling::path(&output), written)
        }
    };
    beside.finish()?;
    #[cfg(feature = "render")]
    let preview = drawn.map(DrawnPreview::write).transpose()?;
    #[cfg(not(feature = "render"))]
    let preview = None;
    progress.end();

    let output = OutputReport {
        path: Some(path),
        preview,
        bytes: written.bytes,
        tiles: files,
        tileset,
        vertices: made.mesh.vertex_count(),
        triangles: made.mesh.face_count(),
        origin,
        coordinates: positions,
    };
    let seconds = start.elapsed().as_secs_f64();
    let report = report(Finished {
        cloud: &cloud,
        surveyed: &surveyed,
        ground,
        settings: &settings,
        made: &made,
        simplification,
        check: checked,
        output,
        progress,
        seconds,
        workspace: &workspace,
    });
    #[cfg(feature = "render")]
    if let Some(page) = page {
        page.write(&report)?;
    }
    Ok(report)
}
