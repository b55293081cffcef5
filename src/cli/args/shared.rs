//! Arguments that several commands have.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use crate::cli::sizes;
use crate::error::Kind;
use crate::input::{InputOptions, Layout};
use crate::points::attribute::Wanted;
use crate::points::unit::Unit;
use crate::run::Resources;
use crate::run::compare::Reach;
use crate::run::progress::Show;
use crate::settings::open::Hole;
use crate::settings::simplification::Tolerance;
use crate::storage::atomic_file::Overwrite;

/// How much is said on standard error.
#[derive(Debug, Args)]
pub struct TalkArguments {
    /// Say nothing but errors
    #[arg(short, long)]
    pub quiet: bool,
    /// How progress is told: auto is a bar on a terminal, else lines with the time of day; json is an object a line, see docs/progress.md
    #[arg(long, value_name = "HOW", value_enum, default_value_t, hide_possible_values = true)]
    pub progress: ProgressWord,
}

/// How progress is told, as typed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum ProgressWord {
    /// As fits standard error.
    #[default]
    Auto,
    /// Lines.
    Lines,
    /// JSON.
    Json,
}

impl ProgressWord {
    /// The way to show it.
    pub fn show(self) -> Show {
        match self {
            ProgressWord::Auto => Show::fitting(),
            ProgressWord::Lines => Show::Lines,
            ProgressWord::Json => Show::Json,
        }
    }
}

impl TalkArguments {
    /// The way to show progress.
    pub fn show(&self) -> Show {
        if self.quiet { Show::Nothing } else { self.progress.show() }
    }
}

/// Memory, disk, threads: nothing of it shows in the mesh.
#[derive(Debug, Args)]
pub struct ResourceArguments {
    /// Memory to work in, such as 512M or 2G [default: a quarter of the machine's]
    #[arg(long, value_name = "SIZE", value_parser = sizes::size, help_heading = "Resources")]
    pub max_memory: Option<u64>,
    /// Worker threads [default: one for each processor]
    #[arg(short = 'j', long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..), help_heading = "Resources")]
    pub threads: Option<u16>,
    /// Folder for temporary files [default: TMPDIR, else the mesh's folder]
    #[arg(long, value_name = "DIR", help_heading = "Resources")]
    pub temp_dir: Option<PathBuf>,
}

impl ResourceArguments {
    /// The means of a run.
    pub fn resources(&self) -> Resources {
        Resources {
            max_memory: self.max_memory,
            threads: self.threads.map(usize::from),
            temp_dir: self.temp_dir.clone(),
            work: None,
        }
    }
}

/// What was typed, and the unit of the length in it, if it has one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InUnit<T> {
    /// Without the unit.
    pub value: T,
    /// The unit.
    pub unit: Option<Unit>,
}

impl<T> InUnit<T> {
    /// What `parse` makes of the text without its unit; `is_length` tells whether that is something that can have one.
    pub(super) fn parse(
        text: &str,
        parse: impl Fn(&str) -> std::result::Result<T, String>,
        is_length: impl Fn(&T) -> bool,
    ) -> std::result::Result<InUnit<T>, String> {
        let (number, unit) = Unit::split(text);
        // Messages quote what was typed.
        let value =
            parse(number).map_err(|wrong| wrong.replace(&format!("found {number:?}"), &format!("found {text:?}")))?;
        match unit {
            Some(unit) if !is_length(&value) => Err(format!("expected a length before {unit}, found {text:?}")),
            _ => Ok(InUnit { value, unit }),
        }
    }
}

/// A text with a length in it, which may have a unit.
pub(super) fn in_unit<T>(text: &str) -> std::result::Result<InUnit<T>, String>
where
    T: std::str::FromStr<Err = String> + Measured,
{
    InUnit::parse(text, str::parse, T::is_length)
}

/// What may be a length.
pub(super) trait Measured {
    /// Whether it is one.
    fn is_length(&self) -> bool;
}

impl Measured for Hole {
    fn is_length(&self) -> bool {
        matches!(self, Hole::Length(_))
    }
}

impl Measured for Tolerance {
    fn is_length(&self) -> bool {
        matches!(self, Tolerance::Length(_))
    }
}

impl Measured for Reach {
    fn is_length(&self) -> bool {
        matches!(self, Reach::Length(_))
    }
}

/// How a cloud is read of which only the places count.
pub(super) fn coordinates_only(layout: &Option<Layout>) -> InputOptions {
    InputOptions { layout: layout.clone(), attributes: Wanted::None, ..InputOptions::default() }
}

/// What the flag `--overwrite` means.
pub fn overwrite(flag: bool) -> Overwrite {
    if flag { Overwrite::Replace } else { Overwrite::Refuse }
}

/// The text below `--help`: the table of exit codes, in short.
pub(super) fn exit_codes() -> String {
    let words = |kind: &Kind| {
        let row = kind.row();
        let codes: Vec<String> = row.codes.iter().map(u8::to_string).collect();
        let name = if *kind == Kind::Done { "done" } else { row.name };
        format!("{} {name}", codes.join(", "))
    };
    format!("Exit codes: {}.", Kind::ALL.iter().map(words).collect::<Vec<_>>().join("; "))
}
