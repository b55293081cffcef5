//! The grid: where coordinates become cells. Axis, slices, cell size, raster (ASRA, Eqs. 1-3).
//!
//! Eq. 1 moves the box to the origin and scales it by its longest side; instead of moving points, the grid keeps the
//! box's corner and the cell size in the world's own units. Eq. 2: s = ⌊k·∛n⌋ slices. Eq. 3: w = extent / s.

pub mod bucket;
pub mod coarse;
pub mod context;
pub mod dilate;
mod gaps;
pub mod label;
pub mod occupancy;
pub mod partition;
pub mod rank_bitmap;
pub mod slice;
pub mod survey;
pub mod trace;
pub mod window;

use std::ops::Range;

pub use self::gaps::Gaps;
use self::gaps::{GAP, SHOWS};
use crate::error::words::short;
use crate::error::{Error, Result};
use crate::points::Coordinate;
use crate::points::bounds::{Axis, Bounds};
use crate::points::vector::{cross, dot};
use crate::settings::{AxisChoice, Resolution};

/// The most cells along an axis.
pub const CELLS_LIMIT: u32 = (1 << 20) - 1;

/// A rotation of the file's axes: its rows are the turned axes, of length 1 and at right angles.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Rotation([[f64; 3]; 3]);

impl Rotation {
    /// The rotation that makes `direction` the third axis; none if it has no length, or too large a one.
    pub fn up(direction: [f64; 3]) -> Option<Rotation> {
        let unit = |p: [f64; 3]| {
            let length = dot(p, p).sqrt();
            (length.is_normal()).then(|| p.map(|c| c / length))
        };
        let up = unit(direction)?;
        // The axis that is the least along it.
        let least = (0..3).fold(0, |least, a| if up[a].abs() < up[least].abs() { a } else { least });
        let mut beside = [0.0; 3];
        beside[least] = 1.0;
        let first = unit(cross(beside, up))?;
        Some(Rotation([first, cross(up, first), up]))
    }

    /// A place in turned coordinates.
    #[inline]
    pub fn of(&self, p: [f64; 3]) -> [f64; 3] {
        self.0.map(|axis| axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2])
    }

    /// The place of turned coordinates.
    #[inline]
    pub fn back(&self, t: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.0;
        std::array::from_fn(|a| x[a] * t[0] + y[a] * t[1] + z[a] * t[2])
    }
}

/// A place in the grid: x, slice, row.
pub type Cell = [u32; 3];

/// The grid of cubic cells over the cloud's box.
///
/// ```text
///   slice (grid y) ^       cell = min(floor((p - min) / w), cells - 1) along each grid axis
///                  |  row (grid z)
///                  | /     corner (i, j, k) lies at min + w * (i, j, k)
///                  +-----> x
/// ```
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Grid {
    axis: Axis,
    bounds: Bounds,
    w: f64,
    inverse: f64,
    cells: [u32; 3],
    /// What is left out along each of its axes.
    gaps: [Gaps; 3],
    /// If its axes are not the file's, whose place the turned ones take then, in the box, too.
    turn: Option<Rotation>,
}

