//! Sheets: patches of walls that have the outside on both sides.
//!
//! ```text
//!      o o o o o o o      # walls, o outside, i inside
//!      # # # # # # #      Left, the floor is a sheet: the outside lies on both of its sides. The body on it is not.
//!      o o # i # o o      Sheets have no inside. They are kept as thin bodies ([`crate::solid::thicken`]).
//!          # i #
//!      o o # # # o o      The floor goes on beneath the body, where it has the inside on one side ([`continued`]).
//! ```

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::block::Side;
use super::block::{Block, PAD};
use super::normal::Wall;

/// A patch of fewer walls is no sheet: single walls at the edges of bodies may see the outside on both sides.
const SHEET: usize = 27;

/// A patch of walls with the same side on both sides.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sheet {
    /// Its walls, as indices of the block.
    pub walls: Vec<u32>,
}

/// A wall of a sheet, on the level of the sign.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SheetWall {
    /// Its cell, as an index of the level's block.
    pub cell: u32,
    /// Its normal.
    pub normal: [f32; 3],
}

/// Finds the patches of walls that have `side` on both sides, the largest first.
pub fn find(block: &Block, walls: &[Wall], sides: &[Side], side: Side) -> Vec<Sheet> {
    let is = |cell: u32| sides[cell as usize] == side;
    let mut open = vec![false; sides.len()];
    let cells: Vec<u32> = walls.iter().filter(|w| w.sides.into_iter().all(is)).map(|w| w.cell).collect();
    cells.iter().for_each(|&cell| open[cell as usize] = true);
    let around = block.around();
    let mut sheets = Vec::new();
    for &first in &cells {
        if !std::mem::take(&mut open[first as usize]) {
            continue;
        }
        let (mut walls, mut at) = (vec![first], 0);
        while at < walls.len() {
            for step in &around {
                let next = (walls[at] as usize).wrapping_add_signed(*step);
                if std::mem::take(&mut open[next]) {
                    walls.push(next as u32);
                }
            }
            at += 1;
        }
        if walls.len() >= SHEET {
            sheets.push(Sheet { walls });
        }
    }
    sheets.sort_by_key(|sheet| std::cmp::Reverse(sheet.walls.len()));
    sheets
}

/// A place is a cell four times as wide, in which at least so many of the eight twice as wide hold walls.
const PLACE: u32 = 3;

/// Walls to a cell twice as wide that a place has at the least, or else it is sparse: then cells have sides of less than .9 sampling distances there (docs/algorithm.md, section 5.1).
const WALLS: f64 = 1.9;

/// How many places some walls have, and how many of these are sparse.
pub fn sparse(walls: impl Iterator<Item = [usize; 3]>) -> [u64; 2] {
    let mut places: BTreeMap<[usize; 3], (u32, u8)> = BTreeMap::new();
    for cell in walls {
        let (count, eighths) = places.entry(cell.map(|c| c / 4)).or_default();
        *count += 1;
        *eighths |= 1 << cell.iter().fold(0, |eighth, c| 2 * eighth + c / 2 % 2);
    }
    let held =
        places.into_values().map(|(count, eighths)| (count, eighths.count_ones())).filter(|(_, held)| *held >= PLACE);
    held.fold([0, 0], |[all, sparse], (count, held)| {
        [all + 1, sparse + u64::from(f64::from(count) < WALLS * f64::from(held))]
    })
}

/// How far, in cells, walls are asked what they part.
const ROUND: i32 = 6;

/// Walls whose normals differ by less than this cosine belong to the same patch.
const SMOOTH: f32 = 0.85;

/// The part of the walls round a wall that part nothing, from which on it belongs to a sheet.
const MOST: f64 = 0.5;

/// How far from a wall's plane, in cells, others lie in it.
const IN_PLANE: f32 = 1.0;

/// The number of walls that one thread takes at a time.
const TOGETHER: usize = 256;

/// What a sheet's wall weighs, as a part of what it weighed.
const SHEET_WEIGHT: f32 = 0.05;

/// Takes weight from the walls of sheets: those in whose neighbourhood, as far as it is smooth, more walls have the same side on both sides than do not. Says how many.
pub fn weigh(block: &Block, walls: &mut [Wall], parts_nothing: &[bool]) -> usize {
    let near = Near::new(block, walls, parts_nothing);
    let sheets: Vec<usize> = (0..walls.len())
        .into_par_iter()
        .with_min_len(TOGETHER)
        .filter(|&i| {
            let wall = &walls[i];
            if wall.weight < super::normal::WEIGHT || !near.may_be_near_marked(wall.cell) {
                return false;
            }
            let (mut nothing, mut all) = (0u32, 0u32);
            for j in near.of(wall.cell).filter(|&j| dot(walls[j].normal, wall.normal).abs() >= SMOOTH) {
                all += 1;
                nothing += u32::from(parts_nothing[j]);
            }
            f64::from(nothing) > MOST * f64::from(all)
        })
        .collect();
    sheets.iter().for_each(|&i| walls[i].weight *= SHEET_WEIGHT);
    sheets.len()
}

