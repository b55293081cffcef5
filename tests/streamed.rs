//! The central test: the stream gives the naive twin's mesh, vertex for vertex, triangle for triangle, bit for bit.

// In one program with the twin, which takes long to compile.
mod streamed {
    mod creases;
    mod facets;
    mod membranes;
    mod noise;
    mod rest;
    mod slots;
    mod smooth;
    mod twin_self;
}
mod twin;

use std::path::Path;

use asra_stream::internals::error::Error;
use asra_stream::internals::grid::Grid;
use asra_stream::internals::grid::dilate::Ball;
use asra_stream::internals::grid::occupancy::Occupancy;
use asra_stream::internals::grid::partition::{Slabs, slab_slices};
use asra_stream::internals::grid::slice::Runs;
use asra_stream::internals::input::{Cloud, InputOptions, Layout};
use asra_stream::internals::mesh::MeshSource;
use asra_stream::internals::points::bounds::{Axis, Bounds};
use asra_stream::internals::resources::memory::MemoryPlan;
use asra_stream::internals::resources::workers::Workers;
use asra_stream::internals::run::pipeline::{context, reconstruct};
use asra_stream::internals::run::progress::{Progress, Show};
use asra_stream::internals::run::surface::Reconstructed;
use asra_stream::internals::run::surveyed::{Surveyed, survey_cloud};
use asra_stream::internals::settings::closing::Least;
use asra_stream::internals::settings::closing::Sealing;
use asra_stream::internals::settings::open::{Facing, Hole, Kind, Open};
use asra_stream::internals::settings::surface::Diagonals;
use asra_stream::internals::settings::surface::{Fit, SurfaceOptions};
use asra_stream::internals::settings::{AxisChoice, Resolution};
use asra_stream::internals::settings::{Fineness, Settings};
use asra_stream::internals::solid::Solid;
use asra_stream::internals::solid::close::How;
use asra_stream::internals::storage::spool::Workspace;
use proptest::prelude::*;

/// A mesh as bits.
type MeshBits = (Vec<[u64; 3]>, Vec<[u32; 3]>);

struct Run {
    surveyed: Surveyed,
    made: Reconstructed,
    mesh: MeshBits,
}

/// The means of a run, which must not show in its result.
#[derive(Debug, Clone, Copy)]
enum Means {
    Ample,
    /// The least budget, and so many points held at once.
    Least {
        threads: usize,
        held: usize,
    },
    /// So many pieces at a time, if so many times the least budget has room for them.
    Pieces {
        threads: usize,
        pieces: usize,
        times: u64,
    },
}

fn write_raw(path: &Path, points: &[[f64; 3]], single: bool) -> Layout {
    let mut bytes = Vec::new();
    for c in points.as_flattened() {
        if single {
            bytes.extend((*c as f32).to_le_bytes());
        } else {
            bytes.extend(c.to_le_bytes());
        }
    }
    std::fs::write(path, bytes).unwrap();
    if single { "xyz" } else { "xyz:f64" }.parse().unwrap()
}

fn stream(points: &[[f64; 3]], single: bool, settings: &Settings, means: Means) -> asra_stream::Result<Run> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cloud.bin");
    let layout = Some(write_raw(&path, points, single));
    let cloud = Cloud::open(&[path], &InputOptions { layout, ..InputOptions::default() })?;
    let threads = match means {
        Means::Ample => 2,
        Means::Least { threads, .. } | Means::Pieces { threads, .. } => threads,
    };
    let workers = Workers::new(threads)?;
    let mut progress = Progress::new(Show::Nothing);
    let surveyed = survey_cloud(&cloud, settings, &workers, 1 << 30, &mut progress)?;
    let workspace = Workspace::new(dir.path())?;
    let budget = match means {
        Means::Ample => 4 << 30,
        Means::Least { .. } => MemoryPlan::least(&surveyed.workload, threads),
        Means::Pieces { times, .. } => times * MemoryPlan::least(&surveyed.workload, threads),
    };
    let mut context = context(&surveyed, &workers, &workspace, budget)?;
    if let Means::Least { held, .. } = means {
        context.memory.points_held = held;
        context.memory.bucket_buffer = 64;
        context.memory.buckets_quota = 0;
        context.memory.store_quota = 0;
        context.memory.mesh_quota = 0;
        context.memory.working = 1 << 30;
    }
    if let Means::Pieces { pieces, .. } = means {
        context.memory.pieces = pieces;
    }
    let made = reconstruct(&cloud, &surveyed, settings, &context, &mut progress)?;
    let mut vertices = vec![[0.0; 3]; made.mesh.vertex_count() as usize];
    made.mesh.read_vertices(0, &mut vertices)?;
    let mut faces = vec![[0; 3]; made.mesh.face_count() as usize];
    made.mesh.read_faces(0, &mut faces)?;
    let mesh = (vertices.iter().map(|v| v.map(f64::to_bits)).collect(), faces);
    Ok(Run { surveyed, made, mesh })
}

