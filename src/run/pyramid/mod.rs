//! A finished mesh as a tileset: levels of detail, cut into tiles.
//!
//! ```text
//!  mesh ─► in its place on Earth, single precision ─► levels ─► counts of cells ─► tree ─► each level's triangles by tile ─► GLB, tileset.json
//! ```
//!
//! A level is a whole mesh ([`levels`]), so the tiles of a level have the same vertices where they meet. The tree ([`tree`]) is a quadtree for surfaces
//! that are open, as terrain is, and an octree for closed ones. Nothing depends on threads or memory but how long it takes.
//!
//! A mesh whose reference system is known stands on Earth: every vertex goes to the east, north and up of the middle by itself, in metres, before anything else
//! is done, so that levels are as near in metres as they say, whatever the map's scale.

mod file;
mod levels;
mod normals;
mod tree;

pub use self::file::{TilesetJob, tileset_file};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use self::levels::{BLOCK, Extents, Level, WINDOW, coarser, copied, each_block, finite, widen};
use self::tree::{Counts, Division, MOST, Tree};
use crate::error::{Error, Result};
use crate::format::glb::write::{View, views};
use crate::format::tiles3d::tile::{Packing, Tile};
use crate::format::tiles3d::tileset::{self, Node};
use crate::format::tiles3d::{Lattice, TREE, is_named};
use crate::format::write::attributes::properties;
use crate::mesh::corners::Corners;
use crate::mesh::spool::MeshSpool;
use crate::mesh::{MeshHeader, MeshSource};
use crate::points::Precision;
use crate::points::crs::Crs;
use crate::points::earth::{Earth, Frame, Site};
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::run::saved_mesh::Means;
use crate::settings::tileset::{Compression, TilesetOptions};
use crate::storage::atomic_file::{Overwrite, WholeFolder};
use crate::storage::spool::Spool;

/// Bytes that a tile in the making takes, about: its triangles, vertices and file.
const TILE_BYTES: u64 = 16 << 20;
/// The least memory of what comes beside simplification: a tile, and the counts of cells, of all levels.
pub(super) const LEAST: u64 = TILE_BYTES + (12 << 20);
/// Places in other tiles that a block's triangles have, beyond which those that follow have none: triangles all across each other are no surface that could have a hole.
const MOST_NEAR: usize = 4 * BLOCK;
/// Unwanted vertices that are read along rather than skipped by a new read.
const GAP: u32 = 64;

/// A level of a tileset.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct LevelFigures {
    /// No place of the level's surface, or of the mesh's, is farther than this from the other.
    pub error: f64,
    /// Triangles.
    pub triangles: u64,
    /// Tiles.
    pub tiles: u64,
    /// Bytes of their files.
    pub bytes: u64,
}

/// What a tileset has.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct TilesetFigures {
    /// Where on Earth it stands, if that is known: lengths are then in metres, else in the mesh's units.
    pub site: Option<Site>,
    /// The levels, the finest first.
    pub levels: Vec<LevelFigures>,
    /// Bytes of all files.
    pub bytes: u64,
}

impl TilesetFigures {
    /// Tiles of all levels.
    pub fn tiles(&self) -> u64 {
        self.levels.iter().map(|level| level.tiles).sum()
    }
}

/// A tileset that is going to be.
#[derive(Debug)]
pub struct TilesetTarget {
    folder: WholeFolder,
    path: PathBuf,
    /// The mesh's reference system, and its way to the Earth.
    earth: Option<Box<(Crs, Earth)>>,
}

impl TilesetTarget {
    /// The folder of a tileset.
    ///
    /// # Errors
    /// [`Error::Usage`] if its name has none.
    pub fn folder(path: &Path) -> Result<&Path> {
        let parent = path.parent().filter(|parent| parent.file_name().is_some());
        parent.ok_or_else(|| {
            let path = path.display();
            Error::Usage(format!("{path}: a tileset needs a folder of its own; pass a name such as city/{TREE}"))
        })
    }

