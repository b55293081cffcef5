//! From sorted points to closed cells: which cells are occupied, which are solid, and what is opened again.

use std::cell::Cell;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::grid::bucket::Buckets;
use crate::grid::context::Context;
use crate::grid::occupancy::{Counted, Occupancy, Sampled, SavedOccupancy};
use crate::input::Cloud;
use crate::points::Coordinate;
use crate::run::phase::Phase;
use crate::run::progress::Progress;
use crate::run::surveyed::Surveyed;
use crate::run::workload::Workload;
use crate::settings::Settings;
use crate::settings::surface::Fit;
use crate::solid::close::{self, Closed, ClosingOptions, How};
use crate::solid::component::Components;
use crate::solid::heightfield::HeightField;
use crate::solid::level;
use crate::solid::membranes::{Common, Membranes};
use crate::solid::reopen::{Reopening, STEPS, STEPS_BEFORE, Sampling};
use crate::solid::sign::Sights;
use crate::solid::unresolved::NarrowHandles;
use crate::solid::{SavedSolid, Solid};
use crate::stitch::size::MeansBytes;
use crate::storage::work::WorkFolder;
use crate::storage::work::sections::{Section, SectionReader, SectionWriter};
use crate::surface::thickness::{self, Shell};
use crate::surface::vertices;

/// The closed cells of a cloud, and what is to be told of the cells that points lie in.
#[derive(Debug)]
pub struct ClosedCells {
    /// The solid, and how it came to be.
    pub closed: Closed,
    /// Which points count.
    pub counted: Counted,
    /// The shell of points, where it was measured.
    pub shell: Option<Shell>,
    /// Handles that are too narrow to be believed, if the mesh could be called sealed without them.
    pub narrow: NarrowHandles,
    /// Occupied cells.
    pub occupied: u64,
    /// Cells with points, but too few to be occupied.
    pub sparse: u64,
    /// What counts for each slice's memory ([`vertices::weights`]), if that was looked at already.
    pub weights: Option<Vec<u32>>,
    /// Whether this process closed them, so that its account tells what that took.
    pub closed_here: bool,
}

/// What is kept of saved cells beside their slices.
#[derive(Debug, Serialize, Deserialize)]
struct Saved {
    sections: Vec<Section>,
    occupancy: SavedOccupancy,
    solid: SavedSolid,
    how: How,
    falls: bool,
    components: Option<Components>,
    membranes: Option<Common>,
    counted: Counted,
    shell: Option<Shell>,
    narrow: NarrowHandles,
    occupied: u64,
    sparse: u64,
}

/// The phase, as the work folder names it.
pub(super) const PHASE: &str = "cells";

impl ClosedCells {
    /// A workload when the cells and the points of each bucket are known, with vertices that are moved onto `fit`.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Interrupted`].
    pub(super) fn counted_workload<T: Coordinate>(
        &self,
        workload: &Workload,
        fit: Fit,
        buckets: &Buckets<T>,
        context: &Context,
    ) -> Result<Workload> {
        let Closed { solid, occupancy, falls, .. } = &self.closed;
        let points: Vec<u64> = (0..buckets.count()).map(|bucket| buckets.points_in(bucket)).collect();
        let means = MeansBytes::of(&occupancy.in_slice, solid.cells, workload.smooth);
        let counted;
        let faces = match &self.weights {
            Some(weights) => weights,
            None => {
                counted = vertices::weights(solid, context)?;
                &counted
            }
        };
        let workload = workload.with_faces_of_slices(faces, *falls).with_fit(fit).with_buckets(&points);
        Ok(workload.with_means(means).with_field_found(context.account.closing().field))
    }

