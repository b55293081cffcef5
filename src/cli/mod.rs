//! The command line: what was typed becomes a job, a job becomes an exit code.

mod args;
mod commands;
mod failures;
mod outputs;
mod pages;
mod signals;
mod sizes;

use std::ffi::OsString;
use std::io::Write;
use std::process::ExitCode;

use clap::Parser;
use serde_json::json;

use crate::error::{Error, Result, defect, overflow};
use crate::run::progress::Progress;

pub use args::{Arguments, Command};
pub use commands::outcome;
pub use failures::exit_code;

/// Parses the command line, does what it says, and gives the exit code.
pub fn main() -> ExitCode {
    ExitCode::from(run(std::env::args_os()))
}

/// [`main`] for arguments of which the first is the program's name.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(words) => {
            // Help and version come this way, too, and are no failure. A closed pipe is none either.
            let _ = match words.use_stderr() {
                true => write!(std::io::stderr(), "{}", named(&words)),
                false => words.print(),
            };
            return words.exit_code() as u8;
        }
    };
    defect::keep_for_the_error();
    let mut progress = Progress::new(arguments.show());
    let line = failures::line(progress.last_line());
    overflow::told_by(failures::farewell(line.clone()));
    match defect::caught(|| commands::execute(arguments, &mut progress)) {
        Ok(kind) => {
            let code = kind.row().codes[0];
            progress.finished(json!({ "exit_code": code, "kind": kind }));
            code
        }
        Err(error) => {
            // The bar's line, if there is one, is to be free. Whether anyone can be told or not.
            progress.clear();
            let _ = std::io::stderr().write_all(line(&error).as_bytes());
            exit_code(&error)
        }
    }
}

/// What a command line asks for, in whose arguments the first is the program's name: for programs that offer the command's options under their own names.
///
/// # Errors
/// [`Error::Usage`], with the words that the command would print.
pub fn parsed(arguments: impl IntoIterator<Item = OsString>) -> Result<Arguments> {
    Arguments::try_parse_from(arguments).map_err(|words| Error::Usage(words.render().to_string().trim_end().to_owned()))
}

/// What is wrong with the arguments, begun as every error of this program is.
fn named(words: &clap::Error) -> String {
    let words = words.render();
    let text = if console::colors_enabled_stderr() { words.ansi().to_string() } else { words.to_string() };
    text.replacen("error:", "asra-stream:", 1)
}
