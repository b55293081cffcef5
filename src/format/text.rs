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

use std::path::PathBuf;
use std::sync::Arc;

use super::lines::{LineBlock, LineCutter, lines, number, quoted};
use super::records::same_length;
use crate::error::{Error, Result};
use crate::format::point_format::{BlockCutter, Decode, PointFormat, Source};
use crate::points::attribute::{Attribute, Placing, Schema, canonical};
use crate::points::scalar::Scalar;
use crate::points::{Batch, Coordinate, Points, Precision};
use crate::storage::mapped::Content;

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

fn comment(line: &[u8]) -> Option<&[u8]> {
    line.strip_prefix(b"#").or_else(|| line.strip_prefix(b"//")).or_else(|| line.strip_prefix(b";"))
}

fn is_count(line: &[u8]) -> bool {
    line.len() <= 19 && line.iter().all(u8::is_ascii_digit)
}

/// Whether a line has numbers and nothing else, but too few of them: a point that lacks something, no header.
fn is_short_of_numbers(line: &[u8]) -> bool {
    WAYS.into_iter().any(|(separator, decimal)| {
        let dialect = Dialect { separator, decimal, columns: [0, 1, 2], counts: Counts::None };
        let filled = || columns_of(line, separator).filter(|token| !token.trim_ascii().is_empty());
        filled().count() == 2 && filled().all(|token| dialect.number(token.trim_ascii()).is_some())
    })
}

/// The lines before the data that may name columns.
#[derive(Default)]
struct Header<'a> {
    /// The last lines that are neither data nor comments.
    names: Vec<&'a [u8]>,
    comment: Option<&'a [u8]>,
}

/// Lines kept as possible headers: titles and units stand above and below the names.
const KEPT_LINES: usize = 8;

