//! Marks on the cells of a box, and the characteristic of what is marked, cell by cell.

use super::*;

/// Marks on the cells of a box, nothing beyond it.
#[derive(Debug, Clone, PartialEq)]
pub struct Marks {
    pub cells: [i64; 3],
    marks: Vec<bool>,
}

impl Marks {
    pub fn of(cells: Cell, mut holds: impl FnMut([i64; 3]) -> bool) -> Marks {
        let cells = cells.map(i64::from);
        let marks = places(cells).map(&mut holds).collect();
        Marks { cells, marks }
    }

    pub fn number(&self, [x, y, z]: [i64; 3]) -> Option<usize> {
        let within = [x, y, z].iter().zip(self.cells).all(|(c, n)| (0..n).contains(c));
        within.then(|| ((y * self.cells[2] + z) * self.cells[0] + x) as usize)
    }

    pub fn at(&self, cell: [i64; 3]) -> bool {
        self.number(cell).is_some_and(|number| self.marks[number])
    }

    pub fn set(&mut self, cell: [i64; 3], mark: bool) {
        let number = self.number(cell).unwrap();
        self.marks[number] = mark;
    }

    pub fn cells(&self) -> Vec<[i64; 3]> {
        places(self.cells).zip(&self.marks).filter(|(_, mark)| **mark).map(|(cell, _)| cell).collect()
    }

    pub fn size(&self) -> Cell {
        self.cells.map(|c| c as u32)
    }

    pub fn occupancy(&self, context: &Context) -> Occupancy {
        Occupancy::of_cells(self.cells().into_iter().map(|cell| cell.map(|c| c as u32)), self.size(), context).unwrap()
    }

    pub fn solid(&self, context: &Context) -> Solid {
        let Occupancy { store, occupied, .. } = self.occupancy(context);
        // As many faces as there are cells, which nobody reads here.
        Solid { cells: self.size(), store, volume: occupied, faces: vec![0; self.cells[1] as usize], ground: None }
    }

    pub fn of_solid(solid: &Solid) -> Marks {
        let (mut bits, mut runs) = (Bits::new(solid.cells[0], solid.cells[2]), Runs::default());
        let mut marks = Marks::of(solid.cells, |_| false);
        for y in 0..i64::from(solid.cells[1]) {
            solid.store.paint(y, &mut bits, &mut runs).unwrap();
            for cell in places(marks.cells).filter(|cell| cell[1] == y) {
                marks.set(cell, bits.get(cell[0], cell[2]));
            }
        }
        marks
    }

    /// χ of the cells joined by faces: cells − pairs + squares − cubes.
    pub fn characteristic(&self) -> i64 {
        let mut sum = 0;
        for cell in self.cells() {
            for size in corners() {
                let all = corners().filter(|c| (0..3).all(|a| c[a] <= size[a])).all(|c| self.at(plus(cell, c)));
                sum += if !all {
                    0
                } else if size.iter().sum::<i64>() % 2 == 0 {
                    1
                } else {
                    -1
                };
            }
        }
        sum
    }

    /// χ from the surface: half of its corners − edges + faces, where cells that share no face are kept apart.
    pub fn characteristic_of_surface(&self) -> i64 {
        // A face is a solid cell, an axis and a direction; its corners are numbered 0 to 3.
        let faces: Vec<([i64; 3], usize, i64)> = self
            .cells()
            .into_iter()
            .flat_map(|cell| (0..3).flat_map(move |axis| [-1, 1].map(|side| (cell, axis, side))))
            .filter(|(cell, axis, side)| !self.at(plus(*cell, unit(*axis, *side))))
            .collect();
        let numbers: std::collections::HashMap<_, _> = faces.iter().enumerate().map(|(i, face)| (*face, i)).collect();
        let across = |axis: usize| [(axis + 1) % 3, (axis + 2) % 3];
        let corner = |face: ([i64; 3], usize, i64), c: usize| {
            let mut at = plus(face.0, unit(face.1, (face.2 + 1) / 2));
            let [a, b] = across(face.1);
            at[a] += (c & 1) as i64;
            at[b] += (c >> 1) as i64;
            at
        };
        let mut joined: Vec<usize> = (0..4 * faces.len()).collect();
        fn root(joined: &[usize], mut i: usize) -> usize {
            while joined[i] != i {
                i = joined[i];
            }
            i
        }
        for (i, &face) in faces.iter().enumerate() {
            let (cell, axis, side) = face;
            for edge in across(axis) {
                for direction in [-1, 1] {
                    // The face that this one meets there: of the cell that lies over the edge, of the one beside, or of the cell itself.
                    let beside = plus(cell, unit(edge, direction));
                    let over = plus(beside, unit(axis, side));
                    let next = if self.at(beside) && self.at(over) {
                        (over, edge, -direction)
                    } else if self.at(beside) {
                        (beside, axis, side)
                    } else {
                        (cell, edge, direction)
                    };
                    let j = numbers[&next];
                    for (a, b) in (0..4).flat_map(|a| (0..4).map(move |b| (a, b))) {
                        // Both corners of the edge that they share.
                        let at = corner(face, a);
                        if at[edge] == cell[edge] + (direction + 1) / 2 && at == corner(next, b) {
                            let (a, b) = (root(&joined, 4 * i + a), root(&joined, 4 * j + b));
                            joined[a] = b;
                        }
                    }
                }
            }
        }
        let corners = (0..joined.len()).filter(|&i| joined[i] == i).count() as i64;
        let faces = faces.len() as i64;
        // Every face has four edges, every edge two faces.
        (corners - 2 * faces + faces) / 2
    }
}

pub fn places(cells: [i64; 3]) -> impl Iterator<Item = [i64; 3]> {
    let [width, slices, rows] = cells;
    (0..slices).flat_map(move |y| (0..rows).flat_map(move |z| (0..width).map(move |x| [x, y, z])))
}

/// In the order of x, rows, slices.
pub fn corners() -> impl Iterator<Item = [i64; 3]> {
    (0..8).map(|i| [i & 1, i >> 2 & 1, i >> 1 & 1])
}

pub fn cube() -> impl Iterator<Item = [i64; 3]> {
    places([3; 3]).map(|c| c.map(|c| c - 1))
}

pub fn plus(a: [i64; 3], b: [i64; 3]) -> [i64; 3] {
    [0, 1, 2].map(|i| a[i] + b[i])
}

pub fn unit(axis: usize, length: i64) -> [i64; 3] {
    let mut out = [0; 3];
    out[axis] = length;
    out
}
