//! Signals that end a run: it stops at the next job, removes what it made so far, and tells by its exit code which one it was.

use std::fs;
use std::io;
use std::sync::Arc;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::SIGINT;
use signal_hook::flag;

use crate::error::{Error, Result};
use crate::resources::workers::Workers;
use crate::system;

/// The first of them that came; 0 if none did.
static CAME: OnceLock<Arc<AtomicUsize>> = OnceLock::new();

/// Lets signals stop `workers` at the next job; a second one ends the process at once. A signal that was ignored when the process began stays so: that is
/// how `nohup`, and a shell's `&` in a script, protect a run.
///
/// # Errors
/// [`Error::Io`] if the system refuses.
pub fn stop(workers: &Workers) -> Result<()> {
    let ignored = ignored(&fs::read_to_string("/proc/self/status").unwrap_or_default());
    let (came, flag) = (CAME.get_or_init(Arc::default), workers.cancel_flag());
    let set = || -> io::Result<()> {
        for signal in system::ENDING.into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0) {
            // In this order: the first signal finds the flag unset.
            flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(&flag))?;
            flag::register_usize(signal, Arc::clone(came), signal as usize)?;
            flag::register(signal, Arc::clone(&flag))?;
        }
        // A file that is longer than a limit allows is an error of writing, and no reason to die.
        for signal in system::WRITTEN_TOO_FAR {
            flag::register(signal, Arc::new(AtomicBool::new(false)))?;
        }
        Ok(())
    };
    set().map_err(Error::io("signals", "handle"))
}

/// The exit code of a run that a signal ended.
pub fn exit_code() -> u8 {
    let came = CAME.get().map_or(0, |came| came.load(Ordering::Relaxed));
    128 + if came == 0 { SIGINT as u8 } else { came as u8 }
}

/// The signals that a process ignores, a bit each, from what the system says of its status.
fn ignored(status: &str) -> u64 {
    let line = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    line.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use signal_hook::consts::SIGHUP;

    use super::*;

    #[test]
    fn ignored_signals_are_found_in_the_status() {
        let status = "Name:\tasra\nSigBlk:\t0000000000000000\nSigIgn:\t0000000000001001\nSigCgt:\t0000000000004002\n";
        assert_eq!((ignored(status), ignored("Name:\tasra\n")), (1 << 12 | 1 << (SIGHUP - 1), 0));
    }
}