/// What a line is, as the header understands it.
enum Line<'a> {
    /// The first point, with the names of its columns, if they have any.
    Data(Dialect, Vec<String>),
    /// Numbers below this line, which names columns, but not these of x, y and z.
    Unclear(&'a [u8]),
    /// Numbers below a header, but none in this column.
    Short(usize, &'a [u8]),
    /// Something else.
    Other,
}

/// What a line above the data says of its columns.
enum Says<'a> {
    Columns([usize; 3], Vec<&'a [u8]>),
    /// It names columns, but x, y and z are not to be found.
    Unknown,
    /// It is a title, or whatever people write.
    Nothing,
}

impl<'a> Header<'a> {
    fn put(&mut self, line: &'a [u8]) {
        if self.names.len() == KEPT_LINES {
            self.names.remove(0);
        }
        self.names.push(line);
    }

    /// How `line` can be read.
    fn read(&self, line: &'a [u8]) -> Line<'a> {
        let (mut unclear, mut short, mut bare) = (None, None, None);
        for (separator, decimal) in WAYS {
            let dialect = |columns| Dialect { separator, decimal, columns, counts: Counts::None };
            let tokens: Vec<&[u8]> = columns_of(line, separator).map(<[u8]>::trim_ascii).collect();
            let width = tokens.iter().rposition(|token| !token.is_empty()).map_or(0, |last| last + 1);
            let numbers = tokens.iter().filter(|token| dialect([0; 3]).number(token).is_some()).count();
            if numbers < 3 {
                continue;
            }
            // A number in front of as many as there are names is a row's own, which no name stands for.
            let numbered = tokens[0].iter().all(u8::is_ascii_digit);
            let commented = self.comment.into_iter().map(|line| (line, true));
            let mut told = false;
            for (named, is_comment) in self.names.iter().rev().map(|line| (*line, false)).chain(commented) {
                match says(named, separator, width, numbered, is_comment) {
                    Says::Columns(columns, names) => {
                        let dialect = dialect(columns);
                        match dialect.parse(line, &columns, &mut [0.0; 3]) {
                            Ok(()) => return Line::Data(dialect, names.into_iter().map(spelt).collect()),
                            Err((index, found)) => short = short.or(Some((columns[index], found))),
                        }
                        told = true;
                        break;
                    }
                    Says::Unknown => unclear = unclear.or(Some(named)),
                    Says::Nothing => {}
                }
            }
            if !told && bare.is_none() && dialect([0, 1, 2]).parse(line, &[0, 1, 2], &mut [0.0; 3]).is_ok() {
                bare = Some(dialect([0, 1, 2]));
            }
        }
        match (unclear, short, bare) {
            (Some(named), ..) => Line::Unclear(named),
            (None, Some((column, found)), _) => Line::Short(column, found),
            (None, None, Some(dialect)) => Line::Data(dialect, Vec::new()),
            (None, None, None) => Line::Other,
        }
    }
}

/// What `line` says of data of `width` columns below, whose first is a whole number if it is `numbered`.
fn says(line: &[u8], separator: Separator, width: usize, numbered: bool, is_comment: bool) -> Says<'_> {
    let own = names_in(columns_of(line, separator));
    // `//X Y Z` also stands above data with commas.
    let any = names_in(line.split(is_any_separator).filter(|n| !n.is_empty()));
    // Between tabs, names may have blanks in them.
    let tabs = names_in(line.split(|&b| b == b'\t'));
    let mut unknown = false;
    for (names, by_blanks) in [(own, separator == Separator::Blanks), (tabs, true), (any, true)] {
        if names.len() == 1 {
            continue;
        }
        let places = named(&names);
        if let Ok([Some(x), Some(y), Some(z)]) = places {
            // Of names with blanks in them, only those in front are surely where their columns are.
            let astray = by_blanks && names.len() > width && [x, y, z].iter().any(|&column| column > 2);
            let unnamed = numbered && names.len() + 1 == width && !is_comment;
            if !astray && !unnamed {
                return Says::Columns([x, y, z], names);
            }
            unknown = true;
        }
        let known = places.map_or(3, |places| places.iter().flatten().count());
        let exact = names.iter().any(|name| matches!(name.to_ascii_lowercase().as_slice(), b"x" | b"y" | b"z"));
        let as_many = names.len() == width || (!by_blanks && names.len() >= 3);
        unknown |= match is_comment {
            // Most comments are prose.
            true => names.len() == width && (known > 0 || names.first().is_some_and(|name| is_identifier(name))),
            false => exact || as_many || known >= 2,
        };
    }
    if unknown { Says::Unknown } else { Says::Nothing }
}

/// Columns with names, and with numbers in the lines at the beginning of `data`, the last of which may be cut.
fn own_attributes(dialect: &Dialect, names: &[String], data: &[u8]) -> Vec<(Attribute, usize)> {
    let whole = memchr::memrchr(b'\n', data).map_or(data, |end| &data[..end]);
    let mut scalars = vec![Some(Scalar::U8); names.len()];
    for (_, range) in lines(whole) {
        let line = whole[range].trim_ascii();
        // What is no point at all says nothing of its columns.
        if dialect.parse(line, &dialect.columns, &mut [0.0; 3]).is_err() {
            continue;
        }
        let mut tokens = columns_of(line, dialect.separator);
        for scalar in &mut scalars {
            *scalar = tokens.next().and_then(|token| dialect.number(token.trim_ascii())).and_then(|value| {
                let small = (0.0..=255.0).contains(&value) && value.fract() == 0.0;
                scalar.map(|scalar| if small { scalar } else { Scalar::F64 })
            });
        }
    }
    let mut seen = std::collections::HashSet::new();
    let mut out = Vec::new();
    for (column, (name, scalar)) in names.iter().zip(scalars).enumerate() {
        if !dialect.columns.contains(&column) && !name.is_empty() && seen.insert(name) {
            out.extend(scalar.map(|scalar| (Attribute { name: name.clone(), scalar }, column)));
        }
    }
    out
}

/// The names of a line: without quotes, and without a unit in brackets, which may stand on its own where blanks separate.
fn names_in<'a>(tokens: impl Iterator<Item = &'a [u8]>) -> Vec<&'a [u8]> {
    let mut names: Vec<&[u8]> = Vec::new();
    for token in tokens {
        let name = unquoted(token);
        let opening =
            name.iter().position(|b| matches!(b, b'[' | b'(')).filter(|_| matches!(name.last(), Some(b']' | b')')));
        match opening {
            Some(0) if !names.is_empty() => {}
            Some(at) if at > 0 => names.push(name[..at].trim_ascii()),
            _ => names.push(name),
        }
    }
    names
}