    /// Creates a temporary folder beside the tileset's own.
    ///
    /// # Errors
    /// Those of [`TilesetTarget::folder`] and [`WholeFolder::create`].
    pub fn prepare(path: &Path, overwrite: Overwrite) -> Result<TilesetTarget> {
        if !is_named(path) {
            return Err(Error::Usage(format!("{}: a tileset is named {TREE}, in a folder of its own", path.display())));
        }
        let folder = WholeFolder::create(TilesetTarget::folder(path)?, overwrite)?;
        Ok(TilesetTarget { folder, path: path.to_path_buf(), earth: None })
    }

    /// Sets the tileset on Earth, by the mesh's reference system. One without stays in the mesh's coordinates, as does one whose system is a site's own.
    ///
    /// # Errors
    /// Those of [`Earth::of`]; [`Error::InvalidSetting`] for an offset of heights without a reference system.
    pub fn georeference(&mut self, crs: Option<&Crs>, options: &TilesetOptions) -> Result<()> {
        match (crs.filter(|crs| !crs.is_local()), options.height_offset) {
            (Some(crs), offset) => self.earth = Some(Box::new((crs.clone(), Earth::of(crs, offset.unwrap_or(0.0))?))),
            (None, None) => (),
            (None, Some(_)) => {
                let words = "`height_offset`: the mesh has no reference system on Earth; name it with `crs`, as in `crs` EPSG:25832";
                return Err(Error::setting("height_offset", words.into()));
            }
        }
        Ok(())
    }

    /// Makes all levels and tiles of a mesh, writes them, and gives the folder its name. Of memory, as much as simplification needs is there at least.
    ///
    /// # Errors
    /// Those of simplification; [`Error::Io`]; [`Error::Interrupted`].
    pub fn write(
        mut self,
        mesh: &dyn MeshSource,
        header: &MeshHeader,
        options: &TilesetOptions,
        means: Means<'_>,
        progress: &mut Progress,
    ) -> Result<TilesetFigures> {
        let (finest, transform, site) = match &self.earth {
            Some(earth) => on_earth(mesh, header.origin, earth, &self.path, means)?,
            None => placed(mesh, header.origin, &self.path, means)?,
        };
        let extents = Extents::of(&finest, means)?;
        // What lifts the mesh is no part of the run that a folder is of.
        let lifted = options.height_offset.map_or(0, |offset| (offset + 0.0).to_bits());
        let coarser = coarser(&finest, &extents, &format!("level-{lifted:x}"), means, progress)?;
        let mut levels = vec![Level { mesh: finest, error: 0.0 }];
        levels.extend(coarser);

        let division = if header.sheet { Division::Quadtree } else { Division::Octree };
        let [low, high] = extents.bounds;
        let axes = if header.sheet { 2 } else { 3 };
        let side = (0..axes).map(|a| high[a] - low[a]).fold(f64::MIN_POSITIVE, f64::max);
        let smallest = |place| division.smallest(place, low, side);
        let code = |place| division.code(smallest(place));
        let counts =
            levels.iter().map(|level| counts(&level.mesh, division, code, means)).collect::<Result<Vec<_>>>()?;
        let tree = Tree::of(division, &counts);
        drop(counts);

        let views = views(&properties(&levels[0].mesh, header, means.workers)?);
        progress.begin(Phase::Write, Some(levels.iter().map(|level| level.mesh.face_count()).sum()));
        let mut nodes: Vec<Node> = (0..tree.tiles.len())
            .map(|number| Node {
                bounds: NOWHERE,
                error: levels[tree.tiles[number].level].error,
                content: None,
                children: tree.tiles[number].children.clone(),
            })
            .collect();
        let mut lattice = None;
        let mut figures = TilesetFigures { site, levels: Vec::new(), bytes: 0 };
        for (number, level) in levels.iter().enumerate() {
            let cut = Cut { level, tree: &tree, number, views: &views, options, sheet: header.sheet };
            let (made, on) = cut.write(smallest, lattice, (&mut self.folder, &mut nodes), means, progress)?;
            lattice = on;
            figures.bytes += made.bytes;
            figures.levels.push(made);
        }
        drop(levels);
        let root = joined(&mut nodes, tree.tops);
        let mut extras = json!({ "crs": header.crs, "comments": header.comments, "levels": figures.levels });
        if let Some(site) = &figures.site {
            extras["site"] = json!(site);
            extras["height_offset"] = json!(options.height_offset.unwrap_or(0.0));
        }
        let tree: Value = tileset::json(&nodes, root, transform, extras);
        let text = serde_json::to_vec(&tree).expect("numbers and text are JSON");
        put(&mut self.folder, TREE, &text)?;
        figures.bytes += text.len() as u64;
        self.folder.finish()?;
        Ok(figures)
    }
}

