//! Rehearsal: the run in small, to know how many faces each slab is going to have before a point is sorted.
//!
//! The survey's coarse grid is closed as the grid's cells are going to be, and once more at half the resolution. That tells how the surface's
//! area goes with the cells' side c, and so what it comes to at the grid's w:
//!
//! ```text
//!   area      a . . . . . . rough: it grows as it did from 2c to c, as a power of the side (trees, noise, folds)
//!    |     b /
//!    |      /               smooth: a body of coarse cells is larger by about a half of them on either side,
//!    |     / . . a          which goes to nothing as the cells do
//!    +----+----+-------> side
//!         w    c   2c
//! ```
//!
//! What a rehearsal cannot see: points too few or too noisy for the grid's cells. It is for plans; when the solid is known, its faces are counted.
//!
//! Where there is no surface (strays by the million, all over the box), the growth from cell to cell is no guide: nothing is refused on its account, as long as
//! as many faces as the coarse cells have would do.
//!
//! A surface that is not closed has walls, which fall to few slabs: a box seen from above has nearly all faces of two of its sides in the first and the last one. So its columns
//! are made of the coarse cells, too. They are put into the grid of the run, whose cells are taken together by a power of two until they are as wide as the coarse ones, as
//! it is turned and with its margin: where the coarse cells are the finer ones, what is found is nearly what the run is going to find.

use crate::error::{Error, Result};
use crate::grid::Grid;
use crate::grid::coarse::{CoarseGrid, SIDE};
use crate::grid::context::Context;
use crate::grid::occupancy::Occupancy;
use crate::grid::partition::{slab_count, slices_of};
use crate::points::Precision;
use crate::resources::memory::MemoryPlan;
use crate::resources::workers::Workers;
use crate::run::workload::{ColumnWorkload, Workload};
use crate::settings::Settings;
use crate::settings::closing::Sealing;
use crate::settings::open::{Kind, Open};
use crate::solid::close::{ClosingOptions, close};
use crate::solid::heightfield::{self, HeightFieldOptions};
use crate::solid::level::{COARSE, side_in_samples};
use crate::storage::spool::Workspace;
use crate::surface::vertices::{self, Weight};

/// Points from which a run is worth a rehearsal, which takes about as long as a cloud of 100,000.
pub const WORTH_IT: u64 = 3_000_000;

/// What is added to the faces found, for what coarse cells do not show: a share.
const DOUBT: f64 = 0.04;

/// The most that a rough surface's area is taken to grow from the coarse cells to the grid's.
const ROUGHEST: f64 = 2.0;

/// What an estimate is made from: what the survey found.
#[derive(Debug, Clone, Copy)]
pub struct EstimateInput<'a> {
    /// The workload, with the faces that the box alone lets expect.
    pub workload: &'a Workload,
    /// The cells of the points at a coarse resolution.
    pub coarse_grid: &'a CoarseGrid,
    /// The grid of the run.
    pub grid: &'a Grid,
    /// How its cells are going to be closed.
    pub settings: &'a Settings,
}

