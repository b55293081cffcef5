//! Tilesets keep the rules of 3D Tiles, and are the mesh: nothing twice, nothing missing, no crack within a level, no farther off than they say.

// Tests read folders that nobody makes fail.
#![allow(clippy::disallowed_methods)]

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use asra_stream::internals::mesh::spool::{FaceRecord, MeshSpool};
use asra_stream::internals::mesh::{MeshHeader, MeshSource};
use asra_stream::internals::points::attribute::Schema;
use asra_stream::internals::resources::workers::Workers;
use asra_stream::internals::run::progress::{Progress, Show};
use asra_stream::internals::run::pyramid::{TilesetFigures, TilesetTarget};
use asra_stream::internals::settings::tileset::TilesetOptions;
use asra_stream::internals::storage::spool::Workspace;
use asra_stream::{Attribute, Error, Overwrite, Precision, Scalar};
use serde_json::Value;

type Place = [f64; 3];
/// Corners of a triangle, to the bit.
type Triangle = [[u32; 3]; 3];

/// A mesh of `columns` times `rows` squares, bent by `place`, of which the borders meet if it is `closed`; its vertices have classes and colours.
fn mesh(columns: u32, rows: u32, closed: bool, workspace: &Workspace, place: impl Fn(f64, f64) -> Place) -> MeshSpool {
    let schema = ["classification", "red", "green", "blue"].map(|name| Attribute::new(name, Scalar::U8));
    let mut mesh = MeshSpool::with_attributes(workspace, Precision::Single, Schema::new(schema.to_vec()), 1 << 20);
    let (wide, high) = if closed { (columns, rows) } else { (columns + 1, rows + 1) };
    for y in 0..high {
        for x in 0..wide {
            let at = place(f64::from(x) / f64::from(columns), f64::from(y) / f64::from(rows));
            mesh.append_vertices(&[at]).unwrap();
            mesh.append_attributes(&[(x / 50 % 7) as u8, 200, (y % 256) as u8, 10]).unwrap();
        }
    }
    for y in 0..rows {
        for x in 0..columns {
            let number = |x: u32, y: u32| y % high * wide + x % wide;
            let [a, b, c, d] = [number(x, y), number(x + 1, y), number(x + 1, y + 1), number(x, y + 1)];
            mesh.append_faces(&[FaceRecord::new([a, b, c]), FaceRecord::new([a, c, d])]).unwrap();
        }
    }
    mesh
}

/// Hills, and one corner where triangles are small.
fn terrain(workspace: &Workspace) -> MeshSpool {
    mesh(300, 260, false, workspace, |u, v| {
        let (x, y) = (1000.0 * u * u, 900.0 * v);
        [x, y, 20.0 * (x / 90.0).sin() * (y / 70.0).cos() + 0.6 * (x / 3.1).sin() * (y / 2.7).sin()]
    })
}

fn torus(workspace: &Workspace) -> MeshSpool {
    mesh(300, 130, true, workspace, |u, v| {
        let (u, v) = (u * std::f64::consts::TAU, v * std::f64::consts::TAU);
        let r = 3.0 + (1.0 + 0.1 * (9.0 * u).sin()) * v.cos();
        [r * u.cos(), r * u.sin(), (1.0 + 0.1 * (9.0 * u).sin()) * v.sin()]
    })
}

fn written(mesh: &MeshSpool, sheet: bool, memory: u64, threads: usize, folder: &Path) -> TilesetFigures {
    let workers = Workers::new(threads).unwrap();
    let workspace = Workspace::new(folder.parent().unwrap()).unwrap();
    let header = MeshHeader { sheet, origin: [500_000.0, 0.0, 0.0], ..MeshHeader::default() };
    let header = if sheet { header } else { MeshHeader { origin: [0.0; 3], ..header } };
    let target = TilesetTarget::prepare(&folder.join("tileset.json"), Overwrite::Refuse).unwrap();
    let progress = &mut Progress::new(Show::Nothing);
    target.write(mesh, &header, &TilesetOptions::default(), memory, (&workers, &workspace), progress).unwrap()
}

