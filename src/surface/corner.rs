//! The 256 cases of the eight cells round a corner: sheets, neighbours, displacement. Derived, not typed.
//!
//! ```text
//!        6-------7        cell (dx, dy, dz) is bit dx + 2 dy + 4 dz of the mask; set = solid
//!       /|      /|        quadrant 4 a + d_b + 2 d_c: the quarter, touching the corner, of the face perpendicular to
//!      4-------5 |        axis a at (d_b, d_c), b = a + 1, c = a + 2 (mod 3); there if cells d_a = 0 and d_a = 1 differ
//!   z  | 2-----|-3        edge 2 m + s: the lattice edge along axis m, towards + if s = 1
//!      |/ y    |/
//!      0-------1  x
//! ```
//!
//! Each quadrant has two edges; at an edge, the quadrants there are paired. Pairs join quadrants into cycles, the sheets. Where four
//! quadrants meet at an edge (two solid cells touch along it only), the two of one solid cell are a pair: solid cells that
//! share no face are kept apart, at both ends of the edge alike.

/// One of the up to four sheets of a corner's surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sheet {
    /// Length of the cycle: the number of neighbours, and of quadrants.
    pub neighbours: u8,
    /// Sum of the unit vectors towards the neighbours.
    pub sum: [i8; 3],
}

/// What the eight cells round a corner say about the surface there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Corner {
    /// Number of sheets, 0 to 4.
    pub sheets: u8,
    /// The sheet of each quadrant, or [`NO_SHEET`].
    pub sheet_of: [u8; 12],
    /// The sheets; those from `sheets` on are empty.
    pub sheet: [Sheet; 4],
    /// Edges (bit 2 m + s) at which both pairs belong to one sheet.
    pub doubled: u8,
}

/// The entry of [`Corner::sheet_of`] for a quadrant that is not there.
pub const NO_SHEET: u8 = u8::MAX;

/// All cases, by mask.
pub static CORNERS: [Corner; 256] = corners();

const _: () = assert!(every_case_closes());

/// The quadrant of the face perpendicular to `a` at (d_b, d_c).
#[inline]
pub const fn quadrant(a: usize, d_b: usize, d_c: usize) -> usize {
    4 * a + d_b + 2 * d_c
}

/// The mask bit of the cell with coordinate d_m along axis m, d_b and d_c along the next two.
const fn bit(m: usize, d_m: usize, d_b: usize, d_c: usize) -> usize {
    (d_m << m) + (d_b << ((m + 1) % 3)) + (d_c << ((m + 2) % 3))
}

/// The cells round edge (m, s), as (d_b, d_c) in the order of a walk round it; neighbours in the ring share a face.
pub const RING: [(usize, usize); 4] = [(0, 0), (1, 0), (1, 1), (0, 1)];

/// The quadrant between ring cells `i` and `i + 1` of edge (m, s).
const fn ring_quadrant(m: usize, s: usize, i: usize) -> usize {
    let (b, c) = ((m + 1) % 3, (m + 2) % 3);
    // Steps 0 and 2 of the walk go along b: that face is perpendicular to b, with next axes c, m. Steps 1 and 3 go
    // along c: perpendicular to c, with next axes m, b.
    match i {
        0 => quadrant(b, 0, s),
        1 => quadrant(c, s, 1),
        2 => quadrant(b, 1, s),
        _ => quadrant(c, s, 0),
    }
}

const fn solid(mask: usize, m: usize, s: usize, i: usize) -> bool {
    let (d_b, d_c) = RING[i % 4];
    mask >> bit(m, s, d_b, d_c) & 1 == 1
}

/// The pairs of quadrants at edge (m, s): none, one or two.
const fn pairs(mask: usize, m: usize, s: usize) -> ([(usize, usize); 2], usize) {
    let mut there = [0; 4];
    let mut count = 0;
    let mut i = 0;
    while i < 4 {
        if solid(mask, m, s, i) != solid(mask, m, s, i + 1) {
            there[count] = ring_quadrant(m, s, i);
            count += 1;
        }
        i += 1;
    }
    match count {
        0 => ([(0, 0); 2], 0),
        2 => ([(there[0], there[1]), (0, 0)], 1),
        // Four: the quadrants either side of ring cell 1 are 0 and 1, of ring cell 3 they are 2 and 3. The pair of the solid
        // cell with d_b = 0 (ring cells 0 and 3) comes first.
        _ if solid(mask, m, s, 1) => ([(there[2], there[3]), (there[0], there[1])], 2),
        _ => ([(there[3], there[0]), (there[1], there[2])], 2),
    }
}

const fn corners() -> [Corner; 256] {
    let empty =
        Corner { sheets: 0, sheet_of: [NO_SHEET; 12], sheet: [Sheet { neighbours: 0, sum: [0; 3] }; 4], doubled: 0 };
    let mut out = [empty; 256];
    let mut mask = 0;
    while mask < 256 {
        out[mask] = corner(mask, empty);
        mask += 1;
    }
    out
}

