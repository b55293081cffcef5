//! The mesh while it is being made: vertices and triangles in two spools, in the shapes a PLY file wants.

use bytemuck::Zeroable;

use super::MeshSource;
use crate::error::Result;
use crate::points::Precision;
use crate::points::attribute::Schema;
use crate::points::scalar::{Endian, reader};
use crate::storage::spool::{Extent, Spool, Workspace};

/// Elements converted at once: few enough for the fast caches and for small allocations, which cost no page faults.
const PIECE: usize = 1 << 12;

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
#[derive(Debug)]
pub struct MeshSpool {
    precision: Precision,
    origin: [f64; 3],
    schema: Schema,
    vertices: Spool,
    attributes: Spool,
    faces: Spool,
    /// Vertices on their way to their spool.
    narrowed: Vec<[f32; 3]>,
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
        MeshSpool { precision, origin: [0.0; 3], schema, vertices, attributes, faces, narrowed: Vec::new() }
    }

    /// The mesh in spools of its vertices, attributes and triangles, which may hold some already.
    pub fn in_spools(precision: Precision, schema: Schema, [vertices, attributes, faces]: [Spool; 3]) -> MeshSpool {
        MeshSpool { precision, origin: [0.0; 3], schema, vertices, attributes, faces, narrowed: Vec::new() }
    }

    /// Whether it holds so many vertices, their attributes, and so many triangles, and nothing else.
    pub fn holds(&self, vertices: u64, faces: u64) -> bool {
        let place = 3 * self.precision.bytes() as u64;
        self.vertices.len() == vertices * place
            && self.attributes.len() == vertices * self.schema.stride() as u64
            && self.faces.len() == faces * size_of::<FaceRecord>() as u64
    }

    /// What was appended to its vertices, attributes and triangles since the last cut ([`Spool::cut`]).
    pub fn cut(&mut self) -> [Extent; 3] {
        [self.vertices.cut(), self.attributes.cut(), self.faces.cut()]
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
        self.attributes.append(records)?;
        Ok(())
    }

    /// Appends vertices, rounding to the mesh's precision.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn append_vertices(&mut self, vertices: &[[f64; 3]]) -> Result<()> {
        match self.precision {
            Precision::Double => self.vertices.append(bytemuck::cast_slice(vertices))?,
            Precision::Single => {
                self.narrowed.clear();
                self.narrowed.extend(vertices.iter().map(|v| v.map(|c| c as f32)));
                self.vertices.append(bytemuck::cast_slice(&self.narrowed))?
            }
        };
        Ok(())
    }

    /// Appends triangles.
    ///
    /// # Errors
    /// [`crate::Error::Io`] if the work directory is full.
    pub fn append_faces(&mut self, faces: &[FaceRecord]) -> Result<()> {
        self.faces.append(bytemuck::cast_slice(faces))?;
        Ok(())
    }

    /// Bytes of all of it.
    pub fn bytes(&self) -> u64 {
        self.vertices.len() + self.attributes.len() + self.faces.len()
    }

    /// The vertices' bytes: `x y z` in native order, 12 or 24 bytes each.
    pub fn vertex_bytes(&self) -> &Spool {
        &self.vertices
    }

    /// The attributes' bytes: records of the schema.
    pub fn attribute_bytes(&self) -> &Spool {
        &self.attributes
    }

    /// The triangles' bytes: [`FaceRecord`]s.
    pub fn face_bytes(&self) -> &Spool {
        &self.faces
    }
}

impl MeshSource for MeshSpool {
    fn vertex_count(&self) -> u64 {
        self.vertices.len() / (3 * self.precision.bytes() as u64)
    }

    fn face_count(&self) -> u64 {
        self.faces.len() / size_of::<FaceRecord>() as u64
    }

    fn origin(&self) -> [f64; 3] {
        self.origin
    }

    fn precision(&self) -> Precision {
        self.precision
    }

    fn read_vertices(&self, first: u64, out: &mut [[f64; 3]]) -> Result<()> {
        let stride = 3 * self.precision.bytes() as u64;
        match self.precision {
            Precision::Double => self.vertices.read_at(first * stride, bytemuck::cast_slice_mut(out)),
            Precision::Single => {
                let mut narrow = vec![[0f32; 3]; out.len().min(PIECE)];
                for (piece, out) in out.chunks_mut(PIECE).enumerate() {
                    let narrow = &mut narrow[..out.len()];
                    let at = (first + (piece * PIECE) as u64) * stride;
                    self.vertices.read_at(at, bytemuck::cast_slice_mut(narrow))?;
                    for (wide, narrow) in out.iter_mut().zip(narrow) {
                        *wide = narrow.map(f64::from);
                    }
                }
                Ok(())
            }
        }
    }

    fn read_faces(&self, first: u64, out: &mut [[u32; 3]]) -> Result<()> {
        let stride = size_of::<FaceRecord>() as u64;
        let mut records = vec![FaceRecord::zeroed(); out.len().min(PIECE)];
        for (piece, out) in out.chunks_mut(PIECE).enumerate() {
            let records = &mut records[..out.len()];
            let at = (first + (piece * PIECE) as u64) * stride;
            self.faces.read_at(at, bytemuck::cast_slice_mut(records))?;
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
        let mut records = vec![0; out.len().min(PIECE) * stride];
        for (piece, out) in out.chunks_mut(PIECE).enumerate() {
            let records = &mut records[..out.len() * stride];
            self.attributes.read_at((first + (piece * PIECE) as u64) * stride as u64, records)?;
            for (value, record) in out.iter_mut().zip(records.chunks_exact(stride)) {
                *value = read(&record[column.offset..]);
            }
        }
        Ok(())
    }
}