/// The planes that are left out of wide gaps, along the grid's axes.
fn naive_folds(points: &[[f64; 3]], settings: &Settings, grid: &Grid) -> [Vec<[u32; 2]>; 3] {
    let Fineness::Given(Resolution::Cell(w)) = settings.fineness else { return Default::default() };
    let raw = grid.raw_cells();
    let longest = *raw.iter().max().unwrap();
    let (up, reach) = match (&settings.open, settings.seal) {
        (Some(Open { facing: Facing::Along { .. }, max_hole: Hole::Cells(hole), .. }), _) => {
            let margin = 9 + 2 * settings.surface.smooth.max(1) - 2;
            (settings.open.map(|open| open.up(grid).axis), 4 * (hole.div_ceil(2).min(longest) + margin))
        }
        (Some(_), _) => return Default::default(),
        (None, Sealing::Cells(radius)) => (None, 4 * radius),
        (None, Sealing::Off) => (None, 4),
        (None, _) => (None, 0),
    };
    let min = grid.bounds().min;
    let mut folds: [Vec<[u32; 2]>; 3] = Default::default();
    for (g, f) in grid.axis().file_axes().into_iter().enumerate().filter(|(g, _)| Some(*g) != up) {
        let plane = |p: &[f64; 3]| (((p[f] - min[f]) * (1.0 / w)).floor() as u32).min(raw[g] - 1);
        let taken: Vec<u32> = points.iter().map(plane).collect();
        folds[g] = twin::grid::folds(&taken, longest, reach);
    }
    folds
}

fn naive(points: &[[f64; 3]], single: bool, settings: &Settings, run: &Run) -> MeshBits {
    let grid = &run.surveyed.grid;
    let folds = naive_folds(points, settings, grid);
    let left_out = folds.each_ref().map(|folds| folds.iter().map(|[from, to]| to - from).sum::<u32>());
    assert_eq!(grid.raw_cells(), [0, 1, 2].map(|g| grid.cells()[g] + left_out[g]), "planes left out");
    let How::Ball(closing) = &run.made.how else { panic!("the twin closes with a ball") };
    let params = twin::Params {
        folds,
        axis: [twin::Axis::X, twin::Axis::Y, twin::Axis::Z][grid.axis().index()],
        turn: settings.open.and_then(|open| match open.facing {
            Facing::Along { .. } => None,
            Facing::Poses => panic!("the twin is told a direction"),
            Facing::Direction(direction) => Some(twin::grid::turned_up(direction)),
            Facing::Position(place) => {
                let Bounds { min, max } = run.surveyed.survey.bounds;
                Some(twin::grid::turned_up([0, 1, 2].map(|a| place[a] - min[a].midpoint(max[a]))))
            }
        }),
        min: grid.bounds().min,
        w: grid.cell_size(),
        cells: grid.cells(),
        min_points: settings.min_points,
        keep: settings.min_component.map(|least| match least {
            Least::Cells(cells) => twin::Keep::Cells(cells),
            Least::Share(share) => twin::Keep::Share(share),
            Least::Largest => twin::Keep::Largest,
            Least::Auto => panic!("the twin is told what to keep"),
        }),
        rho: closing.radius,
        level: closing.level,
        falls: run.made.falls,
        smooth: settings.surface.smooth,
        diagonals: match settings.surface.diagonals {
            Diagonals::Delaunay => twin::Diagonals::Delaunay,
            Diagonals::Random => twin::Diagonals::Random,
            Diagonals::First => twin::Diagonals::First,
        },
        fit: match settings.fit() {
            Fit::Auto => twin::Fit::Auto,
            Fit::AutoPoints => twin::Fit::AutoPoints,
            Fit::Facets => twin::Fit::Facets,
            Fit::Nearest => twin::Fit::Nearest,
            Fit::Sphere => twin::Fit::Sphere,
            Fit::None => twin::Fit::None,
        },
        open: settings.open.map(|open| twin::Open {
            up: open.up(grid).axis,
            positive: open.facing.axis().1,
            bridge: open.bridge(grid) as i32,
            ball: match settings.seal {
                Sealing::Cells(radius) => (if radius == 1 { 3 } else { radius * radius }) as i32,
                _ => 2,
            },
            base: open.base.is_some(),
            jump: open.jump(grid).map(|jump| jump as i32),
            smooth: settings.surface.smooth,
        }),
        slab_slices: Slabs::of(&settings.surface).slices,
        origin: run.made.origin,
        single,
    };
    let mesh = twin::reconstruct(points, &params);
    (mesh.bits(), mesh.faces)
}

