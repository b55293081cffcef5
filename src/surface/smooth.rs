//! Smoothing: the paper's Eq. 4 once, then steps that smooth without shrinking.
//!
//! Eq. 4 moves every vertex to the mean of itself and its r neighbours on the surface, all at once. Displacements from the corner are kept instead
//! of positions: d ← (d + Σ (eᵢ + dᵢ)) / (r + 1), where eᵢ is the unit vector to neighbour i and dᵢ its displacement. It starts from d = 0
//! everywhere, so it depends on the eight cells round the corner alone and is read from a table.
//!
//! Eq. 4 repeated would shrink what it smooths. Each further step is a pair instead (G. Taubin, *A signal processing approach to fair surface
//! design*, 1995): towards the neighbours' mean by 5/8 of the way, then away from it by the slightly larger 7/11. Of a wave of the
//! surface with frequency k (0 flat, 2 vertices in and out in turn) a pair leaves (1 − k·5/8)·(1 + k·7/11):
//!
//! ```text
//!   k         0      0.03   0.1    0.25   0.5    1      1.5    2
//!   is left   1      1      0.997  0.98   0.91   0.61   0.12   -0.57      never more than 1.0001, so shapes stay and steps go
//! ```
//!
//! Each of the two needs one more plane either side.

use crate::surface::corner::{CORNERS, neighbours};
use crate::surface::extract::Surface;
use crate::surface::vertices::{Kind, Vertex};

/// The part of the way to its neighbours' mean that a vertex goes first in a pair.
const INWARDS: f64 = 5.0 / 8.0;

/// The part that it goes back: with 1/INWARDS − 1/OUTWARDS = 0.03, waves of that frequency and flatter stay. With 2/3 (0.1), a knot's strand
/// seven cells thick grows by half a per cent in ten steps.
const OUTWARDS: f64 = 7.0 / 11.0;

/// How far smoothing may move a vertex from its corner along an axis, in cells: fitting counts on it.
const FARTHEST: f64 = 1.0;

/// The positions q′, in cells, of all vertices of a surface after `steps` steps, in the memory of `room`.
///
/// On the lowest and highest [`crate::grid::partition::smooth_halo`] planes of the surface (where the solid goes on beyond them) the result is not the
/// true one.
pub fn smooth(surface: &Surface, steps: u32, room: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
    let vertices = &surface.vertices;
    let mut q = room;
    q.clear();
    q.reserve_exact(vertices.len());
    q.extend(vertices.iter().map(|v| match v.kind {
        Kind::Sheet(sheet) if steps > 0 => CORNERS[usize::from(v.mask)].displacement(usize::from(sheet)),
        _ => [0.0; 3],
    }));
    for _ in 1..steps {
        q = step(surface, &q, INWARDS);
        q = step(surface, &q, -OUTWARDS);
    }
    q.as_flattened_mut().iter_mut().for_each(|d| *d = d.clamp(-FARTHEST, FARTHEST));
    // From here on not displacements any more, but positions.
    for (q, vertex) in q.iter_mut().zip(vertices) {
        *q = std::array::from_fn(|a| f64::from(vertex.corner[a]) + q[a]);
    }
    for (i, vertex) in vertices.iter().enumerate() {
        if let Kind::Midpoint(axis) = vertex.kind
            && ends_are_held(surface, vertex, axis)
        {
            let [a, b] = surface.ends(vertex, axis).map(|end| q[end as usize]);
            let towards = into_solid(vertex.mask, usize::from(axis));
            q[i] = std::array::from_fn(|c| (a[c] + b[c]) * 0.5 + towards[c]);
        }
    }
    q
}

/// Bytes that [`smooth`] needs for so many vertices while it takes a step, with the places it gives.
pub fn bytes(vertices: u64, steps: u32) -> u64 {
    let held = if steps > 1 { 2 } else { 1 };
    held * vertices * size_of::<[f64; 3]>() as u64
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

/// Moves all vertices whose neighbours are held by `part` of the way to their neighbours' mean.
fn step(surface: &Surface, before: &[[f64; 3]], part: f64) -> Vec<[f64; 3]> {
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
            // On the border of what is made of an open surface, a neighbour may be missing, too.
            if !held.contains(&place[1]) || surface.columns().is_some() && !surface.has(place) {
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
            let neighbours = f64::from(corner.sheet[usize::from(sheet)].neighbours);
            after[i] = std::array::from_fn(|a| before[i][a] + part * (sum[a] / neighbours - before[i][a]));
        }
    }
    after
}

/// The quadrant in which a face appears at the other end of its edge along axis `m`: the coordinate along m turns over.
fn seen_from_other_end(quadrant: usize, m: usize) -> usize {
    let axis = quadrant / 4;
    quadrant ^ if m == (axis + 1) % 3 { 1 } else { 2 }
}
