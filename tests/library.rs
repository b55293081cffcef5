//! The library as another program uses it: points in memory, a mesh in memory.

use std::ffi::OsString;
use std::ops::Range;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use asra_stream::internals::points::attribute::Attribute;
use asra_stream::internals::points::scalar::Scalar;
use asra_stream::{
    Bounds, Error, ErrorKind, Facing, Fit, Mesh, MeshSink, Observer, PointBuffer, PointSource, PointSpool, Precision,
    Reconstruction, Result, Update,
};

/// Points on a sphere round a centre.
fn sphere(count: usize, centre: [f64; 3]) -> Vec<[f64; 3]> {
    (0..count)
        .map(|i| {
            let z = (2.0 * i as f64 + 1.0) / count as f64 - 1.0;
            let (r, angle) = ((1.0 - z * z).sqrt(), 2.399963 * i as f64);
            [centre[0] + r * angle.cos(), centre[1] + r * angle.sin(), centre[2] + z]
        })
        .collect()
}

fn same(a: &Mesh, b: &Mesh) -> bool {
    a.vertices().unwrap() == b.vertices().unwrap() && a.triangles().unwrap() == b.triangles().unwrap()
}

#[test]
fn a_slice_and_a_file_of_the_same_points_are_the_same_mesh() {
    let points: Vec<[f32; 3]> = sphere(5000, [0.0; 3]).into_iter().map(|p| p.map(|c| c as f32)).collect();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("sphere.xyz.npy");
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (5000, 3), }";
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(bytemuck::cast_slice::<_, u8>(&points));
    std::fs::write(&path, bytes).unwrap();

    let mesh = Reconstruction::of(&points).run().unwrap();
    let from_file = Reconstruction::from_files([&path]).threads(3).max_memory(64 << 20).run().unwrap();
    assert!(same(&mesh, &from_file));
    // Euler's formula for a sphere.
    assert_eq!(2 * mesh.vertex_count(), 4 + mesh.triangle_count());
    let check = mesh.report().check.as_ref().unwrap();
    assert_eq!((check.components, check.genus), (1, Some(0)));
    assert_eq!(mesh.check().unwrap().intersections.unwrap().pairs, 0);

    // And the command's file is the one that the mesh is saved as.
    let saved = dir.path().join("saved.ply");
    mesh.save(&saved).unwrap();
    assert!(matches!(mesh.save(&saved), Err(Error::OutputExists(there)) if there == saved));
    let mut job = asra_stream::internals::run::Job::new([&path]);
    job.output = Some(dir.path().join("command.ply"));
    let workers = job.resources.workers().unwrap();
    let mut progress =
        asra_stream::internals::run::progress::Progress::new(asra_stream::internals::run::progress::Show::Nothing);
    asra_stream::internals::run::run(&job, &workers, &mut progress).unwrap();
    assert!(std::fs::read(saved).unwrap() == std::fs::read(job.output.unwrap()).unwrap());
}

#[test]
fn a_mesh_far_from_zero_has_an_origin_and_the_points_own_coordinates() {
    let centre = [500_000.0, 5_400_000.0, 300.0];
    let mesh = Reconstruction::of(&sphere(4000, centre)).fit(Fit::Nearest).run().unwrap();
    let origin = mesh.origin();
    assert!(origin[0] > 490_000.0 && origin[1] > 5_390_000.0);
    for (vertex, local) in mesh.vertices().unwrap().iter().zip(mesh.local_vertices().unwrap()) {
        for a in 0..3 {
            assert!((vertex[a] - centre[a]).abs() < 1.1);
            assert!((f64::from(local[a]) + origin[a] - vertex[a]).abs() < 1e-5);
        }
    }
    // Fitted vertices are points of the input, bit for bit.
    let points: std::collections::HashSet<[u64; 3]> =
        sphere(4000, centre).into_iter().map(|p| p.map(f64::to_bits)).collect();
    let fitted = mesh.vertices().unwrap().iter().filter(|v| points.contains(&v.map(f64::to_bits))).count();
    assert!(fitted > mesh.vertex_count() / 2, "{fitted} of {}", mesh.vertex_count());
}

