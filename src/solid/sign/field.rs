//! The field u that makes E least.

use std::ops::Range;

use rayon::prelude::*;

use super::block::{Block, Side};
use super::normal::Wall;
use super::system::System;
use crate::resources::workers::Workers;

/// A component is bare if this part of its border is, and a cavity lined if no more of its border is open.
pub const BARE: f64 = 0.25;

/// What a face weighs if one of its cells lies between two occupied ones: a gap in a wall, as sparse sampling leaves.
const GAP: f32 = 0.1;

/// The number of cells that one thread takes at a time.
const ALONE: usize = 1 << 14;

/// Fewer enclosed cells are no cavity. On wide cells fewer are a piece, and so may a component be with fewer that lie clear of walls.
const CAVITY: usize = 27;

/// A layer of cells along walls is a piece if so many faces for each of its cells lead to the other side.
const LEAKY: f64 = 0.125;

/// The field on the free cells of a block.
#[derive(Debug)]
pub struct Field<'a> {
    pub(super) block: &'a Block,
    occupied: &'a [bool],
    /// Cells with an occupied one among the 26 round them.
    pub(super) lined: Vec<bool>,
    gaps: Vec<bool>,
    /// Cells that are outside, whatever the field.
    outside: Vec<bool>,
    /// The weight of a face between each cell and an equally open one; 0 where u is not looked for.
    open: Vec<f32>,
    /// The u of each cell in which it is looked for.
    pub(super) u: Vec<f32>,
}

