//! A mesh in three files of the work folder, and the steps of a run that leave one there.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::grid::bucket::Compared;
use crate::mesh::MeshSource;
use crate::mesh::copy::copy;
use crate::mesh::spool::MeshSpool;
use crate::points::Precision;
use crate::points::attribute::Schema;
use crate::resources::workers::Workers;
use crate::storage::spool::{Extent, Spool, Workspace};
use crate::storage::work::store::NamedFile;
use crate::storage::work::{Manifest, WorkFolder};

/// The files of a mesh.
pub(super) const FILES: [&str; 3] = ["vertices", "attributes", "faces"];

/// What a manifest tells of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct SavedMesh {
    /// Vertices and triangles.
    pub sizes: [u64; 2],
    /// Where vertices, attributes and triangles lie in the first three files.
    pub extents: [Extent; 3],
}

impl SavedMesh {
    /// New files for the mesh of a phase.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn files(work: &WorkFolder, phase: &str) -> Result<[NamedFile; 3]> {
        let [vertices, attributes, faces] = FILES.map(|what| work.create(&format!("{what}-{phase}")));
        Ok([vertices?, attributes?, faces?])
    }

    /// A mesh that lies in such files, all of it.
    pub fn of(mesh: &mut MeshSpool) -> SavedMesh {
        SavedMesh { sizes: [mesh.vertex_count(), mesh.face_count()], extents: mesh.extents() }
    }

    /// The mesh of a phase's manifest.
    ///
    /// # Errors
    /// [`Error::Damaged`], [`Error::Io`], [`Error::Interrupted`].
    pub fn open(
        self,
        (work, phase, manifest): (&WorkFolder, &str, &Manifest),
        (precision, schema): (Precision, &Schema),
        compared: Compared,
        (workers, workspace): (&Workers, &Workspace),
    ) -> Result<MeshSpool> {
        let told = format!("done/{phase}.json");
        let Some(files) = manifest.files.first_chunk::<3>() else {
            return Err(work.damaged(&told, "a file is missing"));
        };
        let mut spools: Vec<Spool> = Vec::with_capacity(3);
        for (name, extent) in files.iter().zip(self.extents) {
            let file = work.open_file(name)?;
            if compared == Compared::Now && !work.is_as_written(&file, extent, workers)? {
                return Err(work.damaged(name, "its bytes are not what was written"));
            }
            spools.push(workspace.spool_in(file, extent.to));
        }
        let spools = spools.try_into().map_err(|_| Error::Internal("three files".into()))?;
        let mesh = MeshSpool::in_spools(precision, schema.clone(), spools);
        let [vertices, faces] = self.sizes;
        match mesh.holds(vertices, faces) {
            true => Ok(mesh),
            false => Err(work.damaged(&told, "it does not tell how long files are")),
        }
    }
}

/// Where steps that come after the surface are kept, for a run that goes on.
#[derive(Debug, Clone, Copy)]
pub struct KeptSteps<'a> {
    /// The folder.
    pub work: &'a WorkFolder,
    /// What the names of its phases end with.
    pub ending: &'a str,
    /// Whether it is this process's alone: only then can a file be appended to.
    pub alone: bool,
}

/// What steps that come after the surface may use.
#[derive(Debug, Clone, Copy)]
pub struct Means<'a> {
    /// Bytes.
    pub memory: u64,
    /// Who takes them.
    pub workers: &'a Workers,
    /// Where temporary files go.
    pub workspace: &'a Workspace,
    /// Where they are kept, if they are.
    pub kept: Option<KeptSteps<'a>>,
}

impl Means<'_> {
    /// Bytes that a block of a mesh takes that is worked on: triangles, and the vertices that they span.
    const BLOCK_BYTES: u64 = 4 << 20;

    /// How many blocks of a mesh are worked on at a time.
    pub(super) fn in_flight(&self) -> usize {
        (self.memory / 8 / Self::BLOCK_BYTES).clamp(1, self.workers.threads() as u64 + 1) as usize
    }
}

/// What is told of a kept mesh.
#[derive(Debug, Serialize, Deserialize)]
struct Step<R> {
    mesh: SavedMesh,
    rest: R,
}

impl<'a> KeptSteps<'a> {
    /// Where passes of a simplification are kept, if they can be, and what their names begin with.
    pub fn passes(&self, step: &str) -> Option<(&'a WorkFolder, String)> {
        self.alone.then(|| (self.work, self.phase(step)))
    }

    /// The mesh that a step has left, and what was to be told of it, if an earlier run was as far.
    ///
    /// # Errors
    /// [`Error::Damaged`], [`Error::Io`], [`Error::Interrupted`].
    pub fn found<R: DeserializeOwned>(
        &self,
        step: &str,
        form: (Precision, &Schema),
        means: (&Workers, &Workspace),
    ) -> Result<Option<(MeshSpool, R)>> {
        let phase = self.phase(step);
        self.work.load(&phase, |manifest| {
            let unread = |_| self.work.damaged(&format!("done/{phase}.json"), "it cannot be read");
            let there: Step<R> = serde_json::from_value(manifest.rest.clone()).map_err(unread)?;
            let mesh = there.mesh.open((self.work, &phase, manifest), form, Compared::Now, means)?;
            Ok((mesh, there.rest))
        })
    }

    /// Keeps the mesh that a step has left; from then on it is read from the folder.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Interrupted`].
    pub fn keep(
        &self,
        step: &str,
        mesh: &MeshSpool,
        rest: impl Serialize,
        (workers, workspace): (&Workers, &Workspace),
        in_flight: usize,
    ) -> Result<MeshSpool> {
        let phase = self.phase(step);
        let files = SavedMesh::files(self.work, &phase)?;
        let spools = files.clone().map(|file| workspace.spool_in(file, 0));
        let mut kept = MeshSpool::in_spools(mesh.precision(), mesh.schema().clone(), spools);
        copy(mesh, &mut kept, Ok, (workers, in_flight))?;
        let told = Step { mesh: SavedMesh::of(&mut kept), rest };
        self.work.commit(&phase, files.into(), serde_json::to_value(told).expect("a manifest can be written"))?;
        Ok(kept)
    }

    fn phase(&self, step: &str) -> String {
        format!("{step}{}", self.ending)
    }
}
