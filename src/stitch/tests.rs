//! Seams that are said to be clean come out the same where stitching begins at them; and what must not move does not, with all that would have moved with it.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use proptest::prelude::*;

use super::*;
use crate::grid::bucket::Buckets;
use crate::grid::context::Context;
use crate::grid::occupancy::{Counted, Occupancy, Sampled};
use crate::grid::partition::{Slabs, halo, slab_count};
use crate::input::{Carried, Cloud, InputOptions};
use crate::points::Precision;
use crate::points::attribute::{Schema, Wanted};
use crate::resources::memory::SlabJobs;
use crate::resources::workers::{Spares, Workers};
use crate::run::pipeline::context;
use crate::run::progress::{Progress, Show};
use crate::run::surveyed::survey_cloud;
use crate::settings::open::Open;
use crate::settings::surface::{Fit, SurfaceOptions};
use crate::settings::{Fineness, Resolution, Settings};
use crate::solid::close::{ClosingOptions, close, close_below};
use crate::stitch::apart::{self, Apart, Chain, Link, Of};
use crate::stitch::checkpoint::Checkpoint;
use crate::stitch::make::Making;
use crate::stitch::pieces::{self, Means};
use crate::storage::spool::Workspace;
use crate::surface::untangle::step_back;
use crate::surface::untangle::submesh::Submesh;

mod certificate;

const FRAME: Frame = Frame { origin: [0.0; 3], precision: Precision::Single };

/// Slabs after the seams below and above them were closed, and how these were.
struct Closed {
    slabs: Vec<SlabMesh<f32>>,
    seams: Vec<SeamReport>,
}

/// A box with points in it, and on a wavy surface through it.
fn points(seed: u64, count: usize, in_volume: f64) -> Vec<[f32; 3]> {
    let mut state = seed | 1;
    let mut number = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    let mut point = || {
        let [x, y, z, choice] = [(); 4].map(|()| number());
        if f64::from(choice) < in_volume { [x, y, z] } else { [x, y, 0.5 + 0.1 * (9.0 * x).sin() * (7.0 * y).cos()] }
    };
    (0..count).map(|_| point()).collect()
}

/// A cloud and what is asked of its surface.
#[derive(Debug, Clone)]
struct Case {
    points: Vec<[f32; 3]>,
    /// Whether each point has an attribute, too: its number.
    numbered: bool,
    settings: Settings,
}

impl Case {
    fn new(points: Vec<[f32; 3]>, slices: u32, smooth: u32) -> Case {
        let settings = Settings { fineness: Fineness::Given(Resolution::Slices(slices)), ..Settings::default() };
        let surface = SurfaceOptions { smooth, fit: Fit::Facets, ..settings.surface };
        Case { points, numbered: false, settings: Settings { surface, ..settings } }
    }
}

