//! Vertices so far from their points that facets pass amid the points, slab by slab as the specification says.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;

use super::sphere::{Cell, Means, dot};
use super::surface::Surface;

/// What facets are made of: a surface, the place of each vertex in cells, and the number of its point.
pub struct Facets<'a> {
    pub surface: &'a Surface,
    pub places: &'a [[f64; 3]],
    pub points: &'a [Option<usize>],
    pub means: &'a Means,
    /// Where vertices at creases go.
    pub creases: &'a [Option<[f64; 3]>],
}

/// Where a vertex goes, and where it would be without leaving its place along the surface, in cells.
pub type Centred = [[f64; 3]; 2];

fn minus(p: [f64; 3], q: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|a| p[a] - q[a])
}

fn cross(u: [f64; 3], v: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|a| u[(a + 1) % 3] * v[(a + 2) % 3] - u[(a + 2) % 3] * v[(a + 1) % 3])
}

fn normal(triangle: [u32; 3], places: &[[f64; 3]]) -> [f64; 3] {
    let [a, b, c] = triangle.map(|v| places[v as usize]);
    cross(minus(b, a), minus(c, a))
}

fn has_area(triangle: [u32; 3], places: &[[f64; 3]]) -> bool {
    let normal = normal(triangle, places);
    dot(normal, normal) > 0.0
}

