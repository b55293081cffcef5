//! Closing: from the occupied cells to the solid, as asked for.
//!
//! Finds the ball that seals (or takes the one that is asked for), lets it fall, and leaves out what is too small to be kept.

use crate::context::Context;
use crate::error::{Error, Result};
use crate::grid::{CELLS_LIMIT, Grid};
use crate::open::Open;
use crate::stage::component::{self, Components, Least};
use crate::stage::dilate::Ball;
use crate::stage::ground;
use crate::stage::raster::Occupancy;
use crate::stage::seal::{self, Pyramid, Sealed};
use crate::stage::solid::Solid;

pub use crate::stage::seal::Closing;

/// How holes are closed.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Sealing {
    /// By the smallest ball that seals, found by trying.
    #[default]
    Auto,
    /// By a ball of this radius, in cells.
    Cells(u32),
    /// By a ball of this radius, in the input's units.
    Length(f64),
    /// Only those that a ball of one cell closes.
    Off,
}

impl Sealing {
    /// The radius asked for, in cells of `cell_size`, at least 1; none if it is to be found.
    pub fn radius(self, cell_size: f64) -> Option<u32> {
        match self {
            Sealing::Auto => None,
            Sealing::Cells(cells) => Some(cells.max(1)),
            Sealing::Length(length) => Some((length / cell_size).ceil().clamp(1.0, f64::from(CELLS_LIMIT)) as u32),
            Sealing::Off => Some(1),
        }
    }
}

/// What is asked of the closing.
#[derive(Debug, Clone, Copy)]
pub struct Asked {
    /// How holes are closed.
    pub seal: Sealing,
    /// The window's slices, which bound the closing radius: ρ ≤ (W − 1) / 2.
    pub window: Option<u32>,
    /// The components that are kept; `None` keeps all.
    pub min_component: Option<Least>,
}

/// The solid, and how it came to be.
#[derive(Debug)]
pub struct Closed {
    /// The solid, without lone cells and small components.
    pub solid: Solid,
    /// The occupied cells that count.
    pub occupancy: Occupancy,
    /// The ball that was used.
    pub closing: Closing,
    /// Whether it fell to smaller ones ([`crate::stage::sides`]).
    pub falls: bool,
    /// The closing radius ρ that seals the cloud, in cells, if it was looked for and found.
    pub sealing_radius: Option<u32>,
    /// What was tried to find it; nothing if the radius was given.
    pub trials: Vec<seal::Trial>,
    /// What was found and left out, if small components were to be.
    pub components: Option<Components>,
}

/// Closes the occupied cells: with the radius that is asked for, or that seals, and that the window allows. `progress` is told the slices of
/// every pass.
///
/// # Errors
/// [`Error::Usage`] for a radius of more than half the longest side, and if no component is as large as asked for; [`Error::Io`];
/// [`Error::Interrupted`].
pub fn close(
    occupancy: Occupancy,
    cell_size: f64,
    asked: Asked,
    context: &Context,
    mut progress: impl FnMut(u32),
) -> Result<Closed> {
    let given = asked.seal.radius(cell_size);
    let longest = occupancy.cells.into_iter().max().unwrap_or(1);
    if let Some(radius) = given.filter(|radius| *radius > 1 && 2 * u64::from(*radius) > u64::from(longest)) {
        return Err(Error::Usage(format!(
            "--seal: a radius of {radius} cells is more than half of the longest side, {longest} cells"
        )));
    }
    let wanted = given.map(Closing::with_radius);
    let pyramid = Pyramid::over(&occupancy, wanted.map_or(0, |closing| closing.level), context)?;
    let mut sealed = match wanted {
        Some(closing) => Sealed { closing: Some(closing), exterior: None, trials: Vec::new() },
        None => seal::find(&pyramid, context, &mut progress)?,
    };
    let found = sealed.closing.unwrap_or(Closing { level: 0, radius: 1 });
    let most = asked.window.map_or(u32::MAX, |w| (w - 1) / 2);
    // A ball that the window bounds does not seal: there are no sides to tell apart, and nothing to fall to.
    let falls = found.rho() > 1 && found.rho() <= most;
    let closing = if found.rho() <= most { found } else { Closing { level: 0, radius: most } };
    let exterior = sealed.exterior.take().filter(|_| closing == found);
    let solid = if closing == found {
        pyramid.close(closing, exterior, context, &mut progress)?
    } else {
        Solid::close(&occupancy, &Ball::new(closing.radius), context)?
    };
    drop(pyramid);
    let solid = solid.without_lone_cells(context)?;
    let (solid, occupancy, components) = match asked.min_component {
        None => (solid, occupancy, None),
        Some(least) => {
            let (solid, occupancy, components) = component::keep(solid, occupancy, least, context)?;
            if components.dropped == components.found {
                let largest = components.largest;
                return Err(Error::Usage(format!("--min-component: the largest component has {largest} cells only")));
            }
            (solid, occupancy, Some(components))
        }
    };
    let sealing_radius = sealed.closing.filter(|_| given.is_none()).map(|closing| closing.rho());
    Ok(Closed { solid, occupancy, closing, falls, sealing_radius, trials: sealed.trials, components })
}

/// The solid below a surface that is not closed: columns, over which a small ball rolls. `progress` is told the slices.
///
/// # Errors
/// [`Error::Io`], [`Error::Interrupted`].
pub fn close_below(
    occupancy: Occupancy,
    grid: &Grid,
    open: &Open,
    asked: Asked,
    smooth: u32,
    context: &Context,
    mut progress: impl FnMut(u32),
) -> Result<Closed> {
    let ball = open.ball(asked.seal, asked.window, grid.cell_size());
    let ground = ground::Asked {
        up: open.up(grid),
        bridge: open.bridge(grid),
        ball,
        base: open.base.is_some(),
        jump: open.jump(grid),
        smooth,
    };
    let solid = ground::solid(&occupancy, ground, context)?;
    progress(grid.cells()[1]);
    let closing = Closing { level: 0, radius: ball.radius() };
    Ok(Closed { solid, occupancy, closing, falls: false, sealing_radius: None, trials: Vec::new(), components: None })
}
