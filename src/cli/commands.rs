//! What each subcommand does. Results go to standard output or a file, words to standard error.

use std::path::{Path, PathBuf};

use bytesize::ByteSize;
use serde_json::{Value, json};

use super::args::{
    Arguments, CheckArguments, Command, CompareArguments, DensifyArguments, GenerateArguments, InfoArguments,
    PlanArguments, ReconstructArguments, RenderArguments, SimplifyArguments, TilesetArguments, ViewArguments,
    overwrite,
};
use super::failures::failure;
use super::results::{json_file, print_json, print_text, write_json};
use super::{outputs, pages, signals, tasks, view};
use crate::error::defect;
use crate::error::words::{as_options, thousands};
use crate::error::{Error, Kind, Result};
use crate::mesh::check::CheckReport;
use crate::points::attribute::Wanted;
use crate::render::page::{Chart, Document};
use crate::render::{self, ColourBy, Legend, View};
use crate::resources::workers::Workers;
use crate::run::compare::{Comparison, Distances, HeatMap, compare};
use crate::run::generate;
use crate::run::generate::densify::densify;
use crate::run::looks::{InfoReport, PlanReport};
use crate::run::observer::{Observer, watched};
use crate::run::phase::{Forecast, Phase};
use crate::run::progress::{Progress, Show, Warning};
use crate::run::{Resources, look, plan, run, simplify_file, tileset_file};
use crate::storage::atomic_file::{AtomicFile, Overwrite};
use crate::storage::steady::Steady;
use crate::system::stack::Reported;
use crate::{format, mesh};

/// Does what the arguments say.
///
/// # Errors
/// Errors of the work.
pub fn execute(arguments: Arguments, progress: &mut Progress) -> Result<Kind> {
    if let Err(error) = outputs::check(&arguments) {
        // Told in the report, too, if that is not what must not be written.
        if let Some(path) = outputs::sound_report(&arguments) {
            write_json(AtomicFile::report(&path)?, &failure(&error))?;
        }
        return Err(error);
    }
    match &arguments.command {
        None => reconstruct(&arguments.reconstruct, progress),
        Some(Command::Plan(plan)) => show_plan(&arguments, plan, progress),
        Some(Command::Tasks(arguments)) => tasks::list(arguments),
        Some(Command::Work(arguments)) => tasks::work(arguments, progress),
        Some(Command::Info(arguments)) => show_info(arguments, progress),
        Some(Command::Check(arguments)) => check(arguments, progress),
        Some(Command::Compare(arguments)) => compare_mesh(arguments, progress),
        Some(Command::Densify(arguments)) => densify_cloud(arguments, progress),
        Some(Command::Simplify(arguments)) => simplify(arguments, progress),
        Some(Command::Tileset(arguments)) => tileset(arguments, progress),
        Some(Command::View(arguments)) => show(arguments, progress),
        Some(Command::Render(arguments)) => draw(arguments, progress),
        Some(Command::Generate(arguments)) => generate_cloud(arguments, progress),
        Some(Command::Completions(arguments)) => print_text(&pages::completions(arguments.shell)).map(|()| Kind::Done),
        Some(Command::Man(arguments)) => print_text(&pages::manual(arguments.command.as_deref())?).map(|()| Kind::Done),
    }
}

