//! One error type for the whole crate: every variant carries the numbers a user needs to act.
//!
//! Messages are lower case, without a full stop, and say what was expected, what was found, and what to do. They name settings in backticks, as the library has
//! them; [`words::as_options`] makes the command's options of those.

pub mod defect;
pub mod overflow;
#[cfg(test)]
mod panics;
pub mod words;

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use bytesize::ByteSize;

use crate::system;

/// The crate's result type.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that can go wrong between the settings and the finished mesh.
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
    #[error("{}: the record layout is ambiguous; name one with `layout`\n{candidates}", path.display())]
    AmbiguousLayout {
        /// The file.
        path: PathBuf,
        /// The layouts that fit, each with a preview of its first points.
        candidates: Candidates,
    },
    /// An input did not stay as it was while it was read.
    #[error("{}: changed while it was read: expected {expected}, found {found}", path.display())]
    Changed {
        /// The file.
        path: PathBuf,
        /// What was there.
        expected: String,
        /// What is there now.
        found: String,
    },
    /// A [`crate::PointSource`] failed, or did not give the points that it was asked for.
    #[error("the points' source: {0}")]
    Source(Box<dyn std::error::Error + Send + Sync>),
    /// A folder or a pattern stands for no file.
    #[error("{}: {found}", path.display())]
    NoInput {
        /// The folder or the pattern.
        path: PathBuf,
        /// What is missing.
        found: &'static str,
    },
    /// The input holds no finite point.
    #[error("the input holds no points ({dropped} records dropped as not finite, {filtered} left out by filters)")]
    NoPoints {
        /// Records with a coordinate that is NaN or infinite.
        dropped: u64,
        /// Points that were not asked for.
        filtered: u64,
    },
    /// An open surface that has no triangle.
    #[error(
        "the points make no surface that is open: no square of cells is filled by them. A line, a wall seen from above or a few points have none; take `surface` closed, or `facing` where it can be seen from"
    )]
    NoSurface,
    /// A setting cannot have this value, or the value does not go with the input or with another setting.
    #[error("{message}")]
    InvalidSetting {
        /// The setting's name: that of the method of [`crate::Reconstruction`], or of the field, that sets it.
        name: &'static str,
        /// What is wrong, and what would do. Names of settings stand in backticks.
        message: String,
    },
    /// What is asked for is not possible, or contradicts itself.
    #[error("{0}")]
    Usage(String),
    /// The output exists and is not to be replaced ([`crate::Overwrite`]).
    #[error("{}: exists already; pass `overwrite` to replace it", .0.display())]
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
    #[error("`max_memory` {given}: {what} needs {needed}; pass `max_memory` {}M or more", needed.0.div_ceil(1 << 20))]
    Budget {
        /// What was granted.
        given: ByteSize,
        /// The least that would do.
        needed: ByteSize,
        /// The stage that needs it.
        what: &'static str,
    },
    /// The work directory lacks room.
    #[error("{}: {available} free, the work needs up to {needed}, {} more; free some space or choose another `temp_dir`", path.display(), ByteSize(needed.0.saturating_sub(available.0)))]
    Disk {
        /// The work directory.
        path: PathBuf,
        /// Free space found.
        available: ByteSize,
        /// What the plan asks for.
        needed: ByteSize,
        /// The size of the whole file system.
        capacity: ByteSize,
    },
    /// The mesh has, or would have, more elements than an index of the format can name.
    #[error(
        "the mesh would have about {count} {what}, more than the {limit} that {carrier} can index; use larger cells (`k`, `slices` or `cell_size`)"
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
    /// A panic: a defect of this program.
    #[error("internal error: {0}; nothing was written. Please report this, with the input if you can")]
    Internal(String),
    /// Ctrl-C or a termination signal.
    #[error("interrupted; temporary files are removed, no output was written")]
    Interrupted,
    /// The same, of a run with a work folder.
    #[error("interrupted; what is done lies in {}: the same command goes on from there", .0.display())]
    Suspended(PathBuf),
    /// Another run is at work in the work folder.
    #[error("{}: another run is at work there ({holder}); wait until it ends, or choose another `work`", path.display())]
    WorkTaken {
        /// The work folder.
        path: PathBuf,
        /// Who holds it, as it says itself.
        holder: String,
    },
    /// What a task needs is not there yet.
    #[error("{}: {task} needs {needed}, which is not done yet", path.display())]
    NotReady {
        /// The folder of tasks.
        path: PathBuf,
        /// The task.
        task: String,
        /// The task that comes before it.
        needed: String,
    },
    /// A file of the work folder is not what was written there.
    #[error("{}: is damaged: {found}; what depends on it is set aside: the same command makes it again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        found: String,
    },
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
            write!(f, "  `layout` {:<10}", candidate.layout)?;
            for [x, y, z] in &candidate.preview {
                write!(f, " ({x}, {y}, {z})")?;
            }
        }
        Ok(())
    }
}

