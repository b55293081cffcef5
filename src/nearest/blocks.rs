//! Targets in blocks, on disk if need be: as many in each as memory holds at a time.
//!
//! ```text
//!  sample     middles of targets -> cuts across the axes, so that each part has about as many
//!  distribute every target to the partition of its middle's part, but those larger than that to a partition of their own;
//!             a partition with too many is cut in its turn, or, where all its middles are one, dealt out
//!  order      partition by partition: a tree is built, its targets stored in its order, and the block's box noted
//! ```
//!
//! A block's box holds its targets whole, so it bounds distances whatever their size; large targets would make the boxes of all blocks large. How blocks are cut
//! shows in the time alone.

use bytemuck::Pod;

use super::room::Room;
use super::shape::{Cuboid, Point, Target};
use super::tree::{Tree, bytes_of};
use crate::error::Result;
use crate::storage::partitions::Partitions;
use crate::storage::spool::Spool;

/// Parts of one distribution at most: each has a page in memory.
const PARTS: u64 = 256;
/// Middles looked at to place cuts.
pub(crate) const SAMPLE: usize = 1 << 15;

/// A block of targets.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Block {
    cuboid: Cuboid,
    /// The place of its first target.
    first: u64,
    count: u64,
}

impl Target for Block {
    fn cuboid(&self) -> Cuboid {
        self.cuboid
    }

    fn middle(&self) -> Point {
        std::array::from_fn(|a| self.cuboid.low[a].midpoint(self.cuboid.high[a]))
    }

    fn distance2(&self, p: Point) -> f64 {
        self.cuboid.distance2(p)
    }
}

/// All targets, in blocks. Blocks have numbers in the order of a tree over them.
pub(crate) struct Blocks<T> {
    blocks: Tree<Block>,
    store: Spool,
    /// The block in memory.
    held: Option<(usize, Tree<T>)>,
}

impl<T: Target + Pod> Blocks<T> {
    /// Blocks of the targets that `feed` hands over, in pieces and any order; `sample` is of their middles, and `count` about how many there are.
    ///
    /// # Errors
    /// What `feed` gives; [`crate::Error::Io`]; [`crate::Error::Interrupted`].
    pub fn new(
        room: &Room,
        sample: Vec<Point>,
        count: u64,
        feed: impl FnOnce(&mut dyn FnMut(&[T]) -> Result<()>) -> Result<()>,
    ) -> Result<Blocks<T>> {
        let parts = Parts::new(sample, parts_for::<T>(count, room));
        let mut partitions = room.partitions(parts.count() + 1, 0);
        feed(&mut |targets| targets.iter().try_for_each(|target| partitions.push(parts.partition(target), target)))?;
        let mut making = Making { room, store: room.spool(), blocks: Vec::new(), last: None };
        making.order(&mut partitions, 1)?;
        let Making { store, blocks, last, .. } = making;
        let only = last.filter(|_| blocks.len() == 1).map(|tree| (0, tree));
        Ok(Blocks { blocks: Tree::new(blocks, room.workers), store, held: only })
    }

    /// The number of blocks.
    pub fn count(&self) -> usize {
        self.blocks.targets().len()
    }

    /// The block whose box is nearest: the first of equals.
    pub fn home(&self, p: Point) -> usize {
        let nearest = self.blocks.nearest(p, f64::INFINITY);
        self.blocks.first(0, |cuboid| cuboid.distance2(p) <= nearest).unwrap_or(0)
    }

    /// The blocks, and the targets of one, which stay in memory until another is asked for.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn load(&mut self, block: usize, room: &Room) -> Result<(&Tree<Block>, &Tree<T>)> {
        if self.held.as_ref().is_none_or(|(held, _)| *held != block) {
            // Freed first, so that there are never two.
            self.held = None;
            let Block { first, count, .. } = self.blocks.targets()[block];
            let mut targets = vec![T::zeroed(); count as usize];
            self.store.read_at(first * size_of::<T>() as u64, bytemuck::cast_slice_mut(&mut targets))?;
            self.held = Some((block, Tree::sorted(targets, room.workers)));
        }
        Ok((&self.blocks, &self.held.as_ref().expect("it was loaded if it was not there").1))
    }
}

/// Targets that a block may have.
fn most<T>(room: &Room) -> u64 {
    (room.block / bytes_of::<T>()).max(1)
}

