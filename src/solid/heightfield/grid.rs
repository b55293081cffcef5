//! The grid that a surface which is not closed needs: turned to where it was seen from, with a margin round the points.

use super::columns::{Up, margin};
use crate::error::{Error, Result};
use crate::grid::dilate::Ball;
use crate::grid::{Cell, Grid, Rotation};
use crate::points::bounds::{Axis, Bounds};
use crate::settings::closing::Sealing;
use crate::settings::open::{Facing, Hole, Kind, Open};
use crate::settings::{AxisChoice, Resolution};

impl Facing {
    /// How the grid is turned, for points in `bounds`; none if it is not.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if that is no direction.
    pub(crate) fn turn(self, bounds: &Bounds) -> Result<Option<Rotation>> {
        if matches!(self, Facing::Along { .. }) {
            return Ok(None);
        }
        let turn = Rotation::up(self.direction(bounds))
            .ok_or_else(|| Error::setting("facing", format!("`facing` {self}: is no direction from the points")))?;
        Ok(Some(turn))
    }
}

impl Hole {
    /// The radius, in cells of side `w`, of the disc that bridges it, rounded up.
    pub(crate) fn radius(self, w: f64) -> f64 {
        match self {
            Hole::Cells(cells) => f64::from(cells.div_ceil(2)),
            Hole::Length(length) => (length / w / 2.0).ceil(),
        }
    }
}

impl Open {
    /// The grid for `points` points in `bounds`, a box of the grid's own coordinates, with room round them.
    ///
    /// # Errors
    /// [`Error::Raster`], as the grid; [`Error::InvalidSetting`] if slices would lie across what is seen, or if points lie below the base.
    pub(crate) fn grid(
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
                return Err(Error::setting(
                    "axis",
                    format!(
                        "`axis` {}: a slice must hold whole columns of what is seen from {}; choose another axis",
                        axis.letter(),
                        self.facing
                    ),
                ));
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
                return Err(Error::setting(
                    "base",
                    format!("`base` {base}: must not lie above the lowest point, {lowest}"),
                ));
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
    #[doc(hidden)]
    pub fn up(&self, grid: &Grid) -> Up {
        let axes = grid.axis().file_axes();
        let (up, positive) = self.facing.axis();
        Up { axis: if axes[0] == up.index() { 0 } else { 2 }, positive }
    }

    /// The radius of the disc that bridges holes, in cells.
    #[doc(hidden)]
    pub fn bridge(&self, grid: &Grid) -> u32 {
        let longest = grid.cells().into_iter().max().unwrap_or(1);
        self.max_hole.radius(grid.cell_size()).min(f64::from(longest)) as u32
    }

    /// The highest step, in cells, whose wall a sheet keeps: as wide as the widest hole.
    #[doc(hidden)]
    pub fn jump(&self, grid: &Grid) -> Option<u32> {
        (self.kind == Kind::Sheet).then(|| 2 * self.bridge(grid))
    }

    /// The ball that rolls over the surface: of radius 1.5, unless another is asked for.
    pub(crate) fn ball(&self, seal: Sealing, window: Option<u32>, cell_size: f64) -> Ball {
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
    fn slices_hold_whole_columns() {
        let bounds = Bounds { min: [0.0; 3], max: [3.0, 5.0, 40.0] };
        let grid = |open: Open, choice| open.grid(100, &bounds, Resolution::Cell(1.0), choice, 1);
        let terrain = grid(Open::TERRAIN, AxisChoice::Longest).unwrap();
        let m = margin(1);
        assert_eq!((terrain.axis(), terrain.cells()), (Axis::Y, [3 + 2 * m, 5 + 2 * m, 40 + m]));
        assert_eq!(Open::TERRAIN.up(&terrain), Up { axis: 2, positive: true });
        assert_eq!(terrain.cell_of([0.5; 3]), [m; 3]);
        assert!(matches!(
            grid(Open::TERRAIN, AxisChoice::Fixed(Axis::Z)),
            Err(Error::InvalidSetting { name: "axis", .. })
        ));

        let sheet = Open { kind: Kind::Sheet, facing: "-x".parse().unwrap(), ..Open::TERRAIN };
        let across = grid(sheet, AxisChoice::Longest).unwrap();
        assert_eq!((across.axis(), sheet.up(&across)), (Axis::Z, Up { axis: 2, positive: false }));
        assert_eq!(across.cells(), [5 + 2 * m, 40 + 2 * m, 3 + m]);

        let based = grid(Open { base: Some(-2.0), ..Open::TERRAIN }, AxisChoice::Fixed(Axis::X)).unwrap();
        assert_eq!((based.bounds().min[2], based.cells()), (-2.0, [42, 3 + 2 * m, 5 + 2 * m]));
        assert!(grid(Open { base: Some(0.1), ..Open::TERRAIN }, AxisChoice::Longest).is_err());
    }
}
