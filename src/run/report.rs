//! The report of a run: everything a batch job's owner may ask afterwards, as JSON. What may be wrong is judged in `judgement`, the words for people are in `summary`.

use std::path::PathBuf;

use crate::error::words;
use crate::format::write::Positions;
use crate::grid::Grid;
use crate::input::Cloud;
use crate::mesh::check::CheckReport;
use crate::points::Precision;
use crate::points::bounds::Bounds;
use crate::resources::memory::MemoryPlan;
use crate::run::bare_earth::GroundReport;
use crate::run::bridging::Trimmed;
use crate::run::phase::Phase;
use crate::run::progress::Warning;
use crate::run::pyramid::TilesetFigures;
use crate::run::surface::Reconstructed;
use crate::run::surveyed::Surveyed;
use crate::settings::closing::Least;
use crate::settings::closing::Sealing;
use crate::settings::open::Open;
use crate::settings::simplification::{Simplification, Tolerance};
use crate::settings::surface::{Fit, SurfaceOptions};
use crate::settings::{Fineness, Settings};
use crate::simplify::Figures;
use crate::solid::close::How;
use crate::solid::component::Components;
use crate::solid::heightfield::ColumnCounts as Columns;
use crate::solid::parted::{PartingNothing, Sighted};
use crate::stitch::counts::Counts;
use crate::stitch::reach::SeamReport;
use crate::surface::thickness::Shell;

/// Everything about a finished run.
#[derive(Debug, Clone, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct Report {
    /// The program's version.
    pub version: &'static str,
    /// The files read.
    pub inputs: Vec<InputReport>,
    /// What was asked for.
    pub parameters: Parameters,
    /// The points.
    pub points: PointsReport,
    /// How the ground was told, of a surface that is that alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground: Option<GroundReport>,
    /// The grid.
    pub grid: GridReport,
    /// Points to an occupied cell, on average.
    pub points_to_a_cell: f64,
    /// The closing.
    pub closing: Closing,
    /// What vertices were moved onto.
    pub fit: FitReport,
    /// What became of the vertices.
    pub vertices: Counts,
    /// How each seam between two slabs was closed, from the lowest on.
    pub seams: Vec<SeamReport>,
    /// The triangles that were left out as they are far from all points, if they were to be.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trimmed: Option<Trimmed>,
    /// How many triangles were left out, if any were to be.
    pub simplification: Option<Figures>,
    /// The mesh as the check found it, unless it was left out.
    pub check: Option<CheckReport>,
    /// The mesh file.
    pub output: OutputReport,
    /// Seconds of each phase, in order.
    pub seconds: Vec<(Phase, f64)>,
    /// Seconds in all.
    pub seconds_total: f64,
    /// Memory and disk.
    pub memory: MemoryReport,
    /// What may be wrong with the mesh.
    pub warnings: Vec<Warning>,
    /// Those of the points, which come first.
    #[serde(skip)]
    pub(crate) foreseen: Vec<Warning>,
}

/// One file read.
#[derive(Debug, Clone, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct InputReport {
    /// The file.
    #[serde(serialize_with = "words::told")]
    pub path: PathBuf,
    /// Its format.
    pub format: &'static str,
    /// How it was understood.
    pub layout: String,
    /// Its length.
    pub bytes: u64,
    /// What is odd about it though its points are whole.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remark: Option<String>,
}

/// What was asked for.
#[derive(Debug, Clone, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct Parameters {
    /// The paper's k, if that set the grid.
    pub k: Option<f64>,
    /// The number of slices, if that set the grid.
    pub slices: Option<u32>,
    /// The cell's side, if that set the grid.
    pub cell_size: Option<f64>,
    /// How holes were to be closed.
    pub seal: Sealing,
    /// The window's slices, if given.
    pub window: Option<u32>,
    /// Whether outliers were to be kept.
    pub keep_outliers: bool,
    /// Whether places of the surface might be added where points are sparse.
    pub upsample: bool,
    /// The least points of an occupied cell.
    pub min_points: u32,
    /// The components that were kept, if not all.
    pub min_component: Option<Least>,
    /// What was done to the surface.
    pub surface: SurfaceOptions,
    /// What was asked of a surface that is not closed.
    pub open: Option<Open>,
    /// Whether vertices carry their distance from the nearest point.
    pub bridged: bool,
    /// How far from any point triangles were left out.
    pub trim: Option<Tolerance>,
    /// What was asked of a simplification.
    pub simplify: Option<Simplification>,
}

