//! A whole run: files in, mesh file out. What the command does, as a call.

pub mod estimate;
pub mod forecast;
pub mod looks;
pub mod phase;
pub mod pipeline;
pub mod planner;
#[cfg(feature = "render")]
pub mod preview;
pub mod progress;
pub mod reconstruction;
pub mod report;
pub mod workload;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Instant;

use self::estimate::WORTH_IT;
use self::forecast::Known;
use self::pipeline::{Reconstructed, Sampling, Surveyed, context, reconstruct, rehearsed, survey_cloud, survey_with};
#[cfg(feature = "render")]
use self::preview::{DrawnPreview, PlannedPreview, Preview};
use self::progress::Progress;
use self::report::{
    Closing, FitReport, GridReport, InputReport, MemoryReport, OutputReport, Parameters, PointsReport, Report,
};
use crate::error::defect;
use crate::error::words::thousands;
use crate::error::{Error, Result};
use crate::format::write;
use crate::format::write::tiles::{self, Tiles};
use crate::format::write::{Filled, Positions, Target};
use crate::grid::context::Context;
use crate::input::tally::Tally;
use crate::input::{Cloud, InputOptions, Opening, Packing, STANDARD_INPUT, Unpacked, find};
use crate::mesh::check::{CheckReport, check_near};
use crate::mesh::spool::MeshSpool;
use crate::mesh::{MeshHeader, MeshSource};
use crate::points::attribute::Wanted;
use crate::points::unit::Unit;
#[cfg(feature = "render")]
use crate::render;
use crate::resources::machine;
use crate::resources::memory::MemoryPlan;
use crate::resources::workers::Workers;
use crate::run::phase::Phase;
use crate::settings::Resolution;
use crate::settings::closing::Sealing;
use crate::settings::open::{Hole, Kind};
use crate::settings::{Fineness, Settings};
use crate::solid::close::How;
use crate::storage::atomic_file::Overwrite;
use crate::storage::spool::Workspace;

/// Everything a run is told.
#[derive(Debug, Clone)]
pub struct Job {
    /// Files, patterns, folders, or `-` for standard input.
    pub inputs: Vec<PathBuf>,
    /// How raw files are laid out.
    pub input: InputOptions,
    /// What is made of the points.
    pub settings: Settings,
    /// The mesh file; by default beside the first input.
    pub output: Option<PathBuf>,
    /// The side of square tiles, in the input's units, if the mesh is to be a folder of them.
    pub tile: Option<f64>,
    /// The units of lengths in [`Job::settings`] and [`Job::tile`], where these are not the input's.
    pub units: Units,
    /// Whether a picture of the mesh is drawn, too.
    #[cfg(feature = "render")]
    pub preview: Preview,
    /// Whether it may replace a file.
    pub overwrite: Overwrite,
    /// Which coordinates the mesh file has; by default what is usual for its format.
    pub positions: Option<Positions>,
    /// What the run may use.
    pub resources: Resources,
    /// Whether the mesh is checked before it gets its name.
    pub check: Check,
}

impl Job {
    /// Whether a picture of the mesh is drawn, too.
    fn is_drawn(&self) -> bool {
        #[cfg(feature = "render")]
        return self.preview != Preview::None;
        #[cfg(not(feature = "render"))]
        false
    }

    /// A job with the command's defaults.
    pub fn new(inputs: impl IntoIterator<Item = impl Into<PathBuf>>) -> Job {
        Job {
            inputs: inputs.into_iter().map(Into::into).collect(),
            input: InputOptions::default(),
            settings: Settings::default(),
            output: None,
            tile: None,
            units: Units::default(),
            #[cfg(feature = "render")]
            preview: Preview::None,
            overwrite: Overwrite::Refuse,
            positions: None,
            resources: Resources::default(),
            check: Check::Always,
        }
    }
}

/// The units of lengths that were given with a unit. A length without one is in the unit of the input's coordinates, whatever that is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Units {
    /// The unit of the side of a cell.
    pub cell_size: Option<Unit>,
    /// The unit of the radius that holes are closed with.
    pub seal: Option<Unit>,
    /// The unit of the widest hole that is bridged.
    pub max_hole: Option<Unit>,
    /// The unit of the height of a flat bottom.
    pub base: Option<Unit>,
    /// The unit of the side of tiles.
    pub tile: Option<Unit>,
}

