//! The plan of tasks: the input is surveyed, and cut into segments; the slabs are cut into pieces.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::Value;

use super::{Command, PLAN, PlannedSegment, TaskPlan, Tasks, renew};
use crate::error::{Error, Result};
use crate::grid::partition::{Slabs, slab_count};
use crate::input::{Carried, STANDARD_INPUT, Segment};
use crate::resources::workers::Workers;
use crate::run::bare_earth::keep_ground;
use crate::run::files_to_mesh::refuse_output;
use crate::run::identity;
use crate::run::job::Job;
use crate::run::prepare::{Passes, describe, files, known, open, planned, surveyed};
use crate::run::progress::Progress;
use crate::storage::remote::is_remote;
use crate::storage::work::WorkFolder;

/// Pieces for each process: those that take longer are made up for by others.
const PIECES: usize = 2;

/// Slabs of a piece at the least: two more are made for it.
const LEAST: u32 = 6;

/// Surveys the input and writes down, in the job's work folder, the tasks that make its mesh: for so many `processes` side by side. `command` is the command line that
/// the job was read from, and from which others read it again. A folder that is planned already stays as it is, unless files of the input have changed since: then no process may be
/// at work there, and what these touch is to be done again.
///
/// # Errors
/// Those of a run, up to where its points are sorted; [`Error::InvalidSetting`] for what tasks cannot do.
pub fn plan_tasks(
    job: &Job,
    command: &Command,
    processes: usize,
    workers: &Workers,
    progress: &mut Progress,
) -> Result<Tasks> {
    let folder = job.resources.work.clone().ok_or_else(|| Error::Internal("tasks without a folder".into()))?;
    refuse_what_tasks_cannot(job)?;
    let files = files(job, progress)?;
    if files.iter().any(|file| file == Path::new(STANDARD_INPUT)) {
        let message = "`work`: standard input cannot be read by other processes; write it to a file first";
        return Err(Error::setting("work", message.into()));
    }
    let local = job.resources.temp_dir.as_deref();
    let there = WorkFolder::shared_with(&folder, local).ok().filter(|work| matches!(work.has_tasks(), Ok(true)));
    let work = Arc::new(match there {
        Some(work) => work,
        None => WorkFolder::to_plan(&folder, local)?,
    });
    let planned = plan_in(&work, job, &files, (command, processes), workers, progress);
    let settled = if planned.is_err() { work.leave(false, PLAN).map(drop) } else { work.settle(false) };
    planned.and(settled)?;
    // Whoever waits for the lock waits no longer.
    drop(work);
    Tasks::of(WorkFolder::shared_with(&folder, local)?, job.clone(), Path::new(""))
}

/// Writes the tasks down in a folder.
fn plan_in(
    work: &Arc<WorkFolder>,
    job: &Job,
    files: &[PathBuf],
    (command, processes): (&Command, usize),
    workers: &Workers,
    progress: &mut Progress,
) -> Result<()> {
    let workspace = job.resources.workspace(work.path())?.stopped_with(workers);
    let states: Vec<Value> = files.iter().map(|file| identity::of_file(file)).collect::<Result<_>>()?;
    let before = TaskPlan::newest(work)?;
    progress.expect_run(known(job, files, Passes::Few));
    let mut cloud = open(job, files, &workspace, workers, Passes::Few, progress)?;
    refuse_output(job, files, &cloud, Some(work))?;
    let measured = job.measured_as(&cloud)?;
    describe(&cloud, &measured.settings, progress);
    keep_ground(&mut cloud, &measured.settings)?;
    let tasks = serde_json::json!({ "command": command, "processes": processes });
    let begin = || identity::begin_tasks(work, &measured.settings, &job.input, &tasks);
    if let Some(before) = &before {
        begin()?;
        if before.files == files && before.states == states {
            return Ok(());
        }
    }
    let budget = job.resources.budget();
    let (mut surveyed, settings) = surveyed(&cloud, &measured.settings, (workers, &workspace), budget, progress)?;
    if job.output.as_deref().is_some_and(is_remote) {
        surveyed.workload = surveyed.workload.with_transfers();
    }
    let blocks = cloud.block_counts(Carried::Attributes)?;
    let basis = identity::of_basis(&cloud, &surveyed);
    let within = Some(Arc::clone(work));
    let (surveyed, _) = planned(&cloud, surveyed, &settings, (workers, &workspace), budget, within, progress)?;
    // Only what can be done is written down.
    begin()?;
    let (generation, segments) = match &before {
        None => (0, PlannedSegment::all(&Segment::cut(&blocks, processes), 0)),
        Some(before) => {
            let generation = before.generation + 1;
            match before.basis == basis {
                true => {
                    let old = (before.files.as_slice(), before.states.as_slice());
                    (generation, renew::segments(&before.segments, old, (files, &states, &blocks), generation))
                }
                false => (generation, PlannedSegment::all(&Segment::cut(&blocks, processes), generation)),
            }
        }
    };
    let slabs = slab_count(Slabs::of(&settings.surface), surveyed.grid.cells()[1]);
    let plan = TaskPlan {
        generation,
        surveyed,
        schema: cloud.schema().clone(),
        files: files.to_vec(),
        states,
        headers: cloud.headers(),
        basis,
        segments,
        slabs,
        pieces: pieces(slabs, PIECES * processes),
    };
    let manifest = serde_json::to_value(&plan).expect("a manifest can be written");
    work.commit(&TaskPlan::phase(generation), Vec::new(), manifest)?;
    let Some(before) = before else { return Ok(()) };
    progress.note(&renew::told(&before, &plan));
    work.retire(&renew::stale(&plan, &work.done()?))
}

