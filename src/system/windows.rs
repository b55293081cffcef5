//! Windows: the portable way of everything that `unix` does, as far as there is one.
#![allow(unsafe_code)]

use std::convert::Infallible;
use std::ffi::OsStr;
use std::fs::{File, FileType, Metadata, OpenOptions};
use std::io::{self, Read};
use std::ops::Deref;
use std::os::windows::ffi::OsStrExt;
use std::os::windows::fs::{FileExt, OpenOptionsExt};
use std::os::windows::io::AsRawHandle;
use std::path::Path;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError};
use tempfile::Builder;
use windows_sys::Win32::Foundation::{
    ERROR_CANT_RESOLVE_FILENAME, ERROR_LOCK_VIOLATION, ERROR_READ_FAULT, ERROR_TOO_MANY_OPEN_FILES, HANDLE,
};
use windows_sys::Win32::Storage::FileSystem::{
    BY_HANDLE_FILE_INFORMATION, FILE_FLAG_BACKUP_SEMANTICS, FILE_FLAG_OPEN_REPARSE_POINT, GetDiskFreeSpaceExW,
    GetFileInformationByHandle, LOCKFILE_EXCLUSIVE_LOCK, LOCKFILE_FAIL_IMMEDIATELY, LockFileEx, MoveFileExW,
};
use windows_sys::Win32::System::ProcessStatus::{K32GetProcessMemoryInfo, PROCESS_MEMORY_COUNTERS};
use windows_sys::Win32::System::SystemInformation::{GlobalMemoryStatusEx, MEMORYSTATUSEX};
use windows_sys::Win32::System::Threading::GetCurrentProcess;

use super::answers::{Lock, Naming, Space};

/// Reading and writing at places. The file's own place moves with every call: whoever reads at places reads nothing in order.
pub trait FileAt {
    fn read_at(&self, out: &mut [u8], at: u64) -> io::Result<usize>;
    fn read_exact_at(&self, out: &mut [u8], at: u64) -> io::Result<()>;
    fn write_all_at(&self, bytes: &[u8], at: u64) -> io::Result<()>;
}

impl FileAt for File {
    fn read_at(&self, out: &mut [u8], at: u64) -> io::Result<usize> {
        self.seek_read(out, at)
    }

