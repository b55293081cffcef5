//! The triangles of every cell, in one spool: a cell's pile is a chain of pages, each with the place of the one before.
//!
//! ```text
//!  spool   | end  aaaa | end  bbbb | 0  aaaa | 2  aaaa | 1  bbbb |     pile a: pages 0, 2, 3; pile b: 1, 4
//!  memory  a: aa   b: bbb   c: c                                       at most a page of each pile
//! ```

use super::cells::{Cuboid, Tree};
use crate::error::Result;
use crate::spool::{Spool, Workspace};

/// No page before this one.
const END: u64 = u64::MAX;
/// Bytes of a page before its records.
const LINK: usize = size_of::<u64>();

/// A triangle with all that the search needs: 92 bytes.
#[derive(Debug, Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C, packed)]
pub(super) struct Record {
    pub corners: [[f64; 3]; 3],
    pub vertices: [u32; 3],
    pub number: u64,
}

/// Piles of records. Memory: a page for each pile, and what the spool keeps.
pub(super) struct Piles {
    piles: Vec<Pile>,
    /// Records of a page.
    page: usize,
    spool: Spool,
}

struct Pile {
    records: u64,
    /// The page in the making, its link first.
    buffer: Vec<u8>,
}

impl Piles {
    /// So many empty piles, whose pages take about `pages` bytes together; `in_memory` bytes of full pages stay in memory.
    pub fn new(count: usize, pages: u64, in_memory: u64, workspace: &Workspace) -> Piles {
        let page = (pages / count as u64 / size_of::<Record>() as u64).clamp(8, 512) as usize;
        let piles = (0..count).map(|_| Pile { records: 0, buffer: END.to_ne_bytes().to_vec() }).collect();
        Piles { piles, page, spool: workspace.spool(in_memory) }
    }

    /// The number of records in a pile.
    pub fn records(&self, pile: usize) -> u64 {
        self.piles[pile].records
    }

    /// Puts a record on a pile.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn push(&mut self, pile: usize, record: &Record) -> Result<()> {
        let Pile { records, buffer } = &mut self.piles[pile];
        if *records > 0 && records.is_multiple_of(self.page as u64) {
            let at = self.spool.append(buffer)?;
            buffer.clear();
            buffer.extend_from_slice(&at.to_ne_bytes());
        }
        buffer.extend_from_slice(bytemuck::bytes_of(record));
        *records += 1;
        Ok(())
    }

    /// Puts a record on the piles of all cells that its triangle's box touches.
    ///
    /// # Errors
    /// As [`Piles::push`].
    pub fn push_to_all(&mut self, tree: &Tree, record: &Record) -> Result<()> {
        let mut result = Ok(());
        tree.visit(&Cuboid::around(record.corners), &mut |cell| {
            if result.is_ok() {
                result = self.push(cell as usize, record);
            }
        });
        result
    }

    /// Visits a pile's records, the last first.
    ///
    /// # Errors
    /// What `visit` gives, or [`crate::Error::Io`].
    pub fn read(&self, pile: usize, mut visit: impl FnMut(&Record) -> Result<()>) -> Result<()> {
        let mut page = self.piles[pile].buffer.clone();
        loop {
            let (link, records) = page.split_at(LINK);
            bytemuck::cast_slice(records).iter().rev().try_for_each(&mut visit)?;
            let before = u64::from_ne_bytes(link.try_into().expect("a page begins with its link"));
            if before == END {
                return Ok(());
            }
            page.resize(LINK + self.page * size_of::<Record>(), 0);
            self.spool.read_at(before, &mut page)?;
        }
    }
}
