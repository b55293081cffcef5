//! Each stage by itself, on what the stages before it made of a knot of one million points (k = 4, 400 slices).
//!
//! ```text
//! cargo bench --bench stages                                  all stages, about a minute
//! cargo bench --bench stages -- fit                           those with `fit` in the name
//! ASRA_BENCH_POINTS=20_000_000 cargo bench --bench stages     a larger cloud, on a grid that is finer in proportion
//! ```
//!
//! What a stage is compared by is its throughput, in what it goes through:
//!
//! * points: survey, bucket and raster, as a whole run has them. The input file is in the system's cache; bucket writes to memory.
//! * slices: exterior (which dilates) and solid (exterior, and growing it back), by closing radius; seal, which runs
//!   these for several radii on several resolutions; lone.
//! * triangles, before contraction: the stages within a slab. `extract`, `smooth`, `triangles`, `fit` and `contract` go through all
//!   slabs on one thread; `slab` is all of these together on all threads, so on two it should take about half their sum.
//! * triangles of the finished mesh: stitch, check, write.
//!
//! Everything lies in memory, whatever the budget would say; `end_to_end` has the buckets on disk.

mod clouds;

use std::hint::black_box;
use std::time::Duration;

use asra_stream::internals::format::write;
use asra_stream::internals::grid::Grid;
use asra_stream::internals::grid::bucket::Buckets;
use asra_stream::internals::grid::context::Context;
use asra_stream::internals::grid::dilate::Ball;
use asra_stream::internals::grid::occupancy::{Counted, Occupancy, Sampled};
use asra_stream::internals::grid::partition::{halo, slab_count, slices_of};
use asra_stream::internals::input::{Carried, Cloud, InputOptions};
use asra_stream::internals::mesh::check::check;
use asra_stream::internals::mesh::spool::{Frame, MeshSpool};
use asra_stream::internals::mesh::{MeshHeader, MeshSource};
use asra_stream::internals::points::Precision;
use asra_stream::internals::resources::machine;
use asra_stream::internals::resources::memory::SlabJobs;
use asra_stream::internals::resources::workers::Workers;
use asra_stream::internals::run::pipeline::context;
use asra_stream::internals::run::progress::{Progress, Show};
use asra_stream::internals::run::surveyed::{Surveyed, survey_cloud};
use asra_stream::internals::settings::Settings;
use asra_stream::internals::settings::closing::Sealing;
use asra_stream::internals::settings::surface::{Fit, SurfaceOptions};
use asra_stream::internals::solid::close;
use asra_stream::internals::solid::close::ClosingOptions;
use asra_stream::internals::solid::exterior::Exterior;
use asra_stream::internals::stitch::make::Making;
use asra_stream::internals::stitch::slab::SlabMesh;
use asra_stream::internals::storage::spool::Workspace;
use asra_stream::internals::surface::contract::{Groups, NONE, Stars, contract};
use asra_stream::internals::surface::extract::Surface;
use asra_stream::internals::surface::fit::{Fitted, Task, fit};

use asra_stream::internals::grid::survey::{Wanted, survey};
use asra_stream::internals::solid::Solid;
use asra_stream::internals::stitch::Stitcher;
use asra_stream::internals::storage::atomic_file::Overwrite;
use asra_stream::internals::surface::smooth::smooth;
use criterion::measurement::WallTime;
use criterion::{BatchSize, BenchmarkGroup, BenchmarkId, Criterion, SamplingMode, Throughput};

/// The closing radii that exterior and solid are measured with: what a dense cloud takes, and a sparse one.
const RADII: [u32; 3] = [1, 2, 4];

/// How the meshes are written: as the points are.
const FRAME: Frame = Frame { origin: [0.0; 3], precision: Precision::Single };

const SMOOTH: u32 = 1;

fn main() {
    let points = clouds::points_asked("ASRA_BENCH_POINTS").unwrap_or(1_000_000);
    let dir = tempfile::tempdir().expect("a folder for temporary files");
    let workers = Workers::new(machine::processors()).expect("threads");
    let path = clouds::knot(dir.path(), points, &workers);
    let cloud = Cloud::open(&[path], &InputOptions::default()).expect("the cloud");
    let surveyed = survey_cloud(&cloud, &Settings::default(), &workers, 1 << 30, &mut Progress::new(Show::Nothing))
        .expect("a grid");
    let workspace = Workspace::new(dir.path()).expect("a folder for temporary files");
    // So much that the plan keeps everything in memory.
    let budget = (1 << 30) + 400 * points;
    let context = context(&surveyed, &workers, &workspace, budget).expect("a plan");
    let Surveyed { grid, .. } = &surveyed;

    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("stages");
    group.sample_size(10).sampling_mode(SamplingMode::Flat);
    group.warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    let buckets = points_to_cells(&mut group, &cloud, grid, points, &context);
    let occupancy = Occupancy::of_buckets(&buckets, grid, 1, &context, |_| ()).expect("cells");
    let solid = cells_to_solid(&mut group, &occupancy, &context);
    let sampled = Sampled { buckets: &buckets, occupied: &occupancy.store, grid, counted: Counted::All };
    within_slabs(&mut group, &solid, &sampled, &context);
    let mesh = slabs_to_mesh(&mut group, &solid, &sampled, &context);

    group.throughput(Throughput::Elements(mesh.face_count()));
    group.bench_function("check", |b| {
        b.iter(|| check(&mesh, context.memory.working, &workers, &workspace, &mut |_| ()).expect("a mesh"));
    });
    group.bench_function("write", |b| {
        let (path, header) = (dir.path().join("knot.ply"), MeshHeader::default());
        b.iter(|| write::write(&mesh, &header, &path, Overwrite::Replace, &workers, &mut |_| ()).expect("room"));
    });
    group.finish();
    criterion.final_summary();
}

