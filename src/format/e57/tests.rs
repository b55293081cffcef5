//! E57 files made in code: by the crate `e57` for what other programs write, with their content changed for what none should.

use std::io::Cursor as IoCursor;
use std::path::PathBuf;

use e57::{
    CartesianCoordinate, E57Reader, E57Writer, Quaternion, Record, RecordDataType, RecordName, RecordValue, Transform,
    Translation,
};
use proptest::prelude::*;

use super::super::testing::{WithAttributes, collect};
use super::paged::checksum;
use crate::input::InputOptions;
use crate::points::Precision;
use crate::points::scalar::Scalar;

/// A scan to be written: what its records hold, and where it was taken.
type Made = (Vec<Record>, Vec<Vec<RecordValue>>, Option<Transform>);

fn written(scans: &[Made], crs: Option<&str>) -> Vec<u8> {
    let mut content = IoCursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut content, "file").unwrap();
    writer.set_coordinate_metadata(crs.map(str::to_string));
    for (i, (prototype, records, pose)) in scans.iter().enumerate() {
        let mut scan = writer.add_pointcloud(&format!("scan {i}"), prototype.clone()).unwrap();
        scan.set_transform(pose.clone());
        for record in records {
            scan.add_point(record.clone()).unwrap();
        }
        scan.finalize().unwrap();
    }
    writer.finalize().unwrap();
    drop(writer);
    content.into_inner()
}

fn file(content: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cloud.bin");
    std::fs::write(&path, content).unwrap();
    (dir, path)
}

fn record(name: RecordName, data_type: RecordDataType) -> Record {
    Record { name, data_type }
}

fn integer(min: i64, max: i64) -> RecordDataType {
    RecordDataType::Integer { min, max }
}

/// A scan with as many kinds of fields as there are.
fn varied(count: i64) -> Made {
    let scaled = RecordDataType::ScaledInteger { min: -500_000, max: 1_234_567, scale: 0.001, offset: 7.0 };
    let prototype = vec![
        record(RecordName::RowIndex, integer(0, 5_000_000)),
        record(RecordName::CartesianX, scaled.clone()),
        record(RecordName::CartesianY, RecordDataType::F64),
        record(RecordName::CartesianZ, RecordDataType::F32),
        record(RecordName::CartesianInvalidState, integer(0, 2)),
        record(RecordName::Intensity, integer(-3, 2000)),
        record(RecordName::ColorRed, RecordDataType::U8),
        record(RecordName::ColorGreen, integer(5, 5)),
        record(RecordName::ColorBlue, RecordDataType::U8),
        record(RecordName::ReturnIndex, integer(0, 6)),
        record(RecordName::ReturnCount, integer(0, 6)),
        record(RecordName::TimeStamp, RecordDataType::F64),
    ];
    let int = RecordValue::Integer;
    let records = (0..count).map(|i| {
        vec![
            int(i),
            RecordValue::ScaledInteger(i * 7 % 1_700_000 - 500_000),
            RecordValue::Double(i as f64 * 0.1),
            RecordValue::Single(-(i as f32)),
            int(if i % 10 == 3 { i % 2 + 1 } else { 0 }),
            int(i % 2003 - 3),
            int(i % 256),
            int(5),
            int(255 - i % 256),
            int(i % 4),
            int(4),
            RecordValue::Double(i as f64 * 0.5),
        ]
    });
    (prototype, records.collect(), None)
}

fn turned() -> Option<Transform> {
    let half = std::f64::consts::FRAC_PI_8;
    let rotation = Quaternion { w: half.cos(), x: 0.6 * half.sin(), y: 0.0, z: 0.8 * half.sin() };
    Some(Transform { rotation, translation: Translation { x: 500_000.0, y: -2.0, z: 3.5 } })
}

