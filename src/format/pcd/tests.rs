use proptest::prelude::*;

use super::super::lzf::tests::packed;
use super::super::testing::{read, refused};
use super::*;

const HEAD: &str = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb _ intensity fpfh\nSIZE 4 4 4 4 1 2 4\nTYPE F F F U U U F\n\
    COUNT 1 1 1 1 2 1 3\nWIDTH 2\nHEIGHT 2\nVIEWPOINT 0 0 9 1 0 0 0\nPOINTS 4\nDATA ";

/// The four points of that header; one of them was not seen.
fn record(i: u16) -> Vec<u8> {
    let mut out = Vec::new();
    let coordinates = if i == 2 { [f32::NAN; 3] } else { [f32::from(i), 0.1, -5.5] };
    coordinates.iter().for_each(|v| out.extend(v.to_le_bytes()));
    out.extend((0xff01_0200u32 + u32::from(i)).to_le_bytes());
    out.extend([7, 7]);
    out.extend((1000 + i).to_le_bytes());
    (0..3).for_each(|v| out.extend((v as f32).to_le_bytes()));
    out
}

fn binary() -> Vec<u8> {
    let records: Vec<u8> = (0..4).flat_map(record).collect();
    [HEAD.as_bytes(), b"binary\n", &records].concat()
}

fn ascii(nan: &str) -> Vec<u8> {
    let mut text = format!("{HEAD}ascii\n");
    for i in 0..4 {
        let xyz = if i == 2 { [nan; 3].join(" ") } else { format!("{i} 0.1 -5.5") };
        text += &format!("{xyz} {} 7 7 {} 0 1 2\r\n", 0xff01_0200u32 + i, 1000 + i);
    }
    text.into_bytes()
}

/// As the Point Cloud Library writes it: by columns, without padding.
fn compressed() -> Vec<u8> {
    let mut columns = Vec::new();
    for range in [0..4, 4..8, 8..12, 12..16, 18..20, 20..32] {
        (0..4).for_each(|i| columns.extend_from_slice(&record(i)[range.clone()]));
    }
    let packed = packed(&columns);
    let lengths = [packed.len() as u32, columns.len() as u32].map(u32::to_le_bytes).concat();
    [HEAD.as_bytes(), b"binary_compressed\n", &lengths, &packed].concat()
}

#[test]
fn all_three_encodings_give_the_same() {
    let expected = read("a.pcd", &binary()).unwrap();
    assert_eq!(expected.description, "PCD binary, 4 points in single precision");
    let y = f64::from(0.1f32);
    assert_eq!((expected.points.as_slice(), expected.dropped), ([0.0, 1.0, 3.0].map(|x| [x, y, -5.5]).as_slice(), 1));
    let u8s = |name: &str, values: [f64; 3]| (name.to_string(), Scalar::U8, values.to_vec());
    assert_eq!(
        expected.attributes,
        [
            u8s("red", [1.0; 3]),
            u8s("green", [2.0; 3]),
            u8s("blue", [0.0, 1.0, 3.0]),
            ("intensity".to_string(), Scalar::U16, vec![1000.0, 1001.0, 1003.0]),
        ]
    );
    for content in [ascii("nan"), ascii("NaN"), compressed()] {
        let other = read("b.bin", &content).unwrap();
        assert_eq!(
            (other.points, other.dropped, other.attributes),
            (expected.points.clone(), 1, expected.attributes.clone())
        );
    }
}

#[test]
fn columns_of_many_blocks_are_read() {
    let count = 3 * crate::input::BLOCK_RECORDS as u32 / 2;
    let mut columns: Vec<u8> = Vec::new();
    for axis in 0..3 {
        (0..count).for_each(|i| columns.extend(f64::from(i * 3 + axis).to_le_bytes()));
    }
    // All bytes as they are: 32 at a time.
    let packed: Vec<u8> = columns.chunks(32).flat_map(|c| [&[c.len() as u8 - 1], c].concat()).collect();
    let lengths = [packed.len() as u32, columns.len() as u32].map(u32::to_le_bytes).concat();
    let head = format!("VERSION .7\nFIELDS x y z\nSIZE 8 8 8\nWIDTH {count}\nDATA binary_compressed\n");
    let found = read("a", &[head.as_bytes(), &lengths, &packed].concat()).unwrap();
    let expected: Vec<[f64; 3]> = (0..count).map(|i| [0, 1, 2].map(|axis| f64::from(i * 3 + axis))).collect();
    assert!(found.points == expected && found.precision == Precision::Double);
}

#[test]
fn colours_of_every_kind_are_unpacked() {
    let bits = 0x4001_0203u32;
    for (size_and_type, number) in
        [("F", f32::from_bits(bits).to_string()), ("U", bits.to_string()), ("I", bits.to_string())]
    {
        let text = format!("FIELDS rgba x y z\nTYPE {size_and_type} F F F\nWIDTH 1\nDATA ascii\n{number} 1 2 3\n");
        let found = read("a", text.as_bytes()).unwrap();
        let values: Vec<(&str, f64)> = found.attributes.iter().map(|(name, _, v)| (name.as_str(), v[0])).collect();
        assert_eq!(values, [("red", 1.0), ("green", 2.0), ("blue", 3.0), ("alpha", 64.0)], "{text}");
    }
    let negative = "FIELDS rgb x y z\nTYPE I F F F\nWIDTH 2\nDATA ascii\n-16711423 1 2 3\n0 1 2 3\n";
    let found = read("a", negative.as_bytes()).unwrap();
    assert_eq!(found.attributes.iter().map(|(.., v)| v[0]).collect::<Vec<_>>(), [1.0, 1.0, 1.0]);
    let nan = "FIELDS rgb x y z\nWIDTH 1\nDATA ascii\nnan 1 2 3\n";
    assert_eq!(read("a", nan.as_bytes()).unwrap().attributes[0].2, [0.0]);
}

