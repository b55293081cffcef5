//! The cloud, and how it is meshed: arguments of all commands that reconstruct, or tell what a reconstruction would be.

use std::path::PathBuf;
use std::sync::Arc;

use clap::{Args, ValueEnum};

use super::shared::{InUnit, in_unit};
use super::values::{bounds, cell_size, height, positive, sealing};
use crate::cli::sizes;
use crate::error::{Error, Result};
use crate::grid::CELLS_LIMIT;
use crate::input::{Depth, Filter, InputOptions, Layout, Returns, Withheld, tells_stations};
use crate::points::attribute::Wanted;
use crate::points::bounds::{Axis, Bounds};
use crate::points::clip::Clip;
use crate::points::crs::Crs;
use crate::points::scalar::Endian;
use crate::points::seen_from::SeenFrom;
use crate::run::{Job, Resources, Units};
use crate::settings::closing::{Least, Sealing};
use crate::settings::ground::Classes;
use crate::settings::open::{Facing, Hole, Kind, Open};
use crate::settings::simplification::{Borders, Simplification, Tolerance};
use crate::settings::surface::{Diagonals, Fit, SurfaceOptions};
use crate::settings::{AxisChoice, Fineness, Resolution, Settings};

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
    /// The coordinate reference system, whatever the files say: EPSG:25832, WKT, a file with WKT, or none. Nothing is reprojected but a tileset
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
    /// Take points within the polygons of this file only, GeoJSON or WKT, in the input's coordinates; those on the boundary, too
    #[arg(long, value_name = "FILE", help_heading = "Input")]
    pub clip: Option<PathBuf>,
    /// Take points that are marked as withheld, too
    #[arg(long, help_heading = "Input")]
    pub keep_withheld: bool,
    /// Slices for each cube root of the number of points; without it, cells are up to half as wide as by 4 where points are dense and clean, and no finer than with `--cell-size auto` [default: 4]
    #[arg(long, value_name = "K", value_parser = positive, allow_negative_numbers = true, help_heading = "Grid")]
    #[arg(conflicts_with_all = ["slices", "cell_size"])]
    pub k: Option<f64>,
    /// Number of slices, instead of --k
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u32).range(1..=i64::from(CELLS_LIMIT)))]
    #[arg(allow_negative_numbers = true, help_heading = "Grid", conflicts_with = "cell_size")]
    pub slices: Option<u32>,
    /// Side of a cell, in the input's units or as in 5cm, or `auto`: 1.25 sampling distances (1 for terrain and ground, less for forests), the default of open surfaces; instead of --k
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
    /// Whether places of the surface are added between points that are too sparse for the shape: up to 5,000 points, if the cells are those by default and leave the mesh unsealed or hardly tell its walls apart
    #[arg(
        long,
        value_enum,
        default_value_t,
        value_name = "auto|off",
        hide_possible_values = true,
        help_heading = "Surface"
    )]
    pub upsample: UpsampleWord,
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
    /// Where points were scanned from, so that what lies in between is empty: a file with lines such as 3 0.5 1.25 -2, the number of a scan (as points have it in their attribute scan, or
    /// point_source_id) and its position; a position of all, such as @2,0.5,1; or none [default: the positions that E57 files tell]
    #[arg(long, value_name = "FILE|@X,Y,Z|none", help_heading = "Surface")]
    pub seen_from: Option<PathBuf>,
    /// The widest hole that is bridged in a sheet or terrain, a length as in 2.5 or 3m, or cells as in `8c` [default: 16c]
    #[arg(long, value_name = "WIDTH", value_parser = in_unit::<Hole>, allow_negative_numbers = true, help_heading = "Surface")]
    pub max_hole: Option<InUnit<Hole>>,
    /// Close terrain into a body with a flat bottom at this height, such as 120 or -3m
    #[arg(long, value_name = "Z", value_parser = height, allow_hyphen_values = true, help_heading = "Surface")]
    pub base: Option<InUnit<f64>>,
    /// What tells the ground of --surface ground: classes, such as 2,9; a filter (none); or classes 2 and 9 where any point has class 2, else the filter (auto)
    #[arg(long, value_name = "auto|none|LIST", help_heading = "Surface")]
    pub classes: Option<Classes>,
    /// Steps of smoothing: the first is the paper's, those after it do not shrink the surface
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Surface")]
    pub smooth: u32,
    /// Which diagonal cuts a rectangle into triangles
    #[arg(long, value_enum, default_value_t, help_heading = "Surface")]
    pub diagonals: Diagonals,
    /// What vertices are moved onto; the summary says so where points turn out to be noisy
    #[arg(long, value_enum, default_value_t, help_heading = "Surface")]
    pub fit: Fit,
    /// Give vertices their distance from the nearest point, as the attribute `bridged`: large where the surface bridges what was not scanned
    #[arg(long, help_heading = "Surface")]
    pub bridged: bool,
    /// Leave out triangles with a vertex farther than D from any point: a length (plain, or with a unit as in 5cm), cells as in 3c, or per cents of the longest side as in 1%. The surface is open
    /// there, that of a body, too
    #[arg(long, value_name = "D", value_parser = in_unit::<Tolerance>, allow_negative_numbers = true, help_heading = "Surface")]
    pub trim: Option<InUnit<Tolerance>>,
    /// How many triangles are left.
    #[command(flatten)]
    pub simplification: SimplificationArguments,
}

