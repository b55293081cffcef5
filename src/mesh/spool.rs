//! The mesh while it is being made: vertices and triangles in two spools, in the shapes a PLY file wants.

use std::ops::Range;

use bytemuck::Zeroable;

use super::MeshSource;
use super::measure::GROUP;
use crate::error::Result;
use crate::points::Precision;
use crate::points::attribute::Schema;
use crate::points::scalar::{Endian, reader};
use crate::storage::spool::{Extent, Spool, Workspace};

/// Elements converted at once: few enough for the fast caches and for small allocations, which cost no page faults.
const BATCH: usize = 1 << 12;

/// A triangle as a binary PLY file stores it: the number of corners, then the corners. 13 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Zeroable, bytemuck::Pod)]
#[repr(C, packed)]
pub struct FaceRecord {
    corners: u8,
    vertices: [u32; 3],
}

impl FaceRecord {
    /// A triangle of three vertex numbers.
    pub fn new(vertices: [u32; 3]) -> FaceRecord {
        FaceRecord { corners: 3, vertices }
    }
}

/// How positions are written: with the origin taken off, in the mesh's precision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Taken off every position.
    pub origin: [f64; 3],
    /// What is left is rounded to this.
    pub precision: Precision,
}

impl Frame {
    /// The position as it is read back from the mesh.
    #[inline]
    pub fn place(&self, position: [f64; 3]) -> [f64; 3] {
        let moved = std::array::from_fn(|a| position[a] - self.origin[a]);
        match self.precision {
            Precision::Single => moved.map(|c| f64::from(c as f32)),
            Precision::Double => moved,
        }
    }
}

/// A mesh in temporary storage: appended in order, then read back as a [`MeshSource`].
///
/// It may be of several parts, each made by itself with numbers of its own ([`MeshSpool::cut`], [`MeshSpool::join`]); what is read is one mesh.
#[derive(Debug)]
pub struct MeshSpool {
    precision: Precision,
    origin: [f64; 3],
    schema: Schema,
    /// At least one; what is appended goes to the last.
    parts: Vec<Part>,
    /// Vertices on their way to their spool.
    narrowed: Vec<[f32; 3]>,
    groups: Groups,
}

/// How far apart the vertices lie that groups of [`GROUP`] triangles name, while triangles are appended.
#[derive(Debug, Clone, Copy)]
struct Groups {
    /// Triangles of the last group, and the least and the greatest vertex that they name.
    last: (usize, u32, u32),
    /// All that were appended.
    triangles: u64,
    /// Of all groups before, and of all triangles, how many vertices lie between the two, at the most.
    spans: Spans,
}

/// How many vertices lie between the least and the greatest that some triangles name, at the most.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Spans {
    /// Of groups of [`GROUP`] triangles.
    pub group: u64,
    /// Of single triangles.
    pub triangle: u64,
}

impl Groups {
    const NONE: Groups = Groups { last: (0, u32::MAX, 0), triangles: 0, spans: Spans { group: 0, triangle: 0 } };

    fn add(&mut self, mut faces: &[FaceRecord]) {
        self.triangles += faces.len() as u64;
        while !faces.is_empty() {
            let (count, mut low, mut high) = self.last;
            let (now, rest) = faces.split_at(faces.len().min(GROUP - count));
            let mut widest = 0;
            for face in now {
                let [a, b, c] = face.vertices;
                let (least, most) = (a.min(b).min(c), a.max(b).max(c));
                (low, high, widest) = (low.min(least), high.max(most), widest.max(most - least));
            }
            self.spans.triangle = self.spans.triangle.max(u64::from(widest) + 1);
            (self.last, faces) = ((count + now.len(), low, high), rest);
            if self.last.0 == GROUP {
                (self.spans, self.last) = (self.all(), Groups::NONE.last);
            }
        }
    }

    fn all(&self) -> Spans {
        let (count, low, high) = self.last;
        let last = if count > 0 { u64::from(high - low) + 1 } else { 0 };
        Spans { group: self.spans.group.max(last), ..self.spans }
    }
}

