//! Signs of hidden walls: on which side of them the outside lies.
//!
//! What is sure is joined, what is likely votes. Hidden walls of which one surely goes on as the other are joined to *patches*, by a union-find with a parity
//! that tells whether the normals of two walls point to the same side. Walls whose sign is known vote for the patches round them; a patch
//! that most votes speak for is known from then on, and votes in the next round: walls first, then the bottoms between them.
//!
//! ```text
//!   s s       s s      s  seen from the outside
//!     h       h        h  hidden: one patch on either side, told by s
//!     h       h
//!     h b b b h        b  the bottom, a patch of its own: told by h in the next round
//! ```
//!
//! Patches stream as components do ([`crate::grid::label`]): a job joins the walls of its chunk of slices to *parts*; upwards, parts are joined to *classes* where chunks
//! meet; votes are added up on the way up, and a class learns its sign from the chunk above on the way down. Joins within chunks come first, in the order of
//! cells, then those across, chunk by chunk: a link that contradicts what is joined already counts for nothing, so their order is a part of the rule. Votes are summed
//! as whole numbers, in any order.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use super::Slabs;
use super::layers::{Held, Layers, Rounds};
use super::wall::{HIDDEN, Relation, SEEN, Wall};
use crate::error::Result;
use crate::grid::context::CHUNK_SLICES;
use crate::points::vector::{dot, minus};

/// Walls of which one surely goes on as the other: how sure both are of their planes, how nearly parallel, how far apart, how far off each other's plane, and how
/// much more for each cell along it.
const SURE: f32 = 0.3;
const PARALLEL: f64 = 0.9;
const APART: f64 = 1.8;
const OFF: (f64, f64) = (0.15, 0.15);

/// How far off walls are that are joined or vote, either way.
pub const REACH: i64 = 2;

/// Rounds of votes, at most.
pub(super) const ROUNDS: u32 = 6;
/// A seen wall votes if it is so sure of its plane.
pub(super) const VOTER: f32 = 0.1;
/// What a vote weighs across a crease, and across a slot or a sheet; a hint; how votes fall off with the distance, but for those across.
pub(super) const CREASE: f64 = 0.5;
pub(super) const FACING: f64 = 0.5;
pub(super) const HINT: f64 = 0.3;
pub(super) const DECAY: f64 = 0.9;
/// A patch has a sign if its votes come to so much, and the difference to so large a part of them.
pub(super) const ENOUGH: f64 = 0.3;
pub(super) const CLEAR: f64 = 0.3;

/// Votes are counted in this part of one.
pub(super) const QUANTA: f64 = (1 << 20) as f64;

/// No part, and no class above.
const NONE: u32 = u32::MAX;

/// Votes for a patch: the difference, and all.
#[derive(Debug, Clone, Copy, Default, Zeroable, Pod)]
#[repr(C)]
struct Votes {
    difference: i64,
    all: i64,
}

impl Votes {
    fn add(&mut self, other: Votes, opposite: bool) {
        self.difference += if opposite { -other.difference } else { other.difference };
        self.all += other.all;
    }

    fn vote(&mut self, weight: f64) {
        let vote = (weight * QUANTA).round() as i64;
        self.difference += vote;
        self.all += vote.abs();
    }

    fn sign(&self) -> i8 {
        let [difference, all] = [self.difference, self.all].map(|votes| votes as f64 / QUANTA);
        if all > ENOUGH && difference.abs() > CLEAR * all { difference.signum() as i8 } else { 0 }
    }
}

/// A union-find in which every element knows whether it is opposite to its root.
struct Patches {
    parents: Vec<(u32, bool)>,
}

impl Patches {
    fn new(elements: usize) -> Patches {
        Patches { parents: (0..elements as u32).map(|element| (element, false)).collect() }
    }

    /// The root of an element, and whether the element is opposite to it.
    fn find(&mut self, element: u32) -> (u32, bool) {
        let (mut root, mut opposite) = (element, false);
        while self.parents[root as usize].0 != root {
            let (parent, turned) = self.parents[root as usize];
            (root, opposite) = (parent, opposite ^ turned);
        }
        let (mut on_way, mut left) = (element, opposite);
        while on_way != root {
            let (parent, turned) = std::mem::replace(&mut self.parents[on_way as usize], (root, left));
            (on_way, left) = (parent, left ^ turned);
        }
        (root, opposite)
    }

