//! `compare` and `densify`.

use serde_json::Value;

use super::folder::{Folder, ply};

/// A tetrahedron of the given side, as ASCII PLY, moved by `origin` by a comment.
fn tetrahedron(side: f64, origin: [f64; 3]) -> String {
    let [x, y, z] = origin;
    format!(
        "ply\nformat ascii 1.0\ncomment origin {x} {y} {z}\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         element face 4\nproperty list uchar int vertex_indices\nend_header\n\
         0 0 0\n{side} 0 0\n0 {side} 0\n0 0 {side}\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"
    )
}

fn json(f: &Folder, name: &str) -> Value {
    serde_json::from_slice(&f.read(name)).unwrap()
}

#[test]
fn a_comparison_is_told_in_words_and_numbers() {
    let f = Folder::new();
    f.write("m.ply", tetrahedron(1.0, [0.0; 3]));
    f.write("r.ply", tetrahedron(2.0, [0.0; 3]));
    let answer = f.ok("compare m.ply r.ply --report c.json");
    for part in [
        "mesh       m.ply\n           4 vertices, 4 triangles; closed",
        "taken as a mesh: 4 vertices, 4 triangles; closed",
        "longest side 2, diagonal 3.4641",
        "from the reference's vertices",
        "AVR (Eq. 6), area by volume                  100 %",
    ] {
        assert!(answer.out.contains(part), "{part:?} is not in\n{}", answer.out);
    }
    let found = json(&f, "c.json");
    assert_eq!(found["reference"]["kind"], "mesh");
    assert_eq!(found["reference_to_mesh"]["points"]["max"]["units"], 1.0);
    assert_eq!(found["reference_to_mesh"]["points"]["max"]["percent_of_longest"], 50.0);
    assert_eq!(found["mesh_to_reference"]["vertices"]["count"], 4);
    for (part, keys) in [
        ("", "avr diagonal longest_side mesh mesh_to_reference mse normal_deviation reference reference_to_mesh"),
        ("/mesh", "area closed path triangles vertices volume"),
        ("/reference", "area closed kind path points triangles volume"),
        ("/mse", "along_normal along_normal_missed nearest nearest_point"),
        ("/mesh_to_reference", "centroids vertices"),
        ("/mesh_to_reference/centroids", "count max mean p95 rms"),
        ("/reference_to_mesh", "centroids points"),
        ("/reference_to_mesh/points/rms", "percent_of_diagonal percent_of_longest units"),
        ("/normal_deviation", "max mean p95 rms"),
    ] {
        let mut names: Vec<&str> =
            found.pointer(part).unwrap().as_object().unwrap().keys().map(String::as_str).collect();
        names.sort_unstable();
        assert_eq!(names.join(" "), keys, "{part}");
    }
    let quiet = f.ok("compare m.ply r.ply -q --report again.json --max-memory 16M -j 1");
    assert_eq!((quiet.out.as_str(), quiet.err.as_str()), ("", ""));
    assert_eq!(json(&f, "again.json"), found);
}

#[test]
fn a_cloud_is_a_reference_and_so_are_the_vertices_of_a_mesh() {
    let f = Folder::new();
    f.knot(5000);
    f.ok("k.ply -o m.ply -q");
    let answer = f.ok("compare m.ply k.ply --report cloud.json");
    assert!(answer.out.contains("taken as a cloud: 5,000 points"), "{}", answer.out);
    let cloud = json(&f, "cloud.json");
    assert_eq!(cloud["reference"]["kind"], "cloud");
    assert_eq!(cloud["mse"]["nearest"], cloud["mse"]["nearest_point"]);
    assert!(
        ["/avr", "/mse/along_normal", "/normal_deviation", "/reference/area", "/reference_to_mesh/centroids"]
            .iter()
            .all(|part| cloud.pointer(part).unwrap().is_null())
    );
    let itself = f.ok("compare m.ply m.ply --as cloud");
    assert!(itself.out.contains("taken as a cloud"), "{}", itself.out);
    f.fails("compare m.ply k.ply --as mesh", 65, &["k.ply: the header: expected one element face"]);
}