/// Vertices and triangles that were made together.
#[derive(Debug)]
struct Part {
    vertices: Spool,
    attributes: Spool,
    faces: Spool,
    /// The first vertex and the first triangle that are read: those before were cut off.
    from: [u64; 2],
    /// The vertex and the triangle behind the last that are read, unless all are.
    until: Option<[u64; 2]>,
    /// The number in the mesh of the first vertex that is read, and of the first triangle.
    first: [u64; 2],
}

impl Part {
    /// Added to the numbers that its triangles name, gives those in the mesh. Below zero, numbers wrap.
    fn base(&self) -> u32 {
        (self.first[0] as u32).wrapping_sub(self.from[0] as u32)
    }
}

impl MeshSpool {
    /// An empty mesh that keeps up to `in_memory` bytes in memory.
    pub fn new(workspace: &Workspace, precision: Precision, in_memory: u64) -> MeshSpool {
        MeshSpool::with_attributes(workspace, precision, Schema::default(), in_memory)
    }

    /// [`MeshSpool::new`] for vertices that have attributes.
    pub fn with_attributes(workspace: &Workspace, precision: Precision, schema: Schema, in_memory: u64) -> MeshSpool {
        // There are two triangles for each vertex.
        let (vertex, faces) = (3 * precision.bytes() as u64, 2 * size_of::<FaceRecord>() as u64);
        let record = schema.stride() as u64;
        let share = in_memory / (vertex + record + faces);
        let [vertices, attributes] = [share * vertex, share * record].map(|quota| workspace.spool(quota));
        let faces = workspace.spool(in_memory - share * (vertex + record));
        let part = Part { vertices, attributes, faces, from: [0; 2], until: None, first: [0; 2] };
        MeshSpool { precision, origin: [0.0; 3], schema, parts: vec![part], narrowed: Vec::new(), groups: Groups::NONE }
    }

    /// The mesh without its first `vertices` and `faces`. Triangles keep their numbers: those that are left may name vertices before the first one, which are another
    /// part's last ones.
    #[must_use]
    pub fn cut(mut self, vertices: u64, faces: u64) -> MeshSpool {
        let [part] = &mut self.parts[..] else { panic!("a mesh of one part is cut") };
        part.from = [vertices, faces];
        self
    }

    /// [`MeshSpool::cut`] at both ends: of its vertices and its triangles, those within ranges.
    #[must_use]
    pub fn within(mut self, [vertices, faces]: [Range<u64>; 2]) -> MeshSpool {
        let [part] = &mut self.parts[..] else { panic!("a mesh of one part is cut") };
        (part.from, part.until) = ([vertices.start, faces.start], Some([vertices.end, faces.end]));
        self
    }

    /// Another mesh's parts behind this one's, with vertices numbered through.
    pub fn join(&mut self, mut other: MeshSpool) {
        let ends = [self.vertex_count(), self.face_count()];
        for part in &mut other.parts {
            part.first = [0, 1].map(|i| part.first[i] + ends[i]);
        }
        self.parts.append(&mut other.parts);
    }

    /// The mesh in spools of its vertices, attributes and triangles, which may hold some already.
    pub fn in_spools(precision: Precision, schema: Schema, [vertices, attributes, faces]: [Spool; 3]) -> MeshSpool {
        let part = Part { vertices, attributes, faces, from: [0; 2], until: None, first: [0; 2] };
        MeshSpool { precision, origin: [0.0; 3], schema, parts: vec![part], narrowed: Vec::new(), groups: Groups::NONE }
    }

    /// Whether it holds so many vertices, their attributes, and so many triangles, and nothing else.
    pub fn holds(&self, vertices: u64, faces: u64) -> bool {
        let (place, stride) = (3 * self.precision.bytes() as u64, self.schema.stride() as u64);
        let lengths = |part: &Part| [part.vertices.len(), part.attributes.len(), part.faces.len()];
        let all = [vertices * place, vertices * stride, faces * size_of::<FaceRecord>() as u64];
        self.parts.iter().map(lengths).fold([0; 3], |sum, more| [0, 1, 2].map(|i| sum[i] + more[i])) == all
    }

    /// What was appended to its vertices, attributes and triangles since the last time ([`Spool::extent`]).
    pub fn extents(&mut self) -> [Extent; 3] {
        let Part { vertices, attributes, faces, .. } = self.last();
        [vertices.extent(), attributes.extent(), faces.extent()]
    }

