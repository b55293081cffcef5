//! The naive twin: it holds the whole grid, and knows neither chunks nor tiles nor blocks of slices that are read.

use std::collections::{BTreeMap, BTreeSet};

use super::core::BITS;
use super::dipole::Areas;
use super::field::LABELLINGS;
use super::layers::Held;
use super::marks::*;
use super::signs::linked;
use super::wall::{HIDDEN, Relation, SEEN, THIN};
use super::*;
use crate::grid::context::CHUNK_SLICES;
use crate::points::vector::{dot, minus};
use crate::solid::growth::ROUNDS;

/// The cells with points, and what is known of these.
pub type Points = BTreeMap<[i64; 3], Moments>;

/// A sum for each patch, the difference and all, in parts of a vote.
pub type Votes = BTreeMap<usize, (i64, i64)>;

/// Signs of hidden walls: patches by relabelling, rounds of votes over all cells.
pub fn signed(walls: &mut BTreeMap<[i64; 3], Wall>) {
    let places: Vec<Place> = walls.keys().map(|[y, z, x]| [*x, *y, *z]).collect();
    let wall_at = |cell: Place| walls.get(&key(cell)).copied();
    let chunk = |cell: Place| cell[1] / i64::from(CHUNK_SLICES);
    // Every pair once: within chunks first, then across, chunk by chunk.
    let mut links = Vec::new();
    for (number, cell) in places.iter().enumerate() {
        for other in cube(2).into_iter().map(|d| add(*cell, d)).filter(|other| key(*other) < key(*cell)) {
            let (Some(a), Some(b)) = (wall_at(*cell), wall_at(other)) else { continue };
            let d = std::array::from_fn(|i| b.at(other)[i] - a.at(*cell)[i]);
            if let Some(opposite) = linked(&a, &b, d) {
                let earlier = places.binary_search_by_key(&key(other), |p| key(*p)).unwrap();
                links.push((chunk(other) != chunk(*cell), chunk(*cell), number, earlier, opposite));
            }
        }
    }
    links.sort_by_key(|(across, chunk, ..)| (*across, *chunk));
    let mut patch: Vec<(usize, bool)> = (0..places.len()).map(|number| (number, false)).collect();
    for (_, _, a, b, opposite) in links {
        let ((a, of_a), (b, of_b)) = (patch[a], patch[b]);
        for (of, turned) in patch.iter_mut().filter(|_| a != b) {
            if *of == a {
                (*of, *turned) = (b, *turned ^ of_a ^ of_b ^ opposite);
            }
        }
    }
    for _ in 0..signs::ROUNDS {
        let mut votes = Votes::new();
        for (number, cell) in places.iter().enumerate() {
            let wall = walls[&key(*cell)];
            if wall.kind != HIDDEN || wall.sign != 0 {
                continue;
            }
            let (of, turned) = patch[number];
            let sums = votes.entry(of).or_default();
            let mut vote = |weight: f64| {
                let weight = if turned { -weight } else { weight };
                let weight = (weight * signs::QUANTA).round() as i64;
                *sums = (sums.0 + weight, sums.1 + weight.abs());
            };
            for other in cube(2).into_iter().filter(|d| *d != [0; 3]).map(|d| add(*cell, d)) {
                let Some(by) = walls.get(&key(other)) else { continue };
                let knows = (by.kind == SEEN && by.confidence > signs::VOTER) || (by.kind == HIDDEN && by.sign != 0);
                let d: [f64; 3] = std::array::from_fn(|i| by.at(other)[i] - wall.at(*cell)[i]);
                let squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                let decay = libm::exp(-squared / (2.0 * signs::DECAY * signs::DECAY));
                let weight = match Relation::of(&wall, by, d) {
                    Some(Relation::Wall(same)) => same * decay,
                    Some(Relation::Crease(same)) => signs::CREASE * same * decay,
                    Some(Relation::Facing(same)) => signs::FACING * same,
                    None => continue,
                };
                if knows {
                    vote(weight * f64::from(by.sign));
                }
            }
            vote(signs::HINT * f64::from(wall.hint));
        }
        let mut any = false;
        for (number, cell) in places.iter().enumerate() {
            let wall = walls.get_mut(&key(*cell)).unwrap();
            let (of, turned) = patch[number];
            if wall.kind != HIDDEN || wall.sign != 0 {
                continue;
            }
            let (difference, all) = votes[&of];
            let (difference, all) = (difference as f64 / signs::QUANTA, all as f64 / signs::QUANTA);
            if all > signs::ENOUGH && difference.abs() > signs::CLEAR * all {
                wall.sign = if (difference > 0.0) != turned { 1 } else { -1 };
                any = true;
            }
        }
        if !any {
            break;
        }
    }
}

