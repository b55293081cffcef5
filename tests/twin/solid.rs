//! Occupied, dilated, exterior and solid cells as dense arrays.

use std::collections::{BTreeMap, VecDeque};

use super::grid::cell_of;
use super::{Keep, Params};

/// A yes or no for every cell of the box, padded by `pad` cells on every side.
///
/// ```text
/// index of cell (x, y, z), each from −pad to cells + pad − 1:
///     (x + pad) + size_x · ((z + pad) + size_z · (y + pad)),   size_a = cells_a + 2 · pad
/// ```
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Cells {
    /// Cells of the box along the grid's axes, without the padding.
    pub cells: [u32; 3],
    /// Width of the padding.
    pub pad: i32,
    /// One entry per cell of the padded box.
    pub is: Vec<bool>,
}

impl Cells {
    /// All cells `false`.
    pub fn none(cells: [u32; 3], pad: i32) -> Cells {
        let count = cells.iter().map(|&c| c as usize + 2 * pad as usize).product();
        Cells { cells, pad, is: vec![false; count] }
    }

    /// The whole padded box as ranges of x, y, z.
    fn range(&self, axis: usize) -> std::ops::Range<i32> {
        -self.pad..self.cells[axis] as i32 + self.pad
    }

    /// Every cell of the padded box.
    pub fn all(&self) -> Vec<[i32; 3]> {
        let mut all = Vec::new();
        for y in self.range(1) {
            for z in self.range(2) {
                for x in self.range(0) {
                    all.push([x, y, z]);
                }
            }
        }
        all
    }

    /// Whether the cell lies in the padded box.
    pub fn contains(&self, cell: [i32; 3]) -> bool {
        (0..3).all(|a| self.range(a).contains(&cell[a]))
    }

    fn index(&self, [x, y, z]: [i32; 3]) -> usize {
        let size = |a: usize| self.cells[a] as usize + 2 * self.pad as usize;
        let at = |v: i32| (v + self.pad) as usize;
        at(x) + size(0) * (at(z) + size(2) * at(y))
    }

    /// The cell's entry; `false` beyond the padded box.
    pub fn get(&self, cell: [i32; 3]) -> bool {
        self.contains(cell) && self.is[self.index(cell)]
    }

    /// Sets the entry of a cell of the padded box.
    pub fn set(&mut self, cell: [i32; 3]) {
        let index = self.index(cell);
        self.is[index] = true;
    }
}

/// The offsets of the ball of radius `rho`.
pub fn ball(rho: u32) -> Vec<[i32; 3]> {
    ball_squared(if rho == 1 { 3 } else { (rho * rho) as i32 })
}

/// The offsets whose squared length is at most `limit`.
pub fn ball_squared(limit: i32) -> Vec<[i32; 3]> {
    let r = limit.isqrt();
    let mut offsets = Vec::new();
    for dx in -r..=r {
        for dy in -r..=r {
            for dz in -r..=r {
                if dx * dx + dy * dy + dz * dz <= limit {
                    offsets.push([dx, dy, dz]);
                }
            }
        }
    }
    offsets
}

pub fn plus(a: [i32; 3], b: [i32; 3]) -> [i32; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// The cells that hold enough points; no padding.
pub fn occupied(points: &[[f64; 3]], params: &Params) -> Cells {
    let mut counts: BTreeMap<[i32; 3], u32> = BTreeMap::new();
    for &p in points {
        *counts.entry(cell_of(p, params)).or_default() += 1;
    }
    let mut occupied = Cells::none(params.cells, 0);
    for (cell, _) in counts.into_iter().filter(|(_, count)| *count >= params.min_points) {
        occupied.set(cell);
    }
    occupied
}

/// The points that count: those of occupied cells, which must be solid if components were to be left out.
pub fn counted(points: &[[f64; 3]], solid: &Cells, params: &Params) -> Vec<[f64; 3]> {
    let occupied = occupied(points, params);
    let counts = |cell: [i32; 3]| occupied.get(cell) && (params.keep.is_none() || solid.get(cell));
    points.iter().copied().filter(|&p| counts(cell_of(p, params))).collect()
}

/// Without the components that are not to be kept.
pub fn without_small(solid: &Cells, keep: Keep) -> Cells {
    let mut components: Vec<Vec<[i32; 3]>> = Vec::new();
    let mut seen = Cells::none(solid.cells, 0);
    for start in solid.all() {
        if !solid.get(start) || seen.get(start) {
            continue;
        }
        seen.set(start);
        let mut component = vec![start];
        let mut next = 0;
        while next < component.len() {
            for step in [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]] {
                let cell = plus(component[next], step);
                if solid.get(cell) && !seen.get(cell) {
                    seen.set(cell);
                    component.push(cell);
                }
            }
            next += 1;
        }
        components.push(component);
    }
    let largest = components.iter().map(Vec::len).max().unwrap_or(0);
    let kept = |cells: usize| match keep {
        Keep::Cells(least) => cells as u64 >= least,
        Keep::Share(share) => cells as f64 >= share * largest as f64,
        Keep::Largest => cells == largest,
    };
    let mut out = Cells::none(solid.cells, 0);
    for cell in components.into_iter().filter(|c| kept(c.len())).flatten() {
        out.set(cell);
    }
    out
}

