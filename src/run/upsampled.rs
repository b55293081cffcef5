//! Sparse clouds: where cells that are wide enough for the points leave the body unsealed, places of its surface between the points are added to them.
//!
//! ```text
//!   survey ─► cells closed as they are ─┬─► sealed ───────────────────────────────────────────► run
//!                                       └─► the surface by the winding number ─┬─► none ──────► run
//!                                           ([`crate::solid::winding`])        └─► survey with its places ─► closed as it tells ─► run with them
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
use crate::run::counted::context_of;
use crate::run::phase::Phase;
use crate::run::progress::{Progress, Show};
use crate::run::surveyed::{Surveyed, Upsampled, survey_cloud};
use crate::settings::closing::Sealing;
use crate::settings::{Fineness, Resolution, Settings};
use crate::solid::close::How;
use crate::solid::winding::{self, Sampled};
use crate::storage::spool::Workspace;

/// How many times as wide as places carry them cells are tried.
const WIDER: [f64; 3] = [1.0, 1.25, 1.5];

/// So many times as many triangles as k = 4 makes are made unasked at the most.
const MOST_TRIANGLES: f64 = 4.0;

/// A surveyed cloud, with places added where its points alone are too sparse.
///
/// # Errors
/// Those of reading the input, of surveying and of closing cells; [`crate::Error::Budget`] if the budget is too small to look.
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
            "the points are sparse for what they are of: {} places between them, on the surface that they tell of together, are added; `upsample` off leaves them out",
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
    let close = |surveyed: &Surveyed, settings: &Settings| -> Result<(Buckets<T>, ClosedCells)> {
        let context = context_of(surveyed, (workers, workspace), budget)?;
        let input = (cloud, surveyed.added(), Carried::Attributes);
        let buckets = Buckets::fill(input, &surveyed.grid, &context, |_| ())?;
        let cells = closed_cells(cloud, surveyed, settings, &buckets, &context, &mut Progress::new(Show::Nothing))?;
        Ok((buckets, cells))
    };
    let (buckets, cells) = close(&surveyed, settings)?;
    if is_sealed(&cells) {
        return Ok(surveyed);
    }
    let workload = surveyed.workload.clone().with_upsampling(surveyed.survey.points);
    let surveyed = Surveyed { workload, ..surveyed };
    // What is too small a budget is told now.
    let context = context_of(&surveyed, (workers, workspace), budget)?;
    let counted = counted(&buckets, &cells, &surveyed.grid, &context)?;
    let (points, records): (Vec<_>, Vec<_>) = counted.into_iter().unzip();
    drop(buckets);
    let Some(told) = winding::surface_of(&points, workers)? else { return Ok(surveyed) };
    let most = MOST_TRIANGLES * faces(&cells) as f64 * in_usual_cells(&surveyed, settings)?;
    drop(cells);
    // On another grid, walls that nearly meet may come to lie in other cells.
    let tries = told.sampled.iter().flat_map(|sampled| WIDER.map(|wider| (sampled, wider)));
    for (sampled, wider) in tries {
        let added = with_records::<T>(sampled, &records, cloud.schema().stride());
        let upsampled = Upsampled { added, is_steady: told.is_steady, reopened: true, max_triangles: None };
        let mut made = surveyed_with(cloud, &surveyed, settings, (upsampled, wider), workers, budget)?;
        // Reopening goes by the walls round a place, the surface by all points: where they disagree, it is left out.
        for reopened in [true, false] {
            made.upsampled.iter_mut().for_each(|upsampled| upsampled.reopened = reopened);
            let (_, cells) = close(&made, settings)?;
            // The cells must have the pieces and handles that the surface has.
            if cells.closed.solid.characteristic()? == told.characteristic {
                // Contraction leaves more than a triangle to a face, and fewer than two.
                let too_many = 2.0 * faces(&cells) as f64 > most && settings.simplify.is_none();
                let most = too_many.then_some(most.max(4.0) as u64);
                made.upsampled.iter_mut().for_each(|upsampled| upsampled.max_triangles = most);
                let simplify = made.settled(settings).simplify;
                made.workload = made.workload.with_simplification(simplify);
                return Ok(made);
            }
        }
    }
    Ok(surveyed)
}

fn faces(cells: &ClosedCells) -> u64 {
    cells.closed.solid.faces.iter().map(|faces| u64::from(*faces)).sum()
}