/// The solid's cells that are left, and whether wide cores opened, which may make tunnels.
pub fn twin(solid: &Marks, points: &Points, side: f64, thickened: &Marks) -> (Marks, bool) {
    let block = |cell: Place| cell.map(|c| c / i64::from(BLOCK));
    let deep = |cell: Place| cube(1).into_iter().all(|d| solid.at(add(cell, d)));
    let mut counts = BTreeMap::<Place, u32>::new();
    let places = points.keys().map(|[y, z, x]| [*x, *y, *z]);
    places.clone().filter(|cell| deep(*cell)).for_each(|cell| *counts.entry(block(cell)).or_default() += 1);
    let evident: Vec<Place> = counts.into_iter().filter(|(_, count)| *count >= EVIDENCE).map(|(at, _)| at).collect();
    let near =
        |cell: Place, by: u32| evident.iter().any(|at| (0..3).all(|a| (at[a] - block(cell)[a]).abs() <= i64::from(by)));
    let active: Vec<Place> = places.filter(|cell| near(*cell, LOOKED_AT)).collect();
    if active.is_empty() {
        return (solid.clone(), false);
    }
    // Planes.
    let looked_at: BTreeSet<[i64; 3]> = active.iter().map(|cell| key(*cell)).collect();
    let of = |cell: Place| points.get(&key(cell)).filter(|_| looked_at.contains(&key(cell)));
    let mut walls = BTreeMap::new();
    for cell in &active {
        let around = |reach: i64| -> Vec<Near> {
            let near = cube(reach).into_iter().filter_map(|step| Some(Near::new(step, of(add(*cell, step))?)));
            near.collect()
        };
        let (own, wide) = (of(*cell).unwrap(), !plane::is_enough(&around(2)));
        let plane = plane::plane(own, &around(if wide { 3 } else { 2 }), wide);
        let wall = Wall { mean: own.mean, normal: plane.normal, confidence: plane.confidence, ..Wall::default() };
        walls.insert(key(*cell), wall);
    }
    let (left, wide) = pass(solid, points, &walls, side, |_| true);
    let opened = clefts(&left, &walls, thickened);
    if !opened.set.contains(&true) {
        return (left, wide);
    }
    // What clefts bare is looked at once more, in the blocks round them.
    let blocks: BTreeSet<Place> = opened.all().filter(|cell| opened.at(*cell)).map(block).collect();
    let is_near = |at: Place| blocks.iter().any(|block| (0..3).all(|a| (at[a] - block[a]).abs() <= i64::from(OPEN)));
    let (left, wide_anew) = pass(&less(&left, &opened), points, &walls, side, is_near);
    let opened = clefts(&left, &walls, thickened);
    (less(&left, &opened), wide | wide_anew)
}

/// The walls as they are seen from outside the solid: of each, the outside is looked for step by step, either way, until another wall ends the look.
fn seen(solid: &Marks, walls: &BTreeMap<[i64; 3], Wall>) -> BTreeMap<[i64; 3], Wall> {
    let seen = |at: &[i64; 3], wall: &Wall| {
        let cell = [at[2], at[0], at[1]];
        let (middle, normal) = (wall.at(cell), wall.across());
        let mut stops = [9.0f64; 2];
        for step in cube(3) {
            let Some(other) = walls.get(&key(add(cell, step))) else { continue };
            let d = minus(other.at(add(cell, step)), middle);
            let along = dot(d, normal);
            if along.abs() >= 0.8 && dot(normal, other.across()).abs() >= 0.7 && dot(d, d) - along * along <= 1.4 * 1.4
            {
                let stop = &mut stops[usize::from(along < 0.0)];
                *stop = stop.min(along.abs());
            }
        }
        let [along, against] = [(1.0, stops[0]), (-1.0, stops[1])].map(|(side, stop)| {
            for step in 3..=16 {
                let t = 0.2 * f64::from(step);
                if !solid.at([0, 1, 2].map(|a| (middle[a] + side * t * normal[a]).floor() as i64)) {
                    return t;
                }
                if t > stop {
                    break;
                }
            }
            9.0
        });
        let (nearer, side) = (along.min(against), if against > along { 1 } else { -1 });
        let is_clear = (against - along).abs() >= 1.0;
        let [kind, sign, hint] = match nearer {
            _ if nearer > 1.6 => [2, 0, if nearer <= 2.4 && is_clear { side } else { 0 }],
            _ if is_clear && wall.confidence > 0.0 => [0, side, 0],
            _ => [1, 0, 0],
        };
        Wall { kind: kind as u8, sign, hint, ..*wall }
    };
    walls.iter().map(|(at, wall)| (*at, seen(at, wall))).collect()
}