#[test]
fn old_headers_have_defaults() {
    let text = "COLUMNS x y z\nPOINTS 2\nDATA ascii\n1 2 3\n\n4 5 6\n";
    assert_eq!(read("a.xyz", text.as_bytes()).unwrap().points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
}

#[test]
fn what_is_wrong_in_a_header_is_named() {
    for (from, to, says) in [
        ("FIELDS x y", "FIELDS x u", "expected a field y of one number"),
        ("COUNT 1 1 1 1 2 1 3", "COUNT 1 2 1 1 2 1 3", "expected a field y of one number"),
        ("SIZE 4 4 4 4 1 2 4", "SIZE 4 4 4 4", "as many words behind SIZE as FIELDS, 7, found 4"),
        ("SIZE 4", "SIZE four", "header line 4: expected SIZE and the bytes of each field"),
        ("SIZE 4", "SIZE 3", "type I or U with size 1, 2, 4 or 8"),
        ("4 1 2 4\n", "4 0 2 4\n", "type I or U with size"),
        ("TYPE F", "TYPE X", "of type \"X\" and size 4"),
        ("2 1 3\n", "2 1 99999999999999999999\n", "COUNT and the numbers"),
        ("2 1 3\n", "2 1 9999999999999999999\n", "a point of at most 65536 bytes"),
        ("2 1 3\n", "2 1 20000\n", "a point of at most 65536 bytes"),
        ("WIDTH 2", "WIDTH two", "a number behind the word"),
        ("WIDTH 2", "WIDTH -2", "a number behind the word"),
        ("HEIGHT 2", "HEIGHT 3", "as many POINTS as WIDTH times HEIGHT, 6, found 4"),
        ("HEIGHT 2", "HEIGHT 18446744073709551615", "WIDTH and HEIGHT of a cloud"),
        ("POINTS 4", "POINTS many", "a number behind the word"),
        ("DATA ", "DATA un", "DATA and ascii, binary or binary_compressed"),
        ("VIEWPOINT", "VIEWPINT", "a line of a PCD header"),
    ] {
        for whole in [ascii("nan"), binary(), compressed()] {
            let at = whole.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
            let broken = [&whole[..at], to.as_bytes(), &whole[at + from.len()..]].concat();
            let error = refused("a.pcd", &broken);
            assert!(error.contains(says), "{to}: {error}");
        }
    }
    let endless = [b"# .PCD v0.7\n".as_slice(), &b"# comment\n".repeat(10_000)].concat();
    assert!(refused("a", &endless).contains("a header of more than 64 KiB"));
    assert!(refused("a", b"# .PCD v0.7\nFIELDS x y z\nDATA ascii\n").contains("a line POINTS or WIDTH"));
    assert!(refused("a", b"# .PCD v0.7\nWIDTH 1\nDATA ascii\n").contains("FIELDS before DATA"));
}

#[test]
fn no_prefix_is_a_file() {
    for whole in [ascii("nan"), binary(), compressed()] {
        // Of text, the last line may lack its end and its last numbers, which nobody reads.
        let most = if whole.ends_with(b"\r\n") { whole.len() - b" 0 1 2\r\n".len() - 3 } else { whole.len() };
        for end in 12..most {
            assert!(read("a.pcd", &whole[..end]).is_err(), "prefix of {end} bytes");
        }
    }
}

#[test]
fn damaged_compressed_data_is_located() {
    let whole = compressed();
    let start = whole.windows(11).position(|w| w == b"compressed\n").unwrap() + 11;
    let with = |at: usize, bytes: &[u8]| [&whole[..start + at], bytes, &whole[start + at + bytes.len()..]].concat();
    for (broken, says) in [
        (with(0, &[0xff; 4]), "expected 4294967295 bytes, compressed"),
        (with(0, &[1, 0, 0, 0]), "a whole token of LZF"),
        (with(0, &[2, 0, 0, 0]), "120 bytes, once unpacked, found 119 less"),
        (with(4, &[0xff; 4]), "expected 4 points of 30 bytes, found 4294967295 bytes, once unpacked"),
        (with(8, &[0xff, 0, 0]), "a copy of bytes that are there, found one of bytes before the first"),
        (with(10, &[0xe0, 0xff, 0]), "120 bytes, once unpacked, found more"),
    ] {
        let error = refused("a.pcd", &broken);
        assert!(error.contains(says), "{error}");
    }
}

proptest! {
    #[test]
    fn no_content_makes_it_panic(
        which in 0usize..3,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        tail in prop::collection::vec(any::<u8>(), 0..40),
    ) {
        let mut content = [ascii("nan"), binary(), compressed()][which].clone();
        for (at, byte) in changes {
            let at = at.index(content.len());
            content[at] = byte;
        }
        drop(read("a.pcd", &[&content[..], &tail].concat()));
    }
}