#[test]
fn attributes_come_with_their_points() {
    let points = sphere(5000, [0.0; 3]);
    let heights: Vec<f32> = points.iter().map(|p| p[2] as f32).collect();
    let numbers: Vec<u32> = (0..5000).collect();
    let cloud = Reconstruction::of(&points).attribute("height", &heights).attribute("Number", &numbers);
    let mesh = cloud.fit(Fit::Nearest).run().unwrap();
    // One that never changes, and a name that files use for normals: both were asked for.
    let (ones, normals) = ([1u8; 5000], [0.5f64; 5000]);
    let both = Reconstruction::of(&points).attribute("one", &ones).attribute("nx", &normals).run().unwrap();
    assert!(both.attribute("one").unwrap().iter().all(|value| *value == 1.0));
    assert!(both.attribute("nx").unwrap().iter().all(|value| *value == 0.5));
    let (heights, found) = (mesh.attribute("height").unwrap(), mesh.attribute("number").unwrap());
    let mut fitted = 0;
    for ((vertex, height), number) in mesh.vertices().unwrap().into_iter().zip(heights).zip(found) {
        let point = points[number as usize];
        assert_eq!(height, f64::from(point[2] as f32));
        fitted += usize::from(vertex == point);
    }
    assert!(fitted > mesh.vertex_count() / 2);
    let error = mesh.attribute("colour").unwrap_err().to_string();
    assert!(error.contains("colour") && error.contains("height, number"), "{error}");
}

#[test]
fn mistakes_in_attributes_are_told() {
    let points = sphere(100, [0.0; 3]);
    let told = |made: Result<Mesh>| made.unwrap_err().to_string();
    let short = Reconstruction::of(&points).attribute("a", &[1u8; 99]);
    assert!(told(short.run()).contains("99 values for 100 points"));
    let twice = Reconstruction::of(&points).attribute("a", &[1u8; 100]).attribute("A", &[2i16; 100]);
    assert!(told(twice.run()).contains("there twice"));
    let coordinate = Reconstruction::of(&points).attribute("Y", &[1u8; 100]);
    assert!(told(coordinate.run()).contains("a coordinate"));
    let of_file = Reconstruction::from_files(["a.ply"]).attribute("a", &[1u8; 100]);
    assert!(told(of_file.run()).contains("only points in memory"));
}

#[test]
fn what_is_no_cloud_is_an_error() {
    let none: [[f32; 3]; 0] = [];
    assert!(matches!(Reconstruction::of(&none).run(), Err(Error::NoPoints { dropped: 0, .. })));
    let no_numbers = [[f64::NAN, 0.0, 0.0], [f64::INFINITY, 1.0, 2.0]];
    assert!(matches!(Reconstruction::of(&no_numbers).run(), Err(Error::NoPoints { dropped: 2, .. })));
    let points = sphere(1000, [0.0; 3]);
    for (setting, refused) in [
        ("cell_size", Reconstruction::of(&points).cell_size(0.0)),
        ("cell_size", Reconstruction::of(&points).cell_size(f64::NAN)),
        ("window", Reconstruction::of(&points).window(4)),
        ("min_points", Reconstruction::of(&points).min_points(0)),
        ("smooth", Reconstruction::of(&points).smooth(101)),
        ("threads", Reconstruction::of(&points).threads(1 << 20)),
    ] {
        let error = refused.run().unwrap_err();
        assert!(matches!(error, Error::InvalidSetting { name, .. } if name == setting), "{error}");
        assert!(error.to_string().starts_with(&format!("`{setting}` ")), "{error}");
        assert_eq!(error.kind(), ErrorKind::Usage);
    }
    assert!(matches!(Reconstruction::of(&points).max_memory(1).run(), Err(Error::Budget { .. })));
}

/// A source that counts, and may fail.
struct Counting {
    points: Vec<[f64; 3]>,
    asked: AtomicU64,
    fails_after: u64,
    /// Gives one point too few.
    short: bool,
}

impl PointSource for Counting {
    fn len(&self) -> u64 {
        self.points.len() as u64
    }

    fn precision(&self) -> Precision {
        Precision::Double
    }

    fn attributes(&self) -> Vec<Attribute> {
        vec![Attribute::new("half", Scalar::U8)]
    }

