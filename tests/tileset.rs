//! Tilesets keep the rules of 3D Tiles, and are the mesh: nothing twice, nothing missing, no crack within a level, no farther off than they say.

// Tests read folders that nobody makes fail.
#![allow(clippy::disallowed_methods)]

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use asra_stream::internals::mesh::spool::{FaceRecord, MeshSpool};
use asra_stream::internals::mesh::{MeshHeader, MeshSource};
use asra_stream::internals::points::attribute::Schema;
use asra_stream::internals::points::crs::Crs;
use asra_stream::internals::resources::workers::Workers;
use asra_stream::internals::run::progress::{Progress, Show};
use asra_stream::internals::run::pyramid::{TilesetFigures, TilesetTarget};
use asra_stream::internals::run::saved_mesh::Means;
use asra_stream::internals::settings::tileset::{Compression, TilesetOptions};
use asra_stream::internals::storage::spool::Workspace;
use asra_stream::{Attribute, Error, Overwrite, Precision, Scalar};
use meshopt_rs::index::buffer::decode_index_buffer;
use meshopt_rs::vertex::buffer::decode_vertex_buffer;
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

/// Rough land beside flat land, on which coarse triangles are long.
fn rough_and_flat(workspace: &Workspace) -> MeshSpool {
    mesh(500, 400, false, workspace, |u, v| {
        let (x, y) = (1000.0 * u, 800.0 * v);
        let rough = if u < 0.6 { (x * 1.7 + 2.0 * (y / 3.0).sin()).sin() * (y * 1.3).cos() } else { 0.0 };
        [x, y, 3.0 * rough + 4.0 * (-((x - 800.0).powi(2) + (y - 300.0).powi(2)) / 40.0).exp()]
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
    let origin = if sheet { [500_000.0, 0.0, 0.0] } else { [0.0; 3] };
    let header = MeshHeader { sheet, origin, ..MeshHeader::default() };
    written_as(mesh, &header, &TilesetOptions::default(), (memory, threads), folder).unwrap()
}

/// A tileset of a mesh that stands where its header's reference system says.
fn written_as(
    mesh: &dyn MeshSource,
    header: &MeshHeader,
    options: &TilesetOptions,
    (memory, threads): (u64, usize),
    folder: &Path,
) -> Result<TilesetFigures, Error> {
    let workers = Workers::new(threads).unwrap();
    let workspace = Workspace::new(folder.parent().unwrap()).unwrap();
    let mut target = TilesetTarget::prepare(&folder.join("tileset.json"), Overwrite::Refuse)?;
    target.georeference(header.crs.as_ref(), options)?;
    let means = Means { memory, workers: &workers, workspace: &workspace, kept: None };
    target.write(mesh, header, options, means, &mut Progress::new(Show::Nothing))
}

/// A stream as a reader decodes it.
fn decoded(stream: &[u8], told: &Value) -> Vec<u8> {
    let count = told["count"].as_u64().unwrap() as usize;
    match (told["mode"].as_str().unwrap(), told["byteStride"].as_u64().unwrap()) {
        ("ATTRIBUTES", 4) => {
            let mut out = vec![[0u8; 4]; count];
            decode_vertex_buffer(&mut out, stream).unwrap();
            out.into_flattened()
        }
        ("ATTRIBUTES", 8) => {
            let mut out = vec![[0u8; 8]; count];
            decode_vertex_buffer(&mut out, stream).unwrap();
            out.into_flattened()
        }
        ("TRIANGLES", 2) => {
            let mut out = vec![0u32; count];
            decode_index_buffer(&mut out, stream).unwrap();
            out.into_iter().flat_map(|v| u16::try_from(v).unwrap().to_le_bytes()).collect()
        }
        other => panic!("{other:?}"),
    }
}

/// A tile's file: what is its own, and what overlaps others, its skirt included.
struct Content {
    bounds: [Place; 2],
    own: Vec<Triangle>,
    overlap: Vec<Triangle>,
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
        let part = |view: &Value| {
            assert_eq!(view["buffer"], 0);
            let first = view["byteOffset"].as_u64().unwrap() as usize;
            &binary[first..first + view["byteLength"].as_u64().unwrap() as usize]
        };
        let encoded = &view["extensions"]["EXT_meshopt_compression"];
        let bytes = if encoded.is_null() { part(view).to_vec() } else { decoded(part(encoded), encoded) };
        assert_eq!(bytes.len() as u64, view["byteLength"].as_u64().unwrap());
        (accessor.clone(), bytes)
    };
    let primitives = json["meshes"][0]["primitives"].as_array().unwrap();
    let attributes = &primitives[0]["attributes"];
    let (positions, bytes) = accessor(&attributes["POSITION"]);
    // As readers take them: in single precision.
    let number = |value: &Value| value.as_f64().unwrap() as f32;
    let whole = positions["componentType"] == 5123;
    assert_eq!(whole, json["extensionsRequired"][0] == "KHR_mesh_quantization");
    let node = &json["nodes"][1];
    let moved = |place: [f32; 3]| match whole {
        true => std::array::from_fn(|a| number(&node["translation"][a]) + number(&node["scale"][a]) * place[a]),
        false => place,
    };
    let places: Vec<[f32; 3]> = match whole {
        true => bytes
            .chunks_exact(8)
            .map(bytemuck::pod_read_unaligned::<[u16; 4]>)
            .map(|[x, y, z, _]| moved([x, y, z].map(f32::from)))
            .collect(),
        false => bytes.chunks_exact(12).map(bytemuck::pod_read_unaligned).collect(),
    };
    let bound = |key: &str| -> Place { moved(std::array::from_fn(|a| number(&positions[key][a]))).map(f64::from) };
    let bounds = [bound("min"), bound("max")];
    for place in &places {
        assert!((0..3).all(|a| bounds[0][a] <= f64::from(place[a]) && f64::from(place[a]) <= bounds[1][a]));
    }
    let (_, normals) = accessor(&attributes["NORMAL"]);
    let normals: Vec<[f32; 3]> = match whole {
        true => normals.chunks_exact(4).map(|b| [b[0], b[1], b[2]].map(|c| f32::from(c as i8) / 127.0)).collect(),
        false => normals.chunks_exact(12).map(bytemuck::pod_read_unaligned::<[f32; 3]>).collect(),
    };
    assert_eq!(normals.len(), places.len());
    for normal in normals {
        assert!((normal.iter().map(|c| c * c).sum::<f32>() - 1.0).abs() < if whole { 0.02 } else { 1e-4 });
    }
    let (classes, bytes) = accessor(&attributes["_CLASSIFICATION"]);
    assert_eq!(classes["componentType"], 5121);
    let classes = bytes.chunks_exact(4).map(|value| value[0]).collect();
    let (colours, bytes) = accessor(&attributes["COLOR_0"]);
    assert_eq!((&colours["type"], &colours["normalized"]), (&Value::from("VEC4"), &Value::from(true)));
    // All red is 200 of 255, or 2: in linear light, of 65,535.
    let reds: BTreeSet<u16> = bytes.chunks_exact(8).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
    assert!(reds.iter().all(|red| [37_852, 40].contains(red)), "{reds:?}");
    let triangles = |primitive: &Value| -> Vec<Triangle> {
        let (indices, bytes) = accessor(&primitive["indices"]);
        assert_eq!(indices["componentType"], 5123, "numbers of 16 bits");
        let count = indices["count"].as_u64().unwrap() as usize;
        let numbers: Vec<usize> =
            bytes.chunks_exact(2).map(|b| usize::from(u16::from_le_bytes([b[0], b[1]]))).take(count).collect();
        numbers.chunks_exact(3).map(|t| [t[0], t[1], t[2]].map(|v| places[v].map(f32::to_bits))).collect()
    };
    let overlap = primitives.get(1).map(triangles).unwrap_or_default();
    Content { bounds, own: triangles(&primitives[0]), overlap, classes }
}

/// A tile as it is shown.
struct Shown {
    error: f64,
    own: Vec<Triangle>,
    overlap: Vec<Triangle>,
    children: Vec<usize>,
}

/// What is found in a tileset.
struct Found {
    /// The triangles of each error.
    levels: BTreeMap<u64, Vec<Triangle>>,
    tiles: Vec<Shown>,
    deepest: usize,
    /// Column by column.
    transform: [f64; 16],
}

impl Found {
    fn overlaps(&self) -> usize {
        self.tiles.iter().map(|tile| tile.overlap.len()).sum()
    }

    /// Triangles of skirts: no level's.
    fn skirts(&self) -> usize {
        let levels = self.levels.iter().map(|(error, level)| (*error, sorted(level.clone()).into_iter().collect()));
        let levels: BTreeMap<u64, BTreeSet<Triangle>> = levels.collect();
        let of_tile = |tile: &Shown| {
            let level = &levels[&tile.error.to_bits()];
            sorted(tile.overlap.clone()).iter().filter(|triangle| !level.contains(*triangle)).count()
        };
        self.tiles.iter().map(of_tile).sum()
    }

    /// How far the farthest place of the finest level is from what is shown beside the tiles that show it, over the error: where a tile gives way to those below it and the
    /// others of its level stay, of every tile.
    fn farthest_beside(&self) -> f64 {
        let finest = self.levels.values().next().unwrap();
        let mut worst: f64 = 0.0;
        for tile in self.tiles.iter().filter(|tile| !tile.children.is_empty()) {
            let others = self.tiles.iter().filter(|other| other.error == tile.error && !std::ptr::eq(*other, tile));
            let below = tile.children.iter().map(|child| &self.tiles[*child]);
            let shown: Vec<Triangle> =
                others.chain(below).flat_map(|tile| tile.own.iter().chain(&tile.overlap)).copied().collect();
            let middles = finest.iter().step_by(finest.len() / 700 + 1).map(|triangle| {
                let places = triangle.map(|corner| corner.map(f32::from_bits));
                std::array::from_fn::<u32, 3, _>(|a| ((places[0][a] + places[1][a] + places[2][a]) / 3.0).to_bits())
            });
            worst = worst.max(farthest(&middles.collect::<Vec<_>>(), &shown) / tile.error);
        }
        worst
    }

    /// What the root's transform makes of a place.
    fn moved(&self, place: [u32; 3]) -> Place {
        let [x, y, z] = place.map(|bits| f64::from(f32::from_bits(bits)));
        let m = &self.transform;
        std::array::from_fn(|i| m[i] * x + m[4 + i] * y + m[8 + i] * z + m[12 + i])
    }
}

/// A tileset's transform: it turns and moves, and does nothing else.
fn transform(root: &Value) -> [f64; 16] {
    let mut m = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    if let Some(numbers) = root["transform"].as_array() {
        assert_eq!(numbers.len(), 16);
        (0..16).for_each(|i| m[i] = numbers[i].as_f64().unwrap());
    }
    assert!(m.iter().all(|number| number.is_finite()));
    assert_eq!([m[3], m[7], m[11], m[15]], [0.0, 0.0, 0.0, 1.0]);
    let column = |c: usize| [m[4 * c], m[4 * c + 1], m[4 * c + 2]];
    let dot = |a: Place, b: Place| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    for a in 0..3 {
        for b in 0..3 {
            assert!((dot(column(a), column(b)) - f64::from(u8::from(a == b))).abs() < 1e-12, "{m:?}");
        }
    }
    let [x, y, z] = [column(0), column(1), column(2)];
    let across = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    assert!(dot(across, z) > 0.0, "no mirror image");
    m
}

/// Reads a tileset, and holds it to the rules.
fn read(folder: &Path) -> Found {
    read_with(folder, 0.0)
}

/// Reads a tileset whose finest level has an error: that of a lattice.
fn read_with(folder: &Path, finest: f64) -> Found {
    let tree: Value = serde_json::from_slice(&std::fs::read(folder.join("tileset.json")).unwrap()).unwrap();
    assert_eq!(tree["asset"]["version"], "1.1");
    assert_eq!(tree["root"]["refine"], "REPLACE");
    assert!(tree["geometricError"].as_f64().unwrap() >= tree["root"]["geometricError"].as_f64().unwrap());
    let transform = transform(&tree["root"]);
    let mut found = Found { levels: BTreeMap::new(), tiles: Vec::new(), deepest: 0, transform };
    let mut named = BTreeSet::from(["tileset.json".to_owned()]);
    tile(folder, &tree["root"], (None, finest), 1, &mut found, &mut named);
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
    (above, finest): (Option<([Place; 2], f64)>, f64),
    depth: usize,
    found: &mut Found,
    named: &mut BTreeSet<String>,
) -> usize {
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
    assert_eq!(
        children.is_empty(),
        error == finest,
        "the finest tiles, and no others, have no error but the lattice's"
    );
    let uri = tile_["content"]["uri"].as_str().unwrap();
    assert!(named.insert(uri.to_owned()), "{uri} is one tile's");
    let content = content(&folder.join(uri));
    assert!(within(&content.bounds, &bounds));
    assert!((1..=1 << 16).contains(&content.own.len()));
    assert!(!content.classes.is_empty());
    found.deepest = found.deepest.max(depth);
    // Errors are not negative, so their bits are in their order.
    found.levels.entry(error.to_bits()).or_default().extend(&content.own);
    let number = found.tiles.len();
    found.tiles.push(Shown { error, own: content.own, overlap: content.overlap, children: Vec::new() });
    for child in &children {
        let child = tile(folder, child, (Some((bounds, error)), finest), depth + 1, found, named);
        found.tiles[number].children.push(child);
    }
    number
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
        // Of all three ways to say it: two corners may be at one place.
        let [a, b, c] = *triangle;
        *triangle = [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap();
    }
    triangles.sort_unstable();
    triangles
}

/// Edges that do not have one triangle on each side.
fn open_edges(triangles: &[Triangle]) -> usize {
    let mut edges: BTreeMap<[[u32; 3]; 2], i32> = BTreeMap::new();
    for [a, b, c] in triangles {
        // On a lattice, two vertices may come to one place: an edge without length is no crack.
        for [from, to] in [[*a, *b], [*b, *c], [*c, *a]].into_iter().filter(|[from, to]| from != to) {
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

/// How far the farthest of some places is from a level.
fn farthest(places: &[[u32; 3]], level: &[Triangle]) -> f64 {
    let place = |corner: &[u32; 3]| corner.map(|bits| f64::from(f32::from_bits(bits)));
    let level: Vec<[Place; 3]> = level.iter().map(|t| t.map(|corner| place(&corner))).collect();
    let nearest = |p: &[u32; 3]| {
        let p = place(p);
        level.iter().fold(f64::INFINITY, |least, t| {
            // Of most triangles the box is too far away.
            let beyond = |a: usize| {
                let (low, high) = (t[0][a].min(t[1][a]).min(t[2][a]), t[0][a].max(t[1][a]).max(t[2][a]));
                (low - p[a]).max(p[a] - high).max(0.0)
            };
            if (0..3).any(|a| beyond(a) * beyond(a) >= least) { least } else { least.min(apart(p, *t)) }
        })
    };
    places.iter().map(nearest).fold(0.0, f64::max).sqrt()
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
            let places: Vec<[u32; 3]> = whole.iter().step_by(whole.len() / 60).map(|triangle| triangle[0]).collect();
            let farthest = farthest(&places, level);
            assert!(farthest <= told.error * (1.0 + 1e-9) + 1e-6, "{name} {number}: {farthest}");
        }
        assert_eq!(found.skirts() > 0, sheet, "{name}");
        // The transform adds the origin.
        assert_eq!(found.transform[12..15], if sheet { [500_000.0, 0.0, 0.0] } else { [0.0; 3] });
        assert_eq!(figures.site, None, "{name}");
        let again = TilesetTarget::prepare(&folder.join("tileset.json"), Overwrite::Refuse);
        assert!(matches!(again, Err(Error::OutputExists(_))), "{name}");
    }
}

#[test]
fn there_are_no_holes_where_tiles_of_two_levels_meet() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    for (name, mesh, sheet) in [("land", rough_and_flat(&workspace), true), ("torus", torus(&workspace), false)] {
        let folder = dir.path().join(name);
        written(&mesh, sheet, 256 << 20, 2, &folder);
        let found = read(&folder);
        let beside = |tile: &Shown| found.tiles.iter().filter(|other| other.error == tile.error).count() > 1;
        let meet = found.tiles.iter().filter(|tile| !tile.children.is_empty() && beside(tile)).count();
        assert!(meet > 1 || !sheet, "{name}: no tile could be shown beside finer ones");
        let farthest = found.farthest_beside();
        assert!(farthest <= 1.0 + 1e-6, "{name}: {farthest} of the error");
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

/// A mesh of some places in double precision: a fan about the first.
fn fan(places: &[Place], workspace: &Workspace) -> MeshSpool {
    let schema = ["classification", "red", "green", "blue"].map(|name| Attribute::new(name, Scalar::U8));
    let mut mesh = MeshSpool::with_attributes(workspace, Precision::Double, Schema::new(schema.to_vec()), 1 << 20);
    mesh.append_vertices(places).unwrap();
    mesh.append_attributes(&vec![2; 4 * places.len()]).unwrap();
    for v in 1..places.len() as u32 - 1 {
        mesh.append_faces(&[FaceRecord::new([0, v, v + 1])]).unwrap();
    }
    mesh
}

fn distance(a: Place, b: Place) -> f64 {
    (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum::<f64>().sqrt()
}

#[test]
fn places_of_a_tileset_on_earth_agree_with_another_program_to_the_millimetre() {
    // By pyproj 3.7.2 (PROJ 9.5.1): to longitude and latitude, then `+proj=cart`. Metres of UTM; feet and survey feet of state planes; degrees; a map at twice the scale.
    let facts: [(&str, [(Place, Place); 3]); 6] = [
        (
            "EPSG:25832",
            [
                ([691_000.125, 5_334_000.5, 519.25], [4_178_639.230_52, 855_247.774_33, 4_726_965.688_06]),
                ([692_999.75, 5_335_999.875, 571.0], [4_176_849.346_86, 856_989.560_94, 4_728_292.975_99]),
                ([691_500.375, 5_335_250.625, 540.5], [4_177_645.045_63, 855_597.230_69, 4_727_804.206_36]),
            ],
        ),
        (
            "EPSG:2992",
            [
                ([637_000.25, 850_000.5, 400.125], [-2_505_381.619_75, -3_847_692.312_28, 4_412_403.354_47]),
                ([641_250.0, 853_100.75, 655.5], [-2_503_977.782_22, -3_847_855.463_84, 4_413_165.460_59]),
                ([638_500.125, 851_000.0, 512.0], [-2_504_898.970_74, -3_847_771.217_94, 4_412_656.230_86]),
            ],
        ),
        (
            "EPSG:2229",
            [
                ([6_480_000.5, 1_845_000.25, 310.5], [-2_505_219.691_03, -4_658_610.902_00, 3_552_185.213_42]),
                ([6_484_125.0, 1_849_000.0, 402.25], [-2_503_801.916_52, -4_658_621.956_04, 3_553_213.522_34]),
                ([6_482_000.75, 1_846_500.5, 350.0], [-2_504_566.768_59, -4_658_681.455_33, 3_552_572.116_86]),
            ],
        ),
        // Heights in metres above a map in feet.
        (
            "EPSG:2992+5703",
            [
                ([637_000.25, 850_000.5, 121.9581], [-2_505_381.619_75, -3_847_692.312_28, 4_412_403.354_47]),
                ([641_250.0, 853_100.75, 199.7964], [-2_503_977.782_22, -3_847_855.463_84, 4_413_165.460_59]),
                ([638_500.125, 851_000.0, 156.0576], [-2_504_898.970_74, -3_847_771.217_94, 4_412_656.230_86]),
            ],
        ),
        (
            "EPSG:4326",
            [
                ([11.5, 48.1375, 519.0], [4_179_075.146_65, 850_242.448_05, 4_727_479.451_11]),
                ([11.5125, 48.14375, 530.5], [4_178_389.851_10, 851_052.381_52, 4_727_951.802_10]),
                ([11.50625, 48.139_062_5, 501.25], [4_178_843.964_36, 850_670.133_74, 4_727_582.183_14]),
            ],
        ),
        (
            "EPSG:3857",
            [
                ([1_113_194.5, 8_399_737.875, 12.5], [3_148_539.581_27, 555_172.270_37, 5_500_487.955_55]),
                ([1_115_000.25, 8_401_000.0, 80.0], [3_147_876.901_46, 555_974.389_87, 5_500_862.156_52]),
                ([1_114_000.0, 8_400_200.125, 33.75], [3_148_282.630_25, 555_536.933_07, 5_500_622.010_79]),
            ],
        ),
    ];
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    for (number, (system, places)) in facts.iter().enumerate() {
        let mesh = fan(&places.map(|(place, _)| place), &workspace);
        let header = MeshHeader { sheet: true, crs: Crs::parse(system), ..MeshHeader::default() };
        let folder = dir.path().join(number.to_string());
        let figures = written_as(&mesh, &header, &TilesetOptions::default(), (64 << 20, 1), &folder).unwrap();
        let found = read(&folder);
        let corners: Vec<Place> = found.levels[&0][0].iter().map(|corner| found.moved(*corner)).collect();
        for (place, expected) in places {
            let off = corners.iter().map(|corner| distance(*corner, *expected)).fold(f64::INFINITY, f64::min);
            assert!(off < 1e-3, "{system} {place:?}: {off}");
        }
        // Up is away from the Earth, and the site is where the transform says.
        let up: Place = std::array::from_fn(|a| found.transform[8 + a]);
        let from_centre = distance([0.0; 3], corners[0]);
        assert!((0..3).map(|a| up[a] * corners[0][a] / from_centre).sum::<f64>() > 0.999);
        let site = figures.site.unwrap();
        assert!((100.0..700.0).contains(&site.height) || *system == "EPSG:3857", "{site}");
        // Heights are raised by an offset.
        let options = TilesetOptions { height_offset: Some(48.5), ..TilesetOptions::default() };
        let raised =
            written_as(&mesh, &header, &options, (64 << 20, 1), &dir.path().join(format!("{number}-up"))).unwrap();
        assert!((raised.site.unwrap().height - site.height - 48.5).abs() < 1e-6, "{system}");
    }
}

#[test]
fn levels_on_earth_are_as_near_in_metres_as_they_say_and_meet_to_the_last_bit() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    // On a map at twice the scale, where heights are as high as they are: 3 km are one and a half.
    let (east, north) = (1_113_194.5, 8_399_737.875);
    let mesh = mesh(300, 260, false, &workspace, |u, v| {
        let (x, y) = (3000.0 * u, 2700.0 * v);
        [x, y, 20.0 * (x / 90.0).sin() * (y / 70.0).cos() + 0.6 * (x / 3.1).sin() * (y / 2.7).sin()]
    });
    let origin = [east, north, 100.0];
    let header = MeshHeader { sheet: true, crs: Crs::parse("EPSG:3857"), origin, ..MeshHeader::default() };
    let folder = dir.path().join("a");
    let figures = written_as(&mesh, &header, &TilesetOptions::default(), (256 << 20, 2), &folder).unwrap();
    let found = read(&folder);
    assert!(figures.levels.len() > 1, "{figures:?}");
    // A sphere's map for places on the ellipsoid.
    let (a, e2): (f64, f64) = (6_378_137.0, 0.006_694_379_990_141_316);
    let centred = |[x, y, z]: Place| -> Place {
        let (longitude, latitude) = ((x + east) / a, ((y + north) / a).sinh().atan());
        let across = a / (1.0 - e2 * latitude.sin() * latitude.sin()).sqrt();
        let from_axis = (across + z + 100.0) * latitude.cos();
        [from_axis * longitude.cos(), from_axis * longitude.sin(), (across * (1.0 - e2) + z + 100.0) * latitude.sin()]
    };
    let cell = |place: Place| place.map(|c| (c / 2.0).floor() as i64);
    let mut expected: BTreeMap<[i64; 3], Vec<Place>> = BTreeMap::new();
    let mut places = vec![[0.0; 3]; mesh.vertex_count() as usize];
    mesh.read_vertices(0, &mut places).unwrap();
    for place in places.into_iter().map(centred) {
        expected.entry(cell(place)).or_default().push(place);
    }
    let rim = open_edges(&triangles(&mesh));
    let finest: Vec<[u32; 3]> =
        found.levels[&0].iter().flatten().copied().collect::<BTreeSet<_>>().into_iter().collect();
    assert_eq!(finest.len() as u64, mesh.vertex_count());
    // Every vertex went its way by itself: a turned and moved map would be off by metres.
    for corner in &finest {
        let place = found.moved(*corner);
        let [x, y, z] = cell(place);
        let around = (-1..=1).flat_map(|i| (-1..=1).flat_map(move |j| (-1..=1).map(move |k| [x + i, y + j, z + k])));
        let near = around.filter_map(|cell| expected.get(&cell)).flatten();
        let off = near.map(|other| distance(place, *other)).fold(f64::INFINITY, f64::min);
        assert!(off < 2e-4, "{place:?}: {off}");
    }
    let some: Vec<[u32; 3]> = finest.iter().step_by(finest.len() / 60).copied().collect();
    for (number, level) in found.levels.values().enumerate() {
        let open = open_edges(level);
        assert!((4..=rim).contains(&open), "{number}: {open} of {rim}");
        let farthest = farthest(&some, level);
        let told = figures.levels[number].error;
        assert!(farthest <= told * (1.0 + 1e-9) + 1e-6, "{number}: {farthest} {told}");
    }
}

#[test]
fn a_system_whose_place_is_not_known_is_refused_and_a_site_s_own_is_none() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let mesh =
        fan(&[[500_000.0, 4_200_000.0, 5.0], [500_100.0, 4_200_000.0, 6.0], [500_000.0, 4_200_100.0, 7.0]], &workspace);
    let write = |crs: Option<&str>, height_offset: Option<f64>, name: &str| {
        let header = MeshHeader { sheet: true, crs: crs.and_then(Crs::parse), ..MeshHeader::default() };
        let options = TilesetOptions { height_offset, ..TilesetOptions::default() };
        written_as(&mesh, &header, &options, (64 << 20, 1), &dir.path().join(name))
    };
    // NAD27, whose shift is in grids; degrees, which these are not; metres from the Earth's centre; a name.
    for crs in ["EPSG:26710", "EPSG:4326", "EPSG:4978", "somewhere"] {
        let words = write(Some(crs), None, "refused").unwrap_err().to_string();
        assert!(words.contains("`crs`"), "{crs}: {words}");
        assert!(!dir.path().join("refused").exists());
    }
    assert!(write(None, Some(10.0), "refused").unwrap_err().to_string().contains("`height_offset`"));
    for (crs, name) in [(None, "none"), (Some(r#"LOCAL_CS["site",UNIT["metre",1]]"#), "local")] {
        assert_eq!(write(crs, None, name).unwrap().site, None);
        read(&dir.path().join(name));
    }
}

#[test]
fn compressed_tiles_are_smaller_meet_to_the_last_bit_and_are_as_near_as_they_say() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    for (name, mesh, sheet) in [("hills", terrain(&workspace), true), ("torus", torus(&workspace), false)] {
        let origin = if sheet { [691_000.0, 5_334_000.0, 500.0] } else { [0.0; 3] };
        let crs = Crs::parse("EPSG:25832").filter(|_| sheet);
        let header = MeshHeader { sheet, crs, origin, ..MeshHeader::default() };
        let [plain, quantized, encoded] =
            [Compression::None, Compression::Quantize, Compression::Meshopt].map(|compress| {
                let options = TilesetOptions { compress, ..TilesetOptions::default() };
                let folder = dir.path().join(format!("{name}-{compress:?}"));
                let figures = written_as(&mesh, &header, &options, (256 << 20, 2), &folder).unwrap();
                let found = read_with(&folder, figures.levels[0].error);
                (figures, found)
            });
        assert!(plain.0.bytes > quantized.0.bytes && quantized.0.bytes > encoded.0.bytes, "{name}");
        assert_eq!(quantized.0.levels.len(), plain.0.levels.len());
        let whole = &plain.1.levels[&0];
        let rim = open_edges(whole);
        let places: Vec<[u32; 3]> = whole.iter().step_by(whole.len() / 60).map(|triangle| triangle[0]).collect();
        for (number, (error, level)) in quantized.1.levels.iter().enumerate() {
            let told = f64::from_bits(*error);
            assert_eq!(told, quantized.0.levels[number].error);
            let moved = told - plain.0.levels[number].error;
            // A step is no more than two 65,528ths of the largest tile, or of twice the level.
            assert!(moved > 0.0 && moved < 1000.0 / 65_528.0 * 2.0, "{name} {number}: {moved}");
            let open = open_edges(level);
            assert!(if sheet { (4..=rim).contains(&open) } else { open == 0 }, "{name} {number}: {open} of {rim}");
            let farthest = farthest(&places, level);
            assert!(farthest <= told * (1.0 + 1e-9) + 1e-6, "{name} {number}: {farthest} {told}");
            // What is encoded comes back as it was.
            assert_eq!(sorted(level.clone()), sorted(encoded.1.levels[error].clone()), "{name} {number}");
        }
        assert_eq!(
            (plain.1.overlaps(), quantized.1.overlaps()),
            (encoded.1.overlaps(), encoded.1.overlaps()),
            "{name}"
        );
        assert!(encoded.1.skirts() > 0 || !sheet);
    }
}
