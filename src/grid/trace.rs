//! Which parts of what a stage is given it has read, and what was in them: while these stay as they are, so does what the stage makes.

use std::collections::BTreeMap;
use std::hash::Hasher;
use std::sync::atomic::{AtomicBool, Ordering};

use rustc_hash::FxHasher;

use crate::error::Result;

/// A digest of bytes. Equal bytes have equal digests; others hardly ever.
pub fn digest(bytes: &[u8]) -> u64 {
    let mut hasher = FxHasher::default();
    hasher.write(bytes);
    hasher.finish()
}

/// The parts that were read, by their numbers, and the digest of each.
pub type Digests = BTreeMap<u32, u64>;

/// Which parts were read.
#[derive(Debug, Default)]
pub struct Trace(Vec<AtomicBool>);

impl Trace {
    /// Of so many parts, none of which was read yet.
    pub fn of(parts: usize) -> Trace {
        Trace(std::iter::repeat_with(AtomicBool::default).take(parts).collect())
    }

    /// Says that a part is read; nothing if nobody asks.
    #[inline]
    pub fn read(&self, part: usize) {
        if let Some(read) = self.0.get(part) {
            read.store(true, Ordering::Relaxed);
        }
    }

    /// The digests of all parts that were read.
    ///
    /// # Errors
    /// Those of `digest`.
    pub fn digests(&self, mut digest: impl FnMut(u32) -> Result<u64>) -> Result<Digests> {
        let read = (0..).zip(&self.0).filter(|(_, read)| read.load(Ordering::Relaxed));
        read.map(|(part, _)| Ok((part, digest(part)?))).collect()
    }
}

/// Whether parts have these digests still, of so many parts that there are now.
///
/// # Errors
/// Those of `digest`.
pub fn are_same(digests: &Digests, parts: usize, mut digest: impl FnMut(u32) -> Result<u64>) -> Result<bool> {
    for (part, before) in digests {
        if *part as usize >= parts || digest(*part)? != *before {
            return Ok(false);
        }
    }
    Ok(true)
}