impl Job {
    /// The job with all lengths in the unit of a cloud's coordinates.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if a length has a unit, and the cloud's coordinates have none that is known, or are degrees.
    pub(crate) fn measured_as(&self, cloud: &Cloud) -> Result<Job> {
        let Units { cell_size, seal, max_hole, base, tile } = self.units;
        let length = |setting: &'static str, length: f64, unit: Option<Unit>| {
            unit.map_or(Ok(length), |unit| cloud.length(setting, length, unit))
        };
        let mut settings = self.settings;
        if let Fineness::Given(Resolution::Cell(side)) = &mut settings.fineness {
            *side = length("cell_size", *side, cell_size)?;
        }
        if let Sealing::Length(radius) = &mut settings.seal {
            *radius = length("seal", *radius, seal)?;
        }
        if let Some(open) = &mut settings.open {
            if let Hole::Length(width) = &mut open.max_hole {
                *width = length("max_hole", *width, max_hole)?;
            }
            open.base = open.base.map(|height| length("base", height, base)).transpose()?;
        }
        let tile = self.tile.map(|side| length("tile", side, tile)).transpose()?;
        Ok(Job { settings, tile, units: Units::default(), ..self.clone() })
    }
}

/// What a run may use. Nothing of it shows in the mesh.
#[derive(Debug, Clone, Default)]
pub struct Resources {
    /// Memory, in bytes; by default a quarter of the machine's.
    pub max_memory: Option<u64>,
    /// Worker threads; by default one for each processor.
    pub threads: Option<usize>,
    /// The folder for temporary files; by default `TMPDIR`, or else the output's folder.
    pub temp_dir: Option<PathBuf>,
}

/// Threads that may be asked for on any machine; more than a few for each processor only cost time and memory.
const MOST_THREADS: usize = 256;

/// Whether the mesh is checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Check {
    /// It is, and nothing is written if it fails.
    #[default]
    Always,
    /// It is not.
    Never,
}

impl Resources {
    /// The memory budget in bytes.
    pub fn budget(&self) -> u64 {
        self.max_memory.unwrap_or_else(|| machine::memory() / 4)
    }

    /// The worker threads.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] for more threads than any machine could use; as [`Workers::new`].
    pub fn workers(&self) -> Result<Workers> {
        let most = MOST_THREADS.max(4 * machine::processors());
        if let Some(threads) = self.threads.filter(|threads| *threads > most) {
            return Err(Error::setting(
                "threads",
                format!("`threads` {threads}: there are {} processors; at most {most} threads", machine::processors()),
            ));
        }
        Workers::new(self.threads.unwrap_or_else(machine::processors))
    }

    /// The work directory, `beside` a file unless told otherwise.
    ///
    /// # Errors
    /// The same as [`Workspace::new`].
    pub fn workspace(&self, beside: &Path) -> Result<Workspace> {
        Workspace::new(self.folder(beside))
    }

    /// A work directory for looking at points, after which nothing stays: as [`Resources::workspace`]; but where nothing can be written `beside`, and no folder was
    /// named, the system's folder for temporary files, with the folder that could not be written to.
    ///
    /// # Errors
    /// The same as [`Workspace::new`].
    fn looking(&self, beside: &Path) -> Result<(Workspace, Option<PathBuf>)> {
        let folder = self.folder(beside);
        match Workspace::new(&folder) {
            Err(_) if self.temp_dir.is_none() => {
                let system = std::env::temp_dir();
                if system == folder {
                    Workspace::new(system).map(|there| (there, None))
                } else {
                    Ok((Workspace::unchecked(system), Some(folder)))
                }
            }
            there => Ok((there?, None)),
        }
    }

    fn folder(&self, beside: &Path) -> PathBuf {
        self.temp_dir.clone().unwrap_or_else(|| Workspace::folder_beside(beside))
    }
}

/// The default output: the first input's name with `.mesh.ply` for its extension, beside it. If that input is a pattern, the first
/// of its `files` counts; if a file is compressed, the name it has without that.
fn default_output(inputs: &[PathBuf], files: &[PathBuf]) -> PathBuf {
    let named = inputs.first().filter(|input| input.exists() && input.file_name().is_some()).unwrap_or(&files[0]);
    let bare = Packing::named(named).filter(|_| named.is_file()).map(|(_, bare)| bare);
    bare.as_ref().unwrap_or(named).with_extension("mesh.ply")
}

