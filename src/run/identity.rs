//! What decides the bytes of a run's mesh, as a value: two runs are parts of one if, and only if, it is the same for both.
//!
//! Memory, threads and folders are not in it, nor is what is made of the finished mesh: the format, tiles, pictures.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::UNIX_EPOCH;

use serde_json::{Map, Value, json};

use crate::error::{Error, Result};
use crate::input::{Cloud, InputOptions};
use crate::run::surveyed::Surveyed;
use crate::settings::Settings;
use crate::storage::remote::{Meta, is_remote, known};
use crate::storage::work::Difference;
use crate::storage::work::WorkFolder;
use crate::system::FileAt;

/// Places of a file whose content is looked at, and bytes at each.
const PLACES: u64 = 64;
const LOOKED_AT: u64 = 4 << 10;

/// Bytes of the program that are read at a time.
const PIECE: usize = 64 << 10;

/// Says in the work folder what this run makes, or compares with what an earlier one has said.
///
/// # Errors
/// [`Error::Changed`] with the input that has changed since; [`Error::Usage`] if something else differs; [`Error::Io`].
pub(super) fn begin(
    work: &WorkFolder,
    files: &[PathBuf],
    cloud: &Cloud,
    input: &InputOptions,
    (settings, surveyed): (&Settings, &Surveyed),
) -> Result<()> {
    let job = json!({
        "program": program(),
        "settings": of_settings(settings, input),
        "inputs": of_files(files)?,
        "attributes": format!("{:?}", cloud.schema()),
        "grid": of_grid(surveyed),
        "tasks": Value::Null,
    });
    begun(work, &job)
}

/// Says in a folder of tasks what they make, whose inputs and grid stand in their plan, or compares with what was said.
///
/// # Errors
/// [`Error::Usage`] if something differs; [`Error::Io`].
pub(super) fn begin_tasks(work: &WorkFolder, settings: &Settings, input: &InputOptions, tasks: &Value) -> Result<()> {
    begun(work, &json!({ "program": program(), "settings": of_settings(settings, input), "tasks": tasks }))
}

fn begun(work: &WorkFolder, job: &Value) -> Result<()> {
    let Some(Difference { at, there, here }) = work.begin(job)? else { return Ok(()) };
    // Inputs first: a changed input changes the grid, too.
    if let Some(changed) = changed(work, &at, (&there, &here)) {
        return Err(changed);
    }
    let folder = work.path().display();
    let is_of_tasks = !work.job()?.unwrap_or_default()["tasks"].is_null();
    if is_of_tasks == job["tasks"].is_null() {
        return Err(Error::Usage(match is_of_tasks {
            true => format!(
                "{folder}: holds tasks, which `asra-stream work {folder}` does; choose another `work` for a run by itself"
            ),
            false => format!("{folder}: holds a run by itself; choose another `work` for tasks"),
        }));
    }
    Err(Error::Usage(format!(
        "{folder}: holds another run: its `{at}` is {there}, and this run's is {here}; give the command that began it, or another `work`"
    )))
}

/// An input that has changed, if that is the difference.
fn changed(work: &WorkFolder, at: &str, (there, here): (&str, &str)) -> Option<Error> {
    let (path, what) = at.strip_prefix("inputs.")?.rsplit_once('.')?;
    Some(Error::Changed {
        path: PathBuf::from(path),
        expected: format!("what the run in {} began with, of {what} {there}", work.path().display()),
        found: format!("{what} {here}"),
    })
}

/// Compares this program, and files of the input, with what was written down when tasks were planned.
///
/// # Errors
/// [`Error::Changed`] with an input that has changed; [`Error::Usage`] if another program planned the tasks; [`Error::Io`].
pub(super) fn compare<'a>(work: &WorkFolder, files: impl IntoIterator<Item = (&'a PathBuf, &'a Value)>) -> Result<()> {
    let job = work.job()?.unwrap_or_default();
    let (there, here) = (&job["program"], program());
    if *there != here {
        return Err(Error::Usage(format!(
            "{}: the tasks were planned by another program: by {there}, and this is {here}; all processes need the same",
            work.path().display()
        )));
    }
    for (path, there) in files {
        let here = of_file(path)?;
        let mut parts = here.as_object().into_iter().flatten();
        if let Some((what, here)) = parts.find(|(what, here)| there[what] != **here) {
            let folder = work.path().display();
            let expected = format!(
                "the file for which the tasks in {folder} were planned; the same `asra-stream plan` plans anew what has changed"
            );
            let found = match what.as_str() {
                "bytes" => format!("one of {here} bytes"),
                "changed" => "one that was written to since".to_owned(),
                _ => "other content".to_owned(),
            };
            return Err(Error::Changed { path: path.clone(), expected, found });
        }
    }
    Ok(())
}

/// What tells one state of the inputs from another, by their names.
fn of_files(files: &[PathBuf]) -> Result<Value> {
    let mut inputs = Map::new();
    for file in files {
        inputs.insert(file.canonicalize().unwrap_or_else(|_| file.clone()).display().to_string(), of_file(file)?);
    }
    Ok(Value::Object(inputs))
}

