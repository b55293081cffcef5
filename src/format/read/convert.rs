//! Elements from a file on their way into a spool.

use std::path::Path;

use crate::error::{Error, Result};
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::mesh::{MeshSource, check_vertex_count};
use crate::points::Precision;
use crate::points::attribute::Schema;
use crate::storage::spool::Workspace;

/// Elements gathered before they are appended.
const BLOCK: usize = 1 << 14;

/// Takes vertices and polygons in any order and gives a mesh of triangles.
pub(crate) struct Converter<'a> {
    path: &'a Path,
    mesh: MeshSpool,
    vertices: Vec<[f64; 3]>,
    records: Vec<u8>,
    faces: Vec<FaceRecord>,
    polygons: u64,
    /// The largest vertex number so far and the polygon that has it.
    highest: Option<(u64, u64)>,
}

impl<'a> Converter<'a> {
    /// Nothing yet; `path` is named in errors.
    pub fn new(
        path: &'a Path,
        workspace: &Workspace,
        precision: Precision,
        schema: Schema,
        in_memory: u64,
    ) -> Converter<'a> {
        Converter {
            path,
            mesh: MeshSpool::with_attributes(workspace, precision, schema, in_memory),
            vertices: Vec::new(),
            records: Vec::new(),
            faces: Vec::new(),
            polygons: 0,
            highest: None,
        }
    }

    /// Vertices so far.
    pub fn vertex_count(&self) -> u64 {
        self.mesh.vertex_count() + self.vertices.len() as u64
    }

    /// The next vertex.
    ///
    /// # Errors
    /// [`Error::TooManyElements`] beyond what 32 bits can number; [`Error::Io`].
    pub fn vertex(&mut self, position: [f64; 3]) -> Result<()> {
        self.vertices.push(position);
        if self.vertices.len() == BLOCK {
            self.mesh.append_vertices(&self.vertices)?;
            self.vertices.clear();
            check_vertex_count(self.mesh.vertex_count())?;
        }
        Ok(())
    }

    /// The attributes of the next vertex that has none yet, in the schema's order.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn attributes(&mut self, values: &[f64]) -> Result<()> {
        for (attribute, value) in self.mesh.schema().attributes().iter().zip(values) {
            attribute.scalar.put(*value, &mut self.records);
        }
        if self.records.len() >= BLOCK {
            self.mesh.append_attributes(&self.records)?;
            self.records.clear();
        }
        Ok(())
    }

    /// The next polygon, of at least three corners, as the triangles from its first corner.
    ///
    /// # Errors
    /// The first error among `corners`; [`Error::Malformed`] if there are fewer than three; [`Error::Io`].
    pub fn polygon(&mut self, corners: impl IntoIterator<Item = Result<u64>>) -> Result<()> {
        let mut corners = corners.into_iter();
        let (mut count, mut first, mut last) = (0u64, 0, 0);
        for corner in &mut corners {
            let corner = corner?;
            if self.highest.is_none_or(|(highest, _)| corner > highest) {
                self.highest = Some((corner, self.polygons));
            }
            // A number beyond 32 bits is an error in the end; until then any will do.
            let corner = corner as u32;
            match count {
                0 => first = corner,
                1 => {}
                _ => self.triangle([first, last, corner])?,
            }
            last = corner;
            count += 1;
        }
        if count < 3 {
            return Err(Error::malformed(self.path, format!("face {}", self.polygons), "at least 3 corners", count));
        }
        self.polygons += 1;
        Ok(())
    }

    fn triangle(&mut self, vertices: [u32; 3]) -> Result<()> {
        self.faces.push(FaceRecord::new(vertices));
        if self.faces.len() == BLOCK {
            self.mesh.append_faces(&self.faces)?;
            self.faces.clear();
        }
        Ok(())
    }

    /// The mesh, all of whose triangles name vertices it has.
    ///
    /// # Errors
    /// [`Error::Malformed`] if one does not; otherwise as [`Converter::vertex`].
    pub fn finish(mut self) -> Result<MeshSpool> {
        self.mesh.append_vertices(&self.vertices)?;
        self.mesh.append_attributes(&self.records)?;
        self.mesh.append_faces(&self.faces)?;
        let vertices = self.mesh.vertex_count();
        check_vertex_count(vertices)?;
        match self.highest {
            Some((number, polygon)) if number >= vertices => Err(Error::malformed(
                self.path,
                format!("face {polygon}"),
                format!("vertex numbers below {vertices}, the number of vertices"),
                number,
            )),
            _ => Ok(self.mesh),
        }
    }
}