fn settings() -> impl Strategy<Value = Settings> {
    let axis = prop_oneof![
        Just(AxisChoice::Longest),
        Just(AxisChoice::Fixed(Axis::X)),
        Just(AxisChoice::Fixed(Axis::Y)),
        Just(AxisChoice::Fixed(Axis::Z))
    ];
    let diagonals = prop_oneof![Just(Diagonals::Delaunay), Just(Diagonals::First), Just(Diagonals::Random)];
    let fit = prop_oneof![3 => Just(Fit::Auto), 2 => Just(Fit::Facets), 2 => Just(Fit::Nearest), 2 => Just(Fit::Sphere), 1 => Just(Fit::None)];
    let smooth = prop_oneof![4 => Just(1u32), 1 => Just(0), 1 => Just(2), 1 => Just(3)];
    // Fewer slices than usual, so that pieces are several; contraction and noise seldom reach through so many.
    let slab = prop_oneof![2 => Just(None), 1 => Just(Some(12u32)), 1 => Just(Some(16))];
    let min_points = prop_oneof![6 => Just(1u32), 1 => Just(2), 1 => Just(3)];
    let min_component = prop_oneof![
        6 => Just(None),
        1 => Just(Some(Least::Largest)),
        1 => (1u64..30).prop_map(|cells| Some(Least::Cells(cells))),
        1 => (0.0f64..=1.0).prop_map(|share| Some(Least::Share(share))),
    ];
    let seal = prop_oneof![
        1 => Just((Sealing::Off, None)),
        1 => Just((Sealing::Off, Some(3u32))),
        1 => Just((Sealing::Cells(2), Some(5))),
        // From 10 cells on the ball starts on a coarser level.
        3 => (2u32..=4).prop_map(|cells| (Sealing::Cells(cells), None)),
        1 => (10u32..=11).prop_map(|cells| (Sealing::Cells(cells), None)),
    ];
    (axis, 1u32..=40, seal, smooth, diagonals, (fit, slab), min_points, min_component).prop_map(
        |(axis, slices, (seal, window), smooth, diagonals, (fit, slab_slices), min_points, min_component)| Settings {
            fineness: Fineness::Given(Resolution::Slices(slices)),
            axis,
            seal,
            window,
            keep_outliers: false,
            min_points,
            min_component,
            surface: SurfaceOptions { smooth, diagonals, fit, slab_slices },
            open: None,
            ..Settings::default()
        },
    )
}

/// Settings for surfaces that are seen from one side, with cells of side 1.
fn open_settings() -> impl Strategy<Value = Settings> {
    let facing = prop::sample::select(vec![
        "+z",
        "+z",
        "-z",
        "+x",
        "-x",
        "+y",
        "-y",
        "0.3,0,1",
        "-1,0.2,0.5",
        "0,-3,0",
        "@20,7,30",
    ]);
    let seal = prop_oneof![3 => Just(Sealing::Auto), 1 => (1u32..=3).prop_map(Sealing::Cells)];
    let base = prop_oneof![3 => Just(None), 1 => (-3.0f64..=0.0).prop_map(Some)];
    (settings(), facing, seal, 0u32..=7, base, any::<bool>()).prop_map(|(settings, facing, seal, hole, base, fixed)| {
        let facing: Facing = facing.parse().unwrap();
        let base = base.filter(|_| facing == Facing::UP);
        let kind = if facing == Facing::UP { Kind::Terrain } else { Kind::Sheet };
        let axis = match facing.axis().0 {
            _ if !fixed => AxisChoice::Longest,
            Axis::X => AxisChoice::Fixed(Axis::Z),
            Axis::Y => AxisChoice::Fixed(Axis::X),
            Axis::Z => AxisChoice::Fixed(Axis::X),
        };
        Settings {
            fineness: Fineness::Given(Resolution::Cell(1.0)),
            axis,
            seal,
            window: None,
            min_component: None,
            surface: SurfaceOptions { smooth: settings.surface.smooth.min(2), ..settings.surface },
            open: Some(Open { kind, facing, max_hole: Hole::Cells(hole), base }),
            ..settings
        }
    })
}

/// Ground with holes, and things that stand and lie on it, hang over it or below.
fn landscape() -> impl Strategy<Value = Vec<[f64; 3]>> {
    let size = (1u32..=9, 1u32..=24);
    let hole = (0u32..9, 0u32..24, 0u32..5);
    let block = (0u32..9, 0u32..24, 1u32..5, 0u32..5, 0u32..5);
    let strays = prop::collection::vec([0.0f32..9.0, 0.0f32..24.0, 0.0f32..5.0], 0..12);
    let jitter = prop::collection::vec([0.0f32..1.0, 0.0f32..1.0, 0.0f32..1.0], 24 * 9);
    (size, prop::collection::vec(hole, 0..4), prop::collection::vec(block, 0..3), strays, jitter, 0.0f64..0.4).prop_map(
        |((wide, long), holes, blocks, strays, jitter, slope)| {
            let mut points: Vec<[f64; 3]> = strays.iter().map(|p| p.map(f64::from)).collect();
            for x in 0..wide {
                for y in 0..long {
                    let inside = |(a, b, size): &(u32, u32, u32)| x.abs_diff(*a) < *size && y.abs_diff(*b) < *size;
                    if holes.iter().any(inside) {
                        continue;
                    }
                    let [a, b, c] = jitter[(x * 24 + y) as usize].map(f64::from);
                    points.push([f64::from(x) + a, f64::from(y) + b, slope * f64::from(x) + c]);
                    for (_, _, _, low, high) in blocks.iter().filter(|(a, b, size, ..)| inside(&(*a, *b, *size))) {
                        points.push([f64::from(x) + b, f64::from(y) + c, f64::from(low + high) + a]);
                    }
                }
            }
            points.push([0.5, 0.5, 0.5]);
            // Exact in single precision.
            points.into_iter().map(|p| p.map(|c| f64::from(c as f32))).collect()
        },
    )
}

