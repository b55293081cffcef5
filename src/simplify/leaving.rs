//! The vertex whose turn it is: what is known of its star, whichever neighbour it goes to.

use glam::DVec3;

use super::gap::Drift;
use super::piece::{Piece, Ring};

/// A vertex that is to go.
#[derive(Debug, Default)]
pub(super) struct Leaving {
    pub(super) ring: Ring,
    pub(super) own: DVec3,
    /// The ways from it to the vertices of the ring.
    pub(super) ways: Vec<DVec3>,
    /// What the ring's triangles have used up, one by one and together.
    pub(super) drift: Vec<Drift>,
    pub(super) used: Drift,
    /// The sum of the triangles' normals, each twice as long as the area.
    axis: DVec3,
    length: f64,
    /// Of the numbers of the ring's vertices: a bit for each, by the number's last six.
    bits: u64,
}

impl Leaving {
    /// Looks round a vertex; `false` if its triangles are no disc and no half of one.
    pub(super) fn look_round(&mut self, piece: &Piece, vertex: u32) -> bool {
        if !piece.ring(vertex, &mut self.ring) {
            return false;
        }
        let Leaving { ring, own, ways, drift, used, axis, length, bits } = self;
        *own = piece.position(vertex);
        ways.clear();
        *bits = 0;
        for &v in &ring.vertices {
            ways.push(piece.position(v) - *own);
            *bits |= 1 << (v % 64);
        }
        drift.clear();
        (*used, *axis) = (Drift::NONE, DVec3::ZERO);
        for &t in &ring.triangles {
            let (its, [a, b, c]) = (piece.drift[t as usize], piece.corners(t));
            drift.push(its);
            *used = used.with(its);
            *axis += (b - a).cross(c - a);
        }
        *length = axis.length();
        true
    }

    /// Whether the normals have a sum.
    pub(super) fn has_axis(&self) -> bool {
        self.length > 0.0
    }

    /// The axis that the star is seen along.
    pub(super) fn unit(&self) -> DVec3 {
        if self.has_axis() { self.axis / self.length } else { DVec3::Z }
    }

    /// Whether a vertex belongs to the ring. Most do not, and the bits tell so.
    pub(super) fn rings(&self, vertex: u32) -> bool {
        self.bits >> (vertex % 64) & 1 == 1 && self.ring.vertices.contains(&vertex)
    }

    /// Where a neighbour stands in the ring.
    pub(super) fn place_of(&self, neighbour: u32) -> usize {
        self.ring.vertices.iter().position(|v| *v == neighbour).expect("a target is a neighbour")
    }

    /// The ring as it is read from one of its vertices on.
    pub(super) fn from(&self, at: usize) -> RingOrder {
        RingOrder { at, n: self.ring.vertices.len(), closed: self.ring.closed, mirrored: !self.ring.closed && at != 0 }
    }
}

/// A ring read from one of its vertices on: round it, or, from an end of an open one, to the other end.
#[derive(Debug, Clone, Copy)]
pub(super) struct RingOrder {
    at: usize,
    n: usize,
    closed: bool,
    /// An open ring read backwards runs the other way round.
    pub(super) mirrored: bool,
}

impl RingOrder {
    /// The place in the ring of the vertex that comes as number `k`.
    pub(super) fn vertex(self, k: usize) -> usize {
        match (self.closed, self.mirrored) {
            (true, _) => self.round(k),
            (false, false) => k,
            (false, true) => self.n - 1 - k,
        }
    }

    /// The place in the ring of the triangle between the vertices that come as numbers `j` and `j + 1`.
    pub(super) fn triangle(self, j: usize) -> usize {
        match (self.closed, self.mirrored) {
            (true, _) => self.round(j),
            (false, false) => j,
            (false, true) => self.n - 2 - j,
        }
    }

    fn round(self, k: usize) -> usize {
        let place = self.at + k;
        if place >= self.n { place - self.n } else { place }
    }
}
