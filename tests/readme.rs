//! The documents say what the program does: every option with its default in docs/cli.md, every exit code in the guide; links lead somewhere.
//!
//! `ASRA_STREAM_BLESS=1 cargo test --test readme` writes docs/cli.md anew.

use std::fmt::Write;
use std::path::Path;

use asra_stream::cli::Arguments;
use asra_stream::internals::error::Kind;
use asra_stream::internals::error::words::SETTINGS;
use clap::{Arg, Command, CommandFactory};

const README: &str = include_str!("../README.md");
const GUIDE: &str = include_str!("../docs/guide.md");

/// The text below a heading, to the next.
fn section<'a>(document: &'a str, heading: &str) -> &'a str {
    let (_, below) = document.split_once(&format!("\n{heading}\n")).unwrap_or_else(|| panic!("no heading {heading:?}"));
    below.split("\n#").next().unwrap()
}

/// The option as the table writes it: `-o`, `--output FILE`; of an argument its name.
fn written(arg: &Arg) -> String {
    let names = || arg.get_value_names().map(|names| names[0].to_string()).unwrap_or_default();
    let Some(long) = arg.get_long() else { return format!("`{}`", names()) };
    let mut long = format!("--{long}");
    if arg.is_require_equals_set() {
        long += &format!("[={}]", names());
    } else if arg.get_action().takes_values() {
        long += &format!(" {}", names());
    }
    arg.get_short().map_or(format!("`{long}`"), |short| format!("`-{short}`, `{long}`"))
}

/// The default that clap knows, or that the help names in brackets; and the help without it.
fn default_and_help(arg: &Arg) -> (String, String) {
    let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    let (help, named) = match help.split_once(" [default: ") {
        Some((help, rest)) => (help.to_owned(), rest.trim_end_matches(']').to_owned()),
        None => (help, String::new()),
    };
    match arg.get_default_values().first().filter(|_| arg.get_action().takes_values()) {
        Some(value) => (value.to_str().unwrap().to_owned(), help),
        None => (named, help),
    }
}

fn program() -> Command {
    let mut program = Arguments::command();
    program.build();
    program
}

/// A table of a command's arguments and options.
fn table(command: &Command) -> String {
    let mut out = String::from("| option | default | meaning |\n|---|---|---|\n");
    let mut arguments: Vec<&Arg> = command.get_arguments().collect();
    arguments.retain(|arg| !["help", "version"].contains(&arg.get_id().as_str()));
    // Arguments first, then the options in the order of `--help`: those without a heading before the others.
    arguments.sort_by_key(|arg| (arg.get_long().is_some(), arg.get_help_heading().is_some()));
    for arg in arguments {
        let (default, mut help) = default_and_help(arg);
        let values: Vec<String> = match arg.get_action().takes_values() {
            true => arg.get_possible_values().iter().map(|value| format!("`{}`", value.get_name())).collect(),
            false => Vec::new(),
        };
        if !values.is_empty() {
            write!(help, ": {}", values.join(", ")).unwrap();
        }
        let cells = [written(arg), default, help].map(|cell| cell.replace('|', "\\|"));
        writeln!(out, "| {} |", cells.join(" | ")).unwrap();
    }
    out
}

fn reference() -> String {
    let program = program();
    let mut out = String::from("# Commands and options\n\nMade from the program's own help, and tested against it.\n");
    let about = |command: &Command| {
        let about = command.get_about().map(ToString::to_string).unwrap_or_default();
        about.split_whitespace().collect::<Vec<_>>().join(" ").trim_end_matches('.').to_owned()
    };
    writeln!(out, "\n## `asra-stream INPUT...`\n\n{}.\n\n{}", about(&program), table(&program).trim_end()).unwrap();
    for command in program.get_subcommands().filter(|command| command.get_name() != "help") {
        writeln!(
            out,
            "\n## `asra-stream {}`\n\n{}.\n\n{}",
            command.get_name(),
            about(command),
            table(command).trim_end()
        )
        .unwrap();
    }
    out
}

