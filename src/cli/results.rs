//! Where results go: JSON to files and to standard output, text to standard output.

use std::io::Write;
use std::path::Path;

use crate::error::{Error, Result};
use crate::storage::atomic_file::AtomicFile;

/// The report's file, created before the work.
pub fn json_file(path: Option<&Path>) -> Result<Option<AtomicFile>> {
    path.map(AtomicFile::report).transpose()
}

/// Writes a report, and gives it its name.
pub fn write_json(file: AtomicFile, report: &impl serde::Serialize) -> Result<()> {
    let path = file.path().to_path_buf();
    let write = || -> std::io::Result<()> {
        let mut out = file.file();
        serde_json::to_writer_pretty(&mut out, report)?;
        writeln!(out)
    };
    write().map_err(Error::io(path, "write the report"))?;
    file.finish()
}

/// A value as JSON, to standard output.
pub fn print_json(value: &impl serde::Serialize) -> Result<()> {
    let failed = |e: serde_json::Error| Error::io("standard output", "write")(e.into());
    print_text(&serde_json::to_string_pretty(value).map_err(failed)?)
}

/// To standard output; a reader that has gone away is no failure.
pub fn print_text(text: &str) -> Result<()> {
    match writeln!(std::io::stdout(), "{text}") {
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        result => result.map_err(Error::io("standard output", "write")),
    }
}