/// What the crate `e57` reads: the points that are valid, poses applied.
fn oracle(content: &[u8]) -> Vec<[f64; 3]> {
    let mut reader = E57Reader::new(IoCursor::new(content)).unwrap();
    let mut out = Vec::new();
    for scan in reader.pointclouds() {
        for point in reader.pointcloud_simple(&scan).unwrap() {
            if let CartesianCoordinate::Valid { x, y, z } = point.unwrap().cartesian {
                out.push([x, y, z]);
            }
        }
    }
    out
}

#[test]
fn scans_of_all_kinds_are_read_as_another_program_does() {
    let spherical = [RecordName::SphericalRange, RecordName::SphericalAzimuth, RecordName::SphericalElevation];
    let mut prototype: Vec<Record> = spherical.map(|name| record(name, RecordDataType::F64)).to_vec();
    prototype.push(record(RecordName::SphericalInvalidState, integer(0, 2)));
    let round = (0..500).map(|i| {
        let v = f64::from(i);
        let state = RecordValue::Integer(i64::from(i % 7 == 0));
        vec![RecordValue::Double(1.0 + v), RecordValue::Double(v * 0.01), RecordValue::Double(v * 0.002), state]
    });
    let round: Made = (prototype, round.collect(), turned());
    let (fields, records, _) = varied(150_000);
    let content = written(&[varied(1000), round, (fields, records, turned())], Some("EPSG:25832"));
    let (_dir, path) = file(&content);
    let read = WithAttributes::of(&path, &InputOptions::default()).unwrap();
    // The other program turns angles by the C library: a sine or cosine may differ in its last place.
    let expected = oracle(&content);
    assert_eq!(read.points.len(), expected.len());
    for (ours, theirs) in read.points.iter().zip(&expected) {
        let size = theirs.iter().fold(0.0f64, |size, c| size.max(c.abs()));
        assert!(
            ours.iter().zip(theirs).all(|(a, b)| (a - b).abs() <= 4.0 * f64::EPSILON * size),
            "{ours:?} {theirs:?}"
        );
    }
    assert_eq!(read.left_out, (100 + 72 + 15_000, 0));
    let source = &read.cloud.sources()[0];
    assert_eq!((source.format, source.records, source.description.as_str()), ("E57", Some(151_500), "E57, 3 scans"));
    assert_eq!(read.cloud.crs().unwrap().epsg, Some(25832));
    assert_eq!(read.cloud.precision(), Precision::Double);
    let valid: Vec<i64> = (0..1000).filter(|i| i % 10 != 3).collect();
    let expect = |name: &str, scalar: Scalar, value: &dyn Fn(i64) -> f64| {
        assert_eq!(read.cloud.schema().column(name).unwrap().scalar, scalar, "{name}");
        assert_eq!(read.values(name)[..900], valid.iter().map(|i| value(*i)).collect::<Vec<_>>(), "{name}");
    };
    expect("intensity", Scalar::I16, &|i| (i % 2003 - 3) as f64);
    expect("red", Scalar::U8, &|i| (i % 256) as f64);
    expect("blue", Scalar::U8, &|i| (255 - i % 256) as f64);
    expect("return_number", Scalar::U8, &|i| (i % 4 + 1) as f64);
    expect("number_of_returns", Scalar::U8, &|_| 4.0);
    expect("time", Scalar::F64, &|i| i as f64 * 0.5);
    assert!(read.values("intensity")[900..1300].iter().all(|v| *v == 0.0), "the scan that has none");
}

#[test]
fn points_in_single_precision_stay_so_without_a_pose() {
    let prototype = vec![Record::CARTESIAN_X_F32, Record::CARTESIAN_Y_F32, Record::CARTESIAN_Z_F32];
    let records: Vec<Vec<RecordValue>> =
        (0..10).map(|i| [0.1, 0.2, 0.3].map(|v| RecordValue::Single(v * i as f32)).to_vec()).collect();
    let (_dir, path) = file(&written(&[(prototype.clone(), records.clone(), None)], None));
    let read = WithAttributes::of(&path, &InputOptions::default()).unwrap();
    assert_eq!((read.cloud.precision(), read.points[3][0]), (Precision::Single, f64::from(0.1f32 * 3.0)));
    let (_dir, path) = file(&written(&[(prototype, records, turned())], None));
    assert_eq!(WithAttributes::of(&path, &InputOptions::default()).unwrap().cloud.precision(), Precision::Double);
}

