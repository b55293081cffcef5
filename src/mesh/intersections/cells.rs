//! Space cut into cells, so that triangles which meet come together in one.
//!
//! Cells arise by cuts across an axis and are half open; together they are all of space. A triangle belongs to every cell
//! that its box touches. A pair of triangles whose boxes meet is looked at in one cell only: the one that holds the lowest
//! corner `*` of what the boxes have in common, and both triangles are there.
//!
//! ```text
//!   +---------------+        cut at x = at: the left cell has what begins before the cut,
//!   |       |       |                       the right one what does not end before it
//!   |    +--|----+  |
//!   |  +-*--|-+  |  |        the pair is the left cell's: * lies there;
//!   |  | |  | |  |  |        the right cell has both triangles too, and leaves the pair alone
//!   |  +----|-+  |  |
//!   |    +--|----+  |
//!   +---------------+
//! ```

use std::collections::BinaryHeap;

/// A cut must lower the number of pairs, the halves' squares together, to this share of what it was: else triangles that
/// cross the cut would make the work grow from cut to cut.
const WORTHWHILE: f64 = 0.75;
/// Copies of a triangle at most, on average: cutting ends there, and with it the room on disk.
const COPIES: usize = 2;
/// Boxes of a sample that a cell must have to be cut.
const FEWEST: usize = 4;

/// The box of a triangle, its faces included.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cuboid {
    pub low: [f64; 3],
    pub high: [f64; 3],
}

impl Cuboid {
    /// The box of three corners.
    pub fn around([a, b, c]: [[f64; 3]; 3]) -> Cuboid {
        let each = |f: fn(f64, f64) -> f64| std::array::from_fn(|m| f(f(a[m], b[m]), c[m]));
        Cuboid { low: each(f64::min), high: each(f64::max) }
    }

    /// Whether two boxes have a point in common.
    pub fn meets(&self, other: &Cuboid) -> bool {
        // Without branches: in a crowd no single comparison decides often enough to be guessed.
        (0..3).fold(true, |meets, m| meets & (self.low[m] <= other.high[m]) & (other.low[m] <= self.high[m]))
    }

    /// The box that two boxes have in common, if they meet.
    pub fn common(&self, other: &Cuboid) -> Cuboid {
        Cuboid {
            low: std::array::from_fn(|m| self.low[m].max(other.low[m])),
            high: std::array::from_fn(|m| self.high[m].min(other.high[m])),
        }
    }

    /// Its centre.
    pub fn centre(&self) -> [f64; 3] {
        std::array::from_fn(|m| self.low[m].midpoint(self.high[m]))
    }
}

/// A half-open part of space, `low` to before `high`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    low: [f64; 3],
    high: [f64; 3],
}

impl Cell {
    /// All of space.
    pub const SPACE: Cell = Cell { low: [f64::NEG_INFINITY; 3], high: [f64::INFINITY; 3] };

    /// Whether the point lies in the cell.
    pub fn holds(&self, point: [f64; 3]) -> bool {
        (0..3).all(|m| self.low[m] <= point[m] && point[m] < self.high[m])
    }

    /// The two parts on either side of a cut.
    pub fn halves(self, cut: Cut) -> [Cell; 2] {
        let (mut below, mut above) = (self, self);
        below.high[cut.axis] = cut.at;
        above.low[cut.axis] = cut.at;
        [below, above]
    }
}

/// A plane across an axis that parts a cell in two.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cut {
    axis: usize,
    at: f64,
}

impl Cut {
    /// Through the median of the boxes' centres, across the axis where that leaves the fewest pairs; `None` if it is not
    /// worthwhile across any.
    pub fn through(boxes: &[Cuboid], centres: &mut Vec<f64>) -> Option<Cut> {
        let mut best = (WORTHWHILE, None);
        if boxes.is_empty() {
            return None;
        }
        for axis in 0..3 {
            centres.clear();
            centres.extend(boxes.iter().map(|cuboid| cuboid.low[axis].midpoint(cuboid.high[axis])));
            let (_, &mut at, _) = centres.select_nth_unstable_by(boxes.len() / 2, f64::total_cmp);
            let cut = Cut { axis, at };
            let counts = [0, 1].map(|side| boxes.iter().filter(|cuboid| cut.has(side, cuboid)).count());
            let left = share_of_pairs(counts, boxes.len());
            if left < best.0 {
                best = (left, Some(cut));
            }
        }
        best.1
    }

