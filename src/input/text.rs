//! Points as text: one per line, coordinates in columns (`.xyz .txt .csv .pts .asc`).
//!
//! * Columns are separated by blanks (spaces and tabs), commas or semicolons, whichever makes three numbers of the
//!   first line of data.
//! * Lines that begin with `#`, `//` or `;` are comments; blank lines are skipped.
//! * Lines before the first data are a header. If the last one, or a comment, names columns x, y and z, these are
//!   read; otherwise the first three are. Other columns that have names, and numbers in the first lines of data, are attributes: `u8` if all of these are
//!   whole numbers from 0 to 255, else `f64`. Columns without names are ignored.
//! * A line with a single whole number before the data is a count, as in PTS files, which may repeat it between
//!   scans. It is not trusted or used.
//! * Decimal commas are read where they cannot be separators: between semicolons, or between blanks if the first line
//!   of data needs it.
//!
//! Coordinates are taken as `f64`.

use std::path::PathBuf;
use std::sync::Arc;

use super::lines::{LineBlock, LineCutter, lines, number, quoted};
use super::mapped::Content;
use super::records::same_length;
use super::{BlockCutter, Decode, PointFormat, Source};
use crate::attribute::{Attribute, Placing, Schema, canonical};
use crate::error::{Error, Result};
use crate::points::{Batch, Coordinate, Points, Precision};
use crate::scalar::Scalar;

/// Where the first line of data must be found.
const MAX_HEADER: u64 = 64 << 10;

/// What separates columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Separator {
    /// Any number of spaces and tabs.
    Blanks,
    Comma,
    Semicolon,
}

/// What separates a number's whole part from its fraction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Decimal {
    Point,
    PointOrComma,
}

/// The ways to read a line, in the order in which they are tried. `1,5 2,5 3,5` has four columns by commas, but `5 2`
/// is no number.
const WAYS: [(Separator, Decimal); 4] = [
    (Separator::Semicolon, Decimal::PointOrComma),
    (Separator::Comma, Decimal::Point),
    (Separator::Blanks, Decimal::Point),
    (Separator::Blanks, Decimal::PointOrComma),
];

/// Whether lines with a single whole number stand between the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Counts {
    None,
    Skipped,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Dialect {
    separator: Separator,
    decimal: Decimal,
    /// Where x, y and z stand, counted from 0.
    columns: [usize; 3],
    counts: Counts,
}

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
}

/// Opens a file of text.
///
/// # Errors
/// [`Error::Malformed`] if there is no line of three numbers near its beginning, or a header names only some of the
/// coordinates; [`Error::ForeignFormat`] for PTX scans.
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
    let source = Source {
        path: path.to_path_buf(),
        format: "text",
        description: format!("text, separated by {separator}, x y z in columns {} {} {}", x + 1, y + 1, z + 1),
        records: None,
        bytes: file.len(),
        crs: None,
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
        if let Some(comment) = comment(line) {
            header.comment = Some(comment);
        } else if let Some((separator, decimal, columns)) = header.read(line) {
            if counts >= 2 {
                return Err(Error::ForeignFormat {
                    path: path.to_path_buf(),
                    format: "a PTX scan",
                    advice: "export it as PTS, E57 or PLY, with its scans moved into place",
                });
            }
            let counts = if counts == 1 { Counts::Skipped } else { Counts::None };
            let dialect = Dialect { separator, decimal, columns, counts };
            let own = header.attributes(&dialect, &head[mark + range.start..]);
            let attributes = own.iter().map(|(attribute, _)| attribute.clone()).collect();
            let (content, start, first_line) = (content.clone(), (mark + range.start) as u64, number_of_line + 1);
            return Ok(Text { content, len, dialect, start, first_line, own, attributes });
        } else if is_count(line) {
            counts += 1;
        } else {
            header.names = Some(line);
            first_other.get_or_insert((number_of_line + 1, line));
        }
    }
    let (line, found) = first_other.unwrap_or((1, b""));
    Err(Error::malformed(path, format_args!("line {line}"), header.expected(), quoted(found)))
}

fn comment(line: &[u8]) -> Option<&[u8]> {
    line.strip_prefix(b"#").or_else(|| line.strip_prefix(b"//")).or_else(|| line.strip_prefix(b";"))
}

fn is_count(line: &[u8]) -> bool {
    line.len() <= 19 && line.iter().all(u8::is_ascii_digit)
}

/// The lines before the data that may name columns.
#[derive(Default)]
struct Header<'a> {
    names: Option<&'a [u8]>,
    comment: Option<&'a [u8]>,
}

