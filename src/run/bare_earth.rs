//! Bare earth: of a cloud's points, those on the ground, by their classes or by a filter, before anything else is made of them.

use std::path::Path;
use std::sync::Arc;

use bytesize::ByteSize;

use crate::error::words::thousands;
use crate::error::{Error, Result};
use crate::format::las::write::{ClassifiedFile, ClassifiedPoint, Steps, is_packed};
use crate::input::ground::cells::{Highest, Mean};
use crate::input::ground::{GroundModel, GroundOptions, look};
use crate::input::{Carried, Cloud};
use crate::points::bounds::Bounds;
use crate::points::filter::Verdict;
use crate::points::scalar::{Endian, reader};
use crate::points::unit::Measure;
use crate::points::{Batch, Points};
use crate::resources::workers::{Spares, Workers};
use crate::run::job::Job;
use crate::run::phase::Phase;
use crate::run::progress::{Progress, Warning};
use crate::run::rasters::{Raster, check_name};
use crate::settings::Settings;
use crate::settings::ground::{ClassSet, Classes};
use crate::settings::open::{Hole, Kind};
use crate::storage::atomic_file::{AtomicFile, Overwrite};
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

/// What is asked for beside the mesh: of all points, or of those on the ground.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Beside<'a> {
    /// The verdicts on points.
    pub classes: Option<&'a Path>,
    /// The heights of the ground.
    pub dtm: Option<&'a Path>,
    /// The heights of what is highest.
    pub dsm: Option<&'a Path>,
    /// The side of a raster's cells.
    pub side: Option<f64>,
    /// The widest hole that is filled.
    pub hole: Hole,
    /// What becomes of files that are there.
    pub overwrite: Overwrite,
}

impl<'a> Beside<'a> {
    /// What a job asks for.
    ///
    /// # Errors
    /// [`Error::InvalidSetting`] if names do not end as they must, or nothing tells the ground.
    pub(crate) fn of(job: &'a Job) -> Result<Beside<'a>> {
        let (classes, dtm, dsm) = (job.write_classes.as_deref(), job.dtm.as_deref(), job.dsm.as_deref());
        if let Some(path) = classes {
            if !is_asked(&job.settings) && dtm.is_none() {
                let words = "`write_classes`: is for `surface` ground, or beside `dtm`";
                return Err(Error::setting("write_classes", words.into()));
            }
            if is_packed(path).is_none() {
                let words = format!("`write_classes` {}: expected a name with .laz or .las", path.display());
                return Err(Error::setting("write_classes", words));
            }
        }
        if job.settings.classes != Classes::Auto && !is_asked(&job.settings) && dtm.is_none() {
            let words =
                "`classes`: is for `surface` ground, or beside `dtm`; a filter of classes takes points of some only";
            return Err(Error::setting("classes", words.into()));
        }
        dtm.map_or(Ok(()), |path| check_name("dtm", path))?;
        dsm.map_or(Ok(()), |path| check_name("dsm", path))?;
        let side = job.raster_size;
        if let Some(side) = side {
            if dtm.is_none() && dsm.is_none() {
                return Err(Error::setting("raster_size", "`raster_size`: is for `dtm` and `dsm`".into()));
            }
            if !(side.is_finite() && side > 0.0) {
                return Err(Error::setting("raster_size", format!("`raster_size` {side}: expected a length above 0")));
            }
        }
        let hole = job.settings.open.map_or(Hole::DEFAULT, |open| open.max_hole);
        Ok(Beside { classes, dtm, dsm, side, hole, overwrite: job.overwrite })
    }

    /// The files that are written.
    pub(crate) fn paths(&self) -> impl Iterator<Item = &'a Path> {
        [self.classes, self.dtm, self.dsm].into_iter().flatten()
    }

    /// Creates the files: what can fail for want of room or rights, or for files that are there, fails now.
    ///
    /// # Errors
    /// Those of [`AtomicFile::create`].
    pub(crate) fn create(&self) -> Result<BesideFiles> {
        let file = |path: Option<&Path>| path.map(|path| AtomicFile::create(path, self.overwrite)).transpose();
        let [classes, dtm, dsm] = [file(self.classes)?, file(self.dtm)?, file(self.dsm)?];
        Ok(BesideFiles { classes, dtm, dsm, side: self.side, hole: self.hole })
    }
}

