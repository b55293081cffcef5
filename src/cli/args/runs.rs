//! Arguments of the commands that reconstruct, or tell what a reconstruction would be.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::cloud::CloudArguments;
use super::shared::{InUnit, ProgressWord, ResourceArguments, TalkArguments, overwrite};
use super::values::side;
use crate::error::{Error, Result};
use crate::format::tiles3d::{TREE, is_named};
use crate::format::write::{Format, Positions};
use crate::input::find;
use crate::run::preview::Preview;
use crate::run::{Check, Job, Resources, Units, default_output_of};
use crate::settings::tileset::{Compression, TilesetOptions};

/// Which coordinates a mesh has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CoordinatesWord {
    /// The input's own.
    Input,
    /// Less an origin.
    Local,
}

/// What a mesh is written as.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FormatWord {
    /// Binary PLY.
    Ply,
    /// Binary STL.
    Stl,
    /// Wavefront OBJ.
    Obj,
    /// glTF 2.0 in one binary file.
    Glb,
    /// A tileset with levels of detail.
    #[value(name = "3dtiles")]
    Tileset,
}

impl FormatWord {
    /// The extension of its files, or of its folder.
    fn extension(self) -> &'static str {
        match self {
            FormatWord::Ply => "ply",
            FormatWord::Stl => "stl",
            FormatWord::Obj => "obj",
            FormatWord::Glb => "glb",
            FormatWord::Tileset => "3dtiles",
        }
    }

    /// The output of this format that a path names: that file, or the tileset in that folder.
    fn named(self, path: &Path) -> Result<PathBuf> {
        let told = match Format::from_path(path).ok() {
            Some(Format::Ply) => Some(FormatWord::Ply),
            Some(Format::Stl) => Some(FormatWord::Stl),
            Some(Format::Obj) => Some(FormatWord::Obj),
            Some(Format::Glb) => Some(FormatWord::Glb),
            None => is_named(path).then_some(FormatWord::Tileset),
        };
        match (told, self) {
            (Some(told), own) if told == own => Ok(path.to_path_buf()),
            (Some(_), _) => {
                let (path, word) = (path.display(), self.extension());
                Err(Error::Usage(format!("--format {word}: {path} names another format; leave one of the two out")))
            }
            (None, FormatWord::Tileset) => Ok(path.join(TREE)),
            (None, _) => {
                let mut name = path.as_os_str().to_owned();
                name.push(format!(".{}", self.extension()));
                Ok(name.into())
            }
        }
    }

    /// The output of this format where nobody has named one, and PLY would be written to `path`.
    fn instead(self, path: &Path) -> PathBuf {
        match self {
            FormatWord::Tileset => path.with_extension("").with_extension(self.extension()).join(TREE),
            _ => path.with_extension(self.extension()),
        }
    }
}

/// Arguments of a reconstruction.
#[derive(Debug, Args)]
pub struct ReconstructArguments {
    /// The cloud and how it is meshed.
    #[command(flatten)]
    pub cloud: CloudArguments,
    /// The mesh file: .ply, .stl, .obj or .glb; or tileset.json in a folder of its own, as in city/tileset.json: 3D Tiles with levels of detail [default: the first
    /// input's name with .mesh.ply]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// What the mesh is written as, where its name does not say; with 3dtiles, the output is the tileset's folder
    #[arg(long, value_name = "FORMAT", value_enum)]
    pub format: Option<FormatWord>,
    /// Replace the output if it exists
    #[arg(long)]
    pub overwrite: bool,
    /// Write a file for each square of this side, in the input's units or as in 100m, and an index, in the folder city.tiles for city.ply: PLY and GLB; at most 100,000
    #[arg(long, value_name = "SIDE", value_parser = side, allow_negative_numbers = true)]
    pub tile: Option<InUnit<f64>>,
    /// Write a file for each input, named as that, and an index, in the folder city.tiles for city.ply: all are one surface, so where files meet they share
    /// vertices, to the last bit; PLY and GLB
    #[arg(long, conflicts_with = "tile")]
    pub batch: bool,
    /// Hang no skirts from the tiles of a tileset's coarser levels, which hide gaps to other levels where a surface is open
    #[arg(long)]
    pub no_skirts: bool,
    /// Metres that are added to the heights of a tileset on Earth, which are taken as those above the ellipsoid: the geoid's, for heights above the sea
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub height_offset: Option<f64>,
    /// Make a tileset's tiles smaller: quantize has places in 16 bits and normals in 8, meshopt encodes them, too; not all readers take them
    #[arg(long, value_enum, default_value_t, value_name = "HOW")]
    pub compress: Compression,
    /// Write all points with the ground filter's verdicts as their classes (2 on the ground, 1 elsewhere; 7, 9 and 18 stay), a .laz or .las file: with --surface ground
    #[arg(long, value_name = "FILE")]
    pub write_classes: Option<PathBuf>,
    /// Write the heights of the ground as GeoTIFF, of each cell the mean of its points on the ground (told as --classes says); holes up to --max-hole are filled
    #[arg(long, value_name = "FILE")]
    pub dtm: Option<PathBuf>,
    /// Write the heights of what is highest as GeoTIFF, of each cell the highest point; holes up to --max-hole are filled
    #[arg(long, value_name = "FILE")]
    pub dsm: Option<PathBuf>,
    /// Side of a cell of --dtm and --dsm, in the input's units or as in 50cm [default: 1m]
    #[arg(long, value_name = "SIDE", value_parser = side, allow_negative_numbers = true)]
    pub raster_size: Option<InUnit<f64>>,
    /// Draw a picture of the mesh, too [default: the mesh's name with .png]
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    pub preview: Option<Option<PathBuf>>,
    /// Which coordinates the mesh has: the input's own, in double precision, or local ones, less a round origin that the file, or one beside it, tells [default:
    /// input for PLY, local for OBJ, STL and GLB]
    #[arg(long, value_name = "KIND", value_enum)]
    pub coordinates: Option<CoordinatesWord>,
    /// Do not check the mesh at the end
    #[arg(long)]
    pub no_check: bool,
    /// Write a report of the run as JSON; an existing one is replaced
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Write a report as a page that any browser opens, all in one file: figures, pictures, charts and the mesh; an existing one is replaced
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
    /// Keep what is done in this folder: the same command given again goes on from where the run was ended. It is removed at the end. With plan, write the run down
    /// there as tasks, which any number of processes do with asra-stream work
    #[arg(long, value_name = "DIR", help_heading = "Resources")]
    pub work: Option<PathBuf>,
    /// How much is said.
    #[command(flatten)]
    pub talk: TalkArguments,
    /// Say more: the summary's details, too
    #[arg(short, long, conflicts_with = "quiet")]
    pub verbose: bool,
    /// Memory, disk, threads.
    #[command(flatten)]
    pub resources: ResourceArguments,
}

