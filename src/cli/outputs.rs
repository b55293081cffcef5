//! Before any work: nothing that a command is going to write takes the place of something it reads, of another output, or of what is no ordinary file.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use super::args::{Arguments, Command};
use crate::error::{Error, Result};
use crate::format::tiles3d::{TREE, is_named};
use crate::format::write;
use crate::format::write::Format;
use crate::format::write::tiles::INDEX;
use crate::format::write::tiling::Tiling;
use crate::input::{STANDARD_INPUT, Sidecar, expand, find};
use crate::render::page::is_page;
use crate::run;
use crate::run::preview::Preview;
use crate::run::pyramid::TilesetTarget;
use crate::storage::atomic_file::{AtomicFile, Overwrite};
use crate::system::{file_number, folder};

/// Extensions of points that have no side-car.
const WITHOUT_SIDECAR: [&str; 15] =
    ["ply", "las", "laz", "e57", "xyz", "txt", "csv", "pts", "asc", "pcd", "npy", "obj", "stl", "gz", "zst"];

/// A file that is going to be written.
struct Output {
    path: PathBuf,
    /// What it is, for messages.
    what: &'static str,
    kind: Kind,
    overwrite: Overwrite,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// A file of its own.
    File,
    /// A file that comes beside another if there is something to say.
    Beside,
    /// JSON, which replaces an older report.
    Report,
    /// A page, which replaces an older one.
    Page,
    /// A folder of tiles.
    Tiles,
    /// The folder of a tileset.
    Tileset,
}

/// Refuses a command whose outputs would replace what they must not, or that cannot be written where they should be.
///
/// # Errors
/// [`Error::Usage`]; [`Error::OutputExists`]; [`Error::Io`] if a folder cannot be written to.
pub fn check(arguments: &Arguments) -> Result<()> {
    let (inputs, outputs) = reads_and_writes(arguments);
    let inputs: Vec<PathBuf> = inputs.into_iter().flat_map(with_sidecar).collect();
    for (number, output) in outputs.iter().enumerate() {
        if let Some(input) = inputs.iter().find(|input| is_same(input, &output.path)) {
            return Err(Error::Usage(format!(
                "{}: is an input, which the {} would replace; choose another name",
                input.display(),
                output.what
            )));
        }
        let within =
            |input: &&PathBuf| matches!(output.kind, Kind::Tiles | Kind::Tileset) && is_within(input, &output.path);
        if let Some(input) = inputs.iter().find(within) {
            return Err(Error::Usage(format!(
                "{}: is an input, in the folder that the tiles would replace",
                input.display()
            )));
        }
        if let Some(other) = outputs[..number].iter().find(|other| is_same(&other.path, &output.path)) {
            return Err(Error::Usage(format!(
                "{}: cannot be both the {} and the {}",
                output.path.display(),
                other.what,
                output.what
            )));
        }
    }
    outputs.iter().try_for_each(Output::check)
}

/// The report's file, if nothing speaks against writing that.
pub fn sound_report(arguments: &Arguments) -> Option<PathBuf> {
    let (inputs, outputs) = reads_and_writes(arguments);
    let report = outputs.iter().find(|output| output.kind == Kind::Report)?;
    let mut others = outputs.iter().filter(|output| output.kind != Kind::Report).map(|output| &output.path);
    let taken = inputs.into_iter().flat_map(with_sidecar).any(|input| is_same(&input, &report.path))
        || others.any(|other| is_same(other, &report.path));
    (!taken && report.check().is_ok()).then(|| report.path.clone())
}

impl Output {
    /// Whether it can be written where it is to be.
    fn check(&self) -> Result<()> {
        match self.kind {
            Kind::File => AtomicFile::create(&self.path, self.overwrite).map(drop),
            Kind::Beside if self.path.symlink_metadata().is_ok() => {
                AtomicFile::create(&self.path, self.overwrite).map(drop)
            }
            Kind::Beside => Ok(()),
            Kind::Report => {
                let older = self.path.is_file() && self.overwrite == Overwrite::Refuse;
                if older && !begins_like_json(&self.path) {
                    return Err(Error::Usage(format!(
                        "{}: exists and is no report, which alone --report replaces; choose another name",
                        self.path.display()
                    )));
                }
                AtomicFile::report(&self.path).map(drop)
            }
            Kind::Page => {
                if self.path.is_file() && !begins_like_a_page(&self.path) {
                    return Err(Error::Usage(format!(
                        "{}: exists and is no page of a report, which alone --html replaces; choose another name",
                        self.path.display()
                    )));
                }
                AtomicFile::report(&self.path).map(drop)
            }
            Kind::Tiles | Kind::Tileset => {
                let index = if self.kind == Kind::Tiles { INDEX } else { TREE };
                let (there, path) = (self.path.symlink_metadata().is_ok(), self.path.display());
                if there && self.overwrite == Overwrite::Refuse {
                    return Err(Error::OutputExists(self.path.clone()));
                }
                let empty = || folder::entries(&self.path).is_ok_and(|entries| entries.is_empty());
                if there && !self.path.join(index).is_file() && !empty() {
                    return Err(Error::Usage(format!(
                        "{path}: is no folder of tiles (it has no {index}), which alone --overwrite replaces; choose another --output"
                    )));
                }
                Ok(())
            }
        }
    }
}