/// Does what the arguments say, and gives what there is to tell as JSON; an observer hears how far it is. Nothing is printed, and no signal is looked for.
///
/// # Errors
/// Errors of the work.
pub fn outcome(arguments: &Arguments, observer: Option<&dyn Observer>) -> Result<Value> {
    outputs::check(arguments)?;
    let threads = match &arguments.command {
        None => arguments.reconstruct.resources.resources(),
        Some(Command::Plan(plan)) => plan.run.resources.resources(),
        Some(Command::Work(work)) => work.resources.resources(),
        Some(Command::Tasks(arguments)) => return value(&tasks::listed(arguments)?),
        Some(Command::Info(info)) => info.job()?.resources,
        Some(Command::Check(check)) => check.resources.resources(),
        Some(Command::Compare(compare)) => compare.job().resources,
        Some(Command::Densify(densify)) => densify.job().resources,
        Some(Command::Simplify(simplify)) => simplify.job().resources,
        Some(Command::Tileset(tileset)) => tileset.resources.resources(),
        Some(Command::View(_)) => {
            return Err(Error::Usage("a viewer is the command's own: `asra-stream view`".into()));
        }
        Some(Command::Render(render)) => render.resources.resources(),
        Some(Command::Generate(generate)) => generate.resources(),
        Some(Command::Completions(arguments)) => return value(&pages::completions(arguments.shell)),
        Some(Command::Man(arguments)) => return value(&pages::manual(arguments.command.as_deref())?),
    };
    let workers = threads.workers()?;
    watched(observer, &workers, || {
        let progress = &mut Progress::told(observer);
        match &arguments.command {
            None => {
                let arguments = &arguments.reconstruct;
                let run = |progress: &mut Progress| Ok((run(&arguments.job()?, &workers, progress)?, Kind::Done));
                value(&reported(json_file(arguments.report.as_deref())?, progress, run)?.0)
            }
            Some(Command::Plan(plan)) if plan.run.work.is_some() => {
                let tasks = tasks::planned(arguments, plan, &workers, progress)?;
                value(&tasks::Listed::of(&tasks, false, workers.threads())?)
            }
            Some(Command::Plan(arguments)) => {
                value(&PlanReport::of(&plan(&arguments.run.job()?, &workers, progress)?, workers.threads())?)
            }
            Some(Command::Work(arguments)) => tasks::done(arguments, &workers, progress).map(|_| Value::Null),
            Some(Command::Info(arguments)) => value(&InfoReport::of(&look(&arguments.job()?, &workers, progress)?)),
            Some(Command::Check(arguments)) => {
                let check = |progress: &mut Progress| checked(arguments, &workers, progress);
                value(&reported(json_file(arguments.report.as_deref())?, progress, check)?.0)
            }
            Some(Command::Compare(arguments)) => {
                let compare = |progress: &mut Progress| compared(arguments, &workers, progress);
                value(&reported(json_file(arguments.report.as_deref())?, progress, compare)?.0)
            }
            Some(Command::Densify(arguments)) => {
                let job = arguments.job();
                refuse_below(DENSIFY, job.resources.budget(), workers.threads(), &[&job.mesh, &job.cloud])?;
                let made = densify(&job, &workers, progress)?;
                Ok(json!({ "points": made.points, "centroids": made.centroids, "bytes": made.bytes }))
            }
            Some(Command::Simplify(arguments)) => {
                let simplify =
                    |progress: &mut Progress| Ok((simplify_file(&arguments.job(), &workers, progress)?, Kind::Done));
                value(&reported(json_file(arguments.report.as_deref())?, progress, simplify)?.0)
            }
            Some(Command::Tileset(arguments)) => {
                let tileset =
                    |progress: &mut Progress| Ok((tileset_file(&arguments.job()?, &workers, progress)?, Kind::Done));
                value(&reported(json_file(arguments.report.as_deref())?, progress, tileset)?.0)
            }
            Some(Command::Render(arguments)) => {
                let (path, triangles) = drawn(arguments, &workers, progress)?;
                Ok(json!({ "path": path.to_string_lossy(), "triangles": triangles }))
            }
            Some(Command::Generate(arguments)) => {
                let made = generated(arguments, &workers, progress)?;
                Ok(json!({ "points": made.points, "bytes": made.bytes }))
            }
            Some(Command::Tasks(_) | Command::View(_) | Command::Completions(_) | Command::Man(_)) => {
                unreachable!("they take no work")
            }
        }
    })
}

fn value(report: &impl serde::Serialize) -> Result<Value> {
    serde_json::to_value(report).map_err(|words| Error::Internal(words.to_string()))
}

fn reconstruct(arguments: &ReconstructArguments, progress: &mut Progress) -> Result<Kind> {
    reported(json_file(arguments.report.as_deref())?, progress, |progress| {
        let job = arguments.job()?;
        let workers = job.resources.workers()?;
        signals::stop(&workers)?;
        let report = run(&job, &workers, progress)?;
        progress.summary(&report.summary(arguments.verbose));
        if progress.show() == Show::Json {
            report.warnings.iter().for_each(|warning| progress.warn(warning));
            progress.summarise(&report.output);
        }
        Ok((report, Kind::Done))
    })
    .map(|(_, kind)| kind)
}

