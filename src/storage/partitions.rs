//! Records in partitions, in one spool: a partition is a chain of pages, each with the place of the one before.
//!
//! ```text
//!  spool   | end  aaaa | end  bbbb | 0  aaaa | 2  aaaa | 1  bbbb |     partition a: pages 0, 2, 3; partition b: 1, 4
//!  memory  a: aa   b: bbb   c: c                                       at most a page of each partition
//! ```

use std::marker::PhantomData;

use bytemuck::Pod;

use crate::error::Result;
use crate::storage::spool::{Spool, Workspace};

/// No page before this one.
const END: u64 = u64::MAX;
/// Bytes of a page before its records.
const LINK: usize = size_of::<u64>();

/// Partitions of records. Memory: a page for each partition, and what the spool keeps.
pub(crate) struct Partitions<T> {
    partitions: Vec<Partition>,
    /// Records of a page.
    page: usize,
    spool: Spool,
    records: PhantomData<T>,
}

struct Partition {
    records: u64,
    /// The page in the making, its link first.
    buffer: Vec<u8>,
}

impl<T: Pod> Partitions<T> {
    /// So many empty partitions, whose pages take about `pages` bytes together; `in_memory` bytes of full pages stay in memory.
    pub fn new(count: usize, pages: u64, in_memory: u64, workspace: &Workspace) -> Partitions<T> {
        let page = (pages / count.max(1) as u64 / size_of::<T>() as u64).clamp(8, 512) as usize;
        let partitions = (0..count).map(|_| Partition { records: 0, buffer: END.to_ne_bytes().to_vec() }).collect();
        Partitions { partitions, page, spool: workspace.spool(in_memory), records: PhantomData }
    }

    /// The number of partitions.
    pub fn count(&self) -> usize {
        self.partitions.len()
    }

    /// The number of records in a partition.
    pub fn records(&self, partition: usize) -> u64 {
        self.partitions[partition].records
    }

    /// Puts a record into a partition.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn push(&mut self, partition: usize, record: &T) -> Result<()> {
        let Partition { records, buffer } = &mut self.partitions[partition];
        if *records > 0 && records.is_multiple_of(self.page as u64) {
            let at = self.spool.append(buffer)?;
            buffer.clear();
            buffer.extend_from_slice(&at.to_ne_bytes());
        }
        buffer.extend_from_slice(bytemuck::bytes_of(record));
        *records += 1;
        Ok(())
    }

    /// Visits a partition's records, the last first.
    ///
    /// # Errors
    /// What `visit` gives, or [`crate::Error::Io`].
    pub fn read(&self, partition: usize, mut visit: impl FnMut(&T) -> Result<()>) -> Result<()> {
        let mut page = self.partitions[partition].buffer.clone();
        loop {
            let (link, records) = page.split_at(LINK);
            each(records).rev().try_for_each(|record| visit(&record))?;
            let Some(before) = place(link) else { return Ok(()) };
            page.resize(LINK + self.page * size_of::<T>(), 0);
            self.spool.read_at(before, &mut page)?;
        }
    }

    /// Takes the last page off a partition and adds its records to `out`; `false` if the partition is empty. Others may be pushed meanwhile.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn take(&mut self, partition: usize, out: &mut Vec<T>) -> Result<bool> {
        let Partition { records, buffer } = &mut self.partitions[partition];
        if *records == 0 {
            return Ok(false);
        }
        let (link, last) = buffer.split_at(LINK);
        out.extend(each::<T>(last));
        *records -= (last.len() / size_of::<T>()) as u64;
        match place(link) {
            Some(before) => {
                buffer.resize(LINK + self.page * size_of::<T>(), 0);
                self.spool.read_at(before, buffer)?;
            }
            // Its memory goes, too: most partitions that were emptied stay so.
            None => *buffer = END.to_ne_bytes().to_vec(),
        }
        Ok(true)
    }
}

/// The records of a page. Pages are bytes, which may lie anywhere.
fn each<T: Pod>(records: &[u8]) -> impl DoubleEndedIterator<Item = T> {
    records.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned)
}

/// Where the page before lies, if there is one.
fn place(link: &[u8]) -> Option<u64> {
    let before = u64::from_ne_bytes(link.try_into().expect("a page begins with its link"));
    (before != END).then_some(before)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn piles_are_read_backwards_and_taken_apart() {
        let dir = tempfile::tempdir().unwrap();
        let workspace = Workspace::new(dir.path()).unwrap();
        for in_memory in [0, 1 << 20] {
            let mut partitions = Partitions::<[u32; 3]>::new(3, 1, in_memory, &workspace);
            for i in 0..100 {
                partitions.push(i as usize % 2, &[i, 7, i]).unwrap();
            }
            let mut seen = Vec::new();
            let see = |record: &[u32; 3]| {
                seen.push(record[0]);
                Ok(())
            };
            partitions.read(1, see).unwrap();
            assert_eq!(seen, (0..50).rev().map(|i| 2 * i + 1).collect::<Vec<_>>());
            assert_eq!([0, 1, 2].map(|partition| partitions.records(partition)), [50, 50, 0]);
            let (mut taken, mut pushed) = (Vec::new(), 0);
            while partitions.take(0, &mut taken).unwrap() {
                partitions.push(2, &[pushed, 0, 0]).unwrap();
                pushed += 1;
            }
            taken.sort_unstable();
            assert_eq!(taken, (0..50).map(|i| [2 * i, 7, 2 * i]).collect::<Vec<_>>());
            assert_eq!([0, 2].map(|partition| partitions.records(partition)), [0, 7]);
            partitions.push(0, &[1, 2, 3]).unwrap();
            taken.clear();
            assert!(partitions.take(0, &mut taken).unwrap() && !partitions.take(0, &mut taken).unwrap());
            assert_eq!(taken, [[1, 2, 3]]);
        }
    }
}