/// What `work` makes of a cloud's slabs.
fn with_slabs<R>(case: &Case, work: impl FnOnce(&Grid, &Making<'_, f32>, &Context, &Schema) -> R) -> R {
    let Case { points, numbered, settings } = case;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cloud.bin");
    let mut bytes = Vec::new();
    for (number, point) in (0u32..).zip(points) {
        bytes.extend(point.iter().flat_map(|c| c.to_le_bytes()));
        bytes.extend(number.to_le_bytes().into_iter().filter(|_| *numbered));
    }
    std::fs::write(&path, bytes).unwrap();
    let layout = if *numbered { "xyz,number:u32" } else { "xyz" };
    let input = InputOptions {
        layout: Some(layout.parse().unwrap()),
        attributes: if *numbered { Wanted::All } else { Wanted::default() },
        ..InputOptions::default()
    };
    let cloud = Cloud::open(&[path], &input).unwrap();
    assert_eq!(cloud.schema().stride(), if *numbered { 4 } else { 0 });
    let workers = Workers::new(1).unwrap();
    let surveyed = survey_cloud(&cloud, settings, &workers, 1 << 30, &mut Progress::new(Show::Nothing)).unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let context = context(&surveyed, &workers, &workspace, 1 << 30).unwrap();
    let grid = &surveyed.grid;
    let buckets = Buckets::<f32>::fill((&cloud, None, Carried::Attributes), grid, &context, |_| ()).unwrap();
    let occupancy = Occupancy::of_buckets(&buckets, grid, 1, &context, |_| ()).unwrap();
    let options =
        ClosingOptions { seal: settings.seal, window: None, keep_outliers: true, min_component: None, rough: false };
    let closed = match settings.open {
        None => close(occupancy, grid.cell_size(), options, &context, |_, _| ()).unwrap(),
        Some(open) => {
            let smooth = settings.surface.smooth;
            close_below(occupancy, (&buckets, grid), &open, options, smooth, &context, |_, _| ()).unwrap()
        }
    };
    let sampled = Sampled { buckets: &buckets, occupied: &closed.occupancy.store, grid, counted: Counted::All };
    let jobs = SlabJobs { running: 2, ahead: 0, points_held: 1 << 20, pieces: 1, gives_back: false };
    work(
        grid,
        &Making {
            solid: &closed.solid,
            membranes: closed.membranes.as_ref(),
            sampled: &sampled,
            options: settings.surface,
            frame: FRAME,
            jobs,
            told: None,
        },
        &context,
        cloud.schema(),
    )
}

/// Stitches each range of slabs by itself; `ranges` is given the number of slabs.
fn stitched(case: &Case, ranges: impl Fn(u32) -> Vec<Range<u32>>) -> Vec<Closed> {
    with_slabs(case, |grid, making, context, _| {
        let smooth = making.options.smooth;
        let stitch = |range: Range<u32>| {
            let mesh = MeshSpool::new(&context.workspace, Precision::Single, context.memory.mesh_quota);
            let mut stitcher = Stitcher::new(grid, halo(smooth), FRAME, mesh, false);
            let mut slabs = Vec::new();
            for number in range {
                let slab = SlabMesh::make(number, making, SlabMesh::default()).unwrap();
                slabs.extend(stitcher.add(slab).unwrap());
            }
            slabs.extend(stitcher.waiting.take());
            Closed { slabs, seams: stitcher.seams }
        };
        ranges(slab_count(Slabs::of(&making.options), grid.cells()[1])).into_iter().map(stitch).collect()
    })
}

/// What comes of stitching: vertices, attributes and triangles as they are written.
#[derive(Debug, Clone, PartialEq)]
struct Written {
    vertices: Vec<u8>,
    attributes: Vec<u8>,
    faces: Vec<[u32; 3]>,
    counts: Counts,
    seams: Vec<SeamReport>,
}

fn written(stitched: &Stitched) -> Written {
    let Stitched { mesh, counts, seams } = stitched;
    let (count, stride) = (mesh.vertex_count() as usize, mesh.schema().stride());
    let (mut vertices, mut attributes) = (vec![0; 12 * count], vec![0; stride * count]);
    mesh.read_vertex_bytes(0, &mut vertices).unwrap();
    mesh.read_records(0, &mut attributes).unwrap();
    let mut faces = vec![[0; 3]; mesh.face_count() as usize];
    mesh.read_faces(0, &mut faces).unwrap();
    Written { vertices, attributes, faces, counts: *counts, seams: seams.clone() }
}

/// The slabs of a case, each made once, and what stitches them.
struct Stitching<'a> {
    grid: &'a Grid,
    context: &'a Context,
    schema: &'a Schema,
    smooth: u32,
    trimmed: bool,
    slabs: Vec<SlabMesh<f32>>,
}

