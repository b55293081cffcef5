//! Vertices onto their nearest points: contraction slab by slab, then seam by seam, and the final positions.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::{Range, RangeInclusive};

use super::contract::Contraction;
use super::corner::Corner;
use super::creases::Creases;
use super::diagonals;
use super::facets::{Centred, Facets};
use super::flips::Asked;
use super::grid::{cell_of, place_in_cell, to_file};
use super::retreat::retreat;
use super::sphere::{Means, outward_of_corner};
use super::surface::Surface;
use super::{Diagonals, Fit, Params, TwinMesh};

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

/// Where a vertex is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum State {
    /// At T: it has no point.
    Smoothed,
    /// On its point.
    Fitted,
    /// At a crease, or so many thirds of the way there from where it would be without.
    Creased(u8),
    /// On the sphere of the points round it.
    Projected,
    /// Where a hole is bridged.
    Bridged,
    /// Most of the way to its point, which another has.
    Pulled,
    /// So many tenths of the way from rest to its point.
    Back(u8),
    /// At rest.
    Rest,
}

/// A surface whose vertices know their points.
pub struct Fitting {
    surface: Surface,
    params: Params,
    /// The points in the order that settles ties.
    sorted: Vec<[f64; 3]>,
    /// T of every vertex.
    targets: Vec<[f64; 3]>,
    /// R of every vertex.
    rest: Vec<[f64; 3]>,
    nearest: Vec<Nearest>,
    /// Where the spheres of the points round them take the vertices.
    projected: Vec<Option<[f64; 3]>>,
    /// Where vertices go instead of their points, and what they go back to first.
    centred: Vec<Option<Centred>>,
    /// The places of vertices at creases.
    creased: Vec<Option<[f64; 3]>>,
}

/// The finished mesh of a surface and the points it is fitted to.
pub fn finish(surface: &Surface, points: &[[f64; 3]], params: &Params) -> TwinMesh {
    let fitting = Fitting::new(surface, points, params);
    let mut contraction = fitting.start();
    let is_projected = |place: &Option<[f64; 3]>| if place.is_some() { State::Projected } else { State::Smoothed };
    let mut states: Vec<State> = fitting.projected.iter().map(is_projected).collect();
    for (state, _) in states.iter_mut().zip(&surface.bridged).filter(|(_, bridged)| **bridged) {
        *state = State::Bridged;
    }
    let slabs = slabs(params);
    let plane = |v: u32| surface.planes[v as usize];
    for &slab in &slabs {
        contraction.run(&fitting.inner_vertices(slab));
        let living = contraction.living().into_iter().filter(|&v| fitting.planes(slab).contains(&plane(v)));
        fitting.choose(&living.collect::<Vec<_>>(), &mut states);
    }
    for &slab in &slabs {
        let inner = fitting.inner_planes(slab);
        let among = |t: [u32; 3]| t.iter().all(|&v| inner.contains(&plane(v)));
        if matches!(params.fit, Fit::Facets | Fit::Sphere) && params.diagonals == Diagonals::Delaunay {
            let asked = Asked {
                inside: &|v| inner.contains(&plane(v)),
                place: &|v| fitting.written(v, states[v as usize]),
                creased: &|v| matches!(states[v as usize], State::Creased(_)),
            };
            contraction.flip(fitting.triangles_of(slab), &asked);
        }
        retreat(&fitting, &mut contraction, &mut states, &among, 0);
    }
    for pair in slabs.windows(2) {
        let [lower, upper] = [pair[0], pair[1]];
        contraction.run(&fitting.seam_vertices(&contraction, &states, upper.0));
        let fitted = |v: &u32| matches!(states[*v as usize], State::Fitted | State::Creased(_));
        let fitted: Vec<u32> = contraction.living().into_iter().filter(fitted).collect();
        let near = |v: &u32| fitting.planes(lower).contains(&plane(*v)) || fitting.planes(upper).contains(&plane(*v));
        fitting.choose(&fitted.into_iter().filter(near).collect::<Vec<_>>(), &mut states);
        let last = *fitting.planes(upper).end();
        let among = |t: [u32; 3]| t.iter().all(|&v| plane(v) <= last);
        let written = surface.slices.iter().filter(|&&slice| slice < lower.0).count();
        let settled = contraction.triangles_of_first(written).into_iter().flatten().max().map_or(0, |v| v + 1);
        retreat(&fitting, &mut contraction, &mut states, &among, settled);
    }
    fitting.place(&contraction, &states)
}

