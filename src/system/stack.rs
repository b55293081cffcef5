//! Stack overflow: the crate `laz` calls itself once for each symbol "next sequence" of a GPS time layer (point formats 6 to 10), and a few bytes can hold a million of
//! them. That ends the process, since a stack that is used up cannot be unwound; but it ends with an error in the data, that names the file, in the run's report, too.
#![allow(unsafe_code)]

use std::cell::Cell;
use std::path::Path;
use std::ptr;
use std::sync::atomic::{AtomicPtr, Ordering};
use std::sync::{Arc, OnceLock};

use super::LastWords;
use crate::error::Error;
use crate::error::words::as_options;

thread_local! {
    /// What this thread says if its stack overflows; null if that would be a defect of this program.
    static WORDS: Cell<*const Words> = const { Cell::new(ptr::null()) };
}

/// The error, made before it is known whether it is needed: a handler can make nothing.
struct Words {
    line: String,
    report: String,
}

/// The report that is asked for; null if none is.
static REPORT: AtomicPtr<LastWords> = AtomicPtr::new(ptr::null_mut());

/// As long as this lives, the error is written to a report, too.
pub struct Reported(Arc<LastWords>);

impl Reported {
    /// From now on. There is one report at a time: that of the command.
    pub fn to(report: LastWords) -> Reported {
        let report = Arc::new(report);
        REPORT.store(Arc::as_ptr(&report).cast_mut(), Ordering::Release);
        Reported(report)
    }
}

impl Drop for Reported {
    fn drop(&mut self) {
        let own = Arc::as_ptr(&self.0).cast_mut();
        let _ = REPORT.compare_exchange(own, ptr::null_mut(), Ordering::AcqRel, Ordering::Relaxed);
    }
}

/// The exit code of a damaged input.
const CODE: u8 = 65;

/// What was done about the signal before.
static BEFORE: OnceLock<libc::sigaction> = OnceLock::new();

/// Lets the decompressor work on a file. If it uses up the stack, the process ends at once with the exit code of a damaged input, after an error line.
pub fn told<R>(path: &Path, work: impl FnOnce() -> R) -> R {
    BEFORE.get_or_init(|| {
        // SAFETY: the structures are plain numbers, for which zero is a value, and as large as the system takes them to be; the handler is a function of the kind
        // that the flags promise, does nothing but what is allowed in one, and lives as long as the process. It runs on the stack for signals that the standard
        // library gives every thread.
        unsafe {
            let (mut new, mut old): (libc::sigaction, libc::sigaction) = (std::mem::zeroed(), std::mem::zeroed());
            let handler: extern "C" fn(i32, *mut libc::siginfo_t, *mut libc::c_void) = tell;
            new.sa_sigaction = handler as usize;
            new.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
            libc::sigemptyset(&mut new.sa_mask);
            libc::sigaction(libc::SIGSEGV, &new, &mut old);
            old
        }
    });
    let error = Error::malformed(
        path,
        "a chunk of points",
        "compressed points",
        "a stream without end (the decompressor has used up its stack); `attributes` none reads no GPS times",
    );
    let report = if REPORT.load(Ordering::Acquire).is_null() {
        String::new()
    } else {
        let mut failure = error.failure(CODE);
        failure.error.message = as_options(&failure.error.message);
        serde_json::to_string_pretty(&failure).unwrap_or_default() + "\n"
    };
    let words = Words { line: as_options(&format!("asra-stream: {error}\n")), report };
    let before = WORDS.replace(&words);
    let _restored = Restored(before);
    work()
}

struct Restored(*const Words);

impl Drop for Restored {
    fn drop(&mut self) {
        WORDS.set(self.0);
    }
}

/// Says the words of this thread and ends the process; else leaves the signal to whoever had it before, when it comes again.
extern "C" fn tell(signal: i32, _: *mut libc::siginfo_t, _: *mut libc::c_void) {
    // SAFETY: `told` keeps the words, and whoever has the report keeps that, as long as they are pointed to; all calls may be made in a handler, and what writes
    // the report makes no others.
    unsafe {
        if let Some(words) = WORDS.get().as_ref() {
            libc::write(libc::STDERR_FILENO, words.line.as_ptr().cast(), words.line.len());
            if let Some(report) = REPORT.load(Ordering::Acquire).as_ref() {
                report.say(words.report.as_bytes());
            }
            libc::_exit(i32::from(CODE));
        }
        match BEFORE.get() {
            Some(before) => libc::sigaction(signal, before, ptr::null_mut()),
            None => libc::_exit(128 + signal),
        };
    }
}

#[cfg(test)]
mod tests {
    use std::hint::black_box;
    use std::process::Command;

    use super::*;
    use crate::error::Kind;
    use crate::storage::atomic_file::AtomicFile;

    /// Set where this test is its own child.
    const CHILD: &str = "ASRA_STREAM_TEST_OVERFLOW";
    const NAME: &str = "system::stack::tests::a_stack_that_is_used_up_is_an_error_in_the_data";

    fn deep(n: u64) -> u64 {
        let here = black_box([n; 64]);
        if n == 0 { 0 } else { deep(black_box(n - 1)).wrapping_add(here[7]) }
    }

    #[test]
    fn a_stack_that_is_used_up_is_an_error_in_the_data() {
        assert_eq!(Kind::Data.row().codes, [CODE]);
        match std::env::var(CHILD).as_deref() {
            Ok("told") => drop(told(Path::new("far/deep.laz"), || black_box(deep(u64::MAX)))),
            Ok(report) if report.ends_with(".json") => {
                let file = AtomicFile::report(Path::new(report)).unwrap();
                let _reported = Reported::to(file.last_words().unwrap());
                told(Path::new("far/deep.laz"), || black_box(deep(u64::MAX)));
            }
            Ok(_) => {
                assert_eq!(told(Path::new("far/deep.laz"), || deep(10)), 55);
                black_box(deep(u64::MAX));
            }
            Err(_) => {
                let child = |what: &str| {
                    let test = std::env::current_exe().unwrap();
                    Command::new(test).args([NAME, "--exact", "--nocapture"]).env(CHILD, what).output().unwrap()
                };
                let found = child("told");
                let words = String::from_utf8_lossy(&found.stderr).into_owned();
                assert_eq!(found.status.code(), Some(65), "{words}");
                assert!(words.starts_with("asra-stream: far/deep.laz: "), "{words}");
                assert!(words.contains("without end"), "{words}");
                let dir = tempfile::tempdir().unwrap();
                // A new report, and one that takes an older one's place.
                for before in [None, Some("older")] {
                    let path = dir.path().join("r.json");
                    before.inspect(|text| std::fs::write(&path, text).unwrap());
                    assert_eq!(child(path.to_str().unwrap()).status.code(), Some(65));
                    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
                    let error = &report["error"];
                    assert_eq!(
                        (&error["kind"], &error["code"], &error["path"]),
                        (&"data".into(), &65.into(), &"far/deep.laz".into())
                    );
                    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "nothing else is left");
                }
                // Elsewhere it is a defect, which the standard library tells.
                let other = child("not told");
                assert_eq!(other.status.code(), None, "{}", String::from_utf8_lossy(&other.stderr));
            }
        }
    }
}
