//! The central test: the stream gives the naive twin's mesh, vertex for vertex, triangle for triangle, bit for bit.

mod twin;

use std::path::Path;

use asra_stream::closing::Sealing;
use asra_stream::error::Error;
use asra_stream::grid::{Axis, AxisChoice, Resolution};
use asra_stream::input::{Cloud, InputOptions, Layout};
use asra_stream::mesh::MeshSource;
use asra_stream::partition::slab_slices;
use asra_stream::pipeline::{Fineness, Reconstruction, Settings, Surveyed, context, reconstruct, survey_cloud};
use asra_stream::plan::MemoryPlan;
use asra_stream::progress::{Progress, Show};
use asra_stream::schedule::Workers;
use asra_stream::slab::{Fit, SurfaceOptions};
use asra_stream::slice::Runs;
use asra_stream::spool::Workspace;
use asra_stream::stage::component::Least;
use asra_stream::stage::dilate::Ball;
use asra_stream::stage::extract::Diagonals;
use asra_stream::stage::raster::Occupancy;
use asra_stream::stage::solid::Solid;
use proptest::prelude::*;

/// A mesh as bits.
type MeshBits = (Vec<[u64; 3]>, Vec<[u32; 3]>);

struct Run {
    surveyed: Surveyed,
    made: Reconstruction,
    mesh: MeshBits,
}

/// The means of a run, which must not show in its result.
#[derive(Debug, Clone, Copy)]
enum Means {
    Ample,
    /// The least budget, and pieces of this many points.
    Least {
        threads: usize,
        piece: usize,
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
        Means::Least { threads, .. } => threads,
    };
    let workers = Workers::new(threads)?;
    let mut progress = Progress::new(Show::Nothing);
    let surveyed = survey_cloud(&cloud, settings, &workers, &mut progress)?;
    let workspace = Workspace::new(dir.path())?;
    let budget = match means {
        Means::Ample => 4 << 30,
        Means::Least { .. } => MemoryPlan::least(&surveyed.load, threads),
    };
    let mut context = context(&surveyed, &workers, &workspace, budget)?;
    if let Means::Least { piece, .. } = means {
        context.memory.piece_points = piece;
        context.memory.bucket_buffer = 64;
        context.memory.buckets_quota = 0;
        context.memory.store_quota = 0;
        context.memory.mesh_quota = 0;
        context.memory.working = 1 << 30;
    }
    let made = reconstruct(&cloud, &surveyed, settings, &context, &mut progress)?;
    let mut vertices = vec![[0.0; 3]; made.mesh.vertex_count() as usize];
    made.mesh.read_vertices(0, &mut vertices)?;
    let mut faces = vec![[0; 3]; made.mesh.face_count() as usize];
    made.mesh.read_faces(0, &mut faces)?;
    let mesh = (vertices.iter().map(|v| v.map(f64::to_bits)).collect(), faces);
    Ok(Run { surveyed, made, mesh })
}

