//! The last phase of a run's pipeline: from closed cells and sorted points to the mesh.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use crate::error::{Error, Result};
use crate::grid::bucket::Buckets;
use crate::grid::context::Context;
use crate::grid::occupancy::Sampled;
use crate::grid::partition::{REACH, Slabs, buckets_of, halo, slab_count, slices_of};
use crate::mesh::spool::{Frame, MeshSpool};
use crate::nearest::bridged::Bridging;
use crate::points::attribute::Schema;
use crate::points::bounds::Bounds;
use crate::points::{Coordinate, Precision};
use crate::resources::memory::{Claim, MemoryPlan};
use crate::resources::workers::Spares;
use crate::run::bridging::{Trimmed, measured};
use crate::run::closed_cells::ClosedCells;
use crate::run::forecast;
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::run::surface_log::{MadeBefore, SurfaceLog};
use crate::run::surveyed::Surveyed;
use crate::run::workload::Workload;
use crate::settings::Settings;
use crate::settings::surface::{Fit, SurfaceOptions};
use crate::solid::close::{Closed, How};
use crate::solid::component::Components;
use crate::solid::heightfield;
use crate::solid::unresolved::NarrowHandles;
use crate::stitch::checkpoint::Checkpoint;
use crate::stitch::counts::Counts;
use crate::stitch::make::Making;
use crate::stitch::pieces::{self, Means};
use crate::stitch::reach::SeamReport;
use crate::stitch::slab::SlabMesh;
use crate::stitch::{Stitched, Stitcher};
use crate::surface::thickness::Shell;

/// A piece gives up if of its first seams, so many, none is clean: where few are, much of it would be made for nothing.
const TRIES: u32 = 3;

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

/// Makes the mesh of closed cells and the points in them.
///
/// # Errors
/// [`Error::Io`]; [`Error::Budget`] if a slab turns out to be more than the budget can hold; [`Error::Interrupted`].
pub(super) fn surface_of<T: Coordinate>(
    schema: &Schema,
    surveyed: &Surveyed,
    settings: &Settings,
    (mut buckets, mut cells): (Buckets<T>, ClosedCells),
    context: &Context,
    progress: &mut Progress,
) -> Result<Reconstructed> {
    let fit = surface_options(settings, &cells).fit;
    let workload = cells.counted_workload(&surveyed.workload, fit, &buckets, context)?;
    let closing = cells.closed_here.then(|| context.account.closing());
    let memory = context.memory.with_surface(&workload, closing)?;
    if memory.buckets_quota < context.memory.buckets_quota {
        buckets.leave_memory(context)?;
    }
    if memory.store_quota < context.memory.store_quota {
        cells.leave_memory()?;
    }
    let counted = (&workload, &memory);
    let of = (&buckets, &cells);
    let stitched = with_slabs((None, counted), surveyed, settings, of, context, progress, |slabs| {
        let Slabwise { slabs, ranges, faces, begun, means } = slabs;
        if let Some(work) = &context.work {
            let (mut log, MadeBefore { mesh, checkpoint, whole }) =
                SurfaceLog::open(work, (T::PRECISION, schema), context)?;
            let mut stitcher = begun(mesh, &checkpoint);
            let first = if whole { slabs } else { stitcher.next() };
            // The mesh lies in files that outlast the run.
            (0..first).for_each(|number| (means.taken)(number, 0));
            let mut number = first;
            let made = means.workers.in_order_range(
                means.in_flight,
                (slabs - first) as usize,
                |job| (means.make)(first + job as u32),
                |slab| {
                    (means.taken)(number, 0);
                    number += 1;
                    stitcher.add(slab)?.into_iter().for_each(|slab| means.spares.give(slab));
                    log.tell(&mut stitcher)
                },
            );
            if let Err(Error::Interrupted) = made {
                log.tell_now(&mut stitcher)?;
            }
            made?;
            let mut stitched = stitcher.finish()?;
            if !whole {
                log.end(&mut stitched, slabs)?;
            }
            return Ok(stitched);
        }
        let all = faces(0..slabs);
        let stitcher = |piece: usize, from: &Checkpoint| {
            // Each has its share of what the mesh may take of memory.
            let quota = match ranges.len() {
                1 => memory.mesh_quota,
                _ => {
                    let of_piece = u128::from(faces(ranges[piece].clone()));
                    (u128::from(memory.mesh_quota) * of_piece / u128::from(all.max(1))) as u64
                }
            };
            begun(MeshSpool::with_attributes(&context.workspace, T::PRECISION, schema.clone(), quota), from)
        };
        pieces::stitch(ranges, &Means { stitcher: &stitcher, ..means })
    })?;
    let memory = memory.with_slabs_made(&workload, &stitched.mesh, context.account.slabs.most());
    reconstructed(stitched, surveyed, settings, (&buckets, cells), memory, context, progress)
}

