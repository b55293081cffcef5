//! Dialects of text: what separates columns, and whole parts from fractions.

use crate::format::lines::{blanks, number};

/// What separates columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Separator {
    /// Any number of spaces and tabs.
    Blanks,
    Comma,
    Semicolon,
}

/// What separates a number's whole part from its fraction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Decimal {
    Point,
    PointOrComma,
}

/// The ways to read a line, in the order in which they are tried. `1,5 2,5 3,5` has four columns by commas, but `5 2`
/// is no number.
pub(super) const WAYS: [(Separator, Decimal); 4] = [
    (Separator::Semicolon, Decimal::PointOrComma),
    (Separator::Comma, Decimal::Point),
    (Separator::Blanks, Decimal::Point),
    (Separator::Blanks, Decimal::PointOrComma),
];

/// Whether lines with a single whole number stand between the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Counts {
    None,
    Skipped,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Dialect {
    pub(super) separator: Separator,
    pub(super) decimal: Decimal,
    /// Where x, y and z stand, counted from 0.
    pub(super) columns: [usize; 3],
    pub(super) counts: Counts,
}

/// The columns of a line.
pub(super) fn columns_of(line: &[u8], separator: Separator) -> Box<dyn Iterator<Item = &[u8]> + '_> {
    match separator {
        Separator::Blanks => Box::new(blanks(line)),
        Separator::Comma => Box::new(line.split(|&b| b == b',')),
        Separator::Semicolon => Box::new(line.split(|&b| b == b';')),
    }
}

/// The text of a comment, if the line is one.
pub(super) fn comment(line: &[u8]) -> Option<&[u8]> {
    line.strip_prefix(b"#").or_else(|| line.strip_prefix(b"//")).or_else(|| line.strip_prefix(b";"))
}

/// Whether a line is a single whole number.
pub(super) fn is_count(line: &[u8]) -> bool {
    line.len() <= 19 && line.iter().all(u8::is_ascii_digit)
}

/// Whether a line has numbers and nothing else, but too few of them: a point that lacks something, no header.
pub(super) fn is_short_of_numbers(line: &[u8]) -> bool {
    WAYS.into_iter().any(|(separator, decimal)| {
        let dialect = Dialect { separator, decimal, columns: [0, 1, 2], counts: Counts::None };
        let filled = || columns_of(line, separator).filter(|token| !token.trim_ascii().is_empty());
        filled().count() == 2 && filled().all(|token| dialect.number(token.trim_ascii()).is_some())
    })
}

/// Whether a line has three numbers or more if quotes round them are left out.
pub(super) fn has_quoted_numbers(line: &[u8]) -> bool {
    WAYS.into_iter().any(|(separator, decimal)| {
        let dialect = Dialect { separator, decimal, columns: [0, 1, 2], counts: Counts::None };
        columns_of(line, separator).filter(|token| dialect.number(unquoted(token)).is_some()).count() >= 3
    }) && line.contains(&b'"')
}

/// A token without the quotes round it.
pub(super) fn unquoted(name: &[u8]) -> &[u8] {
    let name = name.trim_ascii();
    let name = name.strip_prefix(b"\"").unwrap_or(name);
    name.strip_suffix(b"\"").unwrap_or(name)
}

impl Dialect {
    /// Reads the numbers in `columns` of a line; or tells which of them, and the text where there is no number.
    pub(super) fn parse<'a>(
        &self,
        line: &'a [u8],
        columns: &[usize],
        values: &mut [f64],
    ) -> std::result::Result<(), (usize, &'a [u8])> {
        self.parse_by(line, columns, &|place| columns.iter().position(|&column| column == place), values)
    }

    /// The same, where `index` finds a column among `columns`.
    pub(super) fn parse_by<'a>(
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

    pub(super) fn number(&self, token: &[u8]) -> Option<f64> {
        number(token).or_else(|| {
            let comma = (self.decimal == Decimal::PointOrComma).then(|| memchr::memchr(b',', token))??;
            let mut pointed = token.to_vec();
            pointed[comma] = b'.';
            number(&pointed)
        })
    }
}
