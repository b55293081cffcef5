//! A whole run: files in, mesh file out. What the command does, as a call.

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::error::{Error, Result};
use crate::input::{Cloud, InputOptions};
use crate::machine;
use crate::mesh::{MeshHeader, MeshSource, check::check};
use crate::output::{Positions, Target};
use crate::pipeline::{self, Settings, Surveyed, context, reconstruct, rehearsed, survey_cloud};
use crate::plan::MemoryPlan;
use crate::progress::{Phase, Progress};
use crate::rehearsal::WORTH_IT;
use crate::report::{Closing, GridReport, InputReport, MemoryReport, OutputReport, Parameters, PointsReport, Report};
use crate::schedule::Workers;
use crate::spool::Workspace;
use crate::whole::Overwrite;

/// Everything a run is told.
#[derive(Debug, Clone)]
pub struct Job {
    /// Files, patterns or folders.
    pub inputs: Vec<PathBuf>,
    /// How raw files are laid out.
    pub input: InputOptions,
    /// What is made of the points.
    pub settings: Settings,
    /// The mesh file; by default beside the first input.
    pub output: Option<PathBuf>,
    /// Whether it may replace a file.
    pub overwrite: Overwrite,
    /// Which coordinates the mesh file has.
    pub positions: Positions,
    /// What the run may use.
    pub means: Means,
    /// Whether the mesh is checked before it gets its name.
    pub check: Check,
}

impl Job {
    /// A job with the command's defaults.
    pub fn new(inputs: impl IntoIterator<Item = impl Into<PathBuf>>) -> Job {
        Job {
            inputs: inputs.into_iter().map(Into::into).collect(),
            input: InputOptions::default(),
            settings: Settings::default(),
            output: None,
            overwrite: Overwrite::Refuse,
            positions: Positions::default(),
            means: Means::default(),
            check: Check::Always,
        }
    }
}

/// What a run may use. Nothing of it shows in the mesh.
#[derive(Debug, Clone, Default)]
pub struct Means {
    /// Memory, in bytes; by default a quarter of the machine's.
    pub max_memory: Option<u64>,
    /// Worker threads; by default one for each processor.
    pub threads: Option<usize>,
    /// The folder for temporary files; by default `TMPDIR`, or else the output's folder.
    pub temp_dir: Option<PathBuf>,
}

/// Whether the mesh is checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Check {
    /// It is, and nothing is written if it fails.
    #[default]
    Always,
    /// It is not.
    Never,
}

impl Means {
    /// The memory budget in bytes.
    pub fn budget(&self) -> u64 {
        self.max_memory.unwrap_or_else(|| machine::memory() / 4)
    }

    /// The worker threads.
    ///
    /// # Errors
    /// As [`Workers::new`].
    pub fn workers(&self) -> Result<Workers> {
        Workers::new(self.threads.unwrap_or_else(machine::processors))
    }

    /// The work directory, `beside` a file unless told otherwise. The system's temporary folder is no default: it is often kept in memory.
    ///
    /// # Errors
    /// As [`Workspace::new`].
    pub fn workspace(&self, beside: &Path) -> Result<Workspace> {
        let told = self.temp_dir.clone().or_else(|| std::env::var_os("TMPDIR").map(PathBuf::from));
        Workspace::new(told.unwrap_or_else(|| match beside.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
            _ => PathBuf::from("."),
        }))
    }
}

/// The default output: the first input's name with `.mesh.ply` for its extension, beside it. If that input is a pattern, its
/// first file's name counts.
pub fn default_output(inputs: &[PathBuf], cloud: &Cloud) -> PathBuf {
    let named = inputs.first().filter(|input| input.exists() && input.file_name().is_some());
    named.unwrap_or(&cloud.sources()[0].path).with_extension("mesh.ply")
}

/// What is known of a job before its first point is sorted.
#[derive(Debug)]
pub struct Planned {
    /// The files.
    pub cloud: Cloud,
    /// The survey, the grid and the faces to expect.
    pub surveyed: Surveyed,
    /// Where temporary files would go.
    pub workspace: Workspace,
    /// The plan.
    pub memory: MemoryPlan,
}

/// Surveys the input, rehearses and makes the plan; writes nothing that stays.
///
/// # Errors
/// Those of opening and reading the input, of laying the grid and of the plan.
pub fn plan(job: &Job, workers: &Workers, progress: &mut Progress) -> Result<Planned> {
    let cloud = open(job)?;
    describe(&cloud, progress);
    let surveyed = survey_cloud(&cloud, &job.settings, workers, progress)?;
    let workspace = job.means.workspace(&default_output(&job.inputs, &cloud))?;
    let budget = job.means.budget();
    let surveyed = rehearsed(surveyed, &job.settings, workers, &workspace, budget)?;
    let memory = pipeline::plan(&surveyed, workers, budget)?;
    Ok(Planned { cloud, surveyed, workspace, memory })
}

/// Looks at the input and surveys it; asks for no memory beyond that.
///
/// # Errors
/// Those of opening and reading the input and of laying the grid.
pub fn look(job: &Job, workers: &Workers, progress: &mut Progress) -> Result<(Cloud, Surveyed)> {
    let cloud = open(job)?;
    let surveyed = survey_cloud(&cloud, &job.settings, workers, progress)?;
    Ok((cloud, surveyed))
}

