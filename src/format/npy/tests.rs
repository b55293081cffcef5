use proptest::prelude::*;

use super::super::testing::{read, refused};
use super::*;
use crate::points::Precision;

fn file(version: u8, header: &str, data: &[u8]) -> Vec<u8> {
    let mut out = SIGNATURE.to_vec();
    out.extend([version, 0]);
    match version {
        1 => out.extend((header.len() as u16).to_le_bytes()),
        _ => out.extend((header.len() as u32).to_le_bytes()),
    }
    [&out, header.as_bytes(), data].concat()
}

fn header(descr: &str, fortran: &str, shape: &str) -> String {
    format!("{{'descr': {descr}, 'fortran_order': {fortran}, 'shape': {shape}, }}          \n")
}

/// Numbers 0, 1, 2, … as a type has them.
fn numbers(kind: &str, count: u32) -> Vec<u8> {
    let scalar = Scalar::of_numpy(&kind[1..]).unwrap();
    let mut out = Vec::new();
    for i in 0..count {
        let from = out.len();
        scalar.put(f64::from(i), &mut out);
        if (kind.as_bytes()[0] == b'>') == (Endian::NATIVE == Endian::Little) {
            out[from..].reverse();
        }
    }
    out
}

#[test]
fn arrays_of_every_type_order_and_version_are_read() {
    for kind in ["<f4", ">f4", "<f8", ">f8", "|u1", "|i1", "<u2", ">i2", "<i4", ">u4", "<i8", ">u8"] {
        for version in [1, 2, 3] {
            for (fortran, shape, at) in [
                ("False", "(5, 4)", [4, 1]),
                ("True", "(5, 4)", [1, 5]),
                ("False", "(5L, 1, 4L)", [4, 1]),
                ("True", "(1, 5, 4)", [1, 5]),
            ] {
                let content = file(version, &header(&format!("'{kind}'"), fortran, shape), &numbers(kind, 20));
                let found = read("a.npy", &content).unwrap();
                let expected: Vec<[f64; 3]> =
                    (0..5).map(|i| [0, 1, 2].map(|axis| f64::from(i * at[0] + axis * at[1]))).collect();
                assert_eq!(found.points, expected, "{kind} {fortran} {shape}");
                assert_eq!(found.precision == Precision::Single, kind.ends_with("f4"));
                assert!(found.description.contains("x y z in columns 1 2 3, 1 without names ignored"));
            }
        }
    }
}

const RECORDS: &str = "[('Z', '<f8'), ('pad', '|V3'), (('title', 'x'), '<f8'), ('y', '<f8'), ('shape', '<i2', (2, 2)), ('name', '<U2'), \
    ('inner', [('a', '<f4'), ('b', '|u1')]), ('Intensity', '<u2'), ('ok', '|b1'), ('when', '<M8[ns]')]";

fn records() -> Vec<u8> {
    let mut data = Vec::new();
    for i in 0..3u16 {
        data.extend(f64::from(30 + i).to_le_bytes());
        data.extend([9; 3]);
        data.extend(f64::from(10 + i).to_le_bytes());
        data.extend(f64::from(20 + i).to_le_bytes());
        data.extend([9; 8 + 8 + 5]);
        data.extend((500 + i).to_le_bytes());
        data.push(1);
        data.extend([9; 8]);
    }
    file(1, &header(RECORDS, "False", "(3,)"), &data)
}

#[test]
fn records_have_attributes() {
    let found = read("a", &records()).unwrap();
    assert_eq!(found.points, [0.0, 1.0, 2.0].map(|i| [10.0 + i, 20.0 + i, 30.0 + i]));
    let expected = [
        ("intensity".to_string(), Scalar::U16, vec![500.0, 501.0, 502.0]),
        ("ok".to_string(), Scalar::U8, vec![1.0; 3]),
    ];
    assert_eq!(found.attributes, expected);
    assert_eq!(found.description, "NPY of records of 59 bytes, 3 points");
}

