//! What a process says that ends because its stack is used up: that cannot be unwound, so a handler of the signal says what was prepared, and ends the process.
#![allow(unsafe_code)]

use std::cell::Cell;
use std::ptr;
use std::sync::atomic::{AtomicPtr, Ordering};
use std::sync::{Arc, OnceLock};

use super::answers::Farewell;
use super::last_words::LastWords;

thread_local! {
    /// What this thread says if its stack overflows; null if that would be a defect of this program.
    static FAREWELL: Cell<*const Farewell> = const { Cell::new(ptr::null()) };
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

/// What was done about the signal before.
static BEFORE: OnceLock<libc::sigaction> = OnceLock::new();

/// Does some work. If it uses up the stack, the process ends at once, and says this.
pub fn ending<R>(farewell: &Farewell, work: impl FnOnce() -> R) -> R {
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
    let _restored = Restored(FAREWELL.replace(farewell));
    work()
}

struct Restored(*const Farewell);

impl Drop for Restored {
    fn drop(&mut self) {
        FAREWELL.set(self.0);
    }
}

/// Says the farewell of this thread and ends the process; else leaves the signal to whoever had it before, when it comes again.
extern "C" fn tell(signal: i32, _: *mut libc::siginfo_t, _: *mut libc::c_void) {
    // SAFETY: whoever called `ending` keeps the farewell, and whoever has the report keeps that, as long as they are pointed to; all calls may be made in a handler, and what writes
    // the report makes no others.
    unsafe {
        if let Some(Farewell { code, line, report }) = FAREWELL.get().as_ref() {
            libc::write(libc::STDERR_FILENO, line.as_ptr().cast(), line.len());
            if let Some(file) = REPORT.load(Ordering::Acquire).as_ref() {
                file.say(report.as_bytes());
            }
            libc::_exit(i32::from(*code));
        }
        match BEFORE.get() {
            Some(before) => libc::sigaction(signal, before, ptr::null_mut()),
            None => libc::_exit(128 + signal),
        };
    }
}
