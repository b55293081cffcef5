//! Records that wait for their turn: a spool with a buffer before it.

use bytemuck::Pod;

use crate::error::Result;
use crate::storage::spool::{Spool, Workspace};

/// Records in the order they came, in memory while few.
pub(crate) struct Queue<T> {
    buffer: Vec<T>,
    buffered: usize,
    spool: Spool,
}

impl<T: Pod> Queue<T> {
    /// An empty queue that keeps about `in_memory` bytes in memory.
    pub fn new(workspace: &Workspace, in_memory: u64) -> Queue<T> {
        let buffered = (in_memory / 2 / size_of::<T>() as u64).clamp(1, 8192) as usize;
        Queue { buffer: Vec::new(), buffered, spool: workspace.spool(in_memory / 2) }
    }

    /// Adds a record at the end.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn push(&mut self, record: T) -> Result<()> {
        self.buffer.push(record);
        if self.buffer.len() >= self.buffered {
            self.spool.append(bytemuck::cast_slice(&self.buffer))?;
            self.buffer.clear();
        }
        Ok(())
    }

    /// Visits all records in order.
    ///
    /// # Errors
    /// What `visit` gives, or [`crate::Error::Io`].
    pub fn read(&self, mut visit: impl FnMut(T) -> Result<()>) -> Result<()> {
        let mut piece = vec![T::zeroed(); self.buffered];
        let (mut at, records) = (0, self.spool.len() / size_of::<T>() as u64);
        while at < records {
            piece.truncate((records - at).min(self.buffered as u64) as usize);
            self.spool.read_at(at * size_of::<T>() as u64, bytemuck::cast_slice_mut(&mut piece))?;
            piece.iter().try_for_each(|record| visit(*record))?;
            at += piece.len() as u64;
        }
        self.buffer.iter().try_for_each(|record| visit(*record))
    }
}