/// The mesh's name for `inputs` that stand for `files`, if nobody gave it one.
///
/// # Errors
/// [`Error::Usage`] if the first input is standard input.
pub fn default_output_of(inputs: &[PathBuf], files: &[PathBuf]) -> Result<PathBuf> {
    if inputs[0] == Path::new(STANDARD_INPUT) {
        return Err(Error::Usage("standard input has no name that the mesh could have; pass `output`".to_string()));
    }
    Ok(default_output(inputs, files))
}

/// What is known of a job before its first point is sorted.
#[derive(Debug)]
pub struct Planned {
    /// The files.
    pub cloud: Cloud<'static>,
    /// The survey, the grid and the faces to expect.
    pub surveyed: Surveyed,
    /// Where temporary files would go.
    pub workspace: Workspace,
    /// The folder where they would go by default, if it cannot be written to: the workspace is another one then.
    pub unwritable: Option<PathBuf>,
    /// About how many tiles the mesh would be, if it is to be tiles.
    pub tiles: Option<u64>,
    /// The plan.
    pub memory: MemoryPlan,
}

/// Surveys the input, rehearses and makes the plan; writes nothing that stays.
///
/// # Errors
/// Those of opening and reading the input, of laying the grid and of the plan.
pub fn plan(job: &Job, workers: &Workers, progress: &mut Progress) -> Result<Planned> {
    let files = files(job, progress)?;
    let (workspace, unwritable) = job.resources.looking(&default_output(&job.inputs, &files))?;
    progress.expect_run(known(job, &files, Passes::Few));
    let cloud = open(job, &files, &workspace, workers, Passes::Few, progress)?;
    let job = &job.measured_as(&cloud)?;
    describe(&cloud, &job.settings, progress);
    let surveyed = survey_cloud(&cloud, &job.settings, workers, progress)?;
    refuse_contradiction(&cloud, &surveyed)?;
    let tiles = expected_tiles(job, &surveyed)?;
    let budget = job.resources.budget();
    let surveyed = rehearsed(surveyed, &job.settings, workers, &workspace, budget, progress)?;
    let memory = pipeline::plan(&surveyed, workers, budget)?;
    Ok(Planned { cloud, surveyed, workspace, unwritable, tiles, memory })
}

/// What is found by looking at points.
#[derive(Debug)]
pub struct Looked {
    /// The files.
    pub cloud: Cloud<'static>,
    /// The survey and the grid.
    pub surveyed: Surveyed,
    /// Points by class and return.
    pub tally: Tally,
}

/// About how many tiles a job makes, if any; too many are refused.
fn expected_tiles(job: &Job, surveyed: &Surveyed) -> Result<Option<u64>> {
    let Some(side) = job.tile else { return Ok(None) };
    // Each has a triangle at least.
    let tiles = surveyed.coarse_grid.squares(&surveyed.survey.bounds, side).min(surveyed.workload.triangles().max(1));
    tiles::check_number(side, tiles).map(|()| Some(tiles))
}

/// Looks at the input and surveys it; asks for no memory beyond that, and for no temporary disk unless something must be unpacked.
///
/// # Errors
/// Those of opening and reading the input and of laying the grid.
pub fn look(job: &Job, workers: &Workers, progress: &mut Progress) -> Result<Looked> {
    let files = files(job, progress)?;
    let (workspace, _) = job.resources.looking(&default_output(&job.inputs, &files))?;
    progress.expect_run(Known { rehearsed: false, ..known(job, &files, Passes::Few) });
    let cloud = open(job, &files, &workspace, workers, Passes::Few, progress)?;
    let job = &job.measured_as(&cloud)?;
    let counted = Tally::is_of_use(&cloud);
    progress.learn(|known| known.counted = counted);
    let surveyed = survey_with(&cloud, &job.settings, Sampling::Always, workers, progress)?;
    let tally = if counted {
        progress.begin(Phase::Count, Some(surveyed.survey.records()));
        let tally = Tally::of(&cloud, workers, |records| progress.add(records))?;
        progress.end();
        tally
    } else {
        Tally::default()
    };
    Ok(Looked { cloud, surveyed, tally })
}

/// The input's files, once the settings are found to be in order; what was left out is told.
fn files(job: &Job, progress: &Progress) -> Result<Vec<PathBuf>> {
    job.settings.validate()?;
    let found = find(&job.inputs, job.input.depth)?;
    found.left_out.iter().for_each(|line| progress.note(line));
    Ok(found.files)
}