    fn read(&self, range: Range<u64>, out: &mut PointBuffer) -> Result<()> {
        if self.asked.fetch_add(1, Ordering::Relaxed) >= self.fails_after {
            return Err(Error::Source("the line is dead".into()));
        }
        let range = range.start as usize..range.end as usize - usize::from(self.short);
        for point in &self.points[range] {
            out.push(*point);
            out.push_attribute(Scalar::U8, f64::from(u8::from(point[0] > 0.0)));
        }
        Ok(())
    }
}

fn counting(fails_after: u64, short: bool) -> Counting {
    Counting { points: sphere(200_000, [0.0; 3]), asked: AtomicU64::new(0), fails_after, short }
}

#[test]
fn a_source_of_ones_own_is_read_in_pieces() {
    let source = counting(u64::MAX, false);
    let mesh = Reconstruction::from_source(&source).run().unwrap();
    assert!(source.asked.load(Ordering::Relaxed) >= 8);
    assert!(same(&mesh, &Reconstruction::of(&source.points).run().unwrap()));
    for (vertex, half) in mesh.vertices().unwrap().iter().zip(mesh.attribute("half").unwrap()) {
        assert!(half == f64::from(u8::from(vertex[0] > 0.0)) || vertex[0].abs() < 0.1);
    }
}

#[test]
fn a_source_that_fails_or_lies_ends_the_run() {
    for fails_after in [0, 3, 5] {
        let error = Reconstruction::from_source(&counting(fails_after, false)).run().unwrap_err();
        assert!(matches!(&error, Error::Source(words) if words.to_string() == "the line is dead"), "{error}");
    }
    let error = Reconstruction::from_source(&counting(u64::MAX, true)).run().unwrap_err();
    assert!(error.to_string().contains("expected 65536 points"), "{error}");
}

#[derive(Default)]
struct Watching {
    stages: Mutex<Vec<(&'static str, bool)>>,
    fractions: Mutex<Vec<f64>>,
    cancel_in: Option<&'static str>,
    cancelled: AtomicBool,
}

impl Observer for Watching {
    fn progress(&self, update: &Update) {
        let mut stages = self.stages.lock().unwrap();
        if stages.last() != Some(&(update.stage.name(), update.ended)) {
            stages.push((update.stage.name(), update.ended));
        }
        self.fractions.lock().unwrap().extend(update.fraction);
        if self.cancel_in == Some(update.stage.name()) {
            self.cancelled.store(true, Ordering::Relaxed);
        }
    }

    fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

#[test]
fn an_observer_is_told_every_stage() {
    let watching = Watching::default();
    Reconstruction::of(&sphere(3000, [0.0; 3])).observer(&watching).run().unwrap();
    let stages = watching.stages.into_inner().unwrap();
    let both = |name| [(name, false), (name, true)];
    let expected = ["survey", "upsample", "bucket", "raster", "seal", "reopen", "surface", "check"].map(both).concat();
    assert_eq!(stages, expected);
    let fractions = watching.fractions.into_inner().unwrap();
    assert!(fractions.is_sorted() && fractions.last() == Some(&1.0), "{fractions:?}");
}

#[test]
fn an_observer_ends_the_run() {
    let watching = Watching { cancel_in: Some("survey"), ..Watching::default() };
    let points = sphere(2_000_000, [0.0; 3]);
    let outcome = Reconstruction::of(&points).observer(&watching).run();
    assert!(matches!(outcome, Err(Error::Interrupted)));
    assert!(watching.stages.into_inner().unwrap().iter().all(|(name, _)| *name != "check"));
}

#[derive(Default)]
struct Taken {
    expected: usize,
    vertices: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    values: Vec<f64>,
    full: bool,
}

impl MeshSink for Taken {
    fn begin(&mut self, mesh: &Mesh) -> Result<()> {
        self.expected = mesh.vertex_count();
        Ok(())
    }

    fn vertices(&mut self, positions: &[[f64; 3]]) -> Result<()> {
        if self.full {
            return Err(Error::Source("full".into()));
        }
        self.vertices.extend_from_slice(positions);
        Ok(())
    }

    fn attribute(&mut self, number: usize, values: &[f64]) -> Result<()> {
        assert_eq!(number, 0);
        self.values.extend_from_slice(values);
        Ok(())
    }