/// What tells one state of a surveyed cloud's grid, and of what its points are on it, from another, whatever the number of points.
pub(super) fn of_basis(cloud: &Cloud, surveyed: &Surveyed) -> Value {
    let mut grid = of_grid(surveyed);
    if let Some(grid) = grid.as_object_mut() {
        let _ = (grid.remove("points"), grid.remove("records"));
    }
    json!({
        "grid": grid,
        "open": format!("{:?}", surveyed.open),
        "attributes": format!("{:?}", cloud.schema()),
        "precision": cloud.precision(),
    })
}

/// The program: a later version may place vertices otherwise. Its file is read once.
fn program() -> Value {
    static PROGRAM: OnceLock<Value> = OnceLock::new();
    PROGRAM.get_or_init(read_program).clone()
}

fn read_program() -> Value {
    let checksum = || -> io::Result<u32> {
        let mut file = File::open(std::env::current_exe()?)?;
        let (mut hasher, mut piece) = (crc32fast::Hasher::new(), vec![0; PIECE]);
        loop {
            match file.read(&mut piece)? {
                0 => return Ok(hasher.finalize()),
                bytes => hasher.update(&piece[..bytes]),
            }
        }
    };
    json!({ "version": env!("CARGO_PKG_VERSION"), "build": format!("{:08x}", checksum().unwrap_or(0)) })
}

/// Every setting, in words that tell any two values apart.
fn of_settings(settings: &Settings, input: &InputOptions) -> Value {
    let Settings {
        fineness,
        axis,
        seal,
        window,
        keep_outliers,
        upsample,
        min_points,
        min_component,
        surface,
        open,
        bridged,
        trim,
        simplify,
        classes,
    } = settings;
    let InputOptions { layout, skip_bytes, endian, attributes, looked_at: _, filter, crs, depth: _, seen_from } = input;
    json!({
        "fineness": format!("{fineness:?}"),
        "axis": format!("{axis:?}"),
        "seal": format!("{seal:?}"),
        "window": window,
        "keep_outliers": keep_outliers,
        "upsample": upsample,
        "min_points": min_points,
        "min_component": format!("{min_component:?}"),
        "surface": format!("{surface:?}"),
        "open": format!("{open:?}"),
        "bridged": bridged,
        "trim": format!("{trim:?}"),
        "simplify": format!("{simplify:?}"),
        "classes": format!("{classes:?}"),
        "layout": format!("{layout:?}"),
        "skip_bytes": skip_bytes,
        "endian": format!("{endian:?}"),
        "attributes": format!("{attributes:?}"),
        "filter": format!("{filter:?}"),
        "crs": format!("{crs:?}"),
        "seen_from": format!("{seen_from:?}"),
    })
}

/// The survey's counts and the grid; numbers as bits, since C libraries may differ in the last place.
fn of_grid(surveyed: &Surveyed) -> Value {
    let Surveyed { survey, grid, .. } = surveyed;
    let bits = |number: f64| format!("{:016x}", number.to_bits());
    let (low, cells) = grid.file_box();
    json!({
        "points": survey.points,
        "records": survey.records(),
        "cells": grid.cells(),
        "in_file_axes": cells,
        "axis": format!("{:?}", grid.axis()),
        "side": bits(grid.cell_size()),
        "low": low.map(bits),
        "added": surveyed.added().map(|added| format!("{:08x} {}", added.checksum(), surveyed.may_reopen())),
        "gaps": format!("{:08x}", crc32fast::hash(format!("{:?}", grid.gaps()).as_bytes())),
    })
}

/// What tells one state of a file from another: its length, when it was changed, and a sample of its content; of an object, what its store tells its states apart by.
pub(super) fn of_file(path: &Path) -> Result<Value> {
    if is_remote(path) {
        let Meta { bytes, changed, tag } = known(path)?;
        // Not all requests tell times alike.
        let changed = if tag.is_none() { Some(changed) } else { None };
        return Ok(json!({ "bytes": bytes, "changed": changed, "sample": tag }));
    }
    let there = path.metadata().map_err(Error::io(path, "read"))?;
    let file = File::open(path).map_err(Error::io(path, "open"))?;
    let length = there.len();
    let mut hasher = crc32fast::Hasher::new();
    let mut piece = vec![0; LOOKED_AT.min(length) as usize];
    // Evenly from the first to the last.
    let most = length - piece.len() as u64;
    for place in 0..PLACES {
        let at = (u128::from(most) * u128::from(place) / u128::from(PLACES - 1)) as u64;
        file.read_exact_at(&mut piece, at).map_err(Error::io(path, "read"))?;
        hasher.update(&piece);
    }
    let changed = there.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    let changed = changed.map(|since| format!("{}.{:09}", since.as_secs(), since.subsec_nanos()));
    Ok(json!({ "bytes": length, "changed": changed, "sample": format!("{:08x}", hasher.finalize()) }))
}
