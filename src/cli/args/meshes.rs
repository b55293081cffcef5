//! Arguments of the subcommands that look at a finished mesh.

use std::path::PathBuf;

use clap::Args;

use super::shared::{InUnit, ResourceArguments, TalkArguments, coordinates_only, in_unit, overwrite};
use crate::cli::sizes;
use crate::error::Result;
use crate::input::Layout;
use crate::points::crs::Crs;
use crate::points::unit::Measure;
use crate::render::{Background, ColourBy, Legend, Options, Shading, Size, Up, View};
use crate::run::compare;
use crate::run::generate::densify;
use crate::run::pyramid::TilesetJob;
use crate::run::simplification::SimplifyJob;
use crate::settings::simplification::{Borders, Simplification, Tolerance};
use crate::settings::tileset::{Compression, TilesetOptions};

/// Arguments of `check`.
#[derive(Debug, Args)]
pub struct CheckArguments {
    /// The mesh: .ply, .stl, .obj or .glb
    pub mesh: PathBuf,
    /// Accept a mesh that is open: a manifold with a boundary
    #[arg(long)]
    pub open: bool,
    /// Do not look for triangles that intersect
    #[arg(long)]
    pub no_intersections: bool,
    /// Write the findings as JSON; an existing report is replaced
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Write a report as a page that any browser opens, all in one file: figures, pictures, charts and the mesh; an existing one is replaced
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
    /// How much is said.
    #[command(flatten)]
    pub talk: TalkArguments,
    /// Memory, disk, threads.
    #[command(flatten)]
    pub resources: ResourceArguments,
}

/// Arguments of `compare`.
#[derive(Debug, Args)]
pub struct CompareArguments {
    /// The mesh: .ply, .stl, .obj or .glb
    pub mesh: PathBuf,
    /// What it is compared with: a mesh, or a cloud in any format that is read
    pub reference: PathBuf,
    /// What the reference is [default: a mesh if it has triangles]
    #[arg(long = "as", value_name = "KIND", value_enum)]
    pub kind: Option<compare::Kind>,
    /// Record layout of a raw reference [default: the side-car's, else detected]
    #[arg(long, value_name = "FIELDS")]
    pub layout: Option<Layout>,
    /// Write the mesh coloured by its distance from the reference, from dark blue (none) to yellow, as PLY
    #[arg(long, value_name = "FILE")]
    pub heatmap: Option<PathBuf>,
    /// The distance that is yellow: a length (plain, or with a unit as in 5cm), or per cents of the reference's longest side as in 0.5% [default: that of 95 % of
    /// the vertices]
    #[arg(long, value_name = "D|P%", allow_negative_numbers = true, requires = "heatmap", value_parser = in_unit::<compare::Reach>)]
    pub heatmap_max: Option<InUnit<compare::Reach>>,
    /// Replace the heat map if it exists
    #[arg(long)]
    pub overwrite: bool,
    /// Write the findings as JSON; an existing report is replaced
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Write a report as a page that any browser opens, all in one file: figures, pictures, charts and the mesh; an existing one is replaced
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
    /// How much is said.
    #[command(flatten)]
    pub talk: TalkArguments,
    /// Memory, disk, threads.
    #[command(flatten)]
    pub resources: ResourceArguments,
}

/// Arguments of `densify`.
#[derive(Debug, Args)]
pub struct DensifyArguments {
    /// The mesh: .ply, .stl, .obj or .glb
    pub mesh: PathBuf,
    /// The cloud, in any format that is read
    pub cloud: PathBuf,
    /// The file: .bin (with a side-car), .ply or .xyz
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Replace the file if it exists
    #[arg(long)]
    pub overwrite: bool,
    /// Record layout of a raw cloud [default: the side-car's, else detected]
    #[arg(long, value_name = "FIELDS")]
    pub layout: Option<Layout>,
    /// How much is said.
    #[command(flatten)]
    pub talk: TalkArguments,
    /// Memory, disk, threads.
    #[command(flatten)]
    pub resources: ResourceArguments,
}