    fn triangles(&mut self, triangles: &[[u32; 3]]) -> Result<()> {
        self.triangles.extend_from_slice(triangles);
        Ok(())
    }
}

#[test]
fn a_sink_gets_the_whole_mesh() {
    let points = sphere(60_000, [1000.0, 0.0, 0.0]);
    let values: Vec<f64> = points.iter().map(|p| p[1]).collect();
    let cloud = || Reconstruction::of(&points).attribute("side", &values);
    let mut taken = Taken::default();
    let report = cloud().run_into(&mut taken).unwrap();
    let mesh = cloud().run().unwrap();
    assert_eq!(taken.vertices.len(), taken.expected);
    assert!(taken.vertices == mesh.vertices().unwrap() && taken.triangles == mesh.triangles().unwrap());
    assert!(taken.values == mesh.attribute("side").unwrap());
    assert_eq!(report.output.triangles, taken.triangles.len() as u64);
    let mut full = Taken { full: true, ..Taken::default() };
    assert!(matches!(cloud().run_into(&mut full), Err(Error::Source(_))));
}

#[test]
fn points_that_come_in_pieces_are_those_of_one_piece() {
    let source = counting(u64::MAX, false);
    let mut spool = PointSpool::new(Precision::Double, source.attributes(), 1 << 20, None).unwrap();
    struct Part<'a>(&'a Counting, Range<u64>);
    impl PointSource for Part<'_> {
        fn len(&self) -> u64 {
            self.1.end - self.1.start
        }
        fn precision(&self) -> Precision {
            Precision::Double
        }
        fn attributes(&self) -> Vec<Attribute> {
            self.0.attributes()
        }
        fn read(&self, range: Range<u64>, out: &mut PointBuffer) -> Result<()> {
            self.0.read(range.start + self.1.start..range.end + self.1.start, out)
        }
    }
    for range in [0..1, 1..1, 1..100_000, 100_000..200_000] {
        spool.append(&Part(&source, range)).unwrap();
    }
    let whole = Reconstruction::from_source(&source).run().unwrap();
    let mesh = Reconstruction::from_source(&spool).run().unwrap();
    assert!(same(&mesh, &whole) && mesh.attribute("half").unwrap() == whole.attribute("half").unwrap());
    let mut single = PointSpool::new(Precision::Single, source.attributes(), 0, None).unwrap();
    assert!(single.append(&source).unwrap_err().to_string().contains("double precision"));
    let mut bare = PointSpool::new(Precision::Double, Vec::new(), 0, None).unwrap();
    assert!(bare.append(&source).unwrap_err().to_string().contains("other attributes"));
}

/// Says that work is to end, from the start.
struct Ended;

impl Observer for Ended {
    fn is_cancelled(&self) -> bool {
        true
    }
}

#[test]
fn a_check_that_was_ended_leaves_a_mesh_that_can_be_checked() {
    let mesh = Reconstruction::of(&sphere(5000, [0.0; 3])).run().unwrap();
    assert!(matches!(mesh.check_observed(&Ended), Err(Error::Interrupted)));
    assert_eq!(mesh.check().unwrap().intersections.unwrap().pairs, 0);
}

/// What the options of a command line make of a file.
fn commanded(path: &Path, options: &str) -> Result<Mesh> {
    let words = ["asra-stream"].into_iter().chain(options.split_whitespace()).chain(["--", "-"]);
    let job = asra_stream::cli::parsed(words.map(OsString::from))?.reconstruct.job()?;
    Reconstruction::from_files([path]).job(job).run()
}

