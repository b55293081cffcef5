//! Fewer triangles: as a step of a run, and of a mesh file.

use std::path::PathBuf;
use std::time::Instant;

use bytesize::ByteSize;

use crate::error::words::{short, thousands};
use crate::error::{Error, Result};
use crate::format;
use crate::format::write::{Format, Positions, Target};
use crate::mesh::check::{CheckReport, check, intersections};
use crate::mesh::spool::{Frame, MeshSpool};
use crate::mesh::{MeshHeader, MeshSource};
use crate::points::Precision;
use crate::points::attribute::{Schema, Wanted};
use crate::points::bounds::Bounds;
use crate::points::unit::{Unit, measured};
use crate::resources::workers::Workers;
use crate::run::job::Resources;
use crate::run::phase::{Forecast, Phase};
use crate::run::progress::{Progress, Warning};
use crate::run::saved_mesh::Means;
use crate::settings::simplification::{Borders, Simplification, Tolerance};
use crate::simplify::{Extent, Figures, Given, Options, simplify};
use crate::storage::atomic_file::Overwrite;
use crate::storage::spool::Workspace;
use crate::storage::steady::Steady;

/// The attribute that tells classes.
const CLASSIFICATION: &str = "classification";

/// How long a cell is, and the longest side of the box.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lengths {
    pub cell: Option<f64>,
    pub longest: f64,
}

/// What the settings ask of a mesh.
pub(super) fn options(asked: &Simplification, lengths: Lengths, schema: &Schema) -> Result<Options> {
    let tolerance = asked.tolerance.map(|tolerance| tolerance.length(lengths.cell, lengths.longest)).transpose()?;
    let there = schema.attributes().iter().any(|attribute| attribute.name == CLASSIFICATION);
    let borders = (asked.keep_borders == Borders::Classification && there).then(|| CLASSIFICATION.to_owned());
    let (colours, moves) = (asked.keep_colours, asked.move_vertices);
    Ok(Options { tolerance, most: asked.max_triangles, borders, colours, moves })
}

/// The step that leaves out triangles, as the work folder names it, and what its passes' names begin with.
const STEP: &str = "simplified";
const PASS: &str = "simplify";

/// The mesh of a run with fewer triangles, and how many.
///
/// # Errors
/// Those of [`simplify`].
pub(super) fn simplified(
    mesh: &MeshSpool,
    asked: &Simplification,
    lengths: Lengths,
    by: Means<'_>,
    progress: &mut Progress,
) -> Result<(MeshSpool, Figures)> {
    let Means { workers, workspace, kept, .. } = by;
    let options = options(asked, lengths, mesh.schema())?;
    let means = (workers, workspace);
    // Within a tolerance it is kept pass by pass; a search for it as a whole.
    let whole = kept.filter(|_| options.most.is_some());
    if let Some(kept) = whole
        && let Some(found) = kept.found(STEP, (mesh.precision(), mesh.schema()), means)?
    {
        return Ok(found);
    }
    let (fewer, figures) = passes(mesh, &options, PASS, by, progress)?;
    match whole {
        None => Ok((fewer, figures)),
        Some(kept) => Ok((kept.keep(STEP, &fewer, figures, means, by.in_flight())?, figures)),
    }
}

/// Simplifies a mesh as a step of a run. Passes are kept, where they can be, under names that begin with `name`.
///
/// # Errors
/// Those of [`simplify`].
pub(super) fn passes(
    mesh: &MeshSpool,
    options: &Options,
    name: &str,
    Means { memory: budget, workers, workspace, kept }: Means<'_>,
    progress: &mut Progress,
) -> Result<(MeshSpool, Figures)> {
    progress.begin(Phase::Simplify, Some(mesh.face_count()));
    let triangles = mesh.face_count() as f64;
    let passes = kept.and_then(|kept| kept.passes(name));
    let kept = passes.as_ref().map(|(work, name)| (*work, name.as_str()));
    let given = Given { mesh, options, budget, workers, workspace, kept };
    simplify(given, &mut |part| progress.set((part * triangles) as u64))
}

