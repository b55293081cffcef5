//! Places at sharp edges, as the specification says: every vertex looks at all triangles anew.

use std::collections::BTreeSet;

use super::sphere::dot;
use super::surface::Surface;

/// How many cells a vertex sees along each axis.
const SIGHT: i64 = 2;

/// A surface, the place of each vertex in cells, and the number of its point.
pub struct Creases<'a> {
    pub surface: &'a Surface,
    pub places: &'a [[f64; 3]],
    pub points: &'a [Option<usize>],
}

type Place = [f64; 3];

/// Places of some vertices, and how near they are.
type Places<'a> = dyn Fn(&BTreeSet<u32>) -> Vec<(Place, f64)> + 'a;

fn minus(p: Place, q: Place) -> Place {
    [0, 1, 2].map(|a| p[a] - q[a])
}

fn cross(u: Place, v: Place) -> Place {
    [0, 1, 2].map(|a| u[(a + 1) % 3] * v[(a + 2) % 3] - u[(a + 2) % 3] * v[(a + 1) % 3])
}

fn length(u: Place) -> f64 {
    dot(u, u).sqrt()
}

/// A triangle that a vertex sees.
struct Seen {
    vertices: [u32; 3],
    normal: Place,
    middle: Place,
    area: f64,
    near: f64,
}

impl Seen {
    fn weight(&self) -> f64 {
        self.area * self.near
    }
}

/// A surface of the second degree over a plane.
struct Side {
    origin: Place,
    /// The directions of u, v and of the height.
    frame: [Place; 3],
    height: [f64; 6],
}

impl Side {
    fn through(normal: Place, origin: Place, places: &[(Place, f64)], unit: f64, stiffness: f64) -> Side {
        let up = normal.map(|c| c / length(normal));
        let u = cross(up, if up[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] });
        let u = u.map(|c| c / length(u));
        let mut side = Side { origin, frame: [u, cross(up, u), up], height: [0.0; 6] };
        let mut matrix = [[0.0; 7]; 6];
        for (place, weight) in places {
            let [u, v, above] = side.over(*place);
            let t = Side::terms(u / unit, v / unit);
            for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
                matrix[i][j] += weight * t[i] * t[j];
            }
            (0..6).for_each(|i| matrix[i][6] += weight * t[i] * (above / unit));
        }
        let all = places.iter().fold(0.0, |sum, (_, weight)| sum + weight);
        (1..3).for_each(|i| matrix[i][i] += 1e-6 * all);
        (3..6).for_each(|i| matrix[i][i] += stiffness * all);
        for i in 0..6 {
            for j in (0..6).filter(|j| *j != i) {
                let factor = matrix[j][i] / matrix[i][i];
                let row = matrix[i];
                matrix[j].iter_mut().zip(row).for_each(|(entry, other)| *entry -= factor * other);
            }
        }
        let solved: Vec<f64> = (0..6).map(|i| matrix[i][6] / matrix[i][i]).collect();
        side.height = [solved[0] * unit, solved[1], solved[2], solved[3] / unit, solved[4] / unit, solved[5] / unit];
        side
    }

    fn terms(u: f64, v: f64) -> [f64; 6] {
        [1.0, u, v, u * u / 2.0, u * v, v * v / 2.0]
    }

    fn over(&self, place: Place) -> [f64; 3] {
        self.frame.map(|direction| dot(direction, minus(place, self.origin)))
    }

    fn height(&self, u: f64, v: f64) -> f64 {
        let terms = Side::terms(u, v);
        (0..6).fold(0.0, |sum, i| sum + terms[i] * self.height[i])
    }

    fn distance(&self, place: Place) -> f64 {
        let [u, v, above] = self.over(place);
        (above - self.height(u, v)).abs()
    }

    /// The normal and a place of the plane that touches it over a place.
    fn touching(&self, place: Place) -> (Place, Place) {
        let [u, v, _] = self.over(place);
        let [_, b, c, d, e, f] = self.height;
        let (du, dv) = (b + d * u + e * v, c + e * u + f * v);
        let [x, y, z] = self.frame;
        let normal = [0, 1, 2].map(|a| z[a] - du * x[a] - dv * y[a]);
        let above = self.height(u, v);
        let on = [0, 1, 2].map(|a| self.origin[a] + u * x[a] + v * y[a] + above * z[a]);
        (normal.map(|c| c / length(normal)), on)
    }
}

