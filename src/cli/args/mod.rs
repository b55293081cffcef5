//! The flags: name, type, help and default, each in one place; README's table is tested against this.

mod examples;
mod meshes;
mod shared;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;

pub use self::meshes::{CheckArguments, CompareArguments, DensifyArguments, RenderArguments};
use self::shared::in_unit;
pub use self::shared::{InUnit, ProgressWord, ResourceArguments, TalkArguments, overwrite};
use super::sizes;
use crate::error::{Error, Result};
use crate::format::write::Positions;
use crate::generate::Shape;
use crate::grid::CELLS_LIMIT;
use crate::input::{Depth, Filter, InputOptions, Layout, Returns, Withheld, tells_stations};
use crate::points::attribute::Wanted;
use crate::points::bounds::{Axis, Bounds};
use crate::points::crs::Crs;
use crate::points::scalar::Endian;
use crate::run::preview::Preview;
use crate::run::progress::Show;
use crate::run::{Check, Job, Resources, Units};
use crate::settings::closing::Least;
use crate::settings::closing::Sealing;
use crate::settings::open::{Facing, Hole, Kind, Open};
use crate::settings::surface::Diagonals;
use crate::settings::surface::{Fit, SurfaceOptions};
use crate::settings::{AxisChoice, Resolution};
use crate::settings::{Fineness, Settings};

/// Turns point clouds too large for memory into watertight triangle meshes, without normals.
///
/// Points are sorted into slices on disk; a sliding window of slices streams through closing, extraction, smoothing and
/// fitting. The mesh is closed, oriented and 2-manifold, or with --surface a 2-manifold with a boundary; it is checked, and it has
/// the same bytes for any memory and threads. docs/guide.md has recipes for objects, terrain and noisy scans.
#[derive(Debug, Parser)]
#[command(version, args_conflicts_with_subcommands = true, arg_required_else_help = true)]
#[command(after_help = examples::of_the_command())]
pub struct Arguments {
    /// What to do instead of reconstructing.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// What to reconstruct.
    #[command(flatten)]
    pub reconstruct: ReconstructArguments,
}

impl Arguments {
    /// How progress is to be shown.
    pub fn show(&self) -> Show {
        match &self.command {
            None => self.reconstruct.talk.show(),
            Some(Command::Plan(plan)) => plan.progress.show(),
            Some(Command::Info(info)) => info.progress.show(),
            Some(Command::Check(check)) => check.talk.show(),
            Some(Command::Compare(compare)) => compare.talk.show(),
            Some(Command::Densify(densify)) => densify.talk.show(),
            Some(Command::Render(render)) => render.talk.show(),
            Some(Command::Generate(generate)) => generate.talk.show(),
            Some(Command::Completions(_) | Command::Man(_)) => Show::Nothing,
        }
    }
}

/// What to do instead of reconstructing.
#[derive(Debug, Subcommand)]
pub enum Command {
    #[command(after_help = examples::PLAN)]
    /// Show what a reconstruction would take (memory, disk, slices, triangles, tiles), without doing it
    Plan(PlanArguments),
    #[command(after_help = examples::INFO)]
    /// Show what is in the input: layout, points and how densely they lie, reference system and its unit, box, classes and returns, grid
    Info(InfoArguments),
    #[command(after_help = examples::CHECK)]
    /// Check a mesh: closed, oriented, manifold, free of self-intersections, Euler number, components, volume, area (exit
    /// code 4 if it is no closed oriented 2-manifold or intersects itself)
    Check(CheckArguments),
    #[command(after_help = examples::COMPARE)]
    /// Measure how far a mesh lies from a reference, a mesh or a cloud, and the reference from it
    Compare(CompareArguments),
    #[command(after_help = examples::DENSIFY)]
    /// Add the centroids of a mesh's triangles to a cloud
    Densify(DensifyArguments),
    #[command(after_help = examples::RENDER)]
    /// Draw a picture of a mesh
    Render(RenderArguments),
    /// Write a test cloud of any size
    #[command(after_help = examples::GENERATE)]
    Generate(GenerateArguments),
    /// Print what a shell needs to complete this command's options
    #[command(after_help = examples::COMPLETIONS)]
    Completions(CompletionsArguments),
    /// Print the manual page of this command, or of a subcommand
    #[command(after_help = examples::MAN)]
    Man(ManArguments),
}

