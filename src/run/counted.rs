//! Counting: the run without its last phase, so that a figure of memory is a promise.
//!
//! What coarse cells let expect ([`crate::run::estimate`]) may be far too little. Where points are sparse, one column of a box ends at its top, the next one at its bottom, and the wall
//! between them is as high as the box; columns twice as wide have points of the top, all of them. Nothing short of the cells themselves tells. So before a least budget is named,
//! points are sorted and cells closed as in the run, and the faces of each slab, the points of each bucket and the means of cells are counted.
//!
//! ```text
//!   survey ─► estimate ─┬─► it fits ────────────────────────────────────────► run: counts once its cells are closed, and shares out anew
//!                       └─► it does not, or the least is asked for ─► count ─► refused with a figure that does, or run
//! ```

use bytesize::ByteSize;

use crate::error::{Error, Result};
use crate::grid::bucket::Buckets;
use crate::grid::context::Context;
use crate::input::{Carried, Cloud};
use crate::points::{Coordinate, Precision};
use crate::resources::memory::MemoryPlan;
use crate::resources::workers::Workers;
use crate::run::closed_cells::closed_cells;
use crate::run::phase::Phase;
use crate::run::progress::{Progress, Show};
use crate::run::surveyed::Surveyed;
use crate::run::workload::Workload;
use crate::settings::Settings;
use crate::storage::spool::Workspace;

/// The counted workload of a surveyed cloud; none if its points would have to go to disk, and the temporary folder has no room for them.
///
/// `budget` is in bytes, as for [`MemoryPlan::for_budget`]; what counting cannot do without is taken in any case.
///
/// # Errors
/// Errors of reading the input and of closing cells, [`Error::Budget`] among them; [`Error::Io`]; [`Error::Interrupted`].
pub(super) fn counted(
    cloud: &Cloud,
    surveyed: &Surveyed,
    settings: &Settings,
    (workers, workspace): (&Workers, &Workspace),
    budget: u64,
    progress: &mut Progress,
) -> Result<Option<Workload>> {
    let expected = &surveyed.workload;
    let memory = plan_before_slabs(expected, workers.threads(), budget)?;
    // Nothing may be written where the input lies, and there may be no other folder.
    let has_room =
        || workspace.available().is_ok_and(|free| free >= memory.predicted_disk) && workspace.scratch_file().is_ok();
    if memory.predicted_disk > 0 && !has_room() {
        return Ok(None);
    }
    let context = Context::new(workers, workspace, memory);
    let workload = match expected.precision {
        Precision::Single => workload::<f32>(cloud, surveyed, settings, &context, progress),
        Precision::Double => workload::<f64>(cloud, surveyed, settings, &context, progress),
    };
    // A finer level may be needed ([`crate::solid::level`]), which is not taken in any case.
    let workload = workload.map_err(|error| match error {
        Error::Budget { needed, what, .. } => Error::Budget { given: ByteSize(budget), needed, what },
        other => other,
    })?;
    context.memory.between_phases(workers);
    Ok(Some(workload))
}

/// The plan for sorting points and closing cells alone: what these cannot do without is taken in any case.
pub(super) fn plan_before_slabs(expected: &Workload, threads: usize, budget: u64) -> Result<MemoryPlan> {
    // All but the slabs, of which none is made.
    let small = expected.clone().without_surface();
    let least = MemoryPlan::least_before_slabs(expected, threads).max(MemoryPlan::least(&small, threads));
    MemoryPlan::for_budget(budget.max(least), &small, threads)
}

/// The workload of a cloud whose points are sorted and whose cells are closed for that, and for nothing else.
fn workload<T: Coordinate>(
    cloud: &Cloud,
    surveyed: &Surveyed,
    settings: &Settings,
    context: &Context,
    progress: &mut Progress,
) -> Result<Workload> {
    let Surveyed { survey, grid, workload, .. } = surveyed;
    // Half of the work is sorting.
    progress.begin(Phase::Rehearse, Some(u64::from(grid.cells()[1])));
    let slices_of = |records: u64| records as f64 / survey.records().max(1) as f64 / 2.0 * f64::from(grid.cells()[1]);
    let mut sorted = 0;
    let buckets = Buckets::<T>::fill((cloud, surveyed.added(), Carried::Coordinates), grid, context, |records| {
        sorted += records;
        progress.set(slices_of(sorted) as u64);
    })?;
    let mut unseen = Progress::new(Show::Nothing);
    let cells = closed_cells(cloud, surveyed, settings, &buckets, context, &mut unseen)?;
    let counted = cells.counted_workload(workload, settings.fit(), &buckets, context)?;
    progress.set(u64::from(grid.cells()[1]));
    progress.end();
    Ok(counted)
}
