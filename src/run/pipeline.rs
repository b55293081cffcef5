//! The run, phase by phase: survey, bucket, raster, seal, surface.
//!
//! The rest of a run (checking the mesh, writing it) needs the finished mesh only and is [`crate::run`]'s.

use bytesize::ByteSize;

use crate::error::{Error, Result};
use crate::grid::Grid;
use crate::grid::bucket::Buckets;
use crate::grid::coarse::CoarseGrid;
use crate::grid::context::Context;
use crate::grid::occupancy::{Counted, Occupancy, Sampled};
use crate::grid::partition::{REACH, buckets_of, halo, slab_count, slices_of};
use crate::grid::survey::{Density, Survey, Wanted, planes_with_points, seen_from, survey, turned_bounds};
use crate::input::Cloud;
use crate::mesh::spool::{Frame, MeshSpool};
use crate::nearest::bridged::{Bridging, with_bridged};
use crate::points::bounds::Bounds;
use crate::points::{Coordinate, Precision};
use crate::resources::memory::MemoryPlan;
use crate::resources::workers::{Spares, Workers};
use crate::run::bridging::{Trimmed, measured};
use crate::run::estimate::{EstimateInput, estimate_faces, estimate_open_faces, level_to_expect};
use crate::run::fineness::{auto_side, default_side};
use crate::run::forecast;
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::run::workload::{ColumnWorkload, Workload};
use crate::settings::Resolution;
use crate::settings::open::{Facing, Open};
use crate::settings::surface::{Fit, SurfaceOptions};
use crate::settings::{Fineness, Settings};
use crate::solid::close;
use crate::solid::close::{Closed, ClosingOptions, How};
use crate::solid::component::Components;
use crate::solid::heightfield;
use crate::solid::sign::Sights;
use crate::solid::unresolved::NarrowHandles;
use crate::stitch::reach::SeamReport;
use crate::stitch::slab::{Making, SlabMesh};
use crate::stitch::{Counts, Stitched, Stitcher, VERTEX_LIMIT};
use crate::storage::spool::Workspace;
use crate::surface::extract;
use crate::surface::plane;
use crate::surface::thickness::{self, Shell};

/// A surveyed cloud on its grid: all that is known before the first point is sorted.
#[derive(Debug)]
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
}

