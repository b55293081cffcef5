//! The first phase of a run: the survey, which lays the grid, and the rehearsal, which tells how many faces to expect.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::grid::Grid;
use crate::grid::bucket::Added;
use crate::grid::coarse::CoarseGrid;
use crate::grid::partition::Slabs;
use crate::grid::survey::{Density, Survey, Wanted, planes_with_points, seen_from, survey, turned_bounds};
use crate::input::Cloud;
use crate::points::Precision;
use crate::points::unit::Measure;
use crate::resources::workers::Workers;
use crate::run::estimate::{EstimateInput, estimate_faces, estimate_open_faces, level_to_expect};
use crate::run::fineness::{auto_side, default_side};
use crate::run::forecast;
use crate::run::phase::Phase;
use crate::run::planner::survey_jobs;
use crate::run::progress::Progress;
use crate::run::workload::{ColumnWorkload, SurveyWorkload, Workload};
use crate::settings::open::{Facing, Open};
use crate::settings::simplification::Simplification;
use crate::settings::{Fineness, Resolution, Settings};
use crate::solid::heightfield;
use crate::storage::spool::Workspace;

/// A surveyed cloud on its grid: all that is known before the first point is sorted.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Surveyed {
    /// What the survey found.
    pub survey: Survey,
    /// The grid.
    pub grid: Grid,
    /// What is asked of a surface that is not closed; it is seen from a direction if the scans' places were to tell.
    pub open: Option<Open>,
    /// How densely the points lie, where it was asked for.
    pub density: Option<Density>,
    /// The cells of its points at a coarse resolution.
    pub coarse_grid: CoarseGrid,
    /// What the plan is made from.
    pub workload: Workload,
    /// Places that are added to the points, if these are sparse: the survey counts them, and so does the grid.
    pub upsampled: Option<Upsampled>,
}

/// Places that are added to a cloud's points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Upsampled {
    /// The places, with the attributes of the nearest point each.
    pub added: Added,
    /// Whether the body has the same Euler number if its surface is moved a little inwards or outwards.
    pub is_steady: bool,
    /// Whether cells are opened again after the closing: not where that makes other handles than the surface has.
    pub reopened: bool,
    /// How many triangles are left unasked, if there would be more.
    pub max_triangles: Option<u64>,
}

impl Surveyed {
    /// The settings as the points settle them.
    pub fn settled(&self, settings: &Settings) -> Settings {
        let unasked = self.upsampled.as_ref().and_then(|upsampled| upsampled.max_triangles).map(Simplification::to);
        Settings { open: self.open, simplify: settings.simplify.or(unasked), ..*settings }
    }

    /// Whether cells may be opened again after the closing.
    pub fn may_reopen(&self) -> bool {
        self.upsampled.as_ref().is_none_or(|upsampled| upsampled.reopened)
    }

    /// The same with a change of its workload.
    pub(super) fn with_workload(self, change: impl FnOnce(Workload) -> Workload) -> Surveyed {
        Surveyed { workload: change(self.workload), ..self }
    }

    /// The same with a change of how it is upsampled, if it is.
    pub(super) fn with_upsampled(mut self, change: impl FnOnce(&mut Upsampled)) -> Surveyed {
        if let Some(upsampled) = &mut self.upsampled {
            change(upsampled);
        }
        self
    }

    /// The points that are added to the cloud's.
    pub fn added(&self) -> Option<&Added> {
        self.upsampled.as_ref().map(|upsampled| &upsampled.added)
    }
}

/// Surveys the cloud and lays the grid, with as many blocks in flight as `budget` bytes have room for.
///
/// # Errors
/// Errors of reading the input and of [`Grid::new`].
pub fn survey_cloud(
    cloud: &Cloud,
    settings: &Settings,
    workers: &Workers,
    budget: u64,
    progress: &mut Progress,
) -> Result<Surveyed> {
    survey_with(cloud, settings, Sampling::IfNeeded, workers, budget, progress)
}

/// Whether the sampling distance is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sampling {
    /// If the grid depends on it.
    IfNeeded,
    /// In any case.
    Always,
}