/// Writes a file of the folder.
fn put(folder: &mut WholeFolder, name: &str, bytes: &[u8]) -> Result<()> {
    let path = folder.within(name);
    std::fs::write(&path, bytes).map_err(Error::io(&path, "write"))
}

/// A mesh in its place, the transform that moves it to where it lies, and where on Earth that is.
type Placed = (MeshSpool, Option<[f64; 16]>, Option<Site>);

/// The mesh in single precision, east, north and up of its middle. Coordinates are those of vertices with `own` added.
fn on_earth(
    mesh: &dyn MeshSource,
    own: [f64; 3],
    (crs, earth): &(Crs, Earth),
    path: &Path,
    means: Means<'_>,
) -> Result<Placed> {
    let whole = |place: [f64; 3]| std::array::from_fn(|a| place[a] + own[a]);
    let [low, high] = bounds(mesh, path, means)?.map(whole);
    if let Some(expected) = crs.contradicted_by(low, high) {
        let words = format!(
            "`crs` {crs}: expects {expected}, but coordinates go from {low:?} to {high:?}; name the right one with `crs`, or `crs` none"
        );
        return Err(Error::setting("crs", words));
    }
    let frame = Frame::about(earth.centred(std::array::from_fn(|a| low[a].midpoint(high[a])))?);
    let place = |place: [f64; 3]| finite(frame.local(earth.centred(whole(place))?), path);
    let mesh = copied(mesh, place, means.memory / 16, means)?;
    Ok((mesh, Some(frame.transform()), Some(frame.site)))
}

/// The mesh in single precision about a middle; the transform adds `own`, too.
fn placed(mesh: &dyn MeshSource, own: [f64; 3], path: &Path, means: Means<'_>) -> Result<Placed> {
    let middle = match mesh.precision() {
        Precision::Single => [0.0; 3],
        Precision::Double => {
            let [low, high] = bounds(mesh, path, means)?;
            // In whole units: numbers that are written without loss.
            std::array::from_fn(|a| low[a].midpoint(high[a]).round())
        }
    };
    let place = |place: [f64; 3]| finite(std::array::from_fn(|a| place[a] - middle[a]), path);
    let mesh = copied(mesh, place, means.memory / 16, means)?;
    let origin: [f64; 3] = std::array::from_fn(|a| own[a] + middle[a]);
    let [x, y, z] = origin;
    let transform =
        (origin != [0.0; 3]).then_some([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, y, z, 1.0]);
    Ok((mesh, transform, None))
}

/// The box of all vertices.
fn bounds(mesh: &dyn MeshSource, path: &Path, means: Means<'_>) -> Result<[[f64; 3]; 2]> {
    let blocks = mesh.vertex_count().div_ceil(BLOCK as u64) as usize;
    let mut bounds = NOWHERE;
    let look = |number: usize| {
        let first = number as u64 * BLOCK as u64;
        let mut places = vec![[0.0; 3]; (mesh.vertex_count() - first).min(BLOCK as u64) as usize];
        mesh.read_vertices(first, &mut places)?;
        let mut bounds = NOWHERE;
        for place in places {
            widen(&mut bounds, [finite(place, path)?; 2]);
        }
        Ok(bounds)
    };
    means.workers.in_order_range(means.in_flight(), blocks, look, |more| {
        widen(&mut bounds, more);
        Ok(())
    })?;
    Ok(bounds)
}

/// The triangles of a mesh in each smallest cell.
fn counts(
    mesh: &MeshSpool,
    division: Division,
    code: impl Fn([f64; 3]) -> u32 + Sync,
    means: Means<'_>,
) -> Result<Counts> {
    let mut counts = vec![0u32; division.cells()];
    each_block(
        mesh,
        means,
        |faces| codes(mesh, faces, &code),
        |codes| {
            codes.iter().for_each(|code| counts[*code as usize] += 1);
            Ok(())
        },
    )?;
    Ok(Counts::of(&counts))
}

