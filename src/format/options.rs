//! What is said about files of points that they do not say themselves, and which of their points count.

use super::layout::Layout;
use crate::points::attribute::Wanted;
use crate::points::crs::Crs;
use crate::points::filter::Filter;
use crate::points::scalar::Endian;
use crate::points::seen_from::SeenFrom;

/// What the command line says about the input.
#[derive(Debug, Clone, Default)]
pub struct InputOptions {
    /// The record layout of raw files; other formats describe themselves. It takes the place of a side-car and of detection.
    pub layout: Option<Layout>,
    /// Bytes before the first record of raw files.
    pub skip_bytes: Option<u64>,
    /// Byte order of the numbers in raw files.
    pub endian: Option<Endian>,
    /// The attributes that are carried to the mesh.
    pub attributes: Wanted,
    /// What is read of points whether the mesh carries it or not.
    pub looked_at: &'static [&'static str],
    /// Which points count.
    pub filter: Filter,
    /// The coordinate reference system, whatever files say: `Some(None)` if there is none.
    pub crs: Option<Option<Crs>>,
    /// How folders are looked into.
    pub depth: Depth,
    /// Where points were scanned from.
    pub seen_from: SeenFrom,
}

/// How folders are looked into.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Depth {
    /// The files in them.
    #[default]
    Flat,
    /// Those in the folders in them, too, and so on. Hidden folders, links to folders and folders of tiles are left out.
    Recursive,
}