/// The workload with the faces to expect from closing the coarse cells; unchanged where these cannot be closed as asked. `budget` is in bytes, as for
/// [`MemoryPlan::for_budget`]. `progress` is told the slices that are done, and all there are, over all passes.
///
/// # Errors
/// [`Error::Io`], [`Error::Interrupted`].
pub fn estimate_faces(
    known: EstimateInput<'_>,
    workers: &Workers,
    workspace: &Workspace,
    budget: u64,
    mut progress: impl FnMut(u64, u64),
) -> Result<Workload> {
    let EstimateInput { workload, coarse_grid, grid, settings } = known;
    let axes = grid.axis().file_axes();
    let (low, extent) = coarse_grid.extent();
    let cells = axes.map(|a| extent[a]);
    let small = Workload::in_cells(1, Precision::Single, cells, 1);
    let own = budget.max(MemoryPlan::least(&small, workers.threads()));
    let memory = MemoryPlan::for_budget(own, &small, workers.threads())?;
    let context = Context::new(workers, workspace, memory);
    let mut coarse = Occupancy::of_cells(coarse_grid.cells().map(|cell| axes.map(|a| cell[a])), cells, &context)?;
    let (mut side, w) = (coarse_grid.side(), grid.cell_size());
    // Cells of a grid that is as coarse as the coarse grid may be finer than the sampling already.
    while side < 0.9 * w && coarse.cells != [1; 3] {
        (coarse, side) = (coarse.coarser(&context)?, 2.0 * side);
    }
    let coarser = coarse.coarser(&context)?;
    // The cells are closed twice, the second time an eighth of them.
    let mut before = 0;
    let mut faces = |occupancy: Occupancy, side: f64| {
        let mut all = 0;
        let told = |done: u64, total: u64| {
            all = done;
            progress(before + done, before + total);
        };
        let closed = close(occupancy, side, asked(settings, w / side), &context, told);
        before += all;
        match closed {
            Ok(closed) => Ok(Some((closed.solid.faces, closed.falls))),
            // A radius that is too much for the box is refused when the cells themselves are closed.
            Err(Error::InvalidSetting { name: "seal" | "min_component", .. }) => Ok(None),
            Err(error) => Err(error),
        }
    };
    let (Some((found, falls)), Some((half, _))) = (faces(coarse, side)?, faces(coarser, 2.0 * side)?) else {
        return Ok(workload.clone());
    };
    let area = |faces: &[u32], side: f64| faces.iter().map(|f| f64::from(*f)).sum::<f64>() * side * side;
    let growth = growth(area(&found, side) / area(&half, 2.0 * side).max(f64::MIN_POSITIVE), side / w);
    // Slices of the grid begin at the box's lowest place, coarse ones at a multiple of their side.
    let along = axes[1];
    let bottom = grid.bounds().min[along] / side - low[along] as f64 * coarse_grid.side() / side;
    let slabs = slab_count(workload.partition(), workload.cells[1]);
    let share = |number: u32| {
        let slices = slices_of(number, workload.partition(), workload.cells[1]);
        let [from, to] = [slices.start, slices.end].map(|y| bottom + f64::from(y) * w / side);
        let first = from.max(0.0) as usize;
        let shared =
            |(i, faces): (usize, &u32)| f64::from(*faces) * (to.min((i + 1) as f64) - from.max(i as f64)).max(0.0);
        found.iter().enumerate().skip(first).take((to - from) as usize + 2).map(shared).sum::<f64>()
    };
    let shares: Vec<f64> = (0..slabs).map(share).collect();
    // The slabs have all faces, also where they are thinner than the coarse slices they lie in.
    let all = found.iter().map(|f| f64::from(*f)).sum::<f64>() / shares.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let with = |factor: f64| {
        let of_slab = |share: &f64| (share * all * factor * (1.0 + DOUBT)).ceil() as u64;
        workload.with_faces(shares.iter().map(of_slab).collect(), falls)
    };
    let expected = with((side / w).powi(2) * growth);
    if growth >= ROUGHEST && budget < MemoryPlan::least(&expected, workers.threads()) {
        return Ok(with(1.0));
    }
    Ok(expected)
}

/// The most cells along an axis that columns are estimated on.
const WIDEST: u32 = 512;

/// The workload of an open surface with the faces to expect from the coarse cells' columns. `budget` is in bytes. `progress` is told of passes.
///
/// # Errors
/// [`Error::Io`], [`Error::Interrupted`].
pub fn estimate_open_faces(
    known: EstimateInput<'_>,
    open: &Open,
    workers: &Workers,
    workspace: &Workspace,
    budget: u64,
    mut progress: impl FnMut(u64, u64),
) -> Result<Workload> {
    let EstimateInput { workload, coarse_grid, grid, .. } = known;
    let w = grid.cell_size();
    let mut factor = 1;
    while f64::from(factor) * w < coarse_grid.side() || grid.cells().iter().any(|cells| cells / factor > WIDEST) {
        factor *= 2;
    }
    progress(0, 2);
    let (found, last_plane) = faces_of_columns(known, open, factor, workers, workspace, budget)?;
    progress(1, 2);
    let area =
        |faces: &[u32], factor: u32| faces.iter().map(|f| f64::from(*f)).sum::<f64>() * f64::from(factor).powi(2);
    // Finer cells show no more of a smooth one than its own area, which columns as wide as these have already.
    let growth = match factor {
        1 => 1.0,
        _ => {
            let (half, _) = faces_of_columns(known, open, 2 * factor, workers, workspace, budget)?;
            growth(area(&found, factor) / area(&half, 2 * factor).max(f64::MIN_POSITIVE), f64::from(factor)).max(1.0)
        }
    };
    progress(2, 2);
    // Each of a coarse slice's faces comes to as many of the grid's slices along it, and to as many on each.
    let scale = f64::from(factor) * growth * (1.0 + DOUBT);
    let of_slice = |y: u32| (f64::from(found[(y / factor) as usize]) * scale).ceil() as u32;
    let mut faces: Vec<u32> = (0..grid.cells()[1]).map(of_slice).collect();
    // The plane above the last slice is that of one slice, however many a coarse one comes to.
    if let Some(last) = faces.last_mut() {
        *last += (f64::from(last_plane) * scale).ceil() as u32;
    }
    Ok(workload.with_faces_of_slices(&faces, false))
}