impl Grid {
    /// The grid for `n` points in `bounds`.
    ///
    /// # Errors
    /// [`Error::Raster`] if an axis would get more than [`CELLS_LIMIT`] cells, [`Error::InvalidSetting`] for a resolution that
    /// is not positive and finite or a box whose extent `f64` cannot express.
    pub fn new(n: u64, bounds: &Bounds, resolution: Resolution, choice: AxisChoice) -> Result<Grid> {
        let axis = match choice {
            AxisChoice::Longest => bounds.longest(),
            AxisChoice::Fixed(axis) => axis,
        };
        let extent = bounds.extent();
        let longest = extent[bounds.longest().index()];
        if !longest.is_finite() {
            return Err(Error::Usage(format!("the cloud's extent {longest} is beyond what can be computed with")));
        }
        let along = extent[axis.index()];
        let (w, slices) = match resolution {
            Resolution::Cell(w) if w.is_finite() && w > 0.0 => (w, None),
            Resolution::Cell(w) => {
                return Err(Error::setting("cell_size", format!("`cell_size` {w} is not a positive length")));
            }
            Resolution::Slices(0) => {
                return Err(Error::setting("slices", "`slices` 0: at least one slice is needed".into()));
            }
            Resolution::K(k) if !(k.is_finite() && k > 0.0) => {
                return Err(Error::setting("k", format!("`k` {k} is not a positive number")));
            }
            Resolution::Slices(_) | Resolution::K(_) => {
                let s = match resolution {
                    Resolution::Slices(s) => f64::from(s),
                    Resolution::K(k) => (k * libm::cbrt(n as f64)).floor().max(1.0),
                    Resolution::Cell(_) => unreachable!("handled above"),
                };
                if s > f64::from(CELLS_LIMIT) {
                    return Err(raster_error(s, axis));
                }
                // A flat cloud has no extent to divide; its longest side then gives the scale, and a point cloud that
                // is a single point any scale at all.
                let (side, slices) = if along > 0.0 { (along, Some(s as u32)) } else { (longest, Some(1)) };
                (if side > 0.0 { side / s } else { 1.0 }, slices)
            }
        };
        let inverse = 1.0 / w;
        if !w.is_normal() || !inverse.is_normal() {
            return Err(Error::Usage(format!("cells of side {} are beyond what can be computed with", short(w))));
        }
        let mut cells = [0; 3];
        for (g, &a) in axis.file_axes().iter().enumerate() {
            // The factor forgives the last bits of extent * (1 / (extent / s)): a whole number of cells stays that.
            let exact = (extent[a] * inverse * (1.0 - 4.0 * f64::EPSILON)).ceil().max(1.0);
            if exact > f64::from(CELLS_LIMIT) {
                return Err(raster_error(exact, Axis::ALL[a]));
            }
            cells[g] = exact as u32;
        }
        if let Some(slices) = slices {
            cells[1] = slices;
        }
        Ok(Grid { axis, bounds: *bounds, w, inverse, cells, gaps: Default::default(), turn: None })
    }

    /// The same grid with so many cells more below and above its box, along its own axes; the box grows with it.
    ///
    /// # Errors
    /// [`Error::Raster`] if an axis would get more than [`CELLS_LIMIT`] cells.
    pub fn with_margin(mut self, below: Cell, above: Cell) -> Result<Grid> {
        for (g, &a) in self.axis.file_axes().iter().enumerate() {
            let cells = f64::from(self.cells[g]) + f64::from(below[g]) + f64::from(above[g]);
            if cells > f64::from(CELLS_LIMIT) {
                return Err(raster_error(cells, Axis::ALL[a]));
            }
            self.bounds.min[a] -= self.w * f64::from(below[g]);
            self.bounds.max[a] += self.w * f64::from(above[g]);
            self.cells[g] = cells as u32;
        }
        Ok(self)
    }

    /// The same grid without most of the planes of wide gaps, where far points stretch the box: `planes` tells of its axes which of their planes have points;
    /// along an axis for which it is empty, nothing is left out. A gap keeps half as many planes as have points, and no fewer than 256, nor than `reach`. It is shortened if it
    /// is twice as wide as that, and wider than a thirty-second of the longest side; of an axis, the four widest ones are.
    pub fn without_gaps(self, planes: &[Vec<bool>; 3], reach: u32) -> Grid {
        let widest = self.cells.into_iter().max().unwrap_or(1).div_ceil(SHOWS);
        let gaps = [0, 1, 2].map(|g| Gaps::of(&planes[g], GAP.max(reach), widest));
        let cells = [0, 1, 2].map(|g| self.cells[g] - gaps[g].left_out());
        Grid { gaps, cells, ..self }
    }

    /// Whether planes are left out.
    pub fn has_gaps(&self) -> bool {
        self.gaps.iter().any(|gaps| !gaps.is_empty())
    }

    /// Cells along its axes, those that are left out included.
    pub fn raw_cells(&self) -> [u32; 3] {
        [0, 1, 2].map(|g| self.cells[g] + self.gaps[g].left_out())
    }

    /// What is left out along each of its axes.
    pub fn gaps(&self) -> [Gaps; 3] {
        self.gaps
    }

    /// The same grid along turned axes; the box it was made for is one of turned coordinates.
    pub fn turned(self, turn: Rotation) -> Grid {
        Grid { turn: Some(turn), ..self }
    }

    /// A place in the grid's own coordinates: the file's, unless it is turned.
    #[inline]
    fn own(&self, p: [f64; 3]) -> [f64; 3] {
        self.turn.map_or(p, |turn| turn.of(p))
    }

    /// The slicing axis, the file's or turned.
    pub fn axis(&self) -> Axis {
        self.axis
    }

    /// The cell's side w, in the file's units.
    pub fn cell_size(&self) -> f64 {
        self.w
    }

