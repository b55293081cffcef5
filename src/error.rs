//! One error type for the whole crate: every variant carries the numbers a user needs to act.
//!
//! Messages are lower case, without a full stop, and say what was expected, what was found, and what to do.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use bytesize::ByteSize;

/// The crate's result type.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that can go wrong between the command line and the finished mesh.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused a file operation.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file or folder concerned.
        path: PathBuf,
        /// What was attempted, as a verb phrase ("read", "create the mesh").
        action: &'static str,
        /// What the system answered.
        source: io::Error,
    },
    /// A file's content is not what its format promises.
    #[error("{}: {place}: expected {expected}, found {found}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where in the file: "header line 4", "vertex 18203", "byte 96".
        place: String,
        /// What the format asks for there.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// The file belongs to a format this program does not read.
    #[error("{}: this is {format}, which asra-stream does not read; {advice}", path.display())]
    ForeignFormat {
        /// The file.
        path: PathBuf,
        /// The format's name, with its article ("a CloudCompare project").
        format: &'static str,
        /// What the user can do.
        advice: &'static str,
    },
    /// A bare binary file fits several record layouts.
    #[error("{}: the record layout is ambiguous; name one with --layout\n{candidates}", path.display())]
    AmbiguousLayout {
        /// The file.
        path: PathBuf,
        /// The layouts that fit, each with a preview of its first points.
        candidates: Candidates,
    },
    /// The input holds no finite point.
    #[error("the input holds no points ({dropped} records dropped as not finite, {filtered} left out by filters)")]
    NoPoints {
        /// Records with a coordinate that is NaN or infinite.
        dropped: u64,
        /// Points that were not asked for.
        filtered: u64,
    },
    /// The arguments contradict each other or lie outside their range.
    #[error("{0}")]
    Usage(String),
    /// The output exists and `--overwrite` was not given.
    #[error("{}: exists already; pass --overwrite to replace it", .0.display())]
    OutputExists(PathBuf),
    /// The grid would have more cells along an axis than can be addressed.
    #[error("the raster would be {cells} cells long along {axis}, more than {limit}; {advice}")]
    Raster {
        /// Cells asked for.
        cells: f64,
        /// The axis of the file's coordinates: `x`, `y` or `z`.
        axis: char,
        /// The most that is supported.
        limit: u32,
        /// What the user can change.
        advice: &'static str,
    },
    /// The memory budget cannot hold the work.
    #[error("--max-memory {given}: {what} needs {needed}; pass --max-memory {}M or more", needed.0.div_ceil(1 << 20))]
    Budget {
        /// What was granted.
        given: ByteSize,
        /// The least that would do.
        needed: ByteSize,
        /// The stage that needs it.
        what: &'static str,
    },
    /// The work directory lacks room.
    #[error("{}: {available} free, the work needs up to {needed}; free some space or choose another --temp-dir", path.display())]
    Disk {
        /// The work directory.
        path: PathBuf,
        /// Free space found.
        available: ByteSize,
        /// What the plan asks for.
        needed: ByteSize,
    },
    /// The mesh has, or would have, more elements than an index of the format can name.
    #[error(
        "the mesh would have about {count} {what}, more than the {limit} that {carrier} can index; use larger cells (--k, --slices or --cell-size)"
    )]
    TooManyElements {
        /// Elements counted or predicted.
        count: u64,
        /// "vertices" or "triangles".
        what: &'static str,
        /// The most that can be carried.
        limit: u64,
        /// What carries the index: "a PLY file", "a slab".
        carrier: &'static str,
    },
    /// The finished mesh is not a closed, oriented 2-manifold: a defect of this program.
    #[error("the mesh failed its own check ({0}); nothing was written. Please report this, with the input if you can")]
    CheckFailed(String),
    /// Ctrl-C or a termination signal.
    #[error("interrupted; temporary files are removed, no output was written")]
    Interrupted,
}

/// The layouts that fit an ambiguous binary file.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidates(pub Vec<Candidate>);

/// One layout that fits, with the first points it would give.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// The layout as `--layout` takes it.
    pub layout: String,
    /// The first points under this layout.
    pub preview: Vec<[f64; 3]>,
}

impl fmt::Display for Candidates {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, candidate) in self.0.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "  --layout {:<10}", candidate.layout)?;
            for [x, y, z] in &candidate.preview {
                write!(f, " ({x}, {y}, {z})")?;
            }
        }
        Ok(())
    }
}

impl Error {
    /// An [`Error::Io`] maker for `map_err`: `File::open(p).map_err(Error::io(p, "open"))`.
    pub fn io<P: AsRef<Path>>(path: P, action: &'static str) -> impl FnOnce(io::Error) -> Error + use<P> {
        let path = path.as_ref().to_path_buf();
        move |source| Error::Io { path, action, source }
    }

    /// An [`Error::Malformed`] from its parts.
    pub fn malformed(
        path: impl AsRef<Path>,
        place: impl fmt::Display,
        expected: impl fmt::Display,
        found: impl fmt::Display,
    ) -> Error {
        Error::Malformed {
            path: path.as_ref().to_path_buf(),
            place: place.to_string(),
            expected: expected.to_string(),
            found: found.to_string(),
        }
    }
}