/// What is to be told where there are more triangles than were asked for.
pub(super) fn warning(figures: &Figures) -> Option<Warning> {
    let most = figures.most.filter(|most| *most < figures.after)?;
    let (after, most) = (thousands(figures.after), thousands(most));
    let within = figures.asked.map_or_else(
        || "with fewer it would lose a piece or a hole, or run through itself".to_owned(),
        |asked| format!("no more can go within {}", short(asked)),
    );
    Some(Warning::bare(format!("{after} triangles are left, where {most} were asked for: {within}")))
}

/// A mesh file to be simplified.
#[derive(Debug, Clone)]
pub struct SimplifyJob {
    /// The mesh: PLY, STL, OBJ or GLB.
    pub mesh: PathBuf,
    /// The file: .ply, .stl, .obj or .glb.
    pub output: PathBuf,
    /// Whether it may replace a file.
    pub overwrite: Overwrite,
    /// What is asked.
    pub asked: Simplification,
    /// The unit of a tolerance that is a length, where it is not the mesh's.
    pub unit: Option<Unit>,
    /// Whether a mesh is taken that is no manifold, or intersects itself.
    pub unsound: bool,
    /// Whether the mesh is not looked at for triangles that intersect.
    pub unseen: bool,
    /// What the work may use. Nothing of it shows in the file.
    pub resources: Resources,
}

/// What was made of a mesh file.
#[derive(Debug, Clone, serde::Serialize)]
pub struct SimplifyReport {
    /// The program's version.
    pub version: &'static str,
    /// The mesh.
    #[serde(serialize_with = "crate::error::words::told")]
    pub mesh: PathBuf,
    /// The file that was written.
    #[serde(serialize_with = "crate::error::words::told")]
    pub output: PathBuf,
    /// Its length.
    pub bytes: u64,
    /// Triangles, and how far the surface is from the one before.
    pub simplification: Figures,
    /// What the check found before.
    pub before: CheckReport,
    /// What it found after.
    pub after: CheckReport,
    /// Seconds in all.
    pub seconds_total: f64,
    /// What may be wrong.
    pub warnings: Vec<Warning>,
}

impl SimplifyReport {
    /// What is told on standard error, line by line.
    pub fn summary(&self) -> Vec<String> {
        let Figures { before, after, reached, .. } = self.simplification;
        let share = 100.0 * after as f64 / before.max(1) as f64;
        vec![
            format!("output   {}, {}, in {:.2} s", self.output.display(), ByteSize(self.bytes), self.seconds_total),
            format!("mesh     {} triangles of {} ({share:.1} %)", thousands(after), thousands(before)),
            format!("moved    no place of either surface is farther than {} from the other", short(reached)),
        ]
    }
}

/// Simplifies a mesh file. The file that is written has the mesh's coordinates and attributes, its reference system and the size of its cells, as far as the
/// format has room for them.
///
/// # Errors
/// Those of reading and writing meshes, and of [`simplify`]; [`Error::Malformed`] for a mesh that is no manifold or intersects itself, unless it is to be taken.
pub fn simplify_file(job: &SimplifyJob, workers: &Workers, progress: &mut Progress) -> Result<SimplifyReport> {
    let start = Instant::now();
    job.asked.validate()?;
    let steady = Steady::of([&job.mesh]);
    let positions = Positions::of(&job.output, None)?;
    let target = Target::prepare(&job.output, job.overwrite, positions)?;
    let workspace = job.resources.workspace(&job.output)?.stopped_with(workers);
    let budget = job.resources.budget();
    let opened = steady.settle(format::read::open_with(&job.mesh, &workspace, budget / 8, &Wanted::All))?;
    let triangles = opened.face_count() as f64;
    let looking = if job.unseen { 0.0 } else { 8.0 * triangles };
    progress.expect(Forecast::new([
        (Phase::Check, triangles),
        (Phase::Intersect, looking),
        (Phase::Simplify, 30.0 * triangles),
        (Phase::Write, 0.1 * triangles),
    ]));
    let done = checked_and_simplified(job, &*opened, positions, budget, (workers, &workspace), progress);
    let (mesh, header, mut report) = steady.settle(done)?;
    progress.begin(Phase::Write, Some(mesh.vertex_count() + mesh.face_count()));
    let written = target.fill(&mesh, &header, workers, &mut |done| progress.set(done))?.finish()?;
    progress.end();
    report.bytes = written.bytes;
    report.seconds_total = start.elapsed().as_secs_f64();
    Ok(report)
}