/// What slabs are made and stitched with.
pub(super) struct Slabwise<'s, 'g, T> {
    /// How many there are.
    pub slabs: u32,
    /// The pieces that are stitched side by side in a process.
    pub ranges: &'s [Range<u32>],
    /// The faces of slabs.
    pub faces: &'s (dyn Fn(Range<u32>) -> u64 + Sync),
    /// A stitcher that appends to a mesh.
    pub begun: &'s (dyn Fn(MeshSpool, &Checkpoint) -> Stitcher<'g, T> + Sync),
    /// All but what stitchers append to.
    pub means: Means<'s, 'g, T>,
}

/// Has the slabs of closed cells stitched, by a workload that was counted and the plan that came of it. Progress is that of the slabs `within` a range, or of all.
///
/// # Errors
/// [`Error::Budget`] if a slab turns out to be more than the budget can hold; those of `stitch`.
pub(super) fn with_slabs<T: Coordinate, R>(
    (within, (workload, memory)): (Option<Range<u32>>, (&Workload, &MemoryPlan)),
    surveyed: &Surveyed,
    settings: &Settings,
    (buckets, cells): (&Buckets<T>, &ClosedCells),
    context: &Context,
    progress: &mut Progress,
    stitch: impl FnOnce(Slabwise<'_, '_, T>) -> Result<R>,
) -> Result<R> {
    let Surveyed { survey, grid, .. } = surveyed;
    let Closed { solid, occupancy, membranes, .. } = &cells.closed;
    let sampled = Sampled { buckets, occupied: &occupancy.store, grid, counted: cells.counted };
    let surface = surface_options(settings, cells);
    let smooth = surface.smooth;
    let partition = Slabs::of(&surface);
    let faces_of_slab = |number: u32| {
        let slab = slices_of(number, partition, solid.cells[1]);
        solid.faces[slab.start as usize..slab.end as usize].iter().map(|f| u64::from(*f)).sum::<u64>()
    };
    let faces = |numbers: Range<u32>| numbers.map(faces_of_slab).sum::<u64>();
    let slabs = slab_count(partition, solid.cells[1]);
    let points_of_slab = |number: u32| {
        let of_slab = buckets_of(slices_of(number, partition, solid.cells[1]));
        let of_slab = of_slab.start as usize..(of_slab.end as usize).min(buckets.count());
        of_slab.map(|bucket| buckets.points_in(bucket)).sum::<u64>()
    };
    let work = |number: u32| forecast::surface(2.0 * faces_of_slab(number) as f64, points_of_slab(number) as f64);
    let within = within.unwrap_or(0..slabs);
    let all = within.clone().map(work).sum::<f64>().max(1.0);
    let faces_within = faces(within);
    progress.learn(|known| known.triangles = 2 * faces_within);
    context.memory.between_phases(&context.workers);
    progress.begin(Phase::Surface, Some(faces_within));
    let jobs = memory.slab_jobs(workload)?;
    let frame = Frame { origin: origin(T::PRECISION, &survey.bounds), precision: T::PRECISION };
    let trimmed = solid.ground.as_ref().is_some_and(|ground| ground.trimmed);
    let begun = |mesh: MeshSpool, from: &Checkpoint| Stitcher::resumed(grid, halo(smooth), frame, mesh, trimmed, from);
    let counting = jobs.told(workload, &context.account.slabs);
    let membranes = membranes.as_ref();
    let making = Making { solid, membranes, sampled: &sampled, options: surface, frame, jobs, told: Some(&counting) };
    let written: Spares<SlabMesh<T>> = Spares::default();
    let make = |number: u32| {
        // Slabs differ: a narrow one that kept a wide one's room would hold it while the next wide one is made.
        let size = workload.slabs()[number as usize];
        let room = written.take().filter(|room| room.suits(size));
        let room = room.unwrap_or_else(|| SlabMesh::with_room(size, settings.surface.smooth));
        SlabMesh::make(number, &making, room)
    };
    let told = Mutex::new((&mut *progress, 0.0, Claim::of(&context.account.slabs)));
    let taken = |number: u32, grown: u64| {
        let (progress, done, mesh) = &mut *told.lock().unwrap_or_else(PoisonError::into_inner);
        *done += work(number);
        mesh.set((mesh.bytes() + grown).min(memory.mesh_quota));
        progress.add_weighed(faces_of_slab(number), *done / all);
        // Else a worker that waits keeps what was freed of the slabs that it made.
        if jobs.gives_back {
            context.workers.give_back_soon();
        }
    };
    let ranges = jobs.ranges(workload);
    let unasked =
        |_: usize, _: &Checkpoint| -> Stitcher<'_, T> { unreachable!("whoever stitches says what to append to") };
    let means = Means {
        workers: &context.workers,
        in_flight: jobs.in_flight(),
        tries: TRIES,
        stitcher: &unasked,
        make: &make,
        taken: &taken,
        spares: &written,
    };
    let stitched = stitch(Slabwise { slabs, ranges: &ranges, faces: &faces, begun: &begun, means })?;
    drop(written);
    memory.between_phases(&context.workers);
    progress.end();
    Ok(stitched)
}

