//! What is told of a command that failed: its exit code, and the failure as reports have it.

use super::signals;
use crate::error::words::as_options;
use crate::error::{Error, Failure, Kind};

/// The exit code of a command that failed.
pub fn exit_code(error: &Error) -> u8 {
    match error.kind() {
        Kind::Signal => signals::exit_code(),
        kind => kind.row().codes[0],
    }
}

/// What a report has of a failure: in the command's words.
pub fn failure(error: &Error) -> Failure {
    let mut failure = error.failure(exit_code(error));
    failure.error.message = as_options(&failure.error.message);
    failure
}
