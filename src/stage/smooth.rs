//! Smoothing (the paper's Eq. 4): every vertex moves to the mean of itself and its r neighbours on the surface, all at once.
//!
//! Displacements from the corner are kept instead of positions: d ← (d + Σ (eᵢ + dᵢ)) / (r + 1), where eᵢ is the unit vector to
//! neighbour i and dᵢ its displacement. The first step starts from d = 0 everywhere, so it depends on the eight cells round
//! the corner alone and is read from a table. Each further step needs one more plane either side.

use crate::stage::corner::{CORNERS, neighbours};
use crate::stage::extract::{Kind, Surface, Vertex};

/// The positions q′, in cells, of all vertices of a surface after `steps` steps.
///
/// On the planes nearer than `steps` to the surface's lowest or highest (where the solid goes on beyond them) the result is not the
/// true one: such planes are halo. With `steps` of 0 or 1 every plane's is true.
pub fn smooth(surface: &Surface, steps: u32) -> Vec<[f64; 3]> {
    let vertices = &surface.vertices;
    let mut q: Vec<[f64; 3]> = vertices
        .iter()
        .map(|v| match v.kind {
            Kind::Sheet(sheet) if steps > 0 => CORNERS[usize::from(v.mask)].displacement(usize::from(sheet)),
            _ => [0.0; 3],
        })
        .collect();
    for _ in 1..steps {
        q = step(surface, &q);
    }
    // From here on not displacements any more, but positions.
    for (q, vertex) in q.iter_mut().zip(vertices) {
        *q = std::array::from_fn(|a| f64::from(vertex.corner[a]) + q[a]);
    }
    for (i, vertex) in vertices.iter().enumerate() {
        if let Kind::Middle(axis) = vertex.kind
            && ends_are_held(surface, vertex, axis)
        {
            let [a, b] = surface.ends(vertex, axis).map(|end| q[end as usize]);
            let towards = into_solid(vertex.mask, usize::from(axis));
            q[i] = std::array::from_fn(|c| (a[c] + b[c]) * 0.5 + towards[c]);
        }
    }
    q
}

/// A quarter of a cell, from the doubled edge upwards along axis `m` of a corner, towards the solid cell with d_b = 0, whose copy the middle belongs to.
fn into_solid(mask: u8, m: usize) -> [f64; 3] {
    let (b, c) = ((m + 1) % 3, (m + 2) % 3);
    let mut out = [0.0; 3];
    out[b] = -0.25;
    out[c] = if mask >> (1 << m) & 1 == 1 { -0.25 } else { 0.25 };
    out
}

/// The upper end of a middle along y may lie on the plane above the highest: then the middle belongs to the halo.
fn ends_are_held(surface: &Surface, vertex: &Vertex, axis: u8) -> bool {
    axis != 1 || vertex.corner[1] < *surface.planes().end()
}

/// One step of Eq. 4 for all vertices whose neighbours are held.
fn step(surface: &Surface, before: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let held = surface.planes();
    let mut after = before.to_vec();
    for (i, vertex) in surface.vertices.iter().enumerate() {
        let Kind::Sheet(sheet) = vertex.kind else { continue };
        let corner = &CORNERS[usize::from(vertex.mask)];
        let mut sum = [0.0; 3];
        let mut whole = true;
        for (edge, quadrant) in neighbours(vertex.mask) {
            if corner.sheet_of[quadrant] != sheet {
                continue;
            }
            let (m, s) = (edge / 2, edge % 2);
            let mut place = vertex.corner;
            place[m] = place[m].wrapping_add_signed(if s == 1 { 1 } else { -1 });
            if !held.contains(&place[1]) {
                whole = false;
                break;
            }
            let neighbour = surface.vertex(place, seen_from_other_end(quadrant, m));
            for a in 0..3 {
                let unit = if a == m { if s == 1 { 1.0 } else { -1.0 } } else { 0.0 };
                sum[a] += unit + before[neighbour as usize][a];
            }
        }
        if whole {
            let share = f64::from(corner.sheet[usize::from(sheet)].neighbours) + 1.0;
            after[i] = std::array::from_fn(|a| (before[i][a] + sum[a]) / share);
        }
    }
    after
}

/// The quadrant in which a face appears at the other end of its edge along axis `m`: the coordinate along m turns over.
fn seen_from_other_end(quadrant: usize, m: usize) -> usize {
    let axis = quadrant / 4;
    quadrant ^ if m == (axis + 1) % 3 { 1 } else { 2 }
}