/// Arguments of `completions`.
#[derive(Debug, Args)]
pub struct CompletionsArguments {
    /// The shell
    #[arg(value_enum)]
    pub shell: Shell,
}

/// Arguments of `man`.
#[derive(Debug, Args)]
pub struct ManArguments {
    /// The subcommand: check, compare and so on [default: the command itself]
    pub command: Option<String>,
}

/// Which coordinates a mesh has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CoordinatesWord {
    /// The input's own.
    Input,
    /// Less an origin.
    Local,
}

/// Arguments of a reconstruction.
#[derive(Debug, Args)]
pub struct ReconstructArguments {
    /// The cloud and how it is meshed.
    #[command(flatten)]
    pub cloud: CloudArguments,
    /// The mesh file: .ply, .stl, .obj or .glb [default: the first input's name with .mesh.ply]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Replace the output if it exists
    #[arg(long)]
    pub overwrite: bool,
    /// Write a file for each square of this side, in the input's units or as in 100m, and an index, in the folder city.tiles for city.ply: PLY and GLB; at most 100,000
    #[arg(long, value_name = "SIDE", value_parser = side, allow_negative_numbers = true)]
    pub tile: Option<InUnit<f64>>,
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

/// The cloud and how it is meshed.
#[derive(Debug, Args)]
pub struct CloudArguments {
    /// Point clouds: .las, .laz, .e57, .ply, .pcd, .npy, .obj, .stl, text (.xyz .txt .csv .pts .asc) or raw binary, also as .gz and .zst; several files, patterns
    /// and folders are one cloud; - is standard input
    #[arg(value_name = "INPUT", required = true)]
    pub inputs: Vec<PathBuf>,
    /// Look into the folders in folders, too
    #[arg(long, help_heading = "Input")]
    pub recursive: bool,
    /// Record layout of raw files: xyz, xyzi, xyzir, xyzrgb, xyz:f64, x:f64,y:f64,z:f64,i:u16,_:6 [default: the side-car's, else detected]
    #[arg(long, value_name = "FIELDS", help_heading = "Input")]
    pub layout: Option<Layout>,
    /// Bytes before the first record of raw files [default: the side-car's, else 0]
    #[arg(long, value_name = "N", help_heading = "Input")]
    pub skip_bytes: Option<u64>,
    /// Byte order of raw files [default: the side-car's, else little]
    #[arg(long, value_enum, help_heading = "Input")]
    pub endian: Option<EndianWord>,
    /// What is carried from points to the mesh's vertices: all that files have (but normals, and what never changes), none, or a list such as rgb,intensity
    #[arg(long, value_name = "all|none|NAMES", default_value = "all", help_heading = "Input")]
    pub attributes: Wanted,
    /// The coordinate reference system, whatever the files say: EPSG:25832, WKT, a file with WKT, or none. Nothing is reprojected
    #[arg(long, value_name = "CRS", help_heading = "Input")]
    pub crs: Option<String>,
    /// Leave out points of these classes, such as 7,18
    #[arg(long, value_name = "CLASSES", value_delimiter = ',', help_heading = "Input")]
    pub drop_class: Vec<u8>,
    /// Take points of these classes only, such as 2,6
    #[arg(long, value_name = "CLASSES", value_delimiter = ',', help_heading = "Input")]
    pub keep_class: Vec<u8>,
    /// Take the first return of every pulse only
    #[arg(long, help_heading = "Input", conflicts_with = "last_return")]
    pub first_return: bool,
    /// Take the last return of every pulse only
    #[arg(long, help_heading = "Input")]
    pub last_return: bool,
    /// Take points within this box only: XMIN,YMIN,XMAX,YMAX or XMIN,YMIN,ZMIN,XMAX,YMAX,ZMAX
    #[arg(long, value_name = "BOX", value_parser = bounds, allow_hyphen_values = true, help_heading = "Input")]
    pub bounds: Option<Bounds>,
    /// Take points that are marked as withheld, too
    #[arg(long, help_heading = "Input")]
    pub keep_withheld: bool,
    /// Slices for each cube root of the number of points [default: 4]
    #[arg(long, value_name = "K", value_parser = positive, allow_negative_numbers = true, help_heading = "Grid")]
    #[arg(conflicts_with_all = ["slices", "cell_size"])]
    pub k: Option<f64>,
    /// Number of slices, instead of --k
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u32).range(1..=i64::from(CELLS_LIMIT)))]
    #[arg(allow_negative_numbers = true, help_heading = "Grid", conflicts_with = "cell_size")]
    pub slices: Option<u32>,
    /// Side of a cell, in the input's units or as in 5cm, or `auto`: 1.25 sampling distances; instead of --k
    #[arg(long, value_name = "W|auto", value_parser = cell_size, allow_negative_numbers = true, help_heading = "Grid")]
    pub cell_size: Option<InUnit<Fineness>>,
    /// The axis to slice along
    #[arg(long, value_enum, default_value_t, help_heading = "Grid")]
    pub axis: AxisWord,
    /// Slices in the window: an odd number, at least 3. It bounds a radius that --seal gives, to (W - 1) / 2 cells; without one, every W gives the same surface
    #[arg(long, value_name = "W", help_heading = "Surface")]
    pub window: Option<u32>,
    /// How holes are closed: as wide as they are, up to a third of the longest side (auto), by a ball of radius R (a length as in 2.5 or 30cm, or cells as in `8c`), or not (off)
    #[arg(long, value_name = "auto|R|off", default_value = "auto", value_parser = sealing, help_heading = "Surface")]
    #[arg(allow_negative_numbers = true)]
    pub seal: InUnit<Sealing>,
    /// Keep points that lie apart from all surfaces; else the surface does not go to them
    #[arg(long, help_heading = "Surface")]
    pub keep_outliers: bool,
    /// Points that make a cell occupied, at least: thins out strays
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..), help_heading = "Surface")]
    pub min_points: u32,
    /// Cells of a component, at least: a number (1 keeps all), a share of the largest's such as 1%, or `largest`; auto leaves out specks: fewer than 64 cells,
    /// less than a thousandth of the largest, and in all less than a fiftieth of the cells
    #[arg(
        long,
        value_name = "auto|N|P%|largest",
        default_value = "auto",
        allow_negative_numbers = true,
        help_heading = "Surface"
    )]
    pub min_component: Least,
    /// A closed surface; or one that is open where the points end: of what was scanned from one side, or of ground seen from above
    #[arg(long, value_enum, default_value_t, help_heading = "Surface")]
    pub surface: SurfaceWord,
    /// Where a sheet's points were seen from: +x, -x, +y, -y, +z or -z; a direction such as 0.3,0,1; a position such as @2,0.5,1; or @poses, the positions that E57 files tell
    #[arg(long, value_name = "FROM", allow_hyphen_values = true, help_heading = "Surface")]
    pub facing: Option<Facing>,
    /// The widest hole that is bridged in a sheet or terrain, a length as in 2.5 or 3m, or cells as in `8c` [default: 16c]
    #[arg(long, value_name = "WIDTH", value_parser = in_unit::<Hole>, allow_negative_numbers = true, help_heading = "Surface")]
    pub max_hole: Option<InUnit<Hole>>,
    /// Close terrain into a body with a flat bottom at this height, such as 120 or -3m
    #[arg(long, value_name = "Z", value_parser = height, allow_hyphen_values = true, help_heading = "Surface")]
    pub base: Option<InUnit<f64>>,
    /// Steps of smoothing: the first is the paper's, those after it do not shrink the surface
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Surface")]
    pub smooth: u32,
    /// Which diagonal cuts a rectangle into triangles
    #[arg(long, value_enum, default_value_t, help_heading = "Surface")]
    pub diagonals: Diagonals,
    /// What vertices are moved onto; the summary says so where points turn out to be noisy
    #[arg(long, value_enum, default_value_t, help_heading = "Surface")]
    pub fit: Fit,
}