    /// The same mesh, at an origin that was read with it.
    pub fn placed(self, origin: [f64; 3]) -> MeshSpool {
        MeshSpool { origin, ..self }
    }

    /// Appends the records of vertices' attributes; there is to be one for each vertex in the end.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn append_attributes(&mut self, records: &[u8]) -> Result<()> {
        self.last().attributes.append(records)?;
        Ok(())
    }

    /// Appends vertices, rounding to the mesh's precision.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn append_vertices(&mut self, vertices: &[[f64; 3]]) -> Result<()> {
        match self.precision {
            Precision::Double => self.last().vertices.append(bytemuck::cast_slice(vertices))?,
            Precision::Single => {
                let mut narrowed = std::mem::take(&mut self.narrowed);
                narrowed.clear();
                narrowed.extend(vertices.iter().map(|v| v.map(|c| c as f32)));
                let appended = self.last().vertices.append(bytemuck::cast_slice(&narrowed));
                self.narrowed = narrowed;
                appended?
            }
        };
        Ok(())
    }

    /// Appends triangles.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn append_faces(&mut self, faces: &[FaceRecord]) -> Result<()> {
        self.last().faces.append(bytemuck::cast_slice(faces))?;
        self.groups.add(faces);
        Ok(())
    }

    /// How far apart the vertices of its triangles lie, if all of these were appended to it, and to nothing else.
    pub fn spans(&self) -> Option<Spans> {
        let [Part { from: [0, 0], until: None, .. }] = &self.parts[..] else { return None };
        (self.groups.triangles == self.face_count()).then(|| self.groups.all())
    }

    fn last(&mut self) -> &mut Part {
        self.parts.last_mut().expect("a mesh has a part")
    }

    /// Bytes of all of it.
    pub fn bytes(&self) -> u64 {
        let of_vertex = (3 * self.precision.bytes() + self.schema.stride()) as u64;
        self.vertex_count() * of_vertex + self.face_count() * size_of::<FaceRecord>() as u64
    }

    /// How many vertices (0) or triangles (1) a part has that are read.
    fn of_part(&self, part: &Part, kind: usize) -> u64 {
        let end = match (part.until, kind) {
            (Some(until), _) => until[kind],
            (None, 0) => part.vertices.len() / (3 * self.precision.bytes() as u64),
            (None, _) => part.faces.len() / size_of::<FaceRecord>() as u64,
        };
        end - part.from[kind]
    }

    fn count(&self, kind: usize) -> u64 {
        self.parts.last().map_or(0, |last| last.first[kind] + self.of_part(last, kind))
    }

    /// Hands `read` each part's stretch of the `count` vertices (0) or triangles (1) from `first` on: the part, the number there, and where it lies among those asked for.
    fn stretches(
        &self,
        kind: usize,
        first: u64,
        count: usize,
        mut read: impl FnMut(&Part, u64, Range<usize>) -> Result<()>,
    ) -> Result<()> {
        let mut done = 0;
        let mut number = self.parts.partition_point(|part| part.first[kind] <= first).saturating_sub(1);
        while done < count {
            let at = first + done as u64;
            let part = self.parts.get(number).expect("no more is read than there is");
            let left = (part.first[kind] + self.of_part(part, kind)).saturating_sub(at);
            let now = done..done + left.min((count - done) as u64) as usize;
            (number, done) = (number + 1, now.end);
            if !now.is_empty() {
                read(part, part.from[kind] + (at - part.first[kind]), now)?;
            }
        }
        Ok(())
    }

    /// Fills `out` with the bytes of vertices `first ..`: `x y z` in native order, 12 or 24 bytes each.
    ///
    /// # Errors
    /// [`crate::Error::Io`]; [`crate::Error::Interrupted`].
    pub fn read_vertex_bytes(&self, first: u64, out: &mut [u8]) -> Result<()> {
        let stride = 3 * self.precision.bytes();
        self.stretches(0, first, out.len() / stride, |part, at, now| {
            part.vertices.read_at(at * stride as u64, &mut out[now.start * stride..now.end * stride])
        })
    }

    /// Fills `out` with the attributes of vertices `first ..`: records of the schema.
    ///
    /// # Errors
    /// The same as [`MeshSpool::read_vertex_bytes`].
    pub fn read_records(&self, first: u64, out: &mut [u8]) -> Result<()> {
        let stride = self.schema.stride();
        self.stretches(0, first, out.len().checked_div(stride).unwrap_or(0), |part, at, now| {
            part.attributes.read_at(at * stride as u64, &mut out[now.start * stride..now.end * stride])
        })
    }

    /// Fills `out` with the records of triangles `first ..`.
    ///
    /// # Errors
    /// The same as [`MeshSpool::read_vertex_bytes`].
    pub fn read_face_records(&self, first: u64, out: &mut [FaceRecord]) -> Result<()> {
        self.stretches(1, first, out.len(), |part, at, now| {
            let records = &mut out[now];
            part.faces.read_at(at * size_of::<FaceRecord>() as u64, bytemuck::cast_slice_mut(records))?;
            let base = part.base();
            if base != 0 {
                for record in records {
                    record.vertices = { record.vertices }.map(|v| v.wrapping_add(base));
                }
            }
            Ok(())
        })
    }
}

