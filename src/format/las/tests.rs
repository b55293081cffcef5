//! LAS and LAZ files made in code: by the crate `las` for what other programs write, byte by byte for what none should.

use std::io::Cursor as IoCursor;
use std::path::{Path, PathBuf};

use laz::{LasZipCompressor, LazItemRecordBuilder, LazVlr, LazVlrBuilder};
use proptest::prelude::*;

use super::super::testing::{WithAttributes, collect};
use super::fields;
use crate::error::Result;
use crate::input::{Cloud, Filter, InputOptions, Opening, Withheld};
use crate::points::attribute::Wanted;
use crate::points::crs::Crs;
use crate::points::unit::{Measure, Unit};
use crate::resources::workers::Workers;
use crate::storage::spool::Workspace;

/// How the points of a made file lie in it.
#[derive(Debug, Clone)]
enum Pack {
    Plain,
    One,
    Fixed(u32),
    Varying(Vec<usize>),
}

const SCALE: f64 = 0.001;
const OFFSET: [f64; 3] = [500_000.0, 4_000_000.0, 100.0];

/// A VLR.
fn record(user: &str, number: u16, content: &[u8]) -> Vec<u8> {
    let mut vlr = vec![0; 54];
    vlr[2..2 + user.len()].copy_from_slice(user.as_bytes());
    vlr[18..20].copy_from_slice(&number.to_le_bytes());
    vlr[20..22].copy_from_slice(&(content.len() as u16).to_le_bytes());
    vlr.extend_from_slice(content);
    vlr
}

/// A file of these records, of `length` bytes each.
fn made(point_format: u8, length: usize, records: &[u8], pack: &Pack, mut vlrs: Vec<Vec<u8>>) -> Vec<u8> {
    let minor = if point_format < 6 { 2u8 } else { 4 };
    let header_length = if minor == 4 { 375 } else { 227 };
    let count = (records.len() / length) as u64;
    let laz = match pack {
        Pack::Plain => None,
        _ => {
            let extra = (length - fields::length(point_format).unwrap()) as u16;
            let items = LazItemRecordBuilder::default_for_point_format_id(point_format, extra).unwrap();
            let builder = LazVlrBuilder::new(items);
            Some(match pack {
                Pack::Varying(_) => builder.with_variable_chunk_size().build(),
                Pack::Fixed(size) => builder.with_fixed_chunk_size(*size).build(),
                _ => builder.with_fixed_chunk_size(u32::MAX - 1).build(),
            })
        }
    };
    if let Some(vlr) = &laz {
        let mut content = Vec::new();
        vlr.write_to(&mut content).unwrap();
        if matches!(pack, Pack::One) {
            content[0] = 1;
        }
        vlrs.push(record(LazVlr::USER_ID, LazVlr::RECORD_ID, &content));
    }
    let start = header_length + vlrs.iter().map(Vec::len).sum::<usize>();
    let mut file = vec![0; header_length];
    file[..4].copy_from_slice(b"LASF");
    file[24..26].copy_from_slice(&[1, minor]);
    file[94..96].copy_from_slice(&(header_length as u16).to_le_bytes());
    file[96..100].copy_from_slice(&(start as u32).to_le_bytes());
    file[100..104].copy_from_slice(&(vlrs.len() as u32).to_le_bytes());
    file[104] = point_format | if laz.is_some() { 0x80 } else { 0 };
    file[105..107].copy_from_slice(&(length as u16).to_le_bytes());
    if minor < 4 {
        file[107..111].copy_from_slice(&(count as u32).to_le_bytes());
    } else {
        file[247..255].copy_from_slice(&count.to_le_bytes());
    }
    for axis in 0..3 {
        file[131 + 8 * axis..139 + 8 * axis].copy_from_slice(&SCALE.to_le_bytes());
        file[155 + 8 * axis..163 + 8 * axis].copy_from_slice(&OFFSET[axis].to_le_bytes());
    }
    file.extend(vlrs.concat());
    let Some(vlr) = laz else {
        file.extend_from_slice(records);
        return file;
    };
    let mut out = IoCursor::new(file);
    out.set_position(start as u64);
    let mut compressor = LasZipCompressor::new(out, vlr).unwrap();
    match pack {
        Pack::Varying(sizes) => {
            let mut rest = records;
            for size in sizes {
                let (chunk, behind) = rest.split_at((size * length).min(rest.len()));
                compressor.compress_many(chunk).unwrap();
                compressor.finish_current_chunk().unwrap();
                rest = behind;
            }
            compressor.compress_many(rest).unwrap();
        }
        _ => compressor.compress_many(records).unwrap(),
    }
    compressor.done().unwrap();
    let mut file = compressor.into_inner().into_inner();
    if matches!(pack, Pack::One) {
        // No place for a table, nor a table.
        let table = u64::from_le_bytes(file[start..start + 8].try_into().unwrap()) as usize;
        file.truncate(table);
        file.drain(start..start + 8);
    }
    file
}