fn checked_and_simplified(
    job: &SimplifyJob,
    opened: &dyn MeshSource,
    positions: Positions,
    budget: u64,
    (workers, workspace): (&Workers, &Workspace),
    progress: &mut Progress,
) -> Result<(MeshSpool, MeshHeader, SimplifyReport)> {
    let share = budget / 8 * 7;
    let least = Extent::of(opened, job.asked.move_vertices, job.asked.keep_colours.is_some()).least_memory();
    if share < least {
        let needed = ByteSize((least * 8).div_ceil(7).next_multiple_of(1 << 20));
        return Err(Error::Budget { given: ByteSize(budget), needed, what: "simplifying the mesh" });
    }
    progress.begin(Phase::Check, Some(opened.face_count()));
    let mut before = check(opened, share / 2, workers, workspace, &mut |done| progress.set(done))?;
    if opened.face_count() == 0 || before.nonfinite_vertices > 0 {
        let found =
            format!("{} triangles, {} vertices that are not finite", before.triangles, before.nonfinite_vertices);
        return Err(Error::malformed(&job.mesh, "the mesh", "triangles with finite corners", found));
    }
    if !job.unseen {
        progress.begin(Phase::Intersect, Some(opened.face_count()));
        before.intersections =
            Some(intersections(opened, share / 2, workers, workspace, &mut |done| progress.set(done))?);
    }
    let mut warnings = Vec::new();
    if !before.is_sound(true) {
        let found = what_is_wrong(&before);
        if !job.unsound {
            let expected = "an oriented manifold whose triangles do not intersect; `unsound` takes it as it is";
            return Err(Error::malformed(&job.mesh, "the mesh", expected, found));
        }
        warnings.push(Warning::bare(format!("{}: {found}; such places stay as they are", job.mesh.display())));
    }
    // What is written is what is simplified: formats of 32 bits round coordinates, after an origin is taken off.
    let narrow =
        matches!(Format::from_path(&job.output)?, Format::Stl | Format::Glb) && opened.precision() == Precision::Double;
    let [min, max] = before.bounds.unwrap_or_default();
    let bounds = Bounds { min, max };
    let framed = narrow.then(|| Framed::about(opened, &bounds));
    let mesh: &dyn MeshSource = framed.as_ref().map_or(opened, |framed| framed);

    let crs = format::read::told_crs(&job.mesh);
    let measure = crs.as_ref().and_then(|crs| crs.measure());
    let asked = match (job.asked.tolerance, job.unit) {
        (Some(Tolerance::Length(length)), Some(unit)) if measure.is_none() => {
            let unknown = "the unit of the mesh is not known; give a plain number, in its units";
            return Err(Error::setting("simplify", format!("`simplify` {length}{unit}: {unknown}")));
        }
        (Some(Tolerance::Length(length)), Some(unit)) => {
            let length = measured("simplify", length, unit, measure)?;
            Simplification { tolerance: Some(Tolerance::Length(length)), ..job.asked }
        }
        _ => job.asked,
    };
    let cell = format::read::told_cell_size(&job.mesh);
    let longest = (0..3).map(|a| bounds.max[a] - bounds.min[a]).fold(0.0, f64::max);
    let options = options(&asked, Lengths { cell, longest }, mesh.schema())?;
    progress.begin(Phase::Simplify, Some(mesh.face_count()));
    let triangles = mesh.face_count() as f64;
    let told = &mut |part: f64| progress.set((part * triangles) as u64);
    let given = Given { mesh, options: &options, budget: share, workers, workspace, kept: None };
    let (simplified, figures) = simplify(given, told)?;
    progress.begin(Phase::Check, Some(simplified.face_count()));
    let after = check(&simplified, share / 2, workers, workspace, &mut |done| progress.set(done))?;
    refuse_changed(&before, &after)?;
    warnings.extend(warning(&figures));

    let mut comments = vec![format!("asra-stream {}", env!("CARGO_PKG_VERSION"))];
    comments.extend(cell.map(|cell| format!("cell_size {cell}")));
    comments.push(format!("simplified triangles {} of {} within {}", figures.after, figures.before, figures.reached));
    let header =
        MeshHeader { origin: mesh.origin(), comments, crs, sheet: before.boundary_edges > 0, constant: Vec::new() };
    let (mesh, output) = (job.mesh.clone(), job.output.clone());
    let version = env!("CARGO_PKG_VERSION");
    let simplification = figures;
    // A mesh of double precision in a format of 32 bits has an origin, which the format tells.
    debug_assert!(positions == Positions::Absolute || !narrow || header.origin.iter().all(|c| c.is_finite()));
    let report =
        SimplifyReport { version, mesh, output, bytes: 0, simplification, before, after, seconds_total: 0.0, warnings };
    Ok((simplified, header, report))
}