impl MeshSource for MeshSpool {
    fn vertex_count(&self) -> u64 {
        self.count(0)
    }

    fn face_count(&self) -> u64 {
        self.count(1)
    }

    fn origin(&self) -> [f64; 3] {
        self.origin
    }

    fn precision(&self) -> Precision {
        self.precision
    }

    fn read_vertices(&self, first: u64, out: &mut [[f64; 3]]) -> Result<()> {
        match self.precision {
            Precision::Double => self.read_vertex_bytes(first, bytemuck::cast_slice_mut(out)),
            Precision::Single => {
                let mut narrow = vec![[0f32; 3]; out.len().min(BATCH)];
                for (batch, out) in out.chunks_mut(BATCH).enumerate() {
                    let narrow = &mut narrow[..out.len()];
                    self.read_vertex_bytes(first + (batch * BATCH) as u64, bytemuck::cast_slice_mut(narrow))?;
                    for (wide, narrow) in out.iter_mut().zip(narrow) {
                        *wide = narrow.map(f64::from);
                    }
                }
                Ok(())
            }
        }
    }

    fn read_faces(&self, first: u64, out: &mut [[u32; 3]]) -> Result<()> {
        let mut records = vec![FaceRecord::zeroed(); out.len().min(BATCH)];
        for (batch, out) in out.chunks_mut(BATCH).enumerate() {
            let records = &mut records[..out.len()];
            self.read_face_records(first + (batch * BATCH) as u64, records)?;
            for (face, record) in out.iter_mut().zip(records) {
                *face = record.vertices;
            }
        }
        Ok(())
    }

    fn schema(&self) -> &Schema {
        &self.schema
    }

