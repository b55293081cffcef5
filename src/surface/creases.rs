//! Creases: the sharp edges and corners of a surface, which points hardly ever lie on.
//!
//! ```text
//!    o---o---o               Vertices lie on points, so triangles lead from one side of an edge to the other and cut it off; where they cut off now more, now less, it has
//!   side A    \              teeth. The triangles on both sides tell how these go on, and where they meet (x). Of each edge of the mesh that leads from side to side, the
//!              \  x         end that has less far to go moves there. The other stays: so no triangle loses its area.
//!               \
//!                o           Whether there are sides at all is decided by the vertices in sight. If one smooth surface lies about as near to them as several sides do, that is
//!         side B |           no crease, however strongly it bends. Sides may be curved themselves: they are paraboloids.
//!                o
//! ```
//!
//! Source: own. That a feature is seen by how normals fall apart, and that a vertex goes where planes meet, is L. P. Kobbelt et al., Feature sensitive surface extraction from volume
//! data (2001).

use crate::points::vector::{cross, dot, minus};
use crate::surface::contract::NONE;
use crate::surface::facets::{Creased, Facets, Stars};
use crate::surface::paraboloid::{Paraboloid, Plane};
use crate::surface::vertices::{Kind, Vertex};

/// How far a vertex sees, in cells along each axis, from its corner to those of triangles. Seeing three cells far is no better: there is more to see that is neither side.
const SIGHT: u32 = 2;

/// Creases of a slab and of the planes next to it are decided by the vertices of so many planes beside it.
pub const PLANES_BESIDE: u32 = SIGHT + 1;

/// Triangles whose normals have this cosine or more bend no more than a side may from one triangle to the next: 6°.
const FLAT: f64 = 0.9945;

/// A vertex with a triangle whose normal has a smaller cosine to their mean is bent; with none bent at its point, a vertex is at no crease: 15°.
const BENT: f64 = 0.9659;

/// Normals of one side: 15° from its densest.
const ALIKE: f64 = 0.9659;

/// A crease turns by more than this: 30°.
const SHARP: f64 = 0.8660;

/// And by less than this: 150°. Sides that meet at less than 30° are as likely those of a thin wall, which end in a rim; and where they meet is far off.
const THIN: f64 = -0.8660;

/// A crease that turns by more than this, 130°, is acute.
const ACUTE: f64 = -0.6428;

/// Sides of less than this part of the first's weight are none.
const LIGHT: f64 = 0.1;

/// At most so many sides.
const SIDES: usize = 3;

/// How many times nearer to the vertices the sides must lie than one smooth surface. With 3 times, folds of a horse's mane get edges that they have not; with 8 times, machine parts keep nearly all of theirs.
const NEARER: f64 = 8.0;

/// And at an acute crease, where what bends a little meets far off: with 8 times, a horse's ears grow beyond their tips.
const NEARER_IF_ACUTE: f64 = 30.0;

/// The part of the vertices, by weight, that may lie anywhere: where edges end, a third or fourth surface is in sight, too.
const ELSEWHERE: f64 = 0.1;

/// The side of triangles that are of none.
const NO_SIDE: u8 = u8::MAX;

/// What curvature costs a side ([`Paraboloid::through`]), of which few triangles are known; and one smooth surface.
const STIFF: f64 = 0.2;
const LITHE: f64 = 0.001;

/// How far a vertex goes at most, in edges of the triangles round it.
const FARTHEST: f64 = 2.5;

/// The same for an acute crease: farther off, a third side may end the body before its two meet.
const FARTHEST_IF_ACUTE: f64 = 1.0;

/// And in cells. Its point is up to [`crate::grid::partition::REACH`] away from where smoothing put it, and seams look for vertices no farther off than [`crate::grid::partition::TRAVEL`].
const FARTHEST_IN_CELLS: f64 = 3.0;

/// Three planes whose normals span less than this meet along a line rather than in a corner.
const SPAN: f64 = 0.25;