    /// Joins two elements, unless they are already.
    fn join(&mut self, a: u32, b: u32, opposite: bool) {
        let ((a, of_a), (b, of_b)) = (self.find(a), self.find(b));
        if a != b {
            self.parents[a.max(b) as usize] = (a.min(b), of_a ^ of_b ^ opposite);
        }
    }
}

/// Whether two hidden walls are surely one, and if so, whether their normals are opposite.
pub(super) fn linked(a: &Wall, b: &Wall, d: [f64; 3]) -> Option<bool> {
    if a.kind != HIDDEN || b.kind != HIDDEN || a.confidence <= SURE || b.confidence <= SURE {
        return None;
    }
    let Some(Relation::Wall(same)) = Relation::of(a, b, d) else { return None };
    let (n, m, squared) = (a.across(), b.across(), dot(d, d));
    let off = dot(n, d).abs().max(dot(m, d).abs());
    let aside = (squared - off * off).max(0.0).sqrt();
    let one = squared < APART * APART && off < OFF.0 + OFF.1 * aside && dot(n, m).abs() > PARALLEL;
    one.then_some(same < 0.0)
}

/// The parts of a chunk.
struct Parts {
    /// Of each slice, each wall's part and whether it is opposite to it (the lowest bit); [`NONE`] if it is not hidden.
    of_walls: Vec<Vec<u32>>,
    count: u32,
    /// Links to the chunk below: part, slice and number of the wall below, whether they are opposite.
    links: Vec<(u32, u32, u32, bool)>,
}

impl Parts {
    fn of(walls: &Held<Wall>, chunk: &Range<u32>) -> Parts {
        let slices = i64::from(chunk.start)..i64::from(chunk.end);
        let mut bases = vec![0u32];
        for y in slices.clone() {
            bases.push(bases[bases.len() - 1] + walls.slice(y).1.len() as u32);
        }
        let lowest = slices.start;
        let base = |y: i64| bases[(y - lowest) as usize];
        let mut patches = Patches::new(bases[bases.len() - 1] as usize);
        let mut across = Vec::new();
        for y in slices.clone() {
            let (cells, values) = walls.slice(y);
            for (number, ((z, x), wall)) in cells.iter().zip(values).enumerate() {
                if wall.kind != HIDDEN {
                    continue;
                }
                let (this, at) = (base(y) + number as u32, wall.at([x.into(), y, z.into()]));
                for below in y - REACH..=y {
                    let (cells, values) = walls.slice(below);
                    for row in i64::from(z) - REACH..=i64::from(z) + REACH {
                        for other in cells.range(row, i64::from(x) - REACH..i64::from(x) + REACH + 1) {
                            // Every pair once, with the earlier wall.
                            if below == y && other >= number {
                                break;
                            }
                            let there = values[other].at([cells.x(other).into(), below, row]);
                            if let Some(opposite) = linked(wall, &values[other], minus(there, at)) {
                                if below >= lowest {
                                    patches.join(this, base(below) + other as u32, opposite);
                                } else {
                                    across.push((this, below as u32, other as u32, opposite));
                                }
                            }
                        }
                    }
                }
            }
        }
        let mut names = vec![NONE; patches.parents.len()];
        let mut count = 0;
        let mut of_walls = Vec::new();
        for y in slices {
            let parts = walls.slice(y).1.iter().zip(base(y)..).map(|(wall, element)| {
                if wall.kind != HIDDEN {
                    return NONE;
                }
                let (root, opposite) = patches.find(element);
                let name = &mut names[root as usize];
                if *name == NONE {
                    *name = count;
                    count += 1;
                }
                *name << 1 | u32::from(opposite)
            });
            of_walls.push(parts.collect());
        }
        let links = across.into_iter().map(|(element, slice, number, opposite)| {
            let (root, turned) = patches.find(element);
            (names[root as usize], slice, number, opposite ^ turned)
        });
        Parts { links: links.collect(), of_walls, count }
    }
}

