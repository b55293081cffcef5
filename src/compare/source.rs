//! The two sides as streams of places and triangles, in the input's coordinates less a common corner.

use super::blocks::SAMPLE;
use super::far;
use super::room::Room;
use super::shape::{FARTHEST, Point, Triangle};
use crate::error::Result;
use crate::grid::Bounds;
use crate::input::{Carried, Cloud};
use crate::mesh::MeshSource;
use crate::mesh::measure::{Corners, span};
use crate::points::{Coordinate, Points};

/// Places, and triangles, handled at once.
const PIECE: u64 = 1 << 14;

/// Bytes for each vertex of a window: see [`Corners::fill`].
const WINDOW_BYTES: u64 = 48;

/// A mesh, or a cloud.
pub(super) enum Source {
    Mesh(Box<dyn MeshSource>),
    Cloud(Cloud),
}

/// What a first look at a side's places tells.
#[derive(Debug, Clone)]
pub(super) struct Survey {
    /// Places that can be looked at.
    pub places: u64,
    /// Others.
    pub left_out: u64,
    /// Their box.
    pub bounds: Bounds,
    /// Some of them, evenly over their order.
    pub sample: Vec<Point>,
}

/// Whether a place can be looked at: it is finite, and not absurdly far.
pub(super) fn is_usable(p: Point) -> bool {
    // Not what compares false: NaN is left out, too.
    p.iter().all(|c| c.abs() <= FARTHEST)
}

impl Source {
    /// The mesh, if it is one.
    pub fn mesh(&self) -> Option<&dyn MeshSource> {
        match self {
            Source::Mesh(mesh) => Some(&**mesh),
            Source::Cloud(_) => None,
        }
    }

    /// Hands over all places, in order: vertices with the number of the piece's first, points with 0. Some may be unusable.
    ///
    /// # Errors
    /// Those of reading, of `work` and `sink`; [`crate::Error::Interrupted`].
    pub fn places<R: Send>(
        &self,
        corner: Point,
        room: &Room,
        work: impl Fn(u64, &[Point]) -> Result<R> + Sync,
        sink: impl FnMut(R) -> Result<()>,
    ) -> Result<()> {
        match self {
            Source::Mesh(mesh) => {
                let pieces = mesh.vertex_count().div_ceil(PIECE) as usize;
                let look = |number: usize| {
                    let first = number as u64 * PIECE;
                    let mut piece = vec![[0.0; 3]; (mesh.vertex_count() - first).min(PIECE) as usize];
                    mesh.read_vertices(first, &mut piece)?;
                    piece.iter_mut().for_each(|p| *p = placed(*p, mesh.origin(), corner));
                    work(first, &piece)
                };
                room.workers.in_order_range(room.in_flight, pieces, look, sink)
            }
            Source::Cloud(cloud) => {
                fn wide<T: Coordinate>(points: &[[T; 3]], corner: Point) -> Vec<Point> {
                    points.iter().map(|p| placed(p.map(Into::into), [0.0; 3], corner)).collect()
                }
                let look = |batch: &crate::points::Batch| {
                    let points = match &batch.points {
                        Points::Single(points) => wide(points, corner),
                        Points::Double(points) => wide(points, corner),
                    };
                    work(0, &points)
                };
                cloud.for_each_batch(room.workers, room.in_flight, Carried::Coordinates, look, sink)
            }
        }
    }

    /// Counts places, finds their box and takes a sample.
    ///
    /// # Errors
    /// As [`Source::places`].
    pub fn survey(&self, room: &Room, progress: &mut dyn FnMut(u64)) -> Result<Survey> {
        let mut all = Survey { places: 0, left_out: 0, bounds: Bounds::EMPTY, sample: Vec::new() };
        // Every so many places of a piece, and then every so many of these.
        let (within, mut every, mut number) = (4, 1u64, 0u64);
        let look = |_, places: &[Point]| {
            let mut bounds = Bounds::EMPTY;
            let usable = places.iter().filter(|p| is_usable(**p));
            let count = usable.clone().map(|p| bounds = bounds.union(Bounds { min: *p, max: *p })).count() as u64;
            let sample: Vec<Point> = usable.step_by(within).copied().collect();
            Ok((count, places.len() as u64 - count, bounds, sample))
        };
        self.places([0.0; 3], room, look, |(count, left_out, bounds, sample)| {
            all.places += count;
            all.left_out += left_out;
            all.bounds = all.bounds.union(bounds);
            for p in sample {
                if number.is_multiple_of(every) {
                    all.sample.push(p);
                }
                number += 1;
            }
            while all.sample.len() > 2 * SAMPLE {
                let mut odd = false;
                all.sample.retain(|_| {
                    odd = !odd;
                    odd
                });
                every *= 2;
            }
            progress(count + left_out);
            Ok(())
        })?;
        Ok(all)
    }
}

/// A vertex or point where it lies from the corner.
fn placed(p: Point, origin: Point, corner: Point) -> Point {
    // The sum first: it gives the input's own coordinates, bit for bit.
    std::array::from_fn(|a| (p[a] + origin[a]) - corner[a])
}

/// Hands over all triangles whose corners can be looked at, in any order.
///
/// # Errors
/// Those of reading, of `work` and `sink`; [`crate::Error::Interrupted`].
pub(super) fn triangles<R: Send>(
    mesh: &dyn MeshSource,
    corner: Point,
    room: &Room,
    work: impl Fn(&[Triangle]) -> Result<R> + Sync,
    mut sink: impl FnMut(R) -> Result<()>,
) -> Result<()> {
    // Of vertices that are read along: a mesh in good order spans about half as many as it has triangles.
    let window = (room.corners / WINDOW_BYTES) as usize;
    let done = |mut triangles: Vec<Triangle>| {
        triangles.iter_mut().flat_map(|t| &mut t.0).for_each(|p| *p = placed(*p, mesh.origin(), corner));
        triangles.retain(|t| t.0.iter().all(|p| is_usable(*p)));
        work(&triangles)
    };
    // Pieces whose vertices lie far apart wait.
    let mut far = Vec::new();
    let look = |piece: usize| {
        let first = piece as u64 * PIECE;
        let mut faces = vec![[0; 3]; (mesh.face_count() - first).min(PIECE) as usize];
        mesh.read_faces(first, &mut faces)?;
        if span(&faces).is_some_and(|(low, high)| (high - low) as usize >= window) {
            return Ok((piece as u64, None));
        }
        let mut corners = Corners::default();
        corners.fill(mesh, &mut faces, window)?;
        let triangles = faces.iter().map(|face| Triangle(face.map(|v| corners.table[v as usize])));
        Ok((piece as u64, Some(done(triangles.collect())?)))
    };
    let pieces = mesh.face_count().div_ceil(PIECE) as usize;
    room.workers.in_order_range(room.in_flight, pieces, look, |(piece, made)| match made {
        Some(made) => sink(made),
        None => {
            far.push(piece);
            Ok(())
        }
    })?;
    if far.is_empty() {
        return Ok(());
    }
    far::triangles(mesh, room, &far, PIECE, |triangles| {
        let pieces: Vec<&[Triangle]> = triangles.chunks(PIECE as usize).collect();
        let work = |piece: usize| done(pieces[piece].to_vec());
        room.workers.in_order_range(room.in_flight, pieces.len(), work, &mut sink)
    })
}
