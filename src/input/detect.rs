//! Which format a file is: its first bytes decide, its name does not.

use std::path::Path;
use std::sync::Arc;

use super::mapped::Mapped;
use super::raw::{self, Description};
use super::{InputOptions, PointFormat, Source, e57, las, ply, text};
use crate::error::{Error, Result};

/// Bytes looked at: the longest signature, and enough to tell text from numbers.
const HEAD: u64 = 4096;

/// Formats that are recognised and not read: signature, where it stands, name, advice.
const FOREIGN: [(&[u8], usize, &str, &str); 13] = [
    (b"# .PCD", 0, "a PCD file", "convert it to PLY, for example with pcl_pcd2ply"),
    (b"VERSION .7", 0, "a PCD file", "convert it to PLY, for example with pcl_pcd2ply"),
    (b"CCB2", 0, "a CloudCompare project", "open it in CloudCompare and save the cloud as PLY"),
    (
        &970_401i32.to_le_bytes(),
        8,
        "a TerraSolid file",
        "convert it to PLY, for example with PDAL (readers.terrasolid)",
    ),
    (b"\x93NUMPY", 0, "a NumPy array", "write its numbers with array.tofile() and pass --layout"),
    (b"\x1f\x8b\x08", 0, "a gzip-compressed file", "unpack it first: gunzip FILE"),
    (b"\x28\xb5\x2f\xfd", 0, "a Zstandard-compressed file", "unpack it first: unzstd FILE"),
    (b"PK\x03\x04", 0, "a ZIP archive", "unpack it first"),
    (b"BZh", 0, "a bzip2-compressed file", "unpack it first: bunzip2 FILE"),
    (b"\xfd7zXZ\0", 0, "an xz-compressed file", "unpack it first: unxz FILE"),
    (b"\x89HDF\r\n\x1a\n", 0, "an HDF5 file", "write its points as PLY or as raw numbers"),
    (b"glTF", 0, "a binary glTF file", "save its points as PLY"),
    (b"ncols", 0, "an ESRI ASCII grid", "convert it to x y z text, for example with gdal_translate -of XYZ"),
];

/// Finds out what the file is and opens it.
///
/// # Errors
/// [`Error::ForeignFormat`] if it is known and not read; otherwise as its format's `open`.
pub fn open(path: &Path, options: &InputOptions) -> Result<(Source, Arc<dyn PointFormat>)> {
    let file = Mapped::unmapped(path)?;
    let head = file.read(0..file.len().min(HEAD))?;
    if head.is_empty() {
        return Err(Error::malformed(path, "length", "points", "an empty file"));
    }
    if ply::is_ply(&head) {
        return ply::open(path);
    }
    if las::is_las(&head) && options.skip_bytes.is_none() {
        return las::open(path);
    }
    if e57::is_e57(&head) && options.skip_bytes.is_none() {
        return e57::open(path);
    }
    let description = Description::of(path, options)?;
    // Whoever skips a header by hand knows what it is.
    if options.skip_bytes.is_none()
        && let Some((format, advice)) = foreign(&head, file.len())
    {
        return Err(Error::ForeignFormat { path: path.to_path_buf(), format, advice });
    }
    if description == Description::Unknown && options.skip_bytes.is_none() && is_text(&head) {
        return text::open(path);
    }
    raw::open(&file, description, options)
}

fn foreign(head: &[u8], len: u64) -> Option<(&'static str, &'static str)> {
    let known = FOREIGN.iter().find(|(signature, at, ..)| head.get(*at..).is_some_and(|h| h.starts_with(signature)));
    if let Some((_, _, format, advice)) = known {
        return Some((format, advice));
    }
    is_unity_viewer(head, len).then_some(("a UnityPointCloudViewer file", "export the cloud as PLY instead"))
}

/// UnityPointCloudViewer's first version has no signature: a version byte, the number of points as `i32`, a byte that
/// says whether colours follow, then three or six `f32` per point. A count that agrees with the length is proof enough.
fn is_unity_viewer(head: &[u8], len: u64) -> bool {
    let &[1, a, b, c, d, colours, ..] = head else { return false };
    let per_point = match colours {
        0 => 12,
        1 => 24,
        _ => return false,
    };
    let count = i32::from_le_bytes([a, b, c, d]);
    count > 0 && len == 6 + count as u64 * per_point
}

/// Whether the bytes are text: no control characters but those that lay out lines. Numbers in binary have some within
/// the first few records. Bytes from 128 on are letters of some encoding, in comments.
fn is_text(head: &[u8]) -> bool {
    head.iter().all(|&byte| byte >= b' ' && byte != 0x7f || matches!(byte, b'\t' | b'\n' | b'\r' | 0x0c))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::testing::{collect, points_of};
    use super::*;

    fn file(name: &str, content: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(name);
        std::fs::write(&path, content).unwrap();
        (dir, path)
    }

    #[test]
    fn known_formats_are_refused_by_name() {
        for (signature, at, name, advice) in FOREIGN {
            let mut content = vec![0; 120];
            content[at..at + signature.len()].copy_from_slice(signature);
            let (_dir, path) = file("cloud.bin", &content);
            let error = collect(&path, &InputOptions::default()).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains(advice), "{error}");
        }
        let mut unity = vec![1, 10, 0, 0, 0, 0];
        unity.resize(6 + 120, 1);
        let (_dir, path) = file("cloud.bin", &unity);
        assert!(collect(&path, &InputOptions::default()).unwrap_err().to_string().contains("UnityPointCloudViewer"));
    }

    #[test]
    fn content_goes_before_the_name() {
        let (_dir, path) = file("cloud.bin", b"1 2 3\n4 5 6\n");
        assert_eq!(points_of(&path, &InputOptions::default()), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        let (_dir, path) = file("cloud.xyz", bytemuck::cast_slice(&[1f32, 2.0, 3.0]));
        assert_eq!(points_of(&path, &InputOptions::default()), [[1.0, 2.0, 3.0]]);
        let (_dir, path) = file("empty.ply", b"");
        assert!(collect(&path, &InputOptions::default()).unwrap_err().to_string().contains("an empty file"));
    }

    #[test]
    fn a_layout_makes_a_file_raw_but_not_a_known_format() {
        let options = InputOptions { layout: Some("xyz".parse().unwrap()), ..InputOptions::default() };
        let (_dir, path) = file("a.bin", b"CCB200000000");
        assert!(matches!(collect(&path, &options), Err(Error::ForeignFormat { .. })));
        let skipping = InputOptions { skip_bytes: Some(0), ..options };
        assert_eq!(points_of(&path, &skipping).len(), 1);
    }

    proptest! {
        #[test]
        fn no_content_makes_it_panic(content in prop::collection::vec(any::<u8>(), 0..400), ply: bool) {
            let content = if ply { [&b"ply\nformat ascii 1.0\n"[..], &content].concat() } else { content };
            let (_dir, path) = file("cloud.bin", &content);
            drop(collect(&path, &InputOptions::default()));
        }
    }
}