fn points_to_cells(
    group: &mut BenchmarkGroup<'_, WallTime>,
    cloud: &Cloud,
    grid: &Grid,
    points: u64,
    context: &Context,
) -> Buckets<f32> {
    group.throughput(Throughput::Elements(points));
    group.bench_function("survey", |b| {
        let in_flight = 2 * context.workers.threads();
        b.iter(|| survey(cloud, Wanted::Density, &context.workers, in_flight, |_| ()).expect("points"));
    });
    let fill = || Buckets::<f32>::fill((cloud, None, Carried::Attributes), grid, context, |_| ()).expect("points");
    group.bench_function("bucket", |b| b.iter(fill));
    let buckets = fill();
    assert_eq!(context.workspace.peak_on_disk(), 0);
    group.bench_function("raster", |b| {
        b.iter(|| Occupancy::of_buckets(&buckets, grid, 1, context, |_| ()).expect("cells"));
    });
    buckets
}

fn cells_to_solid(group: &mut BenchmarkGroup<'_, WallTime>, occupancy: &Occupancy, context: &Context) -> Solid {
    group.throughput(Throughput::Elements(u64::from(occupancy.cells[1])));
    for radius in RADII {
        group.bench_function(BenchmarkId::new("exterior", radius), |b| {
            let ball = Ball::new(radius);
            b.iter(|| Exterior::find(occupancy, &ball, context).expect("an exterior"));
        });
    }
    for radius in RADII {
        group.bench_function(BenchmarkId::new("solid", radius), |b| {
            let ball = Ball::new(radius);
            b.iter(|| Solid::close(occupancy, &ball, context).expect("a solid"));
        });
    }
    // The cells are closed anew each time: closing takes them.
    let again = || occupancy.filtered(|_| true, context).expect("cells");
    let asked =
        ClosingOptions { seal: Sealing::Auto, window: None, keep_outliers: false, min_component: None, rough: false };
    let close = || close::close(again(), 1.0, asked, context, |_, _| ()).expect("a solid").solid;
    group.bench_function("close", |b| b.iter(close));
    group.bench_function("lone", |b| {
        let drop_lone = |solid: Solid| solid.without_isolated_cells(context).expect("a solid");
        b.iter_batched(close, drop_lone, BatchSize::PerIteration);
    });
    close().without_isolated_cells(context).expect("a solid")
}

/// What the stages within a slab make of it, before contraction.
struct Slab {
    number: u32,
    planes: std::ops::Range<u32>,
    surface: Surface,
    q: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    fitted: Fitted<f32>,
    /// Of each own vertex where smoothing put it, in the input's units.
    smoothed: Vec<[f64; 3]>,
    /// Vertices that have a star.
    named: usize,
    /// Of each own vertex its point, or none where it must not be contracted.
    group: Vec<u32>,
}

impl Slab {
    /// As [`SlabMesh::make`] does it.
    fn make(number: u32, solid: &Solid, sampled: &Sampled<'_, f32>, jobs: SlabJobs) -> Slab {
        let slices = slices_of(number, SMOOTH, solid.cells[1]);
        let planes = slices.start..slices.end + u32::from(slices.end == solid.cells[1]);
        let surface = find(number, solid);
        let q = smooth(&surface, SMOOTH, Vec::new());
        let task = Task { surface: &surface, q: &q, planes: planes.clone(), halo: halo(SMOOTH) };
        let fitted = fit(sampled, &task, jobs.points_held, Fitted::default()).expect("points");
        let options =
            SurfaceOptions { smooth: SMOOTH, diagonals: Default::default(), fit: Fit::None, slab_slices: None };
        let making = Making { solid, membranes: None, sampled, options, frame: FRAME, jobs, told: None };
        let unfitted = SlabMesh::make(number, &making, SlabMesh::default()).expect("a slab");
        let mut group = fitted.point.clone();
        if slices.start > 0 {
            group[..unfitted.seam() as usize].fill(NONE);
        }
        let SlabMesh { triangles, smoothed, .. } = unfitted;
        let named = triangles.as_flattened().iter().max().map_or(0, |v| *v as usize + 1).max(group.len());
        Slab { number, planes, surface, q, triangles, fitted, smoothed, named, group }
    }
}

