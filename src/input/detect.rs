//! Which format a file is: its first bytes decide, its name only where they cannot.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::fetch;
use crate::error::{Error, Result};
use crate::format::options::InputOptions;
use crate::format::point_format::{PointFormat, Source};
use crate::format::raw;
use crate::format::raw::Description;
use crate::format::unpack::{Packing, STANDARD_INPUT, Unpacking};
use crate::format::{e57, las, npy, obj, pcd, ply, stl, text};
use crate::storage::mapped::{Content, Mapped};
use crate::storage::remote::is_remote;

/// Bytes looked at: the longest signature, and enough to tell text from numbers.
const HEAD: u64 = 4096;

const NO_CLOUD: &str = "name a cloud of points";
const HEIGHTS: &str = "if it holds heights, convert it to x y z text, for example with gdal_translate -of XYZ";
/// Formats that are recognised and not read: signature, where it stands, name, advice.
const FOREIGN: [(&[u8], usize, &str, &str); 15] = [
    (b"CCB2", 0, "a CloudCompare project", "open it in CloudCompare and save the cloud as PLY"),
    (
        &970_401i32.to_le_bytes(),
        8,
        "a TerraSolid file",
        "convert it to PLY, for example with PDAL (readers.terrasolid)",
    ),
    (b"PK\x03\x04", 0, "a ZIP archive", "unpack it first"),
    (b"ustar", 257, "a tar archive", "unpack it first"),
    (b"BZh", 0, "a bzip2-compressed file", "unpack it first: bunzip2 FILE"),
    (b"\xfd7zXZ\0", 0, "an xz-compressed file", "unpack it first: unxz FILE"),
    (b"\x89HDF\r\n\x1a\n", 0, "an HDF5 file", "write its points as PLY or as raw numbers"),
    (b"glTF", 0, "a binary glTF file", "save its points as PLY"),
    (b"\x89PNG\r\n\x1a\n", 0, "a PNG image", NO_CLOUD),
    (b"JFIF\0", 6, "a JPEG image", NO_CLOUD),
    (b"Exif\0", 6, "a JPEG image", NO_CLOUD),
    (b"II*\0", 0, "a TIFF image", HEIGHTS),
    (b"MM\0*", 0, "a TIFF image", HEIGHTS),
    (b"%PDF-", 0, "a PDF document", NO_CLOUD),
    (b"ncols", 0, "an ESRI ASCII grid", "convert it to x y z text, for example with gdal_translate -of XYZ"),
];

/// Finds out what the file is and opens it; what is compressed, and standard input, is unpacked first.
///
/// # Errors
/// [`Error::ForeignFormat`] if it is known and not read; otherwise as its format's `open`, and those of unpacking.
pub fn open(path: &Path, options: &InputOptions, unpacking: &mut Unpacking) -> Result<(Source, Arc<dyn PointFormat>)> {
    let (own, mut names) = if path == Path::new(STANDARD_INPUT) {
        (unpacking.standard_input()?, Vec::new())
    } else if is_remote(path) {
        (fetch::fetched(path, options, unpacking)?, vec![path.to_path_buf()])
    } else {
        (Content::named(path), vec![path.to_path_buf()])
    };
    let file = own.unmapped()?;
    let named = Packing::named(path);
    // Whoever skips a header by hand knows what it is, unless the name says it, too.
    let by_hand = options.skip_bytes.is_some() && !names.is_empty() && named.is_none();
    let Some(packing) = Packing::of(&head(&file)?).filter(|_| !by_hand) else {
        return open_unpacked(&own, &names, options, unpacking);
    };
    names.extend(named.map(|(_, bare)| bare));
    let content = packing.unpack(&own, unpacking)?;
    let (source, format) = open_unpacked(&content, &names, options, unpacking)?;
    let description = format!("{}; from {}", source.description, packing.name());
    Ok((Source { description, bytes: file.len(), ..source }, format))
}

/// Opens a file that lies there as it is; `names` are those it may have a side-car by, the last one with its extension.
fn open_unpacked(
    content: &Content,
    names: &[PathBuf],
    options: &InputOptions,
    unpacking: &mut Unpacking,
) -> Result<(Source, Arc<dyn PointFormat>)> {
    let file = content.unmapped()?;
    let head = head(&file)?;
    if head.is_empty() {
        return Err(Error::malformed(content.name(), "length", "points", "an empty file"));
    }
    if ply::is_ply(&head) {
        return ply::open(content);
    }
    // Whoever skips a header by hand knows what it is.
    if options.skip_bytes.is_none() {
        if las::is_las(&head) {
            return las::open(content, options, unpacking);
        }
        if e57::is_e57(&head) {
            return e57::open(content);
        }
        if pcd::is_pcd(&head) {
            return pcd::open(content, unpacking);
        }
        if head.starts_with(npy::SIGNATURE) {
            return npy::open(content);
        }
    }
    let description = Description::of(names, options)?;
    if options.skip_bytes.is_none()
        && let Some((format, advice)) = foreign(&head, file.len())
    {
        return Err(Error::ForeignFormat { path: content.name().to_path_buf(), format, advice });
    }
    if description == Description::Unknown && options.skip_bytes.is_none() {
        let extension =
            names.last().and_then(|name| name.extension()).map(|e| e.to_string_lossy().to_ascii_lowercase());
        let is = |name: &str| extension.as_deref() == Some(name);
        if is_text(&head) {
            return match () {
                () if is("obj") || obj::is_obj(&head) => obj::open(content),
                () if is("stl") || stl::is_text(&head) => stl::open_text(content),
                () => text::open(content),
            };
        }
        if is("stl") || stl::is_binary(&head, file.len()) {
            return stl::open_binary(content);
        }
    }
    raw::open(&file, description, options)
}