/// Arguments of `plan`.
#[derive(Debug, Args)]
pub struct PlanArguments {
    /// Write what is found as JSON, see docs/info-and-plan.md
    #[arg(long)]
    pub json: bool,
    /// Write a file for each square of this side, in the input's units or as in 100m, and an index, in the folder city.tiles for city.ply: PLY and GLB; at most 100,000
    #[arg(long, value_name = "SIDE", value_parser = side, allow_negative_numbers = true)]
    pub tile: Option<InUnit<f64>>,
    /// How progress is told: auto is a bar on a terminal, else lines with the time of day; json is an object a line, see docs/progress.md
    #[arg(long, value_name = "HOW", value_enum, default_value_t, hide_possible_values = true)]
    pub progress: ProgressWord,
    /// The cloud and how it would be meshed.
    #[command(flatten)]
    pub cloud: CloudArguments,
    /// Memory, disk, threads.
    #[command(flatten)]
    pub resources: ResourceArguments,
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

/// Arguments of `generate`.
#[derive(Debug, Args)]
pub struct GenerateArguments {
    /// What is sampled
    #[arg(value_enum)]
    pub shape: Shape,
    /// Number of points, such as 5000, 100k or 20M
    #[arg(value_parser = sizes::count)]
    pub points: u64,
    /// The file: .bin (with a side-car), .ply or .xyz
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Standard deviation of the noise on each coordinate, as a fraction of the size
    #[arg(long, default_value_t = 0.0)]
    pub noise: f64,
    /// Length of the longest side
    #[arg(long, default_value_t = 1.0)]
    pub size: f64,
    /// Where the centre lies; away from zero, coordinates are written as f64
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, default_value = "0,0,0", allow_hyphen_values = true)]
    pub offset: Triple,
    /// Replace the file if it exists
    #[arg(long)]
    pub overwrite: bool,
    /// How much is said.
    #[command(flatten)]
    pub talk: TalkArguments,
    /// Worker threads [default: one for each processor]
    #[arg(short = 'j', long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
}