/// As many slabs at a time as there are threads, and more than one: that would give memory back between its stages.
fn slab_jobs(context: &Context) -> SlabJobs {
    SlabJobs {
        running: context.workers.threads().max(2),
        ahead: 0,
        points_held: context.memory.points_held,
        pieces: 1,
        gives_back: false,
    }
}

fn find(number: u32, solid: &Solid) -> Surface {
    let slices = slices_of(number, SMOOTH, solid.cells[1]);
    Surface::find(solid, i64::from(slices.start)..=i64::from(slices.end)).expect("a surface")
}

fn within_slabs(
    group: &mut BenchmarkGroup<'_, WallTime>,
    solid: &Solid,
    sampled: &Sampled<'_, f32>,
    context: &Context,
) {
    let jobs = slab_jobs(context);
    let mut slabs: Vec<Slab> =
        (0..slab_count(SMOOTH, solid.cells[1])).map(|n| Slab::make(n, solid, sampled, jobs)).collect();
    group.throughput(Throughput::Elements(slabs.iter().map(|slab| slab.triangles.len() as u64).sum()));
    group.bench_function("extract", |b| {
        b.iter(|| slabs.iter().for_each(|slab| drop(black_box(find(slab.number, solid)))));
    });
    group.bench_function("smooth", |b| {
        b.iter(|| slabs.iter().for_each(|slab| drop(black_box(smooth(&slab.surface, SMOOTH, Vec::new())))));
    });
    group.bench_function("triangles", |b| {
        let triangles =
            |slab: &Slab| slab.surface.triangles(slab.planes.clone(), &slab.q, Default::default(), Vec::new());
        b.iter(|| slabs.iter().for_each(|slab| drop(black_box(triangles(slab)))));
    });
    group.bench_function("fit", |b| {
        let fit = |slab: &Slab| {
            let Slab { surface, q, planes, .. } = slab;
            let task = Task { surface, q, planes: planes.clone(), halo: halo(SMOOTH) };
            fit(sampled, &task, jobs.points_held, Fitted::default()).expect("points")
        };
        b.iter(|| slabs.iter().for_each(|slab| drop(black_box(fit(slab)))));
    });
    // Contraction takes triangles away: each iteration has its own.
    let triangles: Vec<_> = slabs.iter_mut().map(|slab| std::mem::take(&mut slab.triangles)).collect();
    group.bench_function("contract", |b| {
        let contract = |(slab, triangles): (&Slab, &mut Vec<[u32; 3]>)| {
            let mut stars = Stars::new(triangles, slab.named, slab.group.len(), Stars::default());
            let distance = |v: u32| slab.fitted.distance(v as usize, slab.smoothed[v as usize]);
            let groups = Groups { group: &slab.group, distance, kept: &[] };
            contract(triangles, &mut stars, groups, |_, _| ());
        };
        b.iter_batched_ref(
            || triangles.clone(),
            |triangles| slabs.iter().zip(triangles).for_each(contract),
            BatchSize::PerIteration,
        );
    });
}

fn slabs_to_mesh(
    group: &mut BenchmarkGroup<'_, WallTime>,
    solid: &Solid,
    sampled: &Sampled<'_, f32>,
    context: &Context,
) -> MeshSpool {
    let jobs = slab_jobs(context);
    let options = Settings::default().surface;
    assert_eq!(options.smooth, SMOOTH);
    let count = slab_count(SMOOTH, solid.cells[1]);
    let make = || {
        let mut slabs = Vec::new();
        let making = Making { solid, membranes: None, sampled, options, frame: FRAME, jobs, told: None };
        let make = |number: usize| SlabMesh::make(number as u32, &making, SlabMesh::default());
        let keep = |slab| {
            slabs.push(slab);
            Ok(())
        };
        context.workers.in_order_range(context.workers.threads() + 1, count as usize, make, keep).expect("slabs");
        slabs
    };
    let stitch = |slabs: Vec<SlabMesh<f32>>| {
        let mesh = MeshSpool::new(&context.workspace, Precision::Single, context.memory.mesh_quota);
        let mut stitcher = Stitcher::new(sampled.grid, halo(SMOOTH), FRAME, mesh, false);
        for slab in slabs {
            stitcher.add(slab).expect("room");
        }
        stitcher.finish().expect("room").mesh
    };
    let slabs = make();
    group.throughput(Throughput::Elements(slabs.iter().map(|slab| slab.triangles.len() as u64).sum()));
    group.bench_function("slab", |b| b.iter(make));
    let mesh = stitch(slabs);
    group.throughput(Throughput::Elements(mesh.face_count()));
    // Slabs are made anew for each iteration: few iterations, or that is all the time goes to.
    group.warm_up_time(Duration::from_millis(10)).measurement_time(Duration::from_millis(10));
    group.bench_function("stitch", |b| b.iter_batched(make, stitch, BatchSize::PerIteration));
    group.warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    mesh
}
