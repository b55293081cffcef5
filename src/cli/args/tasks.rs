//! Arguments of the commands for runs that several processes do together.

use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use clap::Args;

use super::shared::{ResourceArguments, TalkArguments};
use crate::run::tasks::Task;

/// Arguments of `tasks`.
#[derive(Debug, Args)]
pub struct TasksArguments {
    /// The folder that `plan --work` has made
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Only those that can be done now
    #[arg(long)]
    pub ready: bool,
    /// Write them as JSON, see docs/clusters.md
    #[arg(long)]
    pub json: bool,
    /// Remove files that are not needed any more; all of them once the mesh is finished. No process may be at work in the folder
    #[arg(long)]
    pub clean: bool,
}

/// Arguments of `work`.
#[derive(Debug, Args)]
pub struct WorkArguments {
    /// The folder that `plan --work` has made
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// The tasks to do, in this order, as `asra-stream tasks` lists them; what is done already is not done again
    #[arg(value_name = "TASK", required_unless_present = "any")]
    pub tasks: Vec<Task>,
    /// Do whatever can be done, until nothing is left
    #[arg(long, conflicts_with = "tasks")]
    pub any: bool,
    /// With --any: look for tasks from share I of N on, counted from 0, so that processes that start together begin with different ones
    #[arg(long, value_name = "I/N", requires = "any")]
    pub shard: Option<Shard>,
    /// With --any: begin no task after so long, as in 3h or 90m; exit code 75 says that there is more to do
    #[arg(long = "for", value_name = "TIME", value_parser = humantime::parse_duration, requires = "any")]
    pub time: Option<Duration>,
    /// End as soon as the process that started this one has ended
    #[arg(long)]
    pub die_with_parent: bool,
    /// How much is said.
    #[command(flatten)]
    pub talk: TalkArguments,
    /// Memory, disk, threads.
    #[command(flatten)]
    pub resources: ResourceArguments,
}

/// One of several processes that look for tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// Which it is, from 0 on.
    pub number: usize,
    /// How many there are.
    pub of: usize,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Shard, String> {
        let parts = text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
        match parts {
            Some((number, of)) if number < of => Ok(Shard { number, of }),
            _ => Err(format!("expected a share of shares, counted from 0, such as 0/4 or 3/4, found {text:?}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_counted_from_zero() {
        assert_eq!("0/1".parse(), Ok(Shard { number: 0, of: 1 }));
        assert_eq!("3/4".parse(), Ok(Shard { number: 3, of: 4 }));
        for wrong in ["4/4", "1", "/", "-1/3", "a/b", "0/0"] {
            assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
        }
    }
}
