//! Space cut into parts by planes, so that each holds about as many triangles.

use serde::{Deserialize, Serialize};

use crate::points::Coordinate;

/// A part that is cut no further, or a plane across an axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
enum Node {
    Part(u32),
    /// Places whose coordinate is less lie in the first child, which is the next node; others in the second.
    Plane {
        axis: usize,
        #[serde(with = "bits")]
        at: f64,
        second: u32,
    },
}

/// Numbers as their bits.
mod bits {
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(number: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u64(number.to_bits())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        u64::deserialize(deserializer).map(f64::from_bits)
    }
}

/// A tree of planes (Bentley 1975). Every place lies in one part; parts are boxes, so that triangles between places of a part stay in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Space {
    nodes: Vec<Node>,
    parts: u32,
}

impl Space {
    /// Space for so many triangles, at most about `most` a part, that lie as `sample` says. Each plane leaves the share `first` of the sample on its first side.
    pub(super) fn of<T: Coordinate>(mut sample: Vec<[T; 3]>, triangles: u64, most: u64, first: f64) -> Space {
        let mut space = Space { nodes: Vec::new(), parts: 0 };
        let each = triangles as f64 / sample.len().max(1) as f64;
        space.cut(&mut sample, each, most as f64, first);
        space
    }

    fn cut<T: Coordinate>(&mut self, sample: &mut [[T; 3]], each: f64, most: f64, first: f64) {
        let plane = if sample.len() as f64 * each > most { plane(sample, first) } else { None };
        let Some((axis, at)) = plane else {
            self.nodes.push(Node::Part(self.parts));
            self.parts += 1;
            return;
        };
        let node = self.nodes.len();
        self.nodes.push(Node::Plane { axis, at, second: 0 });
        let mut less = 0;
        for i in 0..sample.len() {
            if sample[i][axis].into() < at {
                sample.swap(i, less);
                less += 1;
            }
        }
        let (below, above) = sample.split_at_mut(less);
        self.cut(below, each, most, first);
        let second = self.nodes.len() as u32;
        self.nodes[node] = Node::Plane { axis, at, second };
        self.cut(above, each, most, first);
    }

    /// The number of parts.
    pub(super) fn parts(&self) -> usize {
        self.parts as usize
    }

    /// The part that a place lies in.
    pub(super) fn part(&self, place: [f64; 3]) -> u32 {
        let mut node = 0;
        loop {
            match self.nodes[node] {
                Node::Part(part) => return part,
                Node::Plane { axis, at, second } => node = if place[axis] < at { node + 1 } else { second as usize },
            }
        }
    }

    /// Calls `visit` with every part that the box of some places meets, in order.
    pub(super) fn meet(&self, low: [f64; 3], high: [f64; 3], mut visit: impl FnMut(u32)) {
        self.meet_below(0, low, high, &mut visit);
    }

    fn meet_below(&self, mut node: usize, low: [f64; 3], high: [f64; 3], visit: &mut impl FnMut(u32)) {
        loop {
            match self.nodes[node] {
                Node::Part(part) => return visit(part),
                Node::Plane { axis, at, second } => {
                    let (first, second) = ((low[axis] < at).then_some(node + 1), second as usize);
                    node = match (first, high[axis] >= at) {
                        (Some(first), false) => first,
                        (None, true) => second,
                        (Some(first), true) => {
                            self.meet_below(first, low, high, visit);
                            second
                        }
                        (None, false) => return,
                    };
                }
            }
        }
    }
}

/// A plane with about a share `first` of the sample on its first side, and something on either; none if all places are one.
fn plane<T: Coordinate>(sample: &mut [[T; 3]], first: f64) -> Option<(usize, f64)> {
    let extent = |axis: usize| {
        let along = || sample.iter().map(|place| -> f64 { place[axis].into() });
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    };
    let extents = [0, 1, 2].map(extent);
    let axis = (0..3).reduce(|a, b| if extents[b] > extents[a] { b } else { a })?;
    if extents[axis] <= 0.0 {
        return None;
    }
    let mut along: Vec<f64> = sample.iter().map(|place| place[axis].into()).collect();
    let share = (along.len() as f64 * first) as usize;
    let (before, at, after) = along.select_nth_unstable_by(share, f64::total_cmp);
    let (at, least) = (*at, before.iter().copied().fold(*at, f64::min));
    // Places on the plane lie on its second side; the first must have some, too.
    let beyond = || after.iter().copied().filter(|place| *place > least).min_by(f64::total_cmp);
    Some((axis, if at > least { at } else { beyond()? }))
}
