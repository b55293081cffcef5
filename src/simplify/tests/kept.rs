//! A simplification that is ended at an operation of its storage, and goes on from what it kept.

use std::path::Path;
use std::sync::Arc;

use super::super::passes::with_parts_of;
use super::*;
use crate::error::Error;
use crate::storage::work::WorkFolder;
use crate::storage::work::simulated::{Crash, Fault, Simulated};

/// A simplification that keeps its passes in a store, until its end or its fault: what is left, and the part that was done before anything had to be simplified.
fn kept_in(store: &Simulated, given: Given<'_>, threads: usize) -> Result<(Mesh, Figures, f64)> {
    let work = WorkFolder::in_store(Arc::new(store.clone()))?;
    assert_eq!(work.begin(&serde_json::json!({ "mesh": "this" }))?, None);
    let workers = Workers::new(threads)?;
    let mut first = None;
    let told = &mut |part: f64| {
        first.get_or_insert(part);
    };
    let (left, figures) = simplify(Given { workers: &workers, kept: Some((&work, "thin")), ..given }, told)?;
    work.settle(false)?;
    Ok((Mesh::of(&left), figures, first.unwrap()))
}

/// Of four rows of parts and three passes: at every operation, by a kill and by a power cut, with a broken disk and with a full one.
#[test]
fn goes_on_after_every_operation() {
    let shape = Shape { cells: [30, 24], closed: [true, true], waves: 0.8, noise: 0.4, turn: 0.3, seed: 5 };
    let mesh = shape.mesh();
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let workers = Workers::new(1).unwrap();
    let spool = mesh.spool(Precision::Single, &workspace);
    for moves in [false, true] {
        let options = Options { tolerance: Some(0.04), moves, ..WITHIN };
        let budget = 64 << 20;
        let given =
            Given { mesh: &spool, options: &options, budget, workers: &workers, workspace: &workspace, kept: None };
        with_parts_of(90, || {
            let (left, figures) = simplify(given, &mut |_| ()).unwrap();
            let expected = (Mesh::of(&left), figures);
            assert_eq!(figures.passes, 3);
            let whole = Simulated::default();
            let done = kept_in(&whole, given, 1).unwrap();
            assert_eq!((done.0, done.1), expected);
            let operations = whole.operations();
            let faults = (0..operations).flat_map(|at| {
                let crash = [(Fault::CrashAt(at), Crash::Kill), (Fault::CrashAt(at), Crash::PowerCut(at))];
                let disk = [(Fault::BrokenAt(at), Crash::Kill), (Fault::FullFrom(at), Crash::Kill)];
                // Of vertices that move, every other kind at every other operation.
                let step = if moves { 2 } else { 1 };
                crash.into_iter().chain(disk).skip((at % step) as usize).step_by(step as usize)
            });
            let mut skipped = 0;
            for (number, (fault, crash)) in faults.enumerate() {
                let store = Simulated::default();
                store.plant(fault);
                match kept_in(&store, given, 1) {
                    Ok(done) => assert_eq!((done.0, done.1), expected, "{fault:?}"),
                    Err(error) => assert!(matches!(error, Error::Io { .. }), "{error}"),
                }
                let found = store.after(crash);
                let mut outcome = kept_in(&found, given, 1 + number % 2);
                for _ in 0..3 {
                    // What a power cut tore is set aside, and made again.
                    if matches!(outcome, Err(Error::Damaged { .. })) {
                        outcome = kept_in(&found, given, 2);
                    }
                }
                let (left, figures, first) = outcome.unwrap_or_else(|error| panic!("{fault:?}, {crash:?}: {error}"));
                assert_eq!((left, figures), expected, "{fault:?}, {crash:?}");
                skipped += usize::from(first > 0.1);
            }
            // Of what was kept, use is made.
            assert!(skipped > operations as usize / 2, "{skipped} of {operations} operations went on from a row");
        });
    }
}

/// What has changed of what was kept is made again; a phase by the same name in the folder of another kind is damage.
#[test]
fn what_is_damaged_is_made_again() {
    let shape = Shape { cells: [40, 40], closed: [true, false], waves: 0.5, noise: 0.3, turn: 0.2, seed: 3 };
    let mesh = shape.mesh();
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let workers = Workers::new(1).unwrap();
    let spool = mesh.spool(Precision::Double, &workspace);
    let options = Options { tolerance: Some(0.02), ..WITHIN };
    let given = Given {
        mesh: &spool,
        options: &options,
        budget: 64 << 20,
        workers: &workers,
        workspace: &workspace,
        kept: None,
    };
    with_parts_of(240, || {
        let store = Simulated::default();
        let (left, figures, _) = kept_in(&store, given, 1).unwrap();
        for (name, length) in store.files().into_iter().filter(|(name, _)| name != "job.json") {
            for place in [0, length / 2, length - 1] {
                let damaged = store.after(Crash::Kill);
                damaged.damage(&name, place);
                let mut outcome = kept_in(&damaged, given, 1);
                if matches!(outcome, Err(Error::Damaged { .. })) {
                    outcome = kept_in(&damaged, given, 1);
                }
                let found = outcome.unwrap_or_else(|error| panic!("{}: {error}", Path::new(&name).display()));
                assert_eq!((&found.0, found.1), (&left, figures), "{name} {place}");
            }
        }
    });
}