/// The cells of clefts that open.
fn clefts(solid: &Marks, walls: &BTreeMap<[i64; 3], Wall>, thickened: &Marks) -> Marks {
    let walls = seen(solid, walls);
    let none = Marks { set: vec![false; solid.set.len()], ..solid.clone() };
    let is_hidden = |cell: Place| walls.get(&key(cell)).is_some_and(|wall| wall.kind == HIDDEN);
    let mut cells = none.clone();
    for (at, _) in walls.iter().filter(|(_, wall)| wall.kind != THIN) {
        let cell = [at[2], at[0], at[1]];
        let beside = cube(1).into_iter().filter(|d| is_hidden(add(cell, *d))).count();
        let sheet = cube(1).into_iter().any(|d| thickened.at(add(cell, d)));
        cells.put(cell, (is_hidden(cell) || beside >= 3) && !sheet);
    }
    let mut target = none.clone();
    let is_deep = |cell: Place| {
        let wall = &walls[&key(cell)];
        (-20..=20).all(|quarter| {
            let along = |a: usize| f64::from(wall.mean[a]) + 0.25 * f64::from(quarter) * f64::from(wall.normal[a]);
            solid.at([0, 1, 2].map(|a| (cell[a] as f64 + along(a)).floor() as i64))
        })
    };
    for group in cells.groups() {
        let hidden: Vec<Place> = group.iter().copied().filter(|cell| is_hidden(*cell)).collect();
        let deep = hidden.iter().filter(|cell| is_deep(**cell)).count();
        if deep >= 8 && 2 * deep >= hidden.len() {
            group.iter().for_each(|cell| target.put(*cell, true));
        }
    }
    let mut opened = none;
    grow(solid, &mut opened, &target);
    opened
}

/// Opens cells of the target one by one, where that changes no topology.
fn grow(solid: &Marks, opened: &mut Marks, target: &Marks) {
    for _ in 0..ROUNDS {
        for subgrid in 0..8 {
            for [x, y, z] in solid.all() {
                let cell = [x, y, z];
                let out = |cell: Place| !solid.at(cell) || opened.at(cell);
                if (x & 1) + 2 * (z & 1) + 4 * (y & 1) != subgrid || out(cell) || !target.at(cell) {
                    continue;
                }
                if simple(|d| out(add(cell, d))) {
                    opened.put(cell, true);
                }
            }
        }
    }
}

