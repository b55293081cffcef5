//! Tiles: a mesh as one file for each square of the plane of x and y, or for each input, and an index.
//!
//! ```text
//!   city.tiles/            +---+---+     every triangle belongs to the square that its middle lies in. Triangles are not cut: where
//!     index.json           | . | ..|     tiles meet, both name the same vertices, which have the same bits in both, since all
//!     12_7.ply             +--/\---+     tiles have one origin
//!     13_7.ply             | /__\. |
//!                          +---+---+
//! ```
//!
//! Of a batch, the tile of an input has the triangles whose middles lie in the box of its points, or nearer to it than to the others' ([`super::territory`]).
//!
//! Triangles are sorted by tile, a block at a time, into temporary storage; then each tile is put together ([`super::part`]). The folder appears under its name
//! when it is whole.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use serde_json::json;

use super::part::{Stretch, part};
use super::territory::Territories;
use super::{Format, Overwrite, Positions, Target, Written};
use crate::error::words::short;
use crate::error::words::thousands;
use crate::error::{Error, Result};
use crate::mesh::measure::Corners;
use crate::mesh::spool::MeshSpool;
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
/// Vertices that a block's triangles may span for all of them to be read.
const WINDOW: usize = 1 << 16;
/// A tile: the whole numbers [y, x] of a square's lower corner, in sides; or 0 and the number of an input.
type Key = [i64; 2];

/// What a mesh is divided by.
#[derive(Debug)]
pub enum Division {
    /// Squares of this side, in the input's units.
    Squares(f64),
    /// What lies where each input's points do.
    Inputs(Territories),
}

impl Division {
    /// The setting that asks for it.
    fn setting(&self) -> &'static str {
        match self {
            Division::Squares(_) => "tile",
            Division::Inputs(_) => "batch",
        }
    }
}

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
    division: Division,
    folder: WholeFolder,
    positions: Positions,
}

impl Tiles {
    /// The folder that takes the place of the mesh file `output`: `city.tiles` for `city.ply`.
    pub fn path(output: &Path) -> PathBuf {
        output.with_extension("tiles")
    }

    /// Creates a temporary folder beside the tiles' own.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] for formats that cannot be tiles; [`Error::OutputExists`]; [`Error::Io`].
    pub fn prepare(output: &Path, division: Division, overwrite: Overwrite, positions: Positions) -> Result<Tiles> {
        let format = Format::from_path(output)?;
        if !matches!(format, Format::Ply | Format::Glb) {
            let setting = division.setting();
            return Err(Error::setting(
                setting,
                format!("`{setting}`: {} names no PLY or GLB files", output.display()),
            ));
        }
        let positions = Positions::of(output, Some(positions))?;
        let path = Self::path(output);
        let folder = WholeFolder::create(&path, overwrite)?;
        Ok(Tiles { format, division, folder, positions })
    }

    /// Changes the division, once the input's unit is known, or where its points lie.
    pub fn divide_by(&mut self, division: Division) {
        self.division = division;
    }

