//! Which triangles of a piece come near a place: a tree of boxes that follows its triangles.

use glam::DVec3;

/// Children of a node.
const WIDE: usize = 8;
/// A triangle without a place.
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

    /// Whether they have a place in common.
    #[cfg(test)]
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

/// Boxes of a node's children, side by side, so that all of them are looked at in a few operations.
#[derive(Debug, Clone, Copy)]
struct Node {
    low: [[f32; WIDE]; 3],
    high: [[f32; WIDE]; 3],
}

impl Node {
    const EMPTY: Node = Node { low: [[f32::INFINITY; WIDE]; 3], high: [[f32::NEG_INFINITY; WIDE]; 3] };

    fn set(&mut self, child: usize, extent: Extent) {
        for a in 0..3 {
            (self.low[a][child], self.high[a][child]) = (extent.low[a], extent.high[a]);
        }
    }

    fn child(&self, child: usize) -> Extent {
        Extent { low: self.low.map(|low| low[child]), high: self.high.map(|high| high[child]) }
    }

    /// The box of all.
    fn whole(&self) -> Extent {
        let low = self.low.map(|low| low.into_iter().fold(f32::INFINITY, |a, b| if b < a { b } else { a }));
        let high = self.high.map(|high| high.into_iter().fold(f32::NEG_INFINITY, |a, b| if b > a { b } else { a }));
        Extent { low, high }
    }

    /// Which of them meet a box: a bit each.
    fn meeting(&self, place: &Extent) -> u32 {
        let mut meet = [u32::MAX; WIDE];
        for a in 0..3 {
            let (low, high) = (&self.low[a], &self.high[a]);
            for child in 0..WIDE {
                // Without branches, one comparison for all. As iterators it takes longer.
                let both = (low[child] <= place.high[a]) & (place.low[a] <= high[child]);
                meet[child] &= u32::from(both).wrapping_neg();
            }
        }
        meet.iter().enumerate().fold(0, |bits, (child, meet)| bits | (meet & 1 << child))
    }
}

/// A tree over triangles in the order of a curve that fills space. A triangle that changes keeps its place.
///
/// ```text
///   row 2                    o                 each node holds the boxes of up to eight nodes of the row below,
///   row 1        o o o o o o o o               those of row 0 of up to eight triangles
///   row 0     oooooooo ... oooooooo
/// ```
#[derive(Debug, Default)]
pub(super) struct Boxes {
    rows: Vec<Vec<Node>>,
    /// The triangles in the order of their places.
    triangles: Vec<u32>,
    /// Of each triangle: its place among these.
    places: Vec<u32>,
    /// Nodes to be looked at: row and number.
    waiting: Vec<(u32, u32)>,
}

impl Boxes {
    /// Bytes for each triangle, at most: a box, a seventh of a box of nodes above and what is left over in the last ones, two numbers; and while it is made, its
    /// number on the curve.
    pub(super) const BYTES: u64 = (size_of::<Extent>() + size_of::<Extent>() / 2 + 2 * size_of::<u32>() + 8) as u64;

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
        let number = |(t, centre): (u32, DVec3)| u64::from(curve((centre - low) * scale)) << 32 | u64::from(t);
        let mut order: Vec<u64> = Vec::with_capacity(count);
        order.extend(centres.map(number));
        order.sort_unstable();
        let mut places = vec![NONE; count];
        let mut row = vec![Node::EMPTY; order.len().div_ceil(WIDE).max(1)];
        let triangles: Vec<u32> = order.into_iter().map(|number| number as u32).collect();
        for (place, &triangle) in triangles.iter().enumerate() {
            row[place / WIDE].set(place % WIDE, Extent::of(corners(triangle)));
            places[triangle as usize] = place as u32;
        }
        let mut rows = vec![row];
        while let Some(below) = rows.last().filter(|row| row.len() > 1) {
            let mut row = vec![Node::EMPTY; below.len().div_ceil(WIDE)];
            below.iter().enumerate().for_each(|(at, node)| row[at / WIDE].set(at % WIDE, node.whole()));
            rows.push(row);
        }
        Boxes { rows, triangles, places, waiting: Vec::new() }
    }

    /// Takes a triangle out.
    pub(super) fn remove(&mut self, triangle: u32) {
        self.set(triangle, Extent::EMPTY);
    }

    /// A triangle has these corners now.
    pub(super) fn update(&mut self, triangle: u32, corners: [DVec3; 3]) {
        self.set(triangle, Extent::of(corners));
    }

    fn set(&mut self, triangle: u32, extent: Extent) {
        let (mut at, mut now) = (self.places[triangle as usize] as usize, extent);
        for row in &mut self.rows {
            let node = &mut row[at / WIDE];
            if node.child(at % WIDE) == now {
                return;
            }
            node.set(at % WIDE, now);
            (at, now) = (at / WIDE, node.whole());
        }
    }

    /// Adds the triangles to `found` whose boxes meet the place.
    pub(super) fn near(&mut self, place: &Extent, found: &mut Vec<u32>) {
        let Boxes { rows, triangles, waiting, .. } = self;
        waiting.clear();
        if let Some(top) = rows.len().checked_sub(1) {
            waiting.push((top as u32, 0));
        }
        while let Some((row, number)) = waiting.pop() {
            let mut meeting = rows[row as usize][number as usize].meeting(place);
            while meeting != 0 {
                let child = number * WIDE as u32 + meeting.trailing_zeros();
                meeting &= meeting - 1;
                if row == 0 {
                    found.push(triangles[child as usize]);
                } else {
                    waiting.push((row - 1, child));
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
