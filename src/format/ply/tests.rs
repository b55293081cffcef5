//! Whole PLY files, written by a small writer and read back.

use std::path::Path;

use proptest::prelude::*;

use super::super::testing::collect;
use super::header::CORNERS;
use super::*;
use crate::input::{Cloud, InputOptions};

/// A property as the test writer writes it; every vertex is given by one seed number.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Column {
    Axis(usize, &'static str),
    Other(&'static str),
    List,
}

const TYPES: [&str; 12] =
    ["char", "uint8", "short", "uint16", "int", "uint32", "float", "float32", "double", "float64", "int16", "uchar"];

/// The value at (vertex, axis): a whole number that every type holds.
fn value(vertex: usize, axis: usize) -> f64 {
    ((vertex * 7 + axis * 31) % 100) as f64
}

fn number(kind: &str, value: f64, encoding: Encoding) -> Vec<u8> {
    let little = match (encoding, kind) {
        (Encoding::Ascii, _) => return format!("{value} ").into_bytes(),
        (_, "char" | "uint8" | "uchar") => (value as u8).to_le_bytes().to_vec(),
        (_, "short" | "uint16" | "int16") => (value as u16).to_le_bytes().to_vec(),
        (_, "int" | "uint32") => (value as u32).to_le_bytes().to_vec(),
        (_, "float" | "float32") => (value as f32).to_le_bytes().to_vec(),
        _ => value.to_le_bytes().to_vec(),
    };
    if encoding == Encoding::Binary(Endian::Big) { little.into_iter().rev().collect() } else { little }
}

fn file_of(columns: &[Column], count: usize, encoding: Encoding, faces_first: bool) -> Vec<u8> {
    let name = match encoding {
        Encoding::Ascii => "ascii",
        Encoding::Binary(Endian::Little) => "binary_little_endian",
        Encoding::Binary(Endian::Big) => "binary_big_endian",
    };
    let end = if count.is_multiple_of(2) { "\n" } else { "\r\n" };
    let mut lines = vec!["ply".to_string(), format!("format {name} 1.0"), "comment element vertex 99".to_string()];
    if faces_first {
        lines.extend(["element face 2", "property list uchar int vertex_indices"].map(String::from));
    }
    lines.push(format!("element vertex {count}"));
    for column in columns {
        lines.push(match column {
            Column::Axis(axis, kind) => format!("property {kind} {}", ["x", "y", "z"][*axis]),
            Column::Other(kind) => format!("property {kind} other"),
            Column::List => "property list uint8 short many".to_string(),
        });
    }
    lines.extend(["element tail 1", "property float t", "end_header"].map(String::from));
    let mut file = (lines.join(end) + end).into_bytes();
    let newline = |file: &mut Vec<u8>| {
        if encoding == Encoding::Ascii {
            file.extend(end.as_bytes());
        }
    };
    for _ in 0..if faces_first { 2 } else { 0 } {
        [("uchar", 3.0), ("int", 0.0), ("int", 1.0), ("int", 2.0)]
            .iter()
            .for_each(|(kind, v)| file.extend(number(kind, *v, encoding)));
        newline(&mut file);
    }
    for vertex in 0..count {
        for column in columns {
            match column {
                Column::Axis(axis, kind) => file.extend(number(kind, value(vertex, *axis), encoding)),
                Column::Other(kind) => file.extend(number(kind, 5.0, encoding)),
                Column::List => {
                    file.extend(number("uint8", (vertex % 4) as f64, encoding));
                    (0..vertex % 4).for_each(|_| file.extend(number("short", 9.0, encoding)));
                }
            }
        }
        newline(&mut file);
    }
    file.extend(number("float", 1.0, encoding));
    file
}

fn read(content: &[u8]) -> Result<Vec<[f64; 3]>> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.ply");
    std::fs::write(&path, content).unwrap();
    collect(&path, &InputOptions::default()).map(|(points, _)| points)
}

fn expected(count: usize) -> Vec<[f64; 3]> {
    (0..count).map(|vertex| [0, 1, 2].map(|axis| value(vertex, axis))).collect()
}

fn any_encoding() -> impl Strategy<Value = Encoding> {
    prop_oneof![Just(Encoding::Ascii), Just(Encoding::Binary(Endian::Little)), Just(Encoding::Binary(Endian::Big))]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn what_is_written_is_read(
        kinds in prop::array::uniform3(0usize..12),
        others in prop::collection::vec(prop_oneof![(0usize..12).prop_map(|k| Column::Other(TYPES[k])), Just(Column::List)], 0..3),
        shuffle in prop::collection::vec(any::<prop::sample::Index>(), 6),
        count in 0usize..30,
        encoding in any_encoding(),
        faces_first: bool,
    ) {
        let mut columns: Vec<Column> = (0..3).map(|axis| Column::Axis(axis, TYPES[kinds[axis]])).collect();
        columns.extend(others);
        for (i, index) in shuffle.iter().enumerate().take(columns.len()) {
            let other = index.index(columns.len());
            columns.swap(i, other);
        }
        let file = file_of(&columns, count, encoding, faces_first);
        prop_assert_eq!(read(&file).unwrap(), expected(count));
    }
}

