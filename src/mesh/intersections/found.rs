//! What the search for intersections has found, and when it ends.

/// Triangles of a cell that are searched in memory.
const HELD: usize = 1 << 15;
/// Triangles that a cell is meant to have: fewer than are held, as a sample shows only about how many there will be.
const MEANT: u64 = HELD as u64 / 4;
/// Cells of one distribution at most.
const CELLS: usize = 1 << 12;
/// Boxes of a sample.
const SAMPLE: u64 = 1 << 14;
/// Pairs after which counting ends: who has so many has no use for the rest.
const MOST_PAIRS: u64 = 1_000_000;
/// Work after which the search ends, in comparisons of boxes: so much, and so much for each triangle. A usual mesh takes
/// a tenth of the latter; the former is some seconds.
const MOST_WORK: (u64, u64) = (1 << 32, 1 << 12);

/// Two triangles that intersect.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Intersection {
    /// The triangles' numbers, from 0, in ascending order.
    pub triangles: [u64; 2],
    /// The middle of what their boxes have in common, in the mesh's coordinates.
    pub at: [f64; 3],
}

impl Intersection {
    /// Leaves the one with the lower numbers in `first`.
    pub(super) fn keep_first(first: &mut Option<Intersection>, other: Option<Intersection>) {
        let numbers = |found: &Option<Intersection>| found.as_ref().map(|found| found.triangles);
        if first.is_none() || other.is_some() && numbers(&other) < numbers(first) {
            *first = other;
        }
    }
}

/// When a cell is distributed and when the search ends. Fixed by the mesh, as they may show in the findings.
#[derive(Debug, Clone)]
pub(super) struct Limits {
    pub(super) held: u64,
    pub(super) cells: usize,
    pub(super) sample: u64,
    pub(super) pairs: u64,
    pub(super) work: u64,
}

impl Limits {
    pub(super) fn of(triangles: u64) -> Limits {
        let (base, each) = MOST_WORK;
        let work = base.saturating_add(triangles.saturating_mul(each));
        Limits { held: HELD as u64, cells: CELLS, sample: SAMPLE, pairs: MOST_PAIRS, work }
    }

    /// Cells for so many triangles.
    pub(super) fn cells_for(&self, triangles: u64) -> usize {
        let meant = MEANT.min(self.held.div_ceil(4));
        triangles.div_ceil(meant).clamp(2, self.cells as u64) as usize
    }
}

/// What the cells so far have shown.
#[derive(Debug, Default)]
pub(super) struct Found {
    pub(super) pairs: u64,
    /// The numbers of triangles that intersect another, some of them several times.
    pub(super) involved: Vec<u64>,
    pub(super) first: Option<Intersection>,
    pub(super) work: u64,
    pub(super) complete: bool,
}

impl Found {
    pub(super) fn add(&mut self, other: Found) {
        self.pairs += other.pairs;
        self.involved.extend(other.involved);
        Intersection::keep_first(&mut self.first, other.first);
        self.work = self.work.saturating_add(other.work);
        self.complete &= other.complete;
    }

    /// Whether the search is to end before its time.
    pub(super) fn enough(&self, limits: &Limits) -> bool {
        self.pairs > limits.pairs || self.work >= limits.work
    }
}

/// A triangle with all that the search needs: 92 bytes.
#[derive(Debug, Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C, packed)]
pub(super) struct Record {
    pub(super) corners: [[f64; 3]; 3],
    pub(super) vertices: [u32; 3],
    pub(super) number: u64,
}