fn assert_same_open(points: &[[f64; 3]], single: bool, settings: &Settings) -> Result<(), TestCaseError> {
    let run = match stream(points, single, settings, Means::Ample) {
        Err(Error::InvalidSetting { name: "min_points", .. }) if settings.min_points > 1 => return Ok(()),
        run => run.unwrap(),
    };
    prop_assume!(run.surveyed.grid.cells().iter().map(|c| u64::from(*c)).product::<u64>() < 25_000);
    let closed = settings.open.is_some_and(|open| open.base.is_some());
    let loops = twin::check::check_open(run.mesh.0.len(), &run.mesh.1).map_err(TestCaseError::fail)?;
    prop_assert!(!closed || loops == 0);
    let expected = naive(points, single, settings, &run);
    prop_assert_eq!(run.mesh.0.len(), expected.0.len(), "number of vertices");
    prop_assert_eq!(&run.mesh.1, &expected.1);
    prop_assert!(run.mesh.0 == expected.0);
    let places: Vec<[f64; 3]> = run.mesh.0.iter().map(|v| v.map(f64::from_bits)).collect();
    // The flat sides of a closed body are too much for exact sums.
    let met = if closed || settings.surface.slab_slices.is_some() {
        Vec::new()
    } else {
        twin::intersect::pairs(&run.mesh.1, &|v| places[v as usize])
    };
    let tangled = if settings.surface.slab_slices.is_some() { 0 } else { run.made.counts.tangled };
    prop_assert!(met.is_empty() && tangled == 0, "{} intersections: {:?}", met.len(), met.first());
    assert_means_do_not_show(points, single, settings, &run)
}

/// Neither memory, threads nor the order of points show in the mesh.
fn assert_means_do_not_show(
    points: &[[f64; 3]],
    single: bool,
    settings: &Settings,
    run: &Run,
) -> Result<(), TestCaseError> {
    for means in [Means::Least { threads: 1, held: 3 }, Means::Least { threads: 7, held: 1000 }] {
        let other = stream(points, single, settings, means).unwrap();
        prop_assert!(other.mesh == run.mesh, "{:?} changes the mesh", means);
    }
    for (pieces, threads, times) in [(2, 1, 4), (5, 3, 8)] {
        let means = Means::Pieces { threads, pieces, times };
        let other = stream(points, single, settings, means).unwrap();
        prop_assert!(other.mesh == run.mesh, "{:?} changes the mesh", means);
        prop_assert_eq!(other.made.counts, run.made.counts, "{:?}", means);
        prop_assert_eq!(&other.made.seams, &run.made.seams, "{:?}", means);
    }
    let mut reversed = points.to_vec();
    reversed.reverse();
    prop_assert!(stream(&reversed, single, settings, Means::Ample).unwrap().mesh == run.mesh, "order changes the mesh");
    Ok(())
}

/// Clouds on grids that the twin cannot hold are left out.
fn too_large(points: &[[f64; 3]], settings: &Settings) -> bool {
    let axis = match settings.axis {
        AxisChoice::Longest => None,
        AxisChoice::Fixed(axis) => Some([twin::Axis::X, twin::Axis::Y, twin::Axis::Z][axis.index()]),
    };
    let Fineness::Given(Resolution::Slices(slices)) = settings.fineness else { return false };
    let (.., cells) = twin::grid_for(points, axis, slices);
    cells.iter().map(|c| u64::from(*c)).product::<u64>() > 20_000
}

fn assert_same(points: &[[f64; 3]], single: bool, settings: &Settings) -> Result<(), TestCaseError> {
    prop_assume!(!too_large(points, settings));
    let run = match stream(points, single, settings, Means::Ample) {
        // Nothing is left of a cloud whose cells or components are all too small.
        Err(error) if may_be_refused(settings, &error) => return Ok(()),
        run => run.unwrap(),
    };
    twin::check::check(run.mesh.0.len(), &run.mesh.1).map_err(TestCaseError::fail)?;
    let expected = naive(points, single, settings, &run);
    prop_assert_eq!(run.mesh.0.len(), expected.0.len(), "number of vertices");
    prop_assert_eq!(&run.mesh.1, &expected.1);
    for (i, (ours, theirs)) in run.mesh.0.iter().zip(&expected.0).enumerate() {
        let floats = |v: &[u64; 3]| v.map(f64::from_bits);
        prop_assert_eq!(ours, theirs, "vertex {}: {:?}, twin {:?}", i, floats(ours), floats(theirs));
    }
    // Where a cell is no more than some units in the last place, rounding alone brings triangles together; where slabs are thin, what is written already may have to stay.
    let largest = points.as_flattened().iter().fold(0.0f64, |m, c| m.max(c.abs()));
    let unit = largest * if single { f64::from(f32::EPSILON) } else { f64::EPSILON };
    if run.surveyed.grid.cell_size() > 64.0 * unit && settings.surface.slab_slices.is_none() {
        let places: Vec<[f64; 3]> = run.mesh.0.iter().map(|v| v.map(f64::from_bits)).collect();
        let met = twin::intersect::pairs(&run.mesh.1, &|v| places[v as usize]);
        prop_assert!(met.is_empty() && run.made.counts.tangled == 0, "{} intersections: {:?}", met.len(), met.first());
    }
    assert_means_do_not_show(points, single, settings, &run)
}