#[test]
fn every_option_is_in_the_reference() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/cli.md");
    let reference = reference();
    if std::env::var_os("ASRA_STREAM_BLESS").is_some() {
        std::fs::write(&path, &reference).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == reference,
        "docs/cli.md is not what the program says: ASRA_STREAM_BLESS=1 cargo test --test readme"
    );
    assert!(reference.matches("\n| ").count() > 100, "there are more options than that");
}

#[test]
fn settings_that_messages_name_are_options() {
    let reference = reference();
    for setting in SETTINGS {
        let option = setting.replace('_', "-");
        assert!(reference.contains(&format!("`--{option}")), "{option} is no option");
    }
}

#[test]
fn options_that_readme_names_are_there() {
    let reference = reference();
    let documents = [README, GUIDE, include_str!("../docs/formats.md")].concat();
    for word in documents.split(|c: char| !(c.is_ascii_lowercase() || c == '-')).filter(|word| word.starts_with("--")) {
        let option = word.trim_end_matches('-');
        // Those of other programs' commands that are shown.
        if option.len() > 3 && !["--release", "--path", "--test", "--tests", "--ignored", "--lib"].contains(&option) {
            assert!(reference.contains(&format!("`{option}")), "{option} is no option");
        }
    }
    for command in program().get_subcommands().filter(|c| c.get_name() != "help") {
        assert!(README.contains(command.get_name()), "{}", command.get_name());
    }
}

#[test]
fn exit_codes_are_those_of_the_program() {
    let lines = section(GUIDE, "## Exit codes").lines().filter(|line| line.starts_with("| ")).skip(1);
    let rows: Vec<String> = lines.map(str::to_owned).collect();
    let known = Kind::ALL.map(|kind| {
        let row = kind.row();
        let codes: Vec<String> = row.codes.iter().map(u8::to_string).collect();
        let name = if kind == Kind::Done { row.name.to_owned() } else { format!("`{}`", row.name) };
        format!("| {} | {name} | {} | {} |", codes.join(", "), row.meaning, row.again)
    });
    assert_eq!(rows, known);
    let help = program().get_after_help().unwrap().to_string();
    let told = |kind: &Kind| help.contains(&format!("{} {}", kind.row().codes.last().unwrap(), kind.row().name));
    assert!(Kind::ALL[1..].iter().all(told), "{help}");
}

#[test]
fn files_that_are_linked_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for document in [
        "README.md",
        "ARCHITECTURE.md",
        "docs/algorithm.md",
        "docs/guide.md",
        "docs/formats.md",
        "docs/cli.md",
        "docs/progress.md",
        "docs/python.md",
        "docs/info-and-plan.md",
        "benches/results/README.md",
        "python/README.md",
    ] {
        let path = root.join(document);
        let text = std::fs::read_to_string(&path).unwrap();
        for part in text.split("](").skip(1) {
            let link = part.split(')').next().unwrap();
            let file = link.split('#').next().unwrap();
            assert!(link.starts_with("https://") || path.parent().unwrap().join(file).exists(), "{document}: {link}");
        }
    }
    assert!(README.lines().count() <= 150, "README has {} lines", README.lines().count());
    let commands: Vec<&str> =
        section(README, "## Two commands").lines().filter(|line| line.starts_with("cargo ")).collect();
    let [meshes, tests] = commands[..] else { panic!("two commands, not {commands:?}") };
    assert!(meshes.contains(" tests/data/stadium ") && meshes.ends_with(" --preview"), "{meshes}");
    let exhaustive = "cargo test --tests -- --ignored";
    assert!(README.contains(&format!("`{exhaustive}`")), "README names {exhaustive:?}");
    for tests in [tests, exhaustive] {
        let runs = |line: &str| {
            let line = line.trim().trim_start_matches("if ! ");
            line == tests || line.starts_with(&format!("{tests} </dev/null >"))
        };
        assert!(include_str!("../.ci/run").lines().any(runs), "CI runs {tests:?}");
    }
}