impl Facets<'_> {
    /// The places of vertices on the planes `own`, by what is known of the planes `near` and of the triangles of the slices `slices`.
    pub fn centred(
        &self,
        own: &RangeInclusive<u32>,
        near: &RangeInclusive<u32>,
        slices: &RangeInclusive<u32>,
    ) -> BTreeMap<u32, Centred> {
        let triangles: Vec<[u32; 3]> = (self.surface.triangles.iter().zip(&self.surface.slices))
            .filter(|(_, slice)| slices.contains(slice))
            .map(|(triangle, _)| *triangle)
            .collect();
        let is_at_crease =
            |v: &u32| near.contains(&self.surface.planes[*v as usize]) && self.creases[*v as usize].is_some();
        let mut at_corner: BTreeMap<[i64; 3], BTreeSet<usize>> = BTreeMap::new();
        let mut star: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (t, triangle) in triangles.iter().enumerate() {
            for v in triangle {
                star.entry(*v).or_default().push(t);
                if has_area(*triangle, self.places)
                    && let Some(corner) = self.surface.corners[*v as usize]
                    && near.contains(&self.surface.planes[*v as usize])
                {
                    at_corner.entry(corner.map(i64::from)).or_default().insert(t);
                }
            }
        }
        let mut off: BTreeMap<(u32, bool), [f64; 2]> = BTreeMap::new();
        for cell in &self.means.0 {
            let corners = (0..8).map(|c| [0, 1, 2].map(|a| i64::from(cell.cell[a]) + i64::from(c >> a & 1)));
            let shown: BTreeSet<usize> =
                corners.filter_map(|corner| at_corner.get(&corner)).flatten().copied().collect();
            let facing = |t: &usize| dot(normal(triangles[*t], self.places), cell.outward) > 0.0;
            let near = shown.into_iter().filter(facing).map(|t| (self.on(cell, triangles[t]).1, t));
            let Some((distance2, t)) = near.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))) else { continue };
            let normal = normal(triangles[t], self.places);
            let above =
                dot(minus(cell.mean, self.places[triangles[t][0] as usize]), normal) / dot(normal, normal).sqrt();
            if distance2 > 1.0 {
                continue;
            }
            let cuts_edge = triangles[t].iter().any(is_at_crease);
            for (v, share) in triangles[t].into_iter().zip(self.on(cell, triangles[t]).0) {
                if cuts_edge && !is_at_crease(&v) {
                    continue;
                }
                let [sum, points] = off.entry((v, above < -0.25)).or_default();
                *sum += share * cell.points * above;
                *points += share * cell.points;
            }
        }
        let mut by_point: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
        for (v, point) in (0u32..).zip(self.points) {
            if let Some(point) = point
                && near.contains(&self.surface.planes[v as usize])
            {
                by_point.entry(*point).or_default().push(v);
            }
        }
        let groups: Vec<&Vec<u32>> = by_point.values().collect();
        let star_of = |v: &u32| star.get(v).into_iter().flatten().map(|t| triangles[*t]);
        // Vertices at creases are there, as far as 32 bits tell how far they go.
        let mut there = self.places.to_vec();
        for v in (0..there.len() as u32).filter(is_at_crease) {
            let (place, from) = (self.creases[v as usize].expect("it is at a crease"), self.places[v as usize]);
            there[v as usize] = [0, 1, 2].map(|a| from[a] + f64::from((place[a] - from[a]) as f32));
        }
        let is_at = |same: &[u32]| same.iter().any(is_at_crease);
        let is_beside = |same: &[u32]| {
            !is_at(same) && same.iter().flat_map(star_of).any(|triangle| triangle.iter().any(is_at_crease))
        };
        let after = |triangle: [u32; 3], v: u32| {
            triangle[(triangle.iter().position(|u| *u == v).expect("it is of the star") + 1) % 3]
        };
        // The normal round a point, if there is one in common, and how far the point lies above its neighbours.
        let bearing = |same: &[u32], places: &[[f64; 3]]| {
            let (mut area, mut count) = (0.0, 0.0);
            let (mut sum, mut neighbours) = ([0.0; 3], [0.0; 3]);
            for v in same {
                for triangle in star_of(v) {
                    if !has_area(triangle, places) {
                        continue;
                    }
                    let of_facet = normal(triangle, places);
                    (0..3).for_each(|a| sum[a] += of_facet[a]);
                    area += dot(of_facet, of_facet).sqrt();
                    let next = places[after(triangle, *v) as usize];
                    (0..3).for_each(|a| neighbours[a] += next[a]);
                    count += 1.0;
                }
            }
            let length = dot(sum, sum).sqrt();
            let normal = sum.map(|c| c / length);
            let above = dot(minus(places[same[0] as usize], neighbours.map(|c| c / count)), normal);
            (length > 0.0 && length >= 0.5 * area).then_some((normal, above))
        };
        let is_own = |v: &u32| own.contains(&self.surface.planes[*v as usize]);
        let above_of = |places: &[[f64; 3]], counts: &dyn Fn(&[u32]) -> bool| {
            let mut all: BTreeMap<u32, f64> = BTreeMap::new();
            for same in groups.iter().filter(|same| counts(same)) {
                if let Some((_, above)) = bearing(same, places) {
                    all.extend(same.iter().copied().filter(is_own).map(|v| (v, above)));
                }
            }
            all
        };
        let without = above_of(self.places, &|_| true);
        let mut with = above_of(self.places, &|same| !is_at(same) && !is_beside(same));
        with.extend(above_of(&there, &|same| is_at(same) || is_beside(same)));
        let mut out = BTreeMap::new();
        for same in groups {
            let (places, all_above) = if is_beside(same) { (&*there, &with) } else { (self.places, &without) };
            let Some((direction, own_above)) = bearing(same, places) else { continue };
            // In front and behind: what the points are off, and how many they are.
            let mut sums = [[0.0; 2]; 2];
            let (mut bent, mut count) = (0.0, 0.0);
            for v in same {
                for (sum, is_behind) in sums.iter_mut().zip([false, true]) {
                    let more = off.get(&(*v, is_behind)).copied().unwrap_or_default();
                    (0..2).for_each(|i| sum[i] += more[i]);
                }
                let facets = star_of(v).filter(|triangle| has_area(*triangle, places));
                for above in facets.filter_map(|triangle| all_above.get(&after(triangle, *v))) {
                    bent += above;
                    count += 1.0;
                }
            }
            let [[front, points], [behind, more]] = sums;
            let (sum, points) = if more > points { (front + behind, points + more) } else { (front, points) };
            let most = if count > 0.0 { 2.0 * bent / count } else { 0.0 };
            let bent = if most > 0.0 { own_above.clamp(0.0, most) } else { own_above.clamp(most, 0.0) };
            let way = (1.5 * sum / (points + 0.5) + bent * 0.5 / f64::max(points, 2.0)).clamp(-0.25, 0.5);
            for v in same.iter().copied().filter(is_own) {
                let (place, q) = (places[v as usize], self.surface.positions[v as usize]);
                let onto = [0, 1, 2].map(|a| place[a] + way * direction[a]);
                let above = dot(minus(q, onto), direction);
                out.insert(v, [onto, [0, 1, 2].map(|a| q[a] - above * direction[a])]);
            }
        }
        out
    }

    /// The place of a triangle that is nearest to a cell's mean, as weights of its corners, and the squared distance.
    fn on(&self, cell: &Cell, triangle: [u32; 3]) -> ([f64; 3], f64) {
        let corners = triangle.map(|v| self.places[v as usize]);
        let [a, b, c] = corners;
        let (ab, ac) = (minus(b, a), minus(c, a));
        let along = |corner: [f64; 3]| [dot(ab, minus(cell.mean, corner)), dot(ac, minus(cell.mean, corner))];
        let [[d1, d2], [d3, d4], [d5, d6]] = corners.map(along);
        let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
        let weights = if d1 <= 0.0 && d2 <= 0.0 {
            [1.0, 0.0, 0.0]
        } else if d3 >= 0.0 && d4 <= d3 {
            [0.0, 1.0, 0.0]
        } else if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            [1.0 - d1 / (d1 - d3), d1 / (d1 - d3), 0.0]
        } else if d6 >= 0.0 && d5 <= d6 {
            [0.0, 0.0, 1.0]
        } else if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            [1.0 - d2 / (d2 - d6), 0.0, d2 / (d2 - d6)]
        } else if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
            let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
            [0.0, 1.0 - t, t]
        } else {
            let all = 1.0 / (va + vb + vc);
            [1.0 - vb * all - vc * all, vb * all, vc * all]
        };
        let [wa, wb, wc] = weights;
        let way = [0, 1, 2].map(|i| cell.mean[i] - (wa * a[i] + wb * b[i] + wc * c[i]));
        (weights, dot(way, way))
    }
}
