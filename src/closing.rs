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
use crate::stage::seal::{self, Pyramid};
use crate::stage::sides::Sides;
use crate::stage::sign::{self, Signed};
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
    let (solid, occupancy, closing, falls, two_sided) = match given {
        None => {
            let signed = close_signed(occupancy, context, &mut progress)?;
            (signed.solid, signed.occupancy, Closing { level: 0, radius: 1 }, signed.level > 0, Some(signed.two_sided))
        }
        Some(_) => {
            let wanted = given.map(Closing::with_radius).expect("a radius is given");
            let pyramid = Pyramid::over(&occupancy, wanted.level, context)?;
            let most = asked.window.map_or(u32::MAX, |w| (w - 1) / 2);
            // A ball that the window bounds does not seal: there are no sides to tell apart, and nothing to fall to.
            let falls = wanted.rho() > 1 && wanted.rho() <= most;
            let closing = if wanted.rho() <= most { wanted } else { Closing { level: 0, radius: most } };
            let solid = if closing == wanted {
                pyramid.close(closing, None, context, &mut progress)?
            } else {
                Solid::close(&occupancy, &Ball::new(closing.radius), context)?
            };
            drop(pyramid);
            (solid, occupancy, closing, falls, None)
        }
    };
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
    let sealing_radius = two_sided.filter(|(two, all)| 20 * two < *all).map(|_| 1);
    Ok(Closed { solid, occupancy, closing, falls, sealing_radius, trials: Vec::new(), components })
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

/// A level whose occupied cells are fewer than this times those of the next coarser one is finer than the sampling: cells between samples are empty by
/// chance. Of samples at random, 2.7 means cells of 1.3 sampling distances.
const FILLED: f64 = 2.7;

/// A level with fewer cells than this along its longest axis shows no body.
const SHORTEST: u32 = 8;

/// What the field's sign made of the cells.
struct ClosedBySign {
    solid: Solid,
    occupancy: Occupancy,
    level: u32,
    two_sided: (u64, u64),
}

/// Closes the occupied cells by the sign of a field on a coarse level ([`crate::stage::sign`]), and finer levels by what that says.
fn close_signed(occupancy: Occupancy, context: &Context, progress: &mut dyn FnMut(u32)) -> Result<ClosedBySign> {
    let mut levels: Vec<Occupancy> = Vec::new();
    let longest = |occupancy: &Occupancy| occupancy.cells.into_iter().max().unwrap_or(1);
    loop {
        let last = levels.last().unwrap_or(&occupancy);
        if longest(last) > sign::LONGEST {
            levels.push(last.coarser(context)?);
            continue;
        }
        if longest(last) < 2 * SHORTEST {
            break;
        }
        let coarser = last.coarser(context)?;
        if last.occupied as f64 >= FILLED * coarser.occupied as f64 {
            break;
        }
        levels.push(coarser);
    }
    let level = levels.len() as u32;
    let signed = Signed::find(levels.last().unwrap_or(&occupancy), context)?;
    progress(longest(&occupancy));
    let mut sides = Sides::signed(&signed, context)?;
    let is_outlier = |cell: [u32; 3]| {
        let parent = cell.map(|c| i64::from(c >> level));
        let index = signed.block.at(parent).expect("cells of the level are in its block") as u32;
        signed.outliers.binary_search(&index).is_ok()
    };
    let occupancy = if signed.outliers.is_empty() {
        occupancy
    } else {
        let left = occupancy.filtered(|cell| !is_outlier(cell), context)?;
        levels.clear();
        while (levels.len() as u32) < level {
            levels.push(levels.last().unwrap_or(&left).coarser(context)?);
        }
        left
    };
    for l in (0..=level).rev() {
        let here = if l == 0 { &occupancy } else { &levels[l as usize - 1] };
        if l < level {
            sides = sides.refined(here, context)?;
        }
        sides = sides.fallen(here, l, context, progress)?;
    }
    let solid = Solid::between(&occupancy, &sides, context)?;
    drop(sides);
    let solid = solid.without_hollows(&occupancy, context)?;
    Ok(ClosedBySign { solid, occupancy, level, two_sided: signed.two_sided })
}
