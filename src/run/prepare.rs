//! From files to a plan: the input is found, opened, surveyed and rehearsed, and memory is shared out.

use std::path::PathBuf;
use std::sync::Arc;

use crate::error::words::thousands;
use crate::error::{Error, Result};
use crate::format::tiles3d::is_named;
use crate::format::write::tiling;
use crate::grid::context::Context;
use crate::input::tally::Tally;
use crate::input::{Cloud, Headers, InputOptions, Opening, Unpacked, find};
use crate::resources::memory::MemoryPlan;
use crate::resources::workers::Workers;
use crate::run::bare_earth::{BesideFiles, bare_earth, budget_beside, looked_at, of_whole_budget};
use crate::run::closed_cells;
use crate::run::counted::counted;
use crate::run::estimate::WORTH_IT;
use crate::run::forecast::{self, Known};
use crate::run::job::{Check, Job, default_output};
use crate::run::phase::Phase;
use crate::run::pipeline::{self, context};
use crate::run::progress::Progress;
use crate::run::surveyed::{Sampling, Surveyed, rehearsed, survey_cloud, survey_with};
use crate::run::upsampled::upsampled;
use crate::run::workload::Workload;
use crate::settings::Settings;
use crate::settings::open::Kind;
use crate::storage::remote::{self, is_remote};
use crate::storage::spool::Workspace;
use crate::storage::work::WorkFolder;

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

/// Surveys the input, counts the faces to come and makes the plan; writes nothing that stays.
///
/// # Errors
/// Those of opening and reading the input, of laying the grid, of closing its cells and of the plan.
pub fn plan(job: &Job, workers: &Workers, progress: &mut Progress) -> Result<Planned> {
    let files = files(job, progress)?;
    let (workspace, unwritable) = job.resources.looking(&default_output(&job.inputs, &files))?;
    progress.expect_run(known(job, &files, Passes::Few));
    let mut cloud = open(job, &files, &workspace, workers, Passes::Few, progress)?;
    let job = &job.measured_as(&cloud)?;
    describe(&cloud, &job.settings, progress);
    let budget = job.resources.budget();
    bare_earth(&mut cloud, &job.settings, &mut BesideFiles::default(), budget, workers, &workspace, progress)?;
    let left = budget_beside(&job.settings, budget, workers);
    let surveyed = survey_with(&cloud, &job.settings, Sampling::Always, workers, left, progress)?;
    refuse_contradiction(&cloud, &surveyed)?;
    let settings = surveyed.settled(&job.settings);
    let surveyed = upsampled(&cloud, surveyed, &settings, (workers, &workspace), left, progress)?;
    let settings = surveyed.settled(&settings);
    let tiles = expected_tiles(job, &surveyed)?;
    let whole = |error| of_whole_budget(error, &settings, budget, workers);
    let mut surveyed = rehearsed(surveyed, &settings, workers, &workspace, left, progress)?;
    match counted(&cloud, &surveyed, &settings, (workers, &workspace), left, progress).map_err(whole)? {
        Some(workload) => surveyed.workload = workload,
        None => progress.note(&format!(
            "{} has no room for the points, so faces are not counted: a run may need more memory than what is told here",
            workspace.dir().display()
        )),
    }
    let memory = pipeline::plan(&surveyed, workers, left).map_err(whole)?;
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
pub(super) fn expected_tiles(job: &Job, surveyed: &Surveyed) -> Result<Option<u64>> {
    let Some(side) = job.tile else { return Ok(None) };
    // Each has a triangle at least.
    let tiles = surveyed.coarse_grid.squares(&surveyed.survey.bounds, side).min(surveyed.workload.triangles().max(1));
    tiling::check_number(side, tiles).map(|()| Some(tiles))
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
    let budget = job.resources.budget();
    let surveyed = survey_with(&cloud, &job.settings, Sampling::Always, workers, budget, progress)?;
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
pub(super) fn files(job: &Job, progress: &Progress) -> Result<Vec<PathBuf>> {
    job.settings.validate()?;
    let mut found = find(&job.inputs, job.input.depth)?;
    found.left_out.iter().for_each(|line| progress.note(line));
    if job.batch {
        found.files.sort();
    }
    Ok(found.files)
}

/// What of a run is to come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Passes {
    /// A look at the points.
    Few,
    /// The whole.
    All,
}

pub(super) fn open(
    job: &Job,
    files: &[PathBuf],
    workspace: &Workspace,
    workers: &Workers,
    passes: Passes,
    progress: &mut Progress,
) -> Result<Cloud<'static>> {
    let input = InputOptions { looked_at: looked_at(job), ..job.input.clone() };
    let open = |opening: Opening<'_>| Cloud::open_in(files, &input, opening);
    opened(job, open, (workspace, workers), passes, progress)
}

