//! A mesh for each input: one surface, whose borders agree to the bit.

use std::collections::{BTreeMap, BTreeSet};

use super::folder::Folder;

type Vertex = [u64; 3];
type Triangle = [Vertex; 3];

/// Hills with blocks on them and strays above, as text of four tiles; the last covers less than its quarter, so that a gap lies between it and the others.
fn tiles(f: &Folder) {
    let mut state = 11u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1u64 << 24) as f64
    };
    let mut texts = [const { String::new() }; 4];
    for _ in 0..24_000 {
        let (x, y) = (60.0 * next(), 60.0 * next());
        let block = (x / 7.0) as u32 % 3 == 1 && (y / 9.0) as u32 % 2 == 1;
        let stray = if next() < 0.01 { 6.0 * next() } else { 0.0 };
        let z = 2.0 * (x / 12.0).sin() + (y / 9.0).cos() + if block { 4.0 } else { stray };
        let number = usize::from(x > 30.0) + 2 * usize::from(y > 30.0);
        if number < 3 || x > 32.0 && y > 32.5 {
            texts[number] += &format!("{:.2} {:.2} {z:.2}\n", 700_000.0 + x, 6_200_000.0 + y);
        }
    }
    f.make("tiles");
    for (name, text) in ["c", "a", "d", "b"].iter().zip(texts) {
        f.write(&format!("tiles/{name}.xyz"), text);
    }
}

/// The triangles of a mesh in PLY with coordinates in double precision and nothing else, by the bits of their corners.
fn triangles(ply: &[u8]) -> Vec<Triangle> {
    let end = ply.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&ply[..end]).unwrap();
    let count = |what: &str| -> usize {
        header.lines().find_map(|line| line.strip_prefix(what)).unwrap().trim().parse().unwrap()
    };
    let (vertices, faces) = ply[end..].split_at(24 * count("element vertex"));
    let place = |face: &[u8], corner: usize| {
        let number = u32::from_le_bytes(face[1 + 4 * corner..][..4].try_into().unwrap()) as usize;
        [0, 1, 2].map(|a| u64::from_le_bytes(vertices[24 * number + 8 * a..][..8].try_into().unwrap()))
    };
    assert_eq!(faces.len(), 13 * count("element face"));
    faces.chunks_exact(13).map(|face| [0, 1, 2].map(|corner| place(face, corner))).collect()
}

/// The edges that only one of the triangles has, as that goes along them.
fn rim(triangles: &[Triangle]) -> BTreeSet<[Vertex; 2]> {
    let edges: BTreeSet<[Vertex; 2]> =
        triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]).collect();
    edges.iter().filter(|[a, b]| !edges.contains(&[*b, *a])).copied().collect()
}

