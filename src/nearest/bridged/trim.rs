//! The mesh written anew: with its distances as an attribute, without the triangles that are too far from any point, or both.
//!
//! ```text
//!   x far         1. triangles with a far vertex go
//!   o near        2. a vertex whose triangles that are left hang together in it alone (v) would be no manifold's:
//!                    it goes, too, with its triangles; all such vertices at once, until there are none
//!    o---o   x
//!    |  /|\  x x
//!    | / | v x x
//!    |/  |/ \x
//!    o---o---o
//! ```
//!
//! A round reads the triangles twice: the first time to find the vertices that have lost one, the second time for the triangles that these still have. Rounds go over the whole mesh, so
//! that neither memory nor the order of the work shows.

use bytemuck::Pod;

use crate::error::Result;
use crate::mesh::MeshSource;
use crate::mesh::corners::{Corners, fresh};
use crate::mesh::measure::Sums;
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::nearest::bridged::distances::Distances;
use crate::nearest::bridged::schema::with_bridged;
use crate::nearest::room::Room;
use crate::storage::partitions::Partitions;
use crate::storage::spool::Spool;

/// Vertices or triangles that are looked at together.
const PIECE: u64 = 1 << 12;
/// Vertices that are read at once for these triangles, if no others are named.
const WINDOW: usize = 1 << 14;

/// A vertex goes: it is far, or has no triangle left, or these would not make a manifold.
const GONE: u8 = 1;
/// It has lost a triangle.
const TOUCHED: u8 = 2;

/// What is asked of the finished mesh.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bridging {
    /// Whether distances are an attribute.
    pub carried: bool,
    /// Vertices farther than this from any point go.
    pub trim: Option<f64>,
    /// A triangle whose vertices are all farther than this bridges a hole.
    pub reach: f64,
}

/// The mesh written anew.
#[derive(Debug)]
pub(crate) struct Rewritten {
    pub mesh: MeshSpool,
    /// Triangles that were left out.
    pub left_out: u64,
    /// The area of those that bridge a hole and are left.
    pub bridged_area: f64,
}

/// Writes a mesh anew. Every vertex that is left is within the distance that is asked for; what is left of a manifold is one.
///
/// Memory: the room's. Disk: the new mesh, ten bytes for each vertex, and twelve for each corner at a vertex that has lost a triangle.
///
/// # Errors
/// [`crate::Error::InvalidSetting`] if the mesh has an attribute of that name; [`crate::Error::Io`]; [`crate::Error::Interrupted`].
pub(crate) fn rewritten(mesh: &MeshSpool, distances: &Distances, asked: Bridging, room: &Room) -> Result<Rewritten> {
    // Of each vertex of a range: its flags, and what is left of its star.
    let range = (room.corners * room.in_flight as u64 / (1 + 8 * size_of::<Left>() as u64)).max(1);
    let work = Work { mesh, distances, asked, room, range };
    let mut flags = work.far()?;
    let mut again = asked.trim.is_some();
    while again {
        (flags, again) = work.round(&flags)?;
    }
    work.write(&flags)
}

struct Work<'a> {
    mesh: &'a MeshSpool,
    distances: &'a Distances,
    asked: Bridging,
    room: &'a Room<'a>,
    /// Vertices of a partition.
    range: u64,
}

/// A triangle that is left at a vertex that has lost one: the vertex, and the two after it.
type Left = [u32; 3];

