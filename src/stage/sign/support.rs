//! Support: whether what the field calls inside is lined by walls, or lies bare.
//!
//! ```text
//!   # # # # # #            . . . . .           i inside, # occupied, . outside
//!   # i i i i .            . i i i .           Left: a body with a hole; few cells of its border are bare.
//!   # i i i i .          # i i i i i #         Right: what a dome, seen from below, holds; as many are bare as are lined.
//!   # # # # # #            # # # # #
//! ```

use super::field::Field;

/// A component is bare if this part of its border is.
const BARE: f64 = 0.25;

/// Of each cell of the block, whether it belongs to a component of the inside that is bare; none if there is no such component.
pub fn bare(field: &Field<'_>) -> Option<Vec<bool>> {
    let strides = field.block.strides();
    let mut seen = vec![false; field.u.len()];
    let mut bare = None;
    let mut component = Vec::new();
    for first in 0..field.u.len() {
        if !field.is_inside(first) || std::mem::replace(&mut seen[first], true) {
            continue;
        }
        component.clear();
        component.push(first as u32);
        let (mut lined, mut open) = (0u64, 0u64);
        let mut at = 0;
        while at < component.len() {
            let cell = component[at] as usize;
            for next in strides.into_iter().flat_map(|s| [cell.wrapping_add_signed(-s), cell.wrapping_add_signed(s)]) {
                if field.is_inside(next) {
                    if !std::mem::replace(&mut seen[next], true) {
                        component.push(next as u32);
                    }
                } else if field.is_open(cell, next) {
                    open += 1;
                } else {
                    lined += 1;
                }
            }
            at += 1;
        }
        if open as f64 > BARE * (open + lined) as f64 {
            let bare = bare.get_or_insert_with(|| vec![false; field.u.len()]);
            component.iter().for_each(|&cell| bare[cell as usize] = true);
        }
    }
    bare
}

/// Whether what is enclosed is lined by walls, so that it is a cavity that was sampled.
pub fn is_lined(field: &Field<'_>, enclosed: &[usize]) -> bool {
    let strides = field.block.strides();
    let (mut lined, mut open) = (0u64, 0u64);
    for &cell in enclosed {
        for next in strides.into_iter().flat_map(|s| [cell.wrapping_add_signed(-s), cell.wrapping_add_signed(s)]) {
            if !field.is_asked(next) || field.u[next] > 0.0 {
                if field.is_open(cell, next) { open += 1 } else { lined += 1 }
            }
        }
    }
    open as f64 <= BARE * (open + lined) as f64
}
