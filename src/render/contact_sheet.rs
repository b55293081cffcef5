//! The picture as a whole: its size, the views' cells on it, what is behind them, and how it becomes a file.
//!
//! ```text
//!   +-----------+ +-----------+   as many columns as make the views largest in all;
//!   |  front    | |  left     |   between cells a gap of a darker tone
//!   +-----------+ +-----------+
//!   +-----------+
//!   |  top      |
//!   +-----------+
//! ```

use std::io::{BufWriter, Write};
use std::path::Path;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::storage::atomic_file::{AtomicFile, Overwrite};

/// The longest side of a picture, in pixels.
pub const LONGEST: u32 = 16384;

/// The size of a picture in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// From left to right.
    pub width: u32,
    /// From top to bottom.
    pub height: u32,
}

impl FromStr for Size {
    type Err = Error;

    fn from_str(text: &str) -> Result<Size> {
        let sides = text.split_once(['x', 'X', '×']).map(|(w, h)| (w.trim().parse(), h.trim().parse()));
        match sides {
            Some((Ok(width), Ok(height))) if (1..=LONGEST).contains(&width) && (1..=LONGEST).contains(&height) => {
                Ok(Size { width, height })
            }
            _ => Err(Error::Usage(format!(
                "expected a width and a height from 1 to {LONGEST} pixels such as 1600x1200, found {text:?}"
            ))),
        }
    }
}

impl Size {
    /// Pixels in all.
    pub fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// What is behind the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Background {
    /// A colour.
    Colour([u8; 3]),
    /// Nothing: the picture has an alpha channel.
    Transparent,
}

impl FromStr for Background {
    type Err = Error;

    fn from_str(text: &str) -> Result<Background> {
        let channel = |digits: &str| u8::from_str_radix(digits, 16).ok();
        let colour = |digits: &str| -> Option<[u8; 3]> {
            let whole = digits.len() == 6 && digits.bytes().all(|b| b.is_ascii_hexdigit());
            whole.then(|| Some([channel(&digits[..2])?, channel(&digits[2..4])?, channel(&digits[4..])?]))?
        };
        match text.to_ascii_lowercase().as_str() {
            "white" => Ok(Background::Colour([255; 3])),
            "black" => Ok(Background::Colour([0; 3])),
            "grey" | "gray" => Ok(Background::Colour([128; 3])),
            "transparent" => Ok(Background::Transparent),
            other => other.strip_prefix('#').and_then(colour).map(Background::Colour).ok_or_else(|| {
                Error::Usage(format!(
                    "expected white, grey, black, transparent, or a colour as in #f0f4f8, found {text:?}"
                ))
            }),
        }
    }
}

/// A part of the picture, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    /// The pixel of its first column.
    pub left: usize,
    /// The pixel of its first row.
    pub top: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// The cells of views of which `extents` tells width and height in whatever unit, row by row.
///
/// # Errors
/// [`Error::InvalidSetting`] if the picture is too small for them.
pub fn cells(size: Size, extents: &[(f64, f64)]) -> Result<Vec<Cell>> {
    let (width, height, views) = (size.width as usize, size.height as usize, extents.len());
    let gap = if views > 1 { (width.min(height) / 300).max(1) } else { 0 };
    let side = |length: usize, count: usize| length.saturating_sub(gap * (count - 1)) / count;
    // The share of a cell that a view can fill.
    let filled = |width: f64, height: f64, extent: (f64, f64)| {
        let (across, down) = (extent.0 / width, extent.1 / height);
        if across > 0.0 && down > 0.0 { across.min(down) / across.max(down) } else { 0.0 }
    };
    let mut best = None;
    for columns in 1..=views {
        let (width, height) = (side(width, columns), side(height, views.div_ceil(columns)));
        if width > 0 && height > 0 {
            let shares: f64 = extents.iter().map(|extent| filled(width as f64, height as f64, *extent)).sum();
            let area = shares * (width * height) as f64;
            // Of equals the one with more columns: pictures are seen on wide screens.
            if best.is_none_or(|(most, _)| area >= most) {
                best = Some((area, columns));
            }
        }
    }
    let Some((_, columns)) = best else {
        return Err(Error::setting("size", format!("`size` {width}x{height}: too small for {views} views")));
    };
    let rows = views.div_ceil(columns);
    let cell = |view: usize| {
        let start = |i: usize, length: usize, count: usize| (length + gap) * i / count;
        let (column, row) = (view % columns, view / columns);
        let (left, top) = (start(column, width, columns), start(row, height, rows));
        let end = |i: usize, length: usize, count: usize| start(i + 1, length, count) - gap;
        Cell { left, top, width: end(column, width, columns) - left, height: end(row, height, rows) - top }
    };
    Ok((0..views).map(cell).collect())
}

/// A finished picture: rows of pixels from the top, each of three channels in sRGB, or four with opacity.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Its size.
    pub size: Size,
    /// Bytes of a pixel: 3 or 4.
    pub channels: usize,
    /// The pixels.
    pub pixels: Vec<u8>,
    /// Triangles that could be drawn, whether they are seen or not.
    pub triangles: u64,
}

