//! Where points were scanned from: as their files tell, or as somebody says of each scan.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use crate::error::{Error, Result};

/// Where points were scanned from.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum SeenFrom {
    /// As files tell, which E57 files with poses do.
    #[default]
    AsTold,
    /// Whatever files tell, nothing is known.
    Unknown,
    /// All points from one place.
    Place([f64; 3]),
    /// Each scan from its place, by the number that its points have as their attribute `scan`; where no file has that, `point_source_id`.
    Scans(Arc<BTreeMap<i64, [f64; 3]>>),
}

/// The attributes that tell a point's scan; the first that any file has counts.
pub const SCAN: [&str; 2] = ["scan", "point_source_id"];

/// The longest file of places.
const LONGEST: u64 = 16 << 20;

impl SeenFrom {
    /// Whether an attribute of this name must be read, whether the mesh carries it or not.
    pub(crate) fn looks_at(&self, name: &str) -> bool {
        matches!(self, SeenFrom::Scans(_)) && SCAN.contains(&name)
    }

    /// Reads the places of scans: a line for each, with its number and three coordinates. Empty lines, and what follows a `#`, say nothing.
    ///
    /// # Errors
    /// [`Error::Malformed`] for a line of anything else, a scan that has two places, a file without places, or one of more than 16 MiB; [`Error::Io`].
    pub fn read(path: &Path) -> Result<SeenFrom> {
        let file = std::fs::File::open(path).map_err(Error::io(path, "open"))?;
        let mut text = String::new();
        file.take(LONGEST + 1).read_to_string(&mut text).map_err(Error::io(path, "read"))?;
        if text.len() as u64 > LONGEST {
            return Err(Error::malformed(path, "length", format!("at most {LONGEST} bytes"), "more"));
        }
        SeenFrom::parse(path, &text)
    }

    fn parse(path: &Path, text: &str) -> Result<SeenFrom> {
        let mut places = BTreeMap::new();
        for (number, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
            let words = line.split('#').next().unwrap_or_default();
            let words: Vec<&str> = words.split([' ', '\t', ',', ';', '\r']).filter(|word| !word.is_empty()).collect();
            if words.is_empty() {
                continue;
            }
            let wrong = |expected: &str| Error::malformed(path, format!("line {}", number + 1), expected, line.trim());
            let place = || {
                let [scan, x, y, z] = words[..] else { return None };
                let coordinate = |word: &str| word.parse().ok().filter(|c: &f64| c.is_finite());
                Some((scan.parse::<i64>().ok()?, [coordinate(x)?, coordinate(y)?, coordinate(z)?]))
            };
            let (scan, place) =
                place().ok_or_else(|| wrong("a scan's number and the three coordinates of its place"))?;
            if places.insert(scan, place).is_some_and(|known| known != place) {
                return Err(wrong("one place for each scan"));
            }
        }
        if places.is_empty() {
            return Err(Error::malformed(path, "the file", "a line for each scan", "none"));
        }
        Ok(SeenFrom::Scans(Arc::new(places)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<SeenFrom> {
        SeenFrom::parse(Path::new("places.txt"), text)
    }

    #[test]
    fn places_are_read_line_by_line() {
        let SeenFrom::Scans(places) = parsed("# places\n0 1 2 3\n\n 7, -1.5e0, 0,4 # the last\n0 1 2 3\n").unwrap()
        else {
            panic!("scans have places")
        };
        assert_eq!(
            places.iter().map(|(scan, place)| (*scan, *place)).collect::<Vec<_>>(),
            [(0, [1.0, 2.0, 3.0]), (7, [-1.5, 0.0, 4.0])]
        );
        for wrong in ["", "# none", "1 2 3", "1 2 3 4 5", "a 1 2 3", "1.5 1 2 3", "0 1 2 nan", "0 1 2 3\n0 1 2 4"] {
            assert!(matches!(parsed(wrong), Err(Error::Malformed { .. })), "{wrong:?}");
        }
    }
}
