//! A reconstruction as tasks: any number of processes do them, in any order that their needs allow, as often as they like, on one machine or on many that share a
//! folder. The mesh has the bytes of one run.
//!
//! ```text
//!  plan ─► bucket/0 ─┬► close ─► piece/0 ─┬► bridge/2 ─┬► measure/0 ─┬► check/0 ─┬► finish
//!          bucket/1 ─┤           piece/1 ─┤            └► measure/1 ─┤  check/1 ─┤
//!          …        ─┘           …       ─┘               …         ─┘  …       ─┘
//! ```
//!
//! A task is done once its manifest has its name in the folder ([`crate::storage::work`]), which one process gives it: what others make of the same task is as good, and is
//! dropped. Nothing but the folder passes between processes.

mod finish;
mod perform;
mod plan;

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use self::plan::plan_tasks;
use crate::error::{Error, Result};
use crate::input::Segment;
use crate::points::attribute::Schema;
use crate::resources::memory::MemoryPlan;
use crate::run::closed_cells;
use crate::run::job::{Check, Job};
use crate::run::surveyed::Surveyed;
use crate::stitch::apart::{self, Apart};
use crate::storage::work::{Claim, WorkFolder};

/// The phase of the plan, as the folder names it.
const PLAN: &str = "plan";

/// A task.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Task {
    /// Sorts the points of a segment of the input into buckets.
    Bucket(usize),
    /// Closes the cells of all points.
    Close,
    /// Stitches a run of slabs.
    Piece(usize),
    /// Stitches from the end of a piece to where it can be joined to one above it.
    Bridge(usize),
    /// Looks at a share of the mesh's triangles, for the check.
    Measure(usize),
    /// Checks the mesh at a share of its vertices.
    Check(usize),
    /// Tells what the check found, and writes all that is to be written.
    Finish,
}

impl Task {
    /// The phase of the folder that the task is.
    fn phase(self) -> String {
        match self {
            // As a run on one machine has it.
            Task::Close => closed_cells::PHASE.to_owned(),
            task => task.to_string().replace('/', "-"),
        }
    }
}

impl fmt::Display for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Task::Bucket(number) => write!(f, "bucket/{number}"),
            Task::Close => f.write_str("close"),
            Task::Piece(number) => write!(f, "piece/{number}"),
            Task::Bridge(number) => write!(f, "bridge/{number}"),
            Task::Measure(number) => write!(f, "measure/{number}"),
            Task::Check(number) => write!(f, "check/{number}"),
            Task::Finish => f.write_str("finish"),
        }
    }
}

impl FromStr for Task {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Task, String> {
        let wrong =
            || format!("expected bucket/N, close, piece/N, bridge/N, measure/N, check/N or finish, found {text:?}");
        let (kind, number) = text.split_once('/').map_or((text, None), |(kind, number)| (kind, Some(number)));
        let number = number.map(|number| number.parse::<usize>().map_err(|_| wrong())).transpose()?;
        match (kind, number) {
            ("bucket", Some(number)) => Ok(Task::Bucket(number)),
            ("close", None) => Ok(Task::Close),
            ("piece", Some(number)) => Ok(Task::Piece(number)),
            ("bridge", Some(number)) => Ok(Task::Bridge(number)),
            ("measure", Some(number)) => Ok(Task::Measure(number)),
            ("check", Some(number)) => Ok(Task::Check(number)),
            ("finish", None) => Ok(Task::Finish),
            _ => Err(wrong()),
        }
    }
}

impl Serialize for Task {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// How it stands with a task.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// It is done.
    Done,
    /// What it needs is there.
    Ready,
    /// It needs what is not there yet.
    Waiting,
}

/// A task and how it stands with it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TaskState {
    /// The task.
    pub task: Task,
    /// How it stands.
    pub state: State,
}

/// What every task is given.
#[derive(Debug, Serialize, Deserialize)]
struct TaskPlan {
    surveyed: Surveyed,
    schema: Schema,
    /// Of the input, for the tasks that sort points.
    segments: Vec<Segment>,
    /// Slabs in all, and those of each piece.
    slabs: u32,
    pieces: Vec<Range<u32>>,
}

/// A folder of tasks.
#[derive(Debug)]
pub struct Tasks {
    work: Arc<WorkFolder>,
    plan: TaskPlan,
    job: Job,
}

/// A command line, as it was typed behind the program's name, and where.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Command {
    /// Its words.
    pub words: Vec<String>,
    /// The folder from which its paths are taken.
    pub folder: PathBuf,
}