/// The codes of the cells that triangles' middles lie in.
fn codes(mesh: &MeshSpool, mut faces: Vec<[u32; 3]>, code: impl Fn([f64; 3]) -> u32) -> Result<Vec<u32>> {
    let mut corners = Corners::default();
    corners.fill(mesh, &mut faces, WINDOW)?;
    Ok(faces.iter().map(|face| code(middle(face.map(|v| corners.table[v as usize])))).collect())
}

fn middle([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    std::array::from_fn(|i| (a[i] + b[i] + c[i]) / 3.0)
}

/// The box that holds nothing.
const NOWHERE: [[f64; 3]; 2] = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];

/// A level's triangles by tile.
struct Sorted {
    spool: Spool,
    tiles: BTreeMap<usize, TileTriangles>,
}

/// A tile's triangles.
struct TileTriangles {
    /// Those with their middles in its cells.
    own: Vec<Stretch>,
    /// Others near its cells.
    others: Vec<Stretch>,
    /// How many others.
    count: u64,
    /// The box of all.
    bounds: [[f64; 3]; 2],
}

impl Default for TileTriangles {
    fn default() -> TileTriangles {
        TileTriangles { own: Vec::new(), others: Vec::new(), count: 0, bounds: NOWHERE }
    }
}

/// Where some triangles of a tile lie in a spool: the first's byte, and how many.
type Stretch = (u64, u32);

/// A level that is cut into tiles.
struct Cut<'a> {
    level: &'a Level,
    tree: &'a Tree,
    number: usize,
    views: &'a [View],
    options: &'a TilesetOptions,
    sheet: bool,
}