/// What kind of end a command came to: what whoever started it can act on. Numbers are those of BSD's `sysexits` where that has one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Kind {
    /// No failure.
    Done,
    /// The arguments are wrong, or the output exists.
    Usage,
    /// `check` found what it looks for.
    Found,
    /// An input is damaged, or not what it says it is.
    Data,
    /// An input is missing or may not be read.
    NoInput,
    /// Something that another process has to make is not there yet.
    NotReady,
    /// A defect of this program.
    Internal,
    /// More memory or disk is needed than there is.
    CannotFit,
    /// The output may not be written there.
    NoOutput,
    /// The system said that reading or writing failed.
    Io,
    /// What was in the way may be gone next time.
    Temporary,
    /// A file of the work folder is damaged, and is going to be made again.
    Intermediate,
    /// A signal.
    Signal,
}

/// A row of the table of exit codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// The codes; of [`Kind::Signal`], 128 and the signal's number.
    pub codes: &'static [u8],
    /// The kind's name, as reports have it; a dash for none.
    pub name: &'static str,
    /// What it means.
    pub meaning: &'static str,
    /// Whether another try with the same arguments can succeed.
    pub again: &'static str,
}

impl Kind {
    /// All, by their codes.
    pub const ALL: [Kind; 13] = [
        Kind::Done,
        Kind::Usage,
        Kind::Found,
        Kind::Data,
        Kind::NoInput,
        Kind::NotReady,
        Kind::Internal,
        Kind::CannotFit,
        Kind::NoOutput,
        Kind::Io,
        Kind::Temporary,
        Kind::Intermediate,
        Kind::Signal,
    ];

    /// Its row in the table of exit codes, the only one there is.
    pub fn row(self) -> Row {
        let (codes, name, meaning, again): (&[u8], _, _, _) = match self {
            Kind::Done => (&[0], "–", "done; also when a reader closed our pipe", "–"),
            Kind::Usage => (&[2], "usage", "options, or the output exists", "no"),
            Kind::Found => (
                &[4],
                "found",
                "`check` found a mesh that is no closed, oriented 2-manifold (with `--open`: none with a boundary either), or intersects itself",
                "no",
            ),
            Kind::Data => (&[65], "data", "an input is damaged, or not what it says it is", "no"),
            Kind::NoInput => (&[66], "no-input", "an input is missing or may not be read", "no"),
            Kind::NotReady => (&[69], "not-ready", "something another process has to make is not there yet", "yes"),
            Kind::Internal => {
                (&[70], "internal", "a panic, or the mesh failed its own check; nothing was written", "no; a bug")
            }
            Kind::CannotFit => (
                &[71],
                "cannot-fit",
                "more memory or disk is needed than may be had, however often it is tried; the message has the figure and the way out",
                "with other options",
            ),
            Kind::NoOutput => (&[73], "no-output", "the output may not be written there", "no"),
            Kind::Io => (&[74], "io", "the system said that reading or writing failed", "perhaps"),
            Kind::Temporary => (
                &[75],
                "temporary",
                "the disk is full, there are too many files or processes, an input changed while it was read, or another run holds the work folder; with `--work` the run goes on where it was",
                "yes",
            ),
            Kind::Intermediate => (
                &[76],
                "intermediate",
                "a file in the work folder is damaged; its manifest is set aside, so that it is made again",
                "yes, three times",
            ),
            Kind::Signal => (&[129, 130, 143], "signal", "HUP, INT, TERM, with `--work` too", "yes"),
        };
        Row { codes, name, meaning, again }
    }

