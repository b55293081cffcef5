//! Bare earth: of a cloud's points, those on the ground, by their classes or by a filter, before anything else is made of them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::error::words::thousands;
use crate::error::{Error, Result};
use crate::format::las::write::{ClassifiedFile, ClassifiedPoint, Steps, is_packed};
use crate::ground::{GroundModel, GroundOptions, look};
use crate::input::{Carried, Cloud};
use crate::points::bounds::Bounds;
use crate::points::filter::Verdict;
use crate::points::scalar::{Endian, reader};
use crate::points::unit::Measure;
use crate::points::{Batch, Points};
use crate::resources::workers::Workers;
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::settings::Settings;
use crate::settings::ground::{ClassSet, Classes};
use crate::settings::open::Kind;
use crate::storage::atomic_file::Overwrite;
use crate::storage::spool::Workspace;

/// How the ground was told.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum GroundReport {
    /// By these classes.
    Classes(String),
    /// By a filter with cells of this side.
    Filter {
        /// The side of a cell, in the unit of the coordinates.
        cell: f64,
    },
}

/// Where the verdicts on points are written, and whether they may replace a file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Verdicts<'a> {
    /// The file.
    pub path: &'a Path,
    /// What becomes of one that is there.
    pub overwrite: Overwrite,
}

/// What stays in memory of a model while points are judged, of each block in flight: a tile and an order.
const JUDGING: u64 = 4 << 20;

/// The memory that is left for all else, of a budget, where points are judged.
pub(crate) fn budget_beside(settings: &Settings, budget: u64, workers: &Workers) -> u64 {
    match is_asked(settings) {
        true => budget.saturating_sub(JUDGING * workers.threads() as u64),
        false => budget,
    }
}

fn is_asked(settings: &Settings) -> bool {
    settings.open.is_some_and(|open| open.kind == Kind::Ground)
}

/// Leaves of a cloud the points on the ground, if the settings ask for these; the file of verdicts is whole then, if one was asked for.
///
/// # Errors
/// [`Error::InvalidSetting`] if the coordinates are degrees; [`Error::Usage`] if there are no classes to go by, or none to write; errors of reading the
/// input and of writing.
pub(crate) fn bare_earth(
    cloud: &mut Cloud,
    settings: &Settings,
    verdicts: Option<Verdicts>,
    budget: u64,
    workers: &Workers,
    workspace: &Workspace,
    progress: &mut Progress,
) -> Result<Option<GroundReport>> {
    if !is_asked(settings) {
        return Ok(None);
    }
    let by_classes = |cloud: &mut Cloud, classes: ClassSet| {
        if verdicts.is_some() {
            let words = "`write_classes`: the ground is told by the classes that the points have; `classes` none has it told by the filter";
            return Err(Error::setting("write_classes", words.into()));
        }
        cloud.keep_classes(&classes.iter().collect::<Vec<_>>())?;
        Ok(Some(GroundReport::Classes(Classes::Of(classes).to_string())))
    };
    if let Classes::Of(classes) = settings.classes {
        return by_classes(cloud, classes);
    }
    let metre = match cloud.measure() {
        Some(Measure::Length(unit)) => 1.0 / unit.in_metres(),
        Some(Measure::Degrees) => {
            let words = "`surface` ground: the input's coordinates are degrees, in which the filter's lengths cannot be told; reproject the input to metres or feet";
            return Err(Error::setting("surface", words.into()));
        }
        Some(Measure::Mixed) => {
            let words = "`surface` ground: the input has one unit on the map and another in height; reproject the input to one unit";
            return Err(Error::setting("surface", words.into()));
        }
        None => 1.0,
    };
    let asked = GroundOptions::usual(metre);
    progress.begin(Phase::Ground, None);
    let found = look(cloud, asked, budget, workers, workspace, |records| progress.add(records))?;
    if settings.classes == Classes::Auto && found.classes[2] > 0 {
        progress.end();
        let (ground, all) = (thousands(found.classes[2]), thousands(found.points));
        progress.note(&format!("ground: told by classes 2 and 9 ({ground} of {all} points are of class 2)"));
        return by_classes(cloud, ClassSet::GROUND);
    }
    if cloud.measure().is_none() {
        progress.note("ground: the unit of the coordinates is not known, and taken to be the metre; `crs` names the reference system");
    }
    let model = found.model(asked, budget, workers, workspace, |_, _| ())?;
    progress.end();
    let model: Arc<GroundModel> = Arc::new(model);
    if let Some(Verdicts { path, overwrite }) = verdicts {
        write(path, cloud, &model, overwrite, workers)?;
    }
    cloud.judge_by(model);
    Ok(Some(GroundReport::Filter { cell: asked.cell }))
}