impl Stitching<'_> {
    fn of<R>(case: &Case, work: impl FnOnce(&Stitching<'_>) -> R) -> R {
        with_slabs(case, |grid, making, context, schema| {
            let trimmed = making.solid.ground.as_ref().is_some_and(|ground| ground.trimmed);
            assert_eq!(trimmed, case.settings.open.is_some_and(|open| open.base.is_none()));
            let count = slab_count(Slabs::of(&making.options), grid.cells()[1]);
            let slabs = (0..count).map(|number| SlabMesh::make(number, making, SlabMesh::default()).unwrap());
            work(&Stitching { grid, context, schema, smooth: making.options.smooth, trimmed, slabs: slabs.collect() })
        })
    }

    fn stitcher(&self, from: &Checkpoint) -> Stitcher<'_, f32> {
        let mesh = MeshSpool::with_attributes(&self.context.workspace, Precision::Single, self.schema.clone(), 1 << 30);
        Stitcher::resumed(self.grid, halo(self.smooth), FRAME, mesh, self.trimmed, from)
    }

    /// Stitches from a checkpoint on, and gives those that come.
    fn run(&self, from: &Checkpoint) -> (Written, Vec<Checkpoint>) {
        let mut checkpoints = Vec::new();
        let mut stitcher = self.stitcher(from);
        for number in stitcher.next()..self.slabs.len() as u32 {
            assert_eq!(stitcher.next(), number);
            stitcher.add(self.slabs[number as usize].clone()).unwrap();
            checkpoints.extend(stitcher.checkpoint());
        }
        (written(&stitcher.finish().unwrap()), checkpoints)
    }

    /// What is written of the whole after a checkpoint.
    fn rest(&self, whole: &Written, checkpoint: &Checkpoint) -> Written {
        let (vertices, faces) = (checkpoint.vertices as usize, checkpoint.faces as usize);
        Written {
            vertices: whole.vertices[12 * vertices..].to_vec(),
            attributes: whole.attributes[self.schema.stride() * vertices..].to_vec(),
            faces: whole.faces[faces..].to_vec(),
            ..whole.clone()
        }
    }

    /// Whether from a checkpoint on all comes out as it did, and with numbers of its own, too.
    fn is_same_from(&self, checkpoint: &Checkpoint, whole: &Written, later: &[Checkpoint]) -> bool {
        let rest = self.rest(whole, checkpoint);
        let (again, checkpoints) = self.run(checkpoint);
        let (alone, _) = self.run(&Checkpoint::at(checkpoint.slab));
        let based = |triangle: &[u32; 3]| triangle.map(|v| v.wrapping_add(checkpoint.vertices as u32));
        again == rest
            && checkpoints == later
            && alone.vertices == rest.vertices
            && alone.attributes == rest.attributes
            && alone.faces.iter().map(based).eq(rest.faces)
            && alone.seams == whole.seams[checkpoint.slab as usize..]
    }

    /// Stitches pieces of the ranges, which give up after so many seams, with slabs that `make` makes.
    fn in_pieces(
        &self,
        (ranges, tries): (&[Range<u32>], u32),
        workers: &Workers,
        make: &(dyn Fn(u32) -> Result<SlabMesh<f32>> + Sync),
    ) -> Result<Written> {
        let taken = Mutex::new(Vec::new());
        let means = Means {
            workers,
            in_flight: 2,
            tries,
            stitcher: &|_, from| self.stitcher(from),
            make,
            taken: &|number, _| taken.lock().unwrap().push(number),
            spares: &Spares::default(),
        };
        let stitched = pieces::stitch(ranges, &means)?;
        let mut taken = taken.into_inner().unwrap();
        taken.sort_unstable();
        assert!(taken.into_iter().eq(0..self.slabs.len() as u32), "each slab is told of once");
        Ok(written(&stitched))
    }

    /// The mesh of pieces that are made apart from each other, and the bridges that it needed.
    fn apart(&self, ranges: &[Range<u32>], workers: &Workers) -> (Written, usize) {
        let slabs = self.slabs.len() as u32;
        let means = Means {
            workers,
            in_flight: 2,
            tries: u32::MAX,
            stitcher: &|_, from| self.stitcher(from),
            make: &|number| self.slab(number),
            taken: &|_, _| (),
            spares: &Spares::default(),
        };
        let (mut meshes, pieces): (Vec<MeshSpool>, Vec<Apart>) =
            ranges.iter().map(|range| apart::piece(range.clone(), slabs, &means).unwrap()).unzip();
        let mut records = BTreeMap::new();
        let mut bridges = BTreeMap::new();
        for from in apart::bridges(&pieces) {
            assert!(apart::chain(&pieces, &records).unwrap().is_none() || !records.is_empty());
            let (mesh, bridge) = apart::bridge(from, &pieces, slabs, &means).unwrap();
            let text = serde_json::to_string(&bridge).unwrap();
            assert_eq!(serde_json::from_str::<Apart>(&text).unwrap(), bridge);
            bridges.insert(from, mesh);
            records.insert(from, bridge);
        }
        let Chain { links, counts, seams } = apart::chain(&pieces, &records).unwrap().unwrap();
        let mut whole: Option<MeshSpool> = None;
        for Link { of, within } in links {
            let mesh = match of {
                Of::Piece(number) => {
                    std::mem::replace(&mut meshes[number], self.stitcher(&Checkpoint::at(0)).mesh.mesh)
                }
                Of::Bridge(number) => bridges.remove(&number).unwrap(),
            };
            let mesh = mesh.within(within);
            match &mut whole {
                Some(whole) => whole.join(mesh),
                None => whole = Some(mesh),
            }
        }
        (written(&Stitched { mesh: whole.unwrap(), counts, seams }), records.len())
    }

    fn slab(&self, number: u32) -> Result<SlabMesh<f32>> {
        Ok(self.slabs[number as usize].clone())
    }
}