/// The place where sides meet is found from planes that touch them, so many times: each time from planes that touch them nearer to it.
const ROUNDS: usize = 3;

/// A triangle in sight that has an area.
#[derive(Debug, Clone, Copy)]
struct Face {
    number: u32,
    /// Its corners' places, as numbers in [`View::places`].
    places: [u32; 3],
    /// Of length 1.
    normal: [f64; 3],
    middle: [f64; 3],
    area: f64,
    /// Area times nearness.
    weight: f64,
}

/// What a vertex sees: it is emptied for each.
#[derive(Debug, Default)]
struct View {
    /// The number of the view, and of the last that each vertex and triangle is in.
    number: u32,
    of_vertex: Vec<u32>,
    of_triangle: Vec<u32>,
    /// The number of each vertex's place, if it is in the view.
    place_of: Vec<u32>,
    /// The vertices, in the surface's order.
    vertices: Vec<u32>,
    /// The triangles, likewise.
    faces: Vec<Face>,
    /// The places of the vertices, each once, and how near they are: in the order of the first vertex at each.
    places: Vec<([f64; 3], f64)>,
    /// The length of an edge, were all triangles alike.
    edge: f64,
    // Scratch.
    points: Vec<u32>,
    edges: Vec<u64>,
    beside: Vec<[u8; 2]>,
    flat: Vec<u32>,
    side_of: Vec<u8>,
    on_side: Vec<bool>,
}