/// Records of points that wander about, with all other bytes following some pattern.
fn wandering(length: usize, count: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(length * count);
    for i in 0..count {
        let wave = |a: f64| ((i as f64 * a).sin() * 50_000.0) as i32;
        for v in [wave(0.01), wave(0.013), wave(0.003)] {
            out.extend(v.to_le_bytes());
        }
        out.extend((12..length).map(|b| (i / (b + 1) % 251) as u8));
    }
    out
}

fn file(content: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cloud.bin");
    std::fs::write(&path, content).unwrap();
    (dir, path)
}

fn keeping_withheld() -> InputOptions {
    InputOptions { filter: Filter { withheld: Withheld::Kept, ..Filter::default() }, ..InputOptions::default() }
}

/// As a whole run reads it: LAZ is decompressed once for all passes.
fn decompressed_once(path: &Path, options: &InputOptions) -> Result<WithAttributes> {
    let workspace = Workspace::unchecked(path.parent().unwrap().to_path_buf());
    let workers = Workers::new(2).unwrap();
    let opening =
        Opening { workspace: &workspace, memory: 1 << 20, decompress: Some(&workers), watch: &mut |_| Ok(()) };
    WithAttributes::of_cloud(Cloud::open_in(&[path.to_path_buf()], options, opening)?)
}

fn stored(points: &[[f64; 3]]) -> Vec<[i32; 3]> {
    let stored = |p: &[f64; 3]| [0, 1, 2].map(|a| ((p[a] - OFFSET[a]) / SCALE).round() as i32);
    points.iter().map(stored).collect()
}

fn in_records(records: &[u8], length: usize) -> Vec<[i32; 3]> {
    let int = |b: &[u8]| i32::from_le_bytes(b.try_into().unwrap());
    records.chunks_exact(length).map(|r| [0, 1, 2].map(|a| int(&r[4 * a..4 * a + 4]))).collect()
}

