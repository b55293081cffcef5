//! Pages about the command itself, made from its arguments: completions for shells, and manual pages.

use clap::CommandFactory;
use clap_complete::Shell;
use clap_mangen::Man;

use super::args::Arguments;
use crate::error::{Error, Result};

/// The command's name, as it is typed.
const NAME: &str = "asra-stream";

/// What `shell` reads to complete options, values and file names.
pub fn completions(shell: Shell) -> String {
    let mut page = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), NAME, &mut page);
    String::from_utf8_lossy(&page).into_owned()
}

/// The manual page of the command, or of one of its subcommands, in roff.
///
/// # Errors
/// [`Error::Usage`] if there is no such subcommand.
pub fn manual(subcommand: Option<&str>) -> Result<String> {
    let mut command = Arguments::command();
    command.build();
    let page = match subcommand {
        None => command,
        Some(name) => {
            let found = command.get_subcommands().find(|known| known.get_name() == name && name != "help");
            let known = || command.get_subcommands().map(clap::Command::get_name).filter(|known| *known != "help");
            let unknown = || {
                Error::Usage(format!("{name}: no such command; there are: {}", known().collect::<Vec<_>>().join(", ")))
            };
            // Its page is called `asra-stream-check`, as git has `git-log`.
            found.cloned().ok_or_else(unknown)?
        }
    };
    let mut text = Vec::new();
    Man::new(page).render(&mut text).map_err(Error::io("the manual page", "write"))?;
    Ok(String::from_utf8_lossy(&text).into_owned())
}
