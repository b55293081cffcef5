//! Flips: two triangles get the other diagonal of their quadrilateral, until that is taken back.

use std::ops::Range;

use super::contract::Contraction;
use super::diagonals::{cross, cuts, minus, normal};
use super::sphere::dot;
use super::surface::larger_angle;

/// Of two triangles, where the corner is that each passes on, whose it was, and whose it is.
#[derive(Debug, Clone, Copy)]
pub struct Flip {
    triangles: [usize; 2],
    positions: [usize; 2],
    before: [u32; 2],
    after: [u32; 2],
    is_done: bool,
}

/// What is asked of vertices: whether their stars are whole, where they are, and whether that is at a crease.
pub struct Asked<'a> {
    pub inside: &'a dyn Fn(u32) -> bool,
    pub place: &'a dyn Fn(u32) -> [f64; 3],
    pub creased: &'a dyn Fn(u32) -> bool,
}

impl Contraction {
    /// Flips edges of some triangles, in order.
    pub fn flip(&mut self, of_slab: Range<usize>, asked: &Asked) {
        let most = of_slab.len() / 4;
        let (start, earlier) = (of_slab.start, self.flips.len());
        for t in of_slab {
            if self.triangles[t].is_none_or(|triangle| !triangle.iter().all(|v| (asked.inside)(*v)))
                || self.takes_part(t)
            {
                continue;
            }
            if 2 * (self.flips.len() - earlier) + 2 > most {
                return;
            }
            let mut best: Option<(f64, Flip)> = None;
            for position in 0..3 {
                if let Some((gain, flip)) = self.gain(t, position, asked)
                    && best.is_none_or(|(most, _)| gain > most)
                {
                    best = Some((gain, flip));
                }
            }
            if let Some((_, flip)) = best {
                assert!(flip.triangles.iter().all(|t| *t >= start));
                self.flips.push(flip);
                for i in 0..2 {
                    self.original[flip.triangles[i]][flip.positions[i]] = flip.after[i];
                }
                self.rename();
            }
        }
    }

    fn takes_part(&self, t: usize) -> bool {
        self.flips.iter().any(|flip| flip.triangles.contains(&t))
    }

    /// What is gained by flipping the edge of a triangle that begins at a position.
    fn gain(&self, t: usize, position: usize, asked: &Asked) -> Option<(f64, Flip)> {
        let triangle = self.triangles[t]?;
        let [a, c, d] = [0, 1, 2].map(|more| triangle[(position + more) % 3]);
        // The one other triangle that has the edge, the other way round.
        let beside = self.around[c as usize].iter().find_map(|&u| {
            let other = self.triangles[u]?;
            (0..3).find(|at| other[*at] == c && other[(at + 1) % 3] == a).map(|at| (u, at, other[(at + 2) % 3]))
        });
        let (u, at, b) = beside?;
        let is_free = !self.takes_part(u) && self.kept[u] == self.kept[t];
        if b == d || !(asked.inside)(b) || !is_free || self.neighbours(b).contains(&d) {
            return None;
        }
        // The edges that other flips took away come back when these are taken back.
        let taken_away = |flip: &Flip| {
            let of = |t: usize| self.triangles[t].unwrap_or_default();
            let [one, other] = flip.triangles.map(of);
            let alone = |v: u32| (one.contains(&v), other.contains(&v));
            [alone(b), alone(d)] == [(true, false), (false, true)]
                || [alone(b), alone(d)] == [(false, true), (true, false)]
        };
        if self.flips.iter().any(taken_away) {
            return None;
        }
        let corners = [a, b, c, d];
        let places = corners.map(asked.place);
        let whole = cross(minus(places[2], places[0]), minus(places[3], places[1]));
        let square = dot(whole, whole);
        let least = |[one, other]: [[[f64; 3]; 3]; 2]| {
            (dot(normal(one), whole) / square).min(dot(normal(other), whole) / square)
        };
        let [before, after] = cuts(places);
        let (now, then) = (least(before), least(after));
        if then.is_nan() || then <= 0.02 {
            return None;
        }
        let [a_creased, b_creased, c_creased, d_creased] = corners.map(asked.creased);
        let level = || {
            let [one, other] = before.map(normal);
            let along = dot(one, other);
            along > 0.0 && along * along >= 0.95 * 0.95 * (dot(one, one) * dot(other, other))
        };
        let better = if now <= 0.02 {
            true
        } else if (a_creased && c_creased) != (b_creased && d_creased) {
            b_creased && d_creased
        } else {
            level() && larger_angle(places) == 1
        };
        let flip = Flip {
            triangles: [t, u],
            positions: [position, at],
            before: [self.original[t][position], self.original[u][at]],
            after: [b, d],
            is_done: true,
        };
        better.then_some((then - now, flip))
    }

    /// Whether a triangle is flipped.
    pub fn is_flipped(&self, t: usize) -> bool {
        self.flips.iter().any(|flip| flip.is_done && flip.triangles.contains(&t))
    }

    /// Takes back the flips of some triangles: whether there were any.
    pub fn flip_back(&mut self, triangles: &[usize]) -> bool {
        let mut any = false;
        for flip in &mut self.flips {
            if flip.is_done && flip.triangles.iter().any(|t| triangles.contains(t)) {
                flip.is_done = false;
                any = true;
                for i in 0..2 {
                    self.original[flip.triangles[i]][flip.positions[i]] = flip.before[i];
                }
            }
        }
        if any {
            self.rename();
        }
        any
    }
}