fn side(text: &str) -> std::result::Result<InUnit<f64>, String> {
    InUnit::parse(text, positive, |_| true)
}

fn height(text: &str) -> std::result::Result<InUnit<f64>, String> {
    let number = |text: &str| text.parse().map_err(|_| format!("expected a height such as 120 or -3m, found {text:?}"));
    InUnit::parse(text, number, |_| true)
}

fn cell_size(text: &str) -> std::result::Result<InUnit<Fineness>, String> {
    InUnit::parse(text, fineness, |value| *value != Fineness::Sampling)
}

/// A way to close holes, as typed.
fn sealing(text: &str) -> std::result::Result<InUnit<Sealing>, String> {
    InUnit::parse(text, unmeasured_sealing, |value| matches!(value, Sealing::Length(_)))
}

fn unmeasured_sealing(text: &str) -> std::result::Result<Sealing, String> {
    let expected = || format!("expected auto, off, a length, or a number of cells such as 8c, found {text:?}");
    match (text, text.strip_suffix('c')) {
        ("auto", _) => Ok(Sealing::Auto),
        ("off", _) => Ok(Sealing::Off),
        (_, Some(cells)) => match cells.parse() {
            Ok(cells @ 1..) => Ok(Sealing::Cells(cells)),
            _ => Err(expected()),
        },
        _ => match text.parse() {
            Ok(length) if f64::is_finite(length) && length > 0.0 => Ok(Sealing::Length(length)),
            _ => Err(expected()),
        },
    }
}

/// Three numbers.
pub type Triple = Coordinates;

/// X, Y and Z as typed.
#[derive(Debug, Clone, Copy)]
pub struct Coordinates(pub [f64; 3]);

/// The axis as typed.
#[derive(Debug, Clone, Copy, Default, ValueEnum)]
pub enum AxisWord {
    /// The longest side of the cloud's box.
    #[default]
    Longest,
    /// The first coordinate.
    X,
    /// The second coordinate.
    Y,
    /// The third coordinate.
    Z,
}

/// The kind of surface as typed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum SurfaceWord {
    /// Closed everywhere: the surface of a body.
    #[default]
    Closed,
    /// One layer, seen from one side.
    Sheet,
    /// One layer, seen from above.
    Terrain,
}

