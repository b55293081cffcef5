//! Runs that several processes do together: `plan --work`, `tasks` and `work`.

use std::fmt;
use std::hash::{BuildHasher, RandomState};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::{Duration, Instant};

use bytesize::ByteSize;
use serde::Serialize;

use super::args::{Arguments, Command, PlanArguments, Shard, TasksArguments, WorkArguments};
use super::results::{json_file, print_json, print_text, write_json};
use super::signals;
use crate::error::{Error, Kind, Result};
use crate::resources::machine;
use crate::resources::workers::Workers;
use crate::run::progress::{Progress, Show};
use crate::run::report::Report;
use crate::run::tasks::{Command as Planned, State, Task, TaskState, Tasks, based_at, command_of, plan_tasks};

/// How long a process waits before it looks for tasks again: at first, and at most.
const LOOKS: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(3)];

/// How often a process tries again what failed as what it needs was damaged, or was not there.
const TRIES: u32 = 3;

/// How often a process looks whether the one that started it is still there, and how long it may take to end then.
const ORPHANED: [Duration; 2] = [Duration::from_millis(200), Duration::from_secs(2)];

/// Writes down the tasks of the run that `plan` is asked about.
pub fn planned(all: &Arguments, plan: &PlanArguments, workers: &Workers, progress: &mut Progress) -> Result<Tasks> {
    let words = all.typed.iter().map(|word| word.clone().into_string());
    let words = words.collect::<std::result::Result<Vec<String>, _>>().map_err(|word| {
        Error::Usage(format!("{}: tasks are for all machines, and this name is no Unicode text", word.display()))
    })?;
    let folder = std::env::current_dir().map_err(Error::io(".", "find the folder of"))?;
    let command = Planned { words, folder };
    plan_tasks(&plan.run.job()?, &command, usize::from(plan.processes), workers, progress)
}

/// The tasks of a folder, the arguments of the run that they are of, and the folder from which paths in these are taken.
fn opened(folder: &Path, local: Option<&Path>) -> Result<(Tasks, Box<PlanArguments>, PathBuf)> {
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    let (work, Planned { words, folder: base }) = command_of(&folder, local)?;
    let typed = std::iter::once("asra-stream".into()).chain(words.into_iter().map(Into::into));
    match Arguments::read(typed).map(|arguments| arguments.command) {
        Ok(Some(Command::Plan(plan))) => Ok((Tasks::of(work, plan.run.job()?, &base)?, plan, base)),
        _ => Err(Error::Usage(format!(
            "{}: its tasks are of a command that this program does not know",
            folder.display()
        ))),
    }
}

/// What `tasks` tells.
#[derive(Debug, Serialize)]
pub struct Listed {
    /// The folder.
    folder: PathBuf,
    /// Whether the mesh is finished.
    finished: bool,
    /// Bytes of memory that a process needs at the least, with as many threads as this one.
    least_memory: u64,
    /// The report of the run, once the mesh is finished.
    #[serde(skip_serializing_if = "Option::is_none")]
    report: Option<serde_json::Value>,
    /// The tasks.
    tasks: Vec<TaskState>,
}

impl Listed {
    /// All tasks, or those that can be done now.
    pub fn of(tasks: &Tasks, ready: bool, threads: usize) -> Result<Listed> {
        let mut states = tasks.states()?;
        let finished = states.iter().all(|task| task.state == State::Done);
        states.retain(|task| !ready || task.state == State::Ready);
        let (folder, least_memory) = (tasks.path().to_path_buf(), tasks.least_memory(threads));
        let report = if finished { tasks.report()? } else { None };
        Ok(Listed { folder, finished, least_memory, report, tasks: states })
    }
}

impl fmt::Display for Listed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for TaskState { task, state } in &self.tasks {
            let state = match state {
                State::Done => "done",
                State::Ready => "ready",
                State::Waiting => "waiting",
            };
            writeln!(f, "{:<12} {state}", task.to_string())?;
        }
        let folder = self.folder.display();
        match self.finished {
            true => write!(f, "all is done"),
            false => write!(
                f,
                "in each process: asra-stream work {folder} --any, with {} at the least",
                ByteSize(self.least_memory)
            ),
        }
    }
}

/// Lists tasks.
pub fn list(arguments: &TasksArguments) -> Result<Kind> {
    let listed = listed(arguments)?;
    if arguments.json { print_json(&listed) } else { print_text(&listed.to_string()) }?;
    Ok(Kind::Done)
}

/// What there is to list.
pub fn listed(arguments: &TasksArguments) -> Result<Listed> {
    let (tasks, ..) = opened(&arguments.folder, None)?;
    if arguments.clean {
        tasks.clean()?;
    }
    Listed::of(&tasks, arguments.ready, machine::processors())
}

