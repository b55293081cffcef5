//! How a mesh is divided into tiles: triangles are sorted by tile, a block at a time, and then each tile is put together ([`super::part`]).
//!
//! ```text
//!   one process    mesh ─► triangles by tile ─► one tile after the other
//!
//!   several        share 0 ─► sorted/0 ─┬► tiles/0    each share's triangles lie tile by tile in a file of its own; each run of tiles
//!                  share 1 ─► sorted/1 ─┤  tiles/1    takes what it needs of all of them, share by share, and so in the mesh's order
//!                  …          …        ─┘  …
//! ```

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek};
use std::ops::Range;
use std::path::{Path, PathBuf};

use bytemuck::Zeroable;
use bytesize::ByteSize;

use super::part::{Part, Stretch, part};
use super::territory::Territories;
use super::{Format, Positions, Target};
use crate::error::words::{short, thousands};
use crate::error::{Error, Result};
use crate::mesh::corners::Corners;
use crate::mesh::spool::MeshSpool;
use crate::mesh::{MeshHeader, MeshSource};
use crate::resources::workers::Workers;
use crate::storage::spool::{Spool, Workspace};

/// Triangles sorted at a time.
const BLOCK: usize = 1 << 15;
/// The most tiles: more files than that in one folder serve nobody.
pub const MOST_TILES: u64 = 100_000;
/// Vertices that a block's triangles may span for all of them to be read.
const WINDOW: usize = 1 << 16;
/// Bytes, or records, copied at a time.
const PIECE: usize = 1 << 16;

/// A tile: the whole numbers [y, x] of a square's lower corner, in sides; or 0 and the number of an input. Tiles come by y, then by x, as pictures are read.
pub type Key = [i64; 2];

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
    pub(super) fn setting(&self) -> &'static str {
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

/// A tile that is written: 112 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Zeroable, bytemuck::Pod)]
#[repr(C)]
pub struct WrittenTile {
    /// Which it is.
    pub key: Key,
    /// Its vertices and triangles.
    pub counts: [u64; 2],
    /// The box of its vertices, without the mesh's origin.
    pub bounds: [[f64; 3]; 2],
    /// Bytes of its file.
    pub bytes: u64,
    /// Where they begin in a file that holds those of several.
    pub at: u64,
    /// Their CRC-32.
    pub crc: u64,
}

/// Triangles of one tile in a share: 24 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Zeroable, bytemuck::Pod)]
#[repr(C)]
pub struct SortedTile {
    /// Which it is.
    pub key: Key,
    /// How many triangles of the share lie in it. They lie behind those of the tiles before.
    pub triangles: u64,
}

/// How a mesh becomes tiles.
#[derive(Debug)]
pub struct Tiling {
    pub(super) format: Format,
    pub(super) division: Division,
    pub(super) positions: Positions,
}

/// Where the triangles of each tile lie in a spool: first bytes, and how many.
type Places = BTreeMap<Key, Vec<(u64, u64)>>;

impl Tiling {
    /// Tiles of the format that an output's name tells.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] for formats that cannot be tiles.
    pub fn of(output: &Path, division: Division, positions: Positions) -> Result<Tiling> {
        let format = Format::from_path(output)?;
        if !matches!(format, Format::Ply | Format::Glb) {
            let (setting, path) = (division.setting(), output.display());
            return Err(Error::setting(setting, format!("`{setting}`: {path} names no PLY or GLB files")));
        }
        let positions = Positions::of(output, Some(positions))?;
        Ok(Tiling { format, division, positions })
    }

    /// The name of a tile's file, and how the index tells which it is.
    pub(super) fn named(&self, [y, x]: Key) -> (String, serde_json::Value) {
        let (stem, entry) = match &self.division {
            Division::Squares(_) => (format!("{x}_{y}"), serde_json::json!({ "x": x, "y": y })),
            Division::Inputs(inputs) => {
                let input = inputs.of_number(x as usize);
                (input.stem.clone(), serde_json::json!({ "input": input.path.to_string_lossy() }))
            }
        };
        (format!("{stem}.{}", if self.format == Format::Ply { "ply" } else { "glb" }), entry)
    }

