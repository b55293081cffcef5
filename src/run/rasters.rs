//! Rasters beside the mesh: the heights of a cloud's points, cell by cell, as GeoTIFF.

use std::path::Path;

use crate::error::words::{short, thousands};
use crate::error::{Error, Result};
use crate::format::geotiff::{self, Area, BLOCK};
use crate::input::Cloud;
use crate::input::ground::cells::{Cells, Gathered, gather};
use crate::input::ground::surface::{MOST, without_small_holes};
use crate::input::ground::tiles::{TILE, Tiles};
use crate::points::unit::Measure;
use crate::resources::workers::Workers;
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::settings::open::Hole;
use crate::storage::atomic_file::AtomicFile;
use crate::storage::spool::Workspace;

/// A raster that is asked for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Raster<'a> {
    /// The file.
    pub file: &'a AtomicFile,
    /// The side of a cell; a metre if none was given.
    pub side: Option<f64>,
    /// The widest hole that is filled.
    pub hole: Hole,
}

/// Whether a name is that of a GeoTIFF file.
///
/// # Errors
/// [`Error::InvalidSetting`] naming `setting` if it is not.
pub(crate) fn check_name(setting: &'static str, path: &Path) -> Result<()> {
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    match extension.as_deref() {
        Some("tif" | "tiff") => Ok(()),
        _ => {
            Err(Error::setting(setting, format!("`{setting}` {}: expected a name with .tif or .tiff", path.display())))
        }
    }
}

impl Raster<'_> {
    /// Fills the file with the heights that `G` gathers of the cloud's points.
    ///
    /// # Errors
    /// Errors of reading the input; [`Error::InvalidSetting`] if there would be too many cells, or the side of one is not to be told; [`Error::Io`].
    pub(crate) fn fill<G: Gathered>(
        &self,
        cloud: &Cloud,
        budget: u64,
        workers: &Workers,
        workspace: &Workspace,
        progress: &mut Progress,
    ) -> Result<()> {
        let side = match (self.side, cloud.measure()) {
            (Some(side), _) => side,
            (None, Some(Measure::Length(unit))) => 1.0 / unit.in_metres(),
            (None, None) => 1.0,
            (None, Some(Measure::Degrees | Measure::Mixed)) => {
                let words = "`raster_size`: must be given where the map's unit is not one of length, or another than that of heights";
                return Err(Error::setting("raster_size", words.into()));
            }
        };
        progress.begin(Phase::Gather, None);
        let Cells { heights, points, .. } = gather::<G>(cloud, side, budget / 4, workers, workspace, |_| ())?;
        if points == 0 {
            return Err(Error::NoPoints { dropped: 0, filtered: 0 });
        }
        let area = area(&heights, side)?;
        area.check()?;
        let radius = self.hole.radius(side).ceil().clamp(0.0, f64::from(MOST)) as u32;
        let heights = without_small_holes(&heights, radius, budget, workers, workspace)?;
        geotiff::write(self.file, area, cloud.crs(), |first| {
            workers.check_cancelled()?;
            block(&heights, first)
        })?;
        let [rows, columns] = area.cells;
        progress.note(&format!(
            "{}: {} x {} cells of {}",
            self.file.path().display(),
            thousands(columns),
            thousands(rows),
            short(side)
        ));
        progress.end();
        Ok(())
    }
}

/// The cells of a block; `None` if no tile reaches there.
fn block(heights: &Tiles, first: [i64; 2]) -> Result<Option<Vec<f32>>> {
    let last = first.map(|at| at + BLOCK as i64 - 1);
    let [low, high] = [first, last].map(|cell| cell.map(|at| at.div_euclid(TILE as i64)));
    let any = (low[0]..=high[0]).any(|row| {
        let next = heights.places().partition_point(|place| *place < [row, low[1]]);
        heights.places().get(next).is_some_and(|place| *place <= [row, high[1]])
    });
    if any { heights.window(first, BLOCK).map(Some) } else { Ok(None) }
}

/// The rows and columns that hold all heights.
fn area(heights: &Tiles, side: f64) -> Result<Area> {
    let (mut low, mut high) = ([i64::MAX; 2], [i64::MIN; 2]);
    for place in heights.places() {
        let first = place.map(|at| at * TILE as i64);
        let inside = (0..2).all(|a| low[a] <= first[a] && first[a] + (TILE as i64) < high[a]);
        if inside {
            continue;
        }
        let window = heights.window(first, TILE)?;
        for at in window.iter().enumerate().filter(|(_, height)| !height.is_nan()).map(|(at, _)| at) {
            let cell = [first[0] + (at / TILE) as i64, first[1] + (at % TILE) as i64];
            (low, high) = ([0, 1].map(|a| low[a].min(cell[a])), [0, 1].map(|a| high[a].max(cell[a])));
        }
    }
    let cells = [0, 1].map(|a| (high[a] - low[a]) as u64 + 1);
    Ok(Area { first: [high[0], low[1]], cells, side })
}
