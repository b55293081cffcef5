//! Every writer through every reader, and files that are there whole or not at all.

use std::path::Path;

use super::tiles::Tiles;
use super::tiling::{Division, Tiling};
use super::*;
use crate::format::read::open;
use crate::mesh::MeshSource;
use crate::mesh::spool::FaceRecord;
use crate::points::Precision;
use crate::storage::spool::{Spool, Workspace};

const ORIGIN: [f64; 3] = [500_000.25, -0.1, 0.0];

type Elements = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// A strip of `n` squares over coordinates that no short decimal has.
fn strip(n: u32) -> Elements {
    let vertices = (0..2 * n + 2).map(|i| [f64::from(i / 2) / 3.0, f64::from(i % 2) * -1.1e-7, f64::from(i * i) * 1e3]);
    let faces = (0..n).flat_map(|i| [[2 * i, 2 * i + 2, 2 * i + 1], [2 * i + 1, 2 * i + 2, 2 * i + 3]]);
    (vertices.collect(), faces.collect())
}

fn spool((vertices, faces): &Elements, precision: Precision, workspace: &Workspace) -> MeshSpool {
    let mut mesh = MeshSpool::new(workspace, precision, 100);
    mesh.append_vertices(vertices).unwrap();
    mesh.append_faces(&faces.iter().map(|f| FaceRecord::new(*f)).collect::<Vec<_>>()).unwrap();
    mesh
}

fn elements(mesh: &dyn MeshSource) -> Elements {
    let mut vertices = vec![[0.0; 3]; mesh.vertex_count() as usize];
    let mut faces = vec![[0; 3]; mesh.face_count() as usize];
    mesh.read_vertices(0, &mut vertices).unwrap();
    mesh.read_faces(0, &mut faces).unwrap();
    (vertices, faces)
}

fn write_to(path: &Path, mesh: &MeshSpool, threads: usize) -> Written {
    let header = MeshHeader { origin: ORIGIN, comments: vec!["two\nlines".into()], ..MeshHeader::default() };
    let mut told = 0;
    let workers = Workers::new(threads).unwrap();
    let target = Target::prepare(path, Overwrite::Replace, Positions::Shifted).unwrap();
    let written = target.fill(mesh, &header, &workers, &mut |done| told = done).unwrap().finish().unwrap();
    let faces = mesh.face_count();
    assert!(told == faces || told == faces + mesh.vertex_count());
    assert_eq!(written.bytes, std::fs::metadata(path).unwrap().len());
    written
}

#[test]
fn every_writer_is_read_back() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let strip = strip(30_000);
    for precision in [Precision::Single, Precision::Double] {
        let mesh = spool(&strip, precision, &workspace);
        let exact = elements(&mesh);
        let mut single = exact.clone();
        single.0.iter_mut().for_each(|v| *v = v.map(|c| f64::from(c as f32)));
        for (name, expected) in [("m.ply", &exact), ("m.OBJ", &exact), ("m.glb", &single), ("m.stl", &single)] {
            let path = dir.path().join(name);
            write_to(&path, &mesh, 2);
            let bytes = std::fs::read(&path).unwrap();
            write_to(&path, &mesh, 1);
            assert!(bytes == std::fs::read(&path).unwrap(), "{name} depends on threads");
            for in_memory in [0, 1 << 30] {
                let (mut vertices, mut faces) = elements(&*open(&path, &workspace, in_memory).unwrap());
                if name == "m.stl" {
                    // Vertices come in the order of corners: compare the triangles' positions.
                    let at = |f: [u32; 3], v: &[[f64; 3]]| f.map(|i| v[i as usize]);
                    assert_eq!(vertices.len(), expected.0.len());
                    let read: Vec<_> = faces.iter().map(|f| at(*f, &vertices)).collect();
                    assert!(read == expected.1.iter().map(|f| at(*f, &expected.0)).collect::<Vec<_>>());
                    assert_eq!(faces[0], [0, 1, 2]);
                    (vertices, faces) = expected.clone();
                }
                if name == "m.OBJ" && precision == Precision::Single {
                    // Shortest decimals of an `f32` name that `f32`, not that `f64`.
                    vertices.iter_mut().for_each(|v| *v = v.map(|c| f64::from(c as f32)));
                }
                if name == "m.OBJ" && precision == Precision::Double {
                    // With the origin added, they are the same.
                    let whole = |v: &[f64; 3]| [0, 1, 2].map(|a| v[a] + ORIGIN[a]);
                    assert!(vertices.iter().map(whole).eq(expected.0.iter().map(whole)));
                    vertices.clone_from(&expected.0);
                }
                assert!((&vertices, &faces) == (&expected.0, &expected.1), "{name} at {in_memory}");
            }
        }
    }
    let left: Vec<_> = std::fs::read_dir(dir.path()).unwrap().collect();
    assert_eq!(left.len(), 5, "four meshes and a side-car: temporary files are gone");
}

