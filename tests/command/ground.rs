//! Bare earth: told by classes, or by the filter, whose verdicts can be written.

use super::folder::Folder;

/// Hills of 120 by 80 with a house, trees and a few strays, in steps of a hundredth, as text; every third point is above the ground.
fn scene() -> String {
    let mut state = 5u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1u64 << 24) as f64
    };
    let mut out = String::new();
    for _ in 0..40_000 {
        let (x, y) = (120.0 * next(), 80.0 * next());
        let ground = 3.0 * (x / 30.0).sin() + 2.0 * (y / 25.0).cos();
        let house = (40.0..58.0).contains(&x) && (30.0..42.0).contains(&y);
        let z = match next() {
            _ if house => ground + 7.0,
            share if share < 0.3 && x > 70.0 => ground + 2.0 + 9.0 * next(),
            _ => ground,
        };
        out += &format!("{:.2} {:.2} {z:.2}\n", 700_000.0 + x, 6_200_000.0 + y);
    }
    out
}

fn report(f: &Folder, name: &str) -> serde_json::Value {
    serde_json::from_slice(&f.read(name)).unwrap()
}

#[test]
fn the_filter_tells_the_ground_and_its_verdicts_tell_it_again() {
    let f = Folder::new();
    f.write("s.xyz", scene());
    let ground = "--surface ground --crs EPSG:2154";
    let run = f.ok(&format!("s.xyz {ground} --write-classes c.laz -o g.ply --report g.json -v"));
    assert!(run.err.contains("surface  ground, seen from +z"), "{}", run.err);
    assert!(run.err.contains("no ground, or left out by filters"), "{}", run.err);
    assert!(run.err.contains("ground: told by a filter, as points have no classes"), "{}", run.err);
    let by_filter = report(&f, "g.json");
    assert_eq!(by_filter["ground"]["filter"]["cell"], 1.0);
    let top = by_filter["check"]["bounds"][1][2].as_f64().unwrap();
    assert!(top < 5.5, "no house, no trees: {top}");

    let tally: serde_json::Value = serde_json::from_str(&f.ok("info c.laz --json").out).unwrap();
    let classes = &tally["classification"];
    let count = |class: &str| classes[class].as_u64().unwrap_or_else(|| panic!("{tally}"));
    assert_eq!(count("1") + count("2"), 40_000, "{tally}");
    assert_eq!(count("2"), by_filter["points"]["count"].as_u64().unwrap());

    let run = f.ok("c.laz --surface ground -o c.ply --report c.json");
    assert!(run.err.contains("told by classes 2 and 9"), "{}", run.err);
    let by_classes = report(&f, "c.json");
    assert_eq!(by_classes["ground"]["classes"], "2,9");
    assert_eq!(by_classes["points"]["count"], by_filter["points"]["count"]);
    assert_eq!(by_classes["points"]["filtered"], by_filter["points"]["filtered"]);

    f.ok("c.laz --surface ground --classes 1 -o one.ply --report one.json");
    assert_eq!(report(&f, "one.json")["points"]["count"].as_u64().unwrap(), count("1"));
    // The filter again, and a file without compression.
    f.ok("c.laz --surface ground --classes none --write-classes c.las -o n.ply --report n.json");
    assert_eq!(report(&f, "n.json")["points"]["count"], by_filter["points"]["count"]);
    let tally: serde_json::Value = serde_json::from_str(&f.ok("info c.las --json").out).unwrap();
    assert_eq!(&tally["classification"], classes);
}

/// Points are judged while all else goes on, for which the least budget has room, however little was given.
#[test]
fn the_budget_that_a_refusal_names_is_enough() {
    let f = Folder::new();
    f.write("s.xyz", scene());
    for threads in [1, 2, 5] {
        let run = format!(
            "s.xyz --surface ground --crs EPSG:2154 --write-classes c.laz --dtm d.tif -o g.ply --overwrite -j {threads}"
        );
        let refused = f.run(&format!("{run} --max-memory 1M"));
        let (_, least) = refused.err.split_once("pass --max-memory ").unwrap_or_else(|| panic!("{}", refused.err));
        let (least, _) = least.split_once(' ').unwrap();
        f.ok(&format!("{run} --max-memory {least}"));
    }
}

