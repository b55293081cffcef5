//! Sparse clouds: where cells that are wide enough for the points leave the body unsealed, or hardly tell its walls apart, places of its surface between the points are added to them.
//!
//! ```text
//!   survey ─► cells closed as they are ─┬─► sealed, and few walls are double ───────────────────► run
//!                                       └─► the surface by the winding number ─┬─► none ────────► run
//!                                           ([`crate::solid::winding`])        ├─► sealed before, with its pieces and handles ─► run
//!                                                                              └─► survey with its places ─► closed as it tells ─► run with them
//! ```

use crate::error::Result;
use crate::error::words::thousands;
use crate::grid::Grid;
use crate::grid::bucket::{Added, Buckets};
use crate::grid::context::Context;
use crate::grid::partition::BUCKET_SLICES;
use crate::grid::slice::{Bits, Runs};
use crate::grid::survey::Survey;
use crate::input::{Carried, Cloud, InputOptions, PointBuffer, PointSource};
use crate::points::{Batch, Coordinate, Points, Precision};
use crate::resources::workers::Workers;
use crate::run::closed_cells::{ClosedCells, closed_cells};
use crate::run::counted::plan_before_slabs;
use crate::run::phase::Phase;
use crate::run::progress::{Progress, Show};
use crate::run::surveyed::{Surveyed, Upsampled, survey_cloud};
use crate::run::workload::Workload;
use crate::settings::closing::Sealing;
use crate::settings::{Fineness, Resolution, Settings};
use crate::solid::close::How;
use crate::solid::parted::Parted;
use crate::solid::winding::{self, Sampled};
use crate::storage::spool::Workspace;

/// How many times as wide as places carry them cells are tried.
const WIDER: [f64; 3] = [1.0, 1.25, 1.5];

/// So many times as many triangles as k = 4 makes are made unasked at the most.
const MOST_TRIANGLES: f64 = 4.0;

/// A surveyed cloud, with places added where its points alone are too sparse.
///
/// Looking takes what memory it cannot do without in any case; a budget that has no room for it is refused by the plan that is made afterwards.
///
/// # Errors
/// Those of reading the input, of surveying and of closing cells.
pub(super) fn upsampled(
    cloud: &Cloud,
    surveyed: Surveyed,
    settings: &Settings,
    (workers, workspace): (&Workers, &Workspace),
    budget: u64,
    progress: &mut Progress,
) -> Result<Surveyed> {
    if !may_be(cloud, &surveyed, settings) {
        return Ok(surveyed);
    }
    progress.begin(Phase::Upsample, Some(surveyed.survey.points));
    let means = (workers, workspace);
    let found = match cloud.precision() {
        Precision::Single => looked_for::<f32>(cloud, surveyed, settings, means, budget),
        Precision::Double => looked_for::<f64>(cloud, surveyed, settings, means, budget),
    };
    progress.end();
    let found = found?;
    if let Some(added) = found.added() {
        progress.note(&format!(
            "the points are sparse for the shape: {} places of its surface are added between them; `upsample` off adds none",
            thousands(added.points.len() as u64)
        ));
    }
    Ok(found)
}

/// Whether places may be added: nothing is asked of the cells, and nothing that speaks of the points alone.
fn may_be(cloud: &Cloud, surveyed: &Surveyed, settings: &Settings) -> bool {
    let few = surveyed.survey.points <= winding::MOST as u64;
    let as_usual = settings.fineness == Fineness::Default && settings.seal == Sealing::Auto && settings.open.is_none();
    let of_points = settings.bridged || settings.trim.is_some() || settings.min_points > 1;
    settings.upsample && few && as_usual && !of_points && cloud.places().places.is_empty()
}

