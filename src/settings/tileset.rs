//! How a mesh becomes a tileset.

/// How a tileset is made.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct TilesetOptions {
    /// Whether skirts hang from the tiles of coarser levels of open surfaces.
    pub skirts: bool,
    /// Metres that are added to heights, where the mesh has a reference system: such as the geoid's height above the ellipsoid, which heights above the sea want.
    pub height_offset: Option<f64>,
}

impl Default for TilesetOptions {
    fn default() -> TilesetOptions {
        TilesetOptions { skirts: true, height_offset: None }
    }
}

impl TilesetOptions {
    /// The name of a setting that is not as by default, if there is one.
    pub fn first_set(&self) -> Option<&'static str> {
        match self {
            TilesetOptions { skirts: false, .. } => Some("no_skirts"),
            TilesetOptions { height_offset: Some(_), .. } => Some("height_offset"),
            _ => None,
        }
    }
}
