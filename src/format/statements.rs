//! Points among other statements of a text, a line each: the `v` of OBJ, the `vertex` of STL.

use std::sync::Arc;

use super::lines::{AllLines, LineBlock, LineCutter, LineReading, blanks, lines, number, quoted};
use super::records::same_length;
use crate::error::{Error, Result};
use crate::format::point_format::{BlockCutter, PointFormat};
use crate::points::attribute::{Attribute, Placing, Schema};
use crate::points::{Coordinate, Precision};
use crate::storage::mapped::{Content, Mapped};

/// A text whose points stand behind a word.
#[derive(Debug)]
pub struct Statements {
    content: Content,
    len: u64,
    word: &'static [u8],
    attributes: Vec<Attribute>,
}

impl Statements {
    /// Points are the lines that begin with `word`: three coordinates, then one number for each attribute; where one of these is missing, all count as
    /// zero.
    pub fn new(file: &Mapped, word: &'static [u8], attributes: Vec<Attribute>) -> Statements {
        Statements { content: file.content().clone(), len: file.len(), word, attributes }
    }
}

/// Whether the line begins with this word, in letters of either case.
pub fn first_word(line: &[u8], word: &[u8]) -> bool {
    blanks(line).next().is_some_and(|first| first.eq_ignore_ascii_case(word))
}

impl PointFormat for Statements {
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
        let own: Vec<(Attribute, usize)> = self.attributes.iter().cloned().zip(3..).collect();
        let placing = Placing::new(schema, &own);
        // Numbers behind the last one that is asked for are not looked at.
        let wanted = placing.last().map_or(3, |last| last + 1);
        let reading =
            Reading { content: self.content.clone(), word: self.word, values: 3 + own.len(), wanted, placing };
        Ok(Box::new(AllLines { lines: LineCutter::new(file, 0, 1), reading: Arc::new(reading) }))
    }
}

/// What is read of a statement.
struct Reading {
    content: Content,
    word: &'static [u8],
    /// Numbers that there may be, and numbers that are read.
    values: usize,
    wanted: usize,
    placing: Placing,
}

impl LineReading for Reading {
    fn fill<C: Coordinate>(&self, block: &LineBlock, points: &mut Vec<[C; 3]>, attributes: &mut Vec<u8>) -> Result<()> {
        let Reading { content, word, values, wanted, placing } = self;
        let mut values = vec![0.0; *values];
        for (number_of_line, range) in lines(&block.bytes) {
            let mut words = blanks(&block.bytes[range]);
            if !words.next().is_some_and(|first| first.eq_ignore_ascii_case(word)) {
                continue;
            }
            values.fill(0.0);
            for index in 0..*wanted {
                let word = match words.next() {
                    Some(word) => word,
                    None if index < 3 => b"the end of the line",
                    None => {
                        values[3..].fill(0.0);
                        break;
                    }
                };
                values[index] = number(word).ok_or_else(|| {
                    let place = format!("line {}", block.first_line + number_of_line);
                    Error::malformed(content.name(), place, "a number", quoted(word))
                })?;
            }
            points.push([0, 1, 2].map(|axis| C::from_f64(values[axis])));
            placing.place(&values, attributes);
        }
        Ok(())
    }

    fn most(&self, block: &LineBlock) -> usize {
        lines(&block.bytes).filter(|(_, range)| first_word(&block.bytes[range.clone()], self.word)).count()
    }

    fn record(&self) -> usize {
        self.placing.stride()
    }
}