    /// Sorts the triangles of a mesh at an origin by tile, those of a tile in the mesh's order: all of share number `share.0` of `share.1` equal ones. `progress` is told how many were sorted since it was told last.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if squares are so small that there are too many; those of reading the mesh; [`Error::Io`].
    pub(super) fn sort(
        &self,
        (mesh, origin): (&MeshSpool, [f64; 3]),
        share: (usize, usize),
        (workers, workspace): (&Workers, &Workspace),
        progress: &mut dyn FnMut(u64),
    ) -> Result<(Spool, Places)> {
        let mut spool = workspace.spool(0);
        let mut tiles = Places::new();
        let blocks = blocks(mesh, share);
        let place = |number: usize| {
            let first = (blocks.start + number) as u64 * BLOCK as u64;
            let mut faces = vec![[0; 3]; (mesh.face_count() - first).min(BLOCK as u64) as usize];
            mesh.read_faces(first, &mut faces)?;
            let keys = self.keys(mesh, origin, &faces)?;
            let mut order: Vec<u32> = (0..faces.len() as u32).collect();
            order.sort_by_key(|&i| keys[i as usize]);
            let sorted: Vec<[u32; 3]> = order.iter().map(|&i| faces[i as usize]).collect();
            let mut counts: Vec<(Key, u64)> = Vec::new();
            for key in order.iter().map(|&i| keys[i as usize]) {
                match counts.last_mut() {
                    Some((last, count)) if *last == key => *count += 1,
                    _ => counts.push((key, 1)),
                }
            }
            Ok((sorted, counts))
        };
        workers.in_order_range(workers.threads() + 1, blocks.len(), place, |(sorted, counts)| {
            let mut at = spool.append(bytemuck::cast_slice(&sorted))?;
            progress(sorted.len() as u64);
            for (key, count) in counts {
                tiles.entry(key).or_default().push((at, count));
                at += count * size_of::<[u32; 3]>() as u64;
            }
            self.check_number(tiles.len())
        })?;
        Ok((spool, tiles))
    }

    fn check_number(&self, tiles: usize) -> Result<()> {
        match self.division {
            Division::Squares(side) if tiles as u64 > MOST_TILES => {
                let most = thousands(MOST_TILES);
                let words =
                    format!("`tile` {side}: makes more than {most} tiles, which is the limit; make tiles larger");
                Err(Error::setting("tile", words))
            }
            _ => Ok(()),
        }
    }