/// The place nearest to `at` where the sides meet.
fn meeting(sides: &[Side], at: Place) -> Option<Place> {
    if sides.len() < 2 {
        return None;
    }
    let mut place = at;
    for _ in 0..3 {
        let planes: Vec<(Place, f64)> = (sides.iter().map(|side| side.touching(place)))
            .map(|(normal, on)| (normal, dot(normal, minus(on, at))))
            .collect();
        place = onto(&planes, at)?;
    }
    Some(place)
}

/// The place nearest to `at` on planes given by their normals, and how far above it they are.
fn onto(planes: &[(Place, f64)], at: Place) -> Option<Place> {
    if let [(a, above_a), (b, above_b), (c, above_c)] = *planes {
        let [bc, ca, ab] = [cross(b, c), cross(c, a), cross(a, b)];
        let span = dot(a, bc);
        if span.abs() >= 0.25 {
            let [s, t, r] = [above_a, above_b, above_c].map(|above| above / span);
            return Some([0, 1, 2].map(|i| at[i] + (s * bc[i] + t * ca[i] + r * ab[i])));
        }
    }
    for i in 0..planes.len() {
        for j in i + 1..planes.len() {
            let ((a, above_a), (b, above_b)) = (planes[i], planes[j]);
            let cosine = dot(a, b);
            if cosine.abs() < 0.866 {
                let s = (above_a - cosine * above_b) / (1.0 - cosine * cosine);
                let t = (above_b - cosine * above_a) / (1.0 - cosine * cosine);
                return Some([0, 1, 2].map(|i| at[i] + (s * a[i] + t * b[i])));
            }
        }
    }
    None
}

