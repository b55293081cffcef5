//! Tiles: a mesh as one file for each square of the plane of x and y, and an index.
//!
//! ```text
//!   city.tiles/            +---+---+     every triangle belongs to the square that its middle lies in. Triangles are not cut: where
//!     index.json           | . | ..|     tiles meet, both name the same vertices, which have the same bits in both, since all
//!     12_7.ply             +--/\---+     tiles have one origin
//!     13_7.ply             | /__\. |
//!                          +---+---+
//! ```
//!
//! Triangles are sorted by tile, a block at a time, into temporary storage; then each tile is put together in memory. The folder appears under its name
//! when it is whole.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use serde_json::json;

use super::{Format, Overwrite, Positions, Target, Written, attributes};
use crate::error::words::short;
use crate::error::words::thousands;
use crate::error::{Error, Result};
use crate::mesh::measure::Corners;
use crate::mesh::spool::{FaceRecord, MeshSpool};
use crate::mesh::{MeshHeader, MeshSource};
use crate::resources::workers::Workers;
use crate::storage::atomic_file::WholeFolder;
use crate::storage::spool::{Spool, Workspace};

/// The file of a folder of tiles that lists them.
pub const INDEX: &str = "index.json";

/// Triangles sorted at a time.
const BLOCK: usize = 1 << 15;
/// The most tiles: more files than that in one folder serve nobody.
pub const MOST_TILES: u64 = 100_000;
/// Bytes that a tile takes for each of its triangles while it is put together: corners (12, and 13 as they are written) and their keys (24); for half as
/// many vertices, places (24, twice), numbers (4) and records.
const PER_TRIANGLE: u64 = 49 + 26 + 16;
/// Vertices that a block's triangles may span for all of them to be read.
const WINDOW: usize = 1 << 16;
/// Vertices read at once where numbers have gaps: reading what is between costs less than another read.
const GAP: u32 = 64;

/// A square: the whole numbers of its lower corner, in sides.
type Square = [i64; 2];

/// Where triangles of a tile lie in the spool: the first's byte, and how many.
type Stretch = (u64, u32);

/// Refuses tiles that are too many by far.
///
/// # Errors
/// [`Error::InvalidSetting`], with the side that would do.
pub fn check_number(side: f64, tiles: u64) -> Result<()> {
    if tiles <= MOST_TILES {
        return Ok(());
    }
    let least = side * (tiles as f64 / MOST_TILES as f64).sqrt();
    // Rounded up to two digits.
    let step = libm::pow(10.0, libm::log10(least).floor() - 1.0);
    let (least, tiles, most) = (short((least / step).ceil() * step), thousands(tiles), thousands(MOST_TILES));
    Err(Error::setting(
        "tile",
        format!("`tile` {side}: makes about {tiles} tiles, and {most} is the limit; pass `tile` {least} or more"),
    ))
}

/// The number of the square that a coordinate lies in.
///
/// # Errors
/// [`Error::Usage`] if there are so many up to there that numbers do not tell them apart.
fn numbered(coordinate: f64, side: f64) -> Result<i64> {
    /// All whole numbers up to here are numbers of 64 bits.
    const MOST: f64 = (1u64 << 53) as f64;
    let number = (coordinate / side).floor();
    if number.abs() < MOST {
        return Ok(number as i64);
    }
    let (at, least) = (short(coordinate), short(coordinate.abs() / MOST * 2.0));
    Err(Error::Usage(format!("--tile {side}: is too small to number squares at {at}; pass --tile {least} or more")))
}

/// A folder of tiles that is going to be.
#[derive(Debug)]
pub struct Tiles {
    format: Format,
    side: f64,
    folder: WholeFolder,
    positions: Positions,
}

impl Tiles {
    /// The folder that takes the place of the mesh file `output`: `city.tiles` for `city.ply`.
    pub fn path(output: &Path) -> PathBuf {
        output.with_extension("tiles")
    }

    /// Creates a temporary folder beside the tiles' own, for squares of side `side`, in the input's units.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] for formats that cannot be tiles; [`Error::OutputExists`]; [`Error::Io`].
    pub fn prepare(output: &Path, side: f64, overwrite: Overwrite, positions: Positions) -> Result<Tiles> {
        let format = Format::from_path(output)?;
        if !matches!(format, Format::Ply | Format::Glb) {
            return Err(Error::setting("tile", format!("`tile`: {} names no PLY or GLB files", output.display())));
        }
        let positions = Positions::of(output, Some(positions))?;
        let path = Self::path(output);
        let folder = WholeFolder::create(&path, overwrite)?;
        Ok(Tiles { format, side, folder, positions })
    }