fn open(job: &Job) -> Result<Cloud> {
    job.settings.validate()?;
    Cloud::open(&job.inputs, &job.input)
}

/// Says how every file was understood.
fn describe(cloud: &Cloud, progress: &Progress) {
    for source in cloud.sources() {
        progress.note(&format!("{}: {}", source.path.display(), source.description));
    }
    if let Some(line) = cloud.crs_line() {
        progress.note(&format!("coordinate reference system: {line}"));
    }
}

/// No mesh takes the place of the points it is made from.
fn refuse_input_as_output(cloud: &Cloud, output: &Path) -> Result<()> {
    let same = |path: &Path| matches!((path.canonicalize(), output.canonicalize()), (Ok(a), Ok(b)) if a == b);
    match cloud.sources().iter().find(|source| same(&source.path)) {
        Some(source) => Err(Error::Usage(format!(
            "{}: is an input, which the mesh would replace; choose another --output",
            source.path.display()
        ))),
        None => Ok(()),
    }
}

/// Reconstructs: reads the input, makes the mesh, checks it, writes it.
///
/// # Errors
/// All of [`Error`]. Whatever happens, no temporary file stays, and the output exists only if it is whole.
pub fn run(job: &Job, workers: &Workers, progress: &mut Progress) -> Result<Report> {
    let start = Instant::now();
    let cloud = open(job)?;
    let output = job.output.clone().unwrap_or_else(|| default_output(&job.inputs, &cloud));
    refuse_input_as_output(&cloud, &output)?;
    // What can fail for want of room or rights fails now, not after the work.
    let target = Target::prepare(&output, job.overwrite, job.positions)?;
    let workspace = job.means.workspace(&output)?;

    describe(&cloud, progress);
    let mut surveyed = survey_cloud(&cloud, &job.settings, workers, progress)?;
    // What the box alone lets expect may be too much.
    if surveyed.survey.points >= WORTH_IT || pipeline::plan(&surveyed, workers, job.means.budget()).is_err() {
        surveyed = rehearsed(surveyed, &job.settings, workers, &workspace, job.means.budget())?;
    }
    let context = context(&surveyed, workers, &workspace, job.means.budget())?;
    let made = reconstruct(&cloud, &surveyed, &job.settings, &context, progress)?;

    let mut checked = None;
    if job.check == Check::Always {
        progress.begin(Phase::Check, Some(made.mesh.face_count()));
        let budget = made.memory.working;
        let report = check(&made.mesh, budget, workers, &workspace, &mut |done| progress.set(done))?;
        let open = job.settings.open.is_some_and(|open| open.base.is_none());
        if !report.is_sound(open) {
            return Err(Error::CheckFailed(report.to_string()));
        }
        checked = Some(report);
    }
    let elements = made.mesh.vertex_count() + made.mesh.face_count();
    progress.begin(Phase::Write, Some(elements));
    let header = header(&cloud, &surveyed, job, &made);
    let written = target.write(&made.mesh, &header, workers, &mut |done| progress.set(done))?;
    progress.end();

    Ok(Report {
        version: env!("CARGO_PKG_VERSION"),
        inputs: input_reports(&cloud),
        parameters: Parameters::of(&job.settings),
        points: PointsReport::of(&cloud, &surveyed),
        grid: GridReport::of(&surveyed.grid),
        closing: Closing::of(&made),
        vertices: made.counts,
        check: checked,
        output: OutputReport {
            path: output,
            bytes: written.bytes,
            vertices: made.mesh.vertex_count(),
            triangles: made.mesh.face_count(),
            origin: made.origin,
        },
        seconds: progress.times().iter().map(|(phase, time)| (*phase, time.as_secs_f64())).collect(),
        seconds_total: start.elapsed().as_secs_f64(),
        memory: MemoryReport {
            plan: made.memory,
            peak_resident: machine::peak_resident(),
            peak_disk: workspace.peak_on_disk(),
        },
    })
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

/// What the mesh file says of its making: nothing that depends on means, so that the same points give the same bytes.
fn header(cloud: &Cloud, surveyed: &Surveyed, job: &Job, made: &crate::pipeline::Reconstruction) -> MeshHeader {
    let grid = &surveyed.grid;
    let surface = job.settings.surface;
    let words = |value: &dyn std::fmt::Debug| format!("{value:?}").to_lowercase();
    let mut header = MeshHeader {
        crs: cloud.crs().cloned(),
        origin: made.origin,
        comments: vec![
            format!("asra-stream {}", env!("CARGO_PKG_VERSION")),
            format!("cell_size {} slices {}", grid.cell_size(), grid.cells()[1]),
            format!(
                "axis {} closing_radius {} smooth {} diagonals {} fit {}",
                grid.axis().letter(),
                made.closing.rho(),
                surface.smooth,
                words(&surface.diagonals),
                words(&surface.fit)
            ),
        ],
    };
    if let Some(open) = &job.settings.open {
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
