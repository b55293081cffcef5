//! Linux, and what other Unix systems have in its place.
#![allow(unsafe_code)]

use std::fs::{File, FileType, Metadata, OpenOptions, Permissions};
use std::io::{self, Stdin};
use std::num::NonZeroU64;
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::Path;

use memmap2::{Advice, Mmap, MmapOptions, UncheckedAdvice};
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::{FlockOperation, OFlags};
use rustix::io::Errno;
use tempfile::Builder;

use super::answers::{Lock, Space};

/// Reading and writing at places, whatever the file's own place is.
pub use std::os::unix::fs::FileExt as FileAt;

/// What the system says when there are too many open files, in the process or in all.
pub const TOO_MANY_FILES: [i32; 2] = [Errno::MFILE.raw_os_error(), Errno::NFILE.raw_os_error()];

/// What it says when links lead in a circle.
pub const LINKS_IN_A_CIRCLE: i32 = Errno::LOOP.raw_os_error();

/// The signals that end a run.
pub const ENDING: [i32; 3] = [libc::SIGHUP, libc::SIGINT, libc::SIGTERM];

/// The signal of a file that is longer than a limit allows.
pub const WRITTEN_TOO_FAR: [i32; 1] = [libc::SIGXFSZ];

/// What it says when a disk cannot be read.
pub fn unreadable() -> io::Error {
    io::Error::from(Errno::IO)
}

/// The space in a folder's file system.
pub fn space(folder: &Path) -> io::Result<Space> {
    let stat = rustix::fs::statvfs(folder)?;
    Ok(Space { available: stat.f_bavail * stat.f_frsize, capacity: stat.f_blocks * stat.f_frsize })
}

/// Says that a part of a file is going to be read. Whether the system begins to fetch it or not, it can be read.
pub fn will_need(file: &File, at: u64, bytes: u64) {
    #[cfg(not(any(target_vendor = "apple", target_os = "netbsd", target_os = "openbsd")))]
    let _ = rustix::fs::fadvise(file, at, NonZeroU64::new(bytes), rustix::fs::Advice::WillNeed);
    #[cfg(target_vendor = "apple")]
    let _ = rustix::fs::fcntl_rdadvise(file, at, NonZeroU64::new(bytes).map_or(0, NonZeroU64::get));
    #[cfg(any(target_os = "netbsd", target_os = "openbsd"))]
    let _ = (file, at, NonZeroU64::new(bytes));
}

/// The machine's memory, in bytes.
pub fn physical_memory() -> u64 {
    // SAFETY: both ask for a number, and change nothing.
    let [pages, page] = unsafe { [libc::sysconf(libc::_SC_PHYS_PAGES), libc::sysconf(libc::_SC_PAGESIZE)] };
    u64::try_from(pages).unwrap_or(0) * u64::try_from(page).unwrap_or(0)
}

/// The most memory of the process that was resident at a time, in bytes. Pages of mapped input files count while they are
/// resident, although the system can take them back at any time.
#[cfg(any(target_os = "linux", target_os = "android"))]
pub fn peak_resident() -> Option<u64> {
    // What `getrusage` says begins with the peak of the process that started this one.
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes << 10)
}

/// The most memory of the process that was resident at a time, in bytes.
#[cfg(not(any(target_os = "linux", target_os = "android")))]
pub fn peak_resident() -> Option<u64> {
    // SAFETY: the structure is plain numbers, for which zero is a value, and the system fills it.
    let usage = unsafe {
        let mut usage: libc::rusage = std::mem::zeroed();
        (libc::getrusage(libc::RUSAGE_SELF, &mut usage) == 0).then_some(usage)?
    };
    let unit = if cfg!(target_vendor = "apple") { 1 } else { 1 << 10 };
    Some(u64::try_from(usage.ru_maxrss).ok()? * unit)
}

/// What tells a file from all others: the same for all its names.
pub fn file_number(_: &Path, there: &Metadata) -> Option<(u64, u64)> {
    Some((there.dev(), there.ino()))
}

/// Whether an open file still has a name. Where the system does not tell, it has, as far as anyone knows.
pub fn has_a_name(file: &File) -> bool {
    file.metadata().map_or(true, |there| there.nlink() > 0)
}

/// Whether it is written to as it is: a pipe or a device.
pub fn is_pipe_or_device(kind: FileType) -> bool {
    kind.is_fifo() || kind.is_char_device()
}

/// Opens a pipe or a device for writing. Opening does not wait for a reader; writing does.
pub fn open_pipe(path: &Path) -> io::Result<File> {
    let file = File::options().write(true).custom_flags(OFlags::NONBLOCK.bits() as i32).open(path)?;
    let set = rustix::fs::fcntl_getfl(&file)?;
    rustix::fs::fcntl_setfl(&file, set - OFlags::NONBLOCK)?;
    Ok(file)
}

/// The permissions that any new file or folder gets, in the place of those that temporary ones get.
pub fn with_usual_permissions(builder: &mut Builder<'_, '_>, folder: bool) {
    // Less the process's umask.
    builder.permissions(Permissions::from_mode(if folder { 0o777 } else { 0o666 }));
}

/// Opens a folder, to lock it.
pub fn open_folder(path: &Path) -> io::Result<File> {
    File::open(path)
}

