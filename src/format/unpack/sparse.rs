//! Contents whose length is known beforehand, and that are filled from several threads, or left with holes.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

use crossbeam_channel::RecvTimeoutError;

use super::{Unpacked, Unpacking};
use crate::error::{Error, Result};
use crate::storage::mapped::{Content, FAULT_WINDOW};
use crate::storage::spool::ScratchFile;

/// Bytes that are fetched at a time, and threads that fetch.
const PIECE: u64 = 4 << 20;
const THREADS: usize = 3;

/// Stretches so near to each other are fetched as one.
const NEAR: u64 = 32 << 10;

/// How often whoever watches is told how far it is.
const LOOK: Duration = Duration::from_millis(100);

/// A content of which any stretch may be missing.
pub struct Sparse {
    file: Arc<ScratchFile>,
    start: u64,
    len: u64,
}

impl Unpacking<'_> {
    /// A content of so many bytes, all of which are missing.
    ///
    /// # Errors
    /// [`Error::Io`] if no temporary file can be created.
    pub fn sparse(&mut self, len: u64) -> Result<Sparse> {
        let stretch = self.begin()?;
        let (file, start) = (Arc::clone(&stretch.file), stretch.start);
        self.end = (start + len).next_multiple_of(FAULT_WINDOW as u64);
        self.objects += len;
        // What is missing is read as zeros, behind the last that is there, too.
        file.reach(self.end)?;
        Ok(Sparse { file, start, len })
    }

    /// Has stretches of a content fetched, each of its pieces by a call of `read`, from several threads. Tells how many bytes that were.
    ///
    /// # Errors
    /// Those of `read`; [`Error::Disk`] before the disk is full; what whoever watches says.
    pub fn fetch(
        &mut self,
        sparse: &Sparse,
        stretches: &[Range<u64>],
        read: &(dyn Fn(Range<u64>) -> Result<Vec<u8>> + Sync),
    ) -> Result<u64> {
        let pieces = pieces(stretches);
        let (next, fetched, stopped) = (AtomicUsize::new(0), AtomicU64::new(0), AtomicBool::new(false));
        let work = || -> Result<()> {
            while let Some(piece) = pieces.get(next.fetch_add(1, Ordering::Relaxed)) {
                if stopped.load(Ordering::Relaxed) {
                    return Err(Error::Interrupted);
                }
                let bytes = read(piece.clone())?;
                sparse.file.write_at(&bytes, sparse.start + piece.start)?;
                fetched.fetch_add(bytes.len() as u64, Ordering::Relaxed);
            }
            Ok(())
        };
        let before = (self.bytes, self.fetched);
        let outcome = if let [one] = &pieces[..] {
            self.told(before, 0)?;
            read(one.clone()).and_then(|bytes| {
                fetched.store(bytes.len() as u64, Ordering::Relaxed);
                sparse.file.write_at(&bytes, sparse.start + one.start)
            })
        } else {
            thread::scope(|scope| {
                let (tell, hear) = crossbeam_channel::unbounded();
                for _ in 0..THREADS.min(pieces.len()) {
                    let tell = tell.clone();
                    scope.spawn(move || drop(tell.send(work())));
                }
                drop(tell);
                let mut outcome = Ok(());
                loop {
                    let heard = hear.recv_timeout(LOOK);
                    let told = match heard {
                        Ok(ended) => ended,
                        Err(RecvTimeoutError::Timeout) => self.told(before, fetched.load(Ordering::Relaxed)),
                        Err(RecvTimeoutError::Disconnected) => return outcome,
                    };
                    // The first that failed says why.
                    if told.is_err() && outcome.is_ok() {
                        stopped.store(true, Ordering::Relaxed);
                        outcome = told;
                    }
                }
            })
        };
        let fetched = fetched.into_inner();
        self.told(before, fetched).and(outcome).map(|()| fetched)
    }

    /// Counts what was fetched, beside what there was `before`, and tells whoever watches.
    fn told(&mut self, before: (u64, u64), fetched: u64) -> Result<()> {
        (self.bytes, self.fetched) = (before.0 + fetched, before.1 + fetched);
        let Unpacking { bytes, finished, reading, total, .. } = *self;
        let read = finished + reading.max(self.fetched - self.fetched_before);
        (self.opening.watch)(Unpacked { bytes, read: total.map_or(read, |total| read.min(total)), total })
    }
}

impl Sparse {
    /// The content, of what messages are to call `name`.
    pub fn content(&self, name: &Path) -> Content {
        Content::unpacked(name, Arc::clone(&self.file), self.start, self.len)
    }
}

/// Stretches in order, joined where they are near, and cut where they are long.
fn pieces(stretches: &[Range<u64>]) -> Vec<Range<u64>> {
    let mut joined: Vec<Range<u64>> = Vec::new();
    for stretch in stretches.iter().filter(|stretch| !stretch.is_empty()) {
        match joined.last_mut() {
            Some(last) if stretch.start <= last.end + NEAR => last.end = last.end.max(stretch.end),
            _ => joined.push(stretch.clone()),
        }
    }
    let cut = |stretch: Range<u64>| {
        let end = stretch.end;
        stretch.step_by(PIECE as usize).map(move |from| from..(from + PIECE).min(end))
    };
    joined.into_iter().flat_map(cut).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_are_joined_and_cut() {
        let far = 3 * PIECE + NEAR + 2;
        let told = pieces(&[0..10, 10 + NEAR..2 * PIECE + 1, 7..7, far..far + 5]);
        assert_eq!(told, [0..PIECE, PIECE..2 * PIECE, 2 * PIECE..2 * PIECE + 1, far..far + 5]);
    }
}
