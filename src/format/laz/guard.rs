//! The crate `laz` panics at some files that are damaged. That is no defect of this program, but an error in the data, as which it is told.

use std::any::Any;
use std::cell::Cell;
use std::io::{Error, ErrorKind, Result};
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

thread_local! {
    /// Whether a panic of this thread is going to be an error, so that nothing is to be said of it.
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Lets the decompressor work; a panic in it is an error of kind [`ErrorKind::InvalidData`]. It must not be used again after that.
pub fn guarded<R>(work: impl FnOnce() -> Result<R>) -> Result<R> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let usual = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !GUARDED.get() {
                usual(info);
            }
        }));
    });
    let before = GUARDED.replace(true);
    let outcome = panic::catch_unwind(AssertUnwindSafe(work));
    GUARDED.set(before);
    outcome.unwrap_or_else(|payload| Err(Error::new(ErrorKind::InvalidData, words(&*payload))))
}

fn words(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().copied().or(payload.downcast_ref::<String>().map(String::as_str));
    format!("a stream that cannot be ({})", text.unwrap_or("the decompressor gave up"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_in_the_data_and_a_result_is_a_result() {
        let error = guarded(|| -> Result<()> { panic!("index {} is out of range", 7) }).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::InvalidData);
        assert!(error.to_string().contains("index 7 is out of range"), "{error}");
        assert!(!GUARDED.get());
        assert_eq!(guarded(|| Ok(3)).unwrap(), 3);
        // One within another, and what comes after it.
        assert_eq!(
            guarded(|| Ok(guarded(|| -> Result<()> { panic!("inner") }).is_err() && GUARDED.get())).ok(),
            Some(true)
        );
    }
}