#[test]
fn a_file_that_is_full_has_no_name_until_it_is_finished() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let mesh = spool(&strip(10), Precision::Single, &workspace);
    let header = MeshHeader { origin: [0.0, 1.0, 2.0], ..MeshHeader::default() };
    let path = dir.path().join("m.obj");
    let count = || std::fs::read_dir(dir.path()).unwrap().count();
    let fill = || {
        let target = Target::prepare(&path, Overwrite::Refuse, Positions::Shifted).unwrap();
        target.fill(&mesh, &header, &Workers::new(1).unwrap(), &mut |_| ()).unwrap()
    };
    let filled = fill();
    assert!(!path.exists() && !dir.path().join("m_offset.xyz").exists(), "neither the file nor its side-car");
    drop(filled);
    assert_eq!(count(), 0, "what is not finished is removed");
    let written = fill().finish().unwrap();
    assert_eq!(written.bytes, std::fs::metadata(&path).unwrap().len());
    assert_eq!(count(), 2);
}

#[test]
fn origin_and_comments_stand_in_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let mesh = spool(&strip(1), Precision::Single, &workspace);
    let text = |name: &str| {
        write_to(&dir.path().join(name), &mesh, 1);
        String::from_utf8_lossy(&std::fs::read(dir.path().join(name)).unwrap()).into_owned()
    };
    let ply = "ply\nformat binary_little_endian 1.0\ncomment two lines\ncomment origin 500000.25 -0.1 0\n\
               element vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n\
               property list uchar int vertex_indices\nend_header\n";
    assert!(text("m.ply").starts_with(ply));
    assert!(text("m.obj").starts_with("# two lines\n# origin 500000.25 -0.1 0\nv 0 -0 0\nv 0 -0.00000011 1000\n"));
    assert!(text("m.stl").starts_with("origin 500000.25 -0.1 0   "));
    assert!(text("m.glb").contains("\"translation\":[500000.25,0.0,0.1]"));
}

#[test]
fn an_empty_mesh_is_a_file_too() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let mesh = spool(&(vec![], vec![]), Precision::Single, &workspace);
    for name in ["m.ply", "m.stl", "m.glb"] {
        let path = dir.path().join(name);
        write_to(&path, &mesh, 1);
        assert_eq!(open(&path, &workspace, 0).unwrap().face_count(), 0);
    }
}

#[test]
fn what_cannot_be_written_is_refused_at_once() {
    let missing = Target::prepare(Path::new("/nonexistent/m.ply"), Overwrite::Refuse, Positions::Shifted).unwrap_err();
    assert!(missing.to_string().starts_with("/nonexistent: cannot open the folder: No such file"), "{missing}");
    for name in ["mesh", "mesh.xyz", ".ply"] {
        assert!(
            matches!(Target::prepare(Path::new(name), Overwrite::Refuse, Positions::Shifted), Err(Error::Usage(_))),
            "{name}"
        );
    }
}