    /// The tiles of the triangles' middles.
    fn keys(&self, mesh: &MeshSpool, origin: [f64; 3], faces: &[[u32; 3]]) -> Result<Vec<Key>> {
        let (mut local, mut corners) = (faces.to_vec(), Corners::default());
        corners.fill(mesh, &mut local, WINDOW)?;
        let middle = |face: &[u32; 3]| {
            let corners = face.map(|v| corners.table[v as usize]);
            [0, 1].map(|a| (corners[0][a] + corners[1][a] + corners[2][a]) / 3.0 + origin[a])
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

    /// Puts a tile together.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if the memory is too little for the numbers of its vertices; those of [`part`].
    pub(super) fn part(
        &self,
        mesh: &MeshSpool,
        of: &[Stretch<'_>],
        memory: u64,
        workspace: &Workspace,
    ) -> Result<Part> {
        part(mesh, of, memory, workspace)?.map_err(|needed| {
            let (setting, needed) = (self.division.setting(), ByteSize(needed));
            let words = format!(
                "`{setting}`: the numbers of a tile's vertices take {needed} of memory; make `max_memory` larger"
            );
            Error::setting(setting, words)
        })
    }

    /// Sorts the triangles of a share into `triangles`, tile by tile, and tells in `index` how many of each there are. Both are empty.
    ///
    /// # Errors
    /// Those of [`super::tiles::Tiles::write`].
    pub fn sort_apart(
        &self,
        (mesh, origin): (&MeshSpool, [f64; 3]),
        share: (usize, usize),
        [triangles, index]: [&mut Spool; 2],
        (workers, workspace): (&Workers, &Workspace),
        progress: &mut dyn FnMut(u64),
    ) -> Result<()> {
        let (spool, tiles) = self.sort((mesh, origin), share, (workers, workspace), progress)?;
        let mut bytes = Vec::new();
        for (key, places) in tiles {
            let count = places.iter().map(|(_, count)| count).sum();
            for (at, count) in places {
                copy(&spool, at..at + count * size_of::<[u32; 3]>() as u64, triangles, &mut bytes)?;
            }
            index.append(bytemuck::bytes_of(&SortedTile { key, triangles: count }))?;
        }
        Ok(())
    }

    /// Writes the tiles of run number `run.0` of `run.1` of about as many triangles, of which each share's lie in a spool, with its index. Files come one after the other into `files`,
    /// and what they are into `index`; both are empty.
    ///
    /// # Errors
    /// Those of [`super::tiles::Tiles::write`].
    pub fn write_apart(
        &self,
        (mesh, header): (&MeshSpool, &MeshHeader),
        (shares, run): (&[[Spool; 2]], (usize, usize)),
        [files, index]: [&mut Spool; 2],
        memory: u64,
        (workers, workspace): (&Workers, &Workspace),
        progress: &mut dyn FnMut(u64),
    ) -> Result<()> {
        let mut totals: BTreeMap<Key, u64> = BTreeMap::new();
        for [_, index] in shares {
            each_record(index, |tile: SortedTile| *totals.entry(tile.key).or_default() += tile.triangles)?;
            self.check_number(totals.len())?;
        }
        let keys = run_of(&totals, run);
        let mut tiles: BTreeMap<Key, Vec<Stretch<'_>>> = BTreeMap::new();
        for [spool, index] in shares {
            let mut at = 0;
            each_record(index, |SortedTile { key, triangles: count }| {
                if keys.contains(&key) {
                    tiles.entry(key).or_default().push(Stretch { spool, at, count });
                }
                at += count * size_of::<[u32; 3]>() as u64;
            })?;
        }
        let mut bytes = vec![0; PIECE];
        for (key, stretches) in tiles {
            workers.check_cancelled()?;
            let Part { mesh: tile, bounds } = self.part(mesh, &stretches, memory, workspace)?;
            let target = Target::aside(workspace, self.format, self.positions)?;
            let filled = target.fill(&tile, header, workers, &mut |_| ())?;
            let mut hasher = crc32fast::Hasher::new();
            let at = files.len();
            let failed = || Error::io(workspace.dir(), "read a temporary file");
            let mut file: &File = filled.file();
            file.rewind().map_err(failed())?;
            loop {
                let read = file.read(&mut bytes).map_err(failed())?;
                if read == 0 {
                    break;
                }
                hasher.update(&bytes[..read]);
                files.append(&bytes[..read])?;
            }
            let counts = [tile.vertex_count(), tile.face_count()];
            let crc = u64::from(hasher.finalize());
            let written = WrittenTile { key, counts, bounds, bytes: files.len() - at, at, crc };
            index.append(bytemuck::bytes_of(&written))?;
            progress(tile.face_count());
        }
        Ok(())
    }

    /// The folder that takes the place of the mesh file `output`: `city.tiles` for `city.ply`.
    pub fn path(output: &Path) -> PathBuf {
        output.with_extension("tiles")
    }
}

/// The blocks of triangles of share number `share.0` of `share.1`.
fn blocks(mesh: &MeshSpool, (number, of): (usize, usize)) -> Range<usize> {
    let blocks = mesh.face_count().div_ceil(BLOCK as u64) as usize;
    let end = |number: usize| (blocks as u128 * number as u128 / of as u128) as usize;
    end(number)..end(number + 1)
}

/// From the first tile of a run to behind its last: runs have about as many triangles, and each tile is in one of them.
fn run_of(totals: &BTreeMap<Key, u64>, (number, of): (usize, usize)) -> Range<Key> {
    let all: u64 = totals.values().sum();
    let mut before = 0;
    let begins = totals.iter().map(|(key, count)| {
        let run = (u128::from(before) * of as u128 / u128::from(all.max(1))) as usize;
        before += count;
        (*key, run)
    });
    let behind = [i64::MAX; 2];
    let mut keys = behind..behind;
    for (key, run) in begins {
        if run == number && keys.start == behind {
            keys.start = key;
        }
        if run > number {
            keys.end = key;
            break;
        }
    }
    keys
}

/// Reads all records of a spool, some at a time.
///
/// # Errors
/// Those of [`Spool::read_at`].
pub(super) fn each_record<R: bytemuck::Pod>(spool: &Spool, mut visit: impl FnMut(R)) -> Result<()> {
    let size = size_of::<R>() as u64;
    let mut records = Vec::new();
    let mut at = 0;
    while at < spool.len() {
        let now = ((spool.len() - at) / size).min((PIECE / size_of::<R>()) as u64);
        records.resize(now as usize, R::zeroed());
        spool.read_at(at, bytemuck::cast_slice_mut(&mut records))?;
        records.iter().copied().for_each(&mut visit);
        at += now * size;
    }
    Ok(())
}

/// Copies a stretch of a spool behind another's bytes.
fn copy(from: &Spool, stretch: Range<u64>, to: &mut Spool, bytes: &mut Vec<u8>) -> Result<()> {
    let mut at = stretch.start;
    while at < stretch.end {
        bytes.resize((stretch.end - at).min(PIECE as u64) as usize, 0);
        from.read_at(at, bytes)?;
        to.append(bytes)?;
        at += bytes.len() as u64;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

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

    proptest! {
        /// Runs hold every tile once, in order.
        #[test]
        fn runs_hold_every_tile_once(
            totals in prop::collection::btree_map(prop::array::uniform2(-9i64..9), 1u64..1000, 1..60),
            of in 1usize..12,
        ) {
            let mut held = Vec::new();
            for number in 0..of {
                let run = run_of(&totals, (number, of));
                held.extend(totals.keys().copied().filter(|key| run.contains(key)));
            }
            prop_assert_eq!(held, totals.keys().copied().collect::<Vec<_>>());
        }
    }
}
