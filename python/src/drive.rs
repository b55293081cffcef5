//! Work on a thread of its own, while the caller's looks after Python: signals, and who wants to know how far it is.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use asra_stream::{Error, Observer, Result, Update};
use crossbeam_channel::RecvTimeoutError;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// How often Python is looked after.
const EVERY: Duration = Duration::from_millis(50);

/// What the work says, and whether it is to end.
#[derive(Default)]
pub struct Watch {
    over: AtomicBool,
    told: Mutex<Vec<Update>>,
}

impl Observer for Watch {
    fn progress(&self, update: &Update) {
        let mut told = self.told.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        // Of a stage under way, the last word counts.
        if told.last().is_some_and(|last| last.stage == update.stage && !last.ended) {
            told.pop();
        }
        told.push(*update);
    }

    fn is_cancelled(&self) -> bool {
        self.over.load(Ordering::Relaxed)
    }
}

/// Does some work without the interpreter's lock. Ctrl-C, or an exception in `progress`, ends it, and is raised when it has ended.
pub fn drive<R: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Watch) -> Result<R> + Send,
) -> PyResult<R> {
    let watch = Watch::default();
    let (done, is_done) = crossbeam_channel::bounded::<()>(1);
    let mut exception = None;
    let outcome = thread::scope(|scope| {
        let watch = &watch;
        let working = thread::Builder::new().name("asra-run".into()).spawn_scoped(scope, move || {
            let outcome = work(watch);
            drop(done);
            outcome
        });
        let working = working.map_err(Error::io("threads", "start"))?;
        while py.detach(|| is_done.recv_timeout(EVERY)) == Err(RecvTimeoutError::Timeout) {
            if exception.is_none() {
                exception = py.check_signals().and_then(|()| tell(py, watch, progress)).err();
                watch.over.store(exception.is_some(), Ordering::Relaxed);
            }
        }
        py.detach(|| working.join()).unwrap_or_else(|_| Err(Error::Internal("a panic in the run".into())))
    });
    if exception.is_none() {
        exception = py.check_signals().and_then(|()| tell(py, &watch, progress)).err();
    }
    match exception {
        Some(exception) => Err(exception),
        None => outcome.map_err(|error| raised(py, error)),
    }
}

fn tell(py: Python<'_>, watch: &Watch, progress: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
    let told = std::mem::take(&mut *watch.told.lock().unwrap_or_else(std::sync::PoisonError::into_inner));
    let Some(progress) = progress else { return Ok(()) };
    for update in told {
        let words = PyDict::new(py);
        words.set_item("stage", update.stage.name())?;
        words.set_item("unit", update.unit)?;
        words.set_item("done", update.done)?;
        words.set_item("total", update.total)?;
        words.set_item("fraction", update.fraction)?;
        words.set_item("seconds_left", update.seconds_left)?;
        words.set_item("ended", update.ended)?;
        progress.call1((words,))?;
    }
    Ok(())
}

/// The error as the exception that the Python files have for its kind.
pub fn raised(py: Python<'_>, error: Error) -> PyErr {
    if matches!(error, Error::Interrupted) {
        return PyKeyboardInterrupt::new_err("interrupted");
    }
    let code = asra_stream::cli::exit_code(&error);
    let failure = serde_json::to_string(&error.failure(code).error).unwrap_or_default();
    let make = || py.import("asra_stream._errors")?.getattr("of")?.call1((failure,));
    make().map_or_else(|second| second, PyErr::from_value)
}
