//! Where a run's mesh goes: a file, tiles, or a tileset.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::thread;

use crate::error::{Error, Result, defect};
use crate::format::tiles3d::is_named;
use crate::format::write::territory::Territories;
use crate::format::write::tiles::Tiles;
use crate::format::write::tiling::{Division, Tiling};
use crate::format::write::{Filled, Positions, Target};
use crate::grid::survey::boxes_of_sources;
use crate::input::Cloud;
use crate::mesh::MeshHeader;
use crate::mesh::spool::MeshSpool;
use crate::resources::workers::Workers;
use crate::run::job::{Job, default_output_of};
use crate::run::phase::Phase;
use crate::run::planner::{FILLING, jobs_of_all};
use crate::run::progress::Progress;
use crate::run::pyramid::TilesetTarget;
use crate::storage::remote::is_remote;

/// The output's name, which is no input's.
pub(super) fn output_of(job: &Job, files: &[PathBuf]) -> Result<PathBuf> {
    let output = match &job.output {
        Some(output) => output.clone(),
        None => default_output_of(&job.inputs, files)?,
    };
    refuse_input_as_output(files, &output).map(|()| output)
}

/// Which coordinates an output has.
///
/// # Errors
/// Those of [`Positions::of`]; [`Error::InvalidSetting`] for the input's own in a tileset, or one of tiles of another kind.
pub(super) fn positions_of(output: &Path, job: &Job) -> Result<Positions> {
    if !is_named(output) {
        return Positions::of(output, job.positions);
    }
    let setting = match job {
        Job { positions: Some(Positions::Absolute), .. } => "coordinates",
        Job { tile: Some(_), .. } => "tile",
        Job { batch: true, .. } => "batch",
        _ => return Ok(Positions::Shifted),
    };
    let words = format!("`{setting}`: does not go with a tileset, whose tiles and places are its own");
    Err(Error::setting(setting, words))
}

/// No mesh takes the place of the points it is made from.
pub(super) fn refuse_input_as_output(files: &[PathBuf], output: &Path) -> Result<()> {
    let same = |path: &Path| {
        matches!((path.canonicalize(), output.canonicalize()), (Ok(a), Ok(b)) if a == b)
            || path == output && is_remote(path)
    };
    match files.iter().find(|file| same(file)) {
        Some(file) => Err(Error::Usage(format!(
            "{}: is an input, which the mesh would replace; choose another `output`",
            file.display()
        ))),
        None => Ok(()),
    }
}

/// Of what a run writes, the mesh alone can go to an object store, if it is one file; and its report.
pub(super) fn refuse_remote(job: &Job, output: &Path) -> Result<()> {
    let is_folder = job.tile.is_some() || job.batch || is_named(output);
    let of_all = [
        ("dtm", job.dtm.as_deref()),
        ("dsm", job.dsm.as_deref()),
        ("write_classes", job.write_classes.as_deref()),
        ("output", Some(output).filter(|_| is_folder)),
    ];
    #[cfg(feature = "render")]
    let picture = job.preview.path(output);
    #[cfg(feature = "render")]
    let drawn = [("html", job.html.as_deref()), ("preview", picture.as_deref())];
    #[cfg(not(feature = "render"))]
    let drawn: [(&str, Option<&Path>); 0] = [];
    let mut others = of_all.into_iter().chain(drawn);
    match others.find_map(|(setting, path)| Some((setting, path.filter(|path| is_remote(path))?))) {
        None => Ok(()),
        Some((setting, path)) => Err(Error::setting(
            setting,
            format!(
                "`{setting}` {}: only meshes in one file are written to object stores; write this to a folder of this machine, and copy it from there",
                path.display()
            ),
        )),
    }
}

/// How a job's mesh becomes tiles, of a job whose lengths are in the input's units; none if it is to be one file, or a mesh of each input.
///
/// # Errors
/// Those of [`Tiling::of`].
pub(super) fn tiling(job: &Job, files: &[PathBuf]) -> Result<Option<Tiling>> {
    let Some(side) = job.tile else { return Ok(None) };
    let output = output_of(job, files)?;
    Tiling::of(&output, Division::Squares(side), positions_of(&output, job)?).map(Some)
}

