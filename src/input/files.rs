//! From the arguments to the files: patterns, folders, and each file once.
//!
//! Of a folder, the files that are point clouds by their name count, but for
//! * meshes of this program, which lie beside the clouds they were made from: by their name (`*.mesh.ply`) or by what their header says;
//! * what holds no points: empty files, archives and the like, text without a line of three numbers.
//!
//! What is left out is told, with the reason. Damaged clouds are no strays: they are taken, and found out when they are opened.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{Read, Seek};
use std::path::{Component, Path, PathBuf};

use glob::{MatchOptions, Pattern};

use super::detect;
use super::objects::{self, Stands};
use crate::error::{Error, Result};
use crate::format::options::Depth;
use crate::format::unpack::{Packing, STANDARD_INPUT};
use crate::format::write::tiles::INDEX;
use crate::format::{e57, las, npy, pcd, ply};
use crate::storage::remote::{Meta, is_remote, note};
use crate::system::{Entry, EntryKind, folder};

/// Extensions that are taken for point files when a whole folder is given; also with that of a compressed file behind them. Files that are
/// meshes as a rule (`.obj`, `.stl`) must be named.
const POINT_FILES: [&str; 16] =
    ["ply", "las", "laz", "e57", "xyz", "txt", "csv", "pts", "asc", "bin", "xyz32", "raw", "f32", "dat", "pcd", "npy"];

/// Bytes of a file that are looked at to tell whether it is a stray.
const HEAD: u64 = 64 << 10;

/// Files that are named of those that are left out.
const NAMED: usize = 5;

/// What arguments stand for.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Found {
    /// The files, in the arguments' order, each once.
    pub files: Vec<PathBuf>,
    /// A line for each folder or pattern of which files were left out.
    pub left_out: Vec<String>,
}

/// The files the arguments stand for (files, patterns, folders, `-` for standard input), in the arguments' order, each once.
///
/// # Errors
/// The same as [`find`].
pub fn expand(inputs: &[PathBuf]) -> Result<Vec<PathBuf>> {
    find(inputs, Depth::Flat).map(|found| found.files)
}

/// The files the arguments stand for, and what was left out.
///
/// # Errors
/// [`Error::Usage`] if there is no argument; [`Error::NoInput`] if a pattern or folder holds no point file; [`Error::Io`] if an argument
/// does not exist.
pub fn find(inputs: &[PathBuf], depth: Depth) -> Result<Found> {
    if inputs.is_empty() {
        return Err(Error::Usage("no input file given".to_string()));
    }
    let mut seen = BTreeSet::new();
    let mut found = Found::default();
    for input in inputs {
        // A shell's `scans/*` names the side-cars, too.
        if has_extension(input, &["json"]) && inputs.contains(&input.with_extension("")) {
            continue;
        }
        let mut strays = Strays::default();
        for file in stands_for(input, depth, &mut strays)? {
            // Links and `./` must not let a file count twice. A file by the name of standard input is `./-`.
            let standard_input = file == Path::new(STANDARD_INPUT);
            let one = if standard_input || is_remote(&file) { Ok(file.clone()) } else { file.canonicalize() };
            if seen.insert(one.map_err(Error::io(&file, "open"))?) {
                found.files.push(file);
            }
        }
        found.left_out.extend(strays.told(input));
    }
    Ok(found)
}

fn stands_for(input: &Path, depth: Depth, strays: &mut Strays) -> Result<Vec<PathBuf>> {
    if is_remote(input) {
        return objects_of(input, depth, strays);
    }
    if input == Path::new(STANDARD_INPUT) {
        return Ok(vec![input.to_path_buf()]);
    }
    if input.is_dir() {
        return point_files_in(input, depth, strays);
    }
    let pattern = input.to_string_lossy();
    if input.exists() || !pattern.contains(['*', '?', '[']) {
        return Ok(vec![input.to_path_buf()]);
    }
    let mut files = Vec::new();
    for path in matching(input)? {
        // `scans/*` also matches the side-cars.
        if !path.is_file() || has_extension(&path, &["json"]) {
            continue;
        }
        match is_own_mesh(&path) {
            true => strays.meshes.push(path),
            false => files.push(path),
        }
    }
    match files.is_empty() {
        true => none(input, "the pattern matches no file"),
        false => Ok(files),
    }
}