impl Cut<'_> {
    /// Writes the level's tiles, and notes what they hold. Compressed, they are on a lattice no finer than that of the level before.
    fn write(
        &self,
        smallest: impl Fn([f64; 3]) -> [u32; 3] + Sync,
        finer: Option<Lattice>,
        (folder, nodes): (&mut WholeFolder, &mut Vec<Node>),
        means: Means<'_>,
        progress: &mut Progress,
    ) -> Result<(LevelFigures, Option<Lattice>)> {
        let normals = normals::normals(&self.level.mesh, means)?;
        let Sorted { spool, tiles } = self.sorted(smallest, means)?;
        let skirts = self.options.skirts && self.sheet && self.number > 0;
        let lattice = (self.options.compress != Compression::None).then(|| {
            let hung = if skirts { 2.0 * self.level.error } else { 0.0 };
            let longest = |[low, high]: &[[f64; 3]; 2]| (0..3).map(|a| high[a] - low[a]).fold(0.0, f64::max) + hung;
            let farthest =
                |bounds: &[[f64; 3]; 2]| bounds.as_flattened().iter().fold(0.0, |m: f64, c| m.max(c.abs())) + hung;
            let most =
                |of: &dyn Fn(&[[f64; 3]; 2]) -> f64| tiles.values().map(|tile| of(&tile.bounds)).fold(0.0, f64::max);
            Lattice::of(most(&longest), most(&farthest), finer)
        });
        // What a lattice moves vertices by, it moves the surface by at the most.
        let error = lattice.map_or(self.level.error, |lattice| self.level.error + lattice.off());
        let packing = Packing { lattice, encoded: self.options.compress == Compression::Meshopt };
        // Where no cell can be divided any more, tiles of the finest level are cut by the order of their triangles.
        let mut all: Vec<(usize, [Vec<Stretch>; 2])> = Vec::new();
        for (tile, TileTriangles { own, mut others, .. }) in tiles {
            let count: u64 = own.iter().map(|(_, count)| u64::from(*count)).sum();
            if self.number > 0 || count <= MOST {
                all.push((tile, [own, others]));
                continue;
            }
            for (share, own) in shares(&own).into_iter().enumerate() {
                let number = if share == 0 { tile } else { nodes.len() };
                if share > 0 {
                    let sibling = nodes[tile].clone();
                    nodes.push(sibling);
                    if let Some(above) = nodes.iter_mut().find(|node| node.children.contains(&tile)) {
                        above.children.push(number);
                    }
                }
                // They are shown together.
                all.push((number, [own, std::mem::take(&mut others)]));
            }
        }
        let in_flight = (means.memory / 2 / TILE_BYTES).clamp(1, means.workers.threads() as u64 + 1) as usize;
        let stride = self.level.mesh.schema().stride();
        let make = |number: usize| {
            let (node, [own, others]) = &all[number];
            let mut tile = gathered(&self.level.mesh, &normals, &spool, [own, others])?;
            let triangles = tile.faces.len() as u64;
            if skirts && error > 0.0 {
                tile.hang_skirt(2.0 * error as f32, stride);
            }
            if let Some(lattice) = &packing.lattice {
                tile.snap(lattice);
            }
            if packing.encoded {
                tile.put_in_order(stride);
            }
            Ok((*node, tile.bounds(), triangles, tile.glb(self.views, stride, self.sheet, &packing)))
        };
        let mut figures = LevelFigures { error, triangles: 0, tiles: 0, bytes: 0 };
        means.workers.in_order_range(in_flight, all.len(), make, |(node, bounds, triangles, bytes)| {
            let name = format!("{}-{}.glb", self.number, figures.tiles);
            put(folder, &name, &bytes)?;
            nodes[node].bounds = bounds.map(|place| place.map(f64::from));
            nodes[node].content = Some(name);
            nodes[node].error = error;
            figures.tiles += 1;
            figures.triangles += triangles;
            figures.bytes += bytes.len() as u64;
            progress.add(triangles);
            Ok(())
        })?;
        Ok((figures, lattice))
    }

    /// All triangles by tile, those of a tile in the mesh's order.
    ///
    /// ```text
    ///        tile A | tile B
    ///     ---o------+--o------      A triangle across the border belongs to one of the tiles. The other has it, too, and all that come as near to its cells
    ///         \    |  |             as the level is from the mesh: whatever level stands beside it, there is no hole between them.
    ///          \---+--o
    /// ```
    fn sorted(&self, smallest: impl Fn([f64; 3]) -> [u32; 3] + Sync, means: Means<'_>) -> Result<Sorted> {
        let mut spool = means.workspace.spool(0);
        let mut tiles: BTreeMap<usize, TileTriangles> = BTreeMap::new();
        let places = self.tree.places(self.number);
        let mesh = &self.level.mesh;
        let sort = |faces: Vec<[u32; 3]>| {
            let (mut local, mut corners) = (faces.clone(), Corners::default());
            corners.fill(mesh, &mut local, WINDOW)?;
            let (mut entries, mut near) = (Vec::with_capacity(faces.len()), Vec::new());
            let mut boxes: BTreeMap<(usize, bool), [[f64; 3]; 2]> = BTreeMap::new();
            for (number, face) in local.iter().enumerate() {
                let corners = face.map(|v| corners.table[v as usize]);
                let own = places.tile(self.tree.division().code(smallest(middle(corners))));
                let bounds = corners.iter().fold(NOWHERE, |mut bounds, corner| {
                    widen(&mut bounds, [*corner; 2]);
                    bounds
                });
                let [low, high] = bounds;
                let error = self.level.error;
                near.clear();
                if entries.len() < faces.len() + MOST_NEAR {
                    places.within([smallest(low.map(|c| c - error)), smallest(high.map(|c| c + error))], &mut near);
                    near.sort_unstable();
                    near.dedup();
                }
                for tile in [own].into_iter().chain(near.iter().copied().filter(|tile| *tile != own)) {
                    let entry = (tile, tile != own);
                    entries.push((entry, number as u32));
                    widen(boxes.entry(entry).or_insert(NOWHERE), bounds);
                }
            }
            entries.sort_unstable();
            let sorted: Vec<[u32; 3]> = entries.iter().map(|(_, number)| faces[*number as usize]).collect();
            let runs = entries.chunk_by(|a, b| a.0 == b.0).map(|run| (run[0].0, run.len() as u32));
            Ok((sorted, runs.collect::<Vec<_>>(), boxes))
        };
        each_block(mesh, means, sort, |(sorted, runs, boxes)| {
            let mut at = spool.append(bytemuck::cast_slice(&sorted))?;
            for ((number, is_other), count) in runs {
                let tile = tiles.entry(number).or_default();
                let stretch = (at, count);
                at += u64::from(count) * size_of::<[u32; 3]>() as u64;
                if !is_other {
                    tile.own.push(stretch);
                } else if tile.count + u64::from(count) <= MOST {
                    tile.others.push(stretch);
                    tile.count += u64::from(count);
                } else {
                    // No more than a tile may have of its own.
                    continue;
                }
                widen(&mut tile.bounds, boxes[&(number, is_other)]);
            }
            Ok(())
        })?;
        Ok(Sorted { spool, tiles })
    }
}

