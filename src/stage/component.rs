//! Components: parts of the solid that hang together by faces; small ones are left out.
//!
//! Upwards, runs are joined within their slice and to the slice below, as in [`crate::stage::exterior`]; each class of a slice knows its cells so far and
//! what it became above. A class that becomes nothing is a whole component, and its cells are the component's. Downwards, each class learns from
//! the one above whether it is kept.
//!
//! ```text
//!   slice 2     [0: 9 cells]             ended with 9 cells: kept, if the least is 9 or fewer
//!   slice 1     [0: 6 cells]  [1: 2]     0 -> 0; 1 ended with 2 cells
//!   slice 0     [0] [1]                  0 -> 0, 1 -> 0
//! ```
//!
//! Memory: the runs of two slices and their classes, whatever the number of slices and of components.

use std::str::FromStr;

use bytemuck::{Pod, Zeroable};

use crate::context::Context;
use crate::error::Result;
use crate::slice::{Run, Runs, SliceStore};
use crate::stage::labels::{Lists, find, overlaps, unite};
use crate::stage::raster::Occupancy;
use crate::stage::solid::Solid;

/// Which components are kept.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Least {
    /// Those of at least so many cells.
    Cells(u64),
    /// Those of at least this share of the largest's cells, from 0 to 1.
    Share(f64),
    /// The largest; several if they have equally many cells.
    Largest,
}

impl Least {
    /// The least number of cells, where the largest component has `largest`.
    fn cells(self, largest: u64) -> u64 {
        match self {
            Least::Cells(cells) => cells,
            Least::Share(share) => (share * largest as f64).ceil() as u64,
            Least::Largest => largest,
        }
    }
}

impl FromStr for Least {
    type Err = String;

    /// `largest`, a share such as `1%`, or a number of cells.
    fn from_str(text: &str) -> std::result::Result<Least, String> {
        let wrong =
            || format!("expected a number of cells, a share of the largest such as 1%, or `largest`, found {text:?}");
        if text == "largest" {
            return Ok(Least::Largest);
        }
        match text.strip_suffix('%') {
            Some(percent) => {
                let percent: f64 = percent.trim().parse().map_err(|_| wrong())?;
                if (0.0..=100.0).contains(&percent) { Ok(Least::Share(percent / 100.0)) } else { Err(wrong()) }
            }
            None => text.parse().map(Least::Cells).map_err(|_| wrong()),
        }
    }
}

/// What was found and left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Components {
    /// Components before.
    pub found: u64,
    /// Components left out.
    pub dropped: u64,
    /// Their cells.
    pub dropped_cells: u64,
    /// Cells of the largest.
    pub largest: u64,
}

/// What is known of a class once the slice above was joined.
#[derive(Debug, Clone, Copy, Zeroable, Pod)]
#[repr(C)]
struct Class {
    /// The component's cells in this slice and below.
    cells: u64,
    /// Its class in the slice above, or [`ENDED`].
    became: u64,
}

const ENDED: u64 = u64::MAX;

/// The solid without its small components, and the occupied cells that lie in those that are kept: points of others do not
/// count any more. The solid's counts of faces stay those before: an upper bound.
///
/// # Errors
/// [`crate::Error::Io`], [`crate::Error::Interrupted`].
pub fn keep(
    solid: Solid,
    occupancy: Occupancy,
    least: Least,
    context: &Context,
) -> Result<(Solid, Occupancy, Components)> {
    let (run_classes, classes, mut components) = label(&solid, context)?;
    let least = least.cells(components.largest);

    let slices = solid.cells[1];
    let mut kept = Lists::new(&context.workspace, context.memory.store_quota);
    let (mut list, mut above) = (Vec::new(), Vec::<u8>::new());
    for y in (0..slices).rev() {
        classes.read(y, &mut list)?;
        let here: Vec<u8> = list
            .iter()
            .map(|class: &Class| match class.became {
                ENDED => {
                    let keep = class.cells >= least;
                    components.dropped += u64::from(!keep);
                    components.dropped_cells += if keep { 0 } else { class.cells };
                    u8::from(keep)
                }
                became => above[became as usize],
            })
            .collect();
        kept.append(&here)?;
        above = here;
    }
    let kept = kept.reversed();

    let mut store = SliceStore::new(&context.workspace, context.memory.store_quota);
    let mut left = Occupancy::new(occupancy.cells, context);
    let (mut runs, mut occupied, mut numbers, mut keep) = (Runs::default(), Runs::default(), Vec::new(), Vec::new());
    let mut volume = 0;
    for y in 0..slices {
        context.workers.check_cancelled()?;
        solid.store.read(y, &mut runs)?;
        occupancy.store.read(y, &mut occupied)?;
        run_classes.read(y, &mut numbers)?;
        kept.read(y, &mut keep)?;
        let (mut solid_left, mut occupied_left) = (Runs::default(), Runs::default());
        for z in 0..runs.row_count() {
            let is_kept = |i: &usize| keep[numbers[*i] as usize] != 0;
            let row: Vec<Run> = runs.row_range(z).filter(is_kept).map(|i| runs.all()[i]).collect();
            row.iter().for_each(|run| solid_left.push_run(run.start, run.end));
            // A run of occupied cells is solid as a whole, unless it is a lone cell that was left out.
            overlaps(occupied.row(z), &row, |i, _| {
                let run = occupied.row(z)[i];
                occupied_left.push_run(run.start, run.end);
            });
            solid_left.end_row();
            occupied_left.end_row();
        }
        volume += solid_left.cell_count();
        store.append(&solid_left)?;
        left.append(vec![occupied_left])?;
    }
    Ok((Solid { store, volume, ..solid }, left, components))
}