impl Header<'_> {
    /// How `line` can be read as data.
    fn read(&self, line: &[u8]) -> Option<(Separator, Decimal, [usize; 3])> {
        WAYS.into_iter().find_map(|(separator, decimal)| {
            let columns = self.columns(separator)?;
            let dialect = Dialect { separator, decimal, columns, counts: Counts::None };
            dialect.parse(line, &columns, &mut [0.0; 3]).is_ok().then_some((separator, decimal, columns))
        })
    }

    /// Columns with names, and with numbers in the lines at the beginning of `data`, the last of which may be cut.
    fn attributes(&self, dialect: &Dialect, data: &[u8]) -> Vec<(Attribute, usize)> {
        let whole = memchr::memrchr(b'\n', data).map_or(data, |end| &data[..end]);
        let mut out: Vec<(Attribute, usize)> = Vec::new();
        for (column, name) in self.names_of(dialect).into_iter().enumerate() {
            if dialect.columns.contains(&column) || name.is_empty() || out.iter().any(|(known, _)| known.name == name) {
                continue;
            }
            let mut scalar = Some(Scalar::U8);
            for (_, range) in lines(whole) {
                let line = whole[range].trim_ascii();
                let mut value = [0.0];
                // What is no point at all says nothing of its columns.
                if dialect.parse(line, &dialect.columns, &mut [0.0; 3]).is_ok() {
                    let number = dialect.parse(line, &[column], &mut value).is_ok();
                    let small = (0.0..=255.0).contains(&value[0]) && value[0].fract() == 0.0;
                    scalar = scalar.filter(|_| number).map(|s| if small { s } else { Scalar::F64 });
                }
            }
            out.extend(scalar.map(|scalar| (Attribute { name, scalar }, column)));
        }
        out
    }

    /// The names of the columns, if x, y and z are found by theirs.
    fn names_of(&self, dialect: &Dialect) -> Vec<String> {
        let spelt = |name: &[u8]| canonical(&String::from_utf8_lossy(unquoted(name)));
        for line in [self.names, self.comment].into_iter().flatten() {
            let by_separator: Vec<&[u8]> = columns_of(line, dialect.separator).collect();
            let by_any: Vec<&[u8]> = line.split(is_any_separator).filter(|n| !n.is_empty()).collect();
            for names in [by_separator, by_any] {
                if named(&mut names.iter().copied()) == dialect.columns.map(Some) {
                    return names.into_iter().map(spelt).collect();
                }
            }
        }
        Vec::new()
    }

    /// Where x, y and z stand; `None` if the header names only some of them.
    fn columns(&self, separator: Separator) -> Option<[usize; 3]> {
        let own = |line: &[u8]| named(&mut columns_of(line, separator));
        // `//X Y Z` also stands above data with commas.
        let any = |line: &[u8]| named(&mut line.split(is_any_separator).filter(|n| !n.is_empty()));
        for line in [self.names, self.comment].into_iter().flatten() {
            let places = own(line);
            if let [Some(x), Some(y), Some(z)] = places {
                return Some([x, y, z]);
            }
            if let [Some(x), Some(y), Some(z)] = any(line) {
                return Some([x, y, z]);
            }
            if self.names == Some(line) && places != [None; 3] {
                return None;
            }
        }
        Some([0, 1, 2])
    }

    fn expected(&self) -> &'static str {
        match self.names {
            Some(_) => "a line with at least three numbers below, in the columns x, y and z if they are named",
            None => "a line with at least three numbers",
        }
    }
}

fn named(names: &mut dyn Iterator<Item = &[u8]>) -> [Option<usize>; 3] {
    let mut places = [None; 3];
    for (place, name) in names.enumerate() {
        let name = unquoted(name);
        for (axis, known) in [b"x", b"y", b"z"].into_iter().enumerate() {
            if name.eq_ignore_ascii_case(known) && places[axis].is_none() {
                places[axis] = Some(place);
            }
        }
    }
    places
}

fn is_any_separator(byte: &u8) -> bool {
    matches!(byte, b',' | b';' | b' ' | b'\t')
}

fn unquoted(name: &[u8]) -> &[u8] {
    let name = name.trim_ascii();
    name.strip_prefix(b"\"").and_then(|n| n.strip_suffix(b"\"")).unwrap_or(name)
}

fn columns_of(line: &[u8], separator: Separator) -> Box<dyn Iterator<Item = &[u8]> + '_> {
    match separator {
        Separator::Blanks => Box::new(blanks(line)),
        Separator::Comma => Box::new(line.split(|&b| b == b',')),
        Separator::Semicolon => Box::new(line.split(|&b| b == b';')),
    }
}

/// The tokens of a line between spaces and tabs.
pub fn blanks(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|b| b.is_ascii_whitespace()).filter(|token| !token.is_empty())
}