    /// Cells along the grid's axes: x, slices, rows.
    pub fn cells(&self) -> [u32; 3] {
        self.cells
    }

    /// The cloud's box, with margins, in the grid's own coordinates.
    pub fn bounds(&self) -> &Bounds {
        &self.bounds
    }

    /// The raster as the paper's Table 1 has it: slices in the middle, the file's other axes in their order round it.
    pub fn raster(&self) -> [u32; 3] {
        self.in_file_order(self.cells)
    }

    /// The same with the planes that are left out.
    pub fn raw_raster(&self) -> [u32; 3] {
        self.in_file_order(self.raw_cells())
    }

    fn in_file_order(&self, [first, slices, second]: [u32; 3]) -> [u32; 3] {
        let axes = self.axis.file_axes();
        if axes[0] < axes[2] { [first, slices, second] } else { [second, slices, first] }
    }

    /// The cell of a point inside the box.
    #[inline]
    pub fn cell_of(&self, point: [f64; 3]) -> Cell {
        let (axes, point) = (self.axis.file_axes(), self.own(point));
        std::array::from_fn(|g| self.along(g, point[axes[g]]))
    }

    /// Calls `each` with the cells of points inside the box, in order.
    #[inline]
    pub fn cells_of<T: Coordinate>(&self, points: &[[T; 3]], each: impl FnMut(Cell)) {
        if self.turn.is_some() || self.has_gaps() {
            return points.iter().map(|p| self.cell_of(p.map(Into::into))).for_each(each);
        }
        // What is the same for all points is settled here, for the loop to be short.
        match self.axis {
            Axis::X => self.cells_along::<T, 2, 0, 1>(points, each),
            Axis::Y => self.cells_along::<T, 0, 1, 2>(points, each),
            Axis::Z => self.cells_along::<T, 1, 2, 0>(points, each),
        }
    }

    #[inline]
    fn cells_along<T: Coordinate, const X: usize, const Y: usize, const Z: usize>(
        &self,
        points: &[[T; 3]],
        mut each: impl FnMut(Cell),
    ) {
        let (min, inverse) = ([X, Y, Z].map(|a| self.bounds.min[a]), self.inverse);
        let last = self.cells.map(|cells| cells - 1);
        let along = |g: usize, c: T| (((c.into() - min[g]) * inverse) as u32).min(last[g]);
        points.iter().for_each(|p| each([along(0, p[X]), along(1, p[Y]), along(2, p[Z])]));
    }

    /// The cell of a point inside the box, and the point's place in it, from 0 to 1 along the grid's axes.
    #[inline]
    pub fn place_of(&self, point: [f64; 3]) -> (Cell, [f64; 3]) {
        let cell = self.cell_of(point);
        let (axes, point) = (self.axis.file_axes(), self.own(point));
        let within = std::array::from_fn(|g| {
            let along = (point[axes[g]] - self.bounds.min[axes[g]]) * self.inverse;
            (along - f64::from(self.raw_along(g, point[axes[g]]))).clamp(0.0, 1.0)
        });
        (cell, within)
    }

    /// Where a point inside the box lies, in cells.
    #[inline]
    pub fn place_in_cells(&self, point: [f64; 3]) -> [f64; 3] {
        let (cell, within) = self.place_of(point);
        std::array::from_fn(|g| f64::from(cell[g]) + within[g])
    }

    /// The slice of a point inside the box.
    #[inline]
    pub fn slice_of(&self, point: [f64; 3]) -> u32 {
        self.along(1, self.own(point)[self.axis.index()])
    }

    /// How far along the slicing axis a place lies, in slices.
    #[inline]
    pub fn height_of(&self, place: [f64; 3]) -> f64 {
        let a = self.axis.index();
        self.gaps[1].height((self.own(place)[a] - self.bounds.min[a]) * self.inverse)
    }

    /// Where a place lies, in cells, as seen from a cell: as if the planes left out on the way were there. And the box of cells round that cell in which
    /// nothing is left out, so that straight lines are straight.
    pub fn seen_from(&self, cell: Cell, place: [f64; 3]) -> ([f64; 3], [Range<u32>; 3]) {
        let (axes, place) = (self.axis.file_axes(), self.own(place));
        let pieces = [0, 1, 2].map(|g| self.gaps[g].piece(cell[g], self.cells[g]));
        let along = std::array::from_fn(|g| {
            (place[axes[g]] - self.bounds.min[axes[g]]) * self.inverse - f64::from(pieces[g].1)
        });
        (along, pieces.map(|(cells, _)| cells))
    }

