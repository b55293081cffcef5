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

use crate::error::{Error, Result};
use crate::grid::Grid;
use crate::grid::coarse::CoarseGrid;
use crate::grid::context::Context;
use crate::grid::occupancy::Occupancy;
use crate::grid::partition::{slab_count, slices_of};
use crate::points::Precision;
use crate::resources::memory::MemoryPlan;
use crate::resources::workers::Workers;
use crate::run::workload::Workload;
use crate::settings::Settings;
use crate::settings::closing::Sealing;
use crate::solid::close::{ClosingOptions, close};
use crate::storage::spool::Workspace;

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
    let context = Context { workers: workers.clone(), workspace: workspace.clone(), memory };
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
    let slabs = slab_count(workload.smooth, workload.cells[1]);
    let share = |number: u32| {
        let slices = slices_of(number, workload.smooth, workload.cells[1]);
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
