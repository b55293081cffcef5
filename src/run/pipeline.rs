//! The run, phase by phase: survey, bucket, raster, seal, surface.
//!
//! The rest of a run (checking the mesh, writing it) needs the finished mesh only and is [`crate::run`]'s.

use bytesize::ByteSize;

use crate::error::{Error, Result};
use crate::grid::bucket::{self, Buckets, Compared};
use crate::grid::context::Context;
use crate::input::{Carried, Cloud};
use crate::nearest::bridged::with_bridged;
use crate::points::{Coordinate, Precision};
use crate::resources::memory::MemoryPlan;
use crate::resources::workers::Workers;
use crate::run::closed_cells::{self, ClosedCells, closed_cells};
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::run::surface::{Reconstructed, surface_of};
use crate::run::surveyed::Surveyed;
use crate::settings::Settings;
use crate::stitch::VERTEX_LIMIT;
use crate::storage::spool::Workspace;

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
    if settings.bridged {
        // Told before the work, not after it.
        with_bridged(cloud.schema())?;
    }
    let work = context.work.as_deref();
    let kept = |work| Buckets::committed(work, [bucket::PHASE.to_owned()], &surveyed.grid, Compared::Now, context);
    let kept = work.map(kept).transpose()?.flatten();
    let buckets: Buckets<T> = match kept {
        Some(buckets) => buckets,
        None => {
            let buckets = bucketed(cloud, surveyed, context, progress)?;
            work.map_or(Ok(()), |work| buckets.commit(work, bucket::PHASE))?;
            buckets
        }
    };
    let kept = work.map(|work| ClosedCells::committed(work, closed_cells::PHASE, context)).transpose()?.flatten();
    let cells = match kept {
        Some(cells) => cells,
        None => {
            let cells = closed_cells(cloud, surveyed, settings, &buckets, context, progress)?;
            work.map_or(Ok(()), |work| cells.commit(work, closed_cells::PHASE))?;
            cells
        }
    };
    surface_of(cloud.schema(), surveyed, settings, (buckets, cells), context, progress)
}

/// The points, sorted.
fn bucketed<T: Coordinate>(
    cloud: &Cloud,
    surveyed: &Surveyed,
    context: &Context,
    progress: &mut Progress,
) -> Result<Buckets<T>> {
    let Surveyed { survey, grid, .. } = surveyed;
    progress.begin(Phase::Bucket, Some(survey.records()));
    let input = (cloud, surveyed.added(), Carried::Attributes);
    let buckets = Buckets::<T>::fill(input, grid, context, |records| progress.add(records))?;
    if buckets.point_count() != survey.points {
        return Err(Error::malformed(
            &cloud.sources()[0].path,
            "the second pass",
            format!("the {} points of the first", survey.points),
            format!("{}; was the input changed meanwhile?", buckets.point_count()),
        ));
    }
    Ok(buckets)
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
    Ok(Context::new(workers, workspace, memory))
}
