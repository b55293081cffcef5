//! The generated file: three formats, a temporary name until it is complete.

use std::io::Write;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::{Options, Overwrite};
use crate::error::{Error, Result};
use crate::input::{Scalar, Sidecar};
use crate::points::Precision;

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

/// A file in the making. Dropping it before [`Target::finish`] removes what was written.
pub struct Target {
    file: NamedTempFile,
    path: PathBuf,
    bytes: u64,
}

impl Target {
    /// Creates the temporary file beside the target and writes its header.
    ///
    /// # Errors
    /// [`Error::OutputExists`]; [`Error::Io`] if the folder cannot be written to; [`Error::Usage`] for the extension.
    pub fn create(options: &Options) -> Result<Target> {
        let kind = FileKind::of(&options.path)?;
        if options.overwrite == Overwrite::Refuse {
            let sidecar = (kind == FileKind::Raw).then(|| Sidecar::path_for(&options.path));
            if let Some(there) = std::iter::once(options.path.clone()).chain(sidecar).find(|path| path.exists()) {
                return Err(Error::OutputExists(there));
            }
        }
        let mut target = Target { file: temporary(&options.path)?, path: options.path.clone(), bytes: 0 };
        target.append(kind.header(options).as_bytes())?;
        Ok(target)
    }

    /// Adds `bytes` at the end.
    ///
    /// # Errors
    /// [`Error::Io`], for example if the disk is full.
    pub fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).map_err(Error::io(&self.path, "write the points"))?;
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    /// Gives the file its name; the length, and the side-car of a raw file, which is there before the file is.
    ///
    /// # Errors
    /// [`Error::OutputExists`] if a file of that name appeared meanwhile; [`Error::Io`].
    pub fn finish(self, options: &Options) -> Result<(u64, Option<PathBuf>)> {
        let mut sidecar = None;
        if FileKind::of(&self.path)? == FileKind::Raw {
            let scalar = match options.precision() {
                Precision::Single => Scalar::F32,
                Precision::Double => Scalar::F64,
            };
            let path = Sidecar::path_for(&self.path);
            let mut file = temporary(&path)?;
            writeln!(file, "{}", Sidecar::describing(scalar, options.points)).map_err(Error::io(&path, "write"))?;
            name(file, &path, options.overwrite)?;
            sidecar = Some(path);
        }
        name(self.file, &self.path, options.overwrite)?;
        Ok((self.bytes, sidecar))
    }
}

fn temporary(path: &Path) -> Result<NamedTempFile> {
    use std::os::unix::fs::PermissionsExt;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // Temporary files are private by default; this one becomes an ordinary file, subject to the umask.
    tempfile::Builder::new()
        .permissions(std::fs::Permissions::from_mode(0o666))
        .prefix(".asra-stream-")
        .tempfile_in(folder)
        .map_err(Error::io(path, "create a file beside"))
}

fn name(file: NamedTempFile, path: &Path, overwrite: Overwrite) -> Result<()> {
    let named = match overwrite {
        Overwrite::Replace => file.persist(path),
        Overwrite::Refuse => file.persist_noclobber(path),
    };
    named.map(drop).map_err(|e| match e.error.kind() {
        std::io::ErrorKind::AlreadyExists => Error::OutputExists(path.to_path_buf()),
        _ => Error::io(path, "name the finished file")(e.error),
    })
}
