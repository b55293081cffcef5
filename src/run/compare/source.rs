//! The two sides as streams of places and triangles, in the input's coordinates less a common corner.

use crate::error::Result;
use crate::input::{Carried, Cloud};
use crate::mesh::MeshSource;
use crate::mesh::corners::{Block, Lookup, Order};
use crate::nearest::blocks::SAMPLE;
use crate::nearest::room::Room;
use crate::nearest::shape::{Point, Triangle, is_usable};
use crate::points::bounds::Bounds;
use crate::points::{Batch, Coordinate, Points};
use crate::resources::workers::Spares;

/// Places, and triangles, handled at once.
const PIECE: u64 = 1 << 14;

/// Bytes for each vertex of a window: see [`crate::mesh::corners::Corners::fill`].
const WINDOW_BYTES: u64 = 48;

/// A mesh, or a cloud.
pub(super) enum Source {
    Mesh(Box<dyn MeshSource>),
    Cloud(Box<Cloud<'static>>),
}

/// What a first look at a side's places tells.
#[derive(Debug, Clone)]
pub(super) struct Survey {
    /// Places that can be looked at.
    pub places: u64,
    /// Others.
    pub left_out: LeftOut,
    /// Their box.
    pub bounds: Bounds,
    /// Some of them, evenly over their order.
    pub sample: Vec<Point>,
}

/// Places that are not looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct LeftOut {
    /// Not finite, or absurdly far.
    pub dropped: u64,
    /// Not asked for.
    pub filtered: u64,
}

impl Source {
    /// The mesh, if it is one.
    pub fn mesh(&self) -> Option<&dyn MeshSource> {
        match self {
            Source::Mesh(mesh) => Some(&**mesh),
            Source::Cloud(_) => None,
        }
    }

    /// Hands what `work` makes of all places to `sink`, in order: of vertices with the number of the piece's first, of points with 0. Some may be unusable; those
    /// that the reader of a cloud left out are counted.
    ///
    /// # Errors
    /// Errors of reading and of `sink`; [`crate::Error::Interrupted`].
    pub fn places<Q: Send>(
        &self,
        corner: Point,
        room: &Room,
        work: impl Fn(u64, &[Point], &mut Vec<Q>) + Sync,
        mut sink: impl FnMut(&[Q]) -> Result<()>,
    ) -> Result<LeftOut> {
        // Handed to and fro: what one thread takes and another gives back would wait for the first.
        let (pieces, made) = (Spares::<Vec<Point>>::default(), Spares::<Vec<Q>>::default());
        let work = |first: u64, piece: &[Point]| {
            let mut queries = made.take().unwrap_or_default();
            queries.clear();
            work(first, piece, &mut queries);
            queries
        };
        let mut sink = |queries: Vec<Q>| {
            sink(&queries)?;
            made.give(queries);
            Ok(())
        };
        match self {
            Source::Mesh(mesh) => {
                let look = |number: usize| {
                    let first = number as u64 * PIECE;
                    pieces.lend(|piece| {
                        piece.resize((mesh.vertex_count() - first).min(PIECE) as usize, [0.0; 3]);
                        mesh.read_vertices(first, piece)?;
                        piece.iter_mut().for_each(|p| *p = placed(*p, mesh.origin(), corner));
                        Ok(work(first, piece))
                    })
                };
                let count = mesh.vertex_count().div_ceil(PIECE) as usize;
                room.workers.in_order_range(room.in_flight, count, look, sink)?;
                Ok(LeftOut::default())
            }
            Source::Cloud(cloud) => {
                fn widen<T: Coordinate>(points: &[[T; 3]], corner: Point, piece: &mut Vec<Point>) {
                    piece.clear();
                    piece.extend(points.iter().map(|p| placed(p.map(Into::into), [0.0; 3], corner)));
                }
                let look = |batch: &Batch| {
                    pieces.lend(|piece| {
                        match &batch.points {
                            Points::Single(points) => widen(points, corner, piece),
                            Points::Double(points) => widen(points, corner, piece),
                        }
                        Ok((work(0, piece), batch.dropped, batch.filtered))
                    })
                };
                let mut left_out = LeftOut::default();
                let sink = |(queries, dropped, filtered)| {
                    left_out.dropped += dropped;
                    left_out.filtered += filtered;
                    sink(queries)
                };
                cloud.for_each_batch(room.workers, room.in_flight, Carried::Coordinates, look, sink)?;
                Ok(left_out)
            }
        }
    }

