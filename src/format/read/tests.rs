//! Small files in every dialect, whole, cut short and corrupted.

use super::*;

const VERTICES: [[f64; 3]; 5] = [[0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [1.5, 2.0, 0.0], [0.0, 2.0, 0.0], [-1.0, 1.0, 0.25]];
/// A square as a fan from its first corner, and a triangle.
const FACES: [[u32; 3]; 3] = [[0, 1, 2], [0, 2, 3], [0, 3, 4]];

type Elements = (Vec<[f64; 3]>, Vec<[u32; 3]>);

fn read(name: &str, bytes: &[u8]) -> Result<Elements> {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let mesh = open(&path, &workspace, 1 << 16)?;
    assert!(mesh.vertex_count() < 1000 && mesh.face_count() < 1000, "more elements than bytes");
    let mut vertices = vec![[0.0; 3]; mesh.vertex_count() as usize];
    let mut faces = vec![[0; 3]; mesh.face_count() as usize];
    mesh.read_vertices(0, &mut vertices)?;
    mesh.read_faces(0, &mut faces)?;
    Ok((vertices, faces))
}

#[test]
fn lines_are_read_from_the_start_wherever_the_file_is() {
    use std::io::{Seek, SeekFrom};

    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("lines.obj");
    std::fs::write(&path, "first\nsecond\n").unwrap();
    let input = Input::open(&path).unwrap();
    let mut lines = text::Lines::new(&input);
    for expected in ["first", "second"] {
        // As reading at places does on Windows.
        (&input.file).seek(SeekFrom::Start(9)).unwrap();
        assert!(lines.advance().unwrap());
        assert_eq!(lines.line(), expected);
    }
    assert!(!lines.advance().unwrap());
}

fn expected() -> Elements {
    (VERTICES.to_vec(), FACES.to_vec())
}

/// A PLY of polygons with an element before, scalars and a list to pass over; `big` tells the byte order.
fn ply_of_polygons(big: bool) -> Vec<u8> {
    let order = if big { "big" } else { "little" };
    let mut bytes = format!(
        "ply\r\nformat binary_{order}_endian 1.0\r\ncomment a polygon\nelement camera 1\nproperty short id\n\
         element vertex 5\nproperty uchar red\nproperty double z\nproperty float x\nproperty float32 y\n\
         element face 2\nproperty list uint8 float texcoord\nproperty list ushort uint32 vertex_index\nproperty char flag\n\
         end_header\n"
    )
    .into_bytes();
    let mut put = |mut value: Vec<u8>| {
        if big {
            value.reverse();
        }
        bytes.extend(value);
    };
    put(7i16.to_le_bytes().into());
    for [x, y, z] in VERTICES {
        put(vec![200]);
        put(z.to_le_bytes().into());
        put((x as f32).to_le_bytes().into());
        put((y as f32).to_le_bytes().into());
    }
    for polygon in [&[0u32, 1, 2, 3][..], &[0, 3, 4]] {
        put(vec![1]);
        put(0.5f32.to_le_bytes().into());
        put((polygon.len() as u16).to_le_bytes().into());
        polygon.iter().for_each(|v| put(v.to_le_bytes().into()));
        put(vec![255]);
    }
    bytes
}

/// A PLY that is read in place, with a scalar on either side of what is wanted.
fn ply_of_triangles() -> Vec<u8> {
    let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 5\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nelement face 3\nproperty uchar flag\n\
        property list uchar int vertex_indices\nproperty uchar red\nend_header\n"
        .to_vec();
    for vertex in VERTICES {
        vertex.iter().for_each(|c| bytes.extend((*c as f32).to_le_bytes()));
        bytes.push(9);
    }
    for face in FACES {
        bytes.extend([8, 3]);
        face.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.push(7);
    }
    bytes
}

fn stl() -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes[..5].copy_from_slice(b"solid");
    bytes.extend(3u32.to_le_bytes());
    for face in FACES {
        bytes.extend([0; 12]);
        for v in face {
            VERTICES[v as usize].iter().for_each(|c| bytes.extend((*c as f32).to_le_bytes()));
        }
        bytes.extend([0; 2]);
    }
    bytes
}

fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    bytes.extend(2u32.to_le_bytes());
    bytes.extend((28 + (json.len() + binary.len()) as u32).to_le_bytes());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend((binary.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    bytes
}

/// Positions at a stride of 16, and 16-bit vertex numbers.
fn interleaved_glb() -> Vec<u8> {
    let mut binary = Vec::new();
    for vertex in VERTICES {
        vertex.iter().for_each(|c| binary.extend((*c as f32).to_le_bytes()));
        binary.extend([1; 4]);
    }
    FACES.iter().flatten().for_each(|v| binary.extend((*v as u16).to_le_bytes()));
    let json = r#"{"asset":{"version":"2.0"},
        "meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":9},"indices":1}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":5,"type":"VEC3"},
                     {"bufferView":1,"componentType":5123,"count":9,"type":"SCALAR"}],
        "bufferViews":[{"buffer":0,"byteLength":80,"byteStride":16},{"buffer":0,"byteOffset":80,"byteLength":18}],
        "buffers":[{"byteLength":98}]}"#;
    glb(json, &binary)
}

const ASCII_PLY: &str = "ply\nformat ascii 1.0\nelement vertex 5\nproperty double x\nproperty double y\n\
    property double z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0\n1.5 0 0\n15e-1 2 0\n0 2\t0\n\n-1 1\n0.25 4 0 1 2 3\n3 0 3 4\n";

const OBJ: &str = "# comment\nmtllib x\nv 0 0 0\nv 1.5 0 0 1.0\nv 1.5 2 0\r\nv 0 2 0\nvn 0 0 1\nv -1 1 .25\n\
    g square\nf 1/1/1 2//1 3 -2\nf 1 4 -1\n";

const ASCII_STL: &str = "solid square\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1.5 0 0\n   \
    vertex 1.5 2 -0\n  endloop\n endfacet\nfacet normal 0 0 1\nouter loop\nvertex 0 -0 0\nvertex 1.5 2 0\nvertex 0 2 0\n\
    endloop\nendfacet\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0 2 0\nvertex -1 1 0.25\nendloop\nendfacet\n\
    endsolid square\n";

fn all() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("polygons.ply", ply_of_polygons(false)),
        ("polygons_big_endian.ply", ply_of_polygons(true)),
        ("triangles.ply", ply_of_triangles()),
        ("text.ply", ASCII_PLY.into()),
        ("binary.stl", stl()),
        ("text.stl", ASCII_STL.into()),
        ("text.obj", OBJ.into()),
        ("interleaved.glb", interleaved_glb()),
    ]
}

#[test]
fn every_dialect_gives_the_same_mesh() {
    for (name, bytes) in all() {
        assert_eq!(read(name, &bytes).unwrap(), expected(), "{name}");
    }
}

#[test]
fn no_beginning_of_a_file_is_taken_for_a_mesh() {
    for (name, bytes) in all() {
        for end in 0..bytes.len() {
            // Of text, the beginning of a last number or line may be a valid one, and OBJ has no end.
            match read(name, &bytes[..end]) {
                Err(Error::Malformed { .. } | Error::Usage(_)) => {}
                Err(error) => panic!("{name} cut at {end}: {error}"),
                Ok(_) => {
                    assert!(name == "text.obj" || name.starts_with("text") && end + 10 > bytes.len(), "{name} {end}")
                }
            }
        }
    }
}

#[test]
#[ignore = "exhaustive"]
fn no_corrupted_byte_makes_a_reader_panic() {
    for (name, bytes) in all() {
        for at in 0..bytes.len() {
            for value in [0, 1, 0x2d, 0x39, 0x7f, 0xff] {
                let mut bytes = bytes.clone();
                bytes[at] = value;
                match read(name, &bytes) {
                    Ok((_, faces)) => assert!(faces.len() < 10),
                    Err(Error::Malformed { .. } | Error::Usage(_) | Error::TooManyElements { .. }) => {}
                    Err(error) => panic!("{name}, byte {at} = {value}: {error}"),
                }
            }
        }
    }
}

