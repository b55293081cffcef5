//! The report of a run: everything a batch job's owner may ask afterwards, as JSON, and a summary for people.

use std::fmt;
use std::path::PathBuf;

use bytesize::ByteSize;

use crate::error::words;
use crate::error::words::{duration, short, thousands};
use crate::format::write::{Format, Positions};
use crate::grid::Grid;
use crate::grid::partition::REACH;
use crate::input::Cloud;
use crate::mesh::check::CheckReport;
use crate::points::Precision;
use crate::points::bounds::Bounds;
use crate::resources::memory::MemoryPlan;
use crate::run::bare_earth::GroundReport;
use crate::run::phase::Phase;
use crate::run::pipeline::{Reconstructed, Surveyed};
use crate::run::progress::Warning;
use crate::run::simplification;
use crate::settings::closing::Least;
use crate::settings::closing::Sealing;
use crate::settings::open::{Kind, Open};
use crate::settings::simplification::Simplification;
use crate::settings::surface::{Fit, SurfaceOptions};
use crate::settings::{Fineness, Settings};
use crate::simplify::Figures;
use crate::solid::close::{How, PartingNothing};
use crate::solid::component::Components;
use crate::solid::heightfield::ColumnCounts as Columns;
use crate::stitch::Counts;
use crate::stitch::reach::SeamReport;
use crate::surface::thickness::Shell;

/// Points to an occupied cell from which the summary says that cells are too coarse. Even scans have ten at most by default, dense clouds with cells of a chosen size a
/// hundred; of a cloud with one point a thousand times as far away as the others, nearly all points share a cell.
const CROWDED: f64 = 1000.0;

/// The part of the surface that bridges holes from which the summary warns of it, and the mesh is not called sealed.
const MUCH_BRIDGED: f64 = 0.02;

/// Pieces of a closed mesh from which the summary warns of them: an object, and some beside it, may be meant.
const MANY_COMPONENTS: u64 = 10;

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
    /// The least points of an occupied cell.
    pub min_points: u32,
    /// The components that were kept, if not all.
    pub min_component: Option<Least>,
    /// What was done to the surface.
    pub surface: SurfaceOptions,
    /// What was asked of a surface that is not closed.
    pub open: Option<Open>,
    /// What was asked of a simplification.
    pub simplify: Option<Simplification>,
}

/// The points.
#[derive(Debug, Clone, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct PointsReport {
    /// Finite points.
    pub count: u64,
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
    /// Whether the mesh encloses the inside: samples part inside and outside everywhere, and little of the surface bridges holes.
    pub sealed: bool,
    /// Whether samples part inside and outside everywhere: there are no patches, and `part_nothing` is below 2 %.
    pub parted: bool,
    /// The part of the surface that bridges holes, if the mesh was checked and its vertices are fitted to points.
    pub bridged: Option<f64>,
    /// The part of the samples' cells that have the same side on both sides.
    pub part_nothing: f64,
    /// Patches that have the outside on both sides, the largest first.
    pub open: Vec<PatchReport>,
    /// Patches that have the inside on both sides, the largest first: slots and folds that were filled.
    pub filled: Vec<PatchReport>,
    /// Cells left out as outliers.
    pub outlier_cells: u64,
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
    /// Points, planes or nothing.
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
        let Settings { seal, window, keep_outliers, min_points, min_component, surface, open, simplify, .. } =
            *settings;
        Parameters {
            k,
            slices,
            cell_size,
            seal,
            window,
            keep_outliers,
            min_points,
            min_component,
            surface,
            open,
            simplify,
        }
    }
}