impl Work<'_> {
    /// Flags: of vertices that are far.
    fn far(&self) -> Result<Spool> {
        let mut out = self.room.spool();
        let (mut distances, mut flags) = (Vec::new(), Vec::new());
        for first in (0..self.mesh.vertex_count()).step_by(PIECE as usize) {
            fresh(&mut distances, (self.mesh.vertex_count() - first).min(PIECE) as usize);
            self.distances.read(first, &mut distances)?;
            let is_far = |d: &f32| self.asked.trim.is_some_and(|trim| f64::from(*d) > trim);
            flags.clear();
            flags.extend(distances.iter().map(|d| if is_far(d) { GONE } else { 0 }));
            out.append(&flags)?;
        }
        Ok(out)
    }

    /// The flags after another round, and whether there are more vertices that took triangles with them.
    fn round(&self, flags: &Spool) -> Result<(Spool, bool)> {
        let part_of = |v: u32| (u64::from(v) / self.range) as usize;
        let mut touched = self.partitions::<u32>();
        self.each_faces(flags, |face, flags| {
            if flags.contains(&GONE) {
                for (v, _) in face.iter().zip(flags).filter(|(_, flag)| *flag != GONE) {
                    touched.push(part_of(*v), v)?;
                }
            }
            Ok(())
        })?;
        let mut some = Vec::new();
        let flags = self.each_range(flags, |part, first, flags| {
            while touched.take(part, &mut some)? {
                some.drain(..).for_each(|v| flags[(u64::from(v) - first) as usize] = TOUCHED);
            }
            Ok(())
        })?;
        drop(touched);
        let mut left = self.partitions::<Left>();
        self.each_faces(&flags, |[a, b, c], flags| {
            if !flags.contains(&GONE) {
                let corners = [[a, b, c], [b, c, a], [c, a, b]];
                for (corner, _) in corners.iter().zip(flags).filter(|(_, flag)| *flag == TOUCHED) {
                    left.push(part_of(corner[0]), corner)?;
                }
            }
            Ok(())
        })?;
        let (mut again, mut corners) = (false, Vec::new());
        let flags = self.each_range(&flags, |part, first, flags| {
            corners.clear();
            while left.take(part, &mut corners)? {}
            corners.sort_unstable();
            let mut stars = corners.chunk_by(|a, b| a[0] == b[0]).peekable();
            for (v, flag) in (first as u32..).zip(flags).filter(|(_, flag)| **flag == TOUCHED) {
                let star = stars.next_if(|star| star[0][0] == v);
                *flag = if star.is_some_and(hangs_together) { 0 } else { GONE };
                again |= *flag == GONE && star.is_some();
            }
            Ok(())
        })?;
        Ok((flags, again))
    }

    /// The mesh without what is gone.
    fn write(&self, flags: &Spool) -> Result<Rewritten> {
        let (old, count) = (self.mesh.schema(), self.mesh.vertex_count());
        let schema = if self.asked.carried { with_bridged(old)? } else { old.clone() };
        let (stride, wide) = (old.stride(), schema.stride());
        let mut mesh = MeshSpool::with_attributes(self.room.workspace, self.mesh.precision(), schema, 0);
        let (mut numbers, mut next) = (self.room.spool(), 0u32);
        let mut piece = Vertices::default();
        for first in (0..count).step_by(PIECE as usize) {
            self.room.workers.check_cancelled()?;
            let len = (count - first).min(PIECE) as usize;
            piece.read(self, flags, stride, first, len)?;
            let (mut places, mut records, mut numbered) = (Vec::new(), Vec::with_capacity(len * wide), Vec::new());
            for v in 0..len {
                numbered.push(next);
                if piece.flags[v] == GONE {
                    continue;
                }
                next += 1;
                places.push(piece.places[v]);
                records.extend_from_slice(&piece.records[v * stride..][..stride]);
                if self.asked.carried {
                    records.extend_from_slice(&piece.distances[v].to_ne_bytes());
                }
            }
            mesh.append_vertices(&places)?;
            mesh.append_attributes(&records)?;
            numbers.append(bytemuck::cast_slice(&numbered))?;
        }
        let number = |first: u64, out: &mut [u32]| numbers.read_at(first * 4, bytemuck::cast_slice_mut(out));
        let (mut corners, mut bridging) = (Corners::<u32>::default(), Bridges::default());
        let (mut faces, mut bridged_area) = (Vec::new(), 0.0);
        let mut write = |kept: &mut Vec<[u32; 3]>| {
            bridged_area += bridging.area(self, kept)?;
            corners.fill_from(&number, kept, WINDOW)?;
            let records = kept.iter().map(|face| FaceRecord::new(face.map(|v| corners.table[v as usize])));
            mesh.append_faces(&records.collect::<Vec<_>>())?;
            kept.clear();
            Ok::<(), crate::Error>(())
        };
        self.each_faces(flags, |face, flags| {
            if !flags.contains(&GONE) {
                faces.push(face);
                if faces.len() as u64 == PIECE {
                    write(&mut faces)?;
                }
            }
            Ok(())
        })?;
        write(&mut faces)?;
        let left_out = self.mesh.face_count() - mesh.face_count();
        Ok(Rewritten { mesh, left_out, bridged_area })
    }

    fn partitions<T: Pod>(&self) -> Partitions<T> {
        self.room.partitions(self.mesh.vertex_count().div_ceil(self.range) as usize, 1)
    }

    /// Visits all triangles, in order, with the flags of their vertices.
    fn each_faces(&self, flags: &Spool, mut visit: impl FnMut([u32; 3], [u8; 3]) -> Result<()>) -> Result<()> {
        let (mut faces, mut looked, mut corners) = (Vec::new(), Vec::new(), Corners::<u8>::default());
        for first in (0..self.mesh.face_count()).step_by(PIECE as usize) {
            self.room.workers.check_cancelled()?;
            fresh(&mut faces, (self.mesh.face_count() - first).min(PIECE) as usize);
            self.mesh.read_faces(first, &mut faces)?;
            looked.clone_from(&faces);
            corners.fill_from(&|first, out| flags.read_at(first, out), &mut looked, WINDOW)?;
            for (face, at) in faces.iter().zip(&looked) {
                visit(*face, at.map(|v| corners.table[v as usize]))?;
            }
        }
        Ok(())
    }

    /// New flags: what `change` makes of those of each range, whose number and first vertex it is told.
    fn each_range(&self, flags: &Spool, mut change: impl FnMut(usize, u64, &mut [u8]) -> Result<()>) -> Result<Spool> {
        let mut out = self.room.spool();
        let mut some = Vec::new();
        for (part, first) in (0..self.mesh.vertex_count()).step_by(self.range as usize).enumerate() {
            self.room.workers.check_cancelled()?;
            fresh(&mut some, (self.mesh.vertex_count() - first).min(self.range) as usize);
            flags.read_at(first, &mut some)?;
            change(part, first, &mut some)?;
            out.append(&some)?;
        }
        Ok(out)
    }
}

