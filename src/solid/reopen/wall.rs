//! Walls: occupied cells with their planes; what is seen of them from the outside, and how two of them lie.

use bytemuck::{Pod, Zeroable};

use super::layers::{Rounds, Stretch};
use crate::points::vector::{dot, minus, plus, times};

/// An occupied cell with its plane.
#[derive(Debug, Clone, Copy, Default, PartialEq, Zeroable, Pod)]
#[repr(C)]
pub struct Wall {
    /// The mean of its points, from its lowest corner, in cells.
    pub mean: [f32; 3],
    /// Across it, of length 1.
    pub normal: [f32; 3],
    /// How surely it has a plane.
    pub confidence: f32,
    /// Where the outside lies: 1 along the normal, -1 against it, 0 not known.
    pub sign: i8,
    /// [`SEEN`], [`THIN`] or [`HIDDEN`].
    pub kind: u8,
    /// Of a hidden one: a sign that is likely, or 0.
    pub hint: i8,
    /// Nothing.
    pub filler: u8,
}

/// The outside is near on one side only.
pub const SEEN: u8 = 0;
/// It is near on both sides.
pub const THIN: u8 = 1;
/// It is near on none.
pub const HIDDEN: u8 = 2;

/// How far is looked along the normal for the outside, in steps; the first one; a step's length in cells.
const LOOK: std::ops::RangeInclusive<u32> = 3..=16;
const STEP: f64 = 0.2;
/// What is not found is so far.
const FAR: f64 = 9.0;
/// A wall that ends the look: how far off its plane, how nearly parallel, how far aside.
const NEXT: (f64, f64, f64) = (0.8, 0.7, 1.4);
/// The outside is near up to so many cells, and tells no more than a hint up to so many.
const NEARBY: (f64, f64) = (1.6, 2.4);
/// It is on one side only if it is so much nearer there.
const NEARER: f64 = 1.0;

/// Cells that are looked at to see a wall, either way.
pub const SIGHT: i64 = 4;
/// Cells in which walls are looked for that end the look, either way.
pub const NEXT_REACH: i64 = 3;

/// A wall is deep if there is no outside along its normal, either way, up to so many cells; and a step of that look.
const DEEP: f64 = 5.0;
const DEEP_STEP: f64 = 0.25;
/// Cells that are looked at to tell so, either way.
pub const DEPTH: i64 = 6;

impl Wall {
    /// Its mean, in cells of the grid.
    #[inline]
    pub fn at(&self, cell: [i64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| cell[a] as f64 + f64::from(self.mean[a]))
    }

    /// Its normal.
    #[inline]
    pub fn across(&self) -> [f64; 3] {
        self.normal.map(f64::from)
    }

    /// Whether the solid goes on along the normal, whatever other walls there are in it.
    pub fn is_deep(&self, cell: [i64; 3], solid: &Stretch) -> bool {
        let (at, normal) = (self.at(cell), self.across());
        let steps = (DEEP / DEEP_STEP) as i32;
        (-steps..=steps).all(|step| {
            let there = plus(at, times(DEEP_STEP * f64::from(step), normal));
            solid.get(there.map(|c| c.floor() as i64))
        })
    }

    /// The same wall, as it is seen from outside the solid; `walls` are cubes of [`NEXT_REACH`] cells either way.
    pub fn seen(&self, cell: [i64; 3], walls: &mut Rounds<Wall>, solid: &Stretch) -> Wall {
        let (normal, at) = (self.across(), self.at(cell));
        let mut free = [1.0, -1.0].map(|side| {
            let mut before = None;
            LOOK.clone().find(|step| {
                let there = plus(at, times(side * (STEP * f64::from(*step)), normal)).map(|c| c.floor() as i64);
                before.replace(there) != Some(there) && !solid.get(there)
            })
        });
        // Most walls have the outside nearer than another wall can be, or nowhere near: these are not looked for.
        if free.iter().flatten().any(|step| !is_before(*step, NEXT.0)) {
            let stops = self.stops(cell, walls);
            for (free, stop) in free.iter_mut().zip(stops) {
                *free = free.filter(|step| is_before(*step, stop));
            }
        }
        let [along, against] = free.map(|step| step.map_or(FAR, |step| STEP * f64::from(step)));
        let (least, more) = (along.min(against), against - along);
        let side = if more > 0.0 { 1 } else { -1 };
        let (kind, sign, hint) = if least > NEARBY.0 {
            (HIDDEN, 0, if least <= NEARBY.1 && more.abs() >= NEARER { side } else { 0 })
        } else if more.abs() < NEARER || self.confidence <= 0.0 {
            (THIN, 0, 0)
        } else {
            (SEEN, side, 0)
        };
        Wall { kind, sign, hint, ..*self }
    }

    /// How far off the next walls are along the normal and against it.
    fn stops(&self, cell: [i64; 3], walls: &mut Rounds<Wall>) -> [f64; 2] {
        let (normal, at) = (self.across(), self.at(cell));
        let mut stops = [FAR; 2];
        walls.round(cell, |other, wall| {
            let d = minus(wall.at(other), at);
            let across = dot(d, normal);
            let parallel = dot(normal, wall.across()).abs() >= NEXT.1;
            if across.abs() >= NEXT.0 && parallel && dot(d, d) - across * across <= NEXT.2 * NEXT.2 {
                let stop = &mut stops[usize::from(across < 0.0)];
                *stop = stop.min(across.abs());
            }
        });
        stops
    }
}

/// Whether the look comes as far as a step, if a wall so far off ends it. The first step beyond the wall is its last.
fn is_before(step: u32, stop: f64) -> bool {
    step == *LOOK.start() || STEP * f64::from(step - 1) <= stop
}

/// How two walls lie, and whether the outside is on the same side of their normals: 1 if it surely is, -1 if it surely is not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Relation {
    /// One wall goes on.
    Wall(f64),
    /// They meet at a crease or a bend.
    Crease(f64),
    /// They face each other across a slot or a sheet.
    Facing(f64),
}

/// Two normals are nearly parallel.
const PARALLEL: f64 = 0.8;
/// Of one wall: how far off its plane a mean may lie, and how much more for each cell along it.
const OFF: (f64, f64) = (0.2, 0.2);
/// Of walls that face each other: how far apart, and how much of that aside.
const FACING: (f64, f64) = (0.9, 0.6);
/// A crease tells something from so much on.
const CREASE: f64 = 0.5;

impl Relation {
    /// How `b` lies from `a`; `d` leads from one mean to the other.
    ///
    /// Where a wall bends, b's normal is a's reflected in the plane in the middle between them: that holds for convex and for concave bends.
    pub fn of(a: &Wall, b: &Wall, d: [f64; 3]) -> Option<Relation> {
        let squared = dot(d, d);
        if squared < 1e-6 {
            return None;
        }
        let (n, m) = (a.across(), b.across());
        let (cosine, off, other) = (dot(n, m), dot(n, d), dot(m, d));
        let sure = (f64::from(a.confidence) * f64::from(b.confidence)).sqrt();
        let reflected = cosine - 2.0 * off * other / squared;
        if cosine.abs() > PARALLEL {
            let off = off.abs().max(other.abs());
            let aside = (squared - off * off).max(0.0).sqrt();
            if off < OFF.0 + OFF.1 * aside {
                Some(Relation::Wall(cosine * sure))
            } else if off > FACING.0 && aside < FACING.1 * off {
                Some(Relation::Facing(reflected * sure))
            } else {
                None
            }
        } else if reflected.abs() >= CREASE {
            Some(Relation::Crease(reflected * sure))
        } else {
            None
        }
    }
}