/// Parts for so many targets, so that most are not too large.
fn parts_for<T>(count: u64, room: &Room) -> usize {
    (count * 3 / 2).div_ceil(most::<T>(room)).clamp(1, PARTS) as usize
}

/// Blocks in the making.
struct Making<'a, T> {
    room: &'a Room<'a>,
    store: Spool,
    blocks: Vec<Block>,
    last: Option<Tree<T>>,
}

impl<T: Target + Pod> Making<'_, T> {
    /// Makes blocks of partitions, which are empty afterwards.
    fn order(&mut self, partitions: &mut Partitions<T>, depth: u32) -> Result<()> {
        let most = most::<T>(self.room);
        for partition in 0..partitions.count() {
            self.room.workers.check_cancelled()?;
            if partitions.records(partition) > most {
                self.cut(partitions, partition, depth)?;
                continue;
            }
            // Freed first, so that there are never two.
            self.last = None;
            let mut targets = Vec::with_capacity(partitions.records(partition) as usize);
            while partitions.take(partition, &mut targets)? {}
            self.block(targets)?;
        }
        Ok(())
    }

    /// Makes several blocks of a partition that is too large for one; `depth` is how many are about it.
    fn cut(&mut self, partitions: &mut Partitions<T>, partition: usize, depth: u32) -> Result<()> {
        let count = partitions.records(partition);
        let every = count.div_ceil(SAMPLE as u64);
        let (mut sample, mut number) = (Vec::new(), 0);
        partitions.read(partition, |target| {
            if number % every == 0 {
                sample.push(target.middle());
            }
            number += 1;
            Ok(())
        })?;
        let parts = Parts::new(sample, parts_for::<T>(count, self.room).max(2));
        let mut within = self.room.partitions(parts.count(), depth);
        let mut piece = Vec::new();
        while partitions.take(partition, &mut piece)? {
            for target in piece.drain(..) {
                within.push(parts.of(target.middle()), &target)?;
            }
        }
        if (0..within.count()).all(|part| within.records(part) < count) {
            return self.order(&mut within, depth + 1);
        }
        // No cut parts them: they are dealt out as they come.
        let most = most::<T>(self.room) as usize;
        let mut dealt = Vec::with_capacity(most);
        for part in 0..within.count() {
            while within.take(part, &mut piece)? {
                for target in piece.drain(..) {
                    dealt.push(target);
                    if dealt.len() == most {
                        self.block(std::mem::replace(&mut dealt, Vec::with_capacity(most)))?;
                    }
                }
            }
        }
        self.block(dealt)
    }

    /// Makes a block.
    fn block(&mut self, targets: Vec<T>) -> Result<()> {
        if targets.is_empty() {
            return Ok(());
        }
        self.last = None;
        let tree = Tree::new(targets, self.room.workers);
        let at = self.store.append(bytemuck::cast_slice(tree.targets()))?;
        let (first, count) = (at / size_of::<T>() as u64, tree.targets().len() as u64);
        self.blocks.push(Block { cuboid: tree.cuboid(), first, count });
        self.last = Some(tree);
        Ok(())
    }
}

/// Space in parts, by cuts across the axes.
struct Parts {
    /// For each node of a complete tree, from 1 on: the axis and the place of its cut.
    cuts: Vec<(usize, f64)>,
    /// For each part: how long the box of the sample in it is.
    sides: Vec<f64>,
}

impl Parts {
    /// At least so many parts (a power of two) with about as many of the sample in each.
    fn new(mut sample: Vec<Point>, parts: usize) -> Parts {
        let count = parts.next_power_of_two();
        let mut parts = Parts { cuts: vec![(0, 0.0); count], sides: vec![0.0; count] };
        parts.cut(&mut sample, 1);
        parts
    }

    /// Places the cuts of a node and those below it.
    fn cut(&mut self, sample: &mut [Point], node: usize) {
        if sample.is_empty() {
            return;
        }
        let around = sample.iter().fold(Cuboid::EMPTY, |all, p| all.with(&Cuboid { low: *p, high: *p }));
        let count = self.count();
        if node >= count {
            self.sides[node - count] = around.side();
            return;
        }
        let axis = around.longest();
        let half = sample.len() / 2;
        let (left, middle, right) = sample.select_nth_unstable_by(half, |a, b| a[axis].total_cmp(&b[axis]));
        self.cuts[node] = (axis, middle[axis]);
        self.cut(left, 2 * node);
        self.cut(right, 2 * node + 1);
    }

