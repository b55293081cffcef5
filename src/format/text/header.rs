//! What stands above the points: which columns are coordinates, and what the others are called.

use std::collections::HashSet;

use super::dialect::{Counts, Dialect, Separator, WAYS, columns_of, unquoted};
use super::names::{is_identifier, named};
use crate::format::lines::lines;
use crate::points::attribute::{Attribute, canonical};
use crate::points::scalar::Scalar;

/// The lines before the data that may name columns.
#[derive(Default)]
pub(super) struct Header<'a> {
    /// The last lines that are neither data nor comments.
    names: Vec<&'a [u8]>,
    /// The last comment.
    pub(super) comment: Option<&'a [u8]>,
}

/// Lines kept as possible headers: titles and units stand above and below the names.
const KEPT_LINES: usize = 8;

/// What a line is, as the header understands it.
pub(super) enum Line<'a> {
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
    pub(super) fn put(&mut self, line: &'a [u8]) {
        if self.names.len() == KEPT_LINES {
            self.names.remove(0);
        }
        self.names.push(line);
    }

    /// How `line` can be read.
    pub(super) fn read(&self, line: &'a [u8]) -> Line<'a> {
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
pub(super) fn own_attributes(dialect: &Dialect, names: &[String], data: &[u8]) -> Vec<(Attribute, usize)> {
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
    let mut seen = HashSet::new();
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

fn spelt(name: &[u8]) -> String {
    canonical(&String::from_utf8_lossy(name))
}

fn is_any_separator(byte: &u8) -> bool {
    matches!(byte, b',' | b';' | b' ' | b'\t')
}