    /// Moves what lies in memory of the cells to disk.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(super) fn leave_memory(&mut self) -> Result<()> {
        let Closed { solid, occupancy, membranes, .. } = &mut self.closed;
        occupancy.store.leave_memory()?;
        solid.store.leave_memory()?;
        membranes.as_mut().map_or(Ok(()), Membranes::leave_memory)?;
        solid.ground.as_mut().map_or(Ok(()), HeightField::leave_memory)
    }

    /// Saves them and commits them as a phase.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(super) fn commit(&self, work: &WorkFolder, phase: &str) -> Result<()> {
        let mut out = SectionWriter::new(work, phase)?;
        let Closed { solid, occupancy, how, falls, components, membranes, .. } = &self.closed;
        let (occupancy, solid) = (occupancy.save(&mut out)?, solid.save(&mut out)?);
        let membranes = membranes.as_ref().map(|membranes| membranes.save(&mut out)).transpose()?;
        out.values(self.weights.as_deref().unwrap_or_default())?;
        let (file, sections) = out.finish();
        let &ClosedCells { counted, shell, narrow, occupied, sparse, .. } = self;
        let (how, falls, components) = (how.clone(), *falls, *components);
        let saved = Saved {
            sections,
            occupancy,
            solid,
            how,
            falls,
            components,
            membranes,
            counted,
            shell,
            narrow,
            occupied,
            sparse,
        };
        work.commit(phase, vec![file], serde_json::to_value(saved).expect("a manifest can be written"))
    }

    /// What was committed as a phase, if it was.
    ///
    /// # Errors
    /// [`Error::Damaged`], [`Error::Io`].
    pub(super) fn committed(work: &WorkFolder, phase: &str, context: &Context) -> Result<Option<ClosedCells>> {
        work.load(phase, |manifest| {
            let saved =
                Saved::deserialize(&manifest.rest).map_err(|_| work.damaged(phase, "the manifest cannot be read"))?;
            let [file] = manifest.files.as_slice() else { return Err(work.damaged(phase, "a file is missing")) };
            let mut sections = SectionReader::new(work, file, saved.sections)?;
            let occupancy = Occupancy::load(&saved.occupancy, &mut sections, context)?;
            let solid = Solid::load(&saved.solid, &mut sections, context)?;
            let membranes =
                saved.membranes.map(|common| Membranes::load(common, &mut sections, context)).transpose()?;
            let Saved { how, falls, components, counted, shell, narrow, occupied, sparse, .. } = saved;
            let closed = Closed { solid, occupancy, how, falls, components, membranes, thickened: None };
            let weights: Vec<u32> = sections.values()?;
            let weights = (!weights.is_empty()).then_some(weights);
            if weights.as_ref().is_some_and(|weights| weights.len() != closed.solid.cells[1] as usize) {
                return Err(work.damaged(file, "it has not a weight for each slice"));
            }
            Ok(ClosedCells { closed, counted, shell, narrow, occupied, sparse, weights, closed_here: false })
        })
    }
}

impl ClosedCells {
    /// With what counts for each slice's memory, for those who are going to need it more than once.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Interrupted`].
    pub(super) fn weighed(self, context: &Context) -> Result<ClosedCells> {
        let weights = Some(vertices::weights(&self.closed.solid, context)?);
        Ok(ClosedCells { weights, ..self })
    }
}

/// Closes the cells of the sorted points.
pub(super) fn closed_cells<T: Coordinate>(
    cloud: &Cloud,
    surveyed: &Surveyed,
    settings: &Settings,
    buckets: &Buckets<T>,
    context: &Context,
    progress: &mut Progress,
) -> Result<ClosedCells> {
    let Surveyed { survey, grid, .. } = surveyed;
    context.memory.between_phases(&context.workers);
    progress.begin(Phase::Raster, Some(survey.points));
    let least = settings.min_points;
    let occupancy = Occupancy::of_buckets(buckets, grid, least, context, |points| progress.add(points))?;
    if occupancy.occupied == 0 {
        let cells = occupancy.sparse;
        return Err(Error::setting(
            "min_points",
            format!("`min_points` {least}: none of the {cells} cells holds so many points"),
        ));
    }
    context.memory.between_phases(&context.workers);
    progress.begin(Phase::Seal, None);
    let (occupied, sparse) = (occupancy.occupied, occupancy.sparse);
    let asked = ClosingOptions {
        seal: settings.seal,
        window: settings.window,
        keep_outliers: settings.keep_outliers,
        min_component: settings.min_component,
        rough: false,
    };
    let done = |done: u64, total: u64| {
        progress.set_total(total);
        progress.set(done);
    };
    let mut closed = match &settings.open {
        None => {
            let sights = Sights::of(cloud, grid);
            close::close_seen(occupancy, grid.cell_size(), asked, sights.as_ref(), context, done)?
        }
        Some(open) => {
            let smooth = settings.surface.smooth;
            close::close_below(occupancy, (buckets, grid), open, asked, smooth, context, done)?
        }
    };
    let counted = if sparse > 0 || closed.components.is_some() || closed.has_outliers() {
        Counted::Occupied
    } else {
        Counted::All
    };
    let sampled = Sampled { buckets, occupied: &closed.occupancy.store, grid, counted };
    let signed = matches!(closed.how, How::Sign(_));
    let shell = match signed || settings.surface.fit == Fit::Auto {
        true => {
            let in_slice = &closed.occupancy.in_slice;
            context.account.measuring(thickness::bytes_of_all(closed.solid.cells, in_slice, context));
            thickness::measure(&sampled, &closed.solid, context)?
        }
        false => None,
    };
    // Noise makes walls thick and double, too.
    if let How::Sign(parted) = &mut closed.how
        && shell.is_some_and(|shell| shell.is_noisy())
    {
        parted.too_wide = None;
    }
    let without_specks = |solid: Solid| match settings.min_component.filter(|_| signed) {
        Some(least) => solid.without_specks_of_outside(least, context),
        None => Ok(solid),
    };
    let is_thick = shell.is_some_and(|shell| shell.hides_walls());
    let (closed, narrow) = match signed && surveyed.may_reopen() && !is_thick {
        true => reopened(closed, surveyed, buckets, without_specks, context, progress)?,
        false => {
            let solid = without_specks(closed.solid)?;
            let solid = if signed && is_thick { solid.without_prongs(context)? } else { solid };
            (Closed { solid, thickened: None, ..closed }, None)
        }
    };
    // What says that it is not sealed says more than handles would.
    let narrow = match &closed.how {
        How::Sign(parted) if parted.is_sealed() => match narrow {
            Some(narrow) => narrow,
            None => closed.solid.narrow_handles(&closed.occupancy, context)?,
        },
        _ => NarrowHandles::default(),
    };
    Ok(ClosedCells { closed, counted, shell, narrow, occupied, sparse, weights: None, closed_here: true })
}