impl PointsReport {
    /// The points of a surveyed cloud.
    pub fn of(cloud: &Cloud, surveyed: &Surveyed) -> PointsReport {
        PointsReport {
            count: surveyed.survey.points,
            dropped: surveyed.survey.dropped,
            filtered: surveyed.survey.filtered,
            attributes: cloud.schema().attributes().iter().map(|a| a.name.clone()).collect(),
            precision: surveyed.workload.precision,
            bounds: surveyed.survey.bounds,
            sampling_distance: surveyed.sampling,
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

impl fmt::Display for GridReport {
    /// "132 x 134 x 104 cells of 0.00117, 134 slices along y".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let GridReport { axis, slices, raster: [a, b, c], cell_size, unfolded } = self;
        write!(f, "{a} x {b} x {c} cells of {}, {slices} slices along {axis}", short(*cell_size))?;
        match unfolded {
            Some([a, b, c]) => write!(f, "; the gaps up to far points are left out, of {a} x {b} x {c} with them"),
            None => Ok(()),
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
        Closing {
            radius,
            sealed: is_parted,
            parted: is_parted,
            bridged: None,
            part_nothing: parted.map_or(0.0, |parted| parted.part_nothing as f64 / walls),
            open: parted.map_or_else(Vec::new, |parted| patches(&parted.open)),
            filled: parted.map_or_else(Vec::new, |parted| patches(&parted.filled)),
            outlier_cells: parted.map_or(0, |parted| parted.outliers),
            occupied_cells: made.occupied,
            sparse_cells: made.sparse,
            components: made.components,
            columns: made.columns,
            solid_cells: made.solid,
        }
    }

    /// A line about what was left out, if anything was to be.
    pub fn left_out(&self) -> Option<String> {
        let sparse = |cells: u64| format!("{} cells of too few points", thousands(cells));
        let dropped = |Components { found, dropped, dropped_cells, .. }: Components| {
            let (dropped, found, cells) = (thousands(dropped), thousands(found), thousands(dropped_cells));
            format!("{dropped} of {found} components, {cells} cells in all")
        };
        let parts: Vec<String> =
            (self.sparse_cells > 0)
                .then(|| sparse(self.sparse_cells))
                .into_iter()
                .chain((self.outlier_cells > 0).then(|| {
                    format!("{} cells of outliers (--keep-outliers keeps them)", thousands(self.outlier_cells))
                }))
                .chain(self.components.filter(|components| components.dropped > 0).map(dropped))
                .collect();
        (!parts.is_empty()).then(|| parts.join("; "))
    }

    /// A line about the inside.
    pub fn verdict(&self) -> String {
        match self.radius {
            Some(radius) => format!("radius {radius} {}, as asked", if radius == 1 { "cell" } else { "cells" }),
            None if self.sealed => "sealed: the mesh encloses the inside".to_owned(),
            None if self.parted => {
                format!("closed over holes: {:.1} % of the surface bridges them", 100.0 * self.bridged.unwrap_or(0.0))
            }
            None => format!("not sealed: {}", self.same_sides()),
        }
    }

    fn same_sides(&self) -> String {
        format!("{:.1} % of the samples have the same side on both sides", 100.0 * self.part_nothing)
    }

    /// What is wrong with the inside, if the mesh does not enclose one; `cell_size` is that of the grid.
    fn warnings(&self, cell_size: f64) -> Option<Warning> {
        if self.radius.is_some() || self.parted {
            return None;
        }
        let whole = |patches: &[PatchReport]| 100.0 * patches.iter().map(|patch| patch.share).sum::<f64>();
        let place = |patch: &PatchReport| {
            let Bounds { min, max } = patch.bounds;
            let side = |a: usize| format!("{} to {}", short(min[a]), short(max[a]));
            format!("x {}, y {}, z {}", side(0), side(1), side(2))
        };
        let mut found = vec![format!("not sealed: {}", self.same_sides())];
        let mut advice = Vec::new();
        if let Some(largest) = self.open.first() {
            found.push(format!(
                "{:.1} % lie on open surfaces, which are kept as slabs a cell thick; the largest in {}",
                whole(&self.open),
                place(largest)
            ));
            advice.push(
                "--surface terrain (seen from above) or --surface sheet --facing FROM makes a surface of them"
                    .to_owned(),
            );
        }
        if let Some(largest) = self.filled.first() {
            found.push(format!(
                "{:.1} % line slots or folds that are filled; the largest in {}",
                whole(&self.filled),
                place(largest)
            ));
            advice.push(format!("--cell-size {} shows them, if there are samples enough", short(cell_size / 2.0)));
        }
        Some(Warning { message: found.join("\n"), advice: (!advice.is_empty()).then(|| advice.join("\n")) })
    }
}

impl Report {
    /// Judges the run by what the rest of the report says: whether the mesh encloses the inside, what may be wrong with it, and what can be done about that.
    pub fn judge(&mut self) {
        self.closing.bridged = self.bridged_share();
        self.closing.sealed = self.closing.parted && self.closing.bridged.is_none_or(|share| share < MUCH_BRIDGED);
        self.warnings = self.find_warnings();
    }

    fn find_warnings(&self) -> Vec<Warning> {
        let mut found = Vec::new();
        if self.points.dropped > 0 {
            let dropped = thousands(self.points.dropped);
            found.push(Warning::bare(format!("{dropped} points left out: a coordinate is not a number, or infinite")));
        }
        if self.points_to_a_cell > CROWDED {
            let crowd = thousands(self.points_to_a_cell as u64);
            found.push(Warning::new(
                format!("{crowd} points to an occupied cell, on average: too coarse to show what they are of"),
                "points far away may stretch the box; --bounds leaves them out, and --cell-size makes cells finer",
            ));
        }
        if self.parameters.open.is_none() {
            found.extend(self.closing.warnings(self.grid.cell_size));
        }
        if let Some(share) = self.closing.bridged.filter(|share| *share >= MUCH_BRIDGED) {
            let advice = match self.parameters.open {
                Some(_) => "--max-hole bounds the holes that are bridged",
                None => "asra-stream compare MESH CLOUD --heatmap FILE shows where",
            };
            found.push(Warning::new(
                format!(
                    "{:.1} % of the surface bridges holes: it is farther than {REACH} cells from any point",
                    100.0 * share
                ),
                advice,
            ));
        }
        let parts = self.check.as_ref().map_or(0, |check| check.components);
        if parts >= MANY_COMPONENTS && self.parameters.open.is_none() {
            found.push(Warning::new(
                format!("the mesh is in {} pieces", thousands(parts)),
                format!(
                    "--min-component largest keeps one; larger cells (--cell-size {}) may join them",
                    short(2.0 * self.grid.cell_size)
                ),
            ));
        }
        found.extend(self.simplification.as_ref().and_then(simplification::warning));
        if self.vertices.tangled > 0 {
            let tangled = thousands(self.vertices.tangled);
            found.push(Warning::bare(format!("{tangled} pairs of triangles still intersect")));
        }
        found
    }

    /// The part of the surface that bridges holes, if the mesh was checked and its vertices are fitted to points.
    fn bridged_share(&self) -> Option<f64> {
        let check = self.check.as_ref().filter(|check| check.area > 0.0)?;
        (self.parameters.surface.fit != Fit::None).then(|| self.vertices.bridged_area / check.area)
    }

    /// The summary for people: the output, the mesh, what may be wrong; and in `detail`, all that came before.
    pub fn summary(&self, detail: bool) -> String {
        let mut lines = self.output_lines();
        lines.extend(self.mesh_lines());
        lines.extend(self.warnings.iter().map(Warning::to_string));
        if detail {
            lines.extend(self.detail_lines());
        }
        lines.join("\n")
    }

    fn output_lines(&self) -> Vec<String> {
        let OutputReport { path, bytes, tiles, origin, preview, .. } = &self.output;
        let files = tiles.map_or_else(String::new, |tiles| format!(", {} tiles and an index", thousands(tiles)));
        let (size, time) = (ByteSize(*bytes), duration(self.seconds_total));
        let mut lines = vec![match path {
            Some(path) => format!("output   {}{files}, {size}, in {time}", path.display()),
            None => format!("output   in memory, in {time}"),
        }];
        if *origin != [0.0; 3] {
            let [x, y, z] = origin;
            let how = match path.as_deref().map(Format::from_path) {
                Some(Ok(Format::Stl | Format::Glb)) => {
                    "32 bits would not hold them; .ply and .obj with --coordinates input do"
                }
                _ => "--coordinates input leaves them as they are",
            };
            lines.push(format!("         origin {x} {y} {z} taken off the coordinates: {how}"));
        }
        lines.extend(preview.iter().map(|preview| format!("preview  {}", preview.display())));
        lines
    }

    fn mesh_lines(&self) -> Vec<String> {
        let OutputReport { vertices, triangles, .. } = self.output;
        let size = format!("mesh     {} vertices, {} triangles", thousands(vertices), thousands(triangles));
        let Some(check) = &self.check else { return vec![format!("{size}; not checked")] };
        let genus = check.genus.map_or_else(String::new, |genus| format!(", genus {genus}"));
        let parts = if check.components == 1 { "component" } else { "components" };
        let loops = if check.boundary_loops == 1 { "loop" } else { "loops" };
        let boundary = thousands(check.boundary_loops);
        let closed =
            if check.closed { "closed".to_owned() } else { format!("open on purpose, {boundary} boundary {loops}") };
        let volume = check.volume.map_or_else(String::new, |volume| format!(", volume {}", short(volume)));
        let mut lines = vec![
            format!("{size}; {closed}, oriented, manifold; {} {parts}{genus}", thousands(check.components)),
            format!("         area {}{volume}", short(check.area)),
        ];
        if let FitReport { onto: Fit::Plane, shell: Some(shell) } = self.fit {
            lines.push(format!(
                "         noisy points, {:.2} cells thick: the mesh lies amid them; --fit nearest puts it on points",
                shell.thickness
            ));
        }
        lines
    }

    fn detail_lines(&self) -> Vec<String> {
        let mut points = format!("points   {}", thousands(self.points.count));
        for (count, why) in [
            (self.points.dropped, "dropped: not finite"),
            (
                self.points.filtered,
                if self.ground.is_some() { "no ground, or left out by filters" } else { "left out by filters" },
            ),
        ] {
            if count > 0 {
                points += &format!(" ({} {why})", thousands(count));
            }
        }
        let mut lines = vec![points, format!("grid     {}", self.grid)];
        match (&self.parameters.open, self.closing.columns) {
            (Some(open), Some(columns)) => {
                let kind = match open.kind {
                    Kind::Sheet => "sheet",
                    Kind::Terrain => "terrain",
                    Kind::Ground => "ground",
                };
                let (data, bridged) = (thousands(columns.data), thousands(columns.bridged));
                let facing = open.facing;
                lines.push(format!(
                    "surface  {kind}, seen from {facing}: {data} columns with points, {bridged} bridged"
                ));
            }
            _ => lines.push(format!("closing  {}", self.closing.verdict())),
        }
        lines.extend(self.closing.left_out().map(|left_out| format!("left out {left_out}")));
        let Counts { retreated, bridged_area, .. } = self.vertices;
        if let Some(share) = self.closing.bridged.filter(|share| *share > 0.0) {
            lines.push(format!(
                "bridged  area {} ({:.2} % of the surface): farther than {REACH} cells from any point",
                short(bridged_area),
                100.0 * share
            ));
        }
        if retreated > 0 {
            lines.push(format!(
                "kept off {} vertices kept off their points, so that no triangles intersect",
                thousands(retreated)
            ));
        }
        if let Some(Figures { before, reached, .. }) = self.simplification {
            let (before, reached) = (thousands(before), short(reached));
            lines.push(format!(
                "fewer    of {before} triangles; no place of either surface is farther than {reached} from the other"
            ));
        }
        let stages = self
            .seconds
            .iter()
            .map(|(phase, time)| format!("{} {:.0} %", phase.name(), 100.0 * time / self.seconds_total.max(1e-9)));
        lines.push(format!("time     {}: {}", duration(self.seconds_total), stages.collect::<Vec<_>>().join(", ")));
        let used = self.memory.peak_resident.map_or_else(|| "?".into(), |bytes| ByteSize(bytes).to_string());
        let (budget, disk) = (ByteSize(self.memory.plan.budget), ByteSize(self.memory.peak_disk));
        lines.push(format!("memory   {used} at most, of {budget} granted; {disk} of temporary disk"));
        lines
    }
}

impl fmt::Display for Report {
    /// The summary without details.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.summary(false))
    }
}