/// What a command reads, as far as it is there, and what it writes.
fn reads_and_writes(arguments: &Arguments) -> (Vec<PathBuf>, Vec<Output>) {
    let mut outputs = Vec::new();
    let may = super::args::overwrite;
    let mut put = |path: PathBuf, what: &'static str, kind: Kind, overwrite: Overwrite| {
        outputs.push(Output { path, what, kind, overwrite });
    };
    let inputs = match &arguments.command {
        None => {
            let arguments = &arguments.reconstruct;
            // An output that is there may be what this run named before it was ended: its folder knows, which the run looks into.
            let overwrite = if arguments.work.is_some() { Overwrite::Replace } else { may(arguments.overwrite) };
            let files = find(&arguments.cloud.inputs, arguments.cloud.depth()).unwrap_or_default().files;
            // What is wrong with the arguments otherwise is told where they are used.
            let output = match arguments.output().ok().flatten() {
                Some(output) => Some(output),
                None if files.is_empty() => None,
                None => run::default_output_of(&arguments.cloud.inputs, &files).ok(),
            };
            if let Some(output) = &output {
                match arguments.tile.map(|_| ()).or(arguments.batch.then_some(())) {
                    Some(()) if matches!(Format::from_path(output), Ok(Format::Ply | Format::Glb)) => {
                        put(Tiling::path(output), "tiles", Kind::Tiles, overwrite);
                    }
                    Some(()) => {}
                    None if is_named(output) => {
                        if let Ok(folder) = TilesetTarget::folder(output) {
                            put(folder.to_path_buf(), "tileset", Kind::Tileset, overwrite);
                        }
                    }
                    None if Format::from_path(output).is_ok() => {
                        put(output.clone(), "mesh", Kind::File, overwrite);
                        for path in write::beside(output) {
                            put(path, "mesh's side-car", Kind::Beside, overwrite);
                        }
                    }
                    None => {}
                }
                let preview = match &arguments.preview {
                    None => Preview::None,
                    Some(None) => Preview::Beside,
                    Some(Some(path)) => Preview::At(path.clone()),
                };
                if let Some(path) = preview.path(output) {
                    put(path, "preview", Kind::File, overwrite);
                }
            }
            if let Some(path) = &arguments.write_classes {
                put(path.clone(), "file of classes", Kind::File, overwrite);
            }
            if let Some(path) = &arguments.dtm {
                put(path.clone(), "raster of the ground", Kind::File, overwrite);
            }
            if let Some(path) = &arguments.dsm {
                put(path.clone(), "raster of what is highest", Kind::File, overwrite);
            }
            if let Some(path) = &arguments.report {
                put(path.clone(), "report", Kind::Report, overwrite);
            }
            if let Some(path) = &arguments.html {
                put(path.clone(), "page", Kind::Page, overwrite);
            }
            files
        }
        Some(Command::Check(arguments)) => {
            if let Some(path) = &arguments.report {
                put(path.clone(), "report", Kind::Report, Overwrite::Refuse);
            }
            if let Some(path) = &arguments.html {
                put(path.clone(), "page", Kind::Page, Overwrite::Refuse);
            }
            vec![arguments.mesh.clone()]
        }
        Some(Command::Compare(arguments)) => {
            let overwrite = may(arguments.overwrite);
            if let Some(path) = &arguments.heatmap {
                put(path.clone(), "heat map", Kind::File, overwrite);
            }
            if let Some(path) = &arguments.report {
                put(path.clone(), "report", Kind::Report, overwrite);
            }
            if let Some(path) = &arguments.html {
                put(path.clone(), "page", Kind::Page, overwrite);
            }
            let mut inputs = expand(std::slice::from_ref(&arguments.reference)).unwrap_or_default();
            inputs.push(arguments.mesh.clone());
            inputs
        }
        Some(Command::Densify(arguments)) => {
            let overwrite = may(arguments.overwrite);
            put(arguments.output.clone(), "cloud", Kind::File, overwrite);
            put(Sidecar::path_for(&arguments.output), "cloud's side-car", Kind::Beside, overwrite);
            let mut inputs = expand(std::slice::from_ref(&arguments.cloud)).unwrap_or_default();
            inputs.push(arguments.mesh.clone());
            inputs
        }
        Some(Command::Simplify(arguments)) => {
            let overwrite = may(arguments.overwrite);
            put(arguments.output.clone(), "mesh", Kind::File, overwrite);
            for path in write::beside(&arguments.output) {
                put(path, "mesh's side-car", Kind::Beside, overwrite);
            }
            if let Some(path) = &arguments.report {
                put(path.clone(), "report", Kind::Report, Overwrite::Refuse);
            }
            vec![arguments.mesh.clone()]
        }
        Some(Command::Tileset(arguments)) => {
            if let Ok(folder) = TilesetTarget::folder(&arguments.output) {
                put(folder.to_path_buf(), "tileset", Kind::Tileset, may(arguments.overwrite));
            }
            if let Some(path) = &arguments.report {
                put(path.clone(), "report", Kind::Report, Overwrite::Refuse);
            }
            vec![arguments.mesh.clone()]
        }
        Some(Command::Render(arguments)) => {
            let output = arguments.output.clone().unwrap_or_else(|| arguments.mesh.with_extension("png"));
            put(output, "picture", Kind::File, may(arguments.overwrite));
            vec![arguments.mesh.clone()]
        }
        Some(Command::Generate(arguments)) => {
            let overwrite = may(arguments.overwrite);
            put(arguments.output.clone(), "cloud", Kind::File, overwrite);
            put(Sidecar::path_for(&arguments.output), "cloud's side-car", Kind::Beside, overwrite);
            Vec::new()
        }
        Some(
            Command::Plan(_)
            | Command::Tasks(_)
            | Command::Work(_)
            | Command::Info(_)
            | Command::View(_)
            | Command::Completions(_)
            | Command::Man(_),
        ) => Vec::new(),
    };
    (inputs, outputs)
}