    fn read_exact_at(&self, mut out: &mut [u8], mut at: u64) -> io::Result<()> {
        while !out.is_empty() {
            match self.read_at(out, at) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(bytes) => (out, at) = (&mut out[bytes..], at + bytes as u64),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    fn write_all_at(&self, mut bytes: &[u8], mut at: u64) -> io::Result<()> {
        while !bytes.is_empty() {
            match self.seek_write(bytes, at) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(written) => (bytes, at) = (&bytes[written..], at + written as u64),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

/// What the system says when the process has too many open files.
pub const TOO_MANY_FILES: [i32; 1] = [ERROR_TOO_MANY_OPEN_FILES as i32];

/// What it says when links lead in a circle.
pub const LINKS_IN_A_CIRCLE: i32 = ERROR_CANT_RESOLVE_FILENAME as i32;

/// The signals that end a run, as the C library numbers them: that of Ctrl-C, and of the end of the process.
pub const ENDING: [i32; 2] = [2, 15];

/// There is no signal of files that grow too long.
pub const WRITTEN_TOO_FAR: [i32; 0] = [];

/// What it says when a disk cannot be read.
pub fn unreadable() -> io::Error {
    io::Error::from_raw_os_error(ERROR_READ_FAULT as i32)
}

/// A name as the system takes it.
fn wide(name: &OsStr) -> Vec<u16> {
    name.encode_wide().chain([0]).collect()
}

/// The space in a folder's file system.
pub fn space(folder: &Path) -> io::Result<Space> {
    let folder = wide(folder.canonicalize()?.as_os_str());
    let (mut available, mut capacity) = (0, 0);
    // SAFETY: the name ends with a zero, and both numbers live as long as the call.
    let done = unsafe { GetDiskFreeSpaceExW(folder.as_ptr(), &mut available, &mut capacity, std::ptr::null_mut()) };
    if done == 0 { Err(io::Error::last_os_error()) } else { Ok(Space { available, capacity }) }
}

/// Nothing: what is going to be read is read when it is.
pub fn will_need(_: &File, _: u64, _: u64) {}

/// The machine's memory, in bytes.
pub fn physical_memory() -> u64 {
    // SAFETY: the structure is plain numbers, for which zero is a value; it says how long it is, and the system fills it.
    unsafe {
        let mut status: MEMORYSTATUSEX = std::mem::zeroed();
        status.dwLength = size_of::<MEMORYSTATUSEX>() as u32;
        GlobalMemoryStatusEx(&mut status);
        status.ullTotalPhys
    }
}

/// The most memory of the process that was resident at a time, in bytes.
pub fn peak_resident() -> Option<u64> {
    let length = size_of::<PROCESS_MEMORY_COUNTERS>() as u32;
    // SAFETY: the structure is plain numbers, for which zero is a value; its length is told, and the system fills it.
    unsafe {
        let mut counters: PROCESS_MEMORY_COUNTERS = std::mem::zeroed();
        (K32GetProcessMemoryInfo(GetCurrentProcess(), &mut counters, length) != 0)
            .then_some(counters.PeakWorkingSetSize as u64)
    }
}

/// What tells a file from all others: the same for all its names.
pub fn file_number(path: &Path, _: &Metadata) -> Option<(u64, u64)> {
    let file = OpenOptions::new().access_mode(0).custom_flags(FILE_FLAG_BACKUP_SEMANTICS).open(path).ok()?;
    // SAFETY: the handle is that of a file that is open, and the structure plain numbers, for which zero is a value.
    let found = unsafe {
        let mut found: BY_HANDLE_FILE_INFORMATION = std::mem::zeroed();
        (GetFileInformationByHandle(file.as_raw_handle() as HANDLE, &mut found) != 0).then_some(found)?
    };
    let number = u64::from(found.nFileIndexHigh) << 32 | u64::from(found.nFileIndexLow);
    Some((u64::from(found.dwVolumeSerialNumber), number))
}

/// A name that is open cannot go.
pub fn has_a_name(_: &File) -> bool {
    true
}

/// No file of a folder is one.
pub fn is_pipe_or_device(_: FileType) -> bool {
    false
}

/// Opens a file for writing.
pub fn open_pipe(path: &Path) -> io::Result<File> {
    File::options().write(true).open(path)
}

/// Nothing: what is new gets the permissions of its folder.
pub fn with_usual_permissions(_: &mut Builder<'_, '_>, _: bool) {}

/// Opens a folder.
pub fn open_folder(path: &Path) -> io::Result<File> {
    OpenOptions::new().read(true).custom_flags(FILE_FLAG_BACKUP_SEMANTICS).open(path)
}

/// Opens what a process may have left behind, to lock it; follows no link.
pub fn open_leftover(path: &Path, folder: bool) -> io::Result<File> {
    let flags = FILE_FLAG_BACKUP_SEMANTICS | FILE_FLAG_OPEN_REPARSE_POINT;
    OpenOptions::new().read(true).write(!folder).custom_flags(flags).open(path)
}

/// Locks a file for as long as it is open: a byte far behind its end, since what is locked cannot be read by others. There are no locks of folders.
pub fn lock(file: &File) -> Lock {
    // SAFETY: the handle is that of an open file, and the structure plain numbers, for which zero is a value.
    let done = unsafe {
        let mut place: windows_sys::Win32::System::IO::OVERLAPPED = std::mem::zeroed();
        place.Anonymous.Anonymous.OffsetHigh = 0x7fff_ffff;
        let how = LOCKFILE_EXCLUSIVE_LOCK | LOCKFILE_FAIL_IMMEDIATELY;
        LockFileEx(file.as_raw_handle() as HANDLE, how, 0, 1, 0, &mut place)
    };
    match done {
        0 if io::Error::last_os_error().raw_os_error() == Some(ERROR_LOCK_VIOLATION as i32) => Lock::Taken,
        0 => Lock::Unknown,
        _ => Lock::Held,
    }
}

/// There are none.
pub fn nameless(_: &Path) -> Option<File> {
    None
}

/// There are no files without names.
pub fn link(_: &File, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Names do not change places at once.
///
/// # Errors
/// [`io::ErrorKind::Unsupported`].
pub fn exchange(_: &Path, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Gives a file or a folder a name that nothing has yet.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`].
pub fn rename_new(old: &Path, new: &Path) -> io::Result<()> {
    // Some versions say of a folder that access is denied.
    if new.symlink_metadata().is_ok() {
        return Err(io::ErrorKind::AlreadyExists.into());
    }
    let (old, new) = (wide(old.as_os_str()), wide(new.as_os_str()));
    // SAFETY: both names end with a zero, and live as long as the call.
    match unsafe { MoveFileExW(old.as_ptr(), new.as_ptr(), 0) } {
        0 => Err(io::Error::last_os_error()),
        _ => Ok(()),
    }
}

/// Brings the names in a folder to the disk: the system does so by itself.
pub fn sync_names(_: &Path) -> io::Result<()> {
    Ok(())
}

/// Brings all that a folder holds to the disk.
pub fn sync_all_of(_: &File, path: &Path) -> io::Result<()> {
    for entry in std::fs::read_dir(path)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            sync_all_of(&open_folder(&entry.path())?, &entry.path())?;
        } else {
            // Only who may write may say so.
            OpenOptions::new().write(true).open(entry.path())?.sync_all()?;
        }
    }
    Ok(())
}

/// Standard input, read by a thread of its own: reading cannot be told to wait for only so long.
pub struct StandardInput {
    pieces: Receiver<io::Result<Vec<u8>>>,
    /// What came and has not been asked for yet.
    rest: Vec<u8>,
}

impl StandardInput {
    pub fn new() -> StandardInput {
        let (sender, pieces) = crossbeam_channel::bounded(1);
        // It ends with the input, or with the process.
        std::thread::spawn(move || {
            let mut input = io::stdin().lock();
            loop {
                let mut piece = vec![0; 64 << 10];
                let read = input.read(&mut piece).map(|bytes| {
                    piece.truncate(bytes);
                    piece
                });
                let over = !matches!(&read, Ok(piece) if !piece.is_empty());
                if sender.send(read).is_err() || over {
                    return;
                }
            }
        });
        StandardInput { pieces, rest: Vec::new() }
    }

    /// Reads what there is; None if nothing came for a tenth of a second, no bytes at the end.
    pub fn read(&mut self, piece: &mut [u8]) -> io::Result<Option<usize>> {
        if self.rest.is_empty() {
            match self.pieces.recv_timeout(Duration::from_millis(100)) {
                Ok(read) => self.rest = read?,
                Err(RecvTimeoutError::Timeout) => return Ok(None),
                Err(RecvTimeoutError::Disconnected) => return Ok(Some(0)),
            }
        }
        let bytes = self.rest.len().min(piece.len());
        piece[..bytes].copy_from_slice(&self.rest[..bytes]);
        self.rest.drain(..bytes);
        Ok(Some(bytes))
    }
}

/// There is none: a file that is mapped could be neither replaced nor shortened by others.
pub struct Map(Infallible);

impl Deref for Map {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self.0 {}
    }
}

impl std::fmt::Debug for Map {
    fn fmt(&self, _: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {}
    }
}

/// Nothing: files are read.
pub fn map(_: &File, _: u64, _: usize) -> Option<Map> {
    None
}

/// Nothing.
pub fn give_back(map: &Map, _: usize, _: usize) {
    match map.0 {}
}

/// Maps that are watched for pages that are lost. There are none.
pub mod bus {
    use std::convert::Infallible;
    use std::path::Path;

    /// A map that is watched.
    #[derive(Debug)]
    pub struct Watched(Infallible);

    /// There is no map.
    pub fn watch(_: &Path, _: &[u8]) -> Option<Watched> {
        None
    }

    /// No page is lost, as there is no map.
    pub fn lost(_: &Path) -> bool {
        false
    }
}

/// What is in a folder, and how one is removed.
pub mod folder {
    use std::io;
    use std::path::Path;

    use super::super::answers::{Entry, EntryKind};

    /// What is in a folder, in the system's order.
    #[expect(clippy::disallowed_methods, reason = "closing a folder does not fail here")]
    pub fn entries(folder: &Path) -> io::Result<Vec<Entry>> {
        let entry = |entry: io::Result<std::fs::DirEntry>| {
            let entry = entry?;
            let kind = match entry.file_type()? {
                kind if kind.is_file() => EntryKind::File,
                kind if kind.is_dir() => EntryKind::Folder,
                _ => EntryKind::Other,
            };
            Ok(Entry { name: entry.file_name(), kind })
        };
        std::fs::read_dir(folder)?.map(entry).collect()
    }

    /// Removes a folder and what it holds.
    #[expect(clippy::disallowed_methods, reason = "closing a folder does not fail here")]
    pub fn remove(folder: &Path) -> io::Result<()> {
        std::fs::remove_dir_all(folder)
    }
}

/// There is no handler of signals that could write a file.
#[derive(Debug)]
pub struct LastWords;

impl LastWords {
    /// Nothing.
    pub fn new(_: &File, _: Option<&Path>, _: std::path::PathBuf, _: &Path, _: Naming) -> io::Result<LastWords> {
        Ok(LastWords)
    }
}

/// A stack that is used up ends the process, as the system has it.
pub mod stack {
    use super::super::answers::Farewell;

    /// Nothing is written to a report.
    pub struct Reported;

    impl Reported {
        /// There is nobody who could.
        pub fn to(_: super::LastWords) -> Reported {
            Reported
        }
    }

    /// Does some work.
    pub fn ending<R>(_: &Farewell, work: impl FnOnce() -> R) -> R {
        work()
    }
}