/// Clouds of all kinds, some of them noisy, with slabs of so many slices, or the usual ones.
fn cases(seeds: Range<u64>, slab_slices: Option<u32>) -> impl Iterator<Item = Case> {
    let kinds = seeds.flat_map(|seed| (0..4).map(move |kind| (seed, kind)));
    kinds.map(move |(seed, kind)| {
        let count = 1200 + 500 * (seed % 5) as usize;
        let cloud = points(0xA076_1D64_78BD_642F ^ seed << 3, count, 0.2 * (seed % 4) as f64);
        let slices = if slab_slices.is_some() { 24 + 5 * (seed % 4) as u32 } else { 62 + 7 * (seed % 4) as u32 };
        let mut case = Case::new(cloud, slices, (seed % 3) as u32);
        case.numbered = kind % 2 == 1;
        case.settings.open = (kind >= 2).then_some(Open::TERRAIN);
        case.settings.surface.slab_slices = slab_slices;
        case
    })
}

#[test]
#[ignore = "exhaustive"]
fn from_a_clean_seam_on_all_is_written_as_in_one_run() {
    let (mut clean, mut changed, mut all) = (0, 0, 0);
    for slab_slices in [None, Some(8), Some(12), Some(16)] {
        for case in cases(0..5, slab_slices) {
            Stitching::of(&case, |stitching| {
                let (whole, checkpoints) = stitching.run(&Checkpoint::at(0));
                let is_clean = |k: &u32| whole.seams[*k as usize - 1].clean;
                assert!(checkpoints.iter().map(|c| c.slab).eq((1..stitching.slabs.len() as u32).filter(is_clean)));
                for (number, checkpoint) in checkpoints.iter().enumerate() {
                    let text = serde_json::to_string(checkpoint).unwrap();
                    assert_eq!(serde_json::from_str::<Checkpoint>(&text).unwrap(), *checkpoint);
                    let later = &checkpoints[number..];
                    assert!(stitching.is_same_from(checkpoint, &whole, later), "{case:?}, from {checkpoint:?}");
                }
                all += whole.seams.len();
                clean += checkpoints.len();
                changed += whole.seams.iter().filter(|seam| seam.clean && seam.changed.is_some()).count();
            });
        }
    }
    assert!(clean > 100 && changed > 50, "{clean} of {all} are clean, {changed} of them changed something");
    assert!(clean < all - 50, "{clean} of {all} are clean");
}