    /// A box of the file's coordinates that holds the grid: its lowest corner, and cells along the grid's axes without those that are left out, each taken for the file's that it is unless turned.
    pub fn file_box(&self) -> ([f64; 3], Cell) {
        let Some(turn) = self.turn else { return (self.bounds.min, self.cells) };
        let Bounds { min, max } = self.bounds;
        let corner = |i: usize| turn.back(std::array::from_fn(|a| if i >> a & 1 == 1 { max[a] } else { min[a] }));
        let corners = (0..8).map(corner).map(|corner| Bounds { min: corner, max: corner });
        let held = corners.fold(Bounds::EMPTY, Bounds::union);
        let extent = held.extent();
        (held.min, self.axis.file_axes().map(|a| ((extent[a] * self.inverse) as u32).min(CELLS_LIMIT - 1) + 1))
    }

    /// The cell coordinate along grid axis `g`.
    #[inline]
    fn along(&self, g: usize, coordinate: f64) -> u32 {
        self.gaps[g].shorten(self.raw_along(g, coordinate))
    }

    /// The same with all planes counted. The cast saturates, so rounding below zero stays in cell 0.
    #[inline]
    fn raw_along(&self, g: usize, coordinate: f64) -> u32 {
        let a = self.axis.file_axes()[g];
        (((coordinate - self.bounds.min[a]) * self.inverse) as u32).min(self.cells[g] + self.gaps[g].left_out() - 1)
    }

    /// The world position, in file axes, of a grid position in cells.
    #[inline]
    pub fn position(&self, q: [f64; 3]) -> [f64; 3] {
        let mut out = [0.0; 3];
        for (g, &a) in self.axis.file_axes().iter().enumerate() {
            out[a] = self.bounds.min[a] + self.w * (q[g] + f64::from(self.gaps[g].left_out_below(q[g])));
        }
        self.turn.map_or(out, |turn| turn.back(out))
    }

    /// How far, in cells, rounding can move a point or a vertex: a distance bound must be relaxed by this.
    pub fn slack(&self) -> f64 {
        let far = self.bounds.min.iter().chain(&self.bounds.max).fold(0.0f64, |m, c| m.max(c.abs()));
        // Turning there and back rounds some more.
        let roundings = if self.turn.is_some() { 64.0 } else { 16.0 };
        1e-9 + roundings * f64::EPSILON * far * self.inverse
    }
}

