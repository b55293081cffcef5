//! A tileset of a mesh file.

use std::path::PathBuf;
use std::time::Instant;

use bytesize::ByteSize;

use super::{LEAST, TilesetFigures, TilesetTarget};
use crate::error::words::{short, thousands};
use crate::error::{Error, Result};
use crate::format;
use crate::mesh::MeshHeader;
use crate::mesh::check::check;
use crate::points::attribute::Wanted;
use crate::points::crs::Crs;
use crate::resources::workers::Workers;
use crate::run::job::Resources;
use crate::run::phase::{Forecast, Phase};
use crate::run::progress::{Progress, Warning};
use crate::run::saved_mesh::Means;
use crate::settings::tileset::TilesetOptions;
use crate::simplify::Extent;
use crate::storage::atomic_file::Overwrite;
use crate::storage::steady::Steady;

/// A mesh file that a tileset is to be made of.
#[derive(Debug, Clone)]
pub struct TilesetJob {
    /// The mesh: PLY, STL, OBJ or GLB.
    pub mesh: PathBuf,
    /// The tileset: `tileset.json` in a folder of its own.
    pub output: PathBuf,
    /// Whether it may replace a tileset.
    pub overwrite: Overwrite,
    /// How it is made.
    pub options: TilesetOptions,
    /// The mesh's reference system, or that it has none, whatever its file says.
    pub crs: Option<Option<Crs>>,
    /// What the work may use. Nothing of it shows in the files.
    pub resources: Resources,
}

/// What was made of a mesh file.
#[derive(Debug, Clone, serde::Serialize)]
pub struct TilesetReport {
    /// The program's version.
    pub version: &'static str,
    /// The mesh.
    #[serde(serialize_with = "crate::error::words::told")]
    pub mesh: PathBuf,
    /// The tileset.
    #[serde(serialize_with = "crate::error::words::told")]
    pub output: PathBuf,
    /// What it has.
    pub tileset: TilesetFigures,
    /// Seconds in all.
    pub seconds_total: f64,
    /// What may be wrong.
    pub warnings: Vec<Warning>,
}

impl TilesetReport {
    /// What is told on standard error, line by line.
    pub fn summary(&self) -> Vec<String> {
        let TilesetFigures { bytes, .. } = self.tileset;
        let mut lines =
            vec![format!("output   {}, {}, in {:.2} s", self.output.display(), ByteSize(bytes), self.seconds_total)];
        lines.extend(self.tileset.lines());
        lines
    }
}

impl TilesetFigures {
    /// What is told of the levels, line by line.
    pub fn lines(&self) -> Vec<String> {
        let metres = if self.site.is_some() { " m" } else { "" };
        let line = |(number, level): (usize, &super::LevelFigures)| {
            let (triangles, tiles, error) = (thousands(level.triangles), thousands(level.tiles), short(level.error));
            let tiles = if level.tiles == 1 { "1 tile".to_owned() } else { format!("{tiles} tiles") };
            format!("level {number}  {triangles} triangles in {tiles}, within {error}{metres} of the mesh")
        };
        let place = self.site.iter().map(|site| format!("place    {site}"));
        place.chain(self.levels.iter().enumerate().map(line)).collect()
    }
}

/// Makes a tileset of a mesh file.
///
/// # Errors
/// Those of reading meshes and of [`TilesetTarget::write`]; [`Error::Budget`]; [`Error::Malformed`] for a mesh without triangles.
pub fn tileset_file(job: &TilesetJob, workers: &Workers, progress: &mut Progress) -> Result<TilesetReport> {
    let start = Instant::now();
    let steady = Steady::of([&job.mesh]);
    let mut target = TilesetTarget::prepare(&job.output, job.overwrite)?;
    let crs = job.crs.clone().unwrap_or_else(|| format::read::told_crs(&job.mesh));
    target.georeference(crs.as_ref(), &job.options)?;
    let workspace = job.resources.workspace(TilesetTarget::folder(&job.output)?)?.stopped_with(workers);
    let budget = job.resources.budget();
    let opened = steady.settle(format::read::open_with(&job.mesh, &workspace, budget / 8, &Wanted::All))?;
    let triangles = opened.face_count() as f64;
    let share = budget / 8 * 7;
    let least = (Extent::of(&*opened, false, false).least_memory() / 3 * 4).max(LEAST);
    if share < least {
        let needed = ByteSize((least * 8).div_ceil(7).next_multiple_of(1 << 20));
        return Err(Error::Budget { given: ByteSize(budget), needed, what: "a tileset of the mesh" });
    }
    progress.expect(Forecast::new([
        (Phase::Check, triangles),
        (Phase::Simplify, 50.0 * triangles),
        (Phase::Write, 4.0 * triangles),
    ]));
    progress.begin(Phase::Check, Some(opened.face_count()));
    let told = &mut |done| progress.set(done);
    let found = steady.settle(check(&*opened, share / 2, workers, &workspace, told))?;
    if opened.face_count() == 0 || found.nonfinite_vertices > 0 {
        let found = format!("{} triangles, {} vertices that are not finite", found.triangles, found.nonfinite_vertices);
        return Err(Error::malformed(&job.mesh, "the mesh", "triangles with finite corners", found));
    }
    let mut warnings = Vec::new();
    if !found.is_sound(true) {
        let words = "is no oriented manifold; where it is none, coarser levels keep all triangles";
        warnings.push(Warning::bare(format!("{}: {words}", job.mesh.display())));
    }
    let comments = vec![format!("asra-stream {}", env!("CARGO_PKG_VERSION"))];
    let header =
        MeshHeader { origin: opened.origin(), comments, crs, sheet: found.boundary_edges > 0, constant: Vec::new() };
    let means = Means { memory: share, workers, workspace: &workspace, kept: None };
    let made = target.write(&*opened, &header, &job.options, means, progress);
    let tileset = steady.settle(made)?;
    progress.end();
    let (mesh, output, version) = (job.mesh.clone(), job.output.clone(), env!("CARGO_PKG_VERSION"));
    Ok(TilesetReport { version, mesh, output, tileset, seconds_total: start.elapsed().as_secs_f64(), warnings })
}