/// How many triangles are left.
#[derive(Debug, Args)]
pub struct SimplificationArguments {
    /// Leave out triangles as long as no place of either surface is farther than E from the other: a length (plain, or with a unit as in 5cm), cells as in 0.25c, or
    /// per cents of the longest side as in 0.01%
    #[arg(long, value_name = "E", value_parser = in_unit::<Tolerance>, allow_negative_numbers = true, help_heading = "Surface")]
    pub simplify: Option<InUnit<Tolerance>>,
    /// Leave at most so many triangles: with the least tolerance that does, or, within --simplify E, those that matter most
    #[arg(long, value_name = "N", value_parser = sizes::count, help_heading = "Surface")]
    pub max_triangles: Option<u64>,
    /// What triangles are not joined across as they are left out: classes, where points have some
    #[arg(long, value_enum, default_value_t, value_name = "WHAT", help_heading = "Surface")]
    pub keep_borders: Borders,
    /// How much any channel of a colour may change anywhere as triangles are left out, in steps of 255, where points have colours [default: as much as it may]
    #[arg(long, value_name = "STEPS", help_heading = "Surface")]
    pub keep_colours: Option<u8>,
    /// Place vertices anew as triangles are left out, where that keeps nearer to the surface, with attributes between those that were there
    #[arg(long, help_heading = "Surface")]
    pub move_vertices: bool,
}

impl SimplificationArguments {
    /// What is asked of a reconstruction.
    fn asked(&self) -> Option<Simplification> {
        let tolerance = self.simplify.map(|tolerance| tolerance.value);
        let (max_triangles, keep_borders) = (self.max_triangles, self.keep_borders);
        let is_asked = tolerance.is_some() || max_triangles.is_some();
        let (keep_colours, move_vertices) = (self.keep_colours, self.move_vertices);
        is_asked.then_some(Simplification { tolerance, max_triangles, keep_borders, keep_colours, move_vertices })
    }
}

/// Whether places are added, as typed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum UpsampleWord {
    /// Where points are too sparse.
    #[default]
    Auto,
    /// Never.
    Off,
}

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
    /// Bare earth, seen from above: the points on the ground alone.
    Ground,
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
            SurfaceWord::Terrain | SurfaceWord::Ground => {
                let usual = if self.surface == SurfaceWord::Ground { Open::GROUND } else { Open::TERRAIN };
                match self.facing {
                    None | Some(Facing::UP) => Ok(Some(Open { max_hole, base, ..usual })),
                    Some(_) => wrong("--facing: terrain is seen from +z; --surface sheet is for other directions"),
                }
            }
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
        let surface =
            SurfaceOptions { smooth: self.smooth, diagonals: self.diagonals, fit: self.fit, slab_slices: None };
        let (min_points, min_component) = (self.min_points, Some(self.min_component));
        let (seal, window, open) = (self.seal.value, self.window, self.open()?);
        let (keep_outliers, simplify) = (self.keep_outliers, self.simplification.asked());
        let upsample = self.upsample == UpsampleWord::Auto;
        let classes = self.classes.unwrap_or_default();
        let (bridged, trim) = (self.bridged, self.trim.map(|distance| distance.value));
        Ok(Settings {
            fineness,
            axis,
            seal,
            window,
            keep_outliers,
            upsample,
            min_points,
            min_component,
            surface,
            open,
            classes,
            bridged,
            trim,
            simplify,
        })
    }

    /// Where points were scanned from.
    fn seen_from(&self) -> Result<SeenFrom> {
        let Some(given) = &self.seen_from else { return Ok(SeenFrom::AsTold) };
        if self.surface != SurfaceWord::Closed {
            return Err(Error::Usage(
                "--seen-from: is for closed surfaces; --facing says where a sheet was seen from".into(),
            ));
        }
        match given.to_str() {
            Some("none") => Ok(SeenFrom::Unknown),
            Some(place) if place.starts_with('@') => match place.parse() {
                Ok(Facing::Position(place)) => Ok(SeenFrom::Place(place)),
                _ => Err(Error::Usage(format!("--seen-from: expected a position such as @2,0.5,1, found {place:?}"))),
            },
            _ => SeenFrom::read(given),
        }
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
            trim: self.trim.and_then(|distance| distance.unit),
            simplify: self.simplification.simplify.and_then(|tolerance| tolerance.unit),
            raster_size: None,
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
            clip: self.clip.as_deref().map(Clip::read).transpose()?.map(Arc::new),
            withheld: if self.keep_withheld { Withheld::Kept } else { Withheld::Dropped },
        };
        let seen_from = self.seen_from()?;
        let (layout, skip_bytes, attributes) = (self.layout.clone(), self.skip_bytes, self.attributes.clone());
        let crs = self.crs.as_deref().map(Crs::given).transpose()?;
        Ok(InputOptions {
            layout,
            skip_bytes,
            endian,
            attributes,
            filter,
            crs,
            looked_at: &[],
            depth: self.depth(),
            seen_from,
        })
    }

    /// The job of these, with what else a command says of it by default.
    ///
    /// # Errors
    /// [`Error::Usage`] for options that contradict each other.
    pub fn job(&self, resources: Resources) -> Result<Job> {
        let (input, settings, units) = (self.input()?, self.settings()?, self.units());
        Ok(Job { input, settings, units, resources, ..Job::new(&self.inputs) })
    }
}
