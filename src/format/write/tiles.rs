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
//! The folder appears under its name when it is whole.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use serde_json::json;

use super::part::{Part, Stretch};
use super::tiling::{Division, Tiling, WrittenTile, each_record};
use super::{Overwrite, Positions, Target, Written};
use crate::error::{Error, Result};
use crate::mesh::spool::MeshSpool;
use crate::mesh::{MeshHeader, MeshSource};
use crate::resources::workers::Workers;
use crate::storage::atomic_file::WholeFolder;
use crate::storage::spool::{Spool, Workspace};

/// The file of a folder of tiles that lists them.
pub const INDEX: &str = "index.json";

/// Bytes copied at a time.
const PIECE: usize = 1 << 16;

/// A folder of tiles that is going to be.
#[derive(Debug)]
pub struct Tiles {
    tiling: Tiling,
    folder: WholeFolder,
}

impl Tiles {
    /// Creates a temporary folder beside the tiles' own.
    ///
    /// # Errors
    /// Those of [`Tiling::of`]; [`Error::OutputExists`]; [`Error::Io`].
    pub fn prepare(output: &Path, division: Division, overwrite: Overwrite, positions: Positions) -> Result<Tiles> {
        let tiling = Tiling::of(output, division, positions)?;
        let folder = WholeFolder::create(&Tiling::path(output), overwrite)?;
        Ok(Tiles { tiling, folder })
    }

    /// Changes the division, once the input's unit is known, or where its points lie.
    pub fn divide_by(&mut self, division: Division) {
        self.tiling.division = division;
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
        let (spool, tiles) =
            self.tiling.sort((mesh, header.origin), (0, 1), (workers, workspace), &mut |triangles| {
                done += triangles;
                progress(done);
            })?;
        let mut index = self.index(header)?;
        for (key, places) in tiles {
            workers.check_cancelled()?;
            let stretches: Vec<Stretch<'_>> =
                places.iter().map(|&(at, count)| Stretch { spool: &spool, at, count }).collect();
            let Part { mesh: tile, bounds } = self.tiling.part(mesh, &stretches, memory, workspace)?;
            let path = self.folder.within(&self.tiling.named(key).0);
            let target = Target::within(&path, self.tiling.format, self.tiling.positions)?;
            let bytes = target.fill(&tile, header, workers, &mut |_| ())?.finish()?.bytes;
            let counts = [tile.vertex_count(), tile.face_count()];
            index.add(&self.tiling, &WrittenTile { key, counts, bounds, bytes, at: 0, crc: 0 })?;
            done += tile.face_count();
            progress(done);
        }
        self.finish(index)
    }

    /// Takes the tiles that others have written ([`Tiling::write_apart`]), and does the rest. `progress` is told how many triangles there are in the files so far.
    ///
    /// # Errors
    /// The number of the run of tiles whose files are not what was written; [`Error::Io`].
    pub fn take(
        mut self,
        header: &MeshHeader,
        runs: &[[Spool; 2]],
        workers: &Workers,
        progress: &mut dyn FnMut(u64),
    ) -> Result<std::result::Result<(Written, u64), usize>> {
        let mut index = self.index(header)?;
        let mut bytes = vec![0; PIECE];
        let mut done = 0;
        for (number, [files, records]) in runs.iter().enumerate() {
            let mut tiles: Vec<WrittenTile> = Vec::new();
            each_record(records, |tile| tiles.push(tile))?;
            for tile in tiles {
                workers.check_cancelled()?;
                let path = self.folder.within(&self.tiling.named(tile.key).0);
                let mut out = File::create_new(&path).map_err(Error::io(&path, "create"))?;
                let mut hasher = crc32fast::Hasher::new();
                let (mut at, end) = (tile.at, tile.at.saturating_add(tile.bytes).min(files.len()));
                while at < end {
                    let now = (end - at).min(PIECE as u64) as usize;
                    files.read_at(at, &mut bytes[..now])?;
                    hasher.update(&bytes[..now]);
                    out.write_all(&bytes[..now]).map_err(Error::io(&path, "write"))?;
                    at += now as u64;
                }
                if u64::from(hasher.finalize()) != tile.crc {
                    return Ok(Err(number));
                }
                index.add(&self.tiling, &tile)?;
                done += tile.counts[1];
                progress(done);
            }
        }
        self.finish(index).map(Ok)
    }

    fn index(&mut self, header: &MeshHeader) -> Result<Index> {
        let mut head = json!({
            "version": 1, "origin": self.origin(header), "crs": header.crs, "comments": header.comments, "tiles": [],
        });
        if let Division::Squares(side) = self.tiling.division {
            head["side"] = json!(side);
        }
        Index::create(self.folder.within(INDEX), head, header.origin)
    }

    fn origin(&self, header: &MeshHeader) -> [f64; 3] {
        if self.tiling.positions == Positions::Absolute { [0.0; 3] } else { header.origin }
    }

    fn finish(self, index: Index) -> Result<(Written, u64)> {
        let done = index.finish()?;
        self.folder.finish()?;
        Ok(done)
    }
}

/// The index in the making: tiles are written as they come, so that those of 100,000 are never in memory together.
struct Index {
    out: BufWriter<File>,
    path: std::path::PathBuf,
    /// Before the first tile, and behind the last.
    text: [String; 2],
    origin: [f64; 3],
    tiles: u64,
    bytes: u64,
}

impl Index {
    /// An index that tells `head`, whose `tiles` are none yet.
    fn create(path: std::path::PathBuf, head: serde_json::Value, origin: [f64; 3]) -> Result<Index> {
        let out = BufWriter::new(File::create_new(&path).map_err(Error::io(&path, "write"))?);
        let text = serde_json::to_string_pretty(&head).expect("numbers and text are JSON");
        // Text has no line breaks, so this is the list itself.
        let (before, behind) = text.split_once("\n  \"tiles\": []").expect("the head has tiles");
        let text = [format!("{before}\n  \"tiles\": ["), format!("]{behind}")];
        let mut index = Index { out, path, text, origin, tiles: 0, bytes: 0 };
        index.put(&index.text[0].clone())?;
        Ok(index)
    }

    fn put(&mut self, text: &str) -> Result<()> {
        self.bytes += text.len() as u64;
        self.out.write_all(text.as_bytes()).map_err(Error::io(&self.path, "write"))
    }

    fn add(&mut self, tiling: &Tiling, tile: &WrittenTile) -> Result<()> {
        let (name, mut entry) = tiling.named(tile.key);
        let [low, high] = tile.bounds.map(|p| [0, 1, 2].map(|a| p[a] + self.origin[a]));
        let [vertices, triangles] = tile.counts;
        for (key, value) in [
            ("file", json!(name)),
            ("vertices", json!(vertices)),
            ("triangles", json!(triangles)),
            ("bytes", json!(tile.bytes)),
            ("min", json!(low)),
            ("max", json!(high)),
        ] {
            entry[key] = value;
        }
        let text = serde_json::to_string_pretty(&entry).expect("numbers and text are JSON").replace('\n', "\n    ");
        let comma = if self.tiles > 0 { "," } else { "" };
        self.put(&format!("{comma}\n    {text}"))?;
        self.tiles += 1;
        self.bytes += tile.bytes;
        Ok(())
    }

    /// The bytes of the index and of all tiles, and how many tiles there are.
    fn finish(mut self) -> Result<(Written, u64)> {
        if self.tiles > 0 {
            self.put("\n  ")?;
        }
        self.put(&self.text[1].clone())?;
        self.out.flush().map_err(Error::io(&self.path, "write"))?;
        Ok((Written { bytes: self.bytes }, self.tiles))
    }
}
