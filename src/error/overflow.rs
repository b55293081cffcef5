//! Stack overflow in a decompressor, which becomes an error in the data. It cannot be unwound, so the process ends; but first it tells the error, that names the file, as
//! it tells any other.
//!
//! The crate `laz` calls itself once for each symbol "next sequence" of a GPS time layer (point formats 6 to 10), and a few bytes can hold a million of them.

use std::path::Path;
use std::sync::{PoisonError, RwLock};

use super::words::as_options;
use super::{Error, Kind};
use crate::system::Farewell;
use crate::system::stack;

/// Makes what is told of an error.
type Teller = Box<dyn Fn(&Error) -> Farewell + Send + Sync>;

/// The command's, if this process is one.
static TELLER: RwLock<Option<Teller>> = RwLock::new(None);

/// From now on, the error is told as `teller` says.
pub fn told_by(teller: impl Fn(&Error) -> Farewell + Send + Sync + 'static) {
    *TELLER.write().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(teller));
}

/// Lets the decompressor work on a file. If it uses up the stack, the process ends at once with the exit code of a damaged input, after an error line.
pub fn told<R>(path: &Path, work: impl FnOnce() -> R) -> R {
    let error = Error::malformed(
        path,
        "a chunk of points",
        "compressed points",
        "a stream without end (the decompressor has used up its stack); `attributes` none reads no GPS times",
    );
    let farewell = match &*TELLER.read().unwrap_or_else(PoisonError::into_inner) {
        Some(teller) => teller(&error),
        None => Farewell {
            code: Kind::Data.row().codes[0],
            line: as_options(&format!("asra-stream: {error}\n")),
            report: String::new(),
        },
    };
    stack::ending(&farewell, work)
}