/// Whether an error says that a cloud cannot give what these settings ask for: cells that are full enough, components that are large enough, room for a ball.
fn may_be_refused(settings: &Settings, error: &Error) -> bool {
    let Error::InvalidSetting { name, .. } = error else { return false };
    match *name {
        "min_points" => settings.min_points > 1,
        "min_component" => settings.min_component.is_some(),
        "seal" => matches!(settings.seal, Sealing::Cells(_)),
        _ => false,
    }
}

/// The centre of a cell of side 1.
fn centre([x, y, z]: [u32; 3]) -> [f64; 3] {
    [x, y, z].map(|c| f64::from(c) + 0.5)
}

#[test]
#[ignore = "exhaustive"]
fn all_256_corners_give_the_twins_mesh_on_a_seam() {
    let settings = Settings {
        fineness: Fineness::Given(Resolution::Slices(24)),
        axis: AxisChoice::Fixed(Axis::Y),
        seal: Sealing::Off,
        window: Some(3),
        min_component: None,
        ..Settings::default()
    };
    let seam = slab_slices(settings.surface.smooth);
    assert!(seam < 24, "the block lies across a seam");
    for fit in [Fit::Facets, Fit::Nearest, Fit::Sphere, Fit::None] {
        for mask in 0..256u32 {
            // Two points far from the block hold the box at 7 x 24 x 7 cells of side 1.
            let mut points = vec![[0.0; 3], [7.0, 24.0, 7.0]];
            let set = (0..8).filter(|bit| mask >> bit & 1 == 1);
            points.extend(set.map(|bit| centre([3 + (bit & 1), seam - 1 + (bit >> 1 & 1), 3 + (bit >> 2)])));
            let settings = Settings { surface: SurfaceOptions { fit, ..settings.surface }, ..settings };
            let run = stream(&points, true, &settings, Means::Ample).unwrap();
            assert_eq!(run.surveyed.grid.cells(), [7, 24, 7]);
            twin::check::check(run.mesh.0.len(), &run.mesh.1).unwrap_or_else(|e| panic!("mask {mask:08b}: {e}"));
            assert!(run.mesh == naive(&points, true, &settings, &run), "mask {mask:08b}, {fit:?}");
        }
    }
}

/// A ball with its points off its surface by up to so many cells of 20 to its diameter.
fn rough_ball(points: usize, off: f64, seed: u64) -> Vec<[f64; 3]> {
    let mut state = seed;
    let mut unit = move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let point = |_| {
        let (height, turn) = (2.0 * unit() - 1.0, std::f64::consts::TAU * unit());
        let (s, r) = ((1.0 - height * height).sqrt(), 10.0 + off * (2.0 * unit() - 1.0));
        [r * s * turn.cos(), r * s * turn.sin(), r * height].map(|c| f64::from(c as f32))
    };
    (0..points).map(point).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6, ..ProptestConfig::default() })]

    #[test]
    fn noise_is_seen_as_the_twin_sees_it(off in 0.0f64..0.6, seed in any::<u64>()) {
        let points = rough_ball(5000, off, seed);
        let settings = Settings {
            fineness: Fineness::Given(Resolution::Slices(20)),
            seal: Sealing::Cells(2),
            min_component: None,
            surface: SurfaceOptions { fit: Fit::Auto, ..Settings::default().surface },
            ..Settings::default()
        };
        let run = stream(&points, true, &settings, Means::Ample).unwrap();
        let shell = run.made.shell.unwrap();
        // A layer of 2 · off cells has a standard deviation of off / √3.
        prop_assert!((shell.thickness - off / 3f64.sqrt()).abs() < 0.06, "{} of {off}", shell.thickness);
        prop_assert_eq!(run.made.fit == Fit::Sphere, shell.is_noisy());
        prop_assert!(run.mesh == naive(&points, true, &settings, &run));
        assert_means_do_not_show(&points, true, &settings, &run)?;
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, max_global_rejects: 100_000, ..ProptestConfig::default() })]

    #[test]
    #[ignore = "exhaustive"]
    fn a_tall_noisy_cloud_gives_the_twins_mesh_across_seams(
        points in prop::collection::vec([0.0f32..3.0, 0.0f32..20.0, 0.0f32..4.0], 50..400),
        settings in settings(),
    ) {
        let mut points: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
        points.push([0.0, 20.0, 0.0]);
        let slices = Resolution::Slices(40);
        let settings = Settings { axis: AxisChoice::Longest, fineness: Fineness::Given(slices), ..settings };
        assert_same(&points, true, &settings)?;
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 72, max_global_rejects: 100_000, ..ProptestConfig::default() })]

    #[test]
    fn the_stream_gives_the_twins_mesh(cloud in twin::clouds::cloud(), settings in settings()) {
        assert_same(&cloud.points, cloud.single, &settings)?;
    }

    #[test]
    fn closing_gives_the_twins_solid(cloud in twin::clouds::cloud(), setting in twin::clouds::setting()) {
        let params = setting.params(&cloud);
        prop_assume!(params.cells.iter().map(|c| u64::from(*c)).product::<u64>() < 5_000);
        assert_same_solid(&cloud.points, &params)?;
    }

    #[test]
    fn winding_cavities_are_told_from_the_exterior(
        occupied in prop::collection::vec(prop::bool::weighted(0.55), 7 * 18 * 7),
        rho in 0u32..=1,
    ) {
        let cells = [7, 18, 7];
        let at = |i: usize| centre([i as u32 % 7, i as u32 / 49, i as u32 / 7 % 7]);
        let points: Vec<[f64; 3]> = (0..occupied.len()).filter(|i| occupied[*i]).map(at).collect();
        let setting = twin::clouds::Setting {
            axis: Some(twin::Axis::Y),
            slices: 18,
            rho,
            smooth: 1,
            diagonals: twin::Diagonals::First,
            slab_slices: 16,
        };
        let cloud = twin::clouds::Cloud { kind: "cells", points: points.clone(), single: true };
        let params = twin::Params { min: [0.0; 3], w: 1.0, cells, ..setting.params(&cloud) };
        prop_assume!(params.axis == twin::Axis::Y);
        assert_same_solid(&points, &params)?;
    }
}

