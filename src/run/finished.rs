//! From a finished run to its report: what the check found decides whether there is one.

use crate::error::{Error, Result};
use crate::input::{Cloud, Source};
use crate::mesh::check::CheckReport;
use crate::resources::machine;
use crate::run::advice;
use crate::run::bare_earth::GroundReport;
use crate::run::progress::Progress;
use crate::run::report::{
    Closing, FitReport, GridReport, InputReport, MemoryReport, OutputReport, Parameters, PointsReport, Report,
};
use crate::run::surface::Reconstructed;
use crate::run::surveyed::Surveyed;
use crate::settings::Settings;
use crate::simplify::Figures;
use crate::storage::spool::Workspace;

/// A mesh that is not what was promised is nobody's.
///
/// # Errors
/// [`Error::CheckFailed`].
pub(crate) fn refuse_unsound(report: &CheckReport, settings: &Settings) -> Result<()> {
    if report.is_sound(settings.may_end()) { Ok(()) } else { Err(Error::CheckFailed(report.to_string())) }
}

/// A finished run, to be reported on.
pub(crate) struct Finished<'a> {
    /// The input.
    pub cloud: &'a Cloud<'a>,
    /// What the survey found.
    pub surveyed: &'a Surveyed,
    /// How the ground was told, if that alone counts.
    pub ground: Option<GroundReport>,
    /// What was asked for.
    pub settings: &'a Settings,
    /// The mesh, and how it came to be.
    pub made: &'a Reconstructed,
    /// How many triangles were left out, if any were to be.
    pub simplification: Option<Figures>,
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
    let Finished {
        cloud,
        surveyed,
        ground,
        settings,
        made,
        simplification,
        check,
        output,
        progress,
        seconds,
        workspace,
    } = run;
    let mut report = Report {
        version: env!("CARGO_PKG_VERSION"),
        inputs: input_reports(cloud),
        parameters: Parameters::of(settings),
        points: PointsReport::of(cloud, surveyed),
        ground,
        grid: GridReport::of(&surveyed.grid),
        points_to_a_cell: surveyed.survey.points as f64 / made.occupied as f64,
        closing: Closing {
            steady: surveyed.upsampled.as_ref().map(|upsampled| upsampled.is_steady),
            ..Closing::of(made, &surveyed.grid)
        },
        fit: FitReport { onto: made.fit, shell: made.shell },
        vertices: made.counts,
        seams: made.seams.clone(),
        trimmed: made.trimmed,
        simplification,
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
        foreseen: advice::of_survey(surveyed),
    };
    report.judge();
    report
}

/// The files of a cloud, for the report.
pub fn input_reports(cloud: &Cloud) -> Vec<InputReport> {
    let report = |source: &Source| InputReport {
        path: source.path.clone(),
        format: source.format,
        layout: source.description.clone(),
        bytes: source.bytes,
        remark: source.remark.clone(),
    };
    cloud.sources().iter().map(report).collect()
}