fn head(file: &Mapped) -> Result<Vec<u8>> {
    file.read(0..file.len().min(HEAD))
}

pub(super) fn foreign(head: &[u8], len: u64) -> Option<(&'static str, &'static str)> {
    if is_npz(head) {
        return Some(("an NPZ archive", "save the array alone, with numpy.save"));
    }
    if Packing::of(head).is_some() {
        return Some(("a file that is compressed twice", "unpack it once"));
    }
    let known = FOREIGN.iter().find(|(signature, at, ..)| head.get(*at..).is_some_and(|h| h.starts_with(signature)));
    if let Some((_, _, format, advice)) = known {
        return Some((format, advice));
    }
    if is_utf16(head) {
        return Some(("text in UTF-16", "save it as UTF-8"));
    }
    is_unity_viewer(head, len).then_some(("a UnityPointCloudViewer file", "export the cloud as PLY instead"))
}

/// Whether it is a ZIP archive of arrays: the name of its first file, 30 bytes from the beginning, says so.
fn is_npz(head: &[u8]) -> bool {
    let length = |head: &[u8]| Some(usize::from(u16::from_le_bytes([*head.get(26)?, *head.get(27)?])));
    let name = length(head).and_then(|length| head.get(30..30 + length));
    head.starts_with(b"PK\x03\x04") && name.is_some_and(|name| name.ends_with(b".npy"))
}

/// Whether it begins with the mark of UTF-16, and goes on with letters that ASCII has: numbers and names of columns.
fn is_utf16(head: &[u8]) -> bool {
    const LOOKED_AT: usize = 16;
    let high = match head {
        [0xff, 0xfe, ..] => 1,
        [0xfe, 0xff, ..] => 0,
        _ => return false,
    };
    let mut letters = head[2..].chunks_exact(2).take(LOOKED_AT).peekable();
    letters.peek().is_some() && letters.all(|letter| letter[high] == 0 && is_text(&letter[1 - high..][..1]))
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
pub(super) fn is_text(head: &[u8]) -> bool {
    head.iter().all(|&byte| byte >= b' ' && byte != 0x7f || matches!(byte, b'\t' | b'\n' | b'\r' | 0x0c))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::format::testing::{collect, points_of};

    fn file(name: &str, content: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(name);
        std::fs::write(&path, content).unwrap();
        (dir, path)
    }

    #[test]
    fn known_formats_are_refused_by_name() {
        for (signature, at, name, advice) in FOREIGN {
            let mut content = vec![0; 600];
            content[at..at + signature.len()].copy_from_slice(signature);
            let (_dir, path) = file("cloud.bin", &content);
            let error = collect(&path, &InputOptions::default()).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains(advice), "{error}");
        }
        let npz = [b"PK\x03\x04".as_slice(), &[0; 22], &[7, 0, 0, 0], b"arr.npy", &[0; 90]].concat();
        let (_dir, path) = file("cloud.npz", &npz);
        assert!(collect(&path, &InputOptions::default()).unwrap_err().to_string().contains("an NPZ archive"));
        for text in ["x,y,z\n1,2,3\n", "1 2 3\n"] {
            for (mark, order) in
                [([0xff, 0xfe], u16::to_le_bytes as fn(u16) -> [u8; 2]), ([0xfe, 0xff], u16::to_be_bytes)]
            {
                let units = text.encode_utf16().flat_map(order);
                let (_dir, path) = file("cloud.csv", &mark.into_iter().chain(units).collect::<Vec<u8>>());
                let error = collect(&path, &InputOptions::default()).unwrap_err().to_string();
                assert!(error.contains("text in UTF-16") && error.contains("UTF-8"), "{error}");
            }
        }
        let (_dir, path) = file("cloud.bin", &[0xff, 0xfe, 0x80, 0x3f, 0, 0, 0, 0x40, 0, 0, 0x40, 0x40]);
        assert_eq!(points_of(&path, &InputOptions::default()).len(), 1, "numbers may begin like the mark");
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