/// Whatever slabs pieces begin with that know nothing of each other, all is written as by one.
#[test]
#[ignore = "exhaustive"]
fn pieces_that_are_made_apart_give_one_mesh() {
    let workers = Workers::new(2).unwrap();
    let (mut sets, mut bridges) = (0, 0);
    for slab_slices in [None, Some(8), Some(12)] {
        for case in cases(24..26, slab_slices) {
            Stitching::of(&case, |stitching| {
                let (whole, _) = stitching.run(&Checkpoint::at(0));
                let count = stitching.slabs.len() as u32;
                let every = |n: u32| (1..count).filter(|k| k % n == 0).collect::<Vec<u32>>();
                for boundaries in [every(1), every(2), every(3), every(5), vec![]] {
                    let starts: Vec<u32> = std::iter::once(0).chain(boundaries).collect();
                    let ends = starts[1..].iter().copied().chain([count]);
                    let ranges: Vec<Range<u32>> = starts.iter().copied().zip(ends).map(|(from, to)| from..to).collect();
                    let (apart, needed) = stitching.apart(&ranges, &workers);
                    assert_eq!(apart, whole, "{case:?}, {ranges:?}");
                    (sets, bridges) = (sets + 1, bridges + needed);
                }
            });
        }
    }
    assert!(bridges > sets / 2, "{bridges} bridges of {sets} sets");
}

/// Whatever slabs pieces begin with, all is written as by one.
#[test]
#[ignore = "exhaustive"]
fn all_sets_of_boundaries_give_one_mesh() {
    let workers = Workers::new(2).unwrap();
    let (mut sets, mut dirty) = (0, 0);
    for (slab_slices, seed) in [(None, 5), (Some(4), 6), (Some(8), 5), (Some(12), 6)] {
        for case in cases(seed..seed + 1, slab_slices) {
            Stitching::of(&case, |stitching| {
                let (whole, _) = stitching.run(&Checkpoint::at(0));
                let count = stitching.slabs.len() as u32;
                // All of them where they are few, else each by itself, and some.
                let masks: Vec<u32> = match count - 1 {
                    few @ 0..=5 => (0..1 << few).collect(),
                    many => (0..many)
                        .map(|bit| 1 << bit)
                        .chain((0..20).map(|i| 0x9E37_79B9u32.wrapping_mul(i) >> (33 - many)))
                        .collect(),
                };
                for mask in masks {
                    let starts = (1..count).filter(|k| mask >> (k - 1) & 1 == 1);
                    let starts: Vec<u32> = std::iter::once(0).chain(starts).chain([count]).collect();
                    let ranges: Vec<Range<u32>> = starts.windows(2).map(|pair| pair[0]..pair[1]).collect();
                    dirty += ranges[1..].iter().filter(|range| !whole.seams[range.start as usize - 1].clean).count();
                    for tries in [1, u32::MAX] {
                        sets += 1;
                        let of = (&ranges[..], tries);
                        let found = stitching.in_pieces(of, &workers, &|number| stitching.slab(number)).unwrap();
                        assert!(found == whole, "{case:?}, {ranges:?}, {tries}");
                    }
                }
            });
        }
    }
    assert!(sets > 100 && dirty > 50, "{sets} sets, {dirty} dirty boundaries in them");
}

/// A piece none of whose first seams is clean gives up, and hardly a slab is made in vain.
#[test]
#[ignore = "exhaustive"]
fn a_piece_in_vain_gives_up() {
    const TRIES: u32 = 2;
    let workers = Workers::new(2).unwrap();
    let (mut in_vain, mut saved) = (0, 0);
    // A closed surface, and one that is open and has attributes.
    for mut case in cases(5..6, Some(8)).step_by(3) {
        case.settings.fineness = Fineness::Given(Resolution::Slices(128));
        Stitching::of(&case, |stitching| {
            let (whole, _) = stitching.run(&Checkpoint::at(0));
            let count = stitching.slabs.len() as u32;
            // The seam at which it begins is not clean for the lower piece, none of the others for the upper one.
            for start in (1..count).filter(|start| !whole.seams[*start as usize - 1].clean) {
                let ranges = [0..start, start..count];
                let made = |tries: u32| {
                    let made = AtomicUsize::new(0);
                    let make = |number: u32| {
                        made.fetch_add(1, Ordering::Relaxed);
                        stitching.slab(number)
                    };
                    assert!(stitching.in_pieces((&ranges, tries), &workers, &make).unwrap() == whole);
                    made.into_inner()
                };
                let (of_upper, clean) = stitching.run(&Checkpoint::at(start));
                let is_dirty = clean.iter().all(|one| one.slab <= start);
                if is_dirty && of_upper.seams.len() > TRIES as usize + 4 {
                    // The two slabs of the first seam, and one for each of the others.
                    let most = count as usize + TRIES as usize + 2;
                    let with = made(TRIES);
                    assert!(with <= most, "from {start} of {count}: {with} made");
                    in_vain += 1;
                    saved += made(u32::MAX) - with;
                }
            }
        });
    }
    assert!(in_vain > 2 && saved > in_vain, "{in_vain} in vain, {saved} saved");
}

