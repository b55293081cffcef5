//! GeoTIFF files of heights: `f32`, tiled, deflated, with overviews and a value for what is not known; BigTIFF where they are long.
//!
//! Row 0 is the northernmost. Blocks without a height are not stored: readers take the no-data value for them. Blocks are written in the order of a tree of
//! overviews, so that a block of each level is held at a time; the directory stands at the end.

use std::fs::File;
use std::io::{BufWriter, Write};

use tiff_core::{Compression, Predictor, Tag, TagValue};
use tiff_writer::{ImageBuilder, ImageHandle, TiffWriter, WriteOptions};

use crate::error::{Error, Result};
use crate::points::crs::Crs;
use crate::points::unit::Measure;
use crate::storage::atomic_file::AtomicFile;

/// Cells along the side of a block.
pub const BLOCK: usize = 256;

/// The most blocks of a file: what is kept of each takes 24 bytes.
const MOST_BLOCKS: u64 = 1 << 20;

/// A raster and where it lies. Cells are squares, and numbered from the origin of the coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Area {
    /// The northernmost row, and the westernmost column.
    pub first: [i64; 2],
    /// Rows, to the south, and columns, to the east.
    pub cells: [u64; 2],
    /// The side of a cell.
    pub side: f64,
}

impl Area {
    fn blocks(&self) -> [u64; 2] {
        self.cells.map(|cells| cells.div_ceil(BLOCK as u64))
    }

    /// Checks that a file can hold it.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if it has too many cells.
    pub fn check(&self) -> Result<()> {
        let [rows, columns] = self.cells;
        let [down, across] = self.blocks();
        if down.saturating_mul(across) > MOST_BLOCKS || rows.max(columns) > u64::from(u32::MAX / 2) {
            return Err(Error::setting(
                "raster_size",
                format!(
                    "`raster_size` {}: the raster would be {columns} x {rows} cells; larger cells, or `bounds` without far points, make it smaller",
                    self.side
                ),
            ));
        }
        Ok(())
    }
}

/// Fills a file with a raster. `heights` gives the heights of [`BLOCK`]² cells from a row and a column on, the southernmost row first, NaN where none is known; or `None` if none of them is.
///
/// # Errors
/// [`Error::InvalidSetting`] if it has too many cells; [`Error::Io`]; those of `heights`.
pub fn write(
    file: &AtomicFile,
    area: Area,
    crs: Option<&Crs>,
    heights: impl Fn([i64; 2]) -> Result<Option<Vec<f32>>>,
) -> Result<()> {
    area.check()?;
    let path = file.path();
    let out = BufWriter::with_capacity(1 << 16, file.file().try_clone().map_err(Error::io(path, "write"))?);
    let failed = |error: tiff_writer::Error| match error {
        tiff_writer::Error::Io(error) => Error::io(path, "write")(error),
        other => Error::Internal(format!("{}: {other}", path.display())),
    };
    let mut writer = TiffWriter::new(out, WriteOptions::auto()).map_err(failed)?;
    let mut levels = Vec::new();
    let mut cells = area.cells;
    loop {
        let [rows, columns] = cells.map(|cells| cells as u32);
        let mut image = ImageBuilder::new(columns, rows)
            .sample_type::<f32>()
            .tiles(BLOCK as u32, BLOCK as u32)
            .compression(Compression::Deflate)
            .predictor(Predictor::FloatingPoint)
            .tag(Tag::new(42113, TagValue::Ascii("nan".into())));
        if levels.is_empty() {
            image = located(image, area, crs);
        } else {
            image = image.overview();
        }
        let handle = writer.add_image(image).map_err(failed)?;
        levels.push((handle, cells.map(|cells| cells.div_ceil(BLOCK as u64))));
        if cells.iter().all(|cells| *cells <= BLOCK as u64) {
            break;
        }
        cells = cells.map(|cells| cells.div_ceil(2));
    }
    let mut tree = Tree { writer, levels, area, heights, failed };
    let top = tree.levels.len() - 1;
    tree.block(top, [0, 0])?;
    let Tree { writer, .. } = tree;
    let mut out = writer.finish().map_err(failed)?;
    out.flush().map_err(Error::io(path, "write"))?;
    Ok(())
}

/// The levels in the making.
struct Tree<H, F> {
    writer: TiffWriter<BufWriter<File>>,
    /// Each level's image, and its blocks, downwards and across.
    levels: Vec<(ImageHandle, [u64; 2])>,
    area: Area,
    heights: H,
    failed: F,
}