/// Whether a vertex's triangles, of which each is that vertex and the two after it, follow each other round it, if those of the whole mesh did: no more than one of them begins where
/// none ends.
fn hangs_together(star: &[Left]) -> bool {
    let begins = star.iter().filter(|[_, begin, _]| star.iter().all(|[_, _, end]| end != begin));
    begins.take(2).count() < 2
}

/// Some vertices, and all that is known of them.
#[derive(Default)]
struct Vertices {
    flags: Vec<u8>,
    places: Vec<[f64; 3]>,
    records: Vec<u8>,
    distances: Vec<f32>,
}

impl Vertices {
    fn read(&mut self, of: &Work, flags: &Spool, stride: usize, first: u64, len: usize) -> Result<()> {
        fresh(&mut self.flags, len);
        fresh(&mut self.places, len);
        fresh(&mut self.records, len * stride);
        fresh(&mut self.distances, len);
        flags.read_at(first, &mut self.flags)?;
        of.mesh.read_vertices(first, &mut self.places)?;
        of.mesh.read_records(first, &mut self.records)?;
        of.distances.read(first, &mut self.distances)
    }
}

/// Measures the triangles that bridge a hole.
#[derive(Default)]
struct Bridges {
    distances: Corners<f32>,
    places: Corners,
    looked: Vec<[u32; 3]>,
}

impl Bridges {
    /// The area of those among `faces`.
    fn area(&mut self, of: &Work, faces: &[[u32; 3]]) -> Result<f64> {
        self.looked.clear();
        self.looked.extend_from_slice(faces);
        self.distances.fill_from(&|first, out| of.distances.read(first, out), &mut self.looked, WINDOW)?;
        let is_far = |v: &u32| f64::from(self.distances.table[*v as usize]) > of.asked.reach;
        let far = faces.iter().zip(&self.looked).filter(|(_, at)| at.iter().all(is_far));
        let mut far: Vec<[u32; 3]> = far.map(|(face, _)| *face).collect();
        self.places.fill(of.mesh, &mut far, WINDOW)?;
        Ok(Sums::of(&far, &self.places.table).area)
    }
}