/// A tile's file: what is its own, and its skirt.
struct Content {
    bounds: [Place; 2],
    own: Vec<Triangle>,
    skirt: Vec<Triangle>,
    classes: BTreeSet<u8>,
}

fn content(path: &Path) -> Content {
    let bytes = std::fs::read(path).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
    let text = &bytes[20..20 + word(12)];
    let binary = &bytes[28 + text.len()..];
    let json: Value = serde_json::from_slice(text).unwrap();
    let accessor = |number: &Value| {
        let accessor = &json["accessors"][number.as_u64().unwrap() as usize];
        let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let first = view["byteOffset"].as_u64().unwrap() as usize;
        let length = view["byteLength"].as_u64().unwrap() as usize;
        (accessor.clone(), &binary[first..first + length])
    };
    let primitives = json["meshes"][0]["primitives"].as_array().unwrap();
    let attributes = &primitives[0]["attributes"];
    let (positions, bytes) = accessor(&attributes["POSITION"]);
    let places: Vec<[f32; 3]> = bytes.chunks_exact(12).map(bytemuck::pod_read_unaligned).collect();
    // As readers take them: in single precision.
    let bound = |key: &str| -> Place { std::array::from_fn(|a| f64::from(positions[key][a].as_f64().unwrap() as f32)) };
    let bounds = [bound("min"), bound("max")];
    for place in &places {
        assert!((0..3).all(|a| bounds[0][a] <= f64::from(place[a]) && f64::from(place[a]) <= bounds[1][a]));
    }
    let (_, normals) = accessor(&attributes["NORMAL"]);
    for normal in normals.chunks_exact(12).map(bytemuck::pod_read_unaligned::<[f32; 3]>) {
        assert!((normal.iter().map(|c| c * c).sum::<f32>() - 1.0).abs() < 1e-4);
    }
    let (classes, bytes) = accessor(&attributes["_CLASSIFICATION"]);
    assert_eq!(classes["componentType"], 5121);
    let classes = bytes.chunks_exact(4).map(|value| value[0]).collect();
    let (colours, _) = accessor(&attributes["COLOR_0"]);
    assert_eq!((&colours["type"], &colours["normalized"]), (&Value::from("VEC4"), &Value::from(true)));
    let triangles = |primitive: &Value| -> Vec<Triangle> {
        let (indices, bytes) = accessor(&primitive["indices"]);
        assert_eq!(indices["componentType"], 5123, "numbers of 16 bits");
        let count = indices["count"].as_u64().unwrap() as usize;
        let numbers: Vec<usize> =
            bytes.chunks_exact(2).map(|b| usize::from(u16::from_le_bytes([b[0], b[1]]))).take(count).collect();
        numbers.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(|v| places[v].map(f32::to_bits))).collect()
    };
    let skirt = primitives.get(1).map(triangles).unwrap_or_default();
    Content { bounds, own: triangles(&primitives[0]), skirt, classes }
}

/// What is found in a tileset: the triangles of each error, the finest last.
struct Found {
    levels: BTreeMap<u64, Vec<Triangle>>,
    skirts: usize,
    deepest: usize,
}

/// Reads a tileset, and holds it to the rules.
fn read(folder: &Path) -> Found {
    let tree: Value = serde_json::from_slice(&std::fs::read(folder.join("tileset.json")).unwrap()).unwrap();
    assert_eq!(tree["asset"]["version"], "1.1");
    assert_eq!(tree["root"]["refine"], "REPLACE");
    assert!(tree["geometricError"].as_f64().unwrap() >= tree["root"]["geometricError"].as_f64().unwrap());
    let mut found = Found { levels: BTreeMap::new(), skirts: 0, deepest: 0 };
    let mut named = BTreeSet::from(["tileset.json".to_owned()]);
    tile(folder, &tree["root"], None, 1, &mut found, &mut named);
    let there: BTreeSet<String> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    assert_eq!(there, named, "every file is a tile's, and every tile has its file");
    found
}

