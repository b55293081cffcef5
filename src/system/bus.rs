//! SIGBUS: what the system says where a page of a mapped file is no more, since the file was cut, or cannot be read.
//!
//! A page of zeros is put in its place, and the file is remembered; whoever reads the file asks at the end, as for other changes, and drops what it
//! made of the zeros. So the process lives, removes what it made, and says which file it was.
#![allow(unsafe_code)]

use std::path::{Path, PathBuf};
use std::ptr;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

/// Maps at a time that can be watched; a file beyond that is read without a map.
const SLOTS: usize = 256;

/// A stretch of memory that is a map.
struct Slot {
    taken: AtomicBool,
    /// 0 while there is none.
    start: AtomicUsize,
    end: AtomicUsize,
    lost: AtomicBool,
}

static MAPS: [Slot; SLOTS] = [const {
    Slot {
        taken: AtomicBool::new(false),
        start: AtomicUsize::new(0),
        end: AtomicUsize::new(0),
        lost: AtomicBool::new(false),
    }
}; SLOTS];

/// Whether a page was lost at all: nearly always not.
static ANY: AtomicBool = AtomicBool::new(false);
/// The files of maps, by their slots, and files of earlier maps that have lost a page.
static PATHS: Mutex<(Vec<PathBuf>, Vec<PathBuf>)> = Mutex::new((Vec::new(), Vec::new()));
/// The length of a page, and what was done about the signal before.
static BEFORE: OnceLock<(usize, libc::sigaction)> = OnceLock::new();

/// A map that is watched as long as this lives, which must be no longer than the map.
#[derive(Debug)]
pub struct Watched(usize);

/// Watches a map of `path`, a page of which that is lost does not end the process any more; `None` if there are too many.
pub fn watch(path: &Path, map: &[u8]) -> Option<Watched> {
    survive();
    let slot = MAPS.iter().position(|slot| !slot.taken.swap(true, Ordering::AcqRel))?;
    {
        let paths = &mut PATHS.lock().unwrap_or_else(PoisonError::into_inner).0;
        paths.resize(paths.len().max(slot + 1), PathBuf::new());
        paths[slot] = path.to_path_buf();
    }
    MAPS[slot].end.store(map.as_ptr() as usize + map.len(), Ordering::Release);
    MAPS[slot].start.store(map.as_ptr() as usize, Ordering::Release);
    Some(Watched(slot))
}

impl Drop for Watched {
    fn drop(&mut self) {
        let slot = &MAPS[self.0];
        slot.start.store(0, Ordering::Release);
        slot.end.store(0, Ordering::Release);
        if slot.lost.swap(false, Ordering::AcqRel) {
            let (paths, lost) = &mut *PATHS.lock().unwrap_or_else(PoisonError::into_inner);
            if !lost.contains(&paths[self.0]) {
                lost.push(paths[self.0].clone());
            }
        }
        slot.taken.store(false, Ordering::Release);
    }
}

/// Whether a page of a map of `path` was lost.
pub fn lost(path: &Path) -> bool {
    if !ANY.load(Ordering::Acquire) {
        return false;
    }
    let (paths, lost) = &*PATHS.lock().unwrap_or_else(PoisonError::into_inner);
    let there = |(slot, of): (&Slot, &PathBuf)| slot.lost.load(Ordering::Acquire) && of == path;
    lost.iter().any(|of| of == path) || MAPS.iter().zip(paths).any(there)
}

/// From now on, a page of a watched map that is lost does not end the process. Where the system refuses that, it does.
fn survive() {
    BEFORE.get_or_init(|| {
        // SAFETY: the structures are plain numbers, for which zero is a value, and as large as the system takes them to be; the handler is a function of the kind
        // that the flags promise, does nothing but what is allowed in one, and lives as long as the process.
        unsafe {
            let (mut new, mut old): (libc::sigaction, libc::sigaction) = (std::mem::zeroed(), std::mem::zeroed());
            let handler: extern "C" fn(i32, *mut libc::siginfo_t, *mut libc::c_void) = mend;
            new.sa_sigaction = handler as usize;
            new.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
            libc::sigemptyset(&mut new.sa_mask);
            libc::sigaction(libc::SIGBUS, &new, &mut old);
            (libc::sysconf(libc::_SC_PAGESIZE).max(1) as usize, old)
        }
    });
}

/// Puts a page of zeros where one is lost, if it is of a watched map; else leaves the signal to whoever had it before, when it comes again.
extern "C" fn mend(signal: i32, info: *mut libc::siginfo_t, _: *mut libc::c_void) {
    let Some((page, before)) = BEFORE.get() else {
        // SAFETY: it may be called in a handler, and ends the process, as the signal would have.
        unsafe { libc::_exit(128 + signal) };
    };
    // SAFETY: the system hands a handler of this kind the structure, and for this signal it holds the address.
    let at = unsafe { (*info).si_addr() } as usize;
    let (start, length) = (at / page * page, *page);
    for slot in &MAPS {
        let (from, to) =
            (slot.start.load(Ordering::Acquire), slot.end.load(Ordering::Acquire).next_multiple_of(length));
        if from != 0 && (from..to).contains(&at) {
            // SAFETY: the page lies within a map of this process that is only ever read, as plain bytes; it is replaced by another that can be read. No
            // memory is taken or freed by the program's allocator, and no lock is held: it is a call of the system alone.
            let new = unsafe {
                let how = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_FIXED;
                libc::mmap(ptr::without_provenance_mut(start), length, libc::PROT_READ, how, -1, 0)
            };
            if new != libc::MAP_FAILED {
                slot.lost.store(true, Ordering::Release);
                ANY.store(true, Ordering::Release);
                return;
            }
        }
    }
    // SAFETY: what was installed before is installed again, and may be so in a handler.
    unsafe { libc::sigaction(signal, before, ptr::null_mut()) };
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::sync::Arc;

    use super::*;
    use crate::storage::mapped::Content;

    #[test]
    fn a_file_cut_under_a_block_is_survived_and_remembered() {
        let dir = tempfile::tempdir().unwrap();
        let [path, other] = ["cut", "whole"].map(|name| dir.path().join(name));
        for path in [&path, &other] {
            std::fs::write(path, vec![7; 300_000]).unwrap();
        }
        let [file, whole] = [&path, &other].map(|path| Content::named(path).open().unwrap());
        let (bytes, beside) = (file.bytes(0..300_000).unwrap(), whole.bytes(0..300_000).unwrap());
        assert!(!lost(&path));
        File::options().write(true).open(&path).unwrap().set_len(8192).unwrap();
        assert_eq!((bytes[0], bytes[299_999], bytes[150_000]), (7, 0, 0));
        assert_eq!((beside[0], beside[299_999]), (7, 7));
        assert!(lost(&path) && !lost(&other));
        drop((bytes, Arc::into_inner(file)));
        assert!(lost(&path) && !lost(&other), "also when the map is gone");
    }
}