impl Creases<'_> {
    fn triangles(&self) -> impl Iterator<Item = [u32; 3]> {
        self.surface.triangles.iter().copied()
    }

    fn normal(&self, triangle: [u32; 3]) -> Place {
        let [a, b, c] = triangle.map(|v| self.places[v as usize]);
        cross(minus(b, a), minus(c, a))
    }

    fn same_place(&self, v: u32, u: u32) -> bool {
        let [one, other] = [v, u].map(|v| self.points[v as usize]);
        v == u || one.is_some() && one == other
    }

    /// Whether a triangle at a vertex leans away from their mean.
    fn is_bent(&self, v: u32) -> bool {
        let normals: Vec<Place> = self.triangles().filter(|t| t.contains(&v)).map(|t| self.normal(t)).collect();
        let normals: Vec<Place> = normals.into_iter().filter(|normal| dot(*normal, *normal) > 0.0).collect();
        let mean = normals.iter().fold([0.0; 3], |sum: Place, normal| [0, 1, 2].map(|a| sum[a] + normal[a]));
        normals.iter().any(|normal| {
            let along = dot(*normal, mean);
            along <= 0.0 || along * along < 0.9659 * 0.9659 * dot(mean, mean) * dot(*normal, *normal)
        })
    }

    /// The vertices and triangles in sight of a vertex that hang together with it.
    fn seen(&self, v: u32) -> (BTreeSet<u32>, Vec<[u32; 3]>) {
        let corner = self.surface.corners[v as usize].expect("a vertex with a point has a corner");
        let away =
            |u: u32| self.surface.corners[u as usize].map(|other| [0, 1, 2].map(|a| i64::from(other[a] - corner[a])));
        let is_near = |triangle: &[u32; 3]| {
            let [Some(p), Some(q), Some(r)] = triangle.map(away) else { return false };
            // None beyond, and not all in the highest plane.
            [p, q, r].iter().flatten().all(|away| away.abs() <= SIGHT) && [p, q, r].iter().any(|[_, y, _]| *y < SIGHT)
        };
        let near: Vec<[u32; 3]> = self.triangles().filter(is_near).collect();
        let mut vertices = BTreeSet::from([v]);
        loop {
            let before = vertices.len();
            for triangle in near.iter().filter(|t| t.iter().any(|u| vertices.contains(u))).collect::<Vec<_>>() {
                vertices.extend(triangle);
            }
            if vertices.len() == before {
                let seen = near.into_iter().filter(|t| t.iter().all(|u| vertices.contains(u))).collect();
                return (vertices, seen);
            }
        }
    }

    /// The place at a crease that a vertex goes to.
    pub fn place(&self, v: u32) -> Option<Place> {
        self.points[v as usize]?;
        let touching: BTreeSet<u32> = self.triangles().filter(|t| t.contains(&v)).flatten().collect();
        if !touching.into_iter().any(|u| self.same_place(v, u) && self.is_bent(u)) {
            return None;
        }
        let (vertices, triangles) = self.seen(v);
        let triangles: Vec<[u32; 3]> =
            triangles.into_iter().filter(|t| dot(self.normal(*t), self.normal(*t)) > 0.0).collect();
        let at = self.places[v as usize];
        let area = triangles.iter().fold(0.0, |sum, t| sum + length(self.normal(*t)) / 2.0);
        let edge2 = area / triangles.len() as f64 * (4.0 / 3f64.sqrt());
        let edge = edge2.sqrt();
        let near = |place: Place| {
            let way = minus(place, at);
            let near = 1.0 / (1.0 + dot(way, way) / (8.0 * edge2));
            near * near
        };
        let faces: Vec<Seen> = (triangles.into_iter())
            .map(|vertices| {
                let normal = self.normal(vertices);
                let [a, b, c] = vertices.map(|v| self.places[v as usize]);
                let middle = [0, 1, 2].map(|i| (a[i] + b[i] + c[i]) / 3.0);
                let (size, near) = (length(normal), near(middle));
                Seen { vertices, normal: normal.map(|c| c / size), middle, area: size / 2.0, near }
            })
            .collect();
        let first = |v: u32| vertices.iter().copied().find(|u| self.same_place(*u, v)).expect("it is one of them");
        let places = |of: &BTreeSet<u32>| -> Vec<(Place, f64)> {
            of.iter().map(|v| self.places[*v as usize]).map(|place| (place, near(place))).collect()
        };
        let sides = self.sides(&faces, &first, &places, edge);
        let place = meeting(&sides, at)?;
        let normals: Vec<Place> = sides.iter().map(|side| side.touching(place).0).collect();
        let pairs = || (0..normals.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        let cosines: Vec<f64> = pairs().map(|(i, j)| dot(normals[i], normals[j])).collect();
        if cosines.iter().all(|c| *c >= 0.866) || cosines.iter().any(|c| *c < -0.866) {
            return None;
        }
        let (times, edges) = if cosines.iter().any(|c| *c < -0.6428) { (30.0, 1.0) } else { (8.0, 2.5) };
        let far = |p: Place, q: Place| dot(minus(p, q), minus(p, q));
        let farthest = (edges * edge).min(3.0);
        let all: BTreeSet<u32> = vertices.iter().map(|v| first(*v)).collect();
        if far(place, at) > farthest * farthest || !is_nearer(times, &sides, &faces, &places(&all), edge) {
            return None;
        }
        let nearest = |place: Place| {
            (0..sides.len())
                .min_by(|i, j| sides[*i].distance(place).total_cmp(&sides[*j].distance(place)))
                .expect("two")
        };
        let beside: BTreeSet<u32> = (faces.iter())
            .filter(|face| face.vertices.iter().any(|u| self.same_place(*u, v)))
            .flat_map(|face| face.vertices)
            .filter(|u| !self.same_place(*u, v))
            .collect();
        let leads_across = |u: u32| {
            let there = self.places[u as usize];
            let other = nearest(there);
            if other == nearest(at) || sides[other].distance(there) > edge / 2.0 {
                return false;
            }
            let (own, theirs) = (far(place, at), meeting(&sides, there).map(|place| far(place, there)));
            theirs.is_none_or(|theirs| own < theirs || own == theirs && at < there)
        };
        beside.into_iter().any(leads_across).then_some(place)
    }

    /// The smooth surfaces through flat triangles whose normals are alike.
    fn sides(&self, faces: &[Seen], first: &dyn Fn(u32) -> u32, places: &Places<'_>, edge: f64) -> Vec<Side> {
        let corners: Vec<BTreeSet<u32>> =
            faces.iter().map(|face| face.vertices.iter().map(|v| first(*v)).collect()).collect();
        let is_flat = |i: &usize| {
            let (mut alike, mut bent) = (0, 0);
            let [a, b, c] = faces[*i].vertices.map(first);
            for ends in [[a, b], [b, c], [c, a]] {
                let at_edge: Vec<usize> =
                    (0..faces.len()).filter(|j| ends.iter().all(|end| corners[*j].contains(end))).collect();
                if let [one, other] = at_edge[..] {
                    let is_alike = dot(faces[one].normal, faces[other].normal) >= 0.9945;
                    (alike, bent) = (alike + i32::from(is_alike), bent + i32::from(!is_alike));
                }
            }
            alike >= 1 && bent <= 1
        };
        let mut flat: Vec<usize> = (0..faces.len()).filter(is_flat).collect();
        let mut groups: Vec<(Vec<usize>, f64)> = Vec::new();
        while groups.len() < 3 {
            let alike = |i: &usize| -> Vec<usize> {
                flat.iter().copied().filter(|j| dot(faces[*i].normal, faces[*j].normal) > 0.9659).collect()
            };
            let weight = |group: &[usize]| group.iter().fold(0.0, |sum, i| sum + faces[*i].weight());
            let mut best: (Vec<usize>, f64) = (Vec::new(), 0.0);
            for group in flat.iter().map(alike) {
                let density = weight(&group);
                if density > best.1 {
                    best = (group, density);
                }
            }
            if best.0.is_empty() || groups.first().is_some_and(|(_, most)| best.1 < 0.1 * most) {
                break;
            }
            flat.retain(|i| !best.0.contains(i));
            groups.push(best);
        }
        if groups.len() < 2 {
            return Vec::new();
        }
        let side = |(group, weight): &(Vec<usize>, f64)| {
            let mean = |of: &dyn Fn(&Seen) -> Place| {
                group
                    .iter()
                    .fold([0.0; 3], |sum: Place, i| [0, 1, 2].map(|a| sum[a] + faces[*i].weight() * of(&faces[*i])[a]))
            };
            let on: BTreeSet<u32> = group.iter().flat_map(|i| corners[*i].iter().copied()).collect();
            Side::through(
                mean(&|face| face.normal),
                mean(&|face| face.middle).map(|c| c / weight),
                &places(&on),
                edge,
                0.2,
            )
        };
        groups.iter().map(side).collect()
    }
}