    /// Changes the side, once the input's unit is known.
    pub fn set_side(&mut self, side: f64) {
        self.side = side;
    }

    /// Writes all tiles and their index, and gives the folder its name; returns the number of tiles, too. `memory` bounds a tile; `progress` is told how many triangles are
    /// sorted, and written: in the end twice as many as there are.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if squares are so small that there are too many, or so large that one does not fit; those of [`Target::fill`] and [`super::Filled::finish`].
    pub fn write(
        mut self,
        mesh: &MeshSpool,
        header: &MeshHeader,
        memory: u64,
        workers: &Workers,
        workspace: &Workspace,
        progress: &mut dyn FnMut(u64),
    ) -> Result<(Written, u64)> {
        let mut done = 0;
        let (spool, tiles) = self.sort(mesh, header, workers, workspace, &mut |triangles| {
            done += triangles;
            progress(done);
        })?;
        let mut entries = Vec::new();
        let mut written = Written { bytes: 0 };
        // By y, then by x, as pictures are read.
        for ([y, x], stretches) in tiles {
            workers.check_cancelled()?;
            let triangles: u64 = stretches.iter().map(|(_, count)| u64::from(*count)).sum();
            if triangles * PER_TRIANGLE > memory {
                let needed = bytesize::ByteSize(triangles * PER_TRIANGLE);
                return Err(Error::setting(
                    "tile",
                    format!(
                        "`tile` {}: a tile has {triangles} triangles, which take {needed} of memory; make tiles smaller or `max_memory` larger",
                        self.side
                    ),
                ));
            }
            let tile = self.tile(mesh, &spool, &stretches, workspace)?;
            let name = format!("{x}_{y}.{}", if self.format == Format::Ply { "ply" } else { "glb" });
            let target = Target::within(&self.folder.within(&name), self.format, self.positions)?;
            let file = target.fill(&tile.mesh, header, workers, &mut |_| ())?.finish()?;
            written.bytes += file.bytes;
            done += triangles;
            progress(done);
            let [low, high] = tile.bounds.map(|p| [0, 1, 2].map(|a| p[a] + header.origin[a]));
            entries.push(json!({
                "file": name, "x": x, "y": y, "vertices": tile.mesh.vertex_count(), "triangles": triangles, "bytes": file.bytes,
                "min": low, "max": high,
            }));
        }
        let origin = if self.positions == Positions::Absolute { [0.0; 3] } else { header.origin };
        let count = entries.len() as u64;
        let index = json!({
            "version": 1, "side": self.side, "origin": origin, "crs": header.crs, "comments": header.comments, "tiles": entries,
        });
        let path = self.folder.within(INDEX);
        let text = serde_json::to_vec_pretty(&index).expect("numbers and text are JSON");
        written.bytes += text.len() as u64;
        std::fs::File::create_new(&path)
            .and_then(|mut file| file.write_all(&text))
            .map_err(Error::io(&path, "write"))?;
        self.folder.finish()?;
        Ok((written, count))
    }

    /// Sorts all triangles by tile, those of a tile in the mesh's order.
    fn sort(
        &self,
        mesh: &MeshSpool,
        header: &MeshHeader,
        workers: &Workers,
        workspace: &Workspace,
        progress: &mut dyn FnMut(u64),
    ) -> Result<(Spool, BTreeMap<Square, Vec<Stretch>>)> {
        let mut spool = workspace.spool(0);
        let mut tiles: BTreeMap<Square, Vec<Stretch>> = BTreeMap::new();
        let blocks = mesh.face_count().div_ceil(BLOCK as u64) as usize;
        let place = |number: usize| {
            let first = number as u64 * BLOCK as u64;
            let mut faces = vec![[0; 3]; (mesh.face_count() - first).min(BLOCK as u64) as usize];
            mesh.read_faces(first, &mut faces)?;
            let squares = self.squares(mesh, header, &faces)?;
            let mut order: Vec<u32> = (0..faces.len() as u32).collect();
            order.sort_by_key(|&i| squares[i as usize]);
            let sorted: Vec<[u32; 3]> = order.iter().map(|&i| faces[i as usize]).collect();
            let mut counts: Vec<(Square, u32)> = Vec::new();
            for square in order.iter().map(|&i| squares[i as usize]) {
                match counts.last_mut() {
                    Some((last, count)) if *last == square => *count += 1,
                    _ => counts.push((square, 1)),
                }
            }
            Ok((sorted, counts))
        };
        workers.in_order_range(workers.threads() + 1, blocks, place, |(sorted, counts)| {
            let mut at = spool.append(bytemuck::cast_slice(&sorted))?;
            progress(sorted.len() as u64);
            for (square, count) in counts {
                tiles.entry(square).or_default().push((at, count));
                at += u64::from(count) * size_of::<[u32; 3]>() as u64;
            }
            match tiles.len() as u64 {
                ..=MOST_TILES => Ok(()),
                _ => Err(Error::setting(
                    "tile",
                    format!(
                        "`tile` {}: makes more than {} tiles, which is the limit; make tiles larger",
                        self.side,
                        thousands(MOST_TILES)
                    ),
                )),
            }
        })?;
        Ok((spool, tiles))
    }

