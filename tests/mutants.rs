//! Files that are damaged at random, through every reader: an answer or an error, never a panic. Built with overflow checks, as all tests are.
//!
//! `MUTANTS=10000 cargo test --test mutants -- --nocapture` tries so many, and tells figures. `MUTANTS_FIRST` is the number of the first one, as a failure names it.

#![allow(clippy::disallowed_methods)]

use std::collections::BTreeMap;
use std::io::{Cursor, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use asra_stream::internals::format::read;
use asra_stream::internals::points::attribute::Wanted;
use asra_stream::internals::resources::workers::Workers;
use asra_stream::internals::run::generate::{Options, Shape, generate};
use asra_stream::internals::run::progress::{Progress, Show};
use asra_stream::internals::run::{Job, Resources, look, run};
use asra_stream::internals::storage::spool::Workspace;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const BUDGET: u64 = 64 << 20;

/// Whole files of all formats, by name.
fn seeds(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let path = |name: &str| folder.join(name);
    let workers = Workers::new(1).unwrap();
    for (name, shape) in [("a.ply", Shape::Sphere), ("a.bin", Shape::Torus), ("a.xyz", Shape::Box)] {
        generate(&Options::new(shape, 400, path(name)), &workers, &mut |_| ()).unwrap();
    }
    let resources = Resources { max_memory: Some(BUDGET), ..Resources::default() };
    for name in ["m.ply", "m.stl", "m.obj", "m.glb"] {
        let job = Job { output: Some(path(name)), resources: resources.clone(), ..Job::new([path("a.ply")]) };
        run(&job, &workers, &mut Progress::new(Show::Nothing)).unwrap();
    }
    let mut seeds: Vec<(String, Vec<u8>)> = ["a.ply", "a.bin", "a.xyz", "m.ply", "m.stl", "m.obj", "m.glb"]
        .map(|name| (name.to_string(), std::fs::read(path(name)).unwrap()))
        .to_vec();
    seeds.push(("raw.bin.json".to_string(), std::fs::read(path("a.bin.json")).unwrap()));
    for format in [0, 1, 3, 6, 7, 8] {
        for compressed in [false, true] {
            let name = format!("f{format}.{}", if compressed { "laz" } else { "las" });
            las(format, &path(&name));
            let bytes = std::fs::read(path(&name)).unwrap();
            seeds.push((name, bytes));
        }
    }
    seeds.push(("a.e57".to_string(), e57()));
    let points = [[0.0f32, 0.5, 1.0], [1.5, -2.0, 3.25], [-4.0, 5.0, 6.0], [7.0, 8.0, 9.0]];
    let bytes: &[u8] = bytemuck::cast_slice(&points);
    let pcd = |kind: &str| {
        format!(
            "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 4\nHEIGHT 1\nPOINTS 4\nDATA {kind}\n"
        )
        .into_bytes()
    };
    seeds.push(("b.pcd".to_string(), [pcd("binary"), bytes.to_vec()].concat()));
    seeds.push(("t.pcd".to_string(), [pcd("ascii"), b"0 1 2\n3 4 5\n6 7 8\n9 9 9\n".to_vec()].concat()));
    let mut npy = b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f4', 'fortran_order': False, 'shape': (4, 3), }".to_vec();
    npy.resize(127, b' ');
    npy.push(b'\n');
    seeds.push(("a.npy".to_string(), [npy, bytes.to_vec()].concat()));
    let table = b"id;Easting [m];Northing [m];Height;intensity\n1;1,5;2,5;3,5;7\n2;4,5;5,5;6,5;8\n3;7;8;9;1\n".to_vec();
    seeds.push(("a.csv".to_string(), table));
    let mut zipped = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    zipped.write_all(&seeds[0].1).unwrap();
    seeds.push(("a.ply.gz".to_string(), zipped.finish().unwrap()));
    seeds
}

/// Writes a LAS file, or LAZ, as its name says.
fn las(format: u8, path: &Path) {
    let mut builder = las::Builder::from((1, if format < 6 { 2 } else { 4 }));
    builder.point_format = las::point::Format::new(format).unwrap();
    let header = builder.into_header().unwrap();
    let kind = header.point_format().to_owned();
    let mut writer = las::Writer::from_path(path, header).unwrap();
    for i in 0..600 {
        let at = f64::from(i);
        let point = las::Point {
            x: at * 0.1,
            y: (at * 0.7) % 13.0,
            z: at % 7.0,
            intensity: i as u16,
            gps_time: kind.has_gps_time.then_some(1e5 + at * (1 + i % 3) as f64),
            color: kind.has_color.then_some(las::Color { red: i as u16, green: 2, blue: 500 }),
            nir: kind.has_nir.then_some(i as u16),
            ..Default::default()
        };
        writer.write_point(point).unwrap();
    }
    writer.close().unwrap();
}

fn e57() -> Vec<u8> {
    use e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue};
    let record = |name, data_type| Record { name, data_type };
    let prototype = vec![
        record(RecordName::CartesianX, RecordDataType::F32),
        record(RecordName::CartesianY, RecordDataType::F64),
        record(RecordName::CartesianZ, RecordDataType::Integer { min: -100, max: 1000 }),
    ];
    let mut content = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut content, "file").unwrap();
    let mut scan = writer.add_pointcloud("scan", prototype).unwrap();
    for i in 0..300i64 {
        let values = vec![RecordValue::Single(i as f32), RecordValue::Double(i as f64 * 0.5), RecordValue::Integer(i)];
        scan.add_point(values).unwrap();
    }
    scan.finalize().unwrap();
    writer.finalize().unwrap();
    drop(writer);
    content.into_inner()
}

