//! Options of open surfaces.

use std::str::FromStr;

use crate::points::bounds::{Axis, Bounds};

/// The kind of an open surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Something that was scanned from one side.
    Sheet,
    /// Ground, buildings and trees, seen from above.
    Terrain,
    /// Bare earth, seen from above: points on the ground alone.
    Ground,
}

/// Where a surface was seen from.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Facing {
    /// From far along an axis of the file's coordinates.
    Along {
        /// The axis.
        axis: Axis,
        /// Whether coordinates grow towards there.
        positive: bool,
    },
    /// From far in a direction.
    Direction([f64; 3]),
    /// From a place: what is looked at is taken to lie in the direction of the middle of the points' box.
    Position([f64; 3]),
    /// From where its files say that scans were taken, on average over the points.
    Poses,
}

impl Facing {
    /// The third coordinate grows upwards.
    pub const UP: Facing = Facing::Along { axis: Axis::Z, positive: true };

    /// The axis of the grid's own coordinates that points there, and whether it does by growing.
    pub fn axis(self) -> (Axis, bool) {
        match self {
            Facing::Along { axis, positive } => (axis, positive),
            Facing::Direction(_) | Facing::Position(_) | Facing::Poses => (Axis::Z, true),
        }
    }

    /// The direction to where points in `bounds` were seen from, of whatever length; none of [`Facing::Poses`], which the points alone tell.
    pub fn direction(self, bounds: &Bounds) -> [f64; 3] {
        match self {
            Facing::Along { axis, positive } => {
                let along = if positive { 1.0 } else { -1.0 };
                std::array::from_fn(|a| if a == axis as usize { along } else { 0.0 })
            }
            Facing::Direction(direction) => direction,
            Facing::Position(place) => std::array::from_fn(|a| place[a] - bounds.min[a].midpoint(bounds.max[a])),
            Facing::Poses => [0.0; 3],
        }
    }
}

impl FromStr for Facing {
    type Err = String;

    /// `+z`, `-x` and so on; `0.3,0,1`, a direction; `@2,0.5,1`, a place; `@poses`, those of the scans.
    fn from_str(text: &str) -> std::result::Result<Facing, String> {
        let known =
            Axis::ALL.into_iter().flat_map(|axis| [true, false].map(|positive| Facing::Along { axis, positive }));
        if let Some(facing) = known.into_iter().find(|facing| facing.to_string() == text) {
            return Ok(facing);
        }
        if text == "@poses" {
            return Ok(Facing::Poses);
        }
        let wrong = || {
            format!(
                "expected +x, -x, +y, -y, +z or -z, a direction such as 0.3,0,1, a position such as @2,0.5,1, or @poses, found {text:?}"
            )
        };
        let (place, numbers) = text.strip_prefix('@').map_or((false, text), |numbers| (true, numbers));
        let numbers: Vec<f64> = numbers
            .split(',')
            .map(|word| word.trim().parse().ok().filter(|c: &f64| c.is_finite()).ok_or_else(wrong))
            .collect::<std::result::Result<_, String>>()?;
        let numbers: [f64; 3] = numbers.try_into().map_err(|_| wrong())?;
        Ok(if place { Facing::Position(numbers) } else { Facing::Direction(numbers) })
    }
}

impl std::fmt::Display for Facing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Facing::Along { axis, positive } => write!(f, "{}{}", if *positive { '+' } else { '-' }, axis.letter()),
            Facing::Direction([x, y, z]) => write!(f, "{x},{y},{z}"),
            Facing::Position([x, y, z]) => write!(f, "@{x},{y},{z}"),
            Facing::Poses => f.write_str("@poses"),
        }
    }
}

impl serde::Serialize for Facing {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> serde::Deserialize<'de> for Facing {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> std::result::Result<Facing, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

/// The width of a hole.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Hole {
    /// In cells.
    Cells(u32),
    /// In the input's units.
    Length(f64),
}

impl Default for Hole {
    fn default() -> Hole {
        Hole::DEFAULT
    }
}

impl Hole {
    /// The widest hole that is bridged unless told otherwise: about twenty sampling distances. On an airborne tile of 10 million points twelve holes stay open, ponds
    /// by their looks.
    pub const DEFAULT: Hole = Hole::Cells(16);
}

impl FromStr for Hole {
    type Err = String;

    /// A length, or cells as in `8c`.
    fn from_str(text: &str) -> std::result::Result<Hole, String> {
        let expected = || format!("expected a length, or a number of cells such as 8c, found {text:?}");
        match text.strip_suffix('c') {
            Some(cells) => cells.parse().map(Hole::Cells).map_err(|_| expected()),
            None => match text.parse() {
                Ok(length) if f64::is_finite(length) && length >= 0.0 => Ok(Hole::Length(length)),
                _ => Err(expected()),
            },
        }
    }
}

/// Options of an open surface.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Open {
    /// The kind of surface.
    pub kind: Kind,
    /// From where it was seen.
    pub facing: Facing,
    /// The widest hole that is bridged.
    pub max_hole: Hole,
    /// Where the flat bottom of a closed body lies along the facing axis, if it is to be one after all.
    pub base: Option<f64>,
}

impl Open {
    /// Terrain with the usual widest hole.
    pub const TERRAIN: Open = Open { kind: Kind::Terrain, facing: Facing::UP, max_hole: Hole::DEFAULT, base: None };

    /// Bare earth with the usual widest hole.
    pub const GROUND: Open = Open { kind: Kind::Ground, ..Open::TERRAIN };

    /// A sheet that was seen from `facing`, with the usual widest hole.
    pub const fn sheet(facing: Facing) -> Open {
        Open { kind: Kind::Sheet, facing, max_hole: Hole::DEFAULT, base: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_and_holes_as_typed() {
        assert_eq!("+z".parse(), Ok(Facing::UP));
        assert_eq!("-x".parse(), Ok(Facing::Along { axis: Axis::X, positive: false }));
        assert_eq!("0.3,0,-1".parse(), Ok(Facing::Direction([0.3, 0.0, -1.0])));
        assert_eq!("@1,2,3e2".parse(), Ok(Facing::Position([1.0, 2.0, 300.0])));
        assert_eq!("@poses".parse(), Ok(Facing::Poses));
        assert_eq!("16c".parse(), Ok(Hole::Cells(16)));
        assert_eq!("2.5".parse(), Ok(Hole::Length(2.5)));
        for wrong in ["", "z", "+Z", "++z", "+w", "x+", "1,2", "@", "@pose", "poses", "1,2,nan", "1,2,3,4"] {
            assert!(wrong.parse::<Facing>().is_err(), "{wrong}");
        }
        for wrong in ["", "c", "-1", "-1c", "inf", "1.5c"] {
            assert!(wrong.parse::<Hole>().is_err(), "{wrong}");
        }
    }
}
