//! The triangles of one cell, in memory: cut on until few are together, then each with each.

use super::cells::{Cell, Cuboid, Cut};
use super::found::{Found, Intersection, Limits, Record};
use crate::mesh::intersect::intersect;

/// So few triangles are not cut on.
const FEW: usize = 24;
/// Boxes that are looked at to place a cut: more would cost more than a better cut saves.
const LOOKED_AT: usize = 24;
/// What an exact test counts as work, in comparisons of boxes: about the ratio of their times.
const EXACT_WORK: u64 = 32;

/// The records of a cell and the working memory to find pairs among them, for one cell after another.
///
/// Memory: 140 bytes a record, and up to 28 for the cuts under way.
#[derive(Default)]
pub(super) struct Pairs {
    pub records: Vec<Record>,
    cuboids: Vec<Cuboid>,
    /// The records of the cell and, behind them, of its parts that are being looked at.
    members: Vec<u32>,
    involved: Vec<bool>,
    near: Vec<Cuboid>,
    centres: Vec<f64>,
    pairs: u64,
    work: u64,
    first: Option<Intersection>,
}

impl Pairs {
    /// The pairs among `records` that are this cell's.
    pub fn find(&mut self, cell: Cell, limits: &Limits) -> Found {
        self.cuboids.clear();
        self.cuboids.extend(self.records.iter().map(|record| Cuboid::around(record.corners)));
        self.members.clear();
        self.members.extend(0..self.records.len() as u32);
        // Where cuts fall depends on the order, which must not depend on means. As a rule it is descending, found at once.
        self.members.sort_by_key(|&member| self.records[member as usize].number);
        self.involved.clear();
        self.involved.resize(self.records.len(), false);
        (self.pairs, self.work, self.first) = (0, 0, None);
        let complete = self.part(0, cell, limits);
        let involved = self.records.iter().zip(&self.involved).filter(|(_, involved)| **involved);
        Found {
            pairs: self.pairs,
            involved: involved.map(|(record, _)| record.number).collect(),
            first: self.first.clone(),
            work: self.work,
            complete,
        }
    }

    /// Looks at the last members, from `from` on, which are those of `cell`; whether the limits let it finish.
    fn part(&mut self, from: usize, cell: Cell, limits: &Limits) -> bool {
        let to = self.members.len();
        let count = to - from;
        let Some(cut) = self.cut(from) else { return self.each_with_each(from, cell, limits) };
        let counts = [0, 1].map(|side| {
            let members = self.members[from..].iter();
            members.filter(|&&member| cut.has(side, &self.cuboids[member as usize])).count()
        });
        if !Cut::pays(counts, count) {
            return self.each_with_each(from, cell, limits);
        }
        self.work += count as u64;
        for (side, half) in cell.halves(cut).into_iter().enumerate() {
            for at in from..to {
                let member = self.members[at];
                if cut.has(side, &self.cuboids[member as usize]) {
                    self.members.push(member);
                }
            }
            let finished = self.part(to, half, limits);
            self.members.truncate(to);
            if !finished {
                return false;
            }
        }
        true
    }

    fn cut(&mut self, from: usize) -> Option<Cut> {
        let members = &self.members[from..];
        if members.len() <= FEW {
            return None;
        }
        self.near.clear();
        let step = members.len().div_ceil(LOOKED_AT);
        self.near.extend(members.iter().step_by(step).map(|&member| self.cuboids[member as usize]));
        Cut::through(&self.near, &mut self.centres)
    }

    fn each_with_each(&mut self, from: usize, cell: Cell, limits: &Limits) -> bool {
        let members = &self.members[from..];
        self.near.clear();
        self.near.extend(members.iter().map(|&member| self.cuboids[member as usize]));
        for (i, &a) in members.iter().enumerate() {
            let cuboid = self.near[i];
            for (other, &b) in self.near[i + 1..].iter().zip(&members[i + 1..]) {
                if !cuboid.meets(other) || !cell.holds(cuboid.common(other).low) {
                    continue;
                }
                self.work += EXACT_WORK;
                let (one, two) = (self.records[a as usize], self.records[b as usize]);
                if intersect(one.vertices, one.corners, two.vertices, two.corners) {
                    self.pairs += 1;
                    self.involved[a as usize] = true;
                    self.involved[b as usize] = true;
                    let (one, two) = (one.number, two.number);
                    let at = cuboid.common(other).centre();
                    let found = Intersection { triangles: [one.min(two), one.max(two)], at };
                    Intersection::keep_first(&mut self.first, Some(found));
                }
            }
            self.work += (members.len() - i) as u64;
            if self.pairs > limits.pairs || self.work >= limits.work {
                return false;
            }
        }
        true
    }
}