/// What keeps a mesh from being sound, with counts.
fn what_is_wrong(report: &CheckReport) -> String {
    let pairs = report.intersections.as_ref().map_or(0, |found| found.pairs);
    let counts = [
        (report.nonmanifold_edges, "non-manifold edges"),
        (report.nonmanifold_vertices, "non-manifold vertices"),
        (report.inconsistent_edges, "inconsistently oriented edges"),
        (report.degenerate_triangles, "triangles that name a vertex twice"),
        (pairs, "pairs of triangles that intersect"),
    ];
    let there = counts.iter().filter(|(count, _)| *count > 0);
    there.map(|(count, what)| format!("{} {what}", thousands(*count))).collect::<Vec<_>>().join(", ")
}

/// What must not change has not; a bug otherwise.
fn refuse_changed(before: &CheckReport, after: &CheckReport) -> Result<()> {
    let kept = |report: &CheckReport| {
        (report.closed, report.oriented, report.manifold, report.components, report.genus, report.boundary_loops)
    };
    if before.manifold && kept(before) != kept(after) {
        return Err(Error::CheckFailed(format!("before simplifying:\n{before}\nafter:\n{after}")));
    }
    Ok(())
}

/// A mesh in single precision, about an origin of its own.
struct Framed<'a> {
    mesh: &'a dyn MeshSource,
    frame: Frame,
}

impl<'a> Framed<'a> {
    fn about(mesh: &'a dyn MeshSource, bounds: &Bounds) -> Framed<'a> {
        // The middle, in whole units where the box is larger than one: numbers that are written without loss.
        let origin = std::array::from_fn(|a| bounds.min[a].midpoint(bounds.max[a]).round());
        Framed { mesh, frame: Frame { origin, precision: Precision::Single } }
    }
}

impl MeshSource for Framed<'_> {
    fn vertex_count(&self) -> u64 {
        self.mesh.vertex_count()
    }

    fn face_count(&self) -> u64 {
        self.mesh.face_count()
    }

    fn origin(&self) -> [f64; 3] {
        let own = self.mesh.origin();
        std::array::from_fn(|a| own[a] + self.frame.origin[a])
    }

    fn precision(&self) -> Precision {
        self.frame.precision
    }

    fn read_vertices(&self, first: u64, out: &mut [[f64; 3]]) -> Result<()> {
        self.mesh.read_vertices(first, out)?;
        out.iter_mut().for_each(|vertex| *vertex = self.frame.place(*vertex));
        Ok(())
    }

    fn read_faces(&self, first: u64, out: &mut [[u32; 3]]) -> Result<()> {
        self.mesh.read_faces(first, out)
    }

    fn schema(&self) -> &Schema {
        self.mesh.schema()
    }

    fn read_attribute(&self, number: usize, first: u64, out: &mut [f64]) -> Result<()> {
        self.mesh.read_attribute(number, first, out)
    }
}
