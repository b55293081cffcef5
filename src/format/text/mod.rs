//! Points as text: one per line, coordinates in columns (`.xyz .txt .csv .pts .asc`).
//!
//! * Columns are separated by blanks (spaces and tabs), commas or semicolons, whichever makes three numbers of the
//!   first line of data.
//! * Lines that begin with `#`, `//` or `;` are comments; blank lines are skipped.
//! * Lines before the first data are a header. If one of the last, or a comment, names columns x, y and z, these are
//!   read. Other names of these are known, too, with or without units, in any case: `easting northing elevation`, `E N H`,
//!   `lon lat alt`, `POINT_X`, `X_m`, `x [m]`. A header that names as many columns as there are, but not these, is an error. Without a
//!   header, the first three columns are read. Other columns that have names, and numbers in the first lines of data, are attributes: `u8`
//!   if all of these are whole numbers from 0 to 255, else `f64`. Columns without names are ignored.
//! * A line with a single whole number before the data is a count, as in PTS files, which may repeat it between
//!   scans. It is not trusted or used.
//! * Decimal commas are read where they cannot be separators: between semicolons, or between blanks if the first line
//!   of data needs it.
//!
//! Coordinates are taken as `f64`.

mod dialect;
mod header;
mod names;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::sync::Arc;

use self::dialect::{Counts, Dialect, Separator, comment, has_quoted_numbers, is_count, is_short_of_numbers};
use self::header::{Header, Line, own_attributes};
use super::lines::{AllLines, LineBlock, LineCutter, LineReading, lines, quoted};
use super::records::same_length;
use crate::error::{Error, Result};
use crate::format::point_format::{BlockCutter, PointFormat, Source};
use crate::points::attribute::{Attribute, Placing, Schema};
use crate::points::{Coordinate, Precision};
use crate::storage::mapped::Content;

/// Where the first line of data must be found.
const MAX_HEADER: u64 = 64 << 10;

#[derive(Debug)]
struct Text {
    content: Content,
    len: u64,
    dialect: Dialect,
    /// Byte and number of the first line of data.
    start: u64,
    first_line: u64,
    /// The other columns that are read, each with the attribute it is.
    own: Vec<(Attribute, usize)>,
    attributes: Vec<Attribute>,
    /// What the columns of x, y and z are called; empty if the file does not say.
    called: [String; 3],
}

/// Opens a file of text.
///
/// # Errors
/// [`Error::Malformed`] if there is no line of three numbers near its beginning, or a header does not tell which columns the
/// coordinates are; [`Error::ForeignFormat`] for PTX scans.
pub fn open(content: &Content) -> Result<(Source, Arc<dyn PointFormat>)> {
    let (file, path) = (content.unmapped()?, content.name());
    let head = file.read(0..file.len().min(MAX_HEADER))?;
    let text = find_data(content, &head, file.len())?;
    let Dialect { separator, columns: [x, y, z], .. } = text.dialect;
    let separator = match separator {
        Separator::Blanks => "blanks",
        Separator::Comma => "commas",
        Separator::Semicolon => "semicolons",
    };
    let plain = text.called.iter().zip(["x", "y", "z"]).all(|(name, axis)| name.is_empty() || name == axis);
    let named = if plain { String::new() } else { format!(", named {}", text.called.join(", ")) };
    let source = Source {
        path: path.to_path_buf(),
        format: "text",
        description: format!("text, separated by {separator}, x y z in columns {} {} {}{named}", x + 1, y + 1, z + 1),
        records: None,
        bytes: file.len(),
        crs: None,
        remark: None,
    };
    Ok((source, Arc::new(text)))
}

