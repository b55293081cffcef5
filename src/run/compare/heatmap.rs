//! The mesh coloured by its vertices' distances: a PLY file.
//!
//! Distances come in no order; they are sorted to ranges of vertices, and written range by range.

use std::io::{BufWriter, Write};
use std::path::PathBuf;
use std::str::FromStr;

use bytemuck::{Pod, Zeroable};

use super::figures::Figures;
use crate::error::{Error, Result};
use crate::format::ply::header_text::HeaderText;
use crate::format::write::Format;
use crate::mesh::MeshSource;
use crate::mesh::spool::FaceRecord;
use crate::nearest::room::Room;
use crate::points::Precision;
use crate::points::scalar::{Endian, Scalar};
use crate::points::unit::Unit;
use crate::render::scale;
use crate::storage::atomic_file::{AtomicFile, Overwrite};
use crate::storage::partitions::Partitions;

/// Elements of a job.
const PIECE: u64 = 1 << 15;

/// Colours from no distance to the largest, evenly: from dark to light, and from blue to yellow, which nearly everybody tells apart, in print without colours, too.
const SCALE: [[u8; 3]; 8] = [
    [38, 13, 76],
    [53, 52, 122],
    [44, 92, 139],
    [30, 128, 140],
    [42, 162, 122],
    [108, 193, 84],
    [188, 217, 52],
    [254, 238, 90],
];

/// The colour of vertices that have no distance.
const NOWHERE: [u8; 3] = [128; 3];

/// A heat map that is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatMap {
    /// The file, PLY.
    pub path: PathBuf,
    /// The distance that has the last colour; by default the least that 95 % of the vertices do not exceed.
    pub max: Option<Reach>,
    /// The unit of that distance, if it is a length and not in the reference's unit.
    pub unit: Option<Unit>,
    /// Whether it may replace a file.
    pub overwrite: Overwrite,
    /// Whether it is told where it went.
    pub told: bool,
}

/// A distance as it is typed: a length, or per cents of the longest side of the reference's box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reach {
    /// In the files' units.
    Length(f64),
    /// In per cent.
    Percent(f64),
}

impl FromStr for Reach {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Reach, String> {
        let (number, reach): (_, fn(f64) -> Reach) = match text.strip_suffix('%') {
            Some(number) => (number, Reach::Percent),
            None => (text, Reach::Length),
        };
        match number.trim().parse() {
            Ok(value) if f64::is_finite(value) && value > 0.0 => Ok(reach(value)),
            _ => {
                Err(format!("expected a length above 0, or per cents of the longest side such as 0.5%, found {text:?}"))
            }
        }
    }
}

impl Reach {
    /// In units.
    fn of(self, longest_side: f64) -> f64 {
        match self {
            Reach::Length(length) => length,
            Reach::Percent(percent) => longest_side * percent / 100.0,
        }
    }
}

/// A vertex's distance.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Told {
    vertex: u32,
    distance: f32,
}

/// The file in the making.
pub(super) struct Heat {
    file: AtomicFile,
    max: Option<Reach>,
    range: u64,
    told: Partitions<Told>,
}

impl Heat {
    /// Creates the temporary file.
    ///
    /// # Errors
    /// [`Error::Usage`] if it is not to be PLY; [`Error::OutputExists`]; [`Error::Io`].
    pub fn create(map: &HeatMap, mesh: &dyn MeshSource, room: &Room) -> Result<Heat> {
        if Format::from_path(&map.path)? != Format::Ply {
            return Err(Error::Usage(format!("{}: a heat map is a PLY file", map.path.display())));
        }
        let (count, limit) = (mesh.vertex_count(), i32::MAX as u64);
        if count > limit {
            return Err(Error::TooManyElements { count, what: "vertices", limit, carrier: "a PLY file" });
        }
        let file = AtomicFile::create(&map.path, map.overwrite)?;
        let range = (room.corners * room.in_flight as u64 / size_of::<f32>() as u64).max(1);
        // Few ranges, whose pages are small against those of blocks.
        Ok(Heat { file, max: map.max, range, told: room.partitions(count.div_ceil(range) as usize, 3) })
    }

    /// Adds a vertex's squared distance.
    ///
    /// # Errors
    /// [`Error::Io`] if the work directory is full.
    pub fn add(&mut self, vertex: u64, distance2: f64) -> Result<()> {
        let told = Told { vertex: vertex as u32, distance: distance2.sqrt() as f32 };
        self.told.push((vertex / self.range) as usize, &told)
    }