/// Of errors, that of the lowest slab is told; panics are errors, and a wish to stop is heard.
#[test]
fn pieces_fail_as_one_does() {
    let case = cases(5..6, Some(4)).next().unwrap();
    Stitching::of(&case, |stitching| {
        let count = stitching.slabs.len() as u32;
        assert!(count >= 5);
        let ranges = [0..1, 1..3, 3..4, 4..count];
        let workers = Workers::new(3).unwrap();
        for first in 0..count {
            for second in first..count {
                let make = |number: u32| match number {
                    bad if bad == first || bad == second => Err(Error::Usage(format!("slab {bad}"))),
                    number => stitching.slab(number),
                };
                let Err(Error::Usage(told)) = stitching.in_pieces((&ranges, u32::MAX), &workers, &make) else {
                    panic!("no error")
                };
                assert_eq!(told, format!("slab {first}"), "and {second}");
            }
            let make = |number: u32| {
                if number == first {
                    std::panic::resume_unwind(Box::new("planted"));
                }
                stitching.slab(number)
            };
            let failed = stitching.in_pieces((&ranges, u32::MAX), &workers, &make);
            assert!(matches!(failed, Err(Error::Internal(_))), "{failed:?}");
            let make = |number: u32| {
                if number == first {
                    workers.cancel_flag().store(true, Ordering::Relaxed);
                }
                stitching.slab(number)
            };
            let stopped = stitching.in_pieces((&ranges, u32::MAX), &workers, &make);
            workers.cancel_flag().store(false, Ordering::Relaxed);
            // With nothing left to do, the wish comes too late.
            assert!(matches!(stopped, Err(Error::Interrupted)) || first + 2 >= count, "{stopped:?}");
        }
    });
}

/// All of a slab that going back may change.
type Changeable = (Vec<VertexState>, Vec<u32>, Vec<[u32; 3]>, Vec<[f64; 3]>);

fn changeable(slab: &SlabMesh<f32>) -> Changeable {
    let places = (0..slab.own()).map(|v| slab.position(InSlab(v))).collect();
    (slab.state.clone(), slab.stars.also.clone(), slab.triangles.clone(), places)
}

