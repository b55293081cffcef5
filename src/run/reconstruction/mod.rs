//! A reconstruction as a call: points from memory, from a source of one's own or from files; a mesh in memory.

mod input;
mod mesh;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use crate::error::{Error, Result};
use crate::format::write::Positions;
use crate::input::{Arrays, Cloud, PointSlice, PointSource, Values};
use crate::mesh::MeshSource;
use crate::mesh::check::check_near;
use crate::points::attribute::Wanted;
use crate::points::bounds::Axis;
use crate::points::clip::Clip;
use crate::resources::workers::Workers;
use crate::run::bare_earth::{Beside, bare_earth, budget_beside, of_whole_budget};
use crate::run::finished::{Finished, refuse_unsound, report};
use crate::run::forecast::{self, Known};
use crate::run::job::{Check, Job};
use crate::run::mesh_header::header_of;
use crate::run::observer::{Observer, watched};
use crate::run::phase::Phase;
use crate::run::pipeline::reconstruct;
use crate::run::prepare::{Passes, describe, known_of_points, open_all, planned, surveyed};
use crate::run::progress::Progress;
use crate::run::report::{OutputReport, Report};
use crate::run::saved_mesh::Means;
use crate::run::simplification::{Lengths, simplified};
use crate::settings::closing::Least;
use crate::settings::closing::Sealing;
use crate::settings::ground::Classes;
use crate::settings::open::{Facing, Hole, Kind, Open};
use crate::settings::simplification::{Simplification, Tolerance};
use crate::settings::surface::{Diagonals, Fit};
use crate::settings::{AxisChoice, Fineness, Resolution};
use crate::storage::spool::Workspace;

pub use mesh::{Mesh, MeshSink};

/// A surface to be made from points.
///
/// Every setting has the default that the command has, and the same name. Lengths are in the unit of the coordinates.
///
/// ```
/// # fn main() -> asra_stream::Result<()> {
/// // Points on a sphere, in no order, without normals.
/// let points: Vec<[f32; 3]> = (0..20_000)
///     .map(|i| {
///         let z = (2.0 * i as f32 + 1.0) / 20_000.0 - 1.0;
///         let (r, angle) = ((1.0 - z * z).sqrt(), 2.399963 * i as f32);
///         [r * angle.cos(), r * angle.sin(), z]
///     })
///     .collect();
/// let mesh = asra_stream::Reconstruction::of(&points).run()?;
/// let (vertices, triangles) = (mesh.vertices()?, mesh.triangles()?);
/// println!("{} vertices, {} triangles", vertices.len(), triangles.len());
/// assert!(mesh.report().closing.sealed);
/// # Ok(())
/// # }
/// ```
///
/// The mesh is closed, oriented and 2-manifold, and checked to be so. The same points and settings give the same mesh, bit for bit, whatever
/// [`Reconstruction::max_memory`], [`Reconstruction::threads`] and [`Reconstruction::temp_dir`] are.
///
/// Memory: [`Reconstruction::max_memory`], a quarter of the machine's by default; beyond that, what does not fit lies in temporary files without names. Points
/// that a program holds are read where they are, and not counted.
#[derive(Clone)]
#[must_use = "nothing happens before `run`"]
pub struct Reconstruction<'a> {
    points: Points<'a>,
    job: Job,
    /// The widest hole and the base of an open surface, if they were said.
    max_hole: Option<Hole>,
    base: Option<f64>,
    /// The file of polygons within which points count.
    clip: Option<PathBuf>,
    observer: Option<&'a dyn Observer>,
    /// The first thing that cannot be done.
    refused: Option<String>,
}

/// Where points come from.
#[derive(Clone)]
enum Points<'a> {
    Arrays(Arrays<'a>),
    Source(&'a dyn PointSource),
    /// The inputs of the job.
    Files,
}

impl std::fmt::Debug for Reconstruction<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reconstruction").field("job", &self.job).finish_non_exhaustive()
    }
}