#[test]
fn an_interrupted_write_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let mesh = spool(&strip(5), Precision::Single, &workspace);
    let workers = Workers::new(1).unwrap();
    workers.cancel_flag().store(true, std::sync::atomic::Ordering::Relaxed);
    for name in ["m.ply", "m.stl", "m.obj", "m.glb"] {
        let target = Target::prepare(&dir.path().join(name), Overwrite::Refuse, Positions::Shifted).unwrap();
        let error = target.fill(&mesh, &MeshHeader::default(), &workers, &mut |_| ()).unwrap_err();
        assert!(matches!(error, Error::Interrupted), "{error}");
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn where_a_mesh_lies_is_told_in_it_or_beside_it() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let mesh = spool(&strip(3), Precision::Double, &workspace);
    let wkt = r#"PROJCS["UTM 32N",AUTHORITY["EPSG","25832"]]"#;
    let crs = crate::points::crs::Crs::parse(wkt);
    let header = MeshHeader { origin: [500_000.0, 5.4e6, 0.0], crs, ..MeshHeader::default() };
    let workers = Workers::new(1).unwrap();
    let read = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    let text = |name: &str| String::from_utf8_lossy(&read(name)).into_owned();
    let put = |name: &str, positions, overwrite, header: &MeshHeader| {
        let target = Target::prepare(&dir.path().join(name), overwrite, positions)?;
        target.fill(&mesh, header, &workers, &mut |_| ())?.finish()
    };
    let write = |name: &str, positions| put(name, positions, Overwrite::Refuse, &header);
    for name in ["m.ply", "m.glb", "m.obj"] {
        write(name, Positions::Shifted).unwrap();
        assert!(text(name).contains("EPSG:25832"), "{name}");
    }
    assert!(text("m.ply").contains(&format!("comment wkt {wkt}\n")));
    assert_eq!((text("m.prj"), text("m_offset.xyz")), (format!("{wkt}\n"), "500000 5400000 0\n".to_string()));
    // The side-cars are outputs like the mesh.
    assert!(matches!(write("m.stl", Positions::Shifted), Err(Error::OutputExists(path)) if path.ends_with("m.prj")));
    assert!(!dir.path().join("m.stl").exists());

    write("absolute.ply", Positions::Absolute).unwrap();
    assert!(!text("absolute.ply").contains("origin"));
    let absolute = elements(&*open(&dir.path().join("absolute.ply"), &workspace, 1 << 20).unwrap());
    let (own, faces) = elements(&mesh);
    let moved: Vec<[f64; 3]> = own.iter().map(|p| [0, 1, 2].map(|a| p[a] + header.origin[a])).collect();
    assert_eq!(absolute, (moved, faces));
    assert!(matches!(write("a.glb", Positions::Absolute), Err(Error::InvalidSetting { name: "coordinates", .. })));
    assert!(matches!(write("a.stl", Positions::Absolute), Err(Error::InvalidSetting { name: "coordinates", .. })));
    write("b.obj", Positions::Absolute).unwrap();
    assert_eq!(elements(&*open(&dir.path().join("b.obj"), &workspace, 1 << 20).unwrap()), absolute);
    assert!(dir.path().join("b.prj").exists() && !dir.path().join("b_offset.xyz").exists());

    // A mesh that takes the place of another does not lie where that one lay.
    put("m.obj", Positions::Shifted, Overwrite::Replace, &MeshHeader::default()).unwrap();
    assert!(!dir.path().join("m.prj").exists() && !dir.path().join("m_offset.xyz").exists());
}

