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
    tasks: Value,
) -> Result<()> {
    let inputs = of_files(files)?;
    let job = json!({
        "program": program(),
        "settings": of_settings(settings, input),
        "inputs": inputs,
        "attributes": format!("{:?}", cloud.schema()),
        "grid": of_grid(surveyed),
        "tasks": tasks,
    });
    let Some(Difference { at, there, here }) = work.begin(&job)? else { return Ok(()) };
    // Inputs first: a changed input changes the grid, too.
    if let Some(changed) = changed(work, &at, (&there, &here)) {
        return Err(changed);
    }
    if at.starts_with("tasks") && (there == "null") != (here == "null") {
        return Err(Error::Usage(match here.as_str() {
            "null" => format!(
                "{0}: holds tasks, which `asra-stream work {0}` does; choose another `work` for a run by itself",
                work.path().display()
            ),
            _ => format!("{}: holds a run by itself; choose another `work` for tasks", work.path().display()),
        }));
    }
    Err(Error::Usage(format!(
        "{}: holds another run: its `{at}` is {there}, and this run's is {here}; give the command that began it, or another `work`",
        work.path().display()
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

/// Compares this program, and files of the input, with what is written down in the folder of tasks.
///
/// # Errors
/// [`Error::Changed`] with an input that has changed; [`Error::Usage`] if another program planned the tasks; [`Error::Io`].
pub(super) fn compare(work: &WorkFolder, files: &[PathBuf]) -> Result<()> {
    let job = work.job()?.unwrap_or_default();
    let Value::Object(inputs) = of_files(files)? else { unreachable!("files are told by their names") };
    for (path, here) in inputs {
        let there = &job["inputs"][&path];
        for (what, here) in here.as_object().into_iter().flatten() {
            let there = &there[what];
            if there != here {
                let (there, here) = (there.to_string(), here.to_string());
                return Err(changed(work, &format!("inputs.{path}.{what}"), (&there, &here))
                    .unwrap_or_else(|| Error::Internal("an input without a name".into())));
            }
        }
    }
    let (there, here) = (&job["program"], program());
    if *there != here {
        return Err(Error::Usage(format!(
            "{}: the tasks were planned by another program: by {there}, and this is {here}; all processes need the same",
            work.path().display()
        )));
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
        "gaps": format!("{:08x}", crc32fast::hash(format!("{:?}", grid.gaps()).as_bytes())),
    })
}

/// What tells one state of a file from another: its length, when it was changed, and a sample of its content.
fn of_file(path: &Path) -> Result<Value> {
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
