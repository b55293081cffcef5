//! One part of space, simplified: triangles in, fewer triangles out.

use glam::DVec3;

use super::collapse::{Limits, Simplifier};
use super::gap::Drift;
use super::piece::{NONE, Piece};
use super::soup::Record;
use super::{boxes, piece, queue};
use crate::points::Coordinate;

/// The triangles that meet a part, as they are read.
#[derive(Debug, Default)]
pub(super) struct Gathered {
    triangles: Vec<[u32; 3]>,
    classes: Vec<[u16; 3]>,
    places: Vec<[[f64; 3]; 3]>,
    drift: Vec<Drift>,
}

impl Gathered {
    /// Room for so many triangles.
    pub(super) fn with_room(triangles: usize) -> Gathered {
        Gathered {
            triangles: Vec::with_capacity(triangles),
            classes: Vec::with_capacity(triangles),
            places: Vec::with_capacity(triangles),
            drift: Vec::with_capacity(triangles),
        }
    }

    /// Bytes for each triangle, while it is read and while it is simplified, whichever is more.
    pub(super) fn bytes<T: Coordinate>() -> u64 {
        let kept = size_of::<[u32; 3]>() + size_of::<Drift>();
        // Corners that are sorted by their vertices. There is about half a vertex to a triangle; open and broken meshes have up to three.
        let read = kept + size_of::<[u16; 3]>() + size_of::<[[f64; 3]; 3]>() + 3 * size_of::<u64>();
        let of_vertex = piece::VERTEX_BYTES + queue::Queue::BYTES + 8;
        let worked = piece::TRIANGLE_BYTES + boxes::Boxes::BYTES + size_of::<Record<T>>() as u64;
        (read as u64).max(worked) + of_vertex
    }

    pub(super) fn push<T: Coordinate>(&mut self, record: &Record<T>) {
        self.triangles.push(record.vertices);
        self.classes.push(record.classes);
        self.places.push(record.places());
        self.drift.push(record.drift());
    }

    /// Collapses what can be, and gives the triangles that are the part's own. `inside` tells whether a place lies in the part.
    pub(super) fn simplified<T: Coordinate>(self, limits: Limits, inside: impl Fn([f64; 3]) -> bool) -> Vec<Record<T>> {
        let Gathered { mut triangles, classes, places, drift } = self;
        let mut keys: Vec<u64> = Vec::with_capacity(3 * triangles.len());
        keys.extend(triangles.as_flattened().iter().zip(0u64..).map(|(&v, corner)| u64::from(v) << 32 | corner));
        keys.sort_unstable();
        let (mut numbers, mut positions, mut class) = (Vec::new(), Vec::new(), Vec::new());
        for key in keys {
            let (number, corner) = ((key >> 32) as u32, (key & 0xffff_ffff) as usize);
            if numbers.last() != Some(&number) {
                numbers.push(number);
                positions.push(DVec3::from_array(places[corner / 3][corner % 3]));
                class.push(classes[corner / 3][corner % 3]);
            }
            triangles.as_flattened_mut()[corner] = numbers.len() as u32 - 1;
        }
        drop((places, classes));
        let within: Vec<bool> = positions.iter().map(|place| inside(place.to_array())).collect();
        // A triangle that reaches out of the part belongs to others, too: it stays, and so do its corners.
        let mut fixed: Vec<bool> = within.iter().map(|within| !within).collect();
        for triangle in &triangles {
            if !triangle.iter().all(|v| within[*v as usize]) {
                triangle.iter().for_each(|v| fixed[*v as usize] = true);
            }
        }
        let mut piece = Piece::new(positions, numbers, triangles, drift);
        piece.fixed = fixed;
        piece.classes = class;
        let mut simplifier = Simplifier::new(piece, limits);
        simplifier.run();
        let Piece { positions, numbers, triangles, drift, classes, .. } = simplifier.piece;
        let left = triangles.iter().zip(drift).filter(|(triangle, _)| triangle[0] != NONE);
        // One that reaches into several parts is written by that of its first corner.
        let own = left.filter(|(triangle, _)| within[triangle[0] as usize]);
        own.map(|(triangle, drift)| {
            let of = |v: u32| positions[v as usize].to_array();
            Record::new(
                triangle.map(|v| numbers[v as usize]),
                triangle.map(|v| classes[v as usize]),
                triangle.map(of),
                drift,
            )
        })
        .collect()
    }
}
