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

/// Of each cell whose u is looked for, whether it belongs to a component of the inside that is bare.
pub fn bare(field: &Field<'_>) -> Vec<bool> {
    let strides = field.block.strides();
    let around = |cell: usize| {
        strides.into_iter().flat_map(move |s| [cell.wrapping_add_signed(-s), cell.wrapping_add_signed(s)])
    };
    let mut seen = vec![false; field.cells.len()];
    let mut bare = vec![false; field.cells.len()];
    let mut component = Vec::new();
    for first in 0..field.cells.len() {
        if field.u[first] <= 0.0 || std::mem::replace(&mut seen[first], true) {
            continue;
        }
        component.clear();
        component.push(first);
        let (mut lined, mut open) = (0u64, 0u64);
        let mut at = 0;
        while at < component.len() {
            let cell = field.cells[component[at]] as usize;
            for next in around(cell) {
                match field.number(next) {
                    Some(number) if field.u[number] > 0.0 => {
                        if !std::mem::replace(&mut seen[number], true) {
                            component.push(number);
                        }
                    }
                    _ if field.is_open(cell, next) => open += 1,
                    _ => lined += 1,
                }
            }
            at += 1;
        }
        if open as f64 > BARE * (open + lined) as f64 {
            component.iter().for_each(|&number| bare[number] = true);
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
            if field.number(next).is_none_or(|number| field.u[number] > 0.0) {
                if field.is_open(cell, next) { open += 1 } else { lined += 1 }
            }
        }
    }
    open as f64 <= BARE * (open + lined) as f64
}