/// Reads a PLY header as RPly does, which CloudCompare and Open3D share: words of at most 255 characters, lines of less than 1,024, a comment as a line.
fn read_as_rply(bytes: &[u8]) -> Vec<String> {
    let mut lines = Vec::new();
    let mut rest = bytes;
    loop {
        let end = rest.iter().position(|b| *b == b'\n').expect("a line end");
        let line = std::str::from_utf8(&rest[..end]).unwrap();
        assert!(line.len() < 500, "Line too long: {line}");
        let comment = line.starts_with("comment ");
        assert!(comment || line.split(' ').all(|word| word.len() < 256));
        lines.push(line.to_string());
        rest = &rest[end + 1..];
        if line == "end_header" {
            return lines;
        }
    }
}

#[test]
fn headers_stay_within_what_strict_readers_take() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let mesh = spool(&strip(3), Precision::Double, &workspace);
    let wkt = |parts: usize| {
        let parameters = ",      PARAMETER[\"Latitude of örigin\",   49.0]".repeat(parts);
        format!("PROJCS[\"{}\"{parameters},AUTHORITY[\"EPSG\",\"6341\"]]", "long name ".repeat(40))
    };
    let path = dir.path().join("m.ply");
    for (parts, whole) in [(30, true), (4000, false)] {
        let crs = crate::points::crs::Crs::parse(&wkt(parts));
        assert!(crs.is_some());
        let header = MeshHeader { crs, comments: vec!["c".repeat(3000)], ..MeshHeader::default() };
        let target = Target::prepare(&path, Overwrite::Replace, Positions::Absolute).unwrap();
        target.fill(&mesh, &header, &Workers::new(1).unwrap(), &mut |_| ()).unwrap().finish().unwrap();
        let lines = read_as_rply(&std::fs::read(&path).unwrap());
        assert!(lines.len() < 100 && lines.iter().any(|line| line.starts_with("comment crs EPSG:6341")));
        let text: String = lines.iter().filter_map(|line| line.strip_prefix("comment wkt ")).collect();
        let bare = |text: &str| text.split_whitespace().collect::<String>();
        assert_eq!(bare(&text), if whole { bare(&wkt(parts)) } else { String::new() });
    }
}

#[test]
fn a_glb_is_as_viewers_expect_it() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let workers = Workers::new(2).unwrap();
    let path = dir.path().join("m.glb");
    for (squares, sheet, short) in [(1u32, true, true), (32_766, false, true), (32_767, false, false)] {
        let strip = strip(squares);
        let mesh = spool(&strip, Precision::Single, &workspace);
        let header = MeshHeader { origin: [470_620.0, 3_810_220.0, 2270.0], sheet, ..MeshHeader::default() };
        write(&mesh, &header, &path, Overwrite::Replace, &workers, &mut |_| ()).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let scene: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        assert_eq!(bytes.len() as u64, u64::from(u32::from_le_bytes(bytes[8..12].try_into().unwrap())));
        let indices = &scene["accessors"][1];
        assert_eq!(indices["componentType"], if short { 5123 } else { 5125 });
        let [view, buffer] =
            [&scene["bufferViews"][1], &scene["buffers"][0]].map(|v| v["byteLength"].as_u64().unwrap());
        assert_eq!(view, u64::from(squares) * 6 * if short { 2 } else { 4 });
        assert!(buffer.is_multiple_of(4) && 28 + length as u64 + buffer == bytes.len() as u64);
        let material = &scene["materials"][0];
        assert_eq!(
            (&material["doubleSided"], &material["pbrMetallicRoughness"]["metallicFactor"]),
            (&sheet.into(), &0.into())
        );
        assert_eq!(scene["meshes"][0]["primitives"][0]["material"], 0);

        // North lies away from the viewer, and up is up.
        let node = &scene["nodes"][0];
        let [x, y, z, w]: [f64; 4] = serde_json::from_value(node["rotation"].clone()).unwrap();
        let turn = glam::DQuat::from_xyzw(x, y, z, w);
        let near = |a: glam::DVec3, b: [f64; 3]| (a - glam::DVec3::from(b)).length() < 1e-9;
        assert!(near(turn * glam::DVec3::Z, [0.0, 1.0, 0.0]) && near(turn * glam::DVec3::Y, [0.0, 0.0, -1.0]));
        let moved: [f64; 3] = serde_json::from_value(node["translation"].clone()).unwrap();
        assert_eq!(moved, [470_620.0, 2270.0, -3_810_220.0]);
        let read = open(&path, &workspace, 1 << 24).unwrap();
        assert_eq!((read.origin(), elements(&*read).1), (header.origin, strip.1));
    }
}