#[test]
fn what_another_program_writes_is_read_in_every_point_format() {
    use las::point::{Classification, ScanDirection};
    for point_format in 0..=10u8 {
        for compressed in [false, true] {
            let mut format = las::point::Format::new(point_format).unwrap();
            // Neither the writer nor its reader knows of compressed wave forms.
            if format.has_waveform && compressed {
                continue;
            }
            format.is_compressed = compressed;
            let mut builder = las::Builder::from((1, if point_format < 6 { 3 } else { 4 }));
            builder.point_format = format;
            let transform = las::Transform { scale: 0.01, offset: 1000.0 };
            builder.transforms = las::Vector { x: transform, y: transform, z: transform };
            let mut writer = las::Writer::new(IoCursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
            let many = 1000u16;
            for i in 0..many {
                let v = f64::from(i);
                let point = las::Point {
                    x: 1000.0 + v * 0.01,
                    y: 1000.0 - v * 0.02,
                    z: 1000.0 + v,
                    intensity: i * 61,
                    return_number: 1 + (i % 5) as u8,
                    number_of_returns: 5,
                    scan_direction: if i % 3 == 0 { ScanDirection::LeftToRight } else { ScanDirection::RightToLeft },
                    is_edge_of_flight_line: i % 7 == 0,
                    classification: Classification::new((i % 8 + 1) as u8).unwrap_or(Classification::Ground),
                    is_synthetic: i % 11 == 0,
                    is_key_point: i % 13 == 0,
                    user_data: (i % 200) as u8,
                    point_source_id: i * 3,
                    scan_angle: f32::from(i % 30) - 15.0,
                    gps_time: format.has_gps_time.then_some(v * 1.5),
                    color: format.has_color.then(|| las::Color::new(i * 65, i * 64, 65535 - i)),
                    nir: format.has_nir.then_some(i * 2),
                    waveform: format.has_waveform.then(Default::default),
                    ..las::Point::default()
                };
                writer.write_point(point).unwrap();
            }
            writer.close().unwrap();
            let content = writer.into_inner().unwrap().into_inner();
            let (_dir, path) = file(&content);
            let read = WithAttributes::of(&path, &InputOptions::default()).unwrap();
            let what = format!("point format {point_format}, compressed {compressed}");
            assert_eq!(read.points.len(), usize::from(many), "{what}");
            let expect = |name: &str, value: &dyn Fn(u16) -> f64| {
                let expected: Vec<f64> = (0..many).map(value).collect();
                assert_eq!(read.values(name), expected, "{what}: {name}");
            };
            for (i, p) in read.points.iter().enumerate() {
                let v = i as f64;
                assert_eq!(*p, [v, -2.0 * v, 100.0 * v].map(|stored| stored * 0.01 + 1000.0), "{what}");
            }
            let flag = |bit: bool| f64::from(u8::from(bit));
            expect("intensity", &|i| f64::from(i * 61));
            expect("return_number", &|i| f64::from(1 + i % 5));
            expect("number_of_returns", &|_| 5.0);
            expect("scan_direction", &|i| flag(i % 3 == 0));
            expect("edge_of_flight_line", &|i| flag(i % 7 == 0));
            expect("classification", &|i| f64::from(i % 8 + 1));
            expect("synthetic", &|i| flag(i % 11 == 0));
            expect("key_point", &|i| flag(i % 13 == 0));
            expect("user_data", &|i| f64::from(i % 200));
            expect("point_source_id", &|i| f64::from(i * 3));
            let steps = if point_format < 6 { 1.0 } else { 0.006f32 };
            expect("scan_angle", &|i| f64::from(((f32::from(i % 30) - 15.0) / steps) as i16));
            if format.has_gps_time {
                expect("gps_time", &|i| f64::from(i) * 1.5);
            }
            if format.has_color {
                expect("red", &|i| f64::from(i * 65));
                expect("blue", &|i| f64::from(65535 - i));
            }
            if format.has_nir {
                expect("nir", &|i| f64::from(i * 2));
            }
        }
    }
}

#[test]
fn compressed_files_give_what_plain_ones_do_however_they_are_chunked() {
    for (point_format, extra) in [(0, 0), (1, 3), (3, 0), (4, 0), (5, 2), (6, 0), (7, 5), (8, 0), (9, 0), (10, 1)] {
        let length = fields::length(point_format).unwrap() + extra;
        let records = wandering(length, 3000);
        let (_dir, path) = file(&made(point_format, length, &records, &Pack::Plain, vec![]));
        let plain = WithAttributes::of(&path, &keeping_withheld()).unwrap();
        assert_eq!(stored(&plain.points), in_records(&records, length));
        let mut packs =
            vec![Pack::Fixed(1000), Pack::Fixed(700), Pack::Fixed(5000), Pack::Varying(vec![10, 1, 2000, 500])];
        if point_format < 6 {
            packs.push(Pack::One);
        }
        for pack in packs {
            let content = made(point_format, length, &records, &pack, vec![]);
            let start = u32::from_le_bytes(content[96..100].try_into().unwrap()) as usize;
            let mut variants = vec![("as written", content.clone())];
            if !matches!(pack, Pack::One) {
                let place: [u8; 8] = content[start..start + 8].try_into().unwrap();
                let mut streamed = content.clone();
                streamed[start..start + 8].copy_from_slice(&(-1i64).to_le_bytes());
                let without = streamed[..u64::from_le_bytes(place) as usize].to_vec();
                streamed.extend(place);
                variants.push(("the table's place at the end", streamed));
                if point_format >= 6 || !matches!(pack, Pack::Varying(_)) {
                    variants.push(("without its table", without));
                }
            }
            for (variant, content) in variants {
                let what = format!("point format {point_format}, {extra} more, {pack:?}, {variant}");
                let (_dir, path) = file(&content);
                let read = WithAttributes::of(&path, &keeping_withheld()).unwrap_or_else(|e| panic!("{what}: {e}"));
                assert!(read.points == plain.points && read.records == plain.records, "{what}");
                let once = decompressed_once(&path, &keeping_withheld()).unwrap();
                assert!(once.points == plain.points && once.records == plain.records, "{what}, once for all passes");
                assert_eq!(once.cloud.unpacked(), records.len() as u64, "{what}");
                let slow = read.cloud.sources()[0].description.contains("one thread");
                assert_eq!(slow, variant.starts_with("without") || matches!(pack, Pack::One), "{what}");
            }
        }
    }
}

#[test]
fn large_chunks_are_decoded_in_parts_or_while_they_are_cut() {
    for point_format in [0, 6] {
        let length = fields::length(point_format).unwrap();
        let records = wandering(length, 300_000);
        for pack in [Pack::Fixed(150_000), Pack::Fixed(300_000), Pack::Varying(vec![70_000, 5])] {
            let (_dir, path) = file(&made(point_format, length, &records, &pack, vec![]));
            let read = WithAttributes::of(&path, &keeping_withheld()).unwrap();
            assert!(stored(&read.points) == in_records(&records, length), "{point_format}, {pack:?}");
            let once = decompressed_once(&path, &keeping_withheld()).unwrap();
            assert!(once.points == read.points && once.records == read.records, "{point_format}, {pack:?}");
        }
    }
}

#[test]
fn withheld_points_do_not_count_unless_asked_for() {
    for (point_format, byte, bit) in [(0, 15, 0x80), (6, 15, 4)] {
        let length = fields::length(point_format).unwrap();
        let mut records = vec![0; length * 10];
        records[3 * length + byte] = bit;
        for pack in [Pack::Plain, Pack::Fixed(4)] {
            let (_dir, path) = file(&made(point_format, length, &records, &pack, vec![]));
            let read = WithAttributes::of(&path, &InputOptions::default()).unwrap();
            assert_eq!((read.points.len(), read.left_out), (9, (0, 1)));
            let without = InputOptions { attributes: Wanted::None, ..InputOptions::default() };
            let once = decompressed_once(&path, &without).unwrap();
            assert_eq!(
                (once.points, once.left_out),
                (read.points, read.left_out),
                "what the filter looks at is decompressed"
            );
            assert!(read.cloud.schema().column("withheld").is_none(), "a mark that none of the points left has");
            assert_eq!(WithAttributes::of(&path, &keeping_withheld()).unwrap().points.len(), 10);
        }
    }
}

#[test]
fn extra_bytes_go_by_their_names() {
    let mut described = vec![0; 192 * 6];
    let mut describe = |i: usize, kind: u8, options: u8, name: &str, scale: f64, offset: f64| {
        let one = &mut described[192 * i..][..192];
        (one[2], one[3]) = (kind, options);
        one[4..4 + name.len()].copy_from_slice(name.as_bytes());
        one[112..120].copy_from_slice(&scale.to_le_bytes());
        one[136..144].copy_from_slice(&offset.to_le_bytes());
    };
    describe(0, 3, 0, "Amplitude", 0.5, 1.0);
    describe(1, 0, 2, "unknown", 0.0, 0.0);
    describe(2, 4, 8 | 16, "Deviation", 0.5, 10.0);
    describe(3, 1, 0, "intensity", 0.0, 0.0);
    describe(4, 11, 0, "pair", 0.0, 0.0);
    describe(5, 10, 0, "beyond", 0.0, 0.0);
    let mut records = vec![0; 20];
    records.extend(7u16.to_le_bytes());
    records.extend([9, 9]);
    records.extend((-3i16).to_le_bytes());
    records.extend([77, 5, 6]);
    let length = records.len();
    for pack in [Pack::Plain, Pack::Fixed(10)] {
        let vlr = record("LASF_Spec", 4, &described);
        let (_dir, path) = file(&made(0, length, &records, &pack, vec![vlr]));
        let read = WithAttributes::of(&path, &InputOptions::default()).unwrap();
        let value = |name: &str| read.values(name)[0];
        assert_eq!((value("amplitude"), value("deviation"), value("intensity")), (7.0, 8.5, 0.0));
        assert_eq!((value("pair_0"), value("pair_1")), (5.0, 6.0));
        assert!(read.cloud.schema().column("beyond").is_none());
    }
}

#[test]
fn reference_systems_are_read_and_must_agree() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, vlrs: Vec<Vec<u8>>| {
        let path = dir.path().join(name);
        std::fs::write(&path, made(0, 20, &[0; 20], &Pack::Plain, vlrs)).unwrap();
        path
    };
    let keys: Vec<u8> = [1u16, 1, 0, 1, 3072, 0, 1, 25832].iter().flat_map(|v| v.to_le_bytes()).collect();
    let keys = write("keys.las", vec![record("LASF_Projection", 34735, &keys)]);
    let wkt = |code: u32| format!("PROJCS[\"somewhere\",AUTHORITY[\"EPSG\",\"{code}\"]]\0").into_bytes();
    let text = write("text.las", vec![record("LASF_Projection", 2112, &wkt(25832))]);
    let other = write("other.las", vec![record("LASF_Projection", 2112, &wkt(25833))]);
    let silent = write("silent.las", vec![]);
    let open = |paths: &[&PathBuf]| {
        Cloud::open(&paths.iter().map(|path| path.to_path_buf()).collect::<Vec<_>>(), &InputOptions::default())
    };
    let cloud = open(&[&keys, &text]).unwrap();
    assert_eq!((cloud.crs().unwrap().epsg, cloud.crs_line().unwrap().as_str()), (Some(25832), "EPSG:25832"));
    let line = open(&[&silent, &text]).unwrap().crs_line().unwrap();
    assert!(line.starts_with("EPSG:25832 (somewhere); taken to be that of ") && line.contains("silent.las"), "{line}");
    assert_eq!(open(&[&silent]).unwrap().crs_line(), None);
    let given = InputOptions { crs: Some(Crs::given("EPSG:25833").unwrap()), ..InputOptions::default() };
    let line = |path: &PathBuf| Cloud::open(std::slice::from_ref(path), &given).unwrap().crs_line().unwrap();
    assert!(line(&keys).starts_with("EPSG:25833, as given; ") && line(&keys).ends_with("keys.las tells EPSG:25832"));
    assert_eq!((line(&silent), line(&other)), ("EPSG:25833".to_owned(), "EPSG:25833".to_owned()));
    let error = open(&[&keys, &silent, &other]).unwrap_err().to_string();
    assert!(
        error.contains("keys.las in EPSG:25832, ") && error.contains("other.las in EPSG:25833 (somewhere)"),
        "{error}"
    );
}

