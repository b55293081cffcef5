//! A reconstruction as tasks: any number of processes do them, in any order that their needs allow, as often as they like, on one machine or on many that share a
//! folder. The mesh has the bytes of one run.
//!
//! ```text
//!  plan ─► bucket/0 ─┬► close ─► piece/0 ─┬► bridge/2 ─┬► measure/0 ─┬► check/0 ─┬► finish
//!          bucket/1 ─┤           piece/1 ─┤            └► measure/1 ─┤  check/1 ─┤
//!          …        ─┘           …       ─┘               …         ─┘  …       ─┘
//! ```
//!
//! A mesh of which triangles are to be left out is simplified first, pass after pass, and numbered anew:
//!
//! ```text
//!      ─► planes/0 ─► deal/0.0 ─┬► simplify/0.0 ─┬► planes/1 ─► … ─► number ─┬► measure/0
//!                     deal/0.1 ─┤  simplify/0.1 ─┤                           └► measure/1
//!                     …        ─┘  …            ─┘                              …
//! ```
//!
//! One that becomes tiles is sorted by tile beside the check:
//!
//! ```text
//!      ─► sort/0 ─┬► tile/0 ─┬► finish
//!         sort/1 ─┤  tile/1 ─┤
//!         …      ─┘  …      ─┘
//! ```
//!
//! Where files of the input have changed, the same plan makes another *generation* of tasks ([`renew`]): what they do not touch stays.
//!
//! A task is done once its manifest has its name in the folder ([`crate::storage::work`]), which one process gives it: what others make of the same task is as good, and is
//! dropped. Nothing but the folder passes between processes.

mod finish;
mod perform;
mod plan;
mod renew;
mod simplify;
mod tiles;

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

pub use self::plan::{based_at, plan_tasks};
use crate::error::{Error, Result};
use crate::input::{Headers, Segment};
use crate::points::attribute::Schema;
use crate::resources::memory::MemoryPlan;
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
    /// Finds the planes by which a pass of the simplification cuts space.
    Planes(usize),
    /// Deals a share of a pass's triangles to rows of parts.
    Deal(usize, usize),
    /// Simplifies a run of a pass's rows.
    Simplify(usize, usize),
    /// Numbers what the last pass has left.
    Number,
    /// Looks at a share of the mesh's triangles, for the check.
    Measure(usize),
    /// Checks the mesh at a share of its vertices.
    Check(usize),
    /// Sorts a share of the mesh's triangles by tile.
    Sort(usize),
    /// Writes a run of tiles.
    Tile(usize),
    /// Tells what the check found, and writes all that is to be written.
    Finish,
}

impl fmt::Display for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Task::Bucket(number) => write!(f, "bucket/{number}"),
            Task::Close => f.write_str("close"),
            Task::Piece(number) => write!(f, "piece/{number}"),
            Task::Bridge(number) => write!(f, "bridge/{number}"),
            Task::Planes(pass) => write!(f, "planes/{pass}"),
            Task::Deal(pass, number) => write!(f, "deal/{pass}.{number}"),
            Task::Simplify(pass, number) => write!(f, "simplify/{pass}.{number}"),
            Task::Number => f.write_str("number"),
            Task::Measure(number) => write!(f, "measure/{number}"),
            Task::Check(number) => write!(f, "check/{number}"),
            Task::Sort(number) => write!(f, "sort/{number}"),
            Task::Tile(number) => write!(f, "tile/{number}"),
            Task::Finish => f.write_str("finish"),
        }
    }
}

impl FromStr for Task {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Task, String> {
        let wrong = || {
            let kinds =
                "bucket/N, close, piece/N, bridge/N, planes/P, deal/P.N, simplify/P.N, number, measure/N, check/N";
            format!("expected {kinds}, sort/N, tile/N or finish, found {text:?}")
        };
        let (kind, numbers) = text.split_once('/').map_or((text, Vec::new()), |(kind, numbers)| {
            (kind, numbers.split('.').map(str::parse::<usize>).collect())
        });
        let numbers = numbers.into_iter().collect::<std::result::Result<Vec<usize>, _>>().map_err(|_| wrong())?;
        match (kind, numbers.as_slice()) {
            ("bucket", [number]) => Ok(Task::Bucket(*number)),
            ("close", []) => Ok(Task::Close),
            ("piece", [number]) => Ok(Task::Piece(*number)),
            ("bridge", [number]) => Ok(Task::Bridge(*number)),
            ("planes", [pass]) => Ok(Task::Planes(*pass)),
            ("deal", [pass, number]) => Ok(Task::Deal(*pass, *number)),
            ("simplify", [pass, number]) => Ok(Task::Simplify(*pass, *number)),
            ("number", []) => Ok(Task::Number),
            ("measure", [number]) => Ok(Task::Measure(*number)),
            ("check", [number]) => Ok(Task::Check(*number)),
            ("sort", [number]) => Ok(Task::Sort(*number)),
            ("tile", [number]) => Ok(Task::Tile(*number)),
            ("finish", []) => Ok(Task::Finish),
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
    /// How often tasks were planned anew, as files of the input had changed.
    generation: u32,
    surveyed: Surveyed,
    schema: Schema,
    /// The input's files, from the folder of the command line; what tells a state of each from others; and what their headers told.
    files: Vec<PathBuf>,
    states: Vec<Value>,
    headers: Headers,
    /// What all that is made stands on but the points themselves.
    basis: Value,
    /// Of the input, for the tasks that sort points.
    segments: Vec<PlannedSegment>,
    /// Slabs in all, and those of each piece.
    slabs: u32,
    pieces: Vec<Range<u32>>,
}

/// A segment of the input, and the generation in which it was last another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct PlannedSegment {
    segment: Segment,
    generation: u32,
}

impl TaskPlan {
    /// The phase of the folder that a plan is.
    fn phase(generation: u32) -> String {
        of_generation(PLAN, generation)
    }

