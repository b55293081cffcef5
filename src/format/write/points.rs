//! Files of points: three formats, a temporary name until they are complete.

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::format::ply::header_text::HeaderText;
use crate::format::sidecar::Sidecar;
use crate::points::Precision;
use crate::points::scalar::{Endian, Scalar};
use crate::storage::atomic_file::{AtomicFile, Overwrite};

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

    fn header(self, cloud: &Description) -> String {
        match self {
            FileKind::Ply => HeaderText {
                endian: Endian::Little,
                comments: vec![cloud.comment.clone()],
                vertices: cloud.points,
                precision: cloud.precision,
                attributes: Vec::new(),
                faces: None,
            }
            .to_string(),
            FileKind::Raw | FileKind::Text => String::new(),
        }
    }
}

/// What is going to be in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    /// How it came about, in a line.
    pub comment: String,
    /// Number of points.
    pub points: u64,
    /// The precision of the coordinates.
    pub precision: Precision,
}

/// A cloud's file in the making.
#[derive(Debug)]
pub struct CloudTarget {
    file: AtomicFile,
    kind: FileKind,
    cloud: Description,
    overwrite: Overwrite,
    bytes: u64,
}

impl CloudTarget {
    /// Creates the temporary file beside the target and writes its header.
    ///
    /// # Errors
    /// [`Error::OutputExists`]; [`Error::Io`] if the folder cannot be written to; [`Error::Usage`] for the extension.
    pub fn create(path: &Path, cloud: Description, overwrite: Overwrite) -> Result<CloudTarget> {
        let kind = FileKind::of(path)?;
        let sidecar = Sidecar::path_for(path);
        if kind == FileKind::Raw && overwrite == Overwrite::Refuse && sidecar.exists() {
            return Err(Error::OutputExists(sidecar));
        }
        let header = kind.header(&cloud);
        let file = AtomicFile::create(path, overwrite)?;
        let mut target = CloudTarget { file, kind, cloud, overwrite, bytes: 0 };
        target.append(header.as_bytes())?;
        Ok(target)
    }

    /// Its format.
    pub fn kind(&self) -> FileKind {
        self.kind
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
    pub fn finish(self) -> Result<(u64, Option<PathBuf>)> {
        let mut sidecar = None;
        if self.kind == FileKind::Raw {
            let path = Sidecar::path_for(self.file.path());
            let file = AtomicFile::create(&path, self.overwrite)?;
            writeln!(file.file(), "{}", Sidecar::describing(Scalar::of(self.cloud.precision), self.cloud.points))
                .map_err(Error::io(&path, "write"))?;
            file.finish()?;
            sidecar = Some(path);
        }
        self.file.finish()?;
        Ok((self.bytes, sidecar))
    }
}