impl Picture {
    /// A picture of the gaps between cells, which cells then cover.
    pub fn new(size: Size, background: Background) -> Picture {
        let pixels = match background {
            Background::Transparent => vec![0; 4 * size.pixels()],
            Background::Colour(colour) => {
                // A tone away from the background, whichever side has room.
                let tone = |c: u8| if c < 64 { c + 48 } else { c - 36 };
                colour.map(tone).repeat(size.pixels())
            }
        };
        Picture { size, channels: Picture::channels(background), pixels, triangles: 0 }
    }

    /// Bytes of a pixel.
    pub fn channels(background: Background) -> usize {
        if background == Background::Transparent { 4 } else { 3 }
    }

    /// The bytes of a row of a cell.
    pub fn row(&mut self, cell: &Cell, row: usize) -> &mut [u8] {
        let start = ((cell.top + row) * self.size.width as usize + cell.left) * self.channels;
        &mut self.pixels[start..start + cell.width * self.channels]
    }

    /// It as PNG.
    pub fn png(&self) -> Vec<u8> {
        let mut out = Vec::new();
        self.encode(&mut out).expect("memory takes what it is given");
        out
    }

    fn encode(&self, out: impl Write) -> std::io::Result<()> {
        let mut encoder = png::Encoder::new(out, self.size.width, self.size.height);
        encoder.set_color(if self.channels == 4 { png::ColorType::Rgba } else { png::ColorType::Rgb });
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_compression(png::Compression::Balanced);
        let mut writer = encoder.write_header().map_err(as_system)?;
        writer.write_image_data(&self.pixels).map_err(as_system)?;
        writer.finish().map_err(as_system)
    }

    /// Writes it as PNG and gives the file its name.
    ///
    /// # Errors
    /// [`Error::Io`]; those of [`AtomicFile::finish`].
    pub fn write(&self, file: AtomicFile) -> Result<()> {
        let write = || -> std::io::Result<()> {
            let mut out = BufWriter::new(file.file());
            self.encode(&mut out)?;
            out.flush()
        };
        write().map_err(Error::io(file.path(), "write the picture"))?;
        file.finish()
    }
}

/// What the system said, if that is why a picture was not written: the encoder's own conversion keeps its words only, and not its kind.
fn as_system(error: png::EncodingError) -> std::io::Error {
    match error {
        png::EncodingError::IoError(error) => error,
        other => other.into(),
    }
}

/// The file that a picture goes to, made before the work.
///
/// # Errors
/// [`Error::Usage`] if its name does not end in .png; those of [`AtomicFile::create`].
pub fn picture_file(path: &Path, overwrite: Overwrite) -> Result<AtomicFile> {
    if path.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("png")) {
        return Err(Error::Usage(format!("{}: pictures are .png", path.display())));
    }
    AtomicFile::create(path, overwrite)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_fill_the_picture_and_do_not_overlap() {
        for (width, height, views) in [(1600, 1200, 1), (1600, 1200, 2), (640, 480, 7), (100, 900, 3), (97, 61, 5)] {
            let cells = cells(Size { width, height }, &vec![(3.0, 2.0); views]).unwrap();
            let mut seen = vec![0; (width * height) as usize];
            for cell in &cells {
                for row in cell.top..cell.top + cell.height {
                    for column in cell.left..cell.left + cell.width {
                        seen[row * width as usize + column] += 1;
                    }
                }
            }
            assert!(seen.iter().all(|count| *count <= 1));
            let right = cells.iter().map(|c| c.left + c.width).max().unwrap();
            let bottom = cells.iter().map(|c| c.top + c.height).max().unwrap();
            assert_eq!((right, bottom), (width as usize, height as usize));
        }
        let size = Size { width: 1600, height: 1200 };
        let tops = |extent| cells(size, &[extent; 2]).unwrap().iter().map(|cell| cell.top).collect::<Vec<_>>();
        assert_eq!(tops((1.0, 2.0)), [0, 0], "side by side");
        assert_eq!(tops((2.0, 1.0)), [0, 602], "one above the other");
        assert_eq!(tops((0.0, 0.0)), [0, 0]);
        assert!(cells(Size { width: 1, height: 1 }, &[(1.0, 1.0); 9]).is_err());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_told_from_other_failures() {
        for side in [1, 300] {
            let picture = Picture::new(Size { width: side, height: side }, Background::Transparent);
            let error = picture.write(AtomicFile::report(Path::new("/dev/full")).unwrap()).unwrap_err();
            assert_eq!(error.kind(), crate::error::Kind::Temporary, "{error}");
        }
    }

    #[test]
    fn sizes_and_backgrounds_as_typed() {
        assert_eq!("1600x1200".parse::<Size>().unwrap(), Size { width: 1600, height: 1200 });
        for bad in ["", "1600", "0x5", "5x0", "-1x5", "99999x5", "axb", "1x2x3"] {
            assert!(bad.parse::<Size>().is_err(), "{bad:?}");
        }
        assert_eq!("#0a0B0c".parse::<Background>().unwrap(), Background::Colour([10, 11, 12]));
        assert_eq!("Transparent".parse::<Background>().unwrap(), Background::Transparent);
        for bad in ["", "#12", "#12345é", "#gggggg", "mauve", "#1234567"] {
            assert!(bad.parse::<Background>().is_err(), "{bad:?}");
        }
    }
}