/// Arguments of `simplify`.
#[derive(Debug, Args)]
pub struct SimplifyArguments {
    /// The mesh: .ply, .stl, .obj or .glb
    pub mesh: PathBuf,
    /// No place of either surface may be farther than this from the other: a length (plain, or with a unit as in 5cm), cells as in 0.25c of a mesh that this program
    /// made, or per cents of the longest side as in 0.01%
    #[arg(value_name = "E", value_parser = in_unit::<Tolerance>, allow_negative_numbers = true, required_unless_present = "max_triangles")]
    pub tolerance: Option<InUnit<Tolerance>>,
    /// Leave at most so many triangles: with the least E that does, or, within E, those that matter most
    #[arg(long, value_name = "N", value_parser = sizes::count)]
    pub max_triangles: Option<u64>,
    /// The file: .ply, .stl, .obj or .glb
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Replace the file if it exists
    #[arg(long)]
    pub overwrite: bool,
    /// What triangles are not joined across: classes, where vertices have some
    #[arg(long, value_enum, default_value_t, value_name = "WHAT")]
    pub keep_borders: Borders,
    /// How much any channel of a colour may change anywhere, in steps of 255, where vertices have colours [default: as much as it may]
    #[arg(long, value_name = "STEPS")]
    pub keep_colours: Option<u8>,
    /// Place vertices anew, where that keeps nearer to the surface, with attributes between those that were there
    #[arg(long)]
    pub move_vertices: bool,
    /// Take a mesh that is no oriented manifold, or intersects itself, too: such places stay as they are
    #[arg(long)]
    pub unsound: bool,
    /// Do not look for triangles of the mesh that intersect
    #[arg(long)]
    pub no_intersections: bool,
    /// Write the findings as JSON; an existing report is replaced
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// How much is said.
    #[command(flatten)]
    pub talk: TalkArguments,
    /// Memory, disk, threads.
    #[command(flatten)]
    pub resources: ResourceArguments,
}

/// Arguments of `tileset`.
#[derive(Debug, Args)]
pub struct TilesetArguments {
    /// The mesh: .ply, .stl, .obj or .glb
    pub mesh: PathBuf,
    /// The tileset: tileset.json in a folder of its own, as in city/tileset.json
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Replace the folder if it is that of a tileset
    #[arg(long)]
    pub overwrite: bool,
    /// Hang no skirts from the tiles of coarser levels, which hide gaps to other levels where a surface is open
    #[arg(long)]
    pub no_skirts: bool,
    /// The mesh's reference system, which tells where on Earth the tileset stands, whatever the file says: EPSG:25832, WKT, a file with WKT, or none
    #[arg(long, value_name = "CRS")]
    pub crs: Option<String>,
    /// Metres that are added to heights, which are taken as those above the ellipsoid: the geoid's, for heights above the sea
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub height_offset: Option<f64>,
    /// Make a tileset's tiles smaller: quantize has places in 16 bits and normals in 8, meshopt encodes them, too; not all readers take them
    #[arg(long, value_enum, default_value_t, value_name = "HOW")]
    pub compress: Compression,
    /// Write the findings as JSON; an existing report is replaced
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// How much is said.
    #[command(flatten)]
    pub talk: TalkArguments,
    /// Memory, disk, threads.
    #[command(flatten)]
    pub resources: ResourceArguments,
}

impl TilesetArguments {
    /// The job they describe.
    ///
    /// # Errors
    /// Those of [`Crs::given`].
    pub fn job(&self) -> Result<TilesetJob> {
        Ok(TilesetJob {
            crs: self.crs.as_deref().map(Crs::given).transpose()?,
            mesh: self.mesh.clone(),
            output: self.output.clone(),
            overwrite: overwrite(self.overwrite),
            options: TilesetOptions {
                skirts: !self.no_skirts,
                height_offset: self.height_offset,
                compress: self.compress,
            },
            resources: self.resources.resources(),
        })
    }
}

/// Arguments of `view`.
#[derive(Debug, Args)]
pub struct ViewArguments {
    /// A tileset (its folder, or the tileset.json in it), a mesh (.ply, .stl, .obj or .glb) or a cloud, of which a mesh is made first
    pub path: PathBuf,
    /// The port of this machine, 127.0.0.1, that the browser asks; 0 is any that is free
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub port: u16,
    /// Open no browser
    #[arg(long)]
    pub no_open: bool,
    /// How much is said.
    #[command(flatten)]
    pub talk: TalkArguments,
    /// Memory, disk, threads.
    #[command(flatten)]
    pub resources: ResourceArguments,
}