/// The hidden walls' patches, and what is known of them.
#[derive(Debug)]
pub struct Signs {
    /// Of each slice: each wall's part, as [`Parts::of_walls`] has it.
    parts: Layers<u32>,
    /// Of each chunk: each part's class, likewise.
    classes: Layers<u32>,
    /// Of each chunk: what each class became in the chunk above, likewise; or [`NONE`].
    became: Layers<u32>,
    /// Of each chunk: the sign of each part, as far as it is known.
    known: Layers<i8>,
}

impl Signs {
    /// The signs of all hidden walls that can be told.
    ///
    /// # Errors
    /// [`crate::Error::Io`], [`crate::Error::Interrupted`].
    pub fn find(slabs: &Slabs, walls: &Layers<Wall>) -> Result<Signs> {
        let context = slabs.context;
        let mut signs = Signs {
            parts: Layers::new(context),
            classes: Layers::new(context),
            became: Layers::new(context),
            known: Layers::new(context),
        };
        let mut below: Vec<u32> = Vec::new();
        let mut classes_below = 0;
        let mut first = true;
        slabs.each(
            |chunk| Ok(Parts::of(&slabs.held(walls, &chunk, REACH)?, &chunk)),
            |parts| {
                let mut patches = Patches::new(classes_below + parts.count as usize);
                let mut read: Vec<(u32, Vec<u32>)> = Vec::new();
                for (part, slice, number, opposite) in parts.links {
                    if read.iter().all(|(y, _)| *y != slice) {
                        read.push((slice, signs.parts.read(slice)?));
                    }
                    let of_slice = read.iter().find(|(y, _)| *y == slice).expect("it was just read");
                    let other = of_slice.1[number as usize];
                    let class = below[(other >> 1) as usize];
                    let turned = (other ^ class) & 1 == 1;
                    patches.join(classes_below as u32 + part, class >> 1, opposite ^ turned);
                }
                let mut names = vec![NONE; patches.parents.len()];
                let mut named = 0;
                let classes: Vec<u32> = (0..parts.count)
                    .map(|part| {
                        let (root, opposite) = patches.find(classes_below as u32 + part);
                        let name = &mut names[root as usize];
                        if *name == NONE {
                            *name = named;
                            named += 1;
                        }
                        *name << 1 | u32::from(opposite)
                    })
                    .collect();
                if !first {
                    let became = (0..classes_below as u32).map(|class| {
                        let (root, opposite) = patches.find(class);
                        let name = names[root as usize];
                        if name == NONE { NONE } else { name << 1 | u32::from(opposite) }
                    });
                    signs.became.extend(&[became.collect()])?;
                }
                first = false;
                classes_below = named as usize;
                signs.known.extend(&[vec![0; parts.count as usize]])?;
                signs.classes.extend(std::slice::from_ref(&classes))?;
                below = classes;
                signs.parts.extend(&parts.of_walls)
            },
        )?;
        signs.became.extend(&[vec![NONE; classes_below]])?;
        for _ in 0..ROUNDS {
            if !signs.round(slabs, walls)? {
                break;
            }
        }
        Ok(signs)
    }