#[test]
fn settings_do_what_the_options_of_their_names_do() {
    let dir = tempfile::tempdir().unwrap();
    // A hill, with a house on it and birds above, in big-endian records after a header of 7 bytes.
    let mut bytes = vec![0u8; 7];
    for i in 0..9000u32 {
        let (x, y) = (f64::from(i) / 9000.0, f64::from(i) * 0.618_034 % 1.0);
        let in_hole = (x - 0.75).hypot(y - 0.3) < 0.04;
        let (lift, class) = match () {
            () if i % 90 == 0 => (0.3, 7u8),
            () if (x - 0.3).abs().max((y - 0.6).abs()) < 0.1 => (0.1, 6),
            () => (0.0, 2),
        };
        if !in_hole {
            let place = [x, y, 0.1 * (6.0 * x).sin() * (5.0 * y).cos() + lift];
            place.into_iter().for_each(|c| bytes.extend((c as f32).to_be_bytes()));
            bytes.extend([class, if i % 3 == 0 { 1 } else { 2 }, 2, u8::from(i % 11 == 0)]);
        }
    }
    let path = dir.path().join("hill.bin");
    std::fs::write(&path, bytes).unwrap();
    let clip = dir.path().join("clip.wkt");
    std::fs::write(&clip, "POLYGON ((0.2 -1, 2 -1, 2 2, 0.2 0.7, 0.2 -1))").unwrap();
    let layout = "xyz,classification:u8,return_number:u8,number_of_returns:u8,withheld:u8";
    let read = format!("--layout {layout} --endian big --skip-bytes 7");
    let reading = || Reconstruction::from_files([&path]).layout(layout.parse().unwrap()).big_endian().skip_bytes(7);
    let same_as_by = |options: &str, mesh: Result<Mesh>| {
        let (mesh, other) = (mesh.unwrap(), commanded(&path, &format!("{read} {options}")).unwrap());
        assert!(same(&mesh, &other) && mesh.attributes() == other.attributes(), "{options}");
        mesh
    };
    let terrain = same_as_by("--surface terrain", reading().terrain().run());
    let bounds = Bounds { min: [0.1, 0.0, -1.0], max: [0.8, 0.9, 1.0] };
    let facing = Facing::Direction([0.1, 0.0, 1.0]);
    let clipped = format!("--clip {}", clip.display());
    for (options, set) in [
        ("--drop-class 7", reading().terrain().drop_class(&[7])),
        ("--keep-class 2,6", reading().terrain().keep_class(&[2, 6])),
        ("--first-return", reading().terrain().first_return()),
        ("--last-return", reading().terrain().last_return()),
        ("--bounds 0.1,0,-1,0.8,0.9,1", reading().terrain().bounds(bounds)),
        (&clipped, reading().terrain().clip(&clip)),
        ("--keep-withheld", reading().terrain().keep_withheld()),
        ("--attributes none", reading().terrain().attributes(&[])),
        ("--attributes classification", reading().terrain().attributes(&["classification"])),
        ("--attributes Class,returnnumber", reading().terrain().attributes(&["Class", "returnnumber"])),
        ("--max-hole 1c", reading().max_hole_cells(1).terrain()),
        ("--max-hole 0.01", reading().terrain().max_hole(0.01)),
        ("--base -0.5", reading().terrain().base(-0.5)),
    ] {
        let mesh = same_as_by(&format!("--surface terrain {options}"), set.run());
        assert!(!same(&mesh, &terrain) || mesh.attributes() != terrain.attributes(), "{options} changes nothing");
    }
    let ground = same_as_by("--surface ground", reading().ground().run());
    let sheet = same_as_by("--surface sheet --facing 0.1,0,1", reading().sheet(facing).run());
    for (options, set) in [
        ("--classes none", reading().ground().classes(&[])),
        ("--classes 2,6", reading().ground().classes(&[2, 6])),
        ("--base -0.5", reading().ground().base(-0.5)),
    ] {
        assert!(!same(&same_as_by(&format!("--surface ground {options}"), set.run()), &ground), "{options}");
    }
    assert!(!same(&ground, &terrain) && !same(&sheet, &terrain));

    let told = |refused: Reconstruction| refused.run().unwrap_err().to_string();
    assert!(told(reading().max_hole(1.0)).starts_with("`max_hole`"));
    assert!(told(reading().base(1.0)).starts_with("`base`"));
    assert!(told(reading().sheet(facing).base(1.0)).starts_with("`base`"));
    assert!(told(reading().terrain().attributes(&["classification", "x"])).contains("\"x\" is no attribute's name"));
    assert!(told(reading().terrain().clip(dir.path().join("none.wkt"))).contains("none.wkt"));
    // Read from the wrong end, nearly all numbers are next to zero, or huge.
    let wrong = reading().little_endian().terrain().run();
    assert!(wrong.map_or(true, |wrong| !same(&wrong, &terrain)));
}
