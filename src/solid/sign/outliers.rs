//! Outliers: occupied cells that belong to no surface.
//!
//! A cell is *thin* if the 5 x 5 x 5 cells round it hold less than a quarter of the occupied cells that they hold in the median. Thin cells count for no walls, twice over:
//! among many strays the median is theirs at first. But where samples are sparse, so are the cells of a surface: what is thin stays if it is not
//! among cells three times as large, of which, with thin cells only, a third as many lie round it as round the others. Small groups that stand apart count for no walls either.

use rayon::prelude::*;

use super::block::{Block, PAD};
use crate::grid::Cell;

/// How many times as large the cells are among which sparse samples are not thin.
const COARSER: u32 = 3;

/// A cell is thin below this part of the median.
const SHARE: f64 = 0.25;

/// Groups of fewer cells that stand apart are no surface.
const GROUP: usize = 8;

/// If fewer cells are left, they are no surface either, and nothing is taken out.
const FEWEST: usize = 27;

/// The number of cells that one thread takes at a time.
const TOGETHER: usize = 1024;

/// The most memory that taking them out of a block of so many cells takes, of which no more than `occupied` are: two flags for each and a third for cells three times as
/// large, and numbers of those that are occupied, as they are, as they are counted, and sorted.
pub fn bytes(cells: Cell, occupied: u64) -> u64 {
    let block: u64 = cells.into_iter().map(|c| u64::from(c) + 2 * PAD as u64).product();
    3 * block + occupied.min(block) * 5 * size_of::<u32>() as u64
}

/// Takes the outliers out of the occupied cells, and gives them. The work is dealt out to the pool that it is called in.
pub fn take_out(block: &Block, occupied: &mut [bool]) -> Vec<u32> {
    let before: Vec<u32> = (0..occupied.len() as u32).filter(|&cell| occupied[cell as usize]).collect();
    let mut cells = before.clone();
    let near: Vec<isize> =
        Block::ball(12).into_iter().filter(|d| d.iter().all(|c| c.abs() <= 2)).map(|d| block.step(d)).collect();
    let rows: Vec<isize> = (-2..=2).flat_map(|y| (-2..=2).map(move |z| block.step([0, y, z]))).collect();
    for _ in 0..2 {
        let around = |&cell: &u32| {
            let row = |step: &isize| Block::five(occupied, (cell as usize).wrapping_add_signed(*step)).count_ones();
            rows.iter().map(row).sum::<u32>()
        };
        let counts: Vec<u32> = cells.par_iter().with_min_len(TOGETHER).map(around).collect();
        let mut sorted = counts.clone();
        sorted.sort_unstable();
        let Some(median) = sorted.get(sorted.len() / 2) else { break };
        let least = SHARE * f64::from(*median) - 0.5;
        cells
            .iter()
            .zip(&counts)
            .filter(|(_, count)| f64::from(**count) < least)
            .for_each(|(&cell, _)| occupied[cell as usize] = false);
        cells.retain(|&cell| occupied[cell as usize]);
    }
    keep_sparse(block, occupied, &before);
    cells = before.iter().copied().filter(|&cell| occupied[cell as usize]).collect();
    drop_groups(occupied, &cells, &near);
    if cells.iter().filter(|&&cell| occupied[cell as usize]).count() < FEWEST {
        before.iter().for_each(|&cell| occupied[cell as usize] = true);
    }
    before.into_iter().filter(|&cell| !occupied[cell as usize]).collect()
}

/// Puts those of the cells back that are thin because the sampling is sparse there.
fn keep_sparse(block: &Block, occupied: &mut [bool], before: &[u32]) {
    let coarse = Block::new(block.cells.map(|c| c.div_ceil(COARSER)));
    let parent = |cell: u32| coarse.index(block.cell(cell as usize).map(|c| c / COARSER as usize));
    let (mut any, mut dense) = (vec![false; coarse.size()], vec![false; coarse.size()]);
    for &cell in before {
        any[parent(cell)] = true;
        dense[parent(cell)] |= occupied[cell as usize];
    }
    let near: Vec<isize> =
        Block::ball(12).into_iter().filter(|d| d.iter().all(|c| c.abs() <= 2)).map(|d| coarse.step(d)).collect();
    let count = |of: &[bool], cell: usize| near.iter().filter(|&&s| of[cell.wrapping_add_signed(s)]).count();
    let mut counts: Vec<usize> = (0..dense.len()).filter(|&cell| dense[cell]).map(|cell| count(&any, cell)).collect();
    counts.sort_unstable();
    let Some(median) = counts.get(counts.len() / 2) else { return };
    // Strays near a surface are not to be held by it.
    let sparse: Vec<bool> = any.iter().zip(&dense).map(|(any, dense)| any & !dense).collect();
    for &cell in before {
        if !occupied[cell as usize] && 3 * count(&sparse, parent(cell)) >= *median {
            occupied[cell as usize] = true;
        }
    }
}

/// Takes out groups of fewer than [`GROUP`] cells that no more than two cells part; none if there is no larger one.
fn drop_groups(occupied: &mut [bool], cells: &[u32], near: &[isize]) {
    let mut seen = vec![false; occupied.len()];
    let (mut group, mut small, mut any_large) = (Vec::new(), Vec::new(), false);
    for &first in cells {
        if std::mem::replace(&mut seen[first as usize], true) {
            continue;
        }
        group.clear();
        group.push(first as usize);
        let mut at = 0;
        while at < group.len() {
            for &step in near {
                let next = group[at].wrapping_add_signed(step);
                if occupied[next] && !std::mem::replace(&mut seen[next], true) {
                    group.push(next);
                }
            }
            at += 1;
        }
        if group.len() < GROUP {
            small.extend_from_slice(&group);
        } else {
            any_large = true;
        }
    }
    if any_large {
        small.into_iter().for_each(|cell| occupied[cell] = false);
    }
}