/// Opens what a process may have left behind, to lock it; follows no link and waits for nobody.
pub fn open_leftover(path: &Path, folder: bool) -> io::Result<File> {
    let flags = (OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32;
    OpenOptions::new().read(true).write(!folder).custom_flags(flags).open(path)
}

/// Locks a file or a folder for as long as it is open.
pub fn lock(file: &File) -> Lock {
    match rustix::fs::flock(file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Lock::Held,
        Err(Errno::WOULDBLOCK) => Lock::Taken,
        Err(_) => Lock::Unknown,
    }
}

/// A file without a name that can be given one by [`link`]; None where there are none.
#[cfg(any(target_os = "linux", target_os = "android"))]
pub fn nameless(folder: &Path) -> Option<File> {
    let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
    // Less the process's umask, as for any file that is created.
    let file = File::from(rustix::fs::open(folder, flags, rustix::fs::Mode::from_raw_mode(0o666)).ok()?);
    by_number(&file).symlink_metadata().is_ok().then_some(file)
}

/// A file without a name that can be given one by [`link`]; None where there are none.
#[cfg(not(any(target_os = "linux", target_os = "android")))]
pub fn nameless(_: &Path) -> Option<File> {
    None
}

/// Gives a file without a name one.
#[cfg(any(target_os = "linux", target_os = "android"))]
pub fn link(file: &File, path: &Path) -> io::Result<()> {
    use rustix::fs::{AtFlags, CWD};
    Ok(rustix::fs::linkat(CWD, by_number(file), CWD, path, AtFlags::SYMLINK_FOLLOW)?)
}

/// Gives a file without a name one.
#[cfg(not(any(target_os = "linux", target_os = "android")))]
pub fn link(_: &File, _: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// An open file's place among those of the process.
#[cfg(any(target_os = "linux", target_os = "android"))]
fn by_number(file: &File) -> std::path::PathBuf {
    use std::os::fd::AsRawFd;
    std::path::PathBuf::from(format!("/proc/self/fd/{}", file.as_raw_fd()))
}

/// Lets two names change places at once.
///
/// # Errors
/// [`io::ErrorKind::Unsupported`] where there is no such thing.
pub fn exchange(one: &Path, other: &Path) -> io::Result<()> {
    renamed(one, other, true)
}

/// Gives a file or a folder a name that nothing has yet.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`]; [`io::ErrorKind::Unsupported`] where there is no such thing.
pub fn rename_new(old: &Path, new: &Path) -> io::Result<()> {
    renamed(old, new, false)
}

#[cfg(any(target_os = "linux", target_os = "android", target_vendor = "apple"))]
fn renamed(old: &Path, new: &Path, exchanged: bool) -> io::Result<()> {
    use rustix::fs::{CWD, RenameFlags};
    let flags = if exchanged { RenameFlags::EXCHANGE } else { RenameFlags::NOREPLACE };
    match rustix::fs::renameat_with(CWD, old, CWD, new, flags) {
        Err(Errno::INVAL | Errno::NOSYS | Errno::NOTSUP) => Err(io::ErrorKind::Unsupported.into()),
        outcome => Ok(outcome?),
    }
}

#[cfg(not(any(target_os = "linux", target_os = "android", target_vendor = "apple")))]
fn renamed(_: &Path, _: &Path, _: bool) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Brings the names in a folder to the disk.
pub fn sync_names(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// Brings all that a folder holds to the disk.
#[cfg(any(target_os = "linux", target_os = "android"))]
pub fn sync_all_of(folder: &File, _: &Path) -> io::Result<()> {
    Ok(rustix::fs::syncfs(folder)?)
}

/// Brings all that a folder holds to the disk.
#[cfg(not(any(target_os = "linux", target_os = "android")))]
pub fn sync_all_of(_: &File, path: &Path) -> io::Result<()> {
    for entry in std::fs::read_dir(path)? {
        let path = entry?.path();
        let file = File::open(&path)?;
        if file.metadata()?.is_dir() {
            sync_all_of(&file, &path)?;
        } else {
            file.sync_all()?;
        }
    }
    Ok(())
}

/// Standard input.
pub struct StandardInput(Stdin);

impl StandardInput {
    pub fn new() -> StandardInput {
        StandardInput(io::stdin())
    }

    /// Reads what there is; None if nothing came for a tenth of a second, no bytes at the end.
    pub fn read(&mut self, piece: &mut [u8]) -> io::Result<Option<usize>> {
        const PATIENCE: Timespec = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };
        let mut ready = [PollFd::new(&self.0, PollFlags::IN)];
        match rustix::event::poll(&mut ready, Some(&PATIENCE)) {
            Ok(0) | Err(Errno::INTR) => Ok(None),
            Ok(_) => match rustix::io::read(&self.0, piece) {
                Err(Errno::INTR | Errno::AGAIN) => Ok(None),
                outcome => Ok(Some(outcome?)),
            },
            Err(error) => Err(error.into()),
        }
    }
}

/// A part of a file as memory.
pub type Map = Mmap;

/// Maps a part of a file, to be read once from its start to its end; None if that cannot be done.
pub fn map(file: &File, start: u64, len: usize) -> Option<Map> {
    let mut options = MmapOptions::new();
    options.offset(start).len(len);
    // SAFETY: the map is read-only, and `storage::mapped`, who alone has it, lends its bytes only after
    // checking the file's present length. Soundness still rests on other processes not shortening or rewriting
    // the file while a block is decoded; that module's introduction says what happens if they do. No bytes from
    // the map are trusted: every decoder takes them for arbitrary data. Of a temporary file, no byte that is mapped is written again.
    let map = unsafe { options.map(file) }.ok()?;
    // Only a hint for read-ahead: failure costs speed, not correctness.
    drop(map.advise(Advice::Sequential));
    Some(map)
}

/// Gives pages of a map back to the system.
pub fn give_back(map: &Map, start: usize, len: usize) {
    // SAFETY: the map is shared, read-only and backed by the file: a page given back is read from the file
    // again when it is next touched, by whichever block still needs it, with the same content. Failure is
    // harmless.
    drop(unsafe { map.unchecked_advise_range(UncheckedAdvice::DontNeed, start, len) });
}