    /// The kind of an error of the system, in an attempt to read or to write.
    fn of_system(action: &str, source: &io::Error) -> Kind {
        use io::ErrorKind as E;
        let writing =
            ["create", "write", "name", "remove", "open the folder"].iter().any(|verb| action.starts_with(verb));
        if source.raw_os_error().is_some_and(|number| system::TOO_MANY_FILES.contains(&number)) {
            return Kind::Temporary;
        }
        match source.kind() {
            E::StorageFull | E::QuotaExceeded | E::WouldBlock | E::OutOfMemory | E::ResourceBusy | E::Interrupted => {
                Kind::Temporary
            }
            E::StaleNetworkFileHandle | E::TimedOut | E::ExecutableFileBusy => Kind::Temporary,
            E::FileTooLarge => Kind::CannotFit,
            E::InvalidData | E::UnexpectedEof if !writing => Kind::Data,
            E::NotFound
            | E::PermissionDenied
            | E::NotADirectory
            | E::IsADirectory
            | E::AlreadyExists
            | E::DirectoryNotEmpty
            | E::ReadOnlyFilesystem
            | E::InvalidFilename
            | E::InvalidInput
            | E::TooManyLinks
            | E::Unsupported => {
                if writing {
                    Kind::NoOutput
                } else {
                    Kind::NoInput
                }
            }
            _ if source.raw_os_error() == Some(system::LINKS_IN_A_CIRCLE) => {
                if writing {
                    Kind::NoOutput
                } else {
                    Kind::NoInput
                }
            }
            _ => Kind::Io,
        }
    }
}

/// A failure, as reports have it.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct Failure {
    /// The program's version.
    pub version: &'static str,
    /// What failed.
    pub error: FailureDetails,
}

/// What is known of a failure.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct FailureDetails {
    /// Its kind.
    pub kind: Kind,
    /// The command's exit code.
    pub code: u8,
    /// What standard error was told.
    pub message: String,
    /// The file or folder concerned.
    #[serde(serialize_with = "words::told_if_any")]
    pub path: Option<PathBuf>,
    /// Where in the file: a line, a vertex, a byte.
    pub place: Option<String>,
    /// Where in the file, in bytes.
    pub offset: Option<u64>,
    /// Bytes of memory or disk that would do.
    pub needed: Option<u64>,
    /// Bytes of memory that were granted, or of disk that are free.
    pub given: Option<u64>,
}

impl Error {
    /// What kind of failure this is.
    pub fn kind(&self) -> Kind {
        match self {
            Error::Io { action, source, .. } => Kind::of_system(action, source),
            Error::Malformed { .. } | Error::ForeignFormat { .. } | Error::NoPoints { .. } | Error::NoSurface => {
                Kind::Data
            }
            Error::NoInput { .. } => Kind::NoInput,
            Error::Source(_) => Kind::Data,
            Error::Changed { .. } | Error::WorkTaken { .. } => Kind::Temporary,
            Error::NotReady { .. } => Kind::NotReady,
            Error::Damaged { .. } => Kind::Intermediate,
            Error::AmbiguousLayout { .. } | Error::InvalidSetting { .. } | Error::Usage(_) | Error::OutputExists(_) => {
                Kind::Usage
            }
            Error::Raster { .. } | Error::Budget { .. } | Error::TooManyElements { .. } => Kind::CannotFit,
            // Other users may free some, but not more than there is.
            Error::Disk { needed, capacity, .. } if needed <= capacity => Kind::Temporary,
            Error::Disk { .. } => Kind::CannotFit,
            Error::CheckFailed(_) | Error::Internal(_) => Kind::Internal,
            Error::Interrupted | Error::Suspended(_) => Kind::Signal,
        }
    }

    /// The failure, for a report, of a command that ends with `code`.
    pub fn failure(&self, code: u8) -> Failure {
        let path = match self {
            Error::Io { path, .. }
            | Error::Malformed { path, .. }
            | Error::ForeignFormat { path, .. }
            | Error::AmbiguousLayout { path, .. }
            | Error::NoInput { path, .. }
            | Error::Changed { path, .. }
            | Error::Disk { path, .. }
            | Error::Damaged { path, .. }
            | Error::WorkTaken { path, .. }
            | Error::NotReady { path, .. }
            | Error::Suspended(path)
            | Error::OutputExists(path) => Some(path.clone()),
            _ => None,
        };
        let place = if let Error::Malformed { place, .. } = self { Some(place.clone()) } else { None };
        // "byte 96", "VLR 2 of 3, byte 375"; of what a compressed file holds, no byte of the file is known.
        let offset = place.as_deref().filter(|place| !place.starts_with("compressed"));
        let offset =
            offset.and_then(|place| place.rsplit_once("byte ").or(place.strip_prefix("byte ").map(|at| ("", at))));
        let offset = offset.and_then(|(_, at)| at.parse().ok());
        let (given, needed) = match self {
            Error::Budget { given, needed, .. } | Error::Disk { available: given, needed, .. } => {
                (Some(given.as_u64()), Some(needed.as_u64()))
            }
            _ => (None, None),
        };
        let message = self.to_string();
        let error = FailureDetails { kind: self.kind(), code, message, path, place, offset, needed, given };
        Failure { version: env!("CARGO_PKG_VERSION"), error }
    }