    /// Whether the cell below the cut (side 0) or above it (side 1) has the box.
    pub fn has(&self, side: usize, cuboid: &Cuboid) -> bool {
        if side == 0 { cuboid.low[self.axis] < self.at } else { cuboid.high[self.axis] >= self.at }
    }

    /// Whether a cut with so many triangles in its halves was worth while.
    pub fn pays(halves: [usize; 2], whole: usize) -> bool {
        share_of_pairs(halves, whole) < WORTHWHILE
    }
}

fn share_of_pairs(halves: [usize; 2], whole: usize) -> f64 {
    let square = |count: usize| (count as f64).powi(2);
    (square(halves[0]) + square(halves[1])) / square(whole)
}

/// Cells that together are one cell, found from a sample so that each has about as many triangles.
#[derive(Debug)]
pub(super) struct Tree {
    nodes: Vec<Node>,
    cells: Vec<Cell>,
}

#[derive(Debug, Clone, Copy)]
enum Node {
    Cut(Cut, [u32; 2]),
    Cell(u32),
}

impl Tree {
    /// The cell as it is.
    pub fn uncut(cell: Cell) -> Tree {
        Tree { nodes: vec![Node::Cell(0)], cells: vec![cell] }
    }

    /// Cuts `cell` into up to `wanted` cells, always the one with the largest part of the sample.
    pub fn new(cell: Cell, sample: Vec<Cuboid>, wanted: usize) -> Tree {
        let most = COPIES * sample.len();
        let mut copies = sample.len();
        let mut tree = Tree::uncut(cell);
        let mut samples = vec![sample];
        // Cells that may be cut, the fullest first: (boxes of the sample, node).
        let mut open = BinaryHeap::from([(samples[0].len(), 0usize)]);
        let mut centres = Vec::new();
        while tree.cells.len() < wanted && copies < most {
            let Some((_, node)) = open.pop() else { break };
            let Node::Cell(number) = tree.nodes[node] else { continue };
            let boxes = &samples[number as usize];
            let cut = if boxes.len() < FEWEST { None } else { Cut::through(boxes, &mut centres) };
            let Some(cut) = cut else { continue };

            let [below, above] =
                [0, 1].map(|side| boxes.iter().filter(|b| cut.has(side, b)).copied().collect::<Vec<_>>());
            copies = copies - boxes.len() + below.len() + above.len();
            let children = tree.nodes.len();
            open.extend([(below.len(), children), (above.len(), children + 1)]);
            let new = tree.cells.len() as u32;
            tree.nodes[node] = Node::Cut(cut, [children as u32, children as u32 + 1]);
            tree.nodes.extend([Node::Cell(number), Node::Cell(new)]);
            let [low, high] = tree.cells[number as usize].halves(cut);
            tree.cells[number as usize] = low;
            tree.cells.push(high);
            samples[number as usize] = below;
            samples.push(above);
        }
        tree
    }

    /// The cells, by number.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// The cell that the box touches, if it is only one.
    pub fn only(&self, cuboid: &Cuboid) -> Option<u32> {
        let mut node = 0;
        loop {
            match self.nodes[node] {
                Node::Cell(number) => return Some(number),
                Node::Cut(cut, [below, above]) => match [0, 1].map(|side| cut.has(side, cuboid)) {
                    [true, true] => return None,
                    [true, false] => node = below as usize,
                    _ => node = above as usize,
                },
            }
        }
    }

    /// Visits the numbers of all cells that the box touches.
    pub fn visit(&self, cuboid: &Cuboid, visit: &mut impl FnMut(u32)) {
        self.descend(0, cuboid, visit);
    }

    fn descend(&self, node: u32, cuboid: &Cuboid, visit: &mut impl FnMut(u32)) {
        match self.nodes[node as usize] {
            Node::Cell(number) => visit(number),
            Node::Cut(cut, children) => {
                for (side, child) in children.into_iter().enumerate() {
                    if cut.has(side, cuboid) {
                        self.descend(child, cuboid, visit);
                    }
                }
            }
        }
    }
}