#[test]
fn the_meshes_of_a_batch_are_one_surface_to_the_bit_in_any_order_of_inputs() {
    let f = Folder::new();
    tiles(&f);
    let options = "--surface terrain --cell-size auto";
    f.ok(&format!("tiles {options} -o one.ply"));
    let run = f.ok(&format!("tiles {options} --batch -o city.ply --report r.json"));
    assert!(run.err.contains("output   city.tiles, 4 tiles and an index, "), "{}", run.err);
    let names = ["a.ply", "b.ply", "c.ply", "d.ply"];
    assert_eq!(f.names("city.tiles"), [&names[..], &["index.json"]].concat().iter().map(|n| (*n).to_owned()).collect());
    let index: serde_json::Value = serde_json::from_slice(&f.read("city.tiles/index.json")).unwrap();
    let of: Vec<&str> = index["tiles"].as_array().unwrap().iter().map(|t| t["input"].as_str().unwrap()).collect();
    assert_eq!(of, ["tiles/a.xyz", "tiles/b.xyz", "tiles/c.xyz", "tiles/d.xyz"]);

    let parts: BTreeMap<&str, Vec<Triangle>> =
        names.iter().map(|name| (*name, triangles(&f.read(&format!("city.tiles/{name}"))))).collect();
    let whole = triangles(&f.read("one.ply"));
    let sorted = |mut triangles: Vec<Triangle>| {
        triangles.sort_unstable();
        triangles
    };
    assert!(sorted(parts.values().flatten().copied().collect()) == sorted(whole.clone()));
    // Every edge at the border of a mesh is one at the border of the whole, or one other mesh has it, the other way round.
    let outer = rim(&whole);
    let rims: BTreeMap<&str, BTreeSet<[Vertex; 2]>> = parts.iter().map(|(name, part)| (*name, rim(part))).collect();
    let mut shared = BTreeSet::new();
    for (name, edges) in &rims {
        for [a, b] in edges.iter().filter(|edge| !outer.contains(*edge)) {
            let others: Vec<&str> =
                rims.iter().filter(|(_, rim)| rim.contains(&[*b, *a])).map(|(other, _)| *other).collect();
            assert_eq!(others.len(), 1, "{name}");
            shared.insert((*name, others[0]));
        }
    }
    // Each has two neighbours at least: c and a lie below d and b.
    for pair in [("a.ply", "c.ply"), ("b.ply", "d.ply"), ("c.ply", "d.ply"), ("a.ply", "b.ply")] {
        assert!(shared.contains(&pair), "{pair:?} of {shared:?}");
    }
    // Most of a mesh lies where its input does.
    for (name, [x, y]) in [("c.ply", [0, 0]), ("a.ply", [1, 0]), ("d.ply", [0, 1]), ("b.ply", [1, 1])] {
        let low = [700_000.0 + 30.0 * f64::from(x), 6_200_000.0 + 30.0 * f64::from(y)];
        let inside = |v: &Vertex| (0..2).all(|a| (low[a] - 3.0..low[a] + 33.0).contains(&f64::from_bits(v[a])));
        assert!(parts[name].as_flattened().iter().all(inside), "{name}");
    }

    let lines = [
        "tiles/d.xyz tiles/a.xyz tiles/b.xyz tiles/c.xyz -j 1 --max-memory 64M",
        "tiles/b.xyz tiles/c.xyz tiles/d.xyz tiles/a.xyz -j 3",
    ];
    for (number, inputs) in lines.iter().enumerate() {
        f.ok(&format!("{inputs} {options} --batch -o again{number}.ply -q"));
        for name in names.iter().chain(&["index.json"]) {
            assert!(f.read(&format!("again{number}.tiles/{name}")) == f.read(&format!("city.tiles/{name}")), "{name}");
        }
    }
}

#[test]
fn inputs_without_points_have_no_mesh_and_names_must_differ() {
    let f = Folder::new();
    tiles(&f);
    let run = f.ok("tiles --surface terrain --cell-size 1 --batch --bounds 700000,6200000,700029,6200060 -o west.ply");
    assert!(run.err.contains("tiles/a.xyz: no points that count, and so no mesh"), "{}", run.err);
    assert_eq!(f.names("west.tiles"), ["c.ply", "d.ply", "index.json"].map(str::to_owned).into());
    f.fails("tiles --surface terrain --batch -o west.ply", 2, &["west.tiles: exists already"]);
    f.fails("tiles --surface terrain --batch -o x.stl", 2, &["--batch: x.stl names no PLY or GLB files"]);
    f.fails("tiles --surface terrain --batch --tile 20 -o x.ply", 2, &["--batch", "--tile"]);
    f.make("more");
    f.write("more/a.txt", f.read("tiles/a.xyz"));
    f.fails(
        "tiles more --surface terrain --batch -o x.ply",
        2,
        &["--batch: the meshes of more/a.txt and tiles/a.xyz would have the same name, a"],
    );
    f.fails("- --layout xyz --surface terrain --batch -o x.ply", 2, &["--batch: standard input has no name"]);
}
