//! Spikes, pits and what they do to χ, against counts over all cells.

mod marks;

use std::collections::BTreeMap;

use proptest::prelude::*;

use self::marks::*;
use super::*;
use crate::grid::Cell;
use crate::run::testing::with_context;
use crate::solid::growth::ROUNDS;
use crate::solid::reopen::marks::simple;

/// The cells that groups are made of, by the definition.
fn looked_for(solid: &Marks, occupied: &Marks, kind: Kind) -> Marks {
    Marks::of(solid.size(), |cell| match kind {
        Kind::Spikes => {
            let covers = |c| solid.at(plus(cell, c)) && !occupied.at(plus(cell, c));
            solid.at(cell) && !cube().any(covers)
        }
        Kind::Pits => {
            let covers = |middle: [i64; 3]| cube().all(|c| !solid.at(plus(middle, c)));
            !solid.at(cell) && !cube().any(|c| covers(plus(cell, c)))
        }
        Kind::Tubes => {
            let plate = |axis: usize| cube().filter(move |c| c[axis] == 0);
            let covers = |axis, middle: [i64; 3]| plate(axis).all(|c| !solid.at(plus(middle, c)));
            !solid.at(cell) && (0..3).all(|axis| !plate(axis).any(|c| covers(axis, plus(cell, c))))
        }
        Kind::Struts => {
            let plate = |axis: usize| cube().filter(move |c| c[axis] == 0);
            let covers = |axis, middle: [i64; 3]| plate(axis).all(|c| solid.at(plus(middle, c)));
            solid.at(cell) && (0..3).all(|axis| !plate(axis).any(|c| covers(axis, plus(cell, c))))
        }
    })
}

/// The cells that faces join, group by group.
fn groups(marks: &Marks) -> Vec<Vec<[i64; 3]>> {
    let mut left = marks.clone();
    let mut out = Vec::new();
    for first in marks.cells() {
        let (mut group, mut stack) = (Vec::new(), vec![first]);
        while let Some(cell) = stack.pop() {
            if left.at(cell) {
                left.set(cell, false);
                group.push(cell);
                stack.extend((0..6).map(|i| plus(cell, unit(i / 2, i as i64 % 2 * 2 - 1))));
            }
        }
        if !group.is_empty() {
            out.push(group);
        }
    }
    out
}

/// The groups with what they are found to be: at every corner, the first cell of a group is given what all groups change there.
fn measured(solid: &Marks, occupied: &Marks, kind: Kind) -> Vec<(Vec<[i64; 3]>, Group)> {
    let marks = looked_for(solid, occupied, kind);
    let with = Marks::of(solid.size(), |cell| solid.at(cell) || marks.at(cell));
    let without = Marks::of(solid.size(), |cell| solid.at(cell) && !marks.at(cell));
    let of = |group: Vec<[i64; 3]>| {
        let mut sum = Group { cells: group.len() as u64, ..Group::default() };
        for &cell in &group {
            for corner in corners() {
                let at = plus(plus(cell, corner), [-1; 3]);
                let around = || corners().map(|c| plus(at, c));
                if around().find(|cell| marks.at(*cell)) == Some(cell) {
                    let value = |marks: &Marks| {
                        let pattern = around().enumerate().fold(0, |p, (i, cell)| p | usize::from(marks.at(cell)) << i);
                        i64::from(CHARACTERISTIC[pattern])
                    };
                    sum.change += value(&with) - value(&without);
                }
            }
            for next in (0..6).map(|i| plus(cell, unit(i / 2, i as i64 % 2 * 2 - 1))) {
                let (sampled, bare) = (occupied.at(next), solid.at(next) && !occupied.at(next));
                sum.lining.add(&Lining::of_faces(u64::from(sampled), u64::from(bare)));
            }
        }
        (group, sum)
    };
    groups(&marks).into_iter().map(of).collect()
}