/// The objects that an address in an object store stands for, as files and folders are told.
fn objects_of(input: &Path, depth: Depth, strays: &mut Strays) -> Result<Vec<PathBuf>> {
    let (found, is_folder) = match objects::stands_for(input, depth)? {
        Stands::One(meta) => {
            note(input, meta);
            return Ok(vec![input.to_path_buf()]);
        }
        Stands::Matching(found) => (found, false),
        Stands::In(found) => (found, true),
    };
    let is_own_mesh = |path: &Path, meta: &Meta| -> Result<bool> {
        let bare = bare(path);
        let is_named = bare.to_str().is_some_and(|name| name.ends_with(".mesh.ply"));
        Ok(is_named || has_extension(path, &["ply"]) && tells_own_mesh(&objects::head(path, meta)?))
    };
    let mut files = Vec::new();
    for (path, meta) in found {
        if is_folder && !has_extension(&bare(&path), &POINT_FILES) {
            strays.others.push((path, None));
        } else if is_folder && meta.bytes == 0 {
            strays.others.push((path, Some("empty")));
        } else if has_extension(&path, &["json"]) {
            continue;
        } else if is_own_mesh(&path, &meta)? {
            strays.meshes.push(path);
        } else {
            note(&path, meta);
            files.push(path);
        }
    }
    match (files.is_empty(), is_folder) {
        (false, _) => Ok(files),
        (true, false) => none(input, "the pattern matches no object"),
        (true, true) => none(input, "there is no such object, and no point cloud in a folder of that name"),
    }
}

/// What a pattern stands for, sorted: each part of the path is matched as a shell does it, and `**` is any number of folders, links left out.
fn matching(pattern: &Path) -> Result<Vec<PathBuf>> {
    // Hidden files only where the pattern begins with a point, too.
    const LIKE_A_SHELL: MatchOptions =
        MatchOptions { case_sensitive: true, require_literal_separator: true, require_literal_leading_dot: true };
    let mut places = BTreeSet::from([PathBuf::new()]);
    for part in pattern.components() {
        let word = part.as_os_str().to_string_lossy();
        let mut next = BTreeSet::new();
        if !matches!(part, Component::Normal(_)) || !word.contains(['*', '?', '[']) {
            next.extend(places.iter().map(|place| place.join(part)).filter(|path| path.symlink_metadata().is_ok()));
        } else if word == "**" {
            let mut waiting: Vec<PathBuf> = places.into_iter().collect();
            while let Some(folder) = waiting.pop() {
                let inner = listed(&folder)?.into_iter().filter(|entry| entry.kind == EntryKind::Folder);
                let shown = inner.filter(|entry| !entry.name.as_encoded_bytes().starts_with(b"."));
                waiting.extend(shown.map(|entry| folder.join(entry.name)));
                next.insert(folder);
            }
        } else {
            let invalid = |e| Error::Usage(format!("{}: not a valid pattern: {e}", pattern.display()));
            let word = Pattern::new(&word).map_err(invalid)?;
            for folder in places {
                let entries = listed(&folder)?.into_iter();
                let named = entries.filter(|entry| word.matches_with(&entry.name.to_string_lossy(), LIKE_A_SHELL));
                next.extend(named.map(|entry| folder.join(entry.name)));
            }
        }
        places = next;
    }
    Ok(places.into_iter().collect())
}

/// What is in a folder; nothing in what is none.
fn listed(folder: &Path) -> Result<Vec<Entry>> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    match folder.is_dir() {
        true => folder::entries(folder).map_err(Error::io(folder, "list")),
        false => Ok(Vec::new()),
    }
}