impl Dialect {
    /// Reads the numbers in `columns` of a line; or tells which of them, and the text where there is no number.
    fn parse<'a>(
        &self,
        line: &'a [u8],
        columns: &[usize],
        values: &mut [f64],
    ) -> std::result::Result<(), (usize, &'a [u8])> {
        // One loop per separator, so that splitting is inlined into it.
        match self.separator {
            Separator::Blanks => self.pick(blanks(line), columns, values),
            Separator::Comma => self.pick(line.split(|&b| b == b','), columns, values),
            Separator::Semicolon => self.pick(line.split(|&b| b == b';'), columns, values),
        }
    }

    fn pick<'a>(
        &self,
        tokens: impl Iterator<Item = &'a [u8]>,
        columns: &[usize],
        values: &mut [f64],
    ) -> std::result::Result<(), (usize, &'a [u8])> {
        let mut missing = columns.len();
        let mut seen = 0;
        for (place, token) in tokens.enumerate() {
            if let Some(index) = columns.iter().position(|&column| column == place) {
                let token = token.trim_ascii();
                values[index] = self.number(token).ok_or((index, token))?;
                missing -= 1;
                if missing == 0 {
                    return Ok(());
                }
            }
            seen = place + 1;
        }
        let absent = (0..columns.len()).filter(|&i| columns[i] >= seen).min_by_key(|&i| columns[i]);
        Err((absent.unwrap_or(0), b"the end of the line"))
    }

    fn number(&self, token: &[u8]) -> Option<f64> {
        number(token).or_else(|| {
            let comma = (self.decimal == Decimal::PointOrComma).then(|| memchr::memchr(b',', token))??;
            let mut pointed = token.to_vec();
            pointed[comma] = b'.';
            number(&pointed)
        })
    }
}

impl PointFormat for Text {
    fn precision(&self) -> Precision {
        Precision::Double
    }

    fn attributes(&self) -> &[Attribute] {
        &self.attributes
    }

    fn cut(&self, schema: &Schema) -> Result<Box<dyn BlockCutter>> {
        let file = self.content.open()?;
        same_length(&file, self.len)?;
        let lines = LineCutter::new(file, self.start, self.first_line);
        let read: Vec<&(Attribute, usize)> =
            self.own.iter().filter(|(a, _)| schema.column(&a.name).is_some()).collect();
        // The numbers that are read of a line: x, y, z, then attributes.
        let columns = self.dialect.columns.into_iter().chain(read.iter().map(|(_, column)| *column)).collect();
        let places: Vec<_> = read.iter().zip(3..).map(|((attribute, _), index)| (attribute.clone(), index)).collect();
        let mut names: Vec<String> = ["x", "y", "z"].map(str::to_string).to_vec();
        names.extend(read.iter().map(|(attribute, _)| attribute.name.clone()));
        let (path, dialect) = (self.content.name().to_path_buf(), self.dialect);
        let reading = Reading { path, dialect, columns, names, placing: Placing::new(schema, &places) };
        Ok(Box::new(TextCutter { lines, reading: Arc::new(reading) }))
    }
}

/// What is read of every line.
struct Reading {
    path: PathBuf,
    dialect: Dialect,
    /// x, y, z, then attributes.
    columns: Vec<usize>,
    names: Vec<String>,
    placing: Placing,
}

struct TextCutter {
    lines: LineCutter,
    reading: Arc<Reading>,
}

impl BlockCutter for TextCutter {
    fn next(&mut self) -> Result<Option<Box<dyn Decode>>> {
        let Some(lines) = self.lines.next()? else { return Ok(None) };
        Ok(Some(Box::new(TextBlock { lines, reading: Arc::clone(&self.reading) })))
    }
}

struct TextBlock {
    lines: LineBlock,
    reading: Arc<Reading>,
}

impl TextBlock {
    fn fill<C: Coordinate>(&self, points: &mut Vec<[C; 3]>, attributes: &mut Vec<u8>) -> Result<()> {
        let Reading { path, dialect, columns, names, placing } = &*self.reading;
        let mut values = vec![0.0; columns.len()];
        for (number_of_line, range) in lines(&self.lines.bytes) {
            let line = self.lines.bytes[range].trim_ascii();
            match dialect.parse(line, columns, &mut values) {
                Ok(()) => {
                    points.push([0, 1, 2].map(|axis| C::from_f64(values[axis])));
                    placing.place(&values, attributes);
                }
                Err(_) if line.is_empty() || comment(line).is_some() => {}
                Err(_) if dialect.counts == Counts::Skipped && is_count(line) => {}
                Err((index, found)) => {
                    let place = format!("line {}", self.lines.first_line + number_of_line);
                    let expected = format!("a number as {} in column {}", names[index], columns[index] + 1);
                    return Err(Error::malformed(path, place, expected, quoted(found)));
                }
            }
        }
        Ok(())
    }
}