#[test]
fn every_format_is_compared_where_it_lies() {
    let f = Folder::new();
    f.ok("generate knot 5000 -o k.bin --offset 512000,5403000,300 --size 100");
    for name in ["m.ply", "m.obj", "m.stl", "m.glb"] {
        f.ok(&format!("k.bin -o {name} -q --overwrite"));
        f.ok(&format!("compare {name} m.ply -q --report c.json"));
        let found = json(&f, "c.json");
        let far = found["mesh_to_reference"]["vertices"]["max"]["units"].as_f64().unwrap();
        assert!(far < 1e-4, "{name}: {far}");
        f.ok(&format!("compare m.ply {name} -q --report c.json"));
        assert_eq!(json(&f, "c.json")["reference"]["kind"], "mesh", "{name}");
        // Fitted vertices are points.
        f.ok(&format!("compare {name} k.bin -q --report c.json"));
        let share = json(&f, "c.json")["reference_to_mesh"]["points"]["rms"]["percent_of_longest"].as_f64().unwrap();
        assert!(share < 1.0, "{name}: {share}");
    }
}

#[test]
fn a_heat_map_has_the_mesh_its_colours_and_distances() {
    let f = Folder::new();
    let origin = [1000.0, 0.0, -5.0];
    f.write("m.ply", tetrahedron(1.0, origin));
    let points = [[1000f32, 0.0, -5.0], [1001.0, 0.0, -5.0], [1000.0, 1.0, -5.0], [1000.0, 0.0, -7.0]];
    f.write("c.ply", ply(&points));
    let answer = f.ok("compare m.ply c.ply --heatmap h.ply --heatmap-max 50%");
    assert!(answer.err.contains("h.ply: distances coloured from 0 to 1\n"), "{}", answer.err);
    let bytes = f.read("h.ply");
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    assert!(header.contains("comment origin 1000 0 -5\n") && header.contains("property float distance\n"), "{header}");
    let distances: Vec<f32> =
        bytes[end..end + 4 * 19].chunks(19).map(|v| f32::from_le_bytes(v[15..19].try_into().unwrap())).collect();
    assert_eq!(distances, [0.0, 0.0, 0.0, 1.0]);
    assert_eq!(bytes[end + 12..end + 15], [38, 13, 76]);
    assert_eq!(bytes[end + 3 * 19 + 12..end + 3 * 19 + 15], [254, 238, 90]);
    // It is a mesh as good as the one it shows.
    f.ok("check h.ply");
    f.ok("compare h.ply m.ply -q --report c.json");
    assert!(json(&f, "c.json")["reference_to_mesh"]["centroids"]["max"]["units"].as_f64().unwrap() < 1e-12);
    f.fails("compare m.ply c.ply --heatmap h.ply", 2, &["h.ply: exists already; pass --overwrite"]);
    f.ok("compare m.ply c.ply --heatmap h.ply --overwrite -q");
    f.fails("compare m.ply c.ply --heatmap h.obj", 2, &["h.obj: a heat map is a PLY file"]);
    f.fails("compare m.ply c.ply --heatmap-max 2", 2, &["--heatmap"]);
    f.fails("compare m.ply c.ply --heatmap x.ply --heatmap-max 0%", 2, &["expected a length above 0"]);
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let f = Folder::new();
    f.write("m.ply", tetrahedron(1.0, [0.0; 3]));
    f.write("c.ply", ply(&[[0.0; 3], [1.0; 3]]));
    f.write("cut.ply", tetrahedron(1.0, [0.0; 3]).trim_end_matches("3 2 0 3\n"));
    f.write("none.ply", tetrahedron(1.0, [0.0; 3]).split("3 0 2 1").next().unwrap().replace("face 4", "face 0"));
    f.write("beyond.ply", tetrahedron(1.0, [0.0; 3]).replace("3 1 2 3", "3 1 2 9"));
    f.write("nan.ply", ply(&[[f32::NAN; 3]]));
    f.write("one.ply", ply(&[[1.0; 3]]));
    f.write("a.las", "nothing");
    // Failures are reported, too; what is there is a report.
    f.write("r.json", "{\"error\": {}}");
    for (line, code, part) in [
        ("gone.ply c.ply", 66, "gone.ply: cannot open"),
        ("m.ply gone.ply", 66, "gone.ply: cannot open"),
        ("c.ply m.ply", 65, "c.ply: the header: expected one element face (is this a point cloud?)"),
        ("cut.ply m.ply", 65, "cut.ply: "),
        ("m.ply cut.ply", 65, "cut.ply: "),
        ("none.ply m.ply", 65, "none.ply: the mesh: expected triangles, found none"),
        ("beyond.ply m.ply", 65, "expected vertex numbers below 4"),
        ("m.ply nan.ply", 65, "the input holds no points (1 records dropped"),
        ("m.ply one.ply", 2, "one.ply: a reference of a single place has no size"),
        ("a.las m.ply", 2, "a.las: not a mesh that can be read"),
    ] {
        f.fails(&format!("compare {line} --report r.json --heatmap h.ply"), code, &[part]);
    }
    f.fails("compare m.ply c.ply --report gone/r.json", 73, &["gone"]);
}