/// Whether places lie so many times nearer to the sides than to one surface, but for the tenth that lies farthest from sides.
fn is_nearer(times: f64, sides: &[Side], faces: &[Seen], places: &[(Place, f64)], edge: f64) -> bool {
    let normal =
        faces.iter().fold([0.0; 3], |sum: Place, face| [0, 1, 2].map(|a| sum[a] + face.weight() * face.normal[a]));
    let sum = places.iter().fold([0.0; 3], |sum: Place, (place, w)| [0, 1, 2].map(|a| sum[a] + w * place[a]));
    let all = places.iter().fold(0.0, |sum, (_, weight)| sum + weight);
    let one = Side::through(normal, sum.map(|c| c / all), places, edge, 0.001);
    let from_side = |place: Place| sides.iter().map(|side| side.distance(place)).fold(f64::INFINITY, f64::min);
    let mut places = places.to_vec();
    places.sort_by(|(p, _), (q, _)| from_side(*p).total_cmp(&from_side(*q)));
    let near =
        (1..=places.len()).rev().find(|n| places[..*n].iter().fold(0.0, |sum, (_, weight)| sum + weight) <= 0.9 * all);
    let counted = &places[..near.unwrap_or(0)];
    let from_one = counted.iter().fold(0.0, |sum, (place, weight)| sum + weight * one.distance(*place));
    let from_sides = counted.iter().fold(0.0, |sum, (place, weight)| sum + weight * from_side(*place));
    dot(normal, normal) > 0.0 && times * from_sides <= from_one
}