#[test]
fn what_is_wrong_in_a_header_is_named() {
    let plain = |descr: &str, fortran: &str, shape: &str| file(1, &header(descr, fortran, shape), &[0; 600]);
    let big = "18446744073709551615";
    for (content, says) in [
        (plain("'<f4'", "Maybe", "(5, 3)"), "fortran_order True or False"),
        (plain("'<f4'", "False", "5"), "a shape of whole numbers"),
        (plain("'<f4'", "False", "(5, -3)"), "a literal of Python, found \"-3"),
        (plain("'<f4'", "False", "('5', 3)"), "a shape of whole numbers"),
        (plain("'<f4'", "False", "()"), "a shape (n, m) with m from 3 to 64"),
        (plain("'<f4'", "False", "(15,)"), "a shape (n, m) with m from 3 to 64, found [15]"),
        (plain("'<f4'", "False", "(5, 2)"), "a shape (n, m) with m from 3 to 64"),
        (plain("'<f4'", "False", "(3, 1000)"), "a shape (n, m) with m from 3 to 64"),
        (plain("'<f4'", "False", &format!("({big}, {big}, 3)")), "a shape of an array"),
        (plain("'<f4'", "False", &format!("({big}, 3)")), "point 50: expected 18446744073709551615 points of 12 bytes"),
        (plain("'<f4'", "False", &format!("({big}0, 3)")), "a literal of Python"),
        (plain("'<f4'", "True", "(51, 3)"), "point 50: expected 51 points of 12 bytes"),
        (plain("'<f2'", "False", "(5, 3)"), "found type \"<f2\""),
        (plain("'|O'", "False", "(5, 3)"), "a type such as '<f4', found \"|O\""),
        (plain("7", "False", "(5, 3)"), "a type such as '<f4', or a list"),
        (plain("[('x', '<f4'), ('y', '<f4')]", "False", "(5,)"), "a field z, a number"),
        (plain("[('x', '<f4'), ('y', '<f4'), ('z', '<f4', 2)]", "False", "(5,)"), "a field z, a number"),
        (plain("[('x', '<f4'), ('y', '>f4'), ('z', '<f4')]", "False", "(5,)"), "one byte order for all fields"),
        (
            plain("[('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('s', '|S99999999999')]", "False", "(5,)"),
            "at most 65536 bytes",
        ),
        (
            plain("[('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('s', '<f4', (99999, 999999))]", "False", "(5,)"),
            "at most 65536",
        ),
        (plain("[('x',)]", "False", "(5,)"), "fields such as ('x', '<f4')"),
        (file(1, "{'descr': '<f4'}", b""), "a dictionary with fortran_order"),
        (file(1, "7", b""), "a dictionary with descr"),
        (file(1, &"[".repeat(5000), b""), "a literal of Python"),
        (file(1, "{'descr': '<f4", b""), "a literal of Python"),
        (file(4, &header("'<f4'", "False", "(5, 3)"), b""), "version 1, 2 or 3, found 4"),
        ([SIGNATURE, &[2, 0, 0xff, 0xff, 0xff, 0xff]].concat(), "a header of at most 256 KiB"),
    ] {
        let error = refused("a.npy", &content);
        assert!(error.contains(says), "{says}: {error}");
    }
}

#[test]
fn no_prefix_is_a_file() {
    let plain = |version: u8, fortran: &str| file(version, &header("'<f4'", fortran, "(2, 3)"), &numbers("<f4", 6));
    for whole in [plain(1, "False"), plain(2, "True"), records()] {
        for end in SIGNATURE.len()..whole.len() {
            assert!(read("a.npy", &whole[..end]).is_err(), "prefix of {end} bytes");
        }
    }
}

proptest! {
    #[test]
    fn no_content_makes_it_panic(
        which in 0usize..3,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        tail in prop::collection::vec(any::<u8>(), 0..40),
    ) {
        let plain = |version: u8, fortran: &str| file(version, &header("'<f4'", fortran, "(2, 3)"), &numbers("<f4", 6));
        let mut content = [plain(1, "False"), plain(2, "True"), records()][which].clone();
        for (at, byte) in changes {
            let at = at.index(content.len());
            content[at] = byte;
        }
        drop(read("a.npy", &[&content[..], &tail].concat()));
    }
}