#[test]
fn a_unit_without_a_code_is_told_by_its_size() {
    let dir = tempfile::tempdir().unwrap();
    let keys: Vec<u8> = [1u16, 1, 0, 3, 3072, 0, 1, 25832, 3076, 0, 1, 32767, 3077, 34736, 1, 1]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let numbers: Vec<u8> = [0.0, 0.3048f64].iter().flat_map(|v| v.to_le_bytes()).collect();
    let measure = |vlrs: Vec<Vec<u8>>| {
        let path = dir.path().join("a.las");
        std::fs::write(&path, made(0, 20, &[0; 20], &Pack::Plain, vlrs)).unwrap();
        Cloud::open(&[path], &InputOptions::default()).unwrap().measure()
    };
    let keys = record("LASF_Projection", 34735, &keys);
    let all = vec![keys.clone(), record("LASF_Projection", 34736, &numbers)];
    assert_eq!(measure(all), Some(Measure::Length(Unit::Foot)));
    let cut = vec![keys.clone(), record("LASF_Projection", 34736, &numbers[..12])];
    assert_eq!((measure(cut), measure(vec![keys])), (None, None));
}

#[test]
fn every_field_of_the_header_is_checked() {
    let plain = made(6, 30, &wandering(30, 5), &Pack::Plain, vec![record("a", 1, &[0; 9])]);
    let packed = made(0, 20, &wandering(20, 5), &Pack::Fixed(3), vec![]);
    let laszip = 227 + 54;
    for (content, at, bytes, expected) in [
        (&plain, 24, &[2u8, 0][..], "1.0 to 1.4, found 2.0"),
        (&plain, 25, &[5], "found 1.5"),
        (&plain, 94, &[0, 1], "375 to"),
        (&plain, 94, &[0xff, 0xff], "375 to"),
        (&plain, 96, &[0, 0, 0, 0], "where points begin: expected a byte from 375"),
        (&plain, 96, &[0xff, 0xff, 0xff, 0xff], "where points begin"),
        (&plain, 100, &[0xff, 0xff, 0xff, 0xff], "VLR"),
        (&plain, 104, &[11], "point format: expected 0 to 10, found 11"),
        (&plain, 105, &[29, 0], "at least 30 bytes in point format 6, found 29"),
        (&plain, 105, &[31, 0], "5 points of 31 bytes"),
        (&plain, 247, &[6], "6 points of 30 bytes from byte 438 on, found 5 points"),
        (&plain, 254, &[0xff], "points, then the file's end"),
        (&plain, 131, &[0; 8], "scale: expected a usable number, found 0"),
        (&plain, 155, &[0xff; 8], "offset: expected a usable number, found NaN"),
        (&plain, 243, &[1, 0, 0, 0], "where EVLRs begin"),
        (&plain, 375 + 20, &[0xff, 0xff], "VLR 0 of 1, byte 375: expected 65535 bytes"),
        (&plain, 104, &[0x86], "LASzip's record, in the VLRs: expected one, found none"),
        (&packed, laszip, &[9], "LASzip's record, content"),
        (&packed, laszip, &[0], "kind of compression"),
        (&packed, laszip, &[3], "kind of compression"),
        (&packed, laszip + 34, &[7], "items of point format 0"),
        (&packed, laszip + 36, &[21], "items of point format 0"),
        (&packed, laszip + 38, &[3], "version of an item"),
        (&packed, laszip + 32, &[0], "items of point format 0"),
        (&packed, 105, &[0xff, 0xff], "at most 256 extra bytes"),
        (&packed, 107, &[0xff, 0xff, 0xff, 0xff], "compressed points"),
    ] {
        let mut broken = content.clone();
        broken[at..at + bytes.len()].copy_from_slice(bytes);
        let (_dir, path) = file(&broken);
        let error = collect(&path, &InputOptions::default()).unwrap_err().to_string();
        assert!(error.contains(expected), "byte {at}: {error}");
    }
}