impl Facets<'_> {
    /// The vertices at creases: of the slab and of the planes next to it. `put` is told those of the slab, counted from its first, and where they go, in cells.
    ///
    /// Memory: less than [`Facets::centre`] needs; and what one vertex sees.
    pub fn creases(&self, stars: &Stars, mut put: impl FnMut(usize, [f64; 3])) -> Vec<Creased> {
        let bent: Vec<bool> = (0..self.vertices.len() as u32).map(|v| self.is_bent(stars, v)).collect();
        let mut view = View {
            of_vertex: vec![0; self.vertices.len()],
            place_of: vec![0; self.vertices.len()],
            of_triangle: vec![0; self.triangle_count() as usize],
            ..View::default()
        };
        let mut creases = Vec::new();
        for v in self.on_planes(self.next_planes()).filter(|v| self.points[*v as usize] != NONE) {
            // The triangles at its point are those at all vertices that have it.
            let is_bent = |u: u32| bent[u as usize] && self.points[u as usize] == self.points[v as usize];
            if stars.at(v).iter().flat_map(|t| self.triangle(*t)).any(is_bent) {
                self.look(stars, v, &mut view);
                if let Some(place) = view.crease(v) {
                    let way = minus(place, self.places[v as usize]).map(|c| c as f32);
                    creases.push(Creased { vertex: v, way });
                    if self.own.contains(&v) {
                        put((v - self.own.start) as usize, place);
                    }
                }
            }
        }
        creases
    }

    fn is_bent(&self, stars: &Stars, v: u32) -> bool {
        let normals = || stars.at(v).iter().filter_map(|t| self.facet(*t)).map(|facet| facet.normal);
        let mut sum = [0.0; 3];
        normals().for_each(|normal| add(&mut sum, 1.0, normal));
        let length2 = dot(sum, sum);
        normals().any(|normal| {
            let along = dot(normal, sum);
            along <= 0.0 || along * along < BENT * BENT * length2 * dot(normal, normal)
        })
    }

    /// What vertex `v` sees: the triangles that hang together with it through vertices in sight.
    fn look(&self, stars: &Stars, v: u32, view: &mut View) {
        let corner = self.vertices[v as usize].corner;
        let is_in_sight = |corners: [u32; 3]| {
            let vertices = corners.map(|u| &self.vertices[u as usize]);
            let near = |vertex: &Vertex| (0..3).all(|a| vertex.corner[a].abs_diff(corner[a]) <= SIGHT);
            // A midpoint has no corner of its own. What lies in the highest plane belongs to the slice above it, which a slab does not know.
            vertices.iter().all(|vertex| matches!(vertex.kind, Kind::Sheet(_)) && near(vertex))
                && vertices.iter().any(|vertex| vertex.corner[1] < corner[1] + SIGHT)
        };
        view.number += 1;
        view.faces.clear();
        view.vertices.clear();
        view.vertices.push(v);
        view.of_vertex[v as usize] = view.number;
        let mut next = 0;
        while next < view.vertices.len() {
            for t in stars.at(view.vertices[next]) {
                if std::mem::replace(&mut view.of_triangle[*t as usize], view.number) == view.number {
                    continue;
                }
                let corners = self.triangle(*t);
                if !is_in_sight(corners) {
                    continue;
                }
                for u in corners {
                    if std::mem::replace(&mut view.of_vertex[u as usize], view.number) != view.number {
                        view.vertices.push(u);
                    }
                }
                view.faces.extend(self.face(*t));
            }
            next += 1;
        }
        view.vertices.sort_unstable();
        view.faces.sort_unstable_by_key(|face| face.number);
        let area = view.faces.iter().fold(0.0, |sum, face| sum + face.area);
        // An equilateral triangle of side e has an area of √3/4 · e².
        let edge2 = area / view.faces.len() as f64 * (4.0 / 3f64.sqrt());
        view.edge = edge2.sqrt();
        let at = self.places[v as usize];
        let nearness = |place: [f64; 3]| {
            let way = minus(place, at);
            let near = 1.0 / (1.0 + dot(way, way) / (8.0 * edge2));
            near * near
        };
        view.points.clear();
        view.places.clear();
        for u in &view.vertices {
            let point = self.points[*u as usize];
            let known = view.points.iter().position(|other| *other == point).filter(|_| point != NONE);
            view.place_of[*u as usize] = known.unwrap_or_else(|| {
                let place = self.places[*u as usize];
                view.points.push(point);
                view.places.push((place, nearness(place)));
                view.points.len() - 1
            }) as u32;
        }
        for face in &mut view.faces {
            face.places = face.places.map(|u| view.place_of[u as usize]);
            face.weight = face.area * nearness(face.middle);
        }
    }

    /// Triangle `t` as a face, with its vertices instead of their places, if it has an area.
    #[inline]
    fn face(&self, t: u32) -> Option<Face> {
        let facet = self.facet(t)?;
        let length = dot(facet.normal, facet.normal).sqrt();
        let [a, b, c] = facet.corners;
        Some(Face {
            number: t,
            places: facet.vertices,
            normal: facet.normal.map(|c| c / length),
            middle: std::array::from_fn(|i| (a[i] + b[i] + c[i]) / 3.0),
            area: length / 2.0,
            weight: 0.0,
        })
    }
}

