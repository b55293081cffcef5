//! `view`: a tileset, a mesh or a cloud in a browser on this machine.
//!
//! A tileset is served as it is. A mesh becomes one first, and so does the mesh of a cloud, in a folder that goes when the command ends.

mod server;

use std::fs::File;
use std::io::{BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;

use serde::de::IgnoredAny;
use tempfile::TempDir;

use self::server::{Server, Site};
use crate::cli::args::ViewArguments;
use crate::error::{Error, Result};
use crate::format;
use crate::format::tiles3d::TREE;
use crate::input::InputOptions;
use crate::render::page;
use crate::resources::workers::Workers;
use crate::run::job::Job;
use crate::run::progress::Progress;
use crate::run::pyramid::TilesetJob;
use crate::run::{run, tileset_file};
use crate::settings::tileset::TilesetOptions;
use crate::storage::atomic_file::Overwrite;
use crate::storage::spool::Workspace;

/// Shows what the arguments name until the workers are cancelled.
///
/// # Errors
/// Those of making a tileset of a mesh or a cloud; [`Error::Usage`] if it is none of these, or the port is not to be had; [`Error::Interrupted`] while a tileset is made.
pub fn view(arguments: &ViewArguments, workers: &Workers, progress: &mut Progress) -> Result<()> {
    // First of all: so a port that is taken costs no work.
    let server = Server::new(arguments.port)?;
    let shown = Shown::of(arguments, workers, progress)?;
    let title = arguments.path.file_name().unwrap_or(arguments.path.as_os_str()).to_string_lossy();
    let site = Site::new(page::viewer(&title, &shown.tree), &shown.folder)?;
    let port = server.port();
    let address = format!("http://127.0.0.1:{port}/");
    // Whoever reads this may have gone.
    let _ = writeln!(std::io::stdout(), "{address}").and_then(|()| std::io::stdout().flush());
    progress.note(&format!("from another machine: ssh -L {port}:127.0.0.1:{port} {}", this_host()));
    progress.note("Ctrl-C ends it");
    if !arguments.no_open {
        open(&address);
    }
    server.serve(&site, workers)
}

/// What is shown.
struct Shown {
    folder: PathBuf,
    /// The name of the tileset's tree.
    tree: String,
    /// Goes with this.
    _made: Option<TempDir>,
}

impl Shown {
    fn of(arguments: &ViewArguments, workers: &Workers, progress: &mut Progress) -> Result<Shown> {
        let path = &arguments.path;
        if path.is_dir() {
            if !path.join(TREE).is_file() {
                let words =
                    format!("{}: is no tileset (it has no {TREE}); name a tileset, a mesh or a cloud", path.display());
                return Err(Error::Usage(words));
            }
            looks_like_a_tree(&path.join(TREE))?;
            return Ok(Shown { folder: path.clone(), tree: TREE.into(), _made: None });
        }
        let is_tree = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
        if let (true, Some(tree)) = (is_tree, path.file_name().and_then(|name| name.to_str())) {
            looks_like_a_tree(path)?;
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
            return Ok(Shown { folder: folder.to_path_buf(), tree: tree.to_owned(), _made: None });
        }
        let made = temporary(arguments)?;
        // In a folder that is not there yet.
        let folder = made.path().join("tiles");
        let output = folder.join(TREE);
        let resources = arguments.resources.resources();
        if format::read::has_triangles(path)? {
            let options = TilesetOptions::default();
            // In the coordinates of the mesh, which are those that people ask for.
            let crs = Some(None);
            let job = TilesetJob { mesh: path.clone(), crs, output, overwrite: Overwrite::Refuse, options, resources };
            let report = tileset_file(&job, workers, progress)?;
            report.warnings.iter().for_each(|warning| progress.warn(warning));
        } else {
            let input = InputOptions { crs: Some(None), ..InputOptions::default() };
            let job = Job { input, output: Some(output), resources, ..Job::new([path]) };
            let report = run(&job, workers, progress)?;
            progress.summary(&report.summary(false));
        }
        Ok(Shown { folder, tree: TREE.into(), _made: Some(made) })
    }
}

/// A tileset's tree, as far as it is told by its first keys.
#[derive(serde::Deserialize)]
struct Tree {
    #[serde(rename = "asset")]
    _asset: IgnoredAny,
    #[serde(rename = "root")]
    _root: IgnoredAny,
}

/// Refuses what is no tileset before a browser is asked to show it.
fn looks_like_a_tree(path: &Path) -> Result<()> {
    let file = File::open(path).map_err(Error::io(path, "open"))?;
    // Nothing of it is kept.
    let read: std::result::Result<Tree, _> = serde_json::from_reader(BufReader::new(file));
    match read {
        Ok(_) => Ok(()),
        Err(error) if error.is_io() => Err(Error::io(path, "read")(error.into())),
        Err(error) => Err(Error::malformed(
            path,
            format!("line {}", error.line().max(1)),
            "the tree of a tileset: JSON with `asset` and `root`",
            error.to_string(),
        )),
    }
}

/// A folder for the tileset that is made: where temporary files go, or, if nothing can be written there, where the system has them.
fn temporary(arguments: &ViewArguments) -> Result<TempDir> {
    let named = arguments.resources.temp_dir.clone();
    let folder = named.clone().unwrap_or_else(|| Workspace::folder_beside(&arguments.path));
    let make = |folder: &Path| tempfile::Builder::new().prefix(".asra-view-").tempdir_in(folder);
    let made = match make(&folder) {
        Err(_) if named.is_none() => make(&std::env::temp_dir()),
        made => made,
    };
    made.map_err(Error::io(&folder, "create a folder in"))
}

/// What to call this machine from another one: as whoever is logged in here by ssh does.
fn this_host() -> String {
    let connection = std::env::var("SSH_CONNECTION").unwrap_or_default();
    connection.split(' ').nth(2).filter(|address| !address.is_empty()).unwrap_or("HOST").to_owned()
}

/// Opens a browser, if there is one; if not, whoever started this opens one.
fn open(address: &str) {
    let mut command = if cfg!(windows) {
        let mut command = Command::new("cmd");
        command.args(["/C", "start", ""]);
        command
    } else if cfg!(target_os = "macos") {
        Command::new("open")
    } else if ["DISPLAY", "WAYLAND_DISPLAY", "BROWSER"].iter().any(|name| std::env::var_os(name).is_some()) {
        Command::new("xdg-open")
    } else {
        return;
    };
    command.arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    if let Ok(mut child) = command.spawn() {
        // Not waited for by anyone, but looked after.
        let wait = move || drop(child.wait());
        let _ = thread::Builder::new().name("asra-browser".into()).spawn(wait);
    }
}