#[test]
fn a_file_that_is_cut_short_is_an_error_at_every_length() {
    for (point_format, pack) in [
        (0, Pack::Plain),
        (7, Pack::Plain),
        (0, Pack::One),
        (3, Pack::Fixed(4)),
        (3, Pack::Varying(vec![4, 3])),
        (7, Pack::Fixed(4)),
        (8, Pack::Varying(vec![4, 3])),
    ] {
        let length = fields::length(point_format).unwrap();
        let content = made(point_format, length, &wandering(length, 12), &pack, vec![]);
        let (_dir, path) = file(&content);
        let whole = collect(&path, &keeping_withheld()).unwrap();
        assert_eq!(whole.0.len(), 12);
        for end in 1..content.len() {
            std::fs::write(&path, &content[..end]).unwrap();
            // Without a part of the table of chunks, the points may all be there.
            if let Ok(read) = collect(&path, &keeping_withheld()) {
                assert!(
                    read == whole && !matches!(pack, Pack::Plain) || end < 4,
                    "{point_format}, {pack:?}: {end} bytes"
                );
            }
        }
    }
}

proptest! {
    #[test]
    fn coordinates_give_back_the_stored_integers(
        points: Vec<[i32; 3]>,
        scale in prop::sample::select(vec![0.00025, 0.001, 0.01, 1e-7, 0.1, 0.3048]),
        offset in prop::sample::select(vec![0.0, 500_000.0, 5_400_000.0, -1234.5678, 0.1]),
    ) {
        let records: Vec<u8> = points.iter().flat_map(|p| [bytemuck::cast_slice::<i32, u8>(p), &[0; 8]].concat()).collect();
        let mut content = made(0, 20, &records, &Pack::Plain, vec![]);
        for axis in 0..3 {
            content[131 + 8 * axis..139 + 8 * axis].copy_from_slice(&f64::to_le_bytes(scale));
            content[155 + 8 * axis..163 + 8 * axis].copy_from_slice(&f64::to_le_bytes(offset));
        }
        let (_dir, path) = file(&content);
        let read = collect(&path, &InputOptions::default()).unwrap().0;
        let back: Vec<[i32; 3]> = read.iter().map(|p| p.map(|c| ((c - offset) / scale).round() as i32)).collect();
        prop_assert_eq!(back, points);
    }

    #[test]
    fn no_content_makes_it_panic(
        (point_format, extra) in (0u8..=10, 0usize..3),
        pack in 0usize..4,
        broken in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        cut: prop::sample::Index,
        whole: bool,
    ) {
        let length = fields::length(point_format).unwrap() + extra;
        let packs = [Pack::Plain, Pack::Fixed(20), Pack::Varying(vec![7, 20]), Pack::Fixed(100)];
        let mut content = made(point_format, length, &wandering(length, 60), &packs[pack], vec![record("LASF_Spec", 4, &[1; 192])]);
        for (at, byte) in broken {
            let at = at.index(content.len());
            content[at] = byte;
        }
        if !whole {
            content.truncate(cut.index(content.len()));
        }
        let (_dir, path) = file(&content);
        let each = WithAttributes::of(&path, &InputOptions::default());
        let once = decompressed_once(&path, &InputOptions::default());
        // Layers that no pass asks for may be broken.
        if let (Ok(each), Ok(once)) = (each, once) {
            prop_assert!(each.points == once.points && each.records == once.records);
        }
    }

    #[test]
    fn no_chunk_makes_it_panic(
        point_format in prop::sample::select(vec![0u8, 3, 5, 6, 8, 10]),
        noise in prop::collection::vec(any::<u8>(), 0..3000),
        from: prop::sample::Index,
        count in 1u64..100_000,
    ) {
        let length = fields::length(point_format).unwrap();
        let mut content = made(point_format, length, &wandering(length, 60), &Pack::Fixed(50_000), vec![]);
        let start = u32::from_le_bytes(content[96..100].try_into().unwrap()) as usize;
        let from = start + 8 + length + from.index(200);
        content.resize(content.len().max(from + noise.len()), 0);
        content[from..from + noise.len()].copy_from_slice(&noise);
        content[start..start + 8].fill(0xff);
        let at = if point_format < 6 { 107 } else { 247 };
        content[at..at + 4].copy_from_slice(&(count as u32).to_le_bytes());
        let (_dir, path) = file(&content);
        let each = WithAttributes::of(&path, &InputOptions::default());
        let once = decompressed_once(&path, &InputOptions::default());
        // Layers that no pass asks for may be broken.
        if let (Ok(each), Ok(once)) = (each, once) {
            prop_assert!(each.points == once.points && each.records == once.records);
        }
    }
}