    /// Writes the file and gives it its name. Returns the distance that has the last colour.
    ///
    /// # Errors
    /// Errors of reading the mesh; [`Error::OutputExists`]; [`Error::Io`]; [`Error::Interrupted`].
    pub fn write(mut self, mesh: &dyn MeshSource, room: &Room, vertices: &Figures, longest_side: f64) -> Result<f64> {
        let typical = [vertices.p95, vertices.max].into_iter().find(|distance| *distance > 0.0);
        let max = self.max.map(|max| max.of(longest_side)).or(typical).unwrap_or(longest_side);
        let mut comments =
            vec![format!("asra-stream {}", env!("CARGO_PKG_VERSION")), format!("distance, coloured from 0 to {max}")];
        let [x, y, z] = mesh.origin();
        if [x, y, z] != [0.0; 3] {
            comments.push(format!("origin {x} {y} {z}"));
        }
        let (count, faces) = (mesh.vertex_count(), mesh.face_count());
        let colours = ["red", "green", "blue"].map(|name| (name, Scalar::U8));
        let header = HeaderText {
            endian: Endian::Little,
            comments,
            vertices: count,
            precision: mesh.precision(),
            attributes: colours.into_iter().chain([("distance", Scalar::F32)]).collect(),
            faces: Some(faces),
        };
        let path = self.file.path().to_path_buf();
        let mut out = BufWriter::with_capacity(1 << 16, self.file.file());
        let mut put = |bytes: &[u8]| out.write_all(bytes).map_err(Error::io(&path, "write the heat map"));
        put(header.to_string().as_bytes())?;
        let (mut distances, mut told) = (Vec::new(), Vec::new());
        for range in 0..self.told.count() {
            let first = range as u64 * self.range;
            distances.clear();
            distances.resize((count - first).min(self.range) as usize, f32::NAN);
            while self.told.take(range, &mut told)? {
                for Told { vertex, distance } in told.drain(..) {
                    distances[(u64::from(vertex) - first) as usize] = distance;
                }
            }
            let pieces: Vec<&[f32]> = distances.chunks(PIECE as usize).collect();
            let work = |piece: usize| vertices_of(mesh, first + piece as u64 * PIECE, pieces[piece], max);
            room.workers.in_order_range(room.in_flight, pieces.len(), work, |bytes| put(&bytes))?;
        }
        let work = |piece: usize| {
            let first = piece as u64 * PIECE;
            let mut piece = vec![[0; 3]; (faces - first).min(PIECE) as usize];
            mesh.read_faces(first, &mut piece)?;
            Ok(piece.into_iter().map(|face| FaceRecord::new(face.map(u32::to_le))).collect::<Vec<_>>())
        };
        room.workers.in_order_range(room.in_flight, faces.div_ceil(PIECE) as usize, work, |records| {
            put(bytemuck::cast_slice(&records))
        })?;
        out.flush().map_err(Error::io(&path, "write the heat map"))?;
        drop(out);
        self.file.finish()?;
        Ok(max)
    }
}

/// The bytes of vertices from `first` on, with their colours and distances.
fn vertices_of(mesh: &dyn MeshSource, first: u64, distances: &[f32], max: f64) -> Result<Vec<u8>> {
    let mut places = vec![[0.0; 3]; distances.len()];
    mesh.read_vertices(first, &mut places)?;
    let mut bytes = Vec::with_capacity(places.len() * 31);
    for (place, distance) in places.iter().zip(distances) {
        for c in place {
            match mesh.precision() {
                Precision::Single => bytes.extend_from_slice(&(*c as f32).to_le_bytes()),
                Precision::Double => bytes.extend_from_slice(&c.to_le_bytes()),
            }
        }
        bytes.extend(colour(f64::from(*distance) / max));
        bytes.extend_from_slice(&distance.to_le_bytes());
    }
    Ok(bytes)
}

/// The colour of a share of the largest distance.
fn colour(share: f64) -> [u8; 3] {
    if share.is_nan() {
        return NOWHERE;
    }
    scale::along(&SCALE, share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_grow_lighter_all_the_way() {
        let light = |share: f64| {
            let [r, g, b] = colour(share).map(f64::from);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        let steps: Vec<f64> = (0..=20).map(|i| light(f64::from(i) / 20.0)).collect();
        assert!(steps.windows(2).all(|pair| pair[1] - pair[0] > 4.0), "{steps:?}");
        assert_eq!([colour(-1.0), colour(0.0)], [[38, 13, 76]; 2]);
        assert_eq!([colour(1.0), colour(f64::INFINITY)], [[254, 238, 90]; 2]);
        assert_eq!(colour(f64::NAN), NOWHERE);
    }

    #[test]
    fn reaches_as_typed() {
        assert_eq!("0.5".parse(), Ok(Reach::Length(0.5)));
        assert_eq!("2 %".parse(), Ok(Reach::Percent(2.0)));
        assert_eq!(Reach::Percent(2.0).of(50.0), 1.0);
        for bad in ["", "%", "0", "-1", "inf", "1e", "x%"] {
            assert!(bad.parse::<Reach>().is_err(), "{bad}");
        }
    }
}
