//! Vertices onto their nearest points: contraction slab by slab, then seam by seam, and the final positions.

use std::collections::{BTreeMap, BTreeSet};

use super::contract::Contraction;
use super::grid::to_file;
use super::plane::Means;
use super::surface::Surface;
use super::{Fit, Params, TwinMesh};

/// How far, in cells, a vertex may be from its point.
const REACH: f64 = 3.0;

/// The nearest point of a vertex: its place in the sorted cloud, and the squared distance.
type Nearest = Option<(usize, f64)>;

fn squared_distance(p: [f64; 3], t: [f64; 3]) -> f64 {
    let (dx, dy, dz) = (p[0] - t[0], p[1] - t[1], p[2] - t[2]);
    dx * dx + dy * dy + dz * dz
}

/// The points in the order that settles ties: by x, y, z, with −0 before 0. Equal points have equal distances, so
/// only the first of them is ever anybody's nearest.
fn sorted(points: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|p, q| p[0].total_cmp(&q[0]).then(p[1].total_cmp(&q[1])).then(p[2].total_cmp(&q[2])));
    sorted
}

fn nearest(t: [f64; 3], sorted: &[[f64; 3]], w: f64) -> Nearest {
    let mut best: Nearest = None;
    for (index, &p) in sorted.iter().enumerate() {
        let d2 = squared_distance(p, t);
        if best.is_none_or(|(_, least)| d2 < least) {
            best = Some((index, d2));
        }
    }
    best.filter(|&(_, d2)| d2 <= (REACH * w) * (REACH * w))
}

/// A surface whose vertices know their points.
pub struct Fitting {
    surface: Surface,
    params: Params,
    /// The points in the order that settles ties.
    sorted: Vec<[f64; 3]>,
    /// T of every vertex.
    targets: Vec<[f64; 3]>,
    nearest: Vec<Nearest>,
    /// Where the planes of the points round them take the vertices.
    projected: Vec<Option<[f64; 3]>>,
}

/// The finished mesh of a surface and the points it is fitted to.
pub fn finish(surface: &Surface, points: &[[f64; 3]], params: &Params) -> TwinMesh {
    let fitting = Fitting::new(surface, points, params);
    let mut contraction = fitting.start();
    if params.fit == Fit::Nearest {
        let slabs = slabs(params);
        for &slab in &slabs {
            contraction.run(&fitting.inner_vertices(slab));
        }
        for &(seam, _) in &slabs[1..] {
            contraction.run(&fitting.seam_vertices(&contraction, seam));
        }
    }
    fitting.place(&contraction)
}

/// First slice and first slice beyond of every slab.
pub fn slabs(params: &Params) -> Vec<(u32, u32)> {
    let last = params.cells[1];
    let starts = (0..last).step_by(params.slab_slices as usize);
    starts.map(|start| (start, last.min(start + params.slab_slices))).collect()
}

impl Fitting {
    /// Finds every vertex's point, if vertices are to be fitted.
    pub fn new(surface: &Surface, points: &[[f64; 3]], params: &Params) -> Fitting {
        let targets: Vec<[f64; 3]> = surface.positions.iter().map(|&q| to_file(q, params)).collect();
        let sorted = sorted(points);
        let nearest = targets
            .iter()
            .zip(&surface.middle)
            .map(
                |(&t, &middle)| {
                    if params.fit == Fit::Nearest && !middle { nearest(t, &sorted, params.w) } else { None }
                },
            )
            .collect();
        let projected = match params.fit {
            Fit::Plane => {
                let means = Means::of(points, params);
                let place = |&q: &[f64; 3]| means.projected(q).map(|q| to_file(q, params));
                surface.positions.iter().map(place).collect()
            }
            Fit::Nearest | Fit::None => vec![None; targets.len()],
        };
        Fitting { projected, surface: surface.clone(), params: params.clone(), sorted, targets, nearest }
    }

    /// Nothing contracted yet.
    pub fn start(&self) -> Contraction {
        Contraction::new(&self.surface.triangles, &self.nearest)
    }

    /// The triangles of one slab and nothing else, nothing contracted yet.
    pub fn start_slab(&self, (start, end): (u32, u32)) -> Contraction {
        let last = if end == self.params.cells[1] { end } else { end - 1 };
        let slices = self.surface.slices.iter();
        let of_slab = slices.zip(&self.surface.triangles).filter(|(slice, _)| (start..=last).contains(slice));
        let triangles: Vec<[u32; 3]> = of_slab.map(|(_, &triangle)| triangle).collect();
        Contraction::new(&triangles, &self.nearest)
    }

    /// Phase 1: the fitted vertices of a slab but those on its first plane, unless it is the first slab.
    pub fn inner_vertices(&self, (start, end): (u32, u32)) -> BTreeSet<u32> {
        let first = if start == 0 { 0 } else { start + 1 };
        let last = if end == self.params.cells[1] { end } else { end - 1 };
        let planes = self.surface.planes.iter().zip(&self.nearest).zip(0u32..);
        let inner = planes.filter(|((plane, point), _)| (first..=last).contains(*plane) && point.is_some());
        inner.map(|(_, v)| v).collect()
    }

    /// Phase 2: what the fitted vertices of a plane reach along edges between vertices with the same point.
    pub fn seam_vertices(&self, contraction: &Contraction, seam: u32) -> BTreeSet<u32> {
        let on_seam = |v: &u32| self.surface.planes[*v as usize] == seam && self.nearest[*v as usize].is_some();
        let mut reached: BTreeSet<u32> = contraction.living().into_iter().filter(on_seam).collect();
        let mut frontier: Vec<u32> = reached.iter().copied().collect();
        while let Some(v) = frontier.pop() {
            for u in contraction.neighbours(v) {
                if contraction.same_point(u, v) && reached.insert(u) {
                    frontier.push(u);
                }
            }
        }
        reached
    }

    /// The final positions and numbers of the vertices that are left.
    pub fn place(&self, contraction: &Contraction) -> TwinMesh {
        let living = contraction.living();
        let mut winners: BTreeMap<usize, (f64, u32)> = BTreeMap::new();
        for &v in &living {
            if let Some((point, d2)) = self.nearest[v as usize] {
                let winner = winners.entry(point).or_insert((d2, v));
                if d2 < winner.0 {
                    *winner = (d2, v);
                }
            }
        }
        let mut mesh = TwinMesh { vertices: Vec::new(), faces: Vec::new() };
        let mut number = BTreeMap::new();
        for v in living {
            number.insert(v, mesh.vertices.len() as u32);
            let t = self.targets[v as usize];
            let position = match self.nearest[v as usize] {
                None => self.projected[v as usize].unwrap_or(t),
                Some((point, _)) if winners[&point].1 == v => self.sorted[point],
                Some((point, _)) => [0, 1, 2].map(|a| t[a] + 0.9 * (self.sorted[point][a] - t[a])),
            };
            mesh.vertices.push(if self.params.single { position.map(|x| f64::from(x as f32)) } else { position });
        }
        mesh.faces = contraction.triangles().into_iter().map(|t| t.map(|v| number[&v])).collect();
        mesh
    }
}
