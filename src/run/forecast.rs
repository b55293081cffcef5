//! Forecast: how much work the phases of a run are likely to be, from what is known so far: bytes at first, then points, then faces.
//!
//! The figures are nanoseconds on a machine of two processors, rounded; only their ratios count, as the run's own speed scales them. They are means over clouds
//! that differ by a factor of two and more, so that an estimate early in a run is a rough one.

use std::path::Path;

use crate::input::Cloud;
use crate::run::phase::{Forecast, Phase};

/// A byte of a packed file.
const UNPACK: f64 = 60.0;
/// A point in one pass over the input.
const SURVEY: f64 = 65.0;
/// A rehearsal, whose cells are as many for every cloud.
const REHEARSE: f64 = 400e6;
/// A point on its way to its bucket.
const BUCKET: f64 = 200.0;
/// A point out of its bucket.
const RASTER: f64 = 40.0;
/// A triangle, while cells are closed: all round, and below a surface that is open.
const SEAL: [f64; 2] = [1000.0, 150.0];
const REOPEN: f64 = 1000.0;
/// A triangle that is made, and a point that it may be fitted to.
const SURFACE: (f64, f64) = (1600.0, 400.0);
/// A point and a triangle, where distances between them are measured.
const BRIDGED: (f64, f64) = (250.0, 500.0);
/// A triangle that is simplified.
const SIMPLIFY: f64 = 5000.0;
/// A triangle that is checked.
const CHECK: f64 = 230.0;
/// A triangle that is drawn.
const RENDER: f64 = 250.0;
/// A triangle that is written: meanwhile the mesh was checked; after that; in tiles; and not at all.
const WRITE: [f64; 4] = [10.0, 80.0, 600.0, 0.0];

/// A triangle, a place, a distance and a coloured vertex of a comparison.
const COMPARE: [f64; 4] = [46.0, 8.0, 900.0, 66.0];
/// A point that is counted, and one that is written, as a cloud is made denser.
const DENSIFY: [f64; 2] = [5.0, 17.0];

/// Bytes of a point: packed, in text and in other files.
const BYTES: [u64; 3] = [6, 28, 20];

/// What is known of a run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Known {
    /// Bytes of packed files that are unpacked before all passes.
    pub packed: u64,
    /// Passes of the survey.
    pub passes: u64,
    /// Points.
    pub points: u64,
    /// Triangles of the mesh.
    pub triangles: u64,
    /// Whether the closing is rehearsed.
    pub rehearsed: bool,
    /// Whether points are counted by class and return.
    pub counted: bool,
    /// Whether a mesh is made at all, and not only the points looked at.
    pub whole: bool,
    /// Whether the surface is open.
    pub open: bool,
    /// Whether its distances from points are measured.
    pub bridged: bool,
    /// Whether it is simplified.
    pub simplified: bool,
    /// Whether the mesh is checked.
    pub checked: bool,
    /// Whether a picture is drawn.
    pub drawn: bool,
    /// How the mesh is written.
    pub write: Write,
}

/// How the mesh is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Write {
    /// While it is checked.
    Meanwhile,
    /// After that.
    #[default]
    After,
    /// In tiles.
    Tiles,
    /// It is not: it stays in memory.
    Not,
}

impl Known {
    /// The work of each phase.
    pub fn forecast(&self) -> Forecast {
        let [points, triangles] = [self.points, self.triangles].map(|n| n as f64);
        let if_so = |so: bool, work: f64| if so && self.whole { work } else { 0.0 };
        Forecast::new([
            (Phase::Unpack, UNPACK * self.packed as f64),
            (Phase::Survey, SURVEY * (self.passes as f64 * points)),
            (Phase::Count, if self.counted { SURVEY * points } else { 0.0 }),
            (Phase::Rehearse, if self.rehearsed { REHEARSE } else { 0.0 }),
            (Phase::Bucket, if_so(true, BUCKET * points)),
            (Phase::Raster, if_so(true, RASTER * points)),
            (Phase::Seal, if_so(true, SEAL[usize::from(self.open)] * triangles)),
            (Phase::Reopen, if_so(!self.open, REOPEN * triangles)),
            (Phase::Surface, if_so(true, surface(triangles, points))),
            (Phase::Bridged, if_so(self.bridged, BRIDGED.0 * points + BRIDGED.1 * triangles)),
            (Phase::Simplify, if_so(self.simplified, SIMPLIFY * triangles)),
            (Phase::Check, if_so(self.checked, CHECK * triangles)),
            (Phase::Render, if_so(self.drawn, RENDER * triangles)),
            (Phase::Write, if_so(true, WRITE[self.write as usize] * triangles)),
        ])
    }
}

/// What is known of a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Comparing {
    /// Bytes of a packed file.
    pub packed: u64,
    /// Triangles of the mesh, and of the reference.
    pub triangles: [u64; 2],
    /// Vertices of the mesh, and vertices or points of the reference.
    pub places: [u64; 2],
    /// Whether the reference has triangles.
    pub surface: bool,
    /// Whether the mesh is written with its distances as colours.
    pub coloured: bool,
}

impl Comparing {
    /// Distances that are measured: of centroids from points, and of all places; from a surface, of its centroids, and of the mesh's once more.
    pub fn distances(&self) -> u64 {
        let ([mesh, reference], [vertices, places]) = (self.triangles, self.places);
        mesh + vertices + places + if self.surface { mesh + reference } else { 0 }
    }

    /// The work of each phase.
    pub fn forecast(&self) -> Forecast {
        let [triangle, place, distance, vertex] = COMPARE;
        let both = |counts: [u64; 2]| counts.iter().sum::<u64>() as f64;
        Forecast::new([
            (Phase::Unpack, UNPACK * self.packed as f64),
            (Phase::Check, triangle * both(self.triangles)),
            (Phase::Survey, place * both(self.places)),
            (Phase::Compare, distance * self.distances() as f64),
            (Phase::Write, if self.coloured { vertex * self.places[0] as f64 } else { 0.0 }),
        ])
    }
}

/// The work of making a cloud of so many points, packed in so many bytes, denser by so many.
pub fn densify(packed: u64, points: u64, more: u64) -> Forecast {
    let [count, write] = DENSIFY;
    Forecast::new([
        (Phase::Unpack, UNPACK * packed as f64),
        (Phase::Survey, count * points as f64),
        (Phase::Write, write * (points + more) as f64),
    ])
}

/// The work of making triangles where there are so many points.
pub fn surface(triangles: f64, points: f64) -> f64 {
    SURFACE.0 * triangles + SURFACE.1 * points
}

/// Triangles of points of which nothing else is known.
pub fn triangles(points: u64) -> u64 {
    points / 2
}

/// Points of files of so many bytes, `packed` of them in packed files.
pub fn points(bytes: u64, packed: u64) -> u64 {
    packed / BYTES[0] + bytes.saturating_sub(packed) / BYTES[2]
}

/// Bytes of a file, of which nothing else is known: none of standard input.
pub fn bytes(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |there| there.len())
}

/// The records of a cloud, as its files say, or as their lengths let expect.
pub fn records(cloud: &Cloud) -> u64 {
    cloud.sources().iter().map(|source| source.records.unwrap_or(source.bytes / BYTES[1])).sum()
}
