//! What is occupied of columns, and needles: single cells high above all others near them.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

/// How far a needle's column looks round, in columns and slices.
pub const ROUND_NEEDLES: u32 = 2;

/// By how many cells more than these a needle stands above all columns that it sees.
const NEEDLE: u32 = 2;

/// What is occupied of a column, as heights above the bottom.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Extent {
    /// The lowest occupied cell; [`u32::MAX`] if none is.
    pub floor: u32,
    /// The one behind the highest.
    pub top: u32,
    /// The one behind the next occupied cell below the highest, if the cell below that is free; 0 if there is no such cell. Else the same as `top`.
    below: u32,
    /// How high the points in the floor lie above its lower side on average, in [`QUANTA`].
    floor_within: u32,
    /// The same of the highest cell; [`u32::MAX`] if that is not known, as of a column whose needle is taken off.
    top_within: u32,
}

/// Half a cell, in [`QUANTA`]: where points lie that are not known.
const MIDDLE: u32 = 1 << 19;

/// Parts of a cell that points' heights are rounded down to, so that sums are exact in any order.
pub const QUANTA: f64 = (1 << 20) as f64;

impl Extent {
    /// Of a column without points.
    pub const NOTHING: Extent = Extent { floor: u32::MAX, top: 0, below: 0, floor_within: MIDDLE, top_within: MIDDLE };

    /// Whether anything is occupied.
    pub fn is_data(self) -> bool {
        self.floor != u32::MAX
    }

    /// The mean height of the points in the floor, in cells above the bottom.
    pub fn floor_height(self) -> f64 {
        f64::from(self.floor) + f64::from(self.floor_within) / QUANTA
    }

    /// That of the points in the highest cell; NaN if it is not known.
    pub fn top_height(self) -> f64 {
        if self.top_within == u32::MAX {
            return f64::NAN;
        }
        f64::from(self.top - 1) + f64::from(self.top_within) / QUANTA
    }

    /// Sets these heights, above the lower sides of their cells and in [`QUANTA`].
    pub fn measured(&mut self, floor_within: u32, top_within: u32) {
        (self.floor_within, self.top_within) = (floor_within, top_within);
    }

    /// Adds cells, all of which lie above those that are there.
    pub fn add(&mut self, cells: Range<u32>) {
        let is_lone = self.top != cells.start && cells.len() == 1;
        self.below = if is_lone { self.top } else { cells.end };
        self.top = cells.end;
        self.floor = self.floor.min(cells.start);
    }

    /// Turns it upside down, in `cells` cells. What is seen from below has no needles.
    pub fn turn(&mut self, cells: u32) {
        if self.is_data() {
            let (floor, top) = (cells - self.top, cells - self.floor);
            *self = Extent { floor, top, below: top, ..*self };
        }
    }
}

/// The columns of lines of `width`, less [`ROUND_NEEDLES`] lines at either end, with needles taken off if there `are` any: columns whose highest cell is a single one that stands more
/// than [`NEEDLE`] cells above all others near it, of which there must be one.
pub fn without_needles(extents: &[Extent], width: usize, are: bool) -> Vec<Extent> {
    let reach = ROUND_NEEDLES as usize;
    let lines = extents.len() / width;
    let mut out = extents[reach * width..(lines - reach) * width].to_vec();
    if !are {
        return out;
    }
    for (i, extent) in out.iter_mut().enumerate().filter(|(_, extent)| extent.top > extent.below) {
        let (y, x) = (i / width, i % width);
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
        let around = (y..=y + 2 * reach).flat_map(|y| &extents[y * width..][columns.clone()]);
        // It is among them; so if it is the highest, the next counts. Else it is no needle.
        let mut tops = [0; 2];
        for top in around.map(|other| other.top) {
            if top > tops[0] {
                tops = [top, tops[0]];
            } else if top > tops[1] {
                tops[1] = top;
            }
        }
        let highest = if tops[0] == extent.top { tops[1] } else { tops[0] };
        if highest > 0 && extent.top > highest.max(extent.below) + NEEDLE {
            *extent = match extent.below {
                0 => Extent::NOTHING,
                below => Extent { top: below, below, top_within: u32::MAX, ..*extent },
            };
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A column of cells that are occupied or not.
    fn extent(cells: &[bool]) -> Extent {
        let mut out = Extent::NOTHING;
        for at in (0..cells.len()).filter(|at| cells[*at]) {
            out.add(at as u32..at as u32 + 1);
        }
        out
    }

    /// The cells without that of the needle, by the definition.
    fn twin(columns: &[Vec<bool>], width: usize, i: usize) -> Vec<bool> {
        let highest = |cells: &[bool]| cells.iter().rposition(|cell| *cell);
        let own = &columns[i];
        let Some(top) = highest(own) else { return own.clone() };
        let (y, x) = ((i / width) as i64, (i % width) as i64);
        let others = (0..columns.len()).filter(|j| {
            let (v, u) = ((j / width) as i64, (j % width) as i64);
            *j != i && (v - y).abs() <= 2 && (u - x).abs() <= 2
        });
        let mut below: Vec<usize> = others.filter_map(|j| highest(&columns[j])).collect();
        let alone = below.is_empty();
        let mut left = own.clone();
        left[top] = false;
        below.extend(highest(&left));
        if !alone && below.iter().all(|other| top > other + 2) { left } else { own.clone() }
    }

    proptest! {
        #[test]
        fn needles_are_single_cells_above_all_that_is_near(
            width in 3usize..8,
            seeds in prop::collection::vec((0usize..16, 0usize..4, prop::collection::vec(0usize..16, 0..3)), 60),
        ) {
            let column = |(ground, thick, lone): &(usize, usize, Vec<usize>)| -> Vec<bool> {
                let mut cells = vec![false; 16];
                // Low ground, mostly, and strays.
                (ground / 5..(ground / 5 + thick).min(16)).for_each(|at| cells[at] = true);
                lone.iter().for_each(|at| cells[*at] = true);
                cells
            };
            let columns: Vec<Vec<bool>> = seeds[..60 / width * width].iter().map(column).collect();
            let extents: Vec<Extent> = columns.iter().map(|cells| extent(cells)).collect();
            let found = without_needles(&extents, width, true);
            prop_assert_eq!(found.len(), extents.len() - 4 * width);
            for (number, found) in found.iter().enumerate() {
                let expected = extent(&twin(&columns, width, number + 2 * width));
                prop_assert_eq!((found.floor, found.top), (expected.floor, expected.top));
            }
            let kept = without_needles(&extents, width, false);
            prop_assert_eq!(&kept[..], &extents[2 * width..extents.len() - 2 * width]);
        }

        #[test]
        fn runs_come_to_what_their_cells_do(cells in prop::collection::vec(any::<bool>(), 1..20)) {
            let mut by_runs = Extent::NOTHING;
            let mut at = 0;
            for run in cells.chunk_by(|a, b| a == b) {
                if run[0] {
                    by_runs.add(at..at + run.len() as u32);
                }
                at += run.len() as u32;
            }
            prop_assert_eq!(by_runs, extent(&cells));
        }
    }
}