/// Points of several bodies far from each other along one axis, each some cells of side 1 large; gaps as wide as those that are just shortened, and wider.
fn far_apart() -> impl Strategy<Value = Vec<[f64; 3]>> {
    let body = prop::collection::vec(prop::array::uniform3(0.0f32..5.0), 1..60);
    let gap = prop_oneof![3 => 505.0f32..530.0, 2 => 600.0f32..3000.0];
    (prop::collection::vec((body, gap), 2..=3), 0..3usize).prop_map(|(bodies, axis)| {
        let (mut points, mut from) = (Vec::new(), 0.0);
        for (body, gap) in bodies {
            for mut point in body {
                point[axis] += from;
                points.push(point.map(f64::from));
            }
            from += gap;
        }
        points
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 18, ..ProptestConfig::default() })]

    // The field itself has twins in the crate.
    #[test]
    fn means_and_window_do_not_show_in_what_the_field_closes(cloud in twin::clouds::cloud(), settings in settings(), window in 1u32..4) {
        let settings = Settings { seal: Sealing::Auto, window: None, min_component: Some(Least::Auto), ..settings };
        prop_assume!(!too_large(&cloud.points, &settings));
        let ample = match stream(&cloud.points, cloud.single, &settings, Means::Ample) {
            Err(error) if may_be_refused(&settings, &error) => return Ok(()),
            run => run.unwrap(),
        };
        twin::check::check(ample.mesh.0.len(), &ample.mesh.1).map_err(TestCaseError::fail)?;
        assert_means_do_not_show(&cloud.points, cloud.single, &settings, &ample)?;
        let settings = Settings { window: Some(2 * window + 1), ..settings };
        let windowed = stream(&cloud.points, cloud.single, &settings, Means::Ample).unwrap();
        prop_assert!(windowed.mesh == ample.mesh, "window {:?}", settings.window);
    }

    /// Slabs so thin that a chain of retreats goes through several.
    #[test]
    fn pieces_do_not_show_where_slabs_are_thin(
        points in prop::collection::vec([0.0f32..6.0, 0.0f32..20.0, 0.0f32..6.0], 200..1500),
        settings in settings(),
        thin in prop::sample::select(vec![12, 16]),
    ) {
        let points: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
        let settings = Settings {
            axis: AxisChoice::Fixed(Axis::Y),
            fineness: Fineness::Given(Resolution::Slices(60)),
            surface: SurfaceOptions { slab_slices: Some(thin), ..settings.surface },
            ..settings
        };
        let ample = match stream(&points, true, &settings, Means::Ample) {
            Err(error) if may_be_refused(&settings, &error) => return Ok(()),
            run => run.unwrap(),
        };
        assert_means_do_not_show(&points, true, &settings, &ample)?;
    }

    #[test]
    fn wide_gaps_are_shortened_as_the_twin_shortens_them(points in far_apart(), settings in settings()) {
        let settings = Settings { fineness: Fineness::Given(Resolution::Cell(1.0)), ..settings };
        assert_same(&points, true, &settings)?;
    }

    #[test]
    fn wide_gaps_of_landscapes_are_shortened(points in far_apart(), settings in open_settings()) {
        assert_same_open(&points, true, &settings)?;
    }
}

#[test]
fn far_points_do_not_cost_what_lies_between() {
    // A ball of points, and one a million cells away along each axis.
    let ball = (0..4000).map(|i| {
        let (turn, z) = (f64::from(i) * 2.399_963, 1.0 - (f64::from(i) + 0.5) / 2000.0);
        let around = (1.0 - z * z).sqrt();
        [around * turn.cos(), around * turn.sin(), z].map(|c| f64::from((c * 12.0) as f32))
    });
    // On points, as the slices may lie along another axis, in which sums are another in the last bit.
    let surface = SurfaceOptions { fit: Fit::Nearest, ..Settings::default().surface };
    let settings = Settings { fineness: Fineness::Given(Resolution::Cell(1.0)), surface, ..Settings::default() };
    let alone: Vec<[f64; 3]> = ball.collect();
    let with_far: Vec<[f64; 3]> = alone.iter().copied().chain([[1_000_000.0; 3]]).collect();
    let run = stream(&with_far, true, &settings, Means::Ample).unwrap();
    assert!(run.surveyed.grid.has_gaps() && run.surveyed.grid.cells().iter().all(|c| *c < 350));
    assert!(run.surveyed.grid.raw_cells().iter().all(|c| *c > 1_000_000));
    let near = |mesh: &MeshBits| -> std::collections::BTreeSet<[u64; 3]> {
        mesh.0.iter().copied().filter(|v| v.iter().all(|c| f64::from_bits(*c).abs() < 100.0)).collect()
    };
    let other = stream(&alone, true, &settings, Means::Ample).unwrap();
    assert_eq!(near(&run.mesh), near(&other.mesh), "the ball is as it is alone");
}