const fn corner(mask: usize, mut out: Corner) -> Corner {
    // Each present quadrant starts as its own component; a component is named by its lowest quadrant.
    let mut component = [usize::MAX; 12];
    let mut edge = 0;
    while edge < 6 {
        let (found, count) = pairs(mask, edge / 2, edge % 2);
        let mut p = 0;
        while p < count {
            let (a, b) = found[p];
            let name_a = if component[a] == usize::MAX { a } else { component[a] };
            let name_b = if component[b] == usize::MAX { b } else { component[b] };
            component[a] = name_a;
            component[b] = name_b;
            let (low, high) = if name_a < name_b { (name_a, name_b) } else { (name_b, name_a) };
            let mut q = 0;
            while q < 12 {
                if component[q] == high {
                    component[q] = low;
                }
                q += 1;
            }
            p += 1;
        }
        edge += 1;
    }
    let mut q = 0;
    while q < 12 {
        if component[q] == q {
            let mut member = q;
            while member < 12 {
                if component[member] == q {
                    out.sheet_of[member] = out.sheets;
                }
                member += 1;
            }
            out.sheets += 1;
        }
        q += 1;
    }
    let mut edge = 0;
    while edge < 6 {
        let (found, count) = pairs(mask, edge / 2, edge % 2);
        let mut p = 0;
        while p < count {
            let sheet = &mut out.sheet[out.sheet_of[found[p].0] as usize];
            sheet.neighbours += 1;
            sheet.sum[edge / 2] += if edge % 2 == 1 { 1 } else { -1 };
            p += 1;
        }
        if count == 2 && out.sheet_of[found[0].0] == out.sheet_of[found[1].0] {
            out.doubled |= 1 << edge;
        }
        edge += 1;
    }
    out
}

/// Every quadrant that is there lies in a sheet, and every sheet has as many neighbours as quadrants (it is a cycle), at least three.
const fn every_case_closes() -> bool {
    let mut mask = 0;
    while mask < 256 {
        let corner = corner_at(mask);
        let mut count = [0; 4];
        let mut q = 0;
        while q < 12 {
            let (a, d_b, d_c) = (q / 4, q % 2, q / 2 % 2);
            let there = (mask >> bit(a, 0, d_b, d_c) ^ mask >> bit(a, 1, d_b, d_c)) & 1 == 1;
            if there != (corner.sheet_of[q] != NO_SHEET) {
                return false;
            }
            if there {
                count[corner.sheet_of[q] as usize] += 1;
            }
            q += 1;
        }
        let mut s = 0;
        while s < 4 {
            if corner.sheet[s].neighbours != count[s] || ((s as u8) < corner.sheets && count[s] < 3) {
                return false;
            }
            s += 1;
        }
        mask += 1;
    }
    true
}

const fn corner_at(mask: usize) -> Corner {
    corner(
        mask,
        Corner { sheets: 0, sheet_of: [NO_SHEET; 12], sheet: [Sheet { neighbours: 0, sum: [0; 3] }; 4], doubled: 0 },
    )
}

impl Corner {
    /// Eq. 4 for one step: where a vertex of sheet `s` moves, in cells.
    #[inline]
    pub fn displacement(&self, s: usize) -> [f64; 3] {
        let Sheet { neighbours, sum } = self.sheet[s];
        sum.map(|c| f64::from(c) / (f64::from(neighbours) + 1.0))
    }
}

/// The pairs of quadrants at an edge of a corner with the given mask, as (edge, one quadrant of the pair), in the order of edges: each is a neighbour.
pub fn neighbours(mask: u8) -> impl Iterator<Item = (usize, usize)> {
    (0..6).flat_map(move |edge| {
        let (found, count) = pairs(usize::from(mask), edge / 2, edge % 2);
        (0..count).map(move |p| (edge, found[p].0))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_and_everything_have_no_surface() {
        assert_eq!(CORNERS[0].sheets, 0);
        assert_eq!(CORNERS[255].sheets, 0);
    }

    #[test]
    fn one_cell_pulls_its_corner_inwards() {
        // Cell (1, 1, 1) alone: three neighbours along +x, +y, +z.
        let corner = CORNERS[1 << 7];
        assert_eq!((corner.sheets, corner.sheet[0].neighbours), (1, 3));
        assert_eq!(corner.displacement(0), [0.25; 3]);
    }

    #[test]
    fn cells_that_touch_at_the_corner_only_have_a_sheet_each() {
        assert_eq!(CORNERS[0b1000_0001].sheets, 2);
        assert_eq!(CORNERS[0b0110_1001].sheets, 4);
        // Touching along an edge: still two sheets.
        assert_eq!(CORNERS[0b0000_1001].sheets, 2);
        // Two pillars on a full floor, touching along an edge: one sheet, which passes that edge twice.
        let floor_below = 0b0110_1111;
        assert_eq!((CORNERS[floor_below].sheets, CORNERS[floor_below].doubled), (1, 1 << 5));
    }

    #[test]
    fn solid_cells_that_share_no_face_share_no_sheet() {
        for (mask, corner) in CORNERS.iter().enumerate() {
            let mut component: [usize; 8] = std::array::from_fn(|i| i);
            for _ in 0..8 {
                for i in 0..8 {
                    for axis in 0..3 {
                        let j = i ^ (1 << axis);
                        if mask >> i & 1 == 1 && mask >> j & 1 == 1 {
                            component[i] = component[i].min(component[j]);
                        }
                    }
                }
            }
            let mut solid_of_sheet = [usize::MAX; 4];
            for q in 0..12 {
                let sheet = corner.sheet_of[q];
                if sheet != NO_SHEET {
                    let low = bit(q / 4, 0, q % 2, q / 2 % 2);
                    let cell = if mask >> low & 1 == 1 { low } else { bit(q / 4, 1, q % 2, q / 2 % 2) };
                    let seen = &mut solid_of_sheet[usize::from(sheet)];
                    assert!(*seen == usize::MAX || *seen == component[cell], "mask {mask:08b}");
                    *seen = component[cell];
                }
            }
        }
    }

    #[test]
    fn neighbours_agree_with_the_table() {
        for mask in 0..=255u8 {
            let corner = &CORNERS[usize::from(mask)];
            let mut counted = [0; 4];
            for (_, quadrant) in neighbours(mask) {
                counted[usize::from(corner.sheet_of[quadrant])] += 1;
            }
            assert_eq!(counted, corner.sheet.map(|s| s.neighbours));
        }
    }
}