fn show_plan(all: &Arguments, arguments: &PlanArguments, progress: &mut Progress) -> Result<Kind> {
    let job = arguments.run.job()?;
    let workers = job.resources.workers()?;
    signals::stop(&workers)?;
    if arguments.run.work.is_some() {
        let tasks = tasks::planned(all, arguments, &workers, progress)?;
        let listed = tasks::Listed::of(&tasks, false, workers.threads())?;
        if arguments.json { print_json(&listed) } else { print_text(&listed.to_string()) }?;
        return Ok(Kind::Done);
    }
    let planned = plan(&job, &workers, progress)?;
    let report = PlanReport::of(&planned, workers.threads())?;
    if arguments.json { print_json(&report) } else { print_text(&report.to_string()) }?;
    Ok(Kind::Done)
}

fn show_info(arguments: &InfoArguments, progress: &mut Progress) -> Result<Kind> {
    let job = arguments.job()?;
    let workers = job.resources.workers()?;
    signals::stop(&workers)?;
    let report = InfoReport::of(&look(&job, &workers, progress)?);
    if arguments.json { print_json(&report) } else { print_text(&report.to_string()) }?;
    if let Some(contradiction) = report.reference_system.as_ref().and_then(|system| system.contradiction.as_ref()) {
        progress
            .warn(&Warning::new(contradiction, "name the right one with --crs, as in --crs EPSG:25832, or --crs none"));
    }
    Ok(Kind::Done)
}

fn check(arguments: &CheckArguments, progress: &mut Progress) -> Result<Kind> {
    reported(json_file(arguments.report.as_deref())?, progress, |progress| {
        let workers = arguments.resources.resources().workers()?;
        signals::stop(&workers)?;
        let (report, kind) = checked(arguments, &workers, progress)?;
        if !arguments.talk.quiet {
            print_text(&report.to_string())?;
        }
        Ok((report, kind))
    })
    .map(|(_, kind)| kind)
}

/// The memory that a command cannot do with less of, in bytes.
#[derive(Debug, Clone, Copy)]
struct Floor {
    /// Beside its workers.
    common: u64,
    /// For each worker.
    worker: u64,
    /// What small files take at most: this, and so many times their length.
    small: (u64, u64),
    what: &'static str,
}

/// As measured on meshes of 1.0 and 4.4 million triangles with 1 to 8 workers and next to nothing granted, and a tenth.
const CHECK: Floor = Floor { common: 34 << 20, worker: 29 << 19, small: (10 << 20, 8), what: "checking a mesh" };
const COMPARE: Floor = Floor { common: 24 << 20, worker: 8 << 20, small: (10 << 20, 8), what: "comparing" };
const DENSIFY: Floor =
    Floor { common: 39 << 20, worker: 9 << 19, small: (12 << 20, 8), what: "adding points to a cloud" };

/// Refuses a budget with which a command would take more than it is granted.
fn refuse_below(floor: Floor, budget: u64, threads: usize, files: &[&PathBuf]) -> Result<()> {
    let threads = threads as u64;
    let bytes: u64 = files.iter().filter_map(|file| std::fs::metadata(file).ok()).map(|there| there.len()).sum();
    let small = floor.small.0 + threads * (1 << 20) + bytes.saturating_mul(floor.small.1);
    let least = (floor.common + threads * floor.worker).min(small).next_multiple_of(1 << 20);
    if budget < least {
        return Err(Error::Budget { given: ByteSize(budget), needed: ByteSize(least), what: floor.what });
    }
    Ok(())
}

/// How much longer it takes to look for pairs of a triangle that intersect than to check the rest of it.
const INTERSECT: f64 = 8.0;

/// Checks, and writes the page that was asked for.
fn checked(arguments: &CheckArguments, workers: &Workers, progress: &mut Progress) -> Result<(CheckReport, Kind)> {
    let page = arguments.html.as_deref().map(AtomicFile::report).transpose()?;
    let steady = Steady::of([&arguments.mesh]);
    let (report, kind) = steady.settle(looked_at(arguments, workers, progress))?;
    if let Some(file) = page {
        let document = Document {
            title: title(&arguments.mesh),
            summary: report.to_string(),
            sheet: report.boundary_edges > 0,
            figures: vec![("Findings".into(), value(&report)?)],
            ..Document::default()
        };
        let shown =
            Shown { mesh: &arguments.mesh, named: &arguments.mesh, wanted: Wanted::All, colour_by: ColourBy::Auto };
        let document = steady.settle(shown.on(document, &arguments.resources.resources(), workers, progress))?;
        document.write(file)?;
    }
    Ok((report, kind))
}

