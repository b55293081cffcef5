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
//! A slab's vertices are numbered plane by plane, so the least and the greatest number tell the planes. Seam k is *clean* if all that it read of slab k − 1 lies above
//!
//! * all that seam k − 1 *touched* there: vertices that it changed, and the corners of triangles that it named anew, or whose blocks' boxes it widened;
//! * all that slab k − 2 names there, with what a trimmed surface freezes round it.
//!
//! Then every value that seam k met is the one that slab k − 1 has by itself, so seam k comes out the same where slab k − 1 has no slab below it. What boxes leave out
//! unread is the same, too: boxes only grow, and a block whose box seam k − 1 widened holds something touched, which seam k reads if it looks into that block. A triangle of
//! slab k − 1 that names a vertex of slab k − 2 was named anew by seam k − 1. Where all its corners were, none is left to be touched; so if such a triangle is read, the seam is not clean.

use std::cell::Cell;
use std::ops::RangeInclusive;

/// The vertices that the closing of a seam reads and changes. They are numbered as the seam numbers them: the lower slab's, then the upper one's.
#[derive(Debug)]
pub(super) struct Reach {
    /// The lowest and the highest that is read; the first is greater while there is none.
    read: Cell<[u32; 2]>,
    /// The same of those that are changed.
    changed: Cell<[u32; 2]>,
    /// The highest vertex that is touched.
    touched: Cell<Option<u32>>,
    /// Whether a triangle of the lower slab was read that names a vertex of the slab before it.
    beyond: Cell<bool>,
}

impl Default for Reach {
    fn default() -> Reach {
        Reach {
            read: Cell::new(NOTHING),
            changed: Cell::new(NOTHING),
            touched: Cell::new(None),
            beyond: Cell::new(false),
        }
    }
}

const NOTHING: [u32; 2] = [u32::MAX, 0];

#[inline]
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
        self.touch(v);
    }

    pub fn touch(&self, v: u32) {
        if Part::Touched.is_on() {
            self.touched.set(self.touched.get().max(Some(v)));
        }
    }

    pub fn read_beyond(&self) {
        self.beyond.set(Part::Beyond.is_on());
    }

    /// Whether a triangle of the lower slab was read that names a vertex of the slab before it.
    pub fn has_read_beyond(&self) -> bool {
        self.beyond.get()
    }

    /// The highest vertex that was touched.
    pub fn highest_touched(&self) -> Option<u32> {
        self.touched.get()
    }

    /// The vertices from the lowest to the highest that was read; a vertex that is changed has been read.
    pub fn all_read(&self) -> Option<RangeInclusive<u32>> {
        range(self.read.get())
    }

    pub fn all_changed(&self) -> Option<RangeInclusive<u32>> {
        range(self.changed.get())
    }
}

/// The parts of what makes a seam clean. Tests switch each off and see what is missed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// Nothing is read that the seam before touched: a vertex that it changed, a corner of a triangle that it named anew or for which it widened a block's box;
    Touched,
    /// nor what the slab before names;
    Settled,
    /// nor a triangle that names a vertex of the slab before.
    Beyond,
}

impl Part {
    #[cfg(not(test))]
    #[inline]
    pub fn is_on(self) -> bool {
        true
    }
}

#[cfg(test)]
thread_local! {
    /// The part that is switched off on this thread.
    pub(super) static OFF: Cell<Option<Part>> = const { Cell::new(None) };
}

#[cfg(test)]
impl Part {
    pub fn is_on(self) -> bool {
        OFF.get() != Some(self)
    }
}

/// How a seam was closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct SeamReport {
    /// The plane between the two slabs: the upper one's first slice.
    pub plane: u32,
    /// The lowest and the highest plane with a vertex that was read, if any was.
    pub read: Option<[u32; 2]>,
    /// The lowest and the highest plane with a vertex that was changed, if any was.
    pub changed: Option<[u32; 2]>,
    /// Rounds in which vertices went back.
    pub rounds: u32,
    /// Whether all that was read of the lower slab lies above all that the seam before touched there, and the slab before names: whether the seam would have come out the
    /// same without them.
    pub clean: bool,
}