#[test]
fn colours_are_spread_from_their_limits() {
    let xyz = [Record::CARTESIAN_X_F32, Record::CARTESIAN_Y_F32, Record::CARTESIAN_Z_F32];
    let names = [RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue];
    let scan = |kind: RecordDataType, values: [RecordValue; 3]| -> Made {
        let colours = names.clone().map(|name| record(name, kind.clone()));
        let values = [vec![RecordValue::Single(1.0); 3], values.to_vec()].concat();
        ([xyz.to_vec(), colours.to_vec()].concat(), vec![values], None)
    };
    let int = |v: [i64; 3]| v.map(RecordValue::Integer);
    let bytes = || scan(integer(0, 255), int([0, 128, 255]));
    let narrow = scan(integer(0, 15), int([0, 5, 15]));
    let floats = scan(RecordDataType::UNIT_F32, [0.0, 0.5, 1.0].map(RecordValue::Single));
    let wide = scan(integer(0, 65535), int([0, 77, 65535]));
    let ten = scan(integer(0, 1023), int([0, 1, 1023]));
    for (scans, scalar, expected) in [
        (vec![bytes()], Scalar::U8, vec![[0.0, 128.0, 255.0]]),
        (vec![narrow], Scalar::U8, vec![[0.0, 85.0, 255.0]]),
        (vec![floats], Scalar::U16, vec![[0.0, 32768.0, 65535.0]]),
        (vec![wide, bytes()], Scalar::U16, vec![[0.0, 77.0, 65535.0], [0.0, 32896.0, 65535.0]]),
        (vec![ten], Scalar::U16, vec![[0.0, 64.0, 65535.0]]),
    ] {
        let (_dir, path) = file(&written(&scans, None));
        let read = WithAttributes::of(&path, &InputOptions::default()).unwrap();
        let [red, green, blue] = ["red", "green", "blue"].map(|name| read.values(name));
        let found: Vec<[f64; 3]> = (0..red.len()).map(|i| [red[i], green[i], blue[i]]).collect();
        assert_eq!((read.cloud.schema().column("red").unwrap().scalar, found), (scalar, expected));
    }
}

/// What is in the pages, without checksums.
fn content_of(pages: &[u8]) -> Vec<u8> {
    pages.chunks_exact(1024).flat_map(|page| page[..1020].to_vec()).collect()
}

/// Pages, with checksums.
fn in_pages(content: &[u8]) -> Vec<u8> {
    let page = |content: &[u8]| {
        let mut page = content.to_vec();
        page.resize(1020, 0);
        let sum = checksum(&page).to_be_bytes();
        [page, sum.to_vec()].concat()
    };
    content.chunks(1020).flat_map(page).collect()
}