/// Surveys the cloud and lays the grid.
///
/// # Errors
/// Errors of reading the input and of [`Grid::new`].
pub fn survey_cloud(
    cloud: &Cloud,
    settings: &Settings,
    workers: &Workers,
    progress: &mut Progress,
) -> Result<Surveyed> {
    survey_with(cloud, settings, Sampling::IfNeeded, workers, progress)
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
    progress: &mut Progress,
) -> Result<Surveyed> {
    settings.validate()?;
    let in_flight = 2 * workers.threads();
    let known: Option<u64> = cloud.sources().iter().map(|s| s.records).sum();
    progress.begin(Phase::Survey, known);
    let mut passes = Passes { progress, expected: forecast::records(cloud), records: 0, planned: 1, done: 0 };
    let wanted = match settings.fineness() {
        Fineness::Given(_) if sampling == Sampling::IfNeeded => Wanted::Extent,
        _ => Wanted::Density,
    };
    let (survey, coarse_grid, density) = survey(cloud, wanted, workers, in_flight, |records| passes.read(records))?;
    let farthest = survey.bounds.min.into_iter().chain(survey.bounds.max).fold(0.0, |most: f64, c| most.max(c.abs()));
    if cloud.precision() == Precision::Single && farthest > FARTHEST_SINGLE {
        return Err(Error::Usage(format!(
            "a coordinate of {farthest:e} leaves single precision no room for a surface, which ends at {FARTHEST_SINGLE:e}; scale the points down"
        )));
    }
    // A single place has no sampling distance; any cell does.
    let distance = density.and_then(|density| density.distance);
    let (resolution, may_have_gaps) = match settings.fineness() {
        Fineness::Given(resolution) => (resolution, matches!(resolution, Resolution::Cell(_))),
        Fineness::Sampling => {
            let kind = settings.open.map(|open| open.kind);
            (Resolution::Cell(distance.map_or(1.0, |distance| auto_side(distance, kind))), true)
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
    let grid = match &open {
        None => Grid::new(survey.points, &survey.bounds, resolution, settings.axis)?,
        Some(open) => {
            let turn = open.facing.turn(&survey.bounds)?;
            let bounds = match turn {
                None => survey.bounds,
                Some(turn) => {
                    passes.next();
                    turned_bounds(cloud, turn, workers, in_flight, |records| passes.read(records))?
                }
            };
            let grid = open.grid(survey.points, &bounds, resolution, settings.axis, settings.surface.smooth)?;
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
    let workload = Workload::new(survey.points, cloud.precision(), &grid, settings.surface.smooth);
    let workload = workload.with_attributes(cloud.schema().stride()).with_fit(settings.surface.fit);
    let workload = workload.with_bridging(settings.bridged, settings.trim.is_some());
    let workload = workload.with_level(level_to_expect(survey.points, &coarse_grid, &grid));
    let workload = workload.with_simplification(settings.simplify);
    let mut workload = workload.with_sights(open.is_none() && !cloud.places().places.is_empty());
    if let Some(open) = &open {
        let of_slice = grid.cells()[open.up(&grid).across()];
        workload = workload.with_columns(ColumnWorkload { of_slice, bridge: open.bridge(&grid) });
        if open.base.is_some() {
            workload = workload.with_walls_at_ends();
        }
    }
    Ok(Surveyed { survey, grid, open, density, coarse_grid, workload })
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

/// The plan for a surveyed cloud.
///
/// # Errors
/// [`Error::Budget`]; [`Error::TooManyElements`] if the mesh would exceed what its indices can name.
pub fn plan(surveyed: &Surveyed, workers: &Workers, budget: u64) -> Result<MemoryPlan> {
    let count = surveyed.workload.vertices();
    if count > VERTEX_LIMIT {
        let (limit, carrier) = (VERTEX_LIMIT, "a mesh file's int");
        return Err(Error::TooManyElements { count, what: "vertices", limit, carrier });
    }
    MemoryPlan::for_budget(budget, &surveyed.workload, workers.threads())
}

/// The finished mesh and what is to be told of its making.
#[derive(Debug)]
pub struct Reconstructed {
    /// The mesh.
    pub mesh: MeshSpool,
    /// Taken off its positions: added to them, it gives the input's coordinates.
    pub origin: [f64; 3],
    /// How the cells were closed.
    pub how: How,
    /// Whether a ball fell to smaller ones.
    pub falls: bool,
    /// Handles that are too narrow to be believed, if the mesh could be called sealed without them.
    pub narrow: NarrowHandles,
    /// Occupied cells.
    pub occupied: u64,
    /// Cells with points, but too few to be occupied.
    pub sparse: u64,
    /// What was found and left out, if small components were to be.
    pub components: Option<Components>,
    /// The columns of a surface that is seen from one side.
    pub columns: Option<heightfield::ColumnCounts>,
    /// Solid cells.
    pub solid: u64,
    /// What vertices were moved onto.
    pub fit: Fit,
    /// The shell of points, if it was to tell what they are moved onto.
    pub shell: Option<Shell>,
    /// What became of the vertices, of those that were left out, too.
    pub counts: Counts,
    /// How each seam between two slabs was closed, from the lowest on.
    pub seams: Vec<SeamReport>,
    /// The triangles that were left out as they are far from all points, if they were to be.
    pub trimmed: Option<Trimmed>,
    /// The plan as it was when the solid was known.
    pub memory: MemoryPlan,
}

/// Makes the mesh of a surveyed cloud.
///
/// # Errors
/// Errors of reading the input; [`Error::Io`]; [`Error::Budget`] if a slab turns out to be more than the budget can hold;
/// [`Error::Interrupted`].
pub fn reconstruct(
    cloud: &Cloud,
    surveyed: &Surveyed,
    settings: &Settings,
    context: &Context,
    progress: &mut Progress,
) -> Result<Reconstructed> {
    match surveyed.workload.precision {
        Precision::Single => reconstruct_as::<f32>(cloud, surveyed, settings, context, progress),
        Precision::Double => reconstruct_as::<f64>(cloud, surveyed, settings, context, progress),
    }
}

fn reconstruct_as<T: Coordinate>(
    cloud: &Cloud,
    surveyed: &Surveyed,
    settings: &Settings,
    context: &Context,
    progress: &mut Progress,
) -> Result<Reconstructed> {
    let Surveyed { survey, grid, workload, .. } = surveyed;
    if settings.bridged {
        // Told before the work, not after it.
        with_bridged(cloud.schema())?;
    }
    progress.begin(Phase::Bucket, Some(survey.records()));
    let buckets = Buckets::<T>::fill(cloud, grid, context, |records| progress.add(records))?;
    if buckets.point_count() != survey.points {
        return Err(Error::malformed(
            &cloud.sources()[0].path,
            "the second pass",
            format!("the {} points of the first", survey.points),
            format!("{}; was the input changed meanwhile?", buckets.point_count()),
        ));
    }

    context.memory.between_phases(&context.workers);
    progress.begin(Phase::Raster, Some(survey.points));
    let least = settings.min_points;
    let occupancy = Occupancy::of_buckets(&buckets, grid, least, context, |points| progress.add(points))?;
    if occupancy.occupied == 0 {
        let cells = occupancy.sparse;
        return Err(Error::setting(
            "min_points",
            format!("`min_points` {least}: none of the {cells} cells holds so many points"),
        ));
    }
    context.memory.between_phases(&context.workers);
    progress.begin(Phase::Seal, None);
    let (occupied, sparse) = (occupancy.occupied, occupancy.sparse);
    let asked = ClosingOptions {
        seal: settings.seal,
        window: settings.window,
        keep_outliers: settings.keep_outliers,
        min_component: settings.min_component,
        rough: false,
    };
    let done = |done: u64, total: u64| {
        progress.set_total(total);
        progress.set(done);
    };
    let closed = match &settings.open {
        None => {
            let sights = Sights::of(cloud, grid);
            close::close_seen(occupancy, grid.cell_size(), asked, sights.as_ref(), context, done)?
        }
        Some(open) => {
            let smooth = settings.surface.smooth;
            close::close_below(occupancy, (&buckets, grid), open, asked, smooth, context, done)?
        }
    };
    let counted = if sparse > 0 || closed.components.is_some() || closed.has_outliers() {
        Counted::Occupied
    } else {
        Counted::All
    };
    let sampled = Sampled { buckets: &buckets, occupied: &closed.occupancy.store, grid, counted };
    let signed = matches!(closed.how, How::Sign(_));
    let shell = match signed || settings.surface.fit == Fit::Auto {
        true => thickness::measure(&sampled, &closed.solid, context)?,
        false => None,
    };
    let closed = match signed && !shell.is_some_and(|shell| shell.hides_walls()) {
        true => reopened(closed, &buckets, grid, context, progress)?,
        false => closed,
    };
    let closed = match settings.min_component.filter(|_| signed) {
        Some(least) => Closed { solid: closed.solid.without_specks_of_outside(least, context)?, ..closed },
        None => closed,
    };
    let Closed { solid, occupancy, .. } = &closed;
    let narrow = match &closed.how {
        How::Sign(parted) if parted.is_sealed() => solid.narrow_handles(occupancy, context)?,
        _ => NarrowHandles::default(),
    };
    let sampled = Sampled { buckets: &buckets, occupied: &occupancy.store, grid, counted };
    let surface = SurfaceOptions {
        fit: settings.surface.fit.chosen(shell.is_some_and(|shell| shell.is_noisy())),
        ..settings.surface
    };

    let smooth = surface.smooth;
    let faces_of_slab = |number: u32| {
        let slab = slices_of(number, smooth, solid.cells[1]);
        solid.faces[slab.start as usize..slab.end as usize].iter().map(|f| u64::from(*f)).sum::<u64>()
    };
    let slabs = slab_count(smooth, solid.cells[1]);
    let means = match surface.fit {
        Fit::Plane => plane::bytes(&occupancy.in_slice, grid.cells(), smooth),
        _ => 0,
    };
    let workload =
        workload.with_faces_of_slices(&extract::weights(solid, context)?, closed.falls).with_fit(surface.fit);
    let points: Vec<u64> = (0..buckets.count()).map(|bucket| buckets.points_in(bucket)).collect();
    let workload = workload.with_buckets(&points);
    let points_of_slab = |number: u32| {
        let buckets = buckets_of(slices_of(number, smooth, solid.cells[1]));
        points[buckets.start as usize..(buckets.end as usize).min(points.len())].iter().sum::<u64>()
    };
    let work = |faces: u64, points: u64| forecast::surface(2.0 * faces as f64, points as f64);
    let faces: u64 = (0..slabs).map(faces_of_slab).sum();
    let (all, mut done) = (work(faces, survey.points).max(1.0), 0.0);
    progress.learn(|known| known.triangles = 2 * faces);
    context.memory.between_phases(&context.workers);
    progress.begin(Phase::Surface, Some(faces));
    let memory = context.memory.with_surface(&workload, means)?;
    let jobs = memory.slab_jobs(&workload, means)?;
    let origin = origin(T::PRECISION, &survey.bounds);
    let mesh = MeshSpool::with_attributes(&context.workspace, T::PRECISION, cloud.schema().clone(), memory.mesh_quota);
    let frame = Frame { origin, precision: T::PRECISION };
    let mut stitcher = Stitcher::new(
        grid,
        halo(smooth),
        frame,
        mesh,
        closed.solid.ground.as_ref().is_some_and(|ground| ground.trimmed),
    );
    let making = Making { solid, sampled: &sampled, options: surface, frame, jobs };
    let written: Spares<SlabMesh<T>> = Spares::default();
    let mut number = 0;
    context.workers.in_order_range(
        jobs.in_flight(),
        slabs as usize,
        |number| {
            // Slabs differ: a narrow one that kept a wide one's room would hold it while the next wide one is made.
            let size = workload.slabs()[number];
            let room = written.take().filter(|room| room.suits(size));
            let room = room.unwrap_or_else(|| SlabMesh::with_room(size, settings.surface.smooth));
            SlabMesh::make(number as u32, &making, room)
        },
        |slab| {
            let (faces, points) = (faces_of_slab(number), points_of_slab(number));
            number += 1;
            done += work(faces, points);
            progress.add_weighed(faces, done / all);
            stitcher.add(slab)?.into_iter().for_each(|slab| written.give(slab));
            Ok(())
        },
    )?;
    let Stitched { mesh, mut counts, seams } = stitcher.finish()?;
    drop(written);
    memory.between_phases(&context.workers);
    progress.end();
    let (mesh, trimmed) = match settings.bridged || settings.trim.is_some() {
        true => {
            let trim = settings.trim.map(|d| d.length(Some(grid.cell_size()), survey.bounds.longest_side()));
            let asked = Bridging {
                carried: settings.bridged,
                trim: trim.transpose()?,
                reach: f64::from(REACH) * grid.cell_size(),
            };
            measured(mesh, asked, &mut counts, (&sampled, origin), (&memory, context), progress)?
        }
        false => (mesh, None),
    };
    Ok(Reconstructed {
        mesh,
        origin,
        how: closed.how,
        falls: closed.falls,
        narrow,
        occupied,
        sparse,
        components: closed.components,
        columns: closed.solid.ground.as_ref().map(|ground| ground.found),
        solid: closed.solid.volume,
        fit: surface.fit,
        shell: shell.filter(|_| settings.surface.fit == Fit::Auto),
        counts,
        seams,
        trimmed,
        memory,
    })
}

/// What was closed, with what that filled opened again where the points say so.
fn reopened<T: Coordinate>(
    closed: Closed,
    buckets: &Buckets<T>,
    grid: &Grid,
    context: &Context,
    progress: &mut Progress,
) -> Result<Closed> {
    context.memory.between_phases(&context.workers);
    progress.begin(Phase::Reopen, None);
    let Closed { solid, occupancy, .. } = closed;
    let coarser = occupancy.coarser(context)?.occupied;
    let side = close::side_in_samples(occupancy.occupied as f64 / coarser.max(1) as f64);
    let sampled = Sampled { buckets, occupied: &occupancy.store, grid, counted: Counted::All };
    let solid = solid.reopened(&sampled, side, context, |done, total| {
        progress.set_total(total);
        progress.set(done);
    })?;
    Ok(Closed { solid, occupancy, ..closed })
}

/// The farthest that points in single precision may lie: corners of cells lie a few extents beyond them, and must be numbers, too.
const FARTHEST_SINGLE: f64 = f32::MAX as f64 / 64.0;

/// What is taken off positions so that formats and programs with `f32` coordinates keep their resolution: nothing for
/// `f32` input, whose coordinates are written as they are, and nothing for boxes near zero.
///
/// Else a round number below the box: no more than a factor of two from any coordinate, so that the
/// difference of a coordinate and the origin is exact in `f64`, and adding the origin gives the coordinate back, bit for bit.
fn origin(precision: Precision, bounds: &Bounds) -> [f64; 3] {
    let extent = bounds.extent().into_iter().fold(0.0, f64::max);
    if precision == Precision::Single || extent <= 0.0 {
        return [0.0; 3];
    }
    let step = 10f64.powi(libm::log10(extent).floor() as i32);
    std::array::from_fn(|a| {
        let near = bounds.min[a].abs().min(bounds.max[a].abs());
        let same_sign = (bounds.min[a] > 0.0) == (bounds.max[a] > 0.0);
        // Sixteen extents away from zero, all coordinates and a multiple of the step below them are within a factor of two.
        if same_sign && near > 16.0 * extent { (bounds.min[a] / step).floor() * step } else { 0.0 }
    })
}

/// The context of a run: `threads` workers, the work directory, and the plan.
///
/// # Errors
/// Those of [`plan`]; [`Error::Io`]; [`Error::Disk`] if the work directory has less room than the plan asks for.
pub fn context(surveyed: &Surveyed, workers: &Workers, workspace: &Workspace, budget: u64) -> Result<Context> {
    let memory = plan(surveyed, workers, budget)?;
    let available = workspace.available()?;
    if available < memory.predicted_disk {
        return Err(Error::Disk {
            path: workspace.dir().to_path_buf(),
            available: ByteSize(available),
            needed: ByteSize(memory.predicted_disk),
            capacity: ByteSize(workspace.capacity()?),
        });
    }
    Ok(Context { workers: workers.clone(), workspace: workspace.clone(), memory })
}
