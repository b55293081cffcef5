//! Edge contraction under the link condition.

use std::collections::BTreeSet;

use super::flips::Flip;

/// Triangles that are being contracted; a vertex number is its place in the order.
#[derive(Debug, Clone)]
pub struct Contraction {
    /// The triangles before any contraction, but with flips.
    pub(super) original: Vec<[u32; 3]>,
    /// Of each triangle, whether it is written in the end.
    pub(super) kept: Vec<bool>,
    /// What each vertex has become.
    into: Vec<u32>,
    /// The vertices that have become each vertex, in order.
    clusters: Vec<Vec<u32>>,
    /// `None` where a triangle is gone.
    pub(super) triangles: Vec<Option<[u32; 3]>>,
    /// The living triangles at each vertex; empty if the vertex is gone.
    pub(super) around: Vec<BTreeSet<usize>>,
    /// The flips, also those that were taken back.
    pub(super) flips: Vec<Flip>,
    /// Point and squared distance of each vertex.
    nearest: Vec<Option<(usize, f64)>>,
}

impl Contraction {
    /// Starts from a closed mesh.
    pub fn new(triangles: &[[u32; 3]], kept: &[bool], nearest: &[Option<(usize, f64)>]) -> Contraction {
        let mut around = vec![BTreeSet::new(); nearest.len()];
        for (index, triangle) in triangles.iter().enumerate() {
            for &v in triangle {
                around[v as usize].insert(index);
            }
        }
        let original = triangles.to_vec();
        let into = (0..nearest.len() as u32).collect();
        let clusters = (0..nearest.len() as u32).map(|v| vec![v]).collect();
        let triangles = triangles.iter().copied().map(Some).collect();
        let (kept, nearest, flips) = (kept.to_vec(), nearest.to_vec(), Vec::new());
        Contraction { original, kept, into, clusters, triangles, around, flips, nearest }
    }

    /// The vertices that have become `v`.
    pub fn cluster(&self, v: u32) -> Vec<u32> {
        self.clusters[v as usize].clone()
    }

    /// Makes the vertices of a cluster vertices of their own again.
    pub fn take_apart(&mut self, v: u32) {
        for u in self.cluster(v) {
            self.into[u as usize] = u;
            self.clusters[u as usize] = vec![u];
        }
        self.rename();
    }

    /// The triangles from what was, and what vertices have become.
    pub(super) fn rename(&mut self) {
        self.around.iter_mut().for_each(BTreeSet::clear);
        for (index, triangle) in self.original.iter().enumerate() {
            let [a, b, c] = triangle.map(|u| self.into[u as usize]);
            let gone = a == b || b == c || c == a;
            self.triangles[index] = if gone { None } else { Some([a, b, c]) };
            for w in if gone { vec![] } else { vec![a, b, c] } {
                self.around[w as usize].insert(index);
            }
        }
    }

    /// The directed edges opposite to `v` in its triangles.
    pub fn link(&self, v: u32) -> Vec<[u32; 2]> {
        let opposite = |&t: &usize| {
            let [a, b, c] = self.triangles[t].expect("a triangle at a vertex lives");
            if a == v {
                [b, c]
            } else if b == v {
                [c, a]
            } else {
                [a, b]
            }
        };
        self.around[v as usize].iter().map(opposite).collect()
    }

    /// The living triangles that are written, in order.
    pub fn written(&self) -> Vec<[u32; 3]> {
        self.triangles.iter().zip(&self.kept).filter(|(_, kept)| **kept).filter_map(|(t, _)| *t).collect()
    }

    /// Whether a vertex has triangles of both kinds.
    fn on_rim(&self, v: u32) -> bool {
        let kept = |wanted: bool| self.around[v as usize].iter().any(|t| self.kept[*t] == wanted);
        kept(true) && kept(false)
    }

    /// Into how many stretches the written triangles round a vertex fall, if there are others.
    pub fn stretches(&self, v: u32) -> usize {
        let written: Vec<usize> = self.around[v as usize].iter().copied().filter(|t| self.kept[*t]).collect();
        let turned = |t: &usize| {
            let [a, b, c] = self.triangles[*t].expect("a triangle at a vertex lives");
            if a == v {
                [b, c]
            } else if b == v {
                [c, a]
            } else {
                [a, b]
            }
        };
        let edges: Vec<[u32; 2]> = written.iter().map(turned).collect();
        edges.iter().filter(|begin| !edges.iter().any(|end| end[1] == begin[0])).count()
    }

