//! Which triangles surely lie beside those that are to come, as all of them are seen along an axis.
//!
//! A line has a triangle that is to come on its inner side, and one that is there beyond it, but for corners of both that the line goes through: then these corners, or
//! the side between them, are all that the two have in common, whatever lies in front of what. Lines go along the sides of the ring and, where it bends inwards, along
//! those that the triangles have in common, too.
//!
//! ```text
//!        r2 ------- r1
//!       /            \  `.  there    the line r0-r1 has all of the ring on one side and the triangle there on the other,
//!     r3              \   `.         but for r0 and r1, which both have
//!       \              r0 --'
//!        r4 --------- '
//! ```
//!
//! Each corner is looked at once and gets a bit for every line. Of a triangle, they are joined: the lines that tell two triangles apart are the bits that both have.

use glam::DVec3;

/// Lines, at most: bits of a number.
const LINES: usize = 64;

/// What a corner must clear a line by, as a part of the square of the farthest that either lies from the place that all is relative to.
///
/// With u = 2⁻⁵³ and U the greatest of these distances, a coordinate across the axis is a difference and three products, off by 5uU; a line's two factors are less than
/// 2U and off by 12uU, its third number is less than 4U² and off by 50uU², and the form at a place is off by 150uU² < 2·10⁻¹⁴ U², sums included. This is far more.
const CLEAR: f64 = 1e-11;

/// The triangles that are to come, seen along an axis.
#[derive(Debug, Default)]
pub(super) struct Sight {
    own: DVec3,
    right: DVec3,
    up: DVec3,
    /// What a place at `own` must clear lines by.
    clear: f64,
    /// Of each line: a, b and c, so that a x + b y + c is greater than 0 on its inner side.
    lines: Vec<[f64; 3]>,
    /// The two corners that it goes through.
    ends: Vec<[usize; 2]>,
    /// Of each triangle: the lines that have it on their inner side.
    within: Vec<u64>,
    /// Vertices that were looked at, and the lines that they lie beyond or on.
    known: Vec<u32>,
    beyond: Vec<u64>,
    /// Of each vertex of the piece: where it may stand among those. What stands there tells whether it does (Briggs, Torczon 1993).
    places: Vec<u32>,
}

impl Sight {
    /// Bytes for each vertex of a piece.
    pub(super) const BYTES: u64 = size_of::<u32>() as u64;

    /// Room for a piece with so many vertices.
    pub(super) fn new(vertices: usize) -> Sight {
        Sight { places: vec![0; vertices], ..Sight::default() }
    }

    /// Looks at triangles between `corners`, which are vertices and their places, of which the first `ring` make a ring. `axes` are the two across that which they are seen along,
    /// relative to `own`.
    pub(super) fn look(
        &mut self,
        (corners, ring): (&[(u32, DVec3)], usize),
        triangles: impl Iterator<Item = [usize; 3]> + Clone,
        own: DVec3,
        (right, up): (DVec3, DVec3),
    ) {
        (self.own, self.right, self.up) = (own, right, up);
        let size = corners.iter().fold(0f64, |size, (_, place)| size.max(place.distance_squared(own)));
        self.clear = CLEAR * size;
        self.lines.clear();
        self.ends.clear();
        for k in 0..ring {
            self.line(corners, [k, if k + 1 == ring { 0 } else { k + 1 }]);
        }
        if self.tell(corners, triangles.clone()) {
            return;
        }
        // Somewhere the ring bends inwards.
        for [from, _, to] in triangles.clone() {
            if (from, to) != (0, ring - 1) {
                self.line(corners, [from, to]);
                self.line(corners, [to, from]);
            }
        }
        self.tell(corners, triangles);
    }

    fn line(&mut self, corners: &[(u32, DVec3)], ends: [usize; 2]) {
        if self.lines.len() < LINES {
            let [(px, py), (qx, qy)] = ends.map(|end| self.across(corners[end].1 - self.own));
            let (a, b) = (py - qy, qx - px);
            self.lines.push([a, b, -(a * px + b * py)]);
            self.ends.push(ends);
        }
    }

    fn across(&self, way: DVec3) -> (f64, f64) {
        (way.dot(self.right), way.dot(self.up))
    }

    /// The lines that surely have a place on their inner side, and those that it lies beyond.
    fn sides(&self, place: DVec3) -> [u64; 2] {
        let way = place - self.own;
        let ((x, y), clear) = (self.across(way), self.clear + CLEAR * way.length_squared());
        let mut sides = [0; 2];
        for (number, [a, b, c]) in self.lines.iter().enumerate() {
            let form = a * x + b * y + c;
            sides[0] |= u64::from(form > clear) << number;
            sides[1] |= u64::from(form < -clear) << number;
        }
        sides
    }

    /// Finds out on which sides the corners and the triangles lie. Whether all triangles have all lines.
    fn tell(&mut self, corners: &[(u32, DVec3)], triangles: impl Iterator<Item = [usize; 3]>) -> bool {
        self.known.clear();
        self.beyond.clear();
        let mut inner = [u64::MAX; LINES + 1];
        for (number, (vertex, place)) in corners.iter().enumerate().take(LINES + 1) {
            let [mut within, mut beyond] = self.sides(*place);
            for (line, ends) in self.ends.iter().enumerate() {
                let on = u64::from(ends.contains(&number)) << line;
                within |= on;
                beyond |= on;
            }
            inner[number] = within;
            self.know(*vertex, beyond);
        }
        self.within.clear();
        self.within.extend(triangles.map(|corners| corners.into_iter().fold(u64::MAX, |all, c| all & inner[c])));
        let all = u64::MAX >> (LINES - self.lines.len());
        self.within.iter().all(|within| *within == all)
    }

    fn know(&mut self, vertex: u32, beyond: u64) {
        self.places[vertex as usize] = self.known.len() as u32;
        self.known.push(vertex);
        self.beyond.push(beyond);
    }

    /// The lines that a triangle which is there lies beyond; `position` tells where a vertex is.
    pub(super) fn beyond(&mut self, there: [u32; 3], position: impl Fn(u32) -> DVec3) -> u64 {
        there.into_iter().fold(u64::MAX, |all, vertex| {
            let place = self.places[vertex as usize] as usize;
            if self.known.get(place) == Some(&vertex) {
                return all & self.beyond[place];
            }
            let [_, beyond] = self.sides(position(vertex));
            self.know(vertex, beyond);
            all & beyond
        })
    }

    /// Whether a triangle that is there surely lies beside the one of this number that is to come: nothing is common to both but corners and sides that both have.
    pub(super) fn is_beside(&self, number: usize, beyond: u64) -> bool {
        self.within[number] & beyond != 0
    }
}
