//! Attributes of vertices: those of the points they were fitted to.
//!
//! ```text
//!   points of the slab and its halo      vertices' points          vertices
//!   (x y z) [record] ----- same ------>  (x y z) [record] -------> [record]     fitted, pulled, gone back: their own point's
//!   (x y z) [record]     coordinates                      . . . .> [record]     without a point: the nearest of their neighbours' points
//! ```
//!
//! Fitting looks at coordinates alone; the records are found again here, by coordinates, in one more pass over the slab's buckets. Of points that lie at
//! one place, the record that is least, byte by byte, counts: the order of points never shows.

use std::cmp::Ordering;
use std::hash::BuildHasher;
use std::ops::Range;

use rustc_hash::FxHashMap;

use crate::error::Result;
use crate::grid::occupancy::Sampled;
use crate::grid::partition::BUCKET_SLICES;
use crate::points::{Coordinate, bits};
use crate::storage::seeds::{SeededMap, Seeds};
use crate::surface::contract::NONE;
use crate::surface::fit::{Fitted, precedes, squared_distance};

/// The records of a slab's vertices, one after the other; `slices` are those whose points it was fitted to, `lookup` is [`Lookup::of`] the same vertices and triangles.
///
/// A vertex without a point takes the record of the nearest point that any of its neighbours has, as soon as one has: from edge to edge, all at once. Where
/// no vertex of the slab has a point, records are zero. Memory: [`Lookup::bytes`], a record for each vertex, a chunk of a bucket.
///
/// # Errors
/// [`crate::Error::Io`].
pub fn attributes<T: Coordinate>(
    sampled: &Sampled<'_, T>,
    slices: Range<u32>,
    fitted: &Fitted<T>,
    places: &[[f64; 3]],
    triangles: &[[u32; 3]],
    lookup: Lookup,
) -> Result<Vec<u8>> {
    let stride = sampled.buckets.stride();
    let mut found = Found::for_points(fitted, lookup.points as usize, stride);
    for bucket in slices.start / BUCKET_SLICES..slices.end.div_ceil(BUCKET_SLICES) {
        let counted = sampled.counted_in(bucket)?;
        sampled.buckets.read_attributes(bucket as usize, |points, records| {
            for (point, record) in points.iter().zip(records.chunks_exact(stride)) {
                let p = point.map(Into::into);
                if let Some(number) = found.number(p)
                    && counted.contains(sampled.grid, p)
                {
                    found.offer(number, record);
                }
            }
            Ok(())
        })?;
    }
    let mut of_vertices = found.of_vertices(fitted);
    spread(&mut of_vertices, &fitted.target, places, triangles, lookup.open as usize);
    let mut out = Vec::with_capacity(places.len() * stride);
    for point in of_vertices {
        match point {
            NONE => out.resize(out.len() + stride, 0),
            // A vertex's number here is that of a vertex with the same point.
            v => out.extend_from_slice(found.record(fitted.target[v as usize].map(Into::into))),
        }
    }
    Ok(out)
}

/// How much [`attributes`] looks up, on which its memory depends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lookup {
    /// Points that vertices were fitted to, each counted once.
    pub points: u64,
    /// Triangles with a vertex that has no point.
    pub open: u64,
}

impl Lookup {
    /// The most that vertices may have: each a point of its own, or none of them one.
    pub fn most(vertices: u64) -> Lookup {
        Lookup { points: vertices, open: 2 * vertices }
    }

    /// What a slab's vertices and triangles look up. Memory: four bytes for each vertex.
    pub fn of<T>(fitted: &Fitted<T>, triangles: &[[u32; 3]]) -> Lookup {
        let has_point = |point: &u32| *point != NONE;
        let lacks = |v: &u32| fitted.point.get(*v as usize).is_some_and(|point| !has_point(point));
        let open = triangles.iter().filter(|triangle| triangle.iter().any(lacks)).count();
        let mut points: Vec<u32> = Vec::with_capacity(fitted.point.len());
        points.extend(fitted.point.iter().copied().filter(has_point));
        points.sort_unstable();
        points.dedup();
        Lookup { points: points.len() as u64, open: open as u64 }
    }

