//! What each subcommand does. Results go to standard output or a file, words to standard error.

use std::io::Write;
use std::path::Path;

use bytesize::ByteSize;

use super::args::{
    Arguments, CheckArguments, Command, CompareArguments, DensifyArguments, GenerateArguments, InfoArguments,
    PlanArguments, ReconstructArguments, RenderArguments, overwrite,
};
use super::{exit_code, outputs, signals};
use crate::compare::compare;
use crate::defect;
use crate::densify::densify;
use crate::error::{Error, Kind, Result};
use crate::generate;
use crate::mesh;
use crate::mesh::check::CheckReport;
use crate::pipeline::Fineness;
use crate::plan::MemoryPlan;
use crate::progress::{Phase, Progress, Show, thousands};
use crate::render;
use crate::report::{GridReport, short};
use crate::run::{Means, Planned, look, plan, run};
use crate::steady::Steady;
use crate::survey::sampling_distance;
use crate::whole::WholeFile;

/// Does what the arguments say.
///
/// # Errors
/// Those of the work.
pub fn execute(arguments: Arguments) -> Result<Kind> {
    if let Err(error) = outputs::check(&arguments) {
        // Told in the report, too, if that is not what must not be written.
        if let Some(path) = outputs::sound_report(&arguments) {
            write_json(WholeFile::report(&path)?, &error.failure(exit_code(&error)))?;
        }
        return Err(error);
    }
    match &arguments.command {
        None => reconstruct(&arguments.reconstruct),
        Some(Command::Plan(arguments)) => show_plan(arguments),
        Some(Command::Info(arguments)) => show_info(arguments),
        Some(Command::Check(arguments)) => check(arguments),
        Some(Command::Compare(arguments)) => compare_mesh(arguments),
        Some(Command::Densify(arguments)) => densify_cloud(arguments),
        Some(Command::Render(arguments)) => draw(arguments),
        Some(Command::Generate(arguments)) => generate_cloud(arguments),
    }
}

fn show(quiet: bool) -> Show {
    if quiet { Show::Nothing } else { Show::fitting() }
}

fn reconstruct(arguments: &ReconstructArguments) -> Result<Kind> {
    reported(json_file(arguments.report.as_deref())?, || {
        let job = arguments.job()?;
        let workers = job.means.workers()?;
        signals::stop(&workers)?;
        let mut progress = Progress::new(show(arguments.quiet));
        let report = run(&job, &workers, &mut progress)?;
        progress.note(&report.to_string());
        Ok((report, Kind::Done))
    })
}

fn show_plan(arguments: &PlanArguments) -> Result<Kind> {
    let job = arguments.job()?;
    let workers = job.means.workers()?;
    signals::stop(&workers)?;
    let mut progress = Progress::new(Show::fitting());
    let Planned { cloud, surveyed, workspace, memory } = plan(&job, &workers, &mut progress)?;
    let load = &surveyed.load;
    let least = MemoryPlan::least(load, workers.threads());
    let in_memory = |quota: u64, bytes: u64| if quota >= bytes { "in memory" } else { "on disk" };
    let unpacked = cloud.unpacked();
    let unpacked_then = unpacked + cloud.unpacked_later();
    let mut lines: Vec<(&str, String)> = Vec::new();
    lines.extend(cloud.crs_line().map(|line| ("reference system", line)));
    lines.extend([
        ("points", thousands(load.points)),
        ("grid", GridReport::of(&surveyed.grid).to_string()),
        ("triangles", format!("about {}", thousands(load.triangles()))),
        ("threads", memory.threads.to_string()),
        ("memory", format!("{} at most, of {} granted", ByteSize(memory.predicted), ByteSize(memory.budget))),
        ("least memory", ByteSize(least.next_multiple_of(1 << 20)).to_string()),
        (
            "temporary disk",
            // What is unpacked lies there already.
            format!(
                "{} at most, of {} free",
                ByteSize(memory.predicted_disk + unpacked_then),
                ByteSize(workspace.available()? + unpacked)
            ),
        ),
        ("temporary folder", workspace.dir().display().to_string()),
        ("points kept", in_memory(memory.buckets_quota, load.bucket_bytes()).to_owned()),
        ("mesh kept", in_memory(memory.mesh_quota, load.mesh_bytes()).to_owned()),
        ("bucket buffers", format!("{} each", ByteSize(memory.bucket_buffer))),
        ("in flight", format!("{} blocks, {} chunks of slices", memory.blocks_in_flight, memory.chunks_in_flight)),
        ("fitted at once", format!("{} points of a slab", thousands(memory.piece_points as u64))),
    ]);
    if unpacked_then > 0 {
        let at = lines.iter().position(|(name, _)| *name == "temporary folder").unwrap_or(0);
        lines.insert(at, ("unpacked input", format!("{}, part of that", ByteSize(unpacked_then))));
    }
    print(&lines)
}