impl<'a> Reconstruction<'a> {
    /// From points in memory: a slice, an array or a `Vec` of `[f32; 3]` or `[f64; 3]`. Points that are not finite are left out, and counted.
    pub fn of(points: impl Into<PointSlice<'a>>) -> Reconstruction<'a> {
        Reconstruction::new(Points::Arrays(Arrays::new(points.into())), Vec::new())
    }

    /// From a source of one's own.
    pub fn from_source(source: &'a dyn PointSource) -> Reconstruction<'a> {
        Reconstruction::new(Points::Source(source), Vec::new())
    }

    /// From files of any format that is read, patterns (`tiles/*.laz`) and folders: together they are one cloud.
    pub fn from_files(inputs: impl IntoIterator<Item = impl Into<PathBuf>>) -> Reconstruction<'a> {
        Reconstruction::new(Points::Files, inputs.into_iter().map(Into::into).collect())
    }

    fn new(points: Points<'a>, inputs: Vec<PathBuf>) -> Reconstruction<'a> {
        let job = Job::new(inputs);
        Reconstruction { points, job, max_hole: None, base: None, clip: None, observer: None, refused: None }
    }

    /// All settings of a job at once, in the place of those before, and its resources: not its inputs, nor its output.
    #[cfg(feature = "internals")]
    #[doc(hidden)]
    pub fn job(mut self, job: Job) -> Self {
        let inputs = std::mem::take(&mut self.job.inputs);
        self.job = Job { inputs, ..job };
        self
    }

    /// An attribute of points in memory, a value for each: the mesh's vertices get it. Beside files or a source of one's own, which have their own attributes, it
    /// is an error of [`Reconstruction::run`].
    pub fn attribute(mut self, name: &str, values: impl Into<Values<'a>>) -> Self {
        let added = match &mut self.points {
            Points::Arrays(arrays) => arrays.add(name, values.into()),
            Points::Source(_) | Points::Files => {
                Err(Error::Usage(format!("attribute {name:?}: only points in memory get attributes this way")))
            }
        };
        if let Err(error) = added {
            self.refuse(&error);
        }
        self
    }

    /// Has the run end with an error, if it is the first.
    fn refuse(&mut self, error: &Error) {
        self.refused.get_or_insert(error.to_string());
    }

    /// The side of a cell. By default that of the paper's k = 4, down to half of it where points are dense and clean, and no less than 1.25 sampling distances, or three standard
    /// deviations of their noise where that is as thick.
    pub fn cell_size(mut self, side: f64) -> Self {
        self.job.settings.fineness = Fineness::Given(Resolution::Cell(side));
        self
    }

    /// Cells tied to the sampling distance, as `--cell-size auto`.
    pub fn cell_size_auto(mut self) -> Self {
        self.job.settings.fineness = Fineness::Sampling;
        self
    }

    /// The paper's k, which sets the number of slices: s = ⌊k·∛n⌋ (Eq. 2).
    pub fn k(mut self, k: f64) -> Self {
        self.job.settings.fineness = Fineness::Given(Resolution::K(k));
        self
    }

    /// The number of slices.
    pub fn slices(mut self, slices: u32) -> Self {
        self.job.settings.fineness = Fineness::Given(Resolution::Slices(slices));
        self
    }

    /// The axis that is sliced: that of the box's longest side by default.
    pub fn axis(mut self, axis: Axis) -> Self {
        self.job.settings.axis = AxisChoice::Fixed(axis);
        self
    }

    /// How holes are closed: as wide as they are by default.
    pub fn seal(mut self, seal: Sealing) -> Self {
        self.job.settings.seal = seal;
        self
    }

    /// The slices of the window, odd and at least 3: they bound a radius given to [`Reconstruction::seal`], and change nothing else.
    pub fn window(mut self, slices: u32) -> Self {
        self.job.settings.window = Some(slices);
        self
    }

    /// Keeps points that belong to no surface; by default they are left out, and counted.
    pub fn keep_outliers(mut self) -> Self {
        self.job.settings.keep_outliers = true;
        self
    }

    /// Whether places of the surface are added between points that are too sparse for the shape, as they are by default: up to 5,000 points, if the
    /// cells are those by default and leave the mesh unsealed or hardly tell its walls apart.
    pub fn upsample(mut self, upsample: bool) -> Self {
        self.job.settings.upsample = upsample;
        self
    }

    /// The least number of points of an occupied cell: 1 by default.
    pub fn min_points(mut self, points: u32) -> Self {
        self.job.settings.min_points = points;
        self
    }

    /// Which components are kept: all but specks by default; all with `None`.
    pub fn min_component(mut self, least: Option<Least>) -> Self {
        self.job.settings.min_component = least;
        self
    }

    /// Steps of smoothing: 1 by default, at most 100.
    pub fn smooth(mut self, steps: u32) -> Self {
        self.job.settings.surface.smooth = steps;
        self
    }

    /// What vertices are moved onto: their nearest points by default.
    pub fn fit(mut self, fit: Fit) -> Self {
        self.job.settings.surface.fit = fit;
        self
    }

    /// Which diagonal cuts a quadrilateral into two triangles: the one that leaves the larger smallest angle by default.
    pub fn diagonals(mut self, diagonals: Diagonals) -> Self {
        self.job.settings.surface.diagonals = diagonals;
        self
    }

    /// Makes terrain, in the place of a closed surface: ground, buildings and trees as one open layer, seen from above. The third coordinate grows upwards.
    pub fn terrain(mut self) -> Self {
        self.job.settings.open = Some(Open::TERRAIN);
        self
    }

    /// Makes bare earth, in the place of a closed surface: one open layer of the points on the ground, seen from above.
    pub fn ground(mut self) -> Self {
        self.job.settings.open = Some(Open::GROUND);
        self
    }

    /// Makes a sheet, in the place of a closed surface: one open layer of what was scanned from one side.
    pub fn sheet(mut self, facing: Facing) -> Self {
        self.job.settings.open = Some(Open::sheet(facing));
        self
    }

    /// The widest hole that is bridged in an open surface: 16 cells by default.
    pub fn max_hole(mut self, width: f64) -> Self {
        self.max_hole = Some(Hole::Length(width));
        self
    }

    /// [`Reconstruction::max_hole`] as a number of cells.
    pub fn max_hole_cells(mut self, cells: u32) -> Self {
        self.max_hole = Some(Hole::Cells(cells));
        self
    }

    /// Closes terrain or bare earth into a body with a flat bottom at this height.
    pub fn base(mut self, height: f64) -> Self {
        self.base = Some(height);
        self
    }

    /// Has vertices carry their distance from the nearest point that counts, as the attribute `bridged`.
    pub fn bridged(mut self) -> Self {
        self.job.settings.bridged = true;
        self
    }

    /// Leaves out the triangles with a vertex farther than this from any point that counts. The surface is open there, that of a body, too; every vertex that is left is within
    /// the distance, and what is left is a manifold.
    pub fn trim(mut self, distance: Tolerance) -> Self {
        self.job.settings.trim = Some(distance);
        self
    }

    /// Leaves out triangles, within a tolerance or down to a number; all stay by default. No guarantee is lost, and no vertex is moved unless it is asked for.
    pub fn simplify(mut self, asked: Simplification) -> Self {
        self.job.settings.simplify = Some(asked);
        self
    }

    /// Which classes tell the ground: 2 and 9 by default, if any point has class 2, else a filter. An empty slice is for the filter, whatever classes say.
    pub fn classes(mut self, classes: &[u8]) -> Self {
        self.job.settings.classes = match classes {
            [] => Classes::None,
            _ => Classes::Of(classes.iter().copied().collect()),
        };
        self
    }

    /// Writes the verdicts of the ground filter to a LAZ or LAS file, by its name: all points that count, in their order, with class 2 on the ground and 1 elsewhere.
    /// Classes 7, 9 and 18 stay. A file that is there is not replaced. The file is whole before the mesh is made.
    pub fn write_classes(mut self, path: impl Into<PathBuf>) -> Self {
        self.job.write_classes = Some(path.into());
        self
    }

    /// Writes a GeoTIFF of the ground's heights, told as [`Reconstruction::classes`] says: of each cell, the mean of its points' on the ground.
    pub fn dtm(mut self, path: impl Into<PathBuf>) -> Self {
        self.job.dtm = Some(path.into());
        self
    }

    /// Writes a GeoTIFF of the heights of what is highest: of each cell, the highest of its points'.
    pub fn dsm(mut self, path: impl Into<PathBuf>) -> Self {
        self.job.dsm = Some(path.into());
        self
    }

    /// The side of the cells of [`Reconstruction::dtm`] and [`Reconstruction::dsm`]: a metre by default.
    pub fn raster_size(mut self, side: f64) -> Self {
        self.job.raster_size = Some(side);
        self
    }

    /// The memory that the run may take, in bytes, the mesh included as long as it is held. A quarter of the machine's by default.
    pub fn max_memory(mut self, bytes: u64) -> Self {
        self.job.resources.max_memory = Some(bytes);
        self
    }

    /// Worker threads: one for each processor by default.
    pub fn threads(mut self, threads: usize) -> Self {
        self.job.resources.threads = Some(threads);
        self
    }

    /// The folder for temporary files: the system's by default.
    pub fn temp_dir(mut self, folder: impl Into<PathBuf>) -> Self {
        self.job.resources.temp_dir = Some(folder.into());
        self
    }

    /// Who is told how far the run is, and may end it.
    pub fn observer(mut self, observer: &'a dyn Observer) -> Self {
        self.observer = Some(observer);
        self
    }

    /// Makes the mesh, and checks it.
    ///
    /// # Errors
    /// All of [`Error`]. Nothing stays behind.
    pub fn run(self) -> Result<Mesh> {
        if let Some(refused) = self.refused {
            return Err(Error::Usage(refused));
        }
        let mut job = self.settled_job()?;
        let workers = job.resources.workers()?;
        watched(self.observer, &workers, || {
            let mut progress = Progress::told(self.observer);
            match &self.points {
                Points::Arrays(arrays) => {
                    if job.input.attributes == Wanted::All {
                        // Those that were named are wanted, whatever files would call them, and even if they never change.
                        job.input.attributes = Wanted::Named(arrays.names());
                    }
                    of_source(arrays, &job, &workers, &mut progress)
                }
                Points::Source(source) => of_source(*source, &job, &workers, &mut progress),
                Points::Files => of_files(&job, &workers, &mut progress),
            }
        })
    }

    /// The job, with what could not be settled before all settings were known.
    fn settled_job(&self) -> Result<Job> {
        let mut job = self.job.clone();
        match &mut job.settings.open {
            Some(open) => {
                open.max_hole = self.max_hole.unwrap_or(open.max_hole);
                open.base = self.base.or(open.base);
                if self.base.is_some() && open.kind == Kind::Sheet {
                    return Err(Error::setting("base", "`base`: is for terrain and ground, not for a sheet".into()));
                }
            }
            None if self.max_hole.is_some() => {
                let message =
                    "`max_hole`: is for terrain, ground and sheets; `seal` closes the holes of a closed surface";
                return Err(Error::setting("max_hole", message.into()));
            }
            None if self.base.is_some() => {
                return Err(Error::setting("base", "`base`: is for terrain and ground".into()));
            }
            None => {}
        }
        if let Some(path) = &self.clip {
            job.input.filter.clip = Some(Arc::new(Clip::read(path)?));
        }
        Ok(job)
    }

    /// Makes the mesh, checks it, and hands it on piece by piece.
    ///
    /// # Errors
    /// The same as [`Reconstruction::run`]; what the sink says.
    pub fn run_into(self, sink: &mut dyn MeshSink) -> Result<Report> {
        let mesh = self.run()?;
        mesh.send(sink)?;
        Ok(mesh.into_report())
    }
}

fn of_source(source: &dyn PointSource, job: &Job, workers: &Workers, progress: &mut Progress) -> Result<Mesh> {
    let start = Instant::now();
    job.settings.validate()?;
    let mut cloud = Cloud::of_source(source, &job.input)?;
    let points = forecast::records(&cloud);
    progress.expect_run(Known { write: forecast::Write::Not, ..known_of_points(job, points, Passes::All) });
    made(&mut cloud, job, workers, &workspace(job, workers)?, progress, start)
}

fn of_files(job: &Job, workers: &Workers, progress: &mut Progress) -> Result<Mesh> {
    let start = Instant::now();
    let workspace = workspace(job, workers)?;
    let mut cloud = open_all(job, &workspace, workers, progress)?;
    made(&mut cloud, job, workers, &workspace, progress, start)
}

fn workspace(job: &Job, workers: &Workers) -> Result<Workspace> {
    let folder = job.resources.temp_dir.clone().unwrap_or_else(std::env::temp_dir);
    Ok(Workspace::new(folder)?.stopped_with(workers))
}

/// Makes the mesh of a cloud, and checks it.
fn made(
    cloud: &mut Cloud,
    job: &Job,
    workers: &Workers,
    workspace: &Workspace,
    progress: &mut Progress,
    start: Instant,
) -> Result<Mesh> {
    let job = &job.measured_as(cloud)?;
    describe(cloud, &job.settings, progress);
    let budget = job.resources.budget();
    let mut beside = Beside::of(job)?.create()?;
    let ground = bare_earth(cloud, &job.settings, &mut beside, budget, workers, workspace, progress)?;
    let left = budget_beside(&job.settings, budget, workers);
    let (surveyed, settings) = surveyed(cloud, &job.settings, (workers, workspace), left, progress)?;
    let whole = |error| of_whole_budget(error, &settings, budget, workers);
    let (surveyed, context) =
        planned(cloud, surveyed, &settings, (workers, workspace), left, None, progress).map_err(whole)?;
    let mut made = reconstruct(cloud, &surveyed, &settings, &context, progress).map_err(whole)?;
    if settings.may_be_empty() && made.mesh.face_count() == 0 {
        return Err(Error::NoSurface);
    }
    let mut simplification = None;
    if let Some(asked) = &settings.simplify {
        let longest = surveyed.survey.bounds.longest_side();
        let lengths = Lengths { cell: Some(surveyed.grid.cell_size()), longest };
        let means = Means { memory: made.memory.working, workers, workspace, kept: None };
        let (fewer, figures) = simplified(&made.mesh, asked, lengths, means, progress)?;
        made.mesh = fewer;
        simplification = Some(figures);
    }
    let header = header_of(cloud, &surveyed, &settings, &made, &job.input.attributes, workers)?;
    made.memory = made.memory.with_mesh(&made.mesh, job.check == Check::Always, 0);
    let checked = match job.check {
        Check::Never => None,
        Check::Always => {
            progress.begin(Phase::Check, Some(made.mesh.face_count()));
            let report =
                check_near(&made.mesh, made.memory.working, workers, workspace, &mut |done| progress.set(done))?;
            refuse_unsound(&report, &settings)?;
            Some(report)
        }
    };
    progress.end();
    beside.finish()?;
    let output = OutputReport {
        path: None,
        preview: None,
        bytes: made.mesh.bytes(),
        tileset: None,
        tiles: None,
        vertices: made.mesh.vertex_count(),
        triangles: made.mesh.face_count(),
        origin: made.origin,
        coordinates: Positions::Shifted,
    };
    let seconds = start.elapsed().as_secs_f64();
    let report = report(Finished {
        cloud,
        surveyed: &surveyed,
        ground,
        settings: &settings,
        made: &made,
        simplification,
        check: checked,
        output,
        progress,
        seconds,
        workspace,
    });
    Ok(Mesh::new(made.mesh, header, report, workers.clone(), workspace.clone()))
}