#[test]
fn a_cloud_is_made_denser_in_its_own_coordinates() {
    let f = Folder::new();
    f.ok("generate knot 3000 -o k.ply --offset 512000,5403000,300 --size 100");
    f.ok("k.ply -o m.ply -q --report r.json");
    let triangles = json(&f, "r.json")["output"]["triangles"].as_u64().unwrap();
    let answer = f.ok("densify m.ply k.ply -o d.ply");
    assert!(answer.err.contains("d.ply: 3,000 points and "), "{}", answer.err);
    let (cloud, dense) = (f.read("k.ply"), f.read("d.ply"));
    let all = (3000 + triangles) as usize * 24;
    assert_eq!(
        dense[dense.len() - all..][..3000 * 24],
        cloud[cloud.len() - 3000 * 24..],
        "the points come first, to the bit"
    );
    f.ok("compare m.ply d.ply -q --report c.json");
    let found = json(&f, "c.json");
    assert_eq!(found["reference"]["points"], 3000 + triangles);
    // The distance of a centroid is none, but for rounding.
    assert!(found["mesh_to_reference"]["centroids"]["max"]["units"].as_f64().unwrap() < 1e-8);
    for name in ["d.xyz", "d.bin"] {
        f.ok(&format!("densify m.ply k.ply -o {name} -q"));
        let info = f.ok(&format!("info {name}")).out;
        let ply = f.ok("info d.ply").out;
        let lines = |text: &str| {
            text.lines()
                .filter(|l| ["points", "smallest", "largest"].iter().any(|w| l.starts_with(w)))
                .map(str::to_owned)
                .collect::<Vec<_>>()
        };
        assert_eq!(lines(&info), lines(&ply));
    }
    // Single precision stays single.
    f.ok("generate knot 3000 -o s.bin");
    f.ok("s.bin -o s.ply -q");
    f.ok("densify s.ply s.bin -o t.bin -q");
    let single = f.read("t.bin");
    assert_eq!(single[..36_000], f.read("s.bin"));
    f.fails("densify m.ply k.ply -o d.ply", 2, &["d.ply: exists already"]);
    f.fails("densify m.ply k.ply -o d.las", 2, &["expected a name with .bin, .ply, .xyz or .txt"]);
    f.fails("densify k.ply k.ply -o e.ply", 65, &["k.ply: the header: expected one element face"]);
}
