//! Observers: who is told how far a run is, and may end it.

use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

use crossbeam_channel::RecvTimeoutError;

use crate::error::{Error, Result};
use crate::resources::workers::Workers;
use crate::run::phase::Phase;

/// How often an observer is asked whether the run is to end.
const ASKED_EVERY: Duration = Duration::from_millis(50);

/// How far a run is.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Update {
    /// The stage under way, or that has just ended.
    pub stage: Phase,
    /// What the stage counts: "points", "faces".
    pub unit: &'static str,
    /// How many of them are done.
    pub done: u64,
    /// How many there are in all, if that is known.
    pub total: Option<u64>,
    /// The part of the whole run that is done, from 0 to 1, if that can be told. It never falls.
    pub fraction: Option<f64>,
    /// Seconds that the run is likely to take from now on, if that can be told.
    pub seconds_left: Option<f64>,
    /// Whether the stage has ended.
    pub ended: bool,
}

/// Who is told how far a run is, and asked whether it should go on.
///
/// ```
/// use std::sync::atomic::{AtomicBool, Ordering};
///
/// use asra_stream::{Error, Observer, Reconstruction, Update};
///
/// /// Ends the run as soon as somebody says so.
/// #[derive(Default)]
/// struct Button(AtomicBool);
///
/// impl Observer for Button {
///     fn progress(&self, update: &Update) {
///         println!("{}: {} {}", update.stage.name(), update.done, update.unit);
///     }
///
///     fn is_cancelled(&self) -> bool {
///         self.0.load(Ordering::Relaxed)
///     }
/// }
///
/// let button = Button::default();
/// button.0.store(true, Ordering::Relaxed);
/// let points = vec![[0f32; 3]; 100_000];
/// let outcome = Reconstruction::of(&points).observer(&button).run();
/// assert!(matches!(outcome, Err(Error::Interrupted)));
/// ```
pub trait Observer: Sync {
    /// Is told when a stage begins and ends, and about ten times a second in between.
    fn progress(&self, update: &Update) {
        let _ = update;
    }

    /// Is told what there is to know: how a file was understood, what was left out.
    fn note(&self, message: &str) {
        let _ = message;
    }

    /// Whether the run is to end, with [`crate::Error::Interrupted`]. It is asked about twenty times a second, from a thread of its own.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Does some work, while an observer is asked from time to time whether the workers are to stop.
pub(crate) fn watched<R>(
    observer: Option<&dyn Observer>,
    workers: &Workers,
    work: impl FnOnce() -> Result<R>,
) -> Result<R> {
    let Some(observer) = observer else { return work() };
    let flag = workers.cancel_flag();
    if observer.is_cancelled() {
        return Err(Error::Interrupted);
    }
    let (over, is_over) = crossbeam_channel::bounded::<()>(0);
    thread::scope(|scope| {
        let watch = move || {
            while is_over.recv_timeout(ASKED_EVERY) == Err(RecvTimeoutError::Timeout) {
                if observer.is_cancelled() {
                    flag.store(true, Ordering::Relaxed);
                    return;
                }
            }
        };
        thread::Builder::new()
            .name("asra-observer".into())
            .spawn_scoped(scope, watch)
            .map_err(Error::io("threads", "start"))?;
        let outcome = work();
        drop(over);
        outcome
    })
}