    /// The walls of a chunk and so many slices more on either side, with their signs.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn walls(&self, slabs: &Slabs, walls: &Layers<Wall>, chunk: &Range<u32>, more: i64) -> Result<Held<Wall>> {
        let mut held = slabs.held(walls, chunk, more)?;
        let mut known: Option<(u32, Vec<i8>)> = None;
        for y in held.slices() {
            if held.slice(y).1.iter().all(|wall| wall.kind != HIDDEN) {
                continue;
            }
            let chunk = y as u32 / CHUNK_SLICES;
            let signs = match known.take() {
                Some((of, signs)) if of == chunk => signs,
                _ => self.known.read(chunk)?,
            };
            for (wall, part) in held.values_mut(y).iter_mut().zip(self.parts.read(y as u32)?) {
                if part != NONE {
                    let sign = signs[(part >> 1) as usize];
                    wall.sign = if part & 1 == 1 { -sign } else { sign };
                }
            }
            known = Some((chunk, signs));
        }
        Ok(held)
    }

    /// A round of votes; whether it told a patch.
    fn round(&mut self, slabs: &Slabs, walls: &Layers<Wall>) -> Result<bool> {
        // What is known of the classes of each chunk that end there.
        let mut ended: Layers<i8> = Layers::new(slabs.context);
        let (mut number, mut below, mut became): (u32, Vec<Votes>, Vec<u32>) = (0, Vec::new(), Vec::new());
        slabs.each(
            |chunk| self.votes(slabs, walls, &chunk),
            |votes: Vec<Votes>| {
                let classes = self.classes.read(number)?;
                let count = classes.iter().map(|class| class >> 1).max().map_or(0, |most| most as usize + 1);
                let mut sums = vec![Votes::default(); count];
                for (votes, class) in votes.iter().zip(&classes) {
                    sums[(class >> 1) as usize].add(*votes, class & 1 == 1);
                }
                if number > 0 {
                    let verdicts = below.iter().zip(&became).map(|(votes, became)| {
                        if *became == NONE {
                            return votes.sign();
                        }
                        sums[(became >> 1) as usize].add(*votes, became & 1 == 1);
                        0
                    });
                    let verdicts = verdicts.collect();
                    ended.extend(&[verdicts])?;
                }
                below = sums;
                became = self.became.read(number)?;
                number += 1;
                Ok(())
            },
        )?;
        ended.extend(&[below.iter().map(Votes::sign).collect()])?;
        let mut known = Layers::new(slabs.context);
        let (mut above, mut any): (Vec<i8>, bool) = (Vec::new(), false);
        for chunk in (0..number).rev() {
            let turned = |sign: i8, code: u32| if code & 1 == 1 { -sign } else { sign };
            let became = self.became.read(chunk)?;
            let verdicts = ended.read(chunk)?.into_iter().zip(became);
            let of_class = |(sign, became): (i8, u32)| match became {
                NONE => sign,
                became => turned(above[(became >> 1) as usize], became),
            };
            let of_classes: Vec<i8> = verdicts.map(of_class).collect();
            let parts = self.classes.read(chunk)?.into_iter().zip(self.known.read(chunk)?);
            let of_parts = parts.map(|(class, known)| {
                let sign = turned(of_classes[(class >> 1) as usize], class);
                any |= known == 0 && sign != 0;
                if known == 0 { sign } else { known }
            });
            let of_parts = of_parts.collect();
            known.extend(&[of_parts])?;
            above = of_classes;
        }
        known.reverse();
        self.known = known;
        Ok(any)
    }

    /// The votes for the parts of a chunk that have no sign yet.
    fn votes(&self, slabs: &Slabs, walls: &Layers<Wall>, chunk: &Range<u32>) -> Result<Vec<Votes>> {
        let number = chunk.start / CHUNK_SLICES;
        let known = self.known.read(number)?;
        let mut votes = vec![Votes::default(); known.len()];
        if known.iter().all(|sign| *sign != 0) {
            return Ok(votes);
        }
        let held = self.walls(slabs, walls, chunk, REACH)?;
        let mut rounds = Rounds::new(&held, REACH);
        for y in chunk.clone() {
            let parts = self.parts.read(y)?;
            let (cells, values) = held.slice(y.into());
            for (((z, x), wall), part) in cells.iter().zip(values).zip(parts) {
                if part == NONE || known[(part >> 1) as usize] != 0 {
                    continue;
                }
                let turn = if part & 1 == 1 { -1.0 } else { 1.0 };
                let (cell, votes) = ([x, y, z].map(i64::from), &mut votes[(part >> 1) as usize]);
                let at = wall.at(cell);
                rounds.round(cell, |there, other| {
                    let votes_too = match other.kind {
                        SEEN => other.confidence > VOTER,
                        HIDDEN => other.sign != 0,
                        _ => false,
                    };
                    if !votes_too || there == cell {
                        return;
                    }
                    let d = minus(other.at(there), at);
                    let decay = || libm::exp(-dot(d, d) / (2.0 * DECAY * DECAY));
                    let weight = match Relation::of(wall, other, d) {
                        None => return,
                        Some(Relation::Wall(same)) => same * decay(),
                        Some(Relation::Crease(same)) => CREASE * same * decay(),
                        Some(Relation::Facing(same)) => FACING * same,
                    };
                    votes.vote(weight * f64::from(other.sign) * turn);
                });
                if wall.hint != 0 {
                    votes.vote(HINT * f64::from(wall.hint) * turn);
                }
            }
        }
        Ok(votes)
    }
}
