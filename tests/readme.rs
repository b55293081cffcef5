//! README says what the program does: every flag with its default, every exit code, every shape.

use std::collections::BTreeMap;

use asra_stream::cli::Arguments;
use asra_stream::error::Kind;
use asra_stream::generate::Shape;
use clap::{Arg, Command, CommandFactory};

const README: &str = include_str!("../README.md");

/// The text below a heading, to the next.
fn section(heading: &str) -> &'static str {
    let (_, below) = README.split_once(&format!("\n{heading}\n")).unwrap_or_else(|| panic!("no heading {heading:?}"));
    below.split("\n#").next().unwrap()
}

/// The rows of the section's table: its first two columns.
fn rows(section: &str) -> Vec<[String; 2]> {
    let lines = section.lines().filter(|line| line.starts_with("| ")).skip(1);
    let cells =
        |line: &str| line.replace("\\|", "¦").split('|').map(|c| c.trim().replace('¦', "|")).collect::<Vec<_>>();
    lines.map(cells).map(|cells| [cells[1].clone(), cells[2].clone()]).collect()
}

/// The flag as the table writes it: `-o`, `--output FILE`.
fn written(arg: &Arg) -> String {
    let mut long = format!("--{}", arg.get_long().unwrap());
    if arg.is_require_equals_set() {
        long += &format!("[={}]", arg.get_value_names().unwrap()[0]);
    } else if arg.get_action().takes_values() {
        long += &format!(" {}", arg.get_value_names().unwrap()[0]);
    }
    arg.get_short().map_or(format!("`{long}`"), |short| format!("`-{short}`, `{long}`"))
}

/// The default that clap knows, or that the help names in brackets.
fn default(arg: &Arg) -> String {
    if let Some(value) = arg.get_default_values().first().filter(|_| arg.get_action().takes_values()) {
        return value.to_str().unwrap().to_owned();
    }
    let help = arg.get_help().unwrap().to_string();
    help.split_once("[default: ").map_or_else(String::new, |(_, rest)| rest.trim_end_matches(']').to_owned())
}

/// The flags in the order of `--help`: those without a heading first.
fn flags(command: &Command) -> Vec<[String; 2]> {
    let mut flags: Vec<&Arg> = command.get_arguments().filter(|arg| arg.get_long().is_some()).collect();
    flags.retain(|arg| !["help", "version"].contains(&arg.get_id().as_str()));
    flags.sort_by_key(|arg| arg.get_help_heading().is_some());
    flags.into_iter().map(|arg| [written(arg), default(arg)]).collect()
}

fn program() -> Command {
    let mut program = Arguments::command();
    program.build();
    program
}

#[test]
fn the_tables_list_exactly_the_flags_and_their_defaults() {
    let program = program();
    assert_eq!(rows(section("### Options")), flags(&program));
    for name in ["compare", "densify", "render", "generate"] {
        let table = rows(section(&format!("### Options of `{name}`")));
        assert_eq!(table, flags(program.find_subcommand(name).unwrap()), "{name}");
    }
}

#[test]
fn other_subcommands_take_options_of_the_table() {
    let program = program();
    let all: BTreeMap<String, String> = flags(&program).into_iter().map(|[flag, default]| (flag, default)).collect();
    let names = |command: &str| {
        let flags = flags(program.find_subcommand(command).unwrap());
        for [flag, default] in &flags {
            // The only flags of its own; README's text names them.
            if ["`--no-intersections`", "`--open`", "`--json`"].contains(&flag.as_str()) {
                assert!(README.contains(flag));
                continue;
            }
            assert_eq!(all.get(flag), Some(default), "{command} {flag}");
        }
        flags.into_iter().map(|[flag, _]| flag).collect::<Vec<_>>()
    };
    let table: Vec<String> = flags(&program).into_iter().map(|[flag, _]| flag).collect();
    let first = table.iter().position(|flag| flag.contains("--recursive")).unwrap();
    let progress = table.iter().find(|flag| flag.contains("--progress")).unwrap();
    let tile = table.iter().find(|flag| flag.contains("--tile")).unwrap();
    let own = ["`--json`".to_owned(), tile.clone(), progress.clone()];
    let plan = [&own, &table[first..]].concat();
    assert_eq!(names("plan"), plan);
    let mut info = plan;
    info.retain(|flag| !["--max-memory", "--tile"].iter().any(|name| flag.contains(name)));
    assert_eq!(names("info"), info);
    let mut check: Vec<String> = table[table.len() - 3..].to_vec();
    let told = |flag: &&String| ["--report", "--quiet", "--progress"].iter().any(|name| flag.contains(name));
    check.splice(0..0, table.iter().filter(told).cloned());
    check.splice(0..0, ["`--open`", "`--no-intersections`"].map(str::to_owned));
    assert_eq!(names("check"), check);
    for command in program.get_subcommands().filter(|c| c.get_name() != "help") {
        assert!(README.contains(&format!("asra-stream {}", command.get_name())), "{}", command.get_name());
    }
}

#[test]
fn exit_codes_and_shapes_are_those_of_the_program() {
    let lines = section("### Exit codes").lines().filter(|line| line.starts_with("| ")).skip(1);
    let rows: Vec<String> = lines.map(str::to_owned).collect();
    let known = Kind::ALL.map(|kind| {
        let row = kind.row();
        let codes: Vec<String> = row.codes.iter().map(u8::to_string).collect();
        let name = if kind == Kind::Done { row.name.to_owned() } else { format!("`{}`", row.name) };
        format!("| {} | {name} | {} | {} |", codes.join(", "), row.meaning, row.again)
    });
    assert_eq!(rows, known);
    let help = program().get_after_help().unwrap().to_string();
    assert!(
        Kind::ALL[1..].iter().all(|kind| help.contains(&format!(
            "{} {}",
            kind.row().codes.last().unwrap(),
            kind.row().name
        ))),
        "{help}"
    );
    let shapes: Vec<String> = Shape::ALL.iter().map(Shape::to_string).collect();
    assert!(README.contains(&format!("`{}`", shapes.join(" "))));
}

#[test]
fn files_that_are_linked_exist() {
    for part in README.split("](").skip(1) {
        let link = part.split(')').next().unwrap();
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(link);
        assert!(link.starts_with("https://") || path.exists(), "{link}");
    }
    let commands: Vec<&str> = section("## Two commands").lines().filter(|line| line.starts_with("cargo ")).collect();
    let [meshes, tests] = commands[..] else { panic!("two commands, not {commands:?}") };
    assert!(meshes.contains(" tests/data/stadium "), "{meshes}");
    assert!(include_str!("../.ci/run").contains(&format!("if ! {tests} <")), "CI runs {tests:?}");
}
