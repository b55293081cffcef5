//! Closing: from the occupied cells to the solid, as asked for.
//!
//! Tells inside and outside apart by the sign of a field ([`crate::solid::sign`]) or by a ball that is asked for ([`crate::solid::seal`]), decides finer
//! cells by falling balls, and leaves out what is too small to be kept.
//!
//! The field is found on one coarse level ([`crate::solid::level`]). A window of slices, however few, holds what finer levels need: on these the balls are a few cells wide.

use crate::error::{Error, Result};
use crate::grid::bucket::Buckets;
use crate::grid::context::Context;
use crate::grid::dilate::{Ball, squared};
use crate::grid::occupancy::Occupancy;
use crate::grid::slice::SliceStore;
use crate::grid::{CELLS_LIMIT, Grid};
use crate::points::Coordinate;
use crate::settings::closing::Least;
use crate::settings::closing::Sealing;
use crate::settings::open::{Kind, Open};
use crate::solid::Solid;
use crate::solid::component;
use crate::solid::component::Components;
use crate::solid::heightfield;
use crate::solid::level::{self, Level, side_in_samples};
use crate::solid::membranes::Membranes;
use crate::solid::parted::Parted;
use crate::solid::seal;
use crate::solid::seal::Pyramid;
use crate::solid::sign;
use crate::solid::sign::{Seen, Sights, Signed};
use crate::solid::thicken::Sheets;
use crate::solid::watershed;
use crate::solid::watershed::{LAST, LAST_COARSE, Sides};

pub use crate::solid::seal::ClosingBall;

impl Sealing {
    /// The radius asked for, in cells of `cell_size`, at least 1; none if it is to be found.
    pub(crate) fn radius(self, cell_size: f64) -> Option<u32> {
        match self {
            Sealing::Auto => None,
            Sealing::Cells(cells) => Some(cells.max(1)),
            Sealing::Length(length) => Some((length / cell_size).ceil().clamp(1.0, f64::from(CELLS_LIMIT)) as u32),
            Sealing::Off => Some(1),
        }
    }
}

/// Options of the closing.
#[derive(Debug, Clone, Copy)]
pub struct ClosingOptions {
    /// How holes are closed.
    pub seal: Sealing,
    /// The window's slices, which bound a closing radius that is given: ρ ≤ (W − 1) / 2.
    pub window: Option<u32>,
    /// Whether outliers stay.
    pub keep_outliers: bool,
    /// The components that are kept; `None` keeps all.
    pub min_component: Option<Least>,
    /// Whether the sign's level may be coarser than the sampling asks for, as [`sign::ROUGH`] says: faster, for a number of faces that is looked for.
    pub rough: bool,
}

/// The solid, and how it came to be.
#[derive(Debug)]
pub struct Closed {
    /// The solid, without lone cells and small components.
    pub solid: Solid,
    /// The occupied cells that count.
    pub occupancy: Occupancy,
    /// How they were closed.
    pub how: How,
    /// Whether a ball fell to smaller ones ([`crate::solid::watershed`]).
    pub falls: bool,
    /// What was found and left out, if small components were to be.
    pub components: Option<Components>,
    /// The membranes that close holes, if there are any.
    pub membranes: Option<Membranes>,
    /// What sheets were thickened by, if there are any. Not kept: reopening looks at it, and nothing after that.
    pub thickened: Option<SliceStore>,
}

impl Closed {
    /// Whether outliers were left out.
    pub fn has_outliers(&self) -> bool {
        matches!(&self.how, How::Sign(parted) if parted.outliers > 0)
    }
}

/// How cells were closed.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum How {
    /// By a ball.
    Ball(ClosingBall),
    /// By the sign of a field.
    Sign(Parted),
}

/// The passes over the slices that closing takes, and who is told of them.
struct Passes<'a> {
    done: u64,
    total: u64,
    tell: &'a mut dyn FnMut(u64, u64),
}

impl Passes<'_> {
    /// A pass over so many slices is done.
    fn done(&mut self, slices: u32) {
        self.done += u64::from(slices);
        self.total = self.total.max(self.done);
        (self.tell)(self.done, self.total);
    }

    /// From here on, there are going to be passes over so many slices.
    fn expect(&mut self, slices: u64) {
        self.total = self.done + slices;
    }
}

/// The slices of the passes in which a ball falls, from level `level` to the grid's own. `first` is its squared radius there, `last` that on each level.
fn slices_of_falls(slices: u32, level: u32, first: u32, last: impl Fn(u32) -> u32) -> u64 {
    let mut squared = first;
    let of_level = |l: u32| {
        if l < level {
            squared *= 4;
        }
        let steps = watershed::steps(squared, last(l));
        squared = squared.min(last(l));
        u64::from(steps) * u64::from(slices.div_ceil(1 << l))
    };
    (0..=level).rev().map(of_level).sum()
}

