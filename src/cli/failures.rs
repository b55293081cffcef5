//! What is told of a command that failed: its exit code, its words, and the failure as reports have it.

use clap::CommandFactory;
use serde_json::{Value, json};

use super::args::Arguments;
use super::{signals, sizes};
use crate::error::words::as_options;
use crate::error::{Error, Failure, Kind};
use crate::points::unit::Unit;
use crate::system::Farewell;

/// The exit code of a command that failed.
pub fn exit_code(error: &Error) -> u8 {
    match error.kind() {
        Kind::Signal => signals::exit_code(),
        kind => kind.row().codes[0],
    }
}

/// What a report has of a failure: in the command's words.
pub fn failure(error: &Error) -> Failure {
    let mut failure = error.failure(exit_code(error));
    failure.error.message = words(error);
    failure
}

/// Makes the line that standard error is told of a failure: the last object if `last` makes one, else words.
pub fn line(last: impl Fn(Value) -> Option<String> + Clone) -> impl Fn(&Error) -> String + Clone {
    move |error| {
        let end = json!({ "exit_code": exit_code(error), "kind": error.kind(), "message": words(error) });
        last(end).unwrap_or_else(|| format!("asra-stream: {}", words(error))) + "\n"
    }
}

/// Makes what is told of a failure with which the process has to end at once.
pub fn farewell(line: impl Fn(&Error) -> String) -> impl Fn(&Error) -> Farewell {
    move |error| {
        let report = serde_json::to_string_pretty(&failure(error)).unwrap_or_default() + "\n";
        Farewell { code: exit_code(error), line: line(error), report }
    }
}

/// What a failure is, and what to do, in the command's words.
fn words(error: &Error) -> String {
    let command = || meant(error).map(|name| format!("; the command is `asra-stream {name}`"));
    let advice = command()
        .or_else(|| lone_unit(error).map(|unit| format!("; a number and its unit are one word, as in 5{unit}")));
    as_options(&error.to_string()) + &advice.unwrap_or_default()
}

/// The word that was taken for a file that is not there.
fn missing(error: &Error) -> Option<&str> {
    let Error::Io { path, source, .. } = error else { return None };
    path.to_str().filter(|_| source.kind() == std::io::ErrorKind::NotFound)
}

/// The unit, of a length or of memory, that was typed apart from its number.
fn lone_unit(error: &Error) -> Option<&str> {
    let word = missing(error).filter(|word| word.starts_with(char::is_alphabetic))?;
    let number = format!("5{word}");
    (Unit::split(&number).0 == "5" || sizes::size(&number).is_ok()).then_some(word)
}

/// The command whose name was mistyped, so that it was taken for a file that is not there.
fn meant(error: &Error) -> Option<String> {
    let word = missing(error)?;
    let command = Arguments::command();
    let mut names = command.get_subcommands().map(|command| command.get_name().to_string());
    names.find(|name| near(word.as_bytes(), name.as_bytes()))
}

