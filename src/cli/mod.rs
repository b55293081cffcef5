//! The command line: what was typed becomes a job, a job becomes an exit code.

mod args;
mod commands;
mod outputs;
mod sizes;

use std::process::ExitCode;
use std::sync::atomic::Ordering;

use clap::Parser;

use crate::error::{Error, Result};
use crate::schedule::Workers;

pub use args::{Arguments, Command};

/// Exit codes; batch systems act on them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// Done.
    Done = 0,
    /// The work failed: input, disk, memory.
    Failed = 1,
    /// The arguments are wrong.
    Usage = 2,
    /// The reconstruction's mesh failed its own check.
    OwnCheckFailed = 3,
    /// `check` found that a mesh is not a closed, oriented 2-manifold, or that it intersects itself.
    NotSound = 4,
    /// Ctrl-C, or a termination signal.
    Interrupted = 130,
}

impl From<&Error> for Exit {
    fn from(error: &Error) -> Exit {
        match error {
            Error::Usage(_) | Error::OutputExists(_) => Exit::Usage,
            Error::CheckFailed(_) => Exit::OwnCheckFailed,
            Error::Interrupted => Exit::Interrupted,
            _ => Exit::Failed,
        }
    }
}

/// Parses the command line, does what it says, and gives the exit code.
pub fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(words) => {
            // Help and version come this way, too, and are no failure. A closed pipe is none either.
            let _ = words.print();
            return ExitCode::from(words.exit_code() as u8);
        }
    };
    let exit = commands::execute(arguments).unwrap_or_else(|error| {
        eprintln!("asra-stream: {error}");
        Exit::from(&error)
    });
    ExitCode::from(exit as u8)
}

/// Lets Ctrl-C and termination signals stop `workers` at the next job; a second one ends the process at once. Then the
/// output in the making may stay, under its temporary name; the rest of the temporary files never has a name.
fn stop_on_signal(workers: &Workers) -> Result<()> {
    let flag = workers.cancel_flag();
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(Exit::Interrupted as i32);
        }
    })
    .map_err(|e| Error::io("signals", "handle")(std::io::Error::other(e)))
}