const PLAIN: [Column; 3] = [Column::Axis(0, "float"), Column::Axis(1, "float"), Column::Axis(2, "double")];
const WITH_LIST: [Column; 4] = [PLAIN[0], Column::List, PLAIN[1], PLAIN[2]];
const ENCODINGS: [Encoding; 3] = [Encoding::Ascii, Encoding::Binary(Endian::Little), Encoding::Binary(Endian::Big)];

#[test]
fn every_prefix_is_an_error_or_complete() {
    for encoding in ENCODINGS {
        for columns in [&PLAIN[..], &WITH_LIST] {
            for faces_first in [false, true] {
                let file = file_of(columns, 5, encoding, faces_first);
                for end in 0..file.len() {
                    // The last number of the last vertex may be cut where it still is one; the tail is not looked at.
                    if let Ok(points) = read(&file[..end]) {
                        assert_eq!(points.len(), 5, "{encoding:?} {columns:?}, prefix of {end} bytes");
                    }
                }
            }
        }
    }
}

/// The remark on a file with this content.
fn remark(content: &[u8]) -> Option<String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.ply");
    std::fs::write(&path, content).unwrap();
    Cloud::open(&[path], &InputOptions::default()).unwrap().sources()[0].remark.clone()
}

#[test]
fn a_file_that_is_cut_off_behind_its_vertices_is_told() {
    for name in CORNERS {
        let lines = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             element face 2\nproperty list uchar int {name}\nproperty list uchar float texcoord\nend_header\n"
        );
        let vertices = lines.len() + 3 * 12;
        let mut file = lines.into_bytes();
        file.resize(vertices, 0);
        for _ in 0..2 {
            file.extend([3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 0]);
        }
        assert_eq!(remark(&file), None, "{name}");
        for end in vertices..file.len() {
            let told = remark(&file[..end]).unwrap_or_else(|| panic!("{name}, {end} bytes: nothing is told"));
            assert!(
                told.contains(&format!(
                    "2 face behind the vertices take at least 28 bytes, the file ends after {} of them",
                    end - vertices
                )),
                "{told}"
            );
        }
        // What its header merely claims is no reason to count beyond all bounds.
        let claimed = String::from_utf8_lossy(&file).replace("element face 2", &format!("element face {}", u64::MAX));
        assert!(remark(claimed.as_bytes()).is_some());
    }
}

#[test]
fn every_changed_byte_is_survived() {
    for encoding in ENCODINGS {
        let file = file_of(&WITH_LIST, 5, encoding, true);
        for at in 0..file.len() {
            for byte in [0, b' ', b'9', 0x7f, 0xff] {
                let mut changed = file.clone();
                changed[at] = byte;
                drop(read(&changed));
            }
        }
    }
}

#[test]
fn claims_of_the_header_allocate_nothing() {
    for (encoding, columns) in [(ENCODINGS[0], &PLAIN[..]), (ENCODINGS[1], &PLAIN), (ENCODINGS[2], &WITH_LIST)] {
        let file = file_of(columns, 5, encoding, true);
        for (claim, instead) in [("vertex 5", "vertex 9999999999999999999"), ("face 2", "face 18446744073709551615")] {
            let at = (0..file.len()).rfind(|&i| file[i..].starts_with(claim.as_bytes())).unwrap();
            let claimed = [&file[..at], instead.as_bytes(), &file[at + claim.len()..]].concat();
            assert!(matches!(read(&claimed), Err(Error::Malformed { .. })), "{encoding:?} {claim}");
        }
    }
}

#[test]
fn precision_follows_the_types() {
    let dir = tempfile::tempdir().unwrap();
    let single = [PLAIN[0], PLAIN[1], Column::Axis(2, "float32")];
    for (columns, precision) in [
        (&single[..], Precision::Single),
        (&PLAIN, Precision::Double),
        (&[PLAIN[0], PLAIN[1], Column::Axis(2, "int")], Precision::Double),
    ] {
        for encoding in ENCODINGS {
            let path = dir.path().join("a.ply");
            std::fs::write(&path, file_of(columns, 3, encoding, false)).unwrap();
            let cloud = Cloud::open(&[path], &InputOptions::default()).unwrap();
            assert_eq!(cloud.precision(), precision);
            assert_eq!(cloud.sources()[0].records, Some(3));
        }
    }
}

#[test]
fn what_is_wrong_is_located() {
    let header =
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    for (data, parts) in [
        ("1 2 3\n4 5\n", ["line 9", "a value for each property"]),
        ("1 2 3\n4 five 6\n", ["line 9", "y, a number"]),
        ("1 2 3\n\n4 5 6\n", ["3 vertices", "the end of the file after 2"]),
    ] {
        let error = read((header.to_string() + data).as_bytes()).unwrap_err().to_string();
        assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    }
    let error = read(header.replace("float y", "float why").as_bytes()).unwrap_err().to_string();
    assert!(error.contains("vertex property y") && error.contains("x why z"), "{error}");
    assert!(is_ply(b"ply\r\n") && !is_ply(b"plywood"));
    assert!(Header::parse(Path::new("a"), b"ply\nend_header\n").is_err());
}