/// [`survey_cloud`], with or without the sampling distance.
///
/// # Errors
/// The same as [`survey_cloud`].
pub fn survey_with(
    cloud: &Cloud,
    settings: &Settings,
    sampling: Sampling,
    workers: &Workers,
    budget: u64,
    progress: &mut Progress,
) -> Result<Surveyed> {
    settings.validate()?;
    let known: Option<u64> = cloud.sources().iter().map(|s| s.records).sum();
    progress.begin(Phase::Survey, known);
    let mut passes = Passes { progress, expected: forecast::records(cloud), records: 0, planned: 1, done: 0 };
    // What a run looks for, which the plan is about.
    let needed = if matches!(settings.fineness(), Fineness::Given(_)) { Wanted::Extent } else { Wanted::Density };
    let wanted = if sampling == Sampling::Always { Wanted::Density } else { needed };
    let surveying = SurveyWorkload::of(cloud, wanted);
    let in_flight = survey_jobs(surveying, budget, workers.threads());
    let (survey, coarse_grid, density) = survey(cloud, wanted, workers, in_flight, |records| passes.read(records))?;
    let farthest = survey.bounds.min.into_iter().chain(survey.bounds.max).fold(0.0, |most: f64, c| most.max(c.abs()));
    if cloud.precision() == Precision::Single && farthest > FARTHEST_SINGLE {
        return Err(Error::Usage(format!(
            "a coordinate of {farthest:e} leaves single precision no room for a surface, which ends at {FARTHEST_SINGLE:e}; scale the points down"
        )));
    }
    let (resolution, may_have_gaps) = match settings.fineness() {
        Fineness::Given(resolution) => (resolution, matches!(resolution, Resolution::Cell(_))),
        Fineness::Sampling => {
            let kind = settings.open.map(|open| open.kind);
            let in_plan = coarse_grid.spacing(survey.points);
            // A single place has no sampling distance; any cell does.
            let side = density.and_then(|density| auto_side(density, in_plan, kind));
            (Resolution::Cell(side.unwrap_or(1.0)), true)
        }
        Fineness::Default => {
            let usual = Grid::new(survey.points, &survey.bounds, Resolution::default(), settings.axis)?.cell_size();
            match density.map_or(usual, |density| default_side(usual, density)) {
                side if side == usual => (Resolution::default(), false),
                side => (Resolution::Cell(side), side > usual),
            }
        }
    };
    let open = match settings.open {
        Some(open) if open.facing == Facing::Poses => {
            Some(Open { facing: Facing::Direction(seen_from(cloud, workers, in_flight)?), ..open })
        }
        open => open,
    };
    let fits = |error| match error {
        Error::Raster { cells, axis, limit, .. } if cloud.measure() == Some(Measure::Degrees) => Error::Raster {
            cells,
            axis,
            limit,
            advice: "the coordinates are degrees; reproject the input to metres or feet",
        },
        error => error,
    };
    let grid = match &open {
        None => Grid::new(survey.points, &survey.bounds, resolution, settings.axis).map_err(fits)?,
        Some(open) => {
            let turn = open.facing.turn(&survey.bounds)?;
            let bounds = match turn {
                None => survey.bounds,
                Some(turn) => {
                    passes.next();
                    turned_bounds(cloud, turn, workers, in_flight, |records| passes.read(records))?
                }
            };
            let grid =
                open.grid(survey.points, &bounds, resolution, settings.axis, settings.surface.smooth).map_err(fits)?;
            match turn {
                Some(turn) => grid.turned(turn),
                None => grid,
            }
        }
    };
    // A number of slices is one of the whole box, and so are the default cells that k = 4 bounds.
    let grid = match may_have_gaps {
        true => without_gaps(grid, &coarse_grid, settings, |grid, asked| {
            passes.next();
            planes_with_points(cloud, grid, asked, workers, in_flight, |records| passes.read(records))
        })?,
        false => grid,
    };
    progress.end();
    let workload = Workload::new(survey.points, cloud.precision(), &grid, Slabs::of(&settings.surface));
    let workload = workload.with_attributes(cloud.schema().stride()).with_fit(settings.fit());
    let workload = workload.with_bridging(settings.bridged, settings.trim.is_some());
    let workload = workload.with_level(level_to_expect(survey.points, &coarse_grid, &grid));
    let surveying = SurveyWorkload { wanted: needed, ..surveying }.counted(cloud, survey.blocks);
    let workload = workload.with_simplification(settings.simplify).with_survey(surveying);
    let mut workload = workload.with_sights(open.is_none() && !cloud.places().places.is_empty());
    if let Some(open) = &open {
        let of_slice = grid.cells()[open.up(&grid).across()];
        workload = workload.with_columns(ColumnWorkload { of_slice, bridge: open.bridge(&grid) });
        if open.base.is_some() {
            workload = workload.with_walls_at_ends();
        }
    }
    Ok(Surveyed { survey, grid, open, density, coarse_grid, workload, upsampled: None })
}

