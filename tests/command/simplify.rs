//! `simplify`, and `--simplify` of a run.

use serde_json::Value;

use super::folder::Folder;

fn json(f: &Folder, name: &str) -> Value {
    serde_json::from_slice(&f.read(name)).unwrap()
}

#[test]
fn a_mesh_becomes_lighter_and_stays_sound() {
    let f = Folder::new();
    f.knot(20_000);
    f.ok("k.ply -o full.ply --report full.json");
    let answer = f.ok("simplify full.ply 0.25c -o light.ply --report light.json");
    assert!(answer.err.contains("no place of either surface is farther than"), "{}", answer.err);
    let report = json(&f, "light.json");
    let [before, after] = ["before", "after"].map(|key| report["simplification"][key].as_u64().unwrap());
    assert!(after * 2 < before, "{after} of {before}");
    let cell = json(&f, "full.json")["grid"]["cell_size"].as_f64().unwrap();
    let [asked, reached] = ["asked", "reached"].map(|key| report["simplification"][key].as_f64().unwrap());
    assert!((asked / cell - 0.25).abs() < 1e-12, "{asked} of {cell}");
    assert!(reached <= asked && reached > 0.9 * asked, "{reached} of {asked}");
    f.ok("check light.ply");
    f.ok("compare light.ply full.ply --report c.json -q");
    for (side, what) in
        [("mesh_to_reference", "centroids"), ("reference_to_mesh", "points"), ("reference_to_mesh", "centroids")]
    {
        let most = json(&f, "c.json")[side][what]["max"]["units"].as_f64().unwrap();
        assert!(most <= reached, "{side} {what}: {most}");
    }
    // The same bytes, by any means; and the cells are known once more.
    f.ok("simplify full.ply 0.25c -o again.ply -j 1 --no-intersections --max-memory 100M -q");
    assert_eq!(f.read("light.ply"), f.read("again.ply"));
    f.ok("simplify light.ply 0.5c -o lighter.stl -q");
    f.ok("check lighter.stl");
    f.fails("simplify lighter.stl 0.5c -o x.ply", 2, &["--simplify 0.5c: the mesh does not say how long"]);
    f.fails("simplify full.ply 5mm -o x.ply", 2, &["--simplify 5mm: the unit of the mesh is not known"]);
    f.fails("simplify full.ply -o x.ply", 2, &["<E>"]);
    f.fails("simplify full.ply 0.1% -o full.ply --overwrite", 2, &["full.ply"]);
    f.fails("simplify full.ply 0.1% -o light.ply", 2, &["light.ply"]);
    f.fails(
        "simplify full.ply 0.1% -o x.ply --max-memory 1M",
        71,
        &["simplifying the mesh needs", "pass --max-memory"],
    );
}

#[test]
fn a_run_can_leave_triangles_out() {
    let f = Folder::new();
    f.knot(20_000);
    f.ok("k.ply -o full.ply -q");
    let answer = f.ok("k.ply -o light.ply --simplify 0.25c -v --report r.json");
    assert!(answer.err.contains("no place of either surface is farther than"), "{}", answer.err);
    let report = json(&f, "r.json");
    let figures = &report["simplification"];
    assert_eq!(figures["after"], report["output"]["triangles"]);
    assert_eq!(report["parameters"]["simplify"]["tolerance"]["Cells"], 0.25);
    assert!(report["check"]["closed"].as_bool().unwrap());
    // What the step of a run makes of the mesh is what the command makes of its file.
    f.ok("simplify full.ply 0.25c -o alike.ply --report a.json -q");
    assert_eq!(json(&f, "a.json")["simplification"]["after"], figures["after"]);
    f.ok("k.ply -o few.ply --max-triangles 3k --report few.json -q");
    let few = json(&f, "few.json")["output"]["triangles"].as_u64().unwrap();
    assert!((2500..=3000).contains(&few), "{few}");
    let answer = f.ok("k.ply -o fewer.ply --max-triangles 100 --simplify 0.01c");
    assert!(answer.err.contains("where 100 were asked for"), "{}", answer.err);
    f.fails("k.ply -o x.ply --max-triangles 0", 2, &["--max-triangles 0: at least 1"]);
}

