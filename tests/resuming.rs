//! A run that was ended goes on to the same bytes: crashed at every operation of its storage, by kills and by power cuts, with a broken disk, with a full one, with files that
//! were damaged meanwhile.

use std::path::PathBuf;
use std::sync::Arc;

use asra_stream::internals::error::{Error, Kind};
use asra_stream::internals::grid::context::Context;
use asra_stream::internals::input::{Cloud, InputOptions};
use asra_stream::internals::mesh::MeshSource;
use asra_stream::internals::resources::workers::Workers;
use asra_stream::internals::run::pipeline::{context, reconstruct};
use asra_stream::internals::run::progress::{Progress, Show};
use asra_stream::internals::run::surveyed::survey_cloud;
use asra_stream::internals::settings::open::Open;
use asra_stream::internals::settings::surface::SurfaceOptions;
use asra_stream::internals::settings::{Fineness, Resolution, Settings};
use asra_stream::internals::storage::spool::Workspace;
use asra_stream::internals::storage::work::WorkFolder;
use asra_stream::internals::storage::work::simulated::{Crash, Fault, Simulated};

/// Vertices, attributes and triangles, as bits.
type Bits = (Vec<[u64; 3]>, Vec<u64>, Vec<[u32; 3]>);

const POINTS: usize = 900;

/// A cloud in a file, and what is made of it.
struct Case {
    dir: tempfile::TempDir,
    path: PathBuf,
    settings: Settings,
}

impl Case {
    /// A sphere with waves, whose points have an attribute; or the ground below it, seen from above.
    fn new(is_open: bool) -> Case {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cloud.bin");
        let mut bytes = Vec::new();
        for i in 0..POINTS {
            let z = (2.0 * i as f32 + 1.0) / POINTS as f32 - 1.0;
            let (round, angle) = ((1.0 - z * z).sqrt(), 2.399_963 * i as f32);
            let r = 1.0 + 0.1 * (5.0 * angle.cos()).sin() * (4.0 * z).cos();
            let [x, y, z] = [
                r * round * angle.cos(),
                2.0 * r * round * angle.sin(),
                if is_open { (3.0 * z).sin() / 9.0 } else { r * z },
            ];
            [x, y, z, (i % 77) as f32].iter().for_each(|c| bytes.extend(c.to_le_bytes()));
        }
        std::fs::write(&path, bytes).unwrap();
        let settings = Settings {
            fineness: Fineness::Given(Resolution::Slices(if is_open { 31 } else { 32 })),
            // Thin slabs, so that there are as many of them as in a larger run.
            surface: SurfaceOptions { slab_slices: Some(8), ..Settings::default().surface },
            open: is_open.then_some(Open::TERRAIN),
            ..Settings::default()
        };
        Case { dir, path, settings }
    }

    /// A run, with the phases that are finished in `work`, if any is given.
    fn run(&self, work: Option<Arc<WorkFolder>>, threads: usize, budget: u64) -> Result<Bits, Error> {
        let input = InputOptions { layout: Some("xyzi".parse().unwrap()), ..InputOptions::default() };
        let cloud = Cloud::open(std::slice::from_ref(&self.path), &input)?;
        let workers = Workers::new(threads)?;
        let mut progress = Progress::new(Show::Nothing);
        let mut surveyed = survey_cloud(&cloud, &self.settings, &workers, 1 << 30, &mut progress)?;
        if work.is_some() {
            surveyed.workload = surveyed.workload.with_work_folder();
        }
        let workspace = Workspace::new(self.dir.path())?;
        if let Some(work) = &work {
            let differs = work.begin(&serde_json::json!({ "cloud": "this" }))?;
            assert_eq!(differs, None);
        }
        let context = Context { work: work.clone(), ..context(&surveyed, &workers, &workspace, budget)? };
        let made = reconstruct(&cloud, &surveyed, &self.settings, &context, &mut progress)?;
        let mut vertices = vec![[0.0; 3]; made.mesh.vertex_count() as usize];
        made.mesh.read_vertices(0, &mut vertices)?;
        let mut values = vec![0.0; vertices.len()];
        made.mesh.read_attribute(0, 0, &mut values)?;
        let mut faces = vec![[0; 3]; made.mesh.face_count() as usize];
        made.mesh.read_faces(0, &mut faces)?;
        assert!(!faces.is_empty());
        if let Some(work) = &work {
            work.settle(false)?;
        }
        let vertices = vertices.iter().map(|v| v.map(f64::to_bits)).collect();
        Ok((vertices, values.iter().map(|value| value.to_bits()).collect(), faces))
    }

    /// A run on a store, until its end or its fault.
    fn run_in(&self, store: &Simulated, threads: usize, budget: u64) -> Result<Bits, Error> {
        let work = Arc::new(WorkFolder::in_store(Arc::new(store.clone()))?);
        self.run(Some(work), threads, budget)
    }

    fn expected(&self) -> Bits {
        self.run(None, 2, AMPLE).unwrap()
    }
}

const AMPLE: u64 = 1 << 30;
const TIGHT: u64 = 64 << 20;