/// A round of going back that meets a frozen vertex is taken back whole, after it has moved others, has taken clusters apart and flips back; a round that meets none moves no frozen one.
#[test]
fn a_round_that_meets_a_frozen_vertex_leaves_everything_as_it_was() {
    let (mut taken_back, mut done, mut parted, mut flipped_back) = (0, 0, 0, 0);
    for seed in 0..12u64 {
        let cloud = points(0x9E37_79B9_7F4A_7C15 ^ seed, 2500, 0.15 * (seed % 5) as f64);
        with_slabs(&Case::new(cloud, 62, 1), |grid, making, _, _| {
            let [mut lower, mut upper] =
                [0, 1].map(|number| SlabMesh::make(number, making, SlabMesh::default()).unwrap());
            let quantizer = BroadPhase::new(grid, FRAME.origin).quantizer();
            Seam::of(&mut lower, &mut upper, 0, FRAME, quantizer).close();
            let own = lower.own();
            // Up to the middle of the lower slab; what goes back lies round it.
            let frozen = own / 2;
            // Each part twelve times, until its vertices are at rest, and their clusters apart: by turns beside what is frozen, and far above it.
            for round in 0..96u32 {
                let part = round / 12;
                let before = [&lower, &upper].map(changeable);
                let mut seam = Seam::of(&mut lower, &mut upper, frozen, FRAME, quantizer);
                let lives = |v: &u32| !matches!(seam.state(*v), VertexState::Contracted | VertexState::AtRest);
                // From the highest number on, so that others have moved when a frozen one is met.
                let first = if part % 2 == 0 { frozen.saturating_sub(part) } else { own - own / 4 };
                let span = first..(first + 40 + 28 * part).min(own);
                let some: Vec<u32> = span.step_by(1 + part as usize % 5).filter(lives).collect();
                let some: Vec<u32> = some.into_iter().rev().collect();
                if some.is_empty() {
                    continue;
                }
                let at = some.iter().flat_map(|v| seam.corners(*v)).map(|corner| corner / 3);
                let flipped: Vec<u32> = at.filter(|t| seam.is_flipped(*t)).step_by(3).collect();
                let moved = step_back(&mut seam, &some, flipped);
                let after = [&lower, &upper].map(changeable);
                match moved {
                    None => {
                        assert!(before == after, "seed {seed}, round {round}");
                        taken_back += 1;
                    }
                    Some(moved) => {
                        assert!(moved.vertices.iter().all(|v| *v >= frozen), "seed {seed}, round {round}");
                        let upto = frozen as usize;
                        assert!(before[0].0[..upto] == after[0].0[..upto] && before[0].3[..upto] == after[0].3[..upto]);
                        parted += u32::from(before[0].1 != after[0].1);
                        flipped_back += moved.flipped_back.len() / 2;
                        done += 1;
                    }
                }
            }
        });
    }
    assert!(
        taken_back > 50 && done > 50 && parted > 0 && flipped_back > 50,
        "{taken_back} taken back, {done} done, {parted} took clusters apart, {flipped_back} flips were taken back"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    #[ignore = "exhaustive"]
    fn a_clean_seam_comes_out_the_same_without_the_seam_before(
        seed in any::<u64>(),
        count in 500usize..6000,
        in_volume in 0.0f64..1.0,
        slices in 62u32..90,
        smooth in 0u32..2,
    ) {
        let cloud = points(seed, count, in_volume);
        let ranges = |count: u32| std::iter::once(0..count).chain((1..count - 1).map(|k| k..k + 2)).collect();
        let mut runs = stitched(&Case::new(cloud, slices, smooth), ranges).into_iter();
        let whole = runs.next().unwrap();
        for (k, alone) in (1..).zip(runs) {
            // The seams below and above slab k, of all and alone.
            let [below, above] = [whole.seams[k - 1], whole.seams[k]];
            let [_, upper] = &alone.slabs[..] else { panic!("two slabs") };
            prop_assert_eq!(above.plane, upper.slices.start);
            if !above.clean {
                continue;
            }
            prop_assert_eq!((above.read, above.changed, above.rounds), {
                let found = alone.seams[0];
                (found.read, found.changed, found.rounds)
            });
            // Whatever lies above all that the seam below changed.
            let lower = [&whole.slabs[k], &alone.slabs[0]];
            let first = below.changed.map_or(0, |[_, plane]| (plane + 1).saturating_sub(lower[0].slices.start));
            let start = lower[0].planes[(first as usize).min(lower[0].planes.len() - 1)] as usize;
            let [a, b] = lower.map(|slab| (&slab.state[start..], &slab.quantized[start..], &slab.stars.also[start..]));
            prop_assert_eq!(a.0, b.0);
            prop_assert!(a.1 == b.1 && a.2 == b.2);
            // In the whole run the next seam has changed the slab above, too: what lies below that is compared.
            let after = &whole.slabs[k + 1];
            let untouched = whole.seams.get(k + 1).and_then(|seam| seam.changed).map_or(u32::MAX, |[plane, _]| plane);
            let end = after.planes[(untouched.saturating_sub(after.slices.start) as usize).min(after.planes.len() - 1)] as usize;
            prop_assert_eq!(&after.state[..end], &upper.state[..end]);
            prop_assert!(after.quantized[..end] == upper.quantized[..end] && after.stars.also[..end] == upper.stars.also[..end]);
        }
    }
}
