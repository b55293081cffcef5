//! The flags: name, type, help and default, each in one place; docs/cli.md is made from this.

mod cloud;
mod examples;
mod generate;
mod meshes;
mod runs;
mod shared;
mod tasks;
mod values;

use std::ffi::OsString;

use clap::{Args, Parser, Subcommand};
use clap_complete::Shell;

pub use self::generate::GenerateArguments;
pub use self::meshes::{
    CheckArguments, CompareArguments, DensifyArguments, RenderArguments, SimplifyArguments, TilesetArguments,
    ViewArguments,
};
pub use self::runs::{InfoArguments, PlanArguments, ReconstructArguments};
pub use self::shared::overwrite;
pub use self::tasks::{Shard, TasksArguments, WorkArguments};
use crate::run::progress::Show;

/// Turns point clouds too large for memory into watertight triangle meshes, without normals.
///
/// Points are sorted into slices on disk; a sliding window of slices streams through closing, extraction, smoothing and
/// fitting. The mesh is closed, oriented and 2-manifold, or with --surface a 2-manifold with a boundary; it is checked, and it has
/// the same bytes for any memory and threads. docs/guide.md has recipes for objects, terrain and noisy scans.
#[derive(Debug, Parser)]
#[command(version, args_conflicts_with_subcommands = true, arg_required_else_help = true)]
#[command(after_help = examples::of_the_command())]
pub struct Arguments {
    /// What to do instead of reconstructing.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// What to reconstruct.
    #[command(flatten)]
    pub reconstruct: ReconstructArguments,
    /// What was typed behind the program's name, for others to read again.
    #[arg(skip)]
    pub typed: Vec<OsString>,
}

impl Arguments {
    /// What was typed, of which the first is the program's name.
    ///
    /// # Errors
    /// Those of the parser, help and version among them.
    pub fn read(typed: impl IntoIterator<Item = OsString>) -> Result<Arguments, clap::Error> {
        let typed: Vec<OsString> = typed.into_iter().collect();
        let arguments = Arguments::try_parse_from(&typed)?;
        Ok(Arguments { typed: typed.into_iter().skip(1).collect(), ..arguments })
    }

    /// How progress is to be shown.
    pub fn show(&self) -> Show {
        match &self.command {
            None => self.reconstruct.talk.show(),
            Some(Command::Plan(plan)) => plan.run.talk.show(),
            Some(Command::Work(work)) => work.talk.show(),
            Some(Command::Tasks(_)) => Show::Nothing,
            Some(Command::Info(info)) => info.progress.show(),
            Some(Command::Check(check)) => check.talk.show(),
            Some(Command::Compare(compare)) => compare.talk.show(),
            Some(Command::Densify(densify)) => densify.talk.show(),
            Some(Command::Simplify(simplify)) => simplify.talk.show(),
            Some(Command::Tileset(tileset)) => tileset.talk.show(),
            Some(Command::View(view)) => view.talk.show(),
            Some(Command::Render(render)) => render.talk.show(),
            Some(Command::Generate(generate)) => generate.talk.show(),
            Some(Command::Completions(_) | Command::Man(_)) => Show::Nothing,
        }
    }
}

/// What to do instead of reconstructing.
#[derive(Debug, Subcommand)]
pub enum Command {
    #[command(after_help = examples::PLAN)]
    /// Show what a reconstruction would take (memory, disk, slices, triangles, tiles): points are sorted and cells closed to count that, and no mesh is made. With --work,
    /// write the run down as tasks for many processes
    Plan(Box<PlanArguments>),
    #[command(after_help = examples::TASKS)]
    /// List the tasks of a run that several processes do together, and how it stands with each
    Tasks(TasksArguments),
    #[command(after_help = examples::WORK)]
    /// Do tasks of a run that several processes do together
    Work(WorkArguments),
    #[command(after_help = examples::INFO)]
    /// Show what is in the input: layout, points and how densely they lie, reference system and its unit, box, classes and returns, grid
    Info(Box<InfoArguments>),
    #[command(after_help = examples::CHECK)]
    /// Check a mesh: closed, oriented, manifold, free of self-intersections, Euler number, components, volume, area (exit
    /// code 4 if it is no closed oriented 2-manifold or intersects itself)
    Check(CheckArguments),
    #[command(after_help = examples::COMPARE)]
    /// Measure how far a mesh lies from a reference, a mesh or a cloud, and the reference from it
    Compare(CompareArguments),
    #[command(after_help = examples::DENSIFY)]
    /// Add the centroids of a mesh's triangles to a cloud
    Densify(DensifyArguments),
    #[command(after_help = examples::SIMPLIFY)]
    /// Leave out triangles of a mesh as long as its surface stays within a distance from what it was, both ways; a closed mesh stays closed, and nothing
    /// intersects
    Simplify(SimplifyArguments),
    #[command(after_help = examples::TILESET)]
    /// Make a tileset of a mesh: 3D Tiles with levels of detail, for web viewers and globes
    Tileset(TilesetArguments),
    #[command(after_help = examples::VIEW)]
    /// Show a tileset, a mesh or a cloud's mesh in a browser on this machine
    View(ViewArguments),
    #[command(after_help = examples::RENDER)]
    /// Draw a picture of a mesh
    Render(RenderArguments),
    /// Write a test cloud of any size
    #[command(after_help = examples::GENERATE)]
    Generate(GenerateArguments),
    /// Print what a shell needs to complete this command's options
    #[command(after_help = examples::COMPLETIONS)]
    Completions(CompletionsArguments),
    /// Print the manual page of this command, or of a subcommand
    #[command(after_help = examples::MAN)]
    Man(ManArguments),
}

/// Arguments of `completions`.
#[derive(Debug, Args)]
pub struct CompletionsArguments {
    /// The shell
    #[arg(value_enum)]
    pub shell: Shell,
}

/// Arguments of `man`.
#[derive(Debug, Args)]
pub struct ManArguments {
    /// The subcommand: check, compare and so on [default: the command itself]
    pub command: Option<String>,
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use clap::CommandFactory;

    use super::*;
    use crate::settings::Settings;

    #[test]
    fn the_flags_are_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn one_resolution_at_a_time() {
        for two in
            [["--k", "3", "--slices", "9"], ["--k", "3", "--cell-size", "1"], ["--slices", "9", "--cell-size", "auto"]]
        {
            let line = ["asra-stream", "a.ply"].into_iter().chain(two);
            assert!(Arguments::try_parse_from(line).is_err(), "{two:?}");
        }
    }

    #[test]
    fn a_reconstruction_needs_no_word_for_it() {
        let arguments = Arguments::try_parse_from(["asra-stream", "huge.bin", "--window", "3"]).unwrap();
        let job = arguments.reconstruct.job().unwrap();
        assert_eq!(job.inputs, [PathBuf::from("huge.bin")]);
        assert_eq!(job.settings, Settings { window: Some(3), ..Settings::default() });
    }
}
