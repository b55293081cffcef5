//! The generated file: three formats, a temporary name until it is complete.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::Options;
use crate::error::{Error, Result};
use crate::input::Sidecar;
use crate::points::Precision;
use crate::scalar::Scalar;
use crate::whole::{Overwrite, WholeFile};

/// The formats that can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// Little-endian numbers and a side-car.
    Raw,
    /// Binary little-endian PLY.
    Ply,
    /// A line per point; every number reads back as the same `f32` or `f64`.
    Text,
}

impl FileKind {
    /// The kind the extension asks for.
    ///
    /// # Errors
    /// [`Error::Usage`] for any other extension.
    pub fn of(path: &Path) -> Result<FileKind> {
        match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("bin") => Ok(FileKind::Raw),
            Some("ply") => Ok(FileKind::Ply),
            Some("xyz" | "txt") => Ok(FileKind::Text),
            _ => Err(Error::Usage(format!("{}: expected a name with .bin, .ply, .xyz or .txt", path.display()))),
        }
    }

    /// Appends a point.
    pub fn encode(self, point: [f64; 3], precision: Precision, bytes: &mut Vec<u8>) {
        match (self, precision) {
            (FileKind::Text, Precision::Single) => {
                let [x, y, z] = point.map(|c| c as f32);
                writeln!(bytes, "{x} {y} {z}").expect("a vector takes everything");
            }
            (FileKind::Text, Precision::Double) => {
                let [x, y, z] = point;
                writeln!(bytes, "{x} {y} {z}").expect("a vector takes everything");
            }
            (_, Precision::Single) => point.iter().for_each(|&c| bytes.extend_from_slice(&(c as f32).to_le_bytes())),
            (_, Precision::Double) => point.iter().for_each(|&c| bytes.extend_from_slice(&c.to_le_bytes())),
        }
    }

    fn header(self, options: &Options) -> String {
        let kind = match options.precision() {
            Precision::Single => "float",
            Precision::Double => "double",
        };
        match self {
            FileKind::Ply => format!(
                "ply\nformat binary_little_endian 1.0\ncomment {} of size {}, seed {}\nelement vertex {}\n\
                 property {kind} x\nproperty {kind} y\nproperty {kind} z\nend_header\n",
                options.shape, options.size, options.seed, options.points
            ),
            FileKind::Raw | FileKind::Text => String::new(),
        }
    }
}

/// A cloud's file in the making.
pub struct Target {
    file: WholeFile,
    bytes: u64,
}

impl Target {
    /// Creates the temporary file beside the target and writes its header.
    ///
    /// # Errors
    /// [`Error::OutputExists`]; [`Error::Io`] if the folder cannot be written to; [`Error::Usage`] for the extension.
    pub fn create(options: &Options) -> Result<Target> {
        let kind = FileKind::of(&options.path)?;
        let sidecar = Sidecar::path_for(&options.path);
        if kind == FileKind::Raw && options.overwrite == Overwrite::Refuse && sidecar.exists() {
            return Err(Error::OutputExists(sidecar));
        }
        let mut target = Target { file: WholeFile::create(&options.path, options.overwrite)?, bytes: 0 };
        target.append(kind.header(options).as_bytes())?;
        Ok(target)
    }

    /// Adds `bytes` at the end.
    ///
    /// # Errors
    /// [`Error::Io`], for example if the disk is full.
    pub fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.file().write_all(bytes).map_err(Error::io(self.file.path(), "write the points"))?;
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    /// Gives the file its name; the length, and the side-car of a raw file, which is there before the file is.
    ///
    /// # Errors
    /// [`Error::OutputExists`] if a file of that name appeared meanwhile; [`Error::Io`].
    pub fn finish(self, options: &Options) -> Result<(u64, Option<PathBuf>)> {
        let mut sidecar = None;
        if FileKind::of(self.file.path())? == FileKind::Raw {
            let scalar = match options.precision() {
                Precision::Single => Scalar::F32,
                Precision::Double => Scalar::F64,
            };
            let path = Sidecar::path_for(self.file.path());
            let file = WholeFile::create(&path, options.overwrite)?;
            writeln!(file.file(), "{}", Sidecar::describing(scalar, options.points))
                .map_err(Error::io(&path, "write"))?;
            file.finish()?;
            sidecar = Some(path);
        }
        self.file.finish()?;
        Ok((self.bytes, sidecar))
    }
}