#[test]
fn attributes_that_never_change_are_found() {
    use crate::points::attribute::{Attribute, Schema};
    use crate::points::scalar::Scalar;
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let names = [
        ("red", Scalar::U8),
        ("green", Scalar::U8),
        ("blue", Scalar::U8),
        ("classification", Scalar::U8),
        ("gps_time", Scalar::F64),
    ];
    let schema = Schema::new(names.map(|(name, scalar)| Attribute::new(name, scalar)).to_vec());
    let strip = strip(32_000);
    for (red, time, found) in [
        (7, 1.5, "red green blue classification gps_time"),
        (8, 1.5, "classification gps_time"),
        (8, 2.5, "classification"),
    ] {
        let mut mesh = MeshSpool::with_attributes(&workspace, Precision::Single, schema.clone(), 1 << 20);
        mesh.append_vertices(&strip.0).unwrap();
        for number in 0..strip.0.len() {
            // One that differs, far behind the first.
            let last = number == 60_001;
            let mut record = vec![if last { red } else { 7 }, 3, 4, 2];
            record.extend(f64::to_ne_bytes(if last { time } else { 1.5 }));
            mesh.append_attributes(&record).unwrap();
        }
        let constant = constant(&mesh, &Workers::new(2).unwrap()).unwrap();
        let names: Vec<&str> = constant.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names.join(" "), found);
        assert!(constant.iter().any(|(name, value)| name == "classification" && *value == 2.0));
    }
}