/// What a pass with evidence in some blocks leaves of the solid before clefts open, and whether wide cores opened.
fn pass(
    solid: &Marks,
    points: &Points,
    planes: &BTreeMap<[i64; 3], Wall>,
    side: f64,
    of: impl Fn(Place) -> bool,
) -> (Marks, bool) {
    let block = |cell: Place| cell.map(|c| c / i64::from(BLOCK));
    // What is seen, signs, areas.
    let mut walls = seen(solid, planes);
    signed(&mut walls);
    let held = self::held(solid.cells, &walls);
    // From here on, hidden walls are the evidence.
    let mut counts = BTreeMap::<Place, u32>::new();
    for (at, _) in walls.iter().filter(|(_, wall)| wall.kind == HIDDEN) {
        *counts.entry(block([at[2], at[0], at[1]])).or_default() += 1;
    }
    let evident: Vec<Place> =
        counts.into_iter().filter(|(_, count)| *count >= EVIDENCE).map(|(at, _)| at).filter(|at| of(*at)).collect();
    if evident.is_empty() {
        return (solid.clone(), false);
    }
    let near =
        |cell: Place, by: u32| evident.iter().any(|at| (0..3).all(|a| (at[a] - block(cell)[a]).abs() <= i64::from(by)));
    let dipoles = walls.iter().map(|(at, wall)| {
        let cell = [at[2], at[0], at[1]];
        let none = Dipole { mean: wall.mean, area: [0.0; 3], inside: 1.0 };
        (*at, if near(cell, LOOKED_AT) { Dipole::of(wall, cell, &mut Areas::new(&held)) } else { none })
    });
    let dipoles: BTreeMap<[i64; 3], Dipole> = dipoles.collect();
    // Labels.
    let sigma = (3.0 / side).clamp(2.0, 3.0);
    let kernel = Kernel::new(sigma);
    let all_dipoles = self::held(solid.cells, &dipoles);
    let candidate = |cell: &Place| {
        let near_wall = cube(4)
            .into_iter()
            .filter(|d| d.iter().map(|c| c * c).sum::<i64>() <= 16)
            .any(|d| walls.contains_key(&key(add(*cell, d))));
        solid.at(*cell) && !points.contains_key(&key(*cell)) && near_wall && near(*cell, OPEN)
    };
    let candidates: Vec<(Place, f32)> = solid
        .all()
        .filter(candidate)
        .map(|cell| (cell, kernel.near(cell[0]..cell[0] + 1, cell[1], cell[2], &all_dipoles)[0]))
        .collect();
    let mut outside = Marks { set: vec![false; solid.set.len()], ..solid.clone() };
    let mut sure = outside.clone();
    let reach = (3.0 * sigma).ceil() as i64;
    let sum: f64 = (-reach..=reach).map(|d| libm::exp(-(d * d) as f64 / (2.0 * sigma * sigma))).sum();
    let weight = |d: i64| (libm::exp(-(d * d) as f64 / (2.0 * sigma * sigma)) / sum) as f32;
    for _ in 0..LABELLINGS {
        let share = |cell: Place| match dipoles.get(&key(cell)) {
            Some(dipole) => dipole.inside,
            None => f32::from(solid.at(cell) && !outside.at(cell)),
        };
        let blurred = |by: &dyn Fn(Place) -> f32, axis: usize| -> BTreeMap<[i64; 3], f32> {
            let mut out = BTreeMap::new();
            let margin = Marks::none(solid.cells.map(|c| (c + 2 * reach) as u32));
            for cell in margin.all().map(|cell| cell.map(|c| c - reach)) {
                let step = |d: i64| [0, 1, 2].map(|a| cell[a] + if a == axis { d } else { 0 });
                let sum = (-reach..=reach).fold(0.0, |sum, d| sum + weight(d) * by(step(d)));
                if sum != 0.0 {
                    out.insert(key(cell), sum);
                }
            }
            out
        };
        let along_x = blurred(&share, 0);
        let along_z = blurred(&|cell| along_x.get(&key(cell)).copied().unwrap_or(0.0), 2);
        let mut next = Marks { set: vec![false; solid.set.len()], ..solid.clone() };
        sure = next.clone();
        for (cell, near) in &candidates {
            let far = (-reach..=reach)
                .fold(0.0, |sum, d| sum + weight(d) * along_z.get(&key(add(*cell, [0, d, 0]))).copied().unwrap_or(0.0));
            next.put(*cell, near + far <= 0.5);
            sure.put(*cell, near + far < 0.3);
        }
        outside = next;
    }
    // The target.
    let thin = |cell: Place| {
        let kinds = cube(1).into_iter().filter_map(|d| walls.get(&key(add(cell, d))).map(|wall| wall.kind));
        let kinds: Vec<u8> = kinds.collect();
        let count = |kind: u8| kinds.iter().filter(|k| **k == kind).count();
        count(THIN) > count(HIDDEN)
    };
    let mut free = outside.clone();
    outside.all().filter(|cell| outside.at(*cell) && thin(*cell)).for_each(|cell| free.put(cell, false));
    let may_open = |cell: Place| -> Option<Place> {
        let wall = walls.get(&key(cell))?;
        let outwards = wall.normal.map(|c| f64::from(wall.sign) * f64::from(c));
        let middle = cell.map(|c| c as f64 + 0.5);
        let at = wall.at(cell);
        let inside = 0.5 + (0..3).map(|a| outwards[a] * (at[a] - middle[a])).sum::<f64>();
        let behind = [0, 1, 2].map(|a| (middle[a] - outwards[a]).floor() as i64);
        let beside = FACES.iter().any(|d| free.at(add(cell, *d)));
        let opens = wall.sign != 0 && wall.confidence >= 0.5 && beside && !thin(cell) && inside <= 0.5;
        (opens && solid.at(cell) && solid.at(behind) && !free.at(behind)).then_some(behind)
    };
    let mut target = free.clone();
    for at in walls.keys() {
        let cell = [at[2], at[0], at[1]];
        if near(cell, OPEN) && may_open(cell).is_some_and(|behind| may_open(behind).is_none()) {
            target.put(cell, true);
        }
    }
    // The core: what is wide first, which may make tunnels.
    let mut wide = core(solid, points, (&target, &sure), true);
    loop {
        let cut_off = cut_off(solid, &wide);
        let touching: Vec<Vec<Place>> =
            wide.groups().into_iter().filter(|group| cut_off.as_ref().is_some_and(|cut| beside(group, cut))).collect();
        touching.iter().flatten().for_each(|cell| wide.put(*cell, false));
        if touching.is_empty() {
            break;
        }
    }
    let any_wide = wide.set.contains(&true);
    let rest = &less(solid, &wide);
    let mut opened = core(rest, points, (&target, &sure), false);
    // Groups are put back until all that are left may stay.
    let cavities = cavities(rest);
    loop {
        let before = opened.clone();
        let changes = changes(rest, &opened);
        let change = |group: &[Place]| group.iter().map(|cell| changes[cell]).sum::<i64>();
        // Those that lower the Euler number, with the cavities that they reach.
        let lowering: Vec<Vec<Place>> = opened.groups().into_iter().filter(|group| change(group) < 0).collect();
        let mut cluster = cavities.clone();
        lowering.iter().flatten().for_each(|cell| cluster.put(*cell, true));
        for cluster in cluster.groups() {
            let of_cluster: Vec<Place> = cluster.iter().copied().filter(|cell| opened.at(*cell)).collect();
            let of_cavities: BTreeSet<Place> = cluster.iter().copied().filter(|cell| !opened.at(*cell)).collect();
            // As faces join them: all of them alone.
            let joined = euler(of_cavities.iter().copied(), |_| true);
            if change(&of_cluster) + joined.max(i64::from(!of_cavities.is_empty())) < 0 {
                of_cluster.iter().for_each(|cell| opened.put(*cell, false));
            }
        }
        put_back_what_cuts(rest, &mut opened);
        if opened.set == before.set {
            break;
        }
    }
    wide.all().filter(|cell| wide.at(*cell)).for_each(|cell| opened.put(cell, true));
    grow(solid, &mut opened, &target);
    // Rungs.
    let solid = &less(solid, &opened);
    let mut rungs = target.clone();
    rungs.all().filter(|cell| target.at(*cell) && !solid.at(*cell)).for_each(|cell| rungs.put(cell, false));
    loop {
        let before = rungs.clone();
        let changes = changes(solid, &rungs);
        for group in rungs.groups() {
            let rises = group.iter().map(|cell| changes[cell]).sum::<i64>() > 0;
            if !rises || !group.iter().any(|cell| FACES.iter().any(|d| !solid.at(add(*cell, *d)))) {
                group.iter().for_each(|cell| rungs.put(*cell, false));
            }
        }
        put_back_what_cuts(solid, &mut rungs);
        if rungs.set == before.set {
            return (less(solid, &rungs), any_wide);
        }
    }
}

