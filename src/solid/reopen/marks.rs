//! Marks on the cells of a box, and their topology, cell by cell.

use std::collections::BTreeSet;

use super::*;

pub type Place = [i64; 3];

/// A cell's key in the order of slices, rows, x.
pub fn key([x, y, z]: Place) -> [i64; 3] {
    [y, z, x]
}

pub fn add(a: Place, b: Place) -> Place {
    [0, 1, 2].map(|i| a[i] + b[i])
}

/// All steps of up to so many cells along each axis, by slice, row and x.
pub fn cube(reach: i64) -> Vec<Place> {
    let side = 2 * reach + 1;
    (0..side.pow(3)).map(|i| [i % side - reach, i / side / side - reach, i / side % side - reach]).collect()
}

pub const FACES: [Place; 6] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];

/// Cells of a box.
#[derive(Clone)]
pub struct Marks {
    pub cells: Place,
    pub set: Vec<bool>,
}

impl Marks {
    pub fn none(cells: Cell) -> Marks {
        let cells = cells.map(i64::from);
        Marks { cells, set: vec![false; cells.iter().product::<i64>() as usize] }
    }

    /// Those that `holds` says.
    pub fn of(cells: Cell, holds: impl Fn(Place) -> bool) -> Marks {
        let mut marks = Marks::none(cells);
        marks.all().filter(|cell| holds(*cell)).for_each(|cell| marks.put(cell, true));
        marks
    }

    /// The solid's.
    pub fn of_solid(solid: &Solid) -> Marks {
        let mut marks = Marks::none(solid.cells);
        let mut bits = Bits::new(solid.cells[0], solid.cells[2]);
        for y in 0..marks.cells[1] {
            solid.store.paint(y, &mut bits, &mut Runs::default()).unwrap();
            for z in 0..marks.cells[2] {
                (0..marks.cells[0]).for_each(|x| marks.put([x, y, z], bits.get(x, z)));
            }
        }
        marks
    }

    /// They as a store.
    pub fn store(&self, context: &Context) -> SliceStore {
        let cells = self.cells.map(|c| c as u32);
        let mut slices = Slices::default();
        for y in 0..self.cells[1] {
            let mut slice = Bits::new(cells[0], cells[2]);
            for z in 0..self.cells[2] {
                (0..self.cells[0]).filter(|x| self.at([*x, y, z])).for_each(|x| slice.set(x as u32, z as u32));
            }
            slices.push(&slice);
        }
        let mut store = SliceStore::new(&context.workspace, 1 << 20);
        store.extend(&slices).unwrap();
        store
    }

    fn number(&self, cell: Place) -> Option<usize> {
        let [x, y, z] = cell;
        let within = (0..3).all(|a| (0..self.cells[a]).contains(&cell[a]));
        within.then(|| ((y * self.cells[2] + z) * self.cells[0] + x) as usize)
    }

    pub fn at(&self, cell: Place) -> bool {
        self.number(cell).is_some_and(|number| self.set[number])
    }

    pub fn put(&mut self, cell: Place, set: bool) {
        if let Some(number) = self.number(cell) {
            self.set[number] = set;
        }
    }

    /// All cells, by slice, row and x.
    pub fn all(&self) -> impl Iterator<Item = Place> + use<> {
        let [width, slices, rows] = self.cells;
        (0..slices).flat_map(move |y| (0..rows).flat_map(move |z| (0..width).map(move |x| [x, y, z])))
    }

    /// Those that are set, in groups joined by faces.
    pub fn groups(&self) -> Vec<Vec<Place>> {
        let mut left = self.clone();
        let mut groups = Vec::new();
        for seed in self.all() {
            if !left.at(seed) {
                continue;
            }
            left.put(seed, false);
            let mut group = vec![seed];
            let mut next = 0;
            while next < group.len() {
                for cell in FACES.map(|d| add(group[next], d)) {
                    if left.at(cell) {
                        left.put(cell, false);
                        group.push(cell);
                    }
                }
                next += 1;
            }
            groups.push(group);
        }
        groups
    }
}

/// Whether a cell may open without a change of topology; `out` tells which cells round it are outside.
pub fn simple(out: impl Fn(Place) -> bool) -> bool {
    let squared = |d: Place| d.iter().map(|c| c * c).sum::<i64>();
    let ends_meet = |within: &dyn Fn(Place) -> bool, end: i64, by: i64| {
        let cells: Vec<Place> = cube(1).into_iter().filter(|d| *d != [0; 3] && within(*d)).collect();
        // Those that three steps lead to; the first one is to a face or, of the outside, an edge.
        let mut far: Vec<Place> = cells.iter().copied().filter(|d| squared(*d) <= end).collect();
        for _ in 0..2 {
            let near = |to: &Place| far.iter().any(|from| squared([0, 1, 2].map(|a| from[a] - to[a])) <= by);
            far = cells.iter().copied().filter(near).collect();
        }
        let cells = far;
        let Some(first) = cells.iter().find(|d| squared(**d) <= end) else { return false };
        let mut reached = vec![*first];
        let mut next = 0;
        while next < reached.len() {
            let from = reached[next];
            let near = |to: &Place| squared([0, 1, 2].map(|a| from[a] - to[a])) <= by;
            let more: Vec<Place> = cells.iter().copied().filter(|to| near(to) && !reached.contains(to)).collect();
            reached.extend(more);
            next += 1;
        }
        cells.iter().all(|d| squared(*d) > end || reached.contains(d))
    };
    let faces = FACES.iter().filter(|d| out(**d)).count();
    (1..6).contains(&faces) && ends_meet(&out, 2, 2) && ends_meet(&|d| !out(d), 1, 1)
}

/// The Euler number of the cells among `places` that are `solid`.
pub fn euler(places: impl Iterator<Item = Place>, solid: impl Fn(Place) -> bool) -> i64 {
    let places: BTreeSet<Place> = places.collect();
    let mut number = 0;
    for low in &places {
        // Boxes of up to 2 x 2 x 2 cells from this one on.
        for size in 0..8 {
            let steps = |bit: i64| {
                (0..8).filter(move |step| step & !bit == 0).map(|step| [step & 1, step >> 1 & 1, step >> 2 & 1])
            };
            let cells: Vec<Place> = steps(size).map(|d| add(*low, d)).collect();
            if cells.iter().all(|cell| places.contains(cell)) {
                let axes = i64::from(i64::count_ones(size));
                let all = cells.iter().all(|cell| solid(*cell));
                number += if all { 1 - 2 * (axes & 1) } else { 0 };
                let out: Vec<Place> = cells.iter().copied().filter(|cell| !solid(*cell)).collect();
                let opposite = |a: Place, b: Place| (0..3).all(|i| a[i] != b[i]);
                number += i64::from(axes == 3 && out.len() == 2 && opposite(out[0], out[1]));
            }
        }
    }
    number
}

/// What the solid encloses.
pub fn cavities(solid: &Marks) -> Marks {
    let mut outside = solid.clone();
    outside.set.iter_mut().for_each(|set| *set = !*set);
    let mut out = Marks { set: vec![false; solid.set.len()], ..solid.clone() };
    for group in outside.groups() {
        if group.iter().all(|cell| (0..3).all(|a| cell[a] > 0 && cell[a] + 1 < solid.cells[a])) {
            group.iter().for_each(|cell| out.put(*cell, true));
        }
    }
    out
}