/// Buildings alone have a lowest surface, too, which is not the ground.
#[test]
fn classes_without_ground_are_told() {
    let f = Folder::new();
    let classed = |class: u8| {
        let lines = scene().lines().map(|line| format!("{},{class}\n", line.replace(' ', ","))).collect::<String>();
        format!("x,y,z,classification\n{lines}")
    };
    for class in [0, 1, 2, 6] {
        f.write("c.csv", classed(class));
        let run = f.ok("c.csv --surface ground --crs EPSG:2154 -o c.ply --overwrite");
        let said = run.err.contains("no point has class 2 (ground), though points have classes")
            && run.err.contains("--classes none");
        assert_eq!(said, class == 6, "{class}: {}", run.err);
        let run = f.ok("c.csv --surface ground --classes none --crs EPSG:2154 -o c.ply --overwrite");
        assert!(!run.err.contains("no point has class"), "{class}: {}", run.err);
    }
}

/// What tells the ground, and what is written with verdicts, is read of compressed points whether the mesh carries it or not.
#[test]
fn a_mesh_without_attributes_has_the_same_ground() {
    let f = Folder::new();
    f.write("s.xyz", scene());
    f.ok("s.xyz --surface ground --write-classes c.laz -o g.ply");
    for (options, verdicts) in [("", ""), ("--classes none ", "--write-classes d.laz "), ("--classes 2 ", "")] {
        let line =
            |name: &str| format!("c.laz --surface ground {options}-o {name}.ply --overwrite --report {name}.json ");
        f.ok(&(line("with") + verdicts));
        let written = (!verdicts.is_empty()).then(|| f.read("d.laz"));
        f.ok(&(line("without") + verdicts + "--attributes none"));
        assert_eq!(
            report(&f, "with.json")["points"]["count"],
            report(&f, "without.json")["points"]["count"],
            "{options}"
        );
        assert_eq!(report(&f, "with.json")["check"]["area"], report(&f, "without.json")["check"]["area"], "{options}");
        assert!(written.is_none_or(|written| written == f.read("d.laz")));
    }
}

#[test]
fn the_ground_is_the_same_for_any_memory_threads_and_order() {
    let f = Folder::new();
    f.write("s.xyz", scene());
    f.ok("s.xyz --surface ground -o a.ply --write-classes a.laz");
    f.ok("s.xyz --surface ground -o b.ply --write-classes b.laz -j 1 --max-memory 64M");
    assert!(f.read("a.ply") == f.read("b.ply") && f.read("a.laz") == f.read("b.laz"));
    let mut lines: Vec<String> = scene().lines().map(str::to_owned).collect();
    lines.reverse();
    f.write("r.xyz", lines.join("\n"));
    f.ok("r.xyz --surface ground -o r.ply -j 3");
    assert!(f.read("a.ply") == f.read("r.ply"));
}

#[test]
fn feet_are_no_metres_and_degrees_have_no_ground() {
    let f = Folder::new();
    f.write("s.xyz", scene());
    let run = f.ok("s.xyz --surface ground -o a.ply");
    assert!(run.err.contains("taken to be the metre; --crs names"), "{}", run.err);
    // The same, in feet of surveys.
    let feet = |line: &str| {
        let feet: Vec<String> =
            line.split(' ').map(|word| format!("{:.3}", word.parse::<f64>().unwrap() / (1200.0 / 3937.0))).collect();
        feet.join(" ") + "\n"
    };
    f.write("ft.xyz", scene().lines().map(feet).collect::<String>());
    f.ok("ft.xyz --surface ground --crs EPSG:2229 -o ft.ply --report ft.json");
    let found = report(&f, "ft.json");
    assert!((found["ground"]["filter"]["cell"].as_f64().unwrap() - 3937.0 / 1200.0).abs() < 1e-9);
    assert!(found["check"]["bounds"][1][2].as_f64().unwrap() < 5.5 / 0.3048);
    f.write("deg.xyz", "1.5 2.5 3\n1.6 2.5 3\n1.6 2.6 3\n");
    f.fails("deg.xyz --surface ground --crs EPSG:4326 -o d.ply", 2, &["--classes: ", "degrees"]);
}