/// Arguments of `render`.
#[derive(Debug, Args)]
pub struct RenderArguments {
    /// The mesh: .ply, .stl, .obj or .glb
    pub mesh: PathBuf,
    /// The picture: .png [default: the mesh's name with .png]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Width and height of the picture, in pixels
    #[arg(long, value_name = "SIZE", default_value = "1600x1200")]
    pub size: Size,
    /// Where it is seen from, one view or several on a sheet: iso, front, back, left, right, top, bottom, or the viewer's AZIMUTH:ELEVATION in degrees
    #[arg(long, value_name = "VIEWS", value_delimiter = ',', default_value = "iso", allow_hyphen_values = true)]
    pub views: Vec<View>,
    /// Which direction is up: x, y, z, -x, -y or -z
    #[arg(long, value_name = "AXIS", default_value = "z", allow_hyphen_values = true)]
    pub up: Up,
    /// Whether triangles are to show
    #[arg(long, value_enum, default_value_t)]
    pub shading: Shading,
    /// What colours tell: rgb (the vertices' own), none, height, or an attribute of vertices such as intensity, classification or distance; auto is rgb where there is
    /// some
    #[arg(long, value_name = "WHAT", default_value = "auto")]
    pub color_by: ColourBy,
    /// What is behind the mesh: white, grey, black, transparent, or a colour as in #f0f4f8
    #[arg(long, value_name = "COLOUR", default_value = "white")]
    pub background: Background,
    /// Leave out the legend below each view: a length, and the scale of colours
    #[arg(long)]
    pub no_legend: bool,
    /// Replace the picture if it exists
    #[arg(long)]
    pub overwrite: bool,
    /// How much is said.
    #[command(flatten)]
    pub talk: TalkArguments,
    /// Memory, disk, threads.
    #[command(flatten)]
    pub resources: ResourceArguments,
}

impl RenderArguments {
    /// What the picture is to show of a mesh whose coordinates are in `measure`.
    pub fn options(&self, measure: Option<Measure>) -> Options {
        Options {
            size: self.size,
            views: self.views.clone(),
            up: self.up,
            shading: self.shading,
            colour_by: self.color_by.clone(),
            background: self.background,
            legend: if self.no_legend { Legend::None } else { Legend::In(measure) },
        }
    }
}

impl CompareArguments {
    /// The job they describe.
    pub fn job(&self) -> compare::Job {
        compare::Job {
            mesh: self.mesh.clone(),
            reference: self.reference.clone(),
            kind: self.kind,
            input: coordinates_only(&self.layout),
            heatmap: self.heatmap.clone().map(|path| {
                let (max, overwrite) = (self.heatmap_max, overwrite(self.overwrite));
                let (max, unit) = (max.map(|max| max.value), max.and_then(|max| max.unit));
                compare::HeatMap { path, max, unit, overwrite, told: true }
            }),
            resources: self.resources.resources(),
        }
    }
}

impl SimplifyArguments {
    /// The job they describe.
    pub fn job(&self) -> SimplifyJob {
        let tolerance = self.tolerance.map(|tolerance| tolerance.value);
        let (max_triangles, keep_borders) = (self.max_triangles, self.keep_borders);
        let (keep_colours, move_vertices) = (self.keep_colours, self.move_vertices);
        SimplifyJob {
            mesh: self.mesh.clone(),
            output: self.output.clone(),
            overwrite: overwrite(self.overwrite),
            asked: Simplification { tolerance, max_triangles, keep_borders, keep_colours, move_vertices },
            unit: self.tolerance.and_then(|tolerance| tolerance.unit),
            unsound: self.unsound,
            unseen: self.no_intersections,
            resources: self.resources.resources(),
        }
    }
}

impl DensifyArguments {
    /// The job they describe.
    pub fn job(&self) -> densify::Job {
        densify::Job {
            mesh: self.mesh.clone(),
            cloud: self.cloud.clone(),
            input: coordinates_only(&self.layout),
            output: self.output.clone(),
            overwrite: overwrite(self.overwrite),
            resources: self.resources.resources(),
        }
    }
}
