//! From the arguments to the files: patterns, folders, and each file once.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::unpack::{Packing, STANDARD_INPUT};
use crate::error::{Error, Result};

/// Extensions that are taken for point files when a whole folder is given; also with that of a compressed file behind them. Files that are
/// meshes as a rule (`.obj`, `.stl`) must be named.
const POINT_FILES: [&str; 16] =
    ["ply", "las", "laz", "e57", "xyz", "txt", "csv", "pts", "asc", "bin", "xyz32", "raw", "f32", "dat", "pcd", "npy"];

/// The files the arguments stand for (files, patterns, folders, `-` for standard input), in the arguments' order, each once.
///
/// # Errors
/// [`Error::Usage`] if there is no argument, or a pattern or folder holds no point file; [`Error::Io`] if an argument
/// does not exist.
pub fn expand(inputs: &[PathBuf]) -> Result<Vec<PathBuf>> {
    if inputs.is_empty() {
        return Err(Error::Usage("no input file given".to_string()));
    }
    let mut seen = BTreeSet::new();
    let mut files = Vec::new();
    for input in inputs {
        for file in stands_for(input)? {
            // Links and `./` must not let a file count twice. A file by the name of standard input is `./-`.
            let standard_input = file == Path::new(STANDARD_INPUT);
            let one = if standard_input { Ok(file.clone()) } else { file.canonicalize() };
            if seen.insert(one.map_err(Error::io(&file, "open"))?) {
                files.push(file);
            }
        }
    }
    Ok(files)
}

fn stands_for(input: &Path) -> Result<Vec<PathBuf>> {
    if input == Path::new(STANDARD_INPUT) {
        return Ok(vec![input.to_path_buf()]);
    }
    if input.is_dir() {
        return point_files_in(input);
    }
    let pattern = input.to_string_lossy();
    if input.exists() || !pattern.contains(['*', '?', '[']) {
        return Ok(vec![input.to_path_buf()]);
    }
    let paths = glob::glob(&pattern).map_err(|e| Error::Usage(format!("{pattern}: not a valid pattern: {e}")))?;
    let mut files = Vec::new();
    for path in paths {
        let path = path.map_err(|e| Error::io(e.path(), "read")(std::io::Error::from(e.error().kind())))?;
        // `scans/*` also matches the side-cars.
        if path.is_file() && !has_extension(&path, &["json"]) && !is_own_mesh(&path) {
            files.push(path);
        }
    }
    some(files, input, "the pattern matches no file")
}

fn point_files_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder, "list"))? {
        let path = entry.map_err(Error::io(folder, "list"))?.path();
        if path.is_file() && has_extension(&bare(&path), &POINT_FILES) && !is_own_mesh(&path) {
            files.push(path);
        }
    }
    files.sort();
    some(files, folder, "the folder holds no point file")
}

/// Whether the file has the name that a mesh gets by default: the mesh of an earlier run is no part of the cloud beside it.
fn is_own_mesh(path: &Path) -> bool {
    bare(path).to_str().is_some_and(|name| name.ends_with(".mesh.ply"))
}

/// The name without the extension of a compressed file.
fn bare(path: &Path) -> PathBuf {
    Packing::named(path).map_or_else(|| path.to_path_buf(), |(_, bare)| bare)
}

fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    path.extension().is_some_and(|e| extensions.iter().any(|known| e.eq_ignore_ascii_case(known)))
}

fn some(files: Vec<PathBuf>, input: &Path, otherwise: &'static str) -> Result<Vec<PathBuf>> {
    if files.is_empty() { Err(Error::NoInput { path: input.to_path_buf(), found: otherwise }) } else { Ok(files) }
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
            std::fs::write(dir.path().join(name), "x").unwrap();
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
}