/// Passes after those of a ball's fall: the solid, its dents, what cannot be resolved, lone cells, components. With a ball that is given, the first three
/// are one.
const AFTER_THE_FALL: [u64; 2] = [5, 3];

/// Closes the occupied cells: with the radius that is asked for, as far as the window allows it, or by the sign of a field. `progress` is told the
/// slices of the passes that are done, and of all.
///
/// # Errors
/// [`Error::InvalidSetting`] for a radius of more than half the longest side, and if no component is as large as asked for; [`Error::Io`];
/// [`Error::Interrupted`].
pub fn close(
    occupancy: Occupancy,
    cell_size: f64,
    asked: ClosingOptions,
    context: &Context,
    progress: impl FnMut(u64, u64),
) -> Result<Closed> {
    close_seen(occupancy, cell_size, asked, None, context, progress)
}

/// [`close`], with what lines of sight say, if the sides are told apart by a field.
///
/// # Errors
/// The same as [`close`]; errors of reading the input.
pub fn close_seen(
    occupancy: Occupancy,
    cell_size: f64,
    asked: ClosingOptions,
    sights: Option<&Sights<'_>>,
    context: &Context,
    mut progress: impl FnMut(u64, u64),
) -> Result<Closed> {
    let slices = occupancy.cells[1];
    let progress = &mut Passes { done: 0, total: 0, tell: &mut progress };
    let given = asked.seal.radius(cell_size);
    let longest = occupancy.cells.into_iter().max().unwrap_or(1);
    if let Some(radius) = given.filter(|radius| *radius > 1 && 2 * u64::from(*radius) > u64::from(longest)) {
        return Err(Error::setting(
            "seal",
            format!("`seal`: a radius of {radius} cells is more than half of the longest side, {longest} cells"),
        ));
    }
    let closed = match given {
        None => close_signed(occupancy, asked, sights, context, progress)?,
        Some(_) => {
            let wanted = given.map(ClosingBall::with_radius).expect("a radius is given");
            let falls = slices_of_falls(slices, wanted.level, squared(wanted.radius), seal::last);
            progress.expect(falls + AFTER_THE_FALL[1] * u64::from(slices));
            let pyramid = Pyramid::over(&occupancy, wanted.level, context)?;
            let most = asked.window.map_or(u32::MAX, |w| (w - 1) / 2);
            // A ball that the window bounds does not seal: there are no sides to tell apart, and nothing to fall to.
            let falls = wanted.rho() > 1 && wanted.rho() <= most;
            let closing = if wanted.rho() <= most { wanted } else { ClosingBall { level: 0, radius: most } };
            let solid = if closing == wanted {
                pyramid.close(closing, context, |slices| progress.done(slices))?
            } else {
                Solid::close(&occupancy, &Ball::new(closing.radius), context)?
            };
            drop(pyramid);
            let how = How::Ball(closing);
            Closed { solid, occupancy, how, falls, components: None, membranes: None, thickened: None }
        }
    };
    let solid = closed.solid.without_isolated_cells(context)?;
    progress.done(slices);
    let (solid, occupancy, components) = match asked.min_component {
        None => (solid, closed.occupancy, None),
        Some(least) => {
            let (solid, occupancy, components) = component::keep(solid, closed.occupancy, least, context)?;
            if components.dropped == components.found {
                let largest = components.largest;
                return Err(Error::setting(
                    "min_component",
                    format!("`min_component`: the largest component has {largest} cells only"),
                ));
            }
            (solid, occupancy, Some(components))
        }
    };
    progress.done(slices);
    Ok(Closed { solid, occupancy, components, ..closed })
}

/// The solid below a surface that is not closed: columns, over which a small ball rolls. `progress` is told the slices that are done, and of all.
///
/// # Errors
/// [`Error::Io`], [`Error::Interrupted`].
pub fn close_below<T: Coordinate>(
    occupancy: Occupancy,
    (buckets, grid): (&Buckets<T>, &Grid),
    open: &Open,
    asked: ClosingOptions,
    smooth: u32,
    context: &Context,
    mut progress: impl FnMut(u64, u64),
) -> Result<Closed> {
    let slices = u64::from(grid.cells()[1]);
    progress(0, slices);
    let ball = open.ball(asked.seal, asked.window, grid.cell_size());
    let ground = heightfield::HeightFieldOptions {
        up: open.up(grid),
        bridge: open.bridge(grid),
        ball,
        base: open.base.is_some(),
        jump: open.jump(grid),
        one_layer: open.kind != Kind::Sheet,
        smooth,
    };
    let solid = heightfield::solid(&occupancy, Some((buckets, grid)), ground, context)?;
    progress(slices, slices);
    let how = How::Ball(ClosingBall { level: 0, radius: ball.radius() });
    Ok(Closed { solid, occupancy, how, falls: false, components: None, membranes: None, thickened: None })
}

