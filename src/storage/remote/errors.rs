//! What stores answer, in a few words.

use std::error::Error as _;
use std::io;

use object_store::Error;

/// The most letters of an answer that are told.
const MOST: usize = 300;

/// What stores say where no bucket is, and to whom they do not know.
const MISSING: [&str; 2] = ["NoSuchBucket", "ContainerNotFound"];
const DENIED: [&str; 6] = [
    "AccessDenied",
    "InvalidAccessKeyId",
    "SignatureDoesNotMatch",
    "ExpiredToken",
    "InvalidToken",
    "AuthenticationFailed",
];

/// Where clients ask the machine for its credentials when the environment has none.
const OF_MACHINE: [&str; 3] = ["169.254.169.254", "169.254.170.2", "metadata.google"];

/// An error of a store as one of the system.
pub fn told(error: &Error) -> io::Error {
    let kind = match error {
        Error::NotFound { .. } => io::ErrorKind::NotFound,
        Error::AlreadyExists { .. } | Error::Precondition { .. } | Error::NotModified { .. } => {
            io::ErrorKind::AlreadyExists
        }
        Error::PermissionDenied { .. } | Error::Unauthenticated { .. } => io::ErrorKind::PermissionDenied,
        Error::InvalidPath { .. } | Error::UnknownConfigurationKey { .. } => io::ErrorKind::InvalidInput,
        Error::NotSupported { .. } | Error::NotImplemented { .. } => io::ErrorKind::Unsupported,
        _ => io::ErrorKind::Other,
    };
    let words = match words(error) {
        words if OF_MACHINE.iter().any(|address| words.contains(address)) => {
            format!("no credentials are set in the environment, and the machine has none to give: {words}")
        }
        words => words,
    };
    // Not all requests tell these apart from failures.
    let says = |codes: &[&str]| kind == io::ErrorKind::Other && codes.iter().any(|code| words.starts_with(code));
    let kind = match () {
        () if says(&MISSING) => io::ErrorKind::NotFound,
        () if says(&DENIED) => io::ErrorKind::PermissionDenied,
        () => kind,
    };
    io::Error::new(kind, words)
}

/// What is said of an error by whoever knows most of it, on one line.
fn words(error: &Error) -> String {
    let mut all = vec![error.to_string()];
    let mut source = error.source();
    while let Some(inner) = source {
        all.push(inner.to_string());
        source = inner.source();
    }
    let tag = |name: &str| {
        let (open, close) = (format!("<{name}>"), format!("</{name}>"));
        all.iter().find_map(|text| Some(text.split_once(&open)?.1.split_once(&close)?.0.to_owned()))
    };
    let words = match (tag("Code"), tag("Message")) {
        (Some(code), Some(message)) => format!("{code}: {message}"),
        (Some(code), None) => code,
        // The store's own words come with all that was tried; the last source says why.
        _ if all.len() > 1 => {
            let last = all.pop().unwrap_or_default();
            let before = all.pop().unwrap_or_default();
            if before.contains(&last) { before } else { format!("{before}: {last}") }
        }
        _ => all.pop().unwrap_or_default(),
    };
    let line: Vec<&str> = words.split_whitespace().collect();
    let mut line = line.join(" ");
    if line.len() > MOST {
        let end = (0..=MOST).rev().find(|at| line.is_char_boundary(*at)).unwrap_or(0);
        line.truncate(end);
        line.push_str("...");
    }
    line
}