/// Does tasks.
pub fn work(arguments: &WorkArguments, progress: &mut Progress) -> Result<Kind> {
    let workers = arguments.resources.resources().workers()?;
    signals::stop(&workers)?;
    done(arguments, &workers, progress)
}

/// The same with these workers.
pub fn done(arguments: &WorkArguments, workers: &Workers, progress: &mut Progress) -> Result<Kind> {
    if arguments.die_with_parent {
        end_with_parent(workers)?;
    }
    let (tasks, plan, base) = opened(&arguments.folder, arguments.resources.resources().temp_dir.as_deref())?;
    let one = |task: Task, progress: &mut Progress| -> Result<()> {
        let report = tasks.perform(task, &arguments.resources.resources(), workers, progress)?;
        report.map_or(Ok(()), |report| tell(&report, &plan, &base, progress))
    };
    if !arguments.any {
        arguments.tasks.iter().try_for_each(|task| one(*task, progress))?;
        return Ok(Kind::Done);
    }
    let (start, mut wait, mut failed) = (Instant::now(), LOOKS[0], 0);
    loop {
        let states = tasks.states()?;
        if states.iter().all(|task| task.state == State::Done) {
            return Ok(Kind::Done);
        }
        if arguments.time.is_some_and(|time| start.elapsed() >= time) {
            progress.note(&format!("{}: there is more to do, and no time for it", tasks.path().display()));
            return Ok(Kind::Temporary);
        }
        workers.check_cancelled()?;
        let ready = in_turn(&states, arguments.shard, tasks.is_remote());
        let mut found = false;
        for task in ready {
            let Some(_claim) = tasks.claimed(task)? else { continue };
            found = true;
            let before = Instant::now();
            match one(task, progress) {
                Ok(()) => progress.note(&format!("{task}: done in {:.1} s", before.elapsed().as_secs_f64())),
                // What is damaged is made again; what was listed and is not there shows after a while.
                Err(error @ (Error::Damaged { .. } | Error::NotReady { .. })) if failed < TRIES => {
                    failed += 1;
                    progress.note(&error.to_string());
                }
                Err(error) => return Err(error),
            }
            break;
        }
        if found {
            wait = LOOKS[0];
        } else {
            // Others are at work on what is ready.
            thread::sleep(wait);
            wait = (2 * wait).min(LOOKS[1]);
        }
    }
}

/// The tasks that can be done, in the order in which this process looks at them. Where nobody can say what it is at, processes that look together begin with tasks that are seldom
/// the same: first those of its own share, each process in an order of its own.
fn in_turn(states: &[TaskState], shard: Option<Shard>, unclaimed: bool) -> Vec<Task> {
    let ready = states.iter().enumerate().filter(|(_, task)| task.state == State::Ready);
    let mut ready: Vec<(usize, Task)> = ready.map(|(number, task)| (number, task.task)).collect();
    let Shard { number: share, of } = shard.unwrap_or(Shard { number: 0, of: 1 });
    if unclaimed {
        static ORDER: OnceLock<RandomState> = OnceLock::new();
        let order = ORDER.get_or_init(RandomState::new);
        ready.sort_by_key(|(number, _)| (number % of != share, order.hash_one(number)));
    } else {
        let first = ready.len() * share / of;
        ready.rotate_left(first);
    }
    ready.into_iter().map(|(_, task)| task).collect()
}

/// Tells what came of the run, as the run itself would have.
fn tell(report: &Report, plan: &PlanArguments, base: &Path, progress: &mut Progress) -> Result<()> {
    progress.summary(&report.summary(plan.run.verbose));
    if progress.show() == Show::Json {
        report.warnings.iter().for_each(|warning| progress.warn(warning));
        progress.summarise(&report.output);
    }
    let path = plan.run.report.as_ref().map(|path| based_at(base, path));
    match json_file(path.as_deref())? {
        Some(file) => write_json(file, report),
        None => Ok(()),
    }
}

/// Has this process end when the one that started it is gone: at the next job, and in any case after a while.
#[cfg(unix)]
fn end_with_parent(workers: &Workers) -> Result<()> {
    let (parent, flag) = (std::os::unix::process::parent_id(), workers.cancel_flag());
    let watch = move || {
        while std::os::unix::process::parent_id() == parent {
            thread::sleep(ORPHANED[0]);
        }
        flag.store(true, Ordering::SeqCst);
        thread::sleep(ORPHANED[1]);
        std::process::exit(i32::from(Kind::Signal.row().codes[2]));
    };
    // Without the thread, it ends when its work does.
    drop(thread::Builder::new().name("asra-parent".into()).spawn(watch));
    Ok(())
}

#[cfg(not(unix))]
fn end_with_parent(_: &Workers) -> Result<()> {
    Err(Error::Usage(
        "--die-with-parent: this system does not tell what has become of the process that started this one".into(),
    ))
}
