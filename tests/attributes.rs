//! Attributes: a fitted vertex has its point's own values, to the bit; others have those of a point nearby; filters choose points.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use asra_stream::internals::input::{Filter, InputOptions};
use asra_stream::internals::points::attribute::Wanted;
use asra_stream::internals::resources::workers::Workers;
use asra_stream::internals::run::progress::{Progress, Show};
use asra_stream::internals::run::report::Report;
use asra_stream::internals::run::{Job, Resources, run};
use asra_stream::internals::settings::closing::Sealing;
use asra_stream::internals::settings::surface::{Fit, SurfaceOptions};
use asra_stream::internals::settings::{Fineness, Settings};
use proptest::prelude::*;

/// A point, its intensity and its class.
type Sample = ([f32; 3], u16, u8);

fn write_raw(path: &Path, samples: &[Sample]) {
    let record = |(p, intensity, class): &Sample| {
        let coordinates = p.iter().flat_map(|c| c.to_le_bytes());
        coordinates.chain(intensity.to_le_bytes()).chain([*class]).collect::<Vec<u8>>()
    };
    std::fs::write(path, samples.iter().flat_map(record).collect::<Vec<u8>>()).unwrap();
}

fn job(inputs: &[PathBuf], output: &Path, threads: usize, budget: u64) -> Job {
    let input = InputOptions {
        layout: Some("xyz,i:u16,class:u8".parse().unwrap()),
        attributes: "intensity,classification".parse().unwrap(),
        ..InputOptions::default()
    };
    let temp_dir = Some(output.parent().unwrap().to_path_buf());
    let resources = Resources { threads: Some(threads), max_memory: Some(budget), temp_dir, ..Resources::default() };
    Job { input, resources, output: Some(output.to_path_buf()), ..Job::new(inputs) }
}

fn run_job(job: &Job) -> Report {
    run(job, &job.resources.workers().unwrap(), &mut Progress::new(Show::Nothing)).unwrap()
}

/// The vertices of a PLY file whose properties are `float x y z`, then `extra` bytes.
fn vertices(path: &Path, extra: &[&str]) -> Vec<([f32; 3], Vec<u8>)> {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let mut lines = header.lines().skip_while(|l| !l.starts_with("element vertex"));
    let count: usize = lines.next().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    let properties: Vec<&str> = lines.map_while(|l| l.strip_prefix("property ")).collect();
    assert_eq!(properties, [&["float x", "float y", "float z"], extra].concat());
    let bytes_of = |p: &str| match p.split(' ').next() {
        Some("uchar") => 1,
        Some("ushort") => 2,
        _ => 4,
    };
    let stride: usize = properties.iter().map(|p| bytes_of(p)).sum();
    let record = |r: &[u8]| {
        let coordinate = |a: usize| f32::from_le_bytes(r[4 * a..4 * a + 4].try_into().unwrap());
        ([0, 1, 2].map(coordinate), r[12..].to_vec())
    };
    bytes[end..end + count * stride].chunks_exact(stride).map(record).collect()
}

fn least_records(samples: &[Sample]) -> BTreeMap<[u32; 3], Vec<u8>> {
    let mut out: BTreeMap<[u32; 3], Vec<u8>> = BTreeMap::new();
    for (p, intensity, class) in samples {
        let record = [&intensity.to_le_bytes()[..], &[*class]].concat();
        let known = out.entry(p.map(f32::to_bits)).or_insert_with(|| record.clone());
        *known = record.min(known.clone());
    }
    out
}

