//! How many triangles are left of a mesh.

use std::str::FromStr;

use crate::error::{Error, Result};

/// How far a simplified surface may be from the surface it was made from.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Tolerance {
    /// In the mesh's units.
    Length(f64),
    /// In cells.
    Cells(f64),
    /// In per cents of the longest side of the mesh's box.
    Percent(f64),
}

impl FromStr for Tolerance {
    type Err = String;

    /// A length, cells as in `0.25c`, or per cents of the longest side as in `0.01%`.
    fn from_str(text: &str) -> std::result::Result<Tolerance, String> {
        let (number, kind): (&str, fn(f64) -> Tolerance) = if let Some(cells) = text.strip_suffix('c') {
            (cells, Tolerance::Cells)
        } else if let Some(share) = text.strip_suffix('%') {
            (share, Tolerance::Percent)
        } else {
            (text, Tolerance::Length)
        };
        match number.parse::<f64>() {
            Ok(number) if number >= 0.0 && number.is_finite() => Ok(kind(number)),
            _ => Err(format!("expected a length, cells such as 0.25c, or a share such as 0.01%, found {text:?}")),
        }
    }
}

impl Tolerance {
    /// As a length, where a cell and the longest side of the box are so long.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if it is in cells, and nothing tells how long one is.
    pub fn length(self, cell: Option<f64>, longest: f64) -> Result<f64> {
        match (self, cell) {
            (Tolerance::Length(length), _) => Ok(length),
            (Tolerance::Percent(share), _) => Ok(share / 100.0 * longest),
            (Tolerance::Cells(cells), Some(cell)) => Ok(cells * cell),
            (Tolerance::Cells(cells), None) => Err(Error::setting(
                "simplify",
                format!(
                    "`simplify` {cells}c: the mesh does not say how long the side of a cell is; pass a length, or a share such as 0.01%"
                ),
            )),
        }
    }
}

/// What edges are not collapsed across.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Borders {
    /// Borders of classes, where vertices have a `classification`.
    #[default]
    Classification,
    /// Nothing.
    None,
}

/// What is asked of a simplification: a tolerance, a number of triangles, or both.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct Simplification {
    /// No place of either surface may be farther than this from the other.
    pub tolerance: Option<Tolerance>,
    /// No more triangles than this, if that can be. Without a tolerance it is the least one that does; within one, what costs least goes.
    pub max_triangles: Option<u64>,
    /// What edges are not collapsed across.
    pub(crate) keep_borders: Borders,
    /// No place may change its colour by more than so many steps of 255, in any channel, where vertices have `red`, `green` and `blue`. None: as much as it may.
    pub keep_colours: Option<u8>,
    /// Whether vertices may be placed anew, where that keeps nearer to the surface, with attributes between those of the vertices that they are made of. Else every
    /// vertex that is left is one of the mesh's.
    pub move_vertices: bool,
}

impl Simplification {
    const UNLIMITED: Simplification = Simplification {
        tolerance: None,
        max_triangles: None,
        keep_borders: Borders::Classification,
        keep_colours: None,
        move_vertices: false,
    };

    /// Within a tolerance.
    pub const fn within(tolerance: Tolerance) -> Simplification {
        Simplification { tolerance: Some(tolerance), ..Simplification::UNLIMITED }
    }

    /// To so many triangles, with the least tolerance.
    pub const fn to(max_triangles: u64) -> Simplification {
        Simplification { max_triangles: Some(max_triangles), ..Simplification::UNLIMITED }
    }

    /// The same, with vertices that may be placed anew, or not.
    pub const fn move_vertices(self, move_vertices: bool) -> Simplification {
        Simplification { move_vertices, ..self }
    }

    /// The same, with edges that are collapsed across borders of classes, too.
    pub const fn across_classes(self) -> Simplification {
        Simplification { keep_borders: Borders::None, ..self }
    }

    /// The same, with colours that change by no more than so many steps of 255.
    pub const fn keep_colours(self, steps: u8) -> Simplification {
        Simplification { keep_colours: Some(steps), ..self }
    }

    /// Checks what can be checked without a mesh.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`].
    pub fn validate(&self) -> Result<()> {
        if self.max_triangles == Some(0) {
            return Err(Error::setting("max_triangles", "`max_triangles` 0: at least 1 triangle".into()));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tolerances_as_typed() {
        assert_eq!("2.5".parse(), Ok(Tolerance::Length(2.5)));
        assert_eq!("0.25c".parse(), Ok(Tolerance::Cells(0.25)));
        assert_eq!("0.01%".parse(), Ok(Tolerance::Percent(0.01)));
        for wrong in ["", "c", "%", "-1", "nan", "inf", "1cc", "1 c", "auto"] {
            assert!(wrong.parse::<Tolerance>().is_err(), "{wrong}");
        }
        assert_eq!(Tolerance::Percent(50.0).length(None, 8.0).unwrap(), 4.0);
        assert_eq!(Tolerance::Cells(2.0).length(Some(0.5), 8.0).unwrap(), 1.0);
        assert!(Tolerance::Cells(2.0).length(None, 8.0).is_err());
    }
}