#[test]
fn what_is_wrong_is_named() {
    let whole = content_of(&written(&[varied(50)], None));
    // Everywhere, so that beginnings and ends of elements still fit.
    let text = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let mut content = whole.clone();
        let places = whole.windows(from.len()).enumerate().filter(|(_, w)| *w == from.as_bytes()).map(|(at, _)| at);
        assert!(places.clone().count() > 0, "{from}");
        places.for_each(|at| content[at..at + to.len()].copy_from_slice(to.as_bytes()));
        content
    };
    let byte = |at: usize, byte: u8| {
        let mut content = whole.clone();
        content[at] = byte;
        content
    };
    for (content, expected) in [
        (byte(8, 2), "version 1, pages of 1024 bytes, found version 2"),
        (byte(41, 8), "pages of 2048"),
        (byte(31, 1), "the end of the file after"),
        (byte(39, 1), "at most 4194304 bytes of XML"),
        (byte(33, 0xff), "a page of 1024 bytes, found the file's end"),
        (byte(48, 2), "a section of points (1), found 2"),
        (byte(48 + 32, 7), "a packet, found kind 7"),
        (byte(48 + 32 + 4, 3), "12 streams within the packet, found 3 streams"),
        (byte(48 + 32 + 7, 0xff), "12 streams within the packet"),
        (text("<e57Root", "<x57Root"), "E57 XML"),
        (text("cartesianX", "cartesianQ"), "points without cartesian or spherical coordinates"),
        (text("</cartesianX>", "</cartesianQ>"), "the end of \"cartesianQ\" within \"cartesianX\""),
        (text("recordCount=\"50\"", "recordCount=\"99\""), "scan 0, 99 records before its end"),
        (text("recordCount=\"50\"", "recordCount=\"-1\""), "recordCount \"-1\" of points"),
        (text("minimum=\"-3\"", "minimum=\"3.\""), "minimum \"3.\" of intensity"),
        (text("maximum=\"2000\"", "maximum=\"-200\""), "maximum -200 below minimum -3 of intensity"),
        (text("scale=\"0.001\"", "scale=\"0.000\""), "scale 0 and offset 7 of cartesianX"),
        (text("type=\"ScaledInteger\"", "type=\"ScaledIntegeR\""), "type \"ScaledIntegeR\" of cartesianX"),
    ] {
        let (_dir, path) = file(&in_pages(&content));
        let error = collect(&path, &InputOptions::default()).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
    let mut pages = written(&[varied(50)], None);
    pages[1500] ^= 1;
    let (_dir, path) = file(&pages);
    let error = collect(&path, &InputOptions::default()).unwrap_err().to_string();
    assert!(error.contains("page at byte 1024: expected content that has its checksum"), "{error}");
}

#[test]
fn as_many_points_as_you_like_of_no_bits_are_refused() {
    let nowhere = [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ];
    let mut prototype: Vec<Record> = nowhere.map(|name| record(name, integer(5, 5))).to_vec();
    prototype.push(record(RecordName::RowIndex, integer(0, 9)));
    let scan: Made = (prototype, vec![vec![RecordValue::Integer(5); 4]; 10], None);
    let content = written(&[scan], None);
    let (_dir, path) = file(&content);
    assert_eq!(collect(&path, &InputOptions::default()).unwrap().0, [[5.0; 3]; 10]);
    let mut content = content_of(&content);
    let at = content.windows(16).position(|w| w == b"recordCount=\"10\"").unwrap();
    content.splice(at + 13..at + 15, *b"999999999999999");
    content[32] += 13;
    let (_dir, path) = file(&in_pages(&content));
    let error = collect(&path, &InputOptions::default()).unwrap_err().to_string();
    assert!(error.contains("coordinates that differ"), "{error}");
}

#[test]
fn a_file_that_is_cut_short_is_an_error_at_every_length() {
    let content = written(&[varied(30)], None);
    let (_dir, path) = file(&content);
    assert_eq!(collect(&path, &InputOptions::default()).unwrap().0.len(), 27);
    for end in 8..content.len() {
        std::fs::write(&path, &content[..end]).unwrap();
        assert!(collect(&path, &InputOptions::default()).is_err(), "{end} bytes");
    }
}

proptest! {
    #[test]
    fn no_content_makes_it_panic(
        broken in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        digits in prop::collection::vec((any::<prop::sample::Index>(), b'0'..=b'9'), 0..4),
        cut: prop::sample::Index,
        whole: bool,
        paged: bool,
    ) {
        let mut content = content_of(&written(&[varied(40)], None));
        for (at, byte) in broken {
            let at = at.index(content.len());
            content[at] = byte;
        }
        let places: Vec<usize> = (0..content.len()).filter(|&i| content[i].is_ascii_digit()).collect();
        for (at, digit) in digits {
            content[places[at.index(places.len())]] = digit;
        }
        if !whole {
            content.truncate(cut.index(content.len()));
        }
        let (_dir, path) = file(&if paged { in_pages(&content) } else { content });
        drop(collect(&path, &InputOptions::default()));
    }
}
