use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;
use proptest::prelude::*;

use super::super::testing::{collect, points_of, read, refused};
use super::*;
use crate::input::{Cloud, InputOptions};

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn zstandard(bytes: &[u8]) -> Vec<u8> {
    zstd::bulk::compress(bytes, 3).unwrap()
}

const SKIPPED: &[u8] = b"\x5a\x2a\x4d\x18\x05\0\0\0abcde";

/// Enough text for several pieces.
fn text() -> String {
    (0..40_000).map(|i| format!("{i} {} 0.5\n", i % 77)).collect()
}

#[test]
fn what_is_unpacked_reads_like_what_was_packed() {
    let text = text();
    let expected = read("a.xyz", text.as_bytes()).unwrap();
    let (first, second) = text.as_bytes().split_at(300_001);
    for (packed, from) in [
        (gzip(text.as_bytes()), "gzip"),
        ([gzip(first), gzip(b""), gzip(second)].concat(), "gzip"),
        ([gzip(first), gzip(second), vec![0; 512]].concat(), "gzip"),
        (zstandard(text.as_bytes()), "Zstandard"),
        ([SKIPPED, &zstandard(first), SKIPPED, &zstandard(second), SKIPPED].concat(), "Zstandard"),
    ] {
        for name in ["a.xyz.gz", "a", "a.bin"] {
            let found = read(name, &packed).unwrap();
            assert!(found.points == expected.points, "{from}");
            assert_eq!(found.description, format!("{}; from {from}", expected.description));
        }
    }
}

#[test]
fn several_files_lie_side_by_side() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let pcd =
        b"FIELDS x y z\nWIDTH 1\nDATA binary_compressed\n\x0e\0\0\0\x0c\0\0\0\x0b\0\0\x80\x3f\0\0\0\x40\0\0\x40\x40!";
    std::fs::write(path("a.gz"), gzip(b"1 2 3\n")).unwrap();
    std::fs::write(path("b.gz"), gzip(pcd)).unwrap();
    std::fs::write(path("c.zst"), zstandard(text().as_bytes())).unwrap();
    let files = ["a.gz", "b.gz", "c.zst"].map(path);
    let workspace = Workspace::new(dir.path()).unwrap();
    let mut told = Unpacked::default();
    let watch = &mut |unpacked: Unpacked| {
        assert!(Some(unpacked.read) <= unpacked.total, "{unpacked:?}");
        told = unpacked;
        Ok(())
    };
    // The length is one more than the stream's: the byte behind it is no token.
    let opening = Opening { workspace: &workspace, memory: 1 << 20, decompress: None, watch };
    let error = Cloud::open_in(&files, &InputOptions::default(), opening).unwrap_err().to_string();
    assert!(error.contains("b.gz: byte 65: expected a whole token of LZF"), "{error}");
    std::fs::write(path("b.gz"), gzip(&[&pcd[..44], b"\x0d", &pcd[45..pcd.len() - 1]].concat())).unwrap();
    let opening = Opening { workspace: &workspace, memory: 1 << 20, decompress: None, watch };
    let cloud = Cloud::open_in(&files, &InputOptions::default(), opening).unwrap();
    let (points, _) = super::super::testing::collect_all(&cloud).unwrap();
    assert_eq!(points[..3], [[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [0.0, 0.0, 0.5]]);
    assert_eq!(points.len(), 40_002);
    let unpacked = 6 + (pcd.len() as u64 - 1) + 12 + text().len() as u64;
    assert_eq!((cloud.unpacked(), workspace.peak_on_disk()), (unpacked, unpacked));
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 3, "what is unpacked has no name");
    let packed = files.iter().map(|file| std::fs::metadata(file).unwrap().len()).sum();
    assert_eq!(told, Unpacked { bytes: unpacked, read: packed, total: Some(packed) });
}

#[test]
fn whoever_watches_may_stop_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.gz");
    std::fs::write(&path, gzip(text().as_bytes())).unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let opening =
        Opening { workspace: &workspace, memory: 1 << 20, decompress: None, watch: &mut |_| Err(Error::Interrupted) };
    assert!(matches!(Cloud::open_in(&[path], &InputOptions::default(), opening), Err(Error::Interrupted)));
}