    /// The newest plan of a folder, if there is any.
    fn newest(work: &WorkFolder) -> Result<Option<TaskPlan>> {
        let done = work.done()?;
        let generations = done.iter().filter_map(|phase| match phase.strip_prefix(PLAN)? {
            "" => Some(0),
            number => number.strip_prefix('.')?.parse().ok(),
        });
        let Some(newest) = generations.max() else { return Ok(None) };
        let phase = TaskPlan::phase(newest);
        work.load(&phase, |manifest| {
            let damaged = |_| work.damaged(&format!("done/{phase}.json"), "it cannot be read");
            TaskPlan::deserialize(&manifest.rest).map_err(damaged)
        })
    }

    /// The phase of the folder that a task is, in this generation.
    fn phase_of(&self, task: Task) -> String {
        match task {
            Task::Bucket(number) => {
                let segment = self.segments.get(number);
                phase_of(task, segment.map_or(self.generation, |segment| segment.generation))
            }
            task => phase_of(task, self.generation),
        }
    }
}

/// The phase of the folder that a task of a generation is.
fn phase_of(task: Task, generation: u32) -> String {
    of_generation(&task.to_string().replace(['/', '.'], "-"), generation)
}

fn of_generation(name: &str, generation: u32) -> String {
    if generation == 0 { name.to_owned() } else { format!("{name}.{generation}") }
}

/// A folder of tasks.
#[derive(Debug)]
pub struct Tasks {
    work: Arc<WorkFolder>,
    plan: TaskPlan,
    /// The input's files.
    files: Vec<PathBuf>,
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

/// The folder at `path` and the command line that its tasks are of. Of a folder in an object store, what has to lie on this machine goes to the folder `local`.
///
/// # Errors
/// [`Error::Usage`] if there is no such folder; [`Error::Io`].
pub fn command_of(path: &Path, local: Option<&Path>) -> Result<(WorkFolder, Command)> {
    let work = WorkFolder::shared_with(path, local)?;
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
    /// The tasks of a folder, whose command line stands for `job`, with paths taken from the folder `base`.
    ///
    /// # Errors
    /// [`Error::NotReady`] if it is not planned yet; [`Error::Damaged`]; [`Error::Io`].
    pub fn of(work: WorkFolder, job: Job, base: &Path) -> Result<Tasks> {
        let Some(plan) = TaskPlan::newest(&work)? else {
            let (task, needed) = ("every task".to_owned(), PLAN.to_owned());
            return Err(Error::NotReady { path: work.path().to_path_buf(), task, needed });
        };
        let files = plan.files.iter().map(|file| based_at(base, file)).collect();
        let job = job.based_at(base);
        Ok(Tasks { work: Arc::new(work), plan, files, job })
    }

    fn phase(&self, task: Task) -> String {
        self.plan.phase_of(task)
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
                let state = match done.contains(&self.phase(task)) {
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
        let mut simplified = joined;
        for pass in self.passes() {
            let cut = stage(vec![Task::Planes(pass)], simplified);
            // What comes of a pass is known with its planes.
            simplified = false;
            let planes = if cut { self.planes(Task::Finish, pass)? } else { break };
            let dealt = stage(self.deals(Task::Finish, pass)?, cut);
            simplified = stage(self.simplifies(pass, &planes), dealt);
            if planes.are_last() {
                break;
            }
        }
        if self.is_simplified() {
            simplified = stage(vec![Task::Number], simplified);
        }
        let measured = stage(self.shares().map(Task::Measure).collect(), simplified);
        let checked = stage(self.shares().map(Task::Check).collect(), measured);
        let sorted = stage(self.tilings().map(Task::Sort).collect(), simplified);
        let tiled = stage(self.tilings().map(Task::Tile).collect(), sorted);
        stage(vec![Task::Finish], checked && tiled);
        Ok(tasks)
    }

    /// Whether tasks make the mesh that is written. They do not where a number of triangles is to be searched for, or where the mesh becomes another one in the end.
    fn is_whole(&self) -> bool {
        let settings = self.plan.surveyed.settled(&self.job.settings);
        !settings.bridged
            && settings.trim.is_none()
            && settings.simplify.is_none_or(|asked| asked.max_triangles.is_none())
    }

    /// The shares that the check is made in: none where the mesh is not checked, or tasks do not make it.
    fn shares(&self) -> Range<usize> {
        match self.job.check {
            Check::Always if self.is_whole() => 0..self.plan.pieces.len(),
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
        self.work.claim(&self.phase(task))
    }

    /// Bytes of memory that a process needs at the least, with so many threads.
    pub fn least_memory(&self, threads: usize) -> u64 {
        MemoryPlan::least(&self.plan.surveyed.workload, threads)
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.work.path()
    }

    /// The report of the run, once the mesh is finished.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn report(&self) -> Result<Option<Value>> {
        Ok(self.work.manifest(&self.phase(Task::Finish))?.map(|manifest| manifest.rest))
    }

    /// Whether the folder lies in an object store, where nothing can be claimed.
    pub fn is_remote(&self) -> bool {
        self.work.is_remote()
    }

    /// Removes the files that no task which is done has left; all of them once the mesh is finished. No process may be at work in the folder.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn clean(&self) -> Result<()> {
        self.work.clean(!self.work.is_done(&self.phase(Task::Finish)))
    }
}
