//! A simplification that is ended at an operation of its storage, and goes on from what it kept.

use std::sync::Arc;

use super::super::passes::with_parts_of;
use super::*;
use crate::error::Error;
use crate::storage::work::WorkFolder;
use crate::storage::work::simulated::{Crash, Fault, Simulated};

/// What is left, its figures, and how often it was told how far it is: once for each part at the least.
type Left = (Mesh, Figures, usize);

/// Does some work with what a simplification of a torus with waves is given, in parts so small that there are rows and passes.
fn with_given(precision: Precision, moves: bool, work: impl FnOnce(Given<'_>)) {
    let shape = Shape { cells: [30, 24], closed: [true, true], waves: 0.8, noise: 0.4, turn: 0.3, seed: 5 };
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let workers = Workers::new(1).unwrap();
    let spool = shape.mesh().spool(precision, &workspace);
    let options = Options { tolerance: Some(0.04), moves, ..WITHIN };
    let (mesh, budget) = (&spool, 64 << 20);
    let given = Given { mesh, options: &options, budget, workers: &workers, workspace: &workspace, kept: None };
    with_parts_of(90, || work(given));
}

/// A simplification that keeps its passes in a store, until its end or its fault.
fn kept_in(store: &Simulated, given: Given<'_>, threads: usize) -> Result<Left> {
    let work = WorkFolder::in_store(Arc::new(store.clone()))?;
    assert_eq!(work.begin(&serde_json::json!({ "mesh": "this" }))?, None);
    let workers = Workers::new(threads)?;
    let mut told = 0;
    let given = Given { workers: &workers, kept: Some((&work, "thin")), ..given };
    let (left, figures) = simplify(given, &mut |_| told += 1)?;
    work.settle(false)?;
    Ok((Mesh::of(&left), figures, told))
}

/// The same after a crash or damage: what is told to be damaged was set aside, and is made again.
fn gone_on_with(store: &Simulated, given: Given<'_>, threads: usize) -> Result<Left> {
    let mut outcome = kept_in(store, given, threads);
    for _ in 0..3 {
        if matches!(outcome, Err(Error::Damaged { .. })) {
            outcome = kept_in(store, given, threads);
        }
    }
    outcome
}

/// Of several rows of parts and three passes: at every operation, by a kill and by a power cut, with a broken disk and with a full one.
#[test]
#[ignore = "exhaustive"]
fn goes_on_after_every_operation() {
    for moves in [false, true] {
        with_given(Precision::Single, moves, |given| {
            let (left, figures) = simplify(given, &mut |_| ()).unwrap();
            let expected = (Mesh::of(&left), figures);
            assert_eq!(figures.passes, 3);
            let whole = Simulated::default();
            let (left, figures, of_all) = kept_in(&whole, given, 1).unwrap();
            assert_eq!((left, figures), expected);
            let (left, figures, told) = kept_in(&whole.after(Crash::Kill), given, 2).unwrap();
            assert_eq!(((left, figures), told), (expected.clone(), 1), "no part is simplified again");

            // Of vertices that move, every other case.
            let step = if moves { 2 } else { 1 };
            let faults = (0..whole.operations()).flat_map(|at| {
                let crash = [(Fault::CrashAt(at), Crash::Kill), (Fault::CrashAt(at), Crash::PowerCut(at))];
                let disk = [(Fault::BrokenAt(at), Crash::Kill), (Fault::FullFrom(at), Crash::Kill)];
                crash.into_iter().chain(disk).skip((at % step) as usize).step_by(step as usize)
            });
            let (mut cases, mut gone_on) = (0, 0);
            for (fault, crash) in faults {
                let store = Simulated::default();
                store.plant(fault);
                match kept_in(&store, given, 1) {
                    Ok((left, figures, _)) => assert_eq!((left, figures), expected, "{fault:?}"),
                    Err(error) => assert!(matches!(error, Error::Io { .. }), "{error}"),
                }
                let outcome = gone_on_with(&store.after(crash), given, 1 + cases % 2);
                let (left, figures, told) = outcome.unwrap_or_else(|error| panic!("{fault:?}, {crash:?}: {error}"));
                assert_eq!((left, figures), expected, "{fault:?}, {crash:?}");
                cases += 1;
                gone_on += usize::from(told < of_all);
            }
            println!("{cases} cases, {gone_on} went on from a part");
            assert!(4 * gone_on > cases, "{gone_on} of {cases} went on from a part");
        });
    }
}

/// What has changed of what was kept is made again.
#[test]
fn what_is_damaged_is_made_again() {
    with_given(Precision::Double, false, |given| {
        let store = Simulated::default();
        let (left, figures, _) = kept_in(&store, given, 1).unwrap();
        for (name, length) in store.files().into_iter().filter(|(name, _)| name != "job.json") {
            for place in [0, length / 2, length - 1] {
                let damaged = store.after(Crash::Kill);
                damaged.damage(&name, place);
                let found = gone_on_with(&damaged, given, 1).unwrap_or_else(|error| panic!("{name}: {error}"));
                assert_eq!((&found.0, found.1), (&left, figures), "{name} {place}");
            }
        }
    });
}