    /// An [`Error::Io`] maker for `map_err`: `File::open(p).map_err(Error::io(p, "open"))`.
    pub fn io<P: AsRef<Path>>(path: P, action: &'static str) -> impl FnOnce(io::Error) -> Error + use<P> {
        let path = path.as_ref().to_path_buf();
        move |source| Error::Io { path, action, source }
    }

    /// An [`Error::InvalidSetting`] from its parts; the message names settings in backticks.
    pub(crate) fn setting(name: &'static str, message: String) -> Error {
        Error::InvalidSetting { name, message }
    }

    /// An [`Error::Changed`] of a file that had `before` bytes at some time, and has `now`.
    pub fn length_changed(path: &Path, before: impl fmt::Display, now: u64) -> Error {
        Error::Changed { path: path.to_path_buf(), expected: before.to_string(), found: format!("{now} bytes") }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_report_names_a_file_whose_name_is_no_text() {
        use std::os::unix::ffi::OsStrExt;

        let path = Path::new(std::ffi::OsStr::from_bytes(b"a\xff.ply"));
        let failure = Error::io(path, "open")(io::ErrorKind::NotFound.into()).failure(66);
        assert_eq!(serde_json::to_value(failure).unwrap()["error"]["path"], "a\u{fffd}.ply");
    }

    #[test]
    fn the_table_has_every_kind_and_every_code_once() {
        let codes: Vec<u8> = Kind::ALL.iter().flat_map(|kind| kind.row().codes).copied().collect();
        assert_eq!(codes, [0, 2, 4, 65, 66, 69, 70, 71, 73, 74, 75, 76, 129, 130, 143]);
        for kind in &Kind::ALL[1..] {
            assert_eq!(serde_json::to_value(kind).unwrap(), kind.row().name);
        }
    }

    #[test]
    fn what_the_system_says_is_told_apart_by_what_was_attempted() {
        use rustix::io::Errno;
        let kind = |action, number: Errno| Error::io("f", action)(number.into()).kind();
        for (number, reading, writing) in [
            (Errno::NOENT, Kind::NoInput, Kind::NoOutput),
            (Errno::ACCESS, Kind::NoInput, Kind::NoOutput),
            (Errno::LOOP, Kind::NoInput, Kind::NoOutput),
            (Errno::ROFS, Kind::NoInput, Kind::NoOutput),
            (Errno::IO, Kind::Io, Kind::Io),
            (Errno::NOSPC, Kind::Temporary, Kind::Temporary),
            (Errno::DQUOT, Kind::Temporary, Kind::Temporary),
            (Errno::MFILE, Kind::Temporary, Kind::Temporary),
            (Errno::NFILE, Kind::Temporary, Kind::Temporary),
            (Errno::AGAIN, Kind::Temporary, Kind::Temporary),
            (Errno::NOMEM, Kind::Temporary, Kind::Temporary),
            (Errno::FBIG, Kind::CannotFit, Kind::CannotFit),
        ] {
            assert_eq!(kind("open", number), reading, "{number:?}");
            for action in ["create a file beside", "write the mesh", "name the finished file", "open the folder"] {
                assert_eq!(kind(action, number), writing, "{number:?} {action}");
            }
        }
    }

    #[test]
    fn a_disk_that_is_too_small_for_ever_is_no_full_one() {
        let kind = |needed| {
            let [available, needed, capacity] = [10, needed, 100].map(ByteSize);
            Error::Disk { path: "d".into(), available, needed, capacity }.kind()
        };
        assert_eq!((kind(100), kind(101)), (Kind::Temporary, Kind::CannotFit));
    }

    #[test]
    fn a_failure_tells_what_is_known() {
        let at = |place: &str| Error::malformed("a.las", place, "this", "that").failure(65).error;
        let one = at("VLR 2 of 3, byte 375");
        assert_eq!((one.kind, one.code, one.offset), (Kind::Data, 65, Some(375)));
        assert_eq!((one.path.unwrap(), one.place.unwrap()), ("a.las".into(), "VLR 2 of 3, byte 375".to_owned()));
        assert_eq!(
            (at("byte 96").offset, at("vertex 7").offset, at("compressed byte 7").offset),
            (Some(96), None, None)
        );
        let budget = Error::Budget { given: ByteSize(5), needed: ByteSize(7), what: "it" }.failure(71).error;
        assert_eq!((budget.given, budget.needed, budget.path), (Some(5), Some(7), None));
    }
}