    /// Counts places, finds their box and takes a sample.
    ///
    /// # Errors
    /// The same as [`Source::places`].
    pub fn survey(&self, room: &Room, progress: &mut dyn FnMut(u64)) -> Result<Survey> {
        let mut all = Survey { places: 0, left_out: LeftOut::default(), bounds: Bounds::EMPTY, sample: Vec::new() };
        // Every so many places of a piece, and then every so many of these.
        let (within, mut every, mut number) = (4, 1u64, 0u64);
        let look = |_, places: &[Point], out: &mut Vec<_>| {
            let mut bounds = Bounds::EMPTY;
            let usable = places.iter().filter(|p| is_usable(**p));
            let count = usable.clone().map(|p| bounds = bounds.union(Bounds { min: *p, max: *p })).count() as u64;
            let sample: Vec<Point> = usable.step_by(within).copied().collect();
            out.push((count, places.len() as u64 - count, bounds, sample));
        };
        let mut far = 0;
        all.left_out = self.places([0.0; 3], room, look, |parts| {
            let [(count, beyond, bounds, sample)] = parts else { return Ok(()) };
            all.places += count;
            far += beyond;
            all.bounds = all.bounds.union(*bounds);
            for p in sample {
                if number.is_multiple_of(every) {
                    all.sample.push(*p);
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
            progress(count + beyond);
            Ok(())
        })?;
        all.left_out.dropped += far;
        Ok(all)
    }
}

/// A vertex or point where it lies from the corner.
fn placed(p: Point, origin: Point, corner: Point) -> Point {
    // The sum first: it gives the input's own coordinates, bit for bit.
    std::array::from_fn(|a| (p[a] + origin[a]) - corner[a])
}

/// Hands what `work` makes of all triangles whose corners can be looked at to `sink`, in any order.
///
/// # Errors
/// Errors of reading and of `sink`; [`crate::Error::Interrupted`].
pub(super) fn triangles<Q: Send>(
    mesh: &dyn MeshSource,
    corner: Point,
    room: &Room,
    work: impl Fn(&[Triangle], &mut Vec<Q>) + Sync,
    mut sink: impl FnMut(&[Q]) -> Result<()>,
) -> Result<()> {
    let lookup = Lookup {
        mesh,
        workers: room.workers,
        workspace: room.workspace,
        block: PIECE as usize,
        // Of vertices that are read along: a mesh in good order spans about half as many as it has triangles.
        window: (room.corners / WINDOW_BYTES) as usize,
        in_flight: room.in_flight,
        memory: room.far(),
    };
    let (pieces, made) = (Spares::<Vec<Triangle>>::default(), Spares::<Vec<Q>>::default());
    let work = |block: &Block<'_, Point>| {
        pieces.lend(|triangles| {
            triangles.clear();
            triangles
                .extend(block.corners().map(|corners| Triangle(corners.map(|p| placed(p, mesh.origin(), corner)))));
            triangles.retain(|t| t.0.iter().all(|p| is_usable(*p)));
            let mut queries = made.take().unwrap_or_default();
            queries.clear();
            work(triangles, &mut queries);
            Ok(queries)
        })
    };
    let blocks = 0..mesh.face_count().div_ceil(PIECE);
    let read = |first: u64, places: &mut [Point]| mesh.read_vertices(first, places);
    lookup.for_each(blocks, Order::NearFirst, &read, work, |queries| {
        sink(&queries)?;
        made.give(queries);
        Ok(())
    })
}