/// Families of names of coordinates, the surest first. Where names of several are there, those of the surest count.
const FAMILIES: [[&[&str]; 3]; 4] = [
    [
        &[
            "x",
            "xcoord",
            "xcoordinate",
            "coordx",
            "coordinatex",
            "pointx",
            "posx",
            "xpos",
            "positionx",
            "utmx",
            "cartesianx",
            "centroidx",
        ],
        &[
            "y",
            "ycoord",
            "ycoordinate",
            "coordy",
            "coordinatey",
            "pointy",
            "posy",
            "ypos",
            "positiony",
            "utmy",
            "cartesiany",
            "centroidy",
        ],
        &[
            "z",
            "zcoord",
            "zcoordinate",
            "coordz",
            "coordinatez",
            "pointz",
            "posz",
            "zpos",
            "positionz",
            "utmz",
            "cartesianz",
            "centroidz",
        ],
    ],
    [
        &["easting", "eastings", "east", "utmeasting", "utme", "rechtswert", "ostwert"],
        &["northing", "northings", "north", "utmnorthing", "utmn", "hochwert", "nordwert"],
        &[
            "elevation",
            "elev",
            "height",
            "zellipsoid",
            "zellipsoidal",
            "ellipsoidalheight",
            "heightellipsoidal",
            "ellipsoidheight",
            "zorthometric",
            "zortho",
            "orthometricheight",
            "orthoheight",
            "hoehe",
            "höhe",
        ],
    ],
    [&["e"], &["n"], &["h"]],
    [
        &["lon", "long", "lng", "longitude", "xlon", "xlongitude"],
        &["lat", "latitude", "ylat", "ylatitude"],
        &["alt", "altitude", "zalt", "zaltitude"],
    ],
];

/// Units that names end with: `X_m`, `Height_ft`.
const UNITS: [&str; 10] = ["m", "ft", "cm", "mm", "km", "meters", "metres", "feet", "deg", "usft"];

/// The axis that a name means, the family it is of, and whether it is spelt in full.
fn meaning(name: &[u8]) -> Option<(usize, usize, bool)> {
    let name = std::str::from_utf8(name).ok()?.to_lowercase();
    let words: Vec<&str> =
        name.split(|c: char| c.is_whitespace() || "_-./:".contains(c)).filter(|w| !w.is_empty()).collect();
    let bare = match words.split_last() {
        Some((unit, before)) if !before.is_empty() && UNITS.contains(unit) => before.concat(),
        _ => words.concat(),
    };
    let bare = bare.strip_prefix("scalar").unwrap_or(&bare);
    FAMILIES.iter().enumerate().find_map(|(family, axes)| {
        let axis = axes.iter().position(|names| names.contains(&bare))?;
        Some((axis, family, axes[axis][0] == name))
    })
}