/// Damages a file in one to four places.
fn mutate(bytes: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    for _ in 0..rng.random_range(1..=4) {
        let len = bytes.len().max(1);
        // Headers are small, and decide most.
        let at = if rng.random_bool(0.6) { rng.random_range(0..len.min(512)) } else { rng.random_range(0..len) };
        if bytes.is_empty() {
            return;
        }
        let run = rng.random_range(1..=8usize).min(bytes.len() - at);
        match rng.random_range(0..8) {
            0 => bytes[at] ^= 1 << rng.random_range(0..8),
            1 => bytes[at] = rng.random(),
            2 => bytes[at..at + run].fill(0xff),
            3 => bytes[at..at + run].fill(0),
            4 => rng.fill_bytes(&mut bytes[at..at + run]),
            5 => bytes.truncate(at),
            6 => drop(bytes.drain(at..at + run)),
            _ => {
                let piece: Vec<u8> = bytes[at..at + run].to_vec();
                let to = rng.random_range(0..=bytes.len());
                drop(bytes.splice(to..to, piece));
            }
        }
    }
}

/// Reads a file as points, and if it may be one, as a mesh.
fn through(path: &Path, folder: &Path, workers: &Workers) -> Result<(), String> {
    let resources =
        Resources { max_memory: Some(BUDGET), temp_dir: Some(folder.to_path_buf()), ..Resources::default() };
    let looked = look(&Job { resources, ..Job::new([path]) }, workers, &mut Progress::new(Show::Nothing)).map(drop);
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let mut seen = looked.map_err(|error| error.to_string());
    if name.starts_with("m.") {
        let workspace = Workspace::new(folder).unwrap();
        let opened = read::open_with(path, &workspace, BUDGET, &Wanted::All).and_then(|mesh| {
            let mut vertices = vec![[0.0; 3]; mesh.vertex_count().min(1 << 16) as usize];
            mesh.read_vertices(0, &mut vertices)?;
            let mut faces = vec![[0; 3]; mesh.face_count().min(1 << 16) as usize];
            mesh.read_faces(0, &mut faces)
        });
        seen = opened.map_err(|error| error.to_string());
    }
    match seen {
        Err(words) if words.starts_with("internal error") => panic!("{words}"),
        other => other,
    }
}

#[test]
fn damaged_files_are_read_or_refused() {
    let number = |name: &str, usual: u64| std::env::var(name).map_or(usual, |n| n.parse().expect("a number"));
    let (first, count) = (number("MUTANTS_FIRST", 0), number("MUTANTS", 400));
    let dir = tempfile::tempdir().unwrap();
    let seeds = seeds(dir.path());
    let temp = dir.path().join("temp");
    std::fs::create_dir(&temp).unwrap();
    let workers = Workers::new(2).unwrap();
    for (name, bytes) in seeds.iter().filter(|(name, _)| name != "raw.bin.json" && name != "a.bin") {
        let path = temp.join(name);
        std::fs::write(&path, bytes).unwrap();
        assert_eq!(through(&path, &temp, &workers), Ok(()), "{name}, undamaged");
        std::fs::remove_file(path).unwrap();
    }
    let (mut read, mut kinds, mut panics) = (0u64, BTreeMap::<String, [u64; 2]>::new(), Vec::new());
    for mutant in first..first + count {
        let mut rng = ChaCha8Rng::seed_from_u64(mutant);
        let (name, bytes) = &seeds[mutant as usize % seeds.len()];
        let mut damaged = bytes.clone();
        mutate(&mut damaged, &mut rng);
        let path: PathBuf = match name.strip_suffix(".json") {
            // A side-car, beside a raw file that is whole.
            Some(raw) => {
                std::fs::write(temp.join(name), &damaged).unwrap();
                std::fs::write(temp.join(raw), &seeds[1].1).unwrap();
                temp.join(raw)
            }
            None => {
                std::fs::write(temp.join(name), &damaged).unwrap();
                temp.join(name)
            }
        };
        let outcome = catch_unwind(AssertUnwindSafe(|| through(&path, &temp, &workers)));
        let kind = kinds.entry(name.rsplit('.').next().unwrap().to_string()).or_default();
        match outcome {
            Ok(Ok(())) => {
                read += 1;
                kind[0] += 1;
            }
            Ok(Err(_)) => kind[1] += 1,
            Err(_) => panics.push(format!("{mutant} ({name})")),
        }
        for entry in std::fs::read_dir(&temp).unwrap() {
            std::fs::remove_file(entry.unwrap().path()).unwrap();
        }
    }
    println!("{count} mutants: {read} read, {} refused, {} panics", count - read - panics.len() as u64, panics.len());
    kinds.iter().for_each(|(kind, [read, refused])| println!("  {kind}: {read} read, {refused} refused"));
    assert!(panics.is_empty(), "panics: {panics:?}");
    assert!(read > count / 20 && read < count, "mutants are neither all the same nor all broken");
}
