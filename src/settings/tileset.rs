//! How a mesh becomes a tileset.

/// How a tileset is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TilesetOptions {
    /// Whether skirts hang from the tiles of coarser levels of open surfaces.
    pub skirts: bool,
}

impl Default for TilesetOptions {
    fn default() -> TilesetOptions {
        TilesetOptions { skirts: true }
    }
}
