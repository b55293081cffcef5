//! Connected components in bounded memory: a union-find whose array need not fit.
//!
//! Nodes are cut into ranges of equal length and the ranges are eliminated from the lowest up. A join lies with the range
//! of its smaller node. When a range's turn comes, its nodes are united among themselves; a set that is joined to higher
//! nodes keeps the first of them as its *outlet*, and a join to any other higher node `u` becomes the join (outlet, `u`),
//! which belongs to a range still to come. So each join is passed on as one join at most and memory is one range.
//!
//! ```text
//!  range 0        range 1        range 2
//!  a---b-----------------u        joins (a,b) (b,u) (a,w)
//!  |              w               {a,b} is eliminated with outlet u; (a,w) becomes (u,w) and waits in range 1
//! ```

use crate::error::Result;
use crate::storage::queue::Queue;
use crate::storage::spool::Workspace;

/// The most ranges, each of which may hold a temporary file open: well below the 1024 files a process may usually open.
const MOST_RANGES: u64 = 256;
/// Bytes of one node in the range under elimination: its parent and its set's outlet.
const NODE_BYTES: u64 = 12;
const NO_OUTLET: u64 = u64::MAX;

/// Bytes for all of so many nodes in one range.
pub(super) fn bytes(nodes: u64) -> u64 {
    nodes * NODE_BYTES
}

/// Counts how many times joins merge two sets of nodes, for more nodes than memory can hold.
pub(super) struct Components {
    nodes: u64,
    /// Nodes of a range; the last range may have fewer.
    range: u64,
    /// The range being eliminated: range 0 until [`Components::merges`] is called.
    current: Range,
    /// Joins that wait for the ranges above the current one; entry 0 is never used.
    waiting: Vec<Option<Queue<[u64; 2]>>>,
}

struct Range {
    number: usize,
    first: u64,
    parents: Vec<u32>,
    outlets: Vec<u64>,
    unions: u64,
    /// Sets that have an outlet.
    open: u64,
}

impl Components {
    /// `nodes` nodes, none joined, within about `memory` bytes (or what 1/256 of the nodes need, if that is more).
    pub fn new(nodes: u64, memory: u64, workspace: &Workspace) -> Components {
        let fits = memory / 2 / NODE_BYTES;
        let range = if nodes <= fits { nodes } else { fits.max(nodes.div_ceil(MOST_RANGES)) }.clamp(1, 1 << 31);
        let ranges = nodes.div_ceil(range).max(1) as usize;
        let share = memory / 2 / ranges as u64;
        let waiting = (0..ranges).map(|_| Some(Queue::new(workspace, share))).collect();
        Components { nodes, range, current: Range::new(0, 0, range.min(nodes)), waiting }
    }

    /// Puts nodes `a` and `b` into one set.
    pub fn join(&mut self, a: u64, b: u64) -> Result<()> {
        let mut next = Some([a.min(b), a.max(b)]);
        while let Some([low, high]) = next {
            debug_assert!(low <= high && high < self.nodes);
            let number = (low / self.range) as usize;
            if number != self.current.number {
                let waiting = self.waiting[number].as_mut().expect("joins go up, to ranges still to come");
                return waiting.push([low, high]);
            }
            next = self.current.join(low, high);
        }
        Ok(())
    }

    /// How often a join made one set of two: nodes less merges are the components.
    pub fn merges(mut self) -> Result<u64> {
        let mut merges = self.current.merges();
        for number in 1..self.waiting.len() {
            let first = number as u64 * self.range;
            self.current = Range::new(number, first, self.range.min(self.nodes - first));
            // Taken out, so that its storage is given back before the next range's turn.
            let waiting = self.waiting[number].take().expect("each range has its turn once");
            waiting.read(|[a, b]| self.join(a, b))?;
            merges += self.current.merges();
        }
        Ok(merges)
    }
}

impl Range {
    fn new(number: usize, first: u64, len: u64) -> Range {
        let parents = (0..len as u32).collect();
        Range { number, first, parents, outlets: vec![NO_OUTLET; len as usize], unions: 0, open: 0 }
    }

    /// A set without an outlet is finished; one with an outlet has merged with the set of a higher node.
    fn merges(&self) -> u64 {
        self.unions + self.open
    }

    /// Joins `low`, which lies in the range, with `high`; returns the join of two higher nodes that follows from it.
    fn join(&mut self, low: u64, high: u64) -> Option<[u64; 2]> {
        let a = root(&mut self.parents, (low - self.first) as u32);
        if high - self.first < self.parents.len() as u64 {
            let b = root(&mut self.parents, (high - self.first) as u32);
            if a == b {
                return None;
            }
            let (a, b) = (a.min(b), a.max(b));
            self.parents[b as usize] = a;
            self.unions += 1;
            let (x, y) = (self.outlets[a as usize], self.outlets[b as usize]);
            self.outlets[a as usize] = x.min(y);
            if x == NO_OUTLET || y == NO_OUTLET {
                return None;
            }
            self.open -= 1;
            return (x != y).then(|| [x.min(y), x.max(y)]);
        }
        let outlet = &mut self.outlets[a as usize];
        if *outlet == NO_OUTLET {
            *outlet = high;
            self.open += 1;
            return None;
        }
        (*outlet != high).then(|| [high.min(*outlet), high.max(*outlet)])
    }
}

/// The root of `node`'s set, halving the path to it.
pub(super) fn root(parents: &mut [u32], mut node: u32) -> u32 {
    loop {
        let parent = parents[node as usize];
        if parent == node {
            return node;
        }
        let grandparent = parents[parent as usize];
        parents[node as usize] = grandparent;
        node = grandparent;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_memory_gives_the_same_merges(
            nodes in 1u64..60,
            joins in prop::collection::vec((0u64..60, 0u64..60), 0..120),
            memory in 0u64..3000,
        ) {
            let dir = tempfile::tempdir().unwrap();
            let workspace = Workspace::new(dir.path()).unwrap();
            let mut components = Components::new(nodes, memory, &workspace);
            let mut labels: Vec<u64> = (0..nodes).collect();
            for (a, b) in joins {
                let (a, b) = (a % nodes, b % nodes);
                components.join(a, b).unwrap();
                let (x, y) = (labels[a as usize], labels[b as usize]);
                labels.iter_mut().filter(|l| **l == x).for_each(|l| *l = y);
            }
            labels.sort_unstable();
            labels.dedup();
            prop_assert_eq!(nodes - components.merges().unwrap(), labels.len() as u64);
        }
    }
}
