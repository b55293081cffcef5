//! The sheets at one corner, found from the definition: lattice faces, turns round edges, cycles.

/// A lattice vertex (i, j, k).
pub type Corner = [i32; 3];

/// A cell (x, y, z).
pub type Cell = [i32; 3];

/// The lattice face between `cell` and its predecessor along `axis`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Face {
    /// The grid axis the face is perpendicular to.
    pub axis: usize,
    /// The cell on its upper side.
    pub cell: Cell,
}

impl Face {
    /// The predecessor and the cell.
    pub fn sides(self) -> [Cell; 2] {
        let mut predecessor = self.cell;
        predecessor[self.axis] -= 1;
        [predecessor, self.cell]
    }
}

/// Two faces of a sheet that meet along one of the corner's edges.
#[derive(Debug, Clone, PartialEq)]
pub struct Turn {
    /// The axis the edge runs along.
    pub axis: usize,
    /// The corner at the edge's other end.
    pub towards: Corner,
    /// The two faces.
    pub faces: [Face; 2],
}

/// One cycle of quadrants at a corner.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    /// Its faces, by quadrant number.
    pub faces: Vec<Face>,
    /// Its turns by edge: −x +x −y +y −z +z. Of two turns round one edge, the one of the solid cell with d_b = 0 is
    /// the first.
    pub turns: Vec<Turn>,
}

/// The lattice faces that touch a corner, by quadrant number.
fn quadrants(corner: Corner) -> Vec<Face> {
    let mut quadrants = Vec::new();
    for a in 0..3 {
        let (b, c) = ((a + 1) % 3, (a + 2) % 3);
        for d_c in 0..2 {
            for d_b in 0..2 {
                let mut cell = corner;
                cell[b] += d_b - 1;
                cell[c] += d_c - 1;
                quadrants.push(Face { axis: a, cell });
            }
        }
    }
    quadrants
}

/// The solid cells round the edge from `corner` along `axis`, upwards if `step` is 1 and downwards if it is −1, if
/// they are two that meet along the edge only; the one with d_b = 0 first.
pub fn diagonal_cells(corner: Corner, axis: usize, step: i32, is_solid: &dyn Fn(Cell) -> bool) -> Option<[Cell; 2]> {
    let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
    let cell = |d_b: i32, d_c: i32| {
        let mut cell = corner;
        cell[axis] += if step > 0 { 0 } else { -1 };
        cell[b] += d_b - 1;
        cell[c] += d_c - 1;
        cell
    };
    for d_c in 0..2 {
        let (one, other) = (cell(0, d_c), cell(1, 1 - d_c));
        let between = [cell(1, d_c), cell(0, 1 - d_c)];
        if is_solid(one) && is_solid(other) && !between.into_iter().any(is_solid) {
            return Some([one, other]);
        }
    }
    None
}

/// The turns round one edge among the faces that are there.
fn turns(corner: Corner, axis: usize, step: i32, faces: &[Face], is_solid: &dyn Fn(Cell) -> bool) -> Vec<Turn> {
    let mut towards = corner;
    towards[axis] += step;
    let along = corner[axis] + if step > 0 { 0 } else { -1 };
    let at_edge: Vec<Face> = faces.iter().copied().filter(|f| f.axis != axis && f.cell[axis] == along).collect();
    let turn = |faces: Vec<Face>| Turn { axis, towards, faces: [faces[0], faces[1]] };
    match at_edge.len() {
        0 => Vec::new(),
        2 => vec![turn(at_edge)],
        4 => {
            let cells = diagonal_cells(corner, axis, step, is_solid).expect("four faces at a diagonal only");
            let of = |cell: Cell| at_edge.iter().copied().filter(|f| f.sides().contains(&cell)).collect::<Vec<_>>();
            cells.into_iter().map(|cell| turn(of(cell))).collect()
        }
        n => panic!("{n} faces at an edge"),
    }
}

/// The sheets at a corner, by their lowest quadrant.
pub fn sheets(corner: Corner, is_solid: &dyn Fn(Cell) -> bool) -> Vec<Sheet> {
    let mut faces = quadrants(corner);
    faces.retain(|face| {
        let [below, above] = face.sides();
        is_solid(below) != is_solid(above)
    });
    let mut all_turns = Vec::new();
    for axis in 0..3 {
        for step in [-1, 1] {
            all_turns.extend(turns(corner, axis, step, &faces, is_solid));
        }
    }

    let mut sheets: Vec<Sheet> = Vec::new();
    for &first in &faces {
        if sheets.iter().any(|sheet| sheet.faces.contains(&first)) {
            continue;
        }
        let mut cycle = vec![first];
        while let Some(turn) =
            all_turns.iter().find(|turn| cycle.contains(&turn.faces[0]) != cycle.contains(&turn.faces[1]))
        {
            let [one, other] = turn.faces;
            cycle.push(if cycle.contains(&one) { other } else { one });
        }
        let sheet = Sheet {
            faces: faces.iter().copied().filter(|face| cycle.contains(face)).collect(),
            turns: all_turns.iter().filter(|turn| cycle.contains(&turn.faces[0])).cloned().collect(),
        };
        assert_eq!(sheet.faces.len(), sheet.turns.len(), "a sheet is a cycle");
        sheets.push(sheet);
    }
    sheets
}