#[test]
fn what_cannot_be_asked_of_the_ground_is_refused() {
    let f = Folder::new();
    f.write("s.xyz", scene());
    f.fails("s.xyz --classes 2 -o x.ply", 2, &["--classes: is for --surface ground, or beside --dtm"]);
    f.fails("s.xyz --write-classes c.laz -o x.ply", 2, &["--write-classes: is for --surface ground, or beside --dtm"]);
    f.fails("s.xyz --surface ground --write-classes c.txt -o x.ply", 2, &["--write-classes c.txt: expected a name"]);
    f.fails("s.xyz --surface ground --classes 2,300 -o x.ply", 2, &["expected auto, none, or classes"]);
    f.fails("s.xyz --surface ground --classes 2 -o x.ply", 2, &["s.xyz: its points have no classification"]);
    f.fails("s.xyz --surface ground --write-classes x.laz -o x.ply --facing +x", 2, &["--facing"]);
    f.ok("s.xyz --surface ground --write-classes c.laz -o g.ply");
    f.fails("s.xyz --surface ground --write-classes c.laz -o h.ply", 2, &["c.laz: exists already"]);
    f.fails("c.laz --surface ground --write-classes c.laz --overwrite -o h.ply", 2, &["c.laz: is an input"]);
    f.fails(
        "c.laz --surface ground --write-classes d.laz -o h.ply",
        2,
        &["--write-classes: the ground is told by the classes", "--classes none"],
    );
    f.fails("c.laz --surface ground --classes 77 -o h.ply", 65, &["no points"]);
    assert!(!f.path("d.laz").exists() && !f.path("h.ply").exists());
}

/// The tags of a TIFF file's directories, with their values as numbers, and the samples of a block of each.
mod tiff {
    use std::collections::HashMap;
    use std::io::Read;

    pub type Tags = HashMap<u16, Vec<f64>>;

    fn int(bytes: &[u8]) -> usize {
        bytes.iter().rev().fold(0, |sum, byte| sum << 8 | usize::from(*byte))
    }

    pub fn directories(file: &[u8]) -> Vec<Tags> {
        assert_eq!(&file[..4], b"II*\0");
        let mut at = int(&file[4..8]);
        let mut out = Vec::new();
        while at > 0 {
            let entries = int(&file[at..at + 2]);
            let mut tags = Tags::new();
            for entry in file[at + 2..][..12 * entries].chunks_exact(12) {
                let (tag, kind, count) = (int(&entry[..2]), int(&entry[2..4]), int(&entry[4..8]));
                let size = [0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8][kind];
                let values = if size * count <= 4 { &entry[8..] } else { &file[int(&entry[8..])..] };
                let number = |value: &[u8]| match kind {
                    12 => f64::from_le_bytes(value.try_into().unwrap()),
                    _ => int(value) as f64,
                };
                tags.insert(tag as u16, values[..size * count].chunks_exact(size).map(number).collect());
            }
            at = int(&file[at + 2 + 12 * entries..][..4]);
            out.push(tags);
        }
        out
    }

    /// The heights of a whole image, row by row.
    pub fn heights(file: &[u8], tags: &Tags) -> (usize, Vec<f32>) {
        let of = |tag: u16| tags[&tag][0] as usize;
        let (width, height, side) = (of(256), of(257), of(322));
        assert_eq!((of(258), of(339), of(317), of(323)), (32, 3, 3, side));
        let mut out = vec![f32::NAN; width * height];
        for (number, (at, len)) in tags[&324].iter().zip(&tags[&325]).enumerate().filter(|(_, (_, len))| **len > 0.0) {
            let mut bytes = Vec::new();
            let packed = &file[*at as usize..][..*len as usize];
            flate2::read::ZlibDecoder::new(packed).read_to_end(&mut bytes).unwrap();
            let across = width.div_ceil(side);
            for row in 0..side {
                // The predictor: differences of bytes along a row, most significant bytes of all samples first.
                let line = &mut bytes[4 * side * row..][..4 * side];
                (1..line.len()).for_each(|i| line[i] = line[i].wrapping_add(line[i - 1]));
                for column in 0..side {
                    let [y, x] = [number / across * side + row, number % across * side + column];
                    if y < height && x < width {
                        let bytes = [0, 1, 2, 3].map(|byte| line[byte * side + column]);
                        out[y * width + x] = f32::from_be_bytes(bytes);
                    }
                }
            }
        }
        (width, out)
    }
}