#[test]
fn a_side_car_goes_by_either_name() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("huge.bin.gz");
    std::fs::write(&path, gzip(bytemuck::cast_slice(&[1i16, 2, 3]))).unwrap();
    for sidecar in ["huge.bin.json", "huge.bin.gz.json"] {
        let sidecar = dir.path().join(sidecar);
        std::fs::write(&sidecar, r#"{"fields":[["x","i2"],["y","i2"],["z","i2"]]}"#).unwrap();
        assert_eq!(points_of(&path, &InputOptions::default()), [[1.0, 2.0, 3.0]]);
        std::fs::remove_file(sidecar).unwrap();
    }
    let layout = Some("xyz:i16".parse().unwrap());
    let skipping = InputOptions { layout, skip_bytes: Some(0), ..InputOptions::default() };
    assert_eq!(points_of(&path, &skipping), [[1.0, 2.0, 3.0]], "bytes are skipped of what is unpacked");
    // Without such a name, whoever skips bytes means the file as it is.
    let bare = dir.path().join("bare.bin");
    std::fs::write(&bare, [b"\x1f\x8b\x08".as_slice(), &[0; 9]].concat()).unwrap();
    assert_eq!(points_of(&bare, &skipping).len(), 2);
}

#[test]
fn no_prefix_is_a_file() {
    let content = b"1 2 3\n4 5 6\n";
    for whole in [gzip(content), zstandard(content)] {
        for end in 4..whole.len() {
            assert!(read("a.xyz.gz", &whole[..end]).is_err(), "prefix of {end} bytes");
        }
    }
}

#[test]
fn what_is_wrong_is_located() {
    let whole = gzip(text().as_bytes());
    let cut = refused("a.gz", &whole[..whole.len() / 2]);
    let at = format!("a.gz: compressed byte {}: expected gzip data, found the end of the file", whole.len() / 2);
    assert!(cut.contains(&at), "{cut}");
    let mut wrong = whole.clone();
    *wrong.last_mut().unwrap() ^= 1;
    let error = refused("a.gz", &wrong);
    assert!(error.contains(&format!("compressed byte {}: expected gzip data", whole.len())), "{error}");
    let error = refused("a.gz", &[whole.as_slice(), b"junk"].concat());
    assert!(error.contains("expected gzip data"), "{error}");
    let frames = zstandard(text().as_bytes());
    let error = refused("a.zst", &[frames.as_slice(), b"junk"].concat());
    assert!(error.contains("expected Zstandard data"), "{error}");
    assert!(refused("a.gz", &gzip(b"")).contains("a.gz: length: expected points, found an empty file"));
    assert!(refused("a.gz", &gzip(&gzip(b"1 2 3\n"))).contains("compressed twice"));
    assert!(
        refused("a.tar.gz", &gzip(&[&[0; 257], b"ustar".as_slice(), &[0; 250]].concat())).contains("a tar archive")
    );
    let error = refused("a.ply.gz", &gzip(b"ply\nformat middle 1.0\n"));
    assert!(error.contains("a.ply.gz: header line 2: expected a known format"), "{error}");
}

#[test]
fn windows_are_bounded_by_memory() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.zst");
    let mut encoder = zstd::stream::write::Encoder::new(Vec::new(), 1).unwrap();
    encoder.window_log(26).unwrap();
    encoder.write_all(text().as_bytes()).unwrap();
    std::fs::write(&path, encoder.finish().unwrap()).unwrap();
    let workspace = Workspace::new(dir.path()).unwrap();
    let open = |memory: u64| {
        let opening = Opening { workspace: &workspace, memory, decompress: None, watch: &mut |_| Ok(()) };
        Cloud::open_in(std::slice::from_ref(&path), &InputOptions::default(), opening)
    };
    let error = open(32 << 20).unwrap_err().to_string();
    assert!(error.contains("expected a window of at most 16.0 MiB (half of `max_memory`)"), "{error}");
    assert!(open(128 << 20).is_ok());
}

proptest! {
    #[test]
    fn no_content_makes_it_panic(
        zstd: bool,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        tail in prop::collection::vec(any::<u8>(), 0..40),
    ) {
        let mut content = if zstd { zstandard(b"1 2 3\n4 5 6\n") } else { gzip(b"1 2 3\n4 5 6\n") };
        for (at, byte) in changes {
            let at = at.index(content.len());
            content[at] = byte;
        }
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.gz");
        std::fs::write(&path, [&content[..], &tail].concat()).unwrap();
        drop(collect(&path, &InputOptions::default()));
    }
}
