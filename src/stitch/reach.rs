//! What the closing of a seam reads and changes, in planes: what tells whether stitching could have begun at that seam.
//!
//! ```text
//!   slab k     . . . . .
//!              ~ seam k ~      reads and changes vertices of slab k - 1 down to some plane
//!   slab k-1   . . . . .
//!              ~ seam k-1 ~    changed vertices of slab k - 1 up to some plane
//!   slab k-2   . . . . .
//! ```
//!
//! A slab's vertices are numbered plane by plane, so the least and the greatest number tell the planes. Seam k is *clean* if all that it read of slab k − 1 lies above all
//! that seam k − 1 changed there, and if no vertex of slab k − 1 had to stay because slab k − 2 names it: then seam k comes out the same on slab k − 1 as it was before seam k − 1.
//! What the boxes of blocks of triangles leave out unread is not looked at: they are taken to leave out the same.

use std::cell::Cell;
use std::ops::RangeInclusive;

/// The vertices that the closing of a seam reads and changes. They are numbered as the seam numbers them: the lower slab's, then the upper one's.
#[derive(Debug)]
pub(super) struct Reach {
    /// The lowest and the highest that is read; the first is greater while there is none.
    read: Cell<[u32; 2]>,
    /// The same of those that are changed.
    changed: Cell<[u32; 2]>,
    /// Whether a vertex had to stay as it is because the slab before names it.
    stopped: Cell<bool>,
}

impl Default for Reach {
    fn default() -> Reach {
        Reach { read: Cell::new(NOTHING), changed: Cell::new(NOTHING), stopped: Cell::new(false) }
    }
}

const NOTHING: [u32; 2] = [u32::MAX, 0];

fn with([low, high]: [u32; 2], v: u32) -> [u32; 2] {
    [low.min(v), high.max(v)]
}

fn range([low, high]: [u32; 2]) -> Option<RangeInclusive<u32>> {
    (low <= high).then_some(low..=high)
}

impl Reach {
    #[inline]
    pub fn read(&self, v: u32) {
        self.read.set(with(self.read.get(), v));
    }

    #[inline]
    pub fn change(&self, v: u32) {
        self.changed.set(with(self.changed.get(), v));
    }

    pub fn stop(&self) {
        self.stopped.set(true);
    }

    pub fn is_stopped(&self) -> bool {
        self.stopped.get()
    }

    /// The vertices from the lowest to the highest that was read; a vertex that is changed has been read.
    pub fn all_read(&self) -> Option<RangeInclusive<u32>> {
        range(self.read.get())
    }

    pub fn all_changed(&self) -> Option<RangeInclusive<u32>> {
        range(self.changed.get())
    }
}

/// How a seam was closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct SeamReport {
    /// The plane between the two slabs: the upper one's first slice.
    pub plane: u32,
    /// The lowest and the highest plane with a vertex that was read, if any was.
    pub read: Option<[u32; 2]>,
    /// The lowest and the highest plane with a vertex that was changed, if any was.
    pub changed: Option<[u32; 2]>,
    /// Rounds in which vertices went back.
    pub rounds: u32,
    /// Whether nothing was read that the seam before had changed, and no vertex had to stay because the slab before names it.
    pub clean: bool,
}
