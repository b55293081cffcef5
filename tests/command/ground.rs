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
    let by_filter = report(&f, "g.json");
    assert_eq!(by_filter["ground"]["filter"]["cell"], 1.0);
    let top = by_filter["check"]["bounds"][1][2].as_f64().unwrap();
    assert!(top < 5.5, "no house, no trees: {top}");

    let tally: serde_json::Value = serde_json::from_str(&f.ok("info c.laz --json").out).unwrap();
    let classes = &tally["classes"];
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
    assert_eq!(&tally["classes"], classes);
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
    f.fails("deg.xyz --surface ground --crs EPSG:4326 -o d.ply", 2, &["--surface ground: ", "degrees"]);
}

#[test]
fn what_cannot_be_asked_of_the_ground_is_refused() {
    let f = Folder::new();
    f.write("s.xyz", scene());
    f.fails("s.xyz --classes 2 -o x.ply", 2, &["--classes: is for --surface ground"]);
    f.fails("s.xyz --write-classes c.laz -o x.ply", 2, &["--write-classes: is for --surface ground"]);
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
