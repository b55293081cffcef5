//! Numbers of vertices where numberings meet, as types: in a slab, as its triangles name it, and in the mesh.
//!
//! ```text
//!   slab k+1  [ 0 1 2 .. ]       what slab k calls      own + v is its vertex v
//!   slab k    [ 0 1 2 .. own )                          v
//!   slab k-1  [ 0 1 2 .. ]                              BEFORE + v is its vertex v
//! ```
//!
//! The two slabs at a seam are numbered through, the lower one's vertices first; those numbers are the plain ones that untangling counts with.

/// A vertex of a slab, by its number there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct InSlab(pub u32);

impl InSlab {
    /// Its place in lists of the slab's vertices.
    #[inline]
    pub fn at(self) -> usize {
        self.0 as usize
    }
}

/// A vertex of the mesh, by its number there: the count of those that are written before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InMesh(pub u32);

/// Where a slab's names of the slab before's vertices begin.
pub const BEFORE: u32 = 1 << 31;

/// A vertex as a slab's triangles name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Named {
    /// Of the slab itself.
    Own(InSlab),
    /// Of the next slab.
    Next(InSlab),
    /// Of the slab before, where the seam below was closed over it.
    Before(InSlab),
}

impl Named {
    /// What a slab of `own` vertices means by a name.
    #[inline]
    pub fn of(name: u32, own: u32) -> Named {
        if name < own {
            Named::Own(InSlab(name))
        } else if name < BEFORE {
            Named::Next(InSlab(name - own))
        } else {
            Named::Before(InSlab(name - BEFORE))
        }
    }

    /// The vertex of the next slab, if it is one.
    pub fn of_next(self) -> Option<InSlab> {
        if let Named::Next(v) = self { Some(v) } else { None }
    }
}