fn volume(tile: &Value) -> [Place; 2] {
    let volume: Vec<f64> =
        tile["boundingVolume"]["box"].as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect();
    let half = [volume[3], volume[7], volume[11]];
    assert!(volume.len() == 12 && half.iter().all(|h| *h >= 0.0));
    [std::array::from_fn(|a| volume[a] - half[a]), std::array::from_fn(|a| volume[a] + half[a])]
}

fn tile(
    folder: &Path,
    tile_: &Value,
    above: Option<([Place; 2], f64)>,
    depth: usize,
    found: &mut Found,
    named: &mut BTreeSet<String>,
) {
    let bounds = volume(tile_);
    let error = tile_["geometricError"].as_f64().unwrap();
    let within = |inner: &[Place; 2], outer: &[Place; 2]| {
        let slack = 1e-6 * (outer[1][0] - outer[0][0]).abs().max(1.0);
        (0..3).all(|a| inner[0][a] >= outer[0][a] - slack && inner[1][a] <= outer[1][a] + slack)
    };
    if let Some((box_above, error_above)) = above {
        assert!(within(&bounds, &box_above), "{bounds:?} in {box_above:?}");
        assert!(error < error_above, "{error} < {error_above}");
    }
    let children = tile_["children"].as_array().cloned().unwrap_or_default();
    assert_eq!(children.is_empty(), error == 0.0, "the finest tiles, and no others, have no error");
    let uri = tile_["content"]["uri"].as_str().unwrap();
    assert!(named.insert(uri.to_owned()), "{uri} is one tile's");
    let content = content(&folder.join(uri));
    assert!(within(&content.bounds, &bounds));
    assert!((1..=1 << 16).contains(&content.own.len()));
    assert!(!content.classes.is_empty());
    found.skirts += content.skirt.len();
    found.deepest = found.deepest.max(depth);
    // Errors are not negative, so their bits are in their order.
    found.levels.entry(error.to_bits()).or_default().extend(content.own);
    children.iter().for_each(|child| tile(folder, child, Some((bounds, error)), depth + 1, found, named));
}

/// The triangles of a mesh, each from its least corner on.
fn triangles(mesh: &MeshSpool) -> Vec<Triangle> {
    let mut places = vec![[0.0; 3]; mesh.vertex_count() as usize];
    mesh.read_vertices(0, &mut places).unwrap();
    let mut faces = vec![[0; 3]; mesh.face_count() as usize];
    mesh.read_faces(0, &mut faces).unwrap();
    faces.iter().map(|face| face.map(|v| places[v as usize].map(|c| (c as f32).to_bits()))).collect()
}

fn sorted(mut triangles: Vec<Triangle>) -> Vec<Triangle> {
    for triangle in &mut triangles {
        let least = (0..3).min_by_key(|i| triangle[*i]).unwrap();
        triangle.rotate_left(least);
    }
    triangles.sort_unstable();
    triangles
}

/// Edges that do not have one triangle on each side.
fn open_edges(triangles: &[Triangle]) -> usize {
    let mut edges: BTreeMap<[[u32; 3]; 2], i32> = BTreeMap::new();
    for [a, b, c] in triangles {
        for [from, to] in [[*a, *b], [*b, *c], [*c, *a]] {
            let (key, sign) = if from < to { ([from, to], 1) } else { ([to, from], -1) };
            *edges.entry(key).or_default() += sign;
        }
    }
    edges.values().filter(|sum| **sum != 0).count()
}