fn show_info(arguments: &InfoArguments) -> Result<Kind> {
    let job = arguments.job()?;
    let workers = job.means.workers()?;
    signals::stop(&workers)?;
    let mut progress = Progress::new(Show::fitting());
    let (cloud, surveyed) = look(&job, &workers, &mut progress)?;
    let distance = match (job.settings.fineness, surveyed.sampling) {
        (Fineness::Sampling, measured) => measured,
        _ => sampling_distance(&cloud, &surveyed.survey, &workers, 2 * workers.threads())?,
    };
    let survey = &surveyed.survey;
    let triple = |values: [f64; 3], word: fn(f64) -> String| values.map(word).join("  ");
    let mut lines: Vec<(&str, String)> = Vec::new();
    for (source, stations) in cloud.sources().iter().zip(cloud.stations()) {
        lines.push(("file", format!("{}, {}", source.path.display(), ByteSize(source.bytes))));
        lines.push(("layout", source.description.clone()));
        lines.extend(stations.iter().map(|place| ("scanned from", place.map(|c| c.to_string()).join("  "))));
    }
    lines.extend(cloud.crs_line().map(|line| ("reference system", line)));
    lines.extend([
        ("points", thousands(survey.points)),
        ("dropped", format!("{} (not finite)", thousands(survey.dropped))),
        ("left out", format!("{} (by filters)", thousands(survey.filtered))),
        (
            "attributes",
            if cloud.schema().attributes().is_empty() { "none".to_owned() } else { cloud.schema().to_string() },
        ),
        ("smallest", triple(survey.bounds.min, |v| v.to_string())),
        ("largest", triple(survey.bounds.max, |v| v.to_string())),
        ("extent", triple(survey.bounds.extent(), short)),
        ("grid", GridReport::of(&surveyed.grid).to_string()),
        ("sampling distance", distance.map_or_else(|| "none: a single place".to_owned(), short)),
    ]);
    print(&lines)
}

fn check(arguments: &CheckArguments) -> Result<Kind> {
    let steady = Steady::of([&arguments.mesh]);
    reported(json_file(arguments.report.as_deref())?, || steady.settle(checked(arguments)))
}

fn checked(arguments: &CheckArguments) -> Result<(CheckReport, Kind)> {
    let means = arguments.means.means();
    let workers = means.workers()?;
    signals::stop(&workers)?;
    let budget = means.budget();
    let workspace = means.workspace(&arguments.mesh)?.stopped_with(&workers);
    let mesh = mesh::read::open(&arguments.mesh, &workspace, budget / 2)?;
    let mut progress = Progress::new(show(arguments.quiet));
    progress.begin(Phase::Check, Some(mesh.face_count()));
    let mut report = mesh::check::check(&*mesh, budget / 2, &workers, &workspace, &mut |done| progress.set(done))?;
    if !arguments.no_intersections {
        progress.begin(Phase::Intersect, Some(mesh.face_count()));
        let mut told = |done| progress.set(done);
        report.intersections = Some(mesh::check::intersections(&*mesh, budget / 2, &workers, &workspace, &mut told)?);
    }
    progress.end();
    if !arguments.quiet {
        print_text(&report.to_string())?;
    }
    let kind = if report.is_sound(arguments.open) { Kind::Done } else { Kind::Found };
    Ok((report, kind))
}

fn compare_mesh(arguments: &CompareArguments) -> Result<Kind> {
    reported(json_file(arguments.report.as_deref())?, || {
        let job = arguments.job();
        let workers = job.means.workers()?;
        signals::stop(&workers)?;
        let mut progress = Progress::new(show(arguments.quiet));
        let found = compare(&job, &workers, &mut progress)?;
        if !arguments.quiet {
            print_text(&found.to_string())?;
        }
        Ok((found, Kind::Done))
    })
}

fn densify_cloud(arguments: &DensifyArguments) -> Result<Kind> {
    let job = arguments.job();
    let workers = job.means.workers()?;
    signals::stop(&workers)?;
    let mut progress = Progress::new(show(arguments.quiet));
    let made = densify(&job, &workers, &mut progress)?;
    progress.note(&format!(
        "{}: {} points and {} centroids, {}",
        arguments.output.display(),
        thousands(made.points),
        thousands(made.centroids),
        ByteSize(made.bytes)
    ));
    Ok(Kind::Done)
}