fn raster_error(cells: f64, axis: Axis) -> Error {
    Error::Raster {
        cells,
        axis: axis.letter(),
        limit: CELLS_LIMIT,
        advice: "use a smaller `k` or `slices`, a larger `cell_size`, or `axis` longest; far outliers stretch the box too",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds(extent: [f64; 3]) -> Bounds {
        Bounds { min: [0.0; 3], max: extent }
    }

    #[test]
    fn wide_gaps_are_shortened_and_places_found_again() {
        let grid =
            Grid::new(3, &bounds([1000.0, 4.0, 2.0]), Resolution::Cell(1.0), AxisChoice::Fixed(Axis::X)).unwrap();
        let planes = |with: &[usize]| {
            let mut planes = vec![false; 1000];
            with.iter().for_each(|y| planes[*y] = true);
            [Vec::new(), planes, Vec::new()]
        };
        for (with, reach, slices) in [
            (&[0, 1, 999][..], 0, 2 + 256 + 1),
            (&[0, 1, 999], 300, 2 + 300 + 1),
            (&[0, 514, 999], 0, 1000 - (513 - 256)),
            (&[0, 513, 999], 0, 1000),
            (&[999], 0, 1000),
        ] {
            let grid = grid.clone().without_gaps(&planes(with), reach);
            assert_eq!((grid.cells()[1], grid.raw_cells()[1]), (slices, 1000), "{with:?}, {reach}");
            for x in [0.5, 1.5, 99.5, 998.0, 999.5, 1000.0] {
                let [_, y, _] = grid.cell_of([x, 0.0, 0.0]);
                let low = grid.position([0.0, f64::from(y), 0.0])[0];
                if with.contains(&(x as usize).min(999)) {
                    assert!(x >= low && x <= low + 1.0, "{x} in slice {y} from {low}");
                    assert_eq!(grid.height_of([x, 0.0, 0.0]), f64::from(y) + x - low);
                    assert_eq!(grid.place_of([x, 0.0, 0.0]).1[1], x - low);
                }
            }
            let heights: Vec<f64> = (0..=1000).map(|x| grid.height_of([f64::from(x), 0.0, 0.0])).collect();
            assert!(heights.is_sorted() && heights[1000] == f64::from(slices));
        }
    }

    #[test]
    fn table_1_of_the_paper() {
        // Number of points and slices; the rasters need the models themselves.
        let table = [
            (30_133, 124),
            (35_947, 132),
            (48_487, 145),
            (75_782, 169),
            (122_882, 198),
            (172_975, 222),
            (543_652, 326),
            (654_651, 347),
            (1_765_913, 483),
            (3_609_601, 613),
        ];
        for (n, slices) in table {
            let grid = Grid::new(n, &bounds([1.0; 3]), Resolution::default(), AxisChoice::Longest).unwrap();
            assert_eq!(grid.cells(), [slices; 3], "n = {n}");
        }
    }

    #[test]
    fn many_points_get_the_cells_that_each_gets() {
        let points: Vec<[f32; 3]> = (0..40).map(|i| [i as f32 * 0.1, i as f32 * 0.2, 7.9 - i as f32 * 0.15]).collect();
        for axis in Axis::ALL {
            let bounds = bounds([3.9, 7.8, 7.9]);
            let grid = Grid::new(9, &bounds, Resolution::Slices(17), AxisChoice::Fixed(axis)).unwrap();
            let mut cells = Vec::new();
            grid.cells_of(&points, |cell| cells.push(cell));
            let each: Vec<Cell> = points.iter().map(|p| grid.cell_of(p.map(f64::from))).collect();
            assert_eq!(cells, each);
        }
    }

    #[test]
    fn the_raster_is_given_in_the_files_order_round_the_slices() {
        // The horse's extents, along z: 80 x 145 x 174.
        let b = bounds([0.084, 0.183, 0.153]);
        let grid = Grid::new(48_485, &b, Resolution::default(), AxisChoice::Fixed(Axis::Z)).unwrap();
        assert_eq!(grid.raster(), [80, 145, 174]);
        assert_eq!(grid.cells(), [174, 145, 80]);
    }

    #[test]
    fn the_box_corners_fall_into_the_first_and_last_cells() {
        let b = Bounds { min: [4.5e6, -3.0, 0.1], max: [4.5e6 + 7.3, 11.0, 0.7] };
        for axis in Axis::ALL {
            let grid = Grid::new(1000, &b, Resolution::default(), AxisChoice::Fixed(axis)).unwrap();
            assert_eq!(grid.cell_of(b.min), [0; 3]);
            assert_eq!(grid.cell_of(b.max), grid.cells().map(|c| c - 1));
            let corner = grid.position(grid.cells().map(f64::from));
            for (c, max) in corner.iter().zip(b.max) {
                assert!(*c >= max - 1e-8 && *c < max + grid.cell_size() + 1e-8);
            }
        }
    }

    #[test]
    fn flat_clouds_and_single_points_have_a_grid() {
        let flat = Bounds { min: [0.0, 5.0, 0.0], max: [10.0, 5.0, 2.0] };
        let grid = Grid::new(1000, &flat, Resolution::Slices(20), AxisChoice::Fixed(Axis::Y)).unwrap();
        assert_eq!(grid.cells(), [20, 1, 4]);
        let point = Bounds { min: [7.0; 3], max: [7.0; 3] };
        assert_eq!(
            Grid::new(1, &point, Resolution::default(), AxisChoice::Longest).unwrap().cells(),
            [1, 4, 1].map(|_| 1)
        );
    }

    #[test]
    fn too_fine_a_grid_is_refused_with_the_figure() {
        let b = bounds([1.0, 1.0, 1.0]);
        let error = Grid::new(10, &b, Resolution::Cell(1e-7), AxisChoice::Longest).unwrap_err();
        assert!(error.to_string().contains("10000000"), "{error}");
        for bad in [Resolution::Cell(0.0), Resolution::K(f64::NAN), Resolution::Slices(0), Resolution::K(-1.0)] {
            assert!(matches!(Grid::new(10, &b, bad, AxisChoice::Longest), Err(Error::InvalidSetting { .. })));
        }
        let huge = Bounds { min: [-1.7e308; 3], max: [1.7e308; 3] };
        assert!(Grid::new(10, &huge, Resolution::default(), AxisChoice::Longest).is_err());
    }
}