/// The faces that count for memory of each slice of columns made of the coarse cells, in the grid's cells taken together by `factor`, and of the plane above the last.
fn faces_of_columns(
    known: EstimateInput<'_>,
    open: &Open,
    factor: u32,
    workers: &Workers,
    workspace: &Workspace,
    budget: u64,
) -> Result<(Vec<u32>, u32)> {
    let EstimateInput { coarse_grid, grid, settings, .. } = known;
    let cells = grid.cells().map(|c| c.div_ceil(factor));
    let (up, bridge) = (open.up(grid), open.bridge(grid).div_ceil(factor));
    let columns = ColumnWorkload { of_slice: cells[up.across()], bridge };
    let small = Workload::in_cells(1, Precision::Single, cells, 1).with_columns(columns);
    let own = budget.max(MemoryPlan::least(&small, workers.threads()));
    let memory = MemoryPlan::for_budget(own, &small, workers.threads())?;
    let context = Context::new(workers, workspace, memory);
    let (low, side) = (coarse_grid.extent().0, coarse_grid.side());
    let middle = |cell: [u32; 3]| std::array::from_fn(|a| (low[a] as f64 + f64::from(cell[a]) + 0.5) * side);
    let occupied = coarse_grid.cells().map(|cell| grid.cell_of(middle(cell)).map(|c| c / factor));
    let occupancy = Occupancy::of_cells(occupied, cells, &context)?;
    let asked = HeightFieldOptions {
        up,
        bridge,
        ball: open.ball(settings.seal, settings.window, f64::from(factor) * grid.cell_size()),
        base: open.base.is_some(),
        jump: open.jump(grid).map(|jump| jump.div_ceil(factor)),
        one_layer: open.kind != Kind::Sheet,
        smooth: settings.surface.smooth,
    };
    let solid = heightfield::solid::<f32>(&occupancy, None, asked, &context)?;
    let (weights, last_plane) = vertices::weights_below(&solid, &context)?;
    Ok((weights.into_iter().map(Weight::rectangles).collect(), last_plane))
}

/// The sampling distance as coarse cells show it may be more than the grid's cells are going to show, by this part.
const SURE: f64 = 0.75;

/// Above this number of sampling distances to a cell, hardly any cell is empty by chance, and the coarse cells tell nothing of the sampling.
const TELLS: f64 = 1.6;

/// Points to a coarse cell, on average, above which some lie denser than the cells show.
const MOST_IN_CELL: u64 = 4;

/// How many of the grid's cells come to one of the level that inside and outside are told apart on, at the least: that level's are [`COARSE`] sampling distances wide, and how
/// many coarse cells there are at two resolutions tells the sampling distance, where they are fine enough for it. It is for plans.
pub fn level_to_expect(points: u64, coarse_grid: &CoarseGrid, grid: &Grid) -> u32 {
    let w = grid.cell_size();
    // No finer than the grid's cells, which are what is counted in the end.
    let mut halvings = 0;
    while coarse_grid.side() * f64::from(1u32 << halvings) < 0.9 * w && halvings < SIDE.ilog2() {
        halvings += 1;
    }
    let (cells, coarser) = (coarse_grid.count(halvings), coarse_grid.count(halvings + 1));
    let side = side_in_samples(cells as f64 / coarser as f64);
    // A dense body among strays has many points to a cell, and strays, a cell each, say nothing of it.
    if side > TELLS || points > MOST_IN_CELL * cells {
        return 1;
    }
    let sampling = coarse_grid.side() * f64::from(1u32 << halvings) / side;
    let longest = grid.cells().into_iter().max().unwrap_or(1);
    let factor = (COARSE * SURE * sampling / w).floor().min(f64::from(longest / 8));
    factor.max(1.0) as u32
}

/// What is asked of the closing of coarse cells, of which `scale` come to a cell of the grid.
fn asked(settings: &Settings, scale: f64) -> ClosingOptions {
    let cells = |radius: u32| (f64::from(radius) * scale).round().max(1.0) as u32;
    let seal = match settings.seal {
        Sealing::Cells(radius) => Sealing::Cells(cells(radius)),
        other => other,
    };
    let window = settings.window.map(|window| 2 * cells((window - 1) / 2) + 1);
    ClosingOptions { seal, window, keep_outliers: settings.keep_outliers, min_component: None, rough: true }
}

/// By how much the area grows from coarse cells, `steps` times as large as the grid's, to these, if from twice as large ones it came to `last`
/// times as much.
fn growth(last: f64, steps: f64) -> f64 {
    if last > 1.0 {
        libm::pow(last, libm::log2(steps.max(1.0))).min(ROUGHEST)
    } else {
        1.0 - (1.0 / last.max(0.5) - 1.0) * (1.0 - 1.0 / steps.max(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::growth;

    #[test]
    fn a_smooth_body_shrinks_to_its_own_area_and_a_rough_one_grows() {
        // A ball of radius 10 whose coarse cells, of sides 1 and 2, stand off by a half of them.
        let area = |side: f64| (10.0 + side / 2.0).powi(2);
        let at_rest = area(1.0) * growth(area(1.0) / area(2.0), 1e9);
        assert!((at_rest / 100.0 - 1.0).abs() < 0.02, "{at_rest}");
        assert_eq!(growth(0.9, 1.0), 1.0);
        assert!((growth(1.1, 8.0) - 1.1f64.powi(3)).abs() < 1e-12);
        assert_eq!(growth(3.0, 1024.0), 2.0);
    }
}