impl<'a> Field<'a> {
    /// The field that is −1 on the cells `outside`.
    pub fn new(block: &'a Block, occupied: &'a [bool], outside: Vec<bool>) -> Field<'a> {
        let lined = {
            let wide = block.each_row(|row, out| {
                let [before, here, after] = [row.start - 1, row.start, row.start + 1].map(|first| &occupied[first..]);
                out.iter_mut().enumerate().for_each(|(x, out)| *out = before[x] | here[x] | after[x]);
            });
            let [_, slice, row] = block.strides();
            let round: Vec<isize> = [-slice, 0, slice].into_iter().flat_map(|s| [s - row, s, s + row]).collect();
            block.each_row(|row, out| {
                for step in &round {
                    let other = &wide[row.start.wrapping_add_signed(*step)..][..out.len()];
                    out.iter_mut().zip(other).for_each(|(out, other)| *out |= other);
                }
            })
        };
        let opposite: Vec<isize> = block.around().into_iter().filter(|step| *step > 0).collect();
        let gaps = block.each_row(|row, out| {
            for &step in &opposite {
                let [one, other] = [step, -step].map(|s| &occupied[row.start.wrapping_add_signed(s)..][..out.len()]);
                out.iter_mut().zip(one.iter().zip(other)).for_each(|(out, (one, other))| *out |= one & other);
            }
            out.iter_mut().zip(&occupied[row]).for_each(|(out, occupied)| *out &= !occupied);
        });
        let (open, u) = (vec![0.0; occupied.len()], vec![0.0; occupied.len()]);
        let mut field = Field { block, occupied, lined, gaps, outside, open, u };
        field.look_where_free();
        field
    }

    /// Looks for u in all cells that are neither occupied nor outside.
    fn look_where_free(&mut self) {
        let of = self.occupied.par_iter().zip(&self.outside).zip(&self.gaps);
        self.open.par_iter_mut().with_min_len(ALONE).zip(of).for_each(|(open, ((occupied, outside), gap))| {
            *open = if occupied | outside { 0.0 } else { weight(*gap) };
        });
    }

    /// Whether u is looked for in a cell.
    pub(super) fn is_asked(&self, cell: usize) -> bool {
        self.open[cell] > 0.0
    }

    /// Whether two free cells lie on the same side.
    pub(super) fn same_side(&self, [a, b]: [u32; 2]) -> bool {
        self.is_outside(a as usize) == self.is_outside(b as usize)
    }

    /// Whether nothing stands between two cells that share a face: neither is occupied, nor a gap between occupied ones.
    pub(super) fn is_open(&self, a: usize, b: usize) -> bool {
        !(self.occupied[a] || self.occupied[b] || self.gaps[a] || self.gaps[b])
    }

    /// Whether a cell is free and outside.
    pub(super) fn is_outside(&self, cell: usize) -> bool {
        if self.is_asked(cell) { self.u[cell] <= 0.0 } else { !self.occupied[cell] }
    }

    /// Which cells are free and inside.
    pub(super) fn inside(&self) -> Vec<bool> {
        self.open.iter().zip(&self.u).map(|(open, u)| (*open > 0.0) & (*u > 0.0)).collect()
    }

    /// Finds the u that makes E least, from where it is.
    pub fn solve(&mut self, walls: &[Wall], workers: &Workers) {
        let known = |cells: Range<usize>, weights: &mut [f32], held: &mut [f32]| {
            let of = self.occupied[cells.clone()].iter().zip(&self.gaps[cells.clone()]);
            for (to, (occupied, gap)) in weights.iter_mut().zip(of) {
                *to = if *occupied { 0.0 } else { weight(*gap) };
            }
            for (to, open) in held.iter_mut().zip(&self.open[cells]) {
                *to = if *open > 0.0 { 0.0 } else { -1.0 };
            }
        };
        let mut system = System::new(self.block, &self.open, workers, known);
        walls.iter().for_each(|wall| system.across(wall.sides, wall.weight, |_| -1.0));
        system.solve(&mut self.u, workers);
    }

    /// Lets the outside into the components that are `bare`, as far as it is `reached`. Both are told of each cell of the block. Whether it gains a cell.
    pub fn open(&mut self, bare: &[bool], reached: &[bool]) -> bool {
        let mut gains = false;
        for ((outside, bare), reached) in self.outside.iter_mut().zip(bare).zip(reached) {
            gains |= bare & reached & !*outside;
            *outside |= bare & reached;
        }
        if gains {
            self.look_where_free();
        }
        gains
    }

    /// Gives all cells that are `bare` to the outside.
    pub fn give_up(&mut self, bare: &[bool]) {
        self.u.iter_mut().zip(bare).filter(|(_, bare)| **bare).for_each(|(u, _)| *u = -1.0);
    }

    /// The side of every cell. What is not inside is outside if a path of such cells leads to what was outside from the start. Else it is enclosed: a cavity if
    /// walls line it ([`Field::is_lined`]), and else inside.
    ///
    /// Where the level's cells are wider than the grid's (`are_wide`), pieces ([`Field::is_piece`]) have no side: enclosed cells that walls line, and components of inside
    /// cells. Walls cut a slot or a fin to such pieces where it is hardly wider than a cell, and the grid's own cells tell more.
    pub fn sides(&self, are_wide: bool) -> Vec<Side> {
        let first = |(occupied, outside): (&bool, &bool)| match (occupied, outside) {
            (true, _) => Side::Wall,
            (false, true) => Side::Outside,
            (false, false) => Side::Inside,
        };
        let mut sides: Vec<Side> = self.occupied.iter().zip(&self.outside).map(first).collect();
        let is_start = |&cell: &usize| {
            self.is_asked(cell)
                && self.u[cell] <= 0.0
                && self.block.beside(cell).iter().any(|&next| sides[next] == Side::Outside)
        };
        let starts = (0..sides.len()).into_par_iter().with_min_len(ALONE).filter(is_start).collect();
        self.spread(&mut sides, starts, |_| {});
        let mut pieces = Vec::new();
        for cell in 0..sides.len() {
            if sides[cell] == Side::Inside && self.is_outside(cell) {
                let mut enclosed = Vec::new();
                self.spread(&mut sides, vec![cell], |cell| enclosed.push(cell));
                let is_lined = self.is_lined(&enclosed);
                let is_other = |next: usize| !self.occupied[next] && !self.is_outside(next);
                let is_piece = are_wide && is_lined && self.is_piece(&enclosed, false, is_other);
                if enclosed.len() < CAVITY || !is_lined || is_piece {
                    // Not outside, and not to be found again.
                    enclosed.iter().for_each(|&cell| sides[cell] = Side::Unknown);
                    pieces.extend(enclosed.into_iter().filter(|_| is_lined));
                }
            }
        }
        sides.iter_mut().filter(|side| **side == Side::Unknown).for_each(|side| *side = Side::Inside);
        if are_wide {
            pieces.into_iter().for_each(|cell| sides[cell] = Side::Unknown);
            self.forget_pieces(&mut sides);
        }
        sides
    }

    /// Whether cells that faces join are a piece: few cells; or a layer along walls, of which many faces lead to cells on the other side. If `through_gaps`, a layer is one only if a gap lies on each
    /// of these faces.
    fn is_piece(&self, cells: &[usize], through_gaps: bool, is_other: impl Fn(usize) -> bool) -> bool {
        let is_layer = || cells.iter().filter(|cell| !self.lined[**cell]).count() < CAVITY;
        let leaks = || {
            let beside = |cell: usize| self.block.beside(cell).map(|next| (cell, next));
            let to_others = cells.iter().flat_map(|cell| beside(*cell)).filter(|(_, next)| is_other(*next));
            let [count, open] = to_others
                .fold([0, 0], |[count, open], (cell, next)| [count + 1, open + usize::from(self.is_open(cell, next))]);
            count as f64 >= LEAKY * cells.len() as f64 && (open == 0 || !through_gaps)
        };
        cells.len() < CAVITY || (is_layer() && leaks())
    }

    /// Takes the side from pieces of the inside, which faces join. What lies before a floor or a dome may be a layer, too: its mouth is open.
    fn forget_pieces(&self, sides: &mut [Side]) {
        let mut waits: Vec<bool> = sides.iter().map(|side| *side == Side::Inside).collect();
        for cell in 0..waits.len() {
            let mut piece = Vec::new();
            piece.extend(std::mem::take(&mut waits[cell]).then_some(cell));
            let mut at = 0;
            while let Some(&cell) = piece.get(at) {
                piece.extend(self.block.beside(cell).into_iter().filter(|&next| std::mem::take(&mut waits[next])));
                at += 1;
            }
            let is_other = |next: usize| matches!(sides[next], Side::Outside | Side::Unknown);
            if self.is_piece(&piece, true, is_other) {
                piece.into_iter().for_each(|cell| sides[cell] = Side::Unknown);
            }
        }
    }

    /// Makes cells that are not inside outside, and all that faces join to them.
    fn spread(&self, sides: &mut [Side], mut stack: Vec<usize>, mut found: impl FnMut(usize)) {
        for &cell in &stack {
            sides[cell] = Side::Outside;
        }
        while let Some(cell) = stack.pop() {
            found(cell);
            if self.block.at_border(cell) {
                continue;
            }
            for next in self.block.beside(cell) {
                if sides[next] == Side::Inside && self.is_outside(next) {
                    sides[next] = Side::Outside;
                    stack.push(next);
                }
            }
        }
    }

    /// Whether what is enclosed is lined by walls, so that it is a cavity that was sampled.
    pub fn is_lined(&self, enclosed: &[usize]) -> bool {
        let (mut lined, mut open) = (0u64, 0u64);
        for &cell in enclosed {
            for next in self.block.beside(cell) {
                if !self.is_asked(next) || self.u[next] > 0.0 {
                    if self.is_open(cell, next) { open += 1 } else { lined += 1 }
                }
            }
        }
        open as f64 <= BARE * (open + lined) as f64
    }
}

/// What a face weighs of which one cell is a gap, or neither.
fn weight(gap: bool) -> f32 {
    if gap { GAP } else { 1.0 }
}