/// Heights of points by cell, from the text.
fn cells(text: &str, side: f64) -> std::collections::HashMap<[i64; 2], Vec<f64>> {
    let mut out: std::collections::HashMap<[i64; 2], Vec<f64>> = Default::default();
    for line in text.lines() {
        let [x, y, z]: [f64; 3] =
            line.split(' ').map(|word| word.parse().unwrap()).collect::<Vec<f64>>().try_into().unwrap();
        out.entry([y, x].map(|c| (c / side).floor() as i64)).or_default().push(z);
    }
    out
}

#[test]
fn rasters_hold_the_heights_of_cells_where_they_lie() {
    let f = Folder::new();
    f.write("s.xyz", scene());
    let side = 0.5;
    f.ok("s.xyz --surface terrain --crs EPSG:2154 --dsm s.tif --dtm g.tif --raster-size 50cm --max-hole 0c -o m.ply");
    let expected = cells(&scene(), side);
    let file = f.read("s.tif");
    let directories = tiff::directories(&file);
    assert_eq!(directories.len(), 1, "a raster of one block has no overviews");
    let tags = &directories[0];
    let (width, heights) = tiff::heights(&file, tags);
    let (west, north) = (tags[&33922][3], tags[&33922][4]);
    assert_eq!(tags[&33550][..2], [side, side]);
    let keys: Vec<[f64; 4]> = tags[&34735].chunks_exact(4).map(|key| key.try_into().unwrap()).collect();
    assert!(keys.contains(&[3072.0, 0.0, 1.0, 2154.0]) && keys.contains(&[1025.0, 0.0, 1.0, 1.0]), "{keys:?}");
    assert_eq!(tags[&42113].iter().map(|c| *c as u8 as char).collect::<String>(), "nan\0");
    let mut found = 0;
    for (i, height) in heights.iter().enumerate() {
        let cell = [(north / side) as i64 - 1 - (i / width) as i64, (west / side) as i64 + (i % width) as i64];
        match expected.get(&cell) {
            None => assert!(height.is_nan(), "{cell:?}"),
            Some(points) => {
                assert_eq!(f64::from(*height), f64::from(points.iter().copied().fold(f64::MIN, f64::max) as f32));
                found += 1;
            }
        }
    }
    assert_eq!(found, expected.len());

    // The ground: below the house and the trees there is none, and elsewhere it is the mean.
    let file = f.read("g.tif");
    let (width, heights) = tiff::heights(&file, &tiff::directories(&file)[0]);
    let known = heights.iter().filter(|height| !height.is_nan()).count();
    assert!(known > 15_000 && heights.iter().all(|height| height.is_nan() || *height < 5.5), "{known}");
    assert!(width <= 240);

    // A surface of the ground alone has the same raster of all, and the same of the ground; holes are filled by default.
    f.ok("s.xyz --surface ground --crs EPSG:2154 --dsm t.tif --dtm h.tif --raster-size 0.5 --max-hole 0c -o n.ply -j 1 --max-memory 64M");
    assert!(f.read("t.tif") == f.read("s.tif") && f.read("h.tif") == file);
    f.ok("s.xyz --surface ground --crs EPSG:2154 --dtm f.tif --raster-size 0.5 -o o.ply");
    let filled = f.read("f.tif");
    let (_, heights) = tiff::heights(&filled, &tiff::directories(&filled)[0]);
    assert!(heights.iter().filter(|height| !height.is_nan()).count() > known + 1000);
}

#[test]
fn overviews_are_means_of_what_is_known() {
    let f = Folder::new();
    f.ok("generate terrain 60k --size 100 -o t.bin");
    let run = f.ok("t.bin --surface terrain --dsm s.tif --raster-size 0.2 --max-hole 3c -o m.ply");
    assert!(run.err.contains("s.tif: 50"), "{}", run.err);
    let file = f.read("s.tif");
    let levels: Vec<(usize, Vec<f32>)> =
        tiff::directories(&file).iter().map(|tags| tiff::heights(&file, tags)).collect();
    assert_eq!(levels.len(), 2);
    assert_eq!(tiff::directories(&file)[1][&254], [1.0]);
    let ((width, fine), (half, coarse)) = (&levels[0], &levels[1]);
    for (i, height) in coarse.iter().enumerate() {
        let (y, x) = (2 * (i / half), 2 * (i % half));
        let parts = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(dy, dx)| match (y + dy, x + dx) {
            (y, x) if x < *width => fine.get(y * width + x).copied().unwrap_or(f32::NAN),
            _ => f32::NAN,
        });
        let known: Vec<f64> = parts.iter().filter(|part| !part.is_nan()).map(|part| f64::from(*part)).collect();
        let mean = (known.iter().sum::<f64>() / known.len() as f64) as f32;
        assert!(mean.is_nan() && height.is_nan() || mean == *height, "{y} {x}: {height} for {parts:?}");
    }
}