fn is_sealed(cells: &ClosedCells) -> bool {
    matches!(&cells.closed.how, How::Sign(parted) if parted.is_sealed()) && cells.narrow.count == 0
}

/// Points, each with the record of its attributes.
type Counted = Vec<([f64; 3], Vec<u8>)>;

/// The points that lie in occupied cells, in an order that they alone decide, each once, with the records of their attributes.
fn counted<T: Coordinate>(
    buckets: &Buckets<T>,
    cells: &ClosedCells,
    grid: &Grid,
    context: &Context,
) -> Result<Counted> {
    let occupied = &cells.closed.occupancy;
    let [width, slices, rows] = occupied.cells;
    let (mut bits, mut runs) = (vec![Bits::new(width, rows); BUCKET_SLICES as usize], Runs::default());
    let stride = buckets.stride();
    let mut all: Counted = Vec::new();
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
    let key = |point: &[f64; 3]| point.map(order_key);
    all.sort_by(|a, b| key(&a.0).cmp(&key(&b.0)).then_with(|| a.1.cmp(&b.1)));
    all.dedup_by(|a, b| a.0 == b.0);
    Ok(all)
}

/// A number that is in the order of finite coordinates, with the two zeros as one.
fn order_key(c: f64) -> u64 {
    let bits = (c + 0.0).to_bits();
    if bits >> 63 == 1 { !bits } else { bits | 1 << 63 }
}

/// The places, as the cloud's precision has them.
fn with_records<T: Coordinate>(sampled: &Sampled, records: &[Vec<u8>], stride: usize) -> Added {
    let points = sampled.places.iter().map(|place| place.map(|c| T::from_f64(c).into())).collect();
    let mut attributes = Vec::with_capacity(sampled.places.len() * stride);
    sampled.nearest.iter().for_each(|point| attributes.extend_from_slice(&records[*point]));
    Added { points, attributes }
}

/// How much of a grid's faces cells by k = 4 would have.
fn in_usual_cells(surveyed: &Surveyed, settings: &Settings) -> Result<f64> {
    let Surveyed { survey, grid, .. } = surveyed;
    let usual = Grid::new(survey.points, &survey.bounds, Resolution::default(), settings.axis)?.cell_size();
    Ok((grid.cell_size() / usual).powi(2))
}

/// The points of a cloud and the places that are added to them.
struct Both<'a> {
    points: &'a [[f64; 3]],
    added: &'a [[f64; 3]],
    precision: Precision,
}

impl PointSource for Both<'_> {
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

/// The survey of a cloud with places added.
fn surveyed_with(
    cloud: &Cloud,
    before: &Surveyed,
    settings: &Settings,
    (upsampled, wider): (Upsampled, f64),
    workers: &Workers,
    budget: u64,
) -> Result<Surveyed> {
    let mut points = Vec::with_capacity(before.survey.points as usize);
    let read = |batch: &Batch| Ok(batch.points.clone());
    cloud.for_each_batch(workers, 1, Carried::Coordinates, read, |some| {
        match some {
            Points::Single(some) => points.extend(some.iter().map(|p| p.map(f64::from))),
            Points::Double(some) => points.extend(some),
        }
        Ok(())
    })?;
    let both = Both { points: &points, added: &upsampled.added.points, precision: cloud.precision() };
    let joined = Cloud::of_source(&both, &InputOptions::default())?;
    // As fine as the places carry.
    let settings = Settings { fineness: Fineness::Sampling, ..*settings };
    let survey_with =
        |settings: &Settings| survey_cloud(&joined, settings, workers, budget, &mut Progress::new(Show::Nothing));
    let mut surveyed = survey_with(&settings)?;
    if wider > 1.0 {
        let side = wider * surveyed.grid.cell_size();
        let wide = survey_with(&Settings { fineness: Fineness::Given(Resolution::Cell(side)), ..settings })?;
        surveyed = Surveyed { density: surveyed.density, ..wide };
    }
    drop(joined);
    let Survey { points, bounds, .. } = surveyed.survey;
    let survey = Survey { points, bounds, ..before.survey };
    let workload = surveyed.workload.with_attributes(cloud.schema().stride());
    let workload = workload.with_survey(before.workload.surveying()).with_upsampling(before.survey.points);
    Ok(Surveyed { survey, workload, upsampled: Some(upsampled), ..surveyed })
}