/// What of a run is to come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Passes {
    /// A look at the points.
    Few,
    /// The whole.
    All,
}

fn open(
    job: &Job,
    files: &[PathBuf],
    workspace: &Workspace,
    workers: &Workers,
    passes: Passes,
    progress: &mut Progress,
) -> Result<Cloud<'static>> {
    let mut begun = false;
    let watch = &mut |unpacked: Unpacked| {
        workers.check_cancelled()?;
        begun = true;
        progress.unpacked(unpacked);
        Ok(())
    };
    let decompress = (passes == Passes::All).then_some(workers);
    let opening = Opening { workspace, memory: job.resources.budget(), decompress, watch };
    let cloud = Cloud::open_in(files, &job.input, opening);
    if begun {
        progress.end();
    } else {
        progress.learn(|known| known.packed = 0);
    }
    let cloud = cloud?;
    let points = forecast::records(&cloud);
    progress.learn(|known| {
        (known.points, known.triangles) = (points, forecast::triangles(points));
        known.rehearsed &= passes == Passes::Few || points >= WORTH_IT;
    });
    Ok(cloud)
}

/// Opens the inputs of a job whose mesh stays in memory.
///
/// # Errors
/// Those of finding and opening files.
pub(crate) fn open_all(
    job: &Job,
    workspace: &Workspace,
    workers: &Workers,
    progress: &mut Progress,
) -> Result<Cloud<'static>> {
    let files = files(job, progress)?;
    progress.expect_run(Known { write: forecast::Write::Not, ..known(job, &files, Passes::All) });
    open(job, &files, workspace, workers, Passes::All, progress)
}

/// What is known of the work that a job is, before its files are opened.
fn known(job: &Job, files: &[PathBuf], passes: Passes) -> Known {
    let bytes = files.iter().filter_map(|file| std::fs::metadata(file).ok()).map(|there| there.len()).sum();
    // Half of the bytes may be packed; it is known as soon as the first file is opened.
    let points = forecast::points(bytes, bytes / 2);
    let survey = 1 + u64::from(matches!(job.settings.fineness, Fineness::Sampling | Fineness::Default));
    let rehearsed = job.settings.open.is_none() && (passes == Passes::Few || points >= WORTH_IT);
    let known = Known { packed: bytes / 2, passes: survey, points, rehearsed, ..Known::default() };
    match passes {
        Passes::Few => known,
        Passes::All => Known {
            triangles: forecast::triangles(points),
            open: job.settings.open.is_some(),
            checked: job.check == Check::Always,
            drawn: job.is_drawn(),
            write: match (job.tile, job.check) {
                (Some(_), _) => forecast::Write::Tiles,
                (None, Check::Always) => forecast::Write::Meanwhile,
                (None, Check::Never) => forecast::Write::After,
            },
            whole: true,
            ..known
        },
    }
}

/// Says how every file was understood, and what its scans' places are good for.
fn describe(cloud: &Cloud, settings: &Settings, progress: &Progress) {
    for source in cloud.sources() {
        progress.note(&format!("{}: {}", source.path.display(), source.description));
    }
    if let Some(line) = cloud.crs_line() {
        progress.note(&format!("coordinate reference system: {line}"));
    }
    let scans: usize = cloud.stations().map(|stations| stations.len()).sum();
    if scans > 0 && settings.open.is_some_and(|open| open.kind == Kind::Terrain) {
        progress.note("the file tells where its scans were taken from: `surface` sheet `facing` @poses makes a sheet seen from there");
    }
}

/// No mesh is put where its points cannot be.
fn refuse_contradiction(cloud: &Cloud, surveyed: &Surveyed) -> Result<()> {
    match contradiction(cloud, surveyed) {
        Some(words) => Err(Error::setting(
            "crs",
            format!("{words}; name the right one with `crs`, as in `crs` EPSG:25832, or `crs` none"),
        )),
        None => Ok(()),
    }
}

