//! The plan of tasks: the input is surveyed, and cut into segments; the slabs are cut into pieces.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{Command, PLAN, TaskPlan, Tasks};
use crate::error::{Error, Result};
use crate::grid::partition::{Slabs, slab_count};
use crate::input::{Carried, STANDARD_INPUT};
use crate::resources::workers::Workers;
use crate::run::bare_earth::keep_ground;
use crate::run::files_to_mesh::refuse_output;
use crate::run::identity;
use crate::run::job::Job;
use crate::run::prepare::{Passes, describe, files, known, open, planned, surveyed};
use crate::run::progress::Progress;
use crate::run::surveyed::Surveyed;
use crate::storage::work::WorkFolder;

/// Pieces for each process: those that take longer are made up for by others.
const PIECES: usize = 2;

/// Slabs of a piece at the least: two more are made for it.
const LEAST: u32 = 6;

/// Surveys the input and writes down, in the job's work folder, the tasks that make its mesh: for so many `processes` side by side. `command` is the command line that
/// the job was read from, and from which others read it again. A folder that is planned already stays as it is.
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
    let there = WorkFolder::shared(&folder).ok().filter(|work| matches!(work.has_tasks(), Ok(true)));
    let work = Arc::new(match there {
        Some(work) => work,
        None => WorkFolder::open(&folder)?,
    });
    let planned = plan_in(&work, job, &files, (command, processes), workers, progress);
    // Where it is not even known what is made, nothing stays.
    let nothing = planned.is_err() && !work.has_begun();
    let settled = if nothing { work.finish(PLAN) } else { work.settle(false) };
    planned.and(settled)?;
    // Whoever waits for the lock waits no longer.
    drop(work);
    Tasks::of(WorkFolder::shared(&folder)?, job.clone())
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
    progress.expect_run(known(job, files, Passes::Few));
    let mut cloud = open(job, files, &workspace, workers, Passes::Few, progress)?;
    refuse_output(job, files, &cloud)?;
    let measured = job.measured_as(&cloud)?;
    describe(&cloud, &measured.settings, progress);
    keep_ground(&mut cloud, &measured.settings)?;
    let budget = job.resources.budget();
    let (surveyed, settings) = surveyed(&cloud, &measured.settings, workers, budget, progress)?;
    let tasks = serde_json::json!({ "command": command, "processes": processes });
    let begin = |surveyed: &Surveyed| identity::begin(work, files, &cloud, &job.input, (&settings, surveyed), tasks);
    if work.is_done(PLAN) {
        return begin(&surveyed);
    }
    let segments = cloud.segments(Carried::Attributes, processes)?;
    let work_folder = Some(Arc::clone(work));
    let (surveyed, _) = planned(&cloud, surveyed, &settings, (workers, &workspace), budget, work_folder, progress)?;
    // Only what can be done is written down.
    begin(&surveyed)?;
    let slabs = slab_count(Slabs::of(&settings.surface), surveyed.grid.cells()[1]);
    let pieces = pieces(slabs, PIECES * processes);
    let plan = TaskPlan { surveyed, schema: cloud.schema().clone(), segments, slabs, pieces };
    work.commit(PLAN, Vec::new(), serde_json::to_value(plan).expect("a manifest can be written"))
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

/// Paths as they are from everywhere.
impl Job {
    /// The job with all its paths taken from a folder, unless they say where they are from the root.
    #[must_use]
    pub fn based_at(mut self, folder: &Path) -> Job {
        let based = |path: &mut PathBuf| *path = folder.join(&*path);
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
