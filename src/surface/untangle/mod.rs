//! Untangling: vertices of triangles that intersect go back towards rest, until no two triangles intersect.
//!
//! *At rest* a vertex is where one step of smoothing puts it. The surface with all vertices at rest, nothing contracted, is free of
//! intersections (`tests/streamed/rest.rs`), so a retreat comes to an end. Each round looks only at what the one before has changed.
//!
//! ```text
//!      x                  x     a and b are one vertex, on point x, and the triangles there meet others: the cluster is taken
//!     /|\                       apart, a and b are vertices of their own again, at rest
//!    / | \              a---b
//!   c  d  e            c  d  e
//! ```
//!
//! If one of two triangles that intersect is flipped, the flip is taken back, and no vertex moves for these two. All flips at a vertex are taken back when it comes to rest.
//!
//! Where clusters are taken apart, others may lose what made their contraction sound: a vertex that meets one cluster twice.
//! These are taken apart, too, so that the mesh stays a closed 2-manifold.

pub mod broad_phase;
pub mod quantized;
pub mod star;
pub mod submesh;

use std::cell::Cell;

use self::broad_phase::{BroadPhase, Dirty};
use self::star::{Star, all_stars, star_is_free};
use self::submesh::Submesh;
use crate::mesh::intersect::intersect;
use crate::points::vector::{cross, minus};
use crate::surface::contract::{NONE, is_gone};
use crate::surface::vertex_state::VertexState;

/// Bytes of a list of vertices before it is worth while to look for those that are in it twice.
const LIST: usize = 1 << 16;

/// Bytes that [`untangle`] needs for a submesh of so many vertices, but for what it lists of those that move, and for the broad phase, whose bytes `near` are.
pub fn bytes(vertices: u64, near: u64) -> u64 {
    let moving = (LIST * size_of::<u32>()) as u64 + vertices * size_of::<u32>() as u64;
    star::bytes(vertices).max(vertices * size_of::<Star>() as u64 + near + moving)
}

/// How retreat ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Untangled {
    /// The pairs of triangles that still intersect: not zero only if cells are too small for the precision of coordinates, or if a frozen vertex would have to move.
    pub tangled: u64,
    /// Rounds in which vertices went back.
    pub rounds: u32,
}

/// Lets vertices retreat until no two known triangles intersect, given that only pairs with a dirty triangle can.
pub fn untangle<P: Submesh>(submesh: &mut P, broad_phase: &mut BroadPhase, mut dirty: Option<Vec<u32>>) -> Untangled {
    let (mut left, mut rounds) = (0, 0);
    let stars = match dirty {
        None => all_stars(submesh),
        Some(_) => vec![Cell::new(Star::Unknown); submesh.vertices() as usize],
    };
    let is_ring = |v: u32| stars[v as usize].get() == Star::Ring;
    loop {
        let (mut tangled, mut flipped): (Vec<u32>, Vec<u32>) = Default::default();
        let mut room = LIST;
        let mut pairs = 0;
        let looked_at = dirty.as_deref().map_or(Dirty::All, Dirty::Some);
        broad_phase.pairs(submesh, looked_at, is_ring, |submesh, t, u| {
            let [a, b] = [t, u].map(|t| submesh.triangle(t));
            if !are_apart(submesh, &stars, a, b) {
                pairs += 1;
                let before = flipped.len();
                flipped.extend([t, u].into_iter().filter(|t| submesh.is_flipped(*t)));
                if flipped.len() > before {
                    return;
                }
                // What vertices at creases have brought about, they take back alone.
                let is_creased = |v: &u32| matches!(submesh.state(*v), VertexState::Creased(_));
                let creased = a.iter().chain(&b).any(is_creased);
                let moves = |v: &u32| if creased { is_creased(v) } else { submesh.state(*v) != VertexState::AtRest };
                let before = tangled.len();
                tangled.extend(a.iter().chain(&b).copied().filter(moves));
                left += u64::from(tangled.len() == before);
                // A vertex that is in many pairs is listed once.
                if tangled.len() >= room {
                    tangled.sort_unstable();
                    tangled.dedup();
                    room = LIST.max(2 * tangled.len());
                }
            }
        });
        tangled.sort_unstable();
        tangled.dedup();
        if tangled.is_empty() && flipped.is_empty() {
            return Untangled { tangled: left, rounds };
        }
        let Some(moved) = step_back(submesh, &tangled, flipped) else {
            return Untangled { tangled: left + pairs, rounds };
        };
        rounds += 1;
        let members = moved.vertices.iter().flat_map(|&v| cluster(submesh, v));
        let mut changed: Vec<u32> = members.flat_map(|v| submesh.corners(v)).map(|corner| corner / 3).collect();
        changed.extend(moved.flipped_back);
        changed.retain(|&t| !is_gone(submesh.triangle(t)) && submesh.is_known(submesh.triangle(t)));
        changed.sort_unstable();
        changed.dedup();
        // A vertex's ring has triangles that do not touch it: the other halves of rectangles.
        for v in changed.iter().flat_map(|&t| [submesh.known(t), submesh.known(t ^ 1)]).flatten().flatten() {
            stars[v as usize].set(Star::Unknown);
        }
        dirty = Some(changed);
    }
}