#[test]
fn promises_of_billions_are_not_believed() {
    let header = |count: &str| {
        format!(
            "ply\nformat binary_little_endian 1.0\nelement nothing {count}\nelement vertex {count}\nproperty float x\n\
             property float y\nproperty float z\nelement face {count}\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    for count in ["4000000000", "1000000000000000000", "18446744073709551615", "18446744073709551616", "-1"] {
        let error = read("m.ply", header(count).as_bytes()).unwrap_err();
        assert!(matches!(error, Error::Malformed { .. } | Error::TooManyElements { .. }), "{error}");
    }
    let mut stl = stl();
    stl[0] = b'S';
    stl[80..84].fill(0xff);
    let error = read("m.stl", &stl).unwrap_err();
    assert!(error.to_string().ends_with("expected 214748364834 bytes for its 4294967295 triangles, found 234 bytes"));
}

#[test]
fn errors_tell_the_place() {
    let text = |ply: &str, from: &str, to: &str| {
        let error = read("m.ply", ply.replace(from, to).as_bytes()).unwrap_err().to_string();
        error[error.find("m.ply").unwrap()..].to_owned()
    };
    assert_eq!(
        text(ASCII_PLY, "3 0 3 4", "3 0 3 5"),
        "m.ply: face 1: expected vertex numbers below 5, the number of vertices, found 5"
    );
    assert_eq!(text(ASCII_PLY, "1.5", "one"), "m.ply: line 11: expected a number, found \"one\"");
    assert_eq!(text(ASCII_PLY, "4 0 1 2 3", "2 0 1"), "m.ply: face 0: expected at least 3 corners, found 2");
    assert_eq!(
        text(ASCII_PLY, "element face 2\nproperty list uchar int vertex_indices\n", ""),
        "m.ply: the header: expected one element face (is this a point cloud?), found none, or several"
    );
    let mut in_place = ply_of_triangles();
    let last = in_place.len() - 5;
    in_place[last] = 5;
    let error = read("m.ply", &in_place).unwrap_err().to_string();
    assert!(error.ends_with("face 2: expected vertex numbers below 5, the number of vertices, found 5"), "{error}");
    let error = read("m.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 0\n").unwrap_err().to_string();
    assert!(error.ends_with("line 3: expected a vertex number, from 1, or from -1 backwards, found 0"), "{error}");
}

#[test]
fn stl_corners_weld_in_the_order_of_the_file_whatever_the_memory() {
    let mut bytes = vec![b' '; 80];
    let triangles = 5000u32;
    bytes.extend(triangles.to_le_bytes());
    let corner = |i: u32| [(i * i % 701) as f32, (i % 7) as f32, -0.0];
    for i in 0..triangles {
        bytes.extend([0; 12]);
        (3 * i..3 * i + 3).flat_map(corner).for_each(|c| bytes.extend(c.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.stl");
    std::fs::write(&path, bytes).unwrap();
    let mut numbers = std::collections::BTreeMap::new();
    let mut expected = Vec::new();
    for i in 0..3 * triangles {
        let next = numbers.len() as u32;
        expected.push(*numbers.entry(corner(i).map(|c| (c + 0.0).to_bits())).or_insert(next));
    }
    for in_memory in [0, 10_000, 1 << 30] {
        let mesh = open(&path, &Workspace::new(dir.path()).unwrap(), in_memory).unwrap();
        let mut faces = vec![[0; 3]; triangles as usize];
        mesh.read_faces(0, &mut faces).unwrap();
        assert_eq!(mesh.vertex_count(), numbers.len() as u64);
        assert!(faces.as_flattened() == expected);
    }
}

#[test]
fn compressed_and_foreign_content_is_named() {
    let json = r#"{"asset":{"version":"2.0"},"extensionsRequired":["KHR_draco_mesh_compression"]}"#;
    assert!(matches!(read("m.glb", &glb(json, &[])), Err(Error::ForeignFormat { .. })));
    assert!(matches!(read("m.xyz", b"1 2 3"), Err(Error::Usage(_))));
    let lines = r#"{"meshes":[{"primitives":[{"attributes":{"POSITION":0},"mode":1}]}]}"#;
    let error = read("m.glb", &glb(lines, &[])).unwrap_err().to_string();
    assert!(error.ends_with("expected triangles (mode 4), found mode 1"), "{error}");
}

/// What a mesh has of an attribute.
fn values(name: &str, bytes: &[u8], wanted: &str, attribute: &str) -> Result<Vec<f64>> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let mesh = open_with(&path, &Workspace::new(dir.path()).unwrap(), 1 << 16, &wanted.parse().unwrap())?;
    let number = mesh.schema().attributes().iter().position(|a| a.name == attribute).unwrap();
    let mut values = vec![0.0; mesh.vertex_count() as usize];
    mesh.read_attribute(number, 0, &mut values)?;
    let mut later = vec![0.0; values.len() - 1];
    mesh.read_attribute(number, 1, &mut later)?;
    assert_eq!(later, values[1..]);
    Ok(values)
}

#[test]
fn attributes_are_read_in_every_dialect() {
    for big in [false, true] {
        assert_eq!(values("m.ply", &ply_of_polygons(big), "red", "red").unwrap(), [200.0; 5]);
    }
    assert_eq!(values("m.ply", &ply_of_triangles(), "red", "red").unwrap(), [9.0; 5]);
    let named =
        |text: &str| text.replace("property double z\n", "property double z\nproperty short scalar_Intensity\n");
    let text = named(ASCII_PLY).replace(
        "0 0 0\n1.5 0 0\n15e-1 2 0\n0 2\t0\n\n-1 1\n0.25 ",
        "0 0 0 5\n1.5 0 0 -6\n15e-1 2 0 7\n0 2\t0 8\n\n-1 1\n0.25 9 ",
    );
    assert_eq!(values("m.ply", text.as_bytes(), "i", "intensity").unwrap(), [5.0, -6.0, 7.0, 8.0, 9.0]);
    let obj = "v 0 0 0 .5 0 1\nv 1 0 0 .25 0 1\nv 0 1 0 1 .125 0\nf 1 2 3\n";
    assert_eq!(values("m.obj", obj.as_bytes(), "rgb", "red").unwrap(), [0.5, 0.25, 1.0]);
    assert_eq!(values("m.obj", obj.as_bytes(), "green", "green").unwrap(), [0.0, 0.0, 0.125]);
    let cut = obj.replace("1 .125 0", "");
    assert!(
        values("m.obj", cut.as_bytes(), "rgb", "red")
            .unwrap_err()
            .to_string()
            .contains("line 3: expected three colours")
    );
}

#[test]
fn attributes_of_glb_are_colours_and_what_has_a_name_of_its_own() {
    let mut binary = Vec::new();
    for (i, vertex) in VERTICES.iter().enumerate() {
        vertex.iter().for_each(|c| binary.extend((*c as f32).to_le_bytes()));
        binary.extend([10 * i as u8, 1, 255, 255]);
    }
    (0..5).for_each(|i: i16| binary.extend([(-i).to_le_bytes(), [0; 2]].concat()));
    let json = r#"{"asset":{"version":"2.0"},
        "meshes":[{"primitives":[{"attributes":{"POSITION":0,"COLOR_0":1,"_SCAN_ANGLE":2}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
                     {"bufferView":0,"byteOffset":12,"componentType":5121,"normalized":true,"count":3,"type":"VEC4"},
                     {"bufferView":1,"componentType":5122,"count":3,"type":"SCALAR"}],
        "bufferViews":[{"buffer":0,"byteLength":80,"byteStride":16},{"buffer":0,"byteOffset":80,"byteLength":20,"byteStride":4}],
        "buffers":[{"byteLength":100}]}"#;
    let bytes = glb(json, &binary);
    // Linear light, a twenty-fifth and two of it, as sRGB.
    assert_eq!(values("m.glb", &bytes, "rgb", "red").unwrap(), [0.0, 14329.0, 20334.0]);
    assert_eq!(values("m.glb", &bytes, "blue,scan_angle", "blue").unwrap(), [65535.0; 3]);
    assert_eq!(values("m.glb", &bytes, "blue,scan_angle", "scan_angle").unwrap(), [0.0, -1.0, -2.0]);
    let error = values("m.glb", &bytes, "intensity", "intensity").unwrap_err().to_string();
    assert!(
        error.ends_with("its vertices have no attribute intensity; there are: red, green, blue, scan_angle"),
        "{error}"
    );
    for (from, to) in [
        ("\"count\":3,\"type\":\"SCALAR\"", "\"count\":2,\"type\":\"SCALAR\""),
        ("5122", "5130"),
        ("\"_SCAN_ANGLE\":2", "\"_SCAN_ANGLE\":7"),
    ] {
        let bytes = glb(&json.replace(from, to), &binary);
        assert!(matches!(values("m.glb", &bytes, "scan_angle", "scan_angle"), Err(Error::Malformed { .. })), "{to}");
    }
}

#[test]
fn nodes_of_a_glb_cost_nothing_and_its_json_stays_within_the_budget() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let workspace = Workspace::new(dir.path()).unwrap();
    let write = |nodes: &str| {
        let mut json = format!(r#"{{"asset":{{"version":"2.0"}},"nodes":[{nodes}]}}"#).into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut bytes = b"glTF\x02\0\0\0".to_vec();
        bytes.extend((20 + json.len() as u32).to_le_bytes());
        bytes.extend((json.len() as u32).to_le_bytes());
        bytes.extend(b"JSON");
        bytes.extend(json);
        std::fs::write(&path, bytes).unwrap();
    };
    let moved = r#"{"mesh":0,"translation":[1,2,3]}"#;
    for (nodes, origin) in [
        (moved.to_string(), [1.0, 2.0, 3.0]),
        (format!("{moved},{{}}"), [0.0; 3]),
        (format!("{{}},{moved}"), [0.0; 3]),
        (String::new(), [0.0; 3]),
    ] {
        write(&nodes);
        assert_eq!(open(&path, &workspace, 0).unwrap().origin(), origin, "{nodes}");
    }
    write(&vec!["{}"; 400_000].join(","));
    let error = open(&path, &workspace, 32 << 20).err().unwrap().to_string();
    assert!(error.contains("the JSON chunk: expected JSON of at most 1048576 bytes"), "{error}");
    assert!(open(&path, &workspace, 1 << 30).is_ok());
}
