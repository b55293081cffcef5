//! How a mesh becomes a tileset.

/// How tiles are made smaller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Compression {
    /// Not at all: what every reader takes.
    #[default]
    None,
    /// Places in 16 bits and normals in 8 (`KHR_mesh_quantization`).
    Quantize,
    /// That, encoded by meshoptimizer's codec (`EXT_meshopt_compression`).
    Meshopt,
}

/// How a tileset is made.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct TilesetOptions {
    /// Whether skirts hang from the tiles of coarser levels of open surfaces.
    pub skirts: bool,
    /// Metres that are added to heights, where the mesh has a reference system: such as the geoid's height above the ellipsoid, which heights above the sea want.
    pub height_offset: Option<f64>,
    /// How its tiles are made smaller.
    pub compress: Compression,
}

impl Default for TilesetOptions {
    fn default() -> TilesetOptions {
        TilesetOptions { skirts: true, height_offset: None, compress: Compression::None }
    }
}

impl TilesetOptions {
    /// The name of a setting that is not as by default, if there is one.
    pub fn first_set(&self) -> Option<&'static str> {
        match self {
            TilesetOptions { skirts: false, .. } => Some("no_skirts"),
            TilesetOptions { height_offset: Some(_), .. } => Some("height_offset"),
            TilesetOptions { compress: Compression::Quantize | Compression::Meshopt, .. } => Some("compress"),
            _ => None,
        }
    }
}