#[test]
fn an_unsound_mesh_is_refused_with_the_counts() {
    let f = Folder::new();
    // Two tetrahedra, one of which runs through the other.
    let corners = "0 0 0\n4 0 0\n0 4 0\n0 0 4\n1 1 -1\n5 1 -1\n1 5 -1\n1 1 3\n";
    let faces = "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n3 4 6 5\n3 4 5 7\n3 5 6 7\n3 6 4 7\n";
    let head = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\nelement face 8\nproperty list uchar int vertex_indices\nend_header\n";
    f.write("m.ply", format!("{head}{corners}{faces}"));
    f.fails(
        "simplify m.ply 0.1 -o x.ply",
        65,
        &["m.ply: the mesh: expected an oriented manifold", "--unsound", "pairs of triangles that intersect"],
    );
    let answer = f.ok("simplify m.ply 0.1 -o x.ply --unsound --report r.json");
    assert!(
        answer.err.contains("warning") && answer.err.contains("pairs of triangles that intersect"),
        "{}",
        answer.err
    );
    assert_eq!(json(&f, "r.json")["simplification"]["after"], 8);
    f.write("empty.ply", head.replace("vertex 8", "vertex 0").replace("face 8", "face 0"));
    f.fails("simplify empty.ply 0.1 -o y.ply", 65, &["empty.ply"]);
}

/// A wavy sheet of so many squares a side, coloured; the classes of its halves differ. Text, in single precision.
fn coloured(side: usize) -> String {
    let (mut vertices, mut faces) = (String::new(), String::new());
    for i in 0..=side {
        for j in 0..=side {
            let (u, v) = (i as f64 / side as f64, j as f64 / side as f64);
            let z = 0.05 * (9.0 * u).sin() * (7.0 * v).cos();
            let colour = [u, v, u * v].map(|c| (255.0 * c) as u8);
            let [r, g, b] = colour;
            vertices += &format!("{u} {v} {z} {r} {g} {b} {} {}\n", 2 + 4 * (2 * i / (side + 1)), 10.0 * u);
            if i < side && j < side {
                let a = i * (side + 1) + j;
                let (b, c, d) = (a + side + 1, a + side + 2, a + 1);
                faces += &format!("3 {a} {b} {c}\n3 {a} {c} {d}\n");
            }
        }
    }
    let names = ["red", "green", "blue", "classification"].map(|name| format!("property uchar {name}\n")).concat();
    let head = format!("ply\nformat ascii 1.0\nelement vertex {}\n", (side + 1) * (side + 1));
    let places = "property float x\nproperty float y\nproperty float z\n";
    let lists = format!("element face {}\nproperty list uchar int vertex_indices\n", 2 * side * side);
    format!("{head}{places}{names}property float height\n{lists}end_header\n{vertices}{faces}")
}

#[test]
fn vertices_move_and_colours_stay_as_they_are_asked_to() {
    let f = Folder::new();
    f.write("m.ply", coloured(60));
    let left = |options: &str, name: &str| -> Value {
        f.ok(&format!("simplify m.ply 0.01 -o {name}.ply --report {name}.json -q {options}"));
        f.ok(&format!("check {name}.ply --open -q"));
        f.ok(&format!("compare {name}.ply m.ply --report c.json -q"));
        let report = json(&f, &format!("{name}.json"));
        let reached = report["simplification"]["reached"].as_f64().unwrap();
        for side in ["mesh_to_reference", "reference_to_mesh"] {
            assert!(json(&f, "c.json")[side]["centroids"]["max"]["units"].as_f64().unwrap() <= reached, "{options}");
        }
        report["simplification"].clone()
    };
    let count = |figures: &Value| figures["after"].as_u64().unwrap();
    let plain = left("", "plain");
    assert!(plain["recoloured"].is_null() && plain["passes"].as_u64().unwrap() >= 1);
    let moved = left("--move-vertices", "moved");
    assert!(count(&moved) <= count(&plain), "{moved} {plain}");
    for (options, name) in [("--keep-colours 3", "kept"), ("--keep-colours 3 --move-vertices", "both")] {
        let kept = left(options, name);
        assert!(kept["recoloured"].as_f64().unwrap() <= 3.0, "{kept}");
        assert!(count(&kept) > count(&plain) && count(&kept) * 2 < 7200, "{kept}");
    }
    left("--move-vertices -j 1 --max-memory 300M", "again");
    assert_eq!(f.read("moved.ply"), f.read("again.ply"));
    f.fails("simplify m.ply 0.01 -o x.ply --keep-colours 256", 2, &["--keep-colours"]);
}