/// A place in the input's precision.
fn as_input(place: [f64; 3], params: &Params) -> [f64; 3] {
    if params.single { place.map(|x| f64::from(x as f32)) } else { place }
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
        let rest = surface.rest.iter().map(|&q| to_file(q, params)).collect();
        let sorted = sorted(points);
        let finds_point = |v: usize| {
            matches!(params.fit, Fit::Facets | Fit::Nearest)
                && !(surface.middle[v] || surface.bridged[v] || surface.cut_off[v])
        };
        let nearest: Vec<Nearest> = (0..targets.len())
            .map(|v| if finds_point(v) { nearest(targets[v], &sorted, params.w) } else { None })
            .collect();
        let mut projected: Vec<Option<[f64; 3]>> = match params.fit {
            Fit::Sphere => {
                let means = Means::of(points, &surface.solid, params);
                // A middle of a doubled edge has no side.
                let side = |corner: Corner| outward_of_corner(&surface.solid, corner);
                let place = |(&q, corner): (&[f64; 3], &Option<Corner>)| {
                    means.projected(q, corner.map_or([0.0; 3], side)).map(|q| as_input(to_file(q, params), params))
                };
                surface.positions.iter().zip(&surface.corners).map(place).collect()
            }
            Fit::Facets | Fit::Nearest | Fit::None => vec![None; targets.len()],
            Fit::Auto | Fit::AutoPoints => panic!("chosen before"),
        };
        for v in (0..targets.len()).filter(|v| surface.bridged[*v]) {
            projected[v] = Some(as_input(targets[v], params));
        }
        let (centred, creased) = (vec![None; targets.len()], vec![None; targets.len()]);
        let (surface, params) = (surface.clone(), params.clone());
        let mut fitting = Fitting { projected, surface, params, sorted, targets, rest, nearest, centred, creased };
        let places = fitting.places();
        if fitting.chooses_diagonals() {
            fitting.choose_diagonals(&places);
        }
        if fitting.params.fit == Fit::Facets {
            fitting.centre(points, &places);
        }
        fitting
    }

    /// Where vertices are, in cells: at their points.
    fn places(&self) -> Vec<[f64; 3]> {
        let place = |(v, point): (usize, &Nearest)| match point {
            None => self.surface.positions[v],
            Some((point, _)) => {
                let (cell, within) =
                    (cell_of(self.sorted[*point], &self.params), place_in_cell(self.sorted[*point], &self.params));
                [0, 1, 2].map(|a| f64::from(cell[a]) + within[a])
            }
        };
        self.nearest.iter().enumerate().map(place).collect()
    }

    /// Diagonals once more; where facets are not fitted, a slab knows the places of its own vertices only.
    fn choose_diagonals(&mut self, places: &[[f64; 3]]) {
        let slabs = slabs(&self.params);
        let planes: Vec<RangeInclusive<u32>> = slabs.iter().map(|slab| self.planes(*slab)).collect();
        let (of_vertex, knows_all) = (self.surface.planes.clone(), self.params.fit == Fit::Facets);
        let known = |slice: u32, corners: [u32; 4]| {
            let slab = slabs.iter().rposition(|(start, _)| *start <= slice).expect("a slice has a slab");
            knows_all || corners.iter().all(|v| planes[slab].contains(&of_vertex[*v as usize]))
        };
        diagonals::choose(&mut self.surface, places, &known);
    }

    /// Moves the vertices of each slab so that facets pass amid the points.
    fn centre(&mut self, points: &[[f64; 3]], places: &[[f64; 3]]) {
        let numbers: Vec<Option<usize>> = self.nearest.iter().map(|point| point.map(|(number, _)| number)).collect();
        let means = Means::of(points, &self.surface.solid, &self.params);
        let creases = Creases { surface: &self.surface, places, points: &numbers };
        let place = |v: u32| if self.params.open.is_none() { creases.place(v) } else { None };
        let creased: Vec<Option<[f64; 3]>> = (0..places.len() as u32).map(place).collect();
        let facets = Facets { surface: &self.surface, places, points: &numbers, means: &means, creases: &creased };
        let mut out = vec![None; places.len()];
        for (start, end) in slabs(&self.params) {
            let own = self.planes((start, end));
            let near = start.saturating_sub(1)..=*own.end() + 1;
            // Open surfaces have no creases, so that slabs know less.
            let known = match self.params.open {
                None => start.saturating_sub(2)..=*own.end() + 1,
                Some(_) => start.saturating_sub(1)..=*own.end(),
            };
            for (v, centred) in facets.centred(&own, &near, &known) {
                out[v as usize] = Some(centred.map(|place| self.as_input(place)));
            }
        }
        self.creased = creased.into_iter().map(|place| place.map(|place| self.as_input(place))).collect();
        self.centred = out;
    }

    /// Whether diagonals are chosen where vertices go.
    fn chooses_diagonals(&self) -> bool {
        matches!(self.params.fit, Fit::Facets | Fit::Nearest) && self.params.diagonals == Diagonals::Delaunay
    }

    /// The numbers of a slab's triangles.
    fn triangles_of(&self, (start, end): (u32, u32)) -> Range<usize> {
        let last = if end == self.params.cells[1] { end } else { end - 1 };
        let before = |slice: u32| self.surface.slices.iter().filter(|of| **of < slice).count();
        before(start)..before(last + 1)
    }

    /// A place in cells in file coordinates and in the input's precision.
    fn as_input(&self, place: [f64; 3]) -> [f64; 3] {
        as_input(to_file(place, &self.params), &self.params)
    }

    /// Nothing contracted yet.
    pub fn start(&self) -> Contraction {
        Contraction::new(&self.surface.triangles, &self.surface.kept, &self.nearest)
    }

    /// The triangles of one slab and nothing else, nothing contracted yet.
    pub fn start_slab(&self, (start, end): (u32, u32)) -> Contraction {
        let last = if end == self.params.cells[1] { end } else { end - 1 };
        let slices = self.surface.slices.iter();
        let triangles = slices.zip(self.surface.triangles.iter().zip(&self.surface.kept));
        let of_slab = triangles.filter(|(slice, _)| (start..=last).contains(slice));
        let (triangles, kept): (Vec<[u32; 3]>, Vec<bool>) = of_slab.map(|(_, (t, kept))| (*t, *kept)).unzip();
        Contraction::new(&triangles, &kept, &self.nearest)
    }

    /// Phase 1: the fitted vertices of a slab but those on its first plane, unless it is the first slab.
    pub fn inner_vertices(&self, (start, end): (u32, u32)) -> BTreeSet<u32> {
        let within = self.inner_planes((start, end));
        let planes = self.surface.planes.iter().zip(&self.nearest).zip(0u32..);
        let inner = planes.filter(|((plane, point), _)| within.contains(plane) && point.is_some());
        inner.map(|(_, v)| v).collect()
    }

    /// The planes of a slab.
    fn planes(&self, (start, end): (u32, u32)) -> RangeInclusive<u32> {
        start..=if end == self.params.cells[1] { end } else { end - 1 }
    }

    /// The planes of a slab but its first, unless it is the first slab.
    fn inner_planes(&self, (start, end): (u32, u32)) -> RangeInclusive<u32> {
        (if start == 0 { 0 } else { start + 1 })..=*self.planes((start, end)).end()
    }

    /// Phase 2: what the fitted vertices of a plane reach along edges between vertices with the same point.
    pub fn seam_vertices(&self, contraction: &Contraction, states: &[State], seam: u32) -> BTreeSet<u32> {
        let on_point = |v: u32| matches!(states[v as usize], State::Fitted | State::Creased(_) | State::Pulled);
        let on_seam = |v: &u32| self.surface.planes[*v as usize] == seam && on_point(*v);
        let mut reached: BTreeSet<u32> = contraction.living().into_iter().filter(on_seam).collect();
        let mut frontier: Vec<u32> = reached.iter().copied().collect();
        while let Some(v) = frontier.pop() {
            for u in contraction.neighbours(v) {
                if on_point(u) && contraction.same_point(u, v) && reached.insert(u) {
                    frontier.push(u);
                }
            }
        }
        reached
    }

    /// Of the vertices that have the same point, the nearest is fitted, the others are pulled.
    fn choose(&self, vertices: &[u32], states: &mut [State]) {
        let before = states.to_vec();
        let mut winners: BTreeMap<usize, (f64, u32)> = BTreeMap::new();
        for &v in vertices {
            if let Some((point, d2)) = self.nearest[v as usize] {
                states[v as usize] = State::Pulled;
                let winner = winners.entry(point).or_insert((d2, v));
                if d2 < winner.0 {
                    *winner = (d2, v);
                }
            }
        }
        for (_, v) in winners.into_values() {
            states[v as usize] = match before[v as usize] {
                State::Creased(thirds) => State::Creased(thirds),
                State::Smoothed if self.creased[v as usize].is_some() => State::Creased(3),
                _ => State::Fitted,
            };
        }
    }

    /// The position of a vertex in file coordinates.
    fn position(&self, v: u32, state: State) -> [f64; 3] {
        let (t, rest) = (self.targets[v as usize], self.rest[v as usize]);
        let point = || match (self.projected[v as usize], self.centred[v as usize]) {
            (Some(place), _) | (None, Some([place, _])) => place,
            (None, None) => self.sorted[self.nearest[v as usize].expect("it has a point").0],
        };
        match state {
            State::Smoothed => t,
            State::Fitted | State::Projected | State::Bridged => point(),
            State::Creased(thirds) => {
                let (crease, without) = (self.creased[v as usize].expect("it has"), point());
                [0, 1, 2].map(|a| without[a] + f64::from(thirds) / 3.0 * (crease[a] - without[a]))
            }
            State::Pulled => [0, 1, 2].map(|a| t[a] + 0.9 * (point()[a] - t[a])),
            State::Back(tenths) if self.centred[v as usize].is_some_and(|[onto, beside]| onto != beside) => {
                let [onto, beside] = self.centred[v as usize].expect("it has");
                match tenths {
                    9 => [0, 1, 2].map(|a| beside[a] + 2.0 / 3.0 * (onto[a] - beside[a])),
                    8 => [0, 1, 2].map(|a| beside[a] + 1.0 / 3.0 * (onto[a] - beside[a])),
                    7 => beside,
                    _ => {
                        let share = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6][usize::from(tenths)];
                        [0, 1, 2].map(|a| rest[a] + share * (beside[a] - rest[a]))
                    }
                }
            }
            State::Back(tenths) => {
                let share = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9][usize::from(tenths)];
                [0, 1, 2].map(|a| rest[a] + share * (point()[a] - rest[a]))
            }
            State::Rest => rest,
        }
    }

    /// Whether a vertex is where one step of smoothing puts it, and has no other contracted into it.
    pub fn is_at_rest(&self, v: u32, state: State) -> bool {
        state == State::Rest || state == State::Smoothed && self.targets[v as usize] == self.rest[v as usize]
    }

    /// The position of a vertex as it is written.
    pub fn written(&self, v: u32, state: State) -> [f64; 3] {
        let position = self.position(v, state);
        let origin = self.params.origin;
        let moved = [0, 1, 2].map(|a| position[a] - origin[a]);
        as_input(moved, &self.params)
    }

    /// The final positions and numbers of the vertices that are left.
    fn place(&self, contraction: &Contraction, states: &[State]) -> TwinMesh {
        let mut mesh = TwinMesh { vertices: Vec::new(), faces: Vec::new() };
        let mut number = BTreeMap::new();
        let triangles = contraction.written();
        let named: BTreeSet<u32> = triangles.iter().flatten().copied().collect();
        for v in named {
            number.insert(v, mesh.vertices.len() as u32);
            mesh.vertices.push(self.written(v, states[v as usize]));
        }
        mesh.faces = triangles.into_iter().map(|t| t.map(|v| number[&v])).collect();
        mesh
    }
}