/// The squared distance of a place to a triangle.
fn apart(p: Place, [a, b, c]: [Place; 3]) -> f64 {
    let minus = |p: Place, q: Place| -> Place { std::array::from_fn(|i| p[i] - q[i]) };
    let dot = |p: Place, q: Place| -> f64 { (0..3).map(|i| p[i] * q[i]).sum() };
    let to_segment = |a: Place, b: Place| {
        let (ab, ap) = (minus(b, a), minus(p, a));
        let t = (dot(ap, ab) / dot(ab, ab)).clamp(0.0, 1.0);
        let off: Place = std::array::from_fn(|i| ap[i] - t * ab[i]);
        dot(off, off)
    };
    let (u, v, w) = (minus(b, a), minus(c, a), minus(p, a));
    let (uu, uv, vv, wu, wv) = (dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v));
    let det = uu * vv - uv * uv;
    let (s, t) = ((vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det);
    if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
        let off: Place = std::array::from_fn(|i| w[i] - s * u[i] - t * v[i]);
        return dot(off, off);
    }
    to_segment(a, b).min(to_segment(b, c)).min(to_segment(c, a))
}

#[test]
fn a_tileset_is_the_mesh_at_every_level_without_cracks_and_as_near_as_it_says() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    for (name, mesh, sheet) in [("hills", terrain(&workspace), true), ("torus", torus(&workspace), false)] {
        let folder = dir.path().join(name);
        let figures = written(&mesh, sheet, 256 << 20, 2, &folder);
        let found = read(&folder);
        assert!(figures.levels.len() > 1, "{figures:?}");
        assert_eq!((found.levels.len(), found.deepest), (figures.levels.len(), figures.levels.len()));
        let whole = triangles(&mesh);
        let rim = open_edges(&whole);
        for (number, (error, level)) in found.levels.iter().enumerate() {
            let told = &figures.levels[number];
            // JSON is read to within the last bits.
            let off = (told.error - f64::from_bits(*error)).abs();
            assert!(off <= 1e-12 * told.error && told.triangles == level.len() as u64, "{name} {number}: {told:?}");
            if number == 0 {
                assert_eq!(sorted(level.clone()), sorted(whole.clone()), "{name}: every triangle once");
            }
            // Tiles of a level meet to the last bit, or there would be edges with one triangle; those on the rim become fewer.
            let open = open_edges(level);
            assert!(if sheet { (4..=rim).contains(&open) } else { open == 0 }, "{name} {number}: {open} of {rim}");
            let level: Vec<[Place; 3]> =
                level.iter().map(|t| t.map(|corner| corner.map(|bits| f64::from(f32::from_bits(bits))))).collect();
            for corner in whole.iter().step_by(whole.len() / 60).map(|triangle| triangle[0]) {
                let place = corner.map(|bits| f64::from(f32::from_bits(bits)));
                let nearest = level.iter().map(|triangle| apart(place, *triangle)).fold(f64::INFINITY, f64::min);
                assert!(nearest.sqrt() <= told.error * (1.0 + 1e-9) + 1e-6, "{name} {number}: {}", nearest.sqrt());
            }
        }
        assert_eq!(found.skirts > 0, sheet, "{name}");
        let again = TilesetTarget::prepare(&folder.join("tileset.json"), Overwrite::Refuse);
        assert!(matches!(again, Err(Error::OutputExists(_))), "{name}");
    }
}

#[test]
fn neither_threads_nor_memory_show() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let mesh = torus(&workspace);
    let files = |folder: &Path| -> BTreeMap<String, Vec<u8>> {
        let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
        entries.map(|e| (e.file_name().into_string().unwrap(), std::fs::read(e.path()).unwrap())).collect()
    };
    written(&mesh, false, 512 << 20, 1, &dir.path().join("a"));
    let first = files(&dir.path().join("a"));
    written(&mesh, false, 96 << 20, 3, &dir.path().join("b"));
    assert_eq!(first, files(&dir.path().join("b")));
}

#[test]
fn a_tileset_has_a_folder_of_its_own() {
    for name in ["tileset.json", "/tileset.json", "../tileset.json"] {
        assert!(matches!(TilesetTarget::prepare(Path::new(name), Overwrite::Refuse), Err(Error::Usage(_))), "{name}");
    }
}