    /// Writes all tiles and their index, and gives the folder its name; returns the number of tiles, too. `memory` bounds what of a tile stays in memory; `progress` is told how many triangles are
    /// sorted, and written: in the end twice as many as there are.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if squares are so small that there are too many, or the memory too little for a tile's numbers; those of [`Target::fill`] and [`super::Filled::finish`].
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
        for (key, stretches) in tiles {
            workers.check_cancelled()?;
            let triangles: u64 = stretches.iter().map(|(_, count)| u64::from(*count)).sum();
            let tile = part(mesh, &spool, &stretches, memory, workspace)?.map_err(|needed| {
                let (setting, needed) = (self.division.setting(), bytesize::ByteSize(needed));
                let words = format!(
                    "`{setting}`: the numbers of a tile's vertices take {needed} of memory; make `max_memory` larger"
                );
                Error::setting(setting, words)
            })?;
            let (stem, mut entry) = self.named(key);
            let name = format!("{stem}.{}", if self.format == Format::Ply { "ply" } else { "glb" });
            let target = Target::within(&self.folder.within(&name), self.format, self.positions)?;
            let file = target.fill(&tile.mesh, header, workers, &mut |_| ())?.finish()?;
            written.bytes += file.bytes;
            done += triangles;
            progress(done);
            let [low, high] = tile.bounds.map(|p| [0, 1, 2].map(|a| p[a] + header.origin[a]));
            let vertices = tile.mesh.vertex_count();
            for (key, value) in [
                ("file", json!(name)),
                ("vertices", json!(vertices)),
                ("triangles", json!(triangles)),
                ("bytes", json!(file.bytes)),
                ("min", json!(low)),
                ("max", json!(high)),
            ] {
                entry[key] = value;
            }
            entries.push(entry);
        }
        let origin = if self.positions == Positions::Absolute { [0.0; 3] } else { header.origin };
        let count = entries.len() as u64;
        let mut index = json!({
            "version": 1, "origin": origin, "crs": header.crs, "comments": header.comments, "tiles": entries,
        });
        if let Division::Squares(side) = self.division {
            index["side"] = json!(side);
        }
        let path = self.folder.within(INDEX);
        let text = serde_json::to_vec_pretty(&index).expect("numbers and text are JSON");
        written.bytes += text.len() as u64;
        std::fs::File::create_new(&path)
            .and_then(|mut file| file.write_all(&text))
            .map_err(Error::io(&path, "write"))?;
        self.folder.finish()?;
        Ok((written, count))
    }

    /// The name of a tile's file without its extension, and how the index tells which it is.
    fn named(&self, [y, x]: Key) -> (String, serde_json::Value) {
        match &self.division {
            Division::Squares(_) => (format!("{x}_{y}"), json!({ "x": x, "y": y })),
            Division::Inputs(inputs) => {
                let input = inputs.of_number(x as usize);
                (input.stem.clone(), json!({ "input": input.path.to_string_lossy() }))
            }
        }
    }

    /// Sorts all triangles by tile, those of a tile in the mesh's order.
    fn sort(
        &self,
        mesh: &MeshSpool,
        header: &MeshHeader,
        workers: &Workers,
        workspace: &Workspace,
        progress: &mut dyn FnMut(u64),
    ) -> Result<(Spool, BTreeMap<Key, Vec<Stretch>>)> {
        let mut spool = workspace.spool(0);
        let mut tiles: BTreeMap<Key, Vec<Stretch>> = BTreeMap::new();
        let blocks = mesh.face_count().div_ceil(BLOCK as u64) as usize;
        let place = |number: usize| {
            let first = number as u64 * BLOCK as u64;
            let mut faces = vec![[0; 3]; (mesh.face_count() - first).min(BLOCK as u64) as usize];
            mesh.read_faces(first, &mut faces)?;
            let keys = self.keys(mesh, header, &faces)?;
            let mut order: Vec<u32> = (0..faces.len() as u32).collect();
            order.sort_by_key(|&i| keys[i as usize]);
            let sorted: Vec<[u32; 3]> = order.iter().map(|&i| faces[i as usize]).collect();
            let mut counts: Vec<(Key, u32)> = Vec::new();
            for key in order.iter().map(|&i| keys[i as usize]) {
                match counts.last_mut() {
                    Some((last, count)) if *last == key => *count += 1,
                    _ => counts.push((key, 1)),
                }
            }
            Ok((sorted, counts))
        };
        workers.in_order_range(workers.threads() + 1, blocks, place, |(sorted, counts)| {
            let mut at = spool.append(bytemuck::cast_slice(&sorted))?;
            progress(sorted.len() as u64);
            for (key, count) in counts {
                tiles.entry(key).or_default().push((at, count));
                at += u64::from(count) * size_of::<[u32; 3]>() as u64;
            }
            match self.division {
                Division::Squares(side) if tiles.len() as u64 > MOST_TILES => Err(Error::setting(
                    "tile",
                    format!(
                        "`tile` {side}: makes more than {} tiles, which is the limit; make tiles larger",
                        thousands(MOST_TILES)
                    ),
                )),
                _ => Ok(()),
            }
        })?;
        Ok((spool, tiles))
    }

    /// The tiles of the triangles' middles.
    fn keys(&self, mesh: &MeshSpool, header: &MeshHeader, faces: &[[u32; 3]]) -> Result<Vec<Key>> {
        let (mut local, mut corners) = (faces.to_vec(), Corners::default());
        corners.fill(mesh, &mut local, WINDOW)?;
        let middle = |face: &[u32; 3]| {
            let corners = face.map(|v| corners.table[v as usize]);
            [0, 1].map(|a| (corners[0][a] + corners[1][a] + corners[2][a]) / 3.0 + header.origin[a])
        };
        let middles = local.iter().map(middle);
        match &self.division {
            Division::Squares(side) => middles.map(|[x, y]| Ok([numbered(y, *side)?, numbered(x, *side)?])).collect(),
            Division::Inputs(inputs) => {
                let numbers = inputs.nearest(&middles.collect::<Vec<_>>());
                Ok(numbers.into_iter().map(|number| [0, number as i64]).collect())
            }
        }
    }
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