#[test]
fn tiles_hold_every_triangle_once_with_the_same_bits() {
    let dir = tempfile::tempdir().unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let header = MeshHeader { origin: [500_000.25, -0.1, 0.0], ..MeshHeader::default() };
    let (mut vertices, faces) = strip(30_000);
    // Several squares along y, too, and triangles in an order that jumps between them.
    vertices.iter_mut().enumerate().for_each(|(i, v)| v[1] += (i % 7) as f64 * 1e3);
    let mesh = spool(&(vertices, faces), Precision::Double, &workspace);
    let corners = |(vertices, faces): &Elements| -> Vec<[[u64; 3]; 3]> {
        faces.iter().map(|face| face.map(|v| vertices[v as usize].map(f64::to_bits))).collect()
    };
    let mut expected = corners(&elements(&mesh));
    expected.sort_unstable();
    let output = dir.path().join("city.ply");
    let write = |side: f64, overwrite, threads: usize, memory: u64| {
        let workers = Workers::new(threads).unwrap();
        let tiles = Tiles::prepare(&output, Division::Squares(side), overwrite, Positions::Shifted)?;
        tiles.write(&mesh, &header, memory, &workers, &workspace, &mut |_| ())
    };
    let folder = dir.path().join("city.tiles");
    let contents = || -> std::collections::BTreeMap<String, Vec<u8>> {
        let files = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
        files.map(|f| (f.file_name().unwrap().to_str().unwrap().to_owned(), std::fs::read(f).unwrap())).collect()
    };
    let written = write(1e3, Overwrite::Refuse, 1, 1 << 30).unwrap();
    let first = contents();
    assert_eq!(written.0.bytes, first.values().map(|bytes| bytes.len() as u64).sum::<u64>());
    let index: serde_json::Value = serde_json::from_slice(&first["index.json"]).unwrap();
    let tiles = index["tiles"].as_array().unwrap();
    assert!(tiles.len() > 30 && tiles.len() + 1 == first.len());
    let mut found = Vec::new();
    for tile in tiles {
        let name = tile["file"].as_str().unwrap();
        let read = elements(&*open(&folder.join(name), &workspace, 1 << 26).unwrap());
        assert_eq!(
            (tile["vertices"].as_u64(), tile["triangles"].as_u64()),
            (Some(read.0.len() as u64), Some(read.1.len() as u64))
        );
        let side = |a: usize| tile[["x", "y"][a]].as_i64().unwrap();
        for face in &read.1 {
            for a in 0..2 {
                let middle = face.iter().map(|v| read.0[*v as usize][a]).sum::<f64>() / 3.0 + header.origin[a];
                assert_eq!((middle / 1e3).floor() as i64, side(a));
            }
        }
        found.extend(corners(&read));
    }
    found.sort_unstable();
    assert!(found == expected);

    assert!(matches!(write(1e3, Overwrite::Refuse, 1, 1 << 30), Err(Error::OutputExists(path)) if path == folder));
    write(1e3, Overwrite::Replace, 3, 1 << 20).unwrap();
    assert!(contents() == first, "the same bytes for any threads and memory");
    let error = write(1e9, Overwrite::Replace, 2, 1 << 10).unwrap_err().to_string();
    assert!(error.contains("make `max_memory` larger"), "{error}");
    assert!(contents() == first, "what was there stays");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "nothing else is left");

    // By several processes, of any number of shares and of runs of tiles.
    for (shares, runs) in [(1, 1), (2, 3), (5, 2), (40, 50)] {
        let workers = Workers::new(2).unwrap();
        let means = (&workers, &workspace);
        let tiling = Tiling::of(&output, Division::Squares(1e3), Positions::Shifted).unwrap();
        let spools = || [workspace.spool(1 << 12), workspace.spool(0)];
        let sorted: Vec<[Spool; 2]> = (0..shares)
            .map(|share| {
                let [mut triangles, mut index] = spools();
                let out = [&mut triangles, &mut index];
                tiling.sort_apart((&mesh, header.origin), (share, shares), out, means, &mut |_| ()).unwrap();
                [triangles, index]
            })
            .collect();
        let mut written: Vec<[Spool; 2]> = (0..runs)
            .map(|run| {
                let [mut files, mut index] = spools();
                let (of, out) = ((&sorted[..], (run, runs)), [&mut files, &mut index]);
                tiling.write_apart((&mesh, &header), of, out, 1 << 20, means, &mut |_| ()).unwrap();
                [files, index]
            })
            .collect();
        let take = |written: &[[Spool; 2]]| {
            let tiles = Tiles::prepare(&output, Division::Squares(1e3), Overwrite::Replace, Positions::Shifted)?;
            tiles.take(&header, written, &workers, &mut |_| ())
        };
        std::fs::remove_dir_all(&folder).unwrap();
        let taken = take(&written).unwrap().unwrap();
        assert!(contents() == first, "{shares} shares, {runs} runs");
        assert_eq!(taken.0.bytes, first.values().map(|bytes| bytes.len() as u64).sum::<u64>());
        // A run whose files are not what was written is told by its number.
        let last = runs - 1 - written.iter().rev().position(|[files, _]| !files.is_empty()).unwrap();
        let mut bytes = vec![0; written[last][0].len() as usize];
        written[last][0].read_at(0, &mut bytes).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        written[last][0] = workspace.spool(0);
        written[last][0].append(&bytes).unwrap();
        assert_eq!(take(&written).unwrap().unwrap_err(), last);
        assert!(contents() == first, "what was there stays");
    }
    let obj = Tiles::prepare(&dir.path().join("a.obj"), Division::Squares(1.0), Overwrite::Refuse, Positions::Shifted);
    assert!(matches!(obj, Err(Error::InvalidSetting { name: "tile", .. })));
}
