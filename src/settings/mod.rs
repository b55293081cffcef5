//! Settings of a reconstruction: plain values that every stage may read. Files, memory and threads are not among them.

pub mod closing;
pub mod ground;
pub mod open;
pub mod simplification;
pub mod surface;
pub mod tileset;

use self::closing::{Least, Sealing};
use self::ground::Classes;
use self::open::Open;
use self::simplification::{Simplification, Tolerance};
use self::surface::{Fit, SurfaceOptions};
use crate::error::{Error, Result};
use crate::points::bounds::Axis;

/// Which axis to slice along.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AxisChoice {
    /// The box's longest side; the first of equals.
    #[default]
    Longest,
    /// A given one.
    Fixed(Axis),
}

/// How fine the grid is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Resolution {
    /// The paper's k: s = ⌊k·∛n⌋ (Eq. 2).
    K(f64),
    /// A number of slices.
    Slices(u32),
    /// A cell's side, in the file's units.
    Cell(f64),
}

impl Default for Resolution {
    /// k = 4, the paper's choice.
    fn default() -> Self {
        Resolution::K(4.0)
    }
}

/// How fine the grid is to be.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Fineness {
    /// The paper's k = 4, with cells up to half as wide where points are dense and clean, but no smaller than `--cell-size auto` would make them: of smaller ones too many are
    /// empty by chance.
    #[default]
    Default,
    /// The resolution that is given.
    Given(Resolution),
    /// Cells tied to the sampling distance.
    Sampling,
}

/// All settings of a reconstruction, but for files and resources.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// How fine the grid is.
    pub fineness: Fineness,
    /// Which axis is sliced.
    pub axis: AxisChoice,
    /// How holes are closed.
    pub seal: Sealing,
    /// The window's slices, which bound a closing radius that is given: ρ ≤ (W − 1) / 2. `None` leaves it free.
    pub window: Option<u32>,
    /// Whether outliers stay.
    pub keep_outliers: bool,
    /// Whether places of the surface are added where points are sparse for the shape.
    pub upsample: bool,
    /// The least number of points that make a cell occupied.
    pub min_points: u32,
    /// The components that are kept; `None` keeps all.
    pub min_component: Option<Least>,
    /// What is done to the surface.
    pub surface: SurfaceOptions,
    /// What is asked of a surface that is not closed; `None` for one that is.
    pub open: Option<Open>,
    /// Whether vertices carry their distance from the nearest point.
    pub bridged: bool,
    /// Triangles with a vertex farther than this from any point are left out, and the surface is open there; none are with `None`.
    pub trim: Option<Tolerance>,
    /// How many triangles are left; all with `None`.
    pub simplify: Option<Simplification>,
    /// What tells the ground, if the open surface is that.
    pub classes: Classes,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            fineness: Fineness::Default,
            axis: AxisChoice::Longest,
            seal: Sealing::Auto,
            window: None,
            keep_outliers: false,
            upsample: true,
            min_points: 1,
            min_component: Some(Least::Auto),
            surface: SurfaceOptions {
                smooth: 1,
                diagonals: Default::default(),
                fit: Default::default(),
                slab_slices: None,
            },
            open: None,
            bridged: false,
            trim: None,
            simplify: None,
            classes: Classes::Auto,
        }
    }
}

impl Settings {
    /// What vertices are moved onto, as far as it is known before points are.
    pub fn fit(&self) -> Fit {
        match (self.surface.fit, self.fineness) {
            (Fit::Auto, Fineness::Given(Resolution::K(_) | Resolution::Slices(_))) => Fit::AutoPoints,
            (fit, _) => fit,
        }
    }

    /// How fine the grid is to be, if nothing was said: an open surface has cells tied to the sampling distance, as k says nothing of a sheet; and so has a mesh of which
    /// a number of triangles is asked for, which is made of the finest.
    pub fn fineness(&self) -> Fineness {
        let few = self.simplify.is_some_and(|asked| asked.max_triangles.is_some());
        match self.fineness {
            Fineness::Default if self.open.is_some() || few => Fineness::Sampling,
            fineness => fineness,
        }
    }

    /// Whether the mesh may end somewhere.
    pub fn may_end(&self) -> bool {
        self.trim.is_some() || self.open.is_some_and(|open| open.base.is_none())
    }

    /// Whether points may make no triangle at all: a line seen from above makes none, nor does its body down to a base.
    pub fn may_be_empty(&self) -> bool {
        self.trim.is_some() || self.open.is_some()
    }

    /// Checks what can be checked without the input.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`].
    pub fn validate(&self) -> Result<()> {
        if let Some(window) = self.window
            && (window < 3 || window % 2 == 0)
        {
            return Err(Error::setting(
                "window",
                format!("`window` {window}: the window is an odd number of slices, at least 3"),
            ));
        }
        if self.min_points == 0 {
            return Err(Error::setting(
                "min_points",
                "`min_points` 0: a cell without points is never occupied; at least 1".into(),
            ));
        }
        if self.surface.smooth > 100 {
            return Err(Error::setting("smooth", format!("`smooth` {}: at most 100 steps", self.surface.smooth)));
        }
        if self.open.is_some() && self.min_component.is_some_and(|least| least != Least::Auto) {
            let message = "`min_component`: a surface that is seen from one side has no components; `min_points` thins out strays";
            return Err(Error::setting("min_component", message.into()));
        }
        if self.trim.is_some() && self.open.is_some_and(|open| open.base.is_some()) {
            let message = "`trim`: what stands on a `base` is closed, and far from all points at its bottom";
            return Err(Error::setting("trim", message.into()));
        }
        if let Some(Tolerance::Length(0.0) | Tolerance::Cells(0.0) | Tolerance::Percent(0.0)) = self.trim {
            return Err(Error::setting(
                "trim",
                "`trim` 0: a surface amid points is farther than that from each".into(),
            ));
        }
        self.simplify.map_or(Ok(()), |asked| asked.validate())
    }
}