// The twin looks for intersections among all pairs: up to a few seconds a case.
proptest! {
    #![proptest_config(ProptestConfig { cases: 16, max_global_rejects: 100_000, ..ProptestConfig::default() })]

    #[test]
    #[ignore = "exhaustive"]
    fn a_landscape_gives_the_twins_sheet(points in landscape(), settings in open_settings(), single in any::<bool>()) {
        assert_same_open(&points, single, &settings)?;
    }
}

/// A point in a column that is not kept may lie where the surface is cut off. Vertices there must stay as they are.
#[test]
fn a_point_where_a_sheet_is_cut_off_changes_nothing() {
    let points: [[f32; 3]; 13] = [
        [7.702959, 4.95649, 3.970591],
        [7.9264216, 3.7160394, 1.8026725],
        [6.9158363, 6.2017922, 1.2450856],
        [4.749662, 4.6967387, 0.8690174],
        [5.3498764, 20.18642, 0.51992387],
        [0.12897761, 0.12740351, 0.9882426],
        [1.0782785, 0.34834555, 0.59343386],
        [2.009122, 0.25642765, 0.35788703],
        [3.8200505, 0.29062653, 0.7997195],
        [4.5677495, 0.8286218, 0.205739],
        [5.358371, 0.54062104, 1.1063596],
        [6.5788293, 0.4939087, 0.30423415],
        [0.5, 0.5, 0.5],
    ];
    let points: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
    let settings = Settings {
        fineness: Fineness::Given(Resolution::Cell(1.0)),
        axis: AxisChoice::Fixed(Axis::Z),
        min_component: None,
        surface: SurfaceOptions { diagonals: Diagonals::Random, fit: Fit::Nearest, ..Settings::default().surface },
        open: Some(Open { max_hole: Hole::Cells(3), ..Open::sheet("+x".parse().unwrap()) }),
        ..Settings::default()
    };
    assert_same_open(&points, true, &settings).unwrap();
}

/// Points of a surface, half a cell apart over `size` cells of side 1; `heights` gives those of a place.
fn sampled<I: IntoIterator<Item = f64>>(size: [u32; 2], heights: impl Fn(f64, f64) -> I) -> Vec<[f64; 3]> {
    let places =
        (0..2 * size[0]).flat_map(|i| (0..2 * size[1]).map(move |j| [i, j].map(|c| f64::from(c) * 0.5 + 0.25)));
    places.flat_map(|[x, y]| heights(x, y).into_iter().map(move |z| [x, y, z]).collect::<Vec<_>>()).collect()
}

/// The loops of the boundary of the one sheet that these points become. Unfitted, no triangle looks away.
fn loops_of(what: &str, points: &[[f64; 3]], open: Open) -> usize {
    let settings = Settings {
        fineness: Fineness::Given(Resolution::Cell(1.0)),
        open: Some(open),
        surface: SurfaceOptions { fit: Fit::None, ..Settings::default().surface },
        ..Settings::default()
    };
    let bare = stream(points, false, &settings, Means::Ample).unwrap();
    let places: Vec<[f64; 3]> = bare.mesh.0.iter().map(|v| v.map(f64::from_bits)).collect();
    let (up, positive) = open.facing.axis();
    let (up, sign) = (up.index(), if positive { 1.0 } else { -1.0 });
    // A body has a bottom.
    let faces = if open.base.is_some() { &[] } else { &bare.mesh.1[..] };
    for face in faces {
        let [a, b, c] = face.map(|v| places[v as usize]);
        let [x, y] = [(up + 1) % 3, (up + 2) % 3];
        let looks = (b[x] - a[x]) * (c[y] - a[y]) - (b[y] - a[y]) * (c[x] - a[x]);
        assert!(sign * looks > -1e-9, "{what}: a triangle at {a:?} looks away");
    }
    let settings = Settings { surface: Settings::default().surface, ..settings };
    let fitted = stream(points, false, &settings, Means::Ample).unwrap();
    assert_eq!(fitted.made.counts.tangled, 0, "{what}");
    let [unfitted, loops] = [&bare, &fitted]
        .map(|run| twin::check::check_open(run.mesh.0.len(), &run.mesh.1).unwrap_or_else(|e| panic!("{what}: {e}")));
    assert_eq!(unfitted, loops, "{what}");
    loops
}