/// What a job wants its mesh divided by, as far as it is known before files are opened.
///
/// # Errors
/// [`Error::InvalidSetting`] if it wants two things, or inputs have no names that tell their meshes apart.
fn division(job: &Job, files: &[PathBuf]) -> Result<Option<Division>> {
    match (job.tile, job.batch) {
        (Some(_), true) => Err(Error::setting(
            "batch",
            "`batch`: makes a mesh of each input, and `tile` of each square; pass one".into(),
        )),
        (Some(side), false) => Ok(Some(Division::Squares(side))),
        (None, true) => Territories::of(files).map(|inputs| Some(Division::Inputs(inputs))),
        (None, false) => Ok(None),
    }
}

/// Where the points of each input lie that count; those without any get no mesh, and are told.
pub(super) fn territories(cloud: &Cloud, workers: &Workers, progress: &mut Progress) -> Result<Territories> {
    let paths: Vec<PathBuf> = cloud.sources().iter().map(|source| source.path.clone()).collect();
    let mut inputs = Territories::of(&paths)?;
    progress.begin(Phase::Survey, cloud.sources().iter().map(|source| source.records).sum());
    let boxes = boxes_of_sources(cloud, workers, 2 * workers.threads(), |records| progress.add(records))?;
    progress.end();
    paths.iter().zip(&boxes).for_each(|(path, bounds)| inputs.put(path, bounds));
    for input in inputs.without_points() {
        progress.note(&format!("{}: no points that count, and so no mesh", input.path.display()));
    }
    Ok(inputs)
}

/// Where the mesh goes.
pub(super) enum Place {
    File(Target),
    Filled(Filled),
    Tiles(Tiles),
    Tileset(TilesetTarget),
}

impl Place {
    /// The output of this name, prepared, and which coordinates it has.
    pub fn of(job: &Job, files: &[PathBuf], output: &Path) -> Result<(Place, Positions)> {
        refuse_remote(job, output)?;
        let positions = positions_of(output, job)?;
        if !is_named(output)
            && let Some(setting) = job.tileset.first_set()
        {
            let words =
                format!("`{setting}`: is for a tileset; its `output` is named tileset.json, in a folder of its own");
            return Err(Error::setting(setting, words));
        }
        let place = match division(job, files)? {
            None if is_named(output) => Place::Tileset(TilesetTarget::prepare(output, job.overwrite)?),
            None => {
                let local = job.resources.temp_dir.as_deref();
                Place::File(Target::prepare_with(output, job.overwrite, positions, local)?)
            }
            Some(division) => Place::Tiles(Tiles::prepare(output, division, job.overwrite, positions)?),
        };
        Ok((place, positions))
    }

    /// A tileset stands on Earth where the cloud's reference system says.
    pub fn stand_where(&mut self, cloud: &Cloud, job: &Job) -> Result<()> {
        match self {
            Place::Tileset(tileset) => tileset.georeference(cloud.crs(), &job.tileset),
            _ => Ok(()),
        }
    }

    /// Bytes that filling it with a mesh takes: as much as a file may for what is not one.
    pub fn filling(&self, mesh: &MeshSpool, workers: &Workers) -> u64 {
        let jobs = jobs_of_all(workers.threads());
        match self {
            Place::File(target) => target.filling(mesh, jobs, FILLING),
            _ => (jobs * FILLING).min(mesh.bytes()),
        }
    }

    /// Does some work; a file is filled meanwhile.
    pub fn filled_meanwhile<R>(
        self,
        mesh: &MeshSpool,
        header: &MeshHeader,
        workers: &Workers,
        work: impl FnOnce() -> R,
    ) -> (R, Result<Place>) {
        let Place::File(target) = self else { return (work(), Ok(self)) };
        let waiting = Mutex::new(Some(target));
        let fill = || {
            let target = waiting.lock().unwrap_or_else(PoisonError::into_inner).take();
            target.map(|target| defect::caught(|| target.fill(mesh, header, workers, &mut |_| ())))
        };
        thread::scope(|scope| {
            let filling = thread::Builder::new().name("asra-writer".into()).spawn_scoped(scope, fill);
            let done = work();
            // A thread that the system refuses costs time only: then nobody has taken the target yet.
            let filled = filling.ok().and_then(|filling| filling.join().ok().flatten()).or_else(fill);
            let lost = || Err(Error::Internal("the writer is gone, and the mesh's file with it".into()));
            (done, filled.unwrap_or_else(lost).map(Place::Filled))
        })
    }
}
