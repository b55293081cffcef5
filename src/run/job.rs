//! What a run is told: its files, settings, output and means.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::format::write::Positions;
use crate::input::{Cloud, InputOptions, Packing, STANDARD_INPUT};
use crate::points::unit::Unit;
use crate::resources::machine;
use crate::resources::workers::Workers;
#[cfg(feature = "render")]
use crate::run::preview::Preview;
use crate::settings::closing::Sealing;
use crate::settings::open::Hole;
use crate::settings::simplification::{Simplification, Tolerance};
use crate::settings::tileset::TilesetOptions;
use crate::settings::{Fineness, Resolution, Settings};
use crate::storage::atomic_file::Overwrite;
use crate::storage::remote::is_remote;
use crate::storage::spool::Workspace;

/// Everything a run is told.
#[derive(Debug, Clone)]
pub struct Job {
    /// Files, patterns, folders, or `-` for standard input.
    pub inputs: Vec<PathBuf>,
    /// How raw files are laid out.
    pub input: InputOptions,
    /// What is made of the points.
    pub settings: Settings,
    /// The mesh file; by default beside the first input.
    pub output: Option<PathBuf>,
    /// The side of square tiles, in the input's units, if the mesh is to be a folder of them.
    pub tile: Option<f64>,
    /// Whether the mesh is to be a folder with a file for each input. Inputs are read in the order of their names then.
    pub batch: bool,
    /// The units of lengths in [`Job::settings`] and [`Job::tile`], where these are not the input's.
    pub units: Units,
    /// Whether a picture of the mesh is drawn, too.
    #[cfg(feature = "render")]
    pub preview: Preview,
    /// The page that the run is reported on, if any.
    #[cfg(feature = "render")]
    pub html: Option<PathBuf>,
    /// The LAZ or LAS file that the verdicts of the ground filter are written to, if any.
    pub write_classes: Option<PathBuf>,
    /// The GeoTIFF file of the ground's heights, if any.
    pub dtm: Option<PathBuf>,
    /// The GeoTIFF file of the heights of what is highest, if any.
    pub dsm: Option<PathBuf>,
    /// The side of the cells of both, in the input's units; a metre by default.
    pub raster_size: Option<f64>,
    /// Whether it may replace a file.
    pub overwrite: Overwrite,
    /// How a tileset is made, if the output is named `tileset.json`.
    pub tileset: TilesetOptions,
    /// Which coordinates the mesh file has; by default what is usual for its format.
    pub positions: Option<Positions>,
    /// What the run may use.
    pub resources: Resources,
    /// Whether the mesh is checked before it gets its name.
    pub check: Check,
}

impl Job {
    /// Whether the mesh is drawn, too.
    pub(super) fn is_drawn(&self) -> bool {
        #[cfg(feature = "render")]
        return self.preview != Preview::None || self.html.is_some();
        #[cfg(not(feature = "render"))]
        false
    }

    /// A job with the command's defaults.
    pub fn new(inputs: impl IntoIterator<Item = impl Into<PathBuf>>) -> Job {
        Job {
            inputs: inputs.into_iter().map(Into::into).collect(),
            input: InputOptions::default(),
            settings: Settings::default(),
            output: None,
            tile: None,
            batch: false,
            units: Units::default(),
            #[cfg(feature = "render")]
            preview: Preview::None,
            #[cfg(feature = "render")]
            html: None,
            write_classes: None,
            dtm: None,
            dsm: None,
            raster_size: None,
            overwrite: Overwrite::Refuse,
            tileset: TilesetOptions::default(),
            positions: None,
            resources: Resources::default(),
            check: Check::Always,
        }
    }

    /// The job with all lengths in the unit of a cloud's coordinates.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if a length has a unit, and the cloud's coordinates have none that is known, or are degrees.
    pub(crate) fn measured_as(&self, cloud: &Cloud) -> Result<Job> {
        let Units { cell_size, seal, max_hole, base, tile, trim, simplify, raster_size } = self.units;
        let length = |setting: &'static str, length: f64, unit: Option<Unit>| {
            unit.map_or(Ok(length), |unit| cloud.length(setting, length, unit))
        };
        let mut settings = self.settings;
        if let Fineness::Given(Resolution::Cell(side)) = &mut settings.fineness {
            *side = length("cell_size", *side, cell_size)?;
        }
        if let Sealing::Length(radius) = &mut settings.seal {
            *radius = length("seal", *radius, seal)?;
        }
        if let Some(open) = &mut settings.open {
            if let Hole::Length(width) = &mut open.max_hole {
                *width = length("max_hole", *width, max_hole)?;
            }
            open.base = open.base.map(|height| length("base", height, base)).transpose()?;
        }
        if let Some(Tolerance::Length(distance)) = &mut settings.trim {
            *distance = length("trim", *distance, trim)?;
        }
        if let Some(Simplification { tolerance: Some(Tolerance::Length(tolerance)), .. }) = &mut settings.simplify {
            *tolerance = length("simplify", *tolerance, simplify)?;
        }
        let tile = self.tile.map(|side| length("tile", side, tile)).transpose()?;
        let raster_size = self.raster_size.map(|side| length("raster_size", side, raster_size)).transpose()?;
        Ok(Job { settings, tile, raster_size, units: Units::default(), ..self.clone() })
    }
}