/// The handles that go when a group is filled, or taken away: at every corner, each part of it that hangs together among the eight cells there changes the surface's χ on its own.
fn handles(solid: &Marks, group: &[[i64; 3]], fills: bool) -> u64 {
    let in_group: std::collections::HashSet<_> = group.iter().copied().collect();
    let lowest: std::collections::BTreeSet<_> =
        group.iter().flat_map(|cell| corners().map(|c| plus(plus(*cell, c), [-1; 3]))).collect();
    let mut grows = 0;
    for at in lowest {
        let around: Vec<[i64; 3]> = corners().map(|c| plus(at, c)).collect();
        let here = Marks::of([2; 3], |c| in_group.contains(&plus(at, c)));
        for part in groups(&here) {
            let value = |changed: bool| {
                let holds = |cell: &[i64; 3]| {
                    let in_part = part.iter().any(|c| plus(at, *c) == *cell);
                    if in_part && changed { fills } else { solid.at(*cell) }
                };
                let pattern = around.iter().enumerate().fold(0, |p, (i, cell)| p | usize::from(holds(cell)) << i);
                i64::from(OF_SURFACE[pattern])
            };
            grows += value(true) - value(false);
        }
    }
    grows.max(0).unsigned_abs().div_ceil(8)
}

/// What [`Solid::narrow_handles`] is to count, and the boxes of the groups that have most of them.
fn narrow(solid: &Marks) -> (u64, Vec<[[u32; 3]; 2]>) {
    let nothing = Marks::of(solid.size(), |_| false);
    let (mut counts, mut most, mut widest) = (Vec::new(), 0, Vec::new());
    for (kind, fills) in [(Kind::Tubes, true), (Kind::Struts, false)] {
        let mut count = 0;
        for group in groups(&looked_for(solid, &nothing, kind)) {
            let handles = handles(solid, &group, fills);
            count += handles;
            let side = |of: fn(i64, i64) -> i64, a: usize| group.iter().map(|cell| cell[a]).reduce(of).unwrap() as u32;
            let cells = [[0, 1, 2].map(|a| side(i64::min, a)), [0, 1, 2].map(|a| side(i64::max, a) + 1)];
            if handles > most {
                (most, widest) = (handles, Vec::new());
            }
            if handles == most && most > 0 {
                widest.push(cells);
            }
        }
        counts.push(count);
    }
    let count = counts[0].max(counts[1]).min(handles_of(solid));
    (count, if count > 0 { widest } else { Vec::new() })
}

/// Handles of the surface: pieces less χ. Each part of what is not solid that does not reach the end of the grid is a piece.
fn handles_of(solid: &Marks) -> u64 {
    let is_at_end = |cell: &[i64; 3]| (0..3).any(|a| cell[a] == 0 || cell[a] + 1 == solid.cells[a]);
    let outside = groups(&Marks::of(solid.size(), |cell| !solid.at(cell)));
    let cavities = outside.iter().filter(|group| !group.iter().any(is_at_end)).count();
    (groups(solid).len() as i64 + cavities as i64 - solid.characteristic_of_surface()).max(0) as u64
}

/// What [`Solid::with_nets_filled`] is to make of the cells.
fn with_nets_filled(solid: &Marks) -> Marks {
    let nothing = Marks::of(solid.size(), |_| false);
    let mut blocks = Vec::new();
    for (kind, fills, least) in [(Kind::Tubes, true, 3), (Kind::Struts, false, 1)] {
        let nets = groups(&looked_for(solid, &nothing, kind)).into_iter();
        let nets = nets.filter(|group| handles(solid, group, fills) >= least);
        blocks.extend(nets.flatten().map(|cell| cell.map(|c| c / 8)));
    }
    let pits = looked_for(solid, &nothing, Kind::Pits);
    Marks::of(solid.size(), |cell| {
        let is_near = |block: &[i64; 3]| (0..3).all(|a| (cell[a] / 8 - block[a]).abs() <= 1);
        solid.at(cell) || pits.at(cell) && blocks.iter().any(is_near)
    })
}

fn found_with_nets_filled(solid: &Marks) -> Marks {
    with_context(solid.size(), |context| {
        let occupancy = Marks::of(solid.size(), |_| false).occupancy(context);
        let cells = solid.solid(context);
        Marks::of_solid(&cells.with_nets_filled(&occupancy, context).unwrap().unwrap_or(cells))
    })
}

