//! Which triangles of a piece come near a place: a tree of boxes that follows its triangles.

use glam::DVec3;

/// Triangles of a leaf.
const LEAF: usize = 4;
/// A place of a leaf without a triangle.
const NONE: u32 = u32::MAX;

/// An axis-parallel box in single precision, never less than what it holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extent {
    low: [f32; 3],
    high: [f32; 3],
}

impl Extent {
    const EMPTY: Extent = Extent { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };

    /// The box of some places.
    pub(super) fn of(places: impl IntoIterator<Item = DVec3>) -> Extent {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for place in places {
            low = low.min(place);
            high = high.max(place);
        }
        Extent { low: low.to_array().map(below), high: high.to_array().map(above) }
    }

    /// The box of both.
    pub(super) fn with(self, other: Extent) -> Extent {
        let low = std::array::from_fn(|a| self.low[a].min(other.low[a]));
        let high = std::array::from_fn(|a| self.high[a].max(other.high[a]));
        Extent { low, high }
    }

    /// Whether they have a place in common.
    pub(super) fn meets(&self, other: &Extent) -> bool {
        (0..3).all(|a| self.low[a] <= other.high[a] && other.low[a] <= self.high[a])
    }
}

/// The nearest number of single precision that is not greater.
fn below(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) > x { near.next_down() } else { near }
}

/// The nearest number of single precision that is not less.
fn above(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) < x { near.next_up() } else { near }
}

/// A binary tree over triangles in the order of a curve that fills space. A triangle that changes keeps its place.
///
/// ```text
///            0                node i has the children 2i + 1 and 2i + 2;
///         1     2             its box holds theirs; the last row are the leaves
///        3  4  5  6
/// ```
#[derive(Debug, Default)]
pub(super) struct Boxes {
    nodes: Vec<Extent>,
    /// The triangles of leaf l: `LEAF` from `LEAF * l`.
    triangles: Vec<u32>,
    /// Of each triangle: its leaf.
    leaves: Vec<u32>,
    /// Nodes to be looked at.
    waiting: Vec<u32>,
}

impl Boxes {
    /// Bytes for each triangle, at most: two boxes a leaf, as many leaves again to make a power of two, a place and a leaf.
    pub(super) const BYTES: u64 = (4 * size_of::<Extent>() / LEAF + 2 * size_of::<u32>() + 16) as u64;

    /// A tree of the triangles given, each with its centre; `corners` its corners.
    pub(super) fn build(
        centres: impl Iterator<Item = (u32, DVec3)> + Clone,
        count: usize,
        corners: impl Fn(u32) -> [DVec3; 3],
    ) -> Boxes {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (_, centre) in centres.clone() {
            low = low.min(centre);
            high = high.max(centre);
        }
        let scale = 1023.0 / (high - low).max_element().max(f64::MIN_POSITIVE);
        let mut order: Vec<(u32, u32)> = centres.map(|(t, centre)| (curve((centre - low) * scale), t)).collect();
        order.sort_unstable();
        let leaves = order.len().div_ceil(LEAF).max(1).next_power_of_two();
        let mut boxes = Boxes {
            nodes: vec![Extent::EMPTY; 2 * leaves - 1],
            triangles: vec![NONE; leaves * LEAF],
            leaves: vec![NONE; count],
            waiting: Vec::new(),
        };
        // Spread over all leaves, so that none is much fuller than another.
        let len = order.len();
        let mut filled = vec![0u8; leaves];
        for (at, (_, triangle)) in order.into_iter().enumerate() {
            let leaf = at * leaves / len;
            boxes.triangles[leaf * LEAF + usize::from(filled[leaf])] = triangle;
            boxes.leaves[triangle as usize] = leaf as u32;
            filled[leaf] += 1;
        }
        for leaf in 0..leaves {
            boxes.nodes[leaves - 1 + leaf] = boxes.leaf_extent(leaf, &corners);
        }
        for node in (0..leaves - 1).rev() {
            boxes.nodes[node] = boxes.nodes[2 * node + 1].with(boxes.nodes[2 * node + 2]);
        }
        boxes
    }

    fn first_leaf(&self) -> usize {
        self.nodes.len() / 2
    }

    fn leaf_extent(&self, leaf: usize, corners: &impl Fn(u32) -> [DVec3; 3]) -> Extent {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for &triangle in self.triangles[leaf * LEAF..][..LEAF].iter().filter(|t| **t != NONE) {
            for corner in corners(triangle) {
                low = low.min(corner);
                high = high.max(corner);
            }
        }
        Extent { low: low.to_array().map(below), high: high.to_array().map(above) }
    }

    /// Takes triangles out.
    pub(super) fn remove(&mut self, gone: impl Iterator<Item = u32> + Clone, corners: impl Fn(u32) -> [DVec3; 3]) {
        // All of them before any box is made: they have no corners any more.
        for triangle in gone.clone() {
            let leaf = self.leaves[triangle as usize] as usize;
            let places = &mut self.triangles[leaf * LEAF..][..LEAF];
            places.iter_mut().filter(|place| **place == triangle).for_each(|place| *place = NONE);
        }
        for triangle in gone {
            self.follow(self.leaves[triangle as usize] as usize, &corners);
        }
    }

    /// A triangle has changed.
    pub(super) fn update(&mut self, triangle: u32, corners: impl Fn(u32) -> [DVec3; 3]) {
        self.follow(self.leaves[triangle as usize] as usize, &corners);
    }

    fn follow(&mut self, leaf: usize, corners: &impl Fn(u32) -> [DVec3; 3]) {
        let mut node = self.first_leaf() + leaf;
        let mut now = self.leaf_extent(leaf, corners);
        loop {
            if self.nodes[node] == now {
                return;
            }
            self.nodes[node] = now;
            if node == 0 {
                return;
            }
            node = (node - 1) / 2;
            now = self.nodes[2 * node + 1].with(self.nodes[2 * node + 2]);
        }
    }

    /// Adds the triangles to `found` that may meet the box: all of a leaf whose box does.
    pub(super) fn near(&mut self, place: &Extent, found: &mut Vec<u32>) {
        let first = self.first_leaf();
        self.waiting.clear();
        self.waiting.push(0);
        while let Some(node) = self.waiting.pop() {
            let node = node as usize;
            if !self.nodes[node].meets(place) {
                continue;
            }
            if node >= first {
                let leaf = &self.triangles[(node - first) * LEAF..][..LEAF];
                found.extend(leaf.iter().filter(|t| **t != NONE));
            } else {
                self.waiting.extend([2 * node as u32 + 1, 2 * node as u32 + 2]);
            }
        }
    }
}

/// The number of a cell along a Z-order curve: bits of x, y and z in turn.
fn curve(cell: DVec3) -> u32 {
    let spread = |x: f64| {
        let mut bits = x as u32 & 0x3ff;
        bits = (bits | bits << 16) & 0x0300_00ff;
        bits = (bits | bits << 8) & 0x0300_f00f;
        bits = (bits | bits << 4) & 0x030c_30c3;
        (bits | bits << 2) & 0x0924_9249
    };
    spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2
}
