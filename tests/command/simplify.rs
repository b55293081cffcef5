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
