//! Contraction: adjacent vertices on one point become one, where the link condition allows.
//!
//! ```text
//!        c                     c
//!      / | \                   |        u and v may become one if c and d are their only common neighbours
//!     u--+--v   contract uv    v        (then no edge or triangle appears twice), unless all four make a tetrahedron
//!      \ | /                   |
//!        d                     d
//! ```

use crate::resources::workers::refill;

/// "No point", "no vertex", "no corner".
pub const NONE: u32 = u32::MAX;

/// Whether a contraction took the triangle away: two of its corners have become one.
#[inline]
pub fn is_gone([a, b, c]: [u32; 3]) -> bool {
    a == b || b == c || c == a
}

/// For each vertex, the corners (3 × triangle + position) at which triangles touched it before any contraction, as linked lists; and
/// the vertices that were contracted into it, likewise. Flips pass corners on.
///
/// A contraction writes the survivor into the dead vertex's corners and joins the two lists of vertices, so that the survivor's star is those of all
/// vertices of its list, and the contraction can be taken back.
#[derive(Debug, Clone, Default)]
pub struct Stars {
    head: Vec<u32>,
    next: Vec<u32>,
    /// The next vertex of each vertex's cluster.
    pub also: Vec<u32>,
}

impl Stars {
    /// Stars with room for so many vertices and triangles.
    pub fn with_room(vertices: usize, triangles: usize) -> Stars {
        let (head, next) = (Vec::with_capacity(vertices), Vec::with_capacity(3 * triangles));
        Stars { head, next, also: Vec::with_capacity(vertices) }
    }

    /// The stars of `vertices` vertices of a mesh of `triangles`, in the memory of `room`; of those, the first `own` may be contracted.
    pub fn new(triangles: &[[u32; 3]], vertices: usize, own: usize, room: Stars) -> Stars {
        let mut stars = room;
        refill(&mut stars.head, vertices, NONE);
        refill(&mut stars.next, 3 * triangles.len(), NONE);
        refill(&mut stars.also, own, NONE);
        for (corner, &v) in triangles.as_flattened().iter().enumerate() {
            stars.next[corner] = stars.head[v as usize];
            stars.head[v as usize] = corner as u32;
        }
        stars
    }

    /// Bytes of the stars of `vertices` vertices and `triangles` triangles.
    pub fn bytes(vertices: u64, triangles: u64) -> u64 {
        (2 * vertices + 3 * triangles) * size_of::<u32>() as u64
    }

    /// The corners that were vertex `v`'s before any contraction; none for vertices beyond those that have a star.
    pub fn corners(&self, v: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.head.get(v as usize).copied();
        std::iter::successors(first.filter(|c| *c != NONE), |c| Some(self.next[*c as usize]).filter(|c| *c != NONE))
    }

    /// Passes a corner from one vertex to another.
    pub fn pass(&mut self, corner: u32, [from, to]: [u32; 2]) {
        let after = self.next[corner as usize];
        let before = self.corners(from).find(|before| self.next[*before as usize] == corner);
        match before {
            Some(before) => self.next[before as usize] = after,
            None => self.head[from as usize] = after,
        }
        self.next[corner as usize] = std::mem::replace(&mut self.head[to as usize], corner);
    }

    /// The vertices that have become `v`, with it as the first.
    pub fn cluster(&self, v: u32) -> impl Iterator<Item = u32> + '_ {
        std::iter::successors(Some(v), |v| self.also.get(*v as usize).copied().filter(|v| *v != NONE))
    }

    /// The triangles at vertex `v`, each with the position of `v` in it. Triangles that are gone are left out.
    #[inline]
    pub fn at<'a>(&'a self, v: u32, triangles: &'a [[u32; 3]]) -> impl Iterator<Item = (usize, usize)> + 'a {
        let mut member = v;
        let mut corner = self.head[v as usize];
        std::iter::from_fn(move || {
            loop {
                while corner != NONE {
                    let (triangle, position) = (corner as usize / 3, corner as usize % 3);
                    corner = self.next[corner as usize];
                    if !is_gone(triangles[triangle]) {
                        return Some((triangle, position));
                    }
                }
                member = *self.also.get(member as usize).filter(|v| **v != NONE)?;
                corner = self.head[member as usize];
            }
        })
    }
}

/// What is to be contracted: per vertex its group (vertices of one group lie on one point; [`NONE`] for vertices that must stay)
/// and its rank (the smaller survives, ties by number).
#[derive(Debug, Clone, Copy)]
pub struct Groups<'a, D> {
    /// The group of each vertex.
    pub group: &'a [u32],
    /// The squared distance of a vertex that has a group to its point.
    pub distance: D,
    /// Whether each triangle is kept; empty if all are. The *rim* lies where kept triangles meet others.
    pub kept: &'a [bool],
}

/// Bytes that [`contract`] needs for so many vertices, with the list of their groups: who is alive, and who can be contracted.
pub fn bytes(vertices: u64) -> u64 {
    vertices * (2 * size_of::<u32>() + size_of::<bool>()) as u64
}