    /// The living triangles of the first triangles that were.
    pub fn triangles_of_first(&self, count: usize) -> Vec<[u32; 3]> {
        self.triangles[..count].iter().flatten().copied().collect()
    }

    /// Contracts what can be contracted between vertices of `allowed`.
    pub fn run(&mut self, allowed: &BTreeSet<u32>) {
        let mut changed = true;
        while changed {
            changed = false;
            for &v in allowed {
                while self.lives(v) {
                    let neighbours = self.neighbours(v);
                    let first = neighbours.into_iter().find(|u| allowed.contains(u) && self.can_contract(v, *u));
                    let Some(u) = first else { break };
                    self.contract(v, u);
                    changed = true;
                }
            }
        }
    }

    /// Whether two vertices have the same point.
    pub fn same_point(&self, u: u32, v: u32) -> bool {
        match (self.nearest[u as usize], self.nearest[v as usize]) {
            (Some((p, _)), Some((q, _))) => p == q,
            _ => false,
        }
    }

    fn lives(&self, v: u32) -> bool {
        !self.around[v as usize].is_empty()
    }

    /// The living vertices, in order.
    pub fn living(&self) -> Vec<u32> {
        (0..self.around.len() as u32).filter(|&v| self.lives(v)).collect()
    }

    /// The numbers of the triangles at a vertex, those included that are gone.
    pub fn at(&self, v: u32) -> Vec<usize> {
        let is_at = |triangle: &[u32; 3]| triangle.iter().any(|u| self.into[*u as usize] == v);
        (0..self.original.len()).filter(|t| is_at(&self.original[*t])).collect()
    }

    /// The living triangles and their numbers, in order.
    pub fn numbered(&self) -> Vec<(usize, [u32; 3])> {
        self.triangles.iter().enumerate().filter_map(|(t, triangle)| Some((t, (*triangle)?))).collect()
    }

    /// The living triangles, in order.
    pub fn triangles(&self) -> Vec<[u32; 3]> {
        self.triangles.iter().flatten().copied().collect()
    }

    /// The vertices that share a triangle with `v`.
    pub fn neighbours(&self, v: u32) -> BTreeSet<u32> {
        let mut neighbours = BTreeSet::new();
        for &t in &self.around[v as usize] {
            neighbours.extend(self.triangles[t].expect("a triangle at a vertex lives"));
        }
        neighbours.remove(&v);
        neighbours
    }

    fn can_contract(&self, u: u32, v: u32) -> bool {
        if !self.same_point(u, v) {
            return false;
        }
        let mut opposite = BTreeSet::new();
        for t in self.around[u as usize].intersection(&self.around[v as usize]) {
            opposite.extend(self.triangles[*t].expect("a triangle at a vertex lives"));
        }
        opposite.remove(&u);
        opposite.remove(&v);
        let (of_u, of_v) = (self.neighbours(u), self.neighbours(v));
        let common: BTreeSet<u32> = of_u.intersection(&of_v).copied().collect();
        let at_edge: Vec<bool> =
            self.around[u as usize].intersection(&self.around[v as usize]).map(|t| self.kept[*t]).collect();
        let across = !(at_edge.contains(&true) && at_edge.contains(&false)) && self.on_rim(u) && self.on_rim(v);
        common == opposite && !(of_u.len() == 3 && of_v.len() == 3) && !across
    }

    /// Makes the two one: the survivor is the one with the smaller distance, or the earlier one.
    fn contract(&mut self, u: u32, v: u32) {
        let d2 = |v: u32| self.nearest[v as usize].expect("only fitted vertices are contracted").1;
        let v_survives = d2(v) < d2(u) || (d2(v) == d2(u) && v < u);
        let (survivor, victim) = if v_survives { (v, u) } else { (u, v) };
        for member in std::mem::take(&mut self.clusters[victim as usize]) {
            self.into[member as usize] = survivor;
            self.clusters[survivor as usize].push(member);
        }
        self.clusters[survivor as usize].sort_unstable();
        for t in std::mem::take(&mut self.around[victim as usize]) {
            let triangle = self.triangles[t].expect("a triangle at a vertex lives");
            if triangle.contains(&survivor) {
                for w in triangle {
                    self.around[w as usize].remove(&t);
                }
                self.triangles[t] = None;
            } else {
                self.triangles[t] = Some(triangle.map(|w| if w == victim { survivor } else { w }));
                self.around[survivor as usize].insert(t);
            }
        }
    }
}