/// The solid without what is opened.
fn less(solid: &Marks, opened: &Marks) -> Marks {
    let mut left = solid.clone();
    opened.all().filter(|cell| opened.at(*cell)).for_each(|cell| left.put(cell, false));
    left
}

/// Whether a group shares a face with a cell of some marks.
fn beside(group: &[Place], marks: &Marks) -> bool {
    group.iter().any(|cell| FACES.iter().any(|d| marks.at(add(*cell, *d))))
}

/// The groups of sure cells of the target in plates of 2 x 2 cells, or in cubes of 3 x 3 x 3, that reach the outside and lie deep, with what they cut off that is small or has no
/// points.
fn core(solid: &Marks, points: &Points, (target, sure): (&Marks, &Marks), wide: bool) -> Marks {
    let certain = |cell: Place| target.at(cell) && sure.at(cell);
    let open = |cell: Place| !solid.at(cell) || certain(cell);
    // Boxes of cells, as their sides.
    let boxes = if wide { vec![[3, 3, 3]] } else { vec![[1, 2, 2], [2, 1, 2], [2, 2, 1]] };
    let mut core = Marks { set: vec![false; solid.set.len()], ..solid.clone() };
    for cell in solid.all().filter(|cell| solid.at(*cell) && certain(*cell)) {
        let within = |[a, b, c]: [i64; 3]| -> Vec<Place> {
            (0..a).flat_map(|x| (0..b).flat_map(move |y| (0..c).map(move |z| [x, y, z]))).collect()
        };
        let lies_in = |sides: &[i64; 3]| {
            let cells = within(*sides);
            cells.iter().any(|back| cells.iter().all(|on| open([0, 1, 2].map(|a| cell[a] - back[a] + on[a]))))
        };
        core.put(cell, boxes.iter().any(lies_in));
    }
    let deep = |cell: Place| cube(1).into_iter().all(|d| solid.at(add(cell, d)));
    let mut opened = Marks { set: vec![false; solid.set.len()], ..solid.clone() };
    for group in core.groups() {
        let joined = group.iter().any(|cell| FACES.iter().any(|d| !solid.at(add(*cell, *d))));
        if joined && group.iter().any(|cell| deep(*cell)) {
            group.iter().for_each(|cell| opened.put(*cell, true));
        }
    }
    let before = opened.clone();
    for piece in less(solid, &opened).groups() {
        let is_sampled = piece.iter().any(|cell| points.contains_key(&key(*cell)));
        if beside(&piece, &before) && (piece.len() < BITS as usize || !is_sampled) {
            piece.iter().for_each(|cell| opened.put(*cell, true));
        }
    }
    opened
}

