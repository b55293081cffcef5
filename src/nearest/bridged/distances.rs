//! The distance of every vertex of a mesh from the nearest point, exact, by a search that needs no bound.

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::grid::occupancy::Sampled;
use crate::mesh::MeshSource;
use crate::nearest::blocks::{Blocks, SAMPLE};
use crate::nearest::room::Room;
use crate::nearest::search::{Nearest, search};
use crate::nearest::shape::{Point, Spot, is_usable};
use crate::nearest::tree::bytes_of;
use crate::points::Coordinate;
use crate::storage::spool::Spool;

/// Vertices that are looked at together, and distances that are read together.
const PIECE: u64 = 1 << 12;

/// Bytes of room for each point, with which all are in one block: it has three eighths of the room. And for each vertex, with which all distances are in one range: an eighth.
pub(super) const BYTES_OF_POINT: u64 = bytes_of::<Spot>() * 8 / 3;
pub(super) const BYTES_OF_VERTEX: u64 = 8 * size_of::<f32>() as u64;

/// The distances of a mesh's vertices, in order, in the unit of coordinates.
#[derive(Debug)]
pub(crate) struct Distances(Spool);

impl Distances {
    /// Those of the vertices from `first` on.
    ///
    /// # Errors
    /// [`crate::Error::Io`].
    pub fn read(&self, first: u64, out: &mut [f32]) -> Result<()> {
        self.0.read_at(first * size_of::<f32>() as u64, bytemuck::cast_slice_mut(out))
    }

    #[cfg(test)]
    pub(super) fn of(values: &[f32], room: &Room) -> Distances {
        let mut spool = room.spool();
        spool.append(bytemuck::cast_slice(values)).unwrap();
        Distances(spool)
    }
}

/// A vertex and its distance.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Told {
    vertex: u32,
    distance: f32,
}

/// Measures how far each vertex of `mesh` is from the nearest point that counts, where `origin` was taken off the mesh's positions. `done` is told the number of points and of vertices
/// that are done, which come to all points and all vertices.
///
/// Distances are computed in `f64` from the places that the mesh file has, and rounded to `f32`. Where coordinates are beyond 1e75, they are infinite. Memory: the room's.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Interrupted`].
pub(crate) fn distances<T: Coordinate>(
    mesh: &dyn MeshSource,
    origin: Point,
    sampled: &Sampled<'_, T>,
    room: &Room,
    done: &mut dyn FnMut(u64),
) -> Result<Distances> {
    let sample = sample(sampled, origin)?;
    let count = sampled.buckets.point_count();
    let mut blocks = Blocks::new(room, sample, count, |put| {
        let mut spots = Vec::new();
        for bucket in 0..sampled.buckets.count() {
            room.workers.check_cancelled()?;
            let counted = sampled.counted_in(bucket as u32)?;
            sampled.buckets.read(bucket, |points| {
                let counts = points.iter().map(|p| p.map(Into::into)).filter(|p| counted.contains(sampled.grid, *p));
                spots.clear();
                spots.extend(counts.map(|p| less(p, origin)).filter(|p| is_usable(*p)).map(Spot));
                done(points.len() as u64);
                put(&spots)
            })?;
        }
        Ok(())
    })?;
    let vertices = mesh.vertex_count();
    let range = (room.corners * room.in_flight as u64 / size_of::<f32>() as u64).max(1);
    let mut told = room.partitions(vertices.div_ceil(range) as usize, 3);
    if blocks.count() > 0 {
        let feed = |home: &(dyn Fn(Point) -> usize + Sync), put: &mut dyn FnMut(&[Nearest]) -> Result<()>| {
            let work = |piece: usize| {
                let first = piece as u64 * PIECE;
                let mut places = vec![[0.0; 3]; (vertices - first).min(PIECE) as usize];
                mesh.read_vertices(first, &mut places)?;
                let usable = (first..).zip(places).filter(|(_, p)| is_usable(*p));
                Ok(usable.map(|(vertex, p)| Nearest::new(vertex, p, home(p))).collect::<Vec<_>>())
            };
            let pieces = vertices.div_ceil(PIECE) as usize;
            room.workers.in_order_range(room.in_flight, pieces, work, |queries| put(&queries))
        };
        let mut waiting = 0;
        search(&mut blocks, room, feed, |query| {
            waiting += 1;
            if waiting == PIECE {
                done(std::mem::take(&mut waiting));
            }
            let known = Told { vertex: query.number as u32, distance: query.distance2.sqrt() as f32 };
            told.push((query.number / range) as usize, &known)
        })?;
        done(waiting);
    }
    drop(blocks);
    let mut out = room.spool();
    let (mut values, mut known) = (Vec::new(), Vec::new());
    for part in 0..told.count() {
        let first = part as u64 * range;
        values.clear();
        values.resize((vertices - first).min(range) as usize, f32::INFINITY);
        while told.take(part, &mut known)? {
            for Told { vertex, distance } in known.drain(..) {
                values[(u64::from(vertex) - first) as usize] = distance;
            }
        }
        out.append(bytemuck::cast_slice(&values))?;
    }
    Ok(Distances(out))
}

/// A place in the mesh's own coordinates.
fn less(p: Point, origin: Point) -> Point {
    std::array::from_fn(|a| p[a] - origin[a])
}

/// Some of the points, evenly over the buckets.
fn sample<T: Coordinate>(sampled: &Sampled<'_, T>, origin: Point) -> Result<Vec<Point>> {
    let every = (sampled.buckets.point_count() / SAMPLE as u64).max(1) as usize;
    let (mut out, mut number) = (Vec::new(), 0usize);
    for bucket in 0..sampled.buckets.count() {
        sampled.buckets.read(bucket, |points| {
            let skip = (every - number % every) % every;
            out.extend(points.iter().skip(skip).step_by(every).map(|p| less(p.map(Into::into), origin)));
            number += points.len();
            Ok(())
        })?;
    }
    out.retain(|p| is_usable(*p));
    Ok(out)
}
