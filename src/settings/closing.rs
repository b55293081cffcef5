//! Options of the closing: which holes are closed, and which components are kept.

use std::str::FromStr;

/// How holes are closed. Lengths are in the unit of the coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Sealing {
    /// However wide they are: the outside and the inside are told apart by the samples on both sides of a hole's rim.
    #[default]
    Auto,
    /// By a ball of this radius, in cells.
    Cells(u32),
    /// By a ball of this radius, in the input's units.
    Length(f64),
    /// Only those that a ball of one cell closes.
    Off,
}

/// Which components are kept.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Least {
    /// All but specks: components of fewer than 64 cells and less than a thousandth of the largest's. If these together have a fiftieth of all cells or more,
    /// they are no accident, and all are kept.
    #[default]
    Auto,
    /// Those of at least so many cells.
    Cells(u64),
    /// Those of at least this share of the largest's cells, from 0 to 1.
    Share(f64),
    /// The largest; several if they have equally many cells.
    Largest,
}

impl FromStr for Least {
    type Err = String;

    /// `auto`, `largest`, a share such as `1%`, or a number of cells.
    fn from_str(text: &str) -> std::result::Result<Least, String> {
        let wrong = || {
            format!(
                "expected a number of cells, a share of the largest such as 1%, `largest` or `auto`, found {text:?}"
            )
        };
        match text {
            "auto" => return Ok(Least::Auto),
            "largest" => return Ok(Least::Largest),
            _ => {}
        }
        match text.strip_suffix('%') {
            Some(percent) => {
                let percent: f64 = percent.trim().parse().map_err(|_| wrong())?;
                if (0.0..=100.0).contains(&percent) { Ok(Least::Share(percent / 100.0)) } else { Err(wrong()) }
            }
            None => text.parse().map(Least::Cells).map_err(|_| wrong()),
        }
    }
}