/// The pieces that opening cuts off from larger ones, if it makes more.
fn cut_off(solid: &Marks, opened: &Marks) -> Option<Marks> {
    let mut pieces = less(solid, opened).groups();
    pieces.retain(|piece| beside(piece, opened));
    let at_first = solid.groups().iter().filter(|piece| piece.iter().any(|cell| opened.at(*cell))).count();
    if pieces.len() <= at_first.max(1) {
        return None;
    }
    let largest = pieces.iter().map(Vec::len).max().unwrap();
    let mut cut_off = Marks { set: vec![false; solid.set.len()], ..solid.clone() };
    pieces.iter().filter(|piece| piece.len() < largest).flatten().for_each(|cell| cut_off.put(*cell, true));
    Some(cut_off)
}

/// Of what is opened, groups by which the Euler number rises do not open where they cut off pieces.
fn put_back_what_cuts(solid: &Marks, opened: &mut Marks) {
    let Some(cut_off) = cut_off(solid, opened) else { return };
    let changes = changes(solid, opened);
    for group in opened.groups() {
        if group.iter().map(|cell| changes[cell]).sum::<i64>() > 0 && beside(&group, &cut_off) {
            group.iter().for_each(|cell| opened.put(*cell, false));
        }
    }
}

/// How the Euler number of the solid changes with each cell that opens, one after the other.
pub fn changes(solid: &Marks, opened: &Marks) -> BTreeMap<Place, i64> {
    let mut changes = BTreeMap::new();
    let mut rest = solid.clone();
    for cell in opened.all().filter(|cell| opened.at(*cell)) {
        let round = || cube(1).into_iter().map(|d| add(cell, d));
        let before = euler(round(), |cell| rest.at(cell));
        rest.put(cell, false);
        changes.insert(cell, euler(round(), |cell| rest.at(cell)) - before);
    }
    changes
}

/// All slices of a grid, each cell with its value, and empty ones beside them.
pub fn held<T: Copy>(cells: Place, values: &BTreeMap<[i64; 3], T>) -> Held<T> {
    let slice = |y: i64| {
        let mut runs = Runs::default();
        for z in 0..cells[2] {
            for (at, _) in values.range([y, z, 0]..[y, z, cells[0]]) {
                runs.push_run(at[2] as u32, at[2] as u32 + 1);
            }
            runs.end_row();
        }
        (Cells::of(&runs), values.range([y, 0, 0]..[y + 1, 0, 0]).map(|(_, value)| *value).collect())
    };
    Held::of(-20, (-20..cells[1] + 20).map(slice).collect())
}