/// Points on a bent sheet or a ball, some of them twice.
fn samples() -> impl Strategy<Value = Vec<Sample>> {
    let place = (0.0f32..1.0, 0.0f32..1.0, 0u16..500, 0u8..5, any::<bool>());
    (prop::collection::vec(place, 300..1500), any::<bool>()).prop_map(|(places, ball)| {
        let mut out = Vec::new();
        for (u, v, intensity, class, twice) in places {
            let (sin, cos) = (u * std::f32::consts::TAU).sin_cos();
            let r = (1.0 - (2.0 * v - 1.0).powi(2)).max(0.0).sqrt();
            let p = if ball { [r * cos, 2.0 * v - 1.0, r * sin] } else { [u, 0.7 * v, 0.2 * sin] };
            out.push((p, intensity, class));
            if twice {
                out.push((p, intensity ^ 77, class));
            }
        }
        out
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn vertices_have_their_points_own_values(
        samples in samples(), fit in 0usize..3, k in 2.0f64..6.0, cut in 0.0f64..1.0, seed: u64,
    ) {
        let dir = tempfile::tempdir().unwrap();
        let [whole, first, second, here, there] =
            ["whole.bin", "1.bin", "2.bin", "here.ply", "there.ply"].map(|name| dir.path().join(name));
        write_raw(&whole, &samples);
        let settings = Settings {
            fineness: Fineness::Given(asra_stream::internals::settings::Resolution::K(k)),
            // Every point counts, and no slab lies across a hole, without any.
            seal: Sealing::Off,
            keep_outliers: true,
            min_component: None,
            surface: SurfaceOptions { fit: [Fit::Nearest, Fit::Sphere, Fit::None][fit], ..Settings::default().surface },
            ..Settings::default()
        };
        let report = run_job(&Job { settings, ..job(std::slice::from_ref(&whole), &here, 2, 1 << 30) });
        prop_assert_eq!(&report.points.attributes, &["intensity", "classification"]);
        let records = least_records(&samples);
        let all: BTreeSet<&Vec<u8>> = records.values().collect();
        let mut fitted = 0;
        for (place, record) in vertices(&here, &["ushort intensity", "uchar classification"]) {
            match records.get(&place.map(f32::to_bits)) {
                Some(own) => {
                    fitted += 1;
                    prop_assert_eq!(&record, own);
                }
                None => prop_assert!(all.contains(&record)),
            }
        }
        prop_assert!(fitted as u64 >= report.vertices.fitted);

        // The same points in another order, in two files, by one thread in little memory.
        let mut shuffled = samples.clone();
        shuffled.sort_by_key(|(p, i, _)| p.map(f32::to_bits).iter().fold(seed ^ u64::from(*i), |h, b| {
            (h ^ u64::from(*b)).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(31)
        }));
        let (a, b) = shuffled.split_at((cut * (shuffled.len() - 1) as f64) as usize + 1);
        write_raw(&first, a);
        let mut inputs = vec![first.clone()];
        if !b.is_empty() {
            write_raw(&second, b);
            inputs.push(second.clone());
        }
        run_job(&Job { settings, ..job(&inputs, &there, 1, 48 << 20) });
        prop_assert!(std::fs::read(&here).unwrap() == std::fs::read(&there).unwrap(), "the same bytes");
    }
}

/// A ball of `n` points whose class is 2 above and 7 below; returns 1 and 2 of 2 in turn.
fn ball(n: usize) -> Vec<Sample> {
    let golden = std::f32::consts::PI * (3.0 - 5f32.sqrt());
    let point = |i: usize| {
        let z = 1.0 - 2.0 * (i as f32 + 0.5) / n as f32;
        let (sin, cos) = (golden * i as f32).sin_cos();
        let r = (1.0 - z * z).sqrt();
        ([r * cos, r * sin, z], 1 + (i % 2) as u16, if z > 0.0 { 2 } else { 7 })
    };
    (0..n).map(point).collect()
}

#[test]
fn filters_choose_points_and_are_told_of() {
    let dir = tempfile::tempdir().unwrap();
    let [all, upper, mesh, mesh_upper] = ["all.bin", "upper.bin", "all.ply", "upper.ply"].map(|n| dir.path().join(n));
    let samples = ball(3000);
    write_raw(&all, &samples);
    let above: Vec<Sample> = samples.iter().filter(|s| s.2 == 2).copied().collect();
    write_raw(&upper, &above);
    let expected = run_job(&job(std::slice::from_ref(&upper), &mesh_upper, 2, 1 << 30));
    assert_eq!((expected.points.count, expected.points.filtered), (1500, 0));
    let filters = [
        Filter { drop_class: vec![7], ..Filter::default() },
        Filter { keep_class: vec![2, 9], ..Filter::default() },
        Filter {
            bounds: Some(asra_stream::internals::points::bounds::Bounds { min: [-2.0, -2.0, 0.0], max: [2.0; 3] }),
            ..Filter::default()
        },
    ];
    for filter in filters {
        let mut job = job(std::slice::from_ref(&all), &mesh, 2, 1 << 30);
        job.input.filter = filter;
        job.overwrite = asra_stream::internals::storage::atomic_file::Overwrite::Replace;
        let report = run_job(&job);
        assert_eq!((report.points.count, report.points.filtered), (1500, 1500));
        assert!(std::fs::read(&mesh).unwrap() == std::fs::read(&mesh_upper).unwrap());
        // What only a filter looks at does not come to the mesh.
        job.input.attributes = "intensity".parse().unwrap();
        run_job(&job);
        assert!(
            vertices(&mesh, &["ushort intensity"])
                .iter()
                .all(|(_, record)| [[1, 0], [2, 0]].contains(&[record[0], record[1]]))
        );
        job.input.attributes = Wanted::None;
        run_job(&job);
        vertices(&mesh, &[]);
    }
    let mut job = job(&[all], &dir.path().join("none.ply"), 2, 1 << 30);
    job.input.filter.returns = asra_stream::internals::input::Returns::First;
    let error = run(&job, &Workers::new(1).unwrap(), &mut Progress::new(Show::Nothing)).unwrap_err().to_string();
    assert!(error.contains("all.bin: its points have no return_number"), "{error}");
}

/// Where points are sparse, places between them have the attributes of the nearest point: on a torus, those of its own half.
#[test]
fn places_between_points_have_their_attributes() {
    let dir = tempfile::tempdir().unwrap();
    let [cloud, mesh] = ["torus.bin", "torus.ply"].map(|name| dir.path().join(name));
    let mut state = 5u64;
    let mut turn = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 40) as f32 / (1u64 << 24) as f32 * std::f32::consts::TAU
    };
    let samples: Vec<Sample> = (0..300)
        .map(|_| {
            let ((sin, cos), (up, out)) = (turn().sin_cos(), turn().sin_cos());
            let far = 1.0 + 0.25 * out;
            let (intensity, class) = if cos > 0.0 { (900, 6) } else { (100, 2) };
            ([far * cos, far * sin, 0.25 * up], intensity, class)
        })
        .collect();
    write_raw(&cloud, &samples);
    let report = run_job(&job(&[cloud], &mesh, 2, 1 << 30));
    assert!(report.points.added > 4 * 300, "{}", report.points.added);
    let mut of_half = [0; 2];
    for (place, record) in vertices(&mesh, &["ushort intensity", "uchar classification"]) {
        // Within a sampling distance of the middle, a vertex may be nearest to a point of the other half.
        if place[0].abs() > 0.3 {
            of_half[usize::from(place[0] > 0.0)] += 1;
            let own: (u16, u8) = if place[0] > 0.0 { (900, 6) } else { (100, 2) };
            assert_eq!(record, [&own.0.to_le_bytes()[..], &[own.1]].concat(), "{place:?}");
        }
    }
    assert!(of_half.iter().all(|vertices| *vertices > 500), "{of_half:?}");
}
