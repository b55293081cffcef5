//! One vertex: its triangles, its edges, its fans.
//!
//! The triangles at a vertex v are given by their *corners* there: `[next, prev]`, the two other vertices in the
//! triangle's own order. The corners form the vertex's link, a graph with an arc next -> prev for each. A mesh is a closed,
//! consistently oriented 2-manifold round v exactly if the link is one simple directed cycle:
//!
//! ```text
//!        b---a
//!       / \ / \        corners of v: [a,b] [b,c] [c,d] [d,e] [e,a]
//!      c---v---e       link: a -> b -> c -> d -> e -> a
//!       \ / \ /
//!        `-d-'         the mesh's edges at v are the link's nodes; v counts those to higher vertices
//! ```
//!
//! Nearly every vertex of nearly every mesh passes that quick test; the others are examined at leisure.

use super::components::root;

/// Beyond this many corners sorting is quicker than walking, which takes the square of the number.
const WALKED: usize = 32;

/// What the vertices of a part of the mesh have shown. Edges are counted at their smaller vertex.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(super) struct Tally {
    /// Vertices of at least one triangle.
    pub used: u64,
    /// Edges.
    pub edges: u64,
    /// Edges of one triangle.
    pub boundary: u64,
    /// Vertices with an edge of one triangle.
    pub at_boundary: u64,
    /// Edges of more than two triangles.
    pub nonmanifold_edges: u64,
    /// Edges of two triangles that both run the same way.
    pub inconsistent: u64,
    /// Edges of two or more triangles that are not run equally often both ways.
    pub unbalanced: u64,
    /// Vertices of more than one fan.
    pub nonmanifold_vertices: u64,
    /// Triangles of three vertices that another triangle has too, beyond the first. Counted at their smallest vertex.
    pub duplicates: u64,
}

impl Tally {
    /// Adds what another part has shown.
    pub fn add(&mut self, other: &Tally) {
        self.used += other.used;
        self.edges += other.edges;
        self.boundary += other.boundary;
        self.at_boundary += other.at_boundary;
        self.nonmanifold_edges += other.nonmanifold_edges;
        self.inconsistent += other.inconsistent;
        self.unbalanced += other.unbalanced;
        self.nonmanifold_vertices += other.nonmanifold_vertices;
        self.duplicates += other.duplicates;
    }
}

/// Whether the corners' link is one simple directed cycle of at least three; if so they are left in its order.
pub(super) fn is_simple_cycle(corners: &mut [[u32; 2]]) -> bool {
    let len = corners.len();
    if !(3..=WALKED).contains(&len) {
        return false;
    }
    let start = corners[0][0];
    for i in 1..len {
        let sought = corners[i - 1][1];
        let (mut found, mut at) = (0, i);
        for (j, corner) in corners.iter().enumerate().skip(i) {
            if corner[0] == sought {
                found += 1;
                at = j;
            }
        }
        // Two ways on, or the start met early: some node is passed twice.
        if found != 1 || sought == start {
            return false;
        }
        corners.swap(i, at);
    }
    corners[len - 1][1] == start
}

/// Examines links of any kind. Memory: 24 bytes per corner of the largest so far.
#[derive(Debug, Default)]
pub(super) struct Examiner {
    /// An end of an arc of the link: (node, corner · 2 + 1 if the arc ends there).
    ends: Vec<(u32, u32)>,
    /// Union-find over corners: the fans.
    fans: Vec<u32>,
    pairs: Vec<[u32; 2]>,
    /// Edges of one triangle, from their smaller vertex, since it was emptied.
    pub boundary: Vec<[u32; 2]>,
}