/// One E for all tiles, and where they meet they have the same vertices: each triangle of the whole is in one of them.
#[test]
fn tiles_are_cut_from_what_is_left() {
    let f = Folder::new();
    f.knot(20_000);
    for options in ["", " --move-vertices"] {
        let folder = format!("t{}", options.len());
        f.ok(&format!("k.ply -o {folder}w.ply --simplify 0.25c -q{options}"));
        f.ok(&format!("k.ply -o {folder}.ply --simplify 0.25c --tile 0.5 -q{options} --report r.json"));
        let counts = |name: &str| {
            // Where a tile is cut, its triangles may meet at a vertex alone.
            let code = f.run(&format!("check {name} --open -q --no-intersections --report c.json")).code;
            assert!(matches!(code, 0 | 4), "{name}: {code}");
            json(&f, "c.json")["triangles"].as_u64().unwrap()
        };
        let tiles = f.names(&format!("{folder}.tiles"));
        let tiles: Vec<&String> = tiles.iter().filter(|name| name.ends_with(".ply")).collect();
        assert!(tiles.len() > 3, "{tiles:?}");
        let all: u64 = tiles.iter().map(|name| counts(&format!("{folder}.tiles/{name}"))).sum();
        assert_eq!(all, counts(&format!("{folder}w.ply")));
        assert_eq!(json(&f, "r.json")["simplification"]["after"], all);
    }
}

/// A mesh that runs through itself has no more pairs that do afterwards.
#[test]
fn no_intersections_are_added_to_those_there() {
    let f = Folder::new();
    f.knot(8_000);
    f.ok("k.ply -o k.off.ply -q");
    // Two knots, one moved by half of its thickness: they run through each other.
    let (head, rest) = {
        let bytes = f.read("k.off.ply");
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        (String::from_utf8(bytes[..end].to_vec()).unwrap(), bytes[end..].to_vec())
    };
    let number = |word: &str| -> usize {
        let line = head.lines().find(|line| line.starts_with(&format!("element {word} "))).unwrap();
        line.rsplit(' ').next().unwrap().parse().unwrap()
    };
    let (vertices, faces) = (number("vertex"), number("face"));
    let stride = (rest.len() - 13 * faces) / vertices;
    let mut moved = rest[..stride * vertices].to_vec();
    for vertex in moved.chunks_exact_mut(stride) {
        let x: f32 = bytemuck::pod_read_unaligned(&vertex[..4]);
        vertex[..4].copy_from_slice(&(x + 0.11).to_le_bytes());
    }
    let mut other = rest[stride * vertices..].to_vec();
    for face in other.chunks_exact_mut(13) {
        for corner in 0..3 {
            let at = 1 + 4 * corner;
            let v: u32 = bytemuck::pod_read_unaligned(&face[at..at + 4]);
            face[at..at + 4].copy_from_slice(&(v + vertices as u32).to_le_bytes());
        }
    }
    let head = head.replace(&format!("vertex {vertices}"), &format!("vertex {}", 2 * vertices));
    let head = head.replace(&format!("face {faces}"), &format!("face {}", 2 * faces));
    let (own, triangles) = rest.split_at(stride * vertices);
    f.write("two.ply", [head.as_bytes(), own, &moved, triangles, &other].concat());
    let pairs = |name: &str| {
        f.run(&format!("check {name} -q --report c.json"));
        json(&f, "c.json")["intersections"]["pairs"].as_u64().unwrap()
    };
    let before = pairs("two.ply");
    assert!(before > 0);
    f.fails("simplify two.ply 0.2c -o x.ply", 65, &["pairs of triangles that intersect"]);
    for options in ["", "--move-vertices"] {
        let answer = f.ok(&format!("simplify two.ply 0.2c -o left.ply --overwrite --unsound {options}"));
        assert!(answer.err.contains("pairs of triangles that intersect"), "{}", answer.err);
        let after = pairs("left.ply");
        assert!(after <= before, "{after} of {before}");
    }
}