fn found_narrow(solid: &Marks) -> NarrowHandles {
    with_context(solid.size(), |context| {
        let occupancy = Marks::of(solid.size(), |_| false).occupancy(context);
        solid.solid(context).narrow_handles(&occupancy, context).unwrap()
    })
}

/// What [`Solid::without_unresolved`] is to make of the cells.
fn resolved(solid: &Marks, occupied: &Marks) -> Marks {
    let mut solid = solid.clone();
    for kind in Kind::UNBELIEVED {
        let (found, mut changed) = (measured(&solid, occupied, kind), Vec::new());
        for (group, measure) in found {
            if measure.verdict(kind) == CHANGES {
                group.iter().for_each(|cell| solid.set(*cell, kind.change() == Change::Filled));
                changed.extend(group);
            }
        }
        if kind.change() == Change::Removed {
            grow(&mut solid, &changed);
        }
    }
    solid
}

/// The solid grows in these cells, one by one, where that changes no topology.
fn grow(solid: &mut Marks, target: &[[i64; 3]]) {
    for _ in 0..ROUNDS {
        for subgrid in 0..8 {
            for &[x, y, z] in target {
                let is_its_turn = (x & 1) + 2 * (z & 1) + 4 * (y & 1) == subgrid;
                if is_its_turn && !solid.at([x, y, z]) && simple(|d| !solid.at(plus([x, y, z], d))) {
                    solid.set([x, y, z], true);
                }
            }
        }
    }
}

fn found(solid: &Marks, occupied: &Marks) -> Marks {
    with_context(solid.size(), |context| {
        let resolved = solid.solid(context).without_unresolved(&occupied.occupancy(context), context).unwrap();
        let marks = Marks::of_solid(&resolved);
        assert_eq!(resolved.volume, marks.cells().len() as u64);
        marks
    })
}

fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed | 1;
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as f64 / f64::from(1u32 << 31)
    }
}