/// The files beside the mesh. They get their names when the mesh has its own: what fails leaves none.
#[derive(Debug, Default)]
pub(crate) struct BesideFiles {
    classes: Option<AtomicFile>,
    dtm: Option<AtomicFile>,
    dsm: Option<AtomicFile>,
    side: Option<f64>,
    hole: Hole,
}

impl BesideFiles {
    fn raster<'a>(&self, file: &'a AtomicFile) -> Raster<'a> {
        Raster { file, side: self.side, hole: self.hole }
    }

    /// Takes the lengths of what is asked for, now that the input's unit is known.
    pub(crate) fn measure_as(&mut self, asked: &Beside) {
        (self.side, self.hole) = (asked.side, asked.hole);
    }

    /// Gives the files their names.
    ///
    /// # Errors
    /// Those of [`AtomicFile::finish`].
    pub(crate) fn finish(self) -> Result<()> {
        [self.classes, self.dtm, self.dsm].into_iter().flatten().try_for_each(AtomicFile::finish)
    }
}

/// What stays in memory of a model while points are judged, of each block in flight: a tile and an order.
const JUDGING: u64 = 4 << 20;

/// The memory that is left for all else, of a budget, where points are judged.
pub(crate) fn budget_beside(settings: &Settings, budget: u64, workers: &Workers) -> u64 {
    budget.saturating_sub(judging(settings, workers))
}

/// The memory that judging points takes, if they are judged.
fn judging(settings: &Settings, workers: &Workers) -> u64 {
    if is_asked(settings) { JUDGING * workers.threads() as u64 } else { 0 }
}

/// An error of what has the budget that [`budget_beside`] leaves: the figures of a refusal are those of the whole.
pub(crate) fn of_whole_budget(error: Error, settings: &Settings, budget: u64, workers: &Workers) -> Error {
    let judging = judging(settings, workers);
    match error {
        Error::Budget { needed, what, .. } if judging > 0 => Error::Budget {
            given: ByteSize(budget),
            needed: ByteSize((needed.0 + judging).next_multiple_of(1 << 20)),
            what,
        },
        other => other,
    }
}

fn is_asked(settings: &Settings) -> bool {
    settings.open.is_some_and(|open| open.kind == Kind::Ground)
}

/// What tells the ground.
enum Telling {
    Classes(ClassSet),
    Model(Arc<GroundModel>, f64),
}

/// Leaves of a cloud the points on the ground, if the settings ask for these. The files beside the mesh are whole then.
///
/// # Errors
/// [`Error::InvalidSetting`] if the coordinates are degrees, or there are no verdicts to write; [`Error::Usage`] if there are no classes to go by; errors of reading the
/// input and of writing.
pub(crate) fn bare_earth(
    cloud: &mut Cloud,
    settings: &Settings,
    beside: &mut BesideFiles,
    budget: u64,
    workers: &Workers,
    workspace: &Workspace,
    progress: &mut Progress,
) -> Result<Option<GroundReport>> {
    if let Some(file) = &beside.dsm {
        beside.raster(file).fill::<Highest>(cloud, budget, workers, workspace, progress)?;
    }
    if !is_asked(settings) && beside.dtm.is_none() {
        return Ok(None);
    }
    let telling = told(cloud, settings, budget, workers, workspace, progress)?;
    let report = match &telling {
        Telling::Classes(_) if beside.classes.is_some() => {
            let words = "`write_classes`: the ground is told by the classes that the points have; `classes` none has it told by the filter";
            return Err(Error::setting("write_classes", words.into()));
        }
        Telling::Classes(classes) => GroundReport::Classes(Classes::Of(*classes).to_string()),
        Telling::Model(model, cell) => {
            if let Some(file) = beside.classes.take() {
                beside.classes = Some(classified(file, cloud, model, workers)?);
            }
            GroundReport::Filter { cell: *cell }
        }
    };
    let all = cloud.sifting();
    match telling {
        Telling::Classes(classes) => cloud.keep_classes(&classes.iter().collect::<Vec<_>>())?,
        Telling::Model(model, _) => cloud.judge_by(model),
    }
    if let Some(file) = &beside.dtm {
        beside.raster(file).fill::<Mean>(cloud, budget, workers, workspace, progress)?;
    }
    if !is_asked(settings) {
        cloud.sift_by(all);
    }
    Ok(Some(report))
}