#[test]
fn rasters_that_cannot_be_are_refused() {
    let f = Folder::new();
    f.write("s.xyz", "0 0 1\n1 0 1\n0 1 1\n1 1 1\n1000000000 0 1\n");
    f.fails("s.xyz --surface terrain --dsm s.png -o x.ply", 2, &["--dsm s.png: expected a name with .tif"]);
    f.fails("s.xyz --surface terrain --raster-size 1 -o x.ply", 2, &["--raster-size: is for --dtm and --dsm"]);
    f.fails("s.xyz --surface terrain --dsm s.tif --raster-size 0 -o x.ply", 2, &["--raster-size"]);
    f.fails(
        "s.xyz --surface terrain --dsm s.tif --raster-size 0.001 -o x.ply",
        2,
        &["the raster would be", "--bounds"],
    );
    f.fails("s.xyz --surface terrain --dsm s.tif --dtm s.tif -o x.ply", 2, &["cannot be both"]);
    f.fails("s.xyz --surface terrain --crs EPSG:4326 --dsm s.tif -o x.ply", 2, &["--raster-size: must be given"]);
    assert!(!f.path("s.tif").exists());
}

/// Files beside the mesh get their names with it, and what is there already is told before anything is read.
#[test]
fn a_run_that_fails_leaves_no_file_beside_the_mesh() {
    let f = Folder::new();
    // A line makes a raster, but no surface.
    f.write("line.xyz", (0..200).map(|i| format!("{} 0 0\n", f64::from(i) / 10.0)).collect::<String>());
    f.fails("line.xyz --surface terrain --cell-size 0.5 --dsm s.tif -o line.ply", 65, &["no surface"]);
    assert!(!f.path("s.tif").exists());
    f.write("s.tif", "older");
    f.write("none.xyz", "1 2\n");
    f.fails("none.xyz --surface terrain --dsm s.tif -o line.ply", 2, &["s.tif"]);
    assert_eq!(f.read("s.tif"), b"older");
}

#[test]
fn points_are_clipped_by_polygons() {
    let f = Folder::new();
    f.write("s.xyz", scene());
    f.write("p.wkt", "POLYGON((700010 6200010,700070 6200010,700070 6200050,700010 6200050,700010 6200010))");
    f.ok("s.xyz --surface terrain --cell-size 1 --clip p.wkt -o p.ply");
    f.ok("s.xyz --surface terrain --cell-size 1 --bounds 700010,6200010,700070,6200050 -o b.ply");
    assert!(f.read("p.ply") == f.read("b.ply"), "a box is a box");
    f.write("cross.wkt", "POLYGON((0 0,9 9,9 0,0 9,0 0))");
    f.fails("s.xyz --clip cross.wkt -o x.ply", 65, &["cross.wkt: ", "expected none that cross"]);
    f.fails("s.xyz --clip gone.wkt -o x.ply", 66, &["gone.wkt"]);
    f.write("deg.json", r#"{"type":"Polygon","coordinates":[[[3,43],[4,43],[4,44],[3,43]]]}"#);
    f.fails("s.xyz --crs EPSG:2154 --clip deg.json -o x.ply", 2, &["deg.json: ", "degrees by their looks"]);
    f.write("far.wkt", "POLYGON((0 0,9 0,9 9,0 0))");
    f.fails("s.xyz --clip far.wkt -o x.ply", 65, &["far.wkt: polygons: ", "from 0 0 to 9 9", "lie, from 7000"]);
    f.fails("s.xyz --clip p.wkt --bounds 0,0,9,9 -o x.ply", 65, &["no points", "left out by filters"]);
}