fn find_data(content: &Content, head: &[u8], len: u64) -> Result<Text> {
    let path = content.name();
    let mark = if head.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
    let mut header = Header::default();
    let mut counts = 0;
    let mut first_other = None;
    for (number_of_line, range) in lines(&head[mark..]) {
        let line = head[mark..][range.clone()].trim_ascii();
        if line.is_empty() {
            continue;
        }
        let place = || format!("line {}", number_of_line + 1);
        if range.len() >= head.len() - mark && len > head.len() as u64 {
            let expected = format_args!("a line of at most {MAX_HEADER} bytes").to_string();
            return Err(Error::malformed(path, place(), expected, "a longer one"));
        }
        if let Some(comment) = comment(line) {
            header.comment = Some(comment);
            continue;
        }
        match header.read(line) {
            Line::Data(dialect, names) => {
                if counts >= 2 {
                    return Err(Error::ForeignFormat {
                        path: path.to_path_buf(),
                        format: "a PTX scan",
                        advice: "export it as PTS, E57 or PLY, with its scans moved into place",
                    });
                }
                let counts = if counts == 1 { Counts::Skipped } else { Counts::None };
                let dialect = Dialect { counts, ..dialect };
                let own = own_attributes(&dialect, &names, &head[mark + range.start..]);
                let attributes = own.iter().map(|(attribute, _)| attribute.clone()).collect();
                let called = dialect.columns.map(|column| names.get(column).cloned().unwrap_or_default());
                let (content, start, first_line) = (content.clone(), (mark + range.start) as u64, number_of_line + 1);
                return Ok(Text { content, len, dialect, start, first_line, own, attributes, called });
            }
            Line::Unclear(named) => {
                let expected = "a line before it that names the columns x, y and z (or easting, northing and height, or longitude, latitude \
                                and altitude), with # in front if it names none";
                let found = format!("{}, then {}", quoted(named), quoted(line));
                return Err(Error::malformed(path, place(), expected, found));
            }
            Line::Short(column, found) => {
                let expected = format!("a number in column {}, as the header says", column + 1);
                return Err(Error::malformed(path, place(), expected, quoted(found)));
            }
            Line::Other if is_count(line) => counts += 1,
            Line::Other if is_short_of_numbers(line) => {
                return Err(Error::malformed(path, place(), "at least three numbers", quoted(line)));
            }
            Line::Other if has_quoted_numbers(line) => {
                return Err(Error::malformed(path, place(), "numbers without quotes round them", quoted(line)));
            }
            Line::Other => {
                header.put(line);
                first_other.get_or_insert((number_of_line + 1, line));
            }
        }
    }
    let (line, found) = first_other.unwrap_or((1, b""));
    let expected = "text with three numbers to a line, x, y and z, such as 1.5 2.5 3.5";
    Err(Error::malformed(path, format_args!("line {line}"), expected, quoted(found)))
}

impl PointFormat for Text {
    fn precision(&self) -> Precision {
        Precision::Double
    }

    fn attributes(&self) -> &[Attribute] {
        &self.attributes
    }

    fn lent_from(&self) -> Option<&Content> {
        Some(&self.content)
    }

    fn cut(&self, schema: &Schema) -> Result<Box<dyn BlockCutter<'_> + '_>> {
        let file = self.content.open()?;
        same_length(&file, self.len)?;
        let lines = LineCutter::new(file, self.start, self.first_line);
        let read: Vec<&(Attribute, usize)> =
            self.own.iter().filter(|(a, _)| schema.column(&a.name).is_some()).collect();
        // The numbers that are read of a line: x, y, z, then attributes.
        let columns: Vec<usize> =
            self.dialect.columns.into_iter().chain(read.iter().map(|(_, column)| *column)).collect();
        let places: Vec<_> = read.iter().zip(3..).map(|((attribute, _), index)| (attribute.clone(), index)).collect();
        let mut names: Vec<String> = ["x", "y", "z"].map(str::to_string).to_vec();
        names.extend(read.iter().map(|(attribute, _)| attribute.name.clone()));
        let (path, dialect) = (self.content.name().to_path_buf(), self.dialect);
        let placing = Placing::new(schema, &places);
        let mut index = vec![None; columns.iter().max().map_or(0, |last| last + 1)];
        columns.iter().enumerate().for_each(|(number, &column)| index[column] = Some(number));
        let reading = Reading { path, dialect, columns, index, names, placing };
        Ok(Box::new(AllLines { lines, reading: Arc::new(reading) }))
    }
}

/// What is read of every line.
struct Reading {
    path: PathBuf,
    dialect: Dialect,
    /// x, y, z, then attributes.
    columns: Vec<usize>,
    /// Which of these a column of the file is: tables may have thousands.
    index: Vec<Option<usize>>,
    names: Vec<String>,
    placing: Placing,
}

impl LineReading for Reading {
    fn fill<C: Coordinate>(&self, block: &LineBlock, points: &mut Vec<[C; 3]>, attributes: &mut Vec<u8>) -> Result<()> {
        let Reading { path, dialect, columns, index, names, placing } = self;
        let index = |place: usize| index.get(place).copied().flatten();
        let mut values = vec![0.0; columns.len()];
        for (number_of_line, range) in lines(&block.bytes) {
            let line = block.bytes[range].trim_ascii();
            match dialect.parse_by(line, columns, &index, &mut values) {
                Ok(()) => {
                    points.push([0, 1, 2].map(|axis| C::from_f64(values[axis])));
                    placing.place(&values, attributes);
                }
                Err(_) if line.is_empty() || comment(line).is_some() => {}
                Err(_) if dialect.counts == Counts::Skipped && is_count(line) => {}
                Err((index, found)) => {
                    let place = format!("line {}", block.first_line + number_of_line);
                    let expected = format!("a number as {} in column {}", names[index], columns[index] + 1);
                    return Err(Error::malformed(path, place, expected, quoted(found)));
                }
            }
        }
        Ok(())
    }

    fn record(&self) -> usize {
        self.placing.stride()
    }
}
