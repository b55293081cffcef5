//! Tasks give the bytes of one run: by any number of processes, in any order, done again and again, with files that are damaged meanwhile.

// Tests read folders that nobody makes fail.
#![allow(clippy::disallowed_methods)]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use asra_stream::internals::error::{Error, Kind};
use asra_stream::internals::resources::workers::Workers;
use asra_stream::internals::run::progress::{Progress, Show};
use asra_stream::internals::run::tasks::{Command, State, Task, Tasks, plan_tasks};
use asra_stream::internals::run::{Job, Resources, run};
use asra_stream::internals::settings::open::Open;
use asra_stream::internals::settings::simplification::{Simplification, Tolerance};
use asra_stream::internals::settings::surface::SurfaceOptions;
use asra_stream::internals::settings::{Fineness, Resolution, Settings};
use asra_stream::internals::storage::work::WorkFolder;

/// A row of numbers that look random.
struct Chance(u64);

impl Chance {
    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((self.0 >> 33) % count as u64) as usize
    }
}

/// A cloud in a file, and what is made of it.
struct Case {
    dir: tempfile::TempDir,
    job: Job,
}

impl Case {
    /// A long body with waves, or the ground below it, with noise that makes some seams dirty; points have an attribute. The one that is `holed` has a hole that reaches through several slabs.
    fn new(name: &str) -> Case {
        let (is_open, is_text) = (name == "ground", name == "text");
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(if is_text { "cloud.xyz" } else { "cloud.bin" });
        let (mut bytes, mut text, mut chance) = (Vec::new(), String::new(), Chance(7));
        for i in 0..90_000 {
            let z = (2.0 * i as f32 + 1.0) / 90_000.0 - 1.0;
            let (round, angle) = ((1.0 - z * z).sqrt(), 2.399_963 * i as f32);
            let noise = (chance.below(1000) as f32 / 1000.0 - 0.5) * if i % 3 == 0 { 0.1 } else { 0.01 };
            let r = 1.0 + noise + 0.1 * (5.0 * angle.cos()).sin() * (4.0 * z).cos();
            let height = if is_open { (3.0 * z).sin() / 9.0 + 9.0 * noise } else { r * z };
            if name == "holed" && z > 0.8 {
                continue;
            }
            let point = [r * round * angle.cos(), 2.0 * r * round * angle.sin(), height, (i % 77) as f32];
            point.iter().for_each(|c| bytes.extend(c.to_le_bytes()));
            text += &format!("{} {} {}\n", 4e6 + f64::from(point[0]), point[1], point[2]);
        }
        if is_text { std::fs::write(&path, text) } else { std::fs::write(&path, bytes) }.unwrap();
        let mut job = Job::new([path]);
        job.input.layout = (!is_text).then(|| "xyzi".parse().unwrap());
        job.settings = Settings {
            fineness: Fineness::Given(Resolution::Slices(150)),
            open: is_open.then_some(Open::TERRAIN),
            bridged: name == "bridged",
            surface: SurfaceOptions { slab_slices: Some(12), ..Settings::default().surface },
            ..Settings::default()
        };
        if name == "simplified" {
            job.settings.simplify = Some(Simplification::within(Tolerance::Cells(0.3)));
        }
        job.resources = Resources { threads: Some(2), ..Resources::default() };
        Case { dir, job }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// The mesh of one run.
    fn expected(&self) -> Vec<u8> {
        let job = Job { output: Some(self.path("plain.ply")), ..self.job.clone() };
        run(&job, &Workers::new(2).unwrap(), &mut Progress::new(Show::Nothing)).unwrap();
        std::fs::read(self.path("plain.ply")).unwrap()
    }

    /// The job of tasks, and their folder.
    fn of_tasks(&self, processes: usize) -> (Job, PathBuf) {
        let work = self.path("work");
        let resources = Resources { work: Some(work.clone()), ..self.job.resources.clone() };
        let job = Job { output: Some(self.path("tasks.ply")), resources, ..self.job.clone() };
        let command = Command { words: Vec::new(), folder: PathBuf::new() };
        plan_tasks(&job, &command, processes, &Workers::new(1).unwrap(), &mut Progress::new(Show::Nothing)).unwrap();
        (job, work)
    }
}

fn opened(work: &Path, job: &Job) -> Tasks {
    Tasks::of(WorkFolder::shared(work).unwrap(), job.clone(), Path::new("")).unwrap()
}

/// Does a task with a number of threads and a budget that chance decides.
fn perform(tasks: &Tasks, task: Task, chance: &mut Chance) -> Result<(), Error> {
    let threads = 1 + chance.below(3);
    let resources = Resources {
        threads: Some(threads),
        max_memory: Some([64, 128, 1024][chance.below(3)] << 20),
        ..Resources::default()
    };
    tasks.perform(task, &resources, &Workers::new(threads)?, &mut Progress::new(Show::Nothing)).map(drop)
}

fn ready(tasks: &Tasks) -> Vec<Task> {
    tasks.states().unwrap().into_iter().filter(|task| task.state == State::Ready).map(|task| task.task).collect()
}

/// Does whatever is ready, in an order that chance decides, until all is done; now and then again what is done.
fn work(folder: &Path, job: &Job, seed: u64, done: &Mutex<BTreeSet<Task>>) {
    let (tasks, mut chance) = (opened(folder, job), Chance(seed));
    loop {
        let states = tasks.states().unwrap();
        if states.iter().all(|task| task.state == State::Done) {
            return;
        }
        let any = chance.below(4) == 0;
        let some: Vec<Task> = states
            .iter()
            .filter(|task| task.state == State::Ready || any && task.state == State::Done)
            .map(|task| task.task)
            .collect();
        if some.is_empty() {
            continue;
        }
        let task = some[chance.below(some.len())];
        // Others may do the same at the same time.
        perform(&tasks, task, &mut chance).unwrap();
        done.lock().unwrap().insert(task);
    }
}

#[test]
#[ignore = "exhaustive"]
fn any_processes_in_any_order_make_the_mesh_of_one_run() {
    let mut bridges = 0;
    for (seed, name) in (1..).zip(["closed", "ground", "text", "bridged", "simplified", "holed"]) {
        let case = Case::new(name);
        let expected = case.expected();
        let (job, folder) = case.of_tasks(1 + seed as usize);
        let done = Mutex::default();
        std::thread::scope(|scope| {
            for number in 0..3 {
                let (job, folder, done) = (&job, &folder, &done);
                scope.spawn(move || work(folder, job, 10 * seed + number, done));
            }
        });
        assert!(std::fs::read(case.path("tasks.ply")).unwrap() == expected, "{name}: other bytes");
        let done: BTreeSet<Task> = done.into_inner().unwrap();
        bridges += done.iter().filter(|task| matches!(task, Task::Bridge(_))).count();
        assert!(done.iter().any(|task| matches!(task, Task::Piece(1..))), "{name}: one piece only");
        // Once more, when all is there: nothing is done, and nothing changes.
        let before = std::fs::metadata(case.path("tasks.ply")).unwrap().modified().unwrap();
        done.iter().for_each(|task| perform(&opened(&folder, &job), *task, &mut Chance(1)).unwrap());
        assert_eq!(std::fs::metadata(case.path("tasks.ply")).unwrap().modified().unwrap(), before);
        // What is not needed any more goes, but what is known of tasks stays.
        opened(&folder, &job).clean().unwrap();
        assert_eq!(std::fs::read_dir(folder.join("data")).unwrap().count(), 0);
        assert!(ready(&opened(&folder, &job)).is_empty());
    }
    assert!(bridges > 0, "no seam between pieces was dirty");
}

#[test]
fn what_is_damaged_is_made_again() {
    let case = Case::new("holed");
    let expected = case.expected();
    let (job, folder) = case.of_tasks(2);
    let tasks = opened(&folder, &job);
    let mut chance = Chance(5);
    let mut damaged = BTreeSet::new();
    while let Some(task) = ready(&tasks).first().copied() {
        // Before each task, the files of one of those before it are damaged, each once.
        let all = std::fs::read_dir(folder.join("data")).unwrap().map(|entry| entry.unwrap().path());
        let kind = |path: &Path| path.file_stem().unwrap().to_str().unwrap().to_owned();
        let mut whole: Vec<PathBuf> =
            all.filter(|path| !damaged.contains(&kind(path)) && path.metadata().unwrap().len() > 0).collect();
        whole.sort();
        if !whole.is_empty() {
            let path = whole.swap_remove(chance.below(whole.len()));
            let mut bytes = std::fs::read(&path).unwrap();
            let at = chance.below(bytes.len());
            bytes[at] ^= 16;
            std::fs::write(&path, bytes).unwrap();
            damaged.insert(kind(&path));
        }
        match perform(&tasks, task, &mut chance) {
            Ok(()) => {}
            Err(error) => assert_eq!(error.kind(), Kind::Intermediate, "{task}: {error}"),
        }
    }
    assert!(damaged.len() > 8, "{damaged:?}");
    assert!(std::fs::read(case.path("tasks.ply")).unwrap() == expected, "other bytes");
}

#[test]
fn what_is_not_there_yet_is_told() {
    let case = Case::new("closed");
    let (job, folder) = case.of_tasks(2);
    let tasks = opened(&folder, &job);
    let error = perform(&tasks, Task::Close, &mut Chance(1)).unwrap_err();
    assert_eq!(error.kind(), Kind::NotReady);
    assert!(error.to_string().contains("close needs bucket/0, which is not done yet"), "{error}");
    let error = perform(&tasks, Task::Piece(99), &mut Chance(1)).unwrap_err();
    assert_eq!(error.kind(), Kind::Usage);
    // An input that has changed.
    let path = job.inputs[0].clone();
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[12] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let error = perform(&tasks, Task::Bucket(0), &mut Chance(1)).unwrap_err();
    assert!(matches!(error, Error::Changed { .. }), "{error}");
}

/// Tiles of a long body or of the ground below it, by slices; each may be written anew.
struct Tiles {
    case: Case,
    all: Vec<[f32; 4]>,
}

const TILES: usize = 6;

impl Tiles {
    fn new(name: &str) -> Tiles {
        let mut case = Case::new(name);
        let bytes = std::fs::read(&case.job.inputs[0]).unwrap();
        let number = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
        let points = bytes.chunks_exact(16).map(|point| [0, 4, 8, 12].map(|at| number(&point[at..at + 4])));
        let mut all: Vec<[f32; 4]> = points.collect();
        // The slices lie along the longest side.
        all.sort_by(|a, b| a[1].total_cmp(&b[1]));
        case.job.inputs = vec![case.path("tiles")];
        std::fs::create_dir(case.path("tiles")).unwrap();
        let tiles = Tiles { case, all };
        (0..TILES).for_each(|number| tiles.write(number, Some));
        tiles
    }

