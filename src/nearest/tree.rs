//! A tree of boxes over targets, with no pointers: the targets are sorted in place, and a node is half of the one above.
//!
//! ```text
//!  level 0          [0, n)                 node 1
//!  level 1    [0, n/2)   [n/2, n)          nodes 2, 3       node i of level l has targets n (i - 2^l) / 2^l and on
//!  level 2     ..   ..    ..   ..          nodes 4 … 7      its halves are nodes 2i and 2i + 1
//! ```

use rayon::prelude::*;

use super::shape::{Cuboid, Point, Target};
use crate::resources::workers::Workers;

/// Targets of a leaf at most.
const LEAF: usize = 8;
/// Targets below which a part is not worth another thread.
const PARALLEL: usize = 1 << 13;

/// Targets in memory, for searches.
#[derive(Debug, Clone)]
pub(crate) struct Tree<T> {
    targets: Vec<T>,
    /// The box of each node, from 1 on.
    boxes: Vec<Cuboid>,
    levels: u32,
}

/// Bytes of memory for each target of a tree.
pub(crate) const fn bytes_of<T>() -> u64 {
    // A leaf has more than half of its room filled, and there are twice as many nodes as leaves.
    (size_of::<T>() + 4 * size_of::<Cuboid>() / LEAF) as u64
}

/// Levels below the first until leaves are small enough.
fn levels_for(count: usize) -> u32 {
    count.div_ceil(LEAF).next_power_of_two().trailing_zeros()
}

impl<T: Target> Tree<T> {
    /// Sorts the targets, on the pool of workers.
    pub fn new(mut targets: Vec<T>, workers: &Workers) -> Tree<T> {
        let count = targets.len();
        workers.pool().install(|| sort(&mut targets, count, 0, 0));
        Tree::sorted(targets, workers)
    }

    /// A tree over targets in the order of an earlier tree over all of them.
    pub fn sorted(targets: Vec<T>, workers: &Workers) -> Tree<T> {
        let (count, levels) = (targets.len(), levels_for(targets.len()));
        let leaves = 1usize << levels;
        // Taken by the calling thread, which gives it back, too: from another one the allocator would keep it.
        let mut boxes = vec![Cuboid::EMPTY; 2 * leaves];
        let bound = |leaf: usize, cuboid: &mut Cuboid| {
            let of_leaf = &targets[range(count, levels, leaf)];
            *cuboid = of_leaf.iter().fold(Cuboid::EMPTY, |all, target| all.with(&target.cuboid()));
        };
        let of_leaves = boxes[leaves..].par_iter_mut().enumerate().with_min_len(PARALLEL / LEAF);
        workers.pool().install(|| of_leaves.for_each(|(leaf, cuboid)| bound(leaf, cuboid)));
        for node in (1..leaves).rev() {
            boxes[node] = boxes[2 * node].with(&boxes[2 * node + 1]);
        }
        Tree { targets, boxes, levels }
    }

    /// The targets, in the tree's order.
    pub fn targets(&self) -> &[T] {
        &self.targets
    }

    /// The box of all.
    pub fn cuboid(&self) -> Cuboid {
        self.boxes[1]
    }

    /// Visits all targets whose boxes, and those round them, have a `bound` of less than the reach, or of the reach itself if `ties` count. `visit` gives
    /// the reach from then on. The nearer of two boxes comes first.
    pub fn visit(
        &self,
        mut reach: f64,
        ties: bool,
        bound: impl Fn(&Cuboid) -> f64,
        mut visit: impl FnMut(&T, f64) -> f64,
    ) {
        let beyond = |bound: f64, reach: f64| if ties { bound > reach } else { bound >= reach };
        let leaves = 1usize << self.levels;
        // At most one node waits on each level.
        let mut waiting = [(0usize, 0.0f64); usize::BITS as usize];
        waiting[0] = (1, bound(&self.boxes[1]));
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (mut node, mut at) = waiting[count];
            while !beyond(at, reach) {
                if node >= leaves {
                    for target in &self.targets[range(self.targets.len(), self.levels, node - leaves)] {
                        reach = visit(target, reach);
                    }
                    break;
                }
                let [left, right] = [2 * node, 2 * node + 1].map(|half| (half, bound(&self.boxes[half])));
                let (near, far) = if right.1 < left.1 { (right, left) } else { (left, right) };
                waiting[count] = far;
                count += 1;
                (node, at) = near;
            }
        }
    }

    /// The squared distance of the nearest target, if that is less than `best`, else `best`.
    pub fn nearest(&self, p: Point, best: f64) -> f64 {
        let mut least = best;
        self.visit(
            best,
            false,
            |cuboid| cuboid.distance2(p),
            |target, reach| {
                least = reach.min(target.distance2(p));
                least
            },
        );
        least
    }

    /// The number of the first target from `from` on for which `holds` is true, of its box and those round it.
    pub fn first(&self, from: usize, holds: impl Fn(&Cuboid) -> bool) -> Option<usize> {
        let leaves = 1usize << self.levels;
        let mut waiting = vec![1usize];
        while let Some(node) = waiting.pop() {
            let level = node.ilog2();
            let of_node = range(self.targets.len(), level, node - (1 << level));
            if of_node.end <= from || !holds(&self.boxes[node]) {
                continue;
            }
            if node < leaves {
                waiting.extend([2 * node + 1, 2 * node]);
                continue;
            }
            let first = of_node.start.max(from);
            let at = self.targets[first..of_node.end].iter().position(|target| holds(&target.cuboid()));
            if at.is_some() {
                return at.map(|at| first + at);
            }
        }
        None
    }
}

/// The targets of the `i`-th node of a level, of `count` in all.
fn range(count: usize, level: u32, i: usize) -> std::ops::Range<usize> {
    let start = |i: usize| ((count as u128 * i as u128) >> level) as usize;
    start(i)..start(i + 1)
}

/// Sorts the targets of node `i` of a level, of `all`: those of its left half before those of its right.
fn sort<T: Target>(targets: &mut [T], all: usize, level: u32, i: usize) {
    if level == levels_for(all) || targets.len() < 2 {
        return;
    }
    let middles = targets.iter().map(Target::middle);
    let around = middles.fold(Cuboid::EMPTY, |cuboid, p| cuboid.with(&Cuboid { low: p, high: p }));
    let axis = around.longest();
    let half = range(all, level + 1, 2 * i).len();
    targets.select_nth_unstable_by(half, |a, b| a.middle()[axis].total_cmp(&b.middle()[axis]));
    let (left, right) = targets.split_at_mut(half);
    if half < PARALLEL {
        sort(left, all, level + 1, 2 * i);
        sort(right, all, level + 1, 2 * i + 1);
    } else {
        rayon::join(|| sort(left, all, level + 1, 2 * i), || sort(right, all, level + 1, 2 * i + 1));
    }
}
