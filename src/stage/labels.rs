//! Joining runs into classes, slice by slice: union-find over a slice's runs, and lists in temporary storage for what is known of them.

use std::marker::PhantomData;

use bytemuck::Pod;

use crate::error::Result;
use crate::slice::Run;
use crate::spool::{Spool, Workspace};

/// Lists of plain values, written one after the other, read by number.
#[derive(Debug)]
pub struct Lists<T> {
    spool: Spool,
    places: Vec<(u64, u32)>,
    values: PhantomData<T>,
}

impl<T: Pod> Lists<T> {
    /// No lists yet; up to `in_memory` bytes stay in memory.
    pub fn new(workspace: &Workspace, in_memory: u64) -> Lists<T> {
        Lists { spool: workspace.spool(in_memory), places: Vec::new(), values: PhantomData }
    }

    /// Appends the next list.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn append(&mut self, list: &[T]) -> Result<()> {
        let at = self.spool.append(bytemuck::cast_slice(list))?;
        self.places.push((at, list.len() as u32));
        Ok(())
    }

    /// Reads list `number` into `out`.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn read(&self, number: u32, out: &mut Vec<T>) -> Result<()> {
        let (at, len) = self.places[number as usize];
        out.resize(len as usize, T::zeroed());
        self.spool.read_at(at, bytemuck::cast_slice_mut(out))
    }

    /// Numbers the lists the other way round: for those written from the last slice to the first.
    pub fn reversed(mut self) -> Lists<T> {
        self.places.reverse();
        self
    }
}

/// Calls `found(i, j)` for every pair of runs of two rows that share a cell coordinate.
pub fn overlaps(a: &[Run], b: &[Run], mut found: impl FnMut(usize, usize)) {
    let (mut i, mut j) = (0, 0);
    while i < a.len() && j < b.len() {
        if a[i].start < b[j].end && b[j].start < a[i].end {
            found(i, j);
        }
        if a[i].end < b[j].end { i += 1 } else { j += 1 }
    }
}

/// The root of an element's set; the way there is halved for the next call.
pub fn find(parents: &mut [u32], mut element: u32) -> u32 {
    while parents[element as usize] != element {
        let grandparent = parents[parents[element as usize] as usize];
        parents[element as usize] = grandparent;
        element = grandparent;
    }
    element
}

/// Makes two sets one. The smaller root becomes the root of both.
pub fn unite(parents: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(parents, a), find(parents, b));
    parents[a.max(b) as usize] = a.min(b);
}