    /// Bytes that [`attributes`] needs for so many vertices and records of `stride` bytes, but for the records it gives.
    pub fn bytes(self, vertices: u64, stride: u64) -> u64 {
        let spread = vertices * size_of::<u32>() as u64 + self.open * size_of::<[u32; 3]>() as u64;
        bytes_of_table::<([u64; 3], u32)>(self.points) + self.points * (2 + stride) + spread
    }
}

/// Bytes of a hash table with room for so many entries: a power of two of places, of which an eighth stays free, and a byte for each.
pub fn bytes_of_table<E>(entries: u64) -> u64 {
    (entries * 8).div_ceil(7).max(4).next_power_of_two() * (size_of::<E>() as u64 + 1)
}

/// The records of the points that vertices were fitted to.
struct Found {
    stride: usize,
    /// The number of a point, by the bits of its coordinates.
    numbers: SeededMap<[u64; 3], u32>,
    filter: BloomFilter,
    /// The record of each point.
    records: Vec<u8>,
    /// Whether a record was found yet, for each point.
    known: Vec<bool>,
}

impl Found {
    fn for_points<T: Coordinate>(fitted: &Fitted<T>, points: usize, stride: usize) -> Found {
        let mut numbers: SeededMap<[u64; 3], u32> = SeededMap::with_capacity_and_hasher(points, Seeds::new());
        for (target, _) in fitted.target.iter().zip(&fitted.point).filter(|(_, point)| **point != NONE) {
            let next = numbers.len() as u32;
            numbers.entry(bits(*target)).or_insert(next);
        }
        let points = numbers.len();
        let mut filter = BloomFilter::new(points);
        // In any order: the filter is the same.
        numbers.keys().for_each(|place| filter.add(place));
        Found { stride, numbers, filter, records: vec![0; points * stride], known: vec![false; points] }
    }

    #[inline]
    fn number(&self, point: [f64; 3]) -> Option<usize> {
        let place = bits(point);
        if self.filter.may_hold(&place) { self.numbers.get(&place).map(|number| *number as usize) } else { None }
    }

    fn offer(&mut self, number: usize, record: &[u8]) {
        let own = &mut self.records[number * self.stride..][..self.stride];
        if !std::mem::replace(&mut self.known[number], true) || record < &*own {
            own.copy_from_slice(record);
        }
    }

    fn record(&self, point: [f64; 3]) -> &[u8] {
        let number = self.number(point).unwrap_or(0);
        &self.records[number * self.stride..][..self.stride]
    }

    /// For each vertex: itself if it has a point.
    fn of_vertices<T>(&self, fitted: &Fitted<T>) -> Vec<u32> {
        fitted.point.iter().zip(0..).map(|(point, v)| if *point == NONE { NONE } else { v }).collect()
    }
}

/// Lets through what may be among some places, and little else: of a slab's points, one in ten was fitted to, and the table is too large for a cache.
struct BloomFilter {
    /// As many as a power of two.
    bits: Vec<u64>,
    seeds: Seeds,
}

impl BloomFilter {
    /// For so many places, of which none is in it: two bytes for each.
    fn new(places: usize) -> BloomFilter {
        BloomFilter { bits: vec![0; (places / 4).next_power_of_two()], seeds: Seeds::new() }
    }

    /// The word and the bit of a place.
    #[inline]
    fn at(&self, place: &[u64; 3]) -> (usize, u32) {
        let hash = self.seeds.hash_one(place);
        ((hash >> 6) as usize & (self.bits.len() - 1), hash as u32 % 64)
    }

    fn add(&mut self, place: &[u64; 3]) {
        let (word, bit) = self.at(place);
        self.bits[word] |= 1 << bit;
    }

    #[inline]
    fn may_hold(&self, place: &[u64; 3]) -> bool {
        let (word, bit) = self.at(place);
        self.bits[word] >> bit & 1 == 1
    }
}

