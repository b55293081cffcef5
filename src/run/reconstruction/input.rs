//! Settings of what goes in: which points count, what they carry, how files are read.

use std::path::PathBuf;

use super::Reconstruction;
use crate::format::options::Depth;
use crate::input::{Layout, Returns, Withheld};
use crate::points::attribute::Wanted;
use crate::points::bounds::Bounds;
use crate::points::crs::Crs;
use crate::points::scalar::Endian;
use crate::points::seen_from::SeenFrom;

impl Reconstruction<'_> {
    /// Leaves out points of these classes.
    pub fn drop_class(mut self, classes: &[u8]) -> Self {
        self.job.input.filter.drop_class = classes.to_vec();
        self
    }

    /// Takes points of these classes only.
    pub fn keep_class(mut self, classes: &[u8]) -> Self {
        self.job.input.filter.keep_class = classes.to_vec();
        self
    }

    /// Takes the first return of every pulse only.
    pub fn first_return(mut self) -> Self {
        self.job.input.filter.returns = Returns::First;
        self
    }

    /// Takes the last return of every pulse only.
    pub fn last_return(mut self) -> Self {
        self.job.input.filter.returns = Returns::Last;
        self
    }

    /// Takes points within this box only, its faces included.
    pub fn bounds(mut self, bounds: Bounds) -> Self {
        self.job.input.filter.bounds = Some(bounds);
        self
    }

    /// Takes points within the polygons of this file only, GeoJSON or WKT, in the input's coordinates; those on the boundary, too.
    pub fn clip(mut self, path: impl Into<PathBuf>) -> Self {
        self.clip = Some(path.into());
        self
    }

    /// Takes points that are marked as withheld, too.
    pub fn keep_withheld(mut self) -> Self {
        self.job.input.filter.withheld = Withheld::Kept;
        self
    }

    /// Which attributes are carried to the mesh, by whatever names files call them, `rgb` for all three: all by default, none of an empty slice.
    pub fn attributes(mut self, names: &[&str]) -> Self {
        match names {
            [] => self.job.input.attributes = Wanted::None,
            _ => match Wanted::named(names.iter().copied()) {
                Ok(wanted) => self.job.input.attributes = wanted,
                Err(error) => self.refuse(&error),
            },
        }
        self
    }

    /// Where points were scanned from: as E57 files tell by default. What lies between a point and that place is empty, so that it is outside of a closed surface.
    pub fn seen_from(mut self, places: SeenFrom) -> Self {
        self.job.input.seen_from = places;
        self
    }

    /// The record layout of raw binary files, such as `"xyz:f64,intensity:u16".parse()?`. By default a side-car file tells, or it is detected.
    pub fn layout(mut self, layout: Layout) -> Self {
        self.job.input.layout = Some(layout);
        self
    }

    /// Bytes before the first record of raw binary files: 0 by default.
    pub fn skip_bytes(mut self, bytes: u64) -> Self {
        self.job.input.skip_bytes = Some(bytes);
        self
    }

    /// Reads raw binary files with the most significant byte first, whatever their side-car files say; by default these tell, else the least significant is first.
    pub fn big_endian(mut self) -> Self {
        self.job.input.endian = Some(Endian::Big);
        self
    }

    /// Reads raw binary files with the least significant byte first, whatever their side-car files say.
    pub fn little_endian(mut self) -> Self {
        self.job.input.endian = Some(Endian::Little);
        self
    }

    /// Takes the files in the folders of folders, too, where [`Reconstruction::from_files`] names a folder.
    pub fn recursive(mut self) -> Self {
        self.job.input.depth = Depth::Recursive;
        self
    }

    /// The coordinate reference system, whatever files say.
    pub fn crs(mut self, crs: Option<Crs>) -> Self {
        self.job.input.crs = Some(crs);
        self
    }
}