/// A mesh that is shown on a page.
struct Shown<'a> {
    /// The file that is read.
    mesh: &'a Path,
    /// The mesh that it is of.
    named: &'a Path,
    /// The attributes that the page has of it.
    wanted: Wanted,
    /// What its picture's colours tell.
    colour_by: ColourBy,
}

impl Shown<'_> {
    /// Draws and packs it.
    fn on(
        &self,
        mut document: Document,
        resources: &Resources,
        workers: &Workers,
        progress: &mut Progress,
    ) -> Result<Document> {
        let workspace = resources.workspace(self.named)?.stopped_with(workers);
        // Of the budget: an eighth for a mesh that has to be converted, another for the process.
        let budget = resources.budget();
        let mesh = format::read::open_with(self.mesh, &workspace, budget / 8, &self.wanted)?;
        let options = render::Options {
            size: render::Size { width: 1200, height: 600 },
            views: vec![View::iso(), View::from_angles(125.0, 30.0)],
            colour_by: self.colour_by.clone(),
            legend: Legend::In(format::read::told_crs(self.named).and_then(|crs| crs.measure())),
            ..render::Options::default()
        };
        let least = Document::least_memory(&*mesh, &options).div_ceil(3) * 4;
        if budget < least {
            let (given, needed) = (ByteSize(budget), ByteSize(least.next_multiple_of(1 << 20)));
            return Err(Error::Budget { given, needed, what: "the page" });
        }
        let triangles = mesh.face_count();
        progress.begin(Phase::Render, Some(triangles));
        let told = &mut |part: f64| progress.set((part * triangles as f64) as u64);
        document.show((&*mesh, mesh.origin()), &options, budget / 4 * 3, (workers, &workspace), told)?;
        progress.end();
        Ok(document)
    }
}

