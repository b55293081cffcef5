//! Queries go from block to block until no other can change their answer.
//!
//! ```text
//!  home    every query to the block nearest to it: that gives it a reach
//!  sweep   block by block, in order: the queries that wait there are searched, and those whose reach (or line) touches
//!          another block further on wait for that one
//! ```
//!
//! So a block is loaded twice at most, however far queries reach. The least distance of all targets is found, whatever way a query takes.

use std::cell::RefCell;

use bytemuck::{Pod, Zeroable};

use super::blocks::{Block, Blocks};
use super::room::Room;
use super::shape::{Cuboid, Line, Point, Target, Triangle, angle};
use super::tree::Tree;
use crate::error::Result;
use crate::resources::workers::Spares;
use crate::storage::partitions::Partitions;

/// Queries of a job.
const PIECE: usize = 1 << 12;

/// What is asked of targets.
pub(crate) trait Query<T>: Pod + Send + Sync {
    /// The block where it was asked first.
    fn home(&self) -> usize;
    /// Whether a target within the box could change the answer.
    fn wants(&self, cuboid: &Cuboid) -> bool;
    /// Asks all targets of a tree.
    fn ask(&mut self, tree: &Tree<T>);
}

/// How far from a place is the nearest target?
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Nearest {
    pub number: u64,
    home: u64,
    place: Point,
    /// The squared distance.
    pub distance2: f64,
}

impl Nearest {
    /// Not yet asked.
    pub fn new(number: u64, place: Point, home: usize) -> Nearest {
        Nearest { number, home: home as u64, place, distance2: f64::INFINITY }
    }
}

impl<T: Target> Query<T> for Nearest {
    fn home(&self) -> usize {
        self.home as usize
    }

    fn wants(&self, cuboid: &Cuboid) -> bool {
        cuboid.distance2(self.place) < self.distance2
    }

    fn ask(&mut self, tree: &Tree<T>) {
        self.distance2 = tree.nearest(self.place, self.distance2);
    }
}

/// How far from a triangle's centroid is the nearest target, how is it turned against that, and how far is the first along the normal, either way?
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Facing {
    home: u64,
    place: Point,
    /// Zero if the triangle has none.
    normal: Point,
    /// The squared distance.
    pub distance2: f64,
    /// In degrees; infinite if there is none. Of several triangles that are equally near, the one that is turned least counts.
    pub turned: f64,
    /// The distance along the normal, infinite if nothing is met.
    pub along: f64,
}

impl Facing {
    /// Not yet asked. The triangle is turned `over` if one of the two meshes is inside out.
    pub fn new(triangle: &Triangle, over: bool, home: usize) -> Facing {
        let [distance2, turned, along] = [f64::INFINITY; 3];
        let normal = triangle.normal().unwrap_or_default();
        let normal = if over { normal.map(|c| -c) } else { normal };
        Facing { home: home as u64, place: triangle.centroid(), normal, distance2, turned, along }
    }

    fn line(&self) -> Option<Line> {
        (self.normal != [0.0; 3]).then_some(Line { origin: self.place, direction: self.normal })
    }
}

impl Query<Triangle> for Facing {
    fn home(&self) -> usize {
        self.home as usize
    }

    fn wants(&self, cuboid: &Cuboid) -> bool {
        // As near as the nearest may be turned less.
        cuboid.distance2(self.place) <= self.distance2
            || self.line().is_some_and(|line| cuboid.entry(&line) < self.along)
    }

