//! One part of space, simplified: triangles in, fewer triangles out.

use glam::DVec3;

use super::collapse::{Limits, Simplifier};
use super::gap::Drift;
use super::mark::{Mark, Marks, inwards, outwards};
use super::merging::Corner;
use super::piece::{NONE, Piece};
use super::soup::Record;
use super::space::Space;
use super::{boxes, piece, queue};
use crate::points::Coordinate;

/// The triangles that meet a part, as they are read.
#[derive(Debug, Default)]
pub(super) struct Gathered {
    triangles: Vec<[u32; 3]>,
    classes: Vec<[u16; 3]>,
    places: Vec<[[f64; 3]; 3]>,
    drift: Vec<Drift>,
    marks: Vec<Marks>,
}

impl Gathered {
    /// Room for so many triangles.
    pub(super) fn with_room<M: Mark>(triangles: usize) -> Gathered {
        Gathered {
            triangles: Vec::with_capacity(triangles),
            classes: Vec::with_capacity(triangles),
            places: Vec::with_capacity(triangles),
            drift: Vec::with_capacity(triangles),
            marks: Vec::with_capacity(if M::CARRIED { triangles } else { 0 }),
        }
    }

    /// Bytes for each triangle, while it is read and while it is simplified, whichever is more.
    pub(super) fn bytes<T: Coordinate, M: Mark>() -> u64 {
        let kept = size_of::<[u32; 3]>() + size_of::<Drift>();
        // Corners that are sorted by their vertices. There is about half a vertex to a triangle; open and broken meshes have up to three.
        let read = kept + size_of::<[u16; 3]>() + size_of::<[[f64; 3]; 3]>() + 3 * size_of::<u64>();
        let of_vertex = piece::VERTEX_BYTES + queue::Queue::BYTES + 8 + Simplifier::BEST_BYTES;
        let worked = piece::TRIANGLE_BYTES + boxes::Boxes::BYTES + size_of::<Record<T, M>>() as u64;
        let marked = if M::CARRIED {
            let vertex = piece::MARKED_VERTEX_BYTES + size_of::<Corner>() as u64;
            size_of::<Marks>() as u64 + piece::MARKED_TRIANGLE_BYTES + vertex
        } else {
            0
        };
        (read as u64).max(worked) + of_vertex + marked
    }

    pub(super) fn push<T: Coordinate, M: Mark>(&mut self, record: &Record<T, M>) {
        self.triangles.push(record.vertices);
        self.classes.push(record.classes);
        self.places.push(record.places());
        self.drift.push(record.drift());
        if M::CARRIED {
            self.marks.push(record.marks());
        }
    }

    /// Collapses what can be, and gives the triangles that are the part's own. `inside` tells whether a place lies in the part. Where a pass was made within the same limits
    /// before, and space cut as `before` tells, vertices are tried that it could not, and those round which something changes.
    pub(super) fn simplified<T: Coordinate, M: Mark>(
        self,
        limits: Limits,
        inside: impl Fn([f64; 3]) -> bool,
        before: Option<&Space>,
    ) -> Vec<Record<T, M>> {
        let Gathered { mut triangles, classes, places, drift, marks } = self;
        let mut keys: Vec<u64> = Vec::with_capacity(3 * triangles.len());
        keys.extend(triangles.as_flattened().iter().zip(0u64..).map(|(&v, corner)| u64::from(v) << 32 | corner));
        keys.sort_unstable();
        let (mut numbers, mut positions, mut class) = (Vec::new(), Vec::new(), Vec::new());
        let mut blends = Vec::new();
        for key in keys {
            let (number, corner) = ((key >> 32) as u32, (key & 0xffff_ffff) as usize);
            if numbers.last() != Some(&number) {
                numbers.push(number);
                positions.push(DVec3::from_array(places[corner / 3][corner % 3]));
                class.push(classes[corner / 3][corner % 3]);
                if M::CARRIED {
                    blends.push(marks[corner / 3].corners[corner % 3]);
                }
            }
            triangles.as_flattened_mut()[corner] = numbers.len() as u32 - 1;
        }
        let tints = marks.iter().map(|marks| inwards(marks.tint)).collect();
        drop((places, classes, marks));
        let within: Vec<bool> = positions.iter().map(|place| inside(place.to_array())).collect();
        // A triangle that reaches out of the part belongs to others, too: it stays, and so do its corners.
        let mut fixed: Vec<bool> = within.iter().map(|within| !within).collect();
        for triangle in &triangles {
            if !triangle.iter().all(|v| within[*v as usize]) {
                triangle.iter().for_each(|v| fixed[*v as usize] = true);
            }
        }
        // Those of triangles that reached out of a part had to stay then; all others were tried, and could not go, or cost too much.
        let mut settled = vec![before.is_some(); positions.len()];
        if let Some(before) = before {
            for triangle in &triangles {
                let [a, b, c] = triangle.map(|v| before.part(positions[v as usize].to_array()));
                if a != b || a != c {
                    triangle.iter().for_each(|v| settled[*v as usize] = false);
                }
            }
        }
        let mut piece = Piece::new(positions, numbers, triangles, drift);
        (piece.fixed, piece.settled) = (fixed, settled);
        (piece.classes, piece.blends, piece.tints) = (class, blends, tints);
        // Where a vertex comes to lie, as it is written; none if that is not in the part.
        let placed = |place: DVec3| {
            let place = place.to_array().map(|c| -> f64 { T::from_f64(c).into() });
            inside(place).then(|| DVec3::from_array(place))
        };
        let mut simplifier = Simplifier::new(piece, limits, &placed);
        simplifier.run();
        let Piece { positions, numbers, triangles, drift, classes, blends, tints, .. } = simplifier.piece;
        let left = (0..triangles.len()).filter(|t| triangles[*t][0] != NONE);
        // One that reaches into several parts is written by that of its first corner.
        let own = left.filter(|t| within[triangles[*t][0] as usize]);
        own.map(|t| {
            let triangle = triangles[t];
            let of = |v: u32| positions[v as usize].to_array();
            let marks = if M::CARRIED {
                Marks { corners: triangle.map(|v| blends[v as usize]), tint: outwards(tints[t]) }
            } else {
                Marks::default()
            };
            Record::new(
                triangle.map(|v| numbers[v as usize]),
                triangle.map(|v| classes[v as usize]),
                triangle.map(of),
                drift[t],
                marks,
            )
        })
        .collect()
    }
}