/// Leaves of a cloud the points on the ground, if the settings ask for these and name the classes that tell it.
///
/// # Errors
/// [`Error::InvalidSetting`] if they do not name classes; [`Error::Usage`] if there are no classes to go by.
pub(crate) fn keep_ground(cloud: &mut Cloud, settings: &Settings) -> Result<()> {
    match settings.classes {
        _ if !is_asked(settings) => Ok(()),
        Classes::Of(classes) => cloud.keep_classes(&classes.iter().collect::<Vec<_>>()),
        _ => {
            let words = "`classes`: tasks do not look at all points for what is ground; name its classes, as in `classes` 2,9, or reconstruct in one run";
            Err(Error::setting("classes", words.into()))
        }
    }
}

/// Finds out what tells the ground.
fn told(
    cloud: &Cloud,
    settings: &Settings,
    budget: u64,
    workers: &Workers,
    workspace: &Workspace,
    progress: &mut Progress,
) -> Result<Telling> {
    if let Classes::Of(classes) = settings.classes {
        return Ok(Telling::Classes(classes));
    }
    let metre = match cloud.measure() {
        Some(Measure::Length(unit)) => 1.0 / unit.in_metres(),
        Some(Measure::Degrees) => {
            let words = "`classes`: the input's coordinates are degrees, in which the ground filter's lengths cannot be told; reproject the input to metres or feet";
            return Err(Error::setting("classes", words.into()));
        }
        Some(Measure::Mixed) => {
            let words = "`classes`: the input has one unit on the map and another in height, and the ground filter wants one; reproject the input";
            return Err(Error::setting("classes", words.into()));
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
        return Ok(Telling::Classes(ClassSet::GROUND));
    }
    if settings.classes == Classes::Auto {
        // Never classified are 0 and 1.
        match found.classes[2..].iter().any(|points| *points > 0) {
            true => progress.warn(&Warning::new(
                "no point has class 2 (ground), though points have classes: a filter tells the ground by the shape of what is lowest",
                "--classes names the classes of the ground; --classes none asks for the filter",
            )),
            false => progress.note("ground: told by a filter, as points have no classes"),
        }
    }
    if cloud.measure().is_none() {
        progress.note("ground: the unit of the coordinates is not known, and taken to be the metre; `crs` names the reference system");
    }
    let model = found.model(asked, budget, workers, workspace, |_, _| ())?;
    progress.end();
    Ok(Telling::Model(Arc::new(model), asked.cell))
}

/// What is read of points whether the mesh carries it or not: what tells the ground, and what is written with verdicts.
pub(crate) fn looked_at(job: &Job) -> &'static [&'static str] {
    match &job.write_classes {
        Some(_) => &WRITTEN,
        None if is_asked(&job.settings) || job.dtm.is_some() => &["classification"],
        None => &[],
    }
}

/// The attributes that are written with a point, if files have them.
const WRITTEN: [&str; 7] =
    ["intensity", "return_number", "number_of_returns", "classification", "scan_angle", "point_source_id", "gps_time"];

/// The most digits behind the point that coordinates are looked at for.
const DIGITS: i32 = 5;

/// Writes all points that count, in the order of the input, with class 2 if they lie on the ground and 1 if not; classes for noise (7, 18) and water (9) stay.
/// Steps are as fine as the coordinates' own digits, up to five behind the point.
fn classified(file: AtomicFile, cloud: &Cloud, model: &GroundModel, workers: &Workers) -> Result<AtomicFile> {
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
    let mut file = ClassifiedFile::begin(file, Steps::of(&bounds, digits), cloud.crs())?;
    let schema = cloud.schema_of(&WRITTEN);
    let columns =
        WRITTEN.map(|name| schema.column(name).map(|column| (column.offset, reader(column.scalar, Endian::NATIVE))));
    let coarse_angles = schema.attributes().iter().any(|a| a.name == "scan_angle" && a.scalar.bytes() == 1);
    let stride = schema.stride();
    // Handed back to the workers, as in `gather`.
    let spares = Spares::<Vec<ClassifiedPoint>>::default();
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
        let mut points = spares.take().unwrap_or_default();
        points.clear();
        points.extend((0..batch.points.len()).map(of));
        Ok(points)
    };
    cloud.for_each_batch(workers, in_flight, Carried::Only(&WRITTEN), work, |points| {
        file.append(&points)?;
        spares.give(points);
        Ok(())
    })?;
    file.filled()
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