/// Arguments of `plan`.
#[derive(Debug, Args)]
pub struct PlanArguments {
    /// Write what is found as JSON, see docs/info-and-plan.md
    #[arg(long)]
    pub json: bool,
    /// With --work: for so many processes side by side, so many tasks are there to do at a time
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..), default_value_t = 8, requires = "work", help_heading = "Resources")]
    pub processes: u16,
    /// The run that the plan is of: its options stay as they are.
    #[command(flatten)]
    pub run: ReconstructArguments,
}

/// Arguments of `info`.
#[derive(Debug, Args)]
pub struct InfoArguments {
    /// Write what is found as JSON, see docs/info-and-plan.md
    #[arg(long)]
    pub json: bool,
    /// How progress is told: auto is a bar on a terminal, else lines with the time of day; json is an object a line, see docs/progress.md
    #[arg(long, value_name = "HOW", value_enum, default_value_t, hide_possible_values = true)]
    pub progress: ProgressWord,
    /// The cloud and how it would be meshed.
    #[command(flatten)]
    pub cloud: CloudArguments,
    /// Worker threads [default: one for each processor]
    #[arg(short = 'j', long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..), help_heading = "Resources")]
    pub threads: Option<u16>,
    /// Folder for temporary files [default: TMPDIR, else the mesh's folder]
    #[arg(long, value_name = "DIR", help_heading = "Resources")]
    pub temp_dir: Option<PathBuf>,
}

impl ReconstructArguments {
    /// The output, if one is named, or a format is.
    ///
    /// # Errors
    /// [`Error::Usage`] if the two contradict each other; those of [`default_output_of`].
    pub fn output(&self) -> Result<Option<PathBuf>> {
        match (self.format, &self.output) {
            (None, output) => Ok(output.clone()),
            (Some(format), Some(path)) => format.named(path).map(Some),
            (Some(format), None) => {
                let inputs = &self.cloud.inputs;
                // That there is no input is told where it is opened.
                let files = find(inputs, self.cloud.depth()).unwrap_or_default().files;
                match files.is_empty() {
                    true => Ok(None),
                    false => default_output_of(inputs, &files).map(|path| Some(format.instead(&path))),
                }
            }
        }
    }

    /// The job they describe.
    ///
    /// # Errors
    /// [`Error::Usage`] for options that contradict each other.
    pub fn job(&self) -> Result<Job> {
        let check = if self.no_check { Check::Never } else { Check::Always };
        let output = self.output()?;
        let positions = self.coordinates.map(|coordinates| match coordinates {
            CoordinatesWord::Input => Positions::Absolute,
            CoordinatesWord::Local => Positions::Shifted,
        });
        let resources = Resources { work: self.work.clone(), ..self.resources.resources() };
        let job = tiled(self.cloud.job(resources)?, self.tile);
        let units = Units { raster_size: self.raster_size.and_then(|side| side.unit), ..job.units };
        Ok(Job {
            output,
            units,
            preview: match &self.preview {
                None => Preview::None,
                Some(None) => Preview::Beside,
                Some(Some(path)) => Preview::At(path.clone()),
            },
            html: self.html.clone(),
            batch: self.batch,
            write_classes: self.write_classes.clone(),
            dtm: self.dtm.clone(),
            dsm: self.dsm.clone(),
            raster_size: self.raster_size.map(|side| side.value),
            overwrite: overwrite(self.overwrite),
            tileset: TilesetOptions {
                skirts: !self.no_skirts,
                height_offset: self.height_offset,
                compress: self.compress,
            },
            positions,
            check,
            ..job
        })
    }
}

/// The job with its mesh in tiles of a side, if there is one.
fn tiled(job: Job, tile: Option<InUnit<f64>>) -> Job {
    let units = Units { tile: tile.and_then(|side| side.unit), ..job.units };
    Job { tile: tile.map(|side| side.value), units, ..job }
}

impl InfoArguments {
    /// The job they describe.
    ///
    /// # Errors
    /// The same as [`ReconstructArguments::job`].
    pub fn job(&self) -> Result<Job> {
        let (threads, temp_dir) = (self.threads.map(usize::from), self.temp_dir.clone());
        self.cloud.job(Resources { threads, temp_dir, ..Resources::default() })
    }
}
