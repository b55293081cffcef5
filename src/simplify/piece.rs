//! A part of the mesh that is simplified at a time: its triangles, and those round every vertex.

use glam::DVec3;

use super::gap::Drift;
use super::mark::Blend;
use super::sight::Sight;

/// Bytes for each triangle of a piece, with as much room again for stars that grow.
pub(super) const TRIANGLE_BYTES: u64 = (size_of::<[u32; 3]>() + size_of::<Drift>() + 2 * 3 * size_of::<u32>()) as u64;
/// Bytes for each vertex of a piece.
pub(super) const VERTEX_BYTES: u64 =
    (size_of::<DVec3>() + size_of::<u32>() + size_of::<Star>() + size_of::<u16>() + 4) as u64 + Sight::BYTES;
/// Bytes more for each triangle and each vertex of a piece with marks.
pub(super) const MARKED_TRIANGLE_BYTES: u64 = size_of::<Drift>() as u64;
pub(super) const MARKED_VERTEX_BYTES: u64 = size_of::<Blend>() as u64;

/// No vertex, no triangle.
pub(super) const NONE: u32 = u32::MAX;

/// Triangles with numbers of their own for vertices, and how far they have drifted.
#[derive(Debug, Default)]
pub(super) struct Piece {
    /// Where the vertices are.
    pub(super) positions: Vec<DVec3>,
    /// The vertices' numbers in the whole mesh.
    pub(super) numbers: Vec<u32>,
    /// Three vertices each; `NONE` where the triangle is gone.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Of each triangle: where its places may have been at first.
    pub(super) drift: Vec<Drift>,
    /// Vertices that have to stay: not all of their triangles are here, or they are not a disc or half of one.
    pub(super) fixed: Vec<bool>,
    /// Vertices that a pass before has tried in vain: they are tried again where something changes round them.
    pub(super) settled: Vec<bool>,
    /// Vertices' classes, which triangles do not join across; none if all are one.
    pub(super) classes: Vec<u16>,
    /// What vertices' attributes are made of; none if no marks are carried.
    pub(super) blends: Vec<Blend>,
    /// Of each triangle: how its colours may differ from what they were; none if no marks are carried.
    pub(super) tints: Vec<Drift>,
    stars: Vec<Star>,
    around: Vec<u32>,
    /// A star in the making.
    joined: Vec<u32>,
}

/// Where the triangles round a vertex are in `around`, how many there are, and for how many there is room.
#[derive(Debug, Default, Clone, Copy)]
struct Star {
    start: u32,
    len: u32,
    room: u32,
}

/// The triangles round a vertex u, in order.
///
/// ```text
///       r2----r1          r2---r1         closed: triangle i is u, r_i, r_(i+1), and after the last comes the first
///      /  \  /  \        /  \ /  \        open:   one triangle fewer than vertices, and u lies on the rim
///    r3----u----r0     r3----u----r0
///      \  /  \  /
///       r4----r5
/// ```
#[derive(Debug, Default, Clone)]
pub(super) struct Ring {
    pub(super) vertices: Vec<u32>,
    pub(super) triangles: Vec<u32>,
    pub(super) closed: bool,
    /// The other two corners of each triangle, while they are put in order.
    sides: Vec<[u32; 2]>,
}

impl Piece {
    /// A piece of triangles whose corners are places in `positions`.
    pub(super) fn new(positions: Vec<DVec3>, numbers: Vec<u32>, triangles: Vec<[u32; 3]>, drift: Vec<Drift>) -> Piece {
        let mut stars = vec![Star::default(); positions.len()];
        for v in triangles.as_flattened() {
            stars[*v as usize].room += 1;
        }
        let mut start = 0;
        for star in &mut stars {
            star.start = start;
            start += star.room;
        }
        let mut around = vec![0; start as usize];
        for (number, corners) in triangles.iter().enumerate() {
            for v in corners {
                let star = &mut stars[*v as usize];
                around[(star.start + star.len) as usize] = number as u32;
                star.len += 1;
            }
        }
        let [fixed, settled] = [0, 1].map(|_| vec![false; positions.len()]);
        let (classes, blends, tints, joined) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Piece { positions, numbers, triangles, drift, fixed, settled, classes, blends, tints, stars, around, joined }
    }