    fn path(&self, number: usize) -> PathBuf {
        self.case.path(&format!("tiles/{number}.bin"))
    }

    /// Writes a tile with what becomes of each of its points.
    fn write(&self, number: usize, change: impl Fn([f32; 4]) -> Option<[f32; 4]>) {
        let size = self.all.len() / TILES;
        let points = self.all[number * size..(number + 1) * size].iter().filter_map(|point| change(*point));
        let bytes: Vec<u8> = points.flatten().flat_map(f32::to_le_bytes).collect();
        std::fs::write(self.path(number), bytes).unwrap();
    }

    /// Plans anew, does what is to be done, and compares with a run; tells what there was to do, and the pieces that were made again.
    fn updated(&self) -> (BTreeSet<String>, usize) {
        let pieces = |folder: &Path| -> BTreeSet<String> {
            let names = std::fs::read_dir(folder.join("data")).into_iter().flatten();
            let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
            names.filter(|name| name.starts_with("vertices-piece")).collect()
        };
        let before = pieces(&self.case.path("work"));
        let (job, folder) = self.case.of_tasks(3);
        let first: BTreeSet<String> = ready(&opened(&folder, &job)).iter().map(Task::to_string).collect();
        work(&folder, &job, 3, &Mutex::default());
        let job = Job { output: Some(self.case.path("plain.ply")), ..self.case.job.clone() };
        let job = Job { overwrite: asra_stream::internals::storage::atomic_file::Overwrite::Replace, ..job };
        run(&job, &Workers::new(2).unwrap(), &mut Progress::new(Show::Nothing)).unwrap();
        let [tasks, plain] = ["tasks.ply", "plain.ply"].map(|name| std::fs::read(self.case.path(name)).unwrap());
        assert!(tasks == plain, "other bytes");
        (first, pieces(&folder).difference(&before).count())
    }
}

#[test]
fn of_a_changed_input_what_it_touches_is_made_again() {
    for name in ["closed", "ground"] {
        let tiles = Tiles::new(name);
        let (first, all) = tiles.updated();
        assert_eq!(first.len(), 3, "{first:?}");
        // Other attributes, and then other places, of some points of a tile.
        tiles.write(4, |[x, y, z, i]| Some([x, y, z, if i == 5.0 { 6.0 } else { i }]));
        let (first, made) = tiles.updated();
        assert_eq!(first, ["bucket/2".to_owned()].into(), "{name}");
        assert!(made > 0 && made < all, "{name}: {made} of {all} pieces for a tile of {TILES}");
        // Two points that are near each other have each other's: the same numbers, but for whose they are.
        let [a, b] = [4, 5].map(|number| tiles.all[4 * tiles.all.len() / TILES + number]);
        assert!(a[3] != b[3]);
        tiles.write(4, |point| match point {
            _ if point == a => Some([a[0], a[1], a[2], b[3]]),
            _ if point == b => Some([b[0], b[1], b[2], a[3]]),
            [x, y, z, i] => Some([x, y, z, if i == 5.0 { 6.0 } else { i }]),
        });
        assert!(tiles.updated().1 > 0, "{name}: attributes that were exchanged");
        tiles.write(1, |[x, y, z, i]| Some([x, y, if i == 7.0 { 1.01 * z } else { z }, i]));
        let (first, made) = tiles.updated();
        assert_eq!(first, ["bucket/0".to_owned()].into(), "{name}");
        assert!(made > 0 && made <= all, "{name}");
        if name == "ground" {
            // Columns are read as slices are; the rest is the same.
            continue;
        }
        // A file that only looks changed.
        tiles.write(3, Some);
        let (first, made) = tiles.updated();
        assert_eq!((first, made), (["bucket/1".to_owned()].into(), 0), "{name}");
        // Fewer points, and none of them at the box; then a file that is gone, and one that is new.
        let is_inside = |[x, _, z, _]: [f32; 4]| (0.3..0.8).contains(&x.abs()) && z.abs() < 0.8;
        tiles.write(2, |point| (point[3] < 70.0 || !is_inside(point)).then_some(point));
        let (first, made) = tiles.updated();
        assert_eq!(first, ["bucket/1".to_owned()].into(), "{name}");
        assert!(made > 0 && made <= all, "{name}");
        std::fs::rename(tiles.path(3), tiles.case.path("tiles/3b.bin")).unwrap();
        let (first, made) = tiles.updated();
        assert_eq!((first, made), (["bucket/1".to_owned()].into(), 0), "{name}: another name for the same points");
        // The box of all points: nothing stays.
        tiles.write(5, |[x, y, z, i]| Some([x, 1.1 * y, z, i]));
        let (first, made) = tiles.updated();
        assert_eq!((first.len(), made), (3, all), "{name}");
    }
}