/// Whether two triangles whose boxes meet do not intersect: by the star of a vertex they share, by a plane between them, or else in full.
fn are_apart<P: Submesh>(submesh: &P, stars: &[Cell<Star>], a: [u32; 3], b: [u32; 3]) -> bool {
    for v in a {
        if v != b[0] && v != b[1] && v != b[2] {
            continue;
        }
        let star = &stars[v as usize];
        if star.get() == Star::Unknown {
            star.set(if star_is_free(submesh, v) { Star::Free } else { Star::Doubtful });
        }
        if star.get() >= Star::Free {
            return true;
        }
    }
    let (pa, pb) = (a.map(|v| submesh.place(v)), b.map(|v| submesh.place(v)));
    let beside = lies_beside(pa, a.map(|v| b.contains(&v)), pb) || lies_beside(pb, b.map(|v| a.contains(&v)), pa);
    beside || !intersect(a, pa, b, pb)
}

/// Whether the first triangle, but for the corners it shares, certainly lies on one side of the second's plane: then it meets that plane, and
/// the second triangle, in these corners or the edge between them alone. May say no where it does.
fn lies_beside(one: [[f64; 3]; 3], shared: [bool; 3], [a, b, c]: [[f64; 3]; 3]) -> bool {
    let (ab, ac) = (minus(b, a), minus(c, a));
    let normal = cross(ab, ac);
    let from_plane = one.map(|p| minus(p, a));
    let largest = ab.iter().chain(&ac).chain(from_plane.as_flattened()).fold(0.0f64, |m, d| m.max(d.abs()));
    // Each difference is off by half a unit in its last place at most, and so is every product and sum of them.
    let doubt = 1e-13 * largest * largest * largest;
    let (mut above, mut below) = (shared != [true; 3], shared != [true; 3]);
    for (d, shared) in from_plane.into_iter().zip(shared) {
        let height = d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2];
        above &= shared | (height > doubt);
        below &= shared | (height < -doubt);
    }
    above | below
}

/// What a step back changed.
#[derive(Debug, Default)]
pub(crate) struct Moved {
    /// The vertices that moved.
    pub vertices: Vec<u32>,
    /// The triangles whose flips were taken back.
    pub flipped_back: Vec<u32>,
}

/// Takes back the flips of the triangles `flipped`, and moves the vertices one step back. Where that is to rest, takes back all flips there, and takes apart their clusters and whatever other clusters
/// this makes unsound: all vertices of these are put to rest.
///
/// If one of them is frozen, nothing is done, and there is no result.
pub(crate) fn step_back<P: Submesh>(submesh: &mut P, vertices: &[u32], flipped: Vec<u32>) -> Option<Moved> {
    let is_frozen = |submesh: &P, v: u32| cluster(submesh, v).any(|member| submesh.is_frozen(member));
    if vertices.iter().any(|&v| is_frozen(submesh, v)) {
        return None;
    }
    let mut moved = Moved::default();
    let mut apart = Vec::new();
    // What was: vertex, survivor, next of its cluster, state.
    let mut before = Vec::new();
    flip_back(submesh, flipped, &mut moved.flipped_back);
    for &v in vertices {
        match submesh.state(v).backtracked() {
            VertexState::AtRest => apart.push(v),
            state => {
                before.push((v, v, submesh.also(v), submesh.state(v)));
                submesh.put(v, v, submesh.also(v), state);
                moved.vertices.push(v);
            }
        }
    }
    // What was flipped back up to here has been looked at.
    let mut looked_at = 0;
    loop {
        let first = moved.vertices.len();
        for &survivor in &apart {
            let members: Vec<u32> = cluster(submesh, survivor).collect();
            if members.iter().any(|&member| submesh.is_frozen(member)) {
                take_back(submesh, &before, &moved.flipped_back);
                return None;
            }
            let at: Vec<u32> = members.iter().flat_map(|member| submesh.corners(*member)).map(|c| c / 3).collect();
            flip_back(submesh, at, &mut moved.flipped_back);
            for member in members {
                before.push((member, survivor, submesh.also(member), submesh.state(member)));
                submesh.put(member, member, NONE, VertexState::AtRest);
                moved.vertices.push(member);
            }
        }
        let at_vertices = moved.vertices[first..].iter().flat_map(|&v| submesh.corners(v)).map(|corner| corner / 3);
        let flipped_back = moved.flipped_back[looked_at..].iter().copied();
        let mut near: Vec<u32> = at_vertices.chain(flipped_back).flat_map(|t| submesh.triangle(t)).collect();
        looked_at = moved.flipped_back.len();
        near.sort_unstable();
        near.dedup();
        apart.clear();
        for v in near {
            find_unsound(submesh, v, &mut apart);
        }
        if apart.is_empty() {
            return Some(moved);
        }
        apart.sort_unstable();
        apart.dedup();
    }
}

