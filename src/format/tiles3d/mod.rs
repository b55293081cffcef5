//! 3D Tiles 1.1: a tree of tiles in `tileset.json`, and a GLB file for each tile.
//!
//! ```text
//!   city/tileset.json      the tree: boxes, geometric errors, names of files; refinement by replacement
//!   city/2-0.glb           level 2: the coarsest mesh, in one tile
//!   city/1-0.glb ...       level 1
//!   city/0-0.glb ...       level 0: the mesh itself
//! ```
//!
//! The tileset has z up, and glTF y; the node of every tile turns its content, and readers turn it back. Places of vertices are single precision about the
//! tileset's middle, and the same in all tiles, so that tiles of a level meet to the last bit. The root's `transform` moves the middle to where it lies:
//! to the Earth's surface, or to the coordinates that the mesh had. Compressed tiles have whole numbers of steps of the level's lattice ([`Lattice`]).

mod pack;
pub mod tile;
pub mod tileset;

pub use self::pack::Lattice;

/// The name that a tileset's tree has.
pub const TREE: &str = "tileset.json";

/// Whether a path names a tileset: a file `tileset.json`, in whatever case.
pub fn is_named(path: &std::path::Path) -> bool {
    path.file_name().is_some_and(|name| name.eq_ignore_ascii_case(TREE))
}