fn point_files_in(folder: &Path, depth: Depth, strays: &mut Strays) -> Result<Vec<PathBuf>> {
    let (mut files, mut pointless, mut deeper) = (Vec::new(), Vec::new(), false);
    let mut waiting = vec![folder.to_path_buf()];
    while let Some(folder) = waiting.pop() {
        for Entry { name, kind } in folder::entries(&folder).map_err(Error::io(&folder, "list"))? {
            let path = folder.join(&name);
            if name.as_encoded_bytes().starts_with(b".") {
                continue;
            }
            // A link to a folder might lead back up.
            if kind == EntryKind::Folder {
                let tiles = has_extension(&path, &["tiles"]) && path.join(INDEX).is_file();
                match depth {
                    Depth::Recursive if tiles => strays.meshes.push(path),
                    Depth::Recursive => waiting.push(path),
                    Depth::Flat => deeper = true,
                }
                continue;
            }
            if !path.is_file() {
                continue;
            }
            if !has_extension(&bare(&path), &POINT_FILES) {
                // Side-cars are read with their files.
                if !(has_extension(&path, &["json"]) && path.with_extension("").is_file()) {
                    strays.others.push((path, None));
                }
            } else if is_own_mesh(&path) {
                strays.meshes.push(path);
            } else {
                match without_points(&path) {
                    Some(why) => pointless.push((path, Some(why))),
                    None => files.push(path),
                }
            }
        }
    }
    if files.is_empty() {
        // Whoever names a folder of such files is told what is wrong with the first of them.
        pointless.sort();
        match (pointless.into_iter().next(), deeper) {
            (Some((first, _)), _) => return Ok(vec![first]),
            (None, true) => {
                return none(folder, "the folder holds no point file; `recursive` looks into the folders in it, too");
            }
            (None, false) => return none(folder, "the folder holds no point file"),
        }
    }
    strays.others.extend(pointless);
    files.sort();
    Ok(files)
}

/// Files of a folder that are left out.
#[derive(Default)]
struct Strays {
    /// Meshes of this program.
    meshes: Vec<PathBuf>,
    /// Others, and what is wrong with those that have the name of a point cloud.
    others: Vec<(PathBuf, Option<&'static str>)>,
}

impl Strays {
    /// Lines about them.
    fn told(mut self, folder: &Path) -> Vec<String> {
        self.meshes.sort();
        self.others.sort();
        let short = |path: &Path| path.strip_prefix(folder).unwrap_or(path).display().to_string();
        let other = |(path, why): &(PathBuf, Option<&str>)| match why {
            Some(why) => format!("{} ({why})", short(path)),
            None => short(path),
        };
        let line = |what: &str, names: Vec<String>| {
            let more = match names.len() {
                ..=NAMED => String::new(),
                all => format!(" and {} more", all - NAMED),
            };
            let named = names[..names.len().min(NAMED)].join(", ");
            (!names.is_empty()).then(|| format!("{}: left out, {what}: {named}{more}", folder.display()))
        };
        let meshes = line("meshes of this program", self.meshes.iter().map(|path| short(path)).collect());
        let others = line("no point clouds", self.others.iter().map(other).collect());
        meshes.into_iter().chain(others).collect()
    }
}

/// Whether the file has the name that a mesh gets by default, or says in its header that this program made it, with triangles: the mesh of an earlier run is no part
/// of the cloud beside it.
fn is_own_mesh(path: &Path) -> bool {
    let bare = bare(path);
    if bare.to_str().is_some_and(|name| name.ends_with(".mesh.ply")) {
        return true;
    }
    has_extension(&bare, &["ply"]) && head(path).is_some_and(|(head, _)| tells_own_mesh(&head))
}

/// Whether this is the beginning of a PLY file of this program with triangles.
fn tells_own_mesh(head: &[u8]) -> bool {
    let lines = || {
        let header = head.split(|byte| *byte == b'\n').map(<[u8]>::trim_ascii);
        header.take_while(|line| *line != b"end_header")
    };
    let faces = |line: &[u8]| line.strip_prefix(b"element face ").is_some_and(|count| count != b"0");
    ply::is_ply(head) && lines().any(|line| line.starts_with(b"comment asra-stream ")) && lines().any(faces)
}

/// Why a file that has the name of a point cloud holds none; `None` if it may hold one.
fn without_points(path: &Path) -> Option<&'static str> {
    let length = path.metadata().ok()?.len();
    let (head, packed) = head(path)?;
    if head.is_empty() {
        return Some("empty");
    }
    let known = [ply::is_ply, las::is_las, e57::is_e57, pcd::is_pcd];
    if known.iter().any(|is| is(&head)) || head.starts_with(npy::SIGNATURE) {
        return None;
    }
    if let Some((format, _)) = detect::foreign(&head, length).filter(|_| !packed) {
        return Some(format);
    }
    // Text that goes on may have numbers further on.
    let whole = (head.len() as u64) < HEAD;
    (whole && detect::is_text(&head) && !has_numbers(&head)).then_some("text without points")
}