/// What a cloud's reference system says, if its coordinates say something else.
pub fn contradiction(cloud: &Cloud, surveyed: &Surveyed) -> Option<String> {
    let bounds = &surveyed.survey.bounds;
    let crs = cloud.crs()?;
    let expected = crs.contradicted_by(bounds.min, bounds.max)?;
    let [[a, b, c], [x, y, z]] = [bounds.min, bounds.max];
    let path = cloud.sources().iter().find(|source| source.crs.is_some()).or(cloud.sources().first())?.path.display();
    let head: String = crs.wkt.as_deref().unwrap_or_default().chars().take(60).collect();
    let head = if head.is_empty() { head } else { format!(", {head}...") };
    Some(format!(
        "{path}: the reference system ({crs}{head}) expects {expected}, but coordinates go from {a} {b} {c} to {x} {y} {z}"
    ))
}

/// No mesh takes the place of the points it is made from.
fn refuse_input_as_output(files: &[PathBuf], output: &Path) -> Result<()> {
    let same = |path: &Path| matches!((path.canonicalize(), output.canonicalize()), (Ok(a), Ok(b)) if a == b);
    match files.iter().find(|file| same(file)) {
        Some(file) => Err(Error::Usage(format!(
            "{}: is an input, which the mesh would replace; choose another `output`",
            file.display()
        ))),
        None => Ok(()),
    }
}

/// Surveys a cloud, once it is told how its files were understood; with the settings as its points settle them.
///
/// # Errors
/// Errors of reading the input and of laying the grid; [`Error::InvalidSetting`] if its reference system contradicts its coordinates.
pub(crate) fn surveyed(
    cloud: &Cloud,
    settings: &Settings,
    workers: &Workers,
    progress: &mut Progress,
) -> Result<(Surveyed, Settings)> {
    describe(cloud, settings, progress);
    let surveyed = survey_cloud(cloud, settings, workers, progress)?;
    refuse_contradiction(cloud, &surveyed)?;
    let settings = Settings { open: surveyed.open, ..*settings };
    Ok((surveyed, settings))
}

/// The plan of a surveyed cloud, and all that the passes over it are given.
///
/// # Errors
/// [`Error::Budget`], [`Error::Disk`], [`Error::TooManyElements`]; those of a rehearsal.
pub(crate) fn planned(
    mut surveyed: Surveyed,
    settings: &Settings,
    workers: &Workers,
    workspace: &Workspace,
    budget: u64,
    progress: &mut Progress,
) -> Result<(Surveyed, Context)> {
    progress.learn(|known| known.points = surveyed.survey.points);
    // What the box alone lets expect may be too much.
    if surveyed.survey.points >= WORTH_IT || pipeline::plan(&surveyed, workers, budget).is_err() {
        surveyed = rehearsed(surveyed, settings, workers, workspace, budget, progress)?;
    }
    let context = context(&surveyed, workers, workspace, budget)?;
    progress.learn(|known| {
        known.triangles = surveyed.workload.triangles();
        if context.memory.mesh_quota == 0 && known.write == forecast::Write::Meanwhile {
            known.write = forecast::Write::After;
        }
    });
    Ok((surveyed, context))
}