/// Cavities of fewer cells are none in the surface: most of their kind reach the outside over an edge.
const CAVITY: u64 = 8;

/// Pieces and handles of the surface round a solid. Its Euler number is pieces less handles.
fn flaws(solid: &Solid, context: &Context) -> Result<i64> {
    Ok(2 * solid.pieces(CAVITY, context)? as i64 - solid.characteristic_of_surface()?)
}

/// What was closed, with what that filled opened again where the points say so, and the narrow handles that were left. Slots that hold nets are then filled whole and opened anew, if the
/// surface loses pieces and handles so, but not many more than were narrow. Then clefts open.
fn reopened<T: Coordinate>(
    closed: Closed,
    surveyed: &Surveyed,
    buckets: &Buckets<T>,
    without_specks: impl Fn(Solid) -> Result<Solid>,
    context: &Context,
    progress: &mut Progress,
) -> Result<(Closed, Option<NarrowHandles>)> {
    context.memory.between_phases(&context.workers);
    progress.begin(Phase::Reopen, None);
    let Closed { solid, occupancy, thickened, .. } = closed;
    let coarser = occupancy.coarser(context)?.occupied;
    let side = level::side_in_samples(occupancy.occupied as f64 / coarser.max(1) as f64);
    let sampled = Sampled { buckets, occupied: &occupancy.store, grid: &surveyed.grid, counted: Counted::All };
    let sampling = Sampling { side, thickened: thickened.as_ref() };
    let (slices, all) = (u64::from(solid.cells[1]), Cell::new(STEPS_BEFORE + STEPS));
    progress.set_total(all.get() * slices);
    let mut done = 0;
    let mut step = || {
        done += 1;
        progress.set_total(all.get() * slices);
        progress.set(done.min(all.get()) * slices);
    };
    let cleaned = |solid: Solid| without_specks(solid.without_isolated_cells(context)?);
    let mut open = |solid: Solid| {
        let mut reopening = Reopening::of(&solid, &sampled, sampling, context, &mut step)?;
        let solid = match &mut reopening {
            Some(reopening) => reopening.opened(solid, &mut step)?,
            None => solid,
        };
        Ok((cleaned(solid)?, reopening))
    };
    let (mut solid, mut reopening) = open(solid)?;
    let mut narrow = solid.narrow_handles(&occupancy, context)?;
    // Where places were added, the winding number that they came of tells the handles.
    let filled = match narrow.count > 0 && surveyed.added().is_none() {
        true => solid.with_nets_filled(&occupancy, context)?,
        false => None,
    };
    if let Some(filled) = filled {
        drop(reopening);
        // Where all fits in memory, nothing goes to disk.
        if context.memory.predicted_disk > 0 {
            solid.store.leave_memory()?;
        }
        all.set(all.get() + STEPS_BEFORE + STEPS);
        let (anew, with_anew) = open(filled)?;
        reopening = with_anew;
        // If far more handles go than were narrow, some of them were the object's.
        let lost = flaws(&solid, context)? - flaws(&anew, context)?;
        narrow.reopened = (1..2 * narrow.count as i64).contains(&lost);
        if narrow.reopened {
            solid = anew;
        }
    }
    if let Some(reopening) = &mut reopening.filter(|_| surveyed.added().is_none()) {
        all.set(all.get() + STEPS);
        let (left, any) = reopening.without_clefts(solid, &mut step)?;
        solid = left;
        if any {
            solid = cleaned(solid)?;
            let now = solid.narrow_handles(&occupancy, context)?;
            if now.count > narrow.count {
                narrow = NarrowHandles { reopened: narrow.reopened, ..now };
            }
        }
    }
    Ok((Closed { solid, occupancy, thickened: None, ..closed }, Some(narrow)))
}