/// Of each slice: the class of every run, and what is known of the classes.
fn label(solid: &Solid, context: &Context) -> Result<(Lists<u32>, Lists<Class>, Components)> {
    let quota = context.memory.store_quota;
    let mut run_classes = Lists::new(&context.workspace, quota);
    let mut classes = Lists::new(&context.workspace, quota);
    let mut components = Components::default();
    let (mut slice, mut below) = (Runs::default(), Runs::default());
    let (mut numbers, mut known) = (Vec::<u32>::new(), Vec::<Class>::new());
    let mut parents = Vec::new();
    for y in 0..solid.cells[1] {
        context.workers.check_cancelled()?;
        solid.store.read(y, &mut slice)?;
        // Elements of the union-find: the classes below, then this slice's runs.
        let (base, runs) = (known.len() as u32, slice.all().len() as u32);
        parents.clear();
        parents.extend(0..base + runs);
        for z in 0..slice.row_count() {
            let range = slice.row_range(z);
            let number = |i: usize| base + (range.start + i) as u32;
            if z > 0 {
                let before = slice.row_range(z - 1);
                overlaps(slice.row(z), slice.row(z - 1), |i, j| {
                    unite(&mut parents, number(i), base + (before.start + j) as u32);
                });
            }
            if y > 0 {
                let start = below.row_range(z).start;
                overlaps(slice.row(z), below.row(z), |i, j| unite(&mut parents, number(i), numbers[start + j]));
            }
        }

        // Roots that have a run of this slice are its classes.
        let mut names = vec![ENDED; (base + runs) as usize];
        let mut here: Vec<Class> = Vec::new();
        numbers.clear();
        for (element, run) in (base..).zip(slice.all()) {
            let name = &mut names[find(&mut parents, element) as usize];
            if *name == ENDED {
                *name = here.len() as u64;
                here.push(Class { cells: 0, became: ENDED });
            }
            here[*name as usize].cells += u64::from(run.end - run.start);
            numbers.push(*name as u32);
        }
        for (class, element) in known.iter_mut().zip(0..) {
            class.became = names[find(&mut parents, element) as usize];
            match class.became {
                ENDED => components.add(class.cells),
                became => here[became as usize].cells += class.cells,
            }
        }
        if y > 0 {
            classes.append(&known)?;
        }
        run_classes.append(&numbers)?;
        known = here;
        std::mem::swap(&mut slice, &mut below);
    }
    known.iter().for_each(|class| components.add(class.cells));
    classes.append(&known)?;
    Ok((run_classes, classes, components))
}

impl Components {
    fn add(&mut self, cells: u64) {
        self.found += 1;
        self.largest = self.largest.max(cells);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_said_in_three_ways() {
        assert_eq!("largest".parse(), Ok(Least::Largest));
        assert_eq!("2.5%".parse(), Ok(Least::Share(0.025)));
        assert_eq!("100".parse(), Ok(Least::Cells(100)));
        for wrong in ["", "%", "101%", "-1%", "-3", "1.5", "Largest", "nan%"] {
            assert!(wrong.parse::<Least>().is_err(), "{wrong}");
        }
        let cells = [Least::Cells(7), Least::Share(0.025), Least::Share(0.0), Least::Largest].map(|l| l.cells(100));
        assert_eq!(cells, [7, 3, 0, 100]);
    }
}