    /// The triangles round a vertex, in no order that means anything.
    pub(super) fn star(&self, vertex: u32) -> &[u32] {
        let Star { start, len, .. } = self.stars[vertex as usize];
        &self.around[start as usize..][..len as usize]
    }

    /// The corners' places of a triangle.
    pub(super) fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    pub(super) fn position(&self, vertex: u32) -> DVec3 {
        self.positions[vertex as usize]
    }

    /// The corners of a triangle after and before one of them.
    pub(super) fn others(&self, triangle: u32, vertex: u32) -> [u32; 2] {
        let [a, b, c] = self.triangles[triangle as usize];
        if a == vertex {
            [b, c]
        } else if b == vertex {
            [c, a]
        } else {
            [a, b]
        }
    }

    /// Whether one triangle of a star has a vertex, and no other: the edge from the star's middle to it lies on the rim.
    pub(super) fn is_rim(&self, star: &[u32], vertex: u32) -> bool {
        star.iter().filter(|t| self.triangles[**t as usize].contains(&vertex)).count() == 1
    }

    /// The triangles round a vertex in order; `false` if they are no disc and no half of one.
    pub(super) fn ring(&self, vertex: u32, ring: &mut Ring) -> bool {
        let Ring { vertices, triangles, closed, sides } = ring;
        vertices.clear();
        triangles.clear();
        let star = self.star(vertex);
        if star.is_empty() {
            return false;
        }
        sides.clear();
        sides.extend(star.iter().map(|t| self.others(*t, vertex)));
        // Where the star is open it begins with the vertex that no triangle ends with.
        let open = sides.iter().position(|[from, _]| sides.iter().all(|[_, to]| to != from));
        *closed = open.is_none();
        let first = open.unwrap_or(0);
        let [start, mut end] = sides[first];
        vertices.push(start);
        triangles.push(star[first]);
        while end != start {
            vertices.push(end);
            if vertices.len() > star.len() + 1 {
                return false;
            }
            let mut following = (0..star.len()).filter(|at| sides[*at][0] == end);
            match (following.next(), following.next()) {
                (Some(at), None) => {
                    triangles.push(star[at]);
                    end = sides[at][1];
                }
                (None, _) => break,
                _ => return false,
            }
        }
        triangles.len() == star.len() && vertices.len() == star.len() + usize::from(!*closed)
    }

    /// Moves the triangles of `gone`'s ring onto `kept`: those that have both are gone. `left` is what stays of them.
    pub(super) fn collapse(&mut self, gone: u32, kept: u32, ring: &Ring) {
        let mut star = std::mem::take(&mut self.joined);
        star.clear();
        star.extend_from_slice(self.star(kept));
        for &t in &ring.triangles {
            let corners = &mut self.triangles[t as usize];
            if corners.contains(&kept) {
                let others = corners.iter().copied().filter(|v| *v != gone && *v != kept);
                let other = others.into_iter().next();
                *corners = [NONE; 3];
                star.retain(|s| *s != t);
                if let Some(other) = other {
                    self.leave(other, t);
                }
            } else {
                corners.iter_mut().filter(|v| **v == gone).for_each(|v| *v = kept);
                star.push(t);
            }
        }
        self.stars[gone as usize].len = 0;
        let of_kept = &mut self.stars[kept as usize];
        of_kept.len = star.len() as u32;
        if of_kept.len > of_kept.room {
            // Twice the room, so that a star that grows is moved a few times only.
            (of_kept.start, of_kept.room) = (self.around.len() as u32, 2 * of_kept.len);
            self.around.resize(self.around.len() + of_kept.room as usize, 0);
        }
        self.around[of_kept.start as usize..][..star.len()].copy_from_slice(&star);
        self.joined = star;
    }

    /// Takes a triangle out of a vertex's star.
    fn leave(&mut self, vertex: u32, triangle: u32) {
        let Star { start, len, .. } = &mut self.stars[vertex as usize];
        let star = &mut self.around[*start as usize..][..*len as usize];
        if let Some(at) = star.iter().position(|t| *t == triangle) {
            star.copy_within(at + 1.., at);
            *len -= 1;
        }
    }
}