/// The points.
#[derive(Debug, Clone, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct PointsReport {
    /// Finite points.
    pub count: u64,
    /// Places of the surface that were added between them, as they are sparse.
    pub added: u64,
    /// Records left out as not finite.
    pub dropped: u64,
    /// Points left out by filters.
    pub filtered: u64,
    /// The attributes that are carried to the mesh.
    pub attributes: Vec<String>,
    /// `f32` or `f64`.
    pub precision: Precision,
    /// Their box.
    pub bounds: Bounds,
    /// Mean distance between neighbouring samples, if it was measured.
    pub sampling_distance: Option<f64>,
    /// Standard deviation of points from the surface, if the grid depends on it and enough places tell.
    pub noise: Option<f64>,
}

/// The grid.
#[derive(Debug, Clone, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct GridReport {
    /// The slicing axis.
    pub axis: char,
    /// Number of slices.
    pub slices: u32,
    /// Cells along the file's axes, the slices in the middle (the paper's Table 1).
    pub raster: [u32; 3],
    /// The cell's side.
    pub cell_size: f64,
    /// The raster with all planes of wide gaps, if some are left out.
    pub unfolded: Option<[u32; 3]>,
}

/// The closing.
#[derive(Debug, Clone, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct Closing {
    /// The ball's radius, in cells, where one was asked for.
    pub radius: Option<u32>,
    /// Whether the mesh encloses the inside: samples part inside and outside everywhere, no handle is too narrow to be believed and no slot too narrow to be seen, and little of the surface bridges holes.
    pub sealed: bool,
    /// Whether samples part inside and outside everywhere: there are no patches, and `part_nothing` is below 2 %.
    pub parted: bool,
    /// Whether triangles were left out, so that the mesh ends there.
    #[serde(skip)]
    pub(crate) ends: bool,
    /// If places were added: whether the body has the same Euler number if its surface is moved a little inwards or outwards.
    pub steady: Option<bool>,
    /// The part of the surface that bridges holes, if the mesh was checked and its vertices are fitted to points.
    pub bridged: Option<f64>,
    /// The part of the border between inside and outside that no sample is near, on the level that tells them apart: what holes are closed with there.
    pub spanned: f64,
    /// The part of the samples' cells that have the same side on both sides.
    pub part_nothing: f64,
    /// Patches that have the outside on both sides, the largest first.
    pub open: Vec<PatchReport>,
    /// Patches that have the inside on both sides, the largest first: slots and folds that were filled.
    pub filled: Vec<PatchReport>,
    /// The side of the cells that inside and outside were told apart on, if they are too wide for slots, fins or shells.
    pub too_wide: Option<f64>,
    /// Cells left out as outliers.
    pub outlier_cells: u64,
    /// Handles that are two cells wide or less, so that nobody can tell whether they are the object's. They are counted where samples part inside and outside everywhere.
    pub narrow_handles: u64,
    /// The widest of them, in the input's coordinates.
    pub narrow_handle: Option<Bounds>,
    /// Whether the slots round them were filled and opened anew, so that the mesh has fewer of them than were counted.
    pub narrow_reopened: bool,
    /// What lines of sight said, where it is known where points were scanned from.
    pub sighted: Option<Sighted>,
    /// Occupied cells.
    pub occupied_cells: u64,
    /// Cells with points, but too few to be occupied.
    pub sparse_cells: u64,
    /// What was found and left out, if small components were to be.
    pub components: Option<Components>,
    /// The columns of a surface that is seen from one side.
    pub columns: Option<Columns>,
    /// Solid cells.
    pub solid_cells: u64,
}

/// What vertices were moved onto.
#[derive(Debug, Clone, Copy, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct FitReport {
    /// Facets, points, spheres or nothing.
    pub onto: Fit,
    /// The shell of points, if `fit` was `auto`, so that the shell decided.
    pub shell: Option<Shell>,
}

/// A patch of samples that have the same side on both sides.
#[derive(Debug, Clone, Copy, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct PatchReport {
    /// The part of the samples' cells that it has.
    pub share: f64,
    /// Its box, in the input's coordinates.
    pub bounds: Bounds,
}

/// The most patches that a report names.
const MOST_PATCHES: usize = 100;

/// The box, in the input's coordinates, of a box of cells of a grid.
fn bounds_of(grid: &Grid, [low, high]: [[f64; 3]; 2]) -> Bounds {
    let corners = (0..8).map(|i| grid.position([0, 1, 2].map(|a| if i >> a & 1 == 0 { low[a] } else { high[a] })));
    let one = |p: [f64; 3]| Bounds { min: p, max: p };
    corners.map(one).reduce(Bounds::union).expect("a box has corners")
}

/// The mesh file.
#[derive(Debug, Clone, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct OutputReport {
    /// The file; none of a mesh in memory.
    #[serde(serialize_with = "words::told_if_any")]
    pub path: Option<PathBuf>,
    /// The picture of it, if one was drawn.
    #[serde(serialize_with = "words::told_if_any")]
    pub preview: Option<PathBuf>,
    /// Its length, or that of all tiles.
    pub bytes: u64,
    /// The number of tiles, if it is a folder of them.
    pub tiles: Option<u64>,
    /// The levels, if it is a tileset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tileset: Option<TilesetFigures>,
    /// Vertices.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
    /// Added to the vertices, gives the input's coordinates.
    pub origin: [f64; 3],
    /// Whether the file has the input's own coordinates, or is less the origin.
    pub coordinates: Positions,
}

