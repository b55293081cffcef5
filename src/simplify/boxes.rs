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
        // Without branches: half of all boxes that are asked meet.
        (0..3).fold(true, |meet, a| meet & (self.low[a] <= other.high[a]) & (other.low[a] <= self.high[a]))
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
    /// The triangles of leaf l, and their boxes: `LEAF` from `LEAF * l`.
    triangles: Vec<u32>,
    extents: Vec<Extent>,
    /// Of each triangle: its place among these.
    places: Vec<u32>,
    /// Nodes to be looked at.
    waiting: Vec<u32>,
}

impl Boxes {
    /// Bytes for each triangle, at most: up to two places, half as many nodes, a place and a leaf; and while it is made, its number on the curve.
    pub(super) const BYTES: u64 =
        (2 * (size_of::<Extent>() + size_of::<u32>()) + 4 * size_of::<Extent>() / LEAF + size_of::<u32>() + 8) as u64;

    /// A tree of the triangles given, each with its centre; `corners` gives its corners.
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
            extents: vec![Extent::EMPTY; leaves * LEAF],
            places: vec![NONE; count],
            waiting: Vec::new(),
        };
        // Spread over all leaves, so that none is much fuller than another.
        let len = order.len();
        let (mut before, mut filled) = (usize::MAX, 0);
        for (at, (_, triangle)) in order.into_iter().enumerate() {
            let leaf = at * leaves / len;
            filled = if leaf == before { filled + 1 } else { 0 };
            before = leaf;
            let place = leaf * LEAF + filled;
            boxes.triangles[place] = triangle;
            boxes.extents[place] = Extent::of(corners(triangle));
            boxes.places[triangle as usize] = place as u32;
        }
        for leaf in 0..leaves {
            boxes.nodes[leaves - 1 + leaf] = boxes.leaf_extent(leaf);
        }
        for node in (0..leaves - 1).rev() {
            boxes.nodes[node] = boxes.nodes[2 * node + 1].with(boxes.nodes[2 * node + 2]);
        }
        boxes
    }

    fn first_leaf(&self) -> usize {
        self.nodes.len() / 2
    }

    fn leaf_extent(&self, leaf: usize) -> Extent {
        self.extents[leaf * LEAF..][..LEAF].iter().fold(Extent::EMPTY, |all, extent| all.with(*extent))
    }

    /// Takes a triangle out.
    pub(super) fn remove(&mut self, triangle: u32) {
        let place = self.places[triangle as usize] as usize;
        (self.triangles[place], self.extents[place]) = (NONE, Extent::EMPTY);
        self.follow(place / LEAF);
    }

    /// A triangle has these corners now.
    pub(super) fn update(&mut self, triangle: u32, corners: [DVec3; 3]) {
        let place = self.places[triangle as usize] as usize;
        self.extents[place] = Extent::of(corners);
        self.follow(place / LEAF);
    }

    fn follow(&mut self, leaf: usize) {
        let mut node = self.first_leaf() + leaf;
        let mut now = self.leaf_extent(leaf);
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

    /// Adds the triangles to `found` whose boxes meet the place.
    pub(super) fn near(&mut self, place: &Extent, found: &mut Vec<u32>) {
        let first = self.first_leaf();
        self.waiting.clear();
        if self.nodes[0].meets(place) {
            self.waiting.push(0);
        }
        while let Some(node) = self.waiting.pop() {
            let node = node as usize;
            if node >= first {
                let at = (node - first) * LEAF;
                let there = self.extents[at..][..LEAF].iter().zip(&self.triangles[at..][..LEAF]);
                found.extend(there.filter(|(extent, _)| extent.meets(place)).map(|(_, triangle)| *triangle));
            } else {
                for child in [2 * node + 1, 2 * node + 2] {
                    if self.nodes[child].meets(place) {
                        self.waiting.push(child as u32);
                    }
                }
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