/// Where x, y and z stand by their names; `Err` if a name stands for one of them twice.
fn named(names: &[&[u8]]) -> std::result::Result<[Option<usize>; 3], ()> {
    // By family and axis: the column, and whether another claims the same.
    let mut places = [[None::<(usize, bool)>; 3]; FAMILIES.len()];
    let mut twice = [[false; 3]; FAMILIES.len()];
    for (column, name) in names.iter().enumerate() {
        let Some((axis, family, full)) = meaning(name) else { continue };
        match &mut places[family][axis] {
            Some((_, known)) if *known => {}
            Some(place) if full => *place = (column, true),
            Some(_) => twice[family][axis] = true,
            place => *place = Some((column, full)),
        }
    }
    let column = |family: usize, axis: usize| places[family][axis].map(|(column, _)| column);
    let clash = |family: usize, axis: usize| twice[family][axis] && !places[family][axis].is_some_and(|(_, full)| full);
    let plane = (0..FAMILIES.len()).find(|&f| column(f, 0).is_some() && column(f, 1).is_some());
    let height = (0..FAMILIES.len()).find(|&f| column(f, 2).is_some());
    if plane.is_some_and(|f| clash(f, 0) || clash(f, 1)) || height.is_some_and(|f| clash(f, 2)) {
        return Err(());
    }
    let any = |axis| (0..FAMILIES.len()).find_map(|f| column(f, axis));
    let [x, y] = [0, 1].map(|axis| plane.map_or_else(|| any(axis), |f| column(f, axis)));
    // Without a pair of one family, one of them is not known.
    let y = if plane.is_none() && x.is_some() { None } else { y };
    Ok([x, y, any(2)])
}

/// Whether a name says what a point is called.
fn is_identifier(name: &[u8]) -> bool {
    let bare: Vec<u8> = name.iter().filter(|b| b.is_ascii_alphanumeric()).map(u8::to_ascii_lowercase).collect();
    matches!(
        &bare[..],
        b"id"
            | b"fid"
            | b"oid"
            | b"objectid"
            | b"pointid"
            | b"ptid"
            | b"point"
            | b"pt"
            | b"nr"
            | b"no"
            | b"number"
            | b"index"
            | b"name"
            | b"label"
    )
}

fn spelt(name: &[u8]) -> String {
    canonical(&String::from_utf8_lossy(name))
}

fn is_any_separator(byte: &u8) -> bool {
    matches!(byte, b',' | b';' | b' ' | b'\t')
}