/// Every operation of a run, by the fault that is planted there: what comes out in the end is what a run gives that nothing ends. The number of runs that went on.
fn every_operation(case: &Case, fault: impl Fn(u64) -> Fault, after: &[Crash]) -> u64 {
    let expected = case.expected();
    let store = Simulated::default();
    assert_eq!(case.run_in(&store, 1, AMPLE).unwrap(), expected);
    let (operations, mut resumed) = (store.operations(), 0);
    assert!(operations > 50, "{operations} operations");
    for at in 0..operations {
        let store = Simulated::default();
        store.plant(fault(at));
        match case.run_in(&store, 1, AMPLE) {
            Ok(bits) => assert_eq!(bits, expected, "{:?}", fault(at)),
            Err(error) => assert!(matches!(error, Error::Io { .. }), "{error}"),
        }
        for crash in after {
            // Another budget and other threads go on.
            let found = store.after(*crash);
            let before = found.files();
            let mut bits = case.run_in(&found, 1 + at as usize % 2, [AMPLE, TIGHT][at as usize % 2]);
            // What a power cut tore is set aside, and made again.
            for _ in 0..3 {
                match bits {
                    Err(error) if error.kind() == Kind::Intermediate => bits = case.run_in(&found, 2, AMPLE),
                    _ => break,
                }
            }
            let bits = bits.unwrap_or_else(|error| panic!("{:?}, {crash:?}: {error}\n{before:?}", fault(at)));
            assert_eq!(bits, expected, "{:?}, {crash:?}", fault(at));
            resumed += 1;
        }
    }
    resumed
}

#[test]
#[ignore = "exhaustive"]
fn killed_at_every_operation() {
    let resumed = every_operation(&Case::new(false), Fault::CrashAt, &[Crash::Kill]);
    println!("{resumed} kills");
}

#[test]
#[ignore = "exhaustive"]
fn the_power_is_cut_at_every_operation() {
    let cuts = [Crash::PowerCut(1), Crash::PowerCut(7)];
    let resumed = every_operation(&Case::new(false), Fault::CrashAt, &cuts);
    println!("{resumed} power cuts");
}

#[test]
#[ignore = "exhaustive"]
fn an_open_surface_is_killed_at_every_operation() {
    let resumed = every_operation(&Case::new(true), Fault::CrashAt, &[Crash::Kill]);
    println!("{resumed} kills");
}

#[test]
#[ignore = "exhaustive"]
fn the_disk_breaks_or_is_full_at_every_operation() {
    let case = Case::new(false);
    every_operation(&case, Fault::BrokenAt, &[Crash::Kill]);
    every_operation(&case, Fault::FullFrom, &[Crash::Kill]);
}

/// A run that goes on does not begin anew: it reads what is there.
#[test]
fn what_is_finished_is_not_made_again() {
    let case = Case::new(false);
    let store = Simulated::default();
    case.run_in(&store, 1, AMPLE).unwrap();
    let files = store.files();
    let again = store.after(Crash::Kill);
    case.run_in(&again, 2, TIGHT).unwrap();
    assert_eq!(again.files(), files);
}

/// Whatever bit of whatever file has changed: it is told, and made again, or nothing depends on it.
#[test]
fn damaged_files_are_found_and_made_again() {
    let case = Case::new(false);
    let expected = case.expected();
    let store = Simulated::default();
    case.run_in(&store, 1, AMPLE).unwrap();
    let (mut told, mut quiet) = (0, 0);
    for (name, length) in store.files() {
        for place in [0, length / 3, length / 2, length - 1] {
            let damaged = store.after(Crash::Kill);
            damaged.damage(&name, place);
            let mut outcome = case.run_in(&damaged, 2, AMPLE);
            if name == "job.json" {
                // Whose run it is cannot be told any more.
                let error = outcome.unwrap_err();
                assert!(error.to_string().contains("job.json") && error.kind() == Kind::Usage, "{error}");
                continue;
            }
            match &outcome {
                Ok(_) => quiet += 1,
                Err(error) => {
                    assert_eq!(error.kind(), Kind::Intermediate, "{name} {place}: {error}");
                    assert!(error.to_string().contains("damaged"), "{error}");
                    told += 1;
                    outcome = case.run_in(&damaged, 2, AMPLE);
                }
            }
            assert_eq!(outcome.unwrap(), expected, "{name} {place}");
        }
    }
    assert!(told > 8, "{told} told, {quiet} not");
}

#[test]
fn a_folder_is_one_runs_and_of_one_job() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.work");
    let first = WorkFolder::open(&path).unwrap();
    let error = WorkFolder::open(&path).unwrap_err();
    assert!(error.to_string().contains(&format!("process {}", std::process::id())), "{error}");
    assert_eq!(error.kind(), Kind::Temporary);
    let job = |fit: &str, length: u64| serde_json::json!({ "fit": fit, "inputs": { "a.laz": { "bytes": length } }, "grid": [length, 2] });
    assert_eq!(first.begin(&job("plane", 5)).unwrap(), None);
    drop(first);
    let second = WorkFolder::open(&path).unwrap();
    assert_eq!(second.begin(&job("plane", 5)).unwrap(), None);
    let differs = second.begin(&job("none", 5)).unwrap().unwrap();
    assert_eq!((differs.at.as_str(), differs.there.as_str(), differs.here.as_str()), ("fit", "\"plane\"", "\"none\""));
    assert_eq!(second.begin(&job("plane", 6)).unwrap().unwrap().at, "inputs.a.laz.bytes");
    second.finish("output").unwrap();
    assert!(!path.exists(), "nothing stays of a run that is finished");

    // What is not a run's is left alone.
    let other = dir.path().join("other");
    std::fs::create_dir(&other).unwrap();
    std::fs::write(other.join("mine.txt"), "mine").unwrap();
    assert_eq!(WorkFolder::open(&other).unwrap_err().kind(), Kind::Usage);
    assert_eq!(WorkFolder::open(&other.join("mine.txt")).unwrap_err().kind(), Kind::Usage);
    assert!(["lock", "job.json", "done", "data"].iter().all(|name| !other.join(name).exists()));
}