impl Examiner {
    /// Adds vertex `v` to the tally; its corners are at least one, of triangles that are not degenerate. Calls `neighbour`
    /// for each distinct neighbour, in ascending order.
    pub fn examine(&mut self, v: u32, corners: &[[u32; 2]], tally: &mut Tally, mut neighbour: impl FnMut(u32)) {
        self.ends.clear();
        self.fans.clear();
        for (i, &[next, prev]) in corners.iter().enumerate() {
            let i = i as u32;
            self.ends.extend([(next, 2 * i), (prev, 2 * i + 1)]);
            self.fans.push(i);
        }
        self.ends.sort_unstable();
        let mut unions = 0;
        let mut at_boundary = false;
        for edge in self.ends.chunk_by(|a, b| a.0 == b.0) {
            let u = edge[0].0;
            neighbour(u);
            for pair in edge.windows(2) {
                let (a, b) = (root(&mut self.fans, pair[0].1 / 2), root(&mut self.fans, pair[1].1 / 2));
                if a != b {
                    self.fans[a as usize] = b;
                    unions += 1;
                }
            }
            at_boundary |= edge.len() == 1;
            if u > v {
                let outward = edge.iter().filter(|(_, end)| end % 2 == 0).count();
                tally.edges += 1;
                match edge.len() {
                    1 => {
                        tally.boundary += 1;
                        self.boundary.push([v, u]);
                    }
                    2 => tally.inconsistent += u64::from(outward != 1),
                    _ => tally.nonmanifold_edges += 1,
                }
                tally.unbalanced += u64::from(edge.len() > 1 && 2 * outward != edge.len());
            }
        }
        tally.used += 1;
        tally.at_boundary += u64::from(at_boundary);
        tally.nonmanifold_vertices += u64::from(corners.len() - unions > 1);
        self.pairs.clear();
        self.pairs.extend(corners.iter().filter(|c| c[0] > v && c[1] > v).map(|&[a, b]| [a.min(b), a.max(b)]));
        self.pairs.sort_unstable();
        tally.duplicates += self.pairs.windows(2).filter(|pair| pair[0] == pair[1]).count() as u64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tally(v: u32, corners: &[[u32; 2]]) -> Tally {
        let mut tally = Tally::default();
        Examiner::default().examine(v, corners, &mut tally, |_| ());
        tally
    }

    #[test]
    fn a_closed_fan_is_a_simple_cycle_in_any_order() {
        let cycle = [[1, 2], [2, 3], [3, 4], [4, 1]];
        for first in 0..4 {
            for second in 0..4 {
                let mut corners = cycle;
                corners.swap(0, first);
                corners.swap(1, second);
                assert!(is_simple_cycle(&mut corners));
                assert!(corners.windows(2).all(|pair| pair[0][1] == pair[1][0]));
            }
        }
        assert_eq!(tally(0, &cycle), Tally { used: 1, edges: 4, ..Tally::default() });
    }

    #[test]
    fn anything_else_is_not() {
        let crossing_at_the_start = [[1, 2], [2, 1], [1, 3], [3, 1]];
        let crossing_later = [[2, 1], [1, 3], [3, 1], [1, 2]];
        let two_cycles = [[1, 2], [2, 3], [3, 1], [4, 5], [5, 6], [6, 4]];
        let open = [[1, 2], [2, 3], [3, 4]];
        let one_flipped = [[1, 2], [2, 3], [1, 3]];
        let pillow = [[1, 2], [2, 1]];
        for corners in [&crossing_at_the_start[..], &crossing_later, &two_cycles, &open, &one_flipped, &pillow, &[]] {
            assert!(!is_simple_cycle(&mut corners.to_vec()), "{corners:?}");
        }
        assert_eq!(tally(0, &two_cycles), Tally { used: 1, edges: 6, nonmanifold_vertices: 1, ..Tally::default() });
        assert_eq!(tally(0, &open), Tally { used: 1, edges: 4, boundary: 2, at_boundary: 1, ..Tally::default() });
        let flipped = Tally { used: 1, edges: 3, inconsistent: 2, unbalanced: 2, ..Tally::default() };
        assert_eq!(tally(0, &one_flipped), flipped);
        assert_eq!(tally(0, &pillow), Tally { used: 1, edges: 2, duplicates: 1, ..Tally::default() });
    }

    #[test]
    fn a_fan_too_large_to_walk_is_examined_alike() {
        let large: Vec<[u32; 2]> = (0..100).map(|i| [i + 1, (i + 1) % 100 + 1]).collect();
        assert!(!is_simple_cycle(&mut large.clone()));
        assert_eq!(tally(0, &large), Tally { used: 1, edges: 100, ..Tally::default() });
    }
}