    fn count(&self) -> usize {
        self.cuts.len()
    }

    /// Where a target goes: to its part, or, if it is larger than that, to the partition behind those of all parts. If there is one part only, none is larger.
    fn partition(&self, target: &impl Target) -> usize {
        let part = self.of(target.middle());
        if self.count() > 1 && target.cuboid().side() > self.sides[part] { self.count() } else { part }
    }

    /// The part that a place is in.
    fn of(&self, p: Point) -> usize {
        let mut node = 1;
        while node < self.cuts.len() {
            let (axis, at) = self.cuts[node];
            node = 2 * node + usize::from(p[axis] >= at);
        }
        node - self.cuts.len()
    }
}

#[cfg(test)]
mod tests {
    use super::super::shape::{Spot, Triangle};
    use super::super::testing::with_room;
    use super::*;

    /// The blocks of some points, each with its points.
    fn blocks(points: &[Point], sample: Vec<Point>, most: u64) -> Vec<Vec<Point>> {
        with_room(2, |room| {
            let room = Room { block: most * bytes_of::<Spot>(), ..room };
            let feed = |put: &mut dyn FnMut(&[Spot]) -> Result<()>| {
                points.chunks(3).try_for_each(|piece| put(&piece.iter().map(|p| Spot(*p)).collect::<Vec<_>>()))
            };
            let mut blocks = Blocks::new(&room, sample, points.len() as u64, feed).unwrap();
            (0..blocks.count())
                .map(|block| {
                    let (all, tree) = blocks.load(block, &room).unwrap();
                    assert_eq!(tree.cuboid(), all.targets()[block].cuboid);
                    tree.targets().iter().map(|spot| spot.0).collect()
                })
                .collect()
        })
    }

    #[test]
    fn large_targets_have_blocks_of_their_own() {
        let [mut small, mut large] = [Vec::new(), Vec::new()];
        for i in 0..4000 {
            let at = [f64::from(i % 50), f64::from(i / 50), 0.0];
            small.push(Triangle([at, [at[0] + 0.5, at[1], 0.0], [at[0], at[1] + 0.5, 1.0]]));
        }
        for i in 0..40 {
            large.push(Triangle([[0.0; 3], [50.0, 0.0, f64::from(i)], [0.0, 80.0, f64::from(i)]]));
        }
        let all: Vec<Triangle> =
            small.chunks(100).zip(&large).flat_map(|(few, one)| few.iter().chain([one])).copied().collect();
        let wide = with_room(2, |room| {
            let room = Room { block: 100 * bytes_of::<Triangle>(), ..room };
            let sample = all.iter().map(Target::middle).collect();
            let blocks = Blocks::new(&room, sample, all.len() as u64, |put| put(&all)).unwrap();
            assert!(blocks.count() > 40);
            blocks.blocks.targets().iter().filter(|block| block.cuboid.side() > 40.0).count()
        });
        assert_eq!(wide, 1);
    }

    #[test]
    fn every_target_is_in_one_block_and_none_has_too_many() {
        let spread: Vec<Point> = (0..1000).map(|i| [f64::from(i * 37 % 101), f64::from(i % 7), f64::from(i)]).collect();
        let heap = vec![[1.0, 2.0, 3.0]; 500];
        let mixed: Vec<Point> = spread[..20].iter().chain(&heap).chain(&spread[20..40]).copied().collect();
        for points in [&spread, &heap, &mixed] {
            // A sample that says nothing of the targets is none the worse but for time.
            for sample in [points.clone(), vec![[0.0; 3]], Vec::new()] {
                for most in [1, 3, 40, 1000] {
                    let found = blocks(points, sample.clone(), most);
                    assert!(found.iter().all(|block| !block.is_empty() && block.len() as u64 <= most));
                    let mut all: Vec<Point> = found.into_iter().flatten().collect();
                    let mut expected = points.clone();
                    all.sort_by(|a, b| a.partial_cmp(b).unwrap());
                    expected.sort_by(|a, b| a.partial_cmp(b).unwrap());
                    assert_eq!(all, expected);
                }
            }
        }
    }
}
