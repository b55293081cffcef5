//! Surfaces that are not closed: what is asked of them, and the grid they need.

use std::str::FromStr;

use crate::error::{Error, Result};
use crate::grid::dilate::Ball;
use crate::grid::{Axis, AxisChoice, Bounds, Cell, Grid, Resolution, Turn};
use crate::solid::close::Sealing;
use crate::solid::heightfield::{Up, margin};

/// What a surface that is not closed is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Of what was scanned from one side.
    Sheet,
    /// Of ground, seen from above.
    Terrain,
}

/// Where a surface was seen from.
#[derive(Debug, Clone, Copy, PartialEq)]
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
    /// From where its files say that scans were taken: the direction is that of [`crate::grid::survey::seen_from`].
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

    /// How the grid is turned, for points in `bounds`; none if it is not.
    ///
    /// # Errors
    /// [`Error::Usage`] if that is no direction.
    pub fn turn(self, bounds: &Bounds) -> Result<Option<Turn>> {
        if matches!(self, Facing::Along { .. }) {
            return Ok(None);
        }
        let turn = Turn::up(self.direction(bounds))
            .ok_or_else(|| Error::Usage(format!("--facing {self}: is no direction from the points")))?;
        Ok(Some(turn))
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

/// The width of a hole.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Hole {
    /// In cells.
    Cells(u32),
    /// In the input's units.
    Length(f64),
}

impl Hole {
    /// The widest hole that is bridged unless told otherwise: about twenty sampling distances. On an airborne tile of 10 million points twelve holes stay open, ponds
    /// by their looks.
    pub const DEFAULT: Hole = Hole::Cells(16);

    /// The radius, in cells of side `w`, of the disc that bridges it, rounded up.
    fn radius(self, w: f64) -> f64 {
        match self {
            Hole::Cells(cells) => f64::from(cells.div_ceil(2)),
            Hole::Length(length) => (length / w / 2.0).ceil(),
        }
    }
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

/// What is asked of a surface that is not closed.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Open {
    /// What it is of.
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

    /// The grid for `points` points in `bounds`, a box of the grid's own coordinates, with room round them.
    ///
    /// # Errors
    /// Those of [`Grid::new`]; [`Error::Usage`] if slices would lie across what is seen, or if points lie below the base.
    pub fn grid(
        &self,
        points: u64,
        bounds: &Bounds,
        resolution: Resolution,
        choice: AxisChoice,
        smooth: u32,
    ) -> Result<Grid> {
        let (up, positive) = self.facing.axis();
        let axis = match choice {
            AxisChoice::Fixed(axis) if axis == up => {
                return Err(Error::Usage(format!(
                    "--axis {}: a slice must hold whole columns of what is seen from {}; choose another axis",
                    axis.letter(),
                    self.facing
                )));
            }
            AxisChoice::Fixed(axis) => axis,
            AxisChoice::Longest => {
                let mut extent = bounds.extent();
                extent[up.index()] = f64::NEG_INFINITY;
                let longest = extent.into_iter().fold(f64::NEG_INFINITY, f64::max);
                let axis = Axis::ALL.into_iter().find(|axis| extent[axis.index()] == longest);
                axis.unwrap_or(Axis::X)
            }
        };
        let mut bounds = *bounds;
        if let Some(base) = self.base {
            let lowest = bounds.min[up.index()];
            if !base.is_finite() || base > lowest {
                return Err(Error::Usage(format!("--base {base}: must not lie above the lowest point, {lowest}")));
            }
            bounds.min[up.index()] = base;
        }
        let grid = Grid::new(points, &bounds, resolution, AxisChoice::Fixed(axis))?;
        let mut below: Cell = [margin(smooth); 3];
        let mut above = below;
        let along = self.up(&grid).axis;
        (below[along], above[along]) = match (positive, self.base) {
            (_, Some(_)) => (0, 0),
            (true, None) => (margin(smooth), 0),
            (false, None) => (0, margin(smooth)),
        };
        grid.with_margin(below, above)
    }

    /// The direction it was seen from, on a grid.
    pub fn up(&self, grid: &Grid) -> Up {
        let axes = grid.axis().file_axes();
        let (up, positive) = self.facing.axis();
        Up { axis: if axes[0] == up.index() { 0 } else { 2 }, positive }
    }

    /// The radius of the disc that bridges holes, in cells.
    pub fn bridge(&self, grid: &Grid) -> u32 {
        let longest = grid.cells().into_iter().max().unwrap_or(1);
        self.max_hole.radius(grid.cell_size()).min(f64::from(longest)) as u32
    }

    /// The highest step, in cells, whose wall a sheet keeps: as wide as the widest hole.
    pub fn jump(&self, grid: &Grid) -> Option<u32> {
        (self.kind == Kind::Sheet).then(|| 2 * self.bridge(grid))
    }

    /// The ball that rolls over the surface: of radius 1.5, unless another is asked for.
    pub fn ball(&self, seal: Sealing, window: Option<u32>, cell_size: f64) -> Ball {
        let most = window.map_or(u32::MAX, |w| (w - 1) / 2);
        match seal.radius(cell_size) {
            None => Ball::squared(2),
            Some(radius) => Ball::new(radius.min(most)),
        }
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

    #[test]
    fn slices_hold_whole_columns() {
        let bounds = Bounds { min: [0.0; 3], max: [3.0, 5.0, 40.0] };
        let grid = |open: Open, choice| open.grid(100, &bounds, Resolution::Cell(1.0), choice, 1);
        let terrain = grid(Open::TERRAIN, AxisChoice::Longest).unwrap();
        let m = margin(1);
        assert_eq!((terrain.axis(), terrain.cells()), (Axis::Y, [3 + 2 * m, 5 + 2 * m, 40 + m]));
        assert_eq!(Open::TERRAIN.up(&terrain), Up { axis: 2, positive: true });
        assert_eq!(terrain.cell_of([0.5; 3]), [m; 3]);
        assert!(matches!(grid(Open::TERRAIN, AxisChoice::Fixed(Axis::Z)), Err(Error::Usage(_))));

        let sheet = Open { kind: Kind::Sheet, facing: "-x".parse().unwrap(), ..Open::TERRAIN };
        let across = grid(sheet, AxisChoice::Longest).unwrap();
        assert_eq!((across.axis(), sheet.up(&across)), (Axis::Z, Up { axis: 2, positive: false }));
        assert_eq!(across.cells(), [5 + 2 * m, 40 + 2 * m, 3 + m]);

        let based = grid(Open { base: Some(-2.0), ..Open::TERRAIN }, AxisChoice::Fixed(Axis::X)).unwrap();
        assert_eq!((based.bounds().min[2], based.cells()), (-2.0, [42, 3 + 2 * m, 5 + 2 * m]));
        assert!(grid(Open { base: Some(0.1), ..Open::TERRAIN }, AxisChoice::Longest).is_err());
    }
}