/// The units of lengths that were given with a unit. A length without one is in the unit of the input's coordinates, whatever that is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Units {
    /// The unit of the side of a cell.
    pub cell_size: Option<Unit>,
    /// The unit of the radius that holes are closed with.
    pub seal: Option<Unit>,
    /// The unit of the widest hole that is bridged.
    pub max_hole: Option<Unit>,
    /// The unit of the height of a flat bottom.
    pub base: Option<Unit>,
    /// The unit of the side of tiles.
    pub tile: Option<Unit>,
    /// The unit of the distance that triangles are left out beyond.
    pub trim: Option<Unit>,
    /// The unit of the tolerance of simplification.
    pub simplify: Option<Unit>,
    /// The unit of the side of a raster's cells.
    pub raster_size: Option<Unit>,
}

/// What a run may use. Nothing of it shows in the mesh.
#[derive(Debug, Clone, Default)]
pub struct Resources {
    /// Memory, in bytes; by default a quarter of the machine's.
    pub max_memory: Option<u64>,
    /// Worker threads; by default one for each processor.
    pub threads: Option<usize>,
    /// The folder for temporary files; by default `TMPDIR`, or else the output's folder.
    pub temp_dir: Option<PathBuf>,
    /// The folder where finished phases stay, so that a run that was ended can go on; by default none do.
    pub work: Option<PathBuf>,
}

/// Threads that may be asked for on any machine; more than a few for each processor only cost time and memory.
const MOST_THREADS: usize = 256;

/// Whether the mesh is checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Check {
    /// It is, and nothing is written if it fails.
    #[default]
    Always,
    /// It is not.
    Never,
}

impl Resources {
    /// The memory budget in bytes.
    pub fn budget(&self) -> u64 {
        self.max_memory.unwrap_or_else(|| machine::memory() / 4)
    }

    /// The worker threads.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] for more threads than any machine could use; as [`Workers::new`].
    pub fn workers(&self) -> Result<Workers> {
        let most = MOST_THREADS.max(4 * machine::processors());
        if let Some(threads) = self.threads.filter(|threads| *threads > most) {
            return Err(Error::setting(
                "threads",
                format!("`threads` {threads}: there are {} processors; at most {most} threads", machine::processors()),
            ));
        }
        Workers::new(self.threads.unwrap_or_else(machine::processors))
    }

    /// The work directory, `beside` a file unless told otherwise.
    ///
    /// # Errors
    /// The same as [`Workspace::new`].
    pub fn workspace(&self, beside: &Path) -> Result<Workspace> {
        Workspace::new(self.folder(beside))
    }

    /// A work directory for looking at points, after which nothing stays: as [`Resources::workspace`]; but where nothing can be written `beside`, and no folder was
    /// named, the system's folder for temporary files, with the folder that could not be written to.
    ///
    /// # Errors
    /// The same as [`Workspace::new`].
    pub(super) fn looking(&self, beside: &Path) -> Result<(Workspace, Option<PathBuf>)> {
        let folder = self.folder(beside);
        match Workspace::new(&folder) {
            Err(_) if self.temp_dir.is_none() => {
                let system = std::env::temp_dir();
                if system == folder {
                    Workspace::new(system).map(|there| (there, None))
                } else {
                    Ok((Workspace::unchecked(system), Some(folder)))
                }
            }
            there => Ok((there?, None)),
        }
    }

    fn folder(&self, beside: &Path) -> PathBuf {
        // What lies in an object store is no place for temporary files.
        let named = self.temp_dir.as_ref().or(self.work.as_ref().filter(|work| !is_remote(work)));
        named.cloned().unwrap_or_else(|| Workspace::folder_beside(beside))
    }
}

/// The default output: the first input's name with `.mesh.ply` for its extension, beside it. If that input is a pattern, the first
/// of its `files` counts; if a file is compressed, the name it has without that.
pub(super) fn default_output(inputs: &[PathBuf], files: &[PathBuf]) -> PathBuf {
    let named = inputs.first().filter(|input| input.exists() && input.file_name().is_some()).unwrap_or(&files[0]);
    let bare = Packing::named(named).filter(|_| named.is_file()).map(|(_, bare)| bare);
    bare.as_ref().unwrap_or(named).with_extension("mesh.ply")
}

/// The mesh's name for `inputs` that stand for `files`, if nobody gave it one.
///
/// # Errors
/// [`Error::Usage`] if the first input is standard input.
pub fn default_output_of(inputs: &[PathBuf], files: &[PathBuf]) -> Result<PathBuf> {
    if inputs[0] == Path::new(STANDARD_INPUT) {
        return Err(Error::Usage("standard input has no name that the mesh could have; pass `output`".to_string()));
    }
    Ok(default_output(inputs, files))
}