    fn read_attribute(&self, number: usize, first: u64, out: &mut [f64]) -> Result<()> {
        let (column, stride) = (self.schema.column_at(number), self.schema.stride());
        let read = reader(column.scalar, Endian::NATIVE);
        let mut records = vec![0; out.len().min(BATCH) * stride];
        for (batch, out) in out.chunks_mut(BATCH).enumerate() {
            let records = &mut records[..out.len() * stride];
            self.read_records(first + (batch * BATCH) as u64, records)?;
            for (value, record) in out.iter_mut().zip(records.chunks_exact(stride)) {
                *value = read(&record[column.offset..]);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::points::attribute::Attribute;
    use crate::points::scalar::Scalar;

    /// Vertices whose places and attributes are their numbers in the mesh, and triangles of three that follow each other, with `base` taken off their numbers.
    fn mesh(
        workspace: &Workspace,
        precision: Precision,
        vertices: Range<u32>,
        faces: Range<u32>,
        base: u32,
    ) -> MeshSpool {
        let schema = Schema::new(vec![Attribute::new("number", Scalar::U32)]);
        let mut mesh = MeshSpool::with_attributes(workspace, precision, schema, 100);
        let places: Vec<[f64; 3]> = vertices.clone().map(|v| [f64::from(v); 3]).collect();
        mesh.append_vertices(&places).unwrap();
        vertices.for_each(|v| mesh.append_attributes(&v.to_ne_bytes()).unwrap());
        let corners = |t: u32| [t, t + 1, t + 2].map(|v| v.wrapping_sub(base));
        let faces: Vec<FaceRecord> = faces.map(|t| FaceRecord::new(corners(t))).collect();
        mesh.append_faces(&faces).unwrap();
        mesh
    }

    #[test]
    fn spans_are_known_of_triangles_that_were_appended_to_one_part() {
        let folder = tempfile::tempdir().unwrap();
        let workspace = Workspace::new(folder.path()).unwrap();
        let mut mesh = MeshSpool::new(&workspace, Precision::Single, 0);
        let spans = |group, triangle| Some(Spans { group, triangle });
        assert_eq!(mesh.spans(), spans(0, 0));
        let small = vec![FaceRecord::new([5, 6, 7]); GROUP - 1];
        mesh.append_faces(&small).unwrap();
        assert_eq!(mesh.spans(), spans(3, 3));
        // The first of these is the group's last, and the others are another's.
        mesh.append_faces(&[FaceRecord::new([0, 6, 9]), FaceRecord::new([40, 30, 48]), FaceRecord::new([31, 30, 32])])
            .unwrap();
        assert_eq!(mesh.spans(), spans(19, 19));
        mesh.append_faces(&[FaceRecord::new([28, 30, 31])]).unwrap();
        assert_eq!(mesh.spans(), spans(21, 19));
        let mut both = MeshSpool::new(&workspace, Precision::Single, 0);
        both.join(mesh);
        assert_eq!(both.spans(), None);
    }

    proptest! {
        /// Parts that number from their own first vertex, with something cut off the start of each, are read as one mesh.
        #[test]
        fn parts_are_read_as_one(
            sizes in prop::collection::vec([0u32..30, 0u32..30, 0u32..9, 0u32..9], 1..5),
            single in any::<bool>(),
            first in any::<prop::sample::Index>(),
            count in any::<prop::sample::Index>(),
        ) {
            let dir = tempfile::tempdir().unwrap();
            let workspace = Workspace::new(dir.path()).unwrap();
            let precision = if single { Precision::Single } else { Precision::Double };
            let [mut vertices, mut faces] = [0, 0];
            let mut whole: Option<MeshSpool> = None;
            for [more, triangles, over, cut] in sizes {
                // What is cut off is what the parts before have already; the first part lacks nothing.
                let [over, cut] = if whole.is_some() { [over.min(vertices), cut.min(faces)] } else { [0, 0] };
                let base = vertices - over;
                let part = mesh(&workspace, precision, base..vertices + more, faces - cut..faces + triangles, base);
                let part = part.cut(u64::from(over), u64::from(cut));
                match &mut whole {
                    None => whole = Some(part),
                    Some(whole) => whole.join(part),
                }
                (vertices, faces) = (vertices + more, faces + triangles);
            }
            let (whole, one) = (whole.unwrap(), mesh(&workspace, precision, 0..vertices, 0..faces, 0));
            let sizes = |of: &MeshSpool| [of.vertex_count(), of.face_count(), of.bytes()];
            prop_assert_eq!(sizes(&whole), sizes(&one));
            let stretch = |all: u32| {
                let first = first.index(all as usize + 1);
                (first as u64, count.index(all as usize - first + 1))
            };
            let (from, len) = stretch(vertices);
            let read = |of: &MeshSpool| {
                let (mut places, mut numbers, mut records) = (vec![[0.0; 3]; len], vec![0.0; len], vec![0; 4 * len]);
                of.read_vertices(from, &mut places).unwrap();
                of.read_attribute(0, from, &mut numbers).unwrap();
                of.read_records(from, &mut records).unwrap();
                (places, numbers, records)
            };
            prop_assert_eq!(read(&whole), read(&one));
            let (from, len) = stretch(faces);
            let read = |of: &MeshSpool| {
                let mut faces = vec![[0; 3]; len];
                of.read_faces(from, &mut faces).unwrap();
                faces
            };
            prop_assert_eq!(read(&whole), read(&one));
        }
    }
}