impl PlannedSegment {
    pub(super) fn all(segments: &[Segment], generation: u32) -> Vec<PlannedSegment> {
        segments.iter().map(|segment| PlannedSegment { segment: segment.clone(), generation }).collect()
    }
}

/// What tells where points are on the ground looks at all of them first, which no task does.
fn refuse_what_tasks_cannot(job: &Job) -> Result<()> {
    let beside =
        [("dtm", job.dtm.is_some()), ("dsm", job.dsm.is_some()), ("write_classes", job.write_classes.is_some())];
    let asked = beside.into_iter().find(|(_, asked)| *asked).map(|(setting, _)| setting);
    let asked = asked.or(job.batch.then_some("batch"));
    match asked {
        None => Ok(()),
        Some(setting) => Err(Error::setting(
            setting,
            format!(
                "`{setting}`: looks at all points before they are sorted, which tasks do not; reconstruct in one run, with `work` if it is to go on after a kill"
            ),
        )),
    }
}

/// Slabs in so many runs, or fewer, of about the same length.
fn pieces(slabs: u32, count: usize) -> Vec<Range<u32>> {
    let count = (slabs / LEAST).clamp(1, count.max(1) as u32);
    let end = |number: u32| (u64::from(slabs) * u64::from(number) / u64::from(count)) as u32;
    (0..count).map(|number| end(number)..end(number + 1)).collect()
}

/// A path taken from a folder; an address stays as it is.
pub fn based_at(folder: &Path, path: &Path) -> PathBuf {
    if is_remote(path) { path.to_path_buf() } else { folder.join(path) }
}

/// Paths as they are from everywhere.
impl Job {
    /// The job with all its paths taken from a folder, unless they say where they are from the root.
    #[must_use]
    pub fn based_at(mut self, folder: &Path) -> Job {
        let based = |path: &mut PathBuf| *path = based_at(folder, path);
        self.inputs.iter_mut().for_each(based);
        let optional = [&mut self.output, &mut self.write_classes, &mut self.dtm, &mut self.dsm];
        optional.into_iter().flatten().for_each(based);
        #[cfg(feature = "render")]
        {
            self.html.iter_mut().for_each(based);
            if let crate::run::preview::Preview::At(path) = &mut self.preview {
                based(path);
            }
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_all_slabs_in_order() {
        for slabs in 1..200 {
            for count in 0..30 {
                let pieces = pieces(slabs, count);
                assert!(pieces[0].start == 0 && pieces.last().unwrap().end == slabs);
                assert!(pieces.windows(2).all(|pair| pair[0].end == pair[1].start));
                assert!(pieces.len() == 1 || pieces.iter().all(|piece| piece.len() as u32 >= LEAST));
                assert!(pieces.len() <= count.max(1));
            }
        }
    }
}