impl<H, F> Tree<H, F>
where
    H: Fn([i64; 2]) -> Result<Option<Vec<f32>>>,
    F: Fn(tiff_writer::Error) -> Error,
{
    /// Writes a block and all below it; its heights, if it has any, the northernmost row first.
    fn block(&mut self, level: usize, [row, column]: [u64; 2]) -> Result<Option<Vec<f32>>> {
        let [down, across] = self.levels[level].1;
        if row >= down || column >= across {
            return Ok(None);
        }
        let heights = match level {
            0 => self.read([row, column])?,
            _ => {
                let mut halved: Option<Vec<f32>> = None;
                for (south, east) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    if let Some(part) = self.block(level - 1, [2 * row + south, 2 * column + east])? {
                        let into = halved.get_or_insert_with(|| vec![f32::NAN; BLOCK * BLOCK]);
                        halve(&part, into, [south, east].map(|half| half as usize * BLOCK / 2));
                    }
                }
                halved
            }
        };
        let (handle, number) = (&self.levels[level].0, (row * across + column) as usize);
        match &heights {
            None => self.writer.write_block_sparse(handle, number),
            Some(heights) => self.writer.write_block(handle, number, heights),
        }
        .map_err(&self.failed)?;
        Ok(heights)
    }

    fn read(&self, [row, column]: [u64; 2]) -> Result<Option<Vec<f32>>> {
        let block = BLOCK as i64;
        let [north, west] = [self.area.first[0] - row as i64 * block, self.area.first[1] + column as i64 * block];
        let Some(mut heights) = (self.heights)([north - block + 1, west])? else { return Ok(None) };
        for row in 0..BLOCK / 2 {
            let (upper, lower) = heights.split_at_mut((BLOCK - 1 - row) * BLOCK);
            upper[row * BLOCK..(row + 1) * BLOCK].swap_with_slice(&mut lower[..BLOCK]);
        }
        Ok(Some(heights).filter(|heights| heights.iter().any(|height| !height.is_nan())))
    }
}

/// Puts means of two by two heights, of those that are known, into a quarter of a block.
fn halve(part: &[f32], into: &mut [f32], [row, column]: [usize; 2]) {
    for y in 0..BLOCK / 2 {
        for x in 0..BLOCK / 2 {
            let at = 2 * y * BLOCK + 2 * x;
            let known = [part[at], part[at + 1], part[at + BLOCK], part[at + BLOCK + 1]];
            let (sum, count) = known
                .into_iter()
                .filter(|height| !height.is_nan())
                .fold((0.0, 0.0), |(sum, count), height| (sum + f64::from(height), count + 1.0));
            into[(row + y) * BLOCK + column + x] = (sum / count) as f32;
        }
    }
}

/// The image with where it lies on the map.
fn located(image: ImageBuilder, area: Area, crs: Option<&Crs>) -> ImageBuilder {
    let (west, north) = (area.first[1] as f64 * area.side, (area.first[0] + 1) as f64 * area.side);
    // A model type, and that a height is that of an area.
    let degrees = crs.is_some_and(|crs| matches!(crs.measure(), Some(Measure::Degrees)));
    let mut keys: Vec<[u16; 4]> = Vec::new();
    if crs.is_some() {
        keys.push([1024, 0, 1, if degrees { 2 } else { 1 }]);
    }
    keys.push([1025, 0, 1, 1]);
    let name = crs.and_then(|crs| crs.name.as_deref()).filter(|name| name.is_ascii() && !name.contains(['|', '\0']));
    let text = name.map(|name| format!("{name}|"));
    if let Some(text) = &text {
        keys.push([1026, 34737, text.len() as u16, 0]);
    }
    if let Some(code) = crs.and_then(|crs| u16::try_from(crs.epsg?).ok()) {
        keys.push([if degrees { 2048 } else { 3072 }, 0, 1, code]);
    }
    if let Some(code) = crs.and_then(|crs| u16::try_from(crs.vertical?).ok()) {
        keys.push([4096, 0, 1, code]);
    }
    let mut directory = vec![1, 1, 0, keys.len() as u16];
    directory.extend(keys.into_iter().flatten());
    let image = image
        .tag(Tag::new(33550, TagValue::Double(vec![area.side, area.side, 0.0])))
        .tag(Tag::new(33922, TagValue::Double(vec![0.0, 0.0, 0.0, west, north, 0.0])))
        .tag(Tag::new(34735, TagValue::Short(directory)));
    match text {
        Some(text) => image.tag(Tag::new(34737, TagValue::Ascii(text))),
        None => image,
    }
}