    /// The squares, as [y, x], of the triangles' middles.
    fn squares(&self, mesh: &MeshSpool, header: &MeshHeader, faces: &[[u32; 3]]) -> Result<Vec<Square>> {
        let (mut local, mut corners) = (faces.to_vec(), Corners::default());
        corners.fill(mesh, &mut local, WINDOW)?;
        let square = |face: &[u32; 3]| {
            let corners = face.map(|v| corners.table[v as usize]);
            let along = |a: usize| {
                let middle = (corners[0][a] + corners[1][a] + corners[2][a]) / 3.0 + header.origin[a];
                numbered(middle, self.side)
            };
            Ok([along(1)?, along(0)?])
        };
        local.iter().map(square).collect()
    }

    /// Puts a tile together.
    fn tile(&self, mesh: &MeshSpool, spool: &Spool, stretches: &[Stretch], workspace: &Workspace) -> Result<Tile> {
        let mut faces: Vec<[u32; 3]> = Vec::new();
        for (at, count) in stretches {
            let before = faces.len();
            faces.resize(before + *count as usize, [0; 3]);
            spool.read_at(*at, bytemuck::cast_slice_mut(&mut faces[before..]))?;
        }
        let mut corners = Corners::default();
        // No window: the vertices that are used, and no others, are numbered anew in their order.
        corners.fill(mesh, &mut faces, 0)?;
        let mut out = MeshSpool::with_attributes(workspace, mesh.precision(), mesh.schema().clone(), u64::MAX);
        out.append_vertices(&corners.table)?;
        let stride = mesh.schema().stride();
        if stride > 0 {
            for run in corners.numbers().chunk_by(|a, b| b - a <= GAP) {
                for run in run.chunks(BLOCK) {
                    let (first, last) = (run[0], run[run.len() - 1]);
                    let records = attributes::records(mesh, u64::from(first), (last - first) as usize + 1)?;
                    for v in run.iter().map(|v| (v - first) as usize) {
                        out.append_attributes(&records[v * stride..(v + 1) * stride])?;
                    }
                }
            }
        }
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for place in &corners.table {
            bounds[0] = [0, 1, 2].map(|a| bounds[0][a].min(place[a]));
            bounds[1] = [0, 1, 2].map(|a| bounds[1][a].max(place[a]));
        }
        let records: Vec<FaceRecord> = faces.iter().map(|face| FaceRecord::new(*face)).collect();
        out.append_faces(&records)?;
        Ok(Tile { mesh: out, bounds })
    }
}

/// One tile.
struct Tile {
    mesh: MeshSpool,
    /// The least and the greatest coordinates of its vertices.
    bounds: [[f64; 3]; 2],
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_side_that_is_advised_would_do() {
        assert!(check_number(1.0, MOST_TILES).is_ok());
        for (side, tiles) in [(0.01, 643_843), (2.0, 100_001), (1e-9, 1 << 60)] {
            let error = check_number(side, tiles).unwrap_err().to_string();
            let advised: f64 = error.split("pass `tile` ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
            let made = tiles as f64 * (side / advised).powi(2);
            assert!(made <= MOST_TILES as f64 && made > 0.8 * MOST_TILES as f64, "{error}");
        }
    }

    #[test]
    fn squares_that_numbers_do_not_tell_apart_are_refused() {
        assert_eq!(numbered(-0.5, 1e-12).unwrap(), -500_000_000_000);
        for (coordinate, side) in [(0.5, 1e-300), (-0.5, 1e-300), (5e6, 1e-12), (1.0, f64::MIN_POSITIVE)] {
            let error = numbered(coordinate, side).unwrap_err().to_string();
            let advised: f64 = error.split("pass --tile ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
            assert!(numbered(coordinate, advised).is_ok(), "{error}");
        }
    }
}