/// Gives vertices without a point that of a neighbour, round by round. `of_vertices` names of each vertex one whose point it has; vertices of other
/// slabs, beyond the end, are passed over. There is `room` for triangles that have one without a point.
fn spread<T: Coordinate>(
    of_vertices: &mut [u32],
    targets: &[[T; 3]],
    places: &[[f64; 3]],
    triangles: &[[u32; 3]],
    room: usize,
) {
    let own = of_vertices.len() as u32;
    let lacks = |of: &[u32], v: u32| v < own && of[v as usize] == NONE;
    let mut open: Vec<[u32; 3]> = Vec::with_capacity(room);
    open.extend(triangles.iter().filter(|t| t.iter().any(|v| lacks(of_vertices, *v))));
    loop {
        let mut nearest: FxHashMap<u32, (f64, u32)> = FxHashMap::default();
        for triangle in &open {
            for v in triangle.iter().filter(|v| lacks(of_vertices, **v)) {
                for other in triangle.iter().filter(|u| **u < own).map(|u| of_vertices[*u as usize]) {
                    if other == NONE {
                        continue;
                    }
                    let target_of = |v: u32| targets[v as usize].map(Into::<f64>::into);
                    let (place, target) = (places[*v as usize], target_of(other));
                    let distance = squared_distance(place, target);
                    let best = nearest.entry(*v).or_insert((distance, other));
                    let nearer = match distance.total_cmp(&best.0) {
                        Ordering::Equal => precedes(target, target_of(best.1)),
                        order => order == Ordering::Less,
                    };
                    if nearer {
                        *best = (distance, other);
                    }
                }
            }
        }
        if nearest.is_empty() {
            return;
        }
        // In any order: each vertex is in it once, and what they take was there before the round.
        for (v, (_, other)) in nearest {
            of_vertices[v as usize] = other;
        }
        open.retain(|t| t.iter().any(|v| lacks(of_vertices, *v)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_points_at_one_place_the_least_record_counts() {
        let (place, elsewhere) = ([1.0, -0.0, 3.0], [1.0, 0.0, 3.0]);
        let fitted = Fitted { point: vec![5, NONE, 5], target: vec![place, elsewhere, place] };
        for order in [[[7, 1], [3, 9], [3, 8]], [[3, 8], [7, 1], [3, 9]]] {
            let mut found = Found::for_points(&fitted, Lookup::of(&fitted, &[]).points as usize, 2);
            assert_eq!(found.number(elsewhere), None, "zero has a sign");
            let number = found.number(place).unwrap();
            order.iter().for_each(|record| found.offer(number, record));
            assert_eq!(found.record(place), [3, 8]);
        }
    }

    #[test]
    fn points_are_counted_once_and_triangles_that_lack_one() {
        let fitted = Fitted { point: vec![7, NONE, 7, 1, 7], target: vec![[0.0; 3]; 5] };
        let triangles = [[0, 1, 2], [2, 3, 4], [3, 4, 9], [1, 3, 9]];
        assert_eq!(Lookup::of(&fitted, &triangles), Lookup { points: 2, open: 2 });
    }

    #[test]
    fn vertices_without_a_point_take_the_nearest_of_their_neighbours() {
        // A strip 0 - 1 - 2 - 3 - 4 along x; 0 and 4 have points, 9 is another slab's.
        let places: Vec<[f64; 3]> = (0..5).map(|x| [f64::from(x), 0.0, 0.0]).collect();
        let targets = vec![[-5.0, 0.0, 0.0], [0.0; 3], [0.0; 3], [0.0; 3], [4.5, 0.0, 0.0]];
        let triangles = [[0, 1, 9], [2, 9, 1], [3, 2, 9], [4, 9, 3]];
        let mut of = vec![0, NONE, NONE, NONE, 4];
        spread(&mut of, &targets, &places, &triangles, 4);
        assert_eq!(of, [0, 0, 4, 4, 4]);
        let mut alone = vec![NONE; 5];
        spread(&mut alone, &targets, &places, &triangles, 4);
        assert_eq!(alone, [NONE; 5]);
    }
}