/// The options of a surface, with what its shell of points has chosen.
pub(super) fn surface_options(settings: &Settings, cells: &ClosedCells) -> SurfaceOptions {
    let fit = settings.fit().chosen(cells.shell.is_some_and(|shell| shell.is_noisy()));
    SurfaceOptions { fit, ..settings.surface }
}

/// The stitched mesh with all that is to be told of its making; measured and trimmed, if that is asked for.
///
/// # Errors
/// [`Error::Io`], [`Error::Interrupted`].
pub(super) fn reconstructed<T: Coordinate>(
    stitched: Stitched,
    surveyed: &Surveyed,
    settings: &Settings,
    (buckets, cells): (&Buckets<T>, ClosedCells),
    memory: MemoryPlan,
    context: &Context,
    progress: &mut Progress,
) -> Result<Reconstructed> {
    let Surveyed { survey, grid, .. } = surveyed;
    let fit = surface_options(settings, &cells).fit;
    let ClosedCells { closed, counted, shell, narrow, occupied, sparse, .. } = cells;
    let origin = origin(T::PRECISION, &survey.bounds);
    let Stitched { mesh, mut counts, seams } = stitched;
    let (mesh, trimmed) = match settings.bridged || settings.trim.is_some() {
        true => {
            let trim = settings.trim.map(|d| d.length(Some(grid.cell_size()), survey.bounds.longest_side()));
            let asked = Bridging {
                carried: settings.bridged,
                trim: trim.transpose()?,
                reach: f64::from(REACH) * grid.cell_size(),
            };
            let sampled = Sampled { buckets, occupied: &closed.occupancy.store, grid, counted };
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
        fit,
        shell: shell.filter(|_| settings.surface.fit == Fit::Auto),
        counts,
        seams,
        trimmed,
        memory,
    })
}

/// What is taken off positions so that formats and programs with `f32` coordinates keep their resolution: nothing for
/// `f32` input, whose coordinates are written as they are, and nothing for boxes near zero.
///
/// Else a round number below the box: no more than a factor of two from any coordinate, so that the
/// difference of a coordinate and the origin is exact in `f64`, and adding the origin gives the coordinate back, bit for bit.
pub(super) fn origin(precision: Precision, bounds: &Bounds) -> [f64; 3] {
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
