//! What is compared, and what was measured.

use std::path::PathBuf;

use super::figures::Figures;
use super::heatmap::HeatMap;
use super::source::Survey;
use crate::input::InputOptions;
use crate::run::Resources;

/// What is compared.
#[derive(Debug, Clone)]
pub struct Job {
    /// The mesh.
    pub mesh: PathBuf,
    /// What it is compared with.
    pub reference: PathBuf,
    /// What the reference is taken for; by default a mesh if it has triangles, else a cloud.
    pub kind: Option<Kind>,
    /// How a raw reference is laid out.
    pub input: InputOptions,
    /// Where the mesh is written, coloured by its distance, if it is to be.
    pub heatmap: Option<HeatMap>,
    /// What the work may use. Nothing of it shows in what is found.
    pub resources: Resources,
}

/// What a reference is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A surface: its vertices and triangles count.
    Mesh,
    /// Points only.
    Cloud,
}

/// What was measured, in units.
pub(super) struct Found {
    pub(super) reference: Survey,
    /// From the mesh's centroids to the reference's nearest points.
    pub(super) nearest_point: Figures,
    pub(super) mesh_centroids: Figures,
    pub(super) mesh_vertices: Figures,
    pub(super) reference_points: Figures,
    pub(super) reference_centroids: Option<Figures>,
    /// If the reference has triangles.
    pub(super) facing: Option<AlongNormals>,
}

/// What centroids tell of a surface.
pub(super) struct AlongNormals {
    pub(super) distances: Figures,
    /// `None` if no normal meets anything.
    pub(super) along: Option<Figures>,
    pub(super) missed: u64,
    /// `None` if no triangle has a normal, or none nearest to one has.
    pub(super) turned: Option<Figures>,
}