/// A file, and its side-car if there is one, or if one that came up there would change how the file is read.
fn with_sidecar(input: PathBuf) -> Vec<PathBuf> {
    if input == Path::new(STANDARD_INPUT) {
        return Vec::new();
    }
    let sidecar = Sidecar::path_for(&input);
    let extension = input.extension().and_then(OsStr::to_str).unwrap_or_default().to_ascii_lowercase();
    match sidecar.exists() || !WITHOUT_SIDECAR.contains(&extension.as_str()) {
        true => vec![input, sidecar],
        false => vec![input],
    }
}

/// Whether two names are of one file, which need not be there.
fn is_same(a: &Path, b: &Path) -> bool {
    match (fs::metadata(a), fs::metadata(b)) {
        (Ok(there), Ok(other)) => {
            matches!((file_number(a, &there), file_number(b, &other)), (Some(a), Some(b)) if a == b)
        }
        (Err(_), Err(_)) => resolved(a).is_some_and(|a| resolved(b) == Some(a)),
        _ => false,
    }
}

fn is_within(path: &Path, folder: &Path) -> bool {
    matches!((path.canonicalize(), folder.canonicalize()), (Ok(path), Ok(folder)) if path.starts_with(&folder))
}

/// A name without links and dots, of a file that is not there in a folder that is.
fn resolved(path: &Path) -> Option<PathBuf> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    Some(folder.canonicalize().ok()?.join(path.file_name()?))
}

/// Whether a file is empty or a report's page.
fn begins_like_a_page(path: &Path) -> bool {
    /// The mark stands in the first lines.
    const HEAD: u64 = 4 << 10;
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head));
    read.is_ok() && is_page(&head)
}

/// Whether a file is empty or begins as reports do.
fn begins_like_json(path: &Path) -> bool {
    let mut first = [0];
    match File::open(path).and_then(|mut file| file.read(&mut first)) {
        Ok(0) => true,
        Ok(_) => first == *b"{",
        Err(_) => false,
    }
}