/// Stretches in shares of as many triangles as a tile may have.
fn shares(stretches: &[Stretch]) -> Vec<Vec<Stretch>> {
    let mut out = vec![Vec::new()];
    let mut room = MOST;
    for (at, count) in stretches {
        let (mut at, mut left) = (*at, u64::from(*count));
        while left > 0 {
            if room == 0 {
                out.push(Vec::new());
                room = MOST;
            }
            let now = left.min(room);
            out.last_mut().expect("there is one").push((at, now as u32));
            at += now * size_of::<[u32; 3]>() as u64;
            left -= now;
            room -= now;
        }
    }
    out
}

/// A tile's own triangles, and others, with the vertices that they use, in the order of the mesh.
fn gathered(mesh: &MeshSpool, normals: &Spool, spool: &Spool, [own, others]: [&[Stretch]; 2]) -> Result<Tile> {
    let mut tile = Tile::default();
    for (at, count) in own.iter().chain(others) {
        let first = tile.faces.len();
        tile.faces.resize(first + *count as usize, [0; 3]);
        spool.read_at(*at, bytemuck::cast_slice_mut(&mut tile.faces[first..]))?;
    }
    let mut used: Vec<u32> = tile.faces.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    for v in tile.faces.as_flattened_mut() {
        *v = used.partition_point(|u| u < v) as u32;
    }
    let stride = mesh.schema().stride();
    let (mut places, mut across, mut records) = (Vec::new(), Vec::new(), Vec::new());
    let mut rest = &used[..];
    while let Some(&first) = rest.first() {
        let near = |pair: &[u32]| pair[1] - pair[0] <= GAP && ((pair[1] - first) as usize) < BLOCK;
        let (run, beyond) = rest.split_at(1 + rest.windows(2).take_while(|pair| near(pair)).count());
        rest = beyond;
        let (first, last) = (run[0], run[run.len() - 1]);
        let len = (last - first) as usize + 1;
        places.resize(len, [0.0; 3]);
        mesh.read_vertices(u64::from(first), &mut places)?;
        across.resize(len, [0f32; 3]);
        normals.read_at(u64::from(first) * normals::BYTES, bytemuck::cast_slice_mut(&mut across))?;
        records.resize(len * stride, 0);
        mesh.read_records(u64::from(first), &mut records)?;
        for at in run.iter().map(|v| (v - first) as usize) {
            tile.places.push(places[at].map(|c| c as f32));
            tile.normals.push(across[at]);
            tile.records.extend_from_slice(&records[at * stride..(at + 1) * stride]);
        }
    }
    let count: u64 = own.iter().map(|(_, count)| u64::from(*count)).sum();
    tile.overlap = tile.faces.split_off(count as usize);
    Ok(tile)
}

/// Makes boxes hold those below them, and one tree of all: the root's number.
fn joined(nodes: &mut Vec<Node>, tops: usize) -> usize {
    let tops: Vec<usize> = {
        let mut below = vec![false; nodes.len()];
        nodes.iter().flat_map(|node| &node.children).for_each(|child| below[*child] = true);
        (0..nodes.len()).filter(|node| *node < tops || !below[*node]).collect()
    };
    let root = match tops[..] {
        [only] => only,
        _ => {
            let error = tops.iter().map(|top| nodes[*top].error).fold(0.0, f64::max);
            nodes.push(Node { bounds: NOWHERE, error: 2.0 * error, content: None, children: tops });
            nodes.len() - 1
        }
    };
    hold(nodes, root);
    root
}

fn hold(nodes: &mut [Node], number: usize) -> [[f64; 3]; 2] {
    for child in nodes[number].children.clone() {
        let bounds = hold(nodes, child);
        widen(&mut nodes[number].bounds, bounds);
    }
    nodes[number].bounds
}
