//! Text, line by line, of bounded length.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Result as IoResult};
use std::path::Path;
use std::str::FromStr;

use super::Input;
use crate::error::{Error, Result};
use crate::system::FileAt;

/// The longest line: a polygon of a hundred thousand corners.
const LONGEST: u64 = 1 << 20;

/// A file from its start on, whatever place others have read from meanwhile: on Windows, the file's own moves with them.
pub(crate) struct FromStart<'a> {
    file: &'a File,
    at: u64,
}

impl Read for FromStart<'_> {
    fn read(&mut self, out: &mut [u8]) -> IoResult<usize> {
        let bytes = self.file.read_at(out, self.at)?;
        self.at += bytes as u64;
        Ok(bytes)
    }
}

/// The lines of a file, one in memory at a time.
pub(crate) struct Lines<'a> {
    path: &'a Path,
    reader: BufReader<FromStart<'a>>,
    number: u64,
    bytes: Vec<u8>,
    line: String,
}

impl<'a> Lines<'a> {
    /// The lines from the file's start on.
    pub fn new(input: &'a Input) -> Lines<'a> {
        Lines::behind(input, 0, 0)
    }

    /// The lines from byte `at` on, before which there are `number` lines.
    pub fn behind(input: &'a Input, at: u64, number: u64) -> Lines<'a> {
        Lines {
            path: input.path,
            reader: BufReader::with_capacity(1 << 16, FromStart { file: &input.file, at }),
            number,
            bytes: Vec::new(),
            line: String::new(),
        }
    }

    /// Goes to the next line; `false` at the end of the file.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Malformed`] if the line is longer than a MiB.
    pub fn advance(&mut self) -> Result<bool> {
        self.bytes.clear();
        let mut limited = (&mut self.reader).take(LONGEST);
        let read = limited.read_until(b'\n', &mut self.bytes).map_err(Error::io(self.path, "read"))?;
        self.number += 1;
        if read as u64 == LONGEST {
            return Err(self.malformed("a line of less than 1 MiB", "a longer one"));
        }
        self.line.clear();
        self.line.push_str(&String::from_utf8_lossy(&self.bytes));
        Ok(read > 0)
    }

    /// The current line, without white space at its ends.
    pub fn line(&self) -> &str {
        self.line.trim()
    }

    /// The file behind the lines, at the byte after the current one.
    pub fn into_rest(self) -> BufReader<FromStart<'a>> {
        self.reader
    }

    /// An [`Error::Malformed`] about the current line.
    pub fn malformed(&self, expected: impl std::fmt::Display, found: impl std::fmt::Display) -> Error {
        Error::malformed(self.path, format!("line {}", self.number), expected, found)
    }

    /// A word of the current line as a number.
    ///
    /// # Errors
    /// [`Error::Malformed`] if it is none, or missing.
    pub fn number<T: FromStr>(&self, word: Option<&str>, expected: &str) -> Result<T> {
        let Some(word) = word else { return Err(self.malformed(expected, "the end of the line")) };
        word.parse().map_err(|_| self.malformed(expected, format_args!("{:?}", shortened(word))))
    }
}

/// The beginning of a word that may be long.
pub(crate) fn shortened(word: &str) -> String {
    word.chars().take(40).collect()
}