/// The byte order as typed.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum EndianWord {
    /// Least significant byte first.
    #[value(alias = "le")]
    Little,
    /// Most significant byte first.
    #[value(alias = "be")]
    Big,
}

fn positive(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        _ => Err(format!("expected a number above 0, found {text:?}")),
    }
}

fn fineness(text: &str) -> std::result::Result<Fineness, String> {
    if text == "auto" {
        return Ok(Fineness::Sampling);
    }
    positive(text)
        .map(|side| Fineness::Given(Resolution::Cell(side)))
        .map_err(|_| format!("expected a length above 0, or `auto`, found {text:?}"))
}

fn bounds(text: &str) -> std::result::Result<Bounds, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
    let bounds = match numbers.as_deref() {
        Some(&[x, y, to_x, to_y]) => Bounds { min: [x, y, f64::NEG_INFINITY], max: [to_x, to_y, f64::INFINITY] },
        Some(&[x, y, z, to_x, to_y, to_z]) => Bounds { min: [x, y, z], max: [to_x, to_y, to_z] },
        _ => return Err(format!("expected four or six numbers such as 0,0,100,100, found {text:?}")),
    };
    // Not a number is no less than anything.
    match (0..3).all(|a| bounds.min[a] <= bounds.max[a]) {
        true => Ok(bounds),
        false => Err(format!("expected the least coordinates, then the greatest, found {text:?}")),
    }
}

fn triple(text: &str) -> std::result::Result<Coordinates, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|word| word.trim().parse().ok()).collect();
    match numbers.try_into() {
        Ok(numbers) if text.split(',').count() == 3 => Ok(Coordinates(numbers)),
        _ => Err(format!("expected three numbers such as 1,2.5,-3, found {text:?}")),
    }
}

impl CloudArguments {
    /// Options of an open surface.
    fn open(&self) -> Result<Option<Open>> {
        let wrong = |message: &str| Err(Error::Usage(message.into()));
        let max_hole = self.max_hole.map_or(Hole::DEFAULT, |hole| hole.value);
        let base = self.base.map(|base| base.value);
        match self.surface {
            SurfaceWord::Closed => match (self.facing, self.max_hole, self.base) {
                (None, None, None) => Ok(None),
                (Some(_), ..) => wrong("--facing: is for --surface sheet"),
                (_, Some(_), _) => {
                    wrong("--max-hole: is for --surface sheet and terrain; --seal closes the holes of a closed surface")
                }
                _ => wrong("--base: is for --surface terrain"),
            },
            SurfaceWord::Sheet if self.base.is_some() => wrong("--base: is for --surface terrain"),
            SurfaceWord::Sheet => match self.facing {
                Some(facing) => Ok(Some(Open { kind: Kind::Sheet, facing, max_hole, base: None })),
                None => {
                    let told = if tells_stations(&self.inputs, self.depth()) {
                        "; the input tells: --facing @poses"
                    } else {
                        ""
                    };
                    wrong(&format!("--surface sheet: --facing must say where the points were seen from{told}"))
                }
            },
            SurfaceWord::Terrain => match self.facing {
                None | Some(Facing::UP) => Ok(Some(Open { max_hole, base, ..Open::TERRAIN })),
                Some(_) => wrong("--facing: terrain is seen from +z; --surface sheet is for other directions"),
            },
        }
    }

    fn settings(&self) -> Result<Settings> {
        let given = |resolution| Fineness::Given(resolution);
        let fineness = match (self.k, self.slices, self.cell_size) {
            (Some(k), ..) => given(Resolution::K(k)),
            (_, Some(slices), _) => given(Resolution::Slices(slices)),
            (.., Some(fineness)) => fineness.value,
            _ => Fineness::Default,
        };
        let axis = match self.axis {
            AxisWord::Longest => AxisChoice::Longest,
            AxisWord::X => AxisChoice::Fixed(Axis::X),
            AxisWord::Y => AxisChoice::Fixed(Axis::Y),
            AxisWord::Z => AxisChoice::Fixed(Axis::Z),
        };
        let surface = SurfaceOptions { smooth: self.smooth, diagonals: self.diagonals, fit: self.fit };
        let (min_points, min_component) = (self.min_points, Some(self.min_component));
        let (seal, window, open) = (self.seal.value, self.window, self.open()?);
        let keep_outliers = self.keep_outliers;
        Ok(Settings { fineness, axis, seal, window, keep_outliers, min_points, min_component, surface, open })
    }