/// The folder at `path` and the command line that its tasks are of.
///
/// # Errors
/// [`Error::Usage`] if there is no such folder; [`Error::Io`].
pub fn command_of(path: &Path) -> Result<(WorkFolder, Command)> {
    let work = WorkFolder::shared(path)?;
    let job = work.job()?.unwrap_or_default();
    match Command::deserialize(&job["tasks"]["command"]) {
        Ok(command) => Ok((work, command)),
        Err(_) => Err(Error::Usage(format!(
            "{}: holds a run, and no tasks; `plan` INPUT `work` DIR makes a folder of tasks",
            path.display()
        ))),
    }
}

impl Tasks {
    /// The tasks of a folder, whose command line stands for `job`.
    ///
    /// # Errors
    /// [`Error::NotReady`] if it is not planned yet; [`Error::Damaged`]; [`Error::Io`].
    pub fn of(work: WorkFolder, job: Job) -> Result<Tasks> {
        let plan = work.load(PLAN, |manifest| {
            TaskPlan::deserialize(&manifest.rest).map_err(|_| work.damaged("done/plan.json", "it cannot be read"))
        })?;
        let Some(plan) = plan else {
            let (task, needed) = ("every task".to_owned(), PLAN.to_owned());
            return Err(Error::NotReady { path: work.path().to_path_buf(), task, needed });
        };
        Ok(Tasks { work: Arc::new(work), plan, job })
    }

    /// All tasks that are known of, in an order in which they can be done.
    ///
    /// # Errors
    /// [`Error::Damaged`], [`Error::Io`].
    pub fn states(&self) -> Result<Vec<TaskState>> {
        let done = self.work.done()?;
        let mut tasks = Vec::new();
        let mut stage = |of: Vec<Task>, before: bool| {
            let mut all = true;
            tasks.extend(of.into_iter().map(|task| {
                let state = match done.contains(&task.phase()) {
                    true => State::Done,
                    false if before => State::Ready,
                    false => State::Waiting,
                };
                all &= state == State::Done;
                TaskState { task, state }
            }));
            before && all
        };
        let sorted = stage((0..self.plan.segments.len()).map(Task::Bucket).collect(), true);
        let closed = stage(vec![Task::Close], sorted);
        let stitched = stage((0..self.plan.pieces.len()).map(Task::Piece).collect(), closed);
        let bridges = if stitched { apart::bridges(&self.pieces(Task::Finish)?) } else { Vec::new() };
        let joined = stage(bridges.into_iter().map(Task::Bridge).collect(), stitched);
        let measured = stage(self.shares().map(Task::Measure).collect(), joined);
        let checked = stage(self.shares().map(Task::Check).collect(), measured);
        stage(vec![Task::Finish], checked);
        Ok(tasks)
    }

    /// The shares that the check is made in: none where the mesh is not checked, or another one is made of it first.
    fn shares(&self) -> Range<usize> {
        let settings = &self.job.settings;
        let is_changed = settings.simplify.is_some() || settings.bridged || settings.trim.is_some();
        match self.job.check {
            Check::Always if !is_changed => 0..self.plan.pieces.len(),
            _ => 0..0,
        }
    }

    /// What is known of all pieces, which a task needs.
    fn pieces(&self, task: Task) -> Result<Vec<Apart>> {
        (0..self.plan.pieces.len()).map(|number| Ok(self.saved_apart(task, Task::Piece(number))?.0.apart)).collect()
    }

    /// The bridges from pieces that need one.
    fn bridges(&self, task: Task, pieces: &[Apart]) -> Result<BTreeMap<usize, Apart>> {
        let bridge = |from: usize| Ok((from, self.saved_apart(task, Task::Bridge(from))?.0.apart));
        apart::bridges(pieces).into_iter().map(bridge).collect()
    }

    /// A task's claim, as [`WorkFolder::claim`] gives it: None if another process has it.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn claimed(&self, task: Task) -> Result<Option<Claim>> {
        self.work.claim(&task.phase())
    }

    /// Bytes of memory that a process needs at the least, with so many threads.
    pub fn least_memory(&self, threads: usize) -> u64 {
        MemoryPlan::least(&self.plan.surveyed.workload, threads)
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.work.path()
    }

    /// Removes the files that no task which is done has left; all of them once the mesh is finished. No process may be at work in the folder.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn clean(&self) -> Result<()> {
        self.work.clean(!self.work.is_done(&Task::Finish.phase()))
    }
}
