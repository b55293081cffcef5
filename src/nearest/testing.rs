//! What tests of several modules need.

use super::room::Room;
use crate::resources::workers::Workers;
use crate::storage::spool::Workspace;

/// Runs a test in a temporary folder, with so many threads and plenty of memory.
pub(crate) fn with_room<R>(threads: usize, test: impl FnOnce(Room) -> R) -> R {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let workers = Workers::new(threads).unwrap();
    test(Room::new(1 << 26, &workers, &workspace))
}