/// Whether a line of a text has three numbers.
fn has_numbers(text: &[u8]) -> bool {
    let is_number = |word: &&[u8]| std::str::from_utf8(word).is_ok_and(|word| word.parse::<f64>().is_ok());
    let numbers = |line: &[u8]| {
        let words = line.split(|byte| byte.is_ascii_whitespace() || matches!(byte, b',' | b';' | b'"'));
        words.filter(is_number).take(3).count() == 3
    };
    text.split(|byte| *byte == b'\n').any(numbers)
}

/// The beginning of a file, unpacked, and whether it was packed; `None` if it cannot be read.
fn head(path: &Path) -> Option<(Vec<u8>, bool)> {
    /// The largest window of Zstandard, as a power of two, that is allowed for a look.
    const WINDOW: u32 = 23;
    let mut file = File::open(path).ok()?;
    let mut head = Vec::new();
    Read::by_ref(&mut file).take(4).read_to_end(&mut head).ok()?;
    let packing = Packing::of(&head);
    head.clear();
    file.rewind().ok()?;
    let read = match packing {
        None => file.take(HEAD).read_to_end(&mut head),
        Some(Packing::Gzip) => flate2::read::MultiGzDecoder::new(file).take(HEAD).read_to_end(&mut head),
        Some(Packing::Zstandard) => {
            let mut frames = zstd::stream::read::Decoder::new(file).ok()?;
            frames.window_log_max(WINDOW).ok()?;
            frames.take(HEAD).read_to_end(&mut head)
        }
    };
    read.ok().map(|_| (head, packing.is_some()))
}

/// The name without the extension of a compressed file.
fn bare(path: &Path) -> PathBuf {
    Packing::named(path).map_or_else(|| path.to_path_buf(), |(_, bare)| bare)
}

fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    path.extension().is_some_and(|e| extensions.iter().any(|known| e.eq_ignore_ascii_case(known)))
}

