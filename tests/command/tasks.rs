//! `plan --work`, `tasks` and `work`: several processes do a run together.

use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process, test_kill_process};
use serde_json::Value;

use super::folder::Folder;
use crate::let_children_hear_signals;

/// What `tasks --json` tells.
fn listed(f: &Folder, line: &str) -> Value {
    serde_json::from_str(&f.ok(line).out).unwrap()
}

/// Whether `tasks` says that a task is done.
fn is_done(told: &str, task: &str) -> bool {
    told.lines().any(|line| line.split_whitespace().collect::<Vec<_>>() == [task, "done"])
}

#[test]
fn several_processes_make_the_mesh_of_one_run() {
    let f = Folder::new();
    f.knot(60_000);
    f.ok("k.ply -o whole.ply --smooth 2 --report whole.json");
    let planned = f.ok("plan k.ply -o m.ply --smooth 2 --report m.json --work w --processes 3");
    assert!(
        planned.out.contains("bucket/0     ready") && planned.out.contains("finish       waiting"),
        "{}",
        planned.out
    );
    assert!(!f.names("").contains("m.ply"));
    let processes: Vec<_> =
        (0..3).map(|n| f.command(&format!("work w --any --shard {n}/3 -j 1")).spawn().unwrap()).collect();
    for process in processes {
        let output = process.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    assert!(f.read("m.ply") == f.read("whole.ply"));
    let report = |name: &str| serde_json::from_slice::<Value>(&f.read(name)).unwrap();
    for key in ["points", "grid", "vertices", "seams", "check", "closing", "fit"] {
        assert_eq!(report("m.json")[key], report("whole.json")[key], "{key}");
    }
    let done = listed(&f, "tasks w --json");
    assert_eq!(done["finished"], true);
    // Whoever comes late has nothing to do, and so has whoever does a task again.
    f.ok("work w --any");
    f.ok("work w bucket/0 close piece/0 finish");
    assert_eq!(listed(&f, "tasks w --json --ready")["tasks"], Value::Array(Vec::new()));
    f.ok("tasks w --clean");
    assert!(f.names("w/data").is_empty());
    f.ok("work w --any");
}

/// A file of the input changes after all is done: what it touches is done again.
#[test]
fn a_changed_input_is_planned_anew() {
    let f = Folder::new();
    f.knot(60_000);
    f.write("more.xyz", "0.1 0.4 0.1\n0.2 0.4 0.1\n");
    let plan = "plan k.ply more.xyz -o m.ply --cell-size 0.004 --keep-outliers --work w --processes 2";
    f.ok(plan);
    f.ok("work w --any -q");
    f.write("more.xyz", "0.1 0.4 0.1\n0.2 0.4 0.15\n");
    let again = f.ok(plan);
    assert!(again.err.contains("more.xyz has changed: bucket/1 and close are to be done again"), "{}", again.err);
    assert!(again.out.contains("bucket/0     done") && again.out.contains("bucket/1     ready"), "{}", again.out);
    let work = f.ok("work w --any");
    assert!(work.err.contains("stays as it was"), "{}", work.err);
    f.ok("k.ply more.xyz -o plain.ply --cell-size 0.004 --keep-outliers");
    assert!(f.read("m.ply") == f.read("plain.ply"));
    // Nothing has changed since.
    let none = f.ok(plan);
    assert!(!none.err.contains("to be done again") && none.out.contains("all is done"), "{}{}", none.err, none.out);
}

/// A simplified mesh is made by tasks, too.
#[test]
fn simplification_is_tasks() {
    let f = Folder::new();
    f.knot(60_000);
    f.ok("k.ply -o whole.ply --simplify 0.3c");
    f.ok("plan k.ply -o m.ply --simplify 0.3c --work w --processes 2");
    f.ok("work w --any -q");
    assert!(f.read("m.ply") == f.read("whole.ply"));
    let tasks = f.ok("tasks w");
    assert!(tasks.out.contains("planes/0     done") && tasks.out.contains("simplify/0.0 done"), "{}", tasks.out);
    assert!(is_done(&tasks.out, "number") && is_done(&tasks.out, "check/0"), "{}", tasks.out);
    f.fails("work w simplify/9.0", 2, &["has no task simplify/9.0"]);
    f.fails("work w deal/0.77", 2, &["has no task deal/0.77"]);
}

/// Tiles are made by tasks, too, of a simplified mesh as of a whole one; a damaged one is made again.
#[test]
fn tiles_are_tasks() {
    let f = Folder::new();
    f.knot(60_000);
    for (number, more) in
        ["", " --simplify 0.3c", " --simplify 0.3c --move-vertices --glb", " --simplify 0.3c --max-triangles 9000"]
            .into_iter()
            .enumerate()
    {
        let (kind, more) = if more.ends_with("--glb") { ("glb", &more[..more.len() - 6]) } else { ("ply", more) };
        f.ok(&format!("k.ply -o whole{number}.{kind} --tile 0.1{more}"));
        f.ok(&format!("plan k.ply -o m{number}.{kind} --tile 0.1{more} --work w{number} --processes 2"));
        if number == 1 || number == 2 {
            // Up to the last task; then what a task has written is damaged, or cut off.
            let work = format!("w{number}");
            loop {
                let ready = listed(&f, &format!("tasks {work} --json --ready"));
                let next = ready["tasks"][0]["task"].as_str().unwrap();
                if next == "finish" {
                    break;
                }
                f.ok(&format!("work {work} {next} -q"));
            }
            let files = f.names(&format!("{work}/data"));
            let tiles = files.into_iter().find(|name| name.starts_with("files-tile-0")).unwrap();
            let tiles = format!("{work}/data/{tiles}");
            let mut bytes = f.read(&tiles);
            let last = bytes.pop().unwrap();
            bytes.extend((number == 1).then_some(last ^ 1));
            f.write(&tiles, bytes);
        }
        f.ok(&format!("work w{number} --any -q"));
        let names = f.names(&format!("whole{number}.tiles"));
        assert!(names.len() > 20 && names == f.names(&format!("m{number}.tiles")), "{names:?}");
        for name in names {
            assert!(
                f.read(&format!("whole{number}.tiles/{name}")) == f.read(&format!("m{number}.tiles/{name}")),
                "{number} {name}"
            );
        }
        let tasks = f.ok(&format!("tasks w{number}"));
        assert_eq!(is_done(&tasks.out, "tile/0"), number != 3, "{}", tasks.out);
    }
    f.fails("work w0 tile/9", 2, &["has no task tile/9"]);
}

#[test]
fn mistakes_are_told() {
    let f = Folder::new();
    f.knot(3000);
    f.fails("work w --any", 2, &["w: is no folder of tasks", "INPUT --work DIR makes one"]);
    f.fails("tasks k.ply", 2, &["is no folder of tasks"]);
    f.fails("plan - -o m.ply --work w", 2, &["--work", "standard input"]);
    f.fails("plan k.ply -o m.ply --work w --dtm d.tif", 2, &["--dtm"]);
    f.fails("plan k.ply -o m.ply --processes 3", 2, &["--work"]);
    f.write("there.ply", "somebody's");
    f.fails("plan k.ply -o there.ply --work w", 2, &["there.ply", "exists"]);
    f.ok("plan k.ply -o m.ply --work w");
    f.fails("k.ply -o m.ply --work w", 2, &["holds tasks, which `asra-stream work w` does"]);
    f.fails("plan k.ply -o other.ply --work w", 2, &["holds another run"]);
    f.fails("work w finish", 69, &["finish needs piece/0"]);
    f.fails("work w piece/17", 2, &["has no task piece/17"]);
    f.fails("work w door/1", 2, &["bucket/N", "door/1"]);
    f.fails("work w --any --max-memory 1M", 71, &["--max-memory"]);
    let late = f.run("work w --any --for 0s");
    assert_eq!(late.code, 75, "{}", late.err);
    // Tasks that are planned already stay.
    f.ok("plan k.ply -o m.ply --work w");
    f.ok("work w --any -q");
    assert!(f.names("").contains("m.ply"));
}

/// A process that was started by one that is gone ends soon.
#[test]
fn an_orphan_ends() {
    let_children_hear_signals();
    let f = Folder::new();
    f.knot(3000);
    f.ok("plan k.ply -o m.ply --work w");
    // It waits for a task that another has: the one that this test claims.
    let claim = std::fs::File::create(f.path("w/claims/bucket-0"));
    let claim = claim.or_else(|_| {
        std::fs::create_dir(f.path("w/claims"))?;
        std::fs::File::create(f.path("w/claims/bucket-0"))
    });
    let claim = claim.unwrap();
    rustix::fs::flock(&claim, rustix::fs::FlockOperation::LockExclusive).unwrap();
    let program = env!("CARGO_BIN_EXE_asra-stream");
    let script = format!("{program} work w --any --die-with-parent -q & echo $!; sleep 60");
    let mut parent = std::process::Command::new("sh");
    parent.args(["-c", &script]).current_dir(f.path("")).stdout(std::process::Stdio::piped());
    let mut parent = parent.spawn().unwrap();
    let mut line = String::new();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(parent.stdout.take().unwrap()), &mut line).unwrap();
    let child = Pid::from_raw(line.trim().parse().unwrap()).unwrap();
    std::thread::sleep(Duration::from_secs(1));
    assert!(test_kill_process(child).is_ok(), "it waits");
    kill_process(Pid::from_child(&parent), Signal::KILL).unwrap();
    parent.wait().unwrap();
    let start = Instant::now();
    // A process that nobody waits for is reaped by the system's first.
    while test_kill_process(child).is_ok() && !is_dead(child) {
        assert!(start.elapsed() < Duration::from_secs(30), "it is still there");
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn is_dead(process: Pid) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", process.as_raw_nonzero())).unwrap_or_default();
    stat.rsplit_once(") ").is_none_or(|(_, state)| state.starts_with('Z'))
}