/// A box whose outer cells are occupied, with noise on it and dents in it, at places that stand apart.
fn noisy(seed: u64, share: f64) -> [Marks; 2] {
    let mut number = numbers(seed);
    let cells = [25, 20, 19];
    let depth = |cell: [i64; 3]| (0..3).map(|a| (cell[a] - 4).min(cells[a] as i64 - 5 - cell[a])).min().unwrap();
    let mut solid = Marks::of(cells, |cell| depth(cell) >= 0);
    let mut occupied = Marks::of(cells, |cell| depth(cell) == 0);
    for cell in places(cells.map(i64::from)) {
        let patch = cell.iter().all(|c| (c - 5).rem_euclid(6) < 3);
        if patch && (-3..2).contains(&depth(cell)) && number() < share {
            let on = depth(cell) < 0;
            solid.set(cell, on);
            occupied.set(cell, on && number() < 0.9);
        }
    }
    [solid, occupied]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_sum_over_cells_is_that_of_the_surface(seed in any::<u64>(), share in 0.0f64..1.0) {
        let mut number = numbers(seed);
        let marks = Marks::of([7, 6, 8], |_| number() < share);
        // Two cells that are not solid and share a corner only are joined for the sum, and kept apart by the surface: a handle more.
        let joined = places([9, 8, 10]).map(|c| plus(c, [-2; 3])).filter(|at| {
            let empty: Vec<[i64; 3]> = corners().filter(|c| !marks.at(plus(*at, *c))).collect();
            empty.len() == 2 && (0..3).all(|a| empty[0][a] != empty[1][a])
        });
        let joined = joined.count() as i64;
        prop_assert_eq!(marks.characteristic(), marks.characteristic_of_surface() - joined);
        let pattern = |at| corners().enumerate().fold(0, |p, (i, c)| p | usize::from(marks.at(plus(at, c))) << i);
        let sum: i32 = places([9, 8, 10]).map(|c| OF_SURFACE[pattern(plus(c, [-2; 3]))]).sum();
        prop_assert_eq!(i64::from(sum), 8 * marks.characteristic_of_surface());
    }

    #[test]
    #[ignore = "exhaustive"]
    fn groups_are_those_of_the_definition(seed in any::<u64>(), share in 0.0f64..0.7) {
        let [solid, occupied] = noisy(seed, share);
        for kind in Kind::UNBELIEVED.into_iter().chain([Kind::Struts]) {
            let mut found = Vec::new();
            with_context(solid.size(), |context| {
                let (cells, samples) = (solid.solid(context), occupied.occupancy(context));
                let mut labeller = Labeller::new(context);
                for slices in chunks(cells.cells[1]) {
                    let seen = Seen::new(&cells, &samples, kind, slices.end);
                    labeller.add(seen.groups(slices, Group::of).unwrap()).unwrap();
                }
                labeller.finish().unwrap().for_each(|group: &Group| found.push(*group)).unwrap();
            });
            let expected = measured(&solid, &occupied, kind);
            // The lining of solid cells is not asked for.
            let key = |g: &Group| (g.cells, g.change, kind.change() == Change::Filled && g.lining.is_sampled());
            let mut keys = [found.iter().map(key).collect::<Vec<_>>(), expected.iter().map(|(_, g)| key(g)).collect()];
            keys.iter_mut().for_each(|keys| keys.sort_unstable());
            prop_assert_eq!(&keys[0], &keys[1]);
            // Groups that touch no other one change χ by as much; some are enough, as all cells are counted for each.
            let owners: BTreeMap<[i64; 3], usize> =
                (0..).zip(&expected).flat_map(|(i, (group, _))| group.iter().map(move |cell| (*cell, i))).collect();
            let touches_another = |i: usize| {
                let round = |cell: [i64; 3]| places([3; 3]).map(move |d| plus(cell, d.map(|c| c - 1)));
                let mut near = expected[i].0.iter().copied().flat_map(round);
                near.any(|cell| owners.get(&cell).is_some_and(|owner| *owner != i))
            };
            for i in (0..expected.len()).filter(|i| !touches_another(*i)).take(12) {
                let (group, measure) = &expected[i];
                let changed = |mark: bool| {
                    let mut marks = solid.clone();
                    group.iter().for_each(|cell| marks.set(*cell, mark));
                    marks.characteristic()
                };
                prop_assert_eq!(measure.change, 8 * (changed(true) - changed(false)));
            }
        }
    }

    #[test]
    fn the_solid_is_that_of_the_definition(seed in any::<u64>(), share in 0.0f64..0.7) {
        let [solid, occupied] = noisy(seed, share);
        prop_assert_eq!(found(&solid, &occupied), resolved(&solid, &occupied));
    }

    /// An ear a cell thick with a hole in it stays, but for a cut from the hole to the rim.
    #[test]
    fn an_ear_with_a_hole_stays(hole in (1i64..6, 1i64..4), order in Just([0usize, 1, 2]).prop_shuffle()) {
        let cells = order.map(|a| [12u32, 18, 12][a]);
        let back = |cell: [i64; 3]| [0, 1, 2].map(|a| cell[order.iter().position(|o| *o == a).unwrap()]);
        let within = |[x, y, z]: [i64; 3], low: i64, high: i64| [x, y, z].iter().all(|c| (low..high).contains(c));
        let ear = |[x, y, z]: [i64; 3]| (3..10).contains(&x) && (11..16).contains(&y) && z == 6;
        let is_hole = |[x, y, _]: [i64; 3]| (x, y) == (3 + hole.0, 11 + hole.1);
        let solid = Marks::of(cells, |cell| within(back(cell), 1, 11) || ear(back(cell)) && !is_hole(back(cell)));
        let occupied = Marks::of(cells, |cell| solid.at(cell) && !within(back(cell), 2, 10));
        let left = found(&solid, &occupied);
        let lost = solid.cells().len() - left.cells().len();
        prop_assert!((1..5).contains(&lost), "{lost}");
        prop_assert_eq!((solid.characteristic(), left.characteristic()), (0, 1));
    }

    #[test]
    fn narrow_handles_are_those_of_the_definition(seed in any::<u64>(), share in 0.0f64..0.7) {
        let [solid, _] = noisy(seed, share);
        let (count, widest) = narrow(&solid);
        let found = found_narrow(&solid);
        prop_assert_eq!(found.count, count);
        prop_assert_eq!(found.widest.is_some(), count > 0);
        prop_assert!(found.widest.is_none_or(|cells| widest.contains(&cells)));
    }

    /// A rod of one cell that leads to nothing but a knob makes no handle; with another one, both make a handle.
    #[test]
    fn what_hangs_on_by_a_rod_makes_no_handle(rods in 1i64..3, order in Just([0usize, 1, 2]).prop_shuffle()) {
        let cells = order.map(|a| [24u32, 14, 14][a]);
        let solid = Marks::of(cells, |cell| {
            let [x, y, z] = [0, 1, 2].map(|a| cell[order.iter().position(|o| *o == a).unwrap()]);
            let within = (2..12).contains(&y) && (2..12).contains(&z);
            let rod = (0..rods).any(|rod| [y, z] == [4 + 5 * rod, 6]);
            within && ((2..8).contains(&x) || (14..20).contains(&x) || rod && (8..14).contains(&x))
        });
        prop_assert_eq!(found_narrow(&solid).count, rods as u64 - 1);
        prop_assert_eq!(found_narrow(&solid).widest.is_some(), rods > 1);
    }

    #[test]
    fn nets_are_filled_by_the_definition(seed in any::<u64>(), share in 0.0f64..0.7) {
        let [solid, _] = noisy(seed, share);
        prop_assert_eq!(found_with_nets_filled(&solid), with_nets_filled(&solid));
    }

    /// A block with a slot two cells wide from end to end, which rungs cross: filled whole, as all of it is near. A bore as wide is no net, and stays.
    #[test]
    fn a_slot_that_rungs_cross_is_filled(
        rungs in prop::collection::btree_set((0i64..4, 0i64..4), 0..8),
        order in Just([0usize, 1, 2]).prop_shuffle(),
    ) {
        let back = |cell: [i64; 3]| [0, 1, 2].map(|a| cell[order.iter().position(|o| *o == a).unwrap()]);
        let cells = order.map(|a| [48u32, 14, 24][a]);
        let in_slot = |[x, y, z]: [i64; 3]| (2..16).contains(&x) && (7..9).contains(&y) && z >= 8;
        let in_bore = |[x, y, _]: [i64; 3]| (42..44).contains(&x) && (7..9).contains(&y);
        let solid = Marks::of(cells, |cell| {
            let [x, y, z] = back(cell);
            let block = (2..46).contains(&x) && (2..12).contains(&y) && (2..22).contains(&z);
            let crossed = |(i, j): &(i64, i64)| (4 + 3 * i == x) && (10 + 3 * j == z);
            block && !in_bore([x, y, z]) && (!in_slot([x, y, z]) || rungs.iter().any(crossed))
        });
        let filled = found_with_nets_filled(&solid);
        for cell in places(solid.cells) {
            let of_slot = in_slot(back(cell)) && (2..22).contains(&back(cell)[2]);
            prop_assert_eq!(filled.at(cell), solid.at(cell) || of_slot && !rungs.is_empty(), "{:?}", back(cell));
        }
        prop_assert_eq!(filled.characteristic(), if rungs.is_empty() { solid.characteristic() } else { 0 });
    }

    /// A block with a hole through it and an arch on it, whose beam is a rod in its middle: a handle each, which is believed if it is three cells wide.
    #[test]
    fn a_handle_is_narrow_if_it_is_two_cells_wide(
        hole in (1i64..6, 1i64..6),
        rod in (1i64..6, 1i64..6),
        order in Just([0usize, 1, 2]).prop_shuffle(),
    ) {
        let back = |cell: [i64; 3]| [0, 1, 2].map(|a| cell[order.iter().position(|o| *o == a).unwrap()]);
        let cells = order.map(|a| [26u32, 14, 24][a]);
        let solid = Marks::of(cells, |cell| {
            let [x, y, z] = back(cell);
            let block = (2..24).contains(&x) && (2..12).contains(&y) && (2..12).contains(&z);
            let through = (10..10 + hole.0).contains(&x) && (4..4 + hole.1).contains(&y);
            let arch = (4..22).contains(&x) && (4..9).contains(&y) && (12..21).contains(&z);
            let below = (9..17).contains(&x) && z < 16;
            let beside = (12..15).contains(&x) && !((4..4 + rod.0).contains(&y) && (16..16 + rod.1).contains(&z));
            block && !through || arch && !below && !beside
        });
        let narrow = |(a, b): (i64, i64)| u64::from(a < 3 && b < 3);
        prop_assert_eq!(solid.characteristic(), -1);
        prop_assert_eq!(found_narrow(&solid).count, narrow(hole).max(narrow(rod)));
    }

    /// Cubes of 3 x 3 x 3 cells: nothing in them is finer than what is seen, whatever handles they make.
    #[test]
    fn a_solid_without_spikes_and_pits_stays(seed in any::<u64>(), share in 0.2f64..0.8) {
        let mut number = numbers(seed);
        let coarse = Marks::of([6, 7, 5], |_| number() < share);
        let solid = Marks::of([18, 21, 15], |cell| coarse.at(cell.map(|c| c / 3)));
        let occupied = Marks::of(solid.size(), |cell| solid.at(cell) && cell.iter().all(|c| c % 3 == 1) && number() < 0.5);
        for kind in Kind::UNBELIEVED {
            // A cube that stands alone and has its middle occupied has others round it that are not.
            prop_assert_eq!(looked_for(&solid, &occupied, kind).cells(), Vec::<[i64; 3]>::new());
        }
        prop_assert_eq!(found(&solid, &occupied), solid);
    }

    #[test]
    fn an_arch_of_samples_on_a_body_is_taken_away(
        at in [0i64..8, 0i64..4],
        length in 3i64..7,
        height in 2i64..5,
        order in Just([0usize, 1, 2]).prop_shuffle(),
    ) {
        let turned = |cell: [i64; 3]| order.map(|a| cell[a]);
        let cells = turned([18, 14, 20]).map(|c| c as u32);
        let back = |cell: [i64; 3]| [0, 1, 2].map(|a| cell[order.iter().position(|o| *o == a).unwrap()]);
        let within = |[x, y, z]: [i64; 3]| (2..16).contains(&x) && (2..12).contains(&y) && (2..12).contains(&z);
        let body = Marks::of(cells, |cell| within(back(cell)));
        let arch = Marks::of(cells, |cell| {
            let [x, y, z] = back(cell);
            let (along, up) = (x - 2 - at[0], z - 11);
            y == 4 + at[1] && (0..length).contains(&along) && (1..=height).contains(&up)
                && (along == 0 || along == length - 1 || up == height)
        });
        let surface = Marks::of(cells, |cell| body.at(cell) && cube().any(|c| !body.at(plus(cell, c))));
        let solid = Marks::of(cells, |cell| body.at(cell) || arch.at(cell));
        let occupied = Marks::of(cells, |cell| surface.at(cell) || arch.at(cell));
        prop_assert_eq!([body.characteristic(), solid.characteristic()], [1, 0]);
        prop_assert_eq!(found(&solid, &occupied).characteristic(), 1);
    }

    #[test]
    fn a_pin_hole_through_a_plate_is_filled(
        at in [1i64..10, 1i64..8],
        wide in 1i64..3,
        thick in 1i64..5,
        order in Just([0usize, 1, 2]).prop_shuffle(),
        sampled in any::<bool>(),
    ) {
        let back = |cell: [i64; 3]| [0, 1, 2].map(|a| cell[order.iter().position(|o| *o == a).unwrap()]);
        let cells = order.map(|a| [18u32, 14, 10][a]);
        let within = |[x, y, z]: [i64; 3]| (2..16).contains(&x) && (2..12).contains(&y) && (2..2 + thick).contains(&z);
        let in_hole = |[x, y, _]: [i64; 3]| (0..wide).contains(&(x - 2 - at[0])) && y == 3 + at[1];
        let plate = Marks::of(cells, |cell| within(back(cell)));
        let solid = Marks::of(cells, |cell| within(back(cell)) && !in_hole(back(cell)));
        let occupied = Marks::of(cells, |cell| solid.at(cell) && sampled);
        prop_assert_eq!([plate.characteristic(), solid.characteristic()], [1, 0]);
        prop_assert_eq!(found(&solid, &occupied), plate);
    }
}
