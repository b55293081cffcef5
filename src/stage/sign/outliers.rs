//! Outliers: occupied cells that belong to no surface.
//!
//! A cell is *thin* if the 5 x 5 x 5 cells round it hold less than a quarter of the occupied cells that they hold in the median. Thin cells count for no walls, twice over:
//! among many strays the median is theirs at first. Nor do small groups that stand apart.

use super::block::Block;

/// A cell is thin below this part of the median.
const SHARE: f64 = 0.25;

/// Groups of fewer cells that stand apart are no surface.
const GROUP: usize = 8;

/// If fewer cells are left, they are no surface either, and nothing is taken out.
const FEWEST: usize = 27;

/// Takes the outliers out of the occupied cells, and gives them.
pub fn take_out(block: &Block, occupied: &mut [bool]) -> Vec<u32> {
    let before: Vec<u32> = (0..occupied.len() as u32).filter(|&cell| occupied[cell as usize]).collect();
    let mut cells = before.clone();
    let near: Vec<isize> =
        Block::ball(12).into_iter().filter(|d| d.iter().all(|c| c.abs() <= 2)).map(|d| block.step(d)).collect();
    for _ in 0..2 {
        let counts: Vec<u32> = cells
            .iter()
            .map(|&cell| near.iter().filter(|&&s| occupied[cell.wrapping_add_signed(s as i32) as usize]).count() as u32)
            .collect();
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
    drop_groups(occupied, &cells, &near);
    if cells.iter().filter(|&&cell| occupied[cell as usize]).count() < FEWEST {
        before.iter().for_each(|&cell| occupied[cell as usize] = true);
    }
    before.into_iter().filter(|&cell| !occupied[cell as usize]).collect()
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