    /// How folders are looked into.
    pub fn depth(&self) -> Depth {
        if self.recursive { Depth::Recursive } else { Depth::Flat }
    }

    /// The units of the lengths in the settings.
    fn units(&self) -> Units {
        Units {
            cell_size: self.cell_size.and_then(|side| side.unit),
            seal: self.seal.unit,
            max_hole: self.max_hole.and_then(|hole| hole.unit),
            base: self.base.and_then(|base| base.unit),
            tile: None,
        }
    }

    fn input(&self) -> Result<InputOptions> {
        let endian = self.endian.map(|word| match word {
            EndianWord::Little => Endian::Little,
            EndianWord::Big => Endian::Big,
        });
        let filter = Filter {
            drop_class: self.drop_class.clone(),
            keep_class: self.keep_class.clone(),
            returns: match (self.first_return, self.last_return) {
                (true, _) => Returns::First,
                (_, true) => Returns::Last,
                _ => Returns::All,
            },
            bounds: self.bounds,
            withheld: if self.keep_withheld { Withheld::Kept } else { Withheld::Dropped },
        };
        let (layout, skip_bytes, attributes) = (self.layout.clone(), self.skip_bytes, self.attributes.clone());
        let crs = self.crs.as_deref().map(Crs::given).transpose()?;
        Ok(InputOptions { layout, skip_bytes, endian, attributes, filter, crs, depth: self.depth() })
    }
}

impl ReconstructArguments {
    /// The job they describe.
    ///
    /// # Errors
    /// [`Error::Usage`] for options that contradict each other.
    pub fn job(&self) -> Result<Job> {
        let check = if self.no_check { Check::Never } else { Check::Always };
        let output = self.output.clone();
        let positions = self.coordinates.map(|coordinates| match coordinates {
            CoordinatesWord::Input => Positions::Absolute,
            CoordinatesWord::Local => Positions::Shifted,
        });
        Ok(Job {
            output,
            preview: match &self.preview {
                None => Preview::None,
                Some(None) => Preview::Beside,
                Some(Some(path)) => Preview::At(path.clone()),
            },
            overwrite: overwrite(self.overwrite),
            positions,
            check,
            ..tiled(job(&self.cloud, self.resources.resources())?, self.tile)
        })
    }
}

impl PlanArguments {
    /// The job they describe.
    ///
    /// # Errors
    /// The same as [`ReconstructArguments::job`].
    pub fn job(&self) -> Result<Job> {
        Ok(tiled(job(&self.cloud, self.resources.resources())?, self.tile))
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
        job(&self.cloud, Resources { threads, temp_dir, ..Resources::default() })
    }
}

impl GenerateArguments {
    /// What may be used.
    pub fn resources(&self) -> Resources {
        Resources { threads: self.threads.map(usize::from), ..Resources::default() }
    }
}

fn job(cloud: &CloudArguments, resources: Resources) -> Result<Job> {
    let (input, settings, units) = (cloud.input()?, cloud.settings()?, cloud.units());
    Ok(Job { input, settings, units, resources, ..Job::new(&cloud.inputs) })
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_flags_are_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn one_resolution_at_a_time() {
        for two in
            [["--k", "3", "--slices", "9"], ["--k", "3", "--cell-size", "1"], ["--slices", "9", "--cell-size", "auto"]]
        {
            let line = ["asra-stream", "a.ply"].into_iter().chain(two);
            assert!(Arguments::try_parse_from(line).is_err(), "{two:?}");
        }
    }

    #[test]
    fn a_reconstruction_needs_no_word_for_it() {
        let arguments = Arguments::try_parse_from(["asra-stream", "huge.bin", "--window", "3"]).unwrap();
        let job = arguments.reconstruct.job().unwrap();
        assert_eq!(job.inputs, [PathBuf::from("huge.bin")]);
        assert_eq!(job.settings, Settings { window: Some(3), ..Settings::default() });
    }
}