impl Decode for TextBlock {
    fn decode(&self, batch: &mut Batch) -> Result<()> {
        let Batch { points, attributes, .. } = batch;
        match points {
            Points::Single(points) => self.fill(points, attributes),
            Points::Double(points) => self.fill(points, attributes),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::InputOptions;
    use super::super::testing::collect;
    use super::*;

    fn read(content: &[u8]) -> Result<(Vec<[f64; 3]>, u64)> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.xyz");
        std::fs::write(&path, content).unwrap();
        collect(&path, &InputOptions::default())
    }

    #[test]
    fn dialects_are_recognised() {
        let expected = vec![[1.0, -2.5, 300.0], [4.0, 5.0, 6.0]];
        for text in [
            "1 -2.5 3e2\n4 5 6",
            "1\t-2.5\t3E+2\r\n\r\n4\t5\t6\r\n",
            "  1   -2.5 300 0.1 0.2 0.3\n 4 5 6 nx ny nz\n",
            "1,-2.5,300\n4, 5, 6\n",
            "1;-2.5;300\n4;5;6\n",
            "1,0;-2,5;300\n4,0;5;6\n",
            "1,0 -2,5 300,0\n4 5 6\n",
            "# comment\n// comment\n; comment\n1 -2.5 300\n# between\n4 5 6\n",
            "x,y,z\n1,-2.5,300\n4,5,6\n",
            "\"Y\",\"Z\",\"X\",i\n-2.5,300,1,9\n5,6,4,9\n",
            "//X,Y,Z,Scalar field\n1,-2.5,300,7\n4,5,6,7\n",
            "# z y x\n300 -2.5 1\n6 5 4\n",
            "//X Y Z\n2\n1,-2.5,300\n4,5,6\n",
            "label,x,y,z\ntree,1,-2.5,300\n,4,5,6\n",
            "2\n1 -2.5 300 128\n4 5 6 128\n",
            "1\n1 -2.5 300 128\n1\n4 5 6 128\n",
            "\u{feff}x y z\n1 -2.5 300\n4 5 6",
            "A survey by J. Müller\n1 -2.5 300\n4 5 6\n",
        ] {
            assert_eq!(read(text.as_bytes()).unwrap().0, expected, "{text}");
        }
    }

    #[test]
    fn missing_and_infinite_coordinates_are_counted() {
        assert_eq!(read(b"1 2 3\nnan 0 0\n1 inf 1\n4 5 6\n").unwrap(), (vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], 2));
    }

    #[test]
    fn what_is_no_number_is_located() {
        for (text, parts) in [
            ("1 2 3\n\n4 5 six\n", ["line 3", "z in column 3", "\"six\""]),
            ("a,z,y,x\n0,1,2,3\n0,1,2\n", ["line 3", "x in column 4", "the end of the line"]),
            ("x y intensity\n1 2 3\n", ["line 1", "x, y and z", "x y intensity"]),
            ("hello\nworld\n", ["line 1", "three numbers", "hello"]),
            ("1 2 3\n7\n4 5 6\n", ["line 2", "y in column 2", "the end of the line"]),
        ] {
            let error = read(text.as_bytes()).unwrap_err().to_string();
            assert!(parts.iter().all(|part| error.contains(part)), "{text}: {error}");
        }
        assert!(read(b"2\n3\n0 0 0\n1 0 0\n").unwrap_err().to_string().contains("PTX"));
    }

    #[test]
    fn every_prefix_gives_fewer_points_or_an_error() {
        let text = b"//X,Y,Z\n10.5,20.5,30.5\r\n# c\n1,2,3\n4,5,6";
        for end in 1..text.len() {
            if let Ok((points, _)) = read(&text[..end]) {
                assert!(points.len() <= 3);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn what_is_written_is_read(points in prop::collection::vec(prop::array::uniform3(-1e300f64..1e300), 1..50),
                                   way in 0usize..4, crlf: bool) {
            let end = if crlf { "\r\n" } else { "\n" };
            let text: String = points.iter().map(|[x, y, z]| match way {
                0 => format!("{x} {y}\t{z}{end}"),
                1 => format!("{x:e},{y},{z}{end}"),
                2 => format!("{x};{y};{z};9{end}"),
                _ => format!("{x:e};{y:e};{z:e}{end}").replace('.', ","),
            }).collect();
            prop_assert_eq!(read(text.as_bytes()).unwrap().0, points);
        }

        #[test]
        fn no_text_makes_it_panic(text in "[-0-9., ;x#\n]{0,200}") {
            drop(read(text.as_bytes()));
        }
    }
}
