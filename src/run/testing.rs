//! What tests of stages need: a context, as a run would have made it.

use std::path::Path;

use crate::grid::Cell;
use crate::grid::context::Context;
use crate::points::Precision;
use crate::resources::memory::MemoryPlan;
use crate::resources::workers::Workers;
use crate::run::workload::Workload;
use crate::storage::spool::Workspace;

/// A context for passes over slices of `cells`, with plenty of memory and `directory` for temporary files.
///
/// # Panics
/// If the directory cannot be used, or threads do not start.
pub fn context(directory: &Path, cells: Cell, threads: usize) -> Context {
    let workload = Workload::in_cells(1000, Precision::Single, cells, 1);
    let memory = MemoryPlan::for_budget(1 << 30, &workload, threads).expect("a GiB is enough");
    let workers = Workers::new(threads).expect("threads start");
    Context::new(&workers, &Workspace::new(directory).expect("temporary files can be made"), memory)
}

/// Runs a test with such a context, two threads, and a directory that is removed behind it.
///
/// # Panics
/// As [`context`].
pub fn with_context<R>(cells: Cell, test: impl FnOnce(&Context) -> R) -> R {
    let directory = tempfile::tempdir().expect("a directory can be made");
    test(&context(directory.path(), cells, 2))
}