fn looked_for<T: Coordinate>(
    cloud: &Cloud,
    surveyed: Surveyed,
    settings: &Settings,
    (workers, workspace): (&Workers, &Workspace),
    budget: u64,
) -> Result<Surveyed> {
    let context = |workload: &Workload| -> Result<Context> {
        Ok(Context::new(workers, workspace, plan_before_slabs(workload, workers.threads(), budget)?))
    };
    let sort = |surveyed: &Surveyed, context: &Context| {
        let input = (cloud, surveyed.added(), Carried::Attributes);
        Buckets::<T>::fill(input, &surveyed.grid, context, |_| ())
    };
    let close = |surveyed: &Surveyed, buckets: &Buckets<T>, context: &Context| {
        closed_cells(cloud, surveyed, settings, buckets, context, &mut Progress::new(Show::Nothing))
    };
    let of_points = context(&surveyed.workload)?;
    let buckets = sort(&surveyed, &of_points)?;
    let cells = close(&surveyed, &buckets, &of_points)?;
    let sealed = sealed(&cells);
    if sealed.is_some_and(Parted::is_resolved) {
        return Ok(surveyed);
    }
    // The Euler number that all points together must tell, too, if a sealed body is to stand.
    let of_sealed = sealed.map(|_| cells.closed.solid.characteristic()).transpose()?;
    let count = surveyed.survey.points;
    let surveyed = surveyed.with_workload(|workload| workload.with_upsampling(count));
    let (points, records): (Vec<_>, Vec<_>) =
        points_that_count(&buckets, &cells, &surveyed.grid, &of_points)?.into_iter().unzip();
    let most = MOST_TRIANGLES * faces(&cells) as f64 * in_usual_cells(&surveyed, settings)?;
    drop((buckets, cells, of_points));
    let Some(told) = winding::surface_of(&points, workers)? else { return Ok(surveyed) };
    if of_sealed.is_some_and(|of_sealed| of_sealed == told.characteristic || !told.is_steady) {
        return Ok(surveyed);
    }
    drop(points);
    let all = all_points(cloud, count, workers)?;
    let mut tries = 0;
    for sampled in &told.sampled {
        let added = with_records::<T>(sampled, &records, cloud.schema().stride());
        let mut upsampled = Upsampled { added, is_steady: told.is_steady, reopened: true, max_triangles: None };
        // The cells and the density of the first grid, which the wider ones go by.
        let mut finest = None;
        for wider in WIDER {
            let fineness = match finest {
                None => Fineness::Sampling,
                Some((side, _)) => Fineness::Given(Resolution::Cell(wider * side)),
            };
            let joined = PointsAndPlaces { points: &all, added: &upsampled.added.points, precision: cloud.precision() };
            let joined = Cloud::of_source(&joined, &InputOptions::default())?;
            let with_fineness = Settings { fineness, ..*settings };
            let mut unseen = Progress::new(Show::Nothing);
            let found = survey_cloud(&joined, &with_fineness, workers, budget, &mut unseen)?;
            drop(joined);
            let (_, density) = *finest.get_or_insert((found.grid.cell_size(), found.density));
            let mut made = with_places(cloud, &surveyed, Surveyed { density, ..found }, upsampled);
            let context = context(&made.workload)?;
            let buckets = sort(&made, &context)?;
            // Reopening goes by the walls round a place, the surface by all points: where they disagree, it is left out.
            for reopened in [true, false] {
                made = made.with_upsampled(|upsampled| upsampled.reopened = reopened);
                let cells = close(&made, &buckets, &context)?;
                tries = context.memory.bytes_of_closing(&made.workload, context.account.closing()).max(tries);
                // The cells must have the pieces and handles that the surface has.
                if cells.closed.solid.characteristic()? == told.characteristic {
                    // Contraction leaves more than a triangle to a face, and fewer than two.
                    let too_many = 2.0 * faces(&cells) as f64 > most && settings.simplify.is_none();
                    let most = too_many.then_some(most.max(4.0) as u64);
                    let made = made.with_upsampled(|upsampled| upsampled.max_triangles = most);
                    let simplify = made.settled(settings).simplify;
                    return Ok(made.with_workload(|workload| workload.with_simplification(simplify).with_tries(tries)));
                }
            }
            upsampled = made.upsampled.expect("it was given");
        }
    }
    Ok(surveyed.with_workload(|workload| workload.with_tries(tries)))
}

fn faces(cells: &ClosedCells) -> u64 {
    cells.closed.solid.faces.iter().map(|faces| u64::from(*faces)).sum()
}

/// What the walls part, if the body is sealed.
fn sealed(cells: &ClosedCells) -> Option<&Parted> {
    match &cells.closed.how {
        How::Sign(parted) if parted.is_sealed() && cells.narrow.count == 0 => Some(parted),
        _ => None,
    }
}

/// A point with the record of its attributes.
type Recorded = ([f64; 3], Vec<u8>);