/// Reconstructs: reads the input, makes the mesh, checks it, writes it.
///
/// # Errors
/// All of [`Error`]. Whatever happens, no temporary file stays, and the output exists only if it is whole.
pub fn run(job: &Job, workers: &Workers, progress: &mut Progress) -> Result<Report> {
    let start = Instant::now();
    let files = files(job, progress)?;
    let output = match &job.output {
        Some(output) => output.clone(),
        None => default_output_of(&job.inputs, &files)?,
    };
    refuse_input_as_output(&files, &output)?;
    let positions = Positions::of(&output, job.positions)?;
    // What can fail for want of room or rights fails now, not after the work.
    let mut target = match job.tile {
        None => Place::File(Target::prepare(&output, job.overwrite, positions)?),
        Some(side) => Place::Tiles(Tiles::prepare(&output, side, job.overwrite, positions)?),
    };
    #[cfg(feature = "render")]
    let picture = job.preview.path(&output).map(|path| render::picture_file(&path, job.overwrite)).transpose()?;
    let workspace = job.resources.workspace(&output)?.stopped_with(workers);
    progress.expect_run(known(job, &files, Passes::All));
    let cloud = open(job, &files, &workspace, workers, Passes::All, progress)?;
    let job = &job.measured_as(&cloud)?;
    if let (Place::Tiles(tiles), Some(side)) = (&mut target, job.tile) {
        tiles.set_side(side);
    }

    let (surveyed, settings) = surveyed(&cloud, &job.settings, workers, progress)?;
    if let Some(tiles) = expected_tiles(job, &surveyed)? {
        progress.note(&format!("about {} tiles in {}", thousands(tiles), Tiles::path(&output).display()));
    }
    let (surveyed, context) = planned(surveyed, &settings, workers, &workspace, job.resources.budget(), progress)?;
    #[cfg(feature = "render")]
    let picture = picture
        .map(|file| PlannedPreview::new(file, &settings, &surveyed.survey.bounds, cloud.schema(), cloud.measure()));
    #[cfg(feature = "render")]
    if let Some(picture) = &picture {
        picture.check_memory(&context.memory)?;
    }
    let made = reconstruct(&cloud, &surveyed, &settings, &context, progress)?;

    if job.settings.open.is_some() && made.mesh.face_count() == 0 {
        return Err(Error::NoSurface);
    }
    let header = header_of(&cloud, &surveyed, &settings, &made, &job.input.attributes, workers)?;
    let origin = if positions == Positions::Absolute { [0.0; 3] } else { made.origin };
    let mut checked = None;
    if job.check == Check::Always {
        progress.begin(Phase::Check, Some(made.mesh.face_count()));
        let budget = made.memory.working;
        let mut work = || check_near(&made.mesh, budget, workers, &workspace, &mut |done| progress.set(done));
        // Neither needs the other, and only what is sound gets its name. Where the mesh lies in memory, there is room for both.
        let (report, filled) = match made.memory.mesh_quota {
            0 => (work(), Ok(target)),
            _ => target.filled_meanwhile(&made.mesh, &header, workers, work),
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
    let elements = match &target {
        Place::Tiles(_) => 2 * made.mesh.face_count(),
        Place::File(_) => made.mesh.vertex_count() + made.mesh.face_count(),
        // Written already, but for the name.
        Place::Filled(_) => 0,
    };
    progress.begin(Phase::Write, Some(elements));
    let mut told = |done| progress.set(done);
    let mut files = None;
    let (path, written) = match target {
        Place::File(target) => (output, target.fill(&made.mesh, &header, workers, &mut told)?.finish()?),
        Place::Filled(filled) => (output, filled.finish()?),
        Place::Tiles(tiles) => {
            let memory = made.memory.working;
            let (written, count) = tiles.write(&made.mesh, &header, memory, workers, &workspace, &mut told)?;
            files = Some(count);
            (Tiles::path(&output), written)
        }
    };
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
        vertices: made.mesh.vertex_count(),
        triangles: made.mesh.face_count(),
        origin,
        coordinates: positions,
    };
    let seconds = start.elapsed().as_secs_f64();
    Ok(report(Finished {
        cloud: &cloud,
        surveyed: &surveyed,
        settings: &settings,
        made: &made,
        check: checked,
        output,
        progress,
        seconds,
        workspace: &workspace,
    }))
}

/// A mesh that is not what was promised is nobody's.
///
/// # Errors
/// [`Error::CheckFailed`].
pub(crate) fn refuse_unsound(report: &CheckReport, settings: &Settings) -> Result<()> {
    let open = settings.open.is_some_and(|open| open.base.is_none());
    if report.is_sound(open) { Ok(()) } else { Err(Error::CheckFailed(report.to_string())) }
}

/// A finished run, to be reported on.
pub(crate) struct Finished<'a> {
    /// The input.
    pub cloud: &'a Cloud<'a>,
    /// What the survey found.
    pub surveyed: &'a Surveyed,
    /// What was asked for.
    pub settings: &'a Settings,
    /// The mesh, and how it came to be.
    pub made: &'a Reconstructed,
    /// What the check found, if there was one.
    pub check: Option<CheckReport>,
    /// Where the mesh went.
    pub output: OutputReport,
    /// The stages and their times.
    pub progress: &'a Progress<'a>,
    /// Seconds in all.
    pub seconds: f64,
    /// The temporary storage that was used.
    pub workspace: &'a Workspace,
}