#[test]
fn never_a_double_wall() {
    let terrain = Open { max_hole: Hole::Cells(8), ..Open::TERRAIN };
    let size = [40, 36];
    let wave = |x: f64, y: f64| 2.0 * (x * 0.3).sin() + 1.5 * (y * 0.2).cos() + 0.1 * x;
    let within = |c: f64, from: f64, to: f64| (from..to).contains(&c);
    assert_eq!(loops_of("a plane", &sampled(size, |_, _| [3.0]), terrain), 1);
    assert_eq!(loops_of("waves", &sampled(size, |x, y| [wave(x, y)]), terrain), 1);
    let building = |x, y| within(x, 8.0, 16.0) && within(y, 10.0, 22.0);
    let roof = |x: f64, y: f64| if building(x, y) { [12.0] } else { [wave(x, y)] };
    assert_eq!(loops_of("a building", &sampled(size, roof), terrain), 1);
    let canopy = |x: f64, y: f64| {
        let above = if within(x, 20.0, 30.0) && within(y, 5.0, 30.0) { 9.0 } else { wave(x, y) };
        [wave(x, y), above]
    };
    assert_eq!(loops_of("a roof over ground", &sampled(size, canopy), terrain), 1);
    let with_hole = |side: f64| {
        let hole = move |x: f64, y: f64| within(x, 12.0, 12.0 + side) && within(y, 11.0, 11.0 + side);
        sampled(size, move |x, y| (!hole(x, y)).then(|| wave(x, y)))
    };
    assert_eq!(loops_of("a small hole", &with_hole(7.0), terrain), 1);
    assert_eq!(loops_of("a wide hole", &with_hole(14.0), terrain), 2);
    let wider = Open { max_hole: Hole::Length(14.0), ..terrain };
    assert_eq!(loops_of("a hole as wide as may be", &with_hole(14.0), wider), 1);
    let based = Open { base: Some(-9.0), ..terrain };
    assert_eq!(loops_of("a body with a hole", &with_hole(14.0), based), 0);

    // The same on end: a wall with windows, seen from where x falls.
    for facing in ["-x", "+x", "-y", "+y", "-z"] {
        let facing: Facing = facing.parse().unwrap();
        let turn = |points: Vec<[f64; 3]>| -> Vec<[f64; 3]> {
            let axis = facing.axis().0.index();
            let turned = |[a, b, depth]: [f64; 3]| {
                let mut p = [0.0; 3];
                (p[(axis + 1) % 3], p[(axis + 2) % 3], p[axis]) = (a, b, depth);
                p
            };
            points.into_iter().map(turned).collect()
        };
        let sheet = Open { kind: Kind::Sheet, facing, ..terrain };
        assert_eq!(loops_of("a wall", &turn(with_hole(7.0)), sheet), 1, "{facing}");
        assert_eq!(loops_of("a wall with a window", &turn(with_hole(14.0)), sheet), 2, "{facing}");
        // In front of the wall by more than a hole's width: no walls join them, and round the wall's hole there is a boundary, too.
        let sign = if facing.axis().1 { 1.0 } else { -1.0 };
        let post = |x: f64, y: f64| if building(x, y) { [sign * 20.0] } else { [wave(x, y)] };
        assert_eq!(loops_of("a box before a wall", &turn(sampled(size, post)), sheet), 3, "{facing}");
    }
}

/// Points on the box's upper side lie at the end of its highest cells, and what is interpolated between them is no higher.
#[test]
fn a_roof_on_the_upper_side_of_the_box_is_bridged() {
    let within = |c: f64, from: f64, to: f64| (from..to).contains(&c);
    let hole = |x: f64, y: f64| within(x, 7.0, 10.0) && within(y, 5.0, 8.0);
    let roof = |x: f64, y: f64| if x < 4.0 { Some(0.0) } else { (!hole(x, y)).then_some(6.0) };
    let points = sampled([14, 12], roof);
    for facing in ["+z", "-z"] {
        let open = Open { facing: facing.parse().unwrap(), max_hole: Hole::Cells(4), ..Open::TERRAIN };
        assert_eq!(loops_of("a roof with a hole", &points, open), 1, "{facing}");
    }
    let terrain = Open { max_hole: Hole::Cells(4), ..Open::TERRAIN };
    let settings = Settings {
        fineness: Fineness::Given(Resolution::Cell(1.0)),
        open: Some(terrain),
        min_component: None,
        ..Settings::default()
    };
    assert_same_open(&points, false, &settings).unwrap();
}

/// The stream's closing gives the solid that the twin's gives.
fn assert_same_solid(points: &[[f64; 3]], params: &twin::Params) -> Result<(), TestCaseError> {
    let expected = twin::solid(points, params);
    let dir = tempfile::tempdir().unwrap();
    let context = asra_stream::internals::run::testing::context(dir.path(), [64; 3], 2);
    let occupied = points.iter().map(|p| twin::grid::cell_of(*p, params).map(|c| c as u32));
    let occupancy = Occupancy::of_cells(occupied, params.cells, &context).unwrap();
    let closed = Solid::close(&occupancy, &Ball::new(params.rho), &context).unwrap();
    let solid = closed.without_isolated_cells(&context).unwrap();
    let [width, slices, rows] = params.cells;
    let mut ours = vec![false; expected.len()];
    let mut runs = Runs::default();
    for y in 0..slices {
        solid.store.read(y, &mut runs).unwrap();
        for z in 0..rows {
            for run in runs.row(z) {
                for x in run.start..run.end {
                    ours[(x + width * (z + rows * y)) as usize] = true;
                }
            }
        }
    }
    prop_assert!(ours == expected);
    prop_assert_eq!(solid.volume, expected.iter().filter(|s| **s).count() as u64);
    Ok(())
}