/// Takes back the flips of some triangles; appends both triangles of each to `back`.
fn flip_back<P: Submesh>(submesh: &mut P, triangles: Vec<u32>, back: &mut Vec<u32>) {
    for t in triangles {
        if submesh.is_flipped(t) {
            back.extend(submesh.toggle_flip(t).into_iter().flatten());
        }
    }
}

fn take_back<P: Submesh>(submesh: &mut P, before: &[(u32, u32, u32, VertexState)], flipped_back: &[u32]) {
    for &(v, survivor, also, state) in before.iter().rev() {
        submesh.put(v, survivor, also, state);
    }
    for &t in flipped_back {
        // The list has both triangles of each flip.
        if !submesh.is_flipped(t) {
            submesh.toggle_flip(t);
        }
    }
}

/// The vertices that have become `v`, with it as the first.
pub fn cluster<P: Submesh>(submesh: &P, v: u32) -> impl Iterator<Item = u32> {
    std::iter::successors(Some(v), |v| Some(submesh.also(*v)).filter(|v| *v != NONE))
}

/// If the link of `v` is not one simple cycle of at least three vertices, or kept triangles are more than one stretch of it, appends the clusters to blame: its own, and those that occur in the link
/// more than once, or all if it is too short.
fn find_unsound<P: Submesh>(submesh: &P, v: u32, out: &mut Vec<u32>) {
    let mut link: Vec<(u32, u32)> = Vec::new();
    // Where a kept triangle begins and ends, seen from the other side of its edges.
    let (mut begins, mut ends): (Vec<u32>, Vec<u32>) = (Vec::new(), Vec::new());
    let mut member = v;
    while member != NONE {
        for corner in submesh.corners(member) {
            let triangle = submesh.triangle(corner / 3);
            if !is_gone(triangle) {
                let at = corner as usize % 3;
                link.push((triangle[(at + 1) % 3], triangle[(at + 2) % 3]));
                if submesh.is_kept(corner / 3) {
                    begins.push(triangle[(at + 1) % 3]);
                    ends.push(triangle[(at + 2) % 3]);
                }
            }
        }
        member = submesh.also(member);
    }
    link.sort_unstable();
    let is_cluster = |v: &u32| submesh.also(*v) != NONE;
    let before = out.len();
    let twice = link.windows(2).filter(|pair| pair[0].0 == pair[1].0).map(|pair| pair[0].0);
    out.extend(twice.filter(is_cluster));
    let mut sound = out.len() == before;
    if sound && submesh.is_whole(v) && !link.is_empty() {
        if link.len() < 3 {
            out.extend(link.iter().map(|(u, _)| *u).filter(is_cluster));
            sound = false;
        } else {
            let mut at = link[0].0;
            let mut steps = 0;
            while steps < link.len() {
                let Ok(next) = link.binary_search_by_key(&at, |(u, _)| *u) else { break };
                at = link[next].1;
                steps += 1;
                if at == link[0].0 {
                    break;
                }
            }
            let stretches = begins.iter().filter(|begin| !ends.contains(begin)).count();
            sound = steps == link.len() && stretches <= 1;
        }
    }
    if !sound && is_cluster(&v) {
        out.push(v);
    }
}