/// Whether two words are the same but for one letter more, one less, another, or two neighbours that changed places.
fn near(a: &[u8], b: &[u8]) -> bool {
    let (short, long) = if a.len() < b.len() { (a, b) } else { (b, a) };
    let same = short.iter().zip(long).take_while(|(a, b)| a == b).count();
    let (short, long) = (&short[same..], &long[same..]);
    match (short, long) {
        ([a, b, short @ ..], [c, d, long @ ..]) if (a, b) == (d, c) => short == long,
        ([_, short @ ..], [_, rest @ ..]) if short.len() == rest.len() => short == rest,
        (short, [_, rest @ ..]) => short == rest,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use std::hint::black_box;
    use std::path::Path;
    use std::process::{Command, Output};

    use super::*;
    use crate::error::overflow;
    use crate::run::progress::{Progress, Show};
    use crate::storage::atomic_file::AtomicFile;
    use crate::system::stack::Reported;

    /// Set where the test below is its own child: what that does, and its report.
    const CHILD: &str = "ASRA_STREAM_TEST_OVERFLOW";
    const NAME: &str = "cli::failures::tests::a_stack_that_is_used_up_is_an_error_in_the_data";
    const FILE: &str = "far/deep.laz";

    fn deep(n: u64) -> u64 {
        let here = black_box([n; 64]);
        if n == 0 { 0 } else { deep(black_box(n - 1)).wrapping_add(here[7]) }
    }

    /// What the child does; it does not come back.
    fn overflow(how: &str) {
        let endless = || black_box(deep(u64::MAX));
        let (how, report) = how.split_once(' ').unwrap_or((how, ""));
        let file = (!report.is_empty()).then(|| AtomicFile::report(Path::new(report)).unwrap());
        let _reported = file.map(|file| Reported::to(file.last_words().unwrap()));
        match how {
            "library" => drop(overflow::told(Path::new(FILE), endless)),
            "lines" | "json" => {
                let show = if how == "json" { Show::Json } else { Show::Lines };
                overflow::told_by(farewell(line(Progress::new(show).last_line())));
                overflow::told(Path::new(FILE), endless);
            }
            _ => {
                assert_eq!(overflow::told(Path::new(FILE), || deep(10)), 55);
                endless();
            }
        }
    }

    #[test]
    fn a_stack_that_is_used_up_is_an_error_in_the_data() {
        if let Ok(how) = std::env::var(CHILD) {
            return overflow(&how);
        }
        let child = |how: &str| -> Output {
            let test = std::env::current_exe().unwrap();
            Command::new(test).args([NAME, "--exact", "--nocapture"]).env(CHILD, how).output().unwrap()
        };
        for how in ["library", "lines", "json"] {
            let found = child(how);
            let words = String::from_utf8_lossy(&found.stderr).into_owned();
            assert_eq!(found.status.code(), Some(65), "{words}");
            assert!(words.contains("far/deep.laz: ") && words.contains("without end"), "{words}");
            assert!(words.contains("--attributes none"), "{words}");
            match how {
                "json" => {
                    let end: Value = serde_json::from_str(&words).unwrap();
                    let told = (&end["event"], &end["exit_code"], &end["kind"]);
                    assert_eq!(told, (&"end".into(), &65.into(), &"data".into()), "{words}");
                }
                _ => assert!(words.starts_with("asra-stream: ") && words.lines().count() == 1, "{words}"),
            }
        }
        let dir = tempfile::tempdir().unwrap();
        // A new report, and one that takes an older one's place.
        for before in [None, Some("older")] {
            let path = dir.path().join("r.json");
            before.inspect(|text| std::fs::write(&path, text).unwrap());
            assert_eq!(child(&format!("lines {}", path.display())).status.code(), Some(65));
            let report: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
            let error = &report["error"];
            assert_eq!((&error["kind"], &error["code"], &error["path"]), (&"data".into(), &65.into(), &FILE.into()));
            assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "nothing else is left");
        }
        // Elsewhere it is a defect, which the standard library tells.
        let other = child("elsewhere");
        assert_eq!(other.status.code(), None, "{}", String::from_utf8_lossy(&other.stderr));
    }

    #[test]
    fn a_mistyped_command_is_recognised() {
        let error = |word: &str| Error::io(word, "open")(std::io::ErrorKind::NotFound.into());
        for (word, name) in
            [("inof", "info"), ("inf", "info"), ("infos", "info"), ("chekc", "check"), ("rander", "render")]
        {
            assert_eq!(meant(&error(word)).as_deref(), Some(name), "{word}");
        }
        for word in ["a", "bunny", "fino", "info.ply", "scans/info", ""] {
            assert_eq!(meant(&error(word)), None, "{word}");
        }
        assert!(words(&error("inof")).ends_with("; the command is `asra-stream info`"));
        assert_eq!(failure(&error("inof")).error.message, words(&error("inof")));
        for unit in ["cm", "m", "us-ft", "GB", "M"] {
            assert!(words(&error(unit)).ends_with(&format!("one word, as in 5{unit}")), "{unit}");
        }
        for word in ["a.ply", "5", "scan.m", ""] {
            assert_eq!(lone_unit(&error(word)), None, "{word}");
        }
        assert_eq!(meant(&Error::io("inof", "open")(std::io::ErrorKind::PermissionDenied.into())), None);
    }
}