/// The passes of a survey, which is as far as the records they have read.
struct Passes<'a, 'p> {
    progress: &'a mut Progress<'p>,
    /// Records that the files say they have, or are likely to.
    expected: u64,
    /// Records of the pass under way.
    records: u64,
    /// Passes that there are going to be, as far as is known, and those that are done.
    planned: u64,
    done: u64,
}

impl Passes<'_, '_> {
    /// More records are read.
    fn read(&mut self, records: u64) {
        self.records += records;
        let pass = (self.records as f64 / self.expected.max(1) as f64).min(1.0);
        let part = (self.done as f64 + pass) / self.planned as f64;
        // The points are counted once.
        self.progress.add_weighed(if self.done == 0 { records } else { 0 }, part);
    }

    /// Another pass begins, which has as many records.
    fn next(&mut self) {
        if self.done == 0 {
            self.expected = self.records;
        }
        (self.done, self.records) = (self.done + 1, 0);
        self.planned = self.planned.max(self.done + 1);
    }
}

/// The grid with its wide gaps shortened, if it has any; `look` tells which planes have points.
fn without_gaps(
    grid: Grid,
    coarse_grid: &CoarseGrid,
    settings: &Settings,
    look: impl FnOnce(&Grid, [bool; 3]) -> Result<[Vec<bool>; 3]>,
) -> Result<Grid> {
    let axes = grid.axis().file_axes();
    // Where coordinates are coarse against the box, so is the coarse grid.
    let longest = grid.cells().into_iter().max().map_or(0.0, f64::from) * grid.cell_size();
    let shows = coarse_grid.side() < longest / SHOWN;
    let gaps = coarse_grid.has_gaps();
    let mut asked = axes.map(|a| gaps[a] || !shows);
    let reach = match &settings.open {
        None => settings.seal.radius(grid.cell_size()).unwrap_or(0),
        Some(open) if !matches!(open.facing, Facing::Along { .. }) => return Ok(grid),
        Some(open) => {
            // Heights are no distances between columns.
            asked[open.up(&grid).axis] = false;
            open.bridge(&grid) + heightfield::margin(settings.surface.smooth)
        }
    };
    if asked == [false; 3] {
        return Ok(grid);
    }
    let planes = look(&grid, asked)?;
    Ok(grid.without_gaps(&planes, reach.saturating_mul(4)))
}

/// The coarse grid shows a gap of a thirty-second of the longest side if its cells are smaller than this part of that.
const SHOWN: f64 = 100.0;

/// How many faces a cloud's slabs are going to have, found by a rehearsal; nothing changes where that says nothing. `budget` as for the run.
///
/// # Errors
/// [`Error::Io`], [`Error::Interrupted`].
pub fn rehearsed(
    surveyed: Surveyed,
    settings: &Settings,
    workers: &Workers,
    workspace: &Workspace,
    budget: u64,
    progress: &mut Progress,
) -> Result<Surveyed> {
    if settings.open.is_none() && surveyed.grid.has_gaps() {
        // Of a body among far points, the coarse grid has hardly a cell.
        return Ok(surveyed);
    }
    let Surveyed { workload, coarse_grid, grid, .. } = &surveyed;
    progress.begin(Phase::Rehearse, None);
    let known = EstimateInput { workload, coarse_grid, grid, settings };
    let told = |done, total| {
        progress.set_total(total);
        progress.set(done);
    };
    let workload = match &surveyed.open {
        None => estimate_faces(known, workers, workspace, budget, told)?,
        Some(open) => estimate_open_faces(known, open, workers, workspace, budget, told)?,
    };
    progress.end();
    Ok(Surveyed { workload, ..surveyed })
}

/// The farthest that points in single precision may lie: corners of cells lie a few extents beyond them, and must be numbers, too.
const FARTHEST_SINGLE: f64 = f32::MAX as f64 / 64.0;