fn none(input: &Path, found: &'static str) -> Result<Vec<PathBuf>> {
    Err(Error::NoInput { path: input.to_path_buf(), found })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_folders_and_names_give_each_file_once() {
        let dir = tempfile::tempdir().unwrap();
        for name in [
            "b.ply",
            "a.ply",
            "c.bin",
            "c.bin.json",
            "notes.md",
            "[odd].xyz",
            "a.mesh.ply",
            "a.mesh.ply.gz",
            "b.obj",
            "b.STL",
            "c.gz",
            "d.tar.zst",
            "e.pcd.GZ",
            "f.npy.zst",
        ] {
            std::fs::write(dir.path().join(name), "1 2 3\n").unwrap();
        }
        let names = |inputs: &[&str]| {
            let inputs: Vec<PathBuf> = inputs.iter().map(|i| dir.path().join(i)).collect();
            let files = expand(&inputs)?;
            Ok::<_, Error>(
                files.iter().map(|f| f.file_name().unwrap().to_str().unwrap().to_owned()).collect::<Vec<_>>(),
            )
        };
        assert_eq!(names(&["*.ply"]).unwrap(), ["a.ply", "b.ply"]);
        assert_eq!(names(&["b.ply", "?.ply", "./a.ply"]).unwrap(), ["b.ply", "a.ply"]);
        assert_eq!(names(&["c.*"]).unwrap(), ["c.bin", "c.gz"], "side-cars are not points");
        assert_eq!(names(&[""]).unwrap(), ["[odd].xyz", "a.ply", "b.ply", "c.bin", "e.pcd.GZ", "f.npy.zst"]);
        let standard_input = [PathBuf::from("-"), PathBuf::from("-")];
        assert_eq!(expand(&standard_input).unwrap(), standard_input[..1]);
        assert_eq!(names(&["[odd].xyz"]).unwrap(), ["[odd].xyz"], "an existing file is no pattern");
        assert_eq!(names(&["a.mesh.ply"]).unwrap(), ["a.mesh.ply"], "a mesh counts if it is named");
        assert!(names(&["*.las"]).unwrap_err().to_string().contains("matches no file"));
        assert!(names(&["[.ply"]).unwrap_err().to_string().contains("not a valid pattern"));
        assert!(matches!(names(&["gone.ply"]), Err(Error::Io { .. })));
        assert!(expand(&[]).is_err());
    }

    #[test]
    fn a_side_car_that_is_named_with_its_file_is_no_input() {
        let dir = folder(&[("a.bin", b"points"), ("a.bin.json", b"{}"), ("b.bin.json", b"{}")]);
        let [file, own, other] = ["a.bin", "a.bin.json", "b.bin.json"].map(|name| dir.path().join(name));
        assert_eq!(expand(&[own.clone(), file.clone()]).unwrap(), std::slice::from_ref(&file));
        assert_eq!(expand(&[file.clone(), own.clone()]).unwrap(), [file]);
        assert_eq!(expand(&[own.clone(), other.clone()]).unwrap(), [own, other], "whoever names them alone means them");
    }

    #[test]
    fn patterns_are_matched_as_shells_do_it() {
        let names = ["a/1.xyz", "a/2.xyz", "b/1.xyz", "b/in/3.xyz", ".hidden/4.xyz", "a/.5.xyz", "c.xyz"];
        let dir = folder(&names.map(|name| (name, &b"1 2 3\n"[..])));
        std::os::unix::fs::symlink(dir.path(), dir.path().join("b/up")).unwrap();
        for (pattern, expected) in [
            ("*/1.xyz", &["a/1.xyz", "b/1.xyz"][..]),
            ("[ab]/*.xyz", &["a/1.xyz", "a/2.xyz", "b/1.xyz"]),
            ("**/*.xyz", &["a/1.xyz", "a/2.xyz", "b/1.xyz", "b/in/3.xyz", "c.xyz"]),
            ("**/in/?.xyz", &["b/in/3.xyz"]),
            ("?/../c.xyz", &["a/../c.xyz"]),
            (".h*/*", &[".hidden/4.xyz"]),
            ("*/.*.xyz", &["a/.5.xyz"]),
            ("c.xyz/*", &[]),
        ] {
            let found = expand(&[dir.path().join(pattern)]);
            let name = |path: &PathBuf| path.strip_prefix(dir.path()).unwrap().to_str().unwrap().to_owned();
            let found: Vec<String> = found.unwrap_or_default().iter().map(name).collect();
            assert_eq!(found, expected, "{pattern}");
        }
    }

    /// A PLY file with so many triangles, with a comment.
    fn ply_file(comment: &str, faces: usize) -> String {
        format!(
            "ply\nformat ascii 1.0\ncomment {comment}\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\n\
             element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
        )
    }

    fn gzip(content: &[u8]) -> Vec<u8> {
        use std::io::Write;
        let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        out.write_all(content).unwrap();
        out.finish().unwrap()
    }

    /// A folder with files in it, some in folders.
    fn folder(files: &[(&str, &[u8])]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for (name, content) in files {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, content).unwrap();
        }
        dir
    }

    fn found(dir: &tempfile::TempDir, depth: Depth) -> (Vec<String>, Vec<String>) {
        let Found { files, left_out } = find(&[dir.path().to_path_buf()], depth).unwrap();
        let name = |path: &PathBuf| path.strip_prefix(dir.path()).unwrap().to_str().unwrap().to_owned();
        let start = format!("{}: left out, ", dir.path().display());
        let line = |line: &String| line.strip_prefix(&start).unwrap().to_owned();
        (files.iter().map(name).collect(), left_out.iter().map(line).collect())
    }

    #[test]
    fn own_meshes_are_no_clouds_whatever_they_are_called() {
        let own = ply_file("asra-stream 0.1.0", 7);
        let dir = folder(&[
            ("scan.ply", ply_file("made elsewhere", 7).as_bytes()),
            ("cloud.ply", ply_file("asra-stream densify", 0).as_bytes()),
            ("city.ply", own.as_bytes()),
            ("city2.ply.gz", &gzip(own.as_bytes())),
            ("city3.ply.zst", &zstd::encode_all(own.as_bytes(), 1).unwrap()),
        ]);
        let meshes = "meshes of this program: city.ply, city2.ply.gz, city3.ply.zst".to_owned();
        assert_eq!(found(&dir, Depth::Flat), (vec!["cloud.ply".to_owned(), "scan.ply".to_owned()], vec![meshes]));
        let pattern = find(&[dir.path().join("c*.ply")], Depth::Flat).unwrap();
        assert_eq!(pattern.files, [dir.path().join("cloud.ply")]);
        assert!(pattern.left_out[0].ends_with("city.ply"), "{:?}", pattern.left_out);
        let named = dir.path().join("city.ply");
        assert_eq!(expand(std::slice::from_ref(&named)).unwrap(), [named], "a mesh counts if it is named");
    }

    #[test]
    fn strays_are_named_and_damaged_clouds_are_none() {
        let cut = ply_file("made elsewhere", 7).into_bytes();
        let dir = folder(&[
            ("a.xyz", b"1 2 3\n"),
            ("b.csv", b"id;x;y;z\n1;1,5;2,5;3,5\n"),
            ("c.txt.gz", &gzip(b"1 2 3\n")),
            ("cut.ply", &cut[..40]),
            ("cut.gz", b"\x1f\x8b\x08\0\0\0"),
            ("cut.txt", b"\x1f\x8b\x08\0\0\0"),
            ("misnamed.txt", &gzip(b"1 2 3\n")),
            ("empty.laz", b""),
            ("notes.md", b"1 2 3\n"),
            ("packed.bin", b"PK\x03\x04 and so on"),
            ("readme.txt", b"scanned in 2026, by 2 people\n"),
            ("readme.txt.gz", &gzip(b"see readme\n")),
            (".hidden.xyz", b"1 2 3\n"),
            ("raw.bin", &[0, 1, 2, 3]),
            ("raw.bin.json", b"{}"),
            ("lonely.json", b"{}"),
        ]);
        let (files, left_out) = found(&dir, Depth::Flat);
        assert_eq!(files, ["a.xyz", "b.csv", "c.txt.gz", "cut.ply", "cut.txt", "misnamed.txt", "raw.bin"]);
        let strays =
            "no point clouds: cut.gz, empty.laz (empty), lonely.json, notes.md, packed.bin (a ZIP archive) and 2 more";
        assert_eq!(left_out, [strays]);
    }

    #[test]
    fn folders_in_folders_are_looked_into_if_that_is_asked_for() {
        let dir = folder(&[
            ("a.xyz", b"1 2 3\n"),
            ("east/b.xyz", b"1 2 3\n"),
            ("east/deep/c.xyz", b"1 2 3\n"),
            ("east/deep/notes.md", b""),
            (".asra-stream.x.tiles/d.xyz", b"1 2 3\n"),
            ("city.tiles/index.json", b"{}"),
            ("city.tiles/0_0.ply", ply_file("asra-stream 0.1.0", 1).as_bytes()),
            ("my.tiles/e.xyz", b"1 2 3\n"),
        ]);
        std::os::unix::fs::symlink(dir.path(), dir.path().join("east/up")).unwrap();
        assert_eq!(found(&dir, Depth::Flat), (vec!["a.xyz".to_owned()], vec![]));
        let (files, left_out) = found(&dir, Depth::Recursive);
        assert_eq!(files, ["a.xyz", "east/b.xyz", "east/deep/c.xyz", "my.tiles/e.xyz"]);
        assert_eq!(left_out, ["meshes of this program: city.tiles", "no point clouds: east/deep/notes.md"]);
        let alone = find(&[dir.path().join("east/deep/..")], Depth::Flat).unwrap();
        assert_eq!(alone.files.len(), 1);
        let outer = folder(&[("in/a.xyz", b"1 2 3\n")]);
        let error = expand(&[outer.path().to_path_buf()]).unwrap_err().to_string();
        assert!(
            error.ends_with("the folder holds no point file; `recursive` looks into the folders in it, too"),
            "{error}"
        );
    }

    #[test]
    fn a_folder_of_strays_alone_says_what_is_wrong_with_the_first() {
        let dir = folder(&[("readme.txt", b"nothing\n"), ("empty.laz", b"")]);
        assert_eq!(found(&dir, Depth::Flat).0, ["empty.laz"]);
    }
}