/// The points that lie in occupied cells, in an order that they alone decide, each once.
fn points_that_count<T: Coordinate>(
    buckets: &Buckets<T>,
    cells: &ClosedCells,
    grid: &Grid,
    context: &Context,
) -> Result<Vec<Recorded>> {
    let occupied = &cells.closed.occupancy;
    let [width, slices, rows] = occupied.cells;
    let (mut bits, mut runs) = (vec![Bits::new(width, rows); BUCKET_SLICES as usize], Runs::default());
    let stride = buckets.stride();
    let mut all: Vec<Recorded> = Vec::new();
    for bucket in 0..buckets.count() {
        context.workers.check_cancelled()?;
        let first = bucket as u32 * BUCKET_SLICES;
        for y in first..(first + BUCKET_SLICES).min(slices) {
            occupied.store.paint(i64::from(y), &mut bits[(y - first) as usize], &mut runs)?;
        }
        buckets.read_attributes(bucket, |points, attributes| {
            for (i, point) in points.iter().enumerate() {
                let point = point.map(Into::into);
                let [x, y, z] = grid.cell_of(point);
                if bits[(y - first) as usize].get(x.into(), z.into()) {
                    all.push((point, attributes[i * stride..][..stride].to_vec()));
                }
            }
            Ok(())
        })?;
    }
    // The two zeros are one place.
    all.iter_mut().for_each(|(point, _)| *point = point.map(|c| c + 0.0));
    let by_axes = |p: &[f64; 3], q: &[f64; 3]| {
        p[0].total_cmp(&q[0]).then_with(|| p[1].total_cmp(&q[1])).then_with(|| p[2].total_cmp(&q[2]))
    };
    all.sort_by(|(p, of_p), (q, of_q)| by_axes(p, q).then_with(|| of_p.cmp(of_q)));
    all.dedup_by(|a, b| a.0 == b.0);
    Ok(all)
}

/// All points of a cloud, in the file's order.
fn all_points(cloud: &Cloud, count: u64, workers: &Workers) -> Result<Vec<[f64; 3]>> {
    let mut points = Vec::with_capacity(count as usize);
    let read = |batch: &Batch| Ok(batch.points.clone());
    cloud.for_each_batch(workers, 1, Carried::Coordinates, read, |some| {
        match some {
            Points::Single(some) => points.extend(some.iter().map(|p| p.map(f64::from))),
            Points::Double(some) => points.extend(some),
        }
        Ok(())
    })?;
    Ok(points)
}

/// The places, as the cloud's precision has them.
fn with_records<T: Coordinate>(sampled: &Sampled, records: &[Vec<u8>], stride: usize) -> Added {
    let points = sampled.places.iter().map(|place| place.map(|c| T::from_f64(c).into())).collect();
    let mut attributes = Vec::with_capacity(sampled.places.len() * stride);
    sampled.nearest.iter().for_each(|point| attributes.extend_from_slice(&records[*point]));
    Added { points, attributes }
}

/// The part of the faces on this grid that cells by k = 4 would have.
fn in_usual_cells(surveyed: &Surveyed, settings: &Settings) -> Result<f64> {
    let Surveyed { survey, grid, .. } = surveyed;
    let usual = Grid::new(survey.points, &survey.bounds, Resolution::default(), settings.axis)?.cell_size();
    Ok((grid.cell_size() / usual).powi(2))
}

/// The points of a cloud and the places that are added to them.
struct PointsAndPlaces<'a> {
    points: &'a [[f64; 3]],
    added: &'a [[f64; 3]],
    precision: Precision,
}

impl PointSource for PointsAndPlaces<'_> {
    fn len(&self) -> u64 {
        (self.points.len() + self.added.len()) as u64
    }

    fn precision(&self) -> Precision {
        self.precision
    }

    fn read(&self, range: std::ops::Range<u64>, out: &mut PointBuffer) -> Result<()> {
        let all = self.points.iter().chain(self.added);
        let some = all.skip(range.start as usize).take((range.end - range.start) as usize);
        some.for_each(|point| out.push(*point));
        Ok(())
    }
}

/// The survey of points and places, as that of a cloud whose points alone were surveyed before.
fn with_places(cloud: &Cloud, before: &Surveyed, joined: Surveyed, upsampled: Upsampled) -> Surveyed {
    let Survey { points, bounds, .. } = joined.survey;
    let survey = Survey { points, bounds, ..before.survey };
    let workload = joined.workload.with_attributes(cloud.schema().stride());
    let workload = workload.with_survey(before.workload.surveying()).with_upsampling(before.survey.points);
    Surveyed { survey, workload, upsampled: Some(upsampled), ..joined }
}
