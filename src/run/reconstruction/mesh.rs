//! A finished mesh in memory.

use std::path::Path;

use crate::error::{Error, Result};
use crate::format::write::{Positions, Target};
use crate::mesh::check::{CheckReport, check, intersections};
use crate::mesh::spool::MeshSpool;
use crate::mesh::{MeshHeader, MeshSource};
use crate::points::Precision;
use crate::points::attribute::{Attribute, Schema};
use crate::points::crs::Crs;
use crate::points::scalar::Scalar;
#[cfg(feature = "internals")]
use crate::points::unit::measured;
use crate::resources::workers::Workers;
#[cfg(feature = "internals")]
use crate::run::job::Job;
use crate::run::observer::{Observer, watched};
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::run::report::Report;
use crate::run::saved_mesh::Means;
use crate::run::simplification::{Lengths, simplified};
use crate::settings::simplification::Simplification;
#[cfg(feature = "internals")]
use crate::settings::simplification::Tolerance;
use crate::storage::atomic_file::Overwrite;
use crate::storage::spool::Workspace;

/// Vertices, or triangles, that are handed on at a time.
pub(super) const PIECE: usize = 1 << 14;

/// A finished mesh. What does not fit into the memory that the run was granted lies in temporary files without names, for as long as the mesh is held.
///
/// Vertices are in the precision of the points. Those of double precision far from zero (map coordinates) are kept less an [`Mesh::origin`], so that programs
/// and formats of 32 bits keep their resolution.
#[derive(Debug)]
pub struct Mesh {
    spool: MeshSpool,
    header: MeshHeader,
    report: Report,
    workers: Workers,
    workspace: Workspace,
}

/// Who takes a mesh piece by piece. Pieces come in order: all vertices, their attributes, all triangles.
pub trait MeshSink {
    /// Is told what is coming: numbers, origin, attributes.
    ///
    /// # Errors
    /// What keeps it from taking the mesh. It ends the run, as do the others.
    fn begin(&mut self, mesh: &Mesh) -> Result<()> {
        let _ = mesh;
        Ok(())
    }

    /// Takes the next vertices, in the points' coordinates.
    ///
    /// # Errors
    /// The same as [`MeshSink::begin`].
    fn vertices(&mut self, positions: &[[f64; 3]]) -> Result<()>;

    /// Takes the next values of the attribute of this number, from 0. All of one attribute come before those of the next.
    ///
    /// # Errors
    /// The same as [`MeshSink::begin`].
    fn attribute(&mut self, number: usize, values: &[f64]) -> Result<()> {
        let _ = (number, values);
        Ok(())
    }

    /// Takes the next triangles: numbers of vertices, counter-clockwise seen from outside.
    ///
    /// # Errors
    /// The same as [`MeshSink::begin`].
    fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<()>;
}

impl Mesh {
    pub(super) fn new(
        spool: MeshSpool,
        header: MeshHeader,
        report: Report,
        workers: Workers,
        workspace: Workspace,
    ) -> Mesh {
        Mesh { spool, header, report, workers, workspace }
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.spool.vertex_count() as usize
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.spool.face_count() as usize
    }

    /// All vertices, in the points' coordinates: a copy of 24 bytes each.
    ///
    /// # Errors
    /// [`Error::Io`] if temporary files cannot be read.
    pub fn vertices(&self) -> Result<Vec<[f64; 3]>> {
        let mut out = vec![[0.0; 3]; self.vertex_count()];
        self.spool.read_vertices(0, &mut out)?;
        let origin = self.origin();
        out.iter_mut().for_each(|vertex| *vertex = at(*vertex, origin));
        Ok(out)
    }

    /// All vertices less the [`Mesh::origin`], in single precision: a copy of 12 bytes each, for graphics.
    ///
    /// # Errors
    /// The same as [`Mesh::vertices`].
    pub fn local_vertices(&self) -> Result<Vec<[f32; 3]>> {
        let mut out = Vec::with_capacity(self.vertex_count());
        self.each_vertices(|vertices| {
            out.extend(vertices.iter().map(|vertex| vertex.map(|c| c as f32)));
            Ok(())
        })?;
        Ok(out)
    }

    /// All triangles, each three numbers of vertices, counter-clockwise seen from outside: a copy of 12 bytes each.
    ///
    /// # Errors
    /// The same as [`Mesh::vertices`].
    pub fn triangles(&self) -> Result<Vec<[u32; 3]>> {
        let mut out = vec![[0; 3]; self.triangle_count()];
        self.spool.read_faces(0, &mut out)?;
        Ok(out)
    }

    /// The value of an attribute at each vertex.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is none of this name; as [`Mesh::vertices`].
    pub fn attribute(&self, name: &str) -> Result<Vec<f64>> {
        let schema = self.spool.schema();
        let number = schema.attributes().iter().position(|attribute| attribute.name == name);
        let number = number.ok_or_else(|| Error::Usage(format!("attribute {name:?}: {}", schema.lacks(name))))?;
        let mut out = vec![0.0; self.vertex_count()];
        self.spool.read_attribute(number, 0, &mut out)?;
        Ok(out)
    }

