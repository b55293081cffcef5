//! Lines of sight, against their definition; and that neither the order nor the number of points matters.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use proptest::prelude::*;

use super::super::sights::{LINES, NEAR, Sights, walk};
use super::super::{Seen, Signed};
use super::Numbers;
use crate::grid::Grid;
use crate::grid::occupancy::Occupancy;
use crate::input::{Arrays, Cloud, InputOptions};
use crate::points::bounds::Bounds;
use crate::points::seen_from::SeenFrom;
use crate::run::testing::with_context;
use crate::settings::{AxisChoice, Resolution};

/// What [`walk`] says, from the definition: the cells whose inside the line goes through.
fn passed(cell: [usize; 3], place: [f64; 3], within: &[Range<usize>; 3]) -> BTreeSet<[usize; 3]> {
    let middle = cell.map(|c| c as f64 + 0.5);
    let all = |a: usize| within[a].clone();
    let goes_through = |there: &[usize; 3]| {
        let (mut from, mut to) = (0.0f64, 1.0f64);
        for a in 0..3 {
            let part = |side: usize| (side as f64 - middle[a]) / (place[a] - middle[a]);
            if place[a] == middle[a] {
                if there[a] != cell[a] {
                    return false;
                }
                continue;
            }
            let ends = [part(there[a]), part(there[a] + 1)];
            from = from.max(ends[0].min(ends[1]));
            to = to.min(ends[0].max(ends[1]));
        }
        from < to
    };
    let is_near = |there: &[usize; 3]| (0..3).map(|a| there[a].abs_diff(cell[a]).pow(2)).sum::<usize>() <= NEAR;
    let cells = all(0).flat_map(|x| all(1).flat_map(move |y| all(2).map(move |z| [x, y, z])).collect::<Vec<_>>());
    cells.filter(|there| goes_through(there) && !is_near(there)).collect()
}

/// A place, often one that makes the line go through edges and corners of cells.
fn place() -> impl Strategy<Value = [f64; 3]> {
    let along = || prop_oneof![(-20i32..40).prop_map(|c| f64::from(c) / 2.0), -20.0..30.0];
    [along(), along(), along()]
}

proptest! {
    #[test]
    fn a_line_goes_through_the_cells_that_it_goes_through(
        cell in [0usize..9, 0..7, 0..8],
        place in place(),
    ) {
        let within = [0..9, 0..7, 0..8];
        let mut found = Vec::new();
        let all = walk(cell, place, &within, |cell| {
            found.push(cell);
            true
        });
        prop_assert!(all);
        let cells: BTreeSet<[usize; 3]> = found.iter().copied().collect();
        prop_assert_eq!(cells.len(), found.len(), "each once");
        prop_assert_eq!(cells, passed(cell, place, &within));
    }
}

/// Where points are, and the number of each one's scan.
type Scans = Vec<([f64; 3], u8)>;

/// The cells that are found empty on a level of a grid of unit cells, by their indices; and the level.
fn emptied(points: &Scans, places: &BTreeMap<i64, [f64; 3]>, bounds: &Bounds, factor: u32) -> (Seen, Grid) {
    let coordinates: Vec<[f64; 3]> = points.iter().map(|(point, _)| *point).collect();
    let scans: Vec<u8> = points.iter().map(|(_, scan)| *scan).collect();
    let mut arrays = Arrays::new((&coordinates).into());
    arrays.add("scan", (&scans).into()).unwrap();
    let options = InputOptions { seen_from: SeenFrom::Scans(Arc::new(places.clone())), ..InputOptions::default() };
    let cloud = Cloud::of_source(&arrays, &options).unwrap();
    let grid = Grid::new(points.len() as u64, bounds, Resolution::Cell(1.0), AxisChoice::Longest).unwrap();
    let cells: Vec<_> = coordinates.iter().map(|point| grid.cell_of(*point)).collect();
    let seen = with_context(grid.cells(), |context| {
        let occupancy = Occupancy::of_cells(cells, grid.cells(), context).unwrap();
        let sights = Sights::of(&cloud, &grid);
        Seen::of(&occupancy, factor, context).unwrap().with_sights(sights.as_ref(), factor, context).unwrap()
    });
    (seen, grid)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn a_cell_is_empty_if_two_lines_go_through_it(seed in any::<u64>(), factor in 1u32..3, unknown in any::<bool>()) {
        let mut numbers = Numbers::new(seed);
        let bounds = Bounds { min: [0.0; 3], max: [14.0, 11.0, 9.0] };
        let mut places: BTreeMap<i64, [f64; 3]> =
            (0..70).map(|scan| (scan, [(); 3].map(|()| numbers.between(-10.0, 24.0)))).collect();
        if unknown {
            places.remove(&1);
        }
        let scan = |numbers: &mut Numbers| if numbers.part() < 0.5 { numbers.below(3) } else { numbers.below(70) } as u8;
        // A wall, and strays.
        let mut points: Scans = (0..150)
            .map(|_| {
                let [x, y, z] = bounds.max.map(|most| numbers.between(0.0, most));
                let stray = numbers.part() < 0.1;
                ([x, y, if stray { z } else { 0.3 * z }], scan(&mut numbers))
            })
            .collect();
        let (seen, grid) = emptied(&points, &places, &bounds, factor);

        let block = &seen.block;
        let level = block.cells.map(|c| c as usize);
        let within = level.map(|c| 0..c);
        let cell_of = |point: [f64; 3]| grid.cell_of(point).map(|c| (c / factor) as usize);
        let is_occupied = |cell: &[usize; 3]| seen.occupied[block.index(*cell)];
        let sights: BTreeSet<([usize; 3], u8)> = points.iter().map(|(point, scan)| (cell_of(*point), *scan)).collect();
        let mut lines: BTreeMap<[usize; 3], u32> = BTreeMap::new();
        for (cell, scan) in sights.into_iter().filter(|(cell, _)| is_occupied(cell)) {
            let Some(place) = places.get(&i64::from(scan)) else { continue };
            // The longest side is the first, which the grid has as its slices.
            let place = grid.axis().file_axes().map(|a| place[a] / f64::from(factor));
            let cells = passed(cell, place, &within);
            if !cells.iter().any(is_occupied) {
                cells.into_iter().for_each(|cell| *lines.entry(cell).or_default() += 1);
            }
        }
        let expected: BTreeSet<[usize; 3]> =
            lines.into_iter().filter(|(_, count)| *count >= LINES).map(|(cell, _)| cell).collect();
        let cells = |seen: &Seen| -> BTreeSet<[usize; 3]> {
            (0..block.size()).filter(|&index| seen.emptied[index]).map(|index| block.cell(index)).collect()
        };
        prop_assert_eq!(cells(&seen), expected);

        // Twice as many points in another order.
        points.extend(points.clone());
        points.reverse();
        let again = emptied(&points, &places, &bounds, factor).0;
        prop_assert_eq!(cells(&again), cells(&seen));

        // What is empty is outside in the end.
        let signed = with_context(grid.cells(), |context| Signed::find(again, context).unwrap());
        for cell in cells(&seen) {
            prop_assert_eq!(signed.side(cell.map(|c| c as i64)), super::super::Side::Outside);
        }
    }
}
