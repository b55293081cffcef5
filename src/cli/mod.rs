//! The command line: what was typed becomes a job, a job becomes an exit code.

mod args;
mod commands;
mod failures;
mod outputs;
mod pages;
mod results;
mod signals;
mod sizes;
mod tasks;
mod view;

use std::ffi::OsString;
use std::io::Write;
use std::process::ExitCode;

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
    let arguments = match Arguments::read(arguments) {
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
/// [`Error::Usage`], with the command's words for what is wrong.
pub fn parsed(arguments: impl IntoIterator<Item = OsString>) -> Result<Arguments> {
    Arguments::read(arguments).map_err(|words| Error::Usage(what_is_wrong(&words)))
}

/// What is wrong with the arguments, without what only those need who typed them: how the command is used, how to ask for help, how to write a name that looks
/// like an option.
fn what_is_wrong(words: &clap::Error) -> String {
    if words.exit_code() == 0 {
        return "help and version are the command's own".into();
    }
    let text = words.render().to_string();
    let of_the_command = |part: &str| {
        ["Usage:", "For more information", "tip: to pass"].iter().any(|begin| part.trim_start().starts_with(begin))
    };
    let kept: Vec<&str> = text.trim_end().split("\n\n").filter(|part| !of_the_command(part)).collect();
    let kept = kept.join("\n");
    kept.strip_prefix("error: ").unwrap_or(&kept).to_owned()
}

/// What is wrong with the arguments, begun as every error of this program is.
fn named(words: &clap::Error) -> String {
    let words = words.render();
    let text = if console::colors_enabled_stderr() { words.ansi().to_string() } else { words.to_string() };
    text.replacen("error:", "asra-stream:", 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_is_told_what_is_wrong_and_no_more() {
        let told = |line: &str| parsed(line.split(' ').map(OsString::from)).unwrap_err().to_string();
        let wrong = told("asra-stream a.ply --fit=spher");
        assert!(wrong.starts_with("invalid value 'spher' for '--fit <FIT>'"), "{wrong}");
        assert!(wrong.ends_with("tip: a similar value exists: 'sphere'"), "{wrong}");
        // The name that it had before.
        assert!(parsed("asra-stream a.ply --fit plane".split(' ').map(OsString::from)).is_ok());
        assert_eq!(told("asra-stream a.ply --zzz"), "unexpected argument '--zzz' found");
        assert_eq!(told("asra-stream --help"), "help and version are the command's own");
        assert_eq!(told("asra-stream info --"), "the following required arguments were not provided:\n  <INPUT>...");
    }
}