    /// The values of an attribute at the vertices in their own type, one after the other in the machine's byte order.
    ///
    /// # Errors
    /// The same as [`Mesh::attribute`].
    pub fn attribute_bytes(&self, name: &str) -> Result<(Scalar, Vec<u8>)> {
        let schema = self.spool.schema();
        let column = schema.column(name);
        let column = column.ok_or_else(|| Error::Usage(format!("attribute {name:?}: {}", schema.lacks(name))))?;
        let (stride, bytes) = (schema.stride(), column.scalar.bytes());
        let mut out = Vec::with_capacity(self.vertex_count() * bytes);
        let mut records = vec![0; PIECE * stride];
        for first in (0..self.vertex_count()).step_by(PIECE) {
            let records = &mut records[..PIECE.min(self.vertex_count() - first) * stride];
            self.spool.read_records(first as u64, records)?;
            let values = records.chunks_exact(stride).map(|record| &record[column.offset..column.offset + bytes]);
            values.for_each(|value| out.extend_from_slice(value));
        }
        Ok((column.scalar, out))
    }

    /// The attributes of its vertices, which they have from their points.
    pub fn attributes(&self) -> &[Attribute] {
        self.spool.schema().attributes()
    }

    /// The precision of its vertices, which is that of the points.
    pub fn precision(&self) -> Precision {
        self.spool.precision()
    }

    /// What is taken off the vertices where they are kept: zero, but for double precision far from zero.
    pub fn origin(&self) -> [f64; 3] {
        self.header.origin
    }

    /// The coordinate reference system of its points, if it is known.
    pub fn crs(&self) -> Option<&Crs> {
        self.header.crs.as_ref()
    }

    /// What is to be told of its making: whether it is sealed, what was left out, the check, times, memory.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// Only what is to be told of its making.
    pub fn into_report(self) -> Report {
        self.report
    }

