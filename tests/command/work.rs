//! `--work`: a run that was ended goes on.

use rustix::process::{Pid, Signal, kill_process};

use super::folder::Folder;
use crate::let_children_hear_signals;

/// Ends a run when its bar of progress has come to a phase; gives its exit code and what it said.
fn ended(f: &Folder, arguments: &str, phase: &str, signal: Signal) -> (Option<i32>, String) {
    use std::io::{BufRead, BufReader};
    let mut command = f.command(&format!("{arguments} --progress json"));
    let mut child = command.stderr(std::process::Stdio::piped()).spawn().unwrap();
    let mut said = String::new();
    for line in BufReader::new(child.stderr.take().unwrap()).lines() {
        let line = line.unwrap();
        if line.contains(&format!("\"{phase}\"")) && !said.contains("SENT") {
            kill_process(Pid::from_child(&child), signal).unwrap();
            said += "SENT\n";
        }
        said = said + &line + "\n";
    }
    (child.wait().unwrap().code(), said)
}

#[test]
fn a_run_that_was_ended_goes_on_to_the_same_bytes() {
    let_children_hear_signals();
    let f = Folder::new();
    f.knot(60_000);
    f.ok("k.ply -o whole.ply");
    let whole = f.read("whole.ply");
    for (phase, signal, code) in [
        ("survey", Signal::TERM, Some(143)),
        ("raster", Signal::TERM, Some(143)),
        ("seal", Signal::KILL, None),
        ("surface", Signal::INT, Some(130)),
        ("check", Signal::KILL, None),
        ("write", Signal::KILL, None),
    ] {
        let (found, said) = ended(&f, "k.ply -o m.ply --work m.work", phase, signal);
        if found == Some(0) {
            // It was done before it heard of it.
            assert_eq!(f.read("m.ply"), whole, "{phase}");
        } else {
            assert_eq!(found, code, "{phase}: {said}");
            let kept = code.is_some() && phase != "survey";
            assert!(said.contains("the same command goes on from there") == kept, "{phase}: {said}");
            // It has its name when it is whole.
            assert!(!f.names("").contains("m.ply") || f.read("m.ply") == whole, "{phase}");
            // A kill in the last instant finds nothing left to do, nor anything to go on from.
            let is_left = ["m.work/job.json", "m.work/done/output.json"].iter().any(|name| f.path(name).exists());
            if !f.names("").contains("m.ply") || is_left {
                let told = f.ok("k.ply -o m.ply --work m.work -j 1 --max-memory 64M");
                // A kill may have come before the points were durable.
                assert!(told.err.contains("going on") || !kept, "{phase}: {}", told.err);
            }
            assert_eq!(f.read("m.ply"), whole, "{phase}");
        }
        assert!(!f.names("").contains("m.work"), "the folder is removed");
        std::fs::remove_file(f.path("m.ply")).unwrap();
    }
}

#[test]
fn an_output_that_the_run_has_named_is_its_own_and_any_other_is_refused() {
    let_children_hear_signals();
    let f = Folder::new();
    f.knot(60_000);
    f.ok("k.ply -o whole.ply");
    let (found, said) = ended(&f, "k.ply -o m.ply --work m.work", "surface", Signal::TERM);
    assert_eq!(found, Some(143), "{said}");
    // Somebody else's, while the folder tells of none.
    f.write("m.ply", "precious");
    let refused = f.run("k.ply -o m.ply --work m.work");
    assert!(refused.code == 2 && refused.err.contains("m.ply: exists already"), "{}", refused.err);
    assert_eq!(f.read("m.ply"), b"precious");
    // The run's own, as the folder tells: it was ended once its output had its name.
    let value = serde_json::json!({ "files": [], "rest": "m.ply" });
    let crc = crc32fast::hash(value.to_string().as_bytes());
    f.write("m.work/done/output.json", serde_json::json!({ "crc": crc, "value": value }).to_string());
    f.write("m.ply", f.read("whole.ply"));
    let told = f.ok("k.ply -o m.ply --work m.work");
    assert!(told.err.contains("going on"), "{}", told.err);
    assert_eq!(f.read("m.ply"), f.read("whole.ply"));
    assert!(!f.names("").contains("m.work"), "the folder is removed");
}

#[test]
fn a_folder_of_another_run_is_refused_with_what_differs() {
    let_children_hear_signals();
    let f = Folder::new();
    f.knot(60_000);
    let (found, said) = ended(&f, "k.ply -o m.ply --work m.work", "seal", Signal::TERM);
    assert_eq!(found, Some(143), "{said}");
    let other = f.run("k.ply -o m.ply --work m.work --smooth 2");
    assert!(other.code == 2 && other.err.contains("surface") && other.err.contains("m.work"), "{}", other.err);
    // A changed input is named.
    let mut bytes = f.read("k.ply");
    *bytes.last_mut().unwrap() ^= 1;
    f.write("k.ply", &bytes);
    let changed = f.run("k.ply -o m.ply --work m.work");
    assert!(changed.code == 75 && changed.err.contains("k.ply: changed"), "{}", changed.err);
    let input = f.run("- -o m.ply --work n.work");
    assert!(input.code == 2 && input.err.contains("--work"), "{}", input.err);
    let full = f.run("k.ply -o m.ply --work .");
    assert!(full.code == 2 && full.err.contains("other files"), "{}", full.err);
}