/// What is told of a run, with how long it took and what may be wrong.
pub(crate) fn report(run: Finished<'_>) -> Report {
    let Finished { cloud, surveyed, settings, made, check, output, progress, seconds, workspace } = run;
    let mut report = Report {
        version: env!("CARGO_PKG_VERSION"),
        inputs: input_reports(cloud),
        parameters: Parameters::of(settings),
        points: PointsReport::of(cloud, surveyed),
        grid: GridReport::of(&surveyed.grid),
        points_to_a_cell: surveyed.survey.points as f64 / made.occupied as f64,
        closing: Closing::of(made, &surveyed.grid),
        fit: FitReport { onto: made.fit, shell: made.shell },
        vertices: made.counts,
        check,
        output,
        seconds: progress.times().iter().map(|(phase, time)| (*phase, time.as_secs_f64())).collect(),
        seconds_total: seconds,
        memory: MemoryReport {
            plan: made.memory.clone(),
            peak_resident: machine::peak_resident(),
            peak_disk: workspace.peak_on_disk(),
        },
        warnings: Vec::new(),
    };
    report.judge();
    report
}

/// Where the mesh goes.
enum Place {
    File(Target),
    Filled(Filled),
    Tiles(Tiles),
}

impl Place {
    /// Does some work; a file is filled meanwhile.
    fn filled_meanwhile<R>(
        self,
        mesh: &MeshSpool,
        header: &MeshHeader,
        workers: &Workers,
        work: impl FnOnce() -> R,
    ) -> (R, Result<Place>) {
        let Place::File(target) = self else { return (work(), Ok(self)) };
        let waiting = Mutex::new(Some(target));
        let fill = || {
            let target = waiting.lock().unwrap_or_else(PoisonError::into_inner).take();
            target.map(|target| defect::caught(|| target.fill(mesh, header, workers, &mut |_| ())))
        };
        thread::scope(|scope| {
            let filling = thread::Builder::new().name("asra-writer".into()).spawn_scoped(scope, fill);
            let done = work();
            // A thread that the system refuses costs time only: then nobody has taken the target yet.
            let filled = filling.ok().and_then(|filling| filling.join().ok().flatten()).or_else(fill);
            let lost = || Err(Error::Internal("the writer is gone, and the mesh's file with it".into()));
            (done, filled.unwrap_or_else(lost).map(Place::Filled))
        })
    }
}

/// The files of a cloud, for the report.
pub fn input_reports(cloud: &Cloud) -> Vec<InputReport> {
    let report = |source: &crate::input::Source| InputReport {
        path: source.path.clone(),
        format: source.format,
        layout: source.description.clone(),
        bytes: source.bytes,
    };
    cloud.sources().iter().map(report).collect()
}

/// The header of a mesh: where all attributes are carried, those that never change stand in it.
///
/// # Errors
/// [`Error::Io`], [`Error::Interrupted`].
pub(crate) fn header_of(
    cloud: &Cloud,
    surveyed: &Surveyed,
    settings: &Settings,
    made: &Reconstructed,
    attributes: &Wanted,
    workers: &Workers,
) -> Result<MeshHeader> {
    let mut header = header(cloud, surveyed, settings, made);
    if *attributes == Wanted::All {
        for (name, value) in write::constant(&made.mesh, workers)? {
            header.comments.push(format!("constant {name} {value}"));
            header.constant.push(name);
        }
    }
    Ok(header)
}

/// What the mesh file says of its making: nothing that depends on means, so that the same points give the same bytes.
fn header(cloud: &Cloud, surveyed: &Surveyed, settings: &Settings, made: &Reconstructed) -> MeshHeader {
    let grid = &surveyed.grid;
    let surface = settings.surface;
    let words = |value: &dyn std::fmt::Debug| format!("{value:?}").to_lowercase();
    let closing = match &made.how {
        How::Ball(closing) => format!("radius {}", closing.rho()),
        How::Sign(_) => "auto".to_owned(),
    };
    let mut header = MeshHeader {
        crs: cloud.crs().cloned(),
        sheet: settings.open.is_some_and(|open| open.base.is_none()),
        constant: Vec::new(),
        origin: made.origin,
        comments: vec![
            format!("asra-stream {}", env!("CARGO_PKG_VERSION")),
            format!("cell_size {} slices {}", grid.cell_size(), grid.cells()[1]),
            format!(
                "axis {} closing {} smooth {} diagonals {} fit {}",
                grid.axis().letter(),
                closing,
                surface.smooth,
                words(&surface.diagonals),
                words(&surface.fit)
            ),
        ],
    };
    if let Some(open) = &settings.open {
        let base = open.base.map_or_else(String::new, |base| format!(" base {base}"));
        let hole = 2 * open.bridge(grid);
        header.comments.push(format!(
            "surface {} facing {} max_hole {hole} cells{base}",
            words(&open.kind),
            open.facing
        ));
    }
    header
}