impl View {
    /// Where vertex `v` goes, if it lies at a crease and an edge leads across it to a vertex that has farther to go.
    fn crease(&mut self, v: u32) -> Option<[f64; 3]> {
        let sides = self.sides();
        let own = self.place_of[v as usize];
        let (at, _) = self.places[own as usize];
        let place = meeting(&sides, at)?;
        let (mut sharp, mut acute, mut thin) = (false, false, false);
        let normals: Vec<[f64; 3]> = sides.iter().map(|side| side.touching(place).normal).collect();
        for (i, normal) in normals.iter().enumerate() {
            for other in &normals[..i] {
                let cosine = dot(*normal, *other);
                sharp |= cosine < SHARP;
                acute |= cosine < ACUTE;
                thin |= cosine < THIN;
            }
        }
        let squared = |p: [f64; 3], q: [f64; 3]| dot(minus(p, q), minus(p, q));
        let way2 = squared(place, at);
        let (farthest, nearer) = if acute { (FARTHEST_IF_ACUTE, NEARER_IF_ACUTE) } else { (FARTHEST, NEARER) };
        let farthest = (farthest * self.edge).min(FARTHEST_IN_CELLS);
        if !sharp || thin || way2 > farthest * farthest || !self.are_sides_nearer(&sides, nearer) {
            return None;
        }
        let nearest = |place: [f64; 3]| {
            let by_distance = |(i, side): (usize, &Paraboloid)| (side.distance(place), i);
            sides.iter().enumerate().map(by_distance).min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let (_, side) = nearest(at)?;
        let leads_across = |u: u32| {
            let (there, _) = self.places[u as usize];
            if nearest(there).is_none_or(|(distance, other)| other == side || distance > self.edge / 2.0) {
                return false;
            }
            let theirs2 = meeting(&sides, there).map_or(f64::INFINITY, |place| squared(place, there));
            // Of two that have equally far to go, the first by place.
            (way2, at) < (theirs2, there)
        };
        let beside = self.faces.iter().filter(|face| face.places.contains(&own)).flat_map(|face| face.places);
        beside.filter(|u| *u != own).any(leads_across).then_some(place)
    }

    /// Finds the triangles that are flat: of those beside it, one at least has about the same normal, and one at most has not.
    fn find_flat(&mut self) {
        let View { faces, edges, beside, flat, .. } = self;
        edges.clear();
        for (i, face) in (0u64..).zip(faces.iter()) {
            let [a, b, c] = face.places.map(u64::from);
            edges.extend([[a, b], [b, c], [c, a]].map(|[a, b]| a.min(b) << 42 | a.max(b) << 21 | i));
        }
        edges.sort_unstable();
        beside.clear();
        beside.resize(faces.len(), [0; 2]);
        for same in edges.chunk_by(|a, b| a >> 21 == b >> 21) {
            if let [a, b] = *same {
                let [a, b] = [a, b].map(|key| (key & 0x1f_ffff) as usize);
                let bent = usize::from(dot(faces[a].normal, faces[b].normal) < FLAT);
                beside[a][bent] += 1;
                beside[b][bent] += 1;
            }
        }
        flat.clear();
        flat.extend((0u32..).zip(&*beside).filter(|(_, [alike, bent])| *alike >= 1 && *bent <= 1).map(|(i, _)| i));
    }

    /// The smooth surfaces in sight, if there are several: each through flat triangles whose normals are alike, the densest first.
    fn sides(&mut self) -> Vec<Paraboloid> {
        self.find_flat();
        let View { faces, places, edge, flat, side_of, on_side, .. } = self;
        side_of.clear();
        side_of.resize(faces.len(), NO_SIDE);
        let mut planes: Vec<Plane> = Vec::with_capacity(SIDES);
        let mut first = 0.0;
        while planes.len() < SIDES {
            let (mut most, mut main) = (0.0, None);
            for normal in flat.iter().map(|i| faces[*i as usize].normal) {
                let alike = flat.iter().map(|i| &faces[*i as usize]).filter(|face| dot(normal, face.normal) > ALIKE);
                let density = alike.fold(0.0, |sum, face| sum + face.weight);
                if density > most {
                    (most, main) = (density, Some(normal));
                }
            }
            let Some(main) = main.filter(|_| most >= LIGHT * first) else { break };
            if planes.is_empty() {
                first = most;
            }
            let (mut normal, mut middle) = ([0.0; 3], [0.0; 3]);
            flat.retain(|i| {
                let face = &faces[*i as usize];
                let is_alike = dot(main, face.normal) > ALIKE;
                if is_alike {
                    side_of[*i as usize] = planes.len() as u8;
                    add(&mut normal, face.weight, face.normal);
                    add(&mut middle, face.weight, face.middle);
                }
                !is_alike
            });
            planes.push(Plane { normal, place: middle.map(|c| c / most) });
        }
        if planes.len() < 2 {
            return Vec::new();
        }
        let side = |(number, plane): (u8, Plane)| {
            on_side.clear();
            on_side.resize(places.len(), false);
            for (face, _) in faces.iter().zip(&*side_of).filter(|(_, side)| **side == number) {
                face.places.iter().for_each(|u| on_side[*u as usize] = true);
            }
            let through = places.iter().zip(&*on_side).filter(|(_, is_on)| **is_on).map(|(place, _)| *place);
            Paraboloid::through(plane, through, *edge, STIFF)
        };
        (0..).zip(planes).map(side).collect()
    }

    /// Whether the vertices in sight lie so many times nearer to the sides than to one smooth surface.
    fn are_sides_nearer(&self, sides: &[Paraboloid], times: f64) -> bool {
        let mut normal = [0.0; 3];
        self.faces.iter().for_each(|face| add(&mut normal, face.weight, face.normal));
        if dot(normal, normal) <= 0.0 {
            return false;
        }
        let (mut middle, mut all) = ([0.0; 3], 0.0);
        for (place, weight) in &self.places {
            add(&mut middle, *weight, *place);
            all += weight;
        }
        let plane = Plane { normal, place: middle.map(|c| c / all) };
        let one = Paraboloid::through(plane, self.places.iter().copied(), self.edge, LITHE);
        let from_side = |place| sides.iter().map(|side| side.distance(place)).fold(f64::INFINITY, f64::min);
        let mut distances: Vec<[f64; 3]> =
            self.places.iter().map(|(place, weight)| [from_side(*place), one.distance(*place), *weight]).collect();
        distances.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let (mut from_one, mut from_sides, mut counted) = (0.0, 0.0, 0.0);
        for [from_side, from, weight] in distances {
            counted += weight;
            if counted > (1.0 - ELSEWHERE) * all {
                break;
            }
            from_one += weight * from;
            from_sides += weight * from_side;
        }
        times * from_sides <= from_one
    }
}

#[inline]
fn add(sum: &mut [f64; 3], weight: f64, of: [f64; 3]) {
    sum.iter_mut().zip(of).for_each(|(sum, c)| *sum += weight * c);
}

/// The place nearest to `at` where sides meet: all three in a corner, or else two along a line.
fn meeting(sides: &[Paraboloid], at: [f64; 3]) -> Option<[f64; 3]> {
    if sides.len() < 2 {
        return None;
    }
    let mut place = at;
    for _ in 0..ROUNDS {
        let mut planes = [sides[0].touching(place); SIDES];
        planes.iter_mut().zip(sides).for_each(|(plane, side)| *plane = side.touching(place));
        place = meeting_of_planes(&planes[..sides.len()], at)?;
    }
    Some(place)
}

fn meeting_of_planes(planes: &[Plane], at: [f64; 3]) -> Option<[f64; 3]> {
    let above = |plane: &Plane| dot(plane.normal, minus(plane.place, at));
    if let [a, b, c] = planes {
        let (bc, ca, ab) = (cross(b.normal, c.normal), cross(c.normal, a.normal), cross(a.normal, b.normal));
        let span = dot(a.normal, bc);
        if span.abs() >= SPAN {
            let (a, b, c) = (above(a) / span, above(b) / span, above(c) / span);
            return Some(std::array::from_fn(|i| at[i] + (a * bc[i] + b * ca[i] + c * ab[i])));
        }
    }
    let mut pairs = planes.iter().enumerate().flat_map(|(i, a)| planes[i + 1..].iter().map(move |b| (a, b)));
    let (a, b) = pairs.find(|(a, b)| dot(a.normal, b.normal).abs() < SHARP)?;
    let cosine = dot(a.normal, b.normal);
    let rest = 1.0 - cosine * cosine;
    let (by_a, by_b) = ((above(a) - cosine * above(b)) / rest, (above(b) - cosine * above(a)) / rest);
    Some(std::array::from_fn(|i| at[i] + (by_a * a.normal[i] + by_b * b.normal[i])))
}