/// The file of verdicts that a job asks for.
///
/// # Errors
/// [`Error::InvalidSetting`] if the surface is not the ground, or the name does not end in .laz or .las.
pub(crate) fn verdicts<'a>(
    path: &'a Option<PathBuf>,
    settings: &Settings,
    overwrite: Overwrite,
) -> Result<Option<Verdicts<'a>>> {
    let Some(path) = path else { return Ok(None) };
    if !is_asked(settings) {
        return Err(Error::setting("write_classes", "`write_classes`: is for `surface` ground".into()));
    }
    if is_packed(path).is_none() {
        let words = format!("`write_classes` {}: expected a name with .laz or .las", path.display());
        return Err(Error::setting("write_classes", words));
    }
    Ok(Some(Verdicts { path, overwrite }))
}

/// The attributes that are written with a point, if files have them.
const WRITTEN: [&str; 7] =
    ["intensity", "return_number", "number_of_returns", "classification", "scan_angle", "point_source_id", "gps_time"];

/// The most digits behind the point that coordinates are looked at for.
const DIGITS: i32 = 5;

/// Writes all points that count, in the order of the input, with class 2 if they lie on the ground and 1 if not; classes for noise (7, 18) and water (9) stay.
/// Steps are as fine as the coordinates' own digits, up to five behind the point.
fn write(path: &Path, cloud: &Cloud, model: &GroundModel, overwrite: Overwrite, workers: &Workers) -> Result<()> {
    let in_flight = 2 * workers.threads();
    let place = |points: &Points, number: usize| match points {
        Points::Single(points) => points[number].map(f64::from),
        Points::Double(points) => points[number],
    };
    let mut bounds = Bounds::EMPTY;
    let mut digits = 2;
    let look = |batch: &Batch| {
        let places = (0..batch.points.len()).map(|number| place(&batch.points, number));
        Ok(places.fold((Bounds::EMPTY, 2), |(bounds, digits), place| {
            let needed = place.iter().map(|c| digits_of(*c, digits)).fold(digits, i32::max);
            (bounds.union(Bounds { min: place, max: place }), needed)
        }))
    };
    cloud.for_each_batch(workers, in_flight, Carried::Coordinates, look, |(box_of, needed)| {
        bounds = bounds.union(box_of);
        digits = digits.max(needed);
        Ok(())
    })?;
    let mut file = ClassifiedFile::create(path, Steps::of(&bounds, digits), cloud.crs(), overwrite)?;
    let schema = cloud.schema_of(&WRITTEN);
    let columns =
        WRITTEN.map(|name| schema.column(name).map(|column| (column.offset, reader(column.scalar, Endian::NATIVE))));
    let coarse_angles = schema.attributes().iter().any(|a| a.name == "scan_angle" && a.scalar.bytes() == 1);
    let stride = schema.stride();
    let work = |batch: &Batch| {
        let verdicts = model.judge(&batch.points)?;
        let of = |number: usize| {
            let record = &batch.attributes[number * stride..(number + 1) * stride];
            let value = |which: usize| columns[which].as_ref().map_or(0.0, |(at, read)| read(&record[*at..]));
            let class = match value(3) as u8 {
                kept @ (7 | 9 | 18) => kept,
                _ if verdicts[number] => 2,
                _ => 1,
            };
            ClassifiedPoint {
                place: place(&batch.points, number),
                intensity: value(0) as u16,
                returns: [value(1) as u8, value(2) as u8],
                class,
                scan_angle: (value(4) * if coarse_angles { 1.0 / 0.006 } else { 1.0 }).round() as i16,
                source: value(5) as u16,
                time: value(6),
            }
        };
        Ok((0..batch.points.len()).map(of).collect::<Vec<_>>())
    };
    cloud.for_each_batch(workers, in_flight, Carried::Only(&WRITTEN), work, |points| file.append(&points))?;
    file.finish()
}

/// The digits behind the point that a coordinate has, from `least` to [`DIGITS`].
fn digits_of(c: f64, least: i32) -> i32 {
    let whole = |digits: &i32| {
        let steps = c * 10f64.powi(*digits);
        (steps - steps.round()).abs() < 1e-3
    };
    (least..DIGITS).find(whole).unwrap_or(DIGITS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_those_of_the_file() {
        assert_eq!(digits_of(6_277_550.12, 2), 2);
        assert_eq!(digits_of(6_277_550.123, 2), 3);
        assert_eq!(digits_of(273_357.143_75, 2), 5);
        assert_eq!(digits_of(1.0 / 3.0, 2), 5);
    }
}