fn unquoted(name: &[u8]) -> &[u8] {
    let name = name.trim_ascii();
    let name = name.strip_prefix(b"\"").unwrap_or(name);
    name.strip_suffix(b"\"").unwrap_or(name)
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
        self.parse_by(line, columns, &|place| columns.iter().position(|&column| column == place), values)
    }

    /// The same, where `index` finds a column among `columns`.
    fn parse_by<'a>(
        &self,
        line: &'a [u8],
        columns: &[usize],
        index: &impl Fn(usize) -> Option<usize>,
        values: &mut [f64],
    ) -> std::result::Result<(), (usize, &'a [u8])> {
        // One loop per separator, so that splitting is inlined into it.
        match self.separator {
            Separator::Blanks => self.pick(blanks(line), columns, index, values),
            Separator::Comma => self.pick(line.split(|&b| b == b','), columns, index, values),
            Separator::Semicolon => self.pick(line.split(|&b| b == b';'), columns, index, values),
        }
    }

    fn pick<'a>(
        &self,
        tokens: impl Iterator<Item = &'a [u8]>,
        columns: &[usize],
        index: &impl Fn(usize) -> Option<usize>,
        values: &mut [f64],
    ) -> std::result::Result<(), (usize, &'a [u8])> {
        let mut missing = columns.len();
        let mut seen = 0;
        for (place, token) in tokens.enumerate() {
            if let Some(index) = index(place) {
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
        Ok(Box::new(TextCutter { lines, reading: Arc::new(reading) }))
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

struct TextCutter {
    lines: LineCutter,
    reading: Arc<Reading>,
}

impl<'a> BlockCutter<'a> for TextCutter {
    fn next(&mut self) -> Result<Option<Box<dyn Decode + 'a>>> {
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
        let Reading { path, dialect, columns, index, names, placing } = &*self.reading;
        let index = |place: usize| index.get(place).copied().flatten();
        let mut values = vec![0.0; columns.len()];
        for (number_of_line, range) in lines(&self.lines.bytes) {
            let line = self.lines.bytes[range].trim_ascii();
            match dialect.parse_by(line, columns, &index, &mut values) {
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

    use super::super::testing::collect;
    use super::*;
    use crate::input::InputOptions;

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
    fn usual_names_of_coordinates_are_known() {
        let expected = vec![[10.5, 20.5, 30.5], [11.5, 20.75, 30.25]];
        let rows = ["1,10.5,20.5,30.5,7", "2,11.5,20.75,30.25,8"];
        for header in [
            "id,x,y,height,i",
            "id,x [m],y [m],z [m],i",
            "id,easting,northing,z,i",
            "id,POINT_X,POINT_Y,POINT_Z,i",
            "id,X_m,Y_m,Z_m,i",
            "id,lon,lat,alt,i",
            "ID,Longitude,Latitude,Altitude,i",
            "\"Id\",\"Easting (m)\",\"Northing (m)\",\"Elevation (m)\",i",
            "P,E,N,H,i",
            "id,X,Y,Z_ellipsoid,i",
            "id,x-coordinate,y-coordinate,Elev_ft,i",
            "height_ref,X,Y,Z,height",
            "lat,x,y,z,lon",
            "survey of the 3rd of May\nid,x,y,z,i\n-,m,m,m,-",
            "# id x y z i",
            "//id,Easting,Northing,Height,i",
        ] {
            for (separator, name) in [(",", "commas"), (";", "semicolons"), ("\t", "tabs")] {
                let text = format!("{header}\n{}\n{}\n", rows[0], rows[1]).replace(',', separator);
                assert_eq!(read(text.as_bytes()).unwrap().0, expected, "{header} with {name}");
            }
        }
        let swapped = b"Northing Easting Height\n20.5 10.5 30.5\n20.75 11.5 30.25\n";
        assert_eq!(read(swapped).unwrap().0, expected);
        let units = b"x [m] y [m] z [m] t\n10.5 20.5 30.5 1\n11.5 20.75 30.25 2\n";
        assert_eq!(read(units).unwrap().0, expected);
    }

    #[test]
    fn a_header_that_does_not_tell_the_coordinates_is_refused_and_quoted() {
        for header in [
            "id,a,b,c",
            "id,x,y,value",
            "id,lat,z,c",
            "id,x_left,x_right,z",
            "id,z_ortho,z_ellipsoid,y",
            "id,easting,lat,height",
            "# id a b c",
            // One name short, as R writes row names.
            "x,y,z",
        ] {
            let error =
                read(format!("{header}\n1,10.5,20.5,30.5\n2,11.5,20.7,30.1\n").as_bytes()).unwrap_err().to_string();
            let bare = header.trim_start_matches('#');
            assert!(error.contains(&format!("{bare:?}")) && error.contains("line 2"), "{header}: {error}");
        }
        // Names with blanks do not tell where their columns are.
        let error = read(b"Point ID x y z Scalar field\n1 10 20 30 5\n").unwrap_err().to_string();
        assert!(error.contains("Point ID"), "{error}");
    }

    #[test]
    fn thousands_of_columns_are_read_and_a_header_too_long_is_named() {
        let table = |columns: usize| {
            let names: String = (0..columns).map(|i| format!(",a{i}")).collect();
            let row: String = (0..columns).map(|i| format!(",{}", i % 9)).collect();
            format!("x,y,z{names}\n1,2,3{row}\n4,5,6{row}\n")
        };
        assert_eq!(read(table(3000).as_bytes()).unwrap().0, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        let error = read(table(20_000).as_bytes()).unwrap_err().to_string();
        assert!(error.contains("line 1") && error.contains("65536"), "{error}");
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
            ("x y intensity\n1 2 3\n", ["line 2", "x, y and z", "x y intensity"]),
            ("hello\nworld\n", ["line 1", "three numbers", "hello"]),
            ("1 2\n3 4 5\n", ["line 1", "three numbers", "\"1 2\""]),
            ("id,x,y,z\n1,2,3,\n4,5,6,7\n", ["line 2", "column 4", "\"\""]),
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