fn naive(points: &[[f64; 3]], single: bool, settings: &Settings, run: &Run) -> MeshBits {
    let grid = &run.surveyed.grid;
    let params = twin::Params {
        axis: [twin::Axis::X, twin::Axis::Y, twin::Axis::Z][grid.axis().index()],
        min: grid.bounds().min,
        w: grid.cell_size(),
        cells: grid.cells(),
        min_points: settings.min_points,
        keep: settings.min_component.map(|least| match least {
            Least::Cells(cells) => twin::Keep::Cells(cells),
            Least::Share(share) => twin::Keep::Share(share),
            Least::Largest => twin::Keep::Largest,
        }),
        rho: run.made.closing.radius,
        level: run.made.closing.level,
        falls: run.made.falls,
        smooth: settings.surface.smooth,
        diagonals: match settings.surface.diagonals {
            Diagonals::Delaunay => twin::Diagonals::Delaunay,
            Diagonals::Random => twin::Diagonals::Random,
            Diagonals::First => twin::Diagonals::First,
        },
        fit: match settings.surface.fit {
            Fit::Nearest => twin::Fit::Nearest,
            Fit::Plane => twin::Fit::Plane,
            Fit::None => twin::Fit::None,
        },
        slab_slices: slab_slices(settings.surface.smooth),
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
    let fit = prop_oneof![4 => Just(Fit::Nearest), 2 => Just(Fit::Plane), 1 => Just(Fit::None)];
    let smooth = prop_oneof![4 => Just(1u32), 1 => Just(0), 1 => Just(2), 1 => Just(3)];
    let min_points = prop_oneof![6 => Just(1u32), 1 => Just(2), 1 => Just(3)];
    let min_component = prop_oneof![
        6 => Just(None),
        1 => Just(Some(Least::Largest)),
        1 => (1u64..30).prop_map(|cells| Some(Least::Cells(cells))),
        1 => (0.0f64..=1.0).prop_map(|share| Some(Least::Share(share))),
    ];
    let seal = prop_oneof![
        3 => Just((Sealing::Auto, None)),
        1 => Just((Sealing::Auto, Some(3u32))),
        1 => Just((Sealing::Auto, Some(5))),
        1 => Just((Sealing::Off, None)),
        // From 10 cells on the ball starts on a coarser level.
        3 => (2u32..=4).prop_map(|cells| (Sealing::Cells(cells), None)),
        1 => (10u32..=11).prop_map(|cells| (Sealing::Cells(cells), None)),
    ];
    (axis, 1u32..=40, seal, smooth, diagonals, fit, min_points, min_component).prop_map(
        |(axis, slices, (seal, window), smooth, diagonals, fit, min_points, min_component)| Settings {
            fineness: Fineness::Given(Resolution::Slices(slices)),
            axis,
            seal,
            window,
            min_points,
            min_component,
            surface: SurfaceOptions { smooth, diagonals, fit },
        },
    )
}

/// Clouds on grids that the twin cannot hold are left out.
fn too_large(points: &[[f64; 3]], settings: &Settings) -> bool {
    let axis = match settings.axis {
        AxisChoice::Longest => None,
        AxisChoice::Fixed(axis) => Some([twin::Axis::X, twin::Axis::Y, twin::Axis::Z][axis.index()]),
    };
    let Fineness::Given(Resolution::Slices(slices)) = settings.fineness else { return true };
    let (.., cells) = twin::grid_for(points, axis, slices);
    cells.iter().map(|c| u64::from(*c)).product::<u64>() > 20_000
}

fn assert_same(points: &[[f64; 3]], single: bool, settings: &Settings) -> Result<(), TestCaseError> {
    prop_assume!(!too_large(points, settings));
    let run = match stream(points, single, settings, Means::Ample) {
        // Nothing is left of a cloud whose cells or components are all too small.
        Err(Error::Usage(_)) if may_be_refused(settings) => return Ok(()),
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
    // Where a cell is no more than some units in the last place, rounding alone brings triangles together.
    let largest = points.as_flattened().iter().fold(0.0f64, |m, c| m.max(c.abs()));
    let unit = largest * if single { f64::from(f32::EPSILON) } else { f64::EPSILON };
    if run.surveyed.grid.cell_size() > 64.0 * unit {
        let places: Vec<[f64; 3]> = run.mesh.0.iter().map(|v| v.map(f64::from_bits)).collect();
        let met = twin::intersect::pairs(&run.mesh.1, &|v| places[v as usize]);
        prop_assert!(met.is_empty() && run.made.counts.tangled == 0, "{} intersections: {:?}", met.len(), met.first());
    }
    for means in [Means::Least { threads: 1, piece: 3 }, Means::Least { threads: 7, piece: 1000 }] {
        let other = stream(points, single, settings, means).unwrap();
        prop_assert!(other.mesh == run.mesh, "{:?} changes the mesh", means);
    }
    let mut reversed = points.to_vec();
    reversed.reverse();
    prop_assert!(stream(&reversed, single, settings, Means::Ample).unwrap().mesh == run.mesh, "order changes the mesh");
    Ok(())
}

/// Whether settings ask for what not every cloud can give: cells that are full enough, components that are large enough, room for a ball.
fn may_be_refused(settings: &Settings) -> bool {
    settings.min_points > 1 || settings.min_component.is_some() || matches!(settings.seal, Sealing::Cells(_))
}

/// The centre of a cell of side 1.
fn centre([x, y, z]: [u32; 3]) -> [f64; 3] {
    [x, y, z].map(|c| f64::from(c) + 0.5)
}

#[test]
fn all_256_corners_give_the_twins_mesh_on_a_seam() {
    let settings = Settings {
        fineness: Fineness::Given(Resolution::Slices(24)),
        axis: AxisChoice::Fixed(Axis::Y),
        window: Some(3),
        ..Settings::default()
    };
    let seam = slab_slices(settings.surface.smooth);
    assert!(seam < 24, "the block lies across a seam");
    for fit in [Fit::Nearest, Fit::Plane, Fit::None] {
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

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, max_global_rejects: 100_000, ..ProptestConfig::default() })]

    #[test]
    fn the_stream_gives_the_twins_mesh(cloud in twin::clouds::cloud(), settings in settings()) {
        assert_same(&cloud.points, cloud.single, &settings)?;
    }

    #[test]
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

/// The stream's closing gives the solid that the twin's gives.
fn assert_same_solid(points: &[[f64; 3]], params: &twin::Params) -> Result<(), TestCaseError> {
    let expected = twin::solid(points, params);
    let dir = tempfile::tempdir().unwrap();
    let context = small_context(dir.path());
    let occupied = points.iter().map(|p| twin::grid::cell_of(*p, params).map(|c| c as u32));
    let occupancy = Occupancy::of_cells(occupied, params.cells, &context).unwrap();
    let closed = Solid::close(&occupancy, &Ball::new(params.rho), &context).unwrap();
    let solid = closed.without_lone_cells(&context).unwrap();
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

/// A context for passes over the slices of small grids.
fn small_context(dir: &Path) -> asra_stream::context::Context {
    use asra_stream::plan::Load;
    use asra_stream::points::Precision;
    let load = Load::in_cells(1000, Precision::Single, [64; 3], 1);
    let memory = MemoryPlan::for_budget(1 << 30, &load, 2).unwrap();
    asra_stream::context::Context {
        workers: Workers::new(2).unwrap(),
        workspace: Workspace::new(dir).unwrap(),
        memory,
        load,
    }
}