    /// Writes a PLY, STL, OBJ or GLB file, as the extension says. It appears under its name when it is whole.
    ///
    /// # Errors
    /// [`Error::OutputExists`], [`Error::Usage`] for another extension, [`Error::TooManyElements`], [`Error::Io`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        self.save_as(path, Overwrite::Refuse, None)
    }

    /// [`Mesh::save`], in the place of a file that is there, say, or with coordinates other than usual for the format.
    ///
    /// # Errors
    /// The same as [`Mesh::save`].
    pub fn save_as(&self, path: impl AsRef<Path>, overwrite: Overwrite, positions: Option<Positions>) -> Result<()> {
        let positions = Positions::of(path.as_ref(), positions)?;
        let target = Target::prepare(path.as_ref(), overwrite, positions)?;
        target.fill(&self.spool, &self.header, &self.workers, &mut |_| ())?.finish()?;
        Ok(())
    }

    /// Checks it once more, strictly: edges, vertices, components, genus, volume; and for triangles that intersect.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn check(&self) -> Result<CheckReport> {
        self.checked(&self.workers)
    }

    /// As [`Mesh::check`], unless an observer says that it is to end; how far it is, it is not told.
    ///
    /// # Errors
    /// [`Error::Interrupted`]; [`Error::Io`].
    pub fn check_observed(&self, observer: &dyn Observer) -> Result<CheckReport> {
        // New ones, as those that were stopped once stay so.
        let workers = Workers::new(self.workers.threads())?;
        watched(Some(observer), &workers, || self.checked(&workers))
    }

    fn checked(&self, workers: &Workers) -> Result<CheckReport> {
        let memory = self.report.memory.plan.working;
        let mut report = check(&self.spool, memory, workers, &self.workspace, &mut |_| ())?;
        report.intersections = Some(intersections(&self.spool, memory, workers, &self.workspace, &mut |_| ())?);
        Ok(report)
    }

    /// The mesh with fewer triangles, see [`Simplification`]. Every vertex that is left is one of this mesh's, with its attributes, unless vertices may move;
    /// components, tunnels and rims stay, no triangles intersect, and no place of either surface is farther from the other than the report's `simplification` tells. It is checked to be sound.
    ///
    /// Memory: as much as the run was granted.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`]; [`Error::Budget`]; [`Error::Io`]; [`Error::Interrupted`].
    pub fn simplify(&self, asked: &Simplification) -> Result<Mesh> {
        self.simplified(asked, &self.workers, &mut Progress::told(None))
    }

    /// As [`Mesh::simplify`]; an observer is told how far it is, and may end it.
    ///
    /// # Errors
    /// The same as [`Mesh::simplify`].
    pub fn simplify_observed(&self, asked: &Simplification, observer: &dyn Observer) -> Result<Mesh> {
        let workers = Workers::new(self.workers.threads())?;
        watched(Some(observer), &workers, || self.simplified(asked, &workers, &mut Progress::told(Some(observer))))
    }

    /// What a job asks of the simplification of this mesh, in the unit of its coordinates.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if the tolerance has a unit, and that of the mesh is not known; [`Error::Usage`] if none is asked for.
    #[cfg(feature = "internals")]
    #[doc(hidden)]
    pub fn simplification_of(&self, job: &Job) -> Result<Simplification> {
        let asked = job.settings.simplify;
        let mut asked = asked.ok_or_else(|| Error::Usage("`simplify`: a tolerance, or `max_triangles`".to_owned()))?;
        if let (Some(Tolerance::Length(length)), Some(unit)) = (&mut asked.tolerance, job.units.simplify) {
            *length = measured("simplify", *length, unit, self.crs().and_then(Crs::measure))?;
        }
        Ok(asked)
    }

    fn simplified(&self, asked: &Simplification, workers: &Workers, progress: &mut Progress) -> Result<Mesh> {
        asked.validate()?;
        let Report { grid, points, memory, parameters, .. } = &self.report;
        let lengths = Lengths { cell: Some(grid.cell_size), longest: points.bounds.longest_side() };
        let memory = memory.plan.working;
        let means = Means { memory, workers, workspace: &self.workspace, kept: None };
        let (spool, figures) = simplified(&self.spool, asked, lengths, means, progress)?;
        progress.begin(Phase::Check, Some(spool.face_count()));
        let found = check(&spool, memory, workers, &self.workspace, &mut |done| progress.set(done))?;
        if !found.is_sound(parameters.trim.is_some() || parameters.open.is_some_and(|open| open.base.is_none())) {
            return Err(Error::CheckFailed(found.to_string()));
        }
        progress.end();
        let mut report = self.report.clone();
        report.parameters.simplify = Some(*asked);
        (report.output.vertices, report.output.triangles) = (spool.vertex_count(), spool.face_count());
        report.output.bytes = spool.bytes();
        (report.simplification, report.check) = (Some(figures), Some(found));
        report.judge();
        Ok(Mesh::new(spool, self.header.clone(), report, self.workers.clone(), self.workspace.clone()))
    }

    /// Hands it on piece by piece; no more than a piece is copied at a time.
    ///
    /// # Errors
    /// [`Error::Io`]; what the sink says.
    pub fn send(&self, sink: &mut dyn MeshSink) -> Result<()> {
        sink.begin(self)?;
        let origin = self.origin();
        self.each_vertices(|vertices| {
            vertices.iter_mut().for_each(|vertex| *vertex = at(*vertex, origin));
            sink.vertices(vertices)
        })?;
        let mut values = vec![0.0; PIECE];
        for number in 0..self.attributes().len() {
            for first in (0..self.vertex_count()).step_by(PIECE) {
                let values = &mut values[..PIECE.min(self.vertex_count() - first)];
                self.spool.read_attribute(number, first as u64, values)?;
                sink.attribute(number, values)?;
            }
        }
        let mut triangles = vec![[0; 3]; PIECE];
        for first in (0..self.triangle_count()).step_by(PIECE) {
            let triangles = &mut triangles[..PIECE.min(self.triangle_count() - first)];
            self.spool.read_faces(first as u64, triangles)?;
            sink.triangles(triangles)?;
        }
        Ok(())
    }

    fn each_vertices(&self, mut take: impl FnMut(&mut [[f64; 3]]) -> Result<()>) -> Result<()> {
        let mut vertices = vec![[0.0; 3]; PIECE];
        for first in (0..self.vertex_count()).step_by(PIECE) {
            let vertices = &mut vertices[..PIECE.min(self.vertex_count() - first)];
            self.spool.read_vertices(first as u64, vertices)?;
            take(vertices)?;
        }
        Ok(())
    }
}

impl MeshSource for Mesh {
    fn vertex_count(&self) -> u64 {
        self.spool.vertex_count()
    }

    fn face_count(&self) -> u64 {
        self.spool.face_count()
    }

    fn origin(&self) -> [f64; 3] {
        self.header.origin
    }

    fn precision(&self) -> Precision {
        self.spool.precision()
    }

    fn read_vertices(&self, first: u64, out: &mut [[f64; 3]]) -> Result<()> {
        self.spool.read_vertices(first, out)
    }

    fn read_faces(&self, first: u64, out: &mut [[u32; 3]]) -> Result<()> {
        self.spool.read_faces(first, out)
    }

    fn schema(&self) -> &Schema {
        self.spool.schema()
    }

    fn read_attribute(&self, number: usize, first: u64, out: &mut [f64]) -> Result<()> {
        self.spool.read_attribute(number, first, out)
    }
}

fn at(vertex: [f64; 3], origin: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|a| vertex[a] + origin[a])
}
