//! What the system is asked for and what it answers: plain values, the same on all of them.

use std::ffi::OsString;

/// A name in a folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// The name alone, without the folder's.
    pub name: OsString,
    /// What it is.
    pub kind: EntryKind,
}

/// What a name in a folder is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EntryKind {
    /// A file.
    File,
    /// A folder.
    Folder,
    /// A link, a pipe, a device.
    Other,
}

/// Bytes of a file system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Space {
    /// Free, for users like this one.
    pub available: u64,
    /// All.
    pub capacity: u64,
}

/// What became of an attempt to lock a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lock {
    /// It is locked.
    Held,
    /// Somebody else has the lock.
    Taken,
    /// There are no locks here.
    Unknown,
}

/// How a file in the making gets its name.
#[derive(Debug, Clone, Copy)]
pub enum Naming {
    /// It has it already.
    None,
    /// It has a hidden one.
    Rename,
    /// It has none.
    Link,
}

/// What is said if the stack overflows, made before it is known whether it is needed: a handler can make nothing.
#[derive(Debug)]
#[cfg_attr(windows, expect(dead_code, reason = "this system tells it by itself"))]
pub struct Farewell {
    /// The exit code.
    pub code: u8,
    /// For standard error.
    pub line: String,
    /// For the report, if one is asked for.
    pub report: String,
}