/// A file as a page's title has it.
fn title(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

fn looked_at(arguments: &CheckArguments, workers: &Workers, progress: &mut Progress) -> Result<(CheckReport, Kind)> {
    let resources = arguments.resources.resources();
    let budget = resources.budget();
    refuse_below(CHECK, budget, workers.threads(), &[&arguments.mesh])?;
    let workspace = resources.workspace(&arguments.mesh)?.stopped_with(workers);
    let mesh = format::read::open(&arguments.mesh, &workspace, budget / 2)?;
    let triangles = mesh.face_count() as f64;
    let pairs = if arguments.no_intersections { 0.0 } else { INTERSECT * triangles };
    progress.expect(Forecast::new([(Phase::Check, triangles), (Phase::Intersect, pairs)]));
    progress.begin(Phase::Check, Some(mesh.face_count()));
    let mut report = mesh::check::check(&*mesh, budget / 2, workers, &workspace, &mut |done| progress.set(done))?;
    if !arguments.no_intersections {
        progress.begin(Phase::Intersect, Some(mesh.face_count()));
        let mut told = |done| progress.set(done);
        report.intersections = Some(mesh::check::intersections(&*mesh, budget / 2, workers, &workspace, &mut told)?);
    }
    progress.end();
    let kind = if report.is_sound(arguments.open) { Kind::Done } else { Kind::Found };
    Ok((report, kind))
}

fn compare_mesh(arguments: &CompareArguments, progress: &mut Progress) -> Result<Kind> {
    reported(json_file(arguments.report.as_deref())?, progress, |progress| {
        let workers = arguments.resources.resources().workers()?;
        signals::stop(&workers)?;
        let (found, kind) = compared(arguments, &workers, progress)?;
        if !arguments.talk.quiet {
            print_text(&found.to_string())?;
        }
        Ok((found, kind))
    })
    .map(|(_, kind)| kind)
}

fn compared(arguments: &CompareArguments, workers: &Workers, progress: &mut Progress) -> Result<(Comparison, Kind)> {
    let mut job = arguments.job();
    refuse_below(COMPARE, job.resources.budget(), workers.threads(), &[&job.mesh, &job.reference])?;
    let Some(path) = &arguments.html else { return Ok((compare(&job, workers, progress)?, Kind::Done)) };
    let file = AtomicFile::report(path)?;
    // The page shows the heat map, whether that is wanted by itself or not.
    let folder = tempfile::tempdir_in(job.resources.workspace(&job.mesh)?.dir())
        .map_err(Error::io(path, "create a folder for"))?;
    let heat = job.heatmap.get_or_insert_with(|| HeatMap {
        path: folder.path().join("distances.ply"),
        max: None,
        unit: None,
        overwrite: Overwrite::Refuse,
        told: false,
    });
    let heat = heat.path.clone();
    let found = compare(&job, workers, progress)?;
    let of = |title: &str, distances: &Distances| Chart::Histogram {
        title: title.into(),
        end: distances.histogram.end,
        counts: distances.histogram.counts.to_vec(),
        beyond: distances.histogram.beyond,
    };
    let mut charts = vec![
        of("Distances from the mesh's vertices to the reference", &found.mesh_to_reference.vertices),
        of("Distances from the mesh's centroids to the reference", &found.mesh_to_reference.centroids),
        of("Distances from the reference's points to the mesh", &found.reference_to_mesh.points),
    ];
    let centroids = found.reference_to_mesh.centroids.as_ref();
    charts.extend(centroids.map(|centroids| of("Distances from the reference's centroids to the mesh", centroids)));
    let document = Document {
        title: format!("{} and {}", title(&job.mesh), title(&job.reference)),
        summary: found.to_string(),
        charts,
        sheet: !found.mesh.closed,
        colour: Some(DISTANCE.into()),
        figures: vec![("Findings".into(), value(&found)?)],
        ..Document::default()
    };
    let distance = ColourBy::Attribute(DISTANCE.into());
    let wanted = Wanted::Named(vec![DISTANCE.into()]);
    let shown = Shown { mesh: &heat, named: &job.mesh, wanted, colour_by: distance };
    shown.on(document, &job.resources, workers, progress)?.write(file)?;
    Ok((found, Kind::Done))
}

/// What vertices of a heat map have.
const DISTANCE: &str = "distance";

fn densify_cloud(arguments: &DensifyArguments, progress: &mut Progress) -> Result<Kind> {
    let job = arguments.job();
    let workers = job.resources.workers()?;
    signals::stop(&workers)?;
    refuse_below(DENSIFY, job.resources.budget(), workers.threads(), &[&job.mesh, &job.cloud])?;
    let made = densify(&job, &workers, progress)?;
    progress.note(&format!(
        "{}: {} points and {} centroids, {}",
        arguments.output.display(),
        thousands(made.points),
        thousands(made.centroids),
        ByteSize(made.bytes)
    ));
    Ok(Kind::Done)
}

fn simplify(arguments: &SimplifyArguments, progress: &mut Progress) -> Result<Kind> {
    reported(json_file(arguments.report.as_deref())?, progress, |progress| {
        let job = arguments.job();
        let workers = job.resources.workers()?;
        signals::stop(&workers)?;
        let report = simplify_file(&job, &workers, progress)?;
        report.summary().iter().for_each(|line| progress.note(line));
        report.warnings.iter().for_each(|warning| progress.warn(warning));
        Ok((report, Kind::Done))
    })
    .map(|(_, kind)| kind)
}

fn tileset(arguments: &TilesetArguments, progress: &mut Progress) -> Result<Kind> {
    reported(json_file(arguments.report.as_deref())?, progress, |progress| {
        let job = arguments.job()?;
        let workers = job.resources.workers()?;
        signals::stop(&workers)?;
        let report = tileset_file(&job, &workers, progress)?;
        report.summary().iter().for_each(|line| progress.note(line));
        report.warnings.iter().for_each(|warning| progress.warn(warning));
        Ok((report, Kind::Done))
    })
    .map(|(_, kind)| kind)
}

fn show(arguments: &ViewArguments, progress: &mut Progress) -> Result<Kind> {
    let workers = arguments.resources.resources().workers()?;
    signals::stop(&workers)?;
    // A signal is how it ends.
    view::view(arguments, &workers, progress).map(|()| Kind::Done)
}

fn draw(arguments: &RenderArguments, progress: &mut Progress) -> Result<Kind> {
    let workers = arguments.resources.resources().workers()?;
    signals::stop(&workers)?;
    let (output, triangles) = drawn(arguments, &workers, progress)?;
    if triangles == 0 {
        progress.warn(&Warning::bare("the picture is empty: the mesh has no triangle with finite corners"));
    }
    progress.note(&format!("{}: {} triangles", output.display(), thousands(triangles)));
    Ok(Kind::Done)
}

/// Draws; gives the picture's path and the number of triangles in it.
fn drawn(arguments: &RenderArguments, workers: &Workers, progress: &mut Progress) -> Result<(PathBuf, u64)> {
    let resources = arguments.resources.resources();
    let options = arguments.options(format::read::told_crs(&arguments.mesh).and_then(|crs| crs.measure()));
    let output = arguments.output.clone().unwrap_or_else(|| arguments.mesh.with_extension("png"));
    // Of the budget: an eighth for a mesh that has to be converted, another for the process.
    let (budget, least) = (resources.budget(), render::least_memory(&options).div_ceil(3) * 4);
    if budget < least {
        let (given, needed) = (ByteSize(budget), ByteSize(least.next_multiple_of(1 << 20)));
        return Err(Error::Budget { given, needed, what: "a picture of this size" });
    }
    let file = render::picture_file(&output, overwrite(arguments.overwrite))?;
    let workspace = resources.workspace(&output)?.stopped_with(workers);
    let steady = Steady::of([&arguments.mesh]);
    let mut drawn = || {
        let mesh = format::read::open_with(&arguments.mesh, &workspace, budget / 8, &options.colour_by.wanted())?;
        progress.expect(Forecast::new([(Phase::Render, 1.0)]));
        progress.begin(Phase::Render, Some(mesh.face_count()));
        let told = &mut |done| progress.set(done);
        render::render(&*mesh, &options, budget / 4 * 3, workers, &workspace, told)
    };
    let picture = steady.settle(drawn())?;
    picture.write(file)?;
    progress.end();
    Ok((output, picture.triangles))
}

fn generate_cloud(arguments: &GenerateArguments, progress: &mut Progress) -> Result<Kind> {
    let workers = arguments.resources().workers()?;
    signals::stop(&workers)?;
    let made = generated(arguments, &workers, progress)?;
    progress.note(&format!(
        "{}: {} points, {}",
        arguments.output.display(),
        thousands(made.points),
        ByteSize(made.bytes)
    ));
    Ok(Kind::Done)
}

fn generated(arguments: &GenerateArguments, workers: &Workers, progress: &mut Progress) -> Result<generate::Summary> {
    let options = generate::Options {
        seed: arguments.seed,
        noise: arguments.noise,
        size: arguments.size,
        offset: arguments.offset,
        overwrite: overwrite(arguments.overwrite),
        ..generate::Options::new(arguments.shape, arguments.points, &arguments.output)
    };
    progress.expect(Forecast::new([(Phase::Generate, 1.0)]));
    progress.begin(Phase::Generate, Some(arguments.points));
    let made = generate::generate(&options, workers, &mut |done| progress.set(done))?;
    progress.end();
    Ok(made)
}

/// Does some work and writes its report, if one was asked for: of a failure, too.
fn reported<R: serde::Serialize>(
    file: Option<AtomicFile>,
    progress: &mut Progress,
    work: impl FnOnce(&mut Progress) -> Result<(R, Kind)>,
) -> Result<(R, Kind)> {
    let Some(file) = file else { return work(progress) };
    let _reported = Reported::to(file.last_words()?);
    match defect::caught(|| work(progress)) {
        Ok((report, kind)) => write_json(file, &report).map(|()| (report, kind)),
        Err(error) => {
            if !early(&error) || !file.path().exists() || is_report(file.path()) {
                let failure = failure(&error);
                if let Err(second) = write_json(file, &failure) {
                    progress.warn_always(&Warning::bare(as_options(&second.to_string())));
                }
            }
            Err(error)
        }
    }
}

/// Whether the work may have failed before it was found out what the report's path is.
fn early(error: &Error) -> bool {
    matches!(error.kind(), Kind::Usage | Kind::NoInput)
}

/// Whether the file is a report of this program: nothing else is replaced before the arguments are known to be in order.
fn is_report(path: &Path) -> bool {
    /// Reports are far shorter.
    const MOST_BYTES: u64 = 1 << 20;
    /// One of these is in each, and in no side-car.
    const KEYS: [&str; 4] = ["error", "parameters", "closed", "mesh_to_reference"];
    let is_short = std::fs::metadata(path).is_ok_and(|there| there.is_file() && there.len() <= MOST_BYTES);
    let text = is_short.then(|| std::fs::read(path).ok()).flatten();
    let value: Option<serde_json::Value> = text.and_then(|text| serde_json::from_slice(&text).ok());
    value.is_some_and(|value| KEYS.iter().any(|key| value.get(key).is_some()))
}
