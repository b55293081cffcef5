//! A checkpoint: what is to be known to go on with stitching from a clean seam.

use serde::{Deserialize, Serialize};

use crate::stitch::counts::Counts;
use crate::stitch::reach::SeamReport;

/// All slabs below one are written, and the seam below that one is clean. With these figures, that slab and the one below it, each made anew, all others are written as in one
/// run ([`Stitcher::resumed`](super::Stitcher::resumed)).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    /// The first slab that is not written. Stitching goes on with the slab before it, if there is one.
    pub slab: u32,
    /// Vertices that are written.
    pub vertices: u64,
    /// Triangles that are written.
    pub faces: u64,
    /// What became of the vertices of the slabs that are written, but for the area, of which `area` has all bits.
    counts: Counts,
    /// The bits of [`Counts::bridged_area`]: text may round it.
    area: u64,
    /// The seams up to that below `slab`.
    pub seams: Vec<SeamReport>,
}

impl Checkpoint {
    /// Of stitching that begins at a slab, with its first vertex as number 0.
    pub fn at(slab: u32) -> Checkpoint {
        Checkpoint::new(slab, [0; 2], Counts::default(), Vec::new())
    }

    pub(super) fn new(slab: u32, [vertices, faces]: [u64; 2], counts: Counts, seams: Vec<SeamReport>) -> Checkpoint {
        let area = counts.bridged_area.to_bits();
        Checkpoint { slab, vertices, faces, counts: Counts { bridged_area: 0.0, ..counts }, area, seams }
    }

    /// What became of the vertices of the slabs that are written.
    pub fn counts(&self) -> Counts {
        Counts { bridged_area: f64::from_bits(self.area), ..self.counts }
    }
}

/// [`Checkpoint`] in short: what a piece writes below a clean seam.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mark {
    pub slab: u32,
    pub vertices: u64,
    pub faces: u64,
    pub counts: Counts,
}