    fn ask(&mut self, tree: &Tree<Triangle>) {
        let (place, normal, line) = (self.place, self.normal, self.line());
        let (mut least, mut turned) = (self.distance2, self.turned);
        let near = |triangle: &Triangle, _| {
            let distance2 = triangle.distance2(place);
            if distance2 <= least {
                let against = triangle.normal().filter(|_| line.is_some());
                let angle = against.map_or(f64::INFINITY, |other| angle(normal, other));
                turned = if distance2 < least { angle } else { turned.min(angle) };
                least = distance2;
            }
            least
        };
        tree.visit(self.distance2, true, |cuboid| cuboid.distance2(place), near);
        (self.distance2, self.turned) = (least, turned);
        if let Some(line) = line {
            let cross = |triangle: &Triangle, reach: f64| triangle.crossing(&line).map_or(reach, |at| reach.min(at));
            let mut along = self.along;
            tree.visit(
                along,
                false,
                |cuboid| cuboid.entry(&line),
                |triangle, reach| {
                    along = cross(triangle, reach);
                    along
                },
            );
            self.along = along;
        }
    }
}

/// Asks the queries that `feed` makes, and hands each with its answer to `done`, in no order. `feed` is told the home of a place.
///
/// # Errors
/// What `feed` and `done` give; [`crate::Error::Io`]; [`crate::Error::Interrupted`].
pub(crate) fn search<T: Target + Pod, Q: Query<T>>(
    blocks: &mut Blocks<T>,
    room: &Room,
    feed: impl FnOnce(&(dyn Fn(Point) -> usize + Sync), &mut dyn FnMut(&[Q]) -> Result<()>) -> Result<()>,
    mut done: impl FnMut(&Q) -> Result<()>,
) -> Result<()> {
    let at_home = RefCell::new(room.partitions(blocks.count(), 0));
    feed(&|place| blocks.home(place), &mut |queries: &[Q]| {
        let mut at_home = at_home.borrow_mut();
        queries.iter().try_for_each(|query| at_home.push(query.home(), query))
    })?;
    let waiting = RefCell::new(room.partitions(blocks.count(), 0));
    for block in 0..blocks.count() {
        visit(blocks, block, 0, &at_home, &waiting, room, &mut done)?;
    }
    drop(at_home);
    for block in 0..blocks.count() {
        visit(blocks, block, block + 1, &waiting, &waiting, room, &mut done)?;
    }
    Ok(())
}

/// Asks the queries that wait for a block. They go on to wait for the first block from `from` on that could change their answer, but their home.
fn visit<T: Target + Pod, Q: Query<T>>(
    blocks: &mut Blocks<T>,
    block: usize,
    from: usize,
    queries: &RefCell<Partitions<Q>>,
    waiting: &RefCell<Partitions<Q>>,
    room: &Room,
    done: &mut impl FnMut(&Q) -> Result<()>,
) -> Result<()> {
    if queries.borrow().records(block) == 0 {
        return Ok(());
    }
    let (all, tree) = blocks.load(block, room)?;
    // Handed to and fro, as in `Source::places`.
    let spares = Spares::<(Vec<Q>, Vec<Option<usize>>)>::default();
    let source = || {
        let (mut piece, next) = spares.take().unwrap_or_default();
        piece.clear();
        while piece.len() < PIECE && queries.borrow_mut().take(block, &mut piece)? {}
        Ok(Some((piece, next)).filter(|(piece, _)| !piece.is_empty()))
    };
    let work = |(mut piece, mut next): (Vec<Q>, Vec<_>)| {
        next.clear();
        for query in &mut piece {
            query.ask(tree);
            next.push(next_block(query, all, from));
        }
        Ok((piece, next))
    };
    room.workers.in_order(room.in_flight, source, work, |(piece, next)| {
        piece.iter().zip(&next).try_for_each(|(query, next)| match next {
            Some(block) => waiting.borrow_mut().push(*block, query),
            None => done(query),
        })?;
        spares.give((piece, next));
        Ok(())
    })
}

fn next_block<T, Q: Query<T>>(query: &Q, blocks: &Tree<Block>, from: usize) -> Option<usize> {
    let next = |from: usize| blocks.first(from, |cuboid| query.wants(cuboid));
    next(from).and_then(|block| if block == query.home() { next(block + 1) } else { Some(block) })
}