/// Opens those files alone that are read, of which the headers of all are known.
pub(super) fn open_known(
    job: &Job,
    (files, headers): (&[PathBuf], &Headers),
    is_read: impl Fn(usize) -> bool,
    means: (&Workspace, &Workers),
    progress: &mut Progress,
) -> Result<Cloud<'static>> {
    let input = InputOptions { looked_at: looked_at(job), ..job.input.clone() };
    let open = |opening: Opening<'_>| Cloud::of_headers(files, headers, is_read, &input, opening);
    opened(job, open, means, Passes::Few, progress)
}

fn opened(
    job: &Job,
    open: impl FnOnce(Opening<'_>) -> Result<Cloud<'static>>,
    (workspace, workers): (&Workspace, &Workers),
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
    let cloud = open(opening);
    if begun {
        progress.end();
    } else {
        progress.learn(|known| known.packed = 0);
    }
    let cloud = cloud?;
    if let (fetched, all @ 1..) = cloud.fetched() {
        progress.note(&format!("fetched {} of {} bytes", thousands(fetched), thousands(all)));
    }
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
pub(super) fn known(job: &Job, files: &[PathBuf], passes: Passes) -> Known {
    let length = |file: &PathBuf| match remote::noted(file) {
        Some(meta) => Some(meta.bytes),
        None => std::fs::metadata(file).ok().map(|there| there.len()),
    };
    let bytes = files.iter().filter_map(length).sum();
    // Half of the bytes may be packed; it is known as soon as the first file is opened.
    Known { packed: bytes / 2, ..known_of_points(job, forecast::points(bytes, bytes / 2), passes) }
}

/// What is known of the work that a job is, of so many points.
pub(super) fn known_of_points(job: &Job, points: u64, passes: Passes) -> Known {
    let survey = 1 + u64::from(job.batch && passes == Passes::All);
    let rehearsed = job.settings.open.is_none() && (passes == Passes::Few || points >= WORTH_IT);
    let known = Known { passes: survey, points, rehearsed, ..Known::default() };
    match passes {
        Passes::Few => known,
        Passes::All => Known {
            triangles: forecast::triangles(points),
            open: job.settings.open.is_some(),
            bridged: job.settings.bridged || job.settings.trim.is_some(),
            // The first level of a tileset takes as long.
            simplified: job.settings.simplify.is_some() || job.output.as_deref().is_some_and(is_named),
            checked: job.check == Check::Always,
            drawn: job.is_drawn(),
            write: match (job.tile.is_some() || job.batch, job.check) {
                (true, _) => forecast::Write::Tiles,
                (false, Check::Always) => forecast::Write::Meanwhile,
                (false, Check::Never) => forecast::Write::After,
            },
            whole: true,
            ..known
        },
    }
}

/// Says how every file was understood, and what its scans' places are good for.
pub(super) fn describe(cloud: &Cloud, settings: &Settings, progress: &Progress) {
    for source in cloud.sources() {
        progress.note(&format!("{}: {}", source.path.display(), source.description));
    }
    if let Some(line) = cloud.crs_line() {
        progress.note(&format!("coordinate reference system: {line}"));
    }
    let scans: usize = cloud.stations().map(|stations| stations.len()).sum();
    if scans > 0 && settings.open.is_some_and(|open| open.kind != Kind::Sheet) {
        progress.note("the file tells where its scans were taken from: `surface` sheet `facing` @poses makes a sheet seen from there");
    }
}

/// Whether a cloud is likely to be ground that was scanned from the air: points tell of returns, and lie in a box that is flat.
fn is_tile(cloud: &Cloud, surveyed: &Surveyed) -> bool {
    const FLAT: f64 = 4.0;
    let [x, y, z] = surveyed.survey.bounds.extent();
    cloud.has_attribute("return_number") && z * FLAT < x.max(y)
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

/// Surveys a cloud, in `budget` bytes, with places added where its points are sparse; with the settings as its points settle them.
///
/// # Errors
/// Errors of reading the input and of laying the grid; [`Error::InvalidSetting`] if its reference system contradicts its coordinates.
pub(crate) fn surveyed(
    cloud: &Cloud,
    settings: &Settings,
    (workers, workspace): (&Workers, &Workspace),
    budget: u64,
    progress: &mut Progress,
) -> Result<(Surveyed, Settings)> {
    let surveyed = survey_cloud(cloud, settings, workers, budget, progress)?;
    refuse_contradiction(cloud, &surveyed)?;
    if settings.open.is_none() && is_tile(cloud, &surveyed) {
        progress.note(
            "the points look like a tile of terrain, scanned from above: `surface` terrain makes one layer of it, `surface` ground bare earth",
        );
    }
    let settings = surveyed.settled(settings);
    let surveyed = upsampled(cloud, surveyed, &settings, (workers, workspace), budget, progress)?;
    let settings = surveyed.settled(&settings);
    Ok((surveyed, settings))
}

/// With a budget of so many times the least of a surface as it is expected from the box alone, with upright walls in its first and last slab if it is open, there is room
/// for what noise, folds and walls add to its faces.
const NEAR: u64 = 4;

/// The plan of a surveyed cloud, and all that the passes over it are given. Where an estimate says that the budget is too small, faces are counted: the figure that is named does.
///
/// # Errors
/// [`Error::Budget`], [`Error::Disk`], [`Error::TooManyElements`]; those of a rehearsal and of counting.
pub(crate) fn planned(
    cloud: &Cloud,
    mut surveyed: Surveyed,
    settings: &Settings,
    (workers, workspace): (&Workers, &Workspace),
    budget: u64,
    work: Option<Arc<WorkFolder>>,
    progress: &mut Progress,
) -> Result<(Surveyed, Context)> {
    if work.is_some() {
        surveyed.workload = surveyed.workload.with_work_folder();
    }
    if work.as_ref().is_some_and(|work| work.is_remote())
        || cloud.sources().iter().any(|source| is_remote(&source.path))
    {
        surveyed.workload = surveyed.workload.with_transfers();
    }
    progress.learn(|known| known.points = surveyed.survey.points);
    // What the box alone lets expect may be too much, and it may be too little: noise makes more faces, and the walls of an open surface fall to few slabs. What is kept
    // in memory on its account would be missing when the faces have been counted.
    let is_near = |workload: &Workload| budget < NEAR * MemoryPlan::least(workload, workers.threads());
    let is_worth_it = match surveyed.open {
        None => surveyed.survey.points >= WORTH_IT || is_near(&surveyed.workload),
        Some(_) => is_near(&surveyed.workload.clone().with_walls_at_ends()),
    };
    // Where cells were closed before, their faces are going to be counted.
    let is_closed = work.as_ref().is_some_and(|work| work.is_done(closed_cells::PHASE));
    if (is_worth_it && !is_closed) || pipeline::plan(&surveyed, workers, budget).is_err() {
        surveyed = rehearsed(surveyed, settings, workers, workspace, budget, progress)?;
    }
    if let Err(Error::Budget { .. }) = pipeline::plan(&surveyed, workers, budget)
        && let Some(workload) = counted(cloud, &surveyed, settings, (workers, workspace), budget, progress)?
    {
        surveyed.workload = workload;
    }
    let context = Context { work, ..context(&surveyed, workers, workspace, budget)? };
    progress.learn(|known| {
        known.triangles = surveyed.workload.triangles();
        if context.memory.mesh_quota == 0 && known.write == forecast::Write::Meanwhile {
            known.write = forecast::Write::After;
        }
    });
    Ok((surveyed, context))
}