fn draw(arguments: &RenderArguments) -> Result<Kind> {
    let means = arguments.means.means();
    let workers = means.workers()?;
    signals::stop(&workers)?;
    let options = arguments.options(mesh::read::told_crs(&arguments.mesh).and_then(|crs| crs.measure()));
    let output = arguments.output.clone().unwrap_or_else(|| arguments.mesh.with_extension("png"));
    // Of the budget: an eighth for a mesh that has to be converted, another for the process.
    let (budget, least) = (means.budget(), render::least_memory(&options).div_ceil(3) * 4);
    if budget < least {
        let (given, needed) = (ByteSize(budget), ByteSize(least.next_multiple_of(1 << 20)));
        return Err(Error::Budget { given, needed, what: "a picture of this size" });
    }
    let file = render::picture_file(&output, overwrite(arguments.overwrite))?;
    let workspace = means.workspace(&output)?.stopped_with(&workers);
    let mut progress = Progress::new(show(arguments.quiet));
    let steady = Steady::of([&arguments.mesh]);
    let mut drawn = || {
        let mesh = mesh::read::open_with(&arguments.mesh, &workspace, budget / 8, &options.colour_by.wanted())?;
        progress.begin(Phase::Render, Some(mesh.face_count()));
        let told = &mut |done| progress.set(done);
        render::render(&*mesh, &options, budget / 4 * 3, &workers, &workspace, told)
    };
    let picture = steady.settle(drawn())?;
    picture.write(file)?;
    progress.end();
    if picture.triangles == 0 {
        progress.note("the picture is empty: the mesh has no triangle with finite corners");
    }
    progress.note(&format!("{}: {} triangles", output.display(), thousands(picture.triangles)));
    Ok(Kind::Done)
}

fn generate_cloud(arguments: &GenerateArguments) -> Result<Kind> {
    let means = Means { threads: arguments.threads.map(usize::from), ..Means::default() };
    let workers = means.workers()?;
    signals::stop(&workers)?;
    let options = generate::Options {
        seed: arguments.seed,
        noise: arguments.noise,
        size: arguments.size,
        offset: arguments.offset.0,
        overwrite: overwrite(arguments.overwrite),
        ..generate::Options::new(arguments.shape, arguments.points, &arguments.output)
    };
    let mut progress = Progress::new(show(arguments.quiet));
    progress.begin(Phase::Generate, Some(arguments.points));
    let made = generate::generate(&options, &workers, &mut |done| progress.set(done))?;
    progress.end();
    progress.note(&format!(
        "{}: {} points, {}",
        arguments.output.display(),
        thousands(made.points),
        ByteSize(made.bytes)
    ));
    Ok(Kind::Done)
}

/// The report's file, created before the work.
fn json_file(path: Option<&Path>) -> Result<Option<WholeFile>> {
    path.map(WholeFile::report).transpose()
}

/// Does some work and writes its report, if one was asked for: of a failure, too.
fn reported<R: serde::Serialize>(file: Option<WholeFile>, work: impl FnOnce() -> Result<(R, Kind)>) -> Result<Kind> {
    let Some(file) = file else { return Ok(work()?.1) };
    match defect::caught(work) {
        Ok((report, kind)) => write_json(file, &report).map(|()| kind),
        Err(error) => {
            if !early(&error) || !file.path().exists() || is_report(file.path()) {
                let failure = error.failure(exit_code(&error));
                if let Err(second) = write_json(file, &failure) {
                    let _ = writeln!(std::io::stderr(), "asra-stream: {second}");
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

fn write_json(file: WholeFile, report: &impl serde::Serialize) -> Result<()> {
    let path = file.path().to_path_buf();
    let write = || -> std::io::Result<()> {
        let mut out = file.file();
        serde_json::to_writer_pretty(&mut out, report)?;
        writeln!(out)
    };
    write().map_err(Error::io(path, "write the report"))?;
    file.finish()
}

fn print(lines: &[(&str, String)]) -> Result<Kind> {
    let width = lines.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    let text: Vec<String> = lines.iter().map(|(name, value)| format!("{name:<width$}  {value}")).collect();
    print_text(&text.join("\n"))?;
    Ok(Kind::Done)
}

/// To standard output; a reader that has gone away is no failure.
fn print_text(text: &str) -> Result<()> {
    match writeln!(std::io::stdout(), "{text}") {
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        result => result.map_err(Error::io("standard output", "write")),
    }
}