/// Memory and disk, planned and used.
#[derive(Debug, Clone, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct MemoryReport {
    /// The plan.
    pub plan: MemoryPlan,
    /// The most memory resident at a time, in bytes (pages of mapped input included).
    pub peak_resident: Option<u64>,
    /// The most temporary disk used at a time, in bytes.
    pub peak_disk: u64,
}

impl Parameters {
    /// What `settings` asked for.
    pub fn of(settings: &Settings) -> Parameters {
        use crate::settings::Resolution;
        let (mut k, mut slices, mut cell_size) = (None, None, None);
        match settings.fineness {
            Fineness::Given(Resolution::K(value)) => k = Some(value),
            Fineness::Given(Resolution::Slices(value)) => slices = Some(value),
            Fineness::Given(Resolution::Cell(value)) => cell_size = Some(value),
            Fineness::Sampling | Fineness::Default => {}
        }
        let Settings { seal, window, keep_outliers, upsample, min_points, min_component, surface, open, .. } =
            *settings;
        let Settings { bridged, trim, simplify, .. } = *settings;
        Parameters {
            k,
            slices,
            cell_size,
            seal,
            window,
            keep_outliers,
            upsample,
            min_points,
            min_component,
            surface,
            open,
            bridged,
            trim,
            simplify,
        }
    }
}

impl PointsReport {
    /// The points of a surveyed cloud.
    pub fn of(cloud: &Cloud, surveyed: &Surveyed) -> PointsReport {
        let added = surveyed.added().map_or(0, |added| added.points.len() as u64);
        PointsReport {
            count: surveyed.survey.points - added,
            added,
            dropped: surveyed.survey.dropped,
            filtered: surveyed.survey.filtered,
            attributes: cloud.schema().attributes().iter().map(|a| a.name.clone()).collect(),
            precision: surveyed.workload.precision,
            bounds: surveyed.survey.bounds,
            sampling_distance: surveyed.density.and_then(|density| density.distance),
            noise: surveyed.density.and_then(|density| density.noise),
        }
    }
}

impl GridReport {
    /// A grid.
    pub fn of(grid: &Grid) -> GridReport {
        GridReport {
            axis: grid.axis().letter(),
            slices: grid.cells()[1],
            raster: grid.raster(),
            cell_size: grid.cell_size(),
            unfolded: grid.has_gaps().then(|| grid.raw_raster()),
        }
    }
}

impl Closing {
    /// The closing of a reconstruction on a grid.
    pub fn of(made: &Reconstructed, grid: &Grid) -> Closing {
        let (radius, parted) = match &made.how {
            How::Ball(closing) => (Some(closing.rho()), None),
            How::Sign(parted) => (None, Some(parted)),
        };
        let walls = parted.map_or(1, |parted| parted.walls.max(1)) as f64;
        let patches = |patches: &[PartingNothing]| -> Vec<PatchReport> {
            let report = |patch: &PartingNothing| PatchReport {
                share: patch.walls as f64 / walls,
                bounds: bounds_of(grid, patch.cells),
            };
            patches.iter().take(MOST_PATCHES).map(report).collect()
        };
        let is_parted = parted.is_some_and(|parted| parted.is_sealed());
        let too_wide = parted.and_then(|parted| parted.too_wide).map(|cells| f64::from(cells) * grid.cell_size());
        Closing {
            radius,
            sealed: is_parted && made.narrow.count == 0 && too_wide.is_none(),
            parted: is_parted,
            ends: false,
            steady: None,
            bridged: None,
            spanned: parted.map_or(0.0, |parted| parted.spanned()),
            part_nothing: parted.map_or(0.0, |parted| parted.part_nothing as f64 / walls),
            open: parted.map_or_else(Vec::new, |parted| patches(&parted.open)),
            filled: parted.map_or_else(Vec::new, |parted| patches(&parted.filled)),
            too_wide,
            outlier_cells: parted.map_or(0, |parted| parted.outliers),
            narrow_handles: made.narrow.count,
            narrow_reopened: made.narrow.reopened,
            narrow_handle: made.narrow.widest.map(|cells| bounds_of(grid, cells.map(|cell| cell.map(f64::from)))),
            sighted: parted.and_then(|parted| parted.sighted),
            occupied_cells: made.occupied,
            sparse_cells: made.sparse,
            components: made.components,
            columns: made.columns,
            solid_cells: made.solid,
        }
    }
}
