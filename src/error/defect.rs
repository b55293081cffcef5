//! Panics, which are defects of this program: they become errors like any other, so that nothing waits and nothing is left behind.

use std::any::Any;
use std::panic::{self, AssertUnwindSafe};
use std::sync::{Mutex, PoisonError};

use crate::error::{Error, Result};

/// Where the last panic was, if [`keep_for_the_error`] was called.
static PLACE: Mutex<Option<String>> = Mutex::new(None);

/// Does some work; a panic in it is an [`Error::Internal`].
///
/// # Errors
/// Errors of the work.
pub fn caught<R>(work: impl FnOnce() -> Result<R>) -> Result<R> {
    // What the work has seen half done is dropped with the run: every caller gives the error on.
    panic::catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| Err(Error::Internal(words(&*payload))))
}

/// From now on, a panic writes nothing to standard error: its words and its place come with the error. With `RUST_BACKTRACE`, the trace is still written.
pub fn keep_for_the_error() {
    let usual = panic::take_hook();
    let traced = std::env::var_os("RUST_BACKTRACE").is_some_and(|value| value != "0");
    panic::set_hook(Box::new(move |info| {
        *PLACE.lock().unwrap_or_else(PoisonError::into_inner) = info.location().map(ToString::to_string);
        if traced {
            usual(info);
        }
    }));
}

fn words(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().copied().or(payload.downcast_ref::<String>().map(String::as_str));
    let text = text.unwrap_or("a panic without words");
    match PLACE.lock().unwrap_or_else(PoisonError::into_inner).take() {
        Some(place) => format!("{text}, at {place}"),
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_with_its_words() {
        let told = |work: fn()| {
            caught(|| {
                work();
                Ok(())
            })
            .unwrap_err()
            .to_string()
        };
        assert!(told(|| panic!("three")).starts_with("internal error: three"));
        assert!(told(|| panic!("{}", 4)).starts_with("internal error: 4"));
        assert!(told(|| panic::panic_any(5)).contains("without words"));
        assert_eq!(caught(|| Ok(6)).unwrap(), 6);
    }
}