/// The last ball's radius, in sampling distances.
const BALL: f64 = 1.5;

/// Closes the occupied cells by the sign of a field on a coarse level ([`crate::solid::sign`]), and finer levels by what that says.
fn close_signed(
    mut occupancy: Occupancy,
    asked: ClosingOptions,
    sights: Option<&Sights<'_>>,
    context: &Context,
    progress: &mut Passes,
) -> Result<Closed> {
    let slices = occupancy.cells[1];
    let least = sign::least_factor(occupancy.cells, if asked.rough { sign::ROUGH } else { sign::LONGEST });
    let first = Seen::of(&occupancy, least, context)?;
    let all = occupancy.occupied;
    // It serves as the level that the field is found on, if that has the same cells.
    let mut first = Some(first);
    if let Some(seen) = first.take_if(|first| !asked.keep_outliers && first.has_outliers()) {
        occupancy = occupancy.filtered(|cell| !seen.is_outlier(cell.map(|c| c / least)), context)?;
    }
    let coarser = occupancy.coarser(context)?.occupied;
    let side = side_in_samples(occupancy.occupied as f64 / coarser as f64);
    let last = ((BALL / side).powi(2) as u32).clamp(LAST, 64);
    let fall_from = |factor: u32, level: u32| (factor >> level).max(1).pow(2);
    let last_of = |l: u32| if l > 0 { LAST_COARSE.max(last >> (2 * l)) } else { last };
    let sampled = level::least_sampled(side, occupancy.cells);
    let mut first = first.filter(|_| sampled <= least);
    // There are passes over the slices for each level that is tried, and then those of the fall from the level that is taken.
    let after = |factor: u32| {
        let level = factor.ilog2();
        slices_of_falls(slices, level, fall_from(factor, level), last_of) + AFTER_THE_FALL[0] * u64::from(slices)
    };
    let find = &mut |factor: u32| {
        progress.expect(u64::from(slices) + after(factor));
        let seen = match first.take() {
            Some(first) => first,
            None => Seen::of(&occupancy, factor, context)?,
        };
        let signed = Signed::find(seen.with_sights(sights, factor, context)?, context)?;
        progress.done(slices);
        Ok(signed)
    };
    let Level { mut signed, factor, is_too_wide } = match asked.rough {
        true => Level::at(sampled.max(least), find)?,
        false => Level::find(&occupancy, sampled, find, context)?,
    };
    let how = How::Sign(Parted {
        outliers: all - occupancy.occupied,
        too_wide: is_too_wide.then_some(factor),
        ..Parted::of(&signed, factor, sights)
    });
    progress.expect(after(factor));
    let level = factor.ilog2();
    let mut levels: Vec<Occupancy> = Vec::new();
    while (levels.len() as u32) < level {
        levels.push(levels.last().unwrap_or(&occupancy).coarser(context)?);
    }
    let at = |l: u32| if l == 0 { &occupancy } else { &levels[l as usize - 1] };
    let mut sides = Sides::signed(&signed, factor, at(level), level, context)?;
    signed.sides = Vec::new();
    let membranes = Membranes::of(&signed.block, factor, &std::mem::take(&mut signed.near_membranes), context)?;
    let sheets = |level: u32| Sheets { block: &signed.block, walls: &signed.sheets, factor, level };
    for l in (0..=level).rev() {
        if l < level {
            sides = sides.refined(at(l), context)?;
        }
        if level > 0 {
            sides = sides.without_bare(context)?;
        }
        let sheets = Some(sheets(l)).filter(|sheets| !sheets.walls.is_empty());
        sides = sides.fallen(at(l), last_of(l), sheets, context, &mut |slices| progress.done(slices))?;
    }
    let solid = Solid::between(&occupancy, &sides, &Ball::squared(last.max(3)), context)?;
    drop(sides);
    progress.done(slices);
    // Sheets before dents: where a body stands on a sheet, the ball would get through its gaps, and the wedge between the two would be dents.
    let thickened = sheets(0).thickened(side, &occupancy, context)?;
    let solid = if let Some(thickened) = &thickened { solid.with(thickened, context)? } else { solid };
    let solid = solid.without_dents(thickened.as_ref(), &occupancy, context)?;
    progress.done(slices);
    // On the grid's own level the field tells the side of every free cell, and its cavities are lined.
    let solid = match level {
        0 => solid,
        _ => solid.without_bare_cavities(thickened.as_ref(), &occupancy, context)?,
    };
    let solid = solid.without_unresolved(&occupancy, context)?;
    progress.done(slices);
    Ok(Closed { solid, occupancy, how, falls: level > 0, components: None, membranes, thickened })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::test_runner::{RngAlgorithm, TestRng};
    use rand::RngExt;

    use super::*;
    use crate::grid::Cell;
    use crate::run::testing::with_context;

    /// All cells count, and the field tells the sides.
    const ASKED: ClosingOptions =
        ClosingOptions { seal: Sealing::Auto, window: None, keep_outliers: true, min_component: None, rough: false };

    /// Points at random on a block and on thin fins that stand on it, turned: cells of 1.37 sampling distances.
    fn finned(turn: &[[f64; 3]; 3], between: f64, numbers: &mut TestRng) -> (BTreeSet<Cell>, Vec<Cell>) {
        let place = |p: [f64; 3]| turn.map(|row| (0..3).map(|a| row[a] * p[a]).sum::<f64>() + 36.0);
        let mut any = |low: f64, high: f64| numbers.random_range(low..high);
        let mut cells = BTreeSet::new();
        let mut points = Vec::new();
        let block = [24.0, 12.0, 6.0];
        for a in 0..3 {
            let [b, c] = [(a + 1) % 3, (a + 2) % 3];
            for _ in 0..(2.0 * 1.88 * 4.0 * block[b] * block[c]) as usize {
                let mut p = [0.0; 3];
                p[a] = if any(0.0, 1.0) < 0.5 { -block[a] } else { block[a] };
                (p[b], p[c]) = (any(-block[b], block[b]), any(-block[c], block[c]));
                p[2] -= block[2];
                points.push(p);
            }
        }
        let fins = [-1.0, 0.0, 1.0].map(|i| i * between);
        for x in fins {
            // Both of its sides.
            for _ in 0..(2.0 * 1.88 * 20.0 * 16.0) as usize {
                points.push([x + any(-0.2, 0.2), any(-10.0, 10.0), any(0.0, 16.0)]);
            }
        }
        cells.extend(points.into_iter().map(|p| place(p).map(|c| c as u32)));
        // The middle of the air between fins.
        let air = [-0.5, 0.5].map(|i| i * between);
        let air =
            air.iter().flat_map(|x| (-8..=8).flat_map(move |y| (3..14).map(move |z| [*x, f64::from(y), f64::from(z)])));
        let air = air.map(|p| place(p).map(|c| c as u32)).collect();
        (cells, air)
    }

    #[test]
    #[ignore = "exhaustive"]
    fn the_air_between_thin_fins_is_outside() {
        let mut wrong = Vec::new();
        for seed in 0..24u8 {
            let mut numbers = TestRng::from_seed(RngAlgorithm::ChaCha, &[seed; 32]);
            let [mut a, mut b] = [(); 2].map(|()| [(); 3].map(|()| numbers.random_range(-1.0..1.0f64)));
            let unit = |v: &mut [f64; 3]| {
                let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
                v.iter_mut().for_each(|c| *c /= length);
            };
            unit(&mut a);
            let along: f64 = (0..3).map(|i| a[i] * b[i]).sum();
            (0..3).for_each(|i| b[i] -= along * a[i]);
            unit(&mut b);
            let c = [0, 1, 2].map(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]);
            let between = numbers.random_range(6.0..10.0);
            let (occupied, air) = finned(&[a, b, c], between, &mut numbers);
            let cells = [72; 3];
            with_context(cells, |context| {
                let occupancy = Occupancy::of_cells(occupied, cells, context).unwrap();
                let solid = close(occupancy, 1.0, ASKED, context, |_, _| ()).unwrap().solid;
                let (mut bits, mut runs) = (crate::grid::slice::Bits::new(72, 72), crate::grid::slice::Runs::default());
                let filled = air.iter().filter(|[x, y, z]| {
                    solid.store.paint(i64::from(*y), &mut bits, &mut runs).unwrap();
                    bits.get(i64::from(*x), i64::from(*z))
                });
                let filled = filled.count();
                if 50 * filled > air.len() {
                    wrong.push((seed, between, filled, air.len()));
                }
            });
        }
        assert!(wrong.is_empty(), "{wrong:?}");
    }
}