/// The cells with an occupied cell in the ball round them; padded by `rho` + 1.
pub fn dilated(occupied: &Cells, rho: u32) -> Cells {
    let mut dilated = Cells::none(occupied.cells, rho as i32 + 1);
    for cell in dilated.all() {
        if ball(rho).iter().any(|&d| occupied.get(plus(cell, d))) {
            dilated.set(cell);
        }
    }
    dilated
}

/// The free cells with a 6-connected path of free cells to the border; padded like `dilated`.
pub fn exterior(dilated: &Cells) -> Cells {
    let on_border = |cell: [i32; 3]| (0..3).any(|a| cell[a] == -dilated.pad || cell[a] == dilated.range(a).end - 1);
    let mut exterior = Cells::none(dilated.cells, dilated.pad);
    let mut queue = VecDeque::new();
    for cell in dilated.all() {
        if on_border(cell) && !dilated.get(cell) {
            exterior.set(cell);
            queue.push_back(cell);
        }
    }
    while let Some(cell) = queue.pop_front() {
        for step in [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]] {
            let next = plus(cell, step);
            if dilated.contains(next) && !dilated.get(next) && !exterior.get(next) {
                exterior.set(next);
                queue.push_back(next);
            }
        }
    }
    exterior
}

/// The occupied cells and those with no exterior cell in the ball round them; no padding.
///
/// # Panics
///
/// If a cell outside the box were solid.
pub fn closed(occupied: &Cells, exterior: &Cells, rho: u32) -> Cells {
    let mut solid = Cells::none(occupied.cells, 0);
    // One cell beyond the box is as far as balls stay in the padding, and shows that nothing outside is solid.
    let mut near = Cells::none(occupied.cells, 1);
    near.is.fill(true);
    for cell in near.all() {
        if occupied.get(cell) || !ball(rho).iter().any(|&d| exterior.get(plus(cell, d))) {
            assert!(solid.contains(cell), "{cell:?} is solid and outside the box");
            solid.set(cell);
        }
    }
    solid
}

/// Points to solid cells, all the way.
pub fn solid_cells(points: &[[f64; 3]], params: &Params) -> Cells {
    let occupied = occupied(points, params);
    let closed = if params.falls {
        super::sides::solid(&occupied, params.level, params.rho)
    } else {
        let exterior = exterior(&dilated(&occupied, params.rho));
        closed(&occupied, &exterior, params.rho)
    };
    let solid = without_lone(&closed);
    params.keep.map_or_else(|| solid.clone(), |keep| without_small(&solid, keep))
}

/// Without the cells that have no solid face neighbour but touch a solid cell that has one.
pub fn without_lone(solid: &Cells) -> Cells {
    let within = |squared: std::ops::RangeInclusive<i32>| -> Vec<[i32; 3]> {
        ball(2)
            .into_iter()
            .chain([-1, 1].iter().flat_map(|&x| [[x, -1, -1], [x, -1, 1], [x, 1, -1], [x, 1, 1]]))
            .filter(|d| d.iter().all(|c| c.abs() <= 1) && squared.contains(&d.iter().map(|c| c * c).sum()))
            .collect::<std::collections::BTreeSet<_>>()
            .into_iter()
            .collect()
    };
    let (faces, touching) = (within(1..=1), within(1..=3));
    let lone = |cell| !faces.iter().any(|&d| solid.get(plus(cell, d)));
    let mut out = Cells::none(solid.cells, 0);
    for cell in solid.all() {
        let touches = || touching.iter().map(|&d| plus(cell, d)).any(|c| solid.get(c) && !lone(c));
        if solid.get(cell) && !(lone(cell) && touches()) {
            out.set(cell);
        }
    }
    out
}