/// Contracts edges inside groups until none can be contracted any more.
///
/// Vertices are visited in order; at each, as long as it lives, its lowest neighbour of the same group that can be
/// contracted with it is. `merged(dead, survivor)` is told of each contraction.
///
/// Every grouped vertex's star must be complete. Keeps a closed 2-manifold one, and its Euler number.
pub fn contract<D: Fn(u32) -> f64>(
    triangles: &mut [[u32; 3]],
    stars: &mut Stars,
    groups: Groups<'_, D>,
    mut merged: impl FnMut(u32, u32),
) {
    let vertices = groups.group.len() as u32;
    let mut alive = vec![true; vertices as usize];
    let mut scratch = Neighbourhoods::default();
    // Only vertices with a neighbour of their own group can ever be contracted; later rounds look at what is left of them.
    let mut candidates: Vec<u32> = Vec::with_capacity(vertices as usize);
    candidates.extend((0..vertices).filter(|&v| {
        let group = groups.group[v as usize];
        group != NONE
            && stars.at(v, triangles).any(|(t, p)| {
                let next = triangles[t][(p + 1) % 3];
                next < vertices && groups.group[next as usize] == group
            })
    }));
    loop {
        let mut changed = false;
        for &v in &candidates {
            while alive[v as usize] {
                let Some(u) = first_contractible(triangles, stars, groups.group, groups.kept, v, &mut scratch) else {
                    break;
                };
                let key = |x: u32| ((groups.distance)(x), x);
                let (survivor, dead) = if key(u) < key(v) { (u, v) } else { (v, u) };
                contract_edge(triangles, stars, survivor, dead);
                alive[dead as usize] = false;
                merged(dead, survivor);
                changed = true;
            }
        }
        if !changed {
            return;
        }
        candidates.retain(|&v| alive[v as usize]);
    }
}

/// Whether the triangles at a vertex go all round it: each corner that comes after it in one comes before it in another.
pub fn is_closed(triangles: &[[u32; 3]], stars: &Stars, v: u32) -> bool {
    let corner = |(t, p): (usize, usize), after: usize| triangles[t][(p + after) % 3];
    stars.at(v, triangles).all(|at| stars.at(v, triangles).any(|other| corner(other, 2) == corner(at, 1)))
}

/// Buffers for the neighbours of two vertices.
#[derive(Debug, Default)]
struct Neighbourhoods {
    of_v: Vec<u32>,
    of_u: Vec<u32>,
    same_group: Vec<u32>,
}

fn first_contractible(
    triangles: &[[u32; 3]],
    stars: &Stars,
    group_of: &[u32],
    kept: &[bool],
    v: u32,
    scratch: &mut Neighbourhoods,
) -> Option<u32> {
    let Neighbourhoods { of_v, of_u, same_group } = scratch;
    collect_neighbours(triangles, stars, v, of_v);
    let group = group_of[v as usize];
    same_group.clear();
    same_group.extend(of_v.iter().filter(|&&u| group_of.get(u as usize) == Some(&group)));
    same_group.sort_unstable();
    same_group.iter().copied().find(|&u| {
        collect_neighbours(triangles, stars, u, of_u);
        let common = of_u.iter().filter(|x| of_v.contains(x)).count();
        common == 2 && !(of_u.len() == 3 && of_v.len() == 3) && keeps_rim(triangles, stars, kept, u, v)
    })
}

/// Whether a contraction leaves the rim one line: not if both ends lie on it, and the edge between them does not.
fn keeps_rim(triangles: &[[u32; 3]], stars: &Stars, kept: &[bool], u: u32, v: u32) -> bool {
    if kept.is_empty() {
        return true;
    }
    let on_rim = |v: u32| {
        let mut at = stars.at(v, triangles).map(|(t, _)| kept[t]);
        let first = at.next();
        at.any(|kept| Some(kept) != first)
    };
    let at_edge = || stars.at(v, triangles).filter(|(t, _)| triangles[*t].contains(&u)).map(|(t, _)| kept[t]);
    at_edge().any(|kept| kept) && at_edge().any(|kept| !kept) || !(on_rim(u) && on_rim(v))
}

/// The neighbours of `v`: in a closed star each is the next corner of exactly one triangle.
fn collect_neighbours(triangles: &[[u32; 3]], stars: &Stars, v: u32, out: &mut Vec<u32>) {
    out.clear();
    out.extend(stars.at(v, triangles).map(|(t, p)| triangles[t][(p + 1) % 3]));
}

fn contract_edge(triangles: &mut [[u32; 3]], stars: &mut Stars, survivor: u32, dead: u32) {
    let mut last = dead;
    for member in stars.cluster(dead) {
        for corner in stars.corners(member) {
            triangles[corner as usize / 3][corner as usize % 3] = survivor;
        }
        last = member;
    }
    stars.also[last as usize] = std::mem::replace(&mut stars.also[survivor as usize], dead);
}