/// The walls whose cells are in `sheets`, which is sorted, and those that a sheet goes on in beneath a body, which have the inside on one side: they lie near a sheet's wall, in its plane, and
/// face as it does. In the order of `walls`.
pub fn continued(block: &Block, walls: &[Wall], sheets: &[u32]) -> Vec<SheetWall> {
    if sheets.is_empty() {
        return Vec::new();
    }
    let in_sheet: Vec<bool> = walls.iter().map(|wall| sheets.binary_search(&wall.cell).is_ok()).collect();
    let near = Near::new(block, walls, &in_sheet);
    let place = |wall: &Wall| block.cell(wall.cell as usize).map(|c| c as f32);
    let goes_on = |wall: &Wall| {
        let at = place(wall);
        near.may_be_near_marked(wall.cell)
            && near.of(wall.cell).filter(|&j| in_sheet[j]).map(|j| &walls[j]).any(|other| {
                let there = place(other);
                let across = dot([0, 1, 2].map(|a| at[a] - there[a]), other.normal);
                across.abs() <= IN_PLANE && dot(wall.normal, other.normal).abs() >= SMOOTH
            })
    };
    let of_sheets =
        walls.par_iter().zip(&in_sheet).with_min_len(TOGETHER).filter(|(wall, in_sheet)| **in_sheet || goes_on(wall));
    of_sheets.map(|(wall, _)| SheetWall { cell: wall.cell, normal: wall.normal }).collect()
}

/// Walls by their cells, to look at those within a ball. Some are marked: where none of these is near, there is often nothing to look for.
struct Near<'a> {
    block: &'a Block,
    /// The wall of each cell of the block; `u32::MAX` for none.
    at: Vec<u32>,
    /// Rows of the ball: steps to their middles, and how far they go either way.
    rows: Vec<([i64; 2], usize)>,
    /// Cubes of [`CUBE`] cells a side, some more on every side, and whether a marked wall's ball may reach into each.
    cubes: Block,
    reached: Vec<bool>,
}

/// The cells along a cube's side; a ball reaches no more than [`CUBES`] cubes beyond that of its middle.
const CUBE: usize = 4;
const CUBES: usize = (ROUND as usize).div_ceil(CUBE);
const _: () = assert!(CUBES <= PAD);

impl Near<'_> {
    fn new<'a>(block: &'a Block, walls: &[Wall], marked: &[bool]) -> Near<'a> {
        let mut at = vec![u32::MAX; block.size()];
        walls.iter().zip(0..).for_each(|(wall, i)| at[wall.cell as usize] = i);
        let rows = (-ROUND..=ROUND)
            .flat_map(|y| (-ROUND..=ROUND).map(move |z| (y, z, ROUND * ROUND - y * y - z * z)))
            .filter(|(.., left)| *left >= 0)
            .map(|(y, z, left)| ([y, z].map(i64::from), left.isqrt() as usize))
            .collect();
        let cubes = Block::new(block.cells.map(|c| c.div_ceil(CUBE as u32)));
        let mut middles = vec![false; cubes.size()];
        walls.iter().zip(marked).filter(|(_, marked)| **marked).for_each(|(wall, _)| {
            middles[cubes.index(block.cell(wall.cell as usize).map(|c| c / CUBE))] = true;
        });
        let mut reached = vec![false; cubes.size()];
        let (slice, row) = (cubes.rows * cubes.width, cubes.width);
        for middle in (0..middles.len()).filter(|i| middles[*i]) {
            let lowest = middle - CUBES * (slice + row + 1);
            for (y, z) in (0..=2 * CUBES).flat_map(|y| (0..=2 * CUBES).map(move |z| (y, z))) {
                let first = lowest + y * slice + z * row;
                reached[first..=first + 2 * CUBES].fill(true);
            }
        }
        Near { block, at, rows, cubes, reached }
    }

    /// Whether a marked wall may lie within [`ROUND`] cells of a cell.
    fn may_be_near_marked(&self, cell: u32) -> bool {
        self.reached[self.cubes.index(self.block.cell(cell as usize).map(|c| c / CUBE))]
    }

    /// The walls within [`ROUND`] cells of a cell.
    fn of(&self, cell: u32) -> impl Iterator<Item = usize> {
        let [x, y, z] = self.block.cell(cell as usize).map(|c| c as i64);
        let found = self.rows.iter().filter_map(move |&([dy, dz], far)| {
            // Of rows that begin or end beyond the block, what lies in it.
            let row = self.block.at([0, y + dy, z + dz])?;
            let x = x as usize;
            Some(self.at[row + x.saturating_sub(far)..=(row + x + far).min(row - PAD + self.block.width - 1)].iter())
        });
        found.flatten().filter(|j| **j != u32::MAX).map(|j| *j as usize)
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|i| a[i] * b[i]).sum()
}
