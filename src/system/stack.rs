//! Stack overflow: the crate `laz` calls itself once for each symbol "next sequence" of a GPS time layer (point formats 6 to 10), and a few bytes can hold a million of
//! them. That ends the process, since a stack that is used up cannot be unwound; but it ends with an error in the data, that names the file.
#![allow(unsafe_code)]

use std::cell::Cell;
use std::path::Path;
use std::ptr;
use std::sync::OnceLock;

use crate::error::words::as_options;
use crate::error::{Error, Kind};

thread_local! {
    /// What this thread says if its stack overflows: the beginning and the length of a text; null if that would be a defect of this program.
    static WORDS: Cell<(*const u8, usize)> = const { Cell::new((ptr::null(), 0)) };
}

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
    let words = as_options(&format!("asra-stream: {error}\n"));
    let before = WORDS.replace((words.as_ptr(), words.len()));
    let _restored = Restored(before);
    work()
}

struct Restored((*const u8, usize));

impl Drop for Restored {
    fn drop(&mut self) {
        WORDS.set(self.0);
    }
}

/// Says the words of this thread and ends the process; else leaves the signal to whoever had it before, when it comes again.
extern "C" fn tell(signal: i32, _: *mut libc::siginfo_t, _: *mut libc::c_void) {
    let (words, length) = WORDS.get();
    // SAFETY: `told` keeps the text as long as it is pointed to; all three calls may be made in a handler.
    unsafe {
        if !words.is_null() {
            libc::write(libc::STDERR_FILENO, words.cast(), length);
            libc::_exit(i32::from(Kind::Data.row().codes[0]));
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

    /// Set where this test is its own child.
    const CHILD: &str = "ASRA_STREAM_TEST_OVERFLOW";
    const NAME: &str = "system::stack::tests::a_stack_that_is_used_up_is_an_error_in_the_data";

    fn deep(n: u64) -> u64 {
        let here = black_box([n; 64]);
        if n == 0 { 0 } else { deep(black_box(n - 1)).wrapping_add(here[7]) }
    }

    #[test]
    fn a_stack_that_is_used_up_is_an_error_in_the_data() {
        match std::env::var(CHILD).as_deref() {
            Ok("told") => drop(told(Path::new("far/deep.laz"), || black_box(deep(u64::MAX)))),
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
                // Elsewhere it is a defect, which the standard library tells.
                let other = child("not told");
                assert_eq!(other.status.code(), None, "{}", String::from_utf8_lossy(&other.stderr));
            }
        }
    }
}
