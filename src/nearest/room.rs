//! What a comparison may use: the budget as sizes, none of which shows in what it finds.

use bytemuck::Pod;

use crate::resources::workers::Workers;
use crate::storage::partitions::Partitions;
use crate::storage::spool::{Spool, Workspace};

/// Workers, temporary storage, and the shares of the budget.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room<'a> {
    pub workers: &'a Workers,
    pub workspace: &'a Workspace,
    /// Bytes for the block that is searched.
    pub block: u64,
    /// Bytes for the pages of partitions: there may be two sets of them at a time.
    pub pages: u64,
    /// Bytes that each store may keep in memory: targets, two sets of partitions, and distances.
    pub kept: u64,
    /// Bytes for the triangles of which the corners are looked up, by each job.
    pub corners: u64,
    /// Jobs under way at a time.
    pub in_flight: usize,
}

impl<'a> Room<'a> {
    /// The shares of a budget.
    pub fn new(budget: u64, workers: &'a Workers, workspace: &'a Workspace) -> Room<'a> {
        let in_flight = workers.threads() + 1;
        // Three eighths for the block, two for pages, one and a half for four stores, one for corners; half of one is left for what is too small to plan.
        Room {
            workers,
            workspace,
            block: budget / 8 * 3,
            pages: budget / 8,
            kept: budget / 32,
            corners: budget / 8 / in_flight as u64,
            in_flight,
        }
    }

    /// Bytes for all triangles together whose corners lie far apart in the mesh: what those of all jobs have, and as much as one set of partitions.
    pub fn far(&self) -> u64 {
        self.corners * self.in_flight as u64 + self.pages + self.kept
    }

    /// A store.
    pub fn spool(&self) -> Spool {
        self.workspace.spool(self.kept)
    }

    /// Empty partitions, within `depth` others.
    pub fn partitions<T: Pod>(&self, count: usize, depth: u32) -> Partitions<T> {
        let share = |bytes: u64| bytes.checked_shr(depth).unwrap_or(0);
        Partitions::new(count, share(self.pages), share(self.kept), self.workspace)
    }
}
